"""How curve skeletons of trees are judged: the true axis, and faults that are put into it."""

import numpy as np
import pytest
from known_trees import METHODS, section, sizes, summary, table
from stability_suite.measures import tree_row
from stability_suite.trees import dense, grown_tree

RINGS = 1


@pytest.fixture(scope="module")
def tree():
    return grown_tree(np.random.default_rng(3), 7, 0.2, RINGS)


@pytest.fixture(scope="module")
def axis(tree):
    """Nodes and edges along the true axis, joined where branches begin; rings are closed."""
    nodes, edges, count = [], [], 0
    for one in tree.branches:
        line, k = dense(one)[0], len(dense(one)[0])
        edges += [(count + i, count + i + 1) for i in range(k - 1)]
        if count:
            before = np.linalg.norm(np.concatenate(nodes) - line[0], axis=1)
            edges.append((int(before.argmin()), count))
        if np.allclose(line[0], line[-1]):
            edges.append((count, count + k - 1))
        nodes.append(line)
        count += k
    return np.concatenate(nodes), np.array(edges)


def test_the_true_axis_has_no_fault(tree, axis):
    row = tree_row(*axis, tree)
    assert row["tips"] == len(tree.tips) > 4
    assert row["absent"] == row["short"] == row["false"] == row["loops_off"] == 0
    assert row["axis"] < 5  # places along the true axis are 5 % of the radius apart


def test_faults_are_counted(tree, axis):
    nodes, edges = axis
    spur = np.concatenate([nodes, nodes[[0]] + [0, 0, 0.1]])
    middle = len(dense(tree.branches[0])[0]) // 2
    spur[-1] = nodes[middle] + [0, 0, 0.1]
    row = tree_row(spur, np.concatenate([edges, [[middle, len(nodes)]]]), tree)
    assert (row["false"], row["absent"]) == (1, 0)
    far = np.linalg.norm(nodes - tree.tips[0], axis=1) < 2.0 * tree.tip_radii[0]
    cut = edges[~far[edges].any(axis=1)]
    row = tree_row(nodes, cut, tree)
    assert (row["short"], row["absent"], row["false"]) == (1, 0, 0)
    gone = edges[~np.isin(edges, np.flatnonzero(_of_limb(tree, nodes, 2))).any(axis=1)]
    assert tree_row(nodes, gone, tree)["absent"] == 1
    ring = next(len(dense(one)[0]) for one in tree.branches if len(one.points) > 10)
    closing = edges[:, 1] - edges[:, 0] == ring - 1
    assert closing.sum() == 1
    assert tree_row(nodes, edges[~closing], tree)["loops_off"] == 1


def _of_limb(tree, nodes, limb):
    near = np.linalg.norm(nodes[:, None] - tree.places[tree.limb == limb][::5], axis=2).min(axis=1)
    return near < 0.5 * tree.place_radii.min()


def test_beside_the_axis_is_told_in_radii(tree, axis):
    nodes, edges = axis
    trunk = edges[(edges < len(dense(tree.branches[0])[0])).all(axis=1)]
    across = np.cross(nodes[50] - nodes[0], [0, 0, 1.0])
    moved = nodes + 0.3 * across / np.linalg.norm(across)
    found = tree_row(moved, trunk, tree)["axis"]
    thick = dense(tree.branches[0])[1]
    assert 100 * 0.2 / thick.max() < found < 100 * 0.31 / thick.min()


def test_the_table_says_what_is_absent_and_what_did_not_run():
    row = {"tips": 4, "absent": 1, "short": 0, "false": 2, "loops_off": 0, "axis": 3.0}
    assert summary([row | {"seconds": 2.0}], 10)[:4] == ["1 of 10", "25.0 %", "50.0 %", "0.0 %"]
    kept = {"rows": {}, "versions": {"medialis": "2"}, "date": "2026-01-01", "tips": 4}
    told = table(kept)
    assert told.count("not run") == 2 and "| kimimaro | default | voxels | absent |" in told
    assert len(told.splitlines()) == 2 + sum(len(sizes(m)) * (1 + len(m.others)) for m in METHODS)
    assert section(kept).startswith("4 limbs; medialis 2; 2026-01-01")
