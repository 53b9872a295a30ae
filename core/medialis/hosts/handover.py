"""Results for hosts that read files: layers in colours, fields on the rows of the file they wrote.

A host without arrays in Python (the MeshLab plugin) writes the user's layer to a file, runs the
command line on it with ``--host``, and adds what the manifest lists. It must not compute: colours
and the way back from the repaired and refined shape to its own vertices are made here.
"""

from __future__ import annotations

import os
from dataclasses import replace
from typing import Any

import numpy as np

from medialis.files.output_folder import OutputFolder
from medialis.files.ply_attributes import write_ply
from medialis.files.results import write_json
from medialis.hosts.fields import on_input
from medialis.hosts.menu import SELECTED, filter_of, host_layers
from medialis.hosts.shown import shown
from medialis.model.shape import Shape
from medialis.operations.registry import operation
from medialis.operations.result import Layer, Result
from medialis.operations.writing import describe_result
from medialis.progress import Progress, ProgressCallback
from medialis.threads import run_patiently

COLOR_NAMES = ("red", "green", "blue", "alpha")


def write_for_host(
    result: Result,
    shape: Shape,
    folder: str | os.PathLike[str],
    *,
    source: str | None = None,
    selects: bool = False,
    auxiliary: bool = False,
    draw_solid: bool = False,
    progress: Progress | ProgressCallback | None = None,
) -> dict[str, Any]:
    """Write the layers of a result and the manifest as a host program adds them.

    Layers have colours: the columns ``red green blue alpha`` of points, or of faces when
    `color_by` is one of their attributes. An `on_input` layer has the vertices and faces of the
    input in their order (see `on_input`) and no faces of its own: a host that wrote the input has
    them. Which layers there are is said by `host_layers`. There are no pictures and no NPZ file;
    nothing is left when anything fails.

    Parameters
    ----------
    result : Result
        From `medialis.run`.
    shape : Shape
        What it was run on, as read.
    folder : path
        Created when missing.
    source : str, optional
        Name of the input, for the manifest.
    selects : bool
        Write the selection that the operation tells, and nothing else.
    auxiliary, draw_solid : bool
        As for `host_layers`.
    progress : callable, optional
        Called with (fraction, text); returning False cancels.

    Returns
    -------
    dict
        The manifest; each of its layers has its "file" in the folder.

    Raises
    ------
    FileError
        When the folder cannot be written.
    """
    progress = Progress.of(progress)
    entry = filter_of(operation(result.operation), selects=selects)
    chosen = host_layers(result, shape, entry, auxiliary=auxiliary, draw_solid=draw_solid)
    manifest = describe_result(replace(result, layers=chosen), input=source)
    if selects:
        manifest["values"] = {SELECTED: int(chosen[0].attributes[SELECTED].sum())}
    manifest["layers"] = [{**about, "file": f"{about['name']}.ply"} for about in manifest["layers"]]
    with OutputFolder(folder) as out, progress.stage("write", 0.0, 1.0):
        for number, layer in enumerate(chosen):
            _write_layer(out, layer, shape, progress)
            progress.update((number + 1) / len(chosen))
        write_json(out.file("manifest.json"), manifest)
    return manifest


def _write_layer(out: OutputFolder, layer: Layer, shape: Shape, progress: Progress) -> None:
    points, faces, attributes, face_attributes = run_patiently(
        lambda: _columns(layer, shape), progress
    )
    file = out.file(f"{layer.name}.ply")
    write_ply(file, points, faces, layer.edges, attributes, face_attributes)


def _columns(layer: Layer, shape: Shape) -> tuple[Any, Any, dict[str, Any], dict[str, Any]]:
    """Return points, faces and the attributes of both, colours with them, of a layer's file."""
    points, faces = layer.points, layer.faces
    attributes, face_attributes = dict(layer.attributes), dict(layer.face_attributes)
    if layer.on_input:
        fields = on_input(layer, shape)
        attributes, face_attributes = dict(fields.attributes), dict(fields.face_attributes)
        points = shape.on_input_points(points, np.nan)
        faces = None
        if face_attributes:  # PLY hangs the values on faces; their corners mean nothing
            rows = len(next(iter(face_attributes.values())))
            faces = np.zeros((rows, 3), np.int32)
    first = shown(layer, attributes, face_attributes)
    if first is not None:
        columns = zip(COLOR_NAMES, first.rgba_bytes.T, strict=True)
        (face_attributes if first.on_faces else attributes).update(columns)
    return points, faces, attributes, face_attributes
