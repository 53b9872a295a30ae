"""What a person sees of a command: a bar or lines while it runs, and one screen about its result.

`shown_progress` is a bar on a terminal, lines in a log or for programs; `summary_lines` tells what
the manifest of a result has: numbers, places, messages and files.
"""

from __future__ import annotations

import math
import os
import shutil
import sys
import textwrap
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TextIO

from medialis.base.progress import Progress

STYLES = ("auto", "bar", "log", "lines", "none")
BAR_WIDTH, BAR_SECONDS = 30, 0.05
LOG_SECONDS = 10.0
"""A log gets a line this often at most, and the last one."""


def shown_progress(style: str, *, batch: bool = False) -> Progress:
    """Return a `Progress` that writes to stderr.

    Parameters
    ----------
    style : str
        One of `STYLES`; "auto" is a bar on a terminal, and elsewhere a log for a batch, which may
        take hours, and nothing for a single run.
    batch : bool
        Tell the time left: all shapes are taken to need about the same.
    """
    if style == "auto":
        style = "bar" if sys.stderr.isatty() else "log" if batch else "none"
    if style == "none":
        return Progress()
    if style == "lines":
        return Progress(Lines())
    left = TimeLeft() if batch else None
    write, pause = (_bar, BAR_SECONDS) if style == "bar" else (_log, LOG_SECONDS)
    return Progress(Timed(write, pause, left))


class TimeLeft:
    """Estimate the rest from the time that this run has taken for its part."""

    def __init__(self) -> None:
        self._first: tuple[float, float] | None = None

    def __call__(self, fraction: float, now: float) -> str:
        """Return such as "3 min left, ", or nothing as long as nothing is known."""
        if self._first is None:
            self._first = now, fraction
        start, before = self._first
        if fraction <= before or fraction >= 1.0:
            return ""
        return f"{duration((now - start) * (1.0 - fraction) / (fraction - before))} left, "


def duration(seconds: float) -> str:
    """Return a time in words, as exact as an estimate is.

    Examples
    --------
    >>> duration(8.2), duration(200), duration(10000)
    ('9 s', '4 min', '2 h 47 min')
    """
    if seconds < 100:
        return f"{int(seconds) + 1} s"
    minutes = int(seconds / 60) + 1
    return f"{minutes} min" if minutes < 100 else f"{minutes // 60} h {minutes % 60} min"


class Lines:
    """One line for each 0.5 %, for programs."""

    def __init__(self) -> None:
        self._last = -1.0

    def __call__(self, fraction: float, text: str) -> None:
        """Print a line."""
        if fraction - self._last >= 0.005:
            self._last = fraction
            _write(f"PROGRESS {fraction:.4f} {text}\n")


class Timed:
    """Writes with pauses, and the last word in any case."""

    def __init__(
        self, write: Callable[[float, str], None], pause: float, left: TimeLeft | None
    ) -> None:
        self._write, self._pause, self._left, self._last = write, pause, left, -math.inf

    def __call__(self, fraction: float, text: str) -> None:
        """Write when it is time."""
        now = time.monotonic()
        left = self._left(fraction, now) if self._left else ""
        if fraction >= 1.0 or now - self._last >= self._pause:
            self._last = now
            self._write(fraction, f"{100 * fraction:3.0f} % {left}{text}")


def _log(fraction: float, text: str) -> None:
    """Write a line, for people who read it later."""
    _write(f"{text}\n")


def _bar(fraction: float, text: str) -> None:
    """Write a bar that fills, in one line as wide as the terminal; it vanishes at the end."""
    room, full = _columns() - 1, int(BAR_WIDTH * fraction)
    line = f"{'#' * full}{'.' * (BAR_WIDTH - full)} {text}" if fraction < 1.0 else ""
    _write(f"\r{line:<{room}.{room}}" + ("" if line else "\r"))


def clear_bar() -> None:
    """Make room for a sentence where a bar may have been left."""
    if sys.stderr.isatty():
        _write("\r" + " " * (_columns() - 1) + "\r")


def _write(text: str) -> None:
    sys.stderr.write(text)
    sys.stderr.flush()


def _columns() -> int:
    try:
        return max(20, os.get_terminal_size(sys.stderr.fileno()).columns)
    except (OSError, ValueError):  # no terminal
        return 80


def say(text: object = "", *, file: TextIO | None = None) -> None:
    """Print text; control characters, as in the name of a file, are shown and do nothing."""
    safe = (c if c.isprintable() or c in "\n\t" else repr(c)[1:-1] for c in str(text))
    print("".join(safe), file=file)


MOST_ROWS, MOST_BRANCHES = 5, 3
"""Of all tables of places together; the manifest has them all."""

TABLES = {
    "spots": ("thin spots", {"value": "value", "area": "area, both sides"}),
    "regions": ("regions", {"value": "value", "area": "area, one side"}),
    "ribs": ("ribs", {"ratio": "ratio", "thickness": "thickness", "wall": "wall"}),
    "branch_table": (
        "branches",
        {
            "length": "length",
            "mean_radius": "mean radius",
            "least_radius": "least radius",
            "tortuosity": "tortuosity",
            "fork_angle": "fork angle",
        },
    ),
    "test_poses": (
        "test poses",
        {
            "stretched": "stretched edges",
            "collapsed": "collapsed triangles",
            "largest_stretch": "largest stretch",
        },
    ),
}
"""Title of the tables of places, and heads of their columns, by the name of the value."""

MOST_LINES, FEWEST_FILES = 25, 2
"""Of a result on the screen; of its files, those left over in one line."""

MOST_NOTES = 3
"""Of the notes below a result, the most important first; --verbose has them all."""

SAID_LAST = {"refined", "welded", "sharp_edges", "specks", "dense_kept", "tails_kept", "lines_kept"}
"""Codes of notes on how it was computed."""

UNSAID = {"open_balls", "thin_walls"}
"""Codes of notes that only --verbose has, and the manifest: there is nothing to do about them."""

NORMALS_CODES = {"normals_missing", "normals_zero", "outside_uncertain"}
"""Codes of messages about normals, hidden for operations that do not use normals."""

WIDEST, NARROWEST = 100, 60

FILES = {
    "manifest.json": "all numbers, options and messages, for programs",
    "report.html": "how good the result is, a page for the browser",
    "report.json": "the same for programs",
    ".npz": "all arrays, for numpy.load",
    ".png": "picture",
    "centerline.lines.vtp": "the lines cut at forks, for the Vascular Modeling Toolkit",
    "centerline.csv": "the places along each line as a table, for spreadsheets",
    "tree_cylinders.csv": "the cylinders as a table, as TreeQSM and rTwig have them",
    "tree_cylinders.branches.csv": "the limbs as a table, as TreeQSM has them",
    "convex_pieces.urdf": "a link with the pieces as collision elements, for robot simulators",
    "convex_pieces.xml": "a body of the pieces, for MuJoCo",
    "convex_pieces.glb": "a mesh for each piece, for programs that show glTF",
    "convex_pieces.obj": "an object for each piece, for modelling programs",
    "test_poses.png": "the rig bent at each main joint, and what stretches there",
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
    ".csv": "the branches as a table, for spreadsheets",
    ".branches.graphml": "forks and ends, an edge a branch, for tools that read networks",
    ".branches.json": "the same for programs",
    ".swc": "the graph as a tree, for tools that read neurons",
    ".graphml": "the graph, for tools that read networks",
    ".json": "the graph with all that it holds",
    ".obj": "the graph as lines, for modelling programs",
    ".glb": "the shape with its bones and skin weights, for animation programs",
    ".bvh": "the bones as a rest pose, for animation programs",
    ".html": "the result to turn round, for the browser",
}
"""What a file is for, by its name or its ending."""


def summary_lines(
    manifest: Mapping[str, Any], width: int | None = None, *, verbose: bool = False
) -> Iterator[str]:
    """Yield what there is to say of a result, from its manifest; all of it when verbose."""
    columns = width or _line_width()
    lines = [*_told(manifest, columns, verbose)]
    for most in range(MOST_NOTES - 1, -1, -1):
        if not verbose and len(lines) > MOST_LINES - FEWEST_FILES - 1:
            lines = [*_told(manifest, columns, verbose, most)]
    yield from lines
    folder = Path(manifest["files"][0]).parent
    yield f"{len(manifest['files'])} files in {folder}, {manifest['seconds']['total']:.1f} seconds:"
    files = [*_files(manifest, verbose)]
    room = len(files) if verbose else max(MOST_LINES - len(lines) - 1, FEWEST_FILES)
    shown = files if len(files) <= room else files[: room - 1]
    yield from _indented(_shortened(_aligned(shown), columns - 2))
    if len(shown) < len(files):
        rest = f"and {', '.join(name for name, _ in files[len(shown) :])}"
        yield from _indented(_shortened([rest], columns - 2))


def _told(
    manifest: Mapping[str, Any], columns: int, verbose: bool, most_notes: int = MOST_NOTES
) -> Iterator[str]:
    """Yield all but the files."""
    from medialis.operations.result import INNER, value_rows

    values, unit = manifest["values"], manifest["unit"]
    yield f"{manifest['operation'].replace('_', ' ')} of {manifest['input']}"
    left_out: set[str] = set() if verbose else INNER
    known = {name: v for name, v in values.items() if v is not None and name not in left_out}
    yield from _indented(_aligned(value_rows(known, unit)))
    tables = [name for name in TABLES if values.get(name)]
    for name in tables:
        most = MOST_BRANCHES if name == "branch_table" else MOST_ROWS // len(tables)
        most = len(values[name]) if name == "test_poses" else most
        yield from _indented(_table(*TABLES[name], values[name], most, unit))
    if manifest.get("replaced"):
        told = ", ".join(f"{name} {value}" for name, value in manifest["replaced"].items())
        yield f"replaces the earlier result ({told})"
    for text in _notes(manifest, verbose, most_notes):
        yield from textwrap.wrap(text, columns, subsequent_indent="  ", break_long_words=False)


def _notes(manifest: Mapping[str, Any], verbose: bool, most: int) -> Iterator[str]:
    """Yield warnings, then notes and always the automatic values; how many are left out."""
    from medialis.operations.registry import operation

    said = list(zip(manifest["messages"], manifest["notes"], strict=True))
    said.sort(key=lambda one: (not one[1]["warning"], one[1]["code"] in SAID_LAST))
    values = [one for one in said if one[1]["code"] == "automatic"]
    normals = operation(manifest["operation"]).needs_normals
    hidden = {"automatic"} if normals else {"automatic", *NORMALS_CODES}
    others = [one for one in said if one[1]["code"] not in hidden and not _is_inner(one[1])]
    warns = bool(others) and others[0][1]["warning"]  # the first one is always told
    shown = said if verbose else others[: max(most, int(warns))] + values
    for message, about in shown:
        yield f"{'warning' if about['warning'] else 'note'}: {message}"
    if len(shown) < len(said):
        yield f"{len(said) - len(shown)} more with --verbose, and in manifest.json"


def _is_inner(about: Mapping[str, Any]) -> bool:
    return about["code"] in UNSAID and not about["warning"]


def _line_width() -> int:
    """Return how wide lines may be; what goes on to a program or a file stays in one line."""
    if not sys.stdout.isatty():
        return sys.maxsize
    return min(max(shutil.get_terminal_size().columns, NARROWEST), WIDEST)


def file_meanings(manifest: Mapping[str, Any]) -> dict[str, str]:
    """Return what each file of a result is for, by its name, the picture first."""
    from medialis.operations.registry import operation

    layers = operation(manifest["operation"]).layers
    names = [Path(file).name for file in manifest["files"]]
    picture = Path(manifest["picture"] or "").name
    found = {name: _meaning(name, layers) for name in sorted(names, key=lambda n: n != picture)}
    if any(layer["role"] == "bones" for layer in manifest["layers"]):
        found = {name: text.replace("the graph", "the bones") for name, text in found.items()}
    return found


SERIES = {
    "turntable_": "{} views all round",
    "convex_pieces_piece_": "{} pieces, for the URDF file",
}
"""What files with numbers in their names are together, by how these begin."""


def _files(manifest: Mapping[str, Any], verbose: bool) -> Iterator[tuple[str, str]]:
    """Give names and meanings; many files of a series are one line, but for --verbose."""
    meanings, seen = file_meanings(manifest), set()
    for name, meaning in meanings.items():
        series = next((one for one in SERIES if name.startswith(one)), None)
        if series is None or verbose:
            yield name, meaning
        elif series not in seen:
            seen.add(series)
            count = sum(other.startswith(series) for other in meanings)
            yield f"{name} ...", SERIES[series].format(count)


def _meaning(name: str, layers: Mapping[str, str]) -> str:
    """Return what a file is for."""
    path = Path(name)
    if path.suffix == ".ply":
        return layers.get(path.stem, "")
    if name.startswith("convex_pieces_piece_"):
        return "a piece, for the URDF file"
    known = (name, "".join(path.suffixes), path.suffix)
    return next((FILES[one] for one in known if one in FILES), "")


def _table(
    title: str,
    columns: Mapping[str, str],
    things: Sequence[Mapping[str, Any]],
    most: int,
    unit: str | None,
) -> list[str]:
    """Return the first of some places as a table: number, what, values, where."""
    from medialis.operations.result import value_text

    rows = [
        (
            str(number),
            thing["kind"],
            *("" if thing[c] is None else value_text(c, thing[c], unit) for c in columns),
            ", ".join(f"{x:.4g}" for x in thing.get("position", ())),
        )
        for number, thing in _first(things, most)
    ]
    left = len(things) - len(rows)
    more = [f"{left} more in manifest.json"] if left else []
    last = "position" if "position" in things[0] else ""
    return _aligned([("", title, *columns.values(), last), *rows]) + more


def _first(things: Sequence[Mapping[str, Any]], most: int) -> list[tuple[int, Mapping[str, Any]]]:
    """Return the first ones with their numbers; of branches the longest ones.

    Branches are numbered from 0, all others from 1: as in all files.
    """
    are_branches = "fork_angle" in things[0]
    numbered = list(enumerate(things, 0 if are_branches else 1))
    if are_branches:
        numbered.sort(key=lambda one: -one[1]["length"])
    return numbered[:most]


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
