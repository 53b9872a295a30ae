"""Balls behind walls thinner than the tolerance, or than the samples are apart."""

from dataclasses import replace

import numpy as np
import pytest

import closed_forms as forms
import medialis
from medialis import MedialCloud, Progress, Shape, make_shape, shrink_balls
from medialis.base.threads import thread_limit
from medialis.skeleton.medial_cloud import (
    DEFAULT_TOLERANCE,
    THINNEST,
    _nearest,
    hidden_walls,
    shrink,
    touches_from_outside,
)
from medialis.skeleton.surface_skeleton import (
    BallOptions,
    Cured,
    _with_lower_tolerance,
    maximal_balls,
)
from oracles import winding_numbers

FIELDS = ("centers", "radii", "features", "status", "spoke_angles")
ROTATION = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]


def test_the_nearest_samples_of_a_few_are_those_that_a_tree_finds():
    shape = medialis.organic_shape(56)
    rows = np.array([0, 17, shape.point_count - 1], np.int32)
    near = _nearest(shape, rows, 32)
    expected = shape.tree.query(shape.points[rows], k=32)[1]
    assert (np.sort(near, axis=1) == np.sort(expected, axis=1)).all()
    assert (near[:, 0] == rows).all()


def sparse_plate(wall, edge=0.05):
    """A plate whose samples are edge / 2 to edge apart, those of one side not over the other's."""
    box = forms.box_mesh((1.0, 0.8, wall), edge)
    points = box.points.copy()
    inner = (np.abs(points[:, 0]) < 0.499) & (np.abs(points[:, 1]) < 0.399)
    step = np.random.default_rng(0).uniform(-edge / 8, edge / 8, (inner.sum(), 2))
    points[inner, :2] += step
    return make_shape(points, box.faces)


def shell(wall=0.01, levels=3):
    """The space between two spheres, whose samples are about 0.14 apart."""
    ball = forms.icosphere(levels)
    n = ball.point_count
    inside = (1 - wall) * ball.points @ ROTATION.T
    return make_shape(
        np.concatenate([ball.points, inside]), np.concatenate([ball.faces, ball.faces[:, ::-1] + n])
    )


def cured(shape, side="inner", progress=None):
    return maximal_balls(shape, BallOptions(side=side), Progress.of(progress))


def changed_rows(before, after):
    return np.flatnonzero((before.radii != after.radii) & after.valid)


def with_full_recomputation(shape, side):
    """What `_with_lower_tolerance` must give: all balls at every tolerance."""
    cloud, finer = shrink_balls(shape, side=side), DEFAULT_TOLERANCE
    hidden = hidden_walls(cloud, finer)
    exact = shrink_balls(shape, side=side, tolerance=0.0)
    hidden &= ~hidden_walls(exact, DEFAULT_TOLERANCE)
    while hidden.any():
        finer = finer / 10 if finer > THINNEST else 0.0
        found = shrink_balls(shape, side=side, tolerance=finer)
        seen = hidden & ~hidden_walls(found, DEFAULT_TOLERANCE)
        rows = {name: np.array(getattr(cloud, name)) for name in FIELDS}
        for name in FIELDS:
            rows[name][seen] = getattr(found, name)[seen]
        cloud, hidden = replace(cloud, **rows), hidden & ~seen
    return cloud


@pytest.mark.parametrize("side", ["inner", "both"])
@pytest.mark.parametrize("threads", [1, 2])
def test_only_the_chunks_of_hidden_samples_are_computed_again(side, threads):
    """All balls were, up to six times, for a few samples. Two plates of 1e-4 and 1e-6 beside a box
    have hidden walls in some chunks, at two tolerances."""
    box = forms.box_mesh((1.0, 1.0, 1.0), 0.05)
    plates = [forms.box_mesh((0.5, 0.5, wall), 0.05) for wall in (1e-4, 1e-6)]
    parts = [
        box,
        *(
            replace(plate, points=plate.points + np.array([1 + i, 0, 0]))
            for i, plate in enumerate(plates)
        ),
    ]
    starts = np.cumsum([0] + [part.point_count for part in parts])
    shape = Shape(
        np.concatenate([part.points for part in parts]),
        np.concatenate([part.normals for part in parts]),
        np.concatenate(
            [part.faces + start for part, start in zip(parts, starts[:-1], strict=True)]
        ),
    )
    with thread_limit(threads):
        options = BallOptions(side=side)
        cloud, tree = shrink(shape, options, Progress())
        before, again = cloud.subset(np.arange(len(cloud))), Cured()
        found = _with_lower_tolerance(cloud, tree, None, options, Progress(), again)
    assert again.samples == len(changed_rows(before, found)) and again.lowest < DEFAULT_TOLERANCE
    assert len(changed_rows(before, found)) > 100
    expected = with_full_recomputation(shape, side)
    for name in FIELDS:
        assert np.array_equal(getattr(found, name), getattr(expected, name), equal_nan=True)


@pytest.mark.parametrize("wall", [1e-2, 1e-3])
def test_balls_do_not_slip_between_the_samples_of_a_plate(wall):
    """Their centers lay outside, up to 400 walls off, and touched samples from the other side."""
    shape = sparse_plate(wall)
    before, after = shrink_balls(shape), cured(shape)
    out = np.abs(before.centers[:, 2]) > wall / 2
    assert out.sum() > 200 and after.valid.all()
    assert (np.abs(after.centers[:, 2]) < wall / 2).all()
    rows = changed_rows(before, after)
    assert np.isin(np.flatnonzero(out), rows).all()
    # The nearest place of a plane is straight behind: the ball touches both sides.
    inside = (np.abs(shape.points[:, :2]) < np.array([0.5, 0.4]) - wall).all(axis=1)
    rows = rows[inside[rows]]
    # 1/16 of the tolerance is left for reusing certificates.
    slack = DEFAULT_TOLERANCE * shape.diagonal / 16
    assert after.radii[rows] == pytest.approx(wall / 2, abs=slack)
    assert after.spoke_angles[rows] == pytest.approx(np.pi, abs=4 * np.sqrt(slack / wall))
    second = shape.points[after.features[rows, 1]]
    assert (second[:, 2] * shape.points[rows, 2] < 0).all()
    off = np.linalg.norm((second - after.centers[rows])[:, :2], axis=1)
    assert (off < 0.05).all()  # the nearest corner of the triangle: within an edge


def test_thickness_of_a_plate_that_is_sampled_sparsely_and_hidden_by_the_tolerance():
    """It was 391 times too thick: no sample of the wall stops a ball, whatever the tolerance."""
    wall = 2e-4
    result = medialis.run("thickness", sparse_plate(wall), refine=0)
    assert wall < DEFAULT_TOLERANCE * result.shape.diagonal
    assert result.layers[0].attributes["wall_thickness"] == pytest.approx(wall, rel=1e-6)


def deepest_place(shape, rows, cloud, grid=12):
    """Radius minus distance of the nearest of a dense set of places, own triangles left out."""
    u, v = np.meshgrid(np.linspace(0, 1, grid + 1), np.linspace(0, 1, grid + 1))
    keep = u + v <= 1 + 1e-9
    weights = np.stack([1 - u[keep] - v[keep], u[keep], v[keep]], axis=1)
    places = np.einsum("gc,fcx->fgx", weights, shape.points[shape.faces])
    depth = []
    for row in rows:
        others = ~(shape.faces == cloud.source[row]).any(axis=1)
        distance = np.linalg.norm(places[others] - cloud.centers[row], axis=2).min()
        depth.append(cloud.radii[row] - distance)
    return np.array(depth)


@pytest.mark.slow
def test_balls_in_a_shell_hold_no_surface_and_touch_it():
    shape = shell()
    before, after = shrink_balls(shape), cured(shape)
    assert touches_from_outside(before).sum() > 300
    rows = changed_rows(before, after)
    assert len(rows) > 300
    depth = deepest_place(shape, rows[::25], after)
    tolerance = DEFAULT_TOLERANCE * shape.diagonal
    assert (depth <= tolerance).all()
    # Places are h = 0.17 / 12 apart at most: one lies within h / sqrt 3 of where the ball touches.
    assert (depth > -0.17 / 12 / np.sqrt(3)).all() and deepest_place(
        shape, rows[::25], before
    ).min() > 0
    distance = np.linalg.norm(after.centers[rows], axis=1)
    assert ((distance > 0.985) & (distance < 1.0)).all()
    # Facets of edges up to 0.17 cut 0.17^2 / 6 = 0.005 deep: the wall is 0.005 to 0.015 thick.
    assert ((after.radii[rows] > 0.0024) & (after.radii[rows] < 0.0076)).all()


def test_rotation_and_threads_change_nothing():
    shape = sparse_plate(1e-2)
    turned = Shape(shape.points @ ROTATION.T, shape.normals @ ROTATION.T, shape.faces)
    with thread_limit(1):
        one = cured(shape)
    with thread_limit(2):
        two, other = cured(shape), cured(turned)
    for name in FIELDS:
        assert np.array_equal(getattr(one, name), getattr(two, name), equal_nan=True)
    # The size, the unit of the tolerance, is that of the bounding box, which turns too.
    rows = changed_rows(shrink_balls(shape), one)
    rows = rows[np.abs(shape.points[rows, :2]).max(axis=1) < 0.38]
    slack = DEFAULT_TOLERANCE * max(shape.diagonal, turned.diagonal) / 16
    assert len(rows) > 300
    assert other.radii[rows] == pytest.approx(one.radii[rows], abs=slack)


def test_clouds_stay_as_they_are():
    shape = sparse_plate(1e-2)
    cloud = Shape(shape.points, shape.normals)
    plain, found = shrink_balls(cloud), cured(cloud)
    for name in FIELDS:
        assert np.array_equal(getattr(plain, name), getattr(found, name), equal_nan=True)


@pytest.mark.slow
def test_scapula_has_no_ball_outside(real_shapes):
    """Its blade is thinner than its vertices are apart: 262 balls had their center outside."""
    shape = medialis.read_shape(real_shapes / "scapula.ply")
    before, after = shrink_balls(shape), cured(shape)
    rows = np.flatnonzero(touches_from_outside(before))
    triangles = shape.points, shape.faces
    assert (winding_numbers(*triangles, before.centers[rows[::10]]) < 0.5).mean() > 0.9
    assert (winding_numbers(*triangles, after.centers[rows]) > 0.5).all()
    assert isinstance(after, MedialCloud) and after.valid.sum() == before.valid.sum()


@pytest.mark.parametrize("fans", [False, True])
def test_balls_at_the_rim_of_a_very_thin_plate_lie_in_it(fans):
    """Balls beside creases lay as deep as the tolerance, which was twice the plate: 384 outside."""
    size = np.array([100.0, 70.0, 0.01])
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * size
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    shape = medialis.make_shape(corners, faces)
    cloud = medialis.surface_skeleton(shape, fans=fans, refine=0.05)
    centers = cloud.centers[cloud.valid]
    assert len(centers) > 500
    assert (centers >= 0).all() and (centers <= size).all()
