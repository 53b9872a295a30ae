"""The nearest others of each point of a set, by a box tree over it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis._kernels.box_tree import build_box_tree
from medialis.progress import Progress
from medialis.threads import run_chunks, run_patiently

LEAVES_A_CHUNK = 128


def nearest_others(
    points: NDArray[np.float64], count: int, progress: Progress | None = None
) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """Find the nearest other points of each point: indices and distances, nearest first.

    Parameters
    ----------
    points : (n, 3) float64
    count : int
    progress : Progress, optional

    Returns
    -------
    (n, count) int32
        Equally near ones in either order. With fewer than count + 1 points there are fewer columns.
    (n, count) float64

    Notes
    -----
    Cost O(n log n); a third of a kd-tree of scipy for 10 neighbours.

    Examples
    --------
    >>> near, distance = nearest_others(np.array([[0.0, 0, 0], [1, 0, 0], [3, 0, 0]]), 1)
    >>> near.ravel().tolist(), distance.ravel().tolist()
    ([1, 0, 1], [1.0, 1.0, 2.0])
    """
    from medialis._kernels.neighbour_kernels import nearest_in_tree

    still = Progress() if progress is None else progress
    n, columns = len(points), max(min(count, len(points) - 1), 0)
    near, distance = np.empty((n, columns), np.int32), np.empty((n, columns))
    if columns == 0:
        return near, distance
    tree = run_patiently(
        lambda: build_box_tree(points, np.zeros_like(points), allocate=_exactly), still
    )

    def work(begin: int, end: int) -> None:
        nearest_in_tree(
            begin, end, tree.points, tree.order, tree.blocks, tree.bounds, tree.child, tree.depth,
            distance, near,
        )  # fmt: skip

    run_chunks(work, len(tree.blocks), LEAVES_A_CHUNK, progress=progress)
    return near, distance


def _exactly(name: str, shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
    """Give an array; bounds in double precision, for points closer than single can tell."""
    return np.empty(shape, np.float64 if name == "bounds" else dtype)
