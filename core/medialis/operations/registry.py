"""All operations, and the one function that runs any of them."""

from __future__ import annotations

import time
from dataclasses import fields
from typing import Any

from medialis.errors import InvalidOptionError, InvalidShapeError
from medialis.model.shape import Shape
from medialis.operations import (
    armature,
    ball_reconstruction,
    curve_skeleton,
    denoise,
    geodesic_path,
    manifolds,
    mean_shift_segments,
    medial_sheets,
    parts,
    patches,
    point_types,
    skeleton_importance,
    skeleton_mesh,
    soft_edges,
    surface_skeleton,
    thickness,
    view_curve_skeleton,
)
from medialis.operations.declaration import Operation
from medialis.operations.result import Outcome, Result
from medialis.progress import Progress, ProgressCallback
from medialis.threads import thread_limit

OPERATIONS: tuple[Operation, ...] = (
    surface_skeleton.OPERATION,
    skeleton_importance.OPERATION,
    ball_reconstruction.OPERATION,
    thickness.OPERATION,
    geodesic_path.OPERATION,
    skeleton_mesh.OPERATION,
    curve_skeleton.OPERATION,
    view_curve_skeleton.OPERATION,
    armature.OPERATION,
    point_types.OPERATION,
    medial_sheets.OPERATION,
    soft_edges.OPERATION,
    patches.OPERATION,
    parts.OPERATION,
    manifolds.OPERATION,
    denoise.OPERATION,
    mean_shift_segments.OPERATION,
)


SMALLEST_SIZE, LARGEST_SIZE = 1e-30, 1e30
"""Diagonals for which sixth powers and the float32 depths of pictures stay in range."""


def operation(name: str) -> Operation:
    """Return an operation by its name, its name with dashes, or its MeshLab-style name.

    Raises
    ------
    InvalidOptionError
        When there is none; the sentence lists them.
    """
    for candidate in OPERATIONS:
        if name in (candidate.name, candidate.name.replace("_", "-"), candidate.filter_name):
            return candidate
    known = ", ".join(candidate.name for candidate in OPERATIONS)
    raise InvalidOptionError(f"There is no operation {name!r}; there are {known}.")


def run(
    name: str,
    shape: Shape,
    *,
    threads: int | None = None,
    progress: Progress | ProgressCallback | None = None,
    **parameters: Any,
) -> Result:
    """Run any registered operation on a shape, as every host does.

    Unlike the plain functions it refines a mesh that is too coarse, and it raises when there is
    nothing to show.

    Parameters
    ----------
    name : str
        As in `operation`.
    shape : Shape
        From `read_shape` or `make_shape`.
    threads : int, optional
        At most this many; all processors when missing.
    progress : callable, optional
        Called with (fraction, text); returning False cancels.
    **parameters
        Parameters of the operation; lengths are fractions of the bounding-box diagonal.

    Raises
    ------
    InvalidOptionError
        For an unknown operation or parameter, or a bad value.
    InvalidShapeError
        When the shape cannot be used, or its diagonal is not within 1e-30 to 1e30.
    Cancelled
        When `progress` asks for it.

    Examples
    --------
    >>> import medialis
    >>> result = medialis.run("surface_skeleton", medialis.organic_shape(56), subsample=0.01)
    >>> result.layers[0].name, result.values["skeleton_points"] > 100
    ('surface_skeleton', True)
    """
    chosen = operation(name)
    resolved = chosen.resolve(parameters)
    _require_size(shape)
    progress = Progress.of(progress)
    clock = time.perf_counter()
    with thread_limit(threads):
        outcome = chosen.run(shape, resolved, progress)
    progress.seconds["total"] = time.perf_counter() - clock
    return Result(
        **{f.name: getattr(outcome, f.name) for f in fields(Outcome)},
        operation=chosen.name,
        parameters=resolved,
        seconds=dict(progress.seconds),
        messages=tuple(progress.messages),
    )


def _require_size(shape: Shape) -> None:
    """Refuse sizes for which areas and pictures would overflow or vanish; 0 has its own sentences.

    Raises
    ------
    InvalidShapeError
    """
    if shape.diagonal > 0 and not SMALLEST_SIZE <= shape.diagonal <= LARGEST_SIZE:
        raise InvalidShapeError(
            f"The bounding-box diagonal must be within {SMALLEST_SIZE:g} to {LARGEST_SIZE:g}, got "
            f"{shape.diagonal:g}: scale the shape to another unit."
        )
