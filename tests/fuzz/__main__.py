"""``python -m fuzz``: run hostile cases for some minutes, or one of them again."""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Sequence
from pathlib import Path

from fuzz.kinds import KINDS
from fuzz.runner import Runner

DEFAULT_MINUTES = 10.0


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the fuzzers; 1 when something was found."""
    parser = argparse.ArgumentParser(prog="fuzz", description=__doc__)
    parser.add_argument("--minutes", type=float, help="how long (default: 10, or until --count)")
    parser.add_argument(
        "--count", type=int, help="so many cases of each kind, earlier runs counted"
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--kinds", default=",".join(KINDS), help="with commas between them (default: %(default)s)"
    )
    parser.add_argument(
        "--output", type=Path, default=Path("build/fuzz"), help="a run goes on from what is here"
    )
    parser.add_argument("--case", metavar="KIND:NUMBER", help="run this one again")
    options = parser.parse_args(arguments)
    if options.case:
        name, _, number = options.case.partition(":")
        answer = Runner(options.output, options.seed, (name,)).run_case(name, int(number))
        print(answer.title or "passed", answer.details, sep="\n")
        return int(bool(answer.title))
    runner = Runner(options.output, options.seed, tuple(options.kinds.split(",")))
    minutes = options.minutes
    if minutes is None and options.count is None:
        minutes = DEFAULT_MINUTES
    # Also where it was started in the background, which ignores Ctrl-C; workers must not stay.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    try:
        runner.run(minutes=minutes, count=options.count)
    except KeyboardInterrupt:
        print("interrupted: the same command goes on from here", file=sys.stderr)
    print("\n".join(runner.summary()))
    return int(runner.failed)


if __name__ == "__main__":
    sys.exit(main())
