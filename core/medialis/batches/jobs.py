"""What a batch does: one job for each file, and what is finished already."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from medialis.batches.files import READABLE, find_files, is_folder, unique_names
from medialis.errors import FileError, InvalidOptionError
from medialis.files.output_folder import MANIFEST
from medialis.kept import Described
from medialis.operations.existing_results import as_given, input_stamp, parameters_given
from medialis.operations.registry import operation
from medialis.operations.writing import THUMBNAIL, content
from medialis.progress import Progress
from medialis.units import as_unit
from medialis.version import package_version

DONE, FAILED = "done", "failed"
REPORT = "report.html"
"""The page of `medialis.reports.report.report_texts`."""


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
        Of reading and computing, and of measuring where a report is made.
    values : dict
        Counts and measures of the result.
    picture, thumbnail, report : str or None
        Paths relative to the output folder.
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
    unit : str or None
        Of all files; None: what each says.
    threads : int
        At most this many.
    picture, report : bool
        Whether to make them.
    """

    name: str
    file: str
    output: str
    operations: Mapping[str, Mapping[str, Any]]
    unit: str | None = None
    threads: int = 1
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
        folder = self.folder(operation_name)
        try:
            manifest = json.loads((folder / MANIFEST).read_bytes())
            files = {Path(name).name for name in manifest["files"]}
            same = (
                manifest["medialis"] == package_version()
                and parameters_given(manifest) == dict(self.operations[operation_name])
                and manifest["input_stamp"] == input_stamp(self.file)
                and manifest["input_unit"] == self.unit
                and (THUMBNAIL in files or not self.picture)
                and (REPORT in files or not self.report)
                and f"{operation_name}.npz" in files
                and files == {*manifest["contents"], MANIFEST}
                and _is_complete(manifest)
                and all(_is_written(folder / n, told) for n, told in manifest["contents"].items())
            )
            return self.row(manifest) if same else None
        except (OSError, ValueError, KeyError, TypeError, RecursionError):
            return None

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
        )

    def failed(self, operation_name: str, sentence: str) -> Row:
        """Return the row of an operation that gave no result."""
        return Row(self.name, self.file, operation_name, FAILED, " ".join(sentence.split()))


def _is_written(path: Path, told: Mapping[str, Any]) -> bool:
    """Whether a file holds what its manifest tells: a machine that lost power leaves empty ones."""
    same_size = path.is_file() and 0 < path.stat().st_size == told["bytes"]
    return same_size and content(path, Progress()) == told


def _is_complete(manifest: Mapping[str, Any]) -> bool:
    """Whether a manifest has what a row needs, in the types that a row has."""
    return (
        isinstance(manifest["values"], dict)
        and isinstance(manifest["messages"], list)
        and isinstance(manifest["seconds"]["total"], int | float)
    )


def _reading(given: Mapping[str, Any]) -> str | None:
    """Return the unit that files are read in, the one option of `read_shape` that a batch has."""
    if unknown := sorted(set(given) - {"unit"}):
        raise InvalidOptionError(f"read_shape has no option {', '.join(unknown)}; it has unit.")
    return as_unit(given.get("unit"))


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
    unit = _reading(given.pop("read_shape", {}))
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
        Job(
            name,
            str(path),
            os.fspath(output),
            chosen,
            unit,
            picture=picture,
            report=report,
        )
        for name, path in zip(unique_names(paths), paths, strict=True)
    ]
