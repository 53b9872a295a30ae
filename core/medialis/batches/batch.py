"""Run operations over many files: plan, hand out, collect the table."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from medialis.batches.engine import run_jobs, warn_if_open
from medialis.batches.jobs import FAILED, Job, Row, plan
from medialis.batches.lock import locked_folder
from medialis.batches.table import write_table
from medialis.batches.work import run_job
from medialis.files.output_folder import remove_left
from medialis.progress import Progress, ProgressCallback
from medialis.threads import thread_count
from medialis.validation import as_whole_number

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
        of "read_shape" are how files are read: its `unit`.
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
        for job in jobs:
            for name in job.operations:
                remove_left(job.folder(name))
        rows = {job.name: found for job in jobs if (found := _finished(job)) is not None}
        waiting = [job for job in jobs if job.name not in rows]
        failed = 0
        progress.update(len(rows) / len(jobs), f"{len(rows)} of {len(jobs)}")
        processes = max(1, min(processes, len(waiting)))
        threads = 1 if scheduler is not None else max(1, thread_count() // processes)
        shared = [replace(job, threads=threads) for job in waiting]
        for job, made in run_jobs(shared, run_job, workers=processes, scheduler=scheduler):
            rows[job.name] = made
            failed += any(row.status == FAILED for row in made)
            bad = f", {failed} failed" if failed else ""
            progress.update(len(rows) / len(jobs), f"{len(rows)} of {len(jobs)}{bad}: {job.name}")
        table = [row for job in jobs for row in rows[job.name]]
        write_table(table, output)
    return table


def _finished(job: Job) -> list[Row] | None:
    """Return the rows of a job that has nothing left to do."""
    rows = [row for name in job.operations if (row := job.finished(name)) is not None]
    return rows if len(rows) == len(job.operations) else None
