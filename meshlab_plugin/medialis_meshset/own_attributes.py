# SPDX-License-Identifier: GPL-3.0-or-later
"""Which custom attributes of which mesh were added in place by us.

MeshLab's expressions can crash on attributes that came with a copy of a mesh (``add_mesh``), and
Python cannot see which did. Those that we added to a mesh of the MeshSet are safe.
"""

from __future__ import annotations

from collections.abc import Collection
from weakref import WeakKeyDictionary

import pymeshlab

_added: WeakKeyDictionary[pymeshlab.MeshSet, dict[tuple[int, str], set[str]]]
_added = WeakKeyDictionary()


def note_own(
    mesh_set: pymeshlab.MeshSet, number: int, element: str, names: Collection[str]
) -> None:
    """Remember names on the vertices ("v") or faces ("f") of the mesh with this id."""
    known = _added.setdefault(mesh_set, {}).setdefault((number, element), set())
    known.update(name.lower() for name in names)


def all_own(mesh_set: pymeshlab.MeshSet, number: int, element: str, names: Collection[str]) -> bool:
    """Tell whether all these names (lower case) are ours; so they are when there are none."""
    return set(names) <= _added.get(mesh_set, {}).get((number, element), set())


def forget(mesh_set: pymeshlab.MeshSet) -> None:
    """Forget a MeshSet that is cleared: it counts ids from 0 again."""
    _added.pop(mesh_set, None)
