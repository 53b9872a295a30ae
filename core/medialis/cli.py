"""The command line: one subcommand for each operation, generated from the registry."""

from __future__ import annotations

import argparse
import io
import json
import logging
import math
import os
import sys
import time
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from medialis.errors import Cancelled, InvalidOptionError, InvalidShapeError, MedialisError
from medialis.operations.declaration import Kind, Operation, Parameter
from medialis.operations.registry import OPERATIONS, operation, run
from medialis.progress import Progress
from medialis.validation import as_whole_number

EXIT_OK, EXIT_BAD_INPUT, EXIT_CANCELLED = 0, 2, 130
NUMBERS = (Kind.FLOAT, Kind.INT, Kind.LENGTH)

_EPILOG = """exit codes: 0 done; 2 bad input or options (one line on stderr); 130 cancelled.
Lengths are fractions of the bounding-box diagonal: 0.01 is 1 % of the size of the shape."""


class _Parser(argparse.ArgumentParser):
    """argparse that reports errors as one line, like every other error of the program."""

    def error(self, message: str) -> Any:
        raise InvalidOptionError(f"{message} (see {self.prog} --help)")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    _print_any_name()
    try:
        options = _parser().parse_args(arguments)
        _configure_log(options)
        code: int = options.command(options)
        sys.stdout.flush()
        return code
    except (KeyboardInterrupt, Cancelled):
        print("medialis: cancelled, nothing was written.", file=sys.stderr)
        return EXIT_CANCELLED
    except BrokenPipeError:  # the reader of our output went away, as in `medialis list | head -1`
        _drop_output()
        return EXIT_OK
    except MedialisError as error:
        print(f"medialis: {' '.join(str(error).split())}", file=sys.stderr)
        return EXIT_BAD_INPUT
    except MemoryError:
        print("medialis: not enough memory for this shape and these options.", file=sys.stderr)
        return EXIT_BAD_INPUT
    except OSError as error:  # all other files are FileErrors: this is our own output
        print(f"medialis: cannot print the output: {error.strerror or error}.", file=sys.stderr)
        _drop_output()
        return EXIT_BAD_INPUT


def _print_any_name() -> None:
    """Let file names in any script pass through a stream that cannot encode them."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors="backslashreplace")


def _drop_output() -> None:
    """Send what is still buffered to nowhere, so that Python does not fail on it at its end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="medialis",
        description="Medial descriptors of 3D shapes: skeletons, thickness, parts.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"medialis {version('medialis')}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for chosen in OPERATIONS:
        _add_operation(commands, chosen)

    def add(name: str, help_text: str, command: Callable[[Any], int]) -> argparse.ArgumentParser:
        sub = commands.add_parser(name, help=help_text, description=help_text)
        sub.set_defaults(command=command, verbose=False)
        return sub

    info = add("info", "Diagnose a mesh or point cloud file, before and after repair.", _info)
    info.add_argument("file", help="PLY, OBJ, OFF, STL or point text; more with the extra io")
    info.add_argument("--json", action="store_true", help="print one JSON object")
    add("list", "List all operations.", _list)
    describe = add("describe", "Describe operations and their parameters.", _describe)
    describe.add_argument("operation", nargs="?", help="one operation; all when missing")
    describe.add_argument("--json", action="store_true", help="print JSON (for programs)")
    warmup = add("warmup", "Compile all kernels now, so that the first run is fast.", _warmup)
    _add_progress(warmup)
    demo = add("demo", "Compute the surface skeleton of a built-in shape, and of yours.", _demo)
    demo.add_argument("file", nargs="?", help="a mesh or point cloud of your own")
    demo.add_argument("-o", "--output", default="medialis-demo", help="output folder")
    _add_progress(demo)
    return parser


def _add_operation(commands: Any, chosen: Operation) -> None:
    first = chosen.help.splitlines()[0]
    sub = commands.add_parser(
        chosen.name.replace("_", "-"),
        help=first,
        description=f"{chosen.help}\n\nSource: {chosen.source}.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    sub.add_argument("file", help="PLY, OBJ, OFF, STL or point text; more with the extra io")
    sub.add_argument(
        "-o", "--output", help="output folder (default: FILE's name + -medialis, here)"
    )
    group = sub.add_argument_group("parameters")
    for parameter in chosen.parameters:
        _add_parameter(group, parameter)
    sub.add_argument("--threads", type=int, help="use at most this many threads")
    sub.add_argument("--json", action="store_true", help="print the manifest as one JSON object")
    sub.add_argument("--no-picture", action="store_true", help="write no picture")
    sub.add_argument("--color-by", metavar="ATTRIBUTE", help="colour the picture by this attribute")
    sub.add_argument(
        "--turntable", type=int, default=0, metavar="N", help="also draw N views all round"
    )
    _add_progress(sub)
    sub.set_defaults(command=_run_operation, operation=chosen)


def _add_parameter(group: Any, parameter: Parameter) -> None:
    flag = "--" + parameter.name.replace("_", "-")
    text = f"{parameter.help} (default: {parameter.default})".replace("%", "%%")
    if parameter.kind is Kind.BOOL:
        group.add_argument(
            flag,
            dest=f"parameter_{parameter.name}",
            action=argparse.BooleanOptionalAction,
            default=parameter.default,
            help=text,
        )
        return
    metavar = {Kind.INT: "N", Kind.LENGTH: "FRACTION", Kind.FLOAT: "NUMBER"}.get(parameter.kind)
    if parameter.kind is Kind.CHOICE:
        metavar = "{" + ",".join(parameter.choices) + "}"
    group.add_argument(flag, dest=f"parameter_{parameter.name}", metavar=metavar, help=text)


def _add_progress(sub: argparse.ArgumentParser) -> None:
    sub.add_argument(
        "--progress",
        choices=("auto", "bar", "lines", "none"),
        default="auto",
        help="bar for people, lines 'PROGRESS fraction text' for programs, both on stderr; auto: a "
        "bar on a terminal",
    )
    sub.add_argument("-v", "--verbose", action="store_true", help="log what is done on stderr")


def _configure_log(options: argparse.Namespace) -> None:
    level = logging.INFO if getattr(options, "verbose", False) else logging.ERROR
    logging.basicConfig(level=level, format="%(message)s", stream=sys.stderr)


def _progress(options: argparse.Namespace) -> Progress:
    style = options.progress
    if style == "auto":
        style = "bar" if sys.stderr.isatty() else "none"
    if style == "none":
        return Progress()
    last = [-1.0]

    def report(fraction: float, text: str) -> None:
        now = time.monotonic()
        if style == "lines":
            if fraction - last[0] >= 0.005:
                last[0] = fraction
                print(f"PROGRESS {fraction:.4f} {text}", file=sys.stderr, flush=True)
        elif fraction >= 1.0 or now - last[0] >= 0.05:
            last[0] = now
            full = int(30 * fraction)
            bar = f"\r{'#' * full}{'.' * (30 - full)} {100 * fraction:3.0f} % {text:<20.20}"
            print(bar if fraction < 1.0 else f"\r{'':<60}\r", end="", file=sys.stderr, flush=True)

    return Progress(report)


def _run_operation(options: argparse.Namespace) -> int:
    chosen: Operation = options.operation
    given = {}
    for parameter in chosen.parameters:
        value = getattr(options, f"parameter_{parameter.name}")
        if value is not None:
            given[parameter.name] = _number(value) if parameter.kind in NUMBERS else value
    chosen.resolve(given)  # bad options are reported before the file is read
    as_whole_number(options.turntable, "turntable", low=0, high=10_000)
    output = options.output or Path(options.file).stem + "-medialis"
    manifest = _compute(chosen.name, options.file, output, given, options)
    _report(manifest, options)
    return EXIT_OK


def _number(text: str) -> float | str:
    """Convert text to a number; what is none goes on to the check, which words the error."""
    try:
        return float(text)
    except ValueError:
        return text


def _compute(
    name: str, file: str | None, output: str, given: dict[str, Any], options: argparse.Namespace
) -> dict[str, Any]:
    from medialis.operations.writing import write_result
    from medialis.shape.generate import organic_shape
    from medialis.shape.reading import read_shape

    clock = time.perf_counter()
    progress = _progress(options)
    with progress.stage("input", 0.0, 0.1):
        shape = organic_shape() if file is None else read_shape(file, progress=progress)
    with progress.stage("compute", 0.1, 0.7):
        result = run(
            name, shape, threads=getattr(options, "threads", None), progress=progress, **given
        )
    with progress.stage("output", 0.7, 1.0):
        manifest = write_result(
            result,
            output,
            source="organic shape" if file is None else file,
            picture=not getattr(options, "no_picture", False),
            color_by=getattr(options, "color_by", None),
            turntable=getattr(options, "turntable", 0),
            progress=progress,
        )
    manifest["seconds"] = {**progress.seconds, "total": time.perf_counter() - clock}
    return manifest


def _report(manifest: dict[str, Any], options: argparse.Namespace) -> None:
    from medialis.io.results import json_text

    if getattr(options, "json", False):
        print(json_text(manifest))
        return
    print(f"{manifest['operation'].replace('_', ' ')} of {manifest['input']}")
    for name, value in manifest["values"].items():
        shown = f"{value:.6g}" if isinstance(value, float) else str(value)
        if name.startswith("spoke_angle"):  # radians in the core, degrees for people
            shown = f"{math.degrees(value):.1f} degrees"
        print(f"{name.replace('_', ' ')}: {shown}")
    for message in manifest["messages"]:
        print(f"note: {message}")
    print(f"{manifest['seconds']['total']:.2f} seconds")
    for file in manifest["files"]:
        if file != manifest["picture"]:
            print(file)
    if manifest["picture"]:
        print(manifest["picture"])


def _info(options: argparse.Namespace) -> int:
    from medialis.io.meshes import read_mesh
    from medialis.io.results import json_text
    from medialis.shape.diagnosis import diagnose
    from medialis.shape.repair import repair

    mesh = read_mesh(options.file)
    found, repaired = diagnose(mesh.points, mesh.faces), None
    messages = list(mesh.messages)
    try:
        fixed = repair(mesh.points, mesh.faces)
        messages += fixed.messages
        repaired = diagnose(fixed.points, fixed.faces) if fixed.messages else found
    except InvalidShapeError as error:  # nothing is left: the diagnosis tells why
        messages.append(f"Operations will refuse it: {error}")
    if options.json:
        after = None if repaired is None else repaired.as_dict()
        about = {"file": options.file, "format": mesh.format, "messages": messages}
        print(json_text({**about, **found.as_dict(), "repaired": after}))
        return EXIT_OK
    print(f"{options.file} ({mesh.format})")
    print(found.summary())
    for message in messages:
        print(f"note: {message}")
    if repaired is not None and repaired != found:
        print(f"as operations see it:\n{repaired.summary()}")
    return EXIT_OK


def _list(options: argparse.Namespace) -> int:
    for chosen in OPERATIONS:
        print(f"{chosen.name.replace('_', '-'):24} {chosen.help.splitlines()[0]}")
    return EXIT_OK


def _describe(options: argparse.Namespace) -> int:
    chosen = [operation(options.operation)] if options.operation else list(OPERATIONS)
    if options.json:
        print(json.dumps([entry.describe() for entry in chosen], indent=2))
        return EXIT_OK
    for entry in chosen:
        print(f"{entry.name} ({entry.label}; MeshLab: {entry.filter_name}; {entry.source})")
        print(entry.help)
        for parameter in entry.parameters:
            kind = parameter.kind.value
            if parameter.choices:
                kind = " | ".join(parameter.choices)
            print(f"  {parameter.name} [{kind}, default {parameter.default}]: {parameter.help}")
    return EXIT_OK


def _warmup(options: argparse.Namespace) -> int:
    from medialis.operations.pictures import draw_result
    from medialis.shape.generate import organic_shape

    clock = time.perf_counter()
    shape, progress = organic_shape(56), _progress(options)
    for number, entry in enumerate(OPERATIONS):
        span = number / len(OPERATIONS), (number + 1) / len(OPERATIONS)
        with progress.stage(entry.name, *span):
            given: dict[str, Any] = {"subsample": 0.01} if entry.name == "surface_skeleton" else {}
            result = run(entry.name, shape, progress=progress, **given)
            draw_result(result, width=64, height=64)
    from medialis._kernels.jit import kernel_cache

    print(f"Kernels ready in {time.perf_counter() - clock:.1f} s; cache: {kernel_cache()}")
    return EXIT_OK


def _demo(options: argparse.Namespace) -> int:
    for file in [None] if options.file is None else [None, options.file]:
        folder = Path(options.output) / ("organic_shape" if file is None else Path(file).stem)
        _report(_compute("surface_skeleton", file, str(folder), {}, options), options)
    return EXIT_OK


if __name__ == "__main__":
    sys.exit(main())
