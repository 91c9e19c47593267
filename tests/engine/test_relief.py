"""Bodies in relief, bright on one side and dark on the other, are found like others."""

import numpy as np
import pytest
from scipy import ndimage

from napari_splinesketch import Progress, refine, synthetic
from napari_splinesketch.engine import spline
from napari_splinesketch.engine.look import relief
from napari_splinesketch.engine.look.scene import leaning, read_scenes
from napari_splinesketch.engine.types import CANCELLED
from napari_splinesketch.metrics import average_dtw

NOTE = "Bodies are in relief: bright on one side and dark on the other."
ANGLE = 0.7
LIGHT = np.array([np.sin(ANGLE), np.cos(ANGLE)])


def slope(image: np.ndarray) -> np.ndarray:
    """An image lit from LIGHT: what falls towards it is bright."""
    down, across = np.gradient(ndimage.gaussian_filter(image.astype(float), 1.0))
    return -LIGHT[0] * down - LIGHT[1] * across


def lit(scene: synthetic.Scene, seed: int = 0) -> tuple[np.ndarray, list[np.ndarray]]:
    """A scene in relief, with lines clicked over its bodies."""
    rng = np.random.default_rng(seed)
    image = slope(scene.clean)
    image += rng.normal(0, 0.15 * image.std(), image.shape)
    lines = [spline.resample(c, 5) + rng.normal(0, 1, (5, 2)) for c in scene.centrelines]
    return image, lines


def scene_of(bodies: int) -> synthetic.Scene:
    side = max(160, int(np.sqrt(bodies * 9000)))
    return synthetic.scene(1, bodies=bodies, shape=(side, side), crossing=False)


@pytest.mark.parametrize("bodies", [1, 8])
def test_curves_lie_between_the_bright_and_the_dark_sides(bodies: int) -> None:
    scene = scene_of(bodies)
    found = refine(*lit(scene))
    apart = [average_dtw(c.points, t) for c, t in zip(found.curves, scene.centrelines, strict=True)]
    assert max(apart) < 1.5
    assert np.median(apart) < 0.7
    assert NOTE in found.model.notes


@pytest.mark.parametrize(
    "recorded",
    [
        lambda image: image**2.5,
        lambda image: image**0.3,
        lambda image: np.minimum(image, np.quantile(image, 0.93)),
    ],
    ids=["dark shades", "bright shades", "saturated"],
)
def test_the_bright_and_the_dark_side_may_be_unlike(recorded) -> None:
    scene = scene_of(8)
    image, lines = lit(scene)
    image = recorded((image - image.min()) / np.ptp(image))
    found = refine(image, lines)
    apart = [average_dtw(c.points, t) for c, t in zip(found.curves, scene.centrelines, strict=True)]
    assert NOTE in found.model.notes
    assert np.median(apart) < 0.9


def test_it_can_be_cancelled_while_the_light_is_looked_for() -> None:
    asked, given = [], lit(scene_of(8))

    def stop(progress: Progress) -> bool:
        asked.append(progress.stage)
        return len(asked) < 4

    found = refine(*given, on_progress=stop)
    assert asked == ["looking at the image"] * 4
    assert all(curve.reasons == (CANCELLED,) for curve in found.curves)


@pytest.mark.parametrize("seed", range(3))
def test_straight_lines_tell_relief_too(seed: int) -> None:
    scene = scene_of(8)
    image, lines = lit(scene, seed)
    found = refine(image, [line[[0, -1]] for line in lines])
    apart = [average_dtw(c.points, t) for c, t in zip(found.curves, scene.centrelines, strict=True)]
    assert NOTE in found.model.notes
    assert max(apart) < 1.5


def test_the_picture_of_the_bodies_is_in_relief_too() -> None:
    image, lines = lit(scene_of(8))
    found = refine(image, lines)
    bodies = found.reconstruction - found.background
    assert np.corrcoef(bodies.ravel(), image.ravel())[0, 1] > 0.7


def test_one_light_falls_on_bodies_that_are_far_from_each_other() -> None:
    shape = (160, 1500)
    scene = synthetic.scene(6, bodies=3, shape=shape, crossing=False, margin=20, bend=0.2)
    image, lines = lit(scene)
    assert np.diff(sorted(line[:, 1].mean() for line in lines)).min() > 250  # each is an island
    found = refine(image, lines)
    apart = [average_dtw(c.points, t) for c, t in zip(found.curves, scene.centrelines, strict=True)]
    assert max(apart) < 1.5


def test_a_turned_image_gives_turned_curves() -> None:
    image, lines = lit(scene_of(8))
    straight = refine(image, lines).curves
    turned = refine(image.T[::-1], [x[:, ::-1] * [-1, 1] + [len(image.T) - 1, 0] for x in lines])
    for one, two in zip(straight, turned.curves, strict=True):
        back = (two.points - [len(image.T) - 1, 0])[:, ::-1] * [1, -1]
        assert np.abs(back - one.points).max() < 1e-6


def test_a_polarity_that_is_given_is_believed() -> None:
    image, lines = lit(scene_of(8))
    assert NOTE not in refine(image, lines, polarity="bright").model.notes


def test_bright_dark_and_hollow_bodies_are_not_in_relief() -> None:
    scene = scene_of(8)
    lines = [spline.resample(c, 5) for c in scene.centrelines]
    inside = ndimage.gaussian_filter(scene.clean, 1.0)
    down, across = np.gradient(inside)
    for image in (scene.image, -scene.image, np.hypot(down, across)):
        assert NOTE not in refine(image, lines).model.notes


@pytest.mark.parametrize("bodies", [1, 2, 3])
def test_bodies_that_cross_are_not_in_relief(bodies: int) -> None:
    for seed in range(1000, 1020):
        made = synthetic.scene(seed, bodies=bodies)
        turned = [synthetic.rotate(curve, 20) for curve in made.centrelines]
        seen = read_scenes(made.image, turned, "auto", None)
        assert not relief.lights(leaning(seen)), seed
        assert NOTE not in refine(made.image, turned).model.notes, seed


@pytest.mark.parametrize("bodies", [1, 8])
def test_bodies_that_cast_shadows_are_bright_where_they_are_clicked(bodies: int) -> None:
    scene = scene_of(bodies)
    clean = scene.clean - np.median(scene.clean)
    shadow = ndimage.shift(clean, -7 * LIGHT, order=1)
    noise = np.random.default_rng(0).normal(0, 0.05 * clean.std(), clean.shape)
    found = refine(clean - shadow + noise, [spline.resample(c, 5) for c in scene.centrelines])
    apart = [average_dtw(c.points, t) for c, t in zip(found.curves, scene.centrelines, strict=True)]
    assert NOTE not in found.model.notes
    assert np.median(apart) < 0.7


def test_a_line_over_nothing_puts_no_clear_body_in_relief() -> None:
    for seed in range(12):
        scene = synthetic.scene(seed, shape=(100, 120), length=55.0, half_width=2.5, margin=8.0)
        body = scene.centrelines[0]
        corners = np.array([[20.0, 15.0], [20.0, 75.0], [80.0, 15.0], [80.0, 75.0]])
        apart = np.linalg.norm(body[:, None] - np.add(corners, [0, 15]), axis=2).min(0)
        stray = np.add(corners[apart.argmax()], [[0, 0], [1, 10], [-1, 20], [0, 30]])
        found = refine(scene.image, [body[::33] + 0.7, stray])
        assert NOTE not in found.model.notes, seed
        assert average_dtw(found.curves[0].points, body) < 0.7, seed


def test_raising_an_image_and_back_leaves_it_as_it_was() -> None:
    image = ndimage.gaussian_filter(np.random.default_rng(0).normal(size=(90, 120)), 3.0)
    image[[0, -1]] = image[:, [0, -1]] = np.median(image)
    back = relief.raised(relief.raised(image, LIGHT), -LIGHT)
    inner = (slice(30, -30),) * 2
    assert np.corrcoef(back[inner].ravel(), image[inner].ravel())[0, 1] > 0.9


def test_white_noise_stays_white() -> None:
    noise = np.random.default_rng(0).normal(size=(200, 200))
    raised = relief.raised(noise, LIGHT)[30:-30, 30:-30]
    assert raised.std() == pytest.approx(1, abs=0.05)
    assert abs((raised[1:] * raised[:-1]).mean()) < 0.05
