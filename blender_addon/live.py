# SPDX-License-Identifier: GPL-3.0-or-later
"""Live results: where an option of the active result changes in the panel, it is computed anew.

The process that computes has kept the stages before, so that late options are answered at once.
What is computed while the slider moves on is cancelled.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy

from . import jobs, removing

DELAY = 0.15
"""Seconds without another change before it begins."""

_wanted: Callable[[], dict[str, Any]] | None = None
_name = ""


def updates(name: str, values: Callable[[], dict[str, Any]]) -> Callable[..., None]:
    """Return what Blender calls when an option of an operation changes in the panel.

    Parameters
    ----------
    name : str
        Operation.
    values : callable
        Returns all options for its operator.
    """

    def update(settings: Any, context: bpy.types.Context) -> None:
        global _name, _wanted
        active = context.view_layer.objects.active
        if not context.scene.medialis.live or removing.operation_of(active) != name:
            return
        _name, _wanted = name, values
        if bpy.app.timers.is_registered(run):
            bpy.app.timers.unregister(run)
        bpy.app.timers.register(run, first_interval=DELAY)

    return update


def run() -> float | None:
    """Compute the active result anew; as a timer, come again while something else is computed."""
    global _wanted
    if _wanted is None:
        return None
    if jobs.running is not None:
        if jobs.running.name == _name:
            jobs.running.cancel()  # its operator ends at its next look
        return DELAY
    values, _wanted = _wanted(), None
    operator = getattr(bpy.ops.medialis, _name)
    windows = bpy.context.window_manager.windows
    with bpy.context.temp_override(**({"window": windows[0]} if len(windows) else {})):
        if operator.poll():
            operator("INVOKE_DEFAULT", True, **values)
    return None


def unregister() -> None:
    """Forget what was wanted."""
    global _wanted
    _wanted = None
    if bpy.app.timers.is_registered(run):
        bpy.app.timers.unregister(run)


def register() -> None:
    """Nothing is there before an option changes."""
