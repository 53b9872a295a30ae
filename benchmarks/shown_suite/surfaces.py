"""Numbers as people read them: on the screen, in pictures, on pages and in tables.

Each reader gives `Told`: where it stands, what it is of, the number, how far it may be rounded, and
its unit. Names are those of the values in the manifest: `thickness 1 to 3 mm, median 2 mm` tells
`thickness_min`, `thickness_max` and `thickness_median`.
"""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from medialis.operations.result import WORDS

NUMBER = r"-?\d[\d,]*(?:\.\d+)?(?:e[+-]?\d+)?"
UNITS = r"(?: (mm²|mm|degrees|%))?"
_NUMBER = re.compile(rf"(?<![\w.])({NUMBER}){UNITS}(?![\w²])")
_RANGE = re.compile(rf"({NUMBER}){UNITS} to ({NUMBER}){UNITS}, median ({NUMBER}){UNITS}")


DIGITS = {"screen": 4, "note": 4, "legend": 3}
"""Significant digits of numbers."""


@dataclass(frozen=True)
class Told:
    """A number that somebody reads.

    Attributes
    ----------
    where : str
        "screen", "note", "page", "csv", "legend".
    name : str
        Of the value; tables of places have `spots[0].value`.
    number, rounded_by : float
        At most half of the last digit.
    unit : str
        "" where none is told.
    """

    where: str
    name: str
    number: float
    rounded_by: float
    unit: str

    def agrees(self, value: float) -> bool:
        """Tell whether a value is this number, as far as that is rounded."""
        return abs(self.number - value) <= self.rounded_by * (1 + 1e-9) + 1e-12 * abs(value)


def number_told(where: str, name: str, text: str, unit: str | None) -> Told:
    """Return a number in a text: `DIGITS` of them, or all before the point; zeros are left out.

    Examples
    --------
    >>> number_told("screen", "area", "1,040", "mm²").rounded_by
    0.5
    >>> number_told("screen", "length", "1", "mm").rounded_by
    0.0005
    """
    number = float(text.replace(",", ""))
    if unit == "degrees":
        return Told(where, name, number, 0.05, unit)
    power = math.floor(math.log10(abs(number))) if number else -300
    return Told(where, name, number, 0.5 * 10.0 ** min(power - DIGITS[where] + 1, 0), unit or "")


KEYS = {words: key for key, words in WORDS.items() if key != "seams"}
"""Names of values by what they are called on the screen."""

TITLES = {"thin spots": "spots", "regions": "regions", "ribs": "ribs", "branches": "branch_table"}
"""Names of the values whose tables have these titles."""


def on_screen(text: str) -> Iterator[Told]:
    """Yield the numbers of a run: rows of values, tables of places, and notes."""
    table: list[str] | None = None
    for line in text.splitlines():
        if line.startswith(("note: ", "warning: ")):
            yield from in_note(line)
        columns = re.split(r" {2,}", line.strip())
        if not line.startswith("  ") or len(columns) < 2:
            table = None
        elif columns[0] in TITLES and line.startswith("    "):
            table = columns
        elif table is not None and columns[0].isdigit():
            yield from _cells(table, columns)
        elif table is None and "." not in columns[0]:  # no file
            yield from _row(KEYS.get(columns[0], columns[0].replace(" ", "_")), columns[1])


def _row(name: str, text: str) -> Iterator[Told]:
    three = _RANGE.fullmatch(text)
    if three is not None:
        low, low_unit, high, high_unit, median, median_unit = three.groups()
        told = (("min", low, low_unit or high_unit), ("max", high, high_unit))
        for part, number, unit in (*told, ("median", median, median_unit)):
            yield number_told("screen", f"{name}_{part}", number, unit)
    elif (one := re.fullmatch(rf"({NUMBER}){UNITS}", text)) is not None:
        yield number_told("screen", name, *one.groups())


def _cells(heads: Sequence[str], cells: Sequence[str]) -> Iterator[Told]:
    """Yield the cells of a line of a table, after its number."""
    first = 0 if heads[0] == "branches" else 1
    start = f"{TITLES[heads[0]]}[{int(cells[0]) - first}]"
    names = [*heads] if len(cells) > len(heads) else [*heads[1:]]
    for name, cell in zip(names, cells[1:], strict=False):
        one = re.fullmatch(rf"({NUMBER}){UNITS}", cell)
        if one is not None:
            column = name.split(",")[0].replace(" ", "_")  # "area, both sides"
            yield number_told("screen", f"{start}.{column}", *one.groups())


def in_note(line: str, where: str = "note") -> Iterator[Told]:
    """Yield the numbers of a sentence that have the unit of lengths."""
    for number, unit in _NUMBER.findall(line):
        if unit in ("mm", "mm²"):
            yield number_told(where, line, number, unit)


def on_page(text: str) -> Iterator[Told]:
    """Yield what the page of the viewer has: places, numbers, ranges of values, the diagonal."""
    scene = json.loads(re.findall(r'id="scene">(.*?)</script>', text, re.DOTALL)[0])
    unit = scene["unit"] or ""
    names = {"length": unit, "area": f"{unit}²" if unit else "", "degrees": "degrees", "": ""}
    yield Told("page", "diagonal", scene["diagonal"], 1e-6 * scene["diagonal"], unit)
    for place in scene["places"]:
        if place["table"] != "ribs":
            name = f"{place['table']}[{place['number'] - 1}].value"
            yield Told("page", name, place["value"], 0.0, unit)
    for name, words in scene["numbers"]:
        for one in _row(KEYS.get(name, name.replace(" ", "_")), words):
            yield replace(one, where="page")
    fields = [field for part in scene["parts"] for field in part["fields"] if not field["label"]]
    for name in {field["name"] for field in fields}:
        mine = [field for field in fields if field["name"] == name]
        low, high = min(one["low"] for one in mine), max(one["high"] for one in mine)
        close = 1e-6 * abs(high) + 1e-12  # PLY files have single precision
        for end, number in (("min", low), ("max", high)):
            yield Told("page", f"{name}_{end}", number, close, names[mine[0]["unit"]])


def in_csv(text: str, shape: str) -> Iterator[tuple[str, Told]]:
    """Yield the numbers of one shape with the operation that each is of."""
    for row in csv.DictReader(io.StringIO(text)):
        if row["shape"] != shape:
            continue
        for head, cell in row.items():
            operation, _, column = head.partition(": ")
            found = re.fullmatch(r"(\w[\w ]*?)(?: \((mm²|mm|degrees|%)\))?", column)
            if not column or found is None or not re.fullmatch(NUMBER, cell):
                continue
            name, unit = found.groups()
            value = float(cell)
            told = Told("csv", name.replace(" ", "_"), value, 1e-12 * abs(value), unit or "")
            yield operation.replace(" ", "_"), told


def known_numbers(values: Mapping[str, Any], start: str = "") -> Iterator[tuple[str, float]]:
    """Yield all numbers of values, with names as `Told` has them."""
    for name, value in values.items():
        if isinstance(value, bool) or value is None:
            continue
        if isinstance(value, int | float):
            yield f"{start}{name}", float(value)
        elif isinstance(value, Mapping):
            yield from known_numbers(value, f"{start}{name}.")
        elif isinstance(value, list):
            for row, one in enumerate(value):
                if isinstance(one, Mapping):
                    yield from known_numbers(one, f"{start}{name}[{row}].")
                elif isinstance(one, int | float):
                    yield f"{start}{name}[{row}]", float(one)
