"""The tasks of the panel do what they are called: tried for their results."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy", reason="bpy is not installed: make hosts")
import medialis
from blender_scenes import add_mesh, add_object, counts, evaluated, read_back

CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
MM = 0.001

UNITS = {
    "metres": ("METRIC", 1.0),
    "millimetres": ("METRIC", MM),
    "inches": ("IMPERIAL", 0.0254),
    "a unit without a name": ("METRIC", 0.002),
}


def plate(thick, unit, scale=1.0):
    """A plate of 20 x 30 mm in units of so many metres, by an object of a scale."""
    size = np.array([20.0, 30.0, thick]) * MM / unit
    return add_mesh("plate", CUBE * size / scale, QUADS, scale=(scale,) * 3)


def passed(chosen):
    lines = chosen["medialis_summary"].split("\n")
    return {"passed: yes": True, "passed: no": False}[next(x for x in lines if "passed" in x)]


@pytest.mark.parametrize("scale", [1.0, 1000.0])
@pytest.mark.parametrize("units", UNITS)
def test_a_plate_of_half_a_millimetre_is_too_thin_to_print(units, scale, scene):
    """One of 2 mm is not; the objects come out the same in all units, at any scale."""
    settings = scene.unit_settings
    settings.system, settings.scale_length = UNITS[units]
    for thick, printable in ((0.5, False), (2.0, True)):
        chosen = plate(thick, settings.scale_length, scale)
        assert bpy.ops.medialis.print_check() == {"FINISHED"}
        assert passed(chosen) == printable
        lengths = [x for x in chosen["medialis_summary"].split("\n") if " units = " in x]
        assert len(lengths) == 1 and lengths[0].startswith("! minimum: ")
        check = read_back(chosen.data, "check")
        assert (check == 1).any() != printable
        assert read_back(chosen.data, "checked_thickness").min() == pytest.approx(
            thick * MM / settings.scale_length, rel=1e-3
        )


def test_without_units_walls_are_compared_with_each_other(scene, capfd):
    """And that is said: a plate is as thick as its typical wall, however thin."""
    scene.unit_settings.system = "NONE"
    chosen = plate(0.5, MM)
    assert bpy.ops.medialis.print_check() == {"FINISHED"}
    assert passed(chosen) and "No limit was given" in chosen["medialis_summary"]
    assert "The scene has no units" in capfd.readouterr().out


@pytest.mark.parametrize("lengths_in", ["SIZE", "SCENE"])
def test_a_minimum_of_the_panel_counts_more(lengths_in, scene):
    """And no other length changes with the unit in which they are given."""
    scene.unit_settings.scale_length = MM
    chosen = plate(2.0, MM)
    settings = scene.medialis
    settings.lengths_in = lengths_in
    if lengths_in == "SIZE":
        settings.of_wall_check.minimum = 100 * 3.0 / chosen.dimensions.length
    else:
        settings.of_wall_check.minimum_in_units = 3.0
    bpy.ops.medialis.print_check()
    assert not passed(chosen) and "at least 3 mm thick" in chosen["medialis_summary"]


def test_a_rig_moves_the_object_also_when_it_is_made_again(scene):
    shape = medialis.organic_shape(56)
    chosen = add_mesh("creature", shape.points, shape.faces)

    def seen():
        mesh = evaluated(chosen).to_mesh()
        points = read_back(mesh, "position").astype(float)
        evaluated(chosen).to_mesh_clear()
        return points

    before = seen()
    for _ in range(2):
        assert bpy.ops.medialis.rig() == {"FINISHED"}
        (armature,) = [o for o in bpy.data.objects if o.type == "ARMATURE"]
        assert chosen.parent == armature and np.abs(seen() - before).max() < 1e-5
        bone = armature.pose.bones[-1]
        bone.rotation_mode, bone.rotation_euler = "XYZ", (0.6, 0.0, 0.0)
        moved = np.linalg.norm(seen() - before, axis=1)
        assert moved.max() > 0.1 * bone.bone.length and (moved < 1e-5).any()


def test_one_step_of_undo_takes_a_rig_back(scene):
    shape = medialis.organic_shape(56)
    add_mesh("creature", shape.points, shape.faces)
    bpy.ops.ed.undo_push(message="before")
    before = counts()
    bpy.ops.medialis.rig("EXEC_DEFAULT", True)  # as from a button
    assert counts() != before
    bpy.ops.ed.undo()
    assert counts() == before and bpy.data.objects["creature"].parent is None


def test_a_copy_that_is_rigged_again_is_replaced(scene):
    """Modifiers leave no vertex of the object: a copy is bound; its armature stayed (fixed)."""
    shape = medialis.organic_shape(56)
    chosen = add_mesh("creature", shape.points, shape.faces)
    remesh = chosen.modifiers.new("remesh", "REMESH")
    remesh.mode, remesh.voxel_size = "VOXEL", 0.05
    for _ in range(2):
        bpy.context.view_layer.objects.active = chosen
        assert bpy.ops.medialis.rig() == {"FINISHED"}
        assert len([o for o in bpy.data.objects if o.type == "ARMATURE"]) == 1
        assert bpy.data.objects["creature skin"].parent == bpy.data.objects["creature armature"]


def test_a_rig_of_the_user_stays(scene):
    shape = medialis.organic_shape(56)
    own = add_object("own", bpy.data.armatures.new("own"))
    chosen = add_mesh("creature", shape.points, shape.faces)
    chosen.modifiers.new("mine", "ARMATURE").object = own
    with pytest.raises(RuntimeError, match="armature of its modifier mine already: remove that"):
        bpy.ops.medialis.rig()
    assert [o.name for o in bpy.data.objects if o.type == "ARMATURE"] == ["own"]


def test_a_study_has_medial_points_and_their_samples(scene):
    """Centers lie as far from both of their samples as their radius says."""
    shape = medialis.organic_shape(56)
    chosen = add_mesh("creature", shape.points, shape.faces)
    assert bpy.ops.medialis.skeleton_study() == {"FINISHED"}
    skeleton, samples = (
        bpy.data.objects[f"creature {name}"].data for name in ("surface skeleton", "samples")
    )
    centers, radii = read_back(skeleton, "position"), read_back(skeleton, "radius")
    places = read_back(samples, "position")
    longest = chosen.dimensions.length * 0.03
    for name in ("feature_1", "feature_2", "source"):
        apart = np.linalg.norm(places[read_back(skeleton, name)] - centers, axis=1)
        assert (np.abs(apart - radii) < longest).all()
