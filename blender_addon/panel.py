# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar tab: what runs, one section for each group of operations, and the active result."""

from __future__ import annotations

from typing import Any, ClassVar

import bpy

from medialis import OPERATIONS
from medialis import operation as find_operation
from medialis.hosts import Operation

from . import (
    editing,
    filtering,
    jobs,
    levels,
    presets,
    reading,
    removing,
    selecting,
    summary,
    widgets,
)
from .menus import groups
from .properties import OPTIONS, values_of

ICONS = {"Skeleton": "OUTLINER_OB_ARMATURE", "Thickness": "MOD_THICKNESS", "Segment": "MOD_EXPLODE"}
"""Of the groups of operations; any other has a magnifying glass."""


class _Panel:
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Medialis"


class MEDIALIS_PT_main(_Panel, bpy.types.Panel):
    """Object and running computation."""

    bl_idname = "MEDIALIS_PT_main"
    bl_label = "Medialis"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw what is worked on, and what runs."""
        layout = self.layout
        chosen = reading.target(context)
        if chosen is None:
            layout.label(text="Select a mesh or point cloud", icon="INFO")
        elif chosen.type not in reading.TYPES:
            layout.label(text=f"{chosen.name} is not a mesh", icon="ERROR")
        else:
            icon = "POINTCLOUD_DATA" if chosen.type == "POINTCLOUD" else "OBJECT_DATA"
            layout.label(text=chosen.name, icon=icon)
        column = layout.column(align=True)
        column.scale_y = 1.3
        column.operator_context = "INVOKE_DEFAULT"
        for preset in presets.PRESETS:
            column.operator(preset.idname, icon=preset.icon)
        if not presets.has_units(context.scene):
            layout.label(text="No units: no millimetres to check", icon="INFO")
        layout.prop(context.scene.medialis, "live", icon="FILE_REFRESH")
        if jobs.running is not None:
            box = layout.box()
            widgets.draw_text(box, context, jobs.running.label)
            widgets.draw_progress(box, jobs.running.fraction, jobs.running.text)
            box.operator("medialis.cancel_computation", icon="CANCEL")


class _GroupPanel(_Panel):
    """The operations of one group."""

    bl_parent_id = "MEDIALIS_PT_main"
    bl_options: ClassVar = {"DEFAULT_CLOSED"}
    group: ClassVar[str]

    def draw(self, context: bpy.types.Context) -> None:
        """Draw a button for each operation, and its options where they are unfolded."""
        for operation in OPERATIONS:
            if operation.group == self.group:
                draw_operation(self.layout, context, operation)


class MEDIALIS_PT_output(_Panel, bpy.types.Panel):
    """What is added to the scene besides the result."""

    bl_idname = "MEDIALIS_PT_output"
    bl_label = "Output"
    bl_parent_id = "MEDIALIS_PT_main"
    bl_options: ClassVar = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the options of the output."""
        for name in OPTIONS:
            self.layout.column().prop(context.scene.medialis, name)


class MEDIALIS_PT_results(_Panel, bpy.types.Panel):
    """All results of the object: which are shown, alone or not, and their removal."""

    bl_idname = "MEDIALIS_PT_results"
    bl_label = "Results"
    bl_parent_id = "MEDIALIS_PT_main"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Show it for objects that have results."""
        source = reading.target(context)
        return source is not None and removing.RECORDS in source

    def draw(self, context: bpy.types.Context) -> None:
        """Draw a row a result."""
        source = reading.target(context)
        looked_at = removing.operation_of(context.active_object)
        column = self.layout.column(align=True)
        for record in removing.records_of(source):
            row = column.row(align=True)
            active = record.operation == looked_at
            label = find_operation(record.operation).label
            row.label(text=label, icon="RADIOBUT_ON" if active else "RADIOBUT_OFF")
            for icon, solo in (
                ("HIDE_OFF" if record.shown else "HIDE_ON", False),
                ("SOLO_ON", True),
            ):
                button = row.operator("medialis.show_result", text="", icon=icon)
                button.result, button.solo = record.operation, solo
            button = row.operator("medialis.remove_result", text="", icon="X")
            button.result = record.operation


class MEDIALIS_PT_result(_Panel, bpy.types.Panel):
    """The active result: how it is shown, and its summary."""

    bl_idname = "MEDIALIS_PT_result"
    bl_label = "Result"
    bl_parent_id = "MEDIALIS_PT_main"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Show it for objects that carry a result."""
        active = context.active_object
        return active is not None and bool(active.get(summary.PROPERTY))

    def draw(self, context: bpy.types.Context) -> None:
        """Draw sliders, buttons, and the lines of the summary."""
        layout, active = self.layout, context.active_object
        column = layout.column()
        for name, (owner, path) in filtering.modifier_inputs(active).items():
            column.prop(owner, path, text=name, slider=name == "Threshold")
        row = column.row(align=True)
        row.operator("medialis.show_colors", icon="COLOR")
        row.operator("medialis.own_look", icon="MATERIAL")
        draw_selections(column, context)
        draw_editing(column, active)
        column.operator("medialis.remove_result", icon="TRASH")
        column.operator("medialis.add_to_catalogue", icon="ASSET_MANAGER")
        lines = active[summary.PROPERTY].split("\n")
        widgets.draw_text(layout, context, lines[0], icon="CHECKMARK")
        notes = [line for line in lines[1:] if line.startswith("!")]
        settings = context.scene.medialis
        text = f"Notes: {len(notes)}"
        if notes and widgets.draw_fold(layout, settings, "unfolded_notes", text):
            for note in notes:
                mark, _, text = note.partition(" ")
                widgets.draw_text(layout, context, text, icon="ERROR" if mark == "!!" else "INFO")
        values = [line for line in lines[1:] if not line.startswith("!")]
        if widgets.draw_fold(layout, settings, "unfolded_values", "Values"):
            for line in values:
                name, _, value = line.partition(": ")
                row = layout.row()
                row.label(text=name)
                row.label(text=value)


def draw_selections(layout: Any, context: bpy.types.Context) -> None:
    """Draw a button for each kind of faces that the result has found."""
    chosen = selecting.carrier(context)
    row = layout.row(align=True)
    for name, label, _ in selecting.WHICH if chosen is not None else ():
        if name in selecting.available(chosen):
            text = f"Select {label}"
            row.operator("medialis.select_faces", text=text, icon="FACESEL").which = name


def draw_editing(layout: Any, active: bpy.types.Object) -> None:
    """Draw the slider of levels, and what can be done with a result that was edited."""
    if levels.has(active):
        layout.prop(active, "medialis_level")
    if editing.option_of(active) is not None:
        layout.operator_context = "INVOKE_DEFAULT"
        layout.operator("medialis.rebuild", icon="MOD_REMESH")
    if active.type == "ARMATURE":
        layout.operator("medialis.test_poses", icon="POSE_HLT")
        layout.operator("medialis.rigify_metarig", icon="ARMATURE_DATA")
    if active.get(reading.FORMATS):
        layout.operator("medialis.export_layer", icon="EXPORT")


def set_options(button: Any, context: bpy.types.Context, operation: Operation) -> None:
    """Give a button the options of the panel: what was used last does not count."""
    for name, value in values_of(operation, context.scene.medialis).items():
        setattr(button, name, value)


def draw_operation(layout: Any, context: bpy.types.Context, operation: Operation) -> None:
    """Draw the button of an operation with the settings of the panel, and its options."""
    settings = getattr(context.scene.medialis, f"of_{operation.name}")
    column = layout.column(align=True)
    row = column.row(align=True)
    row.operator_context = "INVOKE_DEFAULT"
    button = row.operator(f"medialis.{operation.name}", icon=ICONS.get(operation.group, "VIEWZOOM"))
    set_options(button, context, operation)
    icon = "DOWNARROW_HLT" if settings.unfolded else "PREFERENCES"
    row.prop(settings, "unfolded", text="", icon=icon)
    if not settings.unfolded:
        return
    widgets.draw_options(column.box(), operation, settings, context.scene.medialis.lengths_in)


_classes: list[type] = []


def register() -> None:
    """Add the panels."""
    sections = [
        type(
            f"MEDIALIS_PT_{group.lower()}",
            (_GroupPanel, bpy.types.Panel),
            {"bl_idname": f"MEDIALIS_PT_{group.lower()}", "bl_label": group, "group": group},
        )
        for group in groups()
    ]
    _classes[:] = [
        *(MEDIALIS_PT_main, MEDIALIS_PT_results, MEDIALIS_PT_result),
        *(*sections, MEDIALIS_PT_output),
    ]
    for made in _classes:
        bpy.utils.register_class(made)


def unregister() -> None:
    """Remove the panels."""
    for made in reversed(_classes):
        bpy.utils.unregister_class(made)
