"""What is foretold of a body: ahead, in between, and against the noise."""

from dataclasses import replace

import numpy as np

from napari_splinesketch.tracking import motion, steady
from napari_splinesketch.tracking.motion import Known

from .test_follow import curve

S = np.linspace(0, 60, 100)


def winding(frame: float) -> np.ndarray:
    """A body that crawls along its own path by 2 px a frame."""
    s = S + 2 * frame
    return np.column_stack([50 + 6 * np.sin(s / 10), 20 + s])


def drifting(frame: float) -> np.ndarray:
    return np.column_stack([30 + 1.5 * frame + 0 * S, 20 + S])


def known(path, frames) -> list[Known]:
    return [(float(t), path(t)) for t in frames]


def test_ways_of_moving_are_learned_from_the_film() -> None:
    line, sd = motion.ahead(known(winding, range(6)), 6)
    apart = np.linalg.norm(line - winding(6), axis=1)
    assert apart[:90].max() < 0.3, "along its path"
    assert sd < 0.5
    line, _ = motion.ahead(known(drifting, range(6)), 9)
    np.testing.assert_allclose(line, drifting(9), atol=0.05)
    back, _ = motion.ahead(known(drifting, range(9, 3, -1)), 2)
    np.testing.assert_allclose(back, drifting(2), atol=0.05)


def test_nothing_is_sure_before_it_was_measured() -> None:
    assert motion.ahead(known(drifting, [0]), 1)[1] == np.inf
    assert motion.ahead(known(drifting, [0, 1]), 2)[1] == np.inf
    near, far = (motion.ahead(known(drifting, range(5)), t)[1] for t in (5, 9))
    assert near < far < np.inf


def test_a_gap_is_bridged_from_both_sides() -> None:
    before, after = known(winding, range(5)), known(winding, [12, 11])
    for frame in range(5, 11):
        line, sd = motion.between(before, after, frame)
        assert np.linalg.norm(line - winding(frame), axis=1).max() < 3
        assert sd < 4


def test_neighbours_average_out_noise_but_no_movement() -> None:
    rng = np.random.default_rng(1)
    bump = np.array([np.exp(-((S - c) ** 2) / 50) for c in range(0, 61, 6)])

    def noisy(path, frame: float) -> np.ndarray:
        return path(frame) + np.column_stack([0.15 * rng.standard_normal(11) @ bump, 0 * S])

    def hopping(frame: float) -> np.ndarray:
        return drifting(frame) + np.array([6 * np.sin(2.5 * frame), 0])

    for path, better in ((drifting, 0.75), (hopping, 1.1)):
        errors = []
        for _ in range(20):
            lines = {t: noisy(path, t) for t in range(13)}
            before = [(float(t), lines[t]) for t in range(2, 9)]
            after = [(float(t), lines[t]) for t in (12, 11, 10)]
            here = replace(curve(lines[9]), points=lines[9], sd=np.full(100, 0.2))
            found = steady.steadied(here, 9, before, after)
            errors.append([np.abs(p - path(9))[:, 0].mean() for p in (found.points, lines[9])])
            assert (found.sd <= here.sd).all()
        mine, raw = np.mean(errors, axis=0)
        assert mine < better * raw


def test_neighbours_that_agree_do_not_make_a_curve_exact() -> None:
    here = replace(curve(drifting(9)), points=drifting(9), sd=np.full(100, 0.2))
    found = steady.steadied(here, 9, known(drifting, range(2, 9)), known(drifting, (12, 11, 10)))
    assert (found.sd > 0.45 * here.sd).all()
    assert (found.sd < 0.6 * here.sd).all()
