"""Parts as people see them: known bodies, copies, odd input, and slow oracles of each step."""

import json

import numpy as np
import pytest
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

import bodies
import closed_forms as forms
import medialis
from clouds import adjusted_rand
from medialis.base.threads import thread_limit
from medialis.segments.parts import MOST_SURE, PartsOptions, into_valleys, part_persistence
from medialis.segments.sites import (
    CAP,
    NAMES,
    WEIGHTS,
    all_placements,
    divide_sites,
    even_places,
    join_tree,
    mean_quantities,
    pair_quantities,
    principal_axes,
    share_together,
)


def hammer(cell=0.05):
    """A head across the end of a shaft."""

    def field(at):
        head = bodies.rounded_box(at, (0, 0, 1.5), (0.7, 0.35, 0.35), 0.08)
        return bodies.joined([head, bodies.rod(at, (0, 0, 0), 0.16, 1.5)], 0.01)

    shape = bodies.meshed(field, (-0.7, -0.35, -1.5), (0.7, 0.35, 1.85), cell)
    return shape, np.where(shape.points[:, 2] > 1.1, 0, 1)


def bolt(cell=0.05):
    """A flat wide head on a shaft."""

    def field(at):
        head = bodies.rod(at, (0, 0, 1.2), 0.7, 0.22)
        return bodies.joined([head, bodies.rod(at, (0, 0, 0), 0.33, 1.2)], 0.01)

    shape = bodies.meshed(field, (-0.7, -0.7, -1.2), (0.7, 0.7, 1.42), cell)
    return shape, np.where(shape.points[:, 2] > 0.93, 0, 1)


def table(cell=0.05):
    """A plate on four legs."""
    feet = [(x, y) for x in (-1.0, 1.0) for y in (-0.6, 0.6)]

    def field(at):
        top = bodies.rounded_box(at, (0, 0, 1), (1.25, 0.85, 0.1), 0.04)
        legs = [bodies.rod(at, (x, y, 0.45), 0.13, 0.5) for x, y in feet]
        return bodies.joined([top, *legs], 0.01)

    shape = bodies.meshed(field, (-1.25, -0.85, -0.05), (1.25, 0.85, 1.1), cell)
    leg = np.argmin([np.hypot(*(shape.points[:, :2] - foot).T) for foot in feet], axis=0)
    return shape, np.where(shape.points[:, 2] > 0.85, 0, 1 + leg)


def mug(cell=0.05):
    """A cup with a wall, and its handle."""

    def field(at):
        wall = bodies.without(
            bodies.rod(at, (0, 0, 0), 0.8, 0.9), bodies.rod(at, (0, 0, 0.2), 0.66, 0.9)
        )
        ring = np.hypot(np.hypot(at[..., 0] - 0.8, at[..., 2]) - 0.5, at[..., 1]) - 0.11
        outside = 0.74 - np.hypot(at[..., 0], at[..., 1])
        return bodies.joined([wall, -bodies.joined([-ring, -outside], 0.01)], 0.01)

    shape = bodies.meshed(field, (-0.8, -0.8, -0.9), (1.42, 0.8, 0.9), cell)
    x, y, _ = shape.points.T
    return shape, np.where(np.hypot(x, y) > 0.8 + 1e-3, 1, 0)


def dumbbell(step=0.06):
    shape = forms.dumbbell(ball=1.0, bar=0.3, half=2.0, step=step)
    neck = 2.0 - np.sqrt(1 - 0.3**2)
    return shape, np.digitize(shape.points[:, 2], [-neck, neck])


@pytest.mark.slow
@pytest.mark.parametrize("body", [dumbbell, hammer, table, mug, bolt])
def test_known_bodies(body):
    """Borders lie within a spacing of the sites, the root of 0.2 % of the area, of true ones."""
    shape, truth = body()
    found = medialis.parts(medialis.surface_skeleton(shape)).labels[: shape.point_count]
    spacing = np.sqrt(shape.area / 500)
    others = cKDTree(shape.points).query_ball_point(shape.points, spacing)
    clear = np.array([len(np.unique(truth[rows])) == 1 for rows in others])
    assert len(np.unique(found)) == len(np.unique(truth))
    assert adjusted_rand(found[clear], truth[clear]) > 0.97


@pytest.mark.slow
def test_same_parts_turned_scaled_reordered_and_on_one_thread():
    shape = medialis.organic_shape(72)
    labels = medialis.run("parts", shape).layers[0].attributes["parts"]
    rng = np.random.default_rng(3)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    order = rng.permutation(shape.point_count)
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    copies = (
        medialis.make_shape(shape.points @ turn.T, shape.faces),
        medialis.make_shape(shape.points * 1e-3 + 5.0, shape.faces),
        medialis.make_shape(shape.points[order], place[shape.faces]),
    )
    for k, copy in enumerate(copies):
        other = medialis.run("parts", copy).layers[0].attributes["parts"][: shape.point_count]
        assert adjusted_rand(labels[order] if k == 2 else labels, other) >= 0.97
    with thread_limit(1), medialis.memory_limit(0):
        again = medialis.run("parts", shape).layers[0].attributes["parts"]
    assert (again == labels).all()


@pytest.mark.slow
def test_faces_in_four_change_little():
    """The surface stays the same; samples and balls become more."""
    shape = table()[0]
    middle = shape.points[shape.edges].mean(axis=1)
    number = {tuple(e): shape.point_count + k for k, e in enumerate(shape.edges.tolist())}
    quarters = []
    for a, b, c in shape.faces.tolist():
        ab, bc, ca = (number[tuple(sorted(pair))] for pair in ((a, b), (b, c), (c, a)))
        quarters += [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
    split = medialis.make_shape(np.concatenate([shape.points, middle]), quarters)
    labels, others = (
        medialis.run("parts", one).layers[0].attributes["parts"][: shape.point_count]
        for one in (shape, split)
    )
    assert adjusted_rand(labels, others) >= 0.9


def test_persistence_is_the_odds_in_those_of_the_level_or_the_area():
    """A fourth put parts 0 and 1 together, half 0 and 2; 2 has the smallest area there may be."""
    between = np.array([[0.9, 0.25, 0.5], [0.25, 0.9, 0.1], [0.5, 0.1, 0.8]])
    areas = np.array([0.8, 0.19, 0.01])
    found = part_persistence(between, areas, PartsOptions())
    np.testing.assert_allclose(found, [1.0, 3.0, 1.0])
    at_three_fourths = part_persistence(between, areas, PartsOptions(level=0.75, smallest=0.0))
    np.testing.assert_allclose(at_three_fourths, [3.0, 9.0, 3.0])
    alone = part_persistence(np.array([[0.7]]), np.ones(1), PartsOptions(smallest=0.0))
    assert alone == pytest.approx([MOST_SURE])


def test_persistence_of_a_result_is_that_of_its_vertices_and_survives_a_file(tmp_path):
    """A dumbbell: two balls that are large and apart, and its handle, which is less of both."""
    result = medialis.run("parts", forms.dumbbell(step=0.08))
    sure = np.array(result.values["persistence"])
    assert len(sure) == result.values["parts"] == 3 and (sure > 1.0).all()
    labels = result.layers[0].attributes["parts"]
    assert (result.layers[0].attributes["persistence"] == sure[labels]).all()
    medialis.write_result(result, tmp_path)
    assert b"property double persistence" in (tmp_path / "parts.ply").read_bytes()[:2000]
    told = json.loads((tmp_path / "manifest.json").read_text(encoding="utf-8"))["values"]
    assert told["persistence"] == sure.tolist()
    cloud = medialis.surface_skeleton(forms.dumbbell(step=0.08))
    assert medialis.parts(cloud, count=2).persistence.shape == (2,)
    assert medialis.parts(cloud, method="sheets").persistence is None


@pytest.mark.slow
def test_level_and_count_and_the_tree():
    """More at a higher level; so many as asked for; fewer by whole parts."""
    cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    counts = [medialis.parts(cloud, level=level, smallest=0).count for level in (0.1, 0.5, 0.9)]
    assert counts == sorted(counts) and counts[0] < counts[2]
    found = medialis.parts(cloud)
    assert (np.diff(found.join_levels) <= 0).all()
    assert len(found.joins) == found.count - 1  # it is connected
    for count in range(1, found.count + 1):
        fewer = found.joined(count)
        assert fewer.count == count and (np.diff(fewer.areas) <= 0).all()
        assert fewer.areas.sum() == pytest.approx(found.areas.sum())
        assert len(np.unique(np.stack([fewer.labels, found.labels]), axis=1).T) == found.count
        assert len(fewer.joins) == count - 1
    for count in (2, 4, 6):
        assert medialis.parts(cloud, count=count, smallest=0.001).count == count


def test_trees_and_wrong_input():
    shape = forms.cube()
    labels = np.arange(shape.point_count) % 4
    tree = {"joins": [[1, 3], [0, 1]], "join_levels": [0.4, 0.2]}
    found = medialis.Segmentation(labels, surface=shape, **tree)
    assert (
        found.joined(3).labels[labels == 3].tolist() == found.joined(3).labels[labels == 1].tolist()
    )
    assert found.joined(2).count == found.joined(1).count == 2  # 2 is joined with none
    assert medialis.Segmentation(labels, surface=shape).joined(1).count == 4
    with pytest.raises(medialis.InvalidShapeError, match="join_levels"):
        medialis.Segmentation(labels, surface=shape, joins=[[0, 1]], join_levels=[])
    with pytest.raises(medialis.InvalidOptionError, match="level"):
        medialis.parts(medialis.surface_skeleton(forms.icosphere(2)), level=1.0)


@pytest.mark.slow
def test_simple_bodies_are_one_part():
    for shape in (forms.icosphere(3), forms.torus_mesh()):
        assert medialis.parts(medialis.surface_skeleton(shape)).count == 1


@pytest.mark.slow
def test_separate_bodies_are_separate_parts():
    ball = forms.icosphere(2)
    apart = np.concatenate([ball.points, ball.points + np.array([3.0, 0, 0])])
    faces = np.concatenate([ball.faces, ball.faces + ball.point_count])
    found = medialis.parts(medialis.surface_skeleton(medialis.make_shape(apart, faces)))
    assert found.count == 2 and len(found.joins) == 0
    assert len(np.unique(found.labels[: ball.point_count])) == 1


def test_sites_are_the_same_on_any_mesh_of_a_surface():
    """Faces that are split lie in the same planes: the lines cross them in the same places."""
    coarse = medialis.organic_shape(56)
    fine = medialis.refine(coarse, longest_edge=0.012)
    places, normals = even_places(coarse, 400)
    others, _ = even_places(fine, 400)
    assert 350 < len(places) < 450 and fine.face_count > coarse.face_count
    assert np.allclose(places, others, atol=1e-6 * coarse.diagonal)
    assert np.allclose(np.linalg.norm(normals, axis=1), 1)
    nearest = cKDTree(places).query(places, k=2)[0][:, 1]
    assert np.median(nearest) > 0.6 * np.sqrt(coarse.area / 400)


def test_principal_axes_of_a_box():
    middle, axes = principal_axes(forms.box_mesh((1.0, 0.8, 0.6), 0.3))
    assert np.allclose(middle, forms.box_mesh((1.0, 0.8, 0.6), 0.3).points.mean(axis=0))
    assert np.allclose(np.abs(axes), np.eye(3)[:, ::-1])


def test_caps_against_plain_searches():
    """Shares of a sample add up to 1, and each cap ends at its radius along the edges."""
    shape = forms.torus_mesh(40, 20)
    sites = all_placements(medialis.shrink_balls(shape), 50, 1)[0]
    assert np.allclose(sites.shares.sum(axis=1), 1)
    points = shape.points / shape.diagonal
    assert sites.areas.sum() == pytest.approx(shape.area / shape.diagonal**2)
    assert np.allclose(sites.overlaps.sum(axis=1), sites.areas)
    length = shape.edge_matrix.tocoo()
    length.data = np.linalg.norm(points[length.row] - points[length.col], axis=1)
    radius = CAP * sites.spacing
    for site in range(0, len(sites), 7):
        column = sites.shares[:, [site]].toarray().ravel()
        inside = np.flatnonzero(column)
        away = dijkstra(length.tocsr(), indices=inside)
        # Its start is the sample that is nearest to all others, within a radius of the farthest.
        start = away[:, inside].max(axis=1).argmin()
        assert away[start, inside].max() < 1.35 * radius
        assert set(np.flatnonzero(away[start] < 0.5 * radius)) <= set(inside)
    assert (np.abs(sites.radii * shape.diagonal / 0.3 - 1) < 0.05).all()


def test_quantities_of_a_ball():
    """A ball bends outwards, and its radius is the same everywhere."""
    cloud = medialis.shrink_balls(forms.icosphere(4))
    sites = all_placements(cloud, 80, 1)[0]
    quantities = dict(zip(NAMES, pair_quantities(sites), strict=True))
    assert len(WEIGHTS) == len(NAMES) == len(quantities)
    for found in quantities.values():
        assert found.shape == (len(sites), len(sites)) and np.allclose(found, found.T, atol=1e-9)
    assert quantities["radius"].max() < 0.05
    # 0.01 of a spacing along the way, half the girth at most: 0.01 * sqrt(80 pi) / 2.
    assert quantities["bends"].max() < np.log1p(3 * 0.01 * 1.2 * np.sqrt(80 * np.pi) / 2)
    assert np.allclose(quantities["heat"], quantities["held"], atol=0.01)
    assert (quantities["heat_late"] >= quantities["heat_early"] - 0.01).all()
    shares = share_together([sites], cloud.surface.point_areas)
    assert ((shares > 0) & (shares < 1)).all()


@pytest.mark.slow
def test_means_over_placements_differ_less_than_single_ones():
    """On a surface turned against its lines: four placements halve what depends on the lines."""
    first = forms.box_mesh((1.0, 1.0, 1.0), 0.05)  # no axes of its own
    turn = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
    clouds = [medialis.shrink_balls(first)]
    clouds.append(medialis.shrink_balls(medialis.make_shape(first.points @ turn.T, first.faces)))
    placed = [all_placements(cloud, 150) for cloud in clouds]
    rows = np.arange(0, first.point_count, 7)

    def of_samples(placements, cloud):
        found = mean_quantities(placements, cloud.surface.point_areas)
        caps = placements[0].shares[rows]
        return np.stack([caps @ (caps @ one).T for one in found])

    away = [
        np.sqrt(np.mean((of_samples(placed[0][:k], clouds[0])
                         - of_samples(placed[1][:k], clouds[1])) ** 2, axis=(1, 2)))
        for k in (1, 4)
    ]  # fmt: skip
    held = NAMES.index("held")
    assert away[1][held] < 0.75 * away[0][held]


@pytest.mark.slow
def test_both_walls_of_a_plate_are_close():
    """Heat jumps across a thin plate: two places across it are closer than two side by side."""
    plate = forms.box_mesh((1.0, 1.0, 0.02), 0.05)
    sites = all_placements(medialis.shrink_balls(plate), 300, 1)[0]
    quantities = dict(zip(NAMES, pair_quantities(sites), strict=True))
    inner = np.abs(sites.places - sites.places.mean(axis=0)).max(axis=1) < 0.25
    across = sites.across * inner[:, None] * inner[None, :]
    np.fill_diagonal(across, 0)
    one, two = np.nonzero(across > 0.5 * across.max())
    beside = np.linalg.norm(sites.places[one] - sites.places[two], axis=1)
    apart = np.linalg.norm(sites.places[:, None] - sites.places[None], axis=2)
    far = (apart > 3 * sites.spacing) & inner[:, None] & inner[None, :]
    assert len(one) and beside.max() < sites.spacing
    for name in ("heat_early", "heat", "held"):
        assert quantities[name][one, two].min() > quantities[name][far].max()
    assert quantities["resistance"][one, two].max() < quantities["resistance"][far].min()


@pytest.mark.slow
def test_borders_lie_in_the_valley():
    """Two balls that run into each other: wherever labels change, borders go to the neck."""
    shape = forms.dumbbell(ball=1.0, bar=0.5, half=1.0, step=0.06)
    neck = 1.0 - np.sqrt(1 - 0.5**2)
    x, y, z = shape.points.T
    wave = 0.2 * np.sin(5 * np.arctan2(y, x))
    labels = np.digitize(z, [-neck, neck])
    wavy = np.where(z < -neck + wave, 0, np.where(z < neck + wave, 1, 2)).astype(np.int32)
    drawn = into_valleys(shape, wavy, 0.3)
    clear = np.abs(np.abs(z) - neck) > 2 * 0.06
    assert (drawn == labels)[clear].all()
    assert (wavy != labels)[clear].mean() > 0.01
    assert (into_valleys(shape, np.zeros_like(wavy), 0.3) == 0).all()
    finer = medialis.refine(shape, longest_edge=0.01)
    assert finer.point_count > 2 * shape.point_count
    nearest = cKDTree(shape.points).query(finer.points)[1]
    clear = np.abs(np.abs(finer.points[:, 2]) - neck) > 2 * 0.06
    again = into_valleys(finer, wavy[nearest], 0.3)
    assert (again == labels[nearest])[clear].all()


def slow_linkage(shares, areas, level):
    """Join the two clusters with the largest mean share until none has the level."""
    clusters = [[i] for i in range(len(areas))]
    while len(clusters) > 1:
        best, pair = 0.0, None
        for i, one in enumerate(clusters):
            for j in range(i + 1, len(clusters)):
                weights = np.outer(areas[one], areas[clusters[j]])
                mean = (weights * shares[np.ix_(one, clusters[j])]).sum() / weights.sum()
                if mean > best:
                    best, pair = mean, (i, j)
        if pair is None or best < level:
            break
        clusters[pair[0]] += clusters.pop(pair[1])
    labels = np.empty(len(areas), int)
    for k, one in enumerate(clusters):
        labels[one] = k
    return labels


def agreement(shares, areas, labels, level):
    same = labels[:, None] == labels[None, :]
    np.fill_diagonal(same, False)
    return (np.outer(areas, areas) * (shares - level))[same].sum()


@pytest.mark.parametrize("seed", range(4))
def test_clusters_against_a_slow_oracle(seed):
    rng = np.random.default_rng(seed)
    truth = rng.integers(0, 4, 30)
    shares = np.clip(
        0.65 * (truth[:, None] == truth[None, :]) + rng.uniform(0, 0.35, (30, 30)), 0, 1
    )
    shares = (shares + shares.T) / 2
    areas = rng.uniform(0.5, 1.5, 30)
    pairs, joined = join_tree(shares, areas)
    assert len(pairs) == 29 and (np.diff(joined) <= 0).all()
    for level in (0.3, 0.5, 0.7):
        slow = slow_linkage(shares, areas, level)
        assert (joined >= level).sum() == 30 - len(np.unique(slow))
        found = divide_sites(shares, areas, level)
        gain = agreement(shares, areas, found, level) - agreement(shares, areas, slow, level)
        assert gain >= -1e-12  # moves never lower it
    assert adjusted_rand(divide_sites(shares, areas, 0.5), truth) == 1.0
    for count in (1, 2, 5):
        assert divide_sites(shares, areas, 0.5, count).max() + 1 == count


def test_shares_of_zero_are_never_joined():
    shares = np.kron(np.eye(3), np.full((2, 2), 0.9))
    assert divide_sites(shares, np.ones(6), 0.02, count=1).max() == 2
    assert len(join_tree(np.zeros((0, 0)), np.zeros(0))[0]) == 0


@pytest.mark.slow
@pytest.mark.parametrize("shape", [
    medialis.make_shape(np.eye(4, 3, -1), [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]),
    forms.cube(),
    medialis.make_shape(forms.icosphere(1).points * [1, 1, 1e-3], forms.icosphere(1).faces),
    medialis.make_shape(forms.icosphere(1).points * 1e-29, forms.icosphere(1).faces),
    medialis.make_shape(forms.icosphere(1).points * 1e29, forms.icosphere(1).faces),
])  # fmt: skip
def test_tiny_flat_and_simple_shapes_have_parts(shape):
    for refine in (0.1, 0.02):
        result = medialis.run("parts", shape, refine=refine)
        assert result.values["parts"] >= 1 and result.values["method"] == "auto"


@pytest.mark.parametrize("size", [60, 400])
def test_distances_within_a_radius_agree_with_scipy(size):
    """All vertices are linked and links are no distances, so that each is reached again and again:
    the lists are full many times over."""
    from scipy.sparse import csr_array

    from medialis.segments._kernels import Graph, far_from, near_sites

    length = np.triu(np.random.default_rng(0).exponential(size=(size, size)) ** 8, 1)
    length += length.T
    matrix = csr_array(length)
    given = matrix.indptr.astype(np.int64), matrix.indices.astype(np.int32), matrix.data
    radius, starts = 0.8 * float(dijkstra(matrix, indices=0).max()), np.array([3, 7], np.int32)
    away, counts, gaps = np.full(size, np.inf), np.zeros(2, np.int64), np.array([0.0, radius / 9])
    far_from(starts, Graph(*given), radius, away)
    slow = dijkstra(matrix, indices=starts)
    assert np.allclose(away, np.where(slow.min(axis=0) < radius, slow.min(axis=0), np.inf))
    vertices, far = near_sites(0, 2, Graph(*given), starts, gaps, radius, counts)
    for site, rows in enumerate(np.split(np.arange(counts.sum()), counts[:1])):
        expected = slow[site] + gaps[site]
        assert sorted(vertices[rows]) == np.flatnonzero(expected < radius).tolist()
        assert np.allclose(far[rows], expected[vertices[rows]])
    assert (slow < radius).any() and (slow > radius).any()
