from dataclasses import replace

import numpy as np
import pytest

import medialis
from medialis.base.arrays import follow
from medialis.curves.curve_skeleton import CurveSkeleton
from medialis.curves.growth import (
    GraphTree,
    count_crossings,
    find_handles,
    grow_graph,
    link_balls,
    link_turns,
    span_loop,
)
from tubes import circle, segment, tube


def listed(pairs):
    pairs = np.asarray(pairs)
    return [(pairs[:, 0], pairs[:, 1:])]


def random_links(seed=0, k=300):
    random = np.random.default_rng(seed)
    centers, radii = random.uniform(size=(k, 3)), random.uniform(0.1, 0.3, k)
    pairs = random.integers(0, k, (6 * k, 2))
    return link_balls(centers, radii, random.uniform(size=k), [], listed(pairs), spacing=0.05)


def matrix(links):
    from scipy.sparse import csr_array

    k = len(links.radii)
    return csr_array((links.cost, links.neighbours, links.offsets), shape=(k, k))


def test_a_way_through_a_thick_body_is_no_dearer_than_one_along_thin_balls():
    """Links of a thick body are many spacings long. They cost more for it, so that the curve
    skeleton of a plump body went round its middle, along thin balls below the surface."""
    x = np.arange(11.0)
    thick = np.stack([0.25 * x, 0 * x, 0 * x], axis=1)
    thin = np.stack([0.01 * x, 5 + 0 * x, 0 * x], axis=1)
    pairs = np.stack([np.arange(21), np.arange(1, 22)], axis=1)
    links = link_balls(
        np.concatenate([thick, thin]),
        np.repeat([1.0, 0.03], 11),
        np.ones(22),
        listed(np.delete(pairs, 10, axis=0)),
        [],
        spacing=0.01,
    )
    price = links.cost / links.length
    assert price[links.length > 0.1].max() < price[links.length < 0.1].min()


def test_links_come_from_both_ends_once_and_near_ones_stay_in_both_balls():
    links = random_links()
    table = matrix(links).toarray()
    assert (table == table.T).all() and (table.diagonal() == 0).all()
    ends = np.repeat(np.arange(300), np.diff(links.offsets))
    assert len(np.unique(ends * 300 + links.neighbours)) == len(ends)
    near = link_balls(
        np.array([[0, 0, 0], [1, 0, 0], [3, 0, 0.0]]),
        np.array([1.1, 1.2, 9.0]),
        np.ones(3),
        listed([[0, 1], [1, 2], [2, 2]]),
        [],
        spacing=1.0,
    )
    assert near.neighbours.tolist() == [1, 0]  # 2 is outside the ball of 1


def test_the_search_agrees_with_scipy_also_when_sources_are_added():
    from scipy.sparse.csgraph import dijkstra

    links = random_links()
    grown, nodes = GraphTree(links), []
    for sources in ([3], [50, 60], [7]):
        grown.add(sources)
        nodes += sources
        slow = dijkstra(matrix(links), indices=nodes, min_only=True)
        assert np.allclose(grown.spent, slow, rtol=1e-12)
    for ball in (10, 100, 200):
        way = follow(grown.parent, ball)
        steps = np.linalg.norm(np.diff(links.centers[way], axis=0), axis=1)
        assert way[-1] == grown.base[ball] and steps.sum() == pytest.approx(grown.path[ball])


def test_costs_of_all_sizes_need_no_more_than_wider_buckets():
    """Some links cost a billionth of what others cost, and some a million times as much."""
    from scipy.sparse.csgraph import dijkstra

    links = random_links()
    ends = np.repeat(np.arange(len(links.radii)), np.diff(links.offsets))
    wild = links._replace(cost=links.cost * 10.0 ** ((ends + links.neighbours) % 16 - 9))
    grown = GraphTree(wild)
    grown.add([3])
    slow = dijkstra(matrix(wild), indices=[3], min_only=True)
    assert np.allclose(grown.spent, slow, rtol=1e-12)


def test_paths_of_targets_are_those_of_a_search_for_all():
    links, first = random_links(), GraphTree(random_links())
    first.add([3])
    targets = first.spent < np.quantile(first.spent, 0.2)
    grown, whole = GraphTree(links, targets), GraphTree(links)
    for sources in ([3], [50, 60], [7]):
        grown.add(sources)
        whole.add(sources)
        for name in ("spent", "path", "parent", "base"):
            assert np.array_equal(getattr(grown, name)[targets], getattr(whole, name)[targets])
        for ball in np.flatnonzero(targets):
            assert follow(grown.parent, int(ball)) == follow(whole.parent, int(ball))
    assert (grown.spent > whole.spent).any()  # and that of some others is not asked for


@pytest.mark.parametrize("gone", [[50], [50, 60, 7], [3, 50, 60, 7]])
def test_a_graph_without_some_balls_is_as_if_they_had_never_been_in_it(gone):
    """No two ways are as long here, so the answer is the same to the last digit."""
    links, nodes = random_links(), [3, 50, 60, 7, 100]
    grown, never = GraphTree(links), GraphTree(links)
    grown.add(nodes)
    grown.drop(np.array(gone))
    never.add([node for node in nodes if node not in gone])
    for name in ("spent", "path", "parent", "base"):
        assert np.array_equal(getattr(grown, name), getattr(never, name)), name


def solid_angles(points, triangles, places):
    """Solid angle of a surface seen from places, in turns of 4 pi (Van Oosterom and Strackee)."""
    a, b, c = np.moveaxis(points[triangles][None] - places[:, None, None], 2, 0)
    x, y, z = (np.linalg.norm(one, axis=2) for one in (a, b, c))
    triple = (a * np.cross(b, c)).sum(axis=2)
    bottom = x * y * z + (a * b).sum(axis=2) * z + (a * c).sum(axis=2) * y + (b * c).sum(axis=2) * x
    return np.arctan2(triple, bottom).sum(axis=1) / (2 * np.pi)


@pytest.mark.parametrize("count", [2, 3, 4, 5, 64, 2001])
def test_a_loop_spans_a_surface(count):
    """Against the solid angle of a circle from its axis; inner sides have two triangles."""
    turn = np.linspace(0, 2 * np.pi, count + 1)[:-1]
    ring = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    spanned = span_loop(ring)
    triangles = spanned.corners
    assert len(triangles) == count - 1 and triangles[0, 0] == triangles[0, 2] == 0
    after = np.roll(triangles, -1, axis=1)
    sides = np.stack([triangles, after], axis=2)[1:].reshape(-1, 2).tolist()
    border = [side for side in sides if side[::-1] not in sides]
    assert sorted(border) == [[i, (i + 1) % count] for i in range(count)] or count == 2
    if count == 2001:
        z = np.array([0.3, 1.0, -2.0])
        true = np.sign(z) * (1 - abs(z) / np.sqrt(z**2 + 1)) / 2
        seen = solid_angles(ring, triangles, z[:, None] * [0, 0, 1])
        assert abs(abs(seen) - abs(true)).max() < 1e-5
    boxes = np.concatenate([spanned.lowest, -spanned.highest], axis=1)
    below = spanned.children >= 0
    above = np.repeat(np.arange(count - 1), 2)[below.ravel()]
    assert (boxes[above] <= boxes[spanned.children[below]]).all()
    assert sorted(spanned.children[below]) == list(range(1, count - 1))


@pytest.mark.parametrize(
    ("curves", "genus"),
    [
        ([segment([0, 0, 0], [1, 0, 0])], 0),
        ([circle([0, 0, 0], 1)], 1),
        ([circle([0, 0, 0], 1), segment([-1, 0, 0], [1, 0, 0])], 2),
    ],
)
def test_handles_and_how_often_ways_go_round_them(curves, genus):
    shape = tube(curves, 0.25, 0.08)
    (found,) = find_handles(shape).values()
    assert found.genus == genus and len(found.loops) == 2 * genus
    edges = {tuple(edge) for edge in shape.edges.tolist()}
    for loop in found.loops:
        assert loop[0] == loop[-1]
        steps = zip(loop[:-1].tolist(), loop[1:].tolist(), strict=True)
        assert all((min(a, b), max(a, b)) in edges for a, b in steps)
    if genus:
        # Once along the circle: whole turns, and once round at least one loop.
        way = circle([0, 0, 0], 1)[:-1]
        change = np.diff(angles(found, way), axis=0, append=angles(found, way[:1]))
        turns = (change - np.rint(change)).sum(axis=0)
        assert np.allclose(turns, np.rint(turns), atol=1e-9) and np.rint(turns).any()


def angles(handles, places):
    spanned = [span_loop(handles.points[loop[:-1]]) for loop in handles.loops]
    return np.stack([solid_angles(one.points, one.corners, places) for one in spanned], axis=1)


@pytest.mark.slow
@pytest.mark.parametrize("flat", [False, True])
def test_turns_are_counted_along_links_that_leave_a_ball(flat):
    """Against the solid angle in 400 steps, along chords of a ring whose balls overlap.

    Flat: a center lies in the plane of each loop, as those of symmetric shapes do.
    """
    shape = tube([circle([0, 0, 0], 1)], 0.25, 0.08)
    (found,) = find_handles(shape).values()
    centers = circle([0, 0, 0], 1)[:-1:25]  # 0.39 apart, radius 0.25
    if flat:
        points = np.array(found.points)
        for loop in found.loops:
            near = centers[np.linalg.norm(centers - points[loop].mean(axis=0), axis=1).argmin()]
            across = np.cross(near, [0, 0, 1])
            points[loop] -= np.outer(points[loop] @ across, across)
        found = replace(found, points=points)
    k = len(centers)
    ring = np.stack([np.arange(k), (np.arange(k) + 1) % k], axis=1)
    links = link_balls(
        centers, np.full(k, 0.25), np.ones(k), listed(ring), listed(ring), spacing=0.08
    )
    rows = np.arange(k)
    turns = link_turns(links, found, rows).toarray()
    starts = np.repeat(rows, np.diff(links.offsets))
    total, counted = np.zeros(2), np.zeros(2, int)
    for link, (a, b) in enumerate(zip(starts, links.neighbours, strict=True)):
        way = np.linspace(centers[a], centers[b], 400)
        change = np.diff(angles(found, way), axis=0)
        true = (change - np.rint(change)).sum(axis=0)
        theta = angles(found, centers[[a, b]])
        if not flat:
            assert np.allclose(true, theta[1] - theta[0] - turns[link], atol=1e-9)
        total += true * ((b - a) % k == 1)
        counted += turns[link] * ((b - a) % k == 1)
        back = links.offsets[b] + links.neighbours[
            links.offsets[b] : links.offsets[b + 1]
        ].tolist().index(a)
        assert (turns[link] == -turns[back]).all()
    assert np.allclose(total, -counted, atol=1e-9) and counted.any()


def test_links_that_cross_a_large_surface_are_all_found():
    """Against all links with all triangles: a loop that winds through many balls, in any order."""
    random = np.random.default_rng(3)
    points = np.cumsum(random.normal(size=(200, 3)), axis=0)
    centers = random.uniform(points.min(axis=0), points.max(axis=0), (400, 3))
    pairs = random.integers(0, 400, (2000, 2))
    links = link_balls(centers, np.full(400, 9.0), np.ones(400), listed(pairs), [], spacing=1.0)
    spanned, turns = span_loop(points), np.zeros(len(links.length), np.int64)
    count_crossings(spanned, links, np.arange(400), np.full(400, links.length.max()), turns)
    a, b, c = points[spanned.corners].transpose(1, 0, 2)
    starts, total = np.repeat(np.arange(400), np.diff(links.offsets)), 0
    for link, (v, w) in enumerate(zip(starts, links.neighbours, strict=True)):
        p, step = centers[v], centers[w] - centers[v]
        normal = np.cross(b - a, c - a)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = ((a - p) * normal).sum(axis=1) / (step * normal).sum(axis=1)
        place = p + share[:, None] * step
        inside = [
            (np.cross(j - i, place - i) * normal).sum(axis=1) > 0
            for i, j in ((a, b), (b, c), (c, a))
        ]
        meets = np.logical_and.reduce(inside) & (share > 0) & (share < 1)
        wanted = -np.sign((step * normal).sum(axis=1))[meets].sum()
        overlap = links.length[link] < 18.0
        assert turns[link] == wanted * overlap
        total += abs(turns[link])
    assert total > 50


def test_holes_are_closed_and_fins_left_out():
    torus = tube([circle([0, 0, 0], 1)], 0.3, 0.1)
    assert torus.faces is not None
    kept = (torus.faces[:, :, None] != [5, 1000]).all(
        axis=(1, 2)
    )  # without two vertices: two holes
    holed = medialis.Shape(torus.points, torus.normals, torus.faces[kept])
    assert [one.genus for one in find_handles(holed).values()] == [1]
    third = np.array([[*torus.faces[0, :2], 7]])
    torn = medialis.Shape(torus.points, torus.normals, np.concatenate([torus.faces, third]))
    assert [one.genus for one in find_handles(torn).values()] == [1]
    cloud = medialis.Shape(torus.points, torus.normals)
    assert find_handles(cloud) == {}


def test_a_grown_graph_reaches_what_sticks_out_and_is_a_tree():
    """A cross of two lines with noise: four arms, one piece, no loop; a far ball stays alone."""
    random = np.random.default_rng(2)
    t = np.linspace(-1, 1, 201)
    cross = np.concatenate([np.outer(t, [1, 0, 0]), np.outer(t, [0, 1, 0])])
    centers = np.concatenate([cross + random.normal(0, 0.01, cross.shape), [[9, 9, 9]]])
    k = len(centers)
    distance = np.linalg.norm(centers[:, None] - centers[None], axis=2)
    pairs = np.argwhere(distance < 0.05)
    links = link_balls(centers, np.full(k, 0.2), np.ones(k), listed(pairs), [], spacing=0.01)
    components = np.r_[np.zeros(k - 1, np.int32), np.int32(1)]
    edges, loops = grow_graph(links, components, np.arange(k, 0, -1.0), np.ones(k, bool))
    assert loops == {} and [k - 1, k - 1] in edges.tolist()
    names, inner = np.unique(edges[edges[:, 0] != edges[:, 1]], return_inverse=True)
    graph = CurveSkeleton.of(centers[names], inner.reshape(-1, 2), np.full(len(names), 0.2))
    assert graph.component_count == 1 and graph.loops == 0 and len(graph.end_points) == 4
    tips = graph.nodes[graph.end_points]
    assert (np.linalg.norm(tips, axis=1) > 0.95).all()
