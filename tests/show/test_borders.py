"""Borders between colours: where they run, what they keep, and that nothing is torn."""

import numpy as np
import pytest

from medialis.show.borders import cut_at_levels, cut_by_labels
from medialis.show.colors import NEAR_LIMIT, limit_colors


def grid(count, seed=0):
    """A flat sheet of triangles over 0..1, its inner points shaken."""
    x, y = (c.ravel() for c in np.meshgrid(*[np.linspace(0, 1, count)] * 2, indexing="ij"))
    points = np.stack([x, y, 0 * x], axis=1)
    inner = (x > 0) & (x < 1) & (y > 0) & (y < 1)
    shake = np.random.default_rng(seed).uniform(-0.3, 0.3, (count * count, 2)) / count
    points[inner, :2] += shake[inner]
    a = np.arange(count * count).reshape(count, count)
    low, right, up, far = (
        part.ravel() for part in (a[:-1, :-1], a[1:, :-1], a[:-1, 1:], a[1:, 1:])
    )
    return points, np.concatenate([np.stack([low, right, far], 1), np.stack([low, far, up], 1)])


def areas(points, faces):
    corners = points[faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return cross[:, 2] / 2


def border_length(points, faces, side):
    """Length of the edges between pieces of different sides, and whether all edges match."""
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    counts = np.unique(edges, axis=0, return_counts=True)[1]
    sides = np.tile(side, 3)
    order = np.lexsort(edges.T[::-1])
    ordered, owners = edges[order], sides[order]
    twins = (ordered[1:] == ordered[:-1]).all(axis=1) & (owners[1:] != owners[:-1])
    ends = points[ordered[1:][twins]]
    return np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).sum(), counts


@pytest.mark.parametrize("count", [12, 40])
def test_a_level_is_a_straight_line_where_values_are_linear(count):
    points, faces = grid(count)
    values = points[:, 0] + 2 * points[:, 1]
    cut, corners = cut_at_levels(points, faces, values, [0.97, 1.9])
    assert (areas(cut.points, cut.faces) > 0).all()
    assert areas(cut.points, cut.faces).sum() == pytest.approx(1.0)
    new = cut.points[len(points) :]
    level = new[:, 0] + 2 * new[:, 1]
    # A cut keeps away from the ends of edges, by less than a tenth of them.
    away = np.minimum(abs(level - 0.97), abs(level - 1.9))
    assert away.max() < 0.1 * 3.5 / count and np.median(away) < 1e-12
    for number, (low, high) in enumerate([(-1, 0.97), (0.97, 1.9), (1.9, 9)]):
        inside = corners[cut.side == number]
        assert inside.min() >= low and inside.max() <= high


def test_a_border_of_labels_is_smoother_than_the_triangles_and_tears_nothing():
    points, faces = grid(40)
    labels = np.where(np.hypot(points[:, 0] - 0.5, points[:, 1] - 0.5) < 0.3, 4, 1)
    cut = cut_by_labels(points, faces, labels)
    assert areas(cut.points, cut.faces).sum() == pytest.approx(1.0)
    assert (areas(cut.points, cut.faces) > 0).all() and set(cut.side) == {1, 4}
    length, counts = border_length(cut.points, cut.faces, cut.side)
    assert counts.max() == 2
    circle = 2 * np.pi * 0.3
    majority = np.sort(labels[faces], axis=1)[:, 1]
    teeth, _ = border_length(points, faces, majority)
    assert circle * 0.95 < length < 1.1 * circle < teeth


def test_three_labels_meet_in_one_point():
    points, faces = grid(30)
    angle = np.arctan2(points[:, 1] - 0.52, points[:, 0] - 0.48)
    labels = np.digitize(angle, [-1.0, 1.2])
    cut = cut_by_labels(points, faces, labels)
    assert areas(cut.points, cut.faces).sum() == pytest.approx(1.0)
    assert (areas(cut.points, cut.faces) > 0).all()
    _, counts = border_length(cut.points, cut.faces, cut.side)
    assert counts.max() == 2


def test_where_values_jump_each_side_keeps_its_own():
    """At the foot of a thin rib nothing is near the limit."""
    points, faces = grid(30)
    values = np.where(points[:, 0] < 0.5, 0.8, 4.0)
    cut, corners = cut_at_levels(points, faces, values, [1.5, NEAR_LIMIT * 1.5])
    assert set(np.unique(corners)) == {0.8, 4.0}
    assert (areas(cut.points, cut.faces) > 0).all()


def test_below_near_and_above_a_limit_are_told_apart():
    below, near, above = limit_colors([0.99, 1.01, 1.3], 1.0)
    assert below[0] > 2 * below[1] and near[0] > near[2] + 0.5 and abs(above[0] - above[2]) < 0.2
    assert (limit_colors([np.nan], 1.0) == 0.62).all()
