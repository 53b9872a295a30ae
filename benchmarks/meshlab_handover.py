"""What it costs that MeshLab's plugin runs medialis as a child process.

python benchmarks/meshlab_handover.py [--plugin build/plugin-2025.07d/libfilter_medialis.so]

For a mesh of 200,000 vertices: seconds from starting the child to its first line of progress; and
what the hand-over adds to the computation on both sides. The side of the plugin (write the layer,
start a program, read the result, add layers) is measured in pymeshlab with a program that copies a
finished result, so that no computation is in it.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import medialis
from medialis.formats.meshes import read_mesh
from medialis.formats.ply_attributes import write_ply
from medialis.hosts.menu import write_for_host
from medialis.operations.registry import operation

RUNS = 5
IN_PYMESHLAB = f"""
import sys, time
import pymeshlab
pymeshlab.load_plugin(sys.argv[1])
ms = pymeshlab.MeshSet()
ms.load_new_mesh(sys.argv[2])
best = 1e9
for _ in range({RUNS}):
    clock = time.perf_counter()
    ms.apply_filter(sys.argv[3])
    best = min(best, time.perf_counter() - clock)
print(best)
"""


def best_of(function: Callable[[], Any]) -> float:
    """Return the smallest seconds of several calls."""
    found = []
    for _ in range(RUNS):
        clock = time.perf_counter()
        function()
        found.append(time.perf_counter() - clock)
    return min(found)


def first_line(shape: Path, out: Path) -> None:
    """Start the child and wait for its first line of progress."""
    command = [sys.executable, "-m", "medialis", "surface-skeleton", str(shape), "-o", str(out)]
    with subprocess.Popen(
        [*command, "--host", "--progress", "lines"], stderr=subprocess.PIPE
    ) as child:
        if not child.stderr.readline().startswith(b"PROGRESS"):
            sys.exit("The child failed.")
        child.kill()


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="Cost of the hand-over to MeshLab and back.")
    parser.add_argument("--plugin", help="plugin built for the MeshLab of pymeshlab")
    options = parser.parse_args()
    made = medialis.organic_shape(520)
    print(f"{made.point_count} vertices, {made.face_count} faces, {os.cpu_count()} processors")
    with tempfile.TemporaryDirectory() as folder:
        path, out = Path(folder) / "in.ply", Path(folder) / "out"
        write_ply(path, made.points, faces=made.faces)
        print(f"child, start to first line: {best_of(lambda: first_line(path, out)):.3f} s")
        shape = medialis.read_shape(path)
        print(f"child, read the layer: {best_of(lambda: read_mesh(path)):.3f} s")
        for name in ("surface_skeleton", "thickness"):
            result = medialis.run(name, shape)
            spent = best_of(lambda result=result: write_for_host(result, shape, out))
            print(f"child, write the result of {name}: {spent:.3f} s")
            if not options.plugin:
                continue
            program = Path(folder) / "medialis"  # called as: medialis COMMAND in.ply --output OUT
            program.write_text(f'#!/bin/sh\nexec cp -r "{out}" "$4"\n')
            program.chmod(0o755)
            filter_name = operation(name).filter_name
            done = subprocess.run(
                [sys.executable, "-c", IN_PYMESHLAB, options.plugin, str(path), filter_name],
                env={**os.environ, "MEDIALIS_PROGRAM": str(program)},
                capture_output=True, text=True, check=True,
            )  # fmt: skip
            print(f"plugin, hand over and read back {name}: {float(done.stdout.split()[-1]):.3f} s")


if __name__ == "__main__":
    main()
