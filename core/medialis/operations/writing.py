"""Writing results: PLY layers, NPZ arrays, PNG pictures and a JSON manifest, all or nothing."""

from __future__ import annotations

import hashlib
import logging
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.errors import InvalidOptionError
from medialis.files._files import complete_file
from medialis.files.abaqus import CALCULIX, write_inp
from medialis.files.curve_graphs import write_curve_skeleton
from medialis.files.layer_files import Content, write_content
from medialis.files.msh import write_msh
from medialis.files.output_folder import MANIFEST, OutputFolder
from medialis.files.ply_attributes import write_ply
from medialis.files.results import write_json, write_npz
from medialis.files.rigged_gltf import write_rigged_gltf
from medialis.files.vtp import write_vtp
from medialis.files.vtu import write_vtu
from medialis.model.shape import Shape
from medialis.model.surface import Surface
from medialis.operations.declaration import GRAPH_FORMATS, LAYER_FORMATS, SHELL_FORMATS
from medialis.operations.existing_results import (
    check_free,
    check_same,
    files_of,
    manifest_in,
    parameters_given,
)
from medialis.operations.pictures import draw_result, draw_turntable, require_attribute
from medialis.operations.result import Layer, Result
from medialis.progress import Message, Progress, ProgressCallback
from medialis.render.png import reduced, write_png
from medialis.render.shading import Style
from medialis.validation import as_choice
from medialis.version import package_version

WIDTH, HEIGHT = 2000, 1500
"""Pixels of the main picture before what is empty is cut off."""

_LAYER_WRITERS: dict[str, tuple[str, Callable[..., None]]] = {
    "vtp": (".vtp", write_vtp),
    "vtu": (".vtu", write_vtu),
    "msh": (".msh", write_msh),
    "inp": (".inp", write_inp),
    "ccx": (CALCULIX, write_inp),
}
"""Endings and writers of the formats of layers."""

THUMBNAIL, THUMBNAIL_WIDTH = "thumbnail.png", 250


def describe_result(result: Result, **more: Any) -> dict[str, Any]:
    """Return the manifest: operation, parameters, seconds per stage, values, messages."""
    return {
        "medialis": package_version(),
        "operation": result.operation,
        "parameters": dict(result.parameters),
        "lengths": lengths_given(result.messages),
        "unit": result.shape.unit,
        "shape": shape_checksum(result.shape),
        "seconds": dict(result.seconds),
        "values": dict(result.values),
        "messages": [str(message) for message in result.messages],
        "notes": [_note(message) for message in result.messages],
        "layers": [
            {
                "name": layer.name,
                "points": len(layer.points),
                "faces": 0 if layer.faces is None else len(layer.faces),
                "edges": 0 if layer.edges is None else len(layer.edges),
                "attributes": list(layer.attributes),
                "face_attributes": list(layer.face_attributes),
                "labels": list(layer.labels),
                "color_by": layer.color_by,
                "color_map": layer.color_map,
                "color_limits": list(layer.color_limits),
                "filter_by": layer.filter_by,
                "filter_unit": asdict(layer.filter_unit),
                "filter_default": layer.filter_default,
                "number_by": layer.number_by,
                "on_input": layer.on_input,
                "auxiliary": layer.auxiliary,
                "role": layer.role,
                "formats": list(layer.formats),
                "facts": dict(layer.facts),
            }
            for layer in result.layers
        ],
        "shown": [layer.name for layer in result.shown],
        **more,
    }


def shape_checksum(shape: Shape) -> str:
    """Return a checksum of a shape as computed on, by which results of others are told."""
    known = shape.identity
    return known.hex() if isinstance(known, bytes) else ""


def lengths_given(messages: Sequence[str]) -> dict[str, str]:
    """Return the lengths that were given with a unit, as text, by the name of their option."""
    notes = [m.data for m in messages if isinstance(m, Message) and m.code == "length"]
    return {str(data["option"]): str(data["given"]) for data in notes}


def _note(message: str) -> dict[str, Any]:
    """Return what programs read of a message: its code, counts, and whether it is a warning."""
    if not isinstance(message, Message):
        message = Message(message)
    warning = message.level >= logging.WARNING
    return {"code": message.code, "warning": warning, "data": dict(message.data)}


@dataclass(frozen=True)
class Pictures:
    """Which pictures of a result are written.

    Attributes
    ----------
    main : bool
        Draw ``<operation>.png`` (the result's own images are written in any case).
    color_by : str or None
        Attribute to colour by; the layer's own choice when None.
    turntable : int
        Number of turntable views.
    thumbnail : bool
        Write the main picture also small, as ``thumbnail.png``.
    """

    main: bool = True
    color_by: str | None = None
    turntable: int = 0
    thumbnail: bool = False


@dataclass(frozen=True)
class Written:
    """What is written of a result.

    Attributes
    ----------
    source : str or None
        Name of the input.
    pictures : Pictures
    formats : sequence of str
        Of the result's graph, and of each layer besides PLY.
    texts : dict
        More files: their text by name.
    record : dict
        More entries for the manifest.
    overwrite : bool
        Replace what is there.
    """

    source: str | None = None
    pictures: Pictures = Pictures()
    formats: Sequence[str] = GRAPH_FORMATS
    texts: Mapping[str, str] = field(default_factory=dict)
    record: Mapping[str, Any] = field(default_factory=dict)
    overwrite: bool = False


def write_result(
    result: Result,
    folder: str | os.PathLike[str],
    *,
    source: str | None = None,
    pictures: Pictures = Pictures(),
    formats: Sequence[str] = GRAPH_FORMATS,
    overwrite: bool = False,
    progress: Progress | ProgressCallback | None = None,
) -> dict[str, Any]:
    """Write a result into a folder; when anything fails nothing is left behind.

    Parameters
    ----------
    result : Result
        From `medialis.run`.
    folder : path
        Created when missing. It may hold the same result, which is replaced.
    source : str, optional
        Name of the input, for titles and the manifest.
    pictures : Pictures
        Which pictures to draw.
    formats : sequence of str
        Formats of the result's graph, if it has one: swc, graphml, json, obj; and of its
        layers: vtp and vtu, each with its attributes for ParaView; msh (Gmsh), inp (Abaqus) and
        ccx (CalculiX), those with triangles as shell elements.
    overwrite : bool
        Replace another result, with all its files, and other files of the same names.
    progress : callable, optional
        Called with (fraction, text); returning False cancels.

    Returns
    -------
    dict
        The manifest, with "files": the paths written, "contents": bytes and sha256 of each file by
        its name, and "picture": the main one or None.

    Raises
    ------
    InvalidOptionError
        When the first layer has no attribute ``pictures.color_by``, or a format is unknown, or
        is one of shell elements and no layer has triangles.
    FileError
        When the folder cannot be written, or holds something else and `overwrite` is False.

    See Also
    --------
    run : makes results.
    draw_result : the picture alone.

    Examples
    --------
    >>> import tempfile
    >>> import medialis
    >>> result = medialis.run("thickness", medialis.organic_shape(56))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     manifest = medialis.write_result(result, f"{folder}/out")
    >>> manifest["operation"], manifest["picture"].endswith("thickness.png")
    ('thickness', True)
    """
    wanted = Written(source, pictures, formats, overwrite=overwrite)
    return write_files(result, folder, wanted, Progress.of(progress))


def write_files(
    result: Result, folder: str | os.PathLike[str], wanted: Written, progress: Progress
) -> dict[str, Any]:
    """Write what is wanted of a result; see `write_result`."""
    pictures = wanted.pictures
    if pictures.color_by is not None:
        require_attribute(result.layers, pictures.color_by)
    for ending in wanted.formats:
        as_choice(ending, "formats", GRAPH_FORMATS + LAYER_FORMATS)
        if ending in SHELL_FORMATS and all(layer.faces is None for layer in result.layers):
            raise InvalidOptionError(
                f"The result of {result.operation} has no triangles that could be shell elements "
                f"({ending}); vtu holds all it has."
            )
    about = describe_result(result, input=wanted.source, **wanted.record)
    if not wanted.overwrite:
        check_same(folder, {**about, "parameters": parameters_given(about)})
    drawn: list[str] = []
    with OutputFolder(folder, replaced=files_of(manifest_in(folder))) as out:
        names = _write_data(out, result, wanted.formats, progress)

        def new(name: str) -> Path:
            names.append(name)
            return out.file(name)

        with progress.stage("picture", 0.5, 0.95):
            title = _title(result, wanted.source)
            for name, image in _main_pictures(result, pictures, title, progress.unnamed):
                drawn.append(name)
                write_png(new(name), image)
                if pictures.thumbnail and drawn == [name]:
                    write_png(new(THUMBNAIL), reduced(image, THUMBNAIL_WIDTH))
            count, color_by = pictures.turntable, pictures.color_by
            views = draw_turntable(result, count, color_by=color_by, progress=progress.unnamed)
            for number, image in enumerate(views if count else ()):
                write_png(new(f"turntable_{number:03d}.png"), image)
        for name, text in wanted.texts.items():
            with complete_file(new(name)) as stream:
                stream.write(text.encode("utf-8", "backslashreplace"))  # as in write_json
        with progress.stage("check", 0.95, 1.0):
            contents = {name: content(out.file(name), progress) for name in names}
        names.append(MANIFEST)
        if not wanted.overwrite:
            check_free(folder, names)
        base = Path(folder)
        manifest = about | {
            "files": [str(base / name) for name in names],
            "contents": contents,
            "picture": str(base / drawn[0]) if drawn else None,
        }
        write_json(out.file(MANIFEST), manifest)
    return manifest


def _title(result: Result, source: str | None) -> str:
    return result.operation.replace("_", " ") + (f" of {Path(source).name}" if source else "")


def _write_data(
    out: OutputFolder, result: Result, formats: Sequence[str], progress: Progress
) -> list[str]:
    """Write layers, graph and arrays; return the names of the files."""
    names: list[str] = []

    def new(name: str) -> Path:
        names.append(name)
        return out.file(name)

    with progress.stage("write", 0.0, 0.5):
        for number, layer in enumerate(result.layers):
            write_ply(
                new(f"{layer.name}.ply"),
                layer.points,
                faces=layer.faces,
                edges=layer.edges,
                attributes=layer.attributes,
                face_attributes=layer.face_attributes,
            )
            for name in filter(LAYER_FORMATS.__contains__, formats):
                if name not in SHELL_FORMATS or layer.faces is not None:
                    ending, write = _LAYER_WRITERS[name]
                    write(
                        new(layer.name + ending), layer.points, layer.faces, layer.edges,
                        layer.attributes, layer.face_attributes, show=layer.color_by,
                    )  # fmt: skip
            for ending in layer.formats:
                write_content(new(f"{layer.name}.{ending}"), content_of(layer, result.shape.unit))
            progress.update((number + 1) / (len(result.layers) + 1))
        graph = result.graph if result.rig is None else result.rig.graph
        if graph is not None:
            for ending in filter(GRAPH_FORMATS.__contains__, formats):
                write_curve_skeleton(new(f"{result.operation}.{ending}"), graph)
        if result.skin is not None and result.skin.rig is not None:
            file, unit = new(f"{result.operation}.glb"), result.shape.unit
            count = len(result.skin.bones)  # a refined shape has the given points first
            given = next(layer for layer in result.layers if layer.role == "skin")
            write_rigged_gltf(
                file, Surface(given.points, given.faces), result.shape.normals[:count], result.skin,
                unit=unit,
            )  # fmt: skip
        write_npz(new(f"{result.operation}.npz"), result.arrays)
    return names


def content_of(layer: Layer, unit: str | None) -> Content:
    """Return what files of a layer are made of."""
    return Content(layer.points, layer.faces, layer.edges, layer.attributes, layer.facts, unit)


def content(file: Path, progress: Progress) -> dict[str, Any]:
    """Return the size and the checksum of a file, by which a manifest knows its own.

    Raises
    ------
    OSError
        When it cannot be read.
    """
    checksum, size = hashlib.sha256(), 0
    with file.open("rb") as stream:
        while part := stream.read(1 << 24):
            checksum.update(part)
            size += len(part)
            progress.update(0.0)
    return {"bytes": size, "sha256": checksum.hexdigest()}


def _main_pictures(
    result: Result, pictures: Pictures, title: str, progress: Progress
) -> Iterator[tuple[str, NDArray[np.uint8]]]:
    """Give file names and images: the result's own ones, or one of its first layer if wanted."""
    for name, image in result.images.items():
        yield f"{name}.png", image
    if pictures.main and result.layers and not result.images:
        image = draw_result(
            result,
            color_by=pictures.color_by,
            width=WIDTH,
            height=HEIGHT,
            title=title,
            style=Style(background=None, crop=True),
            progress=progress,
        )
        yield f"{result.operation}.png", image
