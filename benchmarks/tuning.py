"""How far results move when each number that tunes an algorithm is halved and doubled.

    python benchmarks/tuning.py                     # all folders that have numbers; hours
    python benchmarks/tuning.py walls rigging       # these folders of the core
    python benchmarks/tuning.py --kernels segments  # the numbers of its kernels
    python benchmarks/tuning.py --report            # the table of what was measured
    python benchmarks/tuning.py --write             # beside each number, in the sources

A number that tunes is a named constant at the top of a module with a text that says unit and
reason. Each is halved and doubled on a dozen small shapes, made by code, and the operations of its
folder are run with one thread. What moves is the largest relative change of what a result tells:
counts and measures among its values, the rows of its layers, the means of their attributes. 0 %
means that all of them are the same on all shapes: the number is a bound on work, a tolerance of
rounding, or has no use. 100 % may also mean that the result came to be, or no longer did.

What a number cannot change is not computed again: an operation that called no function that reads
it, and kept results of modules that do not import its own. On each shape the first operation of the
folder that reads a number is run. Numbers that are read at import, for
defaults and other constants, and those of kernels, which are compiled anew, have a process of their
own. Results stand in tuning.json, and a run goes on where the last one ended; an entry is measured
anew when the value in the code is another one.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from tuning_suite.numbers import (
    PACKAGE,
    WAYS,
    Number,
    is_read_at_import,
    module_of,
    numbers,
    other_values,
    percent,
    with_comments,
)

RECORD = Path(__file__).resolve().parent / "tuning.json"

FEATURES = {
    "rigging": ("armature figures=False", "armature"),
    "walls": ("wall_check", "thickness"),
    "walls/midsurface": ("midsurface",),
    "segments": ("parts", "parts method=limbs", "patches", "soft_edges", "mean_shift_segments"),
    "curves": ("curve_skeleton", "centerline", "tree_cylinders"),
    "sheets": ("point_types", "medial_sheets"),
    "clouds": ("manifolds", "remove_outliers", "smooth"),
    "skeleton": ("surface_skeleton", "skeleton_mesh", "skeleton_importance"),
    "skeleton/importance": ("skeleton_importance",),
    "shape": ("skeleton_mesh", "soft_edges", "curve_skeleton"),
    "curves/from_views": ("view_curve_skeleton",),
    "medial_meshes": ("medial_mesh",),
}
"""Which operations are run for the numbers of a folder: on each shape the first that reads one."""

SLOW = {"medial_mesh": 4, "view_curve_skeleton": 3}
"""Operations that take seconds: one in so many shapes."""


def pairs(folder: str) -> list[tuple[str, str]]:
    """Return the operations of a folder with the shapes that each is run on."""
    from tuning_suite import shapes

    names = [*(shapes.CLOUDS if folder == "clouds" else shapes.SOLIDS)]
    return [(op, name) for op in FEATURES[folder] for name in names[:: SLOW.get(op, 1)]]


def readers(number: Number, folder: str, base: Any) -> list[tuple[str, str]]:
    """Return the first operation that reads a number with each shape on which one does.

    Who reads numbers of kernels, and those that are read at import, is not known: all of them.
    """
    if is_read_at_import(number):
        return pairs(folder)
    found: dict[str, str] = {}
    for operation, name in pairs(folder):
        if name not in found and base.reads((operation, name), number):
            found[name] = operation
    return [(operation, name) for name, operation in found.items()]


def measured(number: Number, folder: str, base: Any) -> dict[str, Any]:
    """Return the entry of a number: its value, how many results read it, what each way moves."""
    from tuning_suite.runs import change, in_own_process

    own = is_read_at_import(number)
    chosen = readers(number, folder, base)
    entry: dict[str, Any] = {"value": number.value, "reached": len(chosen)}
    for way, value in other_values(number).items():
        run = in_own_process if own else base.with_value
        changes = {
            pair: change(base.result(pair), after)
            for pair, after in zip(chosen, run(number, value, chosen), strict=True)
        }
        pair, (most, what) = max(
            changes.items(), key=lambda item: item[1], default=(("", ""), (0, ""))
        )
        all_of_them = [one for one, _ in changes.values()]
        all_of_them += [0.0] * (len({name for _, name in pairs(folder)}) - len(chosen))
        where = f"{pair[0]}, {pair[1]}: {what}" if most else ""
        entry[way] = [round(float(np.median(all_of_them)), 6), round(most, 6) or most, where]
    return entry


def measure(folders: list[str], seconds: float, *, kernels: bool) -> None:
    """Measure the numbers that the record does not have yet, or with another value."""
    from tuning_suite.runs import ROOM, Base

    import medialis

    base, end = Base(), time.monotonic() + seconds
    with medialis.memory_limit(ROOM):
        for folder in folders:
            for number in numbers(folder):
                known = read_record().get(number.key, {})
                if number.in_kernels is not kernels or known.get("value") == number.value:
                    continue
                if time.monotonic() > end:
                    return
                clock = time.monotonic()
                entry = measured(number, folder, base)
                write_record({**read_record(), number.key: entry})
                said = ", ".join(f"{way} {percent(entry[way][1])}" for way in WAYS if way in entry)
                told = f"{number.key} = {number.value:g}: {said}; {entry['reached']} results"
                print(f"{told} ({time.monotonic() - clock:.0f} s)", flush=True)
            if not kernels:
                medialis.forget()


def read_record() -> dict[str, Any]:
    """Return what was measured, by the names of the numbers."""
    return json.loads(RECORD.read_text(encoding="utf-8")) if RECORD.exists() else {}


def write_record(record: dict[str, Any]) -> None:
    """Write what was measured, a line for each number."""
    lines = [f"{json.dumps(key)}: {json.dumps(record[key])}" for key in sorted(record)]
    part = RECORD.with_suffix(".part")
    part.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
    part.replace(RECORD)


def known_numbers() -> dict[str, Number]:
    """Return the numbers of all folders that have operations, by the names of the record."""
    return {number.key: number for folder in FEATURES for number in numbers(folder)}


def report(record: dict[str, Any]) -> None:
    """Print the table: the numbers that do least come first."""
    texts = {key: number.text for key, number in known_numbers().items()}
    print("| number | value | what it is | results that read it | halved: median, most | doubled |")
    print("|---|---|---|---|---|---|")
    for key, entry in sorted(
        record.items(), key=lambda item: max(item[1].get(way, [0, 0])[1] for way in WAYS)
    ):
        cells = [
            f"{percent(entry[way][0])}, {percent(entry[way][1])}" if way in entry else "-"
            for way in WAYS
        ]
        told = f"| `{key}` | {entry['value']:g} | {texts.get(key, 'gone')} | {entry['reached']} | "
        print(f"{told}{cells[0]} | {cells[1]} |")


def write(record: dict[str, Any]) -> None:
    """Write what was measured beside each number; entries of numbers that are gone go."""
    known = known_numbers()
    record = {
        key: entry
        for key, entry in record.items()
        if key in known and known[key].value == entry["value"]
    }
    write_record(record)
    for folder in FEATURES:
        for path in sorted((PACKAGE / folder).glob("*.py")):
            source = path.read_text(encoding="utf-8")
            new = with_comments(module_of(path), source, record)
            if new != source:
                path.write_text(new, encoding="utf-8")
                print(path)


def main() -> int:
    """Parse the command line and do what it says."""
    if sys.argv[1:2] == ["--one"]:
        from tuning_suite.runs import one

        one(sys.argv[2])
        return 0
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("folders", nargs="*", choices=[*FEATURES, []], default=[])
    parser.add_argument("--kernels", action="store_true", help="those of kernels instead")
    parser.add_argument("--seconds", type=float, default=1e9, help="begin none after so many")
    parser.add_argument("--report", action="store_true", help="print what was measured")
    parser.add_argument("--write", action="store_true", help="write it beside the numbers")
    arguments = parser.parse_args()
    if arguments.report:
        report(read_record())
    elif arguments.write:
        write(read_record())
    else:
        measure(arguments.folders or [*FEATURES], arguments.seconds, kernels=arguments.kernels)
    return 0


if __name__ == "__main__":
    sys.exit(main())
