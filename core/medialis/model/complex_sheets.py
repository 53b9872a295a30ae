"""Sheets of a complex of triangles: patches that meet where an edge has three triangles or more."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.model.topology import piece_labels
from medialis.validation import FloatArray

Index = NDArray[np.int64]


class Sheets(NamedTuple):
    """What triangles and edges belong to.

    Attributes
    ----------
    of_faces : (f,) int64
        Sheet of each triangle; sheet 0 has the largest area, and so on.
    of_points : (n,) int64
        Sheet of each vertex; -1 where there are several, and where there are no triangles.
    seams : (s, 2) int64
        Edges of three triangles or more.
    """

    of_faces: Index
    of_points: Index
    seams: Index


def sheets_of(points: FloatArray, faces: Index) -> Sheets:
    """Cut a complex into sheets: triangles belong together where an edge has just two of them.

    Each sheet is a surface with borders, its triangles cut apart along seams; it may touch itself
    in single vertices.

    Parameters
    ----------
    points : (n, 3) float64
    faces : (f, 3) int
        Each once.
    """
    faces = np.asarray(faces, np.int64).reshape(-1, 3)
    count = len(points)
    if not len(faces):
        nothing = np.zeros((0, 2), np.int64)
        return Sheets(np.zeros(0, np.int64), np.full(count, -1), nothing)
    sides = np.sort(faces[:, [[0, 1], [0, 2], [1, 2]]].reshape(-1, 2), axis=1)
    keys, row, uses = np.unique(
        sides @ np.array([count, 1]), return_inverse=True, return_counts=True
    )
    owner = np.argsort(row, kind="stable") // 3
    first = np.cumsum(uses) - uses
    inner = np.flatnonzero(uses == 2)
    links = np.stack([owner[first[inner]], owner[first[inner] + 1]], axis=1)
    pieces = np.asarray(piece_labels(len(faces), links), np.int64)
    corners = points[faces]
    areas = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    order = np.argsort(-np.bincount(pieces, areas), kind="stable")
    of_faces = np.argsort(order)[pieces]
    low, high = np.full(count, len(faces)), np.full(count, -1)
    for corner in faces.T:
        np.minimum.at(low, corner, of_faces)
        np.maximum.at(high, corner, of_faces)
    seams = np.stack(np.divmod(keys[uses > 2], count), axis=1)
    return Sheets(of_faces, np.where(low == high, high, -1), seams)
