"""Sheets, areas and Y-curves of polyhedra and cylinders are those of closed forms (thesis 6.2.2).

Balls know the triangles there, so sheets can be followed to where they meet: what is flat comes out
to rounding and the tolerance of the balls, however the samples lie. Nothing is merged.
"""

import math

import numpy as np
import pytest
from accuracy_suite.catalogue import shapes
from accuracy_suite.suite import mesh

import closed_forms as forms
import medialis
from medialis.shape.creases import find_creases

SIDES = (2.0, 1.5, 1.0)


def scaffold_of(shape, fans=True, **options):
    cloud = medialis.surface_skeleton(shape, refine=0, fans=fans, **options)
    return medialis.medial_scaffold(medialis.medial_sheets(cloud, smallest=0.0))


def turned(shape, seed):
    """The same shape in another position, far from the origin by its own size."""
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    return medialis.make_shape(shape.points @ turn.T + 3.0, shape.faces)


def assert_known(scaffold, areas, y_length, curves, within, triangle=0.0):
    """Each sheet and the whole network have the size that they should.

    `triangle`: area of a triangle of a sheet; one that more than three sheets share is divided
    among three.
    """
    found = np.sort(scaffold.meshes.areas)
    assert len(found) == len(areas)
    assert (np.abs(found - np.sort(areas)) < within * np.sort(areas) + triangle).all()
    assert abs(found.sum() / np.sum(areas) - 1) < within
    assert len(scaffold.network.lengths) == curves
    assert abs(scaffold.network.lengths.sum() / y_length - 1) < within


@pytest.mark.slow
@pytest.mark.parametrize("irregular", [False, True])
@pytest.mark.parametrize("name", ["box", "cube", "wedge", "L", "T", "prism", "cylinder"])
def test_eight_samples_across_are_enough(name, irregular):
    """Curves: two slopes behind each convex corner of the outline, and the sides of the middle
    sheet, of which those round a concave corner are one; of a cube the middle is a point."""
    known = shapes()[name]
    curves = {"box": 12, "cube": 8, "wedge": 9, "L": 15, "T": 18, "prism": 18, "cylinder": 1}
    for shape in (mesh(name, 8, irregular), turned(mesh(name, 8, irregular), 1)):
        scaffold = scaffold_of(shape)
        assert_known(scaffold, known.areas, known.y_length, curves[name], 0.01)


@pytest.mark.parametrize("step", [0.36, 0.18, 0.09])
def test_a_cube_has_twelve_triangles(step):
    """They meet in its center: of side 2, each has the area sqrt 2, each of 8 curves sqrt 3."""
    for shape in (forms.refined(forms.cube(), step), turned(forms.refined(forms.cube(), step), 2)):
        scaffold = scaffold_of(shape)
        assert_known(scaffold, [math.sqrt(2)] * 12, 8 * math.sqrt(3), 8, 1e-3)
        ends = np.bincount(scaffold.network.edges.ravel()) == 1
        away = np.linalg.norm(scaffold.network.points[ends] - shape.points.mean(axis=0), axis=1)
        assert np.allclose(np.sort(away), [0] * 8 + [math.sqrt(3)] * 8, atol=1e-2)


@pytest.mark.slow
@pytest.mark.parametrize("corners", [3, 4, 6])
def test_tall_prisms_have_sheets_that_meet_on_their_axis(corners):
    """Upright trapezoids from each edge (H) to the axis (H - 2 rho), R wide; slopes of 45 degrees
    over both ends. Six sheets meet along the axis of a hexagonal prism, which is one curve."""
    radius, height = 1.0, 2.5
    inner = radius * math.cos(math.pi / corners)
    end = radius**2 * math.sin(2 * math.pi / corners) / 2 * math.sqrt(2)
    areas = [end] * 2 * corners + [radius * (height - inner)] * corners
    y_length = height - 2 * inner + 2 * corners * math.hypot(radius, inner)
    shape = forms.prism(forms.disc_outline(radius, corners), height, inner / 4)
    for seed in (0, 1, 2):
        scaffold = scaffold_of(turned(shape, seed))
        triangle = math.sqrt(2) * (inner / 4) ** 2 / 2
        assert_known(scaffold, areas, y_length, 2 * corners + 1, 0.01, triangle)


def test_sheets_are_cut_where_they_meet_and_end_on_creases():
    """All of a box: points between two sheets lie on both, the rim lies on the edges, and no
    triangle passes from a sheet to another."""
    shape = forms.box_mesh(SIDES, 0.12)
    meshes = scaffold_of(shape).meshes
    half = np.array(SIDES) / 2
    gaps = np.sort(half - np.abs(meshes.mesh.points), axis=1)
    truth = np.sort(half - np.abs(meshes.mesh.points[meshes.mesh.faces].mean(axis=1)), axis=1)
    # Every point is as far from two faces; the middle sheet is as far from top and bottom.
    middle = np.abs(meshes.mesh.points[:, 2]) < 1e-3
    assert np.abs(gaps[~middle, 1] - gaps[~middle, 0]).max() < 3e-3
    assert np.abs(meshes.radii - gaps[:, 0]).max() < 3e-3
    places = meshes.mesh.points[meshes.mesh.faces].mean(axis=1)
    pairs = np.sort(np.argsort(half - np.abs(places), axis=1)[:, :2], axis=1)
    clear = (truth[:, 2] - truth[:, 1] > 1e-2) & (np.abs(places[:, 2]) > 1e-2)
    behind = [np.unique(pairs[clear & (meshes.face_sheet == i)], axis=0) for i in range(13)]
    assert sorted(len(one) for one in behind) == [0] + [1] * 12
    assert (gaps[:, 1] < 1e-12).any()  # on an edge itself


@pytest.mark.slow
def test_fans_close_the_gap_at_a_concave_edge():
    """Over the corner an L has a quarter of a cone of slope 45 degrees, above and below: area
    pi / 4 sqrt 2 h^2 each, of which nothing is there without fans but a chord."""
    shape = forms.prism(forms.L_OUTLINE, 0.8, 0.1)
    without, whole = (scaffold_of(shape, fans=fans).meshes for fans in (False, True))
    cones = 2 * math.pi / 4 * math.sqrt(2) * 0.4**2
    more = whole.areas.sum() - without.areas.sum()
    assert whole.sheets.count == without.sheets.count == 16
    assert 0.1 * cones < more < cones
    assert whole.areas.sum() == pytest.approx(14.4348, rel=2e-3)


def test_a_surface_is_cut_along_convex_creases_only():
    """An L is cut along its convex edges alone; a cube falls into its six faces."""
    shape = forms.prism(forms.L_OUTLINE, 0.8, 0.15)
    unfolded = scaffold_of(shape).sheets.unfolded
    edges = np.sort(unfolded.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    ends, count = np.unique(edges, axis=0, return_counts=True)
    assert count.max() == 2
    creases = find_creases(unfolded.cloud.surface, 30.0)
    convex = creases.vertices[creases.pairs[~creases.concave]]
    assert np.isin(unfolded.samples[ends[count == 1]], convex).all()
    assert unfolded.areas.sum() == pytest.approx(unfolded.cloud.surface.area)
    assert len(np.unique(unfolded.regions[:, 0])) == 7  # the two walls of the corner are one
    cube = scaffold_of(forms.refined(forms.cube(), 0.5)).sheets.unfolded
    copies = np.bincount(cube.samples)
    on_sides = (np.abs(cube.cloud.surface.points) > 1 - 1e-9).sum(axis=1)
    assert (copies == np.maximum(on_sides, 1)).all()
    assert (cube.radii[copies[cube.samples] > 1] == 0).all()


def test_concave_creases_end_the_outer_sheets():
    """Outside, a bar along an edge is what a groove is inside: both sides keep to themselves."""
    shape = forms.prism(forms.L_OUTLINE, 0.8, 0.15)
    cloud = medialis.surface_skeleton(shape, refine=0, fans=True, side="both")
    sheets = medialis.medial_sheets(cloud, smallest=0.0)
    inner = medialis.medial_sheets(cloud.inner, smallest=0.0)
    assert inner.count == 16 and (sheets.labels[cloud.valid] >= 0).all()
    assert set(sheets.labels[cloud.valid & (cloud.side > 0)]) == set(range(16))
    outer = np.unique(sheets.labels[cloud.valid & (cloud.side < 0)])
    assert len(outer) and outer.min() >= 16
    on_crease = (sheets.unfolded.radii == 0) & (cloud.side[sheets.unfolded.rows] < 0)
    corner = cloud.surface.points[np.unique(sheets.unfolded.samples[on_crease])]
    assert len(corner) and np.allclose(corner[:, :2], 1.2)


def test_labelled_points_keep_their_labels_where_others_lie_in_the_same_place():
    """The balls of a fan share their sample: the nearest seed of one must be itself."""
    from medialis.base.arrays import Ragged
    from medialis.shape.labels import spread_labels

    graph = Ragged([0, 1, 3, 4], [1, 0, 2, 1])
    found = spread_labels(np.zeros((3, 3)), graph, np.array([4, 7, -1], np.int32))
    assert found.tolist()[:2] == [4, 7] and found[2] in (4, 7)


def test_curves_are_smoothed_without_shrinking():
    """A circle of 40 nodes keeps its length, and loses the zigzag of a tenth of a step."""
    from medialis.sheets.scaffold import smoothed_curves

    turn = 2 * np.pi * np.arange(40) / 40
    circle = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    links = np.stack([np.arange(40), (np.arange(40) + 1) % 40], axis=1)
    rough = circle * (1 + 0.01 * (-1.0) ** np.arange(40))[:, None]
    for points in (circle, rough):
        smooth = smoothed_curves(points, links)
        assert np.abs(np.linalg.norm(smooth, axis=1) - 1).max() < 3e-3
    line = np.cumsum(np.random.default_rng(0).uniform(0.01, 1, 30))[:, None] * [1.0, 2.0, 3.0]
    ahead = np.stack([np.arange(29), np.arange(1, 30)], axis=1)
    assert np.allclose(smoothed_curves(line, ahead), line)
