"""Flat right prisms: their sheets, areas and the length of the Y-curves in closed form."""

from __future__ import annotations

from functools import partial

import numpy as np

import medialis
from accuracy_suite.cells import divided
from accuracy_suite.known import KnownShape, made, mesh_of
from accuracy_suite.sections import Section, extruded_truth


def flat_prism(name: str, outline: object, height: float) -> KnownShape:
    """Return a prism that is no higher than its outline is wide anywhere.

    With h = height / 2 the section where the distance to the sides is h or more is one piece, and
    nothing but the walls behind its convex corners ends above it. Let b be the angle inside the
    region at a corner. A strip of width h along the sides has the area

        h P - h^2 sum cot(b/2) [convex] + h^2 sum (b - pi) / 2 [concave]

    and the piece within it the girth P - 2 h sum cot(b/2) + h sum (b - pi). The sheets are: that
    piece, in the middle; above and below, at 45 degrees, one over the strip of each side, where
    those of sides that meet at a concave corner are one; and upright behind each convex corner a
    triangle of the base 2 h and the depth h / sin(b/2). Three meet along the girth and along the
    two slopes of each triangle, sqrt(h^2 + (h / sin(b/2))^2) long.
    """
    section = Section.of_loops(np.asarray(outline, float))
    h = height / 2
    lengths = np.linalg.norm(section.sides[:, 1] - section.sides[:, 0], axis=1)
    strips, joined = h * lengths, np.arange(len(lengths))
    upright, girth, slopes = [], lengths.sum(), 0.0
    for before, after, inner in section.corners():
        if inner < np.pi:
            cut = 1 / np.tan(inner / 2)
            strips[[before, after]] -= h**2 * cut / 2
            girth -= 2 * h * cut
            depth = h / np.sin(inner / 2)
            upright.append(h * depth)
            slopes += 2 * np.hypot(h, depth)
        else:
            strips[before] += h**2 * (inner - np.pi) / 2
            girth += h * (inner - np.pi)
            joined[joined == joined[after]] = joined[before]
    above = np.sqrt(2) * np.bincount(joined, strips)[np.unique(joined)]
    middle = section.area() - strips.sum()
    flat = [middle] if middle > 1e-12 else []  # of a cube nothing is left
    areas = np.sort(np.concatenate([flat, upright, above, above]))
    corners = np.asarray(outline, float)
    return KnownShape(
        name, "closed form", lambda h, rng: made(partial(_solid, corners, height), h, rng),
        lambda: extruded_truth(section, height), height, coarse=True,
        sheets=len(areas), areas=areas, y_length=float(max(girth, 0.0) + slopes),
    )  # fmt: skip


def _solid(outline: np.ndarray, height: float, longest: float) -> medialis.Shape:
    """Mesh the prism: its ends cut by ears, each ear into k^2 triangles, its walls into k strips.

    k is the least for which no edge of an end is longer than `longest`; 1 where that is inf.
    """
    ears = outline[_ears(outline)]
    sides = np.linalg.norm(ears - np.roll(ears, 1, axis=1), axis=2)
    k = max(1, int(np.ceil(sides.max() / longest - 1e-9)))
    i, j = (grid.ravel() for grid in np.meshgrid(np.arange(k + 1), np.arange(k + 1)))
    i, j = i[i + j <= k], j[i + j <= k]
    number = np.full((k + 2, k + 2), -1)
    number[i, j] = np.arange(len(i))
    up = np.stack([number[i, j], number[i + 1, j], number[i, j + 1]], axis=1)
    down = np.stack([number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]], axis=1)
    pattern = np.concatenate([up, down])
    pattern = pattern[(pattern >= 0).all(axis=1)]
    weights = np.stack([k - i - j, i, j], axis=1) / k
    flat = np.einsum("ij,ejk->eik", weights, ears).reshape(-1, 2)
    end = (pattern + len(i) * np.arange(len(ears))[:, None, None]).reshape(-1, 3)
    low, high = (np.column_stack([flat, np.full(len(flat), z)]) for z in (-height / 2, height / 2))
    levels = divided(np.array([-height / 2, height / 2]), longest)
    corners = [low[end[:, ::-1]], high[end]]
    for a, b in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        steps = a + np.linspace(0, 1, k + 1)[:, None] * (b - a)
        wall = np.stack([np.column_stack([steps, np.full(k + 1, z)]) for z in levels])
        a0, b0, b1, a1 = wall[:-1, :-1], wall[:-1, 1:], wall[1:, 1:], wall[1:, :-1]
        pairs = ((a0, b0, b1), (a0, b1, a1))
        corners += [np.stack(triangle, axis=2).reshape(-1, 3, 3) for triangle in pairs]
    return _welded(np.concatenate(corners), 1e-9 * height)


def _welded(corners: np.ndarray, apart: float) -> medialis.Shape:
    """Join the corners of triangles (m, 3, 3) that lie at one place."""
    rows = corners.reshape(-1, 3)
    cells = np.round(rows / apart)
    _, first, faces = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    return mesh_of(rows[first], faces.reshape(-1, 3))


def _ears(outline: np.ndarray) -> np.ndarray:
    """Cut a polygon into triangles whose corners are its own, (n - 2, 3)."""
    ring, triangles = list(range(len(outline))), []
    while len(ring) > 3:
        k = next(k for k in range(len(ring)) if _is_ear(outline, ring, k))
        triangles.append([ring[k - 1], ring[k], ring[(k + 1) % len(ring)]])
        ring.pop(k)
    return np.array([*triangles, ring])


def _is_ear(outline: np.ndarray, ring: list[int], k: int) -> bool:
    """Tell whether a corner can be cut off: convex, with no other corner in its triangle."""
    a, b, c = (outline[ring[i % len(ring)]] for i in (k - 1, k, k + 1))

    def left(p: np.ndarray, q: np.ndarray, x: np.ndarray) -> float:
        return float((q[0] - p[0]) * (x[1] - p[1]) - (q[1] - p[1]) * (x[0] - p[0]))

    if left(a, b, c) <= 1e-12:
        return False
    others = [
        outline[i] for i in ring if i not in (ring[k - 1], ring[k], ring[(k + 1) % len(ring)])
    ]
    return not any(min(left(a, b, x), left(b, c, x), left(c, a, x)) >= -1e-12 for x in others)
