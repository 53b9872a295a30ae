"""Repair never moves a vertex, and does each of its steps exactly where it is needed."""

from pathlib import Path

import numpy as np
import pytest

from medialis.base.arrays import first_equal_row
from medialis.base.errors import InvalidShapeError
from medialis.formats.meshes import read_mesh
from medialis.shape.diagnosis import diagnose, propagate_signs, winding_numbers
from medialis.shape.repair import repair

SHAPES = Path(__file__).resolve().parents[3] / "shared" / "shapes"

CUBE_POINTS = np.array([[x, y, z] for x in (0.0, 1) for y in (0.0, 1) for z in (0.0, 1)])
CUBE_QUADS = np.array(
    [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
)
CUBE_FACES = CUBE_QUADS[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)


def cubes(*parts):
    """Cubes as (size, corner, inward) in one mesh."""
    points = [CUBE_POINTS * size + corner for size, corner, _ in parts]
    faces = [
        (CUBE_FACES[:, ::-1] if inward else CUBE_FACES) + 8 * i
        for i, (_, _, inward) in enumerate(parts)
    ]
    return np.vstack(points), np.vstack(faces)


def sheet(rows, columns, height=None):
    x, y = np.meshgrid(np.arange(rows) * 1.0, np.arange(columns) * 1.0, indexing="ij")
    z = np.zeros_like(x) if height is None else height(x, y)
    i = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    a, b, c, d = i, i + columns, i + columns + 1, i + 1
    faces = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    return np.stack([x, y, z], axis=-1).reshape(-1, 3), faces


def check_maps(result, points, faces):
    """What is documented of every repair: nothing moved, maps that fit."""
    points, faces = np.asarray(points, float), np.asarray(faces)
    kept = result.vertex_map >= 0
    np.testing.assert_array_equal(result.points[result.vertex_map[kept]], points[kept])
    assert set(result.vertex_map[kept]) == set(range(len(result.points)))
    assert len(result.face_map) == len(result.faces)
    assert result.vertex_map.dtype == result.face_map.dtype == np.int32
    return result


def told(result):
    """Codes and counts of the messages."""
    return [(message.code, dict(message.data)) for message in result.messages]


def test_a_clean_mesh_stays_as_it_is():
    points, faces = CUBE_POINTS.copy(), CUBE_FACES.astype(np.int32)
    result = check_maps(repair(points, faces), points, faces)
    assert result.messages == () and result.normals is None
    assert np.shares_memory(result.points, points) and np.shares_memory(result.faces, faces)
    np.testing.assert_array_equal(result.vertex_map, np.arange(8))
    np.testing.assert_array_equal(result.face_map, np.arange(12))


def test_triangle_soup_is_welded():
    soup = CUBE_POINTS[CUBE_FACES].reshape(-1, 3)
    soup[0] = -0.0  # the corner at the origin, as STL writers may give it
    result = check_maps(repair(soup, np.arange(36).reshape(-1, 3)), soup, np.arange(36))
    assert len(result.points) == 8 and diagnose(result.points, result.faces).closed
    assert told(result) == [("welded", {"points": 28})]
    assert result.messages == ("Welded 28 points lying exactly on another one.",)
    np.testing.assert_array_equal(result.points[result.faces], CUBE_POINTS[CUBE_FACES])


def test_cloud_is_welded_and_keeps_the_first_normal_that_is_not_zero():
    points = [[0, 0, 0], [1, 0, 0], [0, 0, 0], [0, 0, 0], [np.nan, 0, 0]]
    normals = [[0, 0, 0], [0, 3, 0], [0, 0, 2], [1, 0, 0], [1, 0, 0]]
    result = repair(points, None, normals)
    np.testing.assert_array_equal(result.points, [[0, 0, 0], [1, 0, 0]])
    np.testing.assert_array_equal(result.normals, [[0, 0, 1], [0, 1, 0]])
    np.testing.assert_array_equal(result.vertex_map, [0, 1, 0, 0, -1])
    assert result.faces is None and len(result.messages) == 2


def test_useless_faces_and_vertices_are_dropped():
    points = np.vstack([CUBE_POINTS, [[7, 7, 7], [np.inf, 0, 0]]])
    faces = np.vstack([CUBE_FACES, [[0, 0, 1], CUBE_FACES[3], CUBE_FACES[3][[1, 2, 0]]]])
    result = repair(points, faces)
    np.testing.assert_array_equal(result.faces, CUBE_FACES)
    np.testing.assert_array_equal(result.face_map, np.arange(12))
    np.testing.assert_array_equal(result.vertex_map, [*range(8), -1, -1])
    assert told(result) == [
        ("not_finite_dropped", {"points": 1}),
        ("repeated_corners", {"faces": 1}),
        ("duplicates_dropped", {"faces": 2}),
        ("unused_dropped", {"vertices": 1}),
    ]


@pytest.mark.parametrize("flips", [1, 5, 6, 9, 12])
def test_neighbours_agree_and_the_cube_faces_outward(flips):
    faces = CUBE_FACES.copy()
    faces[:flips] = faces[:flips, ::-1]
    result = check_maps(repair(CUBE_POINTS, faces), CUBE_POINTS, faces)
    d = diagnose(result.points, result.faces)
    assert d.orientation == "out" and d.volume == pytest.approx(1)
    np.testing.assert_array_equal(np.sort(result.faces), np.sort(CUBE_FACES))
    if flips < 6:
        assert told(result) == [("faces_flipped", {"faces": flips})]


def test_a_flat_face_is_merged_into_its_neighbour_without_a_slit():
    """Dropping the flat face 0, 8, 1 would leave a slit of three boundary edges."""
    points = np.vstack([CUBE_POINTS, [[0, 0, 0.25]]])
    edge = [f for f in CUBE_FACES.tolist() if {0, 1} <= set(f)]
    faces = [f for f in CUBE_FACES.tolist() if f not in edge]
    split = next(f for f in edge if 0 in f)
    whole = next(f for f in edge if f is not split)
    for old, new in ((0, 8), (1, 8)):
        faces.append([new if v == old else v for v in split])
    faces.append(whole)
    # Fill between the split side and the whole one: a face without area.
    j = next(j for j in range(3) if {whole[j], whole[(j + 1) % 3]} == {0, 1})
    faces.append([whole[(j + 1) % 3], whole[j], 8])
    before = diagnose(points, faces)
    assert before.closed and before.degenerate_faces == 1
    result = check_maps(repair(points, faces), points, faces)
    after = diagnose(result.points, result.faces)
    assert after.closed and after.degenerate_faces == 0 and after.genus == 0
    assert after.volume == pytest.approx(1) and after.area == pytest.approx(6)
    assert len(result.faces) == len(faces) and told(result) == [("flat_faces_merged", {"faces": 1})]
    assert (result.face_map == len(faces) - 2).sum() == 2
    alone = repair([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0]], [[0, 1, 2], [0, 1, 3]])
    np.testing.assert_array_equal(alone.faces, [[0, 1, 2]])


def test_a_small_fold_is_dropped_and_a_double_sheet_is_not():
    points = np.vstack([CUBE_POINTS, [[2, 2, 2]]])
    fold = [[0, 1, 8], [1, 0, 8]]
    result = repair(points, np.vstack([CUBE_FACES, fold]))
    np.testing.assert_array_equal(result.faces, CUBE_FACES)
    assert told(result)[0] == ("folds_dropped", {"faces": 2})
    points, faces = sheet(4, 4)
    result = repair(points, np.vstack([faces, faces[:, ::-1]]))
    np.testing.assert_array_equal(result.faces, faces)
    assert told(result)[0] == ("duplicates_dropped", {"faces": 18})


def test_a_cavity_stays_inward():
    solid = (4, [0, 0, 0], False)
    points, faces = cubes(solid, (2, [1, 1, 1], True))
    result = repair(points, faces)
    np.testing.assert_array_equal(result.faces, faces)
    assert told(result) == [("cavities_kept", {"cavities": 1})]


def test_everything_inside_an_inverted_piece_is_turned_along():
    """A hollow cube turned inside out comes back as a hollow cube; so does an island in it."""
    right = cubes((8, [0, 0, 0], False), (6, [1, 1, 1], True), (4, [2, 2, 2], False))
    result = repair(right[0], right[1][:, ::-1])
    parts = [diagnose(right[0], result.faces[12 * i : 12 * i + 12]) for i in range(3)]
    assert [d.orientation for d in parts] == ["out", "in", "out"]
    assert told(result)[0] == ("closed_turned", {"pieces": 3})


def test_separate_and_nested_solids_all_face_outward():
    outside = cubes((1, [0, 0, 0], True), (1, [3, 0, 0], False), (1, [0.5, 3, 0], True))
    assert diagnose(outside[0], repair(*outside).faces).volume == pytest.approx(3)
    island = cubes((8, [0, 0, 0], False), (6, [1, 1, 1], True), (4, [2, 2, 2], True))
    parts = repair(*island).faces.reshape(3, 12, 3)
    assert [diagnose(island[0], f).orientation for f in parts] == ["out", "in", "out"]


def test_overlapping_boxes_are_not_nested():
    """The box of an L holds the cube in its notch, the L does not."""
    outline = np.array([[0, 0], [6, 0], [6, 1], [1, 1], [1, 6], [0, 6]], float)
    top = np.column_stack([outline, np.full(6, 2.0)])
    bottom = np.column_stack([outline, np.zeros(6)])
    caps = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]])
    i, j = np.arange(6), (np.arange(6) + 1) % 6
    sides = np.vstack([np.stack([6 + i, 6 + j, j], 1), np.stack([6 + i, j, i], 1)])
    faces = np.vstack([caps, caps[:, ::-1] + 6, sides])
    points = np.vstack([top, bottom, CUBE_POINTS + np.array([3, 3, 0.5])])
    faces = np.vstack([faces, CUBE_FACES[:, ::-1] + 12])
    fixed = repair(points, faces).faces
    assert diagnose(points, fixed).volume == pytest.approx(11 * 2 + 1)


def test_open_pieces_are_turned_only_when_clear():
    bowl = sheet(9, 9, lambda x, y: 8 - ((x - 4) ** 2 + (y - 4) ** 2) / 4)
    assert repair(*bowl).messages == ()
    turned = repair(bowl[0], bowl[1][:, ::-1])
    np.testing.assert_array_equal(np.sort(turned.faces), np.sort(bowl[1]))
    assert told(turned) == [("open_turned", {"pieces": 1})]
    flat, faces = sheet(5, 5)
    wavy = sheet(9, 9, lambda x, y: np.sin(x * np.pi / 2) * np.sin(y * np.pi / 2))
    for points, triangles in ((flat, faces), wavy):
        for side in (triangles, triangles[:, ::-1]):
            result = repair(points, side)
            np.testing.assert_array_equal(result.faces, side)
            assert result.messages == ()


def test_a_surface_given_twice_keeps_both_sides_outward():
    """As a mirror leaves it: the rims are the same points, the rest differs by rounding."""
    points, faces = sheet(9, 9, lambda x, y: 8 - ((x - 4) ** 2 + (y - 4) ** 2) / 4)
    rim = (points[:, :2] == 0).any(axis=1) | (points[:, :2] == 8).any(axis=1)
    again = points * np.where(rim, 1.0, 1 + 1e-8)[:, None]
    given = np.vstack([faces, faces + len(points)])
    result = repair(np.vstack([points, again]), given)
    assert [code for code, _ in told(result)] == ["welded", "duplicates_dropped"]
    facing = np.cross(*(result.points[result.faces[:, k]] - result.points[result.faces[:, 0]]
                        for k in (1, 2)))  # fmt: skip
    assert (facing[:, 2] > 0).all()
    # One copy facing the other way is a thin shell, closed at the rim: it stays.
    inner = np.vstack([faces, faces[:, ::-1] + len(points)])
    shell = repair(np.vstack([points, again]), inner)
    assert "faces_flipped" not in [code for code, _ in told(shell)]


def test_moebius_band_says_so_and_ends():
    u, w = np.meshgrid(np.arange(20) * np.pi / 10, [-0.3, 0.3], indexing="ij")
    ring = 1 + w * np.cos(u / 2)
    points = np.stack([ring * np.cos(u), ring * np.sin(u), w * np.sin(u / 2)], -1).reshape(-1, 3)
    a = np.arange(0, 40, 2)
    b, c, d = (a + 2) % 40, (a + 3) % 40, a + 1
    b[-1], c[-1] = 1, 0
    faces = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    result = repair(points, faces)
    assert told(result)[-1] == ("one_sided", {"faces": 40})
    np.testing.assert_array_equal(result.faces, faces)


def test_normals_follow_their_faces():
    center = CUBE_POINTS.mean(axis=0)
    outward = (CUBE_POINTS - center) / np.linalg.norm(CUBE_POINTS - center, axis=1)[:, None]
    inside_out = CUBE_FACES[:, ::-1]
    np.testing.assert_allclose(repair(CUBE_POINTS, inside_out, -outward).normals, outward)
    # Normals that were right although the faces were not stay right.
    np.testing.assert_allclose(repair(CUBE_POINTS, inside_out, outward).normals, outward)
    np.testing.assert_allclose(repair(CUBE_POINTS, CUBE_FACES, outward).normals, outward)


def test_cubes_sharing_an_edge_are_turned_one_by_one():
    points, faces = cubes((1, [0, 0, 0], False), (1, [1, 1, 0], True))
    result = repair(points, faces)
    d = diagnose(result.points, result.faces)
    assert d.nonmanifold_edges == 0 and d.components == 2 and d.volume == pytest.approx(2)


def test_repair_does_not_depend_on_order_or_pose_and_repeats():
    rng = np.random.default_rng(3)
    points, faces = cubes((8, [0, 0, 0], True), (6, [1, 1, 1], False), (4, [20, 2, 2], True))
    faces[::5] = faces[::5, ::-1]
    volume = diagnose(points, repair(points, faces).faces).volume
    for _ in range(4):
        order = rng.permutation(len(points))
        rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        rotation *= np.sign(np.linalg.det(rotation))
        moved = (points @ rotation.T)[order]
        renamed = np.argsort(order)[faces][rng.permutation(len(faces))]
        once = check_maps(repair(moved, renamed), moved, renamed)
        assert diagnose(once.points, once.faces).volume == pytest.approx(volume)
        twice = repair(once.points, once.faces)
        np.testing.assert_array_equal(once.faces, twice.faces)


def test_inputs_stay_and_bad_input_is_refused():
    points = np.vstack([CUBE_POINTS, CUBE_POINTS])
    faces = np.vstack([CUBE_FACES[:, ::-1], CUBE_FACES + 8])
    normals = np.ones((16, 3))
    copies = points.copy(), faces.copy(), normals.copy()
    repair(points, faces, normals)
    for now, before in zip((points, faces, normals), copies, strict=True):
        np.testing.assert_array_equal(now, before)
    broken = CUBE_POINTS.copy()
    broken[3] = np.nan
    for bad in (
        (CUBE_POINTS[:, :2], CUBE_FACES),
        (CUBE_POINTS, CUBE_FACES + 1),
        (CUBE_POINTS, CUBE_FACES - 1),
        (CUBE_POINTS, CUBE_FACES, np.ones((7, 3))),
        (broken, CUBE_FACES),
        (CUBE_POINTS * np.nan,),
        (np.empty((0, 3)),),
        (CUBE_POINTS, [[0, 0, 1]]),
        ([["a", "b", "c"]], [[0, 0, 0]]),
    ):
        with pytest.raises(InvalidShapeError):
            repair(*bad)
    assert repair(CUBE_POINTS, np.empty((0, 3), int)).faces.shape == (0, 3)


def test_propagate_signs_against_a_walk():
    rng = np.random.default_rng(0)
    parent = np.array([-1, *(rng.integers(i) for i in range(1, 500))])
    parent[[40, 200]] = -9999
    agree = rng.choice([-1, 1], 500)
    expected = np.ones(500, int)
    for i in range(500):
        if parent[i] >= 0:
            expected[i] = expected[parent[i]] * agree[i]
    np.testing.assert_array_equal(propagate_signs(parent, agree), expected)
    assert propagate_signs([], []).shape == (0,)


def test_first_equal_row_against_a_dictionary():
    rows = np.random.default_rng(0).integers(4, size=(300, 3))
    seen: dict = {}
    expected = [seen.setdefault(tuple(row), i) for i, row in enumerate(rows.tolist())]
    np.testing.assert_array_equal(first_equal_row(rows), expected)
    np.testing.assert_array_equal(first_equal_row(rows * -0.5), expected)


def test_winding_numbers_of_a_cube():
    queries = np.array([[0.5, 0.5, 0.5], [0.1, 0.9, 0.2], [1.5, 0.5, 0.5], [-3, 2, 1]])
    triangles = CUBE_POINTS[CUBE_FACES]
    np.testing.assert_allclose(winding_numbers(queries, triangles), [1, 1, 0, 0], atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["bunny", "horse", "ogre", "spider", "dragon"])
def test_the_test_shapes(name):
    if not SHAPES.is_dir():
        pytest.skip("the folder of test shapes (../shared/shapes) is not here")
    mesh = read_mesh(SHAPES / f"{name}.ply")
    result = check_maps(repair(mesh.points, mesh.faces), mesh.points, mesh.faces)
    assert (len(result.messages) == 0) == (name in ("bunny", "spider"))
    d = diagnose(result.points, result.faces)
    assert d.degenerate_faces == d.inconsistent_edges == d.duplicate_faces == 0
    assert d.orientation == ("mixed" if name in ("spider", "dragon") else "out")
    if name == "ogre":  # four flat faces, merged without opening the surface
        assert d.boundary_loops == 5 and d.genus == 1
    assert repair(result.points, result.faces).messages == ()
