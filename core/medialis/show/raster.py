"""Balls and triangles drawn: projected, into depth and index buffers, and lit (thesis 3.4).

A camera makes pixel boxes of balls and clips triangles at its near plane (`see_balls`,
`see_triangles`); bands of rows are drawn on all threads (`rasterize`); `render_layers` adds Phong
shading with two lamps and a headlight, anti-aliasing and see-through surfaces.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.base.errors import InvalidOptionError, InvalidShapeError
from medialis.base.progress import Progress, ProgressCallback
from medialis.base.threads import run_chunks, run_patiently
from medialis.base.validation import (
    FloatArray,
    IntArray,
    as_faces,
    as_field,
    as_number,
    as_points,
    as_whole_number,
    frozen,
)
from medialis.shape.surface import Surface
from medialis.show.camera import MAX_PIXELS, Camera
from medialis.show.colors import to_linear, to_srgb

if TYPE_CHECKING:
    from medialis.base._splat_kernels import Balls, Canvas, Lens, Light, Mesh, Triangles


def lens_of(camera: Camera) -> Lens:
    """Return the camera as the kernels read it."""
    from medialis.base._splat_kernels import Lens

    focal, near = 0.0, 0.0
    if camera.perspective:
        focal, near = camera.scale * camera.distance, camera.near
    numbers = camera.scale, camera.width / 2, camera.height / 2, focal, near, 1.0
    return Lens(*(float(number) for number in numbers))


def _span(center: FloatArray, depth: FloatArray, radii: FloatArray) -> tuple[FloatArray, ...]:
    """Return the range of slopes x / z at which rays in the plane (x, z) meet each disc."""
    away = np.hypot(center, depth)
    around = np.arctan2(center, depth)
    half = np.arcsin(np.minimum(radii / np.maximum(away, 1e-300), 1.0))
    low, high = around - half, around + half
    wide = away <= radii
    with np.errstate(over="ignore"):
        first = np.where(wide | (low <= -math.pi / 2), -np.inf, np.tan(low))
        last = np.where(wide | (high >= math.pi / 2), np.inf, np.tan(high))
    return first, last


def _pixel_box(low: FloatArray, high: FloatArray, center: FloatArray, size: int) -> list[IntArray]:
    """Return first and last pixel whose center lies in low..high, or that holds the center."""
    first = np.minimum(np.ceil(low - 0.5), np.floor(center))
    last = np.maximum(np.floor(high - 0.5), np.floor(center))
    return [
        np.clip(first, 0, size).astype(np.int32),
        np.clip(last, -1, size - 1).astype(np.int32),
    ]


def see_balls(
    camera: Camera,
    centers: FloatArray,
    radii: FloatArray,
    smallest: float | FloatArray = 0.0,
    colors: FloatArray | None = None,
) -> Balls:
    """Project balls; one smaller than `smallest` pixels on screen is drawn with that radius."""
    from medialis.base._splat_kernels import Balls

    view = camera.to_view(centers)
    x, y, z = view.T
    seen = np.full(len(view), True)
    if camera.perspective:
        focal = camera.scale * camera.distance
        drawn = np.maximum(radii, smallest * np.maximum(z, camera.near) / focal)
        seen = z + drawn > camera.near
        columns, rows = _span(x, z, drawn), _span(-y, z, drawn)
        ahead = np.where(z > camera.near, z, np.inf)
        middle = focal * x / ahead, -focal * y / ahead
        bounds = [focal * value for value in (*columns, *rows)]
        # A ball round the near plane has no center pixel: its box is its span.
        middle = tuple(
            np.where(z > camera.near, value, np.clip(0.0, low, high))
            for value, low, high in zip(middle, bounds[::2], bounds[1::2], strict=True)
        )
    else:
        drawn = np.maximum(radii, smallest / camera.scale)
        middle = camera.scale * x, -camera.scale * y
        half = camera.scale * drawn
        bounds = [middle[0] - half, middle[0] + half, middle[1] - half, middle[1] + half]
    w, h = camera.width, camera.height
    boxes = np.stack(
        [
            *_pixel_box(bounds[2] + h / 2, bounds[3] + h / 2, middle[1] + h / 2, h),
            *_pixel_box(bounds[0] + w / 2, bounds[1] + w / 2, middle[0] + w / 2, w),
        ],
        axis=1,
    )
    boxes[~seen | (boxes[:, 2] > boxes[:, 3]), 1] = -1
    tints = np.zeros(view.shape) if colors is None else colors
    return Balls(
        np.ascontiguousarray(view), np.ascontiguousarray(drawn), boxes, tints.astype(np.float32)
    )


def see_triangles(camera: Camera, view: FloatArray, faces: IntArray, base: int = 0) -> Triangles:
    """Project triangles given in view space; face f is named base + f in the index buffer."""
    from medialis.base._splat_kernels import Triangles

    names = np.arange(base, base + len(faces), dtype=np.int32)
    if camera.perspective:
        view, faces, names = _clip(view, faces, names, camera.near)
        last = 1.0 / np.maximum(view[:, 2], camera.near)
        focal = camera.scale * camera.distance
        right, down = focal * view[:, 0] * last, focal * view[:, 1] * last
    else:
        last, right, down = view[:, 2], camera.scale * view[:, 0], camera.scale * view[:, 1]
    screen = np.stack([camera.width / 2 + right, camera.height / 2 - down, last], axis=1)
    return Triangles(screen, frozen(faces, np.int32), names)


def _clip(
    view: FloatArray, faces: IntArray, names: IntArray, near: float
) -> tuple[FloatArray, IntArray, IntArray]:
    """Cut triangles at the near plane: those across it become one or two pieces in front of it."""
    front = view[:, 2] >= near
    count = front[faces].sum(axis=1) if len(faces) else np.zeros(0, np.int64)
    if (count == 3).all():
        return view, faces, names
    kept = count == 3
    points, pieces, owners = [view], [faces[kept]], [names[kept]]
    total = len(view)
    for inside in (1, 2):
        cut = faces[count == inside]
        if len(cut) == 0:
            continue
        lone = front[cut] if inside == 1 else ~front[cut]
        turn = (lone.argmax(axis=1)[:, None] + np.arange(3)) % 3
        a, b, c = np.take_along_axis(cut, turn, axis=1).T
        on_ab, on_ac = _at_near(view, a, b, near), _at_near(view, a, c, near)
        p = np.arange(total, total + len(cut), dtype=np.int32)
        q = (p + len(cut)).astype(np.int32)
        points += [on_ab, on_ac]
        total += 2 * len(cut)
        new = [(a, p, q)] if inside == 1 else [(p, b, c), (p, c, q)]
        for corners in new:
            pieces.append(np.stack(corners, axis=1).astype(np.int32))
            owners.append(names[count == inside])
    owner = np.concatenate(owners)
    order = np.argsort(owner, kind="stable")
    return np.concatenate(points), np.concatenate(pieces)[order], owner[order]


def _at_near(view: FloatArray, a: IntArray, b: IntArray, near: float) -> FloatArray:
    # From the lower vertex to the higher, so that neighbours cut their common edge at one point.
    low, high = view[np.minimum(a, b)], view[np.maximum(a, b)]
    share = (near - low[:, 2]) / (high[:, 2] - low[:, 2])
    points = low + (high - low) * share[:, None]
    points[:, 2] = near
    return points


BAND = 32
"""Rows drawn by one kernel call: a constant, so that results do not depend on the threads."""

BALLS_A_STEP, PIXELS_A_STEP, TRIANGLES_A_STEP = 1 << 16, 1 << 23, 1 << 14
"""Drawn by one kernel call at most: some 30 ms."""

Drawing = Callable[[int, int, "Canvas"], Iterator[None]]
"""Draws what lies in rows begin..end into a canvas, in steps."""


def blank_canvas(height: int, width: int, glass: bool = False) -> Canvas:
    """Return a canvas of so many pixels, all empty; `glass`: for see-through layers as well."""
    from medialis.base._splat_kernels import Canvas

    depth = np.full((height, width), np.inf)
    shape = (height, width, 4) if glass else (0, 0, 4)
    return Canvas(depth, np.full(depth.shape, -1, np.int32), np.zeros(shape, np.float32), 0)


@dataclass(frozen=True, eq=False)
class Buffers:
    """What each pixel shows.

    Attributes
    ----------
    depth : (h, w) float64
        Distance along the viewing axis, in the caller's units; +inf where nothing is.
    index : (h, w) int32
        The ball, or the number of balls plus the face; -1 where nothing is.
    """

    depth: FloatArray
    index: IntArray

    @property
    def mask(self) -> NDArray[np.bool_]:
        """True where something is, (h, w)."""
        return self.index >= 0


def _bands(
    first_row: NDArray[Any], last_row: NDArray[Any], height: int, band: int, beyond: int
) -> tuple[NDArray[np.int64], IntArray]:
    """Return, as compressed rows, the primitives that touch each band, ascending.

    A band has `band` rows, and so many `beyond` it, which its neighbours have as well.
    """
    from medialis.base._splat_kernels import fill_bins

    bands = -(-height // band)
    first = np.maximum(first_row - beyond, 0) // band
    last = np.minimum(last_row + beyond, height - 1) // band
    outside = last_row < first_row
    first, last = np.where(outside, 1, first), np.where(outside, 0, last)
    change = np.bincount(first[~outside], minlength=bands + 1)[: bands + 1]
    change -= np.bincount(last[~outside] + 1, minlength=bands + 1)[: bands + 1]
    offsets = np.zeros(bands + 1, np.int64)
    np.cumsum(np.cumsum(change[:bands]), out=offsets[1:])
    items = np.empty(offsets[-1], np.int32)
    fill_bins(first.astype(np.int32), last.astype(np.int32), offsets[:-1].copy(), items)
    return offsets, items


def balls_drawing(
    balls: Balls, lens: Lens, height: int, band: int = BAND, beyond: int = 0
) -> Drawing:
    """Return what draws balls, band by band, into depth and index."""
    from medialis.base._splat_kernels import splat_balls

    offsets, items = _bands(balls.boxes[:, 0], balls.boxes[:, 1], height, band, beyond)

    def draw(begin: int, end: int, canvas: Canvas) -> Iterator[None]:
        low, high = max(begin - beyond, 0), min(end + beyond, height)
        listed = items[offsets[begin // band] : offsets[begin // band + 1]]
        for part in _steps(listed, balls.boxes, low, high):
            splat_balls(part, balls, lens, low, high, canvas)
            yield

    return draw


def _steps(listed: IntArray, boxes: IntArray, begin: int, end: int) -> Iterator[IntArray]:
    """Give the balls of a band in parts that take about as long to draw, however large they are."""
    for first in range(0, len(listed), BALLS_A_STEP):
        balls = listed[first : first + BALLS_A_STEP]
        row0, row1, column0, column1 = boxes[balls].T.astype(np.int64)
        rows = np.minimum(row1 + 1, end) - np.maximum(row0, begin)
        pixels = np.cumsum(rows * (column1 + 1 - column0))
        cuts = np.flatnonzero(np.diff(pixels // PIXELS_A_STEP)) + 1
        yield from np.split(balls, cuts)


def mesh_drawing(
    triangles: Triangles,
    lens: Lens,
    mesh: Mesh,
    size: tuple[int, int],
    band: int = BAND,
    beyond: int = 0,
) -> Drawing:
    """Return what draws triangles, band by band: opaque ones, or on a canvas with glass layers.

    `size` are the rows and columns of the picture.
    """
    from medialis.base._splat_kernels import draw_triangles, triangle_rows

    height, width = size
    count = len(triangles.corners)
    first, last = np.empty(count, np.int32), np.empty(count, np.int32)
    triangle_rows(triangles.screen, triangles.corners, height, width, first, last)
    offsets, items = _bands(first, last, height, band, beyond)

    def draw(begin: int, end: int, canvas: Canvas) -> Iterator[None]:
        low, high = max(begin - beyond, 0), min(end + beyond, height)
        listed = items[offsets[begin // band] : offsets[begin // band + 1]]
        for place in range(0, len(listed), TRIANGLES_A_STEP):
            part = listed[place : place + TRIANGLES_A_STEP]
            draw_triangles(part, triangles, lens, low, high, mesh, canvas)
            yield

    return draw


def as_radii(radii: ArrayLike, count: int) -> FloatArray:
    """Return radii (k,), or one number for all balls, as finite non-negative float64.

    Raises
    ------
    InvalidShapeError
        For another shape, NaN, infinity or negative radii.
    """
    values = np.full(count, radii) if np.ndim(radii) == 0 else radii
    result = as_field(values, count, "radii")
    if not (np.isfinite(result).all() and (result >= 0).all()):
        raise InvalidShapeError("radii must be finite and at least 0: leave failed balls out.")
    return result


def rasterize(
    camera: Camera,
    *,
    centers: ArrayLike | None = None,
    radii: ArrayLike | None = None,
    points: ArrayLike | None = None,
    faces: ArrayLike | None = None,
    progress: Progress | ProgressCallback | None = None,
) -> Buffers:
    """Return what a camera sees of balls and triangles: depth and index.

    A ball has its exact sphere depth at each pixel center and covers at least the pixel of its
    center. Triangles show both sides; neighbours leave no gap and share no pixel. Equal depths go
    to the lowest index. The result does not depend on the number of threads.

    Parameters
    ----------
    camera : Camera
    centers, radii : (k, 3) and (k,) float, optional
        Balls, in the units of the camera.
    points, faces : (n, 3) float and (m, 3) int, optional
        Triangles.

    Raises
    ------
    InvalidShapeError
        When an array cannot be used.
    Cancelled
        When the progress callback asks for it.

    Notes
    -----
    Source: thesis 3.4 (billboards with a ball's height, depth test). Deviates: the height is
    evaluated at each pixel, not read from a texture, and perspective balls are exact.

    Examples
    --------
    >>> camera = Camera([0, 0, 5], [0, 0, 0], [0, 1, 0], extent=4.0, width=64, height=64)
    >>> seen = rasterize(camera, centers=[[0, 0, 0]], radii=[1.0])
    >>> round(float(seen.depth.min()), 2), int(seen.mask.sum()) == 812
    (4.0, True)
    """
    steps, size = Progress.of(progress), (camera.height, camera.width)
    lens, canvas, count = lens_of(camera), blank_canvas(*size), 0

    def onto(drawing: Drawing) -> None:
        def band(begin: int, end: int) -> Iterator[None]:
            yield from drawing(begin, end, canvas)

        run_chunks(band, camera.height, BAND, progress=steps)

    if centers is not None:
        data = as_points(centers, "centers")
        sizes = as_radii(0.0 if radii is None else radii, len(data))
        count = len(data)
        with steps.stage("balls", 0.0, 0.5):
            balls = run_patiently(lambda: see_balls(camera, data, sizes), steps)
            onto(balls_drawing(balls, lens, camera.height))
    if points is not None:
        corners = as_points(points)
        triangles = as_faces(np.zeros((0, 3)) if faces is None else faces, len(corners))
        view = camera.to_view(corners)
        with steps.stage("triangles", 0.5, 0.9):
            seen = run_patiently(lambda: see_triangles(camera, view, triangles, count), steps)
            onto(mesh_drawing(seen, lens, mesh_of([], [], lens), size))
    return Buffers(canvas.depth, canvas.index)


SMOOTH_COSINE = 0.75
"""A corner takes the vertex normal where that is within 41 degrees of the face normal."""

FACES_A_CHUNK = 1 << 16

SHADOW_DEPTH = 0.05
"""Part of the height of the picture: what stands this much in front darkens wholly."""

_LAMPS = np.array(
    [
        [-0.45, 0.65, -0.62, 0.62],  # key: upper left, in front
        [0.80, 0.10, -0.50, 0.18],  # fill: right
        [0.0, 0.0, -1.0, 0.22],  # headlight
    ]
)
_LAMPS[:, :3] /= np.linalg.norm(_LAMPS[:, :3], axis=1, keepdims=True)


@dataclass(frozen=True)
class Style:
    """How a picture is lit and framed.

    Attributes
    ----------
    ambient, diffuse, specular : float
        Weights 0..2 of the Phong model, in linear light.
    shadow : float
        Darkening 0..1 of what lies closely behind something else; it makes point clouds readable.
    supersampling : int
        Samples a pixel along each axis, 1..4; 2 gives smooth edges.
    background : float or None
        Grey of the background, 0..1 (1 is white); None leaves it see-through (RGBA).
    crop : bool
        Cut off what is empty round the items: the picture is then smaller than its camera says, and
        title and legend stand close to them.
    legend : bool
        Say which colour is which value, where a picture has values.
    limits : (float, float), optional
        Values of the first and last colour; by default those of the item that is drawn.
    scale : bool, optional
        Draw the axes and a bar of a round length below; by default pictures of results have them.

    Raises
    ------
    InvalidOptionError
        When a number is out of range.
    """

    ambient: float = 0.3
    diffuse: float = 0.8
    specular: float = 0.14
    shadow: float = 0.45
    supersampling: int = 2
    background: float | None = 1.0
    crop: bool = False
    legend: bool = True
    limits: tuple[float, float] | None = None
    scale: bool | None = None

    def __post_init__(self) -> None:
        for name in ("ambient", "diffuse", "specular"):
            as_number(getattr(self, name), name, low=0, high=2)
        as_number(self.shadow, "shadow", low=0, high=1)
        if self.background is not None:
            as_number(self.background, "background", low=0, high=1)
        as_whole_number(self.supersampling, "supersampling", low=1, high=4)


@dataclass(frozen=True, eq=False)
class BallLayer:
    """Balls (k): world centers, radii, linear light (k, 3), least screen radius in pixels."""

    centers: FloatArray
    radii: FloatArray
    colors: FloatArray
    smallest: float = 0.0


@dataclass(frozen=True, eq=False)
class MeshLayer:
    """Triangles: points (n, 3), faces (m, 3), linear light (m, 3, 3) at corners, opacity 0..1."""

    points: FloatArray
    faces: IntArray
    colors: FloatArray
    opacity: float = 1.0
    smooth: bool = True


def corner_normals(points: FloatArray, faces: IntArray, smooth: bool = True) -> NDArray[np.float32]:
    """Return a shading normal for each corner of each face, (m, 3, 3) float32.

    The mean of the faces round the vertex, weighted by their angle there (so that it does not
    matter how a flat side is cut into triangles), unless that is more than 41 degrees off the face:
    curved surfaces look smooth and sharp edges stay sharp.
    """
    from medialis.base._splat_kernels import pick_normals, sum_normals

    flat = Surface.of_checked(points, faces).face_normals
    if not smooth:
        return np.repeat(flat[:, None], 3, axis=1).astype(np.float32)
    vertex, corners = np.zeros((len(points), 3)), np.empty((len(faces), 3, 3), np.float32)
    sum_normals(points, faces, flat, vertex)
    length = np.sqrt(np.einsum("ij,ij->i", vertex, vertex))[:, None]
    np.divide(vertex, length, out=vertex, where=length > 0)

    def pick(begin: int, end: int) -> None:
        pick_normals(begin, end, faces, flat, vertex, SMOOTH_COSINE, corners)

    run_chunks(pick, len(faces), FACES_A_CHUNK)
    return corners


@lru_cache(maxsize=1)
def _encoding() -> NDArray[np.uint8]:
    """Return the table linear light 0..1 (8192 steps) -> sRGB 0..255."""
    return frozen(np.rint(255 * to_srgb(np.linspace(0, 1, 8192))), np.uint8)


def _balls_of(layers: list[BallLayer], camera: Camera, supersampling: int) -> Balls:
    """Join ball layers into what the camera sees."""
    centers = np.concatenate([np.zeros((0, 3)), *(layer.centers for layer in layers)])
    radii = np.concatenate([np.zeros(0), *(layer.radii for layer in layers)])
    colors = np.concatenate([np.zeros((0, 3)), *(layer.colors for layer in layers)])
    smallest = np.repeat(
        [supersampling * layer.smallest for layer in layers],
        [len(layer.radii) for layer in layers],
    )
    return see_balls(camera, centers, radii, smallest, colors)


def mesh_of(layers: list[MeshLayer], views: list[FloatArray], lens: Lens) -> Mesh:
    """Join mesh layers, whose points are given in view space, as the kernels read them."""
    from medialis.base._splat_kernels import Mesh, fill_planes

    count = sum(len(layer.faces) for layer in layers)
    planes, density = np.empty((count, 3, 6), np.float32), np.empty(count, np.float32)
    end = 0
    for layer, view in zip(layers, views, strict=True):
        start, end = end, end + len(layer.faces)
        normals = corner_normals(view, layer.faces, layer.smooth)
        colors = np.ascontiguousarray(layer.colors, np.float32)
        faces = frozen(layer.faces, np.int32)
        given = view, faces, normals, colors, lens, planes[start:end]
        run_chunks(fill_planes, len(faces), FACES_A_CHUNK, *given)
        density[start:end] = -math.log1p(-min(layer.opacity, 0.999))
    return Mesh(planes, density)


def _within_range(
    balls: list[BallLayer], meshes: list[MeshLayer], camera: Camera
) -> tuple[list[BallLayer], list[MeshLayer], Camera]:
    """Return huge or tiny scenes in a unit in which products of lengths stay in range.

    A power of two, so that the picture does not change.
    """
    unit = 2.0 ** math.frexp(camera.extent)[1]
    if 1e-30 < unit < 1e30:
        return balls, meshes, camera
    return (
        [replace(x, centers=x.centers / unit, radii=x.radii / unit) for x in balls],
        [replace(x, points=x.points / unit) for x in meshes],
        replace(
            camera, eye=camera.eye / unit, target=camera.target / unit, extent=camera.extent / unit
        ),
    )


def _light(style: Style, camera: Camera) -> Light:
    """Return a style as the kernels read it."""
    from medialis.base._splat_kernels import Light

    return Light(
        _LAMPS,
        float(style.ambient),
        float(style.diffuse),
        float(style.specular),
        float(style.shadow),
        float(SHADOW_DEPTH * camera.extent),
        0.0 if style.background is None else float(to_linear(style.background)),
        _encoding(),
    )


def render_layers(
    balls: list[BallLayer],
    meshes: list[MeshLayer],
    camera: Camera,
    style: Style,
    progress: Progress | None = None,
) -> NDArray[np.uint8]:
    """Return the picture (h, w, 3) uint8 of ball and mesh layers; (h, w, 4) without background.

    Opaque layers go to one depth buffer; a see-through layer (opacity below 1) then veils what lies
    behind it, facing parts by `opacity` a layer and silhouettes up to ten times denser, so that the
    inside stays visible and the outline is clear.

    Raises
    ------
    InvalidOptionError
        When the picture times the supersampling is larger than 16384 pixels.
    """
    from medialis.base._splat_kernels import shade

    balls, meshes, camera = _within_range(balls, meshes, camera)
    n = style.supersampling
    if max(camera.width, camera.height) * n > MAX_PIXELS:
        raise InvalidOptionError(
            f"A picture of {camera.width} x {camera.height} with supersampling {n} is larger than "
            f"{MAX_PIXELS} samples; use a smaller picture or supersampling."
        )
    fine = replace(camera, width=camera.width * n, height=camera.height * n)
    opaques = [layer for layer in meshes if layer.opacity >= 1]
    veils = [layer for layer in meshes if 0 < layer.opacity < 1]
    steps = Progress.of(progress)

    lens = lens_of(fine)

    def see(layers: list[MeshLayer], base: int) -> tuple[Triangles, Mesh]:
        views = [fine.to_view(layer.points) for layer in layers]
        firsts = np.cumsum([0, *map(len, views)])
        faces = [layer.faces + first for layer, first in zip(layers, firsts, strict=False)]
        every = frozen(np.concatenate([np.zeros((0, 3)), *faces]), np.int32)
        points = np.concatenate([np.zeros((0, 3)), *views])
        return see_triangles(fine, points, every, base), mesh_of(layers, views, lens)

    seen = run_patiently(lambda: _balls_of(balls, fine, n), steps)
    faces, solid = run_patiently(lambda: see(opaques, len(seen.radii)), steps)
    layers, veil = run_patiently(lambda: see(veils, 0), steps)
    rows, columns = _window(seen, (faces, layers), fine, n)
    seen, faces, layers = _moved(seen, faces, layers, rows.start, columns.start)
    lens = lens._replace(column=lens.column - columns.start, row=lens.row - rows.start)
    # A strip at a time: a canvas of the whole picture would be 100 MB that nobody reads again.
    size = rows.stop - rows.start, columns.stop - columns.start
    channels = 3 + (style.background is None)
    part = np.empty((size[0] // n, size[1] // n, channels), np.uint8)
    light = _light(style, camera)
    beyond, has_veils = 2 * n, len(layers.corners) > 0
    blanks: list[Canvas] = []

    def drawings() -> tuple[Drawing, Drawing, Drawing]:
        bands = n * BAND, beyond
        return (
            balls_drawing(seen, lens, size[0], *bands),
            mesh_drawing(faces, lens, solid, size, *bands),
            mesh_drawing(layers, lens, veil, size, *bands),
        )

    *opaque, veils_of = run_patiently(drawings, steps)
    no_glass = np.zeros((0, 0, 4), np.float32)

    def band(begin: int, end: int) -> Iterator[None]:
        """Draw a strip of the picture, and light it while it is near the processor."""
        strip = blanks.pop() if blanks else blank_canvas(n * BAND + 2 * beyond, size[1], has_veils)
        strip.depth.fill(np.inf)
        strip.index.fill(-1)
        strip.glass.fill(0.0)
        canvas = strip._replace(top=n * begin - beyond, glass=no_glass)
        for drawing in opaque:
            yield from drawing(n * begin, n * end, canvas)
        if has_veils:
            canvas = canvas._replace(glass=strip.glass)
            yield from veils_of(n * begin, n * end, canvas)
        shade(canvas, lens, seen, solid, light, begin, end, part)
        blanks.append(strip)

    with steps.stage("draw", 0.0, 1.0):
        run_chunks(band, len(part), BAND, progress=steps)
    ground = np.empty((1, 1, channels), np.uint8)
    shade(blank_canvas(n, n), lens, seen, solid, light, 0, 1, ground)
    picture = np.broadcast_to(ground, (camera.height, camera.width, channels)).copy()
    top, left = rows.start // n, columns.start // n
    picture[top : top + len(part), left : left + part.shape[1]] = part
    return picture


def _window(
    balls: Balls, meshes: tuple[Triangles, ...], camera: Camera, step: int
) -> tuple[slice, slice]:
    """Return rows and columns, multiples of `step`, outside of which nothing is drawn.

    A thing fills a fifth of its picture; the rest need not be drawn, nor have memory.
    """
    size = np.array([camera.height, camera.width])
    low, high = [size], [np.zeros(2, np.int64)]
    boxes = balls.boxes[balls.boxes[:, 1] >= 0].astype(np.int64)
    if len(boxes):
        low.append(boxes[:, ::2].min(axis=0))
        high.append(boxes[:, 1::2].max(axis=0) + 1)
    for mesh in meshes:
        if len(mesh.corners):
            at = mesh.screen[:, 1::-1]
            with np.errstate(invalid="ignore"):
                least, most = np.nan_to_num(at.min(axis=0)), np.nan_to_num(at.max(axis=0))
            finite = bool(np.isfinite(least + most).all() and np.isfinite(at).all())
            low.append(np.clip(least, 0, size).astype(np.int64) if finite else 0 * size)
            high.append(np.clip(most + 1, 0, size).astype(np.int64) if finite else size)
    first = np.min(low, axis=0) // step * step
    last = np.maximum(-(-np.max(high, axis=0) // step) * step, first)
    return slice(int(first[0]), int(last[0])), slice(int(first[1]), int(last[1]))


def _moved(
    balls: Balls, faces: Triangles, layers: Triangles, row: int, column: int
) -> tuple[Balls, Triangles, Triangles]:
    """Return what is seen in a window that begins at a row and a column; no bit is rounded away."""
    start = np.array([column, row, 0.0])
    boxes = balls.boxes - np.array([row, row, column, column], np.int32)
    return (
        balls._replace(boxes=boxes),
        faces._replace(screen=faces.screen - start),
        layers._replace(screen=layers.screen - start),
    )
