# SPDX-License-Identifier: GPL-3.0-or-later
"""Geometry Nodes by code."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import bpy


class Nodes:
    """Nodes of a group in a row, each linked to the sockets before it; methods return sockets."""

    def __init__(self, group: bpy.types.NodeTree) -> None:
        self.group = group
        self.inputs = self.node("NodeGroupInput")

    def node(self, kind: str, **settings: Any) -> bpy.types.Node:
        """Add a node with these settings."""
        made = self.group.nodes.new(kind)
        made.location = (200 * len(self.group.nodes), 0)
        for name, value in settings.items():
            setattr(made, name, value)
        return made

    def link(self, output: bpy.types.NodeSocket, into: bpy.types.NodeSocket) -> None:
        """Link two sockets."""
        self.group.links.new(output, into)

    def input(self, name: str, kind: str, **settings: Any) -> bpy.types.NodeSocket:
        """Add an input of the group."""
        socket = self.group.interface.new_socket(name, in_out="INPUT", socket_type=kind)
        for key, value in settings.items():
            setattr(socket, key, value)
        return next(s for s in self.inputs.outputs if s.identifier == socket.identifier)

    def named(self, attribute: str, kind: str = "FLOAT") -> bpy.types.NodeSocket:
        """Return the values of an attribute."""
        node = self.node("GeometryNodeInputNamedAttribute", data_type=kind)
        node.inputs["Name"].default_value = attribute
        return self.enabled(node.outputs, "Attribute")

    @staticmethod
    def enabled(sockets: Iterable[bpy.types.NodeSocket], *names: str) -> bpy.types.NodeSocket:
        """Return the socket of one of these names: nodes of several types have it for each."""
        return next(socket for socket in sockets if socket.name in names and socket.enabled)

    def give(self, into: bpy.types.NodeSocket, value: bpy.types.NodeSocket | float) -> None:
        """Link a socket, or set a number."""
        if isinstance(value, bpy.types.NodeSocket):
            self.link(value, into)
        else:
            into.default_value = value

    def math(self, operation: str, *values: bpy.types.NodeSocket | float) -> bpy.types.NodeSocket:
        """Return what comes of sockets and numbers."""
        node = self.node("ShaderNodeMath", operation=operation)
        for socket, value in zip(node.inputs, values, strict=False):
            self.give(socket, value)
        return node.outputs[0]

    def clamped(self, value: bpy.types.NodeSocket, low: float, high: float) -> bpy.types.NodeSocket:
        """Return the value within limits."""
        return self.math("MINIMUM", self.math("MAXIMUM", value, low), high)

    def vector(
        self, operation: str, *values: bpy.types.NodeSocket, out: str = "Vector"
    ) -> bpy.types.NodeSocket:
        """Return the output `out` of what comes of vectors."""
        node = self.node("ShaderNodeVectorMath", operation=operation)
        inputs = [socket for socket in node.inputs if socket.enabled]
        for socket, value in zip(inputs, values, strict=False):
            self.link(value, socket)
        return node.outputs[out]

    def parts(self, vector: bpy.types.NodeSocket) -> tuple[bpy.types.NodeSocket, ...]:
        """Return x, y and z of a vector."""
        node = self.node("ShaderNodeSeparateXYZ")
        self.link(vector, node.inputs[0])
        return tuple(node.outputs)

    def combined(self, *values: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
        """Return the vector of x, y and z."""
        node = self.node("ShaderNodeCombineXYZ")
        for socket, value in zip(node.inputs, values, strict=True):
            self.link(value, socket)
        return node.outputs[0]

    def between(
        self,
        share: bpy.types.NodeSocket,
        first: bpy.types.NodeSocket,
        second: bpy.types.NodeSocket,
        kind: str,
    ) -> bpy.types.NodeSocket:
        """Return the value that lies this share of the way from the first to the second."""
        node = self.node("ShaderNodeMix", data_type=kind, clamp_factor=False)
        for name, value in (("Factor", share), ("A", first), ("B", second)):
            self.link(value, self.enabled(node.inputs, name))
        return self.enabled(node.outputs, "Result")

    def at(
        self, value: bpy.types.NodeSocket, index: bpy.types.NodeSocket, kind: str
    ) -> bpy.types.NodeSocket:
        """Return the value at the point of that number."""
        node = self.node("GeometryNodeFieldAtIndex", data_type=kind, domain="POINT")
        self.link(value, self.enabled(node.inputs, "Value"))
        self.link(index, node.inputs["Index"])
        return self.enabled(node.outputs, "Value")

    def stored(
        self,
        geometry: bpy.types.NodeSocket,
        name: str,
        value: bpy.types.NodeSocket,
        domain: str,
    ) -> bpy.types.NodeSocket:
        """Write an attribute of the type of its socket."""
        kind = "FLOAT_VECTOR" if value.type == "VECTOR" else "FLOAT"
        node = self.node("GeometryNodeStoreNamedAttribute", data_type=kind, domain=domain)
        node.inputs["Name"].default_value = name
        self.link(geometry, node.inputs["Geometry"])
        self.link(value, self.enabled(node.inputs, "Value"))
        return node.outputs["Geometry"]

    def moved(
        self, geometry: bpy.types.NodeSocket, how: str, value: bpy.types.NodeSocket
    ) -> bpy.types.NodeSocket:
        """Move all points: to a "Position", or by an "Offset"."""
        node = self.node("GeometryNodeSetPosition")
        self.link(geometry, node.inputs["Geometry"])
        self.link(value, node.inputs[how])
        return node.outputs["Geometry"]
