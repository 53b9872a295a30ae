"""Parts by limbs: closed forms with known limbs, invariance, odd input."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

import closed_forms as forms
import medialis
from clouds import adjusted_rand
from medialis.base.arrays import Ragged
from medialis.base.threads import thread_limit
from medialis.segments.parts import extent_share, find_limbs
from medialis.shape import labels as labels_module
from medialis.shape.generate import make_unambiguous, surface_nets
from medialis.shape.labels import connected_labels, diffused_labels
from medialis.shape.normals import vertex_normals
from tubes import AXES, FORK, hub


def limbs(shape, **options):
    return medialis.parts(medialis.shrink_balls(shape), method="limbs", **options)


def across(shape, labels, other):
    """Labels of the samples of another shape: those of the nearest sample."""
    return labels[cKDTree(shape.points).query(other.points)[1]]


@pytest.fixture(scope="module")
def jack():
    return hub(AXES, 0.042, ball=0.6)


@pytest.mark.slow
def test_jack_has_its_ball_and_its_arms(jack):
    """At half, once and twice the density. One sample (0.06) round each arm, 1.6 long, is 0.6 of an
    area of 15.6: with the samples on both sides of it the index is 0.9 or more. At half the density
    the border of each arm may lie two samples beyond the ball, 0.1 of 0.6: 0.85. Borders lie
    between nodes, which are 0.3 radii apart: 0.04 to either side, a sample and a half."""
    middle, plain = jack[0], limbs(jack[0]).labels
    for cell in (0.06, 0.042, 0.03):
        shape, body = hub(AXES, cell, ball=0.6)
        found = limbs(shape)
        assert found.count == 7
        assert adjusted_rand(found.labels, body) > (0.85 if cell > 0.05 else 0.9)
        assert adjusted_rand(across(shape, found.labels, middle), plain) > 0.9
        beyond = np.linalg.norm(shape.points, axis=1) > 0.6 + 2 * cell + 0.04
        for number in range(1, 7):
            assert len(np.unique(found.labels[beyond & (body == number)])) == 1


@pytest.mark.slow
@pytest.mark.parametrize("cell", [0.08, 0.05, 0.035])
def test_equal_arms_meet_in_the_middle(cell):
    """No ball: no arm is the trunk, so the joint is divided among the three."""
    shape, body = hub(FORK, cell, ball=0.25)
    nearest = (shape.points @ FORK.T).argmax(axis=1)
    found = limbs(shape)
    assert found.count == 3
    assert adjusted_rand(found.labels, nearest) > 0.9
    assert (np.bincount(body, minlength=4)[1:] > 0).all()


@pytest.mark.slow
def test_a_thin_arm_leaves_a_thick_one():
    """A bar of two thick arms with a thin one: the bar is one part, the ends are no limbs."""
    thick, _ = hub(np.array([[1.0, 0, 0], [-1, 0, 0]]), 0.06, ball=0.5, arm=0.5)
    assert limbs(thick).count == 1
    side = np.arange(-2.3, 2.31, 0.06)
    x, y, z = np.meshgrid(side, side, side, indexing="ij")
    bar = np.sqrt((np.abs(x) - np.minimum(np.abs(x), 1.4)) ** 2 + y**2 + z**2) - 0.5
    peg = np.sqrt(x**2 + y**2 + (z - np.clip(z, 0, 1.8)) ** 2) - 0.2
    field = np.minimum(bar, peg)
    make_unambiguous(field)
    points, faces = surface_nets(field, np.full(3, side[0]), 0.06)
    shape = medialis.Shape(points, vertex_normals(points, faces), faces)
    found = limbs(shape)
    assert found.count == 2
    assert adjusted_rand(found.labels, points[:, 2] > 0.5) > 0.9


@pytest.mark.slow
def test_dumbbell_at_three_densities():
    """True borders: where the bar enters the balls. A sample spacing either side is free: with
    0.06 in 3.1 of bar and 2 balls, the index stays above 0.95."""
    neck = 2.0 - np.sqrt(1 - 0.3**2)
    shapes = [forms.dumbbell(ball=1.0, bar=0.3, half=2.0, step=s) for s in (0.085, 0.06, 0.0425)]
    found = [limbs(shape).labels for shape in shapes]
    for shape, labels in zip(shapes, found, strict=True):
        assert labels.max() == 2
        assert adjusted_rand(labels, np.digitize(shape.points[:, 2], [-neck, neck])) > 0.95
        assert adjusted_rand(across(shape, labels, shapes[1]), found[1]) > 0.95


def test_extent_does_not_change_when_a_shape_is_turned():
    shape = medialis.organic_shape(56)
    turn = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]
    moved = medialis.Shape(shape.points @ turn.T + 3, shape.normals @ turn.T, shape.faces)
    size = extent_share(shape) * shape.diagonal
    assert extent_share(moved) * moved.diagonal == pytest.approx(size, rel=1e-9)
    assert size == pytest.approx(shape.diagonal, rel=0.2)


@pytest.mark.slow
def test_same_parts_turned_scaled_reordered_and_on_one_thread(jack):
    """Cuts depend on distances alone; the order decides ties of ways along the skeleton, rounding
    too: a row of samples round each arm, 6 * 37 of 13,000, may change sides, 0.97."""
    shape, _ = jack
    plain = limbs(shape).labels
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    order = np.random.default_rng(2).permutation(shape.point_count)
    place = np.argsort(order)
    moved = medialis.Shape(7 * shape.points @ turn.T + 5, shape.normals @ turn.T, shape.faces)
    mixed = medialis.Shape(
        shape.points[order], shape.normals[order], place[shape.faces[::-1]].astype(np.int32)
    )
    assert adjusted_rand(limbs(moved).labels, plain) > 0.97
    assert adjusted_rand(limbs(mixed).labels[place], plain) > 0.97
    with thread_limit(1):
        assert (limbs(shape).labels == plain).all()


@pytest.mark.slow
def test_outer_balls_and_wrong_input(jack):
    shape, _ = jack
    cloud, both = medialis.shrink_balls(shape), medialis.shrink_balls(shape, side="both")
    found = medialis.parts(both, method="limbs")
    assert (found.labels == limbs(shape).labels).all() and found.method == "limbs"
    with pytest.raises(medialis.InvalidOptionError, match="method"):
        medialis.parts(cloud, method="arms")
    with pytest.raises(medialis.InvalidShapeError, match="whole inner cloud"):
        medialis.parts(cloud.subset(np.arange(100)), method="limbs")
    form = forms.box_samples()
    with pytest.raises(medialis.InvalidShapeError, match="need a mesh"):
        medialis.run("parts", form.shape, method="limbs")
    with pytest.raises(medialis.Cancelled):
        medialis.parts(cloud, method="limbs", progress=lambda *_: False)


@pytest.mark.slow
def test_open_non_manifold_and_separate_shapes(jack):
    """Each piece of the surface has labels of its own; a square, which has no ball, has none."""
    shape, _ = jack
    n = shape.point_count
    opened = medialis.make_shape(
        shape.points, shape.faces[shape.points[shape.faces[:, 0], 2] > -1.7]
    )
    assert limbs(opened).labels[opened.faces].min() >= 0
    fan = medialis.make_shape(shape.points, np.concatenate([shape.faces, [[0, 1, 2], [0, 1, 99]]]))
    assert limbs(fan).labels.min() >= 0
    square = np.array([[9.0, 0, 0], [10, 0, 0], [10, 1, 0], [9, 1, 0]])
    many = medialis.make_shape(
        np.concatenate([shape.points, shape.points + np.array([0, 6, 0]), square]),
        np.concatenate([shape.faces, n + shape.faces, 2 * n + np.array([[0, 1, 2], [0, 2, 3]])]),
    )
    result = medialis.run("parts", many, method="limbs", refine=0)
    labels = result.layers[0].attributes["parts"]
    assert not set(labels[:n]) & set(labels[n : 2 * n]) and labels[: 2 * n].min() >= 0
    assert len(set(labels[: 2 * n])) == 14
    assert result.values["unlabelled"] == (labels < 0).sum()
    if (labels < 0).any():
        told = {m.code: m.data for m in result.messages}["samples_unlabelled"]
        assert told["unlabelled"] == result.values["unlabelled"]


def test_limbs_of_a_graph_by_hand():
    """A body of width 1 in the middle of a thin line, and a ring that leaves it and returns."""
    x = np.arange(-6.0, 6.01, 0.25)
    line = np.stack([x, 0 * x, 0 * x], axis=1)
    edges = np.stack([np.arange(len(x) - 1), np.arange(1, len(x))], axis=1)
    width = np.where(np.abs(x) < 1, 1.0, 0.2)
    graph = medialis.CurveSkeleton.of(line, edges, width)
    part = find_limbs(graph, width)
    assert len(np.unique(part)) == 3
    assert len(np.unique(part[np.abs(x) <= 1])) == 1 and part[0] != part[-1]
    even = find_limbs(graph, np.full(len(x), 0.3))
    assert len(np.unique(even)) == 1
    alone = medialis.CurveSkeleton.of([[0.0, 0, 0]], np.empty((0, 2), int), [1.0])
    assert find_limbs(alone, np.ones(1)).tolist() == [0]


@pytest.mark.parametrize(("passage", "parts"), [(1.0, 3), (0.8, 3), (0.7, 4), (0.3, 4)])
def test_bodies_that_touch_are_one_without_a_neck(passage, parts):
    """A trunk with two thin limbs: the balls of the two junctions touch without overlap. It was cut
    between them when they touched by chance."""
    x = np.arange(-3.0, 3.01, 0.5)
    up, none = np.arange(1, 9) / 2, np.zeros(8)
    limbs = [np.stack([none + at, none, up], axis=1) for at in (-1, 0.5)]
    nodes = np.concatenate([np.stack([x, 0 * x, 0 * x], axis=1), *limbs])
    n = len(x)
    edges = [(i, i + 1) for i in range(n - 1)]
    for first, foot in ((n, 4), (n + 8, 7)):
        edges += [(foot, first), *((i, i + 1) for i in range(first, first + 7))]
    width = np.where(nodes[:, 2] > 0, 0.2, 1.0)
    width[5:7] = passage
    part = find_limbs(medialis.CurveSkeleton.of(nodes, edges, 0.8 * width), width)
    assert len(np.unique(part)) == parts
    assert (part[4] == part[7]) == (parts == 3)


def grid_graph(side):
    rows = []
    for i in range(side * side):
        a, b = divmod(i, side)
        near = [(a - 1, b), (a + 1, b), (a, b - 1), (a, b + 1)]
        rows.append([p * side + q for p, q in near if 0 <= p < side and 0 <= q < side])
    return Ragged(np.cumsum([0] + [len(r) for r in rows]), np.concatenate(rows))


def test_diffusion_straightens_borders_and_removes_specks():
    side = 30
    graph = grid_graph(side)
    column = np.tile(np.arange(side), (side, 1))
    wavy = (column > 15 + 2 * (np.arange(side)[:, None] % 2)).astype(np.int32)
    wavy[5, 5] = 1
    labels = wavy.ravel()
    smooth = diffused_labels(labels, graph, 40).reshape(side, side)
    assert (smooth[:, :16] == 0).all() and (smooth[:, 18:] == 1).all()
    assert np.ptp(smooth[2:-2].sum(axis=1)) == 0  # one straight line
    assert labels.reshape(side, side)[5, 5] == 1  # the input is unchanged
    assert diffused_labels(labels, graph, 0) is labels
    none = np.where(column.ravel() == 20, -1, labels).astype(np.int32)
    assert ((diffused_labels(none, graph, 40) < 0) == (none < 0)).all()
    # Numbers that are not in use took memory and time: minutes on a noisy tube (fixed).
    spaced = np.where(labels > 0, 2**31 - 1, 7).astype(np.int32)
    assert ((diffused_labels(spaced, graph, 40) > 7) == (smooth.ravel() > 0)).all()
    pieces = connected_labels(none, graph).reshape(side, side)
    assert pieces[0, 0] != pieces[0, 19] != pieces[0, 29] and (pieces[:, 20] == -1).all()
    assert len(np.unique(pieces)) == 5  # both sides of the wave, the speck, behind the gap, -1


def test_wide_diffusion_is_the_same_with_all_shares_stored(monkeypatch):
    """500 steps of 42 labels on 50,000 samples took 35 s as sparse products (fixed)."""
    side = 40
    graph = grid_graph(side)
    labels = np.random.default_rng(2).integers(0, 9, side * side).astype(np.int32)
    monkeypatch.setattr(labels_module, "FULL", 0.0)
    full = diffused_labels(labels, graph, 60)
    monkeypatch.setattr(labels_module, "FULL", 1.0)
    np.testing.assert_array_equal(diffused_labels(labels, graph, 60), full)


def test_diffusion_has_no_more_steps_than_labels_have_samples():
    side = 20
    labels = np.arange(side * side, dtype=np.int32) // 8
    graph = grid_graph(side)
    eight = diffused_labels(labels, graph, 8)
    np.testing.assert_array_equal(diffused_labels(labels, graph, 1000), eight)
    assert (diffused_labels(labels, graph, 4) != eight).any()
