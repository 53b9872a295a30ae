"""Y-network: where medial sheets meet, as points and as curves (thesis 6.2.2.2).

Strategy. On the surface, the borders between the labels of the sheets are clean lines: they cross
the edges whose ends have different labels. The middle between the two balls of such an edge lies on
the Y-curve, or across a jump (at a concave edge) far from both: these are left out. So the borders,
moved inside, are the Y-curves, each seen from its three contacts. Of the three, one is kept.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from medialis.model.medial_sheets import MedialSheets
from medialis.model.ragged import Ragged
from medialis.model.shape import Shape
from medialis.model.surface import piece_labels
from medialis.model.y_network import YNetwork
from medialis.options import Options, algorithm, whole
from medialis.progress import Progress
from medialis.surface.surface_graph import local_spacing, surface_graph
from medialis.threads import run_patiently
from medialis.validation import FloatArray, IntArray

LONGEST_JUMP = 4.0
"""Sample spacings between two balls on different sheets that still lie on both sides of a Y-curve.
Behind a right edge, balls are 1.4 spacings apart; ligatures and jumps stretch them further."""

SMOOTHING_ROUNDS = 8
"""Each node moves half-way to the middle of its neighbours: takes the zigzag between samples out of
the curves, and shortens a circle of 40 nodes by 5 %."""

SAME_CURVE = 2.0
"""Sample spacings within which borders with the same sheets are the same curve."""


@dataclass(frozen=True, kw_only=True)
class YNetworkOptions(Options):
    """Options of `y_network`."""

    neighbours: int = whole(
        3,
        "Neighbours",
        "A ball is near the network when one of this many nearest medial points belongs to another "
        "sheet. More make the band of points wider.",
        low=1,
        high=100,
    )


@algorithm(YNetworkOptions)
def y_network(sheets: MedialSheets, options: YNetworkOptions, progress: Progress) -> YNetwork:
    """Find the curves along which medial sheets meet.

    Parameters
    ----------
    sheets : MedialSheets
        Sheets of k balls.

    Returns
    -------
    YNetwork
        Curves need faces: a point cloud has points only. Curves are numbered by falling length.

    See Also
    --------
    medial_scaffold : the network with the sheets as a graph.

    Notes
    -----
    Source: thesis 6.2.2.2. Deviates: the curves are new; the thesis has the points only.

    Examples
    --------
    >>> import medialis
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    >>> network = medialis.y_network(medialis.medial_sheets(cloud))
    >>> bool(network.near.any()), len(network.lengths) > 0
    (True, True)
    """
    cloud, parts = sheets.cloud, []
    with progress.stage("y-network", 0.0, 1.0):
        near = run_patiently(lambda: _near_points(sheets, options.neighbours), progress)
        for sign in (1, -1) if cloud.surface.faces is not None else ():
            rows = np.flatnonzero(cloud.valid & (cloud.side == sign))
            if len(rows):
                parts.append(run_patiently(functools.partial(_curves, sheets, rows), progress))
    if not parts:
        none = np.empty((0, 3), np.int32)
        return YNetwork(near, np.empty((0, 3)), none[:, :2], none[:, 0], none, sheets=sheets)
    points, edges, curve, meeting = zip(*parts, strict=True)
    nodes = np.cumsum([0] + [len(part) for part in points])
    curves = np.cumsum([0] + [len(part) for part in meeting])
    return YNetwork(
        near,
        np.concatenate(points),
        np.concatenate([part + shift for part, shift in zip(edges, nodes, strict=False)]),
        np.concatenate([part + shift for part, shift in zip(curve, curves, strict=False)]),
        np.concatenate(meeting),
        sheets=sheets,
    )


def _near_points(sheets: MedialSheets, neighbours: int) -> NDArray[np.bool_]:
    from scipy.spatial import cKDTree

    near = np.zeros(len(sheets), np.bool_)
    rows = np.flatnonzero(sheets.labels >= 0)
    k = min(neighbours + 1, len(rows))
    if k > 1:
        centers, labels = sheets.cloud.centers[rows], sheets.labels[rows]
        nearest = cKDTree(centers).query(centers, k=k)[1]
        near[rows] = (labels[nearest] != labels[:, None]).any(axis=1)
    return near


def _curves(
    sheets: MedialSheets, rows: NDArray[np.int64]
) -> tuple[FloatArray, NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Nodes, edges, curve of each node and sheets of each curve, of the balls of one side."""
    cloud, shape = sheets.cloud, sheets.cloud.surface
    row_of = np.full(shape.point_count, -1, np.int64)
    row_of[cloud.source[rows]] = rows
    labels = np.where(row_of >= 0, sheets.labels[row_of], -1)
    centers, spacing = cloud.centers[row_of], local_spacing(shape)
    ends, links = _borders(shape, labels, centers, spacing)
    points = centers[ends].mean(axis=1)
    piece = piece_labels(len(points), links)
    first = np.unique(piece, return_index=True)[1]
    count = len(first)
    points = smoothed_curves(points, links)
    steps = np.linalg.norm(points[links[:, 0]] - points[links[:, 1]], axis=1)
    length = np.bincount(piece[links[:, 0]], steps, minlength=count).astype(np.float64)
    pair = np.sort(labels[ends[first]], axis=1).astype(np.int64)
    second = cloud.features[row_of, 1]
    third = _third_sheets(ends, piece, pair, labels, second, surface_graph(shape))
    triple = np.column_stack([pair, third])
    radius = SAME_CURVE * spacing[ends].max(axis=1)
    kept, triple = _without_repeats(points, radius, piece, length, triple)
    return _compact(points, links, piece, kept, triple)


def _borders(
    shape: Shape, labels: IntArray, centers: FloatArray, spacing: FloatArray
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Crossed surface edges (b, 2), and links (l, 2) between those of one pair of sheets."""
    table = shape.edge_table
    a, b = table.low, table.high
    gap = np.linalg.norm(centers[a] - centers[b], axis=1)
    crossed = (labels[a] != labels[b]) & (np.minimum(labels[a], labels[b]) >= 0)
    crossed &= gap <= LONGEST_JUMP * np.maximum(spacing[a], spacing[b])
    ends = np.stack([a[crossed], b[crossed]], axis=1)
    # The number of each crossed edge at the sides of the faces; -1 at the others.
    sides = np.where(crossed, np.cumsum(crossed) - 1, -1)[table.edge_of].reshape(-1, 3)
    pairs = np.concatenate([sides[:, [1, 2]], sides[:, [2, 0]], sides[:, [0, 1]]])
    pairs = pairs[(pairs >= 0).all(axis=1)]
    of_pairs = np.sort(labels[ends[pairs]], axis=2)
    return ends, pairs[(of_pairs[:, 0] == of_pairs[:, 1]).all(axis=1)]


def smoothed_curves(points: FloatArray, links: NDArray[np.int64]) -> FloatArray:
    """Move nodes with two neighbours or more towards the middle of these; ends stay."""
    n = len(points)
    degree = np.bincount(links.ravel(), minlength=n)
    inner = degree >= 2
    ends = np.concatenate([links, links[:, ::-1]])
    for _ in range(SMOOTHING_ROUNDS):
        total = np.stack(
            [np.bincount(ends[:, 0], points[ends[:, 1], j], minlength=n) for j in range(3)], axis=1
        )
        middle = total[inner] / degree[inner, None]
        points = points.copy()
        points[inner] = 0.5 * (points[inner] + middle)
    return points


def _third_sheets(
    ends: NDArray[np.int64],
    piece: IntArray,
    pair: NDArray[np.int64],
    labels: IntArray,
    second: IntArray,
    graph: Ragged,
) -> NDArray[np.int64]:
    """Return the sheet seen most often at the second feature points along a chain; -1: none."""
    across = second[ends].ravel()
    chain = np.repeat(piece, 2)
    counts = graph.lengths[across]
    start = np.repeat(graph.offsets[across] - np.cumsum(counts) + counts, counts)
    seen = labels[graph.indices[start + np.arange(counts.sum())]].astype(np.int64)
    chain = np.repeat(chain, counts).astype(np.int64)
    new = (seen >= 0) & (seen != pair[chain, 0]) & (seen != pair[chain, 1])
    width = int(labels.max(initial=0)) + 1
    keys, votes = np.unique(chain[new] * width + seen[new], return_counts=True)
    third = np.full(len(pair), -1, np.int64)
    order = np.lexsort((-keys, votes))  # the last one stays: most votes, then the lowest sheet
    third[keys[order] // width] = keys[order] % width
    return third


def _without_repeats(
    points: FloatArray,
    radius: FloatArray,
    piece: IntArray,
    length: FloatArray,
    triple: NDArray[np.int64],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Chains to keep, longest first, and their sheets; the same curve seen from two contacts once.

    A chain repeats an earlier one when most of its nodes lie close to chains with the same three
    sheets, or with two of them where one has only two.
    """
    from scipy.spatial import cKDTree

    triple = np.sort(np.where(triple < 0, np.iinfo(np.int64).max, triple), axis=1)
    members = Ragged.group(piece, len(length))
    kept: list[int] = []
    taken = np.full(len(points), -1, np.int64)
    near = cKDTree(points).query_ball_point(points, radius) if len(points) else []
    for chain in np.lexsort((np.arange(len(length)), -length)).tolist():
        nodes = members[chain].tolist()
        covered = 0
        for node in nodes:
            others = taken[near[node]]
            others = others[others >= 0]
            covered += len(others) > 0 and bool(_alike(triple[others], triple[chain]).any())
        if 2 * covered <= len(nodes) and len(nodes) > 1:
            kept.append(chain)
            taken[nodes] = chain
    sheets = triple[kept] if kept else np.empty((0, 3), np.int64)
    return np.array(kept, np.int64), np.where(sheets == np.iinfo(np.int64).max, -1, sheets)


def _alike(triples: NDArray[np.int64], one: NDArray[np.int64]) -> NDArray[np.bool_]:
    unknown = np.iinfo(np.int64).max
    common = (triples[:, :, None] == one[None, None, :]) & (triples[:, :, None] != unknown)
    shared = common.any(axis=2).sum(axis=1)
    complete = (triples[:, 2] != unknown) & (one[2] != unknown)
    return np.where(complete, shared == 3, shared >= 1)


def _compact(
    points: FloatArray,
    links: NDArray[np.int64],
    piece: IntArray,
    kept: NDArray[np.int64],
    triple: NDArray[np.int64],
) -> tuple[FloatArray, NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    number = np.full(int(piece.max(initial=-1)) + 1, -1, np.int64)
    number[kept] = np.arange(len(kept))
    curve = number[piece]
    nodes = np.flatnonzero(curve >= 0)
    place = np.full(len(points), -1, np.int64)
    place[nodes] = np.arange(len(nodes))
    edges = place[links[curve[links[:, 0]] >= 0]]
    return points[nodes], edges, curve[nodes], triple
