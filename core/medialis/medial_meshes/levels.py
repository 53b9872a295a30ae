"""Layers of medial meshes, and of their coarser and finer levels."""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import polylines
from medialis.base.validation import FloatArray
from medialis.medial_meshes.envelope import primitives_of
from medialis.medial_meshes.mesh import Collapse, Complex, MedialMesh
from medialis.operations.result import FilterUnit, Layer

STEPS = ("removed", "into", "after")


@dataclass(frozen=True, eq=False)
class MeshLevels:
    """A medial mesh as a layer, with any number of balls that its levels have.

    Attributes
    ----------
    mesh : MedialMesh
    diagonal : float
        Of the shape.
    importance : (n,) float64 or None
        Of the balls; those of other levels have that of the nearest one.
    """

    mesh: MedialMesh
    diagonal: float
    importance: FloatArray | None = None

    @property
    def fewest(self) -> int:
        """Balls of the coarsest level."""
        return self.mesh.fewest

    @property
    def most(self) -> int:
        """Balls of the finest level."""
        return self.mesh.most

    def layer(self, count: int) -> Layer:
        """Return the balls, the triangles, and the edges of no triangle of a level."""
        mesh = self.mesh.level(count)
        rows = primitives_of(mesh.complex)
        bare = rows[(rows[:, 2] < 0) & (rows[:, 1] >= 0), :2].astype(np.int32)
        attributes: dict[str, NDArray[Any]] = {"radius": mesh.radii}
        if self.importance is not None:
            attributes["importance"] = self._importance_of(mesh)
        attributes["ball_sheet"] = mesh.sheets.of_points.astype(np.int32)
        on_faces: dict[str, NDArray[Any]] = {}
        if len(mesh.faces):
            on_faces["sheet"] = mesh.sheets.of_faces.astype(np.int32)
        return Layer(
            "medial_mesh",
            mesh.centers,
            mesh.faces if len(mesh.faces) else None,
            bare if len(bare) else None,
            attributes=attributes,
            face_attributes=on_faces,
            color_by="radius",
            labels=(*on_faces, "ball_sheet"),
            filter_by="radius" if self.importance is None else "importance",
            filter_unit=FilterUnit.length(self.diagonal),
            role="balls",
            levels=self if self.fewest < self.most else None,
        )

    def _importance_of(self, mesh: MedialMesh) -> FloatArray:
        from scipy.spatial import cKDTree

        assert self.importance is not None
        if mesh is self.mesh:
            return self.importance
        found: FloatArray = self.importance[cKDTree(self.mesh.centers).query(mesh.centers)[1]]
        return found

    def packed(self) -> bytes:
        """Return all of it as bytes, for hosts that keep it with their data."""
        mesh = self.mesh
        arrays: dict[str, Any] = {"diagonal": self.diagonal}
        arrays |= {name: getattr(mesh, name) for name in ("centers", "radii", "edges", "faces")}
        if self.importance is not None:
            arrays["importance"] = self.importance
        for name, sequence in (("finer", mesh._finer), ("coarser", mesh._coarser)):
            if sequence is not None:
                start = sequence.start
                own = {"balls": start.balls, "edges": start.edges, "faces": start.faces}
                own |= {step: getattr(sequence, step) for step in STEPS}
                arrays |= {f"{name}_{key}": _small(value) for key, value in own.items()}
        stream = io.BytesIO()
        np.savez_compressed(stream, **arrays)
        return stream.getvalue()

    @classmethod
    def unpacked(cls, data: bytes) -> Self:
        """Return what was packed."""
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            arrays = dict(file)
        finer, coarser = (_sequence(arrays, name) for name in ("finer", "coarser"))
        balls = np.column_stack([arrays["centers"], arrays["radii"]])
        given = Complex(balls, arrays["edges"].astype(np.int64), arrays["faces"].astype(np.int64))
        mesh = MedialMesh.of(given, finer=finer, coarser=coarser)
        return cls(mesh, float(arrays["diagonal"]), arrays.get("importance"))


def _sequence(arrays: Mapping[str, NDArray[Any]], name: str) -> Collapse | None:
    if f"{name}_balls" not in arrays:
        return None
    floats = ("balls", "after")
    own: dict[str, Any] = {
        key: arrays[f"{name}_{key}"].astype(np.float64 if key in floats else np.int64)
        for key in ("balls", "edges", "faces", *STEPS)
    }
    start = Complex(own["balls"], own["edges"], own["faces"])
    return Collapse(start, own["removed"], own["into"], own["after"])


def _small(values: NDArray[Any]) -> NDArray[Any]:
    return values.astype(np.int32) if values.dtype.kind == "i" else values


def seams_layer(mesh: MedialMesh) -> tuple[Layer, ...]:
    """Return the curves where three sheets or more meet, as a layer; none without seams."""
    seams = mesh.sheets.seams
    if not len(seams):
        return ()
    balls, rows = np.unique(seams, return_inverse=True)
    edges = rows.reshape(-1, 2).astype(np.int32)
    lines = polylines(edges, len(balls))
    edges = np.concatenate([np.stack([line[:-1], line[1:]], axis=1) for line in lines])
    curve = np.zeros(len(balls), np.int32)
    for number, line in enumerate(lines):
        curve[line] = number
    return (
        Layer(
            "medial_mesh_seams",
            mesh.centers[balls],
            edges=edges.astype(np.int32),
            attributes={"radius": mesh.radii[balls], "seam": curve},
            color_by="seam",
            labels=("seam",),
            role="hidden",
        ),
    )
