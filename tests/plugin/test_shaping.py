"""Cutting, joining, lengthening and turning curves."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from napari_splinesketch import editing as shaping
from napari_splinesketch.engine import spline
from napari_splinesketch.engine.types import Curve

from .fakes import as_drawn, winding

KNOTS = 9


def bent(bend: float = 6.0, slope: float = 0.4, length: float = 80.0) -> Curve:
    """A curve like a wave, whose half-width falls from 3 to 1 px."""
    x = np.linspace(0, length, KNOTS)
    knots = np.column_stack([slope * x + bend * np.sin(x / 15), x, np.linspace(3, 1, KNOTS)])
    points = spline.sample(knots, 100)
    return Curve(knots, points[:, :2], points[:, 2], np.linspace(0.1, 0.2, 100), "good", (), 0.05)


LONG = replace(bent(), **winding())
curves = st.builds(bent, st.floats(-8, 8), st.floats(-2, 2), st.floats(40, 200))


def same(a: Curve, b: Curve) -> None:
    for name in ("knots", "points", "half_width", "sd"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))


@given(curves)
def test_turning_twice_changes_nothing(curve: Curve) -> None:
    turned = shaping.flipped(curve)
    np.testing.assert_array_equal(turned.points[0], curve.points[-1])
    assert turned.half_width[0] == curve.half_width[-1]
    assert turned.sd[0] == curve.sd[-1]
    assert (turned.status, turned.reasons) == (curve.status, curve.reasons)
    same(shaping.flipped(turned), curve)


@given(curves, st.integers(20, 80))
def test_pieces_make_the_whole(curve: Curve, at: int) -> None:
    first, second = shaping.split(curve, at)
    np.testing.assert_allclose(first.points[0], curve.points[0], atol=0.05)
    np.testing.assert_allclose(first.points[-1], curve.points[at], atol=0.05)
    np.testing.assert_allclose(second.points[0], curve.points[at], atol=0.05)
    np.testing.assert_allclose(second.points[-1], curve.points[-1], atol=0.05)
    assert first.length + second.length == pytest.approx(curve.length, rel=0.01)
    np.testing.assert_allclose(first.half_width[-1], second.half_width[0], atol=0.05)
    assert first.reasons == second.reasons == (shaping.BY_HAND,)
    whole = shaping.joined(first, second)
    assert np.abs(whole.points - curve.points).max() < 1.0
    np.testing.assert_allclose(whole.half_width, curve.half_width, atol=0.15)


@pytest.mark.parametrize("turn", ["", "first", "second", "both"])
def test_two_are_joined_by_their_nearest_ends(turn: str) -> None:
    curve = bent()
    first, second = shaping.split(curve, 40)
    if turn in ("first", "both"):
        first = shaping.flipped(first)
    if turn in ("second", "both"):
        second = shaping.flipped(second)
    whole = shaping.joined(first, second)
    expected = curve.points if turn in ("", "second") else curve.points[::-1]
    np.testing.assert_allclose(whole.points[[0, -1]], expected[[0, -1]], atol=0.1)


def test_what_is_cut_joined_or_lengthened_stays_where_it_is() -> None:
    x = np.array([0.0, 8, 20, 28, 40, 46, 60, 71, 80])  # as knots are that were fitted: uneven
    knots = np.column_stack([6 * np.sin(x / 15), x, np.full(KNOTS, 2.0)])
    curve = replace(bent(), knots=knots, points=spline.sample(knots[:, :2], 100))
    pieces = shaping.split(curve, 55)
    longer = shaping.extended(curve, True, 4.0)
    for made in (pieces, [shaping.joined(*pieces)], [longer]):
        along = np.concatenate([spline.resample(each.points, 2000) for each in made])
        assert spline.apart(curve.points, along).max() < 0.05


@pytest.mark.parametrize("turned", [False, True])
def test_two_that_lie_over_each_other_do_not_fold(turned: bool) -> None:
    curve = bent()
    first, second = shaping.split(curve, 60)[0], shaping.split(curve, 40)[1]
    whole = shaping.joined(first, shaping.flipped(second) if turned else second)
    assert whole.length == pytest.approx(curve.length, rel=0.01)
    assert np.abs(whole.points - curve.points).max() < 1.0


def test_a_long_winding_curve_keeps_its_shape() -> None:
    line = spline.fine(LONG).points

    def off(*made: Curve) -> float:
        lines = [spline.fine(one).points for one in made]
        return float(np.min([spline.apart(line, each) for each in lines], axis=0).max())

    first, second = shaping.split(LONG, 50)
    assert off(first, second) < 2.0, "px, of bends of 40"
    assert off(shaping.joined(first, second)) < 2.0
    assert off(shaping.extended(LONG, True, 5.0)) < 2.0


@given(curves, st.booleans(), st.floats(2, 12))
def test_an_end_goes_on_along_its_tangent(curve: Curve, at_end: bool, by: float) -> None:
    made = shaping.extended(curve, at_end, by)
    assert made.length == pytest.approx(curve.length + by, rel=0.03)
    new, old = (-1, 0) if at_end else (0, -1)
    np.testing.assert_allclose(made.points[old], curve.points[old], atol=0.05)
    beyond = made.points[new] - curve.points[new]
    inner = curve.points[new] - curve.points[-4 if at_end else 3]
    cosine = beyond @ inner / np.linalg.norm(beyond) / np.linalg.norm(inner)
    assert cosine > 0.99
    assert np.linalg.norm(beyond) == pytest.approx(by, rel=0.05)


@given(curves, st.integers(0, KNOTS - 1), st.floats(-9, 9), st.floats(-9, 9))
def test_a_knot_that_moves_takes_the_curve_along(
    curve: Curve, knot: int, down: float, right: float
) -> None:
    knots = curve.knots[:, :2].copy()
    knots[knot] += (down, right)
    made = shaping.moved(curve, knots)
    np.testing.assert_array_equal(made.knots[:, :2], knots)
    np.testing.assert_array_equal(made.knots[:, 2], curve.knots[:, 2])
    np.testing.assert_array_equal(made.half_width, curve.half_width)
    dense = spline.basis(KNOTS, np.linspace(0, 1, 8000)) @ knots
    apart = np.linalg.norm(made.points[:, None] - dense[None], axis=2).min(axis=1)
    assert apart.max() < 0.1, "the natural cubic spline through the knots"
    assert made.status == "check"


def test_with_a_knot_less() -> None:
    curve = bent()
    made = shaping.moved(curve, np.delete(curve.knots[:, :2], 4, axis=0))
    assert len(made.knots) == KNOTS - 1
    np.testing.assert_allclose(made.knots[[0, -1], 2], (3, 1))


def test_pieces_that_are_too_short() -> None:
    with pytest.raises(ValueError, match="farther from the end"):
        shaping.split(bent(), 2)


def test_the_nearest_point() -> None:
    curve = bent()
    assert shaping.nearest(curve, curve.points[33] + 1e-3)[0] == 33
    assert shaping.nearest(curve, curve.points[0] - (0, 5))[1] == pytest.approx(5)


def test_the_width_of_a_body() -> None:
    curve = bent()
    assert shaping.body_width(curve) == pytest.approx(4, abs=0.2)


def test_where_one_of_two_has_no_width_it_is_that_of_the_other() -> None:
    one, two = shaping.split(bent(), 40)
    unknown = replace(
        one, half_width=np.full(100, np.nan), knots=one.knots * [1, 1, np.nan], status="failed"
    )
    whole = shaping.joined(unknown, two)
    assert np.isfinite(whole.half_width).all()
    assert np.isfinite(whole.knots).all()


@pytest.mark.parametrize(
    ("name", "given", "reason"),
    [
        ("moved", [[[0, 0], [np.nan, 1]]], "knots has numbers that are not finite"),
        ("moved", [np.zeros((5, 3))], r"knots has shape \(5, 3\); give \(N, 2\)"),
        ("moved", [[[1, 2]]], "knots has 1 row; a curve needs two or more"),
        ("nearest", [[1]], r"point is \[1\]; give one place"),
        ("nearest", [[np.nan, 2]], "give one place"),
        ("split", [100], "at is 100; give the number of a point, from 0 to 99"),
        ("split", [-1], "at is -1; give"),
        ("extended", [True, -2], "by is -2; give a length above 0"),
        ("extended", [False, np.nan], "by is nan; give a length above 0"),
    ],
)
def test_nonsense_is_refused_in_words(name: str, given: list[object], reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        getattr(shaping, name)(bent(), *given)


@pytest.mark.parametrize(
    "curve", [as_drawn(np.array([[5.0, 0], [5, 2000]])), LONG], ids=["straight", "winding"]
)
def test_a_long_curve_is_near_between_its_points(curve: Curve) -> None:
    places = spline.resample(spline.fine(curve).points, 499)
    assert max(shaping.nearest(curve, place)[1] for place in places) < 1.0
