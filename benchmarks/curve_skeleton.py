"""Seconds and topology of curve skeletons against thesis Table 5.

python benchmarks/curve_skeleton.py MESH ...

Wall-clock seconds of the three stages after the geodesics, and of the whole; components, loops and
genus; median share of the local medial radius that is left round the nodes.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

import medialis

HEAD = "name vertices detect regularize reconstruct processor branches V-E components genus centred"


def main(paths: list[str]) -> None:
    """Print one line a mesh."""
    medialis.run("curve_skeleton", medialis.organic_shape(56))  # compiled and warm
    print(HEAD)
    for path in paths:
        cloud = medialis.surface_skeleton(medialis.read_shape(path))
        medialis.geodesic_importance(cloud)  # kept with the cloud
        progress, clock = medialis.Progress(), time.process_time()
        graph = medialis.curve_skeleton(cloud, progress=progress)
        clock = time.process_time() - clock
        stages, evidence = progress.seconds, graph.evidence
        near = cKDTree(cloud.centers[cloud.valid]).query(graph.nodes)[1]
        centred = float(np.median(graph.radii / cloud.radii[cloud.valid][near]))
        numbers = [stages[name] for name in ("detect", "regularize", "reconstruct")]
        print(
            f"{Path(path).stem} {cloud.surface.point_count}",
            *(f"{number:.2f}" for number in [*numbers, clock]),
            f"{graph.branch_count} {len(graph.nodes) - len(graph.edges)}",
            f"{graph.component_count} {sum(evidence.genus.values())} {centred:.3f}",
            flush=True,
        )


if __name__ == "__main__":
    main(sys.argv[1:])
