"""Operations as the filters of a host with menus and dialogs, and what such a host adds of them.

A filter is an operation under its name, or the selection that it tells. `menu_entries` describes
all of them as plain data, from which the MeshLab plugin makes its menu and its dialogs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from medialis.hosts.shown import hidden_apart
from medialis.hosts.solid import solid
from medialis.model.shape import Shape
from medialis.operations import registry
from medialis.operations.declaration import Operation
from medialis.operations.result import Layer, Result
from medialis.options import Kind, Options, Parameter

LOWER_CASE = ("by", "of", "per", "with", "from", "to", "on", "the", "without")
SELECTED = "selected"

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
    selects : bool
        It selects vertices and adds nothing.
    """

    name: str
    operation: Operation
    selects: bool = False

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
        chosen, full = self.operation, self.operation.full_help
        if self.selects and chosen.selection is not None:
            return full.replace(chosen.help.split("\n\n")[0], chosen.selection.help, 1)
        return full

    @property
    def defaults(self) -> Mapping[str, Any]:
        """Defaults of its own."""
        selection = self.operation.selection
        return selection.defaults if self.selects and selection is not None else {}

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters of the operation, as this filter has them."""
        own = self.operation.parameters
        return tuple(replace(p, default=self.defaults.get(p.name, p.default)) for p in own)

    @property
    def host_parameters(self) -> tuple[Parameter, ...]:
        """What only a host can do, where it means something; off in scripts."""
        chosen = self.operation
        if self.selects:
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
    found = []
    for chosen in registry.OPERATIONS:
        found.append(filter_of(chosen))
        if chosen.selection is not None:
            found.append(filter_of(chosen, selects=True))
    return tuple(found)


def filter_of(chosen: Operation, *, selects: bool = False) -> Filter:
    """Return the filter of an operation, or that of its selection."""
    if selects and chosen.selection is not None:
        return Filter(chosen.selection.filter_name, chosen, selects=True)
    return Filter(chosen.filter_name, chosen)


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
    label = parameter.label
    if parameter.kind is Kind.ANGLE:
        label += " (degrees)"
    return {**asdict(parameter), "kind": parameter.kind.value, "label": label}


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
    if entry.selects and entry.operation.selection is not None:
        chosen = entry.operation.selection.chosen(result, shape)
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
