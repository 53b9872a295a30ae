# SPDX-License-Identifier: GPL-3.0-or-later
"""What a result brought into the file, and how all of it goes again."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable
from dataclasses import asdict, dataclass, field
from typing import Any

import bpy

from . import looks, materials, summary
from .changes import Changes
from .reading import OPERATION, RESULT, source_of

RECORDS = "medialis_records"
"""Custom property of sources: what each operation brought."""


@dataclass
class Record:
    """What an operation brought to its source besides objects."""

    operation: str
    attributes: list[str] = field(default_factory=list)
    groups: list[str] = field(default_factory=list)
    images: list[str] = field(default_factory=list)
    look: str = ""
    """What the source is shown with (`looks.show_with`)."""
    hides: bool = False
    """A copy stands in the place of the source."""


def records_of(source: bpy.types.Object) -> list[Record]:
    """Return what was recorded, the last operation at the end."""
    return [Record(**one) for one in json.loads(source.get(RECORDS, "[]"))]


def _write(source: bpy.types.Object, records: list[Record]) -> None:
    if records:
        source[RECORDS] = json.dumps([asdict(one) for one in records])
    elif RECORDS in source:
        del source[RECORDS]


def add_record(source: bpy.types.Object, new: Record) -> None:
    """Record what another run of an operation brought, besides the earlier ones."""
    records = records_of(source)
    for record in records:
        if record.operation == new.operation:
            for name in ("attributes", "groups", "images"):
                more = [*getattr(record, name), *getattr(new, name)]
                setattr(new, name, list(dict.fromkeys(more)))
            new.hides |= record.hides
    _write(source, [*(one for one in records if one.operation != new.operation), new])


def results_of(source: bpy.types.Object, operation: str) -> list[bpy.types.Object]:
    """Return the objects that an operation added to a source."""
    return [made for made in bpy.data.objects
            if made.get(OPERATION) == operation and source_of(made) == source]  # fmt: skip


def operation_of(chosen: bpy.types.Object | None) -> str:
    """Return the operation whose result is active; of a source, the last one."""
    if chosen is None or chosen.get(RESULT):
        return "" if chosen is None else chosen.get(OPERATION, "")
    records = records_of(chosen)
    return records[-1].operation if records else ""


def replace_earlier(
    context: bpy.types.Context,
    source: bpy.types.Object,
    new: Record,
    made: Iterable[bpy.types.Object],
) -> None:
    """Take away what earlier runs of the same operation brought, and record the new ones.

    An armature that moves its object stays.
    """
    kept = set(made)
    old = [one for one in results_of(source, new.operation) if one not in kept]
    _remove_objects([one for one in old if not _moves(one, old)])
    records = records_of(source)
    for record in records:
        if record.operation == new.operation:
            _remove_fields(source, record, keep=new)
    now = [*(one for one in records if one.operation != new.operation), new]
    _write(source, now)
    if any(one.hides for one in records) and not any(one.hides for one in now):
        _unhide(context, source)
    _purge()


def remove_result(context: bpy.types.Context, source: bpy.types.Object, operation: str) -> None:
    """Take away all that an operation brought to a source."""
    objects = results_of(source, operation)
    for one in objects:
        if one.type == "ARMATURE":
            _unbind(one)
    _remove_objects(objects)
    records = records_of(source)
    for record in records:
        if record.operation == operation:
            _remove_fields(source, record)
    rest = [one for one in records if one.operation != operation]
    _write(source, rest)
    if any(one.hides for one in records) and not any(one.hides for one in rest):
        _unhide(context, source)
    _show_as_recorded(source, rest)
    if not rest and summary.PROPERTY in source:
        del source[summary.PROPERTY]
    _purge()


def _unhide(context: bpy.types.Context, source: bpy.types.Object) -> None:
    source.hide_render = False
    if source.name in context.view_layer.objects:
        source.hide_set(False)


def _show_as_recorded(source: bpy.types.Object, records: list[Record]) -> None:
    """Show the source as the last of these operations left it, or as its own."""
    look = next((record.look for record in reversed(records) if record.look), "")
    if look:
        with Changes() as changes:
            looks.show_with(source, look, changes)
    else:
        looks.own_look(source)


def _moves(armature: bpy.types.Object, going: Collection[bpy.types.Object]) -> bool:
    """Tell whether an object is an armature that others hang on, of those that stay."""
    return armature.type == "ARMATURE" and any(
        child not in going and (not child.get(RESULT) or child.find_armature() == armature)
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


def _remove_objects(objects: Iterable[bpy.types.Object]) -> None:
    for made in list(objects):
        data, places = made.data, list(made.users_collection)
        bpy.data.objects.remove(made)
        if data is not None and data.users == 0:
            bpy.data.batch_remove([data])
        for collection in places:
            if collection.get(RESULT) and not collection.all_objects and not collection.children:
                bpy.data.collections.remove(collection)


def _remove_fields(source: bpy.types.Object, record: Record, keep: Record | None = None) -> None:
    """Remove attributes, vertex groups and images, but those that are kept."""
    new = keep or Record(record.operation)
    attributes = getattr(source.data, "attributes", {})
    for name in _gone(record.attributes, new.attributes):
        if name in attributes:
            attributes.remove(attributes[name])
    for name in _gone(record.groups, new.groups):
        group = source.vertex_groups.get(name)
        if group is not None:
            source.vertex_groups.remove(group)
    for name in _gone(record.images, new.images):
        image = bpy.data.images.get((name, None))
        if image is not None:
            bpy.data.images.remove(image)


def _gone(old: Collection[str], new: Collection[str]) -> list[str]:
    return [name for name in old if name not in new]


def _purge() -> None:
    """Remove node groups and materials of results that nothing uses any more."""
    for collection in (bpy.data.node_groups, bpy.data.materials):
        shared: Any = [one for one in collection if one.get(materials.MEANING) and not one.users]
        for one in shared:
            collection.remove(one)
