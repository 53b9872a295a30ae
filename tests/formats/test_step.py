"""STEP files: the faces of a plate of 100 x 60 x 5 mm with a hole of radius 10."""

import importlib.util
import math
from pathlib import Path

import numpy as np
import pytest

import medialis
from medialis.base.progress import Progress
from medialis.formats import step
from medialis.formats.meshes import read_mesh
from medialis.formats.step import _unit_of
from medialis.shape.reading import _made, _Told

PLATE = Path(__file__).parent / "data" / "plate_with_hole.step"
METRIC = b"( LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT(.MILLI.,.METRE.) )"
INCH = (
    b"( CONVERSION_BASED_UNIT('INCH',#900) LENGTH_UNIT() NAMED_UNIT(#902) )",
    b";\n#900 = LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(25.4),#901);\n#901 = " + METRIC,
    b";\n#902 = DIMENSIONAL_EXPONENTS(1.,0.,0.,0.,0.,0.,0.)",
)
HOLE = math.pi * 10**2

needs_cascadio = pytest.mark.skipif(
    importlib.util.find_spec("cascadio") is None,
    reason='cascadio is not installed (pip install "medialis[cad]")',
)


@pytest.mark.slow
@needs_cascadio
def test_the_shape_is_closed_and_each_face_of_the_model_is_a_patch():
    shape = medialis.read_shape(PLATE)
    assert shape.unit == "mm" and shape.closed_components.all()
    low, high = shape.bounds
    assert low.tolist() == [0, 0, 0] and high.tolist() == [100, 60, 5]
    areas = np.bincount(shape.patches, weights=shape.face_areas)
    # A circle of n chords, each turned by 0.2 radians at most, is 0.7 % less than round at most.
    exact = sorted([500, 500, 300, 300, 20 * math.pi * 5, 6000 - HOLE, 6000 - HOLE])
    assert sorted(areas) == pytest.approx(exact, rel=0.007)
    normals = [shape.face_normals[shape.patches == patch] for patch in range(7)]
    flat = [bool(np.allclose(rows, rows[0], atol=1e-6)) for rows in normals]
    assert flat.count(True) == 6


@pytest.mark.slow
@needs_cascadio
def test_curved_faces_are_met_to_a_share_of_the_size():
    shape = medialis.read_shape(PLATE)
    hole = next(p for p in range(7) if len(np.unique(shape.face_normals[shape.patches == p])) > 12)
    faces = shape.faces[shape.patches == hole]
    radius = np.linalg.norm(shape.points[faces][..., :2] - [50, 30], axis=-1)
    assert radius == pytest.approx(10.0, abs=1e-4)  # corners lie on it
    middles = shape.points[faces].mean(axis=1)[:, :2] - [50, 30]
    assert np.linalg.norm(middles, axis=1).min() >= 10.0 - 3e-4 * shape.diagonal
    assert np.degrees(shape.edge_bends).max() == pytest.approx(90.0, abs=7.0)
    inside = np.sort(np.degrees(shape.edge_bends))
    assert not ((inside > 12) & (inside < 80)).any()  # facets of the hole, and its rim


@pytest.mark.slow
@needs_cascadio
def test_inches_are_inches(tmp_path):
    data = PLATE.read_bytes()
    assert data.count(METRIC) == 1
    (tmp_path / "inch.stp").write_bytes(data.replace(METRIC, b"".join(INCH)))
    shape = medialis.read_shape(tmp_path / "inch.stp")
    assert shape.unit == "in"
    assert np.ptp(shape.points, axis=0) == pytest.approx([100, 60, 5], rel=1e-6)
    assert medialis.read_shape(tmp_path / "inch.stp", unit="mm").unit == "mm"


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        (METRIC, "mm"),
        (METRIC.replace(b".MILLI.", b"$"), "m"),
        (METRIC.replace(b".MILLI.", b".CENTI."), "cm"),
        (b"".join(INCH), "in"),
        (METRIC + b";" + METRIC.replace(b".MILLI.", b"$"), "mm"),  # several: millimetres
        (b"", "mm"),
        (b"(CONVERSION_BASED_UNIT('DEGREE',#4) NAMED_UNIT(#5) PLANE_ANGLE_UNIT());" + METRIC, "mm"),
    ],
)
def test_the_unit_that_a_file_says(text, unit):
    assert _unit_of(text) == unit


@pytest.mark.slow
@needs_cascadio
def test_layers_on_the_shape_tell_the_faces_of_the_model(tmp_path):
    shape = medialis.read_shape(PLATE)
    result = medialis.run("wall_check", shape, minimum="4mm", maximum="6mm")
    assert result.values["passed"] and result.values["typical"] == pytest.approx(5.0, rel=1e-4)
    layer = result.layers[0]
    assert np.array_equal(layer.face_attributes["cad_face"], shape.patches)
    medialis.write_mesh(tmp_path / "a.inp", layer)
    sets = [line for line in (tmp_path / "a.inp").read_text().splitlines() if "*ELEMENT" in line]
    assert sets == [f"*ELEMENT, TYPE=S3, ELSET=CAD_FACE_{patch}" for patch in range(7)]


@pytest.mark.slow
@needs_cascadio
def test_planes_and_normals_are_those_of_the_model():
    """Normals of the hole point to its axis, exactly; at edges there are none in the model."""
    mesh, shape = read_mesh(PLATE), medialis.read_shape(PLATE)
    assert len(np.unique(shape.planes)) == 7 and (shape.planes == -1).any()
    hole = shape.planes < 0
    assert len(np.unique(shape.patches[hole])) == 1
    assert hole.sum() == (shape.patches == shape.patches[hole][0]).sum()
    assert not mesh.normals.any()  # each of its points lies on an edge
    fine = medialis.refine(shape, longest_edge=0.01)
    inside = np.abs(np.linalg.norm(fine.points[:, :2] - [50, 30], axis=1) - 10.0) < 0.1
    out = fine.points[inside, :2] - [50, 30]
    # A quarter of the height of chords that turn by 0.1 radians is left.
    assert np.linalg.norm(out, axis=1) == pytest.approx(10.0, abs=10.0 * 0.1**2 / 8 / 4 + 1e-4)
    flat = fine.planes >= 0
    assert fine.face_normals[flat] == pytest.approx(np.round(fine.face_normals[flat]), abs=1e-12)


def test_normals_of_a_model_stay_and_others_are_computed():
    points, faces = np.eye(4, 3, -1), np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    given = np.zeros((4, 3))
    given[1] = [0.0, 0.6, 0.8]
    told = _Told(planes=np.arange(4, dtype=np.int32))
    shape = _made(points, faces, given, told, True, Progress())
    assert shape.normals[1].tolist() == [0.0, 0.6, 0.8]
    assert shape.planes.tolist() == [0, 1, 2, 3]
    rest = medialis.make_shape(points, faces).normals
    assert np.array_equal(shape.normals[[0, 2, 3]], rest[[0, 2, 3]])


def test_patches_follow_repair():
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 0]], float)
    faces = [[0, 2, 1], [0, 0, 1], [0, 4, 3], [1, 2, 3], [0, 3, 2]]
    shape = medialis.make_shape(points, faces, repair=True, patches=[5, 6, 7, 8, 9])
    assert shape.patches.tolist() == [5, 7, 8, 9]
    with pytest.raises(medialis.InvalidShapeError, match="patches must have shape"):
        medialis.make_shape(points, faces, patches=[1, 2])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["plate.step", "plate.stp", "plate.ply"])
def test_what_is_no_model_is_refused_in_one_sentence(tmp_path, name):
    (tmp_path / name).write_bytes(b"ISO-10303-21;\nHEADER;\nENDSEC;\nDATA;\nENDSEC;\nEND-ISO")
    with pytest.raises(medialis.InvalidShapeError, match="STEP") as caught:
        medialis.read_shape(tmp_path / name)
    assert name in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.skipif(importlib.util.find_spec("cascadio") is not None, reason="cascadio is there")
def test_without_cascadio_a_sentence_says_what_to_install():
    with pytest.raises(medialis.InvalidShapeError, match=r'pip install "medialis\[cad\]"'):
        medialis.read_shape(PLATE)


def test_cad_files_are_known_by_their_beginning(monkeypatch):
    parsed = "medialis.formats.meshes.parsed_foreign"
    monkeypatch.setattr(parsed, lambda kind, data, name: pytest.fail(f"parsed as {kind}"))
    with pytest.raises(pytest.fail.Exception, match="parsed as step"):
        read_mesh(PLATE)


def test_solids_that_touch_share_no_points(monkeypatch):
    """18 solids of an assembly were welded into 6 components."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    flat, patch = np.zeros(4, bool), np.arange(4)
    below = corners * [1, 1, -1]
    pieces = [
        step._Piece(points, np.zeros((4, 3)), triangles, patch, flat)
        for points, triangles in ((corners, faces), (below, faces[:, ::-1]))
    ]
    monkeypatch.setattr(step, "_pieces", lambda data: iter(pieces))
    points, triangles, _, _, _, _, bodies = step.parse_step(b"")
    assert len(points) == 8 and bodies.tolist() == [0] * 4 + [1] * 4
    assert not set(triangles[:4].ravel()) & set(triangles[4:].ravel())
