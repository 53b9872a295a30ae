# SPDX-License-Identifier: GPL-3.0-or-later
"""Legends beside a shape and numbers at places of it, as meshes: they are seen in every view.

They face the view in which the operation was started, else the camera of the scene.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from medialis.hosts import Legend, Numbers

from . import attributes, materials, meshes
from .changes import Changes
from .reading import corner_vertices

COLOR = "legend_color"
CARD, INK = (0.13, 0.13, 0.13), (0.95, 0.95, 0.95)
SIZE, SMALL = 0.03, 0.02
"""Height of the letters of legends and of numbers, as a share of the diagonal."""
BAR = (1.2, 11.0)
"""Width and height of the bar, in letters."""
ABOVE = 0.05
"""How far letters and colours lie in front of their card, in letters."""
FRONT = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def view_axes(context: bpy.types.Context) -> NDArray[np.float64]:
    """Return the directions to the right, up and towards the viewer as columns, (3, 3)."""
    space = context.space_data
    camera = context.scene.camera
    view = space.region_3d if getattr(space, "type", "") == "VIEW_3D" else None
    if view is not None and (view.view_perspective != "CAMERA" or camera is None):
        return np.array(view.view_rotation.to_matrix(), np.float64)
    if camera is None:
        return FRONT
    return np.array(camera.matrix_world.to_quaternion().to_matrix(), np.float64)


def value_text(what: str, value: float, plain: str, scene: bpy.types.Scene) -> str:
    """Return a value in the units of the scene; `plain` is what it is without."""
    settings = scene.unit_settings
    powers = {"length": 1, "area": 2}
    if settings.system == "NONE" or what not in powers or not np.isfinite(value):
        return plain
    scaled = value * settings.scale_length ** powers[what]
    return bpy.utils.units.to_string(settings.system, what.upper(), scaled, precision=3)


def new_legend(
    title: str,
    key: Legend,
    around: NDArray[np.float64],
    context: bpy.types.Context,
    changes: Changes,
) -> bpy.types.Object:
    """Add a legend at the right of these points, (n, 3)."""
    axes, diagonal = view_axes(context), float(np.linalg.norm(np.ptp(around, axis=0)))
    card = _Card()
    if key.names:
        for row, (name, color) in enumerate(zip(key.names, key.colors, strict=True)):
            card.bar((0.0, -1.6 * row, 1.0, 1.0), color[None])
            card.text(name, (1.6, -1.6 * row + 0.15))
        top = 1.6
    else:
        card.bar((0.0, 0.0, *BAR), key.colors)
        for value, y in ((key.low, 0.0), (key.high, BAR[1] - 0.7)):
            text = value_text(key.quantity, value, key.number(value), context.scene)
            card.text(text, (BAR[0] + 0.6, y))
        top = BAR[1] + 0.8
    card.text(key.title, (0.0, top))
    card.plate()
    unit = SIZE * diagonal
    seen = np.einsum("nk,kj->nj", around, axes)
    left, right = seen.min(axis=0), seen.max(axis=0)
    low, high = card.bounds
    place = (left + right - unit * (low + high)) / 2
    place[0] = right[0] + 1.5 * unit - unit * low[0]
    made = _object(title, [(card, axes @ place, unit)], axes, changes)
    made.hide_select = True
    return made


def new_numbers(
    title: str, numbers: Numbers, diagonal: float, context: bpy.types.Context, changes: Changes
) -> bpy.types.Object:
    """Add the values of a layer at their places, each with its rank and a line to its place."""
    axes, unit = view_axes(context), SMALL * diagonal
    cards = []
    rows = zip(numbers.places, numbers.texts_at, numbers.values.tolist(), strict=True)
    for rank, (place, at, value) in enumerate(rows, 1):
        card = _Card()
        plain = f"{value:.3g}"
        text = value_text(numbers.quantity, value, plain, context.scene)
        card.text(f"{rank}: {text}", (0.0, 0.0))
        card.plate()
        card.line(np.zeros(3), (place - at) @ axes / unit)
        cards.append((card, at, unit))
    return _object(title, cards, axes, changes)


def _object(
    title: str,
    cards: list[tuple[_Card, NDArray[np.float64], float]],
    axes: NDArray[np.float64],
    changes: Changes,
) -> bpy.types.Object:
    """Add one mesh of all cards: each with its place, and the size of its letters."""
    points, faces, colors, count = [], [], [], 0
    for card, place, unit in cards:
        local, triangles, shades = card.arrays()
        points.append(place + unit * local @ axes.T)
        faces.append(triangles + count)
        colors.append(shades)
        count += len(local)
    mesh = meshes.new_mesh(
        title,
        attributes.coordinates(np.concatenate(points), title),
        np.concatenate(faces).astype(np.int32),
        None,
        changes,
    )
    mesh.shade_flat()
    attributes.write(mesh, attributes.color_column(COLOR, np.concatenate(colors)), "POINT")
    mesh.color_attributes.active_color = mesh.color_attributes[COLOR]
    mesh.materials.append(materials.flat_material(COLOR, changes))
    made = bpy.data.objects.new(title, mesh)
    bpy.context.scene.collection.objects.link(made)
    made.visible_shadow = False
    return made


class _Card:
    """Texts and colours in a plane, in letters: x to the right, y up, z towards the viewer."""

    def __init__(self) -> None:
        self._points: list[NDArray[Any]] = []
        self._faces: list[NDArray[Any]] = []
        self._colors: list[NDArray[Any]] = []
        self._count = 0

    @property
    def bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lowest and highest x, y and z."""
        points = np.concatenate(self._points)
        return points.min(axis=0), points.max(axis=0)

    def add(self, points: NDArray[Any], faces: NDArray[Any], colors: NDArray[Any]) -> None:
        """Add triangles; colours are those of points, or one for all."""
        self._points.append(points)
        self._faces.append(faces + self._count)
        self._colors.append(np.broadcast_to(colors, (len(points), 3)))
        self._count += len(points)

    def arrays(self) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
        """Return points, triangles and colours."""
        parts = self._points, self._faces, self._colors
        points, faces, colors = (np.concatenate(part) for part in parts)
        return points, faces, colors

    def bar(self, box: tuple[float, float, float, float], colors: NDArray[Any]) -> None:
        """Fill a box (x, y, width, height) with colours from the bottom to the top."""
        x, y, wide, high = box
        shades = np.repeat(colors, 2, axis=0) if len(colors) == 1 else colors
        steps = np.linspace(y, y + high, len(shades))
        sides = [np.stack([np.full(len(steps), at), steps, np.full(len(steps), ABOVE)], axis=1)
                 for at in (x, x + wide)]  # fmt: skip
        a = np.arange(len(steps) - 1)
        b = a + len(steps)
        faces = np.concatenate([np.stack([a, b, b + 1], 1), np.stack([a, b + 1, a + 1], 1)])
        self.add(np.concatenate(sides), faces, np.concatenate([shades, shades]))

    def text(self, body: str, place: tuple[float, float]) -> None:
        """Write a line, its letters one high, from a place to the right."""
        points, faces = _letters(body)
        self.add(points + np.array([*place, ABOVE]), faces, np.array(INK))

    def plate(self) -> None:
        """Put a card behind everything so far."""
        (x, y, _), (right, top, _) = self.bounds
        wide, high = right - x + 1.2, top - y + 1.2
        corners = np.array([[0, 0, 0], [wide, 0, 0], [wide, high, 0], [0, high, 0]], float)
        faces = np.array([[0, 1, 2], [0, 2, 3]])
        self.add(corners + np.array([x - 0.6, y - 0.6, 0.0]), faces, np.array(CARD))

    def line(self, start: NDArray[Any], end: NDArray[Any], width: float = 0.12) -> None:
        """Draw a thin band between two points."""
        side = np.array([-(end - start)[1], (end - start)[0], 0.0])
        side = side / np.linalg.norm(side) if side.any() else np.array([1.0, 0.0, 0.0])
        ends = np.array([start, end])
        points = np.concatenate([ends + 0.5 * width * side, ends - 0.5 * width * side])
        self.add(points, np.array([[0, 2, 3], [0, 3, 1]]), np.array(CARD))


def _letters(body: str) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return points and triangles of a line of text in Blender's own font."""
    fonts = set(bpy.data.fonts)
    curve = bpy.data.curves.new("medialis text", "FONT")
    curve.body, curve.size, curve.resolution_u = body, 1.3, 2
    holder = bpy.data.objects.new("medialis text", curve)
    mesh = bpy.data.meshes.new_from_object(holder)
    try:
        points = np.empty(3 * len(mesh.vertices), np.float32)
        mesh.vertices.foreach_get("co", points)
        mesh.calc_loop_triangles()
        loops = np.empty(3 * len(mesh.loop_triangles), np.int32)
        mesh.loop_triangles.foreach_get("loops", loops)
        faces = corner_vertices(mesh)[loops].reshape(-1, 3)
    finally:
        bpy.data.meshes.remove(mesh)
        bpy.data.objects.remove(holder)
        bpy.data.curves.remove(curve)
        bpy.data.batch_remove(set(bpy.data.fonts) - fonts)  # the first text brings Blender's own
    return points.reshape(-1, 3).astype(np.float64), faces
