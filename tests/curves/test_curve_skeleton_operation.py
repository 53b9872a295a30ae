import json

import numpy as np
import pytest

import closed_forms as forms
import medialis
from medialis.cli.commands import main
from medialis.formats.ply_attributes import write_ply
from tubes import circle, segment, tube


@pytest.fixture(scope="module")
def creature():
    return medialis.organic_shape(100)


@pytest.fixture(scope="module")
def result(creature):
    return medialis.run("curve_skeleton", creature)


@pytest.mark.slow
def test_layers_and_values(result, creature):
    graph, parts, candidates, samples = result.layers
    assert [layer.auxiliary for layer in result.layers] == [False, False, True, True]
    assert parts.on_input and parts.labels == ("branch",)
    assert (parts.points == creature.points).all() and candidates.name.endswith("candidates")
    assert samples.name == "samples"
    values = result.values
    assert values["components"] == 1 and values["loops"] == values["expected_loops"] == 0
    assert values["nodes"] - values["edges"] == 1
    assert values["length"] == pytest.approx(sum(row["length"] for row in values["branch_table"]))
    assert len(graph.edges) == values["edges"] and set(graph.attributes) == {
        "radius",
        "importance",
        "branch",
        "degree",
        "persistence",
    }
    # Four legs, head, tail and two ears.
    assert values["end_points"] == 8
    assert "thin_sheets" not in codes(result)


def codes(result):
    return {message.code for message in result.messages}


def notes(shape, **options):
    return codes(medialis.run("curve_skeleton", shape, **options))


def box(size):
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * size
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return medialis.make_shape(corners, faces)


@pytest.mark.slow
def test_what_makes_the_result_uncertain_is_said(creature):
    assert "thin_sheets" in notes(box([1, 1, 0.06]))
    assert "few_samples" in notes(box([1, 0.4, 0.4]), refine=0)
    ball = tube([segment([0, 0, 0], [1e-9, 0, 0])], 0.5, 0.1)
    assert "single_nodes" in notes(ball)
    torus = tube([circle([0, 0, 0], 1)], 0.3, 0.1)
    kept = (torus.faces[:, :, None] != [5]).all(axis=(1, 2))
    holed = medialis.Shape(torus.points, torus.normals, torus.faces[kept])
    run = medialis.run("curve_skeleton", holed)
    assert run.graph.loops == 1 and "open_shape" in codes(run)
    torn = np.concatenate([torus.faces, [[*torus.faces[0, :2], 7]]])
    run = medialis.run("curve_skeleton", medialis.Shape(torus.points, torus.normals, torn))
    assert "handles_uncertain" in codes(run) and not run.values["expected_loops_certain"]
    assert run.graph.loops == run.values["expected_loops"] == 1
    two = medialis.Shape(
        np.concatenate([torus.points, ball.points + np.array([5, 0, 0])]),
        np.concatenate([torus.normals, ball.normals]),
        np.concatenate([torus.faces, ball.faces + torus.point_count]),
    )
    assert "separate_parts" in notes(two)


@pytest.mark.slow
def test_no_loop_is_claimed_where_all_samples_lie_on_creases():
    """Centers that coincide on the sides of triangles saw angles of chance, and a loop of none."""
    ring = forms.torus_mesh(around=24, across=6, major=1.0, minor=0.012)
    run = medialis.run("curve_skeleton", ring)
    around = len(run.graph.nodes) > 1 and run.graph.length > 2 * np.pi * (1 - 0.012)
    assert run.graph.loops == (1 if around else 0)
    assert ("loops_missing" in codes(run)) == (run.graph.loops == 0)


@pytest.mark.slow
@pytest.mark.parametrize(("around", "across", "minor"), [(5, 6, 0.02), (8, 4, 0.02), (24, 5, 0.03)])
def test_a_thin_ring_of_flat_faces_has_its_loop(around, across, minor):
    """All samples of a thin ring lie on creases; limbs get samples, or handles where refine is 0.

    The loop runs inside, so it is as long as the polygon of the axis but for what cutting its
    corners by the thickness saves.
    """
    ring = forms.torus_mesh(around=around, across=across, major=1.0, minor=minor)
    polygon = 2 * around * np.sin(np.pi / around)
    assert medialis.run("curve_skeleton", ring).graph.loops == 1
    for refine, code in (("auto", "refined"), (0, "handles_refined")):
        run = medialis.run("curve_skeleton", ring, skeleton_method="balls", refine=refine)
        assert run.graph.loops == run.values["expected_loops"] == 1
        assert run.graph.length == pytest.approx(polygon, rel=2 * minor + 0.02)
        (note,) = (note for note in run.messages if "refined" in note.code)
        assert note.code == code
        # The given vertices are there, first and unmoved, as with any refinement.
        assert (run.shape.points[: ring.point_count] == ring.points).all()
    assert note.data["samples"] == run.shape.point_count - ring.point_count


@pytest.mark.slow
def test_refined_handles_turn_with_the_shape():
    """The same loops of a ring that is turned, scaled and far from the origin."""
    ring = forms.torus_mesh(around=8, across=5, major=1.0, minor=0.02)
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    moved = medialis.make_shape(7.0 * ring.points @ turn.T + [10.0, 0, -40], ring.faces)
    one, other = (medialis.run("curve_skeleton", shape) for shape in (ring, moved))
    assert one.graph.loops == other.graph.loops == 1
    assert other.graph.length == pytest.approx(7 * one.graph.length, rel=0.02)


@pytest.mark.slow
def test_sheets_are_parts_more_than_four_times_as_wide_as_thick():
    """Of a plate L x w x t the balls of its inner (w - 4 t) x (L - 4 t) can lie that far."""
    assert "thin_sheets" in notes(box([1, 0.8, 0.06]))
    assert "thin_sheets" not in notes(box([1, 0.2, 0.06]))
    assert "thin_sheets" not in notes(box([1, 0.4, 0.4]))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "flat"), [("scapula", True), ("rockerarm", False), ("screwdriver", False)]
)
def test_real_sheets_are_told_from_other_parts(name, flat, real_shapes):
    found = medialis.run("curve_skeleton", medialis.read_shape(real_shapes / f"{name}.ply"))
    assert ("thin_sheets" in codes(found)) == flat


@pytest.mark.slow
def test_clouds_and_flat_shapes_are_refused(creature):
    with pytest.raises(medialis.InvalidShapeError, match="needs a surface"):
        medialis.run("curve_skeleton", medialis.Shape(creature.points, creature.normals))


@pytest.mark.slow
def test_files_of_the_command_line(tmp_path, capsys):
    shape = tube([circle([0, 0, 0], 1)], 0.3, 0.1)
    write_ply(tmp_path / "torus.ply", shape.points, faces=shape.faces)
    out = tmp_path / "out"
    arguments = ["curve-skeleton", str(tmp_path / "torus.ply"), "-o", str(out), "--json"]
    assert main([*arguments, "--formats", "swc,json"]) == 0
    manifest = json.loads(capsys.readouterr().out)
    assert manifest["values"]["loops"] == 1
    names = {path.name for path in out.iterdir()}
    assert {"curve_skeleton.ply", "curve_skeleton.swc", "curve_skeleton.png"} <= names
    assert "curve_skeleton.json" in names and "curve_skeleton.obj" not in names
    assert medialis.read_curve_skeleton(out / "curve_skeleton.swc").loops == 1
    assert main([*arguments[:-1], "--formats", "swc,xls"]) == 2
    assert "formats must be one of" in capsys.readouterr().err
