"""Compiling what an operation needs before its first run, in as many processes as processors.

Where kernels are made ahead of time (`base/jit.py`) there is nothing to do here.

numba compiles a kernel when it is first called, one after the other, and most of that is Python.
`kernels.txt` lists the kernels that each operation calls, and for which types, so that several
processes can compile them into the same cache, and a bar can tell how far they are. What is not
listed is compiled when it is called. `benchmarks/record_kernels.py` writes the list.
"""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Collection
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from medialis.base.cache_folder import kernel_cache, make_kernel_cache
from medialis.base.jit import record
from medialis.base.progress import Progress
from medialis.base.threads import thread_count

LIST = Path(__file__).with_name("kernels.txt")
CODE = "from medialis.hosts.compile_ahead import take_turns; take_turns()"
PAUSE = 0.1
"""Seconds between two looks."""
MOST_PROCESSES = 8
START, A_KERNEL = 1.5, 0.25
"""Seconds that a process takes to begin, and to compile one kernel, on a processor of 2023."""


class Listed(NamedTuple):
    """A kernel with the types of its arguments, and the operations that need it.

    Kernels that call no other ones come first in the list, and so on.
    """

    kernel: str
    arguments: list[Any]
    operations: list[str]


@cache
def all_listed() -> tuple[Listed, ...]:
    """Return what `kernels.txt` lists: kernel, operations, and types as JSON, parted by ``|``."""
    if not LIST.is_file():
        return ()
    lines = (line.split("|") for line in LIST.read_text(encoding="ascii").splitlines())
    return tuple(Listed(kernel, json.loads(words), names.split()) for kernel, names, words in lines)


def listed(*operations: str) -> list[Listed]:
    """Return what some operations need."""
    return [one for one in all_listed() if not set(operations).isdisjoint(one.operations)]


def compile_ahead(operations: Collection[str], progress: Progress) -> None:
    """Compile what some operations need, if that was not done yet.

    Raises
    ------
    Cancelled
        What was compiled so far stays.
    """
    waiting = listed(*operations)
    with suppress(OSError), tempfile.TemporaryDirectory() as turns:
        make_kernel_cache()
        helpers: list[subprocess.Popen[bytes]] = []
        try:
            count = min(thread_count(), MOST_PROCESSES, len(waiting))
            helpers.extend(_helper(operations, turns) for _ in range(count))
            while any(helper.poll() is None for helper in helpers):
                taken = sum(1 for _ in os.scandir(turns))
                progress.update(taken / len(waiting))
                time.sleep(PAUSE)
        finally:
            for helper in helpers:
                helper.kill()
                helper.communicate()
        for operation in operations:
            _marker(operation).touch()


def is_needed(operation: str) -> bool:
    """Tell whether an operation has listed kernels and was not compiled ahead yet."""
    return not record() and bool(listed(operation)) and not _marker(operation).is_file()


def seconds_needed(operations: Collection[str]) -> float:
    """Return about how long `compile_ahead` takes by the clock, from the number of kernels."""
    return START + A_KERNEL * len(listed(*operations)) / min(thread_count(), MOST_PROCESSES)


def _marker(operation: str) -> Path:
    return kernel_cache() / f"ahead-{operation}-{sys.implementation.cache_tag}"


def _helper(operations: Collection[str], turns: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-P", "-c", CODE, turns, *operations],
        stdin=subprocess.PIPE,  # it ends when this process is gone
        stdout=subprocess.DEVNULL,
        creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
    )


def take_turns() -> None:
    """Compile what no other process has taken; arguments: a folder of turns, and operations."""
    _, turns, *operations = sys.argv
    threading.Thread(target=_end_with_parent, daemon=True).start()
    for number, one in enumerate(listed(*operations)):
        try:
            os.close(os.open(Path(turns) / str(number), os.O_CREAT | os.O_EXCL))
        except OSError:
            continue
        with suppress(Exception):  # changed since it was listed: compiled when it is called
            compile_one(one)


def _end_with_parent() -> None:
    os.read(0, 1)
    os._exit(1)


def compile_one(one: Listed) -> None:
    """Compile a kernel for its types, or find it compiled."""
    from medialis.base.compiling import compile_for

    compile_for(named(one.kernel), [example(word) for word in one.arguments])


def named(name: str) -> Any:
    """Return a kernel, or the class of a record, by its module and its name."""
    module, _, name = name.partition(":")
    return getattr(importlib.import_module(f"medialis.{module}"), name)


def example(word: str | list[Any]) -> Any:
    """Return a value of a type: ``f8`` a number, ``f8:2C`` an array, ``f8:2Cr`` one read-only.

    A record is a list of its class and the words of its fields; a tuple has no class.

    Examples
    --------
    >>> int(example("i4")), example("f8:2C").shape, example("f8:1Ar").flags.writeable
    (0, (2, 2), False)
    >>> example(["walls._kernels:Links", "i4:1C", "i4:1C", "i4:1C"]).neighbours.dtype
    dtype('int32')
    """
    if isinstance(word, list):
        values = [example(field) for field in word[1:]]
        return named(word[0])(*values) if word[0] else tuple(values)
    kind, _, about = word.partition(":")
    if not about:
        return np.dtype(kind).type(0)
    dimensions, layout = int(about[0]), about[1]
    if layout == "A":
        array = np.zeros((4,) * dimensions, kind)[(slice(None, None, 2),) * dimensions]
    else:
        array = np.zeros((2,) * dimensions, kind, order="F" if layout == "F" else "C")
    array.flags.writeable = not about.endswith("r")
    return array
