"""Progress, cancellation, messages and stage times in one object that computations pass along.

A caller gives any `callback(fraction, text)`; it is called on the calling thread, between chunks of
work, with `fraction` from 0 to 1 never decreasing. To cancel, the callback raises `Cancelled` or
returns False. Functions accept the plain callback, an existing `Progress`, or None.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from types import MappingProxyType
from typing import Any, Self

from medialis.base.errors import Cancelled

logger = logging.getLogger("medialis")
logger.addHandler(logging.NullHandler())  # silent unless the host configures a log

ProgressCallback = Callable[[float, str], "bool | None"]

CANCELLED = "Cancelled: nothing was written or changed."


class Message(str):
    """A sentence for the user that programs can read as well.

    Attributes
    ----------
    code : str
        What it is about, such as "refined": the same for every shape and in every version.
    data : dict
        The counts and measures that the sentence tells.
    level : int
        Of `logging`: INFO, or WARNING where the user may want to do something.

    Examples
    --------
    >>> message = Message("2 of 8 faces were dropped.", "dropped", faces=2, of=8)
    >>> message, message.code, message.data["faces"]
    ('2 of 8 faces were dropped.', 'dropped', 2)
    """

    code: str
    data: Mapping[str, Any]
    level: int

    def __new__(cls, text: str, code: str = "", level: int = logging.INFO, **data: Any) -> Self:
        """Make a sentence with its code and data."""
        made = super().__new__(cls, text)
        made.code, made.level, made.data = code, level, MappingProxyType(data)
        return made

    def __reduce__(self) -> tuple[Any, ...]:
        """Let messages go to other processes with all they carry."""
        return _message, (str(self), self.code, self.level, dict(self.data))


def _message(text: str, code: str, level: int, data: dict[str, Any]) -> Message:
    return Message(text, code, level, **data)


def counted(
    count: int, noun: str, *, of: int | None = None, verbs: tuple[str, str] = ("", "")
) -> str:
    """Return a count with its noun, and with the verb that agrees with it, for messages.

    Examples
    --------
    >>> counted(1, "handle"), counted(0, "handle"), counted(12000, "patch")
    ('1 handle', '0 handles', '12,000 patches')
    >>> counted(1, "ball", of=34834, verbs=("lies", "lie"))
    '1 of 34,834 balls lies'
    """
    whole = count if of is None else of
    plural = "vertices" if noun == "vertex" else f"{noun}{'es' if noun.endswith('ch') else 's'}"
    words = f"{count:,}", "" if of is None else f"of {of:,}", noun if whole == 1 else plural
    return " ".join(word for word in (*words, verbs[count != 1]) if word)


class Progress:
    """A span of a longer computation, and the record of what happened in it.

    Parameters
    ----------
    callback : callable, optional
        Called with (fraction in 0..1, text). Returning False cancels.

    Attributes
    ----------
    seconds : dict
        Seconds that each named stage took.
    messages : list of Message
        Sentences for the user: what was repaired, refined, masked. They go to the log as well.
    """

    def __init__(self, callback: ProgressCallback | None = None) -> None:
        self._callback = callback
        self._start = 0.0
        self._width = 1.0
        self._text = ""
        self._reached = 0.0
        self.seconds: dict[str, float] = {}
        self.messages: list[Message] = []

    @classmethod
    def of(cls, progress: Progress | ProgressCallback | None) -> Progress:
        """Wrap a plain callback; an existing Progress is returned as it is."""
        return progress if isinstance(progress, Progress) else cls(progress)

    def note(self, text: str, code: str = "", *, level: int = logging.INFO, **data: Any) -> None:
        """Record a sentence for the user, with its code and its counts, and log it."""
        self.record(Message(text, code, level, **data))

    def warn(self, text: str, code: str, **data: Any) -> None:
        """Record a sentence that the user may want to do something about."""
        self.note(text, code, level=logging.WARNING, **data)

    def record(self, *messages: Message) -> None:
        """Record sentences that are made already, and log them."""
        self.messages.extend(messages)
        for message in messages:
            logger.log(message.level, message)

    def update(self, fraction: float, text: str | None = None) -> None:
        """Report a fraction of the current stage.

        Raises
        ------
        Cancelled
            When the callback returns False.
        """
        if self._callback is None:
            return
        # Never backwards: nested spans can step back by a rounding error.
        overall = self._start + self._width * min(max(fraction, 0.0), 1.0)
        self._reached = min(max(overall, self._reached), 1.0)
        label = self._text if text is None else text
        if self._callback(self._reached, label) is False:
            raise Cancelled(CANCELLED)

    @property
    def unnamed(self) -> Progress:
        """What a part of this span reports to whose stages are neither named nor timed here."""
        return Progress(lambda fraction, text: self.update(fraction))

    @property
    def still(self) -> Progress:
        """What a part of this span reports to that may be cancelled but moves no bar.

        Other threads than the one that asks for it may report to it as well: they call nothing,
        and stop when it was cancelled.
        """
        owner, cancelled = threading.get_ident(), False

        def report(fraction: float, text: str) -> None:
            nonlocal cancelled
            if cancelled:
                raise Cancelled(CANCELLED)
            if threading.get_ident() != owner:
                return
            try:
                self.update(0.0)
            except BaseException:
                cancelled = True
                raise

        return Progress(report)

    @contextmanager
    def stage(self, name: str, begin: float, end: float) -> Iterator[Progress]:
        """Run a named stage that spans `begin`..`end` of the current span, and time it."""
        outer = self._start, self._width, self._text
        if outer == (0.0, 1.0, "") and begin == 0.0:
            self._reached = 0.0  # a new computation with the same object
        self._start, self._width = outer[0] + outer[1] * begin, outer[1] * (end - begin)
        self._text = name
        clock = time.perf_counter()
        try:
            self.update(0.0)
            yield self
            self.update(1.0)
        finally:
            self._start, self._width, self._text = outer
            if outer[2] != name:  # that one counts these seconds
                self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - clock
