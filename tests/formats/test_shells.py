"""Shell elements: .msh, .inp and .vtu, read back by the programs that they are for."""

import importlib.util
import re

import numpy as np
import pytest

import medialis
from calculix import blocks_of, deflection, needs_ccx, nodes_of
from medialis.cli.commands import main
from medialis.formats.files import Drawn
from medialis.formats.shells import ShellMesh, write_inp, write_msh
from medialis.formats.vtk import write_vtu

needs_gmsh = pytest.mark.skipif(
    importlib.util.find_spec("gmsh") is None, reason="Gmsh is not installed (pip install gmsh)"
)
needs_pyvista = pytest.mark.skipif(
    importlib.util.find_spec("pyvista") is None, reason="PyVista is not installed"
)


def grid(nx, ny, length, width):
    """A flat strip of 2 nx ny triangles."""
    x, y = np.meshgrid(np.linspace(0, length, nx + 1), np.linspace(0, width, ny + 1), indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    i = np.arange(x.size).reshape(nx + 1, ny + 1)
    a, b, c, d = (rows.ravel() for rows in (i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]))
    return points, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]).astype(np.int32)


def tee():
    """Two sheets of different thickness at right angles that share the points of a seam."""
    points, faces = grid(4, 4, 4.0, 4.0)
    flange = points[faces].mean(axis=1)[:, 0] > 2.0
    points = points.copy()
    bent = points[:, 0] > 2.0
    points[bent, 2] = points[bent, 0] - 2.0
    points[bent, 0] = 2.0
    thickness = np.where(bent, 0.5, 0.25)
    return points, faces, {"thickness": thickness}, {"sheet": flange.astype(np.int32)}


def test_sections_have_the_thickness_of_their_own_points_also_at_welds(tmp_path):
    """The points of a seam have one value, of whichever sheet: it is not that of both."""
    write_inp(tmp_path / "a.inp", Drawn(*_arguments(tee())))
    sections = [(head, rows) for head, rows in blocks_of(tmp_path / "a.inp") if "SECTION" in head]
    assert [head.split("ELSET=")[1].split(",")[0] for head, _ in sections] == ["SHEET_0", "SHEET_1"]
    assert [float(rows[0][0]) for _, rows in sections] == [0.25, 0.5]
    assert "NODAL" not in (tmp_path / "a.inp").read_text()


def test_no_number_is_longer_than_calculix_reads(tmp_path):
    """-2.848362679850857e-20 ended its reading of nodes (fixed)."""
    layer, values = _arguments(tee())[0], _arguments(tee())[1:]
    points = np.array(layer) - 2.848362679850857e-20
    points[0] = -1.2345678901234567e-200
    write_inp(tmp_path / "a.ccx.inp", Drawn(points, *values))
    cells = re.split(r"[,\n]\s*", (tmp_path / "a.ccx.inp").read_text().partition("*NODE")[2])
    numbers = [cell for cell in cells if re.fullmatch(r"[-+.\deE]+", cell)]
    assert len(numbers) > 100 and max(map(len, numbers)) <= 20
    assert len(nodes_of(tmp_path / "a.ccx.inp")) >= len(points)


def test_an_input_file_says_the_unit_once_it_is_known(tmp_path):
    """It said "Lengths are in the unit of the shape" also with `--unit mm` (fixed)."""
    for unit, said in ((None, "the unit of the shape"), ("mm", "mm")):
        write_inp(tmp_path / "a.inp", Drawn(*_arguments(tee())), unit=unit)
        assert f"\n** Lengths are in {said}.\n" in (tmp_path / "a.inp").read_text()
    points, faces, *_ = tee()
    result = medialis.Result(
        shape=medialis.make_shape(points, faces, unit="mm"),
        layers=(medialis.Layer("tee", points, faces, formats=("obj",)),),
    )
    medialis.write_result(result, tmp_path / "r", formats=["inp", "ccx"])
    for name in ("tee.inp", "tee.ccx.inp"):
        assert "\n** Lengths are in mm.\n" in (tmp_path / "r" / name).read_text()
    assert (tmp_path / "r" / "tee.obj").read_text().startswith("# lengths in mm\n")


def _arguments(layer):
    points, faces, attributes, face_attributes = layer
    return points, faces, None, attributes, face_attributes


@pytest.mark.parametrize("name", ["a.inp", "a.ccx.inp"])
def test_elements_and_nodes_are_those_of_the_layer(tmp_path, name):
    points, faces, *values = tee()
    write_inp(tmp_path / name, Drawn(points, faces, None, *values))
    blocks = blocks_of(tmp_path / name)
    nodes = np.array([row for head, rows in blocks if head.startswith("*NODE,") for row in rows])
    found = nodes.astype(float)
    assert np.array_equal(found[: len(points), 1:], points)
    assert np.array_equal(found[:, 0], np.arange(1, len(found) + 1))
    elements = {}
    for head, rows in blocks:
        if head.startswith("*ELEMENT"):
            elements |= {int(row[0]): [int(n) - 1 for n in row[1:]] for row in rows}
            assert head.startswith("*ELEMENT, TYPE=S" + ("6" if "ccx" in name else "3"))
    corners = np.array([elements[i + 1] for i in range(len(faces))])
    assert np.array_equal(corners[:, :3], faces)
    if "ccx" in name:  # nodes 4 to 6 lie between 1 2, 2 3 and 3 1; neighbours share them
        between = 0.5 * (points[faces] + points[np.roll(faces, -1, axis=1)])
        assert np.array_equal(found[corners[:, 3:], 1:], between)
        shape = medialis.make_shape(points, faces)
        assert len(found) == len(points) + len(shape.edges)


def test_tapered_sheets_have_the_thickness_of_their_nodes(tmp_path):
    points, faces = grid(8, 2, 4.0, 1.0)
    tapered = 0.1 + 0.05 * points[:, 0]
    for name in ("a.inp", "a.ccx.inp"):
        write_inp(tmp_path / name, Drawn(points, faces, None, {"thickness": tapered}))
        blocks = {head.split(",")[0]: rows for head, rows in blocks_of(tmp_path / name)}
        rows = np.array(blocks["*NODAL THICKNESS"], float)
        nodes = np.array(blocks["*NODE"], float)
        assert np.array_equal(rows[:, 0], nodes[:, 0])
        assert np.allclose(rows[:, 1], 0.1 + 0.05 * nodes[:, 1], rtol=1e-14)
        assert "NODAL THICKNESS" in next(h for h, _ in blocks_of(tmp_path / name) if "SECT" in h)
        # the mean over the area of a strip that tapers evenly
        assert float(blocks["*SHELL SECTION"][0][0]) == pytest.approx(0.2, rel=1e-12)


def test_names_of_groups_suit_solvers_and_minus_one_is_no_sheet():
    points, faces = grid(1, 1, 1.0, 1.0)
    patch = {"my patch": np.array([-1, 7], np.int32)}
    mesh = ShellMesh(Drawn(points, faces, face_attributes=patch))
    assert [group.name for group in mesh.groups] == ["NO_MY_PATCH", "MY_PATCH_7"]
    assert [group.name for group in ShellMesh(Drawn(points, faces)).groups] == ["SHELL"]
    both = {"other": np.zeros(2, np.int32), "sheet": np.ones(2, np.int32)}
    mesh = ShellMesh(Drawn(points, faces, face_attributes=both))
    assert [group.name for group in mesh.groups] == ["SHEET_1"]


@pytest.mark.parametrize("write", [write_inp, write_msh])
def test_points_alone_are_refused_and_nothing_is_written(tmp_path, write):
    with pytest.raises(medialis.InvalidOptionError, match="no triangles"):
        write(tmp_path / "a", Drawn(np.eye(3)))
    assert not list(tmp_path.iterdir())


@needs_pyvista
def test_pyvista_reads_vtu(tmp_path):
    import pyvista

    points, faces, attributes, on_faces = tee()
    edges = np.array([[0, 1], [1, 2]])
    write_vtu(tmp_path / "a.vtu", Drawn(points, faces, edges, attributes, on_faces, "thickness"))
    grid_read = pyvista.read(tmp_path / "a.vtu")
    assert np.array_equal(grid_read.points, points)
    assert np.array_equal(grid_read.cells_dict[5], faces)
    assert np.array_equal(grid_read.cells_dict[3], edges)
    assert np.array_equal(grid_read.point_data["thickness"], attributes["thickness"])
    assert grid_read.cell_data["sheet"].tolist() == [0, 0, *on_faces["sheet"].tolist()]
    write_vtu(tmp_path / "b.vtu", Drawn(points))
    assert pyvista.read(tmp_path / "b.vtu").n_cells == len(points)


@needs_gmsh
def test_gmsh_reads_msh(tmp_path):
    import gmsh

    points, faces, attributes, on_faces = tee()
    attributes = {"normal": np.tile([0.0, 0.0, 1.0], (len(points), 1)), **attributes}
    attributes["thickness"] = np.where(np.arange(len(points)) == 3, np.nan, attributes["thickness"])
    write_msh(tmp_path / "a.msh", Drawn(points, faces, None, attributes, on_faces, "thickness"))
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(tmp_path / "a.msh"))
        tags, places, _ = gmsh.model.mesh.getNodes()
        assert np.array_equal(places.reshape(-1, 3)[np.argsort(tags)], points)
        groups = gmsh.model.getPhysicalGroups(2)
        assert [gmsh.model.getPhysicalName(*group) for group in groups] == ["SHEET_0", "SHEET_1"]
        for number, (_, tag) in enumerate(groups):
            (entity,) = gmsh.model.getEntitiesForPhysicalGroup(2, tag)
            _, (elements,), (nodes,) = gmsh.model.mesh.getElements(2, entity)
            rows = np.flatnonzero(on_faces["sheet"] == number)
            assert np.array_equal(elements, rows + 1)
            assert np.array_equal(nodes.reshape(-1, 3), faces[rows] + 1)
        views = gmsh.view.getTags()
        _, which, values, _, _ = gmsh.view.getModelData(views[0], 0)
        assert np.array_equal(which, np.delete(np.arange(len(points)), 3) + 1)
        assert np.array_equal(np.ravel(values), np.delete(attributes["thickness"], 3))
        assert len(views) == 3
    finally:
        gmsh.finalize()


@needs_ccx
@pytest.mark.parametrize("tapered", [False, True])
def test_calculix_bends_a_strip_as_far_as_the_closed_form(tmp_path, tapered):
    """Without Poisson's effect a clamped strip is a beam: F L^3 / (3 E I); tapered, an integral."""
    length, width, load = 200.0, 20.0, 1.0
    points, faces = grid(40, 4, length, width)

    def thickness_at(x):
        return 2.0 + (2.0 * (1 - x / length) if tapered else 0.0 * x)

    layer = points, faces, {"thickness": thickness_at(points[:, 0])}, {}
    write_inp(tmp_path / "strip.ccx.inp", Drawn(*_arguments(layer)))
    nodes = nodes_of(tmp_path / "strip.ccx.inp")
    ends = [np.flatnonzero(np.abs(nodes[:, 0] - at) < 1e-9) for at in (0.0, length)]
    found = deflection(tmp_path / "strip.ccx.inp", *ends, axis=2, load=load, poisson=0.0)
    x = (np.arange(20_000) + 0.5) * length / 20_000
    bent = 12 * load * (length - x) ** 2 / (210_000 * width * thickness_at(x) ** 3)
    assert found == pytest.approx(bent.sum() * length / 20_000, rel=0.01)


@pytest.mark.slow
def test_the_command_line_writes_them_and_says_what_they_are_for(tmp_path, capsys):
    medialis.write_mesh(tmp_path / "a.ply", medialis.organic_shape(56))
    given = ["thickness", str(tmp_path / "a.ply"), "--no-picture", "-o", str(tmp_path / "out")]
    assert main([*given, "--formats", "vtu,msh,inp,ccx"]) == 0
    told = capsys.readouterr().out
    assert all(f"for {program}" in told for program in ("Gmsh", "Abaqus", "CalculiX", "ParaView"))
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert {f"thickness.{e}" for e in ("vtu", "msh", "inp", "ccx.inp")} <= names
    assert "thin_spots.inp" not in names and "thin_spots.vtu" in names  # points are no shells


def test_a_result_without_triangles_has_no_shell_elements(tmp_path):
    shape = medialis.organic_shape(56)
    cloud = medialis.make_shape(shape.points, None, shape.normals)
    result = medialis.run("surface_skeleton", cloud)
    with pytest.raises(medialis.InvalidOptionError, match="no triangles"):
        medialis.write_result(result, tmp_path / "out", formats=["inp"])
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
@pytest.mark.parametrize("ending", ["msh", "inp", "ccx.inp", "vtu"])
def test_write_mesh_takes_a_layer(tmp_path, ending):
    result = medialis.run("thickness", medialis.organic_shape(56))
    medialis.write_mesh(tmp_path / f"a.{ending}", result)
    medialis.write_mesh(tmp_path / f"b.{ending}", result.layers[0])
    assert (tmp_path / f"a.{ending}").read_bytes() == (tmp_path / f"b.{ending}").read_bytes()
    if "inp" in ending:
        assert "*SHELL SECTION" in (tmp_path / f"a.{ending}").read_text()


def test_thickness_of_faces_counts_where_there_is_one(tmp_path):
    points, faces, attributes, on_faces = tee()
    thick = np.where(on_faces["sheet"] == 0, 0.3, 0.6)
    mesh = ShellMesh(Drawn(points, faces, None, attributes, {**on_faces, "face_thickness": thick}))
    assert [(group.thickness, group.even) for group in mesh.groups] == [
        (pytest.approx(0.3), True),
        (pytest.approx(0.6), True),
    ]
