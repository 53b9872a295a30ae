# SPDX-License-Identifier: GPL-3.0-or-later
"""How the object of a result looks: coloured by it, or see-through around what lies inside.

One modifier at the end of the stack sets the material of all faces. The object's own materials
stay where they are: removing the modifier brings them back.
"""

from __future__ import annotations

import bpy

from . import materials, own
from .changes import Changes

MODIFIER = "Medialis look"
SEE_THROUGH = "see-through"
BEFORE = "medialis_before"
"""Custom property of objects without modifiers: how they were shown."""
NUMBER = "medialis_look"
"""Custom property of objects: number of the modifier of `show_with`, which stays when renamed."""


def show_with(chosen: bpy.types.Object, look: str, changes: Changes) -> None:
    """Show an object in a colour attribute of that name, or `SEE_THROUGH`; an earlier look goes.

    What can have no modifiers, like metaballs, becomes a wire that no render shows.
    """
    clear = look == SEE_THROUGH
    material = materials.see_through(changes) if clear else materials.color_material(look, changes)
    color = tuple(chosen.color)
    changes.undo_by(setattr, chosen, "color", color)
    if chosen.get(BEFORE) is None:
        chosen[BEFORE] = [*color, *_shown_as(chosen)]
        changes.undo_by(_forget, chosen)
    chosen.color = (*color[:3], material.diffuse_color[3])
    modifier = look_of(chosen)
    if modifier is None:
        modifier = chosen.modifiers.new(MODIFIER, "NODES")
        if modifier is None:
            _as_wire(chosen, changes)
            return
        changes.undo_by(chosen.modifiers.remove, modifier)
        chosen[NUMBER] = str(modifier.persistent_uid)
        changes.undo_by(chosen.pop, NUMBER)
    before = modifier.node_group
    changes.undo_by(setattr, modifier, "node_group", before)
    modifier.node_group = _node_group(material, changes)
    modifier.show_expanded = False


def look_of(chosen: bpy.types.Object) -> bpy.types.Modifier | None:
    """Return the modifier of `show_with`, whatever it is called; None where there is none.

    One to which the user has given nodes of theirs is theirs.
    """
    number = chosen.get(NUMBER)
    for modifier in chosen.modifiers if number is not None else ():
        group = modifier.node_group if modifier.type == "NODES" else None
        ours = group is not None and group.get(materials.MEANING, "").startswith("look ")
        if ours and str(modifier.persistent_uid) == number:
            return modifier
    return None


def hide(chosen: bpy.types.Object, context: bpy.types.Context, changes: Changes) -> None:
    """Hide an object, as a copy of it stands in its place."""
    changes.undo_by(setattr, chosen, "hide_render", chosen.hide_render)
    chosen.hide_render = True
    if chosen.name in context.view_layer.objects:
        changes.undo_by(chosen.hide_set, chosen.hide_get())
        chosen.hide_set(True)


def own_look(chosen: bpy.types.Object) -> None:
    """Show an object as it was before all results."""
    modifier = look_of(chosen)
    if modifier is not None:
        chosen.modifiers.remove(modifier)
    before = chosen.get(BEFORE)
    if before is not None:
        chosen.color = list(before)[:4]
        if chosen.type == "META":
            chosen.display_type = ("WIRE", "TEXTURED")[int(before[4])]
            chosen.hide_render = bool(before[5])
        _forget(chosen)


def is_changed(chosen: bpy.types.Object) -> bool:
    """Tell whether a result changed how an object is shown."""
    return chosen.get(BEFORE) is not None


def set_shading(context: bpy.types.Context, *, colored_surface: bool) -> None:
    """Let the 3D views of the window show the result: solid with attributes, or with materials.

    Views that show materials already stay as they are.
    """
    screen = getattr(context, "screen", None)
    for area in [] if screen is None else screen.areas:
        if area.type != "VIEW_3D":
            continue
        shading = area.spaces.active.shading
        if shading.type in ("MATERIAL", "RENDERED"):
            continue
        if colored_surface:
            shading.type, shading.color_type = "SOLID", "VERTEX"
        else:
            shading.type = "MATERIAL"


def _shown_as(chosen: bpy.types.Object) -> list[float]:
    return [float(chosen.display_type != "WIRE"), float(chosen.hide_render)]


def _as_wire(chosen: bpy.types.Object, changes: Changes) -> None:
    for name, value in (("display_type", "WIRE"), ("hide_render", True)):
        changes.undo_by(setattr, chosen, name, getattr(chosen, name))
        setattr(chosen, name, value)


def _forget(chosen: bpy.types.Object) -> None:
    for name in (BEFORE, NUMBER):
        if name in chosen:
            del chosen[name]


def _node_group(material: bpy.types.Material, changes: Changes) -> bpy.types.NodeTree:
    """Return the node group that sets a material; it is made when missing."""
    meaning = f"look {material[materials.MEANING]}"
    found = materials.find_shared(bpy.data.node_groups, meaning)
    if found is not None:
        return found
    group = bpy.data.node_groups.new(f"{material.name} (look)", "GeometryNodeTree")
    changes.undo_by(bpy.data.node_groups.remove, group)
    own.mark(group, materials.MEANING, meaning)
    group.is_modifier = True
    for way in ("INPUT", "OUTPUT"):
        group.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    given, output = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
    paint = group.nodes.new("GeometryNodeSetMaterial")
    paint.inputs["Material"].default_value = material
    paint.location, output.location = (200, 0), (400, 0)
    group.links.new(given.outputs[0], paint.inputs["Geometry"])
    group.links.new(paint.outputs["Geometry"], output.inputs[0])
    own.remember_nodes(group)
    return group
