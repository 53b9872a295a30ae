"""The door for input: what passes comes out in one form, everything else is one sentence."""

import math

import numpy as np
import pytest

from medialis.base.errors import InvalidOptionError, InvalidShapeError, MedialisError
from medialis.base.validation import (
    as_choice,
    as_faces,
    as_field,
    as_normals,
    as_number,
    as_points,
    as_whole_number,
    frozen,
    require_rows,
)

EPS = np.finfo(float).eps


def test_frozen_views_without_a_copy():
    array = np.arange(6.0).reshape(2, 3)
    result = frozen(array, np.float64)
    assert np.shares_memory(array, result) and array.flags.writeable
    assert not result.flags.writeable
    assert frozen(result, np.float64) is result
    assert frozen(array.T, np.float64).flags.c_contiguous


@pytest.mark.parametrize(
    "values",
    [
        [[1, 2, 3]],
        ((1.0, 2, 3),),
        np.array([[1, 2, 3]], np.uint8),
        np.array([[1, 2, 3]], ">f4"),
        np.array([[1, 2, 3], [0, 0, 0]], order="F")[:1],
    ],
)
def test_points_come_out_in_one_form(values):
    points = as_points(values)
    assert points.dtype == np.float64 and points.dtype.isnative and points.tolist() == [[1, 2, 3]]
    assert points.flags.c_contiguous and not points.flags.writeable


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ([], "shape"),
        (np.empty((0, 3)), "empty"),
        ([1, 2, 3], "shape"),
        ([[1, 2]], "shape"),
        ([[[1, 2, 3]]], "shape"),
        ([[1, 2], [1, 2, 3]], "unequal"),
        ([["1", "2", "3"]], "values"),
        ([[1, 2, None]], "object"),
        ([[1j, 0, 0]], "complex"),
        ([[10**400, 0, 0]], "object"),
        ("points", "values"),
        (None, "object"),
        ([[1, 2, 3], [math.nan, 0, 0], [0, math.inf, 0]], "2 of 3 rows.*first at row 1"),
        ([[1, 2, 3], [0, 0, -1e200]], "within 1e.151 .* got 1e.200.*Scale"),
    ],
)
def test_bad_points(values, reason):
    with pytest.raises(InvalidShapeError, match=reason) as caught:
        as_points(values, "samples")
    assert str(caught.value).startswith("samples ") and isinstance(caught.value, ValueError)


def test_normals_are_unit_or_zero():
    rows = [[2, 0, 0], [0, 0, 0], [math.nan, 1, 0], [math.inf, 1, 0], [1e308, 1e308, 1e308]]
    rows += [[5e-324, 0, 0], [-3e-310, 4e-310, 0]]
    normals = as_normals(rows, 7)
    third = math.sqrt(1 / 3)
    expected = [[1, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0], [third] * 3, [1, 0, 0], [-0.6, 0.8, 0]]
    # Denormals of 3e-310 carry about 46 bits.
    assert normals == pytest.approx(np.array(expected), abs=1e-13)


def test_normals_that_are_unit_to_rounding_stay_as_they_are():
    """Each pass changed the last bit again, so rebuilding a shape moved its normals (fixed)."""
    rng = np.random.default_rng(0)
    once = as_normals(rng.normal(size=(5000, 3)), 5000)
    assert np.linalg.norm(once, axis=1) == pytest.approx(1, abs=4 * EPS)
    assert as_normals(once, 5000).tobytes() == once.tobytes()
    assert not np.shares_memory(as_normals(once, 5000), once)
    # Beside rows whose squares overflow, and for rows with a component of exactly 1.
    mixed = np.concatenate([once[:3], [[1e200, 0, 0], [1, 1, 0]]])
    again = as_normals(mixed, 5)
    assert (again[:3] == once[:3]).all()
    assert again[3:] == pytest.approx(np.array([[1, 0, 0], [math.sqrt(0.5)] * 2 + [0]]), abs=EPS)


@pytest.mark.parametrize("values", [[[0, 0, 1]], [0, 0, 1], [["x", "y", "z"]] * 2, None])
def test_bad_normals(values):
    with pytest.raises(InvalidShapeError, match="normals must be a"):
        as_normals(values, 2)


@pytest.mark.parametrize("values", [[[0, 1, 2]], [[0.0, 1.0, 2.0]], np.array([[0, 1, 2]], ">u8")])
def test_faces_come_out_in_one_form(values):
    faces = as_faces(values, 3)
    assert faces.dtype == np.int32 and faces.tolist() == [[0, 1, 2]] and not faces.flags.writeable


@pytest.mark.parametrize("values", [[], np.empty((0, 3)), np.empty((0, 3), np.uint8)])
def test_no_faces(values):
    assert as_faces(values, 3).shape == (0, 3)


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ([[0, 1, 3]], r"0\.\.2: 1 of 1"),
        ([[0, 1, 2], [0, -1, 2]], "first: face 1"),
        ([[0, 1, 2**40]], "must name"),
        ([[0, 1, 1e300]], "must name"),
        (np.array([[0, 1, 2**64 - 1]], np.uint64), "must name"),
        ([[0, 1, 0.5]], "whole"),
        ([[0, 1, math.nan]], "whole"),
        ([[0, 1, math.inf]], "whole"),
        ([[0, 1]], "shape"),
        ([0, 1, 2], "shape"),
        ([["0", "1", "2"]], "values"),
        (None, "object"),
    ],
)
def test_bad_faces(values, reason):
    with pytest.raises(InvalidShapeError, match=reason):
        as_faces(values, 3)


def test_fields_may_hold_nan_and_infinity():
    field = as_field([1, math.nan, -math.inf], 3, "priority")
    assert field.dtype == np.float64 and np.isnan(field[1]) and not field.flags.writeable
    for bad in ([1, 2], [[1, 2, 3]], ["a", "b", "c"], 1.0, None):
        with pytest.raises(InvalidShapeError, match="priority"):
            as_field(bad, 3, "priority")


@pytest.mark.parametrize("value", [0, 1, 0.5, np.float32(0.5), np.int64(1), np.array(0.25)])
def test_numbers(value):
    assert as_number(value, "share", low=0, high=1) == float(value)
    assert type(as_number(value, "share", low=0, high=1)) is float


@pytest.mark.parametrize(
    "value",
    [
        *(-1e-9, 1.1, math.nan, math.inf, -math.inf, 10**400, 1j),
        *(None, "0.5", b"1", "x", [0.5], {}, True, np.True_, np.array([0.5, 0.5])),
    ],
)
def test_bad_numbers(value):
    """Text passed as a number, and 10**400 came out as an OverflowError (fixed)."""
    with pytest.raises(InvalidOptionError, match=r"share must be a number \(from 0 to 1\), got"):
        as_number(value, "share", low=0, high=1)


def test_open_lower_end():
    assert as_number(1e-300, "length", low=0, open_low=True) == 1e-300
    with pytest.raises(InvalidOptionError, match="above 0"):
        as_number(0, "length", low=0, open_low=True)
    with pytest.raises(InvalidOptionError, match="finite"):
        as_number(math.nan, "anything")


@pytest.mark.parametrize("value", [3, 3.0, np.uint8(3), np.float64(3)])
def test_whole_numbers(value):
    number = as_whole_number(value, "count", low=0, high=9)
    assert number == 3 and type(number) is int


@pytest.mark.parametrize("value", [2.5, -1, 10, math.nan, "3", True, None, 1e300])
def test_bad_whole_numbers(value):
    with pytest.raises(InvalidOptionError, match="count must be a"):
        as_whole_number(value, "count", low=0, high=9)


def test_choices():
    assert as_choice("a", "side", ("a", "b")) == "a"
    assert type(as_choice(np.str_("a"), "side", ("a", "b"))) is str


@pytest.mark.parametrize("value", ["c", "A", "", None, 0, ["a"], np.array(["a", "b"])])
def test_bad_choices(value):
    """An array of choices raised numpy's own ValueError about ambiguous truth (fixed)."""
    with pytest.raises(InvalidOptionError, match="side must be one of a, b, got"):
        as_choice(value, "side", ("a", "b"))


def test_all_errors_are_one_family():
    for error in (InvalidOptionError, InvalidShapeError):
        assert issubclass(error, MedialisError) and issubclass(error, ValueError)


@pytest.mark.parametrize("rows", [[3], [-1], [[0, 1], [2, 3]]])
def test_rows_that_are_not_there_reach_no_kernel(rows):
    """A sample of a ball that was not there corrupted memory in a medial mesh (fixed)."""
    with pytest.raises(MedialisError, match=r"fault of medialis.*of 3 that are there"):
        require_rows(np.array(rows), 3, "samples")
    require_rows(np.array([0, 2]), 3, "samples")
    require_rows(np.empty(0, np.int64), 0, "samples")
