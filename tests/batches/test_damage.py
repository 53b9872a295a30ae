"""Batches among damaged files and strange names."""

import csv
import json
import os

import pytest

import medialis
from medialis.batches.files import find_files, unique_names
from medialis.batches.jobs import DONE, plan
from medialis.batches.lock import locked_folder
from medialis.batches.table import csv_text
from medialis.batches.work import run_job
from medialis.files.ply_attributes import write_ply


@pytest.fixture
def job(tmp_path):
    """A small job, finished."""
    shape = medialis.organic_shape(56)
    write_ply(tmp_path / "a.ply", shape.points, shape.faces)
    given = {"thickness": {"refine": 0.0}}
    (job,) = plan(
        ["thickness"], [tmp_path / "a.ply"], tmp_path / "o", parameters=given, picture=False
    )
    (row,) = run_job(job)
    assert row.status == DONE and job.finished("thickness") == row
    return job


@pytest.mark.parametrize(
    "text",
    [b"[" * 200_000, b'{"a":' * 200_000, b"\xff", b"", b"7", b"[]", b"{}", b"null", b"9" * 5000],
)
def test_a_damaged_manifest_is_none(job, text):
    """200,000 brackets were a RecursionError that ended the batch (fixed)."""
    (job.folder("thickness") / "manifest.json").write_bytes(text)
    assert job.finished("thickness") is None
    assert find_files([job.output], job.folder("thickness").parents[3]) != []
    (row,) = run_job(job)
    assert row.status == DONE and job.finished("thickness") == row


@pytest.mark.parametrize(
    ("key", "value"),
    [
        *[("messages", value) for value in ([7], "text", None)],
        *[("values", value) for value in ([], None, "x")],
        *[("seconds", value) for value in ({}, [], {"total": "x"}, None)],
        *[("files", value) for value in ([], [7], None, ["../a.ply"], [["a"]])],
        *[("operation", 7), ("picture", 7)],
    ],
)
def test_a_manifest_with_other_types_is_none(job, key, value):
    """A number among the messages was a TypeError outside of the error tree (fixed)."""
    path = job.folder("thickness") / "manifest.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {key: value}))
    assert job.finished("thickness") is None
    del (manifest := json.loads(path.read_text()))[key]
    path.write_text(json.dumps(manifest))
    assert job.finished("thickness") is None


def test_an_empty_file_is_not_done(job):
    """A machine that lost power leaves files of 0 bytes under a complete manifest (fixed)."""
    (job.folder("thickness") / "thickness.npz").write_bytes(b"")
    assert job.finished("thickness") is None


def test_a_file_called_only_by_its_ending_stays_in_the_output(tmp_path):
    """The results of `...ply` went to the folder above the output (fixed)."""
    paths = [tmp_path / name for name in ("...ply", "....ply", "a.ply", ".ply")]
    assert unique_names(paths) == ["___ply", "____ply", "a", ".ply"]
    for job in plan(["thickness"], paths, tmp_path / "out"):
        place = job.folder("thickness").resolve()
        assert place.parent.parent == (tmp_path / "out").resolve()


def test_names_that_no_system_takes_are_failed_rows(tmp_path):
    """A name of 300 letters was an OSError of the whole batch (fixed)."""
    names = ["x" * 300 + ".ply", "a\0b.ply"]
    jobs = plan(["thickness"], names, tmp_path / "out")
    sentences = [run_job(job)[0].sentence for job in jobs]
    assert all(text.startswith("Cannot read") for text in sentences)
    with pytest.raises(medialis.FileError, match="Cannot write"), locked_folder("y" * 300):
        pass
    assert plan(["thickness"], ["a.ply"], "y" * 300)


def test_no_cell_of_the_table_is_a_formula(tmp_path):
    """A file called `=1+1.ply` was a formula in spreadsheets (fixed)."""
    jobs = plan(["thickness"], ["=1+1.ply", "-2.ply", "@a.ply"], tmp_path)
    rows = list(csv.reader(csv_text([job.failed("thickness", "+") for job in jobs]).splitlines()))
    assert [row[0] for row in rows[1:]] == ["'=1+1", "'-2", "'@a"]
    assert all(row[5] == "'+" and not row[4].startswith(("=", "-", "@")) for row in rows[1:])
    assert os.sep not in rows[1][0]
