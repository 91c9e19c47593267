"""Between labels and layers: what Export and napari's own menus write and read."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pint
from jaxtyping import Float
from napari.layers import Shapes

from napari_splinesketch.engine import spline
from napari_splinesketch.engine.types import POINTS, Curve, Status
from napari_splinesketch.labels import Label, Labels, LabelsError, table
from napari_splinesketch.labels.formats import claiming
from napari_splinesketch.plugin.layers.drawn import COLOUR, LINES
from napari_splinesketch.plugin.layers.looks import COLOURS, thinned
from napari_splinesketch.plugin.layers.slot import OWNER, Known
from napari_splinesketch.plugin.layers.space import pixel_size, size_of
from napari_splinesketch.plugin.model import Record

KNOTS = 10
"""Of a curve that was read from a file: as many as the engine gives most bodies."""
READ = "the file does not say why"
LABELS = "napari-splinesketch labels"
"""Key of a layer's metadata under which the labels that it was read from are kept."""


def labels_of(work: Known, *, rejected: bool = True) -> Labels:
    """Label the curves of an image, with or without those that the user has rejected."""
    labels = [
        Label.from_curve(r.curve, frame=r.frame, identity=r.id, review=r.review, locked=r.locked)
        for r in work.records
        if rejected or r.review != "rejected"
    ]
    image = work.image
    size = pixel_size(image.scale.tolist(), image.units)
    return Labels(tuple(labels), *size, size_of(image))


def labels_of_layer(shapes: Sequence[Float[np.ndarray, "N D"]], meta: Mapping[str, Any]) -> Labels:
    """Label the lines of a Shapes layer.

    Parameters
    ----------
    shapes
        Vertices in data coordinates, axes before (row, col) first.
    meta
        The layer's attributes. A line that is a known curve keeps all that is known of it; any
        other one is a sketch.
    """
    origin = _origin(meta.get("metadata", {}))
    known = {(label.frame, label.curve): label for label in origin.labels}
    drawn = dict(zip(known, thinned([label.points for label in known.values()]), strict=True))
    features = meta.get("features", {})
    numbers = features["id"] if "id" in features else range(1, len(shapes) + 1)
    labels = []
    kinds = meta["shape_type"]
    for line, kind, number in zip(shapes, kinds, map(int, numbers), strict=True):
        if kind not in LINES:
            continue
        frame = int(np.round(line[0, 0])) if line.shape[1] > 2 else 0
        points = np.asarray(line[:, -2:])
        key = frame, number
        if key in known and _same(points, known[key].points, drawn[key]):
            label = known[key]
        else:
            label = Label.from_sketch(points, frame=frame, identity=number)
        labels.append(label)
    registry = pint.get_application_registry()
    units = [registry.Unit(str(unit)) for unit in meta["units"]]
    size = pixel_size(meta["scale"], units)
    return Labels(tuple(labels), *size, origin.shape, origin.provenance)


def _same(points: Float[np.ndarray, "N 2"], *lines: Float[np.ndarray, "_ 2"]) -> bool:
    """Whether points are those of one of some lines, in the single precision of Shapes layers."""
    return any(np.array_equal(line.astype(points.dtype), points) for line in lines)


def _origin(metadata: Mapping[str, Any]) -> Labels:
    if LABELS in metadata:
        return metadata[LABELS]
    return labels_of(metadata[OWNER]) if OWNER in metadata else Labels()


def layer_of_labels(labels: Labels, name: str) -> tuple[list[Any], dict[str, Any], str]:
    """Make the data of a Shapes layer that shows labels: paths at (frame, row, col)."""
    film = any(label.frame for label in labels.labels)
    shapes = [_in_film(label) if film else label.points for label in labels.labels]
    leading = 1 if film else 0
    colours = COLOURS | {"sketch": COLOUR}
    meta: dict[str, Any] = {
        "name": name,
        "ndim": 2 + leading,
        "shape_type": "path",
        "edge_color": [colours[label.status] for label in labels.labels] or COLOUR,
        "edge_width": 1,
        "face_color": "transparent",
        "features": {
            "id": [label.curve for label in labels.labels],
            "frame": [label.frame for label in labels.labels],
            "length": [float(label.arc_length[-1]) for label in labels.labels],
            "half_width_mean": [float(np.mean(label.half_width)) for label in labels.labels],
            "status": [str(label.status) for label in labels.labels],
        },
        "metadata": {LABELS: labels},
    }
    return shapes, meta | _placed(labels, 2 + leading), "shapes"


def read_with(layer: Shapes) -> Labels:
    """Give the labels that a layer was read from; none where it was not.

    Of a table that napari itself has opened, which takes the lines alone, the rest is read now.
    """
    source = layer.source
    if LABELS not in layer.metadata and source.reader_plugin == "napari" and source.path:
        try:
            ours = claiming(source.path) is table.FORMAT
            labels = table.FORMAT.read_whole(source.path) if ours else Labels()
        except (LabelsError, OSError):
            labels = Labels()
        layer.metadata[LABELS] = labels
        for name, value in _placed(labels, layer.ndim).items():
            setattr(layer, name, value)
    return layer.metadata.get(LABELS, Labels())


def _placed(labels: Labels, ndim: int) -> dict[str, Any]:
    """Give scale and units of a layer that shows labels, as far as they are known."""
    first, meta = ndim - 2, {}
    if labels.scale:
        meta["scale"] = (*[1.0] * first, *labels.scale)
    if labels.units:
        meta["units"] = (*["pixel"] * first, labels.units, labels.units)
    return meta


def _in_film(label: Label) -> Float[np.ndarray, "N 3"]:
    return np.column_stack([np.full(len(label.points), float(label.frame)), label.points])


def records_of(labels: Labels, frames: int) -> tuple[tuple[Record, ...], int]:
    """Take labels that were read for curves, to go on with them.

    Parameters
    ----------
    labels
        Curves and sketches; the latter are left out.
    frames
        How many the image has.

    Returns
    -------
    tuple
        The curves, numbered from 1, and how many are beyond the last frame.
    """
    curves = [label for label in labels.labels if label.status != "sketch"]
    here = [label for label in curves if label.frame < frames]
    first = int(any(label.curve == 0 for label in here))
    made = [
        Record(r.curve + first, r.frame, r.points, _curve_of(r), r.review, r.locked) for r in here
    ]
    return tuple(made), len(curves) - len(here)


def _curve_of(label: Label) -> Curve:
    even = label.resampled(POINTS)
    at = np.linspace(0, POINTS - 1, KNOTS)
    width = np.interp(at, np.arange(POINTS), even.half_width)
    knots = np.column_stack([spline.fit_knots(even.points, KNOTS), width])
    status: Status = "failed" if label.status == "sketch" else label.status
    reasons = () if status == "good" else (READ,)
    # How well it explained the image is in no file.
    return Curve(knots, even.points, even.half_width, even.sd, status, reasons, np.inf)
