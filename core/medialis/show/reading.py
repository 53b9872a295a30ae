"""Results read back from the folders that `write_result` makes."""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from medialis.base.errors import FileError, InvalidOptionError, InvalidShapeError
from medialis.base.options import Kind
from medialis.base.progress import Message
from medialis.formats.files import MANIFEST, file_bytes, reading
from medialis.formats.json_npz import read_npz
from medialis.formats.ply_attributes import read_ply_attributes
from medialis.operations.registry import operation
from medialis.operations.result import FilterUnit, Layer
from medialis.shape.shape import Shape
from medialis.show.result import Result


def read_result(folder: str | os.PathLike[str]) -> Result:
    """Read a result from its folder.

    Parameters
    ----------
    folder : path
        From `write_result`, the command line or a batch.

    Returns
    -------
    Result
        With its layers, values, arrays, graph (where JSON was written) and messages, without
        pictures, bones and skin weights.

    Raises
    ------
    FileError
        When there is no result, or a file of it is missing.
    InvalidShapeError
        When a file is damaged.

    See Also
    --------
    write_result : writes the folder.

    Examples
    --------
    >>> import tempfile
    >>> import medialis
    >>> result = medialis.run("thickness", medialis.organic_shape(56))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = medialis.write_result(result, folder, pictures=medialis.Pictures(main=False))
    ...     again = medialis.read_result(folder)
    >>> again.values["thickness_min"] == result.values["thickness_min"]
    True
    """
    base = Path(folder)
    if not (base / MANIFEST).is_file():
        raise FileError(f"{base} holds no result: there is no {MANIFEST} in it.")
    with reading(base / MANIFEST):
        manifest = json.loads(file_bytes(os.fspath(base / MANIFEST)))
        layers = {row["name"]: _layer(base, row) for row in manifest["layers"]}
        name = str(manifest["operation"])
        arrays = read_npz(base / f"{name}.npz")
        return Result(
            shape=_shape(arrays, layers, manifest.get("unit")),
            layers=tuple(layers.values()),
            values=manifest["values"],
            arrays=arrays,
            shown=tuple(layers[other] for other in manifest.get("shown", ())),
            extras=_extras(base, name),
            operation=name,
            parameters=manifest["parameters"],
            seconds=manifest["seconds"],
            messages=tuple(map(_message, manifest["messages"], manifest["notes"])),
        )


def _extras(folder: Path, name: str) -> dict[str, Any]:
    """Read what the operation's own formats give back; nothing where none of them was written."""
    try:
        formats = operation(name).formats
    except InvalidOptionError:  # of another version
        return {}
    files = [(one, folder / f"{name}.{one.name}") for one in formats]
    return {one.of: one.read(file) for one, file in files if one.read and file.is_file()}


def _layer(folder: Path, row: Mapping[str, Any]) -> Layer:
    data = read_ply_attributes(folder / f"{row['name']}.ply")
    unit = row["filter_unit"]
    names = ("name", "color_by", "color_map", "filter_by", "filter_default", "on_input")
    return Layer(
        points=data.points,
        faces=data.faces,
        edges=data.edges,
        attributes=data.attributes,
        face_attributes=data.face_attributes,
        color_limits=tuple(row["color_limits"]),
        labels=tuple(row["labels"]),
        filter_unit=FilterUnit(**{**unit, "kind": Kind(unit["kind"])}),
        auxiliary=row["auxiliary"],
        role=row["role"],
        number_by=row.get("number_by"),
        formats=tuple(row.get("formats", ())),
        facts=row.get("facts", {}),
        **{name: row[name] for name in names},
    )


def _message(text: str, note: Mapping[str, Any]) -> Message:
    level = logging.WARNING if note["warning"] else logging.INFO
    return Message(text, note["code"], level, **note["data"])


def _shape(arrays: Mapping[str, Any], layers: Mapping[str, Layer], unit: str | None) -> Shape:
    """Return the surface as computed on: from the arrays, else the layer that shows it.

    Raises
    ------
    InvalidShapeError
        When neither has it.
    """
    if {"points", "normals"} <= arrays.keys():
        faces = arrays.get("faces")
        return Shape(arrays["points"], arrays["normals"], faces, unit=unit)
    surfaces = [layer for layer in layers.values() if layer.name == "samples" or layer.on_input]
    for layer in [*surfaces, *layers.values()]:
        normals = layer.attributes.get("normal", np.zeros(layer.points.shape))
        return Shape(layer.points, normals, layer.faces, unit=unit)
    raise InvalidShapeError("it holds no points.")
