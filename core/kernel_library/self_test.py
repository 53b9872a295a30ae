"""Hold kernels made ahead of time against numba: the same calls, the same bits.

    python core/kernel_library/self_test.py            # of the package that is installed
    python core/kernel_library/self_test.py --drop     # and let numba compile those that differ

All operations run on small shapes. The first calls of each kernel are done twice, on copies of the
arguments: by the code that was made ahead and by numba on this machine. What they return and what
they write must be the same. A release is tested by this on each system; stored results would not
do, since systems round sines and logarithms differently in the last bit.
"""

from __future__ import annotations

import argparse
import copy
import json
import os
import sys
from collections import Counter
from typing import Any

import numpy as np

import medialis
from medialis.base import jit
from medialis.base.compiling import dispatcher_of

CALLS = 2
"""Calls of each variant that are done twice."""
SHAPES = {"midsurface": "bracket"}
QUICK = {"view_curve_skeleton": {"pairs": 10, "size": 96}, "medial_mesh": {"balls": 20}}
CELLS = 64
"""Resolution of the samples: a quarter of their usual vertices, since only first calls count."""

checked: Counter[str] = Counter()
different: dict[str, str] = {}


def same(one: Any, other: Any) -> bool:
    """Tell whether two values are the same to the bit, but for the kind of a NaN."""
    if isinstance(one, tuple):
        return len(one) == len(other) and all(map(same, one, other))
    equal_nan = np.asarray(one).dtype.kind == "f"
    return bool(np.array_equal(one, other, equal_nan=equal_nan))


def twice(kernel: Any, code: str, function: Any) -> Any:
    """Return a function that does the first calls by numba as well."""
    name = f"{kernel.__module__}:{kernel.__name__} {code}"
    calls = 0

    def call(*arguments: Any) -> Any:
        nonlocal calls
        calls += 1
        if calls > CALLS:
            return function(*arguments)
        copies = copy.deepcopy(arguments)  # one array given twice stays one
        result = function(*arguments)
        expected = dispatcher_of(kernel)(*copies)
        if not same((result, arguments), (expected, copies)):
            different.setdefault(name, f"call {calls} of the run")
        checked[name] += 1
        return result

    return call


def run_all() -> None:
    """Run the operations on small shapes, by one thread: others would write meanwhile."""
    by_name = jit._variants

    def variants(where: str, name: str) -> list[tuple[str, Any]]:
        kernel = getattr(sys.modules[f"medialis.{where}"], name)
        return [(code, twice(kernel, code, made)) for code, made in by_name(where, name)]

    jit._variants = variants
    with medialis.thread_limit(1):
        for operation in medialis.OPERATIONS:
            shape = medialis.sample_shape(SHAPES.get(operation.name, "creature"), resolution=CELLS)
            shape = medialis.make_shape(shape.points, shape.faces, repair=True)
            options = QUICK.get(operation.name, {})
            result = medialis.run(operation.name, shape, threads=1, **options)
            medialis.draw_result(result, width=320, height=240)


def drop(names: set[str]) -> None:
    """Take kernels from the record: numba compiles them then."""
    known = json.loads(jit.RECORD.read_text(encoding="ascii"))
    for about in known.values():
        for name in names & set(about.get("kernels", {})):
            del about["kernels"][name]
    jit.RECORD.write_text(json.dumps(known, indent=1, sort_keys=True), encoding="ascii")


def main() -> int:
    """Say what was compared; 1 when something differs, or nothing is made ahead."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--drop", action="store_true", help="leave out kernels that differ")
    options = parser.parse_args()
    os.environ.pop("MEDIALIS_KERNELS", None)
    if not jit.record():
        print("No kernels are made ahead for this Python.")
        return 1
    run_all()
    for name, where in sorted(different.items()):
        print(f"{name} differs from numba: {where}")
    if options.drop and different:
        drop({name.partition(" ")[0].removeprefix("medialis.") for name in different})
    print(f"{len(checked)} kernels compared with numba, {len(different)} different; {jit.RECORD}")
    return int((bool(different) and not options.drop) or not checked)


if __name__ == "__main__":
    sys.exit(main())
