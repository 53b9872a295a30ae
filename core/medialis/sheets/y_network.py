"""YNetwork: the curves along which medial sheets meet (thesis 6.2.2.2).

Strategy. On the unfolded surface, the borders between the labels of the sheets are clean lines:
they cross the edges whose ends have different labels, and meet in triangles between three.
`find_borders` moves them inside, where they are the Y-curves, each seen from its three contacts. Of
the three, one is kept.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import Ragged
from medialis.base.kept import Bound
from medialis.base.options import Options, algorithm, whole
from medialis.base.progress import Progress
from medialis.base.threads import run_patiently
from medialis.base.validation import FloatArray, IntArray, Positions, frozen, hold
from medialis.shape.graph import local_spacing
from medialis.shape.surface import piece_labels
from medialis.sheets.sheets import Borders, MedialSheets, find_borders


@dataclass(frozen=True, eq=False, repr=False)
class YNetwork(Bound):
    """Points near Y-curves, and the curves as a graph.

    Attributes
    ----------
    near : (k,) bool
        Balls with one of their nearest medial points in another sheet.
    points : (p, 3) float64
        Nodes of the curves, in the units of the shape; none for a point cloud.
    edges : (e, 2) int32
        Between nodes; each belongs to one curve.
    curve : (p,) int32
        Curve of each node.
    meeting : (c, 3) int32
        Sheets that meet along each curve, ascending; the last is -1 where only two are known.
    sheets : MedialSheets
        The sheets of the k balls.

    Raises
    ------
    InvalidShapeError
        When the arrays do not fit together.
    """

    near: NDArray[np.bool_]
    points: Positions
    edges: IntArray
    curve: IntArray
    meeting: IntArray
    sheets: MedialSheets = field(kw_only=True)

    def __post_init__(self) -> None:
        p, e, c = len(self.points), len(self.edges), len(self.meeting)
        hold(
            self,
            near=(np.bool_, len(self.sheets)),
            points=(np.float64, p, 3),
            edges=(np.int32, e, 2),
            curve=(np.int32, p),
            meeting=(np.int32, c, 3),
        )

    def __repr__(self) -> str:
        return f"YNetwork({len(self.meeting)} curves, {int(self.near.sum())} points near them)"

    @cached_property
    def lengths(self) -> FloatArray:
        """Length of each curve, (c,)."""
        a, b = self.points[self.edges[:, 0]], self.points[self.edges[:, 1]]
        curve = self.curve[self.edges[:, 0]]
        total = np.bincount(curve, np.linalg.norm(a - b, axis=1), minlength=len(self.meeting))
        return frozen(total, np.float64)


SMOOTHING_ROUNDS, INWARD, OUTWARD = 48, 0.5, -0.505
"""Nodes move to the middle of their neighbours by these shares in turn (Taubin 1995): takes the
zigzag between samples out of curves, and changes circles of 24 nodes or more by less than 1 %."""

SHORTEST = 0.02
"""Mean distances between two nodes below which they are one place."""

SAME_CURVE = 1.0
"""Sample spacings within which borders with the same sheets are the same curve."""

MOST, NEARLY_ALL = 0.5, 0.9
"""Shares of the length of a border."""

OTHERS = 4
"""Sheets that may meet along a curve besides two: six behind the edges of a hexagonal prism."""

UNKNOWN = np.iinfo(np.int64).max
"""A sheet that is not known, behind all others."""


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
    with progress.stage("y-network", 0.0, 1.0):
        near = run_patiently(lambda: _near_points(sheets, options.neighbours), progress)
        points, edges, curve, meeting = run_patiently(lambda: _curves(sheets), progress)
    whole = (frozen(values, np.int32) for values in (edges, curve, meeting))
    return YNetwork(near, points, *whole, sheets=sheets)


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
    sheets: MedialSheets,
) -> tuple[FloatArray, NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Nodes, edges, curve of each node and sheets of each curve."""
    unfolded, labels = sheets.unfolded, sheets.node_labels
    borders = find_borders(sheets)
    points, links, ends = _chains(borders)
    piece = piece_labels(len(points), links)
    first = np.unique(piece, return_index=True)[1]
    points = smoothed_curves(points, links)
    steps = np.linalg.norm(points[links[:, 0]] - points[links[:, 1]], axis=1)
    weight = np.bincount(links.ravel(), np.repeat(steps / 2, 2), len(points)).astype(float)
    pair = np.sort(labels[ends[first]], axis=1).astype(np.int64)
    others = _other_sheets(ends, piece, pair, labels, unfolded.across, unfolded.graph)
    meeting = np.column_stack([pair, others])
    spacing = local_spacing(unfolded.cloud.surface)[unfolded.samples[ends]].max(axis=1)
    kept = _without_repeats(points, weight, spacing, piece, meeting)
    triple = np.sort(np.where(meeting < 0, UNKNOWN, meeting)[kept, :3], axis=1)
    return _compact(points, links, piece, kept, np.where(triple == UNKNOWN, -1, triple))


def _chains(borders: Borders) -> tuple[FloatArray, NDArray[np.int64], NDArray[np.int64]]:
    """Places of nodes, links (l, 2) between those of one pair of sheets, and ends.

    Where three sheets meet in a triangle, each of the three chains has a node of its own.
    """
    sides, ends = borders.sides, borders.ends
    crossed = sides >= 0
    double = np.flatnonzero((crossed.sum(axis=1) == 2) & (sides != -2).all(axis=1))
    pairs = sides[double][crossed[double]].reshape(-1, 2)
    middle, mine = np.repeat(borders.middles, 3, axis=0), sides[borders.triple].ravel()
    tips = np.stack([mine, len(ends) + np.arange(len(mine))], axis=1)
    return (
        np.concatenate([borders.points, middle]),
        np.concatenate([pairs, tips]),
        np.concatenate([ends, ends[mine]]),
    )


def smoothed_curves(points: FloatArray, links: NDArray[np.int64]) -> FloatArray:
    """Smooth curves without shrinking them; only nodes with two neighbours move."""
    from scipy.sparse import coo_array

    n, length = len(points), np.linalg.norm(points[links[:, 0]] - points[links[:, 1]], axis=1)
    if not length.any():
        return points
    degree = np.bincount(links.ravel(), minlength=n)
    # By the inverse of the length, nodes on a line do not move.
    weight = np.tile(1.0 / np.maximum(length, SHORTEST * length.mean()), 2)
    ends = np.concatenate([links, links[:, ::-1]]).T
    total = np.bincount(ends[0], weight, minlength=n)
    near = coo_array((weight / total[ends[0]], tuple(ends)), shape=(n, n)).tocsr()
    inner = (degree == 2)[:, None]
    for share in (INWARD, OUTWARD) * SMOOTHING_ROUNDS:
        points = points + share * np.where(inner, near @ points - points, 0.0)
    return points


def _other_sheets(
    ends: NDArray[np.int64],
    piece: IntArray,
    pair: NDArray[np.int64],
    labels: IntArray,
    second: IntArray,
    graph: Ragged,
) -> NDArray[np.int64]:
    """Return the sheets seen most often at the second contacts along each chain, (c, OTHERS).

    -1 behind the last one; a sheet seen a quarter as often as the first of them does not count.
    """
    across, chain = second[ends].ravel(), np.repeat(piece, 2)
    across, chain = across[across >= 0], chain[across >= 0]
    counts = graph.lengths[across]
    start = np.repeat(graph.offsets[across] - np.cumsum(counts) + counts, counts)
    seen = labels[graph.indices[start + np.arange(counts.sum())]].astype(np.int64)
    chain = np.repeat(chain, counts).astype(np.int64)
    new = (seen >= 0) & (seen != pair[chain, 0]) & (seen != pair[chain, 1])
    width = int(labels.max(initial=0)) + 1
    keys, votes = np.unique(chain[new] * width + seen[new], return_counts=True)
    chain, sheet = np.divmod(keys, width)
    order = np.lexsort((sheet, -votes, chain))
    chain, sheet, votes = chain[order], sheet[order], votes[order]
    first = np.searchsorted(chain, chain)
    rank = np.arange(len(chain)) - first
    often = (rank < OTHERS) & (4 * votes > votes[first])
    result = np.full((len(pair), OTHERS), -1, np.int64)
    result[chain[often], rank[often]] = sheet[often]
    return result


def _without_repeats(
    points: FloatArray,
    weight: FloatArray,
    spacing: FloatArray,
    piece: IntArray,
    meeting: NDArray[np.int64],
) -> NDArray[np.int64]:
    """Chains to keep, longest first; the same curve seen from two contacts once.

    A chain repeats earlier ones when most of it lies close to some with two of its sheets, or
    nearly all of it close to some with one; the weight of a node is the length of chain round it.
    What is no wider than half a spacing is a point, where many sheets meet or one ends on a line.
    """
    from scipy.spatial import cKDTree

    length = np.bincount(piece, weight, minlength=len(meeting))
    members = Ragged.group(piece, len(length))
    kept: list[int] = []
    taken = np.full(len(points), -1, np.int64)
    near = cKDTree(points).query_ball_point(points, SAME_CURVE * spacing) if len(points) else []
    for chain in np.lexsort((np.arange(len(length)), -length)).tolist():
        nodes = members[chain].tolist()
        shared = np.zeros(len(nodes), np.int64)
        for place, node in enumerate(nodes):
            others = taken[near[node]]
            shared[place] = _shared(meeting[others[others >= 0]], meeting[chain])
        two, one = (float(weight[nodes] @ (shared >= least)) for least in (2, 1))
        if two <= MOST * length[chain] and one <= NEARLY_ALL * length[chain]:
            away = points[nodes] - points[nodes].mean(axis=0)
            if 4 * np.linalg.norm(away, axis=1).max() < spacing[nodes].max():
                continue
            kept.append(chain)
        taken[nodes] = chain  # where many sheets meet, repeats lead from one pair to the next
    return np.array(kept, np.int64)


def _shared(meeting: NDArray[np.int64], one: NDArray[np.int64]) -> int:
    """Return how many sheets one curve has in common with another one, at most."""
    common = (meeting[:, :, None] == one) & (one >= 0)
    return int(common.any(axis=2).sum(axis=1).max(initial=0))


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
