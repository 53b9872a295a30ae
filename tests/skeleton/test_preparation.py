"""What comes before all balls: which meshes are refined."""

import numpy as np
import pytest

import closed_forms as forms
import medialis
from medialis.skeleton.surface_skeleton import TOO_LONG_SHARE, auto_longest_edge


@pytest.fixture(scope="module")
def shape():
    return medialis.organic_shape(56)


def longest_sides(shape):
    corners = shape.points[shape.faces]
    return np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).max(axis=1)


def share_above(shape, length):
    """Share of the area that has faces with a side longer than this."""
    return shape.face_areas[longest_sides(shape) > length].sum() / shape.area


def samples(shape, length):
    """Samples of the surface that is computed on when edges above a length are split."""
    return medialis.surface_skeleton(shape, refine=length / shape.diagonal).surface.point_count


def chosen(shape, length):
    """Longest edge that "auto" takes, starting from a length."""
    return auto_longest_edge(shape, length / shape.diagonal) * shape.diagonal


def test_a_dense_mesh_with_a_few_longer_edges_keeps_its_samples(shape):
    """A mesh of 194,000 vertices was refined to 194,252, and every ball computed a second time."""
    falling = np.argsort(-longest_sides(shape))
    sides = longest_sides(shape)[falling]
    share = np.cumsum(shape.face_areas[falling]) / shape.area
    below = sides[np.searchsorted(share, TOO_LONG_SHARE)]
    above = sides[np.searchsorted(share, 1.1 * TOO_LONG_SHARE) + 1]
    assert 0 < share_above(shape, below) <= TOO_LONG_SHARE < share_above(shape, above)
    assert sides[0] < 2 * above  # none is twice as long
    assert chosen(shape, below) == pytest.approx(sides[0], rel=1e-9)
    assert chosen(shape, above) == pytest.approx(above, rel=1e-9)
    assert samples(shape, below) > shape.point_count  # where it was typed
    assert samples(shape, above) > shape.point_count
    assert samples(shape, sides[0] * (1 + 1e-9)) == shape.point_count


def test_a_single_edge_of_twice_the_length_is_split():
    """A dense mesh with one large flat face: it would have no samples in the middle."""
    fine = forms.icosphere(4)
    length = fine.edge_lengths.max()
    big = 1.1 * np.array([[0, 0, 0], [2, 0, 0], [1, 0.02, 0]]) * length + [0, 0, 2]
    points = np.concatenate([fine.points, big])
    n = fine.point_count
    shape = medialis.make_shape(points, np.concatenate([fine.faces, [[n, n + 1, n + 2]]]))
    assert share_above(shape, length) < TOO_LONG_SHARE
    assert samples(shape, length) > shape.point_count


def test_a_mesh_without_an_edge_above_is_computed_on_as_it_is(shape):
    assert medialis.surface_skeleton(shape, refine=0.0).surface is shape
    assert medialis.surface_skeleton(shape, refine=0.5).surface is shape
