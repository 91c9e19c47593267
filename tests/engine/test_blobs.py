"""The paper's renderer against the same sum written out over whole frames."""

from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.ndimage import correlate

from napari_splinesketch.engine import spline
from napari_splinesketch.paper import blobs

CANVAS = blobs.Canvas(frame=(64, 96), tile=(64, 64), patch=17, points=40)
UNIT = 20.0
SCALE = 3.5
EDGE = np.exp(-blobs.REACH)


@pytest.fixture(autouse=True)
def strict_ranks():
    with jax.numpy_rank_promotion("raise"):
        yield


def make(curves: list[np.ndarray], *, padded: int | None = None, seed: int = 0):
    """A scene whose parameters are all different from their starting values."""
    rng = np.random.default_rng(seed)
    knots = np.zeros((padded or len(curves), 5, 2))
    knots[: len(curves)] = [spline.fit_knots(c, 5) for c in curves]
    centre = knots.mean(axis=1)
    widths = np.zeros(knots.shape[:2])
    widths[: len(curves)] = rng.normal(1, 0.5, (len(curves), 5))
    scene = blobs.Blobs(
        centre=jnp.asarray(centre / UNIT),
        offsets=jnp.asarray((knots - centre[:, None]) / UNIT),
        widths=jnp.asarray(widths),
        log_scale=jnp.asarray(-0.05),
        blend=jnp.asarray(0.4),
        brightness=jnp.asarray(0.1),
        gradient=jnp.asarray([0.3, -0.2]),
        log_contrast=jnp.asarray(0.2),
        profile=jnp.asarray(blobs.initial_profile() + rng.normal(0, 0.05, blobs.NODES - 1)),
        kernel=jnp.asarray([[0.0, 0.1, 0.05], [0.0, 0.7, 0.1], [0.1, 0.0, 0.0]]),
    )
    place = blobs.Place(
        jnp.asarray(len(curves)),
        jnp.asarray(len(curves)),
        jnp.asarray([60.0, 90.0]),
        jnp.asarray(UNIT),
        jnp.asarray(SCALE),
    )
    return scene, place


CROSSING = [
    np.array([[10.0, 20], [30, 45], [55, 60]]),
    np.array([[50.0, 15], [30, 40], [12, 50]]),
]
LEAVING = [np.array([[20.0, 70], [30, 85], [40, 110]]), np.array([[-8.0, 30], [20, 35], [30, 30]])]


@dataclass
class Naive:
    """The image, summed blob by blob over the whole frame."""

    scene: blobs.Blobs
    place: blobs.Place

    def f(self, r: np.ndarray) -> np.ndarray:
        nodes = np.linspace(EDGE, 1, blobs.NODES)
        values = CubicSpline(nodes, [0, *np.asarray(self.scene.profile)], bc_type="natural")
        return np.where(r < blobs.REACH, values(np.exp(-r)), 0.0)

    def one(self, i: int) -> np.ndarray:
        knots = (np.asarray(self.scene.centre)[i] + np.asarray(self.scene.offsets)[i]) * UNIT
        width = 1 / (1 + np.exp(-np.asarray(self.scene.widths)[i]))
        total = SCALE * np.exp(float(self.scene.log_scale))
        points = spline.sample(np.column_stack([knots, total * width]), CANVAS.points)
        row, col = np.mgrid[: CANVAS.frame[0], : CANVAS.frame[1]]
        frame = np.zeros(CANVAS.frame)
        for index, (y, x, w) in enumerate(points):
            share = 0.5 if index in (0, len(points) - 1) else 1.0
            frame += share * self.f(np.hypot(row - y, col - x) / w)
        spacing = spline.arc_length(points)[-1] / (CANVAS.points - 1)
        peak = blobs.cross_section(blobs.initial_profile(), np.zeros(1))[0]
        return frame * spacing / total / peak

    def bodies(self) -> np.ndarray:
        each = np.array([self.one(i) for i in range(int(self.place.real))])
        alpha = 1 / (1 + np.exp(-float(self.scene.blend)))
        highest = each.max(0, initial=0.0)  # where no body is, is none of brightness below zero
        return alpha * highest + (1 - alpha) * each.sum(0)


@partial(jax.jit, static_argnames="canvas")
def draw(scene: blobs.Blobs, place: blobs.Place, canvas: blobs.Canvas = CANVAS) -> jax.Array:
    tiles, origin, _ = blobs.draw_tiles(scene, place, canvas)
    return blobs.blend_tiles(tiles, origin, scene.blend, canvas.frame)


# Each operation outside of a jitted function would be compiled alone.
compose = jax.jit(blobs.compose, static_argnums=3)
convolve = jax.jit(blobs.convolve)
evaluate_profile = jax.jit(blobs.evaluate_profile)
keep_in_frame = jax.jit(blobs.keep_in_frame)
sample_points = jax.jit(blobs.sample_points, static_argnums=1)
spline_knots = jax.jit(blobs.spline_knots)


@pytest.mark.parametrize("curves", [CROSSING, LEAVING], ids=["crossing", "leaving the frame"])
def test_stamped_patches_equal_a_sum_over_whole_frames(curves) -> None:
    scene, place = make(curves)
    expected = Naive(scene, place).bodies()
    assert expected.max() > 0.5
    np.testing.assert_allclose(draw(scene, place), expected, atol=3e-3)


def test_a_whole_image_is_contrast_background_and_kernel() -> None:
    scene, place = make(CROSSING)
    bodies = Naive(scene, place).bodies()
    row, col = np.mgrid[: CANVAS.frame[0], : CANVAS.frame[1]]
    behind = 0.1 + 0.3 * (row - 29.5) / 60 - 0.2 * (col - 44.5) / 90
    expected = correlate(np.exp(0.2) * bodies + behind, np.asarray(scene.kernel), mode="nearest")
    image = compose(scene, draw(scene, place), place, CANVAS.frame)
    np.testing.assert_allclose(convolve(image, scene.kernel), expected, atol=4e-3)


def test_splines_of_padding_change_nothing() -> None:
    plain = make(CROSSING)
    padded = make(CROSSING, padded=7)
    np.testing.assert_allclose(draw(*padded), draw(*plain), atol=1e-5)


def test_room_to_spare_changes_nothing() -> None:
    scene, place = make(CROSSING)
    more = draw(scene, place, CANVAS._replace(frame=(128, 128), tile=(64, 96), patch=25))
    np.testing.assert_allclose(more[:64, :96], draw(scene, place), atol=1e-5)


@pytest.mark.slow
def test_gradients_agree_with_finite_differences() -> None:
    names = ("centre", "offsets", "widths", "log_scale", "blend", "profile")
    with jax.enable_x64(True):
        scene, place = make(CROSSING, padded=3)
        rng = np.random.default_rng(1)
        weights = rng.normal(size=CANVAS.frame)

        @jax.jit
        @jax.value_and_grad
        def weighted(values: dict[str, jax.Array]) -> jax.Array:
            return (draw(scene._replace(**values), place) * weights).sum()

        # Of one kind, in memory of NumPy: each other kind would be compiled anew.
        values = {name: np.asarray(getattr(scene, name)) for name in names}
        slope = jax.tree.map(np.asarray, weighted(values)[1])
        for name in names:
            ahead = rng.normal(size=values[name].shape)
            there = (np.asarray(values[name] + h * ahead) for h in (1e-6, -1e-6))
            up, down = (float(weighted({**values, name: at})[0]) for at in there)
            expected = (up - down) / 2e-6
            assert abs(expected) > 1e-2
            assert float((slope[name] * ahead).sum()) == pytest.approx(expected, rel=1e-4), name
        assert not np.any(slope["offsets"][2]) and not np.any(slope["widths"][2])


def test_points_are_uniform_in_arc_length() -> None:
    scene, place = make([np.array([[10.0, 10], [12, 14], [40, 50], [41, 80]])])
    knots = np.asarray(spline_knots(scene, place))[0]
    points, length = sample_points(knots, 40)
    expected = spline.sample(np.asarray(knots), 40)
    np.testing.assert_allclose(points, expected, atol=0.02)
    assert float(length) == pytest.approx(spline.arc_length(expected)[-1], rel=2e-3)


def test_the_profile_is_a_natural_spline_through_its_nodes() -> None:
    values = np.random.default_rng(0).normal(size=blobs.NODES - 1)
    nodes = np.linspace(EDGE, 1, blobs.NODES)
    f = CubicSpline(nodes, [0, *values], bc_type="natural")
    z = np.linspace(EDGE, 1, 200)
    found = evaluate_profile(values, z)
    np.testing.assert_allclose(found, f(z), atol=1e-4)
    assert not np.any(evaluate_profile(values, np.linspace(0, EDGE, 9)))


def test_a_row_of_blobs_starts_with_brightness_one_and_its_half_width() -> None:
    scene, place = make([np.array([[30.0, 20], [30, 70]])])
    scene = scene._replace(
        log_scale=jnp.zeros(()),
        widths=jnp.full((1, 5), 30.0),
        profile=jnp.asarray(blobs.initial_profile()),
    )
    across = np.asarray(draw(scene, place))[30:, 45]
    assert across[0] == pytest.approx(1.0, abs=0.04)

    x = np.linspace(0, 2, 2001)
    height = blobs.cross_section(blobs.initial_profile(), x)
    explained = [height[:i].sum() ** 2 / i for i in range(1, len(x))]
    nearest_uniform = x[np.argmax(explained)]
    ratio = blobs.half_width_ratio(blobs.initial_profile())
    assert ratio == pytest.approx(nearest_uniform, abs=0.01)


def test_knots_that_are_trained_are_kept_in_the_image() -> None:
    scene, place = make([*LEAVING, LEAVING[0]], padded=4)
    place = place._replace(moving=jnp.asarray(2))
    kept = np.asarray(keep_in_frame(scene.centre, scene.offsets, place))
    centre = np.asarray(scene.centre)[:, None]
    knots, before = (centre + kept) * UNIT, (centre + np.asarray(scene.offsets)) * UNIT
    assert before[0].max() > 100 and before[1].min() < -5
    np.testing.assert_allclose(knots[:2], np.clip(before[:2], 0, [59, 89]), atol=1e-4)
    np.testing.assert_array_equal(knots[2:], before[2:])
