"""What is predicted of a body: ahead and in between."""

import numpy as np

from napari_splinesketch.tracking import motion
from napari_splinesketch.tracking.motion import Known

S = np.linspace(0, 60, 100)


def winding(frame: float) -> np.ndarray:
    """A body that crawls along its own path by 2 px a frame."""
    s = S + 2 * frame
    return np.column_stack([50 + 6 * np.sin(s / 10), 20 + s])


def swimming(frame: float) -> np.ndarray:
    """A body along which a wave runs, while it goes on aslant."""
    angle = 0.6 * np.sin(S / 8 + 0.4 * frame)
    line = np.cumsum(np.stack([np.sin(angle), np.cos(angle)], 1), axis=0) * S[1]
    return line - line.mean(0) + (40 + frame, 80 + frame)


def drifting(frame: float) -> np.ndarray:
    return np.column_stack([30 + 1.5 * frame + 0 * S, 20 + S])


def known(path, frames) -> list[Known]:
    return [(float(t), path(t)) for t in frames]


def test_ways_of_moving_are_learned_from_the_film() -> None:
    line, sd = motion.ahead(known(winding, range(6)))(6)
    apart = np.linalg.norm(line - winding(6), axis=1)
    assert apart[:90].max() < 0.3, "along its path"
    assert sd < 0.5
    line, _ = motion.ahead(known(drifting, range(6)))(9)
    np.testing.assert_allclose(line, drifting(9), atol=0.05)
    back, _ = motion.ahead(known(drifting, range(9, 3, -1)))(2)
    np.testing.assert_allclose(back, drifting(2), atol=0.05)


def test_the_wave_of_a_swimmer_goes_on() -> None:
    for frame, most in ((6, 0.3), (8, 1.0)):
        line, sd = motion.ahead(known(swimming, range(6)))(frame)
        assert np.linalg.norm(line - swimming(frame), axis=1).max() < most
        assert sd < most + 0.3


def test_a_single_frame_does_not_tell_that_a_body_swims() -> None:
    """The directions of a few uncertain points at an end look like waves, too."""
    lines = [motion.ahead(known(swimming, range(n)))(n).line for n in (3, 4)]
    few, more = (
        np.linalg.norm(line - swimming(n), axis=1).max()
        for n, line in zip((3, 4), lines, strict=True)
    )
    assert more < 0.3 < 1 < few


def test_nothing_is_sure_before_it_was_measured() -> None:
    assert motion.ahead(known(drifting, [0]))(1)[1] == np.inf
    assert motion.ahead(known(drifting, [0, 1]))(2)[1] == np.inf
    near, far = (motion.ahead(known(drifting, range(5)))(t)[1] for t in (5, 9))
    assert near < far < np.inf


def test_a_gap_is_bridged_from_both_sides() -> None:
    before, after = known(winding, range(5)), known(winding, [12, 11])
    for frame in range(5, 11):
        line, sd = motion.between(before, after, frame)
        assert np.linalg.norm(line - winding(frame), axis=1).max() < 3
        assert sd < 4
