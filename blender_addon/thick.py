# SPDX-License-Identifier: GPL-3.0-or-later
"""Nodes that draw a mesh as what its balls stand for: balls, cones along edges, slabs over faces.

Vertices have a radius. The cone of an edge touches the two balls at its ends, the two planes of a
slab touch its three; all of it is computed from the vertices as they are now, so it follows edits.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

if TYPE_CHECKING:
    from .nodes import Nodes

RADIUS = "radius"
SIDES = 32
"""Of a cone."""
DETAIL = 3
"""How often the faces of balls are split at first."""


def thick(builder: Nodes, geometry: bpy.types.NodeSocket, shown: str) -> bpy.types.NodeSocket:
    """Return the balls, cones and slabs of a mesh of triangles and edges.

    Their points have the radius there, also under the name `shown`.
    """
    detail = builder.input(
        "Detail",
        "NodeSocketInt",
        default_value=DETAIL,
        min_value=1,
        max_value=6,
        description="How round the balls are drawn",
    )
    both = builder.node("GeometryNodeJoinGeometry")
    for part in (
        _balls(builder, geometry, detail),
        _cones(builder, geometry, shown),
        _slabs(builder, geometry),
    ):
        builder.link(part, both.inputs["Geometry"])
    return both.outputs["Geometry"]


def _radius(builder: Nodes) -> bpy.types.NodeSocket:
    return builder.math("MAXIMUM", builder.named(RADIUS), 0.0)


def _balls(
    builder: Nodes, geometry: bpy.types.NodeSocket, detail: bpy.types.NodeSocket
) -> bpy.types.NodeSocket:
    ball = builder.node("GeometryNodeMeshIcoSphere")
    ball.inputs["Radius"].default_value = 1.0
    builder.link(detail, ball.inputs["Subdivisions"])
    return _smooth(builder, _instances(builder, geometry, ball.outputs["Mesh"], _radius(builder)))


def _cones(builder: Nodes, geometry: bpy.types.NodeSocket, shown: str) -> bpy.types.NodeSocket:
    """Put a tube at each edge, and move each of its vertices to where the cone has it."""
    edge = builder.node("GeometryNodeInputMeshEdgeVertices")
    given = geometry
    for end in "12":
        number = edge.outputs[f"Vertex Index {end}"]
        radius = builder.at(_radius(builder), number, "FLOAT")
        given = builder.stored(given, f"end_{end}", edge.outputs[f"Position {end}"], "EDGE")
        given = builder.stored(given, f"end_radius_{end}", radius, "EDGE")
    points = builder.node("GeometryNodeMeshToPoints", mode="EDGES")
    builder.link(given, points.inputs["Mesh"])
    tube = builder.node("GeometryNodeMeshCylinder", fill_type="NONE")
    tube.inputs["Vertices"].default_value = SIDES
    tube.inputs["Radius"].default_value = tube.inputs["Depth"].default_value = 1.0
    place = builder.node("GeometryNodeInputPosition").outputs["Position"]
    tube = builder.stored(tube.outputs["Mesh"], "on_tube", place, "POINT")
    made = _instances(builder, points.outputs["Points"], tube, None)
    x, y, z = builder.parts(builder.named("on_tube", "FLOAT_VECTOR"))
    ends = [builder.named(f"end_{end}", "FLOAT_VECTOR") for end in "12"]
    radii = [builder.named(f"end_radius_{end}") for end in "12"]
    along = builder.vector("SUBTRACT", ends[1], ends[0])
    # Sine of the angle between the cone and its axis; the circles where it touches the balls lie
    # that much off their middles.
    sine = builder.math(
        "DIVIDE", builder.math("SUBTRACT", *radii), builder.vector("LENGTH", along, out="Value")
    )
    sine = builder.clamped(sine, -1.0, 1.0)
    cosine = _other_side(builder, sine)
    turned = builder.node("FunctionNodeAlignRotationToVector", axis="Z")
    builder.link(along, turned.inputs["Vector"])
    outward = builder.node("FunctionNodeRotateVector")
    own = builder.combined(
        builder.math("MULTIPLY", x, cosine), builder.math("MULTIPLY", y, cosine), sine
    )
    builder.link(own, outward.inputs["Vector"])
    builder.link(turned.outputs["Rotation"], outward.inputs["Rotation"])
    share = builder.math("ADD", z, 0.5)
    radius = builder.between(share, *radii, "FLOAT")
    offset = builder.vector("SCALE", outward.outputs["Vector"], radius)
    middle = builder.between(share, *ends, "VECTOR")
    for name in (RADIUS, shown):
        made = builder.stored(made, name, radius, "POINT")
    return _smooth(builder, builder.moved(made, "Position", builder.vector("ADD", middle, offset)))


def _slabs(builder: Nodes, geometry: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """Take each face twice, and move it along the normals of the planes that touch its balls."""
    twice = builder.node("GeometryNodeDuplicateElements", domain="FACE")
    twice.inputs["Amount"].default_value = 2
    builder.link(geometry, twice.inputs["Geometry"])
    place = builder.node("GeometryNodeInputPosition").outputs["Position"]
    corners, radii = [], []
    for number in range(3):
        corner = builder.node("GeometryNodeCornersOfFace")
        corner.inputs["Sort Index"].default_value = number
        vertex = builder.node("GeometryNodeVertexOfCorner")
        builder.link(corner.outputs["Corner Index"], vertex.inputs["Corner Index"])
        index = vertex.outputs["Vertex Index"]
        corners.append(builder.at(place, index, "FLOAT_VECTOR"))
        radii.append(builder.at(_radius(builder), index, "FLOAT"))
    # The normal n has n . (c_k - c_0) = r_0 - r_k: its part in the plane of the triangle follows
    # from the dual basis of the sides, the rest is what is missing to length 1, on either side.
    sides = [builder.vector("SUBTRACT", corners[k], corners[0]) for k in (1, 2)]
    drops = [builder.math("SUBTRACT", radii[0], radii[k]) for k in (1, 2)]
    across = builder.vector("CROSS_PRODUCT", *sides)
    area = builder.vector("DOT_PRODUCT", across, across, out="Value")
    first = builder.vector("SCALE", builder.vector("CROSS_PRODUCT", sides[1], across), drops[0])
    second = builder.vector("SCALE", builder.vector("CROSS_PRODUCT", across, sides[0]), drops[1])
    inverse = builder.math("DIVIDE", 1.0, area)
    flat = builder.vector("SCALE", builder.vector("ADD", first, second), inverse)
    length = builder.vector("LENGTH", flat, out="Value")
    side = builder.math("MULTIPLY_ADD", twice.outputs["Duplicate Index"], -2.0, 1.0)
    height = builder.math("MULTIPLY", _other_side(builder, length), side)
    upward = builder.vector("SCALE", builder.vector("NORMALIZE", across), height)
    normal = builder.vector("ADD", flat, upward)
    # Without such planes the cones and balls hold the triangle: it stays where it is.
    normal = builder.vector("SCALE", normal, builder.math("LESS_THAN", length, 1.0))
    of_face = builder.node("GeometryNodeFieldOnDomain", data_type="FLOAT_VECTOR", domain="FACE")
    builder.link(normal, builder.enabled(of_face.inputs, "Value"))
    normal = builder.enabled(of_face.outputs, "Value")
    offset = builder.vector("SCALE", normal, _radius(builder))
    return builder.moved(twice.outputs["Geometry"], "Offset", offset)


def _other_side(builder: Nodes, value: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """Return the square root of 1 - value^2, of 0 where that is negative."""
    square = builder.math("SUBTRACT", 1.0, builder.math("MULTIPLY", value, value))
    return builder.math("SQRT", builder.math("MAXIMUM", square, 0.0))


def _instances(
    builder: Nodes,
    points: bpy.types.NodeSocket,
    instance: bpy.types.NodeSocket,
    scale: bpy.types.NodeSocket | None,
) -> bpy.types.NodeSocket:
    made = builder.node("GeometryNodeInstanceOnPoints")
    builder.link(points, made.inputs["Points"])
    builder.link(instance, made.inputs["Instance"])
    if scale is not None:
        builder.link(scale, made.inputs["Scale"])
    real = builder.node("GeometryNodeRealizeInstances")
    builder.link(made.outputs["Instances"], real.inputs["Geometry"])
    return real.outputs["Geometry"]


def _smooth(builder: Nodes, geometry: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    node = builder.node("GeometryNodeSetShadeSmooth")
    socket = builder.enabled(node.inputs, "Geometry", "Mesh")  # Blender 5 calls it Mesh
    builder.link(geometry, socket)
    return node.outputs[0]
