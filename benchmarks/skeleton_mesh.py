"""The skeleton mesh against the printed method: a Delaunay triangulation for each face.

python benchmarks/skeleton_mesh.py [MESH ...]

Areas and shares of edges with 1, 2, 3 or more faces; closed forms first, then the given meshes.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
from scipy.spatial import Delaunay, QhullError

import medialis

TESTS = Path(__file__).resolve().parent.parent / "tests"


def printed_method(cloud: medialis.MedialCloud) -> np.ndarray:
    """Thesis 3.4.1 with scipy: triangles as rows of the cloud, duplicates removed."""
    shape, touching, triangles = cloud.surface, cloud.inverse_features, []
    for face in shape.faces:
        rows = np.unique(np.concatenate([touching[i] for i in face]))
        a, b, c = shape.points[face]
        normal = np.cross(b - a, c - a)
        if len(rows) < 3 or not normal.any():
            continue
        across = np.cross(normal / np.linalg.norm(normal), (b - a) / np.linalg.norm(b - a))
        plane = np.stack([(b - a) / np.linalg.norm(b - a), across], axis=1)
        try:
            local = Delaunay(cloud.centers[rows] @ plane, qhull_options="QJ Qbb")
        except QhullError:
            continue
        triangles.append(rows[local.simplices])
    return np.unique(np.sort(np.concatenate(triangles), axis=1), axis=0)


def report(name: str, points: np.ndarray, faces: np.ndarray, seconds: float) -> None:
    """Print one line."""
    a, b, c = (points[faces[:, j]] for j in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    count = np.unique(edges, axis=0, return_counts=True)[1]
    shares = [100 * np.mean(count == 1), 100 * np.mean(count == 2), 100 * np.mean(count > 2)]
    text = " / ".join(f"{s:.0f}" for s in shares)
    print(f"{name:32s} {len(faces):7d} faces, area {area:.4g}, edges {text} %, {seconds:.3f} s")


def main(paths: list[str]) -> None:
    """Compare on three closed forms and the given meshes."""
    sys.path[:0] = [str(TESTS)]
    from closed_forms import box_mesh, elliptic_torus, spheroid

    cases = {
        "spheroid (1.767)": spheroid(),
        "elliptic torus (3.167)": elliptic_torus(),
        "box (24.39)": box_mesh((4.0, 3.0, 1.0), 0.1),
        **{Path(path).stem: medialis.read_shape(path) for path in paths},
    }
    for name, shape in cases.items():
        cloud = medialis.shrink_balls(shape)
        medialis.skeleton_mesh(cloud)
        clock = time.perf_counter()
        mesh = medialis.skeleton_mesh(cloud, min_spoke_angle=0.0, smallest_piece=0.0)
        report(f"{name}, lifted", mesh.points, mesh.faces, time.perf_counter() - clock)
        clock = time.perf_counter()
        faces = printed_method(cloud)
        report(f"{name}, printed", cloud.centers, faces, time.perf_counter() - clock)


if __name__ == "__main__":
    main(sys.argv[1:])
