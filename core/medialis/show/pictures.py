"""Points of sheets as small discs along them: shaded like the surface they sample.

Pictures of results, drawn by the project's own renderer (thesis 3.4).
"""

from __future__ import annotations

import base64
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.errors import InvalidOptionError
from medialis.base.options import Kind
from medialis.base.progress import Progress, ProgressCallback
from medialis.base.threads import run_patiently
from medialis.base.validation import FloatArray
from medialis.operations.result import Layer, Outcome
from medialis.shape.shape import Shape
from medialis.show.camera import Camera, turntable
from medialis.show.colors import value_range
from medialis.show.picture import Balls, Curves, Item, Points, Surface, draw, encode_png
from medialis.show.raster import Style

NEIGHBOURS = 8
"""Nearest points whose axes make the axis of a disc; the fourth of them is at its rim."""

FLAT = 0.75
"""Share of the squared axes that lies along their mean where the points are those of a sheet."""

CORNERS = 7


def sheet_discs(
    points: FloatArray, axes: FloatArray
) -> tuple[FloatArray, NDArray[np.bool_], FloatArray, FloatArray]:
    """Return the radius of a disc at each point, where it lies in a sheet, its axis, and its reach.

    The reach is the distance of the last near point.

    Axes (p, 3) cross the sheet, either way round, zero where unknown; they are averaged over near
    points. Points of curves, round which the axes turn, and lone ones are in no sheet.

    Examples
    --------
    >>> x, y = (c.ravel() for c in np.mgrid[0:9, 0:9].astype(float))
    >>> flat = np.stack([x, y, 0 * x], axis=1)
    >>> radii, sheet, axes, reach = sheet_discs(flat, np.tile([0.0, 0.0, -2.0], (81, 1)))
    >>> float(radii[40]), bool(sheet.all()), np.abs(axes[40]).tolist()
    (1.0, True, [0.0, 0.0, 1.0])
    """
    from medialis.base.box_tree import nearest_others

    if len(points) < 3:
        none = np.zeros(len(points))
        return none, none.astype(bool), np.zeros((len(points), 3)), none
    lengths = np.linalg.norm(axes, axis=1, keepdims=True)
    units = np.divide(axes, lengths, out=np.zeros_like(axes), where=lengths > 0)
    near, distances = nearest_others(np.asarray(points, np.float64), NEIGHBOURS)
    tensors = np.einsum("nki,nkj->nij", units[near], units[near])
    tensors += np.einsum("ni,nj->nij", units, units)
    sizes, directions = np.linalg.eigh(tensors)
    total = sizes.sum(axis=1)
    reach = distances[:, min(3, near.shape[1] - 1)]
    middle = float(np.median(reach))
    flat = (sizes[:, 2] >= FLAT * total) & (total > 0) & (reach <= 4 * middle)
    radii = np.clip(reach, 0.5 * middle, 1.5 * middle)
    return radii, flat, directions[:, :, 2], distances[:, -1]


def disc_mesh(
    points: FloatArray, axes: FloatArray, radii: FloatArray
) -> tuple[FloatArray, NDArray[np.int32]]:
    """Return points and triangles of one regular polygon for each point, `CORNERS` - 2 triangles.

    Triangles of disc i are the rows from i * (CORNERS - 2) on.
    """
    away = np.where(np.abs(axes[:, :1]) < 0.6, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    first = np.cross(axes, away)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(axes, first)
    turn = np.arange(CORNERS) * (2 * np.pi / CORNERS)
    rim = (
        first[:, None] * np.cos(turn)[None, :, None] + second[:, None] * np.sin(turn)[None, :, None]
    )
    corners = points[:, None] + radii[:, None, None] * rim
    fan = np.array([[0, k, k + 1] for k in range(1, CORNERS - 1)], np.int32)
    start = np.arange(len(points), dtype=np.int32)[:, None, None] * np.int32(CORNERS)
    return corners.reshape(-1, 3), (start + fan).reshape(-1, 3)


def lifted_faces(
    shape: Shape, source: NDArray[np.integer], points: FloatArray, longest: FloatArray
) -> NDArray[np.int32]:
    """Return the triangles of the shape whose corners are moved to their medial points.

    `source` are the vertices that the points belong to; no edge is longer than `longest` of both
    its ends, as it is where the corners belong to different sheets.
    """
    if shape.faces is None or len(points) == 0:
        return np.zeros((0, 3), np.int32)
    row = np.full(shape.point_count, -1, np.int32)
    row[source[::-1]] = np.arange(len(source) - 1, -1, -1, dtype=np.int32)
    faces = row[shape.faces]
    faces = faces[(faces >= 0).all(axis=1)]
    for k in range(3):
        a, b = faces[:, k], faces[:, k - 1]
        length = np.linalg.norm(points[a] - points[b], axis=1)
        faces = faces[length <= np.minimum(longest[a], longest[b])]
    return faces


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
