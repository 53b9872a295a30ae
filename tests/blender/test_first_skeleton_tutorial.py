"""What the tutorial "First skeleton in Blender" says is so; its code blocks run in their order."""

from __future__ import annotations

import importlib.util
import re
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy", reason="bpy is not installed: make hosts")
from code_blocks import blocks, run_python

import medialis
from blender_scenes import counts, evaluated, read_back

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "tutorials" / "first_skeleton_in_blender.md"
TEXT = " ".join(PAGE.read_text("utf-8").split())


@pytest.fixture
def creature(scene):
    """The scene after the first code block."""
    run_python(_codes()[0], PAGE, {})
    return bpy.data.objects["creature"]


def _codes():
    found = blocks(PAGE)
    assert [language for language, _ in found] == ["python", "python"]
    return [code for _, code in found]


def _show_colours(active):
    """Press the button in a view, and return how the view is shaded then."""
    from blender_addon import operators

    shading = SimpleNamespace(type="SOLID", color_type="MATERIAL")
    space = SimpleNamespace(type="VIEW_3D", shading=shading)
    context = SimpleNamespace(active_object=active, space_data=space)
    assert operators.MEDIALIS_OT_show_colors.execute(None, context) == {"FINISHED"}
    return shading


def test_the_zips_have_the_names_of_the_page():
    path = ROOT / "blender_addon" / "packaging" / "build_extension.py"
    spec = importlib.util.spec_from_file_location("build_extension_of_the_page", path)
    build = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = build  # dataclasses look their module up
    spec.loader.exec_module(build)
    rows = re.findall(r"\| `(medialis-[\w.-]+\.zip)`", TEXT)
    assert rows == [system.zip_name(build.core_version()) for system in build.SYSTEMS]


def test_everything_that_is_pressed_is_there(creature):
    from blender_addon import filtering, operators

    labels = {chosen.label for chosen in medialis.OPERATIONS}
    assert {"Skeleton with importance", "Thickness"} <= labels
    assert operators.MEDIALIS_OT_show_colors.bl_label == "Show Colours"
    bpy.ops.medialis.skeleton_importance()
    skeleton = bpy.context.active_object
    assert list(filtering.modifier_inputs(skeleton)) == ["Threshold", "Size", "Balls"]
    (thin,) = [p for p in medialis.operation("thickness").parameters if p.name == "threshold"]
    assert thin.label == "Thin below"
    for name in (*filtering.modifier_inputs(skeleton), thin.label, "Show Colours", "Thickness"):
        assert f"**{name}**" in TEXT


def test_one_click(creature):
    bpy.ops.medialis.skeleton_importance()
    skeleton = bpy.context.active_object
    assert skeleton.name == "creature skeleton importance" and skeleton.name in TEXT
    assert skeleton.parent == creature and skeleton.show_in_front
    assert [found.name for found in skeleton.users_collection] == ["Medialis: creature"]
    assert _show_colours(skeleton).type == "MATERIAL" and "Medialis look" in creature.modifiers
    (ramp,) = [n for n in skeleton.data.materials[0].node_tree.nodes if n.type == "VALTORGB"]
    red, green, blue, _ = ramp.color_ramp.elements[-1].color
    assert min(red, green) > 0.5 and blue < 0.1, "the most important points are yellow"


def test_the_slider(creature):
    from blender_addon import filtering

    bpy.ops.medialis.skeleton_importance()
    skeleton = bpy.context.active_object
    importance, radius = (read_back(skeleton.data, n) for n in ("importance", "medial_radius"))

    def shown(name):
        return read_back(evaluated(skeleton).data, name)

    filtering.set_input(skeleton, "Threshold", 6.4)
    stays = importance >= 0.064 * medialis.organic_shape(80).diagonal
    assert np.array_equal(shown("importance"), importance[stays]) and 0 < stays.sum() < len(stays)
    assert np.median(radius[stays]) > np.median(radius)  # the trunk, not the thin parts
    filtering.set_input(skeleton, "Threshold", 0.0)
    assert len(shown("importance")) == len(importance)
    filtering.set_input(skeleton, "Balls", True)
    assert np.array_equal(shown("radius"), radius)


def test_thickness_in_colours(creature):
    """The skeleton has made the creature see-through, which would show no colours."""
    bpy.ops.medialis.skeleton_importance()
    _show_colours(bpy.context.active_object)
    bpy.context.view_layer.objects.active = creature
    bpy.ops.medialis.thickness()
    assert bpy.context.view_layer.objects.active == creature
    shading = _show_colours(creature)
    assert (shading.type, shading.color_type) == ("SOLID", "VERTEX")
    assert creature.display_type == "TEXTURED"
    thickness = read_back(creature.data, "wall_thickness")
    colors = read_back(creature.data, creature.data.color_attributes.active_color.name)
    thin, thick = colors[np.nanargmin(thickness)], colors[np.nanargmax(thickness)]
    assert thick[:2].min() > 5 * thin[:2].max() > 5 * thick[2]  # dark, and yellow
    spots = bpy.data.objects["creature thin spots"]
    assert 0 < len(read_back(spots.data, "position")) <= 10
    assert (
        "! " in creature["medialis_summary"] and "The thinnest has" in creature["medialis_summary"]
    )


def test_a_result_goes_by_undo_with_all_of_it(creature):
    bpy.ops.ed.undo_push(message="before")
    before = counts()
    bpy.ops.medialis.skeleton_importance("EXEC_DEFAULT", True)
    after = counts()
    bpy.ops.ed.undo()
    assert counts() == before
    bpy.ops.ed.redo()
    assert counts() == after


def test_the_script_does_the_same(scene):
    names = {}
    for code in _codes():
        run_python(code, PAGE, names)
    assert names["skeleton"].parent == names["creature"]
    found = read_back(bpy.data.objects["creature thin spots"].data, "value")
    assert len(found) and (found < 0.05 * names["shape"].diagonal).all()
