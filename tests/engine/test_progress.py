"""Progress never falls, and a refinement can be cancelled between any two small steps."""

import numpy as np
import pytest

from napari_splinesketch import Progress, refine, synthetic
from napari_splinesketch.engine import constants
from napari_splinesketch.engine.fit import solver
from napari_splinesketch.engine.refine import _Progress
from napari_splinesketch.engine.types import CANCELLED

from .scenes import SHAPE, frame, sketches_of


def watched(stop_at: int | None = None, bodies: int = 2):
    """The result, and every progress record; cancelled at one of them."""
    made, records = frame(2, bodies), []

    def on_progress(progress: Progress) -> bool:
        records.append(progress)
        return stop_at is None or len(records) <= stop_at

    return refine(made.image, sketches_of(made), on_progress=on_progress), records


def test_fractions_never_fall_and_stages_are_named():
    _, records = watched()
    fractions = [r.fraction for r in records]
    assert fractions == sorted(fractions)
    assert all(0 <= f <= 1 for f in fractions)
    assert len(set(fractions)) > 5
    assert max(np.diff(fractions)) < 0.6
    stages = list(dict.fromkeys(r.stage for r in records))
    assert stages[0] == "looking at the image"
    assert stages[-1] == "polishing"
    assert all(stages)


def test_looking_at_one_sketch_can_be_cancelled_between_its_half_widths():
    """A long line of a large image is looked at for seconds."""
    _, records = watched(bodies=1)
    stages = [r.stage for r in records]
    assert stages.index("tracing bodies") > 8
    result, records = watched(stop_at=5, bodies=1)
    assert len(records) == 6
    assert result.curves[0].reasons == (CANCELLED,)


def test_numpys_false_cancels_too():
    made = frame(2, 2)
    found = refine(made.image, sketches_of(made), on_progress=lambda _: np.bool_(False))  # pyright: ignore[reportArgumentType]
    assert all(curve.reasons == (CANCELLED,) for curve in found.curves)


def test_a_fraction_below_the_last_or_above_one_is_not_passed_on():
    seen = []
    report = _Progress(lambda progress: seen.append(progress.fraction), [], 1)
    for fraction in (0.2, 0.6, 0.4, 1.7):
        report("polishing", fraction)
    assert seen == [0.2, 0.6, 0.6, 1.0]


def test_centrelines_are_those_of_all_sketches_and_arrive():
    result, records = watched(bodies=3)
    shown = [r.centrelines for r in records if r.centrelines is not None]
    assert len(shown) > 2
    for lines in shown:
        assert len(lines) == 3
        assert all(line.ndim == 2 and line.shape[1] == 2 for line in lines)
        assert all(np.isfinite(line).all() for line in lines)
    for line, curve in zip(shown[-1], result.curves, strict=True):
        apart = np.linalg.norm(line[:, None] - curve.points[None], axis=2).min(1)
        assert apart.mean() < 1


def test_centrelines_are_in_the_pixels_of_the_image():
    made = frame(0)
    image = np.pad(made.image, ((150, 0), (200, 0)), mode="median")
    moved = np.array([150, 200])
    shown = []
    refine(
        image,
        [s + moved for s in sketches_of(made)],
        on_progress=lambda p: shown.append(p.centrelines),
    )
    line = next(lines for lines in reversed(shown) if lines is not None)[0]
    truth = made.centrelines[0] + moved
    assert np.linalg.norm(line[:, None] - truth[None], axis=2).min(1).max() < 5


def test_cancelling_anywhere_leaves_every_sketch_as_drawn():
    _, records = watched()
    sketches = sketches_of(frame(2, 2))
    for stop_at in {0, 1, 2, 4, len(records) // 2, len(records) - 1}:
        result, seen = watched(stop_at)
        assert len(seen) == stop_at + 1  # never asked again
        assert [c.status for c in result.curves] == ["failed"] * 2
        assert all(c.reasons == (CANCELLED,) for c in result.curves)
        for curve, sketch in zip(result.curves, sketches, strict=True):
            np.testing.assert_allclose(curve.knots[:, :2], sketch)
        assert result.reconstruction.shape == SHAPE


@pytest.mark.parametrize("answer", [None, True, 1, 0, ""])
def test_only_false_cancels(answer):
    made = frame(0)
    result = refine(made.image, sketches_of(made), on_progress=lambda _: answer)  # pyright: ignore
    assert result.curves[0].status != "failed"


def test_the_callers_own_exceptions_pass_through():
    def broken(_):
        raise RuntimeError("mine")

    with pytest.raises(RuntimeError, match="mine"):
        refine(frame(0).image, sketches_of(frame(0)), on_progress=broken)


def test_watching_changes_nothing():
    made = frame(2, 2)
    plain, (seen, _) = refine(made.image, sketches_of(made)), watched()
    for a, b in zip(plain.curves, seen.curves, strict=True):
        np.testing.assert_array_equal(a.knots, b.knots)


def test_little_is_computed_between_two_chances_to_cancel(monkeypatch):
    """At most one call of the solver, for at most CHUNK curves, from one record to the next."""
    since, most = [], []
    sweep = solver.sweep

    def counted(bands, level, fit, basis, order, count, steps):
        since.append(int(count) * int(steps))
        return sweep(bands, level, fit, basis, order, count, steps)

    def on_progress(_):
        most.append((len(since), sum(since)))
        since.clear()

    monkeypatch.setattr(solver, "sweep", counted)
    made = synthetic.scene(3, bodies=6, shape=(150, 170), length=45, crossing=False)
    refine(made.image, sketches_of(made), on_progress=on_progress)
    calls, visits = (max(m[i] for m in most) for i in (0, 1))
    assert calls == 1
    assert visits <= constants.CHUNK * 10
