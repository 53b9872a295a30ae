"""What a report says: numbers for people, parts of its page, and verdicts in one line each.

Sections, tables and histograms are HTML and SVG; `verdicts` tells what is right.
"""

from __future__ import annotations

import html
import math
from collections.abc import Iterable, Mapping, Sequence
from importlib import resources
from typing import Any

from medialis.base.progress import counted


def number(value: Any, digits: int = 4) -> str:
    """Return a value as short text.

    Parameters
    ----------
    value : bool, int, float, str or None
        None and NaN are a dash.
    digits : int
        Significant digits of floats.

    Examples
    --------
    >>> number(1234567), number(0.022146883), number(432190.4), number(2.5e-9)
    ('1,234,567', '0.02215', '432,190', '2.5e-09')
    >>> number(float("nan")), number(float("inf")), number(True), number(4.0)
    ('–', 'infinite', 'yes', '4')
    """
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}"
    if not isinstance(value, float):
        return str(value)
    if math.isinf(value):
        return "infinite" if value > 0 else "minus infinite"
    if value == 0:
        return "0"
    if not 1e-4 <= abs(value) < 1e9:
        return f"{value:.{digits}g}"
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    text = f"{value:,.{decimals}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def place(position: Sequence[float], size: float) -> str:
    """Return a position with the decimals that tell places apart in something of a size.

    Examples
    --------
    >>> place([1000000.25, 0.123456, -2], 4.0)
    '(1,000,000.250, 0.123, -2.000)'
    >>> place([1.2345678e-20, 0.0, 1e-21], 4e-20)
    '(1.235e-20, 0, 1e-21)'
    """
    if not 1e-6 < size < 1e9:
        return f"({', '.join(number(float(x)) for x in position)})"
    decimals = max(0, 3 - math.floor(math.log10(size)))
    return f"({', '.join(f'{x:,.{decimals}f}' for x in position)})"


def named(name: str) -> str:
    """Return the name of a value in words.

    Examples
    --------
    >>> named("pixels_that_differ_percent"), named("nonmanifold_edges")
    ('pixels that differ (%)', 'non-manifold edges')
    """
    words = name.removesuffix("_percent").replace("_", " ").replace("nonmanifold", "non-manifold")
    return words + (" (%)" if name.endswith("_percent") else "")


MARKS = {"good": "✓", "look": "!", "info": "·"}
WORDS = {"good": "right", "look": "look at this", "info": "for your information"}


def page(title: str, style: str, *body: str) -> str:
    """Return a page that loads nothing from elsewhere; `style` is the text of a style sheet."""
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{html.escape(title)}</title><style>\n{style}</style></head><body>\n"
        + "\n".join(filter(None, body))
        + "\n</body></html>\n"
    )


def data_text(package: str, name: str) -> str:
    """Return the text of a data file of a package, such as a style sheet."""
    return (resources.files(package) / name).read_text("utf-8")


def section(title: str, *body: str) -> str:
    """Return a titled section, nothing when it has no content."""
    full = "\n".join(filter(None, body))
    heading = f"<h2>{html.escape(title)}</h2>\n" if title else ""
    return f"<section>\n{heading}{full}\n</section>" if full else ""


def verdict_list(lines: Iterable[Mapping[str, str]]) -> str:
    """Return the verdicts as a list with a mark each."""
    items = "".join(
        f'<dt class="{line["state"]}"><span title="{WORDS[line["state"]]}">'
        f"{MARKS[line['state']]}</span> {html.escape(line['about'])}</dt>"
        f"<dd>{html.escape(line['text'])}</dd>"
        for line in lines
    )
    return f"<dl>{items}</dl>" if items else ""


def bullets(lines: Iterable[str]) -> str:
    """Return lines of text as a list."""
    items = "".join(f"<li>{html.escape(line)}</li>" for line in lines)
    return f"<ul>{items}</ul>" if items else ""


def table(rows: Iterable[Sequence[str]], head: Sequence[str] = ()) -> str:
    """Return rows of text as a table."""
    body = "".join(
        f"<tr>{''.join(f'<td>{html.escape(cell)}</td>' for cell in row)}</tr>" for row in rows
    )
    top = "".join(
        f'<th scope="col">{html.escape(cell)}</th>' if cell else "<td></td>" for cell in head
    )
    if not body:
        return ""
    first = f"<tr>{top}</tr>" if top else ""
    return f'<div class="wide" tabindex="0"><table>{first}{body}</table></div>'


def records(rows: Sequence[Mapping[str, Any]], most: int) -> str:
    """Return things of the same kind as a table with their fields in columns."""
    if not rows:
        return ""
    shown = table(
        [[cell(value) for value in row.values()] for row in rows[:most]],
        [named(name) for name in rows[0]],
    )
    if len(rows) > most:
        shown += f'<p class="soft">{len(rows) - most:,} more are in report.json.</p>'
    return shown


def cell(value: Any, most: int = 12) -> str:
    """Return a value or a list of values as text."""
    if not isinstance(value, list | tuple):
        return number(value)
    shown = ", ".join(number(item) for item in value[:most])
    return f"{shown}, … ({len(value):,} in all)" if len(value) > most else shown or "–"


def chart(found: Mapping[str, Any], caption: str, factor: float = 1.0) -> str:
    """Return a histogram of `measures.histogram` as SVG with its range and median below."""
    counts = found["counts"]
    notes = [f"{found['count']:,} values"]
    if found["median"] is not None:
        notes.append(f"median {number(factor * found['median'])}")
    others = [name for name in ("infinite", "missing") if found[name]]
    notes += [f"{found[name]:,} {name}, not shown" for name in others]
    picture = ""
    if len(counts) == 1:
        notes.append("all equal")
    elif counts:
        picture = _bars(counts, found["edges"], found["median"], factor)
    text = html.escape("; ".join(notes))
    return (
        f"<figure><h3>{html.escape(caption)}</h3>{picture}<figcaption>{text}</figcaption></figure>"
    )


def _bars(counts: Sequence[int], edges: Sequence[float], median: float, factor: float) -> str:
    width, height = 320, 120
    bar, top = width / len(counts), max(counts)
    bars = "".join(
        f'<rect x="{i * bar:.1f}" y="{12 + height * (1 - count / top):.1f}" '
        f'width="{bar - 0.6:.1f}" height="{height * count / top:.1f}"/>'
        for i, count in enumerate(counts)
        if count
    )
    base, ends = height + 12, [number(factor * edge) for edge in (edges[0], edges[-1])]
    middle = width * (median - edges[0]) / (edges[-1] - edges[0])
    return (
        f'<svg viewBox="0 0 {width} {height + 32}" role="img" aria-label="histogram">'
        f'<text x="0" y="9">{top:,}</text>{bars}'
        f'<line x1="0" y1="{base}" x2="{width}" y2="{base}"/>'
        f'<path d="M{middle:.1f} {base + 1}l4 7h-8z" fill="currentColor"/>'
        f'<text x="0" y="{height + 30}">{ends[0]}</text>'
        f'<text x="{width}" y="{height + 30}" text-anchor="end">{ends[1]}</text></svg>'
    )


GOOD, LOOK, INFO = "good", "look", "info"
NOUNS = {
    "pieces": "piece",
    "sheets": "sheet",
    "y_curves": "Y-curve",
    "parts": "part",
    "segments": "segment",
    "manifolds": "manifold",
    "patches": "patch",
    "bones": "bone",
}
"""Values of results that count what was found."""

ROUNDING = 1e-6
"""Share of the tolerance that a depth may exceed it by rounding."""


def verdicts(found: Mapping[str, Any]) -> list[dict[str, str]]:
    """Judge the measures of a run.

    Parameters
    ----------
    found : dict
        From `medialis.show.reports.measures.measure`, without the verdict.

    Returns
    -------
    list of dict
        ``about``, ``state`` and ``text``. The state is "good" where something that is known to be
        right was checked and holds, "look" where it does not hold or something is missing, and
        "info" where there is nothing to compare a number with.
    """
    judges = {
        **{"emptiness": _emptiness, "reconstruction": _reconstruction, "envelope": _envelope},
        **{"centredness": _centredness, "balls": _balls, "thin_spots": _thinnest, "values": _walls},
    }
    lines = [judge(found) for name, judge in judges.items() if found[name] is not None]
    return [
        *_topology(found["topology"], found["input"]["as_computed"]),
        *filter(None, lines),
        _notes(found["messages"]),
    ]


def _line(about: str, state: str, text: str) -> dict[str, str]:
    return {"about": about, "state": state, "text": text}


def _topology(topology: Mapping[str, Any], after: Mapping[str, Any]) -> list[dict[str, str]]:
    lines = []
    if "loops" in topology:
        lines.append(_loops(topology, after))
        expected, got = topology["expected_components"], topology["skeleton_components"]
        text = f"{number(got)} found; a point cloud does not tell how many to expect."
        if expected is not None:
            text = f"{number(expected)} expected (the parts of the shape), {number(got)} found."
        lines.append(_line("Components", _compared(expected, got), text))
    else:
        lines.append(_line("Shape", INFO, _shape(topology, after)))
    if topology.get("expected_handles") is not None:
        lines.append(_solid(topology))
    counts = [counted(count, NOUNS[name]) for name, count in topology["found"].items()]
    if counts:
        lines.append(_line("Found", INFO, ", ".join(counts) + "."))
    return lines


def _solid(topology: Mapping[str, Any]) -> dict[str, str]:
    """Compare a medial mesh with the solid that the surface bounds."""
    names = (("parts_and_hollows", "surface piece"), ("handles", "handle"))
    right = all(topology[name] == topology[f"expected_{name}"] for name, _ in names)
    expected = " and ".join(counted(topology[f"expected_{name}"], noun) for name, noun in names)
    found = " and ".join(counted(topology[name], noun) for name, noun in names)
    text = f"The medial mesh is that of a solid with {expected}."
    if not right:
        text = f"{expected} expected, the medial mesh has {found}."
    return _line("Topology", GOOD if right else LOOK, text)


def _compared(expected: int | None, got: int) -> str:
    if expected is None:
        return INFO
    return GOOD if expected == got else LOOK


def _loops(topology: Mapping[str, Any], after: Mapping[str, Any]) -> dict[str, str]:
    expected, got = topology["expected_loops"], topology["loops"]
    why = "edges with three or more faces, or vertices that join sheets, leave it undefined"
    if after["faces"] == 0:
        why = "a point cloud has no handles to count"
    text = f"{number(got)} found; how many to expect is not known: {why}."
    if expected is not None:
        text = f"{number(expected)} expected (one for each handle), {number(got)} found."
        if expected == 0 and got == 0:
            text = "No loop expected (the shape has no handle), none found."
    if not topology["expected_loops_certain"]:
        text += " What is expected is a guess: edges with an odd number of faces, or no outside."
        return _line("Loops", INFO, text)
    return _line("Loops", _compared(expected, got), text)


def _shape(topology: Mapping[str, Any], after: Mapping[str, Any]) -> str:
    if topology["components"] is None:
        return f"A cloud of {counted(after['vertices'], 'point')}."
    text = counted(topology["components"], "component")
    genus = topology["genus"]
    text += ", handles not defined" if genus is None else f", {counted(genus, 'handle')} (genus)"
    holes = topology["boundary_loops"]
    return text + (f", open with {counted(holes, 'hole')}." if holes else ", closed.")


def _emptiness(found: Mapping[str, Any]) -> dict[str, str]:
    deepest, parameters = found["emptiness"]["deepest"], found["parameters"]
    if deepest == 0:
        return _line("Emptiness", GOOD, "No sample of the surface lies inside a ball.")
    text = f"The deepest sample lies {number(deepest, 3)} % of the diagonal inside a ball"
    if not found["balls"]["by_shrinking"] or "tolerance" not in parameters:
        return _line("Emptiness", INFO, text + ".")
    allowed = 100 * parameters["tolerance"]
    within = deepest <= allowed * (1 + ROUNDING) + 100 * ROUNDING**2
    text += f": {'within' if within else 'more than'} the tolerance of {number(allowed)} %."
    return _line("Emptiness", GOOD if within else LOOK, text)


def _reconstruction(found: Mapping[str, Any]) -> dict[str, str]:
    error = found["reconstruction"]
    what, after = found["balls"]["what"], found["input"]["as_computed"]
    where = place(error["worst_place"], after["diagonal"])
    text = (
        f"Hausdorff distance from the surface to the {what} {_one_way(error, 'surface_to_balls')}, "
        f"back {_one_way(error, 'balls_to_surface')}; the largest is at {where}."
    )
    if found["balls"]["by_shrinking"] and not after["closed"]:
        text += " Balls bulge out at holes."
    return _line("Reconstruction", INFO, text)


def _envelope(found: Mapping[str, Any]) -> dict[str, str]:
    error = found["envelope"]
    where = place(error["worst_place"], found["input"]["as_computed"]["diagonal"])
    text = (
        f"The surface and the envelope are {number(error['largest_error'], 3)} % of the diagonal "
        f"apart at most (mean {number(error['mean_error'], 2)} %); the largest is at {where}."
    )
    return _line("Envelope", INFO, text)


def _one_way(error: Mapping[str, Any], way: str) -> str:
    largest, mean = error[f"{way}_max"], error[f"{way}_mean"]
    if largest is None:
        return "not seen"
    return f"{number(largest, 3)} % of the diagonal (mean {number(mean, 2)} %)"


def _centredness(found: Mapping[str, Any]) -> dict[str, str]:
    share = found["centredness"]
    return _line(
        "Centredness",
        INFO,
        f"Distance to the surface over the radius: median {number(share['median'], 3)}, from "
        f"{number(share['lowest'], 3)} to {number(share['highest'], 3)}; 1 is centred.",
    )


def _balls(found: Mapping[str, Any]) -> dict[str, str] | None:
    counts = found["balls"]
    if "started" not in counts:
        return None
    missing = {"open": "without a second contact", "without_normal": "without a normal"}
    why = [f"{number(counts[name])} {text}" for name, text in missing.items() if counts[name]]
    text = f"{number(counts['maximal'])} of {counted(counts['started'], 'ball')} are maximal"
    return _line("Balls", INFO if why else GOOD, "; ".join([text, *why]) + ".")


def _thinnest(found: Mapping[str, Any]) -> dict[str, str]:
    spots = found["thin_spots"]
    if not spots:
        return _line("Thin spots", GOOD, "No place is thinner than the threshold.")
    value, diagonal = spots[0]["value"], found["input"]["as_computed"]["diagonal"]
    share = f" ({number(100 * value / diagonal, 3)} % of the diagonal)" if diagonal > 0 else ""
    text = f"{number(len(spots))} listed, the thinnest {number(value)}{share}."
    return _line("Thin spots", INFO, text)


def _walls(found: Mapping[str, Any]) -> dict[str, str] | None:
    values = found["values"]
    if "passed" not in values:
        return None
    told = values.get("part_lines")
    lines = f" {counted(told, 'wall', verbs=('is', 'are'))} not whole lines." if told else ""
    if values["passed"]:
        return _line("Walls", INFO if told else GOOD, f"All walls are within the limits.{lines}")
    if values["passed"] is None:
        return _line("Walls", LOOK, values["verdict"])
    words = {"too_thin": "too thin", "too_thick": "too thick", "narrow_gaps": "gaps too narrow",
             "thick_ribs": "ribs too thick for their wall"}  # fmt: skip
    counts = [f"{number(values[name])} {text}" for name, text in words.items() if values[name]]
    return _line("Walls", LOOK, f"{', '.join(counts)}.{lines}")


def _notes(messages: list[str]) -> dict[str, str]:
    if not messages:
        return _line("Notes", GOOD, "Nothing was repaired, refined or left out.")
    return _line("Notes", INFO, f"{counted(len(messages), 'note')} below.")
