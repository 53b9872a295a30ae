"""Rig a mesh: one bone for each edge of its simplified curve skeleton, vertices bound to bones.

python rig_from_curve_skeleton.py MESH OUTPUT.blend

Needs `pip install bpy medialis`. `bones_of` needs medialis only.
"""

from __future__ import annotations

import sys
from collections import deque
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import medialis


@dataclass(frozen=True)
class Bone:
    """A bone from one node of the skeleton to the next; `parent` is -1 at the root."""

    head: int
    tail: int
    parent: int


def bones_of(curve: medialis.CurveSkeleton) -> list[Bone]:
    """Return the bones in an order in which parents come first, from the thickest node outwards.

    A loop is cut where its two halves meet: an armature is a tree.
    """
    near: list[list[int]] = [[] for _ in curve.nodes]
    for a, b in curve.edges.tolist():
        near[a].append(b)
        near[b].append(a)
    bones: list[Bone] = []
    ending = np.full(len(curve.nodes), -2)  # the bone that ends at a node; -2: not reached yet
    for start in np.argsort(-curve.radii, kind="stable").tolist():
        if ending[start] != -2:
            continue
        ending[start] = -1
        waiting = deque([start])
        while waiting:
            head = waiting.popleft()
            for tail in near[head]:
                if ending[tail] == -2:
                    ending[tail] = len(bones)
                    bones.append(Bone(head, tail, int(ending[head])))
                    waiting.append(tail)
    return bones


def bone_of_vertices(curve: medialis.CurveSkeleton, bones: list[Bone]) -> np.ndarray:
    """Return the bone of each vertex: the one that ends at its node, or begins there at a root."""
    of_node = np.full(len(curve.nodes) + 1, -1)
    for number in range(len(bones) - 1, -1, -1):
        of_node[bones[number].head] = number
    for number, bone in enumerate(bones):
        of_node[bone.tail] = number
    return of_node[curve.vertex_node]


def main(file: str, output: str) -> None:
    """Compute, then make the mesh, the armature and the vertex groups, and save."""
    import bpy

    shape = medialis.read_shape(file)
    curve = medialis.run("curve_skeleton", shape, simplify=0.03).graph
    bones = bones_of(curve)
    owner = bone_of_vertices(curve, bones)[: shape.point_count]

    bpy.ops.wm.read_homefile(use_empty=True)
    mesh = bpy.data.meshes.new("body")
    mesh.from_pydata(shape.points.tolist(), [], shape.faces.tolist())
    body = bpy.data.objects.new("body", mesh)
    rig = bpy.data.objects.new("rig", bpy.data.armatures.new("rig"))
    for made in (body, rig):
        bpy.context.collection.objects.link(made)

    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    made_bones = []
    for number, bone in enumerate(bones):
        new = rig.data.edit_bones.new(f"bone {number:03d}")
        new.head, new.tail = curve.nodes[bone.head], curve.nodes[bone.tail]
        if bone.parent >= 0:
            new.parent, new.use_connect = made_bones[bone.parent], True
        made_bones.append(new)
    bpy.ops.object.mode_set(mode="OBJECT")

    for number in range(len(bones)):
        group = body.vertex_groups.new(name=f"bone {number:03d}")
        group.add(np.flatnonzero(owner == number).tolist(), 1.0, "REPLACE")
    body.parent = rig
    body.modifiers.new("Armature", "ARMATURE").object = rig
    # Weights of 0 and 1 fold at the joints: let them run into each other.
    bpy.context.view_layer.objects.active = body
    body.select_set(True)
    bpy.ops.object.mode_set(mode="WEIGHT_PAINT")
    bpy.ops.object.vertex_group_smooth(group_select_mode="ALL", factor=0.5, repeat=20)
    bpy.ops.object.vertex_group_normalize_all(lock_active=False)
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.ops.wm.save_as_mainfile(filepath=str(Path(output).resolve()))
    print(len(bones), "bones")


if __name__ == "__main__":
    main(*sys.argv[1:])
