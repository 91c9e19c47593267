"""Everything lands where the window shows it, whatever the layers' scales and units."""

from typing import Any

import numpy as np
import pint
import pytest
from napari.components import ViewerModel
from napari.layers import Image, Shapes

from napari_splinesketch.plugin.dock import SplinesketchDock
from napari_splinesketch.plugin.layers.space import (
    current_frame,
    frame_numbers,
    in_stack,
    look_at,
    pixel_size,
    placement,
    plane_problem,
    screen_pixel,
    times_of,
    to_pixels,
    to_world,
    view_of,
)

from .bench import bench
from .fakes import FakeEngine
from .hand import QTest, canvas_point, click, draw, fit_view, refine, until

AFFINE = np.array([[0.9, 0.2, 3.0], [-0.1, 1.1, -4.0], [0.0, 0.0, 1.0]])
TURNED = {"rotate": 25.0, "shear": [0.2], "affine": AFFINE}
PLACES: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "pixels": ({}, {}),
    "anisotropic": ({"scale": (0.5, 2.0)}, {}),
    "translated": ({"scale": (0.5, 2.0), "translate": (7, -3)}, {"translate": (1, 2)}),
    "turned": ({"scale": (0.5, 2.0), **TURNED}, {"scale": (3, 0.7), "rotate": -40}),
    "nm on um": (
        {"scale": (0.5, 0.2), "units": ("um", "um"), **TURNED},
        {"scale": (30, 20), "units": ("nm", "nm"), "translate": (5, 9)},
    ),
    "mm on um": ({"units": ("um", "um")}, {"scale": (1e-3, 2e-3), "units": ("mm", "mm")}),
    "units that do not match": ({"units": ("um", "um")}, {"scale": (2, 3)}),
}


def pair(image: dict[str, Any], sketches: dict[str, Any], shape: tuple[int, ...] = (40, 60)) -> Any:
    viewer: Any = ViewerModel()
    layer = viewer.add_image(np.zeros(shape), **image)
    return viewer, layer, viewer.add_shapes(ndim=2, **sketches)


@pytest.mark.slow
@pytest.mark.window(shown=True)
@pytest.mark.filterwarnings("ignore:Inconsistent units across layers")
def test_pixels_are_where_the_canvas_shows_them(viewer: Any) -> None:
    canvas = viewer.window._qt_viewer.canvas
    for name, (image, sketches) in PLACES.items():  # in one window, which takes longest
        viewer.layers.clear()
        layer = viewer.add_image(np.zeros((40, 60)), **image)
        shapes = viewer.add_shapes([[[0, 0], [9, 9]]], shape_type="line", **sketches)
        viewer.reset_view()
        canvas.on_draw(None)
        points = np.array([[3.0, 4.0], [10.5, 2.0], [-7.0, 20.0]])
        shown = canvas.layer_to_visual[shapes].node.transform.map(points[:, ::-1])
        expected = canvas.layer_to_visual[layer].node.transform.imap(shown)[:, 1::-1]
        # The visual of an image counts from the corner of the first pixel, not from its centre.
        found = to_pixels(viewer, shapes, layer, points)
        offset = np.unique(np.round(expected - found, 3))
        assert len(offset) == 1, name
        assert offset[0] in (0.0, 0.5), name


@pytest.mark.parametrize("name", PLACES)
@pytest.mark.filterwarnings("ignore:Inconsistent units across layers")
def test_a_layer_placed_on_the_image_has_its_pixels(name: str) -> None:
    viewer, image, _ = pair(PLACES[name][0], {})
    shapes = viewer.add_shapes(ndim=2, **placement(image))
    points = np.array([[3.0, 4.0], [10.5, 2.0]])
    np.testing.assert_allclose(to_pixels(viewer, shapes, image, points), points, atol=1e-9)


def test_a_flat_sketch_lies_in_the_frame_in_view() -> None:
    viewer, image, shapes = pair({"scale": (2.0, 0.5, 3)}, {"scale": (1.0, 6)}, (5, 40, 60))
    viewer.dims.set_point(0, 6.0)
    assert current_frame(viewer, image) == 3
    found = to_pixels(viewer, shapes, image, np.array([[1.0, 2.0]]))
    np.testing.assert_allclose(found, [[3, 2, 4]])


@pytest.mark.parametrize("units", ["pixel", "s"])
def test_between_two_frames_it_is_the_one_that_napari_shows(units: str) -> None:
    viewer, numbers = ViewerModel(), np.arange(8)[:, None, None] * np.ones((1, 6, 7))
    placed: Any = {"translate": (1.3, 0, 0), "units": (units, "pixel", "pixel")}
    image = viewer.add_image(numbers, **placed)
    viewer.add_image(np.zeros((16, 6, 7)), scale=(0.5, 1, 1), **placed)
    assert isinstance(image, Image)
    for step in range(15):
        viewer.dims.set_current_step(0, step)
        shown = image.get_value((viewer.dims.point[0], 1, 1), world=True)
        assert current_frame(viewer, image) == shown


def test_fractions_of_frames_are_rounded_in_the_image() -> None:
    viewer: Any = ViewerModel()
    image = viewer.add_image(np.zeros((5, 40, 60)))
    shapes = viewer.add_shapes(ndim=3, scale=(2, 1, 1))
    pixels = to_pixels(viewer, shapes, image, np.array([[1.3, 4, 5], [0.0, 1, 1], [9, 2, 2]]))
    np.testing.assert_allclose(pixels[0], [2.6, 4, 5])
    assert frame_numbers(image, pixels) == [3, 0, 18], "beyond the last one, it stays beyond"


def test_frames_over_several_axes_are_counted_through() -> None:
    image = Image(np.zeros((2, 3, 8, 9)))
    begin = np.zeros((1, 2))
    index = [in_stack(image, n, begin)[0, :2].tolist() for n in (0, 2, 3, 5)]
    assert index == [[0, 0], [0, 2], [1, 0], [1, 2]]
    points = in_stack(image, 5, np.array([[4.0, 5.0]]))
    np.testing.assert_array_equal(points, [[1, 2, 4, 5]])
    assert frame_numbers(image, points) == [5]
    assert in_stack(Image(np.zeros((8, 9))), 0, begin).tolist() == [[0, 0]]


def test_planes_that_cannot_be_sketched_on_are_named() -> None:
    viewer, image, _ = pair({}, {}, (5, 40, 60))
    assert plane_problem(viewer, image) == ""
    viewer.dims.ndisplay = 3
    assert "2-D" in plane_problem(viewer, image)
    viewer.dims.ndisplay = 2
    viewer.dims.order = (1, 0, 2)
    assert "last two axes" in plane_problem(viewer, image)
    viewer.dims.order = (0, 2, 1)
    assert plane_problem(viewer, image) == "", "a transposed view shows the same plane"


def test_a_transposed_view_is_looked_at_as_it_is() -> None:
    viewer, image, _ = pair({"scale": (1, 2, 2)}, {}, (5, 400, 60))
    viewer.dims.transpose()
    viewer.scene.camera.zoom = 10.0
    look_at(viewer, image, 3, np.array([[350.0, 20], [350, 40]]))
    assert viewer.scene.camera.center == (0.0, 60.0, 700.0), "columns run down"
    view = view_of(viewer, image)
    assert view.frame == 3
    np.testing.assert_allclose((view.low + view.high) / 2, [350, 30])


@pytest.mark.parametrize("name", PLACES)
@pytest.mark.filterwarnings("ignore:Inconsistent units across layers")
def test_a_pixel_of_the_screen_covers_what_is_seen_under_it(name: str) -> None:
    viewer, image, _ = pair(*PLACES[name])
    viewer.scene.camera.zoom = 4.0
    corner, *ends = to_world(viewer, image, np.array([[0.0, 0.0], [1, 0], [0, 1]]))
    on_screen = np.linalg.norm(np.subtract(ends, corner), axis=1) * 4.0
    np.testing.assert_allclose(screen_pixel(viewer, image), 1 / on_screen)


SIZES: dict[str, tuple[dict[str, Any], Any]] = {
    "none": ({}, (None, None)),
    "scale alone": ({"scale": (0.5, 2)}, ((0.5, 2.0), None)),
    "units": ({"scale": (0.5, 2), "units": ("um", "um")}, ((0.5, 2.0), "µm")),
    "two units": ({"scale": (0.5, 2), "units": ("um", "nm")}, ((0.5, 0.002), "µm")),
    "no lengths both": ({"scale": (0.5, 2), "units": ("s", "nm")}, (None, None)),
    "mirrored": ({"scale": (-0.5, 2)}, ((0.5, 2.0), None)),
}


@pytest.mark.parametrize("name", SIZES)
def test_pixel_size(name: str) -> None:
    how, expected = SIZES[name]
    layer = Image(np.zeros((4, 4)), **how)
    size, unit = pixel_size(layer.scale.tolist(), layer.units)
    assert unit == expected[1]
    assert size == (pytest.approx(expected[0][0:2]) if expected[0] else None)


def test_micrometres_have_the_micro_sign_also_where_pint_writes_a_greek_letter() -> None:
    newest = pint.UnitRegistry()
    newest.define("micro- = 1e-6 = \u03bc- = u-")
    assert f"{newest.Unit('um'):~P}" == "\u03bcm"
    assert pixel_size([0.5, 2.0], [newest.Unit("um")] * 2) == ((0.5, 2.0), "\u00b5m")


@pytest.mark.slow
@pytest.mark.window
def test_sketches_drawn_on_a_turned_image_land_under_the_mouse(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine
) -> None:
    place = {
        "scale": (3.0, 0.5, 2.0),
        "translate": (1, 2, 3),
        "rotate": 20.0,
        "units": ("s", "um", "um"),
        "axis_labels": ("time", "y", "x"),
    }
    image = viewer.add_image(np.random.default_rng(1).random((4, 90, 60)), name="film", **place)
    viewer.dims.set_point(0, image.data_to_world((2, 0, 0))[0])
    fit_view(viewer)
    click(dock.draw)
    sketches = viewer.layers["film sketches"]
    assert isinstance(sketches, Shapes)
    truth = np.array([[2, 20.0, 10], [2, 70.0, 40]])
    world = [image.data_to_world(point) for point in truth]
    draw(viewer, sketches, world)
    np.testing.assert_allclose(sketches.data[0], truth, atol=2.0)
    refine(dock)
    assert [record.frame for record in dock.controller.records()] == [2]
    for role in ("curves", "outlines", "reconstruction"):
        layer = viewer.layers[f"film {role}"]
        assert layer.units == image.units
        assert layer.axis_labels == image.axis_labels
        np.testing.assert_allclose(layer.data_to_world((2, 5, 9)), image.data_to_world((2, 5, 9)))
    curve = viewer.layers["film curves"].data[0]
    seen = canvas_point(viewer, viewer.layers["film curves"].data_to_world(curve[-1]))
    wanted = canvas_point(viewer, world[-1])
    assert (seen - wanted).manhattanLength() <= 12


@pytest.mark.parametrize(
    ("shape", "labels", "said"),
    [
        ((5,), "zyx", "3"),
        ((2, 5), "tzyx", "0, z 3"),
        ((5, 2), "ztyx", "1, z 1"),
        ((2, 5), None, "0, plane 3"),
        ((4, 1), "tzyx", "3"),
        ((1, 5), "tzyx", "3"),
        ((1, 5), None, "3"),
        ((1, 1), "tzyx", "0"),
        ((), "yx", "0"),
    ],
)
def test_a_frame_is_named_by_its_time_and_plane(
    shape: tuple[int, ...], labels: str | None, said: str
) -> None:
    image = Image(np.zeros((*shape, 8, 9)), axis_labels=labels)
    assert times_of(image).place(3) == said
    assert times_of(None).place(3) == "3"


def test_an_image_that_is_linked_with_its_reconstruction_stays(qapp: Any, fake: FakeEngine) -> None:
    with bench() as at:
        image, lines = at.image((2100, 2100)), np.array([[20.0, 20], [20, 60]])
        sketches = at.sketches([lines + 1900])
        at.refine()
        at.viewer.layers.link_layers(list(at.viewer.layers))
        sketches.add_paths([lines + 300])
        at.refine()
        until(lambda: at.viewer.layers["sketches reconstruction"].translate[0] < 1000)
        QTest.qWait(300)  # for what follows the image
        assert image.translate.tolist() == [0, 0]
