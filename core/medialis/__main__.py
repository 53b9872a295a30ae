"""``python -m medialis`` and the command `medialis`: the command line, which any signal may end."""

import gc
import os
import signal
import sys
from contextlib import suppress
from types import FrameType

LINE = b"medialis: cancelled, nothing was written.\n"
EXIT_CANCELLED = 130
OBJECTS = 20_000
"""Python looks for cycles when so many objects are new: at its 700, that is a twentieth of the time
that a shape of 35,000 points takes, as hundreds of modules are loaded."""


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
    gc.set_threshold(OBJECTS)
    from medialis.cli.commands import main

    code = main()
    gc.freeze()  # the end of the interpreter looks twice for cycles, for .05 s
    _handle(signal.SIG_IGN)  # what is left is the end of the interpreter
    if code == EXIT_CANCELLED:
        # A thread may still be in a library's code, which must not see the interpreter end.
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError):
                stream.flush()
        os._exit(code)
    return code


if __name__ == "__main__":
    sys.exit(run())
