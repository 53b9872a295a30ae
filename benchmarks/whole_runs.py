"""What whole runs cost, file to file, by stage, in units of a kd-tree build and query.

    python benchmarks/whole_runs.py                        measure, and compare with what is stored
    python benchmarks/whole_runs.py --write                store it, and write docs/whole_runs.md
    python benchmarks/whole_runs.py --shapes scan cup      these alone; also --operations NAME ...
    python benchmarks/whole_runs.py --files horse.ply ...  files of your own, nothing is stored
    python benchmarks/whole_runs.py --growth               how times grow with the samples; stored

Each run reads a PLY file, computes one operation with nothing kept from others, and writes its
result without pictures. U is the processor time of `cKDTree(points).query(points, k=2)`, build
included, of the vertices of the file; all times are processor seconds of this process. Where U is
below a thousandth of a second it says little: `--files` prints seconds as well.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from accuracy_suite.known import grid_mesh, mesh_of
from accuracy_suite.sections import lathe, turned_out
from scipy.spatial import cKDTree

import medialis
from medialis.base.progress import Progress
from medialis.formats.ply_attributes import write_ply
from medialis.show.writing import Pictures, write_result

HERE = Path(__file__).parent
STORED, PAGE = HERE / "whole_runs.json", HERE.parent / "docs" / "whole_runs.md"

LOUDER, LEAST = 1.5, 1.0
"""A stage is named that takes more than this many times its stored ratio, and a unit more."""

LARGE = 200_000
"""Vertices from which only the operations of MAIN are run."""

MAIN = ("surface_skeleton", "skeleton_importance", "thickness", "curve_skeleton", "parts")
GIVEN = {
    "surface_skeleton": {"importance": False},
    "geodesic_path": {"start": 0, "end": 1},
    "view_curve_skeleton": {"pairs": 40, "size": 256},
}

GROWING = {"knot": lambda count: knot(count), "thin shell": lambda count: cup(count)}
GROWTH = "growth"
SIZES = (50_000, 200_000)
"""Shapes and numbers of vertices between which growth is measured."""

Row = dict[str, float]


def knot(count: int, noise: float = 0.0) -> medialis.Shape:
    """Return a tube along a knot whose radius goes up and down; noise in spacings."""
    columns = round((count / 16) ** 0.5)

    def surface(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        t = 2 * np.pi * u / (16 * columns)
        reach = 2 + np.cos(3 * t)
        line = np.stack([reach * np.cos(2 * t), reach * np.sin(2 * t), np.sin(3 * t)], axis=1)
        out = np.stack([np.cos(2 * t), np.sin(2 * t), np.zeros(len(t))], axis=1)
        radius = 0.4 * (1 + 0.3 * np.cos(12 * t))[:, None]
        turn = 2 * np.pi * v[:, None]
        return line + radius * (np.cos(turn) * out + np.sin(turn) * [0.0, 0.0, 1.0])

    rows = np.arange(16 * columns)
    shape = turned_out(grid_mesh(surface, rows, columns, free=rows < 0, poles=False))
    if noise == 0.0:
        return shape
    step = np.random.default_rng(0).normal(size=shape.points.shape)
    return mesh_of(shape.points + noise * shape.spacing * step, np.asarray(shape.faces))


def cup(count: int = 15_611) -> medialis.Shape:
    """Return a thin shell of about so many vertices: a wall of 1.5 % of its height."""
    t = np.linspace(0.0, 1.0, 40)
    wall = np.stack([0.3 + 0.2 * np.sqrt(t), t], axis=1)
    inner = wall[::-1] - [0.015, 0.0]
    inner[-1, 1] = 0.015
    profile = np.concatenate([[[0.0, 0.0]], wall, inner, [[0.0, 0.015]]])
    return lathe(profile, 0.026 * (15_611 / count) ** 0.5, None, closed=False)


def pipe() -> medialis.Shape:
    """Return a pipe of 160 vertices: 160 slivers, and fans of slivers as its oblique ends."""
    turn = 2 * np.pi * np.arange(80) / 80
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    ends = [np.column_stack([ring, z + slope * ring[:, 0]]) for z, slope in ((0, -0.5), (20, 0.5))]
    i = np.arange(80)
    j = (i + 1) % 80
    cap = np.stack([np.zeros(78, int), i[1:-1], i[2:]], axis=1)
    side = np.concatenate([np.stack([i, j, j + 80], 1), np.stack([i, j + 80, i + 80], 1)])
    return mesh_of(np.concatenate(ends), np.concatenate([side, cap[:, ::-1], cap + 80]))


def plate() -> medialis.Shape:
    """Return a round plate, a fortieth as thick as wide, of about 15,000 vertices."""
    profile = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.05], [0.0, 0.05]])
    return lathe(profile, 0.03, None, closed=False)


def beads() -> medialis.Shape:
    """Return 200 parts of some 100 vertices."""
    t = np.linspace(-np.pi / 2, np.pi / 2, 10)
    profile = 0.4 * np.stack([np.cos(t), np.sin(t)], axis=1)
    profile[[0, -1], 0] = 0.0
    ball = lathe(profile, 1.0, None, closed=False, columns=14)
    places = np.stack(np.meshgrid(*map(np.arange, (10, 5, 4)), indexing="ij"), -1).reshape(-1, 3)
    points = (ball.points + places[:, None]).reshape(-1, 3)
    faces = ball.faces + ball.point_count * np.arange(len(places))[:, None, None]
    return mesh_of(points, faces.reshape(-1, 3))


def cloud() -> medialis.Shape:
    """Return 50,000 points with normals and no faces."""
    mesh = knot(50_000)
    return medialis.Shape(mesh.points, mesh.normals)


SHAPES: dict[str, Callable[[], medialis.Shape]] = {
    "creature": lambda: medialis.organic_shape(120),
    "knot": lambda: knot(50_000),
    "scan": lambda: knot(50_000, noise=0.2),
    "cup": cup,
    "pipe": pipe,
    "plate": plate,
    "beads": beads,
    "cloud": cloud,
    "knot 500k": lambda: knot(500_000),
    "knot 1M": lambda: knot(1_000_000),
}


@contextmanager
def processor_clock() -> Iterator[None]:
    """Let stages be timed by processor seconds."""
    before, time.perf_counter = time.perf_counter, time.process_time
    try:
        yield
    finally:
        time.perf_counter = before


def seconds(work: Callable[[], object]) -> float:
    """Return the processor seconds of a call."""
    clock = time.process_time()
    work()
    return time.process_time() - clock


def unit(path: Path) -> float:
    """Return U of the vertices of a file: the middle of three, or of more where it is short."""
    points = np.array(medialis.read_shape(path).points)
    first = seconds(lambda: cKDTree(points).query(points, k=2))
    more = [
        seconds(lambda: cKDTree(points).query(points, k=2)) for _ in range(2 + (first < 0.05) * 8)
    ]
    return float(np.median([first, *more]))


def run(path: Path, operation: str) -> Row:
    """Return the processor seconds of a run, whole and by stage."""
    medialis.forget()
    clock, progress = time.process_time(), Progress()
    with tempfile.TemporaryDirectory() as folder, processor_clock():
        with progress.stage("reading", 0.0, 0.1):
            shape = medialis.read_shape(path, progress=progress.unnamed)
        result = medialis.run(operation, shape, progress=progress, **GIVEN.get(operation, {}))
        with progress.stage("writing", 0.9, 1.0):
            write_result(result, folder, source=str(path), pictures=Pictures(main=False))
    return {"whole": time.process_time() - clock, **progress.seconds}


def measured(path: Path, operations: list[str]) -> Iterator[tuple[str, Row]]:
    """Run operations on a file; give their times in units, the second of two runs each."""
    one = unit(path)
    shape = medialis.read_shape(path)
    for name in operations:
        chosen = medialis.operation(name)
        large = shape.point_count >= LARGE and name not in MAIN
        if large or (chosen.needs_faces and shape.faces is None):
            continue
        try:
            if shape.point_count < LARGE:
                run(path, name)  # compiles, and warms up
            row = {stage: round(value / one, 2) for stage, value in run(path, name).items()}
        except medialis.MedialisError as error:
            print(f"  {name}: {error}", flush=True)
            continue
        stages = " ".join(f"{k} {v:g}" for k, v in row.items() if v >= 0.5 and k != "total")
        print(f"  {name} ({row['whole'] * one:.2f} s): {stages}", flush=True)
        yield name, {"U": float(f"{one:.4g}"), **row}


def growth(operations: list[str]) -> Iterator[tuple[str, str, float]]:
    """Measure the power of the vertices with which the time of each operation grows."""
    for shape, made in GROWING.items():
        with tempfile.TemporaryDirectory() as folder:
            paths = [Path(folder) / f"{count}.ply" for count in SIZES]
            counts = [written(made(n), path) for n, path in zip(SIZES, paths, strict=True)]
            for name in operations:
                run(paths[0], name)  # compiles
                few, many = (run(path, name)["whole"] for path in paths)
                power = float(np.log(many / few) / np.log(counts[1] / counts[0]))
                print(f"{shape}, {name}: {few:.2f} s, {many:.2f} s, n^{power:.2f}", flush=True)
                yield shape, name, round(power, 2)


def written(shape: medialis.Shape, path: Path) -> int:
    """Write a shape as a file; return how many vertices it has."""
    normals = dict(zip(("nx", "ny", "nz"), shape.normals.T, strict=True))
    write_ply(path, shape.points, shape.faces, attributes=normals)
    return shape.point_count


def louder(now: Row, stored: Row) -> list[str]:
    """Return sentences about stages that have grown."""
    return [
        f"{stage}: {now[stage]:g} U, {before:g} U before"
        for stage, before in stored.items()
        if stage in now and stage != "U" and now[stage] > max(LOUDER * before, before + LEAST)
    ]


def page(stored: dict[str, dict[str, Row]]) -> str:
    """Return the page of the docs."""
    table = {shape: rows for shape, rows in stored.items() if shape != GROWTH}
    text = [
        "# Whole runs\n",
        "`python benchmarks/whole_runs.py --write` measures this: a PLY file read, one operation,",
        "its result written, without pictures, compiled, in processor seconds. U is the time of",
        "`cKDTree(points).query(points, k=2)`, build included, of the vertices of the file. Runs",
        "with all stages are in `benchmarks/whole_runs.json`; without `--write` the benchmark says",
        "which stages have grown.\n",
        "| shape | vertices | U in s | " + " | ".join(n.replace("_", " ") for n in MAIN) + " |",
        "|---|---|---|" + "---|" * len(MAIN),
    ]
    for shape, rows in table.items():
        first = next(iter(rows.values()))
        cells = [_cell(rows.get(name)) for name in MAIN]
        text.append(
            f"| {shape} | {first['vertices']:,.0f} | {first['U']:.3g} | {' | '.join(cells)} |"
        )
    text += ["\nOther operations, in U (seconds):\n", "| shape | runs |", "|---|---|"]
    for shape, rows in table.items():
        others = [f"{n} {_cell(row)}" for n, row in rows.items() if n not in MAIN]
        if others:
            text.append(f"| {shape} | {', '.join(others).replace('_', ' ')} |")
    powers = stored.get(GROWTH, {})
    if powers:
        few, many = SIZES
        text += [
            f"\n## Growth\n\nFrom {few:,} to {many:,} vertices of the same surface times grow as "
            "the vertices to this power; 1 is in proportion.\n",
            "| operation | " + " | ".join(GROWING) + " |",
            "|---|" + "---|" * len(GROWING),
        ]
        for name in dict.fromkeys(operation for rows in powers.values() for operation in rows):
            cells = [f"{powers.get(shape, {}).get(name, np.nan):.2f}" for shape in GROWING]
            text.append(f"| {name.replace('_', ' ')} | {' | '.join(cells)} |")
    return "\n".join(text) + "\n"


def _cell(row: Row | None) -> str:
    if row is None:
        return ""
    units, seconds = row["whole"], row["whole"] * row["U"]
    return (
        f"{units:.3g} U ({seconds:.2g} s)" if units < 999.5 else f"{units:,.0f} U ({seconds:.2g} s)"
    )


def main() -> int:
    """Measure, compare, and write where that is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--shapes", nargs="+", choices=SHAPES, default=list(SHAPES), metavar="NAME")
    every = [chosen.name for chosen in medialis.OPERATIONS]
    parser.add_argument("--operations", nargs="+", choices=every, default=every, metavar="NAME")
    parser.add_argument("--files", nargs="+", type=Path)
    parser.add_argument("--growth", action="store_true")
    given = parser.parse_args()
    if given.files:
        for path in given.files:
            print(path.stem)
            list(measured(path, given.operations))
        return 0
    stored = json.loads(STORED.read_text()) if STORED.exists() else {}
    if given.growth:
        for shape, name, power in growth(given.operations):
            stored.setdefault(GROWTH, {}).setdefault(shape, {})[name] = power
            STORED.write_text(json.dumps(stored, indent=1) + "\n")
        PAGE.write_text(page(stored))
        return 0
    grown = []
    with tempfile.TemporaryDirectory() as folder:
        for name in given.shapes:
            shape, path = SHAPES[name](), Path(folder) / "shape.ply"
            written(shape, path)
            print(f"{name}: {shape.point_count} vertices", flush=True)
            for operation, row in measured(path, given.operations):
                rows = stored.setdefault(name, {})
                grown += [f"{name}, {operation}, {g}" for g in louder(row, rows.get(operation, {}))]
                if given.write:
                    rows[operation] = {"vertices": shape.point_count, **row}
                    STORED.write_text(json.dumps(stored, indent=1) + "\n")
                    PAGE.write_text(page(stored))
    print("\n".join(grown))
    return 1 if grown else 0


if __name__ == "__main__":
    sys.exit(main())
