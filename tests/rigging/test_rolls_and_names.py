"""Rolls and names of bones, on stick figures whose limbs are known."""

import itertools

import numpy as np
import pytest

import medialis
from medialis.rigging.naming import mixamo_names, rigify_names, roll_axes


def figure(*limbs):
    """Return the bones of a curve skeleton of limbs: lists of places with radius (x, y, z, r)."""
    places: list[tuple[float, ...]] = []
    edges = []
    for limb in limbs:
        for a, b in itertools.pairwise(limb):
            pair = []
            for place in (a, b):
                if place not in places:
                    places.append(place)
                pair.append(places.index(place))
            edges.append(pair)
    table = np.array(places)
    return medialis.bones(
        medialis.CurveSkeleton.of(table[:, :3], edges, table[:, 3]), shortest=0.0, bend=0.05
    )


def both(*limb):
    """Return a limb and its mirror image under x = 0."""
    return limb, tuple((-x, y, z, r) for x, y, z, r in limb)


PELVIS, CHEST, HEAD = (0, 0, 10, 1.0), (0, 0, 16, 1.2), (0, 0, 20, 0.9)
MAN = (
    (PELVIS, CHEST),
    (CHEST, HEAD),
    *both(PELVIS, (2, 0, 9, 0.8), (2, -0.5, 5, 0.6), (2, 0, 1, 0.4), (2, -2, 0.5, 0.3)),
    *both(CHEST, (5, 0, 16, 0.5), (9, -1, 16, 0.4)),
)
HIP, NECK = (0, 8, 8, 1.0), (0, 0, 8, 1.2)
DOG = (
    (HIP, NECK),
    (NECK, (0, -4, 12, 1.0)),
    (HIP, (0, 12, 9, 0.3), (0, 15, 11, 0.2)),
    *both(NECK, (1.5, 0, 7, 0.6), (1.5, 0.5, 4, 0.5), (1.5, 0, 0, 0.4)),
    *both(HIP, (1.5, 8, 7, 0.6), (1.5, 9, 4, 0.5), (1.5, 8, 0, 0.4)),
)


def test_a_person_has_arms_and_legs():
    rig = figure(*MAN)
    names = rigify_names(rig)
    assert len(set(names)) == rig.count
    lowest, highest = rig.tails[:, 2].argmin(), rig.tails[:, 2].argmax()
    assert names[lowest].startswith(("foot", "toe")) and names[highest].startswith("spine")
    assert names[rig.tails[:, 0].argmax()].endswith("arm.L") or "hand.L" in names
    assert {"thigh.L", "thigh.R", "shin.L", "upper_arm.L", "upper_arm.R"} <= set(names)
    assert not any(name.startswith(("tail", "front")) for name in names)
    for bone, mirror in enumerate(rig.mirrors.tolist()):
        if mirror >= 0:
            assert names[bone][:-2] == names[mirror][:-2] and names[bone] != names[mirror]


def test_an_animal_has_front_legs_and_a_tail():
    rig = figure(*DOG)
    names = rigify_names(rig)
    assert len(set(names)) == rig.count and not any("arm" in name for name in names)
    place = dict(zip(names, rig.heads, strict=True))
    assert place["front_thigh.L"][1] < place["thigh.L"][1]
    assert rig.tails[names.index("tail")][1] > 8


def test_without_mirrored_limbs_nothing_is_an_arm():
    rig = figure(((0, 0, 0, 1), (0, 0, 5, 1)), ((0, 0, 5, 1), (3, 0, 9, 0.5)))
    assert {name.split(".")[0].split("_")[0] for name in rigify_names(rig)} <= {"spine", "limb"}


def test_a_person_has_the_names_of_mixamo():
    rig = figure(*MAN)
    names = [name.removeprefix("mixamorig:") for name in mixamo_names(rig)]
    assert all(name.startswith("mixamorig:") for name in mixamo_names(rig))
    assert len(set(names)) == rig.count
    place = dict(zip(names, zip(rig.heads, rig.tails, strict=True), strict=True))
    wanted = {"UpLeg", "Leg", "Foot", "Arm"}
    assert {side + word for side in ("Left", "Right") for word in wanted} <= set(names)
    assert {"Hips", "Head"} <= set(names)
    # The head ends at the top, the hips at the legs; left is x.
    assert max(end[2] for end in place["Head"]) == 20 and min(end[2] for end in place["Hips"]) == 10
    assert place["LeftArm"][1][0] > 0 > place["RightArm"][1][0]
    # The spine ends where the arms begin, whatever its bones are.
    trunk = [name for name in names if name == "Hips" or name.startswith("Spine")]
    assert max(end[2] for name in trunk for end in place[name]) == place["LeftArm"][0][2] == 16
    assert place["LeftUpLeg"][0][2] > place["LeftLeg"][0][2] > place["LeftFoot"][0][2]


def test_front_legs_are_arms_for_mixamo():
    rig = figure(*DOG)
    names = [name.removeprefix("mixamorig:") for name in mixamo_names(rig)]
    assert len(set(names)) == rig.count and {"LeftUpLeg", "LeftArm", "Tail", "Hips"} <= set(names)
    place = dict(zip(names, rig.heads, strict=True))
    assert place["LeftArm"][1] < place["LeftUpLeg"][1]


def test_long_arms_have_shoulders_and_more_pairs_numbers():
    spine = [(0, 0, 0, 1.0), (0, 0, 4, 1.1), (0, 0, 8, 1.2), (0, 0, 11, 0.8)]
    bent = [(2, 0, 8, 0.5), (4, 1, 8, 0.5), (6, -1, 8, 0.5), (8, 1, 8, 0.5), (10, -1, 8, 0.4)]
    lower = [(x, y, 4, r) for x, y, _, r in bent]
    legs = both(spine[0], (1, 0, -1, 0.5), (1, 0.5, -4, 0.5), (1, 0, -7, 0.4))
    arms = *both(spine[2], *bent), *both(spine[1], *lower)
    rig = figure(*itertools.pairwise(spine), *legs, *arms)
    names = {name.removeprefix("mixamorig:") for name in mixamo_names(rig)}
    assert len(names) == rig.count
    assert {"LeftShoulder", "LeftArm", "LeftForeArm", "LeftHand", "LeftHand_2"} <= names


@pytest.mark.slow
@pytest.mark.parametrize("naming", [rigify_names, mixamo_names])
def test_every_bone_of_any_tree_has_a_name_of_its_own(naming):
    for seed in range(12):
        rng = np.random.default_rng(seed)
        count = int(rng.integers(2, 14))
        places = rng.normal(size=(count, 3)) * [1, 1, 3]
        edges = [[int(rng.integers(max(0, k - 4), k)), k] for k in range(1, count)]
        if seed % 2:  # with a mirror image
            places = np.concatenate([places, places[1:] * [-1, 1, 1]])
            places[0, 0] = 0
            edges += [[a + count - 1 if a else 0, b + count - 1] for a, b in edges]
        curve = medialis.CurveSkeleton.of(places, edges, rng.uniform(0.1, 0.5, len(places)))
        rig = medialis.bones(curve, shortest=0.0)
        names = naming(rig)
        assert len(names) == rig.count == len(set(names))


def test_axes_are_at_right_angles_and_limbs_bend_about_x():
    """The knee is bent forwards (y): its bones turn about the axis across the body."""
    for given in (MAN, DOG):
        rig = figure(*given)
        z = roll_axes(rig)
        along = (rig.tails - rig.heads) / np.linalg.norm(rig.tails - rig.heads, axis=1)[:, None]
        assert np.allclose(np.linalg.norm(z, axis=1), 1)
        assert np.abs((z * along).sum(axis=1)).max() < 1e-12
        x = np.cross(along, z)
        middle = rig.sides == 0
        assert np.allclose(np.abs(x[middle, 0]), 1)  # the spine nods, it does not lean
        shins = [b for b, name in enumerate(rigify_names(rig)) if "shin" in name]
        assert np.abs(x[shins, 0]).min() > 0.99


def test_mirrored_bones_have_mirrored_axes():
    rig = figure(*MAN)
    z = roll_axes(rig)
    left = np.flatnonzero(rig.sides > 0)
    assert np.allclose(z[rig.mirrors[left]], z[left] * [-1, 1, 1])


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_axes_turn_with_a_bent_limb(seed):
    """A limb that is bent says itself how it bends, whichever way it is turned."""
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    places = np.array([[0, 0, 0], [4, 0, 0], [6, 3, 0], [6, 7, 0.0]])

    def rig(points):
        edges = [[0, 1], [1, 2], [2, 3]]
        return medialis.bones(medialis.CurveSkeleton.of(points, edges, [0.3] * 4), bend=0.05)

    plain, turned = rig(places), rig(places @ turn.T)
    assert np.allclose(roll_axes(plain) @ turn.T, roll_axes(turned))
    x = np.cross(plain.tails - plain.heads, roll_axes(plain))
    assert np.allclose(x[:, :2], 0) and len({*np.sign(x[:, 2])}) == 1
