"""Vertex normals: of the surface through a ring, and angle-weighted at creases."""

import math

import numpy as np
import pytest
from scipy.spatial import ConvexHull

import closed_forms as forms
from medialis.base.errors import InvalidShapeError
from medialis.shape.normals import ring_normals, vertex_normals

EPS = np.finfo(float).eps


def mean_normals(points, faces):
    return ring_normals(points, faces, smooth=False)


def test_cube_corners_look_along_the_diagonals():
    """Each face has a right angle at the corner, in one or in two triangles: all weigh the same."""
    cube = forms.cube()
    expected = cube.points / math.sqrt(3)
    assert vertex_normals(cube.points, cube.faces) == pytest.approx(expected, abs=8 * EPS)


def test_splitting_faces_does_not_change_mean_normals():
    """The angles of the pieces add up; each is rounded by a few eps, at up to 12 faces a vertex."""
    for shape in (forms.cube(), forms.torus_mesh(9, 7)):
        before = mean_normals(shape.points, shape.faces)
        fine = forms.refined(shape, 0.2)
        after = mean_normals(fine.points, fine.faces)[: shape.point_count]
        assert after == pytest.approx(before, abs=200 * EPS)


def irregular_sphere(count, seed):
    """The convex hull of random points on the unit sphere: slivers included."""
    points = np.random.default_rng(seed).normal(size=(count, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    faces = ConvexHull(points).simplices
    a, b, c = points[faces.T]
    out = np.einsum("ij,ij->i", np.cross(b - a, c - a), a) > 0
    return points, np.where(out[:, None], faces, faces[:, ::-1])


def test_normals_of_spheres_are_exact():
    """The sphere through a ring is one of the surfaces that are looked for, however irregular the
    ring is. Means of face normals were 2 degrees off. What holds the unknowns back where a ring
    tells nothing weighs 1e-10; hulls of random points have vertices of three neighbours."""
    for seed in range(3):
        points, faces = irregular_sphere(2000, seed)
        normals = vertex_normals(points, faces)
        off = np.linalg.norm(normals - points, axis=1)
        smooth = np.abs(mean_normals(points, faces) - normals).max(axis=1) > 1e-12
        assert smooth.mean() > 0.9  # the others lie at edges that bend by more than 30 degrees
        assert np.quantile(off[smooth], 0.99) < 1e-7 and off[smooth].max() < 1e-3
        assert np.degrees(np.linalg.norm(mean_normals(points, faces) - points, axis=1).mean()) > 1


def test_normals_of_a_quadric():
    """On z = x^2 / 2 + x y / 3 - y^2 / 4 with jittered samples: at most a fifth of what means of
    face normals are off is left, by what holds the difference of the curvatures back."""
    off = []
    for count in (12, 24, 48):
        rng = np.random.default_rng(count)
        grid = np.arange(count + 1.0)
        x, y = (axis.ravel() for axis in np.meshgrid(grid, grid, indexing="ij"))
        x, y = (0.8 * (v + rng.uniform(-0.3, 0.3, v.shape)) / count - 0.4 for v in (x, y))
        points = np.stack([x, y, x**2 / 2 + x * y / 3 - y**2 / 4], axis=1)
        number = np.arange(len(x)).reshape(count + 1, count + 1)
        a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
        faces = np.concatenate(
            [np.stack(f, axis=-1).reshape(-1, 3) for f in ((a, b, c), (a, c, d))]
        )
        true = np.stack([-x - y / 3, -x / 3 + y / 2, np.ones(len(x))], axis=1)
        true /= np.linalg.norm(true, axis=1, keepdims=True)
        inner = number[1:-1, 1:-1].ravel()
        away = [
            np.linalg.norm((normals(points, faces) - true)[inner], axis=1).mean()
            for normals in (vertex_normals, mean_normals)
        ]
        off.append(away[0] / away[1])
    assert max(off) < 0.2


def surface_through(points, ring, vertex, about):
    """Normal by least squares of the equations in _normal_kernels.py, with plain numpy."""
    axes = np.linalg.svd(about[None])[2]
    axes[0] = about
    spokes = points[ring] - points[vertex]
    length = np.linalg.norm(spokes, axis=1)
    x, y, z = (spokes @ axes[k] / length for k in (1, 2, 0))
    part = length / np.sqrt((length**2).mean())
    rows = np.stack([x, y, part / 2, part * (x**2 - y**2) / 2, part * x * y], axis=1)
    rest = np.sqrt(np.diag([0, 0, 0, 1, 1]) * 1e-2 * (part**2).sum())
    found = np.linalg.lstsq(np.concatenate([rows, rest]), np.append(z, np.zeros(5)), rcond=None)[0]
    normal = axes[0] - found[0] * axes[1] - found[1] * axes[2]
    return normal / np.linalg.norm(normal)


def test_normals_are_those_of_an_independent_fit():
    ball = forms.icosphere(3)
    x, y, z = ball.points.T
    points = ball.points * (1 + 0.1 * np.sin(3 * x + 1) * np.cos(2 * y) + 0.1 * z * x)[:, None]
    found, about = (
        vertex_normals(points, ball.faces),
        mean_normals(points, ball.faces),
    )
    for vertex in range(0, len(points), 17):
        ring = np.setdiff1d(ball.faces[(ball.faces == vertex).any(axis=1)], vertex)
        assert found[vertex] == pytest.approx(
            surface_through(points, ring, vertex, about[vertex]), abs=1e-8
        )


def test_creases_and_borders_have_means():
    """One edge that bends by more than 30 degrees ends at a vertex; two of them part its faces."""
    for shape in (forms.cube(), forms.refined(forms.cube(), 0.3)):
        assert np.array_equal(
            vertex_normals(shape.points, shape.faces),
            mean_normals(shape.points, shape.faces),
        )
    points, faces = irregular_sphere(200, 7)
    open_faces = faces[1:]
    border = faces[0]
    assert np.array_equal(
        vertex_normals(points, open_faces)[border], mean_normals(points, open_faces)[border]
    )


def test_slivers_and_coincident_vertices_do_no_harm():
    """Needles of any height and sides of no length lie in the rings; the plane is a plane."""
    points, faces = irregular_sphere(400, 3)
    for height in (1e-3, 1e-6, 1e-9, 1e-12, 0.0):
        a, b, c = faces[0]
        new = points[a] + (1 - height) * (points[b] - points[a])
        more = np.concatenate([points, new[None]])
        cut = np.concatenate([faces[1:], [[a, 400, c], [400, b, c]]])
        normals = vertex_normals(more, cut)
        assert np.isfinite(normals).all()
        length = np.linalg.norm(normals, axis=1)
        assert length[length > 0] == pytest.approx(1.0)
        assert (np.einsum("ij,ij->i", normals[:400], points) > 0.9)[length[:400] > 0].all()
    flat = forms.refined(forms.cube(), 0.3)
    shear = flat.points @ np.array([[1, 0.7, 0], [0, 1, 0], [0, 1e-7, 1e-5]])
    turned = vertex_normals(shear, flat.faces)
    true = flat.normals @ np.linalg.inv(np.array([[1, 0.7, 0], [0, 1, 0], [0, 1e-7, 1e-5]])).T
    inside = np.abs(flat.normals).max(axis=1) > 1 - 1e-12
    true /= np.linalg.norm(true, axis=1, keepdims=True)
    assert turned[inside] == pytest.approx(true[inside], abs=1e-6)


def test_sphere_normals_of_regular_meshes_are_the_radius():
    for levels in (2, 3, 4):
        shape = forms.icosphere(levels)
        normals = vertex_normals(shape.points, shape.faces)
        # The five neighbours of twelve vertices lie on circles: exact up to what holds them back.
        assert normals == pytest.approx(shape.points, abs=1e-9)


@pytest.mark.parametrize("scale", [1e-200, 1e-6, 1e6, 1e150])
def test_scale_and_place_do_not_matter(scale):
    shape = forms.torus_mesh(12, 8)
    expected = vertex_normals(shape.points, shape.faces)
    assert vertex_normals(shape.points * scale, shape.faces) == pytest.approx(
        expected, abs=64 * EPS
    )
    # Coordinates at 1e3 are rounded by 1e3 eps, against edges of at least 0.1.
    moved = vertex_normals(shape.points + np.array([1e3, -1e3, 500]), shape.faces)
    assert moved == pytest.approx(expected, abs=8 * 1e3 * EPS / 0.1)


def test_rotation_turns_the_normals():
    shape = forms.torus_mesh(12, 8)
    q, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))
    q *= np.sign(np.linalg.det(q))
    turned = vertex_normals(shape.points @ q.T, shape.faces)
    assert turned == pytest.approx(vertex_normals(shape.points, shape.faces) @ q.T, abs=128 * EPS)


def test_vertices_without_an_area_have_no_normal():
    points = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0], [5, 5, 5]]
    normals = vertex_normals(points, [[0, 1, 2], [0, 1, 3], [2, 2, 3]])
    assert normals.tolist() == [[0, 0, 1], [0, 0, 1], [0, 0, 0], [0, 0, 1], [0, 0, 0]]
    assert not vertex_normals(points, np.empty((0, 3))).any()


def test_fold_has_no_normal():
    """A face and its reverse cancel out; a face folded back by 170 degrees looks away."""
    points = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    assert not vertex_normals(points, [[0, 1, 2], [0, 2, 1]]).any()


def test_inputs_stay_unchanged_and_the_result_is_read_only():
    cube = forms.cube()
    points, faces = cube.points.copy(), cube.faces.copy()
    normals = vertex_normals(points, faces)
    assert (points == cube.points).all() and (faces == cube.faces).all()
    assert not normals.flags.writeable


@pytest.mark.parametrize(
    ("points", "faces"),
    [
        ([[0, 0]], [[0, 0, 0]]),
        ([[0, 0, math.nan]], [[0, 0, 0]]),
        ([[0, 0, 0]], [[0, 0, 1]]),
        ([[0, 0, 0]], [[0, 0, -1]]),
        ([[0, 0, 0]], [[0, 0]]),
        ([[0, 0, 0]], [[0, 0, 0.5]]),
    ],
)
def test_bad_input(points, faces):
    with pytest.raises(InvalidShapeError):
        vertex_normals(points, faces)
