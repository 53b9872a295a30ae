"""Which files a batch takes, and what its shapes are called."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from pathlib import Path

from medialis.files._files import absolute

READABLE = (
    *(".ply", ".obj", ".off", ".stl", ".xyz", ".pts", ".glb", ".gltf", ".3mf", ".dae"),
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
        results = _results(folder)
        for file in files:
            path = folder / file
            if path.suffix.lower() not in READABLE or file.startswith(".") or file in results:
                continue
            if path.is_file():
                yield path


def _results(folder: Path) -> set[str]:
    """Return the names of the files that medialis has written here: its manifest tells."""
    try:
        manifest = json.loads((folder / "manifest.json").read_bytes())
        return {Path(file).name for file in manifest["files"]} if "medialis" in manifest else set()
    except (OSError, ValueError, TypeError, KeyError, RecursionError):
        return set()


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
