# SPDX-License-Identifier: GPL-3.0-or-later
"""The filters as methods: of a MeshSet subclass here, of pymeshlab's own by `medialis_meshlab`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pymeshlab

import medialis
from medialis.hosts import Operation
from medialis_meshset.filters import filter_values, run_filter
from medialis_meshset.listing import docstring, find_filter, signature
from medialis_meshset.own_attributes import forget

# Taken before anyone replaces them.
_apply_filter = pymeshlab.MeshSet.apply_filter
_filter_parameter_values = pymeshlab.MeshSet.filter_parameter_values
_clear = pymeshlab.MeshSet.clear


class FilterMethods:
    """The methods of pymeshlab.MeshSet that must know the filters of medialis as well."""

    REPLACED = ("apply_filter", "clear", "filter_parameter_values")

    def apply_filter(self, filter_name: str, **kwargs: Any) -> dict[str, Any]:
        """Apply a filter of MeshLab or of medialis by its name; a dict of results."""
        if isinstance(filter_name, str) and find_filter(filter_name) is not None:
            return run_filter(self, filter_name, kwargs)
        found: dict[str, Any] = _apply_filter(self, filter_name, **kwargs)
        return found

    def clear(self) -> None:
        """Clear the MeshSet: remove all meshes."""
        forget(self)
        _clear(self)

    def filter_parameter_values(self, filter_name: str, **kwargs: Any) -> dict[str, Any]:
        """Return the parameters that a filter of MeshLab or of medialis would use now."""
        if isinstance(filter_name, str) and find_filter(filter_name) is not None:
            return filter_values(self, filter_name, kwargs)
        found: dict[str, Any] = _filter_parameter_values(self, filter_name, **kwargs)
        return found


def filter_methods() -> dict[str, Callable[..., dict[str, Any]]]:
    """Return one method for each registered operation by its filter name."""
    return {chosen.filter_name: _method(chosen) for chosen in medialis.OPERATIONS}


def _method(chosen: Operation) -> Callable[..., dict[str, Any]]:
    name = chosen.filter_name

    def method(self: pymeshlab.MeshSet, **kwargs: Any) -> dict[str, Any]:
        return run_filter(self, name, kwargs)

    method.__name__ = name
    method.__qualname__ = f"MeshSet.{name}"
    method.__doc__ = docstring(chosen)
    method.__signature__ = signature(chosen)  # type: ignore[attr-defined]
    return method


class MeshSet(FilterMethods, pymeshlab.MeshSet):
    """A pymeshlab MeshSet with the operations of medialis as filters."""


for _name, _filter in filter_methods().items():
    setattr(MeshSet, _name, _filter)
