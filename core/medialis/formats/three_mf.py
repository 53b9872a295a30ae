"""3MF in: a zip archive of XML models, in which objects are meshes, or placed objects.

An object may be placed many times, in objects that are placed many times. What each object holds is
put together once, so that the cost is that of the triangles that come out; how many these are is
known before. It runs in a process of its own (`formats/foreign.py`).

Source: 3MF Core Specification 1.3, Production Extension 1.1 (https://3mf.io/spec).
"""

from __future__ import annotations

import io
import zipfile
from array import array
from collections.abc import Callable
from dataclasses import dataclass, field
from posixpath import normpath
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from medialis.base.errors import InvalidShapeError
from medialis.base.options import METERS, nearest_unit
from medialis.base.validation import FloatArray, IntArray

Faces = NDArray[np.int64]
Name = tuple[str, str]
"""An object: the model that it stands in, and its number there."""

MOST_VERTICES = 2**31 - 1

_MODEL_RELATION = "/3dmodel"


@dataclass(frozen=True)
class _Placed:
    """An object, where it lies: points @ turn + shift."""

    name: Name
    turn: FloatArray
    shift: FloatArray


@dataclass
class _Object:
    """A mesh, or placed objects."""

    corners: array[float] = field(default_factory=lambda: array("d"))
    faces: array[int] = field(default_factory=lambda: array("q"))
    parts: list[_Placed] = field(default_factory=list)


def parse_three_mf(data: bytes) -> tuple[FloatArray, Faces, str, IntArray]:
    """Return points and triangles of all that the build of a 3MF file places, and its unit.

    And the body of each triangle: a mesh object, each time that it is placed.

    Raises
    ------
    InvalidShapeError
        When it is damaged, or names what is not there.
    """
    try:
        package = _Package(zipfile.ZipFile(io.BytesIO(data)))
        root = package.model(package.root())
        whole = _Object(parts=root.build)
        package.count(whole)
        points, faces, bodies = package.assembled(whole)
    except (zipfile.BadZipFile, expat.ExpatError, NotImplementedError, OSError, EOFError) as error:
        raise InvalidShapeError(f"it is damaged ({str(error)[:200]}).") from None
    return points, faces, root.unit, bodies.astype(np.int32)


class _Package:
    """The archive: its models, read when they are first named."""

    def __init__(self, archive: zipfile.ZipFile) -> None:
        self._archive = archive
        self._names = {_plain(name): name for name in archive.namelist()}
        self._models: dict[str, _Model] = {}
        self._counts: dict[Name, int] = {}
        self._meshes: dict[Name, tuple[FloatArray, Faces, Faces]] = {}
        self._scale = 0.0
        self._inside: list[Name] = []

    def root(self) -> str:
        """Return the name of the model that has the build.

        Raises
        ------
        InvalidShapeError
            When there is none.
        """
        found: list[str] = []

        def start(name: str, about: dict[str, str]) -> None:
            if about.get("Type", "").endswith(_MODEL_RELATION):
                found.append(_plain(about.get("Target", "")))

        if "_rels/.rels" in self._names:
            _read_xml(self._archive.read(self._names["_rels/.rels"]), start)
        usual = [name for name in self._names if "3d/3dmodel.model" in name]
        known = [name for name in found + usual if name in self._names]
        if not known:
            raise InvalidShapeError("no model is in this 3MF file.")
        return known[0]

    def model(self, name: str) -> _Model:
        """Return a model; lengths of all are those of the first one."""
        if name not in self._models:
            if name not in self._names:
                raise InvalidShapeError(f"it names the model {name[:60]!r}, which is not there.")
            model = self._models[name] = _Model(name)
            _read_xml(self._archive.read(self._names[name]), model.start)
            meters = METERS[model.unit]
            self._scale = self._scale or meters
            model.scale = meters / self._scale
        return self._models[name]

    def object(self, name: Name) -> _Object:
        """Return an object.

        Raises
        ------
        InvalidShapeError
            When there is none of this name.
        """
        model = self.model(name[0])
        if name[1] not in model.objects:
            raise InvalidShapeError(f"it places object {name[1][:40]!r}, which is not there.")
        return model.objects[name[1]]

    def count(self, thing: _Object) -> int:
        """Return the vertices of an object with all that it places.

        Raises
        ------
        InvalidShapeError
            When it is a part of itself, or has more than can be read.
        """
        total = len(thing.corners) // 3
        for part in thing.parts:
            name = part.name
            if name in self._inside:
                raise InvalidShapeError(f"object {name[1][:40]!r} is a part of itself.")
            if name not in self._counts:
                self._inside.append(name)
                self._counts[name] = self.count(self.object(name))
                self._inside.pop()
            total += self._counts[name]
        if total > MOST_VERTICES:
            raise InvalidShapeError(
                f"its assembly has {total:.3g} vertices; at most {MOST_VERTICES} are supported."
            )
        return total

    def assembled(self, thing: _Object, scale: float = 1.0) -> tuple[FloatArray, Faces, Faces]:
        """Return the mesh of an object with all that it places, in the unit of the first model.

        And the number of the placed mesh that each triangle belongs to.
        """
        points = [np.frombuffer(thing.corners or b"", np.float64).reshape(-1, 3) * scale]
        faces = [_checked(thing, len(points[0]))]
        bodies, count = [np.zeros(len(faces[0]), np.int64)], 1
        start = len(points[0])
        for part in thing.parts:
            name = part.name
            if name not in self._meshes:
                inner = self.model(name[0]).scale
                self._meshes[name] = self.assembled(self.object(name), inner)
            corners, triangles, numbers = self._meshes[name]
            with np.errstate(all="ignore"):
                points.append(corners @ part.turn + part.shift * scale)
                mirrored = np.linalg.det(part.turn) < 0
            faces.append((triangles[:, ::-1] if mirrored else triangles) + start)
            start += len(corners)
            bodies.append(numbers + count)
            count += int(numbers.max(initial=-1)) + 1
        return np.concatenate(points), np.concatenate(faces), np.concatenate(bodies)


class _Model:
    """A model as its elements come: unit, objects, and what its build places."""

    def __init__(self, name: str) -> None:
        self.unit = "mm"
        self.scale = 1.0
        self.objects: dict[str, _Object] = {}
        self.build: list[_Placed] = []
        self._name = name
        self._object = _Object()

    def start(self, name: str, about: dict[str, str]) -> None:
        """Take an element in."""
        kind = name.rpartition(" ")[2]
        if kind == "vertex":
            self._object.corners.extend((float(about["x"]), float(about["y"]), float(about["z"])))
        elif kind == "triangle":
            self._object.faces.extend((int(about["v1"]), int(about["v2"]), int(about["v3"])))
        elif kind == "object":
            self._object = self.objects[about["id"]] = _Object()
        elif kind == "component":
            self._object.parts.append(self._placed(about))
        elif kind == "item":
            self.build.append(self._placed(about))
        elif kind == "model" and "unit" in about:
            unit = nearest_unit(about["unit"])
            if unit is None:
                raise InvalidShapeError(f"its unit {about['unit'][:40]!r} is not known.")
            self.unit = unit

    def _placed(self, about: dict[str, str]) -> _Placed:
        path = next((text for key, text in about.items() if key.endswith(" path")), None)
        numbers = [float(word) for word in about.get("transform", "").split()]
        if len(numbers) not in (0, 12):
            raise InvalidShapeError(f"a transform has {len(numbers)} numbers, not 12.")
        rows = np.array(numbers).reshape(4, 3) if numbers else np.eye(4, 3)
        where = self._name if path is None else _plain(path)
        return _Placed((where, about["objectid"]), rows[:3], rows[3])


def _checked(thing: _Object, count: int) -> Faces:
    """Return the triangles of a mesh; a corner that is no vertex would be one of the next object.

    Raises
    ------
    InvalidShapeError
    """
    faces = np.frombuffer(thing.faces or b"", np.int64).reshape(-1, 3)
    if faces.size and not 0 <= faces.min() <= faces.max() < count:
        raise InvalidShapeError(f"triangles name vertices beyond the {count} of their object.")
    return faces


def _plain(name: str) -> str:
    """Return the name of a part as the standard compares it: no capitals, no slash before it."""
    return normpath(name.replace("\\", "/").lower()).lstrip("/")


def _read_xml(text: bytes, start: Callable[[str, dict[str, str]], None]) -> None:
    """Give `start` each element; the names of entities, which can grow, are not part of 3MF."""
    parser = expat.ParserCreate(namespace_separator=" ")

    def refuse(*about: object) -> None:
        raise InvalidShapeError("its XML defines a document type, which 3MF forbids.")

    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler = start
    parser.Parse(text, True)
