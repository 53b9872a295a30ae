"""Shape: surface samples with outward normals and, for meshes, triangles.

All lengths are fractions of the diagonal of the bounding box. One stray point at a thousand times
the size of a shape makes the default lengths larger than the shape; `far_points` says so.
"""

from __future__ import annotations

import hashlib
import logging
import math
from collections.abc import Hashable
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import Index
from medialis.base.errors import InvalidShapeError
from medialis.base.options import as_unit
from medialis.base.progress import Message
from medialis.base.validation import (
    AXES,
    Directions,
    FloatArray,
    IntArray,
    Positions,
    as_choice,
    as_faces,
    as_normals,
    as_points,
    owned,
)
from medialis.shape.surface import Surface

if TYPE_CHECKING:
    from medialis.shape.cylinders import Cylinders
    from medialis.shape.diagnosis import Diagnosis


def missing_value(values: NDArray[Any]) -> float | int:
    """Return what stands for none among such values: NaN, -1, or 0 where no type has a minus."""
    return {"f": np.nan, "i": -1}.get(np.asarray(values).dtype.kind, 0)


@dataclass(frozen=True, eq=False, repr=False)
class Shape(Surface):
    """A sampled surface: the input of every operation.

    Built directly it checks its arrays and takes them as they are; `medialis.make_shape` estimates
    missing normals and `medialis.read_shape` repairs a file first. A shape never changes: arrays
    that the caller could still write to are copied.

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
    unit : str or None
        What one unit of the points is, such as "mm"; None where nobody said.
    up : "x", "y", "z" or None
        The axis that points up, for pictures; None where nobody said.
    patches : (m,) int32 or None
        The patch that each face lies on, such as the face of a CAD model that was read; None where
        nobody said.
    planes : (m,) int32 or None
        The flat face of the part that each face lies in, -1 for facets of what is rounded (see
        `medialis.shape.planes`); None where nobody looked.
    cylinders : Cylinders or None
        The cylinders of the part, and the one that each face is a chord of (see
        `medialis.shape.cylinders`); None where nobody looked.

    Raises
    ------
    InvalidShapeError
        When an array has the wrong shape, is not finite, or a face index is out of range.
    """

    points: Positions
    normals: Directions
    faces: IntArray | None = None
    origin: IntArray | None = None
    face_origin: IntArray | None = None
    diagnosis: Diagnosis | None = None
    vertex_map: IntArray | None = None
    face_map: IntArray | None = None
    unit: str | None = None
    up: str | None = None
    patches: IntArray | None = None
    planes: IntArray | None = None
    cylinders: Cylinders | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "unit", as_unit(self.unit))
        if self.up is not None:
            as_choice(self.up, "up", AXES)
        points = owned(as_points(self.points))
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "normals", owned(as_normals(self.normals, len(points))))
        if self.faces is not None:
            faces = owned(as_faces(self.faces, len(points)))
            object.__setattr__(self, "faces", faces if len(faces) else None)
        for name, count in (
            ("origin", len(points)),
            ("face_origin", self.face_count),
            ("face_map", self.face_count),
            ("patches", self.face_count),
            ("planes", self.face_count),
            ("vertex_map", 0 if self.vertex_map is None else np.size(self.vertex_map)),
        ):
            value = getattr(self, name)
            if value is not None:
                if np.shape(value) != (count,):
                    raise InvalidShapeError(
                        f"{name} must have shape ({count},), got {np.shape(value)}."
                    )
                object.__setattr__(self, name, owned(np.asarray(value, np.int32)))

    def remade(self, **arrays: Any) -> Shape:
        """Return this shape with other arrays that follow from checked ones: nobody looks at them.

        They are nobody else's, contiguous, of the right types, and normals are unit or zero.
        """
        made = object.__new__(Shape)
        for value in arrays.values():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False
        made.__dict__.update({one.name: getattr(self, one.name) for one in fields(self)} | arrays)
        return made

    def some_bodies(self, chosen: NDArray[np.bool_]) -> tuple[Shape, Index, Index]:
        """Return some bodies as a shape, with the rows of their points and faces here.

        Parameters
        ----------
        chosen : (n,) bool
            Points; whole bodies of a mesh.

        Returns
        -------
        shape : Shape
            What repair and refinement did is left out.
        points : (k,) int64
        faces : (f,) int64
        """
        assert self.faces is not None
        points = np.flatnonzero(chosen)
        faces = np.flatnonzero(chosen[self.faces[:, 0]])
        place = np.cumsum(chosen, dtype=np.int32) - np.int32(1)
        left = {"origin": None, "face_origin": None, "vertex_map": None, "face_map": None}
        of_faces = {"patches": self.patches, "planes": self.planes}
        named = {k: None if rows is None else rows[faces] for k, rows in of_faces.items()}
        cylinders = None if self.cylinders is None else self.cylinders.of_faces(faces)
        arrays = {"points": self.points[points], "normals": self.normals[points]}
        corners = np.ascontiguousarray(place[self.faces[faces]])
        made = self.remade(**arrays, faces=corners, cylinders=cylinders, **named, **left)
        return made, points, faces

    @property
    def identity(self) -> Hashable:
        """A checksum of all that the shape holds: equal shapes share what is kept."""
        known = self.__dict__.get("_identity")
        if known is None:
            digest = hashlib.blake2b(digest_size=20)
            for one in fields(self):
                value = getattr(self, one.name)
                if isinstance(value, np.ndarray):
                    digest.update(f"{one.name} {value.shape} {value.dtype}".encode())
                    digest.update(value.data)
                else:
                    digest.update(f"{one.name} {value!r}".encode())
            known = digest.digest()
            self.__dict__["_identity"] = known
        return known

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


FAR = 50.0
"""Diagonals of what is meant: at this distance the whole of it is no longer than one edge that the
default refinement leaves (2 % of the diagonal)."""

TAILS = 0.1, 0.9
"""Quantiles of each coordinate that bound the bulk of the points: fewer than a tenth are strays."""


def far_points(shape: Shape) -> Message | None:
    """Return a sentence about points, or parts of a mesh, that lie far from the rest, or None.

    Parameters
    ----------
    shape : Shape
        A cloud, or a mesh whose points are all in use.

    Returns
    -------
    Message or None
        What lies where, what it does to the lengths, and what to do.
    """
    if _are_spread(shape):
        bulk = math.inf
    else:
        low, high = np.quantile(shape.points, TAILS, axis=0)
        bulk = float(np.linalg.norm(high - low))
    harm = f"Options are shares of the diagonal of {shape.diagonal:.3g}, too coarse for the"
    if 0 < bulk < shape.diagonal / FAR:
        away = ((shape.points < low - bulk) | (shape.points > high + bulk)).any(axis=1)
        first = ", ".join(f"{x:.6g}" for x in shape.points[int(away.argmax())])
        told = {"points": int(away.sum()), "of": shape.point_count, "size": bulk}
        text = (
            f"{told['points']} of {shape.point_count} points lie far from the rest, as at "
            f"({first}). {harm} rest. Delete strays."
        )
        return Message(text, "far_points", logging.WARNING, **told)
    largest = _largest_part(shape)
    if 0 < largest < shape.diagonal / FAR:
        parts = int(shape.components.max()) + 1
        text = (
            f"The {parts} parts lie far apart. {harm} largest, of {largest:.3g}. Delete strays, or "
            "run the parts one by one."
        )
        return Message(text, "far_parts", logging.WARNING, parts=parts, size=largest)
    return None


def _are_spread(shape: Shape) -> bool:
    """Tell whether the bulk of the points is surely no share of the diagonal that counts as far.

    Along the longest side more points than the tails hold lie on both sides of a slab twice as wide
    as that share: so do the quantiles, which take long to find.
    """
    low, high = shape.bounds
    axis = int((high - low).argmax())
    values, middle = shape.points[:, axis], 0.5 * (low[axis] + high[axis])
    half, least = shape.diagonal / FAR, TAILS[0] * len(values) + 2
    sides = values < middle - half, values > middle + half
    return all(np.count_nonzero(side) > least for side in sides)


def _largest_part(shape: Shape) -> float:
    """Return the diagonal of the largest component."""
    if not shape.components.any():
        return shape.diagonal
    order = np.argsort(shape.components, kind="stable")
    starts = np.flatnonzero(np.diff(shape.components[order], prepend=-1))
    points: FloatArray = shape.points[order]
    size = np.maximum.reduceat(points, starts) - np.minimum.reduceat(points, starts)
    return float(np.linalg.norm(size, axis=1).max())
