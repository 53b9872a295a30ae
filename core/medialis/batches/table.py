"""The table of a batch: CSV for programs, HTML with thumbnails for people."""

from __future__ import annotations

import csv
import html
import io
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

from medialis.batches.jobs import DONE, Row
from medialis.io._files import complete_file

FIRST = ("shape", "operation", "status", "seconds", "file", "sentence")

_STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; margin: 2em auto; max-width: 80em; padding: 0 1em; }
table { border-collapse: collapse; width: 100%; }
th, td { text-align: left; vertical-align: top; padding: .5em .7em; border-bottom: 1px solid #ddd; }
img { width: 180px; height: auto; }
dl { display: grid; grid-template-columns: auto auto; gap: 0 1em; margin: 0; width: max-content; }
dd { margin: 0; text-align: right; font-variant-numeric: tabular-nums; }
.failed td { background: #fdecea; }
.wide { overflow-x: auto; }
@media (prefers-color-scheme: dark) {
  body { background: #16181c; color: #ddd; } th, td { border-color: #333; }
  .failed td { background: #3a1d1b; }
}
"""


def write_table(rows: Sequence[Row], folder: str | os.PathLike[str]) -> tuple[str, str]:
    """Write ``results.csv`` and ``results.html`` into the folder of a batch.

    Returns
    -------
    (str, str)
        The two paths.

    Raises
    ------
    FileError
        When they cannot be written; each file is complete or as it was.
    """
    place = Path(folder)
    place.mkdir(parents=True, exist_ok=True)
    paths = place / "results.csv", place / "results.html"
    for path, text in zip(paths, (csv_text(rows), html_text(rows)), strict=True):
        with complete_file(path) as stream:
            stream.write(text.encode("utf-8"))
    return str(paths[0]), str(paths[1])


def csv_text(rows: Sequence[Row]) -> str:
    """Return the table as CSV: one line a result, one column a value that any result has."""
    numbers = [_plain(row.values) for row in rows]
    names = list(dict.fromkeys(name for values in numbers for name in values))
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*FIRST, *names])
    for row, values in zip(rows, numbers, strict=True):
        seconds = "" if row.seconds is None else f"{row.seconds:.3f}"
        first = [row.name, row.operation, row.status, seconds, row.file, row.sentence]
        writer.writerow([*first, *(values.get(name, "") for name in names)])
    return text.getvalue()


def html_text(rows: Sequence[Row]) -> str:
    """Return the table as one HTML page; the thumbnails are the pictures of the results."""
    done = sum(row.status == DONE for row in rows)
    failed = len(rows) - done
    summary = f"{done} results" + (f", {failed} failed" if failed else "")
    body = "\n".join(_html_row(row) for row in rows)
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>medialis batch: {summary}</title><style>{_STYLE}</style></head><body>\n"
        f"<h1>medialis batch</h1><p>{summary}.</p>\n"
        '<div class="wide"><table><tr><th>Picture</th><th>Shape</th><th>Values</th>'
        f"<th>What was said</th></tr>\n{body}\n</table></div></body></html>\n"
    )


def _html_row(row: Row) -> str:
    picture = ""
    if row.picture is not None:
        link = quote(row.picture)
        alt = html.escape(f"{row.operation} of {row.name}", quote=True)
        picture = f'<a href="{link}"><img loading="lazy" src="{link}" alt="{alt}"></a>'
    values = "".join(
        f"<dt>{html.escape(name.replace('_', ' '))}</dt><dd>{_shown(value)}</dd>"
        for name, value in _plain(row.values).items()
    )
    seconds = "" if row.seconds is None else f"<br>{row.seconds:.2f} s"
    return (
        f'<tr class="{row.status}"><td>{picture}</td><td><b>{html.escape(row.name)}</b><br>'
        f"{row.operation.replace('_', ' ')}<br>{row.status}{seconds}</td>"
        f"<td><dl>{values}</dl></td><td>{html.escape(row.sentence)}</td></tr>"
    )


def _plain(values: Any) -> dict[str, Any]:
    """Numbers and words; lists are for the manifest."""
    return {k: v for k, v in values.items() if isinstance(v, int | float | str)}


def _shown(value: Any) -> str:
    return f"{value:.5g}" if isinstance(value, float) else html.escape(str(value))
