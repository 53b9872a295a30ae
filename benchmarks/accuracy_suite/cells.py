"""Solids of rectangles: drawn as rows of text, extruded, meshed as a grid."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

import medialis
from accuracy_suite.known import mesh_of
from accuracy_suite.sections import Section


def divided(lines: np.ndarray, longest: float) -> np.ndarray:
    """Cut the steps between ascending numbers into equal ones of at most a length."""
    pieces = [
        np.linspace(a, b, max(1, int(np.ceil((b - a) / longest - 1e-9))) + 1)[:-1]
        for a, b in itertools.pairwise(lines)
    ]
    return np.append(np.concatenate(pieces), lines[-1])


@dataclass(frozen=True)
class Cells:
    """A region made of rectangles of a grid.

    Attributes
    ----------
    xs, ys : (a,), (b,) float64
        Lines of the grid.
    filled : (a - 1, b - 1) bool
    """

    xs: np.ndarray
    ys: np.ndarray
    filled: np.ndarray

    @classmethod
    def of_rows(cls, xs: list[float], ys: list[float], rows: list[str]) -> Cells:
        """Read the rectangles from a drawing, the highest row first; # is filled."""
        drawn = np.array([[mark == "#" for mark in row] for row in rows])
        return cls(np.array(xs, float), np.array(ys, float), drawn[::-1].T)

    def section(self) -> Section:
        """Return its boundary; pieces of one side are joined."""
        return Section(np.array(_joined(self._pieces())))

    def solid(self, height: float, longest: float = np.inf) -> medialis.Shape:
        """Extrude it to a mesh: a grid of squares with one diagonal on every rectangle.

        Their sides are at most `longest`; without it there are two triangles for each rectangle.
        """
        fine = self._divided(longest)
        levels = divided(np.array([-height / 2, height / 2]), longest)
        number = np.arange(len(fine.xs) * len(fine.ys)).reshape(len(fine.xs), len(fine.ys))
        n, top = number.size, (len(levels) - 1) * number.size
        quads = []
        for i, j in np.argwhere(fine.filled):
            a, b, c, d = number[i, j], number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]
            quads += [(a + top, b + top, c + top, d + top), (d, c, b, a)]
        x, y = np.meshgrid(fine.xs, fine.ys, indexing="ij")
        flat = np.stack([x.ravel(), y.ravel()], axis=1)
        places = {place: k for k, place in enumerate(map(tuple, flat))}
        for start, end in fine._pieces():
            a, b = places[start], places[end]
            quads += [(a + k, b + k, b + k + n, a + k + n) for k in range(0, top, n)]
        points = np.concatenate([np.column_stack([flat, np.full(n, z)]) for z in levels])
        quads = np.array(quads)
        faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
        used, faces = np.unique(faces, return_inverse=True)
        return mesh_of(points[used], faces.reshape(-1, 3))

    def _divided(self, longest: float) -> Cells:
        """Cut the rectangles into smaller ones."""
        xs, ys = divided(self.xs, longest), divided(self.ys, longest)
        i = np.searchsorted(self.xs, (xs[:-1] + xs[1:]) / 2) - 1
        j = np.searchsorted(self.ys, (ys[:-1] + ys[1:]) / 2) - 1
        return Cells(xs, ys, self.filled[np.ix_(i, j)])

    def _pieces(self) -> list[tuple[tuple[float, float], tuple[float, float]]]:
        """Sides of rectangles that have nothing beyond them."""
        full, pieces = np.pad(self.filled, 1), []
        for i, j in np.argwhere(self.filled):
            x, y = self.xs[i : i + 2], self.ys[j : j + 2]
            ring = [(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])]
            beyond = [full[i + 1, j], full[i + 2, j + 1], full[i + 1, j + 2], full[i, j + 1]]
            pieces += [(ring[k], ring[(k + 1) % 4]) for k in range(4) if not beyond[k]]
        return pieces


def _joined(sides: list) -> list:
    """Join sides that continue each other in the same direction."""
    following = {side[0]: side for side in sides}
    before = {side[1]: side for side in sides}

    def straight(one: tuple, two: tuple) -> bool:
        u, v = np.subtract(one[1], one[0]), np.subtract(two[1], two[0])
        return abs(u[0] * v[1] - u[1] * v[0]) < 1e-12 and u @ v > 0

    result = []
    for side in sides:
        if straight(before[side[0]], side):
            continue
        end = side
        while straight(end, following[end[1]]):
            end = following[end[1]]
        result.append((side[0], end[1]))
    return result
