"""The table of a batch: CSV for programs and spreadsheets, and a page for people (`page.py`)."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from medialis.batches.files import TABLES
from medialis.batches.jobs import Row
from medialis.batches.page import html_text
from medialis.files._files import complete_file

FORMULA = ("=", "+", "-", "@", "\t", "\r")
FIRST = ("shape", "operation", "status", "seconds", "file", "sentence")


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
    csv_path, page_path = (Path(folder) / name for name in TABLES)
    for path, text in ((csv_path, csv_text(rows)), (page_path, html_text(rows))):
        for left in path.parent.glob(f".{path.name}-????????"):  # of a batch that was killed
            left.unlink(missing_ok=True)
        with complete_file(path) as stream:
            stream.write(text.encode("utf-8", "backslashreplace"))  # names that are no text
    return str(csv_path), str(page_path)


def csv_text(rows: Sequence[Row]) -> str:
    """Return the table as CSV: one line a result, one column a value that any result has."""
    numbers = [row.numbers for row in rows]
    names = list(dict.fromkeys(name for values in numbers for name in values))
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*FIRST, *names])
    for row, values in zip(rows, numbers, strict=True):
        seconds = "" if row.seconds is None else f"{row.seconds:.3f}"
        first = [row.name, row.operation, row.status, seconds, row.file, row.sentence]
        cells = [*first, *(values.get(name, "") for name in names)]
        writer.writerow([_plain(cell) for cell in cells])
    return text.getvalue()


def _plain(cell: Any) -> Any:
    """Mark a text that spreadsheets would take for a formula, such as a file called `=1+1.ply`."""
    return f"'{cell}" if isinstance(cell, str) and cell.startswith(FORMULA) else cell
