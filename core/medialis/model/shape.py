"""Shape: surface samples with outward normals and, for meshes, triangles."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from medialis.errors import InvalidShapeError
from medialis.validation import FloatArray, IntArray, as_faces, as_normals, as_points, frozen

if TYPE_CHECKING:
    from medialis.model.diagnosis import Diagnosis


def missing_value(values: NDArray[Any]) -> float | int:
    """Return what stands for none among such values: NaN, -1, or 0 where no type has a minus."""
    return {"f": np.nan, "i": -1}.get(np.asarray(values).dtype.kind, 0)


@dataclass(frozen=True, eq=False)
class Shape:
    """A sampled surface: the input of every operation.

    Built directly it checks its arrays and takes them as they are; `medialis.make_shape` estimates
    missing normals and `medialis.read_shape` repairs a file first.

    Attributes
    ----------
    points : (n, 3) float64
        Surface samples in the caller's units.
    normals : (n, 3) float64
        Unit outward normals; a zero row means that the sample has none.
    faces : (m, 3) int32 or None
        Triangles, counter-clockwise seen from outside; None for a point cloud.
    origin : (n,) int32 or None
        After `medialis.refine`: the vertex of the unrefined shape that this point is, -1 for an
        inserted one. None when the shape was not refined.
    face_origin : (m,) int32 or None
        After `medialis.refine`: the face of the unrefined shape that this face lies in.
    diagnosis : Diagnosis or None
        What the input was like before repair (`medialis.read_shape`).
    vertex_map : (n_in,) int32 or None
        After repair: the point that each input vertex became, -1 if it was dropped. It stays right
        after `medialis.refine`, which keeps the points and adds new ones behind them.
    face_map : (m,) int32 or None
        After repair: the input face of each face.

    Raises
    ------
    InvalidShapeError
        When an array has the wrong shape, is not finite, or a face index is out of range.
    """

    points: FloatArray
    normals: FloatArray
    faces: IntArray | None = None
    origin: IntArray | None = None
    face_origin: IntArray | None = None
    diagnosis: Diagnosis | None = None
    vertex_map: IntArray | None = None
    face_map: IntArray | None = None

    def __post_init__(self) -> None:
        points = as_points(self.points)
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "normals", as_normals(self.normals, len(points)))
        if self.faces is not None:
            faces = as_faces(self.faces, len(points))
            object.__setattr__(self, "faces", faces if len(faces) else None)
        for name, count in (
            ("origin", len(points)),
            ("face_origin", self.face_count),
            ("face_map", self.face_count),
            ("vertex_map", 0 if self.vertex_map is None else np.size(self.vertex_map)),
        ):
            value = getattr(self, name)
            if value is not None:
                if np.shape(value) != (count,):
                    raise InvalidShapeError(
                        f"{name} must have shape ({count},), got {np.shape(value)}."
                    )
                object.__setattr__(self, name, frozen(np.asarray(value), np.int32))

    def on_input_points(self, values: NDArray[Any], missing: Any = None) -> NDArray[Any]:
        """Bring values of the points back to the vertices of the input before repair.

        Parameters
        ----------
        values : (n, ...) array
            Of this shape, or of the first n points of a refined one.
        missing : scalar, optional
            For vertices that were dropped; else `missing_value`.

        Returns
        -------
        (n_in, ...) array
            In the same dtype; merged vertices have the same value.
        """
        if self.vertex_map is None:
            return np.array(values)
        missing = missing_value(values) if missing is None else missing
        result = np.full((len(self.vertex_map), *np.shape(values)[1:]), missing, values.dtype)
        kept = self.vertex_map >= 0
        result[kept] = values[self.vertex_map[kept]]
        return result

    def on_input_faces(self, values: NDArray[Any], count: int, missing: Any = None) -> NDArray[Any]:
        """Bring values of the faces back to the `count` faces of the input before repair.

        Parameters
        ----------
        values : (m, ...) array
            One row a face of this shape.
        count : int
            Number of faces of the input.
        missing : scalar, optional
            For faces that were dropped; else `missing_value`.

        Returns
        -------
        (count, ...) array
            In the same dtype. Several faces of one input face: the last one counts.
        """
        if self.face_map is None:
            return np.array(values)
        missing = missing_value(values) if missing is None else missing
        result = np.full((count, *np.shape(values)[1:]), missing, values.dtype)
        result[self.face_map] = values
        return result

    @property
    def point_count(self) -> int:
        """Number of samples n."""
        return len(self.points)

    @property
    def face_count(self) -> int:
        """Number of triangles m (0 for a point cloud)."""
        return 0 if self.faces is None else len(self.faces)

    @cached_property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper corner of the bounding box, two (3,) arrays."""
        low, high = self.points.min(axis=0), self.points.max(axis=0)
        return frozen(low, np.float64), frozen(high, np.float64)

    @cached_property
    def diagonal(self) -> float:
        """Length of the bounding-box diagonal: the unit of every length option."""
        low, high = self.bounds
        return math.hypot(*(high - low))  # the square of 1e-200 would be 0

    @cached_property
    def edges(self) -> IntArray:
        """Undirected edges (e, 2), lower index first, in ascending order; empty for a cloud.

        A face that names a vertex twice has no edge from the vertex to itself.
        """
        if self.faces is None:
            return frozen(np.empty((0, 2)), np.int32)
        half = np.sort(self.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        half = half[half[:, 0] != half[:, 1]]
        keys = half[:, 0].astype(np.int64) * self.point_count + half[:, 1]
        keys.sort()  # numpy.unique hashes integers, which is five times slower here
        keys = keys[np.r_[True, keys[1:] != keys[:-1]][: len(keys)]]
        return frozen(np.stack(divmod(keys, self.point_count), axis=1), np.int32)

    @cached_property
    def spacing(self) -> float:
        """Mean distance of neighbouring samples: the mean edge length.

        For a cloud, or a mesh whose vertices carry no edges, it is the mean distance to the
        nearest other sample (0 when all samples coincide).
        """
        if len(self.edges):
            ends = self.points[self.edges]
            return float(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).mean())
        if self.point_count < 2:
            return 0.0
        from scipy.spatial import cKDTree

        return float(cKDTree(self.points).query(self.points, k=2)[0][:, 1].mean())

    @cached_property
    def edge_twins(self) -> IntArray:
        """The same edge in the neighbouring face, (3m,): half-edge 3 f + j is side j of face f.

        Side j runs from corner j to corner j + 1. -1 at a border, at a non-manifold edge (three or
        more faces) and where a face that names a vertex twice meets itself.
        """
        result = np.full(3 * self.face_count, -1, np.int32)
        if self.faces is not None:
            half = np.sort(self.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
            keys = half[:, 0].astype(np.int64) * self.point_count + half[:, 1]
            order = np.argsort(keys, kind="stable")
            sorted_keys = keys[order]
            first = np.flatnonzero(np.r_[True, sorted_keys[1:] != sorted_keys[:-1]])
            pairs = first[np.diff(np.r_[first, len(keys)]) == 2]
            a, b = order[pairs], order[pairs + 1]
            a, b = a[a // 3 != b // 3], b[a // 3 != b // 3]
            result[a], result[b] = b, a
        return frozen(result, np.int32)

    @cached_property
    def face_adjacency(self) -> IntArray:
        """Face across each side, (m, 3); side j joins corners j and j + 1; -1: see `edge_twins`."""
        twins = self.edge_twins.reshape(-1, 3)
        return frozen(np.where(twins < 0, -1, twins // 3), np.int32)

    @cached_property
    def components(self) -> IntArray:
        """Connected component of each sample, (n,), numbered by their lowest vertex.

        Faces connect their corners. In a cloud every sample has number 0.
        """
        if self.faces is None:
            return frozen(np.zeros(self.point_count), np.int32)
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        a, b = self.edges.T
        n = self.point_count
        graph = coo_array((np.ones(len(a), np.int8), (a, b)), shape=(n, n))
        return frozen(connected_components(graph, directed=False)[1], np.int32)
