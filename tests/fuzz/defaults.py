"""Cases of the kind `defaults`: what people click first, on a nasty shape, without an option."""

from __future__ import annotations

import time

import medialis
from fuzz.kinds import GIGABYTE, Case, Fault, Kind
from fuzz.nasty_shapes import nasty_mesh
from fuzz.shape_operations import SLOWER, check_cost, check_result, keep_shape, peak_memory

OPERATIONS = (
    *("thickness", "curve_skeleton", "parts", "medial_mesh", "midsurface", "wall_check"),
    *("armature", "skeleton_mesh"),
)

SECONDS = 60.0
"""Processor time that docs/promises.md names for fewer than 1,000 vertices."""


def run(case: Case) -> None:
    """Run one of `OPERATIONS` at its defaults; a sentence is as good as a result."""
    name = OPERATIONS[case.number % len(OPERATIONS)]
    points, faces, made = nasty_mesh(case.rng)
    repair = case.rng.random() < 0.8
    keep_shape(case, {"operation": name, "repair": repair, "made": made}, points, faces)
    begin, before = time.process_time(), peak_memory()
    try:
        shape = medialis.make_shape(points, faces, repair=repair)
        with medialis.memory_limit(0):
            check_result(medialis.run(name, shape, threads=1))
    except medialis.MedialisError as error:
        if not str(error).strip():
            raise Fault("an error without a sentence") from error
    check_cost(name, time.process_time() - begin, peak_memory() - before, SLOWER * SECONDS)


KIND = Kind(
    run, processor_seconds=200.0 * SLOWER, wall_seconds=600.0 * SLOWER, memory=12 * GIGABYTE
)
