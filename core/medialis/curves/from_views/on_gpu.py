"""Silhouette skeletons and sharpening on a GPU: the same bits as on the processor."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.validation import FloatArray, IntArray
from medialis.curves.from_views.views import check_margin, pixels_in

if TYPE_CHECKING:
    from medialis.base.gpu import Session
    from medialis.curves.from_views._kernels import Rows
    from medialis.curves.from_views._view_kernels import PackedView

KERNELS = "curves.from_views._batch_kernels"
BYTES_A_PIXEL = 20
"""Bytes for a pixel of a picture: three arrays of `Silhouettes`, cracks and distances."""
BYTES_INSIDE = 160
"""Bytes for a pixel of the shape: envelope, crossings, cracks and, where runs are short, runs."""

Skeletons = tuple[list["Rows"], list[NDArray[np.float32]]]


def silhouette_skeletons(
    session: Session, silhouettes: Sequence[IntArray], size: int, saliency: float, with_field: bool
) -> Skeletons:
    """Return crossings of silhouettes, and distances of their pixels in the order of the runs.

    Parameters
    ----------
    session : Session
        Silhouettes are computed together as far as its memory allows; all of it is freed.
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
    """Return crossings and distances of silhouettes that fit into the memory together."""
    from medialis.curves.from_views._batch_kernels import Silhouettes
    from medialis.curves.from_views._kernels import Envelope, Found, Rows

    views, runs = len(silhouettes), np.concatenate(silhouettes)
    run_counts, pixel = np.array([*map(len, silhouettes)]), _sums(runs[:, 2] - runs[:, 1])
    view_of, first_run = np.repeat(np.arange(views, dtype=np.int32), run_counts), _sums(run_counts)
    offset, tops = session.zeros((views, size, size), "i4"), session.empty(views * size, "i4")
    indices = session.put((runs, view_of, first_run, pixel))
    session.launch(f"{KERNELS}:offset_column", len(tops), *indices[::2], offset, tops)

    first_crack = _sums(2 * (run_counts + session.get(tops).reshape(views, size).sum(axis=1)))
    cracks, pixels = int(first_crack[-1]), int(pixel[-1])
    shapes = *2 * ((offset.shape, "i4"),), (cracks, "f8"), (cracks, "i4"), (cracks // 4, "f8")
    parts: list[Any] = [session.empty(*one) for one in (*shapes, (views, "f8"))]
    parts = [*indices, session.put(first_crack), offset, *parts]
    many: Any = Silhouettes(*parts)
    counts = session.empty(views, "i8")
    session.launch(f"{KERNELS}:trace_view", views, many, counts)
    lengths, starts = session.get(many.length), first_crack[:-1] // 4
    spans = zip(starts, starts + session.get(counts), strict=True)
    longest = np.array([lengths[begin:end].sum() / 2 for begin, end in spans])
    many = many._replace(longest=session.put(longest))

    shape = (views, size, size) if with_field else (views, 0, 0)
    fields, facing = session.empty(shape, "f4"), session.empty(shape, "i4")
    scratch: list[Any] = [session.empty(pixels + 2 * len(runs), "i8") for _ in range(3)]
    out: list[Any] = [session.empty(pixels, "f8") for _ in range(3)]
    counts = session.empty(len(runs), "i8")
    arguments = many, saliency, Envelope(*scratch), Found(*out), counts, facing, fields
    session.launch(f"{KERNELS}:cross_run", len(runs), *arguments)
    if with_field:
        session.launch(f"{KERNELS}:compare_run", len(runs), many, saliency, facing, fields)

    first = _sums(session.get(counts))
    column = session.empty(int(first[-1]), "f8")
    distance = session.empty(pixels if with_field else 0, "f4")
    gathered = many, out[0], session.put(first), fields, column, distance
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
    """Return the points after sharpening by each view with its step, and whether each is kept."""
    moved, alive = session.put(points), session.put(np.ones(len(points), bool))
    for view, step in views:
        arguments = session.put(view), step, moved, alive
        session.launch(f"{KERNELS}:sharpen_point", len(points), *arguments)
    return session.get(moved), session.get(alive)
