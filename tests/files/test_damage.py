"""Damaged files that took time or words without bound."""

import time

import numpy as np
import pytest

import medialis
from medialis.files import read_mesh


def test_a_word_of_slashes_costs_no_more_than_its_length(tmp_path):
    """A face of 1 MB of slashes took minutes (fixed)."""
    path = tmp_path / "a.obj"
    triangle = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\n"
    path.write_bytes(triangle + b"f 1//1 2//1 3" + b"/1" * 300_000 + b"x\n")
    begin = time.process_time()
    mesh = read_mesh(path)
    assert time.process_time() - begin < 5 and len(mesh.faces) == 1
    path.write_bytes(triangle + b"f 1//1 2/7/1 -1//-1\n")
    assert np.array_equal(read_mesh(path).faces, [[0, 1, 2]])


def test_a_sentence_about_a_foreign_file_is_short(tmp_path):
    """Names in a damaged file came back in its sentence with all their letters (fixed)."""
    pytest.importorskip("trimesh")
    path = tmp_path / "a.gltf"
    path.write_text('{"asset": {"version": "2.0"}, "buffers": [{"uri": "%s"}]}' % ("x" * 9000))
    with pytest.raises(medialis.InvalidShapeError) as error:
        read_mesh(path)
    assert len(str(error.value)) < 1000
