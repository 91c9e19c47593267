"""Which curves to train on, and what to ignore in a frame."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, UInt16

from napari_splinesketch.engine.types import POINTS, Array
from napari_splinesketch.labels.types import Label
from napari_splinesketch.raster import label_image, rasterise

Keep = Literal["accepted", "good"]
MARGIN = 3.0
"""Margin around a body that is ignored, px."""
USUAL = 3.0
"""Half-width where none is known in the whole frame, px."""


def is_kept(label: Label, keep: Keep) -> bool:
    """Whether to train on a curve: one that somebody accepted, or any good one."""
    if keep == "accepted":
        return label.review == "accepted"
    return label.status == "good" and label.review != "rejected"


@dataclass(frozen=True, eq=False)
class Chosen:
    """The curves of one frame."""

    kept: tuple[Label, ...]
    """To train on; 100 points each."""
    others: tuple[Label, ...]
    """To ignore: neither bodies nor background."""

    @classmethod
    def of(cls, labels: Sequence[Label], keep: Keep) -> "Chosen":
        """Divide the curves of a frame."""
        kept = (label for label in labels if is_kept(label, keep))
        others = tuple(label for label in labels if not is_kept(label, keep))
        return cls(tuple(label.resampled(POINTS) for label in kept), others)

    def mask(self, shape: tuple[int, int]) -> UInt16[Array, "H W"]:
        """Draw the bodies that are kept: the first has the value 1, the next 2, ..."""
        kept = [(i, one.points, one.half_width) for i, one in enumerate(self.kept, 1)]
        return label_image(kept, shape, np.uint16)

    def ignored(self, mask: UInt16[Array, "H W"]) -> Bool[Array, "H W"]:
        """Draw what is neither body nor background: the other curves and a margin around them."""
        ignored = np.zeros(mask.shape, dtype=bool)
        widths = [np.median(label.half_width) for label in self.kept if _is_wide(label)]
        usual = float(np.median(widths)) if widths else USUAL
        # A curve that is kept but has no width has no mask either.
        for label in (*self.others, *(label for label in self.kept if not _is_wide(label))):
            # A line without a width is a rough one: the body may be beside it.
            reach = label.half_width if _is_wide(label) else np.full(len(label.points), 2 * usual)
            drawn = rasterise(label.points, reach + MARGIN, mask.shape)
            if drawn is not None:
                place, depth = drawn
                ignored[place] |= depth >= 0
        return ignored & (mask == 0)


def _is_wide(label: Label) -> bool:
    return bool(np.isfinite(label.half_width).all())
