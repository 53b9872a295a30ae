"""Cases that go wrong in every way, to test the runner."""

from __future__ import annotations

import os
import time

import numpy as np

from fuzz.kinds import GIGABYTE, Case, Fault, Kind


def run(case: Case) -> None:
    """Pass, find, raise, crash, hang and take too much memory in turn."""
    (case.folder / "input.txt").write_text(str(case.rng.random()))
    fault = ("pass", "find", "raise", "crash", "hang", "memory", "late")[case.number % 7]
    if fault == "find":
        raise Fault("a finding", "its details")
    if fault == "raise":
        raise KeyError("an error")
    if fault == "crash":
        os.abort()
    if fault == "hang":
        time.sleep(1000)
    if fault == "memory":
        np.ones(4 * GIGABYTE // 8)
    mark = case.home / "late"
    if fault == "late" and not mark.exists():
        mark.touch()
        raise Fault("slow", again=True)


KIND = Kind(run, processor_seconds=5.0, wall_seconds=5.0, memory=3 * GIGABYTE)
