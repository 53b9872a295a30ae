"""What files this process opens: a reader opens its file, and none elsewhere."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

_paths: list[str] | None = None
"""What was opened; None: nobody looks."""

OWN = ("/proc/self/", "/proc/meminfo", "/proc/cpuinfo", "/sys/", "/dev/null", "/usr/share/zoneinfo")
"""Places that tell of the machine, which libraries read."""


@contextmanager
def opened() -> Iterator[list[str]]:
    """Collect the real paths that are opened inside the block, but for modules and caches."""
    global _paths
    _listen()
    found: list[str] = []
    _paths = found
    try:
        yield found
    finally:
        _paths = None
        roots = _roots()
        found[:] = [path for path in found if not path.startswith(roots)]


@cache
def _listen() -> None:
    def note(event: str, arguments: tuple[object, ...]) -> None:
        if _paths is not None and event == "open" and isinstance(arguments[0], str | bytes):
            try:
                _paths.append(os.path.realpath(_whole(os.fsdecode(arguments[0]))))
            except ValueError:  # a NUL character in it
                _paths.append(repr(arguments[0]))

    sys.addaudithook(note)


def _whole(path: str) -> str:
    """Return the path of a name that is looked up in an open folder, which the event leaves out."""
    from medialis.base.disk import Folder

    frame = sys._getframe(2)
    for _ in range(3):
        folder = None if frame is None else frame.f_locals.get("self")
        if isinstance(folder, Folder) and os.sep not in path:
            return str(folder.path / path)
        frame = None if frame is None else frame.f_back
    return path


@cache
def _roots() -> tuple[str, ...]:
    from medialis.base.cache_folder import kernel_cache

    modules = (sys.prefix, sys.base_prefix, *filter(None, sys.path), str(kernel_cache()))
    tables = str(Path(tempfile.gettempdir(), "medialis-"))
    return (
        *OWN,
        f"/proc/{os.getpid()}/",
        tables,
        *(f"{os.path.realpath(place)}{os.sep}" for place in modules),
    )
