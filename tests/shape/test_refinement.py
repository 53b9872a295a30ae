"""Refinement: the same surface, the same vertices, no edge too long."""

import math
import tracemalloc
from itertools import permutations

import numpy as np
import pytest
from scipy.spatial import cKDTree

import closed_forms as forms
from medialis.base.errors import InvalidOptionError, InvalidShapeError
from medialis.shape import refinement
from medialis.shape.refinement import affordable_edge, refine, refine_faces, refine_where
from medialis.shape.shape import Shape
from oracles import edge_uses, euler_number

EPS = np.finfo(float).eps


def open_strip():
    return forms.mesh(
        [[0, 0, 0], [3, 0, 0], [3, 1, 1], [0, 1, 0], [5, 0.2, 0]], [[0, 1, 2], [0, 2, 3], [1, 4, 2]]
    )


def fan():
    """Three faces at one edge, and a component of its own."""
    points = [[0, 0, 0], [0, 0, 2], [1, 0, 1], [-1, 1, 1], [-1, -1, 1], [9, 9, 9], [9, 7, 9]]
    return forms.mesh([*points, [7, 9, 9]], [[0, 1, 2], [0, 1, 3], [0, 1, 4], [5, 6, 7]])


def needle():
    """A sliver beside a long face, and a face that names a vertex twice."""
    points = [[0, 0, 0], [4, 1e-7, 0], [4, -1e-7, 0], [2, 3, 1]]
    return forms.mesh(points, [[0, 2, 1], [0, 1, 3], [0, 0, 3]])


def thin_tube(count=12, height=6.0):
    """A closed tube of long thin faces, turned so that some of them have a blunt corner."""
    angle = np.arange(count) * 2 * np.pi / count
    rings = [[0.3 * np.cos(angle + t), 0.3 * np.sin(angle + t), 0 * angle + h]
             for t, h in ((0.0, 0.0), (2.0, height))]  # fmt: skip
    points = [*np.hstack(rings).T, [0, 0, 0], [0, 0, height]]
    a = np.arange(count)
    b, low, top = (a + 1) % count, 2 * count + 0 * a, 2 * count + 1 + 0 * a
    sides = [(a, b, b + count), (a, b + count, a + count), (b, a, low), (a + count, b + count, top)]
    return forms.mesh(points, np.concatenate([np.stack(side, axis=1) for side in sides]))


def blunt():
    """A flat triangle with a blunt corner, beside two faces that have room inside."""
    points = [[0, 0, 0], [8, 0, 0], [4.3, 0.1, 0], [3, 5, 1], [4, -5, 2]]
    return forms.mesh(points, [[0, 1, 2], [0, 2, 3], [1, 0, 4]])


MESHES = {
    "cube": forms.cube(),
    "long box": forms.mesh(forms.cube().points * [5.0, 0.3, 0.1], forms.cube().faces),
    "icosphere": forms.icosphere(1),
    "torus": forms.torus_mesh(10, 6),
    "strip": open_strip(),
    "fan": fan(),
    "needle": needle(),
    "thin tube": thin_tube(),
    "blunt": blunt(),
    "far away": forms.mesh(forms.cube().points + 1e6, forms.cube().faces),
}


def lengths(shape):
    ends = shape.points[shape.edges]
    return np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)


def areas(points, faces):
    a, b, c = np.moveaxis(points[faces], 1, 0)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


@pytest.mark.parametrize("share", [0.9, 0.37, 0.1])
@pytest.mark.parametrize("name", list(MESHES))
def test_refined_surface_is_the_same_surface(name, share):
    """Every new face lies in its old one, and their areas sum up.

    A midpoint is rounded by eps S/2 (S: largest coordinate); the means of later rounds do not add
    to it. The cross and dot products of the check round about 6 more terms of size S. An area is
    off by its rim times that.
    """
    old = MESHES[name]
    h = share * lengths(old).max()
    new = forms.refined(old, h)
    s = np.abs(old.points).max()
    slack = 16 * EPS * s
    assert lengths(new).max() <= h
    n = old.point_count
    assert (new.points[:n] == old.points).all() and (new.normals[:n] == old.normals).all()
    assert (new.origin[:n] == np.arange(n)).all() and (new.origin[n:] == -1).all()
    assert set(new.face_origin.tolist()) == set(range(old.face_count))

    for f in range(old.face_count):
        a, b, c = old.points[old.faces[f]]
        rows = new.face_origin == f
        corners = new.points[new.faces[rows]].reshape(-1, 3) - a
        normal = np.cross(b - a, c - a)
        size = np.linalg.norm(normal)
        if size > 1e-3:
            assert np.abs(corners @ (normal / size)).max() <= slack
            for start, end, third in ((a, b, c), (b, c, a), (c, a, b)):
                inward = forms.unit(np.cross(normal, end - start)[None])[0]
                assert inward @ (third - start) > 0
                assert ((corners - (start - a)) @ inward).min() >= -slack
        fine = areas(new.points, new.faces[rows])
        rim = 3 * h * rows.sum() + np.linalg.norm(b - a) + np.linalg.norm(c - a)
        assert abs(fine.sum() - size / 2) <= slack * rim
        fine_normals = np.cross(
            new.points[new.faces[rows][:, 1]] - new.points[new.faces[rows][:, 0]],
            new.points[new.faces[rows][:, 2]] - new.points[new.faces[rows][:, 0]],
        )
        if size > 1e-3:
            assert (fine_normals @ normal > 0).all()


@pytest.mark.parametrize("name", ["cube", "long box", "icosphere", "torus", "thin tube"])
def test_closed_manifold_stays_one(name):
    old = MESHES[name]
    new = forms.refined(old, 0.2 * lengths(old).max())
    assert set(edge_uses(new.faces).values()) == {2}
    directed = new.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    assert len(np.unique(directed, axis=0)) == len(directed)
    assert euler_number(new.faces) == euler_number(old.faces)


@pytest.mark.parametrize(("name", "uses"), [("strip", {1, 2}), ("fan", {1, 2, 3})])
def test_borders_and_triple_edges_stay_as_they_are(name, uses):
    old = MESHES[name]
    new = forms.refined(old, 0.2)
    assert set(edge_uses(new.faces).values()) == uses
    assert euler_number(new.faces) == euler_number(old.faces)
    assert new.components.max() == old.components.max()

    def total(shape, times):
        picked = [pair for pair, use in edge_uses(shape.faces).items() if use == times]
        ends = shape.points[np.array(picked)]
        return np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).sum()

    for times in uses - {2}:
        assert total(new, times) == pytest.approx(total(old, times), rel=1e-13)


def test_refining_again_composes_the_origins():
    old = forms.cube()
    half = forms.refined(old, 1.0)
    twice, once = forms.refined(half, 0.3), forms.refined(old, 0.3)
    assert (twice.origin[:8] == np.arange(8)).all() and (twice.origin[8:] == -1).all()
    a, b, c = np.moveaxis(old.points[old.faces[twice.face_origin]], 1, 0)
    plane = np.cross(b - a, c - a)
    center = twice.points[twice.faces].mean(axis=1)
    assert np.abs(np.einsum("ij,ij->i", center - a, plane)).max() < 16 * EPS * 4
    assert len(np.unique(twice.face_origin)) == 12
    assert twice.point_count >= once.point_count


def test_maps_of_a_repaired_shape_stay_right():
    cube = forms.cube()
    shape = Shape(
        cube.points,
        cube.normals,
        cube.faces,
        vertex_map=np.arange(8)[::-1],
        face_map=7 * np.arange(12),
    )
    new = forms.refined(shape, 0.9)
    assert (new.vertex_map == shape.vertex_map).all()
    assert (new.face_map == 7 * new.face_origin).all()


def test_normals_of_the_given_vertices_do_not_change_by_a_bit():
    """Unit normals were normalised again whenever a shape was rebuilt, and drifted (fixed)."""
    shape = forms.icosphere(2)
    new = forms.refined(shape, 0.1)
    assert (new.normals[: shape.point_count] == shape.normals).all()
    assert np.linalg.norm(new.normals, axis=1) == pytest.approx(1, abs=4 * EPS)


def test_new_normals_of_flat_faces_are_the_face_normals():
    new = forms.refined(forms.cube(), 0.3)
    inner = (np.abs(new.points) == 1).sum(axis=1) == 1
    assert inner.sum() > 100
    expected = np.where(np.abs(new.points) == 1, new.points, 0)
    assert new.normals[inner] == pytest.approx(expected[inner], abs=8 * EPS)


@pytest.mark.parametrize("order", list(permutations(range(3))))
def test_two_long_edges_leave_a_quadrangle_with_its_shorter_diagonal(order):
    """Sides 10, 6.7 and 5: the diagonals measure 3.2 and 7.2, only the first is short enough."""
    points = np.array([[0, 0, 0], [10, 0, 0], [6, 3, 0]])[list(order)]
    fine = forms.refined(forms.mesh(points, [[0, 1, 2]]), 5.5)
    assert fine.face_count == 3 and fine.point_count == 5
    assert lengths(fine).min() == pytest.approx(2.5)


@pytest.mark.parametrize("corner", [[1.0, 1e-3], [0.5, 1e-3], [0.9, 1e-9], [0.3, 0.0]])
@pytest.mark.parametrize("pieces", [16, 64, 256])
def test_long_thin_faces_get_samples_along_their_sides_only(corner, pieces):
    """Halving made pieces ^ 1.6 faces of a needle, pieces ^ 2 of a blunt one (fixed).

    320 faces of a tube became 130,000 samples. The sides have up to 4 x pieces parts together.
    """
    triangle = forms.mesh([[0, 0, 0], [1, 0, 0], [*corner, 0]], [[0, 1, 2]])
    fine = forms.refined(triangle, 1 / pieces)
    assert lengths(fine).max() <= 1 / pieces
    border = sum(use == 1 for use in edge_uses(fine.faces).values())
    assert border == fine.point_count == fine.face_count + 2  # no sample inside
    assert fine.point_count <= 4 * pieces + 3


@pytest.mark.slow
def test_samples_are_bounded_by_the_mesh_unless_asked_for():
    """Thirty plates of 8 triangles side by side became 276,000 samples (fixed)."""
    plate = forms.mesh(forms.cube().points * [0.004, 0.5, 0.5], forms.cube().faces)
    assert affordable_edge(plate, 0.02) == 0.02
    assert affordable_edge(forms.cube(), 0.001) == 0.001
    moved = [plate.points + np.array([0.02 * i, 0, 0]) for i in range(30)]
    comb = forms.mesh(
        np.concatenate(moved), np.concatenate([plate.faces + 8 * i for i in range(30)])
    )
    assert refine(comb, longest_edge=0.02).point_count > 200_000
    edge = affordable_edge(comb, 0.02)
    most = refinement.USUAL + refinement.USUAL_A_VERTEX * comb.point_count
    # What is estimated is good to a factor of 1.7, and a step is at most one halving.
    assert 0.2 * most < refine(comb, longest_edge=edge).point_count < 1.7 * most
    assert affordable_edge(comb, 0.005) < edge  # a smaller value than the default makes more


def test_nothing_to_do_gives_the_same_object():
    cube, cloud = forms.cube(), forms.sphere(50).shape
    assert forms.refined(cube, math.sqrt(8) * (1 + 4 * EPS)) is cube
    assert refine(cube, longest_edge=0.0) is cube
    assert forms.refined(cloud, 1e-9) is cloud


@pytest.mark.parametrize("h", [1e-4, 1e-9, 1e-300])
def test_absurd_length_is_refused_before_memory_runs_out(h):
    """Points were made first and counted afterwards: many gigabytes when absurd (fixed)."""
    tracemalloc.start()
    with pytest.raises(InvalidShapeError, match=r"more than 10000000 points.*longest edge is 2\.8"):
        forms.refined(forms.cube(), h)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1e6


def test_bound_of_the_number_of_points_is_a_lower_bound(monkeypatch):
    """Never refuses what fits: with room for just the points needed it still refines."""
    for shape in MESHES.values():
        h = 0.2 * lengths(shape).max()
        count = forms.refined(shape, h).point_count
        monkeypatch.setattr(refinement, "MOST_POINTS", count)
        assert forms.refined(shape, h).point_count == count
        monkeypatch.setattr(refinement, "MOST_POINTS", count - 1)
        with pytest.raises(InvalidShapeError, match="more than"):
            forms.refined(shape, h)
        monkeypatch.undo()


def test_length_below_the_rounding_of_the_coordinates():
    """A midpoint that rounds to an end of its edge was split for ever (fixed)."""
    far = forms.mesh(forms.cube().points + 1e15, forms.cube().faces)
    with pytest.raises(InvalidShapeError, match="rounding"):
        forms.refined(far, 0.1)


@pytest.mark.parametrize("exponent", [-1000, -20, 20, 500])
def test_scale_does_not_matter(exponent):
    """Edges of 1e-200 had length 0 and were never split; those of 1e200 were split for ever."""
    cube, unit = forms.cube(), 2.0**exponent
    plain = forms.refined(cube, 0.3)
    scaled = forms.refined(forms.mesh(cube.points * unit, cube.faces), 0.3 * unit)
    assert (scaled.points == plain.points * unit).all() and (scaled.faces == plain.faces).all()


@pytest.mark.parametrize("h", [1.1, -1.0, math.nan, math.inf, "1", None])
def test_bad_length(h):
    with pytest.raises(InvalidOptionError, match="longest_edge"):
        refine(forms.cube(), longest_edge=h)


def test_inputs_stay_unchanged_and_result_is_deterministic():
    cube = forms.cube()
    points, faces = cube.points.copy(), cube.faces.copy()
    one, two = forms.refined(cube, 0.2), forms.refined(cube, 0.2)
    assert (cube.points == points).all() and (cube.faces == faces).all()
    assert one.points.tobytes() == two.points.tobytes()
    assert one.faces.tobytes() == two.faces.tobytes()


def test_faces_are_cut_as_they_allow_and_others_keep_their_edges():
    """A face between two that allow less keeps what is inside of it; the surface stays."""
    cube = forms.box_mesh((1.0, 1.0, 1.0), 0.25)
    cube = Shape(cube.points, cube.normals, cube.faces)  # whose faces are pieces of no others
    allowed = np.full(cube.face_count, np.inf)
    allowed[[0, 40]] = 0.1, 0.03
    fine = refine_faces(cube, allowed)
    assert (fine.points[: cube.point_count] == cube.points).all()
    assert fine.area == pytest.approx(cube.area) and fine.border_edges == 0
    corners = fine.points[fine.faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    for face in (0, 40):
        assert 0.5 * allowed[face] < longest[fine.face_origin == face].max() <= allowed[face]
    beside = np.append(cube.edge_twins.reshape(-1, 3)[[0, 40]].ravel() // 3, [0, 40])
    others = np.setdiff1d(np.arange(cube.face_count), beside)
    assert (np.bincount(fine.face_origin)[others] == 1).all()
    assert refine_faces(cube, np.full(cube.face_count, np.inf)) is cube
    few = refine_faces(cube, allowed, cube.point_count + 6)  # each side once
    assert few.point_count == cube.point_count + 6


def test_edges_are_split_where_they_are_too_long_and_nowhere_else():
    """The surface and the vertices stay; edges near one corner of a cube become short."""
    cube = forms.box_mesh((1.0, 1.0, 1.0), 0.25)
    near = np.linalg.norm(cube.points - 0.5, axis=1) < 0.3
    fine = refine_where(cube, np.where(near, 0.1, np.inf))
    assert (fine.points[: cube.point_count] == cube.points).all()
    assert fine.area == pytest.approx(cube.area) and fine.border_edges == 0
    middles = fine.points[fine.edges].mean(axis=1)
    owner = cKDTree(cube.points).query(middles)[1]
    assert fine.edge_lengths[near[owner]].max() <= 0.1
    far = np.linalg.norm(fine.points - 0.5, axis=1) > 0.8
    assert far.sum() == (np.linalg.norm(cube.points - 0.5, axis=1) > 0.8).sum()
    assert refine_where(cube, np.full(cube.point_count, np.inf)) is cube
