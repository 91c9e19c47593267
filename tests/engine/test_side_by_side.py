"""Batches of curves that do not touch, on as many cores as there are."""

import threading
import time

import numpy as np
import perturbations
import pytest

from napari_splinesketch import refine, synthetic
from napari_splinesketch.engine import constants, spline
from napari_splinesketch.engine.fit import fit_scene, fitting
from napari_splinesketch.engine.settings import Hold, Settings
from napari_splinesketch.engine.types import CANCELLED


@pytest.fixture(params=[1, 2])
def cores(request, monkeypatch) -> int:
    monkeypatch.setattr(fit_scene, "cores", lambda: request.param)
    return request.param


def crowd() -> tuple[np.ndarray, list[np.ndarray]]:
    made = synthetic.scene(3, bodies=24, shape=(320, 330), length=45, crossing=False)
    return made.image, [perturbations.displace(c, 2, 40) for c in made.centrelines]


def test_heaps_of_curves_that_touch_stay_whole(monkeypatch):
    monkeypatch.setattr(constants, "CURVE_SIZES", (3,))
    meets = np.zeros((9, 9), dtype=bool)
    for i, j in ((0, 4), (4, 8), (8, 2), (1, 3), (5, 6)):
        meets[i, j] = meets[j, i] = True
    found = fit_scene.in_batches(meets, [8, 8, 12, 8, 8, 8, 8, 8, 8])
    assert [sorted(batch) for batch in found] == [[0, 2, 4, 8], [5, 6, 7], [1, 3]]


def test_crossing_bodies_of_unlike_shapes_see_each_other(monkeypatch):
    """A straight one needs fewer knots than one that bends, and is fitted with it all the same."""
    fitted: list[int] = []
    fit_curves = fitting.fit_curves

    def watched(seen, theta, *given, **options):
        fitted.append(len(theta))
        return fit_curves(seen, theta, *given, **options)

    monkeypatch.setattr(fitting, "fit_curves", watched)
    t = np.linspace(0, 1, 60)
    waves = np.column_stack([64 + 14 * np.sin(4 * np.pi * t), 14 + 100 * t])
    lines = [waves, np.array([[14.0, 60.0], [114.0, 66.0]])]
    image = np.max([synthetic_tube(line, (128, 128)) for line in lines], axis=0)
    found = refine(image, lines, Settings(hold=(Hold(1.0, 1.0, 1.0),) * 2))
    assert found.model.knots[0] > found.model.knots[1]
    assert fitted[0] == 2


def synthetic_tube(line: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """A bright tube of half-width 2 px."""
    at = np.indices(shape).reshape(2, -1).T
    apart = spline.apart(at, spline.resample(line, 500)).reshape(shape)
    return np.clip(2.5 - apart, 0, 1) + 0.01 * (np.indices(shape).sum(0) % 3)


def test_two_cores_give_the_same_curves_to_the_last_bit(monkeypatch):
    image, sketches = crowd()
    found, threads = [], []
    fit_curves = fitting.fit_curves

    def watched(*given, **options):
        threads[-1].add(threading.get_ident())
        return fit_curves(*given, **options)

    monkeypatch.setattr(fitting, "fit_curves", watched)
    for count in (1, 2):
        monkeypatch.setattr(fit_scene, "cores", lambda count=count: count)
        threads.append(set())
        found.append(refine(image, sketches))
    assert [len(used) for used in threads] == [1, 2]
    for one, two in zip(*(result.curves for result in found), strict=True):
        for name in ("knots", "points", "half_width", "sd"):
            np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
        assert (one.status, one.reasons) == (two.status, two.reasons)


def test_a_cancel_stops_all_threads(cores):
    image, sketches = crowd()
    stages: list[str] = []

    def on_progress(now):
        stages.append(now.stage)
        return stages.count("polishing") < 3

    before = threading.active_count()
    found = refine(image, sketches, on_progress=on_progress)
    assert all(curve.reasons == (CANCELLED,) for curve in found.curves)
    assert stages.count("polishing") == 3  # never asked again
    assert threading.active_count() == before


def test_what_the_call_raises_first_is_raised(cores):
    image, sketches = crowd()
    asked = []

    def on_progress(now):
        asked.append(now.stage)
        if asked.count("polishing") == 3:
            raise ZeroDivisionError

    before = threading.active_count()
    with pytest.raises(ZeroDivisionError):
        refine(image, sketches, on_progress=on_progress)
    assert asked.count("polishing") == 3  # never asked again
    assert threading.active_count() == before


def test_what_a_run_raises_leaves_out_those_that_had_not_begun(cores):
    begun = []

    def run(number):
        begun.append(number)
        time.sleep(0.01)
        return 1 / (number - 1)

    with pytest.raises(ZeroDivisionError):
        fit_scene.side_by_side(run, 1000)
    assert len(begun) < 1000


def test_results_come_in_order(cores):
    assert fit_scene.side_by_side(lambda i: i * i, 9) == [i * i for i in range(9)]


def test_cores_are_those_that_may_be_used(monkeypatch):
    monkeypatch.setattr(fit_scene.os, "sched_getaffinity", lambda _: {0, 2, 5}, raising=False)
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    assert fit_scene.cores() == 3
    for wanted, found in (("2", 2), ("8", 3), ("0", 3), ("", 3)):
        monkeypatch.setenv("OMP_NUM_THREADS", wanted)
        assert fit_scene.cores() == found
