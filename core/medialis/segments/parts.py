"""Parts of a shape: its limbs, or the sheets of its skeleton (thesis 6.3.3)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

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
from medialis.segments.connected import tell_pieces
from medialis.segments.limbs import PROTRUDES, find_limbs, flatness, node_widths, protrusions
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
from medialis.validation import IntArray

DIFFUSION = 5
"""Steps of diffusion in a round."""

FLAT = 1.7
"""A shape is flat where samples lie this many radii from the curve skeleton, in the mean: cross-
sections are then twice as wide as thick. hand, armadillo, fertility, elephant and bunny have 1.2 to
1.6; table, fandisk, rockerarm, spider and scapula 1.9 to 5.9."""


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
        "limbs: cut where limbs leave a body, for animals, people, tubes. sheets: one"
        " part for each sheet of the skeleton, for flat and blocky shapes. auto: "
        "limbs if some stick out of their base, else sheets.",
        ("auto", "limbs", "sheets"),
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
    """Divide a shape into parts: limbs and bodies, or the sheets of its skeleton.

    Parameters
    ----------
    cloud : MedialCloud
        All k balls; outer ones take no part.

    Returns
    -------
    Segmentation
        Its ``method`` tells the method that was taken, "limbs" or "sheets". Samples without a ball,
        or a node, have the part of the nearest sample along the surface that has one; -1 only in
        components of the surface where no sample has.

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
    `segments/limbs.py`. The method "auto" takes them if some stick out of their base, and those are
    most or the shape is not flat; a message says what was taken, and why.

    A round of smoothing is five steps of diffusion of the labels, near the borders. Limbs are
    connected. A sheet may have its two walls in two pieces of the surface: a message says so.

    Source: thesis 6.3.3. Deviates: small parts are merged and borders smoothed; the thesis knows
    sheets only, and names cuts round the junctions of curve skeletons as what others do.

    Examples
    --------
    >>> import medialis
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    >>> found = medialis.parts(cloud)
    >>> found.count > 4, found.method
    (True, 'limbs')
    """
    inner, method = cloud.inner.own, options.method
    if method == "limbs" or (method == "auto" and _has_curves(inner)):
        with progress.stage("limbs", 0.0, 0.6):
            found, flat = _by_limbs(inner, options, progress)
        if method == "limbs" or _describe_better(found, flat, progress):
            return found
    elif method == "auto":
        progress.note(
            "Divided by medial sheets (method sheets): a curve skeleton needs a mesh with all its "
            "inner balls.",
            "divided_by_sheets",
            reason="no_mesh",
        )
    with progress.stage("sheets", 0.6, 1.0):
        return _sheet_parts(inner, options, progress)


def better_method(
    cloud: MedialCloud, options: PartsOptions, progress: Progress
) -> Literal["limbs", "sheets"]:
    """Tell what the method "auto" takes; a message says why. Few samples are enough for that."""
    found, flat = _by_limbs(cloud.inner.own, options, progress.still)
    return "limbs" if _describe_better(found, flat, progress) else "sheets"


def _by_limbs(
    inner: MedialCloud, options: PartsOptions, progress: Progress
) -> tuple[Segmentation, float]:
    """Divide a mesh by its limbs; also how flat it is."""
    limbs = kept(_limbs, inner, None, lambda: _limbs(inner, progress), progress)
    labels = _main_limbs(inner.surface, limbs.labels, progress)
    found = run_patiently(lambda: _limb_parts(inner.surface, labels, options), progress)
    return found, limbs.flatness


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


class _Limbs(NamedTuple):
    """Limb or body of each sample before smoothing and merging, and how flat the shape is."""

    labels: IntArray
    flatness: float


def _limbs(cloud: MedialCloud, progress: Progress) -> _Limbs:
    """Divide a mesh by the limbs of its curve skeleton."""
    surface = cloud.surface
    if not _has_curves(cloud):
        raise InvalidShapeError(
            "Limbs need a curve skeleton, which needs a mesh with its whole inner cloud; got "
            f"{surface.face_count} faces and {len(cloud)} balls for {surface.point_count} samples. "
            "Use method = sheets."
        )
    extent, usual = run_patiently(lambda: _extent(surface), progress), CurveSkeletonOptions()
    share = extent / surface.diagonal
    of_extent = CurveSkeletonOptions(
        threshold=share * usual.threshold, candidates=share * usual.candidates
    )
    skeleton = curve_skeleton.of(cloud, of_extent, progress)
    node = skeleton.vertex_node
    assert node is not None

    def divide() -> _Limbs:
        of_node = find_limbs(skeleton, node_widths(skeleton))
        labels: IntArray = np.where(node < 0, -1, of_node[node]).astype(np.int32)
        return _Limbs(
            spread_labels(surface.points, surface_graph(surface), labels),
            flatness(skeleton),
        )

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


def _limb_parts(surface: Shape, labels: IntArray, options: PartsOptions) -> Segmentation:
    """Smooth the borders of limbs, and merge small ones."""
    graph = surface_graph(surface)
    labels = connected_labels(diffused_labels(labels, graph, DIFFUSION * options.smoothing), graph)
    return completed(surface, labels, options.smallest, method="limbs")


def _describe_better(found: Segmentation, flat: float, progress: Progress) -> bool:
    """Tell whether limbs describe a shape better than sheets, and say why."""
    components = found.surface.components
    labelled = np.flatnonzero(found.labels >= 0)
    # Parts are numbered from the largest: the first one of each component is no limb.
    order = labelled[np.argsort(found.labels[labelled], kind="stable")]
    bodies = found.labels[order[np.unique(components[order], return_index=True)[1]]]
    limbs = np.setdiff1d(np.arange(found.count), bodies)
    out = limbs[run_patiently(lambda: protrusions(found), progress)[limbs] >= PROTRUDES]
    most = 2 * len(out) > len(limbs)
    counts: dict[str, Any] = {"limbs": len(limbs), "sticking_out": len(out), "flatness": flat}
    if len(out) and (most or flat < FLAT):
        progress.note(
            f"Divided where limbs leave their bodies, {len(limbs)} in all (method limbs): "
            f"{len(out)} of them stick out, samples lie {flat:.2g} radii from the curve skeleton.",
            "divided_by_limbs",
            **counts,
        )
        return True
    reason, why = "no_limbs", "the curve skeleton has no limbs that stick out."
    if flat >= FLAT:
        reason = "flat"
        why = f"the shape is flat, samples lie {flat:.2g} radii from its curve skeleton."
    progress.note(
        f"Divided by medial sheets (method sheets): {why}",
        "divided_by_sheets",
        reason=reason,
        **counts,
    )
    return False


def _has_curves(cloud: MedialCloud) -> bool:
    """Tell whether a curve skeleton can be computed."""
    return cloud.surface.faces is not None and cloud.whole and bool(cloud.valid.any())


def _extent(shape: Shape) -> float:
    """Return the diagonal of the bounding box along the principal axes of the surface.

    That along the coordinate axes changes by a fifth when a shape is turned.
    """
    area = shape.point_areas
    away = shape.points - area @ shape.points / area.sum()
    axes = np.linalg.eigh((away.T * area) @ away)[1]
    return float(np.linalg.norm(np.ptp(away @ axes, axis=0)))
