"""The command line: what its commands do; `cli/arguments.py` says what they take.

An operation is one file in, one folder of results out: `run_operation` checks what was asked for
before anything is read. The doctor is long and has a file of its own. What a command needs is
loaded when it runs, so that help is quick.
"""

from __future__ import annotations

import argparse
import io
import json
import logging
import os
import shlex
import signal
import sys
import threading
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict
from importlib import import_module
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

from medialis.base.device import use_device
from medialis.base.errors import (
    Cancelled,
    FileError,
    InvalidOptionError,
    InvalidShapeError,
    MedialisError,
    nearest,
)
from medialis.cli.arguments import (
    EXIT_BAD_INPUT,
    EXIT_CANCELLED,
    EXIT_NOT_PASSED,
    EXIT_OK,
    EXIT_SOME_FAILED,
    LIMITED,
    SHOWN,
    add_completions,
    build_parser,
    number,
    with_dashes,
    with_method,
)
from medialis.cli.display import clear_bar, say, shown_progress, summary_lines
from medialis.operations.names import RENAMED, named_operations, renamed_note

if TYPE_CHECKING:
    from medialis.base.options import Kind
    from medialis.base.progress import Progress
    from medialis.operations.declaration import Operation
    from medialis.operations.result import Outcome


def run_batch(options: argparse.Namespace) -> int:
    """Run a batch and return the exit code."""
    from medialis.base.progress import counted
    from medialis.batches.batch import batch
    from medialis.batches.jobs import FAILED, TABLES
    from medialis.formats.json_npz import json_text

    progress = shown_progress(options.progress, batch=True)
    try:
        rows = batch(
            [name.strip() for name in options.operations.split(",")],
            options.files,
            options.output,
            parameters={
                **settings(options.set),
                "read_shape": {"unit": options.unit, "up": options.up},
            },
            workers=options.scheduler or options.workers,
            picture=not options.no_picture,
            report=options.report,
            progress=progress,
        )
    except (KeyboardInterrupt, Cancelled):
        clear_bar()
        say(
            "medialis: cancelled; what is finished stays, the same command goes on from there.",
            file=sys.stderr,
        )
        return EXIT_CANCELLED
    for message in progress.messages:
        if message.level >= logging.WARNING:
            say(f"warning: {message}", file=sys.stderr)
    bad = [row for row in rows if row.status == FAILED]
    if options.json:
        say(json_text([asdict(row) for row in rows]))
    else:
        groups: dict[tuple[str, str], list[str]] = {}
        for row in bad:
            groups.setdefault((row.file, row.sentence), []).append(row.operation)
        for (file, sentence), names in groups.items():
            say(f"failed: {', '.join(names)} of {file}: {sentence}")
        for message in progress.messages:
            if message.code == "batch":
                say(message)
        say(f"{counted(len(bad), 'result')} failed." if bad else "None failed.")
        for name in TABLES:
            say(Path(options.output) / name)
    if bad:
        return EXIT_SOME_FAILED
    verdicts = [row.numbers["passed"] for row in rows if "passed" in row.numbers]
    return _exit_code(verdicts) if options.fail else EXIT_OK


def settings(given: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Parse OPERATION.PARAMETER=VALUE into the parameters of each operation.

    Raises
    ------
    InvalidOptionError
        For another form, or an unknown operation.
    """
    from medialis.operations.registry import operation

    result: dict[str, dict[str, Any]] = {}
    for text in given:
        place, equals, value = text.partition("=")
        name, dot, key = place.partition(".")
        if not equals or not dot:
            raise InvalidOptionError(
                f"--set must be OPERATION.PARAMETER=VALUE, such as thickness.threshold=0.02; got "
                f"{text!r}."
            )
        chosen, key = operation(name), key.replace("-", "_")
        kind = next((p.kind for p in chosen.parameters if p.name == key), None)
        result.setdefault(chosen.name, {})[key] = _value(kind, value)
    return result


def _value(kind: Kind | None, text: Any) -> Any:
    """Convert the text of a parameter; what is no value of its kind goes on to the check."""
    from medialis.base.options import NUMBERS, Kind

    if kind is Kind.BOOL and isinstance(text, str):
        return {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}.get(
            text.lower(), text
        )
    return number(text) if kind in NUMBERS and kind is not Kind.LENGTH else text


def run_view(options: argparse.Namespace) -> int:
    """Make the page and say where it is."""
    from medialis.show.viewer.page import write_viewer

    source = Path(options.source)
    output = Path(options.output or f"{source.resolve().stem}-view.html")
    if output.suffix.lower() not in (".html", ".htm"):
        output = output.with_name(f"{output.name}.html")
    progress = shown_progress(options.progress)
    if source.is_dir():
        results = _as_asked(_of_folder(source), options)
    elif (layer := _of_layer(source)) is not None:
        results = _as_asked([layer], options)
    else:
        results = _computed(source, options, progress)
    with progress.stage("page", 0.95, 1.0):
        write_viewer(output, results, _title(source, results))
    say(f"{output} ({output.stat().st_size / 1e6:.1f} MB): open it in a browser.")
    if options.open:
        import webbrowser

        webbrowser.open(output.resolve().as_uri())
    return 0


def _as_asked(results: list[Outcome], options: argparse.Namespace) -> list[Outcome]:
    """Give results that were read the unit and the threshold that were asked for.

    Raises
    ------
    InvalidOptionError
        When they have another unit, or nothing in the first one has a threshold.
    """
    from dataclasses import replace

    from medialis.base.options import LENGTHS, Size, as_length, as_unit

    unit, own = as_unit(options.unit), results[0].shape.unit
    if unit is not None and own not in (None, unit):
        raise InvalidOptionError(f"The results are in {own}: --unit {unit} cannot change that.")
    if unit is not None:
        results = [replace(one, shape=replace(one.shape, unit=unit)) for one in results]
    if not options.threshold:
        return results
    first, *others = results
    told = first.values.get("diagonal")
    size = Size(told if isinstance(told, float) else first.shape.diagonal, unit or own)
    share = size.fraction(as_length(options.threshold, "threshold", 0.0, 1.0), "threshold")
    if first.shown and first.shown[0].color_by in LENGTHS:
        look = replace(first.shown[0], color_limit=share * size.diagonal)
        return [replace(first, shown=(look, *first.shown[1:])), *others]
    if first.layers and first.layers[0].filter_by is not None:
        layer = replace(first.layers[0], filter_default=share)
        return [replace(first, layers=(layer, *first.layers[1:])), *others]
    raise InvalidOptionError(
        "--threshold is for thickness and for skeletons with importance; what is shown first "
        "has neither."
    )


def _title(source: Path, results: Sequence[Outcome]) -> str:
    """Return the name of the shape, with the operation where there is one."""
    from medialis.base.disk import Folder
    from medialis.operations.result import Result
    from medialis.show.writing import manifest_in

    if not source.is_dir():
        return source.resolve().name
    with Folder.at(source) as place:
        folders = [source, *(source / name for name in place.names())]
    manifests = map(manifest_in, folders)
    names = [str(one["input"]) for one in manifests if one and one.get("input")]
    name = names[0] if names else source.resolve().name
    first = results[0]
    return (
        f"{name}: {first.title.lower()}"
        if [first] == results and isinstance(first, Result)
        else name
    )


def _of_folder(folder: Path) -> list[Outcome]:
    """Read the result of a folder, or those of the folders in it.

    Raises
    ------
    InvalidOptionError
        When there is none, or they are of several shapes.
    """
    from medialis.base.disk import Folder
    from medialis.formats.output_folder import MANIFEST
    from medialis.show.result import read_result
    from medialis.show.writing import manifest_in

    def inside(place: Folder, depth: int) -> Iterator[Path]:
        """Yield folders of results in a folder, and so many levels deeper, along no link."""
        if place.about(MANIFEST) is not None:
            yield place.path
        for name in place.names() if depth else ():
            with suppress(OSError):
                if place.is_folder(name):
                    with place.folder(name) as inner:
                        yield from inside(inner, depth - 1)

    with Folder.at(folder) as place:
        found = [path.relative_to(place.path) for path in inside(place, 2)]
    folders = [folder / path for path in sorted(found) if len(path.parts) < 2]
    if not folders:
        more = f" Name one shape, such as {folder / min(found).parent}." if found else ""
        raise InvalidOptionError(f"{folder} holds no results.{more}")
    results = [read_result(path) for path in folders]
    size = results[0].shape.diagonal
    if any(abs(result.shape.diagonal - size) > 0.01 * size for result in results):
        inputs = {str((manifest_in(path) or {}).get("input")) for path in folders}
        if len(inputs) > 1:  # of one input the refined and the repaired shape may differ
            raise InvalidOptionError(
                f"{folder} holds results of several shapes. Name one, such as {folders[0]}."
            )
    return list(results)


def _of_layer(file: Path) -> Outcome | None:
    """Read a layer or a graph that medialis wrote; None for any other file."""
    from medialis.curves.operation import read_curve_skeleton
    from medialis.exchange.libraries import Drawn
    from medialis.formats.ply_attributes import read_ply_attributes

    if file.suffix.lower() in (".swc", ".json"):
        drawn = Drawn.of(read_curve_skeleton(file))
    elif file.suffix.lower() == ".ply" and _is_ours(file):
        data = read_ply_attributes(file)
        if not any(values.ndim == 1 for values in data.attributes.values()):
            return None  # a shape that `write_mesh` wrote
        drawn = Drawn(data.points, data.faces, data.edges, data.attributes, data.face_attributes)
    else:
        return None
    return drawn.outcome(file.stem)


def _is_ours(file: Path) -> bool:
    from medialis.base.disk import open_file

    try:
        with open_file(file) as stream:
            return b"\ncomment medialis " in stream.read(2000)
    except OSError:
        return False  # the reader says why


def _computed(file: Path, options: argparse.Namespace, progress: Progress) -> list[Outcome]:
    """Run the operations; those that cannot be done are said and left out.

    Raises
    ------
    MedialisError
        When none can be done.
    """
    from medialis.operations.registry import operation, run
    from medialis.operations.result import Outcome
    from medialis.shape.reading import read_shape

    show = (LIMITED if options.threshold else SHOWN) if options.show is None else options.show
    names = [operation(name).name for name in filter(None, show.split(","))]
    given: dict[str, Any] = {}
    if options.threshold:
        if not names or not any(p.name == "threshold" for p in operation(names[0]).parameters):
            raise InvalidOptionError(
                "--threshold is for an operation that has one, such as --show thickness."
            )
        given = {"threshold": options.threshold}
    _compile_first(names, progress)
    with progress.stage("input", 0.0, 0.05):
        shape = read_shape(file, unit=options.unit, up=options.up, progress=progress)
    results: list[Outcome] = []
    for row, name in enumerate(names):
        start, width = 0.05 + 0.9 * row / len(names), 0.9 / len(names)
        try:
            with progress.stage(name, start, start + width):
                chosen = given if row == 0 else {}
                found = run(name, shape, threads=options.threads, progress=progress, **chosen)
                results.append(found)
        except MedialisError as error:
            if (row == len(names) - 1 and not results) or (given and row == 0):
                raise
            say(f"note: {name} was left out: {error}")
    return results or [Outcome(shape=shape)]


def run_operation(options: argparse.Namespace) -> int:
    """Run an operation on a file and return the exit code."""
    from medialis.base.validation import as_whole_number
    from medialis.show.writing import check_same, chosen_formats

    chosen: Operation = options.operation
    file = _only_file(options, chosen.name.replace("_", "-"))
    as_whole_number(options.turntable, "turntable", low=0, high=10_000)
    chosen_formats(chosen.name, _formats(options))
    # One folder an operation: the next one on the same file leaves it alone.
    folder = options.output or Path(f"{Path(file).stem}-medialis", chosen.name)
    given = _given(chosen, options)
    about = _about(chosen, file, given, options)  # says what is wrong before the file is read
    if not options.overwrite and not options.host:
        about["earlier"] = check_same(folder, about)
    manifest = _compute(about, given, file, Path(folder), options)
    if not options.host:  # a host reads the manifest from the folder
        _report(manifest, options.json, options.verbose)
    if chosen.checks and options.fail:
        return _exit_code([manifest["values"]["passed"]])
    return EXIT_OK


def _exit_code(passed: Iterable[bool | None]) -> int:
    """Return the exit code of checks: a failure first, then what has no verdict."""
    verdicts = set(passed)
    if False in verdicts:
        return EXIT_NOT_PASSED
    return EXIT_BAD_INPUT if None in verdicts else EXIT_OK


def run_demo(options: argparse.Namespace) -> int:
    """Run the first operation on the built-in shape, and on a file; its folder is its own."""
    from medialis.operations.registry import operation

    chosen = operation("surface_skeleton")
    for file in [None] if options.file is None else [None, options.file]:
        folder = Path(options.output) / ("organic_shape" if file is None else Path(file).stem)
        manifest = _compute(_about(chosen, file, {}, options), {}, file, folder, options)
        _report(manifest, False, False)
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
            given[parameter.name] = _value(parameter.kind, value)
    return given


def _about(
    chosen: Operation, file: str | None, given: dict[str, Any], options: argparse.Namespace
) -> dict[str, Any]:
    """Return what tells a result from others, as its manifest will have it."""
    from medialis.base.options import as_unit
    from medialis.base.version import package_version
    from medialis.show.writing import as_given, input_stamp

    try:
        here = None if file is None else input_stamp(file)
    except (OSError, ValueError):  # reading tells what is wrong
        here = None
    return {
        "operation": chosen.name,
        "medialis": package_version(),
        "parameters": as_given(chosen.resolve(given)),
        "input_stamp": here,
        "input_unit": as_unit(options.unit),
        "input_up": options.up,
    }


def _formats(options: argparse.Namespace) -> tuple[str, ...]:
    """Return the formats to write besides PLY, each once."""
    return tuple(dict.fromkeys(filter(None, options.formats.split(","))))


def _compile_first(names: list[str], progress: Progress) -> None:
    """Compile what operations need, on all processors, where nothing was made ahead of time."""
    from medialis.base.progress import counted
    from medialis.hosts.compile_ahead import compile_ahead, is_needed, seconds_needed

    if needed := list(filter(is_needed, names)):
        import_module("medialis.base.compiling")  # raises here where numba cannot be loaded
        what = needed[0] if len(needed) == 1 else counted(len(needed), "operation")
        about = f"about {seconds_needed(needed):.0f} s"
        say(f"Compiling {what} for the first run, once: {about}.", file=sys.stderr)
        with progress.stage("compile", 0.0, 0.0):
            compile_ahead(needed, progress)


def _compute(
    about: dict[str, Any],
    given: dict[str, Any],
    file: str | None,
    folder: Path,
    options: argparse.Namespace,
) -> dict[str, Any]:
    """Read a file (None: the built-in shape), compute and write; return the manifest."""
    from medialis.base.threads import thread_limit
    from medialis.operations.registry import run
    from medialis.shape.reading import read_shape
    from medialis.show.writing import Pictures, Written, write_files

    clock, threads = time.perf_counter(), options.threads
    progress = shown_progress(options.progress)
    _compile_first([about["operation"]], progress)
    with progress.stage("input", 0.0, 0.1):
        if file is None:
            from medialis.shape.generate import organic_shape

            shape = organic_shape()
        else:
            unit, up = about["input_unit"], about["input_up"]
            shape = read_shape(file, unit=unit, up=up, progress=progress)
    with progress.stage("compute", 0.1, 0.7):
        result = run(about["operation"], shape, threads=threads, progress=progress, **given)
    source = "organic shape" if file is None else file
    if options.host:
        from medialis.hosts.menu import write_for_host

        with progress.stage("output", 0.7, 1.0):
            return write_for_host(
                result, shape, folder, source=source, selects=options.select,
                auxiliary=options.auxiliary, draw_solid=options.solid, progress=progress,
            )  # fmt: skip
    texts = {}
    if options.report:
        from medialis.show.reports.report import report_texts

        with progress.stage("report", 0.7, 0.85), thread_limit(threads):
            texts = report_texts(result, source=file, progress=progress)
    pictures = Pictures(not options.no_picture, options.color_by, options.turntable)
    record = {name: about[name] for name in ("input_stamp", "input_unit", "input_up")}
    wanted = Written(
        *(source, pictures, _formats(options), texts, record, options.overwrite),
        earlier=about.get("earlier"),
    )
    with progress.stage("output", 0.85, 1.0), thread_limit(threads):
        manifest = write_files(result, folder, wanted, progress)
    manifest["seconds"] = {**progress.seconds, "total": time.perf_counter() - clock}
    return manifest


def _report(manifest: dict[str, Any], as_json: bool, verbose: bool) -> None:
    if as_json:
        from medialis.formats.json_npz import json_text

        say(json_text(manifest))
        return
    for line in summary_lines(manifest, verbose=verbose):
        say(line)


def write_sample(options: argparse.Namespace) -> int:
    """Write a sample, or list them all; return the exit code."""
    from medialis.formats.ply_attributes import write_ply
    from medialis.shape.samples import SAMPLES, sample_shape

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
    if path.suffix.lower() != ".ply":
        raise InvalidOptionError(f"Samples are written as PLY: call the file {path.stem}.ply.")
    _refuse_existing(path)  # at once, and again: the shape takes seconds
    shape = sample_shape(name)
    _refuse_existing(path)
    write_ply(path, shape.points, faces=shape.faces)
    faces = f", {shape.face_count:,} triangles" if shape.face_count else ""
    say(f"{path}: {SAMPLES[name]} ({shape.point_count:,} points{faces})")
    return EXIT_OK


def run_robot_balls(options: argparse.Namespace) -> int:
    """Compute balls for a robot, write them and say how good they are; return the exit code."""
    from dataclasses import asdict

    from medialis.base.options import with_unit
    from medialis.base.progress import counted
    from medialis.base.threads import thread_limit
    from medialis.robots.balls import check_ending, finite, robot_balls, write_robot_balls

    default = f"{Path(options.file).stem}-" + ("capsules.xml" if options.capsules else "balls.yml")
    files = [Path(name) for name in options.output or [default]]
    for file in files:  # at once: it takes seconds
        check_ending(file, options.capsules)
        if not options.overwrite:
            _refuse_existing(file)
    progress = shown_progress(options.progress)
    names = ("balls", "cover", "capsules", "plane")
    given = {name: getattr(options, name) for name in names}
    with thread_limit(options.threads):
        robot = robot_balls(options.file, progress=progress, **given)
    for file in files:
        if not options.overwrite:
            _refuse_existing(file)
        write_robot_balls(file, robot)
    counts = {name: len(cover) for name, cover in robot.links.items()}
    if options.json:
        content = {
            "files": [str(file) for file in files],
            "capsules" if options.capsules else "balls": counts,
            "figures": finite(robot.figures),
            "protrusions": dict(robot.protrusions),
            "overlaps": [asdict(pair) for pair in robot.overlaps],
            "unit": "m",
        }
        say(json.dumps(content, indent=1))
        return EXIT_OK
    for message in progress.messages:
        if message.level >= logging.WARNING or message.code == "at_plane":
            say(f"note: {message}")
    kind = "capsule" if options.capsules else "ball"
    say(f"{counted(sum(counts.values()), kind)} for {counted(len(counts), 'link')}")
    for name, count in counts.items() if options.verbose else ():
        say(f"  {name}: {count}, protrusion {with_unit(1000.0 * robot.protrusions[name], 'mm')}")
    for name, value in robot.figures.items():
        share = name in ("coverage", "volume_ratio")
        text = f"{value:.4g}" if share else with_unit(1000.0 * value, "mm")
        say(f"{name.replace('_', ' ')}: {text}")
    for pair in robot.overlaps:
        say(f"overlap: {pair.first}, {pair.second}: {with_unit(1000.0 * pair.depth, 'mm')}")
    for file in files:
        say(file)
    return EXIT_OK


def _refuse_existing(path: Path) -> None:
    if path.exists():
        raise FileError(f"Nothing was written: there is a file {path} already; name another.")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    _print_any_name()
    interrupts: list[int] = []
    try:
        with _ending_as_interrupt(interrupts):
            given = with_method(with_dashes(sys.argv[1:] if arguments is None else arguments))
            if given and given[0] in RENAMED:
                say(renamed_note(given[0]), file=sys.stderr)
                given[0] = RENAMED[given[0]].replace("_", "-")
            parser = build_parser(run_operation, COMMANDS, chosen=given[0] if given else "")
            options = parser.parse_args(given)
            level = logging.INFO if getattr(options, "verbose", False) else logging.ERROR
            logging.basicConfig(level=level, format="%(message)s", stream=sys.stderr)
            with use_device(getattr(options, "device", None)):
                code: int = options.command(options)
            sys.stdout.flush()
            return code
    except (Exception, KeyboardInterrupt) as error:  # noqa: BLE001 - raised again if unknown
        # An import that is interrupted may raise anything.
        return _ended_by(Cancelled() if interrupts else error)


def _working_folder_is_gone() -> bool:
    try:
        return not Path.cwd().is_dir()
    except FileNotFoundError:
        return True


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
    elif isinstance(error, OSError) and _working_folder_is_gone():  # numba asks for it to compile
        line = "Cannot compute here: the working folder was removed; change to another one."
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


def _info(options: argparse.Namespace) -> int:
    import numpy as np

    from medialis.base.progress import Message, Progress
    from medialis.base.threads import run_patiently
    from medialis.formats.json_npz import json_text
    from medialis.formats.meshes import read_mesh
    from medialis.shape.diagnosis import diagnose
    from medialis.shape.repair import joined_corners, repair
    from medialis.shape.shape import Shape, far_points

    progress, repaired = Progress(), None
    mesh = run_patiently(lambda: read_mesh(options.file), progress)
    joined = run_patiently(lambda: joined_corners(mesh.points, mesh.faces), progress)
    points, faces, joining = joined
    found = run_patiently(lambda: diagnose(points, faces), progress)
    messages = [*mesh.messages, *joining]
    try:
        fixed = run_patiently(lambda: repair(points, faces), progress)
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
    say(found.summary(mesh.unit))
    finite = points[np.isfinite(points).all(axis=1)]
    sides = (f"{side:.6g}" for side in np.ptp(finite, axis=0)) if len(finite) else ["0"]
    say(f"size {' x '.join(sides)} {mesh.unit or ''}".rstrip())
    say(
        f"unit: {mesh.unit or 'unknown (the file does not state it; pass --unit mm to operations)'}"
    )
    for message in messages:
        say(f"note: {message}")
    if repaired is not None and repaired != found:
        say(f"as operations see it:\n{repaired.summary(mesh.unit)}")
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
            say(f"  {parameter.name} [{kind}, default {parameter.default}]: {parameter.full_help}")
    return EXIT_OK


def _warmup(options: argparse.Namespace) -> int:
    """Compile what all operations need, on all processors, where nothing was made ahead of time."""
    from medialis.base.cache_folder import kernel_cache, mark_compiled
    from medialis.base.jit import record

    if record():
        say("The kernels were made ahead of time: there is nothing to compile.")
        return EXIT_OK
    clock = time.perf_counter()
    _compile_first([named.name for named in named_operations()], shown_progress(options.progress))
    mark_compiled()
    say(f"Kernels ready in {time.perf_counter() - clock:.1f} s; cache: {kernel_cache()}")
    return EXIT_OK


def _doctor(options: argparse.Namespace) -> int:
    from medialis.cli.doctor import as_data, as_text, examine

    findings = examine()
    say(json.dumps(as_data(findings), indent=2) if options.json else as_text(findings))
    return EXIT_BAD_INPUT if any(f.state == "broken" for f in findings) else EXIT_OK


def _meshlab_install(options: argparse.Namespace) -> int:
    from importlib.metadata import entry_points

    found = entry_points(group="medialis.commands", name="meshlab-install")
    if not found:
        raise FileError(
            "The plugin of MeshLab is a package of its own: pip install medialis-meshlab, then run "
            "medialis meshlab-install."
        )
    install_wanted = next(iter(found)).load()  # of the adapter, which is GPL
    wanted = options.plugins, options.plugin, options.release, options.meshlab
    done, problems = install_wanted(*wanted)
    for name, file in done.items():
        say(f"{name}: {file}")
    for problem in problems:
        say(problem, file=sys.stderr)
    say("Start MeshLab again: its menu Filters has the filters of medialis, search for: medial.")
    return EXIT_OK


def _completion(options: argparse.Namespace) -> int:
    """Print the script that a shell reads."""
    try:
        import shtab
    except ImportError as error:
        raise InvalidOptionError(
            'Completion needs shtab: pip install "medialis[completion]" (importing it says: '
            f"{error})."
        ) from None
    from medialis.shape.samples import SAMPLES

    parser = build_parser(run_operation, COMMANDS, every=True)
    add_completions(parser, shtab.FILE, {"sample": SAMPLES})
    say(shtab.complete(parser, options.shell).removesuffix("\n"))
    return EXIT_OK


COMMANDS = {
    "view": run_view,
    "robot-balls": run_robot_balls,
    "info": _info,
    "list": _list,
    "describe": _describe,
    "batch": run_batch,
    "warmup": _warmup,
    "demo": run_demo,
    "sample": write_sample,
    "completion": _completion,
    "doctor": _doctor,
    "meshlab-install": _meshlab_install,
}

if __name__ == "__main__":
    sys.exit(main())
