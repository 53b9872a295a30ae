"""Envelopes: distances against brute force, surfaces against bodies of known volume."""

import math

import numpy as np
import pytest

import medialis
import medialis.medial_meshes.envelope as envelope_surfaces
from closed_forms import icosphere, random_directions
from medialis.base.errors import InvalidShapeError
from medialis.medial_meshes.distances import boundary_points
from medialis.medial_meshes.envelope import Envelope, primitives_of
from medialis.medial_meshes.mesh import Complex


def random_complex(rng, count=9):
    """Balls with a triangle, an edge and a lone ball for each three of them."""
    balls = np.column_stack([rng.random((count, 3)), 0.02 + 0.3 * rng.random(count)])
    edges, faces = [(0, 1), (0, 2), (1, 2), (3, 4), (4, 5)], [(0, 1, 2)]
    return Complex(balls, np.array(edges), np.array(faces))


def brute(places, given, steps=400):
    """Smallest |p - c| - r over a dense lattice of all primitives."""
    rows = primitives_of(given)
    best = np.full(len(places), np.inf)
    for row in rows:
        corners = given.balls[row[row >= 0]]
        if len(corners) == 1:
            shares = np.ones((1, 1))
        elif len(corners) == 2:
            t = np.linspace(0, 1, steps**2 // 2)
            shares = np.stack([1 - t, t], axis=1)
        else:
            i, j = np.meshgrid(np.arange(steps + 1), np.arange(steps + 1))
            i, j = i[i + j <= steps] / steps, j[i + j <= steps] / steps
            shares = np.stack([1 - i - j, i, j], axis=1)
        balls = shares @ corners
        for k, place in enumerate(places):
            found = (np.linalg.norm(balls[:, :3] - place, axis=1) - balls[:, 3]).min()
            best[k] = min(best[k], found)
    return best


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_distances_are_those_of_brute_force(seed):
    """The lattice is never nearer, and off the foot by at most h: |p - c| - r changes by <= 2 h.

    Between lattice places 1/400 of sides below sqrt(3) (+ 0.3 in radius) apart it is convex, so the
    smallest of the lattice is at most (2 / 400)^2 / distance-like terms above: 1e-3 is ample.
    """
    rng = np.random.default_rng(seed)
    given = random_complex(rng)
    places = 3 * rng.random((30, 3)) - 1
    exact, row, shares = Envelope.of(given).distances(places)
    slow = brute(places, given)
    assert (slow >= exact - 1e-12).all()
    assert np.allclose(exact, slow, atol=1e-3)
    rows = primitives_of(given)[row]
    balls = np.einsum(
        "qk,qkd->qd", shares, given.balls[np.maximum(rows, 0)] * (rows >= 0)[..., None]
    )
    assert np.allclose(np.linalg.norm(places - balls[:, :3], axis=1) - balls[:, 3], exact)


def test_a_ball_within_another_adds_nothing():
    given = Complex(
        np.array([[0.0, 0, 0, 1], [0.1, 0, 0, 0.2]]), np.array([[0, 1]]), np.empty((0, 3), np.int64)
    )
    places = 3 * random_directions(50)
    assert np.allclose(Envelope.of(given).distances(places)[0], 2.0)


def test_boundary_points_lie_on_the_boundary():
    given = random_complex(np.random.default_rng(5))
    envelope = Envelope.of(given)
    points, spacing = boundary_points(envelope)
    assert 0 < spacing < 0.05
    assert np.abs(envelope.distances(points)[0]).max() < 1e-7


@pytest.mark.slow
def test_the_distance_of_a_ball_to_its_sphere():
    """A ball of radius 1.1 round a sphere of radius 1: 0.1 both ways, up to the facets.

    The middle of a facet with edges e lies 1 - sqrt(1 - e^2/3) or less beneath the sphere.
    """
    shape = icosphere(4)
    mesh = medialis.MedialMesh([[0, 0, 0]], [1.1], [], [])
    found = medialis.envelope_distance(mesh, shape)
    sag = 1 - math.sqrt(1 - shape.edge_lengths.max() ** 2 / 3)
    assert 0.1 - 1e-9 <= found.largest <= 0.1 + sag
    assert 0.1 - 1e-9 <= found.surface_to_envelope <= 0.1 + sag
    assert abs(np.linalg.norm(found.place) - 1.05) < 0.06


@pytest.mark.slow
def test_the_distance_finds_a_part_that_is_missing():
    """A sphere with only a small ball in its middle: 0.7 off from the surface, both ways."""
    shape = icosphere(3)
    mesh = medialis.MedialMesh([[0, 0, 0]], [0.3], [], [])
    found = medialis.envelope_distance(mesh, shape)
    assert np.isclose(found.surface_to_envelope, 0.7, atol=1e-9)
    assert np.isclose(found.envelope_to_surface, 0.7, atol=shape.edge_lengths.max() ** 2)


@pytest.mark.slow
def test_distances_scale_and_move_with_the_shape():
    shape = medialis.organic_shape(56)
    mesh = medialis.medial_mesh(shape, balls=10)
    first = medialis.envelope_distance(mesh, shape)
    moved = medialis.make_shape(4 * shape.points + 8, shape.faces)
    other = medialis.MedialMesh(4 * mesh.centers + 8, 4 * mesh.radii, mesh.edges, mesh.faces)
    second = medialis.envelope_distance(other, moved)
    assert np.isclose(second.largest, 4 * first.largest, rtol=1e-4)


def test_a_distance_needs_faces():
    mesh = medialis.MedialMesh([[0, 0, 0]], [1.0], [], [])
    with pytest.raises(InvalidShapeError, match="point cloud"):
        medialis.envelope_distance(mesh, medialis.Shape(random_directions(9), random_directions(9)))


@pytest.mark.parametrize(
    ("balls", "edges", "faces", "volume"),
    [
        ([[0, 0, 0, 1]], [], [], 4 / 3 * math.pi),
        ([[0, 0, 0, 1], [3, 0, 0, 1]], [[0, 1]], [], 4 / 3 * math.pi + 3 * math.pi),
        (  # a slab: prism, half cylinders along its sides, and a ball at its corners together
            [[0, 0, 0, 0.5], [4, 0, 0, 0.5], [0, 3, 0, 0.5]],
            [[0, 1], [0, 2], [1, 2]],
            [[0, 1, 2]],
            6 * 1.0 + 0.5 * math.pi * 0.25 * 12 + math.pi / 6,
        ),
    ],
)
def test_surfaces_of_envelopes_are_closed_and_of_the_right_volume(balls, edges, faces, volume):
    """Cells of 1 % of the diagonal cut off at most their square over the radius: 1 % of volume."""
    balls = np.array(balls, float)
    mesh = medialis.MedialMesh(balls[:, :3], balls[:, 3], edges, faces)
    surface = medialis.envelope_surface(mesh)
    found = medialis.diagnose(surface.points, surface.faces)
    assert found.closed and found.genus == 0 and found.components == 1
    assert found.nonmanifold_edges == 0 and found.nonmanifold_vertices == 0
    assert found.orientation == "out"
    assert found.volume == pytest.approx(volume, rel=0.01)


def test_the_surface_of_a_ring_has_a_handle():
    turn = np.linspace(0, 2 * np.pi, 13)[:-1]
    centers = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    ring = np.stack([np.arange(12), (np.arange(12) + 1) % 12], axis=1)
    mesh = medialis.MedialMesh(centers, np.full(12, 0.2), ring, [])
    assert mesh.betti == (1, 1, 0)
    surface = medialis.envelope_surface(mesh, cell=0.05)
    found = medialis.diagnose(surface.points, surface.faces)
    assert found.closed and found.genus == 1


def test_threads_thinner_than_cells_stay_whole():
    """A thread of a hundredth of a cell between two balls: one piece, and near enough."""
    mesh = medialis.MedialMesh(
        [[0, 0, 0], [0.4, 0.3, 2.0], [1, 1, 3]], [0.3, 0.0004, 0.3], [[0, 1], [1, 2]], []
    )
    progress, cell = medialis.Progress(), 0.01
    surface = medialis.envelope_surface(mesh, cell=cell, progress=progress)
    assert not progress.messages
    found = medialis.diagnose(surface.points, surface.faces)
    assert found.closed and found.components == 1 and found.genus == 0
    width = cell * np.linalg.norm(np.array([1.6, 1.6, 3.6]))
    assert np.abs(Envelope.of(mesh.complex).distances(surface.points)[0]).max() < width


@pytest.mark.parametrize("radius", [0.27, 0.87])
def test_a_surface_moves_by_less_than_a_cell_for_the_topology_of_the_mesh(radius):
    """An open string of balls in a circle: its ends just touch, or a pinhole is left within it."""
    turn = np.radians(30 * np.arange(12))
    centers = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    string = np.stack([np.arange(11), np.arange(1, 12)], axis=1)
    mesh = medialis.MedialMesh(centers, np.full(12, radius), string, [])
    assert mesh.betti == (1, 0, 0)
    cell, extent = 0.03, 2 + 2 * radius
    width = cell * math.sqrt(2 * extent**2 + (2 * radius) ** 2)
    progress = medialis.Progress()
    surface = medialis.envelope_surface(mesh, cell=cell, progress=progress)
    found = medialis.diagnose(surface.points, surface.faces)
    assert not progress.messages
    assert found.closed and found.components == 1 and found.genus == 0
    off = np.abs(Envelope.of(mesh.complex).distances(surface.points)[0])
    assert off.max() < width


def test_a_surface_that_closes_a_loop_says_so():
    """Four balls in a ring that overlap in the middle: the loop is there, the hole is not."""
    centers = [[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]]
    mesh = medialis.MedialMesh(centers, [1.2] * 4, [[0, 1], [1, 2], [2, 3], [3, 0]], [])
    progress = medialis.Progress()
    medialis.envelope_surface(mesh, cell=0.05, progress=progress)
    assert [message.code for message in progress.messages] == ["envelope_topology"]
    with pytest.raises(InvalidShapeError, match="radius 0"):
        medialis.envelope_surface(medialis.MedialMesh([[0, 0, 0]], [0.0], [], []))


def test_too_many_cells_are_made_wider_with_a_message(monkeypatch):
    """A ball of diameter 2 r has 12 r^2 / cell^2 faces of cells; the diagonal is 12^0.5 r."""
    monkeypatch.setattr(envelope_surfaces, "MOST_CELLS", 20_000)
    ball = medialis.MedialMesh([[0, 0, 0]], [1.0], [], [])
    progress = medialis.Progress()
    surface = medialis.envelope_surface(ball, cell=0.0005, progress=progress)
    (message,) = progress.messages
    assert message.code == "cell_enlarged"
    assert surface.face_count < 8 * 20_000  # a cell that is crossed has some four triangles
    found = medialis.diagnose(surface.points, surface.faces)
    assert found.closed and found.volume == pytest.approx(4 / 3 * math.pi, rel=0.01)
