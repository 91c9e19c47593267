"""The benchmark's own arithmetic: frames, rows, statistics and the bound."""

from dataclasses import replace
from pathlib import Path

import bound
import compare_paper_rows
import numpy as np
import paper_score
import pytest
import result_tables
import tune
from collect import Results
from frames import Cell, frame, table_cells
from methods import make, missing, source_digest
from rows import Row, Store, read
from runner import run
from stats import summary

import napari_splinesketch
from napari_splinesketch import metrics, synthetic

CELL = Cell(2, "displacement", 10.0)


def row(index: int = 0, body: int = 0, dtw: float = 1.0, **changes: object) -> Row:
    made = Row("m", "1", "aa", 2, "pca", 2.0, index, body, 6.0, dtw, 0.1, 0.5, "good", 1.0, 2.0)
    return replace(made, **changes)  # pyright: ignore[reportArgumentType]


def test_the_version_counts_what_refining_imports_and_no_more(tmp_path, monkeypatch):
    engine = tmp_path / "engine"
    engine.mkdir()
    package = "napari_splinesketch.engine"
    (engine / "refine.py").write_text(f"from {package} import a\ndef f():\n    import numpy\n")
    (engine / "a.py").write_text(f"def g():\n    from {package}.b import h\n    return h\n")
    for name in ("b", "other"):
        (engine / f"{name}.py").write_text("def h(): return 1\n")
    monkeypatch.setattr(napari_splinesketch, "__file__", str(tmp_path / "__init__.py"))
    before = source_digest()
    (engine / "other.py").write_text("def h(): return 2\n")
    (engine / "b.py").write_text("# why\ndef h():  return 1\n")
    assert source_digest() == before
    (engine / "b.py").write_text("def h(): return 2\n")
    assert source_digest() != before


def test_frames_are_the_same_every_time_and_tuning_frames_are_others():
    again = frame(CELL, 3)
    assert frame(CELL, 3).checksum == again.checksum
    assert frame(CELL, 3, tuning=True).checksum != again.checksum
    assert len(again.sketches) == len(again.truths) == 2


@pytest.mark.parametrize("cell", table_cells()[:4], ids=lambda cell: cell.kind)
def test_sketches_are_spoilt_as_the_cell_says(cell):
    given = frame(cell, 0)
    truth, sketch = given.truths[0], given.sketches[0]
    away = np.linalg.norm(sketch - truth, axis=1)
    if cell.kind == "displacement":
        np.testing.assert_allclose(away, 10)
    if cell.kind == "scaling":
        centre = truth.mean(axis=0)
        np.testing.assert_allclose(sketch - centre, 0.7 * (truth - centre))
    if cell.kind == "rotation":
        from_centre = np.linalg.norm(truth - truth.mean(axis=0), axis=1)
        np.testing.assert_allclose(away, 2 * np.sin(np.deg2rad(10)) * from_centre)
    if cell.kind == "pca":
        np.testing.assert_allclose(sketch, synthetic.compress(truth, 2))


def test_summary_by_hand():
    rows = [row(0, 0, 1.0), row(0, 1, 3.0), row(1, 0, 0.2), row(1, 1, 0.4, cpu=4.0, initial=0.3)]
    rows[2] = replace(rows[2], cpu=4.0)
    found = summary(rows)
    assert found is not None
    assert (found.frames, found.bodies) == (2, 4)
    assert found.best_half == pytest.approx(0.3)
    assert found.mean == pytest.approx(1.15)
    assert found.median == pytest.approx(0.7)
    assert found.far == 0.25
    assert found.worse == 0.25
    assert found.seconds == pytest.approx(3.0)
    assert summary([]) is None


def test_rows_are_kept_until_the_version_or_the_frame_changes(tmp_path):
    store = Store("m", "1", tmp_path)
    store.add([row(0, 0), row(0, 1)])
    store.add([row(1, 0)])
    with store.path.open("a", encoding="utf-8") as file:
        file.write("m,1,aa,2,pca")  # as after a power cut
    again = Store("m", "1", tmp_path)
    assert again.rows == [row(0, 0), row(0, 1), row(1, 0)]
    assert again.has(row().cell, 0, "aa")
    assert not again.has(row().cell, 0, "bb")
    again.add([row(0, 0, frame="bb")])
    assert list(read(again.path)) == [row(1, 0), row(0, 0, frame="bb")]
    assert Store("m", "2", tmp_path).rows == []


@pytest.mark.parametrize("name", ["sketch", "active_contour", "filaments"])
@pytest.mark.filterwarnings("ignore")
def test_methods_answer_every_sketch(name):
    if missing(name):
        pytest.skip(missing(name) or "")
    given = frame(CELL, 0)
    answer = make(name).run(given)
    assert [c.shape for c in answer.curves] == [(100, 2)] * 2
    assert np.all(np.isfinite(np.stack(answer.curves)))
    before = metrics.average_dtw(given.sketches[0], given.truths[0])
    after = metrics.average_dtw(answer.curves[0], given.truths[0])
    if name == "active_contour":
        assert after < before


def test_a_run_goes_on_where_it_stopped(tmp_path, monkeypatch):
    monkeypatch.setattr("runner.Store", lambda name, version: Store(name, version, tmp_path))
    method = make("sketch")
    assert run(method, [CELL], 2, deadline=np.inf) == 2
    assert run(method, [CELL], 3, deadline=np.inf) == 1
    assert run(method, [CELL], 9, deadline=-np.inf) == 0
    rows = list(read(tmp_path / "sketch.csv"))
    assert len(rows) == 6
    assert all(r.dtw == r.initial for r in rows)


def test_the_area_under_the_curve_by_hand():
    failed = np.array([False, True, False, True])
    assert paper_score.area(np.array([1.0, 3.0, 2.0, 4.0]), failed) == 1.0
    assert paper_score.area(np.array([4.0, 1.0, 3.0, 2.0]), failed) == 0.0
    assert paper_score.area(np.array([1.0, 2.0, 3.0, 4.0]), failed) == 0.75
    assert paper_score.area(np.ones(4), failed) == 0.5
    assert np.isnan(paper_score.area(np.ones(4), np.ones(4, bool)))


def test_ours_and_the_reference_are_compared_on_the_frames_that_both_have():
    def found(method: str, index: int, dtw: float, seconds: float) -> compare_paper_rows.Row:
        return compare_paper_rows.Row(
            method, 3, "chord", 0.0, 8 + index, 9.0, dtw, 2 * dtw, 0.1, seconds, 0.0
        )

    rows = [found("paper", i, 0.5 * i, 2.0) for i in range(5)]
    rows += [found("splender-phases", i, 1.0 * i, 30.0) for i in range(1, 4)]
    (line,) = compare_paper_rows.side_by_side(rows).splitlines()[2:]
    given = [cell.strip() for cell in line.split("|")[1:-1]]
    assert given[0] == "line between the ends"
    assert given[1:] == ["3", "3", "1.00", "2.00", "1.00", "2.00", "1", "2", "15"]


def test_what_decides_about_the_papers_method_is_not_what_decides_about_the_others():
    assert len({make(name).version for name in ("balanced", "paper")}) == 2
    assert source_digest(without="paper.result") != source_digest()


@pytest.mark.slow
def test_tables_have_what_the_paper_prints():
    results = Results(["sketch"])
    found = result_tables.table(results, table_cells(), lambda s: "x", lambda s: "y")
    assert "7.18 / 1.63 / 2.49" in found.splitlines()[-4]
    assert "0.28 / 0.30" not in found
    assert "2.06 / 2.32 / 2.89 / 3.98" in result_tables.percentiles(results).splitlines()[-1]


def test_bound_differentiates_the_image():
    scene = synthetic.scene(3, blur=1.0, bend=0.0)
    curve = scene.centrelines[0]
    columns = list(bound.derivatives(scene))[: bound.MOVES]
    across, along = columns[: bound.KNOTS], columns[bound.KNOTS :]
    directions = bound.moves(curve)
    for parts, direction in ((across, directions[: bound.KNOTS]), (along, directions[-2:])):
        step = bound.MOVE_STEP * direction.sum(axis=0)
        ahead, behind = (
            bound.render(replace(scene, centrelines=(curve + sign * step,))) for sign in (1, -1)
        )
        whole = (ahead - behind) / (2 * bound.MOVE_STEP)
        np.testing.assert_allclose(sum(parts), whole, atol=0.03 * np.abs(whole).max())


def test_moves_are_normal_and_tangential():
    curve = synthetic.scene(3).centrelines[0]
    tangent = np.gradient(curve, axis=0)
    directions = bound.moves(curve)
    across = np.einsum("knd,nd->kn", directions[: bound.KNOTS], tangent)
    np.testing.assert_allclose(across, 0, atol=1e-12)
    unit = np.linalg.norm(directions[: bound.KNOTS].sum(axis=0), axis=1)
    np.testing.assert_allclose(unit, 1)
    np.testing.assert_allclose(directions[-2, -1], 0, atol=1e-12)
    assert directions[-1, -1] @ tangent[-1] > 0


def test_bound_grows_with_the_noise():
    quiet = synthetic.scene(3)
    loud = replace(quiet, noise_sd=2 * quiet.noise_sd)
    quiet_sd, loud_sd = (
        np.sqrt(np.diag(bound.covariance(s))[: bound.MOVES]) for s in (quiet, loud)
    )
    np.testing.assert_allclose(loud_sd / quiet_sd, 2, rtol=0.02)
    assert np.all((quiet_sd > 0.01) & (quiet_sd < 0.4))


def test_tune_says_what_it_takes(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["tune.py", "--help"])
    with pytest.raises(SystemExit):
        tune.main()
    assert "{active_contour,filaments,splender}" in capsys.readouterr().out


def test_no_script_starts_measuring_when_asked_for_help() -> None:
    scripts = [path for path in Path(__file__).parent.glob("*.py") if "test_" not in path.name]
    told = {path.name: path.read_text("utf-8") for path in scripts}
    deaf = [n for n, t in told.items() if "parse_args()" not in t and "sys.argv" not in t]
    assert not [name for name in deaf if "__main__" in told[name]]
