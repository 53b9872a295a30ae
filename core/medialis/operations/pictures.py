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
from medialis.render.colors import value_range
from medialis.render.discs import CORNERS, disc_mesh, lifted_faces, sheet_discs
from medialis.render.picture import Balls, Curves, Item, Points, Surface, draw
from medialis.render.png import encode_png
from medialis.render.shading import Style
from medialis.threads import run_patiently

NEARBY = 0.1
"""Fraction of the diagonal: what lies further from the bounding box may leave the picture, so that
a few large balls of an open surface do not make the shape small."""

SMALL = 320
"""Pixels on the page of a notebook."""

IN_DEGREES = ("spoke_angle",)

MEDIAL = {"feature_1", "feature_2", "radius", "source"}
"""Attributes of points that are drawn as pieces of sheets."""


def draw_result(
    result: Outcome,
    *,
    color_by: str | None = None,
    width: int = 1000,
    height: int = 750,
    camera: Camera | None = None,
    title: str | None = None,
    style: Style | None = None,
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
    style : Style, optional
        Light, background (None leaves it see-through), cropping, legend, limits of the colours.
    progress : callable, optional
        Called with (fraction, text); returning False cancels.

    Returns
    -------
    (height, width, 3) uint8; without background (height, width, 4); smaller where it is cropped

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
    style = Style() if style is None else style
    items, label = _paint(result, layer, color_by or layer.color_by, camera.width, style.limits)
    if result.shown:
        items += [_mark(other, camera.width) for other in others]
    else:
        items = [_context(result, camera.width), *items]
    return draw(
        items,
        camera,
        title=title,
        legend=label if style.legend else None,
        style=style,
        progress=progress,
    )


def _context(result: Outcome, width: int) -> Item:
    """Return the shape itself, see-through."""
    points, faces = result.shape.points, result.shape.faces
    if faces is None:
        return Points(points, size=max(1.5, width / 670), color=(0.78, 0.80, 0.84))
    return Surface(points, faces, opacity=0.12)


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


def _paint(
    result: Outcome,
    layer: Layer,
    color_by: str | None,
    width: int,
    limits: tuple[float, float] | None,
) -> tuple[list[Item], str | None]:
    """Return what shows a layer, and the text of its legend."""
    values, label = None, None
    if color_by is not None:
        require_attribute((layer,), color_by)
        values, label = np.asarray(layer.attributes[color_by]), color_by.replace("_", " ")
        if color_by in IN_DEGREES:
            values, label = np.degrees(values), label + " (degrees)"
    cloud = layer.faces is None and layer.edges is None
    shown = ~layer.hidden if cloud else np.ones(len(layer.points), bool)
    if not shown.all():
        values = None if values is None else values[shown]
        label = None if label is None else f"{label}; {_shown_from(layer, str(color_by))}"
    colors: dict[str, Any] = {"values": values}
    if color_by in layer.labels:
        colors, label = {"labels": values}, None
    elif values is not None:
        given = layer.color_limits if color_by == layer.color_by else (None, None)
        low, high = value_range(values, *(limits or given))
        colors.update(low=low, high=high)
        if color_by == layer.color_by:
            colors.update(cmap=layer.color_map)
    items: list[Item] = []
    if layer.faces is not None:
        items.append(Surface(layer.points, layer.faces, **colors))
    if layer.edges is not None:
        items.append(Curves(layer.points, layer.edges, width=width / 180, **colors))
    if items:
        return items, label
    return _cloud_items(result, layer, np.flatnonzero(shown), colors, width), label


def _cloud_items(
    result: Outcome, layer: Layer, rows: NDArray[np.intp], colors: dict[str, Any], width: int
) -> list[Item]:
    """Return medial points as pieces of sheets, those of curves as balls, others as dots."""
    points = layer.points[rows]
    if not layer.attributes.keys() >= MEDIAL:
        # Smaller dots for more points, so that sheets look like sheets and not like gravel.
        size = float(np.clip(width / np.sqrt(max(len(points), 1)) / 2, width / 600, width / 160))
        return [Points(points, size=size, **colors)]
    first, second = (layer.attributes[f"feature_{k}"][rows] for k in (1, 2))
    axes = result.shape.points[first] - result.shape.points[second]
    radii, flat, axes, reach = sheet_discs(points, axes)
    lifted = lifted_faces(result.shape, layer.attributes["source"][rows], points, 4 * reach)
    covered = np.zeros(len(points), bool)
    covered[lifted] = True
    # A disc or ball stays well within the shape, as the medial ball of its point does.
    radii, dots = np.minimum(radii, 0.5 * layer.attributes["radius"][rows]), ~flat
    flat &= ~covered
    corners, faces = disc_mesh(points[flat], axes[flat], radii[flat])

    def painted(chosen: NDArray[Any], repeat: int = 1) -> dict[str, Any]:
        own = dict(colors)
        for name in ("values", "labels"):
            if own.get(name) is not None:
                own[name] = np.repeat(own[name][chosen], repeat)
        return own

    discs = Surface(corners, faces, per_face=True, smooth=False, **painted(flat, CORNERS - 2))
    balls = Balls(points[dots], radii[dots] / 2, **painted(dots))
    lifted_surface = Surface(points, lifted, **colors)
    drawn = ((lifted_surface, len(lifted)), (discs, len(faces)), (balls, int(dots.sum())))
    return [item for item, count in drawn if count]


def _shown_from(layer: Layer, color_by: str) -> str:
    """Say in few words from which value on a picture shows points; the note has the sentence."""
    value, kind = layer.filter_default, layer.filter_unit.kind
    unit = {Kind.LENGTH: " %", Kind.ANGLE: " degrees"}.get(kind, "")
    limit = f"{100 * value if kind is Kind.LENGTH else value:.3g}{unit}"
    of = "" if color_by == layer.filter_by else f" {str(layer.filter_by).replace('_', ' ')}"
    return f"shown from {limit}{of} on"
