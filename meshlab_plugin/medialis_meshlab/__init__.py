# SPDX-License-Identifier: GPL-3.0-or-later
"""The operations of medialis as filters of every pymeshlab MeshSet.

    import pymeshlab
    import medialis_meshlab

    ms = pymeshlab.MeshSet()
    ms.load_new_mesh("bunny.ply")
    ms.generate_surface_skeleton(tolerance=pymeshlab.PercentageValue(0.1))

Importing this package adds the filters to `pymeshlab.MeshSet`; `unpatch` takes them away again. To
leave pymeshlab as it is from the start, import the subclass instead, which is all this one uses:
``from medialis_meshset import MeshSet``.
"""

from __future__ import annotations

from typing import Any

import pymeshlab

from medialis_meshset import (
    MeshSet,
    filter_list,
    filter_parameter_values,
    print_filter_list,
    print_filter_parameter_list,
)
from medialis_meshset.mesh_set import FilterMethods, filter_methods

__all__ = [
    "MeshSet",
    "filter_list",
    "filter_parameter_values",
    "patch",
    "print_filter_list",
    "print_filter_parameter_list",
    "unpatch",
]

_original: dict[str, Any] = {}
"""What `pymeshlab.MeshSet` had under the names that are replaced; None where it had nothing."""


def patch() -> None:
    """Add the filters to `pymeshlab.MeshSet`, and to what ``apply_filter`` knows.

    Done on import. Calling it again adds the operations that were registered since.
    """
    wanted = {name: getattr(FilterMethods, name) for name in FilterMethods.REPLACED}
    for name, method in {**wanted, **filter_methods()}.items():
        _original.setdefault(name, getattr(pymeshlab.MeshSet, name, None))
        setattr(pymeshlab.MeshSet, name, method)


def unpatch() -> None:
    """Make `pymeshlab.MeshSet` what it was before `patch`."""
    while _original:
        name, method = _original.popitem()
        if method is None:
            delattr(pymeshlab.MeshSet, name)
        else:
            setattr(pymeshlab.MeshSet, name, method)


patch()
