"""Patches of meshes follow creases, hang together, and bend no more than their edges (6.3.2)."""

import math
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

import closed_forms as forms
import medialis
from medialis.shape.surface import piece_labels

STEP = 0.08
HYPOTENUSE = math.hypot(3, 2.4)


def shaft(rows):
    """A solid turned from steps of (radius, height), or a tube where the first radius is not 0."""
    rows = np.array(rows, float)
    profile = [rows[0]]
    for a, b in pairwise(rows):
        pieces = max(1, math.ceil(np.linalg.norm(b - a) / STEP))
        profile += [a + (b - a) * k / pieces for k in range(1, pieces + 1)]
    return forms.revolved(np.array(profile), around=64)


def tube(inner, outer, height, around=64):
    """A tube: two ends, the wall outside and the bore."""
    corners = [(inner, 0), (outer, 0), (outer, height), (inner, height)]
    ring = []
    for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
        a, b = np.array(a, float), np.array(b, float)
        pieces = max(1, math.ceil(np.linalg.norm(b - a) / STEP))
        ring += [a + (b - a) * k / pieces for k in range(pieces)]
    ring, turn = np.array(ring), 2 * np.pi * np.arange(around) / around
    radius, height = ring.T
    points = np.stack(
        [
            np.outer(np.cos(turn), radius),
            np.outer(np.sin(turn), radius),
            np.broadcast_to(height, (around, len(ring))),
        ],
        axis=2,
    )
    i, j = np.meshgrid(np.arange(around), np.arange(len(ring)), indexing="ij")
    i, j = i.ravel(), j.ravel()
    ahead, up = (i + 1) % around, (j + 1) % len(ring)
    corners = (i, j), (ahead, j), (ahead, up), (i, up)
    a, b, c, d = (p * len(ring) + q for p, q in corners)
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return forms.mesh(points.reshape(-1, 3), faces)


KNOWN = {
    "box": (lambda: forms.box_mesh((2.0, 1.5, 1.0), 0.1), 6),
    "wedge": (lambda: forms.prism(forms.TRIANGLE, 0.8, 0.1), 5),
    "sharp wedge": (lambda: forms.prism([[0, 0], [3, 0], [0, 0.6]], 0.8, 0.1), 5),
    "L": (lambda: forms.prism(forms.L_OUTLINE, 0.8, 0.1), 8),
    "T": (lambda: forms.prism(forms.T_OUTLINE, 0.8, 0.1), 10),
    "prism": (lambda: forms.prism(forms.disc_outline(1.0, 6), 0.8, 0.1), 8),
    "cylinder": (lambda: forms.rounded_cylinder(1.0, 1.6, 0.0, STEP), 3),
    "rounded cylinder": (lambda: forms.rounded_cylinder(1.0, 1.6, 0.25, STEP), 3),
    "shaft": (lambda: shaft([(0, 0), (1, 0), (1, 0.8), (0.5, 0.8), (0.5, 2), (0, 2)]), 5),
    "tube": (lambda: tube(0.5, 1.0, 1.2), 4),
    "long tube": (lambda: tube(0.3, 0.4, 3.0), 4),
}


@cache
def patches(name):
    return medialis.patches(medialis.surface_skeleton(KNOWN[name][0](), side="both"))


def border_length(found):
    """Length of the edges between faces of two patches."""
    shape, twins = found.surface, found.surface.edge_twins
    half = np.flatnonzero(twins >= 0)
    labels = found.of_faces()
    half = half[labels[half // 3] != labels[twins[half] // 3]]
    start, end = shape.faces.ravel()[half], shape.faces[:, [1, 2, 0]].ravel()[half]
    return np.linalg.norm(shape.points[end] - shape.points[start], axis=1).sum() / 2


def pieces(found):
    """Number of connected pieces of all patches, across the edges of the mesh."""
    twins, labels = found.surface.edge_twins, found.of_faces()
    half = np.flatnonzero(twins >= 0)
    links = np.stack([half // 3, twins[half] // 3], axis=1)
    links = links[labels[links[:, 0]] == labels[links[:, 1]]]
    return int(piece_labels(len(labels), links).max()) + 1


@pytest.mark.slow
@pytest.mark.parametrize("name", KNOWN)
def test_counts_and_connectedness(name):
    found = patches(name)
    assert found.count == KNOWN[name][1] == pieces(found)
    assert set(found.labels) == set(range(found.count))
    assert found.areas.sum() == pytest.approx(found.surface.area)


@pytest.mark.parametrize(
    ("name", "areas", "length"),
    [
        ("box", [3.0, 3.0, 2.0, 2.0, 1.5, 1.5], 18.0),
        ("wedge", [3.6, 3.6, 0.8 * HYPOTENUSE, 2.4, 1.92], 2 * (5.4 + HYPOTENUSE) + 2.4),
        ("tube", None, 64 * math.sin(math.pi / 64) * 2 * (1.0 + 0.5) * 2),
        ("cylinder", None, None),
    ],
)  # fmt: skip
def test_borders_are_the_creases(name, areas, length):
    """Exactly: faces have patches, not samples. The rims of a tube and of a cylinder are polygons
    as drawn; refined, their samples lie on circles."""
    found = patches(name)
    if areas is not None:
        assert found.areas == pytest.approx(areas)
    if name == "cylinder":
        around = round(2 * np.pi / STEP)
        length = 2 * around * 2 * math.sin(math.pi / around)
    if name in ("tube", "cylinder"):
        circles = 2 * np.pi * (3.0 if name == "tube" else 2.0)
        assert length < border_length(found) < circles * (1 + 1e-9)
    else:
        assert border_length(found) == pytest.approx(length)


def test_soft_borders_are_circles():
    """Two circles in the middle of the fillets, of radius 1 - 0.25 (1 - cos 45 degrees)."""
    found = patches("rounded cylinder")
    radius = 1 - 0.25 * (1 - math.sqrt(0.5))
    assert border_length(found) == pytest.approx(2 * 2 * np.pi * radius, rel=0.1)


@pytest.mark.slow
def test_round_shapes_are_said_to_have_few_edges():
    """All of a limb is soft edge; of a box and a cylinder with rounded edges less than half is."""

    def said(shape):
        return [note.code for note in medialis.run("patches", shape, refine=0.02).messages]

    assert "few_edges" in said(medialis.organic_shape(64))
    assert "few_edges" not in said(forms.rounded_cylinder())
    assert "few_edges" not in said(forms.box_mesh())


def test_samples_of_a_crease_have_one_patch():
    """The largest that they touch, so that the border is a straight line of samples as well."""
    found = patches("box")
    top = np.abs(np.abs(found.surface.points[:, 2]) - 0.5) < 1e-9  # the two largest faces
    assert (found.labels[top] < 2).all() and (found.labels[~top] >= 2).all()


def test_patches_do_not_depend_on_place_and_size():
    shape = KNOWN["tube"][0]()
    turn = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    moved = forms.mesh(3.7 * shape.points @ turn.T + 40.0, shape.faces)
    one, other = (
        medialis.patches(medialis.shrink_balls(s, side="both")).of_faces() for s in (shape, moved)
    )
    pairs = np.unique(np.stack([one, other]), axis=1)
    assert one.max() + 1 == other.max() + 1 == pairs.shape[1] == 4  # two ends are equally large


@pytest.mark.slow
def test_convex_creases_need_inner_balls_and_concave_ones_outer():
    shape = KNOWN["L"][0]()
    for side, count in (("inner", 7), ("both", 8)):
        assert medialis.patches(medialis.surface_skeleton(shape, side=side)).count == count
