"""One mesh of all sheets: shared vertices at welds, sheets numbered through (for midsurface)."""

from __future__ import annotations

import math
from collections import defaultdict

import numpy as np
from numpy.typing import NDArray

from medialis.midsurfaces.curves import Curve
from medialis.midsurfaces.junctions import CutSheet
from medialis.model.midsurface import Midsurface
from medialis.model.topology import piece_labels
from medialis.validation import FloatArray, IntArray

STRAIGHT_ON = math.cos(math.radians(15.0))
"""Cosine of the turn up to which a sheet goes on into another one of the same thickness."""

ALIKE = 0.05
"""Share of the thickness by which these may differ."""

SAME_CURVE = math.cos(math.radians(30.0))
"""Cosine of the turn up to which a weld goes on past a place where others meet it."""


def assembled(
    sheets: list[CutSheet],
    numbers: list[dict[int, int]],
    places: FloatArray,
    curves: list[Curve],
    nodes: int,
) -> Midsurface:
    """Put the meshes of all sheets together, vertex by vertex at their curves.

    Parameters
    ----------
    sheets : list of CutSheet
        Remeshed.
    numbers : list of dict
        The number of each vertex of a sheet that lies on a curve.
    places : (k, 3) float64
        Of these numbers.
    curves : list of Curve
    nodes : int
        How many of the places are nodes, the first ones.
    """
    points, faces, owner, count = [places], [], [], len(places)
    halves = np.zeros(len(places))
    values = []
    for s, (sheet, known) in enumerate(zip(sheets, numbers, strict=True)):
        mesh = sheet.mesh
        corners = mesh.faces[: mesh.face_count][mesh.alive]
        used = np.unique(corners)
        number = np.full(mesh.vertex_count, -1, np.int64)
        for v, k in known.items():
            number[v] = k
        own = used[number[used] < 0]
        number[own] = count + np.arange(len(own))
        half = np.zeros(mesh.vertex_count)
        if len(used):
            half[used] = sheet.raw.at(mesh.points[used])[1]
        np.maximum.at(halves, number[used[number[used] < len(places)]],
                      half[used[number[used] < len(places)]])  # fmt: skip
        points.append(mesh.points[own])
        values.append(half[own])
        faces.append((number[corners], half[corners].mean(axis=1)))
        owner.append(np.full(len(corners), s, np.int32))
        count += len(own)
    every = np.concatenate(points)
    triangles = np.concatenate([f for f, _ in faces]).reshape(-1, 3)
    fine = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
    triangles = triangles[fine]
    used, compact = np.unique(triangles, return_inverse=True)
    new = np.full(len(every), -1, np.int64)
    new[used] = np.arange(len(used))
    half = np.concatenate([halves, *values])
    mean = np.concatenate([h for _, h in faces])[fine]
    raw_sheet = np.concatenate(owner)[fine]
    mesh_faces = compact.reshape(-1, 3).astype(np.int32)
    edges, of_edge = _weld_edges(curves, nodes, new)
    label = _numbered(every[used], mesh_faces, raw_sheet, 2 * mean, edges, len(sheets))
    edges, weld = _weld_curves(every[used], mesh_faces, label, edges, of_edge)
    return Midsurface(every[used], mesh_faces, 2 * half[used], 2 * mean, label, edges, weld)


def _weld_edges(
    curves: list[Curve], nodes: int, new: NDArray[np.int64]
) -> tuple[IntArray, IntArray]:
    """Return the edges of all curves of several sheets, and the curve of each."""
    result, of_edge = [], []
    first = _first_numbers(curves, nodes)
    for k, curve in enumerate(curves):
        if len(curve.chains) < 2:
            continue
        inner = first[k] + np.arange(len(curve.places) - 2)
        line = new[np.concatenate([[curve.nodes[0]], inner, [curve.nodes[1]]])]
        result.append(np.stack([line[:-1], line[1:]], axis=1))
        of_edge.append(np.full(len(line) - 1, k, np.int32))
    if not result:
        return np.empty((0, 2), np.int32), np.empty(0, np.int32)
    edges, of_all = np.concatenate(result).astype(np.int32), np.concatenate(of_edge)
    there = (edges >= 0).all(axis=1) & (edges[:, 0] != edges[:, 1])
    return edges[there], of_all[there]


def _first_numbers(curves: list[Curve], nodes: int) -> list[int]:
    result, count = [], nodes
    for curve in curves:
        result.append(count)
        count += len(curve.places) - 2
    return result


def _at_edges(faces: IntArray, edges: IntArray, count: int) -> dict[tuple[int, int], list[int]]:
    """Return the faces at each of some edges."""
    wanted = {(min(a, b), max(a, b)) for a, b in edges.tolist()}
    result: dict[tuple[int, int], list[int]] = defaultdict(list)
    if not wanted:
        return result
    on = np.zeros(count, np.bool_)
    on[edges] = True
    rows = np.flatnonzero(on[faces].sum(axis=1) >= 2)
    for row in rows.tolist():
        corners = faces[row].tolist()
        for j in range(3):
            a, b = corners[j], corners[(j + 1) % 3]
            key = (min(a, b), max(a, b))
            if key in wanted:
                result[key].append(row)
    return result


def _numbered(
    points: FloatArray,
    faces: IntArray,
    raw_sheet: IntArray,
    thickness: FloatArray,
    edges: IntArray,
    count: int,
) -> IntArray:
    """Give sheets numbers, the largest first; those that go straight on into others share one."""
    votes: dict[tuple[int, int], float] = defaultdict(float)
    for (a, b), rows in _at_edges(faces, edges, len(points)).items():
        along = points[b] - points[a]
        length = float(np.linalg.norm(along))
        outward = []
        for row in rows:
            tip = points[int(faces[row].sum()) - a - b] - points[a]
            away = tip - (tip @ along) * along / max(length * length, 1e-300)
            outward.append(away / max(float(np.linalg.norm(away)), 1e-300))
        sheets = raw_sheet[rows].tolist()
        single = [i for i, s in enumerate(sheets) if sheets.count(s) == 1]
        for p, i in enumerate(single):
            for j in single[p + 1 :]:
                pair = (min(sheets[i], sheets[j]), max(sheets[i], sheets[j]))
                one, two = float(thickness[rows[i]]), float(thickness[rows[j]])
                on = float(outward[i] @ outward[j]) < -STRAIGHT_ON
                alike = abs(one - two) <= ALIKE * min(one, two)
                votes[pair] += length if on and alike else -length
    links = np.array([pair for pair, vote in votes.items() if vote > 0], np.int64).reshape(-1, 2)
    joined = piece_labels(count, links)[raw_sheet]
    x, y, z = (points[faces[:, j]] for j in range(3))
    area = np.bincount(joined, np.linalg.norm(np.cross(y - x, z - x), axis=1), minlength=count)
    order = np.lexsort((np.arange(count), -area))
    rank = np.empty(count, np.int32)
    rank[order] = np.arange(count)
    return np.asarray(rank[joined])


def _weld_curves(
    points: FloatArray, faces: IntArray, sheet: IntArray, edges: IntArray, of_edge: IntArray
) -> tuple[IntArray, IntArray]:
    """Return the edges at which sheets meet, and the weld of each: curves of the same sheets."""
    at = _at_edges(faces, edges, len(points))
    meeting: dict[int, frozenset[int]] = {}
    keep = []
    for i, (a, b) in enumerate(edges.tolist()):
        rows = at.get((min(a, b), max(a, b)), [])
        labels = frozenset(sheet[rows].tolist())
        if len(rows) > 2 or len(labels) > 1:
            keep.append(i)
            meeting.setdefault(int(of_edge[i]), labels)
    edges, of_edge = edges[keep], of_edge[keep]
    pieces = sorted(meeting)
    index = {k: i for i, k in enumerate(pieces)}
    ends: dict[int, list[tuple[int, FloatArray]]] = defaultdict(list)
    for k in pieces:
        mine = edges[of_edge == k]
        count = np.bincount(mine.ravel(), minlength=len(points))
        for v in np.flatnonzero(count == 1).tolist():
            row = mine[(mine == v).any(axis=1)][0]
            away = points[int(row.sum()) - v] - points[v]
            ends[v].append((k, away / max(float(np.linalg.norm(away)), 1e-300)))
    links = [
        (index[k], index[q])
        for around in ends.values()
        for i, (k, one) in enumerate(around)
        for q, two in around[i + 1 :]
        if meeting[k] == meeting[q] and float(one @ two) < -SAME_CURVE
    ]
    label = piece_labels(len(pieces), np.array(links, np.int64).reshape(-1, 2))
    number = np.unique(label, return_inverse=True)[1] if len(label) else label
    weld = np.array([number[index[int(k)]] for k in of_edge.tolist()], np.int32)
    return edges.astype(np.int32), weld
