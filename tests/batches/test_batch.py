"""Batches: every good shape finished, every bad one listed, resumed runs give the same table."""

import csv
import functools
import json
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import pytest

import medialis
from medialis.batches.batch import csv_text, html_text, locked_folder, write_table
from medialis.batches.engine import Processes, Worker, cluster, hand_out, run_jobs
from medialis.batches.jobs import DONE, FAILED, Job, Row, find_files, plan, run_job
from medialis.cli.commands import main
from medialis.formats.ply_attributes import write_ply
from medialis.show.viewer.page import has_library
from mortal_work import mortal_work
from png_files import read_png

needs_dask = pytest.mark.skipif(find_spec("distributed") is None, reason="needs the extra dask")
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
    times = [place for place, name in enumerate(rows[0]) if name.endswith(": seconds")]
    return [[cell for place, cell in enumerate(row) if place not in times] for row in rows]


@pytest.mark.slow
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
    assert [row[f"{o}: status"] for row in listed for o in OPERATIONS] == [r.status for r in rows]
    page = (out / "results.html").read_text("utf-8")
    assert page.count("<img") == 6 and "6 shapes: 6 results, 6 failed" in page
    for link in re.findall('(?:src|href)="([^"#]+)"', page):
        assert (out / unquote(link)).exists()
    for link in re.findall('src="([^"]+)"', page):
        _, width, channels = read_png(out / unquote(link)).shape
        assert 250 <= width < 500 and channels == 4


@pytest.mark.slow
def test_results_are_bitwise_those_of_single_runs(finished, shapes, tmp_path):
    out, _ = finished
    for path in shapes[:3]:
        assert main(["surface-skeleton", str(path), "-o", str(tmp_path / path.stem)]) == 0
        for name in ("surface_skeleton.npz", "surface_skeleton.ply", "surface_skeleton.png"):
            one = (tmp_path / path.stem / name).read_bytes()
            assert (out / path.stem / "surface_skeleton" / name).read_bytes() == one


@pytest.mark.slow
def test_a_second_call_computes_only_what_is_missing(finished, shapes):
    out, rows = finished
    kept = out / "good 0 ü" / "thickness" / "thickness.npz"
    lost = out / "good 1 ü" / "surface_skeleton"
    (lost / "surface_skeleton.npz").unlink()
    left = lost.with_name(".surface_skeleton-0123abcd")
    left.mkdir()
    stamp = kept.stat().st_mtime_ns
    again = medialis.batch(OPERATIONS, shapes, out, workers=1)
    assert without_seconds(csv_text(again)) == without_seconds(csv_text(rows))
    assert kept.stat().st_mtime_ns == stamp and (lost / "surface_skeleton.npz").exists()
    assert not left.exists()


@pytest.mark.slow
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


@pytest.mark.slow
def test_operations_share_what_is_kept_and_the_next_shape_starts_without(
    shapes, tmp_path, monkeypatch
):
    """One worker runs the operations of a shape one after the other: balls are shrunk once."""
    from medialis.skeleton import surface_skeleton

    shrunk, shrink = [], surface_skeleton.maximal_balls

    @functools.wraps(shrink)
    def counted(*given):
        shrunk.append(given)
        return shrink(*given)

    monkeypatch.setattr(surface_skeleton, "maximal_balls", counted)
    operations = ("surface_skeleton", "skeleton_importance", "manifolds")
    job = plan(operations, shapes[:1], tmp_path, picture=False)[0]
    with medialis.memory_limit(1 << 30):
        rows = run_job(job)
        assert medialis.kept_bytes() == 0
    assert [row.status for row in rows] == [DONE] * 3 and len(shrunk) == 1


@pytest.mark.slow
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
    assert done.returncode == 3 and "\n6 results failed.\n" in done.stdout, done.stderr
    text = (tmp_path / "out" / "results.csv").read_text("utf-8")
    assert without_seconds(text) == without_seconds(csv_text(rows))
    assert not list(tmp_path.glob("out/*/.*"))


@pytest.mark.slow
def test_ctrl_c_on_a_terminal_ends_a_batch_with_one_line(shapes, tmp_path):
    """It goes to the workers too, which printed their tracebacks (fixed)."""
    words = [sys.executable, "-m", "medialis", "batch", ",".join(OPERATIONS), *map(str, shapes)]
    words += ["-o", str(tmp_path / "out"), "--workers", "1", "--progress", "none"]
    child = subprocess.Popen(words, stderr=subprocess.PIPE, start_new_session=True)
    limit = time.monotonic() + 60
    while not list(tmp_path.glob("out/*/*/manifest.json")) and time.monotonic() < limit:
        time.sleep(0.01)
    os.killpg(child.pid, signal.SIGINT)
    error = child.communicate(timeout=60)[1].decode()
    assert child.returncode == 130 and len(error.splitlines()) == 1, error


def test_a_request_to_end_waits_until_a_worker_has_begun(monkeypatch):
    """A SIGTERM while workers began, or were ended, left some of them behind."""
    begun = []

    class Interrupted(Worker):
        def __init__(self):
            signal.raise_signal(signal.SIGTERM)
            super().__init__()
            begun.append(self.process.pid)

    def stop(number, frame):
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, stop)
    try:
        monkeypatch.setattr("medialis.batches.engine.Worker", Interrupted)
        with pytest.raises(KeyboardInterrupt), Processes(2):
            raise AssertionError("the block must not begin")
        assert len(begun) == 1 and signal.getsignal(signal.SIGTERM) is stop
        with pytest.raises(ProcessLookupError):
            os.kill(begun[0], 0)
    finally:
        signal.signal(signal.SIGTERM, before)


@pytest.mark.slow
def test_workers_give_all_answers_and_end(tmp_path):
    jobs = [Job(str(n), str(n), str(tmp_path), {"thickness": {}}) for n in range(40)]
    with Processes(3) as workers:
        found = list(workers.hand_out(jobs[:20], mortal_work, 3))
        found += workers.hand_out(jobs[20:], mortal_work, 1)
        alive = [worker.process for worker in workers._workers]
        assert len(alive) == 3 and all(process.is_alive() for process in alive)
        pids = [process.pid for process in alive]
    assert all(rows[0].name == job.name for job, rows in found)
    assert sorted(job.name for job, _ in found) == sorted(job.name for job in jobs)
    for pid in pids:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)


@pytest.mark.slow
def test_workers_that_cannot_begin_are_one_sentence(tmp_path):
    """A script without its main test starts itself in each worker."""
    script = tmp_path / "script.py"
    script.write_text(
        "import medialis\n"
        f"medialis.batch('thickness', ['a.ply'], {str(tmp_path / 'out')!r}, workers=1)\n"
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=120)
    assert done.returncode == 1 and "A worker process cannot begin" in done.stderr


@pytest.mark.slow
def test_a_dying_worker_is_one_failed_row(tmp_path):
    """An innocent job whose process died by chance is tried again and done; so are the other
    operations of a deadly one: all of them were failed rows (fixed)."""
    names = ["a", "deadly", "b", "unlucky", "c", "d"]
    jobs = [Job(n, n, str(tmp_path), {"patches": {}, "thickness": {}}) for n in names]
    found = {job.name: rows for job, rows in run_jobs(jobs, mortal_work, workers=2)}
    for name, rows in found.items():
        assert [row.operation for row in rows] == ["patches", "thickness"]
        assert rows[0].status == DONE
        assert rows[1].status == (FAILED if name == "deadly" else DONE)
    assert set(found) == set(names)
    assert "process that computed it died" in found["deadly"][1].sentence


@pytest.mark.slow
def test_a_worker_that_dies_slowly_gets_no_further_job(tmp_path):
    """Its pipe ends before its process does: what was handed to it then failed with it (fixed)."""
    jobs = [
        Job(n, n, str(tmp_path), {"thickness": {}}) for n in ("a", "slow deadly", "b", "unlucky")
    ]
    found = {job.name: rows for job, rows in run_jobs(jobs, mortal_work, workers=1)}
    assert {name: rows[0].status for name, rows in found.items()} == {
        "a": DONE,
        "slow deadly": FAILED,
        "b": DONE,
        "unlucky": DONE,
    }


@pytest.mark.slow
@needs_dask
def test_a_cluster_gives_bitwise_the_same(finished, shapes, tmp_path):
    from distributed import LocalCluster

    out, rows = finished
    with LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0"
    ) as cluster:
        address = cluster.scheduler_address
        again = medialis.batch(OPERATIONS, shapes, tmp_path, workers=address, picture=False)
    for row, other in zip(again, rows, strict=True):
        assert (row.name, row.status, row.values) == (other.name, other.status, other.values)
    for path in sorted(tmp_path.glob("*/*/*.npz")):
        assert path.read_bytes() == (out / path.relative_to(tmp_path)).read_bytes()


@pytest.mark.slow
@needs_dask
def test_a_cluster_whose_workers_are_gone_is_one_sentence(monkeypatch):
    """The batch waited for ever (fixed)."""
    from distributed import LocalCluster

    monkeypatch.setattr("medialis.batches.engine.PATIENCE_SECONDS", 0.2)
    with (
        LocalCluster(
            n_workers=1,
            threads_per_worker=1,
            processes=False,
            dashboard_address="127.0.0.1:0",
        ) as local,
        cluster(local.scheduler_address) as (client, slots),
    ):
        client.retire_workers()
        with pytest.raises(medialis.FileError, match="All workers of the Dask cluster went away"):
            list(hand_out(client, ["a", "b"], str, slots))


@pytest.mark.slow
def test_cancelling_keeps_what_is_finished(shapes, tmp_path):
    def stop(fraction: float, text: str) -> bool:
        return fraction == 0

    with pytest.raises(medialis.Cancelled):
        medialis.batch("thickness", shapes[:3], tmp_path, workers=1, progress=stop)
    assert len(list(tmp_path.glob("*/thickness/manifest.json"))) >= 1
    assert not (tmp_path / "results.csv").exists()


def test_names_say_what_tells_files_apart(tmp_path):
    for name in ("x/a.ply", "x/b.stl", "x/b.ply", "y/A.obj", "y/notes.md", "y/b.ply", "y/c.ply"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("")
    files = [tmp_path, "e/c.weird", "f/g/c.weird", "results.csv.ply", tmp_path / "x" / "a.ply"]
    jobs = plan(["thickness"], files, tmp_path / "out")
    names = ["a_ply", "x_b_ply", "x_b_stl", "A_obj", "y_b_ply"]
    assert [job.name for job in jobs[:5]] == names
    assert [job.name.endswith("_c") for job in jobs[5:8]] == [True] * 3
    assert jobs[7].name.endswith("f_g_c") and len({job.name for job in jobs}) == len(jobs) == 9
    assert jobs[8].name == "results.csv_2"  # results.csv is the table
    assert jobs[0].folder("thickness") == tmp_path / "out/a_ply/thickness"


@pytest.mark.slow
def test_results_and_hidden_files_are_no_input(tmp_path):
    """The second batch into a folder inside the input took the first one's results (fixed)."""
    shape = medialis.organic_shape(56)
    write_ply(tmp_path / "a.ply", shape.points, shape.faces)
    (tmp_path / "._a.ply").write_text("what other systems leave")
    out = tmp_path / "out"
    for folder in (out, out, tmp_path, tmp_path):
        rows = medialis.batch("thickness", [tmp_path], folder, picture=False, workers=1)
        assert [(row.name, row.status) for row in rows] == [("a", DONE)]


def test_results_of_a_single_run_beside_the_input(tmp_path):
    """A manifest among the scans made the whole folder no input (fixed)."""
    for name in ("a.ply", "samples.ply", "thickness.ply"):
        (tmp_path / name).touch()
    manifest = {
        "medialis": "1.0.0",
        "files": [f"elsewhere/{n}.ply" for n in ("samples", "thickness")],
    }
    (tmp_path / "manifest.json").write_text(json.dumps(manifest))
    assert find_files([tmp_path], tmp_path / "out") == [tmp_path / "a.ply"]


@pytest.mark.slow
def test_another_file_of_the_same_size_and_time_is_another_input(shapes, tmp_path):
    """Files of the same name were told apart by their order alone (fixed)."""
    made = []
    for folder, source in zip("xy", shapes, strict=False):
        made.append(tmp_path / folder / "a.ply")
        made[-1].parent.mkdir()
        made[-1].write_bytes(source.read_bytes())
        os.utime(made[-1], ns=(0, 0))
    assert made[0].stat().st_size == made[1].stat().st_size
    (job,) = plan(["thickness"], made[:1], tmp_path / "o", picture=False)
    (row,) = run_job(job)
    assert job.finished("thickness") == row
    (other,) = plan(["thickness"], made[1:], tmp_path / "o", picture=False)
    assert other.name == job.name and other.finished("thickness") is None


@pytest.mark.slow
def test_reports_are_made_where_they_are_missing(finished, shapes, tmp_path):
    """The same files as of a single run; a result without one is computed again, once."""
    out = tmp_path / "out"
    jobs = [
        plan(["thickness"], shapes[:1], out, picture=False, report=report)[0]
        for report in (False, True)
    ]
    (row,) = run_job(jobs[0])
    assert row.report is None and jobs[0].finished("thickness") == row
    assert jobs[1].finished("thickness") is None
    (row,) = run_job(jobs[1])
    assert row.report == "good 0 ü/thickness/report.html" and jobs[1].finished("thickness") == row
    assert jobs[0].finished("thickness") == row
    assert f'<a href="{"good%200%20%C3%BC/thickness/report.html"}">report' in html_text([row])
    turned = '<a href="good%200%20%C3%BC/thickness/report.html#viewer">3D' in html_text([row])
    assert turned == has_library()
    single = ["thickness", str(shapes[0]), "-o", str(tmp_path / "one"), "--report"]
    assert main([*single, "--no-picture"]) == 0
    for name in ("report.html", "report.json"):
        one, many = (
            (f / name).read_text("utf-8") for f in (tmp_path / "one", out / row.name / "thickness")
        )
        assert without_times(one) == without_times(many)


def without_times(text: str) -> str:
    """Cut what differs from run to run: all numbers of seconds."""
    assert "econds" in text
    text = re.sub(r"[\d.]+ seconds", "", text)
    text = re.sub(r'"seconds": \{[^}]*\}', "", text)
    return re.sub("<h2>Seconds</h2>.*?<h2>", "<h2>", text, flags=re.DOTALL)


def test_one_batch_at_a_time_in_a_folder(shapes, tmp_path):
    """Two of them removed each other's unfinished results (fixed)."""
    out = tmp_path / "new" / "out"
    with locked_folder(out):
        with pytest.raises(medialis.FileError, match="Another batch is writing to"):
            medialis.batch("thickness", shapes[:1], out)
        with locked_folder(tmp_path / "other"):
            pass
    assert list(tmp_path.iterdir()) == []


def test_an_output_that_cannot_be_written_is_told_first(shapes, tmp_path):
    """Every shape was computed in vain before (fixed)."""
    (tmp_path / "file").touch()
    called = []
    with pytest.raises(medialis.FileError, match="Cannot write results to"):
        medialis.batch("thickness", shapes, tmp_path / "file" / "out", progress=called.append)
    assert called == []


@pytest.mark.slow
@pytest.mark.skipif(sys.platform in ("win32", "darwin"), reason="file names are text there")
def test_a_file_name_that_is_no_text(shapes, tmp_path):
    """Neither the table nor a report could be written (fixed)."""
    file = tmp_path / os.fsdecode(b"bad\xff.ply")
    file.write_bytes(shapes[0].read_bytes())
    (row,) = run_job(plan(["thickness"], [file], tmp_path, report=True)[0])
    assert row.status == DONE, row.sentence
    write_table([row], tmp_path)
    assert "bad%FF/thickness" in (tmp_path / "results.html").read_text("utf-8")
    assert "bad\\udcff" in (tmp_path / "results.csv").read_text("utf-8")


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
    page = html_text([row, replace(row, status=DONE)])
    assert "<b>.ply" not in page and "&lt;b&gt;" in page and "a &lt; b &amp;" in page
    assert "0.33333" in page and np.isclose(float(csv_text([row]).split(",")[-2]), 1 / 3)


def test_page_and_table_give_angles_in_degrees():
    row = Row("a", "a.ply", "surface_skeleton", DONE, values={"spoke_angle_max": np.pi / 3})
    page = html_text([row])
    assert "spoke angle max in degrees" in page and ">60<" in page
    (line,) = csv.DictReader(csv_text([row]).splitlines())
    assert float(line["surface_skeleton: spoke_angle_max (degrees)"]) == np.degrees(np.pi / 3)


def test_the_table_has_a_line_a_shape_and_a_column_a_unit():
    """It had a line a result, and millimetres and inches in one column (fixed)."""
    sizes = {"diagonal": 2.0, "area": 3.0, "parts": 4}
    rows = [
        Row(name, f"{name}.ply", operation, DONE, values=sizes, unit=unit)
        for name, unit in (("a", "mm"), ("b", "in"), ("c", None))
        for operation in ("parts", "thickness")
    ]
    lines = list(csv.DictReader(csv_text([*rows, rows[0]]).splitlines()))
    assert [(line["shape"], line["unit"]) for line in lines] == [
        ("a", "mm"),
        ("b", "in"),
        ("c", ""),
    ]
    for line, unit in zip(lines, (" (mm)", " (in)", ""), strict=True):
        square = unit.replace(")", "²)")
        for operation in ("parts", "thickness"):
            filled = {name for name, cell in line.items() if cell and name.startswith(operation)}
            assert filled == {
                *(f"{operation}: {name}" for name in ("status", "parts")),
                *(f"{operation}: diagonal{unit}", f"{operation}: area{square}"),
            }
    page = html_text(rows)
    assert "diagonal in mm<" in page and "diagonal in in<" in page and "area in mm²<" in page


def test_failures_come_first_and_the_same_sentence_once():
    bad = [Row("a", "a.ply", name, FAILED, "It is flat.") for name in OPERATIONS]
    good = [Row("b", "b.ply", name, DONE) for name in OPERATIONS]
    page = html_text([*good, *bad])
    assert page.count("It is flat.") == 1 and "<td>all</td>" in page
    assert page.index("It is flat.") < page.index('id="surface_skeleton"')
    assert "1 of 2" in page and "2 shapes: 2 results, 2 failed" in page


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
    command = ["batch", "thickness", str(shapes[0]), "-o", str(tmp_path / "o"), *given]
    assert main([*command, "--progress", "none"]) == 2
    error = capsys.readouterr().err
    assert text in error and error.count("\n") == 1
    assert not (tmp_path / "o").exists()


def test_jobs_know_the_device_that_was_chosen(shapes, tmp_path, monkeypatch):
    """Processes do not have the context of the one that asks."""
    seen = []

    def run_jobs(jobs, work, **kinds):
        seen.extend(jobs)
        return iter(())

    monkeypatch.setattr("medialis.batches.batch.run_jobs", run_jobs)
    with medialis.use_device("cpu"), pytest.raises(KeyError):
        medialis.batch("thickness", shapes, tmp_path / "out")
    assert seen and {job.device for job in seen} == {"cpu"}
