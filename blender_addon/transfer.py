# SPDX-License-Identifier: GPL-3.0-or-later
"""Which vertices and polygons of what is seen are those of the object's own mesh.

Modifiers carry attributes along: every vertex and polygon gets a random vector, and what is seen
has the vector of a vertex exactly where it is this vertex, or a copy of it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import bpy
import numpy as np
from numpy.typing import NDArray

from medialis.hosts import MISSING, to_linear

from .attributes import Column, add
from .reading import corner_vertices

TAGS = {"POINT": "medialis tag", "FACE": "medialis tag of face"}
MOST_COPIES = 2
"""Mirrored vertices and the two sides of a wall may share a value; rows of copies may not."""
ENOUGH = 0.9
"""Share of the vertices of visible polygons that must be found again."""


@dataclass(frozen=True, eq=False)
class Rows:
    """Row of what is seen for each vertex and polygon of the object's own mesh; -1 for none."""

    points: NDArray[np.int64]
    faces: NDArray[np.int64]

    def of(self, values: NDArray[np.generic], domain: str) -> NDArray[np.generic]:
        """Return the values of rows for the own mesh, NaN or -1 where there is none."""
        rows = self.points if domain == "POINT" else self.faces
        found = values[np.maximum(rows, 0)]
        found[rows < 0] = np.nan if values.dtype.kind == "f" else -1
        return found

    def column(self, column: Column, domain: str) -> Column:
        """Return the column of an attribute of what is seen, for the own mesh."""
        own = self.of(column.values.reshape(-1, column.width), domain)
        if column.type == "FLOAT_COLOR":
            own = np.where(np.isnan(own), np.float32([*to_linear(MISSING), 1.0]), own)
        return replace(column, values=np.ascontiguousarray(own).ravel())


def own_rows(
    context: bpy.types.Context, chosen: bpy.types.Object, topology: NDArray[np.int32]
) -> Rows | None:
    """Return where the object's own vertices and polygons are seen.

    None where modifiers leave none of them as it was, add polygons of other objects, or repeat the
    mesh, and where the mesh is another object's as well or that of a library.
    """
    mesh = chosen.data
    if chosen.type != "MESH" or mesh.library is not None or mesh.users > 1 or not mesh.polygons:
        return None
    random = np.random.default_rng(0)
    counts = {"POINT": len(mesh.vertices), "FACE": len(mesh.polygons)}
    tags = {d: random.random((n, 3), np.float32) for d, n in counts.items()}
    names: dict[str, str] = {}
    try:
        for domain, values in tags.items():
            column = Column(TAGS[domain], "FLOAT_VECTOR", "vector", values.ravel())
            names[domain] = add(mesh, column, domain)
        mesh.update_tag()
        seen = _tags_seen(context, chosen, topology, names)
    finally:
        for name in names.values():
            mesh.attributes.remove(mesh.attributes[name])
        mesh.update_tag()
    if seen is None:
        return None
    of_points, of_faces = (_number_of(seen[d], tags[d]) for d in ("POINT", "FACE"))
    if (of_faces < 0).any() or np.bincount(of_points[of_points >= 0]).max(initial=0) > MOST_COPIES:
        return None
    points = _first_rows(of_points, counts["POINT"])
    faces = _first_rows(of_faces, counts["FACE"])
    totals = np.empty(counts["FACE"], np.int32)
    mesh.polygons.foreach_get("loop_total", totals)
    used = np.unique(corner_vertices(mesh)[np.repeat(faces >= 0, totals)])
    if len(used) == 0 or (points[used] >= 0).mean() < ENOUGH:
        return None
    return Rows(points, faces)


def _tags_seen(
    context: bpy.types.Context,
    chosen: bpy.types.Object,
    topology: NDArray[np.int32],
    names: dict[str, str],
) -> dict[str, NDArray[np.float32]] | None:
    """Return the vectors that arrive; None if they do not, or if something else is seen."""
    context.view_layer.update()
    evaluated = chosen.evaluated_get(context.evaluated_depsgraph_get())
    mesh = evaluated.to_mesh()
    try:
        if not np.array_equal(corner_vertices(mesh), topology):
            return None
        found = {}
        for domain, name in names.items():
            attribute = mesh.attributes.get(name)
            if attribute is None or attribute.domain != domain:
                return None
            values = np.empty(3 * len(attribute.data), np.float32)
            attribute.data.foreach_get("vector", values)
            found[domain] = values.reshape(-1, 3)
        return found
    finally:
        evaluated.to_mesh_clear()


def _number_of(seen: NDArray[np.float32], own: NDArray[np.float32]) -> NDArray[np.int64]:
    """Return the row of each vector among the own ones, -1 where it is none of them."""
    keys, wanted = _keys(own), _keys(seen)
    order = np.argsort(keys)
    place = np.minimum(np.searchsorted(keys, wanted, sorter=order), len(keys) - 1)
    number = order[place]
    return np.where((own[number] == seen).all(axis=1), number, -1)


def _keys(vectors: NDArray[np.float32]) -> NDArray[np.uint64]:
    """Return a number for each vector."""
    bits = np.ascontiguousarray(vectors).view(np.uint32).astype(np.uint64)
    return bits[:, 0] ^ (bits[:, 1] << np.uint64(21)) ^ (bits[:, 2] << np.uint64(42))


def _first_rows(numbers: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """Return the first row that has each number, -1 where none has."""
    rows = np.full(count, -1, np.int64)
    known = np.flatnonzero(numbers >= 0)[::-1]
    rows[numbers[known]] = known
    return rows
