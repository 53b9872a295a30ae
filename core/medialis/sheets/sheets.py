"""Medial sheets: the smooth pieces of a surface skeleton (thesis 6.2.2.1).

Two balls lie on one sheet when both contacts of one are close to those of the other. Where sheets
run into a convex edge or corner this holds across sheets as well, because there all contacts are
close together. At a crease it is known which side each contact is on. At soft edges only balls
whose contacts are clearly apart are linked; the others, those of the rim, are attached to the
nearest sheet along the surface afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.balls.surface_skeleton import as_cloud
from medialis.balls.thin_walls import BallOptions
from medialis.kept import kept
from medialis.model.feature_sets import FeatureSets
from medialis.model.medial_cloud import MedialCloud
from medialis.model.medial_sheets import MedialSheets
from medialis.model.unfolded import Unfolded
from medialis.options import Options, algorithm, changed, number
from medialis.progress import Progress
from medialis.sheets.borders import parts_to_border
from medialis.sheets.extended_features import extended_feature_transform
from medialis.sheets.linking import clear_balls, pieces
from medialis.sheets.unfolding import unfold
from medialis.surface.labels import (
    fill_components,
    merge_small,
    numbered_by_weight,
    spread_labels,
)
from medialis.surface.surface_graph import surface_graph
from medialis.threads import run_patiently
from medialis.validation import IntArray

LEAST_BALLS, ON_BORDER = 8, 0.1
"""A piece of fewer linked balls is no sheet, not counting those that lie on its border: nearer than
this share of the way to the next sample. It is attached to its surroundings."""


@dataclass(frozen=True, kw_only=True)
class MedialSheetOptions(Options):
    """Options of `medial_sheets`."""

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


@algorithm(MedialSheetOptions, door=as_cloud)
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
    linked: NDArray[np.bool_]
    front: NDArray[np.bool_]


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


def _shared_walls(
    unfolded: Unfolded, piece: IntArray, clear: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Return nodes whose ball touches the wall of a neighbour in another piece too, and these.

    Where many sheets meet along a line, as on the axis of a prism, its balls touch all their walls,
    and may choose others than the sheets do. Such a line is no sheet. The clearest pairs come last.
    """
    graph = unfolded.graph
    node = np.repeat(np.arange(len(graph)), graph.lengths)
    apart = clear[node] & clear[graph.indices] & (piece[node] != piece[graph.indices])
    ends = np.stack([node[apart], graph.indices[apart].astype(np.int64)], axis=1)
    part = parts_to_border(unfolded, ends)
    shared = part < ON_BORDER
    return ends[shared][np.argsort(-part[shared], kind="stable")]


def _everywhere(unfolded: Unfolded, mine: NDArray[np.bool_], both: IntArray) -> IntArray:
    """Spread labels over creases too; a component in which nothing is linked is one sheet."""
    surface, samples = unfolded.cloud.surface, unfolded.samples[mine]
    known, usable = np.full((2, surface.point_count), -1, np.int32)
    np.maximum.at(known, samples, both[mine])
    usable[samples] = 1
    known = spread_labels(surface.points, surface_graph(surface), known)
    number = fill_components(surface.components, known // 2, usable > 0)
    number = 2 * number + np.where(known < 0, 0, known % 2)
    return np.where(both[mine] < 0, number[samples], both[mine])


def _backs(
    piece: IntArray, region: IntArray, partner: IntArray, linked: NDArray[np.bool_]
) -> NDArray[np.bool_]:
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
