"""Rigged glTF, read back by a reader of its own and by trimesh: skin, joints and rest pose."""

import json
import struct
from dataclasses import replace

import numpy as np
import pytest

import medialis
from medialis.rigging.operation import bone_frames, write_rigged_gltf

TYPES = {5121: np.uint8, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}


class Scene:
    """What a file says, as the specification of glTF 2.0 tells to read it."""

    def __init__(self, data: bytes) -> None:
        magic, version, length = struct.unpack_from("<4sII", data)
        assert (magic, version, length) == (b"glTF", 2, len(data))
        size, kind = struct.unpack_from("<I4s", data, 12)
        assert kind == b"JSON" and size % 4 == 0
        self.json = json.loads(data[20 : 20 + size])
        rest, kind = struct.unpack_from("<I4s", data, 20 + size)
        assert kind == b"BIN\0" and rest % 4 == 0 and len(data) == 28 + size + rest
        self.binary = data[28 + size :]

    def array(self, number: int) -> np.ndarray:
        about = self.json["accessors"][number]
        view = self.json["bufferViews"][about["bufferView"]]
        kind, width = np.dtype(TYPES[about["componentType"]]), WIDTHS[about["type"]]
        assert view["byteOffset"] % 4 == 0
        assert view["byteLength"] == about["count"] * width * kind.itemsize
        values = np.frombuffer(self.binary, kind, about["count"] * width, view["byteOffset"])
        return values.reshape(about["count"], width) if width > 1 else values

    def places(self) -> list[np.ndarray]:
        """The matrix of each node in the scene, from those of its parents."""
        nodes = self.json["nodes"]
        found: dict[int, np.ndarray] = {}

        def visit(number: int, above: np.ndarray) -> None:
            assert number not in found, "a node has two parents"
            here, node = np.eye(4), nodes[number]
            if "rotation" in node:
                here[:3, :3] = turned(*node["rotation"])
            here[:3, 3] = node.get("translation", [0, 0, 0])
            found[number] = above @ here
            for child in node.get("children", []):
                visit(child, found[number])

        for root in self.json["scenes"][0]["nodes"]:
            visit(root, np.eye(4))
        return [found[number] for number in range(len(nodes))]

    def skinned(self, moved: dict[int, np.ndarray] | None = None) -> np.ndarray:
        """Positions of all vertices, with matrices on top of those of some joints.

        Weights sum to 1 in single precision only, so that joints are taken relative to the node of
        the mesh, as programs do that draw scenes far away.
        """
        skin, places = self.json["skins"][0], self.places()
        mesh = next(n for n, node in enumerate(self.json["nodes"]) if "mesh" in node)
        home = places[mesh]
        inverse = self.array(skin["inverseBindMatrices"]).reshape(-1, 4, 4).transpose(0, 2, 1)
        joints = np.array([
            np.linalg.inv(home) @ places[node] @ (moved or {}).get(node, np.eye(4)) @ bind
            for node, bind in zip(skin["joints"], inverse, strict=True)
        ])  # fmt: skip
        held = self.json["meshes"][0]["primitives"][0]["attributes"]
        points = np.c_[self.array(held["POSITION"]), np.ones(len(self.array(held["POSITION"])))]
        weights, rows = self.array(held["WEIGHTS_0"]), self.array(held["JOINTS_0"])
        blended = np.einsum("nk,nkij->nij", weights.astype(float), joints[rows])
        return np.einsum("nij,nj->ni", blended, points)[:, :3] @ home[:3, :3].T + home[:3, 3]


def turned(x, y, z, w):
    """Rotation matrix of a unit quaternion."""
    assert abs(x * x + y * y + z * z + w * w - 1) < 1e-6
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip


@pytest.fixture(scope="module")
def result():
    return medialis.run("armature", replace(medialis.organic_shape(56), unit="cm"))


def written(result, folder, unit=None, up=None):
    layer = next(one for one in result.layers if one.role == "skin")
    surface = medialis.Surface(layer.points, layer.faces)
    normals = result.shape.normals[: len(layer.points)]
    skin = result.extras["skin"]
    write_rigged_gltf(folder / "a.glb", surface, normals, skin, unit=unit, up=up)
    return Scene((folder / "a.glb").read_bytes()), surface


@pytest.mark.slow
def test_the_rest_pose_is_the_shape_in_metres(result, tmp_path):
    scene, surface = written(result, tmp_path, "cm")
    # Single precision of positions, weights and matrices: 2^-24 each.
    assert np.abs(scene.skinned() - 0.01 * surface.points).max() < 1e-6 * 0.01 * surface.diagonal
    held = scene.json["meshes"][0]["primitives"][0]
    assert (scene.array(held["indices"]).reshape(-1, 3) == surface.faces).all()
    weights = scene.array(held["attributes"]["WEIGHTS_0"])
    assert np.abs(weights.sum(axis=1) - 1).max() < 1e-6 and weights.min() >= 0
    about = scene.json["accessors"][held["attributes"]["POSITION"]]
    points = scene.array(held["attributes"]["POSITION"])
    assert about["min"] == points.min(axis=0).tolist()
    assert about["max"] == points.max(axis=0).tolist()


def test_joints_are_the_bones_with_their_names_parents_and_ends(result, tmp_path):
    scene, _ = written(result, tmp_path)
    rig, nodes, places = result.extras["bones"], scene.json["nodes"], scene.places()
    joints = scene.json["skins"][0]["joints"]
    assert [nodes[j]["name"] for j in joints] == list(rig.names)
    parents = {child: n for n, node in enumerate(nodes) for child in node.get("children", [])}
    top = scene.json["skins"][0]["skeleton"]
    assert [parents[j] for j in joints] == [top if p < 0 else joints[p] for p in rig.parents]
    heads = np.array([places[j][:3, 3] for j in joints])
    assert np.abs(heads - rig.heads).max() < 1e-6
    leaves = sorted(set(range(rig.count)) - set(rig.parents.tolist()))
    for bone in leaves:
        (end,) = nodes[joints[bone]]["children"]
        assert np.abs(places[end][:3, 3] - rig.tails[bone]).max() < 1e-6


def test_turning_a_bone_moves_what_hangs_on_it_and_nothing_else(result, tmp_path):
    scene, surface = written(result, tmp_path)
    rig, skin = result.extras["bones"], result.extras["skin"]
    bone = int(np.setdiff1d(np.arange(rig.count), rig.parents)[0])  # an end
    half = np.eye(4)
    half[:3, :3] = turned(1, 0, 0, 0)  # half a turn about its x axis
    moved = scene.skinned({bone: half})
    frame = bone_frames(rig)[bone]
    share = skin.of_bone(bone)[:, None]
    local = np.c_[surface.points, np.ones(surface.point_count)] @ np.linalg.inv(frame).T
    expected = (1 - share) * surface.points + share * (local @ half.T @ frame.T)[:, :3]
    assert np.abs(moved - expected).max() < 2e-6 * surface.diagonal
    assert (np.linalg.norm(moved - surface.points, axis=1) > 0.01)[share[:, 0] > 0.5].any()


def test_frames_are_turns_with_y_along_the_bone(result):
    frames, rig = bone_frames(result.extras["bones"]), result.extras["bones"]
    turns = frames[:, :3, :3]
    assert np.allclose(turns @ turns.transpose(0, 2, 1), np.eye(3), atol=1e-12)
    assert np.allclose(np.linalg.det(turns), 1.0)
    along = rig.tails - rig.heads
    assert np.allclose(turns[:, :, 1] * np.linalg.norm(along, axis=1)[:, None], along, atol=1e-12)


@pytest.mark.slow
def test_a_shape_far_away_keeps_its_precision(tmp_path):
    """Single precision at a million units is 0.06: the shape would be steps."""
    near = medialis.organic_shape(56)
    away = np.array([1e6, -2e6, 5e5])
    shape = medialis.make_shape(near.points + away, near.faces)
    scene, surface = written(medialis.run("armature", shape), tmp_path)
    assert np.abs(scene.skinned() - surface.points).max() < 1e-5
    skin = next(node for node in scene.json["nodes"] if "mesh" in node)
    held = scene.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"]
    plain = scene.array(held) + np.array(skin["translation"])  # readers without skins see the same
    assert np.abs(plain - surface.points).max() < 1e-5


@pytest.mark.parametrize(("up", "axis"), [("x", 0), ("y", 1), ("z", 2), (None, 1)])
def test_what_is_up_is_up_in_gltf(result, tmp_path, up, axis):
    """A shape with z up lay on its back: glTF has y up."""
    scene, surface = written(result, tmp_path, up=up)
    found = scene.skinned()
    assert np.allclose(found[:, 1], surface.points[:, axis], atol=1e-5)
    assert np.isclose(np.linalg.det(np.linalg.lstsq(surface.points, found, rcond=None)[0]), 1)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("naming", "spine"),
    [("rigify", "spine"), ("mixamo", "mixamorig:Hips"), ("unreal", "pelvis"), ("vrm", "hips")],
)
def test_names_are_those_that_were_asked_for(tmp_path, naming, spine):
    """The bones of the file were numbered, whatever was asked for."""
    result = medialis.run("armature", medialis.organic_shape(56), naming=naming)
    medialis.write_result(result, tmp_path / "out", pictures=medialis.Pictures(main=False))
    scene = Scene((tmp_path / "out" / "armature.glb").read_bytes())
    nodes = scene.json["nodes"]
    names = [nodes[joint]["name"] for joint in scene.json["skins"][0]["joints"]]
    assert names == list(result.extras["bones"].names) and spine in names


def test_pygltflib_finds_skin_joints_and_matrices(result, tmp_path):
    gltf = pytest.importorskip("pygltflib", reason="pygltflib is not installed")
    written(result, tmp_path)
    scene, rig = gltf.GLTF2().load(str(tmp_path / "a.glb")), result.extras["bones"]
    (skin,) = scene.skins
    assert [scene.nodes[joint].name for joint in skin.joints] == list(rig.names)
    accessor = scene.accessors[skin.inverseBindMatrices]
    view = scene.bufferViews[accessor.bufferView]
    start = view.byteOffset + (accessor.byteOffset or 0)
    data = scene.binary_blob()[start : start + view.byteLength]
    matrices = np.frombuffer(data, np.float32).reshape(-1, 4, 4).transpose(0, 2, 1)
    # An inverse bind matrix takes the head of its bone to the origin, and its tail up the y axis.
    for end, height in ((rig.heads, 0.0), (rig.tails, 1.0)):
        local = np.einsum("bij,bj->bi", matrices, np.c_[end, np.ones(rig.count)])[:, :3]
        length = np.linalg.norm(rig.tails - rig.heads, axis=1)
        assert np.allclose(local, height * length[:, None] * [0, 1, 0], atol=1e-5)


@pytest.mark.parametrize("naming", ["rigify", "mixamo"])
def test_blender_finds_an_armature_that_moves_the_mesh(tmp_path, naming):
    bpy = pytest.importorskip("bpy", reason="bpy is not installed")
    result = medialis.run("armature", medialis.organic_shape(56), naming=naming)
    written(result, tmp_path)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(tmp_path / "a.glb"))
    (armature,) = [one for one in bpy.data.objects if one.type == "ARMATURE"]
    mesh = next(one for one in bpy.data.objects if one.find_armature() is armature)
    rig, layer = result.extras["bones"], next(one for one in result.layers if one.role == "skin")
    assert set(rig.names) <= set(armature.data.bones.keys())
    parents = {bone.name: bone.parent.name if bone.parent else None for bone in armature.data.bones}
    for name, parent in zip(rig.names, rig.parents.tolist(), strict=True):
        assert parents[name] == (None if parent < 0 else rig.names[parent])
    turn = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0.0]])  # Blender takes y of glTF as up

    def vertices():
        shown = mesh.evaluated_get(bpy.context.evaluated_depsgraph_get())
        found = np.empty(3 * len(shown.data.vertices), np.float32)
        shown.data.vertices.foreach_get("co", found)
        matrix = np.array(shown.matrix_world)
        return found.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]

    rest = vertices()
    assert np.allclose(rest, layer.points @ turn.T, atol=1e-5)
    bone = int(np.setdiff1d(np.arange(rig.count), rig.parents)[0])
    armature.pose.bones[rig.names[bone]].rotation_mode = "XYZ"
    armature.pose.bones[rig.names[bone]].rotation_euler = (1.0, 0.0, 0.0)
    bpy.context.view_layer.update()
    away = np.linalg.norm(vertices() - rest, axis=1)
    share = result.extras["skin"].of_bone(bone)
    assert away[share > 0.5].max() > 0.02 and away[share == 0].max() < 1e-5


def test_another_reader_finds_the_same_shape(result, tmp_path):
    trimesh = pytest.importorskip("trimesh", reason="reads glTF")
    _, surface = written(result, tmp_path, "cm")
    found = trimesh.load(tmp_path / "a.glb").to_mesh()
    assert found.faces.shape == surface.faces.shape
    assert np.allclose(found.extents, 0.01 * np.ptp(surface.points, axis=0), rtol=1e-6)


@pytest.mark.slow
def test_graph_files_of_an_armature_hold_the_bones(result, tmp_path):
    """They held the curve skeleton, which has other nodes and may have loops."""
    medialis.write_result(result, tmp_path / "out")
    graph = medialis.read_curve_skeleton(tmp_path / "out" / "armature.json")
    rig = result.extras["bones"]
    # Legs begin beside the end of the spine: there is an edge to each hip as well.
    free = rig.count - int(rig.connected.sum()) - len(rig.roots)
    assert free == 7 and len(graph.edges) == rig.count + free  # four legs, two ears and a tail
    assert len(graph.nodes) == len(graph.edges) + len(rig.roots)
    assert graph.loops == 0 and graph.component_count == len(rig.roots)
    ends = {tuple(sorted(map(tuple, graph.nodes[edge].tolist()))) for edge in graph.edges}
    bones = zip(rig.heads.tolist(), rig.tails.tolist(), strict=True)
    assert ends > {tuple(sorted(map(tuple, pair))) for pair in bones}
    told = json.loads((tmp_path / "out" / "armature.json").read_text())
    assert told["kind"] == "quadruped" and len(told["bones"]) == rig.count
    for bone, about in enumerate(told["bones"]):
        assert about["name"] == rig.names[bone] and about["parent"] == rig.parents[bone]
        way = np.array(about["tail"]) - about["head"]
        assert about["length"] == pytest.approx(np.linalg.norm(way))
        assert about["head"] == rig.heads[bone].tolist() and abs(about["roll"]) <= np.pi
    assert (tmp_path / "out" / "armature.glb").is_file()
