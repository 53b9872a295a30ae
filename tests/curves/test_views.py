"""Curve skeletons from views (thesis 3.7): closed forms, pairing, culling, invariance, bad input.

Tolerances are in pixels. A silhouette is known to half a pixel, so its skeleton is, too; every view
pulls a point to its own skeleton with a last step of a quarter of a pixel. A surface that is no
perfect tube (facets, a bend) shifts skeletons by as much again. Hence nodes must lie within two
pixels (one cell of the linking), unless a test says more.
"""

import math

import numpy as np
import pytest
from scipy.spatial import cKDTree

import closed_forms
import medialis
from medialis.curves.from_views.drawing import Canvas
from medialis.curves.from_views.skeleton import GivenViews, PackedViews, _match, _sharpen
from medialis.curves.from_views.views import (
    camera_axes,
    camera_pairs,
    pair_points,
    silhouette_skeleton,
    skeletonize,
    sphere_of,
)
from medialis.shape.shape import Shape

QUICK = {"pairs": 60, "size": 128}


def capsules(segments, radius):
    """Overlapping capsule meshes, one a segment: a union without a clean surface."""
    ball = closed_forms.icosphere(3)
    points, faces = [], []
    for a, b in np.asarray(segments, float):
        ahead = ball.points @ (b - a) > 0
        faces.append(ball.faces + len(ball.points) * len(points))
        points.append(radius * ball.points + np.where(ahead[:, None], b, a))
    return closed_forms.mesh(np.concatenate(points), np.concatenate(faces))


def to_segments(points, segments):
    """Distance of each point to the nearest of the segments."""
    away = []
    for a, b in np.asarray(segments, float):
        t = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        away.append(np.linalg.norm(points - a - t[:, None] * (b - a), axis=1))
    return np.min(away, axis=0)


def on_edges(curve):
    """Points along the edges, dense enough to measure how much of a line they cover."""
    a, b = curve.nodes[curve.edges[:, 0]], curve.nodes[curve.edges[:, 1]]
    return np.concatenate([a + t * (b - a) for t in np.linspace(0, 1, 9)])


def pixel_of(shape, size):
    return 2 * sphere_of(shape.points)[1] / (size - 4)


LINE = [[[-1, 0, 0], [1, 0, 0]]]
FORK = [[[0, 0, 0], [math.cos(t), math.sin(t), 0.2]] for t in (0.3, 2.4, 4.4)]
BEND = np.stack([np.sin(t := np.linspace(0, 2, 9)), 1 - np.cos(t), 0 * t], axis=1)
BEND = np.stack([BEND[:-1], BEND[1:]], axis=1)


@pytest.mark.parametrize(
    ("segments", "ends", "junctions"),
    [(LINE, 2, 0), (BEND, 2, 0), (FORK, 3, 1)],
    ids=["capsule", "bent tube", "fork"],
)
def test_tubes_have_their_axes(segments, ends, junctions):
    """Nodes on the axis, all of the axis covered, radii right, one junction where the tubes meet.

    Where tubes meet, silhouettes are wider than the tube: within a radius of the junction the
    skeleton may leave the axes by half a radius. The ends lose at most three cells, the last link.
    """
    shape = capsules(segments, 0.2)
    curve = medialis.view_curve_skeleton(shape, **QUICK)
    pixel = pixel_of(shape, 128)
    assert (curve.component_count, curve.loops) == (1, 0)
    assert (len(curve.end_points), len(curve.junctions)) == (ends, junctions)
    away = to_segments(curve.nodes, segments)
    near = np.linalg.norm(curve.nodes, axis=1) < 2 * 0.2 if junctions else np.zeros(len(away), bool)
    assert (away[~near] < 2 * pixel).all() and (away < 0.1).all()
    share = np.linspace(0, 1, 30)[:, None]
    axis = np.concatenate([a + share * (b - a) for a, b in np.array(segments, float)])
    assert cKDTree(on_edges(curve)).query(axis)[0].max() < (0.1 if junctions else 6 * pixel)
    assert (np.abs(curve.radii - 0.2)[~near] < 2 * pixel).all()
    if junctions:
        assert np.linalg.norm(curve.nodes[curve.junctions[0]]) < 0.1


@pytest.mark.slow
def test_torus_has_its_circle():
    """One closed branch; the mesh of 96 x 48 lies within 0.001 of the torus."""
    shape = closed_forms.torus_mesh(96, 48)
    curve = medialis.view_curve_skeleton(shape, **QUICK)
    assert (curve.component_count, curve.loops, len(curve.end_points)) == (1, 1, 0)
    off = np.hypot(np.hypot(*curve.nodes[:, :2].T) - 1, curve.nodes[:, 2])
    assert off.max() < 2 * pixel_of(shape, 128)
    assert curve.length == pytest.approx(2 * math.pi, rel=0.05)


@pytest.mark.slow
def test_sphere_is_one_point():
    curve = medialis.view_curve_skeleton(closed_forms.icosphere(3), **QUICK)
    assert curve.nodes.shape == (1, 3) and len(curve.edges) == 0
    pixel = pixel_of(closed_forms.icosphere(3), 128)
    assert np.linalg.norm(curve.nodes) < pixel and abs(curve.radii[0] - 1) < 2 * pixel


def test_two_parts_give_two_components():
    shape = capsules([[[-1, 0, 0], [1, 0, 0]], [[-1, 1, 0], [1, 1, 0.3]]], 0.2)
    assert medialis.view_curve_skeleton(shape, **QUICK).component_count == 2


@pytest.mark.slow
def test_point_cloud_of_a_capsule():
    """6000 + 3000 samples; discs leave the tube by (their reach 0.1)^2 / (2 radius) = 0.013."""
    shape = closed_forms.capsule(6000).shape
    curve = medialis.view_curve_skeleton(shape, **QUICK)
    assert (curve.component_count, curve.loops, len(curve.end_points)) == (1, 0, 2)
    pixel = pixel_of(shape, 128)
    assert np.hypot(*curve.nodes[:, 1:].T).max() < 2 * pixel
    ends = np.sort(curve.nodes[curve.end_points, 0])
    assert np.allclose(ends, [-1, 1], rtol=0, atol=6 * pixel)


@pytest.mark.slow
def test_discs_of_a_cloud_fit_into_the_pictures():
    """Cameras saw the samples whole, but not the discs round them: clouds with corners, and many
    scans, were refused because "a silhouette touches the border of its picture"."""
    shape = closed_forms.box_samples((3.0, 0.6, 0.6), spacing=0.1).shape
    curve = medialis.view_curve_skeleton(shape, **QUICK)
    along = curve.nodes[:, 0] - shape.points[:, 0].mean()
    assert curve.component_count == 1 and along.min() < -0.75 and along.max() > 0.75
    core = medialis.rasterizer(shape)
    other = medialis.view_curve_skeleton(shape, **QUICK, source=lambda cameras: core(cameras))
    assert np.array_equal(curve.nodes, other.nodes)


def slow_pairs(first, second, left, right, angle):
    """Every crossing with the one of all in its row whose depth is nearest: Eq. 3.9, 3.10."""
    a, b = first.camera, second.camera
    found = []
    for p in range(len(left.column)):
        row = left.row[p]
        x = (left.column[p] - a.size / 2) * a.pixel
        col = int(left.column[p])
        if not first.mask[row, col]:
            col += -1 if left.column[p] - col < 0.5 else 1
        low, high = float(first.near[row, col]), float(first.far[row, col])
        partners = np.flatnonzero(right.row == row)
        if len(partners) == 0:
            continue
        # x a_r + k a_f = x' b_r + k' b_f in the plane of a row: two equations, two unknowns.
        depths = []
        for q in partners:
            other = (right.column[q] - b.size / 2) * b.pixel
            system = np.array([[0, -math.sin(angle)], [1, -math.cos(angle)]])
            known = other * np.array([math.cos(angle), -math.sin(angle)]) - [x, 0]
            depths.append(np.linalg.solve(system, known))
        depths = np.array(depths)
        best = np.abs(depths[:, 0] - (low + high) / 2).argmin()
        k = depths[best, 0]
        if low <= k <= high:
            found.append([x, (a.size / 2 - row - 0.5) * a.pixel, k])
    return np.array(found) @ a.axes + a.center


def test_pairing_agrees_with_all_pairs():
    """The early stop finds the best partner: depths along a row are monotone."""
    shape = medialis.organic_shape(56)
    angle = math.radians(20)
    center, radius = sphere_of(shape.points)
    for cameras in camera_pairs(center, radius, pairs=3, angle=angle, size=96):
        first, second = medialis.rasterizer(shape)(cameras)
        left, right = silhouette_skeleton(first.mask), silhouette_skeleton(second.mask)
        expected = slow_pairs(first, second, left, right, angle)
        found = pair_points(first, second.camera, left, right)
        assert len(expected) > 10
        assert found.shape == expected.shape
        assert np.allclose(found, expected, rtol=0, atol=1e-9 * radius)


def test_cameras_cover_the_sphere():
    """Unit axes at right angles; no direction is far from a camera, also not from one of the first.

    Steps of the golden ratio once left out half of the sphere in the first 25 cameras.
    """
    axes = camera_axes(200)
    assert np.allclose(np.einsum("nij,nkj->nik", axes, axes), np.eye(3), rtol=0, atol=1e-12)
    assert np.allclose(np.cross(axes[:, 0], axes[:, 1]), -axes[:, 2], rtol=0, atol=1e-12)
    away = cKDTree(axes[:, 2]).query(closed_forms.random_directions(2000))[0]
    assert away.max() < 2 * math.sqrt(4 / 200)  # twice the radius of a cap of 4 pi / 200
    first = cKDTree(axes[:25, 2]).query(closed_forms.random_directions(2000))[0]
    assert first.max() < 3 * math.sqrt(4 / 25)  # any run covers it, a little less evenly


def winding_number(points, shape):
    """Generalized winding number by the solid angles of all triangles (van Oosterom, Strackee)."""
    total = np.zeros(len(points))
    corners = shape.points[shape.faces]
    for row, p in enumerate(points):
        a, b, c = (corners[:, j] - p for j in range(3))
        la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
        top = np.einsum("ij,ij->i", a, np.cross(b, c))
        bottom = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
        total[row] = 2 * np.arctan2(top, bottom).sum() / (4 * math.pi)
    return total


@pytest.mark.slow
def test_all_points_are_inside_and_in_the_middle():
    """After culling no point is outside; nodes are as far from the surface as balls allow.

    Centered: the distance of a node to the surface, against that of the deepest place near by: none
    of the places within half its radius is deeper by more than half at the median node.
    """
    shape = medialis.organic_shape(56)
    center, radius = sphere_of(shape.points)
    pairs = camera_pairs(center, radius, pairs=60, angle=math.radians(20), size=128)
    views, steps = PackedViews(medialis.rasterizer(shape), 1.0, 0), medialis.Progress()
    matched, weights = _match(views, pairs, steps)
    points, _ = _sharpen(views, [a for a, _ in pairs], matched, weights, steps)
    assert 0.3 * len(matched) < len(points) < len(matched)
    some = points[:: max(1, len(points) // 300)]
    assert (winding_number(some, shape) > 0.5).all()
    curve = medialis.view_curve_skeleton(shape, **QUICK)
    assert (winding_number(curve.nodes, shape) > 0.5).all()
    surface = cKDTree(shape.points)
    depth = surface.query(curve.nodes)[0]
    assert np.median(np.abs(depth - curve.radii)) < 2 * pixel_of(shape, 128)


def test_sharpening_gathers_points():
    """Away from its middle less than half of what is a pixel off the axes of a fork remains.

    Silhouettes of facets and of other limbs make such points; most are within a pixel at once.
    """
    shape = capsules(FORK, 0.2)
    center, radius = sphere_of(shape.points)
    pairs = camera_pairs(center, radius, pairs=60, angle=math.radians(20), size=128)
    views, steps = PackedViews(medialis.rasterizer(shape), 1.0, 0), medialis.Progress()
    matched, weights = _match(views, pairs, steps)
    points, _ = _sharpen(views, [a for a, _ in pairs], matched, weights, steps)
    before, after = (
        (to_segments(p, FORK)[np.linalg.norm(p, axis=1) > 0.4] > pixel_of(shape, 128)).mean()
        for p in (matched, points)
    )
    assert after < before / 2


@pytest.mark.slow
def test_packed_views_are_the_views():
    """With room for all first views, for some and for none: the same skeleton to the last bit."""
    shape = medialis.organic_shape(56)
    found = []
    for room in (1 << 30, 200_000, 0):
        with medialis.memory_limit(room):
            found.append(medialis.view_curve_skeleton(shape, **QUICK))
    for other in found[1:]:
        assert other.nodes.tobytes() == found[0].nodes.tobytes()
        assert other.radii.tobytes() == found[0].radii.tobytes()
        assert (other.edges == found[0].edges).all()


@pytest.mark.slow
def test_rotation_scale_and_threads():
    """The same skeleton: exactly when scaled by 4 and on 2 threads, nearly when rotated.

    Rotated, other views see it: nine tenths of the nodes lie within 3 pixels of the edges of the
    other skeleton, the median within 1.5 (measured: 0.9 and 0.5 % of the diagonal, a pixel is 0.9).
    """
    shape = medialis.organic_shape(56)
    curve = medialis.view_curve_skeleton(shape, **QUICK)
    large = Shape(4 * shape.points, shape.normals, shape.faces)
    with medialis.thread_limit(1):
        scaled = medialis.view_curve_skeleton(large, **QUICK)
    assert (scaled.nodes == 4 * curve.nodes).all() and (scaled.radii == 4 * curve.radii).all()
    assert (scaled.edges == curve.edges).all()
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    other = medialis.view_curve_skeleton(
        Shape(shape.points @ turn.T, shape.normals @ turn.T, shape.faces), **QUICK
    )
    assert (other.component_count, other.loops) == (curve.component_count, curve.loops)
    away = cKDTree(on_edges(curve)).query(other.nodes @ turn)[0] / pixel_of(shape, 128)
    assert np.median(away) < 1.5 and np.quantile(away, 0.9) < 3
    assert other.length == pytest.approx(curve.length, rel=0.1)


def test_given_views_and_other_sources():
    """Views of the caller give what the rasterizer gives; a source is asked for every view."""
    shape = capsules(LINE, 0.2)
    center, radius = sphere_of(shape.points)
    cameras = camera_pairs(center, radius, pairs=30, angle=math.radians(20), size=96)
    source = medialis.rasterizer(shape)
    views = [tuple(source(pair)) for pair in cameras]
    given = medialis.view_curve_skeleton(views)
    asked = []

    def counting(batch):
        asked.extend(batch)
        return source(batch)

    with medialis.view_source(lambda seen: counting if seen is shape else source):
        result = medialis.run("view_curve_skeleton", shape, pairs=30, size=96)
    direct = medialis.view_curve_skeleton(shape, pairs=30, size=96, source=counting)
    assert len(asked) == 2 * (2 * 30 + 30 + 30)
    for nodes in (result.layers[0].points, direct.nodes):
        assert (nodes == given.nodes).all()


@pytest.mark.slow
def test_operation_warns_of_sheets_and_joined_parts():
    plate = medialis.run("view_curve_skeleton", closed_forms.box_mesh((1, 1, 0.15)), **QUICK)
    assert plate.messages[0].code == "thin_sheets" and plate.messages[0].data["share"] > 0.2
    crossed = medialis.run("view_curve_skeleton", capsules(FORK, 0.2), **QUICK)
    told = {message.code: dict(message.data) for message in crossed.messages}
    assert told["parts_differ"] == {"parts": 3, "components": 1}
    good = medialis.run("view_curve_skeleton", capsules(LINE, 0.2), **QUICK)
    assert not good.messages and good.values["end_points"] == 2


def test_bad_shapes_and_options():
    ball = closed_forms.icosphere(2)
    for option in (
        {"pairs": 0}, {"pairs": 2.5}, {"size": 16}, {"size": "x"}, {"angle": 0.0}, {"angle": 91.0},
        {"saliency": -1},
    ):  # fmt: skip
        with pytest.raises(medialis.InvalidOptionError, match=next(iter(option))):
            medialis.view_curve_skeleton(ball, **option)
    with pytest.raises(medialis.InvalidShapeError, match="are the same"):
        medialis.view_curve_skeleton(Shape(np.ones((4, 3)), np.zeros((4, 3)), [[0, 1, 2]]))
    flat = Shape([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.zeros((3, 3)), [[0, 1, 2]])
    with pytest.raises(medialis.InvalidShapeError, match="No curve skeleton is left"):
        medialis.view_curve_skeleton(flat, **QUICK)


def test_bad_views():
    shape = closed_forms.icosphere(2)
    source = medialis.rasterizer(shape)

    def pair(angle=20.0, size=64, radius=1.0):
        ((a, b),) = camera_pairs(np.zeros(3), radius, pairs=1, angle=math.radians(angle), size=size)
        return tuple(source([a, b]))

    first, _ = pair()
    for views, why in (
        ([], "at least one pair"),
        ([(first,)], "at least one pair"),
        ([(first, 3)], "at least one pair"),
        ([pair(), pair(size=32)], "same size"),
        ([(first, pair(radius=1.2)[1])], "same center and extent"),
        ([(first, pair(radius=0.5)[1])], "same center and extent"),
        ([pair(radius=0.9)], "border"),
    ):
        with pytest.raises(medialis.InvalidShapeError, match=why):
            medialis.view_curve_skeleton(views)
    with pytest.raises(medialis.InvalidOptionError, match="1 to 90 degrees"):
        medialis.view_curve_skeleton([(first, first)])
    turned = medialis.OrthographicCamera(
        first.camera.center, first.camera.axes[[1, 0, 2]], first.camera.extent, 64
    )
    with pytest.raises(medialis.InvalidShapeError, match="up-axes"):
        medialis.view_curve_skeleton([(first, source([turned])[0])])
    for wrong in (lambda cameras: [], lambda cameras: [first] * len(cameras)):
        with pytest.raises(medialis.InvalidShapeError, match="view source must return"):
            medialis.view_curve_skeleton(shape, pairs=2, size=32, source=wrong)


def test_cancelling():
    def stop(fraction, text):
        return text != "sharpen"

    with pytest.raises(medialis.Cancelled):
        medialis.view_curve_skeleton(closed_forms.icosphere(2), progress=stop, **QUICK)
    assert GivenViews([])([]) == []


def test_clouds_that_fill_a_volume_are_linked_coarsely():
    """With saliency 0 a nested ball had 195,000 nodes in 300 pieces: 42 s to join them (fixed)."""
    from medialis.curves.from_views.linking import link_points, merge_to

    points = np.random.default_rng(0).random((60_000, 3))
    weights = np.full(len(points), 20.0)
    merged, weight, cell = merge_to(points, weights, 0.02, 2000)
    assert 1000 < len(merged) <= 2000 and 0.02 < cell < 0.2
    np.testing.assert_allclose(weight.sum(), weights.sum())
    few = merge_to(points[:500], weights[:500], 0.02, 2000)
    assert few[2] == 0.02  # as fine as asked for where that is few enough
    asked = []

    def measure(places):
        asked.append(len(places))
        return np.minimum(places, 1 - places).min(axis=1).clip(0)

    link_points(points, weights, 0.02, measure, most=2000)
    assert asked[0] < 3000  # another grid of the same cells; 27,000 cells of 0.02 hold points


@pytest.mark.parametrize("kind", ["closed", "turned", "open", "doubled"])
def test_outlines_give_the_silhouette_of_all_triangles(kind):
    """Whatever meets at an edge: the same skeleton."""
    shape = medialis.organic_shape(56)
    faces = np.array(shape.faces)
    rng = np.random.default_rng(0)
    if kind == "turned":  # neighbours face different ways
        some = rng.random(len(faces)) < 0.3
        faces[some] = faces[some][:, ::-1]
    elif kind == "open":
        faces = faces[rng.random(len(faces)) < 0.7]
    elif kind == "doubled":  # four triangles at an edge
        faces = np.concatenate([faces, faces[: len(faces) // 2]])
    triangles = medialis.Rasterizer(shape.points, np.ascontiguousarray(faces))
    canvas = Canvas(triangles, 128)
    center, radius = sphere_of(shape.points)
    for _, camera in camera_pairs(center, radius, pairs=3, angle=0.3, size=128):
        whole = skeletonize(canvas.first(camera).runs, 1.0, canvas.scratch)
        outline = skeletonize(canvas.second(camera), 1.0, canvas.scratch)
        assert len(whole.column) > 50 and (whole.begin == outline.begin).all()
        assert (whole.column == outline.column).all()
