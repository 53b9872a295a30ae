# SPDX-License-Identifier: GPL-3.0-or-later
"""Layers that lie on the input: attributes, vertex groups, colours and materials on its mesh."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from medialis import InvalidShapeError, Layer, Shape
from medialis.hosts import Shown, distinct_names, label_name, on_input, shown

from . import attributes, materials
from .changes import Changes
from .reading import Source, corner_totals, corner_vertices, has_topology
from .transfer import Rows, own_rows

GROUP_LIMIT = 1000
"""Segments beyond which no vertex groups are made: a list of thousands helps nobody."""
ACTIVE = "medialis_active_color"
"""Custom property of meshes with results: the colour attribute that was seen before."""
SLOTS, SLOTS_BEFORE = "material_index", "medialis slots before"
ONE_OF = {"parts": "part", "patches": "patch"}
"""What one segment is called, where that is not the name of the labels."""
FACE_SETS = ".sculpt_face_set"
"""Blender's attribute of the face sets of sculpt mode."""


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
    main_label: str | None
    """The labels that make face sets and materials: a polygon has one of each."""
    color_by_face: bool
    """The colours belong to polygons, and their corners take them."""
    colors: attributes.Column | None
    shown: Shown | None
    """What the colours show."""


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
    groups = {name: on_points[name] for name in layer.labels if with_groups and name in on_points}
    of_faces = {name: on_faces[name] for name in layer.labels if with_groups and name in on_faces}
    labels = [*of_faces, *groups]
    return FieldPlan(
        layer,
        title,
        attributes.columns(on_points),
        attributes.columns(on_faces),
        groups,
        of_faces,
        layer.color_by if layer.color_by in labels else next(iter(labels), None),
        first is not None and first.on_faces,
        colors,
        first,
    )


@dataclass(frozen=True, eq=False)
class Place:
    """The object to write on, and its rows of what was read; None: they are the same."""

    object: bpy.types.Object
    rows: Rows | None = None


def place_for_fields(
    context: bpy.types.Context, chosen: bpy.types.Object, source: Source, changes: Changes
) -> Place:
    """Return the object to write on: the source, or a copy of it as it is seen.

    Where modifiers add vertices, those of the source get their values. The copy is made where they
    leave none of them as it was, and for curves, texts and linked meshes.

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
        return Place(chosen)
    rows = own_rows(context, chosen, source.topology)
    if rows is not None:
        return Place(chosen, rows)
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
    return Place(copy)


def keep_a_copy(chosen: bpy.types.Object, changes: Changes) -> None:
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


@dataclass
class Written:
    """What was written on a mesh or point cloud: names that were taken have got a number."""

    attributes: list[str] = field(default_factory=list)
    groups: list[str] = field(default_factory=list)
    colors: str = ""
    """The colour attribute."""
    slots: list[str] = field(default_factory=list)
    """Materials of segments that were added to the slots."""
    told: list[str] = field(default_factory=list)


def write_field(
    plan: FieldPlan, place: Place, changes: Changes, segments_as: Collection[str] = ()
) -> Written:
    """Write attributes and the colour attribute, and segments in the ways that were asked for.

    Nothing that is there already is changed, whatever its name.
    """
    chosen, rows = place.object, place.rows
    data = chosen.data
    by_domain = (("POINT", plan.on_points), ("FACE", plan.on_faces))
    done = Written()
    for domain, columns in by_domain:
        for column in columns:
            own_column = column if rows is None else rows.column(column, domain)
            done.attributes.append(attributes.add(data, own_column, domain))
    if plan.colors is not None:
        done.colors = _write_colors(plan, data, rows)
        done.attributes.append(done.colors)
    if chosen.type == "MESH":
        labels = [("POINT", *one) for one in plan.groups.items()]
        labels += [("FACE", *one) for one in plan.face_groups.items()]
        for domain, name, values in labels:
            own = values if rows is None else rows.of(values, domain)
            on_faces, is_main = domain == "FACE", name == plan.main_label
            if "GROUPS" in segments_as:
                done.groups += _write_label_groups(chosen, name, own, on_faces=on_faces)
            if "FACE_SETS" in segments_as and is_main:
                if FACE_SETS in data.attributes:
                    done.told.append(f"{chosen.name} has face sets of its own: they stay.")
                else:
                    done.attributes.append(_write_face_sets(data, own, on_faces=on_faces))
            if "MATERIALS" in segments_as and is_main:
                kept, slots = _write_materials(name, own, data, changes, on_faces=on_faces)
                done.attributes += kept
                done.slots += slots
    return done


def _write_label_groups(
    chosen: bpy.types.Object, name: str, labels: NDArray[Any], *, on_faces: bool
) -> list[str]:
    vertices = np.arange(len(labels))
    if on_faces:
        vertices, totals = _corners(chosen.data)
        labels = np.repeat(labels, totals)
    return write_groups(chosen, name, vertices, labels)


def _write_face_sets(mesh: bpy.types.Mesh, labels: NDArray[Any], *, on_faces: bool) -> str:
    """Write the face sets of sculpt mode; 1, as of new faces, is no segment."""
    sets = (labels if on_faces else _of_first_corner(mesh, labels)) + 2
    column = attributes.Column(FACE_SETS, "INT", "value", sets.astype(np.int32))
    return attributes.add(mesh, column, "FACE")


def _of_first_corner(mesh: bpy.types.Mesh, labels: NDArray[Any]) -> NDArray[Any]:
    corners, totals = _corners(mesh)
    return labels[corners[np.cumsum(totals) - totals]]


def _corners(mesh: bpy.types.Mesh) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    return corner_vertices(mesh), corner_totals(mesh)


def _write_colors(plan: FieldPlan, data: Any, rows: Rows | None) -> str:
    column, by_face = plan.colors, plan.color_by_face
    if rows is not None:
        column = rows.column(column, "FACE" if by_face else "POINT")
    rgba = column.values.reshape(-1, 4)
    if rows is not None and not by_face and plan.shown is not None and plan.shown.is_label:
        # Modifiers mix the colours of points: segments would be blurred.
        rgba, by_face = _of_first_corner(data, rgba), True
    if by_face:
        rgba = np.repeat(rgba, corner_totals(data), axis=0)
        column = attributes.Column(column.name, column.type, column.key, rgba.ravel())
    if isinstance(data, bpy.types.Mesh) and ACTIVE not in data:
        colors = data.color_attributes
        active = colors.active_color
        data[ACTIVE] = f"{colors.render_color_index} {active.name if active else ''}"
    name = attributes.add(data, column, "CORNER" if by_face else "POINT")
    show_color(data, name)
    return name


def show_color(data: Any, name: str) -> None:
    """Let a colour attribute be the one that is seen."""
    if isinstance(data, bpy.types.Mesh) and name in data.color_attributes:
        data.color_attributes.active_color = data.color_attributes[name]


def own_color(data: Any) -> None:
    """Let the colour attribute be seen that was seen before all results."""
    if ACTIVE in data:
        number, _, name = data[ACTIVE].partition(" ")
        show_color(data, name)
        if 0 <= int(number) < len(data.color_attributes):
            data.color_attributes.render_color_index = int(number)
        del data[ACTIVE]


def write_groups(
    place: bpy.types.Object, name: str, vertices: NDArray[Any], labels: NDArray[Any]
) -> list[str]:
    """Write one vertex group a label, such as "part 003".

    Parameters
    ----------
    vertices, labels : (k,) int
        Pairs of a vertex and a label that it has; label -1 belongs to no group.

    Returns
    -------
    list of str
        Their names.
    """
    present = np.unique(labels[labels >= 0])
    if len(present) > GROUP_LIMIT:
        return []
    order = np.argsort(labels, kind="stable")
    sorted_labels = labels[order]
    begins = np.searchsorted(sorted_labels, present)
    ends = np.searchsorted(sorted_labels, present, side="right")
    made = []
    for label, begin, end in zip(present.tolist(), begins, ends, strict=True):
        group = place.vertex_groups.new(name=label_name(ONE_OF.get(name, name), label))
        group.add(vertices[order[begin:end]].tolist(), 1.0, "REPLACE")
        made.append(group.name)
    return made


def _write_materials(
    name: str, labels: NDArray[Any], mesh: bpy.types.Mesh, changes: Changes, *, on_faces: bool
) -> tuple[list[str], list[str]]:
    """Give each segment a material slot of its own; earlier slots stay.

    Returns the attribute that keeps which slots the faces had, and the materials that were added.
    """
    if not on_faces:
        labels = _of_first_corner(mesh, labels)
    present, rows = np.unique(labels, return_inverse=True)
    if len(present) > GROUP_LIMIT:
        return [], []
    kept = attributes.add(mesh, _slots(mesh, SLOTS_BEFORE), "FACE")
    first, added = len(mesh.materials), []
    for label in present.tolist():
        mesh.materials.append(materials.label_material(name, label, changes))
        added.append(mesh.materials[-1].name)
    _set_slots(mesh, (first + rows).astype(np.int32))
    return [kept, SLOTS], added


def own_slots(mesh: bpy.types.Mesh, kept: str, added: Collection[str]) -> None:
    """Give the faces the slots that they had, and take the added ones away."""
    before = _slots(mesh, SLOTS, kept).values
    if before.any():
        _set_slots(mesh, before)
    else:  # as Blender has it where all faces have the first slot
        mesh.attributes.remove(mesh.attributes[SLOTS])
    for number in reversed(range(len(mesh.materials))):
        if mesh.materials[number] is not None and mesh.materials[number].name in added:
            mesh.materials.pop(index=number)


def _slots(mesh: bpy.types.Mesh, name: str, of: str = SLOTS) -> attributes.Column:
    values = np.zeros(len(mesh.polygons), np.int32)
    if of in mesh.attributes:
        mesh.attributes[of].data.foreach_get("value", values)
    return attributes.Column(name, "INT", "value", values)


def _set_slots(mesh: bpy.types.Mesh, slots: NDArray[np.int32]) -> None:
    """Set the material slot of each face."""
    attributes.write(mesh, attributes.Column(SLOTS, "INT", "value", slots), "FACE")
    mesh.update()
