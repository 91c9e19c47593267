"""From masks to graphs whose shape is known."""

from itertools import pairwise

import numpy as np
import pytest
from scipy import ndimage

from napari_splinesketch.engine import constants
from napari_splinesketch.engine.find import tracing

SHAPE = (90, 120)
HALF_WIDTH = 3.0
GRID = np.indices(SHAPE).reshape(2, -1).T


def mask_of(*lines: np.ndarray, half_width: float = HALF_WIDTH) -> np.ndarray:
    """Pixels within a half-width of polylines."""
    mask = np.zeros(len(GRID), bool)
    for line in lines:
        for a, b in pairwise(line):
            t = np.clip((GRID - a) @ (b - a) / max(((b - a) ** 2).sum(), 1e-9), 0, 1)
            mask |= np.linalg.norm(GRID - a - t[:, None] * (b - a), axis=1) <= half_width
    return mask.reshape(SHAPE)


def line(*points) -> np.ndarray:
    return np.array(points, float)


STRAIGHT = line((20, 15), (60, 100))
CROSS = (line((20, 20), (70, 100)), line((70, 20), (20, 100)))
TEE = (line((25, 15), (25, 105)), line((25, 60), (75, 60)))
ANGLE = np.linspace(0, 2 * np.pi, 60)
RING = 45 + np.column_stack([25 * np.sin(ANGLE), 15 + 25 * np.cos(ANGLE)])


def degrees(graph: tracing.TraceGraph) -> list[int]:
    """How many pieces meet at each node, without the splits of longer edges."""
    count = np.bincount(graph.ends.ravel(), minlength=len(graph.nodes))
    return sorted(c for c in count.tolist() if c != 2)


def traced(*lines) -> tracing.TraceGraph:
    return tracing.trace(mask_of(*lines), HALF_WIDTH)


@pytest.mark.parametrize(
    ("lines", "ends", "junctions"),
    [((STRAIGHT,), 2, 0), (CROSS, 4, 1), (TEE, 3, 1), ((RING,), 0, 0)],
    ids=["line", "X", "T", "ring"],
)
def test_ends_and_junctions(lines, ends, junctions):
    graph = traced(*lines)
    assert graph.tips.sum() == ends
    assert degrees(graph).count(1) == ends
    # The skeleton of an X may have two junctions and a bridge between them.
    assert min(junctions, 1) <= len(degrees(graph)) - ends <= 2 * junctions


@pytest.mark.parametrize(
    "lines", [(STRAIGHT,), CROSS, TEE, (RING,)], ids=["line", "X", "T", "ring"]
)
def test_graph_is_consistent_and_lies_in_the_bodies(lines):
    mask = mask_of(*lines)
    graph = tracing.trace(mask, HALF_WIDTH)
    inside = np.asarray(ndimage.distance_transform_edt(mask))
    for piece, ends, length, heading in zip(
        graph.pieces, graph.ends, graph.lengths, graph.headings, strict=True
    ):
        np.testing.assert_array_equal(piece[[0, -1]], graph.nodes[ends])
        assert length == pytest.approx(np.linalg.norm(np.diff(piece, axis=0), axis=1).sum())
        assert length < 2 * constants.PIECE_HW * HALF_WIDTH
        np.testing.assert_allclose(np.linalg.norm(heading, axis=1), 1, rtol=1e-6)
        rows, cols = piece.astype(int).T
        assert (inside[rows, cols] > 1).all()


def test_a_straight_body_is_one_chain_along_its_middle():
    graph = traced(STRAIGHT)
    points = np.concatenate(graph.pieces)
    step = (STRAIGHT[1] - STRAIGHT[0]) / np.linalg.norm(STRAIGHT[1] - STRAIGHT[0])
    away = (points - STRAIGHT[0]) @ [-step[1], step[0]]
    assert np.abs(away).max() < 1.5
    assert (
        np.linalg.norm(graph.nodes[graph.tips] - STRAIGHT, axis=1).max() < 5
        or np.linalg.norm(graph.nodes[graph.tips][::-1] - STRAIGHT, axis=1).max() < 5
    )
    # A chain of pixels is up to 8 % longer than the line, and the body has round ends.
    assert 0.95 * 94 < graph.lengths.sum() < 1.08 * (94 + 2 * HALF_WIDTH)


def test_headings_point_out_of_the_piece():
    graph = traced(line((40, 10), (40, 110)))
    for piece, heading in zip(graph.pieces, graph.headings, strict=True):
        direction = np.sign(piece[-1, 1] - piece[0, 1])
        np.testing.assert_allclose(heading[1], [0, direction], atol=0.35)
        np.testing.assert_allclose(heading[0], [0, -direction], atol=0.35)


def test_ends_that_run_askew_are_left_out():
    hook = np.array([[3.0, 0], [2, 0], [1, 0], [0, 0], *[[0.0, k] for k in range(1, 40)]])
    short = np.array([[20.0, k] for k in range(5)])
    out_there = [[0, -1], [0, 1]]
    for chains in ([hook, short], [short, hook]):
        at, out, left_out, lengths = tracing.ends_of(chains, HALF_WIDTH, askew=3.0)
        k = int(chains[0] is short)
        np.testing.assert_array_equal(at[k], [[0, 0], [0, 36]])
        # A quarter of a chain at most, and no point of any other chain.
        np.testing.assert_array_equal(at[1 - k], [[20, 1], [20, 3]])
        np.testing.assert_allclose(out, [out_there, out_there], atol=1e-6)
        np.testing.assert_array_equal(left_out[[k, 1 - k]], [[3, 3], [1, 1]])
        np.testing.assert_allclose(lengths[[k, 1 - k]], [42, 4])
    assert [len(each) for each in tracing.ends_of([], HALF_WIDTH)] == [0, 0, 0, 0]


def test_ring_is_closed():
    graph = traced(RING)
    assert graph.lengths.sum() == pytest.approx(2 * np.pi * 25, rel=0.12)
    count = np.bincount(graph.ends.ravel())
    assert (count == 2).all()


def test_spurs_are_pruned_and_real_branches_are_not():
    bumpy = line((40, 40), (40 + 1.2 * HALF_WIDTH, 40))
    assert degrees(traced(line((40, 10), (40, 110)), bumpy)) == [1, 1]
    branch = line((40, 40), (40 + 6 * HALF_WIDTH, 40))
    assert degrees(traced(line((40, 10), (40, 110)), branch)).count(1) == 3


def test_bridges_are_the_short_pieces_between_junctions():
    graph = traced(line((25, 30), (65, 90)), line((65, 30), (25, 90)))
    assert 1 <= graph.bridges.sum() <= 4
    centre = np.concatenate([p for p, b in zip(graph.pieces, graph.bridges, strict=True) if b])
    assert np.linalg.norm(centre - [45, 60], axis=1).max() < 20
    assert not traced(STRAIGHT).bridges.any()


def test_an_empty_mask_has_an_empty_graph():
    graph = tracing.trace(np.zeros(SHAPE, bool), HALF_WIDTH)
    assert graph.nodes.shape == (0, 2)
    assert graph.ends.shape == (0, 2)
    assert graph.pieces == ()
    assert graph.headings.shape == (0, 2, 2)


def test_a_gap_is_bridged_straight_on():
    parts = mask_of(line((45, 10), (45, 50))) | mask_of(line((45, 65), (45, 110)))
    graph = tracing.trace(parts, HALF_WIDTH)
    links = [sorted(p[:, 1].tolist()) for p in graph.pieces if len(p) == 2]
    assert any(link == pytest.approx([50, 65], abs=4) for link in links)


def test_what_lies_aside_is_not_bridged():
    parts = mask_of(line((45, 10), (45, 50))) | mask_of(line((60, 65), (85, 65)))
    assert not [p for p in tracing.trace(parts, HALF_WIDTH).pieces if len(p) == 2]


@pytest.mark.parametrize("half_width", [1.2, 3.0, 6.0])
def test_everything_scales_with_the_half_width(half_width):
    mask = mask_of(*CROSS, half_width=half_width)
    graph = tracing.trace(mask, half_width)
    assert graph.tips.sum() == 4
    assert graph.lengths.max() < 2 * constants.PIECE_HW * half_width
