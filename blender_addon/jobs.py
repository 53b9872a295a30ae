# SPDX-License-Identifier: GPL-3.0-or-later
"""Computing in a process of its own, one thing at a time; Blender's main thread looks at it."""

from __future__ import annotations

import atexit
from collections.abc import Callable, Mapping
from typing import Any

from medialis import Result, Shape
from medialis.hosts import Computer

from . import folders, preferences, views
from .reading import Source

running: Job | None = None
"""The job in progress; one at a time."""

_computer: Computer | None = None


def computer() -> Computer:
    """Return the process that computes; it is started by its first job, and stays."""
    global _computer
    if _computer is None:
        _computer = Computer(folders.exchange(), folders.kernel_environment())
        atexit.register(stop)  # for scripts that have called functions and registered nothing
    return _computer


class Job:
    """One computation for an object; it is the running job until `close`.

    Attributes
    ----------
    name : str
        Operation.
    label : str
        For people.
    source : Source
    """

    def __init__(
        self,
        source: Source,
        name: str,
        parameters: Mapping[str, Any],
        label: str,
        *,
        gpu_views: bool = False,
    ) -> None:
        global running
        self.source = source
        self.name = name
        self.label = label
        self._computation = computer().run(
            name,
            source.points,
            source.faces,
            parameters,
            render=views.renderer if gpu_views else None,
            threads=preferences.threads(),
            device=preferences.device(),
            unit=source.unit,
        )
        running = self

    @property
    def fraction(self) -> float:
        """How far it is."""
        return self._computation.fraction

    @property
    def text(self) -> str:
        """What it does."""
        return self._computation.text

    def look(self) -> bool:
        """Take in what the process told, render what it needs; return whether it is done."""
        return self._computation.look()

    def wait(self, report: Callable[[float, str], object] | None = None) -> None:
        """Look until it is done."""
        self._computation.wait(report)

    def cancel(self) -> None:
        """Stop it; asking again does nothing."""
        self._computation.cancel()

    def outcome(self) -> tuple[Shape, Result]:
        """Return shape and result.

        Raises
        ------
        MedialisError
            What the computation raised; `Cancelled` when it was cancelled.
        """
        return self._computation.outcome()


def busy() -> str:
    """Return why nothing else can start while a job is running."""
    return f"{running.label} is being computed: wait for it, or press Esc"


def close() -> None:
    """Forget the running job, if there is one; what is not done is cancelled."""
    global running
    if running is not None:
        running.cancel()
    running = None


def stop() -> None:
    """Close the running job, and end the process."""
    global _computer
    close()
    atexit.unregister(stop)
    if _computer is not None:
        _computer.end()
        _computer = None
    folders.remove_exchange()
