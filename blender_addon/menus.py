# SPDX-License-Identifier: GPL-3.0-or-later
"""Object > Medialis: every task and operation; F3 finds them there by what people call them."""

from __future__ import annotations

from typing import Any

import bpy

from medialis import OPERATIONS

from . import presets, selecting


class MEDIALIS_MT_object(bpy.types.Menu):
    """All tasks and operations, group after group."""

    bl_idname = "MEDIALIS_MT_object"
    bl_label = "Medialis"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw one entry an operation and a line between groups; F3 searches their texts."""
        layout = self.layout
        layout.operator_context = "INVOKE_DEFAULT"
        for preset in presets.PRESETS:
            text = with_words(preset.label, preset.words)
            layout.operator(preset.idname, text=text, icon=preset.icon)
        for group in groups():
            layout.separator()
            for operation in OPERATIONS:
                if operation.group == group:
                    text = with_words(operation.label, operation.words)
                    layout.operator(f"medialis.{operation.name}", text=text)
        layout.separator()
        selecting.draw_entries(layout)
        layout.separator()
        for name in ("test_poses", "rigify_metarig"):
            layout.operator(f"medialis.{name}")
        layout.separator()
        for name in ("show_result", "own_look", "remove_result", "add_to_catalogue"):
            layout.operator(f"medialis.{name}")


def with_words(label: str, words: Any) -> str:
    """Return the text of an entry, such as "Armature (bones, rig)"."""
    return f"{label} ({', '.join(words)})"


def groups() -> list[str]:
    """Return the groups that have operations, in the order of the panel."""
    present = dict.fromkeys(operation.group for operation in OPERATIONS)
    order = ("Skeleton", "Thickness", "Segment", "Inspect")
    return sorted(present, key=lambda group: order.index(group) if group in order else len(order))


def _entry(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    self.layout.separator()
    self.layout.menu(MEDIALIS_MT_object.bl_idname)


def _selections(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    self.layout.separator()
    selecting.draw_entries(self.layout)


def register() -> None:
    """Add the menu to the Object menu of the 3D view, and selections to Select of edit mode."""
    bpy.utils.register_class(MEDIALIS_MT_object)
    bpy.types.VIEW3D_MT_object.append(_entry)
    bpy.types.VIEW3D_MT_select_edit_mesh.append(_selections)


def unregister() -> None:
    """Remove the menu and the selections."""
    bpy.types.VIEW3D_MT_select_edit_mesh.remove(_selections)
    bpy.types.VIEW3D_MT_object.remove(_entry)
    bpy.utils.unregister_class(MEDIALIS_MT_object)
