"""Balls and triangles in the depth buffer, against closed forms and slow ray casting in numpy."""

import math

import numpy as np
import pytest

from medialis.base.errors import Cancelled, InvalidShapeError
from medialis.base.threads import thread_limit
from medialis.show import raster
from medialis.show.camera import Camera
from medialis.show.raster import rasterize


def view(perspective=False, width=120, height=90, extent=3.0, eye=(0.3, -0.2, 5.0)):
    return Camera(eye, (0.1, 0.0, 0.0), (0.0, 1.0, 0.2), extent, width, height, perspective)


def rays(camera):
    """Origin and direction of each pixel's ray, (h, w, 3) each; the direction has depth 1."""
    rows, cols = np.mgrid[0 : camera.height, 0 : camera.width] + 0.5
    across = (cols - camera.width / 2) / camera.scale
    upward = (camera.height / 2 - rows) / camera.scale
    right, up, forward = camera.axes
    offset = across[..., None] * right + upward[..., None] * up
    if camera.perspective:
        return np.broadcast_to(camera.eye, offset.shape), forward + offset / camera.distance
    return camera.eye + offset, np.broadcast_to(forward, offset.shape)


def cast_at_ball(camera, center, radius, far=False):
    """Depth of a ball at each pixel (inf: missed) by the quadratic formula."""
    origin, direction = rays(camera)
    out = origin - center
    a = (direction**2).sum(-1)
    b = (out * direction).sum(-1)
    q = b**2 - a * ((out**2).sum(-1) - radius**2)
    root = np.sqrt(np.maximum(q, 0))
    return np.where(q < 0, np.inf, (-b + (root if far else -root)) / a)


def cast_at_triangle(camera, corners):
    """Depth of a triangle at each pixel (inf: missed) by Moeller and Trumbore."""
    origin, direction = rays(camera)
    a, b, c = corners
    p = np.cross(direction, c - a)
    det = p @ (b - a)
    t = origin - a
    q = np.cross(t, b - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = (t * p).sum(-1) / det
        v = (direction * q).sum(-1) / det
        depth = q @ (c - a) / det
        hit = (u >= 0) & (v >= 0) & (u + v <= 1)
    if camera.perspective:
        hit &= depth >= camera.near
    return np.where(hit, depth, np.inf)


@pytest.mark.parametrize("perspective", [False, True])
def test_ball_depth_is_the_exact_ray_intersection(perspective):
    camera = view(perspective)
    for center, radius in (([0.0, 0.0, 0.0], 1.0), ([1.2, -0.9, 0.7], 0.6)):
        expected = cast_at_ball(camera, np.array(center), radius)
        seen = rasterize(camera, centers=[center], radii=[radius])
        # The quadratic formula itself rounds near the rim, where its root is the root of 1e-15.
        assert (seen.mask == np.isfinite(expected)).mean() > 0.9999
        both = seen.mask & np.isfinite(expected)
        np.testing.assert_allclose(seen.depth[both], expected[both], atol=1e-6)
        assert np.median(np.abs(seen.depth[both] - expected[both])) < 1e-14
        assert np.isposinf(seen.depth[~seen.mask]).all()


@pytest.mark.parametrize("perspective", [False, True])
def test_silhouette_area_of_a_ball(perspective):
    """A disc of r (orthographic) or f r / sqrt(d^2 - r^2) pixels: off by far less than its rim."""
    camera = Camera([0, 0, 4], [0, 0, 0], [0, 1, 0], 3.0, 600, 600, perspective)
    disc = camera.scale * (4 / math.sqrt(15) if perspective else 1.0)
    area = rasterize(camera, centers=[[0, 0, 0]], radii=[1.0]).mask.sum()
    assert abs(area - math.pi * disc**2) < 0.05 * 2 * math.pi * disc


@pytest.mark.slow
def test_ball_touches_are_where_the_radius_says():
    camera = view()
    seen = rasterize(camera, centers=[[0, 0, 0]], radii=[0.5])
    origin, direction = rays(camera)
    hit = (origin + seen.depth[..., None] * direction)[seen.mask]
    np.testing.assert_allclose(np.linalg.norm(hit, axis=1), 0.5, atol=1e-9)


@pytest.mark.parametrize("perspective", [False, True])
def test_tiny_balls_cover_the_pixel_they_lie_in(perspective):
    rng = np.random.default_rng(1)
    camera = view(perspective)
    centers = rng.uniform(-0.9, 0.9, (40, 3))
    pixels, depth = camera.project(centers)
    for center, (col, row), z in zip(centers, pixels, depth, strict=True):
        seen = rasterize(camera, centers=[center], radii=[1e-7])
        assert np.argwhere(seen.mask).tolist() == [[math.floor(row), math.floor(col)]]
        # On the pixel's ray next to the center: off by half a pixel times the slope of the ray.
        slope = 0.5 if perspective else 0.0
        assert abs(seen.depth.min() - z) < slope / camera.scale + 1e-6


def test_perspective_ball_behind_across_and_around_the_eye():
    camera = Camera([0, 0, 0], [0, 0, -1], [0, 1, 0], 2.0, 40, 40, True)
    assert not rasterize(camera, centers=[[0, 0, 3]], radii=[1.0]).mask.any()
    around = rasterize(camera, centers=[[0, 0, 0]], radii=[2.0])
    assert around.mask.all()
    expected = cast_at_ball(camera, np.zeros(3), 2.0, far=True)
    np.testing.assert_allclose(around.depth, expected, rtol=1e-12)
    beside = rasterize(camera, centers=[[0, 1.2, 0.0]], radii=[1.0])
    expected = cast_at_ball(camera, np.array([0, 1.2, 0.0]), 1.0)
    np.testing.assert_array_equal(beside.mask, np.isfinite(expected) & (expected > camera.near))


@pytest.mark.parametrize("perspective", [False, True])
def test_triangles_agree_with_ray_casting(perspective):
    """Random triangles of both orientations, some across the near plane or behind the eye."""
    rng = np.random.default_rng(5)
    camera = view(perspective, width=60, height=48)
    points = rng.uniform(-1.5, 1.5, (90, 3)) + camera.eye * rng.uniform(0, 1.2, (90, 1))
    faces = np.arange(90).reshape(-1, 3)
    layers = np.stack([cast_at_triangle(camera, points[face]) for face in faces])
    expected, names = layers.min(0), layers.argmin(0)
    seen = rasterize(camera, points=points, faces=faces)
    covered = np.isfinite(expected)
    assert covered.mean() > 0.2
    # A pixel center on an edge to the last bit may fall to either side.
    same = (seen.index == np.where(covered, names, -1)) & (seen.mask == covered)
    assert same.mean() > 0.999
    both = same & covered
    np.testing.assert_allclose(seen.depth[both], expected[both], rtol=1e-7)


@pytest.mark.parametrize("perspective", [False, True])
def test_neighbours_leave_no_gap_and_share_no_pixel(perspective):
    """A triangulated square whose vertices lie on pixel centers, so that edges are hit exactly."""
    rng = np.random.default_rng(2)
    size, step = 9, 4
    camera = Camera([0, 0, 10], [0, 0, 0], [0, 1, 0], 64.0, 64, 64, perspective)
    grid = np.arange(size) * step - 16.0 + 0.5
    points = np.stack([*np.meshgrid(grid, grid), np.zeros((size, size))], axis=-1).reshape(-1, 3)
    inner = ((points[:, :2] > grid[0]) & (points[:, :2] < grid[-1])).all(axis=1)
    points[inner, :2] += rng.integers(-1, 2, (inner.sum(), 2))
    a = (np.arange(size - 1)[:, None] * size + np.arange(size - 1)).ravel()
    faces = np.concatenate(
        [np.stack([a, a + 1, a + size], 1), np.stack([a + size, a + 1, a + size + 1], 1)]
    )
    flip = rng.random(len(faces)) < 0.5
    faces[flip] = faces[flip, ::-1]
    count = sum(rasterize(camera, points=points, faces=[face]).mask.astype(int) for face in faces)
    rows = np.flatnonzero(count.any(axis=1))
    # The square is 32 pixels wide; its border hits centers, and belongs to it on two sides.
    assert len(rows) == 32
    square = count[rows[0] : rows[-1] + 1]
    assert (square[:, square.any(axis=0)] == 1).all()
    assert count.sum() == 32 * 32


def test_clipped_neighbours_leave_no_gap():
    """A floor under the eye runs through the near plane: below the horizon each pixel shows it."""
    camera = Camera([0, 1, 0], [0, 1, -1], [0, 1, 0], 1.0, 64, 64, True)
    rng = np.random.default_rng(0)
    grid = np.linspace(-400, 400, 9)
    x, z = (part.ravel() for part in np.meshgrid(grid, grid))
    points = np.stack([x + rng.uniform(-9, 9, 81), np.zeros(81), z], axis=1)
    a = (np.arange(8)[:, None] * 9 + np.arange(8)).ravel()
    faces = np.concatenate([np.stack([a, a + 1, a + 9], 1), np.stack([a + 9, a + 1, a + 10], 1)])
    seen = rasterize(camera, points=points, faces=faces)
    assert seen.mask[33:].all()
    assert not seen.mask[:32].any()
    rows = np.arange(33, 64) + 0.5
    np.testing.assert_allclose(seen.depth[33:, 7], 64 / (rows - 32), rtol=1e-9)


def test_nearest_wins_and_ties_go_to_the_lowest_index():
    camera = Camera([0, 0, 5], [0, 0, 0], [0, 1, 0], 3.0, 21, 21)
    seen = rasterize(camera, centers=[[0, 0, -1], [0, 0, 1], [0, 0, 1]], radii=[1, 1, 1])
    assert set(np.unique(seen.index)) == {-1, 1}
    triangle = [[-1, -1, 1.9], [1, -1, 1.9], [0, 1, 1.9]]
    mixed = rasterize(
        camera, centers=[[0, 0, 1]], radii=[1], points=triangle, faces=[[0, 1, 2], [0, 2, 1]]
    )
    assert set(np.unique(mixed.index)) == {-1, 0, 1}
    assert mixed.index[10, 10] == 0  # the ball's front is nearer in the middle


@pytest.mark.parametrize("perspective", [False, True])
def test_one_thread_equals_two_and_inputs_stay(perspective):
    rng = np.random.default_rng(4)
    centers, radii = rng.normal(size=(400, 3)), rng.uniform(0, 0.2, 400)
    points, faces = rng.normal(size=(99, 3)), rng.integers(0, 99, (200, 3))
    kept = [array.copy() for array in (centers, radii, points, faces)]
    camera = view(perspective, width=150, height=200)
    results = []
    for count in (1, 2):
        with thread_limit(count):
            results.append(
                rasterize(camera, centers=centers, radii=radii, points=points, faces=faces)
            )
    one, two = results
    np.testing.assert_array_equal(one.depth, two.depth)
    np.testing.assert_array_equal(one.index, two.index)
    for before, now in zip(kept, (centers, radii, points, faces), strict=True):
        np.testing.assert_array_equal(before, now)


@pytest.mark.parametrize("perspective", [False, True])
def test_bands_drawn_in_parts_are_the_same(perspective, monkeypatch):
    """Bands of many large balls are drawn in parts, so that they can be cancelled between."""
    rng = np.random.default_rng(5)
    centers, radii = rng.normal(0, 0.5, (300, 3)), rng.uniform(0.001, 1.0, 300)
    corners = rng.normal(0, 1, (200, 3))
    corners[100:] = corners[:100]  # equal depths: the lowest index stays
    faces = np.arange(198).reshape(-1, 3)
    given = {"centers": centers, "radii": radii, "points": corners, "faces": faces}
    whole, told = rasterize(view(perspective), **given), []
    for name in ("BALLS_A_STEP", "PIXELS_A_STEP", "TRIANGLES_A_STEP"):
        monkeypatch.setattr(raster, name, 7)
    with thread_limit(1):
        parts = rasterize(
            view(perspective), **given, progress=lambda fraction, text: told.append(text)
        )
    np.testing.assert_array_equal(parts.index, whole.index)
    np.testing.assert_array_equal(parts.depth, whole.depth)
    assert told.count("balls") > 300 / 7 and told.count("triangles") > 66 / 7


def test_union_of_the_balls_of_a_sphere_is_the_sphere():
    """Balls inside the unit sphere that touch it: the union's depth is the sphere's."""
    rng = np.random.default_rng(6)
    directions = rng.normal(size=(3000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    radii = rng.uniform(0.9, 1.0, 3000)
    centers = directions * (1 - radii)[:, None]
    camera = view(extent=2.2)
    union = rasterize(camera, centers=centers, radii=radii)
    sphere = cast_at_ball(camera, np.zeros(3), 1.0)
    assert (union.mask <= np.isfinite(sphere)).all()
    # 3000 touching points are about 0.06 apart; half way between two, a ball with 1 - r = 0.1 lies
    # less than 0.1 (1 - cos 0.03) = 5e-5 below the sphere: a five-hundredth of a pixel.
    missed = np.isfinite(sphere) & ~union.mask
    assert missed.sum() <= 2
    both = union.mask
    assert np.median(union.depth[both] - sphere[both]) * camera.scale < 0.005


def test_depth_statistics_do_not_change_under_rotation():
    rng = np.random.default_rng(7)
    centers, radii = rng.normal(size=(300, 3)), rng.uniform(0.05, 0.3, 300)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.linalg.det(turn)
    camera = Camera([0, 0, 9], [0, 0, 0], [0, 1, 0], 7.0, 150, 150)
    turned = Camera(turn @ camera.eye, [0, 0, 0], turn @ camera.up, 7.0, 150, 150)
    one = rasterize(camera, centers=centers, radii=radii)
    two = rasterize(turned, centers=centers @ turn.T, radii=radii)
    same = one.index == two.index
    assert same.mean() > 0.999
    np.testing.assert_allclose(one.depth[same & one.mask], two.depth[same & one.mask], atol=1e-6)


@pytest.mark.parametrize("perspective", [False, True])
def test_enormous_and_far_away_things_do_no_harm(perspective):
    camera = view(perspective, width=30, height=20)
    huge = [[1e150, 0, 0], [0, 0, 0], [-1e100, 1e100, 1e100]]
    seen = rasterize(camera, centers=huge, radii=[1e100, 0.5, 1.0])
    assert set(np.unique(seen.index)) == {-1, 1}
    rasterize(camera, points=huge, faces=[[0, 1, 2]])


def test_bad_input_is_one_sentence():
    camera = view()
    with pytest.raises(InvalidShapeError, match="radii must be finite"):
        rasterize(camera, centers=[[0, 0, 0]], radii=[-1.0])
    with pytest.raises(InvalidShapeError, match="radii must be finite"):
        rasterize(camera, centers=[[0, 0, 0]], radii=[np.nan])
    with pytest.raises(InvalidShapeError, match="centers must be finite"):
        rasterize(camera, centers=[[0, 0, np.nan]], radii=[1.0])
    with pytest.raises(InvalidShapeError, match="faces must name vertices"):
        rasterize(camera, points=[[0, 0, 0]], faces=[[0, 1, 2]])
    with pytest.raises(Cancelled):
        rasterize(camera, centers=[[0, 0, 0]], radii=[1.0], progress=lambda f, t: False)
