# SPDX-License-Identifier: GPL-3.0-or-later
"""Operations as plain functions, for scripts: they take an object and return what was added.

    skeleton, = medialis_blender.surface_skeleton(bpy.data.objects["hand"], threshold="2%")

Options are the core's: lengths are fractions of the diagonal or text such as "1mm", angles degrees.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from functools import partial
from typing import Any

import bpy

from medialis import operation

from . import jobs, reading, writing


def run(
    name: str,
    chosen: bpy.types.Object,
    *,
    progress: Callable[[float, str], object] | None = None,
    **given: Any,
) -> list[bpy.types.Object]:
    """Run an operation on an object as it is seen, and add the result to the scene.

    Parameters
    ----------
    name : str
        Such as "thickness".
    chosen : Object
        A mesh, point cloud, curve, text, surface or metaball.
    progress : callable, optional
        Called with (fraction, text).
    **given
        Options of the operation, as in `medialis.run`, and those of the output
        (`writing.Options`).

    Returns
    -------
    list of Object
        Those that carry the result, the object itself where it lies on its surface. The core's
        names of values are those of their attributes.

    Raises
    ------
    MedialisError
        As `medialis.run`; nothing is added then.
    """
    wanted = {field.name for field in fields(writing.Options)}
    output = writing.Options(**{name: given.pop(name) for name in sorted(wanted & set(given))})
    source = reading.read_object(bpy.context, chosen)
    job = jobs.Job(source, name, given, f"{name} of {source.name}")
    try:
        job.wait(progress)
        shape, result = job.outcome()
    finally:
        jobs.close()
    return writing.add_result(bpy.context, source, shape, result, output)


def function(name: str) -> Callable[..., list[bpy.types.Object]]:
    """Return `run` of one operation, with its help."""
    made = partial(run, name)
    made.__doc__ = operation(name).full_help
    return made
