"""Colour maps with even lightness, and label colours that differ as much as possible."""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from medialis.base.errors import InvalidOptionError, InvalidShapeError
from medialis.base.validation import FloatArray, as_choice, as_number, frozen

COLOR_MAPS = ("sequential", "diverging", "sequential_reversed", "diverging_reversed")
MISSING = (0.62, 0.62, 0.62)
"""Grey for NaN values and for the label -1."""

TABLE_SIZE = 1024
PALETTE_SIZE = 48

ROUNDING = 1e-9
"""Share of the numbers themselves that rounding makes of one value."""

SAME = 2e-3
"""Share of the numbers themselves: values that differ by less have one colour. A legend tells three
digits, and a scale of five times the same number says nothing."""


def to_linear(rgb: ArrayLike) -> FloatArray:
    """Return linear light of sRGB values 0..1 (IEC 61966-2-1)."""
    value = np.asarray(rgb, np.float64)
    return np.where(
        value <= 0.04045, value / 12.92, ((np.maximum(value, 0) + 0.055) / 1.055) ** 2.4
    )


def to_srgb(linear: ArrayLike) -> FloatArray:
    """Return sRGB values of linear light 0..1; out-of-range values stay out of range."""
    value = np.asarray(linear, np.float64)
    bright = 1.055 * np.maximum(value, 0.0031308) ** (1 / 2.4) - 0.055
    return np.where(value <= 0.0031308, 12.92 * value, bright)


@lru_cache(maxsize=8)
def color_table(name: str) -> FloatArray:
    """Return the 1024 sRGB colours of a map, (1024, 3) in 0..1, read-only.

    "sequential" rises in lightness L* evenly from 20 (violet) over blue, teal and green to 86
    (yellow); "diverging" runs from blue (L* 38) over a light grey (L* 90) to red (L* 38);
    "_reversed" turns them round.

    Raises
    ------
    InvalidOptionError
        When the name is not one of `COLOR_MAPS`.

    Examples
    --------
    >>> table = color_table("sequential")
    >>> table.shape, table[0].round(2).tolist()
    ((1024, 3), [0.26, 0.11, 0.41])
    """
    as_choice(name, "cmap", COLOR_MAPS)
    if name.endswith("_reversed"):
        return frozen(color_table(name.removesuffix("_reversed"))[::-1], np.float64)
    return frozen(_stored()[name], np.float64)


@lru_cache(maxsize=1)
def _stored() -> dict[str, FloatArray]:
    """Return the tables of ``colors.npz``, which ``docs/make_color_maps.py`` derives in CIELAB."""
    with np.load(Path(__file__).with_name("colors.npz")) as tables:
        return dict(tables)


@lru_cache(maxsize=1)
def palette() -> FloatArray:
    """Return 48 distinct sRGB colours, (48, 3), each as far as possible from those before it.

    Distances are Euclidean in CIELAB, from a fixed grid of lightness, chroma and hue; near white
    and near grey colours are not used.
    """
    return frozen(_stored()["palette"], np.float64)


def label_colors(labels: ArrayLike, own: ArrayLike | None = None) -> FloatArray:
    """Return one sRGB colour a label, (n, 3): label i has `palette()` row i mod 48, -1 is grey.

    With colours of its `own` (k, 3) it has the row i mod k of these.

    Raises
    ------
    InvalidShapeError
        When the labels are not whole numbers.

    Examples
    --------
    >>> colors = label_colors([0, 1, 0, -1])
    >>> bool((colors[0] == colors[2]).all()), colors[3].tolist()
    (True, [0.62, 0.62, 0.62])
    """
    values = np.asarray(labels)
    if values.dtype.kind not in "iub":
        raise InvalidShapeError(f"labels must be whole numbers, got {values.dtype} values.")
    table = palette() if own is None else np.asarray(own, np.float64)
    colors = table[values.astype(np.int64) % len(table)]
    colors[values < 0] = MISSING
    return colors


def value_range(
    values: ArrayLike, low: float | None = None, high: float | None = None
) -> tuple[float, float]:
    """Return the limits of a colour scale: those given, else the smallest and largest finite value.

    Raises
    ------
    InvalidOptionError
        When low is above high.
    """
    data = np.asarray(values, np.float64)
    finite = data[np.isfinite(data)]
    bottom = as_number(low, "low") if low is not None else float(finite.min(initial=np.inf))
    top = as_number(high, "high") if high is not None else float(finite.max(initial=-np.inf))
    if len(finite) == 0:  # nothing to scale by
        bottom = bottom if math.isfinite(bottom) else min(0.0, top if math.isfinite(top) else 0.0)
        top = top if math.isfinite(top) else max(1.0, bottom)
    if low is None and high is None and abs(top - bottom) <= SAME * max(abs(top), abs(bottom)):
        top = bottom
    if low is not None and high is None:
        top = max(top, bottom)
    if high is not None and low is None:
        bottom = min(bottom, top)
    if bottom > top:
        raise InvalidOptionError(f"low must not be above high, got {bottom:g} and {top:g}.")
    return bottom, top


NEAR_LIMIT, FAR_FROM_LIMIT = 1.25, 3.0
"""Times the limit: what is below the first is near it, from the second on the colour stays."""
_LIMIT_COLORS = (
    (0.0, (0.42, 0.02, 0.07)), (1.0, (0.89, 0.36, 0.29)),  # below: red
    (1.0, (0.97, 0.78, 0.30)), (NEAR_LIMIT, (0.97, 0.78, 0.30)),  # near: yellow
    (NEAR_LIMIT, (0.84, 0.88, 0.89)), (FAR_FROM_LIMIT, (0.35, 0.53, 0.68)),  # above: grey to blue
)  # fmt: skip


def limit_colors(values: ArrayLike, limit: float) -> FloatArray:
    """Return sRGB colours (n, 3): red below a limit, yellow near it, grey to blue above.

    Examples
    --------
    >>> limit_colors([0.5, 1.1, 9.0], 1.0).round(1).tolist()
    [[0.7, 0.2, 0.2], [1.0, 0.8, 0.3], [0.4, 0.5, 0.7]]
    """
    share = np.asarray(values, np.float64) / limit
    colors = np.full((*share.shape, 3), MISSING)
    for (low, first), (high, last) in zip(_LIMIT_COLORS[::2], _LIMIT_COLORS[1::2], strict=True):
        inside = share >= low if low else ~np.isnan(share)
        part = np.clip((share[inside] - low) / (high - low), 0.0, 1.0)[:, None]
        colors[inside] = np.array(first) * (1 - part) + np.array(last) * part
    return colors


def map_colors(
    values: ArrayLike,
    cmap: str = "sequential",
    low: float | None = None,
    high: float | None = None,
) -> FloatArray:
    """Return sRGB colours (n, 3) in 0..1 of a scalar field (n,).

    Parameters
    ----------
    values : (n,) float
        NaN gets `MISSING`; values beyond the limits (also infinity) get the end colours.
    cmap : str
        One of `COLOR_MAPS`, see `color_table`.
    low, high : float, optional
        Values of the first and last colour; the range of the finite values when missing. With equal
        limits everything has the middle colour.

    Raises
    ------
    InvalidOptionError
        When the map is unknown or low is above high.

    Examples
    --------
    >>> map_colors([0.0, np.nan, 1.0])[1].tolist()
    [0.62, 0.62, 0.62]
    """
    table = color_table(cmap)
    data = np.asarray(values, np.float64)
    bottom, top = value_range(data, low, high)
    missing = np.isnan(data)
    if top > bottom:
        # Halves, because top - bottom can overflow.
        share = (data / 2 - bottom / 2) / (top / 2 - bottom / 2)
    else:
        given = low is not None or high is not None
        alike = np.isclose(data, bottom, rtol=ROUNDING if given else SAME, atol=0.0)
        away = np.where(alike, 0.0, data - bottom)
        share = np.full(data.shape, 0.5) + np.sign(away)
    share = np.where(missing, 0.0, np.clip(share, 0.0, 1.0))
    colors = table[np.rint(share * (TABLE_SIZE - 1)).astype(np.int64)]
    colors[missing] = MISSING
    return colors
