"""Operation: the compact medial mesh of a closed shape, its error, its envelope, and its files.

MA files are the text form that programs for medial meshes share. The first line counts vertices,
edges and triangles; then come ``v x y z r``, ``e i j`` and ``f i j k``, counted from 0. Some
programs write more numbers behind them, more lines, or leave edges of triangles out. MATFP ends
rows with a type and with a 1 where they were deleted; deleted balls stay in the file, so that
numbers still mean the same.

Balls alone are for programs that keep robots clear of things: JSON, and collision elements of URDF.
"""

from __future__ import annotations

import io
import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import Index, kd_tree, polylines
from medialis.base.errors import InvalidOptionError, InvalidShapeError
from medialis.base.options import METERS, changed, file, flag, length, whole
from medialis.base.progress import Progress, counted
from medialis.base.validation import FloatArray
from medialis.formats.files import complete_file, number_lines, reading
from medialis.medial_meshes.distances import EnvelopeDistance, ball_cover, envelope_distance
from medialis.medial_meshes.envelope import EnvelopeSurfaceOptions, envelope_surface, primitives_of
from medialis.medial_meshes.medial_mesh import MedialMeshOptions, medial_mesh
from medialis.medial_meshes.mesh import (
    BallCover,
    Collapse,
    Complex,
    MedialMesh,
    important_mesh,
    values_on_balls,
)
from medialis.operations.declaration import Format, Operation
from medialis.operations.positions import place, places
from medialis.operations.result import FilterUnit, Layer, Outcome
from medialis.shape.shape import Shape
from medialis.skeleton.importance.importance import ImportanceOptions, geodesic_importance
from medialis.skeleton.layers import summary
from medialis.skeleton.surface_skeleton import SurfaceSkeletonOptions, surface_skeleton

WIDTHS = {"v": 4, "e": 2, "f": 3}
FLAGGED = {"v": 6, "e": 4, "f": 4}
"""Numbers of a row that ends with whether it was deleted."""


def write_ma(path: str | os.PathLike[str], mesh: MedialMesh, *, flags: bool = False) -> None:
    """Write a medial mesh as an MA file, with all digits.

    Parameters
    ----------
    path : path
    mesh : MedialMesh
    flags : bool
        Write what MATFP wants behind balls and edges: a type, and that no ball was deleted. Q-MAT
        and importers for Blender read files without.

    Raises
    ------
    FileError
        When the file cannot be written.

    See Also
    --------
    read_ma : reads it back.

    Examples
    --------
    >>> import tempfile
    >>> import medialis
    >>> mesh = medialis.MedialMesh([[0, 0, 0], [1, 0, 0]], [0.5, 0.25], [[0, 1]], [])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     medialis.write_ma(f"{folder}/capsule.ma", mesh)
    ...     medialis.read_ma(f"{folder}/capsule.ma").radii.tolist()
    [0.5, 0.25]
    """
    with complete_file(path) as stream:
        stream.write(_text(mesh, flags).encode("ascii"))


def _text(mesh: MedialMesh, flags: bool) -> str:
    lines = [f"{len(mesh)} {len(mesh.edges)} {len(mesh.faces)}"]
    balls = np.column_stack([mesh.centers, mesh.radii])
    for word, rows, mark in (("v", balls, "0 0"), ("e", mesh.edges, "0"), ("f", mesh.faces, "")):
        behind = [mark] if flags and mark else []
        lines += [" ".join([word, *map(repr, row), *behind]) for row in rows.tolist()]
    return "\n".join(lines) + "\n"


def read_ma(path: str | os.PathLike[str]) -> MedialMesh:
    """Read a medial mesh from an MA file, of this or of another program.

    Parameters
    ----------
    path : path

    Returns
    -------
    MedialMesh
        Sides of triangles that the file has no edge for are added; edges and triangles that it
        names twice, or with equal ends, are there once or not at all.

    Raises
    ------
    FileError
        When the file is missing or cannot be read.
    InvalidShapeError
        When its content is no medial mesh.

    See Also
    --------
    write_ma : writes such files.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import medialis
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "triangle.ma"
    ...     text = "3 0 1;v 0 0 0 1;v 3 0 0 1;v 0 3 0 1;f 0 1 2"
    ...     _ = path.write_text(text.replace(";", chr(10)))
    ...     len(medialis.read_ma(path).edges)
    3
    """
    name = os.fspath(path)
    with reading(name):
        rows: dict[str, list[list[float]]] = {word: [] for word in WIDTHS}
        deleted: dict[str, list[bool]] = {word: [] for word in WIDTHS}
        said = 0
        for number, text, (kind, *words) in number_lines(name):
            if kind in WIDTHS:
                count, width = len(words), WIDTHS[kind]
                if count < width:
                    problem = f"line {number} has {count} of {width} numbers: {text!r}."
                    raise InvalidShapeError(problem)
                rows[kind].append([float(word) for word in words[:width]])
                deleted[kind].append(count == FLAGGED[kind] and words[-1] == "1")
            elif not said and kind.lstrip("+-").isdigit():
                said = int(kind)
        return _mesh(rows, deleted, said)


def _mesh(
    rows: dict[str, list[list[float]]], deleted: dict[str, list[bool]], said: int
) -> MedialMesh:
    balls = np.array(rows["v"], np.float64).reshape(-1, 4)
    if len(balls) == 0:
        raise InvalidShapeError("it has no balls (lines v x y z r).")
    if said > len(balls):
        raise InvalidShapeError(f"it has {len(balls)} balls and says {said}: it was cut off.")
    kept = ~np.array(deleted["v"], bool)
    if not kept.any():
        raise InvalidShapeError("all its balls are marked as deleted.")
    number = np.where(kept, np.cumsum(kept) - 1, -1)
    simplices = (_simplices(rows[one], deleted[one], WIDTHS[one], number) for one in "ef")
    return MedialMesh.of_rows(balls[kept], *simplices)


def _simplices(rows: list[list[float]], deleted: list[bool], width: int, number: Index) -> Index:
    """Return the edges or triangles between balls that are there, in their numbers."""
    found, count = np.array(rows, np.float64).reshape(-1, width), len(number)
    if not ((found >= 0) & (found < count) & (found == np.rint(found))).all():
        raise InvalidShapeError(f"its edges and triangles must name balls from 0 to {count - 1}.")
    known = number[found[~np.array(deleted, bool)].astype(np.int64)]
    return known[(known >= 0).all(axis=1)]


ENDINGS = (".json", ".urdf")


def write_ball_cover(
    path: str | os.PathLike[str], cover: BallCover, *, unit: str | None = None
) -> None:
    """Write the balls that cover a shape, as JSON or as a link of URDF.

    Parameters
    ----------
    path : path
        Ends in .json (a list of balls, each with its center and radius, and the excess volume
        where it is known) or
        .urdf (a robot of one link with a collision element for each ball).
    cover : BallCover
    unit : str, optional
        What one unit of the shape is, as "mm"; lengths are written in metres then, else as they
        are.

    Raises
    ------
    InvalidOptionError
        For another ending, and for a unit that is not known.
    FileError
        When the file cannot be written.

    See Also
    --------
    ball_cover : makes the balls.

    Examples
    --------
    >>> import json
    >>> import tempfile
    >>> import medialis
    >>> shape = medialis.organic_shape(56)
    >>> cover = medialis.ball_cover(medialis.medial_mesh(shape, balls=12), shape)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     medialis.write_ball_cover(f"{folder}/balls.json", cover)
    ...     with open(f"{folder}/balls.json") as stream:
    ...         len(json.load(stream)["spheres"]) == len(cover)
    True
    """
    name = Path(path)
    ending = name.suffix.lower()
    if ending not in ENDINGS:
        raise InvalidOptionError(f"Balls are written as .json or .urdf, got {name.name!r}.")
    if unit is not None and unit not in METERS:
        raise InvalidOptionError(f"unit must be one of {', '.join(METERS)}, got {unit!r}.")
    scale = METERS[unit] if unit else 1.0
    balls = scale * np.column_stack([cover.centers, cover.radii])
    text = _json(balls, cover.excess) if ending == ".json" else _urdf(balls, name.stem)
    with complete_file(name) as stream:
        stream.write(text.encode("utf-8"))


def _json(balls: np.ndarray, excess: float) -> str:
    spheres = [{"center": ball[:3], "radius": ball[3]} for ball in balls.tolist()]
    known = {"excess_volume": excess} if math.isfinite(excess) else {}
    return json.dumps({"spheres": spheres, **known}, indent=1) + "\n"


def _urdf(balls: np.ndarray, name: str) -> str:
    from xml.sax.saxutils import quoteattr

    lines = ['<?xml version="1.0"?>', f"<robot name={quoteattr(name)}>", '  <link name="body">']
    for x, y, z, radius in balls.tolist():
        lines += [
            "    <collision>",
            f'      <origin xyz="{x!r} {y!r} {z!r}" rpy="0 0 0"/>',
            f'      <geometry><sphere radius="{radius!r}"/></geometry>',
            "    </collision>",
        ]
    return "\n".join([*lines, "  </link>", "</robot>", ""])


def mesh_of(layer: Layer) -> MedialMesh:
    """Return the balls of a layer with their edges and triangles.

    Raises
    ------
    InvalidOptionError
        When its points have no radius. Negative ones, which a host may have made, count as 0.
    """
    if "radius" not in layer.attributes:
        raise InvalidOptionError("The points have no attribute radius: they are no balls.")
    radii = np.maximum(np.asarray(layer.attributes["radius"], np.float64), 0.0)
    none = np.zeros((0, 3), np.int64)
    edges = none[:, :2] if layer.edges is None else layer.edges.astype(np.int64)
    faces = none if layer.faces is None else layer.faces.astype(np.int64)
    return MedialMesh.of_rows(np.column_stack([layer.points, radii]), edges, faces)


def _write_balls(path: Path, layer: Layer, unit: str | None) -> None:
    mesh, excess = mesh_of(layer), float(layer.facts.get("excess_volume", np.nan))
    write_ball_cover(path, BallCover(mesh.centers, mesh.radii, excess), unit=unit)


BALL_FORMATS = (
    Format("ma", lambda path, layer, unit: write_ma(path, mesh_of(layer))),
    *(Format(name, _write_balls) for name in ("json", "urdf")),
)
"""Of layers of balls: a medial mesh, and balls for robots."""


PARTS, STEPS = ("balls", "edges", "faces"), ("removed", "into", "after")


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
            nearest = slice(None)
            if mesh is not self.mesh:
                nearest = kd_tree(self.mesh.centers).query(mesh.centers)[1]
            attributes["importance"] = self.importance[nearest]
        attributes["ball_sheet"] = mesh.sheets.of_points.astype(np.int32)
        sheets = {"sheet": mesh.sheets.of_faces.astype(np.int32)}
        on_faces = sheets if len(mesh.faces) else {}
        faces, edges = (rows if len(rows) else None for rows in (mesh.faces, bare))
        return Layer(
            "medial_mesh",
            mesh.centers,
            faces,
            edges,
            attributes=attributes,
            face_attributes=on_faces,
            color_by="radius",
            labels=(*on_faces, "ball_sheet"),
            filter_by="radius" if self.importance is None else "importance",
            filter_unit=FilterUnit.length(self.diagonal),
            role="balls",
            levels=self if self.fewest < self.most else None,
        )

    def packed(self) -> bytes:
        """Return all of it as bytes, for hosts that keep it with their data."""
        mesh = self.mesh
        arrays: dict[str, Any] = {"diagonal": self.diagonal}
        arrays |= {name: getattr(mesh, name) for name in ("centers", "radii", "edges", "faces")}
        if self.importance is not None:
            arrays["importance"] = self.importance
        for name, sequence in (("finer", mesh._finer), ("coarser", mesh._coarser)):
            if sequence is not None:
                own = {part: getattr(sequence.start, part) for part in PARTS}
                own |= {step: getattr(sequence, step) for step in STEPS}
                for key, value in own.items():
                    small = value.dtype.kind == "i"
                    arrays[f"{name}_{key}"] = value.astype(np.int32) if small else value
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
    found: list[Any] = [
        arrays[f"{name}_{key}"].astype(np.float64 if key in ("balls", "after") else np.int64)
        for key in (*PARTS, *STEPS)
    ]
    return Collapse(Complex(*found[:3]), *found[3:])


def seams_layer(mesh: MedialMesh) -> tuple[Layer, ...]:
    """Return the curves where three sheets or more meet, as a layer; none without seams."""
    if not len(mesh.sheets.seams):
        return ()
    balls, rows = np.unique(mesh.sheets.seams, return_inverse=True)
    lines = polylines(rows, len(balls))
    edges = np.concatenate([np.stack([line[:-1], line[1:]], axis=1) for line in lines])
    curve = np.zeros(len(balls), np.int32)
    for number, line in enumerate(lines):
        curve[line] = number
    known: dict[str, Any] = {"color_by": "seam", "labels": ("seam",), "role": "hidden"}
    known["attributes"] = {"radius": mesh.radii[balls], "seam": curve}
    return (Layer("medial_mesh_seams", mesh.centers[balls], edges=edges, **known),)


def junctions_of(mesh: MedialMesh) -> Index:
    """Return the balls where three seams or more meet."""
    balls, uses = np.unique(mesh.sheets.seams, return_counts=True)
    return balls[uses > 2]


def junctions_layer(mesh: MedialMesh) -> tuple[Layer, ...]:
    """Return the balls where seams meet, as a layer; none without any."""
    balls = junctions_of(mesh)
    if not len(balls):
        return ()
    uses = np.bincount(mesh.sheets.seams.ravel(), minlength=len(mesh))[balls]
    attributes = {"radius": mesh.radii[balls], "seams": uses.astype(np.int32)}
    known: dict[str, Any] = {"color_by": "seams", "role": "hidden", "attributes": attributes}
    return (Layer("medial_mesh_junctions", mesh.centers[balls], **known),)


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
        "Remove balls from the rims that are less important than this share of the size; the "
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
    role = "" if options.edited else "hidden"  # what was edited is looked at
    known: dict[str, Any] = {"role": role, "formats": ("glb", "obj")}
    surface = Layer("medial_mesh_envelope", envelope.points, envelope.faces, **known)
    cover = ball_cover(mesh, shape) if options.cover else None
    layers = [replace(first, formats=("ma",)), surface]
    layers += [*seams_layer(mesh), *junctions_layer(mesh)]
    values = _values(mesh, error, shape)
    if importance is not None:
        values |= summary(importance, "importance")
    if cover is not None:
        layers.append(_cover_layer(cover))
        values |= {"cover_balls": len(cover), "cover_excess": cover.excess}
    return Outcome(
        shape=shape,
        layers=(*layers, *_coarser(levels, len(mesh), options.levels)),
        values=values,
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
    text = f"{counted(len(mesh) - len(found), 'ball')} of {len(mesh):,} left out as less important."
    progress.note(text, "less_important", balls=len(mesh) - len(found), of=len(mesh))
    return found, importance[kept]


def _cover_layer(cover: BallCover) -> Layer:
    """Layer of the balls for robots."""
    known: dict[str, Any] = {"color_by": "radius", "role": "hidden", "formats": ("json", "urdf")}
    facts, radius = {"excess_volume": cover.excess}, {"radius": cover.radii}
    return Layer("ball_cover", cover.centers, attributes=radius, facts=facts, **known)


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
        "junctions": len(junctions_of(mesh)),
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


OPERATION = Operation(
    name="medial_mesh",
    filter_name="generate_medial_mesh",
    label="Medial mesh",
    group="Skeleton",
    help="Describe a shape by few balls, joined into a mesh with the topology of the solid.\n\n"
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
        "medial_mesh_junctions": "the balls where three seams or more meet",
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
    words=("medial axis", "sphere mesh", "MAT"),
)
