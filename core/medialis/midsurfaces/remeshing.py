"""Even triangles on a sheet whose curves are fixed already (see `_remesh_kernels`)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from medialis.midsurfaces import _remesh_kernels as kernels
from medialis.midsurfaces._remesh_kernels import FREE
from medialis.midsurfaces.editing import EditMesh
from medialis.midsurfaces.sheet_pieces import RawSheet
from medialis.progress import Progress

ROUNDS = 12
"""Of splitting, collapsing, flipping and smoothing; the angles change little after eight."""

LONG, SHORT = 4 / 3, 4 / 5
"""Edge lengths, as shares of the one wished for, from which on edges are split or collapsed:
halves of a split edge are not collapsed again (Botsch and Kobbelt 2004)."""

MOST_FLIPS = 8
"""Passes of flips in a round."""


def remesh(
    mesh: EditMesh, kind: NDArray[np.int8], raw: RawSheet, edge: float, progress: Progress
) -> None:
    """Make the triangles of a sheet even, with edges of about one length.

    Parameters
    ----------
    mesh : EditMesh
        Changed in place; its curves are the border and the marked edges.
    kind : (n,) int8
        FREE, SLIDING or FIXED for each vertex.
    raw : RawSheet
        The sheet that vertices are kept on.
    edge : float
        The length wished for, in the units of the shape.
    """
    for turn in range(ROUNDS):
        progress.update(turn / ROUNDS)
        last = turn == ROUNDS - 1
        if not last:
            kind = _split(mesh, kind, LONG * edge)
            _collapse(mesh, kind, SHORT * edge, LONG * edge)
        _flip(mesh)
        for _ in range(2):
            kernels.smooth_vertices(
                mesh.points, mesh.faces, mesh.twins, mesh.leaving, mesh.sizes, kind, mesh.ring
            )
        _project(mesh, kind, raw)
        _flip(mesh)


def _split(mesh: EditMesh, kind: NDArray[np.int8], longest: float) -> NDArray[np.int8]:
    most = 3 * mesh.face_count // 2 + 3
    a, b, places = np.empty(most, np.int32), np.empty(most, np.int32), np.empty((most, 3))
    count = kernels.find_long(
        mesh.points, mesh.faces, mesh.twins, mesh.marks, mesh.sizes, longest, a, b, places
    )
    mesh.split_between(a[:count], b[:count], places[:count])
    return np.concatenate([kind, np.full(mesh.vertex_count - len(kind), FREE, np.int8)])


def _collapse(mesh: EditMesh, kind: NDArray[np.int8], low: float, high: float) -> None:
    for _ in range(3):
        done = kernels.collapse_edges(
            mesh.points, mesh.faces, mesh.twins, mesh.marks, mesh.leaving, mesh.sizes, kind, low,
            high, mesh.ring, mesh.other,
        )  # fmt: skip
        if done == 0:
            return


def _flip(mesh: EditMesh) -> None:
    for _ in range(MOST_FLIPS):
        done = kernels.flip_edges(
            mesh.points, mesh.faces, mesh.twins, mesh.marks, mesh.leaving, mesh.sizes, mesh.ring
        )
        if done == 0:
            return


def _project(mesh: EditMesh, kind: NDArray[np.int8], raw: RawSheet) -> None:
    used = (mesh.leaving[: mesh.vertex_count] >= 0) & (kind[: mesh.vertex_count] == FREE)
    rows = np.flatnonzero(used)
    if len(rows):
        mesh.points[rows] = raw.at(mesh.points[rows])[0]
