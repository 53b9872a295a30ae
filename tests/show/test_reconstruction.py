"""The union of medial balls against the surface: a sphere, a capsule, a point cloud."""

import numpy as np
import pytest

from medialis.base.errors import Cancelled, InvalidOptionError, InvalidShapeError
from medialis.shape.shape import Shape
from medialis.show.camera import Camera
from medialis.show.reconstruction import inner_balls, progressive, reconstruct_image
from medialis.skeleton.medial_cloud import BallStatus, MedialCloud


def capsule(around=64, along=40, faces=True):
    """A capsule of radius 1 round the segment from (-1, 0, 0) to (1, 0, 0), finely meshed."""
    bend = np.linspace(0, np.pi / 2, along)[1:]
    x = np.concatenate([-1 - np.cos(bend), np.linspace(-1, 1, along)[1:-1], 1 + np.cos(bend[::-1])])
    width = np.concatenate([np.sin(bend), np.ones(along - 2), np.sin(bend[::-1])])
    angle = 2 * np.pi * np.arange(around) / around
    rings = np.stack(
        [
            np.broadcast_to(x[:, None], (len(x), around)),
            width[:, None] * np.cos(angle),
            width[:, None] * np.sin(angle),
        ],
        axis=-1,
    ).reshape(-1, 3)
    points = np.concatenate([rings, [[-2, 0, 0], [2, 0, 0]]])
    centers = np.stack([np.clip(points[:, 0], -1, 1), *np.zeros((2, len(points)))], axis=1)
    a = np.arange((len(x) - 1) * around)
    b = a // around * around + (a + 1) % around
    last = (len(x) - 1) * around
    i, j = np.arange(around), (np.arange(around) + 1) % around
    tips = np.full(around, len(points) - 2)
    triangles = np.concatenate(
        [
            np.stack([a, b, a + around], 1),
            np.stack([b, b + around, a + around], 1),
            np.stack([i, tips, j], 1),
            np.stack([last + i, last + j, tips + 1], 1),
        ]
    )
    shape = Shape(points, points - centers, triangles if faces else None)
    return cloud_of(shape, centers, np.ones(len(points)))


def cloud_of(surface, centers, radii, side=None, status=None):
    k = len(radii)
    index = np.arange(k) % surface.point_count
    return MedialCloud(
        centers,
        radii,
        np.stack([index, index], 1),
        index,
        np.zeros(k) if status is None else status,
        np.zeros(k),
        np.ones(k) if side is None else side,
        surface=surface,
    )


def look(**options):
    return Camera.framing([[-2, -1, -1], [2, 1, 1]], width=240, height=160, **options)


@pytest.mark.slow
@pytest.mark.parametrize("perspective", [False, True])
def test_balls_of_a_capsule_reproduce_it(perspective):
    cloud = capsule()
    result = reconstruct_image(cloud, look(perspective=perspective))
    # Chords of the 64-gon lie 1 - cos(pi / 64) = 0.0012 below the ball: 0.025 % of the diagonal
    # 4.9; the balls, 0.05 apart, lie 0.0003 below the cylinder.
    assert result.median_difference < 0.03
    # At a grazing ray the difference grows, by 1 / cos: 95 % of a disc has cos > 0.22.
    assert result.difference_95 < 0.025 / 0.2
    # The outline is 0.0012 off, a twentieth of a pixel: of 640 pixels at the rim about 30 change.
    assert result.only_one_share < 0.01
    assert result.ball_count == cloud.surface.point_count
    for image in (
        *result.ball_images,
        *result.surface_images,
        *result.difference_images,
    ):
        assert image.shape == (160, 240, 3)


@pytest.mark.slow
def test_numbers_do_not_change_when_all_is_turned_moved_and_scaled():
    cloud = capsule(32, 12)
    shape = cloud.surface
    turn, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))
    turn *= np.linalg.det(turn)
    camera = look(direction=[1, 1, 3], up=[0, 1, 0])

    def moved(points):
        return 7 * np.asarray(points) @ turn.T + [10, 20, 30]

    first = reconstruct_image(cloud, camera)
    moved_shape = Shape(moved(shape.points), shape.normals @ turn.T, shape.faces)
    second = reconstruct_image(
        cloud_of(moved_shape, moved(cloud.centers), 7 * cloud.radii),
        Camera(moved(camera.eye), moved(camera.target), turn @ camera.up, 7 * camera.extent,
               camera.width, camera.height),
    )  # fmt: skip
    # The bounding-box diagonal depends on the rotation; the depths in units do not.
    ratio = shape.diagonal * 7 / moved_shape.diagonal
    assert abs(first.median_difference * ratio / second.median_difference - 1) < 0.01
    assert abs(first.only_one_share - second.only_one_share) < 1e-3


@pytest.mark.slow
def test_several_views_count_together():
    cloud = capsule(32, 12)
    views = [look(), look(direction=[0, 0, 1], up=[0, 1, 0])]
    single = [reconstruct_image(cloud, view).only_one_share for view in views]
    both = reconstruct_image(cloud, views)
    assert min(single) <= both.only_one_share <= max(single)
    assert len(both.ball_images) == 2


@pytest.mark.slow
def test_a_point_cloud_is_compared_with_its_samples():
    cloud = capsule(faces=False)
    assert cloud.surface.faces is None
    result = reconstruct_image(cloud, look())
    # Discs of 1.5 spacings (up to 0.1) on a unit cylinder stand off by up to 0.1^2 / 2 = 0.005
    # of the radius: 0.1 % of the diagonal; at the outline they stick out by that much.
    assert result.median_difference < 0.1
    assert result.only_one_share < 0.03


def test_only_maximal_inner_balls_are_drawn():
    cloud = capsule(24, 8)
    k = len(cloud)
    centers = np.concatenate([cloud.centers, [[0, 0, 0], [0, 0, 0], [np.nan] * 3]])
    radii = np.concatenate([cloud.radii, [50.0, 50.0, np.nan]])
    side = np.r_[np.ones(k), -1, 1, 1]
    status = np.r_[np.zeros(k), 0, BallStatus.OPEN, BallStatus.NO_NORMAL]
    mixed = cloud_of(cloud.surface, centers, radii, side, status)
    assert inner_balls(mixed).tolist() == list(range(k))
    one, two = (reconstruct_image(balls, look()) for balls in (cloud, mixed))
    np.testing.assert_array_equal(one.ball_images[0], two.ball_images[0])
    assert one.only_one_share == two.only_one_share


@pytest.mark.slow
def test_progressive_covers_more_with_more_balls():
    cloud = capsule(32, 20)
    order = -np.abs(cloud.centers[:, 0])
    order[5] = np.nan
    steps = progressive(cloud, order, (0.0001, 0.1, 0.5, 1.0), look())
    counts = [step.ball_count for step in steps]
    assert counts == [1, *(round(share * len(cloud)) for share in (0.1, 0.5)), len(cloud)]
    missed = [step.only_one_share for step in steps]
    assert missed == sorted(missed, reverse=True)
    assert missed[-1] < 0.02
    assert missed[0] > 0.3


def test_progress_never_goes_back():
    cloud = capsule(16, 6)
    fractions: list[float] = []
    progressive(cloud, camera=look(), progress=lambda fraction, text: fractions.append(fraction))
    # Up to the rounding of nested spans.
    assert np.diff(fractions).min() > -1e-12
    assert fractions[0] == 0
    assert abs(fractions[-1] - 1) < 1e-12


def test_bad_input_is_one_sentence():
    cloud = capsule(8, 4)
    none = cloud_of(cloud.surface, cloud.centers, cloud.radii, status=np.ones(len(cloud)))
    with pytest.raises(InvalidShapeError, match="nothing to draw"):
        reconstruct_image(none)
    with pytest.raises(InvalidOptionError, match="at least one"):
        reconstruct_image(cloud, [])
    with pytest.raises(InvalidOptionError, match="shares"):
        progressive(cloud, shares=(0.0,))
    with pytest.raises(InvalidShapeError, match="order"):
        progressive(cloud, [1.0, 2.0])
    with pytest.raises(Cancelled):
        reconstruct_image(cloud, look(), progress=lambda fraction, text: False)
