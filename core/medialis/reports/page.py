"""Parts of a page: sections, tables and histograms, as HTML and SVG."""

from __future__ import annotations

import html
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from medialis.reports.wording import named, number

STYLE = """
:root { color-scheme: light dark; --back: #f5f6f8; --card: #fff; --ink: #1d2126; --soft: #5d6670;
  --line: #e3e6ea; --bar: #3b6fb6; --good: #1a7f4b; --look: #b04a00; --info: #5d6670; }
@media (prefers-color-scheme: dark) { :root { --back: #14161a; --card: #1e2126; --ink: #e4e6e9;
  --soft: #a0a8b2; --line: #33383f; --bar: #6d9fe0; --good: #5bc88d; --look: #f0a060;
  --info: #a0a8b2; } }
* { box-sizing: border-box; }
body { font: 15px/1.5 system-ui, sans-serif; margin: 0 auto; max-width: 76rem; padding: 1.5rem 1rem;
  background: var(--back); color: var(--ink); }
h1 { margin: 0; font-size: 1.7rem; line-height: 1.2; overflow-wrap: anywhere; }
h2 { font-size: 1.15rem; margin: 0 0 .6rem; } h3 { font-size: 1rem; margin: 1rem 0 .2rem; }
p { margin: .2rem 0 .8rem; } .soft, figcaption, th { color: var(--soft); }
section { background: var(--card); border: 1px solid var(--line); border-radius: 10px;
  padding: 1rem 1.2rem; margin-top: 1rem; }
img { max-width: 100%; height: auto; display: block; border-radius: 6px; background: #fff; }
.side { display: grid; gap: 1rem; margin-top: 1rem;
  grid-template-columns: repeat(auto-fit, minmax(min(23rem, 100%), 1fr)); }
.side > section { margin: 0; min-width: 0; } .side > section > img { margin: auto; }
.row { display: grid; gap: 1rem 2rem;
  grid-template-columns: repeat(auto-fill, minmax(min(17rem, 100%), 1fr)); }
.views { display: grid; gap: .6rem; grid-template-columns: repeat(4, 1fr); margin-top: 1rem; }
@media (max-width: 40rem) { .views { grid-template-columns: 1fr 1fr; } }
dl { margin: 0; } dt { font-weight: 600; margin-top: .7rem; } dt:first-child { margin-top: 0; }
dd { margin: 0; } .good { color: var(--good); } .look { color: var(--look); }
.info { color: var(--info); } ul { margin: 0; padding-left: 1.2rem; }
.wide { overflow-x: auto; } table { border-collapse: collapse; }
td, th { text-align: left; padding: .12rem 1.4rem .12rem 0; vertical-align: top; }
th { font-weight: normal; } td + td { font-variant-numeric: tabular-nums; }
tr + tr > td { border-top: 1px solid var(--line); }
figure { margin: 0; min-width: 0; } svg { width: 100%; height: auto; display: block; }
rect { fill: var(--bar); } text { font-size: 11px; fill: var(--soft); }
line { stroke: var(--line); }
@media print { body { background: none; } section { break-inside: avoid; } }
"""

MARKS = {"good": "✓", "look": "!", "info": "·"}
WORDS = {"good": "right", "look": "look at this", "info": "for your information"}


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
