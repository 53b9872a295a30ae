"""Runs cases under a watchdog, remembers how far it came, and keeps what it finds."""

from __future__ import annotations

import json
import os
import select
import shutil
import signal
import stat
import subprocess
import sys
import time
from collections import Counter
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from fuzz.kinds import KINDS, Kind, load_kind

POLL_SECONDS = 0.1
LARGEST_KEPT = 20_000_000
"""Bytes of a file that is kept with a finding."""


@dataclass
class Tally:
    """How far a kind has come."""

    next: int = 0
    failed: int = 0
    seconds: float = 0.0


@dataclass
class Answer:
    """What came of a case; no title: all is well."""

    title: str = ""
    details: str = ""
    again: bool = False


class Watched:
    """A worker process of a kind, started when needed and killed when it hangs."""

    def __init__(self, name: str, kind: Kind, seed: int, output: Path) -> None:
        self.name, self.kind, self.seed, self.output = name, kind, seed, output
        self.home = output / "home" / name
        self.log = output / f"worker-{name}.txt"
        self._child: subprocess.Popen[bytes] | None = None

    def run(self, number: int, folder: Path) -> Answer:
        """Run a case in an empty folder; again where the first answer depends on the time."""
        answer = self._run_once(number, folder)
        if answer.again:  # kernels were compiled meanwhile, or the machine had other work
            self.end()
            answer = self._run_once(number, folder)
        return answer

    def end(self) -> None:
        """Kill the worker with all that it started."""
        child, self._child = self._child, None
        if child is None:
            return
        with suppress(ProcessLookupError):
            os.killpg(child.pid, signal.SIGKILL)
        child.wait()
        for pipe in (child.stdin, child.stdout):
            if pipe is not None:
                with suppress(BrokenPipeError):
                    pipe.close()

    def _run_once(self, number: int, folder: Path) -> Answer:
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        if self._child is None:
            self._child = self._start()
        child = self._child
        assert child.stdin is not None and child.stdout is not None
        busy, begin = _processor_seconds(child.pid), time.monotonic()
        child.stdin.write(json.dumps({"number": number, "folder": str(folder)}).encode() + b"\n")
        child.stdin.flush()
        while not select.select([child.stdout], [], [], POLL_SECONDS)[0]:
            used, passed = _processor_seconds(child.pid) - busy, time.monotonic() - begin
            if used > self.kind.processor_seconds or passed > self.kind.wall_seconds:
                return self._hanging(f"{used:.0f} s of processor time in {passed:.0f} s.")
        line = child.stdout.readline()
        if line:
            return Answer(**json.loads(line))
        status = child.wait()
        self.end()
        return Answer(f"crash: exit {status}", self._log_end())

    def _start(self) -> subprocess.Popen[bytes]:
        self.home.mkdir(parents=True, exist_ok=True)
        with self.log.open("wb") as log:
            return subprocess.Popen(
                [sys.executable, "-m", "fuzz.worker", self.name, str(self.seed), str(self.home)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log,
                start_new_session=True,
            )

    def _hanging(self, text: str) -> Answer:
        """Ask the worker where it is, and kill it."""
        assert self._child is not None
        self._child.send_signal(signal.SIGUSR1)
        time.sleep(1.0)
        self.end()
        return Answer("hang", f"{text}\n{self._log_end()}", again=True)

    def _log_end(self) -> str:
        return self.log.read_text("utf-8", "replace")[-6000:]


def _processor_seconds(process: int) -> float:
    """Seconds that a process has used on all processors; 0 where the system does not tell."""
    with suppress(OSError):
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return 0.0


@dataclass
class Runner:
    """Runs cases of some kinds with one seed; what it did before is known from `output`.

    Attributes
    ----------
    output : Path
        state.json, findings and working files go here.
    seed : int
    kinds : tuple of str
    """

    output: Path
    seed: int = 0
    kinds: tuple[str, ...] = tuple(KINDS)
    tallies: dict[str, Tally] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.output = self.output.absolute()
        known = self._saved().get(str(self.seed), {})
        self.tallies = {name: Tally(**known.get(name, {})) for name in self.kinds}

    def run(self, *, minutes: float | None = None, count: int | None = None) -> None:
        """Go on until the time is over, or until each kind had `count` cases in all."""
        end = None if minutes is None else time.monotonic() + 60 * minutes
        kinds = {name: load_kind(name) for name in self.kinds}
        workers = {n: Watched(n, kind, self.seed, self.output) for n, kind in kinds.items()}
        spent = dict.fromkeys(self.kinds, 0.0)
        try:
            while end is None or time.monotonic() < end:
                open_kinds = [n for n in kinds if count is None or self.tallies[n].next < count]
                if not open_kinds:
                    break
                name = min(open_kinds, key=lambda n: spent[n] / kinds[n].share)
                begin = time.monotonic()
                self._step(name, workers[name])
                passed = time.monotonic() - begin
                spent[name] += passed
                self.tallies[name].seconds += passed
                self._save()
        finally:
            for worker in workers.values():
                worker.end()

    def run_case(self, name: str, number: int) -> Answer:
        """Run one case; its folder stays in OUTPUT/cases."""
        worker = Watched(name, load_kind(name), self.seed, self.output)
        try:
            return worker.run(number, self.output / "cases" / f"{name}-{self.seed}-{number}")
        finally:
            worker.end()

    def summary(self) -> list[str]:
        """Return counts by kind, findings by class, and the sum."""
        lines = [
            f"{name}: {tally.next} cases, {tally.failed} failed, {tally.seconds:.0f} seconds"
            for name, tally in self.tallies.items()
        ]
        classes: Counter[str] = Counter()
        first: dict[str, str] = {}
        for name in self.kinds:
            folders = (self.output / "findings").glob(f"{name}-{self.seed}-*")
            for folder in sorted(folders, key=lambda p: int(p.name.rpartition("-")[2])):
                title = f"{name}: " + (folder / "finding.txt").read_text("utf-8").splitlines()[0]
                classes[title] += 1
                first.setdefault(title, folder.name)
        lines += [f"{n} x {title} (first: {first[title]})" for title, n in classes.most_common()]
        failed = sum(tally.failed for tally in self.tallies.values())
        cases = sum(tally.next for tally in self.tallies.values())
        return [*lines, f"{cases - failed} passed, {failed} failed"]

    @property
    def failed(self) -> bool:
        """Whether anything was found, now or before."""
        return any(tally.failed for tally in self.tallies.values())

    def _step(self, name: str, worker: Watched) -> None:
        tally = self.tallies[name]
        folder = self.output / "work" / f"{name}-{self.seed}-{tally.next}"
        answer = worker.run(tally.next, folder)
        if answer.title:
            tally.failed += 1
            self._keep(name, tally.next, folder, answer)
            print(f"{folder.name}: {answer.title}", flush=True)
        shutil.rmtree(folder, ignore_errors=True)
        tally.next += 1

    def _keep(self, name: str, number: int, folder: Path, answer: Answer) -> None:
        """Move what the case has left to the findings, with a text."""
        place = self.output / "findings" / folder.name
        shutil.rmtree(place, ignore_errors=True)
        place.parent.mkdir(parents=True, exist_ok=True)
        for path in folder.rglob("*"):
            about = path.lstat()
            # A pipe would stop everybody who looks through the findings.
            if stat.S_ISFIFO(about.st_mode) or about.st_size > LARGEST_KEPT:
                path.unlink()
        shutil.move(folder, place)
        again = f"python -m fuzz --seed {self.seed} --case {name}:{number}"
        text = f"{answer.title}\n\nRun it again: {again}\n\n{answer.details}\n"
        (place / "finding.txt").write_text(text, "utf-8", "backslashreplace")

    def _saved(self) -> dict[str, Any]:
        with suppress(OSError):
            saved: dict[str, Any] = json.loads((self.output / "state.json").read_bytes())
            return saved
        return {}

    def _save(self) -> None:
        saved = self._saved()
        own = {name: asdict(tally) for name, tally in self.tallies.items()}
        saved[str(self.seed)] = saved.get(str(self.seed), {}) | own
        self.output.mkdir(parents=True, exist_ok=True)
        new = self.output / "state.new"
        new.write_text(json.dumps(saved, indent=1))
        new.replace(self.output / "state.json")
