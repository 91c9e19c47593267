"""Distances between curves, against hand-made truths."""

import numpy as np
import pytest

from napari_splinesketch import metrics

LINE = np.stack([np.full(50, 20.0), np.linspace(10.0, 110.0, 50)], axis=1)
ARC = 40 * np.stack([np.sin(t := np.linspace(0, np.pi, 60)), np.cos(t)], axis=1)
WAVE = np.stack([8 * np.sin(t := np.linspace(0, 7, 80)), 15 * t], axis=1)


def moved(rows: float, columns: float) -> np.ndarray:
    return LINE + np.array([rows, columns])


def slow_dtw(a: np.ndarray, b: np.ndarray) -> float:
    """Average DTW of two resampled curves by the textbook's double loop."""
    cost = np.linalg.norm(a[:, None] - b[None], axis=2)
    n, m = cost.shape
    best = np.full((n + 1, m + 1), np.inf)
    cells = np.zeros((n + 1, m + 1), dtype=int)
    best[0, 0] = 0
    for i in range(1, n + 1):
        for j in range(1, m + 1):
            before = min([(i - 1, j - 1), (i - 1, j), (i, j - 1)], key=lambda p: best[p])
            best[i, j] = cost[i - 1, j - 1] + best[before]
            cells[i, j] = cells[before] + 1
    return float(best[-1, -1] / cells[-1, -1])


@pytest.mark.parametrize(
    "curve", [LINE, ARC, WAVE, LINE[[0, -1]]], ids=["line", "arc", "wave", "2"]
)
def test_resampled_points_are_uniform_and_keep_the_ends(curve):
    even = metrics.resample(curve, 37)
    steps = np.linalg.norm(np.diff(even, axis=0), axis=1)
    assert even.shape == (37, 2)
    np.testing.assert_allclose(steps, steps.mean(), rtol=2e-3)
    np.testing.assert_allclose(even[[0, -1]], curve[[0, -1]], atol=1e-9)


def test_resampling_is_cubic():
    radii = np.linalg.norm(metrics.resample(ARC[::6], 200), axis=1)
    np.testing.assert_allclose(radii, 40, atol=0.1)  # chords between them would sag by 2 px


def test_repeated_vertices_are_dropped():
    doubled = np.repeat(WAVE, 2, axis=0)
    np.testing.assert_allclose(metrics.resample(doubled), metrics.resample(WAVE), atol=1e-9)


def test_single_point_is_refused():
    with pytest.raises(ValueError, match="two distinct points"):
        metrics.resample(np.ones((5, 2)))


NONSENSE = {
    "not finite": (np.where(np.eye(50, 2), np.nan, LINE), "has numbers that are not finite"),
    "masked": (np.ma.masked_less(LINE, 15), "has numbers that are not finite"),
    "empty": (np.zeros((0, 2)), r"has shape \(0, 2\); give \(N, 2\)"),
    "three columns": (np.zeros((5, 3)), r"has shape \(5, 3\); give \(N, 2\)"),
    "text": ("x", r"is 'x'; give \(N, 2\) numbers"),
    "ragged": ([[1, 2], [3]], r"is \[\[1, 2\], \[3\]\]; give"),
}


@pytest.mark.parametrize(("line", "reason"), NONSENSE.values(), ids=NONSENSE)
def test_what_is_no_line_is_refused_in_words(line, reason: str):
    for measure in (metrics.average_dtw, metrics.normal_distance, metrics.end_error):
        for pair in ((line, LINE), (LINE, line)):
            with pytest.raises(ValueError, match=f"curve {reason}"):
                measure(*pair)
    with pytest.raises(ValueError, match=f"curve 1 {reason}"):
        metrics.match([LINE, line], [LINE])
    with pytest.raises(ValueError, match=f"truth 0 {reason}"):
        metrics.match([LINE], [line])


@pytest.mark.parametrize("n", [0, -1, 2.5, None])
def test_a_number_of_points_that_cannot_be_is_refused(n):
    with pytest.raises(ValueError, match="give a whole number of points"):
        metrics.resample(LINE, n)


def test_dtw_of_a_line_moved_sideways_is_the_displacement():
    assert metrics.average_dtw(LINE, moved(3.5, 0)) == pytest.approx(3.5)


def test_dtw_of_a_line_moved_along_itself_counts_only_the_ends():
    # 4 px along a 100 px line: the middle warps onto itself, each end is 0-4 px off.
    distance = metrics.average_dtw(LINE, moved(0, 4))
    assert 0.1 < distance < 0.5


@pytest.mark.parametrize("curve", [LINE, ARC, WAVE], ids=["line", "arc", "wave"])
def test_dtw_ignores_orientation_and_sampling(curve):
    assert metrics.average_dtw(curve, curve[::-1]) == pytest.approx(0, abs=1e-9)
    assert metrics.average_dtw(curve, metrics.resample(curve, 333)) < 1e-3


@pytest.mark.parametrize("seed", range(4))
def test_dtw_agrees_with_the_textbook(seed):
    rng = np.random.default_rng(seed)
    a, b = np.cumsum(rng.normal(1, 1, (2, 12, 2)), axis=1) * 5
    p, q = metrics.resample(a), metrics.resample(b)
    expected = min(slow_dtw(p, q), slow_dtw(p, q[::-1]))
    assert metrics.average_dtw(a, b) == pytest.approx(expected, rel=1e-9)
    assert metrics.average_dtw(b, a) == pytest.approx(expected, rel=1e-6)


def test_normal_distance_of_a_line_ignores_movement_along_it():
    assert metrics.normal_distance(moved(2, 7), LINE) == pytest.approx(2)


def test_normal_distance_of_concentric_arcs():
    assert metrics.normal_distance(ARC * 1.05, ARC) == pytest.approx(2, rel=1e-2)


def test_points_beyond_an_end_do_not_count():
    distances = metrics.normal_distances(moved(0, 20), LINE)
    np.testing.assert_array_equal(np.isnan(distances), np.linspace(30, 130, 100) >= 110)
    assert np.isnan(metrics.normal_distance(moved(0, 300), LINE))


def test_end_error_takes_the_better_orientation():
    curve = moved(3, 4)
    assert metrics.end_error(curve, LINE) == pytest.approx(5)
    assert metrics.end_error(curve[::-1], LINE) == pytest.approx(5)


def test_match_finds_who_is_who():
    truths = [LINE, moved(15, 0), moved(60, 0)]
    curves = [truths[1] + [0.5, 0], moved(200, 0), truths[0] - [1, 0]]
    found = metrics.match(curves, truths)
    np.testing.assert_array_equal(found.pairs, [[0, 1], [2, 0]])
    np.testing.assert_allclose(found.distances, [0.5, 1.0])
    assert (found.precision, found.recall) == (2 / 3, 2 / 3)


def test_match_prefers_the_smallest_sum_and_respects_the_tolerance():
    truths = [LINE, moved(1.5, 0)]
    curves = [moved(1.0, 0), moved(3.0, 0)]
    np.testing.assert_array_equal(metrics.match(curves, truths).pairs, [[0, 0], [1, 1]])
    np.testing.assert_array_equal(metrics.match(curves, truths, tolerance=0.6).pairs, [[0, 1]])
    for tolerance in (-1, np.nan, np.inf):
        with pytest.raises(ValueError, match="give a distance from 0"):
            metrics.match(curves, truths, tolerance=tolerance)


def test_a_line_without_a_length_is_in_no_pair():
    dot = LINE[[3, 3]]
    found = metrics.match([dot, LINE], [LINE, dot])
    np.testing.assert_array_equal(found.pairs, [[1, 0]])
    assert (found.precision, found.recall) == (0.5, 0.5)


def test_match_with_nothing_to_match():
    assert metrics.match([], [LINE]).recall == 0
    assert metrics.match([LINE], []).precision == 0
    assert metrics.match([], []).precision == 1
