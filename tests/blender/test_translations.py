"""Every text of panel and operators in every language, given to Blender and taken away again."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

bpy = pytest.importorskip("bpy", reason="bpy is not installed: make hosts")

from medialis import OPERATIONS

ADDON = Path(__file__).resolve().parents[2] / "blender_addon"
LOOKED_UP = {"iface", "tip", "rpt", "poll_message_set", "report", "draw_fold"}
"""Functions whose texts Blender looks up, besides those that are given as `text`."""
LANGUAGES = ("de", "fr", "es", "ja", "zh")
KEPT = re.compile(r"\{[^}]*\}|\d+(?:\.\d+)?")


def messages() -> set[str]:
    """Return all texts that the registered add-on shows; the tests ask each table for them.

    What the core tells of single options, and of their choices, may be missing: it is English then.
    """
    from blender_addon import editing, menus, preferences, selecting
    from blender_addon.properties import PER_CENT

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
    for path in ADDON.glob("*.py"):
        shown += _written(ast.parse(path.read_text(encoding="utf-8")))
    found = {text.removesuffix(PER_CENT) if text != PER_CENT else text for text in shown}
    return found - told_by_options() - {""}


def told_by_options() -> set[str]:
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


@pytest.fixture
def translations(addon):
    from blender_addon import translations

    return translations


@pytest.fixture
def table(translations, request):
    return getattr(translations, request.param).TABLE


every = pytest.mark.parametrize("table", LANGUAGES, indirect=True)


def test_messages_are_those_of_classes_tables_and_sources(translations):
    found = messages()
    some = {"Thickness", "Rig", "Keep my materials", "Select Thin Walls", "medial axis", "Bind"}
    some |= {"Notes: {count}", "{object} is no mesh", "Threads (Automatic)", "Balls", "Export"}
    some |= {"All tasks and operations, group after group.", "Vertex groups", "More"}
    assert some <= found
    assert not any("INVOKE" in text or "medialis." in text for text in found)


@every
def test_every_message_has_a_text_and_no_other_has(translations, table):
    asked = messages()
    assert asked - set(table) == set()
    assert set(table) - asked - told_by_options() == set()
    assert all(to.strip() for to in table.values())


@every
def test_numbers_names_and_stops_are_kept(table):
    for text, to in table.items():
        assert sorted(KEPT.findall(to)) == sorted(KEPT.findall(text)), text
        assert to.endswith((".", "。")) == text.endswith("."), text


@every
def test_most_texts_are_others(table):
    same = [text for text, to in table.items() if text == to]
    assert len(same) < 0.12 * len(table), same


def test_a_new_operator_is_asked_for(translations):
    class MEDIALIS_OT_made_for_a_test(bpy.types.Operator):  # noqa: N801
        """Do what nobody has translated"""

        bl_idname = "medialis.made_for_a_test"
        bl_label = "Made for a Test"

    bpy.utils.register_class(MEDIALIS_OT_made_for_a_test)
    try:
        missing = messages() - set(translations.de.TABLE)
    finally:
        bpy.utils.unregister_class(MEDIALIS_OT_made_for_a_test)
    assert missing == {"Made for a Test", "Do what nobody has translated"}


def test_tables_have_the_names_of_this_blender(translations, monkeypatch):
    """4.2 and later know es, or es_ES; without a list of languages all names are given."""
    every_name = {name for names in translations.LANGUAGES for name in names}
    known = set(bpy.app.translations.locales)
    assert set(translations.tables()) == (every_name & known if known else every_name)
    assert not known or all(set(names) & known for names in translations.LANGUAGES)
    german = translations.tables().get("de_DE") or translations.tables()["de"]
    assert german["Operator", "Thickness"] == german["*", "Thickness"] == "Dicke"
    share = translations.PER_CENT
    assert german["*", "How lengths are given" + share].endswith(german["*", share])


def test_texts_with_names_are_put_together_in_the_language(translations, scene, monkeypatch):
    from blender_addon import menus

    monkeypatch.setattr(menus, "iface", lambda text: translations.de.TABLE[text])
    assert menus.with_words("Rig", ("bones",)) == "Rig (Knochen)"


def test_the_add_on_gives_the_tables_and_takes_them_away(addon, monkeypatch):
    """Where Blender is built without translations, it forgets what it is given: so it is asked."""
    from blender_addon import translations

    given = {}
    own = SimpleNamespace(locales=(), register=given.__setitem__, unregister=given.__delitem__)
    monkeypatch.setattr(translations, "bpy", SimpleNamespace(app=SimpleNamespace(translations=own)))
    assert translations in addon._modules()
    translations.register()
    assert given["blender_addon.translations"]["ja"]["*", "Rig"] == "リグ"
    translations.unregister()
    assert given == {}


@pytest.mark.skipif(
    not bpy.app.build_options.international, reason="this bpy is built without translations"
)
@pytest.mark.parametrize("names", [("de_DE", "de"), ("ja_JP", "ja"), ("zh_HANS", "zh_CN")])
def test_blender_shows_the_language(translations, scene, names):
    view = bpy.context.preferences.view
    before = view.language, view.use_translate_interface, view.use_translate_tooltips
    table = translations.LANGUAGES[names]
    try:
        view.language = next(name for name in names if name in bpy.app.translations.locales)
        view.use_translate_interface = view.use_translate_tooltips = True
        shown = bpy.app.translations.pgettext_iface
        assert shown("Skeleton Study", "Operator") == table["Skeleton Study"]
        assert shown("Notes: {count}") == table["Notes: {count}"]
        translations.unregister()
        assert shown("Notes: {count}") == "Notes: {count}"
        translations.register()
    finally:
        view.language, view.use_translate_interface, view.use_translate_tooltips = before
