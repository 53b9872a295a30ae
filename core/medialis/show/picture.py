"""Pictures: what to draw, in which colours, with a title and a legend (thesis 3.4), and as PNG.

PNG files (8-bit RGB or RGBA) take nothing but the standard library's zlib.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.base.errors import InvalidOptionError, InvalidShapeError
from medialis.base.progress import Progress, ProgressCallback
from medialis.base.threads import run_patiently
from medialis.base.validation import FloatArray, as_faces, as_field, as_number, as_points
from medialis.formats.files import complete_file
from medialis.show.annotation import (
    ColorBar,
    LabelKey,
    content_box,
    draw_legend,
    draw_title,
    legend_size,
    text_size,
    title_height,
)
from medialis.show.camera import Camera
from medialis.show.colors import label_colors, map_colors, to_linear, value_range
from medialis.show.raster import BallLayer, MeshLayer, Style, as_radii, render_layers

SIGNATURE = b"\x89PNG\r\n\x1a\n"
COMPRESSION = 1
"""zlib level: 1000 x 750 pixels of a rendered mesh take about 11 ms, pure noise 42 ms."""


def _chunk(kind: bytes, data: bytes) -> bytes:
    checksum = zlib.crc32(data, zlib.crc32(kind))
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", checksum)


def encode_png(image: ArrayLike) -> bytes:
    """Return the PNG bytes of an image (h, w, 3) or, see-through, (h, w, 4) uint8.

    Each row is stored as the difference to the row above or to the pixel at its left, whichever has
    the smaller sum of absolute differences: smooth shading then compresses well.

    Raises
    ------
    InvalidShapeError
        For another shape or another type than uint8.
    """
    pixels = np.asarray(image)
    right = pixels.ndim == 3 and pixels.shape[2] in (3, 4) and pixels.dtype == np.uint8
    if not right or 0 in pixels.shape:
        raise InvalidShapeError(
            "image must be (h, w, 3) or (h, w, 4) uint8 with h, w >= 1, "
            f"got {pixels.shape} {pixels.dtype}."
        )
    height, width, channels = pixels.shape
    left, above = pixels.copy(), pixels.copy()
    left[:, 1:] -= pixels[:, :-1]
    above[1:] -= pixels[:-1]
    cost = [
        np.abs(rows.reshape(height, -1).view(np.int8).astype(np.int16)).sum(axis=1, dtype=np.int64)
        for rows in (left, above)
    ]
    use_left = cost[0] < cost[1]
    rows = np.empty((height, 1 + channels * width), np.uint8)
    rows[:, 0] = np.where(use_left, 1, 2)
    rows[:, 1:] = np.where(use_left[:, None, None], left, above).reshape(height, -1)
    header = struct.pack(">IIBBBBB", width, height, 8, 2 if channels == 3 else 6, 0, 0, 0)
    data = zlib.compress(rows.tobytes(), COMPRESSION)
    return SIGNATURE + _chunk(b"IHDR", header) + _chunk(b"IDAT", data) + _chunk(b"IEND", b"")


def reduced(image: NDArray[np.uint8], width: int) -> NDArray[np.uint8]:
    """Return a picture (h, w, 3 or 4) at a whole fraction of its size, no narrower than `width`.

    Each pixel is the mean of a square, colours weighed by cover; a rest that fills no square is cut
    off.
    """
    step = max(1, image.shape[1] // width)
    high, wide = (max(1, size // step) for size in image.shape[:2])
    shape = high, min(step, len(image)), wide, step, image.shape[2]
    squares = image[: high * step, : wide * step].reshape(shape).astype(np.float64)
    if image.shape[2] == 3:
        return np.rint(squares.mean(axis=(1, 3))).astype(np.uint8)
    cover = squares[..., 3:].mean(axis=(1, 3))
    inked = (squares[..., :3] * squares[..., 3:]).mean(axis=(1, 3))
    color = np.divide(inked, cover, out=np.zeros_like(inked), where=cover > 0)
    return np.rint(np.concatenate([color, cover], axis=2)).astype(np.uint8)


def write_png(path: str | os.PathLike[str], image: ArrayLike) -> None:
    """Write an image (h, w, 3 or 4) uint8; the file appears whole or not at all.

    Raises
    ------
    InvalidShapeError
        For another shape or another type than uint8.
    FileError
        When the file cannot be written.
    """
    with complete_file(path) as stream:
        stream.write(encode_png(image))


Color = tuple[float, float, float]
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
    """

    color: ArrayLike = (0.62, 0.68, 0.76)
    values: ArrayLike | None = None
    labels: ArrayLike | None = None
    cmap: str = "sequential"
    low: float | None = None
    high: float | None = None

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
            return label_colors(self.labels)
        if self.values is not None:
            field = as_field(self.values, count, "values")
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
    """Points (k, 3) shown as small balls of the same size everywhere, `size` pixels across."""

    points: ArrayLike
    size: float = 4.0


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
        frame = _view_frame(camera, camera.width - right, camera.height - top)
    balls, meshes = run_patiently(lambda: _layers_of(items, frame), steps)
    image = render_layers(balls, meshes, frame, chosen, steps)
    margins = (top, right, size)
    return run_patiently(lambda: _composed(image, title, key, chosen, margins), steps)


def _composed(
    image: NDArray[np.uint8],
    title: str | None,
    key: ColorBar | LabelKey | None,
    style: Style,
    margins: tuple[int, int, int],
) -> NDArray[np.uint8]:
    """Return the image, cut to what it shows if wanted, with its title above and legend at right.

    `margins` are the rows and columns that they take and the size of the text; with cropping they
    follow from what is left.
    """
    top, right, size = margins
    tall = 0
    ground = [0] * 4 if style.background is None else [round(255 * style.background)] * 3
    if style.crop:
        rows, columns = content_box(image, np.array(ground, np.uint8), size)
        size = text_size(round(1.2 * (columns.stop - columns.start)), image.shape[0])
        top = title_height(size) if title else 0
        right, tall = (0, 0) if key is None else legend_size(key, size)
        image = image[rows, columns]
    if top + right == 0:
        return np.ascontiguousarray(image)
    high, wide = image.shape[:2]
    whole = np.empty((top + max(high, tall), wide + right, image.shape[2]), np.uint8)
    whole[...] = ground
    below = top + (len(whole) - top - high) // 2
    whole[below : below + high, :wide] = image
    if title:
        draw_title(whole, title, size)
    if key is not None:
        draw_legend(whole, key, left=wide, top=top, size=size)
    return whole


def _layers_of(items: Sequence[Item], frame: Camera) -> tuple[list[BallLayer], list[MeshLayer]]:
    """Return what is drawn as balls, and what as triangles."""
    balls: list[BallLayer] = []
    meshes: list[MeshLayer] = []
    for item in items:
        if isinstance(item, Surface):
            meshes.append(_mesh_layer(item))
        else:
            balls.append(_ball_layer(item, frame))
    return balls, meshes


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
    return Camera(camera.eye, camera.target, camera.up, extent, width, height, camera.perspective)


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
    if item.per_face:
        corners = np.repeat(item.light(len(faces))[:, None], 3, axis=1)
    else:
        corners = item.light(len(points))[faces]
    return MeshLayer(points, faces, corners, opacity, item.smooth)


def _legend_of(
    items: Sequence[Item], label: str, names: Sequence[str] | None
) -> ColorBar | LabelKey:
    for item in items:
        if item.labels is not None:
            return LabelKey(label, np.unique(item.labels), names)
        if item.values is not None:
            low, high = value_range(item.values, item.low, item.high)
            missing = bool(np.isnan(np.asarray(item.values, np.float64)).any())
            return ColorBar(label, item.cmap, low, high, missing)
    raise InvalidOptionError("A legend needs an item with values or labels; there is none.")
