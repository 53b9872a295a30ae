"""Pictures: what to draw, in which colours, with a title and a legend (thesis 3.4).

Pictures of results (`draw_result`) show medial points as the sheets that they lie on
(`medial_points.py`).
"""

from __future__ import annotations

import base64
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.base.errors import InvalidOptionError, InvalidShapeError
from medialis.base.options import Kind, with_unit
from medialis.base.progress import Progress, ProgressCallback
from medialis.base.threads import run_patiently
from medialis.base.validation import (
    FloatArray,
    IntArray,
    as_faces,
    as_field,
    as_number,
    as_points,
    frozen,
)
from medialis.operations.result import Layer, Outcome, quantity, value_text, value_words
from medialis.show.annotation import (
    ColorBar,
    LabelKey,
    contact_sheet,
    content_box,
    draw_legend,
    draw_title,
    legend_size,
    text_size,
    title_height,
)
from medialis.show.camera import Camera, shape_view, turntable
from medialis.show.colors import (
    FAR_FROM_LIMIT,
    NEAR_LIMIT,
    label_colors,
    limit_colors,
    map_colors,
    to_linear,
    value_range,
)
from medialis.show.marks import draw_scale, scale_height, seen, write_texts
from medialis.show.png import encode_png
from medialis.show.raster import BallLayer, MeshLayer, Style, as_radii, render_layers

Color = tuple[float, float, float]
SMALL = 320
"""Pixels on the page of a notebook; smaller pictures have no scale."""
SMALLEST_TEXT = 5
"""Pixels of a capital in a small picture whose legend needs more room than there is."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Painted:
    """How an item is coloured: by `labels`, else by `values`, else by `color`.

    Attributes
    ----------
    color : (3,) or (count, 3) float
        sRGB 0..1: one for all or one an element.
    values : (count,) float, optional
        Scalar field through `map_colors`; NaN is grey.
    labels : (count,) int, optional
        Distinct colours; -1 is grey.
    cmap, low, high
        Colour map and its limits, as in `map_colors`.
    limit : float, optional
        Values below it are told from those above by colour (`limit_colors`), in the place of cmap.
    palette : (k, 3) float, optional
        sRGB colours of the labels 0, 1, ...
    """

    color: ArrayLike = (0.62, 0.68, 0.76)
    values: ArrayLike | None = None
    labels: ArrayLike | None = None
    cmap: str = "sequential"
    low: float | None = None
    high: float | None = None
    limit: float | None = None
    palette: ArrayLike | None = None

    def colors(self, count: int) -> FloatArray:
        """Return the sRGB colours of `count` elements, (count, 3).

        Raises
        ------
        InvalidShapeError, InvalidOptionError
            When there is not one value, label or colour for each element.
        """
        if self.labels is not None:
            if np.shape(self.labels) != (count,):
                raise InvalidShapeError(
                    f"labels must have shape ({count},), got {np.shape(self.labels)}."
                )
            return label_colors(self.labels, self.palette)
        if self.values is not None:
            field = as_field(self.values, count, "values")
            if self.limit is not None:
                return limit_colors(field, self.limit)
            return map_colors(field, self.cmap, self.low, self.high)
        color = np.asarray(self.color, np.float64)
        if color.shape not in ((3,), (count, 3)) or not ((color >= 0) & (color <= 1)).all():
            raise InvalidOptionError(
                f"color must be three numbers 0..1, or a ({count}, 3) array of them; "
                f"got shape {color.shape}."
            )
        return np.broadcast_to(color, (count, 3))

    def light(self, count: int) -> FloatArray:
        """Return the colours of `count` elements in linear light, (count, 3)."""
        colors = self.colors(count)
        if count and colors.strides[0] == 0:  # one for all
            return np.broadcast_to(to_linear(colors[0]), colors.shape)
        return to_linear(colors)


@dataclass(frozen=True, eq=False)
class Balls(Painted):
    """Shaded balls: centers (k, 3) and radii (k,) or one radius for all, in the caller's units."""

    centers: ArrayLike
    radii: ArrayLike


@dataclass(frozen=True, eq=False)
class Points(Painted):
    """Points (k, 3) shown as small balls of the same size everywhere, `size` pixels across.

    `texts` stand beside those that no surface hides, each once.
    """

    points: ArrayLike
    size: float = 4.0
    texts: Sequence[str] = ()


@dataclass(frozen=True, eq=False)
class Curves(Painted):
    """Tubes along edges (e, 2) between nodes (v, 3), `width` pixels thick.

    Values, labels and colours belong to the nodes and blend along an edge (labels: to the nearer
    node).
    """

    nodes: ArrayLike
    edges: ArrayLike
    width: float = 5.0


@dataclass(frozen=True, eq=False)
class Surface(Painted):
    """Triangles; with opacity below 1 a see-through shell with a clear outline.

    Attributes
    ----------
    points, faces : (n, 3) float and (m, 3) int
    opacity : float
        1 is solid. 0.1 to 0.2 shows what is inside.
    smooth : bool
        Smooth shading except at sharp edges; False shows the facets.

    Values, labels and colours belong to the points or, with `per_face`, to the faces.
    """

    points: ArrayLike
    faces: ArrayLike
    opacity: float = 1.0
    smooth: bool = True
    per_face: bool = False


Item = Balls | Points | Curves | Surface


def draw(
    items: Sequence[Item],
    camera: Camera,
    *,
    title: str | None = None,
    legend: str | None = None,
    label_names: Sequence[str] | None = None,
    style: Style | None = None,
    unit: str | None = None,
    progress: Progress | ProgressCallback | None = None,
) -> NDArray[np.uint8]:
    """Return a picture of the items, (h, w, 3) uint8 with the camera's width and height.

    Without background (`Style`) it is see-through, (h, w, 4).

    Parameters
    ----------
    items : sequence of Balls, Points, Curves, Surface
    camera : Camera
        Where a title or a legend takes room, the view shrinks so that all of it stays visible.
    title : str, optional
        One line above the picture.
    legend : str, optional
        Name of the quantity: adds a colour bar (smallest, middle, largest number of the scale), or
        a key of labels, for the first item that has values or labels.
    label_names : sequence of str, optional
        Texts of the key for the labels 0, 1, ...; the numbers when missing.
    style : Style, optional
        Light, background, anti-aliasing and framing; its `legend` and `limits` are for
        `draw_result`.
    unit : str, optional
        Of the lengths, for the bar that `Style.scale` adds.
    progress : callable, optional

    Raises
    ------
    InvalidShapeError, InvalidOptionError
        When an item, an option, or a legend without values or labels cannot be drawn.
    Cancelled
        When the progress callback asks for it.

    Notes
    -----
    Source: thesis 3.4 (Phong shaded balls with exact depth) and its figures.

    Examples
    --------
    >>> camera = Camera.framing([[-1, -1, -1], [1, 1, 1]], width=80, height=60)
    >>> image = draw([Balls([[0, 0, 0]], 1.0)], camera)
    >>> image.shape, image[0, 0].tolist(), bool(image[30, 40].max() < 255)
    ((60, 80, 3), [255, 255, 255], True)
    """
    steps = Progress.of(progress)
    key = None
    if legend is not None:
        key = run_patiently(lambda: _legend_of(items, legend, label_names), steps)
    chosen = Style() if style is None else style
    size = text_size(camera.width, camera.height)
    below = scale_height(size) if chosen.scale and camera.width >= SMALL else 0
    top, right, frame = 0, 0, camera
    if not chosen.crop:
        right = 0 if key is None else legend_size(key, size)[0]
        while key is not None and right > camera.width / 2 and size > SMALLEST_TEXT:
            size -= 1
            right = legend_size(key, size)[0]
        if right > camera.width / 2:
            raise InvalidOptionError(
                f"The legend needs {right} of the {camera.width} columns: use a wider picture or "
                "a shorter legend text."
            )
        top = title_height(size) if title else 0
        frame = _view_frame(camera, camera.width - right, camera.height - top - below)
    surfaces = [one for one in items if isinstance(one, Surface)]
    others = [one for one in items if not isinstance(one, Surface)]
    balls = run_patiently(lambda: [_ball_layer(one, frame) for one in others], steps)
    meshes = run_patiently(lambda: [_mesh_layer(one) for one in surfaces], steps)
    image = render_layers(balls, meshes, frame, chosen, steps)
    _write_texts(image, items, frame, steps)
    if chosen.crop:
        image, size = _cropped(image, chosen)
        top = title_height(size) if title else 0
        right = 0 if key is None else legend_size(key, size)[0]
    margins = (top, right, size)
    whole = run_patiently(lambda: _composed(image, title, key, chosen, margins), steps)
    return _with_scale(whole, frame, chosen, size, unit) if below else whole


def _cropped(image: NDArray[np.uint8], style: Style) -> tuple[NDArray[np.uint8], int]:
    """Return the image without what is empty round it, and the size of text for that."""
    ground = [0] * 4 if style.background is None else [round(255 * style.background)] * 3
    whole = text_size(image.shape[1], image.shape[0])
    rows, columns = content_box(image, np.array(ground, np.uint8), whole)
    size = text_size(round(1.2 * (columns.stop - columns.start)), image.shape[0])
    return image[rows, columns], size


def _write_texts(
    image: NDArray[np.uint8], items: Sequence[Item], camera: Camera, progress: Progress
) -> None:
    """Write what stands beside points, where no solid surface hides them."""
    solid = [one for one in items if isinstance(one, Surface) and one.opacity >= 1]
    for item in items:
        if not (isinstance(item, Points) and any(item.texts)):
            continue
        places, shown = as_points(item.points), np.ones(len(item.texts), bool)
        for one in solid:
            shown &= seen(camera, places, as_points(one.points), np.asarray(one.faces), progress)
        # Of two ends of a wall with the same text the first one that is seen has it.
        rows = {item.texts[row]: row for row in np.flatnonzero(shown)[::-1] if item.texts[row]}
        if rows:
            turn = sorted(rows.values())
            write_texts(image, camera, places[turn], [item.texts[row] for row in turn])


def _with_scale(
    image: NDArray[np.uint8], camera: Camera, style: Style, size: int, unit: str | None
) -> NDArray[np.uint8]:
    """Return the picture with axes and a bar below."""
    below = np.empty((scale_height(size), *image.shape[1:]), np.uint8)
    below[...] = 0 if style.background is None else round(255 * style.background)
    whole = np.concatenate([image, below])
    draw_scale(whole, camera, len(image), size, unit)
    return whole


def _composed(
    image: NDArray[np.uint8],
    title: str | None,
    key: ColorBar | LabelKey | None,
    style: Style,
    margins: tuple[int, int, int],
) -> NDArray[np.uint8]:
    """Return the image with its title above and legend at right.

    `margins` are the rows and columns that they take and the size of the text.
    """
    top, right, size = margins
    if top + right == 0:
        return np.ascontiguousarray(image)
    tall = legend_size(key, size)[1] if style.crop and key is not None else 0
    high, wide = image.shape[:2]
    whole = np.empty((top + max(high, tall), wide + right, image.shape[2]), np.uint8)
    whole[...] = 0 if style.background is None else round(255 * style.background)
    below = top + (len(whole) - top - high) // 2
    whole[below : below + high, :wide] = image
    if title:
        draw_title(whole, title, size)
    if key is not None:
        draw_legend(whole, key, left=wide, top=top, size=size)
    return whole


def _view_frame(camera: Camera, width: int, height: int) -> Camera:
    """Return the camera for the part of the picture left free, still showing all it saw before."""
    if (width, height) == (camera.width, camera.height):
        return camera
    if width < 1 or height < 1:
        raise InvalidOptionError(
            f"A picture of {camera.width} x {camera.height} has no room for title and legend."
        )
    wanted = camera.extent * camera.width / camera.height
    extent = max(camera.extent, wanted * height / width)
    return replace(camera, extent=extent, width=width, height=height)


def _ball_layer(item: Balls | Points | Curves, camera: Camera) -> BallLayer:
    if isinstance(item, Balls):
        centers = as_points(item.centers, "centers")
        radii = as_radii(item.radii, len(centers))
        # Half a pixel at least, so that the smallest balls are still visible dots.
        return BallLayer(centers, radii, item.light(len(centers)), 0.5)
    if isinstance(item, Points):
        centers = as_points(item.points)
        size = as_number(item.size, "size", low=0, high=1000, open_low=True)
        return BallLayer(centers, np.zeros(len(centers)), item.light(len(centers)), size / 2)
    return _tube_layer(item, camera)


def _tube_layer(item: Curves, camera: Camera) -> BallLayer:
    """Draw tubes as chains of balls a third of a radius apart, at most 20000 an edge."""
    nodes = as_points(item.nodes, "nodes")
    width = as_number(item.width, "width", low=0, high=1000, open_low=True)
    colors = item.colors(len(nodes))
    pairs = np.asarray(item.edges)
    if pairs.size == 0:
        return BallLayer(nodes[:0], np.zeros(0), colors[:0], width / 2)
    if pairs.ndim != 2 or pairs.shape[1] != 2:
        raise InvalidShapeError(f"edges must be (e, 2) node indices, got shape {pairs.shape}.")
    ends = as_faces(pairs[:, [0, 1, 1]], len(nodes), "edges")[:, :2]
    a, b = nodes[ends[:, 0]], nodes[ends[:, 1]]
    step = width / 2 / camera.scale / 3
    count = np.ceil(np.linalg.norm(b - a, axis=1) / step)
    count = np.clip(count, 1, 20000).astype(np.int64) + 1
    edge = np.repeat(np.arange(len(ends)), count)
    place = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
    share = (place / (count - 1)[edge])[:, None]
    mix = np.rint(share) if item.labels is not None else share
    first, second = colors[ends[edge, 0]], colors[ends[edge, 1]]
    return BallLayer(
        a[edge] + (b - a)[edge] * share,
        np.zeros(len(edge)),
        to_linear(first + (second - first) * mix),
        width / 2,
    )


def _mesh_layer(item: Surface) -> MeshLayer:
    points = as_points(item.points)
    faces = as_faces(item.faces, len(points))
    opacity = as_number(item.opacity, "opacity", low=0, high=1)
    if not item.per_face and (item.labels is not None or item.limit is not None):
        points, faces, corners = _with_borders(item, points, faces)
        return MeshLayer(points, faces, corners, opacity, item.smooth)
    if item.per_face:
        corners = np.repeat(item.light(len(faces))[:, None], 3, axis=1)
    else:
        corners = item.light(len(points))[faces]
    return MeshLayer(points, faces, corners, opacity, item.smooth)


def _with_borders(
    item: Surface, points: FloatArray, faces: IntArray
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Return points, faces and colours of their corners, cut where the colours change."""
    from medialis.show.borders import cut_at_levels, cut_by_labels

    if item.labels is not None:
        item.colors(len(points))  # which checks them
        cut = cut_by_labels(points, faces, np.asarray(item.labels))
        tints = to_linear(label_colors(cut.side, item.palette))
        return cut.points, cut.faces, np.repeat(tints[:, None], 3, axis=1)
    assert item.values is not None and item.limit is not None
    values = as_field(item.values, len(points), "values")
    cut, corners = cut_at_levels(points, faces, values, (item.limit, NEAR_LIMIT * item.limit))
    return cut.points, cut.faces, to_linear(limit_colors(corners, item.limit))


def _legend_of(
    items: Sequence[Item], label: str, names: Sequence[str] | None
) -> ColorBar | LabelKey:
    for item in items:
        if item.labels is not None:
            return LabelKey(label, np.unique(item.labels), names, item.palette)
        if item.values is not None:
            low, high = value_range(item.values, item.low, item.high)
            values = np.asarray(item.values, np.float64)
            missing, whole = bool(np.isnan(values).any()), bool((values == np.rint(values)).all())
            return ColorBar(label, item.cmap, low, high, missing, item.limit, whole)
    raise InvalidOptionError("A legend needs an item with values or labels; there is none.")


NEARBY = 0.1
"""Fraction of the diagonal: what lies further from the bounding box may leave the picture, so that
a few large balls of an open surface do not make the shape small."""

MOST_TEXTS = 12
"""Places whose number and value are written, the first ones."""

IN_DEGREES = ("spoke_angle",)

POWERS = {"length": "", "area": "²"}
"""What stands behind the unit of a quantity."""


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
    if color_by is None and layer.drawn_by:
        layer = next(one for one in result.layers if one.name == layer.drawn_by)
    progress = Progress.of(progress)
    if camera is None:
        camera = run_patiently(lambda: _framed(result, width, height), progress)
    style = Style() if style is None else style
    if style.scale is None:
        style = replace(style, scale=True)
    items, label = _paint(result, layer, color_by or layer.color_by, camera.width, style.limits)
    if result.shown:
        unit = result.shape.unit
        items += [_mark(result, other, camera.width, unit) for other in others]
    else:
        items = [_context(result, camera.width), *items]
    return draw(
        items,
        camera,
        title=title,
        legend=label if style.legend else None,
        label_names=[name for name, _ in layer.classes] or None,
        style=style,
        unit=result.shape.unit,
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
    camera = _framed(result, size, size, "turntable")
    for number, view in enumerate(turntable(camera, count)):
        with steps.stage("turntable", number / count, (number + 1) / count):
            image = draw_result(result, color_by=color_by, camera=view, progress=steps)
        yield image


def draw_panels(
    result: Outcome, name: str, *, size: int = 480, progress: Progress | None = None
) -> NDArray[np.uint8]:
    """Draw the surfaces of `Outcome.panels` side by side, with one camera and one legend."""
    steps, panels = Progress.of(progress), result.panels[name]
    direction, up = shape_view(result.shape)
    every = np.concatenate([layer.points for _, layer in panels])
    camera = Camera.framing(every, direction=direction, up=up, width=size, height=size)
    images, key = [], None
    for number, (_, layer) in enumerate(panels):
        with steps.stage("picture", number / len(panels), (number + 1) / len(panels)):
            items, label = _paint(result, layer, layer.color_by, size, None)
            images.append(draw(items, camera, progress=steps))
        if key is None and label is not None:
            key = _legend_of(items, label, None)
    return contact_sheet(images, [caption for caption, _ in panels], columns=3, key=key)


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


SLIVER = 0.006
"""Height of triangles below this share of the size, which are drawn as lines: about their width."""


def line_edges(layer: Layer) -> IntArray | None:
    """Return the edges of a layer that are drawn as lines; None: it has none.

    Those of a layer of edges and triangles have those of its slivers, too: seen from the side, a
    limb of them would be a dashed line.
    """
    if layer.edges is None or layer.faces is None or not len(layer.faces):
        return None if layer.edges is None else frozen(layer.edges, np.int32)
    points = np.asarray(layer.points)
    corners = points[layer.faces]
    sides = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).max(axis=1)
    double = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    thin = np.asarray(layer.faces)[double < SLIVER * size * sides]
    own = np.concatenate([thin[:, [0, 1]], thin[:, [1, 2]], thin[:, [2, 0]]])
    every = np.sort(np.concatenate([layer.edges, own]), axis=1)
    return frozen(np.unique(every, axis=0), np.int32)


def _framed(result: Outcome, width: int, height: int, fit: str = "tight") -> Camera:
    """Return the camera of a result: that of all results of its shape."""
    direction, up = shape_view(result.shape)
    sizes: dict[str, Any] = {"width": width, "height": height, "fit": fit}
    return Camera.framing(_in_view(result), direction=direction, up=up, **sizes)


def _in_view(result: Outcome) -> NDArray[np.float64]:
    """Points that a picture must show: the shape, and the layer where it is not far outside."""
    (low, high), points = result.shape.bounds, result.layers[0].points
    reach = NEARBY * result.shape.diagonal
    near = ((points >= low - reach) & (points <= high + reach)).all(axis=1)
    return np.concatenate([result.shape.points, points[near]])


PLACES = {"thin_spots": "spots", "wall_regions": "regions"}
"""Layers of places, and the values that tell the other end of each."""


def _mark(result: Outcome, layer: Layer, width: int, unit: str | None) -> Item:
    """Points as black balls on the surface, half of each outside it, with number and value.

    Both ends of a wall have a ball, and that which is seen has the number.
    """
    texts: list[str] = []
    if layer.number_by is not None:
        values = layer.attributes[layer.number_by][:MOST_TEXTS]
        told = [value_text(layer.number_by, float(value), unit) for value in values]
        texts = [f"{rank}: {text}" for rank, text in enumerate(told, 1)]
    texts += [""] * (len(layer.points) - len(texts))
    points = np.asarray(layer.points)
    rows = result.values.get(PLACES.get(layer.name, ""), ())
    ends = {row: one["opposite"] for row, one in enumerate(rows) if one.get("opposite")}
    if ends and len(rows) == len(points):
        points = np.concatenate([points, np.array([*ends.values()], np.float64)])
        texts += [texts[row] for row in ends]
    return Points(points, size=max(4.0, width / 80), color=(0.05, 0.05, 0.05), texts=texts)


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
        values, label = np.asarray(layer.attributes[color_by]), value_words(color_by)
        if color_by in IN_DEGREES:
            values, label = np.degrees(values), label + " (degrees)"
        elif result.shape.unit and (power := POWERS.get(quantity(color_by))) is not None:
            label += f" ({result.shape.unit}{power})"
    cloud = layer.faces is None and layer.edges is None
    shown = ~layer.hidden if cloud else np.ones(len(layer.points), bool)
    if values is not None and not shown.all():
        values, label = values[shown], f"{label}; {_shown_from(layer, color_by, result.shape.unit)}"
    colors: dict[str, Any] = {"values": values}
    if layer.classes and color_by == layer.color_by:
        colors = {"labels": values, "palette": [color for _, color in layer.classes]}
    elif color_by in layer.labels:
        colors, label = {"labels": values}, None
    elif values is not None:
        given = layer.color_limits if color_by == layer.color_by else (None, None)
        low, high = value_range(values, *(limits or given))
        colors.update(low=low, high=high)
        if color_by == layer.color_by:
            colors.update(cmap=layer.color_map)
            if layer.color_limit is not None and limits is None:
                far = FAR_FROM_LIMIT * layer.color_limit
                colors.update(limit=layer.color_limit, low=0.0, high=far)
    items: list[Item] = []
    if layer.faces is not None:
        items.append(Surface(layer.points, layer.faces, **colors))
    edges = line_edges(layer)
    if edges is not None:
        items.append(Curves(layer.points, edges, width=width / 180, **colors))
    if items:
        return items, label
    return _cloud_items(result, layer, np.flatnonzero(shown), colors, width), label


def _cloud_items(
    result: Outcome, layer: Layer, rows: NDArray[np.intp], colors: dict[str, Any], width: int
) -> list[Item]:
    """Return medial points as sheets, those of curves as balls, other points as dots."""
    from medialis.show.medial_points import MEDIAL, medial_pieces  # only where there are any

    points = layer.points[rows]
    if not layer.attributes.keys() >= MEDIAL:
        # Smaller dots for more points, so that sheets look like sheets and not like gravel.
        size = float(np.clip(width / np.sqrt(max(len(points), 1)) / 2, width / 600, width / 160))
        return [Points(points, size=size, **colors)]
    drawn = medial_pieces(result.shape, layer, rows)

    def painted(chosen: NDArray[Any]) -> dict[str, Any]:
        own = dict(colors)
        for name in ("values", "labels"):
            if own.get(name) is not None:
                own[name] = own[name][chosen]
        return own

    discs = Surface(*drawn.discs, per_face=True, smooth=False, **painted(drawn.of_discs))
    balls = Balls(drawn.centers, drawn.radii, **painted(drawn.of_balls))
    sheets = Surface(*drawn.sheets, **painted(drawn.of_sheets))
    items: tuple[tuple[Item, int], ...] = (
        (sheets, len(drawn.sheets[1])),
        (discs, len(drawn.of_discs)),
        (balls, len(drawn.of_balls)),
    )
    return [item for item, count in items if count]


def _shown_from(layer: Layer, color_by: str | None, unit: str | None) -> str:
    """Say in few words from which value on a picture shows points; the note has the sentence.

    A length has the unit of the shape, as the values beside it; where none is known, it is a share.
    """
    value, kind = layer.filter_default, layer.filter_unit.kind
    if kind is Kind.LENGTH and unit:
        limit = with_unit(layer.filter_unit.attribute(value), unit, int(layer.filter_unit.power))
    elif kind is Kind.LENGTH:
        limit = f"{100 * value:.3g} % of the size"
    else:
        limit = f"{value:.3g}{' degrees' if kind is Kind.ANGLE else ''}"
    of = "" if color_by == layer.filter_by else f" {str(layer.filter_by).replace('_', ' ')}"
    return f"shown from {limit}{of} on"
