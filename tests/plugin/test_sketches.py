"""Which shapes are sketches, and of which frame."""

from typing import Any

import numpy as np
import pytest
from napari.components import ViewerModel

from napari_splinesketch.plugin.layers.drawn import (
    begin_drawing,
    clicked,
    drawn_in,
    new_sketch_layer,
    selected_in,
)


def test_lines_and_paths_serve_in_the_layers_order() -> None:
    viewer: Any = ViewerModel()
    image = viewer.add_image(np.zeros((60, 80)))
    free = np.column_stack([np.linspace(5, 50, 30), 30 + 5 * np.sin(np.arange(30))])
    shapes = viewer.add_shapes(
        [[[1, 1], [9, 9]], [[0, 0], [20, 30]], free, [[0, 0], [5, 9], [9, 0]]],
        shape_type=["rectangle", "line", "path", "polygon"],
    )
    drawn = drawn_in(viewer, shapes, image, 0)
    assert drawn.numbers == (1, 2)
    np.testing.assert_allclose(drawn.lines[1], free, atol=1e-5)
    assert drawn.unusable == {"rectangle": 1, "polygon": 1}


def test_a_stray_click_is_counted_in_pixels_of_the_image() -> None:
    viewer: Any = ViewerModel()
    image = viewer.add_image(np.zeros((60, 80)), scale=(0.01, 0.01))
    shapes = viewer.add_shapes(
        [[[0, 0], [0.1, 0.1]], [[0, 0], [0.005, 0.01]], [[0.3, 0.3], [0.3, 0.3]]],
        shape_type="path",
    )
    drawn = drawn_in(viewer, shapes, image, 0)
    assert (drawn.numbers, drawn.strays) == ((0,), 2)


def test_frames_are_kept_apart_and_flat_sketches_belong_to_all() -> None:
    viewer: Any = ViewerModel()
    image = viewer.add_image(np.zeros((4, 60, 80)))
    lines = [[[t, 1, 1], [t, 9, 9]] for t in (0, 2, 2.3, 3)]
    stack = viewer.add_shapes(lines, shape_type="line")
    assert drawn_in(viewer, stack, image, 2).numbers == (1, 2)
    assert drawn_in(viewer, stack, image, 1).numbers == ()
    flat = viewer.add_shapes([[[1, 1], [9, 9]]], shape_type="line")
    for frame in (0, 3):
        viewer.dims.set_point(0, frame)
        assert drawn_in(viewer, flat, image, frame).numbers == (0,)


def test_a_stack_of_sketches_on_a_flat_image_counts_where_it_is_in_view() -> None:
    viewer: Any = ViewerModel()
    image = viewer.add_image(np.zeros((60, 80)))
    lines = [[[t, 1, 1], [t, 9, 9]] for t in (0, 2, 3)]
    stack = viewer.add_shapes(lines, shape_type="line")
    viewer.dims.set_point(0, 2)
    assert drawn_in(viewer, stack, image, 0).numbers == (1,)


@pytest.mark.parametrize(("mode", "expected"), [("select", {1}), ("direct", {1}), ("add_line", ())])
def test_only_a_selection_that_is_shown_counts(mode: str, expected: set[int]) -> None:
    viewer: Any = ViewerModel()
    shapes = viewer.add_shapes([[[1, 1], [9, 9]]] * 2, shape_type="line")
    shapes.mode = mode
    shapes.selected_data = {1}
    assert selected_in(shapes) == frozenset(expected)


def test_a_new_layer_lies_on_the_image() -> None:
    viewer: Any = ViewerModel()
    image = viewer.add_image(
        np.zeros((3, 6, 8)),
        name="film",
        scale=(1, 0.5, 2),
        translate=(0, 3, 4),
        rotate=15.0,
        shear=(0.1, 0, 0.2),
        units=("s", "um", "um"),
        axis_labels=("t", "y", "x"),
    )
    layer = new_sketch_layer(viewer, image)
    assert layer.name == "film sketches"
    assert layer.mode == "add_line"
    assert (layer.units, layer.axis_labels) == (image.units, image.axis_labels)
    for point in ((0, 0, 0), (2, 3, 5)):
        np.testing.assert_allclose(layer.data_to_world(point), image.data_to_world(point))
    layer.add([[2, 0, 0], [2, 5, 5]], shape_type="line")
    assert drawn_in(viewer, layer, image, 2).numbers == (0,)


def test_lines_are_drawn_over_images_that_were_opened_later() -> None:
    viewer: Any = ViewerModel()
    viewer.add_shapes(name="outlines")
    lines = viewer.add_shapes(name="lines", visible=False)
    image = viewer.add_image(np.zeros((6, 8)), name="image")
    viewer.add_image(np.zeros((6, 8)), name="model")
    viewer.add_points(name="points")
    begin_drawing(lines, viewer, image)
    names = [layer.name for layer in viewer.layers]
    assert names == ["outlines", "image", "model", "lines", "points"]
    assert lines.visible
    assert viewer.layers.selection.active is lines
    viewer.layers.move(viewer.layers.index(lines), viewer.layers.index(image) + 1)
    before = list(viewer.layers)
    begin_drawing(lines, viewer, image)
    assert list(viewer.layers) == before, "over its image, the user may put it where she likes"


@pytest.mark.parametrize("sizes", [(1, 1), (2, 1), (1, 3), (0.1, 0.5)])
def test_a_click_is_told_from_a_line_whatever_the_size_of_a_pixel(
    sizes: tuple[float, float],
) -> None:
    viewer: Any = ViewerModel()
    viewer.add_image(np.zeros((64, 96)), scale=sizes)
    layer = viewer.add_shapes(ndim=2, scale=sizes)
    layer.mode = "add_line"
    viewer.scene.camera.zoom = 3.0
    # napari's line of a click: 2.5 px of the screen, measured along the last axis.
    apart = 2.5 / (3.0 * sizes[1])
    layer.add([[30, 40], [30 + apart, 40 + apart]], shape_type="line")
    assert clicked(viewer, layer)
    layer.add([[30, 40], [30 + 4 * apart, 40 + 4 * apart]], shape_type="line")
    assert not clicked(viewer, layer), "a line of 10 px of the screen"
