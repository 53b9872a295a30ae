"""Kernels over the faces, edges and vertices of a surface: one pass each, where numpy makes many.

In the order of the file: fans and pieces, measures of faces and edges, the graph of the vertices
with searches along it, bulges of faces, triangles in strips, and how often a surface is wound round
a place.

A graph is two arrays, as in `Ragged`: the neighbours of vertex v are
``neighbours[offsets[v]:offsets[v + 1]]``. Every link is listed from both ends.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base._kernels import join, next_side, number_pieces, pop, push
from medialis.base.jit import kernel


@kernel
def label_corner_fans(half, twin, opposite, parent, out_label):
    """Fan of each corner: corners of a vertex joined across edges of two faces.

    As a corner, a half-edge is the vertex where it starts; that is where its twin ends when the two
    run opposite ways.
    """
    for k in range(len(half)):
        a, b = half[k], twin[k]
        after_a, after_b = next_side(a), next_side(b)
        join(parent, a, after_b if opposite[k] else b)
        join(parent, after_a, b if opposite[k] else after_b)
    number_pieces(parent, out_label)


@kernel
def label_face_pieces(twins, parent, out_label):
    """Piece of each face: faces joined across edges of two faces; `twins` (3m,), -1 elsewhere."""
    for h in range(len(twins)):
        if twins[h] > h:
            join(parent, h // 3, twins[h] // 3)
    number_pieces(parent, out_label)


@kernel
def label_components(faces, parent, out_label):
    """Component of each vertex: faces join their corners."""
    for f in range(len(faces)):
        join(parent, faces[f, 0], faces[f, 1])
        join(parent, faces[f, 0], faces[f, 2])
    number_pieces(parent, out_label)


@kernel
def mark_corners(faces, out_used):
    """Tell the vertices that faces name, (n,)."""
    for f in range(len(faces)):
        out_used[faces[f, 0]] = out_used[faces[f, 1]] = out_used[faces[f, 2]] = True


@kernel
def list_twins(one, other, out_twins):
    """Enter the half-edges of each edge of two as each other's, but for those of one face."""
    for k in range(len(one)):
        a, b = one[k], other[k]
        if a // 3 != b // 3:
            out_twins[a], out_twins[b] = b, a


@kernel
def has_equal_faces(twins):
    """Tell whether a face has the same other one on all sides; edges have two faces at most."""
    for f in range(len(twins) // 3):
        beside = twins[3 * f] // 3
        if beside >= 0 and beside == twins[3 * f + 1] // 3 and beside == twins[3 * f + 2] // 3:
            return True
    return False


@kernel
def count_rings(twins, seen):
    """Rings of faces round vertices, where each half-edge has one that runs the other way.

    `seen` (3m,) is False.
    """
    count = 0
    for h in range(len(twins)):
        if not seen[h]:
            count += 1
            while not seen[h]:
                seen[h] = True
                h = next_side(twins[h])
    return count


@kernel
def find_needles(points, faces, areas, planes, length, out_needle, out_longest):
    """Tell faces of no plane that are more than `length` times as long as high, (m,).

    `out_longest` gets the square of the longest side of each.
    """
    for f in range(len(faces)):
        longest = 0.0
        for j in range(3):
            a, b = faces[f, j], faces[f, (j + 1) % 3]
            x, y = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
            z = points[b, 2] - points[a, 2]
            longest = max(longest, x * x + y * y + z * z)
        out_longest[f] = longest
        needle = longest > 2.0 * length * areas[f] and planes[f] < 0
        out_needle[f] = needle and areas[f] > 0.0


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
def measure_faces(points, faces, height, out_areas, out_units, out_flat):
    """Area (m,) and unit normal (m, 3) of each face, zero without an area, and whether it is flat.

    That is where twice the area is at most `height` times the longest edge squared, (m,).
    """
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        x, y, z = points[a, 0], points[a, 1], points[a, 2]
        bx, by, bz = points[b, 0], points[b, 1], points[b, 2]
        cx, cy, cz = points[c, 0], points[c, 1], points[c, 2]
        ux, uy, uz, vx, vy, vz = bx - x, by - y, bz - z, cx - x, cy - y, cz - z
        wx, wy, wz = cx - bx, cy - by, cz - bz
        longest = max(ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz)
        longest = max(longest, wx * wx + wy * wy + wz * wz)
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        length = math.sqrt(x * x + y * y + z * z)
        out_areas[f] = 0.5 * length
        out_flat[f] = length <= height * longest
        share = length if length > 0.0 else math.inf
        out_units[f, 0], out_units[f, 1], out_units[f, 2] = x / share, y / share, z / share


@kernel
def measure_bends(first, second, units, out_bends):
    """Angle between the faces of two half-edges each, (p,); 0 where one has no area."""
    cosine = np.empty(256)
    for begin in range(0, len(first), len(cosine)):
        end = min(begin + len(cosine), len(first))
        for k in range(begin, end):
            a, b = first[k] // 3, second[k] // 3
            ax, ay, az = units[a, 0], units[a, 1], units[a, 2]
            bx, by, bz = units[b, 0], units[b, 1], units[b, 2]
            x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
            out_bends[k] = math.sqrt(x * x + y * y + z * z)
            cosine[k - begin] = ax * bx + ay * by + az * bz
        for k in range(begin, end):  # after the normals of all: those are waited for once
            out_bends[k] = math.atan2(out_bends[k], cosine[k - begin])


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
def add_corners(points, faces, pieces, out_sums, out_counts):
    """Sum of the first corners of the faces of each piece, (c, 3), and how many these are, (c,)."""
    for f in range(len(faces)):
        p, v = pieces[f], faces[f, 0]
        out_counts[p] += 1
        for axis in range(3):
            out_sums[p, axis] += points[v, axis]


@kernel
def add_ends(points, ends, edges, pieces, out_sums, out_counts):
    """Sum of the ends of edges of each piece, lower ones first, (c, 3), and their count, (c,)."""
    for end in range(2):
        for k in range(len(edges)):
            p, v = pieces[k], ends[edges[k], end]
            out_counts[p] += 1
            for axis in range(3):
                out_sums[p, axis] += points[v, axis]


@kernel
def measure_tetrahedra(points, faces, vectors, apex, out_volumes):
    """Signed volume of the tetrahedron of each face with an apex (3,), (m,)."""
    for f in range(len(faces)):
        v = faces[f, 0]
        x, y, z = points[v, 0] - apex[0], points[v, 1] - apex[1], points[v, 2] - apex[2]
        x, y, z = x * vectors[f, 0], y * vectors[f, 1], z * vectors[f, 2]
        out_volumes[f] = (x + z + y) / 6


@kernel
def sum_pieces(points, faces, vectors, areas, pieces, apex, out_sums):
    """Signed and absolute volume of the tetrahedra to the apex of a piece, and area, (3, c)."""
    for f in range(len(faces)):
        p, v = pieces[f], faces[f, 0]
        x, y, z = points[v, 0] - apex[p, 0], points[v, 1] - apex[p, 1], points[v, 2] - apex[p, 2]
        volume = (x * vectors[f, 0] + y * vectors[f, 1] + z * vectors[f, 2]) / 6.0
        out_sums[0, p] += volume
        out_sums[1, p] += abs(volume)
        out_sums[2, p] += areas[f]


@kernel
def count_corners(faces, wanted, out_offsets):
    """Room for the neighbours of every vertex, by the faces with a wanted corner: 2 a corner."""
    for f in range(len(faces)):
        if wanted[faces[f, 0]] or wanted[faces[f, 1]] or wanted[faces[f, 2]]:
            for j in range(3):
                out_offsets[faces[f, j] + 1] += 2
    for v in range(len(out_offsets) - 1):
        out_offsets[v + 1] += out_offsets[v]


@kernel
def list_neighbours(faces, wanted, cursor, out_neighbours):
    """Enter the other two corners at each corner; `cursor` starts as the offsets and moves on."""
    for f in range(len(faces)):
        if wanted[faces[f, 0]] or wanted[faces[f, 1]] or wanted[faces[f, 2]]:
            for j in range(3):
                v = faces[f, j]
                for other in range(1, 3):
                    out_neighbours[cursor[v]] = faces[f, (j + other) % 3]
                    cursor[v] += 1


@kernel
def drop_repeats(offsets, neighbours):
    """List every neighbour once, moving the lists together in place; return the new length.

    Rows have about 12 entries, so looking through the row is faster than sorting it.
    """
    filled, begin = 0, 0
    for v in range(len(offsets) - 1):
        end = offsets[v + 1]
        offsets[v] = filled
        for at in range(begin, end):
            w = neighbours[at]
            known = w == v
            for earlier in range(offsets[v], filled):
                if neighbours[earlier] == w:
                    known = True
                    break
            if not known:
                neighbours[filled] = w
                filled += 1
        begin = end
    offsets[-1] = filled
    return filled


@kernel
def link_rows(links, out_first, out_neighbours, out_times):
    """Neighbours of each node that links (e, 2) join, ascending, and how often each is one.

    `out_first` (n + 1,) is 0, and becomes where the neighbours of each node start; returns how many
    there are. A counting sort by the neighbour, then by the node.
    """
    count = len(out_first) - 1
    start, nodes = np.zeros(count + 1, np.int64), np.empty(2 * len(links), np.int32)
    for e in range(len(links)):
        start[links[e, 0] + 1] += 1
        start[links[e, 1] + 1] += 1
    for v in range(count):
        start[v + 1] += start[v]
    place = start.copy()
    for e in range(len(links)):
        a, b = links[e, 0], links[e, 1]
        nodes[place[b]] = a
        place[b] += 1
        nodes[place[a]] = b
        place[a] += 1
    place[:] = start
    every = np.empty(2 * len(links), np.int32)
    for v in range(count):
        for at in range(start[v], start[v + 1]):
            every[place[nodes[at]]] = v
            place[nodes[at]] += 1
    filled = 0
    for v in range(count):
        for at in range(start[v], start[v + 1]):
            if at > start[v] and every[at] == every[at - 1]:
                out_times[filled - 1] += 1
                continue
            out_neighbours[filled], out_times[filled] = every[at], 1
            filled += 1
        out_first[v + 1] = filled
    return filled


@kernel
def _apart(points, v, w):
    """Distance of two points."""
    x, y, z = points[v, 0] - points[w, 0], points[v, 1] - points[w, 1], points[v, 2] - points[w, 2]
    return math.sqrt(x * x + y * y + z * z)


@kernel
def spread_from_seeds(points, offsets, neighbours, out_distance, out_seed, out_order):
    """Dijkstra's search from all seeds at once: the nearest seed along edges, and its distance.

    `out_order` (n,) is filled with what is no seed and is reached, the nearest first; returns how
    many there are.

    On entry `out_seed` is the vertex itself and `out_distance` 0 at the seeds, -1 and inf
    elsewhere; what cannot be reached stays so. Equally near seeds: the lowest index wins. A vertex
    is entered in the heap once at most for each of its listed neighbours.
    """
    keys, names = np.empty(len(neighbours)), np.empty(len(neighbours), np.int32)
    size, turn, count, reached = 0, 0, len(out_seed), 0
    while turn < count or size > 0:
        if turn < count:  # the seeds first, which need no heap
            v = turn
            turn += 1
            if out_distance[v] > 0.0:
                continue
        else:
            size = pop(keys, names, size)
            v = names[size]
            if keys[size] > out_distance[v]:
                continue  # a shorter way was found since
            out_order[reached] = v
            reached += 1
        for at in range(offsets[v], offsets[v + 1]):
            w = neighbours[at]
            if out_distance[w] < out_distance[v]:
                continue
            reach = out_distance[v] + _apart(points, v, w)
            if reach < out_distance[w]:
                out_distance[w], out_seed[w] = reach, out_seed[v]
                size = push(keys, names, size, reach, w)
            elif reach == out_distance[w] and out_seed[v] < out_seed[w]:
                out_seed[w] = out_seed[v]
    return reached


@kernel
def spread_again(rows, wanted, points, offsets, neighbours, out_distance, out_seed):
    """Find the nearest seeds of some rows from those of all others, which stay.

    On entry rows have the seed -1 and the distance inf; `wanted` tells which vertices they are. A
    row enters the heap once at first, and then once at most for each of its neighbours.
    """
    room = len(rows)
    for i in range(len(rows)):
        room += offsets[rows[i] + 1] - offsets[rows[i]]
    keys, names, size = np.empty(room), np.empty(room, np.int32), 0
    for i in range(len(rows)):
        v = rows[i]
        for at in range(offsets[v], offsets[v + 1]):
            w = neighbours[at]
            if wanted[w] or out_seed[w] < 0:
                continue
            reach = out_distance[w] + _apart(points, v, w)
            if reach < out_distance[v] or (reach == out_distance[v] and out_seed[w] < out_seed[v]):
                out_distance[v], out_seed[v] = reach, out_seed[w]
        if out_seed[v] >= 0:
            size = push(keys, names, size, out_distance[v], v)
    while size > 0:
        size = pop(keys, names, size)
        v = names[size]
        if keys[size] > out_distance[v]:
            continue
        for at in range(offsets[v], offsets[v + 1]):
            w = neighbours[at]
            if not wanted[w]:
                continue
            reach = out_distance[v] + _apart(points, v, w)
            if reach < out_distance[w]:
                out_distance[w], out_seed[w] = reach, out_seed[v]
                size = push(keys, names, size, reach, w)
            elif reach == out_distance[w] and out_seed[v] < out_seed[w]:
                out_seed[w] = out_seed[v]


@kernel
def _first_of(corners, least):
    """Where the first corner from `least` on stands in the ascending `corners`."""
    low, high = 0, len(corners)
    while low < high:
        middle = (low + high) // 2
        if corners[middle] < least:
            low = middle + 1
        else:
            high = middle
    return low


class CreasedMesh(NamedTuple):
    """Triangles whose normals differ on the two sides of a crease.

    Attributes
    ----------
    points, normals : (n, 3) float64
        Vertices, and their unit normals.
    faces : (m, 3) int32
    units : (m, 3) float64
        Unit normals of the faces; zero without an area.
    corners : (c,) int64
        Corners 3 f + j beside a crease, ascending.
    sector : (c,) int32
        Row in `sector_normals` of each of them.
    sector_normals : (s, 3) float64
    smoothness : (n,) float64
        The cosine that counts at the corners beside a crease, by their vertex.
    """

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    faces: NDArray[np.int32]
    units: NDArray[np.float64]
    corners: NDArray[np.int64]
    sector: NDArray[np.int32]
    sector_normals: NDArray[np.float64]
    smoothness: NDArray[np.float64]


@kernel
def bulge_faces(begin, end, mesh, out_bulges, out_cosines):
    """Bulges over the sides of the faces begin..end, and their least cosine (`Creases`)."""
    points, faces, normals, units, corners = (
        mesh.points, mesh.faces, mesh.normals, mesh.units, mesh.corners,
    )  # fmt: skip
    n = np.empty((3, 3))
    at = _first_of(corners, 3 * begin)
    for f in range(begin, end):
        flat = units[f, 0] == 0.0 and units[f, 1] == 0.0 and units[f, 2] == 0.0
        out_cosines[f] = 0.0 if flat else 1.0
        for j in range(3):
            v = faces[f, j]
            cosine = 0.0
            for axis in range(3):
                n[j, axis] = normals[v, axis]
                cosine += n[j, axis] * units[f, axis]
            if n[j, 0] == 0.0 and n[j, 1] == 0.0 and n[j, 2] == 0.0:
                cosine = 1.0
            if at < len(corners) and corners[at] == 3 * f + j:
                cosine = mesh.smoothness[v]
                for axis in range(3):
                    n[j, axis] = mesh.sector_normals[mesh.sector[at], axis]
                at += 1
            out_cosines[f] = max(min(cosine, out_cosines[f]), 0.0)
        for j in range(3):
            k = j + 1 if j < 2 else 0
            u, v = faces[f, j], faces[f, k]
            one, other = 0.0, 0.0
            for axis in range(3):
                side = points[v, axis] - points[u, axis]
                one -= n[j, axis] * side
                other += n[k, axis] * side
            out_bulges[f, j] = 2.0 * one * other / (one + other) if one * other > 0.0 else 0.0


@kernel
def mark_cut(points, normals, faces, units, corners, cosines, steeper, sign, out_cut):
    """Tell the vertices at which a face is cut, by some of the corners (`Creases.cut_vertices`)."""
    inward, normal, foot = np.empty(3), np.empty(3), np.empty(3)
    sides = np.empty((2, 3))
    for corner in corners:
        f, j = corner // 3, corner % 3
        tip, off = faces[f, j], 0.0
        for axis in range(3):
            inward[axis], normal[axis] = -sign * normals[tip, axis], units[f, axis]
            off += inward[axis] * normal[axis]
        if inward[0] == 0.0 and inward[1] == 0.0 and inward[2] == 0.0:
            continue
        cosine = 1.0
        for k in range(2):
            along, length = 0.0, 0.0
            for axis in range(3):
                d = points[faces[f, (j + 1 + k) % 3], axis] - points[tip, axis]
                sides[k, axis] = d
                along += d * inward[axis]
                length += d * d
            if along > 0.0:
                along /= math.sqrt(length)
                cosine = min(cosine, math.sqrt(max(1.0 - along * along, 0.0)))
        for axis in range(3):
            foot[axis] = inward[axis] - off * normal[axis]
        # The foot lies between the two sides of the corner: as seen along the normal of the face.
        between = True
        for first, second in ((sides[0], foot), (foot, sides[1])):
            turn = 0.0
            for axis in range(3):
                u, v = (axis + 1) % 3, (axis + 2) % 3
                turn += (first[u] * second[v] - first[v] * second[u]) * normal[axis]
            between &= turn > 0.0
        if between:
            cosine = abs(off)
        if cosine < cosines[f] - steeper:
            out_cut[tip] = True


@kernel
def _off_line(points, a, b):
    return (
        (points[a, 0] - points[b, 0]) ** 2
        + (points[a, 1] - points[b, 1]) ** 2
        + (points[a, 2] - points[b, 2]) ** 2
    )


@kernel
def zip_strips(points, ring, first, below, out_faces):
    """Triangles of each strip: its rim is ring[first[s]:first[s + 1]], its base comes first.

    `below` is the number of pieces of the base, which both other sides face; b pieces there and a
    on the other sides make a + b - 2 triangles. One end after the other moves on, that with the
    shorter way across. No new vertex is needed, and no triangle lies on one side alone.
    """
    at = 0
    for s in range(len(below)):
        base, count, b = first[s], first[s + 1] - first[s], below[s]
        a = count - b
        i, j = 1, 1
        low, up = ring[base + 1], ring[base + count - 1]
        out_faces[at, 0], out_faces[at, 1], out_faces[at, 2] = ring[base], low, up
        at += 1
        while i < b - 1 or j < a - 1:
            next_low, next_up = ring[base + i + 1], ring[base + count - j - 1]
            move_low = i < b - 1 and (
                j == a - 1 or _off_line(points, next_low, up) <= _off_line(points, low, next_up)
            )
            out_faces[at, 0] = low
            if move_low:
                out_faces[at, 1], out_faces[at, 2] = next_low, up
                low, i = next_low, i + 1
            else:
                out_faces[at, 1], out_faces[at, 2] = next_up, up
                up, j = next_up, j + 1
            at += 1
        out_faces[at, 0], out_faces[at, 1], out_faces[at, 2] = low, ring[base + b], up
        at += 1


@kernel
def _cross(corners, axis, out_counts):
    """Count a face for the two rays from the origin along an axis, where it meets one of them."""
    u, v = (axis + 1) % 3, (axis + 2) % 3
    a = corners[1, u] * corners[2, v] - corners[1, v] * corners[2, u]
    b = corners[2, u] * corners[0, v] - corners[2, v] * corners[0, u]
    c = corners[0, u] * corners[1, v] - corners[0, v] * corners[1, u]
    facing = 1 if a > 0.0 else -1
    if not (facing * a > 0.0 and facing * b > 0.0 and facing * c > 0.0):
        return
    height = a * corners[0, axis] + b * corners[1, axis] + c * corners[2, axis]
    if height / (a + b + c) > 0.0:
        out_counts[2 * axis] += facing
    else:
        out_counts[2 * axis + 1] -= facing


FACES = 64
"""In a block: neighbours in a file mostly lie side by side, and rays miss nearly all blocks."""


@kernel
def bound_faces(points, faces, out_bounds):
    """Write the least and the largest coordinates of m faces, then of their blocks, (6, m + b)."""
    out_bounds[:3, len(faces) :], out_bounds[3:, len(faces) :] = np.inf, -np.inf
    for f in range(len(faces)):
        a, b, c, block = faces[f, 0], faces[f, 1], faces[f, 2], len(faces) + f // FACES
        for axis in range(3):
            x, y, z = points[a, axis], points[b, axis], points[c, axis]
            low, high = min(min(x, y), z), max(max(x, y), z)
            out_bounds[axis, f], out_bounds[3 + axis, f] = low, high
            out_bounds[axis, block] = min(out_bounds[axis, block], low)
            out_bounds[3 + axis, block] = max(out_bounds[3 + axis, block], high)


@kernel
def _meets_rays(bounds, i, x, y, z):
    """Tell whether rays along the axes from a place may meet what has these bounds.

    Along an axis only where the place is within the bounds on the two others.
    """
    on_x = (bounds[0, i] <= x) & (x <= bounds[3, i])
    on_y = (bounds[1, i] <= y) & (y <= bounds[4, i])
    on_z = (bounds[2, i] <= z) & (z <= bounds[5, i])
    return (on_x & on_y) | (on_y & on_z) | (on_z & on_x)


@kernel
def count_crossings(points, faces, bounds, place, out_counts):
    """Faces that the six rays from a place along the axes leave through, less those they enter."""
    x, y, z, corners = place[0], place[1], place[2], np.empty((3, 3))
    for begin in range(0, len(faces), FACES):
        if not _meets_rays(bounds, len(faces) + begin // FACES, x, y, z):
            continue
        for f in range(begin, min(begin + FACES, len(faces))):
            if not _meets_rays(bounds, f, x, y, z):
                continue
            for axis in range(3):
                u, v = (axis + 1) % 3, (axis + 2) % 3
                if (
                    bounds[u, f] <= place[u] <= bounds[3 + u, f]
                    and bounds[v, f] <= place[v] <= bounds[3 + v, f]
                ):
                    for j in range(3):
                        for k in range(3):
                            corners[j, k] = points[faces[f, j], k] - place[k]
                    _cross(corners, axis, out_counts)
