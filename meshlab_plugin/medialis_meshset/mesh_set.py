# SPDX-License-Identifier: GPL-3.0-or-later
"""The filters as methods: of a MeshSet subclass here, of pymeshlab's own by `medialis_meshlab`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pymeshlab

from medialis.hosts import Filter, filters
from medialis_meshset.attributes import saved_attributes
from medialis_meshset.filters import filter_values, run_filter
from medialis_meshset.listing import docstring, find_filter, signature
from medialis_meshset.own_attributes import forget
from medialis_meshset.script import apply_script
from medialis_meshset.verbosity import note_verbosity

# Taken before anyone replaces them.
_apply_filter = pymeshlab.MeshSet.apply_filter
_filter_parameter_values = pymeshlab.MeshSet.filter_parameter_values
_apply_filter_script = pymeshlab.MeshSet.apply_filter_script
_save_current_mesh = pymeshlab.MeshSet.save_current_mesh
_clear = pymeshlab.MeshSet.clear
_set_verbosity = pymeshlab.MeshSet.set_verbosity


class FilterMethods:
    """The methods of pymeshlab.MeshSet that must know the filters of medialis as well."""

    REPLACED = (
        *("apply_filter", "apply_filter_script", "clear", "filter_parameter_values"),
        *("save_current_mesh", "set_verbosity"),
    )

    def apply_filter(self, filter_name: str, **kwargs: Any) -> dict[str, Any]:
        """Apply a filter of MeshLab or of medialis by its name; a dict of results."""
        if isinstance(filter_name, str) and find_filter(filter_name) is not None:
            return run_filter(self, filter_name, kwargs)
        found: dict[str, Any] = _apply_filter(self, filter_name, **kwargs)
        return found

    def apply_filter_script(self) -> None:
        """Apply the filters of the current filter script, of MeshLab and of medialis."""
        apply_script(self, _apply_filter_script, lambda name, given: run_filter(self, name, given))

    def save_current_mesh(self, file_name: str, *args: Any, **kwargs: Any) -> None:
        """Save the current mesh; PLY files get the attributes of medialis unless told otherwise."""
        if str(file_name).lower().endswith(".ply"):
            kwargs = {**dict.fromkeys(saved_attributes(self), True), **kwargs}
        _save_current_mesh(self, file_name, *args, **kwargs)

    def clear(self) -> None:
        """Clear the MeshSet: remove all meshes."""
        forget(self)
        _clear(self)

    def set_verbosity(self, verbosity: bool) -> None:
        """Say what filters do while they run, or not."""
        note_verbosity(self, verbosity)
        _set_verbosity(self, verbosity)

    def filter_parameter_values(self, filter_name: str, **kwargs: Any) -> dict[str, Any]:
        """Return the parameters that a filter of MeshLab or of medialis would use now."""
        if isinstance(filter_name, str) and find_filter(filter_name) is not None:
            return filter_values(self, filter_name, kwargs)
        found: dict[str, Any] = _filter_parameter_values(self, filter_name, **kwargs)
        return found


def filter_methods() -> dict[str, Callable[..., dict[str, Any]]]:
    """Return one method for each filter by its name."""
    return {chosen.name: _method(chosen) for chosen in filters()}


def _method(chosen: Filter) -> Callable[..., dict[str, Any]]:
    name = chosen.name

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
