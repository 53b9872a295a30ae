# SPDX-License-Identifier: GPL-3.0-or-later
"""Point cloud objects from arrays, in all supported versions of Blender."""

from __future__ import annotations

from contextlib import ExitStack

import bpy
import numpy as np
from numpy.typing import NDArray

from .changes import Changes


def new_point_cloud(
    name: str, points: NDArray[np.float32], scene: bpy.types.Scene, changes: Changes
) -> bpy.types.Object:
    """Add a point cloud object with these points, (n, 3), to the scene's own collection."""
    cloud = bpy.data.pointclouds.new(name)
    changes.undo_by(bpy.data.pointclouds.remove, cloud)
    made = bpy.data.objects.new(name, cloud)
    scene.collection.objects.link(made)
    if hasattr(cloud, "resize"):  # Blender 5.1 and later
        cloud.resize(len(points))
        cloud.attributes["position"].data.foreach_set("vector", points.ravel())
    else:
        _fill_by_nodes(made, points)
    return made


def _fill_by_nodes(made: bpy.types.Object, points: NDArray[np.float32]) -> None:
    """Give the points through an applied Geometry Nodes modifier: older versions have no other way.

    The positions are set before: set afterwards, the bounding box would stay that of the origin.
    """
    with ExitStack() as temporary:
        mesh = bpy.data.meshes.new("medialis points")
        temporary.callback(bpy.data.meshes.remove, mesh)
        mesh.vertices.add(len(points))
        mesh.vertices.foreach_set("co", points.ravel())
        holder = bpy.data.objects.new("medialis points", mesh)
        temporary.callback(bpy.data.objects.remove, holder)
        group = bpy.data.node_groups.new("medialis points", "GeometryNodeTree")
        temporary.callback(bpy.data.node_groups.remove, group)
        for way in ("INPUT", "OUTPUT"):
            group.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
        given = group.nodes.new("GeometryNodeObjectInfo")
        given.inputs["Object"].default_value = holder
        convert = group.nodes.new("GeometryNodeMeshToPoints")
        group.links.new(given.outputs["Geometry"], convert.inputs["Mesh"])
        output = group.nodes.new("NodeGroupOutput")
        group.links.new(convert.outputs[0], output.inputs[0])
        modifier = made.modifiers.new("medialis points", "NODES")
        modifier.node_group = group
        with bpy.context.temp_override(object=made, active_object=made, selected_objects=[made]):
            bpy.ops.object.modifier_apply(modifier=modifier.name)
    for name in (".select_vert", "radius"):
        leftover = made.data.attributes.get(name)
        if leftover is not None:
            made.data.attributes.remove(leftover)
