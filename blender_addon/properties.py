# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender properties of the parameters of operations, and the settings of the panel."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.props import (
    BoolProperty,
    EnumProperty,
    FloatProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

from medialis import OPERATIONS
from medialis.hosts import Kind, Operation, Parameter, as_typed, title

from .writing import Options

LARGEST = 2**31 - 1

OPTIONS = {
    "add_samples": BoolProperty(
        name="Add samples",
        description="Also add the surface as computed on: feature points and sources number its "
        "points",
    ),
    "with_materials": BoolProperty(
        name="Face materials",
        description="Give each segment on the surface a material of its own, or the surface one "
        "that shows the result. Earlier material slots stay, the faces leave them",
    ),
    "curves": BoolProperty(
        name="Curve objects",
        description="Add curve skeletons and paths as curve objects with radius, instead of meshes "
        "of edges with all attributes",
    ),
}

EXTRAS: dict[str, dict[str, Any]] = {
    "armature": {
        "bind": BoolProperty(
            name="Bind",
            description="Parent the object to the armature and add an Armature modifier, so that "
            "posing the bones deforms it",
        ),
    },
    "view_curve_skeleton": {
        "views_by": EnumProperty(
            name="Views by",
            description="What renders the views",
            items=[
                (
                    "AUTO",
                    "Automatic",
                    "Blender's GPU in a window with a graphics card, otherwise the processor",
                ),
                (
                    "GPU",
                    "Blender's GPU",
                    "Blender's gpu module; the processor where it cannot draw",
                ),
                ("CPU", "Processor", "The rasterizer of medialis"),
            ],
        ),
    },
}
"""Options of single operations that only Blender has."""


def property_of(parameter: Parameter) -> Any:
    """Return the Blender property of a parameter: lengths in per cent of the size."""
    about: dict[str, Any] = {
        "name": parameter.label,
        "description": parameter.help.removesuffix("."),
    }
    kind = parameter.kind
    if kind is Kind.BOOL:
        return BoolProperty(default=parameter.default, **about)
    if kind is Kind.CHOICE:
        items = [(value, title(value).capitalize(), "") for value in parameter.choices]
        return EnumProperty(items=items, default=parameter.default, **about)
    if kind is Kind.FILE:
        if bpy.app.version >= (4, 5, 0):  # "//" is the folder of the .blend file
            about["options"] = {"PATH_SUPPORTS_BLEND_RELATIVE"}
        return StringProperty(subtype="FILE_PATH", default=parameter.default, **about)
    if kind is Kind.INT:
        low, high = max(int(parameter.low), -LARGEST), min(int(parameter.high), LARGEST)
        return IntProperty(default=parameter.default, min=low, max=high, **about)
    scale = 100.0 if kind is Kind.LENGTH else 1.0
    if kind is Kind.LENGTH:
        about["description"] += ". In per cent of the size (the bounding-box diagonal)"
    elif kind is Kind.ANGLE:
        about["name"] += " (degrees)"
    return FloatProperty(
        default=scale * parameter.default,
        min=scale * parameter.low,
        max=scale * parameter.high,
        soft_max=min(scale * parameter.high, 100.0)
        if kind is Kind.LENGTH
        else scale * parameter.high,
        subtype="PERCENTAGE" if kind is Kind.LENGTH else "NONE",
        precision=3 if kind is Kind.LENGTH else 2,
        **about,
    )


def value_of(parameter: Parameter, value: Any) -> Any:
    """Return the core's value of a property's value; Blender keeps single precision."""
    if parameter.kind is Kind.FILE:
        return bpy.path.abspath(value) if value else ""
    if parameter.kind in (Kind.FLOAT, Kind.ANGLE, Kind.LENGTH):
        return as_typed(value, percent=parameter.kind is Kind.LENGTH)
    return value


def parameters_of(operation: Operation, holder: Any) -> dict[str, Any]:
    """Return the parameters of an operation from an operator or a settings group."""
    return {p.name: value_of(p, getattr(holder, p.name)) for p in operation.parameters}


def options_of(holder: Any) -> Options:
    """Return the output options from an operator or the settings."""
    given = {name: getattr(holder, name) for name in OPTIONS}
    return Options(**given, bind=getattr(holder, "bind", False))


def annotations_of(operation: Operation) -> dict[str, Any]:
    """Return the properties of an operation by name."""
    own = {p.name: property_of(p) for p in operation.parameters}
    return {**own, **EXTRAS.get(operation.name, {})}


def _settings_classes() -> list[type]:
    """Return one settings group for each operation, and the group of all of them."""
    groups = []
    pointers: dict[str, Any] = dict(OPTIONS)
    for operation in OPERATIONS:
        fold = {
            "unfolded": BoolProperty(name="Options", description="Show the options"),
            "unfolded_more": BoolProperty(name="More", description="Show all options"),
        }
        made = type(
            f"MEDIALIS_PG_{operation.name}",
            (bpy.types.PropertyGroup,),
            {"__annotations__": {**annotations_of(operation), **fold}},
        )
        groups.append(made)
        pointers[f"of_{operation.name}"] = PointerProperty(type=made)
    pointers["unfolded_notes"] = BoolProperty(
        name="Notes", description="Show what was repaired, refined or left out", default=True
    )
    pointers["unfolded_values"] = BoolProperty(name="Values", description="Show all values")
    return [
        *groups,
        type("MEDIALIS_PG_settings", (bpy.types.PropertyGroup,), {"__annotations__": pointers}),
    ]


_classes: list[type] = []


def register() -> None:
    """Add the settings to scenes, as `scene.medialis`."""
    _classes[:] = _settings_classes()
    for made in _classes:
        bpy.utils.register_class(made)
    bpy.types.Scene.medialis = PointerProperty(type=_classes[-1])


def unregister() -> None:
    """Remove the settings."""
    del bpy.types.Scene.medialis
    for made in reversed(_classes):
        bpy.utils.unregister_class(made)
