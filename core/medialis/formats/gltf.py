"""Triangle meshes as binary glTF (GLB), and the buffer that GLB files are written with.

Lengths are metres, the unit of glTF, where the unit of the shape is known. glTF keeps single
precision: a shape far from the origin is stored around its middle, and moved there by its node.
"""

from __future__ import annotations

import json
import os
import struct
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.options import METERS
from medialis.base.validation import FloatArray
from medialis.formats.files import complete_file

if TYPE_CHECKING:
    from medialis.shape.surface import Surface

FAR = 16.0
"""Diagonals between the origin and the middle of a shape from which on it is moved."""

BYTE, SHORT, INDEX, FLOAT = 5121, 5123, 5125, 5126
"""Types of numbers in glTF."""

VERTICES, TRIANGLES = 34962, 34963
"""What a part of the buffer is for."""

HALF = float(np.sqrt(0.5))

UP_TO_Y: dict[str, tuple[FloatArray, list[float]]] = {
    "x": (np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), [0.0, 0.0, HALF, HALF]),
    "y": (np.eye(3), []),
    "z": (np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), [-HALF, 0.0, 0.0, HALF]),
}
"""Turns of the axis that points up to y, which is up in glTF: matrix, quaternion (x, y, z, w)."""

_CODES = {np.dtype(np.uint8): BYTE, np.dtype(np.uint16): SHORT, np.dtype(np.uint32): INDEX,
          np.dtype(np.float32): FLOAT}  # fmt: skip
_SHAPES = {(): "SCALAR", (3,): "VEC3", (4,): "VEC4", (4, 4): "MAT4"}


def write_gltf(
    path: str | os.PathLike[str], surface: Surface, name: str, *, unit: str | None = None
) -> None:
    """Write a mesh as GLB, with the normals of its vertices.

    Parameters
    ----------
    path : path
        Replaced when it is there.
    surface : Surface
        A mesh of n vertices.
    name : str
        Of the mesh in the file.
    unit : str, optional
        What one unit of the points is; metres when unknown.

    Raises
    ------
    FileError
        When the file cannot be written.
    """
    assert surface.faces is not None
    scale, middle = METERS[unit] if unit else 1.0, middle_of(surface)
    store = Buffer()
    points = (scale * (surface.points - middle)).astype(np.float32)
    attributes = {"POSITION": store.add(points, VERTICES, limits=True)}
    normals = _normals(surface)
    if np.isfinite(normals).all():
        attributes["NORMAL"] = store.add(normals, VERTICES)
    indices = store.add(surface.faces.astype(np.uint32).ravel(), TRIANGLES)
    node: dict[str, Any] = {"name": name, "mesh": 0}
    if middle.any():
        node["translation"] = (scale * middle).tolist()
    store.write(path, {
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [node],
        "meshes": [{"name": name, "primitives": [{"attributes": attributes, "indices": indices}]}],
    })  # fmt: skip


def middle_of(surface: Surface) -> FloatArray:
    """Return what a surface is stored around, (3,): its middle where it is far, else 0."""
    middle: FloatArray = (surface.bounds[0] + surface.bounds[1]) / 2
    return middle if np.abs(middle).max() > FAR * surface.diagonal else np.zeros(3)


def _normals(surface: Surface) -> NDArray[np.float32]:
    """Return unit normals of vertices, weighted by areas; NaN where there is none."""
    assert surface.faces is not None
    sums = np.zeros_like(surface.points)
    for corner in surface.faces.T:
        np.add.at(sums, corner, surface.face_vectors)
    with np.errstate(invalid="ignore", divide="ignore"):
        sums /= np.linalg.norm(sums, axis=1, keepdims=True)
    return sums.astype(np.float32)


class Buffer:
    """The binary part of a file, and what stands where in it."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._views: list[dict[str, int]] = []
        self._accessors: list[dict[str, Any]] = []
        self._size = 0

    def add(self, values: NDArray[Any], target: int | None = None, *, limits: bool = False) -> int:
        """Store an array and return the number by which it is known."""
        data = np.ascontiguousarray(values).astype(values.dtype.newbyteorder("<")).tobytes()
        view = {"buffer": 0, "byteOffset": self._size, "byteLength": len(data)}
        self._views.append(view if target is None else {**view, "target": target})
        about: dict[str, Any] = {
            "bufferView": len(self._views) - 1,
            "componentType": _CODES[values.dtype],
            "count": len(values),
            "type": _SHAPES[values.shape[1:]],
        }
        if limits:
            about["min"] = [float(x) for x in values.min(axis=0)]
            about["max"] = [float(x) for x in values.max(axis=0)]
        self._accessors.append(about)
        data += b"\0" * (-len(data) % 4)
        self._parts.append(data)
        self._size += len(data)
        return len(self._accessors) - 1

    def write(self, path: str | os.PathLike[str], scene: dict[str, Any]) -> None:
        """Write header, text and numbers."""
        scene |= {
            "asset": {"version": "2.0", "generator": "medialis"},
            "buffers": [{"byteLength": self._size}],
            "bufferViews": self._views,
            "accessors": self._accessors,
        }
        text = json.dumps(scene, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        with complete_file(path) as stream:
            stream.write(struct.pack("<4sII", b"glTF", 2, 28 + len(text) + self._size))
            stream.write(struct.pack("<I4s", len(text), b"JSON") + text)
            stream.write(struct.pack("<I4s", self._size, b"BIN\0"))
            stream.writelines(self._parts)
