"""One click and it shows; once more replaces; removing leaves the object as it was."""

from types import SimpleNamespace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy", reason="bpy is not installed: make hosts")
import medialis
from blender_scenes import QUICK, add_mesh, counts, evaluated, read_back
from medialis.operations.registry import OPERATIONS
from medialis.show.colors import to_linear
from plates import tee

GIVEN = {"geodesic_path": {"end": 900}, **QUICK}


def with_material(name, points, faces):
    made = add_mesh(name, points, faces)
    made.data.materials.append(bpy.data.materials.new("own"))
    return made


@pytest.fixture
def creature(scene):
    shape = medialis.organic_shape(56)
    return with_material("creature", shape.points, shape.faces)


def start(name, **given):
    assert getattr(bpy.ops.medialis, name)(**GIVEN.get(name, {}), **given) == {"FINISHED"}
    return bpy.context.active_object


def materials_of(chosen):
    """Names of the materials that faces are shown with."""
    mesh = evaluated(chosen).data
    names = [slot.name if slot else None for slot in mesh.materials]
    used = np.zeros(len(mesh.polygons), np.int32)
    mesh.polygons.foreach_get("material_index", used)
    return {names[number] for number in np.unique(used)}


@pytest.mark.parametrize("chosen", OPERATIONS, ids=lambda o: o.name)
def test_one_click_shows_it_and_removing_leaves_nothing(chosen, request, scene):
    """Every operation changes how the object is shown, and its removal takes all of it back."""
    walls = chosen.sample != "creature"
    creature = with_material("tee", *tee()) if walls else request.getfixturevalue("creature")
    before, names = counts(), sorted(creature.data.attributes.keys())
    active = start(chosen.name)
    shown = materials_of(creature)
    hidden = creature.hide_render
    assert shown != {"own"} or hidden
    assert [slot.name for slot in creature.data.materials] == ["own"]
    assert not any("legend" in made.name for made in bpy.data.objects)
    for made in bpy.data.objects:
        if made.type in ("POINTCLOUD", "MESH") and made != creature:
            assert made.data.materials[0] is not None
    bpy.context.view_layer.objects.active = active
    assert bpy.ops.medialis.remove_result() == {"FINISHED"}
    assert counts() == before and sorted(creature.data.attributes.keys()) == names
    assert materials_of(creature) == {"own"} and not creature.hide_render
    assert not [key for key in creature.keys() if key.startswith("medialis")]  # noqa: SIM118
    assert bpy.context.active_object == creature


def test_thickness_is_seen_in_its_colours(creature):
    """By a material in renders, by the active colour attribute in solid views."""
    start("thickness")
    assert materials_of(creature) == {"Medialis: wall_thickness_color"}
    assert creature.data.color_attributes.active_color.name == "wall_thickness_color"
    (spots,) = [o for o in bpy.data.objects if o.type == "POINTCLOUD"]
    assert spots.data.materials[0].name.startswith("Medialis: value")
    start("thickness", legend_in_renders=True)
    numbers = bpy.data.objects["creature thin spots numbers"]
    assert numbers.parent == creature and len(numbers.data.polygons) > 20


def test_keep_my_materials(creature):
    start("thickness", keep_materials=True)
    assert materials_of(creature) == {"own"} and not creature.modifiers


def test_a_skeleton_is_seen_in_its_shape(creature):
    """See-through around it; one button gives the own look back and leaves the skeleton."""
    skeleton = start("surface_skeleton")
    assert materials_of(creature) == {"Medialis: see-through"} and creature.color[3] < 0.5
    assert bpy.ops.medialis.own_look() == {"FINISHED"}
    assert materials_of(creature) == {"own"} and creature.color[3] == 1
    assert skeleton.name in bpy.data.objects and not bpy.ops.medialis.own_look.poll()


def test_the_look_of_the_result_before_comes_back(creature):
    start("thickness")
    start("curve_skeleton")
    assert materials_of(creature) == {"Medialis: see-through"}
    bpy.ops.medialis.remove_result()
    assert materials_of(creature) == {"Medialis: wall_thickness_color"}


def test_points_are_as_large_as_the_samples_are_apart(creature):
    """Half the spacing, in every skeleton of points; fewer points are larger."""
    for name in ("surface_skeleton", "skeleton_importance", "point_types"):
        start(name)
        drawn = read_back(evaluated(bpy.context.active_object).data, "radius")[0]
        fine = medialis.surface_skeleton(medialis.organic_shape(56)).surface
        assert drawn == pytest.approx(fine.spacing / 2, rel=0.02)
    start("surface_skeleton", subsample=5.0, threshold=0.0)
    few = bpy.context.active_object
    assert read_back(evaluated(few).data, "radius")[0] > 1.5 * drawn


def test_again_replaces(creature):
    """The same objects with the same names, nodes and materials; others stay."""
    empty = counts()
    start("thickness")
    start("surface_skeleton")
    names, before = sorted(bpy.data.objects.keys()), counts()
    start("surface_skeleton")
    assert sorted(bpy.data.objects.keys()) == names and counts() == before
    start("surface_skeleton", keep_earlier=True)
    assert len(bpy.data.objects) == len(names) + 1
    assert counts()["node_groups"] == before["node_groups"]
    assert len(bpy.data.collections) == 1
    start("thickness", keep_earlier=True)
    bpy.context.view_layer.objects.active = creature
    bpy.ops.medialis.remove_result()
    bpy.ops.medialis.remove_result()
    assert counts() == empty


def test_one_collection_for_each_source(creature):
    """Also after the source was renamed."""
    start("surface_skeleton")
    creature.name = "animal"
    start("curve_skeleton")
    assert bpy.data.collections.keys() == ["Medialis: creature"]


def test_labels_get_groups_face_sets_and_materials_on_request(creature):
    start("parts")
    assert creature.vertex_groups and ".sculpt_face_set" not in creature.data.attributes
    start("parts", segments_as={"GROUPS", "FACE_SETS", "MATERIALS"})
    label = read_back(creature.data, "parts")
    first = [polygon.vertices[0] for polygon in creature.data.polygons]
    assert (read_back(creature.data, ".sculpt_face_set") == label[first] + 2).all()
    count = len(np.unique(label[label >= 0]))
    assert len(creature.vertex_groups) == count and len(creature.data.materials) > count
    start("parts", segments_as=set())
    assert not creature.vertex_groups and ".sculpt_face_set" not in creature.data.attributes
    assert [slot.name for slot in creature.data.materials] == ["own"]


def test_the_legend_has_the_limits_and_the_colours(creature):
    from blender_addon import legends

    start("thickness", legend_in_renders=True)
    sign = bpy.data.objects["creature thickness legend"]
    assert sign.hide_get() and not sign.hide_render  # views draw their own
    colors = read_back(sign.data, legends.COLOR)
    table = to_linear(medialis.hosts.color_table("sequential")[[0, -1]])
    for end in table:
        assert np.abs(colors[:, :3] - end).max(axis=1).min() < 1e-3
    scene = bpy.context.scene
    assert legends.value_text("length", 0.25, "0.25", scene) == "25 cm"
    scene.unit_settings.system = "NONE"
    assert legends.value_text("length", 0.25, "0.25", scene) == "0.25"
    assert legends.value_text("angle", 30.0, "30°", scene) == "30°"


def test_legends_face_the_view(scene):
    from blender_addon import legends
    from mathutils import Euler

    turned = Euler((0.3, 0.2, 1.0)).to_quaternion()
    view = SimpleNamespace(view_rotation=turned, view_perspective="ORTHO")
    space = SimpleNamespace(type="VIEW_3D", region_3d=view)
    found = legends.view_axes(SimpleNamespace(space_data=space, scene=scene))
    assert np.allclose(found, np.array(turned.to_matrix()))
    front = legends.view_axes(SimpleNamespace(space_data=None, scene=scene))
    assert front[:, 0].tolist() == [1, 0, 0] and front[:, 2].tolist() == [0, -1, 0]


@pytest.mark.parametrize(("kind", "mode"), [("SOLID", "SOLID"), ("RENDERED", "RENDERED")])
def test_views_are_shaded_for_the_result(kind, mode):
    from blender_addon import looks

    shading = SimpleNamespace(type=kind, color_type="MATERIAL")
    space = SimpleNamespace(shading=shading)
    area = SimpleNamespace(type="VIEW_3D", spaces=SimpleNamespace(active=space))
    context = SimpleNamespace(screen=SimpleNamespace(areas=[area]))
    looks.set_shading(context, colored_surface=True)
    assert shading.type == mode and (shading.color_type == "VERTEX") == (kind == "SOLID")
    looks.set_shading(context, colored_surface=False)
    assert shading.type == ("MATERIAL" if kind == "SOLID" else mode)


def test_curves_are_round_and_coloured(creature):
    curve = start("curve_skeleton", curves=True)
    assert curve.type == "CURVE" and curve.data.bevel_depth > 0
    assert len({spline.material_index for spline in curve.data.splines}) > 1
    tube = evaluated(curve).to_mesh()
    assert len(tube.polygons) > 0


def test_what_a_copy_hid_is_seen_again(creature):
    """The modifier that made a copy necessary is gone: the next run is on the object itself."""
    modifier = creature.modifiers.new("remesh", "REMESH")
    modifier.mode, modifier.voxel_size = "VOXEL", 0.05
    start("thickness")
    assert creature.hide_render and "creature thickness" in bpy.data.objects
    creature.modifiers.remove(modifier)
    creature.hide_set(False)
    bpy.context.view_layer.objects.active = creature
    start("thickness")
    assert not creature.hide_render and "creature thickness" not in bpy.data.objects
    assert materials_of(creature) == {"Medialis: wall_thickness_color"}
