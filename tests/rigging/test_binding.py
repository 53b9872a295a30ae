"""Weights for any armature: closed form, invariants, an oracle on a finer grid, broken meshes."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

import medialis
from medialis.rigging.armature import write_armature_json
from medialis.rigging.deforming import segments_of
from medialis.rigging.operation import RIG_FORMATS, RIGGED
from medialis.shape.generate import implicit_shape

RADIUS = 0.25


def rod(rings=81, around=24, radius=RADIUS, low=-1.0, high=1.0):
    """A closed cylinder along z: points and faces."""
    angles = 2 * np.pi * np.arange(around) / around
    circle = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    heights = np.linspace(low, high, rings)
    points = np.concatenate([np.column_stack([circle, np.full(around, z)]) for z in heights])
    here, onward = np.arange(around), (np.arange(around) + 1) % around
    steps = around * np.arange(rings - 1)[:, None, None]
    sides = np.concatenate([
        np.stack([here, onward, onward + around], axis=1)[None] + steps,
        np.stack([here, onward + around, here + around], axis=1)[None] + steps,
    ]).reshape(-1, 3)  # fmt: skip
    ends = np.array([[0, 0, low], [0, 0, high]])
    bottom, top, last = len(points), len(points) + 1, around * (rings - 1)
    caps = [
        np.stack([onward, here, np.full(around, bottom)], axis=1),
        np.stack([here + last, onward + last, np.full(around, top)], axis=1),
    ]
    return np.concatenate([points, ends]), np.concatenate([sides, *caps])


TWO = medialis.Armature([[0, 0, -1], [0, 0, 0]], [[0, 0, 0], [0, 0, 1]], [-1, 0])


def dense(skin, bones):
    """Weights of all bones, (n, b)."""
    table = np.zeros((len(skin.bones), bones + 1))
    np.put_along_axis(table, skin.bones, skin.weights, axis=1)
    return table[:, :-1]


def bound(points, faces, armature, **options):
    """Weights of the vertices that were given."""
    shape = medialis.make_shape(points, faces, repair=True)
    skin = medialis.bind_weights(shape, armature=armature, **options)
    rows = shape.on_input_points(skin.bones, -1), shape.on_input_points(skin.weights, 0.0)
    return dense(medialis.SkinWeights(*rows), armature.count)


@pytest.mark.slow
def test_on_a_rod_weights_fall_as_heat_does():
    """Far from the ends w - r^2 w'' = step: half of exp(-|z| / r) passes the joint."""
    points, faces = rod()
    for softness in (0.5, 1.0):
        weights = bound(points, faces, TWO, softness=softness)
        z = points[:, 2]
        passed = 0.5 * np.exp(-np.abs(z) / (softness * RADIUS))
        truth = np.where(z > 0, 1 - passed, passed)
        middle = (np.abs(z) < 0.6) & (np.abs(z) > 1e-9)
        assert np.abs(weights[:, 1] - truth)[middle].max() < 0.03
        assert np.abs(weights.sum(axis=1) - 1).max() < 1e-12
    stiff = bound(points, faces, TWO, softness=0.0)
    away = np.abs(points[:, 2]) > 0.03
    assert (stiff[away].max(axis=1) == 1.0).all()


def test_a_bone_beside_the_body_moves_what_is_next_to_it():
    """It lies outside, another one inside: each has its half of the rod."""
    points, faces = rod(rings=41)
    aside = np.array([[0, 0, 0], [1.5 * RADIUS, 0, 0]])
    beside = medialis.Armature(TWO.heads + aside, TWO.tails + aside, TWO.parents)
    weights = bound(points, faces, beside, softness=0.0)
    z, outer = points[:, 2], points[:, 0] > 0.9 * RADIUS
    assert (weights[z > 0.8, 1] == 1).all() and (weights[z < -0.1, 0] == 1).all()
    assert (weights[outer & (z > 0.5), 1] == 1).all()


@pytest.mark.parametrize(("name", "border"), [("tail", 0.0), ("tail_tip", 0.25)])
def test_a_tip_begins_in_its_middle(name, border):
    """The border is half way between the end of the bone before and there."""
    points, faces = rod(rings=41)
    chain = medialis.Armature(TWO.heads, TWO.tails, TWO.parents, ("back", name))
    weights = bound(points, faces, chain, softness=0.0)
    z = points[:, 2]
    assert (weights[z > border + 0.06, 1] == 1).all()
    assert (weights[z < border - 0.06, 0] == 1).all()


def legs():
    """Two rods side by side, a hundredth apart, and a bridge above: points, faces, armature."""
    one, faces = rod(rings=41, low=-1.0, high=0.4)
    across = 2 * RADIUS + 0.01
    other = one + np.array([across, 0, 0])
    bridge, more = rod(rings=21, low=-0.1, high=across + 0.1, radius=0.2)
    bridge = bridge[:, [2, 0, 1]] + [0, 0, 0.2]
    points = np.concatenate([one, other, bridge])
    faces = np.concatenate([faces, faces + len(one), more + 2 * len(one)])
    heads = [[0, 0, 0.2], [across, 0, 0.2], [0, 0, 0.2]]
    tails = [[0, 0, -0.9], [across, 0, -0.9], [across, 0, 0.2]]
    return points, faces, medialis.Armature(heads, tails, [2, 2, -1])


@pytest.mark.slow
def test_what_lies_beside_a_bone_outside_its_body_does_not_move():
    """A hand on the hip: the gap is a hundredth, and the next bone half as far as the own one."""
    points, faces, armature = legs()
    nearer = np.array([[0.2, 0, 0], [0, 0, 0], [0, 0, 0]])
    close = medialis.Armature(armature.heads + nearer, armature.tails + nearer, armature.parents)
    weights = bound(points, faces, close)
    half = len(rod(rings=41)[0])
    low = points[:, 2] < -0.5
    first, second = np.arange(len(points)) < half, np.arange(len(points)) // half == 1
    assert weights[first & low, 1].max() < 0.01 and weights[second & low, 0].max() < 0.01
    assert weights[first & low, 0].min() > 0.9 and weights[second & low, 1].min() > 0.9


def test_the_cheapest_bones_of_cells_are_those_of_a_search_for_each_bone():
    """Lists without order give what a heap gives, through faces and outside as well."""
    from medialis.rigging._way_kernels import Fares, Grid, Waiting, Ways, _is_open, nearest_bones

    rng, size, fee, bones, kept = np.random.default_rng(0), np.array([5, 6, 7]), 30.0, 4, 2
    count = int(size.prod())
    inside = rng.random(count) < 0.7
    parted = np.where(rng.random(count) < 0.2, rng.integers(0, 8, count), 0).astype(np.uint8)
    passed, no, yes = (
        inside | (rng.random(count) < 0.5),
        np.zeros(count, bool),
        np.ones(count, bool),
    )
    seeds = rng.choice(np.flatnonzero(passed), bones, replace=False)
    begin = rng.random(bones)

    places = np.stack(np.unravel_index(np.arange(count), size), axis=1)
    strides = np.array([size[1] * size[2], size[2], 1])
    pairs, costs = [], []
    for cell, other in np.argwhere(np.abs(places[:, None] - places).max(axis=2) == 1):
        step = places[other] - places[cell]
        way = np.linalg.norm(step) * (1.0 if inside[cell] and inside[other] else 4.0)
        pairs.append((cell, other))
        costs.append(way + fee * (not _is_open(parted, cell, step, strides)))
    ends = np.array(pairs)
    ways_in = passed[ends].all(axis=1)
    graph = coo_array((np.array(costs)[ways_in], ends[ways_in].T), shape=(count, count)).tocsr()
    expected = np.sort((dijkstra(graph, indices=seeds) + begin[:, None]).T, axis=1)[:, :kept]

    ways = Ways(
        np.full((count, kept), -1, np.int32),
        np.full((count, kept), np.inf),
        np.full((count, kept), np.inf),
    )
    ways.bones[seeds, 0], ways.costs[seeds, 0], ways.lengths[seeds, 0] = (
        np.arange(bones),
        begin,
        begin,
    )
    lists = np.full(int(fee + 4 * 3**0.5) + 2, -1, np.int32)
    after, before = np.empty((2, ways.costs.size), np.int32)
    grid = Grid(size, inside, parted, no, passed, yes)
    limit = nearest_bones(grid, Fares(4.0, fee, 9.0), ways, Waiting(lists, after, before))
    assert limit > expected[np.isfinite(expected)].max()
    assert (expected.max(axis=1) > fee).sum() > 20  # the fee is paid somewhere
    np.testing.assert_allclose(np.sort(ways.costs, axis=1), expected, rtol=1e-12)


@pytest.mark.slow
def test_nearest_bones_are_those_of_a_search_on_all_cells_inside():
    """The oracle: shortest ways on a grid whose inside is told by the formula of the body."""
    from medialis.rigging.binding import _nearest

    bent, step = medialis.Armature(
        [[0, 0, 0], [1, 0, 0], [1, 0, 0.5]], [[1, 0, 0], [1, 0, 0.5], [0, 0, 0.5]], [-1, 0, 1]
    ), 0.02  # fmt: skip

    def distance(places):
        best = np.full(len(places), np.inf)
        for head, tail in zip(bent.heads, bent.tails, strict=True):
            along = tail - head
            share = np.clip((places - head) @ along / (along @ along), 0, 1)
            off = places - head - share[:, None] * along
            best = np.minimum(best, np.linalg.norm(off, axis=1))
        return best

    low, high = np.array([-0.3, -0.3, -0.3]), np.array([1.3, 0.3, 0.8])
    shape = implicit_shape(lambda places: distance(places) - 0.18, low, high, 40)
    axes = [np.arange(a, b, step) for a, b in zip(low, high, strict=True)]
    cells = np.stack(np.meshgrid(*axes, indexing="ij"), axis=3)
    inside = distance(cells.reshape(-1, 3)).reshape(cells.shape[:3]) < 0.18
    number = np.full(inside.shape, -1)
    number[inside] = np.arange(inside.sum())
    ends, ways = [], []
    for code in range(14, 27):
        move = np.array([code // 9 - 1, code // 3 % 3 - 1, code % 3 - 1])
        here = tuple(
            slice(max(0, -m), n - max(0, m)) for m, n in zip(move, inside.shape, strict=True)
        )
        there = tuple(
            slice(max(0, m), n - max(0, -m)) for m, n in zip(move, inside.shape, strict=True)
        )
        pairs = np.stack([number[here].ravel(), number[there].ravel()], axis=1)
        pairs = pairs[(pairs >= 0).all(axis=1)]
        ends.append(pairs)
        ways.append(np.full(len(pairs), step * np.linalg.norm(move)))
    ends, ways = np.concatenate(ends), np.concatenate(ways)
    graph = coo_array((ways, ends.T), shape=(inside.sum(),) * 2).tocsr()
    places = cells[inside]
    tree = cKDTree(places)
    reach = []
    for head, tail in zip(bent.heads, bent.tails, strict=True):
        along = head + np.linspace(0, 1, 60)[:, None] * (tail - head)
        near = np.unique(tree.query(along)[1])
        reach.append(dijkstra(graph, directed=False, indices=near, min_only=True))
    reach = np.array(reach).T
    nearest = tree.query(shape.points)[1]
    reach = np.sort(reach[nearest], axis=1), reach[nearest].argmin(axis=1)
    skin, far = _nearest(shape, segments_of(bent, np.ones(bent.count, bool)))
    clear = reach[0][:, 1] > 1.3 * reach[0][:, 0] + 2 * step
    assert clear.mean() > 0.4
    assert (skin.bones[clear, 0] == reach[1][clear]).mean() > 0.995
    assert np.abs(far - distance(shape.points))[clear].max() < 0.03


@pytest.mark.slow
def test_turned_scaled_moved_and_in_another_order_it_is_the_same():
    points, faces = rod(rings=31, around=16)
    before = bound(points, faces, TWO)
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    turned = medialis.Armature(TWO.heads @ turn.T, TWO.tails @ turn.T, TWO.parents)
    assert np.abs(bound(points @ turn.T, faces, turned) - before).max() < 0.05
    for scale in (1e-3, 1e3):
        scaled = medialis.Armature(scale * TWO.heads, scale * TWO.tails, TWO.parents)
        assert np.abs(bound(scale * points, faces, scaled) - before).max() < 1e-6
    order = np.random.default_rng(1).permutation(len(points))
    other = bound(points[order], np.argsort(order)[faces], TWO)
    assert np.abs(other - before[order]).max() < 1e-9


@pytest.mark.slow
def test_far_from_the_origin_a_file_of_bones_lies_where_it_says(tmp_path):
    points, faces = rod(rings=31, around=16)
    away = np.array([4e5, 5e6, 100.0])
    write_armature_json(tmp_path / "bones.json", TWO, None)
    near = medialis.run("bind", (points, faces), armature=tmp_path / "bones.json")
    moved = medialis.Armature(TWO.heads + away, TWO.tails + away, TWO.parents)
    write_armature_json(tmp_path / "far.json", moved, None)
    far = medialis.run("bind", (points + away, faces), armature=tmp_path / "far.json")
    assert np.abs(far.arrays["skin_weights"] - near.arrays["skin_weights"]).max() < 1e-4
    assert np.abs(far.arrays["heads"] - moved.heads).max() < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize(("up", "unit"), [("x", "mm"), ("y", None), ("z", "in"), (None, "cm")])
def test_files_of_armature_are_bound_again_where_they_were(tmp_path, up, unit):
    """glTF is in metres, with y up: its bones lay beside a part in millimetres with z up."""
    shape = replace(medialis.make_shape(*rod(rings=31, around=16)), up=up, unit=unit)
    made = medialis.run("armature", shape, bone_length=0.3)
    for kind in RIG_FORMATS:
        if kind.name in ("glb", "json"):
            path = tmp_path / f"armature.{kind.name}"
            kind.write(path, made)
            found = medialis.run("bind", shape, armature=path)
            assert found.values["bone_names"] == list(made.extras["bones"].names)
            assert np.abs(found.arrays["heads"] - made.arrays["heads"]).max() < 1e-5
            RIGGED.write(tmp_path / "bind.glb", found)
            again = medialis.read_armature(tmp_path / "bind.glb", unit=unit, up=up)
            assert np.abs(again.heads - made.arrays["heads"]).max() < 1e-5


def broken_rods(points, faces):
    """Yield what is wrong with a rod, its points, and its faces."""
    rng = np.random.default_rng(2)
    specks = np.array([[0.4, 0, z] for z in (-0.8, 0.1, 0.8)])
    corners = (specks[:, None] + 0.005 * rng.normal(size=(1, 3, 3))).reshape(-1, 3)
    more = np.arange(9).reshape(3, 3) + len(points)
    yield "specks", np.concatenate([points, corners]), np.concatenate([faces, more])
    middle = points[faces].mean(axis=1)
    yield "holes", points, faces[~((middle[:, 0] > 0.1) & (np.abs(middle[:, 2] - 0.5) < 0.2))]
    yield "open ends", points, faces[np.abs(middle[:, 2]) < 0.99]
    yield "half a rod: no inside", points, faces[middle[:, 0] > 0]
    inner = 0.9 * points
    yield (
        "inner faces",
        np.concatenate([points, inner]),
        np.concatenate([faces, faces + len(points)]),
    )
    yield "each face alone", points[faces].reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3)
    yield "faces without area", points, np.concatenate([faces, faces[:40, [0, 0, 1]]])
    yield "inside out", points, faces[:, ::-1]


@pytest.mark.slow
@pytest.mark.parametrize("row", range(8))
def test_broken_meshes_are_bound_as_whole_ones(row):
    points, faces = rod(rings=31, around=16)
    what, places, triangles = list(broken_rods(points, faces))[row]
    weights = bound(places, triangles, TWO)
    used = np.unique(triangles)
    z = places[:, 2]
    assert np.abs(weights[used].sum(axis=1) - 1).max() < 1e-12, what
    for side, bone in ((z > 0.4, 1), (z < -0.4, 0)):
        side &= np.isin(np.arange(len(places)), used)
        assert weights[side, bone].min() > 0.75, what


@pytest.mark.slow
def test_a_piece_smaller_than_its_distance_moves_as_a_whole_and_a_limit_holds():
    points, faces = rod(rings=31, around=16)
    _, places, triangles = next(iter(broken_rods(points, faces)))
    weights = bound(places, triangles, TWO)
    for speck in range(3):
        rows = len(points) + 3 * speck + np.arange(3)
        assert np.abs(np.ptp(weights[rows], axis=0)).max() < 1e-12
    star = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1.0]])
    hub = medialis.Armature(np.zeros((6, 3)), 0.4 * star, [-1] * 6)
    for most in (1, 2, 8):
        found = bound(points, faces, hub, bones_per_vertex=most, softness=1.0)
        count = (found > 0).sum(axis=1)
        assert count.max() <= most and np.abs(found.sum(axis=1) - 1).max() < 1e-12
        assert most < 8 or count.max() > 4


@pytest.mark.parametrize(
    ("armature", "said"),
    [
        (medialis.Armature([[9, 9, 9]], [[9, 9, 8]], [-1]), "No bone lies at the shape"),
        ("rig.glb", "must be an Armature or Bones, got str"),
    ],
)
def test_what_cannot_be_bound_is_told(armature, said):
    with pytest.raises((medialis.InvalidShapeError, medialis.InvalidOptionError), match=said):
        medialis.bind_weights(rod(rings=5), armature=armature)


def test_a_cloud_cannot_be_bound():
    with pytest.raises(medialis.InvalidShapeError, match="Binding needs a mesh, got 1,946 points"):
        medialis.bind_weights(rod()[0], armature=TWO)
