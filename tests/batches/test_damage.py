"""Batches among damaged files and strange names."""

import csv
import hashlib
import json
import logging
import os
import subprocess
import sys

import pytest

import medialis
from medialis.base.progress import Progress
from medialis.batches.batch import csv_text, locked_folder
from medialis.batches.engine import warn_if_open
from medialis.batches.jobs import DONE, FAILED, find_files, plan, run_job, unique_names
from medialis.formats.ply_attributes import write_ply


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


@pytest.mark.slow
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


@pytest.mark.slow
@pytest.mark.parametrize(
    ("key", "value"),
    [
        *[("messages", value) for value in ([7], "text", None)],
        *[("values", value) for value in ([], None, "x")],
        *[("seconds", value) for value in ({}, [], {"total": "x"}, None)],
        *[("files", value) for value in ([], [7], None, ["../a.ply"], [["a"]])],
        *[("operation", 7), ("picture", 7)],
        *[("contents", value) for value in ({}, [], None, {"thickness.npz": 7})],
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


def test_a_file_with_other_contents_is_not_done(job):
    """A byte of another generation under a complete manifest was taken for the result (fixed)."""
    folder = job.folder("thickness")
    contents = json.loads((folder / "manifest.json").read_bytes())["contents"]
    assert set(contents) == {path.name for path in folder.iterdir()} - {"manifest.json"}
    for name, told in contents.items():
        path = folder / name
        data = path.read_bytes()
        assert told == {"bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}
        for other in (data[:-1], data + b"\0", data[:-1] + bytes([data[-1] ^ 1])):
            path.write_bytes(other)
            assert job.finished("thickness") is None
        path.unlink()
        assert job.finished("thickness") is None
        path.write_bytes(data)
        assert job.finished("thickness") is not None


KILLED = """
import os, sys
import medialis
from medialis.batches.jobs import plan
from medialis.base.disk import Folder
from medialis.formats.output_folder import OutputFolder
from medialis.show.writing import write_result

file, output, fatal = sys.argv[1:]
left, move, replace = int(fatal), OutputFolder._move, Folder.move

def counted(self, *where):
    global left
    if left == 0:
        os._exit(9)
    left -= 1
    return replace(self, *where)

def moving(self):
    Folder.move = counted
    move(self)
    print("moved", flush=True)
    if left == 0:
        os._exit(9)

OutputFolder._move = moving
from medialis.batches.jobs import run_job
given = {"thickness": {"refine": 0.0, "threshold": 0.3}}
(job,) = plan(["thickness"], [file], output, parameters=given, picture=False)
run_job(job)
print("unharmed")
"""


@pytest.mark.slow
def test_a_replaced_result_that_was_killed_between_moves_is_not_done(job, tmp_path):
    """The old manifest stayed beside new files: a resumed batch took them for the old ones (fixed).

    Killed after every number of moves, then resumed with the old and with the new parameters.
    """
    given = {"thickness": {"refine": 0.0, "threshold": 0.3}}
    files = [tmp_path / "a.ply"]
    (other,) = plan(["thickness"], files, tmp_path / "o", parameters=given, picture=False)
    (whole,) = plan(["thickness"], files, tmp_path / "new", parameters=given, picture=False)
    run_job(whole)

    def data(one):
        paths = one.folder("thickness").iterdir()
        return {path.name: path.read_bytes() for path in paths if path.name != "manifest.json"}

    before, after = data(job), data(whole)
    assert before.keys() == after.keys() and before != after
    for count in range(100):
        words = [sys.executable, "-c", KILLED, files[0], tmp_path / "o", str(count)]
        ended = subprocess.run(words, capture_output=True, text=True)
        assert ended.returncode in (0, 9), ended.stderr
        if ended.returncode == 0:
            break
        complete = "moved" in ended.stdout
        assert list(job.folder("thickness").parent.glob(".*")) != []
        assert job.finished("thickness") is None or (count == 0 and data(job) == before)
        assert (other.finished("thickness") is not None) == complete
        (row,) = run_job(job)
        assert row.status == DONE and data(job) == before
        assert job.finished("thickness") == row and other.finished("thickness") is None
    assert count > 2 * len(before) and data(other) == after
    assert list(job.folder("thickness").parent.glob(".*")) == []


@pytest.mark.slow
def test_a_batch_removes_what_a_killed_one_left(tmp_path):
    """Hidden files of a batch that was killed while it wrote its table stayed (fixed)."""
    shape = medialis.organic_shape(56)
    write_ply(tmp_path / "a.ply", shape.points, shape.faces)
    given = {"thickness": {"refine": 0.0}}
    out = tmp_path / "o"
    (job,) = plan(["thickness"], [tmp_path / "a.ply"], out, parameters=given)
    run_job(job)
    names = [out / ".results.csv-01234567", out / ".results.html-89abcdef"]
    for path in names:
        path.write_text("half")
    left = out / "a" / ".thickness-01234567"
    left.mkdir()
    (left / ".medialis-lock").write_bytes(b"")
    (left / "half.ply").write_bytes(b"ply")
    medialis.batch("thickness", [tmp_path / "a.ply"], out, parameters=given)
    assert not left.exists() and not any(path.exists() for path in names)


@pytest.mark.parametrize(
    ("address", "warned"),
    [
        *[(f"{kind}127.0.0.1:8786", False) for kind in ("", "tcp://", "tls://", "ucx://")],
        *[(f"tcp://{host}:8786", False) for host in ("localhost", "127.8.9.1", "[::1]")],
        *[("inproc://10.0.0.1/77/1", False), ("tls://10.0.0.1:8786", False)],
        *[(f"tcp://{host}:8786", True) for host in ("10.0.0.1", "[fe80::1]", "host", "0.0.0.0")],
        *[("10.0.0.1:8786", True), ("ws://10.0.0.1", True), ("wss://10.0.0.1", False)],
    ],
)
def test_a_scheduler_on_the_network_without_tls_gives_a_warning(address, warned):
    """Who reaches a worker of Dask runs code there, and nothing said so (fixed)."""
    progress = Progress()
    warn_if_open(address, progress)
    assert [m.code for m in progress.messages] == ["open_scheduler"] * warned
    assert all(m.level == logging.WARNING for m in progress.messages)


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
    assert all(row[5] == "'+" and not row[1].startswith(("=", "-", "@")) for row in rows[1:])
    assert os.sep not in rows[1][0]


@pytest.mark.slow
def test_a_batch_follows_no_link_in_its_folder(tmp_path):
    """Results at the end of a planted link were replaced, and a lock made a file there (fixed)."""
    shape = medialis.organic_shape(56)
    medialis.write_mesh(tmp_path / "a.ply", shape)
    victim, out = tmp_path / "victim", tmp_path / "out"
    for folder in (victim, out):
        folder.mkdir()
    (victim / "thickness.npz").write_text("mine")
    (out / "a").symlink_to(victim)
    (job,) = plan(["thickness"], [tmp_path / "a.ply"], out, picture=False)
    (row,) = run_job(job)
    assert row.status == FAILED and "link" in row.sentence
    assert [path.name for path in victim.iterdir()] == ["thickness.npz"]
    (out / ".medialis-batch").symlink_to(victim / "new")
    with pytest.raises(medialis.FileError, match="link"):
        medialis.batch("thickness", [tmp_path / "a.ply"], out, workers=1)
    assert not (victim / "new").exists()


def test_a_batch_refuses_a_folder_with_files_of_somebody_else(tmp_path):
    medialis.write_mesh(tmp_path / "a.ply", medialis.organic_shape(56))
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "letter.txt").write_text("mine")
    with pytest.raises(medialis.FileError, match=r"letter\.txt"):
        medialis.batch("thickness", [tmp_path / "a.ply"], tmp_path / "out", workers=1)
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["letter.txt"]
