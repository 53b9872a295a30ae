"""Solids of walls whose midsurface is known: extruded outlines, boxes, revolved curves."""

import numpy as np

from medialis.operations import registry
from medialis.shape.reading import make_shape


def _cross(a, b):
    return a[0] * b[1] - a[1] * b[0]


def ear_clipping(outline):
    """Triangles (rows of three) of a simple polygon (k, 2), counter-clockwise."""
    p, left, triangles = np.asarray(outline, float), list(range(len(outline))), []
    while len(left) > 3:
        best, which = -1.0, None
        for i in range(len(left)):
            a, b, c = left[i - 1], left[i], left[(i + 1) % len(left)]
            area = _cross(p[b] - p[a], p[c] - p[a])
            if area <= 1e-12:
                continue
            others = [q for q in left if q not in (a, b, c)]
            sides = np.array(
                [[_cross(p[v] - p[u], p[q] - p[u]) for u, v in ((a, b), (b, c), (c, a))]
                 for q in others]
            )  # fmt: skip
            if len(others) and (sides >= -1e-12).all(axis=1).any():
                continue
            longest = max(np.linalg.norm(p[u] - p[v]) for u, v in ((a, b), (b, c), (c, a)))
            if area / longest**2 > best:
                best, which = area / longest**2, i
        a, b, c = left[which - 1], left[which], left[(which + 1) % len(left)]
        triangles.append((a, b, c))
        left.pop(which)
    return np.array([*triangles, tuple(left)])


def extruded(outline, length, *, layers=1):
    """Mesh of a polygon (k, 2) in x, y, from z = 0 to `length`."""
    outline = np.asarray(outline, float)
    k, caps = len(outline), ear_clipping(outline)
    heights = np.linspace(0, length, layers + 1)
    points = np.concatenate([np.column_stack([outline, np.full(k, z)]) for z in heights])
    faces = [*caps[:, ::-1], *(caps + k * layers)]
    for level in range(layers):
        for i in range(k):
            a, b = level * k + i, level * k + (i + 1) % k
            faces += [(a, b, b + k), (a, b + k, a + k)]
    return points, np.array(faces, np.int32)


def grid_solid(planes, filled):
    """Mesh of the cells of a grid for which `filled` (a, b, c) is set; planes: three lists."""
    filled = np.pad(np.asarray(filled, bool), 1)
    found, ids, quads = [], {}, []

    def point(key):
        if key not in ids:
            ids[key] = len(found)
            found.append([planes[d][key[d]] for d in range(3)])
        return ids[key]

    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        step = np.diff(filled.astype(np.int8), axis=axis)
        for cell in np.argwhere(step):
            key = [int(x) - 1 for x in cell]
            key[axis] += 1
            corners = []
            for du, dv in ((0, 0), (1, 0), (1, 1), (0, 1)):
                corner = list(key)
                corner[u] += du
                corner[v] += dv
                corners.append(point(tuple(corner)))
            quads.append(corners if step[tuple(cell)] < 0 else corners[::-1])
    faces = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return np.array(found, float), np.array(faces, np.int32)


def boxes(*given):
    """Mesh of the union of boxes (x0, x1, y0, y1, z0, z1)."""
    given = np.array(given, float)
    planes = [np.unique(given[:, 2 * d : 2 * d + 2]) for d in range(3)]
    middles = np.meshgrid(*[(p[1:] + p[:-1]) / 2 for p in planes], indexing="ij")
    filled = np.zeros(middles[0].shape, bool)
    for box in given:
        inside = [(m > box[2 * d]) & (m < box[2 * d + 1]) for d, m in enumerate(middles)]
        filled |= inside[0] & inside[1] & inside[2]
    return grid_solid(planes, filled)


def revolved(outline, around):
    """Mesh of a closed polygon (k, 2) of radius and height turned round the z axis."""
    outline = np.asarray(outline, float)
    k = len(outline)
    angles = 2 * np.pi * np.arange(around) / around
    points = np.concatenate(
        [
            np.column_stack([outline[:, 0] * np.cos(t), outline[:, 0] * np.sin(t), outline[:, 1]])
            for t in angles
        ]
    )
    faces = []
    for turn in range(around):
        here, there = k * turn, k * ((turn + 1) % around)
        for i in range(k):
            j = (i + 1) % k
            faces += [
                (here + i, there + i, there + j),
                (here + i, there + j, here + j),
            ]
    faces = np.array(faces, np.int32)
    a, b, c = (points[faces[:, j]] for j in range(3))
    inside_out = np.einsum("ij,ij->", a, np.cross(b, c)) < 0
    return points, faces[:, ::-1].copy() if inside_out else faces


def sphere(radius, levels):
    """Mesh of a sphere: an octahedron halved so often."""
    points = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
    faces = [(x, y, z) if x % 2 ^ y % 2 ^ z % 2 == 0 else (x, z, y)
             for x in (0, 1) for y in (2, 3) for z in (4, 5)]  # fmt: skip
    faces = np.array(faces)
    for _ in range(levels):
        edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        unique, which = np.unique(edges, axis=0, return_inverse=True)
        middle = len(points) + which.reshape(-1, 3)
        points = np.concatenate([points, points[unique].mean(axis=1)])
        a, b, c = faces.T
        ab, bc, ca = middle.T
        faces = np.concatenate(
            [np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
        )
    return radius * points / np.linalg.norm(points, axis=1, keepdims=True), faces.astype(np.int32)


def wall(curve, thickness):
    """Outline of a wall along an open curve (k, 2): half the thickness to both sides."""
    curve = np.asarray(curve, float)
    along = np.diff(curve, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    left = np.column_stack([-along[:, 1], along[:, 0]])
    side = np.concatenate([left[:1], left[:-1] + left[1:], left[-1:]])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    cosine = np.einsum("ij,ij->i", side, np.concatenate([left, left[-1:]]))
    offset = side * (thickness / 2 / cosine)[:, None]
    return np.concatenate([curve - offset, (curve + offset)[::-1]])


def i_beam(length=300.0, width=80.0, height=80.0, web=15.0, flange=10.0):
    w, h, s, t = width / 2, height / 2, web / 2, flange
    right = [(w, -h), (w, -h + t), (s, -h + t), (s, h - t), (w, h - t), (w, h)]
    return extruded([*right, *[(-x, y) for x, y in right[::-1]]], length)


def tee(length=60.0, width=50.0, height=40.0, web=4.0, flange=4.0):
    w, s = width / 2, web / 2
    outline = [(-s, 0), (s, 0), (s, height), (w, height), (w, height + flange),
               (-w, height + flange), (-w, height), (-s, height)]  # fmt: skip
    return extruded(outline, length)


def cross(length=60.0, arm=30.0, thickness=4.0):
    s, a = thickness / 2, arm
    corner = [(a, -s), (a, s), (s, s), (s, a), (-s, a), (-s, s), (-a, s), (-a, -s), (-s, -s),
              (-s, -a), (s, -a), (s, -s)]  # fmt: skip
    return extruded(corner, length)


def step(length=60.0, thin=4.0, thick=6.0):
    return extruded([(-50, 0), (50, 0), (50, thick), (0, thick), (0, thin), (-50, thin)], length)


def angle_plate(length=60.0, thickness=4.0):
    t = thickness
    return extruded([(0, 0), (50, 0), (50, t), (t, t), (t, 40), (0, 40)], length)


def bracket(ribs=4, thickness=4.0, rib=3.0):
    """A base and a back plate at right angles, with upright ribs between them."""
    t, length = thickness, 120.0
    at = np.linspace(15, length - 15, ribs)
    parts = [(0, length, 0, 60, 0, t), (0, length, 0, t, 0, 70)]
    parts += [(x - rib / 2, x + rib / 2, t, 45, t, 50) for x in at]
    return boxes(*parts)


def open_box(size=(100.0, 80.0, 50.0), thickness=3.0):
    """A box without its top."""
    x, y, z = size
    t = thickness
    return boxes((0, x, 0, y, 0, t), (0, t, 0, y, 0, z), (x - t, x, 0, y, 0, z),
                 (0, x, 0, t, 0, z), (0, x, y - t, y, 0, z))  # fmt: skip


def sphere_shell(outer=50.0, inner=46.0, levels=5):
    p, f = sphere(outer, levels)
    q, g = sphere(inner, levels)
    return np.concatenate([p, q]), np.concatenate([f, g[:, ::-1] + len(p)])


def cone_shell(thickness=4.0, around=96, rows=24, low=(30.0, 0.0), high=(50.0, 60.0)):
    """Frustum between two radii and heights in the middle, `thickness` across the wall."""
    low, high = np.array(low), np.array(high)
    slope = high - low
    normal = np.array([slope[1], -slope[0]]) / np.linalg.norm(slope)
    line = low + np.linspace(0, 1, rows + 1)[:, None] * (high - low)
    outline = [*(line + normal * thickness / 2), *(line - normal * thickness / 2)[::-1]]
    return revolved(outline, around)


def bent_sheet(thickness=3.0, radius=20.0, steps=24, layers=20):
    """Two flat legs at right angles, joined by a quarter of a cylinder."""
    turn = np.linspace(0, np.pi / 2, steps + 1)
    bend = np.column_stack([radius * np.sin(turn), radius - radius * np.cos(turn)])
    curve = [(-40.0, 0.0), *bend, (radius, radius + 40.0)]
    return extruded(wall(curve, thickness), 60.0, layers=layers)


def wave(x):
    return np.column_stack([x, 6 * np.sin(2 * np.pi * x / 40)])


def corrugated(thickness=2.0, waves=3, steps=48, width=80.0):
    x = np.linspace(0, waves * 40.0, waves * steps + 1)
    return extruded(wall(wave(x), thickness), width)


def shape_of(mesh):
    return make_shape(*mesh)


def with_walls(operation, shape):
    """The shape, or one with walls for an operation by name whose sample is no creature."""
    return shape if registry.operation(operation).sample == "creature" else shape_of(tee())


def pipe_tee(cell=1.0, *, main=20.0, branch=12.0, thickness=4.0, half_length=50.0, height=45.0):
    """A pipe along x with a branch upwards, by a field of distances; radii are those in the middle.

    Vertices lie on the cylinders and planes, those next to an edge near it.
    """
    from bodies import meshed

    t = thickness / 2

    def field(p):
        x, y, z = p[..., 0], p[..., 1], p[..., 2]
        along, upward = np.hypot(y, z), np.hypot(x, y)
        outer = np.minimum(along - main - t, np.maximum(upward - branch - t, -z))
        inner = np.minimum(along - main + t, np.maximum(upward - branch + t, -z))
        ends = np.maximum(np.abs(x) - half_length, z - height)
        return np.maximum(np.maximum(outer, -inner), ends)

    low = np.array([-half_length, -main - t, -main - t])
    found = meshed(field, low, np.array([half_length, main + t, height]), cell)
    return found.points, np.asarray(found.faces)


def irregular(mesh, longest, seed=0):
    """The same solid with points strewn into its faces: slivers of all sizes beside large ones."""
    rng = np.random.default_rng(seed)
    points, faces = mesh
    points, faces = list(map(np.asarray, points)), [tuple(f) for f in np.asarray(faces).tolist()]
    result = []
    while faces:
        a, b, c = faces.pop()
        corners = np.array([points[a], points[b], points[c]])
        area = np.linalg.norm(np.cross(corners[1] - corners[0], corners[2] - corners[0])) / 2
        if area < longest**2 * rng.uniform(0.2, 3.0):
            result.append((a, b, c))
            continue
        weights = rng.dirichlet([2.0, 2.0, 2.0])
        points.append(weights @ corners)
        d = len(points) - 1
        faces += [(a, b, d), (b, c, d), (c, a, d)]
    return np.array(points), np.array(result, np.int32)
