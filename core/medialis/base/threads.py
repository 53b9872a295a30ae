"""One thread pool for all kernels: ranges of items in chunks of constant size, over nogil kernels.

Chunk sizes never depend on the thread count, and every kernel call writes only the slots of its own
range, so results are bitwise the same on 1 and on N threads. Progress and cancellation happen
between chunks, on the calling thread.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from contextvars import ContextVar, copy_context
from functools import cache
from types import FrameType
from typing import Any, TypeVar

import numpy as np

from medialis.base.progress import Progress
from medialis.base.validation import as_whole_number

T = TypeVar("T")

MOST_THREADS = 1024

PATIENCE = 0.05
"""Seconds between the reports of a thread that waits for others."""

_limit: ContextVar[int | None] = ContextVar("medialis_thread_limit", default=None)
_dropped: ContextVar[threading.Event | None] = ContextVar("medialis_dropped", default=None)


def thread_count() -> int:
    """Return how many threads kernels use now: the limit, else the processors of this process.

    See Also
    --------
    thread_limit : sets it.

    Examples
    --------
    >>> import medialis
    >>> with medialis.thread_limit(2):
    ...     medialis.thread_count()
    2
    """
    limit = _limit.get()
    if limit is not None:
        return limit
    if hasattr(os, "sched_getaffinity"):
        return max(1, len(os.sched_getaffinity(0)))
    return max(1, os.cpu_count() or 1)


@contextmanager
def thread_limit(count: int | None) -> Iterator[None]:
    """Use at most `count` threads inside the block (None: no limit), restored on the way out.

    Raises
    ------
    InvalidOptionError
        When `count` is not a whole number from 1 to 1024.

    See Also
    --------
    thread_count : how many there are.

    Examples
    --------
    >>> from medialis.base.threads import thread_count, thread_limit
    >>> with thread_limit(1):
    ...     thread_count()
    1
    """
    token = _limit.set(
        None if count is None else as_whole_number(count, "threads", low=1, high=MOST_THREADS)
    )
    try:
        yield
    finally:
        _limit.reset(token)


@contextmanager
def interrupts_held() -> Iterator[list[BaseException]]:
    """Raise what Ctrl-C and `kill` raise at the end of the block only; it gets a list of them.

    The first of the list is raised; the block may add to it. numba and Dask take locks and begin
    processes in Python: an exception in between leaves a lock taken for which other threads then
    wait for ever, or half a cluster. Signals without a handler in Python, and threads that get no
    signals, are as they were.
    """
    failures: list[BaseException] = []
    handlers = {}
    if threading.current_thread() is threading.main_thread():
        known = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
        handlers = {number: handler for number, handler in known.items() if callable(handler)}

    def note(number: int, frame: FrameType | None) -> None:
        try:
            handlers[signal.Signals(number)](number, frame)
        except BaseException as error:  # noqa: BLE001 - raised again below
            failures.append(error)

    for number in handlers:
        signal.signal(number, note)
    try:
        yield failures
    finally:
        for number, handler in handlers.items():
            if signal.getsignal(number) is note:  # else its handler chose another
                signal.signal(number, handler)
        if failures:
            raise failures[0]


class _LinearAlgebra:
    """How many threads the libraries behind numpy and scipy may use.

    They begin as many as there are processors for any product of some size, and let them turn
    round waiting for more. Of the sizes here nothing gets faster by it: on 16 processors it takes
    many times as much of them, and the last bits depend on their number.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._inside = 0
        self._libraries: Any = None
        self._limit: Any = None

    @contextmanager
    def on_one_thread(self) -> Iterator[None]:
        """Use one thread inside the block; of blocks at the same time the last one restores it."""
        with self._lock:
            self._inside += 1
            if self._inside == 1:
                self._libraries = linear_algebra(*(name in sys.modules for name in _LINKED))
                with _any_thread_sets_limits(self._libraries):
                    self._limit = self._libraries.limit(limits=1)
        try:
            yield
        finally:
            with self._lock:
                self._inside -= 1
                if self._inside == 0:
                    with _any_thread_sets_limits(self._libraries):
                        self._limit.restore_original_limits()


_LINKED = "numpy.linalg._umath_linalg", "scipy.linalg._fblas"
"""Modules that load a library of linear algebra: wheels bring one with numpy, one with scipy."""


@cache
def linear_algebra(*loaded: bool) -> Any:
    """Return the libraries that are loaded with some of `_LINKED`: looked for once, in 3 ms."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController().select(user_api="blas")


@contextmanager
def _any_thread_sets_limits(libraries: Any) -> Iterator[None]:
    """Let this thread set limits, and then others: since 3.8 only the first one may that lives."""

    def free() -> None:
        for library in libraries.lib_controllers:
            if hasattr(library, "clear_controlling_thread"):
                library.clear_controlling_thread(force=True)

    free()
    yield
    free()


_linear_algebra = _LinearAlgebra()


def run_patiently(work: Callable[[], T], progress: Progress) -> T:
    """Return `work()`, one long call that reports nothing, and let it be cancelled meanwhile.

    It runs in a thread of its own while the calling thread reports progress every 50 ms. When that
    cancels, or Ctrl-C comes, the thread ends by itself later and what it computed is dropped; so
    `work` may write to nothing that others see, and must not report progress itself. The linear
    algebra of numpy and scipy keeps to that thread. What waits in it asks `given_up`.
    """
    results: list[T] = []
    failures: list[BaseException] = []
    context, dropped = copy_context(), threading.Event()
    context.run(_dropped.set, dropped)

    def call() -> None:
        try:
            with _linear_algebra.on_one_thread():
                results.append(context.run(work))
        except BaseException as error:  # noqa: BLE001 - handed to the calling thread below
            failures.append(error)

    progress.update(0.0)
    thread = threading.Thread(target=call, daemon=True)
    thread.start()
    try:
        while thread.is_alive():
            thread.join(PATIENCE)
            progress.update(0.0)
    except BaseException:
        dropped.set()
        raise
    if failures:
        raise failures[0]
    return results[0]


def given_up() -> bool:
    """Return whether nobody waits any more for what this thread does for `run_patiently`."""
    dropped = _dropped.get()
    return dropped is not None and dropped.is_set()


def run_together(*works: Callable[[], object], progress: Progress | None = None) -> list[Any]:
    """Return what calls give that do not depend on each other, made at the same time.

    Calls that take long report to the same `progress`, which is a `Progress.still`.
    """
    results: list[Any] = [None] * len(works)

    def work(which: int, _: int) -> None:
        results[which] = works[which]()

    run_chunks(work, len(works), 1, progress=progress)
    return results


def run_chunks(
    work: Callable[..., object],
    count: int,
    chunk: int,
    *arguments: Any,
    progress: Progress | None = None,
) -> None:
    """Call `work(begin, end, *arguments)` for ranges of `chunk` items that cover 0..count.

    The calling thread works too and reports progress between its own chunks. The first exception
    (of a kernel, a cancelling progress callback, or Ctrl-C) stops all threads after the chunk they
    are in and is raised here. Where a chunk may take long, `work` is a generator: it is stopped
    between its steps as well.
    """
    starts, lock, done = iter(range(0, count, chunk)), threading.Lock(), 0

    def steps() -> Iterator[None]:
        """Take chunk after chunk: stop before each, and after each of its steps."""
        nonlocal done
        while True:
            with lock:
                begin = None if failures else next(starts, None)
                if begin is None:
                    return
                done = begin
            yield
            result = work(begin, min(begin + chunk, count), *arguments)
            if isinstance(result, Generator):
                yield from result

    def drain() -> None:
        try:
            for _ in steps():
                if failures:
                    return
        except BaseException as error:  # noqa: BLE001 - handed to the calling thread below
            failures.append(error)

    def report() -> None:
        if failures:
            raise failures[0]
        if progress is not None:
            progress.update(done / count)

    threads: list[threading.Thread] = []
    with interrupts_held() as failures:
        try:
            for _ in range(min(thread_count(), -(-count // chunk)) - 1):
                thread = threading.Thread(target=copy_context().run, args=(drain,), daemon=True)
                thread.start()
                threads.append(thread)
            for _ in steps():
                report()
            for thread in threads:
                while thread.is_alive():
                    thread.join(PATIENCE)
                    report()
        except BaseException as error:  # noqa: BLE001 - raised again, after the threads stopped
            failures.append(error)
            for thread in threads:
                thread.join()


QUERIES_A_CHUNK = 1 << 13


def nearest_rows(tree: Any, queries: Any, count: int, progress: Progress) -> Any:
    """Return the `count` points of a kd-tree that are nearest to each query, (q, count) int64.

    Not by the query's own threads: Ctrl-C leaves them running in a tree that is freed.
    """
    near = np.empty((len(queries), count), np.int64)

    def search(begin: int, end: int) -> None:
        near[begin:end] = tree.query(queries[begin:end], k=count)[1]

    run_chunks(search, len(queries), QUERIES_A_CHUNK, progress=progress)
    return near
