"""Bodies far from each other, thousands of pieces, faces without an area: no fault in any."""

import random

import numpy as np
import pytest

import medialis
from fuzz.nasty_shapes import grid_box, merged, nasty_mesh, sphere
from fuzz.shape_operations import check_result
from medialis.segments.sites import MOST_SITES, SITES, all_placements

OPERATIONS = (
    "thickness", "curve_skeleton", "parts", "medial_mesh", "midsurface", "wall_check", "armature",
    "skeleton_mesh",
)  # fmt: skip


def box_and_ball(distance):
    """A unit box, and a ball of radius 0.1 so far away."""
    points, faces = sphere(12)
    return medialis.make_shape(*merged(grid_box(4), (0.1 * points + [distance, 0, 0], faces)))


def attempt(operation, shape, **options):
    """Run; a sentence is as good as a result, of which no number is infinite and no ball huge."""
    try:
        result = medialis.run(operation, shape, threads=1, **options)
    except medialis.MedialisError as error:
        assert str(error).strip()
        return None
    check_result(result)
    for layer in result.layers:
        if (radius := layer.attributes.get("radius", np.empty(0))).size:
            assert np.nanmax(radius) <= shape.diagonal
    return result


@pytest.mark.slow
@pytest.mark.parametrize("distance", [1e3, 1e6, 1e9])
@pytest.mark.parametrize("operation", [name for name in OPERATIONS if name != "medial_mesh"])
def test_bodies_far_apart(operation, distance):
    attempt(operation, box_and_ball(distance))


@pytest.mark.slow
def test_a_body_without_balls_is_told():
    """At 1e6 a medial mesh corrupted memory: a body without balls was given some (fixed)."""
    attempt("medial_mesh", box_and_ball(1e3))
    result = attempt("medial_mesh", box_and_ball(1e6))
    told = {message.code: message for message in result.messages}
    assert told["parts_without_balls"].data == {"lost": 1, "parts": 2}
    with pytest.raises(medialis.InvalidShapeError, match=r"No ball lies inside|Nothing of the"):
        medialis.run("medial_mesh", box_and_ball(1e8))


@pytest.mark.slow
def test_pieces_far_apart_have_as_many_sites_as_can_be_looked_at():
    """Each had its own, so that 3,000 triangles took more than 150 s (fixed)."""
    side = np.arange(15.0)
    places = np.stack(np.meshgrid(side, side, side[:9], indexing="ij"), axis=-1).reshape(-1, 1, 3)
    corners = places + np.array([[0, 0, 0], [0.4, 0, 0], [0, 0.4, 0.1]])
    faces = np.arange(corners.size // 3).reshape(-1, 3)
    shape = medialis.make_shape(corners.reshape(-1, 3), faces)
    assert len(faces) == 2025
    cloud = medialis.shrink_balls(shape)
    (sites,) = all_placements(cloud, placements=1)
    assert SITES / 2 < len(sites) <= MOST_SITES * SITES
    found = medialis.parts(cloud)
    assert found.count == len(faces) and len(found.joins) == 0
    assert (np.bincount(found.labels) == 3).all() and found.labels.min() == 0


@pytest.mark.parametrize("number", range(6))
@pytest.mark.parametrize("operation", ["wall_check", "thickness"])
def test_faces_without_an_area_are_no_trouble_without_repair(operation, number):
    """Division by zero, also where nothing lies between walls (fixed)."""
    points, faces = grid_box(2)
    more = [[0, 0, 1], [5, 5, 5], [0, 1, 0], [0, 1, 2], faces[0], faces[0][::-1]][number]
    faces = np.concatenate([faces, np.array([more], np.int32)])
    attempt(operation, medialis.make_shape(points, faces), refine=0.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "operation", "repair"),
    [(2, "medial_mesh", True), (14, "wall_check", True), (21, "midsurface", True),
     (1001, "wall_check", True), (1012, "wall_check", False)],
)  # fmt: skip
def test_what_the_fuzzers_found(number, operation, repair):
    """A ball of 5 diagonals, planes that never meet, no moments left, no place between walls."""
    points, faces, _ = nasty_mesh(random.Random(f"38:nasty:{number}"))
    attempt(operation, medialis.make_shape(points, faces, repair=repair))
