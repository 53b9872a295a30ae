"""Operation: convex pieces of a solid for physics engines, and their files.

URDF names an OBJ file for each piece, beside it; MJCF (MuJoCo) holds all pieces itself; glTF and
OBJ have an object for each. Lengths are metres where the unit of the shape is known, but for OBJ,
which keeps those of the shape.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from medialis.base.arrays import enclosed_volume
from medialis.base.options import METERS
from medialis.base.progress import Progress
from medialis.base.validation import FloatArray, IntArray
from medialis.formats.files import Drawn, write_lines
from medialis.formats.gltf import TRIANGLES, VERTICES, Buffer
from medialis.formats.text_meshes import write_obj
from medialis.operations.declaration import Format, Operation
from medialis.operations.result import Layer, Outcome, Result
from medialis.robots.convex_pieces import ConvexPiecesOptions, convex_pieces
from medialis.shape.shape import Shape


@dataclass(frozen=True, kw_only=True)
class ConvexPiecesRun(ConvexPiecesOptions):
    """Options of the operation `convex_pieces`."""


def run(shape: Shape, options: ConvexPiecesRun, progress: Progress) -> Outcome:
    """Find the pieces; each has its own points, so that its number colours it sharply."""
    found = convex_pieces.of(shape, options, progress)
    layer = Layer(
        "convex_pieces",
        found.points,
        found.faces,
        attributes={"piece": found.of_points},
        face_attributes={"piece_of_face": found.of_faces},
        color_by="piece",
        labels=("piece",),
        role="shape",
    )
    parts = [found.piece(number) for number in range(len(found))]
    table = [
        {"piece": k, "corners": len(points), "volume": enclosed_volume(points, faces)}
        for k, (points, faces) in enumerate(parts)
    ]
    return Outcome(
        shape=shape,
        layers=(layer,),
        values={
            "pieces": len(found),
            "largest_error": max(found.pieces_to_surface, found.surface_to_pieces),
            "pieces_to_surface": found.pieces_to_surface,
            "surface_to_pieces": found.surface_to_pieces,
            "volume_ratio": None if math.isnan(found.volume_ratio) else found.volume_ratio,
            "most_corners": max(len(points) for points, _ in parts),
            "diagonal": shape.diagonal,
            "piece_table": table,
        },
        arrays={"piece": found.of_faces},
        extras={"pieces": (layer, found)},
    )


Part = tuple[str, FloatArray, IntArray]


def _parts(result: Result, scale: float | None = None) -> list[Part]:
    """Return name, points and faces of each piece, in metres or scaled."""
    layer, found = result.extras["pieces"]
    placed = replace(found, points=layer.points)
    unit = result.shape.unit
    factor = (METERS[unit] if unit else 1.0) if scale is None else scale
    parts = enumerate(map(placed.piece, range(len(placed))))
    return [(f"piece_{number}", factor * points, faces) for number, (points, faces) in parts]


def _write_urdf(path: Path, result: Result, new: Callable[[str], Path]) -> None:
    """Write a link with a collision element for each piece, and the mesh of each beside it."""
    lines = ['<?xml version="1.0"?>', f"<robot name={quoteattr(path.stem)}>"]
    lines.append('  <link name="body">')
    for name, points, faces in _parts(result):
        file = new(f"{path.stem}_{name}.obj")
        write_obj(file, Drawn(points, faces))
        lines += [
            f'    <collision name="{name}">',
            f"      <geometry><mesh filename={quoteattr(file.name)}/></geometry>",
            "    </collision>",
        ]
    write_lines(path, [*lines, "  </link>", "</robot>"])


def _write_mjcf(path: Path, result: Result) -> None:
    """Write a body that does not move, of a geom for each piece, for MuJoCo."""
    parts = _parts(result)
    lines = [f"<mujoco model={quoteattr(path.stem)}>", "  <asset>"]
    for name, points, faces in parts:
        vertex = " ".join(map(repr, points.ravel().tolist()))
        face = " ".join(map(str, faces.ravel().tolist()))
        lines.append(f'    <mesh name="{name}" vertex="{vertex}" face="{face}"/>')
    lines += ["  </asset>", "  <worldbody>", '    <body name="body">']
    for name, _, _ in parts:
        lines.append(f'      <geom name="{name}" type="mesh" mesh="{name}"/>')
    write_lines(path, [*lines, "    </body>", "  </worldbody>", "</mujoco>"])


def _write_obj(path: Path, result: Result) -> None:
    """Write an object for each piece."""
    lines, first = [f"# lengths in {result.shape.unit}"] if result.shape.unit else [], 1
    for name, points, faces in _parts(result, 1.0):
        lines.append(f"o {name}")
        lines += ["v " + " ".join(map(repr, row)) for row in points.tolist()]
        lines += ["f " + " ".join(map(str, row)) for row in (faces + first).tolist()]
        first += len(points)
    write_lines(path, lines)


def _write_glb(path: Path, result: Result) -> None:
    """Write a node with a mesh for each piece, around the middle of each."""
    store, meshes, nodes = Buffer(), [], list[dict[str, Any]]()
    for number, (name, points, faces) in enumerate(_parts(result)):
        middle = points.mean(axis=0)
        corners = (points - middle).astype(np.float32)
        own = {"POSITION": store.add(corners, VERTICES, limits=True)}
        indices = store.add(faces.astype(np.uint32).ravel(), TRIANGLES)
        meshes.append({"name": name, "primitives": [{"attributes": own, "indices": indices}]})
        nodes.append({"name": name, "mesh": number, "translation": middle.tolist()})
    scenes = [{"nodes": list(range(len(nodes)))}]
    store.write(path, {"scene": 0, "scenes": scenes, "nodes": nodes, "meshes": meshes})


OPERATION = Operation(
    name="convex_pieces",
    filter_name="generate_convex_pieces",
    label="Convex pieces",
    group="Skeleton",
    help="Hold a shape by few convex pieces that leave its holes open, for physics engines.\n\n"
    "A convex decomposition: groups of small triangles are merged while the pieces stick out of "
    "the shape by no more than the error, so that holes, windows and thin walls stay. "
    "They come as URDF, MJCF, glTF and OBJ, an object for each piece.",
    options=ConvexPiecesRun,
    run=run,
    needs_faces=True,
    formats=(
        Format("urdf", _write_urdf, "pieces", beside=True),
        Format("xml", _write_mjcf, "pieces"),
        Format("glb", _write_glb, "pieces"),
        Format("obj", _write_obj, "pieces"),
    ),
    examples=(
        ("creature.ply --error 3%", "pieces that keep its limbs apart"),
        ("creature.ply -o rough --error 10%", "fewer pieces, for a rough shape"),
    ),
    layers={"convex_pieces": "the pieces as closed meshes, with the number of each"},
    order=66,
    words=("convex decomposition", "collision", "convex hull", "physics"),
)
