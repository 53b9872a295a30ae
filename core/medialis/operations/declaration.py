"""What an operation is: names, help, typed parameters, needs, and a function that runs it."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

from medialis.errors import InvalidOptionError
from medialis.model.shape import Shape
from medialis.operations.result import Outcome
from medialis.progress import Progress
from medialis.validation import as_choice, as_number, as_whole_number


class Kind(StrEnum):
    """Type of a parameter; hosts choose the widget by it."""

    FLOAT = "float"
    INT = "int"
    BOOL = "bool"
    CHOICE = "choice"
    LENGTH = "length"
    """Fraction of the bounding-box diagonal; hosts show per cent."""
    ANGLE = "angle"
    """Degrees; the operation converts to radians."""
    FILE = "file"
    """Path of a file to read; empty: none."""


@dataclass(frozen=True)
class Parameter:
    """One option of an operation.

    Attributes
    ----------
    name : str
        Python keyword; the command line writes it with dashes.
    kind : Kind
    default : float, int, bool or str
    label, help : str
        For people; the help is one or two sentences.
    low, high : float
        Range of numbers, both included.
    choices : tuple of str
        Values of a CHOICE.
    advanced : bool
        Hosts fold it away.
    """

    name: str
    kind: Kind
    default: Any
    label: str
    help: str
    low: float = 0.0
    high: float = 1.0
    choices: tuple[str, ...] = ()
    advanced: bool = False

    def check(self, value: Any) -> Any:
        """Return the value in its proper type.

        Raises
        ------
        InvalidOptionError
            When it is of another type or out of range.
        """
        if self.kind is Kind.CHOICE:
            return as_choice(value, self.name, self.choices)
        if self.kind is Kind.FILE:
            if not isinstance(value, str | os.PathLike):
                raise InvalidOptionError(f"{self.name} must be the path of a file, got {value!r}.")
            return os.fspath(value)
        if self.kind is Kind.BOOL:
            if not isinstance(value, bool):
                raise InvalidOptionError(f"{self.name} must be True or False, got {value!r}.")
            return value
        if self.kind is Kind.INT:
            return as_whole_number(value, self.name, low=int(self.low), high=int(self.high))
        return as_number(value, self.name, low=self.low, high=self.high)


@dataclass(frozen=True)
class Operation:
    """One algorithm as hosts see it.

    Attributes
    ----------
    name : str
        Python and, with dashes, command line name.
    filter_name : str
        MeshLab-style name, verb first.
    label, group, help : str
        Title, panel section, and description (first line: one sentence).
    source : str
        Thesis section.
    parameters : tuple of Parameter
    run : callable
        ``run(shape, parameters, progress) -> Outcome``; the shape is repaired, not refined.
    needs_faces : bool
        Hosts do not offer it for point clouds; called with one it raises a sentence.
    makes_graph : bool
        Its outcome has a graph; hosts offer the graph formats.
    """

    name: str
    filter_name: str
    label: str
    group: str
    help: str
    source: str
    parameters: tuple[Parameter, ...]
    run: Callable[[Shape, Mapping[str, Any], Progress], Outcome]
    needs_faces: bool = False
    makes_graph: bool = False

    def resolve(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """Return all parameters: the given ones checked, the others at their defaults.

        Raises
        ------
        InvalidOptionError
            For an unknown name or a bad value.
        """
        names = [p.name for p in self.parameters]
        unknown = sorted(set(given) - set(names))
        if unknown:
            raise InvalidOptionError(
                f"{self.name} has no parameter {', '.join(unknown)}; it has {', '.join(names)}."
            )
        return {p.name: p.check(given.get(p.name, p.default)) for p in self.parameters}

    def describe(self) -> dict[str, Any]:
        """Return the declaration as plain data, for JSON and for code generators."""
        return {
            "name": self.name,
            "filter_name": self.filter_name,
            "label": self.label,
            "group": self.group,
            "help": self.help,
            "source": self.source,
            "needs_faces": self.needs_faces,
            "makes_graph": self.makes_graph,
            "parameters": [{**asdict(p), "kind": p.kind.value} for p in self.parameters],
        }
