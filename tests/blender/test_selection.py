"""What is selected is the input: vertices in edit mode, and several objects one after the other."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy", reason="bpy is not installed: make hosts")
import medialis
from blender_scenes import add_mesh, add_object, read_back


@pytest.fixture
def creature(scene):
    shape = medialis.organic_shape(56)
    return add_mesh("creature", shape.points, shape.faces)


def pick(chosen, *vertices):
    """Pick vertices in edit mode, one after the other."""
    import bmesh

    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="DESELECT")
    bpy.context.tool_settings.mesh_select_mode = (True, False, False)
    edited = bmesh.from_edit_mesh(chosen.data)
    edited.verts.ensure_lookup_table()
    for vertex in vertices:
        edited.verts[vertex].select_set(True)
        edited.select_history.add(edited.verts[vertex])
    bmesh.update_edit_mesh(chosen.data)


@pytest.mark.parametrize("with_modifier", [False, True])
def test_picked_vertices_are_the_ends_of_paths(with_modifier, creature):
    """Two paths through three vertices, in the order in which they were picked."""
    if with_modifier:
        creature.modifiers.new("smooth", "SUBSURF").levels = 1
    picked = [900, 20, 500]
    pick(creature, *picked)
    assert bpy.ops.medialis.geodesic_path() == {"FINISHED"}
    path = bpy.context.active_object.data
    points, pair = read_back(path, "position"), read_back(path, "pair")
    assert set(pair.tolist()) == {0, 1}
    ends = [points[pair == 0][[0, -1]], points[pair == 1][[0, -1]]]
    given = np.array([creature.data.vertices[v].co for v in picked])
    allowed = 0.05 if with_modifier else 1e-5  # the smoothed surface lies a little inside
    assert np.allclose(np.concatenate(ends), given[[0, 1, 1, 2]], atol=allowed)


def test_picked_vertices_are_the_ends_of_a_centerline(creature):
    """From the first to the second, whichever number is lower."""
    points = medialis.organic_shape(56).points
    picked = [int(np.argmax(points[:, 0])), int(np.argmin(points[:, 0]))]
    pick(creature, *picked)
    assert bpy.ops.medialis.centerline() == {"FINISHED"}
    line = bpy.context.active_object.data
    found, distance = read_back(line, "position"), read_back(line, "distance")
    for place, vertex in ((np.argmin(distance), 0), (np.argmax(distance), 1)):
        other = 1 - vertex
        near = np.linalg.norm(points[picked[vertex]] - found[place])
        assert near < 0.2 * np.linalg.norm(points[picked[other]] - found[place])


def test_one_vertex_is_no_path(creature):
    pick(creature, 7)
    with pytest.raises(RuntimeError, match="Select 2 to 100 vertices"):
        bpy.ops.medialis.geodesic_path()
    assert creature.mode == "EDIT"


def test_all_vertices_are_no_selection(creature):
    """Edit mode begins with everything selected: the numbers of the options count."""
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    assert bpy.ops.medialis.geodesic_path(start=3, end=800) == {"FINISHED"}


def test_picked_vertices_are_seeds(creature, monkeypatch):
    """As the core with the same seeds in a file; a file that is given counts more."""
    from blender_addon import tasks

    seen = []
    real = tasks.picked_lines
    monkeypatch.setattr(tasks, "picked_lines", lambda p, v: seen.append((p.name, list(v))) or
                        real(p, v))  # fmt: skip
    pick(creature, 40, 700)
    assert bpy.ops.medialis.mean_shift_segments() == {"FINISHED"}
    assert seen == [("add_seeds", [40, 700])]


def test_selected_objects_are_computed_one_after_the_other(creature):
    """The active one last; what cannot be computed is left out and told."""
    shape = medialis.organic_shape(64)
    second = add_mesh("second", shape.points, shape.faces)
    add_mesh("nothing", np.empty((0, 3)), [])
    add_object("lamp", bpy.data.lights.new("lamp", "POINT"))
    for made in bpy.data.objects:
        made.select_set(True)
    bpy.context.view_layer.objects.active = second
    assert bpy.ops.medialis.surface_skeleton() == {"FINISHED"}
    names = [o.name for o in bpy.data.objects if o.type == "POINTCLOUD"]
    assert names == ["creature surface skeleton", "second surface skeleton"]
    assert bpy.context.active_object.name == "second surface skeleton"
    bpy.context.view_layer.objects.active = creature  # not selected: it alone
    assert bpy.ops.medialis.thickness() == {"FINISHED"}
    assert "thickness" in creature.data.attributes and "thickness" not in second.data.attributes


def test_only_failures_are_an_error(scene):
    for name in ("one", "two"):
        add_mesh(name, np.empty((0, 3)), [])
    bpy.data.objects["one"].select_set(True)
    with pytest.raises(RuntimeError, match=r"(?s)one has no vertices.*two has no vertices"):
        bpy.ops.medialis.thickness()


def test_instances_are_a_sentence(creature):
    """Nodes that give no mesh: the sentence says which nodes help."""
    group = bpy.data.node_groups.new("instances", "GeometryNodeTree")
    group.is_modifier = True
    for way in ("INPUT", "OUTPUT"):
        group.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    given, output = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
    made = group.nodes.new("GeometryNodeGeometryToInstance")
    group.links.new(given.outputs[0], made.inputs[0])
    group.links.new(made.outputs[0], output.inputs[0])
    creature.modifiers.new("nodes", "NODES").node_group = group
    with pytest.raises(RuntimeError, match="Add Realize Instances"):
        bpy.ops.medialis.thickness()
