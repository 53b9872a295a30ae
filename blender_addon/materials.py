# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials that show an attribute: a ramp of the core's colour map, or colours as they are."""

from __future__ import annotations

import bpy
import numpy as np

from medialis.hosts import MISSING, color_table, label_name, palette, to_linear

from .changes import Changes

STOPS = 17
"""Colours of a ramp; Blender allows 32, and the maps are smooth."""


def ramp_material(
    attribute: str, color_map: str, limits: tuple[float, float], changes: Changes
) -> bpy.types.Material:
    """Return a material that colours by a number: the map's first and last colour at the limits."""
    material, shader = _new(f"Medialis: {attribute}", changes)
    tree = material.node_tree
    read = _attribute_node(tree, attribute, -900)
    scale = tree.nodes.new("ShaderNodeMapRange")
    scale.location = (-700, 300)
    low, high = limits
    scale.inputs["From Min"].default_value = low
    scale.inputs["From Max"].default_value = high if high > low else low + 1.0
    ramp = tree.nodes.new("ShaderNodeValToRGB")
    ramp.location = (-500, 300)
    table = color_table(color_map)
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
    return material


def color_material(attribute: str, changes: Changes) -> bpy.types.Material:
    """Return a material that shows a colour attribute."""
    material, shader = _new(f"Medialis: {attribute}", changes)
    read = _attribute_node(material.node_tree, attribute, -300)
    material.node_tree.links.new(read.outputs["Color"], shader.inputs["Base Color"])
    return material


def label_material(labels: str, label: int, changes: Changes) -> bpy.types.Material:
    """Return the material of one segment, "<labels> 003"; one of that name is used again."""
    name = label_name(labels, label)
    found = bpy.data.materials.get((name, None))
    if found is not None:
        return found
    material, shader = _new(name, changes)
    color = _linear(MISSING if label < 0 else palette()[label % len(palette())])
    shader.inputs["Base Color"].default_value = color
    material.diffuse_color = color
    return material


def _new(name: str, changes: Changes) -> tuple[bpy.types.Material, bpy.types.Node]:
    material = bpy.data.materials.new(name)
    changes.undo_by(bpy.data.materials.remove, material)
    if material.node_tree is None:  # Blender 5 has nodes from the beginning
        material.use_nodes = True
    shader = next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    shader.inputs["Roughness"].default_value = 0.6
    return material, shader


def _attribute_node(tree: bpy.types.NodeTree, name: str, x: float) -> bpy.types.Node:
    node = tree.nodes.new("ShaderNodeAttribute")
    node.attribute_type = "GEOMETRY"
    node.attribute_name = name
    node.location = (x, 300)
    return node


def _linear(srgb: object) -> tuple[float, float, float, float]:
    return (*to_linear(srgb).tolist(), 1.0)
