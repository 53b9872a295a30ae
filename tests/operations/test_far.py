"""Shapes far from the origin, in results that lose nothing there."""

from dataclasses import dataclass

import numpy as np
import pytest

import closed_forms as forms
import medialis
from medialis.base.options import Options
from medialis.base.validation import BallRows, Directions, FloatArray, Measures, Positions
from medialis.operations import registry
from medialis.operations.declaration import Operation
from medialis.operations.positions import balls, near_origin, numbers, offset_of, place, places
from medialis.operations.result import Layer, Outcome
from plates import with_walls

FAR = np.array([3.0e7, -5.0e6, 0.0])

PLACED = {"points", "centers", "nodes", "heads", "tails", "y_points", "view_points"} | {
    "midsurface_points"
}
"""Arrays of results that hold positions."""


def on_a_grid(shape):
    """The shape with coordinates that stay the same when it is moved far and back."""
    step = 2.0**-20
    points = np.round(shape.points / step) * step
    return medialis.make_shape(points, shape.faces)


@pytest.mark.slow
@pytest.mark.parametrize("operation", medialis.OPERATIONS, ids=lambda one: one.name)
def test_a_shape_far_away_has_the_same_result_there(operation):
    """Six digits were left of a part in metres of a map: balls lost half of them (mended)."""
    near = on_a_grid(with_walls(operation.name, medialis.organic_shape(60)))
    far = medialis.make_shape(near.points + FAR, near.faces)
    np.testing.assert_array_equal(far.points - FAR, near.points)
    options = {"pairs": 3, "size": 64} if operation.name == "view_curve_skeleton" else {}
    offset = offset_of(far)
    # The same normals: those of the far shape were made from the same differences.
    expected = medialis.run(operation.name, near_origin(far), **options)
    result = medialis.run(operation.name, far, **options)
    assert [str(m) for m in result.messages] == [str(m) for m in expected.messages]
    assert result.arrays.keys() == expected.arrays.keys()
    for name, array in result.arrays.items():
        known = expected.arrays[name]
        known = known + offset if name in PLACED else known
        np.testing.assert_array_equal(array, known, err_msg=name)
    low, high = far.bounds
    for layer in result.layers:
        assert (layer.points > low - 2 * far.diagonal).all(), layer.name
        assert (layer.points < high + 2 * far.diagonal).all(), layer.name
    np.testing.assert_array_equal(result.shape.points[: len(far.points)], far.points)


@pytest.mark.slow
def test_every_place_in_values_is_moved():
    shape = on_a_grid(medialis.organic_shape(60))
    far = medialis.make_shape(shape.points + FAR, shape.faces)
    spots = medialis.run("thickness", far).values["spots"]
    bones = medialis.run("armature", far).values["bone_table"]
    places = [spot["position"] for spot in spots] + [bone["head"] for bone in bones]
    low, high = far.bounds
    assert ((np.array(places) >= low) & (np.array(places) <= high)).all()


def test_near_shapes_are_not_moved():
    assert not offset_of(medialis.organic_shape(60)).any()


def test_a_vertex_turned_inside_out_far_away_ends(monkeypatch):
    """Balls shrank for ever: their smallest change was below the rounding of the coordinates."""
    sphere = forms.sphere(400).shape if hasattr(forms, "sphere") else medialis.organic_shape(60)
    points = np.array(sphere.points)
    points[7] *= -0.5
    for away in (0.0, 3e6, 1e9):
        shape = medialis.make_shape(points + np.array([away, 0, away]), sphere.faces)
        cloud = medialis.surface_skeleton(shape, refine=0.0, denoise="off")
        assert len(cloud) == len(points)


@dataclass(frozen=True)
class Crate:
    """A type of a contributor's own, with fields of names that nobody has heard of."""

    lids: Positions
    bungs: BallRows
    grain: Directions
    staves: Measures
    hoops: tuple[Positions, ...] = ()


@dataclass(frozen=True)
class Loose:
    """One whose field says nothing."""

    lids: FloatArray


@pytest.fixture
def made_up(monkeypatch):
    """Register an operation with a function, as a contributor's file does."""

    def register(outcome):
        added = Operation(
            name="crates", filter_name="generate_crates", label="Crates", group="Inspect",
            help="Find crates.", options=Options,
            run=lambda shape, options, progress: outcome(shape),
        )  # fmt: skip
        monkeypatch.setattr(registry, "operation", lambda name: added)

    return register


def crates(shape):
    """Positions wherever an outcome can hold them, under made-up names."""
    spot, rows = shape.points[7], shape.points[:5]
    tanks = np.column_stack([rows, np.arange(5.0)])
    return Outcome(
        shape=shape,
        layers=(
            Layer("crates", rows, attributes={
                "other_end": places(rows + 1.0), "grain": numbers(shape.normals[:5]),
            }),
        ),
        values={
            "narrowest": place(spot),
            "extent": numbers([1.0, 2.0, 3.0]),
            "ends": places(rows[:2]),
            "slopes": numbers(shape.normals[:2]),
            "table": [{"deep": {"down": place(spot)}, "none": None, "counts": [1, 2, 3]}],
        },
        arrays={"bungs": balls(tanks), "knots": places(rows), "slant": numbers(shape.normals[:5])},
        extras={"crate": Crate(rows, tanks, shape.normals[:5], tanks, (rows, rows[:2]))},
    )  # fmt: skip


def test_positions_are_put_back_wherever_they_stand_and_whatever_they_are_called(made_up):
    """A new operation with ``values={"narrowest": xyz}`` came back 500 km off (mended)."""
    near = on_a_grid(medialis.organic_shape(60))
    far = medialis.make_shape(near.points + FAR, near.faces)
    made_up(crates)
    result = medialis.run("crates", far)
    rows, spot = far.points[:5], far.points[7].tolist()
    tanks = np.column_stack([rows, np.arange(5.0)])
    assert result.values["narrowest"] == result.values["table"][0]["deep"]["down"] == spot
    assert result.values["extent"] == [1.0, 2.0, 3.0]
    assert result.values["ends"] == rows[:2].tolist()
    assert result.values["slopes"] == far.normals[:2].tolist()
    assert result.values["table"][0]["counts"] == [1, 2, 3]
    np.testing.assert_array_equal(result.arrays["bungs"], tanks)
    np.testing.assert_array_equal(result.arrays["knots"], rows)
    np.testing.assert_array_equal(result.arrays["slant"], far.normals[:5])
    (layer,) = result.layers
    np.testing.assert_array_equal(layer.points, rows)
    np.testing.assert_array_equal(layer.attributes["grain"], far.normals[:5])
    assert (abs(layer.attributes["other_end"] - rows - 1.0) < 1e-8).all()
    crate = result.extras["crate"]
    np.testing.assert_array_equal(crate.lids, rows)
    np.testing.assert_array_equal(crate.bungs, tanks)
    np.testing.assert_array_equal(np.concatenate(crate.hoops), np.concatenate([rows, rows[:2]]))
    np.testing.assert_array_equal(crate.grain, far.normals[:5])
    np.testing.assert_array_equal(crate.staves[:, 3], np.arange(5.0))
    for held in (*result.arrays.values(), *layer.attributes.values()):
        assert type(held) is np.ndarray
    assert type(result.values["narrowest"]) is list


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changed", "place_named"),
    [
        (lambda x: {"arrays": {"knots": x.points}}, "'knots'"),
        (lambda x: {"arrays": {"two": x.points[:, :2]}}, "'two'"),
        (lambda x: {"values": {"narrowest": x.points[0].tolist()}}, "'narrowest'"),
        (lambda x: {"values": {"narrowest": x.points[0]}}, "'narrowest'"),
        (lambda x: {"values": {"narrowest": tuple(x.points[0])}}, "'narrowest'"),
        (lambda x: {"values": {"ends": x.points[:2]}}, "'ends'"),
        (lambda x: {"values": {"areas": [0.5, 0.25]}}, "'areas'"),
        (lambda x: {"values": {"rows": [{"at": x.points[0].tolist()}]}}, "'at'"),
        (lambda x: {"extras": {"crate": Loose(x.points)}}, "lids of Loose"),
        (lambda x: {"layers": (Layer("a", x.points, attributes={"end": x.points}),)}, "'end'"),
    ],
)
def test_positions_that_are_not_told_are_refused_at_the_first_run(made_up, changed, place_named):
    """Also of a shape near the origin, where forgetting would change nothing."""
    made_up(lambda shape: Outcome(shape=shape, **changed(shape)))
    with pytest.raises(medialis.MedialisError, match=f"{place_named}.*places|{place_named}.*place"):
        medialis.run("crates", medialis.organic_shape(56))
