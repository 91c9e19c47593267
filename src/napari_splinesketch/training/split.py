"""Which frames are for training, validation and test: in blocks, since neighbours look alike."""

from dataclasses import dataclass
from numbers import Integral
from typing import Literal, get_args

import numpy as np
from jaxtyping import Bool, Int

from napari_splinesketch.engine.types import Array, InputError

Part = Literal["train", "val", "test"]
PARTS: tuple[Part, ...] = get_args(Part)
BLOCKS = 20
"""A film is cut into so many blocks, unless a block would be longer than `LONGEST`."""
LONGEST = 100
GAPS = 10
"""The gap is a block divided by this."""
LEFT_OUT = -1


@dataclass(frozen=True)
class Split:
    """How frames are divided among training, validation and test."""

    shares: tuple[float, float, float] = (0.8, 0.1, 0.1)
    """Of the blocks, for each part; a part whose share is above 0 gets at least one block."""
    block: int | None = None
    """Frames in a block; None takes a twentieth of the film, but at most 100."""
    gap: int | None = None
    """Least number of frames between parts. They are left out, of training first. None takes a
    tenth of a block."""
    seed: int = 0
    """Which blocks go where."""

    def __post_init__(self) -> None:
        known = np.shape(self.shares) == (3,) and min(self.shares) >= 0
        if not known or not 0 < sum(self.shares) < np.inf:
            raise InputError(
                f"shares are {self.shares}; give three numbers from 0, not all 0: train, val, test"
            )
        for name, least in (("block", 1), ("gap", 0), ("seed", 0)):
            given = getattr(self, name)
            left_out = given is None and name != "seed"
            if not left_out and not (isinstance(given, Integral) and int(given) >= least):
                raise InputError(f"{name} is {given!r}; give a whole number from {least}")

    def sizes(self, frames: Int[Array, " F"]) -> tuple[int, int]:
        """Give the frames of a block and of a gap, for these frames."""
        span = int(frames[-1] - frames[0]) + 1 if len(frames) else 1
        block = self.block or min(max(span // BLOCKS, 1), LONGEST)
        return block, block // GAPS if self.gap is None else self.gap

    def parts(self, frames: Int[Array, " F"]) -> Int[Array, " F"]:
        """Give each frame, in rising order, the index of its part in `PARTS`, or `LEFT_OUT`."""
        if not len(frames):
            return np.zeros(0, dtype=int)
        block, gap = self.sizes(frames)
        blocks, place = np.unique((frames - frames[0]) // block, return_inverse=True)
        parts = np.repeat(np.arange(3), _counts(len(blocks), self.shares))
        parts = np.random.default_rng(self.seed).permutation(parts)[place]
        for part in (0, 1):
            later = frames[parts > part]
            parts[(parts == part) & _near(frames, later, gap)] = LEFT_OUT
        return parts


def _counts(blocks: int, shares: tuple[float, ...]) -> Int[Array, "3"]:
    """Share blocks out, the largest remainders first; every part with a share gets one."""
    wanted = blocks * np.array(shares) / sum(shares)
    asked = wanted > 0
    counts = np.floor(wanted).astype(int)
    if blocks >= asked.sum():
        counts = np.maximum(counts, asked)
    while counts.sum() < blocks:
        counts[np.argmax(wanted - counts)] += 1
    while counts.sum() > blocks:
        counts[np.argmax(np.where(counts > 1, counts - wanted, -np.inf))] -= 1
    return counts


def _near(frames: Int[Array, " F"], others: Int[Array, " G"], gap: int) -> Bool[Array, " F"]:
    """Tell which frames have one of the others within the gap."""
    first = np.searchsorted(others, frames - gap, side="left")
    return np.searchsorted(others, frames + gap, side="right") > first
