"""Read scans: LAS and LAZ through laspy and lazrs, E57 through pye57.

Coordinates are float64 as the file stores them, however far they are from the origin. Points that
the file marks as deleted or invalid are left out. This runs in the child process that `foreign.py`
starts.

Sources: LAS Specification 1.4 R15 (ASPRS), ASTM E2807 (E57).
"""

from __future__ import annotations

import io
import math
import os
import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from medialis.base.errors import InvalidShapeError
from medialis.base.options import METERS
from medialis.base.progress import Message, counted
from medialis.base.validation import FloatArray
from medialis.formats.files import ParsedMesh, no_polygons

CHUNK_POINTS = 1_000_000

UNIT_TOLERANCE = 1e-5
"""Relative difference of two units that count as one: the US survey foot is 2e-6 longer."""

_LINEAR_UNIT, _VERTICAL_UNIT, _MODEL = 3076, 4099, 1024
"""GeoTIFF keys: unit of x and y, unit of z, kind of coordinate system."""

_GEOGRAPHIC = 2
_EPSG_UNITS = {9001: 1.0, 9002: 0.3048, 9003: 1200.0 / 3937.0, 9036: 1000.0}
"""Metres in a unit, by its EPSG code: metre, foot, US survey foot, kilometre."""

_E57_FIELDS = {
    "cartesian": ("cartesianX", "cartesianY", "cartesianZ"),
    "spherical": ("sphericalRange", "sphericalAzimuth", "sphericalElevation"),
}

_WKT_TOKEN = re.compile(r'(\w+)\s*[\[(]|"(?:[^"]|"")*"|[\])]|[^\s,\[\]()"]+')
_PROJECTED = {"PROJCS", "PROJCRS", "GEOCCS", "LOCAL_CS", "ENGCRS"}
_VERTICAL = {"VERT_CS", "VERTCRS"}


def parse_las(data: bytes) -> tuple[ParsedMesh, str | None]:
    """Return the points of a LAS or LAZ file, and the unit that its coordinate system states.

    Points marked as withheld are left out.

    Raises
    ------
    InvalidShapeError
        If the file has fewer points than its header announces.
    """
    import laspy

    chunks, withheld, total = [], 0, 0
    with laspy.open(io.BytesIO(data), laz_backend=laspy.LazBackend.Lazrs) as reader:
        announced = reader.header.point_count
        factors = _length_factors([*reader.header.vlrs, *(reader.header.evlrs or ())])
        while total < announced:
            record = reader.read_points(min(CHUNK_POINTS, announced - total))
            if len(record) == 0:
                break
            total += len(record)
            kept = ~np.asarray(record.withheld, bool)
            withheld += int(len(kept) - kept.sum())
            columns = (np.asarray(column, np.float64) for column in (record.x, record.y, record.z))
            chunks.append(np.stack([column[kept] for column in columns], axis=1))
    if total < announced:
        raise InvalidShapeError(
            f"it is truncated: its header announces {announced} points, but it has {total}."
        )
    unit, messages = _unit_of(*factors)
    if withheld:
        text = f"Left out {counted(withheld, 'point', of=total)}, marked as withheld."
        messages += (Message(text, "points_withheld", points=withheld, of=total),)
    points = np.concatenate(chunks) if chunks else np.empty((0, 3))
    return ParsedMesh(points, *no_polygons(), messages=messages), unit


def _length_factors(records: list[Any]) -> tuple[float | None, float | None]:
    """Return metres in a unit of x and y, and of z; None if unknown, 0 for degrees.

    `records` are the variable length records of a file; well-known text wins over GeoTIFF keys.
    """
    horizontal: float | None = None
    vertical: float | None = None
    for record in records:
        if record.user_id != "LASF_Projection":
            continue
        if record.record_id == 2112:
            return wkt_length_factors(record.string)
        if record.record_id == 34735:
            keys = {key.id: key.value_offset for key in record.geo_keys}
            horizontal = _EPSG_UNITS.get(keys.get(_LINEAR_UNIT, -1))
            vertical = _EPSG_UNITS.get(keys.get(_VERTICAL_UNIT, -1))
            if keys.get(_MODEL) == _GEOGRAPHIC:
                horizontal = 0.0
    return horizontal, vertical


def wkt_length_factors(text: str) -> tuple[float | None, float | None]:
    """Return metres in a unit of x and y, and of z, by the well-known text of a coordinate system.

    None if the text does not state it; 0 for longitudes and latitudes in degrees.

    Examples
    --------
    >>> wkt_length_factors('PROJCS["a",GEOGCS["b",UNIT["degree",0.017]],UNIT["metre",1]]')
    (1.0, None)
    >>> wkt_length_factors('COMPD_CS["c",GEOGCS["b",UNIT["d",0.017]],VERT_CS["h",UNIT["ft",0.3]]]')
    (0.0, 0.3)
    """
    inside: list[str] = []
    values: list[list[str]] = []
    horizontal: float | None = None
    vertical: float | None = None
    systems = set()
    for token in _WKT_TOKEN.finditer(text):
        if token[1]:
            inside.append(token[1].upper())
            values.append([])
            systems.add(inside[-1])
        elif token[0] in ")]":
            if not inside:
                break
            kind, own = inside.pop(), values.pop()
            within = next((name for name in inside[::-1] if name != "AXIS"), "")
            if kind in ("UNIT", "LENGTHUNIT") and len(own) > 1:
                factor = _number(own[1])
                if within in _PROJECTED:
                    horizontal = factor
                elif within in _VERTICAL:
                    vertical = factor
        elif values:
            values[-1].append(token[0])
    if horizontal is None and systems & {"GEOGCS", "GEOGCRS"} and not systems & _PROJECTED:
        horizontal = 0.0
    return horizontal, vertical


def _number(word: str) -> float | None:
    try:
        value = float(word)
    except ValueError:
        return None
    return value if math.isfinite(value) and value > 0.0 else None


def _unit_of(
    horizontal: float | None, vertical: float | None
) -> tuple[str | None, tuple[Message, ...]]:
    """Return the unit of x, y and z, and a warning where they have none in common."""
    if horizontal == 0.0:
        text = (
            "The coordinates are longitudes and latitudes in degrees: lengths, areas and volumes "
            "mean nothing. Project them first, for example to UTM."
        )
        return None, (Message(text, "geographic_coordinates"),)
    if horizontal is None:
        return None, ()
    if vertical is not None and abs(vertical - horizontal) > UNIT_TOLERANCE * horizontal:
        text = (
            f"Heights are in units of {vertical:g} m, x and y in units of {horizontal:g} m: "
            "lengths, areas and volumes mean nothing. Convert the file to one unit first."
        )
        return None, (Message(text, "mixed_units", horizontal=horizontal, vertical=vertical),)
    matches = (u for u, m in METERS.items() if abs(m - horizontal) <= UNIT_TOLERANCE * m)
    return next(matches, None), ()


def parse_e57(data: bytes) -> ParsedMesh:
    """Return the points of all scans of an E57 file in metres, placed by the pose of each scan.

    The position of a scanner is the viewpoint of its points, NaN where the scan has no pose.
    Points marked as invalid are left out.

    Raises
    ------
    InvalidShapeError
        If a scan has neither cartesian nor spherical coordinates.
    """
    from pye57 import libe57

    with _file_on_disk(data) as path:
        image = libe57.ImageFile(path, "r")
        try:
            root = image.root()
            scans = root["data3D"] if root.isDefined("data3D") else ()
            parts = [_scan(libe57, image, scans[row]) for row in range(len(scans))]
        finally:
            image.close()
    points = np.concatenate([np.empty((0, 3)), *(part for part, _, _ in parts)])
    invalid, total = sum(count for _, _, count in parts), len(points)
    messages: tuple[Message, ...] = ()
    if invalid:
        text = f"Left out {counted(invalid, 'point', of=total + invalid)}, marked as invalid."
        messages += (Message(text, "points_invalid", points=invalid, of=total + invalid),)
    if len(parts) > 1:
        text = f"Joined {len(parts)} scans."
        messages += (Message(text, "scans_joined", scans=len(parts)),)
    places = np.array([place for _, place, _ in parts]).reshape(-1, 3)
    viewpoints = np.repeat(places, [len(part) for part, _, _ in parts], axis=0)
    known = None if np.isnan(places).all() else viewpoints
    return ParsedMesh(points, *no_polygons(), None, messages, known)


def _scan(libe57: Any, image: Any, scan: Any) -> tuple[FloatArray, FloatArray, int]:
    """Return the points of a scan, its scanner's position, and the number of invalid points."""
    vector = scan["points"]
    prototype = libe57.StructureNode(vector.prototype())
    fields = [prototype.get(row).elementName() for row in range(prototype.childCount())]
    kind = next((one for one in _E57_FIELDS if set(_E57_FIELDS[one]) <= set(fields)), "")
    if not kind:
        raise InvalidShapeError(
            f"one of its scans has no coordinates; it has {', '.join(fields)[:200]}."
        )
    names = _E57_FIELDS[kind]
    state = f"{kind}InvalidState"
    read = [*names, state] if state in fields else [*names]
    size = max(1, min(CHUNK_POINTS, vector.childCount()))
    columns = {name: np.empty(size, "b" if name == state else np.float64) for name in read}
    buffers = libe57.VectorSourceDestBuffer()
    for name, column in columns.items():
        buffers.append(libe57.SourceDestBuffer(image, name, column, size, True, True))
    reader, chunks, invalid = vector.reader(buffers), [], 0
    try:
        while count := reader.read():
            rows = np.stack([columns[name][:count] for name in names], axis=1)
            if state in columns:
                valid = columns[state][:count] == 0
                invalid += int(count - valid.sum())
                rows = rows[valid]
            chunks.append(rows if kind == "cartesian" else _from_spherical(rows))
    finally:
        reader.close()
    points = np.concatenate([np.empty((0, 3)), *chunks])
    turn, place = _pose(scan)
    if not np.array_equal(turn, np.eye(3)):
        points = points @ turn.T
    known = place.any() or not np.array_equal(turn, np.eye(3))
    return points + place, place if known else np.full(3, np.nan), invalid


def _from_spherical(rows: FloatArray) -> FloatArray:
    """Return x, y, z for rows of range, azimuth and elevation (radians)."""
    distance, azimuth, elevation = rows.T
    across = distance * np.cos(elevation)
    parts = across * np.cos(azimuth), across * np.sin(azimuth), distance * np.sin(elevation)
    return np.stack(parts, axis=1)


def _pose(scan: Any) -> tuple[FloatArray, FloatArray]:
    """Return the rotation (3, 3) and the position (3,) of a scan; the identity if it has none."""
    turn, place = np.eye(3), np.zeros(3)
    if not scan.isDefined("pose"):
        return turn, place
    pose = scan["pose"]
    if pose.isDefined("translation"):
        place = np.array([pose["translation"][axis].value() for axis in "xyz"], np.float64)
    if pose.isDefined("rotation"):
        w, x, y, z = (float(pose["rotation"][axis].value()) for axis in "wxyz")
        length = math.sqrt(w * w + x * x + y * y + z * z)
        if not (math.isfinite(length) and length > 0.0):
            raise InvalidShapeError("the rotation of one of its scans is not a quaternion.")
        w, x, y, z = w / length, x / length, y / length, z / length
        turn = np.array([
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ])  # fmt: skip
    if not np.isfinite(place).all():
        raise InvalidShapeError("the position of one of its scans is not finite.")
    return turn, place


@contextmanager
def _file_on_disk(data: bytes) -> Iterator[str]:
    """Give the path of a file with this content, in memory where the system can (Linux)."""
    if hasattr(os, "memfd_create"):
        with os.fdopen(os.memfd_create("e57"), "wb") as stream:
            stream.write(data)
            stream.flush()
            yield f"/proc/self/fd/{stream.fileno()}"
        return
    with tempfile.TemporaryDirectory(prefix="medialis-") as folder:
        path = Path(folder, "scan.e57")
        path.write_bytes(data)
        yield str(path)
