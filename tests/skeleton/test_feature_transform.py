"""Feature transform, its inverse, and fields either way, against loops over the inverse."""

import numpy as np
import pytest

import closed_forms as forms
from medialis.base.errors import InvalidOptionError, InvalidShapeError
from medialis.shape.shape import Shape
from medialis.skeleton.medial_cloud import BallStatus, MedialCloud, shrink_balls
from medialis.walls.thickness import feature_transform, field_on_skeleton, field_on_surface

REDUCE = {"min": np.nanmin, "max": np.nanmax, "mean": np.nanmean}


def balls(features, count, status=None):
    """Balls that touch some of `count` samples."""
    k = len(features)
    status = np.zeros(k) if status is None else status
    features = np.asarray(features).reshape(k, 2)
    points = np.eye(count, 3)
    return MedialCloud(
        np.zeros((k, 3)), np.ones(k), features, features[:, 0], status, np.ones(k), np.ones(k),
        surface=Shape(points, points),
    )  # fmt: skip


@pytest.fixture(scope="module")
def open_shape():
    """Half an icosphere: some balls are masked."""
    whole = forms.icosphere(3)
    faces = whole.faces[whole.points[whole.faces][:, :, 2].mean(axis=1) > -0.3]
    return forms.mesh(*_compact(whole.points, faces))


def _compact(points, faces):
    used, renamed = np.unique(faces, return_inverse=True)
    return points[used], renamed.reshape(-1, 3)


def test_transform_and_inverse_name_the_same_pairs(open_shape):
    cloud = shrink_balls(open_shape, side="both")
    assert (~cloud.valid).any()
    features = feature_transform(cloud)
    assert features.dtype == np.int32 and (features[~cloud.valid] == -1).all()
    assert (features[cloud.valid] == cloud.features[cloud.valid]).all()
    inverse = cloud.inverse_features
    pairs = {(s, b) for s, row in enumerate(inverse) for b in row.tolist()}
    assert pairs == {(s, b) for b in np.flatnonzero(cloud.valid) for s in features[b].tolist()}


@pytest.mark.parametrize("reduce", REDUCE)
def test_fields_agree_with_loops(open_shape, reduce):
    """Bitwise for min and max; a mean of m values may differ by the order of the sum, m eps."""
    cloud = shrink_balls(open_shape, side="both")
    rng = np.random.default_rng(0)
    values = np.where(rng.random(len(cloud)) < 0.2, np.nan, rng.normal(size=len(cloud)))
    n = open_shape.point_count
    field = field_on_surface(cloud, values, reduce=reduce)
    inverse = cloud.inverse_features
    for sample in range(n):
        mine = values[inverse[sample]]
        expected = np.nan if np.isnan(mine).all() else REDUCE[reduce](mine)
        bound = 0 if reduce != "mean" else (len(mine) + 1) * 2.3e-16 * np.nansum(np.abs(mine))
        assert (np.isnan(expected) and np.isnan(field[sample])) or (
            abs(field[sample] - expected) <= bound
        )
    samples = np.where(rng.random(n) < 0.5, np.nan, rng.normal(size=n))
    back = field_on_skeleton(cloud, samples, reduce=reduce)
    for ball, pair in enumerate(feature_transform(cloud)):
        mine = samples[pair] if pair[0] >= 0 else np.array([np.nan])
        expected = np.nan if np.isnan(mine).all() else REDUCE[reduce](mine)
        assert np.isclose(back[ball], expected, rtol=1e-15, atol=1e-16, equal_nan=True)


def test_masked_balls_and_extreme_values():
    cloud = balls([[0, 1], [1, 2], [2, -1]], 4, [BallStatus.OK, BallStatus.OK, BallStatus.OPEN])
    assert field_on_surface(cloud, [1.0, 3.0, 9.0], reduce="max").tolist()[:3] == [1, 3, 3]
    assert np.isnan(field_on_surface(cloud, [1.0, 3.0, 9.0])[3])
    lowest = field_on_surface(cloud, [np.inf, -np.inf, 0], reduce="min")
    assert lowest.tolist()[:3] == [np.inf, -np.inf, -np.inf]
    huge = field_on_skeleton(cloud, [1.7e308, 1.7e308, 5.0, 0.0])
    assert huge[0] == 1.7e308 and np.isnan(huge[2])
    assert field_on_surface(cloud.subset([]), []).shape == (4,)
    assert field_on_skeleton(cloud.subset([]), np.zeros(4)).shape == (0,)


def test_inputs_stay_and_results_do_not_depend_on_the_order_of_balls(open_shape):
    cloud = shrink_balls(open_shape)
    values = np.random.default_rng(1).normal(size=len(cloud))
    before = values.copy()
    turn = np.random.default_rng(2).permutation(len(cloud))
    for reduce in ("min", "max"):
        one = field_on_surface(cloud, values, reduce=reduce)
        other = field_on_surface(cloud.subset(turn), values[turn], reduce=reduce)
        assert one.tobytes() == other.tobytes()
    assert (values == before).all()


def test_bad_input():
    cloud = balls([[0, 1], [1, 2]], 3)
    with pytest.raises(InvalidShapeError, match=r"values must be a \(2,\)"):
        field_on_surface(cloud, [1.0])
    with pytest.raises(InvalidShapeError, match=r"field must be a \(3,\)"):
        field_on_skeleton(cloud, [1.0, 2.0])
    with pytest.raises(InvalidShapeError, match="field must be"):
        field_on_skeleton(cloud, np.ones((3, 2)))
    with pytest.raises(InvalidShapeError, match="values"):
        field_on_surface(cloud, ["a", "b"])
    with pytest.raises(InvalidOptionError, match="reduce must be one of min, max, mean"):
        field_on_surface(cloud, [1.0, 2.0], reduce="sum")
    with pytest.raises(InvalidOptionError, match="reduce"):
        field_on_skeleton(cloud, [1.0, 2.0, 3.0], reduce="sum")
