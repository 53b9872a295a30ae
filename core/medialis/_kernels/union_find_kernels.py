"""Union-find, shared by the stages that join neighbours into pieces."""

from __future__ import annotations

import numpy as np

from medialis._kernels.jit import kernel


@kernel
def find_root(parent, i):
    """Root of the piece of element i; halves the way on the way, which keeps later ways short."""
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@kernel
def join(parent, i, j):
    """Join the pieces of two elements: the lower root wins, so it is the lowest element."""
    i, j = find_root(parent, i), find_root(parent, j)
    if i < j:
        parent[j] = i
    elif j < i:
        parent[i] = j


@kernel
def number_pieces(parent):
    """Piece of each element, (n,) int32, numbered by their lowest elements; made by `join`."""
    label, count = np.empty(len(parent), np.int32), 0
    for i in range(len(parent)):
        if parent[i] == i:
            label[i] = count
            count += 1
        else:
            label[i] = label[parent[i]]  # never above i
    return label


@kernel
def label_pieces(count, links):
    """Piece of each of `count` elements that links (e, 2) int64 join, as `number_pieces`."""
    parent = np.arange(count).astype(np.int32)
    for k in range(len(links)):
        join(parent, links[k, 0], links[k, 1])
    return number_pieces(parent)
