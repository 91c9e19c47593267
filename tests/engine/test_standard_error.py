"""Standard errors: noise averages out, what hangs together does not."""

import numpy as np
import pytest
from scipy import ndimage

from napari_splinesketch import refine, synthetic
from napari_splinesketch.engine import constants, spline
from napari_splinesketch.engine.fit.fitting import Body
from napari_splinesketch.engine.fit.tube import GLOBALS, INDEX
from napari_splinesketch.engine.judge import standard_error as module
from napari_splinesketch.engine.judge.standard_error import (
    standard_error,
    unexplained,
)
from napari_splinesketch.engine.look.ridges import Ridges
from napari_splinesketch.engine.look.scene import Scene

SHAPE = (90, 120)
U = np.linspace(0, 1, 100)
ALONE = np.zeros(100, bool)


def seen(noise: float, half_width: float = 3.0) -> Scene:
    blank = np.zeros(SHAPE)
    return Scene(
        blank, blank == 0, "constant", 1.0, noise, 0.9, half_width, Ridges(blank, noise), ()
    )


@pytest.fixture(scope="module")
def body() -> Body:
    knots = np.column_stack([np.full(8, 45.0), np.linspace(10, 110, 8)])
    look = np.zeros(len(GLOBALS))
    look[INDEX["log_width_0"]] = np.log(3.0)
    rows = np.abs(np.arange(SHAPE[0]) - 45) < 7
    pixels = np.flatnonzero(rows[:, None] & np.ones(SHAPE, bool))
    theta = np.concatenate([knots.T.ravel(), look])
    return Body(theta, pixels, np.ones(len(pixels)), 0.0, 100 * np.eye(len(theta)))


@pytest.mark.parametrize("half_width", [0.7, 3.0, 8.0])
def test_white_noise_is_one_wherever_it_is_averaged(half_width):
    noise = np.random.default_rng(0).normal(0, 0.2, (200, 210))
    assert unexplained(seen(0.2, half_width), noise).std() == pytest.approx(1.0, rel=0.1)


def test_noise_as_assumed_leaves_the_error_as_it_is(body):
    residual = np.random.default_rng(1).normal(0, 0.1, SHAPE)
    found = standard_error(body, U, unexplained(seen(0.1), residual), ALONE)
    plain = module.normal_sd(body.covariance, body.knots, U)
    middle = slice(20, 80)
    np.testing.assert_allclose(found[middle], constants.SD_EVERYWHERE * plain[middle], rtol=0.4)


def test_residuals_that_hang_together_count_for_more(body):
    white = np.random.default_rng(2).normal(0, 0.3, SHAPE)
    smooth = ndimage.gaussian_filter(white, 2.0)
    smooth *= white.std() / smooth.std()
    errors = [standard_error(body, U, unexplained(seen(0.3), r), ALONE) for r in (white, smooth)]
    assert np.median(errors[1] / errors[0]) > 1.8


def test_what_is_not_explained_tells_there_only(body):
    residual = np.random.default_rng(3).normal(0, 0.1, SHAPE)
    residual[40:50, 80:95] += 1.0
    found = standard_error(body, U, unexplained(seen(0.1), residual), ALONE)
    assert found[70:84].mean() > 3 * found[20:40].mean()


def test_beside_another_curve_the_error_is_larger(body):
    residual = np.random.default_rng(4).normal(0, 0.1, SHAPE)
    points = np.column_stack([np.full(100, 45.0), np.linspace(10, 110, 100)])
    other = np.column_stack([np.full(30, 50.0), np.linspace(40, 60, 30)])
    near = spline.apart(points, other) < constants.BESIDE_HW * 3.0
    assert near[30:50].all()
    assert not near[:20].any()
    assert not near[60:].any()
    scaled = [standard_error(body, U, unexplained(seen(0.1), residual), n) for n in (ALONE, near)]
    np.testing.assert_allclose(scaled[1][near], constants.SD_BESIDE * scaled[0][near])
    np.testing.assert_allclose(scaled[1][~near], scaled[0][~near])


def test_textured_bodies_are_less_certain():
    looks = {"plain": {}, "textured": {"texture": 0.2, "shading": 0.2}}
    sd = {}
    for name, look in looks.items():
        made = synthetic.scene(3, bodies=1, shape=SHAPE, length=80, **look)
        curve = refine(made.image, [c[::20] for c in made.centrelines], "fast").curves[0]
        sd[name] = np.median(curve.sd)
    assert sd["textured"] > 1.3 * sd["plain"]
