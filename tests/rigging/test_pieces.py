"""Characters of many pieces: one root, the kind of their union, and weights of loose pieces."""

import numpy as np
import pytest

import medialis
from medialis.rigging.binding import bind_weights
from medialis.rigging.deforming import deforming, is_end_marker, is_eye
from pieced_figures import Figure, capsule, limbs, members, pieces_of, shape_of


def joined(pieces):
    """One shape of pieces, each points and faces."""
    starts = np.cumsum([0, *(len(points) for points, _ in pieces)])
    faces = [faces + start for (_, faces), start in zip(pieces, starts, strict=False)]
    points = np.concatenate([points for points, _ in pieces])
    return medialis.make_shape(points, np.concatenate(faces))


@pytest.mark.slow
@pytest.mark.parametrize(
    "figure",
    [
        Figure(),
        Figure(gap=0.02, turn=3, scale=100.0),
        Figure(clothes=True, hair=6, eyes=True, teeth=8, buttons=3, turn=5),
    ],
)
def test_a_figure_of_pieces_has_one_root_and_the_bones_of_a_biped(figure):
    """The 17 capsules got 15 roots and no kind."""
    result = medialis.run("armature", shape_of(figure))
    assert result.values["roots"] == 1 and result.values["kind"] == "biped"
    assert result.values["bones"] == 21
    told = {message.code: message.data for message in result.messages}
    assert told["pieces_united"]["pieces"] >= 17
    assert ("pieces_bridged" in told) == (figure.gap > 0)
    assert np.allclose(result.extras["skin"].weights.sum(axis=1), 1.0)


@pytest.mark.slow
def test_joints_of_a_figure_of_pieces_are_where_its_capsules_meet():
    figure = Figure()
    result = medialis.run("armature", shape_of(figure))
    rig = result.extras["bones"]
    heads = dict(zip(rig.names, rig.heads, strict=True))
    parts = limbs(figure)
    for name, joint in (("forearm", parts["forearm.L"][0]), ("shin", parts["shin.L"][0])):
        place = joint * [1 if heads[f"{name}.L"][0] > 0 else -1, 1, 1]
        # Straight limbs show no joint: it is at the usual fraction of their length.
        assert np.linalg.norm(heads[f"{name}.L"] - place) < 0.05


@pytest.mark.slow
@pytest.mark.parametrize("away", [0.0, 0.02])
def test_a_sword_is_no_limb(away):
    hand = limbs(Figure())["hand.R"][1]
    start = hand + np.array([0, 0.02 if away == 0 else -0.03 - away, 0])
    pieces = [*pieces_of(Figure()), capsule(start, hand + np.array([0, -0.4, 0]), 0.008)]
    result = medialis.run("armature", joined(pieces))
    assert result.values["kind"] == "biped" and result.values["bones"] == 21
    skin = result.extras["skin"]
    sword = np.arange(len(skin.bones)) >= sum(len(points) for points, _ in pieces[:-1])
    names = np.array(result.extras["bones"].names)[skin.bones[sword, 0]]
    assert len(set(names)) == 1 and names[0].startswith("hand")


@pytest.mark.slow
def test_one_root_and_the_kind_of_the_union_in_a_family():
    found = [medialis.run("armature", shape_of(figure)).values for figure in members(6, 21)]
    assert all(values["roots"] == 1 for values in found)
    assert sum(values["kind"] == "biped" for values in found) >= 5


NECK = medialis.Armature(
    [[0, 0, -0.1], [0, 0, 0], [0, 0, 0.11]], [[0, 0, 0], [0, 0, 0.11], [0, 0, 0.17]],
    [-1, 0, 1], ("chest", "neck", "head"),
)  # fmt: skip


@pytest.mark.slow
def test_hair_above_the_head_follows_the_head():
    """The bun had the cheapest way outside of the body to the neck."""
    head, bun = capsule([0, 0, 0.25], [0, 0, 0.26], 0.16), capsule([0, 0, 0.48], [0, 0, 0.5], 0.05)
    shape = joined([head, capsule([0, 0, 0], [0, 0, 0.2], 0.06), bun])
    skin = bind_weights(shape, armature=NECK)
    last = np.arange(shape.point_count) >= shape.point_count - len(bun[0])
    assert (skin.bones[last, 0] == 2).all() and np.ptp(skin.weights[last, 0]) == 0


@pytest.mark.slow
def test_eye_bones_move_eyeballs_and_nothing_of_the_face():
    eyes = [capsule([x, -0.13, 0.28], [x, -0.132, 0.28], 0.015) for x in (0.06, -0.06)]
    shape = joined([capsule([0, 0, 0.25], [0, 0, 0.26], 0.16), *eyes])
    heads, tails = np.array(NECK.heads), np.array(NECK.tails)
    places = np.array([[0.06, -0.13, 0.28], [-0.06, -0.13, 0.28]])
    rig = medialis.Armature(
        np.concatenate([heads, places]), np.concatenate([tails, places - [0, 0.03, 0]]),
        [-1, 0, 1, 2, 2], ("chest", "neck", "head", "LeftEye", "RightEye"),
    )  # fmt: skip
    skin = bind_weights(shape, armature=rig)
    count = len(eyes[0][0])
    left = np.arange(shape.point_count) >= shape.point_count - 2 * count
    right = np.arange(shape.point_count) >= shape.point_count - count
    assert (skin.bones[right] == [4, -1, -1, -1]).all()
    assert (skin.bones[left & ~right, 0] == 3).all()
    assert not np.isin(skin.bones[~left], [3, 4]).any()


def test_end_markers_roots_and_helpers_do_not_deform():
    names = ("root", "pelvis", "head", "HeadTop_End", "ik_hand_l", "Toe0Nub", "tail_end.R")
    heads = np.arange(21.0).reshape(7, 3)
    rig = medialis.Armature(heads, heads + 1, [-1, 0, 1, 2, 0, 1, 1], names)
    assert deforming(rig).tolist() == [False, True, True, False, False, False, False]
    only = medialis.Armature(heads[:1], heads[:1] + 1, [-1], ("root",))
    assert deforming(only).tolist() == [True]


def test_a_bone_with_children_is_no_end_marker():
    heads = np.arange(9.0).reshape(3, 3)
    rig = medialis.Armature(heads, heads + 1, [-1, 0, 1], ("spine", "tail_end", "tip"))
    assert deforming(rig).all()


@pytest.mark.parametrize("name", ["LeftToe_End", "Bip01 HeadNub", "mixamorig:LeftHandRing4"])
def test_names_of_end_markers(name):
    assert is_end_marker(name) and not is_eye(name)
