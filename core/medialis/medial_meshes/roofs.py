"""The exact medial axis of a convex polyhedron: sheets, seams and junctions by its planes alone.

Inside a convex solid the distance to the surface is the least of those to the planes of its
faces. Over the solid, {(x, r): 0 <= r <= distance of x to each plane} is a polytope in four
dimensions, and the medial axis is its roof: 2-faces are the sheets, where two planes are equally
near, edges the seams and the creases, where sheets end, vertices with r > 0 the junctions, and
those with r = 0 the corners. Centers and radii are linear on each, so balls at the vertices are the
polyhedron exactly.

1. `planes_of`: the planes of a mesh of flat faces, each cut into however many triangles.
2. `roof_of`: the roof, with places that come out more than once as one.
3. `Roof.mesh`: any number of balls on it, at the vertices first, then evenly spread.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from medialis.base.arrays import Index, Mask, kd_tree
from medialis.base.validation import FloatArray
from medialis.medial_meshes.fine_complex import FineComplex
from medialis.medial_meshes.mesh import Complex, betti_numbers
from medialis.medial_meshes.patches import Patch, Spread, most_within
from medialis.medial_meshes.sampling import Samples, Solid
from medialis.shape.surface import piece_labels

FLAT = 2e-6
"""Diagonals: points of one plane are no farther from it; files of 32-bit numbers round by 1e-7."""

ROUNDED, TURN = 3e-7, 0.02
"""Diagonals: corners as far from a plane may be rounded; of triangles that are low they are nearer
than this share of the height: else all triangles at a short edge are in one plane."""

SAME = 1e-5
"""Diagonals: vertices of the roof that are no farther apart are one, and on the planes so near."""

MOST_PLANES = 200
"""A mesh of more flat faces is no polyhedron with a structure that anybody would want."""


def planes_of(solid: Solid) -> FloatArray | None:
    """Return the planes (k, 4) of a mesh: inward unit normals n and offsets b, n.x + b >= 0 inside.

    None where there are many, or where a face is not flat after all.
    """
    found = facets_of(solid)
    return None if found is None else found[0]


def facets_of(solid: Solid) -> tuple[FloatArray, Index] | None:
    """Return the planes of a mesh, and the plane of each of its triangles, -1 without area.

    Triangles side by side belong to one plane where the far corner of the smaller one lies in the
    plane of the larger one.
    """
    surface = solid.surface
    points, faces, areas = solid.points, solid.faces, surface.face_areas
    first, second, _ = surface.edge_table.pairs
    a, b = first // 3, second // 3
    swap = areas[a] < areas[b]
    large, small = np.where(swap, b, a), np.where(swap, a, b)
    half = np.where(swap, first, second)
    far = points[faces[half // 3, (half + 2) % 3]] - points[faces[large, 0]]
    off = np.abs(np.einsum("ij,ij->i", far, surface.face_normals[large]))
    side = points[faces[half // 3, (half + 1) % 3]] - points[faces[half // 3, half % 3]]
    high = 2.0 * areas[small] / np.maximum(np.linalg.norm(side, axis=1), 1e-300)
    flat = (off < np.clip(TURN * high, ROUNDED, FLAT)) | (areas[small] == 0.0)
    label = piece_labels(len(faces), np.stack([a[flat], b[flat]], axis=1))
    count = int(label.max()) + 1
    if count > MOST_PLANES:
        return None
    planes: list[list[float]] = []
    number = np.full(count, -1)
    for k in range(count):
        rows = np.flatnonzero(label == k)
        corners = points[np.unique(faces[rows])]
        normal = -surface.face_vectors[rows].sum(axis=0)
        length = float(np.linalg.norm(normal))
        if length == 0.0:
            continue
        normal /= length
        if len(corners) > 3:  # the plane of least squares
            _, _, axes = np.linalg.svd(corners - corners.mean(axis=0), full_matrices=False)
            normal = axes[2] if axes[2] @ normal > 0 else -axes[2]
        offset = -float(normal @ corners.mean(axis=0))
        if np.abs(corners @ normal + offset).max() > 2 * FLAT:
            return None
        number[k] = len(planes)
        planes.append([*normal, offset])
    return np.array(planes).reshape(-1, 4), number[label]


@dataclass(frozen=True, eq=False)
class Roof:
    """The structure over a convex polyhedron.

    Attributes
    ----------
    planes : (k, 4) float64
    balls : (v, 4) float64
        At its junctions and corners.
    sheets : list of (c,) int64
        The vertices round each sheet, in order.
    """

    planes: FloatArray
    balls: FloatArray
    sheets: list[Index]

    def __len__(self) -> int:
        return len(self.balls)

    @cached_property
    def _patches(self) -> list[Patch]:
        return [Patch.of(self.balls[:, :3], ring) for ring in self.sheets]

    def mesh(self, count: int) -> Complex:
        """Return it as `count` balls, no fewer than it has vertices."""
        spread = most_within(self.balls, self._patches, count)
        return Spread(self.balls, self._patches, spread).complex(count)

    def touched(self, balls: FloatArray) -> Mask:
        """Tell which planes balls (q, 4) touch, (q, k)."""
        heights = balls[:, :3] @ self.planes[:, :3].T + self.planes[:, 3]
        return np.asarray(np.abs(heights - balls[:, 3:]) < SAME)

    def balls_of(self, samples: Samples) -> FloatArray:
        """Return the ball that touches the polyhedron at each sample, (c, 4)."""
        normals, offsets = self.planes[:, :3], self.planes[:, 3]
        heights = np.maximum(samples.points @ normals.T + offsets, 0.0)
        own = heights.argmin(axis=1)
        slower = 1.0 - normals @ normals.T  # a center moves away from its own plane as fast as r
        with np.errstate(divide="ignore", invalid="ignore"):
            radii = np.where(slower[own] > 1e-9, heights / slower[own], np.inf)
        radius = radii.min(axis=1)
        centers = samples.points + radius[:, None] * normals[own]
        return np.column_stack([centers, radius])


def roof_of(solid: Solid) -> Roof | None:
    """Return the roof of a convex polyhedron; None for all other shapes."""
    if not solid.whole:
        return None
    planes = planes_of(solid)
    if planes is None or len(planes) < 4:
        return None
    if (solid.points @ planes[:, :3].T + planes[:, 3]).min() < -2 * FLAT:
        return None
    balls = _vertices(planes, solid.points.mean(axis=0))
    if balls is None:
        return None
    found = Roof(planes, balls, [])
    found = replace(found, sheets=_sheets(balls, found.touched(balls)))
    least = found.mesh(len(found))
    whole = betti_numbers(len(least), least.edges, least.faces) == (1, 0, 0)
    return found if whole and len(least) == len(found) else None


def complex_of(roof: Roof, samples: Samples, count: int) -> FineComplex:
    """Return the roof as a fine complex of about `count` balls."""
    mesh = roof.mesh(max(count, len(roof)))
    pole = kd_tree(mesh.balls).query(roof.balls_of(samples))[1]
    return FineComplex(mesh.balls, mesh.edges, mesh.faces, samples, pole, (1, 0, 0))


def _vertices(planes: FloatArray, middle: FloatArray) -> FloatArray | None:
    """Return the vertices (v, 4) of the roof and its base, each once; `middle` is inside."""
    from scipy.spatial import HalfspaceIntersection, QhullError

    ones = np.ones(len(planes))
    within = np.column_stack([-planes[:, :3], ones])
    depth = float((planes[:, :3] @ middle + planes[:, 3]).min())
    if depth < SAME:
        return None
    inner = np.append(middle, 0.5 * depth)
    limits = np.vstack([np.column_stack([within, -planes[:, 3]]), [0.0, 0.0, 0.0, -1.0, 0.0]])
    try:
        places = HalfspaceIntersection(limits, inner).intersections
    except QhullError:
        return None
    places = places[np.isfinite(places).all(axis=1)]
    links = kd_tree(places).query_pairs(SAME, output_type="ndarray")
    label = piece_labels(len(places), links)
    first = np.unique(label, return_index=True)[1]
    balls = np.array(places[first])
    balls[balls[:, 3] < SAME, 3] = 0.0
    return balls


def _sheets(balls: FloatArray, active: Mask) -> list[Index]:
    """Return the vertices round each sheet: those where two planes are both nearest, (v, k)."""
    both = active.astype(np.int64).T @ active.astype(np.int64)
    sheets = []
    for i, j in np.argwhere(np.triu(both, 1) >= 3):
        rows = np.flatnonzero(active[:, i] & active[:, j])
        centers = balls[rows, :3] - balls[rows, :3].mean(axis=0)
        _, sizes, axes = np.linalg.svd(centers, full_matrices=False)
        if sizes[1] > 2 * SAME:
            turn = np.arctan2(centers @ axes[1], centers @ axes[0])
            sheets.append(rows[np.argsort(turn, kind="stable")])
    return sheets
