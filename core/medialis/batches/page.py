"""The page of a batch: what failed first, then one table for each operation."""

from __future__ import annotations

import html
import math
import os
from collections.abc import Sequence
from typing import Any
from urllib.parse import quote

from medialis.batches.jobs import DONE, FAILED, Row
from medialis.operations.quantities import quantity
from medialis.reports.page import data_text, page
from medialis.viewer.page import has_library

OPEN_ROWS = 2000
"""Longer pages start with their tables closed, so that they open at once."""


def html_text(rows: Sequence[Row]) -> str:
    """Return the table of a batch as one HTML page; pictures and reports are links.

    What failed comes first, the same sentence once for each shape. Tables can be sorted by any
    column, and searched by the names of shapes.
    """
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(row.operation, []).append(row)
    bad = [row for row in rows if row.status == FAILED]
    shapes = len({row.name for row in rows})
    summary = f"{_count(shapes, 'shape')}: {_count(len(rows) - len(bad), 'result')}"
    summary += f", {len(bad)} failed" if bad else ", none failed"
    links = "".join(
        f'<a href="#{name}">{_words(name)} <small>{_done(group)}</small></a>'
        for name, group in groups.items()
    )
    if bad:
        links = f'<a class="bad" href="#failed">failed <small>{len(bad)}</small></a>' + links
    is_open = " open" if len(rows) <= OPEN_ROWS else ""
    tables = "\n".join(_operation(name, group, is_open) for name, group in groups.items())
    find = '<input type="search" placeholder="find a shape" aria-label="find a shape">'
    return page(
        f"medialis batch: {summary}",
        data_text("medialis.batches", "batch.css"),
        f"<header><h1>medialis batch</h1><p>{summary}.</p></header>",
        f"<nav>{links}{find}</nav>",
        _failed(bad, len(groups)) + tables,
        f"<script>\n{data_text('medialis.batches', 'batch.js')}</script>",
    )


def _failed(rows: Sequence[Row], operations: int) -> str:
    if not rows:
        return ""
    groups: dict[tuple[str, str, str], list[str]] = {}
    for row in rows:
        key = row.name, row.file, row.sentence
        groups.setdefault(key, []).append(_words(row.operation))
    lines = "\n".join(
        f'<tr data-shape="{_text(name)}"><th scope="row" title="{_text(file)}">{_text(name)}</th>'
        f"<td>{'all' if len(found) == operations > 1 else ', '.join(found)}</td>"
        f"<td>{_text(sentence)}</td></tr>"
        for (name, file, sentence), found in groups.items()
    )
    return (
        f'<details id="failed" open><summary><h2>Failed <small>{len(rows)}</small></h2></summary>\n'
        '<div class="wide"><table><thead><tr><th>shape</th><th>operations</th>'
        f"<th>why</th></tr></thead>\n<tbody>{lines}</tbody></table></div></details>\n"
    )


def _operation(name: str, rows: Sequence[Row], is_open: str) -> str:
    done = [row for row in rows if row.status == DONE]
    columns = list(dict.fromkeys(key for row in done for key in row.numbers))
    heads = ["shape", "seconds", *map(_heading, columns), "what was said"]
    head = "".join(f'<th aria-sort="none"><button>{text}</button></th>' for text in heads)
    lines = "\n".join(_line(row, columns) for row in done)
    table = (
        f'<div class="wide"><table class="sortable"><thead><tr>{head}</tr></thead>\n'
        f"<tbody>{lines}</tbody></table></div>"
    )
    return (
        f'<details id="{name}"{is_open}><summary><h2>{_words(name)} <small>{_done(rows)}</small>'
        f"</h2></summary>\n{table if done else ''}</details>"
    )


def _line(row: Row, columns: Sequence[str]) -> str:
    name, links = _text(row.name), []
    folder = _link(f"{row.name}/{row.operation}/")
    image = ""
    if row.picture is not None:
        small = _link(row.thumbnail or row.picture)
        image = (
            f'<a href="{_link(row.picture)}"><img loading="lazy" width="112" height="84" '
            f'src="{small}" alt="{_words(row.operation)} of {name}"></a>'
        )
    if row.report is not None:
        links.append(f'<a href="{_link(row.report)}">report</a>')
        if has_library():
            links.append(f'<a href="{_link(row.report)}#viewer">3D</a>')
    links.append(f'<a href="{folder}">files</a>')
    seconds = "" if row.seconds is None else f"{row.seconds:.2f}"
    said = f'<p tabindex="0">{_text(row.sentence)}</p>' if row.sentence else ""
    values = "".join(_cell(column, row.numbers.get(column)) for column in columns)
    return (
        f'<tr data-shape="{name}"><th scope="row" title="{_text(row.file)}"><div>{image}'
        f"<span>{name}<br><small>{' '.join(links)}</small></span></div></th>"
        f"<td>{seconds}</td>{values}<td>{said}</td></tr>"
    )


def _heading(column: str) -> str:
    return _words(column) + (" in degrees" if quantity(column) == "angle" else "")


def _cell(column: str, value: Any) -> str:
    if isinstance(value, float) and quantity(column) == "angle":
        value = math.degrees(value)
    if isinstance(value, bool):
        return f"<td>{'yes' if value else 'no'}</td>"
    if isinstance(value, float):
        return f'<td data-value="{value!r}">{value:.5g}</td>'
    return f"<td>{'' if value is None else _text(value)}</td>"


def _link(path: str) -> str:
    return quote(os.fsencode(path))  # as bytes: a name may be no text


def _done(rows: Sequence[Row]) -> str:
    done = sum(row.status == DONE for row in rows)
    return str(done) if done == len(rows) else f"{done} of {len(rows)}"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" + ("" if number == 1 else "s")


def _words(name: str) -> str:
    return _text(name.replace("_", " "))


def _text(value: Any) -> str:
    return html.escape(str(value), quote=True)
