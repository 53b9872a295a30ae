"""Uniform subsampling: apart, covering, greedy in the stated order."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import closed_forms as forms
from medialis.base.errors import InvalidOptionError, InvalidShapeError
from medialis.shape.shape import Shape
from medialis.skeleton.medial_cloud import BallStatus, MedialCloud, shrink_balls
from medialis.skeleton.surface_skeleton import uniform_subsample
from oracles import greedy_subsample


def cloud_at(centers, status=None, angles=None):
    """Balls on a surface with the diagonal 1, so that fractions of it are lengths."""
    k = len(centers)
    points = np.zeros((max(k, 2), 3))
    points[1, 0] = 1.0
    return MedialCloud(
        centers=np.asarray(centers, float),
        radii=np.ones(k),
        features=np.stack([np.arange(k), np.arange(k)], axis=1),
        source=np.arange(k),
        status=np.zeros(k) if status is None else status,
        spoke_angles=np.ones(k) if angles is None else angles,
        side=np.ones(k),
        surface=Shape(points, points),
    )


def as_one_expects(cloud, distance, priority):
    rows = np.flatnonzero(cloud.valid)
    mask = np.zeros(len(cloud), bool)
    mask[rows] = greedy_subsample(cloud.centers[rows], np.asarray(priority)[rows], distance)
    return mask


@pytest.mark.slow
@settings(max_examples=150, deadline=None, derandomize=True)
@given(
    k=st.integers(1, 120),
    kind=st.sampled_from(["gauss", "grid", "line", "duplicates", "far"]),
    distance=st.sampled_from([1e-9, 1e-4, 0.03, 0.5, 1.0, 3.0, 1e9]),
    ties=st.booleans(),
    masked=st.booleans(),
    seed=st.integers(0, 2**32 - 1),
)
def test_selection_is_the_greedy_one(k, kind, distance, ties, masked, seed):
    rng = np.random.default_rng(seed)
    centers = rng.normal(size=(k, 3))
    if kind == "grid":  # multiples of 1/4: distances of exactly 0.5 and 1.0 are kept
        centers = rng.integers(-4, 5, size=(k, 3)) / 4
    elif kind == "line":
        centers[:, 1:] = 0
    elif kind == "duplicates":
        centers = centers[rng.integers(0, max(k // 3, 1), k)]
    elif kind == "far":
        centers = centers * [1, 1, 0] + [1e6, -1e6, 0]
    status = rng.integers(0, 3, k) if masked else np.zeros(k, int)
    priority = rng.integers(0, 3, k).astype(float) if ties else rng.normal(size=k)
    cloud = cloud_at(centers, status)
    before = centers.copy()
    mask = uniform_subsample(cloud, distance, priority=priority)
    assert mask.dtype == bool and mask.shape == (k,)
    assert not mask[~cloud.valid].any()
    # On the grid all squares are exact, so a distance of exactly `distance` is no trap.
    assert (mask == as_one_expects(cloud, distance, priority)).all()
    assert (centers == before).all()


def test_points_are_apart_and_cover_all_others():
    cloud = shrink_balls(forms.ellipsoid(3000, mirrored=False).shape, side="both")
    distance = 0.05
    mask = uniform_subsample(cloud, distance / cloud.surface.diagonal)
    kept = cloud.centers[mask]
    gaps = np.linalg.norm(kept[:, None] - kept[None], axis=2)
    gaps[np.diag_indices(len(kept))] = np.inf
    assert gaps.min() >= distance * (1 - 1e-15)
    valid = cloud.centers[cloud.valid]
    nearest = np.linalg.norm(valid[:, None] - kept[None], axis=2).min(axis=1)
    assert nearest.max() < distance
    assert not mask[~cloud.valid].any()
    # The axis is an ellipse of about pi 0.75 0.55 = 1.3; discs of half the distance do not overlap.
    assert 50 < mask.sum() < 1.3 / (math.pi * (distance / 2) ** 2)


def test_larger_priority_wins_and_the_lowest_index_breaks_ties():
    cloud = cloud_at([[0, 0, 0], [0.6, 0, 0], [1.2, 0, 0]])
    assert uniform_subsample(cloud, 1.0).tolist() == [True, False, True]
    assert uniform_subsample(cloud, 1.0, priority=[0, 5, 1]).tolist() == [False, True, False]
    assert uniform_subsample(cloud, 1.0, priority=[0, 1, 1]).tolist() == [False, True, False]
    assert uniform_subsample(cloud, 1.0, priority=[math.nan, 0, 0]).tolist() == [False, True, False]
    assert uniform_subsample(cloud, 1.0, priority=[-math.inf, 0, math.inf]).tolist() == [
        True,
        False,
        True,
    ]


def test_default_priority_is_the_spoke_angle():
    cloud = cloud_at([[0, 0, 0], [0.5, 0, 0]], angles=[1.0, 2.0])
    assert uniform_subsample(cloud, 1.0).tolist() == [False, True]


def test_zero_distance_selects_every_valid_point():
    cloud = cloud_at(np.zeros((4, 3)), status=[0, 0, 1, 2])
    assert uniform_subsample(cloud, 0.0).tolist() == [True, True, False, False]


def test_tiny_distance_removes_only_coinciding_points():
    centers = np.random.default_rng(0).normal(size=(500, 3))
    centers[100] = centers[3]
    mask = uniform_subsample(cloud_at(centers), 1e-9)
    assert np.flatnonzero(~mask).tolist() == [100]


def test_huge_distance_keeps_one_point():
    centers = np.random.default_rng(0).normal(size=(500, 3))
    for distance in (1e3, 1e150, 1e300):
        mask = uniform_subsample(cloud_at(centers), distance)
        assert np.flatnonzero(mask).tolist() == [0]


def test_nothing_valid_selects_nothing():
    cloud = cloud_at(np.full((3, 3), np.nan), status=[BallStatus.NO_NORMAL] * 3)
    assert not uniform_subsample(cloud, 1.0).any()


def test_masked_points_neither_survive_nor_remove_others():
    cloud = cloud_at([[0, 0, 0], [0.1, 0, 0]], status=[BallStatus.OPEN, BallStatus.OK])
    assert uniform_subsample(cloud, 1.0, priority=[9, 0]).tolist() == [False, True]


@pytest.mark.parametrize("distance", [-1e-9, math.nan, math.inf, "0.1", None])
def test_bad_distance(distance):
    with pytest.raises(InvalidOptionError, match="distance"):
        uniform_subsample(cloud_at(np.zeros((2, 3))), distance)


@pytest.mark.parametrize("priority", [[1.0], np.ones((2, 1)), ["a", "b"]])
def test_bad_priority(priority):
    with pytest.raises(InvalidShapeError, match="priority"):
        uniform_subsample(cloud_at(np.zeros((2, 3))), 1.0, priority=priority)
