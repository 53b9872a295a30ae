"""Where sheets meet: on the edges and in the triangles of the unfolded surface (thesis 6.2.2.2).

Each ball knows its second contact and the plane that touches the surface there. How the radius
would change if that plane were the only wall is known beside the sample as well, so the sheet of a
ball can be followed a little further. Along an edge between balls of two sheets, both sheets are
followed until they meet: that is a point of the Y-curve, exact where the surface is flat. In a
triangle between three sheets, all three meet at a point.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from medialis.model.edge_table import EdgeTable
from medialis.model.medial_sheets import MedialSheets
from medialis.model.unfolded import Unfolded
from medialis.surface.surface_graph import local_spacing
from medialis.validation import FloatArray

Index = NDArray[np.int64]

LONGEST_JUMP = 4.0
"""Sample spacings between two balls on different sheets that still lie on both sides of a Y-curve.
Behind a right edge, balls are 1.4 spacings apart; ligatures and jumps stretch them further."""

PARALLEL = 1e-6
"""1 - cosine between two spokes: walls that are hardly inclined say nothing about a radius."""

FARTHEST = 0.75
"""Distances between two balls, from their middle to where their sheets meet; flat ones: 0.5."""

SINGULAR, BESIDE, BEYOND = 1e-9, 0.05, 1.0
"""Determinant of three walls that meet nowhere; how far beyond a side of a triangle a place where
they do still lies in it, and may lie at all: shares of the height."""


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
    np.divide(height, off, out=radius, where=off > PARALLEL)
    return radius, unfolded.points[nodes] - radius[..., None] * n


def parts_to_border(unfolded: Unfolded, ends: Index) -> FloatArray:
    """Return which part of each edge (e, 2) lies before the place where the two sheets meet, (e,).

    A half where following the sheets leads nowhere.
    """
    return _parts(unfolded, ends)[0]


def _parts(unfolded: Unfolded, ends: Index) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return these parts, and radii (2, 2, e) and centers of walls (first) at nodes (second)."""
    walls, nodes = np.broadcast_arrays(ends.T[:, None], ends.T[None])
    radius, center = followed(unfolded, walls, nodes)
    # What the wall of the other end would leave more than the ball there has.
    more = np.maximum(radius[1, 0] - radius[0, 0], 0)
    beyond = np.maximum(radius[0, 1] - radius[1, 1], 0)
    total = more + beyond
    return (
        np.divide(more, total, out=np.full(len(ends), 0.5), where=total > 0),
        radius,
        center,
    )


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
    near = np.linalg.norm(points - middle, axis=1) <= FARTHEST * gap  # not where NaN
    points[~near], radii[~near] = middle[~near], unfolded.radii[ends[~near]].mean(axis=1)
    return points, radii


def _meeting_of_three(
    unfolded: Unfolded, triangles: Index
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
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
    outside = weights < -BESIDE
    usable &= (weights > -BEYOND).all(axis=1) & (outside.sum(axis=1) <= 1)
    points = np.einsum("tn,twna->ta", weights, centers) / 3
    radius = np.einsum("tn,twn->t", weights, radii) / 3
    own = unfolded.centers[corners]
    gap = np.linalg.norm(own - own[:, [1, 2, 0]], axis=2).max(axis=1)
    with np.errstate(invalid="ignore"):
        usable &= np.linalg.norm(points - own.mean(axis=1), axis=1) <= 2 * gap
    points[~usable], radius[~usable] = np.nan, np.nan
    return points, radius, (outside & usable[:, None])[:, [2, 0, 1]]
