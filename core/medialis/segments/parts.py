"""Parts of a shape: as people see them, its limbs, or its sheets (thesis 6.3.3)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from medialis.balls.surface_skeleton import as_cloud
from medialis.curves.from_balls.curve_skeleton import CurveSkeletonOptions, curve_skeleton
from medialis.errors import InvalidShapeError
from medialis.kept import kept
from medialis.model.medial_cloud import MedialCloud
from medialis.model.segmentation import Segmentation
from medialis.model.shape import Shape
from medialis.options import Options, algorithm, changed, choice, number, whole
from medialis.progress import Progress
from medialis.segments.clusters import divide_sites, join_tree
from medialis.segments.connected import tell_pieces
from medialis.segments.limbs import find_limbs, node_widths
from medialis.segments.pairs import share_together
from medialis.segments.sites import APART, Sites, all_placements
from medialis.segments.valleys import into_valleys, without_strips
from medialis.sheets.sheets import MedialSheetOptions, medial_sheets
from medialis.surface.labels import (
    completed,
    connected_labels,
    diffused_labels,
    merge_small,
    spread_labels,
)
from medialis.surface.surface_graph import surface_graph
from medialis.threads import run_patiently
from medialis.validation import FloatArray, IntArray, frozen

DIFFUSION = 5
"""Steps of diffusion in a round."""

USUAL_ROUNDS = 4
"""Of smoothing, in which heat spreads as far as sites are apart."""

MOST_LIMBS = 64
"""Before borders are smoothed. Where noise has more limbs, those of less than this part of the
surface are merged first: every sample would have a share of hundreds."""


@dataclass(frozen=True, kw_only=True)
class PartsOptions(Options):
    """Options of `parts`.

    horse, cow and fertility have 17, 22 and 23 sheets of 1 % of the surface, two to four times as
    many without a limit. Borders wander by the sample or two by which second feature points do.
    """

    method: str = choice(
        "auto",
        "Method",
        "auto: parts as people see them, cut where a shape bends inwards or gets thinner. limbs: "
        "cut where limbs leave a body, by the curve skeleton. sheets: one part for each sheet of "
        "the skeleton. Point clouds have sheets in any case.",
        ("auto", "limbs", "sheets"),
    )
    level: float = number(
        0.5,
        "Level",
        "Places are in one part where at least this share of people is expected to put them there: "
        "more makes more parts. For the method auto.",
        low=0.02,
        high=0.98,
    )
    count: int = whole(
        0,
        "Number of parts",
        "Divide into so many parts instead, where as many are larger than the smallest part; 0: "
        "as the level says. For the method auto.",
        high=100,
    )
    smallest: float = number(
        0.01,
        "Smallest part",
        "A part that covers less than this share of the surface is merged into the "
        "neighbour with the longest common border. 0 keeps all.",
    )
    smoothing: int = whole(
        4,
        "Smoothing",
        "Rounds in which the borders of the parts are straightened.",
        high=100,
    )
    sheet_threshold: float = changed(MedialSheetOptions, "sheet_threshold", advanced=True)
    creases: float = changed(MedialSheetOptions, "creases")


@algorithm(PartsOptions, door=as_cloud)
def parts(cloud: MedialCloud, options: PartsOptions, progress: Progress) -> Segmentation:
    """Divide a shape into parts: as people see them, by its limbs, or by its sheets.

    Parameters
    ----------
    cloud : MedialCloud
        All k balls; outer ones take no part.

    Returns
    -------
    Segmentation
        Its ``method`` tells the method that was taken, "auto", "limbs" or "sheets". That of "auto"
        has ``joins``, by which its parts make fewer. Samples without a ball, or a node, have the
        part of the nearest sample along the surface that has one; -1 only in components of the
        surface where no sample has.

    Raises
    ------
    InvalidShapeError
        When limbs are wanted of a point cloud or of a thinned medial cloud.

    See Also
    --------
    curve_skeleton, medial_sheets : what the parts rest on.
    patches : faces between edges instead of limbs.

    Notes
    -----
    Sheets: each sample belongs to the sheet of its own ball, so the borders are the projected
    Y-curves. A limb that goes over into a body without a Y-curve, as fingers do into a flat hand,
    is one part with it, and large bodies have several sheets.

    Limbs need a mesh and its whole inner cloud; each sample belongs to the part of its node. See
    `segments/limbs.py`.

    The method "auto" needs the same. It spreads 500 sites over the surface, four times
    (`segments/sites.py`), says for each two how many people would put them into one part
    (`segments/pairs.py`), and joins them (`segments/clusters.py`): at level 0.5 to the division
    with which most people are expected to agree. Samples have the part with which the sites round
    them have most in common, and borders are drawn into valleys (`segments/valleys.py`).

    A round of smoothing is five steps of diffusion of the labels, near the borders; that of "auto"
    is by lengths. Limbs are connected. A sheet may have its two walls in two pieces of the surface:
    a message says so.

    Source: thesis 6.3.3. Deviates: small parts are merged and borders smoothed; the thesis knows
    sheets only, and names cuts round the junctions of curve skeletons as what others do.

    Examples
    --------
    >>> import medialis
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    >>> found = medialis.parts(cloud)
    >>> found.count > 4, found.method
    (True, 'auto')
    """
    inner = cloud.inner.own
    if options.method == "limbs":
        return _by_limbs(inner, options, progress)
    if options.method == "auto":
        sites = _sites(inner, progress) if _has_curves(inner) else None
        if sites is not None:
            return as_seen(inner.surface, sites, options, progress)
        progress.note(
            "Divided by medial sheets (method sheets): other parts need a mesh with an area and "
            "all its inner balls.",
            "divided_by_sheets",
            reason="no_mesh",
        )
    return _sheet_parts(inner, options, progress)


class SeenSites(NamedTuple):
    """Sites on a surface, and the share of people who put each two into one part."""

    sites: Sites
    shares: FloatArray


def _sites(inner: MedialCloud, progress: Progress) -> SeenSites | None:
    """Spread sites over the surface of a cloud; None where there is no place for any."""

    def spread() -> SeenSites | None:
        with progress.stage("sites", 0.0, 0.3):
            placed = run_patiently(lambda: all_placements(inner), progress)
        if not placed:
            return None
        with progress.stage("pairs", 0.3, 0.8):
            area = inner.surface.point_areas / inner.surface.area
            shares = run_patiently(lambda: share_together(placed, area), progress)
        return SeenSites(placed[0], shares)

    return kept(all_placements, inner, None, spread, progress)


def as_seen(
    surface: Shape, seen: SeenSites, options: PartsOptions, progress: Progress
) -> Segmentation:
    """Divide a surface by its sites."""
    sites, shares = seen

    def divide() -> Segmentation:
        cluster = divide_sites(shares, sites.areas, options.level, options.count)
        labels = _of_samples(sites, shares, cluster)
        found = _with_tree(_in_valleys(sites, surface, labels, options), seen)
        if options.count > 0:
            return found.joined(options.count)
        assert found.join_levels is not None
        # Sites know what their caps hold; parts have come to belong together since, perhaps.
        turns = int((found.join_levels >= options.level).sum())
        if turns == 0:
            return found
        joined = connected_labels(found.joined(found.count - turns).labels, surface_graph(surface))
        return _with_tree(completed(surface, joined, options.smallest, method="auto"), seen)

    with progress.stage("clusters", 0.8, 1.0):
        return run_patiently(divide, progress)


def _in_valleys(
    sites: Sites, surface: Shape, labels: IntArray, options: PartsOptions
) -> Segmentation:
    """Merge small parts, and draw the borders into valleys."""
    distance = sites.spacing * surface.diagonal * np.sqrt(options.smoothing / USUAL_ROUNDS)
    graph = surface_graph(surface)
    labels = connected_labels(labels, graph)
    if options.count == 0 and options.smallest > 0:
        labels = without_strips(surface, labels, APART * sites.spacing * surface.diagonal)
    found = completed(surface, labels, options.smallest, method="auto")
    if options.smoothing == 0 or found.count < 2:
        return found
    drawn = connected_labels(into_valleys(surface, found.labels, distance), graph)
    return completed(surface, drawn, options.smallest, method="auto")


def _of_samples(sites: Sites, shares: FloatArray, cluster: IntArray) -> IntArray:
    """Give each sample the cluster that the sites round it have most in common with."""
    members = np.zeros((len(sites), int(cluster.max()) + 1))
    members[np.arange(len(sites)), cluster] = sites.areas
    common = sites.shares @ (shares @ members / members.sum(axis=0))
    known = np.diff(sites.shares.indptr) > 0
    return np.where(known, common.argmax(axis=1), -1).astype(np.int32)


def _with_tree(found: Segmentation, seen: SeenSites) -> Segmentation:
    """Add the tree by which the parts are joined to fewer."""
    known = np.flatnonzero(found.labels >= 0)
    members = np.zeros((len(found.labels), found.count))
    members[known, found.labels[known]] = found.surface.point_areas[known]
    held = seen.sites.shares.T @ members
    total = held.sum(axis=0)
    between = held.T @ seen.shares @ held
    between /= np.maximum(total[:, None] * total[None, :], 1e-300)
    joins, levels = join_tree(np.clip(between, 0.0, 1.0), np.maximum(total, 1e-300))
    return replace(found, joins=joins, join_levels=levels)


def _by_limbs(inner: MedialCloud, options: PartsOptions, progress: Progress) -> Segmentation:
    """Divide a mesh by its limbs."""
    limbs = kept(_limbs, inner, None, lambda: _limbs(inner, progress), progress)
    labels = _main_limbs(inner.surface, limbs, progress)
    return run_patiently(lambda: _straightened(inner.surface, labels, options, "limbs"), progress)


def _sheet_parts(cloud: MedialCloud, options: PartsOptions, progress: Progress) -> Segmentation:
    """Give each sample the sheet of its ball."""
    sheets = medial_sheets.of(cloud, options, progress)

    def divide() -> Segmentation:
        labels = np.full(cloud.surface.point_count, -1, np.int32)
        labels[cloud.source] = sheets.labels
        steps = DIFFUSION * options.smoothing
        return completed(cloud.surface, labels, options.smallest, method="sheets", steps=steps)

    found = run_patiently(divide, progress)
    tell_pieces(found, progress)
    return found


def _limbs(cloud: MedialCloud, progress: Progress) -> IntArray:
    """Limb or body of each sample of a mesh, before smoothing and merging."""
    surface = cloud.surface
    if not _has_curves(cloud):
        raise InvalidShapeError(
            "Limbs need a curve skeleton, which needs a mesh with its whole inner cloud; got "
            f"{surface.face_count} faces and {len(cloud)} balls for {surface.point_count} samples. "
            "Use method = sheets."
        )
    share = run_patiently(lambda: extent_share(surface), progress)
    usual = CurveSkeletonOptions()
    of_extent = CurveSkeletonOptions(
        threshold=share * usual.threshold, candidates=share * usual.candidates
    )
    skeleton = curve_skeleton.of(cloud, of_extent, progress)
    node = skeleton.vertex_node
    assert node is not None

    def divide() -> IntArray:
        of_node = find_limbs(skeleton, node_widths(skeleton))
        labels: IntArray = np.where(node < 0, -1, of_node[node]).astype(np.int32)
        return frozen(spread_labels(surface.points, surface_graph(surface), labels), np.int32)

    return run_patiently(divide, progress)


def _main_limbs(surface: Shape, labels: IntArray, progress: Progress) -> IntArray:
    """Merge the smallest limbs where there are very many, and say so."""
    count = len(np.unique(labels[labels >= 0]))
    if count <= MOST_LIMBS:
        return labels
    graph, smallest = surface_graph(surface), surface.area / MOST_LIMBS
    merged = merge_small(labels, surface.point_areas, graph, smallest)
    left = len(np.unique(merged[merged >= 0]))
    if left < count:  # else each is a component of the surface
        progress.note(
            f"The curve skeleton has {count} limbs, as noise and crossing faces make them; those "
            f"of less than {100 / MOST_LIMBS:.2g} % of the surface were merged: {left} are left.",
            "limbs_merged",
            limbs=count,
            left=left,
        )
    return merged


def _straightened(
    surface: Shape, labels: IntArray, options: PartsOptions, method: str
) -> Segmentation:
    """Smooth the borders of connected parts, and merge small ones."""
    graph = surface_graph(surface)
    labels = connected_labels(diffused_labels(labels, graph, DIFFUSION * options.smoothing), graph)
    return completed(surface, labels, options.smallest, method=method)


def _has_curves(cloud: MedialCloud) -> bool:
    """Tell whether a curve skeleton can be computed."""
    return cloud.surface.faces is not None and cloud.whole and bool(cloud.valid.any())


def extent_share(shape: Shape) -> float:
    """Return the diagonal of the box along the principal axes of a surface, in its own diagonals.

    The box along the coordinate axes changes by a fifth when a shape is turned.
    """
    area = shape.point_areas
    if not area.sum() > 0.0 or not shape.diagonal > 0.0:
        return 1.0
    points = (shape.points - shape.bounds[0]) / shape.diagonal
    away = points - area @ points / area.sum()
    axes = np.linalg.eigh((away.T * (area / area.sum())) @ away)[1]
    return float(np.linalg.norm(np.ptp(away @ axes, axis=0)))
