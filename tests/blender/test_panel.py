"""The panels are drawn in every state, on a layout that knows what Blender's layout knows."""

from types import SimpleNamespace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy", reason="bpy is not installed: make hosts")
from blender_scenes import add_mesh, add_object
from medialis.operations.registry import OPERATIONS

CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
ICONS = bpy.types.UILayout.bl_rna.functions["label"].parameters["icon"].enum_items.keys()


class Layout:
    """Records what is drawn; checks arguments, property paths, icons and operators as Blender."""

    def __init__(self, drawn=None):
        self.drawn = [] if drawn is None else drawn
        self.texts = []

    def _inside(self, kind, arguments):
        known = bpy.types.UILayout.bl_rna.functions[kind].parameters
        assert set(arguments) <= set(known.keys()), f"{kind} has no {arguments}"
        return Layout(self.drawn)

    def box(self):
        return Layout(self.drawn)

    def row(self, **arguments):
        return self._inside("row", arguments)

    def column(self, **arguments):
        return self._inside("column", arguments)

    def split(self, **arguments):
        return self._inside("split", arguments)

    def separator(self):
        pass

    def menu_pie(self):
        return Layout(self.drawn)

    def menu(self, name, icon="NONE"):
        assert hasattr(bpy.types, name) and icon in ICONS
        self.drawn.append(name)

    def label(self, text="", icon="NONE"):
        assert icon in ICONS
        self.drawn.append(text)

    def progress(self, factor, text):
        assert 0 <= factor <= 1
        self.drawn.append(text)

    def prop(self, owner, path, text=None, icon="NONE", **about):
        assert icon in ICONS and set(about) <= {"emboss", "slider", "full_event"}
        if path.startswith("["):
            owner.path_resolve(path)
        else:
            assert path in owner.bl_rna.properties
        self.drawn.append(text or path)

    def operator(self, name, icon="NONE", text=""):
        assert icon in ICONS
        module, function = name.split(".")
        kind = getattr(getattr(bpy.ops, module), function).get_rna_type()
        self.drawn.append(name)
        self.texts.append(text or kind.name)
        return Button(kind)


class Button:
    """Properties of an operator button: only those that the operator has can be set."""

    def __init__(self, kind):
        object.__setattr__(self, "kind", kind)
        object.__setattr__(self, "given", {})

    def __setattr__(self, name, value):
        assert name in self.kind.properties
        self.given[name] = value


@pytest.fixture
def draw(scene):
    """Draw all panels that Blender would show, and return the texts."""
    from blender_addon import panel

    def draw_all(width=300):
        context = SimpleNamespace(
            scene=bpy.context.scene,
            active_object=bpy.context.view_layer.objects.active,
            preferences=SimpleNamespace(system=SimpleNamespace(ui_scale=1.0)),
            region=SimpleNamespace(width=width),
        )
        drawn = []
        for kind in panel._classes:
            if getattr(kind, "poll", None) is None or kind.poll(context):
                holder = SimpleNamespace(layout=Layout(drawn), group=getattr(kind, "group", None))
                kind.draw(holder, context)
        return drawn

    return draw_all


def test_nothing_or_no_mesh_is_selected(draw):
    assert "Select a mesh or point cloud" in draw()
    add_object("lamp", bpy.data.lights.new("lamp", "POINT"))
    assert "lamp is not a mesh" in draw()


def test_every_operation_has_its_button_and_options(draw):
    add_mesh("cube", CUBE, QUADS)
    drawn = draw()
    assert "cube" in drawn
    for operation in OPERATIONS:
        assert f"medialis.{operation.name}" in drawn
    numbers = [p for o in OPERATIONS for p in o.parameters
               if p.auto is not None or not isinstance(p.default, str)]  # fmt: skip
    hidden = [p.name for p in numbers]
    assert not set(hidden) & set(drawn)
    settings = bpy.context.scene.medialis
    for operation in OPERATIONS:
        getattr(settings, f"of_{operation.name}").unfolded = True
    unfolded = draw()
    visible = {p.name for p in numbers if not p.advanced}
    visible |= {f"use_{p.name}" for p in numbers if not p.advanced and p.auto is not None}
    assert visible <= set(unfolded) and "More" in unfolded
    assert "largest_radius" not in unfolded
    for operation in OPERATIONS:
        getattr(settings, f"of_{operation.name}").unfolded_more = True
    assert set(hidden) <= set(draw())


def test_presets_and_units(draw):
    """Three tasks come first; lengths in the scene's unit begin at the same lengths."""
    add_mesh("cube", 2 * CUBE, QUADS)
    drawn = draw()
    assert drawn[1:4] == [f"medialis.{n}" for n in ("rig", "print_check", "skeleton_study")]
    settings = bpy.context.scene.medialis
    settings.of_thickness.unfolded = True
    assert "tolerance" in draw()
    settings.lengths_in = "SCENE"
    drawn = draw()
    assert "tolerance_in_units" in drawn and "tolerance" not in drawn
    expected = 0.0003 * np.sqrt(12)
    assert settings.of_thickness.tolerance_in_units == pytest.approx(expected)


def test_live_options_replace_the_result(scene):
    """Only options of the active result, only where it is switched on; the source keeps one."""
    from blender_addon import live

    add_mesh("cube", CUBE, QUADS)
    bpy.ops.medialis.surface_skeleton()
    made = bpy.context.active_object
    count = len(made.data.attributes["radius"].data)
    settings = bpy.context.scene.medialis
    settings.of_surface_skeleton.subsample = 20.0
    assert not bpy.app.timers.is_registered(live.run)
    settings.live = True
    settings.of_thickness.spots = 3
    assert not bpy.app.timers.is_registered(live.run)
    settings.of_surface_skeleton.subsample = 10.0
    assert bpy.app.timers.is_registered(live.run)
    assert live.run() is None and live.run() is None
    bpy.app.timers.unregister(live.run)
    made = [o for o in bpy.data.objects if o.name.startswith("cube surface skeleton")]
    assert len([o for o in made if o.type == "POINTCLOUD"]) == 1
    assert len(bpy.context.active_object.data.attributes["radius"].data) < count


def test_the_redo_panel_has_all_options(scene):
    from blender_addon import operators

    for operation in OPERATIONS:
        kind = getattr(bpy.ops.medialis, operation.name).get_rna_type()
        layout = Layout()
        switches = {p.identifier: False for p in kind.properties if p.identifier.startswith("use_")}
        holder = SimpleNamespace(
            layout=layout, operation=operation, lengths_in="SIZE", bl_rna=kind, **switches
        )
        operators.OperationOperator.draw(holder, bpy.context)
        assert {p.name for p in operation.parameters} <= set(layout.drawn)


def test_the_result_has_sliders_and_a_summary(draw):
    add_mesh("cube", CUBE, QUADS)
    assert "medialis.show_colors" not in draw()
    bpy.ops.medialis.surface_skeleton()
    drawn = draw()
    assert {"Threshold", "Size", "Balls", "medialis.remove_result", "medialis.show_colors"} <= set(
        drawn
    )
    assert any(text.startswith("Surface skeleton of cube:") for text in drawn)
    assert any(text.startswith("The mesh was") for text in drawn)  # wrapped
    assert "skeleton points" not in drawn
    bpy.context.scene.medialis.unfolded_values = True
    assert "skeleton points" in draw()
    assert max(map(len, draw(width=150))) < max(map(len, draw(width=600)))
    bpy.context.view_layer.objects.active = bpy.data.objects["cube"]
    bpy.ops.medialis.thickness()
    bpy.context.view_layer.objects.active = bpy.data.objects["cube"]
    drawn = draw()
    assert any(text.startswith("Thickness of cube:") for text in drawn)
    assert "Threshold" not in drawn


def test_a_running_job_is_shown(draw, monkeypatch):
    from blender_addon import jobs

    add_mesh("cube", CUBE, QUADS)
    job = SimpleNamespace(label="Thickness of cube", fraction=0.25, text="skeleton")
    monkeypatch.setattr(jobs, "running", job)
    drawn = draw()
    assert "25 %  skeleton" in drawn and "medialis.cancel_computation" in drawn


def test_the_menu_lists_every_operation(scene):
    from blender_addon import menus

    layout = Layout()
    menus.MEDIALIS_MT_object.draw(SimpleNamespace(layout=layout), bpy.context)
    listed = [
        f"medialis.{o.name}" for group in menus.groups() for o in OPERATIONS if o.group == group
    ]
    assert [name for name in layout.drawn if name in listed] == listed


@pytest.mark.parametrize(
    "words",
    ["bones", "rig", "thin walls", "medial axis", "segment", "centerline", "denoise", "3D print"],
)
def test_search_finds_what_people_type(words, scene):
    """F3 searches the texts of menu entries."""
    from blender_addon import menus

    layout = Layout()
    menus.MEDIALIS_MT_object.draw(SimpleNamespace(layout=layout), bpy.context)
    assert any(words.lower() in text.lower() for text in layout.texts)
    for operation in OPERATIONS:
        assert f"{operation.label} ({', '.join(operation.words)})" in layout.texts


def test_the_menu_is_in_the_object_menu(scene):
    from blender_addon import menus

    layout = Layout()
    menus._entry(SimpleNamespace(layout=layout), bpy.context)
    assert layout.drawn == ["MEDIALIS_MT_object"]


def test_the_pie_menu_has_eight_slots(scene):
    from blender_addon import finding

    layout = Layout()
    finding.MEDIALIS_MT_pie.draw(SimpleNamespace(layout=layout), bpy.context)
    assert len(layout.drawn) == 8 and layout.drawn[:2] == ["medialis.rig", "medialis.print_check"]


def test_the_preferences_list_the_keys(scene):
    """As the user's keymap has them, which a window makes from that of add-ons."""
    from blender_addon import finding, preferences

    keymaps = bpy.context.window_manager.keyconfigs.addon.keymaps
    configs = SimpleNamespace(user=SimpleNamespace(keymaps=keymaps))
    context = SimpleNamespace(window_manager=SimpleNamespace(keyconfigs=configs))
    layout = Layout()
    preferences.draw_keys(layout, context)
    assert len(layout.drawn) == len(finding.KEYS) and len(set(layout.drawn)) == len(layout.drawn)
    assert any("Failed" in text for text in layout.drawn)


def test_registering_twice_in_turn_leaves_nothing(addon):
    addon.unregister()
    assert not hasattr(bpy.types.Scene, "medialis")
    assert not any(name.startswith("MEDIALIS_") for name in dir(bpy.types))
    addon.unregister()
    addon.register()
    addon.register()
    assert hasattr(bpy.types, "MEDIALIS_PT_main")


def test_showing_colors_sets_the_view(scene):
    from blender_addon import operators

    add_mesh("cube", CUBE, QUADS)
    show = operators.MEDIALIS_OT_show_colors
    shading = SimpleNamespace(type="SOLID", color_type="MATERIAL")
    space = SimpleNamespace(type="VIEW_3D", shading=shading)

    def context():
        active = bpy.context.view_layer.objects.active
        return SimpleNamespace(active_object=active, space_data=space)

    bpy.ops.medialis.surface_skeleton()
    assert show.poll(context()) and show.execute(None, context()) == {"FINISHED"}
    assert shading.type == "MATERIAL"
    bpy.context.view_layer.objects.active = bpy.data.objects["cube"]
    bpy.ops.medialis.thickness()
    bpy.context.view_layer.objects.active = bpy.data.objects["cube"]
    show.execute(None, context())
    assert (shading.type, shading.color_type) == ("SOLID", "VERTEX")
