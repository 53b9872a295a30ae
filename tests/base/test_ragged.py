"""Rows of unequal length."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from medialis.base.arrays import Ragged
from medialis.base.errors import InvalidShapeError


@settings(max_examples=100, deadline=None, derandomize=True)
@given(keys=st.lists(st.integers(-3, 6), max_size=40), more=st.integers(0, 3))
def test_group_lists_the_positions_of_each_key(keys, more):
    """An empty list of keys was an array of floats and failed (fixed)."""
    rows = 7 + more
    grouped = Ragged.group(keys, rows)
    expected = [[i for i, key in enumerate(keys) if key == row] for row in range(rows)]
    assert [row.tolist() for row in grouped] == expected
    assert len(grouped) == rows
    assert grouped.lengths.tolist() == [len(row) for row in expected]


def test_group_refuses_keys_above_the_rows():
    """They silently made more rows than were asked for (fixed)."""
    with pytest.raises(InvalidShapeError, match="below 3 rows, got 5"):
        Ragged.group([0, 5], 3)


def test_rows_by_number():
    rows = Ragged([0, 2, 2, 3], [5, 6, 7])
    assert rows[0].tolist() == [5, 6] and rows[1].tolist() == [] and rows[-1].tolist() == [7]
    assert rows[-3].tolist() == [5, 6]
    for row in (3, -4):
        with pytest.raises(IndexError):
            rows[row]


def test_no_rows():
    rows = Ragged([0], [])
    assert len(rows) == 0 and list(rows) == [] and rows.lengths.tolist() == []


def test_arrays_are_read_only_and_the_given_ones_stay_writable():
    offsets, indices = np.array([0, 1], np.int64), np.array([4], np.int32)
    rows = Ragged(offsets, indices)
    assert rows.offsets.dtype == np.int64 and rows.indices.dtype == np.int32
    assert not rows.offsets.flags.writeable and not rows.indices.flags.writeable
    assert offsets.flags.writeable and indices.flags.writeable


@pytest.mark.parametrize(
    ("offsets", "indices"),
    [
        ([], []),
        ([1, 2], [0, 0]),
        ([0, 2, 1], [0]),
        ([0, 3], [0, 0]),
        ([0, 1], [0, 0]),
        ([[0, 1]], [0]),
        ([0, 1], [[0]]),
        (5, [1]),
    ],
)
def test_offsets_that_do_not_describe_the_indices(offsets, indices):
    with pytest.raises(InvalidShapeError, match="offsets"):
        Ragged(offsets, indices)
