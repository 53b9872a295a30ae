# SPDX-License-Identifier: GPL-3.0-or-later
"""From a result of the core to the scene: everything is prepared first, and all of it is added.

Layers on the input become attributes of the source; other layers become objects in the collection
of the source. Auxiliary layers are added on request only. When anything fails the file is as it was
before.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

from medialis import InvalidShapeError, Result, Shape
from medialis.hosts import Rig, rig_of, title

from . import armatures, fields, layers, placing, summary
from .changes import Changes
from .reading import RESULT, Source


@dataclass(frozen=True)
class Options:
    """What a user can ask for beyond the result itself."""

    add_samples: bool = False
    with_materials: bool = False
    curves: bool = False
    bind: bool = False


def add_result(
    context: bpy.types.Context, source: Source, shape: Shape, result: Result, options: Options
) -> list[bpy.types.Object]:
    """Add a result to the scene of its source.

    Parameters
    ----------
    source, shape
        What was read, and the shape of the core made from it.

    Returns
    -------
    list of objects
        Those that carry the layers, in their order; the first is active and selected.

    Raises
    ------
    InvalidShapeError
        When the source is gone or changed, or Blender cannot hold the values: nothing is added.
    """
    chosen = source.find()
    scene = bpy.data.scenes.get(source.scene) or context.scene
    wanted = [layer for layer in result.layers if options.add_samples or not layer.auxiliary]
    rig, spacing = rig_of(result, shape), result.values.get("spacing")
    plans: list[layers.Plan | fields.FieldPlan] = []
    for layer in wanted:
        name = f"{chosen.name} {title(layer.name)}"
        if layer.on_input:
            with_groups = rig is None or rig.weights is None  # the weights are the vertex groups
            plans.append(fields.plan_field(layer, name, shape, source, with_groups=with_groups))
        else:
            plans.append(layers.plan_layer(layer, name, spacing))
    active = context.view_layer.objects.active
    for other in (chosen, active):  # meanwhile the user may be editing another object
        if other is not None:
            leave_edit_mode(context, other)
    names = {plan.layer.name for plan in plans}
    earlier = sum(child.get(RESULT) in names for child in chosen.children)
    with Changes() as changes:
        made = _make(context, scene, chosen, source, plans, options, rig, changes)
        carriers = list(dict.fromkeys(made.values()))
        if rig is not None and rig.weights is not None:
            _add_skin(made, rig, options, changes)
        _add_images(result, chosen.name, changes)
        text = summary.lines(result, wanted, source.name, earlier)
        for carrier in carriers:
            _remember(carrier, text, changes)
        if carriers and carriers[0] != chosen:
            placing.make_active(context, carriers[0])
    return carriers


def leave_edit_mode(context: bpy.types.Context, chosen: bpy.types.Object) -> None:
    """Go to object mode: attributes cannot be written in others, and undo knows no objects there.

    Raises
    ------
    InvalidShapeError
        When Blender refuses.
    """
    if chosen.mode == "OBJECT":
        return
    with context.temp_override(object=chosen, active_object=chosen):
        bpy.ops.object.mode_set(mode="OBJECT")
    if chosen.mode != "OBJECT":
        raise InvalidShapeError(f"{chosen.name} must be in object mode: press Tab, then run again.")


def _make(
    context: bpy.types.Context,
    scene: bpy.types.Scene,
    chosen: bpy.types.Object,
    source: Source,
    plans: Sequence[layers.Plan | fields.FieldPlan],
    options: Options,
    rig: Rig | None,
    changes: Changes,
) -> dict[str, bpy.types.Object]:
    """Add what the plans say; return what carries each layer, by its name."""
    collection = None
    place = None
    made: dict[str, bpy.types.Object] = {}
    for plan in plans:
        if isinstance(plan, fields.FieldPlan):
            if place is None:  # one mesh for all layers on the input
                place = fields.place_for_fields(context, chosen, source, changes)
            carrier = place
            fields.write_field(plan, carrier, changes, with_materials=options.with_materials)
        else:
            if rig is not None and plan.layer is rig.layer:
                carrier = armatures.new_armature(context, plan.title, rig.bones, changes)
            else:
                carrier = layers.make_object(plan, scene, changes, curves=options.curves)
            placing.lay_on(carrier, chosen, source)
            carrier.show_in_front = plan.shows != "faces"
        if carrier != chosen and carrier not in made.values():
            carrier.name = plan.title
            carrier.data.name = plan.title
            collection = collection or placing.result_collection(scene, chosen.name, changes)
            placing.link(carrier, collection)
            carrier[RESULT] = plan.layer.name
        made[plan.layer.name] = carrier
    return made


def _add_skin(
    made: Mapping[str, bpy.types.Object], rig: Rig, options: Options, changes: Changes
) -> None:
    """Write the weights on what carries the layer of the skin; bind that where it is asked for."""
    armature, place = made[rig.layer.name], made[rig.skin_layer.name]
    armatures.write_weights(place, rig.bones.names, rig.weights)
    if options.bind:
        armatures.require_unbound(place)
        armatures.bind(place, armature, changes)


def _remember(carrier: bpy.types.Object, text: str, changes: Changes) -> None:
    """Keep the summary with the object, so that the panel shows it also after loading the file."""
    before = carrier.get(summary.PROPERTY)

    def restore() -> None:
        if before is None:
            del carrier[summary.PROPERTY]
        else:
            carrier[summary.PROPERTY] = before

    carrier[summary.PROPERTY] = text
    changes.undo_by(restore)


def _add_images(result: Result, name: str, changes: Changes) -> None:
    """Add the pictures that are themselves the result; they are packed into the file."""
    for picture, pixels in result.images.items():
        height, width = pixels.shape[:2]
        image = bpy.data.images.new(f"{name} {title(picture)}", width, height)
        changes.undo_by(bpy.data.images.remove, image)
        image.pixels.foreach_set(_rgba(pixels))
        image.update()
        image.pack()
        image.use_fake_user = True


def _rgba(pixels: NDArray[np.uint8]) -> NDArray[np.float32]:
    rgba = np.ones((*pixels.shape[:2], 4), np.float32)
    rgba[..., :3] = pixels[::-1] / np.float32(255)  # Blender's first row is the lowest
    return rgba.ravel()
