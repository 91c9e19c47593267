"""Which path a sketch means, on graphs whose answer is known."""

import numpy as np
import pytest

from napari_splinesketch import synthetic
from napari_splinesketch.engine.find import choice, smooth_paths, tracing

HALF_WIDTH = 3.0
CENTRE = np.array([45.0, 60.0])


def cross(angle: float = 70.0) -> list[np.ndarray]:
    """Two straight bodies, 80 px long, that cross at an angle in degrees."""
    turns = np.deg2rad([-angle / 2, angle / 2])
    along = np.linspace(-40, 40, 81)[:, None]
    return [CENTRE + along * [np.sin(t), np.cos(t)] for t in turns]


def graph_of(lines: list[np.ndarray], shape=(90, 120), half_width=HALF_WIDTH) -> tracing.TraceGraph:
    grid = np.indices(shape).reshape(2, -1).T
    apart = np.min([np.linalg.norm(grid[:, None] - p, axis=2).min(1) for p in lines], axis=0)
    return tracing.trace((apart < half_width).reshape(shape), half_width)


def away(path: np.ndarray, truth: np.ndarray) -> float:
    """Largest distance of a path's points from the truth."""
    return float(np.linalg.norm(path[:, None] - truth[None], axis=2).min(1).max())


@pytest.fixture(scope="module")
def graph() -> tracing.TraceGraph:
    return graph_of(cross())


def paths(graph: tracing.TraceGraph, sketch: np.ndarray, keep: int = 40) -> smooth_paths.Paths:
    return smooth_paths.candidate_paths(graph, sketch, HALF_WIDTH, 3000, keep)


@pytest.mark.parametrize("angle", [40.0, 70.0, 90.0])
@pytest.mark.parametrize("body", [0, 1])
def test_straight_on_at_a_crossing(angle, body):
    lines = cross(angle)
    found = paths(graph_of(lines), lines[body][::20])
    best = found.points[0]
    # Where bodies cross at a small angle the skeleton runs between them.
    assert away(best, lines[body]) < 2 * HALF_WIDTH
    assert away(lines[body], best) < 2.5 * HALF_WIDTH


@pytest.mark.parametrize("turn", [-15.0, 15.0])
def test_straight_on_from_a_turned_sketch(graph, turn):
    lines = cross()
    best = paths(graph, synthetic.rotate(lines[0], turn)).points[0]
    assert away(best, lines[0]) < HALF_WIDTH


def test_straight_on_is_cheaper_than_around_the_bend():
    lines = cross()
    bent = np.concatenate([lines[0][:41], lines[1][41:]])
    straight = lines[0]
    between = (straight + bent) / 2
    costs = [smooth_paths.path_cost(p, between, HALF_WIDTH) for p in (straight, bent)]
    assert costs[0] < costs[1]


def test_candidates_are_sorted_and_run_as_the_sketch(graph):
    sketch = cross()[0]
    found = paths(graph, sketch)
    assert 1 < len(found.points) == len(found.cost) == len(found.covers) <= 40
    assert (np.diff(found.cost) >= 0).all()
    assert len(np.unique(found.covers, axis=0)) > len(found.covers) / 2
    for covers, path in zip(found.covers, found.points, strict=True):
        length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
        assert length == pytest.approx(graph.lengths[covers].sum(), rel=1e-6)
    best = found.points[0]
    assert (best[-1] - best[0]) @ (sketch[-1] - sketch[0]) > 0
    back = paths(graph, sketch[::-1]).points[0]
    assert away(back, best) < HALF_WIDTH
    assert (back[-1] - back[0]) @ (sketch[-1] - sketch[0]) < 0


def test_fewer_candidates_are_the_cheapest(graph):
    sketch = cross()[1]
    few, many = (paths(graph, sketch, keep) for keep in (4, 40))
    assert len(few.cost) == 4
    assert few.cost[0] == many.cost[0]


def test_nothing_near_means_no_candidates(graph):
    sketch = np.array([[800.0, 800.0], [800.0, 880.0]])
    found = paths(graph, sketch)
    assert found.points == ()
    assert found.covers.shape == (0, len(graph.pieces))
    empty = tracing.trace(np.zeros((30, 40), bool), HALF_WIDTH)
    assert paths(empty, cross()[0]).points == ()


STRAIGHT = np.column_stack([np.full(60, 10.0), np.linspace(0, 90, 60)])


def test_cost_of_the_sketch_itself_is_nothing():
    assert smooth_paths.path_cost(STRAIGHT, STRAIGHT, 3.0) == pytest.approx(0, abs=1e-6)


def test_cost_grows_with_distance_bending_and_shortness():
    def cost(path: np.ndarray) -> float:
        return smooth_paths.path_cost(path, STRAIGHT, 3.0)

    def lower(rows: float) -> np.ndarray:
        return STRAIGHT + np.array([rows, 0])

    assert 0 < cost(lower(3)) < cost(lower(6))
    bent = STRAIGHT + np.column_stack([8 * np.sin(np.linspace(0, 3 * np.pi, 60)), np.zeros(60)])
    assert cost(lower(4)) < cost(bent)
    assert cost(STRAIGHT[:40]) > cost(STRAIGHT[:50]) > 0


def test_cost_does_not_depend_on_the_scale():
    path = STRAIGHT + np.column_stack([4 * np.sin(np.linspace(0, 4, 60)), np.ones(60)])
    costs = [smooth_paths.path_cost(s * path, s * STRAIGHT, 3.0 * s) for s in (1.0, 0.4, 3.0)]
    np.testing.assert_allclose(costs, costs[0], rtol=1e-6)


def chosen(graph, sketches, explained=None, keep=3):
    candidates = [paths(graph, s) for s in sketches]
    done = np.zeros(len(graph.pieces), bool) if explained is None else explained
    sets = choice.choose_sets(graph, candidates, HALF_WIDTH, 64, keep, done)
    return candidates, sets


def test_each_body_goes_to_its_own_sketch(graph):
    lines = cross()
    sketches = [synthetic.rotate(line, 20) for line in lines]
    candidates, sets = chosen(graph, sketches)
    for paths_of, number, line in zip(candidates, sets[0], lines, strict=True):
        assert away(paths_of.points[number], line) < HALF_WIDTH


def test_two_sketches_beside_one_another_share_the_skeleton_out(graph):
    """Both sketches are nearer to the first body: one of them takes the second."""
    lines = cross(70.0)
    sketches = [lines[0], synthetic.rotate(lines[1], -25)]
    candidates, sets = chosen(graph, sketches)
    taken = [candidates[i].covers[p] for i, p in enumerate(sets[0])]
    covered = graph.lengths[taken[0] | taken[1]].sum()
    assert covered > 0.85 * graph.lengths.sum()


def test_sets_are_distinct_and_not_more_than_wanted(graph):
    _, sets = chosen(graph, cross(), keep=5)
    assert 1 <= len(sets) <= 5
    assert len(set(sets)) == len(sets)


def test_a_sketch_without_candidates_takes_none(graph):
    far = np.array([[800.0, 800.0], [800.0, 880.0]])
    _, sets = chosen(graph, [cross()[0], far])
    assert all(row[1] == -1 and row[0] >= 0 for row in sets)
    _, nothing = chosen(graph, [far])
    assert nothing == [(-1,)]


def test_what_is_explained_already_is_left_alone(graph):
    """A sketch between two bodies takes the one that no fixed curve explains."""
    lines = cross()
    between = (lines[0] + lines[1]) / 2
    ends = []
    for fixed in lines:
        middles = np.array([p[len(p) // 2] for p in graph.pieces])
        near = np.linalg.norm(middles[:, None] - fixed[None], axis=2).min(1) < HALF_WIDTH
        candidates, sets = chosen(graph, [between], near)
        path = candidates[0].points[sets[0][0]]
        ends.append(away(path, fixed))
    assert min(ends) > HALF_WIDTH


def test_the_skeleton_of_a_tiny_body_is_no_bend():
    zigzag = np.array([[10.0, 10], [10, 11], [11, 12], [11, 13], [12, 14]])
    sketch = np.array([[10.0, 9.0], [12.0, 15.0]])
    elsewhere = np.array([[30.0, 9.0], [30.0, 15.0]])
    costs = [smooth_paths.path_cost(path, sketch, 1.0) for path in (zigzag, elsewhere)]
    assert costs[0] < costs[1] / 2
