"""The measure of balls that poke out of the triangles, on balls whose answer is known."""

from dataclasses import replace

import numpy as np
from accuracy_suite.poke_out import fan_normals, poke_out

import closed_forms
import medialis
from medialis.skeleton.medial_cloud import BallStatus


def cloud_of(shape, centers, radii, features):
    """Balls given by hand."""
    count = len(radii)
    return medialis.MedialCloud(
        np.array(centers, float),
        np.array(radii, float),
        np.array(features, np.int32),
        np.array(features, np.int32)[:, 0],
        np.full(count, BallStatus.OK, np.int8),
        np.full(count, np.pi),
        np.ones(count, np.int8),
        surface=shape,
    )


def test_a_ball_through_all_vertices_of_a_sphere_is_explained_by_its_facets():
    """|c - face| = r cos a where three vertices share the angle a: exactly the sagitta.

    Corners of an icosphere's face see its plane at slightly different angles, but all lie on the
    sphere round the center, so the foot of the center is equally far from them: cos a is the same.
    """
    shape = closed_forms.icosphere(2)
    n = shape.point_count
    opposite = np.array([np.argmin(shape.points @ p) for p in shape.points])
    features = np.stack([np.arange(n), opposite], axis=1)
    found = poke_out(cloud_of(shape, np.zeros((n, 3)), np.ones(n), features), tolerance=0)
    # A vertex may be farther from the flattest face than its own faces are deep: allow for that.
    deepest = 1 - np.linalg.norm(shape.points[shape.faces].mean(axis=1), axis=1).min()
    assert found.balls == n and found.worst <= 100 * deepest / shape.diagonal
    larger = poke_out(cloud_of(shape, np.zeros((n, 3)), np.full(n, 1.1), features), tolerance=0)
    assert larger.share == 100 and larger.tenth > 90


def test_a_ball_between_the_walls_of_a_box_pokes_out_by_its_excess_alone():
    """Flat faces have no sagitta: 1.1 tolerances are allowed, and not a bit more."""
    shape = closed_forms.box_mesh((1.0, 1.0, 0.4), longest_edge=0.1)
    inside = np.abs(shape.points[:, :2]).max(axis=1) < 0.2
    rows = np.flatnonzero(inside & (shape.points[:, 2] > 0.19))[:6]
    below = shape.tree.query(shape.points[rows] * [1, 1, -1])[1]
    tolerance = 0.001
    deep = np.array([0.5, 1.0, 1.05, 1.15, 2.0, 5.0]) * tolerance * shape.diagonal
    radii = 0.2 + deep / 2  # it touches the upper face, so all of the excess is below the lower one
    centers = shape.points[rows] - radii[:, None] * [0, 0, 1]
    found = poke_out(cloud_of(shape, centers, radii, np.stack([rows, below], 1)), tolerance)
    assert found.rows.tolist() == [3, 4, 5]
    assert found.share == found.share_at_creases == 50
    assert np.isclose(found.worst, 100 * (5.0 - 1.1) * tolerance)


def test_at_a_crease_only_the_strict_share_counts():
    """A ball of an averaged normal on the edge of a box cuts both faces."""
    shape = closed_forms.box_mesh((1.0, 1.0, 1.0), longest_edge=0.1)
    on_edge = np.flatnonzero((np.abs(shape.points) > 0.49).sum(axis=1) == 2)
    row = on_edge[np.abs(shape.points[on_edge]).min(axis=1).argmin()]
    normal, radius = shape.normals[row], 0.2
    far = np.linalg.norm(shape.points - (shape.points[row] - 2 * radius * normal), axis=1).argmin()
    cloud = cloud_of(shape, [shape.points[row] - radius * normal], [radius], [[row, far]])
    found = poke_out(cloud, 1e-4)
    assert found.share == 0 and found.share_at_creases == 100
    assert np.allclose(np.abs(fan_normals(shape)).max(axis=1), 1)  # of faces, nowhere averaged


def test_rotation_and_scale_change_nothing():
    shape = medialis.organic_shape(56)
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    moved = medialis.Shape(7 * shape.points @ turn.T + 2, shape.normals @ turn.T, shape.faces)
    cloud = medialis.surface_skeleton(shape, refine=0)
    centers, radii = 7 * cloud.centers @ turn.T + 2, 7 * cloud.radii
    other = replace(cloud, centers=centers, radii=radii, surface=moved)
    scale = moved.diagonal / shape.diagonal / 7  # the box of a turned shape is another
    one, two = poke_out(cloud, 3e-4), poke_out(other, 3e-4 / scale)
    assert 0 < one.share < 100
    assert np.array_equal(one.rows, two.rows)
