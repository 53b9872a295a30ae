"""Solids whose medial axis follows from that of a plane section: extruded and revolved polygons."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

import medialis
from accuracy_suite.known import Truth, grid_mesh, mesh_of

PLACES = 40_000
"""About so many places on the sheets of a truth."""

FAN = 200
"""Directions between the two normals at a concave corner."""


@dataclass(frozen=True)
class Section:
    """A plane region with straight sides.

    Attributes
    ----------
    sides : (s, 2, 2) float64
        Start and end of each side, the region on its left.
    """

    sides: np.ndarray

    @classmethod
    def of_loops(cls, *loops: np.ndarray) -> Section:
        """Return the region inside the first loop (counter-clockwise) and outside the others."""
        closed = [np.asarray(loop, float) for loop in loops]
        return cls(np.concatenate([np.stack([a, np.roll(a, -1, axis=0)], axis=1) for a in closed]))

    @cached_property
    def inward(self) -> np.ndarray:
        """Unit normals of the sides, (s, 2)."""
        along = self.sides[:, 1] - self.sides[:, 0]
        along = along / np.linalg.norm(along, axis=1, keepdims=True)
        return np.stack([-along[:, 1], along[:, 0]], axis=1)

    def distances(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distance of points to the sides, (q,), and the nearest place on them, (q, 2)."""
        least, place = np.full(len(points), np.inf), np.zeros((len(points), 2))
        for a, b in self.sides:
            along = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
            foot = a + along[:, None] * (b - a)
            away = np.linalg.norm(points - foot, axis=1)
            nearer = away < least
            least[nearer], place[nearer] = away[nearer], foot[nearer]
        return least, place

    def inside(self, points: np.ndarray) -> np.ndarray:
        """Tell the points in the region, by the even-odd rule."""
        result = np.zeros(len(points), bool)
        for (ax, ay), (bx, by) in self.sides:
            if ay == by:
                continue
            spans = (ay > points[:, 1]) != (by > points[:, 1])
            result ^= spans & (points[:, 0] < ax + (points[:, 1] - ay) / (by - ay) * (bx - ax))
        return result

    def corners(self) -> list[tuple[int, int, float]]:
        """Sides before and after each corner, and the angle inside the region, radians."""
        found = []
        for before, (_, end) in enumerate(self.sides):
            gap = np.abs(self.sides[:, 0] - end).max(axis=1)
            after = int(gap.argmin())
            one = self.sides[before, 1] - self.sides[before, 0]
            two = self.sides[after, 1] - self.sides[after, 0]
            turn = np.arctan2(one[0] * two[1] - one[1] * two[0], one @ two)
            if abs(turn) > 1e-9:
                found.append((before, after, np.pi - turn))
        return found

    def axis(self, step: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return places of the medial axis: centers (m, 2), radii, and normals of its curves.

        From places on the sides, `step` apart, and from directions at concave corners: the largest
        disc that touches there and meets no other side, in closed form. A disc that touches p with
        center p + t n touches a line through q with the inward normal m for t = (p - q).m /
        (1 - n.m), and a point e for t = |e - p|^2 / (2 (e - p).n).
        """
        starts, normals = [], []
        for (a, b), n in zip(self.sides, self.inward, strict=True):
            count = max(2, int(np.ceil(np.linalg.norm(b - a) / step)))
            along = (np.arange(count) + 0.5)[:, None] / count
            starts.append(a + along * (b - a))
            normals.append(np.repeat(n[None], count, axis=0))
        for before, after, inner in self.corners():
            if inner <= np.pi:
                continue
            first = self.inward[before]
            turn = np.linspace(0, np.pi - inner, FAN)
            fan = [np.cos(turn) * first[0] - np.sin(turn) * first[1]]
            fan += [np.sin(turn) * first[0] + np.cos(turn) * first[1]]
            starts.append(np.repeat(self.sides[after, :1], FAN, axis=0))
            normals.append(np.stack(fan, axis=1))
        p, n = np.concatenate(starts), np.concatenate(normals)
        radii, contact = self._largest(p, n)
        across = p - contact
        length = np.linalg.norm(across, axis=1, keepdims=True)
        return p + radii[:, None] * n, radii, across / np.maximum(length, 1e-300)

    def _largest(self, p: np.ndarray, n: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        radii, contact = np.full(len(p), np.inf), np.zeros((len(p), 2))
        with np.errstate(divide="ignore", invalid="ignore"):
            for (a, b), m in zip(self.sides, self.inward, strict=True):
                height = (p - a) @ m
                t = height / (1 - n @ m)
                foot = p + t[:, None] * (n - m)
                along = (foot - a) @ (b - a) / ((b - a) @ (b - a))
                good = (height > 1e-12) & (t < radii) & (along >= 0) & (along <= 1)
                radii[good], contact[good] = t[good], foot[good]
                e = b - p  # the start of a side is the end of another one
                t = (e**2).sum(axis=1) / (2 * (e * n).sum(axis=1))
                good = ((e * n).sum(axis=1) > 1e-12) & (t < radii)
                radii[good], contact[good] = t[good], b
        return radii, contact

    def area(self) -> float:
        """Area of the region."""
        a, b = self.sides[:, 0], self.sides[:, 1]
        return float((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum() / 2)

    def girth(self) -> float:
        """Length of all sides."""
        return float(np.linalg.norm(self.sides[:, 1] - self.sides[:, 0], axis=1).sum())


def extruded_truth(section: Section, height: float) -> Truth:
    """Return the medial axis of a right prism, z from -height / 2 to height / 2.

    With the distance d to the sides and h = height / 2, the distance to the surface is
    min(d, h - |z|): the axis is the plane z = 0 where d >= h, the graphs |z| = h - d where d < h,
    and walls |z| <= h - d over the axis of the section.
    """
    h = height / 2
    low, high = section.sides.min(axis=(0, 1)), section.sides.max(axis=(0, 1))
    step = float(np.sqrt((2 * section.area() + section.girth() * h) / PLACES))
    ticks = [np.arange(low[k] + step / 2, high[k], step) for k in (0, 1)]
    grid = np.stack(np.meshgrid(*ticks), axis=2)
    flat = grid.reshape(-1, 2)
    flat = flat[section.inside(flat)]
    d, foot = section.distances(flat)
    up = (flat - foot) / np.maximum(d, 1e-300)[:, None]
    parts = []
    for sign in (1, -1):
        low_rows = d < h
        z = sign * (h - d[low_rows])
        normals = np.column_stack([sign * up[low_rows], np.ones(low_rows.sum())]) / np.sqrt(2)
        parts.append(_sheet(flat[low_rows], z, d[low_rows], normals, step))
    middle = flat[d >= h]
    ones = np.ones(len(middle))
    parts.append(_sheet(middle, 0 * ones, h * ones, ones[:, None] * [0, 0, 1.0], step))
    centers, radii, across = section.axis(step / 2)
    keep = radii < h
    centers, radii, across = centers[keep], radii[keep], across[keep]
    count = 1 + np.ceil(2 * (h - radii) / step).astype(int)
    row = np.repeat(np.arange(len(radii)), count)
    part = (np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)) / np.maximum(
        count - 1, 1
    )[row]
    z = (h - radii)[row] * (2 * part - 1)
    normals = np.column_stack([across[row], 0 * z])
    parts.append(_sheet(centers[row], z, radii[row], normals, step))
    return Truth.joined(parts)


def _sheet(
    flat: np.ndarray, z: np.ndarray, radii: np.ndarray, normals: np.ndarray, step: float
) -> Truth:
    return Truth(np.column_stack([flat, z]), radii, normals, np.full(len(z), 0.75 * step))


def revolved_truth(section: Section) -> Truth:
    """Return the medial axis of a solid of revolution round z.

    The nearest place of the surface lies in the same half-plane, so the axis of the solid is that
    of the whole section, turned. `section` is its half with x >= 0, without sides on the z-axis.
    """
    sides = section.sides[~(np.abs(section.sides[:, :, 0]).max(axis=1) < 1e-12)]
    mirrored = sides[:, ::-1] * [-1, 1]
    whole = Section(np.concatenate([sides, mirrored]))
    step = float(np.sqrt(np.pi * sides[:, :, 0].max() * section.girth() / PLACES))
    centers, radii, across = whole.axis(step / 2)
    right = (centers[:, 0] > -1e-9) & np.isfinite(radii)
    on_axis = right & (centers[:, 0] < 1e-6)
    dense, sizes, _ = whole.axis(step / 20)
    thin = (np.abs(dense[:, 0]) < 1e-6) & np.isfinite(sizes)
    line = np.column_stack([0 * dense[thin], dense[thin, 1]])
    right &= ~on_axis
    centers, radii, across = centers[right], radii[right], across[right]
    count = np.maximum(8, np.ceil(2 * np.pi * centers[:, 0] / step)).astype(int)
    row = np.repeat(np.arange(len(radii)), count)
    turn = 2 * np.pi * (np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count))
    turn = turn / count[row]
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    points = np.column_stack([centers[row, :1] * ring, centers[row, 1]])
    normals = np.column_stack([across[row, :1] * ring, across[row, 1]])
    sheet = Truth(points, radii[row], normals, np.full(len(row), 0.75 * step))
    return Truth.joined([sheet, Truth.of_curve(line, sizes[thin])]) if thin.any() else sheet


def lathe(
    profile: np.ndarray,
    longest: float,
    rng: np.random.Generator | None,
    closed: bool,
    columns: int | None = None,
) -> medialis.Shape:
    """Mesh a solid of revolution round z.

    `profile` (p, 2) of (distance from the axis, z) runs counter-clockwise round the half section;
    from the axis to the axis, or closed. `columns`: sides of the polygon in place of a circle.
    """
    ends = np.concatenate([profile, profile[:1]]) if closed else profile
    lengths = np.linalg.norm(np.diff(ends, axis=0), axis=1)
    count = np.maximum(1, np.ceil(lengths / longest)).astype(int)
    rows = np.concatenate([i + np.arange(c) / c for i, c in enumerate(count)])
    rows = rows if closed else np.append(rows, len(lengths))
    columns = columns or max(8, int(np.ceil(2 * np.pi * ends[:, 0].max() / longest)))

    def surface(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        u = u % len(lengths) if closed else u
        knots = np.arange(len(ends))
        rho, z = np.interp(u, knots, ends[:, 0]), np.interp(u, knots, ends[:, 1])
        return np.stack([rho * np.cos(2 * np.pi * v), rho * np.sin(2 * np.pi * v), z], axis=1)

    free = np.abs(rows - np.round(rows)) > 1e-9
    return turned_out(grid_mesh(surface, rows, columns, free=free, poles=not closed, rng=rng))


def turned_out(shape: medialis.Shape) -> medialis.Shape:
    """Return a closed mesh with its faces turned so that its volume is positive."""
    a, b, c = shape.points[shape.faces.T]
    inside_out = (np.cross(a, b) * c).sum() < 0
    return mesh_of(shape.points, shape.faces[:, ::-1]) if inside_out else shape
