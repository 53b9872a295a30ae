"""How sure ends are, on graphs drawn by hand and on one of a mesh."""

import numpy as np
import pytest

import medialis
from medialis.curves.curve_skeleton import CurveSkeleton
from medialis.curves.persistence import node_persistence

TRUNK = np.arange(-10, 11) * 0.5
LARGE = 0.04
"""Area below which a limb is none."""


def with_a_bump(size, long=3.0):
    """Return a trunk of radius 1 with a limb in its middle, `size` thick and `long` times as long.

    And the widths, and the areas next to the nodes.
    """
    limb = np.linspace(0, 1 + long * size, 12)[1:]
    trunk = np.column_stack([TRUNK, 0 * TRUNK, 0 * TRUNK])
    nodes = np.concatenate([trunk, np.column_stack([0 * limb, limb, 0 * limb])])
    t, k = len(TRUNK), len(limb)
    edges = [(i, i + 1) for i in range(t - 1)] + [(10, t)]
    edges += [(t + i, t + i + 1) for i in range(k - 1)]
    radii = np.concatenate([np.ones(t), np.full(k, size)])
    graph = CurveSkeleton.of(nodes, edges, radii)
    outside = np.maximum(np.append(0.0, np.diff(np.maximum(limb, 1.0))), 0.0)
    areas = np.concatenate([np.full(t, np.pi), 2 * np.pi * size * outside])
    return graph, radii, areas


def of_the_bump(size, long=3.0, smallest=LARGE):
    graph, widths, areas = with_a_bump(size, long)
    return node_persistence(graph, widths, areas, smallest)[-1]


def test_a_limb_counts_how_often_it_reaches_out_as_far_as_is_asked():
    """0.3 thick, 0.9 long and its half ball: 1.2 beyond the ball of the trunk, 0.3 is asked."""
    assert of_the_bump(0.3, smallest=0.0) == pytest.approx(4.0)


def test_a_small_bump_counts_by_what_hangs_on_it():
    graph, widths, areas = with_a_bump(0.05)
    hangs = areas[len(TRUNK) :].sum()
    found = node_persistence(graph, widths, areas, LARGE)[-1]
    assert found == pytest.approx(np.sqrt(hangs / LARGE))
    assert found < 1.2


@pytest.mark.parametrize("what", ["size", "long"])
def test_a_bump_is_the_surer_the_larger_or_longer_it_is(what):
    values = (
        np.array([0.02, 0.04, 0.06, 0.08]) if what == "size" else np.array([0.5, 1.0, 2.0, 4.0])
    )
    found = [of_the_bump(**({"size": 0.3} | {what: one})) for one in values]
    assert (np.diff(found) > 0.05).all()


def test_scale_and_turn_change_nothing():
    graph, widths, areas = with_a_bump(0.2)
    before = node_persistence(graph, widths, areas, LARGE)
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    again = CurveSkeleton.of(8 * graph.nodes @ turn, graph.edges, 8 * graph.radii)
    np.testing.assert_allclose(node_persistence(again, 8 * widths, 64 * areas, 64 * LARGE), before)


def test_what_lies_between_limbs_is_as_sure_as_the_surest_of_them():
    graph, widths, areas = with_a_bump(0.2)
    found = node_persistence(graph, widths, areas, LARGE)
    assert found[10] == found.max() == found[graph.end_points].max()


def test_a_ring_counts_by_its_area_alone():
    turn = np.linspace(0, 2 * np.pi, 9)[:-1]
    nodes = np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
    ring = CurveSkeleton.of(nodes, [(i, (i + 1) % 8) for i in range(8)], np.full(8, 0.1))
    found = node_persistence(ring, ring.radii, np.full(8, 0.5), LARGE)
    np.testing.assert_allclose(found, np.sqrt(4.0 / LARGE))
    assert (node_persistence(ring, ring.radii, np.full(8, 0.5), 0.0) == 1.0).all()


def test_the_result_of_a_mesh_and_its_files_have_it(tmp_path):
    found = medialis.run("curve_skeleton", medialis.organic_shape(56))
    graph, layer = found.graph, found.layers[0]
    assert (layer.attributes["persistence"] == graph.persistence).all()
    assert (graph.persistence[graph.end_points] > 1.0).all()
    medialis.write_curve_skeleton(tmp_path / "curve.json", graph)
    again = medialis.read_curve_skeleton(tmp_path / "curve.json")
    assert (again.persistence == graph.persistence).all()
    fewer = medialis.simplify_branches(graph, simplify=0.02)
    ends = [np.sort(one.persistence[one.end_points]) for one in (fewer, graph)]
    assert (ends[0] == ends[1]).all()
