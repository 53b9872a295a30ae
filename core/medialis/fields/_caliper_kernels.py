"""Kernels of calipers (calipers.py): patches of faces, and the smallest ball between two.

A place with its normal is six numbers.
"""

from __future__ import annotations

import math

import numpy as np

from medialis._kernels.jit import kernel
from medialis._kernels.nearest_kernels import nearest_place

PARALLEL = 1e-12  # part of the product of squared lengths: edges without a closest place


@kernel
def _measure(a, b, across, touching):
    """Diameter of the ball between two places; inf where they do not face each other."""
    dx, dy, dz = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    if length <= touching:
        return 0.0
    size_a = math.sqrt(a[3] * a[3] + a[4] * a[4] + a[5] * a[5])
    size_b = math.sqrt(b[3] * b[3] + b[4] * b[4] + b[5] * b[5])
    along = (a[3] * dx + a[4] * dy + a[5] * dz) / max(size_a, 1e-300)
    back = -(b[3] * dx + b[4] * dy + b[5] * dz) / max(size_b, 1e-300)
    lean = min(along, back)  # a length times a cosine
    if lean < across * length or lean <= 0.0:
        return math.inf
    return length * length / lean


@kernel
def _offer(a, b, before, limits, best, out_ends):
    """Take the ball between two places if it is smaller, or equal and nearer to those before.

    `limits`: the least cosine across, the length of touching places, and what is equal. `best` is
    the smallest diameter, that of the ball that is taken, and how far that one is off.
    """
    diameter, equal = _measure(a, b, limits[0], limits[1]), 1.0 + limits[2]
    if diameter == math.inf or diameter > best[0] * equal:
        return
    best[0] = min(best[0], diameter)
    x, y, z = a[0] - before[0, 0], a[1] - before[0, 1], a[2] - before[0, 2]
    moved = math.sqrt(x * x + y * y + z * z)
    x, y, z = b[0] - before[1, 0], b[1] - before[1, 1], b[2] - before[1, 2]
    moved += math.sqrt(x * x + y * y + z * z)
    # What was taken may have been equal to a ball that is no longer the smallest.
    if best[1] > best[0] * equal or moved < best[2]:
        best[1], best[2] = diameter, moved
        for axis in range(3):
            out_ends[0, axis], out_ends[1, axis] = a[axis], b[axis]


@kernel
def _spheres(vertices, faces):
    """Middle of the corners of each face, and the distance of the farthest, (f, 4)."""
    out = np.zeros((len(faces), 4))
    for f in range(len(faces)):
        for axis in range(3):
            for j in range(3):
                out[f, axis] += vertices[faces[f, j], axis] / 3.0
        for j in range(3):
            away = 0.0
            for axis in range(3):
                step = vertices[faces[f, j], axis] - out[f, axis]
                away += step * step
            out[f, 3] = max(out[f, 3], math.sqrt(away))
    return out


@kernel
def try_corners(
    vertices, faces, others, foot, corner, first, second, before, limits, best, out_ends
):
    """Offer each vertex of the other patch with the place of each face that is nearest to it.

    No ball is smaller than its two places are apart, so faces whose sphere is farther from a vertex
    than the smallest ball is wide are left out. `foot` and `corner` are room for these two; `first`
    and `second` the same in their order.
    """
    spheres = _spheres(vertices, faces)
    for v in range(len(others)):
        for part in range(6):
            corner[part] = others[v, part]
        for f in range(len(faces)):
            away = 0.0
            for axis in range(3):
                step = corner[axis] - spheres[f, axis]
                away += step * step
            if math.sqrt(away) > (best[0] * (1.0 + limits[2]) + spheres[f, 3]) * (1.0 + 1e-9):
                continue
            a, b, c = vertices[faces[f, 0]], vertices[faces[f, 1]], vertices[faces[f, 2]]
            s, t, _ = nearest_place(corner[0], corner[1], corner[2], a, b, c)
            for part in range(6):
                foot[part] = (1.0 - s - t) * a[part] + s * b[part] + t * c[part]
            _offer(first, second, before, limits, best, out_ends)


@kernel
def try_edges(vertices, edges, others, other_edges, p, q, before, limits, best, out_ends):
    """Offer the closest places of each pair of edges, where they lie within both."""
    for i in range(len(edges)):
        a, b = vertices[edges[i, 0]], vertices[edges[i, 1]]
        for j in range(len(other_edges)):
            c, d = others[other_edges[j, 0]], others[other_edges[j, 1]]
            uu, uv, vv, uw, vw = 0.0, 0.0, 0.0, 0.0, 0.0
            for axis in range(3):
                u, v, w = b[axis] - a[axis], d[axis] - c[axis], a[axis] - c[axis]
                uu, uv, vv = uu + u * u, uv + u * v, vv + v * v
                uw, vw = uw + u * w, vw + v * w
            bottom = uu * vv - uv * uv
            if not bottom > PARALLEL * uu * vv:
                continue
            s, t = (uv * vw - vv * uw) / bottom, (uu * vw - uv * uw) / bottom
            if s < 0.0 or s > 1.0 or t < 0.0 or t > 1.0:
                continue
            for part in range(6):
                p[part] = (1.0 - s) * a[part] + s * b[part]
                q[part] = (1.0 - t) * c[part] + t * d[part]
            _offer(p, q, before, limits, best, out_ends)


@kernel
def list_around(seeds, rings, faces, fan_first, fan_sides, marked, known, out):
    """List some faces and those round them, so many rings; returns how many.

    `marked` (m,) and `known` (n,) are all 0, before and after. `out` has room for all faces.
    """
    count, done = 0, 0
    for i in range(len(seeds)):
        if marked[seeds[i]] == 0:
            marked[seeds[i]] = 1
            out[count] = seeds[i]
            count += 1
    for _ in range(rings):
        stop = count
        while done < stop:
            for j in range(3):
                v = faces[out[done], j]
                if known[v] == 0:
                    known[v] = 1
                    for at in range(fan_first[v], fan_first[v + 1]):
                        face = fan_sides[at] // 3
                        if marked[face] == 0:
                            marked[face] = 1
                            out[count] = face
                            count += 1
            done += 1
    for i in range(count):
        marked[out[i]] = 0
        for j in range(3):
            known[faces[out[i], j]] = 0
    return count


@kernel
def _bends_outward(one, other, points, faces, face_normals, convex):
    """Tell whether a face and one across a side of it bend outward, by more than a cosine."""
    bend, ahead = 0.0, 0.0
    for axis in range(3):
        bend += face_normals[one, axis] * face_normals[other, axis]
        middle = 0.0
        for j in range(3):
            middle += points[faces[other, j], axis]
        ahead += face_normals[one, axis] * (middle / 3.0 - points[faces[one, 0], axis])
    return bend < convex and ahead < 0.0


@kernel
def list_side(
    near, seeds, outward, leaning, convex, points, faces, face_normals, adjacency, marked, out
):  # fmt: skip
    """List the faces near some seeds that are of the same side of a wall; returns how many.

    They lean less than `leaning` (a cosine) from outward, and no convex edge lies between them.
    `marked` (m,) is all 0, before and after. `out` has room for all that are near.
    """
    for i in range(len(near)):
        lean = 0.0
        for axis in range(3):
            lean += face_normals[near[i], axis] * outward[axis]
        marked[near[i]] = lean >= leaning
    count, done = 0, 0
    for i in range(len(seeds)):
        if marked[seeds[i]] == 1:
            marked[seeds[i]] = 2
            out[count] = seeds[i]
            count += 1
    while done < count:
        face = out[done]
        done += 1
        for j in range(3):
            other = adjacency[face, j]
            if other < 0 or marked[other] != 1:
                continue
            if not _bends_outward(face, other, points, faces, face_normals, convex):
                marked[other] = 2
                out[count] = other
                count += 1
    for i in range(len(near)):
        marked[near[i]] = 0
    return count


@kernel
def list_corners(patch, faces, known, out):
    """List the vertices of some faces; returns how many. `known` is all 0, before and after."""
    count = 0
    for i in range(len(patch)):
        for j in range(3):
            v = faces[patch[i], j]
            if known[v] == 0:
                known[v] = 1
                out[count] = v
                count += 1
    for i in range(count):
        known[out[i]] = 0
    return count


@kernel
def fill_patch(
    patch, corners, points, normals, faces, face_normals, steep, known, out_vertices, out_faces,
    out_edges,
):  # fmt: skip
    """Give a patch vertices of its own, in the order of its corners.

    A vertex is a place and a normal: that of the shape, but where a face leans more than `steep` (a
    cosine) from it the mean of those of the patch. An edge is one number: the lower end times the
    number of corners, and the higher one. `known` (n,) is all 0, before and after.
    """
    for i in range(len(corners)):
        known[corners[i]] = i
        for axis in range(3):
            out_vertices[i, axis] = points[corners[i], axis]
            out_vertices[i, 3 + axis] = 0.0
    for j in range(3):
        for i in range(len(patch)):
            out_faces[i, j] = known[faces[patch[i], j]]
            for axis in range(3):
                out_vertices[out_faces[i, j], 3 + axis] += face_normals[patch[i], axis]
    least = np.ones(len(corners))
    for i in range(len(patch)):
        for j in range(3):
            v, w = out_faces[i, j], out_faces[i, (j + 1) % 3]
            out_edges[3 * i + j] = min(v, w) * len(corners) + max(v, w)
            lean = 0.0
            for axis in range(3):
                lean += face_normals[patch[i], axis] * normals[corners[v], axis]
            least[v] = min(least[v], lean)
    for i in range(len(corners)):
        known[corners[i]] = 0
        size = 0.0
        for axis in range(3):
            size += out_vertices[i, 3 + axis] * out_vertices[i, 3 + axis]
        size = max(math.sqrt(size), 1e-300)
        for axis in range(3):
            mean = out_vertices[i, 3 + axis] / size
            out_vertices[i, 3 + axis] = mean if least[i] < steep else normals[corners[i], axis]
