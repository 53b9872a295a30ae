"""Lengths as people write them: shares of the size, numbers in the unit of a file, real lengths.

Inside, every length option is a fraction of the bounding-box diagonal. At the door it may be text
or a `Length`: "0.5%", "1mm", "0.2in", "3 units". What such a length is as a fraction follows from
the diagonal of what is computed from, and for real ones from its unit.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from medialis.base.errors import InvalidOptionError

METERS = {
    **{"nm": 1e-9, "um": 1e-6, "mm": 1e-3, "cm": 1e-2, "dm": 0.1, "m": 1.0, "km": 1e3},
    **{"in": 0.0254, "ft": 0.3048},
}
"""Metres in each real unit."""

SHARE, PERCENT, UNITS = "", "%", "units"
"""What else a length may be in: fractions and per cent of the diagonal, the numbers of a file."""

LENGTHS = frozenset(
    {"thickness", "radius", "importance", "edge_radius", "length", "y_length", "mean_radius"}
    | {"straight_distance", "diagonal", "spacing", "value", "noise", "moved", "feature_radius"}
    | {"minimum", "maximum", "typical", "wall", "least", "most"}
    | {"rib_thickness", "wall_thickness", "weld_length"}
    | {"distance", "largest_error", "mean_error", "surface_to_envelope", "envelope_to_surface"}
)
AREAS = frozenset({"area"})
RADIANS = frozenset({"spoke_angle", "edge_angle"})
"""Names of values and attributes that have a unit, without _min, _median and _max."""

_WORDS = {
    **{"micron": "um", "micrometer": "um", "µm": "um", "μm": "um", "millimeter": "mm"},
    **{"centimeter": "cm", "decimeter": "dm", "meter": "m", "kilometer": "km"},
    **{"inch": "in", "inche": "in", "foot": "ft", "feet": "ft", "u": UNITS, "unit": UNITS},
}
_LENGTH = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(\D*?)\s*")
_KNOWN = ", ".join(METERS)
_INSIDE = ("surface", "cloud", "sheets", "curve", "importance", "paths")


def unit_name(text: str) -> str | None:
    """Return the short name of a real unit, or None for what is none.

    Examples
    --------
    >>> unit_name("Millimetres"), unit_name("in"), unit_name("furlong")
    ('mm', 'in', None)
    """
    word = text.strip()
    if word in METERS:
        return word
    word = word.lower().replace("metre", "meter").removesuffix("s")
    name = _WORDS.get(word, word)
    return name if name in METERS else None


def nearest_unit(text: str | None) -> str | None:
    """Return the unit that a file says, in words or as a multiple of another; None for none.

    Examples
    --------
    >>> nearest_unit("millimeters"), nearest_unit("0.0254 * meters"), nearest_unit("3 * feet")
    ('mm', 'in', None)
    """
    factor, _, word = (text or "").rpartition("*")
    unit = unit_name(word)
    if unit is None or not factor:
        return unit
    try:
        meters = float(factor) * METERS[unit]
    except ValueError:
        return None
    return next((u for u, m in METERS.items() if math.isclose(m, meters, rel_tol=1e-6)), None)


def as_unit(text: str | None) -> str | None:
    """Return the short name of the unit of a shape; None stays.

    Raises
    ------
    InvalidOptionError
        When it is no unit.
    """
    name = None if text is None else unit_name(text) if isinstance(text, str) else ""
    if text is not None and not name:
        raise InvalidOptionError(f"unit must be one of {_KNOWN}, got {text!r}.")
    return name


@dataclass(frozen=True, repr=False)
class Length:
    """A length with its unit, for any length option.

    Attributes
    ----------
    amount : float
    unit : str
        "mm", "in", "m" and so on; "%" of the bounding-box diagonal; "units" of the numbers of the
        shape; "" for a fraction of the diagonal.

    Raises
    ------
    InvalidOptionError
        When the unit is unknown or the amount is no finite number.

    Examples
    --------
    >>> import medialis
    >>> medialis.Length(1, "mm"), medialis.Length(0.5, "%")
    (1 mm, 0.5 %)
    """

    amount: float
    unit: str

    def __post_init__(self) -> None:
        unit = self.unit if self.unit in (SHARE, PERCENT, UNITS) else unit_name(self.unit)
        unit = UNITS if unit is None and _WORDS.get(self.unit.lower()) == UNITS else unit
        if unit is None:
            raise InvalidOptionError(
                f"A length is in %, units (of the file), or one of {_KNOWN}, got {self.unit!r}."
            )
        if isinstance(self.amount, bool | str) or not math.isfinite(self.amount):
            raise InvalidOptionError(f"A length must be a finite number, got {self.amount!r}.")
        object.__setattr__(self, "amount", float(self.amount))
        object.__setattr__(self, "unit", unit)

    def __str__(self) -> str:
        return f"{self.amount!r}".removesuffix(".0") + (f" {self.unit}" if self.unit else "")

    __repr__ = __str__

    @property
    def share(self) -> float | None:
        """The fraction of the diagonal, where that needs no shape."""
        return {SHARE: self.amount, PERCENT: self.amount / 100.0}.get(self.unit)


def with_unit(value: float, unit: str | None, power: int = 1) -> str:
    """Return a number for people with its unit, where that is known.

    Examples
    --------
    >>> with_unit(0.5, "mm"), with_unit(1234567.8, "mm", 2), with_unit(2.0, None)
    ('0.5 mm', '1,234,568 mm²', '2')
    """
    text = f"{value:,.0f}" if 1e3 <= abs(value) < 1e12 else f"{value:.4g}"
    return text + (f" {unit}{'²' if power == 2 else ''}" if unit else "")


def mm(amount: float) -> Any:
    """Return a length in millimetres, for any length option.

    See Also
    --------
    inch, percent : other units.
    Length : any unit.

    Examples
    --------
    >>> import medialis
    >>> shape = medialis.make_shape([[0, 0, 0], [30, 0, 0], [0, 40, 0]], [[0, 1, 2]], unit="mm")
    >>> medialis.refine(shape, longest_edge=medialis.mm(10)).point_count > 3
    True
    """
    return Length(amount, "mm")


def inch(amount: float) -> Any:
    """Return a length in inches, for any length option.

    See Also
    --------
    mm, percent : other units.

    Examples
    --------
    >>> import medialis
    >>> medialis.inch(0.2)
    0.2 in
    """
    return Length(amount, "in")


def percent(amount: float) -> Any:
    """Return a length in per cent of the bounding-box diagonal, for any length option.

    See Also
    --------
    mm, inch : real lengths.

    Examples
    --------
    >>> import medialis
    >>> medialis.percent(0.5)
    0.5 %
    """
    return Length(amount, PERCENT)


def as_length(value: Any, name: str, low: float, high: float) -> Length:
    """Return text or a `Length` as a length whose share, where it is known, is within low..high.

    Raises
    ------
    InvalidOptionError
        For other text, or out of the range; a bare number that can hardly be meant as a fraction
        gets a sentence that shows what else it could be.
    """
    given = value
    if isinstance(value, str):
        match = _LENGTH.fullmatch(value)
        if match is None:
            raise InvalidOptionError(
                f"{name} must be a length, such as 0.5% of the size, 1mm, 0.2in, or 3units of the "
                f"file, got {value!r}."
            )
        given = Length(float(match[1]), match[2])
    length: Length = given
    share = length.share
    bare = isinstance(value, str) and length.unit == SHARE
    if bare and share is not None and share > 0 and (share >= 1 or not low <= share <= high):
        word = value.strip()
        raise InvalidOptionError(
            f"{name} {word} would be {100 * share:g} % of the size, because a bare number is a "
            f"fraction of the diagonal: write {word}mm for a length, {word}units for one in the "
            f"unit of the shape, or {word}% for a share; it may be {100 * low:g} % to "
            f"{100 * high:g} %."
        )
    if length.amount < 0 or (share is not None and not low <= share <= high):
        raise InvalidOptionError(
            f"{name} must be {100 * low:g} % to {100 * high:g} % of the size, got {given}; write a "
            "share as 0.5%, a length as 1mm."
        )
    return length


@dataclass(frozen=True)
class Size:
    """What lengths are measured by: the bounding-box diagonal, and the unit of its number."""

    diagonal: float
    unit: str | None = None

    @classmethod
    def of(cls, data: Any) -> Size:
        """Return the size of a shape, of what was computed from one, or of points."""
        part, diagonal, unit = data, None, None
        while part is not None and unit is None:
            own = getattr(part, "diagonal", None)  # arrays have another thing of this name
            diagonal = own if diagonal is None and isinstance(own, float) else diagonal
            unit = getattr(part, "unit", None)
            inside = (getattr(part, name, None) for name in _INSIDE)
            part = next((inner for inner in inside if inner is not None), None)
        if diagonal is not None:
            return cls(diagonal, unit)
        points = np.asarray(data, np.float64)
        return cls(float(math.hypot(*np.ptp(points, axis=0))), unit)

    def text(self, length: float) -> str:
        """Return a length of the shape's own numbers with its unit."""
        return with_unit(length, self.unit)

    def fraction(self, length: Length, name: str) -> float:
        """Return a length as a fraction of the diagonal.

        Raises
        ------
        InvalidOptionError
            When it is a real one and the unit of the shape is unknown.
        """
        if length.share is not None:
            return length.share
        own = length.amount
        if length.unit != UNITS:
            if self.unit is None:
                raise InvalidOptionError(
                    f"{name} is {length}, but it is not known in which unit the shape is: say so "
                    "with --unit mm (in Python unit='mm' of read_shape and make_shape), or give a "
                    "share such as 0.5%."
                )
            own *= METERS[length.unit] / METERS[self.unit]
        return own / self.diagonal if self.diagonal > 0.0 else 0.0

    def sentence(self, length: Length, name: str) -> str:
        """Return what a given length is, in all three spellings."""
        fraction = self.fraction(length, name)
        own = self.text(fraction * self.diagonal)
        share = f"{with_unit(100 * fraction, PERCENT)} of the diagonal {self.text(self.diagonal)}"
        if length.share is not None:
            return f"{name.replace('_', ' ')}: {share} = {own}."
        first = "" if length.unit == self.unit else f" = {own}"
        return f"{name.replace('_', ' ')}: {length}{first} = {share}."
