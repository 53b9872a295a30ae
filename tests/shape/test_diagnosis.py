"""Counts and measures of meshes with known answers, and of all test shapes."""

import json
from pathlib import Path

import numpy as np
import pytest

from medialis.base.errors import InvalidShapeError
from medialis.formats.meshes import read_mesh
from medialis.shape.diagnosis import diagnose

SHAPES = Path(__file__).resolve().parents[3] / "shared" / "shapes"

CUBE_POINTS = np.array([[x, y, z] for x in (0.0, 1) for y in (0.0, 1) for z in (0.0, 1)])
CUBE_QUADS = np.array(
    [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
)
CUBE_FACES = CUBE_QUADS[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)


def grid(rows, columns, wrap_rows, wrap_columns, twist=False):
    """Triangles of a rows x columns grid of points, rolled up; `twist` reverses the columns."""
    i, j = np.meshgrid(
        np.arange(rows if wrap_rows else rows - 1),
        np.arange(columns if wrap_columns else columns - 1),
        indexing="ij",
    )

    def at(a, b):
        b = np.where((a >= rows) & twist, columns - 1 - b, b)
        return (a % rows) * columns + b % columns

    a, b, c, d = at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)
    return np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)


def torus(rows=24, columns=16):
    u, v = np.meshgrid(
        np.arange(rows) * 2 * np.pi / rows, np.arange(columns) * 2 * np.pi / columns, indexing="ij"
    )
    ring = 2 + np.cos(v)
    points = np.stack([ring * np.cos(u), ring * np.sin(u), np.sin(v)], axis=-1).reshape(-1, 3)
    return points, grid(rows, columns, True, True)


def cylinder(rows=20, columns=5):
    u, z = np.meshgrid(np.arange(rows) * 2 * np.pi / rows, np.arange(columns) * 1.0, indexing="ij")
    points = np.stack([np.cos(u), np.sin(u), z], axis=-1).reshape(-1, 3)
    return points, grid(rows, columns, True, False)


def moebius(rows=20):
    u, w = np.meshgrid(np.arange(rows) * 2 * np.pi / rows, [-0.3, 0.3], indexing="ij")
    ring = 1 + w * np.cos(u / 2)
    points = np.stack([ring * np.cos(u), ring * np.sin(u), w * np.sin(u / 2)], axis=-1)
    return points.reshape(-1, 3), grid(rows, 2, True, False, twist=True)


def two_cubes(shift, shared):
    """Two cubes with the vertices of the second that `shared` maps to the first made one."""
    points = np.vstack([CUBE_POINTS, CUBE_POINTS + shift])
    place = np.arange(16)
    for second, first in shared.items():
        place[8 + second] = first
    faces = place[np.vstack([CUBE_FACES, CUBE_FACES + 8])]
    used, faces = np.unique(faces, return_inverse=True)
    return points[used], faces.reshape(-1, 3)


def test_cube_closed_form():
    d = diagnose(CUBE_POINTS, CUBE_FACES)
    assert (d.vertices, d.edges, d.faces) == (8, 18, 12)
    assert d.closed and d.genus == 0 and d.components == 1 and d.orientation == "out"
    assert (d.boundary_edges, d.boundary_loops, d.nonmanifold_edges) == (0, 0, 0)
    assert (d.nonmanifold_vertices, d.duplicate_faces, d.degenerate_faces) == (0, 0, 0)
    np.testing.assert_allclose([d.area, d.volume, d.diagonal], [6, 1, 3**0.5], rtol=1e-14)
    # 12 edges of length 1 and 6 diagonals of length sqrt(2).
    assert (d.min_edge, d.max_edge) == (1.0, pytest.approx(2**0.5))
    assert d.spacing == pytest.approx((12 + 6 * 2**0.5) / 18)


def test_torus_has_one_handle_and_turned_over_faces_inward():
    points, faces = torus(96, 64)
    d = diagnose(points, faces)
    assert d.genus == 1 and d.closed and d.orientation == "out"
    # Inscribed polygons lose a relative area of (2 pi / n)^2 / 6 each way: 0.0023 at most here.
    assert d.volume == pytest.approx(4 * np.pi**2, rel=0.003)
    assert diagnose(points, faces[:, ::-1]).orientation == "in"
    assert diagnose(points, faces[:, ::-1]).volume == pytest.approx(-d.volume)


def test_open_cylinder_and_flat_sheet():
    d = diagnose(*cylinder())
    assert not d.closed and d.boundary_loops == 2 and d.genus == 0 and d.volume is None
    assert d.orientation == "out" and d.boundary_edges == 40
    points = np.array([[x, y, 0.0] for x in range(4) for y in range(4)])
    assert diagnose(points, grid(4, 4, False, False)).orientation == "none"


def test_moebius_band_is_one_sided():
    d = diagnose(*moebius())
    assert d.genus is None and d.boundary_loops == 1 and d.orientation == "mixed"
    assert d.inconsistent_edges == 1 and d.components == 1


def test_cubes_that_share_an_edge_or_a_vertex():
    edge = diagnose(*two_cubes([1, 1, 0], {0: 6, 1: 7}))
    assert edge.nonmanifold_edges == 1 and edge.nonmanifold_vertices == 0
    assert edge.components == 1 and edge.genus is None and edge.closed
    assert edge.orientation == "mixed" and edge.inconsistent_edges == 0
    assert edge.volume == pytest.approx(2)
    vertex = diagnose(*two_cubes([1, 1, 1], {0: 7}))
    assert vertex.nonmanifold_vertices == 1 and vertex.nonmanifold_edges == 0
    assert vertex.components == 1 and vertex.genus is None and vertex.orientation == "out"


def test_troubles_are_counted():
    points = np.vstack([CUBE_POINTS, CUBE_POINTS[:2], [[5, 5, 5], [np.nan, 0, 0], [0, 0, 0.5]]])
    extra = [[0, 0, 1], [1, 3, 0], [3, 0, 1], [0, 1, 12]]
    d = diagnose(points, np.vstack([CUBE_FACES, extra]))
    # 0, 1 and 12 lie on a line; [0, 0, 1] repeats a corner.
    assert d.degenerate_faces == 2 and d.duplicate_faces == 2
    assert d.duplicate_vertices == 2 and d.unused_vertices == 4 and d.nonfinite_vertices == 1
    assert d.vertices == 13 and d.nonmanifold_edges == 3


def test_neighbours_that_disagree():
    faces = CUBE_FACES.copy()
    faces[0] = faces[0][::-1]
    d = diagnose(CUBE_POINTS, faces)
    assert d.orientation == "mixed" and d.inconsistent_edges == 3 and d.volume is None
    assert d.genus == 0


def test_cloud():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [3, 0, 0], [3, 0, 0]])
    d = diagnose(points)
    assert (d.faces, d.edges, d.components, d.closed, d.genus) == (0, 0, 0, False, None)
    assert d.orientation == "none" and d.volume is None and d.duplicate_vertices == 1
    assert (d.spacing, d.min_edge, d.max_edge) == (0.5, 0, 1)
    assert diagnose([[1, 2, 3]]).spacing == 0
    assert diagnose(points, np.empty((0, 3), int)) == d


def test_only_degenerate_faces():
    d = diagnose([[0, 0, 0], [1, 0, 0]], [[0, 0, 1], [1, 1, 1]])
    assert d.faces == 2 and d.degenerate_faces == 2 and not d.closed and d.edges == 0


@pytest.mark.parametrize("size", [1e-200, 1e-30, 1.0, 1e30, 1e100])
def test_counts_do_not_depend_on_scale_place_or_order(size):
    rng = np.random.default_rng(1)
    points, faces = torus()
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    rotation *= np.sign(np.linalg.det(rotation))
    order = rng.permutation(len(points))
    moved = ((points @ rotation.T + [5, -3, 2]) * size)[order]
    renamed = np.argsort(order)[faces][rng.permutation(len(faces))]
    a, b = diagnose(points, faces).as_dict(), diagnose(moved, renamed).as_dict()
    lengths = {"spacing": 1, "min_edge": 1, "max_edge": 1, "area": 2, "volume": 3}
    for name, power in lengths.items():
        scale = 1.0
        for _ in range(power):
            scale *= size
        assert b.pop(name) == pytest.approx(a.pop(name) * scale, rel=1e-9)
    a.pop("diagonal"), b.pop("diagonal")
    assert a == b


def test_inputs_stay_and_bad_input_is_refused():
    points, faces = CUBE_POINTS.copy(), CUBE_FACES.copy()
    diagnose(points, faces)
    np.testing.assert_array_equal(points, CUBE_POINTS)
    np.testing.assert_array_equal(faces, CUBE_FACES)
    broken = points.copy()
    broken[3] = np.inf
    for bad in ((points[:, :2], faces), (points, faces + 1), (broken, faces), (points * np.nan,)):
        with pytest.raises(InvalidShapeError):
            diagnose(*bad)


def test_summary_and_dict():
    text = diagnose(CUBE_POINTS, CUBE_FACES[:-1]).summary()
    assert "8 vertices, 11 faces" in text and "open (1 hole)" in text
    assert "point cloud of 8 points" in diagnose(CUBE_POINTS).summary()
    extra = np.vstack([CUBE_FACES, CUBE_FACES[:2], [[0, 0, 1]]])
    text = diagnose(np.vstack([CUBE_POINTS, CUBE_POINTS[:2]]), extra).summary()
    for line in ("2 duplicate vertices", "2 duplicate faces", "1 face without area"):
        assert line in text.splitlines()
    json.dumps(diagnose(CUBE_POINTS).as_dict())


def table_rows():
    if not (SHAPES / "README.md").is_file():
        return []
    rows = []
    for line in (SHAPES / "README.md").read_text().splitlines():
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        if len(cells) == 13 and cells[1].isdigit():
            rows.append(cells)
    return rows


@pytest.mark.slow
@pytest.mark.parametrize("row", table_rows() or [None], ids=lambda row: row[0] if row else "none")
def test_agrees_with_the_table_of_the_test_shapes(row):
    if row is None:
        pytest.skip("the folder of test shapes (../shared/shapes) is not here")
    mesh = read_mesh(SHAPES / f"{row[0]}.ply")
    d = diagnose(mesh.points, mesh.faces)
    assert [str(d.vertices), str(d.faces)] == row[1:3]
    assert f"{d.diagonal:.5g}" == row[11]
    assert d.duplicate_vertices == d.unused_vertices == d.nonfinite_vertices == 0
    if row[2] != "0":
        counts = (d.boundary_loops, d.nonmanifold_edges, d.nonmanifold_vertices, d.components)
        genus = "-" if d.genus is None else str(d.genus)
        found = ["yes" if d.closed else "no", *map(str, counts), genus, d.orientation]
        assert found == [*row[3:9], row[10]]
