"""Bodies side by side of which not all have a sketch, and short stiff ones."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial import KDTree

from napari_splinesketch import refine
from napari_splinesketch.engine.find import finding, neighbours
from napari_splinesketch.engine.fit.fit_scene import knots_needed
from napari_splinesketch.engine.look import scene
from napari_splinesketch.engine.settings import Settings
from napari_splinesketch.engine.types import Line

CENTRE = np.array([60.0, 70.0])
SHAPE = (120, 140)
CLICKS = [2, 28, 54, 78]


def drawn(lines: list[Line], half_width: float) -> np.ndarray:
    """Flat bodies with blurred edges."""
    grid = np.indices(SHAPE).reshape(2, -1).T
    apart = np.min([KDTree(line).query(grid)[0] for line in lines], axis=0).reshape(SHAPE)
    image = ndimage.gaussian_filter((apart < half_width).astype(float), 0.7)
    return image + 0.03 * np.random.default_rng(0).normal(size=SHAPE)


def side_by_side(half_width: float, gap: float, seed: int, count: int = 3) -> list[Line]:
    """Straight bodies, 50 px long, a gap apart."""
    rng, turn = np.random.default_rng(seed), 0.3 * seed
    along = np.linspace(-25, 25, 81)[:, None]
    ahead, aside = np.array([[np.sin(turn), np.cos(turn)], [np.cos(turn), -np.sin(turn)]])
    places = np.arange(count) - (count - 1) / 2
    return [
        CENTRE + k * (2 * half_width + gap) * aside + (along + rng.uniform(-8, 8)) * ahead
        for k in places
    ]


def without(image: np.ndarray, sketches: list[Line], fixed: list[Line]) -> tuple[np.ndarray, ...]:
    """The image as bodies are looked for in it, and without those that have no sketch."""
    ((_, seen),) = scene.read_scenes(image, sketches, "bright", None)
    seen, starts = finding.find(seen, sketches, fixed, Settings(), lambda _: None)
    return seen.normal, neighbours.without_neighbours(seen, starts, fixed).normal


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize(("half_width", "count"), [(4.0, 3), (4.0, 5), (5.0, 3), (5.0, 5)])
def test_one_of_a_pack_stays_as_wide_as_it_is(half_width: float, count: int, seed: int):
    lines = side_by_side(half_width, 1.0, seed, count)
    line = lines[count // 2]
    (curve,) = refine(drawn(lines, half_width), [line[CLICKS]]).curves
    assert np.median(curve.half_width) == pytest.approx(half_width, rel=0.2)
    assert np.median(KDTree(line).query(curve.points)[0]) < 1


def test_bodies_with_sketches_and_fixed_curves_stay_in_the_image():
    lines = side_by_side(4.0, 2.0, seed=1)
    image, sketches = drawn(lines, 4.0), [line[CLICKS] for line in lines]
    for drawn_anew, fixed in ((sketches, []), (sketches[1:2], [lines[0], lines[2]])):
        before, after = without(image, drawn_anew, fixed)
        assert np.array_equal(before, after)
    before, after = without(image, sketches[1:2], [])
    left, mine, right = ((after < before)[tuple(np.rint(x[20:60]).astype(int).T)] for x in lines)
    assert left.mean() > 0.5
    assert right.mean() > 0.5
    assert not mine.any()


def test_the_other_leg_of_a_hairpin_is_its_own():
    angle, leg = np.linspace(0, np.pi, 40), np.linspace(40, 0, 40)
    there, bend = np.column_stack([np.full(40, 5.0), -leg]), [5 * np.cos(angle), 5 * np.sin(angle)]
    line = np.concatenate([there, np.transpose(bend), there[::-1] * [-1, 1]]) + CENTRE
    before, after = without(drawn([line], 3.0), [line[::12]], [])
    assert np.array_equal(before, after)


def test_the_rims_of_a_hollow_body_are_its_own():
    """Also where the fit is to begin with a half-width that does not reach them."""
    (line,) = side_by_side(6.0, 0.0, seed=1, count=1)
    image = drawn([line], 6.0) - 0.8 * drawn([line], 3.5)
    ((_, seen),) = scene.read_scenes(image, [line[CLICKS]], "bright", None)
    seen, (start,) = finding.find(seen, [line[CLICKS]], [], Settings(), lambda _: None)
    for half_width in (2.5, 6.0):
        begun = replace(start, line=line, half_width=half_width)
        assert (
            neighbours.without_neighbours(seen, [begun], []).normal.tolist() == seen.normal.tolist()
        )


def test_a_short_body_gets_few_knots_unless_it_bends():
    straight = np.linspace((10.0, 10.0), (10.0, 50.0), 50)
    bent = straight + 5.0 * np.sin(np.linspace(0, 3 * np.pi, 50))[:, None] * [1, 0]
    allowed = Settings().knots
    assert knots_needed(straight, 4.0, allowed) == 4
    assert knots_needed(straight, 2.0, allowed) == 8, "a slender one of that length"
    assert knots_needed(bent, 4.0, allowed) > 4
    assert knots_needed(straight, 4.0, (12,)) == 12


@pytest.mark.parametrize("seed", [1, 2])
def test_a_straight_rod_gets_a_straight_curve(seed: int):
    rng = np.random.default_rng(seed)
    turn = rng.uniform(0, np.pi)
    line = CENTRE + np.linspace(-17, 17, 81)[:, None] * [np.sin(turn), np.cos(turn)]
    (curve,) = refine(drawn([line], 5.0), [line[CLICKS] + rng.normal(0, 0.7, (4, 2))]).curves
    steps = np.diff(curve.points, axis=0)
    turns = np.diff(np.unwrap(np.arctan2(*steps.T)))
    assert np.rad2deg(np.abs(turns).sum()) < 25


def test_a_careful_stroke_over_one_rod_of_a_chain_counts_as_clicks():
    """If it ends within the error of a click, and not where it reaches for the next one."""
    ahead = np.array([0.0, 1.0])
    rods = [CENTRE + np.linspace(-12 + k, 12 + k, 81)[:, None] * ahead for k in (-34, 0, 34)]
    image = drawn(rods, 3.0)
    for beyond, careful in ((-1.0, True), (4.0, False)):
        stroke = CENTRE + np.linspace(-14 - beyond, 14 + beyond, 20)[:, None] * ahead
        ((_, seen),) = scene.read_scenes(image, [stroke], "bright", None)
        clicks = finding.as_clicks(stroke, seen.evidence(seen.rungs[0]), 3.0)
        assert (len(clicks) < len(stroke)) == careful
