"""Bodies as lines with a width: their sides, and how scaling widens them."""

import numpy as np
from jaxtyping import Float

from napari_splinesketch.engine.types import Array


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


def edges(
    points: Float[Array, "N 2"], half_width: Float[Array, " N"]
) -> tuple[Float[Array, "N 2"], Float[Array, "N 2"]]:
    """Give both sides of a body, half a width beside its centreline, px."""
    tangent = np.gradient(points, axis=0)
    length = np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-12)
    side = half_width[:, None] * np.column_stack([tangent[:, 1], -tangent[:, 0]]) / length
    return points + side, points - side


def area(polygon: Float[Array, "N 2"]) -> float:
    """Area inside a polygon that does not cross itself."""
    a, b = polygon.T
    return abs(float(a @ np.roll(b, -1) - b @ np.roll(a, -1))) / 2
