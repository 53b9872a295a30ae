"""What is the user's stays theirs: names, data, copies and edits, whatever medialis does."""

import numpy as np
import pytest

import medialis
import plates
from blender_scenes import QUICK, add_mesh, add_object, bpy, counts, groups_of, read_back
from medialis import OPERATIONS

KINDS = (
    "objects meshes pointclouds materials node_groups collections armatures images curves actions"
)
GIVEN = {"geodesic_path": {"end": 900}}
SKIPPED = {
    *("rna_type", "users", "tag", "session_uid", "original", "preview", "name_full", "id_data"),
    *("is_evaluated", "is_library_indirect", "is_missing", "is_runtime_data", "bound_box"),
    *("vertices", "edges", "loops", "polygons", "loop_triangles", "loop_triangle_polygons"),
    *("vertex_normals", "polygon_normals", "corner_normals", "attributes", "points", "pixels"),
    *("uv_layers", "vertex_colors", "sculpt_vertex_colors", "pose", "matrix_world", "dimensions"),
    *("active_material", "active_material_index", "has_data", "bindcode", "is_embedded_data"),
    *("all_objects", "children_recursive", "objects_recursive", "execution_time", "is_updated"),
    *("animation_visualization", "edge_creases", "color_tag", "is_active", "show_expanded"),
}
"""Not kept in the file, or looked at otherwise."""
RUNS = [one for one in OPERATIONS if one.name != "midsurface"]  # which needs a plate
SOME = [one for one in OPERATIONS if one.name in ("thickness", "parts", "armature", "patches")]


def snapshot():
    """All that the file keeps of each datablock."""
    found = {}
    bpy.context.view_layer.update()
    for kind in KINDS.split():
        for one in getattr(bpy.data, kind, ()):
            found[kind, one.name_full] = dump(one, 3) | own_values(one)
    return found


def own_values(one):
    """Custom properties, attributes with their values, weights."""
    custom = {key: one[key] for key in one.keys()}  # noqa: SIM118
    groups = {key: value.to_dict() for key, value in custom.items() if hasattr(value, "to_dict")}
    found = {"custom": {key: str(value) for key, value in (custom | groups).items()}}
    for attribute in getattr(one, "attributes", ()):
        if attribute.name.startswith(".") and "sculpt" not in attribute.name:
            continue  # of selections
        kind = attribute.domain, attribute.data_type
        found["attribute", attribute.name] = (*kind, read_back(one, attribute.name).tobytes())
    if isinstance(one, bpy.types.Object) and one.type == "MESH":
        found["groups"] = groups_of(one)
        found["hidden"] = one.name in bpy.context.view_layer.objects and one.hide_get()
    return found


def dump(struct, depth):
    found = {}
    try:
        properties = list(struct.bl_rna.properties)
    except SystemError:  # of Blender 5.2, for some pointers
        return found
    for prop in properties:
        name = prop.identifier
        if name in SKIPPED or depth == 0:
            continue
        value = getattr(struct, name)
        if prop.type == "POINTER":
            if isinstance(value, bpy.types.ID):
                found[name] = value.name_full
            elif value is not None:
                found[name] = dump(value, depth - 1)
        elif prop.type == "COLLECTION":
            found[name] = [
                one.name_full if isinstance(one, bpy.types.ID) else dump(one, depth - 1)
                for one in value
            ]
        else:
            found[name] = np.array(value).tolist() if getattr(prop, "is_array", False) else value
    return found


def differences(before, after):
    """Return what differs, by datablock."""
    found = [f"{key} is gone" for key in before.keys() - after.keys()]
    found += [f"{key} is left" for key in after.keys() - before.keys()]
    for key in before.keys() & after.keys():
        ours, theirs = before[key], after[key]
        for name in ours.keys() | theirs.keys():
            old, new = ours.get(name), theirs.get(name)
            if old != new:
                found.append(f"{key} {name}: {str(old)[:200]} -> {str(new)[:200]}")
    return found


def run_all(chosen, operations, times=2):
    for _ in range(times):
        for operation in operations:
            activate(chosen)
            call = getattr(bpy.ops.medialis, operation.name)
            given = {**GIVEN.get(operation.name, {}), **QUICK.get(operation.name, {})}
            assert call(**given) == {"FINISHED"}


def activate(chosen):
    bpy.context.view_layer.objects.active = chosen
    for other in bpy.context.view_layer.objects:
        other.select_set(other == chosen)


def remove_all(chosen):
    from blender_addon import removing

    while removing.records_of(chosen):
        activate(chosen)
        assert bpy.ops.medialis.remove_result() == {"FINISHED"}


def names_used(chosen):
    """Names of all that is in the file now, by kind."""
    found = {kind: [one.name for one in getattr(bpy.data, kind, ())] for kind in KINDS.split()}
    found["attributes"] = [
        (one.name, one.domain) for one in chosen.data.attributes if not one.name.startswith(".")
    ]
    found["groups"] = [one.name for one in chosen.vertex_groups]
    found["modifiers"] = [one.name for one in chosen.modifiers]
    return found


def creature():
    shape = medialis.organic_shape(56)
    made = add_mesh("creature", shape.points, shape.faces)
    material = bpy.data.materials.new("own")
    made.data.materials.append(material)
    colors = made.data.color_attributes.new("painted", "FLOAT_COLOR", "POINT")
    made.data.color_attributes.active_color = colors
    return made


def fill(chosen, names):
    """Give the file data of the user under all these names."""
    for kind in ("materials", "collections", "armatures", "actions", "meshes"):
        for name in names[kind]:
            if name not in getattr(bpy.data, kind):
                made = getattr(bpy.data, kind).new(name)
                made.use_fake_user = kind != "collections"
                if kind == "collections":
                    bpy.context.scene.collection.children.link(made)
                    made.objects.link(bpy.data.objects.new(f"in {name}", None))
    for name in names["node_groups"]:
        if name not in bpy.data.node_groups:
            bpy.data.node_groups.new(name, "GeometryNodeTree").use_fake_user = True
    for name in names["images"]:
        bpy.data.images.new(name, 4, 4).use_fake_user = True
    for name in names["objects"]:
        if name not in bpy.data.objects:
            bpy.context.scene.collection.objects.link(bpy.data.objects.new(name, None))
    random = np.random.default_rng(0)
    for name, domain in names["attributes"]:
        if name not in chosen.data.attributes:
            made = chosen.data.attributes.new(name, "FLOAT", domain)
            made.data.foreach_set("value", random.random(len(made.data), np.float32))
    for name in names["groups"]:
        chosen.vertex_groups.new(name=name).add([0, 1, 5], 0.5, "REPLACE")
    for name in (*names["modifiers"], "Medialis", "Medialis look", "Medialis armature"):
        chosen.modifiers.new(name, "DISPLACE").strength = 0.0
    bpy.context.view_layer.update()


@pytest.fixture(scope="module")
def taken(addon):
    """Names of all kinds that medialis uses, of all operations at once."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    chosen = creature()
    run_all(chosen, RUNS, times=1)
    return names_used(chosen)


def test_a_file_full_of_our_names_is_as_it_was(scene, taken):
    """Every operation twice at its defaults, then all results removed."""
    chosen = creature()
    fill(chosen, taken)
    before = snapshot()
    run_all(chosen, RUNS)
    remove_all(chosen)
    assert not differences(before, snapshot())


def test_also_after_saving_and_loading(scene, taken, tmp_path):
    chosen = creature()
    fill(chosen, taken)
    for one in bpy.data.collections:
        one.use_fake_user = True
    before = snapshot()
    run_all(chosen, SOME)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "middle.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "middle.blend"))
    chosen = bpy.data.objects["creature"]
    run_all(chosen, SOME, times=1)
    remove_all(chosen)
    assert not differences(before, snapshot())


def test_two_objects_with_one_mesh(scene):
    first = creature()
    second = add_object("second", first.data, location=(3, 0, 0))
    before = snapshot()
    run_all(first, SOME, times=1)
    run_all(second, SOME)
    remove_all(first)
    values = read_back(first.data, "thickness.001")
    assert np.isfinite(values).all()  # of the second: it is there as long as its result
    remove_all(second)
    assert not differences(before, snapshot())


def test_slots_and_face_sets_come_back(scene):
    """Also those of a mesh that has face sets of its own, which stay."""
    for own_sets in (False, True):
        chosen = creature()
        chosen.data.materials.append(bpy.data.materials.new("second"))
        chosen.data.polygons.foreach_set("material_index", np.arange(len(chosen.data.polygons)) % 2)
        if own_sets:
            sets = chosen.data.attributes.new(".sculpt_face_set", "INT", "FACE")
            sets.data.foreach_set("value", np.arange(len(sets.data), dtype=np.int32))
        before = snapshot()
        for _ in range(2):
            activate(chosen)
            assert bpy.ops.medialis.parts(segments_as={"FACE_SETS", "MATERIALS"}) == {"FINISHED"}
        assert ("has face sets of its own" in chosen["medialis_summary"]) == own_sets
        assert len(chosen.data.materials) > 5
        remove_all(chosen)
        assert not differences(before, snapshot())
        bpy.data.objects.remove(chosen)


def test_a_linked_duplicate_keeps_what_it_shows(scene):
    first = creature()
    run_all(first, SOME[:1], times=1)
    copy = first.copy()
    scene.collection.objects.link(copy)
    remove_all(copy)
    assert "thickness" in first.data.attributes
    remove_all(first)
    assert "thickness" not in first.data.attributes


def test_what_was_edited_stays_and_is_told(scene):
    from blender_addon import removing

    chosen = creature()
    assert bpy.ops.medialis.parts() == {"FINISHED"}
    values = read_back(chosen.data, "parts")
    values[3] += 1
    chosen.data.attributes["parts"].data.foreach_set("value", values)
    group = chosen.vertex_groups[0]
    group.add([0], 0.25, "REPLACE")
    activate(chosen)
    assert bpy.ops.medialis.parts() == {"FINISHED"}
    assert (read_back(chosen.data, "parts") == values).all()
    assert "parts.001" in chosen.data.attributes and "edited" in chosen["medialis_summary"]
    told = removing.remove_result(bpy.context, chosen, "parts")
    assert "parts" in chosen.data.attributes and "parts.001" not in chosen.data.attributes
    assert [one.name for one in chosen.vertex_groups] == [group.name] and not told


def test_new_vertices_do_not_make_results_the_users(scene):
    chosen = creature()
    bpy.ops.medialis.thickness()
    chosen.data.vertices.add(3)
    chosen.data.update()
    activate(chosen)
    assert bpy.ops.medialis.thickness() == {"FINISHED"}
    names = [one.name for one in chosen.data.attributes]
    assert "thickness" in names and "thickness.001" not in names


def test_objects_that_were_edited_or_copied_stay(scene):
    chosen = creature()
    bpy.ops.medialis.curve_skeleton()
    made = bpy.context.active_object
    copy = made.copy()
    scene.collection.objects.link(copy)
    activate(chosen)
    bpy.ops.medialis.curve_skeleton()
    assert copy.name in bpy.data.objects  # a copy is the user's
    made = next(one for one in bpy.data.objects if one.name == "creature curve skeleton")
    made.data.vertices[0].co.x += 1.0
    activate(chosen)
    bpy.ops.medialis.curve_skeleton()
    assert "edited" in bpy.context.active_object["medialis_summary"]
    remove_all(chosen)
    assert {one.name for one in bpy.data.objects} == {chosen.name, copy.name, made.name}
    assert "medialis_result" not in made


def test_results_that_were_renamed_are_still_replaced(scene):
    chosen = creature()
    bpy.ops.medialis.curve_skeleton()
    before = counts()
    bpy.context.active_object.name = "line"
    activate(chosen)
    bpy.ops.medialis.curve_skeleton()
    assert counts() == before


def linked_creature(folder):
    """The creature from a library, in a new file."""
    creature()
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "library.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with bpy.data.libraries.load(str(folder / "library.blend"), link=True) as (_, into):
        into.objects = ["creature"]
    return bpy.data.objects["creature"]


def test_a_linked_object_is_refused_and_its_copy_is_ours_to_add_to(scene, tmp_path):
    linked = linked_creature(tmp_path)
    local = bpy.data.objects.new("local", linked.data)
    bpy.context.scene.collection.objects.link(local)
    before = snapshot()
    run_all(local, SOME)
    remove_all(local)
    assert not differences(before, snapshot())


def test_an_override_of_a_library_is_ours_to_add_to(scene, tmp_path):
    """The override keeps what the user has set in it; the mesh of the library stays as it is."""
    made = linked_creature(tmp_path).override_create()
    bpy.context.scene.collection.objects.link(made)
    made.location.x = 2.0
    made["own"] = 5
    before = snapshot()
    run_all(made, SOME)
    remove_all(made)
    assert not differences(before, snapshot())
    assert made.location.x == 2.0 and made["own"] == 5


def test_what_was_appended_is_replaced_as_any_other(scene, taken, tmp_path):
    """A source that came with its results from another file, into a file full of our names."""
    source = creature()
    run_all(source, SOME, times=1)
    names, source_name = [one.name for one in bpy.data.objects], source.name
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "from.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    other = creature()
    fill(other, taken)
    before = snapshot()
    with bpy.data.libraries.load(str(tmp_path / "from.blend"), link=False) as (_, into):
        into.objects = list(names)
    appended = into.objects[names.index(source_name)]
    for one in into.objects:
        bpy.context.scene.collection.objects.link(one)
    run_all(appended, SOME)
    remove_all(appended)
    assert appended.name in bpy.data.objects and not appended.vertex_groups
    after = snapshot()
    assert not differences(before, {key: after[key] for key in before})
    # Blender has called what came as it calls copies: it cannot be told from one, and stays.
    came = {one.name for one in bpy.data.objects} - {key[1] for key in before}
    assert all(one.endswith(".001") for one in came)


def test_data_of_other_add_ons(scene):
    """Custom properties, animation and drivers of any name, on the object, its mesh and scene."""
    chosen = creature()
    for one in (chosen, chosen.data, scene, scene.collection):
        one["medialis_thickness"] = 3.0
        one["thickness"] = {"a": [1, 2], "b": "text"}
    chosen.keyframe_insert("location", frame=1)
    chosen.data.attributes.new("other add-on", "FLOAT2", "CORNER")
    before = snapshot()
    run_all(chosen, SOME)
    remove_all(chosen)
    assert not differences(before, snapshot())


def test_a_result_with_an_action_is_the_users(scene):
    chosen = creature()
    assert bpy.ops.medialis.curve_skeleton() == {"FINISHED"}
    made = bpy.context.active_object
    made.keyframe_insert("location", frame=1)
    activate(chosen)
    assert bpy.ops.medialis.curve_skeleton() == {"FINISHED"}
    assert "edited" in bpy.context.active_object["medialis_summary"]
    remove_all(chosen)
    assert made.name in bpy.data.objects and made.animation_data.action is not None


def test_a_midsurface_leaves_nothing(scene):
    chosen = add_mesh("plate", *plates.boxes((0.0, 4.0, 0.0, 3.0, 0.0, 0.2)))
    before = snapshot()
    run_all(chosen, [one for one in OPERATIONS if one.name == "midsurface"])
    remove_all(chosen)
    assert not differences(before, snapshot())


def test_a_material_that_was_edited_stays_and_is_told(scene):
    from blender_addon import removing

    chosen = creature()
    assert bpy.ops.medialis.thickness() == {"FINISHED"}
    material = next(one for one in bpy.data.materials if "wall_thickness_color" in one.name)
    shader = next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    shader.inputs["Roughness"].default_value = 0.125
    told = removing.remove_result(bpy.context, chosen, "thickness")
    assert material.name in bpy.data.materials and any(material.name in one for one in told)
    assert bpy.ops.medialis.thickness() == {"FINISHED"}
    new = [one for one in bpy.data.materials if "wall_thickness_color" in one.name]
    assert len(new) == 2  # the user's is not taken for ours


def test_an_own_modifier_with_our_look_is_the_users(scene):
    chosen = creature()
    assert bpy.ops.medialis.thickness() == {"FINISHED"}
    look = chosen.modifiers[-1].node_group
    own = add_object("own", bpy.data.meshes["creature"].copy())
    own.modifiers.new("mine", "NODES").node_group = look
    activate(own)
    assert bpy.ops.medialis.thickness() == {"FINISHED"}
    assert len(own.modifiers) == 2
    remove_all(own)
    assert [one.name for one in own.modifiers] == ["mine"]
