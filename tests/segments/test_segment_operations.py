"""Operations of the group Segment: layers, files of seeds, bad input."""

import numpy as np
import pytest

import clouds
import medialis
from medialis.operations.positions import near_origin
from medialis.skeleton.layers import vertices_in_file


@pytest.fixture(scope="module")
def noisy():
    points = clouds.with_outliers(clouds.crossing_planes(90, n=2000)[0], 0.3)
    return medialis.Shape(points, np.zeros_like(points))


@pytest.fixture(scope="module")
def arch():
    return medialis.dental_arch(resolution=100)


@pytest.mark.slow
def test_manifolds_lie_on_the_input(noisy):
    result = medialis.run("manifolds", noisy)
    layer = result.layers[0]
    assert layer.on_input and layer.labels == ("manifold",)
    assert result.values["manifolds"] == 2 == layer.attributes["manifold"].max() + 1
    assert result.values["noise_points"] == (layer.attributes["point_class"] == 0).sum()
    assert result.arrays["membership_offsets"][-1] == len(result.arrays["membership_manifolds"])


@pytest.mark.slow
def test_removing_outliers_keeps_points_where_they_are(noisy):
    result = medialis.run("remove_outliers", noisy)
    clean, noise = result.layers
    assert (clean.points == noisy.points[clean.attributes["source"]]).all()
    assert len(clean.points) + (noise.attributes["noise"] == 0).sum() == noisy.point_count
    recall, precision = clouds.noise_scores(-1 - noise.attributes["noise"], 4000)
    assert recall >= 0.9 and precision >= 0.9


@pytest.mark.slow
def test_clean_clouds_of_many_kinds_stay():
    for name, points in clouds.clean_clouds().items():
        kept = medialis.run("remove_outliers", medialis.make_shape(points)).arrays["kept"]
        assert kept.mean() >= 0.97, name


@pytest.mark.slow
def test_a_clean_cloud_keeps_its_tips_and_says_what_goes():
    """Two cones of 1500 points: tips and rim lie on no smooth patch, but are no outliers."""
    rng = np.random.default_rng(0)
    share, turn = np.sqrt(rng.uniform(0, 1, 3000)), rng.uniform(0, 2 * np.pi, 3000)
    up = np.where(np.arange(3000) < 1500, 1.0, -1.0) * (1 - share)
    cones = np.stack([0.3 * share * np.cos(turn), 0.3 * share * np.sin(turn), up], axis=1)
    clean = medialis.run("remove_outliers", medialis.Shape(cones, np.zeros_like(cones)))
    assert clean.arrays["kept"].mean() >= 0.97
    far = np.concatenate([cones, [[0, 0, 9.0]]])
    result = medialis.run("remove_outliers", medialis.Shape(far, np.zeros_like(far)))
    assert not result.arrays["kept"][-1]
    (told,) = [m for m in result.messages if m.code == "noise_removed"]
    assert told.data["points"] == (~result.arrays["kept"]).sum()
    assert told.data["points"] == told.data["no_patch"] + told.data["small_pieces"]
    share = 100 * (~result.arrays["kept"]).mean()
    assert result.values["removed_percent"] == pytest.approx(share, rel=1e-12)


@pytest.mark.slow
def test_manifolds_of_a_skeleton_of_a_box():
    """The medial sheets of a box are 13 flat pieces: 12 at the edges and the one in the middle.

    They are off the plane by what a contact off by half a spacing (0.012) changes: some 1e-3.
    """
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1.3) for z in (0, 0.7)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    box = medialis.make_shape(corners, faces)
    result = medialis.run("manifolds", box, cloud="skeleton", tolerance=0.0)
    assert not result.layers[0].on_input
    layer = result.layers[0]
    for sheet in range(13):
        points = layer.points[layer.attributes["manifold"] == sheet]
        assert len(points) > 500
        away = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[-1]
        assert away / np.sqrt(len(points)) < 1e-3
    assert sum(result.values["largest"][:13]) > 0.5 * result.values["points"]
    assert result.values["noise_percent"] < 5


@pytest.mark.slow
def test_seeds_from_files(arch, tmp_path):
    shape, teeth = arch
    tips = [
        int(np.flatnonzero(teeth == t)[shape.points[teeth == t, 2].argmax()]) for t in (0, 5, 9)
    ]
    numbers, places = tmp_path / "numbers.txt", tmp_path / "places.txt"
    numbers.write_text("# tips\n" + "\n".join(map(str, tips)), encoding="utf-8")
    rows = [", ".join(map(str, shape.points[t] + 1e-6)) for t in tips]
    places.write_text("\n".join(rows), encoding="utf-8")
    picked = {"seeds": "none", "search_radius": 0.04}
    results = [
        medialis.run("mean_shift_segments", shape, **picked, add_seeds=str(path))
        for path in (numbers, places)
    ]
    first, second = (r.layers[0].attributes["segment"] for r in results)
    assert results[0].values["segments"] == 3 and (first == second).all()
    assert len({int(first[t]) for t in tips}) == 3
    one = tmp_path / "one.txt"
    one.write_text(str(tips[0]), encoding="utf-8")
    fewer = medialis.run(
        "mean_shift_segments", shape, **picked, add_seeds=str(numbers), remove_seeds=str(one),
    )  # fmt: skip
    assert fewer.values["segments"] == 2


def test_places_of_seeds_far_from_the_origin_are_those_of_the_file(tmp_path):
    """The shape is computed near the origin: all seeds were the vertex that lay nearest to it."""
    shape, away = medialis.organic_shape(56), np.array([3e7, -5e6, 0.0])
    near = near_origin(medialis.make_shape(shape.points + away, shape.faces))
    places = (shape.points[[5, 900]] + away).tolist()
    picked = tmp_path / "seeds.txt"
    picked.write_text("".join(f"{x!r} {y!r} {z!r}\n" for x, y, z in places))
    assert vertices_in_file(str(picked), near, "no seed").tolist() == [5, 900]


@pytest.mark.parametrize(
    ("text", "words"),
    [("1 2\n", "Line 1"), ("x\n", "Line 1"), ("# none\n", "holds no"), ("99999999\n", "numbered"),
     ("nan 0 0\n", "finite")],
)  # fmt: skip
def test_bad_files_of_seeds_are_refused(arch, tmp_path, text, words):
    path = tmp_path / "seeds.txt"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(medialis.InvalidOptionError, match=words):
        medialis.run("mean_shift_segments", arch[0], add_seeds=str(path))


def test_missing_files_of_seeds_are_refused(arch, tmp_path):
    with pytest.raises(medialis.FileError, match="there is no such file"):
        medialis.run("mean_shift_segments", arch[0], add_seeds=str(tmp_path / "none.txt"))


def test_few_points_and_a_volume_stay():
    """They were refused: "nothing is left" (fixed). No surface and no distance tells outliers."""
    rng = np.random.default_rng(0)
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    for points in (corners, rng.uniform(size=(500, 3)), corners[:1], np.ones((40, 3))):
        result = medialis.run("remove_outliers", medialis.Shape(points, 0 * points), max_bend=5.0)
        assert result.arrays["kept"].all() and result.values["removed_percent"] == 0.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("operation", "code"), [("manifolds", "mostly_noise"), ("remove_outliers", "by_distances")]
)
def test_a_cloud_of_mostly_noise_is_doubted(noisy, operation, code):
    """Most vertices of a coarse mesh were called noise without a word."""
    plane = noisy.points[:300] * [0.01, 0.01, 0.0]
    apart = np.random.default_rng(0).uniform(-1, 1, (900, 3))
    both = np.concatenate([plane, apart])
    progress = medialis.Progress()
    medialis.run(operation, medialis.Shape(both, 0 * both), max_bend=5.0, progress=progress)
    assert code in [message.code for message in progress.messages]
    clean = medialis.Progress()
    medialis.run(operation, noisy, progress=clean)
    assert code not in [message.code for message in clean.messages]
