"""Benchmark of batches: throughput, overhead of a shape, and a batch with everything wrong in it.

    python benchmarks/batch.py [--shapes 200] [--real FOLDER]

Makes small shapes (some broken: flat, damaged, empty, missing, one that kills its process), runs
them one after the other in this process, then as a batch on one and on all processors, then kills
a batch half-way and resumes it. `--real` adds the meshes of a folder.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import signal
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

import medialis
from medialis.batches.engine import run_jobs
from medialis.batches.jobs import DONE, Job, Row, plan
from medialis.batches.table import csv_text
from medialis.batches.work import run_job
from medialis.io.ply_attributes import write_ply

OPERATIONS = ("surface_skeleton",)


def run_or_die(job: Job) -> list[Row]:
    """Run a job; the deadly one ends its process."""
    if job.name == "deadly":
        os._exit(1)
    return run_job(job)


def make_shapes(count: int, folder: Path) -> list[Path]:
    """Write generated shapes, every tenth one broken in some way."""
    shape = medialis.organic_shape(56)
    rng = np.random.default_rng(0)
    paths = []
    for number in range(count):
        path = folder / f"shape_{number:03d}.ply"
        paths.append(path)
        points = shape.points * rng.uniform(0.5, 2.0, 3)
        broken = number // 10 % 4 if number % 10 == 9 else -1
        if broken == 3:
            continue  # missing
        write_ply(path, points * ([1, 1, 0] if broken == 0 else 1), shape.faces)
        if broken == 1:
            path.write_bytes(path.read_bytes()[:3000])
        elif broken == 2:
            path.write_bytes(b"")
    write_ply(folder / "deadly.ply", shape.points, shape.faces)
    return [*paths, folder / "deadly.ply"]


def run_batch(files: list[Path], out: Path, workers: int) -> list[Row]:
    """Do what `medialis.batch` does, with the deadly job."""
    jobs = plan(OPERATIONS, files, out, picture=False)
    threads = max(1, medialis.thread_count() // workers)
    waiting, rows = [], {}
    for job in (replace(job, threads=threads) for job in jobs):
        done = job.finished(OPERATIONS[0])
        if done is None:
            waiting.append(job)
        else:
            rows[job.name] = [done]
    for job, made in run_jobs(waiting, run_or_die, workers=workers):
        rows[job.name] = made
    return [row for job in jobs for row in rows[job.name]]


def without_seconds(rows: list[Row]) -> str:
    """Return the table without its times, which differ from run to run."""
    return csv_text([replace(row, seconds=None) for row in rows])


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--shapes", type=int, default=200)
    parser.add_argument("--real", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = make_shapes(options.shapes, folder)
        files += sorted(options.real.glob("*.ply")) if options.real else []
        good = [file for file in files[: options.shapes] if file.exists()][:40]
        run_job(plan(OPERATIONS, good[:1], folder / "warm", picture=False)[0])
        clock = time.perf_counter()
        for job in plan(OPERATIONS, good, folder / "loop", picture=False):
            run_job(replace(job, threads=medialis.thread_count()))
        loop = time.perf_counter() - clock
        print(f"{len(good)} small shapes one by one in one process: {loop:.2f} s")
        for workers in dict.fromkeys((1, medialis.thread_count())):
            clock = time.perf_counter()
            found = run_batch(good, folder / f"batch{workers}", workers)
            wall = time.perf_counter() - clock
            inside = sum(row.seconds for row in found if row.status == DONE) / workers
            print(
                f"the same on {workers} workers: {wall:.2f} s with starting and ending them, "
                f"{inside:.2f} s of it in the jobs"
            )
            clock = time.perf_counter()
            stamps = run_batch(good[:1], folder / f"start{workers}", workers)
            start = time.perf_counter() - clock - sum(r.seconds or 0 for r in stamps)
            overhead = (wall - inside - start) / len(good)
            print(f"  starting and ending {start:.2f} s, overhead {1000 * overhead:.0f} ms a shape")
        clock = time.perf_counter()
        table = run_batch(files, folder / "all", medialis.thread_count())
        wall = time.perf_counter() - clock
        bad = [row for row in table if row.status != DONE]
        print(f"{len(table)} shapes in one batch: {wall:.1f} s, {len(table) - len(bad)} done")
        for row in bad:
            print(f"  {row.name}: {row.sentence.replace(str(folder), '...')[:110]}")
        process = multiprocessing.get_context("spawn").Process(
            target=run_batch, args=(files, folder / "killed", medialis.thread_count())
        )
        process.start()
        while len(list((folder / "killed").glob("*/*/manifest.json"))) < len(files) // 2:
            time.sleep(0.05)
        os.kill(process.pid, signal.SIGKILL)
        process.join()
        done = len(list((folder / "killed").glob("*/*/manifest.json")))
        again = run_batch(files, folder / "killed", medialis.thread_count())
        same = without_seconds(again) == without_seconds(table)
        print(f"killed with {done} done, resumed: the same table: {same}")


if __name__ == "__main__":
    main()
