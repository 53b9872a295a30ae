"""Derive the colour maps and label colours of the project in CIELAB, and write them to its data.

python docs/make_color_maps.py
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from medialis.base.validation import FloatArray
from medialis.show.colors import PALETTE_SIZE, TABLE_SIZE, to_linear, to_srgb

TARGET = Path(__file__).resolve().parents[1] / "core" / "medialis" / "render" / "colors.npz"
_WHITE = np.array([0.95047, 1.0, 1.08883])  # D65
_XYZ_OF_RGB = np.array(
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
)


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


def sequential() -> FloatArray:
    """Return colours whose lightness L* rises evenly from 20 (violet) to 86 (yellow)."""
    x = np.linspace(0, 1, TABLE_SIZE)
    stops = [0.0, 0.25, 0.5, 0.75, 1.0]
    hue = _smooth(np.interp(x, stops, [312.0, 280.0, 210.0, 142.0, 92.0]))
    chroma = _smooth(np.interp(x, stops, [50.0, 44.0, 32.0, 50.0, 80.0]))
    return _rgb_of_lch(20 + 66 * x, chroma, hue)


def diverging() -> FloatArray:
    """Return colours from blue (L* 38) over a light grey (L* 90) to red (L* 38)."""
    away = np.abs(2 * np.linspace(0, 1, TABLE_SIZE) - 1)
    first_half = np.arange(TABLE_SIZE) < TABLE_SIZE // 2
    # Below the chroma at which a screen runs out of blue or red, so that the ramps have no kink.
    chroma = np.where(first_half, 46.0, 60.0) * np.sin(away * math.pi / 2)
    hue = np.where(first_half, 268.0, 32.0)
    return _rgb_of_lch(90 - 52 * away**1.2, chroma, hue)


def _smooth(curve: FloatArray) -> FloatArray:
    """Round the corners of a piecewise linear curve (moving average over a fifth of it)."""
    half = TABLE_SIZE // 10
    padded = np.pad(curve, half, mode="reflect", reflect_type="odd")
    return np.convolve(padded, np.full(2 * half + 1, 1 / (2 * half + 1)), mode="valid")


def palette() -> FloatArray:
    """Return distinct colours, each as far as possible from those before it.

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
        chosen.append(int(distance.round(9).argmax()))  # of ties, the first: on any machine
    return rgb[chosen]


def main() -> None:
    """Write the tables."""
    np.savez_compressed(TARGET, sequential=sequential(), diverging=diverging(), palette=palette())


if __name__ == "__main__":
    main()
