# SPDX-License-Identifier: GPL-3.0-or-later
"""Parameters as MeshLab users give them become those of the core, or MeshLab's error.

Lengths are `PercentageValue` (of the bounding-box diagonal) or `PureValue` (units of the mesh), as
for pymeshlab's own filters, or "auto" where an operation can choose; a plain number is refused as
there. The core takes fractions.
"""

from __future__ import annotations

import operator
import os
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from pymeshlab import InvalidEnumException, PercentageValue, PureValue, PyMeshLabException

from medialis import InvalidOptionError
from medialis.hosts import AUTO, Filter, Kind, Parameter, as_typed

LENGTHS = (PercentageValue, PureValue)


def parameters_of(chosen: Filter) -> tuple[Parameter, ...]:
    """Return the parameters of a filter: those of the operation and those of a host, all off."""
    off = (replace(parameter, default=False) for parameter in chosen.host_parameters)
    return (*chosen.parameters, *off)


def checked(chosen: Filter, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the given parameters as the core takes them; lengths stay as they are.

    Raises
    ------
    PyMeshLabException
        For an unknown parameter, or a value of the wrong type or out of range.
    InvalidEnumException
        For a choice that there is not.
    """
    known = {parameter.name: parameter for parameter in parameters_of(chosen)}
    for name in given:
        if name not in known:
            raise PyMeshLabException(
                f"Parameter {name} not found for filter {chosen.name}. Please check the "
                "documentation."
            )
    return {name: _value(known[name], value) for name, value in given.items()}


def with_fractions(chosen: Filter, values: Mapping[str, Any], diagonal: float) -> dict[str, Any]:
    """Return `checked` parameters with lengths as fractions of the diagonal (units of the mesh).

    Raises
    ------
    PyMeshLabException
        When a length is out of range.
    """
    known = {parameter.name: parameter for parameter in chosen.parameters}
    return {
        name: _fraction(known[name], value, diagonal) if isinstance(value, LENGTHS) else value
        for name, value in values.items()
    }


def percent(fraction: float) -> str:
    """Return a fraction as MeshLab writes percentages: 0.02 is "2%"."""
    return f"{100 * fraction:g}%"


def _value(parameter: Parameter, value: Any) -> Any:
    name = parameter.name
    if parameter.kind is Kind.LENGTH and not (parameter.auto is not None and value == AUTO):
        if not isinstance(value, LENGTHS):
            raise PyMeshLabException(
                f"Parameter {name}: must be a pymeshlab.PercentageValue object or a "
                "pymeshlab.PureValue object. Other type values are not accepted."
            )
        return value
    if parameter.kind is Kind.CHOICE:
        return _choice(parameter.choices, value)
    if parameter.kind is Kind.FILE and isinstance(value, os.PathLike):
        value = os.fspath(value)
    try:
        return parameter.check(value)
    except InvalidOptionError as error:
        raise PyMeshLabException(f"Parameter {name}: {error}") from None


def _choice(choices: tuple[str, ...], value: Any) -> str:
    """Return a choice given by name or by number."""
    if isinstance(value, str):
        if value in choices:
            return value
        names = "".join(f"'{choice}'; " for choice in choices)
        raise InvalidEnumException(f"Enum '{value}' not found. Possible values are {names}")
    try:
        number = operator.index(value)
    except TypeError:
        number = -1
    if isinstance(value, bool) or not 0 <= number < len(choices):
        raise InvalidEnumException(
            f"Enum {value} not valid. Must be a value between 0 and {len(choices) - 1}"
        )
    return choices[number]


def _fraction(parameter: Parameter, value: Any, diagonal: float) -> float:
    """Return the fraction of the diagonal that a length is."""
    relative = isinstance(value, PercentageValue)
    # pymeshlab keeps single precision: 0.03 % would be 0.0299999993 %.
    number = as_typed(value.value())
    unit = 100.0 if relative else diagonal
    fraction = number / unit if unit > 0.0 else number
    if relative:
        fraction = as_typed(value.value(), percent=True)
    try:
        return float(parameter.check(fraction))
    except InvalidOptionError:
        suffix = "%" if relative else ""
        raise PyMeshLabException(
            f"Parameter {parameter.name}: must be between {parameter.low * unit:g}{suffix} and "
            f"{parameter.high * unit:g}{suffix} ({percent(parameter.low)} to "
            f"{percent(parameter.high)} of the bounding box diagonal). "
            f"Value: {number:g}{suffix}"
        ) from None
