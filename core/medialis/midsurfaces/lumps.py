"""What of a solid is no wall: lumps, with their share of the volume."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from medialis._kernels.nearest import NearestTree, nearest_on_triangles
from medialis.medial_meshes.solid import Solid
from medialis.model.midsurface import Lump, Midsurface
from medialis.model.shape import Shape
from medialis.model.topology import piece_labels
from medialis.validation import IntArray

PLACES = 12_000
"""Of a grid inside of the solid that tell how much of it is wall: shares are good to 1 %."""

MOST_CELLS = 600_000
"""Of the grid, those outside included: thin shells get fewer places."""

BESIDE = 1.5
"""Half thicknesses: what is nearer to a sheet is wall, also the outer corner of two at right
angles, 1.41 away from their weld."""

LEAST_SHARE = 0.005
"""Of the volume: smaller lumps are fillets and the like, and not named."""


def find_lumps(shape: Shape, sheets: Midsurface) -> tuple[tuple[Lump, ...], float]:
    """Return the lumps of a solid, the largest first, and the share of the volume that is wall.

    Parameters
    ----------
    shape : Shape
        A closed mesh.
    sheets : Midsurface
        Of at least one sheet.
    """
    low, high = shape.bounds
    size = shape.diagonal
    solid = Solid((shape.points - low) / size, np.asarray(shape.faces))
    volume = abs(float(np.einsum("ia,ia->", shape.points[np.asarray(shape.faces)[:, 0]] - low,
                                 shape.face_vectors)) / 6) / size**3  # fmt: skip
    span = (high - low) / size
    cell = (max(volume / PLACES, float(np.prod(span)) / MOST_CELLS)) ** (1 / 3)
    count = np.maximum(1, np.ceil(span / cell).astype(np.int64))
    steps = [(np.arange(n) + 0.5) / n * s for n, s in zip(count, span, strict=True)]
    grid = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 3)
    inside = np.flatnonzero(solid.contains(grid))
    if len(inside) == 0:
        return (), 1.0
    places = grid[inside] * size + low
    tree = NearestTree.of_triangles(sheets.points, np.asarray(sheets.faces))
    distance, row = tree.distances(places)
    corners = np.asarray(sheets.faces)[row]
    weights = nearest_on_triangles(places, sheets.points[corners])
    half = np.einsum("qj,qj->q", weights, sheets.thickness[corners]) / 2
    outside = np.flatnonzero(distance > BESIDE * half)
    label = _pieces(inside[outside], count)
    found = []
    for number in np.unique(label):
        mine = places[outside[label == number]]
        share = len(mine) / len(inside)
        if share >= LEAST_SHARE:
            x, y, z = mine[np.linalg.norm(mine - mine.mean(axis=0), axis=1).argmin()].tolist()
            found.append(Lump(share, (x, y, z)))
    found.sort(key=lambda lump: (-lump.share, lump.position))
    return tuple(found), 1.0 - len(outside) / len(inside)


def _pieces(cells: NDArray[np.int64], count: NDArray[np.int64]) -> IntArray:
    """Give a number to each piece of cells of a grid that hang together through their sides."""
    row = np.full(int(np.prod(count)), -1)
    row[cells] = np.arange(len(cells))
    place = np.stack(np.unravel_index(cells, tuple(count)), axis=1)
    links = []
    for axis in range(3):
        step = np.zeros(3, np.int64)
        step[axis] = 1
        fits = place[:, axis] + 1 < count[axis]
        there = row[np.ravel_multi_index(tuple((place[fits] + step).T), tuple(count))]
        links.append(np.stack([np.flatnonzero(fits), there], axis=1)[there >= 0])
    return np.asarray(piece_labels(len(cells), np.concatenate(links)))
