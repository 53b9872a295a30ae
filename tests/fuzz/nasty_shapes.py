"""Shapes of fewer than 1,000 vertices that break geometry code, made from a random generator."""

from __future__ import annotations

import random
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]
Faces = NDArray[np.int32]
Mesh = tuple[Points, Faces]


def grid(columns: int, rows: int) -> Mesh:
    """Return a flat square of 2 x columns x rows triangles."""
    x, y = np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1), indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    a = (np.arange(columns)[:, None] * (rows + 1) + np.arange(rows)).ravel()
    b, c, d = a + rows + 1, a + rows + 2, a + 1
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return points, faces.astype(np.int32)


def merged(*meshes: Mesh) -> Mesh:
    """Put meshes side by side."""
    starts = np.cumsum([0, *(len(points) for points, _ in meshes)])
    faces = [f + start for (_, f), start in zip(meshes, starts, strict=False)]
    return np.concatenate([p for p, _ in meshes]), np.concatenate(faces).astype(np.int32)


def welded(mesh: Mesh) -> Mesh:
    """Make one vertex of those at the same place; faces that lose a corner go."""
    points, place = np.unique(mesh[0].round(12), axis=0, return_inverse=True)
    faces = place.reshape(-1)[mesh[1]]
    whole = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    return points, faces[whole].astype(np.int32)


def grid_box(cells: int, size: tuple[float, float, float] = (1, 1, 1)) -> Mesh:
    """Return a closed box, each side of cells x cells squares."""
    sides = []
    points, faces = grid(cells, cells)
    for axis in range(3):
        for high in (0.0, 1.0):
            side = np.roll(np.add(points, [0, 0, high]), axis, axis=1)
            sides.append((side, faces if high else faces[:, ::-1]))
    corners, faces = welded(merged(*sides))
    return corners * size, faces


def tube(around: int, along: int, *, radius: float = 0.2) -> Mesh:
    """Return a closed tube with two ends; with one cell along it long triangles."""
    angle = np.arange(around) * 2 * np.pi / around
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1) * radius
    heights = np.repeat(np.linspace(0, 1, along + 1), around)
    points = np.column_stack([np.tile(ring, (along + 1, 1)), heights])
    points = np.concatenate([points, [[0, 0, 0], [0, 0, 1]]])
    a = np.arange(around * along)
    b = a // around * around + (a + 1) % around
    side = np.concatenate(
        [np.stack([a, b, b + around], axis=1), np.stack([a, b + around, a + around], axis=1)]
    )
    first, last = len(points) - 2, len(points) - 1
    low = np.arange(around)
    top = low + around * along
    ends = [
        np.stack([np.full(around, first), np.roll(low, -1), low], axis=1),
        np.stack([np.full(around, last), top, np.roll(top, -1)], axis=1),
    ]
    return points, np.concatenate([side, *ends]).astype(np.int32)


def sphere(rings: int) -> Mesh:
    """Return a ball: a tube whose rings are circles of latitude."""
    points, faces = tube(2 * rings, rings, radius=1.0)
    height = (points[:, 2] - 0.5) * np.pi * (1 - 1 / (rings + 1))
    flat = np.cos(height)[:, None]
    points = np.column_stack([points[:, :2] * flat, np.sin(height)])
    points[-2:] = [[0, 0, -1], [0, 0, 1]]
    return points, faces


def _random_box(rng: random.Random) -> Mesh:
    size = tuple(10 ** rng.uniform(-2, 0) for _ in range(3))
    return grid_box(rng.randint(1, 8), (size[0], size[1], size[2]))


def _plain(rng: random.Random) -> Mesh:
    return rng.choice(
        (
            lambda: sphere(rng.randint(2, 14)),
            lambda: tube(rng.randint(3, 20), rng.randint(1, 30), radius=10 ** rng.uniform(-3, 0)),
            lambda: _random_box(rng),
        )
    )()


def _slivers(rng: random.Random) -> Mesh:
    points, faces = _plain(rng)
    points = points.copy()
    points[:, rng.randrange(3)] *= 10 ** rng.uniform(-8, -1)
    return points, faces


def _long_tube(rng: random.Random) -> Mesh:
    return tube(rng.choice((40, 80, 160)), 1, radius=10 ** rng.uniform(-3, 0))


def _plate(rng: random.Random) -> Mesh:
    thin = 10 ** rng.uniform(-6, -1)
    return grid_box(rng.randint(1, 10), (1, rng.uniform(0.1, 1), thin))


def _folded(rng: random.Random) -> Mesh:
    points, faces = grid(rng.randint(2, 20), rng.randint(1, 20))
    points = points.copy()
    line, angle = rng.random(), np.pi * rng.choice((0.5, 0.99, 1.0, rng.random()))
    beyond = points[:, 0] > line
    rest = points[beyond, 0] - line
    points[beyond, 0] = line + rest * np.cos(angle)
    points[beyond, 2] = rest * np.sin(angle)
    return points, faces


def _duplicated(rng: random.Random) -> Mesh:
    points, faces = _plain(rng)
    rows = np.array(
        [rng.randrange(len(faces)) for _ in range(rng.choice((1, len(faces) // 2 + 1)))]
    )
    again = faces[rows]
    return points, np.concatenate([faces, again[:, ::-1] if rng.random() < 0.5 else again])


def _back_to_back(rng: random.Random) -> Mesh:
    points, faces = grid(rng.randint(1, 15), rng.randint(1, 15))
    return points, np.concatenate([faces, faces[:, ::-1]])


def _fan(rng: random.Random) -> Mesh:
    """Pages of a book: an edge with many faces."""
    count = rng.choice((3, 5, 50, 400))
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    tips = np.stack([np.cos(angle), np.sin(angle), np.full(count, 0.5)], axis=1)
    points = np.concatenate([[[0, 0, 0], [0, 0, 1]], tips])
    index = np.arange(count) + 2
    return points, np.stack([0 * index, 0 * index + 1, index], axis=1).astype(np.int32)


def _hub(rng: random.Random) -> Mesh:
    """Cones that touch in one vertex."""
    parts = []
    for _ in range(rng.randint(2, 5)):
        points, faces = tube(rng.randint(3, 12), 1)
        points = points - points[-1]
        parts.append((points @ _rotation(rng).T, faces))
    return welded(merged(*parts))


def _moebius(rng: random.Random) -> Mesh:
    count, width = rng.randint(5, 80), rng.randint(1, 4)
    points, faces = grid(count, width)
    angle, half = points[:, 0] * 2 * np.pi, (points[:, 1] - 0.5) * 10 ** rng.uniform(-2, 0)
    turn = angle / 2 * rng.choice((1, 1, 3))
    radius = 1 + half * np.cos(turn)
    place = np.stack([radius * np.cos(angle), radius * np.sin(angle), half * np.sin(turn)], axis=1)
    return welded((place, faces))


def _crossing(rng: random.Random) -> Mesh:
    parts = []
    for _ in range(rng.randint(2, 4)):
        points, faces = _few(_plain(rng))
        move = np.array([rng.uniform(-0.5, 0.5) for _ in range(3)]) * rng.choice((0, 1, 1))
        parts.append((points @ _rotation(rng).T + move, faces))
    return merged(*parts)


def _nested(rng: random.Random) -> Mesh:
    points, faces = sphere(rng.randint(2, 9))
    parts = []
    for depth in range(rng.randint(2, 4)):
        shrunk = points * rng.choice((0.5, 0.9, 0.999999, 1.0)) ** depth
        parts.append((shrunk, faces[:, ::-1] if rng.random() < 0.5 else faces))
    return merged(*parts)


def _touching(rng: random.Random) -> Mesh:
    first = grid_box(rng.randint(1, 5))
    step = [1.0, rng.choice((0, 0.5, 1.0)), rng.choice((0, 1.0))]
    both = merged(first, (first[0] + step, first[1]))
    return welded(both) if rng.random() < 0.5 else both


def _open_sheet(rng: random.Random) -> Mesh:
    points, faces = grid(rng.randint(1, 25), rng.randint(1, 25))
    points = points.copy()
    height = 10 ** rng.uniform(-6, 0)
    points[:, 2] = height * np.sin(points[:, 0] * rng.uniform(0, 20)) * np.cos(points[:, 1] * 5)
    return points, faces


def _few_triangles(rng: random.Random) -> Mesh:
    count = rng.choice((1, 1, 2, 3, 4))
    points = np.array([[rng.uniform(-1, 1) for _ in range(3)] for _ in range(3 * count)])
    if rng.random() < 0.3:
        points[2::3] = points[0::3] + (points[1::3] - points[0::3]) * rng.random()  # on a line
    return points, np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


def _flat(rng: random.Random) -> Mesh:
    points, faces = _plain(rng)
    points = points.copy()
    points[:, rng.randrange(3)] = rng.choice((0.0, 1e-300, 7.0))
    return points, faces


def _soup(rng: random.Random) -> Mesh:
    count = rng.choice((4, 20, 100, 400))
    generator = np.random.default_rng(rng.randrange(2**32))
    points = generator.normal(size=(count, 3)) * 10.0 ** generator.integers(-3, 3, size=(count, 1))
    if rng.random() < 0.3:
        points = points.round(1)
    return points, generator.integers(0, count, size=(2 * count, 3)).astype(np.int32)


def _fin(rng: random.Random) -> Mesh:
    """A body with a fin of hardly any thickness."""
    thin = 10 ** rng.uniform(-9, -2)
    points, faces = grid_box(rng.randint(1, 6), (0.8, thin, 0.5))
    body = grid_box(rng.randint(1, 6))
    return merged(body, (np.add(points, [0.9, 0.5, 0.25]), faces))


def _pyramids(rng: random.Random) -> Mesh:
    """A sphere with spikes, or with deep holes."""
    points, faces = sphere(rng.randint(3, 12))
    points = points.copy()
    for _ in range(rng.randint(1, 5)):
        points[rng.randrange(len(points))] *= rng.choice((-1, -5, 0, 0.01, 3, 1000))
    return points, faces


def _tetrahedron(rng: random.Random) -> Mesh:
    points = np.array([[rng.uniform(-1, 1) for _ in range(3)] for _ in range(4)])
    points[3] *= 10 ** rng.uniform(-12, 0)
    return points, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], np.int32)


def _far_apart(rng: random.Random) -> Mesh:
    """Bodies of very different size, very far from each other."""
    parts, here = [], np.zeros(3)
    for _ in range(rng.randint(2, 4)):
        points, faces = _few(_plain(rng)) if rng.random() < 0.2 else _plain(rng)
        parts.append((points * 10 ** rng.uniform(-4, 1) + here, faces))
        way = np.array([rng.gauss(0, 1) for _ in range(3)])
        here = here + way / np.linalg.norm(way) * 10 ** rng.uniform(0, 8)
    return merged(*parts)


def _shattered(rng: random.Random) -> Mesh:
    """Triangles that have no corner in common."""
    count = rng.choice((10, 100, 600))
    generator = np.random.default_rng(rng.randrange(2**32))
    size = 10 ** rng.uniform(-3, 0)
    corners = generator.random((count, 1, 3)) + size * generator.normal(size=(count, 3, 3))
    return corners.reshape(-1, 3), np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


def _degenerate(rng: random.Random) -> Mesh:
    """Faces without an area: of one vertex, on an edge, of three places on a line."""
    points, faces = _plain(rng)
    rows = np.array([rng.randrange(len(faces)) for _ in range(rng.choice((1, 5, 40)))])
    more = faces[rows].copy()
    kind = rng.randrange(3)
    if kind < 2:
        more[:, 1 : 2 + kind] = more[:, :1]
        return points, np.concatenate([faces, more])
    middles = points[more[:, :2]].mean(axis=1)
    more[:, 2] = len(points) + np.arange(len(more))
    return np.concatenate([points, middles]), np.concatenate([faces, more])


MAKERS: tuple[Callable[[random.Random], Mesh], ...] = (
    *(_plain, _slivers, _long_tube, _plate, _folded, _duplicated, _back_to_back, _fan, _hub),
    *(_moebius, _crossing, _nested, _touching, _open_sheet, _few_triangles, _flat, _soup, _fin),
    *(_pyramids, _tetrahedron, _far_apart, _far_apart, _shattered, _degenerate),
)


def _rotation(rng: random.Random) -> Points:
    axes, _ = np.linalg.qr([[rng.gauss(0, 1) for _ in range(3)] for _ in range(3)])
    return np.asarray(axes)


def _few(mesh: Mesh) -> Mesh:
    """Keep at most 300 faces."""
    return mesh[0], mesh[1][:300]


def _turned(rng: random.Random, mesh: Mesh) -> Mesh:
    return mesh[0] @ _rotation(rng).T, mesh[1]


def _moved(rng: random.Random, mesh: Mesh) -> Mesh:
    diagonal = float(np.linalg.norm(np.ptp(mesh[0], axis=0))) or 1.0
    far = diagonal * 10 ** rng.uniform(3, 9)
    return mesh[0] + far * np.array([rng.choice((0, 1, -1, rng.random())) for _ in range(3)]), mesh[
        1
    ]


def _scaled(rng: random.Random, mesh: Mesh) -> Mesh:
    return mesh[0] * 10 ** rng.uniform(-20, 20), mesh[1]


def _lone_points(rng: random.Random, mesh: Mesh) -> Mesh:
    more = np.array([[rng.uniform(-2, 2) for _ in range(3)] for _ in range(rng.choice((1, 30)))])
    return np.concatenate([mesh[0], more]), mesh[1]


def _near_twins(rng: random.Random, mesh: Mesh) -> Mesh:
    """Split vertices into pairs that nearly coincide."""
    points, faces = mesh
    rows = np.array([rng.randrange(len(faces)) for _ in range(min(20, len(faces)))])
    corners = faces[rows, 0]
    gap = 10 ** rng.uniform(-17, -4)
    twins = points[corners] * (1 + gap)
    changed = faces.copy()
    changed[rows, 0] = len(points) + np.arange(len(rows))
    return np.concatenate([points, twins]), changed


def _inside_out(rng: random.Random, mesh: Mesh) -> Mesh:
    points = mesh[0].copy()
    middle = points.mean(axis=0)
    for _ in range(rng.choice((1, 1, 5))):
        row = rng.randrange(len(points))
        points[row] = middle - (points[row] - middle) * rng.choice((0.5, 1, 2))
    return points, mesh[1]


def _holes(rng: random.Random, mesh: Mesh) -> Mesh:
    rows = np.array([rng.random() > 0.1 for _ in range(len(mesh[1]))])
    return (mesh[0], mesh[1][rows]) if rows.any() else mesh


def _mixed_sides(rng: random.Random, mesh: Mesh) -> Mesh:
    faces = mesh[1].copy()
    rows = np.array([rng.random() < 0.3 for _ in range(len(faces))])
    faces[rows] = faces[rows, ::-1]
    return mesh[0], faces


def _noisy(rng: random.Random, mesh: Mesh) -> Mesh:
    generator = np.random.default_rng(rng.randrange(2**32))
    return mesh[0] + generator.normal(size=mesh[0].shape) * 10 ** rng.uniform(-9, -1), mesh[1]


def _rounded(rng: random.Random, mesh: Mesh) -> Mesh:
    return mesh[0].astype(np.float32).round(rng.choice((1, 2, 4))).astype(np.float64), mesh[1]


CHANGES: tuple[Callable[[random.Random, Mesh], Mesh], ...] = (
    *(_turned, _turned, _moved, _scaled, _lone_points, _near_twins, _inside_out, _holes),
    *(_mixed_sides, _noisy, _rounded),
)


def nasty_mesh(rng: random.Random) -> tuple[Points, Faces, str]:
    """Return a mesh and what was done to make it."""
    maker = rng.choice(MAKERS)
    mesh = maker(rng)
    names = [maker.__name__]
    for change in rng.sample(CHANGES, rng.choice((0, 0, 1, 1, 2, 3))):
        mesh = change(rng, mesh)
        names.append(change.__name__)
    return mesh[0], mesh[1], " ".join(name.strip("_") for name in names)


def nasty_normals(rng: random.Random, points: Points) -> Points | None:
    """Return normals of a cloud: none, zero, of any length, all the same, wrong or right."""
    generator = np.random.default_rng(rng.randrange(2**32))
    out = points - points.mean(axis=0)
    kind = rng.randrange(7)
    if kind == 0:
        return None
    if kind == 1:
        return np.zeros_like(points)
    if kind == 2:
        return np.tile([0.0, 0.0, rng.choice((1.0, 1e-300, 1e300))], (len(points), 1))
    if kind == 3:
        return generator.normal(size=points.shape)
    if kind == 4:
        return -out
    if kind == 5:
        out[generator.random(len(out)) < 0.3] = 0
    return out
