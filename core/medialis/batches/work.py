"""What a worker does: read one shape, run the operations, write each result all or nothing."""

from __future__ import annotations

import json
import logging
import time
from dataclasses import dataclass

from medialis.batches.jobs import Job, Row
from medialis.errors import Cancelled, MedialisError
from medialis.files.results import json_text
from medialis.kept import forget
from medialis.model.shape import Shape
from medialis.operations.existing_results import input_stamp
from medialis.operations.registry import run
from medialis.operations.writing import Pictures, Written, write_files
from medialis.progress import Message, Progress
from medialis.surface.reading import read_shape
from medialis.threads import thread_limit

logger = logging.getLogger(__name__)

NO_MEMORY = "There is not enough memory for this shape and these options."


@dataclass(frozen=True)
class Source:
    """A shape as it was read, and what identifies its file."""

    shape: Shape
    messages: tuple[Message, ...]
    seconds: float
    stamp: list[str | int]


def run_job(job: Job) -> list[Row]:
    """Run what is not finished of a job; an error becomes a row, and never leaves here.

    The shape is read once, and what one operation computed on it is found by the next one; nothing
    is kept for the next shape. Returns one row for each operation.
    """
    try:
        return _rows(job)
    finally:
        forget()


def _rows(job: Job) -> list[Row]:
    rows: list[Row] = []
    source: Source | None = None
    unreadable: str | None = None
    for name in job.operations:
        row = job.finished(name)
        if row is None and unreadable is None:
            try:
                with thread_limit(job.threads):
                    source = source or _read(job)
                    row = _run_operation(job, name, source)
            except Exception as error:  # noqa: BLE001 - one shape never stops the others
                row = job.failed(name, _sentence(error))
                unreadable = row.sentence if source is None else None
        rows.append(row or job.failed(name, unreadable or ""))
    return rows


def _read(job: Job) -> Source:
    clock, progress = time.perf_counter(), Progress()
    try:
        here = input_stamp(job.file)
    except (OSError, ValueError):
        here = []  # reading tells what is wrong
    shape = read_shape(job.file, unit=job.unit, progress=progress)
    return Source(shape, tuple(progress.messages), time.perf_counter() - clock, here)


def _run_operation(job: Job, name: str, source: Source) -> Row:
    clock, progress = time.perf_counter(), Progress()
    progress.messages.extend(source.messages)
    result = run(name, source.shape, threads=job.threads, progress=progress, **job.operations[name])
    texts = None
    if job.report:
        from medialis.reports.report import report_texts

        texts = report_texts(result, source=job.file)
    progress.seconds["total"] = source.seconds + time.perf_counter() - clock
    wanted = Written(
        job.file,
        Pictures(main=job.picture, thumbnail=job.picture),
        texts=texts or {},
        record={"input_stamp": source.stamp, "input_unit": job.unit},
        overwrite=True,  # a batch owns its folder, and computes anew what is not as it should be
    )
    manifest = write_files(result, job.folder(name), wanted, progress)
    # As it is read back: a resumed batch must give the same table.
    return job.row(json.loads(json_text(manifest)))


def _sentence(error: Exception) -> str:
    if isinstance(error, MedialisError) and not isinstance(error, Cancelled):
        return str(error)
    if isinstance(error, MemoryError):
        return NO_MEMORY
    logger.exception("unexpected error")
    return f"Unexpected error, please report it: {type(error).__name__}: {error}"
