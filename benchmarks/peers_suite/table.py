"""The table of the comparison, and the page that it stands on."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

import medialis
from peers_suite.measure import ACROSS, FINE_VOXELS, NAMES, VOXELS, cases
from peers_suite.methods import Method, Settings

Outcomes: TypeAlias = list[tuple[Method, Settings, dict[str, dict]]]
"""Each method with its settings, and what was measured on each shape."""

COLUMNS = ("method", "settings", "seconds", "done", "topology right", "ends right", "inside",
           "off centre", "reached", "thickness error", "95 %")  # fmt: skip


def summary(rows: dict[str, dict]) -> dict[str, float]:
    """Return one row for all shapes: sums of seconds and of what is right, means of the others.

    Shapes that were not done count as wrong and are left out of the means.
    """
    done = [row for row in rows.values() if "seconds" in row]
    found = {"done": float(len(done))}
    for name in ("seconds", "topology", "ends"):
        values = [row[name] for row in done if name in row]
        found |= {name: float(np.sum(values))} if values else {}
    for name in ("inside", "off", "reached", "error", "error_95"):
        values = [row[name] for row in done if name in row]
        found |= {name: float(np.mean(values))} if values else {}
    return found


def rank(method: Method, rows: dict[str, dict]) -> tuple[float, ...]:
    """Return what settings are compared by; the smallest is the best."""
    one = summary(rows)
    if method.makes == "thickness":
        return -one["done"], one.get("error_95", np.inf)
    right = (-one.get(name, 0.0) for name in ("topology", "ends", "reached"))
    return *right, one.get("off", np.inf)


def chosen(outcomes: Outcomes) -> Outcomes:
    """Return the defaults of each method, and its best other settings where they are better."""
    found: Outcomes = []
    for method in {method.name: method for method, _, _ in outcomes}.values():
        own = [outcome for outcome in outcomes if outcome[0] is method]
        best = min(own, key=lambda outcome: rank(method, outcome[2]))
        found += [own[0]] if best is own[0] else [own[0], best]
    return found


def table(outcomes: Outcomes) -> str:
    """Return the table as Markdown."""
    count = len(NAMES)
    found = [f"| {' | '.join(COLUMNS)} |", "|---" * len(COLUMNS) + "|"]
    for method, settings, rows in chosen(outcomes):
        one = summary(rows)

        def told(name: str, form: str, one: dict[str, float] = one) -> str:
            return form.format(one[name]) if name in one else ""

        words = ", ".join(f"{name} {value}" for name, value in settings.items())
        default = settings == method.default
        found.append(
            "| "
            + " | ".join([
                method.label,
                ("default" + f": {words}" * bool(words)) if default else words,
                told("seconds", "{:.2f}"),
                f"{one['done']:.0f} of {count}",
                told("topology", f"{{:.0f}} of {count}"),
                told("ends", f"{{:.0f}} of {count}"),
                told("inside", "{:.1f} %"),
                told("off", "{:.1f} %"),
                told("reached", "{:.1f} %"),
                told("error", "{:.1f} %"),
                told("error_95", "{:.1f} %"),
            ])
            + " |"
        )  # fmt: skip
    return lines(found)


BETTER = {"seconds": -1, "topology": 1, "ends": 1, "inside": 1, "off": -1, "reached": 1,
          "error": -1, "error_95": -1}  # fmt: skip
"""What is measured, and whether more of it is better."""

SAID = {
    "seconds": "seconds",
    "topology": "right topologies",
    "ends": "right ends",
    "inside": "per cent inside",
    "off": "per cent off the centre",
    "reached": "per cent reached",
    "error": "per cent of error (median)",
    "error_95": "per cent of error (95 %)",
}


def winners(outcomes: Outcomes) -> list[str]:
    """Return a sentence for each measure: medialis, and the best of the others that did all."""
    said = []
    for makes in ("skeleton", "thickness"):
        rows = [(m, summary(rows)) for m, _, rows in chosen(outcomes) if m.makes == makes]
        rows = [(method, one) for method, one in rows if one["done"] == len(NAMES)]
        for name, sign in BETTER.items():
            own = [one[name] for m, one in rows if m.package == "medialis" and name in one]
            peers = [(one[name], m.label) for m, one in rows
                     if m.package != "medialis" and name in one]  # fmt: skip
            if not own or not peers:
                continue
            value, label = max(peers, key=lambda peer: sign * peer[0])
            # As the table tells them: differences below its digits are none.
            gap = sign * (round(value, 2) - round(own[0], 2))
            verdict = "**better than**" if gap > 0 else "as good as" if gap == 0 else "behind"
            said.append(
                f"- {makes.capitalize()}, {SAID[name]}: {label} ({value:.3g}) is {verdict} "
                f"medialis ({own[0]:.3g})."
            )
    said += nearer(outcomes)
    return said


def nearer(outcomes: Outcomes) -> list[str]:
    """Return a sentence for each shape on which another right skeleton is nearer to the centre."""
    rows = [(m, found) for m, _, found in chosen(outcomes) if m.makes == "skeleton"]
    own = [found for method, found in rows if method.package == "medialis"]
    said = []
    for stem, case in cases().items() if own else ():
        ours = own[0].get(stem, {}).get("off", np.inf)
        others = [(found[stem]["off"], method.label) for method, found in rows
                  if found.get(stem, {}).get("topology")]  # fmt: skip
        least, label = min(others, default=(np.inf, ""))
        if least < ours:
            said.append(
                f"- On the {case.name}, {label} is nearer to the centre: {least:.3g} % off, "
                f"medialis {ours:.3g} %."
            )
    return said


def lines(texts: Sequence[str]) -> str:
    """Return texts in lines."""
    return "\n".join(texts)


def each_shape(outcomes: Outcomes) -> str:
    """Return right topologies and seconds by shape."""
    stems = list(cases())
    found = [f"| method | settings | {' | '.join(NAMES)} |", "|---" * (len(stems) + 2) + "|"]
    for method, settings, rows in chosen(outcomes):
        words = ", ".join(f"{name} {value}" for name, value in settings.items()) or "default"
        cells = [_cell(rows.get(stem)) for stem in stems]
        found.append(f"| {method.label} | {words} | {' | '.join(cells)} |")
    return lines(found)


def _cell(row: dict | None) -> str:
    if row is None:
        return "not in time"
    if "failed" in row:
        return "failed"
    if "error_95" in row:
        return f"{row['error_95']:.3g} %"
    return f"{'right' if row['topology'] else 'wrong'}, {row['off']:.3g} %"


def page(outcomes: Outcomes, versions: dict[str, str], installing: float, running: float) -> str:
    """Return docs/peers.md; installing and running took so many minutes."""
    failures: Sequence[str] = sorted({
        f"- {method.label} {settings or ''} on {stem}: {row['failed']}"
        for method, settings, rows in chosen(outcomes)
        for stem, row in rows.items()
        if "failed" in row
    })  # fmt: skip
    sizes = [case.shape.point_count for case in cases().values()]
    names = ", ".join(f"{name} {number}" for name, number in versions.items())
    return f"""# Compared with others

`python benchmarks/peers.py --write` makes this page from nothing: it installs the packages into an
environment of their own, makes ten shapes, runs everything and measures. On two busy processors it
took {installing:.0f} minutes to install and {running:.0f} to run,
{datetime.date.today().isoformat()}.

medialis {medialis.__version__}; {names}.

The shapes are solids round known curves (envelopes of balls, tubes round networks), so that pieces,
loops, ends, center and thickness are known: {", ".join(NAMES)}. Their meshes
have {ACROSS} samples across the smallest thickness ({min(sizes):,} to {max(sizes):,} vertices).
Packages that take voxels get the exact solid with {VOXELS} voxels across the smallest thickness
(*fine*: {FINE_VOXELS}). Each package runs with its defaults, and with the best of some other
settings where those are better (`benchmarks/peers_suite/methods.py` has all that were tried);
medialis with its defaults only. Lengths in settings are in smallest thicknesses of the shape.

- **seconds**: of processors, for all ten shapes; loading and compiling at first use, and making
  voxels, not counted.
- **done**: shapes that came to a result, within a minute of processors for all ten.
- **topology right**: one piece and the true number of loops. **ends right**: their true number.
- **inside**: share of the length of the skeleton that lies in the true solid.
- **off centre**: mean distance from the true curve along the skeleton, in shares of the radius.
- **reached**: share of the true curve that has the skeleton within a radius.
- **thickness error**: of the vertices of the mesh, the median and what 95 % do not exceed.

{table(outcomes)}

## Where a peer is better

The best of the others that did all ten shapes, measure by measure.

{lines(winners(outcomes))}

Most functions of skeletor, and kimimaro, make trees, for neurons: they cannot have the loops of
{_looped()} of these shapes. That is what they are for, and no mistake. PyGEL3D,
CGAL and voxels keep loops.

## By shape

Topology and distance from the centre; of thickness, what 95 % of the errors do not exceed.

{each_shape(outcomes)}
{lines(["", "## What failed", "", *failures, ""]) if failures else ""}
## Not compared

masbcpp (medial balls of clouds, by the algorithm that [ball shrinking](surface_skeleton.md) rests
on) has no package. The shapes are tubes: skeletons of plates, where no curve is the true one, are
measured in [accuracy](accuracy.md) for medialis alone. Scans, noise and sizes above
{max(sizes):,} vertices are not in this table.
"""


def _looped() -> int:
    return sum(bool(case.known.loops) for case in cases().values())
