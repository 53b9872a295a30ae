"""Benchmark of batches: throughput, overhead of a shape, and a batch with everything wrong in it.

    python benchmarks/batch.py [--shapes 200] [--real FOLDER] [--only-speed]

Makes small shapes (some broken: flat, damaged, empty, missing, one that kills its process), runs
good ones with one command each, in a loop in this process, and as a batch; then all of them as a
batch, and kills one half-way and resumes it. `--real` adds the meshes of a folder. Times are by the
clock, and of processors: of all processes together, whatever else runs.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

import medialis
from medialis.batches.batch import csv_text
from medialis.batches.engine import run_jobs
from medialis.batches.jobs import DONE, Job, Row, plan, run_job
from medialis.formats.ply_attributes import write_ply

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


def processor_seconds() -> float:
    """Processor time of this process and all that it has started and that have ended."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(part.ru_utime + part.ru_stime for part in used)


class Watch:
    """Times from its making: by the clock, and of processors."""

    def __init__(self) -> None:
        self.clock, self.used = time.perf_counter(), processor_seconds()

    def __call__(self) -> tuple[float, float]:
        """Return both."""
        return time.perf_counter() - self.clock, processor_seconds() - self.used


def measure_speed(good: list[Path], folder: Path) -> None:
    """Print seconds for each shape, one command each, in a loop, and as batches."""
    run_job(plan(OPERATIONS, good[:1], folder / "warm", picture=False)[0])
    watch = Watch()
    for number, file in enumerate(good[:10]):
        command = [sys.executable, "-m", "medialis", OPERATIONS[0].replace("_", "-"), str(file)]
        command += ["-o", str(folder / f"one{number}"), "--no-picture"]
        subprocess.run(command, check=True, capture_output=True)
    wall, used = (value / 10 for value in watch())
    print(f"one command a shape: {wall:.3f} s a shape by the clock, {used:.3f} s of processors")
    watch = Watch()
    for job in plan(OPERATIONS, good, folder / "loop", picture=False):
        run_job(replace(job, threads=medialis.thread_count()))
    wall, loop = (value / len(good) for value in watch())
    print(f"a loop in Python:    {wall:.3f} s a shape by the clock, {loop:.3f} s of processors")
    for workers in dict.fromkeys((1, medialis.thread_count())):
        few = good[: len(good) // 6]
        runs = []
        for number, files in enumerate((few, good)):
            watch = Watch()
            out = folder / f"batch{workers}-{number}"
            medialis.batch(OPERATIONS, files, out, workers=workers, picture=False)
            runs.append(watch())
        (wall, used) = ((b - a) / (len(good) - len(few)) for a, b in zip(*runs, strict=True))
        start = [a - len(few) * each for a, each in zip(runs[0], (wall, used), strict=True)]
        print(
            f"batch, {workers} workers:    {wall:.3f} s a shape by the clock, {used:.3f} s of "
            f"processors, so {1000 * (used - loop):.0f} ms of overhead; once for all to start and "
            f"end the workers: {start[0]:.1f} s by the clock, {start[1]:.1f} s of processors"
        )


def measure_proof(files: list[Path], folder: Path) -> None:
    """Run everything with everything wrong in it, then again, killed half-way and resumed."""
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


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--shapes", type=int, default=200)
    parser.add_argument("--real", type=Path)
    parser.add_argument("--only-speed", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = make_shapes(options.shapes, folder)
        files += sorted(options.real.glob("*.ply")) if options.real else []
        good = [file for number, file in enumerate(files[: options.shapes]) if number % 10 != 9]
        measure_speed(good, folder)
        if not options.only_speed:
            measure_proof(files, folder)


if __name__ == "__main__":
    main()
