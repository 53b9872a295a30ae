"""Files for parsers of others: hostile ones end in a sentence, within limits, and nothing leaks."""

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import medialis
from fuzz.good_files import assembly, good_files, three_mf
from fuzz.nasty_shapes import grid_box
from medialis.base.children import Ended
from medialis.formats import foreign
from medialis.formats.foreign import Foreign, _taken, parsed_foreign
from medialis.formats.meshes import read_mesh
from medialis.formats.three_mf import parse_three_mf

PLATE = Path(__file__).parent / "data" / "plate_with_hole.step"
METRE = b"SI_UNIT(.MILLI.,.METRE.)"
MESH = "<mesh><vertices>{}</vertices><triangles>{}</triangles></mesh>"

needs_cascadio = pytest.mark.skipif(
    importlib.util.find_spec("cascadio") is None,
    reason='cascadio is not installed (pip install "medialis[cad]")',
)


def cube(extra=""):
    """The XML of a cube of 1 mm, object 1."""
    points, faces = grid_box(1)
    vertices = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in points.tolist())
    rows = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in faces.tolist())
    return f'<object id="1" type="model">{MESH.format(vertices, rows + extra)}</object>'


def volume(points, faces):
    return np.linalg.det(points[faces]).sum() / 6


@needs_cascadio
@pytest.mark.slow
def test_a_step_file_that_spins_is_refused_in_time(tmp_path, monkeypatch):
    """The unit EXA kept cascadio busy for ever (fixed)."""
    monkeypatch.setattr(foreign, "SECONDS", 1.5)
    data = PLATE.read_bytes()
    assert data.count(METRE) == 1
    path = tmp_path / "exa.step"
    path.write_bytes(data.replace(METRE, b"SI_UNIT(.EXA.,.METRE.)"))
    with pytest.raises(medialis.InvalidShapeError, match=r"2 s of processor time.* 0\.019 MB"):
        read_mesh(path)


@needs_cascadio
@pytest.mark.slow
def test_a_full_temporary_folder_does_not_damage_a_step_file(monkeypatch, tmp_path):
    """It was told as damaged, where the temporary folder was full (fixed): none is used."""
    for name in ("TMPDIR", "TEMP", "TMP"):
        monkeypatch.setenv(name, str(tmp_path / "not" / "there"))
    monkeypatch.setattr("tempfile.tempdir", None)
    monkeypatch.setattr("tempfile._candidate_tempdir_list", lambda: [str(tmp_path / "gone")])
    mesh = read_mesh(PLATE)
    assert mesh.unit == "mm" and mesh.patches.max() == 6


def test_the_reason_of_an_end_is_told(monkeypatch):
    told = {}

    def ended(code, given, limits):
        told["limits"] = limits
        raise Ended("it ended with code -11", slow=told["slow"])

    monkeypatch.setattr(foreign, "answer_of", ended)
    for slow, words in ((True, "limit for 2 MB"), (False, "code -11.*more memory than 0.95 GB")):
        told["slow"] = slow
        with pytest.raises(medialis.InvalidShapeError, match=words):
            parsed_foreign("3mf", bytes(2_000_000), "a.3mf")
    assert told["limits"].seconds == 26.0 and told["limits"].memory == 950_000_000


@pytest.mark.parametrize(
    ("told", "rest"),
    [
        (b'{"points": 1, "faces": 0, "patches": 0, "unit": null}', bytes(8)),
        (b'{"points": -1, "faces": 0, "patches": 0, "unit": null}', b""),
        (b'{"points": 1, "faces": 0, "patches": 3, "unit": null}', bytes(36)),
        (b'{"refused": "%s"}' % (b"x" * 100_000), b""),
        (b"no json", b""),
        (b"", b""),
    ],
)
def test_an_answer_that_a_hostile_file_wrote_is_not_trusted(told, rest):
    with pytest.raises((ValueError, medialis.InvalidShapeError)) as caught:
        _taken(told + b"\n" + rest)
    assert len(str(caught.value)) < 1200


def test_an_answer_is_what_was_sent():
    head = {"points": 2, "faces": 1, "patches": 1, "unit": "millimeter"}
    points, faces = np.arange(6.0).reshape(2, 3), np.array([[0, 1, 0]])
    body = points.tobytes() + faces.astype("<i8").tobytes() + np.array([4], "<i4").tobytes()
    found = _taken(json.dumps(head).encode() + b"\n" + body)
    assert isinstance(found, Foreign) and found.unit == "mm" and found.patches.tolist() == [4]
    assert np.array_equal(found.points, points) and np.array_equal(found.faces, faces)


GUARDED = """
import os, socket, subprocess, sys
from medialis.formats.foreign import guard
folder, other = sys.argv[1:]
guard(folder)
with open(os.path.join(folder, "here")) as stream:
    assert stream.read() == "1"
import wave  # a module is read from where Python is
refused = 0
for attempt in (
    lambda: open(other),
    lambda: open(os.path.join(folder, "..", "other")),
    lambda: open(os.path.join(folder, "link")),
    lambda: open(os.path.join(folder, "new"), "w"),
    lambda: os.open(os.path.join(folder, "new"), os.O_CREAT | os.O_RDWR),
    lambda: socket.create_connection(("127.0.0.1", 9)),
    lambda: subprocess.run([sys.executable, "-c", ""]),
    lambda: os.system("true"),
    lambda: os.remove(os.path.join(folder, "here")),
):
    try:
        attempt()
    except PermissionError:
        refused += 1
os.write(1, str(refused).encode())
"""


@pytest.mark.slow
def test_a_parser_in_python_opens_nothing_outside_of_the_folder(tmp_path):
    folder, other = tmp_path / "folder", tmp_path / "other"
    folder.mkdir()
    other.write_text("2")
    (folder / "here").write_text("1")
    (folder / "link").symlink_to(other)
    run = subprocess.run(
        [sys.executable, "-c", GUARDED, folder, other], capture_output=True, text=True
    )
    assert (run.stdout, run.returncode) == ("9", 0), run.stderr
    assert sorted(path.name for path in folder.iterdir()) == ["here", "link"]


@pytest.mark.parametrize(("parts", "items"), [(1, 1), (4, 7), (8, 8), (40, 3)])
def test_an_assembly_loses_no_body(parts, items):
    """Of 8 x 8 bodies 42 were read, without a word (fixed)."""
    points, faces, unit, bodies = parse_three_mf(assembly(parts, items))
    assert len(np.unique(bodies)) == parts * items
    one = grid_box(1)
    assert len(points) == parts * items * len(one[0]) and unit == "mm"
    assert len(faces) == parts * items * len(one[1])
    assert volume(points, faces) == pytest.approx(parts * items)
    assert points.max(axis=0).tolist() == [2 * parts - 1, 2 * items - 1, 1]


def test_placed_parts_are_turned_scaled_and_mirrored_in_turn():
    turned = '<component objectid="1" transform="0 2 0 -1 0 0 0 0 1 10 0 0"/>'
    middle = f'<object id="2"><components>{turned}</components></object>'
    item = '<item objectid="2" transform="1 0 0 0 1 0 0 0 -1 0 5 0"/>'
    points, faces, unit, _ = parse_three_mf(three_mf(cube() + middle, item, unit="inch"))
    assert points.min(axis=0).tolist() == [9, 5, -1] and points.max(axis=0).tolist() == [10, 7, 0]
    assert volume(points, faces) == pytest.approx(2.0) and unit == "in"  # outward still


def test_a_mesh_that_nothing_places_is_not_read(tmp_path):
    (tmp_path / "a.3mf").write_bytes(three_mf(cube(), ""))
    with pytest.raises(medialis.InvalidShapeError, match="no vertices"):
        read_mesh(tmp_path / "a.3mf")


def placing(number, placed, times):
    """The XML of an object that places another one so many times."""
    parts = f'<component objectid="{placed}"/>' * times
    return f'<object id="{number}"><components>{parts}</components></object>'


NESTED = "".join(placing(k, k - 1, 20) for k in range(2, 12))
LOOP = placing(2, 2, 1)
ITEM = '<item objectid="{}"/>'


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (three_mf(cube(), ITEM.format(9)), "object '9', which is not there"),
        (three_mf(cube() + LOOP, ITEM.format(2)), "a part of itself"),
        (three_mf(cube() + NESTED, ITEM.format(11)), "vertices; at most 2147483647"),
        (three_mf(cube('<triangle v1="0" v2="1" v3="8"/>'), ITEM.format(1)), "beyond the 8"),
        (three_mf(cube(), '<item objectid="1" transform="1 2 3"/>'), "3 numbers, not 12"),
        (three_mf(cube(), ITEM.format(1), unit="parsec"), "'parsec' is not known"),
        (three_mf(cube(), ITEM.format(1), before='<!DOCTYPE a [<!ENTITY b "c">]>'), "forbids"),
        (assembly(2, 2)[:-30], "damaged"),
        (b"PK\x03\x04", "damaged"),
    ],
    ids=["missing", "loop", "bomb", "corner", "transform", "unit", "entity", "cut", "none"],
)
def test_hostile_assemblies_are_refused_in_a_sentence(data, words):
    with pytest.raises(medialis.InvalidShapeError, match=words):
        parse_three_mf(data)


@pytest.mark.slow
@pytest.mark.parametrize("ending", [".glb", ".gltf", ".dae", ".3mf"])
def test_good_files_are_read_in_a_process_of_their_own(tmp_path, ending):
    pytest.importorskip("trimesh")
    if ending == ".dae":
        pytest.importorskip("collada")
    faces = grid_box(3)[1]
    for number, good in enumerate(one for one in good_files() if one.ending == ending):
        path = tmp_path / f"{number}{ending}"
        path.write_bytes(good.data)
        mesh = read_mesh(path)
        bodies = len(mesh.faces) / len(faces) if number == 0 else 12
        assert volume(mesh.points, mesh.faces) == pytest.approx(bodies, rel=1e-6)


@pytest.mark.parametrize("ending", ["glb", "3mf"])
def test_bodies_of_a_scene_that_touch_stay_apart(tmp_path, ending):
    trimesh = pytest.importorskip("trimesh")
    scene = trimesh.Scene()
    for k in range(3):
        box = trimesh.creation.box()
        box.apply_translation([k, 0, 0])
        scene.add_geometry(box, node_name=f"node{k}", geom_name=f"box{k}")
    path = tmp_path / f"a.{ending}"
    path.write_bytes(scene.export(file_type=ending))
    mesh = read_mesh(path)
    assert np.unique(mesh.bodies, return_counts=True)[1].tolist() == [12, 12, 12]
    shape = medialis.read_shape(path)
    assert shape.part_count == shape.body_contacts.count == 3 and shape.topology.is_solid
    assert [contact.bodies for contact in shape.body_contacts.contacts] == [(0, 1), (1, 2)]
