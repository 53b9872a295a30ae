"""Surface: closed forms of each quantity, awkward meshes, clouds, and any order of the elements."""

import math
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import closed_forms as forms
import medialis
from medialis.base.arrays import EdgeTable
from medialis.base.errors import InvalidShapeError
from medialis.shape.surface import Surface, link_matrix, piece_labels
from oracles import component_labels, edge_uses

QUANTITIES = (
    *("face_vectors", "face_areas", "face_normals", "point_areas", "edges", "edge_lengths"),
    *("edge_twins", "face_adjacency", "used_points", "components", "closed_components"),
    "face_pieces",
)

BOOK = Surface(  # three pages on the edge 0 1
    [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1]], [[0, 1, 2], [1, 0, 3], [0, 1, 4]]
)

FACES = st.lists(st.lists(st.integers(0, 7), min_size=3, max_size=3), min_size=1, max_size=14)


def any_surface(faces):
    return Surface(np.random.default_rng(1).normal(size=(8, 3)), np.array(faces))


def hexagon():
    """Six equilateral triangles of side 2 round the vertex 0."""
    angle = np.arange(6) * math.pi / 3
    rim = np.stack([2 * np.cos(angle), 2 * np.sin(angle), 0 * angle], axis=1)
    i = np.arange(6)
    faces = np.stack([0 * i, 1 + i, 1 + (i + 1) % 6], axis=1)
    return Surface(np.vstack([[0, 0, 0], rim]), faces)


def test_areas_and_normals_of_a_hexagon():
    hexagon_ = hexagon()
    each = math.sqrt(3)  # of an equilateral triangle of side 2
    assert hexagon_.face_areas == pytest.approx(np.full(6, each))
    assert hexagon_.area == pytest.approx(6 * each)
    assert hexagon_.face_normals == pytest.approx(np.tile([0, 0, 1.0], (6, 1)))
    assert hexagon_.face_vectors == pytest.approx(2 * each * hexagon_.face_normals)
    assert hexagon_.point_areas == pytest.approx([2 * each, *[2 / 3 * each] * 6])
    assert hexagon_.edge_lengths == pytest.approx(np.full(12, 2.0))
    assert hexagon_.spacing == pytest.approx(2) and hexagon_.diagonal == pytest.approx(
        math.hypot(4, 2 * each)
    )


def test_bends_of_a_cube_and_of_a_folded_page():
    cube = forms.cube()
    bends = np.degrees(cube.edge_bends)
    assert np.sort(bends) == pytest.approx(np.repeat([0.0, 90.0], [6, 12]), abs=1e-6)
    points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, math.cos(1), math.sin(1)]]
    assert Surface(points, [[0, 1, 2], [1, 0, 3]]).edge_bends == pytest.approx([math.pi - 1])
    flat = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0]]  # the second face has no area
    assert Surface(flat, [[0, 1, 2], [1, 0, 3]]).edge_bends.tolist() == [0.0]


def test_cotangents_of_a_hexagon_and_of_right_angles():
    """cot 60 = 1 / sqrt 3; an edge inside has two such angles across, one of the rim has one."""
    weights = hexagon().cotangent_weights.toarray()
    assert weights[0, 1:] == pytest.approx(np.full(6, 1 / math.sqrt(3)))
    assert weights[1, 2] == pytest.approx(0.5 / math.sqrt(3)) and weights[1, 3] == 0
    assert (weights == weights.T).all()
    square = Surface([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    weights = square.cotangent_weights.toarray()
    assert weights[0, 1] == pytest.approx(0.5) and weights[0, 2] == pytest.approx(0, abs=1e-15)


def test_linear_functions_are_harmonic_on_a_flat_mesh():
    """The cotangent Laplacian of x and y is 0 at each vertex inside, however the sheet is cut."""
    n = 7
    x, y = (part.ravel() for part in np.meshgrid(np.arange(n), np.arange(n)))
    inside = (x > 0) & (y > 0) & (x < n - 1) & (y < n - 1)
    jitter = 0.3 * np.random.default_rng(0).uniform(-1, 1, (n * n, 2)) * inside[:, None]
    points = np.column_stack([np.stack([x, y], axis=1) + jitter, np.zeros(n * n)])
    a = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    sheet = Surface(points, np.vstack([np.c_[a, a + 1, a + n + 1], np.c_[a, a + n + 1, a + n]]))
    weights = sheet.cotangent_weights
    laplacian = weights @ points - np.asarray(weights.sum(axis=1))[:, None] * points
    assert np.abs(laplacian[inside]).max() < 1e-12
    assert sheet.area == pytest.approx((n - 1) ** 2)
    assert sheet.border_edges == 4 * (n - 1)
    border = sheet.edges[np.isin(np.arange(len(sheet.edges)), _rim(sheet))]
    assert not inside[border].any()


def _rim(surface):
    return np.flatnonzero(surface.edge_table.counts == 1)


def test_a_cube_is_closed_and_each_quantity_adds_up():
    cube = forms.cube()
    assert cube.area == pytest.approx(24) and cube.point_areas.sum() == pytest.approx(24)
    assert cube.face_vectors.sum(axis=0) == pytest.approx(0)  # of any closed surface
    assert len(cube.edges) == 18 and cube.border_edges == 0
    assert sorted(cube.edge_lengths) == pytest.approx([2.0] * 12 + [math.sqrt(8)] * 6)
    assert (cube.edge_twins[cube.edge_twins] == np.arange(36)).all()
    assert cube.closed_components.tolist() == [True] and cube.part_count == 1
    assert cube.face_pieces.tolist() == [0] * 12 and cube.used_points.all()
    assert cube.edge_matrix.sum() == 36
    assert cube.tree.query([0.9, 0.9, 0.9])[1] == 7
    table = cube.edge_table
    assert (table.counts == 2).all() and len(table.single) == 0 and table.pairs[2].all()


def test_an_edge_of_three_faces_joins_nothing():
    assert BOOK.components.tolist() == [0] * 5 and BOOK.part_count == 1
    assert BOOK.face_pieces.tolist() == [0, 1, 2]
    assert (BOOK.edge_twins == -1).all() and (BOOK.face_adjacency == -1).all()
    assert BOOK.edge_table.counts.max() == 3 and len(BOOK.edge_table.pairs[0]) == 0
    assert BOOK.closed_components.tolist() == [False]
    assert len(BOOK.edges) == 7


def test_pieces_may_touch_where_components_do_not_part():
    """Two cubes with a vertex in common, one component of two closed pieces."""
    cube = forms.cube()
    other = np.where(np.arange(8) == 0, 7, np.arange(8) + 7)
    points = np.vstack([cube.points, cube.points[1:] + 2])
    both = Surface(points, np.vstack([cube.faces, other[cube.faces]]))
    assert both.face_pieces.tolist() == [0] * 12 + [1] * 12
    assert both.part_count == 1 and both.closed_components.tolist() == [True]


def test_degenerate_faces_have_no_area_and_no_direction():
    """A needle, a repeated corner and a single point."""
    surface = Surface([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2], [0, 0, 1], [2, 2, 2]])
    assert (surface.face_areas == 0).all() and (surface.face_normals == 0).all()
    assert surface.area == 0 and (surface.point_areas == 0).all()
    assert surface.edges.tolist() == [[0, 1], [0, 2], [1, 2]]
    assert (surface.edge_table.low == surface.edge_table.high).sum() == 2
    assert np.isfinite(surface.cotangent_weights.toarray()).all()
    twins = surface.edge_twins
    assert all(h // 3 != twin // 3 for h, twin in enumerate(twins) if twin >= 0)


def test_a_cloud_has_points_and_nothing_else():
    cloud = Surface([[0, 0, 0], [0, 0, 3], [0, 4, 0]])
    assert cloud.faces is None and cloud.face_count == 0 and cloud.area == 0
    for name in ("face_vectors", "face_areas", "face_normals", "edges", "edge_lengths"):
        assert len(getattr(cloud, name)) == 0
    assert len(cloud.edge_twins) == 0 and cloud.face_adjacency.shape == (0, 3)
    assert (cloud.point_areas == 1).all() and cloud.used_points.all()
    assert cloud.spacing == pytest.approx((3 + 3 + 4) / 3)
    assert cloud.diagonal == pytest.approx(5) and cloud.bounds[1].tolist() == [0, 4, 3]
    assert cloud.components.tolist() == [0, 0, 0] and cloud.part_count == 0
    assert cloud.closed_components.tolist() == [False] and len(cloud.face_pieces) == 0
    assert cloud.edge_matrix.nnz == 0 and cloud.cotangent_weights.nnz == 0
    assert Surface([[0, 0, 0]], np.empty((0, 3))).faces is None


@settings(max_examples=100, deadline=None, derandomize=True)
@given(faces=FACES)
def test_edges_of_any_faces(faces):
    """The table holds each half-edge once, on the edge of its two vertices."""
    surface, uses = any_surface(faces), edge_uses(faces)
    table = surface.edge_table
    pairs = list(zip(table.low.tolist(), table.high.tolist(), strict=True))
    assert pairs == sorted(uses) and table.counts.tolist() == [uses[pair] for pair in pairs]
    start, end = surface.faces.ravel(), np.roll(surface.faces, -1, axis=1).ravel()
    assert sorted(table.order.tolist()) == list(range(3 * len(faces)))
    assert (table.low[table.edge_of] == np.minimum(start, end)).all()
    assert (table.high[table.edge_of] == np.maximum(start, end)).all()
    assert (table.forward == (start < end)).all()
    assert surface.components.tolist() == component_labels(8, faces).tolist()
    leaving = [set(surface.fans[i].tolist()) for i in range(8)]
    assert leaving == [set(np.flatnonzero(start == i).tolist()) for i in range(8)]
    wide = EdgeTable.of(surface.faces, 2**31 - 1)  # key and half-edge do not fit one integer
    assert (wide.order == table.order).all() and (wide.first == table.first).all()
    assert (wide.low == table.low).all() and (wide.high == table.high).all()


@settings(max_examples=60, deadline=None, derandomize=True)
@given(faces=FACES, seed=st.integers(0, 999))
def test_the_order_of_points_and_faces_changes_names_only(faces, seed):
    rng, one = np.random.default_rng(seed), any_surface(faces)
    name, rows = rng.permutation(8), rng.permutation(len(faces))
    points = np.empty((8, 3))
    points[name] = one.points
    other = Surface(points, name[one.faces][rows])
    assert np.array_equal(other.face_areas, one.face_areas[rows])
    assert np.array_equal(other.face_normals, one.face_normals[rows])
    assert other.point_areas[name] == pytest.approx(one.point_areas, rel=1e-14)
    known = dict(zip(map(tuple, np.sort(name[one.edges], axis=1)), one.edge_lengths, strict=True))
    assert known == dict(zip(map(tuple, other.edges), other.edge_lengths, strict=True))
    assert (other.used_points[name] == one.used_points).all()
    assert (other.part_count, other.border_edges) == (one.part_count, one.border_edges)
    for ours, theirs in (
        (one.components, other.components[name]),
        (one.face_pieces[rows], other.face_pieces),
    ):
        assert ((ours[:, None] == ours) == (theirs[:, None] == theirs)).all()
    closed = other.closed_components[other.components[name]]
    assert (closed == one.closed_components[one.components]).all()


def test_rigid_motion_and_scale():
    one = medialis.organic_shape(56)
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    other = Surface(8 * one.points @ turn.T + [1, 2, 3], one.faces)
    # Rounding of coordinates up to 30, over edges of 0.05.
    assert other.face_areas == pytest.approx(64 * one.face_areas, rel=1e-9)
    assert other.face_normals == pytest.approx(one.face_normals @ turn.T, abs=1e-9)
    assert other.edge_lengths == pytest.approx(8 * one.edge_lengths, rel=1e-9)
    difference = abs(other.cotangent_weights - one.cotangent_weights)
    assert difference.max() < 1e-6
    assert (other.edge_twins == one.edge_twins).all()


def test_quantities_are_computed_once_and_cannot_be_written_to():
    surface = Surface(forms.cube().points.copy(), forms.cube().faces.copy())
    for name in QUANTITIES:
        first = getattr(surface, name)
        assert getattr(surface, name) is first and not first.flags.writeable
    with pytest.raises(ValueError, match="read-only"):
        surface.point_areas[0] = 1


def test_text():
    assert repr(Surface([[0, 0, 0], [3, 4, 0]])) == "Surface(2 points, a cloud, diagonal 5)"
    assert repr(forms.cube()) == "Shape(8 points, 12 faces, diagonal 3.4641)"


def test_graphs_by_their_links():
    assert piece_labels(4, np.empty((0, 2), int)).tolist() == [0, 1, 2, 3]
    assert piece_labels(5, np.array([[4, 2], [2, 4], [0, 1]])).tolist() == [0, 0, 1, 2, 1]
    matrix = link_matrix(3, np.array([[0, 2]]))
    assert matrix.toarray().tolist() == [[0, 0, 1], [0, 0, 0], [1, 0, 0]]


@pytest.mark.parametrize(
    ("points", "faces"),
    [
        ([[0, 0, math.inf]], None),
        ([[0, 0]], None),
        (np.zeros((0, 3)), None),
        (np.eye(3), [[0, 1, 3]]),
        (np.eye(3), [[0, 1]]),
    ],
)
def test_bad_arrays_are_refused(points, faces):
    with pytest.raises(InvalidShapeError):
        Surface(points, faces)


def test_nearest_distances_are_those_of_a_search_and_zero_where_points_coincide():
    rng = np.random.default_rng(3)
    points = rng.normal(size=(200, 3))
    apart = np.linalg.norm(points[:, None] - points, axis=2) + np.diag(np.full(200, np.inf))
    np.testing.assert_allclose(Surface(points).nearest_distances, apart.min(axis=1), rtol=1e-12)
    again = Surface(np.concatenate([points, points[:50]])).nearest_distances
    np.testing.assert_allclose(again[50:200], apart.min(axis=1)[50:], rtol=1e-12)
    assert not again[:50].any() and not again[200:].any()
    assert Surface(np.zeros((3, 3))).nearest_distances.tolist() == [0.0, 0.0, 0.0]


def test_many_coincident_points_take_no_longer():
    """100,000 times the same point in a cloud took a search of all of them for each."""
    points = np.concatenate([np.eye(3), np.ones((100_000, 3))])
    begin = time.process_time()
    assert Surface(points).spacing < 1e-3
    assert time.process_time() - begin < 5.0
