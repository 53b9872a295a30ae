"""Unions of pieces: closed forms, bridges, loose pieces, clothes, and invariants."""

import numpy as np
import pytest

import medialis
from medialis.shape.union import unite, united


def ball(center, radius, detail=24):
    """A closed sphere: points and faces."""
    u = np.linspace(0, np.pi, detail + 1)[1:-1]
    v = 2 * np.pi * np.arange(2 * detail) / (2 * detail)
    rings = np.stack([
        np.outer(np.sin(u), np.cos(v)), np.outer(np.sin(u), np.sin(v)),
        np.outer(np.cos(u), np.ones(len(v))),
    ], axis=-1).reshape(-1, 3)  # fmt: skip
    n, rows = len(v), np.arange(len(v))
    sides = [
        face
        for k in range(len(u) - 1)
        for face in (
            np.stack([k * n + rows, (k + 1) * n + rows, (k + 1) * n + (rows + 1) % n], axis=1),
            np.stack([k * n + rows, (k + 1) * n + (rows + 1) % n, k * n + (rows + 1) % n], axis=1),
        )
    ]
    top, bottom, last = len(rings), len(rings) + 1, (len(u) - 1) * n
    caps = [
        np.stack([np.full(n, top), rows, (rows + 1) % n], axis=1),
        np.stack([np.full(n, bottom), last + (rows + 1) % n, last + rows], axis=1),
    ]
    points = np.concatenate([rings, [[0, 0, 1], [0, 0, -1]]])
    return radius * points + center, np.concatenate([*sides, *caps])


def together(*pieces):
    """One shape of pieces, each points and faces."""
    starts = np.cumsum([0, *(len(points) for points, _ in pieces)])
    faces = [faces + start for (_, faces), start in zip(pieces, starts, strict=False)]
    points = np.concatenate([points for points, _ in pieces])
    return medialis.make_shape(points, np.concatenate(faces))


def volume(shape):
    corners = shape.points[shape.faces]
    return float(np.linalg.det(corners).sum()) / 6


@pytest.mark.slow
def test_the_union_of_two_balls_has_the_volume_of_the_lens_once():
    """The volume of the union of two unit balls is known; the cell is a fiftieth of the radius."""
    far = 1.2
    shape = together(ball([0, 0, 0], 1.0, 40), ball([far, 0, 0], 1.0, 40))
    found = unite(shape)
    lens = np.pi / 12 * (4 + far) * (2 - far) ** 2
    # Facets of the balls cut off 0.4 %.
    assert volume(found.shape) == pytest.approx(8 / 3 * np.pi - lens, rel=0.01)
    assert found.shape.part_count == 1 and found.shape.topology.is_solid
    assert found.body.tolist() == [0, 0] and not found.loose.any()
    ends = np.linalg.norm(found.shape.points[:, None] - [[0, 0, 0], [far, 0, 0]], axis=2)
    assert np.abs(ends.min(axis=1) - 1).max() < 0.05


def test_one_piece_is_returned_as_it_is():
    shape = together(ball([0, 0, 0], 1.0))
    assert unite(shape).shape is shape and unite(shape, joined=True).shape is shape


def test_walls_of_cavities_are_no_pieces():
    points, faces = ball([0, 0, 0], 0.5)
    shape = together(ball([0, 0, 0], 1.0), (points, faces[:, ::-1]))
    assert shape.part_count == 2 and united(shape) is shape


@pytest.mark.slow
def test_touching_pieces_are_one_body_and_pieces_apart_are_not():
    touching = together(ball([0, 0, 0], 1.0), ball([2, 0, 0], 1.0))
    apart = together(ball([0, 0, 0], 1.0), ball([2.4, 0, 0], 1.0))
    assert unite(touching).shape.part_count == 1
    assert unite(apart).shape.part_count == 2 and unite(apart).body.tolist() == [0, 1]


@pytest.mark.slow
def test_a_bridge_connects_the_nearest_places():
    shape = together(ball([0, 0, 0], 1.0), ball([2.4, 0, 0], 1.0), ball([4.8, 0, 0], 1.0))
    found = unite(shape, joined=True)
    assert found.shape.part_count == 1 and len(found.bridges) == 2
    assert np.abs(found.bridges[:, :, 1:]).max() < 0.1
    assert np.sort(found.bridges[:, :, 0].ravel()) == pytest.approx([0, 2.4, 2.4, 4.8], abs=0.1)


@pytest.mark.slow
def test_small_loose_pieces_and_open_sheets_are_left_out():
    sheet = np.array([[-1, 1.2, 0], [1, 1.2, 0], [1, 1.2, 1], [-1, 1.2, 1.0]])
    shape = together(
        ball([0, 0, 0], 1.0), ball([1.0, 0, 1.0], 0.5), ball([0, 0, 1.2], 0.03, 6),
        (sheet, np.array([[0, 1, 2], [0, 2, 3]])),
    )  # fmt: skip
    found = unite(shape, joined=True)
    assert found.body.tolist() == [0, 0, -1, -1] and found.shape.part_count == 1


@pytest.mark.slow
def test_holes_that_other_pieces_cover_do_not_matter():
    points, faces = ball([0, 0, 0], 1.0)
    cut = faces[(points[faces][:, :, 0] < 0.5).all(axis=1)]
    used, number = np.unique(cut, return_inverse=True)
    shape = together((points[used], number.reshape(-1, 3)), ball([0.9, 0, 0], 0.95))
    found = unite(shape)
    assert found.shape.part_count == 1 and not found.loose.any()
    assert found.shape.points[:, 0].min() == pytest.approx(-1, abs=0.02)


@pytest.mark.slow
def test_many_pieces_take_no_longer_than_few():
    """Cost follows the grid: 400 overlapping balls along a ring."""
    angles = 2 * np.pi * np.arange(400) / 400
    middles = 10 * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    found = unite(together(*(ball(middle, 0.3, 4) for middle in middles)))
    assert found.shape.part_count == 1 and found.piece_count == 400
    assert len(found.shape.faces) == 2 * found.shape.point_count  # a ring: one handle


@pytest.mark.slow
def test_the_given_points_are_unchanged_and_results_repeat():
    shape = together(ball([0, 0, 0], 1.0), ball([1.2, 0, 0], 1.0))
    before = shape.points.copy()
    first, second = unite(shape), unite(shape)
    assert (shape.points == before).all()
    assert (first.shape.points == second.shape.points).all()
    assert (first.nearest == second.nearest).all() and len(first.nearest) == shape.point_count
