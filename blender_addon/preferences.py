# SPDX-License-Identifier: GPL-3.0-or-later
"""The preferences of the add-on: where compiled code is kept, and how many threads compute."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.props import IntProperty, StringProperty

from . import folders


class MEDIALIS_AP_preferences(bpy.types.AddonPreferences):
    """Edit > Preferences > Add-ons > Medialis."""

    bl_idname = __package__

    cache_folder: StringProperty(
        name="Cache",
        description="Folder of compiled code, for you alone. Empty: the extension's own folder",
        subtype="DIR_PATH",
    )
    threads: IntProperty(
        name="Threads",
        description="Threads that compute at most. 0: one for each processor",
        min=0,
        soft_max=64,
        max=1024,
    )

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the settings, and where the compiled code is."""
        layout = self.layout
        layout.use_property_split = True
        layout.prop(self, "threads", text="Threads" if self.threads else "Threads (Automatic)")
        layout.prop(self, "cache_folder", placeholder=str(self._usual()))

    @staticmethod
    def _usual() -> str:
        return folders.kernel_environment().get("MEDIALIS_CACHE_DIR", "")


def _found() -> Any:
    """Return the preferences; None where the add-on is registered as a module."""
    addon = bpy.context.preferences.addons.get(__package__)
    return None if addon is None else addon.preferences


def cache_folder() -> str:
    """Return the chosen folder of compiled code, empty: the usual one."""
    found = _found()
    return "" if found is None else found.cache_folder


def threads() -> int | None:
    """Return how many threads may compute; None: all."""
    found = _found()
    return None if found is None else found.threads or None


def register() -> None:
    """Add the preferences."""
    bpy.utils.register_class(MEDIALIS_AP_preferences)


def unregister() -> None:
    """Remove the preferences."""
    bpy.utils.unregister_class(MEDIALIS_AP_preferences)
