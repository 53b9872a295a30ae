"""Assemblies of bodies that touch: plane, cylindrical, spherical and conical contacts.

What varies in the family: the kind of contact, whether both sides have the same facets, the gap or
overlap, the number of bodies, and their sizes. Each function returns closed bodies as
(points, faces).
"""

import numpy as np


def turned_profile(profile, around, turn=0.0):
    """Closed solid of revolution about z.

    A profile (k, 2) of radii and heights goes from axis to axis, or round in a ring.
    """
    profile = np.asarray(profile, float)
    angle = turn + 2 * np.pi * np.arange(around) / around
    rows, points, count = [], [], 0
    for radius, height in profile:
        if radius == 0.0:
            points.append([[0.0, 0.0, height]])
            rows.append(np.full(around, count))
        else:
            ring = [radius * np.cos(angle), radius * np.sin(angle), np.full(around, height)]
            points.append(np.stack(ring, axis=1))
            rows.append(count + np.arange(around))
        count += len(points[-1])
    faces = []
    steps = len(profile) if profile[0, 0] > 0 else len(profile) - 1
    for i in range(steps):
        low, high = rows[i], rows[(i + 1) % len(profile)]
        one, two = np.roll(low, -1), np.roll(high, -1)
        for corners in (np.stack([low, one, two], axis=1), np.stack([low, two, high], axis=1)):
            a, b, c = corners.T
            faces.append(corners[(a != b) & (b != c) & (c != a)])
    points, faces = np.concatenate(points), np.concatenate(faces)
    corners = points[faces] - points.mean(axis=0)
    volume = np.einsum("fa,fa->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    return points, np.ascontiguousarray(faces if volume > 0 else faces[:, ::-1], np.int32)


def block(size, center=(0.0, 0.0, 0.0)):
    points, faces = turned_profile([[0, -0.5], [1, -0.5], [1, 0.5], [0, 0.5]], 4, np.pi / 4)
    return points * [*np.multiply(size[:2], np.sqrt(0.5)), size[2]] + np.asarray(center), faces


def stack(rng, gap, count, alike):
    """Blocks on each other."""
    parts, top = [], 0.0
    for _ in range(count):
        height = rng.uniform(0.3, 1.0)
        size = (1.0, 1.0) if alike else rng.uniform(0.5, 1.5, 2)
        shift = (0.0, 0.0) if alike else rng.uniform(-0.2, 0.2, 2)
        parts.append(block((*size, height), (*shift, top + height / 2)))
        top += height + gap * max(1.5, 0.5 * count)
    return parts


def sleeves(rng, gap, count, alike):
    """A pin in rings round each other."""
    radius, parts = 0.3, [turned_profile([[0, 0], [0.3, 0], [0.3, 1], [0, 1]], 24)]
    for _ in range(count - 1):
        wide, height = rng.uniform(0.15, 0.4), 1.0 if alike else rng.uniform(0.3, 1.0)
        low, inner = rng.uniform(0, 1.0 - height) if height < 1 else 0.0, radius + 2 * gap
        radius = inner + wide
        ring = [[inner, low], [radius, low], [radius, low + height], [inner, low + height]]
        facets = 24 if alike else int(rng.integers(20, 40))
        parts.append(turned_profile(ring, facets, 0.0 if alike else rng.uniform(0, 1)))
    return parts


def socket(rng, gap, count, alike):
    """A ball in a socket."""
    angle = np.linspace(0, np.pi, 17)
    ball = np.stack([np.sin(angle), -np.cos(angle)], axis=1)
    ball[[0, -1], 0] = 0.0
    angle = np.linspace(0, np.pi / 2, 9 if alike else int(rng.integers(9, 14)))
    inner, wide = 1.0 + 3 * gap, rng.uniform(0.3, 0.6)
    cup = np.stack([inner * np.sin(angle), -inner * np.cos(angle)], axis=1)
    cup[0, 0] = 0.0
    outer = [[inner + wide, 0], [inner + wide, -inner - wide], [0, -inner - wide]]
    facets = 24 if alike else int(rng.integers(20, 36))
    profile = np.concatenate([cup, outer])
    return [turned_profile(ball, 24),
            turned_profile(profile, facets, 0.0 if alike else rng.uniform(0, 1))]  # fmt: skip


def plug(rng, gap, count, alike):
    """A cone in a ring."""
    slope, wide = rng.uniform(0.2, 0.5), rng.uniform(0.3, 0.6)
    far, top = 3 * gap * np.hypot(1, slope), 1.0 + 2 * slope
    ring = [[1 + far, 0], [top + wide, 0], [top + wide, 2], [top + far, 2]]
    facets = 24 if alike else int(rng.integers(20, 40))
    return [turned_profile([[0, 0], [1, 0], [top, 2], [0, 2]], 24),
            turned_profile(ring, facets, 0.0 if alike else rng.uniform(0, 1))]  # fmt: skip


KINDS = {"stack": stack, "sleeves": sleeves, "socket": socket, "plug": plug}

GAPS = (0.0, 1e-12, 1e-6, 1e-3, -1e-12, -1e-6, -1e-3)
"""Fractions of the size, roughly; negative ones are overlaps."""


def in_any_pose(parts, rng):
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    rotation *= np.sign(np.linalg.det(rotation))
    return [(points @ rotation.T, faces) for points, faces in parts]


def together(parts):
    """One mesh of all bodies: points and faces."""
    first = np.cumsum([0, *(len(points) for points, _ in parts)])[:-1]
    points = np.concatenate([points for points, _ in parts])
    faces = [faces + start for (_, faces), start in zip(parts, first, strict=True)]
    return points, np.concatenate(faces).astype(np.int32)
