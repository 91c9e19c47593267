"""Standard errors: noise averages out, what hangs together does not; clicks are measurements."""

import numpy as np
import pytest
from scipy import ndimage

from napari_splinesketch import refine, synthetic
from napari_splinesketch.engine import constants, spline
from napari_splinesketch.engine.fit import fitting
from napari_splinesketch.engine.fit.fit_scene import fit_scene
from napari_splinesketch.engine.fit.fitting import Body
from napari_splinesketch.engine.fit.tube import GLOBALS, INDEX
from napari_splinesketch.engine.judge import position
from napari_splinesketch.engine.judge.position import unexplained
from napari_splinesketch.engine.look.ridges import Ridges
from napari_splinesketch.engine.look.scene import Scene, read_scenes
from napari_splinesketch.engine.settings import Settings

SHAPE = (90, 120)
U = np.linspace(0, 1, 100)


def seen(noise: float, half_width: float = 3.0) -> Scene:
    blank = np.zeros(SHAPE)
    return Scene(
        blank, blank == 0, "constant", 1.0, noise, 0.9, half_width, Ridges(blank, noise), (), ()
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


def errors(body: Body, noise: float, residual: np.ndarray, others=None) -> np.ndarray:
    known = position.covariance(body, unexplained(seen(noise), residual), others)
    return position.normal_sd(known, body.knots, U)


def test_noise_as_assumed_leaves_the_error_as_it_is(body):
    found = errors(body, 0.1, np.random.default_rng(1).normal(0, 0.1, SHAPE))
    plain = position.normal_sd(body.covariance[:16, :16], body.knots, U)
    middle = slice(20, 80)
    np.testing.assert_allclose(found[middle], constants.SD_EVERYWHERE * plain[middle], rtol=0.4)


def test_residuals_that_hang_together_count_for_more(body):
    white = np.random.default_rng(2).normal(0, 0.3, SHAPE)
    smooth = ndimage.gaussian_filter(white, 2.0)
    smooth *= white.std() / smooth.std()
    found = [errors(body, 0.3, residual) for residual in (white, smooth)]
    assert np.median(found[1] / found[0]) > 1.8


def test_what_is_not_explained_tells_there_only(body):
    residual = np.random.default_rng(3).normal(0, 0.1, SHAPE)
    residual[40:50, 80:95] += 1.0
    found = errors(body, 0.1, residual)
    assert found[70:84].mean() > 3 * found[20:40].mean()


def test_beside_another_curve_the_error_is_larger(body):
    residual = np.random.default_rng(4).normal(0, 0.1, SHAPE)
    other = np.column_stack([np.full(30, 50.0), np.linspace(40, 60, 30)])
    ratio = errors(body, 0.1, residual, other) / errors(body, 0.1, residual)
    assert ratio.max() == pytest.approx(constants.SD_BESIDE, rel=0.1)
    assert 30 <= 10 + U[ratio.argmax()] * 100 <= 70
    np.testing.assert_allclose(ratio[75:], 1, atol=0.1)


def test_knots_that_slide_along_a_bent_curve_do_not_make_it_uncertain():
    around, at = np.linspace(0, np.pi, 8), np.linspace(0, 1, 8)
    knots = 40 * np.column_stack([np.sin(around), np.cos(around)])
    along = spline.basis(8, at, 1) @ knots
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = along[:, ::-1] * [-1, 1]
    sliding, off = (
        np.concatenate([np.diag(way[:, 0]), np.diag(way[:, 1])]) for way in (along, across)
    )
    assert position.normal_sd(sliding @ sliding.T, knots, U).max() < 1e-6
    np.testing.assert_allclose(position.normal_sd(off @ off.T, knots, at), 1)


KNOTS = np.column_stack([np.full(8, 45.0), np.linspace(10, 110, 8)])
CLICKS = np.column_stack([[45.5, 44.0, 46.0, 50.0, 50.0], np.linspace(10, 110, 5)])


def test_clicks_do_not_move_what_the_image_shows():
    sure = 0.1**2 * np.eye(16)
    knots, known = position.with_sketch(KNOTS, sure, CLICKS, 3.0)
    assert np.abs(knots - KNOTS).max() < 0.05
    np.testing.assert_allclose(known, sure, atol=0.01**2)


def test_clicks_lead_where_the_image_shows_nothing():
    sd = np.tile([0.1, 0.1, 0.1, 0.1, 50, 50, 50, 50], 2)
    knots, known = position.with_sketch(KNOTS, np.diag(sd**2), CLICKS, 3.0)
    assert np.abs(knots[:3] - KNOTS[:3]).max() < 0.2
    np.testing.assert_allclose(knots[[5, 7], 0], 50.0, atol=1.5)
    clicked = np.array([0.75, 1.0])
    before, after = (position.normal_sd(c, KNOTS, clicked) for c in (np.diag(sd**2), known))
    assert (after < 0.2 * before).all()


def test_a_sketch_that_misses_the_curve_at_most_vertices_says_nothing():
    known = 4.0**2 * np.eye(16)
    knots, after = position.with_sketch(KNOTS, known, CLICKS + np.array([8.0, 0.0]), 3.0)
    assert knots is KNOTS
    assert after is known


def test_clicks_that_would_fold_the_curve_say_nothing(monkeypatch):
    """As where an end is hardly known, and its click lies beside the curve."""
    sd = np.tile(np.r_[np.full(6, 2.0), 40.0, 40.0], 2)
    careless = np.array([1.0, 1.0, 1.0, 8.0, 8.0])[:, None]
    told = {True: 0, False: 0}
    for seed in range(40):
        clicks = CLICKS + careless * np.random.default_rng(seed).normal(size=CLICKS.shape)
        knots, _ = position.with_sketch(KNOTS, np.diag(sd**2), clicks, 8.0)
        with monkeypatch.context() as without:
            without.setattr(constants, "FOLD_RAD", np.inf)
            led, _ = position.with_sketch(KNOTS, np.diag(sd**2), clicks, 8.0)
        turn = spline.sharpest_turn(spline.sample(led, 400), 8.0)
        if abs(turn - constants.FOLD_RAD) > 0.2:
            folds = turn > constants.FOLD_RAD
            assert (knots is KNOTS) == folds, seed
            told[folds] += 1
    assert told[True] > 1
    assert told[False] > 20


def test_a_click_says_where_an_unseen_end_is():
    sd = np.r_[np.full(14, 0.1), 30, 30]
    longer = np.column_stack([np.full(5, 45.0), np.linspace(10, 122, 5)])
    knots, _ = position.with_sketch(KNOTS, np.diag(sd**2), longer, 3.0)
    assert knots[-1, 1] == pytest.approx(122, abs=3)


@pytest.mark.parametrize("seed", range(4))
def test_knots_do_not_slide_along_the_curve(seed):
    """Where they are along the curve is hardly known, and may hang together with what is across."""
    rng = np.random.default_rng(seed)
    loose = rng.normal(0, 20, (2 * len(KNOTS), 2 * len(KNOTS)))
    knots, _ = position.with_sketch(KNOTS, loose @ loose.T / 16, CLICKS, 3.0)
    assert np.diff(knots[:, 1]).min() > 0.9 * np.diff(KNOTS[:, 1]).mean()


def test_a_body_that_a_click_moves_is_drawn_there():
    made = synthetic.scene(3, bodies=1, shape=SHAPE, length=80)
    scene = read_scenes(made.image, [made.centrelines[0][::20]], "auto", None)[0][1]
    found = fit_scene(
        scene,
        [made.centrelines[0][::20]],
        [],
        Settings(),
        lambda stage, fraction, centrelines=None: None,
    )
    body = found.bodies[0]
    there = fitting.moved(found.seen, body, body.knots + np.array([5.0, 0.0]))
    same = fitting.moved(found.seen, body, body.knots)
    picture = np.zeros(SHAPE)
    picture.flat[body.pixels] = body.own
    shifted = np.zeros(SHAPE)
    shifted.flat[there.pixels] = there.own
    assert same.own is body.own
    np.testing.assert_allclose(shifted[10:80], picture[5:75], atol=0.02)


def test_textured_bodies_are_less_certain():
    looks = {"plain": {}, "textured": {"texture": 0.2, "shading": 0.2}}
    sd = {}
    for name, look in looks.items():
        made = synthetic.scene(3, bodies=1, shape=SHAPE, length=80, **look)
        curve = refine(made.image, [c[::20] for c in made.centrelines], "fast").curves[0]
        sd[name] = np.median(curve.sd)
    assert sd["textured"] > 1.3 * sd["plain"]


def test_clicks_never_make_a_curve_less_certain(monkeypatch):
    """They turn these, whose points slide along them by more than they may be off across them."""
    fitted, errors = [], []
    with_sketch, normal_sd = position.with_sketch, position.normal_sd

    def clicks(knots, known, *rest):
        fitted.append((known, knots))
        return with_sketch(knots, known, *rest)

    def of(known, knots, u):
        before, there = fitted[-1]
        errors.append((normal_sd(known, knots, u), normal_sd(before, there, u)))
        return errors[-1][0]

    monkeypatch.setattr(position, "with_sketch", clicks)
    monkeypatch.setattr(position, "normal_sd", of)
    for seed in (65, 82, 118):
        made = synthetic.scene(seed, bodies=1, length=70, bend=1.0)
        rng = np.random.default_rng(seed)
        texture = ndimage.gaussian_filter(rng.normal(size=made.image.shape), 2.5)
        image = made.image + 0.6 * np.ptp(made.image) * texture / texture.std()
        (line,) = made.centrelines
        clicked = line[:: len(line) // 5]
        refine(image, [clicked + rng.normal(0, 1.0, clicked.shape)])
    assert len(errors) == 3
    assert all((told < untold + 1e-6).all() for told, untold in errors)
    assert np.median([told.max() / untold.max() for told, untold in errors]) < 0.7
