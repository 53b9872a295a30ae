"""Topology: labels against other libraries and slow definitions, and who shares it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

import medialis
from medialis.base.arrays import EdgeTable
from medialis.shape.surface import Surface, Topology, link_matrix, linked_rows, piece_labels


@pytest.mark.parametrize("links", [0, 1, 40, 90, 400])
def test_pieces_are_those_of_a_graph_library_numbered_by_their_lowest_node(links):
    random = np.random.default_rng(links)
    pairs = random.integers(0, 100, (links, 2))
    graph = coo_array((np.ones(links), (pairs[:, 0], pairs[:, 1])), shape=(100, 100))
    labels = piece_labels(100, pairs)
    assert np.array_equal(labels, connected_components(graph, directed=False)[1])
    _, first = np.unique(labels, return_index=True)
    assert (np.diff(first) > 0).all()


@pytest.mark.parametrize("links", [0, 1, 40, 400])
def test_links_are_those_of_a_sparse_matrix(links):
    pairs = np.random.default_rng(links).integers(0, 30, (links, 2))
    first, neighbours, times = linked_rows(31, pairs)
    matrix = link_matrix(31, pairs)
    assert np.array_equal(first, matrix.indptr) and np.array_equal(neighbours, matrix.indices)
    assert np.array_equal(times, matrix.data)


def _random_faces(count: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 25, (count, 3)).astype(np.int32)


@pytest.mark.parametrize("seed", range(5))
def test_fans_join_corners_of_one_vertex_across_edges_of_two_faces(seed):
    faces = _random_faces(40, seed)
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    at: dict[tuple[int, int], list[int]] = {}
    for face, corners in enumerate(faces.tolist()):
        for j in range(3):
            a, b = corners[j], corners[(j + 1) % 3]
            at.setdefault((min(a, b), max(a, b)), []).append(face)
    links = []
    for (a, b), around in at.items():
        if len(around) == 2:
            f, g = around
            for vertex in (a, b):
                corner = [3 * face + faces[face].tolist().index(vertex) for face in (f, g)]
                links.append(corner)
    expected = piece_labels(faces.size, np.array(links).reshape(-1, 2))
    assert np.array_equal(Topology(faces, 25).corner_fans(), expected)


def test_equal_faces_are_found_in_any_order_of_their_corners():
    faces = _random_faces(300, 1) % 7
    first = Topology(faces, 7).first_equal_face
    seen: dict[tuple[int, ...], int] = {}
    for face, corners in enumerate(np.sort(faces, axis=1).tolist()):
        assert first[face] == seen.setdefault(tuple(corners), face)


@pytest.mark.parametrize("count", [0, 1, 40, 400])
def test_sides_are_sorted_by_their_edge_as_numpy_does(count):
    faces = _random_faces(count, count)
    table = EdgeTable.of(faces, 25)
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1), axis=-1).reshape(-1, 2)
    edges, first = np.unique(ends[order := np.lexsort(ends.T[::-1])], axis=0, return_index=True)
    assert np.array_equal(table.order, order) and np.array_equal(table.ends, edges)
    assert np.array_equal(table.first, np.append(first, len(order)))
    assert np.array_equal(table.forward, (faces < np.roll(faces, -1, axis=1)).ravel())


def test_a_table_is_turned_with_its_faces():
    faces = medialis.organic_shape(56).faces
    turn = np.arange(len(faces)) % 3 == 0
    there = EdgeTable.of(np.where(turn[:, None], faces[:, [0, 2, 1]], faces), faces.max() + 1)
    table = EdgeTable.of(faces, faces.max() + 1).turned(turn)
    for name in ("order", "first", "ends", "forward"):
        assert np.array_equal(getattr(table, name), getattr(there, name)), name


def test_faces_and_edges_are_measured_as_numpy_does():
    random = np.random.default_rng(3)
    faces = _random_faces(60, 4)
    surface = Surface(random.normal(size=(25, 3)), faces)
    a, b, c = surface.points[faces.T]
    assert np.array_equal(surface.face_vectors, np.cross(b - a, c - a))
    ends = surface.points[surface.edges]
    assert np.allclose(surface.edge_lengths, np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1))
    repeated = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    assert repeated.any() and np.array_equal(surface.flat_faces, repeated)


def test_what_is_known_of_the_faces_is_found_once_for_examination_repair_and_shape():
    """Reading sorted all half-edges three times: the file's, the repaired mesh's, the shape's."""
    given = medialis.organic_shape(56)
    shape = medialis.make_shape(given.points, given.faces, repair=True)
    assert "edge_table" in vars(shape.topology)
    # Another order of the faces is another topology.
    other = Surface(given.points, given.faces[::-1]).adopt(shape.topology)
    assert other.topology is not shape.topology
    assert Surface(given.points * 2, given.faces).adopt(shape.topology).topology is shape.topology


def test_a_solid_has_two_agreeing_faces_at_each_edge_and_one_ring_round_each_vertex():
    faces = np.asarray(medialis.organic_shape(56).faces)
    n = int(faces.max()) + 1
    assert Topology(faces, n).is_solid and Topology(faces, n + 5).is_solid  # with unused points
    beside = np.concatenate([faces, faces + n])
    assert Topology(beside, 2 * n).is_solid and Topology(beside, 2 * n).part_count == 2
    for name, other in {
        "a border": faces[1:],
        "a face turned over": np.concatenate([faces[:1, [0, 2, 1]], faces[1:]]),
        "a shared vertex": np.where(beside == n, 0, beside),
        "an edge of four faces": np.concatenate([faces, [faces[0], faces[0, [0, 2, 1]]]]),
        "a vertex named twice": np.concatenate([faces, [[0, 0, 0]]]),
    }.items():
        assert not Topology(other.astype(np.int32), 2 * n).is_solid, name


@pytest.mark.parametrize("share", [1, 2])
def test_what_is_kept_of_a_turned_surface_is_what_it_would_be_found_to_be(share):
    shape = medialis.organic_shape(56)
    faces = np.concatenate([shape.faces, shape.faces + shape.point_count])
    points = np.concatenate([shape.points, shape.points + 9.0])
    turned = np.arange(len(faces)) < len(faces) / share
    known = Surface(points, faces)
    assert known.face_areas.all() and len(known.face_vectors)
    assert known.topology.is_solid and len(known.topology.face_pieces)
    fresh = Surface(points, np.where(turned[:, None], faces[:, [0, 2, 1]], faces))
    kept = Surface(points, fresh.faces)
    kept.adopt_turned(known, turned)
    for name in ("face_vectors", "face_areas", "face_normals", "flat_faces"):
        assert getattr(kept, name).tobytes() == getattr(fresh, name).tobytes(), name
    for name in ("edges", "edge_twins", "used_points", "components", "face_pieces", "is_solid"):
        assert np.array_equal(getattr(kept.topology, name), getattr(fresh.topology, name)), name


def test_many_and_few_points_at_one_place_have_the_first_of_them():
    random = np.random.default_rng(0)
    places = random.normal(size=(500, 3))
    rows = random.integers(0, 500, 5000) * (random.random(5000) < 0.7)
    first = Surface(places[rows]).first_equal_point
    seen: dict[int, int] = {}
    assert first.tolist() == [seen.setdefault(row, i) for i, row in enumerate(rows.tolist())]
