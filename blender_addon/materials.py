# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials that show an attribute, a segment, or what lies inside; each is made once and shared.

A material carries its meaning as a custom property: the next result that needs the same finds it,
also after it was renamed or changed by hand.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy
import numpy as np

from medialis.hosts import MISSING, color_table, label_name, palette, to_linear

from . import own
from .changes import Changes

STOPS = 17
"""Colours of a ramp; Blender allows 32, and the maps are smooth."""
MEANING = "medialis_meaning"
"""Custom property of materials and node groups: what they were made for."""
GLASS = (0.35, 0.45, 0.6, 1.0)
"""Colour of the outline of what is see-through."""
CLEAR = 0.18
"""Opacity of what is see-through, in views without materials."""

_Build = Callable[[bpy.types.Material, bpy.types.Node], None]


def ramp_material(
    attribute: str, color_map: str, limits: tuple[float, float], changes: Changes
) -> bpy.types.Material:
    """Return a material that colours by a number: the map's first and last colour at the limits."""
    table, (low, high) = color_table(color_map), limits

    def build(material: bpy.types.Material, shader: bpy.types.Node) -> None:
        tree = material.node_tree
        read = _attribute_node(tree, attribute, -900)
        scale = tree.nodes.new("ShaderNodeMapRange")
        scale.location = (-700, 300)
        scale.inputs["From Min"].default_value = low
        scale.inputs["From Max"].default_value = high if high > low else low + 1.0
        ramp = tree.nodes.new("ShaderNodeValToRGB")
        ramp.location = (-500, 300)
        elements = ramp.color_ramp.elements
        while len(elements) < STOPS:
            elements.new(0.5)
        for element, share in zip(elements, np.linspace(0.0, 1.0, STOPS), strict=True):
            element.position = share
            element.color = _linear(table[round(share * (len(table) - 1))])
        tree.links.new(read.outputs["Fac"], scale.inputs["Value"])
        tree.links.new(scale.outputs["Result"], ramp.inputs["Fac"])
        tree.links.new(ramp.outputs["Color"], shader.inputs["Base Color"])
        material.diffuse_color = _linear(table[len(table) // 2])

    meaning = f"{attribute} by {color_map} from {low:.9g} to {high:.9g}"
    return _shared(f"Medialis: {attribute}", meaning, build, changes)


def color_material(attribute: str, changes: Changes) -> bpy.types.Material:
    """Return a material that shows a colour attribute."""

    def build(material: bpy.types.Material, shader: bpy.types.Node) -> None:
        read = _attribute_node(material.node_tree, attribute, -300)
        material.node_tree.links.new(read.outputs["Color"], shader.inputs["Base Color"])

    return _shared(f"Medialis: {attribute}", f"colour {attribute}", build, changes)


def flat_material(attribute: str, changes: Changes) -> bpy.types.Material:
    """Return a material that shows a colour attribute as it is, in any light."""

    def build(material: bpy.types.Material, shader: bpy.types.Node) -> None:
        read = _attribute_node(material.node_tree, attribute, -300)
        shader.inputs["Base Color"].default_value = (0.0, 0.0, 0.0, 1.0)
        shader.inputs["Emission Strength"].default_value = 1.0
        material.node_tree.links.new(read.outputs["Color"], shader.inputs["Emission Color"])

    return _shared(f"Medialis: {attribute}", f"flat {attribute}", build, changes)


def label_material(labels: str, label: int, changes: Changes) -> bpy.types.Material:
    """Return the material of one segment, "<labels> 003"; labels of one colour share it."""
    name = label_name(labels, label)
    color = _linear(MISSING if label < 0 else palette()[label % len(palette())])

    def build(material: bpy.types.Material, shader: bpy.types.Node) -> None:
        shader.inputs["Base Color"].default_value = color
        material.diffuse_color = color

    return _shared(name, f"segment {name}", build, changes)


def see_through(changes: Changes) -> bpy.types.Material:
    """Return the material that shows an outline only."""

    def build(material: bpy.types.Material, shader: bpy.types.Node) -> None:
        tree = material.node_tree
        output = next(node for node in tree.nodes if node.type == "OUTPUT_MATERIAL")
        mix = tree.nodes.new("ShaderNodeMixShader")
        edge = tree.nodes.new("ShaderNodeLayerWeight")
        edge.inputs["Blend"].default_value = 0.3
        tree.links.new(edge.outputs["Facing"], mix.inputs[0])
        clear = tree.nodes.new("ShaderNodeBsdfTransparent")
        tree.links.new(clear.outputs[0], mix.inputs[1])
        tree.links.new(shader.outputs[0], mix.inputs[2])
        tree.links.new(mix.outputs[0], output.inputs["Surface"])
        shader.inputs["Base Color"].default_value = GLASS
        material.diffuse_color = (*GLASS[:3], CLEAR)

    return _shared("Medialis: see-through", "see-through", build, changes)


def _shared(name: str, meaning: str, build: _Build, changes: Changes) -> bpy.types.Material:
    """Return the material of this meaning; it is made when missing."""
    found = find_shared(bpy.data.materials, meaning)
    if found is not None:
        return found
    material = bpy.data.materials.new(name)
    changes.undo_by(bpy.data.materials.remove, material)
    own.mark(material, MEANING, meaning)
    if material.node_tree is None:  # Blender 5 has nodes from the beginning
        material.use_nodes = True
    shader = next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    shader.inputs["Roughness"].default_value = 0.6
    build(material, shader)
    own.remember_nodes(material)
    return material


def find_shared(collection: Any, meaning: str) -> Any:
    """Return what medialis has made of this meaning in a collection of the file, if anything."""
    made = (one for one in collection if one.get(MEANING) == meaning and one.library is None)
    return next((one for one in made if own.is_own(one, collection)), None)


def _attribute_node(tree: bpy.types.NodeTree, name: str, x: float) -> bpy.types.Node:
    node = tree.nodes.new("ShaderNodeAttribute")
    node.attribute_type = "GEOMETRY"
    node.attribute_name = name
    node.location = (x, 300)
    return node


def _linear(srgb: object) -> tuple[float, float, float, float]:
    return (*to_linear(srgb).tolist(), 1.0)
