"""The curves where medial sheets meet, the sheets as triangle meshes, and their graph.

`y_network` (thesis 6.2.2.2): on the unfolded surface, the borders between the labels of the sheets
are clean lines. They cross the edges whose ends have different labels, and meet in triangles
between three. `find_borders` moves them inside, where they are the Y-curves, each seen from its
three contacts. Of the three, one is kept.

`sheet_meshes` (thesis 6.2.2.3) cuts the triangles of the unfolded surface along the Y-curves and
measures each sheet; `medial_scaffold` (thesis 6.2.2) tells which sheets meet along which curves.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np

from medialis.base.arrays import Index, Mask, Ragged, kd_tree
from medialis.base.errors import InvalidShapeError
from medialis.base.kept import Bound
from medialis.base.options import Options, algorithm, whole
from medialis.base.progress import Progress
from medialis.base.threads import run_patiently
from medialis.base.validation import FloatArray, IntArray, Positions, frozen, hold
from medialis.shape.graph import local_spacing
from medialis.shape.surface import piece_labels
from medialis.sheets.sheets import Borders, MedialSheets, find_borders
from medialis.skeleton.rims import clean_rims
from medialis.skeleton.skeleton_mesh import SkeletonMesh

SMOOTHING_ROUNDS = 48  # halved 17 %, doubled 9 %
"""Times that nodes move to the middle of their neighbours by two shares in turn (Taubin 1995)."""

INWARD = 0.5  # halved 100 %, doubled 100 %
"""The first share: takes the zigzag between samples out of curves."""

OUTWARD = -0.505  # halved 32 %, doubled 100 %
"""The second one: circles of 24 nodes or more change by less than 1 %."""

STRETCHED = 1.0
"""Longest side of a triangle of a sheet over that of the surface triangle. Behind round edges that
are sampled well it is less everywhere."""

NARROW = 1.25
"""Radii: contacts farther apart (77 degrees from the center) are those of a limb, not of a rim.
With 1, creature, hand and bug keep 4 to 8 % more area and some spikes; with 1.5 two limbs break."""

LOOSE = 0.05
"""Share of a strip's triangles that are stretched, from which on it is a fringe: 0 on an oblate
spheroid and an elliptic torus; 0.09 to 0.7 on creature, hand, horse, bug, dolphin, dove."""

SAME_NODE = 0.02  # halved 2 %, doubled 2 %
"""Mean distances between two nodes below which they are one place."""

SAME_CURVE = 1.0  # halved 65 %, doubled 100 %
"""Sample spacings within which borders with the same sheets are the same curve."""

REPEATED_TWO = 0.5  # halved 45 %, doubled 100 %
"""Share of the length of a border: close to others with two of its sheets, it is the same curve."""

REPEATED_ONE = 0.9  # halved 15 %, doubled 6 %
"""The same, close to others with one of its sheets."""

POINT_WIDTH = 0.25  # halved 3 %, doubled 9 %
"""Spacings from its middle within which all nodes of a border lie that is a point."""

SEEN_OFTEN = 0.25  # halved 7 %, doubled 7 %
"""Of the votes of the sheet seen most often at the second contacts along a curve."""

OTHER_SHEETS = 4  # halved 0 %, doubled 0 %
"""Sheets that may meet along a curve besides two: six behind the edges of a hexagonal prism."""

UNKNOWN = np.iinfo(np.int64).max
"""A sheet that is not known, behind all others."""

GRAPHML = "http://graphml.graphdrawing.org/xmlns"


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

    near: Mask
    points: Positions
    edges: IntArray
    curve: IntArray
    meeting: IntArray
    sheets: MedialSheets = field(kw_only=True)

    def __post_init__(self) -> None:
        p, e, c = len(self.points), len(self.edges), len(self.meeting)
        hold(self, near=len(self.sheets), points=(p, 3), edges=(e, 2), curve=p, meeting=(c, 3))

    def __repr__(self) -> str:
        return f"YNetwork({len(self.meeting)} curves, {int(self.near.sum())} points near them)"

    @cached_property
    def lengths(self) -> FloatArray:
        """Length of each curve, (c,)."""
        a, b = self.points[self.edges[:, 0]], self.points[self.edges[:, 1]]
        curve = self.curve[self.edges[:, 0]]
        total = np.bincount(curve, np.linalg.norm(a - b, axis=1), minlength=len(self.meeting))
        return frozen(total, np.float64)


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


def _near_points(sheets: MedialSheets, neighbours: int) -> Mask:
    near = np.zeros(len(sheets), np.bool_)
    rows = np.flatnonzero(sheets.labels >= 0)
    k = min(neighbours + 1, len(rows))
    if k > 1:
        centers, labels = sheets.cloud.centers[rows], sheets.labels[rows]
        nearest = kd_tree(centers).query(centers, k=k)[1]
        near[rows] = (labels[nearest] != labels[:, None]).any(axis=1)
    return near


def _curves(sheets: MedialSheets) -> tuple[FloatArray, Index, Index, Index]:
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


def _chains(borders: Borders) -> tuple[FloatArray, Index, Index]:
    """Places of nodes, links (l, 2) between those of one pair of sheets, and ends.

    Where three sheets meet in a triangle, each of the three chains has a node of its own.
    """
    sides, ends = borders.sides, borders.ends
    crossed = sides >= 0
    double = np.flatnonzero((crossed.sum(axis=1) == 2) & (sides != -2).all(axis=1))
    pairs = sides[double][crossed[double]].reshape(-1, 2)
    middle, mine = np.repeat(borders.middles, 3, axis=0), sides[borders.triple].ravel()
    tips = np.stack([mine, len(ends) + np.arange(len(mine))], axis=1)
    links = np.concatenate([pairs, tips])
    return np.concatenate([borders.points, middle]), links, np.concatenate([ends, ends[mine]])


def smoothed_curves(points: FloatArray, links: Index) -> FloatArray:
    """Smooth curves without shrinking them; only nodes with two neighbours move."""
    from scipy.sparse import coo_array

    n, length = len(points), np.linalg.norm(points[links[:, 0]] - points[links[:, 1]], axis=1)
    if not length.any():
        return points
    degree = np.bincount(links.ravel(), minlength=n)
    # By the inverse of the length, nodes on a line do not move.
    weight = np.tile(1.0 / np.maximum(length, SAME_NODE * length.mean()), 2)
    ends = np.concatenate([links, links[:, ::-1]]).T
    total = np.bincount(ends[0], weight, minlength=n)
    near = coo_array((weight / total[ends[0]], tuple(ends)), shape=(n, n)).tocsr()
    inner = (degree == 2)[:, None]
    for share in (INWARD, OUTWARD) * SMOOTHING_ROUNDS:
        points = points + share * np.where(inner, near @ points - points, 0.0)
    return points


def _other_sheets(
    ends: Index, piece: IntArray, pair: Index, labels: IntArray, second: IntArray, graph: Ragged
) -> Index:
    """Return the sheets seen most often at the second contacts along each chain, (c, OTHER_SHEETS).

    -1 behind the last one; a sheet seen a quarter as often as the first of them does not count.
    """
    across, chain = second[ends].ravel(), np.repeat(piece, 2)
    across, chain = across[across >= 0], chain[across >= 0]
    seen = labels[graph.joined(across)].astype(np.int64)
    chain = np.repeat(chain, graph.lengths[across]).astype(np.int64)
    new = (seen >= 0) & (seen != pair[chain, 0]) & (seen != pair[chain, 1])
    width = int(labels.max(initial=0)) + 1
    keys, votes = np.unique(chain[new] * width + seen[new], return_counts=True)
    chain, sheet = np.divmod(keys, width)
    order = np.lexsort((sheet, -votes, chain))
    chain, sheet, votes = chain[order], sheet[order], votes[order]
    first = np.searchsorted(chain, chain)
    rank = np.arange(len(chain)) - first
    often = (rank < OTHER_SHEETS) & (votes > SEEN_OFTEN * votes[first])
    result = np.full((len(pair), OTHER_SHEETS), -1, np.int64)
    result[chain[often], rank[often]] = sheet[often]
    return result


def _without_repeats(
    points: FloatArray, weight: FloatArray, spacing: FloatArray, piece: IntArray, meeting: Index
) -> Index:
    """Chains to keep, longest first; the same curve seen from two contacts once.

    A chain repeats earlier ones when most of it lies close to some with two of its sheets, or
    nearly all of it close to some with one; the weight of a node is the length of chain round it.
    What is no wider than half a spacing is a point, where many sheets meet or one ends on a line.
    """
    length = np.bincount(piece, weight, minlength=len(meeting))
    members = Ragged.group(piece, len(length))
    kept: list[int] = []
    taken = np.full(len(points), -1, np.int64)
    lists = kd_tree(points).query_ball_point(points, SAME_CURVE * spacing) if len(points) else []
    counts = np.array([len(one) for one in lists], np.int64)
    inside = np.fromiter(itertools.chain.from_iterable(lists), np.int32, counts.sum())
    near = Ragged(np.append(0, np.cumsum(counts)), inside)
    for chain in np.lexsort((np.arange(len(length)), -length)).tolist():
        nodes = members[chain]
        others, which = np.unique(taken[near.joined(nodes)], return_inverse=True)
        common = np.where(others < 0, 0, _shared(meeting[others], meeting[chain]))
        shared = np.zeros(len(nodes), np.int64)
        np.maximum.at(shared, np.repeat(np.arange(len(nodes)), counts[nodes]), common[which])
        two, one = (float(weight[nodes] @ (shared >= least)) for least in (2, 1))
        if two <= REPEATED_TWO * length[chain] and one <= REPEATED_ONE * length[chain]:
            away = points[nodes] - points[nodes].mean(axis=0)
            if np.linalg.norm(away, axis=1).max() < POINT_WIDTH * spacing[nodes].max():
                continue
            kept.append(chain)
        taken[nodes] = chain  # where many sheets meet, repeats lead from one pair to the next
    return np.array(kept, np.int64)


def _shared(meeting: Index, one: Index) -> Index:
    """Return how many sheets each of some curves has in common with another one."""
    common = (meeting[:, :, None] == one) & (one >= 0)
    return np.asarray(common.any(axis=2).sum(axis=1))


def _compact(
    points: FloatArray, links: Index, piece: IntArray, kept: Index, triple: Index
) -> tuple[FloatArray, Index, Index, Index]:
    number = np.full(int(piece.max(initial=-1)) + 1, -1, np.int64)
    number[kept] = np.arange(len(kept))
    curve = number[piece]
    stays = curve >= 0
    edges = (np.cumsum(stays) - 1)[links[stays[links[:, 0]]]]
    return points[stays], edges, curve[stays], triple


@dataclass(frozen=True, eq=False, repr=False)
class SheetMeshes(Bound):
    """All sheets as one mesh, in which each sheet has its own points and triangles.

    Attributes
    ----------
    mesh : SkeletonMesh
        p points, sheet by sheet, those on the Y-curves included; t triangles.
    point_sheet, face_sheet : (p,) and (t,) int32
        Sheet of each point and of each triangle.
    radii : (p,) float64
        Radius of the ball at each point. (``mesh.rows`` of a point between two balls is one of
        them.)
    areas : (count,) float64
        Of each sheet; 0 where a sheet has no triangle.
    boundaries : (count,) float64
        Length of the edges that belong to one triangle of a sheet only, its rim and its Y-curves,
        smoothed: they zigzag from sample to sample.
    mean_radii : (count,) float64
        Mean radius of the balls of each sheet, by area; NaN without a triangle.
    sheets : MedialSheets
        The sheets.

    Raises
    ------
    InvalidShapeError
        When the arrays do not fit together.
    """

    mesh: SkeletonMesh
    point_sheet: IntArray
    face_sheet: IntArray
    radii: FloatArray
    areas: FloatArray
    boundaries: FloatArray
    mean_radii: FloatArray
    sheets: MedialSheets = field(kw_only=True)

    def __post_init__(self) -> None:
        p, t, count = len(self.mesh.points), len(self.mesh.faces), self.sheets.count
        hold(self, point_sheet=p, face_sheet=t, radii=p)
        hold(self, areas=count, boundaries=count, mean_radii=count)

    def sheet(self, number: int) -> SkeletonMesh:
        """Return one sheet as a mesh of its own.

        Raises
        ------
        InvalidShapeError
            When there is no such sheet.
        """
        if not 0 <= number < self.sheets.count:
            raise InvalidShapeError(f"There are sheets 0..{self.sheets.count - 1}, got {number}.")
        mesh, own, mine = self.mesh, self.face_sheet == number, self.sheets.labels == number
        used, place = np.unique(mesh.faces[own], return_inverse=True)
        faces, cloud = frozen(place.reshape(-1, 3), np.int32), self.sheets.cloud
        known = mesh.points[used], faces, mesh.rows[used], mesh.face_origin[own]
        return SkeletonMesh(*known, cloud=cloud, selected=mine)

    def __repr__(self) -> str:
        return f"SheetMeshes({self.sheets.count} sheets, {len(self.mesh.faces)} faces)"


@algorithm(Options)
def sheet_meshes(sheets: MedialSheets, options: Options, progress: Progress) -> SheetMeshes:
    """Connect the points of each medial sheet to triangles.

    Parameters
    ----------
    sheets : MedialSheets
        Sheets of all balls of a mesh.

    Returns
    -------
    SheetMeshes

    Raises
    ------
    InvalidShapeError
        When the surface has no faces.

    See Also
    --------
    skeleton_mesh : one mesh of the whole skeleton, in which sheets are connected.

    Notes
    -----
    The triangles on the front of a sheet (`MedialSheets.front`) are moved to the centers of the
    balls of their corners. Where sheets meet, triangles are cut along the Y-curve, so that each
    piece belongs to one sheet; `SkeletonMesh.rows` of a point there is the ball of a corner beside.
    Sheets that end at a crease end on it. At other rims a fringe of spikes, where contacts lie
    close together, is left out. What remains is cleaned as in `skeleton_mesh`: gaps that balls
    cover are closed, and points of rims moved to a mean of balls. Triangles longer than four
    spacings between different sheets (jumps at concave edges without fans) are left out.

    Source: thesis 6.2.2.3, Eq. 6.6-6.7. Deviates: the sides are told apart by pieces linked along
    the surface and partners across the sheet, not by geodesics to a reference point.

    Examples
    --------
    >>> import medialis
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    >>> sheets = medialis.medial_sheets(cloud)
    >>> meshes = medialis.sheet_meshes(sheets)
    >>> len(meshes.areas) == sheets.count, bool(meshes.areas.sum() > 0)
    (True, True)
    """
    cloud = sheets.cloud
    if cloud.surface.faces is None:
        raise InvalidShapeError(
            "Sheet meshes need a surface with faces, got a point cloud: reconstruct a surface "
            "first, or show the sheets as points."
        )
    with progress.stage("sheet meshes", 0.0, 1.0):
        return run_patiently(lambda: _meshed(sheets), progress)


def _meshed(sheets: MedialSheets) -> SheetMeshes:
    """Lift and cut the triangles on the fronts of the sheets, and measure each sheet."""
    cloud, unfolded = sheets.cloud, sheets.unfolded
    borders = find_borders(sheets)
    pieces = _pieces(sheets, borders)
    points = np.concatenate([unfolded.centers, borders.points, borders.middles])
    radii = np.concatenate([unfolded.radii, borders.radii, borders.middle_radii])
    # Each sheet has its own points: those of sheet s and place p come in the order of s n + p.
    key = pieces.sheet[:, None] * len(points) + pieces.triangles
    own, first, place = np.unique(key, return_index=True, return_inverse=True)
    point_sheet, places = np.divmod(own, len(points)) if len(own) else (own, own)
    rows, faces = unfolded.rows[pieces.beside.ravel()[first]], place.reshape(-1, 3)
    known = points[places], frozen(faces, np.int32), frozen(rows, np.int32)
    valid, origin = sheets.labels >= 0, frozen(pieces.origin, np.int32)
    mesh = SkeletonMesh(*known, origin, cloud=cloud, selected=valid)
    # Y-curves and creases are where they are; a rim at a soft edge is where samples end.
    fixed = np.append(unfolded.parted, [True])[np.minimum(places, len(unfolded))]
    spacing = local_spacing(cloud.surface)[cloud.source[rows]]
    rims = clean_rims(mesh, radii[places], spacing, fixed)
    mesh = SkeletonMesh(
        rims.at_points(mesh.points), rims.faces, mesh.rows[rims.kept], origin[rims.origin],
        cloud=cloud, selected=valid,
    )  # fmt: skip
    radii, sheet = rims.at_points(radii[places]), pieces.sheet[rims.origin]
    point_sheet = point_sheet[rims.kept]
    areas = np.bincount(sheet, mesh.face_areas, sheets.count).astype(np.float64)
    mean, radius = np.full(sheets.count, np.nan), radii[mesh.faces].mean(axis=1)
    total = np.bincount(sheet, mesh.face_areas * radius, sheets.count)
    np.divide(total, areas, out=mean, where=areas > 0)
    around = _boundaries(mesh, point_sheet, sheets.count)
    of_points, of_faces = frozen(point_sheet, np.int32), frozen(sheet, np.int32)
    return SheetMeshes(mesh, of_points, of_faces, radii, areas, around, mean, sheets=sheets)


class _Pieces(NamedTuple):
    """Triangles between nodes, borders (b) and triple points, each in one sheet.

    Node i is place i, border i is place u + i, the place where three meet u + b + i.
    """

    triangles: Index
    sheet: Index
    origin: Index
    beside: Index
    """For each corner of the triangles, a node of the same sheet there or beside it."""


def _pieces(sheets: MedialSheets, borders: Borders) -> _Pieces:
    """Cut the triangles between sheets, and take what lies on the fronts."""
    unfolded, labels, front = sheets.unfolded, sheets.node_labels, sheets.node_front
    faces, sides = np.asarray(unfolded.faces).astype(np.int64), borders.sides
    u, crossed = len(unfolded), (sides >= 0).sum(axis=1)
    clear = (sides != -2).all(axis=1)
    whole, double = (np.flatnonzero(clear & (crossed == c)) for c in (0, 2))
    corners = faces[whole]
    mostly = front[corners].sum(axis=1) >= 2
    parts = [(corners[mostly], corners[mostly], whole[mostly])]
    # The corner on a sheet of its own comes first: the side across from it is the one not crossed.
    turn = ((sides[double].argmin(axis=1) + 2)[:, None] + np.arange(3)) % 3
    c, a, b = np.take_along_axis(faces[double], turn, axis=1).T
    ca, _, bc = u + np.take_along_axis(sides[double], turn, axis=1).T
    both = front[a] & front[b]
    cut = [
        ((c, ca, bc), (c, c, c), double, front[c]),
        ((a, b, bc), (a, b, b), double, both),
        ((a, bc, ca), (a, b, a), double, both),
    ]
    triple = borders.triple
    tip = u + len(borders.ends) + np.arange(len(triple))
    for j in range(3):
        c, after, before = faces[triple, j], sides[triple, j] + u, sides[triple, j - 1] + u
        cut.append(((c, after, tip), (c, c, c), triple, front[c]))
        cut.append(((c, tip, before), (c, c, c), triple, front[c]))
    for places, near, rows, chosen in cut:
        corners, nodes = (np.stack(columns, axis=1)[chosen] for columns in (places, near))
        parts.append((corners, nodes, rows[chosen]))
    triangles, beside, which = (np.concatenate(part) for part in zip(*parts, strict=True))
    known = (labels[beside[:, 0]] >= 0) & ~_frayed(sheets, beside)
    triangles, beside, which = triangles[known], beside[known], which[known]
    sheet, origin = labels[beside[:, 0]].astype(np.int64), np.asarray(unfolded.face_origin)[which]
    return _Pieces(triangles, sheet, origin, beside)


def _frayed(sheets: MedialSheets, beside: Index) -> Mask:
    """Return which triangles are the fringe of a sheet, spikes of any length, (t,).

    Beyond the balls that were linked to a sheet, the two contacts of a ball are close together.
    Behind a round edge centers move less than the samples do, and the sheet goes on to its rim.
    Where centers move farther, they tell how two samples lie and not where a sheet ends: a strip of
    such triangles along a rim is left out, as a whole. Of a sheet in which nothing is linked, all
    stays.
    """
    unfolded, labels = sheets.unfolded, sheets.node_labels
    linked = sheets.linked[unfolded.rows]
    bare = np.bincount(labels[linked], minlength=sheets.count + 1) == 0
    wide = np.linalg.norm(unfolded.points - unfolded.contacts, axis=1) > NARROW * unfolded.radii
    beyond = np.flatnonzero(~(linked | bare[labels] | wide)[beside].any(axis=1))
    corners = beside[beyond]
    lifted, below = (_longest_side(x[corners]) for x in (unfolded.centers, unfolded.points))
    loose = lifted > STRETCHED * below
    nodes, place = np.unique(corners, return_inverse=True)
    place = place.reshape(-1, 3)
    strip = piece_labels(len(nodes), place[:, [0, 1, 1, 2]])[place[:, 0]]
    stretched, all_of_it = (np.bincount(strip, each) for each in (loose, np.ones(len(loose))))
    frayed = np.zeros(len(beside), np.bool_)
    frayed[beyond] = stretched[strip] > LOOSE * all_of_it[strip]
    return frayed


def _longest_side(corners: FloatArray) -> FloatArray:
    """Longest side of triangles (t, 3, 3)."""
    return np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)


def _boundaries(mesh: SkeletonMesh, point_sheet: Index, count: int) -> FloatArray:
    """Length of the edges with one triangle, for each sheet, without the zigzag between samples."""
    table = mesh.edge_table
    links = np.stack([table.low, table.high], axis=1)[table.counts == 1]
    points = smoothed_curves(mesh.points, links)
    length = np.linalg.norm(points[links[:, 0]] - points[links[:, 1]], axis=1)
    return np.bincount(point_sheet[links[:, 0]], length, count).astype(np.float64)


@dataclass(frozen=True, eq=False, repr=False)
class MedialScaffold(Bound):
    """Graph of sheets and Y-curves; a link joins a curve to each sheet that ends on it.

    Attributes
    ----------
    sheets : MedialSheets
        Its nodes, with ``sheets.sizes`` balls each.
    network : YNetwork
        Its curves, with ``network.lengths``.
    meshes : SheetMeshes or None
        Areas, boundaries and mean radii of the sheets; None for a point cloud.
    """

    sheets: MedialSheets
    network: YNetwork
    meshes: SheetMeshes | None

    @property
    def links(self) -> IntArray:
        """Curve and sheet of each link, (l, 2)."""
        curve, place = np.nonzero(self.network.meeting >= 0)
        return np.column_stack([curve, self.network.meeting[curve, place]]).astype(np.int32)

    def __repr__(self) -> str:
        curves = len(self.network.meeting)
        return f"MedialScaffold({self.sheets.count} sheets, {curves} curves)"

    def as_dict(self) -> dict[str, Any]:
        """Return plain lists and numbers, for strict JSON: None for what is not defined."""
        meeting: list[list[int]] = [[] for _ in self.network.meeting]
        for curve, sheet in self.links.tolist():
            meeting[curve].append(sheet)
        measures: list[Any] = [[None] * self.sheets.count] * 3
        if self.meshes is not None:
            own = self.meshes.areas, self.meshes.boundaries, self.meshes.mean_radii
            measures = [_defined(each) for each in own]
        sheets = zip(self.sheets.sizes.tolist(), *measures, strict=True)
        return {
            "sheets": [
                {"sheet": i, "balls": b, "area": a, "boundary": o, "mean_radius": r}
                for i, (b, a, o, r) in enumerate(sheets)
            ],
            "curves": [
                {"curve": i, "length": length, "sheets": meeting[i]}
                for i, length in enumerate(_defined(self.network.lengths))
            ],
        }

    def graphml(self) -> str:
        """Return the graph as GraphML, which networkx, Gephi, yEd and others read.

        Nodes are named s0, s1, ... (sheets) and c0, c1, ... (curves). What is not defined is left
        out.
        """
        root = ElementTree.Element("graphml", {"xmlns": GRAPHML})
        plain = self.as_dict()
        types = {"kind": "string", "balls": "int", "area": "double", "boundary": "double"}
        types |= {"mean_radius": "double", "length": "double"}
        for name, kind in types.items():
            about = {"id": name, "for": "node", "attr.name": name, "attr.type": kind}
            ElementTree.SubElement(root, "key", about)
        graph = ElementTree.SubElement(root, "graph", {"edgedefault": "undirected"})
        for kind, rows in (("sheet", plain["sheets"]), ("curve", plain["curves"])):
            for row in rows:
                node = ElementTree.SubElement(graph, "node", {"id": f"{kind[0]}{row[kind]}"})
                for name, value in {"kind": kind, **row}.items():
                    if name in types and value is not None:
                        ElementTree.SubElement(node, "data", {"key": name}).text = str(value)
        for curve, sheet in self.links.tolist():
            ElementTree.SubElement(graph, "edge", {"source": f"c{curve}", "target": f"s{sheet}"})
        ElementTree.indent(root)
        return ElementTree.tostring(root, encoding="unicode", xml_declaration=True)


def _defined(values: FloatArray) -> list[float | None]:
    return [value if math.isfinite(value) else None for value in values.tolist()]


@algorithm(Options, keep=False)
def medial_scaffold(sheets: MedialSheets, options: Options, progress: Progress) -> MedialScaffold:
    """Collect sheets and the curves along which they meet to a graph.

    Parameters
    ----------
    sheets : MedialSheets
        From `medialis.medial_sheets`.

    Returns
    -------
    MedialScaffold
        With the Y-network and, for a mesh, the sheet meshes that it was made of.

    See Also
    --------
    y_network, sheet_meshes : its two halves.

    Notes
    -----
    Source: thesis 6.2.2 (the scaffold of sheets and curves).

    Examples
    --------
    >>> import medialis
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    >>> scaffold = medialis.medial_scaffold(medialis.medial_sheets(cloud))
    >>> len(scaffold.as_dict()["sheets"]) == scaffold.sheets.count
    True
    """
    with progress.stage("scaffold", 0.0, 1.0):
        with progress.stage("network", 0.0, 0.5):
            network = y_network.of(sheets, options, progress)
        meshes = None
        if sheets.cloud.surface.faces is not None:
            with progress.stage("meshes", 0.5, 1.0):
                meshes = sheet_meshes.of(sheets, options, progress)
    return MedialScaffold(sheets, network, meshes)
