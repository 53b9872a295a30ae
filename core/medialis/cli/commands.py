"""The command line: what its commands do (`cli/arguments.py` says what they take)."""

from __future__ import annotations

import argparse
import io
import json
import logging
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

from medialis.cli.arguments import (
    EXIT_BAD_INPUT,
    EXIT_CANCELLED,
    EXIT_OK,
    build_parser,
    number,
    with_dashes,
)
from medialis.cli.display import clear_bar, say, shown_progress
from medialis.errors import Cancelled, InvalidShapeError, MedialisError
from medialis.operations.names import named_operations

if TYPE_CHECKING:
    from medialis.operations.declaration import Operation


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    _print_any_name()
    interrupts: list[int] = []
    try:
        with _ending_as_interrupt(interrupts):
            given = with_dashes(sys.argv[1:] if arguments is None else arguments)
            parser = build_parser(_run_operation, COMMANDS, chosen=given[0] if given else "")
            options = parser.parse_args(given)
            _configure_log(options)
            code: int = options.command(options)
            sys.stdout.flush()
            return code
    except (Exception, KeyboardInterrupt) as error:  # noqa: BLE001 - raised again if unknown
        # An import that is interrupted may raise anything.
        return _ended_by(Cancelled() if interrupts else error)


def _ended_by(error: BaseException) -> int:
    """Say in one line why the program ends; return its exit code."""
    clear_bar()
    code, line = EXIT_BAD_INPUT, ""
    if isinstance(error, KeyboardInterrupt | Cancelled):
        code, line = EXIT_CANCELLED, "cancelled, nothing was written."
    elif isinstance(error, BrokenPipeError):  # the reader went away: `medialis list | head -1`
        _drop_output()
        return EXIT_OK
    elif isinstance(error, MedialisError):
        line = " ".join(str(error).split())
    elif isinstance(error, ImportError):  # numba is loaded by the first computation
        line = f"a package cannot be loaded: {error}; see medialis doctor."
    elif isinstance(error, MemoryError):
        line = "not enough memory for this shape and these options."
    elif isinstance(error, OSError):  # all other files are FileErrors: this is our own output
        line = f"cannot print the output: {error.strerror or error}."
        _drop_output()
    else:
        raise error
    say(f"medialis: {line}", file=sys.stderr)
    return code


def _print_any_name() -> None:
    """Let file names in any script pass through a stream that cannot encode them."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors="backslashreplace")


@contextmanager
def _ending_as_interrupt(interrupts: list[int]) -> Iterator[None]:
    """Let a request to end (`kill`, a host that cancels) clean up as Ctrl-C does, and note both."""

    def stop(number: int, frame: FrameType | None) -> None:
        interrupts.append(number)
        signal.signal(number, signal.SIG_IGN)  # a second one must not disturb the cleaning
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():  # others may set no handler
        yield
        return
    before = {
        number: signal.signal(number, stop)
        for number in (signal.SIGINT, signal.SIGTERM)
        if signal.getsignal(number) is not signal.SIG_IGN  # as in the background of a shell
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _drop_output() -> None:
    """Send what is still buffered to nowhere, so that Python does not fail on it at its end."""
    with suppress(OSError):  # a stream that is no file
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _configure_log(options: argparse.Namespace) -> None:
    level = logging.INFO if getattr(options, "verbose", False) else logging.ERROR
    logging.basicConfig(level=level, format="%(message)s", stream=sys.stderr)


def _run_operation(options: argparse.Namespace) -> int:
    from medialis.operations.writing import GRAPH_FORMATS
    from medialis.options import NUMBERS, Kind
    from medialis.units import as_unit
    from medialis.validation import as_choice, as_whole_number

    chosen: Operation = options.operation
    given = {}
    for parameter in chosen.parameters:
        value = getattr(options, f"parameter_{parameter.name}")
        as_text = parameter.kind not in NUMBERS or (
            parameter.kind is Kind.LENGTH and not options.host
        )
        if value is not None:  # hosts give lengths as fractions, people with their units
            given[parameter.name] = value if as_text else number(value)
    chosen.resolve(given)  # bad options are reported before the file is read
    as_unit(options.unit)
    as_whole_number(options.turntable, "turntable", low=0, high=10_000)
    for name in _formats(options):
        as_choice(name, "formats", GRAPH_FORMATS)
    output = options.output or Path(options.file).stem + "-medialis"
    manifest = _compute(chosen.name, options.file, output, given, options)
    if not options.host:  # a host reads the manifest from the folder
        _report(manifest, options)
    return EXIT_OK


def _formats(options: argparse.Namespace) -> tuple[str, ...]:
    """Return the graph formats to write, each once."""
    return tuple(dict.fromkeys(filter(None, getattr(options, "formats", "").split(","))))


def _compute(
    name: str, file: str | None, output: str, given: dict[str, Any], options: argparse.Namespace
) -> dict[str, Any]:
    from medialis.hosts.handover import write_for_host
    from medialis.operations.registry import run
    from medialis.operations.writing import Pictures, write_result
    from medialis.surface.generate import organic_shape
    from medialis.surface.reading import read_shape
    from medialis.threads import thread_limit

    clock = time.perf_counter()
    threads = getattr(options, "threads", None)
    progress = shown_progress(options.progress)
    with progress.stage("input", 0.0, 0.1):
        unit = getattr(options, "unit", None)
        shape = organic_shape() if file is None else read_shape(file, unit=unit, progress=progress)
    with progress.stage("compute", 0.1, 0.7):
        result = run(name, shape, threads=threads, progress=progress, **given)
    source = "organic shape" if file is None else file
    if getattr(options, "host", False):
        with progress.stage("output", 0.7, 1.0):
            return write_for_host(
                result, shape, output, source=source, auxiliary=options.auxiliary, progress=progress
            )
    texts = None
    if getattr(options, "report", False):
        from medialis.reports.report import report_texts

        with progress.stage("report", 0.7, 0.85), thread_limit(threads):
            texts = report_texts(result, source=file, progress=progress)
    with progress.stage("output", 0.85, 1.0), thread_limit(threads):
        manifest = write_result(
            result,
            output,
            source=source,
            pictures=Pictures(
                main=not getattr(options, "no_picture", False),
                color_by=getattr(options, "color_by", None),
                turntable=getattr(options, "turntable", 0),
            ),
            texts=texts,
            formats=_formats(options),
            progress=progress,
        )
    manifest["seconds"] = {**progress.seconds, "total": time.perf_counter() - clock}
    return manifest


def _report(manifest: dict[str, Any], options: argparse.Namespace) -> None:
    from medialis.files.results import json_text
    from medialis.operations.result import value_lines

    if getattr(options, "json", False):
        say(json_text(manifest))
        return
    say(f"{manifest['operation'].replace('_', ' ')} of {manifest['input']}")
    for line in value_lines(manifest["values"]):
        say(line)
    for message, about in zip(manifest["messages"], manifest["notes"], strict=True):
        say(f"{'warning' if about['warning'] else 'note'}: {message}")
    say(f"{manifest['seconds']['total']:.2f} seconds")
    for file in manifest["files"]:
        if file != manifest["picture"]:
            say(file)
    if manifest["picture"]:
        say(manifest["picture"])


def _info(options: argparse.Namespace) -> int:
    import numpy as np

    from medialis.files.meshes import read_mesh
    from medialis.files.results import json_text
    from medialis.model.shape import Shape
    from medialis.progress import Message, Progress
    from medialis.surface.diagnosis import diagnose
    from medialis.surface.far_points import far_points
    from medialis.surface.repair import repair
    from medialis.threads import run_patiently

    progress, repaired = Progress(), None
    mesh = run_patiently(lambda: read_mesh(options.file), progress)
    found = run_patiently(lambda: diagnose(mesh.points, mesh.faces), progress)
    messages = list(mesh.messages)
    try:
        fixed = run_patiently(lambda: repair(mesh.points, mesh.faces), progress)
        messages += fixed.messages
        repaired = found
        if fixed.messages:
            repaired = run_patiently(lambda: diagnose(fixed.points, fixed.faces), progress)
        without_normals = np.zeros_like(fixed.points)
        messages += filter(None, [far_points(Shape(fixed.points, without_normals, fixed.faces))])
    except InvalidShapeError as error:  # nothing is left: the diagnosis tells why
        messages.append(Message(f"Operations will refuse it: {error}", "refused"))
    if options.json:
        after = None if repaired is None else repaired.as_dict()
        about = {"file": options.file, "format": mesh.format, "messages": messages}
        say(json_text({**about, **found.as_dict(), "repaired": after}))
        return EXIT_OK
    say(f"{options.file} ({mesh.format})")
    say(found.summary())
    for message in messages:
        say(f"note: {message}")
    if repaired is not None and repaired != found:
        say(f"as operations see it:\n{repaired.summary()}")
    return EXIT_OK


def _list(options: argparse.Namespace) -> int:
    for named in named_operations():
        say(f"{named.command:24} {named.first_line}")
    return EXIT_OK


def _describe(options: argparse.Namespace) -> int:
    from medialis.operations.registry import OPERATIONS, operation

    chosen = [operation(options.operation)] if options.operation else list(OPERATIONS)
    if options.json:
        say(json.dumps([entry.describe() for entry in chosen], indent=2, allow_nan=False))
        return EXIT_OK
    for entry in chosen:
        names = [entry.label, f"MeshLab: {entry.filter_name}", *filter(None, [entry.source])]
        say(f"{entry.name} ({'; '.join(names)})")
        say(entry.help)
        for parameter in entry.parameters:
            kind = parameter.kind.value
            if parameter.choices:
                kind = " | ".join(parameter.choices)
            say(f"  {parameter.name} [{kind}, default {parameter.default}]: {parameter.help}")
    return EXIT_OK


def _warmup(options: argparse.Namespace) -> int:
    from medialis.operations.pictures import draw_result
    from medialis.operations.registry import OPERATIONS, run
    from medialis.surface.generate import organic_shape

    clock = time.perf_counter()
    shape, progress = organic_shape(56), shown_progress(options.progress)
    for place, entry in enumerate(OPERATIONS):
        span = place / len(OPERATIONS), (place + 1) / len(OPERATIONS)
        with progress.stage(entry.name, *span):
            given: dict[str, Any] = {"subsample": 0.01} if entry.name == "surface_skeleton" else {}
            result = run(entry.name, shape, progress=progress, **given)
            draw_result(result, width=320, height=240)
    from medialis._kernels.cache_folder import kernel_cache, mark_compiled

    mark_compiled()
    say(f"Kernels ready in {time.perf_counter() - clock:.1f} s; cache: {kernel_cache()}")
    return EXIT_OK


def _batch(options: argparse.Namespace) -> int:
    from medialis.cli.batch_command import run_batch

    return run_batch(options)


def _doctor(options: argparse.Namespace) -> int:
    from medialis.cli.doctor import as_data, as_text, examine

    findings = examine()
    say(json.dumps(as_data(findings), indent=2) if options.json else as_text(findings))
    return EXIT_BAD_INPUT if any(f.state == "broken" for f in findings) else EXIT_OK


def _meshlab_install(options: argparse.Namespace) -> int:
    from medialis.cli.meshlab_install import find_built, install

    for path in install(options.plugin or find_built(), folder=options.meshlab):
        say(path)
    say("Start MeshLab again: its menu Filters has the filters of medialis.")
    return EXIT_OK


def _demo(options: argparse.Namespace) -> int:
    for file in [None] if options.file is None else [None, options.file]:
        folder = Path(options.output) / ("organic_shape" if file is None else Path(file).stem)
        _report(_compute("surface_skeleton", file, str(folder), {}, options), options)
    return EXIT_OK


COMMANDS = {
    "info": _info,
    "list": _list,
    "describe": _describe,
    "batch": _batch,
    "warmup": _warmup,
    "demo": _demo,
    "doctor": _doctor,
    "meshlab-install": _meshlab_install,
}

if __name__ == "__main__":
    sys.exit(main())
