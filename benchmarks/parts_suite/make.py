"""Write the parts: a STEP file, STL files and what is known of each, as JSON.

    python benchmarks/parts_suite/make.py FOLDER [--kinds tee ell] [--radii 0 0.5] [--held-out]

Run it with a Python that has cadquery (`pip install "cadquery>=2.5"`), which the program does not
need. Kinds that are held out are left out without `--held-out`. What is there already stays.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import cadquery as cq

from parts_suite.kinds import KINDS, made
from parts_suite.truth import HELD_OUT, RADII, TESSELLATIONS

TURN = 0.5
"""Radians between neighbouring facets, at most: lengths decide as a rule."""


def main() -> None:
    """Parse the command line and write the files."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--kinds", nargs="*", default=list(KINDS), choices=list(KINDS))
    parser.add_argument("--radii", nargs="*", type=float, default=list(RADII))
    parser.add_argument("--held-out", action="store_true")
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    for kind in given.kinds:
        if kind in HELD_OUT and not given.held_out:
            continue
        for ratio in given.radii:
            name = f"{kind}_r{ratio:g}"
            truth = given.folder / f"{name}.json"
            if truth.exists():
                continue
            try:
                part = made(kind, ratio)
            except Exception as error:  # noqa: BLE001 - Open CASCADE raises classes of its own
                print(f"{name}: not made, {type(error).__name__}: {error}")
                continue
            work = cq.Workplane(part.solid)
            cq.exporters.export(work, str(given.folder / f"{name}.step"))
            for step in TESSELLATIONS:
                # A solid keeps its triangles, also finer ones: each time from the model.
                again = cq.importers.importStep(str(given.folder / f"{name}.step")).val()
                path = str(given.folder / f"{name}_{step:g}.stl")
                again.exportStl(path, step, TURN, relative=False)
            known = part.truth() | {"volume": float(part.solid.Volume())}
            truth.write_text(json.dumps(known), encoding="utf-8")
            print(f"{name}: volume {known['volume']:.6g}", flush=True)


if __name__ == "__main__":
    main()
