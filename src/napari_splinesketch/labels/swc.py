"""SWC, as neuron tracers use it: one tree per body, (x, y), radius = half-width."""

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from napari_splinesketch.geometry import width_growth
from napari_splinesketch.labels.format import Format
from napari_splinesketch.labels.json_tree import head_of
from napari_splinesketch.labels.types import AnyLabels, Label

OURS = "# splinesketch "
LOSSES = (
    "no place for standard errors, and is not read back: keep a labels CSV too",
    "review",
    "frames",
    "radius",
)
ROOT = -1
UNDEFINED = 0
"""SWC's structure type for something that is not part of a neuron."""


def write(path: Path, labels: AnyLabels) -> None:
    """Write one unbranched tree for each body; z is 0.

    x, y and radius are in the image's units, or in pixels where it has none. Comments that other
    programs skip hold frame, identity and status of each tree.
    """
    with path.open("x", encoding="utf-8", errors="replace", newline="\n") as file:
        head = json.dumps(head_of(labels.head), ensure_ascii=False)
        file.write(f"{OURS}{head}\n# id type x y z radius parent\n")
        first = 1
        for label in labels.labels:
            file.writelines(_tree(label, labels.head.scale or (1.0, 1.0), first))
            first += len(label.points)


def _tree(label: Label, size: tuple[float, float], first: int) -> Iterator[str]:
    about = {"frame": label.frame, "curve": label.curve, "status": label.status}
    yield f"{OURS}{json.dumps(about)}\n"
    radius = np.nan_to_num(label.half_width * width_growth(label.points, size))
    rows = zip((label.points * size).tolist(), radius.tolist(), strict=True)
    for i, ((y, x), half_width) in enumerate(rows):
        parent = first + i - 1 if i else ROOT
        yield f"{first + i} {UNDEFINED} {x!r} {y!r} 0 {half_width!r} {parent}\n"


FORMAT = Format("SWC", {".swc": b""}, write=write, losses=LOSSES)
