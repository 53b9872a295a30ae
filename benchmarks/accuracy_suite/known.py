"""Shapes whose medial axis is known, and grids of points on their surfaces as meshes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

import medialis
from medialis.shape.normals import vertex_normals

NEIGHBOURS = 6
"""Places of the truth that may be the nearest one to a point."""


@dataclass(frozen=True)
class Truth:
    """A medial axis as many places with the ball of each.

    Attributes
    ----------
    points : (t, 3) float64
    radii : (t,) float64
    normals : (t, 3) float64
        Of the sheet; zero on curves and at points.
    cover : (t,) float64
        Radius of the piece of a sheet that a place stands for; 0 on curves, which are dense.
    """

    points: np.ndarray
    radii: np.ndarray
    normals: np.ndarray
    cover: np.ndarray

    @classmethod
    def of_curve(cls, points: np.ndarray, radii: np.ndarray) -> Truth:
        """Return a dense curve, or a single point."""
        none = np.zeros(len(points))
        return cls(points, np.broadcast_to(radii, len(points)), np.zeros((len(points), 3)), none)

    @classmethod
    def joined(cls, parts: list[Truth]) -> Truth:
        """Return several of them as one."""
        names = ("points", "radii", "normals", "cover")
        return cls(*(np.concatenate([getattr(one, name) for one in parts]) for name in names))

    def distances(self, queries: np.ndarray) -> np.ndarray:
        """Return the distance of points to the axis, (q,): to flat discs round its places.

        Exact on plane sheets; on curved ones to half a curvature times the squared cover, and up to
        a cover too small beyond a rim.
        """
        k = min(NEIGHBOURS, len(self.points))
        rows = cKDTree(self.points).query(queries, k=k)[1].reshape(len(queries), k)
        away = queries[:, None] - self.points[rows]
        height = np.einsum("ijk,ijk->ij", away, self.normals[rows])
        flat = np.sqrt(np.maximum((away**2).sum(axis=2) - height**2, 0))
        return np.hypot(height, np.maximum(flat - self.cover[rows], 0)).min(axis=1)


@dataclass(frozen=True)
class KnownShape:
    """A solid, its meshes and what is known of it; what is not known is None.

    Attributes
    ----------
    name : str
    kind : str
        "closed form", "CAD" or "organic".
    make : function
        From the longest edge (inf: as few triangles as the form needs) and a random generator
        (None: a regular mesh) to a Shape whose vertices lie on the true surface.
    truth : function
        Returns the medial axis.
    across : float
        The smallest thickness: n samples across are edges of across / n.
    coarse : bool
        Whether a mesh of few triangles is the same solid (plane faces).
    sheets, areas, y_length : int, (sheets,) float64, float
        Sheets of the axis, their areas in ascending order, and the length of the curves where three
        of them meet.
    loops, ends : int
        Of the curve skeleton.
    curve : (c, 3) float64
        The curve skeleton, densely.
    thinnest : tuple of float and (p, 3) float64
        The smallest thickness and the places of the surface that have it, densely.
    """

    name: str
    kind: str
    make: Callable[[float, np.random.Generator | None], medialis.Shape]
    truth: Callable[[], Truth]
    across: float
    coarse: bool = False
    sheets: int | None = None
    areas: np.ndarray | None = None
    y_length: float | None = None
    loops: int | None = None
    ends: int | None = None
    curve: np.ndarray | None = None
    thinnest: tuple[float, np.ndarray] | None = None


def mesh_of(points: np.ndarray, faces: np.ndarray) -> medialis.Shape:
    """Return a mesh with the normals that any file would get."""
    return medialis.Shape(points, vertex_normals(points, faces), faces)


def grid_mesh(
    surface: Callable[[np.ndarray, np.ndarray], np.ndarray],
    rows: np.ndarray,
    columns: int,
    *,
    free: np.ndarray,
    poles: bool,
    twist: int = 0,
    rng: np.random.Generator | None = None,
) -> medialis.Shape:
    """Triangulate a surface over a grid of parameters, closed in both directions.

    Parameters
    ----------
    surface : function
        From parameters u (k,) and v (k,), v once round from 0 to 1, to points (k, 3).
    rows : (r,) float
        Values of u, ascending. With `poles` the first and the last row are one point each, else the
        last row is followed by the first one.
    columns : int
    free : (r,) bool
        Rows that may move along u in an irregular mesh; creases may not.
    twist : int
        Rows by which the grid is shifted after once round.
    rng : Generator, optional
        Moves every vertex by up to 0.3 cells and draws the diagonals.

    Returns
    -------
    Shape
        Normals point out where u, v and the outward normal are a right-handed frame.
    """
    count = len(rows)
    u = np.repeat(rows[:, None], columns, axis=1).astype(float)
    v = np.repeat(np.arange(columns)[None] / columns, count, axis=0)
    if rng is not None:
        gap = np.minimum(np.diff(rows, prepend=2 * rows[0] - rows[1]), np.diff(rows, append=np.inf))
        u += rng.uniform(-0.3, 0.3, u.shape) * np.where(free, gap, 0.0)[:, None]
        v += rng.uniform(-0.3, 0.3, v.shape) / columns
    number = np.arange(count * columns).reshape(count, columns)
    after = np.concatenate([number, number[:1]]) if not poles else number
    around = np.concatenate([after[:-1], after[-1:]])
    right = np.roll(around, -1, axis=1)
    if twist:
        shifted = (np.arange(len(around)) + twist) % count
        right[:, -1] = number[shifted, 0]
    a, b, c, d = around[:-1], around[1:], right[1:], right[:-1]
    quads = np.stack([x.ravel() for x in (a, b, c, d)], axis=1)
    flip = np.zeros(len(quads), bool) if rng is None else rng.random(len(quads)) < 0.5
    straight, crossed = quads[~flip], quads[flip]
    triangles = [straight[:, [0, 1, 2]], straight[:, [0, 2, 3]]]
    triangles += [crossed[:, [0, 1, 3]], crossed[:, [1, 2, 3]]]
    faces = np.concatenate(triangles)
    points = surface(u.ravel(), v.ravel())
    if poles:
        first = np.arange(count * columns)
        first[:columns], first[-columns:] = 0, number[-1, 0]
        faces = first[faces]
    proper = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    used, faces = np.unique(faces[proper], return_inverse=True)
    return mesh_of(points[used], faces.reshape(-1, 3))


def shaken(shape: medialis.Shape, rng: np.random.Generator) -> medialis.Shape:
    """Move the vertices of a polyhedron within its faces and along its edges, by chance.

    By up to 0.3 of the shortest edge at a vertex; the solid stays the same. Vertices whose
    triangles would turn over or get a tenth of their area stay.
    """
    normals = shape.face_normals
    total = np.zeros((shape.point_count, 3, 3))
    outer = normals[:, :, None] * normals[:, None, :]
    for corner in range(3):
        np.add.at(total, shape.faces[:, corner], outer)
    size, axes = np.linalg.eigh(total)
    within = size < 1e-9 * size[:, -1:]  # directions that all faces there contain
    shortest = np.full(shape.point_count, np.inf)
    for end in (0, 1):
        np.minimum.at(shortest, shape.edges[:, end], shape.edge_lengths)
    step = rng.uniform(-0.3, 0.3, size.shape) * within * shortest[:, None]
    move = np.einsum("ijk,ik->ij", axes, step)
    for _ in range(100):
        points = shape.points + move
        a, b, c = points[shape.faces.T]
        along = (np.cross(b - a, c - a) * normals).sum(axis=1) / 2
        bad = along < 0.1 * shape.face_areas
        if not bad.any():
            break
        move[shape.faces[bad]] = 0
    return mesh_of(points, shape.faces)


def made(
    solid: Callable[[float], medialis.Shape], longest: float, rng: np.random.Generator | None
) -> medialis.Shape:
    """Mesh a polyhedron regularly, or shake that mesh where `rng` is given."""
    return solid(longest) if rng is None else shaken(solid(longest), rng)


def sunflower(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Points spread evenly over the unit disc, and a tenth as many on its rim: x and y."""
    i = np.arange(count)
    rho = np.append(np.sqrt((i + 0.5) / count), np.ones(count // 10))
    turn = np.append(i * np.pi * (3 - np.sqrt(5)), 20 * np.pi * i[: count // 10] / count)
    return rho * np.cos(turn), rho * np.sin(turn)
