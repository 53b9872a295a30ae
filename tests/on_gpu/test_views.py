"""Curve skeletons from views on a GPU: the same bits as on the processor, by a fake driver."""

import numpy as np
import pytest

import closed_forms
import medialis
from medialis.base.device import use_device
from medialis.base.gpu import opened_gpu
from medialis.curves.from_views.on_gpu import silhouette_skeletons
from medialis.curves.from_views.views import Scratch, camera_pairs, runs_of, skeletonize
from on_gpu.driver import FakeDriver, install

SIZE = 40


@pytest.fixture
def driver(monkeypatch):
    """Let a fake driver be that of this process."""
    fake = FakeDriver()
    install(monkeypatch, fake)
    return fake


def bits(curve):
    """Return all that a curve skeleton from views holds, as bytes."""
    points = curve.view_points
    arrays = curve.nodes, curve.edges, curve.radii, points.points, points.weights
    return [array.tobytes() for array in arrays]


def masks():
    """Silhouettes: two components, a ring with a piece inside, single pixels, none, and blocks."""
    rng = np.random.default_rng(5)
    apart, ring, dots, nothing, blocks = np.zeros((5, SIZE, SIZE), bool)
    apart[3:20, 4:12] = apart[15:35, 16:37] = True
    ring[2:38, 2:38], ring[9:30, 9:33], ring[15:22, 14:27] = True, False, True
    dots[1:-1, 1:-1] = rng.random((SIZE - 2, SIZE - 2)) < 0.2
    for _ in range(12):
        row, column, height, width = rng.integers(1, SIZE // 2, 4)
        blocks[row : row + height, column : column + width] ^= True
    return [apart, ring, dots, nothing, blocks]


@pytest.mark.parametrize("room", [1 << 30, 1 << 18])
def test_silhouettes_have_the_same_crossings_and_distances(driver, room):
    """All at once, and as many as a small memory holds."""
    driver.room = room
    pictures = [np.where(mask, 0, np.nan).astype(np.float32) for mask in masks()]
    runs = [runs_of(near, Scratch(SIZE)).copy() for near in pictures]
    with opened_gpu().session(medialis.Progress()) as session:
        rows, distances = silhouette_skeletons(session, runs, SIZE, 1.0, True)
        outlines, nothing = silhouette_skeletons(session, runs, SIZE, 1.0, False)
    assert not driver.taken
    assert driver.calls["cuMemsetD8_v2"] == (2 if room == 1 << 30 else 10)
    for mask, some, row, distance, outline, none in zip(
        masks(), runs, rows, distances, outlines, nothing, strict=True
    ):
        field = np.zeros((SIZE, SIZE), np.float32)
        expected = skeletonize(some, 1.0, Scratch(SIZE), field)
        assert field[mask].tobytes() == distance.tobytes()
        for found in (row, outline):
            assert found.begin.tobytes() == expected.begin.tobytes()
            assert found.column.tobytes() == expected.column.tobytes()
        assert len(none) == 0
    assert sum(len(row.column) for row in rows) > 100
    assert min(distance.min(initial=0) for distance in distances) < -1  # beside the skeleton


def two_rings():
    """Return a torus and a smaller one away from it."""
    torus = closed_forms.torus_mesh()
    points = np.concatenate([torus.points, 0.5 * torus.points + 2.0])
    return medialis.make_shape(
        points, np.concatenate([torus.faces, torus.faces + torus.point_count])
    )


@pytest.mark.parametrize("make", [lambda: medialis.organic_shape(56), two_rings])
def test_same_bits_as_on_the_processor(driver, make):
    shape, options = make(), {"pairs": 6, "size": 64}
    with use_device("cpu"):
        expected = medialis.view_curve_skeleton(shape, **options)
    assert not driver.calls
    progress = medialis.Progress()
    with use_device("gpu"):
        found = medialis.view_curve_skeleton(shape, **options, progress=progress)
    assert driver.calls["cuLaunchKernel"] == 4 + 5 + 6  # of both views of all pairs, and sharpening
    assert not driver.taken and not progress.messages
    assert bits(found) == bits(expected)


@pytest.mark.parametrize("failed", [1, 7, 12])
def test_what_fails_is_done_by_the_processor(driver, failed):
    """At the first launch, at the second silhouettes, and while points are sharpened."""
    shape, options = medialis.organic_shape(56), {"pairs": 6, "size": 64}
    expected = medialis.view_curve_skeleton(shape, **options)
    driver.fails = "cuLaunchKernel", failed, 700
    progress = medialis.Progress()
    with use_device("gpu"):
        found = medialis.view_curve_skeleton(shape, **options, progress=progress)
    assert [message.code for message in progress.messages] == ["gpu_not_used"]
    assert bits(found) == bits(expected)


def test_views_of_others(driver):
    """Given views, and no memory for packed ones."""
    shape = medialis.organic_shape(56)
    center, radius = (shape.points.min(0) + shape.points.max(0)) / 2, shape.diagonal / 2
    cameras = camera_pairs(center, radius, pairs=4, angle=0.3, size=48)
    views = [tuple(medialis.rasterizer(shape)(pair)) for pair in cameras]
    with medialis.memory_limit(0), use_device("cpu"):
        expected = medialis.view_curve_skeleton(views)
    with medialis.memory_limit(0), use_device("gpu"):
        found = medialis.view_curve_skeleton(views)
    assert driver.calls["cuLaunchKernel"] == 13
    assert bits(found) == bits(expected)


def test_a_silhouette_at_the_border_is_an_error(driver):
    runs = np.array([[5, 0, 9]], np.int32)
    with (
        opened_gpu().session(medialis.Progress()) as session,
        pytest.raises(medialis.InvalidShapeError, match="border"),
    ):
        silhouette_skeletons(session, [runs], SIZE, 1.0, True)
