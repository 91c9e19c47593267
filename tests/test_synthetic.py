"""Generated scenes: what they draw is what their labels say."""

import dataclasses

import numpy as np
import perturbations
import pytest
from scipy.ndimage import map_coordinates

from napari_splinesketch import metrics, synthetic
from napari_splinesketch.synthetic import drawing
from napari_splinesketch.synthetic.bodies import crosses, random_curve

PLAIN = synthetic.Look(
    level=0.0,
    contrast=1.0,
    flatness=1.0,
    brightness_sd=0.0,
    shading=0.0,
    texture=0.0,
    taper_floor=1.0,
)
SHAPE = (60, 150)


def draw(points: np.ndarray, half_width: float, look: synthetic.Look = PLAIN) -> np.ndarray:
    widths = np.full(len(points), half_width)
    return drawing.draw_bodies((points,), (widths,), (drawing.Finish(),), look, SHAPE)


def line(row: float, angle: float = 0.0, length: float = 80.0) -> np.ndarray:
    along = np.linspace(-length / 2, length / 2, 100)[:, None]
    return np.array([row, 75.0]) + along * [np.sin(angle), np.cos(angle)]


def arc_length(curve: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(curve, axis=0), axis=1).sum())


@pytest.mark.parametrize("angle", [0.0, 0.3, np.pi / 4])
@pytest.mark.parametrize("row", [30.0, 30.37])
def test_area_is_that_of_a_rounded_strip(angle, row):
    area = draw(line(row, angle, length=60), 3.0).sum()
    assert area == pytest.approx(60 * 6 + np.pi * 9, rel=3e-3)


@pytest.mark.parametrize("row", [30.0, 30.25, 30.5])
def test_profile_across_a_horizontal_line_is_exact(row):
    column = draw(line(row), 2.6)[:, 75]
    edges = np.arange(SHAPE[0])[:, None] + [-0.5, 0.5]
    overlap = np.clip(edges, row - 2.6, row + 2.6)
    np.testing.assert_allclose(column, np.diff(overlap)[:, 0], atol=0.01)


def test_centre_of_mass_lies_on_the_centreline():
    curve = line(29.3, 0.2)
    image = draw(curve, 2.5)
    rows, columns = np.indices(SHAPE)
    centre = [(image * rows).sum() / image.sum(), (image * columns).sum() / image.sum()]
    np.testing.assert_allclose(centre, [29.3, 75], atol=5e-3)


def test_elliptic_cross_section():
    look = dataclasses.replace(PLAIN, flatness=0.0)
    assert draw(line(30), 3.0, look)[:, 75].sum() == pytest.approx(np.pi / 2 * 3, rel=1e-2)


@pytest.mark.parametrize(("overlap", "expected"), [(1.0, 1.0), (0.0, 2.0), (0.5, 1.5)])
def test_overlap_is_between_maximum_and_sum(overlap, expected):
    look = dataclasses.replace(PLAIN, overlap=overlap)
    pair = (line(30, 0.5), line(30, -0.5))
    widths = (np.full(100, 3.0),) * 2
    image = drawing.draw_bodies(pair, widths, (drawing.Finish(),) * 2, look, SHAPE)
    assert image[30, 75] == pytest.approx(expected)


def test_taper_follows_its_formula():
    look = dataclasses.replace(PLAIN, taper_floor=0.1, taper_length=0.25, taper_power=0.5)
    width = drawing.taper(look, 101)
    np.testing.assert_allclose(width[[0, 12, 25, 50, 100]], [0.1, 0.48**0.5, 1, 1, 0.1])


def test_body_outside_the_frame_draws_nothing():
    assert draw(line(-30.0), 3.0).sum() == 0
    assert draw(line(0.0), 3.0).sum() == pytest.approx(80 * 3.5 + np.pi * 4.5 + 3, rel=0.01)


@pytest.mark.parametrize("bodies", [1, 2, 3, 8])
def test_scene_is_deterministic_and_bodies_keep_inside(bodies):
    shape = (140, 170)
    first, again = (synthetic.scene(5, bodies=bodies, shape=shape) for _ in range(2))
    other = synthetic.scene(6, bodies=bodies, shape=shape)
    assert first.image.dtype == np.float32
    assert first.image.shape == shape
    np.testing.assert_array_equal(first.image, again.image)
    assert not np.array_equal(first.image, other.image)
    assert len(first.centrelines) == len(first.half_widths) == bodies
    for points in first.centrelines:
        assert np.all(points >= 5)
        assert np.all(points <= np.array(shape) - 6)
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        np.testing.assert_allclose(steps, steps.mean(), rtol=1e-3)


@pytest.mark.parametrize("seed", range(6))
def test_two_or_three_bodies_cross(seed):
    for bodies in (2, 3):
        curves = synthetic.scene(seed, bodies=bodies).centrelines
        for i, curve in enumerate(curves[1:], start=1):
            assert any(crosses(curve, other) for other in curves[:i])


def test_crossing_can_be_turned_on_for_many():
    curves = synthetic.scene(1, bodies=6, shape=(300, 300), crossing=True).centrelines
    assert all(any(crosses(c, o) for o in curves[:i]) for i, c in enumerate(curves) if i)


@pytest.mark.parametrize("polarity", ["bright", "dark"])
def test_polarity_and_contrast(polarity):
    frame = synthetic.scene(3, polarity=polarity, contrast=0.4, gradient=(0.0, 0.0), blur=0.5)
    middle = frame.centrelines[0][40:60]
    sign = 1 if polarity == "bright" else -1
    on_body = map_coordinates(frame.clean - frame.background, middle.T, order=1)
    np.testing.assert_allclose(on_body, sign * 0.4, atol=0.09)


def test_noise_has_the_promised_size():
    frame = synthetic.scene(4, shape=(128, 200), snr=10.0, contrast=0.4)
    standard = (frame.image - frame.clean) / frame.noise_sd
    assert standard.std() == pytest.approx(1, abs=0.02)
    on_body = map_coordinates(frame.noise_sd, frame.centrelines[0][40:60].T, order=1)
    np.testing.assert_allclose(on_body, 0.04, rtol=0.1)


def test_background_gradient():
    frame = synthetic.scene(4, shape=(100, 140), gradient=(0.5, -0.25), contrast=0.4, level=0.6)
    corners = frame.background[[0, 0, -1], [0, -1, 0]]
    np.testing.assert_allclose(corners, [0.55, 0.45, 0.75])


def test_size_of_bodies():
    frame = synthetic.scene(2, bodies=4, length=40, half_width=1.2)
    for points, width in zip(frame.centrelines, frame.half_widths, strict=True):
        assert 32 <= arc_length(points) <= 44.1
        assert 0.83 * 1.2 <= width.max() <= 1.17 * 1.2


def test_debris_adds_specks():
    clear, dirty = (synthetic.scene(9, debris=count, polarity="bright") for count in (0, 12))
    assert dirty.clean.sum() > clear.clean.sum()
    np.testing.assert_array_equal(dirty.centrelines[0], clear.centrelines[0])


def test_curvature_is_bounded():
    rng = np.random.default_rng(0)
    for _ in range(20):
        curve = random_curve(rng, 100, 3, 2.0)
        turns = np.diff(np.unwrap(np.arctan2(*np.diff(curve, axis=0).T)))
        assert np.abs(turns).max() / (100 / 99) <= 1.03 / 7.5


def test_straight_bodies():
    points = synthetic.scene(2, bend=0.0).centrelines[0]
    np.testing.assert_allclose(np.linalg.norm(points[-1] - points[0]), arc_length(points))


def test_impossible_scenes_say_so():
    with pytest.raises(ValueError, match="does not fit into a frame"):
        synthetic.scene(0, length=200, bend=0.0)
    with pytest.raises(ValueError, match="brightnes"):
        synthetic.scene(0, brightnes=2.0)
    with pytest.raises(ValueError, match="polarity is 'drak'; choose 'bright' or 'dark'"):
        synthetic.scene(0, polarity="drak")


CURVE = synthetic.scene(11).centrelines[0]


def test_rotation_keeps_centroid_and_length():
    turned = synthetic.rotate(CURVE, 20)
    np.testing.assert_allclose(turned.mean(axis=0), CURVE.mean(axis=0))
    assert arc_length(turned) == pytest.approx(arc_length(CURVE))
    before, after = (c[-1] - c[0] for c in (CURVE, turned))
    angle = np.arctan2(after[1], after[0]) - np.arctan2(before[1], before[0])
    assert np.rad2deg(angle) % 360 == pytest.approx(20)


def test_displacement():
    np.testing.assert_allclose(perturbations.displace(CURVE, 10) - CURVE, [[10, 0]] * 100)
    np.testing.assert_allclose(perturbations.displace(CURVE, 10, 90) - CURVE, [[0, 10]] * 100)
    moved = perturbations.displace(CURVE, 10, np.random.default_rng(0)) - CURVE
    np.testing.assert_allclose(np.linalg.norm(moved, axis=1), 10)


def test_scaling():
    small = perturbations.scale(CURVE, 0.7)
    assert arc_length(small) == pytest.approx(0.7 * arc_length(CURVE))
    np.testing.assert_allclose(small.mean(axis=0), CURVE.mean(axis=0))


def test_chord_and_axis_line():
    np.testing.assert_array_equal(perturbations.chord(CURVE), CURVE[[0, -1]])
    axis = perturbations.axis_line(CURVE)
    assert arc_length(axis) == pytest.approx(arc_length(CURVE), rel=1e-3)
    assert np.dot(*np.diff(np.stack([axis, CURVE[[0, -1]]]), axis=1)[:, 0]) > 0
    straight = np.array([[10.0, 20.0], [40.0, 60.0]])
    np.testing.assert_allclose(perturbations.axis_line(straight), straight)


def test_compression_loses_less_with_more_components():
    losses = [metrics.average_dtw(synthetic.compress(CURVE, k), CURVE) for k in (2, 4, 8, 200)]
    assert losses == sorted(losses, reverse=True)
    assert losses[0] > 0.5
    assert losses[-1] < 1e-6


@pytest.mark.parametrize("components", [-1, 201])
def test_impossible_numbers_of_components_are_refused(components: int):
    with pytest.raises(ValueError, match=f"components is {components}; give a whole number"):
        synthetic.compress(CURVE, components)


def test_two_components_follow_any_direction():
    straight = np.linspace([10.0, 20.0], [70.0, 90.0], 100)
    assert metrics.average_dtw(synthetic.compress(straight, 2), straight) < 1.5
