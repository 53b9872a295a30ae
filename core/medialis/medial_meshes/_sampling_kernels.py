"""Kernels of samples: rays through triangles, samples not too near to others, points on balls.

Rays tell how often a surface is wound round a place, and how thick the solid is there. Points on
balls, cones and slabs come before those that others hide are taken away. Samples of a distance at
the corners of cells tell the surface where it changes sign.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base.jit import kernel
from medialis.skeleton.importance._walk_kernels import distance, dot

TURN = math.pi * (1.0 + math.sqrt(5.0))
"""From one point of a ball to the next one: the golden angle, twice."""

OWN_FACE = 1e-9
"""Length from which on a ray meets faces, so that the neighbours of its own do not count."""

SAME_WAY = -0.3
"""Cosine of two normals from which on samples that are too near exclude each other."""

MOST_ALONG, MOST_ACROSS = 400, 300
"""Steps along and round a cone, and along the sides of a slab."""


class Rays(NamedTuple):
    """Rays from places (q, 3), in directions (q, 3), which skip a face and have a largest length.

    Attributes
    ----------
    origins, directions : (q, 3) float64
    skip : (q,) int64
        The face that each begins on, -1 for none.
    longest : (q,) float64
    """

    origins: NDArray[np.float64]
    directions: NDArray[np.float64]
    skip: NDArray[np.int64]
    longest: NDArray[np.float64]


class Candidates(NamedTuple):
    """Samples that may be kept.

    Attributes
    ----------
    points, normals : (n, 3) float64
    spacing : (n,) float64
    mirror : (n,) int64
        The sample on the other side of a thin wall, -1 for none.
    """

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    spacing: NDArray[np.float64]
    mirror: NDArray[np.int64]


class Grid(NamedTuple):
    """Grids that kept samples are entered into, by levels of their spacing.

    Samples of spacing s lie in the grid of level log2(s / smallest), whose cells are 1 to 2 s wide.

    Attributes
    ----------
    smallest : float
    levels : int
    heads, following : (h,), (n,) int64
        First sample of each slot of a hash table, and the next one after each sample; -1: none.
    cell : (3,) int64
        Scratch.
    """

    smallest: float
    levels: int
    heads: NDArray[np.int64]
    following: NDArray[np.int64]
    cell: NDArray[np.int64]


@kernel
def _side(points, a, b, x, y):
    """+1 or -1: on which side of edge a b a place lies in the plane, the opposite for b a.

    The edge is always taken from its lower vertex on, and zero belongs to that side, so a ray
    through an edge or a vertex is counted once.
    """
    low, high, sign = (a, b, 1) if a < b else (b, a, -1)
    cross = (points[high, 0] - points[low, 0]) * (y - points[low, 1]) - (
        points[high, 1] - points[low, 1]
    ) * (x - points[low, 0])
    return sign if cross >= 0.0 else -sign


@kernel
def _height(points, a, b, c, x, y):
    """Height at which the upright line through (x, y) meets the plane of a triangle."""
    bx, by = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
    cx, cy = points[c, 0] - points[a, 0], points[c, 1] - points[a, 1]
    px, py = x - points[a, 0], y - points[a, 1]
    area = bx * cy - by * cx
    if area == 0.0:
        return points[a, 2]
    u, v = (px * cy - py * cx) / area, (bx * py - by * px) / area
    z = points[a, 2]
    return z + u * (points[b, 2] - z) + v * (points[c, 2] - z)


@kernel
def count_crossings(begin, end, places, points, faces, tree, out):
    """Faces that rays from each place leave through, less those entered through.

    out (q, 1 or 2): of the ray up, and of that down if wanted. Each is how often the surface is
    wound round the place, where it is closed: then what lies below need not be looked at.
    """
    order, bounds, depth = tree
    n, leaves = len(faces), 1 << depth
    stack = np.empty(2 * depth + 2, np.int64)
    for q in range(begin, end):
        x, y, z = places[q, 0], places[q, 1], places[q, 2]
        lowest = z if out.shape[1] == 1 else -np.inf
        up, down = 0, 0
        stack[0], size = 1, 1
        while size > 0:
            size -= 1
            node = stack[size]
            if x < bounds[node, 0] or x > bounds[node, 3] or lowest > bounds[node, 5]:
                continue
            if y < bounds[node, 1] or y > bounds[node, 4]:
                continue
            if node < leaves:
                stack[size], stack[size + 1] = 2 * node, 2 * node + 1
                size += 2
                continue
            leaf = node - leaves
            for i in range((n * leaf) >> depth, (n * (leaf + 1)) >> depth):
                a, b, c = faces[order[i], 0], faces[order[i], 1], faces[order[i], 2]
                side = _side(points, a, b, x, y)
                if side != _side(points, b, c, x, y) or side != _side(points, c, a, x, y):
                    continue
                if _height(points, a, b, c, x, y) > z:
                    up += side
                else:
                    down -= side
        out[q, 0] = up
        if out.shape[1] > 1:
            out[q, 1] = down


@kernel
def _meets_box(box, origin, inverse, length):
    """Tell whether a ray meets a box before `length`."""
    near, far = 0.0, length
    for d in range(3):
        first = (box[d] - origin[d]) * inverse[d]
        second = (box[3 + d] - origin[d]) * inverse[d]
        if first > second:
            first, second = second, first
        near, far = max(near, first), min(far, second)
    return near <= far


@kernel
def _step(points, a, b):
    return points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]


@kernel
def _meet(points, a, b, c, origin, direction):
    """Length of a ray up to a triangle; infinite where they do not meet."""
    ex, ey, ez = _step(points, a, b)
    fx, fy, fz = _step(points, a, c)
    px = direction[1] * fz - direction[2] * fy
    py = direction[2] * fx - direction[0] * fz
    pz = direction[0] * fy - direction[1] * fx
    det = ex * px + ey * py + ez * pz
    if det == 0.0:
        return np.inf
    tx, ty, tz = origin[0] - points[a, 0], origin[1] - points[a, 1], origin[2] - points[a, 2]
    u = (tx * px + ty * py + tz * pz) / det
    qx, qy, qz = ty * ez - tz * ey, tz * ex - tx * ez, tx * ey - ty * ex
    v = (direction[0] * qx + direction[1] * qy + direction[2] * qz) / det
    if u < 0.0 or v < 0.0 or u + v > 1.0:
        return np.inf
    return (fx * qx + fy * qy + fz * qz) / det


@kernel
def ray_lengths(begin, end, rays, points, faces, tree, out_length, out_face):
    """Length of each ray up to the first face, but its longest at most, and that face or -1."""
    order, bounds, depth = tree
    n, leaves = len(faces), 1 << depth
    stack = np.empty(2 * depth + 2, np.int64)
    inverse = np.empty(3)
    for q in range(begin, end):
        best, met, origin, direction = rays.longest[q], -1, rays.origins[q], rays.directions[q]
        for d in range(3):
            inverse[d] = 1.0 / direction[d] if direction[d] != 0.0 else 1e300
        stack[0], size = 1, 1
        while size > 0:
            size -= 1
            node = stack[size]
            if not _meets_box(bounds[node], origin, inverse, best):
                continue
            if node < leaves:
                stack[size], stack[size + 1] = 2 * node, 2 * node + 1
                size += 2
                continue
            leaf = node - leaves
            for i in range((n * leaf) >> depth, (n * (leaf + 1)) >> depth):
                face = order[i]
                if face == rays.skip[q]:
                    continue
                a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
                length = _meet(points, a, b, c, origin, direction)
                if OWN_FACE < length < best:
                    best, met = length, face
        out_length[q], out_face[q] = best, met


@kernel
def corner_normals(vectors, starts, corners, cosine, out):
    """Find the normal at each corner, (m, 3, 3): of the faces there that bend little from its own.

    `vectors` (m, 3) are normals times areas; `corners` lists the corners 3 f + j of each vertex.
    """
    for vertex in range(len(starts) - 1):
        for i in range(starts[vertex], starts[vertex + 1]):
            own = vectors[corners[i] // 3]
            length = np.sqrt(own[0] * own[0] + own[1] * own[1] + own[2] * own[2])
            x, y, z = 0.0, 0.0, 0.0
            for j in range(starts[vertex], starts[vertex + 1]):
                other = vectors[corners[j] // 3]
                size = np.sqrt(other[0] * other[0] + other[1] * other[1] + other[2] * other[2])
                along = own[0] * other[0] + own[1] * other[1] + own[2] * other[2]
                if along >= cosine * length * size:
                    x, y, z = x + other[0], y + other[1], z + other[2]
            size = max(np.sqrt(x * x + y * y + z * z), 1e-300)
            row = out[corners[i] // 3, corners[i] % 3]
            row[0], row[1], row[2] = x / size, y / size, z / size


@kernel
def _cell_of(cell, level, mask):
    """Slot of a grid cell (3,) of a level in the hash table."""
    return (
        (cell[0] * 73856093) ^ (cell[1] * 19349663) ^ (cell[2] * 83492791) ^ (level * 2654435761)
    ) & mask


@kernel
def _cell_at(points, i, level, grid):
    """Fill in the cell of a level that sample i lies in."""
    width = grid.smallest * 2.0 ** (level + 1)
    for d in range(3):
        grid.cell[d] = int(points[i, d] // width)


@kernel
def _conflict(i, samples, grid):
    """Return a kept sample that faces the same way and is too near to sample i; -1 for none."""
    points, normals, spacing, _ = samples
    cell, mask = grid.cell, len(grid.heads) - 1
    for level in range(grid.levels):
        _cell_at(points, i, level, grid)
        x, y, z = cell[0], cell[1], cell[2]
        for dx in range(-1, 2):
            for dy in range(-1, 2):
                for dz in range(-1, 2):
                    cell[0], cell[1], cell[2] = x + dx, y + dy, z + dz
                    j = grid.heads[_cell_of(cell, level, mask)]
                    while j >= 0:
                        near = min(spacing[i], spacing[j])
                        a, b, c = _step(points, j, i)
                        close = a * a + b * b + c * c < near * near
                        if close and dot(normals[i], normals[j]) > SAME_WAY:
                            return j
                        j = grid.following[j]
    return -1


@kernel
def _keep(i, samples, grid):
    """Enter a sample into the grid of its level."""
    level = int(np.floor(np.log2(samples.spacing[i] / grid.smallest)))
    level = min(grid.levels - 1, level)
    _cell_at(samples.points, i, level, grid)
    slot = _cell_of(grid.cell, level, len(grid.heads) - 1)
    grid.following[i] = grid.heads[slot]
    grid.heads[slot] = i


@kernel
def thin_out(samples, order, heads, following, out_owner):
    """Keep samples in this order where none is too near; sample and mirror are kept together.

    `heads` is all -1, with a power of two of slots; `following` (n,) is scratch. out_owner (n,):
    the sample itself where kept, else a kept one near it, else -1.
    """
    smallest = samples.spacing.min()
    levels = int(np.floor(np.log2(samples.spacing.max() / smallest))) + 1
    grid = Grid(smallest, levels, heads, following, np.empty(3, np.int64))
    for i in order:
        if out_owner[i] >= 0:
            continue
        near = _conflict(i, samples, grid)
        if near >= 0:
            out_owner[i] = near
            continue
        other = samples.mirror[i]
        if other >= 0:
            near = _conflict(other, samples, grid)
            if near >= 0:
                out_owner[other] = near
                continue
            out_owner[other] = other
            _keep(other, samples, grid)
        out_owner[i] = i
        _keep(i, samples, grid)


@kernel
def count_points(balls, edges, faces, steps, fewest, most, out):
    """How many points each ball, cone and slab gets: about one for the square of its own step."""
    n = len(balls)
    for i in range(n):
        wanted = 4.0 * np.pi * balls[i, 3] ** 2 / steps[i] ** 2
        out[i] = int(min(max(wanted, fewest), most))
    for e in range(len(edges)):
        along, around = _cone_steps(balls, edges[e, 0], edges[e, 1], steps[n + e])
        out[n + e] = (along + 1) * around
    for f in range(len(faces)):
        k = _slab_steps(balls, faces[f], steps[n + len(edges) + f])
        out[n + len(edges) + f] = (k + 1) * (k + 2)


@kernel
def _cone_steps(balls, i, j, step):
    length = distance(balls, i, j)
    if length <= abs(balls[i, 3] - balls[j, 3]) * (1.0 + 1e-9) + 1e-12:
        return -1, 0
    widest = max(balls[i, 3], balls[j, 3])
    along = min(max(int(np.ceil(length / step)), 2), MOST_ALONG)
    return along, min(max(int(np.ceil(2 * np.pi * widest / step)), 8), MOST_ALONG)


@kernel
def _slab_steps(balls, face, step):
    longest = max(
        distance(balls, face[0], face[1]),
        distance(balls, face[1], face[2]),
        distance(balls, face[0], face[2]),
    )
    return min(max(int(np.ceil(longest / step)), 2), MOST_ACROSS)


@kernel
def put_points(balls, edges, faces, steps, starts, out):
    """Fill out (p, 3); starts (b + e + f + 1,) are the counts summed up."""
    n = len(balls)
    for i in range(n):
        _on_ball(balls[i], starts[i], starts[i + 1], out)
    for e in range(len(edges)):
        if starts[n + e + 1] > starts[n + e]:
            _on_cone(steps[n + e], balls, edges[e], starts[n + e], out)
    for f in range(len(faces)):
        row = n + len(edges) + f
        _on_slab(balls, faces[f], steps[row], starts[row], out)


@kernel
def _on_ball(ball, begin, end, out):
    count = end - begin
    for k in range(count):
        z = 1.0 - (2.0 * k + 1.0) / count
        ring = np.sqrt(1.0 - z * z)
        turn = TURN * (k + 0.5)
        out[begin + k, 0] = ball[0] + ball[3] * ring * np.cos(turn)
        out[begin + k, 1] = ball[1] + ball[3] * ring * np.sin(turn)
        out[begin + k, 2] = ball[2] + ball[3] * z


@kernel
def _on_cone(step, balls, edge, begin, out):
    first, second = balls[edge[0]], balls[edge[1]]
    along, around = _cone_steps(balls, edge[0], edge[1], step)
    axis = second[:3] - first[:3]
    length = np.sqrt(axis[0] ** 2 + axis[1] ** 2 + axis[2] ** 2)
    axis = axis / length
    least = 0
    for d in range(1, 3):
        if abs(axis[d]) < abs(axis[least]):
            least = d
    side = -axis[least] * axis
    side[least] += 1.0
    side = side / np.sqrt(side[0] ** 2 + side[1] ** 2 + side[2] ** 2)
    up = np.empty(3)
    for d in range(3):
        a, b = (d + 1) % 3, (d + 2) % 3
        up[d] = axis[a] * side[b] - axis[b] * side[a]
    back = (second[3] - first[3]) / length  # the normal leans back where the cone grows
    lean = np.sqrt(1.0 - back * back)
    for i in range(along + 1):
        t = i / along
        r = first[3] + t * (second[3] - first[3])
        for j in range(around):
            turn = 2.0 * np.pi * j / around
            for d in range(3):
                normal = lean * (np.cos(turn) * side[d] + np.sin(turn) * up[d]) - back * axis[d]
                out[begin + i * around + j, d] = first[d] + t * length * axis[d] + r * normal


@kernel
def _on_slab(balls, face, step, begin, out):
    k = _slab_steps(balls, face, step)
    a, b, c = balls[face[0]], balls[face[1]], balls[face[2]]
    u, v = b[:3] - a[:3], c[:3] - a[:3]
    uu, uv, vv = (u * u).sum(), (u * v).sum(), (v * v).sum()
    area = uu * vv - uv * uv
    normal, gradient = np.zeros(3), np.zeros(3)
    if area > 1e-14 * uu * vv:
        ur, vr = b[3] - a[3], c[3] - a[3]
        gradient = ((ur * vv - vr * uv) * u + (vr * uu - ur * uv) * v) / area
        for d in range(3):
            p, q = (d + 1) % 3, (d + 2) % 3
            normal[d] = (u[p] * v[q] - u[q] * v[p]) / np.sqrt(area)
    steep = (gradient * gradient).sum()
    if steep >= 1.0:
        normal[:], gradient[:] = 0.0, 0.0  # no side of its own: the middle, which others hide
    height = np.sqrt(max(1.0 - steep, 0.0))
    at = begin
    for i in range(k + 1):
        for j in range(k + 1 - i):
            s, t = i / k, j / k
            r = a[3] + s * (b[3] - a[3]) + t * (c[3] - a[3])
            for sign in (-1.0, 1.0):
                for d in range(3):
                    out[at, d] = (
                        a[d] + s * u[d] + t * v[d] + r * (sign * height * normal[d] - gradient[d])
                    )
                at += 1


class Cuts(NamedTuple):
    """How cells and their tetrahedra are cut where a distance changes sign.

    Attributes
    ----------
    masks : (256, 6) uint8
        Inside corners of each tetrahedron by those of the cell, the first one highest.
    tetrahedra : (6, 4) int64
        Their corners in the cell.
    counts : (16,) int64
        Triangles of each mask.
    corners : (16, 2, 3, 2) int64
        Each corner of a triangle lies on an edge of the tetrahedron: from inside, to outside.
    """

    masks: NDArray[np.uint8]
    tetrahedra: NDArray[np.int64]
    counts: NDArray[np.int64]
    corners: NDArray[np.int64]


@kernel
def _signs(values, cell):
    """Tell which corners of a cell are inside, one bit each; the first one is the highest."""
    signs = 0
    for k in range(8):
        signs = 2 * signs + (1 if values[cell[k]] < 0.0 else 0)
    return signs


@kernel
def count_masks(values, cells, cuts, out):
    """How many tetrahedra of cells (c, 8) with corners inside and outside have each mask, (16,)."""
    for c in range(len(cells)):
        signs = _signs(values, cells[c])
        if 0 < signs < 255:
            for t in range(6):
                out[cuts.masks[signs, t]] += 1


@kernel
def cut_cells(values, cells, cuts, starts, out_across, out_keys):
    """Fill in the triangles, out_keys (f, 3), by mask from starts (16, 2) on; these are moved.

    A vertex has the key of its inside corner and the way to the outside one; that corner stands at
    the key in out_across, which is -1 elsewhere. Returns how many vertices there are.
    """
    ways, count = len(out_across) // len(values), 0
    for c in range(len(cells)):
        cell = cells[c]
        signs = _signs(values, cell)
        if signs == 0 or signs == 255:
            continue
        for t in range(6):
            mask = cuts.masks[signs, t]
            for triangle in range(cuts.counts[mask]):
                row = starts[mask, triangle]
                starts[mask, triangle] += 1
                for k in range(3):
                    i = cuts.tetrahedra[t, cuts.corners[mask, triangle, k, 0]]
                    o = cuts.tetrahedra[t, cuts.corners[mask, triangle, k, 1]]
                    key = ways * cell[i] + o - i + ways // 2
                    out_keys[row, k] = key
                    if out_across[key] < 0:
                        count += 1
                    out_across[key] = cell[o]
    return count


@kernel
def number_keys(keys, table, out_first, out_number):
    """Give equal keys (q,) a number, by where each comes first; return how many differ.

    `out_first` are where they do. `table` is -1 and a power of two long, more than differ.
    """
    last, count = np.uint64(len(table) - 1), 0
    for i in range(len(keys)):
        mixed = np.uint64(keys[i] >> 3) * np.uint64(0x9E3779B97F4A7C15)
        slot = ((mixed >> np.uint64(29)) + np.uint64(keys[i] & 7)) & last
        while table[slot] >= 0 and keys[out_first[table[slot]]] != keys[i]:
            slot = (slot + np.uint64(1)) & last
        if table[slot] < 0:
            table[slot] = count
            out_first[count] = i
            count += 1
        out_number[i] = table[slot]
    return count
