# SPDX-License-Identifier: GPL-3.0-or-later
"""What panel, menus and operators say in other languages, through Blender's translation tables.

Blender looks a text up where it draws it: nothing else knows of these tables, but for texts with a
name or number in them, which are looked up before it is put in. Blender's own translation of a text
goes before that of a table. What a table lacks is shown in English.
"""

from __future__ import annotations

from collections.abc import Iterator

import bpy

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


def register() -> None:
    """Give Blender the tables."""
    bpy.app.translations.register(__name__, tables())


def unregister() -> None:
    """Take them away."""
    bpy.app.translations.unregister(__name__)
