# SPDX-License-Identifier: GPL-3.0-or-later
"""What filters there are and what parameters they take: lists, print-outs, docstrings."""

from __future__ import annotations

import inspect
import textwrap
from typing import Any

from pymeshlab import PercentageValue, PyMeshLabException

from medialis.hosts import AUTO, Filter, Kind, Parameter, filters
from medialis_meshset.parameters import parameters_of, percent

TYPES = {
    Kind.FLOAT: "float",
    Kind.INT: "int",
    Kind.BOOL: "bool",
    Kind.CHOICE: "str",
    Kind.LENGTH: "PercentageValue",
    Kind.ANGLE: "float",
    Kind.FILE: "str",
}

RESULTS = """\
Returns
-------
dict
    The values of the operation; "layers": id of each new layer by its name; "attributes": name of
    each custom attribute written on the current mesh; "images": pictures, (h, w, 3) uint8;
    "messages": what was repaired, refined or left out.

Raises
------
PyMeshLabException
    When the mesh or a parameter cannot be used; the MeshSet is then as it was.
"""


def filter_list() -> list[str]:
    """Return the names of the filters of medialis, in alphabetical order."""
    return sorted(chosen.name for chosen in filters())


def find_filter(name: str) -> Filter | None:
    """Return the filter of a name; None: it is none of medialis."""
    return next((chosen for chosen in filters() if chosen.name == name), None)


def require_filter(name: str) -> Filter:
    """Return the filter of a name.

    Raises
    ------
    PyMeshLabException
        When there is none.
    """
    chosen = find_filter(name)
    if chosen is None:
        raise PyMeshLabException(f"{name} filter not found.")
    return chosen


def filter_parameter_values(name: str) -> dict[str, Any]:
    """Return the defaults of a filter, in the form in which it takes them.

    Raises
    ------
    PyMeshLabException
        When there is no such filter.
    """
    return {
        parameter.name: PercentageValue(100 * parameter.default)
        if parameter.kind is Kind.LENGTH and parameter.default != AUTO
        else parameter.default
        for parameter in parameters_of(require_filter(name))
    }


def print_filter_list() -> None:
    """Print the names of the filters of medialis."""
    print("medialis - list of filter names:")
    for name in filter_list():
        print(f"\t{name}")


def search(keyword: str) -> None:
    """Print the filters of medialis whose name or help has all the words."""
    words = keyword.lower().replace("_", " ").split()
    for chosen in filters():
        about = " ".join(chosen.operation.words)
        text = f"{chosen.name} {chosen.title} {chosen.help} {about}".lower().replace("_", " ")
        if all(word in text for word in words):
            print(f"{chosen.name}: {chosen.help.splitlines()[0]}")


def print_filter_parameter_list(name: str) -> None:
    """Print the parameters of a filter with types, defaults and ranges.

    Raises
    ------
    PyMeshLabException
        When there is no such filter.
    """
    chosen = require_filter(name)
    print(f"{name} filter - list of parameter names:")
    for parameter in parameters_of(chosen):
        kind = TYPES[parameter.kind]
        print(f"\t{parameter.name} : {kind} = {_default(parameter)}{_range(parameter)}")


def docstring(chosen: Filter) -> str:
    """Return the docstring of a filter: help, parameters with units and defaults, result."""
    lines = [*(textwrap.fill(text, 96) + "\n" for text in chosen.help.split("\n\n"))]
    lines += ["Parameters", "----------"]
    for parameter in parameters_of(chosen):
        lines.append(f"{parameter.name} : {TYPES[parameter.kind]} = {_default(parameter)}")
        text = f"{parameter.full_help}{_units(parameter)}"
        lines.append(textwrap.fill(text, 96, initial_indent="    ", subsequent_indent="    "))
    return "\n".join([*lines, "", RESULTS])


def signature(chosen: Filter) -> inspect.Signature:
    """Return the signature of a filter as a method: keywords only, with readable defaults."""
    keyword = inspect.Parameter.KEYWORD_ONLY
    own = inspect.Parameter("self", inspect.Parameter.POSITIONAL_OR_KEYWORD)
    return inspect.Signature(
        [
            own,
            *(
                inspect.Parameter(p.name, keyword, default=_Shown(_default(p)))
                for p in parameters_of(chosen)
            ),
        ]
    )


class _Shown:
    """A default in a signature, shown as users read it."""

    def __init__(self, text: str) -> None:
        self._text = text

    def __repr__(self) -> str:
        return self._text


def _default(parameter: Parameter) -> str:
    if parameter.kind is Kind.LENGTH and parameter.default != AUTO:
        return percent(parameter.default)
    return repr(parameter.default)


def _range(parameter: Parameter) -> str:
    if parameter.kind is Kind.CHOICE:
        return f" [{'; '.join(repr(choice) for choice in parameter.choices)}]"
    if parameter.kind is Kind.LENGTH:
        return f" [min: {percent(parameter.low)}; max: {percent(parameter.high)}]"
    if parameter.kind in (Kind.FLOAT, Kind.INT, Kind.ANGLE):
        return f" [min: {parameter.low:.10g}; max: {parameter.high:.10g}]"
    return ""


def _units(parameter: Parameter) -> str:
    if parameter.kind is Kind.LENGTH:
        automatic = "" if parameter.auto is None else f", or '{AUTO}'"
        return f" PercentageValue of the bounding box diagonal, PureValue in mesh units{automatic}."
    if parameter.kind is Kind.CHOICE:
        return f" One of {', '.join(repr(choice) for choice in parameter.choices)}, or its number."
    return " Degrees." if parameter.kind is Kind.ANGLE else ""
