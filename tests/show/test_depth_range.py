"""The rasterizer of views: against rays and triangles in plain numpy, and on point clouds."""

import math

import numpy as np
import pytest

import closed_forms
import medialis
from medialis.curves.from_views.views import OrthographicCamera, View
from medialis.shape.shape import Shape


def camera(size=32, extent=2.5, seed=0):
    axes = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    return OrthographicCamera([0.1, -0.1, 0.05], axes, extent, size)


def cast_rays(shape, seen):
    """Depth of the first and last triangle on the ray of each pixel center, and doubtful pixels."""
    n = seen.size
    row, col = (g.ravel() + 0.5 for g in np.mgrid[:n, :n])
    right, up, forward = seen.axes
    origin = (
        seen.center
        + ((col - n / 2) * seen.pixel)[:, None] * right
        + ((n / 2 - row) * seen.pixel)[:, None] * up
    )
    a, b, c = (shape.points[shape.faces[:, j]] for j in range(3))
    cross = np.cross(forward, c - a)
    det = np.einsum("ij,ij->i", b - a, cross)
    away = origin[:, None] - a
    u = np.einsum("pij,ij->pi", away, cross) / det
    turned = np.cross(away, b - a)
    v = turned @ forward / det
    t = np.einsum("pij,ij->pi", turned, c - a) / det
    least = np.minimum(np.minimum(u, v), 1 - u - v)
    hit = least >= 0
    near = np.where(hit, t, np.inf).min(axis=1).reshape(n, n)
    far = np.where(hit, t, -np.inf).max(axis=1).reshape(n, n)
    doubt = (np.abs(least) < 1e-9).any(axis=1).reshape(n, n)  # on an edge: either is right
    return near, far, doubt


@pytest.mark.parametrize("seed", range(3))
def test_agrees_with_rays(seed):
    """Same pixels, same depth: float32 keeps 2^-24 of coordinates below 2."""
    shape = closed_forms.torus_mesh(24, 12)
    seen = camera(seed=seed)
    (view,) = medialis.rasterizer(shape)([seen])
    near, far, doubt = cast_rays(shape, seen)
    assert (view.mask == np.isfinite(near))[~doubt].all() and doubt.mean() < 0.01
    sure = np.isfinite(near) & ~doubt
    assert 0.2 < sure.mean() < 0.8
    assert np.allclose(view.near[sure], near[sure], rtol=0, atol=2e-7)
    assert np.allclose(view.far[sure], far[sure], rtol=0, atol=2e-7)


def test_large_triangles_and_pictures_smaller_than_the_shape():
    """Wide rows take another way through the kernel; parts outside the picture are cut off."""
    shape = closed_forms.cube()
    for extent in (5.0, 1.0):
        seen = camera(extent=extent)
        (view,) = medialis.rasterizer(shape)([seen])
        near, far, doubt = cast_rays(shape, seen)
        assert (view.mask == np.isfinite(near))[~doubt].all()
        sure = np.isfinite(near) & ~doubt
        assert np.allclose(view.near[sure], near[sure], rtol=0, atol=4e-7)
        assert np.allclose(view.far[sure], far[sure], rtol=0, atol=4e-7)


def test_same_on_one_and_two_threads():
    shape, cameras = closed_forms.torus_mesh(), [camera(seed=k) for k in range(3)]
    source = medialis.rasterizer(shape)
    both = []
    for threads in (1, 2):
        with medialis.thread_limit(threads):
            both.append(source(cameras))
    for one, two in zip(*both, strict=True):
        assert one.near.tobytes() == two.near.tobytes() and one.far.tobytes() == two.far.tobytes()


def test_cloud_looks_like_its_surface():
    """Discs of 4000 random samples of a sphere: no holes, silhouette and depth of the sphere.

    A disc reaches as far as the 12th neighbour; of 4000 samples on an area of 4 pi that is
    rho = sqrt(12 / 1000) = 0.11 on average, here up to 0.2. It leaves the sphere by rho^2/2 = 0.02
    at most, in depth near the middle and in the silhouette at the rim.
    """
    shape = closed_forms.sphere(4000, seed=0).shape
    seen = camera(size=64, extent=2.6)
    (view,) = medialis.rasterizer(shape)([seen])
    row, col = np.mgrid[:64, :64] + 0.5
    offset = np.einsum("i,ji->j", -seen.center, seen.axes)  # the sphere's middle
    x, y = (col - 32) * seen.pixel - offset[0], (32 - row) * seen.pixel - offset[1]
    away = np.hypot(x, y)
    assert view.mask[away < 0.98].all() and not view.mask[away > 1.02 + seen.pixel].any()
    middle = away < 0.5
    half = np.sqrt(1 - away[middle] ** 2)
    assert np.allclose(view.near[middle], offset[2] - half, rtol=0, atol=0.03)
    assert np.allclose(view.far[middle], offset[2] + half, rtol=0, atol=0.03)


def test_cloud_needs_normals():
    points = np.random.default_rng(0).normal(size=(50, 3))
    with pytest.raises(medialis.InvalidShapeError, match="samples with normals, got 0"):
        medialis.rasterizer(Shape(points, np.zeros((50, 3))))


@pytest.mark.parametrize(
    "change",
    [
        {"center": [0, 0]}, {"center": [0, 0, math.nan]}, {"axes": 2 * np.eye(3)},
        {"axes": np.eye(2)}, {"extent": 0}, {"size": 4}, {"size": 8.5}, {"extent": math.inf},
    ],
    ids=str,
)  # fmt: skip
def test_bad_cameras(change):
    good = {"center": [0, 0, 0], "axes": np.eye(3), "extent": 1.0, "size": 16}
    with pytest.raises(medialis.InvalidOptionError):
        OrthographicCamera(**{**good, **change})


def test_bad_views():
    seen = camera(size=8)
    flat = np.zeros((8, 8))
    holed = flat.copy()
    holed[2, 2] = np.nan
    for near, far, why in (
        (flat[:7], flat, "must be"),
        (flat, np.full((8, 8), "a"), "must be"),
        (flat, holed, "same pixels"),
        (flat, flat - 1, "nearer"),
    ):
        with pytest.raises(medialis.InvalidShapeError, match=why):
            View(seen, near, far)
