# SPDX-License-Identifier: GPL-3.0-or-later
"""What panel, menus and operators say in other languages, through Blender's translation tables.

Blender looks a text up where it draws it: nothing else knows of these tables, but for texts with a
name or number in them, which are looked up before it is put in. Blender's own translation of a text
goes before that of a table. What a table lacks is shown in English.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import bpy

from medialis import OPERATIONS

from ..properties import PER_CENT
from . import de, es, fr, ja, zh

LANGUAGES: dict[tuple[str, ...], dict[str, str]] = {
    ("de_DE", "de"): de.TABLE,
    ("fr_FR", "fr"): fr.TABLE,
    ("es", "es_ES"): es.TABLE,
    ("ja_JP", "ja"): ja.TABLE,
    ("zh_HANS", "zh_CN"): zh.TABLE,
}
"""By the names that versions of Blender have for a language."""

CONTEXTS = ("*", "Operator")
"""Where Blender looks: labels of operators and texts of buttons are in the second."""

LOOKED_UP = {"iface", "tip", "rpt", "poll_message_set", "report", "draw_fold"}
"""Functions whose texts Blender looks up, besides those that are given as `text`."""


def tables() -> dict[str, dict[tuple[str, str], str]]:
    """Return what Blender registers, for the languages that it knows; without a list, for all."""
    known = bpy.app.translations.locales
    return {
        name: {(context, text): to for text, to in _whole(table) for context in CONTEXTS}
        for names, table in LANGUAGES.items()
        for name in names
        if not known or name in known
    }


def _whole(table: dict[str, str]) -> Iterator[tuple[str, str]]:
    """Yield the texts of a table; those of options also as they are where lengths are a share."""
    for text, to in table.items():
        yield text, to
        if text != PER_CENT and PER_CENT in table:
            yield text + PER_CENT, to + table[PER_CENT]


def messages() -> set[str]:
    """Return all texts that the registered add-on shows; the tests ask each table for them.

    What the core tells of single options, and of their choices, is not among them.
    """
    from .. import editing, menus, preferences, selecting

    settings = bpy.types.Scene.bl_rna.properties["medialis"].fixed_type
    groups = [p.fixed_type for p in settings.properties if p.identifier.startswith("of_")]
    levels = bpy.types.Object.bl_rna.properties["medialis_level"]
    shown = [PER_CENT, *menus.words(), *editing.ABOUT.values(), *selecting.MISSING.values()]
    shown += [f"Select {label}" for _, label, _ in selecting.WHICH]
    shown += _of_properties([levels, *preferences.MEDIALIS_AP_preferences.bl_rna.properties])
    for name in [name for name in dir(bpy.types) if name.startswith("MEDIALIS_")]:
        kind = getattr(bpy.types, name)
        if "_OT_" in name:
            operator = getattr(bpy.ops.medialis, name.partition("_OT_")[2]).get_rna_type()
            shown += [operator.name, operator.description, *_of_properties(operator.properties)]
        else:
            shown += [kind.bl_label, kind.__dict__.get("__doc__") or ""]
    for group in (settings, *groups):
        shown += _of_properties(group.properties)
    for path in Path(__file__).parents[1].glob("*.py"):
        shown += _written(ast.parse(path.read_text(encoding="utf-8")))
    found = {text.removesuffix(PER_CENT) if text != PER_CENT else text for text in shown}
    return found - _told_by_options() - {""}


def _told_by_options() -> set[str]:
    """Return what the core tells of its options and their choices."""
    every = [option for operation in OPERATIONS for option in operation.parameters]
    told = [text for option in every for text in (option.help, *option.choice_help)]
    return {text.removesuffix(".") for text in told}


def _of_properties(properties: Iterable[Any]) -> Iterator[str]:
    """Yield names and descriptions of properties and of their choices."""
    for one in properties:
        if one.type == "POINTER" or one.identifier in (one.name, "name", "bl_idname"):
            continue  # none of these is shown
        for shown in (one, *(one.enum_items if one.type == "ENUM" else ())):
            yield from (shown.name, shown.description)


def _written(tree: ast.AST) -> Iterator[str]:
    """Yield the texts in a source that are given to functions of `LOOKED_UP`."""
    for call in ast.walk(tree):
        if not isinstance(call, ast.Call):
            continue
        texts = [word.value for word in call.keywords if word.arg == "text"]
        if getattr(call.func, "attr", getattr(call.func, "id", "")) in LOOKED_UP:
            texts += call.args
        for one in [part for text in texts for part in _parts(text)]:
            value = getattr(one, "value", None)
            if isinstance(value, str) and (value[:1].isupper() or "{" in value):
                yield value


def _parts(text: ast.expr) -> list[ast.expr]:
    """Return what an expression chooses from."""
    return [text.body, text.orelse] if isinstance(text, ast.IfExp) else [text]


def register() -> None:
    """Give Blender the tables."""
    bpy.app.translations.register(__name__, tables())


def unregister() -> None:
    """Take them away."""
    bpy.app.translations.unregister(__name__)
