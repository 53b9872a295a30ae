"""Union-find, shared by the stages that join neighbours into pieces."""

from __future__ import annotations

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
def number_pieces(parent, out_label):
    """Piece of each element, (n,), numbered by their lowest elements; `parent` made by `join`."""
    count = 0
    for i in range(len(parent)):
        if parent[i] == i:
            out_label[i] = count
            count += 1
        else:
            out_label[i] = out_label[parent[i]]  # never above i


@kernel
def label_pieces(links, parent, out_label):
    """Piece of each element that links (e, 2) int64 join; `parent` is 0, 1, 2 and so on."""
    for k in range(len(links)):
        join(parent, links[k, 0], links[k, 1])
    number_pieces(parent, out_label)
