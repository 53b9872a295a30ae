# SPDX-License-Identifier: GPL-3.0-or-later
"""Tasks that people come with: an operation with the options that the task needs.

Each is an operator of its own, for buttons, menus, keys and scripts. It takes the options of the
panel where the task says nothing else, and starts the operator of its operation, which goes on.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

import bpy

from medialis import operation as find_operation
from medialis.hosts import as_typed

from . import tasks
from .properties import LENGTH_SUFFIX, values_of

LEAST_WALL = 0.0008
"""Metres. Services that print in plastics by laser, resin or filament ask for 0.5 to 1 mm."""

Given = Callable[[bpy.types.Scene], dict[str, Any]]


def rigged(scene: bpy.types.Scene) -> dict[str, Any]:
    """Return the options of Rig: what is pressed again binds again."""
    return {**_of_panel(scene, "armature"), "bind": True}


def print_check(scene: bpy.types.Scene) -> dict[str, Any]:
    """Return the options of 3D Print Check: the minimum of the panel, else `LEAST_WALL`.

    Without units in the scene nobody knows what a millimetre is: walls are compared with the
    typical wall.
    """
    options = {**_of_panel(scene, "wall_check"), "legend": True}
    in_units = "minimum" + LENGTH_SUFFIX
    if has_units(scene) and not options.get(in_units) and not options["minimum"]:
        options["lengths_in"] = "SCENE"
        options[in_units] = LEAST_WALL / as_typed(scene.unit_settings.scale_length)
    return options


def study(scene: bpy.types.Scene) -> dict[str, Any]:
    """Return the options of Skeleton Study: medial points, and the samples that they belong to."""
    return {**_of_panel(scene, "surface_skeleton"), "add_samples": True}


def _of_panel(scene: bpy.types.Scene, name: str) -> dict[str, Any]:
    """Return the options of the panel; lengths in the unit of the scene only where it shows them.

    What is not given there is its share of the size.
    """
    given = values_of(find_operation(name), scene.medialis)
    if given["lengths_in"] == "SIZE":
        return {key: value for key, value in given.items() if not key.endswith(LENGTH_SUFFIX)}
    return given


def has_units(scene: bpy.types.Scene) -> bool:
    """Tell whether lengths of the scene are real ones."""
    return scene.unit_settings.system != "NONE"


class Preset(NamedTuple):
    """A task: its operator, what is seen of it, its operation, and what that is given."""

    name: str
    label: str
    words: tuple[str, ...]
    icon: str
    help: str
    operation: str
    given: Given

    @property
    def idname(self) -> str:
        """Name of the operator."""
        return f"medialis.{self.name}"


PRESETS = (
    Preset(
        "rig",
        "Rig",
        ("bones", "armature", "skin weights"),
        "ARMATURE_DATA",
        "Lay bones into the object and bind it to them. An armature of an earlier run is replaced",
        "armature",
        rigged,
    ),
    Preset(
        "print_check",
        "3D Print Check",
        ("thin walls", "wall thickness"),
        "MOD_THICKNESS",
        "Check that no wall is thinner than 0.8 mm, or than the minimum of the wall check in the "
        "panel. Without units in the scene, walls are compared with the typical wall",
        "wall_check",
        print_check,
    ),
    Preset(
        "skeleton_study",
        "Skeleton Study",
        ("medial axis", "samples"),
        "SNAP_MIDPOINT",
        "Add the medial points of the object, and the samples of its surface that they belong to",
        "surface_skeleton",
        study,
    ),
)


class PresetOperator:
    """What the operators of all tasks do."""

    preset: ClassVar[Any]  # a Preset: Blender evaluates it, and 4.2 crashes at its end by that

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Allow it where its operation can start."""
        return tasks.can_start(cls, context, find_operation(cls.preset.operation))

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Wait for the result."""
        return self._run(context, "EXEC_DEFAULT")

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Begin; the operator of the operation goes on."""
        return self._run(context, "INVOKE_DEFAULT")

    def _run(self, context: bpy.types.Context, how: str) -> set[str]:
        preset = self.preset
        if preset.given is print_check and not has_units(context.scene):
            self.report(
                {"INFO"},
                "The scene has no units: walls are compared with the typical wall. Choose units "
                "in Scene > Units to check for 0.8 mm.",
            )
        run = getattr(bpy.ops.medialis, preset.operation)
        try:
            # True: the operator has its own step of undo.
            ended = run(how, True, **preset.given(context.scene))
        except RuntimeError as error:
            self.report({"ERROR"}, str(error).removeprefix("Error: ").strip())
            return {"CANCELLED"}
        return {"CANCELLED"} if "CANCELLED" in ended else {"FINISHED"}


def _operator_of(preset: Preset) -> type:
    about = {
        "preset": preset,
        "bl_idname": preset.idname,
        "bl_label": preset.label,
        "bl_description": preset.help,
        "__module__": __name__,
    }
    return type(f"MEDIALIS_OT_{preset.name}", (PresetOperator, bpy.types.Operator), about)


_classes: list[type] = []


def register() -> None:
    """Add the operators."""
    _classes[:] = [_operator_of(preset) for preset in PRESETS]
    for made in _classes:
        bpy.utils.register_class(made)


def unregister() -> None:
    """Remove the operators."""
    for made in reversed(_classes):
        bpy.utils.unregister_class(made)
