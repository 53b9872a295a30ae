"""What pymeshlab itself knows of the filters: lists, searches, scripts, saved files, progress."""

import xml.etree.ElementTree as Xml

import numpy as np
import pytest
from code_blocks import blocks, run_python
from website.pages import DOCS

import medialis

pymeshlab = pytest.importorskip("pymeshlab", reason="needs pymeshlab (the extra meshlab)")
import medialis_meshlab  # noqa: E402


def script_text(mesh_set, path):
    mesh_set.save_filter_script(str(path))
    return path.read_text(encoding="utf-8")


@pytest.mark.slow
def test_lists_of_pymeshlab_know_both(fresh):
    assert {"generate_convex_hull", "generate_curve_skeleton"} <= {*pymeshlab.filter_list()}
    printed = fresh(
        "import medialis_meshlab, pymeshlab\n"
        "pymeshlab.print_filter_list()\n"
        "pymeshlab.search('medial thickness')\n"
        "pymeshlab.print_filter_parameter_list('generate_curve_skeleton')\n"
        "pymeshlab.print_filter_parameter_list('generate_convex_hull')\n"
    )
    assert "\tgenerate_curve_skeleton" in printed and "generate_convex_hull filter" in printed
    assert "compute_scalar_by_medial_thickness_per_vertex: Measure how thick" in printed
    assert "\tthreshold : PercentageValue = 'auto' [min: 0%; max: 100%]" in printed


def test_unpatching_gives_pymeshlab_its_functions_back():
    patched = pymeshlab.filter_list
    medialis_meshlab.unpatch()
    try:
        assert "generate_curve_skeleton" not in pymeshlab.filter_list()
        assert not hasattr(pymeshlab.MeshSet, "generate_curve_skeleton")
    finally:
        medialis_meshlab.patch()
    assert pymeshlab.filter_list is not patched
    assert "generate_curve_skeleton" in pymeshlab.filter_list()


@pytest.mark.slow
def test_a_script_keeps_the_filters_in_per_cent_and_runs_them(mesh_set, creature, tmp_path):
    """On the same shape, four times as large (exact in floating point): results are as well."""
    mesh_set.compute_scalar_by_medial_thickness_per_vertex(
        threshold=pymeshlab.PureValue(0.02 * creature.diagonal), kind="radius"
    )
    mesh_set.set_selection_all()
    mesh_set.generate_curve_skeleton(solid=True, hide_source=True)
    text = script_text(mesh_set, tmp_path / "script.mlx")
    steps = Xml.fromstring(text)
    assert [step.get("name") for step in steps] == [
        "Compute Scalar by Medial Thickness per Vertex",
        "Select All",
        "Generate Medial Curve Skeleton",
    ]
    threshold = next(row for row in steps[0] if row.get("name") == "threshold")
    assert float(threshold.get("value")) == pytest.approx(2.0, rel=1e-6)
    assert (threshold.get("min"), threshold.get("max")) == ("0", "100")

    other = pymeshlab.MeshSet()
    other.add_mesh(pymeshlab.Mesh(4 * creature.points, creature.faces), "larger")
    other.load_filter_script(str(tmp_path / "script.mlx"))
    other.apply_filter_script()
    assert other.mesh_number() == mesh_set.mesh_number()
    assert other.mesh(0).selected_vertex_number() == creature.point_count
    assert not other.is_mesh_visible(0)
    skeletons = [ms.current_mesh() for ms in (mesh_set, other)]
    assert (4 * skeletons[0].vertex_matrix() == skeletons[1].vertex_matrix()).all()
    thickness = [
        ms.mesh(0).vertex_custom_scalar_attribute_array("thickness") for ms in (mesh_set, other)
    ]
    assert (4 * thickness[0] == thickness[1]).all()
    assert Xml.canonicalize(script_text(other, tmp_path / "again.mlx")) == Xml.canonicalize(text)


def test_a_script_of_pymeshlab_alone_runs_as_before(mesh_set, tmp_path):
    mesh_set.set_selection_all()
    mesh_set.apply_selection_inverse(invverts=True)
    text = script_text(mesh_set, tmp_path / "script.mlx")
    mesh_set.set_selection_all()
    mesh_set.load_filter_script(str(tmp_path / "script.mlx"))
    mesh_set.apply_filter_script()
    assert mesh_set.current_mesh().selected_vertex_number() == 0
    assert Xml.canonicalize(script_text(mesh_set, tmp_path / "x.mlx")) == Xml.canonicalize(text)


def test_a_step_that_fails_leaves_the_script(mesh_set, tmp_path):
    mesh_set.generate_curve_skeleton()
    text = script_text(mesh_set, tmp_path / "script.mlx")
    cloud = pymeshlab.MeshSet()
    cloud.add_mesh(pymeshlab.Mesh(np.eye(3)), "cloud")
    cloud.load_filter_script(str(tmp_path / "script.mlx"))
    with pytest.raises(pymeshlab.PyMeshLabException, match="Any Faces"):
        cloud.apply_filter_script()
    assert Xml.canonicalize(script_text(cloud, tmp_path / "x.mlx")) == Xml.canonicalize(text)
    assert cloud.mesh_number() == 1


def test_the_selection_of_a_run_is_not_in_its_script(mesh_set, creature, tmp_path):
    """A script takes the vertices that are selected when it runs, not a file that is gone."""
    mesh_set.compute_selection_by_condition_per_vertex(condselect="(vi == 7 || vi == 900)")
    first = mesh_set.generate_geodesic_path(use_selection=True)["length"]
    expected = medialis.run("geodesic_path", creature, start=7, end=900).values["length"]
    assert first == expected
    (step,) = Xml.fromstring(script_text(mesh_set, tmp_path / "script.mlx"))[1:]
    rows = {row.get("name"): row.get("value") for row in step}
    assert rows["pairs"] == "" and rows["use_selection"] == "true"


@pytest.mark.slow
def test_attributes_survive_saving(mesh_set, creature, tmp_path):
    """pymeshlab leaves custom attributes out of PLY files unless it is told."""
    from medialis.formats.ply_attributes import read_ply_attributes

    mesh_set.compute_scalar_by_medial_thickness_per_vertex()
    mesh_set.current_mesh().add_vertex_custom_scalar_attribute(np.ones(creature.point_count), "b")
    mesh_set.save_current_mesh(str(tmp_path / "with.ply"))
    mesh_set.save_current_mesh(str(tmp_path / "without.ply"), __ca_vs__thickness=False)
    found = read_ply_attributes(tmp_path / "with.ply").attributes
    expected = mesh_set.current_mesh().vertex_custom_scalar_attribute_array("thickness")
    np.testing.assert_array_equal(found["thickness"], expected)
    assert "thin_spot" in found and "b" not in found  # others' as pymeshlab does it
    assert "thickness" not in read_ply_attributes(tmp_path / "without.ply").attributes
    mesh_set.save_current_mesh(str(tmp_path / "plain.obj"))


def test_a_verbose_mesh_set_tells_the_progress(mesh_set, capsys):
    mesh_set.set_verbosity(True)
    mesh_set.generate_surface_skeleton()
    lines = capsys.readouterr().out.splitlines()
    shares = [int(line.split(" %")[0]) for line in lines if " %" in line]
    assert len(shares) > 5 and shares == sorted(shares) and shares[-1] == 100
    mesh_set.set_verbosity(False)
    mesh_set.generate_surface_skeleton()
    assert capsys.readouterr().out == ""


@pytest.mark.slow
def test_every_block_of_the_page_runs_in_order(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    page, names = DOCS / "pymeshlab.md", {}
    found = [code for language, code in blocks(page) if language == "python"]
    assert len(found) >= 5
    for code in found:
        run_python(code, page, names)
    assert (tmp_path / "thickness.ply").is_file() and (tmp_path / "steps.mlx").is_file()
