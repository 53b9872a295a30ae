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
from types import FrameType
from typing import Any

from medialis.cli.arguments import (
    EXIT_BAD_INPUT,
    EXIT_CANCELLED,
    EXIT_OK,
    build_parser,
    with_dashes,
)
from medialis.cli.display import clear_bar, say, shown_progress
from medialis.errors import Cancelled, FileError, InvalidShapeError, MedialisError
from medialis.operations.names import RENAMED, named_operations, renamed_note


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    _print_any_name()
    interrupts: list[int] = []
    try:
        with _ending_as_interrupt(interrupts):
            given = with_dashes(sys.argv[1:] if arguments is None else arguments)
            if given and given[0] in RENAMED:
                say(renamed_note(given[0]), file=sys.stderr)
                given[0] = RENAMED[given[0]].replace("_", "-")
            parser = build_parser(_operation, COMMANDS, chosen=given[0] if given else "")
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


def _operation(options: argparse.Namespace) -> int:
    from medialis.cli.operation_command import run_operation

    return run_operation(options)


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
        about = {"file": options.file, "format": mesh.format, "unit": mesh.unit}
        about["messages"] = messages
        say(json_text({**about, **found.as_dict(), "repaired": after}))
        return EXIT_OK
    say(f"{options.file} ({mesh.format})")
    say(found.summary())
    say(f"unit: {mesh.unit or 'not said by the file (--unit mm says it to operations)'}")
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
    from medialis.surface.samples import sample_shape

    clock = time.perf_counter()
    creature, progress = organic_shape(56), shown_progress(options.progress)
    for place, entry in enumerate(OPERATIONS):
        span = place / len(OPERATIONS), (place + 1) / len(OPERATIONS)
        with progress.stage(entry.name, *span):
            given: dict[str, Any] = {"subsample": 0.01} if entry.name == "surface_skeleton" else {}
            shape = creature if entry.sample == "creature" else sample_shape(entry.sample)
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
    from medialis.cli import meshlab_install as plugins
    from medialis.cli.machine import Machine

    machine, problems, done = Machine(), [], 0
    chosen = plugins.wanted_hosts(options.release, options.meshlab, machine)
    with plugins.built_plugins(options.plugins, machine) as built:
        for host in chosen:
            try:
                files = (
                    plugins.install(options.plugin, host.folder, machine=machine)
                    if options.plugin
                    else plugins.install_for(host, built, machine)
                )
            except FileError as error:
                problems.append(error)
                continue
            done += 1
            say(f"{host.name}: {files[0]}")
    if not done:
        raise problems[0]
    for problem in problems:
        say(problem, file=sys.stderr)
    say("Start MeshLab again: its menu Filters has the filters of medialis, search for: medial.")
    return EXIT_OK


def _demo(options: argparse.Namespace) -> int:
    from medialis.cli.operation_command import run_demo

    return run_demo(options)


def _sample(options: argparse.Namespace) -> int:
    from medialis.cli.samples import write_sample

    return write_sample(options)


def _completion(options: argparse.Namespace) -> int:
    from medialis.cli.completion import print_script

    return print_script(options)


def _view(options: argparse.Namespace) -> int:
    from medialis.cli.view_command import run_view

    return run_view(options)


COMMANDS = {
    "view": _view,
    "info": _info,
    "list": _list,
    "describe": _describe,
    "batch": _batch,
    "warmup": _warmup,
    "demo": _demo,
    "sample": _sample,
    "completion": _completion,
    "doctor": _doctor,
    "meshlab-install": _meshlab_install,
}

if __name__ == "__main__":
    sys.exit(main())
