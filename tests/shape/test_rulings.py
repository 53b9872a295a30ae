"""What is rounded of a part is straight one way: its normals are so, too, where blends begin."""

import numpy as np
import pytest

import closed_forms as forms
import medialis
from medialis.shape.creases import find_creases
from medialis.shape.rulings import find_mitres, with_rulings

CREASE = np.radians(30.0)


def boss(radius, fillet, height, around, segments):
    """A cylinder on a disc, with a fillet at its foot: revolved, cut into chords."""
    turn = np.radians(np.linspace(0, 90, segments + 1))
    arc = np.stack([radius + fillet * (1 - np.sin(turn)), fillet * (1 - np.cos(turn))], axis=1)
    outline = [[0, -2], [3 * radius, -2], [3 * radius, 0], *arc, [radius, height], [0, height]]
    return forms.revolved(outline, around)


def beside_axis(shape, radius, height):
    """Vertices at a radius and a height, and their outward directions."""
    x, y, z = shape.points.T
    rows = np.flatnonzero((abs(np.hypot(x, y) - radius) < 1e-9) & (abs(z - height) < 1e-9))
    return rows, np.column_stack([x, y, 0 * z])[rows] / radius


@pytest.mark.parametrize("fillet", [0.25, 0.5, 1.0])
@pytest.mark.parametrize("around", [16, 26, 48])
def test_normals_where_a_cylinder_goes_over_into_a_fillet_are_its_own(fillet, around):
    """They leaned by 5 degrees, and its facets bulged: a wall of 1.5 mm read up to 2.4 % wrong."""
    shape = boss(5.0, fillet, 15.0, around, 6)
    shape = medialis.make_shape(shape.points, shape.faces)
    rows, outward = beside_axis(shape, 5.0, fillet)
    assert len(rows) == around
    assert np.abs(shape.normals[rows] - outward).max() < 1e-9


def test_rounded_rims_end_in_mitres_though_these_bend_little():
    """Each corner of a plate with a rounded rim: the edges of both strips beside its flat top."""
    inset, high = [3.0, 1.7, 0.8, 0.2, 0.0], [3.0, 2.8, 2.2, 1.3, 0.0]
    points = [
        place
        for d, z in zip(inset, high, strict=True)
        for place in ((d, d, z), (60 - d, d, z), (60 - d, 40 - d, z), (d, 40 - d, z))
    ]
    faces = [(0, 1, 2), (0, 2, 3), (16, 18, 17), (16, 19, 18)]
    for p in range(16):
        q = p - p % 4 + (p + 1) % 4
        faces += [(p, p + 4, q), (q, p + 4, q + 4)]
    shape = medialis.make_shape(np.array(points), np.array(faces))
    creases = find_creases(shape, 30.0)
    first = creases.half_edges[:, 0]
    flat = shape.faces.ravel()
    ends = np.stack([flat[first], flat[first - first % 3 + (first + 1) % 3]], axis=1)
    mitres = {tuple(sorted(pair)) for pair in ends.tolist()}
    assert mitres >= {(p, p + 4) for p in range(16)}
    # Beside a mitre each strip keeps its own normal, at right angles to its straight direction.
    strip = np.flatnonzero((shape.planes < 0) & (np.abs(shape.face_normals[:, 0]) < 1e-9))
    assert len(strip) == 16 and np.abs(creases.corner_normals(strip)[:, :, 0]).max() < 1e-9


def test_smooth_shapes_keep_their_normals_though_their_facets_are_needles():
    for made in (medialis.organic_shape(56), forms.icosphere(3), forms.torus_mesh(24, 96)):
        shape = medialis.make_shape(made.points, made.faces)
        kept = with_rulings(shape.normals, shape, shape.planes, CREASE)
        assert np.array_equal(kept, shape.normals)
        assert not find_mitres(shape, shape.planes).any()
