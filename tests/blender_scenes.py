"""What the tests of the Blender adapter share: objects from arrays, and reading attributes back."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy", reason="bpy is not installed: make hosts")

QUICK = {
    "view_curve_skeleton": {"pairs": 40, "size": 128},
    "medial_mesh": {"balls": 24, "quality": "fast"},
}
"""Options of operations that take three seconds at their defaults, where numbers do not matter;
test_operators.py runs all operations at their defaults."""

KEYS = {"FLOAT_VECTOR": ("vector", 3), "FLOAT2": ("vector", 2), "FLOAT_COLOR": ("color", 4)}


def add_object(name, data, **transform):
    """Add an object of any data to the scene; it alone is selected, and active."""
    made = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(made)
    bpy.context.view_layer.objects.active = made
    for other in bpy.context.scene.objects:
        other.select_set(other == made)
    for key, value in transform.items():
        setattr(made, key, value)
    return made


def add_mesh(name, points, faces, **transform):
    """Add a mesh object of triangles, polygons or points."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(np.asarray(points).tolist(), [], [list(map(int, f)) for f in faces])
    return add_object(name, mesh, **transform)


def values_of(attribute):
    """Return the values of an attribute, (n,) or (n, d)."""
    key, width = KEYS.get(attribute.data_type, ("value", 1))
    kinds = {"INT": np.int32, "BOOLEAN": bool}
    values = np.empty(len(attribute.data) * width, kinds.get(attribute.data_type, np.float32))
    attribute.data.foreach_get(key, values)
    return values.reshape(-1, width) if width > 1 else values


def read_back(data, name):
    """Return the values of the attribute of that name."""
    return values_of(data.attributes[name])


def counts():
    """Number of datablocks in every collection of the file."""
    found = {}
    for name in dir(bpy.data):
        collection = getattr(bpy.data, name)
        if isinstance(collection, bpy.types.bpy_prop_collection):
            found[name] = len(collection)
    return found


def groups_of(chosen):
    """Return {name: sorted vertices} of the vertex groups."""
    names = [group.name for group in chosen.vertex_groups]
    found = {name: [] for name in names}
    for vertex in chosen.data.vertices:
        for entry in vertex.groups:
            found[names[entry.group]].append(vertex.index)
    return found


def evaluated(chosen):
    """Return the object as Blender shows it."""
    return chosen.evaluated_get(bpy.context.evaluated_depsgraph_get())


def world(chosen):
    """Return the points of a mesh or point cloud object in the world."""
    points = read_back(chosen.data, "position").astype(float)
    bpy.context.view_layer.update()
    matrix = np.array(chosen.matrix_world)
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def add_armature(name, bones, matrix=None):
    """Add an armature with bones (name, head, tail, parent, deforms); it is active."""
    data = bpy.data.armatures.new(name)
    made = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(made)
    bpy.context.view_layer.objects.active = made
    bpy.ops.object.mode_set(mode="EDIT")
    for bone, head, tail, parent, deforms in bones:
        new = data.edit_bones.new(bone)
        new.head, new.tail, new.use_deform = head, tail, deforms
        new.parent = data.edit_bones.get(parent) if parent else None
    bpy.ops.object.mode_set(mode="OBJECT")
    return made


def select(*objects):
    """Select objects; the last one is active."""
    bpy.ops.object.select_all(action="DESELECT")
    for one in objects:
        one.select_set(True)
    bpy.context.view_layer.objects.active = objects[-1]
