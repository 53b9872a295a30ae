"""Work that kills its process, for the tests of batches; workers import it from here."""

import os
from pathlib import Path

from medialis.batches.jobs import DONE, Job, Row


def mortal_work(job: Job) -> list[Row]:
    """Die at the thickness of jobs named "deadly...", once for jobs named "unlucky..."."""
    if job.name.startswith("deadly") and "thickness" in job.operations:
        os._exit(1)
    mark = Path(job.output) / f"{job.name}.mark"
    if job.name.startswith("unlucky") and not mark.exists():
        mark.touch()
        os._exit(1)
    return [Row(job.name, job.file, name, DONE) for name in job.operations]
