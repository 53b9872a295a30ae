"""MedialSheets: the smooth pieces of a surface skeleton, and where they meet (thesis 6.2.2).

**Which balls lie on one sheet** (thesis 6.2.2.1). Two do when both contacts of one are close to
those of the other. Where sheets run into a convex edge or corner this holds across sheets as well,
because there all contacts are close together. At a crease it is known which side each contact is
on. At soft edges only balls whose contacts are clearly apart are linked; the others, those of the
rim, are attached to the nearest sheet along the surface afterwards.

**Where sheets meet** on the edges and in the triangles of the unfolded surface (thesis 6.2.2.2).
Each ball knows its second contact and the plane that touches the surface there. How the radius
would change if that plane were the only wall is known beside the sample as well, so the sheet of a
ball can be followed a little further. Along an edge between balls of two sheets, both sheets are
followed until they meet: that is a point of the Y-curve, exact where the surface is flat. In a
triangle between three sheets, all three meet at a point.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from medialis.base.arrays import EdgeTable, Index, Mask
from medialis.base.kept import Bound, kept
from medialis.base.options import Options, algorithm, changed, number
from medialis.base.progress import Progress
from medialis.base.threads import run_chunks, run_patiently
from medialis.base.validation import FloatArray, IntArray, hold
from medialis.shape.graph import local_spacing, surface_graph
from medialis.shape.labels import fill_components, merge_small, numbered_by_weight, spread_labels
from medialis.sheets.feature_sets import FeatureSets, extended_feature_transform
from medialis.sheets.unfolding import Unfolded, unfold
from medialis.skeleton.medial_cloud import MedialCloud, ShrinkOptions, Side
from medialis.skeleton.preparation import SheetPreparation
from medialis.skeleton.surface_skeleton import (
    BallOptions,
    SurfaceSkeletonOptions,
    balls_of,
    shape_or_cloud,
)

LONGEST_JUMP = 4.0  # halved 100 %, doubled 9 %
"""Sample spacings between two balls on different sheets that still lie on both sides of a Y-curve.
Behind a right edge, balls are 1.4 spacings apart; ligatures and jumps stretch them further."""

PARALLEL_SPOKES = 1e-6  # halved 0 %, doubled 0 %
"""1 - cosine between two spokes: walls that are hardly inclined say nothing about a radius."""

FARTHEST_MEETING = 0.75  # halved 26 %, doubled 28 %
"""Distances between two balls, from their middle to where their sheets meet; flat ones: 0.5."""

SINGULAR = 1e-9  # halved 0 %, doubled 0 %
"""Determinant of three walls that meet nowhere."""

JUST_BEYOND = 0.05  # halved 0.1 %, doubled < 0.1 %
"""Shares of the height of a triangle: a place no farther beyond a side still lies in it."""

FAR_BEYOND = 1.0  # halved 2 %, doubled 6 %
"""And a place that is farther beyond a side is none where three walls meet."""

FARTHEST_TRIPLE = 2.0  # halved 3 %, doubled 4 %
"""Distances between two balls of a triangle, from their middle to where three sheets meet."""

CLEARLY_APART = 2.0  # halved 30 %, doubled 80 %
"""Sample spacings between the two feature points from which a ball can be linked. A box of sides 2,
1.5 and 1 has 13 sheets at spacings from 0.03 to 0.17 (six samples across its smallest side) with
2, and fewer at 0.17 with 3, because too few balls are left."""

LARGEST_TURN = 0.75  # halved 33 %, doubled 26 %
"""Radii: the chord by which a feature point may move from ball to ball, an angle of 44 degrees.
Near the corner of a box the feature points of two sheets come as close as one likes, but stay 90
degrees apart as seen from the center."""

WALL_COSINE = -0.5  # halved 100 %, doubled 100 %
"""Cosine between the normals at the two feature points of a ball in a wall: 120 degrees or more."""

NODES_A_CHUNK = 8192  # halved 0 %, doubled 0 %
"""Some milliseconds of work."""

LEAST_BALLS = 8  # halved 100 %, doubled 100 %
"""A piece of fewer linked balls is no sheet, not counting those that lie on its border. It is
attached to its surroundings."""

ON_BORDER = 0.1  # halved 4 %, doubled 29 %
"""Share of the way to the next sample: a ball nearer than this to a border lies on it."""


@dataclass(frozen=True, eq=False, repr=False)
class MedialSheets(Bound):
    """Partition of the balls of a cloud into sheets.

    Attributes
    ----------
    labels : (k,) int32
        Sheet of each ball: 0, 1, ... from the one that covers most of the surface to the least;
        -1 for masked balls.
    linked : (k,) bool
        True where the ball itself was linked to its sheet; False where it was attached afterwards:
        on the rim of a sheet its feature points are too close together to tell.
    front : (k,) bool
        True on one of the two sides of each sheet: the samples of these balls cover it once (those
        of a tube, which has no two sides, all around).
    node_labels, node_front : (u,) int32 and bool
        The same for the nodes of the unfolded surface: at a crease, those on its two sides are on
        the two sides of a sheet.
    unfolded : Unfolded
        The surface of the k balls, with u nodes.

    Raises
    ------
    InvalidShapeError
        When there is not one value a ball, or a node.
    """

    labels: IntArray
    linked: Mask
    front: Mask
    node_labels: IntArray
    node_front: Mask
    unfolded: Unfolded = field(kw_only=True)

    def __post_init__(self) -> None:
        k, u = len(self.cloud), len(self.unfolded)
        hold(self, labels=k, linked=k, front=k)
        hold(self, node_labels=u, node_front=u)

    @property
    def cloud(self) -> MedialCloud:
        """The k balls."""
        return self.unfolded.cloud

    def __len__(self) -> int:
        return len(self.labels)

    def __repr__(self) -> str:
        return f"MedialSheets({self.count} sheets, {len(self)} balls)"

    @property
    def count(self) -> int:
        """Number of sheets."""
        return int(self.labels.max(initial=-1)) + 1

    @property
    def sizes(self) -> IntArray:
        """Number of balls of each sheet, (count,)."""
        return np.bincount(self.labels[self.labels >= 0], minlength=self.count).astype(np.int32)


@dataclass(frozen=True)
class Borders:
    """Where sheets meet on the unfolded surface.

    Attributes
    ----------
    ends : (b, 2) int64
        Nodes of each edge between two sheets.
    points, radii : (b, 3) and (b,) float64
        Where the two meet, and the radius of the ball there.
    sides : (t, 3) int64
        Row above for the sides of the triangles, from corner j to the next; -1: within a sheet, -2:
        the balls lie too far apart.
    triple : (j,) int64
        Triangles between three sheets.
    middles, middle_radii : (j, 3) and (j,) float64
        Where these meet.
    """

    ends: Index
    points: FloatArray
    radii: FloatArray
    sides: Index
    triple: Index
    middles: FloatArray
    middle_radii: FloatArray


def find_borders(sheets: MedialSheets) -> Borders:
    """Find where the sheets meet on the edges of the unfolded surface."""
    unfolded, labels = sheets.unfolded, sheets.node_labels
    table = EdgeTable.of(np.asarray(unfolded.faces), len(unfolded))
    crossed = np.flatnonzero(labels[table.low] != labels[table.high])
    ends = np.stack([table.low[crossed], table.high[crossed]], axis=1)
    a, b = ends.T
    spacing = local_spacing(unfolded.cloud.surface)[unfolded.samples[ends]].max(axis=1)
    gap = np.linalg.norm(unfolded.centers[a] - unfolded.centers[b], axis=1)
    near = gap <= LONGEST_JUMP * spacing
    number = np.full(len(table.low), -1, np.int64)
    number[crossed] = np.where(near, np.cumsum(near) - 1, -2)
    ends = ends[near]
    points, radii = _meeting(unfolded, ends)
    sides = number[table.edge_of].reshape(-1, 3)
    triple = np.flatnonzero((sides >= 0).all(axis=1))
    middles, middle_radii, hidden = _meeting_of_three(unfolded, triple)
    # Where three sheets meet beyond a side, two of them have not met there: the third hides it.
    which, side = np.nonzero(hidden)
    points[sides[triple[which], side]] = middles[which]
    radii[sides[triple[which], side]] = middle_radii[which]
    middle = np.isnan(middle_radii)
    middles[middle] = points[sides[triple[middle]]].mean(axis=1)
    middle_radii[middle] = radii[sides[triple[middle]]].mean(axis=1)
    return Borders(ends, points, radii, sides, triple, middles, middle_radii)


def followed(unfolded: Unfolded, walls: Index, nodes: Index) -> tuple[FloatArray, FloatArray]:
    """Follow the sheets of some nodes to other nodes: return radius and center of the balls there.

    The ball at a node p with the spoke n touches the plane through q with the normal m where
    ((q - p + r n) m = r, so r = (q - p) m / (1 - n m).
    """
    n, m = unfolded.spokes[0][nodes], unfolded.spokes[1][walls]
    off = 1.0 - np.einsum("...j,...j->...", n, m)
    height = np.einsum("...j,...j->...", unfolded.contacts[walls] - unfolded.points[nodes], m)
    radius = np.full(off.shape, np.nan)
    np.divide(height, off, out=radius, where=off > PARALLEL_SPOKES)
    return radius, unfolded.points[nodes] - radius[..., None] * n


def _parts(unfolded: Unfolded, ends: Index) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return which part of each edge (e, 2) lies before the place where the two sheets meet, (e,).

    A half where following the sheets leads nowhere. Also radii (2, 2, e) and centers of the balls
    of walls (first) at nodes (second).
    """
    walls, nodes = np.broadcast_arrays(ends.T[:, None], ends.T[None])
    radius, center = followed(unfolded, walls, nodes)
    # What the wall of the other end would leave more than the ball there has.
    more = np.maximum(radius[1, 0] - radius[0, 0], 0)
    beyond = np.maximum(radius[0, 1] - radius[1, 1], 0)
    total = more + beyond
    part = np.divide(more, total, out=np.full(len(ends), 0.5), where=total > 0)
    return part, radius, center


def _meeting(unfolded: Unfolded, ends: Index) -> tuple[FloatArray, FloatArray]:
    """Follow the sheets of both ends of edges to where they meet; the middle if that is far off.

    The contacts of a ball surround its center. So two sheets that meet face the surface at a right
    angle or more, and the place lies within half their distance from the middle of the two balls.
    """
    part, radius, center = _parts(unfolded, ends)
    weights = 0.5 * np.stack([1.0 - part, part])
    points = np.einsum("ne,wnea->ea", weights, center)
    radii = np.einsum("ne,wne->e", weights, radius)
    one, other = unfolded.centers[ends[:, 0]], unfolded.centers[ends[:, 1]]
    middle, gap = (one + other) / 2, np.linalg.norm(one - other, axis=1)
    near = np.linalg.norm(points - middle, axis=1) <= FARTHEST_MEETING * gap  # not where NaN
    points[~near], radii[~near] = middle[~near], unfolded.radii[ends[~near]].mean(axis=1)
    return points, radii


def _meeting_of_three(unfolded: Unfolded, triangles: Index) -> tuple[FloatArray, FloatArray, Mask]:
    """Follow the sheets of all corners of triangles to where three of them meet.

    Returns
    -------
    points, radii : (j, 3) and (j,) float64
        NaN where the three do not meet in the triangle nor just beyond one side.
    hidden : (j, 3) bool
        The side, from that corner to the next, beyond which they meet.
    """
    corners = np.asarray(unfolded.faces)[triangles].astype(np.int64)
    walls, nodes = np.broadcast_arrays(corners[:, :, None], corners[:, None, :])
    radii, centers = followed(unfolded, walls, nodes)
    # Weights of the corners with which all walls leave the same radius.
    system = np.ones((len(triangles), 3, 3))
    system[:, :2] = radii[:, :2] - radii[:, 2:]
    size = np.abs(system[:, :2]).max(axis=(1, 2))
    system[:, :2] /= np.where(size > 0, size, 1.0)[:, None, None]
    usable = np.isfinite(system).all(axis=(1, 2))
    system[~usable] = np.eye(3)
    usable &= np.abs(np.linalg.det(system)) > SINGULAR
    system[~usable] = np.eye(3)
    right = np.broadcast_to([[0.0], [0.0], [1.0]], (len(triangles), 3, 1))
    weights = np.linalg.solve(system, right)[..., 0]
    outside = weights < -JUST_BEYOND
    usable &= (weights > -FAR_BEYOND).all(axis=1) & (outside.sum(axis=1) <= 1)
    points = np.einsum("tn,twna->ta", weights, centers) / 3
    radius = np.einsum("tn,twn->t", weights, radii) / 3
    own = unfolded.centers[corners]
    gap = np.linalg.norm(own - own[:, [1, 2, 0]], axis=2).max(axis=1)
    with np.errstate(invalid="ignore"):
        usable &= np.linalg.norm(points - own.mean(axis=1), axis=1) <= FARTHEST_TRIPLE * gap
    points[~usable], radius[~usable] = np.nan, np.nan
    return points, radius, (outside & usable[:, None])[:, [2, 0, 1]]


def clear_balls(sets: FeatureSets, unfolded: Unfolded) -> tuple[Mask, Mask]:
    """Return which balls can be linked, and which lie in walls or at creases; two (u,) arrays.

    A ball can be linked when its contacts are clearly apart, or on the two sides of a wall or of a
    crease.
    """
    rows, parted = unfolded.rows, unfolded.parted
    spacing = local_spacing(unfolded.cloud.surface)[unfolded.cloud.features[rows]].max(axis=1)
    gap = np.linalg.norm(unfolded.points - unfolded.contacts, axis=1)
    cosine = np.einsum("ij,ij->i", unfolded.normals, unfolded.contact_normals)
    wall = cosine < WALL_COSINE
    clear = ((gap >= CLEARLY_APART * spacing) | wall) & ~sets.rim[rows]
    return clear | parted, wall | parted


def pieces(
    sets: FeatureSets, unfolded: Unfolded, clear: Mask, wall: Mask, threshold: float
) -> tuple[IntArray, IntArray, IntArray]:
    """Return the lowest node that each node is linked to, directly or through others, (u,).

    Also the same for links along the surface alone, and the partner of each ball across its sheet.
    """
    from medialis.sheets import _kernels as kernels

    graph = kernels.Links(unfolded.graph.offsets, unfolded.graph.indices)
    u, rows = len(unfolded), unfolded.rows
    touched = unfolded.cloud.features[rows].T.ravel()
    contacts = kernels.Contacts(
        places=np.concatenate([unfolded.points, unfolded.contacts]),
        normals=np.concatenate([unfolded.normals, unfolded.contact_normals]),
        touched=touched,
        regions=unfolded.regions.T.ravel(),
        spacing=local_spacing(unfolded.cloud.surface)[touched],
        rows=rows,
        centers=unfolded.centers,
        radii=unfolded.radii,
        clear=clear,
        closed=sets.closed[rows] & ~unfolded.parted,
        wall=wall,
        tau=threshold - 1.0,
        turn=LARGEST_TURN,
        sets=kernels.Links(sets.samples.offsets, sets.samples.indices),
        clusters=sets.clusters,
    )
    links, partner = np.zeros(len(graph.indices), np.bool_), np.full(u, -1, np.int32)
    given = graph, unfolded.across, contacts, links, partner
    run_chunks(kernels.link_nodes, u, NODES_A_CHUNK, *given)
    piece, region = np.arange(u, dtype=np.int32), np.arange(u, dtype=np.int32)
    kernels.join_links(graph, links, partner, piece)
    kernels.join_links(graph, links, np.full_like(partner, -1), region)
    return piece, region, partner


@dataclass(frozen=True, kw_only=True)
class MedialSheetOptions(SheetPreparation):
    """Options of `medial_sheets`."""

    side: Side = changed(ShrinkOptions, "side")
    smallest: float = number(
        0.002,
        "Smallest sheet",
        "A sheet that covers less than this share of the surface is merged into the "
        "neighbour with the longest common border. 0 keeps all.",
    )
    sheet_threshold: float = number(
        4.0,
        "Sheet threshold",
        "Two neighbouring points are on one sheet when their feature points are "
        "closer together than this many sample spacings. Larger values join more.",
        low=1.5,
        high=100.0,
        advanced=True,
    )
    creases: float = changed(BallOptions, "creases")

    def ball_options(self) -> SurfaceSkeletonOptions:
        """Return the options of the balls: with fans, sheets have no gap at concave edges."""
        return SurfaceSkeletonOptions.taken_from(self, fans=True)


@algorithm(MedialSheetOptions, door=shape_or_cloud, prepare=balls_of)
def medial_sheets(
    cloud: MedialCloud, options: MedialSheetOptions, progress: Progress
) -> MedialSheets:
    """Separate a surface skeleton into its sheets.

    Parameters
    ----------
    cloud : MedialCloud
        All k balls; those of the inner and the outer side never share a sheet.

    Returns
    -------
    MedialSheets
        Every valid ball has a sheet. A component of the surface in which no ball can be linked is
        one sheet.

    Raises
    ------
    InvalidShapeError
        When the cloud has two balls for one sample and side, other than those of fans.

    See Also
    --------
    y_network, sheet_meshes, medial_scaffold : what follows from the sheets.
    parts : the surface divided by its sheets.

    Notes
    -----
    1. The surface is unfolded (`Unfolded`): cut along the creases that sheets end on (convex ones,
       for inner balls), with strips between the balls of fans along the others.
    2. A ball takes part when such a crease parts its two contacts; or it is not of type A3 and they
       are at least two spacings apart, or on the two sides of a wall (normals at least 120 degrees
       apart).
    3. Balls of neighbouring nodes are linked when their second contacts match: no such crease
       parts them, and they lie closer together than the threshold allows and less than 44 degrees
       apart as seen from the center, or have normals less than 45 degrees apart in walls, at
       creases and in one cluster of a feature set. A ball is also linked to that of its second
       contact, where this is the same ball seen from the other side. Balls that touch all round are
       linked when they nearly coincide.
    4. Linked balls are a piece; pieces of at least 8 balls are sheets, not counting balls that
       touch the wall of a neighbouring sheet as well. Those that are in none take the sheet whose
       wall they touch, all others that of the nearest sample along the surface.

    Rims at soft edges are attached, not linked. Where sheets are only two or three samples wide
    there, a splinter of some ten balls may come off; the default of `smallest` merges it.

    Cost O(n); about 1.7 s of processor time for 194,000 samples, 1.3 of them for the feature sets.

    Source: thesis 6.2.2.1, Eq. 6.4-6.5. Deviates: neighbours along the surface and across the sheet
    instead of nearest medial points: the first feature points are then close for certain. Straight
    lines instead of geodesics: at less than four spacings they differ only round the tip of a slit,
    where the spokes differ as well. Creases part contacts, however close they are.

    Examples
    --------
    The skeleton of a box of three different sides has a middle sheet and one behind each edge:

    >>> import medialis
    >>> x = [[x, y, z] for x in (0, 4) for y in (0, 3) for z in (0, 2)]
    >>> q = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> faces = [t for a, b, c, d in q for t in ((a, b, c), (a, c, d))]
    >>> box = medialis.refine(medialis.make_shape(x, faces), longest_edge=0.05)
    >>> medialis.medial_sheets(medialis.surface_skeleton(box)).count
    13
    """
    with progress.stage("sheets", 0.0, 1.0):
        own = options.sheet_threshold, options.creases
        divided = kept(_divide, cloud, own, lambda: _divide(cloud, options, progress), progress)
        return run_patiently(lambda: _numbered(divided, options.smallest), progress)


class _Divided(NamedTuple):
    """Sheet of each node before small ones are merged, and two masks of the nodes."""

    unfolded: Unfolded
    labels: IntArray
    linked: Mask
    front: Mask


def _numbered(divided: _Divided, smallest: float) -> MedialSheets:
    """Merge small sheets into their neighbours, and number them by falling area, inner first."""
    unfolded, side = divided.unfolded, divided.unfolded.cloud.side[divided.unfolded.rows]
    area, labels, count = unfolded.areas, np.array(divided.labels), 0
    for mine in filter(np.any, (side == 1, side == -1)):
        own = np.where(mine, labels, -1)
        if smallest > 0.0:
            own = merge_small(own, area, unfolded.graph, smallest * float(area[mine].sum()))
        labels[mine] = numbered_by_weight(own, area)[mine] + count
        count = labels[mine].max(initial=-1) + 1
    return _of_nodes(divided, labels)


def _of_nodes(divided: _Divided, labels: IntArray) -> MedialSheets:
    """Give each ball what its node has; of several nodes at a crease, the first one's sheet."""
    unfolded, cloud = divided.unfolded, divided.unfolded.cloud
    k, rows = len(cloud), unfolded.rows
    of_row = np.full(k, -1, np.int32)
    of_row[rows[::-1]] = labels[::-1]
    linked, front = np.zeros(k, np.bool_), np.zeros(k, np.bool_)
    linked[rows[divided.linked]] = True
    front[rows[divided.front]] = True
    # The ball of the mean normal at a fan has no node: it lies amid those of its sample.
    of_sample = np.full((2, cloud.surface.point_count), -1, np.int32)
    outer = (cloud.side < 0).astype(np.int64)
    of_sample[outer[rows], unfolded.samples] = labels
    without = cloud.valid & (of_row < 0)
    of_row[without] = of_sample[outer[without], cloud.source[without]]
    return MedialSheets(of_row, linked, front, labels, divided.front, unfolded=unfolded)


def _divide(cloud: MedialCloud, options: MedialSheetOptions, progress: Progress) -> _Divided:
    """Link balls, and spread the pieces over the surface: nothing is merged."""
    with progress.stage("contacts", 0.0, 0.7):
        sets = extended_feature_transform.of(cloud, Options(), progress)
    with progress.stage("unfolding", 0.7, 0.8):
        unfolded = run_patiently(lambda: unfold(cloud, options.creases), progress)
    return run_patiently(lambda: _spread(sets, unfolded, options.sheet_threshold), progress)


def _spread(sets: FeatureSets, unfolded: Unfolded, threshold: float) -> _Divided:
    u = len(unfolded)
    clear, wall = clear_balls(sets, unfolded)
    piece, region, partner = pieces(sets, unfolded, clear, wall, threshold)
    shared = _shared_walls(unfolded, piece, clear)
    own = clear.copy()
    own[shared[:, 0]] = False
    size = np.bincount(piece[own], minlength=u)
    linked = clear & (size[piece] >= LEAST_BALLS)
    back = _backs(piece, region, partner, linked)
    labels = np.full(u, -1, np.int32)
    # Twice the number of the piece, plus 1 on its back: both are spread at once.
    place = np.unique(piece[linked], return_inverse=True)[1].reshape(-1)
    labels[linked] = 2 * place + back[linked]
    node, near = shared[~linked[shared[:, 0]] & linked[shared[:, 1]]].T
    labels[node] = labels[near]
    both = spread_labels(unfolded.points, unfolded.graph, labels)
    for sign in (1, -1):
        mine = unfolded.cloud.side[unfolded.rows] == sign
        if (both[mine] < 0).any():
            both[mine] = _everywhere(unfolded, mine, both)
    return _Divided(unfolded, both // 2, linked, both % 2 == 0)


def _shared_walls(unfolded: Unfolded, piece: IntArray, clear: Mask) -> Index:
    """Return nodes whose ball touches the wall of a neighbour in another piece too, and these.

    Where many sheets meet along a line, as on the axis of a prism, its balls touch all their walls,
    and may choose others than the sheets do. Such a line is no sheet. The clearest pairs come last.
    """
    graph = unfolded.graph
    node = np.repeat(np.arange(len(graph)), graph.lengths)
    apart = clear[node] & clear[graph.indices] & (piece[node] != piece[graph.indices])
    ends = np.stack([node[apart], graph.indices[apart].astype(np.int64)], axis=1)
    part, _, _ = _parts(unfolded, ends)
    shared = part < ON_BORDER
    return ends[shared][np.argsort(-part[shared], kind="stable")]


def _everywhere(unfolded: Unfolded, mine: Mask, both: IntArray) -> IntArray:
    """Spread labels over creases too; a component in which nothing is linked is one sheet."""
    surface, samples = unfolded.cloud.surface, unfolded.samples[mine]
    known, usable = np.full((2, surface.point_count), -1, np.int32)
    np.maximum.at(known, samples, both[mine])
    usable[samples] = 1
    known = spread_labels(surface.points, surface_graph(surface), known)
    number = fill_components(surface.components, known // 2, usable > 0)
    number = 2 * number + np.where(known < 0, 0, known % 2)
    return np.where(both[mine] < 0, number[samples], both[mine])


def _backs(piece: IntArray, region: IntArray, partner: IntArray, linked: Mask) -> Mask:
    """Return which balls lie on the back of their piece: that side with fewer balls, (k,).

    A region is what neighbours along the surface alone link: one side of a sheet, mostly all of it.
    From the largest to the smallest, each takes the side across from those that it has partners in.
    """
    k = len(piece)
    rows = np.flatnonzero(linked)
    size = np.bincount(region[rows], minlength=k)
    met = rows[partner[rows] >= 0]
    pairs, links = np.unique(
        region[met].astype(np.int64) * k + region[partner[met]], return_counts=True
    )
    facing: dict[int, list[tuple[int, int]]] = {}
    for pair, count in zip(pairs.tolist(), links.tolist(), strict=True):
        a, b = divmod(pair, k)
        facing.setdefault(a, []).append((b, count))
        facing.setdefault(b, []).append((a, count))
    side = np.zeros(k, np.int8)  # +1 and -1; 0: not yet
    used = np.flatnonzero(size)
    for a in used[np.lexsort((used, -size[used]))].tolist():
        votes = sum(count * int(side[b]) for b, count in facing.get(a, []) if b != a)
        side[a] = -1 if votes > 0 else 1
    balance = np.bincount(piece[rows], side[region[rows]], minlength=k)
    return side[region] * np.where(balance < 0, -1, 1)[piece] < 0
