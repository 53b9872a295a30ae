# SPDX-License-Identifier: GPL-3.0-or-later
"""Computing in a background thread; Blender's data are touched by the main thread only."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from typing import Any

from medialis import Progress, Result, Shape, ViewSource, make_shape, run, view_source

from . import views
from .reading import Source

SERVICE = 0.05
"""Seconds that one look at a job may spend on rendering views for it."""

running: Job | None = None
"""The job in progress; one at a time."""


def compute(
    source: Source,
    name: str,
    parameters: Mapping[str, Any],
    progress: Progress,
    factory: Callable[[Shape], ViewSource] | None = None,
) -> tuple[Shape, Result]:
    """Repair what was read and run an operation on it; `factory` renders views, if there are any.

    Raises
    ------
    MedialisError
        As `medialis.run`.
    """
    with progress.stage("input", 0.0, 0.1):
        shape = make_shape(source.points, source.faces, repair=True, progress=progress)
    rendered = nullcontext() if factory is None else view_source(factory)
    with rendered, progress.stage("compute", 0.1, 1.0):
        return shape, run(name, shape, progress=progress, **parameters)


class Job:
    """One computation in a thread of its own.

    Attributes
    ----------
    label : str
        For people.
    fraction, text : float, str
        How far it is.
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
        self.source = source
        self.label = label
        self.fraction, self.text = 0.0, "starting"
        self._cancelled = threading.Event()
        self._progress = Progress(self._report)
        self._desk: views.ViewDesk | None = None
        if gpu_views:
            self._desk = views.ViewDesk(self._progress.note, self._cancelled.is_set)
        self._found: tuple[Shape, Result] | None = None
        self._error: BaseException | None = None
        self._thread = threading.Thread(
            target=self._work, args=(name, dict(parameters)), name="medialis", daemon=True
        )

    def start(self) -> None:
        """Begin; this is the running job until it is `close`d."""
        global running
        running = self
        self._thread.start()

    def cancel(self) -> None:
        """Ask it to stop at the next chunk of work; asking again does nothing."""
        self._cancelled.set()
        self.text = "cancelling"

    def serve(self) -> None:
        """Render the views that it waits for; on the main thread, now and then."""
        if self._desk is not None:
            self._desk.serve(SERVICE)

    def close(self) -> None:
        """Forget it; it is not the running one any more."""
        global running
        if self._desk is not None:
            self._desk.close()
        if running is self:
            running = None

    @property
    def done(self) -> bool:
        """Whether `outcome` has something to tell."""
        return not self._thread.is_alive()

    def wait(self, seconds: float | None = None) -> None:
        """Wait until it is done."""
        self._thread.join(seconds)

    def outcome(self) -> tuple[Shape, Result]:
        """Return shape and result.

        Raises
        ------
        MedialisError
            What the computation raised; `Cancelled` when it was cancelled.
        """
        if self._error is not None:
            raise self._error
        assert self._found is not None
        return self._found

    def _work(self, name: str, parameters: dict[str, Any]) -> None:
        try:
            factory = None if self._desk is None else self._desk.factory
            self._found = compute(self.source, name, parameters, self._progress, factory)
        except BaseException as error:  # noqa: BLE001 - it is raised again on the main thread
            self._error = error

    def _report(self, fraction: float, text: str) -> bool:
        if self._cancelled.is_set():
            return False
        self.fraction, self.text = fraction, text
        return True


def stop() -> None:
    """Cancel the running job, if there is one, and wait a moment for its end."""
    if running is not None:
        running.cancel()
        running.wait(2.0)
        running.close()
