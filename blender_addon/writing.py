# SPDX-License-Identifier: GPL-3.0-or-later
"""From a result of the core to the scene: everything is prepared first, and all of it is added.

Layers on the input become attributes of the source; other layers become objects in the collection
of the source. Auxiliary layers are added on request only. When anything fails the file is as it was
before.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import bpy
import numpy as np
from numpy.typing import NDArray

from medialis import Bones, InvalidShapeError, Result, Shape
from medialis.hosts import Rig, legend_of, numbers_of, rig_of, title

from . import armatures, fields, layers, legends, looks, overlay, own, placing, removing, summary
from .changes import Changes
from .reading import FORMATS, OPERATION, RESULT, Source, positions
from .removing import Record


@dataclass(frozen=True)
class Options:
    """What a user can ask for beyond the result itself."""

    add_samples: bool = False
    keep_materials: bool = False
    keep_earlier: bool = False
    legend: bool = True
    legend_in_renders: bool = False
    segments_as: frozenset[str] = frozenset({"GROUPS"})
    curves: bool = False
    bind: bool = False


@dataclass(eq=False)
class _Run:
    """What one writing of a result needs throughout."""

    context: bpy.types.Context
    scene: bpy.types.Scene
    chosen: bpy.types.Object
    source: Source
    shape: Shape
    result: Result
    options: Options
    rig: Rig | None
    changes: Changes
    record: Record
    collection: bpy.types.Collection | None = None
    told: list[str] = field(default_factory=list)

    def adopt(self, made: bpy.types.Object, name: str, of: str) -> None:
        """Name an object, mark it as a result, and put it into the collection of the source."""
        made.name = made.data.name = name
        made[OPERATION] = self.result.operation
        own.mark(made, RESULT, of)
        if self.collection is None:
            self.collection = placing.result_collection(self.scene, self.chosen, self.changes)
        placing.link(made, self.collection)


def add_result(
    context: bpy.types.Context,
    source: Source,
    shape: Shape,
    result: Result,
    options: Options,
    tell: Callable[[str], object] | None = None,
    armature: tuple[str, str | None] | None = None,
) -> list[bpy.types.Object]:
    """Add a result to the scene of its source, in the place of an earlier one of its operation.

    Results of other operations are hidden.

    Parameters
    ----------
    source, shape
        What was read, and the shape of the core made from it.
    tell : callable, optional
        Called with sentences that say what of the user's stays.
    armature : tuple, optional
        Name and library of the armature of the user that the result has bound the source to.

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
    rig = rig_of(result, shape)
    plans = _plans(chosen, source, shape, result, options, rig)
    active = context.view_layer.objects.active
    for other in (chosen, active):  # meanwhile the user may be editing another object
        if other is not None:
            leave_edit_mode(context, other)
    with Changes() as changes:
        record = Record(result.operation)
        run = _Run(context, scene, chosen, source, shape, result, options, rig, changes, record)
        place = _prepare(run, plans)
        made, colors = _make(run, plans, place)
        carriers = list(dict.fromkeys(made.values()))
        if run.rig is not None and run.rig.weights is not None:
            _add_skin(
                run, made, place, None if armature is None else bpy.data.objects.get(armature)
            )
        record.images = _add_images(result, chosen.name, changes)
        extra = _add_signs(run, plans)
        record.hides = _hide_covered(run, plans, place)
        if plans and not options.keep_materials and plans[0].layer.role != "shape":
            record.look = _set_look(run, plans, place, colors)
        if chosen.data is not None:
            record.attributes = own.prints(chosen.data, record.attributes)
            record.groups = own.group_prints(chosen, record.groups) if record.groups else {}
        record.summary = summary.lines(result, [plan.layer for plan in plans], source.name)
        for carrier in carriers:
            _remember(carrier, record.summary, changes)
        changes.keep_by(_finish, run, [*carriers, *extra], plans)
    for sentence in run.told if tell is not None else ():
        tell(sentence)
    return carriers


def _prepare(run: _Run, plans: Sequence[layers.Plan | fields.FieldPlan]) -> fields.Place | None:
    """Return where layers on the input go; what an earlier run has written there goes before."""
    chosen, changes = run.chosen, run.changes
    place = None
    if any(isinstance(plan, fields.FieldPlan) for plan in plans):
        place = fields.place_for_fields(run.context, chosen, run.source, changes)
    earlier = removing.record_of(chosen, run.result.operation)
    replaced = earlier is not None and not run.options.keep_earlier
    if (replaced or (place is not None and place.object == chosen)) and chosen.type in (
        "MESH", "POINTCLOUD"
    ):  # fmt: skip
        fields.keep_a_copy(chosen, changes)
    if replaced and earlier is not None:
        run.told += removing.take_fields(chosen, earlier)
        changes.keep_by(removing.take_images, earlier)
    if place is not None and run.rig is not None and isinstance(run.rig.bones, Bones):
        taken = [group.name for group in place.object.vertex_groups]
        run.rig = armatures.free_names(run.rig, taken)
    return place


def _plans(
    chosen: bpy.types.Object,
    source: Source,
    shape: Shape,
    result: Result,
    options: Options,
    rig: Rig | None,
) -> list[layers.Plan | fields.FieldPlan]:
    """Convert all layers that are wanted, before anything is changed."""
    plans: list[layers.Plan | fields.FieldPlan] = []
    for layer in result.layers:
        name = f"{chosen.name} {title(layer.name)}"
        if layer.on_input:
            with_groups = rig is None or rig.weights is None  # the weights are the vertex groups
            plans.append(fields.plan_field(layer, name, shape, source, with_groups=with_groups))
        elif options.add_samples or not layer.auxiliary:
            plans.append(layers.plan_layer(layer, name, result))
    return plans


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
    run: _Run, plans: Sequence[layers.Plan | fields.FieldPlan], place: fields.Place | None
) -> tuple[dict[str, bpy.types.Object], dict[str, str]]:
    """Add what the plans say; return what carries each layer, and the colours of those on input."""
    record = run.record
    made: dict[str, bpy.types.Object] = {}
    colors: dict[str, str] = {}
    for plan in plans:
        if isinstance(plan, fields.FieldPlan):
            assert place is not None
            carrier = place.object
            written = fields.write_field(plan, place, run.changes, run.options.segments_as)
            colors[plan.layer.name] = written.colors
            run.told += written.told
            if carrier == run.chosen:
                record.attributes |= {key: [] for key in written.attributes}
                record.groups |= {key: [] for key in written.groups}
                record.slots += written.slots
        else:
            if run.rig is not None and plan.layer is run.rig.layer:
                carrier = armatures.new_armature(run.context, plan.title, run.rig, run.changes)
            else:
                carrier = layers.make_object(
                    plan, run.scene, run.changes, curves=run.options.curves
                )
            placing.lay_on(carrier, run.chosen, run.source)
            carrier.show_in_front = plan.shows not in ("faces", "sheets", "balls")
            carrier.hide_render = plan.layer.role == "hidden"
            if plan.layer.formats:
                carrier[FORMATS] = ",".join(plan.layer.formats)
        if carrier != run.chosen and carrier not in made.values():
            run.adopt(carrier, plan.title, plan.layer.name)
        made[plan.layer.name] = carrier
    return made, colors


def _add_skin(
    run: _Run,
    made: dict[str, bpy.types.Object],
    place: fields.Place | None,
    armature: bpy.types.Object | None,
) -> None:
    """Write the weights on what carries the layer of the skin; bind that where it is asked for."""
    rig = run.rig
    assert rig is not None and place is not None
    weights = rig.weights if place.rows is None else armatures.own_weights(rig.weights, place.rows)
    of_user = not isinstance(rig.bones, Bones)
    names = armatures.write_weights(place.object, rig.bones.names, weights, overwrite=of_user)
    if place.object == run.chosen:
        run.record.groups |= {key: [] for key in names}
    if armature is not None:
        armatures.attach(place.object, armature, run.changes)
    elif run.options.bind and rig.layer is None:
        raise InvalidShapeError(
            "The bones of a file are no armature object: import it and select it with the object, "
            "or do not bind."
        )
    elif run.options.bind:
        armatures.require_unbound(place.object)
        armatures.bind(place.object, made[rig.layer.name], run.changes)


def _add_signs(
    run: _Run,
    plans: Sequence[layers.Plan | fields.FieldPlan],
) -> list[bpy.types.Object]:
    """Record the legend of the first layer that has colours, and numbers at places.

    Views draw them. Objects for renders are added where they are asked for.
    """
    options = run.options
    if not (options.legend or options.legend_in_renders):
        return []
    numbered = [(plan, numbers_of(plan.layer, run.result.shape)) for plan in plans]
    shown = next((plan.shown for plan in plans if plan.shown is not None), None)
    key = None if shown is None else legend_of(shown)
    if options.legend:
        numbers = [one for _, one in numbered if one is not None]
        run.record.legend = overlay.packed(key, numbers, run.source.linear)
    if not options.legend_in_renders:
        return []
    found, around = [], [run.shape.points]
    for plan, one in numbered:
        if one is not None:
            name, size = f"{plan.title} numbers", run.shape.diagonal
            sign = legends.new_numbers(name, one, size, run.context, run.changes)
            sign.show_in_front = True
            around.append(positions(sign.data).astype(np.float64))
            found.append(sign)
    if key is not None:
        name = f"{run.chosen.name} {title(run.result.operation)} legend"
        all_of_it = np.concatenate(around)
        found.append(legends.new_legend(name, key, all_of_it, run.context, run.changes))
    for sign in found:
        placing.lay_on(sign, run.chosen, run.source)
        run.adopt(sign, sign.name, "legend")
        run.context.view_layer.update()
        if sign.name in run.context.view_layer.objects:  # not in a collection that is excluded
            sign.hide_set(True)
    return found


def _hide_covered(
    run: _Run, plans: Sequence[layers.Plan | fields.FieldPlan], place: fields.Place | None
) -> bool:
    """Hide the source where a copy or the result itself takes its place; tell whether it does."""
    copied = place is not None and place.object != run.chosen
    if copied or (plans and plans[0].layer.role == "shape"):
        looks.hide(run.chosen, run.context, run.changes)
        return True
    return False


def _set_look(
    run: _Run,
    plans: Sequence[layers.Plan | fields.FieldPlan],
    place: fields.Place | None,
    colors: dict[str, str],
) -> str:
    """Show the shape in the colours of the result, or see-through where that lies inside.

    Returns
    -------
    str
        What the source is shown with (`looks.show_with`).
    """
    if not isinstance(next(iter(plans), None), fields.FieldPlan) and run.rig is None:
        looks.show_with(run.chosen, looks.SEE_THROUGH, run.changes)
        return looks.SEE_THROUGH
    name = next((one for one in colors.values() if one), "")
    if not name or place is None:
        return ""
    looks.show_with(place.object, name, run.changes)
    return name if place.object == run.chosen else ""


def _finish(
    run: _Run,
    made: list[bpy.types.Object],
    plans: Sequence[layers.Plan | fields.FieldPlan],
) -> None:
    """Take earlier results away, give the names that they had, and let the views show the new."""
    record, chosen = run.record, run.chosen
    if run.options.keep_earlier:
        removing.add_record(run.chosen, record)
    else:
        names = {one: one.name for one in made}
        run.told += removing.replace_earlier(run.context, run.chosen, record, made)
        for one, name in names.items():
            stem = name.rpartition(".")[0] if name[-4:-3] == "." else name
            if one != run.chosen and name != stem and stem not in bpy.data.objects:
                own.rename(one, stem)
                one.data.name = stem
        others = [one for one in removing.records_of(chosen) if one.operation != record.operation]
        if any(one.shown for one in others):
            removing.show(run.context, chosen, [record.operation])
    run.context.view_layer.update()
    for one in made:
        if one.hide_render and one != run.chosen and one.name in run.context.view_layer.objects:
            one.hide_set(True)
    if made and made[0] != run.chosen:
        placing.make_active(run.context, made[0])
    if run.told:
        record.summary = "\n".join([record.summary, *(f"! {told}" for told in run.told)])
        others = [one for one in removing.records_of(chosen) if one.operation != record.operation]
        removing.write_records(chosen, [*others, record])
        for one in made:
            if summary.PROPERTY in one:
                one[summary.PROPERTY] = record.summary
    for one in made:
        if one != chosen:
            own.remember(one)
    on_surface = all(isinstance(plan, fields.FieldPlan) for plan in plans)
    looks.set_shading(run.context, colored_surface=on_surface)


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


def _add_images(result: Result, name: str, changes: Changes) -> list[str]:
    """Add the pictures that are themselves the result, packed into the file; return their names."""
    names = []
    for picture, pixels in result.images.items():
        height, width = pixels.shape[:2]
        image = bpy.data.images.new(f"{name} {title(picture)}", width, height)
        changes.undo_by(bpy.data.images.remove, image)
        own.mark(image, RESULT, picture)
        image.pixels.foreach_set(_rgba(pixels))
        image.update()
        image.pack()
        image.use_fake_user = True
        names.append(image.name)
    return names


def _rgba(pixels: NDArray[np.uint8]) -> NDArray[np.float32]:
    rgba = np.ones((*pixels.shape[:2], 4), np.float32)
    rgba[..., :3] = pixels[::-1] / np.float32(255)  # Blender's first row is the lowest
    return rgba.ravel()
