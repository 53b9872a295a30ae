"""Twelve ways to other libraries and back, with what is installed: the same shape, graph, values.

1 trimesh, 2 PyVista, 3 Open3D, 4 meshio, 5 pymeshlab, 6 pandas (meshes and clouds); 7 networkx,
8 navis, 9 SWC (graphs); 10 SimpleITK, 11 NIfTI (volumes of labels); 12 VTP files as VTK reads them.
`test_other_libraries.py` has stand-ins of those that may be missing.
"""

import subprocess
import sys

import numpy as np
import pytest

import medialis
from medialis.shape.graph import ENCLOSED, Enclosure
from medialis.shape.reading import as_shape
from medialis.show.reports.measures import distance_to_surface


@pytest.fixture(scope="module")
def result(default_run):
    return default_run("thickness")


@pytest.fixture(scope="module")
def curve():
    return medialis.run("curve_skeleton", medialis.sample_shape("molecule", 56)).graph


def needed(name):
    return pytest.importorskip(name, reason=f"{name} is not installed", exc_type=ImportError)


def check_mesh(mesh, layer):
    """The mesh comes back as the same shape, bit by bit, and so does what is computed from it."""
    again = as_shape(mesh)
    assert np.array_equal(again.points, layer.points) and np.array_equal(again.faces, layer.faces)


def test_1_trimesh(result):
    needed("trimesh")
    mesh, layer = medialis.to_trimesh(result), result.layers[0]
    check_mesh(mesh, layer)
    assert np.array_equal(mesh.vertex_attributes["thickness"], layer.attributes["thickness"])


@pytest.mark.slow
def test_2_pyvista(result, curve):
    needed("pyvista")
    mesh, layer = medialis.to_pyvista(result), result.layers[0]
    check_mesh(mesh, layer)
    assert np.array_equal(mesh.point_data["thickness"], layer.attributes["thickness"])
    assert medialis.to_pyvista(curve).length > 0


def test_3_open3d(result, curve):
    needed("open3d")
    mesh, layer = medialis.to_open3d(result), result.layers[0]
    check_mesh(mesh, layer)
    check_mesh(mesh.to_legacy(), layer)
    assert np.array_equal(mesh.vertex["thickness"].numpy()[:, 0], layer.attributes["thickness"])
    lines = medialis.to_open3d(curve)
    assert np.array_equal(lines.line.indices.numpy(), curve.edges)
    assert np.array_equal(lines.point["radius"].numpy()[:, 0], curve.radii)
    shape = medialis.organic_shape(56)
    cloud = medialis.to_open3d(medialis.Shape(shape.points, shape.normals))
    again = medialis.to_open3d(cloud)
    assert np.allclose(again.point.normals.numpy(), shape.normals, atol=1e-15)


def test_4_meshio(result, curve, tmp_path):
    meshio = needed("meshio")
    layer = result.layers[0]
    mesh = medialis.to_meshio(result)
    check_mesh(mesh, layer)
    mesh.write(tmp_path / "a.vtu")
    again = meshio.read(tmp_path / "a.vtu")
    check_mesh(again, layer)
    assert np.array_equal(again.point_data["thickness"], layer.attributes["thickness"])
    assert np.array_equal(medialis.to_meshio(curve).cells_dict["line"], curve.edges)
    balls = medialis.surface_skeleton(medialis.organic_shape(56))
    assert len(medialis.to_meshio(balls).cells_dict["vertex"]) == balls.valid.sum()


def test_5_pymeshlab(result):
    pymeshlab = needed("pymeshlab")
    layer = result.layers[0]
    mesh = pymeshlab.Mesh(layer.points, layer.faces, v_scalar_array=layer.attributes["thickness"])
    check_mesh(mesh, layer)
    assert np.array_equal(mesh.vertex_scalar_array(), layer.attributes["thickness"])


def test_6_pandas(result):
    needed("pandas")
    shape = medialis.organic_shape(56)
    again = medialis.to_pandas(medialis.Shape(shape.points, shape.normals))
    cloud = medialis.surface_skeleton(again, refine=0, denoise="off").surface
    assert np.array_equal(cloud.points, shape.points)
    assert np.allclose(cloud.normals, shape.normals, atol=1e-15)
    table = medialis.to_pandas(result)
    assert table.thickness.min() == result.layers[0].attributes["thickness"].min()


def check_curve(again, curve):
    assert np.array_equal(again.nodes, curve.nodes) and np.array_equal(again.radii, curve.radii)
    pairs = [{tuple(sorted(edge)) for edge in one.edges.tolist()} for one in (again, curve)]
    assert pairs[0] == pairs[1]
    assert again.length == pytest.approx(curve.length) and again.loops == curve.loops


def test_7_networkx(curve):
    needed("networkx")
    assert curve.loops == 1
    check_curve(medialis.as_curve_skeleton(medialis.to_networkx(curve)), curve)


def test_8_navis(curve):
    needed("navis")
    neuron = medialis.to_navis(curve, units="1 mm")
    again = medialis.as_curve_skeleton(neuron)
    # A neuron is a tree: one edge of the ring is cut.
    assert again.loops == 0 and len(again.edges) == len(curve.edges) - 1
    assert np.array_equal(np.sort(again.radii), np.sort(curve.radii))
    assert neuron.cable_length == pytest.approx(again.length)
    assert neuron.n_leafs + neuron.n_root >= len(curve.end_points)


def test_9_swc(curve, tmp_path):
    medialis.write_curve_skeleton(tmp_path / "a.swc", curve)
    again = medialis.as_curve_skeleton(tmp_path / "a.swc")
    assert again.loops == 1 and again.length == pytest.approx(curve.length)
    assert np.array_equal(np.sort(again.radii), np.sort(curve.radii))


def voxels(shape, size):
    """Which voxels of a grid are inside, and where its first one lies."""
    low, high = shape.bounds
    counts = np.ceil((high - low) / size).astype(int) + 3
    origin = low - size
    grid = np.stack(np.meshgrid(*[np.arange(n) for n in counts], indexing="ij"), axis=-1)
    times = Enclosure(shape).times(origin + size * grid.reshape(-1, 3))
    return (times > ENCLOSED).reshape(counts), origin


@pytest.fixture(scope="module")
def bone():
    """A shape, its voxels and where they lie."""
    shape = medialis.organic_shape(56)
    size = 0.03 * shape.diagonal
    return shape, *voxels(shape, size), size


def check_volume(found, shape, size):
    """Surfaces are less than a voxel apart, everywhere, both ways."""
    assert (found.edge_twins >= 0).all()
    assert distance_to_surface(found.points, shape).max() < np.sqrt(3) * size


@pytest.mark.slow
def test_10_simpleitk(bone):
    sitk, shape = needed("SimpleITK"), bone[0]
    needed("skimage")
    _, inside, origin, size = bone
    image = sitk.GetImageFromArray(inside.astype(np.uint16).T * 4)
    image.SetSpacing([size] * 3)
    image.SetOrigin(origin.tolist())
    check_volume(medialis.label_surfaces(image)[4], shape, size)


def test_11_nifti(bone, tmp_path):
    nibabel, shape = needed("nibabel"), bone[0]
    needed("skimage")
    _, inside, origin, size = bone
    affine = np.diag([size, size, size, 1.0])
    affine[:3, 3] = origin
    nibabel.save(nibabel.Nifti1Image(inside.astype(np.uint8), affine), tmp_path / "a.nii.gz")
    check_volume(medialis.label_surfaces(tmp_path / "a.nii.gz")[1], shape, size)


def test_12_vtp(result, curve, tmp_path):
    pyvista = needed("pyvista")
    layer = result.layers[0]
    medialis.write_mesh(tmp_path / "a.vtp", result)
    mesh = pyvista.read(tmp_path / "a.vtp")
    check_mesh(mesh, layer)
    assert np.array_equal(mesh.point_data["thickness"], layer.attributes["thickness"])
    medialis.write_mesh(tmp_path / "b.vtp", curve)
    assert np.array_equal(pyvista.read(tmp_path / "b.vtp").lines.reshape(-1, 3)[:, 1:], curve.edges)


@pytest.mark.slow
def test_importing_medialis_loads_none_of_them():
    names = "trimesh pyvista vtk open3d meshio pymeshlab pandas networkx navis SimpleITK nibabel"
    program = (
        "import sys, medialis, medialis.exchange.libraries, medialis.exchange.label_volumes, "
        "medialis.exchange.libraries, medialis.exchange.libraries\n"
        f"print([n for n in '{names} skimage numba scipy'.split() if n in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout.strip() == "[]", done.stderr
