"""Polylines of a graph."""

import numpy as np
import pytest

import medialis
from medialis.base.arrays import polylines


def lines(edges, count):
    return [line.tolist() for line in polylines(edges, count)]


def test_chain_loop_branch_and_lonely_points():
    assert lines([[3, 1], [1, 0]], 5) == [[0, 1, 3]]
    assert lines([[2, 1], [0, 1], [2, 0]], 3) == [[0, 1, 2, 0]]
    assert lines(np.empty((0, 2), int), 4) == []
    # A loop that hangs on a branch point, and a free loop behind it.
    assert lines([[0, 1], [1, 2], [2, 3], [3, 1], [4, 5], [5, 6], [6, 4]], 7) == [
        [0, 1],
        [1, 2, 3, 1],
        [4, 5, 6, 4],
    ]


def test_every_edge_is_in_exactly_one_polyline_in_any_order():
    rng = np.random.default_rng(3)
    tree = np.array([[rng.integers(max(0, i - 3), i), i] for i in range(1, 400)])
    for edges in (tree, rng.permutation(tree)[:, ::-1]):
        found = polylines(edges, 400)
        pieces = np.concatenate([np.stack([line[:-1], line[1:]], 1) for line in found])
        assert len(pieces) == 399
        assert {tuple(sorted(pair)) for pair in pieces.tolist()} == {
            tuple(sorted(pair)) for pair in tree.tolist()
        }
        degree = np.bincount(tree.ravel(), minlength=400)
        for line in found:
            assert (degree[line[1:-1]] == 2).all()
            assert degree[line[0]] != 2 and degree[line[-1]] != 2


def test_edges_of_missing_vertices_are_refused():
    with pytest.raises(medialis.InvalidShapeError, match=r"vertices 0..2, got 0..3"):
        polylines([[0, 3]], 3)
