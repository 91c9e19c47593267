"""The public call: what comes out is what the caller may rely on."""

import dataclasses
import time

import numpy as np
import pytest
from scipy import ndimage
from scipy.interpolate import CubicSpline
from scipy.spatial import KDTree

from napari_splinesketch import (
    Curve,
    Refinement,
    read_labels,
    refine,
    suggest,
    synthetic,
    write_labels,
)
from napari_splinesketch.data import load_sample
from napari_splinesketch.engine import spline
from napari_splinesketch.engine.judge.assess import as_drawn
from napari_splinesketch.engine.settings import OFFERED, Hold, Settings

from .scenes import SHAPE, frame, miss, refined, sketches_of

OUTSIDE = np.array([[500.0, 500.0], [560.0, 540.0]])


def assert_whole(result: Refinement, count: int, shape=SHAPE) -> None:
    """Everything that holds for every result, however bad the sketches were."""
    assert len(result.curves) == len(result.model.knots) == count
    for frame_like in (result.reconstruction, result.background):
        assert frame_like.shape == shape
        assert np.isfinite(frame_like).all()
    assert result.seconds > 0
    for curve, knots in zip(result.curves, result.model.knots, strict=True):
        assert curve.points.shape == (100, 2)
        assert curve.half_width.shape == curve.sd.shape == (100,)
        assert curve.knots.ndim == 2
        assert curve.knots.shape[1] == 3
        assert curve.status in ("good", "check", "failed")
        assert bool(curve.reasons) == (curve.status != "good")
        assert all(isinstance(r, str) and r for r in curve.reasons)
        assert np.isfinite(curve.points).all()
        assert (knots == 0) == (curve.status == "failed")
        if curve.status != "failed":
            assert np.isfinite(curve.knots).all()
            assert (curve.half_width > 0).all()
            assert (curve.sd >= 0).all()
            assert knots == len(curve.knots)


def test_curves_come_in_the_order_of_the_sketches():
    made = frame(1, 3)
    found = refined(1, 3)
    assert_whole(found, 3)
    for curve, truth in zip(found.curves, made.centrelines, strict=True):
        assert miss(curve, truth) < 2
    back = refine(made.image, sketches_of(made)[::-1])
    for curve, same in zip(back.curves[::-1], found.curves, strict=True):
        assert miss(curve, same.points) < 0.5


@pytest.mark.parametrize("offset", [1e8, -1e8])
def test_values_far_from_zero_hide_no_body(offset: float):
    image = frame(1, 3).image.astype(np.float64)
    far = refine(image + offset, sketches_of(frame(1, 3)))
    for curve, same in zip(far.curves, refined(1, 3).curves, strict=True):
        assert miss(curve, same.points) < 0.3
    assert len(suggest(image + offset)) == len(suggest(image)) > 0


def test_a_curve_is_the_natural_spline_through_its_knots():
    for curve in refined(1, 3).curves:
        through = CubicSpline(np.arange(len(curve.knots)), curve.knots[:, :2], bc_type="natural")
        line = through(np.linspace(0, len(curve.knots) - 1, 4000))
        apart = np.linalg.norm(curve.points[:, None] - line[None], axis=2).min(1)
        assert apart.max() < 0.05
        np.testing.assert_allclose(curve.points[[0, -1]], curve.knots[[0, -1], :2], atol=1e-6)
        steps = np.linalg.norm(np.diff(curve.points, axis=0), axis=1)
        np.testing.assert_allclose(steps, steps.mean(), rtol=0.02)
        assert curve.length == pytest.approx(steps.sum())
        np.testing.assert_allclose(curve.half_width[[0, -1]], curve.knots[[0, -1], 2], rtol=0.05)


def test_widths_and_errors_are_those_of_the_bodies():
    made, found = frame(0), refined(0)
    curve, truth = found.curves[0], made.half_widths[0]
    assert curve.half_width[30:70].mean() == pytest.approx(truth[30:70].mean(), rel=0.15)
    assert found.model.half_width == pytest.approx(truth.max(), rel=0.25)
    assert 0.01 < np.median(curve.sd) < 0.2
    assert 0 < curve.residual < 0.3


@pytest.mark.parametrize("seed", range(4))
def test_whole_sketches_give_good_curves_and_short_ones_at_least_right_ones(seed):
    made = frame(seed)
    assert miss(refined(seed).curves[0], made.centrelines[0]) < 2
    (whole,) = refine(made.image, [synthetic.rotate(made.centrelines[0], 12.0)[::11]]).curves
    assert whole.status == "good", whole.reasons
    assert miss(whole, made.centrelines[0]) < 0.5


@pytest.mark.parametrize("polarity", ["bright", "dark"])
def test_both_polarities(polarity):
    made = frame(5, 2, polarity=polarity)
    found = refine(made.image, sketches_of(made))
    assert found.model.polarity == polarity
    for curve, truth in zip(found.curves, made.centrelines, strict=True):
        assert miss(curve, truth) < 1
    told = refine(made.image, sketches_of(made), polarity=polarity)
    np.testing.assert_array_equal(told.curves[0].points, found.curves[0].points)


def test_reconstruction_is_in_the_units_of_the_image():
    made = frame(2, 2)
    sketches = sketches_of(made)
    here = refine(made.image, sketches)
    there = refine(1000 * made.image.astype(float) - 300, sketches)
    for name in ("reconstruction", "background"):
        expected = 1000 * getattr(here, name) - 300
        # Rounded otherwise, an end may stop a step sooner: that is seen in a few pixels there.
        differ = np.abs(getattr(there, name) - expected) / there.model.noise
        assert differ.mean() < 0.005
        assert (differ > 0.1).mean() < 0.005
    assert there.model.contrast == pytest.approx(1000 * here.model.contrast, rel=0.03)
    assert there.model.noise == pytest.approx(1000 * here.model.noise, rel=0.03)
    contrast = made.look.contrast
    assert np.abs(here.reconstruction - made.clean).mean() < 0.05 * contrast
    body = np.abs(made.clean - made.background) > 0.6 * contrast
    assert np.abs(here.reconstruction - made.clean)[body].mean() < 0.15 * contrast
    assert np.abs(here.background - made.background).mean() < 0.06 * contrast


def _twelve_bits(image: np.ndarray) -> np.ndarray:
    return np.clip(image * 4095, 0, 4095).astype(np.uint16)


def scaled(kind: str):
    def convert(image: np.ndarray) -> np.ndarray:
        high = min(np.iinfo(kind).max, 2**40)
        return (np.clip(image, 0, 1) * high * 0.99).astype(kind)

    return convert


DTYPES = {
    **{kind: scaled(kind) for kind in ("uint8", "int8", "uint16", "int16", "uint32", "int32")},
    **{kind: scaled(kind) for kind in ("uint64", "int64")},
    **{kind: (lambda i, kind=kind: i.astype(kind)) for kind in ("float16", "float32", "float64")},
    "longdouble": lambda i: i.astype(np.longdouble),
    "bool": lambda i: i > (i.min() + i.max()) / 2,
    "12-bit": _twelve_bits,
    "negative": lambda i: -1000 + 50 * i,
    "big-endian": lambda i: i.astype(">f4"),
    "strided": lambda i: np.repeat(np.repeat(i, 2, 0), 2, 1)[::2, ::2],
    "reversed": lambda i: i[::-1, ::-1].copy()[::-1, ::-1],
    "read-only": lambda i: np.broadcast_to(i, (1, *i.shape))[0],
    "list": lambda i: i.tolist(),
}


@pytest.mark.parametrize("kind", DTYPES)
def test_every_kind_of_image(kind):
    made = frame(3, gradient=(0.0, 0.0), polarity="bright", texture=0.0)
    image = DTYPES[kind](made.image)
    found = refine(image, sketches_of(made))
    assert_whole(found, 1)
    assert miss(found.curves[0], made.centrelines[0]) < (1.0 if kind == "bool" else 0.7)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_pixels_that_are_not_finite_are_masked_and_do_not_spread(value):
    made = frame(0)
    image = made.image.copy()
    rows, cols = np.rint(made.centrelines[0][45:50]).astype(int).T
    image[rows, cols] = value
    image[5:12, 60:70] = value
    image[:, 120] = value
    found = refine(image, sketches_of(made))
    assert_whole(found, 1)
    assert miss(found.curves[0], made.centrelines[0]) < 0.7
    apart = np.abs(found.reconstruction - refined(0).reconstruction)
    assert apart[np.isfinite(image)].max() < 0.25 * made.look.contrast


def test_scattered_pixels_may_be_missing():
    made = frame(2, 2)
    image = made.image.copy()
    image[np.random.default_rng(0).random(SHAPE) < 0.04] = np.nan
    found = refine(image, sketches_of(made))
    for curve, truth in zip(found.curves, made.centrelines, strict=True):
        assert miss(curve, truth) < 1


@pytest.mark.parametrize("value", [-np.finfo(np.float32).max, 1e20, 9.96921e36])
def test_a_fill_value_is_no_pixel(value):
    """Programs for maps put such numbers where nothing was measured."""
    made = frame(0)
    image = made.image.astype(np.float32)
    image[:4] = value
    image[70, 100] = value
    found = refine(image, sketches_of(made))
    missing = np.where(np.abs(image) > 1e18, np.nan, image)
    np.testing.assert_array_equal(
        found.curves[0].points, refine(missing, sketches_of(made)).curves[0].points
    )
    assert miss(found.curves[0], made.centrelines[0]) < 1


def test_a_sketch_whose_pixels_are_missing_says_so_and_leaves_the_noise_as_it_is():
    image = np.random.default_rng(0).normal(100, 5, (120, 120))
    image[54:66, 14:106] = np.nan
    found = refine(image, [np.array([[60.0, 25.0], [60.0, 60.0], [60.0, 95.0]])])
    assert found.curves[0].status != "good"
    assert found.model.noise == pytest.approx(5, rel=0.2)


def test_a_line_may_cross_the_image_from_outside_to_outside():
    row, column = np.mgrid[:96, :96]
    body = np.exp(-(((row - 40 - column / 10) / 2.0) ** 2))
    image = 100 * body + np.random.default_rng(0).normal(size=body.shape)
    (curve,) = refine(image, [np.array([[39.8, -2.0], [49.8, 98.0]])]).curves
    assert curve.status != "failed"
    inside = curve.points[(curve.points[:, 1] > 0) & (curve.points[:, 1] < 95)]
    assert np.abs(inside[:, 0] - 40 - inside[:, 1] / 10).max() < 0.5


BLANK = {"missing": (np.nan, "no pixel around the sketch has"), "even": (7.0, "one and the")}


@pytest.mark.parametrize("kind", BLANK)
def test_nothing_to_be_seen_around_the_sketches(kind):
    value, reason = BLANK[kind]
    image = np.full((110, 520), value)
    image[:, 480:] = np.random.default_rng(0).normal(size=(110, 40))
    lines = [np.array([[30.0, 20.0], [60.0, 80.0]]), np.array([[50.0, 30.0], [50.0, 30.0]])]
    found = refine(image, lines)
    assert_whole(found, 2, image.shape)
    assert [c.status for c in found.curves] == ["failed", "failed"]
    assert reason in found.curves[0].reasons[0]
    assert "shorter" in found.curves[1].reasons[0]


@pytest.mark.parametrize("shape", [(104, 150), (190, 92)])
def test_images_that_are_not_square(shape):
    made = synthetic.scene(6, bodies=2, shape=shape, length=75)
    found = refine(made.image, sketches_of(made))
    assert_whole(found, 2, shape)
    for curve, truth in zip(found.curves, made.centrelines, strict=True):
        assert miss(curve, truth) < 1


def test_a_part_of_an_image_gives_the_same_curve_moved():
    """The image is larger than what the sketch needs: only its surroundings count."""
    made = frame(0)
    rng = np.random.default_rng(0)
    large = made.background.mean() + made.noise_sd.mean() * rng.standard_normal((420, 400))
    large[200:304, 150:278] = made.image
    found = refine(large, [s + np.array([200, 150]) for s in sketches_of(made)])
    assert_whole(found, 1, large.shape)
    assert miss(found.curves[0], made.centrelines[0] + np.array([200, 150])) < 0.7


DEGENERATE = {
    "a click": np.array([[40.0, 40.0], [40.0, 40.0]]),
    "a dot": np.array([[40.0, 40.0], [40.5, 40.5], [40.2, 40.9]]),
    "not finite": np.array([[40.0, 40.0], [np.nan, 60.0], [50.0, 90.0]]),
    "infinite": np.array([[40.0, 40.0], [np.inf, 60.0]]),
    "all missing": np.full((3, 2), np.nan),
    "outside": OUTSIDE,
    "above": np.array([[-300.0, 20.0], [-240.0, 90.0]]),
}


@pytest.mark.parametrize("kind", DEGENERATE)
def test_a_sketch_that_cannot_be_refined_fails_alone(kind):
    made, bad = frame(2, 2), DEGENERATE[kind]
    first, second = sketches_of(made)
    found = refine(made.image, [first, bad, second])
    assert_whole(found, 3)
    assert [c.status == "failed" for c in found.curves] == [False, True, False]
    failed = found.curves[1]
    assert len(failed.reasons) == 1
    assert "sketch" in failed.reasons[0]
    assert np.isinf(failed.sd).all()
    assert np.isnan(failed.half_width).all()
    if np.isfinite(bad).all():
        np.testing.assert_array_equal(failed.knots[:, :2], bad)
        np.testing.assert_allclose(failed.points[[0, -1]], bad[[0, -1]])
    alone = refined(2, 2)
    for curve, same in zip((found.curves[0], found.curves[2]), alone.curves, strict=True):
        np.testing.assert_array_equal(curve.points, same.points)


def test_only_degenerate_sketches():
    found = refine(frame(0).image, list(DEGENERATE.values()))
    assert_whole(found, len(DEGENERATE))
    assert all(c.status == "failed" for c in found.curves)
    np.testing.assert_array_equal(found.reconstruction, found.background)


def test_no_sketches():
    found = refine(frame(0).image, [])
    assert_whole(found, 0)


IMAGE, SKETCH = np.zeros((30, 40)), np.array([[3.0, 3.0], [20.0, 30.0]])
SENSELESS = {
    "one row of pixels": ((np.zeros(30), [SKETCH]), r"image has shape \(30,\).*\(H, W\)"),
    "colour": ((np.zeros((30, 40, 3)), [SKETCH]), r"image has shape \(30, 40, 3\).*2-D"),
    "empty": ((np.zeros((0, 40)), [SKETCH]), r"image has shape \(0, 40\)"),
    "none": ((None, [SKETCH]), "image has shape"),
    "complex": ((IMAGE + 1j, [SKETCH]), "image has dtype complex128; give real"),
    "text": ((np.full((3, 3), "a"), [SKETCH]), "image has dtype <U1"),
    "nothing finite": ((IMAGE * np.nan, [SKETCH]), "no finite pixel"),
    "3-D sketch": ((IMAGE, [SKETCH, np.zeros((4, 3))]), r"sketch 1 has shape \(4, 3\).*\(N, 2\)"),
    "no points": ((IMAGE, [np.zeros((0, 2))]), r"sketch 0 has shape \(0, 2\)"),
    "flat sketch": ((IMAGE, [np.zeros(4)]), r"sketch 0 has shape \(4,\)"),
    "no sketches": ((IMAGE, None), "sketches is None; give a list"),
    "by name": ((IMAGE, {"a": SKETCH}), "sketches is {'a': .*give a list"),
    "a word": ((IMAGE, ["ab"]), "sketch 0 is 'ab'; give"),
    "uneven": ((IMAGE, [SKETCH, [[1, 2], [3]]]), r"sketch 1 is \[\[1, 2\], \[3\]\]; give"),
    "complex sketch": ((IMAGE, [SKETCH * 1j]), "sketch 0 is array.*give"),
    "too large": ((IMAGE, [[[10**400, 1], [2, 2]]]), r"sketch 0 is \[\[1000.*give"),
    "preset": ((IMAGE, [SKETCH], "best"), "preset is 'best'; choose one of fast, balanced"),
    "no preset": ((IMAGE, [SKETCH], None), "preset is None; choose one of fast, balanced"),
}


@pytest.mark.parametrize("case", SENSELESS)
def test_senseless_calls_say_what_is_wrong(case):
    given, message = SENSELESS[case]
    with pytest.raises(ValueError, match=message):
        refine(*given)


OPTIONS = {
    "polarity": ({"polarity": "grey"}, "polarity is 'grey'.*bright"),
    "no width": ({"half_width": 0.0}, "half_width is 0.*give 0.2 to 20 px"),
    "negative": ({"half_width": -2.0}, "half_width is -2.*give 0.2"),
    "missing": ({"half_width": np.nan}, "half_width is nan"),
    "thinner than pixels": ({"half_width": 1e-6}, "half_width is 1e-06.*measured"),
    "wider than the image": ({"half_width": 1e9}, "half_width is 1000000000.0.*30 x 40 px"),
    "endless": ({"half_width": np.inf}, "half_width is inf"),
    "text": ({"half_width": "3"}, "half_width is '3'"),
    "fixed points": ({"fixed": [SKETCH]}, "fixed has array.*give a list of curves"),
    "one curve": ({"fixed": as_drawn(SKETCH, "-")}, "fixed has Curve.*give a list of curves"),
    "a number": ({"fixed": 3}, "fixed has 3; give a list of curves"),
    "half-widths of another curve": (
        {"fixed": [dataclasses.replace(as_drawn(SKETCH, "-"), half_width=np.ones(7))]},
        "points and 7 half-widths; give one half-width for each point",
    ),
    "no function": ({"on_progress": 3}, "on_progress is 3; give a function"),
    "long seed": ({"seed": 2**40, "preset": "paper"}, "seed is 1099511627776; give a whole"),
    "broken seed": ({"seed": 1.5}, "seed is 1.5; give a whole"),
}


@pytest.mark.parametrize("case", OPTIONS)
def test_senseless_options_say_what_is_wrong(case):
    options, message = OPTIONS[case]
    with pytest.raises(ValueError, match=message):
        refine(IMAGE, [SKETCH], **options)


SETTINGS = {
    "none": ({"knots": ()}, r"knots is \(\); give whole numbers"),
    "a number": ({"knots": 8}, "knots is 8; give whole numbers"),
    "too few": ({"knots": (1, 8)}, r"knots is \(1, 8\).*from 2 to 24"),
    "many only": ({"knots": (48, 96)}, r"knots is \(48, 96\).*from 2 to 24"),
    "falling": ({"knots": (16, 8)}, "in rising order"),
    "broken": ({"knots": (8.0,)}, "whole numbers"),
    "one hold": ({"hold": Hold(1.0, 1.0, 1.0)}, "hold is Hold.*one Hold for each sketch"),
    "numbers": ({"hold": ((1.0, 1.0, 1.0),)}, "hold is .*one Hold for each sketch"),
}


@pytest.mark.parametrize("case", SETTINGS)
def test_senseless_settings_say_what_is_wrong(case):
    given, message = SETTINGS[case]
    with pytest.raises(ValueError, match=message):
        Settings(**given)


@pytest.mark.parametrize("sd", [0.0, -1.0, np.nan, np.inf, "1"])
def test_errors_that_no_sketch_has_are_refused(sd):
    with pytest.raises(ValueError, match=r"hold is Hold.*finite standard errors above 0"):
        Hold(sd, 1.0, 1.0)


@pytest.mark.parametrize("count", [0, 1, 3])
def test_as_many_sketches_as_there_are_can_be_held(count):
    held = Settings(hold=(Hold(1.0, 1.0, 1.0),) * count)
    with pytest.raises(ValueError, match=f"hold has {count} for 2 sketches; give one Hold for"):
        refine(IMAGE, [SKETCH, SKETCH + 3], held)


@pytest.mark.parametrize("vertices", [2, 5])
def test_a_vertex_that_was_set_twice_counts_once(vertices):
    made = frame(2, bodies=2)
    lines = [spline.resample(line, vertices) for line in sketches_of(made)]
    once = refine(made.image, lines)
    twice = refine(
        made.image, [np.repeat(line, [2, *[1] * (vertices - 2), 3], 0) for line in lines]
    )
    for one, two in zip(once.curves, twice.curves, strict=True):
        np.testing.assert_array_equal(one.points, two.points)


@pytest.mark.parametrize("far", [2e9, 1e200, 1e308])
def test_a_sketch_that_leads_nowhere_stops_no_file(far, tmp_path):
    made = frame(0)
    found = refine(made.image, [*sketches_of(made), np.array([[5.0, 7.0], [far, -far]])])
    assert_whole(found, 2)
    write_labels(tmp_path / "labels.csv", found)
    good, bad = read_labels(tmp_path / "labels.csv").labels
    np.testing.assert_array_equal(good.points, found.curves[0].points)
    assert bad.status == "failed"
    assert bad.points[0].tolist() == [5, 7]


def test_fixed_curves_take_part_and_do_not_move():
    """A body that a fixed curve explains is not found again by a sketch between two bodies."""
    made = frame(5, 2)
    both = refine(made.image, sketches_of(made))
    alone = refine(made.image, sketches_of(made)[1:], fixed=both.curves[:1])
    assert_whole(alone, 1)
    assert miss(alone.curves[0], made.centrelines[1]) < 0.4
    bodies = np.abs(made.clean - made.background) > 0.5 * made.look.contrast
    gap = [np.abs(r.reconstruction - made.clean)[bodies].mean() for r in (alone, both)]
    assert gap[0] < 1.2 * gap[1]


@pytest.mark.parametrize("sketches", [[], [OUTSIDE]], ids=["no sketch", "none in the image"])
def test_fixed_curves_are_drawn_where_nothing_is_refined(sketches):
    found = refined(5, 2)
    alone = refine(frame(5, 2).image, sketches, fixed=found.curves)
    assert_whole(alone, len(sketches))
    rise = np.abs(found.reconstruction - found.background)
    bodies = rise > rise.max() / 2
    off = np.abs(alone.reconstruction - found.reconstruction)
    assert off[bodies].mean() < 0.05 * rise.max()


def test_no_fixed_curves_may_be_none():
    assert_whole(refine(IMAGE, [], fixed=None), 0, IMAGE.shape)


def test_a_fixed_curve_keeps_a_sketch_off_its_body():
    made = frame(4, 2)
    first, second = made.centrelines
    fixed = refine(made.image, sketches_of(made)).curves[0]
    between = 0.55 * synthetic.resample(first, 30) + 0.45 * synthetic.resample(second, 30)
    found = refine(made.image, [between], fixed=[fixed]).curves[0]
    assert miss(found, first) > 4


def test_a_body_that_a_fixed_curve_has_already_is_said_to_be_its():
    made, found = frame(4), refined(4)
    again = refine(made.image, sketches_of(made), fixed=found.curves).curves[0]
    assert "it lies on the same body as another curve" in again.reasons


@pytest.mark.slow
@pytest.mark.parametrize("preset", OFFERED)
def test_a_fixed_curve_without_a_half_width_is_as_wide_as_the_others(preset):
    made = frame(5, 2)
    both = refine(made.image, sketches_of(made))
    bare = dataclasses.replace(
        both.curves[0], half_width=np.full_like(both.curves[0].half_width, np.nan)
    )
    found = refine(made.image, sketches_of(made)[1:], preset, fixed=[bare])
    assert_whole(found, 1)


def test_a_fixed_curve_far_away_changes_nothing():
    made = frame(0)
    curve = refined(0).curves[0]
    far = dataclasses.replace(curve, points=curve.points + 3000, knots=curve.knots + 3000)
    image = np.pad(made.image, ((0, 60), (0, 0)), mode="median")
    plain, beside = (refine(image, sketches_of(made), fixed=f).curves[0] for f in ([], [far]))
    assert miss(beside, plain.points) < 0.02


def test_a_failed_curve_may_be_fixed():
    """What came back as drawn has no half-width; it is nobody's body and changes nothing."""
    made = frame(2, 2)
    first, second = sketches_of(made)
    beside = refine(made.image, [second], fixed=[as_drawn(first, "it was cancelled")])
    assert_whole(beside, 1)
    alone = refine(made.image, [second]).curves[0]
    np.testing.assert_array_equal(beside.curves[0].points, alone.points)


def test_same_from_the_other_end():
    made = frame(2, 2)
    forth = refined(2, 2)
    back = refine(made.image, [s[::-1] for s in sketches_of(made)])
    for a, b in zip(forth.curves, back.curves, strict=True):
        for name in ("knots", "points", "half_width", "sd"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name)[::-1])
        assert a.status == b.status


def test_same_in_another_order():
    made, order = frame(1, 3), [2, 0, 1]
    sketches = sketches_of(made)
    other = refine(made.image, [sketches[i] for i in order])
    for i, curve in zip(order, other.curves, strict=True):
        np.testing.assert_array_equal(curve.knots, refined(1, 3).curves[i].knots)


def test_same_every_time():
    made = frame(2, 2)
    again = refine(made.image, sketches_of(made))
    for a, b in zip(refined(2, 2).curves, again.curves, strict=True):
        np.testing.assert_array_equal(a.knots, b.knots)


def test_turned_image_gives_the_turned_curve():
    made = frame(0)
    turned = refine(made.image.T, [s[:, ::-1] for s in sketches_of(made)])
    assert miss(turned.curves[0], refined(0).curves[0].points[:, ::-1]) < 0.1


def test_input_is_not_changed():
    made = frame(0)
    image, sketches = made.image.copy(), sketches_of(made)
    copies = [s.copy() for s in sketches]
    refine(image, sketches)
    np.testing.assert_array_equal(image, made.image)
    for sketch, copy in zip(sketches, copies, strict=True):
        np.testing.assert_array_equal(sketch, copy)


def test_sketches_may_be_lists_of_integers():
    made = frame(0)
    whole = [np.rint(s).astype(int).tolist() for s in sketches_of(made)]
    found = refine(made.image, whole)
    assert miss(found.curves[0], made.centrelines[0]) < 0.7


@pytest.mark.parametrize("preset", ["fast", "thorough"])
def test_other_names_of_the_same_engine_give_the_same_curves(preset):
    made, plain = frame(1, 3), refined(1, 3)
    found = refine(made.image, sketches_of(made), preset)
    assert_whole(found, 3)
    for a, b in zip(found.curves, plain.curves, strict=True):
        np.testing.assert_array_equal(a.knots, b.knots)


def test_the_result_is_complete_and_immutable():
    found = refined(0)
    with pytest.raises(dataclasses.FrozenInstanceError):
        found.curves[0].status = "good"  # pyright: ignore[reportAttributeAccessIssue]
    assert isinstance(found.curves[0], Curve)
    assert all(note.endswith(".") for note in found.model.notes)
    began = time.perf_counter()
    again = refine(frame(0).image, sketches_of(frame(0)))
    assert again.seconds <= time.perf_counter() - began


def test_a_worm_does_not_leave_its_body_for_one_that_has_a_sketch():
    image = load_sample("worms_swimming")[0][0]
    sketches = suggest(image)
    for curve, sketch in zip(refine(image, sketches).curves, sketches, strict=True):
        assert np.linalg.norm(curve.points.mean(0) - np.mean(sketch, axis=0)) < 6


@pytest.mark.parametrize("half_width", [3.0, 5.0])
def test_a_blunt_body_is_followed_to_the_tips_that_its_sketch_reaches(half_width: float) -> None:
    rows, columns = np.mgrid[:80, :120].astype(float)
    beside = np.hypot(rows - 40, np.clip(np.abs(columns - 60) - 30, 0, None))
    image = 1 / (1 + np.exp((beside - half_width) / 0.4))
    image += np.random.default_rng(0).normal(0, 0.05, image.shape)
    tips = np.array([30 - half_width, 90 + half_width])
    sketch = np.column_stack([np.full(5, 40.0), np.linspace(tips[0], tips[1], 5)])
    curve = refine(image, [sketch]).curves[0]
    np.testing.assert_allclose(curve.points[[0, -1], 1], tips, atol=0.7)
    np.testing.assert_allclose(curve.knots[[0, -1], 1], tips, atol=0.7)
    assert (curve.half_width > 0).all()


def test_a_pointed_body_is_followed_to_where_its_tips_were_clicked() -> None:
    """The last px of a point hardly show; clicks on them may be as far beside as ahead."""
    rows, columns = np.mgrid[:80, :160].astype(float)
    half_width = 3 * np.clip(np.minimum(columns - 30, 130 - columns) / 30, 1e-3, 1)
    body = (np.abs(rows - 40) < half_width) & (columns > 30) & (columns < 130)
    sketch = np.column_stack([[41.5, 40, 40, 40, 38.5], np.linspace(30, 130, 5)])
    short = []
    for seed in range(8):
        noise = np.random.default_rng(seed).normal(0, 0.05, body.shape)
        (curve,) = refine(ndimage.gaussian_filter(body * 1.0, 0.7) + noise, [sketch]).curves
        short += [curve.points[0, 1] - 30, 130 - curve.points[-1, 1]]
    assert abs(np.median(short)) < 0.3


@pytest.mark.parametrize("points", [5, 60], ids=["clicked short", "freehand"])
def test_a_blunt_body_is_followed_to_its_tips_whoever_draws_it(points: int) -> None:
    rows, columns = np.mgrid[:80, :120].astype(float)
    beside = np.hypot(rows - 40, np.clip(np.abs(columns - 60) - 30, 0, None))
    image = 1 / (1 + np.exp((beside - 3) / 0.4))
    image += np.random.default_rng(1).normal(0, 0.05, image.shape)
    sketch = np.column_stack([np.full(points, 40.0), np.linspace(29, 91, points)])
    curve = refine(image, [sketch]).curves[0]
    np.testing.assert_allclose(curve.points[[0, -1], 1], [27, 93], atol=0.7)
    goes_on = np.where(columns < 60, 1 / (1 + np.exp((np.abs(rows - 40) - 3) / 0.4)), image)
    curve = refine(goes_on, [sketch]).curves[0]
    assert curve.points[0, 1] > 29 - 3 - 3, "an end is not followed where the body goes on"
    assert curve.points[-1, 1] == pytest.approx(93, abs=0.7)


def drawn(
    shape: tuple[int, int], lines: list[np.ndarray], half_widths: list[float], noise: float = 0.1
) -> np.ndarray:
    """Bright bodies with round ends around some lines."""
    places = np.moveaxis(np.indices(shape), 0, -1)
    edges = [
        half_width - KDTree(line).query(places)[0] + 0.5
        for line, half_width in zip(lines, half_widths, strict=True)
    ]
    return np.clip(edges, 0, 1).max(0) + np.random.default_rng(0).normal(0, noise, shape)


def bow(row: float, length: float = 220.0, height: float = 6.0) -> np.ndarray:
    """A line that bows, from left to right."""
    along = np.linspace(0, 1, 400)
    return np.column_stack([row + height * np.sin(np.pi * along), 20 + length * along])


@pytest.mark.parametrize("vertices", [2, 4, 80])
def test_a_wide_body_among_thin_ones_has_its_own_half_width(vertices):
    half_widths = [2.0, 10.0, 2.0, 2.0, 2.0]
    lines = [bow(row) for row in (20, 60, 105, 140, 175)]
    image = drawn((200, 260), lines, half_widths)
    few = np.linspace(0, 399, vertices).astype(int)
    sketches = [line[few] + [1.0, 0.0] for line in lines]
    for curve, line, own in zip(refine(image, sketches).curves, lines, half_widths, strict=True):
        assert curve.status == "good"
        assert KDTree(line).query(curve.points)[0].mean() < 1.0
        assert curve.typical_half_width == pytest.approx(own, rel=0.25)


def test_a_very_wide_body_is_not_taken_for_the_background():
    line = bow(140, 480, 20)
    curve = refine(drawn((300, 520), [line], [36.0]), [line[::80]]).curves[0]
    assert curve.status == "good"
    assert KDTree(line).query(curve.points)[0].mean() < 1.0
    assert curve.typical_half_width == pytest.approx(36, rel=0.1)


@pytest.mark.parametrize("vertices", [25, 120])
def test_a_ring_ends_where_it_begins(vertices):
    turn = np.linspace(0, 2 * np.pi, 1000)
    ring = 70 + 45 * np.column_stack([np.sin(turn), np.cos(turn)])
    sketch = ring[np.linspace(0, 999, vertices).astype(int)]
    curve = refine(drawn((140, 140), [ring], [3.0]), [sketch]).curves[0]
    assert curve.status == "good"
    assert curve.length == pytest.approx(2 * np.pi * 45, rel=0.04)


def test_a_curve_that_cannot_follow_all_bends_says_so():
    along = np.linspace(0, 1, 4000)
    line = np.column_stack([30 + 8 * np.sin(2 * np.pi * 30 * along), 10 + 700 * along])
    curve = refine(drawn((60, 720), [line], [2.0]), [line[::32]]).curves[0]
    assert "it has too few knots to follow all bends of its body" in curve.reasons


def test_the_mask_of_a_masked_array_is_missing_pixels():
    made = frame(0)
    spoilt, hidden = made.image.copy(), np.zeros(SHAPE, dtype=bool)
    hidden[40:60, 50:70], spoilt[40:60, 50:70] = True, 1e4
    masked = refine(np.ma.masked_array(spoilt, hidden), sketches_of(made))
    missing = refine(np.where(hidden, np.nan, made.image), sketches_of(made))
    np.testing.assert_array_equal(masked.curves[0].points, missing.curves[0].points)
