# SPDX-License-Identifier: GPL-3.0-or-later
"""Object > Medialis: every operation with its default options; F3 finds them there."""

from __future__ import annotations

import bpy

from medialis import OPERATIONS


class MEDIALIS_MT_object(bpy.types.Menu):
    """All operations, group after group."""

    bl_idname = "MEDIALIS_MT_object"
    bl_label = "Medialis"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw one entry an operation and a line between groups."""
        self.layout.operator_context = "INVOKE_DEFAULT"
        for number, group in enumerate(groups()):
            if number:
                self.layout.separator()
            for operation in OPERATIONS:
                if operation.group == group:
                    self.layout.operator(f"medialis.{operation.name}")


def groups() -> list[str]:
    """Return the groups that have operations, in the order of the panel."""
    present = dict.fromkeys(operation.group for operation in OPERATIONS)
    order = ("Skeleton", "Thickness", "Segment", "Inspect")
    return sorted(present, key=lambda group: order.index(group) if group in order else len(order))


def _entry(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    self.layout.separator()
    self.layout.menu(MEDIALIS_MT_object.bl_idname)


def register() -> None:
    """Add the menu to the Object menu of the 3D view."""
    bpy.utils.register_class(MEDIALIS_MT_object)
    bpy.types.VIEW3D_MT_object.append(_entry)


def unregister() -> None:
    """Remove the menu."""
    bpy.types.VIEW3D_MT_object.remove(_entry)
    bpy.utils.unregister_class(MEDIALIS_MT_object)
