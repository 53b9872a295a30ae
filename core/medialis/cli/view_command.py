"""The command `view`: a page that shows a file or results in three dimensions."""

from __future__ import annotations

import argparse
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING

from medialis.base.errors import InvalidOptionError, MedialisError
from medialis.cli.display import say, shown_progress

if TYPE_CHECKING:
    from medialis.base.progress import Progress
    from medialis.operations.result import Outcome


def run_view(options: argparse.Namespace) -> int:
    """Make the page and say where it is."""
    from medialis.show.viewer.page import write_viewer

    source = Path(options.source)
    output = Path(options.output or f"{source.resolve().stem}-view.html")
    progress = shown_progress(options.progress)
    results = _results(source, options, progress)
    with progress.stage("page", 0.95, 1.0):
        write_viewer(output, results, source.resolve().name)
    say(f"{output} ({output.stat().st_size / 1e6:.1f} MB): open it in a browser.")
    if options.open:
        webbrowser.open(output.resolve().as_uri())
    return 0


def _results(source: Path, options: argparse.Namespace, progress: Progress) -> list[Outcome]:
    if source.is_dir():
        return _of_folder(source)
    if (layer := _of_layer(source)) is not None:
        return [layer]
    return _computed(source, options, progress)


def _of_folder(folder: Path) -> list[Outcome]:
    """Read the result of a folder, or those of the folders in it.

    Raises
    ------
    InvalidOptionError
        When there is none, or they are of several shapes.
    """
    from medialis.formats.output_folder import MANIFEST
    from medialis.show.reading import read_result

    folders = sorted(
        path.parent for path in [*folder.glob(MANIFEST), *folder.glob(f"*/{MANIFEST}")]
    )
    if not folders:
        inside = sorted({path.parents[1] for path in folder.glob(f"*/*/{MANIFEST}")})
        more = f" Name one shape, such as {inside[0]}." if inside else ""
        raise InvalidOptionError(f"{folder} holds no results.{more}")
    results = [read_result(path) for path in folders]
    size = results[0].shape.diagonal
    if any(abs(result.shape.diagonal - size) > 0.01 * size for result in results):
        raise InvalidOptionError(
            f"{folder} holds results of several shapes. Name one, such as {folders[0]}."
        )
    return list(results)


def _of_layer(file: Path) -> Outcome | None:
    """Read a layer or a graph that medialis wrote; None for any other file."""
    from medialis.curves.formats import read_curve_skeleton
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
    try:
        with file.open("rb") as stream:
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

    names = [operation(name).name for name in filter(None, options.show.split(","))]
    with progress.stage("input", 0.0, 0.05):
        shape = read_shape(file, progress=progress)
    results: list[Outcome] = []
    for number, name in enumerate(names):
        start, width = 0.05 + 0.9 * number / len(names), 0.9 / len(names)
        try:
            with progress.stage(name, start, start + width):
                results.append(run(name, shape, threads=options.threads, progress=progress))
        except MedialisError as error:
            if number == len(names) - 1 and not results:
                raise
            say(f"note: {name} was left out: {error}")
    return results or [Outcome(shape=shape)]
