"""Weights for armatures of the user: groups of its bones, by `medialis.bind` beside Ctrl+P."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy", reason="bpy is not installed: make hosts")
import medialis
from blender_scenes import add_armature, add_mesh, evaluated, groups_of, read_back, select
from medialis.hosts import write_armature_json

BONES = [
    ("root", (0, 0, -2), (0, 0, -1.5), None, False),
    ("lower", (0, 0, -1), (0, 0, 0), "root", True),
    ("upper", (0, 0, 0), (0, 0, 1), "lower", True),
]


@pytest.fixture
def rod(scene):
    """A rod along z, off the origin, with a group of its user, a speck, and its armature."""
    angles = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    rings = [
        [0.25 * np.cos(a), 0.25 * np.sin(a), z] for z in np.linspace(-1, 1, 21) for a in angles
    ]
    points = np.array(
        [*rings, [0, 0, -1], [0, 0, 1], [0.4, 0, 0.8], [0.41, 0, 0.8], [0.4, 0, 0.81]]
    )
    faces = []
    for ring in range(20):
        for k in range(12):
            a, b = 12 * ring + k, 12 * ring + (k + 1) % 12
            faces += [[a, b, b + 12], [a, b + 12, a + 12]]
    faces += [[(k + 1) % 12, k, 252] for k in range(12)]
    faces += [[240 + k, 240 + (k + 1) % 12, 253] for k in range(12)]
    faces += [[254, 255, 256]]
    chosen = add_mesh("rod", points, np.array(faces))
    chosen.location = (5, 0, 0)
    chosen.vertex_groups.new(name="mine").add([3, 4], 0.5, "REPLACE")
    chosen.vertex_groups.new(name="upper").add([0, 1], 1.0, "REPLACE")
    armature = add_armature("rig", BONES)
    armature.location = (5, 0, 0)
    bpy.context.view_layer.update()
    return chosen, armature


def test_an_armature_of_the_user_gets_weights_and_moves_the_mesh(rod):
    """As with Blender's own parenting: the mesh is selected, the armature is active."""
    chosen, armature = rod
    place = chosen.matrix_world.copy()
    select(chosen, armature)
    assert bpy.ops.medialis.bind() == {"FINISHED"}
    groups = groups_of(chosen)
    assert groups["mine"] == [3, 4] and set(groups) == {"mine", "lower", "upper"}
    weights = {name: np.zeros(len(chosen.data.vertices)) for name in ("lower", "upper")}
    for vertex in chosen.data.vertices:
        for entry in vertex.groups:
            name = chosen.vertex_groups[entry.group].name
            if name in weights:
                weights[name][vertex.index] = entry.weight
    total = weights["lower"] + weights["upper"]
    assert np.abs(total - 1).max() < 1e-5
    heights = read_back(chosen.data, "position")[:, 2]
    assert (weights["lower"][heights < -0.6] > 0.9).all() and weights["upper"][0] < 0.05
    assert (weights["upper"][heights > 0.6] > 0.9).all(), "the speck as well"
    assert len(set(weights["upper"][254:257])) == 1, "a speck moves as a whole"
    assert chosen.parent == armature and chosen.find_armature() == armature
    assert [m.type for m in chosen.modifiers].count("ARMATURE") == 1
    bpy.context.view_layer.update()
    assert np.allclose(np.array(chosen.matrix_world), np.array(place), atol=1e-6)
    before = read_back(chosen.data, "position").astype(float)
    armature.pose.bones["upper"].rotation_mode = "XYZ"
    armature.pose.bones["upper"].rotation_euler = (np.pi / 2, 0, 0)
    bpy.context.view_layer.update()
    shown = evaluated(chosen)
    mesh = shown.to_mesh()
    after = read_back(mesh, "position").astype(float)
    shown.to_mesh_clear()
    assert np.abs(after - before)[heights < -0.7].max() < 0.05
    assert np.abs(after - before)[heights > 0.7].max() > 0.8
    # Once more, posed as it is: read at rest, so the same, and no second modifier.
    groups = {name: values.copy() for name, values in weights.items()}
    select(chosen)
    assert bpy.ops.medialis.bind() == {"FINISHED"}
    assert [m.type for m in chosen.modifiers].count("ARMATURE") == 1
    again = [
        next(e.weight for e in v.groups if chosen.vertex_groups[e.group].name == "lower")
        for v in chosen.data.vertices
        if groups["lower"][v.index] > 0.5
    ]
    assert np.abs(np.array(again) - groups["lower"][groups["lower"] > 0.5]).max() < 1e-4


def test_removing_the_result_leaves_groups_of_the_user(rod):
    chosen, armature = rod
    select(chosen, armature)
    assert bpy.ops.medialis.bind() == {"FINISHED"}
    select(chosen)
    assert bpy.ops.medialis.remove_result(result="bind") == {"FINISHED"}
    assert {group.name for group in chosen.vertex_groups} == {"mine", "upper"}


def test_an_armature_without_bones_that_deform_is_told(rod):
    chosen, armature = rod
    for bone in armature.data.bones:
        bone.use_deform = False
    select(chosen, armature)
    with pytest.raises(RuntimeError, match="no bone that deforms"):
        bpy.ops.medialis.bind()
    assert set(groups_of(chosen)) == {"mine", "upper"} and not chosen.modifiers


def test_without_an_armature_the_bones_are_those_of_the_shape(scene):
    made = medialis.organic_shape(56)
    chosen = add_mesh("creature", made.points, made.faces)
    select(chosen)
    assert bpy.ops.medialis.bind(bind=True) == {"FINISHED"}
    armature = chosen.find_armature()
    assert armature is not None and len(armature.data.bones) > 10
    assert {bone.name for bone in armature.data.bones} >= set(groups_of(chosen))


def test_groups_of_the_user_with_names_of_bones_that_are_ours_stay(scene):
    """Also those with the names that ours get where theirs are taken."""
    made = medialis.organic_shape(56)
    names = medialis.run("armature", made).extras["bones"].names
    chosen = add_mesh("creature", made.points, made.faces)
    for name in (names[0], f"medialis {names[1]}"):
        chosen.vertex_groups.new(name=name).add([3, 4], 0.5, "REPLACE")
    select(chosen)
    assert bpy.ops.medialis.armature() == {"FINISHED"}
    groups = groups_of(chosen)
    assert groups[names[0]] == [3, 4] and groups[f"medialis {names[1]}"] == [3, 4]
    assert f"medialis {names[0]}" in groups


def test_bones_of_a_file_are_weighed_and_cannot_be_bound(rod, tmp_path):
    chosen, _ = rod
    write_armature_json(
        tmp_path / "a.json", medialis.Armature([[0, 0, -1]], [[0, 0, 1]], [-1]), None
    )
    select(chosen)
    options = {"armature": str(tmp_path / "a.json")}
    with pytest.raises(RuntimeError, match="no armature object"):
        bpy.ops.medialis.bind(bind=True, **options)
    assert set(groups_of(chosen)) == {"mine", "upper"} and not chosen.modifiers
    assert bpy.ops.medialis.bind(**options) == {"FINISHED"}
    assert set(groups_of(chosen)) == {"mine", "upper", "bone 000"}
