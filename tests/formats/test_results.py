"""Results come back bit by bit; a folder of results appears whole or not at all."""

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from enum import Enum

import numpy as np
import pytest

from medialis.base import disk
from medialis.base.errors import FileError, InvalidOptionError, InvalidShapeError, MedialisError
from medialis.formats.files import complete_file
from medialis.formats.json_npz import json_text, read_npz, write_json, write_npz
from medialis.formats.meshes import read_mesh
from medialis.formats.output_folder import OutputFolder
from medialis.formats.ply_attributes import read_ply_attributes, write_ply


def names_in(folder):
    return sorted(path.name for path in folder.iterdir())


def same_bits(a, b):
    assert a.dtype == b.dtype and a.shape == b.shape
    assert a.tobytes() == b.tobytes()


def strange_doubles(n):
    bits = np.array([0x7FF8000000000123, 0xFFF0000000000001, 1, 1 << 63], np.uint64)
    special = np.r_[bits.view(np.float64), np.inf, -np.inf, np.nan, 1e-320, 0.1]
    return np.resize(special, n)


N = 9
ATTRIBUTES = {
    "radius": strange_doubles(N),
    "short_radius": np.resize(np.array([0x7F800001, 0x80000000, 3], np.uint32), N).view("f4"),
    "valid": np.arange(N) % 2 == 0,
    "normal": strange_doubles(3 * N).reshape(N, 3),
    "one": np.arange(N, dtype=np.int16).reshape(N, 1),
    "none": np.empty((N, 0), np.float32),
    "tensor": np.arange(4 * N, dtype=np.float32).reshape(N, 2, 2),
    "small_long": np.arange(N) - 4,
    "big_long": (np.arange(N) - 4) * 2**51,
    "unsigned": np.arange(N, dtype=np.uint64) * 2**40,
    "flags": np.arange(2 * N).reshape(N, 2) % 3 == 0,
    **{f"a{t}": np.arange(N).astype(t) for t in ("i1", "u1", "i2", "u2", "i4", "u4")},
}


def test_ply_comes_back_bit_by_bit(tmp_path):
    points = strange_doubles(3 * N).reshape(N, 3)
    faces, edges = np.array([[0, 1, 2], [8, 7, 6]], np.int32), np.array([[0, 8]], np.int32)
    before = {k: v.copy() for k, v in ATTRIBUTES.items()}
    write_ply(tmp_path / "a.ply", points, faces, edges, ATTRIBUTES)
    data = read_ply_attributes(tmp_path / "a.ply")
    same_bits(data.points, points)
    same_bits(data.faces, faces)
    same_bits(data.edges, edges)
    assert list(data.attributes) == list(ATTRIBUTES)
    for name, values in ATTRIBUTES.items():
        same_bits(data.attributes[name], values)
        same_bits(values, before[name])
    assert names_in(tmp_path) == ["a.ply"]


def test_ply_face_attributes_come_back_bit_by_bit(tmp_path):
    """Beside point attributes of the same name; other programs still read the triangles."""
    faces = np.arange(3 * N).reshape(N, 3) % N
    write_ply(tmp_path / "a.ply", np.zeros((N, 3)), faces, None, {"flags": np.ones(N)}, ATTRIBUTES)
    back = read_ply_attributes(tmp_path / "a.ply")
    assert (back.faces == faces).all() and list(back.attributes) == ["flags"]
    assert list(back.face_attributes) == list(ATTRIBUTES)
    for name, values in ATTRIBUTES.items():
        same_bits(back.face_attributes[name], values)
    assert (read_mesh(tmp_path / "a.ply").faces == faces).all()


def test_ply_refuses_face_attributes_of_other_length(tmp_path):
    with pytest.raises(InvalidOptionError, match="each of the 0 faces"):
        write_ply(tmp_path / "a.ply", np.zeros((2, 3)), face_attributes={"part": [1, 2]})
    assert names_in(tmp_path) == []


def test_ply_without_rows_and_parts(tmp_path):
    write_ply(tmp_path / "a.ply", np.empty((0, 3)), attributes={"v": np.empty((0, 3))})
    data = read_ply_attributes(tmp_path / "a.ply")
    assert data.points.shape == (0, 3) and data.faces is None and data.edges is None
    assert data.attributes["v"].shape == (0, 3)
    write_ply(tmp_path / "a.ply", np.zeros((1, 3)), np.empty((0, 3), int), np.empty((0, 2), int))
    data = read_ply_attributes(tmp_path / "a.ply")
    assert data.faces.shape == (0, 3) and data.edges.shape == (0, 2)


def test_ply_is_read_as_a_mesh_too_and_bytes_repeat(tmp_path):
    points, faces = np.eye(3), [[0, 1, 2]]
    for name in "ab":
        write_ply(tmp_path / f"{name}.ply", points, faces, attributes={"q": np.arange(3.0)})
    assert (tmp_path / "a.ply").read_bytes() == (tmp_path / "b.ply").read_bytes()
    np.testing.assert_array_equal(read_mesh(tmp_path / "a.ply").points, points)


def test_foreign_ply_gives_its_scalars(tmp_path):
    text = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
    text += "property float z\nproperty uchar red\nend_header\n0 0 0 200\n"
    (tmp_path / "a.ply").write_text(text)
    assert read_ply_attributes(tmp_path / "a.ply").attributes["red"] == [200]


@pytest.mark.parametrize(
    "attributes",
    [
        {"a": np.zeros(2)},
        {"a": 1.0},
        {"": np.zeros(3)},
        {"two words": np.zeros(3)},
        {"größe": np.zeros(3)},
        {"line\nbreak": np.zeros(3)},
        {"x": np.zeros(3)},
        {"a": np.zeros((3, 2)), "a_1": np.zeros(3)},
        {"a": np.full(3, 2**53 + 1)},
        {"a": np.full(3, 2**63, np.uint64)},
        {"a": np.zeros(3, complex)},
        {"a": np.zeros(3, np.float16)},
        {"a": np.array(["a", "b", "c"])},
    ],
)
def test_ply_refuses_what_it_cannot_hold(tmp_path, attributes):
    with pytest.raises(InvalidOptionError):
        write_ply(tmp_path / "a.ply", np.zeros((3, 3)), attributes=attributes)
    assert names_in(tmp_path) == []


@pytest.mark.parametrize(
    ("points", "faces", "edges"),
    [
        (np.zeros((3, 2)), None, None),
        ([["a", "b", "c"]], None, None),
        (np.zeros((3, 3)), [[0, 1, 3]], None),
        (np.zeros((3, 3)), None, [[0, 3]]),
        (np.zeros((3, 3)), None, [[0, 1, 2]]),
    ],
)
def test_ply_refuses_bad_geometry(tmp_path, points, faces, edges):
    with pytest.raises(InvalidShapeError):
        write_ply(tmp_path / "a.ply", points, faces, edges)


def test_damaged_results_are_one_sentence(tmp_path):
    path = tmp_path / "a.ply"
    write_ply(path, np.zeros((3, 3)), [[0, 1, 2]], [[0, 1]], {"v": np.arange(6).reshape(3, 2)})
    data = path.read_bytes()
    rng = np.random.default_rng(0)
    for _ in range(200):
        damaged = np.frombuffer(data, np.uint8).copy()
        damaged[rng.integers(len(data), size=3)] = rng.integers(256, size=3)
        path.write_bytes(damaged.tobytes())
        try:
            read_ply_attributes(path)
        except MedialisError as error:
            assert "\n" not in str(error)
    for bad in (data[:-1], b"not ply", b""):
        path.write_bytes(bad)
        with pytest.raises(InvalidShapeError):
            read_ply_attributes(path)
    path.write_bytes(data.replace(b"v int64 2", b"v object 2"))
    with pytest.raises(InvalidShapeError):
        read_ply_attributes(path)
    with pytest.raises(FileError):
        read_ply_attributes(tmp_path / "none.ply")


def test_npz_comes_back_bit_by_bit_and_bytes_repeat(tmp_path):
    arrays = {**ATTRIBUTES, "file": np.array(3), "a/b": np.array(["text"])}
    for name in "ab":
        write_npz(tmp_path / f"{name}.npz", arrays)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    back = read_npz(tmp_path / "a.npz")
    assert list(back) == list(arrays)
    for name, values in arrays.items():
        same_bits(back[name], values)


def test_npz_refuses_objects_and_damage(tmp_path):
    path = tmp_path / "a.npz"
    for bad in ({"a": np.array([object()])}, {"": np.zeros(1)}, {3: np.zeros(1)}):
        with pytest.raises(InvalidOptionError):
            write_npz(path, bad)
    write_npz(path, ATTRIBUTES)
    data = path.read_bytes()
    for bad in (data[:-40], data[:10], b"no zip", b"PK\x03\x04", data.replace(b"NUMPY", b"NUMPI")):
        path.write_bytes(bad)
        with pytest.raises(InvalidShapeError):
            read_npz(path)


class Kind(Enum):
    A = "a"


@dataclass
class Pair:
    left: float
    right: object


def test_json_is_strict_and_sorted(tmp_path):
    value = {
        "b": np.float32(0.5),
        "a": [np.nan, np.inf, -np.inf, np.int64(3), np.bool_(True), None],
        "array": np.array([[1, 2], [3, 4]]),
        "path": tmp_path,
        "kind": Kind.A,
        "pair": Pair(float("nan"), {3, 1, 2}),
        2: (),
    }
    write_json(tmp_path / "a.json", value)
    text = (tmp_path / "a.json").read_text()
    back = json.loads(text, parse_constant=lambda word: pytest.fail(word))
    assert back["a"] == [None, None, None, 3, True, None]
    assert back["array"] == [[1, 2], [3, 4]] and back["b"] == 0.5 and back["kind"] == "a"
    assert back["path"] == str(tmp_path) and back["pair"] == {"left": None, "right": [1, 2, 3]}
    assert list(back) == sorted(back)
    assert json_text(dict(reversed(value.items()))) + "\n" == text


def test_json_refuses_what_has_no_place():
    endless: list = []
    endless.append(endless)
    for bad in (object(), {"a": 1j}, {(1,): 2}, endless, b"bytes"):
        with pytest.raises(InvalidOptionError):
            json_text(bad)


def test_writers_refuse_bad_targets(tmp_path):
    (tmp_path / "file").write_text("")
    for target in (tmp_path, tmp_path / "no" / "a", tmp_path / "file" / "a", tmp_path / "a\0b"):
        with pytest.raises(FileError):
            write_json(target, {})
    assert names_in(tmp_path) == ["file"]


def test_output_folder_moves_files_at_the_end(tmp_path):
    out = tmp_path / "new" / "out"
    with OutputFolder(out) as folder:
        folder.file("a.txt").write_text("a")
        folder.file("sub/b.txt").write_text("b")
        assert not out.exists()
    assert names_in(tmp_path / "new") == ["out"]
    assert (out / "a.txt").read_text() == "a" and (out / "sub" / "b.txt").read_text() == "b"
    with OutputFolder(out) as folder:
        folder.file("a.txt").write_text("new")
    assert (out / "a.txt").read_text() == "new" and (out / "sub" / "b.txt").exists()
    with OutputFolder(tmp_path / "empty"):
        pass
    assert names_in(tmp_path / "empty") == []


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError, SystemExit])
def test_output_folder_leaves_nothing_after_an_error(tmp_path, error):
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "a.txt").write_text("old")
    for out in (tmp_path / "x" / "y" / "out", tmp_path / "old"):
        with pytest.raises(error), OutputFolder(out) as folder:
            folder.file("a.txt").write_text("half")
            raise error
    assert names_in(tmp_path) == ["old"] and names_in(tmp_path / "old") == ["a.txt"]
    assert (tmp_path / "old" / "a.txt").read_text() == "old"


def test_output_folder_puts_everything_back_when_moving_fails(tmp_path, monkeypatch):
    (tmp_path / "a").write_text("old")
    original = disk.Folder.move

    def fail_late(self, name, folder, new):
        if name == "c":
            raise OSError(28, "No space left on device", name)
        return original(self, name, folder, new)

    with pytest.raises(FileError, match=r"\(c\): no space"), OutputFolder(tmp_path) as folder:
        for name in ("a", "b", "c"):
            folder.file(name).write_text("new")
        monkeypatch.setattr(disk.Folder, "move", fail_late)
    assert names_in(tmp_path) == ["a"] and (tmp_path / "a").read_text() == "old"


KILLED = """
import os, sys
from medialis.formats.output_folder import OutputFolder
with OutputFolder(sys.argv[1]) as folder:
    folder.file("half.txt").write_text("half")
    print("here", flush=True)
    sys.stdin.read()
"""


@pytest.mark.slow
def test_output_folder_removes_what_a_killed_run_left_and_nothing_else(tmp_path):
    """Hidden folders of killed runs stayed; a batch removed any `.name-*` (fixed)."""
    out = tmp_path / "ou[t]"
    tails = ("notes", "0123456", "012345678", "ABCDEF01")
    own = [tmp_path / f".ou[t]-{tail}" for tail in tails]
    own += [tmp_path / ".out-01234567", tmp_path / ".ou[t]-01234567"]
    for folder in own:
        folder.mkdir(exist_ok=True)
        (folder / "mine.txt").write_text("mine")
    children = []
    for _ in range(2):
        words = [sys.executable, "-c", KILLED, out]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        children.append(subprocess.Popen(words, **pipes))
        assert children[-1].stdout.readline() == b"here\n"
    left = [p for p in tmp_path.glob(".ou*") if p not in own]
    assert len(left) == 2
    children[0].kill()
    children[0].communicate()
    (empty := tmp_path / ".ou[t]-deadbeef").mkdir()  # killed before it made its lock
    with OutputFolder(out) as folder:
        folder.file("a.txt").write_text("a")
        (alive,) = [p for p in left if p.exists()]
    assert (alive / "half.txt").exists() and not empty.exists()
    children[1].communicate(b"")
    assert children[1].returncode == 0
    assert names_in(out) == ["a.txt", "half.txt"]
    assert all((folder / "mine.txt").exists() for folder in own)
    assert sorted(tmp_path.glob(".ou*")) == sorted(own)


def test_output_folder_loses_no_old_file_when_it_is_interrupted(tmp_path, monkeypatch):
    """Ctrl-C just after an old file was moved away lost it (fixed)."""
    original = disk.Folder.move
    for count in range(20):
        (tmp_path / "a").write_text("old")
        (tmp_path / "manifest.json").write_text("old")
        left = count

        def interrupted(self, name, folder, new):
            nonlocal left
            original(self, name, folder, new)
            left -= 1
            if left == -1:
                raise KeyboardInterrupt

        def write():
            with OutputFolder(tmp_path) as folder:
                for name in ("a", "b", "manifest.json"):
                    folder.file(name).write_text("new")
                monkeypatch.setattr(disk.Folder, "move", interrupted)

        try:
            write()
        except KeyboardInterrupt:
            assert names_in(tmp_path) == ["a", "manifest.json"]
            assert (tmp_path / "a").read_text() == (tmp_path / "manifest.json").read_text() == "old"
        else:
            break
        finally:
            monkeypatch.setattr(disk.Folder, "move", original)
    assert count == 5


def test_output_folder_refuses_bad_targets(tmp_path):
    (tmp_path / "file").write_text("")
    (tmp_path / "out" / "a").mkdir(parents=True)
    for bad in (tmp_path / "file", tmp_path / "file" / "out", tmp_path / "a\0b"):
        with pytest.raises(FileError), OutputFolder(bad):
            pytest.fail("entered")
    with pytest.raises(FileError, match="folder there"), OutputFolder(tmp_path / "out") as folder:
        folder.file("a").write_text("")
    with OutputFolder(tmp_path / "out") as folder:
        for name in ("../a", "/a", "", "."):
            with pytest.raises(InvalidOptionError):
                folder.file(name)
    with pytest.raises(InvalidOptionError):
        folder.file("late")
    assert names_in(tmp_path) == ["file", "out"]


def test_output_folder_refuses_a_locked_target(tmp_path):
    locked = tmp_path / "locked"
    locked.mkdir()
    locked.chmod(0o500)
    if os.access(locked, os.W_OK):
        pytest.skip("this user may write everywhere")
    for out in (locked, locked / "new"):
        with pytest.raises(FileError, match="permission"), OutputFolder(out):
            pytest.fail("entered")


def test_a_disk_that_fills_up_leaves_the_old_file(tmp_path):
    write_json(tmp_path / "a.json", 1)
    with (
        pytest.raises(FileError, match="no space left"),
        complete_file(tmp_path / "a.json") as stream,
    ):
        stream.write(b"half")
        raise OSError(28, "No space left on device")
    assert names_in(tmp_path) == ["a.json"] and (tmp_path / "a.json").read_text() == "1\n"
