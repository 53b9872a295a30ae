"""Processes of our own: another Python of this installation, that ends with this one in any case.

A host's computations (`hosts/computing.py`) and what reads foreign files (`formats/foreign.py`) run
in such a process. It finds the modules that this one finds. `answer_of` gives one bytes, within
limits of processor time and memory, and takes its answer; the process calls `settle` first.

However this process ends, by a crash or a kill as well, the other one ends too. On Linux the system
kills it then. On Windows it belongs to a job that ends with its last handle. Elsewhere it begins
with a fork: the first half watches a pipe that this process holds, and kills the second one.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from medialis.base.errors import MedialisError
from medialis.base.threads import PATIENCE, given_up

LINUX, WINDOWS = sys.platform.startswith("linux"), sys.platform == "win32"

WALL = 6.0
"""Seconds by the clock for one of processor time: other programs run as well."""

GRACE = 2
"""Seconds between the limit of processor time, which a process may tell of, and its end."""

TIME_IS_UP = 1816
"""What a process of a Windows job ends with when the time of the job is used."""

_SET_DEATH_SIGNAL = 1


@dataclass(frozen=True)
class Limits:
    """What a process may cost: seconds of processor time, and bytes of memory that it writes."""

    seconds: float
    memory: int


class Ended(MedialisError):  # noqa: N818 - an outcome, told by who asked
    """A process gave no answer; `slow` tells that its time was used up."""

    def __init__(self, text: str, *, slow: bool) -> None:
        super().__init__(text)
        self.slow = slow


class Child(subprocess.Popen[bytes]):
    """A Python that runs some code, and ends with this process on Windows; else see `settle`."""

    def __init__(
        self,
        code: str,
        words: Sequence[str] = (),
        *,
        environment: Mapping[str, str] | None = None,
        limits: Limits | None = None,
        **more: Any,
    ) -> None:
        more["creationflags"] = more.get("creationflags", 0) | getattr(
            subprocess, "CREATE_NO_WINDOW", 0
        )
        super().__init__(
            [sys.executable, "-P", "-c", code, *words],
            env={**_variables(), **(environment or {})},
            **more,
        )
        self._job = _job_of(self, limits) if WINDOWS else None


def _variables() -> dict[str, str]:
    """Return the variables of a process that finds the same modules as this one."""
    ours = dict(os.environ)
    if sys.flags.ignore_environment:  # a host that does not let others change its Python
        ours = {name: text for name, text in ours.items() if not name.startswith("PYTHON")}
    return {**ours, "PYTHONPATH": os.pathsep.join(dict.fromkeys(filter(None, sys.path)))}


def answer_of(code: str, given: bytes, limits: Limits) -> bytes:
    """Return what a process writes that runs `code` and reads `given`.

    Its code begins with `settle(*sys.argv[1:])`. It is killed when its time is used, when the
    caller is (`given_up`), and when an exception comes by.

    Raises
    ------
    Ended
        When it crashed, or came to the end of its limits.
    """
    watched = None if WINDOWS or LINUX else os.pipe()
    words = (str(os.getpid()), str(watched[0] if watched else -1), repr(limits.seconds),
             str(limits.memory))  # fmt: skip
    more: dict[str, Any] = {"pass_fds": watched[:1]} if watched else {}
    # More threads of linear algebra would only take memory.
    few = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
    try:
        child = Child(code, words, environment=few, limits=limits, **pipes, **more)
        pipe, child.stdin = child.stdin, None
        feeding = threading.Thread(target=_feed, args=(pipe, given), daemon=True)
        feeding.start()
        try:
            said = _heard(child, time.monotonic() + WALL * (limits.seconds + GRACE))
        finally:
            child.kill()
            child.wait()
            feeding.join()
            if child.stdout is not None:
                child.stdout.close()
    except OSError as error:
        raise Ended(f"Python cannot be started ({error.strerror or error})", slow=False) from None
    finally:
        for end in watched or ():
            os.close(end)
    if child.returncode == 0 and said is not None:
        return said
    slow = said is None or child.returncode in (TIME_IS_UP, -getattr(signal, "SIGXCPU", 0))
    raise Ended(f"it ended with code {child.returncode}", slow=slow)


def _feed(pipe: Any, given: bytes) -> None:
    """Write to a process, which may end before it has read all: what waits cannot write besides."""
    with suppress(OSError):
        pipe.write(given)
    with suppress(OSError):
        pipe.close()


def _heard(child: Child, end: float) -> bytes | None:
    """Return what a process wrote when it has ended; None when it took too long."""
    while time.monotonic() < end and not given_up():
        with suppress(subprocess.TimeoutExpired):
            return child.communicate(timeout=PATIENCE)[0]
    return None


def settle(parent: str, watched: str, seconds: str, memory: str) -> None:
    """Let this process end with the one that began it, and within limits; called in it, first."""
    if WINDOWS:
        return  # its job does both
    if LINUX:
        import ctypes

        ctypes.CDLL(None).prctl(_SET_DEATH_SIGNAL, signal.SIGKILL, 0, 0, 0)
        if os.getppid() != int(parent):  # it ended before
            os._exit(1)
    else:
        watch(int(watched))
    limit(Limits(float(seconds), int(memory)))


def watch(pipe: int) -> None:
    """Go on in a process of its own, which is killed when nobody holds the other end of a pipe."""
    import select

    ours, theirs = os.pipe()
    process = os.fork()
    if process == 0:
        os.close(ours)  # `theirs` is closed when this process ends, however it does
        os.close(pipe)
        return
    os.close(theirs)
    os.close(0)
    os.close(1)
    ready = select.select([ours, pipe], [], [])[0]
    if ours not in ready:
        os.kill(process, signal.SIGKILL)
    code = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
    if code < 0:  # end as it did
        signal.signal(-code, signal.SIG_DFL) if -code != signal.SIGKILL else None
        os.kill(os.getpid(), -code)
    os._exit(code)


def limit(limits: Limits) -> None:
    """Bound the processor time and the memory of this process (Linux and macOS)."""
    import resource

    seconds = max(1, round(limits.seconds))
    # macOS takes no notice of limits of memory.
    wanted = (
        (resource.RLIMIT_CPU, seconds, seconds + GRACE),
        (resource.RLIMIT_DATA, limits.memory, limits.memory),
        (resource.RLIMIT_CORE, 0, 0),
    )
    for which, soft, hard in wanted:
        highest = resource.getrlimit(which)[1]
        if highest != resource.RLIM_INFINITY:
            soft, hard = min(soft, highest), min(hard, highest)
        with suppress(OSError, ValueError):
            resource.setrlimit(which, (soft, hard))


_KILL_WITH_JOB, _PROCESS_TIME, _PROCESS_MEMORY = 0x2000, 0x2, 0x100
_EXTENDED_LIMITS = 9
_TICKS = 10_000_000
"""Of Windows in a second."""


def job_limits(limits: Limits | None) -> Any:
    """Return what a Windows job is told: its processes end with it, and within limits."""
    import ctypes

    whole, size, count = ctypes.c_int64, ctypes.c_size_t, ctypes.c_uint32

    class Basic(ctypes.Structure):
        _fields_ = (
            *(("process_time", whole), ("job_time", whole), ("flags", count)),
            *(("least_set", size), ("most_set", size), ("processes", count), ("affinity", size)),
            *(("priority", count), ("scheduling", count)),
        )

    class Extended(ctypes.Structure):
        _fields_ = (
            *(("basic", Basic), ("counters", ctypes.c_uint64 * 6), ("process_memory", size)),
            *(("job_memory", size), ("most_process", size), ("most_job", size)),
        )

    told = Extended()
    told.basic.flags = _KILL_WITH_JOB
    if limits is not None:
        told.basic.flags |= _PROCESS_TIME | _PROCESS_MEMORY
        told.basic.process_time = int(limits.seconds * _TICKS)
        told.process_memory = limits.memory
    return told


def _job_of(process: subprocess.Popen[bytes], limits: Limits | None) -> Any:
    """Put a process into a job of its own, which ends with the handle that is returned."""
    if sys.platform != "win32":
        return None
    import ctypes

    kernel = ctypes.WinDLL("kernel32", use_last_error=True)
    kernel.CreateJobObjectW.restype = ctypes.c_void_p
    job = ctypes.c_void_p(kernel.CreateJobObjectW(None, None))
    told = job_limits(limits)
    kernel.SetInformationJobObject(job, _EXTENDED_LIMITS, ctypes.byref(told), ctypes.sizeof(told))
    kernel.AssignProcessToJobObject(job, ctypes.c_void_p(int(process._handle)))
    return job
