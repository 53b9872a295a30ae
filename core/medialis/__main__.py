"""``python -m medialis`` and the command `medialis`: the command line, which any signal may end."""

import os
import signal
import sys
from types import FrameType

LINE = b"medialis: cancelled, nothing was written.\n"
EXIT_CANCELLED = 130


def _quit(number: int, frame: FrameType | None) -> None:
    """End at once, while nothing is done but imports."""
    os.write(2, LINE)
    os._exit(EXIT_CANCELLED)


def _handle(handler: object) -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) is not signal.SIG_IGN:  # as in the background of a shell
            signal.signal(number, handler)  # type: ignore[arg-type]


def run() -> int:
    """Run the command line; return its exit code."""
    _handle(_quit)
    from medialis.cli.commands import main

    code = main()
    _handle(signal.SIG_IGN)  # what is left is the end of the interpreter
    return code


if __name__ == "__main__":
    sys.exit(run())
