"""What was computed is kept with what it was computed from, and found again.

Data of the core never change: a `Shape` owns its arrays, and what is computed from it refers to it.
So a result follows from its input and its options alone, and the second operation on a shape, or
the same one with another late option, finds the refined surface, the balls and the importance
there. A shape is known by its content: hosts make a new object of the same arrays for each run and
find the same results; one moved vertex makes another shape.

One memory serves the process. It is bounded (`memory_limit`): what was not used for longest goes
first. Results are the same bits with and without, and so are the messages.
"""

from __future__ import annotations

import itertools
import os
import sys
import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from medialis.base.arrays import Described
from medialis.base.validation import as_whole_number

if TYPE_CHECKING:
    from medialis.base.progress import Message, Progress

Found = TypeVar("Found")

DEFAULT_LIMIT = 1 << 30
"""Bytes: all stages of a shape of a million samples, or of some twenty of 50,000."""

LIMIT_VARIABLE = "MEDIALIS_KEPT_BYTES"

LARGE = 1 << 28
"""Bytes of a result, with what it refers to, from which on memory freed on the way to it goes back
to the system: that of half a million samples. The C library of Linux keeps it by threads, and of a
million samples a quarter of all memory was of no use to anybody."""

_numbers = itertools.count()


class Bound(Described):
    """What results can be kept with: it has an identity that equal input shares.

    A subclass that is input, as `Shape`, answers by its content; everything computed by its number.
    """

    @property
    def identity(self) -> Hashable:
        """What results of this object are found by."""
        known = self.__dict__.get("_identity")
        if known is None:
            # setdefault: two threads that ask at once get the same number.
            known = self.__dict__.setdefault("_identity", next(_numbers))
        return known

    def __getstate__(self) -> dict[str, Any]:
        """Leave out what another process has no use for: numbers, and what can be computed."""
        names = [f.name for f in fields(self)] if is_dataclass(self) else list(self.__dict__)
        return {name: self.__dict__[name] for name in names if name in self.__dict__}


class _Memory:
    """Results by what they follow from, the one used last at the end."""

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self._lock = threading.RLock()
        self._entries: OrderedDict[Hashable, tuple[Any, tuple[Message, ...]]] = OrderedDict()
        self._estimate = 0
        """Bytes that were counted last, and those of all that came since, shared ones again."""

    def find(self, key: Hashable) -> tuple[Any, tuple[Message, ...]] | None:
        with self._lock:
            entry = self._entries.get(key)
            if entry is not None:
                self._entries.move_to_end(key)
            return entry

    def store(self, key: Hashable, value: Any, messages: tuple[Message, ...]) -> None:
        size = _lock_arrays(value)
        if size >= LARGE:
            give_back()
        with self._lock:
            self._entries[key] = value, messages
            self._entries.move_to_end(key)
            self._estimate += size
            # What results refer to may have grown as well: half the limit is left to that.
            if self._estimate <= self.limit // 2:
                return
        self.shrink()

    def shrink(self) -> None:
        """Forget what was not used for longest until the rest fits the limit."""
        with self._lock:
            # What an entry refers to is there as long as the entry is, so it counts with it: from
            # the newest on, each array once.
            seen: set[int] = set()
            total, fitting = 0, 0
            for value, _ in reversed(self._entries.values()):
                total += sum(array.nbytes for array in _arrays(value, seen))
                if total > self.limit:
                    break
                fitting += 1
            for _ in range(len(self._entries) - fitting):
                self._entries.popitem(last=False)
            self._estimate = min(total, self.limit)

    def forget(self) -> None:
        with self._lock:
            self._entries.clear()
            self._estimate = 0

    def size(self) -> int:
        with self._lock:
            seen: set[int] = set()
            values = [value for value, _ in self._entries.values()]
            return sum(array.nbytes for value in values for array in _arrays(value, seen))


def _first_limit() -> int:
    text = os.environ.get(LIMIT_VARIABLE, "")
    return int(text) if text.isascii() and text.isdigit() else DEFAULT_LIMIT


_memory = _Memory(_first_limit())


def kept(
    compute: Callable[..., Any],
    data: Any,
    options: Hashable,
    work: Callable[[], Found],
    progress: Progress,
) -> Found:
    """Return the result of `work`, computed now or found; its messages are recorded either way.

    Parameters
    ----------
    compute : callable
        Which computation it is.
    data : Bound
        What it is computed from; the result of anything else is not kept.
    options : hashable
        All else that the result follows from.
    work : callable
        Computes the result.
    progress : Progress
    """
    if _memory.limit == 0 or not isinstance(data, Bound):
        return work()
    key = (compute.__module__, compute.__qualname__), data.identity, type(options), options
    entry = _memory.find(key)
    if entry is not None:
        value, messages = entry
        progress.messages.extend(messages)
        return value
    before = len(progress.messages)
    result = work()
    _memory.store(key, result, tuple(progress.messages[before:]))
    return result


@contextmanager
def memory_limit(size: int) -> Iterator[None]:
    """Keep at most `size` bytes of results inside the block; 0 keeps none.

    The environment variable MEDIALIS_KEPT_BYTES sets the limit of a whole process (1 GiB).

    Raises
    ------
    InvalidOptionError
        When `size` is not a whole number of bytes.

    See Also
    --------
    kept_bytes : how much is kept.
    forget : keeps nothing of it.

    Examples
    --------
    >>> import medialis
    >>> with medialis.memory_limit(0):
    ...     cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    """
    checked = as_whole_number(size, "size", low=0, high=2**62)
    before, _memory.limit = _memory.limit, checked
    try:
        _memory.shrink()
        yield
    finally:
        _memory.limit = before


def forget() -> None:
    """Forget all kept results, and give their memory back.

    See Also
    --------
    memory_limit : how much is kept.
    kept_bytes : how much is kept now.

    Examples
    --------
    >>> import medialis
    >>> medialis.forget()
    >>> medialis.kept_bytes()
    0
    """
    _memory.forget()


def room() -> int:
    """Return how many bytes of results may be kept."""
    return _memory.limit


def kept_bytes() -> int:
    """Return the bytes that kept results take now, with what they refer to.

    See Also
    --------
    memory_limit : how much may be kept.
    forget : keeps nothing of it.

    Examples
    --------
    >>> import medialis
    >>> medialis.forget()
    >>> with medialis.memory_limit(1 << 30):
    ...     cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    ...     medialis.kept_bytes() > 0
    True
    """
    return _memory.size()


def _arrays(value: Any, seen: set[int]) -> Iterator[np.ndarray[Any, Any]]:
    """Arrays that a result holds or refers to, each once."""
    waiting = [value]
    while waiting:
        one = waiting.pop()
        if id(one) in seen or one is None or isinstance(one, str | int | float | bool | type):
            continue
        seen.add(id(one))
        if isinstance(one, np.ndarray):
            if one.base is None:
                yield one
            elif isinstance(one.base, np.ndarray):
                waiting.append(one.base)
        elif isinstance(one, dict):
            waiting.extend(one.values())
        elif isinstance(one, list | tuple | set | frozenset):
            waiting.extend(one)
        elif hasattr(one, "__dict__") and not callable(one):
            waiting.extend(vars(one).values())


def give_back() -> None:
    """Let the C library give memory that is free back to the system, where it has a call for it."""
    from ctypes import CDLL

    if sys.platform == "linux" and hasattr(library := CDLL(None), "malloc_trim"):
        library.malloc_trim(0)


def _lock_arrays(value: Any) -> int:
    """Make the arrays of a result read-only, and return their bytes.

    Whoever writes into one would change later results.
    """
    size = 0
    for array in _arrays(value, set()):
        array.flags.writeable = False
        size += array.nbytes
    return size
