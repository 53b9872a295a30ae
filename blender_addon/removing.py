# SPDX-License-Identifier: GPL-3.0-or-later
"""What results brought into the file, which of them is shown, and how all of it goes again.

Only what medialis has made goes, and only while it is as it was made (`own.py`).
"""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Iterable
from dataclasses import asdict, dataclass, field
from functools import lru_cache
from typing import Any

import bpy

from . import fields, looks, materials, own, placing, summary
from .changes import Changes
from .reading import OPERATION, RESULT, is_result, source_of

RECORDS = "medialis_records"
"""Custom property of sources: what each operation brought."""
HIDDEN = "medialis_hidden"
"""Custom property of objects that were hidden with their result, and not otherwise."""


@dataclass
class Record:
    """What an operation brought to its source besides objects."""

    operation: str
    attributes: own.Made = field(default_factory=dict)
    groups: own.Made = field(default_factory=dict)
    images: list[str] = field(default_factory=list)
    slots: list[str] = field(default_factory=list)
    """Materials of segments that were added to the slots of the source."""
    look: str = ""
    """What the source is shown with (`looks.show_with`)."""
    hides: bool = False
    """A copy stands in the place of the source."""
    legend: dict[str, Any] = field(default_factory=dict)
    """What the colours mean, and numbers at places (`overlay.py`)."""
    summary: str = ""
    shown: bool = True


def records_of(source: bpy.types.Object) -> list[Record]:
    """Return what was recorded, the last operation at the end; views and panels ask at each draw.

    Fields of records may be set anew; what is in them stays as it is.
    """
    return [Record(**one) for one in _parsed(source.get(RECORDS, "[]"))]


@lru_cache(maxsize=8)
def _parsed(text: str) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads(text)
    return found


def write_records(source: bpy.types.Object, records: list[Record]) -> None:
    """Keep what results have brought with the source."""
    if records:
        source[RECORDS] = json.dumps([asdict(one) for one in records])
    elif RECORDS in source:
        del source[RECORDS]


def record_of(source: bpy.types.Object, operation: str) -> Record | None:
    """Return what was recorded of an operation."""
    return next((one for one in records_of(source) if one.operation == operation), None)


def attribute_of(chosen: bpy.types.Object, wanted: str) -> str:
    """Return the attribute of a result, which has a number where its name was taken; or nothing.

    That of the result that is shown goes before; a copy that carries a result has no records.
    """
    records = sorted(records_of(chosen), key=lambda one: one.shown)
    for record in reversed(records):
        for name in record.attributes:
            if re.fullmatch(re.escape(wanted) + r"(\.\d{3,})?", name):
                return name
    return wanted if not records and is_result(chosen) else ""


def add_record(source: bpy.types.Object, new: Record) -> None:
    """Record what another run of an operation brought, besides the earlier ones."""
    records = records_of(source)
    for record in records:
        if record.operation == new.operation:
            new.attributes = {**record.attributes, **new.attributes}
            new.groups = {**record.groups, **new.groups}
            new.images, new.slots = record.images + new.images, record.slots + new.slots
            new.hides |= record.hides
    write_records(source, [*(one for one in records if one.operation != new.operation), new])


def results_of(source: bpy.types.Object, operation: str) -> list[bpy.types.Object]:
    """Return the objects that an operation added to a source."""
    return [made for made in bpy.data.objects
            if made.get(OPERATION) == operation and is_result(made)
            and source_of(made) == source]  # fmt: skip


def operation_of(chosen: bpy.types.Object | None) -> str:
    """Return the operation whose result is active; of a source, the one that is shown, or last."""
    if chosen is None or is_result(chosen):
        return "" if chosen is None else chosen.get(OPERATION, "")
    records = records_of(chosen)
    shown = [record for record in records if record.shown] or records
    return shown[-1].operation if shown else ""


def replace_earlier(
    context: bpy.types.Context,
    source: bpy.types.Object,
    new: Record,
    made: Iterable[bpy.types.Object],
) -> list[str]:
    """Take away the objects of earlier runs of the same operation, and record the new ones.

    An armature that moves its object stays, and what was edited. Their attributes and groups have
    gone before (`take_fields`).

    Returns
    -------
    list of str
        Sentences that say what stays.
    """
    kept = set(made)
    old = [one for one in results_of(source, new.operation) if one not in kept]
    told = _remove_objects([one for one in old if not _moves(one, old)])
    records = records_of(source)
    now = [*(one for one in records if one.operation != new.operation), new]
    write_records(source, now)
    _cover(context, source, _is_covered(records), now)
    return told + _purge()


def remove_result(
    context: bpy.types.Context, source: bpy.types.Object, operation: str
) -> list[str]:
    """Take away all that an operation brought to a source; return sentences on what stays."""
    objects = results_of(source, operation)
    for one in objects:
        if one.type == "ARMATURE":
            _unbind(one)
    told = _remove_objects(objects)
    records = records_of(source)
    for record in records:
        if record.operation == operation:
            told += take_fields(source, record)
            take_images(record)
    rest = [one for one in records if one.operation != operation]
    write_records(source, rest)
    _cover(context, source, _is_covered(records), rest)
    if not any(one.attributes for one in rest) and source.data is not None:
        fields.own_color(source.data)
    seen = [one.operation for one in rest if one.shown]
    show(context, source, seen or [one.operation for one in rest[-1:]])
    if not rest and summary.PROPERTY in source:
        del source[summary.PROPERTY]
    return told + _purge()


def take_fields(source: bpy.types.Object, record: Record) -> list[str]:
    """Remove attributes, vertex groups and slots as they were written.

    Returns
    -------
    list of str
        Sentences that say what the user has edited, and keeps.
    """
    data = source.data
    ours, edited = own.unchanged(data, record.attributes) if record.attributes else ([], [])
    shared = _of_others(source)
    kept = next((one for one in ours if one.startswith(fields.SLOTS_BEFORE)), "")
    if fields.SLOTS in ours and kept:  # without it nobody knows what they were
        fields.own_slots(data, kept, record.slots)
    for name in ours:
        if name not in (*shared, fields.SLOTS):
            data.attributes.remove(data.attributes[name])
    if record.groups:
        groups, painted = own.unchanged_groups(source, record.groups)
        edited += painted
        for name in groups:
            if name not in shared:
                source.vertex_groups.remove(source.vertex_groups[name])
    if not edited:
        return []
    return [f"{', '.join(edited)} of {source.name} was edited since: it stays as yours."]


def take_images(record: Record) -> None:
    """Remove the pictures of a result, but those that were painted on."""
    for name in record.images:
        image = bpy.data.images.get((name, None))
        if image is not None and own.is_own(image, bpy.data.images) and not image.is_dirty:
            bpy.data.images.remove(image)


def _of_others(source: bpy.types.Object) -> set[str]:
    """Return the attributes and groups that are results of other objects with the same data."""
    names: set[str] = set()
    if source.data.users > 1:
        for other in bpy.data.objects:
            if other != source and other.data == source.data:
                for record in records_of(other):
                    names |= {*record.attributes, *record.groups}
    return names


def show(context: bpy.types.Context, source: bpy.types.Object, shown: Collection[str]) -> None:
    """Show the results of these operations and hide all others: objects, and colours of the source.

    Where none that is shown stands in the place of the source, the source is seen.
    """
    records = records_of(source)
    was_covered = _is_covered(records)
    for record in records:
        on = record.operation in shown
        for made in results_of(source, record.operation) if on != record.shown else ():
            if made.name in context.view_layer.objects:
                _show_object(made, on=on)
        record.shown = on
    write_records(source, records)
    _cover(context, source, was_covered, records)
    seen = [record for record in records if record.shown]
    _show_as_recorded(source, seen)
    if seen and summary.PROPERTY in source:
        source[summary.PROPERTY] = seen[-1].summary


def _show_object(made: bpy.types.Object, *, on: bool) -> None:
    if made[RESULT] == "legend":
        made.hide_render = not on
    elif on and made.get(HIDDEN):
        del made[HIDDEN]
        made.hide_render = False
        made.hide_set(False)
    elif not on and not made.hide_get():
        made[HIDDEN] = True
        made.hide_render = True
        made.hide_set(True)


def _is_covered(records: Iterable[Record]) -> bool:
    """Tell whether a copy that is shown stands in the place of the source."""
    return any(record.hides and record.shown for record in records)


def _cover(
    context: bpy.types.Context, source: bpy.types.Object, before: bool, records: Iterable[Record]
) -> None:
    """Hide or show the source where it is covered now and was not before, or the other way."""
    covered = _is_covered(records)
    if covered != before:
        source.hide_render = covered
        if source.name in context.view_layer.objects:
            source.hide_set(covered)


def _show_as_recorded(source: bpy.types.Object, records: list[Record]) -> None:
    """Show the source as the last of these operations left it, or as its own."""
    look = next((record.look for record in reversed(records) if record.look), "")
    if not look:
        looks.own_look(source)
        return
    with Changes() as changes:
        looks.show_with(source, look, changes)
    if look != looks.SEE_THROUGH:
        fields.show_color(source.data, look)


def _moves(armature: bpy.types.Object, going: Collection[bpy.types.Object]) -> bool:
    """Tell whether an object is an armature that others hang on, of those that stay."""
    return armature.type == "ARMATURE" and any(
        child not in going and (not is_result(child) or child.find_armature() == armature)
        for child in armature.children
    )


def _unbind(armature: bpy.types.Object) -> None:
    """Let what an armature moves stay where it is without it."""
    for child in list(armature.children):
        place = child.matrix_world.copy()
        for modifier in list(child.modifiers):
            if modifier.type == "ARMATURE" and modifier.object == armature:
                child.modifiers.remove(modifier)
        child.parent = armature.parent
        child.matrix_world = place


def _remove_objects(objects: Iterable[bpy.types.Object]) -> list[str]:
    """Remove objects that are as they were made; the others become the user's, which is told."""
    told = []
    for made in list(objects):
        own.release_copies(made, bpy.data.objects)
        if own.is_edited(made):
            own.release(made)
            told.append(f"{made.name} was edited since: it stays as yours.")
            continue
        data, places = made.data, list(made.users_collection)
        bpy.data.objects.remove(made)
        if data is not None and data.users == 0:
            bpy.data.batch_remove([data])
        placing.remove_empty(places)
    return told


def _purge() -> list[str]:
    """Remove node groups and materials of results that nothing uses any more.

    Returns
    -------
    list of str
        Sentences that say which were edited, and stay.
    """
    told = []
    for collection in (bpy.data.node_groups, bpy.data.materials):
        shared: Any = [one for one in collection if one.get(materials.MEANING) and not one.users]
        for one in shared:
            if not own.is_own(one, collection):
                continue
            if own.is_rewired(one):
                own.release(one)
                one.use_fake_user = True
                told.append(f"{one.name} was edited since: it stays as yours.")
            else:
                collection.remove(one)
    return told
