"""How long cancelling can take: the longest times between two calls of the progress callback.

    python benchmarks/cancel_gaps.py ../shared/shapes/igea2.ply [--operations thickness parts]

Cancelling raises in the callback, on the calling thread, so nothing can be cancelled between two of
its calls. Reading, each operation and writing, pictures included, are run in this process, and the
longest gaps are printed: wall time, processor time of the whole process, the stage that was last
named, and the line of the core where the calling thread was. On a machine that others use a gap
counts by the smaller of both times. Results are kept from one operation to the next, as in a host,
so the stages that operations share are measured in the first that needs them.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any

import medialis
from medialis.operations.registry import OPERATIONS

CORE = str(Path(medialis.__file__).parent)
SAMPLING = 0.02
"""Seconds between two looks at the stack of the calling thread."""
HOSTING = ("threads.py", "progress.py")
"""Files whose lines say nothing of what is computed."""
GIVEN: dict[str, dict[str, Any]] = {"geodesic_path": {"end": 1000}}
"""Parameters other than the default ones."""


@dataclass(frozen=True)
class Gap:
    """A time between two calls of the callback."""

    wall: float
    processor: float
    stage: str
    begin: float

    @property
    def seconds(self) -> float:
        """Return what counts where others use the machine as well."""
        return min(self.wall, self.processor)


class Recorder:
    """A progress callback that remembers the gaps between its calls, and where they were spent."""

    def __init__(self) -> None:
        self.gaps: list[Gap] = []
        self._samples: list[tuple[float, str]] = []
        self._calling = threading.get_ident()
        self._ended = threading.Event()
        self._last = (time.perf_counter(), time.process_time(), "start")

    def __call__(self, fraction: float, text: str) -> None:
        """Record the time since the last call."""
        now = (time.perf_counter(), time.process_time(), text)
        wall, processor = now[0] - self._last[0], now[1] - self._last[1]
        self.gaps.append(Gap(wall, processor, self._last[2], self._last[0]))
        self._last = now

    def __enter__(self) -> Recorder:
        self._sampler = threading.Thread(target=self._sample, daemon=True)
        self._sampler.start()
        self._last = (time.perf_counter(), time.process_time(), "start")
        return self

    def __exit__(self, *_: object) -> None:
        self(1.0, "end")
        self._ended.set()
        self._sampler.join()

    def _sample(self) -> None:
        while not self._ended.wait(SAMPLING):
            frames = sys._current_frames()
            place = innermost(frames.pop(self._calling, None))
            # What it waits for may hold the interpreter, so that it cannot report.
            others = {innermost(frame) for frame in frames.values()} - {"", place}
            self._samples.append((time.perf_counter(), " | ".join([place, *sorted(others)])))

    def place(self, gap: Gap) -> str:
        """Return the line where the calling thread was most often during a gap."""
        seen = Counter(
            place for when, place in self._samples if gap.begin < when <= gap.begin + gap.wall
        )
        return seen.most_common(1)[0][0] if seen else ""


def innermost(frame: FrameType | None) -> str:
    """Return file and line of the innermost frame that computes something in the core."""
    while frame is not None:
        name = frame.f_code.co_filename
        if name.startswith(CORE) and not name.endswith(HOSTING):
            return f"{name[len(CORE) + 1 :]}:{frame.f_lineno} {frame.f_code.co_name}"
        frame = frame.f_back
    return ""


def measured(what: str, work: Callable[..., Any], least: float) -> tuple[Any, Gap]:
    """Do a step, print its gaps longer than `least` seconds, and return its longest one."""
    with Recorder() as recorder:
        clock = time.perf_counter()
        result = work(progress=recorder)
        seconds = time.perf_counter() - clock
    gaps = sorted(recorder.gaps, key=lambda gap: -gap.seconds)
    print(f"{what}: {seconds:.1f} s, {len(gaps)} calls", flush=True)
    for gap in gaps:
        if gap.seconds < least:
            break
        print(f"    {gap.wall:6.2f} {gap.processor:6.2f}  {gap.stage:28} {recorder.place(gap)}")
    return result, gaps[0]


def steps(path: Path, names: list[str], least: float) -> Iterator[tuple[str, Gap]]:
    """Read the shape, run and write the operations, and yield the longest gap of each step."""
    shape, gap = measured("reading", partial(medialis.read_shape, path), least)
    yield "reading", gap
    for name in names:
        given = GIVEN.get(name, {})
        try:
            work = partial(medialis.run, name, shape, **given)
            result, gap = measured(name, work, least)
        except medialis.MedialisError as error:
            print(f"{name}: {error}")
            continue
        yield name, gap
        with tempfile.TemporaryDirectory() as folder:
            work = partial(medialis.write_result, result, f"{folder}/out")
            _, gap = measured(f"{name}, writing", work, least)
        yield f"{name}, writing", gap


def main() -> None:
    """Measure the steps that are asked for, after a run on a small shape that compiles."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("path", type=Path)
    parser.add_argument("--operations", nargs="*")
    parser.add_argument("--least", type=float, default=0.15, help="Print gaps of so many seconds.")
    options = parser.parse_args()
    names = options.operations or [operation.name for operation in OPERATIONS]
    small = medialis.organic_shape(56)
    for name in names:
        sample = medialis.operation(name).sample
        with tempfile.TemporaryDirectory() as folder:
            shape = small if sample == "creature" else medialis.sample_shape(sample)
            medialis.write_result(medialis.run(name, shape), f"{folder}/out")
    table = list(steps(options.path, names, options.least))
    print(f"\n{'step':40} wall  processor")
    for what, gap in sorted(table, key=lambda row: -row[1].seconds):
        print(f"{what:40} {gap.wall:4.2f}  {gap.processor:4.2f}  {gap.stage}")


if __name__ == "__main__":
    main()
