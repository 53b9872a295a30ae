"""Values of results for people: what is a length, an area or an angle, and how it is written."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from medialis.units import AREAS, LENGTHS, RADIANS, with_unit

_PARTS = ("_min", "_median", "_max")


def quantity(name: str) -> str:
    """Return "length", "area" or "angle" (in radians) for the name of a value, else nothing.

    Examples
    --------
    >>> quantity("radius_max"), quantity("area"), quantity("spoke_angle"), quantity("nodes")
    ('length', 'area', 'angle', '')
    """
    stem = next((name.removesuffix(part) for part in _PARTS if name.endswith(part)), name)
    kinds = {"length": LENGTHS, "area": AREAS, "angle": RADIANS}
    return next((kind for kind, names in kinds.items() if stem in names), "")


def value_text(name: str, value: Any, unit: str | None = None) -> str:
    """Return a value of a result for people, with its unit; `unit` is that of the shape.

    Examples
    --------
    >>> value_text("radius_max", 0.5, "mm"), value_text("spoke_angle_min", math.pi / 3)
    ('0.5 mm', '60.0 degrees')
    >>> value_text("samples", 35779), value_text("area", None)
    ('35,779', 'not defined')
    """
    what = quantity(name)
    if value is None:
        return "not defined"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, Mapping):
        return ", ".join(f"{key}: {value_text('', part, unit)}" for key, part in value.items())
    if isinstance(value, float) and what == "angle":
        return f"{math.degrees(value):.1f} degrees"
    if isinstance(value, float):
        own = unit if what else "%" if name.endswith("_percent") else None
        return with_unit(value, own, 2 if what == "area" else 1)
    return f"{value:,}" if isinstance(value, int) else str(value)


def value_rows(values: Mapping[str, Any], unit: str | None = None) -> Iterator[tuple[str, str]]:
    """Yield the values of a result in words; tables are for programs and left out.

    Smallest, median and largest of a quantity share a row.

    Examples
    --------
    >>> list(value_rows({"points": 3, "radius_min": 1.0, "radius_median": 1.5, "radius_max": 3.0}))
    [('points', '3'), ('radius', '1 to 3, median 1.5')]
    """
    stems = [name.removesuffix("_min") for name in values if name.endswith("_min")]
    threes = {stem: [f"{stem}{part}" for part in _PARTS] for stem in stems}
    whole = {a: b for a, b in threes.items() if all(isinstance(values.get(c), float) for c in b)}
    done = {one for three in whole.values() for one in three[1:]}
    for name, value in values.items():
        parts = value.values() if isinstance(value, Mapping) else ()
        if name in done or isinstance(value, list):
            continue
        if any(isinstance(part, list | Mapping) for part in parts):
            continue
        stem = name.removesuffix("_min")
        if stem != name and stem in whole:
            low, median, high = (value_text(one, values[one], unit) for one in whole[stem])
            ending = low.removeprefix(low.split(" ")[0])
            if ending and high.endswith(ending):
                low = low.removesuffix(ending)
            yield stem.replace("_", " "), f"{low} to {high}, median {median}"
        else:
            yield name.removesuffix("_percent").replace("_", " "), value_text(name, value, unit)


def value_lines(values: Mapping[str, Any], unit: str | None = None) -> list[str]:
    """Return the values of a result as lines for people.

    Examples
    --------
    >>> value_lines({"points": 3, "spoke_angle_max": math.pi, "spots": [{}], "area": None})
    ['points: 3', 'spoke angle max: 180.0 degrees', 'area: not defined']
    """
    return [f"{name}: {text}" for name, text in value_rows(values, unit)]
