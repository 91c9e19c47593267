"""Suggestions: bodies found by nobody's hand, few lines that are on none."""

import subprocess
import sys
from itertools import pairwise

import numpy as np
import pytest
from scipy import ndimage
from suggested import FOUND, judged, on, worms

from napari_splinesketch import suggest, synthetic
from napari_splinesketch.data import load_sample
from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine.find.suggest import _bodies, prepare
from napari_splinesketch.engine.look.ridges import Ridges
from napari_splinesketch.engine.types import Progress


def test_bodies_are_parts_that_are_large_and_certain_enough() -> None:
    low, high = const.SUGGEST_BODY
    evidence = np.zeros((12, 20), np.float32)
    evidence[1, 1:10] = evidence[3:6, 1:4] = evidence[8, 1:4] = low + 0.01
    evidence[1, 9] = evidence[8, 2] = high + 0.01  # the second is nowhere certain
    evidence[2, 10] = 1.0  # touches the first at a corner only
    expected = np.zeros(evidence.shape, dtype=bool)
    expected[1, 1:10] = True
    np.testing.assert_array_equal(_bodies(evidence, 3.0), expected)
    np.testing.assert_array_equal(_bodies(evidence, 2.9)[8], evidence[8] > 0)
    assert not _bodies(np.zeros((4, 5), np.float32), 0.0).any()


@pytest.fixture(scope="module")
def crowd() -> np.ndarray:
    return load_sample("worms_dense")[0]


@pytest.mark.slow
def test_most_isolated_worms_are_found_and_little_else() -> None:
    row = worms(0.5)
    assert row.found >= 0.8 * row.bodies
    assert row.false <= 0.05 * row.suggested


@pytest.mark.parametrize(
    "change",
    [
        lambda image: 255 - image,
        lambda image: image.astype(np.uint16) * 100,
        lambda image: image / 1000 - 7,
    ],
    ids=["bright", "16 bit", "floats"],
)
def test_it_looks_at_contrast_not_at_numbers(crowd: np.ndarray, change) -> None:
    part = crowd[20:170, 100:340]
    plain, changed = suggest(part), suggest(change(part))
    assert len(plain) > 8
    assert len(on(changed, plain, 1.0)) >= len(plain) - 1


def test_transposed_images_give_transposed_lines(crowd: np.ndarray) -> None:
    part = crowd[20:170, 100:340]
    turned = [line[:, ::-1] for line in suggest(part.T)]
    assert len(on(turned, suggest(part), FOUND)) > 8


@pytest.mark.slow
def test_sensitivity_finds_what_is_faint(crowd: np.ndarray) -> None:
    part, inside = crowd[:256, :256], np.array([[3.0, 3], [252, 252]])
    clear = [
        line
        for line in judged()["isolated"]
        if (line > inside[0]).all() and (line < inside[1]).all()
    ]
    assert len(clear) > 5
    lines = {s: suggest(part, s) for s in (0.0, 0.35, 0.5, 1.0)}
    for s in (0.0, 0.35, 0.5):  # what is clear is in all of them
        assert len(on(lines[s], clear, FOUND)) >= 0.95 * len(clear)
    assert len(lines[0.0]) < len(lines[1.0])


def test_sensitivity_moves_the_threshold() -> None:
    rows = np.arange(120.0)[:, None] + np.zeros(120)
    inside = (np.arange(120) > 20) & (np.arange(120) < 100)
    places = {20: 1.0, 45: 1.0, 70: 1.0, 95: 0.36}
    image = sum(c * (np.abs(rows - r) < 3) * inside for r, c in places.items())
    image = image + np.random.default_rng(0).normal(0, 0.02, (120, 120))
    assert len(suggest(image, 0.5)) == 3
    assert len(suggest(image, 1.0)) == 4


def test_a_higher_sensitivity_keeps_what_a_lower_one_gives(crowd: np.ndarray) -> None:
    prepared = prepare(crowd[:256, :256])
    chosen = [prepared.choose(s) for s in (0.0, 0.5, 1.0)]
    for fewer, more in pairwise(chosen):
        assert {line.tobytes() for line in fewer} <= {line.tobytes() for line in more}


def test_bodies_of_one_image_differ_in_width_and_contrast() -> None:
    rows, inside = np.arange(200.0)[:, None] + np.zeros(200), np.abs(np.arange(200) - 100) < 80
    bodies = {30: (1.5, 0.4), 60: (1.5, 1.0), 100: (5.0, 0.6), 160: (8.0, 1.0)}
    image = sum(c * (np.abs(rows - r) < w) * inside for r, (w, c) in bodies.items())
    image = image + np.random.default_rng(0).normal(0, 0.02, (200, 200))
    truth = [np.array([[r, 20.0], [r, 180]]) for r in bodies]
    assert {k for _, k in on(suggest(image, 1.0), truth, 4.0)} == {0, 1, 2, 3}


def test_crossing_bodies_go_straight_on() -> None:
    rows, cols = np.mgrid[:90, :120].astype(float)
    image = np.zeros((90, 120))
    truth = [np.array([[15.0, 20], [75, 100]]), np.array([[75.0, 25], [15, 95]])]
    for (r0, c0), (r1, c1) in truth:
        along = np.array([r1 - r0, c1 - c0])
        t = np.clip(((rows - r0) * along[0] + (cols - c0) * along[1]) / (along @ along), 0, 1)
        apart = np.hypot(rows - r0 - t * along[0], cols - c0 - t * along[1])
        image = np.maximum(image, np.clip(3.5 - apart, 0, 1))
    image += np.random.default_rng(0).normal(0, 0.03, image.shape)
    found = suggest(image)
    assert len(found) == 2
    assert {k for _, k in on(found, truth, 2.0)} == {0, 1}


def test_bodies_packed_side_by_side_stand_out() -> None:
    rows, columns = np.mgrid[:260, :260] - 130.0
    cos, sin = np.cos(np.deg2rad(20)), np.sin(np.deg2rad(20))
    across, along = rows * cos - columns * sin, rows * sin + columns * cos
    found = total = 0
    for seed in range(6):
        image, truth, rng = np.zeros(rows.shape), [], np.random.default_rng(seed)
        for middle in (-40.5, 40.5):
            for place in 11.0 * np.arange(-4.5, 5):
                beside = np.hypot(across - place, np.clip(np.abs(along - middle) - 32.5, 0, None))
                image = np.maximum(image, rng.uniform(0.7, 1) * np.clip(5.5 - beside, 0, 1))
                ends = middle + np.array([-37.5, 37.5])
                truth.append(130 + np.c_[place * cos + ends * sin, ends * cos - place * sin])
        image = ndimage.gaussian_filter(image, 2.5) + rng.normal(0, 0.02, image.shape)
        found += len({body for _, body in on(suggest(image, polarity="bright"), truth, FOUND)})
        total += len(truth)
    assert found > 0.4 * total, "a quarter, with blocks that lie within a pack"


@pytest.mark.parametrize(
    ("halo", "broad", "given"),
    [(0.5, 2, None), (0.8, 2, None), (1.0, 2, None), (0.6, 6, 7.0), (0.9, 6, 9.0)],
)
def test_halos_of_bodies_are_not_offered(halo: float, broad: float, given: float | None) -> None:
    rows, columns = np.mgrid[:220, :220].astype(float)
    away, half_width = np.full(rows.shape, np.inf), 7.0
    rods = [(50, 60, 0.2), (150, 60, 1.2), (120, 150, 0.7), (60, 160, -0.6)]
    for row, column, angle in rods:
        down, right, sin, cos = rows - row, columns - column, np.sin(angle), np.cos(angle)
        along = np.clip(np.abs(down * sin + right * cos) - 38, 0, None)
        away = np.minimum(away, np.hypot(along, down * cos - right * sin) - half_width)
    image = halo * np.exp(-0.5 * ((away - broad - 2) / broad) ** 2) * (away > 0) - (away < 0)
    image = ndimage.gaussian_filter(image, 1.5)
    image += np.random.default_rng(0).normal(0, 0.05, rows.shape)
    found = suggest(image, half_width=given)
    assert len(found) == len(rods)
    inside = [(away[tuple(np.rint(line).astype(int).T)] < 0).mean() for line in found]
    assert min(inside) >= 0.75


@pytest.mark.parametrize("seed", [2, 6])
def test_lines_of_bodies_in_relief_lie_between_the_bright_and_the_dark_side(seed: int) -> None:
    scene = synthetic.scene(seed, bodies=12, shape=(330, 330), crossing=False)
    down, across = np.gradient(ndimage.gaussian_filter(scene.clean.astype(float), 1.0))
    image = np.asarray(0.6 * down + 0.8 * across)
    image += np.random.default_rng(seed).normal(0, 0.15 * image.std(), image.shape)
    found = suggest(image)
    assert len(on(found, scene.centrelines, 2.0)) >= 6, "without this rule none"
    assert len(found) <= 12, "without it two for each body"
    assert not on(suggest(image, polarity="bright"), scene.centrelines, 2.0)


@pytest.mark.parametrize(
    ("seed", "other", "share"), [(1, 51, 1.0), (2, 52, 1.0), (2, 2, 0.5), (11, 11, 0.5)]
)
def test_bright_and_dark_bodies_and_shadows_are_no_relief(
    seed: int, other: int, share: float
) -> None:
    one, two = (
        synthetic.scene(k, bodies=6, shape=(200, 200), crossing=False) for k in (seed, other)
    )
    shadow = np.roll(two.clean, (4, 3), (0, 1)) if seed == other else two.clean
    noise = np.random.default_rng(seed).normal(0, 0.05 * np.ptp(one.clean), one.clean.shape)
    found = suggest(one.clean - share * shadow + noise)
    assert len(on(found, one.centrelines, 2.0)) >= 4


def test_one_body_alone() -> None:
    made = synthetic.scene(3, bodies=1, shape=(128, 160))
    (line,) = suggest(made.image)
    assert on([line], made.centrelines, 3.0)


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((40, 50)),
        np.full((40, 50), 7, np.uint8),
        np.random.default_rng(0).normal(size=(120, 90)),
        np.ones((1, 1)),
        np.ones((1, 80)),
    ],
    ids=["zero", "constant", "noise", "a pixel", "a row"],
)
def test_nothing_is_found_where_nothing_is(image: np.ndarray) -> None:
    assert suggest(image) == ()


def test_missing_pixels_are_no_bodies() -> None:
    image = np.random.default_rng(0).normal(size=(120, 90))
    image[40:44, 20:80] = np.nan
    assert suggest(image, 1.0) == ()


def test_fill_values_are_missing_pixels() -> None:
    image = synthetic.scene(3, shape=(90, 100), length=60.0).image
    filled, missing = image.copy(), image.copy()
    filled[:, 70:], missing[:, 70:] = np.finfo(np.float32).min, np.nan
    assert len(suggest(filled)) == len(suggest(missing)) > 0
    assert all(map(np.array_equal, suggest(filled), suggest(missing)))
    assert suggest(np.full((30, 40), 1e20)) == suggest(1e20 + 1e19 * image) == ()


@pytest.mark.parametrize(
    ("image", "options", "words"),
    [
        (np.zeros((3, 4, 5)), {}, r"shape \(3, 4, 5\)"),
        (np.zeros((0, 4)), {}, "shape"),
        (np.zeros((4, 4), complex), {}, "real"),
        (np.full((4, 4), np.nan), {}, "finite"),
        (np.eye(9), {"sensitivity": 1.5}, "0 to 1"),
        (np.eye(9), {"sensitivity": np.nan}, "0 to 1"),
        (np.eye(9), {"sensitivity": None}, "sensitivity is None; give a number from 0 to 1"),
        (np.eye(9), {"sensitivity": "high"}, "sensitivity is 'high'"),
        (np.eye(9), {"sensitivity": np.ones(2)}, "sensitivity is array"),
        (np.full((9, 9), np.nan), {"sensitivity": 1.5}, "sensitivity is 1.5"),
        (np.eye(9), {"polarity": "grey"}, "polarity"),
        (np.eye(9), {"half_width": 0}, "give 0.2 to"),
    ],
)
def test_calls_that_make_no_sense_say_so(image, options, words) -> None:
    with pytest.raises(ValueError, match=words):
        suggest(image, **options)


def test_jax_is_not_needed() -> None:
    code = (
        "import sys, numpy as np; from napari_splinesketch import suggest; suggest(np.eye(50));"
        "sys.exit('jax' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_bright_and_dark_bodies_are_both_found_where_both_are_clear() -> None:
    rows, columns = np.mgrid[:160, :160].astype(float)
    image = np.random.default_rng(0).normal(0, 0.05, rows.shape)
    lines = [np.array([[r, 30.0], [r, 130.0]]) for r in (30, 65, 100, 135)]
    for line, sign in zip(lines, (1, -1, 1, -1), strict=True):
        beside = np.hypot(rows - line[0, 0], np.clip(np.abs(columns - 80) - 50, 0, None))
        image += sign * np.exp(-0.5 * (beside / 2) ** 2)
    found = {p: on(suggest(image, polarity=p), lines, FOUND) for p in ("auto", "bright", "dark")}
    bodies = {p: {body for _, body in pairs} for p, pairs in found.items()}
    assert bodies == {"auto": {0, 1, 2, 3}, "bright": {0, 2}, "dark": {1, 3}}


def test_progress_never_falls_and_a_cancel_ends_the_work() -> None:
    image = synthetic.scene(3, shape=(90, 100), length=60.0).image
    told: list[Progress] = []
    lines = suggest(image, on_progress=told.append)
    assert len(lines) == len(suggest(image)) > 0
    shares = [progress.fraction for progress in told]
    assert shares == sorted(shares)
    assert shares[-1] == 1
    assert {progress.stage for progress in told} == {"looking for bodies"}
    for enough in range(1, len(told)):
        heard: list[Progress] = []

        def tell(now: Progress, heard: list[Progress] = heard, enough: int = enough) -> bool:
            heard.append(now)
            return len(heard) < enough

        assert suggest(image, on_progress=tell) == ()
        assert len(heard) == enough
    with pytest.raises(ValueError, match="on_progress is 7"):
        suggest(image, on_progress=7)  # pyright: ignore[reportArgumentType]


def test_large_images_keep_less_and_have_the_same_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    image = synthetic.scene(3, shape=(90, 100), length=60.0).image
    kept = prepare(image)
    monkeypatch.setattr(const, "SUGGEST_LARGE", 0)
    held: list[int] = []
    keep = Ridges.keep
    monkeypatch.setattr(
        Ridges, "keep", lambda self, *more: (keep(self, *more), held.append(len(self._heights)))[0]
    )
    freed = prepare(image)
    assert max(held) <= 4
    assert len(held) > 4
    np.testing.assert_array_equal(freed.strength, kept.strength)
    assert all(map(np.array_equal, freed.lines, kept.lines))
