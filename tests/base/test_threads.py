"""The thread pool: every range once, errors and cancelling stop all threads."""

import math
import signal
import threading
import time

import numpy as np
import pytest

from medialis.base.errors import Cancelled, InvalidOptionError
from medialis.base.progress import Progress
from medialis.base.threads import (
    interrupts_held,
    linear_algebra,
    run_chunks,
    run_patiently,
    run_together,
    thread_count,
    thread_limit,
)


def test_limit_holds_inside_the_block_only():
    before = thread_count()
    assert before >= 1
    with thread_limit(3):
        assert thread_count() == 3
        with thread_limit(1):
            assert thread_count() == 1
        with thread_limit(None):
            assert thread_count() == before
        assert thread_count() == 3
    assert thread_count() == before
    with pytest.raises(RuntimeError), thread_limit(2):
        raise RuntimeError
    assert thread_count() == before


@pytest.mark.parametrize(
    "count", [0, -1, 1.5, True, "2", "abc", math.nan, math.inf, [1], 1j, 10**400, 10**6]
)
def test_bad_limits(count):
    """Text, NaN and lists came out as ValueError, OverflowError or TypeError (fixed)."""
    with pytest.raises(InvalidOptionError, match="threads"), thread_limit(count):
        pass


@pytest.mark.parametrize("count", [2, 2.0, np.int64(2)])
def test_whole_numbers_of_any_type(count):
    with thread_limit(count):
        assert thread_count() == 2 and type(thread_count()) is int


@pytest.mark.parametrize("threads", [1, 2, 7])
@pytest.mark.parametrize(("count", "chunk"), [(0, 4), (1, 4), (4, 4), (5, 4), (1000, 7)])
def test_ranges_cover_all_items_once(threads, count, chunk):
    spans = []
    with thread_limit(threads):
        run_chunks(lambda begin, end: spans.append((begin, end)), count, chunk)
    assert sorted(spans) == [(b, min(b + chunk, count)) for b in range(0, count, chunk)]


def test_several_threads_work_at_once():
    """Both ranges wait for each other: one thread alone would never pass the barrier."""
    barrier = threading.Barrier(2)
    with thread_limit(2):
        run_chunks(lambda begin, end: barrier.wait(timeout=20), 2, 1)


def test_progress_rises_on_the_calling_thread():
    seen, callers = [], set()

    def note(fraction, text):
        seen.append(fraction)
        callers.add(threading.get_ident())

    with thread_limit(2):
        run_chunks(lambda begin, end: None, 500, 1, progress=Progress(note))
    assert seen == sorted(seen) and all(0 <= fraction < 1 for fraction in seen)
    assert callers <= {threading.get_ident()}


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_first_error_stops_the_work(threads, error):
    done, before = [], threading.active_count()  # earlier tests may have left threads of Dask

    def work(begin, end):
        if begin == 10:
            raise error("in range 10")
        done.append(begin)

    with thread_limit(threads), pytest.raises(error, match="range 10"):
        run_chunks(work, 100_000, 1)
    assert len(done) < 100_000
    assert threading.active_count() <= before


@pytest.mark.parametrize("threads", [1, 2])
def test_cancelling_stops_the_work(threads):
    done, before = [], threading.active_count()
    progress = Progress(lambda fraction, text: len(done) < 50)
    with thread_limit(threads), pytest.raises(Cancelled):
        run_chunks(lambda begin, end: done.append(begin), 1_000_000, 1, progress=progress)
    assert len(done) < 1_000_000
    count = len(done)
    assert threading.active_count() <= before and len(done) == count


def test_one_long_call_can_be_cancelled_and_hands_on_what_it_returns_and_raises():
    """Skin weights of 134,000 vertices could not be cancelled for four seconds."""
    assert run_patiently(lambda: 7, Progress()) == 7
    with thread_limit(3):
        assert run_patiently(thread_count, Progress()) == 3
    with pytest.raises(ZeroDivisionError):
        run_patiently(lambda: 1 / 0, Progress())
    begin = time.perf_counter()
    with pytest.raises(Cancelled):
        run_patiently(lambda: time.sleep(2), Progress(lambda fraction, text: False))
    assert time.perf_counter() - begin < 1.0


@pytest.mark.parametrize("threads", [1, 2])
def test_a_chunk_of_steps_is_stopped_between_them(threads):
    """A band of large balls took nine seconds, in which nothing could be cancelled."""
    done, before = [], threading.active_count()

    def work(begin, end):
        for step in range(100_000):
            done.append((begin, step))
            yield

    progress = Progress(lambda fraction, text: len(done) < 50)
    with thread_limit(threads), pytest.raises(Cancelled):
        run_chunks(work, threads, 1, progress=progress)
    assert len(done) < 100_000 * threads
    assert threading.active_count() <= before


def test_steps_are_all_done_and_reported():
    done, told = [], []

    def work(begin, end):
        for step in range(10):
            done.append((begin, step))
            yield

    with thread_limit(1):
        run_chunks(work, 3, 1, progress=Progress(lambda fraction, text: told.append(fraction)))
    assert done == [(chunk, step) for chunk in range(3) for step in range(10)]
    assert len(told) >= len(done)


def test_waiting_for_the_other_threads_can_be_cancelled():
    """The calling thread, done with its own chunks, was silent until the last one ended."""
    stopped, first = threading.Event(), []

    def work(begin, end):
        first.append(threading.get_ident())
        if threading.current_thread() is not threading.main_thread():
            assert stopped.wait(timeout=20)  # ends when the calling thread has reported anew
        else:
            while len(first) < 2:
                time.sleep(0.001)

    def tell(fraction, text):
        if len(first) == 2:
            stopped.set()

    with thread_limit(2):
        run_chunks(work, 2, 1, progress=Progress(tell))
    assert stopped.is_set()


def test_what_is_still_moves_no_bar_and_cancels():
    seen = []
    progress = Progress(lambda fraction, text: seen.append((fraction, text)))
    with progress.stage("views", 0.5, 1.0):
        with progress.still.stage("of others", 0.0, 1.0) as still:
            still.update(0.7)
        progress.update(0.2)
    assert seen == [(0.5, "views")] * 4 + [(0.6, "views"), (1.0, "views")]
    with pytest.raises(Cancelled):
        Progress(lambda fraction, text: False).still.update(0.0)


@pytest.mark.parametrize("failure", [None, OSError("of the host")])
def test_calls_at_the_same_time_are_cancelled_together(failure):
    """The callback is called on the calling thread alone; the other one stops when it cancels."""
    callers, ended, both = [], [], threading.Barrier(2)

    def tell(fraction, text):
        callers.append(threading.current_thread())
        if len(callers) < 5:
            return True
        if failure is not None:
            raise failure
        return False

    still = Progress(tell).still

    def work():
        both.wait(timeout=20)
        try:
            for _ in range(20_000):  # 20 s at least
                still.update(0.5)
                time.sleep(0.001)
        except BaseException as error:
            ended.append((threading.current_thread(), type(error)))
            raise

    with thread_limit(2), pytest.raises(Cancelled if failure is None else OSError):
        run_together(work, work, progress=still)
    assert set(callers) == {threading.main_thread()}
    assert len(ended) == 2
    own = dict(ended)[threading.main_thread()]
    assert own is (Cancelled if failure is None else OSError)
    assert Cancelled in dict(ended).values()


def test_a_call_goes_on_while_the_callback_works():
    """It was taken for cancelled as long as a slow callback had not returned (fixed)."""
    told, ended = threading.Event(), threading.Event()

    def tell(fraction, text):
        told.set()
        return ended.wait(timeout=20)

    still = Progress(tell).still

    def work():
        if threading.current_thread() is threading.main_thread():
            still.update(0.5)
        else:
            assert told.wait(timeout=20)
            for _ in range(100):
                still.update(0.5)
            ended.set()

    with thread_limit(2):
        run_together(work, work, progress=still)
    assert ended.is_set()


def test_calls_at_the_same_time_keep_their_order():
    for threads in (1, 2, 5):
        with thread_limit(threads):
            assert run_together(*(lambda k=k: k * k for k in range(7))) == [
                0, 1, 4, 9, 16, 25, 36
            ]  # fmt: skip


@pytest.mark.parametrize("threads", [1, 2])
def test_an_interrupt_ends_no_chunk_in_its_middle(threads):
    """Ctrl-C within numba, which takes locks in Python when it loads a kernel, left them taken: the
    other threads waited for ever, and so did a cancelled run (fixed)."""
    lock, taken, raised = threading.Lock(), [], threading.Event()

    def work(begin, end):
        main = threading.current_thread() is threading.main_thread()
        if not main:  # on a busy machine it took all chunks before the main thread had one
            raised.wait(timeout=10)
        taken.append(lock.acquire(timeout=10))
        if main:
            signal.raise_signal(signal.SIGINT)
            raised.set()
        time.sleep(0.001)
        lock.release()

    before = signal.getsignal(signal.SIGINT)
    with thread_limit(threads), pytest.raises(KeyboardInterrupt):
        run_chunks(work, 100, 1)
    assert all(taken) and len(taken) < 100 and not lock.locked()
    assert signal.getsignal(signal.SIGINT) is before


def test_a_handler_of_signals_that_raises_nothing_ends_nothing():
    told = []
    before = signal.signal(signal.SIGINT, lambda number, frame: told.append(number))
    try:
        with thread_limit(2):
            run_chunks(lambda a, b: a == 3 and signal.raise_signal(signal.SIGINT), 10, 1)
        assert told == [signal.SIGINT]
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_handler_that_chooses_another_keeps_it():
    """So does that of the command line: a second Ctrl-C must not disturb the cleaning."""

    def once(number, frame):
        signal.signal(number, signal.SIG_IGN)
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, once)
    try:
        with pytest.raises(KeyboardInterrupt), interrupts_held() as failures:
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGINT)
            assert len(failures) == 1
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_linear_algebra_keeps_to_the_thread_of_long_work():
    """Its libraries have their threads again when the last of several works is done.

    With threadpoolctl 3.8 limits that the main thread had set kept all others from it (fixed).
    """
    import scipy.linalg  # noqa: F401 - its library is one of them

    libraries = linear_algebra(True, True)

    def counts():
        return [library["num_threads"] for library in libraries.info()]

    assert min(counts()) >= 1
    given = libraries.limit(limits=2)
    try:
        before, inside, begun, go_on = counts(), [], threading.Event(), threading.Event()

        def waiting():
            begun.set()
            go_on.wait(10)
            inside.append(counts())

        other = threading.Thread(target=lambda: run_patiently(waiting, Progress()))
        other.start()
        begun.wait(10)
        run_patiently(lambda: inside.append(counts()), Progress())
        go_on.set()
        other.join()
        assert inside == [[1] * len(before)] * 2
        assert counts() == before
        with pytest.raises(ZeroDivisionError):
            run_patiently(lambda: 1 / 0, Progress())
        assert counts() == before
    finally:
        given.restore_original_limits()
