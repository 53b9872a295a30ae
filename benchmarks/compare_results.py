"""Record what every operation gives at its defaults on a folder of shapes, and compare two records.

    python benchmarks/compare_results.py record ../shared/shapes before.json
    python benchmarks/compare_results.py record ../shared/shapes after.json
    python benchmarks/compare_results.py compare before.json after.json

A record holds a checksum of each array, every value and message, so that a redesign can show that
it changes no bit, and a sample of each array, so that the table can tell how large a difference is.
Operations that raise are recorded by their sentence. A record that is there is continued.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import medialis

SAMPLED = 500
"""Entries of each array that a record keeps, evenly spread."""


def checksum(values: Any) -> dict[str, Any]:
    """Describe an array: type, shape, checksum, and a sample of its entries."""
    array = np.ascontiguousarray(values)
    flat = array.reshape(-1)
    some = flat[:: max(1, len(flat) // SAMPLED)][: 2 * SAMPLED].astype(float)
    return {
        "dtype": str(array.dtype),
        "shape": list(array.shape),
        "sha256": hashlib.sha256(array.tobytes()).hexdigest(),
        "sample": [x if math.isfinite(x) else str(x) for x in some.tolist()],
    }


def described(result: medialis.Result) -> dict[str, Any]:
    """Describe a result by names: its values, its arrays and those of its layers."""
    found: dict[str, Any] = {f"values/{name}": value for name, value in result.values.items()}
    found["messages"] = [str(message) for message in result.messages]
    for name, array in result.arrays.items():
        found[f"arrays/{name}"] = checksum(array)
    for name, image in result.images.items():
        found[f"images/{name}"] = checksum(image)
    for layer in result.layers:
        place = f"layers/{layer.name}"
        for name in ("points", "faces", "edges"):
            if getattr(layer, name) is not None:
                found[f"{place}/{name}"] = checksum(getattr(layer, name))
        for name, array in {**layer.attributes, **layer.face_attributes}.items():
            found[f"{place}/{name}"] = checksum(array)
    return json.loads(json.dumps(found))


def record(folder: Path, target: Path, wanted: list[str], shapes: list[str]) -> None:
    """Run the operations on all shapes of the folder, the smallest first."""
    known = json.loads(target.read_text()) if target.exists() else {}
    paths = sorted(folder.glob("*.ply"), key=lambda path: path.stat().st_size)
    for path in paths:
        if shapes and path.stem not in shapes:
            continue
        shape = None
        for operation in medialis.OPERATIONS:
            key = f"{path.stem} {operation.name}"
            if key in known or (wanted and operation.name not in wanted):
                continue
            shape = medialis.read_shape(path) if shape is None else shape
            clock = time.process_time()
            try:
                known[key] = described(medialis.run(operation.name, shape))
            except medialis.MedialisError as error:
                known[key] = {"error": str(error)}
            print(f"{key}: {time.process_time() - clock:.1f} s", flush=True)
            target.write_text(json.dumps(known))


def differences(before: dict[str, Any], after: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Tell which entries of two descriptions differ, and by how much."""
    for name in sorted({*before, *after}):
        if name not in after:
            yield name, "gone"
        elif name not in before:
            yield name, "new"
        elif before[name] != after[name]:
            yield name, _difference(before[name], after[name])


def _difference(a: Any, b: Any) -> str:
    if isinstance(a, dict) and isinstance(b, dict) and "sha256" in a and "sha256" in b:
        if a["shape"] != b["shape"] or a["dtype"] != b["dtype"]:
            return f"{a['dtype']} {a['shape']} -> {b['dtype']} {b['shape']}"
        x, y = (np.array([float(v) for v in one["sample"]]) for one in (a, b))
        unequal = ~((x == y) | (np.isnan(x) & np.isnan(y)))
        apart = np.abs(x - y)[unequal & np.isfinite(x - y)].max(initial=0.0)
        return f"{unequal.mean():.2%} of the sampled entries, by up to {apart:.3g}"
    text = f"{a} -> {b}"
    return text if len(text) < 200 else f"{text[:200]} ..."


def compare(before: Path, after: Path) -> int:
    """Print what differs between two records; return how many results do."""
    old, new = (json.loads(path.read_text()) for path in (before, after))
    differing = 0
    for key in sorted({*old, *new}):
        if key not in old or key not in new:
            print(f"{key}: only in {before if key in old else after}")
            differing += 1
            continue
        found = list(differences(old[key], new[key]))
        if found:
            differing += 1
            print(f"{key}:")
            for name, text in found:
                print(f"    {name}: {text}")
    print(f"{differing} of {len({*old, *new})} results differ.")
    return differing


def main() -> int:
    """Parse the command line and do what it says."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    one = commands.add_parser("record")
    one.add_argument("folder", type=Path)
    one.add_argument("target", type=Path)
    one.add_argument("--operations", nargs="*", default=[])
    one.add_argument("--shapes", nargs="*", default=[])
    two = commands.add_parser("compare")
    two.add_argument("before", type=Path)
    two.add_argument("after", type=Path)
    arguments = parser.parse_args()
    if arguments.command == "record":
        record(arguments.folder, arguments.target, arguments.operations, arguments.shapes)
        return 0
    return 1 if compare(arguments.before, arguments.after) else 0


if __name__ == "__main__":
    sys.exit(main())
