"""Cases of the kind `calls`: one call of the system fails once, or is the last before a kill.

Single runs and batches, with and without an older result. The calls of the workers of a batch are
those of a single run; here it is the process of the batch itself that is hindered.
"""

from __future__ import annotations

import errno
import os
import shutil
import sys
from pathlib import Path

from fuzz.commands import check_whole, command, content, finish, hidden, one_line, start
from fuzz.commands import run as run_command
from fuzz.kills import _plan as plan
from fuzz.kinds import Case, Fault, Kind

CODE = """
import sys
from fuzz.hindered_disk import failing, hindered, killing
from medialis.cli import main
number, error = int(sys.argv[1]), int(sys.argv[2])
if __name__ == "__main__":
    with hindered(failing(number, error) if error else killing(number)):
        code = main(sys.argv[3:])
    sys.exit(code)
"""
ERRORS = (errno.ENOSPC, errno.EIO, errno.EROFS, errno.EINTR, 0, 0)
"""The last ones are kills."""

MOST_CALLS = {"thickness": 60, "patches": 60, "batch": 14}
KILLED, BAD_INPUT = 9, 2


def run(case: Case) -> None:
    """Hinder a run, look at what is there, run again, and look once more."""
    rng = case.rng
    name = rng.choice(("thickness", "patches", "batch"))
    known = plan(case.home, name)
    out = case.folder / "out"
    replaced = rng.random() < 0.6
    if replaced:
        shutil.copytree(known.old_folder, out)
    number, error = rng.randrange(MOST_CALLS[name]), rng.choice(ERRORS)
    script = case.folder / "script.py"
    script.write_text(CODE)
    words = [sys.executable, os.fspath(script), str(number), str(error), *known.words]
    ended = finish(start([*words, "-o", os.fspath(out)], case.folder))
    script.unlink()
    about = f"{name}, call {number}: {errno.errorcode.get(error, 'kill')}, replaced: {replaced}"
    _note(case.folder, f"{about}\n{ended}")
    what = f"after a call of a {'batch' if name == 'batch' else 'run'} that failed"
    if ended.code not in ((0, BAD_INPUT) if error else (0, KILLED)):
        raise Fault(f"exit {ended.code} {what}", f"{about}\n{ended}")
    if ended.code == BAD_INPUT:
        last = ended.err.splitlines()[-1] + "\n" if ended.err else ""
        if not one_line(last if name == "batch" else ended.err) or "/out" not in last:
            raise Fault(f"no sentence that names the file {what}", f"{about}\n{ended}")
    check_whole(out, (known.new_content, known.old_content), what)
    if ended.code == BAD_INPUT and name != "batch":
        before = known.old_content if replaced else {}
        now = content(out) if out.exists() else {}
        if {n: t for n, t in now.items() if n[0] != "."} != before:
            raise Fault(f"the old result is not as it was {what}", f"{about}\n{sorted(now)}")
    again = run_command(command(*known.words, "-o", out), case.folder)
    if again.code != 0:
        raise Fault(f"the next run fails {what}", f"{about}\n{again}")
    if left := hidden(case.folder):
        raise Fault(f"hidden files stay {what} and the next", f"{about}\n{left}")
    expected = known.new_content if not replaced or name != "batch" else None
    if expected is not None and content(out) != expected:
        raise Fault(f"files differ in the next run {what}", about)


def _note(folder: Path, text: str) -> None:
    (folder / "about.txt").write_text(text)


KIND = Kind(run, processor_seconds=100.0, wall_seconds=500.0)
