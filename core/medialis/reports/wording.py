"""Numbers and names as people read them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any


def number(value: Any, digits: int = 4) -> str:
    """Return a value as short text.

    Parameters
    ----------
    value : bool, int, float, str or None
        None and NaN are a dash.
    digits : int
        Significant digits of floats.

    Examples
    --------
    >>> number(1234567), number(0.022146883), number(432190.4), number(2.5e-9)
    ('1,234,567', '0.02215', '432,190', '2.5e-09')
    >>> number(float("nan")), number(float("inf")), number(True), number(4.0)
    ('–', 'infinite', 'yes', '4')
    """
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}"
    if not isinstance(value, float):
        return str(value)
    if math.isinf(value):
        return "infinite" if value > 0 else "minus infinite"
    if value == 0:
        return "0"
    if not 1e-4 <= abs(value) < 1e9:
        return f"{value:.{digits}g}"
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    text = f"{value:,.{decimals}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def place(position: Sequence[float], size: float) -> str:
    """Return a position with the decimals that tell places apart in something of a size.

    Examples
    --------
    >>> place([1000000.25, 0.123456, -2], 4.0)
    '(1,000,000.250, 0.123, -2.000)'
    >>> place([1.2345678e-20, 0.0, 1e-21], 4e-20)
    '(1.235e-20, 0, 1e-21)'
    """
    if not 1e-6 < size < 1e9:
        return f"({', '.join(number(float(x)) for x in position)})"
    decimals = max(0, 3 - math.floor(math.log10(size)))
    return f"({', '.join(f'{x:,.{decimals}f}' for x in position)})"


def named(name: str) -> str:
    """Return the name of a value in words.

    Examples
    --------
    >>> named("pixels_that_differ_percent"), named("nonmanifold_edges")
    ('pixels that differ (%)', 'non-manifold edges')
    """
    words = name.removesuffix("_percent").replace("_", " ").replace("nonmanifold", "non-manifold")
    return words + (" (%)" if name.endswith("_percent") else "")
