"""Files of armatures: there and back, and what is wrong with a file is said."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import medialis
from medialis.rigging.armature import write_armature_json, write_bvh
from medialis.show.writing import Pictures

CHAIN = medialis.Armature(
    [[0, 0, 0], [0, 0, 1], [1, 0, 2], [0, 0, 1]],
    [[0, 0, 1], [1, 0, 2], [2, 0, 2.5], [-1, 0.25, 2]],
    [-1, 0, 1, 0],
    ("hips", "left arm", "left hand", "right arm"),
)


def same(found, wanted, names=None):
    assert found.names == (names or wanted.names)
    assert found.parents.tolist() == wanted.parents.tolist()
    assert np.abs(found.heads - wanted.heads).max() < 1e-6
    ends = np.bincount(found.parents[found.parents >= 0], minlength=found.count)
    leaves = ends < 2  # where several hang on a bone its end is in their middle
    assert np.abs(found.tails - wanted.tails)[leaves].max() < 1e-6


def test_json_comes_back_with_names_parents_and_lengths(tmp_path):
    write_armature_json(tmp_path / "a.json", CHAIN, "mm")
    same(medialis.read_armature(tmp_path / "a.json"), CHAIN)
    content = json.loads((tmp_path / "a.json").read_text())
    assert content["unit"] == "mm" and content["bones"][1]["parent"] == "hips"
    assert content["bones"][0]["length"] == 1.0


def test_bvh_comes_back(tmp_path):
    write_bvh(tmp_path / "a.bvh", CHAIN)
    names = tuple(name.replace(" ", "_") for name in CHAIN.names)
    same(medialis.read_armature(tmp_path / "a.bvh"), CHAIN, names)
    lines = (tmp_path / "a.bvh").read_text().splitlines()
    assert lines[0] == "HIERARCHY" and len(lines[-1].split()) == 6 + 3 * 3


@pytest.mark.slow
def test_skinned_gltf_comes_back(tmp_path):
    """Written by `armature`: a turned joint for each bone, and a node at each end."""
    result = medialis.run("armature", medialis.organic_shape(56))
    medialis.write_result(result, tmp_path / "out", pictures=Pictures(main=False))
    found = medialis.read_armature(tmp_path / "out" / "armature.glb")
    rig = result.extras["bones"]
    assert found.names == rig.names and found.parents.tolist() == rig.parents.tolist()
    assert np.abs(found.heads - rig.heads).max() < 1e-5
    leaves = ~np.isin(np.arange(rig.count), rig.parents)
    assert np.abs(found.tails - rig.tails)[leaves].max() < 1e-5


def bone(parent="null", head="[0, 0, 0]"):
    """Text of an armature of one bone."""
    return f'{{"bones": [{{"name": "a", "parent": {parent}, "head": {head}, "tail": [0, 0, 1]}}]}}'


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("a.json", "{}", "expected JSON with a list bones"),
        ("a.json", '{"bones": []}', "one bone at least"),
        ("a.json", bone(parent='"b"'), "KeyError: 'b'"),
        ("a.json", bone(parent="0"), "in a circle"),
        ("a.json", bone(head="[0, 0, NaN]"), "finite"),
        ("a.bvh", "MOTION", "no ROOT"),
        ("a.bvh", "HIERARCHY ROOT hips { CHANNELS 0 }", "no ROOT with an OFFSET"),
        ("a.bvh", "HIERARCHY ROOT hips", "damaged"),
        ("a.gltf", "{}", "no skin"),
        ("a.gltf", '{"nodes": [{"children": [0]}], "skins": [{"joints": [0]}]}', "in a circle"),
        ("a.glb", "glTF", "damaged"),
    ],
)  # fmt: skip
def test_damaged_files_are_told(tmp_path, name, text, said):
    (tmp_path / name).write_text(text)
    with pytest.raises((medialis.InvalidShapeError, medialis.FileError), match=said) as caught:
        medialis.read_armature(tmp_path / name)
    assert "\n" not in str(caught.value) and str(tmp_path / name) in str(caught.value)


def test_a_missing_file_is_told(tmp_path):
    with pytest.raises(medialis.FileError):
        medialis.read_armature(tmp_path / "none.bvh")


def test_names_of_gltf_are_made_different(tmp_path):
    nodes = [{"name": "a", "children": [1, 2]}, {"name": "a", "translation": [0, 1, 0]}, {}]
    (tmp_path / "a.gltf").write_text(json.dumps({"nodes": nodes, "skins": [{"joints": [0, 1, 2]}]}))
    found = medialis.read_armature(tmp_path / "a.gltf")
    assert found.names == ("a", "a.001", "bone 002") and found.parents.tolist() == [-1, 0, 0]


def turned_rig(folder, turn):
    """A file of joints whose bones lie along their own y: an arm, then two fingers, then tips."""
    nodes = [
        {"name": "arm", "rotation": turn, "children": [1]},
        {"name": "hand", "translation": [0, 2, 0], "children": [2, 3]},
        {"name": "one", "translation": [0.5, 1, 0], "children": [4]},
        {"name": "two", "translation": [-1, 3, 0], "children": [5]},
        {"name": "tip", "translation": [0, 1, 0], "rotation": [0, 0, 0.5**0.5, 0.5**0.5]},
        {"name": "tip", "translation": [0, 1, 0], "children": [6, 7]},
        {"name": "on", "translation": [0.01, 3, 0]},
        {"name": "off", "translation": [1, 1, 0]},
    ]
    path = folder / "a.gltf"
    path.write_text(json.dumps({"nodes": nodes, "skins": [{"joints": list(range(8))}]}))
    return medialis.read_armature(path)


@pytest.mark.parametrize("turn", [[0, 0, 0, 1], [0.5, 0.5, -0.5, 0.5]])
def test_bones_of_gltf_end_along_the_axis_that_all_bones_lie_along(tmp_path, turn):
    """The hand: as far as its fingers on average; a tip: half of the bone before, as it is turned;
    a joint on the way: there, whatever else hangs on the bone."""
    found = turned_rig(tmp_path, turn)
    back = Rotation.from_quat(turn).inv()
    ways = back.apply(found.tails - found.heads)
    expected = {0: [0, 2, 0], 1: [0, 2, 0], 2: [0, 1, 0], 4: [-0.5, 0, 0], 5: [0.01, 3, 0]}
    for row, way in expected.items():
        assert np.abs(ways[row] - way).max() < 1e-9


def test_where_bones_lie_along_no_axis_they_end_in_the_middle_of_what_hangs_on_them(tmp_path):
    nodes = [{"children": [1, 2]}, {"translation": [0, 2, 0], "children": [3]},
             {"translation": [2, 0, 0], "children": [4]}, {"translation": [1, 0, 0]},
             {"translation": [0, 0, 1]}]  # fmt: skip
    (tmp_path / "a.gltf").write_text(
        json.dumps({"nodes": nodes, "skins": [{"joints": list(range(5))}]})
    )
    tails = medialis.read_armature(tmp_path / "a.gltf").tails
    assert tails[0].tolist() == [1, 1, 0] and tails[3].tolist() == [1.5, 2, 0]
