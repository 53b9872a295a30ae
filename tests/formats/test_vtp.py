"""VTP files, read back by a reader that follows VTK's description of the format."""

import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

import medialis
from medialis.cli.commands import main
from medialis.formats.files import Drawn
from medialis.formats.vtk import write_vtp

KINDS = {"Int": "i", "UInt": "u", "Float": "f"}
TETRAHEDRON = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], np.int32)


class Piece:
    """What a file says: arrays of points, cells and data by their names."""

    def __init__(self, path):
        text, _, rest = path.read_bytes().partition(b'<AppendedData encoding="raw">\n_')
        self.root = ElementTree.fromstring(text + b"</VTKFile>")
        assert self.root.get("type") == "PolyData" and self.root.get("header_type") == "UInt64"
        self.piece = self.root.find("PolyData/Piece")
        self.binary = rest
        assert rest.endswith(b"\n</AppendedData>\n</VTKFile>\n")

    def arrays(self, part):
        return {a.get("Name"): self.array(a) for a in self.piece.iterfind(f"{part}/DataArray")}

    def array(self, about):
        name = about.get("type")
        size = int("".join(filter(str.isdigit, name)))
        kind = np.dtype(f"<{KINDS[name.rstrip('0123456789')]}{size // 8}")
        start = int(about.get("offset"))
        count = int(np.frombuffer(self.binary, "<u8", 1, start)[0])
        values = np.frombuffer(self.binary, kind, count // kind.itemsize, start + 8)
        width = about.get("NumberOfComponents")
        return values if width is None else values.reshape(-1, int(width))

    def cells(self, part):
        """Rows of corners; all of them have the same length here."""
        held = self.arrays(part)
        ends, corners = held["offsets"], held["connectivity"]
        assert len(ends) == int(self.piece.get(f"NumberOf{part}"))
        width = int(ends[0]) if len(ends) else 1
        assert np.array_equal(ends, width * np.arange(1, len(ends) + 1))
        return corners.reshape(-1, width)


def test_points_triangles_and_values_come_back(tmp_path):
    given = {
        "height": TETRAHEDRON[:, 2],
        "number": np.array([2**40, -1, 0, 3]),
        "mask": np.array([True, False, True, False]),
        "nothing": np.array([np.nan, np.inf, 0, 1], np.float32),
        "turn <&> \"'": np.arange(36.0).reshape(4, 3, 3),
        "swapped": np.arange(4, dtype=">i2"),
    }
    on_faces = {"area": np.array([0.5, 0.5, 0.9, 0.5]), "side": np.arange(4, dtype=np.int8)}
    write_vtp(tmp_path / "a.vtp", Drawn(TETRAHEDRON, FACES, None, given, on_faces, "height"))
    piece = Piece(tmp_path / "a.vtp")
    assert np.array_equal(piece.arrays("Points")["Points"], TETRAHEDRON)
    assert np.array_equal(piece.cells("Polys"), FACES)
    assert len(piece.cells("Verts")) == len(piece.cells("Lines")) == 0
    found = piece.arrays("PointData")
    assert list(found) == list(given)
    for name, values in given.items():
        assert np.array_equal(found[name], values.reshape(found[name].shape), equal_nan=True)
    assert found["mask"].dtype == np.uint8 and found["number"].dtype == np.int64
    assert piece.piece.find("PointData").get("Scalars") == "height"
    assert all(np.array_equal(piece.arrays("CellData")[k], v) for k, v in on_faces.items())


def test_points_alone_are_cells_and_lines_have_no_values_of_faces(tmp_path):
    write_vtp(tmp_path / "a.vtp", Drawn(TETRAHEDRON))
    assert Piece(tmp_path / "a.vtp").cells("Verts").tolist() == [[0], [1], [2], [3]]
    edges, values = np.array([[0, 1], [2, 3]]), {"area": np.ones(4), "label": np.arange(4)}
    write_vtp(tmp_path / "b.vtp", Drawn(TETRAHEDRON, FACES, edges, {}, values))
    piece = Piece(tmp_path / "b.vtp")
    assert np.array_equal(piece.cells("Lines"), edges) and len(piece.cells("Verts")) == 0
    held = piece.arrays("CellData")  # VTK's order: points, lines, triangles
    assert np.isnan(held["area"][:2]).all() and (held["area"][2:] == 1).all()
    assert held["label"].tolist() == [0, 0, 0, 1, 2, 3]


@pytest.mark.parametrize("values", [np.arange(3), np.array(["a"] * 4), np.array(1.0)])
def test_other_values_are_refused_and_nothing_is_written(tmp_path, values):
    with pytest.raises(medialis.InvalidOptionError, match="attribute 'x'"):
        write_vtp(tmp_path / "a.vtp", Drawn(TETRAHEDRON, FACES, None, {"x": values}))
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
@pytest.mark.parametrize("name", ["thickness", "curve_skeleton"])
def test_every_layer_of_a_result_is_written(tmp_path, name):
    result = medialis.run(name, medialis.organic_shape(56))
    no_picture = medialis.Pictures(main=False)
    medialis.write_result(result, tmp_path / "a", formats=["vtp"], pictures=no_picture)
    for layer in result.layers:
        piece = Piece(tmp_path / "a" / f"{layer.name}.vtp")
        assert np.array_equal(piece.arrays("Points")["Points"], layer.points)
        for part, rows in (("Polys", layer.faces), ("Lines", layer.edges)):
            assert len(piece.cells(part)) == (0 if rows is None else len(rows))
        assert set(piece.arrays("PointData")) == set(layer.attributes)
        assert set(piece.arrays("CellData")) == set(layer.face_attributes)
    assert medialis.read_result(tmp_path / "a").values == result.values


@pytest.mark.slow
def test_the_command_line_writes_them_for_every_operation(tmp_path, capsys):
    medialis.write_mesh(tmp_path / "a.ply", medialis.organic_shape(56))
    given = ["thickness", str(tmp_path / "a.ply"), "--no-picture", "-o", str(tmp_path / "out")]
    assert main([*given, "--formats", "vtp"]) == 0
    assert "for ParaView" in capsys.readouterr().out
    assert (tmp_path / "out" / "thickness.vtp").is_file()
    assert main([*given, "--overwrite"]) == 0
    assert not list((tmp_path / "out").glob("*.vtp"))
    assert main([*given, "--overwrite", "--formats", "vtk"]) == 2
    assert "vtp" in capsys.readouterr().err
