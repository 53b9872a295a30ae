"""How far results move when each number that tunes an algorithm is halved and doubled.

    python benchmarks/tuning.py                     # all features; hours
    python benchmarks/tuning.py walls rigging       # these folders of the core
    python benchmarks/tuning.py --report            # the table of what was measured

A number that tunes is a named constant at the top of a module with a text that says unit and
reason. Each is halved and doubled on a dozen shapes, made by code, and the operations of its
feature are run. What moves is the largest relative change of what a result tells: counts and
measures among its values, the rows of its layers, and the means of their attributes. A number
whose change moves nothing on any shape does nothing within a factor of two: it should go, or the
page says why it stays (a bound on work, a tolerance of rounding). Results stand in tuning.json;
a run goes on where the last one ended. Kernels with another number are compiled for it, in a
process of their own and with a cache that is thrown away.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import json
import math
import os
import subprocess
import sys
import tempfile
import time
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import medialis
from medialis.base import cache_folder

HERE = Path(__file__).resolve().parent
RECORD = HERE / "tuning.json"
PACKAGE = cache_folder.PACKAGE
SHAPES = [
    *((name, 56) for name in ("creature", "hand", "tree", "molecule", "vase", "gear", "bracket")),
    *((name, 72) for name in ("hand", "tree", "molecule", "gear", "creature")),
]
"""A dozen shapes that are made in a moment: names and resolutions of `sample_shape`."""

HALF_AND_DOUBLE = ("halved", "doubled")
SLOW = {"medial_mesh", "view_curve_skeleton", "manifolds"}
"""Operations that get every third shape."""

FEATURES = {
    "skeleton": ("surface_skeleton", "skeleton_mesh"),
    "skeleton/importance": ("skeleton_importance",),
    "sheets": ("point_types", "medial_sheets"),
    "curves": ("curve_skeleton",),
    "curves/from_balls": ("curve_skeleton",),
    "curves/graph": ("curve_skeleton",),
    "curves/from_views": ("view_curve_skeleton",),
    "medial_meshes": ("medial_mesh",),
    "walls": ("thickness", "wall_check"),
    "walls/midsurface": ("midsurface",),
    "segments": ("parts", "patches", "soft_edges", "mean_shift_segments"),
    "clouds": ("manifolds", "remove_outliers", "smooth"),
    "rigging": ("armature",),
    "shape": ("surface_skeleton", "skeleton_mesh", "curve_skeleton"),
}
"""Which operations are run for the constants of a folder."""


class Number(NamedTuple):
    """A constant that tunes: module, name, value, and the first sentence of its text."""

    module: str
    name: str
    value: float
    text: str


def numbers(folder: str) -> Iterator[Number]:
    """Find the numbers of a folder, in the order of the sources."""
    for path in sorted((PACKAGE / folder).glob("*.py")):
        body = ast.parse(path.read_text(encoding="utf-8")).body
        for node, after in zip(body, [*body[1:], None], strict=True):
            text = _text(after)
            if not isinstance(node, ast.Assign) or not text:
                continue
            (target,) = node.targets
            names = [one.id for one in ast.walk(target) if isinstance(one, ast.Name)]
            module = ".".join(("medialis", *path.relative_to(PACKAGE).with_suffix("").parts))
            for name in names if all(one.isupper() for one in names) else ():
                value = getattr(importlib.import_module(module), name)
                if type(value) in (int, float) and value and math.isfinite(value):
                    yield Number(module, name, value, text.split(". ")[0].replace("\n", " "))


def _text(node: ast.stmt | None) -> str | None:
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
        return node.value.value if isinstance(node.value.value, str) else None
    return None


def told(result: medialis.Result) -> dict[str, float]:
    """Return what a result tells, as numbers by name; words become checksums."""
    found: dict[str, float] = {}
    for name, many in _flat(result.values, ""):
        numbers = [abs(float(x)) for x in many if isinstance(x, int | float)]
        words = [x for x in many if isinstance(x, str)]
        found[f"{name}: count"] = len(many)
        found[f"{name}: mean"] = sum(numbers) / len(numbers) if numbers else 0.0
        found[f"{name}: words"] = float(zlib.crc32(repr(words).encode()))
    for layer in result.layers:
        for part in ("points", "edges", "faces"):
            rows = getattr(layer, part)
            found[f"{layer.name}/{part}"] = float(0 if rows is None else len(rows))
        for name, values in {**layer.attributes, **layer.face_attributes}.items():
            if values.dtype.kind in "fiu" and len(values):
                usable = values[np.isfinite(values)].astype(float)
                found[f"{layer.name}/{name}"] = float(abs(usable).mean()) if len(usable) else 0.0
        if len(layer.points):
            away = np.linalg.norm(layer.points - result.shape.bounds[0], axis=1)
            found[f"{layer.name}/away"] = float(away.mean())
    return found


def _flat(values: Any, place: str) -> Iterator[tuple[str, list[Any]]]:
    """Yield what stands in values and tables, the rows of a table together."""
    if isinstance(values, Mapping):
        for name, value in values.items():
            yield from _flat(value, f"{place}/{name}")
    elif isinstance(values, list) and values and isinstance(values[0], Mapping):
        for name in values[0]:
            yield from _flat([row.get(name) for row in values], f"{place}/{name}")
    else:
        many = values if isinstance(values, list) else [values]
        yield place, [x for one in many for x in (one if isinstance(one, list) else [one])]


def runs(operations: tuple[str, ...]) -> dict[str, dict[str, float]]:
    """Run operations on the shapes, nothing kept, and return what each result tells."""
    found = {}
    for i, (name, resolution) in enumerate(SHAPES):
        shape = medialis.sample_shape(name, resolution)
        for operation in operations:
            if operation in SLOW and i % 3:
                continue
            key = f"{operation} {name} {resolution}"
            try:
                with medialis.memory_limit(0):
                    found[key] = told(medialis.run(operation, shape))
            except medialis.MedialisError:
                found[key] = {"refused": 1.0}
            except (ArithmeticError, LookupError, ValueError, TypeError, MemoryError):
                found[key] = {"failed": 1.0}
    return found


def moved(
    before: Mapping[str, Mapping[str, float]], after: Mapping[str, Mapping[str, float]]
) -> tuple[float, float, str]:
    """Return the median over the results of how far each moved, the most, and what moved most."""
    apart = []
    for key, known in before.items():
        most, name = 0.0, ""
        for one in {*known, *after[key]}:
            a, b = known.get(one, 0.0), after[key].get(one, 0.0)
            change = abs(a - b) / max(abs(a), abs(b)) if a != b else 0.0
            most, name = max((most, name), (change, f"{key}: {one}"))
        apart.append((most, name))
    most, name = max(apart)
    return float(np.median([one for one, _ in apart])), most, name


def with_value(number: Number, value: float, operations: tuple[str, ...]) -> dict[str, Any]:
    """Run with another value, in every module that has the number by name."""
    old = getattr(sys.modules[number.module], number.name)
    holders = [
        module
        for name, module in list(sys.modules.items())
        if name.startswith("medialis") and getattr(module, number.name, None) is old
    ]
    for module in holders:
        setattr(module, number.name, value)
    try:
        return runs(operations)
    finally:
        for module in holders:
            setattr(module, number.name, old)


def other_values(number: Number) -> dict[str, float]:
    """Return half and double; whole numbers stay whole."""
    whole = isinstance(number.value, int)
    return {
        "halved": max(1, number.value // 2) if whole else number.value / 2,
        "doubled": number.value * 2,
    }


def measure(folder: str, record: dict[str, Any], *, kernels: bool) -> None:
    """Measure the numbers of one folder that the record does not have with this value yet."""
    operations, before = FEATURES[folder], None
    for number in list(numbers(folder)):
        if "kernels" in number.module and not kernels:
            continue
        key = f"{number.module.removeprefix('medialis.')}.{number.name}"
        if record.get(key, {}).get("value") == number.value:
            continue
        clock, entry = time.process_time(), {"value": number.value, "text": number.text}
        for label, value in other_values(number).items():
            if value == number.value:
                continue
            before = before or runs(operations)
            change = _in_own_process if "kernels" in number.module else with_value
            entry[label] = moved(before, change(number, value, operations))
        record[key] = entry
        RECORD.write_text(json.dumps(record, indent=1, sort_keys=True) + "\n")
        both = [f"{label} {entry[label][1]:.2g}" for label in HALF_AND_DOUBLE if label in entry]
        print(f"{key} = {number.value:g}: {', '.join(both)} ({time.process_time() - clock:.0f} s)")


def _in_own_process(number: Number, value: float, operations: tuple[str, ...]) -> dict[str, Any]:
    """Kernels have their numbers compiled in: change them before anything is compiled."""
    with tempfile.TemporaryDirectory() as folder:
        words = [sys.executable, __file__, "--one", number.module, number.name, repr(value)]
        environment = {**os.environ, "MEDIALIS_CACHE_DIR": folder}
        answer = subprocess.run(
            [*words, *operations], capture_output=True, text=True, env=environment, check=True
        )
    return dict(json.loads(answer.stdout.splitlines()[-1]))


def one(module: str, name: str, value: str, operations: list[str]) -> None:
    """Answer `_in_own_process`: set a number of a kernel, run, and print what results tell."""
    loaded = importlib.import_module(module)
    old = getattr(loaded, name)
    for holder in [m for n, m in sys.modules.items() if n.startswith("medialis")]:
        if getattr(holder, name, None) is old:
            setattr(holder, name, ast.literal_eval(value))
    print(json.dumps(runs(tuple(operations))))


def report(record: dict[str, Any]) -> None:
    """Print the table: the numbers that do least come first."""
    print("| number | value | what it is | halved: median, most | doubled: median, most |")
    print("|---|---|---|---|---|")
    for key, entry in sorted(
        record.items(),
        key=lambda item: max(item[1].get(label, [0, 0])[1] for label in HALF_AND_DOUBLE),
    ):
        cells = [
            f"{entry[label][0]:.1%}, {entry[label][1]:.1%}" if label in entry else "-"
            for label in HALF_AND_DOUBLE
        ]
        print(f"| `{key}` | {entry['value']:g} | {entry['text']} | {cells[0]} | {cells[1]} |")


def main() -> int:
    """Parse the command line and do what it says."""
    if sys.argv[1:2] == ["--one"]:
        one(*sys.argv[2:5], sys.argv[5:])
        return 0
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("folders", nargs="*", choices=[*FEATURES, []], default=[])
    parser.add_argument("--kernels", action="store_true", help="those of kernels as well; hours")
    parser.add_argument("--report", action="store_true", help="print what was measured")
    arguments = parser.parse_args()
    record = json.loads(RECORD.read_text()) if RECORD.exists() else {}
    if not arguments.report:
        for folder in arguments.folders or FEATURES:
            measure(folder, record, kernels=arguments.kernels)
    report(record)
    return 0


if __name__ == "__main__":
    sys.exit(main())
