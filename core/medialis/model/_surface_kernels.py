"""Kernels over the triangles of a surface: one pass each, where numpy would make many."""

from __future__ import annotations

import math

from medialis._kernels.jit import kernel
from medialis._kernels.union_find_kernels import join, number_pieces


@kernel
def label_corner_fans(half, twin, opposite, parent, out_label):
    """Fan of each corner: corners of a vertex joined across edges of two faces.

    As a corner, a half-edge is the vertex where it starts; that is where its twin ends when the two
    run opposite ways.
    """
    for k in range(len(half)):
        a, b = half[k], twin[k]
        after_a, after_b = a + 1 - 3 * (a % 3 == 2), b + 1 - 3 * (b % 3 == 2)
        join(parent, a, after_b if opposite[k] else b)
        join(parent, after_a, b if opposite[k] else after_b)
    number_pieces(parent, out_label)


@kernel
def label_face_pieces(half, twin, parent, out_label):
    """Piece of each face: faces joined across edges of two faces."""
    for k in range(len(half)):
        join(parent, half[k] // 3, twin[k] // 3)
    number_pieces(parent, out_label)


@kernel
def cross_faces(points, faces, out_vectors):
    """Write the normal of each face times twice its area, (m, 3)."""
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        x, y, z = points[a, 0], points[a, 1], points[a, 2]
        ux, uy, uz = points[b, 0] - x, points[b, 1] - y, points[b, 2] - z
        vx, vy, vz = points[c, 0] - x, points[c, 1] - y, points[c, 2] - z
        out_vectors[f, 0] = uy * vz - uz * vy
        out_vectors[f, 1] = uz * vx - ux * vz
        out_vectors[f, 2] = ux * vy - uy * vx


@kernel
def scale_vectors(vectors, out_areas, out_units):
    """Half the length of each vector, (m,), and its direction, (m, 3): zero without a length.

    `out_units` may be `vectors`.
    """
    for f in range(len(vectors)):
        x, y, z = vectors[f, 0], vectors[f, 1], vectors[f, 2]
        length = math.sqrt(x * x + y * y + z * z)
        out_areas[f] = 0.5 * length
        share = length if length > 0.0 else math.inf
        out_units[f, 0], out_units[f, 1], out_units[f, 2] = x / share, y / share, z / share


@kernel
def measure_bends(first, second, units, out_bends):
    """Angle between the faces of two half-edges each, (p,); 0 where one has no area."""
    for k in range(len(first)):
        a, b = first[k] // 3, second[k] // 3
        ax, ay, az = units[a, 0], units[a, 1], units[a, 2]
        bx, by, bz = units[b, 0], units[b, 1], units[b, 2]
        x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        out_bends[k] = math.atan2(math.sqrt(x * x + y * y + z * z), ax * bx + ay * by + az * bz)


@kernel
def measure_edges(points, edges, out_lengths):
    """Length of each edge, (e,)."""
    for k in range(len(edges)):
        a, b = edges[k, 0], edges[k, 1]
        x = points[a, 0] - points[b, 0]
        y = points[a, 1] - points[b, 1]
        z = points[a, 2] - points[b, 2]
        out_lengths[k] = math.sqrt(x * x + y * y + z * z)


@kernel
def find_flat_faces(points, faces, areas, height, out_flat):
    """Whether twice the area of a face is at most `height` times its longest edge squared, (m,)."""
    for f in range(len(faces)):
        longest = 0.0
        for j in range(3):
            a, b = faces[f, j], faces[f, j - 1]
            x = points[b, 0] - points[a, 0]
            y = points[b, 1] - points[a, 1]
            z = points[b, 2] - points[a, 2]
            longest = max(longest, x * x + y * y + z * z)
        out_flat[f] = 2 * areas[f] <= height * longest


@kernel
def sum_pieces(corner, vectors, areas, pieces, apex, out_sums):
    """Signed and absolute volume of the tetrahedra to the apex of a piece, and area, (3, c)."""
    for f in range(len(corner)):
        p = pieces[f]
        x, y, z = corner[f, 0] - apex[p, 0], corner[f, 1] - apex[p, 1], corner[f, 2] - apex[p, 2]
        volume = (x * vectors[f, 0] + y * vectors[f, 1] + z * vectors[f, 2]) / 6.0
        out_sums[0, p] += volume
        out_sums[1, p] += abs(volume)
        out_sums[2, p] += areas[f]
