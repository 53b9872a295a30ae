"""What a second operation on the same shape costs, in processor time.

    python benchmarks/kept_stages.py ../shared/shapes/horse2.ply

The unit U is the processor time of `cKDTree(points).query(points, k=2)`, build included, of the
given vertices in the same process.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

from scipy.spatial import cKDTree

import medialis

RUNS = 3
Run = tuple[str, dict[str, Any]]
SECOND: list[tuple[str, Run, Run, float]] = [
    ("thickness after curve skeleton", ("curve_skeleton", {}), ("thickness", {}), 3.0),
    (
        "changed threshold of the curve skeleton",
        ("curve_skeleton", {}),
        ("curve_skeleton", {"threshold": 0.05}),
        2.0,
    ),
    (
        "changed threshold of importance",
        ("skeleton_importance", {}),
        ("skeleton_importance", {"threshold": 0.02}),
        0.3,
    ),
]
"""What is measured, the operation before, the operation itself, and the units it may take."""


def processor_seconds(work: Callable[..., Any], *given: Any, **options: Any) -> float:
    """Return the processor time that a call takes."""
    clock = time.process_time()
    work(*given, **options)
    return time.process_time() - clock


def search(points: Any) -> None:
    """Do the work that is the unit."""
    cKDTree(points).query(points, k=2)


def measured(path: Path, before: Run, after: Run) -> tuple[float, float, float]:
    """Return the processor seconds of the unit, the first and the second operation."""
    medialis.forget()
    shape, again = medialis.read_shape(path), medialis.read_shape(path)
    unit = processor_seconds(search, shape.points)
    first = processor_seconds(medialis.run, before[0], shape, **before[1])
    # A host makes a new shape for each run.
    return unit, first, processor_seconds(medialis.run, after[0], again, **after[1])


def main() -> None:
    """Measure all pairs on each shape that is named."""
    for path in map(Path, sys.argv[1:]):
        for what, before, after, bar in SECOND:
            measured(path, before, after)  # compiles
            rows = [measured(path, before, after) for _ in range(RUNS)]
            unit, first, second = (median(column) for column in zip(*rows, strict=True))
            print(
                f"{path.stem}: {what}: {second:.3f} s = {second / unit:.2f} U (bar {bar:g} U; "
                f"U = {unit:.3f} s; first operation {first / unit:.1f} U; kept "
                f"{medialis.kept_bytes() / 1e6:.0f} MB)"
            )


if __name__ == "__main__":
    main()
