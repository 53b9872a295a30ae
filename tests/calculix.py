"""CalculiX on written shell models: how far a clamped one bends under a load at its end."""

import shutil
import subprocess

import numpy as np
import pytest

needs_ccx = pytest.mark.skipif(
    shutil.which("ccx") is None, reason="CalculiX is not installed (apt-get install calculix-ccx)"
)

YOUNG = 210_000.0
"""Of steel, in N / mm^2."""


def blocks_of(path):
    """Keyword lines of an input file with the rows of numbers or words below each."""
    blocks = []
    for line in path.read_text().splitlines():
        if line.startswith("**"):
            continue
        if line.startswith("*"):
            blocks.append((line, []))
        else:
            blocks[-1][1].append(line.split(", "))
    return blocks


def nodes_of(path):
    """Places of the nodes, (n, 3)."""
    rows = next(rows for head, rows in blocks_of(path) if head.startswith("*NODE,"))
    return np.array(rows, float)[:, 1:]


def deflection(model, clamped, loaded, *, axis, load, poisson):
    """Mean deflection along an axis of the loaded nodes, which share the load evenly."""
    lines = [
        *("*MATERIAL, NAME=PART", "*ELASTIC", f"{YOUNG}, {poisson}"),
        f"*INCLUDE, INPUT={model.name}",
        *("*NSET, NSET=CLAMPED", *(str(node + 1) for node in clamped)),
        *("*NSET, NSET=LOADED", *(str(node + 1) for node in loaded)),
        *("*BOUNDARY", "CLAMPED, 1, 6", "*STEP", "*STATIC", "*CLOAD"),
        *(f"{node + 1}, {axis + 1}, {load / len(loaded)!r}" for node in loaded),
        *("*NODE PRINT, NSET=LOADED", "U", "*END STEP"),
    ]
    (model.parent / "job.inp").write_text("\n".join(lines) + "\n")
    run = subprocess.run(
        ["ccx", "job"], cwd=model.parent, capture_output=True, text=True, timeout=300
    )
    assert "ERROR" not in run.stdout, run.stdout[-2000:]
    rows = [line.split() for line in (model.parent / "job.dat").read_text().splitlines()]
    found = [float(row[1 + axis]) for row in rows if len(row) == 4]
    assert len(found) == len(loaded)
    return float(np.mean(found))
