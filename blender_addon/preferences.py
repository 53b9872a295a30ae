# SPDX-License-Identifier: GPL-3.0-or-later
"""The preferences of the add-on: threads, device and keys."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.props import EnumProperty, IntProperty


class MEDIALIS_AP_preferences(bpy.types.AddonPreferences):
    """Edit > Preferences > Add-ons > Medialis."""

    bl_idname = __package__

    threads: IntProperty(
        name="Threads",
        description="Threads that compute at most. 0: one for each processor",
        min=0,
        soft_max=64,
        max=1024,
    )
    device: EnumProperty(
        name="Device",
        description="Device for computing",
        items=[
            ("auto", "Automatic", "The fastest device; currently always the processor"),
            ("cpu", "Processor", "Only the processor"),
            (
                "gpu",
                "GPU",
                "An NVIDIA GPU for the steps that support it, else the processor",
            ),
        ],
    )

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the settings."""
        layout = self.layout
        layout.use_property_split = True
        layout.prop(self, "threads", text="Threads" if self.threads else "Threads (Automatic)")
        layout.prop(self, "device")
        layout.label(text="Keys (none are assigned by default)")
        draw_keys(layout, context)


def draw_keys(layout: Any, context: bpy.types.Context) -> None:
    """Draw the entries of the keymap (`finding.KEYS`) as the user has them, to be given a key."""
    keymap = context.window_manager.keyconfigs.user.keymaps.get("3D View")
    column = layout.column()
    for item in [] if keymap is None else keymap.keymap_items:
        menu = getattr(item.properties, "name", "") if item.idname == "wm.call_menu_pie" else ""
        if item.idname.startswith("medialis.") or menu.startswith("MEDIALIS_"):
            which = getattr(item.properties, "which", "")
            text = f"{item.name}: {which.capitalize()}" if which else item.name
            column.prop(item, "type", text=text, full_event=True)


def _found() -> Any:
    """Return the preferences; None where the add-on is registered as a module."""
    addon = bpy.context.preferences.addons.get(__package__)
    return None if addon is None else addon.preferences


def threads() -> int | None:
    """Return how many threads may compute; None: all."""
    found = _found()
    return None if found is None else found.threads or None


def device() -> str | None:
    """Return the chosen device; None for automatic."""
    found = _found()
    return None if found is None or found.device == "auto" else found.device


def register() -> None:
    """Add the preferences."""
    bpy.utils.register_class(MEDIALIS_AP_preferences)


def unregister() -> None:
    """Remove the preferences."""
    bpy.utils.unregister_class(MEDIALIS_AP_preferences)
