"""Medial meshes of convex polyhedra have the sheets, seams and junctions of the medial axis.

The oracle knows nothing of polytopes in four dimensions: it cuts the bisector of each two planes by
all others, the line of each three, and tries the point of each four.
"""

from itertools import combinations, pairwise

import numpy as np
import pytest
from scipy.spatial import HalfspaceIntersection

import medialis
from closed_forms import icosphere
from medialis.base.arrays import polylines
from medialis.medial_meshes.roofs import planes_of, roof_of
from medialis.medial_meshes.sampling import Solid

DEPTH = 1e-7


def box(*size):
    return np.vstack([np.eye(3), -np.eye(3)]), np.concatenate([np.zeros(3), size])


def prism(sides, height=1.0, turn=0.3):
    """A regular one: all its walls are equally near at the axis."""
    angle = turn + 2 * np.pi * np.arange(sides) / sides
    walls = np.stack([-np.cos(angle), -np.sin(angle), 0 * angle], axis=1)
    caps = [[0, 0, 1], [0, 0, -1]]
    return np.vstack([walls, caps]), np.concatenate([np.ones(sides), [0.0, height]])


def random_planes(seed):
    """As many as 6 to 14 faces that touch a ball nearly, none far out."""
    rng = np.random.default_rng(seed)
    count = rng.integers(1, 9)
    way = rng.normal(size=(count, 3))
    way /= np.linalg.norm(way, axis=1)[:, None]
    frame = np.vstack([np.eye(3), -np.eye(3)])
    return np.vstack([-way, frame]), np.append(rng.uniform(0.7, 1, count), np.full(6, 1.1))


def inside_of(normals, offsets):
    """A place inside, by steps away from the nearest plane."""
    place = np.zeros(3)
    for step in range(1, 2000):
        heights = normals @ place + offsets
        place = place + normals[heights.argmin()] * 0.5 / step
    return place


def mesh_of(normals, offsets, edge, turn=None, scale=1.0):
    """The polyhedron as triangles with no side longer than `edge`, turned and scaled."""
    corners = HalfspaceIntersection(
        np.column_stack([-normals, -offsets]), inside_of(normals, offsets)
    ).intersections
    corners = np.unique(np.round(corners, 9), axis=0)
    faces = []
    for normal, offset in zip(normals, offsets, strict=True):
        rows = np.flatnonzero(np.abs(corners @ normal + offset) < 1e-6)
        if len(rows) < 3:
            continue
        away = corners[rows] - corners[rows].mean(axis=0)
        along = away[0] / np.linalg.norm(away[0])
        turned = np.arctan2(away @ np.cross(normal, along), away @ along)
        rows = rows[np.argsort(turned)]
        faces += [[rows[0], b, a] for a, b in pairwise(rows[1:])]
    points, faces = corners, np.array(faces)
    while np.linalg.norm(points[faces] - points[np.roll(faces, -1, 1)], axis=2).max() > edge:
        ends = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        rows, which = np.unique(ends, axis=0, return_inverse=True)
        x, y, z = (len(points) + which.reshape(-1, 3)).T
        points = np.vstack([points, points[rows].mean(axis=1)])
        a, b, c = faces.T
        faces = np.vstack([np.c_[a, x, z], np.c_[x, b, y], np.c_[z, y, c], np.c_[x, y, z]])
    turn = np.eye(3) if turn is None else turn
    return medialis.make_shape(scale * points @ turn.T, faces)


def truth_of(normals, offsets):
    """Sheets, seams and junctions of the medial axis, by planes two, three and four at a time."""

    def lower(places, own):
        """How much farther the other planes are than those given."""
        heights = places @ normals.T + offsets
        r = heights[..., own[0]]
        return np.delete(heights, own, axis=-1) - r[..., None], r

    def unique(points):
        return len(np.unique(np.round(np.reshape(points, (len(points), -1)), 5), axis=0))

    junctions, seams, sheets = [], [], 0
    rows = np.column_stack([normals, -np.ones(len(normals))])
    for own in combinations(range(len(normals)), 4):
        if abs(np.linalg.det(rows[list(own)])) > 1e-9:
            place = np.linalg.solve(rows[list(own)], -offsets[list(own)])[:3]
            others, r = lower(place, own)
            if r > 1e-6 and others.min(initial=1) > -DEPTH:
                junctions.append(place)
    for own in combinations(range(len(normals)), 3):
        i, j, k = own
        across = np.stack([normals[i] - normals[j], normals[i] - normals[k]])
        way = np.cross(*across)
        if np.linalg.norm(way) < 1e-9:
            continue
        way /= np.linalg.norm(way)
        wanted = [offsets[j] - offsets[i], offsets[k] - offsets[i], 0.0]
        start = np.linalg.solve(np.vstack([across, way]), wanted)
        at, end = lower(np.stack([start, start + way]), own)
        here, slope = np.append(at[0], end[0]), np.append(at[1] - at[0], end[1] - end[0])
        if (here[np.abs(slope) < 1e-9] < -DEPTH).any():
            continue
        up, down = slope > 1e-9, slope < -1e-9
        low, high = (-here[up] / slope[up]).max(), (-here[down] / slope[down]).min()
        if high - low > 1e-6:
            seams.append(np.sort([start + low * way, start + high * way], axis=0))
    for i, j in combinations(range(len(normals)), 2):
        normal = normals[i] - normals[j]
        point = normal * (offsets[j] - offsets[i]) / (normal @ normal)
        _, _, axes = np.linalg.svd(normal[None])
        polygon = point + 100 * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) @ axes[1:]
        for limit in range(len(normals) + 1):
            if limit in (i, j) or len(polygon) == 0:
                continue
            heights = polygon @ normals.T + offsets
            h = heights[:, i] if limit == len(normals) else heights[:, limit] - heights[:, i]
            cut = []
            for a in range(len(polygon)):
                b = (a + 1) % len(polygon)
                if h[a] >= 0:
                    cut.append(polygon[a])
                if h[a] * h[b] < 0:
                    cut.append(polygon[a] + h[a] / (h[a] - h[b]) * (polygon[b] - polygon[a]))
            polygon = np.array(cut).reshape(-1, 3)
        if len(polygon) > 2:
            area = np.cross(polygon[1:-1] - polygon[0], polygon[2:] - polygon[0]).sum(axis=0)
            sheets += np.linalg.norm(area) > 1e-9
    return sheets, unique(seams), np.array(junctions)


def structure_of(mesh):
    return int(mesh.sheets.of_faces.max()) + 1, len(polylines(mesh.sheets.seams, len(mesh)))


def quality(mesh):
    """Area over that of an equal triangle with as long a side and half as long a rim, about."""
    p = mesh.centers[mesh.faces]
    sides = np.linalg.norm(p - np.roll(p, 1, axis=1), axis=2)
    area = 0.5 * np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1)
    return 6 / np.sqrt(3) * area / (sides.max(axis=1) * 0.5 * sides.sum(axis=1))


def test_a_box_is_twelve_balls():
    """Its eight corners, and the ends of the rectangle in the middle."""
    shape = mesh_of(*box(1, 0.8, 0.6), edge=np.inf)
    mesh = medialis.MedialMesh.of(roof_of(Solid(shape.points, shape.faces)).mesh(12))
    assert (structure_of(mesh), mesh.betti) == ((13, 12), (1, 0, 0))
    corner = mesh.radii == 0
    assert {tuple(row) for row in np.round(mesh.centers[corner], 6).tolist()} == {
        (x, y, z) for x in (0, 1) for y in (0, 0.8) for z in (0, 0.6)
    }
    assert np.allclose(mesh.radii[~corner], 0.3)


def test_the_oracle_knows_boxes():
    sheets, seams, junctions = truth_of(*box(1, 0.8, 0.6))
    assert (sheets, seams, len(junctions)) == (13, 12, 4)
    inner = [[x, y, 0.3] for x in (0.3, 0.7) for y in (0.3, 0.5)]
    assert np.allclose(junctions[np.lexsort(junctions.T[::-1])], inner)


CASES = [
    pytest.param(planes, id=name)
    for name, planes in (
        ("box", box(1, 0.8, 0.6)),
        ("square bar", box(2, 0.7, 0.7)),
        ("cube", box(1, 1, 1)),
        ("triangular prism", prism(3)),
        ("regular hexagonal prism", prism(6, 3.0)),
        ("flat regular octagonal prism", prism(8, 0.5)),
    )
]


@pytest.mark.slow
@pytest.mark.parametrize("planes", [*CASES, *map(random_planes, range(4))])
def test_the_roof_has_all_sheets_seams_and_junctions(planes):
    """Also where more planes meet than must: the axis of a prism, the center of a cube."""
    shape = mesh_of(*planes, edge=np.inf)
    low, high = shape.bounds
    middle, scale = 0.5 * (low + high), shape.diagonal
    roof = roof_of(Solid((shape.points - middle) / scale, shape.faces))
    sheets, seams, junctions = truth_of(*planes)
    inner = roof.balls[roof.balls[:, 3] > 0, :3] * scale + middle
    apart = np.linalg.norm(inner[:, None] - junctions[None], axis=2)
    assert max(apart.min(axis=0).max(), apart.min(axis=1).max()) < 1e-6 * scale
    mesh = medialis.MedialMesh.of(roof.mesh(len(roof)))
    assert (len(roof.sheets), structure_of(mesh)) == (sheets, (sheets, seams))
    assert mesh.betti == (1, 0, 0) and len(mesh) == len(roof)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_any_number_of_balls_keeps_the_structure_and_is_spread_evenly(seed):
    """Turned, scaled, cut into small triangles, and with the digits of 32-bit numbers."""
    planes, rng = random_planes(seed), np.random.default_rng(seed)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    shape = mesh_of(*planes, edge=0.3, turn=turn * np.linalg.det(turn), scale=10.0 ** (2 * seed))
    shape = medialis.make_shape(shape.points.astype(np.float32), shape.faces)
    low, high = shape.bounds
    solid = Solid((shape.points - 0.5 * (low + high)) / shape.diagonal, shape.faces)
    roof, (sheets, seams, _) = roof_of(solid), truth_of(*planes)
    for count in (len(roof), len(roof) + 1, 150, 400):
        mesh = medialis.MedialMesh.of(roof.mesh(count))
        assert (len(mesh), structure_of(mesh), mesh.betti) == (count, (sheets, seams), (1, 0, 0))
        heights = mesh.centers @ roof.planes[:, :3].T + roof.planes[:, 3]
        nearest = np.sort(heights, axis=1)
        assert np.abs(nearest[:, :2] - mesh.radii[:, None]).max() < 1e-5  # rounding of the input
    assert quality(mesh).mean() > 0.75 and np.percentile(quality(mesh), 5) > 0.4


def test_other_shapes_have_no_roof():
    """A bump on a face (its foot is a valley), a dent, and a ball of many faces."""
    shape = mesh_of(*box(1, 1, 1), edge=0.3)
    assert roof_of(Solid(shape.points / shape.diagonal, shape.faces)) is not None
    for height in (0.02, -0.02):
        points = np.array(shape.points)
        top = np.flatnonzero(points[:, 2] == 1)
        middle = top[np.linalg.norm(points[top, :2] - 0.5, axis=1).argmin()]
        points[middle, 2] += height
        assert roof_of(Solid(points / shape.diagonal, shape.faces)) is None
    ball = icosphere(3)
    assert planes_of(Solid(ball.points / ball.diagonal, ball.faces)) is None


@pytest.mark.slow
@pytest.mark.parametrize("planes", [*CASES[:2], random_planes(6)])
def test_as_many_balls_as_the_structure_has_vertices_are_the_polyhedron(planes):
    """Radii and centers are linear on sheets, so the envelope is the solid."""
    shape, (sheets, seams, junctions) = mesh_of(*planes, edge=0.2), truth_of(*planes)
    corners = len(mesh_of(*planes, edge=np.inf).points)
    count = corners + len(np.unique(np.round(junctions, 5), axis=0))
    mesh = medialis.medial_mesh(shape, balls=count)
    assert (len(mesh), structure_of(mesh)) == (count, (sheets, seams))
    assert medialis.envelope_distance(mesh, shape).largest < 1e-5 * shape.diagonal
    if sheets == 13:  # of many faces, seams of levels may be off where sheets are tiny
        for level in (2 * count, 10 * count):
            assert structure_of(mesh.level(level)) == (sheets, seams)
    found = medialis.medial_mesh(shape, error=1e-4)
    assert len(found) <= count


@pytest.mark.slow
def test_fewer_balls_than_vertices_are_still_near():
    """Ten balls of a box: its structure has twelve."""
    shape = mesh_of(*box(1, 0.8, 0.6), edge=0.1)
    mesh = medialis.medial_mesh(shape, balls=10)
    assert len(mesh) == 10 and mesh.betti == (1, 0, 0)
    assert medialis.envelope_distance(mesh, shape).largest < 0.1 * shape.diagonal
