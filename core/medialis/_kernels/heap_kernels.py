"""Binary heap of (key, name) pairs in two arrays, shared by the searches along graphs."""

from __future__ import annotations

from medialis._kernels.jit import kernel


@kernel
def _before(keys, names, i, j):
    return keys[i] < keys[j] or (keys[i] == keys[j] and names[i] < names[j])


@kernel
def _swap(keys, names, i, j):
    keys[i], keys[j] = keys[j], keys[i]
    names[i], names[j] = names[j], names[i]


@kernel
def push(keys, names, size, key, name):
    """Enter one pair; return the new size. Equal keys leave in the order of their names."""
    child = size
    keys[child], names[child] = key, name
    while child > 0:
        parent = (child - 1) // 2
        if not _before(keys, names, child, parent):
            break
        _swap(keys, names, child, parent)
        child = parent
    return size + 1


@kernel
def pop(keys, names, size):
    """Move the smallest entry to the end of the heap, which loses it; return the new size."""
    size -= 1
    _swap(keys, names, 0, size)
    parent = 0
    while True:
        child = 2 * parent + 1
        if child >= size:
            return size
        if child + 1 < size and _before(keys, names, child + 1, child):
            child += 1
        if not _before(keys, names, child, parent):
            return size
        _swap(keys, names, child, parent)
        parent = child
