"""The values at which a parameter is drawn, from its declaration alone.

A few parameters show nothing on a smooth closed creature, or at values round their default: they
have an example of their own. An operation that is added later needs none.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np

import medialis
from medialis.operations.declaration import Kind, Operation, Parameter

RESOLUTION = 96


@cache
def creature() -> medialis.Shape:
    """Make the shape of most strips."""
    return medialis.organic_shape(RESOLUTION)


@cache
def noisy() -> medialis.Shape:
    """Make the creature with noise of 0.05 % of its size along the normals."""
    shape = creature()
    step = np.random.default_rng(0).normal(size=shape.point_count) * 0.0005 * shape.diagonal
    return medialis.make_shape(shape.points + step[:, None] * shape.normals, shape.faces)


@cache
def box() -> medialis.Shape:
    """Make a box of 8 vertices, 3 x 2 x 1."""
    corners = np.array([[x, y, z] for x in (0, 3) for y in (0, 2) for z in (0, 1)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return medialis.make_shape(corners, faces, repair=True)


@cache
def cloud() -> medialis.Shape:
    """Make a cloud of two crossing planes and a ball, with 20 % outliers."""
    rng = np.random.default_rng(0)
    ball = rng.normal(size=(4000, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    planes = [rng.uniform(-1.5, 1.5, (3000, 3)) * scale for scale in ((1, 1, 0), (1, 0, 1))]
    points = np.concatenate([ball, *planes, rng.uniform(-1.5, 1.5, (2000, 3))])
    return medialis.Shape(points, np.zeros_like(points))


@dataclass(frozen=True)
class Example:
    """What a parameter is drawn on: a shape, values, and what the other parameters are."""

    values: tuple[Any, ...] = ()
    shape: Callable[[], medialis.Shape] | None = None
    others: Mapping[str, Any] = field(default_factory=dict)


def _ends() -> dict[str, int]:
    """Vertices at the nose and at a hind foot."""
    points = creature().points
    ends = [int(np.argmax(points @ d)) for d in ((1, 0.1, -0.2), (-0.4, 0.5, -1))]
    return dict(zip(("start", "end"), ends, strict=True))


def _along(axis: int) -> tuple[int, ...]:
    """Vertices at four places of the creature, from one end to the other."""
    values = creature().points[:, axis]
    shares = np.linspace(values.min(), values.max(), 4)
    return tuple(int(np.argmin(np.abs(values - share))) for share in shares)


BASE: dict[str, Callable[[], dict[str, Any]]] = {"geodesic_path": _ends}
"""Parameters of an operation that has nothing to show at its defaults."""

SHAPES: dict[str, Callable[[], medialis.Shape]] = {
    "denoise": cloud,
    "manifolds": cloud,
}
"""Shapes on which an operation shows more than on the creature."""

EXAMPLES: dict[str, Callable[[], Example]] = {
    "tolerance": lambda: Example((0.0, 0.0003, 0.001, 0.003), noisy),
    "refine": lambda: Example((0.0, 0.01, 0.02, 0.05), box),
    "largest_radius": lambda: Example((0.01, 0.02, 0.04, 1.0)),
    "connected": lambda: Example(shape=noisy, others={"threshold": 0.05}),
    "manifolds.cloud": lambda: Example(shape=creature),
    "manifolds.refine": lambda: Example((0.0, 0.005, 0.02), creature, {"cloud": "skeleton"}),
    "manifolds.tolerance": lambda: Example(shape=creature, others={"cloud": "skeleton"}),
    "mean_shift_segments.last_steps": lambda: Example((0, 5, 20, 80)),
    "mean_shift_segments.fill": lambda: Example(others={"last_steps": 20}),
    "geodesic_path.start": lambda: Example(_along(0)),
    "geodesic_path.end": lambda: Example(_along(0)),
    "skeleton_importance.threshold": lambda: Example((0.0, 0.02, 0.05, 0.1), noisy),
    "skeleton_mesh.bridge": lambda: Example((0, 1, 2, 4), noisy),
    "thickness.threshold": lambda: Example((0.0, 0.04, 0.08, 0.12)),
    "ball_reconstruction.size": lambda: Example((100, 200, 400)),
    "ball_reconstruction.order": lambda: Example(others={"progressive": True}),
}
"""By operation and parameter, or by parameter for all operations that have it."""


def example_of(operation: Operation, parameter: Parameter) -> Example:
    """Return shape, values from low to high, and other parameters for a strip."""
    known = EXAMPLES.get(f"{operation.name}.{parameter.name}") or EXAMPLES.get(parameter.name)
    example = known() if known else Example()
    others = {**BASE.get(operation.name, dict)(), **example.others}
    others.pop(parameter.name, None)
    shape = example.shape or SHAPES.get(operation.name, creature)
    if shape is not creature:
        others = {name: v for name, v in others.items() if name not in ("start", "end")}
    values = tuple(v for v in example.values if _allowed(parameter, v)) or values_of(parameter)
    return Example(values, shape, others)


def _allowed(parameter: Parameter, value: Any) -> bool:
    try:
        parameter.check(value)
    except medialis.InvalidOptionError:
        return False
    return True


def values_of(parameter: Parameter) -> tuple[Any, ...]:
    """Return up to four values from low to high, the default among them; none for files.

    Numbers are spread by factors round the default, where it is not 0; angles evenly.
    """
    default = parameter.default
    if parameter.kind is Kind.FILE:
        return ()
    if parameter.kind is Kind.BOOL:
        return (False, True)
    if parameter.kind is Kind.CHOICE:
        rest = [choice for choice in parameter.choices if choice != default]
        shown = {default, *rest[:3]}
        return tuple(choice for choice in parameter.choices if choice in shown)
    if default:
        wanted = [default / 4, default, default * 4]
        if parameter.kind is Kind.INT:
            wanted = [default / 4, default / 2, default, default * 2]
        if parameter.kind is Kind.ANGLE:
            wanted = [parameter.low, default / 2, default, (default + parameter.high) / 2]
    else:
        steps = {Kind.LENGTH: (0.005, 0.02, 0.05), Kind.ANGLE: (30, 60, 90), Kind.INT: (1, 2, 4)}
        span = parameter.high - parameter.low
        wanted = [0, *steps.get(parameter.kind, (span / 4, span / 2, span))]
    kept = {float(np.clip(value, parameter.low, parameter.high)) for value in wanted}
    if parameter.kind is Kind.INT:
        return tuple(sorted({round(value) for value in kept}))
    return tuple(sorted(kept))
