"""The whole path with the real engine: draw, refine, export, compare with the truth."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from perturbations import displace

from napari_splinesketch.labels import read_labels
from napari_splinesketch.metrics import average_dtw
from napari_splinesketch.plugin import engine
from napari_splinesketch.plugin.dock import SplinesketchDock
from napari_splinesketch.synthetic import rotate, scene

from .hand import (
    QTest,
    add_dock,
    assert_drawn,
    click,
    draw,
    fit_view,
    outlines,
    refine,
    rest,
    until,
)

PLACE = {"scale": (1, 0.4, 0.8), "translate": (0, 5, -7), "units": ("s", "um", "um")}


@pytest.fixture
def real(viewer: Any, monkeypatch: pytest.MonkeyPatch) -> SplinesketchDock:
    """The dock with the real engine, which compiles when it is first used."""
    monkeypatch.setattr(engine, "warm_up", lambda report: None)
    return add_dock(viewer)


def distances(lines: Any, truth: Any) -> list[float]:
    """Average DTW of each line from its truth, px."""
    return [average_dtw(line, body) for line, body in zip(lines, truth, strict=True)]


@pytest.mark.window(shown=True)
def test_lines_drawn_with_the_mouse_become_the_bodies(
    viewer: Any, real: SplinesketchDock, tmp_path: Path
) -> None:
    frames = [scene(seed, bodies=2, shape=(128, 160)) for seed in (1, 2)]
    film = np.stack([made.image for made in frames])
    image = viewer.add_image(film, name="film", **PLACE)
    viewer.dims.set_point(0, 1)
    fit_view(viewer)
    click(real.draw)
    sketches = viewer.layers["film sketches"]
    truth = frames[1].centrelines
    for body in truth:
        rough = rotate(displace(body, 3, 45), 8)[[0, 33, 66, 99]]
        draw(viewer, sketches, [image.data_to_world((1, *point))[1:] for point in rough])
    assert real.refine.text() == "Refine 2 new lines"
    before = [
        average_dtw(line[:, 1:], body) for line, body in zip(sketches.data, truth, strict=True)
    ]
    refine(real)
    assert "Refining failed" not in real.notice.text()
    real.controller.export(tmp_path / "out.csv")
    rest(real)
    labels = read_labels(tmp_path / "out.csv")
    assert (labels.scale, labels.units) == ((0.4, 0.8), "µm")
    assert [label.frame for label in labels.labels] == [1, 1]
    curves = viewer.layers["film curves"]
    after = [
        average_dtw(label.points, body) for label, body in zip(labels.labels, truth, strict=True)
    ]
    assert min(before) > 1.5
    assert max(after) < 1.0
    for label, curve, body in zip(labels.labels, curves.data, truth, strict=True):
        assert_drawn(curve[:, 1:], label.points)
        there = np.array([curves.data_to_world(point)[1:] for point in curve])
        wanted = np.array([image.data_to_world((1, *point))[1:] for point in body])
        assert average_dtw(there, wanted) < 0.8 * 1.0
    widths = [np.median(label.half_width) for label in labels.labels]
    # Widths are the weakest of what is measured: docs/limits.md.
    np.testing.assert_allclose(widths, [w.max() for w in frames[1].half_widths], rtol=0.6)
    model = viewer.layers["film reconstruction"].data[1]
    clean = frames[1].clean
    assert 1 - np.var(clean - model) / np.var(clean) > 0.8


def test_cancel_while_it_really_runs(viewer: Any, real: SplinesketchDock) -> None:
    made = scene(5, bodies=3, shape=(160, 160))
    viewer.add_image(made.image, name="x")
    viewer.add_shapes([line[[0, 50, 99]] for line in made.centrelines], shape_type="path")
    click(real.refine)
    until(lambda: real.controller.progress and real.controller.progress.fraction > 0)
    click(real.cancel)
    assert real.refine.isEnabled()
    QTest.qWait(500)
    assert len(viewer.layers) == 2
    refine(real)
    assert len(real.controller.records()) == 3


def test_a_sketch_beside_the_image_fails_alone(viewer: Any, real: SplinesketchDock) -> None:
    made = scene(3, bodies=1)
    viewer.add_image(made.image, name="x")
    lines = [made.centrelines[0][[0, 30, 60, 99]], np.array([[-60.0, -60], [-30, -20]])]
    viewer.add_shapes(lines, shape_type="path", name="x sketches")
    refine(real)
    first, second = (record.curve for record in real.controller.records())
    assert average_dtw(first.points, made.centrelines[0]) < 0.8
    assert second.status == "failed"
    assert "1 failed" in real.results.text()
    assert len(outlines(viewer.layers["x outlines"])) == 1
    np.testing.assert_allclose(viewer.layers["x curves"].data[1][[0, -1]], lines[1], atol=1e-4)
