"""Clean rims: slits of a skeleton mesh are closed, its saw-teeth cut off, its rims smoothed.

A skeleton mesh ends where a triangle of the surface has a corner without a usable ball. So its rim
runs along the edges of the samples, and where sheets meet, or single balls are false, holes and
slits remain. The **rim** are the edges of one triangle. Three things are done to it, in this order:

1. *Gaps are closed.* Where two edges of the rim turn back sharply, with the sheet around them, the
   triangle between them is added: this zips slits from their ends and fills notches. Holes of few
   edges are closed altogether. A triangle is added only where the balls at its corners cover it, so
   it lies inside the shape, and no true hole is closed: at a wall balls do not cover.
2. *Teeth are cut off.* A triangle with two edges of the rim that meet at a sharp tip is dropped,
   `TEETH` times over, so that limbs lose no more than so many triangles at their tips.
3. *Rims are smoothed.* Every point of the rim moves to a weighted mean of balls along the rim
   (Taubin 1995: no shrinking), unless it would leave the sheet outwards and its own ball. Where the
   rim is known (`fixed`: creases, Y-curves) it stays. The weights are kept
   (`Blend`): radius and any other number of a point there are the same mean.

All steps are array operations on the rim alone.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import EdgeTable, Index, Mask
from medialis.base.validation import FloatArray, IntArray, frozen
from medialis.shape.surface import Surface
from medialis.skeleton._ball_kernels import cover

SHARP = 1.4
"""Length of two edges over that of the third side: tips and notches of less than 91 degrees."""

WIDEST = 2.0
"""Sample spacings: the widest gap that is zipped."""

FEW = 16
"""Edges of holes that are closed whatever their form."""

ZIPS = 24
"""Rounds of closing: a slit gets shorter by one edge from each end in each."""

TEETH = 2
"""Rounds of cutting teeth off."""

ROUNDS = 12
"""Times that points move to the middle of their neighbours by two shares in turn."""

INWARD, OUTWARD = 0.5, -0.51
"""The two shares."""


class Blend(NamedTuple):
    """Weights of balls at points of a rim; those of a point are 1 together, some below 0.

    Attributes
    ----------
    points, rows : (w,) int32
        Point and ball of each weight.
    weights : (w,) float64
    """

    points: IntArray
    rows: IntArray
    weights: FloatArray


class Rims(NamedTuple):
    """A mesh with clean rims.

    Attributes
    ----------
    kept : (p,) int32
        Rows of the given points that triangles still use.
    faces : (t, 3) int32
        Between these: of the given ones those that stayed, in their order, then those that close
        gaps.
    origin : (t,) int64
        Row of the given face that each one is or lies beside.
    blend : Blend
        Of the points that moved, the weights of given points.
    """

    kept: IntArray
    faces: IntArray
    origin: Index
    blend: Blend

    def at_points(self, values: NDArray[Any]) -> FloatArray:
        """Return numbers (n,) or (n, d) of the given points at these."""
        known = np.asarray(values, np.float64)
        return blended(known[self.kept], known, self.blend)


def blended(given: FloatArray, values: FloatArray, blend: tuple[Any, ...]) -> FloatArray:
    """Return what is given for each point, but for those of clean rims the mean of the values."""
    points, rows, weights = blend
    result = np.array(given)
    result[points] = 0.0
    np.add.at(result, points, weights.reshape(-1, *(1,) * (values.ndim - 1)) * values[rows])
    return result


class _Rim:
    """The rim as it changes: a node for each fan of triangles at a point of the rim.

    Where rims touch, or a rim touches the inside of a sheet, a point has several nodes. A node has
    two neighbours along the rim, or one where its sheet ends on a seam of three or more: -1.

    Attributes
    ----------
    point : (v,) int64
        Point of each node.
    near : (v, 2) int64
    count, total : (v,) int64
        Faces at each node, and the sum of their numbers.
    """

    def __init__(self, mesh: Surface) -> None:
        points, faces, table = np.asarray(mesh.points), np.asarray(mesh.faces), mesh.edge_table
        n, faces = len(points), faces.astype(np.int64)
        single = table.counts == 1
        self.keys = table.low.astype(np.int64) * n + table.high
        at_rim = np.zeros(n, np.bool_)
        at_rim[table.ends[single]] = True
        self.points, self.faces = points, faces
        node = _fans(faces, table, at_rim)  # of each corner, -1 inside
        self.point = np.zeros(node.max(initial=-1) + 1, np.int64)
        known = node >= 0
        self.point[node[known]] = faces.ravel()[known]
        v = len(self.point)
        self.count = np.bincount(node[known], minlength=v)
        face = np.flatnonzero(known) // 3
        self.total = np.bincount(node[known], face.astype(np.float64), v).astype(np.int64)
        half = table.order[table.first[:-1][single]].astype(np.int64)
        face, side = np.divmod(half, 3)
        a, b = node[half], node[3 * face + (side + 1) % 3]
        ends, others = np.concatenate([a, b]), np.concatenate([b, a])
        order = np.argsort(ends, kind="stable")
        ends, others = ends[order], others[order]
        first = np.searchsorted(ends, np.arange(v))
        self.near = np.full((v, 2), -1, np.int64)
        self.near[ends, np.arange(len(ends)) - first[ends]] = others
        # Towards the sheet, across the edges of the rim.
        across = _across(self.at(a), self.at(b), points[faces[face, (side + 2) % 3]])
        self.inward = np.zeros((v, 3))
        for end in (a, b):
            np.add.at(self.inward, end, across)

    def at(self, nodes: Index) -> FloatArray:
        """Return where nodes are."""
        return self.points[self.point[nodes]]

    def corners(self) -> tuple[Index, Index, Index]:
        """Return the nodes in the middle of two edges, between their neighbours."""
        middle = np.flatnonzero((self.near >= 0).all(axis=1))
        a, c = self.near[middle].T
        usable = self.point[a] != self.point[c]
        return a[usable], middle[usable], c[usable]

    def ratio(self, a: Index, b: Index, c: Index) -> tuple[FloatArray, FloatArray]:
        """Return the way over b against the straight one, and the length of this."""
        middle, straight = self.at(b), _norm(self.at(a) - self.at(c))
        way = _norm(self.at(a) - middle) + _norm(self.at(c) - middle)
        return way / np.maximum(straight, 1e-300), straight

    def cut_short(self, a: Index, b: Index, c: Index) -> None:
        """Take the nodes b out of the rim: it runs from a to c."""
        for one, other in ((a, c), (c, a)):
            self.near[one, np.where(self.near[one, 0] == b, 0, 1)] = other
        self.near[b] = -1
        closed = self.near[a, 0] == self.near[a, 1]  # a hole of two edges is none
        self.near[a[closed]] = self.near[c[closed]] = -1


def _fans(faces: Index, table: EdgeTable, at_rim: Mask) -> Index:
    """Return the fan of each corner of the faces at a point of the rim, (3t,); -1 elsewhere.

    Triangles with an edge in common are in one fan, unless a third one has it as well.
    """
    from scipy import sparse

    corner = np.flatnonzero(at_rim[faces.ravel()])
    place = np.full(faces.size, -1, np.int64)
    place[corner] = np.arange(len(corner))
    double = np.flatnonzero((table.counts == 2) & at_rim[table.ends].any(axis=1))
    one, other = (table.order[table.first[double] + k].astype(np.int64) for k in (0, 1))
    start = [place[half] for half in (one, other)]
    end = [place[half - half % 3 + (half + 1) % 3] for half in (one, other)]
    same = table.forward[one] == table.forward[other]
    pairs = [
        np.stack([start[0], np.where(same, start[1], end[1])], axis=1),
        np.stack([end[0], np.where(same, end[1], start[1])], axis=1),
    ]
    links = np.concatenate(pairs)
    links = links[(links >= 0).all(axis=1)]
    shape = (len(corner), len(corner))
    graph = sparse.coo_array((np.ones(len(links), np.int8), tuple(links.T)), shape=shape)
    _, fan = sparse.csgraph.connected_components(graph, directed=False)
    node = np.full(faces.size, -1, np.int64)
    node[corner] = fan
    return node


def _norm(vectors: FloatArray) -> FloatArray:
    return np.linalg.norm(vectors, axis=1)


def _across(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """Return unit vectors from the edges a b towards c, at right angles to the edges."""
    along, away = b - a, c - a
    square = np.maximum((along * along).sum(axis=1), 1e-300)
    away = away - along * ((along * away).sum(axis=1) / square)[:, None]
    return away / np.maximum(_norm(away), 1e-300)[:, None]


def _apart(rank: FloatArray, corners: Index, count: int) -> Mask:
    """Return which corners come first of all that have a node in common with them."""
    order = np.lexsort((corners[:, 1], rank))
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    best = np.full(count, len(order), np.int64)
    for ends in corners.T:
        np.minimum.at(best, ends, place)
    return (best[corners] == place[:, None]).all(axis=1)


def covered(corners: FloatArray, radii: FloatArray) -> Mask:
    """Tell which triangles (t, 3, 3) the balls at their corners cover: see `in_balls`."""
    whole = np.empty(len(corners), np.bool_)
    cover(corners, radii, whole)
    return whole


def clean_rims(
    mesh: Surface, radii: FloatArray, spacing: FloatArray, fixed: Mask | None = None
) -> Rims:
    """Close gaps, cut teeth off and smooth the rims of a mesh between the centers of balls.

    Parameters
    ----------
    mesh : Surface
        n points.
    radii, spacing : (n,) float64
        Of the balls, and of the samples near each.
    fixed : (n,) bool, optional
        Points that are where the rim truly is, such as creases and Y-curves: they stay.
    """
    n = len(mesh.points)
    fixed = np.zeros(n, np.bool_) if fixed is None else fixed
    rim = _Rim(mesh)
    added, beside = _closed(rim, radii, spacing)
    given = np.flatnonzero(_without_teeth(rim, fixed))
    faces = np.concatenate([rim.faces[given], added])
    blend = _smoothed(rim, radii, fixed)
    used = np.zeros(n, np.bool_)
    used[faces] = True
    place, chosen = np.cumsum(used, dtype=np.int32) - 1, used[blend.points]
    moved = Blend(place[blend.points[chosen]], blend.rows[chosen], blend.weights[chosen])
    kept = frozen(np.flatnonzero(used), np.int32)
    return Rims(kept, frozen(place[faces], np.int32), np.concatenate([given, beside]), moved)


def _closed(rim: _Rim, radii: FloatArray, spacing: FloatArray) -> tuple[Index, Index]:
    """Close slits, notches and small holes; return the triangles added, and a face beside each."""
    n, point = len(rim.points), rim.point
    new, near = [np.empty((0, 3), np.int64)], [np.empty(0, np.int64)]
    small, more = _few(rim), np.empty(0, np.int64)
    for _ in range(ZIPS):
        a, b, c = rim.corners()
        ratio, straight = rim.ratio(a, b, c)
        chord = (rim.at(a) + rim.at(c)) / 2 - rim.at(b)
        outside = np.einsum("ij,ij->i", chord, rim.inward[b]) < 0
        width = WIDEST * np.minimum(spacing[point[a]], spacing[point[c]])
        wanted = outside & (((ratio >= SHARP) & (straight <= width)) | small[b])
        key = np.minimum(point[a], point[c]) * n + np.maximum(point[a], point[c])
        wanted &= (rim.near[a] == c[:, None]).any(axis=1) | ~(
            _among(rim.keys, key) | _among(more, key)
        )
        a, b, c, straight = (x[wanted] for x in (a, b, c, straight))
        corners = np.stack([a, b, c], axis=1)
        good = covered(rim.points[point[corners]], radii[point[corners]])
        corners = corners[good]
        corners = corners[_apart(straight[good], corners, len(point))]
        if not len(corners):
            break
        a, b, c = corners.T
        new.append(point[corners])
        near.append(b)
        ends = np.sort(point[corners[:, [0, 2]]], axis=1)
        more = np.sort(np.concatenate([more, ends[:, 0] * n + ends[:, 1]]))
        across = _across(rim.at(a), rim.at(c), rim.at(b))
        rim.cut_short(a, b, c)
        for end in (a, c):
            rim.inward[end] += across
            rim.count[end] += 1
    added, beside = np.concatenate(new), np.zeros(n, np.int64)
    beside[rim.faces.ravel()] = np.repeat(np.arange(len(rim.faces)), 3)
    return added, beside[added[:, 1]]


def _among(rising: Index, keys: Index) -> Mask:
    """Tell which keys are among those in rising order."""
    place = np.searchsorted(rising, keys)
    return np.append(rising, -1)[place] == keys


def _few(rim: _Rim) -> Mask:
    """Return which nodes lie on a hole of few edges."""
    from scipy import sparse

    v = len(rim.point)
    rows, columns = np.nonzero(rim.near >= 0)
    ends = rows, rim.near[rows, columns]
    links = sparse.coo_array((np.ones(len(rows), np.int8), ends), shape=(v, v))
    count, piece = sparse.csgraph.connected_components(links, directed=False)
    size = np.bincount(piece, minlength=count)
    ends_on_seam = np.bincount(piece, (rim.near < 0).any(axis=1), minlength=count)
    return ((size <= FEW) & (ends_on_seam == 0))[piece]


def _without_teeth(rim: _Rim, fixed: Mask) -> Mask:
    """Cut sharp teeth off; return which of the given faces stay."""
    stays = np.ones(len(rim.faces), np.bool_)
    for _ in range(TEETH):
        a, b, c = rim.corners()
        ratio, _ = rim.ratio(a, b, c)
        # A node with one face, which is that of its two edges and not one of those added.
        own = (rim.count[b] == 1) & (ratio >= SHARP) & (rim.count[a] > 1) & (rim.count[c] > 1)
        own &= ~fixed[rim.point[b]]
        a, b, c, ratio = (x[own] for x in (a, b, c, ratio))
        face = rim.total[b]
        corners = np.stack([a, b, c], axis=1)
        chosen = _apart(-ratio, corners, len(rim.point))
        face, corners = face[chosen], corners[chosen]
        if not len(corners):
            break
        stays[face] = False
        rim.cut_short(*corners.T)
        for end in corners.T:
            rim.count[end] -= 1
            rim.total[end] -= face
    return stays


def _smoothed(rim: _Rim, radii: FloatArray, fixed: Mask) -> Blend:
    """Return the weights of the given points at the smoothed ones."""
    from scipy import sparse

    n, point = len(rim.points), rim.point
    node, place = np.nonzero(rim.near >= 0)
    rows, columns = point[node], point[rim.near[node, place]]
    two = np.bincount(rows, minlength=n)[rows] == 2  # where rims touch or end, they stay
    two &= ~fixed[rows]
    rows, columns = rows[two], columns[two]
    used = np.unique(np.concatenate([rows, columns]))
    place = np.full(n, -1, np.int64)
    place[used] = np.arange(len(used))
    rows, columns, size = place[rows], place[columns], len(used)
    own = np.unique(rows)
    entries = np.concatenate([np.full(len(rows), 0.5), np.full(len(own), -1.0)])
    ends = np.concatenate([rows, own]), np.concatenate([columns, own])
    to_middle = sparse.csr_array((entries, ends), shape=(size, size))
    blend = sparse.eye_array(size, format="csr")
    for share in (INWARD, OUTWARD) * ROUNDS:
        blend = blend + share * (to_middle @ blend)
    step = blend @ rim.points[used] - rim.points[used]
    towards = np.zeros((n, 3))
    np.add.at(towards, point, rim.inward)
    moved = _norm(step) <= radii[used]
    moved |= np.einsum("ij,ij->i", step, towards[used]) > 0
    moved &= np.bincount(rows, minlength=size) > 0
    kept = blend.tocoo()
    chosen = moved[kept.coords[0]]
    points, rows = (frozen(used[at[chosen]], np.int32) for at in kept.coords)
    return Blend(points, rows, frozen(kept.data[chosen], np.float64))
