# SPDX-License-Identifier: GPL-3.0-or-later
"""One operation on one object or on several, one after the other: read, compute, write."""

from __future__ import annotations

from contextlib import nullcontext
from typing import Any

import bpy

from medialis import Cancelled, MedialisError
from medialis.hosts import Kind, Operation, Parameter, picked_lines

from . import armatures, folders, jobs, properties, reading, summary, views, writing

FAILURES = (MedialisError, MemoryError)


def can_start(kind: Any, context: bpy.types.Context, operation: Operation) -> bool:
    """Tell whether an operation can start now; where not, its operator says why."""
    reason = reading.why_not(context, operation)
    if jobs.running is not None:
        reason = jobs.busy()
    if reason is not None:
        kind.poll_message_set(reason)
    return reason is None


class Tasks:
    """The objects that an operation is run on, and what came of it.

    Parameters
    ----------
    context : Context
        Its active object, and those selected with it, or their sources.
    operation : Operation
    holder : operator or settings
        Has the options as properties.
    """

    def __init__(self, context: bpy.types.Context, operation: Operation, holder: Any) -> None:
        self._waiting = [_key(chosen) for chosen in reading.targets(context, operation)]
        self._of = len(self._waiting)
        self._operation = operation
        self._parameters = properties.parameters_of(operation, holder)
        self._options = properties.options_of(holder)
        self._gpu_views = views.chosen(getattr(holder, "views_by", "CPU"))
        self._told: list[str] = []
        self._kept: list[str] = []
        self._failed: list[tuple[str, Exception]] = []
        self.job: jobs.Job
        self.armature: tuple[str, str | None] | None = None

    def begin_next(self, context: bpy.types.Context) -> bool:
        """Read the next object that can be read and begin; return whether there was one."""
        while self._waiting:
            key = self._waiting.pop(0)
            try:
                self.job = self._begin(context, key)
            except FAILURES as error:
                self._failed.append((key[0], error))
            else:
                return True
        return False

    def write(self, context: bpy.types.Context) -> None:
        """Write what was computed; after cancelling nothing else begins."""
        source = self.job.source
        try:
            shape, result = self.job.outcome()
            writing.add_result(
                context, source, shape, result, self._options, self._kept.append, self.armature
            )
        except FAILURES as error:
            self._failed.append((source.name, error))
            if isinstance(error, Cancelled):
                self._waiting.clear()
        else:
            self._told.append(summary.headline(result, result.layers, source.name))
        finally:
            jobs.close()

    def tell(self, operator: bpy.types.Operator) -> set[str]:
        """Report what came of it; return what the operator returns."""
        for text in (*self._told, *self._kept):
            operator.report({"INFO"}, text)
        for name, error in self._failed:
            text = str(error)
            if isinstance(error, MemoryError):
                text = "There is not enough memory for this object and these options."
            if self._of > 1 and name not in text:
                text = f"{name}: {text}"
            kind = "WARNING" if self._told else "ERROR"
            operator.report({"INFO" if isinstance(error, Cancelled) else kind}, text)
        return {"FINISHED" if self._told else "CANCELLED"}

    def _begin(self, context: bpy.types.Context, key: tuple[str, str | None]) -> jobs.Job:
        chosen = bpy.data.objects.get(key)
        if chosen is None:
            raise MedialisError(f"{key[0]} was deleted or renamed meanwhile: it was left out.")
        takes = next((p for p in self._operation.parameters if p.bones), None)
        armature = None
        if takes is not None and not self._parameters[takes.name]:
            armature = armatures.of_user(context, chosen)
        at_rest = self._options.bind or armature is not None
        with armatures.at_rest(context, chosen, armature) if at_rest else nullcontext():
            source = reading.read_object(context, chosen)
        self.armature = None if armature is None else _key(armature)
        if self._options.bind and source.on_data:
            armatures.require_unbound(chosen)
        number = self._of - len(self._waiting)
        label = f"{self._operation.label} of {source.name}"
        if self._of > 1:
            label += f" ({number} of {self._of})"
        return jobs.Job(
            source,
            self._operation.name,
            {**self._parameters, **self._picked(chosen, source), **self._bones(takes, source)},
            label,
            gpu_views=self._gpu_views,
        )

    def _bones(self, takes: Parameter | None, source: reading.Source) -> dict[str, str]:
        """Return the option that takes bones: a file of those of the user's armature."""
        if takes is None or self.armature is None:
            return {}
        path = folders.exchange() / "medialis-bones.json"
        armatures.hand_over(bpy.data.objects[self.armature], source, path)
        return {takes.name: str(path)}

    def _picked(self, chosen: bpy.types.Object, source: reading.Source) -> dict[str, str]:
        """Return the first option that lists vertices, if none is given: a file of those selected.

        Raises
        ------
        InvalidOptionError
            When others were needed.
        """
        lists = [p for p in self._operation.parameters if p.kind is Kind.FILE and p.selection]
        if not lists or any(self._parameters[p.name] for p in lists):
            return {}
        vertices = reading.selected_vertices(chosen, source)
        if not len(vertices):
            return {}
        path = folders.exchange() / "medialis-selected.txt"
        path.write_text(picked_lines(lists[0], vertices))
        return {lists[0].name: str(path)}


def _key(chosen: bpy.types.Object) -> tuple[str, str | None]:
    """Return name and library: pointers to objects do not survive undo."""
    return chosen.name, None if chosen.library is None else chosen.library.filepath
