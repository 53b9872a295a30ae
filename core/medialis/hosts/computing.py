"""A process that computes for a host, so that the host's window answers meanwhile.

The process (`Computer`) is another Python of the same installation, which runs `computing_child`.
It stays between computations, and with it what it has computed: a late option is answered from
there. One computation (`Computation`) is looked at from a timer of the host, or waited for; there
is no thread, and a crash of the process is a sentence. When the host is gone, also by a crash, the
pipe ends, and with it the process.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Pipe
from pathlib import Path
from typing import IO, Any

from medialis.base.children import Child
from medialis.base.device import Device
from medialis.base.errors import Cancelled, MedialisError
from medialis.base.validation import FloatArray, IntArray
from medialis.base.version import package_version
from medialis.curves.from_views.views import OrthographicCamera, ViewSource
from medialis.hosts.computing_child import Task, pack, unpack
from medialis.operations.result import Result
from medialis.shape.shape import Shape

SERVICE = 0.05
"""Seconds that one look may spend on rendering views."""
PATIENCE = 0.02
"""Seconds between two looks while waiting."""

Renderer = Callable[[FloatArray, IntArray], ViewSource | str]
"""Makes the view source of triangles; a sentence where the host cannot render."""


class Computation:
    """One computation of a `Computer`.

    Attributes
    ----------
    fraction, text : float, str
        How far it is.
    done : bool
        Whether `outcome` has something to tell.
    """

    def __init__(self, computer: Computer, render: Renderer | None) -> None:
        self.fraction, self.text, self.done = 0.0, "starting", False
        self._computer = computer
        self._render = render
        self._source: ViewSource | None = None
        self._found: tuple[Shape, Result] | None = None
        self._error: Exception | None = None

    def look(self, seconds: float = SERVICE) -> bool:
        """Take in what the process told, and render what it asked for; return whether it is done.

        Parameters
        ----------
        seconds : float
            While views are asked for, look again for so long.
        """
        end = time.monotonic() + seconds
        wait = 0.0
        while not self.done:
            word, *content = self._computer.hear(wait) or ("nothing",)
            if word == "nothing":
                return False
            wait = self._take_in(word, content, max(end - time.monotonic(), 0.0))
        return True

    def wait(self, report: Callable[[float, str], object] | None = None) -> None:
        """Look until it is done; `report` hears the progress. Ctrl-C cancels it."""
        try:
            while not self.look():
                if report is not None:
                    report(self.fraction, self.text)
                self._computer.listen(PATIENCE)
        except BaseException:
            self.cancel()
            raise

    def cancel(self) -> None:
        """End it now; the process stops at its next chunk of work and is there for the next one."""
        if not self.done:
            self._end(Cancelled("Cancelled: nothing was written or changed."))
            self._computer.cancel()

    def outcome(self) -> tuple[Shape, Result]:
        """Return the repaired shape, and the result without what no host shows.

        Raises
        ------
        MedialisError
            What the computation raised; `Cancelled` when it was cancelled.
        """
        if self._error is not None:
            raise self._error
        if self._found is None:
            raise RuntimeError("The computation is not done.")
        return self._found

    def _take_in(self, word: str, content: Sequence[Any], left: float) -> float:
        """Take one word in; return how long the next may be waited for."""
        if word == "progress":
            self.fraction, self.text = content
        elif word == "ask":
            self._computer.answer(self._answer(unpack(content[0])))
            return left
        else:
            error = content[0] if word == "failed" else None
            if word == "done":
                try:
                    self._found = unpack(content[0])
                except MedialisError as failure:
                    error = failure
            self._end(error)
        return 0.0

    def _answer(self, question: Any) -> Any:
        """Make the view source of triangles, or render views of it."""
        assert self._render is not None
        try:
            if isinstance(question, list):
                cameras: list[OrthographicCamera] = question
                return self._source(cameras) if self._source else []
            made = self._render(*question)
            self._source = None if isinstance(made, str) else made
            return made if isinstance(made, str) else None
        except Exception as error:  # noqa: BLE001 - drivers raise anything; the computation tells
            return MedialisError(f"The views could not be rendered: {error}")

    def _end(self, error: Exception | None) -> None:
        self._error, self.done, self._render, self._source = error, True, None, None
        if error is None:
            self.fraction = 1.0


CODE = "from medialis.hosts.computing_child import serve; serve()"
VERSION = package_version()
"""What runs here; an update may have put other files in their place since."""
SECONDS_TO_COME_BACK = 0.2
"""What a cancelled process has when the next task is there; then another takes its place."""
SECONDS_TO_END = 1.0
"""What a process has to end by itself."""


@dataclass
class Computer:
    """The process, started when it is first needed.

    Attributes
    ----------
    folder : path
        Where arrays are handed over; the host's own.
    environment : dict
        Variables of the process, such as MEDIALIS_CACHE_DIR, beside the host's.
    """

    folder: Path
    environment: Mapping[str, str]

    def __post_init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._pipe: Any = None
        self._free = True
        self._ready = False
        self._errors: IO[bytes] | None = None
        self._passed_on = 0

    def run(
        self,
        name: str,
        points: FloatArray,
        faces: IntArray | None,
        parameters: Mapping[str, Any],
        *,
        render: Renderer | None = None,
        threads: int | None = None,
        unit: str | None = None,
        device: Device | None = None,
    ) -> Computation:
        """Begin an operation on points and faces as the host has them.

        Parameters
        ----------
        name, parameters
            As in `medialis.run`.
        render : callable, optional
            The host renders views; called where `Computation.look` is.
        threads : int, optional
            At most this many.
        unit : str, optional
            What one unit of the points is, such as "mm".
        device : str, optional
            Device for computing: "cpu", "gpu" or "auto".

        Raises
        ------
        MedialisError
            When the process cannot be started, or the arrays cannot be handed over.
        """
        self._require_process()
        given = pack((points, faces), self.folder)
        task = Task(
            name,
            dict(parameters),
            given,
            str(self.folder),
            render is not None,
            threads,
            unit,
            device,
        )
        self._free = False
        with suppress(OSError):  # what cannot take it is noticed as dead by `hear`
            self._pipe.send(("run", task))
        return Computation(self, render)

    def hear(self, seconds: float = 0.0) -> tuple[Any, ...] | None:
        """Return the next word of the process, None when there is none in this time."""
        try:
            if not self.listen(seconds):
                return None
            words: tuple[Any, ...] = self._pipe.recv()
        except (EOFError, OSError):
            return "failed", self._death()
        if words[0] == "ready":
            self._ready = True
            if words[1] == VERSION:
                return None
            self.end()  # the files are of another version than what runs here
            told = f"medialis was updated from {VERSION} to {words[1]}: restart the program."
            return "failed", MedialisError(told)
        self._free = words[0] in ("done", "failed")
        if self._free:
            self._pass_on_errors()
        return words

    def listen(self, seconds: float) -> bool:
        """Wait until the process says something, so long at most; return whether it did."""
        return self._pipe is None or bool(self._pipe.poll(seconds))

    def answer(self, thing: Any) -> None:
        """Answer what the process asked."""
        with suppress(OSError):
            self._pipe.send(("answer", pack(thing, self.folder)))

    def cancel(self) -> None:
        """Ask the process to stop."""
        with suppress(OSError, AttributeError):
            self._pipe.send(("cancel",))

    def end(self) -> None:
        """End the process, and with it what it knows."""
        if self._process is None:
            return
        with suppress(OSError):
            self._pipe.send(("end",))
        self._pipe.close()
        try:
            self._process.wait(SECONDS_TO_END)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._process = self._pipe = None
        self._free, self._ready = True, False
        if self._errors is not None:
            self._errors.close()
        for left in self.folder.glob("medialis-*.arrays"):
            with suppress(OSError):
                left.unlink()

    def _require_process(self) -> None:
        """Have a process that is free: what does not come back from a cancelled task is ended."""
        end = time.monotonic() + SECONDS_TO_COME_BACK
        while self._process is not None and not self._free:
            words = self.hear(max(end - time.monotonic(), 0.0))
            if words is None:
                self.end()
            elif words[0] == "done":
                unpack(words[1])
        if self._process is None or self._process.poll() is not None:
            self.end()
            self._start()

    def _start(self) -> None:
        here, there = Pipe()
        stdin = _descriptor(there)
        self._errors, self._passed_on = None, 0
        with suppress(OSError):  # `pack` says why nothing can be written there
            self._errors = tempfile.TemporaryFile(dir=self.folder)  # noqa: SIM115 - `end` closes it
        try:
            self._process = Child(
                CODE,
                environment=self.environment,
                cwd=self.folder,
                stdin=stdin,
                stdout=subprocess.DEVNULL,
                stderr=self._errors,
                creationflags=getattr(subprocess, "BELOW_NORMAL_PRIORITY_CLASS", 0),
            )
        except OSError as error:
            here.close()
            if self._errors is not None:
                self._errors.close()
            raise MedialisError(
                f"Python cannot be started for the computation ({sys.executable}: "
                f"{error.strerror}). Is the program complete, and is there enough memory?"
            ) from None
        finally:
            os.close(stdin)
            there.close()
        self._pipe, self._free = here, True

    def _pass_on_errors(self) -> str:
        """Write what the process wrote to its stderr to that of this one; return its last line.

        The process has said its last word or is dead. Both have one position in the file, so it
        must not write meanwhile.
        """
        if self._errors is None:
            return ""
        self._errors.seek(self._passed_on)
        text = self._errors.read().decode("utf-8", "replace")
        self._passed_on = self._errors.tell()
        if text and sys.stderr is not None:
            sys.stderr.write(text)
        # Below what Python dies of before it runs, it lists threads without frames.
        lines = [line for line in text.splitlines() if not line.startswith((" ", "Current thread"))]
        return next((line.strip() for line in reversed(lines) if line.strip()), "")

    def _death(self) -> MedialisError:
        """Say how the process ended, and forget it."""
        process, ready = self._process, self._ready
        code = None
        if process is not None:
            with suppress(subprocess.TimeoutExpired):
                code = process.wait(SECONDS_TO_END)
        last = self._pass_on_errors()
        self.end()
        if sys.platform != "win32" and code == -signal.SIGKILL:
            return MedialisError(
                "The system killed the process that computes, as it does when memory runs out: "
                "nothing was added. Run again, or with a smaller object."
            )
        how = "" if code is None else f" (signal {-code})" if code < 0 else f" (code {code})"
        what = "ended unexpectedly" if ready else "could not start"
        why = f": {last.removesuffix('.')}." if last else "."
        return MedialisError(f"The process that computes {what}{how}{why} Nothing was added.")


def _descriptor(pipe: Any) -> int:
    """Return a file descriptor of a pipe's end, to be closed by the caller."""
    if sys.platform == "win32":
        import msvcrt
        from multiprocessing.reduction import duplicate

        return msvcrt.open_osfhandle(duplicate(pipe.fileno()), 0)
    return os.dup(pipe.fileno())
