"""Every format in every spelling gives the same mesh; every bad file gives one sentence."""

import gzip
import os
import struct
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from medialis.base.errors import FileError, InvalidShapeError, MedialisError
from medialis.formats.meshes import read_mesh

POINTS = np.array(
    [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1.5]]
)
QUADS = np.array(
    [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
)
FACES = QUADS[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)


def rows(array, form="{:g}"):
    return "".join(" ".join(form.format(v) for v in row) + "\n" for row in array)


def ply_header(encoding, vertex="float", count=8, faces=12, extra=""):
    return (
        f"ply\nformat {encoding} 1.0\ncomment a comment\nobj_info nothing\nelement vertex {count}\n"
        f"property {vertex} x\nproperty {vertex} y\nproperty {vertex} z\n{extra}"
        f"element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
    ).encode()


def ascii_ply():
    faces = rows(np.column_stack([np.full(12, 3), FACES]), "{:d}")
    return ply_header("ascii") + (rows(POINTS) + faces).encode()


def binary_ply(order="<", point="f4", name="float"):
    encoding = "binary_little_endian" if order == "<" else "binary_big_endian"
    faces = np.zeros(12, [("n", "u1"), ("v", order + "i4", 3)])
    faces["n"], faces["v"] = 3, FACES
    return ply_header(encoding, name) + POINTS.astype(order + point).tobytes() + faces.tobytes()


def obj():
    return (rows_with("v", POINTS) + rows_with("f", FACES + 1, "{:d}")).encode()


def rows_with(key, array, form="{:g}"):
    return "".join(f"{key} {line}\n" for line in rows(array, form).splitlines())


def off():
    return ("OFF\n8 12 0\n" + rows(POINTS) + rows_with("3", FACES, "{:d}")).encode()


def binary_stl(title=b"solid but binary"):
    facets = b"".join(
        struct.pack("<12fH", 0, 0, 0, *POINTS[face].astype("f4").ravel(), 0) for face in FACES
    )
    return title.ljust(80) + struct.pack("<I", len(FACES)) + facets


def ascii_stl():
    text = "solid cube\n"
    for face in FACES:
        text += " facet normal 0 0 0\n  outer loop\n"
        text += rows_with("   vertex", POINTS[face]) + "  endloop\n endfacet\n"
    return (text + "endsolid cube\n").encode()


GOOD = {
    "a.ply": ascii_ply(),
    "le.ply": binary_ply(),
    "be.ply": binary_ply(">", "f8", "double"),
    "a.obj": obj(),
    "a.off": off(),
    "b.stl": binary_stl(),
    "a.stl": ascii_stl(),
}


def save(folder, name, data):
    path = folder / name
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    return path


def read(folder, name, data):
    return read_mesh(save(folder, name, data))


def refused(folder, name, data, *words, error=InvalidShapeError):
    path = save(folder, name, data)
    with pytest.raises(error) as caught:
        read_mesh(path)
    sentence = str(caught.value)
    assert str(path) in sentence and "\n" not in sentence and sentence.endswith(".")
    for word in words:
        assert word in sentence, sentence


@pytest.mark.parametrize("name", GOOD)
def test_all_formats_give_the_same_triangles(tmp_path, name):
    mesh = read(tmp_path, name, GOOD[name])
    assert mesh.points.dtype == np.float64 and mesh.faces.dtype == np.int32
    np.testing.assert_array_equal(mesh.points[mesh.faces], POINTS[FACES])
    assert mesh.messages == () and mesh.normals is None
    assert not mesh.points.flags.writeable and not mesh.faces.flags.writeable


@pytest.mark.parametrize("name", GOOD)
def test_windows_line_ends(tmp_path, name):
    if b"\0" in GOOD[name]:
        pytest.skip("binary")
    mesh = read(tmp_path, name, GOOD[name].replace(b"\n", b"\r\n"))
    np.testing.assert_array_equal(mesh.points[mesh.faces], POINTS[FACES])


@pytest.mark.parametrize("name", [n for n in GOOD if b"\0" not in GOOD[n]])
def test_byte_order_mark(tmp_path, name):
    """Windows editors put one before the text: an OBJ file lost its first vertex to it."""
    mesh = read(tmp_path, name, b"\xef\xbb\xbf" + GOOD[name])
    np.testing.assert_array_equal(mesh.points[mesh.faces], POINTS[FACES])


@pytest.mark.parametrize("name", GOOD)
@pytest.mark.parametrize("wrong", ["x.bin", "x", "x.ply", "x.obj", "x.off", "x.stl", "x.xyz"])
def test_the_content_wins_over_the_extension(tmp_path, name, wrong):
    mesh = read(tmp_path, wrong, GOOD[name])
    np.testing.assert_array_equal(mesh.points[mesh.faces], POINTS[FACES])
    assert mesh.format == name[-3:]
    if wrong[-3:] != name[-3:]:
        assert mesh.messages[0].code == "other_format"


def test_ply_skips_what_it_does_not_need_and_reads_normals(tmp_path):
    """Extra scalars, lists before and after the coordinates, unknown elements, mixed face sizes."""
    header = (
        b"ply\r\nformat binary_big_endian 1.0\r\nelement camera 2\r\nproperty list ushort double k"
        b"\r\nproperty short id\r\nelement vertex 4\r\nproperty uchar red\r\nproperty double x\r\n"
        b"property float y\r\nproperty short z\r\nproperty float nx\r\nproperty float ny\r\n"
        b"property float nz\r\nelement face 3\r\nproperty uchar flag\r\n"
        b"property list uchar ushort vertex_index\r\nproperty list int float uv\r\n"
        b"element tail 1\r\nproperty list char char c\r\nend_header\r\n"
    )
    body = struct.pack(">HdhHddh", 1, 0.5, 7, 2, 1.5, 2.5, 8)
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    for x, y, z in corners:
        body += struct.pack(">Bdfhfff", 200, x, y, z, 0, 0, 2)
    body += struct.pack(">BB3Hi2f", 9, 3, 0, 1, 2, 2, 0.5, 0.5)
    body += struct.pack(">BB4Hi", 9, 4, 0, 1, 2, 3, 0)
    body += struct.pack(">BB2Hif", 9, 2, 0, 1, 1, 0.5)
    body += struct.pack(">bbb", 2, 1, 1)
    mesh = read(tmp_path, "m.ply", header + body)
    np.testing.assert_array_equal(mesh.points, corners)
    np.testing.assert_array_equal(mesh.normals, [[0, 0, 1]] * 4)
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2], [0, 1, 2], [0, 2, 3]])
    assert mesh.messages[0].code == "quads_split" and mesh.messages[0].data["faces"] == 1
    assert len(mesh.messages) == 2


def test_ascii_ply_with_mixed_faces_and_without_faces(tmp_path):
    data = ply_header("ascii", faces=2) + (rows(POINTS) + "4 0 1 2 3\n3 4 5 6\n").encode()
    np.testing.assert_array_equal(
        read(tmp_path, "m.ply", data).faces, [[0, 1, 2], [0, 2, 3], [4, 5, 6]]
    )
    data = ply_header("ascii", faces=0) + rows(POINTS).encode()
    assert read(tmp_path, "c.ply", data).faces is None


def test_obj_spellings(tmp_path):
    text = """# comment
    mtllib x.mtl
o thing
v 0 0 0 0.5 0.5 0.5
v 1 0 0   # inline comment
v\t1 1 0 1.0
vt 0 0
vn 0 0 2
vn 0 0 1
usemtl stone
f 1/1/1 2/1/2 \\
  3/1/2
v 0 1 0
f -4//1 -2//1 -1//1
l 1 2
p 1
f
vp 0.5
s off
"""
    mesh = read(tmp_path, "m.obj", text)
    np.testing.assert_array_equal(mesh.points, [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2], [0, 2, 3]])
    np.testing.assert_array_equal(mesh.normals, [[0, 0, 1]] * 4)


def test_obj_with_points_and_normals_only_is_a_cloud(tmp_path):
    mesh = read(tmp_path, "m.obj", "v 0 0 0\nvn 0 0 3\nv 1 0 0\nvn 1 0 0\n")
    assert mesh.faces is None
    np.testing.assert_array_equal(mesh.normals, [[0, 0, 1], [1, 0, 0]])


def test_off_spellings(tmp_path):
    text = "OFF4 2 0 # counts beside the keyword\n\n0 0 0\n1 0 0 # c\n1 1 0\n0 1 0\n"
    text += "3 0 1 2 255 0 0\n4 0 1 2 3 0.5 0.5 0.5 1\n"
    mesh = read(tmp_path, "m.off", text)
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2], [0, 1, 2], [0, 2, 3]])
    coff = "COFF\n3 1 3\n0 0 0 255 0 0 255\n1 0 0 255 0 0\n0 1 0 9\n3 0 1 2\n"
    np.testing.assert_array_equal(read(tmp_path, "c.off", coff).points[2], [0, 1, 0])
    noff = "STCNOFF\n3 1 3\n" + "0 0 0 0 0 9 1 1 1 1 0 0\n" * 3 + "3 0 1 2\n"
    np.testing.assert_array_equal(read(tmp_path, "n.off", noff).normals, [[0, 0, 1]] * 3)
    bare = read(tmp_path, "b.off", "3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")
    assert bare.format == "off" and len(bare.faces) == 1


def test_point_text_spellings(tmp_path):
    assert read(tmp_path, "a.xyz", rows(POINTS)).format == "xyz"
    comma = "x, y, z\n" + rows(POINTS).replace(" ", ",")
    mesh = read(tmp_path, "b.csv", "# c\n" + comma)
    np.testing.assert_array_equal(mesh.points, POINTS)
    assert mesh.messages[0].code == "heading"
    normals = np.tile([0.6, 0, 0.8], (8, 1))
    mesh = read(tmp_path, "c.txt", rows(np.hstack([POINTS, normals])))
    np.testing.assert_allclose(mesh.normals, normals)
    mesh = read(tmp_path, "d.pts", "8\n" + rows(np.hstack([POINTS, normals * 200])))
    np.testing.assert_array_equal(mesh.points, POINTS)
    assert mesh.normals is None and mesh.messages[0].data == {"columns": 3}


def area_vectors(mesh):
    a, b, c = (mesh.points[mesh.faces[:, i]] for i in range(3))
    return np.cross(b - a, c - a) / 2


@pytest.mark.parametrize("turn", range(7))
@pytest.mark.parametrize("flip", [False, True])
def test_concave_polygon_is_cut_inside_itself(tmp_path, turn, flip):
    """Triangles of an L with a corner on a straight side face its way and add up to its area."""
    outline = np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2], [0, 1]], float)
    points = np.column_stack([outline, outline @ [0.5, -0.25]])
    ring = np.roll(np.arange(7), turn)[:: -1 if flip else 1]
    text = rows_with("v", points) + "f " + " ".join(str(i + 1) for i in ring) + "\n"
    mesh = read(tmp_path, "m.obj", text)
    vectors = area_vectors(mesh)
    normal = np.array([-0.5, 0.25, 1.0]) * (-1 if flip else 1)
    assert len(mesh.faces) == 5
    assert (vectors @ normal > 0).all()
    # The L has area 3 seen from above; its plane tilts by |normal|.
    np.testing.assert_allclose(vectors.sum(axis=0), 3 * normal, atol=1e-12)


@pytest.mark.parametrize("turn", range(4))
def test_concave_quad_takes_the_diagonal_inside(tmp_path, turn):
    points = np.array([[0, 0, 0], [2, 0, 0], [0.5, 0.5, 0], [0, 2, 0]])
    quad = np.roll([1, 2, 3, 4], turn)
    text = rows_with("v", points) + rows_with("f", [quad], "{:d}")
    mesh = read(tmp_path, "m.obj", text)
    assert (area_vectors(mesh)[:, 2] > 0).all()


def test_crossing_and_flat_polygons_still_end(tmp_path):
    angles = np.arange(5) * 4 * np.pi / 5
    star = np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])
    line = np.column_stack([np.arange(5), np.zeros(5), np.zeros(5)])
    text = rows_with("v", np.vstack([star, line])) + "f 1 2 3 4 5\nf 6 7 8 9 10\nf 1 1 1 1 1\n"
    assert len(read(tmp_path, "m.obj", text).faces) == 9


def test_missing_folder_and_locked_files(tmp_path):
    for path, word in [(tmp_path / "no.ply", "no such file"), (tmp_path, "folder")]:
        with pytest.raises(FileError, match=word):
            read_mesh(path)
    with pytest.raises(FileError):
        read_mesh("a\0b.ply")
    locked = save(tmp_path, "locked.ply", ascii_ply())
    locked.chmod(0)
    if os.access(locked, os.R_OK):
        pytest.skip("this user may read everything")
    with pytest.raises(FileError, match="permission"):
        read_mesh(locked)


def test_a_pipe_is_refused_without_waiting(tmp_path):
    os.mkfifo(tmp_path / "pipe.ply")
    with pytest.raises(FileError, match="regular file"):
        read_mesh(tmp_path / "pipe.ply")


def test_truncated_files_say_how_much_was_found(tmp_path):
    refused(tmp_path, "a.ply", binary_ply()[:-30], "12 faces", "only 9 were found")
    refused(tmp_path, "b.ply", binary_ply()[: 30 - 13 * 12 - 96], "8 vertices", "only 2")
    refused(tmp_path, "c.ply", ascii_ply()[:-30], "12 faces", "only 8")
    refused(tmp_path, "d.off", off()[:-32], "12 faces", "8 vertices and 8 faces were found")
    refused(tmp_path, "e.stl", binary_stl()[:-60], "12 faces", "only 10")
    refused(tmp_path, "f.stl", ascii_stl()[:-200], "cut short")
    mixed = ply_header("ascii", faces=3) + (rows(POINTS) + "4 0 1 2 3\n3 4 5 6\n").encode()
    refused(tmp_path, "g.ply", mixed, "3 faces", "only 2")


@pytest.mark.parametrize("name", ["a.ply", "a.obj", "a.off", "a.stl", "a.xyz", "a.glb", "a.what"])
def test_empty_and_garbage(tmp_path, name):
    refused(tmp_path, name, b"", "empty")
    refused(tmp_path, name, b"Dear reader, this is a letter.\nYours, me\n")
    refused(tmp_path, name, bytes(range(256)) * 3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("data", "words"),
    [
        (gzip.compress(b"ply\n", mtime=0), "gzip"),  # the time would be in the name of the test
        (b"PK\3\4" + bytes(50), "zip archive"),
        ("ply\nformat ascii 1.0\n".encode("utf-16"), "UTF-16"),
        (b"version https://git-lfs.github.com/spec/v1\n", "git lfs pull"),
        (b"\n<!DOCTYPE html><html>v 1 2 3", "web page"),
        (b"\x89PNG\r\n", "picture"),
        (b"ISO-10303-21;", "STEP"),
    ],
)
def test_files_that_are_no_mesh_are_named(tmp_path, data, words):
    """A packed PLY was told that its header does not end."""
    for name in ("a.ply", "a.obj", "a.xyz"):
        refused(tmp_path, name, data, words)


def test_absurd_counts_are_refused_before_any_allocation(tmp_path):
    for encoding in ("ascii", "binary_little_endian"):
        for counts in ({"count": 10**18}, {"faces": 10**18}, {"count": "9" * 5000}):
            refused(
                tmp_path, "a.ply", ply_header(encoding, **counts) + bytes(rows(POINTS), "ascii")
            )
    refused(tmp_path, "a.off", f"OFF\n{10**15} {10**15} 0\n0 0 0\n", "only 1 vertices")
    refused(tmp_path, "a.off", "OFF\n1e300 3 0\n0 0 0\n")
    refused(tmp_path, "a.stl", b"x" * 80 + b"\xff\xff\xff\xff" + b"y" * 50, "4294967295")
    huge = b"ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\n"
    huge += b"property float y\nproperty float z\nelement face 2\n"
    huge += b"property list uint int vertex_indices\nend_header\n" + bytes(12)
    refused(tmp_path, "b.ply", huge + b"\xff\xff\xff\x7f" * 3, "only 0")


def test_bad_numbers_and_faces(tmp_path):
    refused(tmp_path, "a.obj", "v 0 0 zero\n", "'zero'")
    refused(tmp_path, "b.obj", "v 0 0\n", "at least 3 numbers")
    refused(tmp_path, "c.obj", "v 0 0 0\nf 1 1 2\n", "vertex 1")
    refused(tmp_path, "d.obj", "v 0 0 0\nf 0 1 1\n", "count from 1")
    refused(tmp_path, "e.obj", "v 0 0 0\nf -1 -2 -1\n", "beyond the first")
    refused(tmp_path, "f.obj", "f 1 2 3\n", "vertices")
    refused(tmp_path, "g.off", off().replace(b"3 0 3 2", b"3 0 3 8"), "1 of 12", "vertex 8")
    refused(tmp_path, "h.off", off().replace(b"3 0 3 2", b"3 0 3.5 2"), "3.5")
    refused(tmp_path, "i.off", off().replace(b"3 0 3 2", b"5 0 3 2"), "5 corners")
    refused(tmp_path, "j.off", b"OFF BINARY\n" + bytes(40), "binary")
    refused(tmp_path, "k.ply", ascii_ply() + b"7\n", "announces")
    refused(tmp_path, "l.ply", ascii_ply().replace(b"float z", b"float w"), "x, y, z")
    refused(tmp_path, "m.ply", ascii_ply().replace(b"vertex_indices", b"corners"), "vertex_indices")
    refused(tmp_path, "n.ply", ascii_ply().replace(b"property float x", b"property quad x"), "quad")
    refused(tmp_path, "o.ply", ascii_ply().replace(b"ascii 1.0", b"morse 1.0"), "morse")
    refused(tmp_path, "p.ply", ascii_ply().replace(b"element vertex", b"element corner"), "vertex")
    strips = b"element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    strips = ascii_ply().replace(b"end_header\n", strips) + b"3 0 1 2\n"
    refused(tmp_path, "q.ply", strips, "strips")
    refused(tmp_path, "r.pts", "9\n" + rows(POINTS), "9 points, but 8")
    refused(tmp_path, "s.xyz", "0 0 0\n1 2\n", "point 2")
    refused(tmp_path, "t.off", "OFF\n0 0 0\n", "no vertices")


def test_nan_vertices_are_refused_only_where_a_face_uses_them(tmp_path):
    lines = off().replace(b"1 1 0\n", b"1 nan 0\n")
    refused(tmp_path, "a.off", lines, "NaN", "vertex 2")
    refused(tmp_path, "b.xyz", "nan 0 0\ninf 0 0\n", "all its vertices")
    spare = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv nan 0 0\nf 1 2 3\n"
    assert len(read(tmp_path, "c.obj", spare).points) == 4
    assert len(read(tmp_path, "d.xyz", "0 0 0\nnan 0 0\n").points) == 2


def test_other_formats_need_trimesh(tmp_path, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    refused(tmp_path, "a.glb", b"glTF....", 'pip install "medialis[io]"')


def test_a_scene_is_read_with_its_transforms(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    scene = trimesh.Scene()
    shift = np.eye(4)
    shift[:3, 3] = [5, 0, 0]
    cube = trimesh.Trimesh(POINTS, FACES, process=False)
    scene.add_geometry(cube)
    scene.add_geometry(cube, transform=shift)
    mesh = read(tmp_path, "a.glb", scene.export(file_type="glb"))
    assert len(mesh.faces) == 24 and mesh.points[:, 0].max() == 6
    assert len(read(tmp_path, "noname", scene.export(file_type="glb")).faces) == 24
    refused(tmp_path, "b.glb", scene.export(file_type="glb")[:-200])


def attempt(path):
    """Read; anything but a mesh or a MedialisError of one sentence fails the test."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            mesh = read_mesh(path)
        except MedialisError as error:
            assert "\n" not in str(error)
        else:
            assert mesh.points.shape[1] == 3


@pytest.mark.parametrize("name", GOOD)
def test_every_truncation_is_a_mesh_or_a_sentence(tmp_path, name):
    data = GOOD[name]
    for size in range(0, len(data), 3):
        attempt(save(tmp_path, name, data[:size]))


@pytest.mark.slow
@pytest.mark.parametrize("name", GOOD)
@settings(
    max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    changes=st.lists(st.tuples(st.integers(0, 2000), st.integers(0, 255)), min_size=1, max_size=6)
)
def test_damaged_bytes_are_a_mesh_or_a_sentence(tmp_path, name, changes):
    data = bytearray(GOOD[name])
    for at, value in changes:
        data[at % len(data)] = value
    attempt(save(tmp_path, name, bytes(data)))


@pytest.mark.parametrize("name", GOOD)
def test_damaged_digits_are_a_mesh_or_a_sentence(tmp_path, name):
    """Text files are mostly digits: change those to what numbers can hold."""
    rng = np.random.default_rng(0)
    data = np.frombuffer(GOOD[name], np.uint8)
    for _ in range(60):
        copy = data.copy()
        at = rng.integers(len(copy), size=4)
        copy[at] = rng.choice(np.frombuffer(b"0123456789-+.einf \n/\\#v", np.uint8), size=4)
        attempt(save(tmp_path, name, copy.tobytes()))


def test_the_test_shapes_are_read(tmp_path):
    folder = Path(__file__).resolve().parents[3] / "shared" / "shapes"
    if not folder.is_dir():
        pytest.skip("the folder of test shapes (../shared/shapes) is not here")
    mesh = read_mesh(folder / "bunny.ply")
    assert mesh.points.shape == (34834, 3) and mesh.faces.shape == (69451, 3)


PLY_VIEWS = (
    "ply\nformat ascii 1.0\n{comment}element vertex 2\nproperty float x\nproperty float y\n"
    "property float z\n{more}end_header\n{rows}"
)


@pytest.mark.parametrize(
    ("name", "text", "expected"),
    [
        ("a.xyz", "# VIEWPOINT 1 2 3\n0 0 0\n1 0 0\n", [[1, 2, 3], [1, 2, 3]]),
        (
            "a.xyz",
            "// scanner position: -1 0 0\n// scanner position: 9 0 0\n0 0 0\n8 0 0\n",
            [[-1, 0, 0], [9, 0, 0]],
        ),
        (
            "a.ply",
            PLY_VIEWS.format(comment="comment viewpoint 1 2 3\n", more="", rows="0 0 0\n1 0 0\n"),
            [[1, 2, 3], [1, 2, 3]],
        ),
        (
            "a.ply",
            PLY_VIEWS.format(
                comment="",
                more="".join(f"property float vp_{c}\n" for c in "xyz"),
                rows="0 0 0 4 5 6\n1 0 0 7 8 9\n",
            ),
            [[4, 5, 6], [7, 8, 9]],
        ),
        (
            "a.ply",
            PLY_VIEWS.format(
                comment="",
                more="element camera 1\n" + "".join(f"property float view_p{c}\n" for c in "xyz"),
                rows="0 0 0\n1 0 0\n0 0 0\n",
            ),
            None,
        ),
        ("a.xyz", "# viewpoint unknown\n0 0 0\n1 0 0\n", None),
    ],
    ids=["text", "two scanners", "ply comment", "ply columns", "camera not set", "no numbers"],
)
def test_viewpoints_are_read(tmp_path, name, text, expected):
    path = tmp_path / name
    path.write_text(text)
    found = read_mesh(path).viewpoints
    assert found is None if expected is None else (found == expected).all()
