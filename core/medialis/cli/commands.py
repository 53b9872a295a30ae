"""The command line: what its commands do; `cli/arguments.py` says what they take.

What is long has a file of its own, which is loaded when its command runs: an operation, a batch,
a page in three dimensions, the doctor.
"""

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
from typing import Any

from medialis.base.errors import (
    Cancelled,
    FileError,
    InvalidOptionError,
    InvalidShapeError,
    MedialisError,
)
from medialis.cli.arguments import (
    EXIT_BAD_INPUT,
    EXIT_CANCELLED,
    EXIT_OK,
    add_completions,
    build_parser,
    nearest,
    with_dashes,
)
from medialis.cli.display import clear_bar, say, shown_progress
from medialis.formats.ply_attributes import write_ply
from medialis.operations.names import RENAMED, named_operations, renamed_note
from medialis.shape.samples import SAMPLES, sample_shape


def write_sample(options: argparse.Namespace) -> int:
    """Write a sample, or list them all; return the exit code."""
    name = options.name
    if name is None:
        for known, text in SAMPLES.items():
            say(f"{known:10} {text}")
        return EXIT_OK
    if name not in SAMPLES:
        raise InvalidOptionError(
            f"There is no sample {name}{nearest(name, SAMPLES) or '.'} There are "
            f"{', '.join(SAMPLES)}."
        )
    path = Path(options.output or f"{name}.ply")
    shape = sample_shape(name)
    if path.exists():
        raise FileError(f"Nothing was written: there is a file {path} already; name another.")
    write_ply(path, shape.points, faces=shape.faces)
    faces = f", {shape.face_count:,} triangles" if shape.face_count else ""
    say(f"{path}: {SAMPLES[name]} ({shape.point_count:,} points{faces})")
    return EXIT_OK


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

    from medialis.base.progress import Message, Progress
    from medialis.base.threads import run_patiently
    from medialis.formats.json_npz import json_text
    from medialis.formats.meshes import read_mesh
    from medialis.shape.diagnosis import diagnose
    from medialis.shape.repair import repair
    from medialis.shape.shape import Shape, far_points

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
    from medialis.operations.registry import OPERATIONS, run
    from medialis.shape.generate import organic_shape
    from medialis.shape.samples import sample_shape
    from medialis.show.pictures import draw_result

    clock = time.perf_counter()
    creature, progress = organic_shape(56), shown_progress(options.progress)
    for place, entry in enumerate(OPERATIONS):
        span = place / len(OPERATIONS), (place + 1) / len(OPERATIONS)
        with progress.stage(entry.name, *span):
            given: dict[str, Any] = {"subsample": 0.01} if entry.name == "surface_skeleton" else {}
            shape = creature if entry.sample == "creature" else sample_shape(entry.sample)
            result = run(entry.name, shape, progress=progress, **given)
            draw_result(result, width=320, height=240)
    from medialis.base.cache_folder import kernel_cache, mark_compiled

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
    try:
        from medialis_meshlab_plugin.install import install_wanted
    except ModuleNotFoundError as error:
        if not (error.name or "").startswith("medialis_meshlab_plugin"):
            raise
        raise FileError(
            "The plugin of MeshLab is a package of its own: pip install medialis-meshlab, then run "
            "medialis meshlab-install."
        ) from None
    wanted = options.plugins, options.plugin, options.release, options.meshlab
    done, problems = install_wanted(*wanted)
    for name, file in done.items():
        say(f"{name}: {file}")
    for problem in problems:
        say(problem, file=sys.stderr)
    say("Start MeshLab again: its menu Filters has the filters of medialis, search for: medial.")
    return EXIT_OK


def _demo(options: argparse.Namespace) -> int:
    from medialis.cli.operation_command import run_demo

    return run_demo(options)


def _completion(options: argparse.Namespace) -> int:
    """Print the script that a shell reads."""
    try:
        import shtab
    except ImportError as error:
        raise InvalidOptionError(
            'Completion needs shtab: pip install "medialis[completion]" (importing it says: '
            f"{error})."
        ) from None
    parser = build_parser(_operation, COMMANDS, every=True)
    add_completions(parser, shtab.FILE, {"sample": SAMPLES})
    say(shtab.complete(parser, options.shell).removesuffix("\n"))
    return EXIT_OK


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
    "sample": write_sample,
    "completion": _completion,
    "doctor": _doctor,
    "meshlab-install": _meshlab_install,
}

if __name__ == "__main__":
    sys.exit(main())
