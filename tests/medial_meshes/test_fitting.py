"""What a fit looks at: distances of moving balls, balls that stick out, hollows."""

import numpy as np
import pytest

from closed_forms import box_mesh, icosphere
from medialis.base.progress import Progress
from medialis.medial_meshes.envelope import Envelope, primitives_of
from medialis.medial_meshes.fine_complex import fine_complex
from medialis.medial_meshes.fitting import BALLS_A_LISTED, Bounds, Fit, Follower, Target
from medialis.medial_meshes.mesh import Complex
from medialis.medial_meshes.refining import Fault, Hollows, refined
from medialis.medial_meshes.sampling import Solid


def shell(radius, thickness):
    """A closed sheet of balls with their centers on an icosphere."""
    sphere = icosphere(2)
    balls = np.column_stack([radius * sphere.points, np.full(sphere.point_count, thickness)])
    edges = np.sort(sphere.edges.astype(np.int64), axis=1)
    return Complex(balls, edges, np.sort(sphere.faces.astype(np.int64), axis=1))


@pytest.mark.parametrize("listed", [6, 24])
def test_distances_that_follow_moving_balls_are_those_of_a_search(listed):
    """Balls all move alike, by random steps of up to a tenth of their radius."""
    given, rng = shell(1.0, 0.2), np.random.default_rng(3)
    rows = primitives_of(given)
    places = 2.6 * rng.random((500, 3)) - 1.3
    follower, balls = Follower(places, listed * BALLS_A_LISTED), given.balls
    assert follower.listed == listed
    for step in (0.02, 0.02, 0.001, 0.02, 0.0001):
        envelope = Envelope(balls, rows)
        distance, row, shares = follower.distances(envelope).done()
        assert np.allclose(distance, envelope.distances(places)[0], atol=1e-14)
        centers = np.einsum("qk,qkd->qd", shares, balls[np.maximum(rows[row], 0)])
        far = np.linalg.norm(places - centers[:, :3], axis=1) - centers[:, 3]
        assert np.allclose(far, distance, atol=1e-14)
        balls = balls + step * (2 * rng.random(balls.shape) - 1)


def sphere_target():
    points = icosphere(4).points
    return Target(points, points, np.arange(10), np.empty((0, 5)), Bounds(points, points))


def test_what_sticks_out_of_a_sphere():
    """A center at distance d of the middle is 1 - d deep, up to the spacing squared; 0 if held."""
    centers = np.array([[0.2, 0, 0], [0, 0.7, 0], [0, 0, 1.02], [0, 0.5, 0]])
    balls = np.column_stack([centers, [0.9, 0.4, 0.1, 0.4]])
    found = sphere_target().bounds.overshoot(balls).done()
    assert np.allclose(found.over, [-0.1, -0.1, -0.12, 0.0], atol=2e-3)
    assert found.near[3] == -1


def test_what_sticks_out_is_found_exactly_while_balls_move():
    """Lists of near points, kept from step to step, lose none that comes nearer."""
    bounds, rng = sphere_target().bounds, np.random.default_rng(2)
    balls = np.column_stack([0.5 * rng.normal(size=(300, 3)), 0.1 + 0.6 * rng.random(300)])
    known = bounds.overshoot(balls).done()
    for step in (0.001, 0.02, 0.0001, 0.005, 0.1):
        balls = balls + step * (2 * rng.random(balls.shape) - 1)
        known = bounds.overshoot(balls, known).done()
        held = np.linalg.norm(balls[:, :3], axis=1) < 1.0  # a center outside needs to be followed
        slow = np.linalg.norm(balls[:, None, :3] - bounds.points, axis=2)
        over = np.minimum(slow.min(axis=1) - balls[:, 3], 0.0)
        assert np.allclose(known.over[held], over[held], atol=1e-14)
        assert (known.near[over < 0] == slow.argmin(axis=1)[over < 0]).all()


def test_a_ball_that_flew_off_is_found_by_the_point_it_came_from():
    """A small ball far outside, where no point is near: it was missed, and shapes got spikes."""
    target = sphere_target()
    ball = np.array([[0.0, 0.0, 0.9, 0.05]])
    known = target.bounds.overshoot(np.array([[0.0, 0.0, 0.96, 0.05]])).done()
    ball[0, 2] = 1.7
    found = target.bounds.overshoot(ball, known).done()
    assert np.isclose(found.over[0], -0.75, atol=2e-3)


def test_the_side_of_a_center_is_looked_up_where_normals_are_wrong():
    """Normals turned over where x > 0: only what tells inside is right there."""
    points = icosphere(4).points
    normals = np.where(points[:, :1] > 0, -points, points)
    balls = np.array([[0.9, 0, 0, 0.3], [-0.9, 0, 0, 0.3], [1.2, 0, 0, 0.1], [0.2, 0, 0, 0.5]])
    right = [-0.2, -0.2, -0.3]

    def over(bounds):
        known = bounds.overshoot(balls).done()
        rows, found, places = bounds.out_of(balls, known, np.array([2]))
        assert np.allclose(np.linalg.norm(places, axis=1), 1.0, atol=2e-3)
        return dict(zip(rows.tolist(), found.tolist(), strict=True))

    wrong = over(Bounds(points, normals))
    assert abs(wrong[0] + 0.4) < 0.01 and abs(wrong.get(2, 0.0) + 0.3) > 0.1
    found = over(Bounds(points, normals, lambda x: np.linalg.norm(x, axis=1) < 1.0))
    assert np.allclose([found.get(i, 0.0) for i in range(3)], right, atol=2e-3) and 3 not in found


def test_a_hollow_that_no_sample_of_the_surface_tells():
    """A shell of balls in a ball: its inner wall at 0.6 is 0.4 deep, with all samples on it."""
    sphere = icosphere(3)
    solid = Solid(sphere.points / sphere.diagonal, sphere.faces)
    fine = fine_complex(solid, 1000, 0.002, 0, Progress())
    scale = 1 / sphere.diagonal
    given = shell(0.8, 0.2).placed(scale, np.zeros(3))
    hollows = Hollows(solid, fine, Bounds(fine.samples.points, fine.samples.normals))
    places, depth = hollows.of(given, 0.01 * scale)
    # Slabs of chords e = 0.32 lie e^2 / 6 = 0.02 further in, samples between them half of that.
    assert 0.38 * scale < depth < 0.45 * scale
    radius = np.linalg.norm(places[:, :3], axis=1) / scale
    assert len(places) > 100 and (radius > 0.5).all() and (radius < 0.75).all()
    assert np.allclose(places[:, 3] * places[:, 4] / scale, 1 - radius, atol=0.01)
    full = Complex(np.array([[0, 0, 0, scale]]), np.empty((0, 2), np.int64), np.empty((0, 3), int))
    assert hollows.of(full, 0.01)[1] < 0.02 * scale


def boxed(size, count):
    """Return what finds hollows in a box, the scale to diagonal 1, and samples."""
    box = box_mesh(size, 0.1)
    scale = 1 / box.diagonal
    solid = Solid(box.points * scale, box.faces)
    samples = (fine := fine_complex(solid, count, 0.002, 0, Progress())).samples
    return Hollows(solid, fine, Bounds(samples.points, samples.normals)), scale, samples.points


def test_the_ground_of_a_valley_is_found_in_a_close_look():
    """Two cones with radii from 0.5 to 0.1 meet in the middle of a box; their walls lean by 0.92.

    The ground has the radius 0.1 / 0.92, and is deepest where it is as far from two faces.
    """
    hollows, scale, points = boxed((3.0, 1.0, 1.0), 2000)
    balls = np.array([[-1.0, 0, 0, 0.5], [0, 0, 0, 0.1], [1, 0, 0, 0.5]]) * scale
    given = Complex(balls, np.array([[0, 1], [1, 2]]), np.empty((0, 3), np.int64))
    outside = Envelope.of(given).distances(points)[0]
    found = hollows.look(given, 0.3 * scale, outside)
    ground = 0.1 / np.sqrt(1 - 0.4**2)
    assert np.isclose(found.largest, (0.5 - ground * np.sqrt(0.5)) * scale, rtol=0.02)
    places, depth = found.within[:, :3], found.within[:, 3] * found.within[:, 4]
    assert len(places) > 50 and np.abs(Envelope.of(given).distances(places)[0]).max() < 0.01 * scale
    assert np.allclose(depth, 0.5 * scale - np.abs(places[:, 1:]).max(axis=1), atol=1e-3)
    assert np.abs(places[:, 0]).max() < 0.3 * scale  # beside the valley nothing is that deep
    assert len(found.watched[0]) == 0


def test_what_sticks_out_is_watched():
    """A ball of radius 0.6 in a cube of side 1: its caps are out, its corners not held."""
    hollows, scale, points = boxed((1.0, 1.0, 1.0), 1000)
    none = np.empty((0, 2), np.int64), np.empty((0, 3), np.int64)
    ball = Complex(np.array([[0, 0, 0, 0.6 * scale]]), *none)
    found = hollows.look(ball, 0.05 * scale, np.zeros(len(points)))
    assert np.isclose(found.largest, (0.5 - 0.6 / np.sqrt(3)) * scale, rtol=0.02)
    row, shares = found.watched
    assert len(row) > 100 and (row == 0).all() and (shares == [1, 0, 0]).all()


def test_places_of_a_fit_are_there_once():
    """Two triangles with a common side: lattices of both share its places."""
    box = box_mesh((1.0, 1.0, 1.0), 0.2)
    balls = np.array([[0, 0, 0, 0.1], [1, 0, 0, 0.1], [0, 1, 0, 0.1], [1, 1, 0, 0.1]])
    edges = np.array([[0, 1], [0, 2], [1, 2], [1, 3], [2, 3]])
    given = Complex(balls, edges, np.array([[0, 1, 2], [1, 2, 3]]))
    bounds = Bounds(box.points, box.points)
    target = Target(box.points, box.points, np.arange(4), np.empty((0, 5)), bounds)
    between = Fit(given, target).between(balls)
    assert len(np.unique(between.round(9), axis=0)) == len(between)
    assert len(between) == 17 * 17  # a square with 16 steps a side, cut along its diagonal


def test_small_faults_get_balls_where_a_smaller_share_of_the_worst_does():
    """Three places apart from each other, of errors 4, 2, 1."""
    start = shell(1.0, 0.1)
    places = np.eye(3)
    balls = np.column_stack([places, np.full(3, 0.2)])
    faults = Fault(places, np.array([4.0, 2.0, 1.0]), balls, places)
    for share, added in ((0.6, 1), (0.5, 2), (0.2, 3)):
        found = refined(start, faults, 3, share=share)
        assert len(found) == len(start) + added
        assert np.array_equal(found.balls[len(start) :], balls[:added])
    assert len(refined(start, faults, 2, share=0.2)) == len(start) + 2
