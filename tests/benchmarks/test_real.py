"""The judge of the benchmark of other images, and how its cases are read."""

import json
import shutil
import sys
from functools import partial

import numpy as np
import pytest
import real
import real_foreign
import real_judge
import real_modes
import real_page
import skimage.io
from real_cases import (
    FOLDERS,
    FREEHAND,
    FRESH,
    RIGHT,
    Case,
    by_arc,
    freehand,
    in_folders,
    jittered,
    length_of,
    read,
    split_of,
)

from napari_splinesketch.engine.find import finding, hollow

PERMISSIVE = ("Apache-2.0", "BSD-", "CC0", "CC-BY-4.0", "MIT", "PDDL-1.0", "public domain")
ROUNDED = ("bacteria", "flower_stems", "joints", "petals", "ropes", "stick", "straws")
"""Images in which rounding moved many curves."""
LINE = np.array([[50.0, 10.0], [50.0, 110.0]])


def _beside(distance: float) -> np.ndarray:
    return LINE + np.array([distance, 0.0])


@pytest.mark.parametrize(
    ("curve", "half_width", "expected"),
    [
        (LINE, 3.0, "good"),
        (LINE[::-1], 3.0, "good"),
        (_beside(2.9), 1.0, "good"),
        (_beside(3.1), 1.0, "lost"),
        (_beside(4.9), 20.0, "good"),
        (_beside(5.1), 20.0, "lost"),
        (np.array([[50.0, 10.0], [50.0, 75.0]]), 3.0, "short/long"),
        (np.array([[50.0, -70.0], [50.0, 110.0]]), 3.0, "short/long"),
        (np.array([[50.0, 10.0], [50.0, 40.0]]), 3.0, "lost"),
        (np.array([[50.0, 10.0], [50.0, 75.0], [85.0, 75.0]]), 3.0, "partly"),
    ],
)
def test_verdicts_by_hand(curve, half_width, expected):
    assert real_judge.verdict(*real_judge.shares(curve, LINE, half_width)) == expected


def _row(verdict: real_judge.Verdict, status: str, drawn: str = "lost") -> real_judge.Row:
    return real_judge.Row(
        "m", "1", "c", "k", "tune", "eye", 0, drawn, verdict, 1.0, 1.0, 2.0, status, "", 0.1
    )


def test_shares_by_hand():
    rows = [_row("good", "good", "good")] * 3 + [_row("good", "check"), _row("partly", "check")]
    rows += [_row("lost", "good", "good"), _row("lost", "failed", "good"), _row("lost", "failed")]
    assert real_judge.summary(rows) == real_judge.Summary(8, 50.0, 37.5, 75.0, 25.0, 40.0, 20.0)


def test_a_case_is_read_and_its_sketches_made_right(tmp_path):
    image = np.full((60, 90), 200, np.uint8)
    image[28:33, 10:80] = 20
    bent = [[30.0, 10.0], [30.0, 50.0], [30.0, 79.0]]
    texts = {"sketches": {"eye": [bent[::2]]}, "truth": None, "reference_by_eye": {"eye": [bent]}}
    texts["source"] = {"source": "drawn", "licence": "MIT", "kind": "bars", "half_width": 2.5}
    for name, value in texts.items():
        (tmp_path / f"{name}.json").write_text(json.dumps(value))
    skimage.io.imsave(tmp_path / "image.png", image, check_contrast=False)
    case = read(tmp_path)
    assert (case.kind, case.half_width, case.bright(0)) == ("bars", 2.5, False)
    right = jittered(case)
    assert np.array_equal(right.sketches[RIGHT][0], jittered(case).sketches[RIGHT][0])
    rows = [
        *real.measure("as_drawn", "1", right, RIGHT),
        *real.measure("minimal_path", "1", case, "eye"),
    ]
    assert [row.verdict for row in rows] == ["good", "good"]
    real.write(tmp_path / "rows.csv", rows)
    again = list(real.read(tmp_path / "rows.csv"))
    assert [row.verdict for row in again] == ["good", "good"]
    assert [row.method for row in again] == ["as_drawn", "minimal_path"]


def test_cases_at_hand_are_whole():
    cases = {case.name: case for case in in_folders(FOLDERS)}
    assert {"neurites", "retina", "tripod", "whiskers"} <= set(cases)
    fresh = {case.name: case for case in in_folders(FRESH)}
    assert not set(fresh) & set(cases)
    for case in (*cases.values(), *fresh.values()):
        _check(case)


@pytest.mark.parametrize("folder", [FOLDERS[0], *FRESH], ids=lambda folder: folder.name)
def test_committed_cases_are_free_to_use_named_and_small(folder):
    about = (folder / "README.md").read_text(encoding="utf-8")
    for case in in_folders([folder]):
        assert case.licence.startswith(PERMISSIVE), (case.name, case.licence)
        line = f"| {case.name} | {case.kind} | {len(case.references)} | {case.source} |"
        assert f"{line} {case.licence} |" in about
    files = [file for file in folder.rglob("*") if file.is_file()]
    assert sum(file.stat().st_size for file in files) < 8e6


def test_images_that_nothing_was_chosen_on_have_rows_and_a_section_of_their_own(
    tmp_path, monkeypatch, capsys
):
    shutil.copytree(FOLDERS[0] / "tulips", tmp_path / "cases" / "tulips")
    page, rows = tmp_path / "page.md", tmp_path / "rows.csv"
    page.write_text("before\n<!-- fresh -->\n<!-- /fresh -->\nafter\n", encoding="utf-8")
    monkeypatch.setattr(real_page, "PAGE", page)

    def run(*options: str) -> None:
        places = ["--folder", str(tmp_path / "cases"), "--rows", str(rows)]
        monkeypatch.setattr(sys, "argv", ["real.py", "--images", "fresh", *places, *options])
        real.main()

    run("--page")
    assert "| 3 |" not in page.read_text(encoding="utf-8")
    run("--methods", "as_drawn", "minimal_path")
    run("--methods", "as_drawn", "--jitter")
    assert "tulips" in capsys.readouterr().out
    run("--page")
    lines = page.read_text(encoding="utf-8").splitlines()
    assert "| all | the sketch itself | 3 | 100 % | 0 % | – | – | 0 % |" in lines
    assert "The minimal path is better in 0 of 1 images." in lines
    (line,) = (line for line in lines if line.startswith("| tulips |"))
    assert line.endswith("| – | – | 33 % |")
    assert (lines[0], lines[-1]) == ("before", "after")


def test_generated_cases_are_whole_and_always_the_same():
    one = next(real_foreign.cases(lambda name: name == "foreign_mixed_0"))
    again = real_foreign.scene(one.name, "mixed", real_foreign.LOOKS["mixed"])
    assert np.array_equal(one.image, again.image)
    _check(one)
    assert {one.bright(body) for body in range(len(one.references))} == {True, False}
    rows = real.measure("as_drawn", "1", jittered(one), RIGHT)
    assert {row.verdict for row in rows} == {"good"}


@pytest.mark.parametrize("taper", real_foreign.TAPERS.values(), ids=real_foreign.TAPERS)
def test_tapers_end_at_the_tips(taper):
    half = taper(np.array([0.0, 50.0, 100.0]), 100.0, 3.0)
    assert np.allclose(half[[0, 2]], 0)
    assert 1.5 < half[1] <= 3


def test_points_turn_with_their_image():
    image = np.zeros((30, 40))
    image[4, 9] = 1
    for turn, forth, back in real_modes.TURNS:
        (there,) = np.argwhere(turn(image))
        assert np.array_equal(forth(np.array([[4, 9]]), image.shape), [there])
        assert np.array_equal(back(there[None], image.shape), [[4, 9]])


def test_ends_beyond_and_short_of_the_tips():
    truth = by_arc(LINE, 100)
    curve = np.array([[51.0, 8.0], [49.0, 107.0]])
    assert np.allclose(real_modes._beyond(curve, truth), (2, -3))


def _check(case: Case) -> None:
    assert case.image.ndim == 2
    for line in (*case.references, *(line for lines in case.sketches.values() for line in lines)):
        assert line.shape[1] == 2
        assert length_of(line) > 0
        assert (line > -1).all()
        assert (line < case.image.shape).all()


def test_points_are_uniform_along_a_polyline():
    points = by_arc(np.array([[0.0, 0.0], [0.0, 3.0], [1.0, 3.0]]), 5)
    assert np.allclose(points, [[0, 0], [0, 1], [0, 2], [0, 3], [1, 3]])


def test_about_a_third_is_held_out():
    assert 80 < sum(split_of(f"case {i}") == "held" for i in range(300)) < 120


@pytest.mark.slow
def test_curves_hardly_depend_on_rounding(monkeypatch):
    some = [case for case in in_folders(FOLDERS[:1]) if case.name in ROUNDED]
    monkeypatch.setattr(real_modes, "in_folders", lambda _: some)
    figures = real_modes.rounding(partial(real_modes._refine, preset="balanced"), 1)
    assert figures["curves"] == 92
    assert figures["moved over 0.1 px, %"] < 20


@pytest.mark.slow
def test_lines_mean_the_middles_of_hollow_bodies_and_solid_ones_beside_others(monkeypatch):
    run = partial(real_modes._refine, preset="balanced")
    figures = real_modes.hollow(run, 8)
    for kind in ("straight", "freehand"):
        assert figures[f"{kind}: good, %"] > 50
        assert figures[f"{kind}: good beside another, %"] == 100
    monkeypatch.setattr(hollow, "_between_rims", lambda *_: False)
    figures = real_modes.hollow(run, 1)
    assert figures["straight: good, %"] < 30
    assert figures["freehand: good, %"] > 50, "strokes together mean the dark middles, too"


def test_careful_strokes_keep_their_bodies_where_clearer_ones_are_near(monkeypatch):
    (case,) = (freehand(case) for case in in_folders(FOLDERS) if case.name == "blossom")

    def good() -> int:
        rows = real.measure("balanced", "1", case, FREEHAND)
        return sum(row.verdict == "good" for row in rows)

    assert good() == len(case.references)
    monkeypatch.setattr(finding, "as_clicks", lambda sketch, *_: sketch)
    assert good() < len(case.references)
