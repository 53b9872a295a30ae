"""What is asked of walls: by a process, from a file that a company can edit, and by a plastic.

`rules.toml` beside this file has a table for each process: its format, and what is usual. The same
words in a file of one's own say other numbers, or other processes.

How thick moulded walls are, for each plastic: the ranges that moulding services recommend for
injection moulding; several publish the same table, in inches (0.045 to 0.140 for ABS). They are
starting points: grade, flow length and part decide. Source: Protolabs, "Improving part design with
uniform wall thickness"; the same numbers in the design guidelines of Xcentric Mold and of UpMold.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from medialis.base.errors import InvalidOptionError, no_option
from medialis.base.options import Length, Size, as_length
from medialis.formats.files import file_bytes
from medialis.shape.shape import Shape

INCH = 25.4

_INCHES = {
    "ABS": (0.045, 0.140),
    "LCP": (0.030, 0.120),
    "PA": (0.030, 0.115),
    "PBT/PET": (0.025, 0.125),
    "PC": (0.040, 0.150),
    "PE": (0.030, 0.200),
    "PMMA": (0.025, 0.500),
    "POM": (0.030, 0.120),
    "PP": (0.025, 0.150),
    "PPS": (0.020, 0.180),
    "PS": (0.035, 0.150),
    "PUR": (0.080, 0.750),
}
"""Polyamide is nylon, POM acetal, PMMA acrylic, PBT/PET polyester, LCP liquid crystal polymer."""

MATERIALS = {
    name: (round(low * INCH, 2), round(high * INCH, 2)) for name, (low, high) in _INCHES.items()
}
"""Least and largest thickness of a wall in millimetres."""

USUAL = Path(__file__).with_name("rules.toml")

NONE = "none"

UNASKED = Length(0.0, "mm")

LENGTHS_OF_RULES = ("minimum", "maximum", "gap", "line_width")


@dataclass(frozen=True, kw_only=True)
class Rules:
    """What a process asks of walls; 0, or inf for `rib_ratio`, is not checked.

    Attributes
    ----------
    minimum, maximum, gap, line_width : Length
    rib_ratio : float
    line_tolerance : float
        Of a line.
    most_lines : float
    about : str
    """

    minimum: Length = UNASKED
    maximum: Length = UNASKED
    gap: Length = UNASKED
    line_width: Length = UNASKED
    rib_ratio: float = math.inf
    line_tolerance: float = 0.1
    most_lines: float = 6.0
    about: str = ""

    def in_units_of(self, shape: Shape, name: str) -> float:
        """Return a length in the units of a shape.

        Raises
        ------
        InvalidOptionError
            When the unit of the shape is not known.
        """
        length: Length = getattr(self, name)
        if not length.amount:
            return 0.0
        told = f"the {name.replace('_', ' ')} of the process"
        return Size.of(shape).fraction(length, told) * shape.diagonal


def read_rules(path: str | Path) -> dict[str, Rules]:
    """Return the processes in a file of rules.

    Raises
    ------
    FileError
        When it cannot be read.
    InvalidOptionError
        When it is no TOML, or a table, a name or a number is none of those that rules have.
    """
    try:
        import tomllib

        tables = tomllib.loads(file_bytes(str(path)).decode("utf-8"))
    except ValueError as error:  # what is not UTF-8 as well
        raise InvalidOptionError(f"{path} is no file of rules (TOML): {error}.") from error
    if not tables:
        raise InvalidOptionError(f"{path} has no process: a table such as [FDM].")
    return {name: _rules(path, name, table) for name, table in tables.items()}


def _rules(path: str | Path, name: str, table: Any) -> Rules:
    if not isinstance(table, dict):
        raise InvalidOptionError(f"{path}: {name} must stand below a process, such as [FDM].")
    known = [one.name for one in fields(Rules)]
    if unknown := sorted(set(table) - set(known)):
        raise InvalidOptionError(f"{path}: {no_option(name, unknown, known)}")
    return Rules(**{key: _value(f"{key} of {name}", key, value) for key, value in table.items()})


def _value(told: str, key: str, value: Any) -> Any:
    """Return a value of a file of rules in its type."""
    if key == "about":
        if not isinstance(value, str):
            raise InvalidOptionError(f"The {told} must be text, got {value!r}.")
        return value
    if key in LENGTHS_OF_RULES and isinstance(value, str):
        length = as_length(value, told, 0.0, 1.0)
        return length if isinstance(length, Length) else Length(100.0 * length, "%")
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < math.inf:
        raise InvalidOptionError(f"The {told} must be a number from 0 up, got {value!r}.")
    return Length(float(value), "mm") if key in LENGTHS_OF_RULES else float(value)


PROCESSES = read_rules(USUAL)
"""Those that everybody has."""


def rules_of(path: str, process: str) -> Rules | None:
    """Return the rules of a process; of a file with one process, of that; None without any.

    Raises
    ------
    FileError, InvalidOptionError
        As `read_rules`, and when the file has no such process, or several and none is named.
    """
    if not path:
        return PROCESSES.get(process)
    found = read_rules(path)
    if process == NONE and len(found) == 1:
        return next(iter(found.values()))
    if process not in found:
        which = "is chosen" if process == NONE else f"{process} is none of them"
        none = "no process " if process == NONE else ""
        raise InvalidOptionError(
            f"{path} has rules for {', '.join(found)}, and {none}{which}. Say --process, or keep "
            "one process in the file."
        )
    return found[process]


def process_help(name: str) -> str:
    """Return what a choice of a process says: its walls, gaps and lines."""
    rules, parts = PROCESSES[name], []
    low, high = rules.minimum.amount, rules.maximum.amount
    parts.append(f"walls of {low:g} to {high:g} mm" if high else f"walls of at least {low:g} mm")
    if rules.gap.amount:
        parts.append(f"gaps of {rules.gap.amount:g} mm")
    if rules.line_width.amount:
        parts.append(f"lines of {rules.line_width.amount:g} mm")
    return f"{rules.about} {', '.join(parts).capitalize()}."
