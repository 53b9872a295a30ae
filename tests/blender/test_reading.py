"""Reading Blender objects: transforms, modifiers, edit mode, curves and texts, polygons."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy", reason="bpy is not installed: make hosts")
import medialis
from blender_scenes import add_mesh, add_object
from medialis.operations.registry import operation

CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


@pytest.fixture
def read(scene):
    from blender_addon import reading

    def read_object(chosen):
        return reading.read_object(bpy.context, chosen)

    return read_object


def volume(source):
    a, b, c = source.points[source.faces].transpose(1, 0, 2)
    return float((np.cross(a, b) * c).sum() / 6)


@pytest.mark.parametrize("scale", [(1, 1, 1), (2, 3, 0.5), (-1, 1, 1), (-2, -1, -1)])
def test_world_axes_and_size_with_the_outside_outside(read, scale):
    """Mirrored objects turned inside out would have their skeleton outside."""
    place = {"location": (100, 0, -7), "rotation_euler": (0.3, 0.2, 1.1), "scale": scale}
    cube = add_mesh("cube", CUBE, QUADS, **place)
    source = read(cube)
    matrix = np.array(cube.matrix_world)
    expected = CUBE @ matrix[:3, :3].T
    assert np.allclose(source.points, expected, rtol=0, atol=1e-6)
    assert volume(source) == pytest.approx(abs(np.prod(scale)), rel=1e-5)


def test_polygons_become_triangles_that_know_them(read):
    # A pentagon with a notch: a fan of triangles from its first corner would leave it.
    notch = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (1, 0.5, 0), (0, 2, 0), (3, 0, 0), (3, 1, 0)]
    source = read(add_mesh("notch", notch, [(1, 5, 6), (0, 1, 2, 3, 4)]))
    assert source.polygons.tolist() == [0, 1, 1, 1] and source.polygon_count == 2
    a, b, c = source.points[source.faces].transpose(1, 0, 2)
    areas = np.cross(b - a, c - a)[:, 2] / 2
    assert (areas > 0).all() and areas[1:].sum() == pytest.approx(4 - 1.5)
    assert read(add_mesh("cube", CUBE, QUADS)).polygons.tolist() == np.repeat(range(6), 2).tolist()
    assert read(add_mesh("one", CUBE[:3], [(0, 1, 2)])).polygons is None


def test_modifiers_are_applied_and_known(read):
    cube = add_mesh("cube", CUBE, QUADS)
    assert read(cube).on_data
    array = cube.modifiers.new("array", "ARRAY")
    array.count = 3
    array.use_relative_offset, array.use_constant_offset = False, True
    array.constant_offset_displace = (5, 0, 0)
    source = read(cube)
    assert len(source.points) == 24 and source.points[:, 0].max() == pytest.approx(11)
    assert not source.on_data
    cube.modifiers.remove(array)
    cube.modifiers.new("cast", "CAST").factor = 0.5  # moves vertices only
    moved = read(cube)
    assert moved.on_data and not np.allclose(moved.points, CUBE)


def test_edits_that_are_not_flushed_yet_are_seen(read):
    import bmesh

    cube = add_mesh("cube", CUBE, QUADS)
    bpy.ops.object.mode_set(mode="EDIT")
    edited = bmesh.from_edit_mesh(cube.data)
    bmesh.ops.translate(edited, verts=edited.verts, vec=(10, 0, 0))
    bmesh.ops.delete(edited, geom=[next(iter(edited.faces))], context="FACES_ONLY")
    source = read(cube)
    assert source.points[:, 0].min() == pytest.approx(10) and len(source.faces) == 10
    assert cube.mode == "EDIT"
    bpy.ops.object.mode_set(mode="OBJECT")


def text():
    curve = bpy.data.curves.new("text", "FONT")
    curve.body, curve.extrude = "A", 0.1
    return curve


def circle():
    curve = bpy.data.curves.new("circle", "CURVE")
    curve.dimensions, curve.bevel_depth = "3D", 0.1
    spline = curve.splines.new("POLY")
    spline.points.add(3)
    for point, place in zip(spline.points, [(0, 0), (1, 0), (1, 1), (0, 1)], strict=True):
        point.co = (*place, 0, 1)
    spline.use_cyclic_u = True
    return curve


@pytest.mark.parametrize("make", [text, circle])
def test_curves_and_texts_are_read_as_meshes(read, make):
    source = read(add_object("object", make()))
    assert len(source.faces) > 10 and not source.on_data
    assert volume(source) > 0


@pytest.mark.parametrize(
    "add", ["surface.primitive_nurbs_surface_sphere_add", "object.metaball_add"]
)
def test_surfaces_and_metaballs_are_read_as_meshes(read, add):
    module, name = add.split(".")
    getattr(getattr(bpy.ops, module), name)()
    source = read(bpy.context.active_object)
    assert len(source.faces) > 10 and volume(source) > 0


def test_point_clouds_and_meshes_without_faces_are_clouds(read, scene):
    from blender_addon import point_clouds
    from blender_addon.changes import Changes

    points = np.random.default_rng(0).normal(size=(50, 3)).astype(np.float32)
    with Changes() as changes:
        cloud = point_clouds.new_point_cloud("cloud", points, scene, changes)
    cloud.location = (9, 9, 9)
    for source in (read(cloud), read(add_mesh("points", points, []))):
        assert source.faces is None and source.on_data
        assert (source.points == points.astype(float)).all()


@pytest.mark.parametrize("scale", [(0, 0, 0), (1, 1, 0)])
def test_an_object_without_extent_is_refused(read, scale):
    with pytest.raises(medialis.InvalidShapeError, match="needs a size in every direction"):
        read(add_mesh("cube", CUBE, QUADS, scale=scale))


def test_empty_meshes_are_refused(read):
    with pytest.raises(medialis.InvalidShapeError, match="empty has no vertices"):
        read(add_mesh("empty", np.empty((0, 3)), []))


def test_linked_objects_are_refused_and_objects_with_linked_meshes_are_not(read, tmp_path):
    cube = add_mesh("cube", CUBE, QUADS)
    bpy.data.libraries.write(str(tmp_path / "lib.blend"), {cube})
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with bpy.data.libraries.load(str(tmp_path / "lib.blend"), link=True) as (_, into):
        into.objects = ["cube"]
    linked = into.objects[0]
    bpy.context.scene.collection.objects.link(linked)
    with pytest.raises(medialis.InvalidShapeError, match=r"linked from lib\.blend.*make it local"):
        read(linked)
    own = add_object("own", linked.data)
    assert len(read(own).faces) == 12 and not read(own).on_data


def test_why_a_button_is_grey(scene):
    from blender_addon import reading

    skeleton, path = operation("surface_skeleton"), operation("geodesic_path")
    assert "no active object" in reading.why_not(bpy.context, skeleton)
    add_object("lamp", bpy.data.lights.new("lamp", "POINT"))
    assert "lamp is of type light" in reading.why_not(bpy.context, skeleton)
    empty = add_object("instance", None)
    empty.instance_type = "COLLECTION"
    assert "instance is of type empty" in reading.why_not(bpy.context, skeleton)
    add_object("cloud", bpy.data.pointclouds.new("cloud"))
    assert reading.why_not(bpy.context, skeleton) is None
    assert "needs a surface with faces" in reading.why_not(bpy.context, path)
    add_mesh("cube", CUBE, QUADS)
    assert reading.why_not(bpy.context, path) is None


def test_linked_duplicates_are_read_each_in_its_own_size(read):
    cube = add_mesh("cube", CUBE, QUADS)
    double = add_object("double", cube.data, scale=(2, 2, 2))
    assert volume(read(double)) == pytest.approx(8 * volume(read(cube)))
