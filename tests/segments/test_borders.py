"""Borders between segments as curves."""

import numpy as np
import pytest

import closed_forms as forms
import medialis


def turns(points, edges):
    """Angles by which curves turn at their inner points, in degrees."""
    near = [[] for _ in points]
    for a, b in edges.tolist():
        near[a].append(b)
        near[b].append(a)
    inner = [k for k, others in enumerate(near) if len(others) == 2]
    u = np.array([points[k] - points[near[k][0]] for k in inner])
    v = np.array([points[near[k][1]] - points[k] for k in inner])
    size = np.linalg.norm(u, axis=1) * np.linalg.norm(v, axis=1)
    cosine = (u * v).sum(axis=1)[size > 0] / size[size > 0]
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


def length(points, edges):
    return np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1).sum()


@pytest.mark.parametrize("tilt", [0.0, 0.3, 1.0])
def test_a_cut_through_a_torus_is_two_smooth_circles(tilt):
    """Labels by a plane across the tube: as long as the polygons, where edge midpoints zigzag."""
    ring = forms.torus_mesh(around=90, across=30, major=1.0, minor=0.3)
    side = ring.points @ [0.2, np.cos(tilt), np.sin(tilt)] > 0
    found = medialis.Segmentation(side.astype(np.int32), surface=ring)
    points, edges = found.borders
    degree = np.bincount(edges.ravel(), minlength=len(points))
    assert (degree == 2).all()
    cut = ring.points[ring.edges[side[ring.edges].sum(axis=1) == 1]]
    assert len(points) == len(cut)
    # Every point lies on an edge that is cut, so within half the longest of its middle.
    away = np.linalg.norm(points[:, None] - cut.mean(axis=1), axis=2).min(axis=1)
    assert away.max() <= np.linalg.norm(cut[:, 0] - cut[:, 1], axis=1).max() / 2 + 1e-12
    assert np.percentile(turns(points, edges), 90) < 25


def test_three_segments_meet_in_a_point():
    ball = forms.icosphere(4)
    turn = np.arctan2(*(ball.points - ball.points.mean(axis=0))[:, :2].T)
    labels = np.searchsorted([-np.pi / 3, np.pi / 3], turn).astype(np.int32)
    points, edges = medialis.Segmentation(labels, surface=ball).borders
    corners = np.sort(labels[ball.faces], axis=1)
    three = (np.diff(corners, axis=1) > 0).all(axis=1).sum()
    degree = np.bincount(edges.ravel(), minlength=len(points))
    assert three > 0 and (degree == 3).sum() >= three
    assert length(points, edges) > 0 and not points.flags.writeable


def test_borders_of_faces_are_edges_of_the_mesh():
    box = forms.refined(forms.cube(), 0.5)
    shape = medialis.make_shape(box.points, box.faces)
    found = medialis.patches(medialis.surface_skeleton(shape, side="both"))
    points, edges = found.borders
    size = np.ptp(shape.points, axis=0)
    assert length(points, edges) == pytest.approx(4 * size.sum())  # the 12 edges of the box
    on = np.isclose(points, shape.points.min(axis=0)) | np.isclose(points, shape.points.max(axis=0))
    assert (on.sum(axis=1) >= 2).all()


def test_nothing_to_divide_has_no_borders():
    shape = forms.icosphere(2)
    none = np.full(shape.point_count, -1, np.int32)
    for labels in (none, 0 * none):
        points, edges = medialis.Segmentation(labels, surface=shape).borders
        assert len(points) == len(edges) == 0
    cloud = medialis.Shape(shape.points, shape.normals)
    assert len(medialis.Segmentation(0 * none, surface=cloud).borders[1]) == 0
