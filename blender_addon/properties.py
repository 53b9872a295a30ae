# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender properties of the parameters of operations, and the settings of the panel."""

from __future__ import annotations

import math
from collections.abc import Callable
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

from medialis import OPERATIONS, Length
from medialis.hosts import AUTO, Kind, Operation, Parameter, as_typed, title

from . import live, reading
from .filtering import WIDGETS
from .writing import Options

Update = Callable[..., None] | None

LARGEST = 2**31 - 1

LENGTH_SUFFIX = "_in_units"
"""What the name of a length in the unit of the scene ends in."""

SWITCH_PREFIX = "use_"
"""What the name of the switch of an automatic option begins with: off is automatic."""

OPTIONS = {
    "add_samples": BoolProperty(
        name="Add samples",
        description="Also add the surface as computed on: feature points and sources number its "
        "points",
    ),
    "keep_materials": BoolProperty(
        name="Keep my materials",
        description="Leave the object as it looks. Otherwise a modifier shows it in the colours of "
        "the result, or see-through around a skeleton; its own materials stay below",
    ),
    "legend": BoolProperty(
        name="Legend",
        description="Show in views what the colours mean, and numbers at the places that have them",
        default=True,
    ),
    "legend_in_renders": BoolProperty(
        name="Legend in renders",
        description="Add the legend and the numbers as objects that renders show, facing the view",
    ),
    "keep_earlier": BoolProperty(
        name="Keep earlier results",
        description="Add the result besides one of the same operation, instead of replacing it",
    ),
    "segments_as": EnumProperty(
        name="Segments as",
        description="What segments on the surface become besides attributes",
        items=[
            ("GROUPS", "Vertex groups", "One for each segment"),
            ("FACE_SETS", "Face sets", "As sculpt mode has them"),
            ("MATERIALS", "Materials", "A slot for each segment; earlier slots stay"),
        ],
        options={"ENUM_FLAG"},
        default={"GROUPS"},
    ),
    "curves": BoolProperty(
        name="Curve objects",
        description="Add curve skeletons and paths as curve objects with radius, instead of meshes "
        "of edges with all attributes",
    ),
}

_BIND = {
    "bind": BoolProperty(
        name="Bind",
        description="Parent the object to the armature and add an Armature modifier, so that "
        "posing the bones deforms it",
    ),
}

EXTRAS: dict[str, dict[str, Any]] = {
    "armature": _BIND,
    "bind": _BIND,
    "view_curve_skeleton": {
        "views_by": EnumProperty(
            name="Views by",
            description="What renders the views",
            items=[
                (
                    "AUTO",
                    "Automatic",
                    "Blender's GPU; in a window without a graphics card the processor",
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


def property_of(parameter: Parameter, update: Update = None) -> Any:
    """Return the Blender property of a parameter: lengths in per cent of the size.

    That of an automatic one has the number from which the operation starts; see `switch_of`.
    """
    default = parameter.default if parameter.auto is None else parameter.auto
    about: dict[str, Any] = {
        "update": update,
        "name": parameter.label,
        "description": parameter.help.removesuffix("."),
    }
    kind = parameter.kind
    if kind is Kind.BOOL:
        return BoolProperty(default=parameter.default, **about)
    if kind is Kind.CHOICE:
        told = zip(parameter.choices, parameter.choice_help, strict=True)
        items = [(word, title(word).capitalize(), text.removesuffix(".")) for word, text in told]
        return EnumProperty(items=items, default=parameter.default, **about)
    if kind is Kind.FILE:
        if bpy.app.version >= (4, 5, 0):  # "//" is the folder of the .blend file
            about["options"] = {"PATH_SUPPORTS_BLEND_RELATIVE"}
        if parameter.layer:  # what was edited counts once
            about["options"] = {*about.get("options", ()), "SKIP_SAVE"}
        return StringProperty(subtype="FILE_PATH", default=parameter.default, **about)
    if kind is Kind.INT:
        low, high = max(int(parameter.low), -LARGEST), min(int(parameter.high), LARGEST)
        return IntProperty(default=int(default), min=low, max=high, **about)
    subtype, scale = WIDGETS.get(kind, ("NONE", 1.0))
    high = scale * parameter.high
    if kind is Kind.LENGTH:
        about["description"] += ". In per cent of the size (the bounding-box diagonal)"
        about["soft_max"] = min(high, 100.0)
    return FloatProperty(
        default=scale * default,
        min=scale * parameter.low,
        max=high,
        subtype=subtype,
        precision=3 if kind is Kind.LENGTH else 2,
        **about,
    )


def length_of(parameter: Parameter, update: Update = None) -> Any:
    """Return the Blender property of a length in the unit of the scene; see `lengths_in`."""
    return FloatProperty(
        name=parameter.label,
        description=parameter.help.removesuffix("."),
        min=0.0,
        subtype="DISTANCE",
        precision=4,
        update=update,
    )


def switch_of(parameter: Parameter, update: Update = None) -> Any:
    """Return the switch of an automatic option: on, its number is used; off, one is chosen."""
    return BoolProperty(
        name=f"Set {parameter.label}",
        description="Use this value. Otherwise the operation chooses one that suits the shape, and "
        "the result says which",
        update=update,
    )


def is_automatic(parameter: Parameter, holder: Any) -> bool:
    """Tell whether the operation chooses the value.

    Scripts give an operator the number alone: it counts, unless they turn its switch off.
    """
    if parameter.auto is None:
        return False
    switch, given = SWITCH_PREFIX + parameter.name, getattr(holder, "properties", holder)
    names = {parameter.name, shown_name(parameter, getattr(holder, "lengths_in", "SIZE"))}
    if given is not holder and not given.is_property_set(switch):
        return not any(map(given.is_property_set, names))
    return not getattr(holder, switch)


def value_of(parameter: Parameter, value: Any) -> Any:
    """Return the core's value of a property's value; Blender keeps single precision."""
    if parameter.kind is Kind.FILE:
        return bpy.path.abspath(value) if value else ""
    if parameter.kind is Kind.ANGLE:
        return as_typed(float(f"{math.degrees(value):.6g}"))
    if parameter.kind in (Kind.FLOAT, Kind.LENGTH):
        return as_typed(value, percent=parameter.kind is Kind.LENGTH)
    return value


def shown_name(parameter: Parameter, lengths_in: str) -> str:
    """Return the name of the property that shows a parameter."""
    own = parameter.kind is Kind.LENGTH and lengths_in == "SCENE"
    return parameter.name + LENGTH_SUFFIX if own else parameter.name


def parameters_of(operation: Operation, holder: Any) -> dict[str, Any]:
    """Return the parameters of an operation from an operator or a settings group.

    A length in the unit of the scene that nobody gave is the share of the size.
    """
    given = getattr(holder, "properties", holder)  # an operator has them apart
    found = {}
    for p in operation.parameters:
        shown = shown_name(p, getattr(holder, "lengths_in", "SIZE"))
        if is_automatic(p, holder):
            found[p.name] = AUTO
        elif shown != p.name and given.is_property_set(shown):
            found[p.name] = Length(as_typed(getattr(holder, shown)), "units")
        else:
            found[p.name] = value_of(p, getattr(holder, p.name))
    return found


def set_lengths(operation: Operation, holder: Any, diagonal: float) -> None:
    """Set the lengths in the unit of the scene to what the shares of the size are."""
    for p in operation.parameters:
        if p.kind is Kind.LENGTH:
            share = 0.01 * getattr(holder, p.name)
            setattr(holder, p.name + LENGTH_SUFFIX, share * diagonal)


def _choose_lengths(settings: Any, context: bpy.types.Context) -> None:
    """Begin with the same lengths where the user changes their unit."""
    chosen = reading.target(context)
    diagonal = 1.0 if chosen is None else chosen.dimensions.length or 1.0
    for operation in OPERATIONS:
        set_lengths(operation, getattr(settings, f"of_{operation.name}"), diagonal)


def options_of(holder: Any) -> Options:
    """Return the output options from an operator or the settings."""
    given = {name: getattr(holder, name) for name in OPTIONS}
    given["segments_as"] = frozenset(given["segments_as"])
    return Options(**given, bind=getattr(holder, "bind", False))


def values_of(operation: Operation, settings: Any) -> dict[str, Any]:
    """Return what the operator of an operation gets from the settings of the panel."""
    own = getattr(settings, f"of_{operation.name}")
    options = {name: getattr(settings, name) for name in (*OPTIONS, "lengths_in")}
    return {**{name: getattr(own, name) for name in annotations_of(operation)}, **options}


def annotations_of(operation: Operation, update: Update = None) -> dict[str, Any]:
    """Return the properties of an operation by name; `update` hears of changes."""
    own = {p.name: property_of(p, update) for p in operation.parameters}
    lengths = [p for p in operation.parameters if p.kind is Kind.LENGTH]
    own |= {p.name + LENGTH_SUFFIX: length_of(p, update) for p in lengths}
    automatic = [p for p in operation.parameters if p.auto is not None]
    own |= {SWITCH_PREFIX + p.name: switch_of(p, update) for p in automatic}
    return {**own, **EXTRAS.get(operation.name, {})}


def lengths_in(**about: Any) -> Any:
    """Return the choice of the unit of lengths, for the settings and for operators."""
    return EnumProperty(
        name="Lengths",
        description="How lengths are given",
        items=[
            ("SIZE", "% of Size", "Per cent of the diagonal of the bounding box"),
            ("SCENE", "Scene Units", "As Blender shows lengths"),
        ],
        **about,
    )


def _update_of(operation: Operation) -> Update:
    return live.updates(operation.name, lambda: values_of(operation, bpy.context.scene.medialis))


def _settings_classes() -> list[type]:
    """Return one settings group for each operation, and the group of all of them."""
    groups = []
    pointers: dict[str, Any] = {**OPTIONS, "lengths_in": lengths_in(update=_choose_lengths)}
    for operation in OPERATIONS:
        fold = {
            "unfolded": BoolProperty(name="Options", description="Show the options"),
            "unfolded_more": BoolProperty(name="More", description="Show all options"),
        }
        made = type(
            f"MEDIALIS_PG_{operation.name}",
            (bpy.types.PropertyGroup,),
            {"__annotations__": {**annotations_of(operation, _update_of(operation)), **fold}},
        )
        groups.append(made)
        pointers[f"of_{operation.name}"] = PointerProperty(type=made)
    pointers["live"] = BoolProperty(
        name="Live",
        description="Compute the active result anew when one of its options changes here",
    )
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
        # With `import bpy` of Blender 4.2, Python crashes at its end while properties are known
        # that call back.
        made.__annotations__.clear()
