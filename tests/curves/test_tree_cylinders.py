"""Cylinders of trees whose limbs are known: volume, order, parents, angles, and their tables."""

import csv
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

import closed_forms as forms
import medialis
from medialis.base.arrays import enclosed_volume
from medialis.curves.tree_cylinders import (
    _Laid,
    _paths,
    _tapering,
    lowest_thick_end,
    nearest_end,
    rooted,
)
from medialis.curves.tree_operation import write_branches
from trees import known_tree, meshed

# What each program asks of a table: rTwig knows TreeQSM's by these four.
SIGNATURE = {"parent", "extension", "branch", "BranchOrder"}
COLUMNS = [
    *("radius", "length", "start.x", "start.y", "start.z", "axis.x", "axis.y", "axis.z"),
    *("parent", "extension", "added", "UnmodRadius", "branch", "BranchOrder", "PositionInBranch"),
]


SAME = np.eye(3)


def limb_at(tree, known, turn=SAME, scale=1.0):
    """The number of the known limb that each cylinder lies in, by its middle."""
    dense = [one.dense(60) for one in known]
    points = scale * np.concatenate([one for one, _ in dense]) @ turn.T
    radii = scale * np.concatenate([one for _, one in dense])
    number = np.repeat(np.arange(len(known)), [len(one) for _, one in dense])
    away, rows = cKDTree(points).query((tree.starts + tree.ends) / 2, k=200)
    deepest = np.argmin(away - radii[rows], axis=1)
    return number[rows[np.arange(len(rows)), deepest]]


def share_of_order(tree, known, of_known):
    right = np.array([one.order for one in known])[of_known] == tree.orders
    return tree.lengths[right].sum() / tree.lengths.sum()


KNOWN = known_tree(1, 5, ratio=5)


@pytest.fixture(scope="module")
def small():
    return medialis.make_shape(meshed(KNOWN, 0.1).points, meshed(KNOWN, 0.1).faces, unit="cm")


@pytest.fixture(scope="module")
def result(small):
    return medialis.run("tree_cylinders", small)


def test_each_limb_is_found_with_its_volume_order_and_parent(small, result):
    tree = result.extras["cylinders"]
    assert result.values["limbs"] == len(KNOWN) and result.values["highest_order"] == 2
    volume = enclosed_volume(small.points, small.faces)
    assert result.values["volume"] == pytest.approx(volume, rel=0.05)
    of_known = limb_at(tree, KNOWN)
    assert share_of_order(tree, KNOWN, of_known) == 1.0
    for row in tree.first[1:]:
        assert KNOWN[of_known[row]].parent == of_known[tree.parents[row]]
    assert sum(row["volume"] for row in result.values["limb_table"]) == pytest.approx(
        result.values["volume"]
    )


def test_cylinders_follow_each_other(result):
    tree = result.extras["cylinders"]
    within = tree.parents >= 0
    within[tree.first] = False
    np.testing.assert_allclose(tree.starts[within], tree.ends[tree.parents[within]], atol=1e-12)
    assert (tree.parents < np.arange(len(tree))).all() and tree.parents[0] == -1
    ratio = tree.lengths / tree.radii
    assert np.median(ratio) == pytest.approx(3.0, rel=0.1)
    assert result.values["root"][2] == pytest.approx(-0.5, abs=0.2)  # two thirds of 0.5 below 0


def test_branch_angles_are_those_of_the_limbs(result):
    """Within 5 degrees: the axis is off by up to a tenth of a radius over four."""
    tree = result.extras["cylinders"]
    of_known = limb_at(tree, KNOWN)
    for number, row in enumerate(tree.first):
        limb = KNOWN[of_known[row]]
        if limb.parent < 0:
            assert np.isnan(tree.angles[number])
            continue
        parent = KNOWN[limb.parent].points
        middles = (parent[1:] + parent[:-1]) / 2
        nearest = np.argmin(np.linalg.norm(middles - limb.points[0], axis=1))
        ways = limb.points[1] - limb.points[0], np.diff(parent, axis=0)[nearest]
        cosine = ways[0] @ ways[1] / np.linalg.norm(ways[0]) / np.linalg.norm(ways[1])
        assert np.degrees(tree.angles[number]) == pytest.approx(
            np.degrees(np.arccos(cosine)), abs=5
        )


def test_tables_have_the_columns_of_treeqsm_in_metres(result, tmp_path):
    medialis.write_result(result, tmp_path / "out", pictures=medialis.Pictures(main=False))
    with (tmp_path / "out/tree_cylinders.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert list(rows[0]) == COLUMNS and set(COLUMNS) >= SIGNATURE
    tree, numbers = (
        result.extras["cylinders"],
        {k: np.array([float(r[k]) for r in rows]) for k in COLUMNS},
    )
    np.testing.assert_allclose(numbers["radius"], tree.radii / 100, rtol=1e-12)
    assert numbers["parent"].tolist() == (tree.parents + 1).tolist() and numbers["parent"][0] == 0
    for row, after in enumerate(numbers["extension"].astype(int).tolist()):
        if after:
            assert (numbers["parent"][after - 1], numbers["branch"][after - 1]) == (
                row + 1, numbers["branch"][row],
            )  # fmt: skip
    assert (numbers["extension"] == 0).sum() == len(KNOWN)
    assert numbers["PositionInBranch"].min() == 1 and numbers["branch"].max() == len(KNOWN)
    with (tmp_path / "out/tree_cylinders.branches.csv").open() as stream:
        limbs = list(csv.DictReader(stream))
    assert [int(one["order"]) for one in limbs] == sorted(one.order for one in KNOWN)
    litres = sum(float(one["volume"]) for one in limbs)
    assert litres == pytest.approx(result.values["volume"] / 1000)  # a litre has 1000 cm^3


def test_height_and_azimuth_are_those_of_the_axis_that_points_up(result, tmp_path):
    """They took z for up whatever was said (fixed)."""
    tree = result.extras["cylinders"]
    for up, axes in (("z", [0, 1, 2]), ("y", [1, 2, 0]), ("x", [2, 0, 1])):
        turned = replace(tree, starts=tree.starts[:, axes], leaving=tree.leaving[:, axes])
        shape = replace(result.shape, points=result.shape.points[:, axes], up=up)
        path = tmp_path / up
        write_branches(path, replace(result, shape=shape, extras={"cylinders": turned}))
        rows = list(csv.DictReader(path.read_text("utf-8").splitlines()))
        heights = (tree.starts[tree.first, 2] - tree.starts[0, 2]) / 100
        assert [float(row["height"]) for row in rows] == pytest.approx(heights)
        azimuths = np.degrees(np.arctan2(tree.leaving[:, 1], tree.leaving[:, 0]))
        assert [float(row["azimuth"]) for row in rows] == pytest.approx(azimuths)


@pytest.mark.slow
def test_a_larger_tree_turned_and_scaled(tmp_path):
    """15 limbs of radii down to 0.05, two side by side, half an edge of the mesh to the radius."""
    seed, limbs, cell, scale = 13, 15, 0.08, 80.0
    known = known_tree(seed, limbs, orders=1)
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    mesh = meshed(known, cell)
    shape = medialis.make_shape(scale * mesh.points @ turn.T, mesh.faces)
    place = tmp_path / "root.txt"
    place.write_text(" ".join(map(str, (scale * known[0].points[0] @ turn.T).tolist())))
    result = medialis.run("tree_cylinders", shape, root=str(place), taper=True)
    tree = result.extras["cylinders"]
    volume = enclosed_volume(shape.points, shape.faces)
    assert result.values["volume"] == pytest.approx(volume, rel=0.05)
    of_known = limb_at(tree, known, turn, scale)
    assert share_of_order(tree, known, of_known) >= 0.95
    assert set(of_known.tolist()) == set(range(limbs + 1))
    goes_on = tree.parents >= 0
    assert (tree.radii[goes_on] <= tree.radii[tree.parents[goes_on]] * (1 + 1e-12)).all()


@pytest.mark.slow
def test_a_cloud_that_is_open_below_has_the_same_limbs(result):
    mesh = meshed(KNOWN, 0.1)
    seen = mesh.points[:, 2] > 0.4
    cloud = medialis.make_shape(mesh.points[seen], None, mesh.normals[seen])
    again = medialis.run("tree_cylinders", cloud)
    assert again.values["limbs"] == len(KNOWN)
    tree = again.extras["cylinders"]
    known = limb_at(tree, KNOWN)
    assert set(known.tolist()) == set(range(len(KNOWN)))
    # The trunk of a scan goes on in what reaches farthest: limb 2, whose end is 3 m above its top.
    expected = np.array([one.order for one in KNOWN])[known]
    top = (known == 0) & (tree.starts[:, 2] > KNOWN[2].points[0, 2] + KNOWN[0].radii[-1])
    expected[known == 2], expected[top] = 0, 1
    assert tree.lengths[tree.orders == expected].sum() >= 0.95 * tree.lengths.sum()
    thick = (tree.branches == 0) & (known == 0)
    whole = result.extras["cylinders"]
    known = np.interp(tree.starts[thick, 2], whole.starts[:, 2], whole.radii)
    assert np.median(tree.radii[thick] / known) == pytest.approx(1.0, abs=0.1)


def square(radii):
    """A trunk with a loop of four edges, and what hangs behind it."""
    points = [[0, 0, 0], [0, 0, 4], [2, 0, 6], [-2, 0, 6], [0, 0, 8], [0, 0, 12]]
    edges = [[0, 1], [1, 2], [1, 3], [2, 4], [3, 4], [4, 5]]
    return medialis.CurveSkeleton.of(points, edges, radii)


@pytest.mark.parametrize("thin", [2, 3])
def test_a_loop_is_cut_where_it_is_thinnest(thin):
    radii = [1.0, 1.0, 0.8, 0.8, 0.9, 0.7]
    radii[thin] = 0.5
    after, cut = rooted(square(radii), 0)
    assert cut == 1
    assert 4 in after[5 - thin] and after[thin] == [] and after[4] == [5]


def test_a_trunk_goes_on_where_it_is_thickest_though_it_ends_soon():
    """A branch of 60 % of its radius and of four times its length was taken for its top."""
    points = [[0, 0, 0], [0, 0, 4], [0, 0, 4.6], [1, 0, 4.5], [2, 0, 5.5], [3, 0, 7.5]]
    edges = [[0, 1], [1, 2], [1, 3], [3, 4], [4, 5]]
    graph = medialis.CurveSkeleton.of(points, edges, [0.5, 0.5, 0.48, 0.3, 0.3, 0.3])
    after, cut = rooted(graph, 0)
    assert cut == 0
    assert _paths(graph, after, 0) == [([0, 1, 2], -1, 0), ([1, 3, 4, 5], 0, 1)]


def test_the_root_is_the_lowest_of_the_thick_ends_or_the_nearest():
    graph = square([1.0, 1.0, 0.8, 0.8, 0.9, 0.7])
    assert lowest_thick_end(graph, 2) == 0 and lowest_thick_end(graph, 0) == 0
    assert nearest_end(graph, np.array([0.0, 0.0, 10.5])) == 5
    assert nearest_end(graph, np.array([2.0, 0.0, 6.0])) == 2  # far from all ends
    turned = medialis.CurveSkeleton.of(-graph.nodes, graph.edges, graph.radii)
    assert lowest_thick_end(turned, 2) == 5  # no thinner than half


def test_tapering_keeps_the_volume_of_what_it_joins():
    limb = _Laid(np.array([0.0, 1.0, 3.0, 4.0]), np.array([4.0, 1.0, 2.5]), 0)
    twig = _Laid(np.array([0.0, 1.0, 2.0]), np.array([9.0, 0.5]), 3)
    radii = _tapering([limb, twig], [-1, 1])
    assert radii**2 == pytest.approx([4.0, 1.5, 1.5, 1.5, 0.5])  # (1 * 2 + 2.5 * 1) / 3; 9 is cut


def test_what_is_no_tree_says_why():
    with pytest.raises(medialis.InvalidShapeError, match="no tree"):
        medialis.run("tree_cylinders", forms.icosphere(3))
