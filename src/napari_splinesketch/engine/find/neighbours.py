"""Bodies without a sketch beside those that have one: they are taken out of the image."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy import ndimage
from scipy.spatial import KDTree

from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine import spline
from napari_splinesketch.engine.find import strip
from napari_splinesketch.engine.find.finding import Start
from napari_splinesketch.engine.find.tracing import without_specks
from napari_splinesketch.engine.look.scene import Scene
from napari_splinesketch.engine.types import Array, Line


def without_neighbours(seen: Scene, starts: list[Start], fixed: list[Line]) -> Scene:
    """The scene without the bodies that no sketch means, beside those that one does.

    What rises again beyond a valley at the side of a body is another one, if it is not nearer to
    another path, to a curve that is `fixed` or to another stretch of the same path. Left where it
    is, it would be fitted as part of the body.
    """
    lines = [start.line for start in starts] + fixed
    paths = [spline.resample(line, 2 + int(spline.arc_length(line)[-1])) for line in lines]
    tree, lowered = KDTree(np.concatenate(paths)), seen.normal.copy()
    for start in starts:
        if start.found:
            points, away, level = _beside(seen, start)
            mine = tree.query(points)[0] > away - const.VALLEY_NEAREST_PX
            at = tuple(np.rint(points[mine]).astype(int).T)
            lowered[at] = np.minimum(lowered[at], level[mine])
    others = without_specks(lowered < seen.normal, seen.half_width)
    return replace(seen, normal=np.where(others, lowered, seen.normal))


def _beside(
    seen: Scene, start: Start
) -> tuple[Float[Array, "P 2"], Float[Array, " P"], Float[Array, " P"]]:
    """Points beyond the valleys beside a body that rise from them and above the background.

    Also how far they are from the body's path, px, and the image there without what rises.
    """
    half_width, step = start.half_width, const.VALLEY_STEP_PX
    length = float(spline.arc_length(start.line)[-1])
    count, extra = 2 + int(length / step), int(half_width / step)
    line, normal = strip.frame(start.line, count, extra, length / (count - 1), half_width)
    away = np.arange(0, const.VALLEY_TO_HW * half_width + const.MARGIN_PX, step)
    inside = 1 + int(const.VALLEY_FROM_HW * half_width / step)
    sides = np.array([[1.0], [-1.0]]) * away
    at = line[:, None] + sides[:, None, :, None] * normal[:, None]
    bright = ndimage.map_coordinates(seen.normal, np.moveaxis(at, 3, 0), order=1, mode="nearest")
    bright = ndimage.gaussian_filter1d(bright, half_width / step, axis=1, mode="nearest")
    own, beyond = bright[..., :inside].mean(2, keepdims=True), bright[..., inside:]
    valley = np.minimum.accumulate(beyond, axis=2)
    least = const.VALLEY * start.contrast + seen.noise / np.sqrt(half_width)
    level = np.minimum(valley, 0.0)
    rises = (own - valley > least) & (beyond - np.maximum(valley, 0.0) > least)
    points, away = at[..., inside:, :], np.broadcast_to(away[inside:], rises.shape)
    rises &= ((points > -0.5) & (points < np.array(seen.normal.shape) - 0.5)).all(3)
    return points[rises], away[rises], level[rises]
