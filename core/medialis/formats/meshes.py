"""Mesh and point-cloud files in: one function for all formats, one sentence for every bad file.

The format is that of the extension, unless the content says otherwise. A file that is no mesh is
known by how it begins, and the sentence says what to do. Polygons become triangles in their plane
and orientation, without new vertices.

Strategy of the triangles: polygons are grouped by their number of corners and each group is cut at
once. A quad takes the diagonal that leaves both triangles facing the way the polygon faces, the
shorter one when both do. A larger polygon is a fan from its first corner when all triangles of the
fan face that way (always so when it is convex without straight corners); the rare others are cut
ear by ear.
"""

from __future__ import annotations

import codecs
import io
import os
import re
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.errors import InvalidShapeError
from medialis.base.progress import Message
from medialis.base.validation import (
    FloatArray,
    IntArray,
    all_finite,
    as_normals,
    extremes,
    frozen,
    sealed,
)
from medialis.formats import pcd, point_texts, vtk_polydata
from medialis.formats import text_meshes as texts
from medialis.formats.files import ParsedMesh, file_bytes, reading
from medialis.formats.foreign import BY_CONTENT, BY_ENDING, parsed_foreign
from medialis.formats.ply import parse_ply

UNPACK = "unpack it first"
EXPORT = "export PLY, OBJ or STL from a program that opens it"

LABELS = "medialis.label_surfaces makes shapes of its labels"

_MARKS = (
    (rb"\x1f\x8b", "is packed with gzip", UNPACK),
    (rb"PK\x03\x04", "is a zip archive", UNPACK),
    (rb"BZh\d", "is packed with bzip2", UNPACK),
    (rb"\xfd7zXZ\0", "is packed with xz", UNPACK),
    (rb"7z\xbc\xaf\x27\x1c", "is a 7z archive", UNPACK),
    (rb"\x28\xb5\x2f\xfd", "is packed with zstd", UNPACK),
    (rb"\xff\xfe|\xfe\xff", "is text in UTF-16", "save it as UTF-8"),
    (rb"version https://git-lfs", "is only a pointer of Git LFS", "get the file with git lfs pull"),
    (rb"(?i)\s*<(!doctype html|html)", "is a web page", "download the mesh itself"),
    (rb"\x89PNG|\xff\xd8\xff|GIF8|%PDF", "is a picture or document", "name the mesh file"),
    (rb"BLENDER", "is a Blender file", "export PLY, OBJ or STL, or use the Blender extension"),
    (rb"Kaydara FBX|; FBX", "is an FBX file", EXPORT),
    (rb"(?s).{344}(n[+i]1)\0|NRRD\d|ObjectType *= *Image", "is a volume of voxels", LABELS),
)


def foreign(data: bytes) -> str | None:
    r"""Return what a file is instead of a mesh and what to do, or None.

    Examples
    --------
    >>> foreign(b"PK\x03\x04..."), foreign(b"ply\n")
    ('it is a zip archive: unpack it first.', None)
    """
    for mark, what, advice in _MARKS:
        if re.match(mark, data[:400]):
            return f"it {what}: {advice}."
    return None


def triangulate(
    points: FloatArray, counts: NDArray[np.int64], corners: NDArray[np.int64]
) -> tuple[IntArray, tuple[Message, ...]]:
    """Cut polygons into triangles, in the order of the polygons.

    Parameters
    ----------
    points : (n, 3) float64
    counts : (p,) int64
        Corners of each polygon; polygons with fewer than three are left out.
    corners : (sum of counts,) int64
        Vertex indices.

    Returns
    -------
    faces : (m, 3) int32
    messages : tuple of Message
        What was split or left out.

    Raises
    ------
    InvalidShapeError
        When a corner is not a vertex.
    """
    _check_corners(len(points), counts, corners)
    if len(counts) == 0 or extremes(counts) == (3, 3):
        return corners.reshape(-1, 3).astype(np.int32), ()
    starts = np.cumsum(counts) - counts
    made = np.maximum(counts - 2, 0)
    places = np.cumsum(made) - made
    faces = np.empty((int(made.sum()), 3), np.int32)
    for size in np.unique(counts[counts >= 3]):
        rows = np.flatnonzero(counts == size)
        polygons = corners[starts[rows, None] + np.arange(size)]
        target = places[rows, None] + np.arange(size - 2)
        faces[target] = _split(points, polygons)
    return faces, _split_messages(counts)


def _check_corners(n: int, counts: NDArray[np.int64], corners: NDArray[np.int64]) -> None:
    low, high = extremes(corners)
    if low >= 0 and high < n:
        return
    bad = (corners < 0) | (corners >= n)
    polygon = np.repeat(np.arange(len(counts)), counts)
    first = int(bad.argmax())
    raise InvalidShapeError(
        f"faces must name vertices 0..{n - 1} (counted from 0), but {len(np.unique(polygon[bad]))} "
        f"of {len(counts)} do not (first: face {polygon[first]} names vertex {corners[first]})."
    )


def _split_messages(counts: NDArray[np.int64]) -> tuple[Message, ...]:
    polygons = "Split {} polygon{} of five or more corners into triangles."
    kinds = (
        (counts == 4, "quads_split", "Split {} quad{} into triangles."),
        (counts > 4, "polygons_split", polygons),
        (counts < 3, "corners_missing", "Left out {} face{} with fewer than three corners."),
    )
    return tuple(
        Message(text.format(n, "" if n == 1 else "s"), code, faces=n)
        for rows, code, text in kinds
        if (n := int(rows.sum()))
    )


def _split(points: FloatArray, polygons: NDArray[np.int64]) -> NDArray[np.int64]:
    """Cut (k, size) polygons of one size into (k, size - 2, 3) triangles."""
    size = polygons.shape[1]
    if size == 3:
        return polygons[:, None, :]
    # Scaled to about 1 so that products of very large or very small coordinates stay in range.
    with np.errstate(all="ignore"):
        local = points[polygons] - points[polygons[:, :1]]
        extent = np.abs(local).max(axis=(1, 2), keepdims=True)
        local = np.where(extent > 0, local / extent, 0.0)
        following = np.roll(local, -1, axis=1)
        normals = np.cross(local, following).sum(axis=1)  # Newell: twice the area vector
    if size == 4:
        return _split_quads(local, normals, polygons)
    fan = np.stack(np.broadcast_arrays(0, np.arange(1, size - 1), np.arange(2, size)), axis=1)
    result = polygons[:, fan]
    bad = ~(_facing(local, normals, fan) > 0).all(axis=1)
    for row in np.flatnonzero(bad):
        result[row] = polygons[row][_clip_ears(local[row], normals[row])]
    return result


def _facing(local: FloatArray, normals: FloatArray, triangles: NDArray[np.int64]) -> FloatArray:
    """Return, (k, triangles), how much each local triangle faces along its polygon's normal."""
    a, b, c = (local[:, triangles[:, i]] for i in range(3))
    with np.errstate(all="ignore"):
        return np.einsum("kti,ki->kt", np.cross(b - a, c - a), normals)


def _split_quads(
    local: FloatArray, normals: FloatArray, quads: NDArray[np.int64]
) -> NDArray[np.int64]:
    cuts = np.array([[[0, 1, 2], [0, 2, 3]], [[0, 1, 3], [1, 2, 3]]])
    fits = [(_facing(local, normals, cut) > 0).all(axis=1) for cut in cuts]
    with np.errstate(all="ignore"):
        length = [np.linalg.norm(local[:, j] - local[:, i], axis=1) for i, j in ((0, 2), (1, 3))]
    second = np.where(fits[0] == fits[1], length[1] < length[0], fits[1])
    return np.where(second[:, None, None], quads[:, cuts[1]], quads[:, cuts[0]])


def _clip_ears(local: FloatArray, normal: FloatArray) -> NDArray[np.int64]:
    """Cut one polygon ear by ear, the fattest ear without another corner in it first."""
    from medialis.base._kernels import clip_ears

    drop = int(np.abs(normal).argmax())
    flat = np.delete(local, drop, axis=1)
    # Dropping y swaps the handedness of the remaining two axes.
    if (normal[drop] < 0) != (drop == 1):
        flat = flat * [-1.0, 1.0]
    triangles = np.empty((len(flat) - 2, 3), np.int64)
    clip_ears(np.ascontiguousarray(flat), triangles)
    return triangles


_EXTENSIONS = {
    **{".ply": "ply", ".obj": "obj", ".off": "off", ".coff": "off", ".noff": "off", ".stl": "stl"},
    **{".xyz": "xyz", ".pts": "xyz", ".txt": "xyz", ".csv": "xyz", ".asc": "xyz", ".xyzn": "xyz"},
    ".pcd": "pcd",
}
_PARSERS: dict[str, Callable[[bytes], ParsedMesh]] = {
    **{"ply": parse_ply, "off": texts.parse_off, "stl": texts.parse_stl, "obj": texts.parse_obj},
    **{"pcd": pcd.parse_pcd, "xyz": point_texts.parse_point_text},
}


MOST_UNPACKED = 4_000_000_000
"""Bytes in an archive: ten times the largest meshes that people hand round."""


UP = {"stl": "z", "3mf": "z", "step": "z", "las": "z", "laz": "z", "e57": "z"} | {
    **{"glb": "y", "gltf": "y"}
}
"""The axis that points up, by formats that have one: printers and CAD stand on x and y."""


@dataclass(frozen=True, eq=False)
class MeshData:
    """What a file holds, as triangles; not yet repaired (see `medialis.shape.repair`).

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
    planes : (m,) int32 or None
        The flat face of the model that each lies on, -1 for none; `normals` are those of the model
        then, zero at its edges.
    bodies : (m,) int32 or None
        The body of the file that each triangle belongs to: a solid of a STEP file, a placed mesh
        object of a 3MF file, a mesh of a scene. None where the format has none.
    own_up : str or None
        The axis that points up, where the file says it, as Collada does.
    """

    points: FloatArray
    faces: IntArray | None
    normals: FloatArray | None
    format: str
    messages: tuple[Message, ...] = ()
    viewpoints: FloatArray | None = None
    unit: str | None = None
    patches: IntArray | None = None
    planes: IntArray | None = None
    bodies: IntArray | None = None
    own_up: str | None = None

    @property
    def up(self) -> str | None:
        """The axis that points up, as the file says or files of its format have it, else None."""
        return self.own_up or UP.get(self.format)


def read_mesh(path: str | os.PathLike[str]) -> MeshData:
    """Read a mesh or point cloud.

    PLY, OBJ, OFF, STL, 3MF, VTP, PCD and plain text points are read here; glTF, Collada and others
    through `trimesh` when it is installed, STEP through `cascadio`, LAS and LAZ through `laspy`,
    E57 through `pye57`. The extension names the
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
        binary_gltf, ending = data.startswith(b"glTF"), suffix.lstrip(".")
        if kind := _kind_of_scan(data):
            return _read_foreign(kind, data, name)
        if ending in BY_ENDING or binary_gltf:
            return _read_foreign("glb" if binary_gltf else ending, data, name)
        if not (data.startswith(b"ply") or texts.is_binary_stl(data)):
            data = data.removeprefix(codecs.BOM_UTF8)  # some editors put it before any text
            if data[:400].lstrip().startswith(b"ISO-10303-21"):
                return _read_foreign("step", data, name)
            if other := foreign(data):
                raise InvalidShapeError(other)
        kind, told = _format_of(suffix, data)
        parsed = _PARSERS[kind](data)
        return _checked(parsed, kind, told)


def _kind_of_scan(data: bytes) -> str | None:
    """Return the format of a scan, or of VTK's XML, by the first bytes; None if it is another."""
    if data.startswith(b"LASF"):
        compressed = len(data) > 104 and data[104] & 0xC0  # bits of the point format
        return "laz" if compressed else "las"
    if data.startswith(b"ASTM-E57"):
        return "e57"
    return "vtp" if vtk_polydata.MARK.match(data[:2000]) else None


def _read_foreign(kind: str, data: bytes, name: str) -> MeshData:
    """Read what a child process parses; faces of a CAD model are patches."""
    _check_unpacked(data)
    found = parsed_foreign(kind, data, name)
    counts, corners = found.counts, found.corners
    if counts is None or corners is None:
        counts, corners = np.full(len(found.faces), 3, np.int64), found.faces.ravel()
    normals = found.normals if found.planes is None else None
    parsed = ParsedMesh(found.points, counts, corners, normals, found.messages, found.viewpoints)
    mesh = _checked(parsed, kind, ())
    bodies = None if found.bodies is None else frozen(found.bodies, np.int32)
    up = _collada_up(data) if kind == "dae" else None
    mesh = replace(mesh, unit=found.unit, own_up=up, bodies=bodies)
    if found.patches is None:
        return mesh
    faces = int(found.patches.max()) + 1
    text = f"The CAD model has {faces:,} {'face' if faces == 1 else 'faces'}, in {found.unit}."
    note = Message(text, "cad_faces", faces=faces, unit=found.unit)
    told: dict[str, Any] = {"patches": frozen(found.patches, np.int32), "messages": (note,)}
    if found.normals is not None and found.planes is not None:
        told["normals"] = frozen(found.normals, np.float64)
        told["planes"] = frozen(found.planes, np.int32)
    return replace(mesh, **told)


def _collada_up(data: bytes) -> str:
    """Return the axis that points up in a Collada file: y where it does not say."""
    found = re.search(rb"<up_axis>\s*([XYZ])_UP\s*</up_axis>", data)
    return found[1].decode().lower() if found else "y"


def _check_unpacked(data: bytes) -> None:
    """Refuse an archive that unpacks to more than memory should be given for it."""
    stream = io.BytesIO(data)
    if not zipfile.is_zipfile(stream):
        return
    with zipfile.ZipFile(stream) as archive:
        size = sum(entry.file_size for entry in archive.infolist())
    if size > MOST_UNPACKED:
        raise InvalidShapeError(
            f"the archive unpacks to {size / 1e9:.3g} GB; at most {MOST_UNPACKED / 1e9:g} GB are "
            "read. Unpack it and name the mesh inside."
        )


def _looks_like(kind: str, data: bytes, expected: bool) -> bool:
    """Return whether the content has the marks of a format; `expected`: its extension says so."""
    if kind == "ply":
        return bool(re.match(rb"ply[ \t]*[\r\n]", data))
    if kind == "off":
        counts = expected and point_texts.starts_with_numbers(data)
        return counts or bool(texts.KEYWORD.match(data.lstrip()[:20]))
    if kind == "stl":
        return texts.is_binary_stl(data) or texts.is_ascii_stl(data)
    if kind == "pcd":
        return bool(pcd.MARK.match(data[:4000]))
    if kind == "obj":
        return bool(re.search(rb"(?:^|[\r\n])[ \t]*v[ \t]+[-+.\d]", data[:1_000_000]))
    return point_texts.starts_with_numbers(data) and not texts.is_binary_stl(data)


def _format_of(suffix: str, data: bytes) -> tuple[str, tuple[Message, ...]]:
    """Return the format and what to tell when it is not that of the extension."""
    expected = _EXTENSIONS.get(suffix)
    if expected == "ply" and _looks_like(expected, data, True):
        return expected, ()
    # OBJ and point text have no mark of their own, so the marks of the others are looked at first.
    marked = [kind for kind in ("ply", "off", "stl", "pcd") if _looks_like(kind, data, False)]
    if expected and expected in (marked or [expected]) and _looks_like(expected, data, True):
        return expected, ()
    for kind in _PARSERS:
        if kind in marked or _looks_like(kind, data, False):
            label = "plain text points" if kind == "xyz" else kind.upper()
            text = f"Read as {label}: the content is not what '{suffix}' says."
            return kind, (Message(text, "other_format", format=kind),)
    if expected:
        return expected, ()  # its parser tells what is wrong
    if suffix.lstrip(".") in BY_CONTENT:
        raise InvalidShapeError(
            f"it does not begin like a {suffix} file: it is damaged, or something else."
        )
    raise InvalidShapeError(
        f"neither its extension '{suffix}' nor its content is a known mesh format; "
        "PLY, OBJ, OFF, STL, STEP, VTP, PCD, LAS, E57 and text points (.xyz) can be read."
    )


def _checked(parsed: ParsedMesh, kind: str, told: tuple[Message, ...]) -> MeshData:
    points = parsed.points
    if len(points) == 0:
        raise InvalidShapeError("the file has no vertices.")
    if len(points) > np.iinfo(np.int32).max:
        raise InvalidShapeError(f"it has {len(points)} vertices; at most 2147483647 are supported.")
    whole = all_finite(points)
    finite = np.ones(len(points), bool) if whole else np.asarray(np.isfinite(points).all(axis=1))
    if not finite.any():
        raise InvalidShapeError("all its vertices are NaN or infinite.")
    safe = points if whole else np.where(finite[:, None], points, 0.0)
    faces, split = triangulate(safe, parsed.counts, parsed.corners)
    if not whole:
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
        frozen(sealed(points), np.float64),
        frozen(sealed(faces), np.int32) if len(faces) else None,
        normals,
        kind,
        told + parsed.messages + split,
        None if parsed.viewpoints is None else frozen(parsed.viewpoints, np.float64),
    )
