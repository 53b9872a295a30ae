"""Importance of skeleton points: geodesics between feature points, and thresholds (thesis 3.3).

`geodesic_importance` traces the path of each ball. Where the surface is folded or has holes, no
plane cut comes near the shortest path of some pairs, while neighbouring pairs do well. From the
feature points of one ball one can go along an edge to those of the neighbouring ball, and take its
geodesic: that path is real, and where it is shorter it is taken (`relax`). It also makes the
importance continuous: it changes by at most the distance between the feature points.

`connected_importance` makes thresholding leave no islands. The thesis notes that the geodesic
importance is monotone in practice, not by construction: a foot that is wider than its leg stays
when the leg has gone. A small island of that kind is lowered to the importance at which it joins
the larger piece; a large one keeps its importance, and the best path that joins the two is raised
to it.

`important_points` applies a threshold; `local_measures` need no surface.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace

import numpy as np

from medialis.base.arrays import Index, Mask, along_space, follow
from medialis.base.errors import InvalidShapeError
from medialis.base.kept import kept
from medialis.base.options import Options, algorithm, length
from medialis.base.progress import Progress
from medialis.base.threads import run_patiently
from medialis.base.validation import FloatArray, IntArray, frozen
from medialis.skeleton.importance.geodesics import (
    GeodesicOptions,
    GeodesicPaths,
    PathStatus,
    as_pairs,
    surface_walk,
    trace,
)
from medialis.skeleton.medial_cloud import Balls, MedialCloud
from medialis.skeleton.surface_skeleton import as_cloud

LARGE_ISLAND = 0.002  # halved 8 %, doubled 6 %
"""Share of the skeleton points from which an island is worth a bridge: at most 500 bridges."""


@dataclass(frozen=True, eq=False, repr=False)
class Importance(GeodesicPaths):
    """Geodesics between the feature points of the balls of a cloud: their lengths are importance.

    Attributes
    ----------
    cloud : MedialCloud
        The k skeleton points. After `medialis.connected_importance`, ``length`` is lower than the
        path on islands, and higher on bridges.
    """

    cloud: MedialCloud = field(kw_only=True)


@dataclass(frozen=True, kw_only=True)
class ConnectOptions(Options):
    """Options of `connected_importance`."""

    link: float = length(
        0.02,
        "Longest link",
        "Neighbours whose centers are further apart than this share of the size come last.",
        low=1e-9,
        advanced=True,
    )


@algorithm(ConnectOptions)
def connected_importance(
    importance: Importance, options: ConnectOptions, progress: Progress
) -> Importance:
    """Change the importance so that no threshold leaves islands.

    Two skeleton points are linked when their samples share an edge of the mesh, or one is the
    second feature point of the other; and the most important of a neighbourhood across the others,
    up to three edges, since on a rough surface most balls belong to noise. Above any threshold the
    points of the result hang together by links, in one piece for each piece of the shape. Links
    longer than `link` come last: a small piece that only they reach gets importance 0.

    Parameters
    ----------
    importance : Importance
        `geodesic_importance` of the whole inner cloud of a mesh: row i belongs to vertex i.

    Returns
    -------
    Importance
        The same paths; ``length`` (n,) is lower on small islands, higher on the bridges to large
        ones, and NaN where the given one is.

    Raises
    ------
    InvalidShapeError
        When the cloud is not the whole inner cloud of its surface.

    See Also
    --------
    geodesic_importance, important_points

    Notes
    -----
    Cost O(n log n). Of two pieces the one with fewer points is the island; it is large from 0.2 %
    of the points on. A bridge is the path whose least important link is as important as can be (it
    runs in a maximum spanning tree). Not in the thesis.

    Examples
    --------
    >>> import medialis, numpy as np
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(100))
    >>> plain = medialis.geodesic_importance(cloud)
    >>> connected = medialis.connected_importance(plain)
    >>> bool(np.isclose(connected.length, plain.length).mean() > 0.9)
    True
    """
    cloud = importance.cloud
    shape, n = cloud.surface, len(cloud)
    if not cloud.whole or n > shape.point_count:
        raise InvalidShapeError(
            "Connected importance needs the whole inner cloud of the shape, "
            f"{shape.point_count} rows in their order; got {n} rows."
        )
    values = run_patiently(lambda: _connected(importance, options.link * shape.diagonal), progress)
    return replace(importance, length=values)


def _connected(importance: Importance, longest: float) -> FloatArray:
    """Return the changed lengths, (n,); links longer than `longest` come last."""
    from medialis.skeleton.importance._path_kernels import falling_links, join_pieces

    cloud = importance.cloud
    shape, n = cloud.surface, len(cloud)
    values = np.array(importance.length)
    links = np.concatenate([shape.edges, cloud.features[cloud.valid]])
    usable = (links[:, 0] != links[:, 1]) & (cloud.valid & ~np.isnan(values))[links].all(axis=1)
    links = links[usable]
    edges = links[: np.count_nonzero(usable[: len(shape.edges)])]
    links = np.concatenate([links, _across_noise(edges, values)])
    # A link is as strong as its weaker end, so the ranks of the points rank the links. Neighbours
    # that are too far apart join last, as if the link had no importance.
    falling = np.argsort(-values, kind="stable")
    rank = np.empty(n, np.int32)
    rank[falling] = np.arange(n)
    strength = np.append(values[falling], 0.0)
    level, order = falling_links(links, rank, cloud.centers, longest)
    tree, bridges = np.empty((n, 2), np.int64), np.empty((n, 2), np.int64)
    large = max(2.0, LARGE_ISLAND * np.count_nonzero(cloud.valid))
    joined, count = join_pieces(links, order, level, strength, large, values, tree, bridges)
    _raise_bridges(values, tree[:joined].astype(np.int32), bridges[:count])
    return frozen(values, np.float64)


def _across_noise(edges: IntArray, values: FloatArray) -> IntArray:
    """Link each point, and its best neighbour, to the best neighbours of its neighbours."""
    from medialis.skeleton.importance._path_kernels import best_neighbours

    best = best_neighbours(edges, values)
    ends = np.concatenate([edges, edges[:, ::-1]])
    links = np.concatenate([np.column_stack([ends[:, 0], best[ends[:, 1]]]), best[edges]])
    return links[links[:, 0] != links[:, 1]]


def _raise_bridges(values: FloatArray, tree: IntArray, bridges: Index) -> None:
    """Raise the path in the tree between each two peaks to the lower one of them, in place."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import breadth_first_order, connected_components

    n = len(values)
    graph = coo_array((np.ones(len(tree), np.int8), (tree[:, 0], tree[:, 1])), shape=(n, n)).tocsr()
    # One virtual root above one point of each part of the forest.
    heads = np.unique(connected_components(graph, directed=False)[1], return_index=True)[1]
    a = np.concatenate([tree[:, 0], np.full(len(heads), n, np.int32)])
    b = np.concatenate([tree[:, 1], heads.astype(np.int32)])
    joined = coo_array((np.ones(len(a), np.int8), (a, b)), shape=(n + 1, n + 1)).tocsr()
    parent = breadth_first_order(joined, n, directed=False)[1]
    for first, second in bridges.tolist():
        level = min(values[first], values[second])
        path, other = follow(parent, first), follow(parent, second)
        while path[-2:] == other[-2:] and len(path) > 1:  # the way that both have in common
            path.pop()
            other.pop()
        path += other[:-1]
        values[path] = np.maximum(values[path], level)


@dataclass(frozen=True, kw_only=True)
class ImportanceOptions(GeodesicOptions):
    """Options of `geodesic_importance`."""


@algorithm(ImportanceOptions, door=as_cloud)
def geodesic_importance(
    cloud: MedialCloud, options: ImportanceOptions, progress: Progress
) -> Importance:
    """Compute the importance of each skeleton point: the geodesic between its feature points.

    It grows from the boundary of the skeleton inwards, so thresholding it (`important_points`)
    removes what small bumps and noise made, and keeps the rest in one piece.

    Parameters
    ----------
    cloud : MedialCloud
        k skeleton points of a mesh.

    Returns
    -------
    Importance
        One path for each ball. Its ``length`` (k,) is the importance, in the units of the shape:
        NaN for a masked ball, +inf where the feature points lie in different components (such a
        point is always kept).

    Raises
    ------
    InvalidShapeError
        When the shape is a point cloud: use `local_measures`, which need no surface.

    See Also
    --------
    important_points : selects the points above a threshold.
    connected_importance : importance without islands at any threshold.

    Notes
    -----
    Source: thesis 3.3.1-3.3.2; see `medialis.geodesic_lengths`. Deviates: each pair of feature
    points is traced once, whichever is the first. Directions are searched
    for some. Others near by walk beside the paths found there, where no other path of
    theirs can be shorter; and where the plane of the normals has a path of less than 1.05
    times the straight line, that one is taken. Where the path through the feature points of
    neighbouring balls is shorter, it is taken (status NEIGHBOUR).

    Examples
    --------
    >>> import medialis
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(100))
    >>> importance = medialis.geodesic_importance(cloud)
    >>> simple = cloud.subset(medialis.important_points(importance, threshold=0.05))
    >>> 0 < len(simple) < len(cloud)
    True
    """
    paths = _traced(cloud, options.directions, progress)
    known = vars(run_patiently(lambda: relax(cloud, paths), progress))
    return Importance(**{f.name: known[f.name] for f in fields(GeodesicPaths)}, cloud=cloud)


def _traced(cloud: MedialCloud, directions: int, progress: Progress) -> GeodesicPaths:
    """Trace the path of each ball; that from b to a is that from a to b.

    All paths begin at the end that comes first along a Z-curve, so that those of balls on both
    sides of a wall follow each other.
    """
    pairs = np.where(cloud.valid[:, None], cloud.features, -1)
    ends = as_pairs(pairs, cloud.surface.point_count)
    code = along_space(cloud.surface.points)[ends].T
    turned = (code[0] > code[1]) | ((code[0] == code[1]) & (ends[:, 0] > ends[:, 1]))
    opposite = _opposite_balls(cloud)
    copies = turned & (opposite >= 0)
    rows = np.flatnonzero(~copies)
    once = np.where(turned[rows, None], ends[rows, ::-1], ends[rows])
    at = np.empty(len(cloud), np.int32)
    at[rows] = np.arange(len(rows))
    at[copies] = at[opposite[copies]]
    del code, pairs, ends, opposite, copies, rows  # as large as the cloud
    paths = trace(cloud.surface, np.ascontiguousarray(once), directions, True, progress)
    length, status = paths.length[at], paths.status[at]
    first, last = paths.start_tangent[at], paths.end_tangent[at]
    del paths, at
    back = np.flatnonzero(turned)
    first[back], last[back] = -last[back], -first[back]
    return GeodesicPaths(length, first, last, status)


def _opposite_balls(cloud: MedialCloud) -> Index:
    """Return for each ball the row of one that has the same feature points in turn, or -1."""
    out = np.full(len(cloud), -1)
    for side in (1, -1):
        rows = np.flatnonzero(cloud.valid & (cloud.side == side))
        starts, goals = cloud.features[rows].T
        row_of = np.full(cloud.surface.point_count, -1)
        row_of[starts] = rows
        found = row_of[goals]
        same = (found >= 0) & (cloud.features[found, 1] == starts)
        out[rows[same]] = found[same]
    return out


@dataclass(frozen=True, kw_only=True)
class ThresholdOptions(Options):
    """Options of `important_points`."""

    threshold: float = length(
        0.0,
        "Importance",
        "Keep the points whose importance is at least this share of the size. 0 keeps all; 0.01 "
        "to 0.05 removes noise and small details.",
        high=10.0,
    )


@algorithm(ThresholdOptions, keep=False)
def important_points(importance: Importance, options: ThresholdOptions, progress: Progress) -> Mask:
    """Select the skeleton points whose importance reaches a threshold.

    Parameters
    ----------
    importance : Importance
        From `geodesic_importance` or `connected_importance`; k points.

    Returns
    -------
    (k,) bool
        For ``cloud.subset(mask)``. NaN is dropped, +inf kept.

    See Also
    --------
    uniform_subsample : selects points by their distance.

    Examples
    --------
    >>> import medialis
    >>> importance = medialis.geodesic_importance(
    ...     medialis.surface_skeleton(medialis.organic_shape(56)))
    >>> bool(medialis.important_points(importance, threshold=0.05).mean() < 0.9)
    True
    """
    return np.asarray(importance.length >= options.threshold * importance.cloud.surface.diagonal)


def local_measures(cloud: MedialCloud) -> dict[str, FloatArray]:
    """Compute the importance measures that need no surface, for comparison.

    They are not monotone: thresholding them can tear the skeleton apart (thesis 3.3).

    Parameters
    ----------
    cloud : MedialCloud
        k skeleton points.

    Returns
    -------
    dict of (k,) float64
        ``spoke_angle``: radians (theta-SMA). ``radius``: of the ball. ``feature_radius``: half the
        distance of the feature points, the radius of the smallest ball that holds both (the
        lambda medial axis). ``radius_ratio``: feature_radius / radius, 0..1. NaN where masked.

    See Also
    --------
    geodesic_importance : the measure that keeps a skeleton in one piece.

    Notes
    -----
    Cost O(k). Source: thesis 3.2 and 3.3 (theta-SMA), 2.3.4 for the others.

    Examples
    --------
    >>> import medialis
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    >>> sorted(medialis.local_measures(cloud))
    ['feature_radius', 'radius', 'radius_ratio', 'spoke_angle']
    """
    points = cloud.surface.points
    # A copy: who writes into the dict that is kept would change what others get.
    return dict(
        kept(measures_of_points, cloud, None, lambda: measures_of_points(points, cloud), Progress())
    )


def measures_of_points(points: FloatArray, cloud: Balls) -> dict[str, FloatArray]:
    """Compute `local_measures` from the samples (n, 3) alone."""
    valid = cloud.valid
    half = np.full(len(cloud), np.nan)
    ends = points[cloud.features[valid]]
    half[valid] = 0.5 * np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    angle, radius = (np.where(valid, x, np.nan) for x in (cloud.spoke_angles, cloud.radii))
    ratio = np.minimum(half / radius, 1.0)
    return {"spoke_angle": angle, "radius": radius, "feature_radius": half, "radius_ratio": ratio}


def relax(cloud: MedialCloud, paths: GeodesicPaths) -> GeodesicPaths:
    """Shorten paths where the path through neighbouring balls is shorter.

    Two balls are neighbours when their first feature points share an edge of the mesh, and their
    second ones share an edge or are the same vertex.

    Parameters
    ----------
    cloud : MedialCloud
        k balls of a mesh, all or some of them.
    paths : GeodesicPaths
        The geodesic of each ball, k rows.

    Returns
    -------
    GeodesicPaths
        Lengths at most the given ones. A shortened path has status NEIGHBOUR and the tangents of
        the path that it ends up in, its own where that has none.

    Notes
    -----
    Cost: one look at each two neighbours, and a Dijkstra search over the balls that are shortened.
    """
    from medialis.skeleton.importance._path_kernels import relax_lengths

    k, shape = len(cloud), cloud.surface
    length, origin = np.array(paths.length), np.arange(k)
    walk, ends = surface_walk(shape), np.array(cloud.features)
    for side in (1, -1):
        rows = np.flatnonzero(cloud.valid & (cloud.side == side))
        row_of = np.full(shape.point_count, -1, np.int64)
        row_of[cloud.source[rows]] = rows
        relax_lengths(row_of[row_of >= 0], row_of, walk, ends, length, origin)
    shorter = np.flatnonzero(length < paths.length)
    # A path of length 0 has no direction.
    origin = np.where(np.isnan(paths.start_tangent[origin, 0]), np.arange(k), origin)
    status = np.array(paths.status)
    status[shorter] = PathStatus.NEIGHBOUR
    start, end = paths.start_tangent[origin], paths.end_tangent[origin]
    return replace(paths, length=length, start_tangent=start, end_tangent=end, status=status)
