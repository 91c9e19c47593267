"""Lines: how scaling widens them, and how other formats want them sampled."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from napari_splinesketch.engine.types import POINTS, Array
from napari_splinesketch.labels.stream import AnyLabels, facts_of
from napari_splinesketch.labels.types import Label


def width_growth(points: Float[Array, "N 2"], scale: tuple[float, float]) -> Float[Array, " N"]:
    """Factor from a half-width in pixels to one in physical units, where pixels may be oblong.

    A strip along the unit tangent t keeps its area when the axes are stretched by s, so its width
    grows by s_y s_x / |(s_y t_row, s_x t_col)|.
    """
    tangent = np.gradient(points, axis=0)
    length = np.linalg.norm(tangent, axis=1)
    stretched = np.linalg.norm(tangent * scale, axis=1)
    square = np.full(len(length), np.sqrt(scale[0] * scale[1]))
    return np.divide(scale[0] * scale[1] * length, stretched, out=square, where=stretched > 0)


def resampled(label: Label, count: int) -> Label:
    """Give a label `count` points, uniform in arc length along its polyline."""
    arc = label.arc_length
    places = np.linspace(0, arc[-1], count)
    points = np.column_stack([np.interp(places, arc, axis) for axis in label.points.T])
    width, sd = (np.interp(places, arc, values) for values in (label.half_width, label.sd))
    return replace(label, points=points, half_width=width, sd=sd)


def edges(label: Label) -> tuple[Float[Array, "N 2"], Float[Array, "N 2"]]:
    """Give both sides of a body, half a width beside its centreline, px."""
    tangent = np.gradient(label.points, axis=0)
    length = np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-12)
    normal = np.column_stack([tangent[:, 1], -tangent[:, 0]]) / length
    side = label.half_width[:, None] * normal
    return label.points + side, label.points - side


def outline(label: Label) -> Float[Array, "M 2"] | None:
    """Give the polygon around a body, px, or None where its half-width is not known."""
    if not np.all(np.isfinite(label.half_width)):
        return None
    left, right = edges(label)
    return np.concatenate([left, right[::-1]])


def area(polygon: Float[Array, "N 2"]) -> float:
    """Area inside a polygon that does not cross itself."""
    a, b = polygon.T
    return abs(float(a @ np.roll(b, -1) - b @ np.roll(a, -1))) / 2


def evenly_sampled(labels: AnyLabels) -> tuple[int, Iterator[Label]]:
    """Give all labels the same number of points, and that number: `POINTS` where they differ."""
    sizes = facts_of(labels).sizes
    if len(sizes) == 1:
        return min(sizes), iter(labels.labels)
    return POINTS, (resampled(label, POINTS) for label in labels.labels)
