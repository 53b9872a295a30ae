"""Unfolded: a surface whose every node has one normal and one ball (for thesis 6.2.2)."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from medialis.kept import Bound
from medialis.model.medial_cloud import MedialCloud
from medialis.model.ragged import Ragged
from medialis.validation import FloatArray, IntArray, frozen, hold

TANGENT = 0.95
"""Cosine, of 18 degrees: between a spoke and the normal of the wall that its ball touches."""


@dataclass(frozen=True, eq=False, repr=False)
class Unfolded(Bound):
    """The surface as balls see it: cut along creases where sheets end, spread out along the others.

    A sample has one node. At a crease it has one for each smooth sector of faces, so that triangles
    on both sides end in balls of their own normal. Where the surface bends inward, strips of
    triangles between the balls of fans join the sectors; where it bends outward nothing does.

    Attributes
    ----------
    rows : (u,) int32
        Row of the cloud that holds the ball of each node.
    centers, radii : (u, 3) and (u,) float64
        Of the ball; the sample itself and 0 on a crease where a sheet ends.
    normals : (u, 3) float64
        Normal of the surface at the first contact: that of the sector.
    contacts, contact_normals : (u, 3) float64
        Second contact and the normal there: on such a crease, the sample and the normal across.
    regions : (u, 2) int32
        Region of the surface (`Creases.regions`) of the first and of the second contact.
    across : (u,) int32
        Node at the second contact, or the nearest one to it; -1 where there is none.
    faces : (t, 3) int32
        Triangles between nodes: those of the surface, then the strips; none of a point cloud.
    face_origin : (t,) int32
        Face of the surface that each triangle is, or lies beside.
    graph : Ragged
        Neighbours of each node, u rows.
    cloud : MedialCloud
        The balls.

    Raises
    ------
    InvalidShapeError
        When the arrays do not fit together.
    """

    rows: IntArray
    centers: FloatArray
    radii: FloatArray
    normals: FloatArray
    contacts: FloatArray
    contact_normals: FloatArray
    regions: IntArray
    across: IntArray
    faces: IntArray
    face_origin: IntArray
    graph: Ragged
    cloud: MedialCloud = field(kw_only=True)

    def __post_init__(self) -> None:
        u, t = len(self.rows), len(self.faces)
        vectors = ("centers", "normals", "contacts", "contact_normals")
        hold(
            self,
            rows=(np.int32, u),
            radii=(np.float64, u),
            regions=(np.int32, u, 2),
            across=(np.int32, u),
            faces=(np.int32, t, 3),
            face_origin=(np.int32, t),
            **dict.fromkeys(vectors, (np.float64, u, 3)),
        )

    def __len__(self) -> int:
        return len(self.rows)

    def __repr__(self) -> str:
        return f"Unfolded({len(self)} nodes, {len(self.faces)} triangles)"

    @cached_property
    def samples(self) -> IntArray:
        """Sample of each node, (u,)."""
        return frozen(self.cloud.source[self.rows], np.int32)

    @cached_property
    def points(self) -> FloatArray:
        """Place of each node on the surface, (u, 3)."""
        return frozen(self.cloud.surface.points[self.samples], np.float64)

    @cached_property
    def parted(self) -> NDArray[np.bool_]:
        """True where a crease lies between the two contacts, (u,): they are not the same wall."""
        return frozen(self.regions[:, 0] != self.regions[:, 1], np.bool_)

    @cached_property
    def areas(self) -> FloatArray:
        """Area of the surface round each node, (u,)."""
        if self.cloud.surface.faces is None:
            return frozen(self.cloud.surface.point_areas[self.samples], np.float64)
        a, b, c = (self.points[self.faces[:, j]] for j in range(3))
        third = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6
        total = np.bincount(self.faces.ravel(), np.repeat(third, 3), len(self))
        return frozen(total, np.float64)

    @cached_property
    def spokes(self) -> tuple[FloatArray, FloatArray]:
        """Unit vectors from the center to the first and to the second contact, each (u, 3).

        The second one is the normal of the wall there, unless the two have little in common: a
        tolerance turns a spoke by some degrees.
        """
        side = self.cloud.side[self.rows][:, None]
        first = _directions(self.points - self.centers, side * self.normals)
        wall = side * self.contact_normals
        second = _directions(self.contacts - self.centers, wall)
        tangent = np.einsum("ij,ij->i", second, wall) > TANGENT
        second = np.where(tangent[:, None], wall, second)
        return frozen(first, np.float64), frozen(second, np.float64)


def _directions(vectors: FloatArray, instead: FloatArray) -> FloatArray:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.divide(vectors, length, out=np.array(instead), where=length > 0)
