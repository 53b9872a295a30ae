"""Benchmark of mapped runs: time, largest memory and bytes on disk of a huge cloud.

    python benchmarks/huge.py [--samples 20000000] [--folder FOLDER] [--limit GIGABYTES]

The rippled torus of `surface_skeleton.py` is written to .npy files block by block, and its skeleton
is computed from them. `--limit` forbids this process more memory of its own than that (mapped files
do not count, the system takes their pages back when it needs them).
"""

from __future__ import annotations

import argparse
import resource
import shutil
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

import medialis


def write_torus(count: int, folder: Path) -> int:
    """Write points.npy and normals.npy of a torus with eight bulges; return the true count."""
    rows = int(np.sqrt(count / 3))
    n = 3 * rows * rows
    points, normals = (
        np.lib.format.open_memmap(folder / f"{name}.npy", "w+", np.float64, (n, 3))
        for name in ("points", "normals")
    )
    u = 2 * np.pi * np.arange(3 * rows) / (3 * rows)
    tube, slope = 0.35 + 0.05 * np.cos(8 * u), -0.4 * np.sin(8 * u)
    ring = np.stack([np.cos(u), np.sin(u), 0 * u], 1)
    along = np.stack([-np.sin(u), np.cos(u), 0 * u], 1)
    up = np.array([0.0, 0.0, 1.0])
    for row, v in enumerate(2 * np.pi * np.arange(rows) / rows):
        here = slice(3 * rows * row, 3 * rows * (row + 1))
        out = np.cos(v) * ring + np.sin(v) * up
        points[here] = ring + tube[:, None] * out
        # The surface moves by slope along `out` and by 1 + tube cos v along the ring.
        across = (1 + tube * np.cos(v))[:, None] * out - slope[:, None] * along
        normals[here] = across / np.linalg.norm(across, axis=1, keepdims=True)
    return n


def own_memory() -> tuple[int, int]:
    """Bytes of this process in memory: of its own, and of mapped files."""
    fields = dict(
        line.split(":")
        for line in Path("/proc/self/status").read_text().splitlines()
        if ":" in line
    )
    return tuple(int(fields[name].split()[0]) * 1024 for name in ("RssAnon", "RssFile"))


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=20_000_000)
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--limit", type=float)
    options = parser.parse_args()
    place = Path(tempfile.mkdtemp(dir=options.folder))
    peak = [0, 0]
    done = threading.Event()

    def watch() -> None:
        while not done.wait(0.2):
            peak[:] = [max(a, b) for a, b in zip(peak, own_memory(), strict=True)]

    try:
        n = write_torus(options.samples, place)
        print(f"{n} samples, {2 * 24 * n / 1e9:.2f} GB of points and normals")
        if options.limit:
            size = int(options.limit * 1e9)
            resource.setrlimit(resource.RLIMIT_DATA, (size, size))
        threading.Thread(target=watch, daemon=True).start()
        progress = medialis.Progress()
        clock, cpu = time.perf_counter(), time.process_time()
        cloud = medialis.huge_surface_skeleton(
            place / "points.npy", place / "normals.npy", place / "out", progress=progress
        )
        seconds, used = time.perf_counter() - clock, time.process_time() - cpu
        done.set()
        stages = ", ".join(f"{name} {value:.1f}" for name, value in progress.seconds.items())
        print(f"{seconds:.1f} s ({used:.1f} s of processors): {stages}")
        print(
            f"largest memory of its own {peak[0] / 1e9:.2f} GB, of mapped files {peak[1] / 1e9:.2f}"
        )
        print(f"valid balls {cloud.valid.mean():.4%}, median radius {np.median(cloud.radii):.5f}")
    finally:
        shutil.rmtree(place)


if __name__ == "__main__":
    main()
