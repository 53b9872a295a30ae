"""MedialCloud: aligned rows, selection, inverse feature transform."""

import numpy as np
import pytest

import closed_forms as forms
from medialis.base.errors import InvalidShapeError
from medialis.shape.shape import Shape
from medialis.skeleton.medial_cloud import COLUMNS, BallStatus, MedialCloud, shrink_balls


def surface(n):
    return Shape(np.eye(n, 3), np.eye(n, 3))


def small(k=4):
    return {
        "centers": np.zeros((k, 3)),
        "radii": np.arange(k, dtype=float),
        "features": np.array([[0, 1], [1, 2], [2, -1], [3, 1]])[:k],
        "source": np.arange(k),
        "status": np.array([0, 0, 1, 0])[:k],
        "spoke_angles": np.ones(k),
        "side": np.ones(k),
        "contact_faces": np.full(k, -1),
        "contact_weights": np.zeros((k, 3)),
        "surface": surface(5),
    }


def test_types_and_read_only_arrays():
    cloud = MedialCloud(**small())
    assert len(cloud) == 4
    dtypes = [getattr(cloud, name).dtype for name in COLUMNS]
    assert dtypes == ["f8", "f8", "i4", "i4", "i1", "f8", "i1", "i4", "f8"]
    assert not any(getattr(cloud, name).flags.writeable for name in [*COLUMNS, "valid"])
    assert cloud.valid.tolist() == [True, True, False, True]


@pytest.mark.parametrize("name", COLUMNS)
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
    for name in COLUMNS:
        assert np.array_equal(getattr(part, name), getattr(cloud, name)[expected])


def test_empty_mask():
    assert len(MedialCloud(**small(0)).subset(np.empty(0, bool))) == 0


def test_inverse_features():
    """Sample 1 is touched by the balls 0, 1 and 3; the masked ball 2 counts for nobody."""
    rows = MedialCloud(**small()).inverse_features
    assert [row.tolist() for row in rows] == [[0], [0, 1, 3], [1], [3], []]


def test_inverse_features_invert_the_features():
    cloud = shrink_balls(forms.capsule(500).shape, side="both")
    n = 750
    rows = cloud.inverse_features
    assert rows.lengths.sum() == 2 * cloud.valid.sum()
    for sample in range(n):
        assert ((cloud.features[rows[sample]] == sample).sum(axis=1) == 1).all()


def test_a_surface_without_the_samples_that_are_touched():
    with pytest.raises(InvalidShapeError, match="touch sample 3, but the surface has 3"):
        MedialCloud(**{**small(), "surface": surface(3)})


def test_only_all_inner_balls_in_their_order_are_whole():
    shape = forms.icosphere(1)
    cloud, both = shrink_balls(shape), shrink_balls(shape, side="both")
    assert cloud.whole and both.subset(both.side > 0).whole
    assert not both.whole and not both.subset(both.side < 0).whole
    assert not cloud.subset(np.arange(5)).whole and not cloud.subset(np.arange(42)[::-1]).whole


def test_statuses_are_stored_numbers():
    assert [status.value for status in BallStatus] == [0, 1, 2]


def test_balls_of_a_least_wall_angle_are_those_of_all_wall_angles():
    """They are found where the spoke angle is large enough alone, or among angles known."""
    cloud = shrink_balls(forms.ellipsoid(800, (3.0, 2.0, 1.0)).shape)
    rows = np.flatnonzero(cloud.valid)[::2]
    first = cloud.with_wall_angle(rows, 2.0)
    assert 0 < len(first) < len(rows)
    assert (first == rows[cloud.wall_angles[rows] >= 2.0]).all()
    assert (cloud.with_wall_angle(rows, 2.0) == first).all()
