"""SWC, as neuron tracers use it: one tree a body, (x, y), radius = half-width."""

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from napari_splinesketch.labels.format import Format, without_place
from napari_splinesketch.labels.geometry import width_growth
from napari_splinesketch.labels.head import head_of
from napari_splinesketch.labels.json_tree import pieces
from napari_splinesketch.labels.stream import AnyLabels, facts_of, in_frames
from napari_splinesketch.labels.types import Label

OURS = "# splinesketch "
NOT_READ = "SWC has no place for standard errors, and is not read back: keep a labels CSV too"
ROOT = -1
UNDEFINED = 0
"""SWC's structure type for what is no part of a neuron."""


def write(path: Path, labels: AnyLabels) -> None:
    """Write one unbranched tree for each body; z is 0.

    x, y and radius are in the image's units, or in pixels where it has none. Comments that other
    programs skip hold frame, identity and status of each tree.
    """
    with path.open("x", encoding="utf-8", errors="replace", newline="\n") as file:
        file.write(OURS)
        file.writelines(pieces(head_of(labels)))
        file.write("\n# id type x y z radius parent\n")
        first = 1
        for label in labels.labels:
            file.writelines(_tree(label, labels.scale, first))
            first += len(label.points)


def losses(labels: AnyLabels) -> tuple[str, ...]:
    """Say what SWC has no place for."""
    lost = [NOT_READ, *without_place("SWC", labels, "review")]
    if len(in_frames(labels).frames) > 1:
        lost.append("SWC has no frames: other programs see the curves of all frames at once")
    if facts_of(labels).without_radius:
        lost.append("SWC has no unknown radius: where the half-width is not known, it is 0")
    return tuple(lost)


def _tree(label: Label, scale: tuple[float, float] | None, first: int) -> Iterator[str]:
    about = {"frame": label.frame, "curve": label.curve, "status": label.status}
    yield f"{OURS}{json.dumps(about)}\n"
    size = scale or (1.0, 1.0)
    radius = np.nan_to_num(label.half_width * width_growth(label.points, size))
    rows = zip((label.points * size).tolist(), radius.tolist(), strict=True)
    for i, ((y, x), half_width) in enumerate(rows):
        parent = first + i - 1 if i else ROOT
        yield f"{first + i} {UNDEFINED} {x!r} {y!r} 0 {half_width!r} {parent}\n"


FORMAT = Format("SWC", (".swc",), write=write, losses=losses)
