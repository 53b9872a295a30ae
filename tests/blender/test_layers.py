"""Layers of every kind become objects and attributes with exactly the core's values in float32."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy", reason="bpy is not installed: make hosts")
import medialis
from blender_scenes import add_mesh, counts, evaluated, groups_of, read_back, world
from medialis import Layer, Result
from medialis.hosts import FilterUnit
from medialis.show.colors import label_colors, to_linear

RNG = np.random.default_rng(7)
POINTS = RNG.normal(size=(12, 3))
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
BRANCH = np.array([[0, 1], [1, 2], [1, 3], [3, 4]], np.int32)
ATTRIBUTES = {
    "value": RNG.random(12),
    "label": np.arange(12, dtype=np.int64) % 4 - 1,
    "side": (np.arange(12) % 2).astype(np.uint8),
    "flag": np.arange(12) % 3 == 0,
    "normal": RNG.normal(size=(12, 3)),
    "uv": RNG.random((12, 2)),
    "pair": np.arange(24, dtype=np.int32).reshape(12, 2),
    "holes": np.r_[np.nan, np.inf, RNG.random(10)],
}


@pytest.fixture
def cube(scene):
    return add_mesh("cube", CUBE, QUADS, location=(3, 2, 1), scale=(2, 1, -1))


@pytest.fixture
def add(cube):
    """Add layers as the result of an operation on the cube."""
    from blender_addon import reading, writing

    def add_layers(*layers, chosen=cube, images=None, **options):
        source = reading.read_object(bpy.context, chosen)
        shape = medialis.make_shape(source.points, source.faces, repair=True)
        result = Result(
            shape=shape,
            layers=layers,
            images=images or {},
            operation="surface_skeleton",
            seconds={"total": 1.0},
        )
        return writing.add_result(bpy.context, source, shape, result, writing.Options(**options))

    return add_layers


def check(data, attributes):
    for name, values in attributes.items():
        if values.dtype.kind in "iu" and values.ndim == 2:
            for i in range(values.shape[1]):
                assert (read_back(data, f"{name}_{i + 1}") == values[:, i]).all()
            continue
        found = read_back(data, name)
        expected = values.astype(np.float32) if values.dtype.kind == "f" else values
        assert found.shape == expected.shape
        assert np.array_equal(found, expected, equal_nan=values.dtype.kind == "f")


def test_points(add, cube):
    radius = 1 + RNG.random(12)
    layer = Layer("dots", POINTS, attributes={"radius": radius, **ATTRIBUTES}, color_by="radius")
    (made,) = add(layer)
    assert made.type == "POINTCLOUD" and made.name == "cube dots"
    check(made.data, {**layer.attributes, "medial_radius": radius, "position": POINTS})
    assert (read_back(made.data, "position") == POINTS.astype(np.float32)).all()
    assert [c.name for c in made.users_collection] == ["Medialis: cube"]
    assert bpy.context.active_object == made and made.parent == cube
    shown = evaluated(made).data
    drawn = read_back(shown, "radius")
    assert (drawn == drawn[0]).all() and 0 < drawn[0] < 0.1  # small dots, not balls
    from blender_addon import filtering

    filtering.set_input(made, "Balls", True)
    assert (read_back(evaluated(made).data, "radius") == radius.astype(np.float32)).all()


def test_results_lie_on_the_object_and_follow_it(add, cube):
    """Points are relative to the object's origin in world axes; the object may then move."""
    (made,) = add(Layer("dots", POINTS))
    assert np.allclose(world(made), POINTS + np.array([3, 2, 1]), rtol=0, atol=1e-6)
    cube.location = (0, 0, 5)
    cube.scale = (4, 2, -2)
    assert np.allclose(world(made), 2 * POINTS + np.array([0, 0, 5]), rtol=0, atol=1e-5)


def test_far_from_the_origin_no_digit_is_lost(add, cube):
    cube.location = (1e6, -1e6, 0)
    (made,) = add(Layer("dots", 1e-3 * POINTS))
    bpy.context.view_layer.update()
    matrix = np.array(made.matrix_world)
    assert np.allclose(matrix[:3, :3], np.eye(3), atol=1e-6)
    assert (matrix[:3, 3] == (1e6, -1e6, 0)).all()


def test_the_threshold_filters_live(add):
    from blender_addon import filtering

    value = np.r_[np.inf, np.nan, np.linspace(0, 1, 10)]
    layer = Layer("dots", POINTS, attributes={"value": value}, filter_by="value", color_by="value")
    (made,) = add(layer)
    assert len(evaluated(made).data.points) == 12
    filtering.set_input(made, "Threshold", 0.5)
    assert len(evaluated(made).data.points) == 2 + (value[2:] >= 0.5).sum()
    assert len(made.data.points) == 12
    # Blender 4.5 lost the material of filtered clouds: they were rendered white.
    assert evaluated(made).data.materials[0].name == made.data.materials[0].name
    owner, path = filtering.modifier_inputs(made)["Threshold"]
    assert owner.path_resolve(path) == 0.5


@pytest.mark.parametrize(
    ("unit", "typed", "subtype"),
    [
        (FilterUnit.length(4.0, "threshold"), 5.0, "PERCENTAGE"),
        (FilterUnit.length(4.0, "threshold", power=2.0), 5.0, "PERCENTAGE"),
        (FilterUnit.degrees(), np.radians(0.05), "ANGLE"),
        (FilterUnit(), 0.05, "NONE"),
    ],
    ids=["length", "area", "angle", "number"],
)
def test_the_threshold_has_the_unit_of_the_option(add, unit, typed, subtype):
    """It starts at the default of the layer, and what it shows can be typed into the operator."""
    from blender_addon import filtering

    value = np.linspace(0, 2 * unit.attribute(0.05), 12)  # none is the threshold itself
    layer = Layer(
        "dots", POINTS, attributes={"value": value}, filter_by="value", filter_unit=unit,
        filter_default=0.05,
    )  # fmt: skip
    (made,) = add(layer)
    owner, path = filtering.modifier_inputs(made)["Threshold"]
    assert owner.path_resolve(path) == pytest.approx(typed, rel=1e-6)
    assert len(evaluated(made).data.points) == 6 == (~layer.hidden).sum()
    tree = made.modifiers["Medialis"].node_group.interface.items_tree
    (socket,) = [item for item in tree if item.name == "Threshold"]
    assert socket.subtype == subtype
    assert socket.max_value == pytest.approx(2 ** (1 / unit.power) * typed, rel=1e-6)
    filtering.set_input(made, "Threshold", 0.0)
    assert len(evaluated(made).data.points) == 12


def test_faces(add):
    faces = RNG.permuted(np.tile(np.arange(12), (9, 1)), axis=1)[:, :3].astype(np.int32)
    faces[4] = (1, 1, 2)  # Blender has no such face
    of_faces = {"area": RNG.random(9), "label": np.arange(9), "direction": RNG.random((9, 3))}
    layer = Layer(
        "sheet", POINTS, faces=faces, attributes=ATTRIBUTES, face_attributes=of_faces,
        color_by="area", filter_by="value",
    )  # fmt: skip
    (made,) = add(layer)
    assert made.type == "MESH" and len(made.data.polygons) == 8
    check(made.data, ATTRIBUTES)
    kept = np.delete(np.arange(9), 4)
    check(made.data, {n: of_faces[n][kept] for n in ("area", "direction")})
    assert (read_back(made.data, "label_of_face") == kept).all()
    corners = np.empty(24, np.int32)
    made.data.attributes[".corner_vert"].data.foreach_get("value", corners)
    assert (corners.reshape(-1, 3) == faces[kept]).all()


def test_faces_with_edges_beside_them(add):
    """A triangle, and an edge of no face as a tube; the data have the three edges and this one."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 0, 0]], float)
    layer = Layer(
        "both", points, faces=np.array([[0, 1, 2]], np.int32), edges=np.array([[1, 3]], np.int32),
        attributes={"radius": np.full(4, 0.5)}, color_by="radius",
    )  # fmt: skip
    (made,) = add(layer)
    assert len(made.data.polygons) == 1 and len(made.data.edges) == 4
    shown = evaluated(made).to_mesh()
    assert len(shown.polygons) == 1 + 8 and len(shown.materials) >= 1


def test_hidden_layers_are_there_and_not_seen(add):
    first, hidden = add(Layer("dots", POINTS), Layer("more", POINTS, role="hidden"))
    assert hidden.hide_render and hidden.hide_get()
    assert not first.hide_render and not first.hide_get()


def test_edges_with_radius_are_tubes_with_all_attributes(add):
    from blender_addon import filtering

    line = np.array([[0, 0, 0], [1, 0, 0], [2, 0.5, 0], [2, -0.5, 0], [3, -1, 0]], float)
    radius = np.array([0.2, 0.3, 0.1, 0.1, 0.05])
    attributes = {"radius": radius, "branch": np.array([0, 0, 1, 2, 2])}
    layer = Layer(
        "curve", line, edges=BRANCH, attributes=attributes, labels=("branch",), color_by="branch"
    )
    (made,) = add(layer)
    assert made.type == "MESH" and len(made.data.edges) == 4
    check(made.data, attributes)
    edges = np.empty(8, np.int32)
    made.data.edges.foreach_get("vertices", edges)
    assert sorted(map(sorted, edges.reshape(-1, 2).tolist())) == BRANCH.tolist()
    tube = evaluated(made).to_mesh()
    assert len(tube.polygons) == 4 * 8 and "branch_color" in tube.attributes
    filtering.set_input(made, "Balls", True)
    fat = evaluated(made).to_mesh()
    points = np.array([vertex.co for vertex in fat.vertices])
    # The ring round the first point is perpendicular to the first edge.
    ring = points[np.abs(points[:, 0]) < 1e-6]
    assert len(ring) == 8
    assert np.allclose(np.linalg.norm(ring, axis=1), 0.2, atol=1e-6)


def test_tubes_are_coloured_by_their_medial_radius(add):
    """The tube's own radius took the attribute's place: the whole curve had one colour."""
    radius = np.array([0.2, 0.3, 0.1, 0.1, 0.05])
    layer = Layer(
        "curve", POINTS[:5], edges=BRANCH, attributes={"radius": radius}, color_by="radius"
    )
    (made,) = add(layer)
    nodes = made.data.materials[0].node_tree.nodes
    shown = next(node.attribute_name for node in nodes if node.type == "ATTRIBUTE")
    tube = evaluated(made).to_mesh()
    assert set(read_back(tube, shown).tolist()) == set(radius.astype(np.float32).tolist())


def test_edges_as_curve_objects(add):
    radius = np.array([0.2, 0.3, 0.1, 0.1, 0.05])
    layer = Layer("curve", POINTS[:5], edges=BRANCH, attributes={"radius": radius})
    (made,) = add(layer, curves=True)
    assert made.type == "CURVE" and [len(s.points) for s in made.data.splines] == [2, 2, 3]
    last = made.data.splines[2]
    rows = [1, 3, 4]
    assert np.allclose([p.co[:3] for p in last.points], POINTS[rows], atol=1e-6)
    assert [p.radius for p in last.points] == radius[rows].astype(np.float32).tolist()


def test_colours_of_labels_are_the_palette(add):
    labels = ATTRIBUTES["label"]
    layer = Layer("dots", POINTS, attributes={"label": labels}, labels=("label",), color_by="label")
    (made,) = add(layer)
    expected = to_linear(label_colors(labels)).astype(np.float32)
    assert (read_back(made.data, "label_color")[:, :3] == expected).all()
    assert made.data.materials[0] is not None


def test_fields_on_the_input(add, cube):
    """Values, labels and face values on the cube; its mesh is not touched otherwise."""
    before = counts()
    shape = medialis.make_shape(*_arrays(cube), repair=True)
    value, label = RNG.random(8), np.array([0, 0, 1, 1, 2, 2, -1, -1])
    of_faces = {"patch": np.arange(12, dtype=np.int32) // 2}
    layer = Layer(
        "parts", shape.points, faces=shape.faces, attributes={"value": value, "part": label},
        face_attributes=of_faces, labels=("part", "patch"), color_by="part", on_input=True,
    )  # fmt: skip
    (made,) = add(layer, segments_as={"GROUPS"}, keep_materials=True, legend=False)
    assert made == cube and counts() == before
    check(cube.data, {"value": value, "part": label})
    assert (read_back(cube.data, "patch") == np.arange(6)).all()
    groups = groups_of(cube)
    assert {n: g for n, g in groups.items() if n.startswith("part ")} == {
        "part 000": [0, 1], "part 001": [2, 3], "part 002": [4, 5]
    }  # fmt: skip
    for number, quad in enumerate(QUADS):
        assert groups[f"patch {number:03d}"] == sorted(quad)
    assert cube.data.color_attributes.active_color.name == "part_color"
    assert not cube.data.materials
    # An earlier run's groups are replaced, others stay.
    cube.vertex_groups.new(name="mine")
    again = Layer(
        "parts", shape.points, faces=shape.faces, attributes={"part": np.zeros(8, int)},
        labels=("part",), on_input=True,
    )  # fmt: skip
    add(again, segments_as={"GROUPS"})
    names = [group.name for group in cube.vertex_groups]
    assert "part 000" in names and "mine" in names and "part 001" not in names


def _arrays(chosen):
    from blender_addon import reading

    source = reading.read_object(bpy.context, chosen)
    return source.points, source.faces


def test_materials_on_request(add, cube):
    own = bpy.data.materials.new("own")
    cube.data.materials.append(own)
    shape = medialis.make_shape(*_arrays(cube), repair=True)
    label = np.arange(12, dtype=np.int32) // 4
    layer = Layer(
        "parts", shape.points, faces=shape.faces, face_attributes={"part": label},
        labels=("part",), color_by="part", on_input=True,
    )  # fmt: skip
    add(layer, segments_as={"MATERIALS"})
    slots = [material.name for material in cube.data.materials]
    assert slots == ["own", "part 000", "part 001", "part 002"]
    assert [p.material_index for p in cube.data.polygons] == [1, 1, 2, 2, 3, 3]
    colors = read_back(cube.data, "part_color").reshape(6, 4, 4)
    expected = to_linear(label_colors([0, 0, 1, 1, 2, 2])).astype(np.float32)
    assert (colors[:, :, :3] == expected[:, None]).all()
    materials = len(bpy.data.materials)
    add(layer, segments_as={"MATERIALS"})  # the same materials again
    assert len(bpy.data.materials) == materials


def test_merged_and_dropped_vertices(add, scene):
    """Repair merges doubles and drops loose vertices: each vertex of the mesh still has a row."""
    points = np.vstack([CUBE, CUBE[:1], [[9, 9, 9]]])
    double = add_mesh("double", points, [tuple(8 if i == 0 else i for i in QUADS[0]), *QUADS[1:]])
    shape = medialis.make_shape(*_arrays(double), repair=True)
    value = np.arange(shape.point_count, dtype=float)
    layer = Layer(
        "field", shape.points, faces=shape.faces, attributes={"value": value}, on_input=True
    )
    add(layer, chosen=double)
    found = read_back(double.data, "value")
    assert np.array_equal(found, shape.on_input_points(value, np.nan), equal_nan=True)
    assert found[0] == found[8] and np.isnan(found[9]) and not np.isnan(found[:9]).any()


def test_rows_of_copies_give_a_copy(add, cube):
    """Three cubes in a row have other values each: they cannot stand on the vertices of one."""
    cube.modifiers.new("array", "ARRAY").count = 3
    points, faces = _arrays(cube)
    shape = medialis.make_shape(points, faces, repair=True)
    value = np.arange(shape.point_count, dtype=float)
    layer = Layer(
        "field", shape.points, faces=shape.faces, attributes={"value": value}, on_input=True
    )
    (made,) = add(layer)
    assert made != cube and made.parent == cube and len(made.data.vertices) == 24
    assert (read_back(made.data, "value") == shape.on_input_points(value, np.nan)).all()
    assert np.allclose(world(made), points + np.array([3, 2, 1]), atol=1e-6)
    assert "value" not in cube.data.attributes and cube.hide_render and cube.hide_get()
    bpy.ops.medialis.remove_result()
    assert not cube.hide_render and not cube.hide_get() and len(bpy.data.objects) == 1


def test_images_are_packed(add):
    pixels = RNG.integers(0, 256, (5, 7, 3), dtype=np.uint8)
    add(Layer("dots", POINTS), images={"a_picture": pixels})
    image = bpy.data.images["cube a picture"]
    values = np.empty(5 * 7 * 4, np.float32)
    image.pixels.foreach_get(values)
    found = np.rint(values.reshape(5, 7, 4)[::-1, :, :3] * 255)
    assert (found == pixels).all() and image.packed_file is not None


def test_auxiliary_layers_on_request_only(add):
    layers = Layer("dots", POINTS), Layer("samples", POINTS, auxiliary=True)
    assert [made.name for made in add(*layers)] == ["cube dots"]
    names = [made.name for made in add(*layers, add_samples=True)]
    assert names == ["cube dots", "cube samples"]


def test_numbers_that_blender_cannot_hold_change_nothing(add):
    before = counts()
    with pytest.raises(medialis.InvalidShapeError, match="32 bits: id has larger"):
        add(Layer("dots", POINTS, attributes={"id": np.full(12, 2**40)}))
    with pytest.raises(medialis.InvalidShapeError, match="too large for Blender's single"):
        add(Layer("dots", 1e39 * POINTS))
    assert counts() == before


def test_failing_midway_takes_everything_back(add, cube, monkeypatch):
    """The last step fails: new objects go, and the mesh of the source is as it was."""
    from blender_addon import writing

    shape = medialis.make_shape(*_arrays(cube), repair=True)
    field = Layer(
        "field", shape.points, faces=shape.faces, on_input=True, color_by="part",
        attributes={"part": np.arange(8, dtype=np.int32)}, labels=("part",),
    )  # fmt: skip
    cube.data.materials.append(bpy.data.materials.new("own"))
    before, names = counts(), list(cube.data.attributes.keys())
    other = Layer("edges", POINTS, edges=BRANCH, attributes={"radius": RNG.random(12)},
                  color_by="radius")  # fmt: skip

    def fail(*_):
        raise RuntimeError("no")

    monkeypatch.setattr(writing.summary, "lines", fail)
    with pytest.raises(RuntimeError, match="no"):
        add(field, Layer("dots", POINTS, attributes={"radius": POINTS[:, 0]}), other,
            images={"p": np.zeros((2, 2, 3), np.uint8)}, segments_as={"MATERIALS"})  # fmt: skip
    assert counts() == before
    assert sorted(cube.data.attributes.keys()) == sorted(names) and not cube.vertex_groups
    assert [m.name for m in cube.data.materials] == ["own"] and cube.data.name == "cube"
    assert "medialis_summary" not in cube
