"""The command of an operation: one file in, one folder of results out, and one screen about them.

`run_operation` checks what was asked for before anything is read; `summary_lines` prints what the
manifest of a result tells: numbers, places, messages and files.
"""

from __future__ import annotations

import argparse
import shlex
import shutil
import sys
import textwrap
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from medialis.base.cache_folder import package_version
from medialis.base.errors import InvalidOptionError
from medialis.base.options import NUMBERS, Kind
from medialis.base.threads import thread_limit
from medialis.base.units import as_unit
from medialis.base.validation import as_whole_number
from medialis.cli.arguments import EXIT_OK, number
from medialis.cli.display import say, shown_progress
from medialis.formats.json_npz import json_text
from medialis.operations.declaration import Operation
from medialis.operations.registry import operation, run
from medialis.operations.result import value_rows, value_text
from medialis.shape.reading import read_shape
from medialis.show.writing import (
    Pictures,
    Written,
    as_given,
    check_same,
    chosen_formats,
    input_stamp,
    write_files,
)

MOST_ROWS = 5
"""Of all tables of places together; the manifest has them all."""

TABLES = {
    "spots": ("thin spots", ("value", "area")),
    "regions": ("regions", ("value", "area")),
    "ribs": ("ribs", ("ratio", "thickness", "wall")),
}
"""Title and columns of the tables of places, by the name of the value."""

WIDEST, NARROWEST = 100, 60

FILES = {
    "manifest.json": "all numbers, options and messages, for programs",
    "report.html": "how good the result is, a page for the browser",
    "report.json": "the same for programs",
    ".npz": "all arrays, for numpy.load",
    ".png": "picture",
    ".vtp": "the same as the PLY file of that name, for ParaView",
    ".vtu": "the same as the PLY file of that name, for ParaView and solvers",
    "midsurface.obj": "the sheets, for modelling programs",
    "midsurface.glb": "the sheets, for programs that show glTF",
    "medial_mesh_envelope.obj": "the same, for modelling programs",
    "medial_mesh_envelope.glb": "the same, for programs that show glTF",
    "ball_cover.json": "their centers and radii, for programs",
    "ball_cover.urdf": "a link with them as collision elements, for robot simulators",
    ".msh": "the triangles with their values, for Gmsh",
    ".inp": "shell elements with their thickness, for Abaqus",
    ".ccx.inp": "shell elements with their thickness, for CalculiX",
    ".ma": "the balls with their edges and triangles, for programs for medial meshes",
    ".swc": "the graph as a tree, for tools that read neurons",
    ".graphml": "the graph, for tools that read networks",
    ".json": "the graph with all that it holds",
    ".obj": "the graph as lines, for modelling programs",
    ".glb": "the shape with its bones and skin weights, for animation programs",
    ".html": "the result to turn round, for the browser",
}
"""What a file is for, by its name or its ending."""


def summary_lines(manifest: Mapping[str, Any], width: int | None = None) -> Iterator[str]:
    """Yield what there is to say of a result, from its manifest."""
    columns = width or _columns()
    values, unit = manifest["values"], manifest["unit"]
    yield f"{manifest['operation'].replace('_', ' ')} of {manifest['input']}"
    known = {name: value for name, value in values.items() if value is not None}
    yield from _indented(_aligned(value_rows(known, unit)))
    tables = [name for name in TABLES if values.get(name)]
    for name in tables:
        most = MOST_ROWS // len(tables)
        yield from _indented(_table(*TABLES[name], values[name], most, unit))
    for message, about in zip(manifest["messages"], manifest["notes"], strict=True):
        text = f"{'warning' if about['warning'] else 'note'}: {message}"
        yield from textwrap.wrap(text, columns, subsequent_indent="  ", break_long_words=False)
    folder = Path(manifest["files"][0]).parent
    yield f"{len(manifest['files'])} files in {folder}, {manifest['seconds']['total']:.1f} seconds:"
    yield from _indented(_shortened(_aligned(_files(manifest)), columns - 2))


def _columns() -> int:
    """Return how wide lines may be; what goes on to a program or a file stays in one line."""
    if not sys.stdout.isatty():
        return sys.maxsize
    return min(max(shutil.get_terminal_size().columns, NARROWEST), WIDEST)


def file_meanings(manifest: Mapping[str, Any]) -> dict[str, str]:
    """Return what each file of a result is for, by its name, the picture first."""
    layers = operation(manifest["operation"]).layers
    names = [Path(file).name for file in manifest["files"]]
    picture = Path(manifest["picture"] or "").name
    found = {name: _meaning(name, layers) for name in sorted(names, key=lambda n: n != picture)}
    if any(layer["role"] == "bones" for layer in manifest["layers"]):
        found = {name: text.replace("the graph", "the bones") for name, text in found.items()}
    return found


def _files(manifest: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Give names and meanings; many pictures of a turntable are one line."""
    views = [name for name in file_meanings(manifest) if name.startswith("turntable_")]
    for name, meaning in file_meanings(manifest).items():
        if name not in views:
            yield name, meaning
        elif name == views[0]:
            yield f"{views[0]} ...", f"{len(views)} views all round"


def _meaning(name: str, layers: Mapping[str, str]) -> str:
    """Return what a file is for."""
    path = Path(name)
    if path.suffix == ".ply":
        return layers.get(path.stem, "")
    known = (name, "".join(path.suffixes), path.suffix)
    return next((FILES[one] for one in known if one in FILES), "")


def _table(
    title: str,
    columns: Sequence[str],
    things: Sequence[Mapping[str, Any]],
    most: int,
    unit: str | None,
) -> list[str]:
    """Return the first of some places as a table: number, what, values, where."""
    rows = [
        (
            str(number),
            thing["kind"],
            *("" if thing[c] is None else value_text(c, thing[c], unit) for c in columns),
            ", ".join(f"{x:.4g}" for x in thing["position"]),
        )
        for number, thing in enumerate(things[:most])
    ]
    left = len(things) - len(rows)
    more = [f"{left} more in manifest.json"] if left else []
    return _aligned([("", title, *columns, "position"), *rows]) + more


def _aligned(rows: Iterator[tuple[str, ...]] | Sequence[tuple[str, ...]]) -> list[str]:
    """Return rows of texts as lines with columns of equal width."""
    table = list(rows)
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    return [
        "  ".join(f"{text:<{width}}" for text, width in zip(row, widths, strict=True)).rstrip()
        for row in table
    ]


def _shortened(lines: Sequence[str], columns: int) -> Iterator[str]:
    return (line if len(line) <= columns else line[: columns - 3] + "..." for line in lines)


def _indented(lines: Sequence[str] | Iterator[str]) -> Iterator[str]:
    return (f"  {line}" for line in lines)


@dataclass(frozen=True)
class Task:
    """What a command was asked for.

    Attributes
    ----------
    chosen : Operation
    file : str or None
        None: the built-in shape.
    folder : path
        Of the results.
    given : dict
        Parameters, lengths as text.
    options : argparse.Namespace
        All else.
    """

    chosen: Operation
    file: str | None
    folder: Path
    options: argparse.Namespace
    given: dict[str, Any] = field(default_factory=dict)

    def option(self, name: str, otherwise: Any = None) -> Any:
        """Return an option that not every command has."""
        return getattr(self.options, name, otherwise)

    @property
    def about(self) -> dict[str, Any]:
        """What tells the result from others, as its manifest will have it."""
        try:
            here = None if self.file is None else input_stamp(self.file)
        except (OSError, ValueError):  # reading tells what is wrong
            here = None
        return {
            "operation": self.chosen.name,
            "medialis": package_version(),
            "parameters": as_given(self.chosen.resolve(self.given)),
            "input_stamp": here,
            "input_unit": as_unit(self.option("unit")),
        }


def run_operation(options: argparse.Namespace) -> int:
    """Run an operation on a file and return the exit code."""
    chosen: Operation = options.operation
    file = _only_file(options, chosen.name.replace("_", "-"))
    as_whole_number(options.turntable, "turntable", low=0, high=10_000)
    chosen_formats(chosen.name, _formats(options))
    # One folder an operation: the next one on the same file leaves it alone.
    folder = options.output or Path(f"{Path(file).stem}-medialis", chosen.name)
    task = Task(chosen, file, Path(folder), options, _given(chosen, options))
    about = task.about  # bad options are reported before the file is read
    if not options.overwrite and not options.host:
        check_same(task.folder, about)
    manifest = _compute(task, about)
    if not options.host:  # a host reads the manifest from the folder
        _report(manifest, options.json)
    return EXIT_OK


def run_demo(options: argparse.Namespace) -> int:
    """Run the first operation on the built-in shape, and on a file; its folder is its own."""
    chosen = operation("surface_skeleton")
    options.overwrite = True
    for file in [None] if options.file is None else [None, options.file]:
        folder = Path(options.output) / ("organic_shape" if file is None else Path(file).stem)
        task = Task(chosen, file, folder, options)
        manifest = _compute(task, task.about)
        _report(manifest, False)
        say(manifest["picture"])  # last, as `make demo` says
    return EXIT_OK


def _only_file(options: argparse.Namespace, command: str) -> str:
    """Return the one file, or say that a batch takes folders and several files."""
    files: Sequence[str] = options.file
    if len(files) == 1 and not Path(files[0]).is_dir():
        return files[0]
    what = f"{len(files)} files" if len(files) > 1 else f"the folder {files[0]}"
    words = " ".join(map(shlex.quote, files))
    raise InvalidOptionError(
        f"{command} takes one file, got {what}. For many: medialis batch {command} {words}"
    )


def _given(chosen: Operation, options: argparse.Namespace) -> dict[str, Any]:
    """Return the parameters that were typed, and what is another default of a selection."""
    given: dict[str, Any] = {}
    if options.select and chosen.selection is not None:
        given |= chosen.selection.defaults
    for parameter in chosen.parameters:
        value = getattr(options, f"parameter_{parameter.name}")
        if value is not None:
            plain = parameter.kind in NUMBERS and parameter.kind is not Kind.LENGTH
            given[parameter.name] = number(value) if plain else value
    return given


def _formats(options: argparse.Namespace) -> tuple[str, ...]:
    """Return the formats to write besides PLY, each once."""
    return tuple(dict.fromkeys(filter(None, getattr(options, "formats", "").split(","))))


def _compute(task: Task, about: dict[str, Any]) -> dict[str, Any]:
    """Read, compute and write; return the manifest."""
    clock, options = time.perf_counter(), task.options
    threads, file = task.option("threads"), task.file
    progress = shown_progress(options.progress)
    with progress.stage("input", 0.0, 0.1):
        unit = about["input_unit"]
        if file is None:
            from medialis.shape.generate import organic_shape

            shape = organic_shape()
        else:
            shape = read_shape(file, unit=unit, progress=progress)
    with progress.stage("compute", 0.1, 0.7):
        result = run(task.chosen.name, shape, threads=threads, progress=progress, **task.given)
    source = "organic shape" if file is None else file
    if task.option("host"):
        from medialis.hosts.menu import write_for_host

        with progress.stage("output", 0.7, 1.0):
            return write_for_host(
                result, shape, task.folder, source=source, selects=options.select,
                auxiliary=options.auxiliary, draw_solid=options.solid, progress=progress,
            )  # fmt: skip
    texts = {}
    if task.option("report"):
        from medialis.show.reports.report import report_texts

        with progress.stage("report", 0.7, 0.85), thread_limit(threads):
            texts = report_texts(result, source=file, progress=progress)
    pictures = Pictures(
        main=not task.option("no_picture"),
        color_by=task.option("color_by"),
        turntable=task.option("turntable", 0),
    )
    record = {name: about[name] for name in ("input_stamp", "input_unit")}
    wanted = Written(source, pictures, _formats(options), texts, record, options.overwrite)
    with progress.stage("output", 0.85, 1.0), thread_limit(threads):
        manifest = write_files(result, task.folder, wanted, progress)
    manifest["seconds"] = {**progress.seconds, "total": time.perf_counter() - clock}
    return manifest


def _report(manifest: dict[str, Any], as_json: bool) -> None:
    if as_json:
        say(json_text(manifest))
        return
    for line in summary_lines(manifest):
        say(line)
