"""Distances between surfaces and unions of balls: closed forms, a slow oracle, invariants."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import closed_forms as forms
import medialis
from medialis.show.reports.measures import (
    distance_to_balls,
    distance_to_surface,
    reconstruction_error,
)


def slow_distance(queries, centers, radii):
    return (np.linalg.norm(queries[:, None] - centers, axis=2) - radii).min(axis=1)


@settings(deadline=None, max_examples=40)
@given(st.integers(1, 400), st.integers(0, 2**32 - 1), st.sampled_from([1e-12, 1.0, 1e12]))
def test_distance_to_balls_is_the_smallest(count, seed, scale):
    """Any number of balls, some equal, some of radius 0, far from the origin too."""
    rng = np.random.default_rng(seed)
    centers = scale * (rng.normal(size=(count, 3)) + rng.choice([0, 100]))
    centers[rng.integers(count, size=count // 3)] = centers[0]
    radii = scale * rng.exponential(size=count) * rng.integers(0, 2, size=count)
    queries = scale * 2 * rng.normal(size=(50, 3)) + centers[0]
    distance, ball = distance_to_balls(queries, centers, radii)
    # Subtracting the middle rounds coordinates of up to 100 scale by 1e-14 scale.
    size = np.abs(centers).max() + np.abs(queries).max()
    assert np.abs(distance - slow_distance(queries, centers, radii)).max() <= 1e-14 * size
    own = np.linalg.norm(queries - centers[ball], axis=1) - radii[ball]
    assert np.abs(own - distance).max() <= 1e-14 * size


def test_one_and_two_threads_give_the_same_bits():
    rng = np.random.default_rng(1)
    arrays = rng.normal(size=(3000, 3)), rng.normal(size=(5000, 3)), rng.uniform(0, 0.1, 5000)
    with medialis.thread_limit(1):
        one = distance_to_balls(*arrays)
    with medialis.thread_limit(2):
        two = distance_to_balls(*arrays)
    assert all((a == b).all() for a, b in zip(one, two, strict=True))


@pytest.mark.slow
def test_distance_to_a_triangle_in_all_its_regions():
    """Against the nearest of a dense set of its points: never above, below by the grid's step."""
    corners = np.array([[0, 0, 0], [2, 0, 0], [0.3, 1, 0.0]])
    shape = medialis.make_shape(corners, [[0, 1, 2]])
    queries = np.random.default_rng(0).uniform(-2, 3, size=(300, 3))
    steps = 200
    s, t = np.meshgrid(np.linspace(0, 1, steps + 1), np.linspace(0, 1, steps + 1))
    inside = s + t <= 1 + 1e-12
    a, b, c = corners
    dense = a + s[inside, None] * (b - a) + t[inside, None] * (c - a)
    slow = np.linalg.norm(queries[:, None] - dense, axis=2).min(axis=1)
    found = distance_to_surface(queries, shape)
    step = 2 / steps  # the next grid point is nearer than a step of the longest edge
    assert (found <= slow + 1e-12).all() and (slow - found).max() <= step


def test_a_sphere_and_its_ball():
    """The facets lie inside the ball by the sagitta of their circumcircle at most; their middles
    are seen, the samples alone are not."""
    sphere = forms.icosphere(4)
    error = reconstruction_error(sphere, [[0, 0, 0.0]], [1.0])
    longest = np.linalg.norm(np.diff(sphere.points[sphere.edges], axis=1), axis=2).max()
    sagitta = 1 - np.sqrt(1 - (longest / np.sqrt(3)) ** 2)  # of the largest possible triangle
    middles = sphere.points[sphere.faces].mean(axis=1)
    assert error.surface_to_balls_max == pytest.approx(1 - np.linalg.norm(middles, axis=1).min())
    assert error.deepest_sample <= 1e-12
    assert 0 < error.balls_to_surface_max <= sagitta
    grown = reconstruction_error(sphere, [[0, 0, 0.0]], [1.25])
    assert grown.surface_to_balls_max == pytest.approx(1.25 - np.linalg.norm(middles, axis=1).min())
    assert grown.balls_to_surface_max == pytest.approx(0.25, abs=sagitta)
    assert grown.hausdorff >= grown.balls_to_surface_mean > 0.249


def test_the_worst_place_is_on_the_stray_ball():
    """A ball outside of the shape, as false normals make: its far side is found. Of 512 points one
    lies within twice the cap that is its share of a sphere, 2 sqrt(4 / 512) = 0.18; the distance
    is off by the height of that cap and the sagitta of the facets, 0.01 each at most."""
    error = reconstruction_error(forms.icosphere(3), [[0, 0, 0], [3, 0, 0.0]], [1.0, 0.5])
    assert np.linalg.norm(error.worst_place - [3.5, 0, 0]) <= 0.18 * 0.5
    assert error.hausdorff == error.balls_to_surface_max == pytest.approx(2.5, abs=0.02)
    left_out = reconstruction_error(forms.icosphere(3), [[0, 0, 0.5]], [0.5])
    assert left_out.worst_place @ [0, 0, 1] == pytest.approx(-1, abs=0.02)


def test_the_mean_is_over_the_area_not_over_the_samples():
    """A square whose samples crowd at one side. The ball is so large that the distance of a place
    is its x, up to 1 / (2 radius): the mean is a half, that of the samples a twentieth."""
    x = np.r_[np.linspace(0, 0.05, 60), 1.0]
    rows = np.arange(len(x) - 1)
    points = np.array([[value, y, 0] for y in (0.0, 1.0) for value in x])
    low, high = np.stack([rows, rows + 1]), np.stack([rows, rows + 1]) + len(x)
    faces = np.concatenate([np.stack([*low, high[1]], 1), np.stack([low[0], *high[::-1]], 1)])
    shape = medialis.Shape(points, np.tile([0, 0, 1.0], (len(points), 1)), faces)
    error = reconstruction_error(shape, [[-1e4, 0, 0]], [1e4])
    assert error.surface_to_balls_mean == pytest.approx(0.5, abs=1e-4)


@pytest.mark.slow
def test_leaving_balls_out_is_seen_on_the_surface_side_only():
    """Half of the balls of a real skeleton: samples of the other half are far from the union."""
    shape = medialis.organic_shape(56)
    cloud = medialis.shrink_balls(shape)
    good = cloud.subset(cloud.valid)
    half = good.subset(good.centers[:, 0] > np.median(good.centers[:, 0]))
    all_of_it = reconstruction_error(shape, good.centers, good.radii)
    error = reconstruction_error(shape, half.centers, half.radii)
    # Every sample touches its own ball; no ball is deeper than the tolerance in the surface. A
    # place between them is no further from a sample than the longest edge.
    longest = np.linalg.norm(np.diff(shape.points[shape.edges], axis=1), axis=2).max()
    assert 0 < all_of_it.deepest_sample <= (3e-4 + 1e-9) * shape.diagonal
    assert all_of_it.surface_to_balls_max <= longest
    assert error.surface_to_balls_max > 0.1 * shape.diagonal
    assert error.balls_to_surface_mean < 0.1 * shape.diagonal


@pytest.mark.slow
def test_rotation_and_scale_change_nothing():
    shape = medialis.organic_shape(56)
    cloud = medialis.shrink_balls(shape)
    good = cloud.subset(np.flatnonzero(cloud.valid)[::7])
    error = reconstruction_error(shape, good.centers, good.radii)
    turn = Rotation.from_rotvec([0.3, -0.8, 0.5]).as_matrix()
    moved = medialis.Shape(1e3 * shape.points @ turn.T, shape.normals @ turn.T, shape.faces)
    other = reconstruction_error(moved, 1e3 * good.centers @ turn.T, 1e3 * good.radii)
    assert other.surface_to_balls_max == pytest.approx(1e3 * error.surface_to_balls_max, rel=1e-9)
    assert other.surface_to_balls_mean == pytest.approx(1e3 * error.surface_to_balls_mean, rel=1e-9)
    # The points on the spheres do not turn with the shape: the mean over them is a sample.
    assert other.balls_to_surface_mean == pytest.approx(1e3 * error.balls_to_surface_mean, rel=0.1)


def test_distance_to_uneven_triangles_is_exact():
    """Report of gears: the triangles round the three nearest vertices of a place are not always
    the nearest ones, so that its Hausdorff distance came out too large. Here the nearest triangle
    has all its vertices far away."""
    corners = [[-10, -10, 0], [10, -10, 0], [0, 10, 0], [0, 0, -1], [0.1, 0, -1], [0, 0.1, -1.0]]
    shape = medialis.make_shape(corners, [[0, 1, 2], [3, 4, 5]])
    assert distance_to_surface([[0, 0, 0.25]], shape) == pytest.approx(0.25)


def test_a_far_side_that_was_not_seen_is_none():
    """Of many balls every second one is looked at; the only one on the boundary is not."""
    radii = np.full(40_000, 0.01)
    radii[1] = 1.0
    error = reconstruction_error(forms.icosphere(2), np.zeros((40_000, 3)), radii)
    assert error.balls_to_surface_max is None and error.balls_to_surface_mean is None
    assert error.hausdorff == error.surface_to_balls_max > 0


@pytest.mark.parametrize(
    ("centers", "radii", "text"),
    [
        (np.empty((0, 3)), [], "centers"),
        ([[0, 0, 0]], [-1], "not negative"),
        ([[0, 0, 0]], [np.nan], "finite"),
        ([[0, 0, 0]], [1, 2], "radii must be"),
    ],
)
def test_bad_balls_are_refused(centers, radii, text):
    with pytest.raises(medialis.InvalidShapeError, match=text):
        distance_to_balls([[0, 0, 0.0]], centers, radii)
