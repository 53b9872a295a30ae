import numpy as np
import pytest

import medialis
from medialis.curves.graph.ground import link_balls
from medialis.curves.graph.growth import grow_graph
from medialis.curves.graph.handles import find_handles
from medialis.curves.graph.loops import link_turns
from medialis.curves.graph.tree import GraphTree
from medialis.model.curve_skeleton import CurveSkeleton
from medialis.model.polylines import follow
from tubes import circle, segment, tube

NONE = np.empty((0, 2), np.int64)


def random_links(seed=0, k=300):
    random = np.random.default_rng(seed)
    centers, radii = random.uniform(size=(k, 3)), random.uniform(0.1, 0.3, k)
    pairs = random.integers(0, k, (6 * k, 2))
    return link_balls(centers, radii, random.uniform(size=k), NONE, pairs, spacing=0.05)


def matrix(links):
    from scipy.sparse import csr_array

    k = len(links)
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
        np.delete(pairs, 10, axis=0),
        NONE,
        spacing=0.01,
    )
    price = links.cost / links.length
    assert price[links.length > 0.1].max() < price[links.length < 0.1].min()


def test_links_come_from_both_ends_once_and_near_ones_stay_in_both_balls():
    links = random_links()
    table = matrix(links).toarray()
    assert (table == table.T).all() and (table.diagonal() == 0).all()
    ends = np.repeat(np.arange(len(links)), np.diff(links.offsets))
    assert len(np.unique(ends * len(links) + links.neighbours)) == len(ends)
    near = link_balls(
        np.array([[0, 0, 0], [1, 0, 0], [3, 0, 0.0]]),
        np.array([1.1, 1.2, 9.0]),
        np.ones(3),
        np.array([[0, 1], [1, 2], [2, 2]]),
        NONE,
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


def test_the_solid_angle_of_a_circle():
    """From a point on the axis at height z: 2 pi (1 - z / sqrt(z^2 + 1)), here in turns of 4 pi."""
    from medialis.curves.graph._growth_kernels import solid_angles

    turn = np.linspace(0, 2 * np.pi, 2001)
    ring = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    centers = np.array([[0, 0, 0.3], [0, 0, 1.0], [0, 0, -2.0]])
    out = np.empty(3)
    loop = np.r_[np.arange(2000), 0]
    solid_angles(0, 3, np.arange(3), centers, loop, ring, out)
    z = centers[:, 2]
    true = np.sign(z) * (1 - abs(z) / np.sqrt(z**2 + 1)) / 2
    assert abs(abs(out) - abs(true)).max() < 1e-5 and out[2] * out[1] < 0


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
        theta = angles(found, way)
        change = np.diff(theta, axis=0, append=theta[:1])
        turns = (change - np.rint(change)).sum(axis=0)
        assert np.allclose(turns, np.rint(turns), atol=1e-9) and np.rint(turns).any()


def angles(handles, places):
    theta = np.zeros((len(handles.loops), len(places)))
    for number, row in enumerate(theta):
        handles.fill_angles(number, places, np.arange(len(places)), row)
    return theta.T


def test_angles_are_followed_along_links_that_leave_a_ball():
    """Against the angle in 400 steps, along chords of a ring whose balls overlap."""
    shape = tube([circle([0, 0, 0], 1)], 0.25, 0.08)
    (found,) = find_handles(shape).values()
    centers = circle([0, 0, 0], 1)[:-1:25]  # 0.39 apart, radius 0.25
    k = len(centers)
    ring = np.stack([np.arange(k), (np.arange(k) + 1) % k], axis=1)
    links = link_balls(centers, np.full(k, 0.25), np.ones(k), ring, ring, spacing=0.08)
    rows = np.arange(k)
    theta = angles(found, centers)
    turns = link_turns(links, found, rows)
    starts = np.repeat(rows, np.diff(links.offsets))
    total = np.zeros(2)
    for link, (a, b) in enumerate(zip(starts, links.neighbours, strict=True)):
        way = np.linspace(centers[a], centers[b], 400)
        change = np.diff(angles(found, way), axis=0)
        true = (change - np.rint(change)).sum(axis=0)
        assert np.allclose(true, theta[b] - theta[a] - turns.along(link), atol=1e-9)
        total += true * ((b - a) % k == 1)
    assert np.allclose(total, np.rint(total), atol=1e-9) and np.rint(total).any()


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
    links = link_balls(centers, np.full(k, 0.2), np.ones(k), pairs, NONE, spacing=0.01)
    components = np.r_[np.zeros(k - 1, np.int32), np.int32(1)]
    edges, loops = grow_graph(links, components, np.arange(k, 0, -1.0), np.ones(k, bool))
    assert loops == {} and [k - 1, k - 1] in edges.tolist()
    names, inner = np.unique(edges[edges[:, 0] != edges[:, 1]], return_inverse=True)
    graph = CurveSkeleton.of(centers[names], inner.reshape(-1, 2), np.full(len(names), 0.2))
    assert graph.component_count == 1 and graph.loops == 0 and len(graph.end_points) == 4
    tips = graph.nodes[graph.end_points]
    assert (np.linalg.norm(tips, axis=1) > 0.95).all()
