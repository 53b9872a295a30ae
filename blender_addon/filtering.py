# SPDX-License-Identifier: GPL-3.0-or-later
"""The Geometry Nodes modifier of results: a live threshold, and how thick points and curves look.

The data below the modifier keep exactly the core's values; removing the modifier removes only what
is described here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import bpy

from medialis import Layer
from medialis.hosts import FilterUnit, Kind, title

from . import own
from .changes import Changes
from .materials import MEANING, find_shared
from .nodes import Nodes
from .thick import thick

MODIFIER = "Medialis"
MEDIAL_RADIUS = "medial_radius"
"""Copy of `radius`: the modifier sets Blender's own radius attribute to the size on the screen."""

WIDGETS = {Kind.LENGTH: ("PERCENTAGE", 100.0), Kind.ANGLE: ("ANGLE", math.radians(1.0))}
"""Blender's type of a slider, and what it holds where the option is 1: per cent, radians."""


@dataclass(frozen=True)
class Slider:
    """The threshold of a layer, in the unit of the option that can be typed into the operator.

    Attributes
    ----------
    attribute : str
        Of the points; those below the threshold are hidden.
    unit : FilterUnit
    limits : (float, float)
        Smallest and largest value of the attribute.
    default : float
        Of the option.
    """

    attribute: str
    unit: FilterUnit
    limits: tuple[float, float]
    default: float = 0.0

    @classmethod
    def of(cls, layer: Layer, limits: tuple[float, float]) -> Slider:
        """Return the slider of a layer whose attribute has these limits."""
        return cls(str(layer.filter_by), layer.filter_unit, limits, layer.filter_default)

    @property
    def subtype(self) -> str:
        """Blender's type of the number."""
        return WIDGETS.get(self.unit.kind, ("NONE", 1.0))[0]

    @property
    def step(self) -> float:
        """What Blender holds for an option of 1."""
        return WIDGETS.get(self.unit.kind, ("NONE", 1.0))[1]

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest number, as Blender holds it."""
        plain = self.unit == FilterUnit(option=self.unit.option)
        low = min(0.0, self.limits[0]) if plain else 0.0
        high = self.step * max(self.unit.of_attribute(self.limits[1]), self.default)
        return low, high if high > low else low + 1.0

    @property
    def factor(self) -> float:
        """The attribute is this times Blender's number to the power of the unit."""
        return self.unit.scale / self.step**self.unit.power


def add_modifier(
    made: bpy.types.Object,
    *,
    shows: str,
    slider: Slider | None,
    size: float,
    material: bpy.types.Material | None,
    changes: Changes,
) -> bpy.types.Modifier:
    """Give an object its modifier; objects with the same inputs share its nodes.

    Parameters
    ----------
    shows : "points", "tubes", "faces", "sheets" or "balls"
        Sheets are faces with tubes along edges of no face, balls what `thick` draws.
    slider : Slider or None
        The input "Threshold".
    size : float
        Radius of points and tubes on the screen.
    """
    has_radius = MEDIAL_RADIUS in made.data.attributes
    group = _node_group(shows, slider, has_radius, changes)
    modifier = made.modifiers.new(MODIFIER, "NODES")
    modifier.node_group = group
    if shows != "faces":
        set_input(made, "Size", size)
        _set(*_inputs(modifier)["Material"], material)
    if slider is not None:
        set_input(made, "Threshold", slider.step * slider.default)
    return modifier


def _node_group(
    shows: str, slider: Slider | None, has_radius: bool, changes: Changes
) -> bpy.types.NodeTree:
    """Return the node group of these inputs; it is made when missing."""
    meaning = f"{shows} {slider} {has_radius}"
    found = find_shared(bpy.data.node_groups, meaning)
    if found is not None:
        return found
    name = shows if slider is None else slider.attribute
    group = bpy.data.node_groups.new(f"Medialis: {name}", "GeometryNodeTree")
    changes.undo_by(bpy.data.node_groups.remove, group)
    own.mark(group, MEANING, meaning)
    group.is_modifier = True
    builder = _Builder(group)
    geometry = builder.input("Geometry", "NodeSocketGeometry")
    group.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    if slider is not None:
        geometry = builder.hide_below(geometry, slider)
    if shows == "points":
        geometry = builder.points(geometry, has_radius)
    elif shows == "tubes":
        geometry = builder.tubes(geometry, has_radius)
    elif shows == "sheets":
        geometry = builder.sheets(geometry, has_radius)
    elif shows == "balls":
        geometry = builder.balls(geometry)
    if shows != "faces":  # Blender 4.5 loses the material of a cloud when it deletes points
        geometry = builder.colored(geometry)
    builder.link(geometry, builder.node("NodeGroupOutput").inputs[0])
    own.remember_nodes(group)
    return group


def modifier_inputs(made: bpy.types.Object) -> dict[str, tuple[Any, str]]:
    """Return (owner, property path) of each number of the object's Medialis modifier, by name."""
    modifier = made.modifiers.get(MODIFIER)
    if modifier is None or modifier.type != "NODES" or modifier.node_group is None:
        return {}
    found = _inputs(modifier)
    found.pop("Material", None)
    return found


def _inputs(modifier: bpy.types.Modifier) -> dict[str, tuple[Any, str]]:
    found = {}
    for item in modifier.node_group.interface.items_tree:
        if item.item_type == "SOCKET" and item.in_out == "INPUT" and item.name != "Geometry":
            if hasattr(modifier, "properties"):  # Blender 5.2 and later
                owner = getattr(modifier.properties.inputs, item.identifier)
                found[item.name] = owner, "value"
            else:
                found[item.name] = modifier, f'["{item.identifier}"]'
    return found


def set_input(made: bpy.types.Object, name: str, value: float | bool) -> None:
    """Set an input of the object's modifier, as the panel's sliders do."""
    _set(*modifier_inputs(made)[name], value)
    made.update_tag()


def _set(owner: Any, path: str, value: Any) -> None:
    if path == "value":
        owner.value = value
    else:
        owner[path[2:-2]] = value


class _Builder(Nodes):
    """What results are shown with, one geometry after the other."""

    def hide_below(self, geometry: bpy.types.NodeSocket, slider: Slider) -> bpy.types.NodeSocket:
        low, high = slider.range
        about = f"Hide what has a smaller {title(slider.attribute)}; nothing is computed anew"
        if slider.unit.option is not None:
            about += f". The same number as {title(slider.unit.option)} of the operator"
        threshold = self.input(
            "Threshold",
            "NodeSocketFloat",
            subtype=slider.subtype,
            default_value=slider.step * slider.default,
            min_value=low,
            max_value=high,
            description=about,
        )
        if slider.unit.power != 1.0:
            threshold = self.math("POWER", threshold, slider.unit.power)
        if slider.factor != 1.0:
            threshold = self.math("MULTIPLY", threshold, slider.factor)
        less = self.node("FunctionNodeCompare", data_type="FLOAT", operation="LESS_THAN")
        self.link(self.named(slider.attribute), less.inputs["A"])
        self.link(threshold, less.inputs["B"])
        hide = self.node("GeometryNodeDeleteGeometry", domain="POINT")
        self.link(geometry, hide.inputs["Geometry"])
        self.link(less.outputs["Result"], hide.inputs["Selection"])
        return hide.outputs["Geometry"]

    def shown_radius(self, has_radius: bool) -> bpy.types.NodeSocket:
        """Radius on the screen: the input "Size", or the medial radius where "Balls" is on."""
        shown = self.input(
            "Size",
            "NodeSocketFloat",
            min_value=0.0,
            subtype="DISTANCE",
            description="Radius of points and curves as they are drawn",
        )
        if not has_radius:
            return shown
        balls = self.input(
            "Balls",
            "NodeSocketBool",
            description="Draw with the medial radius: all balls together fill the shape",
        )
        switch = self.node("GeometryNodeSwitch", input_type="FLOAT")
        self.link(balls, switch.inputs["Switch"])
        self.link(shown, switch.inputs["False"])
        self.link(self.named(MEDIAL_RADIUS), switch.inputs["True"])
        return switch.outputs["Output"]

    def points(self, geometry: bpy.types.NodeSocket, has_radius: bool) -> bpy.types.NodeSocket:
        shown = self.shown_radius(has_radius)
        node = self.node("GeometryNodeSetPointRadius")
        self.link(geometry, node.inputs["Points"])
        self.link(shown, node.inputs["Radius"])
        return node.outputs["Points"]

    def sheets(self, geometry: bpy.types.NodeSocket, has_radius: bool) -> bpy.types.NodeSocket:
        faces = self.node("GeometryNodeInputMeshEdgeNeighbors")
        bare = self.node("FunctionNodeCompare", data_type="INT", operation="EQUAL")
        self.link(faces.outputs["Face Count"], bare.inputs["A"])
        tubes = self.tubes(geometry, has_radius, bare.outputs["Result"])
        both = self.node("GeometryNodeJoinGeometry")
        self.link(geometry, both.inputs["Geometry"])
        self.link(tubes, both.inputs["Geometry"])
        return both.outputs["Geometry"]

    def balls(self, geometry: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
        shown = self.input(
            "Balls",
            "NodeSocketBool",
            default_value=True,
            description="Draw balls, and the cones and slabs between them; off: edges and faces",
        )
        # Cycles has no attribute of meshes that is called radius.
        geometry = self.stored(geometry, MEDIAL_RADIUS, self.named("radius"), "POINT")
        switch = self.node("GeometryNodeSwitch", input_type="GEOMETRY")
        self.link(shown, switch.inputs["Switch"])
        self.link(self.sheets(geometry, False), switch.inputs["False"])
        self.link(thick(self, geometry, MEDIAL_RADIUS), switch.inputs["True"])
        return switch.outputs["Output"]

    def tubes(
        self,
        geometry: bpy.types.NodeSocket,
        has_radius: bool,
        which: bpy.types.NodeSocket | None = None,
    ) -> bpy.types.NodeSocket:
        shown = self.shown_radius(has_radius)
        curve = self.node("GeometryNodeMeshToCurve")
        if which is not None:
            self.link(which, curve.inputs["Selection"])
        self.link(geometry, curve.inputs["Mesh"])
        profile = self.node("GeometryNodeCurvePrimitiveCircle")
        profile.inputs["Resolution"].default_value = 8
        profile.inputs["Radius"].default_value = 1.0
        tube = self.node("GeometryNodeCurveToMesh")
        if "Scale" in tube.inputs:  # Blender 5 and later
            self.link(curve.outputs["Curve"], tube.inputs["Curve"])
            self.link(shown, tube.inputs["Scale"])
        else:
            thick = self.node("GeometryNodeSetCurveRadius")
            self.link(curve.outputs["Curve"], thick.inputs["Curve"])
            self.link(shown, thick.inputs["Radius"])
            self.link(thick.outputs["Curve"], tube.inputs["Curve"])
        self.link(profile.outputs["Curve"], tube.inputs["Profile Curve"])
        return tube.outputs["Mesh"]

    def colored(self, geometry: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
        node = self.node("GeometryNodeSetMaterial")
        self.link(self.input("Material", "NodeSocketMaterial"), node.inputs["Material"])
        self.link(geometry, node.inputs["Geometry"])
        return node.outputs["Geometry"]
