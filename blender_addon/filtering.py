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

from .changes import Changes

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
    """Give an object its modifier.

    Parameters
    ----------
    shows : "points", "tubes" or "faces"
    slider : Slider or None
        The input "Threshold".
    size : float
        Radius of points and tubes on the screen.
    """
    name = shows if slider is None else slider.attribute
    group = bpy.data.node_groups.new(f"Medialis: {name}", "GeometryNodeTree")
    changes.undo_by(bpy.data.node_groups.remove, group)
    group.is_modifier = True
    builder = _Builder(group)
    geometry = builder.input("Geometry", "NodeSocketGeometry")
    group.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    if slider is not None:
        geometry = builder.hide_below(geometry, slider)
    if shows == "points":
        geometry = builder.points(geometry, size, MEDIAL_RADIUS in made.data.attributes)
    elif shows == "tubes":
        geometry = builder.tubes(geometry, size, MEDIAL_RADIUS in made.data.attributes)
    if shows != "faces":  # Blender 4.5 loses the material of a cloud when it deletes points
        geometry = builder.colored(geometry, material)
    builder.link(geometry, builder.node("NodeGroupOutput").inputs[0])
    modifier = made.modifiers.new(MODIFIER, "NODES")
    modifier.node_group = group
    return modifier


def modifier_inputs(made: bpy.types.Object) -> dict[str, tuple[Any, str]]:
    """Return (owner, property path) of each input of the object's Medialis modifier, by name."""
    modifier = made.modifiers.get(MODIFIER)
    if modifier is None or modifier.type != "NODES" or modifier.node_group is None:
        return {}
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
    owner, path = modifier_inputs(made)[name]
    if path == "value":
        owner.value = value
    else:
        owner[path[2:-2]] = value
    made.update_tag()


class _Builder:
    """Nodes in a row, each linked to the socket before it."""

    def __init__(self, group: bpy.types.NodeTree) -> None:
        self.group = group
        self.inputs = self.node("NodeGroupInput")

    def node(self, kind: str, **settings: Any) -> bpy.types.Node:
        made = self.group.nodes.new(kind)
        made.location = (200 * len(self.group.nodes), 0)
        for name, value in settings.items():
            setattr(made, name, value)
        return made

    def link(self, output: bpy.types.NodeSocket, into: bpy.types.NodeSocket) -> None:
        self.group.links.new(output, into)

    def input(self, name: str, kind: str, **settings: Any) -> bpy.types.NodeSocket:
        socket = self.group.interface.new_socket(name, in_out="INPUT", socket_type=kind)
        for key, value in settings.items():
            setattr(socket, key, value)
        return next(s for s in self.inputs.outputs if s.identifier == socket.identifier)

    def named(self, attribute: str) -> bpy.types.NodeSocket:
        node = self.node("GeometryNodeInputNamedAttribute", data_type="FLOAT")
        node.inputs["Name"].default_value = attribute
        return next(s for s in node.outputs if s.name == "Attribute" and s.enabled)

    def math(
        self, operation: str, value: bpy.types.NodeSocket, number: float
    ) -> bpy.types.NodeSocket:
        node = self.node("ShaderNodeMath", operation=operation)
        self.link(value, node.inputs[0])
        node.inputs[1].default_value = number
        return node.outputs[0]

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

    def shown_radius(self, size: float, radius: str | None) -> bpy.types.NodeSocket:
        """Radius on the screen: the input "Size", or the medial radius where "Balls" is on."""
        shown = self.input(
            "Size",
            "NodeSocketFloat",
            default_value=size,
            min_value=0.0,
            subtype="DISTANCE",
            description="Radius of points and curves as they are drawn",
        )
        if radius is None:
            return shown
        balls = self.input(
            "Balls",
            "NodeSocketBool",
            description="Draw with the medial radius: all balls together fill the shape",
        )
        switch = self.node("GeometryNodeSwitch", input_type="FLOAT")
        self.link(balls, switch.inputs["Switch"])
        self.link(shown, switch.inputs["False"])
        self.link(self.named(radius), switch.inputs["True"])
        return switch.outputs["Output"]

    def points(
        self, geometry: bpy.types.NodeSocket, size: float, has_radius: bool
    ) -> bpy.types.NodeSocket:
        shown = self.shown_radius(size, MEDIAL_RADIUS if has_radius else None)
        node = self.node("GeometryNodeSetPointRadius")
        self.link(geometry, node.inputs["Points"])
        self.link(shown, node.inputs["Radius"])
        return node.outputs["Points"]

    def tubes(
        self, geometry: bpy.types.NodeSocket, size: float, has_radius: bool
    ) -> bpy.types.NodeSocket:
        shown = self.shown_radius(size, MEDIAL_RADIUS if has_radius else None)
        curve = self.node("GeometryNodeMeshToCurve")
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

    def colored(
        self, geometry: bpy.types.NodeSocket, material: bpy.types.Material | None
    ) -> bpy.types.NodeSocket:
        node = self.node("GeometryNodeSetMaterial")
        node.inputs["Material"].default_value = material
        self.link(geometry, node.inputs["Geometry"])
        return node.outputs["Geometry"]
