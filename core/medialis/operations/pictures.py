"""Pictures of results, drawn by the project's own renderer (thesis 3.4)."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.errors import InvalidOptionError
from medialis.operations.result import Layer, Outcome
from medialis.options import Kind
from medialis.progress import Progress, ProgressCallback
from medialis.render.camera import Camera, turntable
from medialis.render.picture import Curves, Item, Points, Surface, draw
from medialis.render.png import encode_png
from medialis.threads import run_patiently

NEARBY = 0.1
"""Fraction of the diagonal: what lies further from the bounding box may leave the picture, so that
a few large balls of an open surface do not make the shape small."""

SMALL = 320
"""Pixels on the page of a notebook."""

IN_DEGREES = ("spoke_angle",)


def draw_result(
    result: Outcome,
    *,
    color_by: str | None = None,
    width: int = 1000,
    height: int = 750,
    camera: Camera | None = None,
    title: str | None = None,
    legend: bool = True,
    progress: Progress | ProgressCallback | None = None,
) -> NDArray[np.uint8]:
    """Draw the first layer of a result inside its see-through shape.

    Points that the layer hides (`Layer.hidden`) are left out, and the legend says so. A surface is
    drawn solid instead, with the points of the other shown layers as marks on it (see
    `Outcome.shown`).

    Parameters
    ----------
    result : Outcome
        Of any operation with at least one layer.
    color_by : str, optional
        Attribute of the layer; its own choice when missing.
    width, height : int
        Picture size in pixels.
    camera : Camera, optional
        Else an automatic view of the shape.
    title : str, optional
        One line on top.
    legend : bool
        Say which colour is which value, where the layer has values.
    progress : callable, optional
        Called with (fraction, text); returning False cancels.

    Returns
    -------
    (height, width, 3) uint8

    Raises
    ------
    InvalidOptionError
        When the layer has no such attribute.

    See Also
    --------
    write_result : writes the picture with all files.

    Examples
    --------
    >>> import medialis
    >>> result = medialis.run("thickness", medialis.organic_shape(56))
    >>> medialis.draw_result(result, width=240, height=180).shape
    (180, 240, 3)
    """
    layer, *others = result.shown or result.layers[:1]
    progress = Progress.of(progress)
    if camera is None:
        camera = run_patiently(
            lambda: Camera.framing(_in_view(result), width=width, height=height), progress
        )
    item, label = _paint(layer, color_by or layer.color_by, camera.width)
    label = label if legend else None
    if result.shown:
        marks = [_mark(other, camera.width) for other in others]
        return draw([item, *marks], camera, title=title, legend=label, progress=progress)
    points, faces = result.shape.points, result.shape.faces
    context: Item = Points(points, size=1.5, color=(0.78, 0.80, 0.84))
    if faces is not None:
        context = Surface(points, faces, opacity=0.12)
    items = [context, item]
    return draw(items, camera, title=title, legend=label, progress=progress)


def draw_turntable(
    result: Outcome,
    count: int,
    *,
    color_by: str | None = None,
    size: int = 600,
    progress: Progress | ProgressCallback | None = None,
) -> Iterator[NDArray[np.uint8]]:
    """Draw `count` views round the up-axis one after the other, (size, size, 3) uint8 each."""
    steps = Progress.of(progress)
    camera = Camera.framing(_in_view(result), width=size, height=size, fit="turntable")
    for number, view in enumerate(turntable(camera, count)):
        with steps.stage("turntable", number / count, (number + 1) / count):
            image = draw_result(result, color_by=color_by, camera=view, progress=steps)
        yield image


def picture_html(result: Outcome) -> str:
    """Return the picture of a result, half as wide as its pixels, as an image for HTML."""
    images = list(result.images.values())
    if not images and result.layers:
        images = [draw_result(result, width=2 * SMALL, height=3 * SMALL // 2)]
    if not images:
        return ""
    data = base64.b64encode(encode_png(images[0])).decode()
    return f'<img width="{SMALL}" alt="" src="data:image/png;base64,{data}">'


def require_attribute(layers: Sequence[Layer], name: str) -> None:
    """Check that the first layer, the one that pictures show, has an attribute.

    Raises
    ------
    InvalidOptionError
        When it has not, or there is no layer.
    """
    if not layers:
        raise InvalidOptionError(f"The result has no layer to colour by {name}.")
    known = layers[0].attributes
    if name not in known:
        raise InvalidOptionError(
            f"Layer {layers[0].name} has no attribute {name}; it has {', '.join(known)}."
        )


def _in_view(result: Outcome) -> NDArray[np.float64]:
    """Points that a picture must show: the shape, and the layer where it is not far outside."""
    (low, high), points = result.shape.bounds, result.layers[0].points
    reach = NEARBY * result.shape.diagonal
    near = ((points >= low - reach) & (points <= high + reach)).all(axis=1)
    return np.concatenate([result.shape.points, points[near]])


def _mark(layer: Layer, width: int) -> Item:
    """Points as black balls on the surface, half of each outside it."""
    return Points(layer.points, size=max(4.0, width / 60), color=(0.05, 0.05, 0.05))


def _paint(layer: Layer, color_by: str | None, width: int) -> tuple[Item, str | None]:
    values, label = None, None
    if color_by is not None:
        require_attribute((layer,), color_by)
        values, label = np.asarray(layer.attributes[color_by]), color_by.replace("_", " ")
        if color_by in IN_DEGREES:
            values, label = np.degrees(values), label + " (degrees)"
    points, hidden = layer.points, layer.hidden
    if layer.faces is None and layer.edges is None and hidden.any():
        points = points[~hidden]
        values = None if values is None else values[~hidden]
        label = None if label is None else f"{label}; {_shown_from(layer, str(color_by))}"
    colors: dict[str, Any] = {"values": values}
    if color_by in layer.labels:
        colors, label = {"labels": values}, None
    elif color_by is not None and color_by == layer.color_by:
        low, high = layer.color_limits
        colors.update(cmap=layer.color_map, low=low, high=high)
    if layer.faces is not None:
        return Surface(layer.points, layer.faces, **colors), label
    if layer.edges is not None:
        return Curves(layer.points, layer.edges, **colors), label
    # Smaller dots for more points, so that sheets look like sheets and not like gravel.
    size = float(np.clip(width / np.sqrt(len(points)) / 2, 1.5, 6.0))
    return Points(points, size=size, **colors), label


def _shown_from(layer: Layer, color_by: str) -> str:
    """Say in few words from which value on a picture shows points; the note has the sentence."""
    value, kind = layer.filter_default, layer.filter_unit.kind
    unit = {Kind.LENGTH: " %", Kind.ANGLE: " degrees"}.get(kind, "")
    limit = f"{100 * value if kind is Kind.LENGTH else value:.3g}{unit}"
    of = "" if color_by == layer.filter_by else f" {str(layer.filter_by).replace('_', ' ')}"
    return f"shown from {limit}{of} on"
