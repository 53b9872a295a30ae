"""Axes and rolls of bones, on stick figures whose limbs are known."""

import itertools

import numpy as np
import pytest

import medialis
from medialis.rigging.naming import roll_axes, rolls


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
        legs = np.flatnonzero((rig.sides != 0) & (rig.tails[:, 2] < 6))
        assert np.abs(x[legs[rig.parents[legs] >= 0], 0]).min() > 0.9


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


def test_rolls_are_those_that_turn_blenders_rest_axes_to_the_axes_of_bones():
    """Built from matrices: the shortest turn of y to the bone, then the roll about the bone."""
    rig = figure(*MAN)
    along = (rig.tails - rig.heads) / np.linalg.norm(rig.tails - rig.heads, axis=1)[:, None]
    for bone, roll, wanted in zip(along, rolls(rig), roll_axes(rig), strict=True):
        axis = np.cross([0, 1, 0], bone)
        rest = np.array([0, 0, 1.0])
        turned = rest + np.cross(axis, rest) + np.cross(axis, np.cross(axis, rest)) / (1 + bone[1])
        rolled = turned * np.cos(roll) + np.cross(bone, turned) * np.sin(roll)
        assert np.allclose(rolled, wanted, atol=1e-9)
