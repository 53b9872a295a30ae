"""Operations as the filters of a host with menus and dialogs, and results for hosts of files.

A filter is an operation under its name, or the selection that it tells. `menu_entries` describes
all of them as plain data, from which the MeshLab plugin makes its menu and its dialogs;
`write_notes` writes them beside it.

A host without arrays in Python (the MeshLab plugin) writes the user's layer to a file, runs the
command line on it with ``--host``, and adds what the manifest lists. It must not compute: layers
are in colours, and fields on the rows of the file that it wrote, not on the repaired and refined
shape.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from medialis.base.options import AUTO, Kind, Options, Parameter
from medialis.base.progress import Progress, ProgressCallback
from medialis.base.threads import run_patiently
from medialis.base.version import package_version
from medialis.formats.files import write_text
from medialis.formats.json_npz import json_text, write_json
from medialis.formats.output_folder import OutputFolder
from medialis.formats.ply_attributes import write_ply
from medialis.hosts.drawing import hidden_apart, shown, solid
from medialis.hosts.fields import on_input
from medialis.operations import registry
from medialis.operations.declaration import Operation, Selection
from medialis.operations.registry import operation
from medialis.operations.result import Layer, Result
from medialis.shape.shape import Shape
from medialis.show.writing import describe_result

LOWER_CASE = ("by", "of", "per", "with", "from", "to", "on", "the", "without")
SELECTED = "selected"

PROGRAM_NOTE = "medialis-program.txt"
"""File beside the MeshLab plugin: the interpreter that has medialis, one line."""

FILTER_NOTE = "medialis-filters.json"
"""File beside it: its menu and its dialogs, and the medialis that they are of."""

HIDE_SOURCE = Parameter(
    "hide_source",
    Kind.BOOL,
    True,
    "Hide the shape",
    "Hide the layer that was computed from, so that the new one inside it can be seen.",
)
SOLID = Parameter(
    "solid",
    Kind.BOOL,
    True,
    "Tubes and balls",
    "Draw curves as tubes, thicker where the radius is larger, and marked places as balls. Off: "
    "edges and points, which scripts can read on.",
)
USE_SELECTION = Parameter(
    "use_selection",
    Kind.BOOL,
    True,
    "Selected vertices",
    "Take the vertices that are selected in the layer, where some are.",
)
AUXILIARY = Parameter(
    "auxiliary_layers",
    Kind.BOOL,
    False,
    "Add the samples",
    "Also add what results only refer to, such as the surface as it was computed on: numbers of "
    "feature points and sources are rows of it.",
    advanced=True,
)


@dataclass(frozen=True)
class Filter:
    """An operation as one entry of a menu.

    Attributes
    ----------
    name : str
        As MeshLab's filters are called in Python: verb first.
    operation : Operation
    selection : Selection or None
        It selects vertices and adds nothing.
    """

    name: str
    operation: Operation
    selection: Selection | None = None

    @property
    def selects(self) -> bool:
        """Whether it selects vertices and adds nothing."""
        return self.selection is not None

    @property
    def generates(self) -> bool:
        """Whether it adds layers; what it knows of the given one are attributes, no colours."""
        return self.name.startswith("generate_")

    @property
    def title(self) -> str:
        """The entry in the menu.

        Examples
        --------
        >>> from medialis.operations.registry import operation
        >>> Filter("generate_surface_skeleton", operation("surface_skeleton")).title
        'Generate Medial Surface Skeleton'
        """
        verb, *words = self.name.split("_")
        if "medial" not in words:
            words.insert(0, "medial")
        return " ".join(w if w in LOWER_CASE else w.capitalize() for w in (verb, *words))

    @property
    def help(self) -> str:
        """What it does, and where that is from."""
        full, first = self.operation.full_help, self.operation.help.split("\n\n")[0]
        return full.replace(first, self.selection.help, 1) if self.selection else full

    @property
    def defaults(self) -> Mapping[str, Any]:
        """Defaults of its own."""
        return self.selection.defaults if self.selection else {}

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters of the operation, as this filter has them."""
        own = self.operation.parameters
        return tuple(replace(p, default=self.defaults.get(p.name, p.default)) for p in own)

    @property
    def host_parameters(self) -> tuple[Parameter, ...]:
        """What only a host can do, where it means something; off in scripts."""
        chosen = self.operation
        if self.selection:
            return ()
        wanted = {
            USE_SELECTION: any(p.selection for p in chosen.parameters),
            HIDE_SOURCE: self.generates and not chosen.lies_on_shape,
            SOLID: chosen.thin_lines,
            AUXILIARY: True,
        }
        return tuple(parameter for parameter, means in wanted.items() if means)

    def resolve(self, given: Mapping[str, Any]) -> Options:
        """Return all options, those given checked."""
        return self.operation.resolve({**self.defaults, **given})


def filters() -> tuple[Filter, ...]:
    """Return all filters in the order in which hosts list operations."""
    return tuple(
        Filter(own.filter_name, chosen, own if own is chosen.selection else None)
        for chosen in registry.OPERATIONS
        for own in (chosen, chosen.selection)
        if own is not None
    )


def menu_entries() -> list[dict[str, Any]]:
    """Return the filters as plain data, without those whose result is pictures."""
    return [
        {
            "command": entry.operation.name.replace("_", "-"),
            "name": entry.name,
            "title": entry.title,
            "help": entry.help,
            "selects": entry.selects,
            "needs_faces": entry.operation.needs_faces,
            "parameters": [_described(p) for p in entry.parameters],
            "host_parameters": [_described(p) for p in entry.host_parameters],
        }
        for entry in filters()
        if not entry.operation.makes_images
    ]


def _described(parameter: Parameter) -> dict[str, Any]:
    kind = parameter.kind.value
    label = parameter.label + (" (degrees)" if parameter.kind is Kind.ANGLE else "")
    if parameter.auto is not None:  # number fields have no place for a word
        kind, length = "text", parameter.kind is Kind.LENGTH
        label += (
            f" ({AUTO}, or such as {f'{100 * parameter.auto:g}%' if length else parameter.auto})"
        )
    return {**asdict(parameter), "kind": kind, "label": label, "help": parameter.full_help}


def host_layers(
    result: Result,
    shape: Shape,
    entry: Filter,
    *,
    auxiliary: bool = False,
    draw_solid: bool = False,
) -> tuple[Layer, ...]:
    """Return the layers that a host without sliders adds, in their order, or the selection.

    Points that a layer hides are a layer of their own, whose role is "hidden". Where layers are
    generated, the fields on the given one are attributes, without colours. Where the result is
    pictures, layers come on request.

    Parameters
    ----------
    result : Result
    shape : Shape
        What it was run on.
    entry : Filter
    auxiliary : bool
        With the layers that others refer to.
    draw_solid : bool
        Curves as tubes, marks as balls (`solid`).
    """
    if entry.selection:
        chosen = entry.selection.chosen(result, shape)
        field = {SELECTED: np.asarray(chosen, np.int32)}
        return (
            Layer("selection", shape.points, attributes=field, on_input=True, role="selection"),
        )
    layers: list[Layer] = []
    for layer in result.layers:
        if not auxiliary and (layer.auxiliary or (result.images and not layer.on_input)):
            continue
        if layer.on_input and entry.generates:
            layer = replace(layer, color_by=None)
        if draw_solid and not layer.on_input:
            layer = solid(layer, result.shape.diagonal)
        layers += hidden_apart(layer)
    return tuple(layers)


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
    made_by = operation(result.operation)
    entry = Filter(made_by.filter_name, made_by, made_by.selection if selects else None)
    chosen = host_layers(result, shape, entry, auxiliary=auxiliary, draw_solid=draw_solid)
    manifest = describe_result(replace(result, layers=chosen), input=source)
    if selects:
        manifest["values"] = {SELECTED: int(chosen[0].attributes[SELECTED].sum())}
    manifest["layers"] = [{**about, "file": f"{about['name']}.ply"} for about in manifest["layers"]]
    with OutputFolder(folder) as out, progress.stage("write", 0.0, 1.0):
        for number, layer in enumerate(chosen):
            columns = run_patiently(partial(_columns, layer, shape), progress)
            write_ply(out.file(f"{layer.name}.ply"), *columns)
            progress.update((number + 1) / len(chosen))
        write_json(out.file("manifest.json"), manifest)
    return manifest


def _columns(layer: Layer, shape: Shape) -> tuple[Any, Any, Any, dict[str, Any], dict[str, Any]]:
    """Return what `write_ply` takes of a layer; colours are attributes of points or faces."""
    points, faces = layer.points, layer.faces
    attributes, face_attributes = dict(layer.attributes), dict(layer.face_attributes)
    if layer.on_input:
        fields = on_input(layer, shape)
        attributes, face_attributes = dict(fields.attributes), dict(fields.face_attributes)
        points, faces = shape.on_input_points(points, np.nan), None
        for values in face_attributes.values():  # PLY hangs them on faces; corners mean nothing
            faces = np.zeros((len(values), 3), np.int32)
    first = shown(layer, attributes, face_attributes)
    if first is not None:
        columns = zip(COLOR_NAMES, first.rgba_bytes.T, strict=True)
        (face_attributes if first.on_faces else attributes).update(columns)
    return points, faces, layer.edges, attributes, face_attributes


def write_notes(
    folder: str | os.PathLike[str], python: str | os.PathLike[str] = sys.executable
) -> list[Path]:
    """Write what lies beside the plugin into a folder: the Python that it runs, and the filters.

    Returns
    -------
    list of paths
        `PROGRAM_NOTE` and `FILTER_NOTE` in that folder.

    Raises
    ------
    FileError
        When the folder cannot be written.
    """
    table = json_text({"medialis": package_version(), "filters": menu_entries()})
    texts = {PROGRAM_NOTE: str(Path(python).absolute()), FILTER_NOTE: table}
    for name, text in texts.items():
        write_text(Path(folder) / name, f"{text}\n")
    return [Path(folder) / name for name in texts]
