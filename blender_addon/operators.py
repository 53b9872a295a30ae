# SPDX-License-Identifier: GPL-3.0-or-later
"""One operator for each operation of the core: read, compute, write, report."""

from __future__ import annotations

from typing import Any, ClassVar

import bpy
from bpy.props import BoolProperty, StringProperty

from medialis import OPERATIONS
from medialis.hosts import Operation

from . import jobs, looks, placing, properties, reading, removing, tasks, widgets, writing

STEP = 0.1
"""Seconds between two looks at a running job."""


class OperationOperator:
    """What the operators of all operations do.

    The computation runs in a process of its own. From a button or menu the operator is modal; from
    a script, in background mode and for the redo panel it waits for the result.
    """

    operation: ClassVar[Operation]

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Allow the operator when the active object can be used; say why where it cannot."""
        return tasks.can_start(cls, context, cls.operation)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Read, compute and write, all before returning."""
        manager = context.window_manager
        manager.progress_begin(0, 100)
        self._tasks = tasks.Tasks(context, self.operation, self)
        try:
            while self._tasks.begin_next(context):
                job = self._tasks.job
                job.wait(lambda fraction, text: manager.progress_update(int(100 * fraction)))
                self._tasks.write(context)
        finally:
            jobs.close()
            manager.progress_end()
        return self._tasks.tell(self)

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the options in the redo panel."""
        layout = self.layout
        widgets.draw_options(layout, self.operation, self, self.lengths_in, fold=False)
        layout.use_property_split, layout.use_property_decorate = True, False
        for name in properties.OPTIONS:
            layout.prop(self, name)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Read, and begin to compute."""
        if bpy.app.background or context.window is None:
            return self.execute(context)
        self._tasks = tasks.Tasks(context, self.operation, self)
        if not self._tasks.begin_next(context):
            return self._tasks.tell(self)
        manager = context.window_manager
        self._timer = manager.event_timer_add(STEP, window=context.window)
        manager.progress_begin(0, 100)
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Show progress, cancel on Esc, write when the result is there; everything else passes."""
        job = self._tasks.job
        if event.type == "ESC" and event.value == "PRESS":
            job.cancel()
        elif event.type != "TIMER":
            return {"PASS_THROUGH"}
        if not job.look():
            context.window_manager.progress_update(int(100 * job.fraction))
            context.workspace.status_text_set(draw_status)
            redraw(context)
            return {"PASS_THROUGH"}
        self._tasks.write(context)
        if self._tasks.begin_next(context):
            return {"PASS_THROUGH"}
        self._end(context)
        return self._tasks.tell(self)

    def cancel(self, context: bpy.types.Context) -> None:
        """Stop when Blender ends the operator, as on closing the window or loading a file."""
        self._end(context)

    def _end(self, context: bpy.types.Context) -> None:
        jobs.close()
        context.window_manager.event_timer_remove(self._timer)
        context.window_manager.progress_end()
        if context.workspace is not None:
            context.workspace.status_text_set(None)
        redraw(context)


class MEDIALIS_OT_cancel_computation(bpy.types.Operator):
    """Stop the running computation; nothing is added"""  # noqa: D400 - a tooltip

    bl_idname = "medialis.cancel_computation"
    bl_label = "Cancel"
    bl_options: ClassVar = {"INTERNAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Ask the job to stop."""
        if jobs.running is not None:
            jobs.running.cancel()
        return {"FINISHED"}


class MEDIALIS_OT_show_colors(bpy.types.Operator):
    """Show the colours of the result in the views of this window"""  # noqa: D400 - a tooltip

    bl_idname = "medialis.show_colors"
    bl_label = "Show Colours"
    bl_options: ClassVar = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Allow it for results in a 3D view."""
        space = context.space_data
        return context.active_object is not None and getattr(space, "type", "") == "VIEW_3D"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Set the shading of the view."""
        active, shading = context.active_object, context.space_data.shading
        if active.type == "MESH" and active.data.color_attributes.active_color:
            shading.type, shading.color_type = "SOLID", "VERTEX"
        else:
            shading.type = "MATERIAL"
        return {"FINISHED"}


class MEDIALIS_OT_own_look(bpy.types.Operator):
    """Show the object with its own materials again; results stay"""  # noqa: D400 - a tooltip

    bl_idname = "medialis.own_look"
    bl_label = "Own Look"
    bl_options: ClassVar = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Allow it where a result changed the look."""
        source = reading.target(context)
        return source is not None and looks.is_changed(source)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Take the modifier away."""
        looks.own_look(reading.target(context))
        return {"FINISHED"}


class MEDIALIS_OT_show_result(bpy.types.Operator):
    """Show or hide a result: its objects, and its colours on the surface"""  # noqa: D400 - a tooltip

    bl_idname = "medialis.show_result"
    bl_label = "Show or Hide Results"
    bl_options: ClassVar = {"REGISTER", "UNDO"}
    __annotations__: ClassVar = {
        "result": StringProperty(name="Result", description="Operation; none: all results"),
        "solo": BoolProperty(name="Solo", description="Hide the others"),
    }

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Allow it where there are results."""
        source = reading.target(context)
        return source is not None and bool(removing.records_of(source))

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Turn it on or off, or the others off; then the source or a result is active."""
        source = reading.target(context)
        records = removing.records_of(source)
        wanted = [one.operation for one in records if self.result in ("", one.operation)]
        if not wanted:
            self.report({"ERROR"}, f"{source.name} has no result of {self.result}.")
            return {"CANCELLED"}
        shown = {one.operation for one in records if one.shown}
        if self.solo and self.result:
            shown = {self.result}
        else:
            shown = shown - {*wanted} if shown & {*wanted} else {*shown, wanted[-1]}
        removing.show(context, source, shown)
        found = removing.results_of(source, removing.operation_of(source))
        visible = [one for one in found if one.visible_get() and not one.hide_render]
        placing.make_active(context, next(iter(visible), source))
        return {"FINISHED"}


class MEDIALIS_OT_remove_result(bpy.types.Operator):
    """Remove the result and all that it brought; what was edited stays"""  # noqa: D400 - a tooltip

    bl_idname = "medialis.remove_result"
    bl_label = "Remove Result"
    bl_options: ClassVar = {"REGISTER", "UNDO"}
    __annotations__: ClassVar = {
        "result": StringProperty(
            name="Result", description="Operation; none: that of the active object"
        ),
    }

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Allow it for results and their sources."""
        return bool(removing.operation_of(context.active_object))

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Remove the operation's result; the source is active afterwards."""
        active = context.active_object
        source, operation = reading.source_of(active), self.result or removing.operation_of(active)
        if source is None:
            self.report({"ERROR"}, "The object of this result is gone: delete it with X.")
            return {"CANCELLED"}
        writing.leave_edit_mode(context, active)
        for told in removing.remove_result(context, source, operation):
            self.report({"INFO"}, told)
        placing.make_active(context, source)
        return {"FINISHED"}


def draw_status(self: bpy.types.Header, context: bpy.types.Context) -> None:
    """Draw the running job in the status bar."""
    job = jobs.running
    if job is not None:
        self.layout.label(text="Cancel", icon="EVENT_ESC")
        self.layout.label(text=f"{job.label}: {job.text}, {100 * job.fraction:.0f} %")


def redraw(context: bpy.types.Context) -> None:
    """Draw the side panels of all 3D views anew."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


def operator_of(operation: Operation) -> type:
    """Return the operator class `medialis.<name>` of an operation."""
    about: dict[str, Any] = {
        "operation": operation,
        "bl_idname": f"medialis.{operation.name}",
        "bl_label": operation.label,
        "bl_description": operation.help.splitlines()[0].removesuffix("."),
        "bl_options": {"REGISTER", "UNDO"},
        "__doc__": operation.help,
        "__module__": __name__,
        "__annotations__": {
            **properties.annotations_of(operation),
            **properties.OPTIONS,
            "lengths_in": properties.lengths_in(),
        },
    }
    return type(f"MEDIALIS_OT_{operation.name}", (OperationOperator, bpy.types.Operator), about)


_classes: list[type] = []


def register() -> None:
    """Add all operators."""
    _classes[:] = [operator_of(operation) for operation in OPERATIONS]
    _classes.extend(
        [
            MEDIALIS_OT_cancel_computation,
            MEDIALIS_OT_show_colors,
            MEDIALIS_OT_own_look,
            MEDIALIS_OT_show_result,
            MEDIALIS_OT_remove_result,
        ]
    )
    for made in _classes:
        bpy.utils.register_class(made)


def unregister() -> None:
    """Remove all operators."""
    for made in reversed(_classes):
        bpy.utils.unregister_class(made)
