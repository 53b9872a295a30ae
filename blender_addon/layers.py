# SPDX-License-Identifier: GPL-3.0-or-later
"""A layer of a result as a new object: points, triangles or curves with their attributes."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import bpy
import numpy as np
from numpy.typing import NDArray

from medialis import Layer, Result
from medialis.hosts import Shown, distinct_names, drawn_radius, palette, shown, value_range

from . import attributes, filtering, materials, meshes, point_clouds
from .changes import Changes

LEVELS = "medialis_levels"
"""Custom property of objects: the levels of their layer, as bytes."""


@dataclass(frozen=True, eq=False)
class Plan:
    """A layer in Blender's types; making it cannot fail because of its values any more."""

    layer: Layer
    title: str
    points: NDArray[np.float32]
    faces: NDArray[np.int32] | None
    on_points: list[attributes.Column]
    on_faces: list[attributes.Column] = field(default_factory=list)
    limits: tuple[float, float] = (0.0, 1.0)
    """Smallest and largest value of `filter_by`."""
    size: float = 0.0
    """Radius of points and curves as they are drawn."""
    shown: Shown | None = None

    @property
    def shows(self) -> str:
        """What is seen: "faces", "tubes", both as "sheets", "points", or "balls" of a mesh."""
        joined = self.faces is not None or self.layer.edges is not None
        if joined and self.layer.role == "balls":
            return "balls"
        if self.faces is not None:
            return "faces" if self.layer.edges is None else "sheets"
        return "points" if self.layer.edges is None else "tubes"


def plan_layer(layer: Layer, title: str, result: Result) -> Plan:
    """Convert a layer of a result.

    Raises
    ------
    InvalidShapeError
        When Blender cannot hold a value.
    """
    plan = plan_data(layer, title)
    limits = (0.0, 1.0)
    if layer.filter_by in layer.attributes:
        limits = value_range(layer.attributes[layer.filter_by])
    lines = plan.shows != "faces"
    return replace(plan, limits=limits, size=drawn_radius(layer, result) if lines else 0.0)


def plan_data(layer: Layer, title: str) -> Plan:
    """Convert points, faces and attributes of a layer.

    Raises
    ------
    InvalidShapeError
        When Blender cannot hold a value.
    """
    faces, on_faces = layer.faces, dict(layer.face_attributes)
    if faces is not None:
        # Blender has no face that names a vertex twice.
        proper = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
        faces = faces[proper]
        on_faces = {name: np.asarray(values)[proper] for name, values in on_faces.items()}
    on_faces = distinct_names(layer.attributes, on_faces)  # a mesh has each name once
    first = shown(layer)
    points = attributes.coordinates(layer.points, layer.name)
    plan = Plan(layer, title, points, faces, [], attributes.columns(on_faces), shown=first)
    on_points = attributes.columns(layer.attributes)
    if first is not None and first.is_label and not first.on_faces:
        on_points.append(attributes.color_column(f"{first.name}_color", first.rgb))
    # Points and curves are drawn with another radius, which replaces the attribute of that name.
    if plan.shows not in ("faces", "balls") and "radius" in layer.attributes:
        on_points += attributes.columns({filtering.MEDIAL_RADIUS: layer.attributes["radius"]})
    return replace(plan, on_points=on_points)


def make_object(
    plan: Plan, scene: bpy.types.Scene, changes: Changes, *, curves: bool = False
) -> bpy.types.Object:
    """Add the object of a layer to the scene's own collection, with material and modifier."""
    if curves and plan.shows == "tubes":
        return _curve_object(plan, scene, changes)
    if plan.shows == "points":
        made = point_clouds.new_point_cloud(plan.title, plan.points, scene, changes)
    else:
        mesh = meshes.new_mesh(plan.title, plan.points, plan.faces, plan.layer.edges, changes)
        made = bpy.data.objects.new(plan.title, mesh)
        scene.collection.objects.link(made)
    write_attributes(made.data, plan)
    material = _material(plan, changes)
    if material is not None:
        made.data.materials.append(material)
        made.color = material.diffuse_color
    slider = None
    if plan.layer.filter_by in plan.layer.attributes:
        slider = filtering.Slider.of(plan.layer, plan.limits)
    if slider or plan.shows != "faces":
        filtering.add_modifier(
            made,
            shows=plan.shows,
            slider=slider,
            size=plan.size,
            material=material,
            changes=changes,
        )
    if plan.layer.role == "balls" and plan.shows == "points":
        filtering.set_input(made, "Balls", True)
    if plan.layer.levels is not None:
        made[LEVELS] = plan.layer.levels.packed()
    return made


def write_attributes(data: bpy.types.Mesh | bpy.types.PointCloud, plan: Plan) -> None:
    """Write the attributes of points and faces; the radius of balls is the one to edit."""
    if plan.shows in ("sheets", "balls"):  # triangles turned to either side: smooth ones are black
        data.shade_flat()
    for column in plan.on_points:
        attributes.write(data, column, "POINT")
    for column in plan.on_faces:
        attributes.write(data, column, "FACE")
    if plan.shows == "balls":
        data.attributes.active = data.attributes["radius"]


def _curve_object(plan: Plan, scene: bpy.types.Scene, changes: Changes) -> bpy.types.Object:
    """Add a curve object: round, as thick as the tubes where its radius is the median one.

    Curves have no colours of points: each spline has a material of its own.
    """
    radius = plan.layer.attributes.get("radius")
    curve = meshes.new_curve(
        plan.title,
        plan.points,
        plan.layer.edges,
        None if radius is None else attributes.single(np.asarray(radius)),
        changes,
    )
    usual = 1.0 if radius is None else float(np.median(radius)) or 1.0
    curve.bevel_depth, curve.bevel_resolution = plan.size / usual, 2
    kinds = min(len(curve.splines), len(palette()))
    for number in range(kinds):
        curve.materials.append(materials.label_material("curve", number, changes))
    for number, spline in enumerate(curve.splines):
        spline.material_index = number % kinds
    made = bpy.data.objects.new(plan.title, curve)
    scene.collection.objects.link(made)
    return made


def _material(plan: Plan, changes: Changes) -> bpy.types.Material | None:
    """Material of the attribute that the layer shows first; one colour without any."""
    first = plan.shown
    if first is None:  # a vector has no place in a colour map
        return materials.label_material(plan.layer.name, 0, changes)
    if first.is_label and not first.on_faces:
        return materials.color_material(f"{first.name}_color", changes)
    drawn_otherwise = first.name == "radius" and plan.shows != "faces"
    name = filtering.MEDIAL_RADIUS if drawn_otherwise else first.name
    return materials.ramp_material(name, first.color_map, first.limits, changes)
