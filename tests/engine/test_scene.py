"""What an image is made of, against what generated scenes are made of."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import ndimage

from napari_splinesketch import refine, synthetic
from napari_splinesketch.engine import spline
from napari_splinesketch.engine.look import background, ridges, scene
from napari_splinesketch.engine.look.sketched import half_width_across, wanted_rungs
from napari_splinesketch.engine.report.assemble import Pictures
from napari_splinesketch.engine.types import Polarity

SHAPE = (140, 100)


def frame(seed: int = 2, **look) -> synthetic.Scene:
    return synthetic.scene(seed, bodies=2, shape=SHAPE, length=70, **look)


MIDDLE = np.array([[SHAPE[0] / 2, 10.0], [SHAPE[0] / 2, SHAPE[1] - 10.0]])


def read(made: Any, polarity: Polarity = "auto", half_width=None) -> scene.Scene:
    """The scene of a generated frame, seen through its centrelines, or of an image."""
    if isinstance(made, np.ndarray):
        image, lines = made, [MIDDLE]
    else:
        image, lines = made.image, [line[::20] for line in made.centrelines]
    ((members, seen),) = scene.read_scenes(image, lines, polarity, half_width)
    assert members == list(range(len(lines)))
    return seen


@pytest.mark.parametrize("polarity", ["bright", "dark"])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_polarity_contrast_and_background_are_found(seed, polarity):
    made = frame(seed, polarity=polarity)
    seen = read(made)
    assert seen.polarity == polarity
    sign = 1 if polarity == "bright" else -1
    assert seen.contrast == pytest.approx(sign * made.look.contrast, rel=0.3)
    background = made.image - seen.contrast * seen.normal
    assert np.abs(background - made.background).mean() < 0.1 * made.look.contrast
    assert seen.normal.dtype == np.float32
    assert seen.valid.all()


def test_polarity_is_what_it_is_told():
    made = frame(0, polarity="dark")
    assert read(made, "bright").polarity == "bright"
    assert read(made, "dark").polarity == "dark"


@pytest.mark.parametrize("factor", [1.0, 40_000.0, 1e-6])
def test_normal_image_does_not_depend_on_the_units(factor):
    made = frame(1)
    seen, scaled = read(made), read(replace(made, image=made.image * factor - 3 * factor))
    np.testing.assert_allclose(scaled.normal, seen.normal, atol=2e-3)
    assert scaled.contrast == pytest.approx(seen.contrast * factor, rel=1e-3)
    assert scaled.noise == pytest.approx(seen.noise, rel=1e-3)


@pytest.mark.parametrize("snr", [5.0, 15.0])
def test_noise_is_measured(snr):
    made = frame(3, snr=snr, photon_share=0.0)
    sd = made.look.contrast / snr
    assert scene.pixel_noise(made.image.astype(float)) == pytest.approx(sd, rel=0.1)
    assert read(made).noise == pytest.approx(1 / snr, rel=0.4)


def test_noise_does_not_see_a_gradient():
    rows, cols = np.indices(SHAPE)
    white = 0.3 * np.random.default_rng(0).normal(size=SHAPE)
    assert scene.pixel_noise(white + 5 * rows - 2 * cols) == pytest.approx(0.3, rel=0.05)


def test_noise_is_measured_where_most_of_the_image_is_cut_off_at_black():
    white = np.random.default_rng(0).normal(0, 0.3, (96, 128))
    cut = np.where(np.indices(white.shape)[0] < 60, 0.0, 5.0 + white)
    assert scene.pixel_noise(cut) == pytest.approx(0.3, rel=0.1)


def test_noise_of_a_rounded_image_is_the_same_in_another_unit():
    """In whole numbers most second differences are exactly 0; multiplied, they are so nearly."""
    rows, cols = np.indices((96, 128))
    white = np.random.default_rng(0).normal(0, 0.3, rows.shape)
    image = np.round(2 * rows + 3 * cols + white)
    assert scene.pixel_noise(3.7 * image) == pytest.approx(3.7 * scene.pixel_noise(image))


@pytest.mark.parametrize("share", [0.0, 0.02])
def test_a_drawn_image_has_no_noise(share):
    drawn = np.zeros((100, 100))
    drawn.flat[: int(share * drawn.size)] = 1.0
    assert scene.pixel_noise(drawn) == 0.0


@pytest.mark.parametrize(("half_width", "error"), [(1.2, 0.8), (2.0, 0.3), (3.0, 0.3), (5.0, 0.3)])
def test_half_width_is_measured(half_width, error):
    measured = []
    for seed in range(3):
        made = synthetic.scene(
            seed, bodies=2, shape=(200, 160), length=100, half_width=half_width, crossing=False
        )
        true = np.median([w.max() for w in made.half_widths])
        measured.append(read(made).half_width / true)
    assert np.median(measured) == pytest.approx(1, abs=error)


def test_a_given_half_width_is_used_where_bodies_are_like_that():
    measured = read(frame()).half_width
    told = read(frame(), half_width=1.3 * measured)
    assert told.contradicted is None
    assert told.half_width == pytest.approx(1.3 * measured, rel=0.1)
    wrong = read(frame(), half_width=4 * measured)
    assert (wrong.half_width, wrong.contradicted) == (measured, 4 * measured)


def test_only_the_surroundings_of_the_sketches_tell_contrast_and_width():
    rows, cols = np.indices((160, 160))
    image = np.zeros((160, 160))
    image[np.abs(rows - 40) < 2.5] = 1.0
    image[np.hypot(rows - 120, cols - 80) < 25] = 20.0
    image += 0.02 * np.random.default_rng(0).normal(size=image.shape)
    sketch = np.array([[42.0, 20.0], [39.0, 140.0]])
    ((_, seen),) = scene.read_scenes(image, [sketch], "auto", None)
    assert seen.contrast == pytest.approx(1, rel=0.3)
    assert seen.half_width == pytest.approx(2.5, abs=1)


def test_bright_and_dark_bodies_of_one_image_are_told_apart():
    rows = np.indices((120, 160))[0]
    image = 0.02 * np.random.default_rng(0).normal(size=(120, 160))
    image[np.abs(rows - 30) < 2.5] = 1.0
    image[np.abs(rows - 80) < 2.5] = -1.0
    lines = [np.array([[row + 1.0, 20.0], [row, 140.0]]) for row in (80, 30, 79)]
    found = {
        seen.polarity: members for members, seen in scene.read_scenes(image, lines, "auto", None)
    }
    assert found == {"bright": [1], "dark": [0, 2]}


def test_a_bright_blob_is_no_ridge():
    rows, cols = np.indices((120, 160))
    image = 0.02 * np.random.default_rng(0).normal(size=(120, 160))
    image[np.hypot(rows - 60, cols - 80) < 25] = 50.0
    image[np.abs(rows - 20) < 2] += 0.3
    seen = ridges.Ridges(image, 0.02).evidence(3, 1, 0.3)
    assert seen[20, 20:140].min() > 0.9
    rim = np.abs(np.hypot(rows - 60, cols - 80) - 25) < 3
    assert (seen[rim] > 0.5).mean() < 0.1


def test_what_has_the_size_of_the_image_is_in_single_precision():
    made = frame(4)
    seen = read(replace(made, image=made.image.astype(float)))
    pictures = seen.normal, seen.evidence(seen.rungs[0]), seen.ridges.heights(2, -1)
    assert [picture.dtype for picture in pictures] == [np.float32] * 3


def test_what_was_freed_is_measured_again():
    image = np.random.default_rng(0).normal(size=(60, 80))
    looked = ridges.Ridges(image, 1.0)
    heights, evidence = looked.heights(3, 1), looked.evidence(3, 1, 1.0)
    looked.keep({(3, 1)}, {3})
    assert looked.heights(3, 1) is heights
    assert looked.evidence(3, 1, 1.0) is evidence
    looked.keep()
    assert looked.heights(3, 1) is not heights
    assert looked.evidence(3, 1, 1.0) is not evidence
    np.testing.assert_array_equal(looked.heights(3, 1), heights)
    np.testing.assert_array_equal(looked.evidence(3, 1, 1.0), evidence)


def test_pixels_that_are_not_finite_are_left_out():
    made = frame(4)
    holed = made.image.copy()
    holed[30:60, 20:40] = np.nan
    holed[0, 0], holed[100, 50] = np.inf, -np.inf
    seen = read(replace(made, image=holed))
    assert np.isfinite(seen.normal).all()
    np.testing.assert_array_equal(seen.valid, np.isfinite(holed))
    inside = np.s_[40:50, 27:33]  # of the hole: too far from anything to be guessed
    assert np.abs(seen.normal[inside]).max() < 0.5
    whole = read(made)
    assert seen.contrast == pytest.approx(whole.contrast, rel=0.15)


@pytest.mark.parametrize("value", [0.0, 7.0, -1e6])
def test_a_constant_image_is_all_background(value):
    seen = read(np.full(SHAPE, value), polarity="bright")
    np.testing.assert_allclose(seen.normal, 0, atol=1e-5)
    assert np.isfinite([seen.contrast, seen.noise, seen.half_width]).all()


@pytest.mark.parametrize("shape", [(2, 2), (2, 30), (30, 2), (5, 200)])
def test_narrow_images(shape):
    image = np.random.default_rng(0).normal(size=shape)
    with np.errstate(all="raise"):
        seen = read(image, half_width=2.0)
    assert seen.normal.shape == shape
    assert np.isfinite(seen.normal).all()


KINDS = {
    "constant": lambda r, c: 3.0 + 0 * r,
    "linear": lambda r, c: 3 + 0.0005 * r - 0.001 * c,
    "textured": lambda r, c: 0.5 * np.cos(r / 120) * np.sin(c / 100),
}


@pytest.mark.parametrize("unit", [1.0, 1e-12, 1e9])
@pytest.mark.parametrize("kind", KINDS)
def test_background_is_as_simple_as_it_can_be(kind, unit):
    r, c = np.indices((250, 330))
    truth = KINDS[kind](r, c)
    image = truth + 0.05 * np.random.default_rng(1).normal(size=truth.shape)
    found, chosen = background.estimate_background(unit * image, unit * 0.05)
    assert chosen == kind
    inner = np.s_[50:-50, 50:-50]  # medians of blocks, and of those, say less near the border
    assert np.abs(found / unit - truth)[inner].mean() < (0.01 if kind != "textured" else 0.06)


@pytest.mark.parametrize("kind", KINDS)
def test_the_wanted_kind_of_background_is_used(kind):
    image = np.random.default_rng(1).normal(size=(70, 90))
    found, chosen = background.estimate_background(image, 1.0, kind)
    assert chosen == kind
    second = np.abs(np.diff(found, 2, axis=0)).max() + np.abs(np.diff(found, 2, axis=1)).max()
    assert (second < 1e-9) == (kind != "textured")
    assert (np.ptp(found) == 0) == (kind == "constant")


@pytest.mark.parametrize("kind", [*KINDS, None])
def test_the_pictures_take_few_copies_of_the_image(kind, peak_memory):
    image = np.random.default_rng(1).normal(400, 9, (1200, 1300)).astype(np.uint16)
    r, c = np.indices(image.shape, dtype=np.uint16)
    image += r // 5 + c // 20
    drawn = [((slice(0, 50), slice(0, 60)), np.ones((50, 60)))]
    peak = peak_memory(lambda: Pictures(image, drawn, kind).reconstruction)
    assert peak < 2.5 * 8 * image.size


@pytest.mark.parametrize("half_width", [6.0, 17.0])
@pytest.mark.parametrize("aside", [0.0, 0.3])
def test_a_path_tells_the_half_width(half_width: float, aside: float) -> None:
    """Also beside the middle, and where what is tried is off by a third; never too thin."""
    rows = np.arange(201)[:, None] - 100.0
    image = np.broadcast_to(np.clip(half_width + 0.5 - np.abs(rows), 0, 1), (201, 160))
    path = np.column_stack([np.full(30, 100 + aside * half_width), np.linspace(20, 140, 30)])
    for tried in (half_width / 1.35, half_width * 1.35):
        wide = half_width_across(image, path, tried)
        assert 0.98 * half_width < wide < 1.25 * half_width


def hairpin(apart: float, limb: float = 50.0) -> np.ndarray:
    """Two straight limbs side by side, and half a circle between them."""
    turn = np.linspace(0, np.pi, 60)
    bend = np.column_stack([60 - apart / 2 * np.cos(turn), 90 + apart / 2 * np.sin(turn)])
    ends = [[60 - apart / 2, 90 - limb]], [[60 + apart / 2, 90 - limb]]
    return spline.resample(np.concatenate([ends[0], bend, ends[1]]), 200)


ROUND = np.linspace(0, 2 * np.pi, 40)
LOOP = np.column_stack([50 + 25 * np.cos(ROUND), 100 + 25 * np.sin(ROUND)])
TO_AND_FRO = 20 + 15 * np.array([0, 2, 1, 4, 3, 6, 5, 8, 7.0])
BENDS = {
    "straight": (np.array([[20.0, 20.0], [25.0, 140.0]]), 18),
    "corner": (np.array([[20.0, 20.0], [20.0, 80.0], [80.0, 80.0]]), 18),
    "sharp": (np.array([[20.0, 20.0], [60.0, 90.0], [100.0, 20.0]]), 24),
    "loop": (np.concatenate([[[75.0, 10.0]], LOOP, [[75.0, 190.0]]]), 37),
    "scribble": (np.column_stack([np.tile([40.0, 44.0, 48.0], 3), TO_AND_FRO]), 28),
    "touching": (hairpin(16.0), 8),
}
"""Sketches, and the half-width, px, that a body of theirs has at most."""


@pytest.mark.parametrize("bend", BENDS)
def test_a_sketch_may_bend_as_bodies_do(bend: str) -> None:
    sketch, most = BENDS[bend]
    widest = ridges.WIDTHS[wanted_rungs(sketch)[-1]]
    assert 0.74 * most < widest < 1.12 * most


def test_the_limbs_of_a_hairpin_are_not_one_wide_body() -> None:
    """They are blurred, so that what is between them is bright, too: the wider the higher."""
    line = hairpin(10.0)
    at = np.argwhere(np.ones((120, 140)))
    away = spline.apart(at, line).reshape(120, 140)
    image = ndimage.gaussian_filter(np.clip(3 - away, 0, 1), 3.0)
    image += np.random.default_rng(0).normal(0, 0.03, image.shape)
    clicks = line[np.linspace(0, 199, 8).astype(int)]
    (curve,) = refine(image, [clicks]).curves
    assert spline.apart(line, curve.points).max() < 3
