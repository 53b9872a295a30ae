"""Curve skeletons of trees whose axes are known, beside other packages, in one table.

    python benchmarks/known_trees.py [--write] [--environment FOLDER] [--shapes FOLDER]
        [--only TEXT ...]

Ten trees of swept balls: radii up to 10 : 1, 5 to 25 limbs, rings. Each as meshes of 5,000 and of
100,000 triangles, and as exact voxels. Their numbers are not those of `stability.py --trees`, by
which constants were chosen. The packages are those of `peers.py`, and skan, in an environment that
is there (`python -m pip install skeletor kimimaro scikit-image skan`): nothing is installed, and
what it lacks is told as absent. `--write` keeps each row in `known_trees.json`, where those of
methods that do not run stay, and puts the table into docs/curve_skeleton.md. Shapes stay in a
folder that is given, and are taken from there the next time.
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from peers_suite.methods import Method
from stability_suite.changes import decimated
from stability_suite.measures import tree_row
from stability_suite.trees import TREES, Tree, depth_grid, grown_tree, meshed

import medialis

HERE = Path(__file__).resolve().parent
KEPT, PAGE = HERE / "known_trees.json", HERE.parent / "docs" / "curve_skeleton.md"
BEGIN, END = "<!-- known trees -->", "<!-- end of known trees -->"

FACES = (5_000, 100_000)
FIRST = 100
"""Number of the first tree."""

ACROSS = 4
"""Voxels across the thinnest limb."""

SECONDS = 100
"""Of processors that a method has for all trees of a size."""

METHODS = (
    Method("medialis_curve", "medialis curve_skeleton", "medialis"),
    Method(
        "wavefront", "skeletor by_wavefront", "skeletor", others=({"waves": 10, "step_size": 2},)
    ),
    Method("teasar", "skeletor by_teasar", "skeletor", default={"inv_dist": 1.0}),
    Method("mean_curvature", "skeletor by_mean_curvature", "skeletor"),
    Method(
        "clusters", "skeletor contract, by_vertex_clusters", "skeletor",
        default={"sampling_dist": 0.5},
    ),
    Method("tangent_ball", "skeletor by_tangent_ball", "skeletor"),
    Method(
        "kimimaro", "kimimaro", "kimimaro",
        others=({"scale": 1.5, "const": 0.5}, {"scale": 3.0, "const": 0.5}),
    ),
    Method("skan", "scikit-image skeletonize, skan", "skan"),
)  # fmt: skip
"""Lengths are in thicknesses of the thinnest limb."""

Row = dict[str, Any]


def trees() -> list[tuple[Tree, float]]:
    """Return the trees, and the radius of the thinnest limb of each."""
    return [
        (grown_tree(np.random.default_rng(FIRST + k), limbs, thinnest, rings), thinnest)
        for k, (limbs, thinnest, rings) in enumerate(TREES)
    ]


def mesh_of(tree: Tree, thinnest: float, faces: int) -> medialis.Shape:
    """Return a mesh of so many triangles, of one that is finer."""
    cell = 0.45 * thinnest
    while (shape := meshed(tree, cell)).face_count < faces:
        cell *= 0.98 * float(np.sqrt(shape.face_count / faces))
    return decimated(shape, faces)


def write_trees(folder: Path, faces: int) -> None:
    """Write all trees for the workers: meshes, or voxels where no faces are wanted."""
    if folder.is_dir():
        return
    folder.mkdir(parents=True)
    for k, (tree, thinnest) in enumerate(trees()):
        rows: dict[str, Any] = {"across": 2 * thinnest}
        if faces:
            shape = mesh_of(tree, thinnest, faces)
            rows |= {"points": shape.points, "faces": shape.faces}
        else:
            pitch = 2 * thinnest / ACROSS
            depth, low = depth_grid(tree, pitch)
            rows |= {"volume": depth < 0, "pitch": pitch, "origin": low}
        np.savez_compressed(folder / f"{k:02}.npz", **rows)


def run(method: Method, settings: dict[str, Any], python: str | Path, folder: Path) -> list[Row]:
    """Run a method on all trees and measure; those are missing that did not come to an end."""
    variables = dict(os.environ)
    for name in ("OMP", "OPENBLAS", "MKL", "NUMBA"):
        variables[f"{name}_NUM_THREADS"] = "1"
    if method.package != "medialis":
        variables.pop("PYTHONPATH", None)
    with tempfile.TemporaryDirectory() as results:
        command = [python, HERE / "peers_suite" / "worker.py", method.name]
        subprocess.run(
            [*command, json.dumps(settings), folder, results], capture_output=True, env=variables,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS)),
        )  # fmt: skip
        rows = []
        for k, (tree, _) in enumerate(trees()):
            path = Path(results) / f"{k:02}.npz"
            if path.is_file():
                with np.load(path) as held:
                    nodes, edges = np.asarray(held["nodes"], float), np.asarray(held["edges"], int)
                    seconds = float(held["seconds"])
                rows.append(tree_row(nodes, edges, tree) | {"seconds": seconds})
        return rows


def versions(python: Path) -> dict[str, str]:
    """Return the versions of the packages that an environment has."""
    found = {"medialis": medialis.__version__}
    for name in sorted({method.package for method in METHODS} - {"medialis"}):
        command = [python, HERE / "peers_suite" / "worker.py", "versions", name]
        if python.is_file():
            asked = subprocess.run(command, capture_output=True, check=False)
            if asked.returncode == 0:
                found |= json.loads(asked.stdout)
    return found


def summary(rows: list[Row], count: int) -> list[str]:
    """Return the cells of a method: sums over the trees that came to a result, in per cent."""
    if not rows:
        return [f"0 of {count}", *[""] * 6]
    total = {name: sum(row[name] for row in rows) for name in rows[0]}
    shares = [100 * total[name] / total["tips"] for name in ("absent", "false", "short")]
    right = sum(row["loops_off"] == 0 for row in rows)
    return [
        f"{len(rows)} of {count}",
        *(f"{share:.1f} %" for share in shares),
        f"{right} of {len(rows)}",
        f"{np.median([row['axis'] for row in rows]):.1f} %",
        f"{total['seconds'] / len(rows):.2f}",
    ]


def table(kept: dict[str, Any]) -> str:
    """Return the table of all rows that are known."""
    names = ("done", "absent", "false", "short", "loops right", "off the axis", "seconds a tree")
    lines = ["| method | settings | input | " + " | ".join(names) + " |", "|---" * 10 + "|"]
    for method in METHODS:
        for settings in (method.default, *method.others):
            words = ", ".join(f"{name} {value}" for name, value in settings.items()) or "default"
            for size in sizes(method):
                told = f"{size:,} triangles" if size else "voxels"
                why = "not run" if method.package in kept["versions"] else "absent"
                cells = kept["rows"].get(key(method, settings, size), [why, *[""] * 6])
                lines.append("| " + " | ".join((method.label, words, told, *cells)) + " |")
    return "\n".join(lines)


def sizes(method: Method) -> tuple[int, ...]:
    """Return the triangles of the meshes that a method takes; 0 for voxels."""
    return (0,) if method.name in ("kimimaro", "skan") else FACES


def key(method: Method, settings: dict[str, Any], size: int) -> str:
    """Return the name of a method with settings and a size."""
    return f"{method.label} {json.dumps(settings)} {size}"


def section(kept: dict[str, Any]) -> str:
    """Return the table for the page, with what it was made of."""
    names = ", ".join(f"{name} {number}" for name, number in kept["versions"].items())
    return f"{kept['tips']} limbs; {names}; {kept['date']}.\n\n{table(kept)}\n"


def main() -> None:
    """Run what is asked for and there, and print or keep the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--environment", type=Path, default=HERE.parent / "build" / "peers")
    parser.add_argument("--shapes", type=Path)
    parser.add_argument("--only", nargs="*", default=[], metavar="TEXT")
    given = parser.parse_args()
    python = given.environment.absolute() / "bin" / "python"
    there = versions(python)
    kept: dict[str, Any] = {"rows": {}, "versions": {}}
    if given.write and KEPT.is_file():
        kept = json.loads(KEPT.read_text(encoding="utf-8"))
    kept["versions"] |= there
    kept["date"] = datetime.date.today().isoformat()
    kept["tips"] = sum(len(tree.tips) for tree, _ in trees())
    chosen = [m for m in METHODS if not given.only or any(text in m.label for text in given.only)]
    for name in sorted({m.package for m in chosen} - there.keys()):
        print(f"{name} is absent", flush=True)
    chosen = [m for m in chosen if m.package in there]
    with tempfile.TemporaryDirectory() as name:
        for size in sorted({size for method in chosen for size in sizes(method)}):
            folder = (given.shapes or Path(name)) / str(size)
            write_trees(folder, size)
            for method in (m for m in chosen if size in sizes(m)):
                own = sys.executable if method.package == "medialis" else python
                for settings in (method.default, *method.others):
                    cells = summary(run(method, settings, own, folder), len(TREES))
                    kept["rows"][key(method, settings, size)] = cells
                    print(method.label, settings, size, *cells, flush=True)
                    if given.write:
                        write(kept)
    print(table(kept))


def write(kept: dict[str, Any]) -> None:
    """Keep the rows, and put their table into the page."""
    KEPT.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    text = PAGE.read_text(encoding="utf-8")
    before, after = text[: text.index(BEGIN)], text[text.index(END) :]
    PAGE.write_text(f"{before}{BEGIN}\n{section(kept)}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()
