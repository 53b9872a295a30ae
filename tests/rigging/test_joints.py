"""Joints where limbs bend and change their thickness; limbs that mirror each other."""

import numpy as np
import pytest

import medialis
from medialis.curves.curve_skeleton import CurveSkeleton
from tubes import capsules, dense_curve, segment, tube


def chain(points, radii):
    """A curve skeleton along points, which is its own only limb."""
    k = len(points)
    edges = np.stack([np.arange(k - 1), np.arange(1, k)], axis=1)
    return CurveSkeleton.of(points, edges, np.broadcast_to(radii, k))


def joints_of(rig):
    return np.vstack([rig.heads, rig.tails[-1:]])


def limb_between(rng, bends):
    """Straight parts of 4 to 9 radii (of 1) with bends of 35 to 100 degrees between."""
    way, corners = np.array([1.0, 0, 0]), [np.zeros(3)]
    for turn in range(bends + 1):
        if turn:
            across = np.cross(way, rng.normal(size=3))
            angle = rng.uniform(np.radians(35), np.radians(100))
            way = np.cos(angle) * way + np.sin(angle) * across / np.linalg.norm(across)
        corners.append(corners[-1] + rng.uniform(4, 9) * way)
    return np.array(corners)


@pytest.mark.parametrize("seed", range(30))
def test_joints_lie_in_the_bends(seed):
    """As many bones as straight parts. Joints are tried four times a radius; half of one is left
    for what the least squares give to the short part."""
    rng = np.random.default_rng(seed)
    corners = limb_between(rng, seed % 4)
    rig = medialis.bones(chain(dense_curve(corners, rng.uniform(0.1, 0.5)), 1.0))
    found = joints_of(rig)
    if np.linalg.norm(found[0] - corners[0]) > 1e-9:
        found = found[::-1]
    assert len(found) == len(corners)
    assert np.linalg.norm(found - corners, axis=1).max() < 0.5


def test_straight_limbs_have_one_bone():
    """Also where they taper, and where the curve trembles by a tenth of the radius."""
    rng = np.random.default_rng(4)
    points = dense_curve(segment([0, 0, 0], [40, 9, -7]), 0.3)
    assert medialis.bones(chain(points, 1.0)).count == 1
    assert medialis.bones(chain(points, np.linspace(2.0, 0.4, len(points)))).count == 1
    trembling = points + rng.uniform(-0.1, 0.1, points.shape)
    radii = 1 + rng.uniform(-0.1, 0.1, len(points))
    assert medialis.bones(chain(trembling, radii)).count == 1


@pytest.mark.parametrize("share", [0.3, 0.5, 0.6])
def test_a_joint_lies_where_the_thickness_changes(share):
    points = dense_curve(segment([0, 0, 0], [30, 0, 0]), 0.2)
    thick = points[:, 0] < 30 * share
    rig = medialis.bones(chain(points, np.where(thick, 2.0, 0.9)))
    assert rig.count == 2 and abs(rig.heads[1, 0] - 30 * share) < 0.9


def test_a_bend_within_the_radius_needs_no_joint_and_a_smaller_bend_option_finds_it():
    points = dense_curve(np.array([[0, 0, 0], [10, 0.5, 0], [20, 0, 0]]), 0.3)
    assert medialis.bones(chain(points, 2.0)).count == 1
    rig = medialis.bones(chain(points, 2.0), bend=0.1)
    assert rig.count == 2 and abs(rig.heads[1, 0] - 10) < 1


def test_long_bones_are_split_between_their_joints():
    points = np.array([[0, 0, 0], [12.0, 0, 0], [12, 12, 0]])
    curve = chain(points, 1.0)
    rig = medialis.bones(curve, bone_length=7 / curve.diagonal)
    assert rig.count == 4
    # The bend lies on a multiple of a quarter of a radius: all bones have their exact length.
    assert np.allclose(np.linalg.norm(rig.tails - rig.heads, axis=1), 6, atol=1e-9)


ARM = [[3.5, 0, 5], [6.5, 0.5, 2], [8.5, -3, 0]]
LEG = [[1.5, 0, -6], [2.5, -1.5, -11], [2, 1, -16]]


def figure(turn=None, scale=1.0, tremble=0.0, seed=0):
    """Curve skeleton of a figure that mirrors itself in x = 0, and the radius of its limbs.

    Hips, chest and head lie in the plane.
    """
    rng = np.random.default_rng(seed)
    hips, chest, head = [0, 0, -5.0], [0, 0, 5.0], [0, 0.3, 9.0]
    ways = [(np.array([chest, hips]), 2.0), (np.array([chest, head]), 1.0)]
    for side in (1, -1):
        for start, limb, radius in ((chest, ARM, 0.7), (hips, LEG, 0.8)):
            # Limbs of equal thickness would be numbered as rounding decides.
            thickness = radius * (1 + 0.01 * (side < 0))
            ways.append((np.array([start, *limb]) * [side, 1, 1], thickness))
    nodes, edges, radii = [], [], []
    of_place = {}
    for way, radius in ways:
        rows = dense_curve(way, rng.uniform(0.2, 0.4))
        rows[1:-1] += rng.uniform(-tremble, tremble, (len(rows) - 2, 3))
        before = -1
        for row in rows:
            key = tuple(np.round(row, 6))
            if key not in of_place:
                of_place[key] = len(nodes)
                nodes.append(row)
                radii.append(radius)
            if before >= 0:
                edges.append((before, of_place[key]))
            before = of_place[key]
    radii[of_place[(0, 0, 5)]] = 2.2
    turned = np.array(nodes) if turn is None else np.array(nodes) @ turn.T
    return CurveSkeleton.of(scale * turned, edges, scale * np.array(radii))


def rotation(seed):
    turn, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return turn * np.sign(np.linalg.det(turn))


def paired(rig):
    """Names by their base, and a check that left and right are each other's mirror images."""
    left = np.flatnonzero(rig.sides == 1)
    assert (rig.mirrors[rig.mirrors[left]] == left).all()
    for bone in left.tolist():
        one, other = rig.names[bone], rig.names[rig.mirrors[bone]]
        assert one.endswith(".L") and other == one[:-1] + "R"
    assert len(set(rig.names)) == rig.count
    assert ((rig.mirrors < 0) == (rig.sides == 0)).all()
    return left


@pytest.mark.parametrize("tremble", [0.0, 0.05])
def test_a_mirrored_figure_has_mirrored_bones(tremble):
    rig = medialis.bones(figure(tremble=tremble))
    left = paired(rig)
    right = rig.mirrors[left]
    # Within the chest one bone to each arm and the neck, as the thickness changes there.
    assert len(left) == 4 + 3 and rig.count == 2 * 7 + 3
    assert (rig.tails[left, 0] > 0).all()
    for ends in (rig.heads, rig.tails):
        apart = np.linalg.norm(ends[left] * [-1, 1, 1] - ends[right], axis=1)
        assert (apart < rig.head_radii[left]).all()
    known = [*ARM, *LEG, *(np.array([*ARM, *LEG]) * [-1, 1, 1])]
    apart = np.linalg.norm(np.array(known)[:, None] - rig.tails, axis=2)
    assert (apart.min(axis=1) < 0.7).all()  # the least radius of a limb


def test_the_spine_is_the_root_and_goes_to_the_hips():
    rig = medialis.bones(figure())
    assert rig.parents[0] == -1 and rig.sides[0] == 0
    assert np.allclose(rig.heads[0], [0, 0, 5]) and np.allclose(rig.tails[0], [0, 0, -5])
    hips = np.flatnonzero((rig.parents == 0) & rig.connected)
    assert len(hips) == 2 and rig.mirrors[hips[0]] == hips[1]


@pytest.mark.parametrize("seed", range(4))
def test_bones_and_pairs_turn_and_scale_with_the_shape(seed):
    turn = rotation(seed)
    before, after = medialis.bones(figure()), medialis.bones(figure(turn, 40.0))
    assert np.allclose(after.heads, 40 * before.heads @ turn.T, atol=1e-8)
    assert (after.parents == before.parents).all() and (after.mirrors == before.mirrors).all()
    left = np.flatnonzero(after.sides == 1)
    normal = turn[:, 0] * np.sign(turn[np.argmax(np.abs(turn[:, 0])), 0])
    assert (((after.tails - after.tails[after.mirrors])[left] @ normal) > 0).all()


def test_a_figure_that_mirrors_nothing_has_no_sides():
    rng = np.random.default_rng(2)
    nodes = [[0, 0, 0], *rng.normal(size=(6, 3)) * rng.uniform(3, 20, (6, 1))]
    rig = medialis.bones(CurveSkeleton.of(nodes, [[0, k] for k in range(1, 7)], [0.3] * 7))
    assert (rig.sides == 0).all() and rig.names[1] == "bone 001"


def test_every_bone_begins_at_an_end_of_its_parent():
    """Forks that lie in one ball are one joint; a link of half its radius or more is a bone."""
    for link in (0.4, 1.2):
        nodes = [
            [0, 0, 0],
            [0, 0, -link],
            [0, 0, 6],
            [5, 0, 2],
            [-5, 0, 2],
            [3, 0, -9],
            [-3, 0, -9],
        ]
        edges = [[0, 1], [0, 2], [0, 3], [0, 4], [1, 5], [1, 6]]
        curve = CurveSkeleton.of(nodes, edges, [2.0, 1.8, 1, 0.5, 0.5, 0.5, 0.5])
        rig = medialis.bones(curve, bend=10)
        below = np.flatnonzero(rig.parents >= 0)
        parent = rig.parents[below]
        at_tail = (rig.heads[below] == rig.tails[parent]).all(axis=1)
        at_head = (rig.heads[below] == rig.heads[parent]).all(axis=1)
        assert (at_tail | at_head).all()
        starts = {tuple(head) for head in rig.heads.tolist()}
        assert ((0.0, 0.0, -link) in starts) == (link == 1.2)


@pytest.mark.slow
def test_a_rod_of_triangles_has_one_bone():
    rig = medialis.run("armature", tube([segment([0, 0, 0], [4, 1, 0.5])], 0.3, 0.08)).extras[
        "bones"
    ]
    assert rig.count == 1


@pytest.mark.slow
@pytest.mark.parametrize("seed", [None, 5])
def test_a_quadruped_of_capsules(seed):
    """Joints within a radius of the knees; left and right by name."""
    knees = np.array([[0.75, 3, -2.2], [0.75, -3, -2.2]])
    feet = np.array([[0.75, 1.9, -4.4], [0.75, -4.1, -4.4]])
    curves, radii = [segment([0, 3, 0], [0, -3, 0]), segment([0, 3, 0], [0, 5.5, 2.0])], [0.8, 0.4]
    for side in (1, -1):
        for knee, foot in zip(knees, feet, strict=True):
            hip = knee * [1, 1, 0]
            curves.append(np.array([hip, knee, foot]) * [side, 1, 1])
            radii.append(0.3)
    turn = np.eye(3) if seed is None else rotation(seed)
    shape = capsules([curve @ turn.T for curve in curves], radii, 0.1)
    rig = medialis.run("armature", shape).extras["bones"]
    left = paired(rig)
    assert len(left) >= 4
    heads = rig.heads @ turn
    known = np.concatenate([knees, knees * [-1, 1, 1]])
    assert np.linalg.norm(known[:, None] - heads, axis=2).min(axis=1).max() < 0.3
    for ends in (rig.heads @ turn, rig.tails @ turn):
        apart = np.linalg.norm(ends[left] * [-1, 1, 1] - ends[rig.mirrors[left]], axis=1)
        assert (apart < rig.head_radii[left]).all()
