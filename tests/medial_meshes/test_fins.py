"""Sheets of complexes are kept whole by the collapse, and taken away whole where they are fins."""

import numpy as np
import pytest

import medialis
from closed_forms import icosphere, prism
from medialis.base.progress import Progress
from medialis.medial_meshes.collapsing import collapse
from medialis.medial_meshes.fine_complex import fine_complex
from medialis.medial_meshes.fins import Touched, creased, on_reflex_edges, without_fins
from medialis.medial_meshes.mesh import Complex, betti_numbers, sheets_of
from medialis.medial_meshes.sampling import Solid
from medialis.operations.registry import run


def grid(columns, rows, radius):
    """A flat sheet of balls on a square grid of unit 1 / columns, as rows of a complex."""
    y, x = np.mgrid[:rows, :columns] / (columns - 1)
    balls = np.stack([x, y, 0 * x, radius(x, y)], axis=-1).reshape(-1, 4)
    a = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    b, c, d = a + 1, a + columns, a + columns + 1
    return balls, np.concatenate([np.stack([a, b, d], 1), np.stack([a, c, d], 1)])


def whole(balls, faces):
    faces = np.sort(faces, axis=1)
    sides = np.unique(faces[:, [[0, 1], [0, 2], [1, 2]]].reshape(-1, 2), axis=0)
    return Complex(balls, sides, faces)


def book(leaves, count=9):
    """Square sheets that share a side along y: a seam of so many sheets."""
    all_balls, all_faces, start = [], [], 0
    for k in range(leaves):
        balls, faces = grid(count, count, lambda x, y: 0.3 + 0 * x)
        turn = 2 * np.pi * k / leaves
        x = balls[:, 0].copy()
        balls[:, 0], balls[:, 2] = np.cos(turn) * x, np.sin(turn) * x
        rows = np.arange(len(balls)) + start
        if k:
            spine = np.arange(len(balls)) % count == 0
            rows = np.where(spine, np.arange(len(balls)), start + np.cumsum(~spine) - 1)
            balls = balls[~spine]
        all_balls.append(balls)
        all_faces.append(rows[faces])
        start += len(balls)
    return whole(np.concatenate(all_balls), np.concatenate(all_faces))


def structure(given):
    found = sheets_of(given.balls[:, :3], given.faces)
    return int(found.of_faces.max()) + 1, betti_numbers(len(given), given.edges, given.faces)


@pytest.mark.parametrize("leaves", [1, 3, 4])
def test_sheets_stay_as_the_collapse_goes_on(leaves):
    """A book is told by its seam and rims; its quadrics, random, want anything but that."""
    start, rng = book(leaves), np.random.default_rng(leaves)
    quadrics = np.zeros((len(start), 15))
    quadrics[:, [0, 4, 7, 9]] = rng.uniform(size=(len(start), 4)) ** 3
    quadrics[:, 10:14] = quadrics[:, [0, 4, 7, 9]] * start.balls
    found = collapse(start, quadrics, 1, whole=True)
    for count in range(5 * leaves + 3, len(start), 7):
        level, _ = found.level(count)
        assert structure(level) == (leaves, (1, 0, 0))
        sides = level.faces[:, [[0, 1], [0, 2], [1, 2]]].reshape(-1, 2)
        ends, uses = np.unique(sides, axis=0, return_counts=True)
        assert len(ends) == len(level.edges) and set(uses) <= {1, 2, leaves}
    last, _ = found.level(1)
    assert len(last) == 1  # in the end sheets go


def with_a_fin(height):
    """A large sheet with a small one at right angles on it, whose balls stick out by `height`."""
    balls, faces = grid(21, 21, lambda x, y: 0.3 + 0 * x)
    row = np.arange(21 * 10 + 8, 21 * 10 + 13)
    tips = balls[row].copy()
    tips[:, 2] += 0.2
    tips[:, 3] += height - 0.2
    new = len(balls) + np.arange(5)
    fin = [[row[i], row[i + 1], new[i]] for i in range(4)]
    fin += [[row[i + 1], new[i], new[i + 1]] for i in range(4)]
    return whole(np.concatenate([balls, tips]), np.concatenate([faces, fin])), new


def tops(given):
    """The highest place of each ball."""
    balls = given.balls
    return Touched(balls[:, :3] + [0, 0, 1] * balls[:, 3:], np.arange(len(balls)))


def test_a_fin_goes_when_its_balls_hardly_stick_out():
    """Of balls straight under them: by `height` exactly."""
    for height, gone in ((0.009, True), (0.011, False)):
        given, new = with_a_fin(height)
        assert structure(given) == (2, (1, 0, 0))
        found, place = without_fins(given, tops(given), 0.01)
        assert structure(found) == (1 if gone else 2, (1, 0, 0))
        assert (place[new] < 0).all() == gone and len(found) == len(given) - 5 * gone
        stays = place >= 0
        assert np.array_equal(found.balls[place[stays]], given.balls[stays])


def test_a_sheet_that_closes_a_hollow_stays():
    """A bubble on the sheet has no free rim, however little it sticks out."""
    given, new = with_a_fin(0.0)
    a, b = 21 * 10 + 8, 21 * 10 + 9
    others = np.array([[a, b, 21 * 9 + 8], [a, new[0], 21 * 9 + 8], [b, new[0], 21 * 9 + 8]])
    faces = np.concatenate([given.faces, others])
    closed = whole(given.balls, np.unique(np.sort(faces, axis=1), axis=0))
    before = structure(closed)[1]
    assert before[2] == 1
    assert structure(without_fins(closed, tops(closed), 0.01)[0])[1] == before


def test_of_fins_that_stand_for_each_other_the_larger_stays():
    """A crumb on a fin sticks out of the rest as far as that does."""
    given, new = with_a_fin(0.011)
    below = 21 * 10 + 10
    crumb = np.append(given.balls[new[1], :3] + [0, 0.01, 0], given.balls[new[1], 3])
    faces = np.vstack([given.faces, [new[1], below, len(given)]])
    both = whole(np.vstack([given.balls, crumb]), faces)
    found, place = without_fins(both, tops(both), 0.0105)
    assert structure(both)[0] > structure(found)[0] == 2
    assert (place[new] >= 0).all() and place[-1] < 0


def test_flat_sheets_have_no_fins():
    given = book(3)
    found, place = without_fins(given, tops(given), 1e-3)
    assert len(found) == len(given) and np.array_equal(place, np.arange(len(given)))


@pytest.mark.slow
def test_many_balls_have_the_sheets_of_the_fine_complex():
    """2.0 had some hundred more: merging cut them into pieces."""
    shape = medialis.organic_shape(56)
    mesh = medialis.medial_mesh(shape, balls=1100)
    assert len(mesh) == 1100
    assert structure(mesh.complex) == structure(mesh.level(mesh.most).complex)
    assert mesh.betti == (1, 0, 0)


@pytest.mark.parametrize("balls", [120, 1000])
def test_a_ball_is_one_ball_however_many_are_wanted(balls):
    """The faces of an icosphere lie e^2/6 or less beneath the sphere; bumps are less than that."""
    shape = icosphere(3)
    sag = shape.edge_lengths.max() ** 2 / 6
    rng = np.random.default_rng(0)
    bumpy = shape.points * (1 + 0.05 * sag * rng.uniform(-1, 1, (len(shape.points), 1)))
    result = run("medial_mesh", medialis.make_shape(bumpy, shape.faces), balls=balls)
    assert result.values["balls"] == 1
    assert result.values["largest_error"] < 2 * sag
    (message,) = [one for one in result.messages if one.code == "ball_count"]
    assert "nearly a ball" in str(message)


@pytest.mark.slow
def test_what_is_longer_gets_more_balls():
    """One ball of an ellipsoid is off by half of what its axes differ; a few are less so."""
    shape = icosphere(3)
    long = medialis.make_shape(shape.points * [1.0, 1.0, 1.04], shape.faces)
    mesh = medialis.medial_mesh(long, balls=120)
    assert 1 < len(mesh) < 120
    assert medialis.envelope_distance(mesh, long).largest < 0.3 * 0.02


HOOK = np.array([[0, 0], [1, 0], [1, 0.3], [0.3, 0.3], [0.3, 0.8], [0, 0.8]])
"""The outline of an L."""


def test_rims_of_an_l_reach_its_edges_and_corners():
    """Balls of radius 0 are on the edges that stick out; the places on the one that goes in too."""
    shape = prism(HOOK, 0.4, 0.1)
    solid = Solid(shape.points / shape.diagonal, shape.faces)
    fine = fine_complex(solid, 3000, 0.002, 0, Progress(), on_reflex_edges)
    found, planes = creased(fine, solid)
    assert (found.edges is fine.edges) and (found.faces is fine.faces)
    moved = np.flatnonzero((found.balls != fine.balls).any(axis=1))
    assert len(moved) > 100 and (found.balls[moved, 3] == 0).all()
    assert np.array_equal(np.unique(planes.ball), moved)
    places = found.balls[moved, :3] * shape.diagonal
    sides = np.stack([HOOK, np.roll(HOOK, -1, axis=0)], axis=1)
    x, y = places[:, :2].T
    off = [(b - a)[0] * (y - a[1]) - (b - a)[1] * (x - a[0]) for a, b in sides]
    flat = [np.abs(one) < 1e-9 for one in off]
    ends = np.abs(np.abs(places[:, 2]) - 0.2) < 1e-9
    assert (np.sum([*flat, ends], axis=0) >= 2).all()
    reflex = HOOK[3]
    for x, y in HOOK:
        off = np.linalg.norm(places - [x, y, 0.2], axis=1).min()
        assert (x, y) == tuple(reflex) or off < 1e-9
    inner, normals = on_reflex_edges(solid, 0.01)
    assert np.allclose(inner[:, :2] * shape.diagonal, reflex) and len(inner) > 20
    assert np.allclose(normals, np.array([1, 1, 0]) / np.sqrt(2))
    assert len(on_reflex_edges(solid_of_a_ball(), 0.01)[0]) == 0


def solid_of_a_ball():
    shape = icosphere(2)
    return Solid(shape.points, shape.faces)
