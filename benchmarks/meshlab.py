"""What pymeshlab filters cost beyond the computation, on meshes of growing size.

    python benchmarks/meshlab.py [--largest 200000]

The mesh is a bumpy sphere. The hand-over is the time of the filter less that of the two functions
of the core that it calls: `make_shape`, which repairs, and `run`.
"""

import argparse
import time
from unittest.mock import patch

import numpy as np
import pymeshlab

import medialis_meshlab
from medialis.operations import registry
from medialis_meshset import reading

FILTERS = (
    "generate_surface_skeleton",
    "generate_surface_skeleton_mesh",
    "compute_scalar_by_medial_thickness_per_vertex",
)


def bumpy_sphere(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Points and faces of a closed surface with about `count` vertices."""
    from scipy.spatial import ConvexHull

    index = np.arange(count) + 0.5
    polar, turn = np.arccos(1 - 2 * index / count), np.pi * (1 + 5**0.5) * index
    directions = np.stack(
        [np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)], axis=1
    )
    faces = ConvexHull(directions).simplices
    corners = directions[faces]
    outward = np.einsum(
        "ij,ij->i",
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]),
        corners[:, 0],
    )
    faces[outward < 0] = faces[outward < 0][:, ::-1]
    bumps = 1 + 0.1 * np.sin(6 * directions).prod(axis=1)
    return directions * bumps[:, None], faces.astype(np.int32)


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--largest", type=int, default=200_000)
    parser.add_argument("--repeat", type=int, default=3)
    options = parser.parse_args()
    assert set(FILTERS) <= set(medialis_meshlab.filter_list())
    print("| filter | vertices | core (s) | hand-over (s) |")
    print("|---|---|---|---|")
    for count in (options.largest // 20, options.largest):
        points, faces = bumpy_sphere(count)
        for name in FILTERS:
            row = measure(name, points, faces, options.repeat)
            print(f"| `{name}` | {len(points)} | " + " | ".join(f"{x:.2f}" for x in row) + " |")


def measure(name: str, points, faces, repeat: int) -> tuple[float, float]:
    """Seconds of the core and of the hand-over; the fastest of some runs after a first one."""
    rows = []
    for _ in range(repeat + 1):
        ms = pymeshlab.MeshSet()
        ms.add_mesh(pymeshlab.Mesh(points, faces))
        inside: list[float] = []
        with (
            patch.object(reading, "make_shape", timed(reading.make_shape, inside)),
            patch.object(registry, "run", timed(registry.run, inside)),
        ):
            timed(ms.apply_filter, total := [])(name)
        rows.append((sum(inside), total[0] - sum(inside)))
    return min(rows[1:], key=lambda row: row[1])


def timed(function, seconds: list[float]):
    """Return a function that also notes how long it took."""

    def call(*arguments, **options):
        clock = time.perf_counter()
        found = function(*arguments, **options)
        seconds.append(time.perf_counter() - clock)
        return found

    return call


if __name__ == "__main__":
    main()
