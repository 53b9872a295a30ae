"""What an operation is: names, help, its class of options, needs, and a function that runs it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import Described
from medialis.base.errors import InvalidOptionError, no_option
from medialis.base.options import Kind, Options, Parameter
from medialis.base.progress import Progress
from medialis.operations.names import LAST
from medialis.operations.result import Outcome, Result
from medialis.shape.shape import Shape

__all__ = ["Format", "Kind", "Operation", "Parameter", "Selection"]

THESIS = (
    "J. Kustra: Medial Descriptors for 3D Shape Segmentation, Reconstruction and Analysis. "
    "PhD thesis, University of Groningen, 2015"
)


@dataclass(frozen=True, repr=False)
class Selection(Described):
    """Another use of an operation, for hosts whose users select vertices: it tells which.

    Attributes
    ----------
    filter_name, help : str
        As those of the operation.
    chosen : callable
        ``chosen(result, shape) -> (n,) bool``: the vertices of the shape that are selected.
    defaults : dict
        Of options that have another one here.
    """

    filter_name: str
    help: str
    chosen: Callable[[Result, Shape], NDArray[np.bool_]]
    defaults: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, repr=False)
class Format(Described):
    """A kind of file that a feature brings, besides those of every layer and its arrays.

    Attributes
    ----------
    name : str
        What `formats` calls it, and how its files end.
    write : callable
        ``write(path, result)``; of layers ``write(path, layer, unit)``.
    of : str
        Which one of `Outcome.extras` it holds; empty: those layers that name it in
        `Layer.formats`.
    read : callable or None
        ``read(path)`` gives that extra output back.
    unasked : bool
        Always written.
    by_default : bool
        Written unless users choose other formats.
    beside : bool
        It has more files: ``write(path, result, new)``, where ``new(name)`` is the path of another.
    """

    name: str
    write: Callable[..., object]
    of: str = ""
    read: Callable[[Path], Any] | None = None
    unasked: bool = False
    by_default: bool = True
    beside: bool = False


@dataclass(frozen=True, repr=False)
class Operation(Described):
    """One algorithm as hosts see it.

    Attributes
    ----------
    name : str
        Python and, with dashes, command line name.
    filter_name : str
        MeshLab-style name, verb first.
    label, group, help : str
        Title, panel section, and description (first line: one sentence).
    options : type of Options
        Its fields are the parameters.
    run : callable
        ``run(shape, options, progress) -> Outcome``; the shape is repaired, not refined.
    source : str or None
        Section of the thesis; None for what the thesis does not have.
    order : float
        Where hosts list it: the lowest first.
    needs_faces : bool
        Hosts do not offer it for point clouds; called with one it raises a sentence.
    needs_normals : bool
        Whether it uses the normals of point clouds; if not, messages about them are hidden.
    formats : tuple of Format
        Kinds of files of its own.
    makes_images : bool
        Its result is pictures; hosts without a place for them leave it out.
    thin_lines : bool
        It adds curves, or marks places: hosts offer to draw them as solids (`hosts.drawing.solid`).
    lies_on_shape : bool
        What it adds lies on the surface: hosts leave the shape visible.
    selection : Selection or None
    checks : bool
        Its values say whether the shape has `passed`, and the `verdict` in a sentence.
    examples : tuple of (str, str)
        What may follow its name on the command line, on shapes of `medialis sample`, and what it
        is for.
    sample : str
        The shape of `medialis sample` that it is tried on: one that it has a result for.
    words : tuple of str
        What people type who look for it, where its label has other words.
    layers : dict of str
        What each of its layers is, by their names; some may be missing in a result.
    """

    name: str
    filter_name: str
    label: str
    group: str
    help: str
    options: type[Options]
    run: Callable[[Shape, Any, Progress], Outcome]
    source: str | None = None
    order: float = LAST
    needs_faces: bool = False
    needs_normals: bool = True
    formats: tuple[Format, ...] = ()
    makes_images: bool = False
    thin_lines: bool = False
    lies_on_shape: bool = False
    selection: Selection | None = None
    checks: bool = False
    examples: tuple[tuple[str, str], ...] = ()
    sample: str = "creature"
    words: tuple[str, ...] = ()
    layers: Mapping[str, str] = field(default_factory=dict)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """What is known of each option, in the order in which hosts show them."""
        return self.options.parameters()

    @property
    def offered(self) -> tuple[str, ...]:
        """Names of its own formats that users choose from."""
        return tuple(one.name for one in self.formats if one.of and not one.unasked)

    @property
    def default_formats(self) -> tuple[str, ...]:
        """Names of those that are written where users choose none."""
        default = {one.name for one in self.formats if one.by_default}
        return tuple(name for name in self.offered if name in default)

    @property
    def full_help(self) -> str:
        """The help, and where in the thesis it is from."""
        if not self.source:
            return self.help
        section = self.source.removeprefix("thesis ")
        return f"{self.help}\n\nSee: {THESIS}, section {section}."

    def resolve(self, given: Mapping[str, Any]) -> Options:
        """Return all options: the given ones checked, the others at their defaults.

        Raises
        ------
        InvalidOptionError
            For an unknown name or a bad value.
        """
        names = [p.name for p in self.parameters]
        unknown = sorted(set(given) - set(names))
        if unknown:
            raise InvalidOptionError(no_option(self.name, unknown, names))
        return self.options(**given)

    def describe(self) -> dict[str, Any]:
        """Return the declaration as plain data, for JSON and for code generators."""
        plain = "name", "filter_name", "label", "group", "help", "source", "needs_faces"
        return {
            **{name: getattr(self, name) for name in plain},
            "words": list(self.words),
            "formats": list(self.offered),
            "default_formats": list(self.default_formats),
            "parameters": [{**asdict(p), "kind": p.kind.value} for p in self.parameters],
        }
