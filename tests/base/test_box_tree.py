"""The bounding tree: every sample once, every bound holds."""

import numpy as np
import pytest

from medialis.base._box_tree_kernels import FAN, LEAF
from medialis.base._box_tree_kernels import test_children as _test_children
from medialis.base.box_tree import build_box_tree
from medialis.base.compiling import dispatcher_of
from medialis.base.threads import thread_limit

SIZES = [1, 2, 15, 16, 17, 31, 32, 33, 127, 128, 129, 130, 1025, 5000]
FLOAT32 = np.finfo(np.float32).eps


def clouds(n):
    rng = np.random.default_rng(n)
    p = rng.normal(size=(n, 3))
    yield "gauss", p
    yield "equal x", p * [0, 1, 1]
    yield "line", np.outer(p[:, 0], [1.0, 2.0, 3.0])
    yield "few values", np.round(p)
    yield "all equal", np.ones((n, 3))
    yield "sorted", np.sort(p, axis=0)
    yield "far away", p + 1e6


def leaf_ranges(n, depth):
    return [((n * j) >> depth, (n * (j + 1)) >> depth) for j in range(1 << depth)]


@pytest.mark.parametrize("n", SIZES)
def test_every_sample_is_in_one_leaf_and_in_its_place(n):
    normals = np.random.default_rng(1).normal(size=(n, 3))
    for _, points in clouds(n):
        tree = build_box_tree(points, normals)
        assert sorted(tree.order.tolist()) == list(range(n))
        assert (tree.points == (points - tree.center)[tree.order]).all()
        assert (tree.normals == normals[tree.order]).all()
        assert tree.blocks.shape == (1 << tree.depth, 3, LEAF)
        for leaf, (begin, end) in enumerate(leaf_ranges(n, tree.depth)):
            assert 1 <= end - begin <= LEAF
            padded = np.minimum(np.arange(begin, begin + LEAF), end - 1)
            assert (tree.points[padded] == tree.blocks[leaf].T).all()


def samples_below(tree, n, node, slot):
    """Range of the samples of a child, found from the leaves below it."""
    if tree.child[node] < 0:
        leaf = ~tree.child[node] + slot
        return (n * leaf) >> tree.depth, (n * (leaf + 1)) >> tree.depth
    below = tree.child[node] + slot
    first = samples_below(tree, n, below, 0)
    used = np.flatnonzero(np.isfinite(tree.bounds[below, 0]))
    return first[0], samples_below(tree, n, below, used[-1])[1]


@pytest.mark.parametrize("n", SIZES)
def test_boxes_and_discs_hold_their_samples(n):
    """Bounds are float32 roundings: off by half a unit of the largest coordinate at most."""
    normals = np.random.default_rng(2).normal(size=(n, 3))
    normals[::3] = 0
    for name, points in clouds(n):
        tree = build_box_tree(points, normals)
        slack = FLOAT32 * np.abs(tree.points).max() * 2  # offsets: up to sqrt(3) coordinates
        covered = np.zeros(n, int)
        for node, bounds in enumerate(tree.bounds):
            for slot in range(FAN):
                if not np.isfinite(bounds[0, slot]):
                    assert bounds[3, slot] == -np.inf and (bounds[6:9, slot] == 0).all()
                    continue
                begin, end = samples_below(tree, n, node, slot)
                p = tree.points[begin:end]
                b = bounds[:, slot].astype(float)
                assert (p >= b[:3] - slack).all() and (p <= b[3:6] + slack).all(), name
                assert (p.min(0) <= b[:3] + slack).all() and (p.max(0) >= b[3:6] - slack).all()
                p = p - (bounds[:3, slot] + bounds[3:6, slot]).astype(float) / 2
                offsets = p @ b[6:9]
                assert (offsets >= b[9] - slack).all() and (offsets <= b[10] + slack).all()
                beside = np.linalg.norm(p - offsets[:, None] * b[6:9], axis=1)
                assert abs(beside.max() - b[11]) <= slack, name
                if tree.child[node] < 0:
                    covered[begin:end] += 1
        assert (covered == 1).all()


def test_left_half_lies_below_the_right_half():
    """Each binary split sorts along the widest axis of its samples."""
    n = 3000
    points = np.random.default_rng(3).normal(size=(n, 3)) * [1, 5, 2]
    tree = build_box_tree(points, np.zeros((n, 3)))
    for level in range(tree.depth):
        for j in range(1 << level):
            begin, end = (n * j) >> level, (n * (j + 1)) >> level
            middle = (n * (2 * j + 1)) >> (level + 1)
            axis = np.ptp(tree.points[begin:end], axis=0).argmax()
            p = tree.points[:, axis]
            assert p[begin:middle].max() <= p[middle:end].min()


def test_one_and_two_threads_give_the_same_tree():
    points, normals = np.random.default_rng(4).normal(size=(2, 40000, 3))
    with thread_limit(1):
        one = build_box_tree(points, normals)
    with thread_limit(2):
        two = build_box_tree(points, normals)
    for name in ("points", "normals", "order", "blocks", "bounds", "child", "center"):
        assert getattr(one, name).tobytes() == getattr(two, name).tobytes()


def test_masks_have_32_bits():
    """With the 64 bits of numba's sums, half as many float32 fit beside them into a vector.

    What is made ahead for processors of 2013 took 2.6 times a kd-tree for balls between triangles,
    and 2.1 with masks of 32 bits; for those of 2009 4.6 and 2.6.
    """
    numba = pytest.importorskip("numba")
    test_children = dispatcher_of(_test_children)
    assert test_children(np.zeros((12, FAN), np.float32), 0.0, 0.0, 0.0, 1.0) == (1 << FAN) - 1
    (signature,) = test_children.nopython_signatures
    assert signature.return_type == numba.int32
