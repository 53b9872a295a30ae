"""Parts of a shape: its limbs, or the sheets of its skeleton (thesis 6.3.3)."""

from __future__ import annotations

import numpy as np

from medialis.curves.from_balls.curve_skeleton import CurveSkeletonOptions, curve_skeleton
from medialis.errors import InvalidShapeError
from medialis.model.curve_skeleton import CurveSkeleton
from medialis.model.medial_cloud import MedialCloud
from medialis.model.segmentation import Segmentation
from medialis.model.shape import Shape
from medialis.progress import Progress, ProgressCallback
from medialis.segments.limbs import (
    PROTRUDES,
    find_limbs,
    flatness,
    node_widths,
    protrusions,
)
from medialis.segments.patches import completed
from medialis.sheets.sheets import medial_sheets
from medialis.surface.labels import (
    connected_labels,
    diffused_labels,
    smoothed_labels,
    spread_labels,
)
from medialis.surface.surface_graph import surface_graph
from medialis.validation import IntArray, as_choice, as_number, as_whole_number

METHODS = ("auto", "limbs", "sheets")

DEFAULT_SMALLEST = 0.01
"""Fraction of the surface. horse, cow and fertility have 17, 22 and 23 sheets with 1 %, two to four
times as many without a limit."""

DEFAULT_SMOOTHING = 4
"""Rounds. Borders wander by the sample or two by which the second feature points do."""

DIFFUSION = 5
"""Steps of diffusion in a round. The nodes of samples wander more than feature points do."""

FLAT = 1.7
"""A shape is flat where samples lie this many radii from the curve skeleton, in the mean: cross-
sections are then twice as wide as thick. hand, armadillo, fertility, elephant and bunny have 1.2 to
1.6; table, fandisk, rockerarm, spider and scapula 1.9 to 5.9."""


def parts(
    shape: Shape,
    cloud: MedialCloud,
    *,
    method: str = "auto",
    sheet_threshold: float = 4.0,
    smallest: float = DEFAULT_SMALLEST,
    smoothing: int = DEFAULT_SMOOTHING,
    skeleton: CurveSkeleton | None = None,
    progress: Progress | ProgressCallback | None = None,
) -> Segmentation:
    """Divide a shape into parts: limbs and bodies, or the sheets of its skeleton.

    Parameters
    ----------
    shape : Shape
        n samples, as given to `medialis.surface_skeleton`.
    cloud : MedialCloud
        All k balls; outer ones take no part.
    method : {"auto", "limbs", "sheets"}
        "limbs": cut where limbs leave a body, by the curve skeleton; needs a mesh and its whole
        inner cloud. "sheets": one part for each medial sheet. "auto": limbs if some stick out of
        their base, and those are most or the shape is not flat, else sheets; a message says which,
        and why.
    sheet_threshold : float
        As in `medialis.medial_sheets`; only for sheets.
    smallest : float
        Fraction of the surface, 0 to 1: parts that cover less are merged into the neighbour with
        the longest common border.
    smoothing : int
        0 to 100 rounds. Sheets: every sample takes the most common label round it. Limbs: five
        steps of diffusion of the labels, near the borders.
    skeleton : CurveSkeleton, optional
        From `medialis.curve_skeleton`, for limbs; computed when missing.
    progress : callable, optional
        Called with (fraction, text); returning False cancels.

    Returns
    -------
    Segmentation
        Samples without a ball, or a node, have the part of the nearest sample along the surface
        that has one; -1 only in components of the surface where no sample has.

    Raises
    ------
    InvalidShapeError
        When the cloud belongs to a larger shape, the skeleton to another one, or limbs are wanted
        of a point cloud or of a thinned medial cloud.
    InvalidOptionError
        When an option is out of its range.
    Cancelled
        When `progress` asks for it.

    Notes
    -----
    Sheets: each sample belongs to the sheet of its own ball, so the borders are the projected
    Y-curves. A limb that goes over into a body without a Y-curve, as fingers do into a flat hand,
    is one part with it, and large bodies have several sheets.

    Limbs: see `segments/limbs.py`. Each sample belongs to the part of its node.

    Source: thesis 6.3.3. Deviates: small parts are merged and borders smoothed; the thesis knows
    sheets only, and names cuts round the junctions of curve skeletons as what others do.

    Examples
    --------
    >>> import medialis
    >>> shape = medialis.organic_shape(56)
    >>> medialis.parts(shape, medialis.surface_skeleton(shape)).count > 4
    True
    """
    return divide_into_parts(
        shape,
        cloud,
        method=method,
        sheet_threshold=sheet_threshold,
        smallest=smallest,
        smoothing=smoothing,
        skeleton=skeleton,
        progress=progress,
    )[0]


def divide_into_parts(
    shape: Shape,
    cloud: MedialCloud,
    *,
    method: str = "auto",
    sheet_threshold: float = 4.0,
    smallest: float = DEFAULT_SMALLEST,
    smoothing: int = DEFAULT_SMOOTHING,
    skeleton: CurveSkeleton | None = None,
    progress: Progress | ProgressCallback | None = None,
) -> tuple[Segmentation, str]:
    """Return the parts and the method that was taken, "limbs" or "sheets"; see `parts`."""
    method = as_choice(method, "method", METHODS)
    smallest = as_number(smallest, "smallest", low=0.0, high=1.0)
    rounds = as_whole_number(smoothing, "smoothing", low=0, high=100)
    progress = Progress.of(progress)
    inner = np.flatnonzero(cloud.side > 0)
    if len(inner) < len(cloud):
        cloud = cloud.subset(inner)
    if method == "limbs" or (method == "auto" and _is_whole(shape, cloud)):
        with progress.stage("limbs", 0.0, 0.6):
            if skeleton is None:
                skeleton = _skeleton(shape, cloud, progress)
            found = limb_parts(shape, skeleton, smallest=smallest, smoothing=rounds)
        if method == "limbs":
            return found, "limbs"
        limbs, reason = _choose(shape, skeleton, found)
        progress.note(reason)
        if limbs:
            return found, "limbs"
    elif method == "auto":
        progress.note(
            "Divided by medial sheets (method sheets): a curve skeleton needs a mesh with all its "
            "inner balls."
        )
    with progress.stage("sheets", 0.6, 1.0):
        sheets = medial_sheets(
            cloud, sheet_threshold=sheet_threshold, smallest=smallest, progress=progress
        )
        graph = surface_graph(shape)
        labels = np.full(shape.point_count, -1, np.int32)
        labels[cloud.source] = sheets.labels
        labels = smoothed_labels(labels, graph, rounds)
        return completed(shape, graph, labels, smallest, fill=False), "sheets"


def _choose(shape: Shape, skeleton: CurveSkeleton, found: Segmentation) -> tuple[bool, str]:
    """Tell whether limbs describe a shape better than sheets, and why."""
    flat = flatness(shape, skeleton)
    labelled = np.flatnonzero(found.labels >= 0)
    # Parts are numbered from the largest: the first one of each component is no limb.
    order = labelled[np.argsort(found.labels[labelled], kind="stable")]
    bodies = found.labels[order[np.unique(shape.components[order], return_index=True)[1]]]
    limbs = np.setdiff1d(np.arange(found.count), bodies)
    out = limbs[protrusions(shape, found)[limbs] >= PROTRUDES]
    most = found.areas[out].sum() >= found.areas[limbs].sum() / 2
    if len(out) and (most or flat < FLAT):
        return True, (
            f"Divided where limbs leave their bodies, {len(limbs)} in all (method limbs): "
            f"{len(out)} of them stick out, samples lie {flat:.2g} radii from the curve skeleton."
        )
    why = (
        f"the shape is flat, samples lie {flat:.2g} radii from its curve skeleton."
        if flat >= FLAT
        else "the curve skeleton has no limbs that stick out."
    )
    return False, f"Divided by medial sheets (method sheets): {why}"


def limb_parts(
    shape: Shape, skeleton: CurveSkeleton, *, smallest: float, smoothing: int
) -> Segmentation:
    """Divide a mesh by the limbs of its curve skeleton.

    Parameters
    ----------
    shape : Shape
        n samples.
    skeleton : CurveSkeleton
        With the node of each sample.
    smallest, smoothing
        As in `parts`.

    Returns
    -------
    Segmentation

    Raises
    ------
    InvalidShapeError
        When the skeleton has no map from these samples.
    """
    node = skeleton.vertex_node
    if node is None or len(node) != shape.point_count:
        raise InvalidShapeError(
            f"Limbs need a curve skeleton with a node for each of the {shape.point_count} samples, "
            f"got {'none' if node is None else len(node)}: give the skeleton of this shape."
        )
    of_node = find_limbs(skeleton, node_widths(shape, skeleton))
    graph = surface_graph(shape)
    labels: IntArray = np.where(node < 0, -1, of_node[node]).astype(np.int32)
    labels = diffused_labels(spread_labels(shape, graph, labels), graph, DIFFUSION * smoothing)
    return completed(shape, graph, connected_labels(labels, graph), smallest, fill=False)


def _is_whole(shape: Shape, cloud: MedialCloud) -> bool:
    """Tell whether a curve skeleton can be computed."""
    return (
        shape.faces is not None
        and np.array_equal(cloud.source, np.arange(shape.point_count))
        and bool(cloud.valid.any())
    )


def _skeleton(shape: Shape, cloud: MedialCloud, progress: Progress) -> CurveSkeleton:
    if not _is_whole(shape, cloud):
        raise InvalidShapeError(
            "Limbs need a curve skeleton, which needs a mesh with its whole inner cloud; got "
            f"{shape.face_count} faces and {len(cloud)} balls for {shape.point_count} samples. "
            "Use method = sheets."
        )
    share, usual = _extent(shape) / shape.diagonal, CurveSkeletonOptions()
    turned = CurveSkeletonOptions(
        threshold=share * usual.threshold, candidates=share * usual.candidates
    )
    return curve_skeleton.of(cloud, turned, progress)


def _extent(shape: Shape) -> float:
    """Return the diagonal of the bounding box along the principal axes of the surface.

    That along the coordinate axes changes by a fifth when a shape is turned.
    """
    area = shape.point_areas
    away = shape.points - area @ shape.points / area.sum()
    axes = np.linalg.eigh((away.T * area) @ away)[1]
    return float(np.linalg.norm(np.ptp(away @ axes, axis=0)))
