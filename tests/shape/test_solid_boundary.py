"""The boundary of the solid of a mesh: manifold, closed, with the handles of the solid."""

import numpy as np
import pytest
from scipy import ndimage

import medialis
from medialis.curves.growth import find_handles
from medialis.shape.surface import solid_boundary


def voxel_surface(full):
    """The faces between full and empty cells, outward; corners at the same place are one vertex."""
    cells = np.pad(full, 1)
    faces, count = [], np.array(cells.shape) + 1
    for axis in range(3):
        u, v = np.eye(3, dtype=int)[[(axis + 1) % 3, (axis + 2) % 3]]
        for sign in (-1, 1):
            beside = np.roll(cells, -sign, axis)
            low = np.argwhere(cells & ~beside) + (sign > 0) * np.eye(3, dtype=int)[axis]
            ring = [low, low + u, low + u + v, low + v][::sign]
            corner = [np.ravel_multi_index(tuple(place.T), count) for place in ring]
            faces += [np.stack([corner[0], corner[i], corner[i + 1]], axis=1) for i in (1, 2)]
    used, faces = np.unique(np.concatenate(faces), return_inverse=True)
    points = np.stack(np.unravel_index(used, count), axis=1).astype(float)
    return points, faces.reshape(-1, 3)


def handles_of_voxels(full):
    """b1 of the solid: surfaces - Euler characteristic of what hangs together, by counting cells.

    Cells hang together through faces, empty ones through edges too. Where empty cells touch at a
    corner only, the solid passes between them: the loops that cells form round a corner are filled.
    """
    cells = np.pad(full, 1)
    euler = 0
    for sizes in np.ndindex(2, 2, 2):
        euler += (-1) ** sum(sizes) * int(blocks(cells, sizes).all(axis=-1).sum())
    corners = blocks(cells, (1, 1, 1)).reshape(-1, 8)
    for octants, count in zip(*np.unique(corners, axis=0, return_counts=True), strict=True):
        one = octants.reshape(2, 2, 2)
        link = sum(
            (-1) ** sum(sizes) * int(blocks(one, sizes).all(axis=-1).sum())
            for sizes in np.ndindex(2, 2, 2)
            if sum(sizes) < 3
        )
        if not one.all():
            euler += count * (ndimage.label(one)[1] - link)
    solids = ndimage.label(cells)[1]
    cavities = ndimage.label(~cells, ndimage.generate_binary_structure(3, 2))[1] - 1
    return solids + cavities - euler


def blocks(cells, sizes):
    """All blocks of 1 + sizes cells, the cells of each in the last axis."""
    windows = np.lib.stride_tricks.sliding_window_view(cells, np.array(sizes) + 1)
    return windows.reshape(*windows.shape[:3], -1)


def check_closed(boundary):
    faces, twins = boundary.faces, boundary.twins
    assert (twins[twins] == np.arange(3 * len(faces))).all()
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    assert (start[twins] == end).all() and (end[twins] == start).all()


@pytest.mark.parametrize("seed", range(12))
def test_handles_of_random_voxels(seed):
    """Cells that touch at edges and corners in every way, against counting cells."""
    random = np.random.default_rng(seed)
    full = random.random((5, 6, 7)) < (0.35 if seed % 2 else 0.6)
    points, faces = voxel_surface(full)
    shape = medialis.Shape(points, np.zeros_like(points), faces)
    assert (shape.edge_table.counts > 2).any()
    boundary = solid_boundary(shape)
    check_closed(boundary)
    assert boundary.unclear.sum() == 0 and boundary.seams.sum() > 0
    for same in (shape, medialis.make_shape(points, faces[:, ::-1], repair=True)):
        found = find_handles(same)
        assert sum(one.genus for one in found.values()) == handles_of_voxels(full)


def test_walls_and_fins_are_no_part_of_the_boundary():
    """A ring of eight boxes with a wall between two of them; a fin on an edge outside."""
    full = np.ones((3, 3, 1), bool)
    full[1, 1] = False
    points, faces = voxel_surface(full)
    square = [
        points.tolist().index(place) for place in ([1, 2, 1], [1, 3, 1], [1, 3, 2], [1, 2, 2])
    ]
    wall = np.array([square])[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
    outside = [points.tolist().index(place) for place in ([1, 1, 1], [1, 1, 2])]
    fin = np.array([[*outside, len(points)]])
    for more, tip in (
        (wall, []),
        (wall[:, ::-1], []),
        (fin, [[0, 0, 3]]),
        (fin[:, ::-1], [[9, 0, 3]]),
    ):
        corners = np.concatenate([points, np.reshape(tip, (-1, 3))])
        shape = medialis.make_shape(corners, np.concatenate([faces, more]), repair=True)
        boundary = solid_boundary(shape)
        check_closed(boundary)
        assert boundary.unclear.sum() == boundary.seams.sum() > 0
        (one,) = find_handles(shape).values()
        assert one.genus == 1 and one.unclear == boundary.unclear.sum()


def test_what_touches_in_an_edge_or_a_vertex_stays_apart():
    """Two cubes touching in an edge, in a vertex, and a chain of six that closes at a vertex."""
    two = np.zeros((2, 2, 2), bool)
    two[0, 0, 0] = two[1, 1, 0] = True
    (one,) = find_handles(medialis.make_shape(*voxel_surface(two))).values()
    assert (one.genus, one.seams, one.unclear) == (0, 1, 0)
    two[1, 1] = [False, True]
    (one,) = find_handles(medialis.make_shape(*voxel_surface(two))).values()
    assert (one.genus, one.seams, one.unclear) == (0, 1, 0)


def test_a_one_sided_surface_has_a_number_that_is_called_a_guess():
    """A Moebius band: cut along the line beyond which its faces disagree, it is a strip."""
    turn, count = np.linspace(0, 2 * np.pi, 41)[:-1], 40
    middle = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    across = np.cos(turn / 2)[:, None] * middle + np.sin(turn / 2)[:, None] * [0, 0, 1]
    points = np.concatenate([middle - 0.3 * across, middle + 0.3 * across])
    a, b = np.arange(count), (np.arange(count) + 1) % count
    c, d = a + count, np.where(b == 0, 0, b + count)
    b = np.where(b == 0, count, b)
    faces = np.concatenate([np.stack([a, b, d], axis=1), np.stack([a, d, c], axis=1)])
    shape = medialis.make_shape(points, faces)
    boundary = solid_boundary(shape)
    check_closed(boundary)
    (one,) = find_handles(shape).values()
    assert one.genus == 0 and one.unclear == 1


@pytest.mark.slow
def test_frames_that_touch_in_an_edge_have_both_loops():
    """Two square frames of voxels that share an edge: one component, a loop each (was none)."""
    full = np.zeros((10, 10, 1), bool)
    for place in (0, 5):
        full[place : place + 5, place : place + 5] = True
        full[place + 1 : place + 4, place + 1 : place + 4] = False
    run = medialis.run("curve_skeleton", medialis.make_shape(*voxel_surface(full), repair=True))
    assert run.graph.loops == run.values["expected_loops"] == handles_of_voxels(full) == 2
    assert run.graph.component_count == 1 and run.values["expected_loops_certain"]
    assert "handles_of_solid" in {message.code for message in run.messages}
