"""Bones along graphs that are known, and the weights of points round them."""

from dataclasses import replace

import numpy as np
import pytest

import medialis
from medialis.curves.curve_skeleton import CurveSkeleton
from medialis.rigging import bones as rigging
from medialis.rigging.bones import stiffness
from tubes import circle, segment, tube


def path(points, radii=0.3):
    k = len(points)
    edges = np.stack([np.arange(k - 1), np.arange(1, k)], axis=1)
    return CurveSkeleton.of(points, edges, np.broadcast_to(radii, k))


def line(x, radii=0.3):
    x = np.asarray(x, float)
    return path(np.stack([x, 0 * x, 0 * x], axis=1), radii)


def fork(twig=2.0):
    """Three limbs of length 4, 3 and `twig` from a junction, the first one thick."""
    nodes = [[0, 0, 0], [-2, 0, 0], [-4, 0, 0], [0, 3, 0], [0, -twig, 0]]
    return CurveSkeleton.of(nodes, [[0, 1], [1, 2], [0, 3], [0, 4]], [0.5, 0.5, 0.4, 0.2, 0.2])


def on_surface(curve, shape, node):
    """The same curve skeleton, which knows the node of each point of a surface; without balls."""
    none = np.empty(0)
    cloud = medialis.MedialCloud(
        np.empty((0, 3)), none, np.empty((0, 2)), none, none, none, none, surface=shape
    )
    return CurveSkeleton.of(curve.nodes, curve.edges, curve.radii, vertex_node=node, cloud=cloud)


def surface_of(points, curve):
    """Points as a cloud, each with its nearest node."""
    points = np.asarray(points, float)
    node = np.linalg.norm(points[:, None] - curve.nodes, axis=2).argmin(axis=1)
    return on_surface(curve, medialis.Shape(points, np.zeros_like(points)), node)


def lay(curve, length, **options):
    """Bones up to a length in units of the curve."""
    return medialis.bones(curve, bone_length=min(length / curve.diagonal, 1.0), **options)


def dense(skin, count):
    return np.stack([skin.of_bone(bone) for bone in range(count)], axis=1)


def test_a_line_is_split_into_equal_bones():
    rig = lay(line([0, 1, 2.5, 6]), 2.0)
    assert np.allclose(rig.heads[:, 0], [0, 2, 4], atol=1e-14)
    assert np.allclose(rig.tails[:, 0], [2, 4, 6], atol=1e-14)
    assert rig.parents.tolist() == [-1, 0, 1] and rig.connected.tolist() == [False, True, True]
    assert rig.names == ("bone 000", "bone 001", "bone 002") and rig.cut == 0
    assert lay(line([0, 6]), 1.9).count == 4
    assert lay(line([0, 6]), 100).count == 1


@pytest.mark.parametrize("blend", [0.0, 0.5, 2.0, 10.0])
@pytest.mark.parametrize("nodes", [[0, 6], np.linspace(0, 6, 61)], ids=["two nodes", "many"])
def test_weights_on_a_tube_are_linear_across_joints(blend, nodes):
    """Closed form: from 1 to 0 over `blend` radii on both sides, at most to the middle of bones.

    Points lie above the line, so that their place on it is their x, however few nodes it has.
    """
    curve, x = line(nodes), np.linspace(0, 6, 241)
    known = surface_of(np.stack([x, 0 * x + 0.3, 0 * x], axis=1), curve)
    rig = lay(known, 2.0, blend=blend)
    found = dense(medialis.skin_weights(rig, skin_smoothing=0), 3)
    reach = min(0.3 * blend, 1.0)

    def risen(at):  # how far the next bone has taken over at a joint
        if reach == 0:
            return (x >= at).astype(float)
        return np.clip((x - at + reach) / (2 * reach), 0, 1)

    expected = np.stack([1 - risen(2), risen(2) - risen(4), risen(4)], axis=1)
    assert np.allclose(found, expected, atol=1e-9)


def test_at_a_fork_only_parent_and_child_share():
    """On the child from 0 to 1 over two radii of the junction; the other child has nothing."""
    curve = fork()
    rig = lay(curve, 10.0)
    assert rig.heads.tolist() == [[0, 0, 0]] * 3 and rig.parents.tolist() == [-1, 0, 0]
    assert rig.tails.tolist() == [[-4, 0, 0], [0, 3, 0], [0, -2, 0]]  # the thickest is the root
    assert rig.connected.tolist() == [False, False, False]
    y = np.linspace(0, 3, 61)
    known = surface_of(np.stack([0 * y, y, 0 * y + 0.1], axis=1), curve)
    found = dense(medialis.skin_weights(replace(rig, curve=known), skin_smoothing=0), 3)
    assert np.allclose(found[:, 1], np.clip(y / 1.0, 0, 1), atol=1e-12)
    assert np.allclose(found[:, 0], 1 - found[:, 1], atol=1e-12) and (found[:, 2] == 0).all()


def test_twigs_get_no_bone_and_belong_to_the_fork():
    curve = fork(twig=0.4)  # the ball at the junction has radius 0.5
    rig = lay(curve, 10.0)
    assert rig.count == 2 and (rig.tails[:, 1] >= 0).all()
    known = surface_of([[0.1, -0.5, 0], [0.1, -0.2, 0]], curve)
    skin = medialis.skin_weights(replace(rig, curve=known), skin_smoothing=0)
    assert skin.bones[:, 0].tolist() == [0, 0] and (skin.weights[:, 0] == 1).all()
    assert lay(curve, 10.0, shortest=0.5).count == 3


def test_what_hangs_on_a_twig_hangs_on_the_limb_before():
    """A short bar between two forks: the limbs behind it are children of the root's bone.

    They begin at its head, not at the other fork: there would be a gap.
    """
    nodes = [[0, 0, 0], [0.2, 0, 0], [-3, 0, 0], [0, -3, 0], [2, 2, 0], [2, -2, 0]]
    edges = [[0, 1], [0, 2], [0, 3], [1, 4], [1, 5]]
    curve = CurveSkeleton.of(nodes, edges, [0.6, 0.5, 0.5, 0.2, 0.2, 0.2])
    rig = lay(curve, 10.0)
    assert rig.count == 4 and rig.parents.tolist() == [-1, 0, 0, 0]
    assert rig.tails[0].tolist() == [-3, 0, 0]
    assert (rig.heads == 0).all()


def test_loops_are_cut_opposite_to_the_root():
    turn = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    nodes = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    edges = np.stack([np.arange(40), (np.arange(40) + 1) % 40], axis=1)
    radii = np.full(40, 0.2)
    radii[7] = 0.3
    curve = CurveSkeleton.of(nodes, edges, radii)
    rig = medialis.bones(curve)
    assert rig.cut == 1 and len(rig.roots) == 1 and rig.heads[0].tolist() == nodes[7].tolist()
    cut = edges[rig.edge_limbs < 0][0]
    assert abs(abs(int(cut.mean()) - 7) - 20) <= 1
    # 40 chords make two limbs of nearly half the length each.
    assert rig.limbs.max() == 1 and rig.ends.max() == pytest.approx(np.pi, abs=0.2)


def test_parts_have_roots_of_their_own_and_points_a_bone():
    nodes = [[0, 0, 0], [2, 0, 0], [9, 9, 9]]
    curve = CurveSkeleton.of(nodes, [[0, 1]], [0.2, 0.3, 0.7])
    rig = lay(curve, 5)
    assert rig.parents.tolist() == [-1, -1]
    assert rig.heads[0].tolist() == [2, 0, 0]  # the thicker end
    assert rig.heads[1].tolist() == [9, 9, 9] and rig.tails[1].tolist() == [9, 9, 9.7]
    known = surface_of([[0, 0.1, 0], [9, 9, 8]], curve)
    assert medialis.skin_weights(replace(rig, curve=known)).bones[:, 0].tolist() == [0, 1]


@pytest.fixture(scope="module")
def creature():
    return medialis.organic_shape(100)


@pytest.fixture(scope="module")
def result(creature):
    return medialis.run("armature", creature)


@pytest.mark.slow
def test_turned_and_scaled_shapes_have_the_same_bones_and_weights(result):
    """The curve skeleton is turned with the shape, so only rounding differs."""
    curve, shape = result.extras["graph"], result.shape
    turn, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    turned = medialis.Shape(7 * shape.points @ turn.T, shape.normals @ turn.T, shape.faces)
    there = CurveSkeleton.of(7 * curve.nodes @ turn.T, curve.edges, 7 * curve.radii)
    moved = on_surface(there, turned, curve.vertex_node)
    before, after = lay(curve, 0.3), lay(moved, 2.1)
    assert np.allclose(after.heads, 7 * before.heads @ turn.T, atol=1e-9)
    assert (after.parents == before.parents).all()
    one = medialis.skin_weights(before)
    other = medialis.skin_weights(after)
    assert np.abs(dense(one, before.count) - dense(other, before.count)).max() < 1e-6


@pytest.mark.slow
def test_the_creature_can_be_rigged(result, creature):
    """Four legs, head, tail: a root on the trunk, all weights, neighbours alike."""
    rig, skin = result.extras["bones"], result.extras["skin"]
    assert len(rig.roots) == 1 and rig.cut == 0 and len(skin.bones) == creature.point_count
    assert (rig.parents < np.arange(rig.count)).all()
    used = skin.bones >= 0
    assert (skin.weights[~used] == 0).all() and (skin.weights[used] > 0).all()
    assert np.allclose(skin.weights.sum(axis=1), 1, atol=1e-12)
    assert (np.diff(skin.weights, axis=1) <= 0).all()
    assert set(skin.bones[:, 0].tolist()) == set(range(rig.count))  # each bone moves something
    weights = dense(skin, rig.count)
    a, b = creature.edges.T
    # The smoothing of 0.3 radii spreads a jump over several edges: without it there are jumps of 1.
    assert np.quantile(np.abs(weights[a] - weights[b]).max(axis=1), 0.999) < 0.5
    bones, surface = result.layers
    assert surface.on_input and bones.edges.shape == (rig.count, 2)
    assert [row["name"] for row in result.values["bone_table"]] == list(rig.names)


@pytest.mark.slow
def test_limbs_of_a_fork_do_not_move_each_other():
    """A Y of tubes: three radii from the fork a limb has no weight of another one.

    The transition ends two radii behind the junction, and the smoothing, exp(-d / 0.3 r), falls
    below the least weight of 0.01 within 1.4 radii.
    """
    ends = [np.array([0, -1.6, 0]), np.array([1.2, 1.2, 0]), np.array([-1.2, 1.2, 0])]
    shape = tube([segment([0, 0, 0], end) for end in ends], 0.2, 0.05)
    result = medialis.run("armature", shape)
    rig, skin = result.extras["bones"], result.extras["skin"]
    assert len(rig.roots) == 1 and rig.limbs.max() == 2
    tips = [rig.tails[rig.limbs == limb][-1] for limb in range(3)]
    of_end = [int(np.argmin([np.linalg.norm(tip - end) for end in ends])) for tip in tips]
    assert sorted(of_end) == [0, 1, 2]
    weights = dense(skin, rig.count)
    for limb in range(3):
        end = ends[of_end[limb]]
        way = shape.points @ (end / np.linalg.norm(end))
        off = np.linalg.norm(shape.points - way[:, None] * end / np.linalg.norm(end), axis=1)
        far = (way > 5 * 0.2) & (off < 0.25)
        others = rig.limbs != limb
        assert far.sum() > 50 and weights[far][:, others].max() == 0


@pytest.mark.slow
def test_smoothing_solves_the_diffusion_equation():
    """Against the dense solution, with a Laplacian summed face by face."""
    shape = medialis.organic_shape(56)
    points, faces = shape.points, shape.faces
    n = len(points)
    weights, mass = np.zeros((n, n)), np.zeros(n)
    for face in faces:
        for k in range(3):
            o, a, b = face[k], face[(k + 1) % 3], face[(k + 2) % 3]
            u, v = points[a] - points[o], points[b] - points[o]
            area = np.linalg.norm(np.cross(u, v))
            weights[a, b] += u @ v / area / 2
            weights[b, a] += u @ v / area / 2
            mass[o] += area / 6
    weights = np.maximum(weights, 0)
    expected = np.diag(weights.sum(axis=1)) - weights
    found, areas = stiffness(shape)
    assert np.allclose(found.toarray(), expected, atol=1e-9) and np.allclose(areas, mass)
    x = points[:, 0]
    curve = line(np.linspace(x.min(), x.max(), 2))
    known = on_surface(curve, shape, (x > x.mean()).astype(int))
    rig = lay(known, 0.6 * float(np.ptp(x)), blend=0)
    raw = dense(medialis.skin_weights(rig, skin_smoothing=0), rig.count)
    smooth = dense(medialis.skin_weights(rig, skin_smoothing=1), rig.count)
    pull = np.diag(mass / 0.3**2)
    right = np.linalg.solve(pull + expected, pull @ raw)
    right[right < 0.01] = 0
    assert np.allclose(smooth, right / right.sum(axis=1, keepdims=True), atol=1e-9)


def test_vertices_without_a_node_take_a_neighbours_weights():
    curve = line([0, 1, 2, 3, 4])
    node = np.array([0, -1, 4])
    shape = medialis.Shape(np.array([[0, 0.3, 0], [3.9, 0.4, 0], [4, 0.3, 0]]), np.zeros((3, 3)))
    for known in (node, [-1, -1, -1]):
        rig = lay(on_surface(curve, shape, known), 2)
        assert medialis.skin_weights(rig).bones[:, 0].tolist() == [0, 1, 1]


def test_bad_input_is_a_sentence(creature, result):
    with pytest.raises(medialis.InvalidShapeError, match="at least one node"):
        medialis.bones(CurveSkeleton.of(np.empty((0, 3)), np.empty((0, 2), int), []))
    for option in ({"bone_length": 0}, {"shortest": -1}, {"blend": np.nan}):
        with pytest.raises(medialis.InvalidOptionError, match=next(iter(option))):
            medialis.bones(line([0, 1]), **option)
    rig = medialis.bones(line([0, 1]))
    with pytest.raises(medialis.InvalidShapeError, match="knows the points of its surface"):
        medialis.skin_weights(rig)
    with pytest.raises(medialis.InvalidShapeError, match="a row for each of the"):
        on_surface(line([0, 1]), creature, [0, 1])
    with pytest.raises(medialis.InvalidOptionError, match="skin_smoothing"):
        medialis.skin_weights(result.extras["bones"], skin_smoothing=-1)
    with pytest.raises(medialis.InvalidShapeError, match=r"shape \(n, k\)"):
        medialis.SkinWeights(np.zeros((3, 4), int), np.zeros((3, 3)))
    cloud = medialis.Shape(creature.points, creature.normals)
    with pytest.raises(medialis.InvalidShapeError, match="got a point cloud"):
        medialis.run("armature", cloud)


@pytest.mark.slow
def test_what_was_cut_and_bridged_is_reported():
    ring = tube([circle([0, 0, 0], 1.0)], 0.2, 0.07)
    other = medialis.Shape(ring.points + np.array([5, 0, 0]), ring.normals, ring.faces)
    both = medialis.Shape(
        np.concatenate([ring.points, other.points]),
        np.concatenate([ring.normals, other.normals]),
        np.concatenate([ring.faces, other.faces + len(ring.points)]),
    )
    result = medialis.run("armature", both)
    assert result.values["cut_loops"] == 2 and result.values["roots"] == 1
    told = {message.code: message.data for message in result.messages}
    assert told["loops_cut"]["loops"] == 2 and told["pieces_bridged"]["bridges"] == 1


@pytest.mark.slow
def test_solving_for_bones_together_changes_nothing(monkeypatch, result):
    """More bones than are solved for at once, against one after the other."""
    rig = medialis.bones(result.extras["graph"], bone_length=0.03)
    assert rig.count > 2 * rigging.AT_ONCE
    together = rigging._skin(rig, result.extras["graph"].surface, 0.3)
    monkeypatch.setattr(rigging, "AT_ONCE", 1)
    alone = rigging._skin(rig, result.extras["graph"].surface, 0.3)
    assert np.abs(dense(together, rig.count) - dense(alone, rig.count)).max() < 1e-12
