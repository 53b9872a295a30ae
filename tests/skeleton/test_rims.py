"""Clean rims of skeleton meshes: gaps that balls cover close, teeth go, rims are smooth."""

import numpy as np
import pytest

import medialis
from closed_forms import elliptic_torus, spheroid
from medialis.base.threads import thread_limit
from medialis.shape.shape import Shape
from medialis.shape.surface import Surface
from medialis.skeleton.rims import SHARP, clean_rims
from medialis.skeleton.skeleton_mesh import with_clean_rims


def rim_lengths(points, faces):
    """Ends and lengths of the edges of one triangle."""
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    edges, count = np.unique(edges, axis=0, return_counts=True)
    rim = edges[count == 1]
    return rim, np.linalg.norm(points[rim[:, 0]] - points[rim[:, 1]], axis=1)


def euler(faces):
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    return len(np.unique(faces)) - len(np.unique(edges, axis=0)) + len(faces)


def grid(keep):
    """Unit squares 0..20 by 0..20, two triangles each, where keep(middle x, y)."""
    x, y = (c.ravel() for c in np.mgrid[0:21, 0:21])
    points = np.stack([x, y, 0 * x], axis=1).astype(float)
    first = (21 * np.arange(20)[:, None] + np.arange(20)).ravel()
    faces = np.concatenate(
        [
            np.stack([first, first + 21, first + 22], axis=1),
            np.stack([first, first + 22, first + 1], axis=1),
        ]
    )
    faces = faces[keep(*points[faces].mean(axis=1)[:, :2].T)]
    used, place = np.unique(faces, return_inverse=True)
    return Surface(points[used], place.reshape(-1, 3).astype(np.int32))


def cleaned(mesh, radii):
    """Points and faces with clean rims; all points where they were but those of the rim."""
    n = len(mesh.points)
    rims = clean_rims(mesh, np.broadcast_to(radii, n).astype(float), np.ones(n))
    moved, place = np.unique(rims.blend.points, return_inverse=True)
    np.testing.assert_allclose(np.bincount(place, rims.blend.weights), 1.0, atol=1e-12)
    assert np.array_equal(np.unique(rims.faces), np.arange(len(rims.kept)))
    points = rims.at_points(mesh.points)
    still = np.setdiff1d(np.arange(len(rims.kept)), moved)
    assert np.array_equal(points[still], mesh.points[rims.kept[still]])
    return points, rims.faces


def test_a_rim_of_saw_teeth_becomes_a_line():
    """A disc cut out of a grid along its edges: its rim is 4/pi too long, or so."""
    mesh = grid(lambda x, y: np.hypot(x - 10, y - 10) < 8)
    points, faces = cleaned(mesh, 5.0)
    before = rim_lengths(mesh.points, mesh.faces)[1].sum() / (16 * np.pi)
    after = rim_lengths(points, faces)[1].sum() / (16 * np.pi)
    assert before > 1.15 and 0.97 < after < 1.03
    # It is where it was in the mean, but for notches of half a square, a quarter of the rim.
    area = Surface(points, faces).area
    assert 0 < area - mesh.area < 0.25 * 16 * np.pi
    assert np.abs(points[:, 2]).max() == 0 and euler(faces) == 1


def test_slits_are_zipped_and_walls_stay():
    slit = grid(lambda x, y: (np.abs(y - 10.5) > 0.5) | (np.abs(x - 10) > 6))
    hole = grid(lambda x, y: (np.abs(y - 10) > 1) | (np.abs(x - 10) > 1))
    wide = grid(lambda x, y: (np.abs(y - 10) > 4) | (np.abs(x - 10) > 4))
    for mesh, radii, loops in ((slit, 5.0, 1), (hole, 5.0, 1), (hole, 0.8, 0), (wide, 5.0, 0)):
        assert euler(mesh.faces) == 0
        assert euler(cleaned(mesh, radii)[1]) == loops
    area = Surface(cleaned(slit, 5.0)[0], cleaned(slit, 5.0)[1]).area
    assert abs(area - 400) < 4  # only the corners of the square are rounded


def test_teeth_are_cut_and_limbs_are_not_eaten():
    """A strip one square wide keeps its length but for two triangles; a lone tooth goes."""
    limb = grid(lambda x, y: (y < 8) | ((x > 10) & (x < 11) & (y < 18)))
    points, _ = cleaned(limb, 5.0)
    assert points[:, 1].max() > 16
    row = np.arange(9.0)
    rows = (np.stack([row, 0 * row + y, 0 * row], axis=1) for y in (0, -1))
    tooth = Surface(
        np.insert(np.concatenate([*rows]), 9, [4.5, 5.0, 0.0], axis=0),
        np.array(
            [[4, 5, 9]]
            + [t for k in range(8) for t in ([k, k + 1, k + 10], [k + 1, k + 11, k + 10])],
            np.int32,
        ),
    )  # fmt: skip
    assert SHARP < 2
    points, faces = cleaned(tooth, 9.0)
    assert points[np.unique(faces), 1].max() < 0.5


@pytest.mark.parametrize("angle", [0.0, 60.0])
def test_the_rim_of_a_spheroid_is_a_circle(angle):
    """Where balls are left out by their angle as well, which is the same along circles.

    Its points stray from a circle by less than they did, and than a twentieth of an edge (0.07).
    """
    cloud = medialis.shrink_balls(spheroid())
    torn = medialis.skeleton_mesh(cloud, min_spoke_angle=angle, clean_rims=False)
    mesh = medialis.skeleton_mesh(cloud, min_spoke_angle=angle)
    spread, turns = [], []
    for one in (torn, mesh):
        rim, lengths = rim_lengths(one.points, one.faces)
        outer = np.hypot(*one.points[np.unique(rim)].T[:2])
        outer = outer[outer > 0.5 * outer.max()]  # but not seams between both sides
        spread.append(outer.std())
        turns.append(lengths.sum() / (2 * np.pi * outer.mean()))
    assert spread[1] < min(spread[0], 0.05 * 0.07) and turns[1] <= turns[0]
    assert np.hypot(*mesh.points.T[:2]).max() <= 0.75 + 1e-3
    assert abs(mesh.area - torn.area) < 0.02 * torn.area
    np.testing.assert_allclose(mesh.at_points(cloud.centers), mesh.points, atol=1e-12)
    radii = mesh.at_points(cloud.radii)
    # The radius of a ball at (x, y, 0) follows from where it is: (1 - (x/a)^2 ...)^(1/2).
    true = 0.5 * np.sqrt(np.maximum(1 - (mesh.points[:, :2] ** 2).sum(axis=1) / 0.75, 0))
    assert np.abs(radii - true).max() < 0.02


def test_a_ring_keeps_its_hole_and_points_their_balls():
    cloud = medialis.shrink_balls(elliptic_torus(80, 24))
    mesh = medialis.skeleton_mesh(cloud)
    assert mesh.blend is not None and mesh.part_count == 1
    assert np.hypot(*mesh.points.T[:2]).min() > 0.5
    away = np.linalg.norm(mesh.points - cloud.centers[mesh.rows], axis=1)
    assert away.max() > 0 and (away <= cloud.radii[mesh.rows] * (1 + 1e-12)).all()
    assert (np.diff(mesh.rows) > 0).all()
    assert np.array_equal(np.unique(mesh.faces), np.arange(len(mesh.points)))
    still = np.setdiff1d(np.arange(len(mesh.points)), mesh.blend[0])
    assert np.array_equal(mesh.points[still], cloud.centers[mesh.rows[still]])
    assert np.array_equal(mesh.at_points(cloud.radii)[still], cloud.radii[mesh.rows[still]])


def test_clean_rims_are_the_same_at_any_scale_and_on_any_number_of_threads():
    shape = medialis.organic_shape(56)
    mesh = medialis.skeleton_mesh(medialis.shrink_balls(shape))
    with thread_limit(1):
        single = medialis.skeleton_mesh(medialis.shrink_balls(shape))
    assert np.array_equal(mesh.points, single.points) and np.array_equal(mesh.faces, single.faces)
    for scale in (2.0**-60, 2.0**60):
        moved = Shape(shape.points * scale, shape.normals, shape.faces)
        scaled = medialis.skeleton_mesh(medialis.shrink_balls(moved))
        assert np.array_equal(scaled.faces, mesh.faces)
        assert np.array_equal(scaled.points, mesh.points * scale)


def test_a_mesh_without_triangles_has_no_rim():
    cloud = medialis.shrink_balls(spheroid(2))
    assert len(with_clean_rims(medialis.skeleton_mesh(cloud.subset([]))).faces) == 0
