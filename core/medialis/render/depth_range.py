"""The core's view source: silhouettes and depths of a mesh or a point cloud (thesis 3.7.4.2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from medialis.errors import InvalidShapeError
from medialis.kept import Described
from medialis.model.shape import Shape
from medialis.model.view import OrthographicCamera, View
from medialis.progress import Progress
from medialis.surface.given_shapes import ShapeLike, as_shape
from medialis.threads import run_chunks
from medialis.validation import FloatArray, IntArray

DISC_NEIGHBOUR = 12
"""The radius of the disc of a sample is the distance to its neighbour of this rank: discs overlap,
also where samples are irregular (checked on random samples of a sphere and a torus)."""


@dataclass(frozen=True, eq=False, repr=False)
class Rasterizer(Described):
    """Renders the views of triangles, in parallel over views.

    Attributes
    ----------
    points : (n, 3) float64
    faces : (m, 3) int32

    Notes
    -----
    Every pixel whose center a triangle covers belongs to the silhouette; depth is exact up to
    float32. Source: thesis 3.7.4.2 (depth buffers by GL_LESS and GL_GREATER); both in one pass.
    """

    points: FloatArray
    faces: IntArray

    def __call__(
        self, cameras: Sequence[OrthographicCamera], progress: Progress | None = None
    ) -> list[View]:
        """Return the view of each camera."""
        from medialis.render._depth_range_kernels import (
            draw_depth_range,
            mark_outside,
            project_points,
        )

        views: list[View] = [None] * len(cameras)  # type: ignore[list-item]

        def draw(begin: int, end: int) -> None:
            screen = np.empty((len(self.points), 3))
            for at in range(begin, end):
                camera = cameras[at]
                near = np.full((camera.size, camera.size), np.inf, np.float32)
                far = np.full_like(near, -np.inf)
                project_points(
                    self.points, camera.center, camera.axes, camera.size, camera.pixel, screen
                )
                draw_depth_range(self.faces, screen, near, far)
                mark_outside(near, far)
                views[at] = View(camera, near, far)

        run_chunks(draw, len(cameras), 1, progress=progress)
        return views


def rasterizer(shape: ShapeLike) -> Rasterizer:
    """Return the view source of a shape.

    A mesh is drawn as it is. Each sample of a point cloud becomes a hexagon in its tangent plane,
    as wide as covers the gaps to its neighbours.

    Parameters
    ----------
    shape : Shape

    Raises
    ------
    InvalidShapeError
        For a point cloud without normals, or with fewer than 9 samples.

    See Also
    --------
    view_curve_skeleton : what the views are for.
    view_source : sets another renderer.

    Examples
    --------
    >>> import medialis
    >>> source = medialis.rasterizer(medialis.organic_shape(56))
    >>> callable(source)
    True
    """
    shape = as_shape(shape)
    if shape.faces is not None:
        return Rasterizer(shape.points, shape.faces)
    return _discs(shape)


def _discs(shape: Shape) -> Rasterizer:
    """Hexagons round the samples that have a normal."""
    has_normal = shape.normals.any(axis=1)
    if has_normal.sum() <= DISC_NEIGHBOUR:
        raise InvalidShapeError(
            f"Views of a point cloud need more than {DISC_NEIGHBOUR} samples with normals, got "
            f"{int(has_normal.sum())}: estimate normals first (medialis.make_shape does)."
        )
    points, normals = shape.points[has_normal], shape.normals[has_normal]
    radius = shape.tree.query(points, k=DISC_NEIGHBOUR + 1)[0][:, -1:]
    # An isolated sample must not become a plate: no disc is larger than four usual ones.
    radius = np.minimum(radius, 4 * np.median(radius))
    least = np.eye(3)[np.abs(normals).argmin(axis=1)]
    across = np.cross(normals, least)
    across *= radius / np.linalg.norm(across, axis=1, keepdims=True)
    along = np.cross(normals, across)
    turns = np.pi / 3 * np.arange(6)
    corners = (
        points[:, None]
        + np.cos(turns)[:, None] * across[:, None]
        + np.sin(turns)[:, None] * along[:, None]
    )
    fan = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]])
    faces = (6 * np.arange(len(points))[:, None, None] + fan).reshape(-1, 3)
    return Rasterizer(np.ascontiguousarray(corners.reshape(-1, 3)), faces.astype(np.int32))
