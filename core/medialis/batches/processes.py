"""Worker processes of this machine: each gets its jobs through a pipe of its own.

A process that dies takes only its own job with it, and another one starts in its place. Workers
hear no Ctrl-C: this process ends them by itself, and they end when it is gone, however it went.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import connection, get_context, parent_process, resource_tracker
from types import TracebackType
from typing import Any, TypeVar

from medialis.errors import FileError
from medialis.threads import interrupts_held

J = TypeVar("J")
R = TypeVar("R")

READY = "ready"
SECONDS_TO_END = 5.0
"""What a worker is given to end by itself before it is killed."""


class Worker:
    """A process with its pipe; `job` is what it works on, None when it is free."""

    def __init__(self) -> None:
        context = get_context("spawn")  # a fork would copy threads that hold locks
        self.pipe, there = context.Pipe()
        self.process = context.Process(target=_serve, args=(there,), daemon=True)
        self.job: Any = None
        self._ready = False
        with deaf():
            self.process.start()
        there.close()

    def start(self, work: Callable[[Any], Any], job: Any) -> None:
        """Hand out a job; one that cannot take it is noticed as dead by `answer`."""
        self.job = job
        with suppress(OSError):
            self.pipe.send((work, job))

    def answer(self) -> tuple[bool, Any]:
        """Return whether there is an answer, and it; None of one that died.

        Raises
        ------
        FileError
            When it died before it could begin.
        """
        try:
            while self.pipe.poll():
                told = self.pipe.recv()
                if self._ready:
                    return True, told
                self._ready = told == READY
            return not self.process.is_alive() and self._lost(), None
        except (EOFError, OSError):
            return self._lost(), None

    def _lost(self) -> bool:
        if not self._ready:
            raise FileError(
                "A worker process cannot begin. In a script, call batch under "
                'if __name__ == "__main__": because each worker imports the script.'
            )
        return True

    def end(self) -> None:
        """End the process and free what it had."""
        self.pipe.close()
        self.process.terminate()
        self.process.join(SECONDS_TO_END)
        if self.process.is_alive():
            self.process.kill()
            self.process.join()
        self.process.close()


class Processes:
    """Workers as many as wanted; leaving the block ends them."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._workers: list[Worker] = []

    def __enter__(self) -> Processes:
        try:
            for _ in range(self._count):
                with interrupts_held():  # one that has begun is known, and ended
                    self._workers.append(Worker())
        except BaseException:
            self.__exit__(None, None, None)
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        with interrupts_held():
            while self._workers:
                self._workers.pop().end()

    def hand_out(
        self, jobs: Sequence[J], work: Callable[[J], R], slots: int
    ) -> Iterator[tuple[J, R | None]]:
        """Yield each job with its result, or None when its worker died; `slots` at a time.

        Raises
        ------
        FileError
            When workers cannot begin.
        """
        waiting = deque(jobs)
        while waiting or any(worker.job is not None for worker in self._workers):
            for worker in self._workers[:slots]:
                if waiting and worker.job is None:
                    worker.start(work, waiting.popleft())
            busy = [worker for worker in self._workers if worker.job is not None]
            handles = [handle for w in busy for handle in (w.pipe, w.process.sentinel)]
            connection.wait(handles)
            for worker in busy:
                there, result = worker.answer()
                if there:
                    job, worker.job = worker.job, None
                    if not worker.process.is_alive():
                        self._replace(worker)
                    yield job, result

    def _replace(self, worker: Worker) -> None:
        with interrupts_held():
            worker.end()
            self._workers[self._workers.index(worker)] = Worker()


def _serve(pipe: Any) -> None:
    """Work on what comes, until nobody is there any more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    pipe.send(READY)
    while True:
        try:
            work, job = pipe.recv()
        except (EOFError, OSError):
            return
        pipe.send(work(job))


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)


@contextmanager
def deaf() -> Iterator[None]:
    """Put requests to end off to the end of the block, in which processes begin.

    They get no Ctrl-C from the beginning: the process that starts them ends them by itself.
    """
    if sys.platform == "win32":
        yield
        return
    resource_tracker.ensure_running()  # when it begins it makes the process after it hear again
    with interrupts_held():
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
