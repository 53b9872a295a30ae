"""What a camera makes of balls and triangles before they are drawn: pixel boxes, near clipping."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from medialis.render.camera import Camera
from medialis.validation import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class BallSet:
    """Balls seen by one camera: view-space centers, drawn radii, pixel boxes."""

    view: FloatArray
    radii: FloatArray
    boxes: IntArray


@dataclass(frozen=True, eq=False)
class TriangleSet:
    """Triangles seen by one camera, clipped at the near plane; piece i belongs to face names[i]."""

    screen: FloatArray
    corners: IntArray
    names: IntArray


def lens(camera: Camera, sign: float = 1.0) -> FloatArray:
    """Return the camera as the six numbers that the kernels read."""
    focal = camera.scale * camera.distance if camera.perspective else 0.0
    near = camera.near if camera.perspective else 0.0
    return np.array([camera.scale, camera.width / 2, camera.height / 2, focal, near, sign])


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
    camera: Camera, centers: FloatArray, radii: FloatArray, smallest: float | FloatArray = 0.0
) -> BallSet:
    """Project balls; one smaller than `smallest` pixels on screen is drawn with that radius."""
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
    return BallSet(np.ascontiguousarray(view), np.ascontiguousarray(drawn), boxes)


def see_triangles(camera: Camera, view: FloatArray, faces: IntArray, base: int = 0) -> TriangleSet:
    """Project triangles given in view space; face f is named base + f in the index buffer."""
    names = np.arange(base, base + len(faces), dtype=np.int32)
    if not camera.perspective:
        screen = np.empty_like(view)
        screen[:, 0] = camera.width / 2 + camera.scale * view[:, 0]
        screen[:, 1] = camera.height / 2 - camera.scale * view[:, 1]
        screen[:, 2] = view[:, 2]
        return TriangleSet(screen, faces, names)
    view, faces, names = _clip(view, faces, names, camera.near)
    inverse = 1.0 / np.maximum(view[:, 2], camera.near)
    focal = camera.scale * camera.distance
    screen = np.empty_like(view)
    screen[:, 0] = camera.width / 2 + focal * view[:, 0] * inverse
    screen[:, 1] = camera.height / 2 - focal * view[:, 1] * inverse
    screen[:, 2] = inverse
    return TriangleSet(screen, faces, names)


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
