"""MedialCloud: aligned rows, selection, inverse feature transform."""

from dataclasses import fields

import numpy as np
import pytest

import closed_forms as forms
from medialis.balls.ball_shrinking import shrink_balls as surface_skeleton
from medialis.errors import InvalidShapeError
from medialis.model.medial_cloud import BallStatus, MedialCloud

NAMES = [field.name for field in fields(MedialCloud)]


def small(k=4):
    return {
        "centers": np.zeros((k, 3)),
        "radii": np.arange(k, dtype=float),
        "features": np.array([[0, 1], [1, 2], [2, -1], [3, 1]])[:k],
        "source": np.arange(k),
        "status": np.array([0, 0, 1, 0])[:k],
        "spoke_angles": np.ones(k),
        "side": np.ones(k),
    }


def test_types_and_read_only_arrays():
    cloud = MedialCloud(**small())
    assert len(cloud) == 4
    dtypes = [getattr(cloud, name).dtype for name in NAMES]
    assert dtypes == ["f8", "f8", "i4", "i4", "i1", "f8", "i1"]
    assert not any(getattr(cloud, name).flags.writeable for name in [*NAMES, "valid"])
    assert cloud.valid.tolist() == [True, True, False, True]


@pytest.mark.parametrize("name", NAMES)
def test_rows_that_do_not_match(name):
    arrays = small()
    arrays[name] = arrays[name][:-1]
    with pytest.raises(InvalidShapeError, match=r"must have shape"):
        MedialCloud(**arrays)
    arrays[name] = small()[name][:, None]
    with pytest.raises(InvalidShapeError, match=r"must have shape"):
        MedialCloud(**arrays)


@pytest.mark.parametrize("rows", [[2, 0], [], np.array([True, False, False, True]), [-1]])
def test_subset_keeps_all_arrays_aligned(rows):
    """An empty list of rows is an array of floats, and failed (fixed)."""
    cloud = MedialCloud(**small())
    part = cloud.subset(rows)
    expected = np.arange(4)[np.array(rows, int if isinstance(rows, list) else bool)]
    assert len(part) == len(expected)
    for name in NAMES:
        assert np.array_equal(getattr(part, name), getattr(cloud, name)[expected])


def test_empty_mask():
    assert len(MedialCloud(**small(0)).subset(np.empty(0, bool))) == 0


def test_inverse_features():
    """Sample 1 is touched by the balls 0, 1 and 3; the masked ball 2 counts for nobody."""
    rows = MedialCloud(**small()).inverse_features(5)
    assert [row.tolist() for row in rows] == [[0], [0, 1, 3], [1], [3], []]


def test_inverse_features_invert_the_features():
    cloud = surface_skeleton(forms.capsule(500).shape, side="both")
    n = 750
    rows = cloud.inverse_features
    assert rows.lengths.sum() == 2 * cloud.valid.sum()
    for sample in range(n):
        assert ((cloud.features[rows[sample]] == sample).sum(axis=1) == 1).all()


def test_inverse_features_of_too_few_samples():
    with pytest.raises(InvalidShapeError):
        MedialCloud(**small()).inverse_features(2)


def test_statuses_are_stored_numbers():
    assert [status.value for status in BallStatus] == [0, 1, 2]
