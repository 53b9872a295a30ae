"""Balls behind walls thinner than the tolerance, or than the samples are apart."""

from dataclasses import replace

import numpy as np
import pytest

import closed_forms as forms
import medialis
from medialis import MedialCloud, Progress, Shape, make_shape, shrink_balls
from medialis.balls.ball_shrinking import DEFAULT_TOLERANCE, ShrinkOptions, shrink
from medialis.balls.hidden_walls import THINNEST, hidden_walls, touches_from_outside
from medialis.balls.thin_walls import _with_lower_tolerance, maximal_balls
from medialis.balls.triangle_contacts import NearSurface
from medialis.threads import thread_limit
from oracles import winding_numbers

FIELDS = ("centers", "radii", "features", "status", "spoke_angles")
ROTATION = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]


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
    return maximal_balls(shape, ShrinkOptions(side=side), Progress.of(progress))


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
        options = ShrinkOptions(side=side)
        cloud, tree = shrink(shape, options, Progress())
        progress = Progress()
        found = _with_lower_tolerance(cloud, tree, options, progress)
    assert progress.messages[0].code == "thin_walls"
    assert len(changed_rows(cloud, found)) > 100
    expected = with_full_recomputation(shape, side)
    for name in FIELDS:
        assert np.array_equal(getattr(found, name), getattr(expected, name), equal_nan=True)


@pytest.mark.parametrize("wall", [1e-2, 1e-3])
def test_balls_do_not_slip_between_the_samples_of_a_plate(wall):
    """Their centers lay outside, up to 400 walls off, and touched samples from the other side."""
    shape, progress = sparse_plate(wall), Progress()
    before, after = shrink_balls(shape), cured(shape, progress=progress)
    out = np.abs(before.centers[:, 2]) > wall / 2
    assert out.sum() > 200 and after.valid.all()
    assert (np.abs(after.centers[:, 2]) < wall / 2).all()
    rows = changed_rows(before, after)
    assert np.isin(np.flatnonzero(out), rows).all()
    (message,) = progress.messages
    assert message.code == "slipped_balls"
    assert message.data == {"samples": len(rows), "of": len(after)}
    # The nearest place of a plane is straight behind: the ball touches both sides.
    assert after.radii[rows] == pytest.approx(wall / 2, rel=1e-9)
    assert after.spoke_angles[rows] == pytest.approx(np.pi, abs=1e-4)
    second = shape.points[after.features[rows, 1]]
    assert (second[:, 2] * shape.points[rows, 2] < 0).all()
    off = np.linalg.norm((second - after.centers[rows])[:, :2], axis=1)
    assert (off < 0.05).all()  # the nearest corner of the triangle: within an edge


def test_thickness_of_a_plate_that_is_sampled_sparsely_and_hidden_by_the_tolerance():
    """It was 391 times too thick: no sample of the wall stops a ball, whatever the tolerance."""
    wall = 2e-4
    result = medialis.run("thickness", sparse_plate(wall), refine=0)
    assert wall < DEFAULT_TOLERANCE * result.shape.diagonal
    assert result.layers[0].attributes["thickness"] == pytest.approx(wall, rel=1e-6)


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
    rows = changed_rows(shrink_balls(shape), one)
    assert other.radii[rows] == pytest.approx(one.radii[rows], rel=1e-9)


def test_clouds_and_outer_balls_stay_as_they_are():
    shape = sparse_plate(1e-2)
    cloud = Shape(shape.points, shape.normals)
    for given, side in ((cloud, "inner"), (shape, "outer")):
        plain, found = shrink_balls(given, side=side), cured(given, side=side)
        for name in FIELDS:
            assert np.array_equal(getattr(plain, name), getattr(found, name), equal_nan=True)


@pytest.mark.parametrize("seam", [False, True])
def test_which_side_of_a_blade_is_told_as_by_winding_numbers(seam):
    """At its edge of 11 degrees the normal of one face tells the wrong side."""
    points = np.array([[0, 0, 0], [0, 1, 0], [1, 0, 0.1], [1, 1, 0.1], [1, 0, -0.1], [1, 1, -0.1]])
    quads = [(0, 2, 3, 1), (0, 1, 5, 4), (2, 4, 5, 3)]
    faces = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))] + [(0, 4, 2), (1, 3, 5)]
    shape = make_shape(points, faces)
    if seam:  # the second side has corners of its own
        extra = np.array(faces)
        extra[2:4] += np.where(extra[2:4] < 2, 6, 0)
        shape = Shape(np.vstack([points, points[:2]]), shape.normals[[*range(6), 0, 1]], extra)
    queries = np.random.default_rng(2).uniform([-0.5, -0.2, -0.3], [1.2, 1.2, 0.3], (2000, 3))
    surface = NearSurface.of(shape, np.zeros((1, 3)), np.array([9.0]))
    front, _ = surface.in_front(queries)
    assert np.array_equal(front, winding_numbers(shape.points, shape.faces, queries) < 0.5)
    assert front.sum() > 1000 and (~front).sum() > 100


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
