"""Geodesic importance, thresholding, local measures."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

import closed_forms as forms
import medialis
from medialis.base.errors import InvalidOptionError, InvalidShapeError
from medialis.base.progress import Progress
from medialis.skeleton.importance._strip_kernels import (
    PLACES,
    make_room,
    straighten,
    walk_beside,
    write_trail,
)
from medialis.skeleton.importance._walk_kernels import record_cut
from medialis.skeleton.importance.geodesics import PathStatus, cut_by_planes, surface_walk, trace
from medialis.skeleton.importance.importance import relax


def test_importance_of_a_flat_box_is_the_path_round_its_rim():
    """In the middle sheet of a plate the importance is the path round the nearest rim.

    Both feature points lie above each other, at distance d from the nearest rim of a plate of
    thickness t: straight over the edge, 2 d + t. The balls of samples touch samples, so the second
    feature point may be off by one spacing h (two, up and down).
    """
    shape = forms.box_mesh((2.0, 1.6, 0.2), 0.05)
    cloud = medialis.shrink_balls(shape, tolerance=0)
    paths = medialis.geodesic_importance(cloud)
    low, high = shape.bounds
    top = np.abs(shape.points[:, 2] - high[2]) < 1e-12
    rim = np.minimum(shape.points - low, high - shape.points)[:, :2].min(axis=1)
    middle = top & (rim > 0.3)
    expected = 2 * rim[middle] + 0.2
    h = 0.05
    assert middle.sum() > 200
    assert (np.abs(paths.length[middle] - expected) <= 2 * math.sqrt(2) * h + 1e-3).all()


def test_sphere_importance_is_the_arc_between_the_features():
    shape = forms.icosphere(4)
    cloud = medialis.shrink_balls(shape)
    paths = medialis.geodesic_importance(cloud)
    ends = shape.points[cloud.features]
    angle = np.arccos(np.clip(np.einsum("ij,ij->i", ends[:, 0], ends[:, 1]), -1, 1))
    assert np.allclose(paths.length, angle, rtol=0.01)


def test_threshold_selects_without_recomputation():
    shape = forms.icosphere(1)
    importance = medialis.geodesic_importance(medialis.shrink_balls(shape).subset(np.arange(5)))
    values = np.array([0.0, 0.1, 0.5, np.inf, np.nan]) * shape.diagonal
    importance = replace(importance, length=values)
    for threshold, wanted in ((0, [1, 1, 1, 1, 0]), (0.1, [0, 1, 1, 1, 0]), (1, [0, 0, 0, 1, 0])):
        mask = medialis.important_points(importance, threshold=threshold)
        assert mask.tolist() == [bool(one) for one in wanted]
    for bad in (-0.1, math.nan, 11):
        with pytest.raises(InvalidOptionError, match="threshold"):
            medialis.important_points(importance, threshold=bad)


@pytest.mark.slow
def test_thresholding_removes_noise_and_keeps_the_body():
    """Noise of 0.2 % of the size makes balls everywhere; the important ones lie where the clean
    skeleton is: within the noise amplitude over the sine of a reliable spoke angle, some 1 %."""
    from scipy.spatial import cKDTree

    clean = forms.box_mesh((1.0, 0.8, 0.6), 0.03)
    step = np.random.default_rng(0).normal(size=clean.point_count) * 0.002 * clean.diagonal
    noisy = medialis.make_shape(clean.points + step[:, None] * clean.normals, clean.faces)
    cloud, truth = medialis.shrink_balls(noisy), medialis.shrink_balls(clean)
    tree = cKDTree(truth.centers[truth.valid])
    cloud = cloud.subset(cloud.valid)
    paths = medialis.geodesic_importance(cloud)
    kept = medialis.important_points(paths, threshold=0.3)
    off = tree.query(cloud.centers)[0] / clean.diagonal
    assert kept.sum() > 100
    assert np.quantile(off[kept], 0.9) < 0.03
    assert np.quantile(off[kept], 0.9) < 0.7 * np.quantile(off, 0.9)


def test_local_measures():
    shape = forms.icosphere(3)
    cloud = medialis.shrink_balls(shape, side="both")
    measures = medialis.local_measures(cloud)
    valid = cloud.valid
    for values in measures.values():
        assert values.shape == (len(cloud),) and (np.isnan(values) == ~valid).all()
    half = np.sin(measures["spoke_angle"][valid] / 2)
    assert np.allclose(measures["radius_ratio"][valid], half, atol=1e-9)
    assert np.allclose(measures["feature_radius"][valid], cloud.radii[valid] * half, atol=1e-9)


def test_clouds_are_told_what_to_use_instead():
    sphere = forms.sphere(200).shape
    with pytest.raises(InvalidShapeError, match="local measures"):
        medialis.geodesic_importance(medialis.shrink_balls(sphere))
    with pytest.raises(InvalidShapeError, match="spoke angle"):
        medialis.run("skeleton_importance", sphere)


@pytest.mark.slow
def test_operation_thresholds_and_reports():
    shape = medialis.organic_shape(64)
    full = medialis.run("skeleton_importance", shape)
    some = medialis.run("skeleton_importance", shape, threshold=0.05)
    assert some.values["skeleton_points"] == full.values["points_above_percent"]["5"]
    assert some.layers[0].attributes["importance"].min() >= 0.05 * some.shape.diagonal
    with pytest.raises(InvalidShapeError, match="Lower the threshold"):
        medialis.run("skeleton_importance", shape, threshold=5)


def test_geodesic_operation_names_input_vertices():
    points = np.vstack([[9.0, 9, 9], forms.cube().points])
    shape = medialis.make_shape(points, forms.cube().faces + 1, repair=True)
    result = medialis.run("geodesic_path", shape, start=1, end=8)
    assert (result.layers[0].points[[0, -1]] == points[[1, 8]]).all()
    with pytest.raises(InvalidOptionError, match="Vertex 0 is used by no face"):
        medialis.run("geodesic_path", shape, start=0, end=8)
    with pytest.raises(InvalidOptionError, match=r"numbered 0\.\.8, got 9"):
        medialis.run("geodesic_path", shape, start=1, end=9)


@pytest.mark.slow
def test_skeleton_mesh_is_simplified_by_importance():
    shape = medialis.organic_shape(100)
    plain = medialis.run("skeleton_mesh", shape, min_spoke_angle=0)
    some = medialis.run("skeleton_mesh", shape, min_spoke_angle=0, importance=0.05)
    assert some.values["kept_points"] < plain.values["kept_points"]
    least = 0.05 * some.shape.diagonal
    assert (some.arrays["importance"][some.arrays["selected"]] >= least).all()
    values = some.layers[0].attributes["importance"]
    assert (values >= 0.95 * least).all()  # at rims a mean of balls, with weights below 0
    with pytest.raises(InvalidShapeError, match="importance of 9"):
        medialis.run("skeleton_mesh", shape, importance=9)


def test_geodesics_of_a_list_of_pairs(tmp_path):
    shape = forms.icosphere(2)
    (tmp_path / "pairs.txt").write_text("0 5  # first\n\n3, 7\n2 2\n")
    result = medialis.run("geodesic_path", shape, pairs=str(tmp_path / "pairs.txt"))
    expected = [path.length for path in medialis.geodesics(shape, [[0, 5], [3, 7], [2, 2]])]
    assert (result.arrays["length"] == expected).all() and result.values["pairs"] == 3
    layer = result.layers[0]
    for row, length in enumerate(expected):
        mine = layer.attributes["pair"] == row
        assert layer.attributes["distance"][mine].max() == pytest.approx(length, abs=1e-12)
    same = layer.attributes["pair"][layer.edges]
    assert (same[:, 0] == same[:, 1]).all()
    for text, told in (("1 2 3", "Line 1"), ("a b", "two vertex numbers"), ("# none", "no pair")):
        (tmp_path / "bad.txt").write_text(text)
        with pytest.raises(InvalidOptionError, match=told):
            medialis.run("geodesic_path", shape, pairs=str(tmp_path / "bad.txt"))
    with pytest.raises(medialis.FileError, match="there is no such file"):
        medialis.run("geodesic_path", shape, pairs=str(tmp_path / "missing.txt"))
    with pytest.raises(InvalidOptionError, match="path of a file"):
        medialis.run("geodesic_path", shape, pairs=7)


def dumbbell():
    """Two boxes joined by a thin bar: the small box is an island at high thresholds."""
    # Sections along x: half width at each; a chain of frusta with square cross-sections.
    x = np.array([0, 0.1, 1.4, 1.5, 2.5, 2.6, 3.3, 3.4])
    half = np.array([0.3, 0.5, 0.5, 0.1, 0.1, 0.35, 0.35, 0.2])
    ring = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    points = np.concatenate([np.c_[np.full(4, a), h * ring] for a, h in zip(x, half, strict=True)])
    faces = []
    for i in range(len(x) - 1):
        for j in range(4):
            a, b = 4 * i + j, 4 * i + (j + 1) % 4
            faces += [(a, b, b + 4), (a, b + 4, a + 4)]
    last = len(points) - 4
    faces += [(0, 2, 1), (0, 3, 2), (last, last + 1, last + 2), (last, last + 2, last + 3)]
    shape = medialis.make_shape(points, faces, repair=True)
    return forms.refined(shape, 0.05)


def pieces(shape, cloud, kept):
    """Oracle: pieces of the kept points under all links that the docstring allows."""
    n = shape.point_count
    one = coo_array((np.ones(len(shape.edges)), shape.edges.T), shape=(n, n)).tocsr()
    one = one + one.T
    near = (one + one @ one + one @ one @ one).tocoo()
    links = np.concatenate([np.column_stack([near.row, near.col]), cloud.features[cloud.valid]])
    gap = np.linalg.norm(cloud.centers[links[:, 0]] - cloud.centers[links[:, 1]], axis=1)
    links = links[kept[links].all(axis=1) & (gap <= 0.02 * shape.diagonal)]
    graph = coo_array((np.ones(len(links)), links.T), shape=(n, n))
    return connected_components(graph, directed=False)[0] - np.count_nonzero(~kept)


@pytest.mark.slow
def test_connected_importance_leaves_one_piece_at_every_threshold():
    shape = dumbbell()
    cloud = medialis.shrink_balls(shape)
    importance = medialis.geodesic_importance(cloud)
    plain, lowered = importance.length, medialis.connected_importance(importance).length
    assert (np.isnan(lowered) == np.isnan(plain)).all()
    torn = 0
    for threshold in np.quantile(plain[cloud.valid], np.linspace(0.05, 0.95, 12)):
        torn += pieces(shape, cloud, plain >= threshold) > 1
        assert pieces(shape, cloud, lowered >= threshold) == 1
    assert torn > 3  # the small box is an island without it
    # Both boxes are large: they stay, and only the bridge between them is raised.
    raised = lowered > plain
    assert 0 < raised.sum() < 0.1 * len(cloud)
    bar = (cloud.centers[:, 0] > 1.2) & (cloud.centers[:, 0] < 2.9)
    assert bar[raised].mean() > 0.5
    small = shape.points[:, 0] > 2.7
    assert (lowered[small] == plain[small]).mean() > 0.8


@pytest.mark.slow
def test_connected_importance_keeps_the_sheets_of_rough_surfaces():
    """Most neighbours of a good ball belong to noise: alone among them, each was an island."""
    clean = medialis.organic_shape(100)
    step = np.random.default_rng(0).normal(size=clean.point_count) * 0.0016 * clean.diagonal
    shape = medialis.make_shape(clean.points + step[:, None] * clean.normals, clean.faces)
    cloud = medialis.shrink_balls(shape)
    importance = medialis.geodesic_importance(cloud)
    plain, connected = importance.length, medialis.connected_importance(importance).length
    good = plain >= 0.05 * shape.diagonal
    assert 0.03 < good.mean() < 0.15  # most balls belong to noise
    assert (connected[good] >= 0.05 * shape.diagonal).mean() > 0.9


def test_connected_importance_of_two_parts_keeps_both():
    one = forms.box_mesh((1.0, 0.8, 0.6), 0.1)
    points = np.vstack([one.points, one.points + 3])
    shape = medialis.make_shape(points, np.vstack([one.faces, one.faces + one.point_count]))
    cloud = medialis.shrink_balls(shape)
    importance = medialis.geodesic_importance(cloud)
    plain = importance.length
    lowered = medialis.connected_importance(importance, link=0.1).length
    n = one.point_count
    for part in (slice(0, n), slice(n, 2 * n)):
        # Both ends of the highest ridge are as high but for rounding.
        assert np.nanmax(lowered[part]) == pytest.approx(np.nanmax(plain[part]), rel=1e-12)


def test_connected_importance_refuses_what_it_cannot_link():
    shape = forms.icosphere(1)
    cloud = medialis.shrink_balls(shape)
    some = medialis.geodesic_importance(cloud.subset(np.arange(5)))
    with pytest.raises(InvalidShapeError, match="whole inner cloud"):
        medialis.connected_importance(some)
    with pytest.raises(InvalidOptionError, match="link"):
        medialis.connected_importance(medialis.geodesic_importance(cloud), link=0)


@pytest.mark.slow
def test_relaxation_is_the_shortest_path_through_neighbours():
    """Oracle: repeat over all links until nothing gets shorter (Bellman-Ford)."""
    shape = dumbbell()
    cloud = medialis.shrink_balls(shape)
    pairs = np.where(cloud.valid[:, None], cloud.features, -1)
    paths = medialis.geodesic_lengths(shape, pairs, directions=2)
    length = np.array(paths.length)
    length[np.flatnonzero(cloud.valid)[::7]] *= 3  # paths that a fold has led astray
    found = relax(cloud, replace(paths, length=length))
    edges = {tuple(e) for e in shape.edges.tolist()}
    links = []
    for i, j in shape.edges.tolist():
        if cloud.valid[i] and cloud.valid[j]:
            a, b = sorted((int(cloud.features[i, 1]), int(cloud.features[j, 1])))
            if a == b or (a, b) in edges:
                gap = np.linalg.norm(shape.points[i] - shape.points[j])
                links.append((i, j, gap + np.linalg.norm(shape.points[a] - shape.points[b])))
    expected = length.copy()
    for _ in range(len(expected)):
        before = expected.copy()
        for i, j, gap in links:
            expected[i] = min(expected[i], expected[j] + gap)
            expected[j] = min(expected[j], expected[i] + gap)
        if np.array_equal(before, expected, equal_nan=True):
            break
    assert np.allclose(found.length, expected, rtol=1e-8, equal_nan=True)
    changed = found.status == medialis.PathStatus.NEIGHBOUR
    assert changed.sum() > 0.1 * len(cloud)
    assert (found.length[~changed & cloud.valid] == length[~changed & cloud.valid]).all()
    tangents = {row.tobytes() for row in paths.start_tangent[cloud.valid]}
    assert all(row.tobytes() in tangents for row in found.start_tangent[changed])


@pytest.mark.slow
def test_importance_changes_no_faster_than_the_feature_points():
    shape = medialis.organic_shape(100)
    cloud = medialis.shrink_balls(shape, side="both")
    paths = medialis.geodesic_importance(cloud)
    inner = cloud.side > 0
    a, b = shape.edges.T
    near = (cloud.features[a, 1] == cloud.features[b, 1]) & cloud.valid[a] & cloud.valid[b]
    step = np.linalg.norm(shape.points[a] - shape.points[b], axis=1)[near]
    change = np.abs(paths.length[inner][a] - paths.length[inner][b])[near]
    assert near.sum() > 1000 and (change <= step * (1 + 1e-6)).all()


def test_opposite_balls_have_one_path_in_both_directions():
    """The path from b to a is that from a to b, with its tangents turned round."""
    cloud = medialis.shrink_balls(forms.box_mesh((2.0, 1.6, 0.2), 0.05), tolerance=0)
    paths = medialis.geodesic_importance(cloud)
    row_of = {tuple(pair): row for row, pair in enumerate(cloud.features.tolist())}
    rows = [(row, row_of[b, a]) for (a, b), row in row_of.items() if (b, a) in row_of]
    one, other = np.array([(i, j) for i, j in rows if i < j]).T
    assert len(one) > 500
    plane = (paths.status[one] == PathStatus.PLANE) & (paths.status[other] == PathStatus.PLANE)
    one, other = one[plane], other[plane]
    assert len(one) > 400
    assert (paths.length[one] == paths.length[other]).all()
    assert (paths.start_tangent[one] == -paths.end_tangent[other]).all()


def tall_ring():
    """A torus stretched along its axis, on which geodesics bend sideways."""
    u, v = np.meshgrid(2 * np.pi * np.arange(72) / 72, 2 * np.pi * np.arange(36) / 36)
    reach = 1.0 + 0.45 * np.cos(v)
    points = np.stack([reach * np.cos(u), reach * np.sin(u), 0.9 * np.sin(v)], -1).reshape(-1, 3)
    at = np.arange(72 * 36).reshape(36, 72)
    right, up = np.roll(at, -1, axis=1), np.roll(at, -1, axis=0)
    both = np.roll(right, -1, axis=0)
    faces = np.concatenate(
        [np.stack(corners, -1) for corners in ((at, right, both), (at, both, up))]
    )
    return medialis.make_shape(points, faces.reshape(-1, 3))


def test_walks_beside_a_trail_need_little_shortening():
    """What a pair finds beside the path of another one is as short as what it finds by itself."""
    shape = tall_ring()
    walk = surface_walk(shape)
    points, corners, _, offsets, fan = walk
    pairs = np.random.default_rng(0).integers(shape.point_count, size=(300, 2)).astype(np.int32)
    normals = cut_by_planes(shape, pairs, 20, Progress()).normal
    room, trail = make_room(shape.face_count), np.empty((PLACES, 7))
    strip = np.empty(4096, np.int64)
    close, walked, beside = [], [], []
    for (start, end), normal in zip(pairs, normals, strict=True):
        count = record_cut(walk, start, end, normal, room.strips[0])
        straighten(walk, start, end, count, room)
        if not write_trail(points, shape.normals, room, trail):
            continue
        s, e = (corners[3 * (fan[offsets[i]] // 3) :][:3] for i in (start, end))
        s, e = s[s != start][0], e[e != end][0]
        moved = np.stack([points[s] - points[start], points[e] - points[end]])
        towards = room.near[0] - points[start]
        length, count = walk_beside(walk, s, e, trail, moved, towards, np.inf, strip)
        close.append([s, e])
        walked.append(length)
        room.strips[0, :count] = strip[:count]
        straight = straighten(walk, s, e, count, room)
        beside.append(straight if length < np.inf else np.inf)
    walked, beside = np.array(walked), np.array(beside)
    arrived = np.isfinite(walked)
    assert len(arrived) > 200
    assert arrived.mean() > 0.9
    walked, beside = walked[arrived], beside[arrived]
    alone = medialis.geodesic_lengths(shape, np.array(close)[arrived]).length
    assert (beside <= walked).all()
    assert np.median(walked / beside) < 1.01
    assert (beside < 1.001 * alone).mean() > 0.9


def test_paths_go_round_the_end_of_a_slit():
    """Plane cuts end at a slit in a tube, and lead all the way round it instead."""
    sides, rows, slit = 48, 24, 16
    turn = 2 * np.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    height = 0.13 * np.arange(rows)
    points = np.concatenate([np.column_stack([ring, np.full(sides, z)]) for z in height])
    at = np.arange(sides * rows).reshape(rows, sides)
    right = np.roll(at, -1, axis=1)
    quads = np.stack([at[:-1], right[:-1], right[1:], at[1:]], axis=-1)
    quads = np.concatenate([quads[:slit, 1:].reshape(-1, 4), quads[slit:].reshape(-1, 4)])
    shape = medialis.make_shape(points, np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]]))
    depth = np.arange(2, 7)
    ends = np.stack([at[slit - depth, 0], at[slit - depth, 1]], axis=1).astype(np.int32)
    length = trace(shape, ends, 20, True, Progress()).length
    exact = 2 * 0.13 * depth  # up one side and down the other
    gap = np.linalg.norm(points[0] - points[1])
    assert (length >= exact).all()
    assert (length <= exact + 1.5 * gap).all()
    assert (length[:-1] < 0.6 * 2 * np.pi).all()
