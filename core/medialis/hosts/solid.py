"""Curves as tubes and marked places as balls, for hosts that draw lines and points a pixel wide."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import polylines
from medialis.base.validation import FloatArray
from medialis.hosts.drawing import LARGEST_DOT, TUBE
from medialis.operations.result import Layer
from medialis.show.colors import value_range

SIDES = 8
OF_RADIUS = 0.15
"""Radius of a tube: that of drawn curves, and this share of the medial radius more."""

DARK_SHARE = 0.6
"""How much longer the colour scale of a tube begins before its values: without its dark third."""

Solid = tuple[FloatArray, NDArray[np.int64], NDArray[np.int64]]
"""Points, faces, and the row of the layer that each point comes from."""


def solid(layer: Layer, diagonal: float) -> Layer:
    """Return a layer with its edges as tubes, or its numbered places as balls; others stay.

    Attributes are those of the point that a vertex of a tube or ball belongs to. Curves with
    numbered branches have a colour for each, marks one for each place.

    Parameters
    ----------
    layer : Layer
    diagonal : float
        Of the shape.

    Examples
    --------
    >>> line = Layer("line", [[0, 0, 0], [1, 0, 0.0]], edges=[[0, 1]])
    >>> tube = solid(line, 1.0)
    >>> tube.edges is None, len(tube.points), len(tube.faces)
    (True, 18, 32)
    """
    if layer.number_by is not None and layer.faces is None and layer.edges is None:
        attributes = {**layer.attributes, "spot": np.arange(len(layer.points), dtype=np.int32)}
        marks = replace(layer, attributes=attributes, color_by="spot", labels=("spot",))
        return _made_of(marks, _balls(np.asarray(layer.points, np.float64), LARGEST_DOT * diagonal))
    if layer.edges is None:
        return layer
    radii = np.full(len(layer.points), TUBE * diagonal)
    if "radius" in layer.attributes:
        radii += OF_RADIUS * np.nan_to_num(np.asarray(layer.attributes["radius"], np.float64))
    points = np.asarray(layer.points, np.float64)
    made = _made_of(layer, _tubes(points, np.asarray(layer.edges), radii))
    return _bright(made, by_branch=layer.faces is None)


def _bright(layer: Layer, *, by_branch: bool) -> Layer:
    """Colour curves by branch, else without the dark colours of the map."""
    on_points = [name for name in layer.labels if name in layer.attributes]
    if by_branch and on_points:
        return replace(layer, color_by=on_points[0])
    values = layer.attributes.get(layer.color_by or "")
    if values is None:
        return layer
    low, high = value_range(values, *layer.color_limits)
    return replace(layer, color_limits=(low - DARK_SHARE * (high - low), high))


def _made_of(layer: Layer, made: Solid) -> Layer:
    """Return the layer with this mesh in the place of its edges or points; its faces stay."""
    points, faces, rows = made
    kept = layer.faces is not None and len(layer.faces) > 0
    face_attributes: Mapping[str, NDArray[Any]] = {}
    if kept:
        assert layer.faces is not None
        faces = np.concatenate([layer.faces, faces + len(layer.points)])
        points = np.concatenate([layer.points, points])
        rows = np.concatenate([np.arange(len(layer.points)), rows])
        face_attributes = {
            name: _with_tubes(np.asarray(v), len(faces), name in layer.labels)
            for name, v in layer.face_attributes.items()
        }
    return replace(
        layer,
        points=points,
        faces=faces.astype(np.int32),
        edges=None,
        attributes={name: np.asarray(v)[rows] for name, v in layer.attributes.items()},
        face_attributes=face_attributes,
        number_by=None,
    )


def _with_tubes(values: NDArray[Any], count: int, is_label: bool) -> NDArray[Any]:
    """Return values of faces with those of tubes behind: no segment, else the first value."""
    more = np.repeat(values[:1], count - len(values), axis=0)
    return np.concatenate([values, np.full_like(more, -1) if is_label else more])


def _balls(centers: FloatArray, radius: float) -> Solid:
    """Return a ball at each center: an octahedron, split twice."""
    ball, faces = _unit_ball(2)
    count, n = len(centers), len(ball)
    points = (np.asarray(centers)[:, None] + radius * ball).reshape(-1, 3)
    all_faces = (faces + n * np.arange(count)[:, None, None]).reshape(-1, 3)
    return points, all_faces, np.repeat(np.arange(count), n)


def _unit_ball(rounds: int) -> tuple[FloatArray, NDArray[np.int64]]:
    points = np.concatenate([np.eye(3), -np.eye(3)])
    signs = [(a, b, c) for a in (0, 3) for b in (1, 4) for c in (2, 5)]
    outward = [row if sum(i > 2 for i in row) % 2 == 0 else row[::-1] for row in signs]
    faces = np.array(outward, np.int64)
    for _ in range(rounds):
        pairs = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        edges, place = np.unique(pairs, axis=0, return_inverse=True)
        middle = points[edges].sum(axis=1)
        middle /= np.linalg.norm(middle, axis=1)[:, None]
        m = place.reshape(-1, 3) + len(points)
        points = np.concatenate([points, middle])
        corners = [(faces[:, k], m[:, k], m[:, k - 1]) for k in range(3)]
        faces = np.concatenate([m, *(np.stack(corner, axis=1) for corner in corners)])
    return points, faces


def _tubes(points: FloatArray, edges: NDArray[Any], radii: FloatArray) -> Solid:
    """Return tubes along all polylines of a graph, closed at their ends."""
    parts: list[Solid] = []
    first = 0
    for line in polylines(edges, len(points)):
        made, faces = _tube(points[line], radii[line])
        rows = np.concatenate([np.repeat(line, SIDES), line[[0, -1]]])
        parts.append((made, faces + first, rows))
        first += len(made)
    if not parts:
        return np.empty((0, 3)), np.empty((0, 3), np.int64), np.empty(0, np.int64)
    columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
    return columns[0], columns[1], columns[2]


def _tube(line: FloatArray, radii: FloatArray) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return the rings round a polyline, the two ends, and the faces between them."""
    count = len(line)
    across, beside = _frames(line)
    turn = 2 * np.pi * np.arange(SIDES) / SIDES
    ring = np.cos(turn)[:, None] * across[:, None] + np.sin(turn)[:, None] * beside[:, None]
    points = (line[:, None] + radii[:, None, None] * ring).reshape(-1, 3)
    k, after = np.arange(SIDES), (np.arange(SIDES) + 1) % SIDES
    base = SIDES * np.arange(count - 1)[:, None]
    a, b, c, d = base + k, base + after, base + SIDES + k, base + SIDES + after
    sides = np.concatenate([np.stack([a, b, c], -1), np.stack([b, d, c], -1)]).reshape(-1, 3)
    start, end, last = SIDES * count, SIDES * count + 1, SIDES * (count - 1)
    caps = np.concatenate(
        [
            np.stack([np.full(SIDES, start), after, k], -1),
            np.stack([np.full(SIDES, end), last + k, last + after], -1),
        ]
    )
    return np.concatenate([points, line[[0, -1]]]), np.concatenate([sides, caps])


def _frames(line: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return two directions across a polyline at each point, which turn no more than it does."""
    steps = np.diff(line, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    steps = np.where(lengths[:, None] > 0, steps / np.where(lengths > 0, lengths, 1)[:, None], 0)
    along = np.concatenate([steps[:1], steps[:-1] + steps[1:], steps[-1:]])
    norms = np.linalg.norm(along, axis=1)
    along[norms < 1e-9] = np.concatenate([steps, steps[-1:]])[norms < 1e-9]
    along[~along.any(axis=1)] = (0.0, 0.0, 1.0)
    along /= np.linalg.norm(along, axis=1)[:, None]
    across = np.empty_like(along)
    before = np.eye(3)[np.abs(along[0]).argmin()]
    for i, direction in enumerate(along):
        flat = before - (before @ direction) * direction
        if flat @ flat < 1e-12:
            flat = np.cross(direction, np.eye(3)[np.abs(direction).argmin()])
        before = across[i] = flat / np.linalg.norm(flat)
    return across, np.cross(along, across)
