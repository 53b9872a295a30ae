"""What a batch does: one job for each file, and what is finished already."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from medialis.errors import FileError, InvalidOptionError
from medialis.operations.registry import operation
from medialis.version import package_version

READABLE = (".ply", ".obj", ".off", ".stl", ".xyz", ".pts", ".glb", ".gltf", ".3mf", ".dae")
"""Files that are taken from a folder; a file that is named itself may have any ending."""

DONE, FAILED = "done", "failed"


@dataclass(frozen=True)
class Row:
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
        Of the computation and writing.
    values : dict
        Counts and measures of the result.
    picture : str or None
        Path relative to the output folder.
    """

    name: str
    file: str
    operation: str
    status: str
    sentence: str = ""
    seconds: float | None = None
    values: Mapping[str, Any] = field(default_factory=dict)
    picture: str | None = None


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
        All parameters of each operation.
    threads : int
        At most this many.
    picture : bool
    """

    name: str
    file: str
    output: str
    operations: Mapping[str, Mapping[str, Any]]
    threads: int = 1
    picture: bool = True

    def folder(self, operation_name: str) -> Path:
        """Return where the results of an operation go."""
        return Path(self.output) / self.name / operation_name

    def finished(self, operation_name: str) -> Row | None:
        """Return the row of a result that is there already, complete and of the same input.

        Same means: the same file by size and time of change, the same parameters, and the same
        version of medialis.
        """
        folder = self.folder(operation_name)
        try:
            manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
            same = (
                manifest["medialis"] == package_version()
                and manifest["parameters"] == dict(self.operations[operation_name])
                and manifest["input_stamp"] == stamp(self.file)
                and (manifest["picture"] is not None or not self.picture)
                and all((folder / Path(name).name).is_file() for name in manifest["files"])
            )
        except (OSError, ValueError, KeyError, TypeError):
            return None
        return self.row(manifest) if same else None

    def row(self, manifest: Mapping[str, Any]) -> Row:
        """Return the row of a result from its manifest."""
        picture = manifest["picture"]
        if picture is not None:
            place = self.folder(manifest["operation"]) / Path(picture).name
            picture = place.relative_to(self.output).as_posix()
        return Row(
            self.name,
            self.file,
            manifest["operation"],
            DONE,
            " ".join(manifest["messages"]),
            manifest["seconds"]["total"],
            dict(sorted(manifest["values"].items())),  # as read back from a manifest
            picture,
        )

    def failed(self, operation_name: str, sentence: str) -> Row:
        """Return the row of an operation that gave no result."""
        return Row(self.name, self.file, operation_name, FAILED, " ".join(sentence.split()))


def stamp(file: str) -> list[int]:
    """Size and time of change of a file: another input under the same name is computed anew."""
    found = Path(file).stat()
    return [found.st_size, found.st_mtime_ns]


def plan(
    operations: Sequence[str],
    files: Sequence[str | os.PathLike[str]],
    output: str | os.PathLike[str],
    *,
    parameters: Mapping[str, Mapping[str, Any]] | None = None,
    picture: bool = True,
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
    chosen = {}
    for name in operations:
        found = operation(name)
        chosen[found.name] = found.resolve(given.pop(name, given.pop(found.name, {})))
    if not chosen:
        raise InvalidOptionError("A batch needs at least one operation, got none.")
    if given:
        raise InvalidOptionError(
            f"There are parameters for {', '.join(given)}, which this batch does not run."
        )
    if Path(output).exists() and not Path(output).is_dir():
        raise FileError(
            f"Cannot write results to {os.fspath(output)}: it is a file; name a folder."
        )
    paths = [path for entry in files for path in _expand(Path(entry))]
    if not paths:
        raise InvalidOptionError(
            f"A batch needs at least one file with one of the endings {', '.join(READABLE)}; "
            "none was found."
        )
    return [
        Job(name, str(path), os.fspath(output), chosen, picture=picture)
        for name, path in zip(_unique_names(paths), paths, strict=True)
    ]


def _expand(entry: Path) -> list[Path]:
    if not entry.is_dir():
        return [entry]
    return sorted(p for p in entry.rglob("*") if p.suffix.lower() in READABLE and p.is_file())


def _unique_names(paths: Sequence[Path]) -> list[str]:
    """Stem of each file; the ending, then a number are added where stems are the same.

    Compared without case, as some file systems do.
    """
    result: list[str] = []
    stems = [path.stem.casefold() for path in paths]
    taken: set[str] = set()
    for path, stem in zip(paths, stems, strict=True):
        base = path.stem if stems.count(stem) == 1 else path.name.replace(".", "_")
        name, number = base, 1
        while name.casefold() in taken:
            number += 1
            name = f"{base}_{number}"
        taken.add(name.casefold())
        result.append(name)
    return result
