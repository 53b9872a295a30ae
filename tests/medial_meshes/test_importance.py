"""Sheets of medial meshes, values on their balls, and meshes simplified by importance."""

import numpy as np
import pytest

import medialis
from closed_forms import torus_mesh
from medialis.base.errors import InvalidShapeError


def book(pages=3, length=4):
    """Sheets that share one line: pages of squares, each cut into two triangles."""
    points = [(0.0, 0.0, float(z)) for z in range(length + 1)]
    edges, faces = [(z, z + 1) for z in range(length)], []
    for page in range(pages):
        turn = 2 * np.pi * page / pages
        first = len(points)
        width = 1.0 + page  # areas differ: the widest is sheet 0
        points += [(width * np.cos(turn), width * np.sin(turn), z) for z in range(length + 1)]
        for z in range(length):
            faces += [(z, z + 1, first + z), (z + 1, first + z, first + z + 1)]
    balls = np.column_stack([points, np.full(len(points), 0.1)])
    return medialis.MedialMesh.of_rows(balls, np.array(edges), np.array(faces))


def test_sheets_meet_in_seams():
    mesh = book()
    sheets = mesh.sheets
    assert sorted(map(tuple, sheets.seams.tolist())) == [(0, 1), (1, 2), (2, 3), (3, 4)]
    # The third page is the widest: its eight triangles are sheet 0.
    assert np.bincount(sheets.of_faces).tolist() == [8, 8, 8]
    widest = mesh.centers[mesh.faces][:, :, :2]
    area = np.linalg.norm(widest, axis=2).max(axis=1)
    assert (np.diff([area[sheets.of_faces == k].max() for k in range(3)]) < 0).all()
    assert (sheets.of_points[:5] == -1).all() and (sheets.of_points[5:] >= 0).all()


@pytest.mark.slow
def test_each_sheet_is_a_surface_with_borders():
    """No edge off the seams has more than two triangles, and those are of one sheet."""
    mesh = medialis.medial_mesh(medialis.organic_shape(56), balls=60, quality="fast")
    labels, seams = mesh.sheets.of_faces, {tuple(row) for row in mesh.sheets.seams.tolist()}
    around = {}
    for face, label in zip(mesh.faces.tolist(), labels.tolist(), strict=True):
        for a, b in ((0, 1), (0, 2), (1, 2)):
            around.setdefault((face[a], face[b]), []).append(label)
    for edge, found in around.items():
        assert (len(found) > 2) == (edge in seams)
        assert len(found) != 2 or found[0] == found[1]


def test_a_mesh_without_triangles_has_no_sheets():
    mesh = medialis.MedialMesh([[0, 0, 0], [1, 0, 0]], [1, 1], [[0, 1]], [])
    assert len(mesh.sheets.of_faces) == len(mesh.sheets.seams) == 0
    assert mesh.sheets.of_points.tolist() == [-1, -1]


def test_less_important_rims_go():
    """Of one page only the line at the back is left; the others stay whole."""
    mesh = book()
    importance = np.where(np.arange(len(mesh)) // 5 == 1, 0.5, 2.0)
    found = medialis.important_mesh(mesh, importance, 1.0)
    assert len(found) == len(mesh) - 5 and len(found.faces) == 16
    assert found.sheets.of_faces.max() == 0  # the two pages that are left are one sheet
    assert found.betti == mesh.betti == (1, 0, 0)


@pytest.mark.slow
def test_the_topology_stays():
    """The loop of a torus has the same importance all round and stays at any threshold."""
    mesh = medialis.medial_mesh(torus_mesh(), balls=24, quality="fast")
    assert mesh.betti == (1, 1, 0)
    for threshold in (0.5, 2.0):
        found = medialis.important_mesh(mesh, np.ones(len(mesh)), threshold)
        assert found.betti == (1, 1, 0)
    assert len(medialis.important_mesh(mesh, np.ones(len(mesh)), 0.5)) == len(mesh)


@pytest.mark.slow
def test_important_balls_stay_with_all_between_them():
    rng = np.random.default_rng(3)
    mesh = medialis.medial_mesh(medialis.organic_shape(56), balls=60, quality="fast")
    importance = rng.random(len(mesh))
    importance[::7] = np.nan  # not known: kept
    found = medialis.important_mesh(mesh, importance, 0.5)
    kept = {tuple(row) for row in found.centers.tolist()}
    high = mesh.centers[~(importance < 0.5)]
    assert {tuple(row) for row in high.tolist()} <= kept
    place = {tuple(row): i for i, row in enumerate(found.centers.tolist())}
    rows = [[place.get(tuple(p)) for p in mesh.centers[face].tolist()] for face in mesh.faces]
    inner = (~(importance < 0.5))[mesh.faces].all(axis=1)
    given = {tuple(row) for row in found.faces.tolist()}
    assert {tuple(rows[i]) for i in np.flatnonzero(inner)} <= given
    assert found.betti == mesh.betti and len(found) < len(mesh)


@pytest.mark.slow
def test_values_come_from_the_nearest_ball():
    shape = medialis.organic_shape(56)
    mesh, cloud = medialis.medial_mesh(shape, balls=20), medialis.surface_skeleton(shape)
    found = medialis.values_on_balls(mesh, cloud, cloud.radii)
    apart = np.linalg.norm(cloud.centers[None] - mesh.centers[:, None], axis=2)
    apart[:, ~cloud.valid] = np.inf
    assert np.array_equal(found, cloud.radii[apart.argmin(axis=1)])
    assert np.isnan(medialis.values_on_balls(mesh, cloud, np.full(len(cloud), np.nan))).all()


def test_values_of_another_length_are_refused():
    mesh = book()
    cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    with pytest.raises(InvalidShapeError, match="values of shape"):
        medialis.important_mesh(mesh, [1.0], 1.0)
    with pytest.raises(InvalidShapeError, match="values of shape"):
        medialis.values_on_balls(mesh, cloud, [1.0])
