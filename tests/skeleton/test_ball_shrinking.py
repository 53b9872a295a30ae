"""Ball shrinking against closed forms, two slow oracles, and invariances."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

import closed_forms as forms
from medialis.base.errors import Cancelled, InvalidOptionError, InvalidShapeError
from medialis.base.progress import Progress
from medialis.base.threads import thread_limit
from medialis.shape.reading import read_shape
from medialis.shape.shape import Shape
from medialis.skeleton import medial_cloud
from medialis.skeleton.medial_cloud import (
    CLEARANCE,
    COINCIDENT,
    DEFAULT_TOLERANCE,
    LARGEST_RADIUS,
    BallStatus,
    shrink_balls,
)
from oracles import brute_force_balls, deepest, depth_radii, thesis_algorithm_1

EPS = np.finfo(float).eps
EXACT = 1e-9  # fraction of the diagonal that the docstring grants to rounding


def rounding(shape, i, second, r, a=0.0):
    """Bound of the rounding error of r_a(q) = (num - a^2)/(den - 2 a).

    Coordinates relative to the center of the box (diagonal D) are rounded by eps D at most, so num
    is off by 4 eps D |d| and den by 4 eps D; with den - 2 a = (num - a^2)/r the quotient is off by
    r (4 eps D |d| + 4 eps D r)/(num - a^2), doubled for the operations themselves.
    """
    gap = np.linalg.norm(shape.points[i] - shape.points[second], axis=-1)
    free = np.maximum(gap**2 - a * a, 1e-300)
    return 8 * EPS * shape.diagonal * r * (gap + r) / free


def check_against_oracle(shape, tolerance, side="inner", always_traversed=False, clearance=None):
    """Check all that is promised of every ball, with the brute-force minimum as the judge."""
    cloud = shrink_balls(shape, tolerance=tolerance, side=side)
    sign = 1 if side == "inner" else -1
    d = shape.diagonal
    normals, largest = sign * shape.normals, LARGEST_RADIUS * d
    a = (CLEARANCE if clearance is None else clearance) * tolerance * d
    near = max(COINCIDENT * d, a)
    best, winner = brute_force_balls(shape.points, normals, a, near)
    none = ~shape.normals.any(axis=1)
    assert ((cloud.status == BallStatus.NO_NORMAL) == none).all()
    assert np.isnan(cloud.radii[none]).all() and np.isnan(cloud.centers[none]).all()
    assert (cloud.features[~cloud.valid, 1] == -1).all()
    has = np.flatnonzero(~none)
    depth = deepest(shape.points, cloud.centers[has], cloud.radii[has])
    assert depth.max(initial=-np.inf) <= tolerance * d + EXACT * d
    exact = tolerance == 0 or always_traversed
    for i in has:
        r, second = cloud.radii[i], cloud.features[i, 1]
        if second < 0:
            assert r == pytest.approx(largest, rel=1e-15)
            if exact and np.isfinite(best[i]):
                assert best[i] >= largest - rounding(shape, i, winner[i], best[i], a)
            continue
        at_zero = depth_radii(shape.points, normals, i, 0.0, 0.0)[second]
        assert abs(r - at_zero) <= rounding(shape, i, second, r)
        deep = depth_radii(shape.points, normals, i, a, near)[second]
        assert deep >= best[i] - rounding(shape, i, second, deep, a)
        if exact:
            slack = rounding(shape, i, second, deep, a) + rounding(shape, i, winner[i], best[i], a)
            assert deep <= best[i] + slack
        half = math.asin(min(1.0, np.linalg.norm(shape.points[i] - shape.points[second]) / 2 / r))
        # asin is steepest at 1, where asin(1) - asin(1 - x) <= pi/2 sqrt(x).
        blur = math.pi * math.sqrt(rounding(shape, i, second, r) / r)
        assert abs(cloud.spoke_angles[i] - 2 * half) <= blur
    return cloud


def make_points(kind, n, rng):
    points = rng.normal(size=(n, 3))
    if kind == "sphere":
        points = forms.unit(points)
    elif kind == "grid":  # exact ties, coplanar and duplicate points
        points = rng.integers(-2, 3, size=(n, 3)).astype(float)
    elif kind == "plane":
        points[:, 2] = 0.25
    elif kind == "line":
        points = np.outer(points[:, 0], [1.0, 2.0, 3.0])
    elif kind == "clusters":
        points = points[rng.integers(0, min(n, 4), n)] + 1e-6 * rng.normal(size=(n, 3))
    elif kind == "duplicates":
        points = points[rng.integers(0, max(n // 3, 2), n)]
    return points


def make_normals(kind, points, rng):
    normals = rng.normal(size=points.shape)
    if kind == "outward":
        normals = points - points.mean(axis=0)
    elif kind == "axes":
        normals = np.eye(3)[rng.integers(0, 3, len(points))] * rng.choice([-1, 1], (len(points), 1))
    elif kind == "gaps":
        normals[rng.random(len(points)) < 0.3] = 0
        normals[0] = 1
    return normals


@pytest.mark.slow
@settings(max_examples=120, deadline=None, derandomize=True)
@given(
    n=st.integers(2, 120),
    points=st.sampled_from(["gauss", "sphere", "grid", "plane", "line", "clusters", "duplicates"]),
    normals=st.sampled_from(["random", "outward", "axes", "gaps"]),
    exponent=st.sampled_from([-200, -30, -6, 0, 0, 6, 30, 120]),
    side=st.sampled_from(["inner", "outer"]),
    tolerance=st.sampled_from([0.0, 0.0, 1e-6, DEFAULT_TOLERANCE, 1e-2, 0.1]),
    seed=st.integers(0, 2**32 - 1),
)
def test_balls_of_any_cloud_are_the_brute_force_minimum(
    n, points, normals, exponent, side, tolerance, seed
):
    """Tiny and huge coordinates: squares left the float32 range of the tree's bounds (fixed)."""
    rng = np.random.default_rng(seed)
    p = make_points(points, n, rng)
    if (p == p[0]).all():
        p[0] += 1
    n_ = make_normals(normals, p, rng)
    if not n_.any():
        n_[0] = 1
    # A power of two, so that the oracle can work at size 1 without another rounding.
    scale = 2.0 ** round(exponent * math.log2(10))
    small = Shape(p, n_)
    cloud = check_against_oracle(small, tolerance, side)
    scaled = shrink_balls(Shape(p * scale, n_), tolerance=tolerance, side=side)
    assert np.array_equal(scaled.radii, cloud.radii * scale, equal_nan=True)
    assert np.array_equal(scaled.centers, cloud.centers * scale, equal_nan=True)
    assert np.array_equal(scaled.features, cloud.features)


@pytest.mark.parametrize("kind", ["gauss", "sphere", "grid", "clusters", "plane"])
@pytest.mark.parametrize("tolerance", [1e-6, 1e-3, 0.03])
def test_without_certificates_the_ball_is_the_one_through_the_winner(kind, tolerance, monkeypatch):
    """With a clearance of 1 only nested balls reuse a certificate, so r_a(f2) is the minimum."""
    monkeypatch.setattr(medial_cloud, "CLEARANCE", 1.0)
    rng = np.random.default_rng(5)
    p = make_points(kind, 150, rng)
    check_against_oracle(
        Shape(p, make_normals("random", p, rng)), tolerance, always_traversed=True, clearance=1.0
    )


@pytest.mark.parametrize(
    "n", [2, 3, 7, 15, 16, 17, 31, 32, 33, 63, 64, 65, 127, 128, 129, 130, 256, 257, 1025]
)
def test_every_leaf_and_level_count(n):
    rng = np.random.default_rng(n)
    check_against_oracle(Shape(rng.normal(size=(n, 3)), rng.normal(size=(n, 3))), 0.0)


@pytest.mark.parametrize("side", ["inner", "outer"])
def test_balls_are_those_of_the_printed_algorithm(side):
    """Algorithm 1 stops when no sample is deeper than tau: r_tau of our contact bounds it."""
    for shape in (
        forms.ellipsoid(120, mirrored=False).shape,
        forms.capsule(80).shape,
        Shape(*np.random.default_rng(3).normal(size=(2, 90, 3))),
    ):
        sign = 1 if side == "inner" else -1
        tau = 1e-8 * shape.diagonal
        cloud = shrink_balls(shape, tolerance=0.0, side=side)
        radii, second = thesis_algorithm_1(
            shape.points, sign * shape.normals, LARGEST_RADIUS * shape.diagonal, tau
        )
        for i in range(len(cloud)):
            f2 = cloud.features[i, 1]
            assert radii[i] >= cloud.radii[i] - EXACT * shape.diagonal
            if f2 >= 0:
                bound = depth_radii(shape.points, sign * shape.normals, i, tau, tau)[f2]
                assert radii[i] <= bound + EXACT * shape.diagonal
            else:
                assert radii[i] == LARGEST_RADIUS * shape.diagonal or second[i] >= 0


CLOSED = {
    "sphere": forms.sphere(1500),
    "random sphere": forms.sphere(1500, seed=4),
    "ellipsoid": forms.ellipsoid(4000, mirrored=False),
    "mirrored ellipsoid": forms.ellipsoid(4000),
    "oblate spheroid": forms.oblate_spheroid(4000),
    "torus": forms.torus(),
    "capsule": forms.capsule(6000),
    "box": forms.box_samples(),
}


@pytest.mark.parametrize("tolerance", [0.0, DEFAULT_TOLERANCE])
@pytest.mark.parametrize("name", list(CLOSED))
def test_closed_form(name, tolerance):
    """Radius and center are off by at most ClosedForm.excess, whose docstring derives it."""
    form = CLOSED[name]
    cloud = shrink_balls(form.shape, tolerance=tolerance)
    bound, tiny = form.excess(tolerance), EXACT * form.shape.diagonal
    judged = np.isfinite(bound)
    # A vacuous bound proves nothing. Not judged: samples close to the rim of the axis or, of the
    # box, close to an edge, where the balls are smaller than about three spacings.
    assert judged.mean() > (0.8 if name == "box" else 0.9)
    excess = cloud.radii - form.radii
    assert cloud.valid[judged].all()
    assert excess[cloud.valid].min() >= -tiny
    assert (excess[judged] <= bound[judged] + tiny).all()
    off = np.linalg.norm(cloud.centers - form.centers, axis=1)
    assert (off[judged] <= bound[judged] + tiny).all()


def test_balls_of_a_mirrored_ellipsoid_are_exact():
    """Every second contact is a sample: radius, center and contact are right to rounding."""
    form = forms.ellipsoid(3000)
    cloud = shrink_balls(form.shape, tolerance=0.0)
    n = len(cloud)
    mirror = (np.arange(n) + n // 2) % n
    error = np.abs(cloud.radii - form.radii)
    # Sample and normal are themselves rounded, by eps D and eps: no more than the same again.
    assert (error <= 2 * rounding(form.shape, np.arange(n), mirror, form.radii)).all()
    assert (cloud.features[:, 1] == mirror).mean() > 0.99  # else a sample equally far to rounding


@pytest.mark.slow
def test_mirrored_ellipsoid_with_tolerance():
    """No sample is deeper than T: r is at most r_T of the mirror point, and never below r."""
    form = forms.ellipsoid(3000)
    shape, n = form.shape, form.shape.point_count
    cloud, t = shrink_balls(shape), DEFAULT_TOLERANCE * shape.diagonal
    mirror = (np.arange(n) + n // 2) % n
    bound = [depth_radii(shape.points, shape.normals, i, t, t)[mirror[i]] for i in range(n)]
    assert (cloud.radii <= np.array(bound) + EXACT).all()
    assert (cloud.radii >= form.radii - EXACT).all()


def test_sphere_centers_meet_at_the_origin():
    """All samples lie on one ball, so each contact gives r = 1 up to rounding (gap > 1e-3 here)."""
    cloud = shrink_balls(forms.sphere(3000, seed=1).shape, tolerance=0.0)
    gap = np.linalg.norm(
        cloud.centers + forms.random_directions(3000, 1) * cloud.radii[:, None], axis=1
    )
    assert gap == pytest.approx(1.0, abs=1e-12)
    assert np.abs(cloud.centers).max() < 16 * EPS * 3.5 / 1e-3**2


def test_oblate_spheroid_has_a_disc():
    a, c = 1.0, 0.5
    form = forms.oblate_spheroid(4000, a, c)
    cloud = shrink_balls(form.shape, tolerance=0.0)
    bound = form.excess()
    judged = np.isfinite(bound)
    reach = np.linalg.norm(cloud.centers[judged, :2], axis=1)
    assert (reach <= (a * a - c * c) / a + bound[judged] + EXACT).all()
    assert (np.abs(cloud.centers[judged, 2]) <= bound[judged] + EXACT).all()
    assert reach.max() > 0.9 * (a * a - c * c) / a


def test_box_balls_touch_a_wall_or_the_opposite_face():
    """Contacts at a wall are seen at 90 degrees, those of the opposite face at 180.

    The contact found lies within e of the true one or closer to p; where the bound of the radius
    is d, two tangent balls that differ by d see a contact at angles at most 2 asin(sqrt(d/r) + e/r)
    apart: loosely 0.35 for the samples with e < 0.1 r, which have d < 0.01 r.
    """
    form = forms.box_samples(spacing=0.02)
    cloud = shrink_balls(form.shape, tolerance=0.0)
    e = cKDTree(form.shape.points).query(form.contacts)[0]
    a, b = form.shape.points - form.centers, form.contacts - form.centers
    truth = np.arccos(np.clip((a * b).sum(1) / form.radii**2, -1, 1))
    judged = e < 0.1 * form.radii
    assert judged.sum() > 3000
    assert set(np.round(np.degrees(truth)).astype(int)) == {90, 180}
    # Balls that touch wall and opposite face at once (within the bound) may show either.
    second = np.sort(np.stack([*_box_gaps(form)], axis=1), axis=1)
    clear = judged & (second[:, 1] - second[:, 0] > 0.1 * form.radii)
    assert np.abs(cloud.spoke_angles - truth)[clear].max() < 0.35


def _box_gaps(form):
    """Largest radius that each of wall, other wall and opposite face would allow."""
    half = form.shape.points.max(axis=0)
    axis = np.abs(form.shape.normals).argmax(axis=1)
    gaps = half - np.abs(form.shape.points)
    rows = np.arange(len(axis))
    yield gaps[rows, (axis + 1) % 3]
    yield gaps[rows, (axis + 2) % 3]
    yield half[axis]


@pytest.mark.parametrize("tolerance", [0.0, DEFAULT_TOLERANCE])
@pytest.mark.parametrize("name", ["bunny", "armadillo", "fandisk"])
def test_no_sample_lies_deep_in_a_ball_of_a_real_shape(name, tolerance, real_shapes):
    shape = read_shape(real_shapes / f"{name}.ply")
    cloud = shrink_balls(shape, tolerance=tolerance)
    rows = np.flatnonzero(cloud.status != BallStatus.NO_NORMAL)[::11]
    distance = cKDTree(shape.points).query(cloud.centers[rows])[0]
    assert (cloud.radii[rows] - distance).max() <= (tolerance + EXACT) * shape.diagonal
    assert cloud.valid.mean() > 0.9


def generic():
    return forms.ellipsoid(2500, (1.0, 0.7, 0.4), mirrored=False).shape


def assert_same_balls(cloud, other, shape, noise=1.0):
    """Radii agree to `noise` x rounding; contacts agree, or both give that radius (a tie)."""
    rows = np.arange(len(cloud))
    near = np.minimum(
        np.linalg.norm(shape.points - shape.points[cloud.features[:, 1]], axis=1),
        np.linalg.norm(shape.points - shape.points[other.features[:, 1]], axis=1),
    )
    r = cloud.radii
    slack = 16 * noise * EPS * shape.diagonal * r * (near + r) / near**2
    assert cloud.valid.all() and other.valid.all()
    assert (np.abs(other.radii - r) <= slack).all()
    for i in rows[cloud.features[:, 1] != other.features[:, 1]]:
        radius = depth_radii(shape.points, shape.normals, i, 0.0, 0.0)[other.features[i, 1]]
        assert abs(radius - r[i]) <= slack[i]


@pytest.mark.parametrize(
    ("factor", "shift", "noise"),
    [(1e-6, 0.0, 1), (1e6, 0.0, 1), (1.0, 1e3, 1e3), (1.0, 7.0, 10)],
)
def test_balls_follow_scale_and_translation(factor, shift, noise):
    """The moved samples are rounded to eps x their size, `noise` times that of the originals."""
    shape = generic()
    move = shift * shape.diagonal * np.array([1.0, -0.5, 0.7])
    cloud = shrink_balls(shape, tolerance=0.0)
    moved = Shape(shape.points * factor + move, shape.normals)
    other = shrink_balls(moved, tolerance=0.0)
    back = other.radii / factor
    rows = np.linalg.norm(other.centers - move - cloud.centers * factor, axis=1) / factor
    gap = np.linalg.norm(shape.points - shape.points[cloud.features[:, 1]], axis=1)
    slack = 64 * noise * EPS * shape.diagonal * (1 + back * (gap + back) / gap**2)
    assert (rows <= slack).all()
    assert (np.abs(back - cloud.radii) <= slack).all()


@pytest.mark.parametrize("tolerance", [0.0, DEFAULT_TOLERANCE])
def test_scaling_by_a_power_of_two_changes_no_bit(tolerance):
    shape = generic()
    cloud = shrink_balls(shape, tolerance=tolerance)
    for power in (-900, -64, 20, 500):
        scale = 2.0**power
        other = shrink_balls(Shape(shape.points * scale, shape.normals), tolerance=tolerance)
        assert (other.radii == cloud.radii * scale).all()
        assert (other.centers == cloud.centers * scale).all()
        assert (other.features == cloud.features).all()


def test_balls_follow_a_rotation():
    shape = generic()
    q, _ = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))
    cloud = shrink_balls(shape, tolerance=0.0)
    other = shrink_balls(Shape(shape.points @ q.T, shape.normals @ q.T), tolerance=0.0)
    assert_same_balls(cloud, other, shape, noise=4)  # normals are rounded as well


def test_balls_do_not_depend_on_the_point_order():
    shape = generic()
    order = np.random.default_rng(1).permutation(shape.point_count)
    cloud = shrink_balls(shape, tolerance=0.0)
    mixed = shrink_balls(Shape(shape.points[order], shape.normals[order]), tolerance=0.0)
    back = np.argsort(order)
    mixed = mixed.subset(back)
    object.__setattr__(mixed, "features", order[mixed.features].astype(np.int32))
    assert (mixed.features[:, 0] == np.arange(len(mixed))).all()
    assert_same_balls(cloud, mixed, shape)


@pytest.mark.parametrize("side", ["inner", "both"])
def test_one_and_two_threads_give_the_same_bits(side):
    shape = forms.capsule(9000).shape
    with thread_limit(1):
        one = shrink_balls(shape, side=side)
    with thread_limit(2):
        two = shrink_balls(shape, side=side)
    for name in ("centers", "radii", "features", "status", "spoke_angles", "source", "side"):
        assert getattr(one, name).tobytes() == getattr(two, name).tobytes()


def test_inputs_stay_unchanged():
    points, normals = np.random.default_rng(0).normal(size=(2, 300, 3))
    before = points.copy(), normals.copy()
    shrink_balls(Shape(points, normals), side="both")
    assert (points == before[0]).all() and (normals == before[1]).all()


def test_outer_balls_of_a_sphere_are_open():
    shape = forms.sphere(400).shape
    progress = Progress()
    cloud = shrink_balls(shape, side="outer", largest_radius=0.7, progress=progress)
    assert (cloud.status == BallStatus.OPEN).all() and (cloud.side == -1).all()
    assert cloud.radii == pytest.approx(0.7 * shape.diagonal, rel=1e-15)
    assert (cloud.features[:, 1] == -1).all() and np.isnan(cloud.spoke_angles).all()
    expected = shape.points + 0.7 * shape.diagonal * shape.normals
    assert cloud.centers == pytest.approx(expected, abs=1e-14)
    (message,) = progress.messages
    assert message.code == "open_balls" and message.data["side"] == "outer"
    assert message.data["balls"] == message.data["of"] == 400


def test_outer_balls_lie_between_plates_that_face_each_other():
    """The plate at z = 1 repeats the samples of the one at z = 0, so the contact is exact."""
    x, y = (g.ravel() for g in np.meshgrid(np.linspace(-1, 1, 21), np.linspace(-1, 1, 21)))
    low = np.stack([x, y, 0 * x], axis=1)
    up = np.tile([0, 0, 1.0], (len(x), 1))
    shape = Shape(np.concatenate([low, low + up]), np.concatenate([up, -up]))
    inner = shrink_balls(shape, tolerance=0.0)
    outer = shrink_balls(shape, tolerance=0.0, side="outer")
    assert (inner.status == BallStatus.OPEN).all()
    assert outer.valid.all()
    assert outer.centers[:, 2] == pytest.approx(0.5, abs=4 * EPS)
    assert outer.radii == pytest.approx(0.5, abs=4 * EPS)
    assert (outer.features[:, 1] == (outer.source + len(x)) % (2 * len(x))).all()


def test_both_sides_are_inner_rows_then_outer_rows():
    shape = forms.torus(60, 20).shape
    parts = [shrink_balls(shape, side=side) for side in ("inner", "outer")]
    both = shrink_balls(shape, side="both")
    for name in ("centers", "radii", "features", "status", "spoke_angles", "source", "side"):
        joined = np.concatenate([getattr(part, name) for part in parts])
        assert np.array_equal(getattr(both, name), joined, equal_nan=True)


def test_samples_without_a_normal_get_no_ball():
    form = forms.sphere(300)
    normals = form.shape.normals.copy()
    normals[3], normals[200] = 0, np.nan
    progress = Progress()
    cloud = shrink_balls(Shape(form.shape.points, normals), progress=progress)
    assert np.flatnonzero(cloud.status == BallStatus.NO_NORMAL).tolist() == [3, 200]
    assert np.isnan(cloud.radii[[3, 200]]).all() and np.isfinite(cloud.radii[cloud.valid]).all()
    assert len(cloud.subset(cloud.valid)) == 298
    (message,) = progress.messages
    assert message.code == "no_normal" and message.data == {"samples": 2, "of": 300}


@pytest.mark.parametrize("side", ["inner", "both"])
def test_progress_rises_to_one(side):
    seen = []
    shape = forms.capsule(6000).shape
    shrink_balls(shape, side=side, progress=lambda f, text: seen.append((f, text)))
    fractions = [f for f, _ in seen]
    assert fractions == sorted(fractions) and fractions[0] == 0 and fractions[-1] == 1
    assert {text for _, text in seen} == {"tree", "balls"}


@pytest.mark.parametrize("answer", ["false", "raise"])
@pytest.mark.parametrize("threads", [1, 2])
def test_cancelling(answer, threads):
    def stop(fraction, text):
        if fraction > 0.3:
            if answer == "raise":
                raise Cancelled("enough")
            return False
        return True

    with thread_limit(threads), pytest.raises(Cancelled):
        shrink_balls(forms.capsule(20000).shape, progress=stop)


def test_outer_half_of_both_sides_can_be_cancelled():
    """The second side ran without a progress callback: silent and not to be stopped (fixed)."""
    seen = []

    def stop(fraction, text):
        seen.append(fraction)
        return fraction < 0.7

    with pytest.raises(Cancelled):
        shrink_balls(forms.capsule(9000).shape, side="both", progress=stop)
    assert 0.7 <= seen[-1] < 1


def test_keyboard_interrupt_in_the_callback_comes_through():
    def stop(fraction, text):
        if fraction > 0.2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        shrink_balls(forms.capsule(9000).shape, progress=stop)


@pytest.mark.parametrize(
    "options",
    [
        {"tolerance": -1e-9},
        {"tolerance": 0.11},
        {"tolerance": math.nan},
        {"tolerance": "exact"},
        {"side": "inside"},
        {"side": None},
        {"largest_radius": 0.0},
        {"largest_radius": 10.5},
        {"largest_radius": math.inf},
    ],
)
def test_options_out_of_range(options):
    with pytest.raises(InvalidOptionError, match=next(iter(options))):
        shrink_balls(forms.sphere(20).shape, **options)


def test_coinciding_points():
    for n in (1, 5):
        with pytest.raises(InvalidShapeError, match="coincide"):
            shrink_balls(Shape(np.ones((n, 3)), np.ones((n, 3))))


def test_no_normals_at_all():
    with pytest.raises(InvalidShapeError, match="normal"):
        shrink_balls(Shape(np.random.default_rng(0).normal(size=(9, 3)), np.zeros((9, 3))))
