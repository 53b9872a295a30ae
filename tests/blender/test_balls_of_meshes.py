"""Meshes drawn as balls, cones and slabs: as the core has them, also when edited; their levels."""

import json

import numpy as np
import pytest

bpy = pytest.importorskip("bpy", reason="bpy is not installed: make hosts")
import medialis
from blender_scenes import add_mesh, evaluated, read_back
from medialis import Layer, Result
from medialis.medial_meshes.distances import boundary_points
from medialis.medial_meshes.envelope import Envelope

CENTERS = np.array([[0, 0, 0], [3, 0, 0], [0, 2.5, 0.5], [5, 1, 1.0], [5, 1, 1.4]])
RADII = np.array([0.5, 0.3, 0.7, 0.1, 0.6])
EDGES = np.array([[1, 3], [3, 4]], np.int32)  # the last ball holds the one before it
FACES = np.array([[0, 1, 2]], np.int32)
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)


def envelope(centers, radii):
    rows = np.column_stack([centers, radii])
    return Envelope.of(medialis.MedialMesh.of_rows(rows, EDGES, FACES).complex)


def drawn(made):
    """Points and triangles as Blender shows the object."""
    mesh = evaluated(made).to_mesh()
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    mesh.calc_loop_triangles()
    faces = np.empty(3 * len(mesh.loop_triangles), np.int32)
    mesh.loop_triangles.foreach_get("vertices", faces)
    return points.reshape(-1, 3).astype(float), faces.reshape(-1, 3)


def check(made, centers, radii):
    """What is drawn lies in the envelope, and the envelope lies near what is drawn."""
    from medialis.base.box_tree import NearestTree

    points, faces = drawn(made)
    wanted = envelope(centers, radii)
    # Single precision of lengths up to 6, through some twenty steps.
    assert wanted.distances(points)[0].max() < 20 * 6 * 2.0**-23
    boundary, _ = boundary_points(wanted)
    tree = NearestTree.of_triangles(points, faces)
    # An icosahedron split twice has sides of 18.7 degrees at most, so its faces lie up to
    # 1 - cos(18.7 degrees / sqrt(3)) of the radius beneath the ball; cones are rounder.
    assert tree.distances(boundary)[0].max() < 0.018 * radii.max()


@pytest.fixture
def balls(scene):
    """A medial mesh as a result on a cube."""
    from blender_addon import reading, writing

    cube = add_mesh("cube", CUBE, QUADS)
    layer = Layer(
        "balls", CENTERS, FACES, EDGES, attributes={"radius": RADII}, role="balls",
        color_by="radius", filter_by="radius",
    )  # fmt: skip
    source = reading.read_object(bpy.context, cube)
    shape = medialis.make_shape(source.points, source.faces, repair=True)
    result = Result(shape=shape, layers=(layer,), operation="smooth", seconds={"total": 1.0})
    (made,) = writing.add_result(bpy.context, source, shape, result, writing.Options())
    return made


def test_balls_cones_and_slabs_are_those_of_the_core(balls):
    check(balls, CENTERS, RADII)
    shown = read_back(evaluated(balls).data, "medial_radius")
    assert shown.min() == np.float32(RADII.min()) and shown.max() == np.float32(RADII.max())
    material = balls.data.materials[0]
    assert material.name in [one.name for one in evaluated(balls).data.materials if one]
    node = next(n for n in material.node_tree.nodes if n.type == "ATTRIBUTE")
    assert node.attribute_name == "medial_radius"


def test_they_follow_edits(balls):
    centers, radii = CENTERS.copy(), RADII.copy()
    centers[2] += (0.5, 1.0, -1.0)
    radii[0] = 1.25
    balls.data.vertices[2].co = centers[2]
    assert balls.data.attributes.active.name == "radius"  # what Set Attribute changes
    balls.data.attributes["radius"].data[0].value = radii[0]
    balls.data.update()
    check(balls, centers, radii)


def test_without_balls_there_are_faces_and_edges(balls):
    from blender_addon import filtering

    filtering.set_input(balls, "Balls", False)
    points, _ = drawn(balls)
    apart = np.linalg.norm(points[:, None] - CENTERS, axis=2)
    assert apart.min(axis=0).max() < 1e-6
    edges = len(points) - len(CENTERS)
    assert edges == 3 * 8  # the tube along the edges of no face


@pytest.fixture(scope="module")
def creature():
    return medialis.organic_shape(56)


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """Where the scene of `mesh` is, once it was made."""
    return tmp_path_factory.mktemp("mesh") / "mesh.blend"


@pytest.fixture
def mesh(scene, creature, file):
    """The medial mesh of a shape that is moved and scaled."""
    if file.is_file():
        bpy.ops.wm.open_mainfile(filepath=str(file))
        return bpy.context.active_object
    add_mesh("creature", creature.points, creature.faces, location=(3, 2, 1), scale=(2, 2, 2))
    bpy.context.view_layer.update()
    options = {"balls": 24, "quality": "fast", "cell": 3.0}
    assert bpy.ops.medialis.medial_mesh(**options, cover=True) == {"FINISHED"}
    bpy.ops.wm.save_as_mainfile(filepath=str(file), copy=True)
    return bpy.context.active_object


def test_levels_are_shown_without_computing(mesh, creature, tmp_path):
    from blender_addon import levels

    single = creature.points.astype(np.float32).astype(float)  # as Blender holds them
    twice = medialis.make_shape(2 * single, creature.faces)
    own = medialis.medial_mesh(twice, balls=24, quality="fast")
    for count in (6, 24, 100):
        mesh.medialis_level = count
        level = own.level(count)
        assert mesh.medialis_level == len(level) == len(mesh.data.vertices)
        apart = read_back(mesh.data, "position") - level.centers
        assert np.abs(apart).max() < 1e-5
        assert len(mesh.data.polygons) == len(level.faces)
        assert len(mesh.data.edges) == len(level.edges)
        if len(level.faces):
            assert set(read_back(mesh.data, "sheet")) == set(level.sheets.of_faces)
    mesh.medialis_level = 1_000_000_000
    assert len(mesh.data.vertices) == own.most
    name = mesh.name
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "levels.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "levels.blend"))
    again = bpy.data.objects[name]
    assert levels.has(again)
    again.medialis_level = 6
    assert len(again.data.vertices) == 6


def test_in_edit_mode_the_level_stays(mesh):
    bpy.ops.object.mode_set(mode="EDIT")
    mesh.medialis_level = 6
    bpy.ops.object.mode_set(mode="OBJECT")
    assert len(mesh.data.vertices) == 24
    other = add_mesh("other", CUBE, QUADS)
    other.medialis_level = 3  # has none: nothing happens
    assert len(other.data.vertices) == 8


def test_an_edited_result_is_rebuilt(mesh):
    """Moved by (0, 0, 1) in its object of scale 1, and the object enlarged by a half."""
    first = read_back(mesh.data, "position").astype(float)
    radii = read_back(mesh.data, "radius").astype(float)
    faces, edges = len(mesh.data.polygons), len(mesh.data.edges)
    mesh.data.vertices[3].co.z += 1.0
    first[3, 2] += 1.0
    mesh.scale = (1.5, 1.5, 1.5)
    assert bpy.ops.medialis.rebuild.poll()
    assert bpy.ops.medialis.rebuild() == {"FINISHED"}
    made = bpy.context.active_object
    assert np.abs(read_back(made.data, "position") - 1.5 * first).max() < 1e-5
    assert np.abs(read_back(made.data, "radius") - 1.5 * radii).max() < 1e-6
    assert (len(made.data.polygons), len(made.data.edges)) == (faces, edges)
    assert "medialis_levels" not in made
    surface = bpy.data.objects["creature medial mesh envelope"]
    assert not surface.hide_get() and not surface.hide_render
    points = read_back(surface.data, "position").astype(float)
    top = 1.5 * (first[:, 2] + radii).max()
    assert abs(points[:, 2].max() - top) < 0.01 * np.linalg.norm(np.ptp(points, axis=0))
    settings = bpy.context.scene.medialis.of_medial_mesh
    assert settings.edited == ""  # the next run computes


def test_a_result_without_radius_is_not_rebuilt(mesh):
    mesh.data.attributes.remove(mesh.data.attributes["radius"])
    with pytest.raises(RuntimeError, match="no attribute radius"):
        bpy.ops.medialis.rebuild()


def test_only_results_that_are_taken_back_are_rebuilt(mesh):
    envelope = bpy.data.objects["creature medial mesh envelope"]
    envelope.hide_set(False)
    bpy.context.view_layer.objects.active = envelope
    assert not bpy.ops.medialis.rebuild.poll()
    bpy.context.view_layer.objects.active = bpy.data.objects["creature"]
    assert not bpy.ops.medialis.rebuild.poll() and not bpy.ops.medialis.export_layer.poll()


def test_results_are_exported_where_they_are_in_the_world(mesh, tmp_path):
    bpy.context.scene.unit_settings.scale_length = 0.001  # millimetres
    written = {}
    for layer, ending in (("mesh", "ma"), ("mesh envelope", "glb"), ("mesh envelope", "obj")):
        made = bpy.data.objects[f"creature medial {layer}"]
        made.hide_set(False)
        bpy.context.view_layer.objects.active = made
        path = tmp_path / f"out.{ending}"
        assert bpy.ops.medialis.export_layer(filepath=str(path), format=ending) == {"FINISHED"}
        written[ending] = path
    found = medialis.read_ma(written["ma"])
    expected = read_back(mesh.data, "position") + np.array([3.0, 2, 1])
    assert np.abs(found.centers - expected).max() < 1e-6
    assert np.array_equal(found.radii.astype(np.float32), read_back(mesh.data, "radius"))
    surface = bpy.data.objects["creature medial mesh envelope"]
    shape = medialis.read_shape(written["obj"])
    assert shape.point_count == len(surface.data.vertices) and shape.diagnosis.closed
    balls = bpy.data.objects["creature ball cover"]
    balls.hide_set(False)
    bpy.context.view_layer.objects.active = balls
    path = tmp_path / "robot.json"
    assert bpy.ops.medialis.export_layer(filepath=str(path), format="json") == {"FINISHED"}
    spheres = json.loads(path.read_text())["spheres"]
    radii = 0.001 * read_back(balls.data, "radius")
    assert np.allclose([one["radius"] for one in spheres], radii, rtol=1e-6)


def test_the_panel_offers_what_can_be_done(mesh):
    from blender_addon import editing, levels, panel

    drawn = []

    class Layout:
        operator_context = ""

        def prop(self, owner, name):
            drawn.append(name)

        def operator(self, name, icon):
            drawn.append(name)

    panel.draw_editing(Layout(), mesh)
    assert drawn == ["medialis_level", "medialis.rebuild", "medialis.export_layer"]
    drawn.clear()
    panel.draw_editing(Layout(), mesh.parent)
    assert drawn == [] and not levels.has(mesh.parent) and editing.option_of(None) is None
