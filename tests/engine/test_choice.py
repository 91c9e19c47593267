"""Which way through the image a sketch means: paths, their cost, and the choice for all of them."""

import json
from pathlib import Path

import numpy as np
import perturbations
import pytest
from scipy import ndimage
from skimage import io

from napari_splinesketch import refine, synthetic
from napari_splinesketch.engine import constants, spline
from napari_splinesketch.engine.find import finding, hollow, paths, scoring, strip, tracing
from napari_splinesketch.engine.look import scene
from napari_splinesketch.engine.settings import Settings
from napari_splinesketch.engine.types import Polarity
from napari_splinesketch.metrics import average_dtw

HALF_WIDTH = 3.0
CENTRE = np.array([45.0, 60.0])
SHAPE = (90, 120)


def cross(angle: float = 70.0) -> list[np.ndarray]:
    """Two straight bodies, 80 px long, that cross at an angle in degrees."""
    turns = np.deg2rad([-angle / 2, angle / 2])
    along = np.linspace(-40, 40, 81)[:, None]
    return [CENTRE + along * [np.sin(t), np.cos(t)] for t in turns]


def drawn(lines: list[np.ndarray], half_width=HALF_WIDTH, noise=0.03) -> np.ndarray:
    grid = np.indices(SHAPE).reshape(2, -1).T
    apart = np.min([np.linalg.norm(grid[:, None] - p, axis=2).min(1) for p in lines], axis=0)
    image = ndimage.gaussian_filter((apart < half_width).reshape(SHAPE).astype(float), 0.7)
    return image + noise * np.random.default_rng(0).normal(size=SHAPE)


def found(image, sketches, fixed=(), polarity: Polarity = "auto") -> list[finding.Start]:
    ((_, seen),) = scene.read_scenes(image, sketches, polarity, None)
    return finding.find(seen, sketches, list(fixed), Settings(), lambda share: None)[1]


def turned(line: np.ndarray, angle: float) -> np.ndarray:
    a = np.deg2rad(angle)
    middle = line.mean(0)
    return (line - middle) @ [[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]] + middle


def away(path: np.ndarray, truth: np.ndarray) -> float:
    """Largest distance of a path's points from the truth."""
    return float(np.linalg.norm(path[:, None] - truth[None], axis=2).min(1).max())


@pytest.mark.parametrize("angle", [40.0, 70.0, 90.0])
@pytest.mark.parametrize("turn", [-12.0, 0.0, 12.0])
def test_straight_on_at_a_crossing(angle, turn):
    lines = cross(angle)
    sketches = [turned(line[::20], turn) for line in lines]
    for start, line in zip(found(drawn(lines), sketches), lines, strict=True):
        assert start.found
        # Where bodies cross at a small angle the skeleton runs between them.
        assert away(start.line, line) < 2 * HALF_WIDTH
        assert away(line, start.line) < 2.5 * HALF_WIDTH


def test_the_order_of_the_sketches_changes_nothing():
    lines = cross()
    sketches = [turned(line[::20], 10) for line in lines]
    image = drawn(lines)
    one, other = found(image, sketches), found(image, sketches[::-1])[::-1]
    for a, b in zip(one, other, strict=True):
        np.testing.assert_allclose(a.line, b.line)
        assert (a.half_width, a.contrast) == pytest.approx((b.half_width, b.contrast))


def test_something_strong_does_not_draw_a_curve_away():
    line = np.column_stack([np.full(81, 20.0), np.linspace(20, 100, 81)])
    image = drawn([line])
    rows, cols = np.indices(SHAPE)
    image[np.hypot(rows - 60, cols - 60) < 18] += 50
    (start,) = found(image, [line[::40] + 1])
    assert away(start.line, line) < HALF_WIDTH


def test_where_nothing_is_the_sketch_stays_and_is_not_found():
    image = 0.1 * np.random.default_rng(1).normal(size=SHAPE)
    image[:, 110] += 20
    sketch = np.array([[20.0, 20.0], [25.0, 60.0], [20.0, 90.0]])
    ((_, seen),) = scene.read_scenes(image, [sketch], "bright", 3.0)
    (start,) = finding.find(seen, [sketch], [], Settings(), lambda _: None)[1]
    assert not start.found
    np.testing.assert_array_equal(start.line, sketch)
    (curve,) = refine(image, [sketch], polarity="bright", half_width=3.0).curves
    assert curve.status == "check"
    assert "no body was seen along its sketch" in curve.reasons
    assert away(curve.points, spline.resample(sketch, 200)) < 1


def wavy(rows: float) -> np.ndarray:
    along = np.linspace(20, 100, 81)
    return np.column_stack([rows + 6 * np.sin(along / 12), along])


def stroke(line: np.ndarray, off: float = 1.0) -> np.ndarray:
    """A line as a hand draws it: a point every px, off smoothly."""
    shaken = ndimage.gaussian_filter1d(np.random.default_rng(3).normal(size=line.shape), 12, axis=0)
    return line + off * shaken / np.sqrt((shaken**2).sum(1).mean())


def scaled(line: np.ndarray, by: float) -> np.ndarray:
    return line.mean(0) + by * (line - line.mean(0))


@pytest.mark.parametrize(
    ("sketch", "careful"),
    [
        (stroke(wavy(45.0)), True),
        (stroke(wavy(45.0))[::-1], True),
        (wavy(45.0)[::4], False),
        (wavy(45.0)[[0, -1]], False),
        (turned(wavy(45.0), 20), False),
        (wavy(51.0), False),
        (scaled(wavy(45.0), 0.7), False),
        (stroke(wavy(45.0))[38:44], False),
    ],
    ids="stroke backwards clicks straight turned shifted scaled short".split(),
)
def test_a_careful_stroke_counts_as_clicks(sketch, careful):
    image = drawn([wavy(45.0)])
    ((_, seen),) = scene.read_scenes(image, [wavy(45.0)[::8]], "bright", HALF_WIDTH)
    clicks = finding.as_clicks(sketch, seen.evidence(seen.rungs[0]), HALF_WIDTH)
    if careful:
        assert scoring.clicked(clicks)
        np.testing.assert_array_equal(clicks[[0, -1]], sketch[[0, -1]])
        assert spline.apart(clicks, wavy(45.0)).max() < 2
    else:
        assert clicks is sketch


@pytest.mark.parametrize(("length", "careful"), [(300, True), (80, False)])
def test_a_long_stroke_may_be_farther_from_its_body_and_count_as_clicks(length, careful):
    """Long bodies are seen from afar; both strokes are up to 4 px off."""
    line = np.column_stack([np.full(length + 1, 30.0), np.arange(20.0, length + 21)])
    image = np.zeros((60, length + 40))
    image[29:32, 18 : length + 23] = 1
    image = ndimage.gaussian_filter(image, 0.7)
    image += 0.03 * np.random.default_rng(0).normal(size=image.shape)
    ((_, seen),) = scene.read_scenes(image, [line[::20]], "bright", 1.5)
    sketch = line + np.column_stack([4 * np.sin(line[:, 1] / 9), np.zeros(len(line))])
    clicks = finding.as_clicks(sketch, seen.evidence(seen.rungs[0]), 1.5)
    assert scoring.clicked(clicks) == careful


def test_a_winding_stroke_gets_as_many_clicks_as_it_needs():
    along = np.linspace(15, 105, 400)
    line = np.column_stack([45 + 15 * np.sin(along / 4), along])
    image = drawn([line], half_width=2.0)
    ((_, seen),) = scene.read_scenes(image, [line[::8]], "bright", 2.0)
    sketch = stroke(line)
    clicks = finding.as_clicks(sketch, seen.evidence(seen.rungs[0]), 2.0)
    assert scoring.clicked(clicks)
    assert len(clicks) > constants.VERTICES_MOST
    assert spline.apart(sketch, spline.resample(clicks, 400)).max() < scoring.hit(2.0)


def test_a_clicked_sketch_says_itself_whether_its_body_is_bright_where_a_dark_one_is_near():
    line, others = wavy(35.0), np.column_stack([np.full(81, 80.0), np.linspace(20, 100, 81)])
    image = drawn([line]) - 6 * drawn([wavy(45.0)], noise=0.0) - drawn([others], noise=0.0)

    def told(sketch: np.ndarray) -> tuple[list[int], list[int]]:
        scenes = scene.read_scenes(image, [sketch, others[::16]], "auto", None)
        (look,) = [seen.sign for members, seen in scenes if 0 in members]
        return [look, -1], finding.signs(scenes, [sketch, others[::16]])

    look, signs = told(line[::27])
    assert (look, signs) == ([-1, -1], [1, -1])
    look, signs = told(line[[0, -1]])
    assert look == signs, "two points tell less: the path may bow to the other body"
    curve = refine(image, [line[::27], others[::16]]).curves[0]
    assert away(line[:55], curve.points) < 1


@pytest.mark.parametrize(("others", "sign"), [(1, 1), (8, -1)])
def test_the_more_bodies_are_dark_the_less_a_sketch_in_doubt_means_a_bright_one(
    monkeypatch, others, sign
):
    along = np.linspace(15, 105, 91)
    dark = [np.column_stack([np.full(91, row), along]) for row in np.linspace(30, 86, 8)]
    image = -drawn(dark, half_width=1.5)
    sketches = [np.array([[10.0, 20.0], [11.0, 60.0], [10.0, 100.0]]), *(x[::18] for x in dark)]
    scenes = scene.read_scenes(image, sketches[: 1 + others], "auto", None)
    monkeypatch.setattr(finding, "_dearer", lambda *_: -1.5 * constants.CLEAR_MARGIN)
    assert finding.signs(scenes, sketches[: 1 + others]) == [sign, *[-1] * others]


def test_a_straight_line_over_a_dark_body_beside_bright_ones_stays_there():
    rows, columns = np.mgrid[:185, :240].astype(float)
    image, places = np.zeros(rows.shape), (30, 65, 100, 135, 160)
    for row in places:
        inside = 4 - np.hypot(rows - row, np.maximum(np.abs(columns - 120) - 80, 0))
        image += (-0.5 if row == places[-1] else 1.0) * np.clip(inside, 0, 1)
    image = ndimage.gaussian_filter(image, 1) + np.random.default_rng(0).normal(0, 0.05, rows.shape)
    lines = [np.array([[row, 38.0], [row, 202.0]]) for row in places]
    curve = refine(image, lines).curves[-1]
    assert np.abs(curve.points[:, 0] - places[-1]).max() < 1, "it lies on the bright one beside"


@pytest.mark.parametrize("polarity", ["bright", "dark"])
def test_straight_lines_over_stripes_take_the_polarity_of_what_joins_their_ends(polarity):
    """Around each line bright and dark ridges are as high, as in a fingerprint."""
    row, column = np.mgrid[:160, :160]
    bow = 12 * np.sin(np.pi * column / 160)
    noise = np.random.default_rng(0).normal(0, 0.15, row.shape)
    image = np.sin(2 * np.pi * (row + bow) / 14) + noise
    ends, first = np.array([15, 145]), 45.5 if polarity == "bright" else 52.5
    lines = [np.column_stack([first + 14 * k - bow[0, ends], ends]) for k in range(5)]
    assert refine(image, lines).model.polarity == polarity


@pytest.mark.parametrize("sign", [1, -1])
def test_strokes_of_unclear_polarity_mean_what_costs_all_of_them_less(monkeypatch, sign):
    """Each alone would not cost enough less to decide."""
    image = np.random.default_rng(0).normal(0, 1, (120, 120))
    strokes = [
        np.column_stack([np.full(60, row), np.linspace(20, 100, 60)]) for row in (30.0, 60.0, 90.0)
    ]
    scenes = scene.read_scenes(image, strokes, "auto", None)
    monkeypatch.setattr(finding, "_dearer", lambda *_: -0.5 * sign * constants.CLEAR_MARGIN)
    assert finding.signs(scenes, strokes) == [sign] * 3


def thin_beside_wide(gap: int, bodies: int, bright: float) -> tuple[np.ndarray, np.ndarray]:
    """An image of thin bodies side by side near a wide and bright one, and the first of them."""
    along = np.linspace(15, 105, 91)
    thin = [np.column_stack([np.full(91, 45.0 + gap * k), along]) for k in range(bodies)]
    wide = np.column_stack([np.full(91, 65 + gap * (bodies - 1) / 2), along])
    lit = bright * drawn([wide], 5.0, noise=0.0)
    return np.maximum(drawn(thin, half_width=1.0), lit), thin[0]


@pytest.mark.parametrize(("gap", "bodies", "bright"), [(4, 3, 1), (5, 2, 2), (5, 3, 2), (8, 4, 2)])
def test_a_straight_line_on_a_thin_body_stays_there_beside_wide_and_bright_ones(
    gap, bodies, bright
):
    """Around its line, ridges are highest at the half-width of the others."""
    image, line = thin_beside_wide(gap, bodies, bright)
    (curve,) = refine(image, [line[[0, -1]]]).curves
    assert away(curve.points[10:-10], line) < 1
    assert curve.typical_half_width < 2


@pytest.mark.parametrize("given", [None, 5.0])
def test_a_half_width_that_was_given_is_kept_for_a_straight_line(given):
    image, line = thin_beside_wide(5, 3, 2)
    ((_, seen),) = scene.read_scenes(image, [line[[0, -1]]], "bright", given)
    assert (finding.sized(seen, [line[[0, -1]]]).rungs == seen.rungs) == bool(given)


def test_what_a_straight_line_costs_is_the_cost_of_a_path_between_its_ends():
    """It decides the half-width and the polarity; the path may bow where the line does not."""
    body = wavy(45.0)
    other = np.column_stack([np.full(120, 60.0), np.arange(120.0)])
    image = np.maximum(0.3 * drawn([body], 1.5, noise=0.0), drawn([other], 1.5))
    sketch = body[[0, -1]]
    ((_, seen),) = scene.read_scenes(image, [sketch], "bright", 1.5)
    cost, path = finding._cheapest(seen, sketch, seen.rungs[0])
    assert away(path, body) < 2
    assert cost < 2


def test_a_fixed_curve_keeps_its_body():
    lines = [np.column_stack([np.full(81, row), np.linspace(20, 100, 81)]) for row in (35.0, 50.0)]
    image = drawn(lines)
    for k, row in enumerate((38.5, 46.5)):
        sketch = np.array([[row, 20.0], [row, 100.0]])
        (start,) = found(image, [sketch], [lines[k]])
        assert away(start.line, lines[1 - k]) < HALF_WIDTH


def test_a_body_that_goes_on_beyond_its_sketch_is_known():
    line = np.column_stack([np.full(101, 45.0), np.linspace(10, 110, 101)])
    (start,) = found(drawn([line]), [np.array([[45.0, 10.0], [46.0, 60.0]])])
    assert start.line[-1, 1] > 100 or start.goes_on[1]
    assert not start.goes_on[0]


@pytest.mark.parametrize("first", [25.0, 33.0, 41.0])
def test_a_clicked_sketch_ends_where_it_was_clicked_on_a_body_that_goes_on(first):
    """A sketch of two points only tells the direction; five were put there one by one."""
    line = np.column_stack([np.full(120, 45.0), np.arange(120.0)])
    sketch = np.column_stack([[45.5, 44.2, 45.8, 44.6, 45.2], np.linspace(first, first + 44, 5)])
    (start,) = found(drawn([line]), [sketch])
    np.testing.assert_allclose(start.line[[0, -1], 1], sketch[[0, -1], 1], atol=2)


def test_a_clicked_end_that_is_a_little_short_of_the_tip_grows_to_it():
    line = np.column_stack([np.full(81, 45.0), np.linspace(20, 100, 81)])
    sketch = np.column_stack([[45.5, 44.2, 45.8, 44.6, 45.2], np.linspace(24, 96, 5)])
    image = drawn([line])
    (start,) = found(image, [sketch])
    assert not any(start.goes_on)
    (curve,) = refine(image, [sketch]).curves
    np.testing.assert_allclose(curve.points[[0, -1], 1], [20, 100], atol=1.5)


def arc(centre: tuple[float, float], radius: float, degrees: float) -> np.ndarray:
    """A body along a circle, open downwards."""
    turn = np.deg2rad(np.linspace(-degrees / 2, degrees / 2, 181))
    return centre + radius * np.column_stack([-np.cos(turn), np.sin(turn)])


def test_a_body_that_bows_out_is_found_from_a_line_between_its_ends(monkeypatch):
    """It is 1.8 times as long as the line, and 0.6 of the line's length away from it."""
    body = arc((50, 55), 28, 200)
    image, sketch = drawn([body], half_width=2.0), body[[0, -1]]
    (curve,) = refine(image, [sketch]).curves
    # The body as drawn has round caps of 2 px beyond the ends of its line.
    assert away(curve.points, body) < 2.5 and away(body, curve.points) < 3
    monkeypatch.setattr(constants, "GRAPH_BOW", 0.0)
    (near,) = refine(image, [sketch]).curves
    assert away(body, near.points) > 5, "within reach without it: the case tells nothing"


def test_a_curve_has_its_own_knots_whatever_its_neighbour_needs():
    wave = np.column_stack([45 + 9 * np.sin(np.linspace(0, 14, 201)), np.linspace(8, 112, 201)])
    bar = np.column_stack([np.linspace(10, 80, 81), np.full(81, 63.0)])
    sketches = [wave[::10], bar[[0, 40, -1]]]
    wavy, straight = refine(drawn([wave, bar], half_width=2.0), sketches).curves
    assert len(straight.knots) == 8 < len(wavy.knots)
    assert abs(straight.points[:, 1] - 63).max() < 0.5
    assert away(straight.points, bar) < 2.5 and away(wavy.points, wave) < 2.5, "caps of 2 px"


def test_the_middle_of_a_body_that_goes_on_is_marked():
    line = np.column_stack([np.full(120, 45.0), np.arange(120.0)])
    sketch = np.column_stack([[45.5, 44.2, 45.8, 44.6, 45.2], np.linspace(35, 80, 5)])
    (curve,) = refine(drawn([line]), [sketch]).curves
    assert "go on beyond its ends" in " ".join(curve.reasons)


def test_a_curve_that_leaves_its_path_again_stays_on_it(monkeypatch):
    """The sketch is a px aside; here any curve counts as astray, or none."""
    line = np.column_stack([np.full(81, 45.0), np.linspace(20, 100, 81)])
    sketch = np.column_stack([np.full(5, 46.2), np.linspace(17, 103, 5)])
    monkeypatch.setattr(finding.strip, "paths_along", lambda _, sketch, *__, **___: [sketch])
    monkeypatch.setattr(finding.paths, "routes_of_sketch", lambda *_: [])
    free, held = (_refined_with(monkeypatch, most, drawn([line]), sketch) for most in (99.0, -99.0))
    assert abs(free.points[10:-10, 0] - 45).max() < 0.3
    assert abs(held.points[10:-10, 0] - 46.2).max() < 0.3
    assert held.sd.min() > HALF_WIDTH / 2


def _refined_with(monkeypatch, most: float, image, sketch):
    monkeypatch.setattr(constants, "STRAYED_COST", most)
    monkeypatch.setattr(constants, "STRAYED_HW", 0.0)
    return refine(image, [sketch]).curves[0]


def test_a_curve_is_not_drawn_off_its_sketch_by_something_bright_beside_it():
    """A faint body passes a bright disc; the fit alone would bow out into it."""
    line = np.column_stack([np.full(91, 45.0), np.linspace(15, 105, 91)])
    image = drawn([line])
    rows, columns = np.indices(SHAPE)
    image[np.hypot(rows - 55, columns - 60) < 9] = 10.0
    curve = refine(image, [line[::10] + np.array([0.5, 0])]).curves[0]
    assert abs(curve.points[8:-8, 0] - 45).max() < HALF_WIDTH


def sketch_cost(line, sketch, half_width: float) -> float:
    """What a line costs where everything is body and ends."""
    lines = spline.resample(line, constants.SCORE_SAMPLES)[None]
    total = spline.arc_length(line)[-1:]
    known = scoring.features(lines, total, sketch, half_width, np.zeros((1, 1)))
    return float(scoring.cost(known)[0] - constants.PATH_WEIGHTS[0])


@pytest.mark.parametrize("scale", [0.5, 1.0, 2.5])
def test_cost_does_not_depend_on_the_scale(scale):
    sketch = np.column_stack([np.zeros(41), np.linspace(0, 80, 41)])
    path = sketch + np.column_stack([5 * np.sin(np.linspace(0, 3, 41)), np.zeros(41)])

    def cost(f: float) -> float:
        return sketch_cost(f * path, f * sketch, f * HALF_WIDTH)

    assert cost(100 * scale) == pytest.approx(cost(100.0), rel=0.02)


def test_cost_of_the_sketch_itself_is_nothing_and_grows_with_distance():
    sketch = np.column_stack([np.zeros(41), np.linspace(0, 80, 41)])
    costs = [sketch_cost(sketch + np.array([d, 0]), sketch, HALF_WIDTH) for d in (0, 2, 5, 10)]
    assert costs[0] == pytest.approx(0, abs=1e-9)
    assert costs == sorted(costs)


def test_a_line_that_was_moved_as_a_whole_keeps_its_shape():
    along = np.linspace(0, 80, 41)
    sketch = spline.resample(np.column_stack([8 * np.sin(along / 12), along]), 41)
    moved = turned(sketch, 25.0) + np.array([6.0, -3.0])
    assert scoring._reshaped(moved.T[:, :, None], sketch) < 0.01
    large = 1.5 * moved.T[:, :, None]
    assert scoring._reshaped(large, sketch, 2.0) < 0.01 < scoring._reshaped(large, sketch)
    straight = spline.resample(moved[[0, -1]], 41)
    assert scoring._reshaped(straight.T[:, :, None], sketch) > HALF_WIDTH**2
    assert scoring._reshaped(sketch.T[:, :, None], straight[[0, -1]]) == 0


@pytest.mark.parametrize("seed", [8, 12, 16, 17, 21])
def test_one_body_of_a_crowd_is_found_by_its_shape(seed):
    made = synthetic.scene(seed, bodies=3)
    sketch = synthetic.rotate(made.centrelines[0], 20.0 * (-1) ** (seed + 1))
    (curve,) = refine(made.image, [sketch]).curves
    assert average_dtw(curve.points, made.centrelines[0]) < 2


def test_a_path_along_the_sketch_bridges_gaps_and_ends_with_the_body():
    evidence = np.zeros(SHAPE)
    evidence[43:46, 20:50] = evidence[43:46, 58:100] = 1
    sketch = np.array([[47.0, 17.0], [40.0, 60.0], [46.0, 104.0]])
    [path] = strip.paths_along(evidence, sketch, 2.0, 12.0)
    assert np.abs(path[3:-3, 0] - 44).max() < 2
    assert path[[0, -1], 1] == pytest.approx([20, 99], abs=4)


def test_a_path_between_both_ends_follows_a_bow_and_does_not_run_on():
    evidence, angle = np.zeros(SHAPE), np.linspace(0, np.pi, 400)
    rows, columns = (60 - 30 * np.sin(angle)).round(), (60 - 30 * np.cos(angle)).round()
    evidence[rows.astype(int), columns.astype(int)] = evidence[60, 90:115] = 1
    evidence = ndimage.grey_dilation(evidence, 3)
    sketch = np.array([[60.0, 30.0], [60.0, 90.0]])
    path = strip.paths_along(evidence, sketch, 2.0, 40.0, between_ends=True)[-1]
    assert np.abs(path[[0, -1]] - sketch).max() < 1
    assert abs(np.hypot(path[:, 0] - 60, path[:, 1] - 60) - 30).max() < 3


@pytest.mark.parametrize("aside", [1.0, 9.0])
def test_a_path_leaves_a_clicked_sketch_only_where_nothing_is_seen_near_it(monkeypatch, aside):
    """A body is in the dark for half of its length, and beside it runs one that is not."""
    monkeypatch.setattr(finding.paths, "routes_of_sketch", lambda *_: [])
    line = np.column_stack([45 + 4 * np.sin(np.linspace(0, 5, 81)), np.linspace(20, 100, 81)])
    there = [line[:20], line[60:], np.add(line, [9.0, 0.0])] if aside < HALF_WIDTH else [line]
    (start,) = found(drawn(there), [np.add(line[::16], [aside, 0.0])])
    assert away(start.line[8:-8], line) < HALF_WIDTH


def test_a_clicked_sketch_is_not_left_for_a_body_of_another_shape(monkeypatch):
    """Its own body is in the dark, and beside it runs one that is not."""
    monkeypatch.setattr(finding.paths, "routes_of_sketch", lambda *_: [])
    along, wave = np.linspace(20, 100, 81), np.sin(np.linspace(0, 5, 81))
    line, other = (np.column_stack([row, along]) for row in (45 + 4 * wave, 53 - 2 * wave))
    (start,) = found(drawn([other]), [line[::16]])
    assert away(start.line, line) < HALF_WIDTH


@pytest.mark.parametrize("seed", [5, 6, 9])
def test_a_line_drawn_too_short_still_means_the_whole_body(seed):
    made = synthetic.scene(seed, bodies=2)
    sketches = [perturbations.scale(line, 0.6) for line in made.centrelines]
    for curve, line in zip(refine(made.image, sketches).curves, made.centrelines, strict=True):
        assert average_dtw(curve.points, line) < 2


@pytest.mark.parametrize("first", [0, 15])
def test_a_straight_line_means_the_part_between_its_ends(first: int):
    """Beyond one of them, or both, the body goes on; a stroke over it all means all of it."""
    line = np.column_stack([45 + 6 * np.sin(np.arange(101) / 16), np.arange(10.0, 111)])
    image, part = drawn([line]), line[first : first + 70]
    straight, whole = (refine(image, [s]).curves[0] for s in (part[[0, -1]], line[::5]))
    assert np.linalg.norm(straight.points[[0, -1]] - part[[0, -1]], axis=1).max() < 3
    assert np.linalg.norm(whole.points[[0, -1]] - line[[0, -1]], axis=1).max() < 3


def test_routes_run_on_from_the_nearest_and_none_repeats_a_piece():
    image = drawn(cross())
    graph = tracing.trace(ndimage.gaussian_filter(image, 1) > 0.5, HALF_WIDTH)
    sketch = cross()[0][::20]
    unseen = np.zeros(len(graph.pieces))
    routes = paths.routes_of_sketch(graph, unseen, sketch, HALF_WIDTH, 40.0, 5.0)
    assert len(routes) > 10
    assert all(len({step >> 1 for step in r}) == len(r) for r in routes)
    sampled, total = paths.sampled(graph, routes, 20)
    for route, points, length in zip(routes[:20], sampled, total, strict=False):
        line = paths.polyline(graph, route)
        assert spline.arc_length(line)[-1] == pytest.approx(length, rel=0.05, abs=1)
        assert away(points, line) < 2


def test_no_pieces_no_routes():
    graph = tracing.trace(np.zeros(SHAPE, bool), HALF_WIDTH)
    sketch = cross()[0][::20]
    assert paths.routes_of_sketch(graph, np.zeros(0), sketch, HALF_WIDTH, 40.0, 5.0) == []


def test_two_sketches_do_not_take_one_body():
    lines = [np.column_stack([np.full(81, row), np.linspace(20, 100, 81)]) for row in (38.0, 52.0)]
    sketches = [np.array([[row, 20.0], [row, 100.0]]) for row in (43.0, 53.0)]
    curves = refine(drawn(lines), sketches).curves
    for curve, line in zip(curves, lines, strict=True):
        assert np.abs(curve.points[:, 0] - line[0, 0]).max() < 0.3


def test_a_sketch_that_is_right_already_keeps_its_body():
    """A brighter body that runs beside it for a while does not take it away."""
    line = np.column_stack([40 + 4 * np.sin(np.linspace(0, 3, 81)), np.linspace(20, 100, 81)])
    other = np.column_stack([np.linspace(20, 56, 81), np.linspace(30, 100, 81)])
    image = np.maximum(0.4 * drawn([line]), drawn([other]))
    sketch = line[::16] + np.random.default_rng(0).normal(0, 1, (6, 2))
    (start,) = found(image, [sketch])
    assert away(start.line, line) < 2
    assert away(line, start.line) < 2


@pytest.mark.parametrize(
    ("aside", "rim", "off"),
    [
        *((5.0, 1.0, 0.0), (6.0, 1.0, 0.0), (5.0, 1.0, 1.5), (6.0, 1.0, 1.5)),
        *((7.0, 1.5, 2.5), (7.0, 1.0, 4.0), (8.0, 1.0, 4.0)),
    ],
)
def test_a_clicked_line_stays_in_the_middle_of_a_hollow_body(monkeypatch, aside, rim, off):
    """Without the search between rims, or another half-width, its curve lies on one of them.

    Rims that are broad and near to the line stand out at half-widths of their own.
    """
    line = cross(0.0)[0]
    rims = drawn([np.add(line, [side, 0.0]) for side in (-aside, aside)], half_width=rim)
    image = np.maximum(rims, 0.15 * drawn([line], half_width=aside, noise=0.0))
    sketch = np.add(line[::16], [off, 0.0])
    (curve,) = refine(image, [sketch]).curves
    assert away(curve.points[10:-10], line) < 1.5
    assert np.median(curve.half_width) > 0.6 * aside
    monkeypatch.setattr(hollow, "_between_rims", lambda *_: False)
    monkeypatch.setattr(finding, "sized", lambda seen, _: seen)
    (curve,) = refine(image, [sketch], polarity="bright").curves
    assert away(curve.points[10:-10], line) > 3


def test_a_faint_body_between_two_that_are_sketched_is_not_a_hollow_one(monkeypatch):
    line = cross(0.0)[0]
    sides = [np.add(line, [side, 0.0]) for side in (-8.0, 8.0)]
    image = np.maximum(drawn(sides), 0.15 * drawn([line], noise=0.0))
    sketches = [x[::16] for x in (line, *sides)]
    curve = refine(image, sketches, polarity="bright").curves[0]
    assert away(curve.points[5:-5], line) < 1
    assert curve.typical_half_width == pytest.approx(HALF_WIDTH, rel=0.2)
    monkeypatch.setattr(hollow, "_along", lambda *_: False)
    assert found(image, sketches, polarity="bright")[0].half_width > 2 * HALF_WIDTH


@pytest.mark.parametrize(("points", "half_width", "mesh"), [(2, 5, 12), (4, 5, 12), (2, 6, 9)])
def test_a_wide_body_in_a_mesh_of_thin_ones_is_found(points, half_width, mesh):
    """Most ridges around its line are thin and higher, as those of the side veins of a leaf."""
    line = np.column_stack([np.linspace(8, 82, 100), np.linspace(15, 105, 100)])
    veins = [np.column_stack([np.full(120, row), np.arange(120)]) for row in range(4, 90, mesh)]
    veins += [np.column_stack([np.arange(90), np.full(90, col)]) for col in range(4, 120, mesh)]
    beside = drawn([line], half_width=half_width + 2, noise=0.0) < 0.1
    thin = beside * drawn(veins, half_width=1.0, noise=0.0)
    sketch = np.add(line[:: 99 // (points - 1)], [2.0, -1.0])
    (curve,) = refine(drawn([line], half_width=half_width) + 2 * thin, [sketch]).curves
    assert away(line[5:-5], curve.points) < 2
    assert np.median(curve.half_width) == pytest.approx(half_width, rel=0.2)


def test_a_body_is_not_wider_than_the_ridges_along_it():
    """A path of a larger half-width than its own costs little along the third stalk."""
    assert refined("flower_buds")[2].typical_half_width == pytest.approx(8, rel=0.2)


def test_a_line_of_one_stroke_or_of_two_points_is_not_taken_at_its_word():
    line = cross(0.0)[0]
    assert scoring.clicked(line[::10])
    assert not scoring.clicked(line)
    assert not scoring.clicked(line[::80])


def test_a_sketch_between_two_bodies_may_mean_either_and_one_beside_a_body_means_that():
    bodies = [np.add(cross(0.0)[0], [side, 0.0]) for side in (-9.0, 9.0)]
    sketch = cross(0.0)[0][::80]
    (between,), (beside,) = (found(drawn(b), [sketch], polarity="bright")
                             for b in (bodies, bodies[:1]))  # fmt: skip
    assert between.margin < 2 < beside.margin


def refined(name):
    """The curves of a real image, from its sketches."""
    folder = Path(__file__).parents[1] / "data" / "real" / name
    image = io.imread(next(folder.glob("image.*"))).astype(float)
    image = image.mean(2) if image.ndim == 3 else image
    ((_, sketches),) = json.loads((folder / "sketches.json").read_text()).items()
    return refine(image, [np.array(line) for line in sketches]).curves


def turns(points):
    """How sharply a polyline turns at each of its points, rad."""
    step = np.diff(points, axis=0)
    return np.abs(np.diff(np.unwrap(np.arctan2(step[:, 1], step[:, 0]))))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["flower_stems", "retina_rim"])
def test_no_curve_folds_over_itself(name):
    """It never turns back within a half-width, also where other bodies branch off.

    Within two half-widths of its tips it may hook: see docs/limits.md.
    """
    for curve in refined(name):
        count = round(curve.length / np.median(curve.half_width))
        assert turns(spline.resample(curve.points, count))[2:-2].max() < np.pi / 2


def test_no_curve_kinks_where_its_knots_crowd():
    """As in bodies that are wide beside the distance of their knots, and not smoothly bright."""
    good = [curve for curve in refined("bacteria") if curve.status == "good"]
    assert len(good) > 8
    assert max(turns(curve.points).max() for curve in good) < 0.5
