"""STEP in: faces of a CAD model as triangles, through the optional cascadio (MIT).

cascadio cuts the faces of Open CASCADE into triangles and hands them on as binary glTF, one
primitive a body, in metres and single precision, with the normals of the model's surfaces and the
kind of each face. Neighbouring faces have the same points along their common edge. The triangles
follow the model to within `CHORD` of its size, and turn by at most `TURN` from one to the next, so
that they are facets of a smooth surface and no creases.
"""

from __future__ import annotations

import json
import math
import re
import struct
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import sums_of, unit_rows
from medialis.base.errors import InvalidShapeError
from medialis.base.options import METERS
from medialis.base.validation import FloatArray, IntArray

CHORD = 5e-5
"""Share of the diagonal that a triangle may lie off its face. A curved wall is off by a quarter of
this on each side: one of 1.5 in a part of 80 by 0.1 % (0.17 % where doubled, 0.05 % where halved,
in a third more time)."""

TURN = 0.25
"""Radians between neighbouring triangles, some 14 degrees: creases begin at 30. The normals are
those of the model, so that narrow fillets need no more: their facets are as wide as a sixth of a
right angle, and lie within `CHORD` wherever that is narrower. At 0.1 the rims of a tube took 60,000
triangles, and its middle surface was off by 4 % of the thickness beside them, for 0.6 %."""

SMOOTH = math.cos(math.radians(1.0))
"""Faces that go over into each other smoothly have one normal, up to this angle from their mean."""

COARSE = 1e6
"""A distance, in the millimetres of cascadio, that limits nothing: for the size of the model."""

SINGLE = 2.0**-24
"""Relative rounding of the numbers in binary glTF."""

_PREFIXES = {b"MILLI": "mm", b"CENTI": "cm", b"DECI": "dm", b"MICRO": "um", b"KILO": "km"}
_SI = re.compile(
    rb"LENGTH_UNIT\s*\(\s*\)[^;]{0,200}?SI_UNIT\s*\(\s*(?:\.(\w+)\.|\$)\s*,\s*\.METRE\.\s*\)"
)
_NAMED = re.compile(rb"CONVERSION_BASED_UNIT\s*\(\s*'(\w+)'[^;]{0,200}?LENGTH_UNIT")
_WORDS = {b"INCH": "in", b"FOOT": "ft"}

_INDICES = {5121: "u1", 5123: "<u2", 5125: "<u4"}


@dataclass(frozen=True)
class _Piece:
    """Triangles of a model in metres: normals of its faces at their points, and what each is on."""

    points: FloatArray
    normals: FloatArray
    corners: NDArray[np.int64]
    patch: NDArray[np.int64]
    is_plane: NDArray[np.bool_]


def parse_step(
    data: bytes,
) -> tuple[FloatArray, NDArray[np.int64], str, IntArray, FloatArray, IntArray, IntArray]:
    """Return points and triangles of a STEP file, its unit, and what the model says of them.

    That is the face of the model that each triangle lies on, the normal of the surface at each
    point, zero where faces meet in an edge, the flat face of each triangle, -1 for none, and the
    solid of each triangle. Solids that touch share no points.

    It runs in a process of its own (`formats/foreign.py`), since damaged files crash the library
    and keep it busy for ever.

    Raises
    ------
    InvalidShapeError
        When cascadio finds nothing to cut into triangles.
    """
    unit, pieces = _unit_of(data), list(_pieces(data))
    starts = np.cumsum([0, *(len(piece.points) for piece in pieces)])
    firsts = np.cumsum([0, *(piece.patch.max(initial=-1) + 1 for piece in pieces)])
    corners = np.concatenate([p.corners + s for p, s in zip(pieces, starts, strict=False)])
    patches = np.concatenate([p.patch + s for p, s in zip(pieces, firsts, strict=False)])
    patches = np.unique(patches, return_inverse=True)[1].astype(np.int32)
    flat = np.concatenate([piece.is_plane for piece in pieces])
    planes = np.full(len(patches), -1, np.int32)
    planes[flat] = np.unique(patches[flat], return_inverse=True)[1]
    places = _rounded(np.concatenate([piece.points for piece in pieces]) / METERS[unit])
    solid = np.repeat(np.arange(len(pieces)), [len(piece.points) for piece in pieces])
    rows, number = np.unique(np.column_stack([places, solid]), axis=0, return_inverse=True)
    number = number.ravel()
    normals = _normals(np.concatenate([piece.normals for piece in pieces]), number, len(rows))
    bodies = solid[corners[:, 0]].astype(np.int32)
    return rows[:, :3], number[corners], unit, patches, normals, planes, bodies


def _normals(normals: FloatArray, number: NDArray[np.int64], count: int) -> FloatArray:
    """Return the normal at each point, zero where faces of the model meet in an edge there."""
    total = sums_of(number, normals, count)
    mean = unit_rows(total, 1e-12)
    off = np.einsum("ij,ij->i", normals, mean[number]) < SMOOTH
    mean[number[off]] = 0.0
    return mean


def _unit_of(data: bytes) -> str:
    """Return the unit that a STEP file draws in; millimetres where it says none or several."""
    found = {
        "m" if prefix is None else _PREFIXES.get(prefix.upper(), "")
        for prefix in (match[1] for match in _SI.finditer(data))
    }
    # A unit such as the inch is defined by a metric one, which is then not that of the model.
    named = {_WORDS.get(match[1].upper(), "") for match in _NAMED.finditer(data)}
    found = named or found
    unit = next(iter(found)) if len(found) == 1 else ""
    return unit or "mm"


def _rounded(points: FloatArray) -> FloatArray:
    """Drop the digits that single precision made: 100.00000149 becomes 100."""
    diagonal = float(np.linalg.norm(np.ptp(points, axis=0)))
    largest = max(float(np.abs(points).max()), diagonal)
    if largest == 0.0:
        return points
    digits = -int(np.ceil(np.log10(largest * SINGLE)))
    return np.round(points, digits)


def _pieces(data: bytes) -> Iterator[_Piece]:
    """Give the triangles of each body of the model.

    Raises
    ------
    InvalidShapeError
        When there is none.
    """
    packed = _tessellated(data)
    if len(packed) < 20:
        raise InvalidShapeError("no faces were found in this STEP file: it is damaged.")
    length = struct.unpack("<I", packed[12:16])[0]
    scene, binary = json.loads(packed[20 : 20 + length]), packed[28 + length :]
    meshes, found = scene.get("meshes", []), False
    for mesh, place in _placed(scene):
        for primitive in meshes[mesh]["primitives"]:
            if primitive.get("mode", 4) != 4:
                continue
            found = True
            yield _piece(scene, binary, primitive, place)
    if not found:
        raise InvalidShapeError("this STEP file has no faces, only curves or points.")


def _piece(
    scene: Mapping[str, Any], binary: bytes, primitive: Mapping[str, Any], place: FloatArray
) -> _Piece:
    """Return the triangles of a primitive, where they lie."""
    given = primitive["attributes"]
    points = _array(scene, binary, given["POSITION"], "<f4", 3)
    corners = _array(scene, binary, primitive["indices"], "", 3).astype(np.int64)
    normals = np.zeros_like(points)
    if "NORMAL" in given:
        turned = _array(scene, binary, given["NORMAL"], "<f4", 3) @ np.linalg.inv(place[:3, :3])
        normals = unit_rows(turned, 1e-12)
    about = primitive.get("extensions", {}).get("TM_brep_faces")
    patch, is_plane = np.zeros(len(corners), np.int64), np.zeros(len(corners), np.bool_)
    if about is not None:
        patch = _array(scene, binary, about["faceIndices"], "", 1)[:, 0].astype(np.int64)
        kinds = [face is not None and face.get("type") == "plane" for face in about["faces"]]
        is_plane = np.array(kinds, np.bool_)[patch]
    return _Piece(points @ place[:3, :3].T + place[:3, 3], normals, corners, patch, is_plane)


def _tessellated(data: bytes) -> bytes:
    """Return the faces as binary glTF, cut roughly, for the size, and then finely; or nothing."""
    sys.modules["trimesh"] = None  # type: ignore[assignment]  # cascadio works without, in half a second less
    import cascadio

    def cut(chord: float, turn: float) -> bytes:
        packed: bytes = cascadio.load(
            data, file_type="step", tol_linear=chord, tol_angular=turn, include_brep=True
        )
        return packed

    packed = cut(COARSE, 1.0)
    if len(packed) < 20:
        return b""
    scene = json.loads(packed[20 : 20 + int.from_bytes(packed[12:16], "little")])
    boxes = [about for about in scene["accessors"] if len(about.get("min", ())) == 3]
    low, high = ([f(box[key][d] for box in boxes) for d in range(3)]
                 for key, f in (("min", min), ("max", max)))  # fmt: skip
    return cut(max(CHORD * 1000.0 * math.dist(low, high), 1e-9), TURN)


def _placed(scene: Mapping[str, Any]) -> Iterator[tuple[int, FloatArray]]:
    """Give the meshes of a scene, each with where it lies: a part may be there several times."""
    nodes = scene.get("nodes", [])
    children = {child for node in nodes for child in node.get("children", ())}
    waiting = [(row, np.eye(4)) for row in range(len(nodes)) if row not in children][::-1]
    while waiting:
        row, above = waiting.pop()
        node = nodes[row]
        here = above @ _matrix(node)
        if "mesh" in node:
            yield node["mesh"], here
        waiting += [(child, here) for child in reversed(node.get("children", ()))]


def _matrix(node: Mapping[str, Any]) -> FloatArray:
    """Return the transform of a node: its matrix, or scale, turn and shift."""
    if "matrix" in node:
        return np.array(node["matrix"], float).reshape(4, 4).T
    x, y, z, w = node.get("rotation", (0.0, 0.0, 0.0, 1.0))
    result = np.eye(4)
    result[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    result[:3, :3] *= np.array(node.get("scale", (1.0, 1.0, 1.0)))
    result[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return result


def _array(scene: Mapping[str, Any], binary: bytes, row: int, kind: str, width: int) -> Any:
    """Return the rows of an accessor."""
    about = scene["accessors"][row]
    view = scene["bufferViews"][about["bufferView"]]
    kind = kind or _INDICES[about["componentType"]]
    count = about["count"] * (width if about["type"] == "VEC3" else 1)
    start = view.get("byteOffset", 0) + about.get("byteOffset", 0)
    return np.frombuffer(binary, kind, count, start).reshape(-1, width).astype(np.float64)
