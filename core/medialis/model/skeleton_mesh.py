"""SkeletonMesh: triangles between skeleton points (thesis 3.4.1)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from medialis.model.medial_cloud import MedialCloud
from medialis.model.surface import Surface
from medialis.validation import FloatArray, IntArray, as_faces, frozen, hold


@dataclass(frozen=True, eq=False, repr=False)
class SkeletonMesh(Surface):
    """A surface skeleton as triangles: open sheets that meet along curves, not a manifold.

    It is a `Surface`: areas, edges, components and more are its quantities.

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
        Face of the surface from which each triangle was lifted.
    cloud : MedialCloud
        The k balls.
    selected : (k,) bool
        Balls that the mesh was made of.

    Raises
    ------
    InvalidShapeError
        When the arrays do not fit together.
    """

    points: FloatArray
    faces: IntArray
    rows: IntArray
    face_origin: IntArray
    cloud: MedialCloud = field(kw_only=True)
    selected: NDArray[np.bool_] = field(kw_only=True)

    def __post_init__(self) -> None:
        p, t = len(self.points), len(self.faces)
        hold(
            self,
            points=(np.float64, p, 3),
            faces=(np.int32, t, 3),
            rows=(np.int32, p),
            face_origin=(np.int32, t),
            selected=(np.bool_, len(self.cloud)),
        )
        as_faces(self.faces, p)

    @classmethod
    def of_rows(
        cls, cloud: MedialCloud, triangles: IntArray, origin: IntArray, selected: NDArray[np.bool_]
    ) -> SkeletonMesh:
        """Make a mesh of triangles that name rows of the cloud; its points keep their order."""
        used = np.zeros(len(cloud), np.bool_)
        used[triangles] = True
        rows = np.flatnonzero(used).astype(np.int32)
        place = np.cumsum(used, dtype=np.int32) - 1
        faces = frozen(place[triangles], np.int32)
        return cls(cloud.centers[rows], faces, rows, origin, cloud=cloud, selected=selected)

    def __repr__(self) -> str:
        return f"SkeletonMesh({len(self.points)} points, {len(self.faces)} faces)"
