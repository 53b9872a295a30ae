"""Cylinders of parts: found where needles lie on one, and nowhere else."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

import closed_forms as forms
import medialis
from plates import extruded
from rounded import hollow_section

TURNED = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]


def pipe(inner, outer, height, around):
    """A tube with sharp ends: rings inside below and above, then outside."""
    turn = 2 * np.pi * np.arange(around) / around
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    rings = [(inner, 0.0), (inner, height), (outer, 0.0), (outer, height)]
    points = np.concatenate([np.column_stack([r * ring, np.full(around, z)]) for r, z in rings])
    i = np.arange(around)
    j = (i + 1) % around
    faces = []
    for a, b in ((1, 0), (2, 3), (0, 2), (3, 1)):  # bore, outside, bottom, top
        a, b = a * around, b * around
        faces += [np.stack([a + i, a + j, b + j], 1), np.stack([a + i, b + j, b + i], 1)]
    return medialis.make_shape(points, np.concatenate(faces))


def made(shape, scale=1.0, shift=0.0, single=False):
    points = shape.points @ TURNED.T * scale + shift
    if single:
        points = points.astype(np.float32).astype(float)
    return medialis.make_shape(points, shape.faces)


@pytest.mark.parametrize("around", [12, 31, 90, 400])
@pytest.mark.parametrize("scale", [1e-3, 1.0, 25.4])
@pytest.mark.parametrize("single", [False, True])
def test_a_pipe_has_two_cylinders(around, scale, single):
    """STL files have seven digits, and parts lie anywhere."""
    shape = made(pipe(9.0, 10.0, 60.0, around), scale, 3 * scale, single)
    found = shape.cylinders
    assert np.sort(found.radii) / scale == pytest.approx([9.0, 10.0], rel=2e-5)
    assert found.signs[np.argsort(found.radii)].tolist() == [-1, 1]
    assert np.abs(found.axes @ TURNED[:, 2]) == pytest.approx(1.0, abs=1e-8)
    assert (found.label >= 0).sum() == 4 * around
    center = found.centers - 3 * scale
    off = center - (center @ TURNED[:, 2])[:, None] * TURNED[:, 2]
    assert np.abs(off).max() < 2e-5 * scale * 60
    places, which = shape.points[shape.faces].mean(axis=1), np.maximum(found.label, 0)
    assert (np.einsum("fa,fa->f", found.normals(which, places), shape.face_normals) > 0.96)[
        found.label >= 0
    ].all()


def test_a_bend_and_its_counterbend_are_two_cylinders():
    """Tangent to each other and to flat sides: an extruded S of sheet metal."""
    turn = np.radians(np.linspace(0, 90, 8))[1:]
    one = np.column_stack([10 + 6 * np.sin(turn), 6 - 6 * np.cos(turn)])
    two = np.column_stack([20 - 4 * np.cos(turn), 6 + 4 * np.sin(turn)])
    middle = np.concatenate([[[0, 0], [10, 0]], one, two, [[35, 10]]])
    outline = np.concatenate([middle, middle[::-1] + np.array([-1e-9, 30])])
    found = medialis.make_shape(*extruded(outline, 80.0)).cylinders
    assert np.sort(found.radii) == pytest.approx([4.0, 4.0, 6.0, 6.0], rel=1e-6)


@pytest.mark.parametrize("shape", [
    forms.torus_mesh(24, 96), forms.torus_mesh(96, 24), forms.icosphere(3),
    medialis.organic_shape(56),
    forms.revolved([[0, 0], [5, 0], [3, 40], [0, 40]], 24),
    forms.revolved([[0, -2], [4, -1.5], [5, 0], [4, 1.5], [0, 2]], 40),
])  # fmt: skip
def test_other_surfaces_have_none(shape):
    """Rings are cut into strips that are cylinders each, cones into needles."""
    assert len(medialis.make_shape(shape.points, shape.faces).cylinders.radii) == 0


def test_ovals_have_none():
    turn = 2 * np.pi * np.arange(40) / 40
    oval = np.column_stack([10 * np.cos(turn), 6 * np.sin(turn)])
    assert len(medialis.make_shape(*extruded(oval, 90.0)).cylinders.radii) == 0


def test_a_cylinder_goes_on_where_its_triangles_are_no_needles():
    """Its end is cut askew, finely: half of its facets have three corners at the cut."""
    around = 60
    shape = pipe(4.0, 6.0, 30.0, around)
    points = np.array(shape.points)
    top = points[:, 2] > 29
    points[top, 2] += 1.8 * points[top, 0]
    found = medialis.make_shape(points, shape.faces).cylinders
    assert np.sort(found.radii) == pytest.approx([4.0, 6.0])
    assert (found.label >= 0).sum() == 4 * around


@pytest.mark.parametrize("chords", [3, 4, 7])
def test_bends_of_a_hollow_section_are_as_thick_as_its_walls(chords):
    """Balls met the chords of the bore: 1.1 % too thick."""
    shape = medialis.make_shape(*hollow_section(60, 40, 2.0, 6.0, 80, chords))
    layers = medialis.run("thickness", shape).layers
    layer = next(layer for layer in layers if layer.name == "samples")
    points, told = layer.points, layer.attributes["wall_thickness"]
    away = np.minimum(points[:, 2], 80 - points[:, 2])
    wrong = np.abs(told[away > 3] / 2.0 - 1.0)
    assert np.quantile(wrong, 0.99) < 1e-4 and wrong.max() < 0.01


def test_far_and_near_the_origin_it_is_one_part():
    shape = pipe(9.0, 10.0, 60.0, 24)
    near, far = (
        medialis.run("thickness", medialis.make_shape(shape.points + shift, shape.faces))
        for shift in (0.0, 4096.0)
    )
    thinnest = [run.values["wall_thickness_min"] for run in (near, far)]
    assert thinnest[0] == pytest.approx(thinnest[1], rel=1e-9)


@pytest.mark.parametrize(("radius", "chords"), [(1.0, 3), (2.5, 5), (4.0, 9)])
def test_a_rounded_box_has_twelve_cylinders_and_eight_spheres(radius, chords):
    turn = np.linspace(0, np.pi / 2, chords + 1)
    up, round_ = (x.ravel() for x in np.meshgrid(turn, turn, indexing="ij"))
    octant = np.column_stack([np.cos(up) * np.cos(round_), np.cos(up) * np.sin(round_), np.sin(up)])
    signs = np.stack(np.meshgrid(*[[-1, 1]] * 3), axis=-1).reshape(-1, 1, 3)
    points = np.unique((signs * ([30, 20, 10] + radius * octant)).reshape(-1, 3).round(9), axis=0)
    hull = ConvexHull(points)
    faces = np.array(hull.simplices)
    turned = np.linalg.det(points[faces]) < 0
    faces[turned] = faces[turned][:, ::-1]
    found = medialis.make_shape(points @ TURNED.T, faces).cylinders
    spheres = ~found.axes.any(axis=1)
    assert spheres.sum() == 8 and (~spheres).sum() == 12
    assert found.radii == pytest.approx(radius, rel=1e-6) and (found.signs == 1).all()
    corners = np.abs(found.centers[spheres] @ TURNED)
    assert corners == pytest.approx(np.tile([30.0, 20.0, 10.0], (8, 1)), abs=1e-6)
