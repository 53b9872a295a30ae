# SPDX-License-Identifier: GPL-3.0-or-later
"""How operators are found besides the panel: a pie menu, keys, and pages of the manual.

Keys are entries without one: Preferences > Keymap > 3D View lists them, and so do the preferences
of the add-on. Nothing that a user has assigned is touched.
"""

from __future__ import annotations

from typing import Any

import bpy

from medialis import OPERATIONS

from . import presets, selecting

DOCUMENTATION = "https://medialis.github.io/medialis/"
"""The site that `pyproject.toml` names (a test compares them)."""

PIE = "MEDIALIS_MT_pie"

KEYS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("wm.call_menu_pie", {"name": PIE}),
    *((preset.idname, {}) for preset in presets.PRESETS),
    *(("medialis.select_faces", {"which": name}) for name, _, _ in selecting.WHICH),
    ("medialis.show_result", {}),
    ("medialis.show_colors", {}),
    ("medialis.own_look", {}),
    ("medialis.remove_result", {}),
)
"""Operators that a key can be given to, with their options."""

_entries: list[tuple[bpy.types.KeyMap, bpy.types.KeyMapItem]] = []


class MEDIALIS_MT_select(bpy.types.Menu):
    """What can be selected of the result"""  # noqa: D400 - a tooltip

    bl_idname = "MEDIALIS_MT_select"
    bl_label = "Select Faces"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw one entry for each."""
        selecting.draw_entries(self.layout)


class MEDIALIS_MT_pie(bpy.types.Menu):
    """What is done most often, all around the mouse"""  # noqa: D400 - a tooltip

    bl_idname = PIE
    bl_label = "Medialis"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the eight slots: left, right, bottom, top, and the corners."""
        pie = self.layout.menu_pie()
        pie.operator_context = "INVOKE_DEFAULT"
        rig, check, study = presets.PRESETS
        pie.operator(rig.idname, icon=rig.icon)
        pie.operator(check.idname, icon=check.icon)
        pie.operator("medialis.remove_result", icon="TRASH")
        pie.operator(study.idname, icon=study.icon)
        pie.operator("medialis.parts", icon="MOD_EXPLODE")
        pie.operator("medialis.show_result", icon="HIDE_OFF")
        pie.operator("medialis.own_look", icon="MATERIAL")
        pie.menu(MEDIALIS_MT_select.bl_idname, icon="FACESEL")


def manual() -> tuple[str, tuple[tuple[str, str], ...]]:
    """Return the site, and the page of each operator and of its options; the first that fits."""
    of_presets = [(preset.name, preset.operation) for preset in presets.PRESETS]
    pages = [(operation.name, operation.name) for operation in OPERATIONS]
    found = []
    for name, page in [*of_presets, *pages]:
        for pattern in (f"bpy.ops.medialis.{name}", f"bpy.types.medialis_pg_{name}.*"):
            found.append((pattern, f"{page}.html"))
            found.append((f"{pattern}.*", f"{page}.html"))
    rest = ("bpy.ops.medialis.*", "bpy.types.medialis_*", "bpy.types.scene.medialis*")
    return DOCUMENTATION, (*found, *((pattern, "blender.html") for pattern in rest))


_classes = (MEDIALIS_MT_select, MEDIALIS_MT_pie)


def register() -> None:
    """Add menus, pages, and entries for keys."""
    for made in _classes:
        bpy.utils.register_class(made)
    bpy.utils.register_manual_map(manual)
    config = bpy.context.window_manager.keyconfigs.addon
    if config is None:
        return
    keymap = config.keymaps.new(name="3D View", space_type="VIEW_3D")
    for name, options in KEYS:
        item = keymap.keymap_items.new(name, "NONE", "PRESS")
        for key, value in options.items():
            setattr(item.properties, key, value)
        _entries.append((keymap, item))


def unregister() -> None:
    """Remove them."""
    for keymap, item in _entries:
        keymap.keymap_items.remove(item)
    _entries.clear()
    bpy.utils.unregister_manual_map(manual)
    for made in reversed(_classes):
        bpy.utils.unregister_class(made)
