"""Colour maps derived in CIELAB, and label colours that differ as much as possible."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from medialis.errors import InvalidOptionError, InvalidShapeError
from medialis.validation import FloatArray, as_choice, as_number, frozen

COLOR_MAPS = ("sequential", "diverging", "sequential_reversed", "diverging_reversed")
MISSING = (0.62, 0.62, 0.62)
"""Grey for NaN values and for the label -1."""

TABLE_SIZE = 1024
PALETTE_SIZE = 48
_WHITE = np.array([0.95047, 1.0, 1.08883])  # D65
_XYZ_OF_RGB = np.array(
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
)


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


def lab_of_rgb(rgb: ArrayLike) -> FloatArray:
    """Return CIELAB (L*, a*, b*) under D65 of sRGB values 0..1, same shape."""
    xyz = to_linear(rgb) @ _XYZ_OF_RGB.T / _WHITE
    f = np.where(xyz > 216 / 24389, np.cbrt(xyz), (24389 / 27 * xyz + 16) / 116)
    return np.stack(
        [116 * f[..., 1] - 16, 500 * (f[..., 0] - f[..., 1]), 200 * (f[..., 1] - f[..., 2])],
        axis=-1,
    )


def rgb_of_lab(lab: ArrayLike) -> FloatArray:
    """Return sRGB values of CIELAB colours; those that no screen shows lie outside 0..1."""
    values = np.asarray(lab, np.float64)
    fy = (values[..., 0] + 16) / 116
    f = np.stack([fy + values[..., 1] / 500, fy, fy - values[..., 2] / 200], axis=-1)
    xyz = np.where(f**3 > 216 / 24389, f**3, (116 * f - 16) * 27 / 24389) * _WHITE
    return to_srgb(xyz @ np.linalg.inv(_XYZ_OF_RGB).T)


def _rgb_of_lch(lightness: ArrayLike, chroma: ArrayLike, hue: ArrayLike) -> FloatArray:
    """Return sRGB of lightness, chroma, hue in degrees; chroma shrinks until a screen shows it."""
    lightness, chroma, hue = np.broadcast_arrays(
        np.asarray(lightness, float), np.asarray(chroma, float), np.deg2rad(hue)
    )

    def rgb(share: FloatArray) -> FloatArray:
        c = chroma * share
        return rgb_of_lab(np.stack([lightness, c * np.cos(hue), c * np.sin(hue)], axis=-1))

    low, high = np.zeros(lightness.shape), np.ones(lightness.shape)
    for _ in range(30):
        middle = (low + high) / 2
        color = rgb(middle)
        fits = ((color >= 0) & (color <= 1)).all(axis=-1)
        low, high = np.where(fits, middle, low), np.where(fits, high, middle)
    return np.clip(rgb(low), 0, 1)


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
    >>> bool((np.diff(lab_of_rgb(table)[:, 0]) > 0).all())
    True
    """
    as_choice(name, "cmap", COLOR_MAPS)
    if name.endswith("_reversed"):
        return frozen(color_table(name.removesuffix("_reversed"))[::-1], np.float64)
    x = np.linspace(0, 1, TABLE_SIZE)
    if name == "sequential":
        stops = [0.0, 0.25, 0.5, 0.75, 1.0]
        hue = _smooth(np.interp(x, stops, [312.0, 280.0, 210.0, 142.0, 92.0]))
        chroma = _smooth(np.interp(x, stops, [50.0, 44.0, 32.0, 50.0, 80.0]))
        return frozen(_rgb_of_lch(20 + 66 * x, chroma, hue), np.float64)
    away = np.abs(2 * x - 1)
    # Below the chroma at which a screen runs out of blue or red, so that the ramps have no kink.
    chroma = np.where(x < 0.5, 46.0, 60.0) * np.sin(away * math.pi / 2)
    hue = np.where(x < 0.5, 268.0, 32.0)
    return frozen(_rgb_of_lch(90 - 52 * away**1.2, chroma, hue), np.float64)


def _smooth(curve: FloatArray) -> FloatArray:
    """Round the corners of a piecewise linear curve (moving average over a fifth of it)."""
    reach = TABLE_SIZE // 10
    padded = np.pad(curve, reach, mode="reflect", reflect_type="odd")
    return np.convolve(padded, np.full(2 * reach + 1, 1 / (2 * reach + 1)), mode="valid")


@lru_cache(maxsize=1)
def palette() -> FloatArray:
    """Return 48 distinct sRGB colours, (48, 3), each as far as possible from those before it.

    Distances are Euclidean in CIELAB, from a fixed grid of lightness, chroma and hue; near white
    and near grey colours are not used.
    """
    lightness, chroma, hue = np.meshgrid(
        [40.0, 53.0, 66.0, 78.0], [38.0, 62.0], np.arange(0, 360, 12.0), indexing="ij"
    )
    rgb = _rgb_of_lch(lightness.ravel(), chroma.ravel(), hue.ravel())
    lab = lab_of_rgb(rgb)
    avoid = np.array([[100.0, 0, 0], [62.0, 0, 0]])
    distance = np.linalg.norm(lab[:, None] - avoid, axis=2).min(axis=1)
    chosen = [int(np.abs(lab - [53.0, -2.0, -45.0]).sum(axis=1).argmin())]  # start with a blue
    for _ in range(PALETTE_SIZE - 1):
        distance = np.minimum(distance, np.linalg.norm(lab - lab[chosen[-1]], axis=1))
        chosen.append(int(distance.argmax()))
    return frozen(rgb[chosen], np.float64)


def label_colors(labels: ArrayLike) -> FloatArray:
    """Return one sRGB colour a label, (n, 3): label i has `palette()` row i mod 48, -1 is grey.

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
    colors = palette()[values.astype(np.int64) % PALETTE_SIZE]
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
    if low is not None and high is None:
        top = max(top, bottom)
    if high is not None and low is None:
        bottom = min(bottom, top)
    if bottom > top:
        raise InvalidOptionError(f"low must not be above high, got {bottom:g} and {top:g}.")
    return bottom, top


def map_colors(
    values: ArrayLike,
    cmap: str = "sequential",
    low: float | None = None,
    high: float | None = None,
    nan_color: tuple[float, float, float] = MISSING,
) -> FloatArray:
    """Return sRGB colours (n, 3) in 0..1 of a scalar field (n,).

    Parameters
    ----------
    values : (n,) float
        NaN gets `nan_color`; values beyond the limits (also infinity) get the end colours.
    cmap : str
        One of `COLOR_MAPS`, see `color_table`.
    low, high : float, optional
        Values of the first and last colour; the range of the finite values when missing. With equal
        limits everything has the middle colour.
    nan_color : three floats 0..1

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
        share = np.full(data.shape, 0.5) + np.sign(data - bottom)
    share = np.where(missing, 0.0, np.clip(share, 0.0, 1.0))
    colors = table[np.rint(share * (TABLE_SIZE - 1)).astype(np.int64)]
    colors[missing] = nan_color
    return colors
