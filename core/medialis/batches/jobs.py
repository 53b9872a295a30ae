"""What a batch does: one job for each file, what is finished already, what a worker does.

`plan` finds the files and names their shapes; `Job` knows where results go and which are there;
`run_job` reads one shape, runs the operations, and writes each result all or nothing.
"""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from medialis.base.arrays import Described
from medialis.base.device import Device
from medialis.base.disk import Folder
from medialis.base.errors import Cancelled, FileError, InvalidOptionError, MedialisError
from medialis.base.kept import forget
from medialis.base.options import as_unit
from medialis.base.progress import Progress
from medialis.base.threads import thread_limit
from medialis.base.validation import AXES, as_choice
from medialis.base.version import package_version
from medialis.formats.files import absolute
from medialis.formats.json_npz import json_text
from medialis.formats.output_folder import MANIFEST
from medialis.operations.registry import operation, run
from medialis.shape.reading import read_shape
from medialis.shape.shape import Shape
from medialis.show.writing import (
    THUMBNAIL,
    Pictures,
    Written,
    as_given,
    content,
    files_of,
    input_stamp,
    manifest_in,
    parameters_given,
    write_files,
)

READABLE = (
    *(".ply", ".obj", ".off", ".stl", ".xyz", ".pts", ".glb", ".gltf", ".3mf", ".dae"),
    *(".vtp", ".pcd", ".las", ".laz", ".e57"),
    *(".step", ".stp"),
)
"""Files that are taken from a folder; a file that is named itself may have any ending."""

TABLES = ("results.csv", "results.html")
"""Files beside the folders of the shapes."""


def find_files(entries: Sequence[str | os.PathLike[str]], output: Path) -> list[Path]:
    """Return the files of a batch, each once; a folder stands for the meshes in it, sorted.

    Left out of folders: what is hidden, the output, and results of medialis.
    """
    found: dict[Path, Path] = {}
    for entry in map(Path, entries):
        for path in sorted(_meshes(entry, output)) if is_folder(entry) else [entry]:
            found.setdefault(absolute(path), path)
    return list(found.values())


def is_folder(path: Path) -> bool:
    """Whether there is a folder of this name; one that no system takes names none."""
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False


def _meshes(entry: Path, output: Path) -> Iterator[Path]:
    top, out = absolute(entry).resolve(), absolute(output).resolve()
    for name, inner, files in os.walk(entry):
        folder = Path(name)
        inside = top / folder.relative_to(entry)
        inner[:] = [n for n in inner if not n.startswith(".") and inside / n != out]
        there = manifest_in(folder) or {}
        results = files_of(there) if "medialis" in there else ()
        for file in files:
            path = folder / file
            known = path.suffix.lower() in READABLE and not file.startswith(".")
            if known and file not in results and path.is_file():
                yield path


def unique_names(paths: Sequence[Path]) -> list[str]:
    """Name each file by its stem; where stems are the same, by what tells the files apart.

    That is the ending (a_ply, a_stl), else the folders (x_a, y_a), else both, else a number. Names
    are compared without case, as some file systems do.
    """
    groups: dict[str, list[int]] = {}
    for place, path in enumerate(paths):
        groups.setdefault(path.stem.casefold(), []).append(place)
    result = [""] * len(paths)
    taken = set(TABLES)
    for members in groups.values():
        bases = _told_apart([paths[place] for place in members])
        for place, base in zip(members, bases, strict=True):
            # `...ply` has the stem `..`, which is the folder above.
            base = base if base.strip(".") else paths[place].name.replace(".", "_")
            name, number = base, 1
            while name.casefold() in taken:
                number += 1
                name = f"{base}_{number}"
            taken.add(name.casefold())
            result[place] = name
    return result


def _told_apart(paths: Sequence[Path]) -> list[str]:
    if len(paths) == 1:
        return [paths[0].stem]
    parents = [path.absolute().parent.parts for path in paths]
    levels = enumerate(zip(*parents, strict=False))
    shared = next((k for k, level in levels if len(set(level)) > 1), min(map(len, parents)))
    folders = ["".join(f"{part.rstrip(':/' + os.sep)}_" for part in p[shared:]) for p in parents]
    endings = [path.name.replace(".", "_") for path in paths]
    names = endings
    for names in (
        endings,
        [folder + path.stem for folder, path in zip(folders, paths, strict=True)],
        [folder + ending for folder, ending in zip(folders, endings, strict=True)],
    ):
        if len({name.casefold() for name in names}) == len(names):
            break
    return names


DONE, FAILED = "done", "failed"
REPORT = "report.html"
"""The page of `medialis.show.reports.report.report_texts`."""


@dataclass(frozen=True, repr=False)
class Row(Described):
    """One line of the table: what became of one operation on one shape.

    Attributes
    ----------
    name : str
        Of the shape in this batch, and of its folder.
    file : str
        As it was named.
    operation : str
    status : str
        "done" or "failed".
    sentence : str
        Why it failed; for a result, what it says about the shape (repaired, refined, ...).
    seconds : float or None
        Of computing.
    values : dict
        Counts and measures of the result.
    picture, thumbnail, report : str or None
        Paths relative to the output folder.
    unit : str or None
        Of the lengths among the values; None: not known.
    """

    name: str
    file: str
    operation: str
    status: str
    sentence: str = ""
    seconds: float | None = None
    values: Mapping[str, Any] = field(default_factory=dict)
    picture: str | None = None
    thumbnail: str | None = None
    report: str | None = None
    unit: str | None = None

    @property
    def numbers(self) -> dict[str, Any]:
        """Values that fit into a table: numbers and words; lists are for the manifest."""
        return {k: v for k, v in self.values.items() if isinstance(v, int | float | str)}


@dataclass(frozen=True)
class Job:
    """All operations on one file.

    Attributes
    ----------
    name : str
        Unique in the batch.
    file : str
    output : str
        Folder of the batch; results go to ``output/name/operation``.
    operations : dict of dict
        All parameters of each operation; lengths with a unit are text.
    unit, up : str or None
        Of all files; None: what each says.
    threads : int
    device : {"auto", "cpu", "gpu"}
        At most this many.
    picture, report : bool
        Whether to make them.
    """

    name: str
    file: str
    output: str
    operations: Mapping[str, Mapping[str, Any]]
    unit: str | None = None
    up: str | None = None
    threads: int = 1
    device: Device = "auto"
    picture: bool = True
    report: bool = False

    def folder(self, operation_name: str) -> Path:
        """Return where the results of an operation go."""
        return Path(self.output) / self.name / operation_name

    def finished(self, operation_name: str) -> Row | None:
        """Return the row of a result that is there already, complete and of the same input.

        Same means: the same file by path, size and time of change, the same parameters, and the
        same version of medialis. A manifest that is damaged is none; so is one whose files have
        other contents than it lists.
        """
        try:
            with Folder.at(self.folder(operation_name), self.output) as folder:
                return self._finished(folder, operation_name)
        except (OSError, ValueError, KeyError, TypeError, RecursionError):
            return None

    def _finished(self, folder: Folder, operation_name: str) -> Row | None:
        """Return the row of a result in an open folder; whatever is wrong with it raises."""
        manifest = json.loads(folder.read(MANIFEST))
        files = {Path(name).name for name in manifest["files"]}
        same = (
            manifest["medialis"] == package_version()
            and parameters_given(manifest) == dict(self.operations[operation_name])
            and manifest["input_stamp"] == input_stamp(self.file)
            and manifest["input_unit"] == self.unit
            and manifest["input_up"] == self.up
            and (THUMBNAIL in files or not self.picture)
            and (REPORT in files or not self.report)
            and f"{operation_name}.npz" in files
            and files == {*manifest["contents"], MANIFEST}
            and _is_complete(manifest)
            and all(_is_written(folder, n, told) for n, told in manifest["contents"].items())
        )
        return self.row(manifest) if same else None

    def row(self, manifest: Mapping[str, Any]) -> Row:
        """Return the row of a result from its manifest, as it is read back from its file."""
        files = [Path(name).name for name in manifest["files"]]
        place = self.folder(manifest["operation"]).relative_to(self.output)

        def path(name: str) -> str | None:
            return (place / name).as_posix() if name in files else None

        return Row(
            self.name,
            self.file,
            manifest["operation"],
            DONE,
            " ".join(manifest["messages"]),
            manifest["seconds"]["total"],
            manifest["values"],
            None if manifest["picture"] is None else path(Path(manifest["picture"]).name),
            path(THUMBNAIL),
            path(REPORT),
            manifest["unit"],
        )

    def failed(self, operation_name: str, sentence: str) -> Row:
        """Return the row of an operation that gave no result."""
        return Row(self.name, self.file, operation_name, FAILED, " ".join(sentence.split()))


def _is_written(folder: Folder, name: str, told: Mapping[str, Any]) -> bool:
    """Whether a file holds what its manifest tells: a machine that lost power leaves empty ones."""
    about = folder.about(name)
    if about is None or not 0 < about.st_size == told["bytes"]:
        return False
    with folder.open(name) as stream:
        return content(stream, Progress()) == told


def _is_complete(manifest: Mapping[str, Any]) -> bool:
    """Whether a manifest has what a row needs, in the types that a row has."""
    return (
        isinstance(manifest["values"], dict)
        and isinstance(manifest["messages"], list)
        and isinstance(manifest["seconds"]["total"], int | float)
    )


def _reading(given: Mapping[str, Any]) -> tuple[str | None, str | None]:
    """Return the options of `read_shape` that a batch has: `unit`, and the axis that points up."""
    if unknown := sorted(set(given) - {"unit", "up"}):
        raise InvalidOptionError(
            f"read_shape has no option {', '.join(unknown)} here; it has unit and up."
        )
    up = given.get("up")
    known = None if up is None else as_choice(up, "up", AXES)
    return as_unit(given.get("unit")), known


def plan(
    operations: Sequence[str],
    files: Sequence[str | os.PathLike[str]],
    output: str | os.PathLike[str],
    *,
    parameters: Mapping[str, Mapping[str, Any]] | None = None,
    picture: bool = True,
    report: bool = False,
) -> list[Job]:
    """Return one job for each file, in the given order; folders stand for the meshes in them.

    Raises
    ------
    InvalidOptionError
        When there is no operation or file, or a parameter is wrong.
    FileError
        When the output is a file. A missing input file is a failed row, not an error.
    """
    given = dict(parameters or {})
    unit, up = _reading(given.pop("read_shape", {}))
    chosen = {}
    for name in operations:
        found = operation(name)
        options = found.resolve(given.pop(name, given.pop(found.name, {})))
        chosen[found.name] = as_given(options)
    if not chosen:
        raise InvalidOptionError("A batch needs at least one operation, got none.")
    if given:
        raise InvalidOptionError(
            f"There are parameters for {', '.join(given)}, which this batch does not run."
        )
    if os.path.lexists(output) and not is_folder(Path(output)):
        raise FileError(
            f"Cannot write results to {os.fspath(output)}: it is a file; name a folder."
        )
    paths = find_files(files, Path(output))
    if not paths:
        raise InvalidOptionError(
            f"A batch needs at least one file with one of the endings {', '.join(READABLE)}; "
            "none was found."
        )
    return [
        Job(name, str(path), os.fspath(output), chosen, unit, up, picture=picture, report=report)
        for name, path in zip(unique_names(paths), paths, strict=True)
    ]


logger = logging.getLogger(__name__)

NO_MEMORY = "There is not enough memory for this shape and these options."


def run_job(job: Job) -> list[Row]:
    """Run what is not finished of a job; an error becomes a row, and never leaves here.

    The shape is read once, and what one operation computed on it is found by the next one; nothing
    is kept for the next shape. Returns one row for each operation.
    """
    try:
        return _rows(job)
    finally:
        forget()


def _rows(job: Job) -> list[Row]:
    rows: list[Row] = []
    shape: Shape | None = None
    stamp: list[str | int] = []
    unreadable: str | None = None
    reading = Progress()
    for name in job.operations:
        row = job.finished(name)
        if row is None and unreadable is None:
            try:
                with thread_limit(job.threads):
                    if shape is None:
                        with suppress(OSError, ValueError):  # reading tells what is wrong
                            stamp = input_stamp(job.file)
                        shape = read_shape(job.file, unit=job.unit, up=job.up, progress=reading)
                    row = _run_operation(job, name, shape, stamp, reading)
            except Exception as error:  # noqa: BLE001 - one shape never stops the others
                row = job.failed(name, _sentence(error))
                unreadable = row.sentence if shape is None else None
        rows.append(row or job.failed(name, unreadable or ""))
    return rows


def _run_operation(
    job: Job, name: str, shape: Shape, stamp: list[str | int], reading: Progress
) -> Row:
    """Run an operation and write its result; `reading` is the progress of the shape."""
    progress = Progress()
    progress.messages.extend(reading.messages)
    of_machine: dict[str, Any] = {"threads": job.threads, "device": job.device}
    result = run(name, shape, progress=progress, **of_machine, **job.operations[name])
    texts = {}
    if job.report:
        from medialis.show.reports.report import report_texts

        texts = report_texts(result, source=job.file)
    wanted = Written(
        job.file,
        Pictures(main=job.picture, thumbnail=job.picture),
        texts=texts,
        record={"input_stamp": stamp, "input_unit": job.unit, "input_up": job.up},
        overwrite=True,  # a batch owns its folder, and computes anew what is not as it should be
        below=job.output,
    )
    manifest = write_files(result, job.folder(name), wanted, progress)
    # As it is read back: a resumed batch must give the same table.
    return job.row(json.loads(json_text(manifest)))


def _sentence(error: Exception) -> str:
    if isinstance(error, MedialisError) and not isinstance(error, Cancelled):
        return str(error)
    if isinstance(error, MemoryError):
        return NO_MEMORY
    logger.exception("unexpected error")
    return f"Unexpected error, please report it: {type(error).__name__}: {error}"
