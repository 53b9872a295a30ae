"""Jobs on worker processes of this machine, or on an existing Dask cluster by its address.

Strategy: no more jobs are handed out than the workers have threads, so that none waits in the queue
of a worker that dies. On a cluster of many threads a job dies with others in the same worker, so
jobs whose worker died run again at the end, one operation at a time and alone, and only what kills
its worker then is reported. Rows come back as they are made; nothing else is held.

Each process of this machine gets its jobs through a pipe of its own. One that dies takes only its
own job with it, and another one starts in its place. They hear no Ctrl-C: this process ends them by
itself, and they end when it is gone, however it went.
"""

from __future__ import annotations

import ipaddress
import logging
import os
import signal
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from functools import partial
from itertools import islice
from multiprocessing import connection, get_context, parent_process, resource_tracker
from typing import Any, TypeVar

from medialis.base.errors import FileError, InvalidOptionError
from medialis.base.progress import Progress
from medialis.base.threads import interrupts_held
from medialis.batches.jobs import Job, Row

J = TypeVar("J")
R = TypeVar("R")

READY = "ready"
SECONDS_TO_END = 5.0
"""What a worker is given to end by itself before it is killed."""


class Worker:
    """A process with its pipe; `job` is what it works on, None when it is free.

    `gone` is a process that closed its pipe: it takes no job any more, though it may still be alive
    for the moment between that and its end.
    """

    def __init__(self) -> None:
        context = get_context("spawn")  # a fork would copy threads that hold locks
        self.pipe, there = context.Pipe()
        self.process = context.Process(target=_serve, args=(there,), daemon=True)
        self.job: Any = None
        self.gone = False
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
        self.gone = True
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
            self.__exit__()
            raise
        return self

    def __exit__(self, *error: object) -> None:
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
                    if worker.gone or not worker.process.is_alive():
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


Work = Callable[[Job], list[Row]]

DIED = (
    "The process that computed it died: out of memory, or a crash in a library. Try this shape "
    "alone, with a larger refine or fewer samples."
)
GO_ON = "What is finished stays: start it again, and call the batch again to go on from there."
CONNECT_SECONDS = 10
PATIENCE_SECONDS = 30
"""A worker that died has started again by then; looked at only while no job ends."""


def run_jobs(
    jobs: Sequence[Job], work: Work, *, workers: int, scheduler: str | None = None
) -> Iterator[tuple[Job, list[Row]]]:
    """Yield each job with its rows, in the order in which they are finished.

    Parameters
    ----------
    jobs : sequence of Job
    work : callable
        Called with a job in a worker; must be importable there.
    workers : int
        Processes on this machine, when no scheduler is given.
    scheduler : str, optional
        Address of an existing Dask scheduler, such as "tcp://127.0.0.1:8786". Its workers must see
        the files under the same paths.

    Raises
    ------
    InvalidOptionError
        When there is a scheduler and Dask is not installed.
    FileError
        When workers cannot begin, there is no scheduler at the address, or no worker, or they went
        away.
    """
    if not jobs:
        return
    with ExitStack() as stack:
        if scheduler is None:
            hands, slots = stack.enter_context(Processes(workers)).hand_out, workers
        else:
            client, slots = stack.enter_context(cluster(scheduler))
            hands = partial(hand_out, client)
        died: list[Job] = []
        for job, rows in hands(jobs, work, slots):
            if rows is None:
                died.append(job)
            else:
                yield job, rows
        for job in died:
            tried = []
            for name, given in job.operations.items():
                alone = replace(job, operations={name: given})
                for _, rows in hands([alone], work, 1):
                    tried += [job.failed(name, DIED)] if rows is None else rows
            yield job, tried


def hand_out(
    client: Any, jobs: Sequence[J], work: Callable[[J], R], slots: int, then: str = GO_ON
) -> Iterator[tuple[J, R | None]]:
    """Yield each job with its result, or None when its worker died; `slots` at a time.

    `then` says in an error what to do.

    Raises
    ------
    FileError
        When the scheduler or all workers went away.
    """
    from concurrent.futures import CancelledError

    from distributed import KilledWorker, wait

    waiting = iter(jobs)
    running = {client.submit(work, job, pure=False): job for job in islice(waiting, slots)}
    while running:
        try:
            with client.as_current():
                finished = wait(list(running), PATIENCE_SECONDS, "FIRST_COMPLETED").done
            for future in finished:
                job = running.pop(future)
                try:
                    result = future.result()
                except KilledWorker:
                    result = None
                future.release()
                running |= {client.submit(work, new, pure=False): new for new in islice(waiting, 1)}
                yield job, result
        except TimeoutError:
            if not client.nthreads():
                raise FileError("All workers of the Dask cluster went away. " + then) from None
        except CancelledError:
            raise FileError("The Dask scheduler went away. " + then) from None


@contextmanager
def cluster(scheduler: str) -> Iterator[tuple[Any, int]]:
    """Give a Dask client and how many jobs it can run at a time; see `run_jobs` for the errors."""
    try:
        import dask
        from distributed import Client
    except ImportError as error:
        raise InvalidOptionError(
            f'A cluster needs Dask: pip install "medialis[dask]" (importing it says: {error}).'
        ) from None
    # A job whose worker died is not tried again by Dask: see the top of this file.
    settings = {"distributed.scheduler.allowed-failures": 0}
    with dask.config.set(settings), _quiet():
        try:
            client = Client(scheduler, timeout=CONNECT_SECONDS, set_as_default=False)
        except (OSError, ValueError) as error:
            raise FileError(f"Cannot reach a Dask scheduler at {scheduler}: {error}.") from None
        with client:
            slots = sum(client.nthreads().values())
            if slots == 0:
                raise FileError(f"The scheduler at {scheduler} has no worker: start one first.")
            yield client, slots


def warn_if_open(scheduler: str, progress: Progress) -> None:
    """Warn of a scheduler beyond this machine without TLS: who reaches it can run any code."""
    protocol, _, rest = scheduler.rpartition("://")
    host = rest.rpartition(":")[0].strip("[]") or rest
    local = host == "localhost" or protocol in ("inproc", "unix")
    with suppress(ValueError):  # a name
        local = local or ipaddress.ip_address(host).is_loopback
    if not local and protocol not in ("tls", "wss"):
        progress.warn(
            f"The Dask scheduler at {scheduler} is on the network and not encrypted: who reaches "
            "it runs code on its workers; use tls:// or a network that you trust.",
            "open_scheduler",
            scheduler=scheduler,
        )


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep Dask's own log to itself: what matters for a shape is in its row."""
    loggers = [logging.getLogger(n) for n in list(logging.root.manager.loggerDict)]
    levels = [(log, log.level) for log in loggers if log.name.startswith("distributed")]
    try:
        for log, _ in levels:
            log.setLevel(logging.CRITICAL)
        yield
    finally:
        for log, level in levels:
            log.setLevel(level)
