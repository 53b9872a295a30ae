"""Benchmark of ball shrinking (thesis 3.2, Table 1): one command prints and saves all tables.

    python benchmarks/surface_skeleton.py [SHAPE.ply ...] [--quick]

Without files it uses the shapes in ../shared/shapes where they exist, else a generated one. Every
figure is the smallest of several runs in this process, with compiled kernels; ratios compare runs
of the same process. Results are also saved as benchmarks/results/surface_skeleton.{md,json}.
"""

from __future__ import annotations

import argparse
import json
import platform
import time
import tracemalloc
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

import medialis
from medialis.skeleton.medial_cloud import DEFAULT_TOLERANCE

HERE = Path(__file__).resolve().parent
REAL = HERE.parent.parent / "shared" / "shapes"
NAMES = ("armadillo", "bunny", "dragon", "horse", "horse2", "elephant", "igea", "igea2", "scapula")


def ellipsoid(count: int) -> medialis.Shape:
    """Fibonacci samples of the ellipsoid (1, 0.7, 0.4) with exact normals."""
    return _scaled_sphere(count, np.array([1.0, 0.7, 0.4]))


def sphere(count: int) -> medialis.Shape:
    """Exact sphere: all samples are equidistant from the center, the worst case."""
    return _scaled_sphere(count, np.ones(3))


def _scaled_sphere(count: int, axes: np.ndarray) -> medialis.Shape:
    i = np.arange(count) + 0.5
    z, turn = 1 - 2 * i / count, np.pi * (1 + 5**0.5) * i
    unit = np.stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z], 1)
    normals = unit / axes
    return medialis.Shape(unit * axes, normals / np.linalg.norm(normals, axis=1, keepdims=True))


def rippled_torus(count: int) -> medialis.Shape:
    """Sample a torus with eight bulges evenly in its two angles, with exact normals."""
    rows = int(np.sqrt(count / 3))
    u, v = np.meshgrid(
        2 * np.pi * np.arange(3 * rows) / (3 * rows), 2 * np.pi * np.arange(rows) / rows
    )
    u, v = u.ravel(), v.ravel()
    tube, slope = 0.35 + 0.05 * np.cos(8 * u), -0.4 * np.sin(8 * u)
    ring = np.stack([np.cos(u), np.sin(u), 0 * u], 1)
    along = np.stack([-np.sin(u), np.cos(u), 0 * u], 1)
    up = np.array([0.0, 0.0, 1.0])
    out = np.cos(v)[:, None] * ring + np.sin(v)[:, None] * up
    points = ring + tube[:, None] * out
    by_u = along * (1 + tube * np.cos(v))[:, None] + slope[:, None] * out
    by_v = tube[:, None] * (-np.sin(v)[:, None] * ring + np.cos(v)[:, None] * up)
    normals = np.cross(by_u, by_v)
    return medialis.Shape(points, normals / np.linalg.norm(normals, axis=1, keepdims=True))


def batched_kdtree(shape: medialis.Shape, workers: int = 1) -> np.ndarray:
    """Shrink balls as anyone would write it: batched nearest-neighbour queries (the baseline).

    It already drops balls that have converged; `workers` is that of scipy's query (its default: 1).
    """
    points, normals = shape.points, shape.normals
    tree = cKDTree(points)
    radii = np.full(len(points), shape.diagonal / 2)
    active = np.arange(len(points))
    for _ in range(100):
        if len(active) == 0:
            break
        p, n, r = points[active], normals[active], radii[active]
        distance, near = tree.query(p - r[:, None] * n, workers=workers)
        q = points[near]
        square, height = ((q - p) ** 2).sum(1), ((p - q) * n).sum(1)
        smaller = (near != active) & (distance < r * (1 - 1e-9)) & (height > 0) & (square > 0)
        active, near = active[smaller], near[smaller]
        radii[active] = square[smaller] / (2 * height[smaller])
    return radii


def best_seconds(run: object, repeats: int) -> tuple[float, dict[str, float]]:
    """Smallest wall time of several runs, with the seconds of its stages."""
    best, stages = np.inf, {}
    for _ in range(repeats):
        progress = medialis.Progress()
        clock = time.perf_counter()
        run(progress)
        seconds = time.perf_counter() - clock
        if seconds < best:
            best, stages = seconds, dict(progress.seconds)
    return best, stages


def peak_bytes(shape: medialis.Shape) -> float:
    """Peak of all arrays made while the skeleton is computed, bytes a sample."""
    tracemalloc.start()
    medialis.surface_skeleton(shape)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak / shape.point_count


def measure(name: str, shape: medialis.Shape, repeats: int, exact: bool = True) -> dict:
    """One row of the table."""

    def default(progress: medialis.Progress) -> None:
        medialis.surface_skeleton(shape, progress=progress)

    seconds, stages = best_seconds(default, repeats)
    with medialis.thread_limit(1):
        single, _ = best_seconds(default, repeats)
    row = {
        "shape": name,
        "samples": shape.point_count,
        "tree_s": stages["tree"],
        "balls_s": stages["balls"],
        "total_s": seconds,
        "speedup_of_threads": single / seconds,
        "peak_bytes_a_sample": peak_bytes(shape),
        "valid_balls": int(medialis.surface_skeleton(shape).valid.sum()),
    }
    if exact:
        row["exact_s"], _ = best_seconds(
            lambda p: medialis.surface_skeleton(shape, tolerance=0, progress=p), repeats
        )
    return row


def table(rows: list[dict]) -> str:
    """Rows as a Markdown table."""
    names = list(dict.fromkeys(key for row in rows for key in row))
    lines = ["| " + " | ".join(names) + " |", "|" + "---|" * len(names)]
    for row in rows:
        cells = [row.get(name, "") for name in names]
        shown = [f"{c:.3f}" if isinstance(c, float) and c < 100 else f"{c:.0f}"
                 if isinstance(c, float) else str(c) for c in cells]  # fmt: skip
        lines.append("| " + " | ".join(shown) + " |")
    return "\n".join(lines)


def growth(make: object, counts: list[int], repeats: int) -> tuple[list[dict], float]:
    """Return times for growing samples of one surface, and the fitted exponent."""
    rows = []
    for count in counts:
        shape = make(count)
        seconds, _ = best_seconds(
            lambda p, s=shape: medialis.surface_skeleton(s, progress=p), repeats
        )
        rows.append(
            {"surface": make.__name__, "samples": shape.point_count, "total_s": seconds,
             "microseconds_a_sample": 1e6 * seconds / shape.point_count}
        )  # fmt: skip
    logs = np.log([[row["samples"], row["total_s"]] for row in rows])
    return rows, float(np.polyfit(logs[:, 0], logs[:, 1], 1)[0])


def main() -> None:
    """Measure, print and save."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="*", help="meshes to measure instead of the usual ones")
    parser.add_argument("--quick", action="store_true", help="few and small shapes")
    options = parser.parse_args()
    repeats = 2 if options.quick else 5
    medialis.surface_skeleton(medialis.organic_shape(56))  # compile

    files = [Path(f) for f in options.files]
    if not files and REAL.is_dir():
        files = [REAL / f"{name}.ply" for name in (NAMES[:2] if options.quick else NAMES)]
    shapes = {path.stem: medialis.read_shape(path) for path in files}
    if not shapes:
        shapes = {"organic": medialis.organic_shape(128 if options.quick else 400)}

    parts = [f"# Ball shrinking\n\n{platform.processor() or platform.machine()}, "
             f"{medialis.thread_count()} threads, Python {platform.python_version()}, "
             f"default tolerance {DEFAULT_TOLERANCE:g} of the diagonal.\n"]  # fmt: skip
    rows = [measure(name, shape, repeats) for name, shape in shapes.items()]
    if not options.files:
        rows.append(measure("ellipsoid", ellipsoid(100_000), repeats))
        rows.append(measure("sphere", sphere(100_000), repeats, exact=False))
    parts.append(table(rows))

    first = next(iter(shapes))
    found: dict[int, np.ndarray] = {}
    seconds = {
        workers: best_seconds(
            lambda p, w=workers: found.update({w: batched_kdtree(shapes[first], w)}), 2
        )[0]
        for workers in (1, -1)
    }
    slow = found[1]
    exact = medialis.surface_skeleton(shapes[first], tolerance=0)
    same = np.abs(slow - exact.radii)[exact.valid] <= 1e-6 * shapes[first].diagonal
    ratios = {
        "shape": first,
        "ckdtree_s": seconds[1],
        "ckdtree_all_threads_s": seconds[-1],
        "same_radius_share": float(same.mean()),
        "ratio_exact": seconds[1] / rows[0]["exact_s"],
        "ratio_default": seconds[1] / rows[0]["total_s"],
        "ratio_default_all_threads": seconds[-1] / rows[0]["total_s"],
    }
    parts.append("\n## Against batched scipy.spatial.cKDTree queries\n\n" + table([ratios]))

    growths = {}
    counts = (
        [10_000, 30_000, 100_000]
        if options.quick
        else [10_000, 30_000, 100_000, 300_000, 1_000_000]
    )
    for make in (ellipsoid, rippled_torus):
        some, exponent = growth(make, counts, min(repeats, 3))
        growths[make.__name__] = {"rows": some, "exponent": exponent}
        parts.append(f"\n## Growth: {make.__name__}, exponent {exponent:.3f}\n\n" + table(some))

    text = "\n".join(parts) + "\n"
    print(text)
    results = HERE / "results"
    results.mkdir(exist_ok=True)
    (results / "surface_skeleton.md").write_text(text)
    (results / "surface_skeleton.json").write_text(
        json.dumps({"rows": rows, "baseline": ratios, "growth": growths}, indent=2)
    )
    print(f"saved in {results}")


if __name__ == "__main__":
    main()
