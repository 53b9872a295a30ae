"""One computation of a `Computer`, as a host looks at it."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from medialis.errors import Cancelled, MedialisError
from medialis.hosts.parcels import unpack
from medialis.model.shape import Shape
from medialis.model.view import OrthographicCamera, ViewSource
from medialis.operations.result import Result
from medialis.validation import FloatArray, IntArray

if TYPE_CHECKING:
    from medialis.hosts.computing import Computer

SERVICE = 0.05
"""Seconds that one look may spend on rendering views."""
PATIENCE = 0.02
"""Seconds between two looks while waiting."""

Renderer = Callable[[FloatArray, IntArray], ViewSource | str]
"""Makes the view source of triangles; a sentence where the host cannot render."""


class Computation:
    """One computation of a `Computer`.

    Attributes
    ----------
    fraction, text : float, str
        How far it is.
    done : bool
        Whether `outcome` has something to tell.
    """

    def __init__(self, computer: Computer, render: Renderer | None) -> None:
        self.fraction, self.text, self.done = 0.0, "starting", False
        self._computer = computer
        self._render = render
        self._source: ViewSource | None = None
        self._found: tuple[Shape, Result] | None = None
        self._error: Exception | None = None

    def look(self, seconds: float = SERVICE) -> bool:
        """Take in what the process told, and render what it asked for; return whether it is done.

        Parameters
        ----------
        seconds : float
            While views are asked for, look again for so long.
        """
        end = time.monotonic() + seconds
        wait = 0.0
        while not self.done:
            word, *content = self._computer.hear(wait) or ("nothing",)
            if word == "nothing":
                return False
            wait = self._take_in(word, content, max(end - time.monotonic(), 0.0))
        return True

    def wait(self, report: Callable[[float, str], object] | None = None) -> None:
        """Look until it is done; `report` hears the progress. Ctrl-C cancels it."""
        try:
            while not self.look():
                if report is not None:
                    report(self.fraction, self.text)
                self._computer.listen(PATIENCE)
        except BaseException:
            self.cancel()
            raise

    def cancel(self) -> None:
        """End it now; the process stops at its next chunk of work and is there for the next one."""
        if not self.done:
            self._end(Cancelled("Cancelled: nothing was written or changed."))
            self._computer.cancel()

    def outcome(self) -> tuple[Shape, Result]:
        """Return the repaired shape, and the result without what no host shows.

        Raises
        ------
        MedialisError
            What the computation raised; `Cancelled` when it was cancelled.
        """
        if self._error is not None:
            raise self._error
        if self._found is None:
            raise RuntimeError("The computation is not done.")
        return self._found

    def _take_in(self, word: str, content: Sequence[Any], left: float) -> float:
        """Take one word in; return how long the next may be waited for."""
        if word == "progress":
            self.fraction, self.text = content
        elif word == "ask":
            self._computer.answer(self._answer(unpack(content[0])))
            return left
        else:
            error = content[0] if word == "failed" else None
            if word == "done":
                try:
                    self._found = unpack(content[0])
                except MedialisError as failure:
                    error = failure
            self._end(error)
        return 0.0

    def _answer(self, question: Any) -> Any:
        """Make the view source of triangles, or render views of it."""
        assert self._render is not None
        try:
            if isinstance(question, list):
                cameras: list[OrthographicCamera] = question
                return self._source(cameras) if self._source else []
            made = self._render(*question)
            self._source = None if isinstance(made, str) else made
            return made if isinstance(made, str) else None
        except Exception as error:  # noqa: BLE001 - drivers raise anything; the computation tells
            return MedialisError(f"The views could not be rendered: {error}")

    def _end(self, error: Exception | None) -> None:
        self._error, self.done, self._render, self._source = error, True, None, None
        if error is None:
            self.fraction = 1.0
