"""What a person sees of a running command: a bar on a terminal, lines in a log or for programs."""

from __future__ import annotations

import os
import sys
import time
from typing import TextIO

from medialis.base.progress import Progress, ProgressCallback

STYLES = ("auto", "bar", "log", "lines", "none")
BAR_WIDTH, BAR_SECONDS = 30, 0.05
LOG_SECONDS = 10.0
"""A log gets a line this often at most, and the last one."""


def shown_progress(style: str, *, batch: bool = False) -> Progress:
    """Return a `Progress` that writes to stderr.

    Parameters
    ----------
    style : str
        One of `STYLES`; "auto" is a bar on a terminal, and elsewhere a log for a batch, which may
        take hours, and nothing for a single run.
    batch : bool
        Tell the time left: all shapes are taken to need about the same.
    """
    if style == "auto":
        style = "bar" if sys.stderr.isatty() else "log" if batch else "none"
    if style == "none":
        return Progress()
    left = TimeLeft() if batch else None
    callback: dict[str, ProgressCallback] = {"bar": Bar(left), "log": Log(left), "lines": Lines()}
    return Progress(callback[style])


class TimeLeft:
    """Estimate the rest from the time that this run has taken for its part."""

    def __init__(self) -> None:
        self._first: tuple[float, float] | None = None

    def __call__(self, fraction: float, now: float) -> str:
        """Return such as "3 min left, ", or nothing as long as nothing is known."""
        if self._first is None:
            self._first = now, fraction
        start, before = self._first
        if fraction <= before or fraction >= 1.0:
            return ""
        return f"{duration((now - start) * (1.0 - fraction) / (fraction - before))} left, "


def duration(seconds: float) -> str:
    """Return a time in words, as exact as an estimate is.

    Examples
    --------
    >>> duration(8.2), duration(200), duration(10000)
    ('9 s', '4 min', '2 h 47 min')
    """
    if seconds < 100:
        return f"{int(seconds) + 1} s"
    minutes = int(seconds / 60) + 1
    return f"{minutes} min" if minutes < 100 else f"{minutes // 60} h {minutes % 60} min"


class Lines:
    """One line for each 0.5 %, for programs."""

    def __init__(self) -> None:
        self._last = -1.0

    def __call__(self, fraction: float, text: str) -> None:
        """Print a line."""
        if fraction - self._last >= 0.005:
            self._last = fraction
            _write(f"PROGRESS {fraction:.4f} {text}\n")


class Log:
    """A line now and then, for people who read it later."""

    def __init__(self, left: TimeLeft | None) -> None:
        self._left, self._last = left, -LOG_SECONDS

    def __call__(self, fraction: float, text: str) -> None:
        """Print a line when it is time."""
        now = time.monotonic()
        left = self._left(fraction, now) if self._left else ""
        if fraction >= 1.0 or now - self._last >= LOG_SECONDS:
            self._last = now
            _write(f"{100 * fraction:3.0f} % {left}{text}\n")


class Bar:
    """A bar that fills, in one line as wide as the terminal; it vanishes at the end."""

    def __init__(self, left: TimeLeft | None) -> None:
        self._left, self._last = left, -1.0

    def __call__(self, fraction: float, text: str) -> None:
        """Draw the bar anew."""
        now = time.monotonic()
        left = self._left(fraction, now) if self._left else ""
        if fraction < 1.0 and now - self._last < BAR_SECONDS:
            return
        self._last = now
        room = _columns() - 1
        full = int(BAR_WIDTH * fraction)
        bar = f"{'#' * full}{'.' * (BAR_WIDTH - full)} {100 * fraction:3.0f} % {left}{text}"
        line = bar if fraction < 1.0 else ""
        end = "" if fraction < 1.0 else "\r"
        _write(f"\r{line:<{room}.{room}}{end}")


def clear_bar() -> None:
    """Make room for a sentence where a bar may have been left."""
    if sys.stderr.isatty():
        _write("\r" + " " * (_columns() - 1) + "\r")


def _write(text: str) -> None:
    sys.stderr.write(text)
    sys.stderr.flush()


def _columns() -> int:
    try:
        return max(20, os.get_terminal_size(sys.stderr.fileno()).columns)
    except (OSError, ValueError):  # no terminal
        return 80


def say(text: object = "", *, file: TextIO | None = None) -> None:
    """Print text; control characters, as in the name of a file, are shown and do nothing."""
    safe = (c if c.isprintable() or c in "\n\t" else repr(c)[1:-1] for c in str(text))
    print("".join(safe), file=file)
