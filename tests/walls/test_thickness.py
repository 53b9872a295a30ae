"""Wall thickness against closed forms, invariances, real shapes.

For thickness see `test_largest_balls.py`.
"""

import math

import numpy as np
import pytest

import closed_forms as forms
from medialis.base.errors import InvalidOptionError, InvalidShapeError
from medialis.base.threads import thread_limit
from medialis.shape.generate import organic_shape
from medialis.shape.reading import read_shape
from medialis.shape.shape import Shape
from medialis.skeleton.medial_cloud import DEFAULT_TOLERANCE, shrink_balls
from medialis.walls.thickness import WALL_ANGLE, wall_thickness


def measured(shape, **options):
    return wall_thickness(shrink_balls(shape), **options)


def slack(shape, wall, lateral):
    """Bound of diameter - wall between parallel walls sampled `lateral` off the true contact.

    r_a(q) = (e^2 + H^2 - a^2) / (2 (H - a)) for a sample q across the wall H, off by e, with
    a < T (tolerance times diagonal): 2 r <= (H + e^2/H) / (1 - T/H).
    """
    t = DEFAULT_TOLERANCE * shape.diagonal
    return (wall + lateral**2 / wall) / (1 - t / wall) - wall


@pytest.fixture(scope="module")
def creature():
    shape = organic_shape(56)
    return shape, shrink_balls(shape)


def test_a_plate_is_as_thick_as_it_is_high_up_to_its_rim_and_on_it():
    """Without the angle, the edges of the plate are 0 thick: what a wall check must not say.

    The triangles are right-angled with edges up to h, so no point is further than h/sqrt(2) from a
    sample. A ball that passes the angle touches the far side: never less than the height.
    """
    height, h = 0.3, 0.05
    shape = forms.box_mesh((2.0, 1.5, height), h)
    values = measured(shape)
    assert (values >= height * (1 - 1e-9)).all()
    assert values.max() <= height + slack(shape, height, h / math.sqrt(2))
    raw = measured(shape, min_spoke_angle=0.0)
    assert raw.min() < 2 * h and raw.max() <= height + slack(shape, height, h / math.sqrt(2))


def test_a_cube_has_no_wall_and_gets_its_inscribed_ball_everywhere():
    """All its balls have a spoke angle of 90 degrees, but for the middle of a face.

    The sample nearest to the middle of a face is at most h/sqrt(2) off; its ball has the radius of
    its distance to the nearest side, at least 1/2 - h/sqrt(2).
    """
    h = 0.1
    shape = forms.box_mesh((1.0, 1.0, 1.0), h)
    for angle in (WALL_ANGLE, 180.0):
        values = measured(shape, min_spoke_angle=angle)
        assert values.min() >= 1 - math.sqrt(2) * h
        assert values.max() <= 1 + slack(shape, 1.0, h / math.sqrt(2))


def test_sphere_and_capsule_are_as_thick_as_their_diameter():
    """The cap of a capsule has balls with spoke angles down to 90 degrees: left out, filled in.

    At every sample whose ball is judged, the radius is right up to the sampling (`excess`); all
    values are those of balls or lie between them.
    """
    for form in (forms.sphere(2000), forms.capsule(4000)):
        values = measured(form.shape)
        true = 2 * form.radii[0]
        bound = 2 * form.excess(DEFAULT_TOLERANCE)
        cloud = shrink_balls(form.shape)
        rows = cloud.wall_angles >= math.radians(WALL_ANGLE)
        assert np.isfinite(bound[rows]).mean() > 0.9
        assert (values >= true * (1 - 1e-9)).all()
        own = rows & np.isfinite(bound)
        assert (values[own] <= true + bound[own]).all()
        assert values.max() <= true + bound[own].max()


def test_an_ellipsoid_has_the_closed_form_where_it_is_a_wall():
    form = forms.ellipsoid(4000, (1.0, 0.8, 0.3))
    cloud = shrink_balls(form.shape)
    values, bound = wall_thickness(cloud), 2 * form.excess(DEFAULT_TOLERANCE)
    wall = cloud.wall_angles >= math.radians(WALL_ANGLE)
    assert 0.3 < wall.mean() < 0.9
    error = values - 2 * form.radii
    assert (error[wall] >= -1e-9).all() and (error[wall] <= bound[wall]).all()
    assert values.min() >= values[wall].min() and values.max() <= values[wall].max()
    assert (wall_thickness(cloud, kind="radius") == values / 2).all()


def test_a_hollow_sphere_is_as_thick_as_its_wall():
    """Both spheres have their samples on the same rays, so contacts are met exactly."""
    outer, wall = forms.icosphere(4), 0.2
    n = outer.point_count
    shape = Shape(
        np.concatenate([outer.points, (1 - wall) * outer.points]),
        np.concatenate([outer.points, -outer.points]),
        np.concatenate([outer.faces, outer.faces[:, ::-1] + n]),
    )
    values = measured(shape)
    assert (values >= wall * (1 - 1e-9)).all()
    assert values.max() <= wall + slack(shape, wall, 0.0)


def test_zero_angle_gives_the_ball_of_every_sample(creature):
    shape, cloud = creature
    values = wall_thickness(cloud, min_spoke_angle=0.0)
    own = np.full(shape.point_count, np.nan)
    own[cloud.source] = 2 * cloud.radii
    assert (values[cloud.source[cloud.valid]] == own[cloud.source[cloud.valid]]).all()


def test_parts_without_reliable_balls():
    """A cube beside a plate has its inscribed ball, a lone triangle what is nearest."""
    plate, cube = forms.box_mesh((2.0, 1.5, 0.3), 0.1), forms.box_mesh((0.6, 0.6, 0.6), 0.1)
    sheet = np.array([[0, 0, 9], [1, 0, 9], [0, 1, 9.0]])
    points = np.concatenate([plate.points, cube.points + np.array([0, 0, 2]), sheet])
    n, m = plate.point_count, plate.point_count + cube.point_count
    shape = forms.mesh(points, np.concatenate([plate.faces, cube.faces + n, [[m, m + 2, m + 1]]]))
    values = measured(shape)
    lateral = 0.1 / math.sqrt(2)
    assert values[:n].max() <= 0.3 + slack(shape, 0.3, lateral)
    assert values[n:m].min() >= 0.6 - math.sqrt(2) * 0.1
    assert values[n:m].max() <= 0.6 + slack(shape, 0.6, lateral)
    assert np.isin(values[m:], values[n:m]).all()


def test_motion_scale_order_and_threads(creature):
    """Scaling by a power of two and threads change no digit. Turning rounds coordinates by eps:
    the radius (num/den with den down to r^2 1e-4) keeps 1e-9; another order changes sums only."""
    shape, cloud = creature
    values = wall_thickness(cloud)
    assert (measured(Shape(4 * shape.points, shape.normals, shape.faces)) == 4 * values).all()
    with thread_limit(1):
        assert measured(shape).tobytes() == values.tobytes()
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    cloud = shrink_balls(shape, tolerance=0)  # the tolerance scales with the (turned) box
    turned = Shape(shape.points @ turn.T, shape.normals @ turn.T, shape.faces)
    other = wall_thickness(shrink_balls(turned, tolerance=0))
    assert np.quantile(np.abs(other / wall_thickness(cloud) - 1), 0.99) < 1e-6
    place = np.random.default_rng(1).permutation(shape.point_count)
    new = np.argsort(place)
    mixed = Shape(shape.points[place], shape.normals[place], new[shape.faces][::-1])
    assert np.allclose(measured(mixed), values[place], rtol=1e-6)


@pytest.mark.parametrize("name", ["cow", "spider", "face", "scapula", "kitten_points"])
def test_real_shapes_are_complete(name, real_shapes):
    """Open, non-manifold, of many parts, and a cloud."""
    path = real_shapes / f"{name}.ply"
    shape = read_shape(path)
    cloud = shrink_balls(shape)
    inputs = cloud.radii.copy(), shape.points.copy()
    values = wall_thickness(cloud)
    assert np.isfinite(values).all() and (values > 0).all()
    # Balls of an open surface may be larger than what encloses them, but not than allowed.
    assert values.max() <= 2 * shape.diagonal
    assert (cloud.radii == inputs[0])[cloud.valid].all() and (shape.points == inputs[1]).all()


def test_bad_input(creature):
    shape, cloud = creature
    with pytest.raises(InvalidOptionError, match="kind must be one of diameter, radius"):
        wall_thickness(cloud, kind="width")
    with pytest.raises(InvalidOptionError, match="min_spoke_angle"):
        wall_thickness(cloud, min_spoke_angle=181)
    with pytest.raises(InvalidShapeError, match="No inner ball"):
        wall_thickness(shrink_balls(shape, side="outer"))
    with pytest.raises(InvalidShapeError, match="No inner ball"):
        wall_thickness(cloud.subset([]))
