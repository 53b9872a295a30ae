"""Curve skeletons from the surface skeleton against those from views, on the same shapes.

    python benchmarks/compare_curve_skeletons.py MESH ...

Loops and ends; share of nodes inside (winding number); median of the distance to the surface over
the radius of the nearest maximal ball; processor seconds; distance of each skeleton from the other,
median and 90 %, in per cent of the diagonal. Both run at the defaults of the operations.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

import medialis

HEAD = "shape method loops ends inside centred seconds away_median away_90%"


def main(paths: list[str]) -> None:
    """Print two lines a mesh."""
    for name in ("curve_skeleton", "view_curve_skeleton"):  # compiled and warm
        medialis.run(name, medialis.organic_shape(56))
    print(HEAD)
    for path in paths:
        shape = medialis.read_shape(path)
        graphs, seconds = {}, {}
        for name in ("curve_skeleton", "view_curve_skeleton"):
            clock = time.process_time()
            result = medialis.run(name, shape)
            graphs[name], seconds[name] = result.extras["graph"], time.process_time() - clock
            if name == "curve_skeleton":
                samples = result.shape.points
                valid = result.arrays["status"] == medialis.BallStatus.OK
                balls = result.arrays["centers"][valid], result.arrays["radii"][valid]
        one, other = graphs.values()
        for name, graph in graphs.items():
            local = balls[1][cKDTree(balls[0]).query(graph.nodes)[1]]
            room = cKDTree(samples).query(graph.nodes)[0]
            target = other if graph is one else one
            away = cKDTree(line(target)).query(line(graph))[0] * 100 / shape.diagonal
            print(
                f"{Path(path).stem} {name} {graph.loops} {len(graph.end_points)}",
                f"{100 * inside(graph.nodes, shape).mean():.0f}",
                f"{100 * np.median(room / local):.0f}",
                f"{seconds[name]:.1f} {np.median(away):.2f} {np.quantile(away, 0.9):.2f}",
                flush=True,
            )


def line(graph: medialis.CurveSkeleton) -> np.ndarray:
    """Return points along the edges of a graph."""
    a, b = graph.nodes[graph.edges[:, 0]], graph.nodes[graph.edges[:, 1]]
    return np.concatenate([a + t * (b - a) for t in np.linspace(0, 1, 9)])


def inside(points: np.ndarray, shape: medialis.Shape) -> np.ndarray:
    """Tell the points round which a closed mesh winds."""
    corners = shape.points[shape.faces]
    found = []
    for point in points:
        a, b, c = (corners[:, k] - point for k in range(3))
        la, lb, lc = (np.sqrt(np.einsum("ij,ij->i", v, v)) for v in (a, b, c))
        top = np.einsum("ij,ij->i", a, np.cross(b, c))
        ab, bc, ca = (np.einsum("ij,ij->i", u, v) for u, v in ((a, b), (b, c), (c, a)))
        bottom = la * lb * lc + ab * lc + bc * la + ca * lb
        found.append(abs(np.arctan2(top, bottom).sum() / (2 * np.pi)) > 0.5)
    return np.array(found)


if __name__ == "__main__":
    main(sys.argv[1:])
