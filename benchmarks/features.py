"""Refined features against closed forms, and their speed (thesis 6.4).

python benchmarks/features.py [MESH ...]

First counts, lengths and areas at several densities; then, for the given meshes, counts and the
processor time of each function, the feature sets that it needs included (smallest of three runs,
all threads together, nothing kept).
"""

from __future__ import annotations

import functools
import math
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from accuracy_suite.flat_prisms import flat_prism

import medialis

TESTS = Path(__file__).resolve().parent.parent / "tests"
SIDES = (2.0, 1.5, 1.0)


def box_outline(a: float, b: float) -> list[list[float]]:
    """Return the corners of a rectangle."""
    return [[0, 0], [a, 0], [a, b], [0, b]]


def closed_forms() -> None:
    """Print counts, Y-length and areas of shapes whose sheets are known."""
    sys.path[:0] = [str(TESTS)]
    import closed_forms as forms

    cases: dict[str, tuple[Callable[[float], medialis.Shape], int, int, float, float]] = {}
    prisms = {
        "box": (box_outline(*SIDES[:2]), SIDES[2], 6), "slab": (box_outline(2, 2), 0.5, 6),
        "L": (forms.L_OUTLINE, 0.8, 8), "T": (forms.T_OUTLINE, 0.8, 10),
        "wedge": (forms.TRIANGLE, 0.8, 5),
    }  # fmt: skip
    for name, (outline, height, patches) in prisms.items():
        known = flat_prism(name, outline, height)
        make = functools.partial(forms.prism, outline, height)
        cases[name] = make, known.sheets, patches, known.y_length, float(known.areas.sum())
    cases |= {
        "flat cylinder": (
            lambda h: forms.rounded_cylinder(1, 1, 0, h), 3, 3, math.pi,
            math.pi / 4 + 3 * math.pi * math.sqrt(0.5),
        ),
        "rounded cylinder": (lambda h: forms.rounded_cylinder(1, 1.6, 0.25, h), 3, 3, 0.0, 0.0),
        "dumbbell": (lambda h: forms.dumbbell(step=h), 3, 0, 0.0, 0.0),
    }  # fmt: skip
    print("| shape | spacing | samples | sheets | patches | parts | Y-length | area |")
    print("|---|---|---|---|---|---|---|---|")
    for name, (make, sheets, patches, length, area) in cases.items():
        for spacing in (0.12, 0.06, 0.03):
            shape = make(spacing)
            cloud = medialis.surface_skeleton(shape, refine=0, side="both")
            inner = medialis.surface_skeleton(shape, refine=0, fans=True)
            found = medialis.medial_sheets(inner)
            network = medialis.y_network(found)
            meshes = medialis.sheet_meshes(found)
            print(
                f"| {name} | {spacing} | {shape.point_count} | {found.count} ({sheets}) "
                f"| {medialis.patches(cloud).count}{f' ({patches})' if patches else ''} "
                f"| {medialis.parts(inner, method='sheets').count} "
                f"| {network.lengths.sum():.3f}{f' ({length:.3f})' if length else ''} "
                f"| {meshes.areas.sum():.3f}{f' ({area:.3f})' if area else ''} |"
            )


def timed(work: Callable[[], object]) -> float:
    """Processor time of a call that finds nothing kept, the smallest of three."""
    times = []
    with medialis.memory_limit(0):
        for _ in range(3):
            clock = time.process_time()
            work()
            times.append(time.process_time() - clock)
    return min(times)


def speed(path: str) -> None:
    """Print one line for a mesh."""
    shape = medialis.read_shape(path)
    cloud = medialis.shrink_balls(shape)
    sets = medialis.extended_feature_transform(cloud)
    sheets = medialis.medial_sheets(cloud, smallest=0.0)
    seconds = [
        timed(lambda: medialis.extended_feature_transform(cloud)),
        timed(lambda: medialis.point_types(cloud)),
        timed(lambda: medialis.soft_edges(cloud)),
        timed(lambda: medialis.medial_sheets(cloud)),
        timed(lambda: medialis.y_network(sheets)) if shape.faces is not None else 0,
        timed(lambda: medialis.sheet_meshes(sheets)) if shape.faces is not None else 0,
        timed(lambda: medialis.patches(cloud)),
        timed(lambda: medialis.parts(cloud, method="sheets")),
    ]
    size = sum(x.nbytes for x in (sets.samples.indices, sets.samples.offsets, sets.clusters))
    types = np.bincount(np.minimum(medialis.point_types(cloud), 3), minlength=4)
    large = medialis.medial_sheets(cloud, smallest=0.01)
    print(
        f"| {Path(path).stem} | {shape.point_count} | {types[1]} | {types[3]} | {sheets.count} "
        f"| {large.count} | "
        + " | ".join(f"{s:.2f}" for s in seconds)
        + f" | {size / len(cloud):.0f} |"
    )


def main(paths: list[str]) -> None:
    """Run both."""
    closed_forms()
    print()
    print(
        "| shape | samples | A3 | A1^3+ | sheets | from 1 % | feature sets | types | soft edges "
        "| sheets | Y-network | meshes | patches | parts | set bytes a ball |"
    )
    print("|" + "---|" * 15)
    with medialis.memory_limit(0):
        for path in paths:
            speed(path)


if __name__ == "__main__":
    main(sys.argv[1:])
