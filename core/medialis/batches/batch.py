"""Run operations over many files: plan, hand out, collect the table.

There is one batch at a time in an output folder (`locked_folder`), and none where nothing can be
written. The table is CSV for programs and spreadsheets (`csv_text`), and a page for people
(`html_text`): what failed comes first, then one table for each operation.
"""

from __future__ import annotations

import csv
import html
import io
import math
import os
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import quote

from medialis.base import disk
from medialis.base.device import device_choice
from medialis.base.errors import FileError
from medialis.base.progress import Progress, ProgressCallback, counted
from medialis.base.threads import thread_count
from medialis.base.validation import as_whole_number
from medialis.batches.engine import run_jobs, warn_if_open
from medialis.batches.jobs import DONE, FAILED, TABLES, Job, Row, plan, run_job
from medialis.formats.files import absolute, reason, write_text
from medialis.formats.output_folder import remove_left
from medialis.operations.result import unit_of
from medialis.show.reports.page import data_text, page
from medialis.show.viewer.page import has_library
from medialis.show.writing import strangers

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
        f"<main>{_failed(bad, len(groups))}{tables}</main>",
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
    columns = _columns(done)
    values = [_words(name) + (f" in {unit}" if unit else "") for name, unit in columns]
    heads = ["shape", "seconds", *values, "what was said"]
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


Column = tuple[str, str]
"""Name of a value, and its unit: what has different units has different columns."""


def _columns(rows: Sequence[Row]) -> list[Column]:
    found = ((name, unit_of(name, row.unit)) for row in rows for name in row.numbers)
    return list(dict.fromkeys(found))


def _value(row: Row, column: Column) -> Any:
    """Return what a row has in a column, angles in degrees; None: nothing."""
    name, unit = column
    value = row.numbers.get(name) if unit_of(name, row.unit) == unit else None
    return math.degrees(value) if unit == "degrees" and value is not None else value


def _line(row: Row, columns: Sequence[Column]) -> str:
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
    values = "".join(_cell(_value(row, column)) for column in columns)
    return (
        f'<tr data-shape="{name}"><th scope="row" title="{_text(row.file)}"><div>{image}'
        f"<span>{name}<br><small>{' '.join(links)}</small></span></div></th>"
        f"<td>{seconds}</td>{values}<td>{said}</td></tr>"
    )


def _cell(value: Any) -> str:
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


LOCK = ".medialis-batch"
LEFT = re.compile(rf"\.({'|'.join(map(re.escape, TABLES))})-[0-9a-f]{{8}}")
"""Names of tables that were half written."""


@contextmanager
def locked_folder(folder: str | os.PathLike[str]) -> Iterator[None]:
    """Hold an output folder; it is made when missing, and removed again when it stays empty.

    The system gives the lock back when the process ends in whatever way, so a killed batch leaves
    none behind.

    Raises
    ------
    FileError
        When another batch holds the folder, or it cannot be made or written.
    """
    made: list[Path] = []
    try:
        with ExitStack() as stack:
            try:
                disk.refuse_links_of_others(absolute(folder))
                disk.make_folders(absolute(folder), made)
                place = stack.enter_context(disk.Folder.at(folder))
            except OSError as error:
                raise FileError(f"Cannot write results to {folder}: {reason(error)}.") from None
            yield from _locked(place, folder)
    finally:
        for new in reversed(made):
            disk.remove_if_empty(new)


def _locked(place: disk.Folder, folder: str | os.PathLike[str]) -> Iterator[None]:
    """Hold the lock in an open folder."""
    try:
        handle = place.open_regular(LOCK, os.O_RDWR | os.O_CREAT)
    except OSError as error:
        raise FileError(f"Cannot write to {Path(folder) / LOCK}: {reason(error)}.") from None
    try:
        # The one who had it may have removed it between our opening and locking.
        about = place.about(LOCK) if disk.take_lock(handle) is not False else None
        if about is None or not os.path.samestat(os.fstat(handle), about):
            raise FileError(
                f"Another batch is writing to {folder}: wait until it has ended, or name another "
                "folder."
            )
        try:
            yield
        finally:
            if sys.platform != "win32":  # before the next one can open and lock it
                _remove(place, LOCK)
    finally:
        os.close(handle)
        if sys.platform == "win32":  # an open file cannot be removed: not that of another batch
            _remove(place, LOCK)


def _refuse_strangers(folder: str | os.PathLike[str], jobs: Sequence[Job]) -> None:
    """Refuse a folder with files of somebody else, in which no batch of these shapes has begun."""
    with disk.Folder.at(folder) as place:
        own = [*TABLES, *(job.name for job in jobs)]
        found = strangers(place, [job.file for job in jobs])
        if found and all(place.about(name) is None for name in own):
            raise FileError(
                f"Nothing was written to {os.fspath(folder)}: it holds no results of a batch, but "
                f"a file {found[0]}. Name another folder, such as a new one in it."
            )


def _remove(place: disk.Folder, name: str) -> None:
    with suppress(OSError):
        place.remove(name)


FORMULA = ("=", "+", "-", "@", "\t", "\r")
FIRST = ("shape", "file", "unit")


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
    with disk.Folder.at(folder) as place:
        for name in filter(LEFT.fullmatch, place.names()):  # of a batch that was killed
            if place.is_file(name):
                _remove(place, name)
    for path, text in ((csv_path, csv_text(rows)), (page_path, html_text(rows))):
        write_text(path, text)
    return str(csv_path), str(page_path)


def csv_text(rows: Sequence[Row]) -> str:
    """Return the table as CSV: one line a shape; columns are named `operation: value (unit)`.

    A shape that could not be read has no unit. Angles are in degrees.
    """
    shapes: dict[tuple[str, str], dict[str, Row]] = {}
    operations: dict[str, list[Row]] = {}
    for row in rows:
        shapes.setdefault((row.name, row.file), {})[row.operation] = row
        operations.setdefault(row.operation, []).append(row)
    columns = {name: _columns(group) for name, group in operations.items()}
    heads = [*FIRST]
    for operation, found in columns.items():
        values = [f"{name} ({unit})" if unit else name for name, unit in found]
        heads += [f"{operation}: {name}" for name in ("status", "seconds", *values, "sentence")]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(heads)
    for (name, file), own in shapes.items():
        unit = next((row.unit for row in own.values() if row.unit), "")
        cells: list[Any] = [name, file, unit]
        for operation, found in columns.items():
            cells += _cells(own.get(operation), found)
        writer.writerow([_plain(cell) for cell in cells])
    return text.getvalue()


def _cells(row: Row | None, columns: Sequence[Column]) -> list[Any]:
    """Return what one operation has in the line of a shape."""
    if row is None:
        return [""] * (len(columns) + 3)
    seconds = "" if row.seconds is None else f"{row.seconds:.3f}"
    values = (_value(row, column) for column in columns)
    told = ["" if value is None else value for value in values]
    return [row.status, seconds, *told, row.sentence]


def _plain(cell: Any) -> Any:
    """Mark a text that spreadsheets would take for a formula, such as a file called `=1+1.ply`."""
    return f"'{cell}" if isinstance(cell, str) and cell.startswith(FORMULA) else cell


MOST_WORKERS = 1024


def batch(
    operations: str | Sequence[str],
    files: Sequence[str | os.PathLike[str]],
    output: str | os.PathLike[str],
    *,
    parameters: Mapping[str, Mapping[str, Any]] | None = None,
    workers: int | str | None = None,
    picture: bool = True,
    report: bool = False,
    progress: Progress | ProgressCallback | None = None,
) -> list[Row]:
    """Run operations over many shapes in worker processes; one bad shape never stops the rest.

    Results go to ``output/<shape>/<operation>``, as `write_result` writes them, and a table of all
    to ``output/results.csv`` and ``output/results.html``. Called again it computes only what is
    missing: results of the same file, parameters and version stay.

    Parameters
    ----------
    operations : str or sequence of str
        Names as in `operation`.
    files : sequence of paths
        Meshes and point clouds; a folder stands for all of them in it.
    output : path
        Folder of the batch.
    parameters : dict of dict, optional
        Parameters by the name of the operation; the others are at their defaults. Those
        of "read_shape" are how files are read: its `unit` and `up`.
    workers : int or str, optional
        Number of processes, which share the threads of this machine; as many as processors when
        missing. Or the address of an existing Dask scheduler, such as "tcp://127.0.0.1:8786": its
        workers compute with one thread for each of theirs and must see the files under the same
        paths. An address beyond this machine that is not tls:// gets a warning (open_scheduler).
    picture : bool
        Draw a picture of each result.
    report : bool
        Write ``report.html`` and ``report.json`` beside each result: how good it is.
    progress : callable, optional
        Called with (fraction, text) after each shape; returning False cancels.

    Returns
    -------
    list of Row
        One for each file and operation, in the given order.

    Raises
    ------
    InvalidOptionError
        For unknown operations or bad parameters, or when there is a scheduler and Dask (extra
        ``dask``) is missing.
    FileError
        When the output cannot be written, another batch is writing to it, or the scheduler or all
        workers cannot be reached.
    Cancelled
        When `progress` asks for it; what is finished stays, and the next call goes on from there.

    See Also
    --------
    run : one operation on one shape.
    read_shape : what reads each file.

    Notes
    -----
    Scripts must call it under ``if __name__ == "__main__":``, as every use of worker processes.

    Examples
    --------
    Workers begin by importing the script that started them, so this stands below its `main` test:

    >>> import medialis
    >>> rows = medialis.batch("thickness", ["scans/"], "results/")  # doctest: +SKIP
    >>> [row.name for row in rows if row.status == "failed"]  # doctest: +SKIP
    []
    """
    progress = Progress.of(progress)
    names = [operations] if isinstance(operations, str) else list(operations)
    scheduler = workers if isinstance(workers, str) else None
    processes = thread_count()
    if workers is not None and not isinstance(workers, str):
        processes = as_whole_number(workers, "workers", low=1, high=MOST_WORKERS)
    jobs = plan(names, files, output, parameters=parameters, picture=picture, report=report)
    if scheduler is not None:
        warn_if_open(scheduler, progress)
    with locked_folder(output):
        _refuse_strangers(output, jobs)
        rows: dict[str, list[Row]] = {}
        known = 0
        for job in jobs:
            for name in job.operations:
                remove_left(job.folder(name), output)
            there = [row for name in job.operations if (row := job.finished(name)) is not None]
            known += len(there)
            if len(there) == len(job.operations):
                rows[job.name] = there
        waiting = [job for job in jobs if job.name not in rows]
        failed = 0
        progress.update(len(rows) / len(jobs), f"{len(rows)} of {len(jobs)}")
        processes = max(1, min(processes, len(waiting)))
        threads = 1 if scheduler is not None else max(1, thread_count() // processes)
        of_machine: dict[str, Any] = {"threads": threads, "device": device_choice()}
        shared = [replace(job, **of_machine) for job in waiting]
        for job, made in run_jobs(shared, run_job, workers=processes, scheduler=scheduler):
            rows[job.name] = made
            failed += any(row.status == FAILED for row in made)
            bad = f", {failed} failed" if failed else ""
            progress.update(len(rows) / len(jobs), f"{len(rows)} of {len(jobs)}{bad}: {job.name}")
        table = [row for job in jobs for row in rows[job.name]]
        write_table(table, output)
    done = sum(row.status == DONE for row in table) - known
    text = f"{counted(done, 'result', verbs=('was', 'were'))} computed"
    text += f", {known} {'was' if known == 1 else 'were'} there already." if known else "."
    progress.note(text, "batch", computed=done, there=known)
    return table
