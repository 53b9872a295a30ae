"""Bodies of blended capsules and machine parts: shapes whose limbs, ends and loops are known."""

import numpy as np

from medialis.shape.generate import make_unambiguous, surface_nets
from medialis.shape.normals import vertex_normals
from medialis.shape.shape import Shape


def meshed(field, low, high, cell):
    """Zero level of a signed distance (nearly), with the cell of its grid as spacing."""
    low = np.asarray(low, float) - 2.31 * cell
    count = np.ceil((np.asarray(high) + 2.4 * cell - low) / cell).astype(int)
    axes = [low[k] + cell * np.arange(count[k] + 1) for k in range(3)]
    values = np.stack(
        [field(np.stack(np.meshgrid([x], *axes[1:], indexing="ij"), axis=-1)[0]) for x in axes[0]]
    )
    make_unambiguous(values)
    points, faces = surface_nets(values, low, cell)
    step = 1e-4 * cell * np.eye(3)
    for _ in range(3):
        slope = np.stack([field(points + h) - field(points - h) for h in step], axis=1)
        slope /= 2e-4 * cell
        off = np.clip(field(points) / np.maximum((slope**2).sum(1), 0.25), -cell / 2, cell / 2)
        points = points - off[:, None] * slope
    return Shape(points, vertex_normals(points, faces), faces)


def capsule(at, a, b, radius, end=None):
    """Distance to a capsule from a to b whose radius goes from `radius` to `end`."""
    a, d = np.asarray(a, float), np.asarray(b, float) - np.asarray(a, float)
    t = np.clip((at - a) @ d / (d @ d), 0, 1)
    thick = radius + ((radius if end is None else end) - radius) * t
    return np.linalg.norm(at - a - t[..., None] * d, axis=-1) - thick


def rounded_box(at, center, half, fillet):
    d = np.abs(at - np.asarray(center)) - np.asarray(half) + fillet
    return np.linalg.norm(np.maximum(d, 0), axis=-1) + np.minimum(d.max(-1), 0) - fillet


def rod(at, center, radius, half, axis=2, fillet=0.02):
    """Distance to a cylinder along an axis, with a fillet at its rims."""
    at = at - np.asarray(center, float)
    away = np.linalg.norm(np.delete(at, axis, axis=-1), axis=-1) - radius + fillet
    d = np.stack([away, np.abs(at[..., axis]) - half + fillet], axis=-1)
    return np.linalg.norm(np.maximum(d, 0), axis=-1) + np.minimum(d.max(-1), 0) - fillet


def joined(distances, blend):
    """Union whose seams are rounded by about `blend`."""
    distances = np.stack(distances)
    least = distances.min(axis=0)
    return least - blend * np.log(np.exp((least - distances) / blend).sum(axis=0))


def without(body, hole, blend=0.01):
    return -joined([-body, hole], blend)


def blended(parts, blend, cell):
    """Mesh of capsules (a, b, radius, end)."""
    low = np.min([np.minimum(a, b) - max(r, e) for a, b, r, e in parts], axis=0)
    high = np.max([np.maximum(a, b) + max(r, e) for a, b, r, e in parts], axis=0)
    return meshed(lambda at: joined([capsule(at, *p) for p in parts], blend), low, high, cell)
