"""The three phases on generated frames, which are not drawn by the model that is fitted."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import perturbations
import pytest

from napari_splinesketch import refine, synthetic
from napari_splinesketch.engine import spline
from napari_splinesketch.engine.types import CANCELLED, Curve, Progress
from napari_splinesketch.metrics import average_dtw
from napari_splinesketch.paper import phases, result
from napari_splinesketch.paper.blobs import spline_knots
from napari_splinesketch.paper.fit import draw
from napari_splinesketch.paper.phases import PaperFit, PaperSettings

SETTINGS = PaperSettings(splines_steps=150, everything_steps=20, seeds=1)
HALF_WIDTH = 3.0
SHAPE = (110, 128)


@pytest.fixture(autouse=True)
def strict_ranks():
    with jax.numpy_rank_promotion("raise"):
        yield


def frame(seed: int, bodies: int = 1, shape: tuple[int, int] = SHAPE, **look):
    """A generated scene, and its image with background 0 and contrast 1."""
    scene = synthetic.scene(seed, bodies=bodies, shape=shape, length=80, **look)
    sign = 1 if scene.look.polarity == "bright" else -1
    normal = sign * (scene.image - np.median(scene.image)) / scene.look.contrast
    return scene, normal.astype(np.float32)


def fit(image, sketches, *, seed=0, report=lambda *_: None, settings=SETTINGS) -> PaperFit:
    return phases.refine_paper(
        image, list(sketches), half_width=HALF_WIDTH, seed=seed, report=report, settings=settings
    )


def points(found: PaperFit) -> list[np.ndarray]:
    return [spline.sample(knots, 100)[:, :2] for knots in found.knots]


PERTURBATIONS = {
    "rotated": lambda c, seed: synthetic.rotate(c, 20 * (-1) ** seed),
    "displaced": lambda c, seed: perturbations.displace(c, 10, 70 * seed),
    "shrunk": lambda c, seed: perturbations.scale(c, 0.7),
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", PERTURBATIONS)
def test_one_body_is_found_from_a_spoilt_label(kind) -> None:
    before, after = [], []
    for seed in range(3):
        scene, image = frame(seed)
        sketch = PERTURBATIONS[kind](scene.centrelines[0], seed)
        before.append(average_dtw(sketch, scene.centrelines[0]))
        after.append(average_dtw(points(fit(image, [sketch]))[0], scene.centrelines[0]))
    assert np.median(before) > 2
    assert np.median(after) < 0.6


def test_ends_that_were_drawn_outside_of_the_image_come_back() -> None:
    scene, image = frame(0)
    sketch = perturbations.scale(scene.centrelines[0], 1.7)
    assert (sketch[:, 0] > SHAPE[0]).any() and (sketch < 0).any()
    found = fit(image, [sketch])
    assert (found.knots[0, :, :2] >= 0).all() and (found.knots[0, :, :2] < SHAPE).all()
    assert average_dtw(points(found)[0], scene.centrelines[0]) < 0.6


@pytest.fixture(scope="module")
def crossing():
    scene, image = frame(4, bodies=2)
    sketches = [perturbations.displace(c, 4, 45) for c in scene.centrelines]
    return scene, image, sketches, fit(image, sketches)


def test_every_phase_lowers_the_loss(crossing) -> None:
    losses = crossing[-1].losses
    assert {name: len(loss) for name, loss in losses.items()} == {
        "background": 100,
        "splines": 150,
        "everything": 20,
    }
    for loss in losses.values():
        assert np.isfinite(loss).all()
        assert loss.min() < loss[0]
    assert losses["splines"][0] <= losses["background"][0]
    assert losses["everything"][0] == pytest.approx(losses["splines"].min(), rel=1e-4)


def test_only_the_last_phase_trains_blob_and_kernel(crossing) -> None:
    _, image, sketches, last = crossing
    start = phases.prepare(image, sketches, [], half_width=HALF_WIDTH, knots=12, spacing=0.6)[0]
    earlier = fit(image, sketches, settings=replace(SETTINGS, everything_steps=0)).scene
    first = fit(image, sketches, settings=replace(SETTINGS, everything_steps=0, splines_steps=0))
    moved = {
        name: [
            not np.array_equal(getattr(scene, name), getattr(start, name))
            for scene in (first.scene, earlier, last.scene)
        ]
        for name in start._fields
    }
    for name, when in moved.items():
        if name in ("brightness", "gradient", "log_contrast"):
            assert when == [True, True, True], name
        elif name in ("profile", "kernel"):
            assert when == [False, False, True], name
        else:
            assert when == [False, True, True], name


def test_reconstruction_background_and_bodies_agree(crossing) -> None:
    scene, image, _, found = crossing
    assert found.reconstruction.shape == found.background.shape == SHAPE
    assert found.score == pytest.approx(np.mean((image - found.reconstruction) ** 2), rel=1e-4)
    assert found.score < 0.5 * np.mean((image - found.background) ** 2)
    bodies = phases.render_bodies(found)
    assert bodies.shape == (2, *SHAPE)
    expected = found.alpha * bodies.max(0) + (1 - found.alpha) * bodies.sum(0)
    apart = bodies.min(0) < 1e-6
    drawn = found.reconstruction - found.background
    np.testing.assert_allclose(drawn[apart], expected[apart], atol=0.05)
    for body, line in zip(bodies, scene.centrelines, strict=True):
        row, col = np.round(line).astype(int).T
        assert np.median(body[row, col]) > 5 * np.median(body)


def test_fixed_curves_are_drawn_and_do_not_move(crossing) -> None:
    scene, image, sketches, _ = crossing
    still = np.column_stack([scene.centrelines[1], scene.half_widths[1]])
    still = spline.fit_knots(still, 12)
    found = phases.refine_paper(
        image,
        sketches[:1],
        half_width=HALF_WIDTH,
        seed=0,
        report=lambda *_: None,
        fixed=[still],
        settings=SETTINGS,
    )
    assert len(found.knots) == 1
    assert average_dtw(points(found)[0], scene.centrelines[0]) < 0.8
    kept = np.asarray(spline_knots(found.scene, found.place))[1]
    np.testing.assert_allclose(kept[:, :2], still[:, :2], atol=0.2)
    row, col = np.round(scene.centrelines[1][10:-10]).astype(int).T
    drawn = found.reconstruction - found.background
    assert np.median(drawn[row, col]) > 0.5 and len(phases.render_bodies(found)) == 1


def test_the_preset_draws_fixed_curves_where_they_are(
    crossing, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(result, "refine_paper", partial(result.refine_paper, settings=SETTINGS))
    scene, _, sketches, _ = crossing
    line, width = scene.centrelines[1], scene.half_widths[1]
    knots = spline.fit_knots(np.column_stack([line, width]), 12)
    still = Curve(knots, line, width, np.zeros(100), "good", (), 0.0)
    found = refine(scene.image, sketches[:1], "paper", fixed=[still])
    assert len(found.curves) == 1
    assert average_dtw(found.curves[0].points, scene.centrelines[0]) < 0.8
    assert found.model.overlap is not None
    row, col = np.round(still.points[15:-15]).astype(int).T
    drawn = (found.reconstruction - found.background)[row, col] / found.model.contrast
    assert np.abs(np.median(drawn)) > 0.7


def test_fixed_curves_wider_than_the_rest_are_drawn_as_wide() -> None:
    line = np.column_stack([np.full(30, 40.0), np.linspace(20.0, 90.0, 30)])
    wide = np.column_stack([line, np.full(30, 2.5 * HALF_WIDTH)])
    scene, place, _, canvas = phases.prepare(
        np.zeros(SHAPE),
        [line + np.array([30, 0])],
        [wide],
        half_width=HALF_WIDTH,
        knots=8,
        spacing=0.6,
    )
    drawn = np.asarray(draw(scene, place, canvas)[0])[:, 55]
    for middle, width in ((70, HALF_WIDTH), (40, 2.5 * HALF_WIDTH)):
        column = drawn[middle - 15 : middle + 16]
        assert (column > column.max() / 2).sum() == pytest.approx(2 * width, rel=0.2)


def test_half_widths_are_those_of_the_bodies(crossing) -> None:
    scene, _, _, found = crossing
    for knots, truth in zip(found.knots, scene.half_widths, strict=True):
        assert knots[2:-2, 2].mean() == pytest.approx(truth[25:75].mean(), rel=0.15)


def test_of_several_seeds_the_best_reconstruction_is_kept(crossing) -> None:
    _, image, sketches, _ = crossing
    short = replace(SETTINGS, splines_steps=40, everything_steps=0)
    alone = [fit(image, sketches, seed=s, settings=short).losses["splines"].min() for s in range(3)]
    assert len(set(alone)) == 3
    together = fit(image, sketches, settings=replace(short, seeds=3)).losses["splines"].min()
    assert together == min(alone)


def test_the_seed_decides(crossing) -> None:
    _, image, sketches, found = crossing
    np.testing.assert_array_equal(fit(image, sketches).knots, found.knots)
    assert not np.array_equal(fit(image, sketches, seed=7).knots, found.knots)


def test_other_sketches_sizes_and_settings_do_not_compile(crossing) -> None:
    _, image, sketches, _ = crossing
    fit(image, sketches)  # the fixture may have been made under other settings of JAX
    before = compiled()
    other = PaperSettings(12, 0.7, 20, 30, 10, 1, 2e-2, 1e-3, 0.5, 1.0)
    found = fit(np.pad(image, ((0, 7), (0, 0))), [*sketches, sketches[0] + 3], settings=other)
    assert len(found.knots) == 3
    assert compiled() == before


def test_each_phase_is_compiled_once(crossing) -> None:
    _, image, sketches, _ = crossing
    phases._advance.clear_cache()  # pyright: ignore[reportAttributeAccessIssue]
    fit(image, sketches, settings=PaperSettings(12, 0.7, 20, 30, 10, 1))
    assert compiled() == 3


def compiled() -> int:
    return phases._advance._cache_size()  # pyright: ignore[reportAttributeAccessIssue]


def test_pixels_that_are_not_finite_are_left_out(crossing) -> None:
    _, image, sketches, _ = crossing
    spoilt = image.copy()
    spoilt[:3] = np.nan
    found = fit(spoilt, sketches)
    assert np.isfinite(found.knots).all() and np.isfinite(found.reconstruction).all()
    assert np.isfinite(found.score)


def test_reports_rise_to_one_with_the_curves_as_they_move(crossing) -> None:
    _, image, sketches, _ = crossing
    told: list[tuple[str, float, list[np.ndarray]]] = []
    fit(image, sketches, report=lambda stage, share, lines: told.append((stage, share, lines())))
    fractions = [fraction for _, fraction, _ in told]
    assert fractions == sorted(fractions) and fractions[-1] == pytest.approx(1.0)
    assert len({stage for stage, _, _ in told}) == 3
    assert all([line.shape for line in lines] == [(100, 2)] * 2 for _, _, lines in told)


def test_the_preset_shows_the_curves_and_stops_when_told_to(
    crossing, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(result, "refine_paper", partial(result.refine_paper, settings=SETTINGS))
    scene, _, sketches, _ = crossing
    told: list[Progress] = []

    def stop(progress: Progress) -> bool:
        told.append(progress)
        return progress.fraction < 0.4

    found = refine(scene.image, sketches, "paper", on_progress=stop)
    assert told[-1].fraction >= 0.4 and all(progress.fraction < 0.4 for progress in told[:-1])
    assert [curve.reasons for curve in found.curves] == [(CANCELLED,)] * 2
    shown = next(progress.centrelines for progress in reversed(told) if progress.centrelines)
    for line, truth in zip(shown, scene.centrelines, strict=True):
        assert average_dtw(line, truth) < 5


def test_noise_is_as_large_as_the_gradient_of_its_spline_and_decays() -> None:
    gradient = {"offsets": jnp.array([[[3.0, -4.0]], [[0.0, 0.0]]]), "blend": jnp.array(-2.0)}
    plan = PaperSettings(noise=4.0, noise_decay=1.0).plan("splines")

    @jax.jit
    def drawn(seed, step):
        noisy = phases.relative_noise(gradient, jax.random.key(seed), step, plan)
        return jax.tree.map(jnp.subtract, noisy, gradient)

    for step, expected in ((0, 2.0), (99, 0.2)):
        draws = [jax.tree.map(np.asarray, drawn(seed, step)) for seed in range(300)]
        offsets = np.array([draw["offsets"] for draw in draws])
        blends = np.array([draw["blend"] for draw in draws])
        assert offsets[:, 0].std() == pytest.approx(expected * np.sqrt(12.5), rel=0.15)
        assert blends.std() == pytest.approx(expected * 2.0, rel=0.15)
        assert not offsets[:, 1].any()


@pytest.mark.parametrize("bad", [{"knots": 2}, {"seeds": 0}, {"spacing": 0.0}])
def test_settings_that_cannot_run_are_refused(bad) -> None:
    with pytest.raises(ValueError, match="cannot run: it needs at least 3 knots"):
        PaperSettings(**bad)
