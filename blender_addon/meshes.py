# SPDX-License-Identifier: GPL-3.0-or-later
"""Mesh and curve data from arrays."""

from __future__ import annotations

import bpy
import numpy as np
from numpy.typing import NDArray

from medialis.hosts import polylines

from .changes import Changes


def new_mesh(
    name: str,
    points: NDArray[np.float32],
    faces: NDArray[np.int32] | None,
    edges: NDArray[np.int32] | None,
    changes: Changes,
) -> bpy.types.Mesh:
    """Add a mesh of triangles, or of edges without faces; smooth shaded."""
    mesh = bpy.data.meshes.new(name)
    changes.undo_by(bpy.data.meshes.remove, mesh)
    fill(mesh, points, faces, edges)
    return mesh


def fill(
    mesh: bpy.types.Mesh,
    points: NDArray[np.float32],
    faces: NDArray[np.int32] | None,
    edges: NDArray[np.int32] | None,
) -> None:
    """Give an empty mesh its vertices, triangles and edges."""
    mesh.vertices.add(len(points))
    mesh.vertices.foreach_set("co", points.ravel())
    if edges is not None:  # also those of no face, beside faces
        mesh.edges.add(len(edges))
        mesh.edges.foreach_set("vertices", np.ascontiguousarray(edges, np.int32).ravel())
    if faces is not None and len(faces):
        mesh.loops.add(faces.size)
        mesh.loops.foreach_set("vertex_index", np.ascontiguousarray(faces, np.int32).ravel())
        mesh.polygons.add(len(faces))
        mesh.polygons.foreach_set("loop_start", np.arange(0, faces.size, 3, dtype=np.int32))
        mesh.update(calc_edges=True)
        mesh.shade_smooth()
    else:
        mesh.update()


def new_curve(
    name: str,
    points: NDArray[np.float32],
    edges: NDArray[np.int32],
    radius: NDArray[np.float32] | None,
    changes: Changes,
) -> bpy.types.Curve:
    """Add a curve of poly splines, cut at ends and branch points, with the radius of each point."""
    curve = bpy.data.curves.new(name, "CURVE")
    changes.undo_by(bpy.data.curves.remove, curve)
    curve.dimensions = "3D"
    for line in polylines(edges, len(points)):
        closed = len(line) > 3 and line[0] == line[-1]
        rows = line[:-1] if closed else line
        spline = curve.splines.new("POLY")
        spline.points.add(len(rows) - 1)
        spline.points.foreach_set("co", np.insert(points[rows], 3, 1.0, axis=1).ravel())
        if radius is not None:
            spline.points.foreach_set("radius", radius[rows])
        spline.use_cyclic_u = bool(closed)
    return curve
