"""What a worker does: read one shape, run the operations, write each result all or nothing."""

from __future__ import annotations

import logging
import shutil
import time
from pathlib import Path

from medialis.batches.jobs import Job, Row, stamp
from medialis.errors import Cancelled, MedialisError
from medialis.model.shape import Shape
from medialis.operations.registry import run
from medialis.operations.writing import write_result
from medialis.progress import Progress
from medialis.shape.reading import read_shape

logger = logging.getLogger(__name__)

NO_MEMORY = "There is not enough memory for this shape and these options."


def run_job(job: Job) -> list[Row]:
    """Run what is not finished of a job; an error becomes a row, and never leaves here.

    The shape is read once. Returns one row for each operation.
    """
    rows = []
    shape: Shape | None = None
    reading: Progress = Progress()
    for name in job.operations:
        row = job.finished(name)
        if row is None:
            clock = time.perf_counter()
            try:
                input_stamp = [] if not Path(job.file).is_file() else stamp(job.file)
                if shape is None:
                    shape = read_shape(job.file, progress=reading)
                row = _run_operation(job, name, shape, reading.messages, input_stamp, clock)
            except Exception as error:  # noqa: BLE001 - one shape never stops the others
                row = job.failed(name, _sentence(error))
        rows.append(row)
    return rows


def _run_operation(
    job: Job, name: str, shape: Shape, said: list[str], input_stamp: list[int], clock: float
) -> Row:
    _remove_unfinished(job.folder(name))
    progress = Progress()
    progress.messages.extend(said)
    result = run(name, shape, threads=job.threads, progress=progress, **job.operations[name])
    progress.seconds["total"] = time.perf_counter() - clock
    manifest = write_result(
        result,
        job.folder(name),
        source=job.file,
        picture=job.picture,
        progress=progress,
        record={"input_stamp": input_stamp},
    )
    return job.row(manifest)


def _remove_unfinished(folder: Path) -> None:
    """Remove what a killed run has left: hidden folders of unfinished results."""
    for left in folder.parent.glob(f".{folder.name}-*"):
        shutil.rmtree(left, ignore_errors=True)


def _sentence(error: Exception) -> str:
    if isinstance(error, MedialisError) and not isinstance(error, Cancelled):
        return str(error)
    if isinstance(error, MemoryError):
        return NO_MEMORY
    logger.exception("unexpected error")
    return f"Unexpected error, please report it: {type(error).__name__}: {error}"
