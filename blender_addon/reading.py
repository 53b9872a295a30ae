# SPDX-License-Identifier: GPL-3.0-or-later
"""From a Blender object to arrays: the evaluated mesh in world axes, relative to its origin.

Points are in world units and world axes, but relative to the origin of the object: so an object far
from the world's origin loses no digits in Blender's single precision. `placing.py` puts results
back.
"""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

from medialis import InvalidShapeError
from medialis.hosts import Operation, nearest_unit

from . import own

TYPES = ("MESH", "CURVE", "SURFACE", "FONT", "META", "POINTCLOUD")
RESULT = "medialis_result"
"""Custom property that marks the objects that operations have added: the layer that they show."""
OPERATION = "medialis_operation"
"""Custom property of these objects: the operation that added them."""
FORMATS = "medialis_formats"
"""Custom property of these objects: the endings of files that they can be written to."""


@dataclass(frozen=True, eq=False)
class Source:
    """What was read from an object; holds no reference to Blender data, which undo would break.

    Attributes
    ----------
    name, uid : str, int or None
        To find the object again (`find`); Blender 4.2 has no uid.
    scene : str
    linear : (3, 3) float64
        Rotation and scale of the object in the world.
    points : (n, 3) float64
        World units and axes, relative to the object's origin.
    faces : (m, 3) int32 or None
        Triangles, counter-clockwise seen from outside also for mirrored objects.
    polygons : (m,) int32 or None
        Polygon of each triangle; None where all polygons are triangles.
    polygon_count : int
    topology : (c,) int32
        Vertex of each corner of the evaluated mesh.
    on_data : bool
        The evaluated mesh has the vertices and corners of the object's own data: values can be
        written there.
    unit : str or None
        What one unit of the points is, where the scene says so.
    """

    name: str
    uid: int | None
    scene: str
    linear: NDArray[np.float64]
    points: NDArray[np.float64]
    faces: NDArray[np.int32] | None
    polygons: NDArray[np.int32] | None
    polygon_count: int
    topology: NDArray[np.int32]
    on_data: bool
    unit: str | None

    def find(self) -> bpy.types.Object:
        """Return the object.

        Raises
        ------
        InvalidShapeError
            When it was deleted or renamed meanwhile.
        """
        for candidate in bpy.data.objects:
            if self.uid is not None and candidate.session_uid == self.uid:
                return candidate
        candidate = bpy.data.objects.get((self.name, None))
        if candidate is None:
            raise InvalidShapeError(
                f"{self.name} was deleted or renamed while its result was computed: nothing was "
                "added. Run again."
            )
        return candidate


def target(context: bpy.types.Context) -> bpy.types.Object | None:
    """Return the object to work on: the active one, or the source of an active result."""
    return source_of(context.active_object)


def bound_meshes(context: bpy.types.Context) -> list[bpy.types.Object]:
    """Return the meshes that are selected with an active armature of the user, as for parenting."""
    active = context.active_object
    if active is None or active.type != "ARMATURE" or not active.select_get():
        return []
    return [one for one in context.selected_objects if one.type in TYPES and not is_result(one)]


def targets(
    context: bpy.types.Context, operation: Operation | None = None
) -> list[bpy.types.Object]:
    """Return the objects to work on, the active one last: it is active afterwards, too.

    Where the active object is selected, the others that are selected with it come as well. For an
    operation that takes bones, an active armature is none of them.
    """
    if operation is not None and takes_bones(operation) and (meshes := bound_meshes(context)):
        return meshes
    active = target(context)
    chosen = context.active_object
    others = context.selected_objects if chosen is not None and chosen.select_get() else []
    sources = [source_of(other) for other in others]
    usable = [one for one in sources if one is not None and one.type in TYPES and one != active]
    return [*dict.fromkeys(usable), *([] if active is None else [active])]


def selected_vertices(chosen: bpy.types.Object, source: Source) -> NDArray[np.int64]:
    """Return the vertices that are selected in edit mode, as rows of what was read.

    They come in the order in which they were picked. None are where all are selected, as Blender
    does when edit mode begins.
    """
    none = np.empty(0, np.int64)
    if chosen.type != "MESH" or chosen.mode != "EDIT":
        return none
    import bmesh

    edited = bmesh.from_edit_mesh(chosen.data)
    picked = [one for one in edited.select_history if isinstance(one, bmesh.types.BMVert)]
    selected = [vertex for vertex in edited.verts if vertex.select]
    if len(selected) == len(edited.verts):
        return none
    rows = list(dict.fromkeys(vertex.index for vertex in [*picked, *selected]))
    if source.on_data or not rows:
        return np.array(rows, np.int64)
    # Modifiers have numbered them anew: the nearest ones are meant.
    edited.verts.ensure_lookup_table()
    places = np.array([edited.verts[row].co for row in rows]) @ source.linear.T
    squares = (((source.points - place) ** 2).sum(axis=1) for place in places)
    return np.array([int(apart.argmin()) for apart in squares], np.int64)


def is_result(chosen: bpy.types.Object | None) -> bool:
    """Tell whether an operation has added this object; a user's copy of a result is none."""
    return chosen is not None and RESULT in chosen and own.is_own(chosen, bpy.data.objects)


def source_of(chosen: bpy.types.Object | None) -> bpy.types.Object | None:
    """Return the object that a result belongs to; any other object itself."""
    while chosen is not None and is_result(chosen):
        bound = []
        if chosen.type == "ARMATURE":  # one that its source is bound to is its parent
            bound = [c for c in chosen.children if c.type in TYPES and not is_result(c)]
        chosen = bound[0] if bound else chosen.parent
    return chosen


def takes_bones(operation: Operation) -> bool:
    """Tell whether an operation has an option for the bones of an armature."""
    return any(parameter.bones for parameter in operation.parameters)


def why_not(context: bpy.types.Context, operation: Operation) -> str | None:
    """Tell in one sentence why the operation cannot start now; None when it can."""
    chosen = target(context)
    if takes_bones(operation) and (meshes := bound_meshes(context)):
        chosen = meshes[-1]
    if chosen is None:
        return "Select a mesh or point cloud first: there is no active object"
    if chosen.type not in TYPES:
        return f"{chosen.name} is of type {chosen.type.lower()}: select a mesh or point cloud"
    if operation.needs_faces and chosen.type == "POINTCLOUD":
        return f"{operation.label} needs a surface with faces, and {chosen.name} is a point cloud"
    return None


LAST_DIGITS = 2e-6
"""Share of a matrix that single precision changes when it is put together from others."""

_read: dict[str, NDArray[np.float64]] = {}
"""Rotation and scale with which objects were read, by name."""


def _settled(chosen: bpy.types.Object, linear: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return rotation and scale, those of the last time where only last digits are others.

    A new parent changes them; the same shape has the same result, which is known already.
    """
    before = _read.get(chosen.name)
    largest = np.abs(linear).max()
    if before is not None and np.abs(linear - before).max() <= LAST_DIGITS * largest:
        return before
    _read[chosen.name] = linear
    return linear


def read_object(context: bpy.types.Context, chosen: bpy.types.Object) -> Source:
    """Read the object as it is seen: edits flushed, modifiers applied, scaled and mirrored.

    Raises
    ------
    InvalidShapeError
        When it is linked from a library, has no extent along an axis, or has no vertices.
    """
    if chosen.library is not None:
        raise InvalidShapeError(
            f"{chosen.name} is linked from {chosen.library.name}, and nothing can be added to it: "
            "make it local first (Object > Relations > Make Local)."
        )
    chosen.update_from_editmode()
    graph = context.evaluated_depsgraph_get()
    evaluated = chosen.evaluated_get(graph)
    linear = _settled(chosen, np.array(evaluated.matrix_world, np.float64)[:3, :3])
    if not np.isfinite(linear).all() or np.linalg.matrix_rank(linear) < 3:
        raise InvalidShapeError(
            f"{chosen.name} needs a size in every direction, its scale is "
            f"{tuple(round(s, 6) for s in evaluated.matrix_world.to_scale())}: give it another "
            "scale (N panel, Item)."
        )
    if chosen.type == "POINTCLOUD":
        points, topology = positions(evaluated.data), np.empty(0, np.int32)
        faces, polygons, count = None, None, 0
    else:
        mesh = evaluated.to_mesh()
        try:
            points, topology = positions(mesh), corner_vertices(mesh)
            faces, polygons = triangles(mesh, topology)
            count = len(mesh.polygons)
        finally:
            evaluated.to_mesh_clear()
    if len(points) == 0:
        _refuse_empty(chosen)
    if faces is not None and np.linalg.det(linear) < 0:
        faces = np.ascontiguousarray(faces[:, [0, 2, 1]])  # mirrored: outside stays outside
    return Source(
        name=chosen.name,
        uid=getattr(chosen, "session_uid", None),
        scene=context.scene.name,
        linear=linear,
        # Not a matrix product: on a busy machine its threads take thirty times longer.
        points=np.einsum("ij,kj->ik", points.astype(np.float64), linear),
        faces=faces,
        polygons=polygons,
        polygon_count=count,
        topology=topology,
        on_data=has_topology(chosen, len(points), topology),
        unit=scene_unit(context.scene),
    )


def scene_unit(scene: bpy.types.Scene) -> str | None:
    """Return what one unit of a scene is, such as "mm"; None where it has no name."""
    settings = scene.unit_settings
    if settings.system == "NONE":
        return None
    return nearest_unit(f"{settings.scale_length} * meters")


def _refuse_empty(chosen: bpy.types.Object) -> None:
    if any(modifier.type == "NODES" for modifier in chosen.modifiers):
        raise InvalidShapeError(
            f"{chosen.name} shows no mesh: its nodes give instances or curves, or nothing. Add "
            "Realize Instances or Curve to Mesh at their end."
        )
    raise InvalidShapeError(f"{chosen.name} has no vertices: there is nothing to compute on.")


def has_topology(chosen: bpy.types.Object, count: int, corners: NDArray[np.int32]) -> bool:
    """Tell whether the object's own, local data has these vertices and corners."""
    data = chosen.data
    if chosen.type == "POINTCLOUD":
        return data.library is None and len(data.points) == count
    return (
        chosen.type == "MESH"
        and data.library is None
        and len(data.vertices) == count
        and len(data.loops) == len(corners)
        and np.array_equal(corner_vertices(data), corners)
    )


def positions(data: bpy.types.Mesh | bpy.types.PointCloud) -> NDArray[np.float32]:
    """Return the points of a mesh or point cloud, (n, 3)."""
    attribute = data.attributes.get("position")
    count = 0 if attribute is None else len(attribute.data)
    points = np.empty(3 * count, np.float32)
    if count:
        attribute.data.foreach_get("vector", points)
    return points.reshape(-1, 3)


def corner_vertices(mesh: bpy.types.Mesh) -> NDArray[np.int32]:
    """Return the vertex of each corner, (c,).

    The attribute is a hundred times faster than the loops; in edit mode it is hidden.
    """
    corners = np.empty(len(mesh.loops), np.int32)
    attribute = mesh.attributes.get(".corner_vert")
    if attribute is None:
        mesh.loops.foreach_get("vertex_index", corners)
    elif len(corners):
        attribute.data.foreach_get("value", corners)
    return corners


def triangles(
    mesh: bpy.types.Mesh, corners: NDArray[np.int32]
) -> tuple[NDArray[np.int32] | None, NDArray[np.int32] | None]:
    """Return the triangles (m, 3), None without faces, and the polygon of each where it matters."""
    polygons = len(mesh.polygons)
    if polygons == 0:
        return None, None
    if len(corners) == 3 * polygons:  # none has fewer corners, so all have three
        return corners.reshape(-1, 3), None
    mesh.calc_loop_triangles()
    loops = np.empty(3 * len(mesh.loop_triangles), np.int32)
    mesh.loop_triangles.foreach_get("loops", loops)
    # Blender keeps them in the order of the polygons, n - 2 for one of n corners.
    of = np.repeat(np.arange(polygons, dtype=np.int32), corner_totals(mesh) - 2)
    return corners[loops].reshape(-1, 3), of


def corner_totals(mesh: bpy.types.Mesh) -> NDArray[np.int32]:
    """Return the number of corners of each polygon."""
    totals = np.empty(len(mesh.polygons), np.int32)
    mesh.polygons.foreach_get("loop_total", totals)
    return totals
