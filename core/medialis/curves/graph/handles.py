"""Loops round the handles of a surface, and how often paths inside go round them (thesis 3.6.3).

A closed surface of genus g bounds a solid with g independent loops. The surface itself has 2 g: a
tree of vertices and a tree of faces leave 2 g sides, each of which closes a loop over the surface.
The faces are joined where loops would be longest first, so that those which are left are the
shortest through the root (Erickson and Whittlesey 2005): each lies at its handle.

A closed path inside is contractible in homology exactly when it is linked with none of these loops:
when it crosses a surface that a loop spans as often one way as the other (`spanning.py`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from medialis.kept import Described
from medialis.model.polylines import follow
from medialis.model.ragged import Ragged
from medialis.model.shape import Shape
from medialis.model.topology import piece_labels
from medialis.surface.solid_boundary import SolidBoundary, solid_boundary
from medialis.validation import FloatArray, frozen

MOST_HANDLES = 2048

JITTER = 1e-9
"""Fraction of the diagonal by which points of loops move."""


@dataclass(frozen=True, eq=False, repr=False)
class Handles(Described):
    """Loops over one component of a surface.

    Attributes
    ----------
    genus : int
        Number of independent loops inside.
    loops : list of (l,) int64
        2 genus closed polylines: indices into `points`. None for more than 2048 handles, which
        would take minutes.
    points : (n, 3) float64
        Those of the boundary of the solid, which are the vertices first; moved by 1e-9 of the size,
        since centers of symmetric shapes lie in triangles that loops span.
    seams, unclear : int
        Where the surface touches itself, and where the solid is a guess (`SolidBoundary`).
    """

    genus: int
    loops: list[NDArray[np.int64]]
    points: FloatArray
    seams: int = 0
    unclear: int = 0


def find_handles(shape: Shape) -> dict[int, Handles]:
    """Find the loops over each component of a surface.

    Parameters
    ----------
    shape : Shape
        A mesh.

    Returns
    -------
    dict
        Handles of the solid (`solid_boundary`) by the number of the component
        (`Shape.components`). What touches in a vertex or an edge is one component.
    """
    if shape.faces is None or shape.face_count == 0:
        return {}
    boundary = solid_boundary(shape)
    parent, sides = _sides_left(boundary)
    corners = np.ascontiguousarray(boundary.faces.ravel())
    of_side = boundary.component[corners[sides]]
    move = np.random.default_rng(0).uniform(-1, 1, boundary.points.shape)
    points = frozen(boundary.points + JITTER * shape.diagonal * move, np.float64)
    result = {}
    for number in np.unique(shape.components[shape.faces[:, 0]]).tolist():
        mine = sides[of_side == number]
        usable = mine if len(mine) <= 2 * MOST_HANDLES else mine[:0]
        loops = [_loop(corners, int(h), parent) for h in usable]
        seams, unclear = int(boundary.seams[number]), int(boundary.unclear[number])
        result[number] = Handles(len(mine) // 2, loops, points, seams, unclear)
    return result


def _sides_left(boundary: SolidBoundary) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Tree of vertices, by parents, and the sides that are in no tree of vertices nor of faces."""
    from medialis.curves.graph._growth_kernels import join_faces, steps_from

    twins, n = boundary.twins, len(boundary.points)
    a, b = boundary.faces.ravel(), np.roll(boundary.faces, -1, axis=1).ravel()
    near, neighbours = Ragged.group(a, n), np.ascontiguousarray(b, np.int64)
    steps, parent = np.full(n, -1, np.int64), np.full(n, -1, np.int64)
    piece = piece_labels(n, np.stack([a, b], axis=1))
    starts = np.unique(piece, return_index=True)[1]
    steps_from(starts, near.offsets, neighbours[near.indices], np.empty(n, np.int64), steps, parent)
    # Two edges may have the same ends: one of them is in the tree.
    down = np.flatnonzero(parent[b] == a)
    first = down[np.unique(b[down], return_index=True)[1]]
    free = twins > np.arange(len(twins))
    free[first] = free[twins[first]] = False
    sides = np.flatnonzero(free)
    longest_first = np.argsort(-(steps[a[sides]] + steps[b[sides]]), kind="stable")
    sides = sides[longest_first]
    left = np.zeros(len(sides), bool)
    join_faces(sides, twins, np.arange(len(boundary.faces)), left)
    return parent, sides[left]


def _loop(corners: NDArray[np.int32], h: int, parent: NDArray[np.int64]) -> NDArray[np.int64]:
    """Side h and the paths of both its ends up the tree, as far as they differ."""
    a, b = (follow(parent, int(corners[h])) for h in (h, h - 2 if h % 3 == 2 else h + 1))
    while len(a) > 1 and len(b) > 1 and a[-2] == b[-2]:
        a.pop()
        b.pop()
    loop = [*a, *b[-2::-1]]
    return np.array([*loop, loop[0]], np.int64)
