"""Medial meshes of shapes whose topology and medial axis are known."""

import numpy as np
import pytest

import medialis
from closed_forms import box_mesh, icosphere, torus_mesh
from medialis.base.errors import InvalidOptionError, InvalidShapeError
from medialis.base.kept import memory_limit
from medialis.base.progress import Progress
from medialis.base.threads import thread_limit
from medialis.medial_meshes.mesh import betti_numbers
from medialis.medial_meshes.sampling import Solid
from tubes import arc, capsules, circle, distance_to, segment, tube


def joined(*shapes):
    """One mesh of several."""
    counts = np.cumsum([0] + [shape.point_count for shape in shapes])
    faces = [shape.faces + n for shape, n in zip(shapes, counts, strict=False)]
    return medialis.make_shape(
        np.concatenate([shape.points for shape in shapes]), np.concatenate(faces)
    )


def scaled(shape, factor, offset=(0, 0, 0), turned=False):
    faces = shape.faces[:, ::-1] if turned else shape.faces
    return medialis.make_shape(factor * shape.points + offset, faces)


def error(mesh, shape):
    return medialis.envelope_distance(mesh, shape).largest / shape.diagonal


@pytest.mark.slow
def test_a_ball_is_one_ball():
    """The vertices of an icosphere lie on the sphere; its faces e^2/6 or less beneath it."""
    shape = icosphere(3)
    mesh = medialis.medial_mesh(shape, balls=1)
    assert len(mesh) == 1 and mesh.betti == (1, 0, 0)
    sag = shape.edge_lengths.max() ** 2 / 6
    assert np.abs(mesh.centers).max() < sag
    assert abs(mesh.radii[0] - 1) < sag


@pytest.mark.slow
def test_a_capsule_is_two_balls_and_an_edge():
    """From a grid of cells of 0.05: flat facets lie 0.05^2 / 2 / 0.4 = 0.003 beneath it."""
    shape = capsules([np.array([[-1.0, 0, 0], [1.0, 0, 0]])], [0.4], 0.05)
    mesh = medialis.medial_mesh(shape, balls=2)
    assert (len(mesh), len(mesh.edges), len(mesh.faces)) == (2, 1, 0)
    ends = mesh.centers[np.argsort(mesh.centers[:, 0])]
    assert np.allclose(ends, [[-1, 0, 0], [1, 0, 0]], atol=0.02)
    assert np.allclose(mesh.radii, 0.4, atol=0.02)


@pytest.mark.slow
def test_a_torus_is_a_loop():
    shape = torus_mesh()
    mesh = medialis.medial_mesh(shape, balls=16)
    assert mesh.betti == (1, 1, 0)
    assert error(mesh, shape) < 0.01  # a ring of 16 chords is off by 1 - cos(pi / 16) = 0.02 of 2.9
    around = np.linalg.norm(mesh.centers[:, :2], axis=1)
    assert np.abs(around - 1).max() < 0.05 and np.abs(mesh.centers[:, 2]).max() < 0.05


def torus_knot(p, q, major=2.0, minor=0.9):
    """A curve p times round the axis and q times through the hole."""
    turn = np.linspace(0, 2 * np.pi, 900)
    out = major + minor * np.cos(q * turn)
    return np.stack([out * np.cos(p * turn), out * np.sin(p * turn), minor * np.sin(q * turn)], 1)


@pytest.mark.slow
@pytest.mark.parametrize(("p", "q"), [(2, 3), (2, 5), (3, 4)])
def test_a_knot_is_one_loop_along_its_curve(p, q):
    """A tube round a torus knot: a ring of balls, however it is knotted.

    Chords between `n` balls of a curve of length L that bends with radius R or more are off by
    (L / n)^2 / 8 R; balls need not lie evenly, so four times that is allowed.
    """
    radius, curve = 0.25, torus_knot(p, q)
    shape = tube([curve], radius, 0.09)
    assert Solid(shape.points / shape.diagonal, shape.faces).betti == (1, 1, 0)
    mesh = medialis.medial_mesh(shape, balls=80)
    assert mesh.betti == (1, 1, 0)
    steps = np.diff(curve, axis=0)
    length = np.linalg.norm(steps, axis=1).sum()
    bend = np.linalg.norm(np.diff(steps, axis=0), axis=1) / np.linalg.norm(steps[1:], axis=1) ** 2
    allowed = 4 * (length / 80) ** 2 * bend.max() / 8
    assert allowed < 0.5 * radius
    assert distance_to(mesh.centers, [curve], 1e-2).max() < allowed
    assert error(mesh, shape) * shape.diagonal < allowed
    for count in (200, 40, 10, 3):
        assert mesh.level(count).betti == (1, 1, 0)
    assert mesh.fewest == 3  # fewer have no loop


@pytest.mark.slow
@pytest.mark.parametrize("holes", [2, 5])
def test_as_many_loops_as_rings_in_a_row(holes):
    """Rings of tube that share a side each: genus `holes`; two linked rings are two parts."""
    rings = [circle((1.6 * k, 0, 0), 1.0) for k in range(holes)]
    spokes = [segment((1.6 * k - 0.6, 0, 0), (1.6 * k - 1.0, 0, 0)) for k in range(1, holes)]
    shape = tube(rings + spokes, 0.12, 0.05)
    wanted = Solid(shape.points / shape.diagonal, shape.faces).betti
    # Two circles cross at two places, which closes one loop more for each neighbouring pair.
    assert wanted == (1, 2 * holes - 1 + (holes - 1), 0)
    mesh = medialis.medial_mesh(shape, balls=60)
    assert mesh.betti == wanted == mesh.level(1).betti


@pytest.mark.slow
def test_linked_rings_are_two_parts():
    other = circle((0, 0, 0), 1.0)[:, [0, 2, 1]] + [1.0, 0, 0]
    shape = tube([circle((0, 0, 0), 1.0), other], 0.2, 0.08)
    mesh = medialis.medial_mesh(shape, balls=40)
    assert mesh.betti == (2, 2, 0) == mesh.level(1).betti
    assert mesh.fewest == 6


@pytest.mark.slow
def test_a_box_ends_in_its_edges():
    """Large balls lie as far from the nearest face as they are large; small ones reach the corners.

    Balls stick out by no more than the distance of the envelope, which is measured at points some
    spacing apart; of small balls few are looked at.
    """
    size = np.array([1.0, 0.8, 0.6])
    shape = box_mesh(tuple(size), 0.1)
    mesh = medialis.medial_mesh(shape, balls=120)
    assert mesh.betti == (1, 0, 0)
    found = medialis.envelope_distance(mesh, shape)
    off, large = found.largest, mesh.radii > 5 * found.spacing
    assert off < 0.03 and large.sum() > 20
    depth = (0.5 * size - np.abs(mesh.centers)).min(axis=1)
    assert (mesh.radii <= depth + off + found.spacing)[large].all()
    assert np.isclose(mesh.radii.max(), 0.3, atol=off)


@pytest.mark.slow
def test_a_slab_is_flat():
    """Large balls of a thin slab lie on its middle sheet; those along its edges stay within it.

    A ball sticks out of the surface by no more than the distance of the envelope.
    """
    shape = box_mesh((1.0, 0.8, 0.05), 0.1)
    mesh = medialis.medial_mesh(shape, balls=30)
    assert mesh.betti == (1, 0, 0) and len(mesh.faces) > 10
    off = error(mesh, shape) * shape.diagonal
    assert off < 0.025 * (np.sqrt(3) - 1)  # of corners rounded by the thickness
    height = np.abs(mesh.centers[:, 2])
    assert (height + mesh.radii <= 0.025 + off).all()
    assert height[mesh.radii > 0.02].max() <= 0.005 + off


@pytest.mark.slow
def test_a_hollow_ball_has_a_hollow():
    shape = joined(icosphere(3), scaled(icosphere(3), 0.6, turned=True))
    mesh = medialis.medial_mesh(shape, balls=60)
    assert mesh.betti == (1, 0, 1)
    assert mesh.level(20).betti == (1, 0, 1)


@pytest.mark.slow
def test_parts_and_nested_parts_stay_apart():
    ball = icosphere(3)
    shape = joined(
        ball, scaled(ball, 0.7, turned=True), scaled(ball, 0.3), scaled(ball, 0.5, (3, 0, 0))
    )
    mesh = medialis.medial_mesh(shape, balls=80)
    assert mesh.betti == (3, 0, 1)


@pytest.mark.slow
def test_a_fin_thinner_than_a_thousandth_survives():
    """A plate of 1 x 1 x 0.001 on the diagonal of 1.41, far thinner than its samples are apart."""
    shape = box_mesh((1.0, 1.0, 0.001), 0.1)
    mesh = medialis.medial_mesh(shape, balls=20)
    assert mesh.betti == (1, 0, 0) and len(mesh.faces) > 0
    low, high = mesh.centers.min(axis=0), mesh.centers.max(axis=0)
    assert (high - low)[:2].min() > 0.9
    assert error(mesh, shape) < 0.01


@pytest.fixture(scope="module")
def organic():
    shape = medialis.organic_shape(200)
    return shape, medialis.medial_mesh(shape, balls=40)


@pytest.mark.slow
def test_every_level_has_the_topology(organic):
    shape, mesh = organic
    wanted = Solid(shape.points / shape.diagonal, shape.faces).betti
    for count in [*range(1, 60), 100, 500, 2000, mesh.most]:
        level = mesh.level(count)
        assert level.betti == wanted, count
        assert len(level) == max(mesh.fewest, min(count, mesh.most))


@pytest.mark.slow
def test_more_balls_are_nearer(organic):
    shape, mesh = organic
    few = medialis.medial_mesh(shape, balls=12)
    assert error(mesh, shape) < error(few, shape) < 0.1


@pytest.mark.slow
def test_best_is_never_farther_off_than_the_default():
    shape = medialis.organic_shape(56)
    default, best = (
        [
            error(medialis.medial_mesh(shape, balls=9, samples=800, seed=k, quality=quality), shape)
            for k in range(3)
        ]
        for quality in ("balanced", "best")
    )
    gains = np.subtract(default, best)
    assert gains.min() >= 0 and gains.max() > 0, (default, best)


@pytest.mark.slow
def test_an_error_is_reached(organic):
    shape, _ = organic
    mesh = medialis.medial_mesh(shape, error=0.02, quality="fast")
    assert error(mesh, shape) <= 0.02


@pytest.mark.slow
def test_an_error_out_of_reach_ends_with_a_message():
    """320 flat facets, too many for a roof, are far from the cones and slabs of any few balls."""
    progress = medialis.Progress()
    mesh = medialis.medial_mesh(
        icosphere(2), error=1e-4, samples=300, quality="fast", progress=progress
    )
    assert "error_not_reached" in [message.code for message in progress.messages]
    assert mesh.betti == (1, 0, 0)


@pytest.mark.slow
def test_results_do_not_depend_on_threads():
    shape = medialis.organic_shape(120)
    found = []
    for threads in (1, 2):
        with memory_limit(0), thread_limit(threads):
            found.append(medialis.medial_mesh(shape, balls=25))
    for name in ("centers", "radii", "edges", "faces"):
        assert np.array_equal(getattr(found[0], name), getattr(found[1], name))


@pytest.mark.slow
def test_topology_and_error_do_not_change_with_a_turn():
    """The samples are others on the axes of the turned shape; what they stand for is the same."""
    shape = medialis.organic_shape(120)
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    turned = medialis.make_shape(5 * shape.points @ turn.T, shape.faces)
    first, second = (medialis.medial_mesh(one, balls=30) for one in (shape, turned))
    assert first.betti == second.betti
    assert error(second, turned) < 2 * error(first, shape)


@pytest.mark.slow
def test_an_open_mesh_is_guessed_with_a_message():
    shape = icosphere(3)
    cap = (shape.points[shape.faces][:, :, 2] > 0.9).all(axis=1)  # a hole of 0.9, too large
    opened = medialis.make_shape(shape.points, shape.faces[~cap])
    progress = medialis.Progress()
    mesh = medialis.medial_mesh(opened, balls=4, progress=progress)
    assert "inside_guessed" in [message.code for message in progress.messages]
    assert mesh.betti[0] == 1


@pytest.mark.slow
def test_parts_that_cross_have_balls_of_their_own():
    """Two balls that overlap: each is one part, and what of it lies in the other is no surface.

    Faces that cross the other ball are surface or not as a whole: their corners may lie as deep in
    it as their sides are long.
    """
    shape = joined(icosphere(3), scaled(icosphere(3), 1.0, (1.0, 0.0, 0.0)))
    solid = Solid(shape.points / shape.diagonal, shape.faces)
    middles = shape.points[shape.faces].mean(axis=1)
    centers = np.repeat([[1.0, 0, 0], [0, 0, 0]], len(middles) // 2, axis=0)
    other = np.linalg.norm(middles - centers, axis=1)
    assert solid.walls[other > 1].all() and not solid.walls[other < 0.99].any()
    assert solid.betti == (2, 0, 0)
    progress = medialis.Progress()
    mesh = medialis.medial_mesh(shape, balls=2, progress=progress)
    assert [message.code for message in progress.messages] == ["automatic", "parts_cross"]
    assert mesh.betti == (2, 0, 0) and len(mesh) == 2
    side = icosphere(3).edge_lengths.max()
    assert error(mesh, shape) * shape.diagonal < side
    ends = mesh.centers[np.argsort(mesh.centers[:, 0])]
    assert np.allclose(ends, [[0, 0, 0], [1, 0, 0]], atol=0.25 * side)
    assert np.allclose(mesh.radii, 1.0, atol=0.25 * side)


@pytest.mark.slow
def test_a_piece_hidden_in_another_is_no_part():
    """A ball within a solid ball, both outward: nothing of it is a wall."""
    ball = icosphere(3)
    mesh = medialis.medial_mesh(joined(ball, scaled(ball, 0.5)), balls=3)
    assert mesh.betti == (1, 0, 0) and error(mesh, ball) < 0.01


@pytest.mark.slow
def test_gaps_between_parts_do_not_join_them():
    """Two boxes a ten-thousandth of the diagonal apart, far less than their samples."""
    box = box_mesh((1.0, 0.8, 0.6), 0.1)
    shape = joined(box, scaled(box, 1.0, (1.0001, 0, 0)))
    mesh = medialis.medial_mesh(shape, balls=60)
    assert mesh.betti == (2, 0, 0) == mesh.level(1).betti


@pytest.mark.slow
def test_parts_that_touch_at_a_vertex_are_apart_there():
    """A horseshoe whose ends share one vertex: no loop."""
    curve = arc((0, 0, 0), 1.0, 0.3, 2 * np.pi - 0.3)
    shape = tube([curve], 0.2, 0.08)
    points, faces = shape.points.copy(), shape.faces.copy()
    top, low = (
        np.argmin(np.linalg.norm(shape.points - [0.95, side * 0.12, 0], axis=1)) for side in (1, -1)
    )
    points[top] = 0.5 * (points[top] + points[low])
    faces[faces == low] = top
    touching = medialis.make_shape(points, faces)
    solid = Solid(touching.points / touching.diagonal, touching.faces)
    assert solid.whole and solid.betti == (1, 0, 0)
    assert medialis.medial_mesh(touching, balls=30).betti == (1, 0, 0)


@pytest.mark.slow
def test_an_open_shell_with_parts_that_cross_it():
    """A head without its neck, and two eyes in its front; only where it is open it is a guess."""
    head = icosphere(3)
    opened = head.faces[(head.points[head.faces][:, :, 2] > -0.8).all(axis=1)]
    eyes = [scaled(icosphere(2), 0.25, (0.85, y, 0.2)) for y in (-0.35, 0.35)]
    shape = joined(medialis.make_shape(head.points, opened), *eyes)
    mesh = medialis.medial_mesh(shape, balls=30)
    assert mesh.betti == (1, 0, 0)
    assert medialis.envelope_distance(mesh, shape).mean < 0.005 * shape.diagonal


def test_what_cannot_be_used_is_refused():
    cloud = medialis.Shape(icosphere(1).points, icosphere(1).points)
    with pytest.raises(InvalidShapeError, match="point cloud"):
        medialis.medial_mesh(cloud)
    with pytest.raises(InvalidOptionError):
        medialis.medial_mesh(icosphere(1), balls=0)
    flat = medialis.make_shape([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    with pytest.raises(InvalidShapeError, match="solid"):
        medialis.medial_mesh(flat)


def test_medial_meshes_check_their_arrays():
    good = medialis.MedialMesh([[0, 0, 0], [1, 0, 0]], [1, 1], [[1, 0]], [])
    assert good.edges.tolist() == [[0, 1]] and good.faces.shape == (0, 3)
    for radii, edges, faces in (
        ([1, -1], [], []),
        ([1, np.nan], [], []),
        ([1, 1], [[0, 2]], []),
        ([1, 1], [[0, 0]], []),
        ([1, 1], [[0, 1], [1, 0]], []),
    ):
        with pytest.raises(InvalidShapeError):
            medialis.MedialMesh([[0, 0, 0], [1, 0, 0]], radii, edges, faces)
    with pytest.raises(InvalidShapeError, match="must be an edge"):
        medialis.MedialMesh(np.eye(3), [1, 1, 1], [[0, 1]], [[0, 1, 2]])


@pytest.mark.parametrize(
    ("count", "edges", "faces", "wanted"),
    [
        (1, [], [], (1, 0, 0)),
        (3, [[0, 1], [1, 2], [0, 2]], [], (1, 1, 0)),
        (3, [[0, 1], [1, 2], [0, 2]], [[0, 1, 2]], (1, 0, 0)),
        (
            4,
            [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]],
            [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]],
            (1, 0, 1),
        ),
    ],
)
def test_betti_numbers(count, edges, faces, wanted):
    edges, faces = np.array(edges).reshape(-1, 2), np.array(faces).reshape(-1, 3)
    assert betti_numbers(count, edges.astype(np.int64), faces.astype(np.int64)) == wanted


def test_betti_numbers_of_a_torus_surface():
    shape = torus_mesh(12, 8)
    found = betti_numbers(shape.point_count, shape.edges.astype(np.int64), shape.faces.astype(int))
    assert found == (1, 2, 1)


def test_an_inside_that_lies_nowhere_near_is_refused_with_a_sentence():
    """A fifth of a sphere, the rest of which is open; half of one is closed."""
    ball = icosphere(2)
    height = ball.points[ball.faces].mean(axis=1)[:, 2]
    caps = [medialis.make_shape(ball.points, ball.faces[height > z]) for z in (0.6, 0.0)]
    with pytest.raises(InvalidShapeError, match=r"off by \d+ % of the diagonal"):
        medialis.medial_mesh(caps[0], balls=20, samples=1000, quality="fast")
    assert len(medialis.medial_mesh(caps[1], balls=20, samples=1000, quality="fast"))


@pytest.mark.slow
def test_noise_above_the_relief_is_smoothed():
    """Noise of 1 % of the diagonal of a torus. What is below the relief leaves no branches."""
    shape, random = torus_mesh(), np.random.default_rng(0)

    def far(noise, **options):
        move, told = noise * shape.diagonal * random.normal(size=shape.points.shape), Progress()
        noisy = medialis.make_shape(shape.points + move, shape.faces)
        options |= {"balls": 24, "samples": 800, "quality": "fast", "progress": told}
        mesh = medialis.medial_mesh(noisy, **options)
        levels = [message.data["noise"] for message in told.messages if message.code == "denoised"]
        return error(mesh, shape), levels

    smooth, levels = far(0.01)
    rough, none = far(0.01, denoise="off")
    assert smooth < rough and none == far(0.001)[1] == []
    assert 0.005 < levels[0] < 0.02
