"""What the tests put in the place of the system below `medialis.base.disk`: it fails, or kills.

Every call that changes something is counted; the one of a number fails once with an error, or is
the last one before the process ends. An attacker may act before any of them.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from medialis.base import disk

CHANGING = ("mkdir", "replace", "unlink", "rmdir", "write", "ftruncate", "posix_fallocate")
"""Calls of the system that change something; so does `open` of a file that may be new."""


class System:
    """The module `os`, hindered; `count` is how many calls were made that change something."""

    def __init__(self, before: Callable[[int, str], None]) -> None:
        self._before, self.count = before, 0

    def __getattr__(self, name: str) -> Any:
        found = getattr(os, name)
        if name == "open":
            return self._open
        return self._counted(name, found) if name in CHANGING else found

    def _open(self, path: Any, flags: int, *more: Any, **named: Any) -> int:
        if flags & os.O_CREAT:
            return self._counted("open", os.open)(path, flags, *more, **named)
        return os.open(path, flags, *more, **named)

    def _counted(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def hindered(*given: Any, **named: Any) -> Any:
            self.count += 1
            self._before(self.count - 1, name)
            return call(*given, **named)

        return hindered


@contextmanager
def hindered(before: Callable[[int, str], None]) -> Iterator[System]:
    """Call `before` with number and name of each call that changes something."""
    usual, disk.os = disk.os, System(before)  # type: ignore[assignment]
    try:
        yield disk.os  # type: ignore[misc]
    finally:
        disk.os = usual


def failing(number: int, error: int) -> Callable[[int, str], None]:
    """Let one call fail, once."""

    def before(count: int, name: str) -> None:
        if count == number:
            raise OSError(error, os.strerror(error))

    return before


def killing(number: int) -> Callable[[int, str], None]:
    """End the process before one call, as nothing can prevent."""

    def before(count: int, name: str) -> None:
        if count == number:
            os._exit(9)

    return before
