"""Benchmark of the GPU against the processor: balls, skeletons from views, mean shift.

    python benchmarks/gpu.py [--shapes FOLDER] [--minutes 8] [--quick]

Wall time in seconds on all threads, 2 threads and 1 thread of the processor, and in milliseconds on
the GPU: the first run, then the fastest of ten runs with its uploads, kernels and downloads.
`differ` is the number of values whose bits differ. Missing shapes are skipped, and so are runs that
do not fit into the remaining time. numba compiles processor kernels that are not made ahead; GPU
kernels must be made (`make kernels`). Without a GPU the script prints the reason and ends. Results
are saved in benchmarks/results.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from surface_skeleton import REAL, ellipsoid, table

import medialis
from medialis.base import gpu
from medialis.base.errors import GpuError

RESULTS = Path(__file__).resolve().parent / "results"
RUNS = 10
MAX_REPEATED_SECONDS = 10.0
PARTS = ("put", "launch", "get")
BALLS = ("centers", "radii", "features", "status")
VIEWS = (("horse", 500, 512), ("horse", 500, 1024))
SAMPLES = (100_000, 1_000_000, 4_000_000)
POINTS = (50_000, 500_000)


class Clock:
    """Accumulated seconds of each kind of session call."""

    def __init__(self) -> None:
        self.seconds = dict.fromkeys(PARTS, 0.0)
        self._depth = 0
        for name in PARTS:
            setattr(gpu.Session, name, self._timed(name, getattr(gpu.Session, name)))

    def _timed(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            begin, self._depth = time.perf_counter(), self._depth + 1
            try:
                return function(*arguments)
            finally:
                self._depth -= 1
                if self._depth == 0:  # `put` calls itself for tuples
                    self.seconds[name] += time.perf_counter() - begin

        return call


def jobs(folder: Path, quick: bool) -> list[tuple[str, Callable[[], Any], tuple[str, ...]]]:
    """Return the measured operations: name, function, and the compared attributes of its result."""
    found: list[tuple[str, Callable[[], Any], tuple[str, ...]]] = []
    real = {}
    for name in ("horse", "igea", "horse2", "igea2"):
        if (folder / f"{name}.ply").is_file():
            real[name] = medialis.read_shape(folder / f"{name}.ply")
    made = {f"ellipsoid, {n:,}": ellipsoid(n) for n in SAMPLES[: 1 if quick else None]}
    for name, shape in {**real, **made}.items():
        found += [
            (f"balls of {name}, tolerance {tolerance:g}", _balls(shape, tolerance), BALLS)
            for tolerance in (0.0, 3e-4)
        ]
    if "horse" in real:
        for name, pairs, size in VIEWS[: 1 if quick else None]:
            work = _views(real[name], pairs, size)
            found.append((f"{pairs} views of {name}, {size} pixels", work, ("nodes", "radii")))
    for count in POINTS[: 1 if quick else None]:
        radius = 0.05 * (POINTS[0] / count) ** (1 / 3)  # as many points within it
        points = np.random.default_rng(0).random((count, 3))
        found.append((f"mean shift, {count:,}", _shift(points, radius), ("labels", "centers")))
    return found


def _balls(shape: medialis.Shape, tolerance: float) -> Callable[[], Any]:
    return lambda: medialis.shrink_balls(shape, tolerance=tolerance)


def _views(shape: medialis.Shape, pairs: int, size: int) -> Callable[[], Any]:
    return lambda: medialis.view_curve_skeleton(shape, pairs=pairs, size=size)


def _shift(points: Any, radius: float) -> Callable[[], Any]:
    return lambda: medialis.mean_shift(points, search_radius=radius)


def run(work: Callable[[], Any], device: Any, threads: int | None) -> tuple[float, Any]:
    """Return the seconds of an operation, and its result."""
    medialis.forget()
    with medialis.use_device(device), medialis.thread_limit(threads):
        begin = time.perf_counter()
        result = work()
        return time.perf_counter() - begin, result


def differing(first: Any, second: Any, names: tuple[str, ...]) -> int | str:
    """Count values whose bits differ."""
    count = 0
    for name in names:
        a, b = (np.ascontiguousarray(getattr(one, name)) for one in (first, second))
        if a.shape != b.shape:
            return f"{len(a)} {name} and {len(b)}"
        bits = (one.view(f"u{one.itemsize}") for one in (a, b))
        count += int(np.not_equal(*bits).sum())
    return count


def measure(
    name: str, work: Callable[[], Any], compared: tuple[str, ...], clock: Clock, end: float
) -> dict[str, Any]:
    """Return a row of the table, without the runs that do not fit into the time."""
    row: dict[str, Any] = {"what": name}
    every = medialis.thread_count()

    def fits(seconds: float) -> bool:
        return time.perf_counter() + seconds < end

    seconds, expected = run(work, "cpu", None)
    if seconds < MAX_REPEATED_SECONDS:  # the first run may have compiled kernels
        seconds = min(seconds, *(run(work, "cpu", None)[0] for _ in range(3)))
    row[f"{every} threads"] = seconds
    before = dict(clock.seconds)
    seconds, found = run(work, "gpu", None)
    row["first_ms"] = 1e3 * seconds
    if clock.seconds["launch"] == before["launch"]:
        return {**row, "note": "the GPU was not used"}
    row["differ"] = differing(expected, found, compared)
    best = None
    for _ in range(RUNS):
        if best is not None and not fits(2 * best[0]):
            break
        before = dict(clock.seconds)
        seconds, _ = run(work, "gpu", None)
        parts = [clock.seconds[part] - before[part] for part in PARTS]
        best = min(best or (seconds, parts), (seconds, parts))
    assert best is not None
    names = "whole_ms", "upload_ms", "kernels_ms", "download_ms"
    row |= {name: 1e3 * one for name, one in zip(names, (best[0], *best[1]), strict=True)}
    for threads in {1, 2} - {every}:
        likely = row[f"{every} threads"] * every / threads
        if fits(likely + 60):
            row[f"{threads} threads"] = run(work, "cpu", threads)[0]
    return row


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--shapes", type=Path, default=REAL, help="folder of horse.ply and others")
    parser.add_argument("--minutes", type=float, default=8.0, help="time limit of the benchmark")
    parser.add_argument("--quick", action="store_true", help="only the smallest of each kind")
    parser.add_argument("--output", type=Path, default=RESULTS / "gpu.json")
    options = parser.parse_args()
    end = time.perf_counter() + 60 * options.minutes
    try:
        found = gpu.opened_gpu()
        gpu.kernel_names()
    except GpuError as error:
        print(f"Not measured: {error}")
        return
    print(f"{found.name}, driver for CUDA {found.driver}, Python {sys.version.split()[0]}")
    clock, rows = Clock(), []
    for name, work, compared in jobs(options.shapes, options.quick):
        if time.perf_counter() > end - 30:
            rows.append({"what": name, "note": "no time was left"})
            continue
        rows.append(measure(name, work, compared, clock, end))
        print(table(rows[-1:]), flush=True)
        options.output.parent.mkdir(parents=True, exist_ok=True)
        about = {"gpu": found.name, "driver": found.driver, "rows": rows}
        options.output.write_text(json.dumps(about, indent=1))
    print(table(rows))


if __name__ == "__main__":
    main()
