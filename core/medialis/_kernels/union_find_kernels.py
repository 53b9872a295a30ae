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
