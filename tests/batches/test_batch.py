"""Batches: every good shape finished, every bad one listed, resumed runs give the same table."""

import csv
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import medialis
from medialis.batches.engine import run_jobs
from medialis.batches.jobs import DONE, FAILED, Job, Row, plan
from medialis.batches.table import csv_text, html_text
from medialis.cli import main
from medialis.io.ply_attributes import write_ply
from mortal_work import mortal_work

pytest.importorskip("distributed", reason="needs the extra dask")

OPERATIONS = ("surface_skeleton", "thickness")


@pytest.fixture(scope="module")
def shapes(tmp_path_factory) -> list[Path]:
    """Three good shapes, a flat one, a damaged one and a missing one."""
    folder = tmp_path_factory.mktemp("shapes")
    shape = medialis.organic_shape(56)
    paths = []
    for number, factor in enumerate((1.0, 0.7, 3.0)):
        paths.append(folder / f"good {number} ü.ply")
        write_ply(paths[-1], shape.points * [1, 1, factor], shape.faces)
    write_ply(folder / "flat.ply", shape.points * [1, 1, 0], shape.faces)
    (folder / "damaged.ply").write_bytes(paths[0].read_bytes()[:2000])
    return [*paths, folder / "flat.ply", folder / "damaged.ply", folder / "missing.ply"]


@pytest.fixture(scope="module")
def finished(shapes, tmp_path_factory) -> tuple[Path, list[Row]]:
    out = tmp_path_factory.mktemp("batch")
    return out, medialis.batch(OPERATIONS, shapes, out, workers=2)


def without_seconds(text: str) -> list[list[str]]:
    rows = list(csv.reader(text.splitlines()))
    place = rows[0].index("seconds")
    return [row[:place] + row[place + 1 :] for row in rows]


def test_good_shapes_are_done_and_bad_ones_say_why(finished, shapes):
    out, rows = finished
    assert [(r.file, r.operation) for r in rows] == [
        (str(f), o) for f in shapes for o in OPERATIONS
    ]
    assert [r.status for r in rows] == [DONE] * 6 + [FAILED] * 6
    sentences = [r.sentence for r in rows[6:]]
    assert all("shape is flat" in text for text in sentences[:2])
    assert all("damaged.ply" in text for text in sentences[2:4])
    assert all("no such file" in text for text in sentences[4:])
    listed = list(csv.DictReader((out / "results.csv").read_text("utf-8").splitlines()))
    assert [row["status"] for row in listed] == [r.status for r in rows]
    page = (out / "results.html").read_text("utf-8")
    assert page.count("<img") == 6 and "6 results, 6 failed" in page
    for link in re.findall('src="([^"]+)"', page):
        assert (out / link.replace("%20", " ").replace("%C3%BC", "ü")).is_file()


def test_results_are_bitwise_those_of_single_runs(finished, shapes, tmp_path):
    out, _ = finished
    for path in shapes[:3]:
        assert main(["surface-skeleton", str(path), "-o", str(tmp_path / path.stem)]) == 0
        for name in ("surface_skeleton.npz", "surface_skeleton.ply", "surface_skeleton.png"):
            one = (tmp_path / path.stem / name).read_bytes()
            assert (out / path.stem / "surface_skeleton" / name).read_bytes() == one


def test_a_second_call_computes_only_what_is_missing(finished, shapes):
    out, rows = finished
    kept = out / "good 0 ü" / "thickness" / "thickness.npz"
    lost = out / "good 1 ü" / "surface_skeleton"
    (lost / "surface_skeleton.npz").unlink()
    left = lost.with_name(".surface_skeleton-left")
    left.mkdir()
    stamp = kept.stat().st_mtime_ns
    again = medialis.batch(OPERATIONS, shapes, out, workers=1)
    assert without_seconds(csv_text(again)) == without_seconds(csv_text(rows))
    assert kept.stat().st_mtime_ns == stamp and (lost / "surface_skeleton.npz").exists()
    assert not left.exists()


def test_another_input_or_parameter_is_computed_anew(finished, shapes, tmp_path):
    path = tmp_path / "a.ply"
    path.write_bytes(shapes[0].read_bytes())
    calls = {}
    for step, given in {"first": {}, "same": {}, "other": {"subsample": 0.01}}.items():
        parameters = {"surface_skeleton": given}
        (row,) = medialis.batch(
            "surface-skeleton", [path], tmp_path / "o", parameters=parameters, picture=False
        )
        calls[step] = row
    assert calls["first"] == calls["same"]
    assert calls["other"].values["skeleton_points"] < calls["same"].values["skeleton_points"]
    path.write_bytes(shapes[2].read_bytes())
    (row,) = medialis.batch("surface-skeleton", [path], tmp_path / "o", picture=False)
    assert row.values["diagonal"] > calls["same"].values["diagonal"]


def test_a_killed_batch_goes_on_and_gives_the_same_table(finished, shapes, tmp_path):
    _, rows = finished
    command = [sys.executable, "-m", "medialis", "batch", ",".join(OPERATIONS)]
    command += [*map(str, shapes), "-o", str(tmp_path / "out"), "--workers", "1"]
    child = subprocess.Popen(command, stderr=subprocess.DEVNULL, start_new_session=True)
    limit = time.monotonic() + 60
    while not list(tmp_path.glob("out/*/*/manifest.json")) and time.monotonic() < limit:
        time.sleep(0.01)
    os.killpg(child.pid, signal.SIGKILL)
    child.wait()
    assert not (tmp_path / "out" / "results.csv").exists()
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0 and "6 results, 6 failed" in done.stdout, done.stderr
    text = (tmp_path / "out" / "results.csv").read_text("utf-8")
    assert without_seconds(text) == without_seconds(csv_text(rows))
    assert not list(tmp_path.glob("out/*/.*"))


def test_a_dying_worker_is_one_failed_row(tmp_path):
    """An innocent job whose process died by chance is tried again and done."""
    names = ["a", "deadly", "b", "unlucky", "c", "d"]
    jobs = [Job(n, n, str(tmp_path), {"thickness": {}}) for n in names]
    found = {job.name: rows for job, rows in run_jobs(jobs, mortal_work, workers=2)}
    assert {n: rows[0].status for n, rows in found.items()} == {
        **dict.fromkeys(names, DONE),
        "deadly": FAILED,
    }
    assert "process that computed it died" in found["deadly"][0].sentence


def test_a_cluster_gives_bitwise_the_same(finished, shapes, tmp_path):
    from distributed import LocalCluster

    out, rows = finished
    with LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0"
    ) as cluster:
        address = cluster.scheduler_address
        again = medialis.batch(OPERATIONS, shapes, tmp_path, scheduler=address, picture=False)
    for row, other in zip(again, rows, strict=True):
        assert (row.name, row.status, row.values) == (other.name, other.status, other.values)
    for path in sorted(tmp_path.glob("*/*/*.npz")):
        assert path.read_bytes() == (out / path.relative_to(tmp_path)).read_bytes()


def test_cancelling_keeps_what_is_finished(shapes, tmp_path):
    def stop(fraction: float, text: str) -> bool:
        return fraction == 0

    with pytest.raises(medialis.Cancelled):
        medialis.batch("thickness", shapes[:3], tmp_path, workers=1, progress=stop)
    assert len(list(tmp_path.glob("*/thickness/manifest.json"))) >= 1
    assert not (tmp_path / "results.csv").exists()


def test_plan_names_are_unique_and_folders_are_searched(tmp_path):
    for name in ("x/a.ply", "x/b.stl", "x/b.ply", "y/A.obj", "y/notes.md", "y/b.ply"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("")
    jobs = plan(["thickness"], [tmp_path, "other/c.weird"], tmp_path / "out")
    assert [job.name for job in jobs] == ["a_ply", "b_ply", "b_stl", "A_obj", "b_ply_2", "c"]
    assert jobs[0].folder("thickness") == tmp_path / "out" / "a_ply" / "thickness"


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ([[], ["a.ply"]], "at least one operation"),
        ([["nothing"], ["a.ply"]], "no operation 'nothing'"),
        ([["thickness"], []], "at least one file"),
    ],
)
def test_plan_refuses(arguments, text, tmp_path):
    with pytest.raises(medialis.InvalidOptionError, match=text):
        plan(*arguments, tmp_path)


def test_plan_checks_parameters_before_anything_runs(tmp_path):
    with pytest.raises(medialis.InvalidOptionError, match="spots must be"):
        plan(["thickness"], ["a.ply"], tmp_path, parameters={"thickness": {"spots": 0}})
    with pytest.raises(medialis.InvalidOptionError, match="which this batch does not run"):
        plan(["thickness"], ["a.ply"], tmp_path, parameters={"skeleton_mesh": {}})
    (tmp_path / "file").write_text("")
    with pytest.raises(medialis.FileError, match="it is a file"):
        plan(["thickness"], ["a.ply"], tmp_path / "file")


def test_the_page_shows_any_name_as_text():
    row = Row("<b>", "<b>.ply", "thickness", FAILED, 'a < b & "c"', values={"x": 1 / 3})
    page = html_text([row])
    assert "<b>.ply" not in page and "&lt;b&gt;" in page and "a &lt; b &amp;" in page
    assert "0.33333" in page and np.isclose(float(csv_text([row]).split(",")[-1]), 1 / 3)


@pytest.mark.parametrize(
    ("given", "text"),
    [
        (["--set", "thickness=3"], "OPERATION.PARAMETER=VALUE"),
        (["--set", "thickness.spots=x"], "spots must be"),
        (["--workers", "0"], "workers must be"),
        (["--scheduler", "tcp://127.0.0.1:1"], "Cannot reach a Dask scheduler"),
    ],
)
def test_the_command_refuses_in_one_line(given, text, shapes, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("medialis.batches.engine.CONNECT_SECONDS", 0.2)
    assert main(["batch", "thickness", str(shapes[0]), "-o", str(tmp_path / "o"), *given]) == 2
    error = capsys.readouterr().err
    assert text in error and error.count("\n") == 1
    assert not (tmp_path / "o").exists()
