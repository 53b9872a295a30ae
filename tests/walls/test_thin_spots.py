"""Thin spots: known places, a slow oracle for minima and regions, invariances."""

import dataclasses

import numpy as np
import pytest

import closed_forms as forms
from medialis.base.errors import InvalidOptionError, InvalidShapeError
from medialis.shape.generate import organic_shape
from medialis.shape.shape import Shape
from medialis.skeleton.medial_cloud import DEFAULT_TOLERANCE, shrink_balls
from medialis.walls.thickness import wall_thickness as thickness
from medialis.walls.thin_spots import PlaceGraph, low_places, thin_spots

STEP = 0.05
NO_WALLS = np.empty((0, 2), np.int32)


def places(shape, field, level=0.0, prominence=0.25):
    """Places of any field; the two sides of a wall are not joined."""
    return list(low_places(PlaceGraph(shape, NO_WALLS), field, level=level, prominence=prominence))


DENTS = np.array([[-0.7, 0.1, 0.15], [0.6, -0.3, 0.25]])
"""Centers (x, y) on the grid, and the thickness left there."""


def height(x, y):
    """Thickness of a plate 1 high and wide with two round dents from both sides."""
    total = np.ones_like(x)
    for cx, cy, left in DENTS:
        total -= (1 - left) * np.exp(-((x - cx) ** 2 + (y - cy) ** 2) / 0.4**2)
    return total


def dented_plate():
    """Two mirrored height fields z = +-height/2 on a grid, joined by a rim of quadrangles."""
    x, y = np.meshgrid(np.arange(-30, 31) * STEP, np.arange(-20, 21) * STEP, indexing="ij")
    rows, columns = x.shape
    z = height(x, y) / 2
    top = np.stack([x, y, z], axis=2).reshape(-1, 3)
    n = len(top)
    index = np.arange(n).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    cells = np.concatenate([np.stack(t, axis=2).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])
    loop = np.concatenate([index[:-1, 0], index[-1, :-1], index[:0:-1, -1], index[0, :0:-1]])
    after = np.roll(loop, -1)
    rim = np.concatenate(
        [np.stack([loop, loop + n, after + n], 1), np.stack([loop, after + n, after], 1)]
    )
    points = np.concatenate([top, top * [1, 1, -1]])
    return forms.mesh(points, np.concatenate([cells, cells[:, ::-1] + n, rim]))


def third_lowest(field, links):
    return np.array([sorted([field[v], *(field[w] for w in links[v])])[2] for v in links])


def flood(start, level, field, links):
    found, queue = {start}, [start]
    while queue:
        for w in links[queue.pop()] - found:
            if field[w] < level:
                found.add(w)
                queue.append(w)
    return found


def neighbours(shape):
    links = {v: set() for v in range(shape.point_count)}
    for a, b in shape.edges.tolist():
        links[a].add(b)
        links[b].add(a)
    return links


def test_a_plate_with_two_dents_has_two_thin_spots():
    """At the middle of a dent the surfaces are parallel and mirrored: the ball is the height there.

    The sample in the middle is on the grid and its mirror image is the contact, so only the
    tolerance T enlarges the ball, to at most H / (1 - T/H). Another sample can be the lowest only
    because of the tolerance: it is one step away at most.
    """
    shape = dented_plate()
    cloud = shrink_balls(shape)
    values = thickness(cloud)
    spots = thin_spots(cloud)
    assert len(spots) == 2
    for spot, (x, y, _) in zip(spots, DENTS, strict=True):
        t = DEFAULT_TOLERANCE * shape.diagonal
        true = height(np.array([x]), np.array([y]))[0]
        assert true * (1 - 1e-9) <= spot.value <= true / (1 - t / true)
        assert spot.value <= values[spot.vertex]
        assert np.linalg.norm(spot.position[:2] - [x, y]) <= STEP * 1.001
        both = shape.points[spot.vertices, 2]
        assert (both > 0).any() and (both < 0).any()  # both sides of the wall
    below = thin_spots(cloud, threshold=0.2 / shape.diagonal)
    assert len(below) == 1 and (values[below[0].vertices] < 0.2).all()
    assert set(below[0].vertices) == set(np.flatnonzero(values < 0.2))
    sides = places(shape, values, level=0.2)
    assert len(sides) == 2 and set.union(*(set(s.vertices) for s in sides)) == set(
        below[0].vertices
    )
    assert sum(shape.point_areas[s.vertices].sum() for s in sides) == pytest.approx(below[0].area)


def test_a_uniform_plate_is_one_place_with_all_its_area():
    shape = forms.box_mesh((2.0, 1.5, 0.3), 0.1)
    spots = thin_spots(shrink_balls(shape))
    assert len(spots) == 1 and len(spots[0].vertices) == shape.point_count
    assert spots[0].area == pytest.approx(2 * (2 * 1.5 + 2 * 0.3 + 1.5 * 0.3))


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("prominence", [0.1, 0.25, 1.0])
def test_minima_and_regions_agree_with_the_definition(seed, prominence):
    """A sample is a place when nothing thinner is in its own sublevel set (ties: listed first)."""
    shape = forms.icosphere(2)
    rng = np.random.default_rng(seed)
    field = np.exp(np.sin(shape.points @ rng.normal(size=3) * 6) + 0.3 * rng.normal(size=162))
    if seed == 4:
        field = np.round(field, 1) + 0.1
    links = neighbours(shape)
    calm = third_lowest(field, links)
    rank = np.lexsort((np.arange(162), field, calm)).argsort()
    expected = []
    for v in np.argsort(rank):
        region = flood(v, (1 + prominence) * calm[v], calm, links)
        if rank[v] == min(rank[w] for w in region):
            expected.append((v, region))
    spots = places(shape, field, prominence=prominence)
    found = [(s.vertex, set(s.vertices.tolist())) for s in spots]
    assert sorted(found, key=lambda f: f[0]) == sorted(expected, key=lambda e: e[0])
    assert [s.value for s in spots] == sorted(s.value for s in spots)
    for spot in spots:
        speck = calm[spot.vertex] >= (1 + prominence) * field[spot.vertex]
        assert spot.value == (calm if speck else field)[spot.vertex]


@pytest.mark.parametrize("seed", range(3))
def test_persistence_is_the_height_of_the_lowest_pass_to_a_lower_place(seed):
    """Where there is none lower it is the largest height; the levels are tried one by one."""
    shape = forms.icosphere(2)
    field = np.exp(np.sin(shape.points @ np.random.default_rng(seed).normal(size=3) * 6))
    links = neighbours(shape)
    calm = third_lowest(field, links)
    rank = np.lexsort((np.arange(162), field, calm)).argsort()
    found = places(shape, field, prominence=0.1)
    assert len(found) > 1
    for spot in found:
        lower = [
            level
            for level in np.unique(calm)
            if min(rank[v] for v in flood(spot.vertex, np.nextafter(level, 9), calm, links))
            < rank[spot.vertex]
        ]
        assert spot.persistence + spot.value == pytest.approx(min(lower, default=calm.max()))


def test_persistence_of_a_plate_with_dents():
    """The deeper dent lives up to the plate, the other one up to what lies between them."""
    shape = dented_plate()
    cloud = shrink_balls(shape)
    thick = thickness(cloud).max()
    deep, other = thin_spots(cloud)
    assert deep.persistence == pytest.approx(thick - deep.value, rel=0.01)
    assert 0.25 * other.value < other.persistence <= (thick - other.value) * 1.01
    limit = 1.2 * other.value
    below = thin_spots(cloud, threshold=limit / shape.diagonal)
    assert [s.persistence for s in below] == pytest.approx(
        [limit - s.value for s in below], rel=0.01
    )
    even = thin_spots(shrink_balls(forms.box_mesh((2.0, 1.5, 0.3), 0.1)))[0]
    assert even.persistence == pytest.approx(0.0, abs=0.003)


def test_one_or_two_wrong_samples_are_no_place_but_fail_a_threshold():
    shape = forms.icosphere(3)
    values = np.ones(shape.point_count)
    values[shape.edges[7]] = 0.01
    assert len(places(shape, values)) == 1
    below = places(shape, values, level=0.5)
    assert len(below) == 1 and below[0].vertices.tolist() == shape.edges[7].tolist()
    assert places(shape, values, level=1e-3) == []


@pytest.mark.slow
def test_scale_order_and_clouds():
    shape = organic_shape(56)
    values = thickness(shrink_balls(shape))
    spots = places(shape, values)
    bigger = places(Shape(4 * shape.points, shape.normals, shape.faces), 4 * values)
    assert [s.value * 4 for s in spots] == [s.value for s in bigger]
    place = np.random.default_rng(1).permutation(shape.point_count)
    mixed = Shape(shape.points[place], shape.normals[place], np.argsort(place)[shape.faces])
    other = places(mixed, values[place])
    assert [s.value for s in other] == [s.value for s in spots]
    for one, two in zip(spots, other, strict=True):
        assert set(place[two.vertices].tolist()) == set(one.vertices.tolist())
    cloud = places(Shape(shape.points, shape.normals), values)
    assert cloud[0].vertices.size
    with pytest.raises(dataclasses.FrozenInstanceError):
        spots[0].value = 1.0
    with pytest.raises(ValueError, match="read-only"):
        spots[0].vertices[0] = 1


def test_bad_input():
    cloud = shrink_balls(forms.icosphere(1))
    with pytest.raises(InvalidShapeError, match="No inner ball"):
        thin_spots(cloud.subset([]))
    for bad in ({"threshold": -0.1}, {"spots": 0}, {"prominence": -1}, {"kind": "width"}):
        with pytest.raises(InvalidOptionError, match=next(iter(bad))):
            thin_spots(cloud, **bad)
