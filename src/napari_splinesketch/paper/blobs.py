"""The paper's renderer: rows of radially symmetric blobs, stamped in local patches."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from scipy.interpolate import CubicSpline

from napari_splinesketch.engine.spline import even_basis

# A blob reaches to r = REACH; f is a natural cubic spline over z = exp(-r), NODES nodes apart
# evenly from exp(-REACH), where it is zero, to 1, the blob's centre.
REACH = 2.0
NODES = 7
_EDGE = float(np.exp(-REACH))
# The blob at the start: its row is about as bright in the middle of a body as near the edge.
_DISC_RADIUS, _DISC_EDGE = 0.8, 0.2
# Centre-line samples from which the uniform ones are interpolated, for each of those.
_OVERSAMPLING = 2
_TINY = 1e-6


class Blobs(NamedTuple):
    """Every parameter that renders one image the paper's way; what is optimised.

    Lengths are in units of `Canvas.unit`, brightness in units of the image.
    """

    centre: Float[Array, "N 2"]
    """Where each spline is placed, row and col."""
    offsets: Float[Array, "N K 2"]
    """Its knots, relative to `centre`."""
    widths: Float[Array, "N K"]
    """Logit of r_w at the knots."""
    log_scale: Float[Array, ""]
    """log(W / W̄): the global width, shared by all splines."""
    blend: Float[Array, ""]
    """Logit of α: 0 sum, 1 maximum where splines overlap."""
    brightness: Float[Array, ""]
    gradient: Float[Array, "2"]
    """`brightness` and `gradient`: background in the middle of the frame, and its (2,) change by
    row and col over the frame."""
    log_contrast: Float[Array, ""]
    """Log of the brightness of a body above the background."""
    profile: Float[Array, " M"]
    """(NODES - 1,): f at its nodes, without the one at the blob's edge, which is zero."""
    kernel: Float[Array, "3 3"]
    """The last convolution."""


class Canvas(NamedTuple):
    """Sizes of everything that is drawn, px; they decide what is compiled."""

    frame: tuple[int, int]
    """Height and width of the padded image."""
    tile: tuple[int, int]
    """Height and width of the window that one spline is drawn in."""
    patch: int
    """Side of the square that one blob is drawn in, odd."""
    points: int
    """Number of blobs of a spline."""


class Place(NamedTuple):
    """What turns parameters into pixels; data, so that it never causes a compilation."""

    real: Int[Array, ""]
    moving: Int[Array, ""]
    """`real` and `moving`: number of splines, those beyond are padding; and of those that are
    trained, the first."""
    shape: Float[Array, "2"]
    """Height and width of the image without padding."""
    unit: Float[Array, ""]
    """Unit of length of the parameters, px."""
    scale: Float[Array, ""]
    """W̄: prior of the global width, px."""


# From f at its nodes to c₁t + c₂t² + c₃t³ + Σ bⱼ max(0, t - j)³ for t in node spacings.
_PIECES = CubicSpline(np.arange(NODES), np.eye(NODES), bc_type="natural").c
_POWERS = np.concatenate([_PIECES[2::-1, 0], np.diff(_PIECES[0], axis=0)])[:, 1:]


def evaluate_profile(profile: Float[Array, " M"], z: Float[Array, "*S"]) -> Float[Array, "*S"]:
    """f(z), the blob's brightness at r = -log z; zero beyond REACH."""
    c = jnp.asarray(_POWERS, z.dtype) @ profile
    t = jnp.maximum((z - _EDGE) / (1 - _EDGE) * (NODES - 1), 0.0)
    value = t * (c[0] + t * (c[1] + t * c[2]))
    for j in range(1, NODES - 1):
        value += c[2 + j] * jnp.maximum(t - j, 0.0) ** 3
    return value


def initial_profile() -> Float[np.ndarray, " M"]:
    """A disc with a soft edge, f = 1 / (1 + exp((r - R) / s)), zero at REACH and 1 at z = 1."""
    r = -np.log(np.linspace(_EDGE, 1.0, NODES))
    f = 1 / (1 + np.exp((r - _DISC_RADIUS) / _DISC_EDGE))
    return (f[1:] - f[0]) / (f[-1] - f[0])


def cross_section(
    profile: Float[np.ndarray, " M"], x: Float[np.ndarray, " X"]
) -> Float[np.ndarray, " X"]:
    """Brightness of a long row of blobs at distance `x` (X,) from it, both by W·r_w."""
    y = np.linspace(-REACH, REACH, 401)
    z = np.exp(-np.hypot(x[:, None], y))
    f = CubicSpline(np.linspace(_EDGE, 1.0, NODES), [0.0, *profile], bc_type="natural")
    return np.where(z > _EDGE, f(z), 0.0).sum(1) * (y[1] - y[0])


_RIDGE = float(cross_section(initial_profile(), np.zeros(1))[0])


def half_width_ratio(profile: Float[np.ndarray, " M"]) -> float:
    """Half-width of a long row of blobs, divided by its W·r_w.

    The edge is where the brightness is half of its mean inside, which is the half-width of the
    uniform body that the row resembles most in the least-squares sense.
    """
    x = np.linspace(0.0, REACH, 801)
    height = cross_section(profile, x)
    inside = np.cumsum(height) / np.arange(1, len(x) + 1)
    return float(x[np.argmax(height < inside / 2)])


def spline_knots(scene: Blobs, place: Place) -> Float[Array, "N K 3"]:
    """Row, col and scale W·r_w of the knots, px."""
    at = (scene.centre[:, None] + scene.offsets) * place.unit
    scale = place.scale * jnp.exp(scene.log_scale) * jax.nn.sigmoid(scene.widths)
    return jnp.concatenate([at, scale[..., None]], axis=-1)


def keep_in_frame(
    centre: Float[Array, "N 2"], offsets: Float[Array, "N K 2"], place: Place
) -> Float[Array, "N K 2"]:
    """Offsets with which the knots that are trained lie in the image, as r(s) does in the paper.

    A loss over the image says nothing about what lies outside: an end there would stay there.
    """
    knots = centre[:, None] + offsets
    kept = jnp.clip(knots, 0.0, ((place.shape - 1) / place.unit)[None, None])
    moving = jnp.arange(len(offsets))[:, None, None] < place.moving
    return jnp.where(moving, kept - centre[:, None], offsets)


def sample_points(
    knots: Float[Array, "K 3"], points: int
) -> tuple[Float[Array, "P 3"], Float[Array, ""]]:
    """Row, col and scale of one spline's blobs, uniform in arc length; and its length."""
    dense = jnp.asarray(even_basis(len(knots), _OVERSAMPLING * points), knots.dtype) @ knots
    steps = jnp.diff(dense, axis=0)
    chords = jnp.sqrt((steps[:, :2] ** 2).sum(-1) + _TINY)
    arc = jnp.cumsum(chords)
    target = arc[-1] * np.linspace(0.0, 1.0, points, dtype=np.float32)
    # How much of each chord lies before each point: interpolation without a search.
    before = (target[:, None] - (arc - chords)[None]) * (1 / chords)[None]
    return dense[:1] + jnp.clip(before, 0.0, 1.0) @ steps, arc[-1]


def stamp(
    points: Float[Array, "P 3"], profile: Float[Array, " M"], canvas: Canvas
) -> Float[Array, "h w"]:
    """Sum of the blobs f(exp(-r)) at `points` (row, col, scale), each in its own patch.

    The first and the last count half, as in an integral: else the row would reach half a spacing
    beyond its ends.
    """
    corner = jnp.round(jax.lax.stop_gradient(points[:, :2])).astype(jnp.int32) - canvas.patch // 2
    pixel = corner[:, :, None] + jnp.arange(canvas.patch)[None, None]
    apart = (pixel - points[:, :2, None]) / points[:, 2:, None]
    squared = apart[:, 0, :, None] ** 2 + apart[:, 1, None, :] ** 2
    blobs = evaluate_profile(profile, jnp.exp(-jnp.sqrt(squared + _TINY)))
    trapezoid = np.pad(np.ones(len(points) - 2), 1, constant_values=0.5)
    blobs *= jnp.asarray(trapezoid, blobs.dtype)[:, None, None]
    # The margin takes what is outside of the tile.
    height, width = canvas.tile
    limit = jnp.asarray([[height, width]]) + canvas.patch
    corner = jnp.clip(corner + canvas.patch, 0, limit)
    margin = 2 * canvas.patch
    tile = jnp.zeros((height + margin, width + margin), blobs.dtype)
    tile = jax.lax.scatter_add(tile, corner, blobs, **_WINDOWS)
    return tile[canvas.patch : -canvas.patch, canvas.patch : -canvas.patch]


_WINDOWS: Any = {
    "dimension_numbers": jax.lax.ScatterDimensionNumbers((1, 2), (), (0, 1)),
    "mode": jax.lax.GatherScatterMode.PROMISE_IN_BOUNDS,
}


def draw_tiles(
    scene: Blobs, place: Place, canvas: Canvas
) -> tuple[Float[Array, "N h w"], Int[Array, "N 2"], Float[Array, " N"]]:
    """Each spline alone, of brightness about 1, in a tile of its own.

    Returns
    -------
    tiles
        (N, h, w): zero for splines that are padding.
    origin
        (N, 2): row and col of the tiles' first pixels in the padded frame.
    length
        (N,): the splines' lengths, px; zero for padding.
    """
    width = place.scale * jnp.exp(scene.log_scale)

    @jax.checkpoint
    def draw_one(knots: Float[Array, "K 3"]):
        points, length = sample_points(knots, canvas.points)
        origin = _tile_origin(points, canvas)
        local = points.at[:, :2].add(-origin[None].astype(points.dtype))
        # A sum over blobs times their spacing is an integral along the spline.
        spacing = length / (canvas.points - 1) / width
        return stamp(local, scene.profile, canvas) * (spacing / _RIDGE), origin, length

    def draw_if_real(item: tuple[Int[Array, ""], Float[Array, "K 3"]]):
        index, knots = item
        shapes = jax.eval_shape(draw_one, knots)
        blank = jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), shapes)
        return jax.lax.cond(index < place.real, draw_one, lambda _: blank, knots)

    knots = spline_knots(scene, place)
    moving = jnp.arange(len(knots))[:, None, None] < place.moving
    knots = jnp.where(moving, knots, jax.lax.stop_gradient(knots))
    return jax.lax.map(draw_if_real, (jnp.arange(len(knots)), knots))


def _tile_origin(points: Float[Array, "P 3"], canvas: Canvas) -> Int[Array, "2"]:
    """First pixel of the tile that has a spline's blobs in its middle, and lies in the frame."""
    at = jax.lax.stop_gradient(points[:, :2])
    corner = (at.max(0) + at.min(0)) / 2 - jnp.asarray(canvas.tile) / 2
    room = jnp.asarray(canvas.frame) - jnp.asarray(canvas.tile)
    return jnp.clip(jnp.round(corner).astype(jnp.int32), 0, room)


def blend_tiles(
    tiles: Float[Array, "N h w"],
    origin: Int[Array, "N 2"],
    blend: Float[Array, ""],
    frame: tuple[int, int],
) -> Float[Array, "H W"]:
    """α·max + (1 - α)·sum over splines, in the padded frame; `blend` is the logit of α."""
    empty = jnp.zeros(frame, tiles.dtype)
    highest = jax.lax.scatter_max(empty, origin, jax.lax.stop_gradient(tiles), **_WINDOWS)
    above = jax.vmap(lambda at: jax.lax.dynamic_slice(highest, at, tiles.shape[1:]))(origin)
    alpha = jax.nn.sigmoid(blend)
    share = jnp.where(tiles == above, 1.0, 1 - alpha)
    return jax.lax.scatter_add(empty, origin, tiles * share, **_WINDOWS)


def background(scene: Blobs, place: Place, frame: tuple[int, int]) -> Float[Array, "H W"]:
    """Brightness and gradient over the padded frame."""
    row, col = (
        (jnp.arange(n) - (size - 1) / 2) / size for n, size in zip(frame, place.shape, strict=True)
    )
    slope = scene.gradient
    return scene.brightness + slope[0] * row[:, None] + slope[1] * col[None, :]


def convolve(image: Float[Array, "H W"], kernel: Float[Array, "3 3"]) -> Float[Array, "H W"]:
    """Correlation with a 3 × 3 kernel; the border is continued."""
    height, width = image.shape
    wide = jnp.pad(image, 1, mode="edge")
    shifts = [(i, j) for i in range(3) for j in range(3)]
    parts = [kernel[i, j] * wide[i : i + height, j : j + width] for i, j in shifts]
    return sum(parts[1:], parts[0])


def compose(
    scene: Blobs, bodies: Float[Array, "H W"], place: Place, frame: tuple[int, int]
) -> Float[Array, "H W"]:
    """Contrast times the blended splines, plus the background: all but the last convolution."""
    return jnp.exp(scene.log_contrast) * bodies + background(scene, place, frame)
