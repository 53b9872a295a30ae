"""The operation `medial_mesh`: files, levels, cover, edited meshes, importance."""

import json
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

import medialis
from closed_forms import box_mesh
from medialis.base.errors import FileError, InvalidShapeError
from medialis.medial_meshes.operation import MeshLevels

FAST = {"balls": 24, "quality": "fast", "cell": 0.03}


@pytest.fixture(scope="module")
def creature():
    return medialis.organic_shape(56)


@pytest.fixture(scope="module")
def result(creature):
    return medialis.run("medial_mesh", creature, cover=True, levels=2, **FAST)


@pytest.fixture(scope="module")
def folder(result, tmp_path_factory):
    made = tmp_path_factory.mktemp("medial") / "out"
    medialis.write_result(result, made, pictures=medialis.Pictures(main=False))
    return made


def layers(result):
    return {layer.name: layer for layer in result.layers}


@pytest.mark.slow
def test_the_envelope_is_written_for_other_programs(result, folder):
    surface = layers(result)["medial_mesh_envelope"]
    again = medialis.read_shape(folder / "medial_mesh_envelope.obj")
    assert np.array_equal(again.points, surface.points)
    assert np.array_equal(again.faces, surface.faces)
    trimesh = pytest.importorskip("trimesh")
    scene = trimesh.load(folder / "medial_mesh_envelope.glb", process=False)
    (found,) = scene.geometry.values()
    assert np.array_equal(found.faces, surface.faces)
    # Single precision: half a unit in the last place of the largest coordinate.
    assert np.abs(found.vertices - surface.points).max() <= np.abs(surface.points).max() * 2.0**-24
    outward = (found.vertex_normals * found.vertices).sum()  # by trimesh, from the file
    assert outward > 0 and found.is_watertight


@pytest.mark.slow
def test_the_balls_are_written_for_robots(creature, result, folder):
    cover = medialis.ball_cover(medialis.read_ma(folder / "medial_mesh.ma"), creature)
    said = json.loads((folder / "ball_cover.json").read_text())
    radii = [ball["radius"] for ball in said["spheres"]]
    assert np.array_equal(radii, layers(result)["ball_cover"].attributes["radius"])
    assert np.array_equal(radii, cover.radii)
    assert said["excess_volume"] == result.values["cover_excess"] == cover.excess
    robot = ElementTree.parse(folder / "ball_cover.urdf").getroot()
    assert len(robot.findall("./link/collision/geometry/sphere")) == len(cover)
    centers = np.array([ball["center"] for ball in said["spheres"]])
    apart = np.linalg.norm(creature.points[:, None] - centers, axis=2) - radii
    assert (apart.min(axis=1) <= 0).all()


@pytest.mark.slow
def test_results_read_back_say_what_they_are_written_as(result, folder):
    again = medialis.read_result(folder)
    for name, layer in layers(result).items():
        assert layers(again)[name].formats == layer.formats
        assert dict(layers(again)[name].facts) == dict(layer.facts)


@pytest.mark.slow
def test_an_edited_mesh_is_measured_and_rebuilt(creature, result, folder, tmp_path):
    path = folder / "medial_mesh.ma"
    again = medialis.run("medial_mesh", creature, edited=str(path), cell=FAST["cell"])
    for name in ("balls", "largest_error", "position", "sheets", "fewest_balls"):
        expected = result.values["balls" if name == "fewest_balls" else name]
        assert again.values[name] == expected
    envelope = layers(result)["medial_mesh_envelope"]
    assert np.array_equal(layers(again)["medial_mesh_envelope"].points, envelope.points)
    assert layers(again)["medial_mesh"].levels is None
    mesh = medialis.read_ma(path)
    lone = medialis.MedialMesh(mesh.centers[:1] + 1.0, [0.25], [], [])
    medialis.write_ma(tmp_path / "lone.ma", lone)
    moved = medialis.run("medial_mesh", creature, edited=tmp_path / "lone.ma")
    points = layers(moved)["medial_mesh_envelope"].points
    apart = np.abs(np.linalg.norm(points - lone.centers, axis=1) - 0.25)
    # Chords of cells of a hundredth of the diagonal of the ball (4 radii at most).
    assert apart.max() < (0.01 * 4) ** 2 * 0.25
    with pytest.raises(FileError):
        medialis.run("medial_mesh", creature, edited=tmp_path / "missing.ma")
    point = medialis.MedialMesh([[0, 0, 0]], [0.0], [], [])  # divided by 0 once
    far = np.linalg.norm(creature.points, axis=1).max()
    assert medialis.envelope_distance(point, creature).surface_to_envelope == pytest.approx(far)
    medialis.write_ma(tmp_path / "point.ma", point)
    with pytest.raises(InvalidShapeError, match="radius 0"):
        medialis.run("medial_mesh", creature, edited=tmp_path / "point.ma")
    cloud = medialis.Shape(creature.points, creature.normals)
    with pytest.raises(InvalidShapeError, match="point cloud"):
        medialis.run("medial_mesh", cloud, edited=path)


@pytest.mark.slow
def test_far_away_files_and_levels_are_where_the_shape_is(creature, folder, tmp_path):
    far = np.array([1e6, -2e6, 0.0])  # whole numbers: exact differences
    shape = medialis.make_shape(creature.points + far, creature.faces)
    near = medialis.make_shape(shape.points - far, creature.faces)
    here, there = (medialis.run("medial_mesh", s, **FAST) for s in (near, shape))
    # One unit in the last place of two million.
    close = {"rtol": 0.0, "atol": 2.0**-32}
    levels = [layers(found)["medial_mesh"].levels for found in (here, there)]
    for count in (5, 24, 400):
        a, b = (one.layer(count).points for one in levels)
        assert np.allclose(a + far, b, **close)
    medialis.write_result(there, tmp_path / "far", pictures=medialis.Pictures(main=False))
    mesh = medialis.read_ma(tmp_path / "far" / "medial_mesh.ma")
    assert np.allclose(mesh.centers, layers(here)["medial_mesh"].points + far, **close)
    again = medialis.run(
        "medial_mesh", shape, edited=tmp_path / "far" / "medial_mesh.ma", cell=0.03
    )
    error = there.values["largest_error"]
    assert again.values["largest_error"] == pytest.approx(error, abs=1e-8)


def test_coarser_levels_halve_the_balls(result):
    found = layers(result)
    assert [len(found[f"medial_mesh_level_{k}"].points) for k in (1, 2)] == [12, 6]
    levels = found["medial_mesh"].levels
    assert (levels.fewest, levels.most) == tuple(
        result.values[name] for name in ("fewest_balls", "most_balls")
    )
    level = levels.layer(12)
    assert np.array_equal(level.points, found["medial_mesh_level_1"].points)


def test_levels_are_kept_as_bytes(result):
    levels = layers(result)["medial_mesh"].levels
    again = MeshLevels.unpacked(levels.packed())
    assert (again.fewest, again.most) == (levels.fewest, levels.most)
    for count in (1, 7, 24, 100, 10**6):
        a, b = levels.layer(count), again.layer(count)
        assert np.array_equal(a.points, b.points)
        for name, values in {**a.attributes, **a.face_attributes}.items():
            assert np.array_equal({**b.attributes, **b.face_attributes}[name], values)


@pytest.mark.slow
def test_importance_simplifies(creature):
    whole = medialis.run("medial_mesh", creature, importance=True, **FAST)
    some = medialis.run("medial_mesh", creature, threshold=0.06, **FAST)
    layer = layers(whole)["medial_mesh"]
    importance = layer.attributes["importance"]
    assert layer.filter_by == "importance" and np.isfinite(importance).all()
    kept = {tuple(p) for p in layers(some)["medial_mesh"].points.tolist()}
    high = layer.points[importance >= 0.06 * creature.diagonal]
    assert {tuple(p) for p in high.tolist()} <= kept and len(kept) < len(importance)
    for name in ("parts", "loops", "hollows"):
        assert some.values[name] == whole.values[name]
    (message,) = [m for m in some.messages if m.code == "less_important"]
    assert message.data == {"balls": len(importance) - len(kept), "of": len(importance)}
    assert layers(some)["medial_mesh"].levels is None


def test_a_box_has_four_junctions():
    """At each end of its ridge two, where six sheets and four seams meet."""
    result = medialis.run("medial_mesh", box_mesh((1.0, 0.8, 0.6), 0.2), balls=12)
    (layer,) = [one for one in result.layers if one.name == "medial_mesh_junctions"]
    assert result.values["junctions"] == len(layer.points) == 4
    assert np.allclose(np.abs(layer.points), [0.2, 0.1, 0.0], atol=1e-6)
    assert np.allclose(layer.attributes["radius"], 0.3, atol=1e-6)
    assert layer.attributes["seams"].tolist() == [4] * 4
