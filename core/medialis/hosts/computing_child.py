"""The other side of `medialis.hosts.computing`: a process that computes what a host asks for.

It reads orders from the pipe that is its standard input, and ends when nobody is there any more.
Orders are tuples that begin with a word: ``("run", Task)``, ``("cancel",)``, ``("answer",
file)``, ``("end",)``. It tells ``("ready", version)`` first, then ``("progress", fraction,
text)``, ``("ask", file)``, ``("done", file)`` and ``("failed", error)``.

What has arrays does not go through the pipe, where the sender would wait for the receiver: `pack`
writes it to a file of a folder that both know, and `unpack` reads it from there.
"""

from __future__ import annotations

import os
import pickle
import queue
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Callable, Hashable
from contextlib import nullcontext, suppress
from dataclasses import dataclass, replace
from hashlib import blake2b
from importlib.util import find_spec
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from medialis.base.cache_folder import kernel_cache
from medialis.base.device import Device, use_device
from medialis.base.errors import Cancelled, FileError, MedialisError
from medialis.base.kept import Bound, kept
from medialis.base.progress import Progress
from medialis.base.validation import FloatArray, IntArray
from medialis.base.version import package_version
from medialis.curves.from_views.drawing import rasterizer
from medialis.curves.from_views.skeleton import view_source
from medialis.curves.from_views.views import ViewSource
from medialis.hosts.compile_ahead import compile_ahead, is_needed
from medialis.operations.registry import run
from medialis.operations.result import Result
from medialis.shape.reading import make_shape
from medialis.shape.shape import Shape


def pack(thing: Any, folder: str | os.PathLike[str]) -> str:
    """Write an object to a new file of a folder, and return its path.

    Raises
    ------
    FileError
        When the folder cannot be written, or the disk is full.
    """
    path = ""
    try:
        handle, path = tempfile.mkstemp(".arrays", "medialis-", folder)
        with os.fdopen(handle, "wb") as file:
            pickle.dump(thing, file, protocol=5)
    except OSError as error:
        discard(path)
        raise FileError(
            f"Cannot hand arrays over in {folder}: {error.strerror or error}. Free some space, or "
            "choose another folder."
        ) from None
    return path


def unpack(file: str) -> Any:
    """Return the object, whose arrays may be written if they could before; the file is gone then.

    Raises
    ------
    FileError
        When the file cannot be read.
    """
    try:
        with Path(file).open("rb") as stream:
            return pickle.load(stream)
    except OSError as error:
        raise FileError(f"Cannot read what was handed over: {error}.") from None
    finally:
        discard(file)


def discard(file: str) -> None:
    """Remove a file that nobody will unpack."""
    if file:
        with suppress(OSError):
            Path(file).unlink()


def clear_up() -> None:
    """Remove what a host that has crashed has left: the working folder is where it handed over."""
    folder = Path.cwd()
    for left in folder.glob("medialis-*.*"):
        discard(str(left))
    if folder.name.startswith("medialis-"):  # made for this run alone
        with suppress(OSError):
            os.chdir(folder.parent)
            folder.rmdir()


PAUSE = 0.04
"""Seconds between two words about progress."""
SHARE_OF_COMPILING = 0.7
"""How far the bar goes while what the first run needs is compiled."""
PAUSE_OF_COMPILING = 0.2
"""Seconds between two looks at what was compiled."""
MOST_SHOWN, HALF_OF_COMPILING = 0.9, 50
"""How far the bar goes while kernels are compiled, and how many bring it half as far: how many
there will be is not known, operations need some 60 to 110."""


@dataclass(frozen=True)
class Task:
    """What is asked for.

    Attributes
    ----------
    name : str
        Operation.
    parameters : dict
    given : str
        File of the points and faces, as the host has them.
    folder : str
        Where arrays are handed over.
    views : bool
        The host renders views.
    threads : int or None
    device : str or None
    unit : str or None
        What one unit of the points is.
    """

    name: str
    parameters: dict[str, Any]
    given: str
    folder: str
    views: bool = False
    threads: int | None = None
    unit: str | None = None
    device: Device | None = None


class Given(Bound):
    """Points and faces that a host gave, known by their content: they are repaired once."""

    def __init__(self, points: FloatArray, faces: IntArray | None) -> None:
        self.points, self.faces = points, faces

    @property
    def identity(self) -> Hashable:
        """A digest of the arrays."""
        digest = blake2b(self.points.tobytes(), digest_size=16)
        if self.faces is not None:
            digest.update(self.faces.tobytes())
        return digest.digest(), None if self.faces is None else len(self.faces)


class Host:
    """The host at the other end of the pipe."""

    def __init__(self, pipe: Any) -> None:
        self._pipe = pipe
        self._orders: queue.SimpleQueue[tuple[str, Any]] = queue.SimpleQueue()
        self._cancelled = threading.Event()
        self._told, self._reached = 0.0, 0.0
        self._sending = threading.Lock()
        self._working = threading.Event()
        for work in (self._listen, self._watch_compiling):
            threading.Thread(target=work, daemon=True).start()

    def begin(self) -> Task:
        """Wait for the next task and begin it: what was cancelled and reached is forgotten."""
        word, task = self._orders.get()
        while word != "run":
            word, task = self._orders.get()
        self._cancelled.clear()
        self._reached = 0.0
        self._working.set()
        return task

    def end(self, *words: Any) -> None:
        """Say the last word about a task."""
        self._working.clear()
        self.tell(*words)

    def tell(self, *words: Any) -> None:
        """Say something to the host."""
        with self._sending:
            try:
                self._pipe.send(words)
            except OSError:  # `_listen` hears whether the host is gone or said "end", and ends us
                threading.Event().wait()

    def progress(self, fraction: float, text: str) -> bool:
        """Tell how far it is; False when it shall stop."""
        now = time.monotonic()
        if now - self._told >= PAUSE:
            self._told = now
            self._reached = max(fraction, self._reached)
            self.tell("progress", self._reached, text)
        return not self._cancelled.is_set()

    def ask(self, question: str) -> Any:
        """Return what the host answers.

        Raises
        ------
        Cancelled
        MedialisError
            What it failed with.
        """
        self.tell("ask", question)
        while not self._cancelled.is_set():
            with suppress(queue.Empty):
                word, answer = self._orders.get(timeout=PAUSE)
                if word == "answer":
                    found = unpack(answer)
                    if isinstance(found, Exception):
                        raise found
                    return found
        raise Cancelled("Cancelled: nothing was written or changed.")

    def _listen(self) -> None:
        """Take orders in; nobody there any more ends the process, whatever it is doing."""
        while True:
            try:
                order = self._pipe.recv()
            except (EOFError, OSError):  # the host is gone without a word
                clear_up()
                os._exit(1)
            if order[0] == "end":
                os._exit(0)
            if order[0] == "cancel":
                self._cancelled.set()
            else:
                self._orders.put(order)

    def _watch_compiling(self) -> None:
        """Tell of kernels that are compiled: meanwhile the computation itself is silent."""
        if find_spec("numba") is None:  # all were made ahead
            return
        known = compiled = _compiled_kernels()
        while True:
            if not self._working.wait(PAUSE_OF_COMPILING):
                continue
            time.sleep(PAUSE_OF_COMPILING)
            before, compiled = compiled, _compiled_kernels()
            if compiled > before and self._working.is_set():
                new = compiled - known
                self._reached = max(self._reached, MOST_SHOWN * new / (new + HALF_OF_COMPILING))
                text = f"compiling what the first run needs, {new} pieces so far"
                self.tell("progress", self._reached, text)


def _compiled_kernels() -> int:
    with suppress(OSError):
        return sum(1 for _ in kernel_cache().rglob("*.nbi"))
    return 0


def compute(task: Task, host: Host) -> tuple[Shape, Result]:
    """Repair what was given and run the operation on it; both stay known for the next task."""
    progress = Progress(host.progress)
    given = Given(*unpack(task.given))
    begin = 0.0
    if is_needed(task.name):
        begin = SHARE_OF_COMPILING
        with progress.stage("compiling what the first run needs", 0.0, begin):
            compile_ahead([task.name], progress)
    with progress.stage("input", begin, begin + 0.1):

        def repaired() -> Shape:
            points, faces, unit = given.points, given.faces, task.unit
            return make_shape(points, faces, repair=True, unit=unit, progress=progress)

        shape = kept(make_shape, given, task.unit, repaired, progress)
    views = view_source(_views_of(task, host, progress)) if task.views else nullcontext()
    with views, progress.stage("compute", begin + 0.1, 1.0), use_device(task.device):
        result = run(task.name, shape, threads=task.threads, progress=progress, **task.parameters)
    values = {"spacing": result.shape.spacing, **result.values}  # hosts draw points as large
    extras = {name: part for name, part in result.extras.items() if name in HANDED_OVER}
    return shape, replace(result, shape=shape, values=values, arrays={}, shown=(), extras=extras)


HANDED_OVER = ("bones", "skin")
"""Extra outputs that hosts use."""


def _views_of(task: Task, host: Host, progress: Progress) -> Callable[[Shape], ViewSource]:
    """Return what makes the view source of a shape: the host, or the rasterizer where it cannot."""

    def factory(shape: Shape) -> ViewSource:
        triangles = rasterizer(shape)  # a point cloud becomes discs there
        reason = host.ask(pack((triangles.points, triangles.faces), task.folder))
        if reason is not None:
            progress.note(reason, "views_by_processor")
            return triangles
        return lambda cameras: host.ask(pack(list(cameras), task.folder))

    return factory


def work(task: Task, host: Host) -> tuple[Any, ...]:
    """Return the last word about a task."""
    try:
        return "done", pack(compute(task, host), task.folder)
    except MedialisError as error:
        return "failed", error
    except MemoryError:
        return "failed", MedialisError(
            "There is not enough memory for this object and these options."
        )
    except ImportError as error:
        traceback.print_exc()
        return "failed", MedialisError(
            f"A module that medialis needs is not there or does not work: {type(error).__name__}: "
            f"{error}. Nothing was added; install medialis again."
        )
    except Exception as error:  # noqa: BLE001 - the host shows it and goes on
        traceback.print_exc()
        return "failed", MedialisError(
            f"This is a fault of medialis, please report it: {type(error).__name__}: {error}"
        )


def serve() -> None:
    """Work on what comes through the standard input, until nobody is there."""
    with suppress(OSError, AttributeError):
        os.nice(5)  # the host's window comes first
    host = Host(_input())
    host.tell("ready", package_version())
    while True:
        host.end(*work(host.begin(), host))


def _input() -> Any:
    """Return the standard input as a pipe of `multiprocessing`, which goes both ways."""
    if sys.platform == "win32":
        import msvcrt
        from multiprocessing.connection import PipeConnection
        from multiprocessing.reduction import duplicate

        return PipeConnection(duplicate(msvcrt.get_osfhandle(0)))
    return Connection(os.dup(0))
