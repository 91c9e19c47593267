"""All bodies of a scene: which are fitted again, and with what beside them."""

import numpy as np
import pytest
from scipy import ndimage

from napari_splinesketch import refine
from napari_splinesketch.engine import spline
from napari_splinesketch.engine.fit import fit_scene, fitting
from napari_splinesketch.engine.look import scene
from napari_splinesketch.engine.settings import Settings

LINES = [
    np.array([[40.0, 20.0], [40.0, 120.0]]),
    np.array([[25.0, 70.0], [155.0, 70.0]]),  # crosses the first and the third
    np.array([[140.0, 20.0], [140.0, 120.0]]),
    np.array([[20.0, 190.0], [160.0, 190.0]]),  # touches none
]


def image_of(lines: list[np.ndarray]) -> np.ndarray:
    rows, columns = np.indices((180, 220))
    image = 0.03 * np.random.default_rng(0).normal(size=rows.shape)
    for (top, left), (bottom, right) in lines:
        near = np.hypot(
            np.maximum(np.maximum(top - rows, rows - bottom), 0),
            np.maximum(np.maximum(left - columns, columns - right), 0),
        )
        image = np.maximum(image, np.clip(3.5 - near, 0, 1))
    return image


def fitted(monkeypatch, again: int | None):
    """The bodies, and what was asked of `fit_curves`; the sketch `again` is fitted again."""
    calls, plain = [], fitting.fit_curves

    def fit_curves(seen, theta, *given, **options):
        calls.append((theta, options))
        return plain(seen, theta, *given, **options)

    def ended(body, start):
        mine = again is not None and start.sketch is sketches[again]
        return body.points(256) if mine else None

    monkeypatch.setattr(fitting, "fit_curves", fit_curves)
    monkeypatch.setattr(fit_scene, "_ended", ended)
    monkeypatch.setattr(fit_scene, "_strayed", lambda *_: False)
    sketches = [line + 1.0 for line in LINES]
    ((_, seen),) = scene.read_scenes(image_of(LINES), sketches, "bright", 3.0)
    found = fit_scene.fit_scene(seen, sketches, (), Settings(), silent)
    return found.bodies, calls


@pytest.mark.parametrize(("again", "with_it"), [(0, {0, 1}), (1, {0, 1, 2}), (3, {3})])
def test_only_what_touches_a_curve_moves_when_it_is_fitted_again(monkeypatch, again, with_it):
    first, (only,) = fitted(monkeypatch, None)
    assert len(only[0]) == 4
    second, calls = fitted(monkeypatch, again)
    assert sorted({0, 1, 2, 3}.difference(calls[1][1]["known"])) == [again]
    for i, (a, b) in enumerate(zip(first, second, strict=True)):
        if i not in with_it:
            np.testing.assert_allclose(a.theta, b.theta, atol=1e-4)
        assert spline.apart(a.points(), b.points(512)).max() < 1.0


def silent(stage: str, fraction: float, centrelines: object = None) -> None:
    pass


@pytest.mark.parametrize("seed", range(3))
def test_a_curve_does_not_widen_into_what_lies_at_its_ends(seed):
    thick = [np.array([[5.0, column], [85.0, column]]) for column in (17.0, 103.0)]
    line = np.array([[45.0, 20.0], [45.0, 100.0]])
    rows, columns = np.mgrid[:90, :120].astype(float)

    def body(ends, half_width):
        off = np.abs(np.array([rows, columns]) - ends.mean(0)[:, None, None])
        near = np.hypot(*np.maximum(off - np.ptp(ends, axis=0)[:, None, None] / 2, 0))
        return near < half_width

    there = body(line, 2.0) | body(thick[0], 5.0) | body(thick[1], 5.0)
    image = ndimage.gaussian_filter(there.astype(float), 0.7)
    image += 0.03 * np.random.default_rng(seed).normal(size=rows.shape)
    curve = refine(image, [spline.resample(line, 6)]).curves[0]
    assert curve.half_width.max() < 2 * np.median(curve.half_width)
