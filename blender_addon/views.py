# SPDX-License-Identifier: GPL-3.0-or-later
"""Views of a shape rendered by Blender's gpu module: the host's view source (thesis 3.7.4.2).

Depth only: one draw keeps the nearest, one the furthest surface. It needs no window and no scene.
The process that computes asks for them through its `Computation`. Where the gpu module cannot draw,
the core's rasterizer takes over, and a message says so.
"""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np
from numpy.typing import NDArray

from medialis import OrthographicCamera, View

VERTEX = "void main() { gl_Position = mvp * vec4(pos, 1.0); }"
FRAGMENT = "void main() {}"

_why_not: str | None = None
_tried = False


def why_no_gpu() -> str | None:
    """Return None when the gpu module can draw, otherwise the reason; tried once a session."""
    global _tried, _why_not
    if not _tried:
        _tried = True
        try:
            _start_gpu()
            _why_not = _trial()
        except Exception as error:  # noqa: BLE001 - drivers raise anything
            _why_not = str(error) or type(error).__name__
    return _why_not


def chosen(views_by: str) -> bool:
    """Return whether the gpu module shall render the views: "GPU", "CPU" or "AUTO".

    In a window with software graphics the core's rasterizer is faster. Without a window Blender is
    asked, and the rasterizer takes over where it cannot draw.
    """
    if views_by != "AUTO":
        return views_by == "GPU"
    if bpy.app.background:
        return True
    import gpu

    return gpu.platform.device_type_get() != "SOFTWARE"


def _start_gpu() -> None:
    """Make a graphics context where there is no window."""
    import gpu

    if not bpy.app.background:
        return
    if hasattr(gpu, "init"):  # Blender 5.2
        gpu.init()
        return
    # Before, the module works after one render of the Workbench engine, however small.
    images = set(bpy.data.images)
    scene = bpy.data.scenes.new("medialis views")
    camera = bpy.data.cameras.new("medialis views")
    eye = bpy.data.objects.new("medialis views", camera)
    try:
        scene.render.engine = "BLENDER_WORKBENCH"
        scene.render.resolution_x = scene.render.resolution_y = 4
        scene.render.resolution_percentage = 100
        scene.collection.objects.link(eye)
        scene.camera = eye
        bpy.ops.render.render(scene=scene.name)
    finally:
        bpy.data.objects.remove(eye)
        bpy.data.cameras.remove(camera)
        bpy.data.scenes.remove(scene)
        for image in set(bpy.data.images) - images:  # what a render leaves
            bpy.data.images.remove(image)


def _trial() -> str | None:
    """Draw a square and look at it."""
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0.5], [-1, 1, 0.5]], float)
    camera = OrthographicCamera([0, 0, 0], np.diag([1.0, 1.0, -1.0]), 4.0, 8)
    view = GpuViews(corners, np.array([[0, 1, 2], [0, 2, 3]]))([camera])[0]
    inside = np.zeros((8, 8), bool)
    inside[2:6, 2:6] = True
    right = (view.mask == inside).all() and abs(float(view.near[5, 3]) + 0.0625) < 1e-3
    return None if right else "a trial picture came out wrong"


class GpuViews:
    """Renders views of triangles; to be called on the main thread only.

    Parameters
    ----------
    points : (n, 3) float
    faces : (m, 3) int
    """

    def __init__(self, points: NDArray[np.float64], faces: NDArray[np.int32]) -> None:
        import gpu
        from gpu_extras.batch import batch_for_shader

        # Coordinates relative to a point of the shape keep their digits in float32.
        self._origin = np.array(points[0])
        local = points - self._origin
        self._reach = float(np.sqrt((local**2).sum(axis=1).max()))
        info = gpu.types.GPUShaderCreateInfo()
        info.vertex_in(0, "VEC3", "pos")
        info.push_constant("MAT4", "mvp")
        info.vertex_source(VERTEX)
        info.fragment_source(FRAGMENT)
        self._shader = gpu.shader.create_from_info(info)
        self._batch = batch_for_shader(
            self._shader,
            "TRIS",
            {"pos": np.ascontiguousarray(local, np.float32)},
            indices=np.ascontiguousarray(faces, np.int32),
        )
        self._target: tuple[int, object, object] | None = None

    def __call__(self, cameras: Sequence[OrthographicCamera]) -> list[View]:
        """Return the view of each camera."""
        return [self._view(camera) for camera in cameras]

    def _view(self, camera: OrthographicCamera) -> View:
        offset = camera.axes @ (self._origin - camera.center)
        half = 1.001 * (self._reach + float(np.linalg.norm(offset))) or 1.0
        scale = np.array([2 / camera.extent, 2 / camera.extent, 1 / half])
        matrix = np.eye(4)
        matrix[:3, :3] = scale[:, None] * camera.axes
        matrix[:3, 3] = scale * offset
        near = self._draw(camera.size, matrix, "LESS_EQUAL", 1.0)
        far = self._draw(camera.size, matrix, "GREATER_EQUAL", 0.0)
        near[near == 1.0] = np.nan
        far[np.isnan(near)] = np.nan
        near, far = ((2 * z - 1) * np.float32(half) for z in (near, far))
        return View(camera, near, np.maximum(near, far))

    def _draw(
        self, size: int, matrix: NDArray[np.float64], test: str, clear: float
    ) -> NDArray[np.float32]:
        """Return the depth buffer, top row first."""
        import gpu
        from mathutils import Matrix

        if self._target is None or self._target[0] != size:
            depth = gpu.types.GPUTexture((size, size), format="DEPTH_COMPONENT32F")
            # The framebuffer does not keep its texture alive.
            self._target = size, gpu.types.GPUFrameBuffer(depth_slot=depth), depth
        target = self._target[1]
        try:
            with target.bind():
                gpu.state.viewport_set(0, 0, size, size)
                target.clear(depth=clear)
                gpu.state.depth_test_set(test)
                gpu.state.depth_mask_set(True)
                self._shader.bind()
                self._shader.uniform_float("mvp", Matrix(matrix.tolist()))
                self._batch.draw(self._shader)
                seen = target.read_depth(0, 0, size, size)
        finally:
            gpu.state.depth_test_set("NONE")
        seen.dimensions = size * size  # 4.5 gives wrong strides for two dimensions
        return np.frombuffer(seen, np.float32).reshape(size, size)[::-1].copy()


def render_views(
    points: NDArray[np.float64], faces: NDArray[np.int32], cameras: Sequence[OrthographicCamera]
) -> list[View]:
    """Render views of triangles once; for many calls keep a `GpuViews`."""
    return GpuViews(points, faces)(cameras)


def renderer(points: NDArray[np.float64], faces: NDArray[np.int32]) -> GpuViews | str:
    """Return the view source of triangles, or a sentence that says why Blender cannot render."""
    reason = why_no_gpu()
    if reason is not None:
        return f"Blender cannot render views here ({reason}): the core's rasterizer does."
    return GpuViews(points, faces)
