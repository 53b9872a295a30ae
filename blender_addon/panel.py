# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar tab: what runs, one section for each group of operations, and the active result."""

from __future__ import annotations

import textwrap
from typing import Any, ClassVar

import bpy

from medialis import OPERATIONS
from medialis.hosts import Operation

from . import filtering, jobs, reading, summary, warmup
from .menus import groups
from .properties import EXTRAS, OPTIONS

CHARACTER = 7.0
"""Pixels of a letter of the panel, on average, at Blender's standard scale."""


class _Panel:
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Medialis"


class MEDIALIS_PT_main(_Panel, bpy.types.Panel):
    """Object, running computation and preparation."""

    bl_idname = "MEDIALIS_PT_main"
    bl_label = "Medialis"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw what is worked on, and what runs."""
        layout = self.layout
        chosen = reading.target(context)
        if chosen is None:
            layout.label(text="Select a mesh or point cloud", icon="INFO")
        elif chosen.type not in reading.TYPES:
            layout.label(text=f"{chosen.name} is no mesh", icon="ERROR")
        else:
            icon = "POINTCLOUD_DATA" if chosen.type == "POINTCLOUD" else "OBJECT_DATA"
            layout.label(text=chosen.name, icon=icon)
        if jobs.running is not None:
            box = layout.box()
            draw_text(box, context, jobs.running.label)
            draw_progress(box, jobs.running.fraction, jobs.running.text)
            box.operator("medialis.cancel_computation", icon="CANCEL")
        if warmup.current is not None and warmup.current.note:
            box = layout.box()
            draw_text(box, context, warmup.current.note, icon="TIME")
            if warmup.current.running:
                draw_progress(box, warmup.current.fraction, "compiling")


class _GroupPanel(_Panel):
    """The operations of one group."""

    bl_parent_id = "MEDIALIS_PT_main"
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
            self.layout.prop(context.scene.medialis, name)


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
        column.operator("medialis.show_colors", icon="COLOR")
        if active.get(reading.RESULT) and active.parent is not None:
            column.prop(active.parent, "display_type", text="Source")
        lines = active[summary.PROPERTY].split("\n")
        draw_text(layout, context, lines[0], icon="CHECKMARK")
        notes = [line for line in lines[1:] if line.startswith("!")]
        settings = context.scene.medialis
        if notes and draw_fold(layout, settings, "unfolded_notes", f"Notes: {len(notes)}"):
            for note in notes:
                mark, _, text = note.partition(" ")
                draw_text(layout, context, text, icon="ERROR" if mark == "!!" else "INFO")
        values = [line for line in lines[1:] if not line.startswith("!")]
        if draw_fold(layout, settings, "unfolded_values", "Values"):
            for line in values:
                name, _, value = line.partition(": ")
                row = layout.row()
                row.label(text=name)
                row.label(text=value)


def draw_operation(layout: Any, context: bpy.types.Context, operation: Operation) -> None:
    """Draw the button of an operation with the settings of the panel, and its options."""
    settings = getattr(context.scene.medialis, f"of_{operation.name}")
    column = layout.column(align=True)
    row = column.row(align=True)
    row.operator_context = "INVOKE_DEFAULT"
    button = row.operator(f"medialis.{operation.name}")
    extras = EXTRAS.get(operation.name, {})
    for name in (*(parameter.name for parameter in operation.parameters), *extras):
        setattr(button, name, getattr(settings, name))
    for name in OPTIONS:
        setattr(button, name, getattr(context.scene.medialis, name))
    icon = "DOWNARROW_HLT" if settings.unfolded else "PREFERENCES"
    row.prop(settings, "unfolded", text="", icon=icon)
    if not settings.unfolded:
        return
    box = column.box().column()
    for parameter in operation.parameters:
        if not parameter.advanced:
            draw_parameter(box, settings, parameter)
    for name in extras:
        box.prop(settings, name)
    advanced = [parameter for parameter in operation.parameters if parameter.advanced]
    if advanced and draw_fold(box, settings, "unfolded_more", "More"):
        for parameter in advanced:
            draw_parameter(box, settings, parameter)


def draw_parameter(layout: Any, settings: Any, parameter: Any) -> None:
    """Draw one option; those with a list or a path get their name in front."""
    if isinstance(parameter.default, str):
        row = layout.row().split(factor=0.4)
        row.label(text=parameter.label)
        row.prop(settings, parameter.name, text="")
    else:
        layout.prop(settings, parameter.name)


def draw_fold(layout: Any, settings: Any, name: str, text: str) -> bool:
    """Draw a triangle that unfolds what follows, and return whether it is open."""
    opened = getattr(settings, name)
    row = layout.row()
    row.alignment = "LEFT"
    icon = "TRIA_DOWN" if opened else "TRIA_RIGHT"
    row.prop(settings, name, text=text, icon=icon, emboss=False)
    return opened


def draw_progress(layout: Any, fraction: float, text: str) -> None:
    """Draw a progress bar with per cent and text."""
    shown = f"{100 * fraction:.0f} %  {text}"
    if hasattr(layout, "progress"):
        layout.progress(factor=fraction, text=shown)
    else:
        layout.label(text=shown)


def draw_text(layout: Any, context: bpy.types.Context, text: str, icon: str = "NONE") -> None:
    """Draw a sentence in as many lines as the panel is narrow."""
    width = 240 if context.region is None else context.region.width
    scale = context.preferences.system.ui_scale
    letters = max(20, int((width / scale - 50) / CHARACTER))
    column = layout.column(align=True)
    column.scale_y = 0.8
    for number, line in enumerate(textwrap.wrap(text, letters)):
        column.label(text=line, icon=icon if number == 0 else "BLANK1" if icon != "NONE" else icon)


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
    _classes[:] = [MEDIALIS_PT_main, MEDIALIS_PT_result, *sections, MEDIALIS_PT_output]
    for made in _classes:
        bpy.utils.register_class(made)


def unregister() -> None:
    """Remove the panels."""
    for made in reversed(_classes):
        bpy.utils.unregister_class(made)
