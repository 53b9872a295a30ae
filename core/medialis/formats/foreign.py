"""Meshes and scans that are parsed in a child process with limits, one process for each file.

STEP is read through cascadio (Open CASCADE), glTF, Collada and others through trimesh, LAS and LAZ
through laspy, E57 through pye57; 3MF and VTP by our own code with Python's XML parser. A file can
make such a parser crash, spin or take all memory: it does so in a process that has `SECONDS` and
`MEMORY`, and more for each byte of the file. The process opens no file but the modules that it runs
and, for glTF, buffers in the folder of the file; it starts no other process and no connection. What
it found comes back as JSON and arrays.

`parsed_foreign` is the door, `serve` runs in the process.
"""

from __future__ import annotations

import importlib.util
import io
import json
import os
import re
import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, cast
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from medialis.base.children import Ended, Limits, answer_of
from medialis.base.disk import Folder
from medialis.base.errors import InvalidShapeError, MedialisError
from medialis.base.options import nearest_unit
from medialis.base.progress import Message
from medialis.base.validation import FloatArray, IntArray
from medialis.formats.files import ParsedMesh, absolute

SECONDS, SECONDS_A_MEGABYTE = 10.0, 8.0
"""Processor time of a file. Good ones take 0.1 to 2 s for each MB, on a machine of 2026."""

MEMORY, MEMORY_A_BYTE = 750_000_000, 100
"""Bytes of memory of a file. Libraries take 80 to 350 MB before they read, good files some 50 times
their size."""

THROUGH_TRIMESH = ("glb", "gltf", "dae", "3dxml", "zae", "xaml", "ctm")
"""Formats by their endings; 3MF and STEP have readers of their own."""

CODE = (
    "import sys; from medialis.base.children import settle; settle(*sys.argv[1:]); "
    "from medialis.formats.foreign import serve; serve()"
)

BY_ENDING = ("3mf", *THROUGH_TRIMESH)
"""Formats that are parsed in the child process, by their endings."""

BY_CONTENT = ("vtp", "las", "laz", "e57")
"""Formats that are parsed there by how they begin, whatever their endings; STEP is, too."""

_LASPY = ("laspy", "LAS files are read through laspy", "scans")
_INSTALL = {
    "step": (("cascadio", "STEP files are read through cascadio", "cad"),),
    "las": (_LASPY,),
    "laz": (_LASPY, ("lazrs", "LAZ files are read through lazrs", "scans")),
    "e57": (("pye57", "E57 files are read through pye57", "scans"),),
    "3mf": (),
    "vtp": (),
}
"""The packages that read a format: name, sentence, extra."""

_ARRAYS = {
    "points": ("<f8", 3), "faces": ("<i8", 3), "counts": ("<i8", 1), "corners": ("<i8", 1),
    "patches": ("<i4", 1), "bodies": ("<i4", 1), "planes": ("<i4", 1),
    "normals": ("<f8", 3), "viewpoints": ("<f8", 3),
}  # fmt: skip
"""Arrays that the child process returns: type, and numbers in a row."""

_ROWS_LIKE = {
    "patches": "faces",
    "planes": "faces",
    "bodies": "faces",
    "normals": "points",
    "viewpoints": "points",
}
"""Arrays that have as many rows as another one, or none."""

MAX_MESSAGES = 20

_BUFFERS = re.compile(rb'"uri"\s*:\s*"(?!data:)([^"\\]{1,1000})"')


@dataclass(frozen=True, eq=False)
class Foreign:
    """What a file holds: points (n, 3), triangles (m, 3), its unit, and the CAD face of each.

    And the normals (n, 3) of the CAD model, zero at its edges, the flat face of each triangle, and
    the body of the file that it belongs to. Polygons have `counts` (p,) and `corners` instead of
    triangles, and a scan has `viewpoints` (n, 3), NaN where unknown.
    """

    points: FloatArray
    faces: NDArray[np.int64]
    unit: str | None = None
    patches: IntArray | None = None
    normals: FloatArray | None = None
    planes: IntArray | None = None
    bodies: IntArray | None = None
    counts: NDArray[np.int64] | None = None
    corners: NDArray[np.int64] | None = None
    viewpoints: FloatArray | None = None
    messages: tuple[Message, ...] = ()

    @classmethod
    def of_parsed(cls, parsed: ParsedMesh, unit: str | None = None) -> Foreign:
        """Return what one of our own parsers found."""
        return cls(
            parsed.points, np.empty((0, 3), np.int64), unit, normals=parsed.normals,
            counts=parsed.counts, corners=parsed.corners, viewpoints=parsed.viewpoints,
            messages=parsed.messages,
        )  # fmt: skip


def parsed_foreign(kind: str, data: bytes, name: str) -> Foreign:
    """Return what a file of a kind ("step", "3mf", "glb", ...) holds; `name` is its path.

    Raises
    ------
    InvalidShapeError
        When the library is not installed, the file is damaged, or takes more than the limits.
    """
    trimesh = (("trimesh", f".{kind} files are read through trimesh", "io"),)
    for package, what, extra in _INSTALL.get(kind, trimesh):
        if importlib.util.find_spec(package) is None:
            raise InvalidShapeError(
                f'{what}, which is not installed; install it with: pip install "medialis[{extra}]".'
            )
    folder = str(absolute(name).parent)
    size = len(data) + (_size_of_buffers(data, folder) if kind == "gltf" else 0)
    limits = Limits(SECONDS + SECONDS_A_MEGABYTE * size / 1e6, MEMORY + MEMORY_A_BYTE * size)
    head = json.dumps({"kind": kind, "folder": folder}).encode()
    try:
        said = answer_of(CODE, head + b"\n" + data, limits)
    except Ended as ended:
        if ended.slow:
            raise InvalidShapeError(
                f"reading it took more than {limits.seconds:.0f} s of processor time, the limit "
                f"for {size / 1e6:.2g} MB. It is damaged or too intricate: save it as PLY or STL."
            ) from None
        raise InvalidShapeError(
            f"the {_library(kind)} that reads it failed ({ended}): it is damaged, or needs more "
            f"memory than {limits.memory / 1e9:.2g} GB, the limit for its size."
        ) from None
    return _taken(said)


def _library(kind: str) -> str:
    packages = _INSTALL.get(kind, (("trimesh",),))
    return f"library {packages[-1][0]}" if packages else "reader"


def _size_of_buffers(data: bytes, folder: str) -> int:
    """Return the bytes of the files beside a glTF file that it names."""
    size = 0
    for name in {unquote(match.decode("utf-8", "replace")) for match in _BUFFERS.findall(data)}:
        with suppress(OSError, ValueError):
            size += _inside(folder, name).stat().st_size
    return size


def _inside(folder: str, name: str) -> Path:
    """Return the path of a file below a folder, however it is named.

    Raises
    ------
    ValueError
        When it lies elsewhere.
    """
    root = Path(folder).resolve()
    path = (root / name).resolve()
    if not path.is_relative_to(root):
        raise ValueError(f"the buffer {name[:60]!r} lies outside of the folder of the file")
    return path


def _taken(said: bytes) -> Foreign:
    """Return what a process told; it may be in the hands of a hostile file, so it is checked."""
    head, _, rest = said.partition(b"\n")
    told = json.loads(head)
    if "refused" in told:
        raise InvalidShapeError(str(told["refused"])[:1000])
    arrays: dict[str, Any] = {}
    for name, (kind, width) in _ARRAYS.items():
        count = int(told.get(name, 0))
        if count < 0:
            raise InvalidShapeError("its parser failed: it is damaged.")
        length = count * width * np.dtype(kind).itemsize
        rows = np.frombuffer(rest[:length], kind).reshape(count, width)
        arrays[name] = rows if width > 1 else rows[:, 0]
        rest = rest[length:]
    for name, other in _ROWS_LIKE.items():
        if len(arrays[name]) not in (0, len(arrays[other])):
            raise InvalidShapeError("its parser failed: it is damaged.")
        if not len(arrays[name]):
            arrays[name] = None
    if len(arrays["faces"]) or not len(arrays["counts"]):
        arrays["counts"] = arrays["corners"] = None
    elif int(arrays["counts"].sum()) != len(arrays["corners"]) or arrays["counts"].min() < 0:
        raise InvalidShapeError("its parser failed: it is damaged.")
    unit = told["unit"]
    messages = tuple(
        Message(str(text)[:500], str(code)[:50], int(level), **data)
        for text, code, level, data in told.get("messages", ())[:MAX_MESSAGES]
    )
    return Foreign(**arrays, unit=nearest_unit(unit) if unit else None, messages=messages)


def serve() -> None:
    """Read a kind, a folder and a file from the standard input, and tell what is in it."""
    answers = os.fdopen(os.dup(1), "wb")
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)  # libraries print there
    head, _, data = sys.stdin.buffer.read().partition(b"\n")
    told = json.loads(head)
    try:
        _tell(answers, _parsed(told["kind"], data, told["folder"]))
    except MedialisError as error:
        refused = str(error)
    except MemoryError:
        refused = "it needs more memory than is given to a file of its size."
    except RecursionError:
        refused = "it nests too deeply."
    except Exception as error:  # noqa: BLE001 - a parser of others may raise anything
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        refused = f"the {_library(told['kind'])} could not read it ({reason})."
    else:
        refused = ""
    if refused:
        answers.write(json.dumps({"refused": refused}).encode() + b"\n")
    answers.close()
    os._exit(0)  # nothing that a library does at the end is wanted


def _tell(answers: io.BufferedWriter, found: Foreign) -> None:
    arrays = {name: getattr(found, name) for name in _ARRAYS}
    arrays = {name: np.empty(0) if rows is None else rows for name, rows in arrays.items()}
    about: dict[str, Any] = {name: len(rows) for name, rows in arrays.items()}
    about["unit"] = found.unit
    about["messages"] = [(str(m), m.code, m.level, dict(m.data)) for m in found.messages]
    answers.write(json.dumps(about).encode() + b"\n")
    for name, (kind, _) in _ARRAYS.items():
        answers.write(np.ascontiguousarray(arrays[name], kind).data)


def _parsed(kind: str, data: bytes, folder: str) -> Foreign:
    if kind == "step":
        from medialis.formats.step import parse_step

        return Foreign(*parse_step(data))
    if kind == "3mf":
        from medialis.formats.three_mf import parse_three_mf

        points, faces, unit, bodies = parse_three_mf(data)
        return Foreign(points, faces, unit, bodies=bodies)
    if kind == "vtp":
        from medialis.formats.vtk_polydata import parse_vtp

        return Foreign.of_parsed(parse_vtp(data))
    if kind in ("las", "laz"):
        import laspy  # noqa: F401 - loaded before nothing can be opened

        from medialis.formats.scans import parse_las

        guard(folder)
        return Foreign.of_parsed(*parse_las(data))
    if kind == "e57":
        from medialis.formats.scans import parse_e57

        return Foreign.of_parsed(parse_e57(data), "m")
    return _through_trimesh(data, kind, folder)


def _through_trimesh(data: bytes, kind: str, folder: str) -> Foreign:
    """Read by trimesh; a scene becomes one mesh with its transforms applied."""
    import trimesh

    guard(folder)
    more: Mapping[str, Any] = {"skip_materials": True} if kind in ("glb", "gltf") else {}
    loaded: Any = trimesh.load(
        io.BytesIO(data), file_type=kind, process=False, resolver=cast(Any, _Beside(folder)), **more
    )
    bodies = None
    if isinstance(loaded, trimesh.Scene):
        meshes = [mesh for mesh in loaded.dump() if isinstance(mesh, trimesh.Trimesh)]
        bodies = _bodies_of(loaded, meshes)
        loaded = trimesh.util.concatenate(meshes) if meshes else loaded.to_mesh()
    points = np.array(loaded.vertices, np.float64).reshape(-1, 3)
    faces = np.array(getattr(loaded, "faces", np.empty((0, 3))), np.int64).reshape(-1, 3)
    unit = getattr(loaded, "units", None)
    # glTF knows metres alone.
    metres = kind in ("glb", "gltf")
    return Foreign(points, faces, "m" if metres else str(unit) if unit else None, bodies=bodies)


def _bodies_of(scene: Any, meshes: list[Any]) -> IntArray:
    """Return the number of the node that each triangle of the meshes of a scene belongs to.

    A mesh of several materials has a part for each of them, in a node of its own below that of the
    mesh: these are one body.
    """
    numbers: dict[Any, int] = {}
    rows = []
    for k, mesh in enumerate(meshes):
        node = mesh.metadata.get("node", k)
        if mesh.metadata.get("from_gltf_primitive"):
            node = scene.graph.transforms.parents.get(node, node)
        rows.append(np.full(len(mesh.faces), numbers.setdefault(node, len(numbers)), np.int32))
    return np.concatenate(rows) if rows else np.empty(0, np.int32)


class _Beside:
    """Buffers of a glTF file: regular files in its folder, along no link, and nothing else."""

    def __init__(self, folder: str) -> None:
        self._folder = Path(folder)

    def get(self, name: str) -> bytes:
        """Return the content of a file.

        Raises
        ------
        InvalidShapeError
            When it is not there, or no regular file of this folder.
        """
        for one in (name, unquote(name)):
            relative = PurePosixPath(one.strip().replace("\\", "/"))
            if relative.is_absolute() or ".." in relative.parts or not relative.name:
                raise InvalidShapeError(
                    f"the buffer {name[:60]!r} lies outside of the folder of the file"
                )
            with (
                suppress(OSError),
                Folder.at(self._folder / relative.parent, self._folder) as place,
            ):
                if content := place.read(relative.name):
                    return content
        raise InvalidShapeError(
            f"its buffer {name[:60]!r} is not there, empty, or no regular file."
        )

    __getitem__ = get


WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND

_REFUSED = (
    *("socket.", "subprocess.", "shutil.", "urllib.", "ctypes.dlopen", "os.system", "os.exec"),
    *("os.fork", "os.posix_spawn", "os.spawn", "os.remove", "os.rename", "os.rmdir", "os.mkdir"),
    *("os.link", "os.symlink", "os.truncate"),
)


def guard(folder: str) -> None:
    """Open nothing from here on but modules, and files of a folder to read (what Python opens)."""
    import mimetypes

    mimetypes.init()
    sys.dont_write_bytecode = True
    os.chdir(folder)  # names that are looked up in the open folder are told without it
    ours = (sys.prefix, sys.base_prefix, sys.exec_prefix, folder, *filter(None, sys.path))
    roots = tuple(f"{os.path.realpath(place)}{os.sep}" for place in ours)

    def look(event: str, arguments: tuple[Any, ...]) -> None:
        if event.startswith(_REFUSED):
            raise PermissionError(f"a file of others may not do this: {event}")
        if event == "open" and not isinstance(arguments[0], int):
            path, _, flags = arguments
            place = os.path.realpath(os.fsdecode(path))
            if (flags or 0) & WRITING or not f"{place}{os.sep}".startswith(roots):
                raise PermissionError("a file of others may not open files")

    sys.addaudithook(look)
