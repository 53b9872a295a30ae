"""The benchmark of whole runs: it shouts when a stage has grown, and its page has its numbers."""

import json

import pytest
import whole_runs

import medialis


def test_a_stage_that_has_grown_is_named():
    """By half and a unit more; other units of time, new stages and what is faster are none."""
    stored = {"U": 0.01, "whole": 10.0, "reading": 1.0, "balls": 4.0, "writing": 3.0}
    now = {"U": 0.09, "whole": 15.5, "reading": 1.9, "balls": 5.9, "writing": 1.0, "new": 99.0}
    assert whole_runs.louder(stored, stored) == []
    assert whole_runs.louder(now, stored) == ["whole: 15.5 U, 10 U before"]
    now["balls"] = 6.1
    assert len(whole_runs.louder(now, stored)) == 2


def test_the_page_is_written_from_the_numbers():
    stored = json.loads(whole_runs.STORED.read_text())
    assert whole_runs.PAGE.read_text() == whole_runs.page(stored)
    assert set(stored) <= {*whole_runs.SHAPES, whole_runs.GROWTH}


@pytest.mark.slow
def test_a_run_is_measured_by_stage(tmp_path):
    """Stages of one run lie within it, and so do those that are run twice."""
    shape = medialis.organic_shape(56)
    path = tmp_path / "shape.ply"
    whole_runs.write_ply(path, shape.points, shape.faces)
    row = whole_runs.run(path, "thickness")
    assert {"reading", "skeleton", "writing"} <= set(row)
    assert all(0 <= row[stage] <= row["whole"] for stage in row)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["creature", "knot", "scan", "cup", "pipe", "plate", "beads"])
def test_shapes_are_closed(name):
    shape = whole_runs.SHAPES[name]()
    assert (shape.face_adjacency >= 0).all()
