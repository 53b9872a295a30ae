"""Which of the faces that have an opposite lie in a wall: an extended one of even thickness."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.model.medial_cloud import MedialCloud
from medialis.model.shape import Shape
from medialis.validation import FloatArray

EXTENT = 2.0
"""Half thicknesses: widths by which what has an opposite is spread to tell whether it is a wall."""

WIDER = 2.0
"""Times that width: over which linear functions are fitted, so that the wall outweighs blends."""

SLOW = 0.05
"""Share of the half thickness by which this may differ from a linear function of the place, near
the end of a wall: it does where this goes over into a blend."""

INSIDE = 0.7
"""Of what is left when all is spread: half a thickness from the end of a wall, and more within."""

BESIDE = 0.1
"""Of what is left when walls are spread: 0.5 at their end, if it is long, 0.18 a width from it."""

CELL = 1 / 3
"""Half thicknesses: samples within a cube of this are one unknown, which is all this needs."""

MOST_CELLS = 20_000
"""Of the surface, or a few times as many; equations for more take long."""


def faces_in_walls(cloud: MedialCloud, core: NDArray[np.bool_], width: float) -> NDArray[np.bool_]:
    """Tell which faces that have an opposite lie in a wall, (m,).

    What has an opposite is spread over the surface, by its thickness. In the middle of a strip
    that is narrower than 1.4 thicknesses less than half is left, in that of a disc below 2.5.
    Where half is left on both sides there is a wall, and so is what lies beside it; but not what
    changes its thickness at the end of a wall, where this goes over into a blend.
    """
    shape, n = cloud.surface, cloud.surface.point_count
    faces, half = np.asarray(shape.faces), np.nan_to_num(cloud.radii[:n])
    heat = _Diffusion(shape, half, CELL * width)
    third = np.repeat(shape.face_areas[core] / 3, 3)
    given = np.bincount(faces[core].ravel(), third, n) / np.maximum(shape.point_areas, 1e-300)
    share = heat.spread(given[:, None], EXTENT)[:, 0]
    # Moments of place and half thickness, over what has an opposite: linear functions of the place.
    place, value = (shape.points - shape.bounds[0]) / shape.diagonal, half / shape.diagonal
    x, y, z = place.T
    terms = np.stack([np.ones(n), x, y, z, value, x * x, y * y, z * z, x * y, x * z, y * z,
                      x * value, y * value, z * value], axis=1)  # fmt: skip
    moments = heat.spread(given[:, None] * terms, WIDER * EXTENT)
    smooth = shape.diagonal * _linear(moments / np.maximum(moments[:, :1], 1e-9), place)
    slow = (np.abs(smooth - half) < SLOW * half) | (share > INSIDE)
    touched = cloud.contact_faces[:n]
    there = np.where(touched >= 0, share[faces[touched]].mean(axis=1), share[cloud.features[:n, 1]])
    wall = (given > 0) & (np.minimum(share, there) > 0.5)
    left = heat.spread(wall[:, None].astype(np.float64), EXTENT)[:, 0]
    return np.asarray(core & (slow & (left > BESIDE))[faces].all(axis=1))


class _Diffusion:
    """Equations on cells of samples that lie near each other and face the same way."""

    def __init__(self, shape: Shape, half: FloatArray, cell: float) -> None:
        from scipy.sparse import triu

        cell = max(cell, (shape.area / MOST_CELLS) ** 0.5)
        place = np.floor((shape.points - shape.bounds[0]) / cell).astype(np.int64)
        across = np.abs(shape.normals).argmax(axis=1)
        facing = np.take_along_axis(shape.normals, across[:, None], axis=1)[:, 0] > 0
        size = place.max(axis=0) + 1
        key = 6 * np.ravel_multi_index(tuple(place.T), tuple(size)) + 2 * across + facing
        self.cell = np.unique(key, return_inverse=True)[1]
        self.mass = np.maximum(shape.point_areas, 1e-12 * shape.area / shape.point_count)
        self.area = np.bincount(self.cell, self.mass)
        middle = np.stack(
            [np.bincount(self.cell, self.mass * x) / self.area for x in shape.points.T], axis=1
        )
        links = triu(shape.cotangent_weights, 1).tocoo()
        ends = self.cell[links.row], self.cell[links.col]
        step = np.linalg.norm(shape.points[links.row] - shape.points[links.col], axis=1)
        apart = np.maximum(np.linalg.norm(middle[ends[0]] - middle[ends[1]], axis=1), 1e-3 * cell)
        narrow = np.minimum(half[links.row], half[links.col])  # none at creases: they part
        parted = ends[0] != ends[1]
        self.ends = ends[0][parted], ends[1][parted]
        self.flow = (narrow**2 * np.maximum(links.data, 0.0) * step / apart)[parted]
        self.factors: dict[float, Any] = {}

    def spread(self, values: FloatArray, width: float) -> FloatArray:
        """Return values (n, k) spread by a width in half thicknesses, those of the cells."""
        if width not in self.factors:
            self.factors[width] = self._factors(width)
        held = np.stack([np.bincount(self.cell, self.mass * v) for v in values.T], axis=1)
        return np.asarray(self.factors[width].solve(held)[self.cell])

    def _factors(self, width: float) -> Any:
        from scipy.sparse import coo_array, diags_array
        from scipy.sparse.linalg import splu

        count, (one, two), flow = len(self.area), self.ends, width**2 * self.flow
        between = coo_array((flow, (one, two)), shape=(count, count)).tocsr()
        between = between + between.T
        matrix: Any = diags_array(self.area + between.sum(axis=1)) - between
        return splu(matrix.tocsc())


def _linear(moments: FloatArray, places: FloatArray) -> FloatArray:
    """Return the values at places of linear functions, fitted by the moments beside each.

    Columns: 1, x, y, z, v, xx, yy, zz, xy, xz, yz, xv, yv, zv.
    """
    mean, value = moments[:, 1:4], moments[:, 4]
    square = moments[:, [5, 8, 9, 8, 6, 10, 9, 10, 7]].reshape(-1, 3, 3)
    square = square - mean[:, :, None] * mean[:, None, :]
    size = np.trace(square, axis1=1, axis2=2)[:, None, None] + 1e-300
    right = moments[:, 11:14] - mean * value[:, None]
    slope = np.linalg.solve(square + 1e-6 * size * np.eye(3), right[:, :, None])[:, :, 0]
    return np.asarray(value + np.einsum("na,na->n", slope, places - mean))
