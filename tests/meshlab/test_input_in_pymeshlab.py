"""Results written on the current mesh, round the traps of pymeshlab 2025.7."""

import re

import numpy as np
import pytest

import medialis
from medialis.operations.positions import places
from medialis.operations.result import Layer
from medialis.show.colors import label_colors, map_colors

pymeshlab = pytest.importorskip("pymeshlab", reason="needs pymeshlab (the extra meshlab)")

# A tetrahedron whose corners are stored once a face, and a vertex that no face uses.
CORNERS = np.array([[0, 0, 0], [0, 1, 0], [1, 0, 0], [0, 0, 1], [5, 5, 5.0]])
SOUP = CORNERS[[0, 1, 2, 0, 2, 3, 0, 3, 1, 2, 1, 3, 4]]
SOUP_FACES = np.arange(12).reshape(4, 3)


def height(shape, **more):
    """Layer on the input: a scalar and a vector of the vertices."""
    values = {"height": shape.points[:, 2], "place": places(shape.points)}
    return Layer(
        "on", shape.points, shape.faces, attributes=values, color_by="height", on_input=True, **more
    )


def parts(shape):
    """Layer on the input: labels of the faces."""
    label = np.arange(shape.face_count, dtype=np.int32) % 60 - 1
    return Layer(
        "on",
        shape.points,
        shape.faces,
        face_attributes={"part": label},
        color_by="part",
        labels=("part",),
        on_input=True,
    )


def close(found, expected, steps=1.5):
    """Colours are within a step of the map where an expression made them, rounding adds half."""
    return np.abs(255 * found[:, :3] - 255 * expected).max() <= steps


def test_vertices_that_repair_merged_or_dropped(register):
    """Merged vertices have one value; what no face uses has none, -1, grey, and finite quality."""
    register(
        lambda s: Layer(
            "on",
            s.points,
            s.faces,
            attributes={"z": s.points[:, 2], "n": np.arange(s.point_count, dtype=np.int32)},
            color_by="z",
            on_input=True,
        )
    )
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(SOUP, SOUP_FACES))
    ms.compute_made()
    mesh = ms.current_mesh()
    z = mesh.vertex_custom_scalar_attribute_array("z")
    assert (z[:12] == SOUP[:12, 2]).all() and np.isnan(z[12])
    number = mesh.vertex_custom_scalar_attribute_array("n")
    same = (SOUP[:12, None] == SOUP[None, :12]).all(axis=2)
    assert (same == (number[:12, None] == number[None, :12])).all() and number[12] == -1
    assert mesh.vertex_scalar_array().tolist() == [*SOUP[:12, 2], 0.0]
    assert close(mesh.vertex_color_matrix(), map_colors(z))
    assert ms.get_scalar_statistics_per_vertex()["max"] == 1.0
    assert (mesh.vertex_matrix() == SOUP).all() and (mesh.face_matrix() == SOUP_FACES).all()


def test_labels_of_faces_and_of_vertices(mesh_set, register):
    register(
        parts,
        lambda s: Layer(
            "more",
            s.points,
            s.faces,
            attributes={"region": (np.arange(s.point_count) % 70 - 1).astype(np.int32)},
            color_by="region",
            labels=("region",),
            on_input=True,
        ),
    )
    result = mesh_set.compute_made()
    mesh = mesh_set.current_mesh()
    assert result["attributes"] == {"part": "part", "region": "region"}
    for found, shown, colors, count, share in (
        (
            mesh.face_custom_scalar_attribute_array("part"),
            mesh.face_scalar_array(),
            mesh.face_color_matrix(),
            mesh.face_number(),
            60,
        ),
        (
            mesh.vertex_custom_scalar_attribute_array("region"),
            mesh.vertex_scalar_array(),
            mesh.vertex_color_matrix(),
            mesh.vertex_number(),
            70,
        ),
    ):
        expected = np.arange(count) % share - 1
        assert (found == expected).all() and (shown == expected).all()
        assert close(colors, label_colors(expected), steps=0.5)


def test_scalars_of_faces_with_values_that_are_missing(mesh_set, register):
    values = np.linspace(-1, 2, mesh_set.current_mesh().face_number())
    values[:3] = np.nan, np.inf, -np.inf
    register(
        lambda s: Layer(
            "on",
            s.points,
            s.faces,
            face_attributes={"value": values},
            color_by="value",
            color_limits=(-0.5, 1.5),
            on_input=True,
        )
    )
    mesh_set.compute_made()
    mesh = mesh_set.current_mesh()
    found = mesh.face_custom_scalar_attribute_array("value")
    assert np.array_equal(found, values, equal_nan=True)
    low, high = values[3:].min(), values[3:].max()
    assert mesh.face_scalar_array()[:3].tolist() == [low, high, low]
    assert (mesh.face_scalar_array()[3:] == values[3:]).all()
    assert close(mesh.face_color_matrix(), map_colors(values, "sequential", -0.5, 1.5))


@pytest.mark.parametrize("name", ["sequential", "diverging_reversed"])
@pytest.mark.parametrize("limits", [(None, None), (0.3, 0.3), (0.9, 1.1)], ids=str)
def test_colours_by_expression(mesh_set, register, name, limits):
    register(lambda s: height(s, color_map=name, color_limits=limits))
    mesh_set.compute_made()
    mesh = mesh_set.current_mesh()
    values = mesh.vertex_matrix()[:, 2]
    assert close(mesh.vertex_color_matrix(), map_colors(values, name, *limits))


def test_again_on_the_same_mesh(mesh_set, register):
    """Trap: an attribute cannot be written twice. The new one has a free name, and is shown."""
    factors = iter([1.0, 2.0, 3.0])

    def layer(shape):
        values = next(factors) * shape.points[:, 2]
        return Layer(
            "on", shape.points, shape.faces, attributes={"z": values}, color_by="z", on_input=True
        )

    register(layer)
    names = [mesh_set.compute_made()["attributes"]["z"] for _ in range(3)]
    assert names == ["z", "z_2", "z_3"]
    mesh = mesh_set.current_mesh()
    for factor, name in enumerate(names, 1):
        found = mesh.vertex_custom_scalar_attribute_array(name)
        assert (found == factor * mesh.vertex_matrix()[:, 2]).all()
    assert (mesh.vertex_scalar_array() == 3 * mesh.vertex_matrix()[:, 2]).all()
    assert mesh_set.mesh_number() == 1


def test_a_mesh_with_copied_attributes(creature, register):
    """Trap: expressions can crash on a mesh whose attributes were copied by add_mesh."""
    own = pymeshlab.Mesh(creature.points, creature.faces)
    own.add_vertex_custom_scalar_attribute(np.arange(len(creature.points)) * 1.0, "Height")
    own.add_vertex_custom_point_attribute(creature.points, "mine")
    own.add_face_custom_scalar_attribute(np.arange(len(creature.faces)) * 1.0, "part")
    ms = pymeshlab.MeshSet()
    ms.add_mesh(own)
    register(height, parts)
    result = ms.compute_made()
    mesh = ms.current_mesh()
    assert result["attributes"] == {"height": "height_2", "place": "place", "part": "part_2"}
    assert (mesh.vertex_scalar_array() == creature.points[:, 2]).all()
    assert close(mesh.vertex_color_matrix(), map_colors(creature.points[:, 2]), steps=0.5)
    assert (mesh.vertex_custom_point_attribute_matrix("place") == creature.points).all()
    kept = mesh.vertex_custom_scalar_attribute_array("Height")
    assert (kept == np.arange(len(creature.points))).all()
    part = mesh.face_custom_scalar_attribute_array("part_2")
    assert (part == np.arange(len(creature.faces)) % 60 - 1).all()
    assert "values are in the attribute part_2" in result["messages"][-1]
    assert ms.mesh_number() == 1 and ms.current_mesh_id() == 0


def test_a_mesh_with_copied_attributes_and_a_transform(creature, register):
    """Trap: transfer between layers moves the vertices of a transformed layer by rounding."""
    own = pymeshlab.Mesh(creature.points, creature.faces)
    own.add_vertex_custom_scalar_attribute(creature.points[:, 0].copy(), "mine")
    ms = pymeshlab.MeshSet()
    ms.add_mesh(own)
    matrix = np.array([[0.1, 0, 0.3, 7], [0, 1 / 3, 0, -2], [0, 0.2, 1.7, 0], [0, 0, 0, 1]])
    ms.set_matrix(transformmatrix=matrix, freeze=False)
    register(height)
    ms.compute_made()
    mesh = ms.current_mesh()
    assert (mesh.vertex_matrix() == creature.points).all()
    assert (mesh.transform_matrix() == matrix).all()
    assert (mesh.vertex_scalar_array() == mesh.transformed_vertex_matrix()[:, 2]).all()


def test_an_attribute_name_that_expressions_cannot_hold(mesh_set, register):
    """Trap: an attribute named so by the user makes every expression fail."""
    mesh = mesh_set.current_mesh()
    mesh.add_face_custom_scalar_attribute(np.zeros(mesh.face_number()), "größe (mm)")
    mesh.add_vertex_custom_scalar_attribute(np.zeros(mesh.vertex_number()), "größe (mm)")
    register(height, parts)
    result = mesh_set.compute_made()
    assert (mesh.vertex_scalar_array() == mesh.vertex_matrix()[:, 2]).all()
    expected = np.arange(mesh.face_number()) % 60 - 1
    assert (mesh.face_custom_scalar_attribute_array("part") == expected).all()
    assert "values are in the attribute part" in result["messages"][-1]


def test_a_name_too_long_for_an_expression(mesh_set, register):
    """Trap: an expression may have at most 5000 characters."""
    name = "length_of_the_path_over_the_surface_" * 4
    register(
        lambda s: Layer(
            "on",
            s.points,
            s.faces,
            attributes={name: s.points[:, 2]},
            color_by=name,
            on_input=True,
        )
    )
    mesh_set.compute_made()
    mesh = mesh_set.current_mesh()
    assert (mesh.vertex_scalar_array() == mesh.vertex_matrix()[:, 2]).all()
    assert close(mesh.vertex_color_matrix(), map_colors(mesh.vertex_matrix()[:, 2]), steps=0.5)


def test_a_mesh_of_polygons_and_another_thread(register):
    """Polygons are triangles with an attribute of their own; Ctrl-C is a matter of one thread."""
    import threading

    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    points = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1.0)])
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(points, [np.array(quad, np.uint32) for quad in quads]))
    register(height, parts)
    worker = threading.Thread(target=ms.compute_made)
    worker.start()
    worker.join()
    mesh = ms.current_mesh()
    assert (mesh.face_custom_scalar_attribute_array("part") == np.arange(12) - 1).all()
    assert (mesh.vertex_scalar_array() == points[:, 2]).all()
    assert mesh.polygonal_face_list()[0].size == 4


def test_ids_that_a_cleared_mesh_set_gives_again(creature, register):
    """Mesh 0 of a MeshSet that was cleared is another mesh, whose attributes may be copies."""
    register(height, parts)
    own = pymeshlab.Mesh(creature.points, creature.faces)
    ms = pymeshlab.MeshSet()
    ms.add_mesh(own)
    assert len(ms.compute_made()["messages"]) == 1
    assert len(ms.compute_made()["messages"]) == 1  # the attributes that it has are ours
    own.add_vertex_custom_scalar_attribute(np.zeros(len(creature.points)), "height")
    own.add_face_custom_scalar_attribute(np.zeros(len(creature.faces)), "part")
    ms.clear()
    ms.add_mesh(own)
    assert ms.current_mesh_id() == 0
    assert "values are in the attribute part_2" in ms.compute_made()["messages"][-1]
    assert (ms.current_mesh().vertex_scalar_array() == creature.points[:, 2]).all()


def test_selection_and_colours_stay(mesh_set, register):
    """Vertex data, face data, selection: only what the layer sets changes."""
    mesh = mesh_set.current_mesh()
    mesh_set.compute_selection_by_condition_per_face(condselect="fi<100")
    mesh_set.compute_selection_by_condition_per_vertex(condselect="vi<50")
    mesh_set.compute_color_by_function_per_face(r="fi", g="7", b="9")
    mesh_set.compute_scalar_by_function_per_face(q="fi")
    colors, quality = mesh.face_color_matrix(), mesh.face_scalar_array()
    register(height)
    for ours in (True, False):  # by expression, then by transfer
        if not ours:
            mesh.add_vertex_custom_scalar_attribute(np.zeros(mesh.vertex_number()), "mine")
        mesh_set.compute_made()
        assert mesh.selected_face_number() == 100 and mesh.selected_vertex_number() == 50
        assert mesh.face_selection_array()[:100].all()
        assert (mesh.face_color_matrix() == colors).all()
        assert (mesh.face_scalar_array() == quality).all()
        assert (mesh.vertex_scalar_array() == mesh.vertex_matrix()[:, 2]).all()


@pytest.mark.slow
def test_a_far_point_does_not_slow_the_first_run(register):
    """Trap: MeshLab's search for the nearest vertex takes quadratic time then (minutes here)."""
    points = np.random.default_rng(0).random((200_000, 3))
    points[0] = 1e6
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(points, v_normals_matrix=np.ones_like(points)))
    register(height)
    ms.compute_made()
    assert (ms.current_mesh().vertex_scalar_array() == points[:, 2]).all()


def test_the_filter_script_holds_no_steps_within_ours(mesh_set, register, tmp_path, capfd):
    """Trap: pymeshlab records the filters that we apply inside, with layers that are gone."""

    def script():
        mesh_set.save_filter_script(str(tmp_path / "script.mlx"))
        return (tmp_path / "script.mlx").read_text(encoding="utf-8")

    register(height, parts, Layer("made", np.eye(3)), name="compute_made")
    mesh_set.compute_made()
    mesh_set.compute_made()
    ours = ["Compute Medial Made"] * 2
    assert re.findall('<filter name="(.*?)"', script()) == ours
    mesh_set.meshing_merge_close_vertices(threshold=pymeshlab.PureValue(0.5e-7))
    capfd.readouterr()
    mesh_set.compute_made()
    titles = [*ours, "Merge Close Vertices", "Compute Medial Made"]
    assert re.findall('<filter name="(.*?)"', script()) == titles
    assert 'value="5e-08"' in script()
    assert capfd.readouterr() == ("", "")


@pytest.mark.slow
def test_saved_attributes(mesh_set, tmp_path):
    """As the page says: MeshLab writes custom attributes when asked to by name."""
    mesh_set.compute_scalar_by_medial_thickness_per_vertex()
    file = tmp_path / "größe.ply"
    mesh_set.save_current_mesh(str(file), __ca_vs__thickness=True, binary=True)
    header = file.read_bytes()[:2000].split(b"end_header")[0].decode()
    assert "property double thickness" in header
    assert medialis.read_shape(file).point_count > 0
