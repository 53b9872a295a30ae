"""Triangles of sheets are even: flips and moves keep the structure, merging makes no folds."""

import numpy as np
import pytest

from medialis.base.validation import FloatArray
from medialis.medial_meshes.collapsing import collapse, evened
from medialis.medial_meshes.mesh import Complex, betti_numbers, sheets_of
from medialis.medial_meshes.refining import Fault, refined_at_once


def sheet(count: int, seed: int | None = 0) -> Complex:
    """A flat square sheet of balls, those within moved at random, with linear radii."""
    y, x = np.mgrid[:count, :count] / (count - 1.0)
    places = np.stack([x, y], axis=-1).reshape(-1, 2)
    within = ((places > 0) & (places < 1)).all(axis=1)
    if seed is not None:
        way = np.random.default_rng(seed).uniform(-0.3, 0.3, (len(places), 2)) / (count - 1)
        places[within] += way[within]
    a = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).ravel()
    b, c, d = a + 1, a + count, a + count + 1
    faces = np.concatenate([np.stack([a, b, d], 1), np.stack([a, c, d], 1)])
    sides = np.unique(faces[:, [[0, 1], [0, 2], [1, 2]]].reshape(-1, 2), axis=0)
    balls = np.column_stack([places, np.zeros(len(places)), 0.2 + 0.1 * places[:, 0]])
    return Complex(balls, sides, faces)


def quality(given: Complex) -> FloatArray:
    """6 / sqrt(3) times the area by the longest side and half the perimeter."""
    p = given.balls[given.faces, :3]
    sides = np.linalg.norm(p - np.roll(p, 1, axis=1), axis=2)
    area = 0.5 * np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1)
    return np.asarray(6 / np.sqrt(3) * area / (sides.max(axis=1) * 0.5 * sides.sum(axis=1)))


def area_of(given: Complex) -> float:
    """The sum over all triangles: larger than that of the sheet where it is folded."""
    p = given.balls[given.faces, :3]
    return float(0.5 * np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1).sum())


def folded(given: Complex) -> int:
    """Edges whose two triangles lie on the same side of them, in the plane."""
    places, count = given.balls[:, :2], 0
    for a, b in given.edges:
        around = given.faces[(given.faces == a).any(axis=1) & (given.faces == b).any(axis=1)]
        if len(around) == 2:
            way, others = places[b] - places[a], places[around.sum(axis=1) - a - b] - places[a]
            side = way[0] * others[:, 1] - way[1] * others[:, 0]
            count += side.prod() > 0
    return count


@pytest.mark.parametrize("seed", range(3))
def test_triangles_of_a_flat_sheet_get_even_and_it_stays_the_same(seed):
    """Its square, its topology and its radii, which are linear; the balls given stay unchanged."""
    start = sheet(12, seed)
    before = start.balls.copy()
    found = evened(start, 1e-3)
    assert np.array_equal(start.balls, before)
    assert quality(found).mean() > quality(start).mean() + 0.03
    assert quality(found).min() > quality(start).min()
    assert abs(area_of(found) - 1.0) < 1e-9
    assert np.abs(found.balls[:, 3] - 0.2 - 0.1 * found.balls[:, 0]).max() < 1e-9
    assert betti_numbers(len(found), found.edges, found.faces) == (1, 0, 0)
    assert sheets_of(found.balls[:, :3], found.faces).of_faces.max() == 0


def test_an_edge_stays_where_the_other_one_is_far_from_it():
    """Four balls of a saddle: the better diagonal is 0.2 from the one that there is."""
    balls = np.array([[0, 0, 0.1, 1], [3, 0, 0.1, 1], [1.5, 1, -0.1, 1], [1.5, -1, -0.1, 1]])
    edges = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3]])
    saddle = Complex(balls, edges, np.array([[0, 1, 2], [0, 1, 3]]))
    flipped = [bool((evened(saddle, off).edges == [2, 3]).all(axis=1).any()) for off in (0.1, 0.3)]
    assert flipped == [False, True]


def test_merging_in_a_whole_sheet_makes_no_folds():
    """Quadrics that pull balls astray: 40 of 150 edges were folded over, of a dolphin 28 %."""
    start = sheet(16, None)
    rng = np.random.default_rng(2)
    astray = start.balls + rng.normal(0, 0.1, start.balls.shape) * [1, 1, 0, 0]
    quadrics = np.zeros((len(start), 15))
    quadrics[:, [0, 4, 7, 9]] = 1.0
    quadrics[:, 10:14] = astray
    quadrics[:, 14] = (astray**2).sum(axis=1)
    found, _ = collapse(start, quadrics, 60, whole=True).level(60)
    assert len(found) == 60 and betti_numbers(60, found.edges, found.faces) == (1, 0, 0)
    assert folded(found) == 0


def test_balls_added_at_once_keep_the_topology_and_lie_apart():
    """As many as there is room for, none twice on the same triangle."""
    start = sheet(6, None)
    rng = np.random.default_rng(0)
    places = np.column_stack([rng.uniform(0.05, 0.95, (300, 2)), np.zeros(300)])
    balls = np.column_stack([places, 0.2 + 0.1 * places[:, 0]])
    faults = Fault(places, rng.uniform(0, 1, 300), balls, places)
    found = refined_at_once(start, faults, 4)
    assert len(found) == len(start) + 4
    assert betti_numbers(len(found), found.edges, found.faces) == (1, 0, 0)
    many = refined_at_once(start, faults, 200)
    assert len(start) + 4 < len(many) < len(start) + 200
    assert betti_numbers(len(many), many.edges, many.faces) == (1, 0, 0)
    assert abs(area_of(many) - 1.0) < 1e-9
