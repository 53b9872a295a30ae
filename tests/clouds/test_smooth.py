"""The operation smooth: noise goes, clean shapes stay, in every unit and place the same."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

import closed_forms
import medialis
from medialis.base.progress import Progress
from medialis.clouds._kernels import measure_flatness
from medialis.clouds.quadrics import on_quadrics, within_scatter
from medialis.clouds.smoothing import beside_surfaces, jitter

LEVEL = 0.003  # of the diagonal


@pytest.fixture(scope="module")
def clean():
    return medialis.organic_shape(80)


@pytest.fixture(scope="module")
def rough():
    """A sphere of radius 1 with radial noise."""
    ball = closed_forms.icosphere(4)
    step = 1 + np.random.default_rng(3).normal(size=(ball.point_count, 1)) * LEVEL * ball.diagonal
    return medialis.make_shape(ball.points * step, ball.faces)


def test_flatness_is_the_least_median_of_all_planes():
    """Planes that cannot be the flattest are told by counting: the same as sorting for each."""
    rng = np.random.default_rng(4)
    points = rng.normal(size=(60, 3)) * [1.0, 1.0, 0.1]
    near = np.argsort(np.linalg.norm(points[:, None] - points, axis=2), axis=1)[:, 1:21]
    triples = np.array([rng.choice(21, 3, replace=False) for _ in range(30)])
    found, radius = np.empty(60), np.empty(60)
    rows = np.arange(60)
    measure_flatness(points, near.astype(np.int32), rows, triples, found, radius)
    places = np.concatenate([points[:, None], points[near]], axis=1) - points[:, None]
    a, b, c = (places[:, triples[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    heights = (
        np.einsum("rtc,rpc->rtp", normals, places) - np.einsum("rtc,rtc->rt", normals, a)[..., None]
    )
    wanted = np.median(np.abs(heights), axis=2).min(axis=1)
    np.testing.assert_allclose(found, wanted, rtol=1e-9)


def test_the_noise_of_a_mesh_is_measured_and_goes(rough):
    """As much stays as `smooth_noise` says that its plate leaves: about a third."""
    result = medialis.run("smooth", rough)
    assert result.values["noise"] == pytest.approx(LEVEL * rough.diagonal, rel=0.15)
    layer = result.layers[0]
    before, after = (np.linalg.norm(points, axis=1) for points in (rough.points, layer.points))
    left = medialis.smooth_noise(rough, result.values["noise"])[1]
    assert np.std(after) == pytest.approx(left, rel=0.1) and left < np.std(before) / 2
    assert (layer.faces == rough.faces).all() and len(layer.points) == rough.point_count
    moved = np.linalg.norm(layer.points - rough.points, axis=1)
    assert np.array_equal(layer.attributes["moved"], moved)


@pytest.mark.slow
def test_the_noise_of_a_cloud_is_measured_and_goes():
    """Points of a sphere with radial noise of 0.01: half of it goes, and no point with it."""
    rng = np.random.default_rng(0)
    sphere = rng.normal(size=(6000, 3))
    sphere /= np.linalg.norm(sphere, axis=1, keepdims=True)
    cloud = medialis.Shape(sphere * (1 + 0.01 * rng.normal(size=(6000, 1))), sphere)
    result = medialis.run("smooth", cloud)
    assert result.values["noise"] == pytest.approx(0.01, rel=0.3)
    points = result.layers[0].points
    assert len(points) == 6000
    assert np.std(np.linalg.norm(points, axis=1)) < 0.5 * 0.01


@pytest.mark.slow
def test_clean_shapes_stay_as_they_are(clean):
    for shape in (clean, medialis.Shape(clean.points, clean.normals)):
        result = medialis.run("smooth", shape)
        assert [m.code for m in result.messages] == ["no_noise"]
        assert result.layers[0].points.tobytes() == shape.points.tobytes()


def test_points_that_coincide_stay_together():
    rng = np.random.default_rng(1)
    flat = np.c_[rng.uniform(size=(3000, 2)), 0.01 * rng.normal(size=3000)]
    points = np.concatenate([flat, flat[:500]])
    found = medialis.run("smooth", medialis.Shape(points, np.zeros_like(points)), noise=0.01)
    smooth = found.layers[0].points
    assert (smooth[:500] == smooth[3000:]).all() and found.values["moved_max"] > 0


def test_a_given_noise_is_a_length(rough):
    by_share = medialis.run("smooth", rough, noise=LEVEL)
    by_text = medialis.run("smooth", rough, noise=f"{LEVEL * rough.diagonal!r} units")
    assert by_text.values["noise"] == pytest.approx(by_share.values["noise"], rel=1e-12)
    with pytest.raises(medialis.InvalidOptionError, match="0 % to 10 %"):
        medialis.run("smooth", rough, noise="20%")


@pytest.mark.slow
def test_an_old_name_still_works_and_says_so(rough):
    assert medialis.operation("denoise") is medialis.operation("remove_outliers")
    result = medialis.run("denoise", rough)
    assert result.operation == "remove_outliers"
    assert any(message.code == "renamed_operation" for message in result.messages)


def test_triples_name_neighbours_that_are_there(monkeypatch):
    """A few dense points among scattered ones: their neighbourhoods are smaller than others."""
    from medialis.base.progress import Progress
    from medialis.clouds import _kernels as _smoothing_kernels
    from medialis.clouds import smoothing

    seen = []

    def look(beside, near, triples, *others):
        seen.append(near.shape[1])
        assert triples.max() <= near.shape[1] < len(beside)

    monkeypatch.setattr(_smoothing_kernels, "smooth_positions", look)
    rng = np.random.default_rng(5)
    around = rng.normal(size=(30, 3))
    around *= 3 / np.linalg.norm(around, axis=1, keepdims=True)
    points = np.concatenate([1e-3 * rng.normal(size=(30, 3)), around])
    smoothing.without_jitter(points, np.arange(60), 1.0, Progress())
    assert seen == [29, 29]


@pytest.mark.parametrize("count", [1, 2, 3])
def test_fewer_points_than_name_a_plane_stay(count):
    from medialis.base.progress import Progress
    from medialis.clouds.smoothing import without_jitter

    points = np.eye(3)[:count]
    moved = without_jitter(points, np.arange(count), 10.0, Progress())
    assert np.isfinite(moved).all() and moved.shape == (count, 3)


def plain_quadrics(points, count=30):
    """Moving least squares without any of ours: the quadric of each point's nearest neighbours."""
    near = points[cKDTree(points).query(points, count)[1]]
    spokes = near - near.mean(axis=1, keepdims=True)
    axes = np.linalg.eigh(np.einsum("rki,rkj->rij", spokes, spokes))[1]
    w, u, v = np.moveaxis((near - points[:, None]) @ axes, 2, 0)
    form = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=2)
    square = u**2 + v**2
    weight = np.exp(-2 * square / square.max(axis=1, keepdims=True))[:, :, None]
    matrix = np.einsum("rka,rkb->rab", weight * form, form)
    right = np.einsum("rka,rk->ra", weight * form, w)
    return points + np.linalg.solve(matrix, right[:, :, None])[:, 0] * axes[:, :, 0]


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.01, 0.04])
def test_round_clouds_keep_their_volume(noise):
    """Points of a sphere: less than .6 of the noise is left, less than plain quadrics leave."""
    rng = np.random.default_rng(0)
    sphere = rng.normal(size=(4000, 3))
    sphere *= (1 + noise * rng.normal(size=(4000, 1))) / np.linalg.norm(sphere, axis=1)[:, None]
    smooth = on_quadrics(sphere, noise, Progress())
    off, plain = (np.linalg.norm(one, axis=1) - 1 for one in (smooth, plain_quadrics(sphere)))
    assert abs(off.mean()) < 0.1 * noise
    assert np.sqrt(np.mean(off**2)) < min(0.6 * noise, np.sqrt(np.mean(plain**2)))


@pytest.mark.slow
def test_two_surfaces_that_cross_stay_two():
    """Points 3 deviations from the line where planes cross lie on one of them after smoothing."""
    rng, noise = np.random.default_rng(1), 0.01
    across, along = rng.uniform(-1, 1, (2, 8000))
    off = noise * rng.normal(size=8000)
    half = np.arange(8000) < 4000
    points = np.column_stack([np.where(half, across, off), along, np.where(half, off, across)])
    smooth = on_quadrics(points, noise, Progress())
    far = np.abs(across) > 5 * noise
    left = np.where(half, smooth[:, 2], smooth[:, 0])[far]
    assert np.median(np.abs(left)) < 0.4 * noise
    assert (np.abs(left) < 3 * noise).mean() > 0.98


@pytest.mark.slow
def test_the_scatter_of_a_dense_cloud_is_measured():
    """All of the 182 nearest of a point lie within the scatter: fewer points tell it (was 0)."""
    rng, noise = np.random.default_rng(2), 0.06
    sphere = rng.normal(size=(80_000, 3))
    sphere *= (1 + noise * rng.normal(size=(80_000, 1))) / np.linalg.norm(sphere, axis=1)[:, None]
    assert jitter(sphere) == pytest.approx(noise, rel=0.15)
    clean = sphere / np.linalg.norm(sphere, axis=1, keepdims=True)
    assert jitter(clean) == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 2])
def test_the_scatter_of_a_square_at_the_limit_of_discs_is_measured(seed):
    """Half of its groups of neighbourhoods were no discs, so it was called clean."""
    rng = np.random.default_rng(seed)
    square = np.column_stack([rng.uniform(-1, 1, (20000, 2)), np.zeros(20000)])
    level = 0.01 * np.linalg.norm(np.ptp(square, axis=0))
    found = jitter(square + level * rng.normal(size=square.shape))
    assert found == pytest.approx(level, rel=0.1)


def test_tails_of_the_scatter_are_of_the_surface_and_what_lies_beyond_its_rim_is_not():
    """Of a square with noise s: points up to 3 s off it stay where they lie over it."""
    rng = np.random.default_rng(0)
    points = rng.uniform(-1, 1, (3000, 3)) * [1, 1, 0]
    points[:, 2] = np.clip(0.02 * rng.normal(size=3000), -0.04, 0.04)
    asked = np.array([[0.2, 0.1, 0.05], [-0.3, 0.4, 0.075], [1.4, 0.0, 0.0], [0.5, 0.5, 0.3]])
    noise = np.arange(3004) >= 3000
    told = within_scatter(np.concatenate([points, asked]), noise, 0.02, Progress())
    assert not told[:3000].any() and told[3000:].tolist() == [True, False, False, False]


def test_outliers_that_fill_a_volume_are_told_from_a_surface_as_dense_once_it_is_thinned():
    """40,000 points on a square with noise s, and 4,000 in a box: 2.5 s apart."""
    rng = np.random.default_rng(0)
    points = rng.uniform(-1, 1, (44000, 3))
    points[:40000, 2] = 0.05 * rng.normal(size=40000)
    chosen = np.concatenate([np.arange(0, 40000, 40), np.arange(40000, 44000)])
    told = beside_surfaces(points, chosen, 0.05, Progress())
    high = np.abs(points[chosen, 2])
    inside = (np.abs(points[chosen]) < 0.5).all(axis=1)  # most of the ball of 12 s is in the box
    assert told[(high > 0.3) & inside].mean() > 0.95 and not told[:1000][high[:1000] < 0.1].any()
    # Along edges of the box their number grows as on a surface; a quarter was told.
    edges = (np.abs(points[chosen]) > 0.85).sum(axis=1) >= 2
    assert told[(high > 0.3) & edges].mean() > 0.6
