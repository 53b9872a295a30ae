"""Curve skeletons from level sets: thin and branching meshes of any proportion."""

import itertools

import numpy as np
import pytest

import medialis
from closed_forms import mesh, torus_mesh
from medialis.base.progress import Progress
from medialis.curves.from_level_sets import hanging_areas, level_ground
from medialis.curves.level_sets import level_sets
from medialis.shape.surface import solid_boundary
from tube_trees import judged, tube_tree

FAMILIES = {
    "plain": {"limbs": 8, "slender": 100},
    "few sides": {"limbs": 8, "slender": 100, "round_": 6},
    "many sides": {"limbs": 4, "slender": 60, "round_": 24},
    "thick body": {"limbs": 6, "slender": 150, "soma": 8, "round_": 12},
    "spines": {"limbs": 4, "slender": 60, "round_": 16, "spines": 12},
    "long triangles": {"limbs": 5, "slender": 200, "elongation": 4},
}


def shape_of(tree, change=None, rng=None):
    points, faces = tree.arrays()
    if change is not None:
        points, faces = change(points, faces, tree, rng)
    return medialis.make_shape(points, faces)


def noisy(points, faces, tree, rng):
    """Move vertices by up to a quarter of the radius there along each axis."""
    from scipy.spatial import cKDTree

    axis, size = tree.axis(0.5)
    near = cKDTree(axis).query(points)[1]
    return points + 0.25 * rng.uniform(-1, 1, points.shape) * size[near][:, None], faces


def holed(points, faces, tree, rng):
    """Leave out two faces in a hundred."""
    return points, faces[rng.random(len(faces)) > 0.02]


def by_level_sets(shape, **options):
    return medialis.curve_skeleton(shape, skeleton_method="level_sets", **options)


def right(graph, tree, *, radii=3.0):
    recall, excess = judged(graph, tree)
    assert recall >= 0.98 and excess < radii
    assert (graph.loops, graph.component_count) == (tree.loops, 1)


@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("seed", [0, 1])
def test_trees_of_tubes(family, seed):
    tree = tube_tree(np.random.default_rng(seed), **FAMILIES[family])
    right(by_level_sets(shape_of(tree)), tree, radii=4.5 if family == "long triangles" else 3.0)


@pytest.mark.slow
@pytest.mark.parametrize("change", [noisy, holed])
def test_trees_with_noise_and_holes(change):
    """The method is chosen by the shape; a hole is no loop, and noise no limb."""
    rng = np.random.default_rng(3)
    tree = tube_tree(rng, limbs=8, slender=150, round_=12)
    graph = medialis.curve_skeleton(shape_of(tree, change, rng))
    assert graph.evidence.measured is None
    right(graph, tree)
    if change is noisy:  # folds beside holes are limbs as long as one radius
        assert len(graph.end_points) == tree.tips


@pytest.mark.slow
def test_the_longest_proportions():
    """5,000 radii long: the whole is 10,000 times as long as a limb is thick."""
    tree = tube_tree(np.random.default_rng(0), limbs=2, slender=2500, round_=6, elongation=3)
    graph = medialis.curve_skeleton(shape_of(tree))
    right(graph, tree)
    assert len(graph.end_points) == tree.tips


def tube(length=60.0, around=12, step=0.6, radius=1.0):
    """Return a straight tube with flat ends along z."""
    count = int(length / step) + 1
    angle = 2 * np.pi * np.arange(around) / around
    ring = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    heights = np.linspace(0, length, count)
    points = [[x, y, z] for z in heights for x, y in ring] + [[0, 0, 0], [0, 0, length]]
    faces = []
    for k, j in itertools.product(range(count - 1), range(around)):
        a, b = k * around + j, k * around + (j + 1) % around
        faces += [[a, b, b + around], [a, b + around, a + around]]
    last = (count - 1) * around
    for j in range(around):
        after = (j + 1) % around
        faces += [[after, j, len(points) - 2], [last + j, last + after, len(points) - 1]]
    return np.array(points), np.array(faces)


def test_a_tube_is_its_axis():
    """Sections are regular polygons of 12 sides, with an area of 3 r^2."""
    graph = by_level_sets(mesh(*tube()))
    assert (graph.branch_count, graph.loops, len(graph.end_points)) == (1, 0, 2)
    assert np.abs(graph.nodes[:, :2]).max() < 0.1
    inner = (graph.nodes[:, 2] > 4) & (graph.nodes[:, 2] < 56)  # ends tilt contours
    assert np.allclose(graph.radii[inner], np.sqrt(3 / np.pi), rtol=1e-3)
    ends = np.sort(graph.nodes[graph.end_points, 2])
    assert 0.5 < ends[0] < 1.5 and 58.5 < ends[1] < 59.5, "balls that touch the flat ends"


def test_a_torus_is_a_loop():
    graph = by_level_sets(torus_mesh(60, 16))
    assert (graph.loops, len(graph.end_points), graph.component_count) == (1, 0, 1)
    off = np.hypot(np.hypot(*graph.nodes[:, :2].T) - 1, graph.nodes[:, 2])
    assert np.median(off) < 0.1 * 0.3 and off.max() < 0.5 * 0.3, "by the radius of the tube"


@pytest.mark.slow
def test_a_cage_of_thin_rings_keeps_its_loops():
    """Five rings with a radius of 1/1,000 of the size, which hang together."""
    size, parts = 500.0, []
    for k in range(5):
        ring = torus_mesh(800, 6, major=size, minor=1.0)
        turn = np.pi * k / 5
        spin = np.array(
            [[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]]
        )
        flat = ring.points[:, [0, 2, 1]] * [1, 1, -1]
        parts.append((flat @ spin.T, ring.faces + k * ring.point_count))
    points, faces = (np.concatenate(one) for one in zip(*parts, strict=True))
    graph = medialis.curve_skeleton(medialis.make_shape(points, faces))
    assert graph.loops == 5 and len(graph.end_points) == 0


@pytest.mark.slow
def test_the_pose_the_scale_and_the_order_do_not_matter():
    tree = tube_tree(np.random.default_rng(5), limbs=6, slender=60, round_=10)
    points, faces = tree.arrays()
    first = by_level_sets(medialis.make_shape(points, faces))
    rng = np.random.default_rng(0)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    row = rng.permutation(len(points))
    back = np.argsort(row)
    moved = 1e-3 * points[row] @ turn.T + [3, 1, 4]
    other = by_level_sets(medialis.make_shape(moved, back[faces][rng.permutation(len(faces))]))
    assert len(other.end_points) == len(first.end_points) == tree.tips
    assert other.length == pytest.approx(1e-3 * first.length, rel=0.01)
    expected = 1e-3 * first.nodes[first.end_points] @ turn.T + [3, 1, 4]
    found = other.nodes[other.end_points]
    gap = np.linalg.norm(found[:, None] - expected, axis=2).min(axis=1)
    assert gap.max() < 2e-3, "two radii: from which tip the distance is measured changes"


def test_contours_are_those_of_plain_loops():
    """Oracle: each level cut alone, in plain Python, and its segments joined by their ends."""
    tree = tube_tree(np.random.default_rng(2), limbs=2, slender=12, round_=6)
    boundary = solid_boundary(shape_of(tree))
    levels = level_sets(boundary)
    value = 3.0 * levels.distance + 0.5
    expected = 0
    for level in range(1, int(value.max()) + 1):
        near = {}
        for face in boundary.faces.tolist():
            cut = [
                frozenset((a, b))
                for a, b in itertools.pairwise([*face, face[0]])
                if (value[a] < level) != (value[b] < level)
            ]
            if cut:
                one, two = cut
                near.setdefault(one, []).append(two)
                near.setdefault(two, []).append(one)
        while near:
            expected += 1
            todo = [next(iter(near))]
            while todo:
                todo += near.pop(todo.pop(), [])
    assert len(levels.centers) == expected
    whole = levels.band_count - len(levels.centers)
    assert whole == 1, "a connected graph without loops"


def test_bodies_that_touch_are_joined():
    """Tubes that overlap are one graph, others have their own."""
    points, faces = tube(40.0)
    n = len(points)
    for shift, parts in (([0.7, 0, 39.5], 1), ([0, 0, 45], 2)):
        both = np.concatenate([points, points + shift])
        graph = by_level_sets(medialis.make_shape(both, np.concatenate([faces, faces + n])))
        assert graph.component_count == parts
        assert len(graph.end_points) == 2 * parts


@pytest.mark.slow
@pytest.mark.parametrize("count", [10, 200])
def test_many_bodies_make_one_chain(count):
    points, faces = tube(12.0, around=8, step=1.0)
    n = len(points)
    all_points = np.concatenate([points + np.array([0, 0, 11.5 * k]) for k in range(count)])
    all_faces = np.concatenate([faces + n * k for k in range(count)])
    graph = by_level_sets(medialis.make_shape(all_points, all_faces))
    assert (graph.component_count, len(graph.end_points), graph.loops) == (1, 2, 0)
    assert 11.5 * count - 2 < graph.length < 12.5 * count, "a detour of a radius at each joint"


def test_the_method_follows_the_shape_and_the_options():
    thin, thick = mesh(*tube(2500.0, 6, 4.0)), mesh(*tube(8.0))
    progress = Progress()
    assert medialis.curve_skeleton(thin, progress=progress).evidence.measured is None
    (message,) = progress.messages
    assert message.code == "level_sets" and message.data["slenderness"] > 1000
    assert medialis.curve_skeleton(thick).evidence.measured is not None
    assert by_level_sets(thick).evidence.measured is None
    assert medialis.curve_skeleton(thin, candidates=0.005).evidence.measured is not None
    assert medialis.curve_skeleton(thin, skeleton_method="balls").evidence.measured is not None


def test_a_threshold_leaves_out_small_limbs():
    """All limbs of this tree have less surface than a square with a side of 40 % of its size."""
    tree = tube_tree(np.random.default_rng(4), limbs=4, slender=40, round_=8)
    shape = shape_of(tree)
    assert len(by_level_sets(shape).end_points) == tree.tips
    assert len(by_level_sets(shape, threshold=0.4).end_points) == 2


def test_the_area_that_hangs_on_a_node():
    graph = medialis.CurveSkeleton.of(
        [[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0], [2, 1, 0]],
        [[0, 1], [1, 2], [2, 3], [2, 4]],
        [1, 1, 2, 1, 1],
    )
    areas = np.array([1.0, 2.0, 4.0, 5.0, 6.0])
    assert hanging_areas(graph, areas).tolist() == [1, 3, 18, 5, 6]


def test_slenderness_is_length_over_radius():
    ground = level_ground(mesh(*tube(60.0)), Progress())
    assert ground.slenderness == pytest.approx(60 / np.sqrt(3 / np.pi), rel=0.05)
    assert ground.share_below(0.1) < 0.02 < 0.95 < ground.share_below(1.1)


def test_what_is_not_explained_is_marked():
    """A plate is no limb: its middle line explains a small part of it."""
    points = np.array(list(itertools.product([0, 1.0], [0, 0.8], [0, 0.06])))
    faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]]
    faces += [[2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    result = medialis.run("curve_skeleton", medialis.make_shape(points, faces))
    parts = next(one for one in result.layers if one.name == "curve_skeleton_parts")
    assert set(parts.attributes["left_out"]) <= {0, 1}
    values = result.values
    assert (
        values["explained"] == pytest.approx(1 - values["sheet_share"])
        and values["explained"] < 0.8
    )
    (warning,) = (one for one in result.messages if one.code == "thin_sheets")
    assert warning.data["share"] == values["sheet_share"]
