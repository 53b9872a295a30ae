"""Silhouette skeletons and sharpening on a GPU: the same bits as on the processor."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from medialis.base.gpu import Session
from medialis.base.validation import FloatArray, IntArray
from medialis.curves.from_views.views import check_margin, pixels_in

if TYPE_CHECKING:
    from medialis.curves.from_views._kernels import Rows
    from medialis.curves.from_views._view_kernels import PackedView

KERNELS = "curves.from_views._batch_kernels"
BYTES_A_PIXEL = 20
"""Memory for a pixel of a picture: three pictures of `Silhouettes`, cracks and distances."""
BYTES_INSIDE = 160
"""Memory for a pixel of the shape: envelope, crossings, cracks and, where runs are short, runs."""

Skeletons = tuple[list["Rows"], list[NDArray[np.float32]]]


def silhouette_skeletons(
    session: Session, silhouettes: Sequence[IntArray], size: int, saliency: float, with_field: bool
) -> Skeletons:
    """Return crossings of silhouettes, and distances of their pixels in the order of the runs.

    Parameters
    ----------
    session : Session
        It computes as many as its memory holds at a time, and frees all of it.
    silhouettes : sequence of (r, 3) int32
        Runs of each silhouette (`Contours`).
    size : int
        Width and height of the pictures in pixels.
    saliency : float
    with_field : bool
        Whether distances are needed.
    """
    for runs in silhouettes:
        check_margin(runs, size)
    largest = max(map(pixels_in, silhouettes), default=0)
    at_once = max(session.room() // (BYTES_A_PIXEL * size * size + BYTES_INSIDE * largest), 1)
    rows: list[Rows] = []
    distances: list[NDArray[np.float32]] = []
    for begin in range(0, len(silhouettes), at_once):
        some = silhouettes[begin : begin + at_once]
        parts = _skeletons(session, some, size, saliency, with_field)
        rows, distances = rows + parts[0], distances + parts[1]
        session.close()
    return rows, distances


def _skeletons(
    session: Session, silhouettes: Sequence[IntArray], size: int, saliency: float, with_field: bool
) -> Skeletons:
    from medialis.curves.from_views._batch_kernels import Silhouettes
    from medialis.curves.from_views._kernels import Envelope, Found, Rows

    views, runs = len(silhouettes), np.concatenate(silhouettes)
    run_counts, pixel = np.array([*map(len, silhouettes)]), _sums(runs[:, 2] - runs[:, 1])
    first_run, pixels, view = _sums(run_counts), int(pixel[-1]), np.arange(views, dtype=np.int32)
    offset, tops = session.zeros((views, size, size), "i4"), session.empty(views * size, "i4")
    on_device = session.put((runs, np.repeat(view, run_counts), first_run, pixel))
    given = on_device[0], on_device[2], offset, tops
    session.launch(f"{KERNELS}:offset_column", views * size, *given)
    first_crack = _sums(2 * (run_counts + session.get(tops).reshape(views, size).sum(axis=1)))
    cracks, pictures = int(first_crack[-1]), [session.empty(offset.shape, "i4") for _ in range(2)]
    many = Silhouettes(
        *on_device[:3], session.put(first_crack), on_device[3], offset, *pictures,
        session.empty(cracks, "f8"), session.empty(cracks, "i4"), session.empty(cracks // 4, "f8"),
        session.zeros(views, "f8"),
    )  # fmt: skip
    counts = session.empty(views, "i8")
    session.launch(f"{KERNELS}:trace_view", views, many, counts)
    lengths, ends = session.get(many.length), first_crack[:-1] // 4 + session.get(counts)
    spans = zip(first_crack // 4, ends, strict=False)
    longest = np.array([lengths[begin:end].sum() / 2 for begin, end in spans])
    many = many._replace(longest=session.put(longest))
    shape = (views, size, size) if with_field else (views, 0, 0)
    fields, cracks_of = session.empty(shape, "f4"), session.empty(shape, "i4")
    scratch = Envelope(*(session.empty(pixels + 2 * len(runs), "i8") for _ in range(3)))
    crossings = Found(*(session.empty(pixels, "f8") for _ in range(3)))
    counts = session.empty(len(runs), "i8")
    out = scratch, crossings, counts, cracks_of, fields
    session.launch(f"{KERNELS}:cross_run", len(runs), many, saliency, *out)
    if with_field:
        session.launch(f"{KERNELS}:compare_run", len(runs), many, saliency, cracks_of, fields)
    first = _sums(session.get(counts))
    column = session.empty(int(first[-1]), "f8")
    distance = session.empty(pixels if with_field else 0, "f4")
    gathered = many, crossings.column, session.put(first), fields, column, distance
    session.launch(f"{KERNELS}:gather_run", len(runs), *gathered)
    columns, rows = session.get(column), []
    for a, b in pairwise(first_run):
        begin = first[a + np.searchsorted(runs[a:b, 0], np.arange(size + 1))] - first[a]
        rows.append(Rows(begin.astype(np.int32), columns[first[a] : first[b]]))
    return rows, np.split(session.get(distance), pixel[first_run[1:-1]])


def _sums(counts: NDArray[np.integer]) -> NDArray[np.int64]:
    """Return the sums of the counts before each one, and the sum of all."""
    return np.concatenate([[0], np.cumsum(counts, dtype=np.int64)])


def sharpened(
    views: Sequence[tuple[PackedView, float]], points: FloatArray, session: Session
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return the points after each view and its step has moved them, and which ones are kept."""
    moved, alive = session.put(points), session.put(np.ones(len(points), bool))
    for view, step in views:
        arguments = session.put(view), step, moved, alive
        session.launch(f"{KERNELS}:sharpen_point", len(points), *arguments)
    return session.get(moved), session.get(alive)
