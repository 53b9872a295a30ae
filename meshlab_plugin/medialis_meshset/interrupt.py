# SPDX-License-Identifier: GPL-3.0-or-later
"""Ctrl-C while a MeshSet changes: held back until stopping leaves nothing half done."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


class Interrupt:
    """Whether Ctrl-C was pressed since `interrupts_held` began."""

    def __init__(self) -> None:
        self.pending = False

    def deliver(self) -> None:
        """Raise what was held back: here is a point where stopping can be undone.

        Raises
        ------
        KeyboardInterrupt
        """
        if self.pending:
            self.pending = False
            raise KeyboardInterrupt


@contextmanager
def interrupts_held() -> Iterator[Interrupt]:
    """Hold Ctrl-C back inside the block and raise it at its end, if it ends well.

    Only the main thread receives it, and only a handler that Python knows can be put back.
    """
    interrupt = Interrupt()
    if threading.current_thread() is not threading.main_thread():
        yield interrupt
        return
    before = signal.getsignal(signal.SIGINT)
    if before is None:
        yield interrupt
        return

    def remember(number: int, frame: object) -> None:
        interrupt.pending = True

    signal.signal(signal.SIGINT, remember)
    try:
        yield interrupt
    finally:
        signal.signal(signal.SIGINT, before)
    interrupt.deliver()
