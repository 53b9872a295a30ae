"""Ball shrinking on a GPU: the tree is uploaded once, balls are computed in blocks."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.device import UNMEASURED, on_gpu
from medialis.base.progress import Progress

if TYPE_CHECKING:
    from medialis.base._box_tree_kernels import BoxTree
    from medialis.base.gpu import Session

BALLS_A_BLOCK = 1 << 22
"""Limits the memory of tangents and results to about 0.3 GB."""

NAME = "skeleton._ball_kernels:shrink_apart"


def shrink_there(
    lengths: Any, begin: int, end: int, tree: BoxTree, sign: int, out: tuple[NDArray[Any], ...],
    tangents: Any, progress: Progress,
) -> bool:  # fmt: skip
    """Do the work of `Shrinking.run` on the GPU if one is used; return whether it was."""
    work = partial(_shrink, lengths, begin, end, tree, sign, out, tangents, progress)
    return on_gpu(work, end - begin, UNMEASURED, progress) is not None


def _shrink(
    lengths: Any, begin: int, end: int, tree: BoxTree, sign: int, out: tuple[NDArray[Any], ...],
    tangents: Any, progress: Progress, session: Session,
) -> bool:  # fmt: skip
    from medialis.skeleton._ball_kernels import GROUP_SIZE, Columns

    there, places = session.put((tree, tree.place))
    every = np.arange(len(tree.order), dtype=np.int32), tree.normals
    samples, normals = every if tangents is None else tangents
    for first in range(begin, end, BALLS_A_BLOCK):
        last = min(first + BALLS_A_BLOCK, end)
        rows = tree.order[first:last] if tangents is None else slice(first, last)
        found = [values[rows].copy() for values in out]  # kernels skip samples without a normal
        given = session.put((normals[first:last], samples[first:last], Columns(*found)))
        for step in (GROUP_SIZE, 1):
            count = -(-(last - first) // step)
            session.launch(NAME, count, step, places, float(sign), lengths, there, *given)
        for values, columns, mine in zip(out, given[2], found, strict=True):
            values[rows] = session.get(columns, mine)
        session.free(*given[:2], *given[2])
        progress.update((last - begin) / (end - begin))
    return True
