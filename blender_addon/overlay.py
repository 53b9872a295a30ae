# SPDX-License-Identifier: GPL-3.0-or-later
"""The legend of the result that is looked at, and its numbers: drawn over 3D views, in pixels.

There is one: that of the active result, or of what the active object shows. It stands in the lower
right corner, left of the side bar, and no render has it (`legends.py` adds objects for those).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import bpy
import numpy as np
from mathutils import Vector
from numpy.typing import NDArray

from medialis.hosts import Legend, Numbers

from . import legends, reading, removing

STEPS = 24
"""Colours that are kept of a bar."""
CARD, INK, LINE = (0.1, 0.1, 0.1, 0.82), (0.95, 0.95, 0.95, 1.0), (0.1, 0.1, 0.1, 0.9)
LETTER = 12.0
"""Height of letters in pixels, at Blender's standard scale."""
BAR = (14.0, 130.0)
"""Width and height of the bar, in the same pixels."""
MARGIN = 10.0

Legends = dict[str, Any]


def packed(key: Legend | None, numbers: Sequence[Numbers], linear: NDArray[np.float64]) -> Legends:
    """Return a legend as a record keeps it: plain values, places in the axes of the object."""
    found: Legends = {}
    if key is not None:
        rows = np.linspace(0, len(key.colors) - 1, min(STEPS, len(key.colors))).round().astype(int)
        colors = key.colors if key.names else key.colors[rows]
        found |= {"title": key.title, "names": list(key.names), "quantity": key.quantity}
        found["colors"] = np.round(colors, 3).tolist()
        found["values"] = [[float(v), key.number(float(v))] for v in (key.low, key.high)]
    inverse = np.linalg.inv(linear)
    found["numbers"] = [
        [*(inverse @ place).tolist(), *(inverse @ at).tolist(), float(value), one.quantity]
        for one in numbers
        for place, at, value in zip(one.places, one.texts_at, one.values, strict=True)
    ]
    return found if key is not None or found["numbers"] else {}


def looked_at(context: bpy.types.Context) -> tuple[bpy.types.Object, Legends] | None:
    """Return the source and the legend of the result that is looked at; None: there is none."""
    active = context.view_layer.objects.active
    source = reading.source_of(active)
    if source is None or removing.RECORDS not in source or not active.visible_get():
        return None
    record = removing.record_of(source, removing.operation_of(active))
    if record is None or not record.shown or not record.legend:
        return None
    return source, record.legend


def draw() -> None:
    """Draw in the view at hand, as Blender calls it."""
    context = bpy.context
    if not context.space_data.overlay.show_overlays:
        return
    found = looked_at(context)
    if found is None:
        return
    source, legend = found
    from bpy_extras.view3d_utils import location_3d_to_region_2d

    region, view = context.region, context.space_data.region_3d
    places = []
    for rank, (px, py, pz, tx, ty, tz, value, quantity) in enumerate(legend["numbers"], 1):
        ends = [source.matrix_world @ Vector(place) for place in ((px, py, pz), (tx, ty, tz))]
        flat = [location_3d_to_region_2d(region, view, end) for end in ends]
        if None not in flat:
            text = legends.value_text(quantity, value, f"{value:.3g}", context.scene)
            places.append((f"{rank}: {text}", *(tuple(one) for one in flat)))
    sides = [one.width for one in context.area.regions if one.type == "UI"]
    overlap = context.preferences.system.use_region_overlap
    right = region.width - (sum(sides) if overlap else 0)
    paint(legend, places, right, context.scene, context.preferences.system.ui_scale)


def paint(
    legend: Legends,
    places: Sequence[tuple[str, tuple[float, float], tuple[float, float]]],
    right: float,
    scene: bpy.types.Scene,
    scale: float,
) -> tuple[float, float, float, float]:
    """Draw a legend into the pixels at hand, its lower right corner at `right`, and the numbers.

    Parameters
    ----------
    legend : dict
        From `packed`.
    places : sequence
        Texts of numbers with the pixel of their place, and the one where the text stands.

    Returns
    -------
    tuple
        x, y, width and height of its card; zeros without one.
    """
    import gpu

    gpu.state.blend_set("ALPHA")
    try:
        for text, place, at in places:
            _polygon([place, at], LINE, "LINES")
            wide = _width(text, scale)
            x, y, letter = at[0], at[1], LETTER * scale
            _box(x - 3 * scale, y - 4 * scale, wide + 6 * scale, letter + 6 * scale, CARD)
            _text(text, x, y, scale)
        return _card(legend, right, scene, scale) if "title" in legend else (0.0, 0.0, 0.0, 0.0)
    finally:
        gpu.state.blend_set("NONE")


def _card(
    legend: Legends, right: float, scene: bpy.types.Scene, scale: float
) -> tuple[float, float, float, float]:
    row, pad = 1.5 * LETTER * scale, MARGIN * scale
    names = legend["names"]
    values = [legends.value_text(legend["quantity"], value, plain, scene)
              for value, plain in legend["values"]]  # fmt: skip
    texts, bar = (names, row) if names else (values, BAR[0] * scale)
    high = len(names) * row if names else BAR[1] * scale
    wide = max(_width(legend["title"], scale), bar + pad + max(_width(t, scale) for t in texts))
    width, height = wide + 2 * pad, high + row + 2 * pad
    x, y = right - pad - width, pad
    _box(x, y, width, height, CARD)
    _text(legend["title"], x + pad, y + height - pad - LETTER * scale, scale)
    left, low = x + pad, y + pad
    if names:
        for number, (name, color) in enumerate(zip(names, legend["colors"], strict=True)):
            bottom = low + high - (number + 1) * row
            _box(left, bottom + 0.15 * row, 0.8 * row, 0.7 * row, (*color, 1.0))
            _text(name, left + bar + 0.3 * pad, bottom + 0.25 * row, scale)
    else:
        _gradient(left, low, bar, high, legend["colors"])
        for text, bottom in zip(values, (low, low + high - LETTER * scale), strict=True):
            _text(text, left + bar + pad, bottom, scale)
    return x, y, width, height


def _width(text: str, scale: float) -> float:
    import blf

    blf.size(0, LETTER * scale)
    wide: float = blf.dimensions(0, text)[0]
    return wide


def _text(text: str, x: float, y: float, scale: float) -> None:
    import blf

    blf.size(0, LETTER * scale)
    blf.color(0, *INK)
    blf.position(0, x, y, 0.0)
    blf.draw(0, text)


def _box(x: float, y: float, wide: float, high: float, color: Sequence[float]) -> None:
    corners = [(x, y), (x + wide, y), (x, y + high), (x + wide, y + high)]
    _polygon(corners, color, "TRI_STRIP")


def _polygon(corners: Sequence[tuple[float, float]], color: Sequence[float], kind: str) -> None:
    import gpu
    from gpu_extras.batch import batch_for_shader

    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    shader.bind()
    shader.uniform_float("color", color)
    batch_for_shader(shader, kind, {"pos": corners}).draw(shader)


def _gradient(
    x: float, y: float, wide: float, high: float, colors: Sequence[Sequence[float]]
) -> None:
    import gpu
    from gpu_extras.batch import batch_for_shader

    steps = np.linspace(y, y + high, len(colors)).tolist()
    corners = [corner for step in steps for corner in ((x, step), (x + wide, step))]
    shades = [(*color, 1.0) for color in colors for _ in range(2)]
    shader = gpu.shader.from_builtin("SMOOTH_COLOR")
    batch_for_shader(shader, "TRI_STRIP", {"pos": corners, "color": shades}).draw(shader)


_handle: Any = None


def register() -> None:
    """Let 3D views draw the legend."""
    global _handle
    _handle = bpy.types.SpaceView3D.draw_handler_add(draw, (), "WINDOW", "POST_PIXEL")


def unregister() -> None:
    """Take it away."""
    global _handle
    if _handle is not None:
        bpy.types.SpaceView3D.draw_handler_remove(_handle, "WINDOW")
        _handle = None
