"""SkeletonMesh: triangles between skeleton points (thesis 3.4.1)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from medialis.errors import InvalidShapeError
from medialis.validation import FloatArray, IntArray, as_faces, frozen


@dataclass(frozen=True, eq=False)
class SkeletonMesh:
    """A surface skeleton as triangles: open sheets that meet along curves, not a manifold.

    Attributes
    ----------
    points : (p, 3) float64
        Skeleton points, each used by a triangle; none when the skeleton has no sheet.
    faces : (t, 3) int32
        Triangles; no two have the same three corners. Their orientation has no meaning.
    rows : (p,) int32
        Row of the medial cloud that each point is: ``cloud.radii[mesh.rows]`` and likewise for any
        (k,) attribute.
    face_origin : (t,) int32
        Face of the shape from which each triangle was lifted.

    Raises
    ------
    InvalidShapeError
        When the arrays do not fit together.
    """

    points: FloatArray
    faces: IntArray
    rows: IntArray
    face_origin: IntArray

    def __post_init__(self) -> None:
        p, t = len(self.points), len(self.faces)
        for name, dtype, shape in (
            ("points", np.float64, (p, 3)),
            ("faces", np.int32, (t, 3)),
            ("rows", np.int32, (p,)),
            ("face_origin", np.int32, (t,)),
        ):
            value = np.asarray(getattr(self, name))
            if value.shape != shape:
                raise InvalidShapeError(f"{name} must have shape {shape}, got {value.shape}.")
            object.__setattr__(self, name, frozen(value, dtype))
        as_faces(self.faces, p)

    @cached_property
    def face_areas(self) -> FloatArray:
        """Area of each triangle, (t,)."""
        a, b, c = (self.points[self.faces[:, j]] for j in range(3))
        return frozen(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2, np.float64)

    @property
    def area(self) -> float:
        """Area of all triangles; each sheet counts once."""
        return float(self.face_areas.sum())

    @cached_property
    def pieces(self) -> IntArray:
        """Connected piece of each point, (p,), numbered by their lowest point."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        p = len(self.points)
        if p == 0:
            return frozen(np.empty(0), np.int32)
        a, b = self.faces[:, [0, 1, 1, 2]].reshape(-1, 2).T
        graph = coo_array((np.ones(len(a), np.int8), (a, b)), shape=(p, p))
        return frozen(connected_components(graph, directed=False)[1], np.int32)

    @property
    def piece_count(self) -> int:
        """Number of connected pieces."""
        return int(self.pieces.max(initial=-1)) + 1
