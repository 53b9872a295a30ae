"""Kernels of walls: calipers between two patches of faces, fields by balls, low places of fields.

1. Calipers (`thin_spots.py`): the faces of a side, and the smallest ball between two patches. A
   vertex of a patch is a place with its normal, six numbers.
2. The feature transform (`thickness.py`): values of balls gathered at the samples they touch.
3. Low places (`thin_spots.py`): minima and sublevel sets of a field on a graph. A vertex is lower
   than another one by its value, then by the field, then by its number.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base._box_tree_kernels import nearest_place
from medialis.base._kernels import find_root
from medialis.base.jit import kernel

PARALLEL = 1e-12
"""Part of the product of squared lengths: edges without a closest place."""

MINIMUM, MAXIMUM, SUM = 0, 1, 2


class Mesh(NamedTuple):
    """A triangle mesh; face f is next to adjacency[f, j] across its side j, -1 for none.

    Attributes
    ----------
    points, normals : (n, 3) float64
    faces : (m, 3) int32
    face_normals : (m, 3) float64
    adjacency : (m, 3) int32
    """

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    faces: NDArray[np.int32]
    face_normals: NDArray[np.float64]
    adjacency: NDArray[np.int32]


class Patch(NamedTuple):
    """A patch of faces with vertices of its own.

    Attributes
    ----------
    vertices : (v, 6) float64
        Place and normal: of the smooth surface, but at a crease of the faces of the patch alone.
    faces : (f, 3) int64
    edges : (e, 2) int64
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    edges: NDArray[np.int64]


class Search(NamedTuple):
    """The search for the smallest ball between two patches.

    Attributes
    ----------
    before : (2, 3) float64
        Of equal balls that with its ends next to these is taken.
    across : float
        Least cosine of normals and the line between the ends.
    touching : float
        Length up to which places touch.
    equal : float
        Share up to which diameters are equal.
    best : (3,) float64
        The smallest diameter, that of the ball that is taken, and how far that one is off.
    ends : (2, 3) float64
        Of the ball that is taken.
    foot, corner : (6,) float64
        Room for two places.
    """

    before: NDArray[np.float64]
    across: float
    touching: float
    equal: float
    best: NDArray[np.float64]
    ends: NDArray[np.float64]
    foot: NDArray[np.float64]
    corner: NDArray[np.float64]


class Links(NamedTuple):
    """A graph: the neighbours of vertex v are neighbours[first[v]:last[v]], each link twice."""

    first: NDArray[np.int32]
    last: NDArray[np.int32]
    neighbours: NDArray[np.int32]


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
def _offer(a, b, search):
    """Take the ball between two places if it is smaller, or equal and nearer to those before."""
    before, best = search.before, search.best
    diameter, equal = _measure(a, b, search.across, search.touching), 1.0 + search.equal
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
            search.ends[0, axis], search.ends[1, axis] = a[axis], b[axis]


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
def try_corners(patch, other, swapped, search):
    """Offer each vertex of the other patch with the place of each face that is nearest to it.

    No ball is smaller than its two places are apart, so faces whose sphere is farther from a vertex
    than the smallest ball is wide are left out. `swapped`: the patch is the second one.
    """
    vertices, faces, others = patch.vertices, patch.faces, other.vertices
    best, foot, corner = search.best, search.foot, search.corner
    first, second = (corner, foot) if swapped else (foot, corner)
    spheres = _spheres(vertices, faces)
    for v in range(len(others)):
        for part in range(6):
            corner[part] = others[v, part]
        for f in range(len(faces)):
            away = 0.0
            for axis in range(3):
                step = corner[axis] - spheres[f, axis]
                away += step * step
            if math.sqrt(away) > (best[0] * (1.0 + search.equal) + spheres[f, 3]) * (1.0 + 1e-9):
                continue
            a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
            s, t, _ = nearest_place(corner[0], corner[1], corner[2], vertices, a, b, c)
            for part in range(6):
                place = (1.0 - s - t) * vertices[a, part] + s * vertices[b, part]
                foot[part] = place + t * vertices[c, part]
            _offer(first, second, search)


@kernel
def try_edges(patch, other, search):
    """Offer the closest places of each pair of edges, where they lie within both."""
    vertices, edges, p, q = patch.vertices, patch.edges, search.foot, search.corner
    others, other_edges = other.vertices, other.edges
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
            _offer(p, q, search)


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
def _bends_outward(one, other, mesh, convex):
    """Tell whether a face and one across a side of it bend outward, by more than a cosine."""
    points, faces, face_normals = mesh.points, mesh.faces, mesh.face_normals
    bend, ahead = 0.0, 0.0
    for axis in range(3):
        bend += face_normals[one, axis] * face_normals[other, axis]
        middle = 0.0
        for j in range(3):
            middle += points[faces[other, j], axis]
        ahead += face_normals[one, axis] * (middle / 3.0 - points[faces[one, 0], axis])
    return bend < convex and ahead < 0.0


@kernel
def list_side(near, seeds, outward, mesh, leaning, convex, marked, out):
    """List the faces near some seeds that are of the same side of a wall; returns how many.

    They lean less than `leaning` (a cosine) from outward, and no convex edge lies between them.
    `marked` (m,) is all 0, before and after. `out` has room for all that are near.
    """
    for i in range(len(near)):
        lean = 0.0
        for axis in range(3):
            lean += mesh.face_normals[near[i], axis] * outward[axis]
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
            other = mesh.adjacency[face, j]
            if other < 0 or marked[other] != 1:
                continue
            if not _bends_outward(face, other, mesh, convex):
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
def fill_patch(patch, corners, mesh, steep, known, out_vertices, out_faces, out_edges):
    """Give a patch vertices of its own, in the order of its corners.

    A vertex is a place and a normal: that of the shape, but where a face leans more than `steep` (a
    cosine) from it the mean of those of the patch. An edge is one number: the lower end times the
    number of corners, and the higher one. `known` (n,) is all 0, before and after.
    """
    points, normals, faces, face_normals, _ = mesh
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


@kernel
def gather_at_features(features, values, how, out_values, out_counts):
    """Reduce the values of all balls at their feature points; NaN values and index -1 are left out.

    One pass over the k balls in their order: 2 ms for 194k balls (sorting by sample takes 19), so
    one thread is enough, and sums are the same bits on any number of them.
    """
    for i in range(len(features)):
        value = values[i]
        if np.isnan(value):
            continue
        for j in range(2):
            at = features[i, j]
            if at < 0:
                continue
            if out_counts[at] == 0:
                out_values[at] = value
            elif how == MINIMUM:
                out_values[at] = min(out_values[at], value)
            elif how == MAXIMUM:
                out_values[at] = max(out_values[at], value)
            else:
                out_values[at] += value
            out_counts[at] += 1


@kernel
def take_out(pairs, times, links):
    """Take links out of a graph; `times` says how often each one is in it."""
    first, last, neighbours = links
    for i in range(len(pairs)):
        for j in range(2):
            v, w = pairs[i, j], pairs[i, 1 - j]
            for at in range(first[v], last[v]):
                if neighbours[at] != w:
                    continue
                times[at] -= 1
                if times[at] == 0:
                    last[v] -= 1
                    neighbours[at], times[at] = neighbours[last[v]], times[last[v]]
                break


@kernel
def third_lowest(values, links, out):
    """Find the third lowest value of each vertex and its neighbours; the highest of fewer than 3.

    One or two samples that are far too low vanish; a line of low samples (a groove has itself and
    two neighbours in it) keeps its depth.
    """
    first, last, neighbours = links
    for v in range(len(values)):
        lowest, second, third = values[v], np.inf, np.inf
        for at in range(first[v], last[v]):
            value = values[neighbours[at]]
            if value < lowest:
                lowest, second, third = value, lowest, second
            elif value < second:
                second, third = value, second
            elif value < third:
                third = value
        count = last[v] - first[v] + 1
        out[v] = lowest if count == 1 else (second if count == 2 else third)


@kernel
def _lower(v, w, values, field):
    if values[v] != values[w]:
        return values[v] < values[w]
    if field[v] != field[w]:
        return field[v] < field[w]
    return v < w


@kernel
def find_basins(values, field, links, out_basin):
    """Find the minimum that each vertex descends to, always to the lowest neighbour."""
    n, (first, last, neighbours) = len(values), links
    for v in range(n):
        down = v
        for at in range(first[v], last[v]):
            if _lower(neighbours[at], down, values, field):
                down = neighbours[at]
        out_basin[v] = down
    for v in range(n):
        root = v
        while out_basin[root] != root:
            root = out_basin[root]
        while out_basin[v] != root:
            out_basin[v], v = root, out_basin[v]


@kernel
def list_passes(basin, values, field, links, out_passes):
    """List the links between basins, the higher end first; returns how many, at most all links."""
    count, (first, last, neighbours) = 0, links
    for v in range(len(basin)):
        for at in range(first[v], last[v]):
            w = neighbours[at]
            if basin[v] != basin[w] and _lower(w, v, values, field):
                out_passes[count, 0], out_passes[count, 1] = v, w
                count += 1
    return count


@kernel
def climbs(passes, basin, values, field, out_heights):
    """Heights to which one climbs from each minimum before reaching a lower one; 0 elsewhere.

    Basins join at the passes, in rising order. `basin` becomes that of the joined ones: it is known
    by its lowest vertex. Where two meet at the height L, the one with the higher minimum ends. The
    lowest minimum of what hangs together has the largest finite height there.
    """
    for i in range(len(passes)):
        a, b = find_root(basin, passes[i, 0]), find_root(basin, passes[i, 1])
        if a == b:
            continue
        low, high = (a, b) if _lower(a, b, values, field) else (b, a)
        basin[high] = low
        out_heights[high] = values[passes[i, 0]]
    for v in range(len(basin)):
        root = find_root(basin, v)
        if values[v] < math.inf:
            out_heights[root] = max(out_heights[root], values[v])


@kernel
def flood_below(start, level, values, links, label, out_label, out_vertices):
    """Label the piece of {values < level} that holds `start`; return how many vertices it has.

    They are listed in `out_vertices` (room for n), which is the queue of the search as well.
    """
    first, last, neighbours = links
    out_vertices[0] = start
    out_label[start] = label
    count, done = 1, 0
    while done < count:
        v = out_vertices[done]
        done += 1
        for at in range(first[v], last[v]):
            w = neighbours[at]
            if out_label[w] < 0 and values[w] < level:
                out_label[w] = label
                out_vertices[count] = w
                count += 1
    return count
