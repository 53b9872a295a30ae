"""Thickness, the largest ball that touches or contains a sample: closed forms and search."""

import numpy as np
import pytest

import closed_forms as forms
import medialis
from medialis.base.box_tree import NearestTree
from medialis.base.threads import thread_limit
from medialis.walls.thickness import CHORDAL, COVERED, DEPTH, chord_heights
from necks import mesh_of, random_necks, true_thickness

QUIET = {"rib_ratio": 100.0}


def shape_of(parts, seed=0, **how):
    """The union of balls and rods, turned and moved; and the turn back to its axis."""
    rng = np.random.default_rng(seed)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    away = rng.normal(size=3) * 100.0
    mesh = mesh_of(parts, **how)
    shape = medialis.make_shape(mesh.points @ turn.T + away, mesh.faces, unit="mm")
    return shape, lambda points: (points - away) @ turn


def test_a_cube_is_as_thick_as_twice_the_distance_to_its_nearest_edge():
    """In the wedge at an edge the ball touches both faces at the distance of the sample."""
    shape = medialis.make_shape(*(lambda m: (m.points, m.faces))(forms.box_mesh((1, 1, 1), 9.0)))
    cloud = medialis.surface_skeleton(shape, refine=0.02)
    points = cloud.surface.points
    distance = np.sort(0.5 - np.abs(points), axis=1)[:, 1]
    values = medialis.thickness(cloud)
    inside = distance > 1e-9
    assert np.allclose(values[inside], 2 * distance[inside], rtol=0.01)
    # On an edge there is no ball: the value is that of the nearest sample.
    spacing = 2 * distance[inside].min()
    assert (values[~inside] <= 2 * spacing).all() and (values > 0).all()
    assert (medialis.thickness(cloud, kind="radius") == values / 2).all()


@pytest.mark.parametrize("seed", [0, 1, 3])
def test_it_is_the_largest_ball_of_the_cloud_that_covers_the_sample(seed):
    """Every ball against every sample; on facets between the least and the largest slack."""
    shape, _ = shape_of(random_necks(seed)[1], seed)
    cloud = medialis.surface_skeleton(shape, refine=0.04).own
    values = medialis.thickness(cloud)
    valid = cloud.valid
    surface = cloud.surface
    away = np.linalg.norm(surface.points[:, None] - cloud.centers[valid], axis=2)
    triangles = NearestTree.of_triangles(surface.points, surface.faces)
    room = triangles.distances(cloud.centers[valid])[0]
    radii = cloud.radii[valid]
    high = chord_heights(surface)[cloud.features[valid]].max(axis=1)
    radii = np.where(room < (1 - DEPTH) * radii - high, room, radii)  # balls that facets cut
    largest = [
        np.where(away <= radii * (1 + slack) * (1 + 1e-9), 2 * radii, 0.0).max(axis=1)
        for slack in (COVERED, CHORDAL)
    ]
    known = largest[0] > 0
    assert (values[known] >= largest[0][known] * (1 - 1e-9)).all()
    assert (values[known] <= largest[1][known] * (1 + 1e-9)).all()


@pytest.mark.slow
@pytest.mark.parametrize("kind", range(4), ids=["snowman", "dumbbell", "stud", "chain"])
def test_beside_necks_each_ball_and_each_rod_has_its_own_thickness(kind):
    """A snowman of 20 and 12 mm read 16.2 mm in the median, and 86 % of the large ball was wrong.

    Facets of 24 chords a half circle are off the sphere by 0.2 %; the narrow balls between two of
    them are far smaller, where no wider one covers the sample.
    """
    wrong, far_off = [], []
    for seed in range(kind, kind + 4 * 13, 4):
        name, parts = random_necks(seed)
        shape, back = shape_of(parts, seed)
        result = medialis.run("thickness", shape, refine=0.02)
        layer = next(one for one in result.layers if one.name == "samples")
        true = true_thickness(parts, back(layer.points + shape.offset - shape.offset))
        inside = true > 4 * result.values["spacing"]
        error = layer.attributes["thickness"][inside] / true[inside] - 1
        wrong.append((np.abs(error) > 0.01).mean())
        far_off.append((np.abs(error) > 0.1).mean())
        areas = result.shape.point_areas
        largest = 2 * max(part.radius for part in parts)
        assert result.values["thickness_max"] == pytest.approx(largest, rel=0.01), name
        half = np.argsort(layer.attributes["thickness"])
        middle = np.searchsorted(np.cumsum(areas[half]), 0.5 * areas.sum())
        median = layer.attributes["thickness"][half[middle]]
        assert result.values["thickness_median"] == pytest.approx(median)
    assert np.mean(wrong) < 0.15 and np.mean(far_off) < 0.02


@pytest.mark.slow
@pytest.mark.parametrize("group", range(4))
def test_a_maximum_fails_where_a_larger_ball_fits_inside(group):
    """36 of 50 runs passed, although a ball of 1.25 to 2 times the limit fits: 60 members here."""
    for seed in range(15 * group, 15 * group + 15):
        _, parts = random_necks(seed)
        shape, _ = shape_of(parts, seed, corners=16, around=32)
        largest = 2 * max(part.radius for part in parts)
        facets = np.cos(np.pi / 32)  # of the inscribed ball, 0.5 %
        ratio = np.random.default_rng(seed).choice([1.02, 1.25, 2.0])
        found = medialis.run(
            "wall_check", shape, maximum=f"{facets * largest / ratio}mm", refine=0.03, **QUIET
        ).values
        assert found["passed"] is False and found["too_thick"] >= 1, (seed, ratio)
        assert found["regions"][0]["value"] == pytest.approx(largest, rel=0.015), seed
        passes = medialis.run(
            "wall_check", shape, maximum=f"{1.011 * largest}mm", refine=0.03, **QUIET
        ).values
        assert passes["passed"] and passes["too_thick"] == 0, seed


def test_function_and_operations_have_the_same_field():
    shape = medialis.organic_shape(56)
    cloud = medialis.surface_skeleton(shape, refine=0.02, tolerance=3e-4)
    options = {"refine": 0.02, "tolerance": 3e-4}
    field = medialis.thickness(cloud)
    for name in ("thickness", "wall_check"):
        layer = medialis.run(name, shape, **options).layers[0]
        assert (layer.attributes["thickness"] == field[: shape.point_count]).all()
    walls = medialis.wall_thickness(cloud)[: shape.point_count]
    found = medialis.run("thickness", shape, **options).layers[0].attributes["wall_thickness"]
    assert (found == walls).all()


def test_the_median_does_not_change_with_the_density_of_samples():
    """By number of samples it went from 0.063 to 0.086 when a camel was remeshed."""
    fine = forms.mesh(*(lambda m: (m.points, m.faces))(forms.dumbbell(step=0.1)))
    points = fine.points
    one_end = points[fine.faces].mean(axis=1)[:, 2] > 1.0
    dense = medialis.make_shape(*_halved(points, fine.faces, one_end))
    even = medialis.make_shape(points, fine.faces)
    medians = [
        medialis.run("thickness", s, refine=0).values["thickness_median"] for s in (even, dense)
    ]
    assert medians[1] == pytest.approx(medians[0], rel=0.03)


def _halved(points, faces, chosen):
    """Cut the chosen faces in three at their middles."""
    middles = points[faces[chosen]].mean(axis=1)
    new = len(points) + np.arange(len(middles))
    a, b, c = faces[chosen].T
    fans = [np.stack([a, b, new], 1), np.stack([b, c, new], 1), np.stack([c, a, new], 1)]
    return np.concatenate([points, middles]), np.concatenate([faces[~chosen], *fans])


def test_threads_and_scale_change_nothing():
    shape = shape_of(random_necks(1)[1])[0]
    cloud = medialis.surface_skeleton(shape, refine=0.04)
    values = medialis.thickness(cloud)
    medialis.forget()
    with thread_limit(1):
        assert medialis.thickness(cloud).tobytes() == values.tobytes()
    twice = medialis.make_shape(2 * shape.points, shape.faces)
    other = medialis.thickness(medialis.surface_skeleton(twice, refine=0.04))
    assert np.allclose(other, 2 * values, rtol=1e-6)


def sheet(size=1.0, steps=8):
    """A flat square with one side: a surface that encloses nothing."""
    axis = np.linspace(0, size, steps + 1)
    x, y = np.meshgrid(axis, axis)
    points = np.stack([x.ravel(), y.ravel(), 0.02 * np.sin(3 * x.ravel())], axis=1)
    i = np.arange(steps * (steps + 1)).reshape(steps, -1)[:, :-1].ravel()
    faces = np.concatenate(
        [np.stack([i, i + 1, i + steps + 2], 1), np.stack([i, i + steps + 2, i + steps + 1], 1)]
    )
    return points, faces


def both(*meshes):
    starts = np.cumsum([0, *(len(points) for points, _ in meshes)])[:-1]
    return (
        np.concatenate([points for points, _ in meshes]),
        np.concatenate([f + start for (_, f), start in zip(meshes, starts, strict=True)]),
    )


def box(size, at):
    shape = forms.box_mesh(size, 9.0)
    return shape.points + np.asarray(at, float), np.asarray(shape.faces)


@pytest.mark.parametrize("limits", [{"minimum": "1mm"}, {"maximum": "1mm"}])
def test_a_surface_that_encloses_nothing_has_no_verdict(limits):
    """It passed, with a thickness of twice the size of the part."""
    bent = np.array([[0, 0, 0.0], [1, 0, 0], [1, 1, 0.3], [0, 1, 0.3], [0, 2, 0], [1, 2, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3], [3, 2, 5], [3, 5, 4]])
    for mesh in (sheet(), (bent, faces)):
        shape = medialis.make_shape(*mesh, unit="mm")
        try:
            result = medialis.run("wall_check", shape, **limits)
        except medialis.InvalidShapeError:
            continue  # no ball at all
        assert result.passed is None and result.values["checked_percent"] == 0.0
        assert "not_checked" in {m.code for m in result.messages}
        assert result.values["regions"] == []
        with pytest.raises(medialis.NotPassedError):
            result.require()


def test_a_verdict_says_how_much_of_the_surface_it_speaks_for():
    solid = box((2, 2, 1), (0, 0, 0))
    part = medialis.make_shape(*both(solid, (sheet(2.0)[0] + [9, 0, 0], sheet()[1])), unit="mm")
    found = medialis.run("wall_check", part, minimum="0.5mm", refine=0.02).values
    assert found["passed"] is None
    assert found["checked_percent"] == pytest.approx(80, abs=2)
    thin = medialis.run("wall_check", part, minimum="1.2mm", refine=0.02).values
    assert thin["passed"] is False and thin["too_thin"] == 1
    whole = medialis.make_shape(*solid, unit="mm")
    result = medialis.run("wall_check", whole, minimum="0.5mm", refine=0.02)
    assert result.passed and result.values["checked_percent"] == 100.0
