# SPDX-License-Identifier: GPL-3.0-or-later
"""The filters added to pymeshlab's own MeshSet, and taken away again."""

from __future__ import annotations

from typing import Any

import pymeshlab

from medialis_meshset.mesh_set import FilterMethods, filter_methods

_original: dict[str, Any] = {}
"""What `pymeshlab.MeshSet` had under the names that are replaced; None where it had nothing."""


def patch() -> None:
    """Add the filters to `pymeshlab.MeshSet`, and to what its ``apply_filter`` knows.

    ``import medialis_meshlab`` does it. Calling it again adds operations registered since.
    """
    wanted = {name: getattr(FilterMethods, name) for name in FilterMethods.REPLACED}
    for name, method in {**wanted, **filter_methods()}.items():
        _original.setdefault(name, vars(pymeshlab.MeshSet).get(name))
        setattr(pymeshlab.MeshSet, name, method)


def unpatch() -> None:
    """Make `pymeshlab.MeshSet` what it was before `patch`."""
    while _original:
        name, method = _original.popitem()
        if method is None:
            delattr(pymeshlab.MeshSet, name)
        else:
            setattr(pymeshlab.MeshSet, name, method)
