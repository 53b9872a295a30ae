"""Samples on limbs: rays against all triangles, closed forms of prisms, nothing on sheets."""

import numpy as np
import pytest

import closed_forms as forms
import medialis
from medialis.base.box_tree import NearestTree
from medialis.base.progress import Progress
from medialis.curves import limb_sampling
from medialis.curves._limb_kernels import first_hit
from medialis.curves.finishing import _small
from medialis.curves.limb_sampling import (
    EDGES_A_RADIUS,
    _longest_sides,
    _thin_places,
    limb_radii,
    with_limbs_sampled,
)
from medialis.skeleton.preparation import size_share

TURN = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0], [0.48, 0.64, 0.6]])


def prism(sides, radius, length):
    """A bar with flat ends, whose sides are two triangles each."""
    ends = [(0, 0), (radius, 0), (radius, length), (0, length)]
    return forms.revolved(ends, around=sides)


def all_hits(place, way, corners):
    """Length of a ray up to the first of all triangles, by solving for each."""
    a, b, c = np.moveaxis(corners, 1, 0)
    matrix = np.stack([b - a, c - a, np.broadcast_to(-way, a.shape)], axis=2)
    matrix, a = (
        matrix[np.abs(np.linalg.det(matrix)) > 1e-14],
        a[np.abs(np.linalg.det(matrix)) > 1e-14],
    )
    u, v, length = np.linalg.solve(matrix, (place - a)[:, :, None])[:, :, 0].T
    return length[(u >= 0) & (v >= 0) & (u + v <= 1) & (length > 1e-9)].min(initial=np.inf)


@pytest.mark.slow
def test_rays_hit_what_all_triangles_tell():
    shape = forms.torus_mesh(around=20, across=10)
    tree = NearestTree.of_triangles(shape.points, shape.faces)
    corners, rng = shape.points[shape.faces], np.random.default_rng(0)
    room = np.empty(200, np.int64), np.empty(8)
    for _ in range(40):
        place = shape.points[rng.integers(shape.point_count)] + 0.05 * rng.normal(size=3)
        way = rng.normal(size=3)
        way /= np.linalg.norm(way)
        start, longer = place - tree.tree.center, np.append(way, np.zeros(3))
        given = start, longer, tree.tree, tree.items.corners, *room, 1e-9
        true = all_hits(place, way, corners)
        assert first_hit(*given, np.inf) == pytest.approx(true, rel=1e-9)
        assert first_hit(*given, 0.999 * true) == np.inf  # nothing is so near


@pytest.mark.slow
@pytest.mark.parametrize("turn", [np.eye(3), TURN])
def test_a_bar_is_as_thick_as_its_sides_are_apart(turn):
    bar = prism(6, 0.1, 2.0)
    bar = medialis.make_shape(bar.points @ turn.T, bar.faces)
    apothem = 0.1 * np.cos(np.pi / 6)
    found = limb_radii(bar, Progress())
    assert found[np.isfinite(found)] == pytest.approx(apothem, rel=1e-9)
    # Long triangles become even ones first, as in `prepared`.
    bar = medialis.refine(bar, longest_edge=0.05)
    fine = with_limbs_sampled(bar, Progress())
    middles = fine.points[fine.edges].mean(axis=1) @ turn
    side = np.hypot(*middles[:, :2].T) > 0.9 * apothem  # the middle of an end is no limb
    assert fine.edge_lengths[side].max() <= apothem / EDGES_A_RADIUS
    assert (fine.points[: bar.point_count] == bar.points).all()
    assert fine.area == pytest.approx(bar.area, rel=1e-12)


def test_plates_are_limbs_at_their_corners_alone():
    """A line across a plate, three thicknesses long, may cut off a corner half as far away."""
    thick, edge = 0.1, 0.2
    plate = forms.box_mesh((2.0, 1.6, thick), longest_edge=edge)
    limb = np.isfinite(limb_radii(plate, Progress()))
    middles = plate.points[plate.faces].mean(axis=1)[:, :2]
    corner = np.array([1.0, 0.8]) - np.abs(middles - np.mean(plate.bounds, axis=0)[:2])
    assert limb.any() and np.hypot(*corner[limb].T).max() < 1.5 * thick + edge


def test_only_faces_that_may_be_thin_are_measured_and_others_tell_the_same(monkeypatch):
    """A thin limb on a thick body; samples round the limb are apart by up to its thickness."""
    profile = [(0, -1), (1, -1), (1, 0), (0.08, 0.02), (0.08, 1.5), (0, 1.5)]
    shape = medialis.refine(forms.revolved(profile, around=12), longest_edge=0.03)
    chosen, others = _thin_places(shape, _longest_sides(shape), Progress())
    found = limb_radii(shape, Progress())
    assert 0 < len(chosen) < len(others) < shape.face_count
    whole = np.arange(shape.face_count), np.arange(shape.face_count)
    monkeypatch.setattr(limb_sampling, "_thin_places", lambda *_: whole)
    assert (limb_radii(shape, Progress()) == found).all()


def test_the_size_is_that_of_a_ball_and_no_turn_changes_it():
    ball = forms.icosphere(3)
    assert size_share(ball) * ball.diagonal == pytest.approx(4.0, rel=0.01)
    bar = prism(5, 0.1, 2.0)
    turned = medialis.make_shape(bar.points @ TURN.T, bar.faces)
    sizes = [size_share(shape) * shape.diagonal for shape in (bar, turned)]
    assert sizes[0] == pytest.approx(sizes[1], rel=1e-12)


@pytest.mark.parametrize("smallest", [0.5, 1.5, 2.5])
def test_of_limbs_at_one_base_the_smallest_goes_first(smallest):
    """Limbs on which 1 and 2 hang, at one end of a trunk on which 9 hang."""
    nodes = [[0, 0, 0], [3, 0, 0], [3, 2, 0], [3, 0, 2]]
    graph = medialis.CurveSkeleton.of(nodes, [[0, 1], [1, 2], [1, 3]], np.full(4, 0.5))
    area = np.array([9.0, 0.0, 1.0, 2.0])
    gone = _small(graph, np.arange(4), area, smallest)
    assert gone.tolist() == [False, False, smallest > 1.0, False]


@pytest.mark.slow
@pytest.mark.parametrize("sides", [5, 8, 24])
def test_a_thin_bar_has_its_axis_however_few_sides_it_has(sides):
    run = medialis.run("curve_skeleton", prism(sides, 0.01, 2.0))
    assert (run.graph.branch_count, len(run.graph.end_points)) == (1, 2)
    assert run.graph.length == pytest.approx(2.0 - 0.02, abs=0.02)
    off = np.hypot(*run.graph.nodes[:, :2].T)
    assert off.max() < 0.01 / 4  # half the distance of samples
