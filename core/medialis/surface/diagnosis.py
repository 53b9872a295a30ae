"""What is right and wrong with a mesh or cloud, before anything is computed on it (before 3.2)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from medialis.model.diagnosis import Diagnosis
from medialis.model.edge_table import Index
from medialis.model.surface import Surface
from medialis.model.topology import piece_labels
from medialis.surface._orientation import agreeing_flips
from medialis.surface._volumes import piece_volumes, power_of_two_scale
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

    See Also
    --------
    repair : mends what it finds.
    read_shape : does both.

    Examples
    --------
    >>> tetrahedron = diagnose(
    ...     [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
    ...     [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]],
    ... )
    >>> tetrahedron.closed, tetrahedron.genus, tetrahedron.orientation
    (True, 0, 'out')
    """
    return examine(points, faces)[0]


def examine(points: ArrayLike, faces: ArrayLike | None) -> tuple[Diagnosis, Surface]:
    """Return the diagnosis, and the finite part at a scale near 1 with all that was found of it."""
    xyz, triangles, lost = _finite_part(points, faces)
    # Measured at a scale of about 1, which costs no accuracy (a power of two) and keeps squares and
    # cubes of very large or very small lengths in range.
    scale = power_of_two_scale(xyz)
    surface = Surface(xyz * scale, triangles)
    values: dict[str, Any] = {"vertices": len(xyz), "faces": len(triangles)}
    values |= {"duplicate_vertices": _repeated(surface.first_equal_point)}
    values |= {"nonfinite_vertices": lost, "diagonal": surface.diagonal}
    values |= _diagnose_cloud(surface) if surface.faces is None else _diagnose_faces(surface)
    for names, power in ((("diagonal", "spacing", "min_edge", "max_edge"), 1), (("area",), 2)):
        for name in names:
            values[name] = _unscaled(values[name], scale, power)
    if values["volume"] is not None:
        values["volume"] = _unscaled(values["volume"], scale, 3)
    values["vertices"] += lost
    if len(triangles):
        values["unused_vertices"] += lost
    return Diagnosis(**values), surface


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


def _repeated(first: Index) -> int:
    """Count rows that are equal to an earlier one."""
    return int((first != np.arange(len(first))).sum())


def _diagnose_cloud(surface: Surface) -> dict[str, Any]:
    names = [
        *("edges", "boundary_edges", "boundary_loops", "nonmanifold_edges", "components"),
        *("nonmanifold_vertices", "inconsistent_edges", "duplicate_faces", "degenerate_faces"),
        "unused_vertices",
    ]
    values: dict[str, Any] = dict.fromkeys(names, 0)
    values |= {"closed": False, "genus": None, "orientation": "none", "area": 0.0, "volume": None}
    nearest = np.empty(0)
    if surface.point_count > 1:
        nearest = surface.nearest_distances
    return values | _lengths(nearest)


def _lengths(lengths: FloatArray) -> dict[str, float]:
    if len(lengths) == 0:
        return {"spacing": 0.0, "min_edge": 0.0, "max_edge": 0.0}
    low, mean, high = lengths.min(), lengths.mean(), lengths.max()
    return {"spacing": float(mean), "min_edge": float(low), "max_edge": float(high)}


def _diagnose_faces(surface: Surface) -> dict[str, Any]:
    faces = surface.faces
    assert faces is not None
    values: dict[str, Any] = {
        "duplicate_faces": _repeated(surface.topology.first_equal_face),
        "degenerate_faces": int(surface.flat_faces.sum()),
        "unused_vertices": int((~surface.used_points).sum()),
        "area": surface.area,
    }
    a, b, c = faces.T
    proper = (a != b) & (b != c) & (c != a)
    if not proper.any():
        return _diagnose_cloud(Surface(surface.points)) | values
    if not proper.all():
        surface = Surface(surface.points, faces[proper])
    return values | _lengths(surface.edge_lengths) | _topology(surface) | _facing(surface)


def _topology(surface: Surface) -> dict[str, Any]:
    table = surface.edge_table
    single, many = table.single, table.counts > 2
    fan = surface.topology.corner_fans()
    several = _split_vertices(surface, fan)
    inconsistent = int((~table.pairs[2]).sum())
    loops = _loops(single, fan)
    genus = None
    orientable = not inconsistent or not agreeing_flips(surface)[1].any()
    if not many.any() and not several and orientable:
        # Euler characteristic with b boundary loops: V - E + F = 2 C - 2 g - b. Each vertex in use
        # has one fan here.
        euler = int(fan.max()) + 1 - len(table.counts) + surface.face_count
        genus = (2 * surface.part_count - loops - euler) // 2
    return {
        "edges": len(table.counts),
        "closed": len(single) == 0,
        "boundary_edges": len(single),
        "boundary_loops": loops,
        "nonmanifold_edges": int(many.sum()),
        "nonmanifold_vertices": several,
        "components": surface.part_count,
        "genus": genus,
        "inconsistent_edges": inconsistent,
    }


def _following(h: IntArray) -> IntArray:
    """Return the next half-edge (corner) of the same face."""
    return h + 1 - 3 * (h % 3 == 2)


def _split_vertices(surface: Surface, fan: IntArray) -> int:
    """Count vertices whose fans stay apart when also joined across non-manifold edges."""
    assert surface.faces is not None
    table, fans = surface.edge_table, int(fan.max()) + 1
    fan_vertex = np.empty(fans, np.int64)
    fan_vertex[fan] = surface.faces.ravel()
    if (table.counts > 2).any():
        edge = np.repeat(np.arange(len(table.counts)), table.counts)
        half = table.order[table.counts[edge] > 2]
        edge = edge[table.counts[edge] > 2]
        anchor = np.empty((2, len(table.counts)), np.int64)
        links = []
        for end, at_start in ((0, table.forward[half]), (1, ~table.forward[half])):
            touching = fan[np.where(at_start, half, _following(half))]
            anchor[end, edge] = touching
            links.append(np.stack([touching, anchor[end, edge]], axis=1))
        group = piece_labels(fans, np.concatenate(links))
        fan_vertex = fan_vertex[np.unique(group, return_index=True)[1]]
    return int((np.bincount(fan_vertex) > 1).sum())


def _loops(single: IntArray, fan: IntArray) -> int:
    """Count boundary loops: boundary edges chained through the fans at their ends."""
    if len(single) == 0:
        return 0
    ends = np.stack([fan[single], fan[_following(single)]], axis=1)
    known, links = np.unique(ends, return_inverse=True)
    return int(piece_labels(len(known), links.reshape(-1, 2)).max()) + 1


def _facing(surface: Surface) -> dict[str, Any]:
    """Return orientation and volume."""
    assert surface.faces is not None
    counts = surface.edge_table.counts
    if not surface.edge_table.pairs[2].all():
        return {"orientation": "mixed", "volume": None}
    if (counts == 1).any():
        measured = piece_volumes(surface, surface.face_pieces)
        volume = float((measured.volume * np.abs(measured.sign)).sum())
        result: dict[str, Any] = {"orientation": _word(volume), "volume": None}
    else:
        # Pieces that meet at non-manifold edges are closed together, so one apex serves them all.
        corner = surface.points[surface.faces[:, 0]]
        tetra = np.einsum("ij,ij->i", corner - corner.mean(axis=0), surface.face_vectors) / 6
        volume = float(tetra.sum())
        clear = abs(volume) > 1e-9 * np.abs(tetra).sum()
        result = {"orientation": _word(volume * clear), "volume": volume}
    if (counts > 2).any():
        # Of three faces at an edge, two run along it in the same direction.
        result["orientation"] = "mixed"
    return result


def _word(volume: float) -> str:
    return "out" if volume > 0 else "in" if volume < 0 else "none"
