"""Parts of a page: sections, tables and histograms as HTML and SVG; numbers for people."""

from __future__ import annotations

import html
import math
from collections.abc import Iterable, Mapping, Sequence
from importlib import resources
from typing import Any


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
    top = "".join(f"<th>{html.escape(cell)}</th>" for cell in head)
    if not body:
        return ""
    return f'<div class="wide"><table>{f"<tr>{top}</tr>" if top else ""}{body}</table></div>'


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
    counts, (width, height) = found["counts"], (320, 120)
    notes = [f"{found['count']:,} values"]
    if found["median"] is not None:
        notes.append(f"median {number(factor * found['median'])}")
    others = [name for name in ("infinite", "missing") if found[name]]
    notes += [f"{found[name]:,} {name}, not shown" for name in others]
    picture = ""
    if len(counts) == 1:
        notes.append("all equal")
    elif counts:
        picture = _bars(counts, found["edges"], found["median"], factor, width, height)
    text = html.escape("; ".join(notes))
    return (
        f"<figure><h3>{html.escape(caption)}</h3>{picture}<figcaption>{text}</figcaption></figure>"
    )


def _bars(
    counts: Sequence[int],
    edges: Sequence[float],
    median: float,
    factor: float,
    width: int,
    height: int,
) -> str:
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
