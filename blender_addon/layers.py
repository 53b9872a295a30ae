# SPDX-License-Identifier: GPL-3.0-or-later
"""A layer of a result as a new object: points, triangles or curves with their attributes."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import bpy
import numpy as np
from numpy.typing import NDArray

from medialis import Layer
from medialis.hosts import distinct_names, shown, value_range

from . import attributes, filtering, materials, meshes, point_clouds
from .changes import Changes

SIZE_SHARE = 0.002
"""Radius of drawn points where the spacing is not known, as a share of the diagonal."""
TUBE_SHARE = 0.005
"""Radius of drawn curves where the spacing is not known."""


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

    @property
    def shows(self) -> str:
        """What a viewer sees: "faces", "tubes" or "points"."""
        if self.faces is not None:
            return "faces"
        return "points" if self.layer.edges is None else "tubes"


def plan_layer(layer: Layer, title: str, spacing: float | None) -> Plan:
    """Convert a layer; `spacing` is the distance of samples, for the size of drawn points.

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
    plan_points = attributes.columns(layer.attributes)
    first = shown(layer)
    if first is not None and first.is_label and not first.on_faces:
        plan_points.append(attributes.color_column(f"{first.name}_color", first.rgb))
    # Points and curves are drawn with another radius, which replaces the attribute of that name.
    if faces is None and "radius" in layer.attributes:
        plan_points += attributes.columns({filtering.MEDIAL_RADIUS: layer.attributes["radius"]})
    limits = (0.0, 1.0)
    if layer.filter_by in layer.attributes:
        limits = value_range(layer.attributes[layer.filter_by])
    share = SIZE_SHARE if layer.edges is None else TUBE_SHARE
    diagonal = math.hypot(*(layer.points.max(axis=0) - layer.points.min(axis=0)))
    return Plan(
        layer,
        title,
        attributes.coordinates(layer.points, layer.name),
        faces,
        plan_points,
        attributes.columns(on_faces),
        limits,
        spacing / 2 if spacing else share * diagonal,
    )


def make_object(
    plan: Plan, scene: bpy.types.Scene, changes: Changes, *, curves: bool = False
) -> bpy.types.Object:
    """Add the object of a layer to the scene's own collection, with material and modifier."""
    if curves and plan.shows == "tubes":
        made = _curve_object(plan, scene, changes)
        made.data.materials.append(materials.label_material("curve", 0, changes))
        return made
    if plan.shows == "points":
        made = point_clouds.new_point_cloud(plan.title, plan.points, scene, changes)
    else:
        mesh = meshes.new_mesh(plan.title, plan.points, plan.faces, plan.layer.edges, changes)
        made = bpy.data.objects.new(plan.title, mesh)
        scene.collection.objects.link(made)
    for column in plan.on_points:
        attributes.write(made.data, column, "POINT")
    for column in plan.on_faces:
        attributes.write(made.data, column, "FACE")
    material = _material(plan.layer, changes)
    if material is not None:
        made.data.materials.append(material)
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
    return made


def _curve_object(plan: Plan, scene: bpy.types.Scene, changes: Changes) -> bpy.types.Object:
    radius = plan.layer.attributes.get("radius")
    curve = meshes.new_curve(
        plan.title,
        plan.points,
        plan.layer.edges,
        None if radius is None else attributes.single(np.asarray(radius)),
        changes,
    )
    made = bpy.data.objects.new(plan.title, curve)
    scene.collection.objects.link(made)
    return made


def _material(layer: Layer, changes: Changes) -> bpy.types.Material | None:
    """Material of the attribute that the layer shows first; None without one."""
    first = shown(layer)
    if first is None:  # a vector has no place in a colour map
        return None
    if first.is_label and not first.on_faces:
        return materials.color_material(f"{first.name}_color", changes)
    drawn_otherwise = first.name == "radius" and layer.faces is None
    name = filtering.MEDIAL_RADIUS if drawn_otherwise else first.name
    return materials.ramp_material(name, first.color_map, first.limits, changes)
