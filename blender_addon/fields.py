# SPDX-License-Identifier: GPL-3.0-or-later
"""Layers that lie on the input: attributes, vertex groups, colours and materials on its mesh."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from medialis import InvalidShapeError, Layer, Shape
from medialis.hosts import distinct_names, label_name, on_input, shown

from . import attributes, materials
from .changes import Changes
from .reading import Source, corner_totals, corner_vertices, has_topology

GROUP_LIMIT = 1000
"""Segments beyond which no vertex groups are made: a list of thousands helps nobody."""


@dataclass(frozen=True, eq=False)
class FieldPlan:
    """A layer on the input in Blender's types, one row a vertex or polygon of the input."""

    layer: Layer
    title: str
    on_points: list[attributes.Column]
    on_faces: list[attributes.Column]
    groups: Mapping[str, NDArray[np.int32]]
    """Labels of the vertices, by name."""
    face_groups: Mapping[str, NDArray[np.int32]]
    """Labels of the polygons, by name."""
    color_by_face: bool
    """The colours belong to polygons, and their corners take them."""
    colors: attributes.Column | None


def plan_field(
    layer: Layer, title: str, shape: Shape, source: Source, *, with_groups: bool = True
) -> FieldPlan:
    """Bring the values of a layer to the vertices and polygons of what was read.

    Merged vertices have the same value; dropped ones NaN, or -1 for whole numbers. A polygon has
    the value of its first triangle.

    Raises
    ------
    InvalidShapeError
        When Blender cannot hold a value.
    """
    found = on_input(layer, shape, polygons=source.polygons, polygon_count=source.polygon_count)
    on_points = dict(found.attributes)
    on_faces = distinct_names(on_points, found.face_attributes)
    first = shown(layer, on_points, on_faces)
    colors = None
    if first is not None:
        colors = attributes.color_column(f"{first.name}_color", first.rgb)
    return FieldPlan(
        layer,
        title,
        attributes.columns(on_points),
        attributes.columns(on_faces),
        {name: on_points[name] for name in layer.labels if with_groups and name in on_points},
        {name: on_faces[name] for name in layer.labels if with_groups and name in on_faces},
        first is not None and first.on_faces,
        colors,
    )


def place_for_fields(
    context: bpy.types.Context, chosen: bpy.types.Object, source: Source, changes: Changes
) -> bpy.types.Object:
    """Return the object to write on: the source, or a copy of it as it is seen.

    The copy is made where the source's own data have other vertices: modifiers that change them,
    curves and texts, linked meshes.

    Raises
    ------
    InvalidShapeError
        When vertices or faces were changed since they were read.
    """
    changed = InvalidShapeError(
        f"The vertices or faces of {chosen.name} were changed while the result was computed: "
        "nothing was added. Run again."
    )
    if source.on_data:
        if not has_topology(chosen, len(source.points), source.topology):
            raise changed
        _keep_a_copy(chosen, changes)
        return chosen
    graph = context.evaluated_depsgraph_get()
    evaluated = chosen.evaluated_get(graph)
    if chosen.type == "POINTCLOUD":
        data = evaluated.data.copy()
        changes.undo_by(bpy.data.pointclouds.remove, data)
    else:
        data = bpy.data.meshes.new_from_object(evaluated, depsgraph=graph)
        changes.undo_by(bpy.data.meshes.remove, data)
    copy = bpy.data.objects.new(chosen.name, data)
    context.scene.collection.objects.link(copy)
    copy.parent = chosen
    if not has_topology(copy, len(source.points), source.topology):
        raise changed
    return copy


def _keep_a_copy(chosen: bpy.types.Object, changes: Changes) -> None:
    """Copy the data first; the copy takes their place when something fails."""
    data = chosen.data
    collection = bpy.data.meshes if chosen.type == "MESH" else bpy.data.pointclouds
    copy, name = data.copy(), data.name

    def restore() -> None:
        data.user_remap(copy)
        collection.remove(data)
        copy.name = name

    changes.undo_by(restore)
    changes.keep_by(collection.remove, copy)


def write_field(
    plan: FieldPlan, place: bpy.types.Object, changes: Changes, *, with_materials: bool
) -> None:
    """Write attributes, vertex groups, the colour attribute and, if asked for, materials."""
    data = place.data
    for column in plan.on_points:
        attributes.write(data, column, "POINT")
    for column in plan.on_faces:
        attributes.write(data, column, "FACE")
    if plan.colors is not None:
        _write_colors(plan, data)
    if place.type == "MESH":
        for name, labels in plan.groups.items():
            write_groups(place, name, np.arange(len(labels)), labels)
        for name, labels in plan.face_groups.items():
            corners, totals = _corners(data)
            write_groups(place, name, corners, np.repeat(labels, totals))
        if with_materials:
            _write_materials(plan, data, changes)


def _corners(mesh: bpy.types.Mesh) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    return corner_vertices(mesh), corner_totals(mesh)


def _write_colors(plan: FieldPlan, data: Any) -> None:
    column = plan.colors
    if plan.color_by_face:
        rgba = np.repeat(column.values.reshape(-1, 4), corner_totals(data), axis=0)
        column = attributes.Column(column.name, column.type, column.key, rgba.ravel())
    attribute = attributes.write(data, column, "CORNER" if plan.color_by_face else "POINT")
    if isinstance(data, bpy.types.Mesh):
        data.color_attributes.active_color = data.color_attributes[attribute.name]


def write_groups(
    place: bpy.types.Object, name: str, vertices: NDArray[Any], labels: NDArray[Any]
) -> None:
    """Write one vertex group a label, "<name> 003"; those of an earlier run are replaced.

    Parameters
    ----------
    vertices, labels : (k,) int
        Pairs of a vertex and a label that it has; label -1 belongs to no group.
    """
    number = re.compile(rf"{re.escape(name)} \d{{3,}}")
    for group in [group for group in place.vertex_groups if number.fullmatch(group.name)]:
        place.vertex_groups.remove(group)
    present = np.unique(labels[labels >= 0])
    if len(present) > GROUP_LIMIT:
        return
    order = np.argsort(labels, kind="stable")
    sorted_labels = labels[order]
    begins = np.searchsorted(sorted_labels, present)
    ends = np.searchsorted(sorted_labels, present, side="right")
    for label, begin, end in zip(present.tolist(), begins, ends, strict=True):
        group = place.vertex_groups.new(name=label_name(name, label))
        group.add(vertices[order[begin:end]].tolist(), 1.0, "REPLACE")


def _write_materials(plan: FieldPlan, mesh: bpy.types.Mesh, changes: Changes) -> None:
    """Give each segment its material, or the whole mesh a ramp; earlier slots stay."""
    by_name = {**plan.groups, **plan.face_groups}
    first = plan.layer.color_by
    name = first if first in by_name else next(iter(by_name), None)
    if name is None or (first is not None and first not in by_name):
        if plan.colors is not None:
            slot = _slot(mesh, materials.color_material(plan.colors.name, changes))
            _set_slots(mesh, np.full(len(mesh.polygons), slot, np.int32))
        return
    labels = by_name[name]
    if name in plan.groups:  # a polygon takes the label of its first corner
        corners, totals = _corners(mesh)
        labels = labels[corners[np.cumsum(totals) - totals]]
    present, rows = np.unique(labels, return_inverse=True)
    if len(present) > GROUP_LIMIT:
        return
    slots = [_slot(mesh, materials.label_material(name, int(i), changes)) for i in present]
    _set_slots(mesh, np.array(slots, np.int32)[rows])


def _slot(mesh: bpy.types.Mesh, material: bpy.types.Material) -> int:
    found = mesh.materials.find(material.name)
    if found < 0:
        mesh.materials.append(material)
        found = len(mesh.materials) - 1
    return found


def _set_slots(mesh: bpy.types.Mesh, slots: NDArray[np.int32]) -> None:
    attributes.write(mesh, attributes.Column("material_index", "INT", "value", slots), "FACE")
    mesh.update()
