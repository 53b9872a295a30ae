"""Kernels for GPUs: each thread processes one item, which is a column, a view, a run or a point.

The bodies are kernels of `_kernels.py` and `_view_kernels.py` that the processor calls as well. The
kernels here select the view, the run and the scratch memory of an item.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base.jit import kernel
from medialis.curves.from_views._kernels import (
    Contours,
    Envelope,
    column_offsets,
    compare_rows,
    run_crossings,
    trace_contours,
)
from medialis.curves.from_views._view_kernels import cull_and_sharpen


class Silhouettes(NamedTuple):
    """Silhouettes and contours of v views: the arrays of `Contours`, concatenated.

    Attributes
    ----------
    runs : (r, 3) int32
    view_of : (r,) int32
        View of each run.
    first_run : (v + 1,) int64
        Index of the first run of each view.
    pixel : (r + 1,) int64
        Index of the first pixel of each run.
    first_crack : (v + 1,) int64
        Index of the first crack of each view.
    offset, upright, flat : (v, h, w) int32
    arc, contour, length : (c,) float64, (c,) int32, (c / 4,) float64
    longest : (v,) float64
    """

    runs: NDArray[np.int32]
    view_of: NDArray[np.int32]
    first_run: NDArray[np.int64]
    pixel: NDArray[np.int64]
    first_crack: NDArray[np.int64]
    offset: NDArray[np.int32]
    upright: NDArray[np.int32]
    flat: NDArray[np.int32]
    arc: NDArray[np.float64]
    contour: NDArray[np.int32]
    length: NDArray[np.float64]
    longest: NDArray[np.float64]


@kernel
def contours_in(many, view):
    """Return the contours of a view."""
    runs = many.runs[many.first_run[view] : many.first_run[view + 1]]
    first, last = many.first_crack[view], many.first_crack[view + 1]
    return Contours(
        many.offset[view], runs, many.upright[view], many.flat[view], many.arc[first:last],
        many.contour[first:last], many.length[first // 4 : last // 4], many.longest[view],
    )  # fmt: skip


@kernel
def offset_column(item, runs, first_run, offset, out_tops):
    """Call `column_offsets` for a column of a view."""
    width = offset.shape[2]
    view, column = item // width, item % width
    some = runs[first_run[view] : first_run[view + 1]]
    out_tops[item] = column_offsets(some, column, column + 1, offset[view])


@kernel
def trace_view(item, many, out_count):
    """Trace the contours of a view."""
    out_count[item] = trace_contours(contours_in(many, item))


@kernel
def cross_run(item, many, saliency, scratch, out, out_count, out_cracks, out_fields):
    """Call `run_crossings` for a run; `out` has room for one crossing per pixel."""
    view, begin = many.view_of[item], many.pixel[item]
    run, room = item - many.first_run[view], begin + 2 * item
    own = Envelope(scratch.column[room:], scratch.key[room:], scratch.start[room:])
    contours, cracks, field = contours_in(many, view), out_cracks[view], out_fields[view]
    out_count[item] = run_crossings(run, contours, saliency, own, begin, out, cracks, field)


@kernel
def compare_run(item, many, saliency, cracks, out_fields):
    """Call `compare_rows` for a run."""
    view = many.view_of[item]
    run, contours = item - many.first_run[view], contours_in(many, view)
    compare_rows(run, contours, saliency, cracks[view], out_fields[view])


@kernel
def gather_run(item, many, column, first, fields, out_column, out_distance):
    """Copy the crossings of a run to `out_column` from first[item] on, and its distances."""
    begin = many.pixel[item]
    for k in range(first[item + 1] - first[item]):
        out_column[first[item] + k] = column[begin + k]
    field, row, left = fields[many.view_of[item]], many.runs[item, 0], many.runs[item, 1]
    if len(field) > 0:
        for k in range(many.runs[item, 2] - left):
            out_distance[begin + k] = field[row, left + k]


@kernel
def sharpen_point(item, view, step, points, alive):
    """Call `cull_and_sharpen` for a point."""
    cull_and_sharpen(view, step, item, item + 1, points, alive)
