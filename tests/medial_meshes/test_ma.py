"""MA files: the same arrays back, and what other programs write."""

import numpy as np
import pytest

import medialis
from medialis.base.errors import FileError, InvalidShapeError


def test_a_mesh_comes_back_to_the_last_digit(tmp_path):
    rng = np.random.default_rng(0)
    mesh = medialis.MedialMesh(
        rng.normal(size=(4, 3)) / 3, rng.random(4), [[0, 1], [0, 2], [1, 2], [2, 3]], [[0, 1, 2]]
    )
    medialis.write_ma(tmp_path / "mesh.ma", mesh)
    found = medialis.read_ma(tmp_path / "mesh.ma")
    for name in ("centers", "radii", "edges", "faces"):
        assert np.array_equal(getattr(found, name), getattr(mesh, name))


@pytest.mark.parametrize(
    "text",
    [
        "3 3 1\nv 0 0 0 1\nv 1 0 0 1\nv 0 1 0 2\ne 0 1\ne 1 2\ne 0 2\nf 0 1 2\n",
        "3\t0\t1\nv 0 0 0 1\nv 1 0 0 1\nv 0 1 0 2\nf 2 1 0\n",  # sides left out
        "3 4 2\n\n# Q-MAT\nv 0 0 0 1 0\nv 1 0 0 1 1\nv 0 1 0 2 0\ne 0 1 1\ne 1 0\ne 2 2\ne 2 1\n"
        "f 0 1 2\nf 2 0 1\n",  # flags behind, rows twice
        # MATFP: fixed digits, a type and whether it was deleted, balls counted without those
        "3 3 1\nv 0.000000000000000 0.0 0.0 1.000000000000000 2 0\nv 9 9 9 1 1 1\nv 1 0 0 1 2 0\n"
        "v 0 1 0 2.0 0 0\ne 0 2 0\ne 2 3 1\ne 0 3 2 0\ne 0 1 0\nf 0 2 3\nf 0 1 3\n",
        # as its description has it: deleted edges and triangles stay in the file
        "3 4 2\nv 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 0 1 0 2 0 0\n"
        "v 0 1 1 2 0 1\ne 2 3 0 1\nf 0 1 2 0\nf 1 2 3 1\n",
        # Windows line ends, no line end behind the last row, nothing but counts of triangles
        "3 0 1\r\nv 0 0 0 1\r\nv 1 0 0 1.0e+00\r\nv 0 1 0 2\r\nf 0 1 2",
    ],
)
def test_other_programs_are_read(tmp_path, text):
    (tmp_path / "other.ma").write_text(text)
    mesh = medialis.read_ma(tmp_path / "other.ma")
    assert mesh.radii.tolist() == [1, 1, 2]
    assert mesh.edges.tolist() == [[0, 1], [0, 2], [1, 2]] and mesh.faces.tolist() == [[0, 1, 2]]


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("2 0 0\nv 0 0 0 1\n", "cut off"),
        ("1 0 0\nv 0 0 0 1 0 1\n", "deleted"),
        ("0 0 0\n", "no balls"),
        ("1 0 0\nv 0 0 1\n", "3 of 4 numbers"),
        ("1 1 0\nv 0 0 0 1\ne 0 1\n", "from 0 to 0"),
        ("1 0 0\nv 0 0 0 x\n", "damaged"),
        ("1 0 0\nv 0 0 0 nan\n", "finite"),
    ],
)
def test_damaged_files_are_refused(tmp_path, text, sentence):
    (tmp_path / "bad.ma").write_text(text)
    with pytest.raises(InvalidShapeError, match=sentence):
        medialis.read_ma(tmp_path / "bad.ma")
    with pytest.raises(FileError):
        medialis.read_ma(tmp_path / "missing.ma")
