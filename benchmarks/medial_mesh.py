"""Medial meshes: error, topology and time of shapes that papers print numbers for.

    python benchmarks/medial_mesh.py ../shared/medial_mesh [--quality fast] [--seeds 0 1 2]
        [--jobs bug:30 elk:124 ...] [--envelope]
    python benchmarks/medial_mesh.py topology ../shared/medial_mesh/*.ply ../shared/shapes/*.ply

One line for each shape and number of balls, medians of the seeds: the two-sided distance of
envelope and surface in % of the diagonal (and its range), Betti numbers, seconds of processor time
with the fine complex, and U, that time over one nearest-neighbour search of all vertices in the
same process. `--envelope` rebuilds the surface of the first seed as well: closed or not, its pieces
and handles, and how far it is from the input.

`topology` compares Betti numbers with those that vertices, edges and faces of the mesh give, for
each closed mesh without non-manifold edges: by default, with 4 times as many balls, with samples
for 4,000 balls, as the shape turned with its points in another order, with the fewest balls, and
with every number of balls in between (`levels`: how many were looked at). Meshes that are open or
not manifold are listed as such.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

import medialis
from medialis.medial_meshes.sampling import Solid
from medialis.show.reports.measures import distance_to_surface

JOBS = (
    "bug:30", "bug:60", "bug:120", "dolphin:30", "dolphin:60", "dolphin:120", "fertility:79",
    "elk:124", "dove:120", "octopus:120", "pinion:120", "plane:120", "santa:120",
)  # fmt: skip


def seconds(work: Callable[[], Any]) -> tuple[float, Any]:
    """Return the processor time of a call, and its result."""
    begin = time.process_time()
    result = work()
    return time.process_time() - begin, result


def unit(shape: medialis.Shape) -> float:
    """Return the processor time of a search of the two nearest of all vertices, least of 5."""
    return min(seconds(lambda: cKDTree(shape.points).query(shape.points, k=2))[0] for _ in range(5))


def wanted(shape: medialis.Shape) -> tuple[int, int, int] | None:
    """Return the Betti numbers of the solid."""
    assert shape.faces is not None
    return Solid(shape.points / shape.diagonal, shape.faces).betti


def rebuilt(mesh: medialis.MedialMesh, shape: medialis.Shape) -> str:
    """Rebuild the surface and say what it is like."""
    surface = medialis.envelope_surface(mesh)
    found = medialis.diagnose(surface.points, surface.faces)
    far = distance_to_surface(surface.points, shape).max() / shape.diagonal
    closed = "closed" if found.closed else "OPEN"
    return f"{closed}, {found.components} pieces, genus {found.genus}, off {100 * far:.2f}"


def measure(folder: Path, job: str, quality: str, seeds: list[int], envelope: bool) -> str:
    """Return one line."""
    name, balls = job.split(":")
    shape = medialis.read_shape(folder / f"{name}.ply")
    errors, times, found = [], [], []
    for seed in seeds:
        medialis.forget()

        def work(seed: int = seed) -> medialis.MedialMesh:
            return medialis.medial_mesh(shape, balls=int(balls), quality=quality, seed=seed)

        spent, mesh = seconds(work)
        times.append(spent)
        found.append(mesh)
        errors.append(100 * medialis.envelope_distance(mesh, shape).largest / shape.diagonal)
    betti = wanted(shape)
    right = "right" if all(mesh.betti == betti for mesh in found) else f"WRONG, wanted {betti}"
    line = (
        f"| {name} {len(found[0])} | {np.median(errors):.2f} ({min(errors):.2f}-{max(errors):.2f}) "
        f"| {found[0].betti} {right} | {np.median(times):.1f} "
        f"| {np.median(times) / unit(shape):.0f} |"
    )
    return f"{line} {rebuilt(found[0], shape)} |" if envelope else line


def counted(shape: medialis.Shape) -> tuple[int, int, int] | None:
    """Count parts, loops and hollows of the solid from the mesh alone; None if it is not closed.

    Pieces are faces joined across edges, each with 2 - 2 genus = vertices - edges + faces, where a
    vertex of several fans is there for each of them. Pieces with a negative volume are cavities.
    """
    assert shape.faces is not None
    faces = shape.faces.astype(np.int64)
    count = len(faces)
    sides = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    keys = np.sort(sides, axis=1) @ [len(shape.points), 1]
    order = np.argsort(keys, kind="stable")
    if len(keys) % 2:
        return None
    pairs = keys[order].reshape(-1, 2)
    if (pairs[:, 0] != pairs[:, 1]).any() or len(np.unique(pairs[:, 0])) < len(pairs):
        return None
    first, second = order.reshape(-1, 2).T
    if (sides[first] == sides[second]).any():
        return None  # neighbours that disagree
    piece = _labels(count, first % count, second % count)
    corner = faces.T.ravel()  # of side k the corner where it begins
    after = np.roll(np.arange(3 * count), -count)  # the side that begins where it ends
    fans = _labels(3 * count, np.r_[first, after[first]], np.r_[after[second], second])
    vertices = np.bincount(piece[np.unique(fans, return_index=True)[1] % count])
    assert (corner[first] == corner[after[second]]).all()
    euler = vertices - np.bincount(piece[first % count]) + np.bincount(piece)
    points = shape.points - shape.points.mean(axis=0)
    volume = np.bincount(piece, np.linalg.det(points[faces]))
    outward = volume * np.sign(volume[np.abs(volume).argmax()]) > 0
    return int(outward.sum()), int((2 - euler).sum() // 2), int((~outward).sum())


def _labels(count: int, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    graph = coo_matrix((np.ones(len(a), bool), (a, b)), shape=(count, count))
    return connected_components(graph, directed=False)[1]


def turned(shape: medialis.Shape) -> medialis.Shape:
    """Return the shape turned at random, with its points and faces in another order."""
    assert shape.faces is not None
    rng = np.random.default_rng(5)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    order = rng.permutation(len(shape.points))
    place = np.argsort(order)
    return medialis.make_shape(
        shape.points[order] @ turn.T, place[shape.faces][rng.permutation(len(shape.faces))]
    )


def all_levels(mesh: medialis.MedialMesh, wanted: tuple[int, int, int]) -> str:
    """Look at each number of balls up to 60, and at some beyond."""
    steps = np.geomspace(60, mesh.most, 20).astype(int)
    counts = sorted({*range(mesh.fewest, 60), *steps.tolist()})
    wrong = [n for n in counts if mesh.level(n).betti != wanted]
    return f"{len(counts)} right" if not wrong else f"WRONG: {wrong}"


def topology(path: Path) -> str:
    """Return one line of Betti numbers."""
    shape = medialis.read_shape(path)
    if shape.faces is None or not len(shape.faces):
        return f"| {path.stem} | a cloud |"
    wanted, places, runs = counted(shape), [], []
    if wanted is None:
        return f"| {path.stem} | open or not manifold |"
    for given, options in (
        (shape, {}), (shape, {"balls": 480}), (shape, {"balls": 4000}), (turned(shape), {}),
    ):  # fmt: skip
        medialis.forget()
        spent, mesh = seconds(
            lambda one=given, more=options: medialis.medial_mesh(one, quality="fast", **more)  # type: ignore[misc]
        )
        places.append("right" if mesh.betti == wanted else f"WRONG {mesh.betti}")
        runs.append((spent, mesh))
    spent, mesh = runs[0]
    fewest = mesh.level(1)
    places.append(f"{len(fewest)}: {'right' if fewest.betti == wanted else fewest.betti}")
    places += [all_levels(mesh, wanted), f"{spent:.1f}"]
    return f"| {path.stem} | {wanted} | " + " | ".join(places) + " |"


TOPOLOGY = ("shape", "parts, loops, hollows", "120 balls", "480", "4,000", "turned", "fewest",
            "levels", "s")  # fmt: skip


def main() -> None:
    """Measure and print."""
    medialis.medial_mesh(medialis.organic_shape(56), balls=10)  # compiles
    if sys.argv[1:2] == ["topology"]:
        print("| " + " | ".join(TOPOLOGY) + " |\n" + "|---" * len(TOPOLOGY) + "|", flush=True)
        for path in sys.argv[2:]:
            print(topology(Path(path)), flush=True)
        return
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--quality", default="balanced")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--jobs", nargs="+", default=JOBS, metavar="SHAPE:BALLS")
    parser.add_argument("--envelope", action="store_true")
    given = parser.parse_args()
    columns = ["shape, balls", "error %", "parts, loops, hollows", "s", "U"]
    columns += ["rebuilt surface"] * given.envelope
    print("| " + " | ".join(columns) + " |\n" + "|---" * len(columns) + "|")
    for job in given.jobs:
        line = measure(given.folder, job, given.quality, given.seeds, given.envelope)
        print(line, flush=True)


if __name__ == "__main__":
    main()
