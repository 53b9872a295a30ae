# SPDX-License-Identifier: GPL-3.0-or-later
"""What panels draw: options with their names in front, folds, bars, sentences."""

from __future__ import annotations

import textwrap
from typing import Any

import bpy

from medialis.hosts import Operation, Parameter

from .properties import EXTRAS, SWITCH_PREFIX, shown_name

CHARACTER = 7.0
"""Pixels of a letter of the panel, on average, at Blender's standard scale."""


def draw_options(
    layout: Any, operation: Operation, holder: Any, lengths_in: str, *, fold: bool = True
) -> None:
    """Draw the options of an operation; rare ones below More where `fold`."""
    column = layout.column()
    column.use_property_split, column.use_property_decorate = True, False
    for parameter in operation.parameters:
        if not parameter.advanced:
            draw_option(column, parameter, holder, lengths_in)
    for name in EXTRAS.get(operation.name, {}):
        column.prop(holder, name)
    advanced = [parameter for parameter in operation.parameters if parameter.advanced]
    if advanced and (not fold or draw_fold(column, holder, "unfolded_more", "More")):
        for parameter in advanced:
            draw_option(column, parameter, holder, lengths_in)


def draw_option(layout: Any, parameter: Parameter, holder: Any, lengths_in: str) -> None:
    """Draw one option; an automatic one with its switch, and grey where that is off."""
    name = shown_name(parameter, lengths_in)
    if parameter.auto is None:
        layout.prop(holder, name)
        return
    row = layout.row(heading=parameter.label)
    row.prop(holder, SWITCH_PREFIX + parameter.name, text="")
    number = row.row()
    number.enabled = getattr(holder, SWITCH_PREFIX + parameter.name)
    number.prop(holder, name, text="")


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
