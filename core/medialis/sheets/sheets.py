"""Medial sheets: the smooth pieces of a surface skeleton (thesis 6.2.2.1).

Two balls lie on one sheet when both feature points of one are close to those of the other. Where
sheets run into a convex corner this holds across sheets as well, because there all feature points
are close together. So only balls whose feature points are clearly apart are linked; the others,
those of the rim, are attached to the nearest sheet along the surface afterwards.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.errors import InvalidShapeError
from medialis.kept import kept
from medialis.model.feature_sets import FeatureSets
from medialis.model.medial_cloud import MedialCloud
from medialis.model.medial_sheets import MedialSheets
from medialis.model.shape import Shape
from medialis.options import Options, algorithm, number
from medialis.progress import Progress
from medialis.sheets.extended_features import extended_feature_transform
from medialis.surface.labels import (
    fill_components,
    merge_small,
    numbered_by_weight,
    spread_labels,
)
from medialis.surface.surface_graph import local_spacing, surface_graph
from medialis.threads import run_chunks, run_patiently
from medialis.validation import IntArray

CLEARLY_APART = 2.0
"""Sample spacings between the two feature points from which a ball can be linked. A box of sides 2,
1.5 and 1 has 13 sheets at spacings from 0.03 to 0.17 (six samples across its smallest side) with
2, and fewer at 0.17 with 3, because too few balls are left."""

LARGEST_TURN = 0.75
"""Radii: the chord by which a feature point may move from ball to ball, an angle of 44 degrees.
Near the corner of a box the feature points of two sheets come as close as one likes, but stay 90
degrees apart as seen from the center."""

WALL = -0.5
"""Cosine between the normals at the two feature points of a ball in a wall: 120 degrees or more."""

LEAST_BALLS = 8
"""A piece of fewer linked balls is no sheet; it is attached to its surroundings."""

SAMPLES_A_CHUNK = 8192


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


@algorithm(MedialSheetOptions)
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
        When the cloud has two balls for one sample and side.

    See Also
    --------
    y_network, sheet_meshes, medial_scaffold : what follows from the sheets.
    parts : the surface divided by its sheets.

    Notes
    -----
    1. A ball takes part when it is not of type A3 and its feature points are at least two spacings
       apart, or on the two sides of a wall (normals at least 120 degrees apart).
    2. Balls of neighbouring samples are linked when their second feature points match: they lie
       closer together than the threshold allows and less than 44 degrees apart as seen from the
       center, or in the same cluster of one of the two feature sets with normals less than 45
       degrees apart. A ball is also linked to that of its second feature point, where this is the
       same ball seen from the other side. Balls that touch all round are linked when they nearly
       coincide.
    3. Linked balls are a piece; pieces of at least 8 balls are sheets. All other balls get the
       sheet of the nearest sample along the surface.

    Where sheets are only two or three samples wide, in sharp corners, a splinter of some ten balls
    may come off; the default of `smallest` merges it.

    Cost O(n); about 1.7 s of processor time for 194,000 samples, 1.3 of them for the feature sets.

    Source: thesis 6.2.2.1, Eq. 6.4-6.5. Deviates: neighbours along the surface and across the sheet
    instead of nearest medial points: the first feature points are then close for certain. Straight
    lines instead of geodesics: at less than four spacings they differ only round the tip of a slit,
    where the spokes differ as well. Rims are attached, not linked.

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
    k = len(cloud)
    labels, linked, front = np.full(k, -1, np.int32), np.zeros(k, np.bool_), np.zeros(k, np.bool_)
    with progress.stage("sheets", 0.0, 1.0):
        threshold = options.sheet_threshold
        sides = kept(
            _divide, cloud, threshold, lambda: _divide(cloud, threshold, progress), progress
        )
        for side in sides:
            of_samples = run_patiently(
                functools.partial(_numbered, cloud.surface, side.labels, options.smallest), progress
            )
            own = of_samples[cloud.source[side.rows]]
            labels[side.rows] = np.where(own < 0, -1, own + labels.max() + 1)
            linked[side.rows], front[side.rows] = side.linked, side.front
    return MedialSheets(labels, linked, front, cloud=cloud)


def _numbered(surface: Shape, labels: IntArray, smallest: float) -> IntArray:
    """Merge small sheets into their neighbours, and number them by falling area."""
    area = surface.point_areas
    if smallest > 0.0:
        least = smallest * float(area.sum())
        labels = merge_small(labels, area, surface_graph(surface), least)
    return numbered_by_weight(labels, area)


class _Side(NamedTuple):
    """Inner or outer balls: their rows, the sheet of each sample, and two masks of the rows."""

    rows: IntArray
    labels: IntArray
    linked: NDArray[np.bool_]
    front: NDArray[np.bool_]


def _divide(cloud: MedialCloud, threshold: float, progress: Progress) -> list[_Side]:
    """Link the balls of each side, and spread the pieces over the surface: nothing is merged."""
    with progress.stage("contacts", 0.0, 0.8):
        sets = extended_feature_transform.of(cloud, Options(), progress)
    sides = [np.flatnonzero(cloud.valid & (cloud.side == sign)) for sign in (1, -1)]
    return [
        run_patiently(functools.partial(_side, sets, rows.astype(np.int32), threshold), progress)
        for rows in sides
        if len(rows)
    ]


def _side(sets: FeatureSets, rows: IntArray, threshold: float) -> _Side:
    cloud, shape = sets.cloud, sets.cloud.surface
    row_of = np.full(shape.point_count, -1, np.int32)
    row_of[cloud.source[rows]] = rows
    if len(rows) != np.count_nonzero(row_of >= 0):
        raise InvalidShapeError("The cloud has several balls for one sample and side.")
    clear, wall = _clear_balls(sets, rows)
    piece, region, partner = _pieces(sets, row_of, clear, wall, threshold)
    size = np.bincount(piece[clear], minlength=len(cloud))
    linked = clear & (size[piece] >= LEAST_BALLS)
    back = _backs(piece, region, partner, linked)
    labels, source = np.full(shape.point_count, -1, np.int32), cloud.source
    # Twice the number of the piece, plus 1 on its back: both are spread at once.
    place = np.unique(piece[linked], return_inverse=True)[1].reshape(-1)
    labels[source[linked]] = 2 * place + back[linked]
    both, usable = spread_labels(shape, surface_graph(shape), labels), row_of >= 0
    labels = fill_components(shape, np.where(both < 0, -1, both // 2).astype(np.int32), usable)
    labels[~usable] = -1
    side = both[source[rows]]
    return _Side(rows, labels, linked[rows], (side < 0) | (side % 2 == 0))


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


def _clear_balls(sets: FeatureSets, rows: IntArray) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which balls can be linked, and which lie in walls; two (k,) arrays.

    A ball can be linked when its feature points are clearly apart, or on the two sides of a wall.
    """
    cloud, shape = sets.cloud, sets.cloud.surface
    spacing = local_spacing(shape)
    first, second = cloud.features[rows].T
    gap = np.linalg.norm(shape.points[first] - shape.points[second], axis=1)
    cosine = np.einsum("ij,ij->i", shape.normals[first], shape.normals[second])
    clear, wall = np.zeros(len(cloud), np.bool_), np.zeros(len(cloud), np.bool_)
    wall[rows] = cosine < WALL
    clear[rows] = gap >= CLEARLY_APART * np.maximum(spacing[first], spacing[second])
    return (clear | wall) & ~sets.rim, wall


def _pieces(
    sets: FeatureSets,
    row_of: IntArray,
    clear: NDArray[np.bool_],
    wall: NDArray[np.bool_],
    threshold: float,
) -> tuple[IntArray, IntArray, IntArray]:
    """Return the lowest row that each ball is linked to, directly or through others, (k,).

    Also the same for links along the surface alone, and the partner of each ball across its sheet.
    """
    from medialis.sheets._sheet_kernels import join_links, link_across, link_neighbours

    cloud, shape = sets.cloud, sets.cloud.surface
    graph, k = surface_graph(shape), len(cloud)
    balls = shape.points, shape.normals, cloud.features, cloud.centers, cloud.radii
    rules = local_spacing(shape), sets.closed, clear, wall, threshold - 1.0, LARGEST_TURN
    members = sets.samples.offsets, sets.samples.indices, sets.clusters
    links, partner = np.zeros(len(graph.indices), np.bool_), np.full(k, -1, np.int32)

    def work(begin: int, end: int) -> None:
        link_neighbours(
            begin, end, row_of, graph.offsets, graph.indices, *balls, *rules, *members, links,
        )  # fmt: skip
        link_across(begin, end, row_of, *balls, *rules, *members, partner)

    run_chunks(work, shape.point_count, SAMPLES_A_CHUNK)
    piece, region = np.arange(k, dtype=np.int32), np.arange(k, dtype=np.int32)
    join_links(row_of, graph.offsets, graph.indices, links, partner, piece)
    join_links(row_of, graph.offsets, graph.indices, links, np.full_like(partner, -1), region)
    return piece, region, partner
