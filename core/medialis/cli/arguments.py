"""The arguments of the command line: one subcommand for each operation, from the registry."""

from __future__ import annotations

import argparse
import sys
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from medialis.base.device import DEVICES
from medialis.base.errors import InvalidOptionError, nearest
from medialis.base.validation import AXES
from medialis.cli.display import STYLES, say
from medialis.operations.names import named_operations

if TYPE_CHECKING:
    from medialis.operations.declaration import Operation, Parameter

Command = Callable[[argparse.Namespace], int]

SHELLS = ("bash", "zsh", "fish")

EXIT_OK, EXIT_NOT_PASSED, EXIT_BAD_INPUT, EXIT_SOME_FAILED, EXIT_CANCELLED = 0, 1, 2, 3, 130

_EPILOG = """exit statuses: 0 done; 1 a check failed (with --fail); 2 bad input or options (a line
on stderr says which); 3 some results of a batch failed (its table says which); 130 interrupted.
Lengths are shares of the size (0.5% of the bounding-box diagonal; 0.005 is the same) or real ones
(1mm, 0.2in), for which the unit of the file must be known: STEP, 3MF, glTF, Collada and E57 say it,
LAS may, for others add --unit mm."""


SHOWN, LIMITED = "surface_skeleton,thickness,curve_skeleton", "thickness,surface_skeleton"
"""What `view` computes of a mesh or point cloud: without a threshold, and with one."""

_VIEW = (
    "Write one HTML file that shows a shape and its results in three dimensions: turn it, switch\n"
    "layers, hide values, cut it open, click for the numbers of a place. It needs no network and\n"
    "no server: open it by a double click, or send it to somebody."
)
_VIEW_EXAMPLES = """examples:
  medialis view bunny.ply                     the shape with its skeletons and its thickness
  medialis view bunny.ply --show parts        with its parts
  medialis view bunny-medialis                all results in a folder, nothing is computed
  medialis view bunny-medialis/thickness/thickness.ply   one layer with its values"""


def number(text: str) -> float | str:
    """Convert text to a number; what is none goes on to the check, which words the error."""
    try:
        return float(text)
    except ValueError:
        return text


class _Parser(argparse.ArgumentParser):
    """argparse that reports errors as one line, like every other error of the program."""

    def _print_message(self, message: str, file: Any = None) -> None:
        if message:  # argparse itself prints to a full disk without a word
            say(message.removesuffix("\n"), file=file)
            sys.stdout.flush()

    def error(self, message: str) -> Any:
        raise InvalidOptionError(f"{message} (see {self.prog} --help)")

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse; what is unknown gets a sentence that names the nearest known words."""
        given, unknown = self.parse_known_args(args, namespace)
        if unknown:
            sub = getattr(given, "parser", self)
            known = [word for action in sub._actions for word in action.option_strings]
            words = [word.partition("=")[0] for word in unknown if word.startswith("-")]
            near = [nearest(word, known) for word in words]
            raise InvalidOptionError(
                f"{sub.prog} has no {' '.join(words or unknown)}{''.join(near)} (see {sub.prog} "
                "--help)"
            )
        return given


class _Version(argparse.Action):
    """Looks the version up when it is asked for."""

    def __call__(self, parser: argparse.ArgumentParser, *rest: Any) -> None:
        from medialis.base.version import package_version

        say(f"medialis {package_version()}")
        sys.stdout.flush()
        parser.exit()


def build_parser(
    run: Command, commands: Mapping[str, Command], chosen: str = "", *, every: bool = False
) -> argparse.ArgumentParser:
    """Return the parser; `run` is the command of every operation, `commands` the others by name.

    Of the operations only the `chosen` one is loaded and has its parameters, or `every` one.

    Raises
    ------
    InvalidOptionError
        When the chosen command is none.
    """
    names = [*(named.command for named in named_operations()), *commands]
    if chosen and not chosen.startswith("-") and chosen not in names:
        raise InvalidOptionError(
            f"There is no command {chosen}{nearest(chosen, names) or '.'} All are listed by "
            "medialis --help"
        )
    parser = _Parser(
        prog="medialis",
        description="Medial descriptors of 3D shapes: skeletons, thickness, parts.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and exit")
    group = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for named in named_operations():
        sub = group.add_parser(named.command, help=named.first_line)
        if every or named.command == chosen:
            from medialis.operations.registry import operation

            _add_operation(sub, operation(named.name), run)

    def add(name: str, help_text: str) -> argparse.ArgumentParser:
        sub = group.add_parser(name, help=help_text, description=help_text)
        sub.set_defaults(command=commands[name], verbose=False, parser=sub)
        return sub

    info = add("info", "Diagnose a mesh or point cloud file, before and after repair.")
    info.add_argument("file", help="PLY, OBJ, OFF, STL or point text; more with the extra io")
    info.add_argument("--json", action="store_true", help="print one JSON object")
    add("list", "List all operations.")
    describe = add("describe", "Describe operations and their parameters.")
    describe.add_argument("operation", nargs="?", help="one operation; all when missing")
    describe.add_argument("--json", action="store_true", help="print JSON (for programs)")
    _add_batch(add("batch", "Run operations over many files, in parallel; --help tells how."))
    warmup = add("warmup", "Compile all kernels now, so that the first run is fast.")
    _add_progress(warmup)
    doctor = add("doctor", "Say what is installed, what is missing, and how to get it.")
    doctor.add_argument("--json", action="store_true", help="print JSON (for programs)")
    install = add("meshlab-install", "Put the plugin into the MeshLab of this machine.")
    install.add_argument(
        "--plugins", metavar="PLACE", help="folder or zip of built plugins (default: installed)"
    )
    install.add_argument("--plugin", metavar="FILE", help="this built plugin, whatever it is for")
    install.add_argument("--release", help="the MeshLab to install for, as in 2025.07d")
    install.add_argument(
        "--meshlab", metavar="FOLDER", help="MeshLab's folder of plugins (default: found)"
    )
    demo = add("demo", "Compute the surface skeleton of a built-in shape, and of yours.")
    demo.add_argument("file", nargs="?", help="a mesh or point cloud of your own")
    demo.add_argument("-o", "--output", default="medialis-demo", help="output folder")
    _add_progress(demo)
    demo.set_defaults(
        **{"overwrite": True, "turntable": 0, "formats": "", "host": False, "report": False},
        **dict.fromkeys(("unit", "up", "threads", "no_picture", "color_by")),
    )
    sample = add("sample", "Write a shape to try things on; without a name: list them.")
    sample.add_argument("name", nargs="?", help="its name")
    sample.add_argument("-o", "--output", metavar="FILE", help="(default: NAME.ply, here)")
    robot = add("robot-balls", "Describe the links of a robot (URDF) by balls, for planners.")
    _add_robot_balls(robot)
    view = add("view", "Show a shape and its results in three dimensions, in one HTML file.")
    _add_view(view)
    completion = add("completion", "Print the script by which a shell completes commands.")
    completion.add_argument("shell", choices=SHELLS)
    return parser


def add_completions(
    parser: argparse.ArgumentParser, file: Any, first: Mapping[str, Iterable[str]]
) -> None:
    """Tell shtab what values a parser of `every` operation takes: known words, or files.

    Parameters
    ----------
    parser : ArgumentParser
    file
        What shtab has for files.
    first : mapping
        Words of the first argument of a command, by its name.
    """
    operations = [named.command for named in named_operations()]
    words = {"batch": operations, "describe": operations, **first}
    group = next(a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    for name, sub in group.choices.items():
        for action in sub._actions:
            metavar = str(action.metavar)
            if metavar.startswith("{"):  # choices that the operation checks
                action.choices = metavar[1:-1].split(",")
            elif not action.option_strings and name in words:
                action.choices = list(words.pop(name))
            elif action.nargs != 0 and action.choices is None:
                action.complete = file


def with_dashes(arguments: Sequence[str]) -> list[str]:
    """Return arguments with the command and the options spelled as the parser knows them.

    Examples
    --------
    >>> with_dashes(["soft_edges", "my_part.ply", "--color_by=edge_radius"])
    ['soft-edges', 'my_part.ply', '--color-by=edge_radius']
    """
    result = list(arguments)
    for place, word in enumerate(result):
        if word == "--":  # file names follow
            break
        name, equals, value = word.partition("=")
        if place == 0 or name.startswith("--"):
            result[place] = name.replace("_", "-") + equals + value
    return result


OF_METHOD = {("curve-skeleton", "views"): "view-curve-skeleton"}
"""Operations that people call by another one and its `--method`."""


def with_method(arguments: Sequence[str]) -> list[str]:
    """Return arguments with the operation that a `--method` stands for, and without it.

    Examples
    --------
    >>> with_method(["curve-skeleton", "a.ply", "--method", "views", "--pairs", "40"])
    ['view-curve-skeleton', 'a.ply', '--pairs', '40']
    """
    result = list(arguments)
    end = result.index("--") if "--" in result else len(result)
    for place, word in enumerate(result[:end]):
        name, equals, value = word.partition("=")
        given = value if equals else "".join(result[place + 1 : place + 2])
        if name == "--method" and (operation := OF_METHOD.get((result[0], given))):
            del result[place : place + (1 if equals else 2)]
            return [operation, *result[1:]]
    return result


def _add_operation(sub: argparse.ArgumentParser, chosen: Operation, run: Command) -> None:
    lines = chosen.full_help.splitlines()  # paragraphs, in lines that fit a terminal
    sub.description = "\n".join(textwrap.fill(line, 88) for line in lines)
    sub.epilog = f"{_examples(chosen)}\n\n{_EPILOG}"
    sub.formatter_class = argparse.RawDescriptionHelpFormatter
    sub.add_argument(
        "file",
        nargs="+",
        metavar="FILE",
        help="PLY, OBJ, OFF, STL or point text; more with the extra io. One: batch takes many",
    )
    sub.add_argument(
        "-o",
        "--output",
        metavar="FOLDER",
        help=f"folder of the results (default: NAME-medialis/{chosen.name}, here)",
    )
    sub.add_argument(
        "--overwrite", action="store_true", help="replace another result in that folder"
    )
    _add_unit(sub)
    _add_up(sub)
    options = sub.add_argument_group("parameters")
    for parameter in chosen.parameters:
        _add_parameter(options, parameter)
    if chosen.checks:
        sub.add_argument(
            "--fail", action="store_true", help="end with exit status 1 where the check fails"
        )
    own = chosen.name.replace("_", "-")
    methods = [method for (command, method) in OF_METHOD if command == own]
    if methods:
        sub.add_argument(
            "--method",
            choices=("balls", *methods),
            default="balls",
            help="from the balls inside (default), or from pictures all round, which takes point "
            "clouds and open meshes too and has options of its own (medialis view-curve-skeleton)",
        )
    _add_processors(sub)
    sub.add_argument("--json", action="store_true", help="print the manifest as one JSON object")
    sub.add_argument("--no-picture", action="store_true", help="write no picture")
    _add_report(sub, "of the result")
    sub.add_argument("--color-by", metavar="ATTRIBUTE", help="colour the picture by this attribute")
    sub.add_argument(
        "--turntable", type=int, default=0, metavar="N", help="also draw N views all round"
    )
    sub.add_argument(
        "--host", action="store_true", help=argparse.SUPPRESS
    )  # for host programs, see hosts/menu.py; and with it:
    for more in ("--auxiliary", "--solid", "--select"):
        sub.add_argument(more, action="store_true", help=argparse.SUPPRESS)
    layers = (
        "vtp, vtu: each layer for ParaView, with its attributes; msh, inp, ccx: triangles as shell "
        "elements for Gmsh, Abaqus and CalculiX"
    )
    others = [name for name in chosen.offered if name not in chosen.default_formats]
    own = f" Of this operation also {', '.join(others)}." if others else ""
    sub.add_argument(
        "--formats",
        default=",".join(chosen.default_formats),
        metavar="LIST",
        help="formats to write besides PLY, with commas between them; '' for none (default: "
        f"{','.join(chosen.default_formats) or 'none'}).{own} Of every operation {layers}",
    )
    _add_progress(sub)
    sub.set_defaults(command=run, operation=chosen, parser=sub)


def _examples(chosen: Operation) -> str:
    """Return worked examples, on shapes of `medialis sample`, and the files that come out."""
    command = chosen.name.replace("_", "-")
    lines = ["examples:"]
    for arguments, meaning in chosen.examples:
        lines += [f"  # {meaning}", f"  medialis {command} {arguments}"]
    shapes = dict.fromkeys(arguments.split()[0] for arguments, _ in chosen.examples)
    lines += [f"  (medialis sample {Path(shape).stem} writes {shape})" for shape in shapes]
    lines += ["", "files:"]
    width = max(map(len, chosen.layers), default=0) + 6
    lines += [f"  {name + '.ply':<{width}}{text}" for name, text in chosen.layers.items()]
    lines += [f"  {chosen.name}.npz, {chosen.name}.png, manifest.json: all arrays, a picture, "]
    lines[-1] += "all numbers"
    return "\n".join(lines)


def _add_batch(sub: argparse.ArgumentParser) -> None:
    sub.description = (
        "Run operations over many shapes, in processes of this machine. Results go to "
        "OUTPUT/SHAPE/OPERATION, a table of all to OUTPUT/results.html and results.csv. One bad "
        "shape never stops the rest; the exit code is 3 then. Called again it computes only what "
        "is missing."
    )
    sub.epilog = _EPILOG
    sub.formatter_class = argparse.RawDescriptionHelpFormatter
    sub.add_argument(
        "operations", metavar="OPERATION[,OPERATION...]", help="names as `medialis list` has them"
    )
    sub.add_argument(
        "files", nargs="+", metavar="FILE", help="meshes and point clouds, or folders of them"
    )
    sub.add_argument("-o", "--output", default="medialis-batch", help="output folder")
    sub.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="OPERATION.PARAMETER=VALUE",
        help="a parameter that is not at its default; may be given several times",
    )
    _add_unit(sub)
    _add_up(sub)
    sub.add_argument("--workers", type=int, help="processes (default: one a processor)")
    _add_device(sub)
    sub.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="use the workers of an existing Dask scheduler instead (extra dask)",
    )
    sub.add_argument("--no-picture", action="store_true", help="draw no pictures")
    _add_report(sub, "of each result")
    sub.add_argument(
        "--fail", action="store_true", help="end with exit status 1 where a check fails"
    )
    sub.add_argument("--json", action="store_true", help="print the table as JSON")
    _add_progress(sub)


def _add_robot_balls(sub: argparse.ArgumentParser) -> None:
    sub.add_argument("file", help="a URDF file, with its meshes beside it or in folders above")
    sub.add_argument(
        "-o",
        "--output",
        action="append",
        metavar="FILE",
        help="ends in .yml (cuRobo), .srdf (MoveIt), .urdf (balls as collision elements), .xml "
        "(MuJoCo) or .json; capsules in .urdf, .xml or .json; may be given several times (default: "
        "NAME-balls.yml or NAME-capsules.xml, here)",
    )
    sub.add_argument("--balls", type=int, default=100, metavar="N", help="in all (default: 100)")
    sub.add_argument(
        "--capsules",
        action="store_true",
        help="so many capsules in place of balls: fewer hold a long link as closely",
    )
    sub.add_argument(
        "--cover",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="every point of every link lies in a ball (default), or balls are smaller by half of "
        "what they stick out",
    )
    sub.add_argument(
        "--plane",
        nargs=4,
        type=number,
        metavar=("A", "B", "C", "D"),
        help="balls of links that no joint moves keep to the side where A x + B y + C z is D or "
        "more, in the frame of the first link and in metres: 0 0 1 0 for a robot on a table",
    )
    sub.add_argument("--overwrite", action="store_true", help="replace files that are there")
    _add_processors(sub)
    sub.add_argument("--json", action="store_true", help="print the figures as one JSON object")
    _add_progress(sub)


def _add_processors(sub: argparse.ArgumentParser) -> None:
    sub.add_argument("--threads", type=int, help="use at most this many threads")
    _add_device(sub)


def _add_device(sub: argparse.ArgumentParser) -> None:
    sub.add_argument(
        "--device",
        choices=DEVICES,
        help="device for computing: cpu, gpu (an NVIDIA GPU for the steps that support it, see "
        "docs/gpu.md) or auto (default; currently the processor)",
    )


def _add_view(sub: argparse.ArgumentParser) -> None:
    sub.description, sub.epilog = _VIEW, _VIEW_EXAMPLES
    sub.formatter_class = argparse.RawDescriptionHelpFormatter
    sub.add_argument(
        "source",
        metavar="FILE|FOLDER",
        help="a mesh or point cloud, a layer or graph that medialis wrote, or a folder of results",
    )
    sub.add_argument("-o", "--output", help="the page (default: NAME-view.html, here)")
    sub.add_argument(
        "--show",
        metavar="OPERATION[,OPERATION...]",
        help="what to compute of a mesh or point cloud; the first is seen at first; '' for the "
        f"shape alone (default: {SHOWN}; with --threshold {LIMITED})",
    )
    sub.add_argument(
        "--threshold",
        metavar="LENGTH",
        help="threshold of the operation that is seen first, such as 1mm for thickness",
    )
    _add_unit(sub)
    _add_up(sub)
    sub.add_argument("--open", action="store_true", help="open the page in the browser")
    _add_processors(sub)
    _add_progress(sub)


def _add_parameter(group: Any, parameter: Parameter) -> None:
    from medialis.base.options import Kind

    flag = "--" + parameter.name.replace("_", "-")
    text = f"{parameter.full_help} (default: {parameter.default})".replace("%", "%%")
    metavars = {Kind.INT: "N", Kind.FLOAT: "NUMBER", Kind.ANGLE: "DEGREES"}
    metavars[Kind.CHOICE] = "{" + ",".join(parameter.choices) + "}"
    taken: dict[str, Any] = {"metavar": metavars.get(parameter.kind, parameter.kind.name)}
    if parameter.kind is Kind.BOOL:
        taken = {"action": argparse.BooleanOptionalAction, "default": parameter.default}
    group.add_argument(flag, dest=f"parameter_{parameter.name}", help=text, **taken)


def _add_up(sub: argparse.ArgumentParser) -> None:
    sub.add_argument(
        "--up",
        choices=AXES,
        help="the axis that points up in pictures (default: y in glTF, z in STL, 3MF, STEP, "
        "LAS and E57, what a Collada file says, else as the shape stands)",
    )


def _add_unit(sub: argparse.ArgumentParser) -> None:
    sub.add_argument(
        "--unit",
        metavar="UNIT",
        help="what one unit of the file is: mm, cm, m, in, ft, ... (default: what the file says)",
    )


def _add_report(sub: argparse.ArgumentParser, of_what: str) -> None:
    sub.add_argument(
        "--report",
        action="store_true",
        help=f"also write report.html and report.json: the quality {of_what}",
    )


def _add_progress(sub: argparse.ArgumentParser) -> None:
    """Give a command the options of its progress."""
    sub.add_argument(
        "--progress",
        choices=STYLES,
        default="auto",
        help="on stderr: a bar, a log with a line now and then, lines 'PROGRESS fraction text' for "
        "programs; auto: a bar on a terminal, else a log of a batch and nothing of a single run",
    )
    sub.add_argument(
        "-v",
        "--verbose",
        action="store_true",
        help="say more: all values and notes, and a log on stderr",
    )
