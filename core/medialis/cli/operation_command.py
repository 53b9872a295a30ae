"""The command of an operation: one file in, one folder of results out."""

from __future__ import annotations

import argparse
import shlex
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from medialis.cli.arguments import EXIT_OK, number
from medialis.cli.display import say, shown_progress
from medialis.cli.summary import summary_lines
from medialis.errors import InvalidOptionError
from medialis.files.results import json_text
from medialis.hosts.handover import write_for_host
from medialis.operations.declaration import GRAPH_FORMATS, LAYER_FORMATS, Operation
from medialis.operations.existing_results import as_given, check_same, input_stamp
from medialis.operations.registry import operation, run
from medialis.operations.writing import Pictures, Written, write_files
from medialis.options import NUMBERS, Kind
from medialis.surface.generate import organic_shape
from medialis.surface.reading import read_shape
from medialis.threads import thread_limit
from medialis.units import as_unit
from medialis.validation import as_choice, as_whole_number
from medialis.version import package_version


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
    for name in _formats(options):
        as_choice(name, "formats", GRAPH_FORMATS + LAYER_FORMATS)
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
        shape = organic_shape() if file is None else read_shape(file, unit=unit, progress=progress)
    with progress.stage("compute", 0.1, 0.7):
        result = run(task.chosen.name, shape, threads=threads, progress=progress, **task.given)
    source = "organic shape" if file is None else file
    if task.option("host"):
        with progress.stage("output", 0.7, 1.0):
            return write_for_host(
                result, shape, task.folder, source=source, selects=options.select,
                auxiliary=options.auxiliary, draw_solid=options.solid, progress=progress,
            )  # fmt: skip
    texts = {}
    if task.option("report"):
        from medialis.reports.report import report_texts

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
