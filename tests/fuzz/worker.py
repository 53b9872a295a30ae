"""The child process in which cases run: numbers come in on stdin, a line of JSON goes out for each.

It may crash, hang or run out of memory: the runner watches it.
"""

from __future__ import annotations

import faulthandler
import json
import os
import resource
import signal
import sys
import traceback
import warnings
from pathlib import Path

import medialis
from fuzz.kinds import Fault, Kind, load_kind, make_case

PACKAGE = Path(medialis.__file__).parent


def main() -> None:
    """Run cases of the kind and seed in sys.argv until stdin ends."""
    name, seed, home = sys.argv[1], int(sys.argv[2]), Path(sys.argv[3])
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what a case prints must not be taken for an answer
    faulthandler.enable()
    faulthandler.register(signal.SIGUSR1, all_threads=True)  # the runner asks where it hangs
    kind = load_kind(name)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if kind.memory is not None:
        resource.setrlimit(resource.RLIMIT_AS, (kind.memory, kind.memory))
    warnings.simplefilter("error")
    for line in sys.stdin:
        given = json.loads(line)
        found = run_case(kind, name, seed, given["number"], Path(given["folder"]), home)
        print(json.dumps(found), file=answers, flush=True)


def run_case(
    kind: Kind, name: str, seed: int, number: int, folder: Path, home: Path
) -> dict[str, object]:
    """Run one case; return its title ("": all is well), details, and whether to try again."""
    try:
        kind.run(make_case(seed, name, number, folder, home))
    except Fault as fault:
        return {"title": fault.title, "details": fault.details, "again": fault.again}
    except BaseException as error:  # noqa: BLE001 - whatever comes out is the finding
        return {"title": title_of(error), "details": traceback.format_exc(), "again": False}
    return {"title": "", "details": "", "again": False}


def title_of(error: BaseException) -> str:
    """Return type and place of an error: the last line of medialis that it passed."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if Path(frame.filename).is_relative_to(PACKAGE)]
    if not own:
        return f"{type(error).__name__} outside of medialis"
    place = Path(own[-1].filename).relative_to(PACKAGE)
    return f"{type(error).__name__} in {place}, {own[-1].name}"


if __name__ == "__main__":
    main()
