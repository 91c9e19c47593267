"""A body over length and time: noise is averaged out as far as its movement allows."""

from dataclasses import replace

import numpy as np
import pytest

from napari_splinesketch.engine import spline
from napari_splinesketch.engine.types import Curve
from napari_splinesketch.tracking.over_time import mean_curvature
from napari_splinesketch.tracking.surface import KNOWN, REACH, steadied

from .test_follow import curve
from .test_motion import S, drifting, winding

FRAMES, NOW = range(KNOWN + REACH + 1), KNOWN


def hopping(frame: float) -> np.ndarray:
    return drifting(frame) + np.array([6 * np.sin(2.5 * frame), 0])


def fitted(line: np.ndarray, sd: float = 0.2) -> Curve:
    return replace(curve(line), points=line, sd=np.full(100, sd))


@pytest.mark.parametrize(
    ("path", "better"),
    [(drifting, 0.7), (winding, 0.7), (hopping, 1.1)],
    ids=["drifting", "winding", "hopping"],
)
def test_neighbours_average_out_noise_but_no_movement(path, better) -> None:
    rng = np.random.default_rng(1)
    bump = np.array([np.exp(-((S - c) ** 2) / 50) for c in range(0, 61, 6)])
    errors = []
    for _ in range(20):
        lines = {}
        for t in FRAMES:
            noise = 0.15 * rng.standard_normal(11) @ bump
            lines[t] = path(t) + np.column_stack([noise, 0 * S])
        around = [(t, fitted(lines[t])) for t in FRAMES if t != NOW]
        found = steadied(fitted(lines[NOW]), NOW, around)
        inner = slice(10, 90)
        errors.append([np.abs(p - path(NOW))[inner, 0].mean() for p in (found.points, lines[NOW])])
        assert (found.sd <= 0.2).all()
    mine, raw = np.mean(errors, axis=0)
    assert mine < better * raw


def test_a_smooth_body_stays_smooth_and_on_its_knots() -> None:
    rng = np.random.default_rng(3)

    def noisy(frame: int) -> Curve:
        knots = winding(frame)[::11] + [[1.0, 0]] * rng.normal(0, 0.2, (10, 1))
        made = np.column_stack([knots, np.full(10, 2.0)])
        return replace(fitted(spline.sample(knots, 100)), knots=made)

    for _ in range(10):
        seen = {t: noisy(t) for t in FRAMES}
        found = steadied(seen.pop(NOW), NOW, [*seen.items()])
        drawn = spline.sample(found.knots[:, :2], 2000)
        assert spline.apart(found.points, drawn).max() < 0.03
        assert mean_curvature(found.points) < 1.1 * mean_curvature(winding(NOW))


def test_neighbours_that_agree_do_not_make_a_curve_exact() -> None:
    around = [(t, fitted(drifting(t))) for t in FRAMES if t != NOW]
    found = steadied(fitted(drifting(NOW)), NOW, around)
    assert (found.sd > 0.4 * 0.2).all() and (found.sd < 0.6 * 0.2).all()


def test_a_neighbour_that_is_unsure_counts_for_less() -> None:
    wrong = drifting(NOW + 1) + np.array([3.0, 0])
    moved = []
    for sd in (0.2, 20.0):
        around = [(t, fitted(drifting(t))) for t in FRAMES if abs(t - NOW) > 1]
        found = steadied(fitted(drifting(NOW)), NOW, [*around, (NOW + 1, fitted(wrong, sd))])
        moved.append(np.abs(found.points - drifting(NOW)).max())
    assert moved[1] < 0.1 * moved[0]


def test_few_frames_change_nothing() -> None:
    here = fitted(drifting(NOW))
    assert steadied(here, NOW, [(NOW - 1, fitted(drifting(NOW - 1)))]) is here
