"""Results for hosts that read files: layers in colours, fields on the rows of the file they wrote.

A host without arrays in Python (the MeshLab plugin) writes the user's layer to a file, runs the
command line on it with ``--host``, and adds what the manifest lists. It must not compute: colours
and the way back from the repaired and refined shape to its own vertices are made here.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.errors import InvalidShapeError
from medialis.files.output_folder import OutputFolder
from medialis.files.ply_attributes import write_ply
from medialis.files.results import write_json
from medialis.model.shape import Shape
from medialis.operations.result import Layer, Result
from medialis.operations.writing import describe_result
from medialis.progress import Progress, ProgressCallback
from medialis.validation import FloatArray

COLOR_NAMES = ("red", "green", "blue", "alpha")


def layer_colors(layer: Layer) -> NDArray[np.uint8] | None:
    """Return the colours in which hosts show a layer: those of its `color_by`.

    Returns
    -------
    (rows, 4) uint8 or None
        sRGB and opacity, one row a point, or a face when `color_by` is an attribute of faces;
        distinct colours where it is one of the layer's `labels`. None when it has no `color_by`
        or that holds vectors.
    """
    if layer.color_by is None:
        return None
    known = {**layer.face_attributes, **layer.attributes}
    values = np.asarray(known[layer.color_by])
    if values.ndim != 1:
        return None
    colors = np.full((len(values), 4), 255, np.uint8)
    colors[:, :3] = np.rint(255 * shown_colors(layer, values))
    return colors


def shown_colors(layer: Layer, values: NDArray[Any]) -> FloatArray:
    """Return the sRGB colours 0..1, (rows, 3), that a layer gives to values of its `color_by`."""
    from medialis.render.colors import label_colors, map_colors

    if layer.color_by in layer.labels:
        return label_colors(values)
    return map_colors(values, layer.color_map, *layer.color_limits)


def on_input_attributes(
    layer: Layer, shape: Shape
) -> tuple[dict[str, NDArray[Any]], dict[str, NDArray[Any]]]:
    """Return the attributes of an `on_input` layer for the vertices and faces before repair.

    Parameters
    ----------
    layer : Layer
        Its rows are the points and faces of `shape`.
    shape : Shape
        As read or made, not refined.

    Returns
    -------
    attributes : dict of (n_in, ...) arrays
    face_attributes : dict of (m_in, ...) arrays
        Vertices and faces that repair dropped have NaN, -1 or (unsigned) 0.

    Raises
    ------
    InvalidShapeError
        When the layer has other rows than the shape.
    """
    if len(layer.points) != shape.point_count:
        raise InvalidShapeError(
            f"Layer {layer.name} has {len(layer.points)} points, the shape {shape.point_count}: "
            "it does not lie on it."
        )
    faces = shape.face_count if shape.diagnosis is None else shape.diagnosis.faces
    return (
        {k: shape.on_input_points(np.asarray(v)) for k, v in layer.attributes.items()},
        {k: shape.on_input_faces(np.asarray(v), faces) for k, v in layer.face_attributes.items()},
    )


def write_for_host(
    result: Result,
    shape: Shape,
    folder: str | os.PathLike[str],
    *,
    source: str | None = None,
    auxiliary: bool = False,
    progress: Progress | ProgressCallback | None = None,
) -> dict[str, Any]:
    """Write the layers of a result and the manifest as a host program adds them.

    Layers have colours: the columns ``red green blue alpha`` of points, or of faces when
    `color_by` is one of their attributes. An `on_input` layer has the vertices and faces of the
    input in their order (see `on_input_attributes`) and no faces of its own: a host that wrote the
    input has them. There are no pictures and no NPZ file; nothing is left when anything fails.

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
    auxiliary : bool
        Write the auxiliary layers (the samples) as well.
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
    chosen = [layer for layer in result.layers if auxiliary or not layer.auxiliary]
    manifest = describe_result(result, input=source)
    manifest["layers"] = [
        {**about, "file": f"{about['name']}.ply"}
        for about in manifest["layers"]
        if auxiliary or not about["auxiliary"]
    ]
    with OutputFolder(folder) as out, progress.stage("write", 0.0, 1.0):
        for number, layer in enumerate(chosen):
            _write_layer(out, layer, shape)
            progress.update((number + 1) / len(chosen))
        write_json(out.file("manifest.json"), manifest)
    return manifest


def _write_layer(out: OutputFolder, layer: Layer, shape: Shape) -> None:
    points, faces = layer.points, layer.faces
    attributes, face_attributes = dict(layer.attributes), dict(layer.face_attributes)
    colors = layer_colors(layer)
    if colors is not None:
        on_faces = layer.color_by not in attributes
        (face_attributes if on_faces else attributes).update(_color_columns(colors))
    if layer.on_input:
        colored = replace(layer, attributes=attributes, face_attributes=face_attributes)
        attributes, face_attributes = on_input_attributes(colored, shape)
        points = shape.on_input_points(points, np.nan)
        faces = None
        if face_attributes:  # PLY hangs the values on faces; their corners mean nothing
            rows = len(next(iter(face_attributes.values())))
            faces = np.zeros((rows, 3), np.int32)
    write_ply(
        out.file(f"{layer.name}.ply"), points, faces, layer.edges, attributes, face_attributes
    )


def _color_columns(colors: NDArray[np.uint8]) -> Mapping[str, NDArray[np.uint8]]:
    return dict(zip(COLOR_NAMES, colors.T, strict=True))
