"""Signs along a tree: the one step of making orientations agree, for faces and for normals."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def propagate_signs(predecessors: ArrayLike, agree: ArrayLike) -> NDArray[np.int8]:
    """Return the sign of each node relative to its root, (k,).

    Parameters
    ----------
    predecessors : (k,) integers
        The parent of each node in a forest; negative at a root.
    agree : (k,)
        +1 where a node agrees with its parent, -1 where it does not; ignored at roots.

    Notes
    -----
    Pointer doubling: after round r a node knows its product of signs over 2^r ancestors. Cost
    O(k log depth).

    Examples
    --------
    >>> propagate_signs([-1, 0, 1, 2], [1, -1, 1, -1])
    array([ 1, -1, -1,  1], dtype=int8)
    """
    parent = np.array(predecessors, dtype=np.int64)
    sign = np.array(agree, dtype=np.int8)
    roots = parent < 0
    parent[roots] = np.flatnonzero(roots)
    sign[roots] = 1
    while True:
        above = parent[parent]
        if (above == parent).all():
            # A parent that is a root carries sign +1, so every sign is complete now.
            return sign
        sign = sign * sign[parent]
        parent = above
