"""Light: Phong shading with two lamps and a headlight, anti-aliasing, see-through surfaces."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from medialis.errors import InvalidOptionError
from medialis.model.surface import Surface
from medialis.progress import Progress
from medialis.render.camera import MAX_PIXELS, Camera
from medialis.render.colors import to_linear, to_srgb
from medialis.render.projection import BallSet, TriangleSet, lens, see_balls, see_triangles
from medialis.render.raster import BAND, Mesh, draw_balls, draw_mesh, empty_mesh
from medialis.threads import run_chunks, run_patiently
from medialis.validation import FloatArray, IntArray, as_number, as_whole_number, frozen

SMOOTH_COSINE = 0.75
"""A corner takes the vertex normal where that is within 41 degrees of the face normal."""

FACES_A_CHUNK = 1 << 16

_LAMPS = np.array(
    [
        [-0.45, 0.65, -0.62, 0.62],  # key: upper left, in front
        [0.80, 0.10, -0.50, 0.18],  # fill: right
        [0.0, 0.0, -1.0, 0.22],  # headlight
    ]
)


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
    from medialis.render._shading_kernels import pick_normals, sum_normals

    flat = Surface(points, faces).face_normals
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


def _balls_of(
    layers: list[BallLayer], camera: Camera, supersampling: int
) -> tuple[BallSet, NDArray[np.float32]]:
    """Join ball layers into what the camera sees, and the colors."""
    centers = np.concatenate([np.zeros((0, 3)), *(layer.centers for layer in layers)])
    radii = np.concatenate([np.zeros(0), *(layer.radii for layer in layers)])
    colors = np.concatenate([np.zeros((0, 3)), *(layer.colors for layer in layers)])
    smallest = np.repeat(
        [supersampling * layer.smallest for layer in layers],
        [len(layer.radii) for layer in layers],
    )
    return see_balls(camera, centers, radii, smallest), colors.astype(np.float32)


def _mesh_of(layers: list[MeshLayer], camera: Camera, base: int) -> tuple[Mesh, TriangleSet]:
    """Join mesh layers into the tuple that the kernels read, and what the camera sees of it."""
    mesh = _joined(layers, camera)
    return mesh, see_triangles(camera, mesh[0], mesh[1], base)


def _joined(layers: list[MeshLayer], camera: Camera) -> Mesh:
    """Join mesh layers in view space."""
    if not layers:
        return empty_mesh()
    counts = np.cumsum([0, *(len(layer.points) for layer in layers[:-1])])
    views = [camera.to_view(layer.points) for layer in layers]
    normals = [
        corner_normals(view, layer.faces, layer.smooth)
        for view, layer in zip(views, layers, strict=True)
    ]
    faces = [layer.faces + count for layer, count in zip(layers, counts, strict=True)]
    density = [
        np.full(len(layer.faces), -np.log1p(-min(layer.opacity, 0.999)), np.float32)
        for layer in layers
    ]
    return (
        np.concatenate(views),
        np.concatenate(faces).astype(np.int32),
        np.concatenate(normals),
        np.concatenate([layer.colors.astype(np.float32) for layer in layers]),
        np.concatenate(density),
    )


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
    from medialis.render._shading_kernels import shade

    balls, meshes, camera = _within_range(balls, meshes, camera)
    n = style.supersampling
    if max(camera.width, camera.height) * n > MAX_PIXELS:
        raise InvalidOptionError(
            f"A picture of {camera.width} x {camera.height} with supersampling {n} is larger than "
            f"{MAX_PIXELS} samples; use a smaller picture or supersampling."
        )
    fine = camera.resized(camera.width * n, camera.height * n)
    numbers = lens(fine)
    depth = np.full((fine.height, fine.width), np.inf)
    index = np.full(depth.shape, -1, np.int32)
    opaques = [layer for layer in meshes if layer.opacity >= 1]
    veils = [layer for layer in meshes if 0 < layer.opacity < 1]
    steps = Progress.of(progress)
    with steps.stage("balls", 0.0, 0.5):
        seen, tints = run_patiently(lambda: _balls_of(balls, fine, n), steps)
        draw_balls(seen, numbers, depth, index, steps)
    with steps.stage("triangles", 0.5, 0.7):
        solid, opaque = run_patiently(lambda: _mesh_of(opaques, fine, len(seen.radii)), steps)
        draw_mesh(opaque, numbers, depth, index, progress=steps)
    glass = np.zeros((0, 0, 4), np.float32)
    if any(len(layer.faces) for layer in veils):
        glass = np.zeros((*depth.shape, 4), np.float32)
        with steps.stage("see-through", 0.7, 0.9):
            veil, clear = run_patiently(lambda: _mesh_of(veils, fine, 0), steps)
            draw_mesh(clear, numbers, depth, index, glass=glass, mesh=veil, progress=steps)
    lamps = _LAMPS.copy()
    lamps[:, :3] /= np.linalg.norm(lamps[:, :3], axis=1, keepdims=True)
    material = np.array(
        [
            style.ambient,
            style.diffuse,
            style.specular,
            style.shadow,
            0.05 * camera.extent,
            0.0 if style.background is None else float(to_linear(style.background)),
        ]
    )
    picture = np.empty((camera.height, camera.width, 3 + (style.background is None)), np.uint8)

    def band(begin: int, end: int) -> None:
        shade(
            depth, index, glass, numbers, seen.view, seen.radii, tints, solid, lamps, material,
            begin, end, n, _encoding(), picture,
        )  # fmt: skip

    with steps.stage("light", 0.9, 1.0):
        run_chunks(band, camera.height, BAND, progress=steps)
    return picture
