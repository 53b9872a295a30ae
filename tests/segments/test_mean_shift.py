"""Mean shift: blobs, an independent oracle, the dental arch, picked seeds, bad input."""

import math

import numpy as np
import pytest

import clouds
import medialis
from medialis.segments._kernels import STILL, _exponential
from medialis.segments.mean_shift import MOST_STEPS, SIGMA, seed_points


def blobs(distance, n=300, seed=0):
    """Four Gaussian blobs of standard deviation 1, the centers `distance` apart or more."""
    rng = np.random.default_rng(seed)
    centers = distance * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    return (rng.normal(size=(4, n, 3)) + centers[:, None]).reshape(-1, 3), np.repeat(range(4), n)


def shift(points, radius, **options):
    """Mean shift with a search radius in the units of the points."""
    share = radius / math.dist(points.min(axis=0), points.max(axis=0))
    return medialis.mean_shift(points, search_radius=share, **options)


def shifted(points, place, radius, sigma):
    """Eq. 5.1 for one place."""
    distance = np.linalg.norm(points - place, axis=1)
    near = distance <= radius
    weight = np.exp(-(distance[near] ** 2) / (2 * sigma**2)) if sigma else np.ones(near.sum())
    return (weight[:, None] * points[near]).sum(axis=0) / weight.sum()


def paths_by_numpy(points, seeds, radius, sigma):
    """The steps of each seed, in plain numpy."""
    result = []
    for place in seeds:
        steps = []
        for _ in range(MOST_STEPS):
            moved = shifted(points, place, radius, sigma)
            still = np.linalg.norm(moved - place) <= STILL * radius
            place = moved
            steps.append(place)
            if still:
                break
        result.append(np.array(steps))
    return result


@pytest.mark.parametrize("kernel", ["gaussian", "flat"])
def test_paths_and_votes_are_those_of_numpy(kernel):
    points, _ = blobs(4, n=60)
    seeds, radius = points[::12], 2.0
    sigma = SIGMA * radius if kernel == "gaussian" else 0.0
    found = shift(points, radius, seeds=seeds, kernel=kernel)
    paths = paths_by_numpy(points, seeds, radius, sigma)
    ends = np.array([path[-1] for path in paths])
    # A center is an end; sums in another order differ by rounding, and so may the last step.
    nearest = np.linalg.norm(found.centers[:, None] - ends, axis=2).min(axis=1)
    assert nearest.max() <= 2 * STILL * radius
    gap = np.linalg.norm(found.centers[found.seed_labels] - ends, axis=1)
    assert (gap <= radius * (1 + 2 * STILL)).all()
    votes = np.zeros((len(points), len(found.centers)))
    for path, name in zip(paths, found.seed_labels, strict=True):
        distance = np.linalg.norm(points[:, None] - path, axis=2)
        weight = np.exp(-(distance**2) / (2 * sigma**2)) if sigma else np.ones_like(distance)
        votes[:, name] += np.where(distance <= radius, weight, 0).sum(axis=1)
    expected = np.where(votes.sum(axis=1) > 0, votes.argmax(axis=1), -1)
    clear = np.sort(votes, axis=1)[:, -1] - np.sort(votes, axis=1)[:, -2] > 2
    assert clear.mean() > 0.5
    assert (found.labels[clear] == expected[clear]).all()


@pytest.mark.parametrize("distance", [4, 9])
def test_blobs_are_found(distance):
    """Blobs 4 standard deviations apart overlap by 2.3 % on each side (the normal tail at 2)."""
    points, truth = blobs(distance)
    found = shift(points, 2.5)
    assert len(found.centers) == 4
    assert clouds.adjusted_rand(truth, found.labels) >= (0.99 if distance == 9 else 0.85)
    # The mean of 300 points errs by 1 / sqrt(300) an axis; the mode of a smoothed density by more.
    for center in (points[truth == t].mean(axis=0) for t in range(4)):
        assert np.linalg.norm(found.centers - center, axis=1).min() < 0.5


def test_last_steps_leave_far_points_alone():
    points = np.concatenate([blobs(9)[0], [[30.0, 0, 0]]])
    found = shift(points, 2.0, seeds=points[:-1], last_steps=1)
    whole = shift(points, 2.0, seeds=points[:-1])
    assert found.labels[-1] == -1 and whole.labels[-1] == -1
    assert (found.labels < 0).sum() > (whole.labels < 0).sum()


def test_threads_order_of_seeds_and_scale():
    points, _ = blobs(4)
    seeds = points[::5]
    with medialis.thread_limit(1):
        one = shift(points, 2.0, seeds=seeds)
    with medialis.thread_limit(2):
        two = shift(points, 2.0, seeds=seeds[::-1])
    assert (one.centers == two.centers).all() and (one.seed_labels[::-1] == two.seed_labels).all()
    scaled = shift(points * 2.0**-60, 2.0**-59, seeds=seeds * 2.0**-60)
    assert (scaled.labels == one.labels).all()  # powers of 2: not even rounding differs


def test_a_callback_changes_nothing():
    """Options that are data got lost with it."""
    points, _ = blobs(4)
    calls = []
    seen = shift(points, 2.0, seeds=points[::5], progress=lambda *call: calls.append(call))
    assert calls and len(seen.seed_labels) == len(points[::5])
    assert (seen.labels == shift(points, 2.0, seeds=points[::5]).labels).all()


@pytest.fixture(scope="module")
def arch():
    shape, teeth = medialis.dental_arch(resolution=120)
    return shape, teeth, medialis.shrink_balls(shape)


@pytest.mark.slow
def test_the_arch_has_its_teeth(arch):
    shape, teeth, _ = arch
    found = medialis.diagnose(shape.points, shape.faces)
    assert found.closed and found.components == 1 and found.orientation == "out"
    assert sorted(set(teeth.tolist())) == list(range(-1, 14))
    other = medialis.dental_arch(16, resolution=100, rng=1)
    assert other[1].max() == 15
    assert (medialis.dental_arch(resolution=120)[0].points == shape.points).all()


@pytest.mark.slow
def test_teeth_are_found_by_density(arch):
    """The gum is divided into segments as well; on the teeth, segments are teeth."""
    shape, teeth, cloud = arch
    found = medialis.mean_shift_segments(cloud, seeds="bumps", last_steps=20, fill=False)
    on = teeth >= 0
    assert clouds.adjusted_rand(teeth[on], found.labels[on]) >= 0.9
    assert found.areas.sum() <= 1.0001 * shape.area


def test_picked_teeth_are_found_and_nothing_else(arch):
    """One pick a tooth: its tip. The gum stays without a segment."""
    shape, teeth, cloud = arch
    tips = [
        int(np.flatnonzero(teeth == t)[shape.points[teeth == t, 2].argmax()]) for t in range(14)
    ]
    options = {"search_radius": 0.04, "seeds": "none", "add": tips, "fill": False}
    found = medialis.mean_shift_segments(cloud, **options)
    assert found.count == 14
    assert clouds.adjusted_rand(teeth, found.labels) >= 0.9
    fewer = medialis.mean_shift_segments(cloud, **options, remove=tips[:1])
    assert fewer.count == 13


def test_the_whole_surface_is_segmented_unless_told_otherwise(arch):
    shape, _, cloud = arch
    found = medialis.mean_shift_segments(cloud, seeds="bumps", last_steps=1)
    assert (found.labels >= 0).all()
    assert found.areas.sum() == pytest.approx(shape.area)


def dumbbell(n=4000, gap=1.5):
    """Two spheres of radius 1 joined by a thin neck, as samples with normals."""
    rng = np.random.default_rng(0)
    u = rng.normal(size=(n, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    side = np.where(np.arange(n) < n // 2, -1, 1)
    keep = u[:, 0] * -side < math.cos(0.2)
    ball = u * [1, 1, 1] + side[:, None] * [1 + gap / 2, 0, 0]
    x, turn = rng.uniform(-gap / 2, gap / 2, n // 8), rng.uniform(0, 2 * math.pi, n // 8)
    round_ = np.stack([0 * x, np.cos(turn), np.sin(turn)], axis=1)
    points = np.concatenate([ball[keep], 0.2 * round_ + x[:, None] * [1, 0, 0]])
    truth = np.concatenate([(side[keep] > 0).astype(int), (x > 0).astype(int)])
    return medialis.Shape(points, np.concatenate([u[keep], round_])), truth


@pytest.mark.slow
def test_a_dumbbell_has_two_ends():
    """The neck is not judged: its segments may be the ends or its own."""
    shape, truth = dumbbell()
    cloud = medialis.shrink_balls(shape)
    found = medialis.mean_shift_segments(cloud, search_radius=0.1, seeds="all")
    ends = np.abs(shape.points[:, 0]) > 0.75
    assert clouds.adjusted_rand(truth[ends], found.labels[ends]) >= 0.9


def test_seeds_are_small_and_wide(arch):
    _, _, cloud = arch
    rows = seed_points(cloud, 0.05)
    assert len(rows) > 100
    assert (cloud.spoke_angles[rows] >= math.radians(90) - 1e-12).all()
    assert cloud.radii[rows].max() <= np.quantile(cloud.radii[cloud.valid], 0.3)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"seeds": "none"}, "No seed is left"),
        ({"search_radius": 0}, "search_radius"),
        ({"seeds": "some"}, "seeds must be one of"),
        ({"add": [10**7]}, "Picked samples"),
        ({"add": [0.5]}, "Picked samples"),
        ({"last_steps": -1}, "last_steps"),
    ],
)
def test_bad_options_are_refused(arch, options, words):
    _, _, cloud = arch
    with pytest.raises(medialis.InvalidOptionError, match=words):
        medialis.mean_shift_segments(cloud, **options)


def test_bad_clouds_are_refused(arch):
    _, _, cloud = arch
    with pytest.raises(medialis.InvalidShapeError, match="No valid inner ball"):
        medialis.mean_shift_segments(cloud.subset([]))
    with pytest.raises(medialis.InvalidOptionError, match="search_radius"):
        medialis.mean_shift(np.eye(3), search_radius=-1)
    with pytest.raises(medialis.InvalidShapeError):
        medialis.mean_shift(np.eye(2))


def test_the_exponential_is_that_of_the_library():
    """Our own gives the same bits on every processor, and on a GPU."""
    powers = -np.linspace(0.0, 2.0, 401)
    found = np.array([_exponential(power) for power in powers])
    assert np.abs(found / np.exp(powers) - 1.0).max() < 1e-14
    assert found[0] == 1.0 and (np.diff(found) < 0.0).all()
