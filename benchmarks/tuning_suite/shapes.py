"""Two dozens of small shapes, made by code: solids, and clouds of points."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import medialis
from medialis.shape.reading import make_shape

sys.path.append(str(Path(__file__).resolve().parents[2] / "tests"))
import clouds
import plates

RESOLUTION = 56
"""Of `sample_shape`: the least that it takes, some 2,500 vertices."""

POINTS = 1200
"""Of a part of a cloud."""


def _noisy(name: str, share: float) -> medialis.Shape:
    """Return a sample with vertices that are moved by a share of its size."""
    shape = medialis.sample_shape(name, RESOLUTION)
    noise = np.random.default_rng(0).normal(size=shape.points.shape)
    return make_shape(shape.points + share * shape.diagonal * noise, shape.faces)


def _cloud(points: Any) -> medialis.Shape:
    return make_shape(np.ascontiguousarray(points))


def _sample_points(name: str) -> medialis.Shape:
    shape = medialis.sample_shape(name, RESOLUTION)
    return medialis.Shape(shape.points, shape.normals)


SOLIDS: dict[str, Callable[[], medialis.Shape]] = {
    **{
        name: lambda name=name: medialis.sample_shape(name, RESOLUTION)
        for name in ("creature", "hand", "tree", "molecule", "gear", "vase", "bracket")
    },
    "tee": lambda: make_shape(*plates.tee()),
    "ribs": lambda: make_shape(*plates.bracket()),
    "bent sheet": lambda: make_shape(*plates.bent_sheet(steps=12, layers=8)),
    "noisy hand": lambda: _noisy("hand", 0.002),
    "points of the creature": lambda: _sample_points("creature"),
}

CLOUDS: dict[str, Callable[[], medialis.Shape]] = {
    "crossing planes": lambda: _cloud(clouds.crossing_planes(50, POINTS)[0]),
    "flat crossing": lambda: _cloud(clouds.crossing_planes(20, POINTS)[0]),
    "three planes": lambda: _cloud(clouds.three_planes(POINTS)[0]),
    "sphere and plane": lambda: _cloud(clouds.sphere_and_plane(POINTS)[0]),
    "spiral and plane": lambda: _cloud(clouds.spiral_and_plane(2 * POINTS)[0]),
    "parallel sheets": lambda: _cloud(clouds.parallel_sheets(POINTS)[0]),
    "moebius band": lambda: _cloud(clouds.mobius_band(POINTS)[0]),
    "rough planes": lambda: _cloud(clouds.jittered(clouds.three_planes(POINTS)[0], 0.01)),
    "rough band": lambda: _cloud(clouds.jittered(clouds.mobius_band(2 * POINTS)[0], 0.02)),
    "planes in dust": lambda: _cloud(clouds.with_outliers(clouds.three_planes(POINTS)[0], 0.2)),
    "laser room": lambda: _cloud(clouds.laser_room(4.0, 0.0)[0]),
    "rough laser room": lambda: _cloud(clouds.laser_room(4.0, 0.01)[0]),
}


@cache
def shape(name: str) -> medialis.Shape:
    """Return a shape by name, made once."""
    return (SOLIDS.get(name) or CLOUDS[name])()
