"""The accuracy table: computed, kept as numbers, and written as a page."""

from __future__ import annotations

import json
import time
from pathlib import Path

from accuracy_suite.must_hold import requirements
from accuracy_suite.suite import SECTIONS, Row

HERE = Path(__file__).resolve().parents[1]
NUMBERS = HERE / "accuracy.json"
PAGE = HERE.parent / "docs" / "accuracy.md"

Table = dict[str, dict[str, Row]]

HEAD = """# Accuracy

`make accuracy` (`python benchmarks/accuracy.py --write`) measures all of this and writes this page
and the numbers behind it (`benchmarks/accuracy.json`). `--sections NAME ...` measures some tables
and `--only TEXT ...` the rows whose names contain one of the texts; the others stay. A test
recomputes some rows and compares them.

Shapes, meshes and measures are those of `benchmarks/accuracy_suite`: closed forms, CAD parts
(extruded and revolved polygons: their medial axis follows from that of the polygon, in closed
form) and organic shapes (envelopes of balls along curves and on sheets, which are their axis).
Meshes have a stated number of samples across the smallest thickness of the shape; in irregular
ones vertices are moved by chance, by up to 0.3 edges, on the true surface. *As drawn* is a mesh of
as few triangles as the shape needs.
"""

TITLES = {
    "axis": (
        "Skeleton and true medial axis",
        "All inner balls, those of fans at concave creases as well, with `refine = 0` but for "
        "shapes as drawn, which are refined as at the defaults. Lengths in per cent of the "
        "diagonal. `to_axis`: from the centers to the true axis; `from_axis`: from the axis to the "
        "nearest center, so half the spacing of the samples at least. `poke_out`: per cent of the "
        "balls that leave the triangles by more than "
        "1.1 tolerances and the sagitta r (1 - cos a) at their contacts; `poke_out_creases`: the "
        "same with creases of more than 30 degrees as walls. (Facets lie inside of rounded shapes: "
        "on coarse irregular meshes the true balls poke out as well, all of those of a sphere.)",
    ),
    "poke_out": (
        "Balls that poke out of real shapes",
        "Closed meshes of `../shared/shapes` without faces that cross, at the defaults. Per cent "
        "of the balls; `tenth`: those that poke out by more than a tenth of their radius as well; "
        "`worst`: the largest excess in per cent of the diagonal.",
    ),
    "union": (
        "Union of the balls and surface",
        "Edges refined to 0.5 % of the diagonal; lengths in per cent of it. `out`: of the surface "
        "from the union, `back`: of the boundary of the union from the surface.",
    ),
    "rays": (
        "Thickness against rays on opposite parallel walls",
        "At so many samples along the length of a wall, on these samples alone, or refined as the "
        "operation does. `right`: per cent of the judged samples within 2 % of the ray; "
        "`error_95`: per cent of the ray that 95 % of them do not exceed.",
    ),
    "thickness": (
        "Thickness of organic shapes against their true balls",
        "`refine = 0`; columns as above, all samples are judged.",
    ),
    "thin": (
        "The thinnest place",
        "First thin spot of the operation `thickness` at its defaults. `value_error`: per cent of "
        "the true minimum; `off`: distance to the nearest place of the surface that is as thin, in "
        "spacings of the samples.",
    ),
    "noisy_thin": (
        "The thinnest place of noisy shapes",
        "The same of meshes whose vertices lie off by a tenth of their spacing in each direction. "
        "They are smoothed, and what is left of the noise has its own low places: of as many "
        "places as there are samples the lowest is found.",
    ),
    "sheets": (
        "Sheets, areas and Y-curves",
        "`refine = 0`. Errors in per cent of the true value: all areas together, the worst sheet, "
        "and the length of the Y-curves. (A cube has 12 sheets: that in the middle of a box is a "
        "point.)",
    ),
    "curves": (
        "Curve skeletons",
        "The operation at its defaults. `off`: distance of the graph from the true curve in per "
        "cent of the local radius; `missing`: the largest distance of the true curve from the "
        "graph, per cent of the diagonal.",
    ),
    "segments": (
        "Segments",
        "`rand`: adjusted Rand index by area, 1 for the true division. Patches against the faces "
        "of polyhedra at 8 samples across (those on edges do not count), parts against a ball with "
        "six arms and three arms alone.",
    ),
}


def read_table() -> Table:
    """Read the numbers as they were written last; nothing where they were not."""
    return json.loads(NUMBERS.read_text()) if NUMBERS.exists() else {}


def compute(table: Table, sections: list[str], only: list[str]) -> Table:
    """Measure rows and put them into a copy of a table; print each."""
    found = {name: dict(table.get(name, {})) for name in SECTIONS}
    for name in sections or SECTIONS:
        rows = {}
        for title, row in SECTIONS[name]():
            if only and not any(text in title for text in only):
                rows[title] = found[name].get(title, {})
                continue
            clock = time.process_time()
            rows[title] = {key: _rounded(value) for key, value in row().items()}
            print(f"{name}: {title}: {time.process_time() - clock:.1f} s {rows[title]}", flush=True)
        found[name] = {title: row for title, row in rows.items() if row} or found[name]
    return found


def _rounded(value: float | None) -> float | None:
    return value if value is None or isinstance(value, int) else float(f"{value:.4g}")


def write(table: Table) -> None:
    """Write the numbers and the page."""
    NUMBERS.write_text(json.dumps(table, indent=1) + "\n")
    PAGE.write_text(page(table))


def page(table: Table) -> str:
    """Return the page of a table."""
    parts = [HEAD, "## What must hold\n", _requirements(table)]
    for name, (title, text) in TITLES.items():
        parts += [f"## {title}\n", f"{text}\n", _rows(table.get(name, {}))]
    return "\n".join(parts)


def _requirements(table: Table) -> str:
    lines = ["| what | holds | else |", "|---|---|---|"]
    for what, holds, misses in requirements(table):
        lines.append(f"| {what} | {'yes' if holds else 'no'} | {misses} |")
    return "\n".join(lines) + "\n"


def _rows(rows: dict[str, Row]) -> str:
    if not rows:
        return "Not measured.\n"
    names = list(next(iter(rows.values())))
    lines = [f"| shape | {' | '.join(names)} |", "|---|" + "---|" * len(names)]
    for title, row in rows.items():
        lines.append(f"| {title} | {' | '.join(_text(row.get(name)) for name in names)} |")
    return "\n".join(lines) + "\n"


def _text(value: float | None) -> str:
    if value is None:
        return "-"
    return str(value) if isinstance(value, int) else f"{value + 0.0:.4g}"
