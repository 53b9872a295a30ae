import itertools

import numpy as np
import pytest

from medialis.base.errors import InvalidShapeError
from medialis.curves.curve_skeleton import CurveSkeleton


def lollipop():
    """A stick 0-1-2 whose end 2 is on a square 2-3-4-5; node 6 is alone."""
    nodes = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 1, 0], [4, 0, 0], [3, -1, 0], [9, 9, 9]]
    edges = [[2, 3], [0, 1], [3, 4], [2, 1], [4, 5], [5, 2]]
    return CurveSkeleton.of(nodes, edges, np.arange(7.0), vertex_node=[0, 3, 6, -1, 2])


def test_the_parts_of_a_graph():
    graph = lollipop()
    assert graph.degrees.tolist() == [1, 2, 3, 2, 2, 2, 0]
    assert graph.junctions.tolist() == [2] and graph.end_points.tolist() == [0]
    assert graph.branch.tolist() == [0, 1, 0, 1, 0, 0]
    assert graph.component_count == 2 and graph.loops == 1
    assert graph.components.tolist() == [0, 0, 0, 0, 0, 0, 1]


def test_branches_run_from_end_to_end_and_closed_ones_from_their_junction():
    loop, stick = lollipop().branches
    assert stick.tolist() == [0, 1, 2]
    assert loop[0] == loop[-1] == 2 and sorted(loop[1:-1].tolist()) == [3, 4, 5]


def test_measures_of_branches():
    graph = lollipop()
    assert graph.branch_lengths == pytest.approx([4 * np.sqrt(2), 2])
    assert graph.tortuosity.tolist() == [np.inf, 1.0]
    assert graph.mean_radii == pytest.approx([(2.5 + 3.5 + 4.5 + 3.5) / 4, (0.5 + 1.5) / 2])
    assert graph.length == pytest.approx(4 * np.sqrt(2) + 2)


def test_vertices_of_the_surface_know_their_branch():
    graph = lollipop()
    assert graph.vertex_branch.tolist() == [1, 0, -1, -1, 0]
    assert graph.surface_part(1).tolist() == [0]
    bare = CurveSkeleton.of(graph.nodes, graph.edges, graph.radii)
    with pytest.raises(InvalidShapeError, match="no map"):
        bare.surface_part(0)


def test_a_ring_without_a_junction_is_one_branch():
    graph = CurveSkeleton.of(np.eye(3), [[1, 2], [2, 0], [0, 1]], np.ones(3))
    assert graph.branch_count == 1 and graph.loops == 1 and len(graph.junctions) == 0
    assert graph.branches[0][0] == graph.branches[0][-1] == 0


def test_a_point_and_nothing_are_skeletons():
    point = CurveSkeleton.of([[1, 2, 3]], [], [4], vertex_node=[0, 0])
    assert point.component_count == 1 and point.loops == 0 and point.branches == ()
    assert point.vertex_branch.tolist() == [-1, -1] and point.length == 0
    nothing = CurveSkeleton.of([], [], [])
    assert nothing.component_count == 0 and nothing.loops == 0 and len(nothing.mean_radii) == 0


def test_random_graphs_agree_with_networkx():
    networkx = pytest.importorskip("networkx")
    random = np.random.default_rng(1)
    for _ in range(20):
        pairs = random.integers(0, 12, (14, 2))
        pairs = np.unique(np.sort(pairs[pairs[:, 0] != pairs[:, 1]], axis=1), axis=0)
        graph = CurveSkeleton.of(random.normal(size=(12, 3)), pairs, np.ones(12))
        other = networkx.Graph(pairs.tolist())
        other.add_nodes_from(range(12))
        assert graph.component_count == networkx.number_connected_components(other)
        assert graph.loops == len(networkx.cycle_basis(other))
        walked = [tuple(sorted(p)) for row in graph.branches for p in itertools.pairwise(row)]
        assert sorted(walked) == [tuple(row) for row in pairs.tolist()]
        for row in graph.branches:
            assert (graph.degrees[row[1:-1]] == 2).all()


@pytest.mark.parametrize(
    ("edges", "text"),
    [
        ([[0, 3]], "0..2"),
        ([[1, 1]], "itself"),
        ([[0, 1], [1, 0]], "twice"),
    ],
)
def test_bad_edges_are_named(edges, text):
    with pytest.raises(InvalidShapeError, match=text):
        CurveSkeleton.of(np.zeros((3, 3)), edges, np.ones(3))


def test_arrays_must_fit():
    with pytest.raises(InvalidShapeError, match="radii"):
        CurveSkeleton.of(np.zeros((3, 3)), [[0, 1]], np.ones(2))
    with pytest.raises(InvalidShapeError, match="vertex_node"):
        CurveSkeleton(np.zeros((1, 3)), np.empty((0, 2)), [1], [1], [], vertex_node=[1])
    with pytest.raises(InvalidShapeError, match="radii"):
        CurveSkeleton.of(np.zeros((2, 3)), [[0, 1]], [1, 1e200])


@pytest.mark.parametrize("branch", [[0, 0, 0], [0, 1, 3], [1, 2, 3], [0, 1, -1], [0, 1, 1]])
def test_branches_must_be_the_chains_of_the_edges(branch):
    """A number that no edge had broke `branches` with ValueError, joined chains with KeyError."""
    fork = np.zeros((4, 3)), [[0, 1], [1, 2], [1, 3]], np.ones(4), np.ones(4)
    assert [len(row) for row in CurveSkeleton(*fork, [2, 0, 1]).branches] == [2, 2, 2]
    with pytest.raises(InvalidShapeError, match="branch"):
        CurveSkeleton(*fork, branch)
