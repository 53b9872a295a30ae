"""Patches: the faces of a surface between its edges (thesis 6.3.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from medialis.balls.surface_skeleton import as_cloud
from medialis.model.medial_cloud import MedialCloud
from medialis.model.segmentation import Segmentation
from medialis.options import Options, algorithm, angle, number
from medialis.progress import Progress
from medialis.segments.face_patches import face_patches
from medialis.segments.soft_edges import SoftEdges, soft_edges
from medialis.surface.labels import completed, connected_labels
from medialis.surface.surface_graph import surface_graph
from medialis.threads import run_patiently

LEAST_SAMPLES = 8
"""A piece between edges of fewer samples is no patch: it joins the nearest one."""


ROUND = 0.5
"""Share of the surface on soft edges above which much of a shape is round: a box has 13 %, rounded
cylinder, fandisk and scapula 28 to 37; hand, creature, horse and cow 54 to 62, as have the rounded
castings of rockerarm and screwdriver."""


@dataclass(frozen=True, kw_only=True)
class PatchesOptions(Options):
    """Options of `patches`.

    At 30 degrees, gears, fandisk and rockerarm are divided along the edges that one would draw, and
    the body of the horse stays one patch.
    """

    min_angle: float = angle(
        30.0,
        "Minimum angle",
        "Edges across which the surface turns by less do not separate patches.",
    )
    smallest: float = number(
        0.002,
        "Smallest patch",
        "A patch that covers less than this share of the surface is merged into the "
        "neighbour with the longest common border. 0 keeps all.",
    )


@algorithm(PatchesOptions, door=as_cloud)
def patches(cloud: MedialCloud, options: PatchesOptions, progress: Progress) -> Segmentation:
    """Divide a surface into patches along its edges, sharp or soft.

    Parameters
    ----------
    cloud : MedialCloud
        k balls: inner ones for convex edges, outer ones for concave edges, or both.

    Returns
    -------
    Segmentation
        Every sample has a patch; components of the surface are never joined.

    See Also
    --------
    soft_edges : the edges, as fields on the surface.
    parts : limbs and bodies, or sheets, instead of faces.

    Notes
    -----
    A mesh is divided by its faces: they hang together across all edges of the mesh but creases,
    and those at samples on soft edges (`medialis.soft_edges`) are taken out. What stays connected
    is a patch, and the faces of the soft edges join the nearest one. Patches are one where the
    surface turns by less than `min_angle` across their border, or no more sharply than beside it,
    as in a bore. So patches are connected, and borders follow creases exactly. A sample at a border
    has the largest patch that it touches. A cloud is divided by its samples, without creases.

    Source: thesis 6.3.2. Deviates: creases of a mesh are borders, weak edges do not count, small
    pieces are merged, and with outer balls concave edges separate as well.

    Examples
    --------
    >>> import medialis
    >>> x = [[x, y, z] for x in (0, 4) for y in (0, 3) for z in (0, 2)]
    >>> q = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> faces = [t for a, b, c, d in q for t in ((a, b, c), (a, c, d))]
    >>> box = medialis.make_shape(x, faces)
    >>> medialis.patches(medialis.surface_skeleton(box)).count
    6
    """
    edges, surface = soft_edges.of(cloud, options, progress), cloud.surface
    _note_round(edges, options.min_angle, progress)
    kinds = bool((cloud.side > 0).any()), bool((cloud.side < 0).any())

    def divide() -> Segmentation:
        soft = edges.on_edge(options.min_angle)
        if surface.faces is not None:
            return face_patches(surface, soft, options.min_angle, kinds, options.smallest)
        labels = connected_labels(np.where(soft, -1, 0).astype(np.int32), surface_graph(surface))
        size = np.bincount(labels[labels >= 0], minlength=1)
        labels[size[labels] < LEAST_SAMPLES] = -1
        return completed(surface, labels, options.smallest, fill=True)

    return run_patiently(divide, progress)


def _note_round(edges: SoftEdges, min_angle: float, progress: Progress) -> None:
    """Say that much of a shape is round, so that no one takes all of its patches for faces."""
    areas = edges.cloud.surface.point_areas
    share = float(areas[edges.on_edge(min_angle)].sum() / max(areas.sum(), 1e-300))
    if share > ROUND:
        progress.note(
            f"{100 * share:.0f} % of the surface lies on soft edges: much of the shape is round, "
            "and patches end in the middle of what is, wherever that is. Parts divide limbs; a "
            "larger minimum angle leaves the sharper edges only.",
            "few_edges",
            share=share,
        )
