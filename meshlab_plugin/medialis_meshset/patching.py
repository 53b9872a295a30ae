# SPDX-License-Identifier: GPL-3.0-or-later
"""The filters added to pymeshlab's own MeshSet, and taken away again."""

from __future__ import annotations

from typing import Any

import pymeshlab

from medialis_meshset import listing
from medialis_meshset.mesh_set import FilterMethods, filter_methods

_original: dict[str, Any] = {}
"""What `pymeshlab.MeshSet` had under the names that are replaced; None where it had nothing."""

_functions: dict[str, Any] = {}
"""What pymeshlab itself had."""

FUNCTIONS = ("filter_list", "print_filter_list", "search", "print_filter_parameter_list")


def _everyones() -> dict[str, Any]:
    """Return what replaces functions of pymeshlab, so that they know the filters of both."""
    theirs = {name: getattr(pymeshlab, name) for name in FUNCTIONS}

    def filter_list() -> list[str]:
        return sorted({*theirs["filter_list"](), *listing.filter_list()})

    def print_filter_list() -> None:
        theirs["print_filter_list"]()
        listing.print_filter_list()

    def search(keyword: str) -> None:
        theirs["search"](keyword)
        listing.search(keyword)

    def print_filter_parameter_list(filter_name: str) -> None:
        ours = isinstance(filter_name, str) and listing.find_filter(filter_name) is not None
        own = listing.print_filter_parameter_list
        (own if ours else theirs["print_filter_parameter_list"])(filter_name)

    made = (filter_list, print_filter_list, search, print_filter_parameter_list)
    for function in made:
        function.__doc__ = theirs[function.__name__].__doc__
    return {function.__name__: function for function in made}


def patch() -> None:
    """Add the filters to `pymeshlab.MeshSet`, and to what the functions of pymeshlab know.

    ``import medialis_meshlab`` does it. Calling it again adds operations registered since.
    """
    wanted = {name: getattr(FilterMethods, name) for name in FilterMethods.REPLACED}
    for name, method in {**wanted, **filter_methods()}.items():
        _original.setdefault(name, vars(pymeshlab.MeshSet).get(name))
        setattr(pymeshlab.MeshSet, name, method)
    if not _functions:
        everyones = _everyones()
        _functions.update({name: getattr(pymeshlab, name) for name in everyones})
        for name, function in everyones.items():
            setattr(pymeshlab, name, function)


def unpatch() -> None:
    """Make pymeshlab what it was before `patch`."""
    while _original:
        name, method = _original.popitem()
        if method is None:
            delattr(pymeshlab.MeshSet, name)
        else:
            setattr(pymeshlab.MeshSet, name, method)
    while _functions:
        setattr(pymeshlab, *_functions.popitem())
