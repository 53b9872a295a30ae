"""What is right and wrong with a mesh or cloud, before anything is computed on it (before 3.2)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.model.diagnosis import Diagnosis
from medialis.surface._edges import EdgeTable, corner_fans, face_components, following
from medialis.surface._orientation import agreeing_flips
from medialis.surface._rows import first_equal_row
from medialis.surface._volumes import (
    degenerate_faces,
    face_vectors,
    piece_volumes,
    power_of_two_scale,
)
from medialis.validation import FloatArray, IntArray, as_faces, as_points


def diagnose(points: ArrayLike, faces: ArrayLike | None = None) -> Diagnosis:
    """Examine a mesh or cloud; nothing is changed.

    Parameters
    ----------
    points : (n, 3) array of numbers
        NaN and infinity are allowed in points that no face uses: they are counted and left out.
    faces : (m, 3) integers, optional

    Returns
    -------
    Diagnosis

    Raises
    ------
    InvalidShapeError
        When points or faces have a wrong shape or are out of range, or a face uses a point that
        is not finite.

    Examples
    --------
    >>> tetrahedron = diagnose(
    ...     [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
    ...     [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]],
    ... )
    >>> tetrahedron.closed, tetrahedron.genus, tetrahedron.orientation
    (True, 0, 'out')
    """
    xyz, triangles, lost = _finite_part(points, faces)
    # Measured at a scale of about 1, which costs no accuracy (a power of two) and keeps squares and
    # cubes of very large or very small lengths in range.
    scale = power_of_two_scale(xyz)
    xyz = xyz * scale
    duplicates = int((first_equal_row(xyz) != np.arange(len(xyz))).sum())
    diagonal = float(np.linalg.norm(xyz.max(axis=0) - xyz.min(axis=0)))
    values: dict[str, Any] = {"vertices": len(xyz), "faces": len(triangles)}
    values |= {"duplicate_vertices": duplicates, "diagonal": diagonal, "nonfinite_vertices": lost}
    values |= _diagnose_faces(xyz, triangles) if len(triangles) else _diagnose_cloud(xyz)
    for names, power in ((("diagonal", "spacing", "min_edge", "max_edge"), 1), (("area",), 2)):
        for name in names:
            values[name] = _unscaled(values[name], scale, power)
    if values["volume"] is not None:
        values["volume"] = _unscaled(values["volume"], scale, 3)
    values["vertices"] += lost
    if len(triangles):
        values["unused_vertices"] += lost
    return Diagnosis(**values)


def _finite_part(points: ArrayLike, faces: ArrayLike | None) -> tuple[FloatArray, IntArray, int]:
    """Return the finite points, the faces counted in them, and how many points are not finite."""
    raw = np.asarray(points)
    if raw.dtype.kind == "f" and raw.ndim == 2 and raw.shape[1] == 3:
        finite = np.asarray(np.isfinite(raw).all(axis=1))
        if finite.any() and not finite.all():
            triangles = as_faces(np.empty((0, 3)) if faces is None else faces, len(raw))
            if finite[triangles].all():
                place = np.cumsum(finite) - 1
                lost = int((~finite).sum())
                return as_points(raw[finite]), place[triangles].astype(np.int32), lost
    xyz = as_points(points)
    return xyz, as_faces(np.empty((0, 3)) if faces is None else faces, len(xyz)), 0


def _unscaled(value: float, scale: float, power: int) -> float:
    for _ in range(power):
        value /= scale
    return float(value)


def _diagnose_cloud(points: FloatArray) -> dict[str, Any]:
    names = [
        *("edges", "boundary_edges", "boundary_loops", "nonmanifold_edges", "components"),
        *("nonmanifold_vertices", "inconsistent_edges", "duplicate_faces", "degenerate_faces"),
        "unused_vertices",
    ]
    values: dict[str, Any] = dict.fromkeys(names, 0)
    values |= {"closed": False, "genus": None, "orientation": "none", "area": 0.0, "volume": None}
    return values | _lengths(_nearest(points))


def _nearest(points: FloatArray) -> FloatArray:
    if len(points) < 2:
        return np.empty(0)
    from scipy.spatial import cKDTree

    return np.asarray(cKDTree(points).query(points, k=2)[0][:, 1])


def _lengths(lengths: FloatArray) -> dict[str, float]:
    if len(lengths) == 0:
        return {"spacing": 0.0, "min_edge": 0.0, "max_edge": 0.0}
    low, mean, high = lengths.min(), lengths.mean(), lengths.max()
    return {"spacing": float(mean), "min_edge": float(low), "max_edge": float(high)}


def _diagnose_faces(points: FloatArray, faces: IntArray) -> dict[str, Any]:
    double, longest = face_vectors(points, faces)
    used = np.zeros(len(points), bool)
    used[faces] = True
    a, b, c = faces.T
    proper = (a != b) & (b != c) & (c != a)
    values: dict[str, Any] = {
        "duplicate_faces": _duplicate_faces(faces),
        "degenerate_faces": int(degenerate_faces(double, longest).sum()),
        "unused_vertices": int((~used).sum()),
        "area": float(np.sqrt(np.einsum("ij,ij->i", double, double)).sum() / 2),
    }
    if not proper.all():
        faces, double = faces[proper], double[proper]
    if len(faces) == 0:
        return _diagnose_cloud(points) | values
    table = EdgeTable.of(faces, len(points))
    pieces, piece = face_components(table)
    ends = points[table.high] - points[table.low]
    values |= _lengths(np.sqrt(np.einsum("ij,ij->i", ends, ends)))
    values |= _topology(faces, table, len(points), pieces, piece)
    return values | _facing(points, faces, double, table, pieces, piece)


def _duplicate_faces(faces: IntArray) -> int:
    low, high = faces.min(axis=1), faces.max(axis=1)
    middle = faces.sum(axis=1, dtype=np.int64) - low - high
    rows = np.stack([low.astype(np.int64), middle, high], axis=1)
    return int((first_equal_row(rows) != np.arange(len(rows))).sum())


def _topology(
    faces: IntArray, table: EdgeTable, n: int, pieces: int, piece: IntArray
) -> dict[str, Any]:
    counts = table.counts
    single, many = table.single(), counts > 2
    fans, fan = corner_fans(table)
    several = _split_vertices(faces, table, n, fans, fan)
    _, _, agree = table.pairs()
    inconsistent = int((~agree).sum())
    components = _vertex_components(faces, n, pieces, piece)
    loops = _loops(single, fan)
    genus = None
    if not many.any() and not several and (not inconsistent or _orientable(table)):
        # Euler characteristic with b boundary loops: V - E + F = 2 C - 2 g - b. Each vertex in use
        # has one fan here.
        euler = fans - len(counts) + len(faces)
        genus = (2 * components - loops - euler) // 2
    return {
        "edges": len(counts),
        "closed": len(single) == 0,
        "boundary_edges": len(single),
        "boundary_loops": loops,
        "nonmanifold_edges": int(many.sum()),
        "nonmanifold_vertices": several,
        "components": components,
        "genus": genus,
        "inconsistent_edges": inconsistent,
    }


def _orientable(table: EdgeTable) -> bool:
    return not agreeing_flips(table)[1].any()


def _vertex_components(faces: IntArray, n: int, count: int, piece: IntArray) -> int:
    """Count the sets of faces joined by vertices: pieces joined by edges, then those that touch."""
    if count == 1:
        return 1
    corners, pieces = faces.ravel(), np.repeat(piece, 3)
    anchor = np.zeros(n, np.int64)
    anchor[corners] = pieces
    return _connected(count, pieces, anchor[corners])


def _split_vertices(faces: IntArray, table: EdgeTable, n: int, fans: int, fan: IntArray) -> int:
    """Count vertices whose fans stay apart when also joined across non-manifold edges."""
    corners = faces.ravel()
    fan_vertex = np.empty(fans, np.int64)
    fan_vertex[fan] = corners
    counts = table.counts
    many = np.flatnonzero(counts > 2)
    if len(many):
        edge = np.repeat(np.arange(len(counts)), counts)
        half = table.order[counts[edge] > 2]
        edge = edge[counts[edge] > 2]
        anchor = np.empty((2, len(counts)), np.int64)
        links = []
        for end, at_start in ((0, table.forward[half]), (1, ~table.forward[half])):
            touching = fan[np.where(at_start, half, following(half))]
            anchor[end, edge] = touching
            links.append((touching, anchor[end, edge]))
        group = _grouped(fans, *np.concatenate(links, axis=1))[1]
        first = np.unique(group, return_index=True)[1]
        fan_vertex = fan_vertex[first]
    return int((np.bincount(fan_vertex, minlength=n) > 1).sum())


def _loops(single: NDArray[np.int64], fan: IntArray) -> int:
    """Count boundary loops: boundary edges chained through the fans at their ends."""
    if len(single) == 0:
        return 0
    ends = np.concatenate([fan[single], fan[following(single)]])
    known, ends = np.unique(ends, return_inverse=True)
    return _connected(len(known), *ends.reshape(2, -1))


def _connected(count: int, a: NDArray[Any], b: NDArray[Any]) -> int:
    return _grouped(count, a, b)[0]


def _grouped(count: int, a: NDArray[Any], b: NDArray[Any]) -> tuple[int, IntArray]:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(a), np.int8), (a, b)), shape=(count, count))
    number, labels = connected_components(graph, directed=False)
    return int(number), labels


def _facing(
    points: FloatArray,
    faces: IntArray,
    double: FloatArray,
    table: EdgeTable,
    pieces: int,
    piece: IntArray,
) -> dict[str, Any]:
    """Return orientation and volume."""
    if not table.pairs()[2].all():
        return {"orientation": "mixed", "volume": None}
    counts = table.counts
    if (counts == 1).any():
        measured = piece_volumes(points, faces, double, table, piece, pieces)
        volume = float((measured.volume * np.abs(measured.sign)).sum())
        result: dict[str, Any] = {"orientation": _word(volume), "volume": None}
    else:
        # Pieces that meet at non-manifold edges are closed together, so one apex serves them all.
        corner = points[faces[:, 0]]
        tetra = np.einsum("ij,ij->i", corner - corner.mean(axis=0), double) / 6
        volume = float(tetra.sum())
        clear = abs(volume) > 1e-9 * np.abs(tetra).sum()
        result = {"orientation": _word(volume * clear), "volume": volume}
    if (counts > 2).any():
        # Of three faces at an edge, two run along it in the same direction.
        result["orientation"] = "mixed"
    return result


def _word(volume: float) -> str:
    return "out" if volume > 0 else "in" if volume < 0 else "none"
