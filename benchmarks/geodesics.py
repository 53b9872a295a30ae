"""Benchmark of geodesics and importance (thesis 3.3, Tables 2 and 3): accuracy, speed, thresholds.

    python benchmarks/geodesics.py [accuracy speed thresholds noise] [--pairs N] [--shapes A,B]

Needs the shapes in ../shared/shapes; accuracy needs `pip install pygeodesic` (exact geodesics:
about a second for each pair of a large shape). Prints tables and saves them in benchmarks/results.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree
from surface_skeleton import REAL, best_seconds, table

import medialis
from medialis.show.camera import Camera
from medialis.show.picture import Curves, Points, draw
from medialis.show.png import write_png

RESULTS = Path(__file__).resolve().parent / "results"
ACCURACY = ("fertility", "rockerarm", "cow", "fandisk", "bunny", "horse")
SPEED = ("hand", "bunny", "armadillo", "horse", "dragon", "igea", "horse2", "igea2")
THRESHOLDS = ("bunny", "horse", "armadillo", "hand", "fertility")
NOISE = ("sphere", "box", "bunny")
DIRECTIONS = (5, 10, 20, 30, 50, 100, 500)


def accuracy(names: list[str], count: int) -> list[dict]:
    """Relative error in per cent against exact geodesics, for growing numbers of directions."""
    from pygeodesic import geodesic

    rows = []
    for name in names:
        shape = medialis.read_shape(REAL / f"{name}.ply")
        cloud = medialis.shrink_balls(shape)
        chosen = np.random.default_rng(0).choice(np.flatnonzero(cloud.valid), count, replace=False)
        pairs = cloud.features[chosen]
        exact = geodesic.PyGeodesicAlgorithmExact(shape.points, shape.faces)
        clock = time.perf_counter()
        truth = np.array([exact.geodesicDistance(int(a), int(b))[0] for a, b in pairs])
        slow = time.perf_counter() - clock
        for directions in DIRECTIONS:
            seconds, _ = best_seconds(
                lambda p, s=shape, q=pairs, d=directions: medialis.geodesic_lengths(
                    s, q, directions=d
                ),
                2,
            )
            found = medialis.geodesic_lengths(shape, pairs, directions=directions).length
            rows.append(
                {"shape": name, "M": directions, **_errors(found, truth), "seconds": seconds,
                 "exact_seconds": slow}
            )  # fmt: skip
        relaxed = medialis.geodesic_importance(cloud).length[chosen]
        rows.append({"shape": name, "M": "importance", **_errors(relaxed, truth)})
        print(table(rows[-len(DIRECTIONS) - 1 :]), flush=True)
    return rows


def _errors(found: np.ndarray, truth: np.ndarray) -> dict:
    use = np.isfinite(found) & (truth > 0) & np.isfinite(truth)
    error = 100 * (found[use] / truth[use] - 1)
    return {
        "pairs": int(use.sum()),
        "median_percent": f"{np.median(error):.5f}",
        "p90_percent": float(np.quantile(error, 0.9)),
        "p99_percent": float(np.quantile(error, 0.99)),
        "max_percent": float(error.max()),
    }


def speed(names: list[str]) -> list[dict]:
    """Seconds of importance at the default setting, of local measures, threads, growth."""
    rows = []
    for name in names:
        shape = medialis.read_shape(REAL / f"{name}.ply")
        cloud = medialis.shrink_balls(shape)
        medialis.geodesic_lengths(shape, cloud.features[:100])
        repeats = 1 if shape.point_count > 300_000 else 3

        def importance(p: medialis.Progress, s=shape, c=cloud) -> None:
            medialis.geodesic_importance(c)

        seconds, _ = best_seconds(importance, repeats)
        with medialis.thread_limit(1):
            single, _ = best_seconds(importance, 1)
        local, _ = best_seconds(lambda p, c=cloud: medialis.local_measures(c), 3)
        paths = medialis.geodesic_importance(cloud)
        rows.append(
            {"shape": name, "points": len(cloud), "importance_s": seconds,
             "speedup_of_threads": single / seconds, "local_measures_s": local,
             "infinite": int(np.isinf(paths.length).sum()),
             "along_edges": int((paths.status == medialis.PathStatus.EDGES).sum())}
        )  # fmt: skip
        print(table(rows[-1:]), flush=True)
    return rows


def components(points: np.ndarray, radius: float) -> int:
    """Count connected components when points closer than `radius` are linked."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    pairs = cKDTree(points).query_pairs(radius, output_type="ndarray")
    n = len(points)
    graph = coo_array((np.ones(len(pairs), np.int8), tuple(pairs.T)), shape=(n, n))
    count, label = connected_components(graph, directed=False)
    return int((np.bincount(label) > 0.001 * n).sum()) if count else 0


def thresholds(names: list[str]) -> list[dict]:
    """Tell what thresholding leaves: points, components, the depth error of their balls."""
    rows = []
    for name in names:
        shape = medialis.read_shape(REAL / f"{name}.ply")
        cloud = medialis.surface_skeleton(shape)
        importance = medialis.geodesic_importance(cloud)
        connected = medialis.connected_importance(importance)
        for threshold in (0.0, 0.005, 0.01, 0.02, 0.05):
            plain = cloud.subset(medialis.important_points(importance, threshold=threshold))
            kept = cloud.subset(medialis.important_points(connected, threshold=threshold))
            found = medialis.reconstruct_image(kept)
            rows.append(
                {"shape": name, "threshold_percent": 100 * threshold, "points": len(kept),
                 "components": components(kept.centers, 0.02 * shape.diagonal),
                 "components_plain": components(plain.centers, 0.02 * shape.diagonal),
                 "pixels_that_differ_percent": 100 * found.only_one_share,
                 "median_depth_percent": found.median_difference,
                 "depth_95_percent": found.difference_95}
            )  # fmt: skip
        print(table(rows[-5:]), flush=True)
    return rows


def curves(rows: list[dict]) -> np.ndarray:
    """Draw the share of pixels that differ against the threshold, both axes logarithmic.

    From left to right thresholds of 0.5, 1, 2, 5 %; grid lines at 0.1, 1, 10 and 100 %.
    """
    names = list(dict.fromkeys(row["shape"] for row in rows))
    nodes, edges, labels = [], [], []
    for number, name in enumerate(names):
        mine = [row for row in rows if row["shape"] == name and row["threshold_percent"] > 0]
        for step, row in enumerate(mine):
            if step:
                edges.append((len(nodes) - 1, len(nodes)))
            height = 0.6 * np.log10(row["pixels_that_differ_percent"])
            nodes.append((np.log2(row["threshold_percent"]), height, 0.0))
            labels.append(number)
    left, right = min(n[0] for n in nodes), max(n[0] for n in nodes)
    grid = np.array([(x, 0.6 * k, -0.1) for k in range(-1, 3) for x in (left, right)])
    lines = [(2 * k, 2 * k + 1) for k in range(4)]
    items = [
        Curves(nodes, edges, width=5, labels=labels),
        Points(nodes, size=11, labels=labels),
        Curves(grid, lines, width=1.5, color=(0.75, 0.75, 0.78)),
    ]
    camera = Camera.framing(grid, direction=(0, 0, 1), up=(0, 1, 0), width=900, height=560)
    title = "pixels that differ: 0.1, 1, 10, 100 % over importance from 0.5, 1, 2, 5 %"
    return draw(items, camera, title=title, legend="shape", label_names=names)


def noise(names: list[str]) -> list[dict]:
    """Tell how far pruned skeletons of noisy shapes lie from the clean skeleton, by measure.

    Noise moves every vertex along its normal, normally distributed; the deviation is a share of
    the diagonal. Each measure keeps as many points as importance does at 10 % of the diagonal.
    """
    rows = []
    for name in names:
        clean = _clean(name)
        truth = medialis.surface_skeleton(clean)
        tree = cKDTree(truth.centers[truth.valid])
        for amount in (0.001, 0.005, 0.01):
            step = np.random.default_rng(0).normal(size=clean.point_count) * amount
            points = clean.points + (step * clean.diagonal)[:, None] * clean.normals
            shape = medialis.make_shape(points, clean.faces)
            cloud = medialis.surface_skeleton(shape)
            cloud = cloud.subset(cloud.valid)
            off = 100 * tree.query(cloud.centers)[0] / clean.diagonal
            importance = medialis.geodesic_importance(cloud)
            count = int(medialis.important_points(importance, threshold=0.1).sum())
            measures = {"importance": importance.length, **medialis.local_measures(cloud)}
            row: dict = {"shape": name, "noise_percent": 100 * amount, "all": len(cloud),
                         "kept": count, "all_median": float(np.median(off))}  # fmt: skip
            for measure in ("importance", "spoke_angle", "radius"):
                kept = np.argsort(-measures[measure], kind="stable")[:count]
                row[f"{measure}_median"] = float(np.median(off[kept]))
                row[f"{measure}_95"] = float(np.quantile(off[kept], 0.95))
            rows.append(row)
        print(table(rows[-3:]), flush=True)
    return rows


def _clean(name: str) -> medialis.Shape:
    if name == "box":
        corners = np.array([[x, y, z] for x in (0, 3) for y in (0, 2) for z in (0, 1)], float)
        quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
        faces = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
        return medialis.refine(medialis.make_shape(corners, faces), longest_edge=0.016)
    if name == "sphere":
        cube = _clean("box")
        points = cube.points - cube.points.mean(axis=0)
        points = points / [1.5, 1.0, 0.5]
        points /= np.linalg.norm(points, axis=1, keepdims=True)
        return medialis.make_shape(points, cube.faces)
    return medialis.read_shape(REAL / f"{name}.ply")


def main() -> None:
    """Measure, print and save."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", default=["accuracy", "speed", "thresholds", "noise"])
    parser.add_argument("--pairs", type=int, default=500)
    parser.add_argument("--shapes", help="comma-separated names instead of the usual ones")
    options = parser.parse_args()
    RESULTS.mkdir(exist_ok=True)
    for part in options.parts:
        usual = {"accuracy": ACCURACY, "speed": SPEED, "thresholds": THRESHOLDS, "noise": NOISE}[
            part
        ]
        names = options.shapes.split(",") if options.shapes else list(usual)
        rows = accuracy(names, options.pairs) if part == "accuracy" else globals()[part](names)
        if part == "thresholds":
            write_png(RESULTS / "geodesics_thresholds.png", curves(rows))
        (RESULTS / f"geodesics_{part}.md").write_text(table(rows) + "\n")


if __name__ == "__main__":
    main()
