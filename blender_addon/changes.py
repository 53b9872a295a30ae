# SPDX-License-Identifier: GPL-3.0-or-later
"""All or nothing: what a block adds to the file is taken back when it fails."""

from __future__ import annotations

from collections.abc import Callable
from types import TracebackType
from typing import Any


class Changes:
    """Record of changes in a `with` block; on any exception they are undone, the last one first."""

    def __init__(self) -> None:
        self._undo: list[tuple[Callable[..., Any], tuple[Any, ...]]] = []
        self._keep: list[tuple[Callable[..., Any], tuple[Any, ...]]] = []

    def undo_by(self, function: Callable[..., Any], *arguments: Any) -> None:
        """Call this when the block fails."""
        self._undo.append((function, arguments))

    def keep_by(self, function: Callable[..., Any], *arguments: Any) -> None:
        """Call this when the block ends well."""
        self._keep.append((function, arguments))

    def __enter__(self) -> Changes:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for function, arguments in self._keep if kind is None else reversed(self._undo):
            function(*arguments)
