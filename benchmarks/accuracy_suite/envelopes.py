"""Envelopes of balls round a curve, or on a sheet with a rounded rim: what has that as its axis.

The balls of radius r along a curve touch their envelope where a unit vector d from the center has
d.T = -dr/ds; those on a sheet where d = -grad r +- sqrt(1 - |grad r|^2) n, and along its rim at all
d with d.T = -dr/ds between the two. The axis is exact while no ball reaches into another one's
contact; `tests/benchmarks` checks that all balls are empty.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import medialis
from accuracy_suite.known import Truth, grid_mesh, sunflower
from accuracy_suite.sections import turned_out

STEP = 1e-6
"""Of central differences, in parameters of order 1."""

Function = Callable[..., np.ndarray]


def unit(vectors: np.ndarray) -> np.ndarray:
    """Rows divided by their lengths."""
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def steps(count: int) -> np.ndarray:
    """Return 0, 1 / count, ... below 1."""
    return np.arange(count) / count


@dataclass(frozen=True)
class Canal:
    """Balls along a curve.

    Attributes
    ----------
    curve : function
        From t (k,) in 0..1 to (k, 3), smooth; closed where `closed`.
    radius : function
        From t to (k,).
    up : (3,) float or function
        A direction that is nowhere along the curve, or one for each t.
    """

    curve: Function
    radius: Function
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    closed: bool = False

    def frame(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Tangent, two normals and dr/ds, at each t."""
        speed = (self.curve(t + STEP) - self.curve(t - STEP)) / (2 * STEP)
        length = np.linalg.norm(speed, axis=1)
        tangent = speed / length[:, None]
        up = np.array(self.up)
        first = unit(up - (tangent @ up)[:, None] * tangent)
        slope = (self.radius(t + STEP) - self.radius(t - STEP)) / (2 * STEP) / length
        return tangent, first, np.cross(tangent, first), slope

    def contact(self, t: np.ndarray, polar: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Points at an angle to the tangent, turned round it by v in 0..1."""
        tangent, first, second, _ = self.frame(t)
        around = np.cos(2 * np.pi * v)[:, None] * first + np.sin(2 * np.pi * v)[:, None] * second
        d = np.cos(polar)[:, None] * tangent + np.sin(polar)[:, None] * around
        return self.curve(t) + self.radius(t)[:, None] * d

    def length(self) -> float:
        """Length of the curve."""
        points = self.curve(np.linspace(0, 1, 4001))
        return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())

    def mesh(self, longest: float, rng: np.random.Generator | None = None) -> medialis.Shape:
        """Triangulate it; two spherical caps where it is not closed."""
        widest = float(self.radius(np.linspace(0, 1, 400)).max())
        columns = max(6, int(np.ceil(2 * np.pi * widest / longest)))
        along = max(4, int(np.ceil(self.length() / longest)))
        if self.closed:
            rows = np.arange(along) / along
            free = np.ones(along, bool)
            shape = grid_mesh(self._ring, rows, columns, free=free, poles=False, rng=rng)
            return turned_out(shape)
        ends = np.array([0.0, 1.0])
        edge = np.arccos(-self.frame(ends)[3])
        angles = np.array([np.pi - edge[0], edge[1]])
        cap = np.maximum(2, np.ceil(angles * self.radius(ends) / longest)).astype(int)
        rows = np.concatenate([steps(cap[0]) - 1, steps(along), 1 + steps(cap[1]), [2.0]])
        free = np.ones(len(rows), bool)
        free[[0, -1]] = False
        free[[cap[0], cap[0] + along]] = False

        def surface(u: np.ndarray, v: np.ndarray) -> np.ndarray:
            t = np.clip(u, 0, 1)
            polar = np.arccos(-self.frame(t)[3])
            polar = np.where(u < 0, polar + (np.pi - polar) * -u, polar)
            polar = np.where(u > 1, polar * (2 - u), polar)
            return self.contact(t, polar, v)

        return turned_out(grid_mesh(surface, rows, columns, free=free, poles=True, rng=rng))

    def _ring(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        return self.contact(u, np.arccos(-self.frame(u)[3]), v)

    def truth(self) -> Truth:
        """Return the curve."""
        t = np.linspace(0, 1, 20_001)
        return Truth.of_curve(self.curve(t), self.radius(t))

    def thinnest(self) -> tuple[float, np.ndarray]:
        """Smallest diameter, not at an end, and the circles of its contacts."""
        t = np.linspace(0, 1, 20_001)
        radii = self.radius(t)
        t = t[radii <= radii.min() * (1 + 1e-6)]
        t, v = (grid.ravel() for grid in np.meshgrid(t, np.linspace(0, 1, 721)))
        return 2 * float(radii.min()), self._ring(t, v)


@dataclass(frozen=True)
class Sheet:
    """Balls on a sheet over a disc, or over a strip that closes to a band.

    Attributes
    ----------
    place : function
        From parameters x (k,) and y (k,) to (k, 3): x and y in the unit disc, or x in -1..1 across
        a band and y in 0..1 along it.
    radius : function
        From x and y to (k,).
    band : bool
    twisted : bool
        The band comes back with x turned to -x: the surface has one side.
    """

    place: Function
    radius: Function
    band: bool = False
    twisted: bool = False

    def frame(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, ...]:
        """Center, its two derivatives, normal, and gradient of the radius on the sheet."""
        by, slopes = [], []
        for dx, dy in ((STEP, 0.0), (0.0, STEP)):
            by.append((self.place(x + dx, y + dy) - self.place(x - dx, y - dy)) / (2 * STEP))
            slopes.append((self.radius(x + dx, y + dy) - self.radius(x - dx, y - dy)) / (2 * STEP))
        a, b = by
        aa, ab, bb = ((u * w).sum(axis=1) for u, w in ((a, a), (a, b), (b, b)))
        det = aa * bb - ab**2
        first = (bb * slopes[0] - ab * slopes[1]) / det
        second = (aa * slopes[1] - ab * slopes[0]) / det
        gradient = first[:, None] * a + second[:, None] * b
        return self.place(x, y), a, b, unit(np.cross(a, b)), gradient

    def contact(self, x: np.ndarray, y: np.ndarray, side: np.ndarray) -> np.ndarray:
        """Contact on one side (1 or -1) of the ball at x, y."""
        center, _, _, normal, gradient = self.frame(x, y)
        up = np.sqrt(1 - (gradient**2).sum(axis=1))
        d = -gradient + (side * up)[:, None] * normal
        return center + self.radius(x, y)[:, None] * d

    def rim(self, x: np.ndarray, y: np.ndarray, part: np.ndarray) -> np.ndarray:
        """Contact at the rim, `part` in 0..1 from the upper side to the lower one."""
        center, a, b, normal, gradient = self.frame(x, y)
        if self.band:
            tangent, outer = unit(b), a * np.sign(x)[:, None]
        else:
            tangent, outer = unit(x[:, None] * b - y[:, None] * a), x[:, None] * a + y[:, None] * b
        out = np.cross(tangent, normal)
        out *= np.sign((out * outer).sum(axis=1))[:, None]
        along, across = ((gradient * w).sum(axis=1) for w in (tangent, out))
        rest = np.sqrt(1 - along**2)
        first = np.arcsin(-across / rest)
        turn = first + (np.pi - 2 * first) * part
        d = np.cos(turn)[:, None] * normal + np.sin(turn)[:, None] * out
        d = -along[:, None] * tangent + rest[:, None] * d
        return center + self.radius(x, y)[:, None] * d

    def mesh(self, longest: float, rng: np.random.Generator | None = None) -> medialis.Shape:
        """Triangulate it: the upper side, the rim, the lower side, and the other rim of a band."""
        t = np.linspace(0, 1, 201)
        round_ = (np.ones(201), t) if self.band else (np.cos(2 * np.pi * t), np.sin(2 * np.pi * t))
        rim = self.place(*round_)
        around = max(8, int(np.ceil(np.linalg.norm(np.diff(rim, axis=0), axis=1).sum() / longest)))
        width = max(
            np.linalg.norm(np.diff(self.place(*line), axis=0), axis=1).sum()
            for line in self._lines()
        )
        across = max(2, int(np.ceil(width / longest)))
        cap = max(2, int(np.ceil(np.pi * self.radius(*round_).max() / longest)))
        if self.band:
            rows = np.concatenate(
                [k + np.arange(n) / n for k, n in enumerate((across, cap, across, cap))]
            )
            free = np.abs(rows - np.round(rows)) > 1e-9
            half = (across + cap) if self.twisted else 0
            shape = grid_mesh(self._band, rows, around, free=free, poles=False, twist=half, rng=rng)
        else:
            rows = np.concatenate([steps(across), 1 + steps(cap), 2 + steps(across), [3.0]])
            free = np.abs(rows - np.round(rows)) > 1e-9
            shape = grid_mesh(self._disc, rows, around, free=free, poles=True, rng=rng)
        return turned_out(shape)

    def _lines(self) -> list[tuple[np.ndarray, np.ndarray]]:
        s = np.linspace(0, 1, 101)
        if self.band:
            return [(2 * s - 1, np.full(101, y)) for y in (0.0, 0.25, 0.5, 0.75)]
        return [(s * c, s * d) for c, d in ((1, 0), (0, 1), (-1, 0), (0, -1))]

    def _band(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        u = u % 4
        x = np.where(u < 1, 2 * u - 1, np.where(u < 2, 1.0, np.where(u < 3, 5 - 2 * u, -1.0)))
        flat = self.contact(x, v, np.where(u < 2, 1, -1))
        part = np.where(u < 2, u - 1, 4 - u)
        rim = self.rim(x, v, np.clip(part, 0, 1))
        on_rim = ((u >= 1) & (u < 2)) | (u >= 3)
        return np.where(on_rim[:, None], rim, flat)

    def _disc(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        rho = np.where(u < 1, u, np.where(u < 2, 1.0, 3 - u))
        x, y = rho * np.cos(2 * np.pi * v), rho * np.sin(2 * np.pi * v)
        flat = self.contact(x, y, np.where(u < 1.5, 1, -1))
        edge = (np.cos(2 * np.pi * v), np.sin(2 * np.pi * v))
        rim = self.rim(*edge, np.clip(u - 1, 0, 1))
        on_rim = (u >= 1) & (u < 2)
        return np.where(on_rim[:, None], rim, flat)

    def _grid(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        if self.band:
            x, y = np.meshgrid(np.linspace(-1, 1, count), np.arange(4 * count) / (4 * count))
            return x.ravel(), y.ravel()
        return sunflower(4 * count**2)

    def truth(self) -> Truth:
        """Return the sheet; its rim densely."""
        x, y = self._grid(80)
        center, a, b, normal, _ = self.frame(x, y)
        cell = np.linalg.norm(np.cross(a, b), axis=1) * (2.0 if self.band else np.pi) / len(x)
        rim = np.abs(x) == 1 if self.band else x**2 + y**2 > 1 - 1e-9
        cover = np.where(rim, 0.0, 0.75 * np.sqrt(cell))
        return Truth(center, self.radius(x, y), normal, cover)

    def thinnest(self) -> tuple[float, np.ndarray]:
        """Smallest diameter and its contacts on both sides."""
        x, y = self._grid(400)
        radii = self.radius(x, y)
        rows = np.flatnonzero(radii <= radii.min() * (1 + 1e-9))
        places = [self.contact(x[rows], y[rows], np.full(len(rows), side)) for side in (1, -1)]
        rim = rows[np.abs(x[rows]) == 1] if self.band else rows[:0]
        parts = np.linspace(0, 1, 41)
        places += [self.rim(x[rim], y[rim], np.full(len(rim), part)) for part in parts]
        return 2 * float(radii.min()), np.concatenate(places)
