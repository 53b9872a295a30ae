"""Arrays as text: undone here with numpy, as unpack.js does in the page."""

import base64
import zlib

import numpy as np
import pytest

from medialis.show.viewer.page import INFINITE, LEVELS, MISSING, Packer, point_codes, value_codes


def unpacked(packer: Packer, where: dict) -> np.ndarray:
    data = zlib.decompress(base64.b64decode(packer.text()))
    rows, columns, width = where["rows"], where["columns"], where["bytes"]
    block = np.frombuffer(data, np.uint8, rows * columns * width, where["at"])
    planes = block.reshape(width, columns, rows).astype(np.uint64)
    folded = sum(plane << np.uint64(8 * byte) for byte, plane in enumerate(planes)).astype(np.int64)
    steps = np.where(folded % 2, -(folded + 1) // 2, folded // 2)
    return (np.cumsum(steps, axis=1) if where["differences"] else steps).T


TABLES = {
    "nothing": np.empty((0, 3), int),
    "one": np.array([[7]]),
    "large": np.array([[0], [2**31 - 1], [0], [-(2**31)]]),
    "random": np.random.default_rng(0).integers(0, 65_536, (1000, 3)),
    "slow": np.cumsum(np.random.default_rng(1).integers(-2, 3, (1000, 2)), axis=0),
}


@pytest.mark.parametrize("differences", [True, False])
def test_whole_numbers_come_back(differences):
    packer = Packer()
    places = {name: packer.add(table, differences=differences) for name, table in TABLES.items()}
    for name, table in TABLES.items():
        assert np.array_equal(unpacked(packer, places[name]), table), name


def test_triangles_come_back_turned_and_sorted():
    rng = np.random.default_rng(2)
    faces = np.array([rng.permutation(500)[:3] for _ in range(300)], np.int32)
    packer = Packer()
    first, above = packer.add_faces(faces)
    a, rest = unpacked(packer, first), unpacked(packer, above)
    found = np.concatenate([a, a + rest], axis=1)
    assert {tuple(row) for row in found} == {
        tuple(np.roll(face, -int(face.argmin()))) for face in faces
    }


def test_points_are_off_by_half_a_step():
    points = np.random.default_rng(3).normal(size=(1000, 3)) * [1, 5, 0.1] + 1e6
    codes, place = point_codes(points)
    back = np.array(place["low"]) + place["step"] * codes
    assert codes.min() == 0 and codes.max() == 65_535
    assert np.abs(back - points).max() <= 0.5 * place["step"] * (1 + 1e-6)


def test_points_in_one_place_and_none_at_all():
    assert point_codes(np.ones((4, 3)))[0].max() == 0
    assert point_codes(np.empty((0, 3)))[0].shape == (0, 3)


def test_values_keep_infinity_and_nothing():
    values = np.array([0.0, 0.5, 2.0, np.inf, np.nan])
    codes, place = value_codes(values)
    assert codes.tolist() == [0, round(LEVELS / 4), LEVELS, INFINITE, MISSING]
    assert (place["low"], place["high"]) == (0.0, 2.0)
    assert value_codes(np.array([np.nan]))[0].tolist() == [MISSING]
    assert value_codes(np.full(3, 7.0))[0].tolist() == [0, 0, 0]
