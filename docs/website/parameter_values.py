"""The values at which a parameter is drawn, from its declaration alone.

A few parameters show nothing on a smooth closed creature, or at values round their default: they
have an example of their own. An operation that is added later needs none.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from make_pictures import _dented_plate

import medialis
from medialis.operations.declaration import Kind, Operation, Parameter

RESOLUTION = 96


@cache
def creature() -> medialis.Shape:
    """Make the shape of most strips."""
    return medialis.organic_shape(RESOLUTION)


def _with_noise(amount: float) -> medialis.Shape:
    """Make the creature with noise of a share of its size along the normals."""
    shape = creature()
    step = np.random.default_rng(0).normal(size=shape.point_count) * amount * shape.diagonal
    return medialis.make_shape(shape.points + step[:, None] * shape.normals, shape.faces)


@cache
def noisy() -> medialis.Shape:
    """Make the creature with noise of 0.05 % of its size."""
    return _with_noise(0.0005)


@cache
def rough() -> medialis.Shape:
    """Make the creature with noise of 0.3 % of its size."""
    return _with_noise(0.003)


@cache
def samples() -> medialis.Shape:
    """Make the creature as a point cloud with normals."""
    shape = creature()
    return medialis.Shape(shape.points, shape.normals)


@cache
def plate() -> medialis.Shape:
    """Make a plate with two dents."""
    return _dented_plate()


@cache
def flat_dumbbell() -> medialis.Shape:
    """Make two flat discs joined by a thin bar."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))
    from closed_forms import dumbbell

    shape = dumbbell(step=0.06)
    return medialis.make_shape(shape.points * [1.0, 0.5, 1.0], shape.faces)


@cache
def block() -> medialis.Shape:
    """Make a block with edges of 18, 32, 70 and 90 degrees, one of them concave."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))
    from closed_forms import prism

    outline = [(0, 0), (3, 0), (3, 0.7), (2.1, 1), (1.3, 1), (1.3, 2), (0.5, 2.3), (0, 2.2)]
    return prism(np.array(outline, float), 1.2, 10.0)


@cache
def sample(name: str) -> medialis.Shape:
    """Make a sample shape."""
    return medialis.sample_shape(name)


@cache
def arch() -> medialis.Shape:
    """Make a dental arch of 12 teeth."""
    return medialis.dental_arch(12, resolution=110)[0]


@cache
def wedge() -> medialis.Shape:
    """Make a box of 8 vertices, three times as thick at one end as at the other."""
    corners = box().points * [1, 1, 0.6]
    return medialis.make_shape(corners * (1 - 0.22 * corners[:, :1] * [0, 0, 1]), box().faces)


@cache
def box() -> medialis.Shape:
    """Make a box of 8 vertices, 3 x 2 x 1."""
    corners = np.array([[x, y, z] for x in (0, 3) for y in (0, 2) for z in (0, 1)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return medialis.make_shape(corners, faces, repair=True)


def _cloud(scatter: float) -> medialis.Shape:
    """Make a cloud of a ball in a disc, four small discs, and outliers."""
    rng = np.random.default_rng(0)
    ball = rng.normal(size=(4000, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    pieces = [ball]
    for count, size, middle in ((6000, 2.0, (0, 0)), (100, 0.25, (-2, 2)), (50, 0.18, (-1, 2.4)),
                                (25, 0.14, (0, 2.7)), (12, 0.1, (0.8, 2.6))):  # fmt: skip
        turn, reach = rng.uniform(0, 2 * np.pi, count), size * np.sqrt(rng.uniform(size=count))
        x, y, height = reach * np.cos(turn), reach * np.sin(turn), 0.0 if size == 2.0 else 0.8
        pieces.append(np.stack([x + middle[0], y + middle[1], 0 * x + height], axis=1))
    points = np.concatenate(pieces)
    points += scatter * rng.normal(size=points.shape)
    low, high = [-2.2, -2.2, -1.4], [2.2, 2.9, 1.4]
    points = np.concatenate([points, rng.uniform(low, high, (1500, 3))])
    return medialis.Shape(points, np.zeros_like(points))


@cache
def cloud() -> medialis.Shape:
    """Make a cloud of several surfaces, two of which cross, with outliers."""
    return _cloud(0.0)


@cache
def scattered() -> medialis.Shape:
    """Make the same cloud with points that lie off their surfaces."""
    return _cloud(0.02)


@dataclass(frozen=True)
class Example:
    """What a parameter is drawn on: a shape, values, and what the other parameters are.

    `layer` and `color_by` name what is drawn of the result, where it is not what is shown first.
    """

    values: tuple[Any, ...] = ()
    shape: Callable[[], medialis.Shape] | None = None
    others: Mapping[str, Any] = field(default_factory=dict)
    layer: str = ""
    color_by: str | None = None


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
    "remove_outliers": cloud,
    "smooth": rough,
    "manifolds": cloud,
    "soft_edges": block,
    "patches": block,
}
"""Shapes on which an operation shows more than on its sample."""


def default_shape(operation: Operation) -> Callable[[], medialis.Shape]:
    """Return what makes the shape that an operation is shown on."""
    own = creature if operation.sample == "creature" else partial(sample, operation.sample)
    return SHAPES.get(operation.name, own)


EXAMPLES: dict[str, Callable[[], Example]] = {
    "tolerance": lambda: Example((0.0, 0.0003, 0.001, 0.003), noisy),
    "refine": lambda: Example((0.0, 0.01, 0.02, 0.05), box),
    "largest_radius": lambda: Example((0.01, 0.02, 0.04, 1.0)),
    "denoise": lambda: Example(shape=rough),
    "reconstruct": lambda: Example(shape=samples),
    "neighbours": lambda: Example((5, 7, 10, 20)),
    "min_points": lambda: Example((5, 20, 40, 80)),
    "max_bend": lambda: Example((1.0, 4.0, 8.59, 18.0)),
    "smooth": lambda: Example(shape=scattered),
    "armature.blend": lambda: Example((0.0, 1.0, 4.0), layer="skin", color_by="weight"),
    "armature.skin_smoothing": lambda: Example((0.0, 0.3, 1.2), layer="skin", color_by="weight"),
    "armature.smoothing": lambda: Example((0.0, 0.7, 2.8), others={"bone_length": 0.02}),
    "armature.tolerance": lambda: _undenoised(),
    "ball_reconstruction.order": lambda: Example(others={"progressive": True}),
    "ball_reconstruction.size": lambda: Example((200, 400, 800)),
    "curve_skeleton.smoothing": lambda: Example((0.0, 0.175, 0.7, 2.8)),
    "curve_skeleton.simplify": lambda: Example((0.0, 0.002, 0.005, 0.02)),
    "curve_skeleton.threshold": lambda: Example((0.02, 0.04, 0.08, 0.16)),
    "curve_skeleton.tolerance": lambda: _undenoised(),
    "remove_outliers.max_turn": lambda: Example((1.0, 4.0, 12.0, 30.0)),
    "geodesic_path.directions": lambda: Example((2, 4, 20, 60), others=_flanks()),
    "geodesic_path.end": lambda: Example(_along(0)[:3]),
    "geodesic_path.start": lambda: Example(_along(0)),
    "manifolds.cloud": lambda: Example(shape=creature),
    "manifolds.max_turn": lambda: Example((1.0, 3.0, 5.73, 30.0)),
    "manifolds.refine": lambda: Example((0.0, 0.005, 0.02), creature, {"cloud": "skeleton"}),
    "manifolds.surfaces": lambda: Example(layer="manifold_surfaces"),
    "manifolds.tolerance": lambda: Example((0.0, 0.0003, 0.001), noisy, {"cloud": "skeleton"}),
    "mean_shift_segments.fill": lambda: Example(shape=arch, others={**TEETH, "last_steps": 20}),
    "mean_shift_segments.last_steps": lambda: Example((0, 5, 20, 80), arch, {**TEETH}),
    "medial_mesh.balls": lambda: Example((10, 30, 120, 500)),
    "medial_mesh.error": lambda: Example((0.005, 0.01, 0.03, 0.1)),
    "medial_mesh.relief": lambda: Example((0.0, 0.002, 0.02, 0.1), noisy),
    "medial_mesh.samples": lambda: Example((500, 2000, 5000)),
    "medial_mesh.cell": lambda: Example((0.005, 0.01, 0.05), layer="medial_mesh_envelope"),
    "medial_sheets.smallest": lambda: Example((0.0, 0.01, 0.05, 0.2), block),
    "midsurface.angle": lambda: Example((120.0, 150.0, 170.0), wedge),
    "midsurface.edge": lambda: Example((0.01, 0.02, 0.05), plate),
    "parts.smallest": lambda: Example((0.002, 0.01, 0.02, 0.05)),
    "parts.smoothing": lambda: Example((0, 1, 4, 16), noisy),
    "parts.sheet_threshold": lambda: Example((1.5, 4.0, 16.0), others={"method": "sheets"}),
    "patches.min_angle": lambda: Example((10.0, 30.0, 50.0, 80.0)),
    "patches.smallest": lambda: Example((0.002, 0.04, 0.08, 0.15)),
    "skeleton_importance.connected": lambda: Example(shape=flat_dumbbell, others=ISLANDS),
    "skeleton_importance.threshold": lambda: Example((0.0, 0.02, 0.05, 0.1), noisy),
    "skeleton_mesh.bridge": lambda: Example((0, 1, 2, 4), noisy),
    "skeleton_mesh.importance": lambda: Example(
        (0.0, 0.01, 0.03, 0.1), noisy, {"min_spoke_angle": 0.0}
    ),
    "skeleton_mesh.min_spoke_angle": lambda: Example((0.0, 45.0, 90.0, 135.0), noisy),
    "skeleton_mesh.smallest_piece": lambda: Example((0.0, 0.01, 0.03, 0.1), noisy, {"bridge": 0}),
    "thickness.refine": lambda: Example((0.0, 0.01, 0.05, 0.2), wedge),
    "thickness.threshold": lambda: Example(
        (0.0, 0.03, 0.06, 0.15), plate, layer="thickness", color_by="thin_spot"
    ),
    "view_curve_skeleton.angle": lambda: Example((1.0, 5.0, 20.0, 80.0)),
    "view_curve_skeleton.pairs": lambda: Example((5, 10, 20, 100)),
    "view_curve_skeleton.saliency": lambda: Example((0.05, 0.25, 1.0, 20.0)),
    "view_curve_skeleton.size": lambda: Example((32, 64, 128, 512)),
}
"""By operation and parameter, or by parameter for all operations that have it."""

TEETH = {"seeds": "bumps", "fill": False}
ISLANDS = {"threshold": 0.2}


def _undenoised() -> Example:
    """Return the example of a tolerance where noise would be smoothed away before."""
    return Example((0.0, 0.0003, 0.001, 0.003), noisy, {"denoise": "off"})


def _flanks() -> dict[str, int]:
    """Vertices on the rump and on the other flank, between which few plane cuts are short."""
    points = creature().points
    ends = [
        int(np.argmin(np.linalg.norm(points - place, axis=1)))
        for place in ([-0.4, -0.15, 0.63], [0.46, 0.23, 0.12])
    ]
    return dict(zip(("start", "end"), ends, strict=True))


def example_of(operation: Operation, parameter: Parameter) -> Example:
    """Return shape, values from low to high, and other parameters for a strip."""
    known = EXAMPLES.get(f"{operation.name}.{parameter.name}") or EXAMPLES.get(parameter.name)
    example = known() if known else Example()
    others = {**BASE.get(operation.name, dict)(), **example.others}
    others.pop(parameter.name, None)
    shape = example.shape or default_shape(operation)
    if shape is not creature:
        others = {name: v for name, v in others.items() if name not in ("start", "end")}
    values = tuple(v for v in example.values if _allowed(parameter, v)) or values_of(parameter)
    return replace(example, values=values, shape=shape, others=others)


def _allowed(parameter: Parameter, value: Any) -> bool:
    try:
        parameter.check(value)
    except medialis.InvalidOptionError:
        return False
    return True


def values_of(parameter: Parameter) -> tuple[Any, ...]:
    """Return up to four values from low to high, the default among them; none for files.

    Of automatic options, the number from which they start counts as the default.

    Numbers are spread by factors round the default, where it is not 0; angles evenly.
    """
    default = parameter.default if parameter.auto is None else parameter.auto
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
