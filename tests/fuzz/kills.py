"""Cases of the kind `kills`: signals at random moments of single runs and of batches.

The moment in a run is drawn from the seed; what the run does then depends on the machine.
"""

from __future__ import annotations

import functools
import os
import re
import shutil
import signal
import time
from dataclasses import dataclass, replace
from pathlib import Path

from fuzz.commands import (
    Content,
    Ended,
    check_same,
    check_whole,
    command,
    content,
    finish,
    has_handler,
    hidden,
    kill_group,
    one_line,
    start,
    wait,
    write_inputs,
)
from fuzz.commands import (
    run as run_command,
)
from fuzz.kinds import Case, Fault, Kind

CANCELLED = 130
LEFT_OPEN = re.compile(
    r"Exception ignored in: <_io.*\n(Traceback .*\n(  .*\n)*)?ResourceWarning: .*\n"
)
SINGLE = ("thickness", "curve-skeleton", "surface-skeleton", "patches")
OLD = {
    "thickness": ("--threshold", "0.01"),
    "curve-skeleton": ("--threshold", "0.1"),
    "surface-skeleton": ("--subsample", "0.1"),
    "patches": ("--min-angle", "50"),
}
BATCH = "thickness,patches"
BATCH_OLD = ("--set", "thickness.threshold=0.01", "--set", "patches.min_angle=50")


@dataclass(frozen=True)
class Plan:
    """What is run: the command, what it gives undisturbed and how long that takes.

    Attributes
    ----------
    words : tuple of str
        Command line without the output.
    old : tuple of str
        More options, with which the result that is there already was made.
    new_content, old_content : Content
    seconds : float
    """

    words: tuple[str, ...]
    old: tuple[str, ...]
    new_content: Content
    old_content: Content
    seconds: float
    old_folder: Path


def run(case: Case) -> None:
    """Disturb a run, look at what it left, run it again and look once more."""
    rng = case.rng
    batch = rng.random() < 0.3
    replaced = rng.random() < 0.5
    plan = _plan(case.home, "batch" if batch else rng.choice(SINGLE))
    out = case.folder / "out"
    if replaced:
        shutil.copytree(plan.old_folder, out)
    number = rng.choice((signal.SIGINT, signal.SIGTERM, signal.SIGKILL))
    everyone = (number == signal.SIGKILL and rng.random() < 0.7) or rng.random() < 0.3
    moment = plan.seconds * rng.choice((rng.random(), rng.random(), rng.uniform(0.7, 1.05)))
    words = command(*plan.words, "-o", out)
    child = start(words, case.folder)
    try:
        wait(child, moment)
        started = has_handler(child.pid)
        _send(child.pid, number, everyone)
        ended = finish(child, started=started) if number != signal.SIGKILL else None
        child.wait()  # killed alone, its workers may still write
        about = (
            f"{number.name} after {moment:.3f} s of {plan.seconds:.1f} s: {' '.join(plan.words)}"
        )
        (case.folder / "about.txt").write_text(
            f"{about}\nreplaced: {replaced}, whole group: {everyone}\n"
        )
        what = f"after {number.name} of a {'batch' if batch else 'run'}"
        check_whole(out, (plan.new_content, plan.old_content), what)
        if ended is not None:
            _check_cancelled(ended, number, about)
            if not batch:
                _check_nothing_left(case.folder, plan, replaced, ended.code == 0, what)
                return  # all is as it was, or done: the next run can find nothing else
        again = run_command(words, case.folder)
    finally:
        kill_group(child)
    if again.code != 0 or (again.err and not batch):
        raise Fault(f"the next run fails {what}", f"{again.code}: {again.err}")
    expected = plan.new_content
    if replaced:
        expected = plan.old_content | expected
    left = hidden(case.folder)
    if left:
        raise Fault(f"hidden files stay {what} and the next", ", ".join(left))
    check_same(out, expected, f"in the next run {what}")


def _send(process: int, number: signal.Signals, everyone: bool) -> None:
    try:
        if everyone:
            os.killpg(process, number)
        else:
            os.kill(process, number)
    except ProcessLookupError:
        pass  # it has ended


def _check_cancelled(ended: Ended, number: signal.Signals, about: str) -> None:
    """Done, or cancelled with one line."""
    told = f"{about}\nexit {ended.code}\n{ended.err}"
    # An import that is cut off leaves a file to the garbage: told only as warnings are errors here.
    ended = replace(ended, err=LEFT_OPEN.sub("", ended.err))
    if ended.code == 0 and not ended.err:
        return
    if ended.code == CANCELLED and one_line(ended.err):
        return
    if ended.code == -number and ended.out and not ended.err:
        raise Fault(f"{number.name} after the last line of a run gives exit {ended.code}", told)
    own = "medialis/" in ended.err
    if not ended.started:
        if own:
            raise Fault(f"{number.name} in the imports gives no line and exit 130", told)
        return  # while Python itself starts
    kind = "a traceback" if "Traceback" in ended.err else f"exit {ended.code}"
    if ended.code == CANCELLED:
        kind = "more lines than one" if ended.err else "no line"
    stage = "while it is imported" if "import" in ended.err else "while it runs"
    raise Fault(f"{number.name} {stage} gives {kind}", told)


def _check_nothing_left(folder: Path, plan: Plan, replaced: bool, done: bool, what: str) -> None:
    """A cancelled run leaves all as it was."""
    out = folder / "out"
    left = hidden(folder)
    if left:
        raise Fault(f"hidden files stay {what}", ", ".join(left))
    if done:
        expected = plan.new_content  # what is replaced goes with all its files
    elif content(out) == plan.new_content:
        return  # the signal came when all was in its place
    else:
        expected = plan.old_content if replaced else {}
    check_same(out, expected, what)


@functools.cache
def _plan(home: Path, name: str) -> Plan:
    """Run undisturbed, twice: with old parameters and with those of the case."""
    inputs = [os.fspath(path) for path in write_inputs(home / "inputs")]
    if name == "batch":
        words = ("batch", BATCH, *inputs, "--workers", "1", "--progress", "none")
        old: tuple[str, ...] = BATCH_OLD
    else:
        words, old = (name, inputs[0], "--refine", "0.05", "--overwrite"), OLD[name]
    folders = home / f"{name}-old", home / f"{name}-new"
    for folder in folders:
        shutil.rmtree(folder, ignore_errors=True)
    for more, folder in ((old, folders[0]), ((), folders[1])):
        begin = time.monotonic()
        ended = run_command(command(*words, *more, "-o", folder), home)
        if ended.code != 0:
            raise Fault(f"an undisturbed run fails: {name}", ended.err)
    seconds = time.monotonic() - begin
    contents = [content(folder) for folder in folders]
    return Plan(words, old, contents[1], contents[0], seconds, folders[0])


KIND = Kind(run, processor_seconds=100.0, wall_seconds=600.0, share=2.0)
