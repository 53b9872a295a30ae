"""The examples for other programs, each run where its program is installed."""

import importlib.util
import os
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

import medialis

EXAMPLES = Path(__file__).resolve().parents[2] / "docs/examples"
NAMES = ["pyvista_thickness.py", "napari_layers.py", "MedialisThickness.py"]
LONGEST = 150


def needed(name):
    return pytest.importorskip(name, reason=f"{name} is not installed", exc_type=ImportError)


def example(name):
    """Load an example as a module, without running it."""
    spec = importlib.util.spec_from_file_location(name.partition(".")[0], EXAMPLES / name)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", [*NAMES, "thickness_check.FCMacro", "wall_check.FCMacro"])
def test_examples_are_short_and_are_python(name):
    text = (EXAMPLES / name).read_text("utf-8")
    assert len(text.splitlines()) < LONGEST
    compile(text, name, "exec")


@pytest.fixture(scope="module")
def plate():
    """Return a gear: 0.34 thick between its flat sides."""
    return medialis.sample_shape("gear", 56)


@pytest.mark.filterwarnings("ignore")  # of VTK, where there is no screen
def test_pyvista_draws_a_picture(tmp_path):
    needed("pyvista")
    path = tmp_path / "a.ply"
    medialis.write_mesh(path, medialis.organic_shape(56))
    example("pyvista_thickness.py").main(str(path), str(tmp_path / "a.png"))
    picture = (tmp_path / "a.png").read_bytes()
    assert picture.startswith(b"\x89PNG") and len(picture) > 10_000


@pytest.mark.filterwarnings("ignore")  # napari's own
def test_napari_gets_a_surface_points_and_a_skeleton_for_each_label():
    needed("napari")
    needed("skimage")
    from napari.components import ViewerModel

    grid = np.indices((60, 30, 30))
    across = np.hypot(grid[1] - 14.5, grid[2] - 14.5)
    labels = ((across < 6) & (grid[0] > 6) & (grid[0] < 53)).astype(int)  # a rod
    labels[:, :, 25] = 2  # a wall beside it
    viewer, scale = ViewerModel(), np.array([0.5, 0.5, 0.5])
    example("napari_layers.py").show(viewer, labels, scale)
    names = [layer.name for layer in viewer.layers]
    assert {"thickness of 1", "curve skeleton of 1", "thickness of 2"} <= set(names)
    rod = viewer.layers["thickness of 1"]
    # Six millimetres wide; labels and surface lie on each other.
    assert np.median(rod.vertex_values) == pytest.approx(6, abs=0.5)
    lines = viewer.layers["curve skeleton of 1"].data
    assert np.abs(lines[:, 0, 1:] - 0.5 * 14.5).max() < 0.5
    assert viewer.dims.ndisplay == 3


def test_the_functions_of_the_slicer_module_work_on_vtk(plate):
    """The module itself needs 3D Slicer, which pip does not install; VTK is what it computes on."""
    vtk = needed("vtk")
    pyvista = needed("pyvista")
    module = example("MedialisThickness.py")
    polydata = vtk.vtkPolyData()
    polydata.DeepCopy(medialis.to_pyvista(plate))
    made, spots = module.with_thickness(polydata, 0.5)
    values = pyvista.wrap(made)["thickness"]
    assert len(values) == plate.point_count and np.isfinite(values).all()
    assert spots and spots[0]["value"] < 0.5
    curve = pyvista.wrap(module.curve_of(polydata))
    graph = medialis.run("curve_skeleton", plate).graph
    assert np.array_equal(np.asarray(curve.points), graph.nodes)
    assert curve.n_cells == len(graph.edges)
    assert set(curve.cell_data) == {"branch"} and set(curve.point_data) == {"radius"}


def test_the_macro_checks_a_body_of_freecad(capfd):
    """A box of 30 x 20 x 5 with a pocket that leaves a floor of 0.6."""
    freecad = needed("FreeCAD")
    needed("MeshPart")
    import Part

    macro = runpy.run_path(os.fspath(EXAMPLES / "thickness_check.FCMacro"))
    document = freecad.newDocument("test")
    pocket = Part.makeBox(10, 10, 4.4, freecad.Vector(10, 5, 0.6))
    body = document.addObject("Part::Feature", "Tray")
    body.Shape = Part.makeBox(30, 20, 5).cut(pocket)
    spots = macro["thin_spots"](macro["shape_of"](body))
    assert len(spots) == 1 and spots[0]["value"] == pytest.approx(0.6, rel=0.01)
    group = macro["mark"](document, body, spots)
    (ball,) = group.Group
    assert ball.Radius.Value == pytest.approx(0.3, rel=0.01)
    x, y, z = ball.Placement.Base
    assert 10 < x < 20 and 5 < y < 15 and z == pytest.approx(0.3, abs=0.02)
    assert macro["mark"](document, body, []) is None
    freecad.closeDocument("test")
    assert sys.modules["FreeCAD"] is freecad
