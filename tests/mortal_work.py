"""Work that kills its process, for the tests of batches; workers import it from here."""

import os
import time
from pathlib import Path

from medialis.batches.jobs import DONE, Job, Row


def mortal_work(job: Job) -> list[Row]:
    """Die at the thickness of jobs named "deadly...", once for jobs named "unlucky...".

    Jobs named "slow deadly..." die too, and their process is alive for a while after its files are
    closed, as any is for a moment.
    """
    if job.name.startswith("slow deadly") and "thickness" in job.operations:
        os.closerange(3, 1000)
        time.sleep(1)
        os._exit(1)
    if job.name.startswith("deadly") and "thickness" in job.operations:
        os._exit(1)
    mark = Path(job.output) / f"{job.name}.mark"
    if job.name.startswith("unlucky") and not mark.exists():
        mark.touch()
        os._exit(1)
    return [Row(job.name, job.file, name, DONE) for name in job.operations]
