"""Cameras: projection, framing, turntables, the automatic view."""

import math

import numpy as np
import pytest

from medialis.base.errors import InvalidOptionError, InvalidShapeError
from medialis.show.camera import Camera, default_view, turntable
from medialis.show.raster import rasterize


def test_projection_of_known_points():
    camera = Camera([0, 0, 4], [0, 0, 0], [0, 1, 0], 2.0, 100, 100, perspective=True)
    pixels, depth = camera.project([[1, 0, 0], [1, 0, 2], [0, 0, 5]])
    np.testing.assert_allclose(pixels[0], [100, 50])
    np.testing.assert_allclose(pixels[1], [150, 50])  # half as far: twice as large
    assert np.isnan(pixels[2]).all()  # behind the eye
    np.testing.assert_allclose(depth, [4, 2, -1])


def test_axes_are_orthonormal_and_up_is_up():
    camera = Camera([3, 2, 1], [0, 0, 0], [0, 0, 1], 2.0)
    np.testing.assert_allclose(camera.axes @ camera.axes.T, np.eye(3), atol=1e-14)
    assert camera.axes[1] @ [0, 0, 1] > 0
    np.testing.assert_allclose(np.cross(camera.axes[0], camera.axes[1]), -camera.axes[2])


@pytest.mark.parametrize("perspective", [False, True])
@pytest.mark.parametrize("size", [(200, 150), (90, 300), (300, 40)])
def test_framing_is_tight_and_clips_nothing(perspective, size):
    rng = np.random.default_rng(0)
    points = rng.normal(size=(200, 3)) * [3, 1, 0.5] + [100, -20, 7]
    camera = Camera.framing(
        points, width=size[0], height=size[1], margin=0.1, perspective=perspective
    )
    pixels, _ = camera.project(points)
    share = (pixels / size).ravel()
    assert share.min() > 0.1 - 1e-9
    assert share.max() < 0.9 + 1e-9
    low, high = (pixels / size).min(axis=0), (pixels / size).max(axis=0)
    # In one direction it fills the picture, and there it is centered.
    filled = np.argmax(high - low)
    np.testing.assert_allclose([low[filled], high[filled]], [0.1, 0.9], atol=1e-6)


@pytest.mark.parametrize("perspective", [False, True])
def test_framing_shows_the_whole_ball_round_the_box(perspective):
    corners = np.array([[-1.0, -2.0, -3.0], [2.0, 1.0, 0.5]])
    camera = Camera.framing(
        corners, fit="sphere", width=160, height=120, margin=0.03, perspective=perspective
    )
    radius = np.linalg.norm(np.diff(corners, axis=0)) / 2
    mask = rasterize(camera, centers=[corners.mean(axis=0)], radii=[radius]).mask
    assert not (mask[0].any() or mask[-1].any() or mask[:, 0].any() or mask[:, -1].any())
    assert mask[6:-6].any(axis=1).all() or mask[:, 8:-8].any(axis=0).all()


@pytest.mark.parametrize("perspective", [False, True])
@pytest.mark.parametrize("fit", ["turntable", "sphere"])
def test_a_turntable_keeps_all_in_view(perspective, fit):
    rng = np.random.default_rng(2)
    points = rng.normal(size=(100, 3)) * [5, 1, 1]
    first = Camera.framing(points, fit=fit, perspective=perspective, margin=0)
    cameras = turntable(first, 7)
    assert len(cameras) == 7
    np.testing.assert_allclose(cameras[0].eye, first.eye, atol=1e-12)
    for camera in cameras:
        pixels, _ = camera.project(points)
        assert (pixels > 0).all()
        assert (pixels < [camera.width, camera.height]).all()
        assert math.isclose(camera.distance, first.distance)
        assert math.isclose(
            (camera.eye - camera.target) @ camera.up,
            (first.eye - first.target) @ first.up,
            abs_tol=1e-9,
        )


def test_a_turntable_frame_is_tighter_than_a_sphere():
    rng = np.random.default_rng(2)
    flat = rng.normal(size=(300, 3)) * [3, 0.2, 3]
    table = Camera.framing(flat, up=[0, 1, 0], direction=[0, 0.3, 1], fit="turntable", width=1500)
    sphere = Camera.framing(flat, up=[0, 1, 0], direction=[0, 0.3, 1], fit="sphere", width=1500)
    assert table.extent < 0.6 * sphere.extent
    spread = np.stack([camera.project(flat)[0] for camera in turntable(table, 12)])
    assert spread[..., 0].max() > 0.93 * 1500
    assert spread[..., 0].min() < 0.07 * 1500


@pytest.mark.parametrize(
    "points", [[[1, 2, 3]], [[0, 0, 0], [0, 0, 0]], [[1e9, 0, 0]], [[0, 0, 0], [0, 5, 0]]]
)
def test_framing_of_points_without_extent(points):
    for perspective in (False, True):
        camera = Camera.framing(points, perspective=perspective)
        pixels, _ = camera.project(points)
        assert (pixels >= 0).all()
        assert (pixels <= [1000, 750]).all()


def test_framing_straight_along_up():
    camera = Camera.framing([[0, 0, 0], [1, 1, 1]], direction=[0, 1, 0], up=[0, 1, 0])
    np.testing.assert_allclose(camera.axes[2], [0, -1, 0], atol=1e-12)


def test_default_view_faces_the_thin_side():
    rng = np.random.default_rng(3)
    box = rng.uniform(-1, 1, (500, 3))
    for thin, up in ((0, 1), (1, 2), (2, 1)):
        scale = np.full(3, 1.0)
        scale[thin] = 0.1
        direction, upward = default_view(box * scale)
        assert abs(direction[thin]) > 0.7
        assert upward[up] == 1
        assert direction @ upward > 0.3  # from above
    ball = rng.normal(size=(500, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    assert default_view(ball)[1].tolist() == [0, 1, 0]


def test_default_view_finds_the_axis_that_an_animal_stands_on():
    """The first automatic view of a horse that walks along y and stands along z lay on its side."""
    rng = np.random.default_rng(4)
    body = rng.normal(size=(400, 3))
    body = body / np.linalg.norm(body, axis=1, keepdims=True) * [0.3, 1, 0.35] + [0, 0, 1]
    legs = [
        rng.uniform([x, y, 0], [x + 0.1, y + 0.1, 1], (100, 3))
        for x in (-0.25, 0.15)
        for y in (-0.7, 0.6)
    ]
    animal = np.concatenate([body, *legs])
    assert default_view(animal)[1].tolist() == [0, 0, 1]
    assert default_view(animal[:, [0, 2, 1]])[1].tolist() == [0, 1, 0]
    assert default_view(animal[:, [1, 0, 2]])[1].tolist() == [0, 0, 1]
    assert default_view(animal[:, [1, 2, 0]])[1].tolist() == [0, 1, 0]


def test_bad_options_are_one_sentence():
    good = {"eye": [0, 0, 5], "target": [0, 0, 0], "up": [0, 1, 0], "extent": 1.0}
    for bad in (
        {"width": 0}, {"width": 16385}, {"height": 2.5}, {"height": True}, {"extent": 0},
        {"extent": np.nan}, {"eye": [0, 0, 0]}, {"eye": [0, 0]}, {"eye": [0, 0, np.inf]},
        {"up": [0, 0, 1]}, {"up": [0, 0, 0]},
    ):  # fmt: skip
        with pytest.raises(InvalidOptionError):
            Camera(**(good | bad))
    with pytest.raises(InvalidOptionError, match="width"):
        Camera.framing([[0, 0, 0]], width=0)
    with pytest.raises(InvalidOptionError, match="margin"):
        Camera.framing([[0, 0, 0]], margin=0.5)
    with pytest.raises(InvalidOptionError, match="fit"):
        Camera.framing([[0, 0, 0]], fit="loose")
    with pytest.raises(InvalidShapeError):
        Camera.framing([[0, 0, np.nan]])
    with pytest.raises(InvalidOptionError, match="count"):
        turntable(Camera(**good), 0)
