"""Patches of a mesh: its faces between creases and soft edges (for thesis 6.3.2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from medialis.model.ragged import Ragged
from medialis.model.segmentation import Segmentation
from medialis.model.shape import Shape
from medialis.segments.face_edges import FaceEdges, joined_across_weak
from medialis.surface.labels import (
    connected_labels,
    diffused_labels,
    fill_components,
    merge_small,
    numbered_by_weight,
)
from medialis.surface.surface_graph import nearest_seeds
from medialis.validation import IntArray

LEAST_FACES = 8
"""A piece of fewer faces beside a soft edge is left over from the edge: it joins the nearest."""

DIFFUSION = 40
"""Steps by which borders in soft edges are straightened: they move by about six faces at most."""


def face_patches(
    surface: Shape,
    soft: NDArray[np.bool_],
    min_angle: float,
    kinds: tuple[bool, bool],
    smallest: float,
) -> Segmentation:
    """Divide the faces of a mesh along creases and through the middle of soft edges.

    Parameters
    ----------
    surface : Shape
        A mesh of n samples and m faces.
    soft : (n,) bool
        Samples on soft edges.
    min_angle : float
        Degrees by which the mesh bends at a crease.
    kinds : (convex, concave)
        Which creases divide.
    smallest : float
        Share of the surface below which a patch is merged.

    Notes
    -----
    Faces hang together across all edges but creases. Those at soft samples are taken out; what
    hangs together still is a patch, and the faces taken out join the nearest one that they hang
    together with. Two patches across whose common border the surface hardly turns are one. So
    creases are borders exactly, and each patch is connected.
    """
    edges = FaceEdges.of(surface, min_angle, kinds)
    across, smooth = edges.graph(creases=True), edges.graph(creases=False)
    area, every = surface.face_areas, np.ones(surface.face_count, np.bool_)
    corners = np.asarray(surface.faces)
    free = ~soft[corners].any(axis=1) & (area > 0)
    labels = _without_scraps(connected_labels(np.where(free, 0, -1), smooth), smooth)
    seed = nearest_seeds(surface.points[corners].mean(axis=1), smooth, labels >= 0)[0]
    labels = np.where(seed < 0, -1, labels[seed])
    labels = fill_components(connected_labels(0 * labels, smooth), labels, every)
    labels = joined_across_weak(edges, labels, seed, free, min_angle)
    labels = connected_labels(diffused_labels(labels, smooth, DIFFUSION), smooth)
    for graph in (smooth, across):
        labels = merge_small(labels, area, graph, smallest * float(area.sum()))
    labels = numbered_by_weight(labels, area)
    return Segmentation(_of_samples(surface, labels), surface=surface, face_labels=labels)


def _without_scraps(labels: IntArray, graph: Ragged) -> IntArray:
    """Take out pieces of few faces beside faces that are taken out."""
    face = np.repeat(np.arange(len(labels)), graph.lengths)
    beside = labels[face[labels[graph.indices] < 0]]
    count = int(labels.max(initial=-1)) + 1
    scrap = np.bincount(labels[labels >= 0], minlength=count) < LEAST_FACES
    scrap &= np.bincount(beside[beside >= 0], minlength=count) > 0
    return np.where((labels >= 0) & np.append(scrap, False)[labels], -1, labels).astype(np.int32)


def _of_samples(surface: Shape, labels: IntArray) -> IntArray:
    """Give each sample the largest patch that it touches; -1 to those without a face.

    So all samples of a crease have one label.
    """
    none = int(labels.max(initial=-1)) + 1
    result = np.full(surface.point_count, none, np.int32)
    np.minimum.at(result, np.asarray(surface.faces), labels[:, None])
    return np.where(result == none, -1, result).astype(np.int32)
