"""Operation: the compact medial mesh of a closed shape, its error, and its envelope as a mesh."""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import polylines
from medialis.base.errors import InvalidShapeError
from medialis.base.options import changed, file, flag, length, whole
from medialis.base.progress import Progress, counted
from medialis.base.validation import FloatArray
from medialis.medial_meshes.distances import EnvelopeDistance, ball_cover, envelope_distance
from medialis.medial_meshes.envelope import EnvelopeSurfaceOptions, envelope_surface, primitives_of
from medialis.medial_meshes.formats import BALL_FORMATS, read_ma
from medialis.medial_meshes.medial_mesh import MedialMeshOptions, medial_mesh
from medialis.medial_meshes.mesh import (
    BallCover,
    Collapse,
    Complex,
    MedialMesh,
    important_mesh,
    values_on_balls,
)
from medialis.operations.declaration import Operation
from medialis.operations.positions import place, places
from medialis.operations.result import FilterUnit, Layer, Outcome
from medialis.shape.shape import Shape
from medialis.skeleton.importance.importance import ImportanceOptions, geodesic_importance
from medialis.skeleton.layers import summary
from medialis.skeleton.surface_skeleton import SurfaceSkeletonOptions, surface_skeleton

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


MOST_LEVELS = 6


@dataclass(frozen=True, kw_only=True)
class MedialMeshRun(MedialMeshOptions, EnvelopeSurfaceOptions):
    """Options of the operation `medial_mesh`."""

    balls: int = changed(MedialMeshOptions, "balls")
    error: float = changed(MedialMeshOptions, "error")
    quality: str = changed(MedialMeshOptions, "quality")
    cell: float = changed(EnvelopeSurfaceOptions, "cell")
    cover: bool = flag(
        False,
        "Cover",
        "Also move and enlarge the balls until every point of the surface lies in one, for robots "
        "that keep clear of it.",
    )
    levels: int = whole(
        0,
        "Coarser levels",
        "Also give so many coarser meshes, each of half as many balls: merged, not fitted anew.",
        low=0,
        high=MOST_LEVELS,
    )
    importance: bool = flag(
        False,
        "Importance",
        "Measure the importance of each ball: that of the nearest one of the surface skeleton.",
    )
    threshold: float = length(
        0.0,
        "Importance from",
        "Take balls that are less important than this share of the size from the rims; the "
        "topology stays. 0 keeps all.",
        high=10.0,
    )
    edited: str = file(
        "Edited mesh",
        "An MA file whose medial mesh is measured, and its surface rebuilt, instead of computing "
        "one.",
        layer="medial_mesh",
        advanced=True,
    )


def run(shape: Shape, options: MedialMeshRun, progress: Progress) -> Outcome:
    """Compute the mesh, measure it, and rebuild the surface from it."""
    with progress.stage("medial mesh", 0.0, 0.7):
        mesh = _given(shape, options, progress)
    importance = None
    if options.importance or options.threshold:
        with progress.stage("importance", 0.7, 0.8):
            importance = _importance(mesh, shape, progress)
    if options.threshold:
        assert importance is not None
        least = options.threshold * shape.diagonal
        mesh, importance = _simplified(mesh, importance, least, progress)
    with progress.stage("distance", 0.8, 0.9):
        error = envelope_distance(mesh, shape)
    with progress.stage("envelope", 0.9, 0.98):
        envelope = envelope_surface.of(mesh, options, progress)
    levels = MeshLevels(mesh.with_levels(), shape.diagonal, importance)
    first = levels.layer(len(mesh))
    surface = Layer(
        "medial_mesh_envelope",
        envelope.points,
        envelope.faces,
        role="" if options.edited else "hidden",  # what was edited is looked at
        formats=("glb", "obj"),
    )
    cover = ball_cover(mesh, shape) if options.cover else None
    layers = [replace(first, formats=("ma",)), surface, *seams_layer(mesh)]
    if cover is not None:
        layers.append(_cover_layer(cover))
    return Outcome(
        shape=shape,
        layers=(*layers, *_coarser(levels, len(mesh), options.levels)),
        values={**_values(mesh, error, shape), **_further(cover, importance)},
        arrays={
            "centers": places(mesh.centers),
            "mesh_radii": mesh.radii,
            "mesh_edges": mesh.edges,
            "mesh_faces": mesh.faces,
            "mesh_sheets": mesh.sheets.of_faces.astype(np.int32),
            "mesh_seams": mesh.sheets.seams.astype(np.int32),
        },
    )


def _given(shape: Shape, options: MedialMeshRun, progress: Progress) -> MedialMesh:
    """Compute the mesh, or read the one that was edited."""
    if not options.edited:
        return medial_mesh.of(shape, options, progress)
    if shape.faces is None:
        raise InvalidShapeError("A medial mesh is measured against a mesh, got a point cloud.")
    found = read_ma(options.edited)
    return replace(found, centers=found.centers - shape.offset)


def _importance(mesh: MedialMesh, shape: Shape, progress: Progress) -> FloatArray:
    """Carry the importance of the surface skeleton to the balls."""
    cloud = surface_skeleton.of(shape, SurfaceSkeletonOptions(), progress)
    lengths = geodesic_importance.of(cloud.own, ImportanceOptions(), progress).length
    return values_on_balls(mesh, cloud.own, lengths)


def _simplified(
    mesh: MedialMesh, importance: FloatArray, threshold: float, progress: Progress
) -> tuple[MedialMesh, FloatArray]:
    """Leave less important balls out; return their importance with those that stay."""
    found = important_mesh(mesh, importance, threshold)
    stays = {tuple(ball) for ball in found.complex.balls.tolist()}
    kept = np.array([tuple(ball) in stays for ball in mesh.complex.balls.tolist()])
    progress.note(
        f"{counted(len(mesh) - len(found), 'ball')} of {len(mesh):,} left out as less important.",
        "less_important",
        balls=len(mesh) - len(found),
        of=len(mesh),
    )
    return found, importance[kept]


def _cover_layer(cover: BallCover) -> Layer:
    """Layer of the balls for robots."""
    return Layer(
        "ball_cover",
        cover.centers,
        attributes={"radius": cover.radii},
        color_by="radius",
        role="hidden",
        formats=("json", "urdf"),
        facts={"excess_volume": cover.excess},
    )


def _coarser(levels: MeshLevels, balls: int, count: int) -> list[Layer]:
    """Layers of half as many balls, a quarter, and so on, down to the fewest."""
    found: list[Layer] = []
    for number in range(1, count + 1):
        layer = levels.layer(balls >> number)
        if len(layer.points) < (len(found[-1].points) if found else balls):
            name = f"medial_mesh_level_{number}"
            found.append(replace(layer, name=name, role="hidden", levels=None))
    return found


def _values(mesh: MedialMesh, error: EnvelopeDistance, shape: Shape) -> dict[str, Any]:
    parts, loops, hollows = mesh.betti
    sheets = mesh.sheets
    return {
        "balls": len(mesh),
        "edges": len(mesh.edges),
        "faces": len(mesh.faces),
        "parts": parts,
        "loops": loops,
        "hollows": hollows,
        "sheets": int(sheets.of_faces.max(initial=-1)) + 1,
        "seams": len(polylines(sheets.seams, len(mesh))),
        "seam_edges": len(sheets.seams),
        "largest_error": error.largest,
        "surface_to_envelope": error.surface_to_envelope,
        "envelope_to_surface": error.envelope_to_surface,
        "mean_error": error.mean,
        "position": place(error.place),
        "fewest_balls": mesh.fewest,
        "most_balls": mesh.most,
        **summary(mesh.radii, "radius"),
        "diagonal": shape.diagonal,
    }


def _further(cover: BallCover | None, importance: FloatArray | None) -> dict[str, Any]:
    """Values of what was asked for besides."""
    values: dict[str, Any] = {}
    if importance is not None:
        values |= summary(importance, "importance")
    if cover is not None:
        values |= {"cover_balls": len(cover), "cover_excess": cover.excess}
    return values


OPERATION = Operation(
    name="medial_mesh",
    filter_name="generate_medial_mesh",
    label="Medial mesh",
    group="Skeleton",
    help="Compute the shape as few balls, connected with the topology of the solid.\n\n"
    "Balls are joined by edges and triangles: cones and slabs between them fill the shape. The "
    "number of balls, or the largest distance to the surface, is chosen; the rest follows. The "
    "union of balls, cones and slabs comes as a closed mesh of its own, and the balls as a file "
    "for other programs (medial_mesh.ma). Balls that were moved, scaled or deleted give a new "
    "surface.",
    examples=(
        ("creature.ply --balls 60", "60 balls, their edges and triangles, and the surface of them"),
        (
            "creature.ply --balls 60 --cover -o robot",
            "balls that hold the whole surface, for robots",
        ),
    ),
    layers={
        "medial_mesh": "balls with their radius, triangles with their sheet, and edges of no "
        "triangle",
        "medial_mesh_envelope": "the union of balls, cones and slabs as a closed mesh",
        "medial_mesh_seams": "the curves where three sheets or more meet",
        "ball_cover": "balls that hold the whole surface",
        **{
            f"medial_mesh_level_{number}": f"the mesh merged to 1/{1 << number} of the balls"
            for number in range(1, MOST_LEVELS + 1)
        },
    },
    options=MedialMeshRun,
    formats=BALL_FORMATS,
    run=run,
    thin_lines=True,
    needs_faces=True,
    order=65,
)
