"""Shapes whose medial axis is known in closed form, and what the sampling allows of the answer."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import Delaunay, cKDTree

from medialis.shape.normals import vertex_normals
from medialis.shape.refinement import refine
from medialis.shape.shape import Shape


@dataclass(frozen=True)
class ClosedForm:
    """A shape with the true ball of every sample.

    `contacts` is a true second contact of each ball (of many, the one farthest from the sample).
    `bend` is the largest curvature with which the surface bends away from the balls (0 if convex).
    """

    shape: Shape
    centers: np.ndarray
    radii: np.ndarray
    contacts: np.ndarray
    bend: float = 0.0

    def excess(self, tolerance=0.0):
        """Bound of radius minus true radius for each sample; inf where the sampling says nothing.

        The samples lie on the true surface, outside the true ball (c, r), so the radius is never
        too small. Let q be the sample nearest to the true contact f, at distance e. With m the
        unit vector from c to f, q lies at most k e^2/2 above the tangent plane at f, where k is the
        curvature away from the ball (1 + k^2 e^2/8 covers the third and fourth order of a curve of
        curvature k, for k e < 1), so |q - c|^2 = r^2 + 2 r m.(q - f) + e^2 gives
        h = |q - c| - r <= e^2 (1/r + k)/2. Seen from c, q and f are at most asin(e/r) apart, so
        g = angle p-c-q >= theta - asin(e/r). No sample lies deeper than T in the ball found:
        |q - c + d n| >= r + d - T for a radius that is larger by d. Squared and solved for d,

            d <= (2 r h + h^2 + 2 T r - T^2) / (2 (r - (r + h) cos g - T)),

        while the denominator is positive. Only samples with e < 0.3 r are judged.
        """
        p, r, t = self.shape.points, self.radii, tolerance * self.shape.diagonal
        e = cKDTree(p).query(self.contacts)[0]
        bend = self.bend * (1 + (self.bend * e) ** 2 / 8)
        h = e**2 * (1 / r + bend) / 2
        a, b = (p - self.centers) / r[:, None], (self.contacts - self.centers) / r[:, None]
        theta = np.arccos(np.clip((a * b).sum(1), -1, 1))
        near = np.maximum(theta - np.arcsin(np.minimum(e / r, 1)), 0)
        bottom = 2 * (r - (r + h) * np.cos(near) - t)
        bound = np.full(len(r), np.inf)
        judged = (bottom > 0) & (e < 0.3 * r) & (self.bend * e < 1)
        top = 2 * r * h + h**2 + 2 * t * r - t**2
        bound[judged] = top[judged] / bottom[judged]
        return bound


def unit(vectors):
    """Rows divided by their lengths."""
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def fibonacci(n):
    """n directions spread evenly over the sphere."""
    z = 1 - (2 * np.arange(n) + 1) / n
    turn = np.arange(n) * math.pi * (3 - math.sqrt(5))
    s = np.sqrt(1 - z * z)
    return np.stack([s * np.cos(turn), s * np.sin(turn), z], axis=1)


def random_directions(n, seed=0):
    """n random directions, uniform on the sphere."""
    return unit(np.random.default_rng(seed).normal(size=(n, 3)))


def sphere(n=1000, radius=1.0, seed=None):
    """All balls are the sphere itself."""
    u = fibonacci(n) if seed is None else random_directions(n, seed)
    return ClosedForm(
        Shape(radius * u, u), np.zeros((n, 3)), np.full(n, float(radius)), -radius * u
    )


def ellipsoid(n=1000, axes=(1.0, 0.8, 0.5), mirrored=True):
    """Axes a >= b > c; the second contact of (x, y, z) is (x, y, -z).

    The normal is g/|g| with g = (x/a^2, y/b^2, z/c^2); following it inward by r = c^2 |g| leads to
    z = 0 and to (x (1 - c^2/a^2), y (1 - c^2/b^2), 0). `mirrored`: the samples contain every
    second contact, bit for bit.
    """
    axes = np.array(axes)
    u = fibonacci(n)
    if mirrored:
        u = u[u[:, 2] > 0]
        u = np.concatenate([u, u * [1, 1, -1]])
    p = u * axes
    g = p / axes**2
    c2 = axes[2] ** 2
    return ClosedForm(
        Shape(p, unit(g)),
        p * (1 - c2 / axes**2),
        c2 * np.linalg.norm(g, axis=1),
        p * [1.0, 1.0, -1.0],
    )


def oblate_spheroid(n=1000, a=1.0, c=0.5):
    """The axis is a disc of radius (a^2 - c^2)/a."""
    return ellipsoid(n, (a, a, c), mirrored=False)


def torus(around=120, across=41, major=1.0, minor=0.3):
    """The axis is the circle of radius `major`; every ball touches all of its tube circle.

    An odd number across: no sample lies opposite to another.
    """
    u, v = np.meshgrid(
        2 * np.pi * np.arange(around) / around, 2 * np.pi * np.arange(across) / across
    )
    u, v = u.ravel() + np.pi / around * (np.arange(u.size) // around % 2), v.ravel()
    ring = np.stack([np.cos(u), np.sin(u), 0 * u], axis=1)
    normals = np.cos(v)[:, None] * ring + np.sin(v)[:, None] * [0, 0, 1.0]
    centers = major * ring
    # The tube bends away from the ball only along the inner equator, at most by 1/(R - r).
    return ClosedForm(
        Shape(centers + minor * normals, normals),
        centers,
        np.full(u.size, minor),
        centers - minor * normals,
        1 / (major - minor),
    )


def capsule(n=2000, half_length=1.0, radius=0.4, seed=0):
    """Points at `radius` from the segment x = -half_length..half_length, which is the axis."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(-half_length, half_length, n)
    turn = rng.uniform(0, 2 * np.pi, n)
    tube = np.stack([0 * turn, np.cos(turn), np.sin(turn)], axis=1)
    cap = fibonacci(n // 2)
    ends = np.where(cap[:, :1] < 0, -1, 1) * [half_length, 0, 0]
    # The end balls touch their whole half sphere: the point of its rim opposite to p is farthest.
    across = cap * [0, 1, 1]
    size = np.linalg.norm(across, axis=1, keepdims=True)
    across = np.where(size > 1e-9, across / np.maximum(size, 1e-9), [0, 1.0, 0])
    normals = np.concatenate([tube, cap])
    centers = np.concatenate([x[:, None] * [1, 0, 0], ends])
    contacts = centers - radius * np.concatenate([tube, across])
    return ClosedForm(
        Shape(centers + radius * normals, normals), centers, np.full(len(normals), radius), contacts
    )


def box_samples(size=(1.0, 0.8, 0.6), spacing=0.04):
    """Samples inside the faces of a box (none on an edge), centered at the origin.

    A ball on a face grows until it meets the nearest adjacent face at distance d (a contact at a
    right angle) or the opposite face (straight across): r = min(d, height/2).
    """
    size = np.array(size)
    points, normals, radii, contacts = [], [], [], []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        grids = []
        for other in (u, v):
            count = round(size[other] / spacing) + axis  # adjacent faces do not match
            grids.append(((np.arange(count) + 0.5) / count - 0.5) * size[other])
        a, b = (g.ravel() for g in np.meshgrid(*grids))
        for sign in (-1.0, 1.0):
            p, n, w = np.zeros((len(a), 3)), np.zeros((len(a), 3)), np.zeros((len(a), 3))
            p[:, u], p[:, v], p[:, axis] = a, b, sign * size[axis] / 2
            n[:, axis] = sign
            gap_u, gap_v = size[u] / 2 - np.abs(a), size[v] / 2 - np.abs(b)
            r = np.minimum(np.minimum(gap_u, gap_v), size[axis] / 2)
            first = gap_u <= gap_v
            w[first, u], w[~first, v] = np.sign(a[first]), np.sign(b[~first])
            w[r >= size[axis] / 2] = -n[0]
            points.append(p)
            normals.append(n)
            radii.append(r)
            contacts.append(p - r[:, None] * n + r[:, None] * w)
    p, n, r = np.concatenate(points), np.concatenate(normals), np.concatenate(radii)
    return ClosedForm(Shape(p, n), p - r[:, None] * n, r, np.concatenate(contacts))


def mesh(points, faces):
    """A Shape with angle-weighted normals."""
    points = np.asarray(points, float)
    return Shape(points, vertex_normals(points, faces), faces)


def refined(shape, longest_edge):
    """A mesh without longer edges: an absolute length."""
    return refine(shape, longest_edge=min(longest_edge / shape.diagonal, 1.0))


def cube():
    """The cube -1..1: 8 vertices, 12 outward triangles."""
    points = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return mesh(points, [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])


def box_mesh(size=(1.0, 0.8, 0.6), longest_edge=0.1):
    """A box of 12 triangles, refined."""
    return refined(mesh(cube().points * np.array(size) / 2, cube().faces), longest_edge)


def icosphere(levels=3):
    """A unit sphere mesh of 20 * 4^levels triangles, exact normals."""
    g = (1 + math.sqrt(5)) / 2
    points = unit(
        np.array(
            [
                [-1, g, 0], [1, g, 0], [-1, -g, 0], [1, -g, 0], [0, -1, g], [0, 1, g],
                [0, -1, -g], [0, 1, -g], [g, 0, -1], [g, 0, 1], [-g, 0, -1], [-g, 0, 1],
            ]
        )
    )  # fmt: skip
    faces = np.array(
        [
            [0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11], [1, 5, 9], [5, 11, 4],
            [11, 10, 2], [10, 7, 6], [7, 1, 8], [3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8],
            [3, 8, 9], [4, 9, 5], [2, 4, 11], [6, 2, 10], [8, 6, 7], [9, 8, 1],
        ]
    )  # fmt: skip
    for _ in range(levels):
        half = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        pairs, where = np.unique(half, axis=0, return_inverse=True)
        ab, bc, ca = (len(points) + where.reshape(-1, 3)).T
        points = np.concatenate([points, unit(points[pairs].mean(axis=1))])
        a, b, c = faces.T
        rows = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        faces = np.concatenate([np.stack(row, axis=1) for row in rows])
    return Shape(points, points, faces)


def torus_mesh(around=48, across=24, major=1.0, minor=0.3):
    """A closed mesh of genus 1 on the torus, exact normals."""
    i, j = (g.ravel() for g in np.meshgrid(np.arange(around), np.arange(across), indexing="ij"))
    u, v = 2 * np.pi * i / around, 2 * np.pi * j / across
    ring = np.stack([np.cos(u), np.sin(u), 0 * u], axis=1)
    normals = np.cos(v)[:, None] * ring + np.sin(v)[:, None] * [0, 0, 1.0]
    here = i * across + j
    ahead = (i + 1) % around * across + j
    side, corner = i * across + (j + 1) % across, (i + 1) % around * across + (j + 1) % across
    faces = np.concatenate(
        [np.stack([here, ahead, corner], axis=1), np.stack([here, corner, side], axis=1)]
    )
    return Shape(major * ring + minor * normals, normals, faces)


def prism(outline, height=1.0, longest_edge=0.1):
    """A polygon (v, 2), counter-clockwise, of height -height/2..height/2, refined.

    The polygon is triangulated by Delaunay, which must contain its sides.
    """
    outline = np.asarray(outline, float)
    n = len(outline)
    cells = Delaunay(outline).simplices
    a, b, c = (outline[cells[:, j]] for j in range(3))
    turn = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    cells[turn < 0] = cells[turn < 0, ::-1]
    cells = cells[(np.abs(turn) > 1e-9) & _inside(outline, outline[cells].mean(axis=1))]
    i = np.arange(n)
    j = (i + 1) % n
    walls = [np.stack([i, j, j + n], axis=1), np.stack([i, j + n, i + n], axis=1)]
    faces = np.concatenate([cells[:, ::-1], cells + n, *walls])
    low, high = np.full((n, 1), -height / 2), np.full((n, 1), height / 2)
    points = np.concatenate([np.hstack([outline, low]), np.hstack([outline, high])])
    return refined(mesh(points, faces), longest_edge)


def _inside(outline, points):
    """Even-odd rule."""
    result = np.zeros(len(points), bool)
    for (ax, ay), (bx, by) in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        above = (ay > points[:, 1]) != (by > points[:, 1])
        with np.errstate(divide="ignore", invalid="ignore"):
            at = ax + (points[:, 1] - ay) / (by - ay) * (bx - ax)
        result ^= above & (points[:, 0] < at)
    return result


def disc_outline(radius=1.0, corners=64):
    """A regular polygon."""
    turn = 2 * np.pi * np.arange(corners) / corners
    return radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)


L_OUTLINE = [[0, 0], [3, 0], [3, 1.2], [1.2, 1.2], [1.2, 3], [0, 3]]
T_OUTLINE = [[0, 0], [1, 0], [1, 2], [2.2, 2], [2.2, 3], [-1.2, 3], [-1.2, 2], [0, 2]]
TRIANGLE = [[0, 0], [3, 0], [0, 2.4]]


def revolved(profile, around=96):
    """Turn a profile (p, 2) of (radius, height) from axis to axis round the z-axis; a closed mesh.

    The first and the last point lie on the axis.
    """
    profile = np.asarray(profile, float)
    turn = 2 * np.pi * np.arange(around) / around
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    inner = profile[1:-1]
    points = np.concatenate(
        [
            [[0, 0, profile[0, 1]], [0, 0, profile[-1, 1]]],
            *[np.column_stack([r * ring, np.full(around, z)]) for r, z in inner],
        ]
    )
    i = np.arange(around)
    j = (i + 1) % around
    faces = [np.stack([0 * i, 2 + j, 2 + i], axis=1)]
    for row in range(len(inner) - 1):
        a, b = 2 + row * around, 2 + (row + 1) * around
        faces += [np.stack([a + i, a + j, b + j], axis=1), np.stack([a + i, b + j, b + i], axis=1)]
    last = 2 + (len(inner) - 1) * around
    faces.append(np.stack([0 * i + 1, last + i, last + j], axis=1))
    return mesh(points, np.concatenate(faces))


def rounded_cylinder(radius=1.0, height=1.6, fillet=0.25, step=0.05):
    """A cylinder whose two edges are quarter circles of radius `fillet`; 0: sharp edges."""
    flat = np.arange(0.0, radius - fillet, step)
    turn = np.linspace(0, np.pi / 2, max(2, math.ceil(fillet * np.pi / 2 / step) + 1))[1:]
    top = height / 2
    corner = [[radius - fillet + fillet * np.sin(t), top - fillet * (1 - np.cos(t))] for t in turn]
    if fillet == 0:
        corner = [[radius, top]]
    rows = [[r, top] for r in flat] + [[radius - fillet, top]] * (fillet > 0) + corner
    down = top - fillet
    walls = [[radius, z] for z in np.arange(down - step, -down + step / 2, -step)]
    profile = np.array(rows + walls + [[r, -z] for r, z in rows[::-1]])
    return revolved(profile[::-1], around=round(2 * np.pi * radius / step))


def dumbbell(ball=1.0, bar=0.3, half=2.0, step=0.06):
    """Two balls joined by a round bar, along the z-axis."""
    neck = math.asin(bar / ball)
    turn = np.linspace(0, np.pi - neck, math.ceil((np.pi - neck) * ball / step))
    cap = np.column_stack([ball * np.sin(turn), -half - ball * np.cos(turn)])
    cap[0, 0] = 0.0
    inner = half - ball * math.cos(neck)
    bar_z = np.linspace(-inner, inner, math.ceil(2 * inner / step))[1:-1]
    profile = np.concatenate([cap, np.column_stack([bar + 0 * bar_z, bar_z]), cap[::-1] * [1, -1]])
    return revolved(profile, around=round(2 * np.pi * ball / step / 1.5))


def spheroid(levels=4):
    """Semi-axes 1, 1, 1/2 with exact normals: the skeleton is a disc of radius 3/4."""
    ball = icosphere(levels)
    axes = np.array([1.0, 1.0, 0.5])
    return Shape(ball.points * axes, unit(ball.points / axes), ball.faces)


def elliptic_torus(around=160, across=48, major=1.0, p=0.3, q=0.12):
    """An ellipse p (radial), q (along z) turned about z.

    The nearest surface point of a point is in its half plane through the axis, where the surface is
    the ellipse: the skeleton is the ring of the radii major -+ (p^2 - q^2)/p in the plane z = 0.
    """
    shape = torus_mesh(around, across, major, 0.3)
    turn = np.arctan2(shape.points[:, 1], shape.points[:, 0])
    ring = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    cos, sin = ((shape.normals * ring).sum(1), shape.normals[:, 2])
    points = (major + p * cos)[:, None] * ring + (q * sin)[:, None] * [0, 0, 1.0]
    normals = unit((cos / p)[:, None] * ring + (sin / q)[:, None] * [0, 0, 1.0])
    return Shape(points, normals, shape.faces)
