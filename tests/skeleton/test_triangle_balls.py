"""Balls that triangles constrain, edge balls and fans."""

import numpy as np
import pytest

import closed_forms as forms
import medialis
from medialis import make_shape
from medialis.base.box_tree import NearestTree
from medialis.base.progress import Progress
from medialis.base.threads import thread_limit
from medialis.shape.creases import find_creases
from medialis.skeleton.medial_cloud import DEFAULT_TOLERANCE, sample_tree
from medialis.skeleton.triangle_balls import Walls
from oracles import winding_numbers

ROTATION = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]


def l_prism(height=3.0):
    """Walls of width 1 in the form of an L: one concave edge, through (1, 1)."""
    outline = np.array([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)], float)
    points = np.concatenate([np.c_[outline, np.zeros(6)], np.c_[outline, np.full(6, height)]])
    below = [(0, 3, 1), (1, 3, 2), (0, 5, 3), (3, 5, 4)]
    faces = below + [(a + 6, c + 6, b + 6) for a, b, c in below]
    for i in range(6):
        j = (i + 1) % 6
        faces += [(i, j, j + 6), (i, j + 6, i + 6)]
    return make_shape(points, faces)


def bumpy(levels=3):
    """A closed smooth surface with bulges and dents, nowhere symmetric."""
    ball = forms.icosphere(levels)
    x, y, z = ball.points.T
    radius = 1 + 0.25 * np.sin(3 * x + 1) * np.cos(2 * y) + 0.2 * np.sin(4 * z + x)
    return make_shape(ball.points * radius[:, None] * (1.0, 0.7, 0.5), ball.faces)


def places_on_faces(shape, grid=10):
    """A dense set of places of each triangle, (m, g, 3), and their weights, (g, 3)."""
    u, v = np.meshgrid(np.linspace(0, 1, grid + 1), np.linspace(0, 1, grid + 1))
    keep = u + v <= 1 + 1e-9
    weights = np.stack([1 - u[keep] - v[keep], u[keep], v[keep]], axis=1)
    return np.einsum("gc,fcx->fgx", weights, shape.points[shape.faces]), weights


def excess(cloud, rows):
    """How much deeper than the smooth surface bulges any of a dense set of places lies, each row.

    Faces at the sample itself take no part. The ball at the depth a in its relief h has
    |c - x|^2 + 2 r h = (r - a)^2.
    """
    shape = cloud.surface
    places, weights = places_on_faces(shape)
    bulges = find_creases(shape, 30.0).bulges
    pairs = weights[:, [0, 1, 2]] * weights[:, [1, 2, 0]]
    height = np.maximum(bulges, 0.0) @ pairs.T
    result = []
    for row in rows:
        other = ~(shape.faces == cloud.source[row]).any(axis=1)
        squared = ((places[other] - cloud.centers[row]) ** 2).sum(axis=2)
        squared += 2 * cloud.radii[row] * height[other]
        result.append(cloud.radii[row] - np.sqrt(squared.min()))
    return np.array(result)


def test_balls_of_a_cube_are_exact():
    """With samples alone balls at edges poked out by up to 0.4, and were of averaged normals."""
    shape = forms.cube()
    cloud = medialis.surface_skeleton(shape, refine=0.05)
    low, high = shape.bounds
    room = np.sort(np.concatenate([cloud.centers - low, high - cloud.centers], axis=1), axis=1)
    assert cloud.valid.all()
    assert cloud.radii == pytest.approx(room[:, 0], abs=1e-14)
    assert room[:, 1] == pytest.approx(room[:, 0], abs=1e-14)  # each touches two faces
    planes = ((cloud.surface.points == low) | (cloud.surface.points == high)).sum(axis=1)
    assert np.array_equal(cloud.features[:, 0] == cloud.features[:, 1], planes > 1)
    middle = planes == 2
    assert cloud.spoke_angles[middle] == pytest.approx(np.pi / 2)
    depth = DEFAULT_TOLERANCE * shape.diagonal
    assert cloud.radii[middle] == pytest.approx(depth / np.sqrt(2))


@pytest.mark.slow
def test_no_place_lies_deeper_than_the_smooth_surface_bulges():
    shape = bumpy()
    before = medialis.shrink_balls(shape)
    after = medialis.surface_skeleton(shape, refine=0)
    rows = np.flatnonzero(after.valid)[::7]
    tolerance = DEFAULT_TOLERANCE * shape.diagonal
    assert (excess(after, rows) <= tolerance).all()
    assert (excess(before, rows) > tolerance).sum() > 5
    assert (after.radii[rows] <= before.radii[rows]).all()
    inside = winding_numbers(shape.points, shape.faces, after.centers[rows]) > 0.5
    assert inside.all()


def test_balls_that_shrank_touch_the_face_that_they_name():
    cloud = medialis.surface_skeleton(bumpy(), refine=0)
    rows = np.flatnonzero(cloud.contact_faces >= 0)
    assert len(rows) > 50
    apart = np.linalg.norm(cloud.contacts[rows] - cloud.centers[rows], axis=1)
    # A ball touches the smooth surface, which bulges over the face.
    bulges = np.maximum(find_creases(cloud.surface, 30.0).bulges[cloud.contact_faces[rows]], 0.0)
    weights = cloud.contact_weights[rows]
    height = (weights[:, [0, 1, 2]] * weights[:, [1, 2, 0]] * bulges).sum(axis=1)
    radii = cloud.radii[rows]
    assert apart**2 + 2 * radii * height == pytest.approx(radii**2, rel=1e-9)
    corners = cloud.surface.faces[cloud.contact_faces[rows]]
    assert (corners == cloud.features[rows, 1:]).any(axis=1).all()
    assert cloud.contact_weights[rows].sum(axis=1) == pytest.approx(1.0)


def test_threads_turning_moving_and_scaling_change_nothing():
    shape = bumpy()
    with thread_limit(1):
        one = medialis.surface_skeleton(shape, refine=0)
    with thread_limit(3):
        three = medialis.surface_skeleton(shape, refine=0)
    for name in ("centers", "radii", "features", "contact_faces", "contact_weights"):
        assert np.array_equal(getattr(one, name), getattr(three, name), equal_nan=True)
    size = shape.diagonal
    for scale in (1e-6, 1e6):
        other = make_shape(scale * shape.points + 5 * scale, shape.faces)
        found = medialis.surface_skeleton(other, refine=0)
        assert found.radii / scale == pytest.approx(one.radii, abs=1e-9 * size)
    turned = make_shape(shape.points @ ROTATION.T, shape.faces)
    found = medialis.surface_skeleton(turned, refine=0)
    # The tree of a turned shape is another one, and certificates serve other balls.
    apart = np.abs(found.radii - one.radii)
    assert np.quantile(apart, 0.98) < DEFAULT_TOLERANCE * size


def test_exact_polyhedron_and_no_creases():
    """A prism of 16 sides: its axis when it is smooth; sheets to every edge when it is not."""
    shape = forms.prism(forms.disc_outline(corners=16), height=4.0, longest_edge=0.15)
    inside = np.abs(shape.points[:, 2] - shape.points[:, 2].mean()) < 0.8
    smooth = medialis.surface_skeleton(shape, refine=0)
    sharp = medialis.surface_skeleton(shape, refine=0, creases=0)
    none = medialis.surface_skeleton(shape, refine=0, creases=180)
    assert (smooth.radii[inside] > 0.3).mean() >= (sharp.radii[inside] > 0.3).mean()
    at_own = sharp.features[:, 0] == sharp.features[:, 1]
    radial = np.linalg.norm(shape.points[:, :2], axis=1)
    assert at_own[inside & (radial > 1 - 1e-9)].all()  # all 16 edges are sharp
    at_own = smooth.features[:, 0] == smooth.features[:, 1]
    assert not at_own[inside].any()
    assert not (none.features[:, 0] == none.features[:, 1]).any()


def fans_of(cloud):
    """The balls of fans, without those of convex creases between samples."""
    rows = np.arange(cloud.surface.point_count, len(cloud))
    return cloud.subset(rows[cloud.features[rows, 0] != cloud.features[rows, 1]])


def test_fan_at_a_concave_edge_has_no_gap():
    """The sheet between a concave edge and the walls opposite is a parabolic cylinder; there were
    balls on its rims and in its middle only."""
    shape = l_prism()
    plain = medialis.surface_skeleton(shape, refine=0.04)
    cloud = medialis.surface_skeleton(shape, refine=0.04, fans=True)
    n = cloud.surface.point_count
    assert np.array_equal(cloud.centers[:n], plain.centers, equal_nan=True)
    fan = fans_of(cloud)
    at_edge = cloud.surface.points[fan.source]
    assert len(fan) > 200 and (at_edge[:, :2] == 1.0).all()
    far = np.abs(fan.centers[:, 2] - 1.5) < 0.9  # not stopped by the ends
    x, y = fan.centers[far, 0], fan.centers[far, 1]
    assert fan.radii[far] == pytest.approx(np.hypot(1 - x, 1 - y), abs=1e-12)
    assert fan.radii[far] == pytest.approx(np.minimum(x, y), abs=1e-9)
    here = far & (np.abs(at_edge[:, 2] - at_edge[far][0, 2]) < 1e-9)
    ordered = fan.centers[here][np.argsort(np.arctan2(*(1 - fan.centers[here, :2]).T))]
    steps = np.linalg.norm(np.diff(ordered, axis=0), axis=1)
    assert steps.max() < 2 * cloud.surface.spacing


def test_fans_of_the_outer_side_stand_at_convex_edges():
    cloud = medialis.surface_skeleton(
        l_prism(), refine=0.1, fans=True, side="outer", largest_radius=2.0
    )
    fan = fans_of(cloud)
    assert (fan.side == -1).all()
    assert not (cloud.surface.points[fan.source][:, :2] == 1.0).all(axis=1).any()


@pytest.mark.slow
def test_balls_between_the_samples_of_convex_creases():
    """The surface between two samples of a crease was half a sample spacing from any ball."""
    shape = forms.cube()
    plain = medialis.surface_skeleton(shape, refine=0.02)
    cloud = medialis.surface_skeleton(shape, refine=0.02, fans=True)
    n = cloud.surface.point_count
    more = cloud.subset(np.arange(n, len(cloud)))
    assert (more.features[:, 0] == more.features[:, 1]).all() and (more.contact_faces >= 0).all()
    low, high = shape.bounds
    room = np.concatenate([more.centers - low, high - more.centers], axis=1).min(axis=1)
    assert more.radii == pytest.approx(room, abs=1e-12)  # none pokes out, each touches
    # Their contacts are places of edges, as far apart as three balls between two samples are.
    at_wall = (np.abs(np.abs(more.contacts) - 1) < 1e-12).sum(axis=1)
    assert (at_wall >= 2).all()
    # 0.1 % of the diagonal where one of them lies; without, 0.41 of the radius of the next balls.
    between = cloud.surface.points[cloud.surface.edges].mean(axis=1)
    edges = between[(np.abs(np.abs(between) - 1) < 1e-12).sum(axis=1) == 2]
    gaps = [
        np.min(np.linalg.norm(edges[:, None] - c.centers[None], axis=2) - c.radii, axis=1).max()
        for c in (plain, cloud)
    ]
    assert gaps[1] < 1.01e-3 * shape.diagonal < 0.5 * gaps[0]
    ball = forms.icosphere(2)  # without any crease
    assert len(medialis.surface_skeleton(ball, fans=True, refine=0)) == ball.point_count
    sheets = [medialis.medial_sheets(c).count for c in (plain, cloud)]
    assert sheets[0] == sheets[1] == 12


@pytest.mark.parametrize("angle, edges", [(30.0, 12), (91.0, 0), (0.0, 12)])
def test_creases_of_a_cube(angle, edges):
    creases = find_creases(forms.cube(), angle)
    assert len(creases.vertices) == (24 if edges else 0)
    assert len(creases.pairs) == (24 if edges else 0) and not creases.concave.any()
    if edges:
        assert np.abs(creases.normals).max(axis=1) == pytest.approx(1.0)
        assert creases.least_cosines == pytest.approx(1.0)
    else:
        # Weighted by angle: the two corners at a face's diagonal have 1/2 the angle each.
        assert creases.least_cosines == pytest.approx(1 / np.sqrt(3))


def test_concave_creases():
    creases = find_creases(l_prism(), 30.0)
    place = creases.shape.points[creases.vertices[creases.pairs[:, 0]]]
    at_edge = (place[:, :2] == 1.0).all(axis=1)
    assert creases.concave.sum() == 2 and at_edge[creases.concave].all()


def test_clouds_have_no_creases():
    cloud = forms.sphere(300).shape
    result = medialis.surface_skeleton(cloud)
    assert (result.contact_faces == -1).all()
    assert result.contacts == pytest.approx(cloud.points[result.features[:, 1]])


@pytest.mark.slow
def test_hulls_of_slivers_are_as_thin_as_the_slivers():
    """The disc round a sliver is as wide as that is long: 41,000 outer balls of a tube of 160 sides
    were each compared with thousands of faces that they do not touch, 13 s (fixed)."""
    from medialis.skeleton import _triangle_kernels as kernels

    rng = np.random.default_rng(3)
    for high in (1.0, 0.3, 0.1, 1e-3, 1e-6, 0.0):
        corners = np.array([[0, 0, 0], [1, 0, 0], [rng.random(), high, 0]]) @ ROTATION.T + 0.3
        hull = np.zeros((1, kernels.ROWS, kernels.BLOCK), np.float32)
        faces, held = np.arange(3)[None], np.full((kernels.BLOCK, 3), -1, np.int32)
        held[0] = faces
        kernels.fill_hulls(0, 1, corners, held, hull)
        row = hull[0, :, 0].astype(np.float64)
        to = corners.mean(axis=0) + rng.normal(size=(200, 3)) - row[:3]
        off = to @ row[kernels.AXIS : kernels.AXIS + 3]
        beside = np.linalg.norm(to - off[:, None] * row[kernels.AXIS : kernels.AXIS + 3], axis=1)
        beside = np.maximum(beside - row[kernels.BREADTH], 0)
        near = np.hypot(np.maximum(np.abs(off) - row[kernels.THICK], 0), beside)
        weights = places_on_faces(make_shape(corners, faces, repair=False), 400)[1]
        places = weights @ corners
        away = np.array([np.linalg.norm(places - p, axis=1).min() for p in to + row[:3]])
        assert (near <= away + 1e-6).all()
        if high < 1 / kernels.SLIVER:
            assert (near >= away - high - 1e-2).all()  # 1e-2: between the places that were tried


def test_room_is_the_distance_to_the_nearest_triangle():
    """Against the tree of triangles that reports use."""
    shape = l_prism()
    walls = Walls.of(find_creases(shape, 30.0), sample_tree(shape, Progress()))
    rng = np.random.default_rng(5)
    low, high = shape.bounds
    places = rng.uniform(low - 0.1, high + 0.1, size=(500, 3))
    distance, _ = NearestTree.of_triangles(shape.points, shape.faces).distances(places)
    most = distance * rng.choice([0.5, 1.5, 10.0], size=500)
    assert walls.room(places, most) == pytest.approx(np.minimum(distance, most), abs=1e-12)
