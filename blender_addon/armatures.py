# SPDX-License-Identifier: GPL-3.0-or-later
"""Bones and skin weights of the core as an armature object, vertex groups and a modifier."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix, Vector
from numpy.typing import NDArray

from medialis import Armature, InvalidShapeError, SkinWeights
from medialis.hosts import Rig, write_armature_json

from . import attributes
from .changes import Changes
from .reading import Source, is_result
from .transfer import Rows

MODIFIER = "Medialis armature"
FINISH = {
    *("SUBSURF", "MULTIRES", "SMOOTH", "CORRECTIVE_SMOOTH", "LAPLACIANSMOOTH", "BEVEL", "SOLIDIFY"),
    *("WEIGHTED_NORMAL", "EDGE_SPLIT", "TRIANGULATE"),
}
"""Modifiers that come after the pose: they see the surface that the bones have bent."""


def new_armature(
    context: bpy.types.Context, title: str, given: Rig, changes: Changes
) -> bpy.types.Object:
    """Add an armature object with these bones; bones that meet at a joint are connected.

    Bones can be added in edit mode only: the armature is active for a moment.

    Raises
    ------
    InvalidShapeError
        When Blender cannot edit it, or cannot hold the coordinates.
    """
    rig = given.bones
    heads = attributes.coordinates(rig.heads, title)
    tails = attributes.coordinates(rig.tails, title)
    data = bpy.data.armatures.new(title)
    changes.undo_by(bpy.data.armatures.remove, data)
    made = bpy.data.objects.new(title, data)
    context.scene.collection.objects.link(made)
    layer = context.view_layer
    layer.update()
    active = layer.objects.active
    layer.objects.active = made
    try:
        bpy.ops.object.mode_set(mode="EDIT")
        _add_bones(data, given, heads, tails)
        bpy.ops.object.mode_set(mode="OBJECT")
    except RuntimeError as error:
        raise InvalidShapeError(f"Blender cannot edit a new armature here: {error}") from error
    finally:
        layer.objects.active = active
    data.display_type = "OCTAHEDRAL"
    if len(data.bones) < rig.count:
        raise InvalidShapeError(
            f"{rig.count - len(data.bones)} bones are too short for Blender: scale the object up."
        )
    return made


def _add_bones(
    data: bpy.types.Armature, given: Rig, heads: NDArray[np.float32], tails: NDArray[np.float32]
) -> None:
    rig = given.bones
    made: list[Any] = []
    for number, name in enumerate(rig.names):
        bone = data.edit_bones.new(name)
        bone.head, bone.tail = heads[number].tolist(), tails[number].tolist()
        bone.align_roll(Vector(given.rolls[number].tolist()))
        bone.head_radius = float(rig.head_radii[number])
        bone.tail_radius = float(rig.tail_radii[number])
        bone.envelope_distance = 0.25 * max(bone.head_radius, bone.tail_radius)
        parent = int(rig.parents[number])
        if parent >= 0:
            bone.parent = made[parent]
            bone.use_connect = bool(rig.connected[number])
        made.append(bone)


def free_names(given: Rig, taken: Collection[str]) -> Rig:
    """Give the bones other names where vertex groups of the user have some of theirs."""
    names = given.bones.names
    if not set(names) & set(taken):
        return given
    other = tuple(f"medialis {name}" for name in names)
    return replace(given, bones=replace(given.bones, given_names=other))


def own_weights(skin: SkinWeights, rows: Rows) -> SkinWeights:
    """Return the weights of the vertices of the object's own mesh."""
    weights = rows.of(skin.weights, "POINT")
    return SkinWeights(rows.of(skin.bones, "POINT"), np.nan_to_num(weights))


def of_user(context: bpy.types.Context, chosen: bpy.types.Object) -> bpy.types.Object | None:
    """Return the armature that an object is to be bound to.

    The active one or another selected one; else the one that moves the object; None: there is none.
    """
    selected = [context.active_object, *context.selected_objects]
    moving = [one.object for one in chosen.modifiers if one.type == "ARMATURE"]
    for candidate in (*selected, *moving, chosen.parent):
        if candidate is not None and candidate.type == "ARMATURE":
            return candidate
    return None


def deforming(armature: bpy.types.Object) -> Armature:
    """Return the bones that deform, at rest, in the axes of the object.

    Raises
    ------
    InvalidShapeError
        When the armature has none.
    """
    bones = [bone for bone in armature.data.bones if bone.use_deform]
    if not bones:
        raise InvalidShapeError(f"{armature.name} has no bone that deforms: turn on Deform.")
    rows = {bone.name: row for row, bone in enumerate(bones)}
    parents = []
    for bone in bones:
        above = bone.parent
        while above is not None and above.name not in rows:
            above = above.parent
        parents.append(-1 if above is None else rows[above.name])
    heads = np.array([bone.head_local for bone in bones], np.float64)
    tails = np.array([bone.tail_local for bone in bones], np.float64)
    return Armature(heads, tails, parents, tuple(rows))


def in_world(armature: bpy.types.Object) -> Armature:
    """Return the bones that deform, at rest, in the axes of the world.

    Raises
    ------
    InvalidShapeError
        When the armature has none.
    """
    bones, here = deforming(armature), np.array(armature.matrix_world)
    heads, tails = (ends @ here[:3, :3].T + here[:3, 3] for ends in (bones.heads, bones.tails))
    return replace(bones, heads=heads, tails=tails)


def hand_over(armature: bpy.types.Object, source: Source, path: str | Path) -> None:
    """Write the bones that deform, at rest, in the axes and units of what was read.

    Raises
    ------
    InvalidShapeError
        When the armature has none.
    """
    bones = in_world(armature)
    origin = np.array(source.find().matrix_world.translation)
    moved = replace(bones, heads=bones.heads - origin, tails=bones.tails - origin)
    write_armature_json(path, moved, source.unit)


def write_weights(
    place: bpy.types.Object, names: Sequence[str], skin: SkinWeights, *, overwrite: bool
) -> list[str]:
    """Write one vertex group a bone, of its name; vertices with the same weight together.

    A group that has the name already is overwritten where that is asked for, as for the bones of
    the user's armature, which find it by its name; else the new one gets another name.

    Returns
    -------
    list of str
        The names of the groups that are new.
    """
    vertices, columns = np.nonzero(skin.bones >= 0)
    of_bone = skin.bones[vertices, columns]
    weights = attributes.single(skin.weights[vertices, columns])
    order = np.lexsort((vertices, weights, of_bone))
    vertices, of_bone, weights = vertices[order], of_bone[order], weights[order]
    groups, added = [], []
    everything = list(range(len(place.data.vertices)))
    for name in names:
        group = place.vertex_groups.get(name) if overwrite else None
        if group is None:
            group = place.vertex_groups.new(name=name)
            added.append(group.name)
        else:
            group.remove(everything)
        groups.append(group)
    new = (np.diff(of_bone, prepend=-1) != 0) | (np.diff(weights, prepend=-1) != 0)
    begins = np.flatnonzero(new).tolist()
    rows, heaviness, numbers = vertices.tolist(), weights.tolist(), of_bone.tolist()
    for begin, end in zip(begins, [*begins[1:], len(rows)], strict=True):
        groups[numbers[begin]].add(rows[begin:end], heaviness[begin], "REPLACE")
    return added


def require_unbound(place: bpy.types.Object) -> None:
    """Refuse to bind what an armature of the user moves; one of ours is replaced.

    Raises
    ------
    InvalidShapeError
        When one does.
    """
    for modifier in place.modifiers:
        moves = modifier.type == "ARMATURE" and modifier.object is not None
        if moves and not _is_ours(modifier):
            raise InvalidShapeError(
                f"{place.name} is moved by the armature of its modifier {modifier.name} already: "
                "remove that first, or do not bind."
            )


def _is_ours(modifier: bpy.types.Modifier) -> bool:
    return modifier.type == "ARMATURE" and is_result(modifier.object)


@contextmanager
def at_rest(
    context: bpy.types.Context, place: bpy.types.Object, armature: bpy.types.Object | None = None
) -> Iterator[None]:
    """Show what an armature of ours, or this one, moves as it is without: bones belong there.

    An armature at rest would do, but changes the last digits.
    """
    moving = [
        one
        for one in place.modifiers
        if one.type == "ARMATURE" and one.show_viewport
        and (_is_ours(one) or (armature is not None and one.object == armature))
    ]  # fmt: skip
    for modifier in moving:
        modifier.show_viewport = False
    context.view_layer.update()
    try:
        yield
    finally:
        for modifier in moving:
            modifier.show_viewport = True


def bind(place: bpy.types.Object, armature: bpy.types.Object, changes: Changes) -> None:
    """Parent an object to an armature that lies on it, and let the bones deform it.

    The armature takes the place of the object: it gets its parent, and no scale of its own. An
    armature of ours that moved the object becomes its child, as results that move nothing are.
    """
    context = bpy.context
    context.view_layer.update()
    modifier = next((one for one in place.modifiers if _is_ours(one)), None)
    before = None if modifier is None else modifier.object
    top = before if before is not None and place.parent == before else place
    above, kind, bone = top.parent, top.parent_type, top.parent_bone
    here, there = place.matrix_world.copy(), armature.matrix_world.copy()
    _keep_parent(place, changes)
    basis = place.matrix_basis.copy()
    armature.parent, armature.matrix_basis = above, Matrix()
    armature.matrix_parent_inverse = Matrix()
    if above is not None:
        armature.parent_type, armature.parent_bone = kind, bone
    context.view_layer.update()
    # Inverses of parents may shear, which location, rotation and scale cannot.
    armature.matrix_parent_inverse = armature.matrix_world.inverted()
    armature.matrix_basis = there
    place.parent, place.parent_type = armature, "OBJECT"
    place.matrix_parent_inverse = there.inverted() @ here @ basis.inverted()
    if modifier is None:
        modifier = place.modifiers.new(MODIFIER, "ARMATURE")
        changes.undo_by(place.modifiers.remove, modifier)
        place.modifiers.move(len(place.modifiers) - 1, _before_finish(place))
    else:
        changes.undo_by(setattr, modifier, "object", before)
    modifier.object = armature
    if top is before:
        _keep_parent(before, changes)
        before.parent, before.parent_type = place, "OBJECT"


def attach(place: bpy.types.Object, armature: bpy.types.Object, changes: Changes) -> None:
    """Let an armature of the user deform an object, as Blender's parenting does; nothing moves."""
    if not any(one.type == "ARMATURE" and one.object == armature for one in place.modifiers):
        modifier = place.modifiers.new(MODIFIER, "ARMATURE")
        changes.undo_by(place.modifiers.remove, modifier)
        place.modifiers.move(len(place.modifiers) - 1, _before_finish(place))
        modifier.object = armature
    if place.parent is None:
        _keep_parent(place, changes)
        place.parent, place.parent_type = armature, "OBJECT"
        place.matrix_parent_inverse = armature.matrix_world.inverted()


def _keep_parent(child: bpy.types.Object, changes: Changes) -> None:
    """Record the parent of an object, in case that something fails."""
    above, inverse = child.parent, child.matrix_parent_inverse.copy()
    kind, bone = child.parent_type, child.parent_bone

    def restore() -> None:
        child.parent = above
        child.parent_type, child.parent_bone = kind, bone
        child.matrix_parent_inverse = inverse

    changes.undo_by(restore)


def _before_finish(place: bpy.types.Object) -> int:
    """Return where an armature belongs: behind what makes limbs, before what rounds them.

    The last modifier is not looked at.
    """
    at = len(place.modifiers) - 1
    while at > 0 and _finishes(place.modifiers[at - 1]):
        at -= 1
    return at


def _finishes(modifier: bpy.types.Modifier) -> bool:
    return modifier.type in FINISH
