"""Test poses: where a rig is bent, which way, and what is counted there."""

import json
from dataclasses import replace

import numpy as np
import pytest

import medialis
from medialis.base.progress import Progress
from medialis.rigging import poses
from medialis.rigging.naming import TARGETS

PARTS = {
    "hips": ((0, 0, 1.0), (0, 0, 1.1), ""),
    "spine": ((0, 0, 1.1), (0, 0, 1.3), "hips"),
    "chest": ((0, 0, 1.3), (0, 0, 1.5), "spine"),
    "neck": ((0, 0, 1.5), (0, 0, 1.6), "chest"),
    "head": ((0, 0, 1.6), (0, 0, 1.8), "neck"),
    "upper_arm.L": ((0.2, 0, 1.45), (0.5, 0, 1.45), "chest"),
    "forearm.L": ((0.5, 0, 1.45), (0.8, 0, 1.45), "upper_arm.L"),
    "thigh.L": ((0.1, 0, 1.0), (0.1, 0, 0.5), "hips"),
    "shin.L": ((0.1, 0, 0.5), (0.1, 0, 0.1), "thigh.L"),
}


def person(target="plain", bent=0.0):
    """A figure that looks along -y; its elbows are bent to the back by so much."""
    both = dict(PARTS)
    for name, (head, tail, parent) in PARTS.items():
        if name.endswith(".L"):
            other = parent[:-1] + "R" if parent.endswith(".L") else parent
            both[name[:-1] + "R"] = (np.multiply(head, [-1, 1, 1]), np.multiply(tail, [-1, 1, 1]),
                                     other)  # fmt: skip
    rows = {name: row for row, name in enumerate(both)}
    tails = np.array([tail for _, tail, _ in both.values()], float)
    for name in ("forearm.L", "forearm.R"):
        tails[rows[name], 1] += bent
    named = tuple(TARGETS[target].name(name) if target else f"b{row}" for name, row in rows.items())
    return medialis.Armature(
        np.array([head for head, _, _ in both.values()], float),
        tails,
        [rows.get(parent, -1) for _, _, parent in both.values()],
        named,
    )


@pytest.mark.parametrize(
    ("target", "change"),
    [
        ("mixamo", lambda name: name.removeprefix("mixamorig:")),
        ("mixamo", lambda name: name.replace("mixamorig:", "mixamorig")),
        ("mixamo", lambda name: name.replace("mixamorig:", "mixamorig12:")),
        ("unreal", lambda name: f"SK_Mannequin|{name}"),
        ("rigify", lambda name: f"DEF-{name}"),
        ("vrm", lambda name: name[:1].upper() + name[1:]),
        ("vrm", lambda name: "J_Bip_" + (f"L_{name[4:]}" if name.startswith("left") else
                f"R_{name[5:]}" if name.startswith("right") else f"C_{name.capitalize()}")),
    ],
)  # fmt: skip
def test_parts_of_figures_are_known_with_and_without_prefixes(target, change):
    """Only the names with the prefix "mixamorig:" were known."""
    rig = person(target)
    other = replace(rig, names=tuple(change(name) for name in rig.names))
    found = poses.figure_parts(other)
    assert found.rows == poses.figure_parts(rig).rows and len(found.rows) == len(rig.names)


@pytest.mark.parametrize("target", TARGETS)
def test_joints_of_figures_are_known_by_the_names_of_all_programs(target):
    rig = person(target)
    bends = {bend.joint: bend for bend in poses.test_poses(rig)}
    assert list(bends) == ["elbows", "shoulders", "knees", "hips", "neck", "spine"]
    goes = {"elbows": [0, -1, 0], "shoulders": [0, -1, 0], "knees": [0, 1, 0], "hips": [0, -1, 0],
            "neck": [0, -1, 0], "spine": [0, -1, 0]}  # fmt: skip
    for joint, bend in bends.items():
        assert len(bend.bones) == (1 if joint in ("neck", "spine") else 2)
        for bone, turn in zip(bend.bones, bend.turns, strict=True):
            along = rig.tails[bone] - rig.heads[bone]
            along /= np.linalg.norm(along)
            assert np.allclose(turn @ turn.T, np.eye(3)) and np.linalg.det(turn) > 0
            # A bone at right angles to where it goes is as far there as the sine of its turn.
            assert turn @ along @ goes[joint] == pytest.approx(np.sin(np.radians(bend.degrees)))


def test_an_elbow_that_is_bent_already_goes_on_that_way():
    rig = person(bent=0.3)
    elbows = poses.test_poses(rig)[0]
    along = (rig.tails - rig.heads)[elbows.bones] / np.hypot(0.3, 0.3)
    for own, turn in zip(along, elbows.turns, strict=True):
        # 45 degrees and 80 more, to the back
        assert np.degrees(np.arctan2((turn @ own)[1], abs(own[0]) / own[0] * (turn @ own)[0])) == (
            pytest.approx(125)
        )


def test_rigs_without_names_bend_at_their_largest_joints_both_sides_at_once():
    rig = person("")
    bends = poses.test_poses(rig)
    assert 1 <= len(bends) <= poses.MOST_POSES
    chain = medialis.Armature(
        [[0, 0, 0], [1, 0, 0], [3, 1, 0], [3, -1, 0]],
        [[1, 0, 0], [3, 0, 0], [5, 1, 0], [5, -1, 0]],
        [-1, 0, 1, 1], ("root", "trunk", "leg_l", "leg_r"),
    )  # fmt: skip
    found = poses.test_poses(chain)
    assert [bend.joint for bend in found] == ["leg_l", "trunk"]
    assert found[0].bones.tolist() == [2, 3]
    assert poses.test_poses(medialis.Armature([[0, 0, 0]], [[1, 0, 0]], [-1])) == ()


@pytest.fixture(scope="module")
def rod():
    """A rod along z from -1 to 1, of radius 0.2, and two bones that meet in its middle."""
    turn, heights, around = 2 * np.pi * np.arange(16) / 16, np.linspace(-1, 1, 41), np.arange(16)
    ring = 0.2 * np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    points = np.vstack([*(ring + np.array([0, 0, z]) for z in heights), [0, 0, -1], [0, 0, 1]])
    near, far = around, (around + 1) % 16
    faces = [np.stack([near + k, far + k, far + k + 16, near + k, far + k + 16, near + k + 16], 1)
             for k in range(0, 640, 16)]  # fmt: skip
    caps = [
        np.stack([far, near, 0 * near + 656], 1),
        np.stack([near + 640, far + 640, near * 0 + 657], 1),
    ]
    shape = medialis.make_shape(points, np.concatenate([np.reshape(faces, (-1, 3)), *caps]))
    rig = medialis.Armature([[0, 0, -1], [0, 0, 0]], [[0, 0, 0], [0, 0, 1]], [-1, 0], ("a", "b"))
    return shape, rig


def weighed(shape, rig, share):
    share = np.clip(share, 0, 1)
    bones = np.tile(np.array([0, 1], np.int32), (len(share), 1))
    return medialis.SkinWeights(bones, np.stack([1 - share, share], axis=1), rig=rig)


def test_what_is_counted_is_what_moves(rod):
    """By hand: with a step between two rings only the edges across it change."""
    shape, rig = rod
    upper = shape.points[:, 2] > 0.01
    (strain,) = poses.strains(shape, weighed(shape, rig, upper.astype(float)))
    turn = strain.bend.turns[0]
    moved = np.where(upper[:, None], shape.points @ turn.T, shape.points)
    assert np.abs(strain.points - moved).max() < 1e-12
    a, b = shape.edges.T
    ratio = np.linalg.norm(moved[a] - moved[b], axis=1) / shape.edge_lengths
    assert strain.largest == pytest.approx(ratio.max()) and ratio.max() > 2
    assert strain.stretched == (ratio >= 2).sum() > 0
    assert strain.edges == 0  # none is moved partly
    across = upper[a] != upper[b]
    assert (np.abs(ratio[~across] - 1) < 1e-9).all()
    assert strain.collapsed > 0  # inside of the bend
    assert strain.stretch.max() == pytest.approx(ratio.max())


def test_smooth_weights_are_clean(rod):
    """Over three radii both ways no edge is longer than the derivative of blending allows.

    Along the rod the share rises by 1 / 1.2 a unit, and a share of 1 moves a place that is v from
    the joint by 2 sin(angle / 2) |v|, where |v| is at most that of the rim at the ends.
    """
    shape, rig = rod
    (strain,) = poses.strains(shape, weighed(shape, rig, shape.points[:, 2] / 1.2 + 0.5))
    assert (strain.stretched, strain.collapsed) == (0, 0)
    moves = 2 * np.sin(np.radians(strain.bend.degrees) / 2) * np.hypot(0.2, 0.6 + 0.05)
    assert 1 < strain.largest < 1 + moves / 1.2 and strain.edges > 0


@pytest.mark.slow
def test_operations_tell_the_joint_and_draw_it(rod, tmp_path):
    shape, rig = rod
    path = tmp_path / "bones.json"
    rows = [
        {"name": name, "parent": None if up < 0 else up, "head": head, "tail": tail}
        for name, up, head, tail in zip(
            rig.names, rig.parents.tolist(), rig.heads.tolist(), rig.tails.tolist(), strict=True
        )
    ]
    path.write_text(json.dumps({"bones": rows}))
    result = medialis.run("bind", shape, armature=str(path), softness=0, poses=True)
    (row,) = result.values["test_poses"]
    assert row["bones"] == ["b"] and row["stretched"] > 0
    told = [str(one) for one in result.messages if one.code == "strained"]
    assert len(told) == 1 and told[0].startswith("Bent by 50 degrees at b: ")
    files = medialis.write_result(result, tmp_path / "out", pictures=medialis.Pictures(True))
    assert (tmp_path / "out/test_poses.png").stat().st_size > 1000
    assert files["picture"].endswith("bind.png")
    plain = medialis.run("bind", shape, armature=str(path), softness=0)
    assert "test_poses" not in plain.values and not plain.panels
    away_by = np.array([5e6, 0, 0])
    far = medialis.make_shape(shape.points + away_by, shape.faces)
    for one in rows:
        one["head"][0] += 5e6
        one["tail"][0] += 5e6
    path.write_text(json.dumps({"bones": rows}))
    away = medialis.run("bind", far, armature=str(path), softness=0, poses=True)
    assert away.values["test_poses"][0]["stretched"] == row["stretched"]
    panel = away.panels["test_poses"][0][1]
    assert np.abs(panel.points - result.panels["test_poses"][0][1].points - away_by).max() < 1e-6


def test_a_rig_of_one_bone_has_no_joint_and_says_so(rod):
    shape, _ = rod
    one = medialis.Armature([[0, 0, -1]], [[0, 0, 1]], [-1])
    skin = medialis.SkinWeights(
        np.zeros((shape.point_count, 1), np.int32), np.ones((shape.point_count, 1)), rig=one
    )
    progress = Progress()
    rows, panels = poses.tried(shape, skin, progress)
    assert rows == [] and panels == ()
    assert "no joint to bend" in str(progress.messages[-1])
