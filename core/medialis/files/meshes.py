"""Mesh and point-cloud files in: one function for all formats, one sentence for every bad file."""

from __future__ import annotations

import codecs
import importlib.util
import os
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from medialis.errors import InvalidShapeError
from medialis.files import off, point_text, step, stl
from medialis.files._content import ParsedMesh
from medialis.files._files import file_bytes, reading
from medialis.files._foreign import foreign
from medialis.files._polygons import triangulate
from medialis.files.obj import parse_obj
from medialis.files.off import parse_off
from medialis.files.ply import parse_ply
from medialis.files.point_text import parse_point_text
from medialis.files.stl import parse_stl
from medialis.progress import Message
from medialis.units import nearest_unit
from medialis.validation import FloatArray, IntArray, as_normals, frozen

_EXTENSIONS = {
    **{".ply": "ply", ".obj": "obj", ".off": "off", ".coff": "off", ".noff": "off", ".stl": "stl"},
    **{".xyz": "xyz", ".pts": "xyz", ".txt": "xyz", ".csv": "xyz", ".asc": "xyz", ".xyzn": "xyz"},
}
_PARSERS: dict[str, Callable[[bytes], ParsedMesh]] = {
    **{"ply": parse_ply, "off": parse_off, "stl": parse_stl, "obj": parse_obj},
    "xyz": parse_point_text,
}
_THROUGH_TRIMESH = {".glb", ".gltf", ".3mf", ".dae", ".3dxml", ".zae", ".xaml", ".ctm"}


MOST_UNPACKED = 4_000_000_000
"""Bytes in an archive: ten times the largest meshes that people hand round."""


@dataclass(frozen=True, eq=False)
class MeshData:
    """What a file holds, as triangles; not yet repaired (see `medialis.surface.repair`).

    Attributes
    ----------
    points : (n, 3) float64
        Vertices; a vertex that no face uses may be NaN or infinite.
    faces : (m, 3) int32 or None
        Triangles; None for a point cloud.
    normals : (n, 3) float64 or None
        Unit vertex normals, a zero row where a vertex has none; None when the file has none.
    format : str
        "ply", "obj", "off", "stl", "xyz", or the extension that trimesh read.
    messages : tuple of Message
        What was split, left out or ignored, one sentence each.
    viewpoints : (n, 3) float64 or None
        Where each vertex was seen from, NaN where unknown; None when the file does not say.
    unit : str or None
        What one unit of the points is, such as "mm"; None when the format does not say.
    patches : (m,) int32 or None
        The face of the CAD model that each triangle lies on; None when there is no such model.
    """

    points: FloatArray
    faces: IntArray | None
    normals: FloatArray | None
    format: str
    messages: tuple[Message, ...] = ()
    viewpoints: FloatArray | None = None
    unit: str | None = None
    patches: IntArray | None = None


def read_mesh(path: str | os.PathLike[str]) -> MeshData:
    """Read a mesh or point cloud.

    PLY, OBJ, OFF, STL and plain text points are read here; glTF, 3MF, Collada and others through
    `trimesh` when it is installed, STEP through `cascadio`. The extension names the
    format; where the content says otherwise, the content wins. Polygons are split into triangles.

    Parameters
    ----------
    path : path
        The file.

    Returns
    -------
    MeshData

    Raises
    ------
    FileError
        When the file is missing, a directory, or may not be read.
    InvalidShapeError
        When the content is empty, damaged, cut short, of an unknown format, names vertices that
        are not there, or a face uses a vertex that is NaN or infinite.
    """
    name = os.fspath(path)
    data = file_bytes(name)
    suffix = Path(name).suffix.lower()
    with reading(name):
        if suffix in _THROUGH_TRIMESH or data.startswith(b"glTF"):
            binary_gltf = data.startswith(b"glTF")
            return _read_with_trimesh(name, "glb" if binary_gltf else suffix.lstrip("."))
        if not stl.is_binary_stl(data):
            data = data.removeprefix(codecs.BOM_UTF8)  # some editors put it before any text
            if data[:400].lstrip().startswith(b"ISO-10303-21"):
                return _read_step(data)
            if other := foreign(data):
                raise InvalidShapeError(other)
        kind, told = _format_of(suffix, data)
        parsed = _PARSERS[kind](data)
        return _checked(parsed, kind, told)


def _read_step(data: bytes) -> MeshData:
    """Cut the faces of a CAD model into triangles; each face is a patch."""
    parsed, patches, unit = step.parse_step(data)
    mesh = _checked(parsed, "step", ())
    faces = int(patches.max()) + 1
    text = f"The CAD model has {faces:,} {'face' if faces == 1 else 'faces'}, in {unit}."
    note = Message(text, "cad_faces", faces=faces, unit=unit)
    return replace(mesh, unit=unit, patches=frozen(patches, np.int32), messages=(note,))


def _looks_like(kind: str, data: bytes, expected: bool) -> bool:
    """Return whether the content has the marks of a format; `expected`: its extension says so."""
    if kind == "ply":
        return bool(re.match(rb"ply[ \t]*[\r\n]", data))
    if kind == "off":
        counts = expected and point_text.starts_with_numbers(data)
        return counts or bool(off.KEYWORD.match(data.lstrip()[:20]))
    if kind == "stl":
        return stl.is_binary_stl(data) or stl.is_ascii_stl(data)
    if kind == "obj":
        return bool(re.search(rb"(?:^|[\r\n])[ \t]*v[ \t]+[-+.\d]", data[:1_000_000]))
    return point_text.starts_with_numbers(data) and not stl.is_binary_stl(data)


def _format_of(suffix: str, data: bytes) -> tuple[str, tuple[Message, ...]]:
    """Return the format and what to tell when it is not that of the extension."""
    expected = _EXTENSIONS.get(suffix)
    # OBJ and point text have no mark of their own, so the marks of the others are looked at first.
    marked = [kind for kind in ("ply", "off", "stl") if _looks_like(kind, data, False)]
    if expected and expected in (marked or [expected]) and _looks_like(expected, data, True):
        return expected, ()
    for kind in _PARSERS:
        if kind in marked or _looks_like(kind, data, False):
            label = "plain text points" if kind == "xyz" else kind.upper()
            text = f"Read as {label}: the content is not what '{suffix}' says."
            return kind, (Message(text, "other_format", format=kind),)
    if expected:
        return expected, ()  # its parser tells what is wrong
    raise InvalidShapeError(
        f"neither its extension '{suffix}' nor its content is a known mesh format; "
        "PLY, OBJ, OFF, STL, STEP and text points (.xyz) can be read."
    )


def _checked(parsed: ParsedMesh, kind: str, told: tuple[Message, ...]) -> MeshData:
    points = parsed.points
    if len(points) == 0:
        raise InvalidShapeError("the file has no vertices.")
    if len(points) > np.iinfo(np.int32).max:
        raise InvalidShapeError(f"it has {len(points)} vertices; at most 2147483647 are supported.")
    finite = np.asarray(np.isfinite(points).all(axis=1))
    if not finite.any():
        raise InvalidShapeError("all its vertices are NaN or infinite.")
    safe = points if finite.all() else np.where(finite[:, None], points, 0.0)
    faces, split = triangulate(safe, parsed.counts, parsed.corners)
    if not finite.all():
        used = np.zeros(len(points), bool)
        used[faces] = True
        bad = used & ~finite
        if bad.any():
            raise InvalidShapeError(
                f"faces use {int(bad.sum())} of {len(points)} vertices that are NaN or infinite "
                f"(first: vertex {int(bad.argmax())}); remove or correct them."
            )
    normals = None if parsed.normals is None else as_normals(parsed.normals, len(points))
    return MeshData(
        frozen(points, np.float64),
        frozen(faces, np.int32) if len(faces) else None,
        normals,
        kind,
        told + parsed.messages + split,
        None if parsed.viewpoints is None else frozen(parsed.viewpoints, np.float64),
    )


def _check_unpacked(name: str) -> None:
    """Refuse an archive that unpacks to more than memory should be given for it."""
    import zipfile

    if not zipfile.is_zipfile(name):
        return
    with zipfile.ZipFile(name) as archive:
        size = sum(entry.file_size for entry in archive.infolist())
    if size > MOST_UNPACKED:
        raise InvalidShapeError(
            f"the archive unpacks to {size / 1e9:.3g} GB; at most {MOST_UNPACKED / 1e9:g} GB are "
            "read. Unpack it and name the mesh inside."
        )


def _read_with_trimesh(name: str, kind: str) -> MeshData:
    """Read through the optional trimesh; a scene becomes one mesh with its transforms applied."""
    if importlib.util.find_spec("trimesh") is None:
        raise InvalidShapeError(
            f".{kind} files are read through trimesh, which is not installed; "
            'install it with: pip install "medialis[io]".'
        )
    import trimesh

    _check_unpacked(name)
    try:
        loaded: Any = trimesh.load(name, file_type=kind, process=False)
        if isinstance(loaded, trimesh.Scene):
            loaded = loaded.to_mesh()
        points = np.array(loaded.vertices, np.float64).reshape(-1, 3)
        faces = np.array(getattr(loaded, "faces", np.empty((0, 3))), np.int64).reshape(-1, 3)
    except Exception as error:  # noqa: BLE001 - a third-party parser may raise anything
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise InvalidShapeError(f"trimesh could not read it ({reason}).") from None
    counts = np.full(len(faces), 3, np.int64)
    mesh = _checked(ParsedMesh(points, counts, faces.ravel()), kind, ())
    unit = nearest_unit(getattr(loaded, "units", None))
    return replace(mesh, unit="m" if kind in ("glb", "gltf") else unit)  # glTF knows metres alone
