"""Parts with rounded edges as meshes: extruded outlines whose corners are arcs of a few chords."""

import numpy as np


def rounded_corner(before, corner, after, radius, segments):
    """Places on the arc that rounds a corner of an outline, with both ends."""
    before, corner, after = (np.asarray(p, float) for p in (before, corner, after))
    if radius == 0:
        return corner[None]
    one = (before - corner) / np.linalg.norm(before - corner)
    two = (after - corner) / np.linalg.norm(after - corner)
    half = np.arccos(np.clip(one @ two, -1, 1)) / 2
    center = corner + (one + two) / np.linalg.norm(one + two) * radius / np.sin(half)
    start = corner + one * radius / np.tan(half) - center
    end = corner + two * radius / np.tan(half) - center
    turn = np.arctan2(start[0] * end[1] - start[1] * end[0], start @ end)
    angle = np.arctan2(start[1], start[0]) + turn * np.linspace(0, 1, segments + 1)
    return center + radius * np.column_stack([np.cos(angle), np.sin(angle)])


def rounded_outline(corners, radii, segments):
    """Outline (k, 2) with corners rounded by radii (0: sharp), each of so many chords."""
    count = len(corners)
    return np.concatenate([
        rounded_corner(corners[i - 1], corners[i], corners[(i + 1) % count], radii[i], segments)
        for i in range(count)
    ])  # fmt: skip


def _rectangle(width, height, radius, segments):
    x, y = width / 2, height / 2
    corners = [(x, -y), (x, y), (-x, y), (-x, -y)]
    return rounded_outline(corners, [radius] * 4, segments)


def hollow_section(width, height, thickness, radius, length, segments):
    """Mesh of a rectangular hollow section; `radius` of its outer corners, larger than the wall."""
    outer = _rectangle(width, height, radius, segments)
    wall = 2 * thickness
    inner = _rectangle(width - wall, height - wall, radius - thickness, segments)
    k = len(outer)
    rings = [(outer, 0.0), (inner, 0.0), (outer, length), (inner, length)]
    points = np.concatenate([np.column_stack([ring, np.full(k, z)]) for ring, z in rings])
    i = np.arange(k)
    j = (i + 1) % k
    quads = [
        (i, j, j + 2 * k, i + 2 * k),
        (j + k, i + k, i + 3 * k, j + 3 * k),
        (i + k, j + k, j, i),
        (j + 3 * k, i + 3 * k, i + 2 * k, j + 2 * k),
    ]
    faces = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return points, np.concatenate([np.column_stack(t) for t in faces]).astype(np.int32)


def tee(base, stem, width, height, fillet, length, segments, rim=0.0):
    """Mesh of a T: a plate with a stem on it, fillets between them, and rounded rims."""
    x, s = width / 2, stem / 2
    corners = [(-x, 0), (x, 0), (x, base), (s, base),
               (s, base + height), (-s, base + height), (-s, base), (-x, base)]  # fmt: skip
    radii = [rim, rim, rim, fillet, rim, rim, fillet, rim]
    from plates import extruded

    return extruded(rounded_outline(corners, radii, segments), length)
