"""How much curve skeletons change when a shape is told otherwise, and trees with known axes.

    python benchmarks/stability.py MESH ...     # turned, scaled, remeshed, coarse, noisy, holed
    python benchmarks/stability.py MESH ... --fields   # thickness and parts of the same copies
    python benchmarks/stability.py MESH ... --sure     # parts and thin spots by their persistence
    python benchmarks/stability.py --trees 10   # trees of swept balls, as they are and coarser

Tables in Markdown. Meshes of more than 30,000 faces are decimated to so many first, by
pymeshlab, as are coarse copies.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from stability_suite.changes import changes, decimated
from stability_suite.measures import along, hausdorff, rand_index, tree_row, values_at
from stability_suite.sure import PARTS_FROM, SPOTS_FROM, rows_of, table
from stability_suite.trees import TREES, grown_tree, meshed

import medialis

MOST_FACES = 30_000
COARSE = (20_000, 5_000, 2_000)
"""Faces of copies of trees."""

FIELDS = ("thickness", "parts")
"""Operations, and arrays of theirs."""


def main() -> None:
    """Measure what is asked for and print it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("paths", nargs="*")
    parser.add_argument("--trees", type=int, default=0)
    parser.add_argument("--fields", action="store_true")
    parser.add_argument("--sure", action="store_true")
    given = parser.parse_args()
    if given.paths:
        what = print_sure if given.sure else print_fields if given.fields else print_changes
        what(given.paths)
    if given.trees:
        print_trees(given.trees)


def graph_of(shape: medialis.Shape) -> medialis.CurveSkeleton:
    """Return the curve skeleton at the defaults."""
    return medialis.run("curve_skeleton", shape).graph


def print_changes(paths: list[str]) -> None:
    """Print how ends and places of graphs change, over all meshes."""
    found: dict[str, list[tuple[bool, bool, float]]] = {name: [] for name in changes()}
    for shape in map(read, paths):
        graph = graph_of(shape)
        places, ends = along(graph), len(graph.end_points)
        for name, (change, scale, turn) in changes().items():
            other = graph_of(change(shape))
            there = along(other) @ turn / scale
            far = 100 * hausdorff(places, there) / shape.diagonal
            row = len(other.end_points) == ends, other.loops == graph.loops, far
            found[name].append(row)
    print(
        "| change | ends the same | loops the same | Hausdorff median / worst, % |\n"
        "|---|---|---|---|"
    )
    for name, rows in found.items():
        ends, loops = (sum(row[k] for row in rows) for k in (0, 1))
        far = [row[2] for row in rows]
        most = f"{np.median(far):.1f} / {max(far):.1f}"
        print(f"| {name} | {ends} of {len(rows)} | {loops} of {len(rows)} | {most} |")


def read(path: str) -> medialis.Shape:
    """Return a mesh of not too many faces."""
    shape = medialis.read_shape(path)
    return decimated(shape, MOST_FACES) if shape.face_count > MOST_FACES else shape


def print_fields(paths: list[str]) -> None:
    """Print how thickness and parts change at the vertices of the given meshes."""
    found: dict[str, list[tuple[float, float, float]]] = {name: [] for name in changes()}
    for shape in map(read, paths):
        thick, part = fields_at(shape, shape.points)
        for name, (change, scale, turn) in changes().items():
            other, label = fields_at(change(shape), scale * shape.points @ turn.T)
            off = 100 * np.abs(other / scale / thick - 1)
            row = float(np.median(off)), float(np.quantile(off, 0.99)), rand_index(part, label)
            found[name].append(row)
    print(
        "| change | thickness: median, in the median / worst, % | 99 of 100 places, % | "
        "parts: Rand index, median / worst |\n|---|---|---|---|"
    )
    for name, rows in found.items():
        usual, most, same = np.array(rows).T
        print(
            f"| {name} | {np.median(usual):.2f} / {usual.max():.1f} | "
            f"{np.median(most):.1f} / {most.max():.0f} | {np.median(same):.3f} / {same.min():.3f} |"
        )


def print_sure(paths: list[str]) -> None:
    """Print how many parts and thin spots are in all copies, by their persistence."""
    parts, spots = [], []
    for shape in map(read, paths):
        more = rows_of(shape)
        parts += more[0]
        spots += more[1]
    print(table("parts", parts, PARTS_FROM))
    print(table("thin spots", spots, SPOTS_FROM))


def fields_at(shape: medialis.Shape, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return thickness and part at the samples that are nearest to places."""
    return tuple(values_at(medialis.run(name, shape), name, places) for name in FIELDS)


def print_trees(count: int) -> None:
    """Print how many limbs of trees are found, and how well."""
    rows: dict[str, list[dict[str, float]]] = {}
    for number, (limbs, thinnest, rings) in enumerate(TREES[:count]):
        tree = grown_tree(np.random.default_rng(number), limbs, thinnest, rings)
        fine = meshed(tree, max(0.035, 0.45 * thinnest))
        for faces in COARSE:
            shape = decimated(fine, faces) if faces < fine.face_count else fine
            clock = time.process_time()
            graph = graph_of(shape)
            row = tree_row(graph.nodes, graph.edges, tree, graph.radii)
            row["seconds"] = time.process_time() - clock
            rows.setdefault(f"{faces:,} triangles", []).append(row)
    names = ("tips", "absent", "short", "false", "loops_off", "axis", "radius", "seconds")
    print("| " + " | ".join(("mesh", *names)) + " |\n" + "|---" * (len(names) + 1) + "|")
    for name, all_rows in rows.items():
        cells = [
            f"{np.median([row[n] for row in all_rows]):.1f}"
            if n in ("axis", "radius", "seconds")
            else f"{sum(row[n] for row in all_rows):.0f}"
            for n in names
        ]
        print("| " + " | ".join((name, *cells)) + " |")


if __name__ == "__main__":
    main()
