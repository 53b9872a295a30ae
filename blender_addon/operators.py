# SPDX-License-Identifier: GPL-3.0-or-later
"""One operator for each operation of the core: read, compute, write, report."""

from __future__ import annotations

from typing import Any, ClassVar

import bpy

from medialis import OPERATIONS, MedialisError, Progress, Result, Shape
from medialis.hosts import Operation

from . import armatures, jobs, properties, reading, summary, views, writing

STEP = 0.1
"""Seconds between two looks at a running job."""


class OperationOperator:
    """What the operators of all operations do.

    From a button or menu the computation runs in a thread and the operator is modal; from a script,
    in background mode and for the redo panel it computes at once.
    """

    operation: ClassVar[Operation]

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Allow the operator when the active object can be used; say why where it cannot."""
        reason = reading.why_not(context, cls.operation)
        if jobs.running is not None:
            reason = f"{jobs.running.label} is being computed: wait for it, or press Esc"
        if reason is not None:
            cls.poll_message_set(reason)
        return reason is None

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Read, compute and write, all before returning."""
        manager = context.window_manager
        manager.progress_begin(0, 100)

        def report(fraction: float, text: str) -> None:
            manager.progress_update(int(100 * fraction))

        try:
            source = self._read(context)
            parameters = properties.parameters_of(self.operation, self)
            progress = Progress(report)
            desk = views.ViewDesk(progress.note) if self._gpu_views() else None
            factory = None if desk is None else desk.factory
            found = jobs.compute(source, self.operation.name, parameters, progress, factory)
            return self._write(context, source, *found)
        except (MedialisError, MemoryError) as error:
            return self._fail(error)
        finally:
            manager.progress_end()

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Read, and start computing in a thread."""
        if bpy.app.background or context.window is None:
            return self.execute(context)
        try:
            source = self._read(context)
        except (MedialisError, MemoryError) as error:
            return self._fail(error)
        parameters = properties.parameters_of(self.operation, self)
        label = f"{self.operation.label} of {source.name}"
        self._job = jobs.Job(
            source, self.operation.name, parameters, label, gpu_views=self._gpu_views()
        )
        manager = context.window_manager
        self._timer = manager.event_timer_add(STEP, window=context.window)
        manager.progress_begin(0, 100)
        manager.modal_handler_add(self)
        self._job.start()
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Show progress, cancel on Esc, write when the thread is done; everything else passes."""
        job = self._job
        if event.type == "ESC" and event.value == "PRESS":
            job.cancel()
            return {"RUNNING_MODAL"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        job.serve()
        if not job.done:
            context.window_manager.progress_update(int(100 * job.fraction))
            context.workspace.status_text_set(
                f"{job.label}: {job.text}, {100 * job.fraction:.0f} %   (Esc cancels)"
            )
            redraw(context)
            return {"PASS_THROUGH"}
        self._end(context)
        try:
            return self._write(context, job.source, *job.outcome())
        except (MedialisError, MemoryError) as error:
            return self._fail(error)

    def cancel(self, context: bpy.types.Context) -> None:
        """Stop when Blender ends the operator, as on closing the window or loading a file."""
        self._job.cancel()
        self._end(context)

    def _end(self, context: bpy.types.Context) -> None:
        self._job.close()
        context.window_manager.event_timer_remove(self._timer)
        context.window_manager.progress_end()
        if context.workspace is not None:
            context.workspace.status_text_set(None)
        redraw(context)

    def _read(self, context: bpy.types.Context) -> reading.Source:
        chosen = reading.target(context)
        source = reading.read_object(context, chosen)
        if getattr(self, "bind", False) and source.on_data:
            armatures.require_unbound(chosen)
        return source

    def _gpu_views(self) -> bool:
        return views.chosen(getattr(self, "views_by", "CPU"))

    def _write(
        self, context: bpy.types.Context, source: reading.Source, shape: Shape, result: Result
    ) -> set[str]:
        options = properties.options_of(self)
        writing.add_result(context, source, shape, result, options)
        self.report({"INFO"}, summary.headline(result, result.layers, source.name))
        return {"FINISHED"}

    def _fail(self, error: BaseException) -> set[str]:
        text = str(error)
        if isinstance(error, MemoryError):
            text = "There is not enough memory for this object and these options."
        self.report({"ERROR"}, text)
        return {"CANCELLED"}


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
    """Show the colours of the result in this view; its source becomes a wire where it hides it"""  # noqa: D400 - a tooltip

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
        on_surface = active.type == "MESH" and active.data.color_attributes.active_color
        if on_surface:
            shading.type, shading.color_type = "SOLID", "VERTEX"
            if active.display_type == "WIRE":  # as the colours of its skeleton have left it
                active.display_type = "TEXTURED"
        else:
            shading.type = "MATERIAL"
            if active.get(reading.RESULT) and active.parent is not None:
                active.parent.display_type = "WIRE"
        return {"FINISHED"}


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
        "__annotations__": {**properties.annotations_of(operation), **properties.OPTIONS},
    }
    return type(f"MEDIALIS_OT_{operation.name}", (OperationOperator, bpy.types.Operator), about)


_classes: list[type] = []


def register() -> None:
    """Add all operators."""
    _classes[:] = [operator_of(operation) for operation in OPERATIONS]
    _classes.extend([MEDIALIS_OT_cancel_computation, MEDIALIS_OT_show_colors])
    for made in _classes:
        bpy.utils.register_class(made)


def unregister() -> None:
    """Remove all operators."""
    for made in reversed(_classes):
        bpy.utils.unregister_class(made)
