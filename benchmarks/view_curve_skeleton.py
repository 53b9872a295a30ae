"""Benchmark of curve skeletons from views (thesis 3.7): graphs found, seconds, memory, renderers.

    python benchmarks/view_curve_skeleton.py [graphs rotations blender] [--shapes A,B] [--quick]

Needs the shapes in ../shared/shapes; blender needs a Python with bpy. Prints tables and saves them
in benchmarks/results. Seconds of processor time are those of all threads together.
"""

from __future__ import annotations

import argparse
import resource
import sys
import time
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree
from surface_skeleton import REAL, table

import medialis
from medialis.curves.from_views.views import camera_pairs, sphere_of

RESULTS = Path(__file__).resolve().parent / "results"
SHAPES = ("hand", "horse", "fertility", "elephant", "armadillo", "rockerarm", "cow")
STAGES = ("pairs", "sharpen", "link")
SETTINGS = ((100, 512), (500, 1024))


def graphs(names: list[str], settings: tuple[tuple[int, int], ...]) -> list[dict]:
    """Return what is found, and what it costs."""
    rows = []
    for name in names:
        shape = medialis.read_shape(REAL / f"{name}.ply")
        medialis.view_curve_skeleton(shape, pairs=2, size=64)  # compiled
        for pairs, size in settings:
            clock, used = time.perf_counter(), time.process_time()
            result = medialis.run("view_curve_skeleton", shape, pairs=pairs, size=size)
            seconds, processor = time.perf_counter() - clock, time.process_time() - used
            rows.append(
                {
                    "shape": name, "vertices": shape.point_count, "pairs": pairs, "size": size,
                    **{key: result.values[key] for key in
                       ("components", "loops", "end_points", "junctions", "nodes", "points")},
                    "seconds": seconds, "processor": processor,
                    **{f"{stage}_s": result.seconds[stage] for stage in STAGES},
                    "peak_MB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
                }
            )  # fmt: skip
            print(table(rows[-1:]), flush=True)
    return rows


def rotations(names: list[str], count: int = 10) -> list[dict]:
    """Distance of the skeletons of rotated shapes from the first, per cent of the diagonal."""
    rows = []
    for name in names:
        shape = medialis.read_shape(REAL / f"{name}.ply")
        own = medialis.view_curve_skeleton(shape, pairs=100, size=512)
        line = _line(own)
        for number in range(count):
            turn = np.linalg.qr(np.random.default_rng(number).normal(size=(3, 3)))[0]
            turn *= np.linalg.det(turn)
            turned = medialis.Shape(shape.points @ turn.T, shape.normals @ turn.T, shape.faces)
            other = medialis.view_curve_skeleton(turned, pairs=100, size=512)
            away = 100 * cKDTree(line).query(_line(other) @ turn)[0] / shape.diagonal
            rows.append(
                {"shape": name, "rotation": number, "loops": other.loops,
                 "ends": len(other.end_points), "median": float(np.median(away)),
                 "p90": float(np.quantile(away, 0.9)), "max": float(away.max())}
            )  # fmt: skip
        print(table(rows[-count:]), flush=True)
    return rows


def _line(curve: medialis.CurveSkeleton) -> np.ndarray:
    a, b = curve.nodes[curve.edges[:, 0]], curve.nodes[curve.edges[:, 1]]
    return np.concatenate([a + t * (b - a) for t in np.linspace(0, 1, 9)])


def blender(names: list[str], size: int = 1024, pairs: int = 10) -> list[dict]:
    """Milliseconds a view: Blender's gpu module against the rasterizer."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
    import bpy
    from blender_addon.views import GpuViews, why_no_gpu

    reason = why_no_gpu()
    if reason is not None:
        sys.exit(f"Blender cannot draw here: {reason}")
    rows = []
    for name in names:
        shape = medialis.read_shape(REAL / f"{name}.ply")
        center, radius = sphere_of(shape.points)
        cameras = [
            camera
            for pair in camera_pairs(center, radius, pairs=pairs, angle=0.35, size=size)
            for camera in pair
        ]
        core = medialis.rasterizer(shape)
        graphics = GpuViews(core.points, core.faces)
        row: dict = {"bpy": bpy.app.version_string, "shape": name, "faces": shape.face_count}
        seen = {}
        for kind, source in (("core", core), ("blender", graphics)):
            source(cameras[:2])
            clock = time.perf_counter()
            seen[kind] = source(cameras)
            row[f"{kind}_ms"] = 1000 * (time.perf_counter() - clock) / len(cameras)
        same = [(a.mask == b.mask).mean() for a, b in zip(*seen.values(), strict=True)]
        rows.append({**row, "same_pixels_percent": f"{100 * min(same):.4f}"})
        print(table(rows[-1:]), flush=True)
    return rows


def main() -> None:
    """Run the chosen tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*", default=["graphs"])
    parser.add_argument("--shapes", default="")
    parser.add_argument("--quick", action="store_true", help="100 pairs of 512 pixels only")
    options = parser.parse_args()
    names = options.shapes.split(",") if options.shapes else list(SHAPES)
    RESULTS.mkdir(exist_ok=True)
    for part in options.parts:
        if part == "graphs":
            rows = graphs(names, SETTINGS[:1] if options.quick else SETTINGS)
        elif part == "rotations":
            rows = rotations(names)
        elif part == "blender":
            rows = blender(names)
        else:
            parser.error(f"unknown part {part}: graphs, rotations, blender")
        (RESULTS / f"view_curve_skeleton_{part}.md").write_text(table(rows), encoding="utf-8")


if __name__ == "__main__":
    main()
