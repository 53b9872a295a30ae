"""Level sets of the distance along a surface, as a graph of contours and of the bands between.

The distance counts in radii of the limb: one along a finger as long as thick, a hundred along a
thread a hundred times as long as thick. So the contours follow the shape at the scale of each limb,
however thin it is against the whole, and their number grows with the length of the skeleton over
its radius (deviation from thesis 3.6, whose candidates have one scale for the whole shape).

Contours are closed curves across the triangles, exact for the distance interpolated between the
vertices. A band is a connected part of the surface between two levels. Bands as vertices and
contours as edges are the Reeb graph of the distance: one contour follows another along a limb, a
band with three or more contours is a fork, one with a single contour has a tip, and each handle of
the surface is a loop. Source: Lazarus, Verroust, "Level set diagrams of polyhedral objects", SMA
1999; Cole-McLaughlin et al., "Loops in Reeb graphs of 2-manifolds", SoCG 2003.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from medialis.base.arrays import Index, Mask, weighted_graph
from medialis.base.validation import FloatArray, IntArray
from medialis.shape.surface import SolidBoundary, piece_labels

LEVELS_A_RADIUS = 3.0
"""Contours along one radius of a limb."""

LONGEST_EDGE = 32.0
"""Maximum number of radii that an edge counts: a tube of a few long triangles is straight."""


@dataclass(frozen=True, eq=False)
class LevelSets:
    """Contours of the distance along the closed boundary of a mesh, and the bands between them.

    Attributes
    ----------
    boundary : SolidBoundary
        p points, q faces.
    distance : (p,) float64
        In radii of the limb, from one tip of each piece of the boundary.
    piece : (p,) int32
        Connected piece of the boundary.
    segments : (s, 2, 3) float64
        Ends of the segments of contours, which go round on the same side as seen along the
        distance.
    contour : (s,) int64
        Contour of each segment.
    centers : (c, 3) float64
        Centroid of each contour, by length.
    perimeters : (c,) float64
    bands : (c, 2) int64
        The band before each contour and the one behind it.
    band_of_point : (p,) int64
        -1 for points without faces.
    band_count : int
        Number of bands; some have no point.
    spacing : (p,) float64
        Mean length of the edges at each point.
    """

    boundary: SolidBoundary
    distance: FloatArray
    piece: IntArray
    segments: FloatArray
    contour: Index
    centers: FloatArray
    perimeters: FloatArray
    bands: Index
    band_of_point: Index
    band_count: int
    spacing: FloatArray


def level_sets(boundary: SolidBoundary) -> LevelSets:
    """Cut the boundary of a solid along levels of the distance from a tip of each piece.

    The radius of a limb is that of a circle with the perimeter of its contours; in a first pass,
    by which these are found, twice the length of the edges.
    """
    edges, edge_of = _edges(boundary)
    spacing = _mean_lengths(boundary, edges)
    radii = 2.0 * spacing
    levels = _level_sets(boundary, edges, edge_of, radii, spacing)
    return _level_sets(boundary, edges, edge_of, _section_radii(levels, radii), spacing)


def _mean_lengths(boundary: SolidBoundary, edges: Index) -> FloatArray:
    """Return the mean length of the edges at each point, (p,)."""
    length, n = _lengths(boundary, edges), len(boundary.points)
    total = np.bincount(edges.ravel(), np.repeat(length, 2), n)
    return np.asarray(total / np.maximum(np.bincount(edges.ravel(), minlength=n), 1))


def _lengths(boundary: SolidBoundary, edges: Index) -> FloatArray:
    a, b = boundary.points[edges.T]
    return np.asarray(np.linalg.norm(a - b, axis=1))


def _section_radii(levels: LevelSets, before: FloatArray) -> FloatArray:
    """Return the radius of the largest contour of the band of each point, (p,)."""
    largest = np.zeros(levels.band_count)
    for bands in levels.bands.T:
        np.maximum.at(largest, bands, levels.perimeters / (2.0 * np.pi))
    known = levels.band_of_point >= 0
    found = np.where(known, largest[levels.band_of_point], 0.0)
    return np.where(found > 0.0, found, before)


def _level_sets(
    boundary: SolidBoundary, edges: Index, edge_of: Index, radii: FloatArray, spacing: FloatArray
) -> LevelSets:
    """Cut the boundary along levels of the distance in given radii (p,)."""
    distance, piece = _distances(boundary, edges, radii)
    value = distance * LEVELS_A_RADIUS + 0.5
    band = np.floor(value).astype(np.int64)
    corners, sides, turned = _sorted_faces(boundary.faces.astype(np.int64), value, edge_of)
    ends = np.sort(band[edges], axis=1)
    bands = band[corners]
    crossings, levels = _crossings(boundary.points, edges, value, ends)
    # A segment of a contour leads from the side between the lowest and the highest corner of a face
    # to one of the others.
    face, level = _Levels(bands[:, 0], bands[:, 2]).all()
    other = np.where(level < bands[face, 1], sides[face, 0], sides[face, 1])
    pairs = np.column_stack([levels.number(sides[face, 2], level), levels.number(other, level)])
    contour = _numbered(piece_labels(levels.total, pairs))[pairs[:, 0]]
    back = turned[face]  # seen along the distance, all segments go round on the same side
    pairs[back] = pairs[back, ::-1]
    segments = crossings[pairs]
    centers, perimeters = _centroids(segments, contour)
    strips, strip = _strips(bands, sides, ends)
    at, beside = strips.number(face, level), np.zeros((len(centers), 2), np.int64)
    beside[contour] = np.column_stack([strip[at], strip[at + 1]])
    of_point = np.full(len(boundary.points), -1)
    for corner, own in zip(corners.T, bands.T, strict=True):
        of_point[corner] = strip[strips.number(np.arange(len(corner)), own)]
    count = int(strip.max(initial=-1)) + 1
    known = boundary, distance, piece, segments, contour, centers, perimeters
    return LevelSets(*known, beside, of_point, count, spacing)


def _sorted_faces(faces: Index, value: FloatArray, edge_of: Index) -> tuple[Index, Index, Mask]:
    """Return the corners of faces from the lowest to the highest, and the sides between them.

    Sides are those from the lowest to the middle corner, from the middle to the highest, and from
    the lowest to the highest, (q, 3). True for faces whose corners change their sense of rotation.
    """
    order = np.argsort(value[faces], axis=1, kind="stable")
    corners = np.take_along_axis(faces, order, axis=1)
    opposite = order[:, [2, 0, 1]]  # side j of a face starts at corner j: after the opposite one
    sides = edge_of.reshape(-1, 3)[np.arange(len(faces))[:, None], (opposite + 1) % 3]
    return corners, sides, (order[:, 1] - order[:, 0]) % 3 != 1


def _crossings(
    points: FloatArray, edges: Index, value: FloatArray, ends: Index
) -> tuple[FloatArray, _Levels]:
    """Return the points where edges cross levels, and their numbers by edge and level."""
    levels = _Levels(ends[:, 0], ends[:, 1])
    edge, level = levels.all()
    a, b = edges[edge].T
    share = (level + 1.0 - value[a]) / (value[b] - value[a])
    return points[a] + share[:, None] * (points[b] - points[a]), levels


def _centroids(segments: FloatArray, contour: Index) -> tuple[FloatArray, FloatArray]:
    """Return the centroid by length and the length of each contour."""
    count = int(contour.max(initial=-1)) + 1
    length = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1)
    perimeters = np.bincount(contour, length, count)
    weight = length + 1e-12 * perimeters[contour] + 1e-300  # contours of a single point
    total, middles = np.bincount(contour, weight, count), segments.mean(axis=1)
    centers = [np.bincount(contour, weight * middles[:, k], count) / total for k in range(3)]
    return np.stack(centers, axis=1), perimeters.astype(np.float64)


class _Levels:
    """Numbers for pairs of an item and a level, for items that pass several levels.

    Level k is between the bands k and k + 1; item i passes those from `low` to `high`.
    """

    def __init__(self, low: Index, high: Index) -> None:
        self.low, self.count = low, high - low
        self.first = np.concatenate([[0], np.cumsum(self.count)])
        self.total = int(self.first[-1])

    def number(self, items: Index, level: Index) -> Index:
        """Return the number of each pair."""
        return np.asarray(self.first[items] + level - self.low[items])

    def all(self) -> tuple[Index, Index]:
        """Return the item and the level of each number."""
        items = np.repeat(np.arange(len(self.low)), self.count)
        return items, np.arange(self.total) - self.first[items] + self.low[items]


def _edges(boundary: SolidBoundary) -> tuple[Index, Index]:
    """Return the ends (e, 2) of all edges, and the edge of each half-edge (3q,)."""
    once = boundary.twins > np.arange(len(boundary.twins))
    edge_of = np.empty(len(once), np.int64)
    edge_of[once] = np.arange(np.count_nonzero(once))
    edge_of[boundary.twins[once]] = edge_of[once]
    faces = boundary.faces.astype(np.int64)
    return np.column_stack([faces.ravel()[once], np.roll(faces, -1, axis=1).ravel()[once]]), edge_of


def _distances(
    boundary: SolidBoundary, edges: Index, radii: FloatArray
) -> tuple[FloatArray, IntArray]:
    """Return the distance of each point from a tip of its piece, in radii, and the pieces."""
    from scipy.sparse.csgraph import dijkstra

    n = len(boundary.points)
    piece, length = piece_labels(n, edges), _lengths(boundary, edges)
    least = 1e-12 * max(float(length.max(initial=0.0)), 1e-300)
    a, b = np.maximum(radii, least)[edges.T]
    steps = np.clip(0.5 * length * (1.0 / a + 1.0 / b), 1e-9, LONGEST_EDGE)
    both = np.concatenate([edges, edges[:, ::-1]]).T
    graph = weighted_graph(np.tile(steps, 2), both[0], both[1], n)
    starts = np.unique(piece, return_index=True)[1]
    for _ in range(2):  # from any point to a farthest one, and from there
        distance = np.asarray(dijkstra(graph, indices=starts, min_only=True))
        order = np.lexsort((distance, piece))
        starts = order[np.append(np.flatnonzero(np.diff(piece[order])), n - 1)]
    return distance, piece


def _strips(bands: Index, sides: Index, ends: Index) -> tuple[_Levels, Index]:
    """Return the numbers of the parts of faces between levels, and the band of each.

    Parts hang together across the part of a side that is in the same band.
    """
    strips, parts = _Levels(bands[:, 0], bands[:, 2] + 1), _Levels(ends[:, 0], ends[:, 1] + 1)
    face, band = strips.all()
    links = []
    for side, (low, high) in zip(sides.T, ((0, 1), (1, 2), (0, 2)), strict=True):
        inside = (band >= bands[face, low]) & (band <= bands[face, high])
        number = parts.number(side[face[inside]], band[inside])
        links.append(np.column_stack([np.flatnonzero(inside), strips.total + number]))
    label = piece_labels(strips.total + parts.total, np.concatenate(links))[: strips.total]
    return strips, _numbered(label)


def _numbered(labels: IntArray) -> Index:
    """Return labels renamed to 0, 1, ... in their order."""
    return np.unique(labels, return_inverse=True)[1].astype(np.int64)
