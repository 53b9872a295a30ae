"""What a folder holds already: no result is overwritten or mixed with another one unawares."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from medialis.errors import FileError
from medialis.files._files import absolute
from medialis.files.output_folder import MANIFEST
from medialis.options import Options
from medialis.units import Length

DIFFERENCES = {
    "operation": "of the operation {}",
    "input_stamp": "of another input or an older state of it",
    "shape": "of another shape",
    "input_unit": "in another unit",
    "medialis": "of medialis {}",
}
"""What tells results apart, and what is said of the one that is there."""


def input_stamp(file: str | os.PathLike[str]) -> list[str | int]:
    """Path, size and time of change of a file: another input under a name is another input.

    Raises
    ------
    OSError
        When there is no such file.
    """
    found = Path(file).stat()
    return [str(absolute(file)), found.st_size, found.st_mtime_ns]


def as_given(options: Options) -> dict[str, Any]:
    """Return all options by name, lengths with a unit as text."""
    return {n: str(v) if isinstance(v, Length) else v for n, v in options.values().items()}


def parameters_given(manifest: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters of a result as they were given, lengths with a unit as text."""
    return {**manifest["parameters"], **manifest.get("lengths", {})}


def manifest_in(folder: str | os.PathLike[str]) -> dict[str, Any] | None:
    """Return the manifest in a folder; empty where it is damaged, None where there is none."""
    try:
        text = (Path(folder) / MANIFEST).read_bytes()
    except (OSError, ValueError):
        return None
    try:
        found = json.loads(text)
        return found if isinstance(found, dict) else {}
    except (ValueError, RecursionError):
        return {}


def check_same(folder: str | os.PathLike[str], about: Mapping[str, Any]) -> None:
    """Refuse a folder with a result that is not the one that is about to be written there.

    Parameters
    ----------
    folder : path
    about : dict
        Entries of the new manifest, "parameters" as they were given.

    Raises
    ------
    FileError
    """
    there = manifest_in(folder)
    if there is None:
        return
    told = [
        text.format(there.get(name, "unknown"))
        for name, text in DIFFERENCES.items()
        if name in about and there.get(name) != about[name]
    ]
    if not told:
        before, now = parameters_given(there), dict(about["parameters"])
        names = [name for name in {**before, **now} if before.get(name) != now.get(name)]
        told = [f"with another {', '.join(names)}"] if names else []
    if told:
        raise _refused(folder, f"it holds a result {', '.join(told)}")


def check_free(folder: str | os.PathLike[str], names: Iterable[str]) -> None:
    """Refuse a folder that has files of these names which belong to no result.

    Raises
    ------
    FileError
    """
    own = set(files_of(manifest_in(folder)))
    taken = [name for name in names if name not in own and (Path(folder) / name).exists()]
    if taken:
        raise _refused(folder, f"there is a file {taken[0]} already, which is of no result")


def files_of(manifest: Mapping[str, Any] | None) -> list[str]:
    """Return the names of the files of a result, its manifest included."""
    try:
        return [Path(name).name for name in (manifest or {}).get("files", [])]
    except TypeError:  # damaged
        return []


def _refused(folder: str | os.PathLike[str], why: str) -> FileError:
    return FileError(
        f"Nothing was written to {os.fspath(folder)}: {why}. Name another folder, or say that it "
        "may be replaced: --overwrite (in Python overwrite=True)."
    )
