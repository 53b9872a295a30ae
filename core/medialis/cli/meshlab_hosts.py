"""Which MeshLabs this machine has, which plugin each of them takes, and where it looks for it.

The library meshlab-common, which each of them has, holds its release, with a d for double
precision: a plugin is taken by that release alone.
"""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from medialis.cli.machine import Machine

RELEASE = re.compile(rb"20[2-9]\d\.[01]\dd?")

LIBRARIES = ("libmeshlab-common.so", "libmeshlab-common.dylib", "meshlab-common.dll")
"""The library of a MeshLab, by system."""

NEAR_PLUGINS = ("..", "../..", "../../..", "../Frameworks", ".")
"""Where it lies, seen from the folder of plugins."""

NEAR_PROGRAM = {"darwin": "../Frameworks", "win32": "."}
"""Where it lies, seen from the program."""


@dataclass(frozen=True)
class Host:
    """A MeshLab.

    Attributes
    ----------
    name : str
        For people.
    release : str
        As in "2020.09" or, of double precision, "2025.07d".
    folder : path
        Where it looks for plugins; it may have to be made.
    """

    name: str
    release: str
    folder: Path


def release_in(library: Path) -> str:
    """Return the release that a library meshlab-common is of; empty when it does not tell."""
    try:
        found = RELEASE.search(library.read_bytes())
    except OSError:
        return ""
    return found.group().decode() if found else ""


def release_near(folder: Path, places: tuple[str, ...]) -> str:
    """Return the release of the library in one of these places; empty without one."""
    libraries = (folder / place / name for place in places for name in LIBRARIES)
    return next(filter(None, map(release_in, libraries)), "")


def hosts(machine: Machine, *, with_python: bool = True) -> list[Host]:
    """Return every MeshLab that is found, and pymeshlab where there is no other.

    Parameters
    ----------
    machine : Machine
    with_python : bool
        Look for pymeshlab in this Python.
    """
    found = list(_meshlabs(machine))
    if not found and with_python:
        found = list(_pymeshlab())
    return list({host.folder: host for host in found}.values())


def _meshlabs(machine: Machine) -> Iterator[Host]:
    for folder in machine.system_folders():
        release = release_near(folder, NEAR_PLUGINS)
        yield Host(f"MeshLab {release or 'of unknown release'}", release, folder)
    for program in machine.programs("meshlab"):
        release = release_near(program.parent, (NEAR_PROGRAM.get(machine.platform, "../lib"),))
        if release and not release.startswith("2020"):
            yield user_host(release, machine)
    for folder in sorted(machine.user_data.glob("VCG/MeshLab_64bit_*/MeshLabExtraPlugins/*")):
        if folder.is_dir() and RELEASE.fullmatch(folder.name.encode()):
            yield Host(f"MeshLab {folder.name}", folder.name, folder)


def user_host(release: str, machine: Machine) -> Host:
    """Return a MeshLab of 2021.05 or later, which looks into the folder of its user."""
    scalar = "double" if release.endswith("d") else "float"
    return Host(f"MeshLab {release}", release, machine.extra_folder(release, scalar))


def _pymeshlab() -> Iterator[Host]:
    """Look for pymeshlab without importing it: the plugin lies beside those it loads itself."""
    spec = importlib.util.find_spec("pymeshlab")
    if spec is None or spec.origin is None:
        return
    package = Path(spec.origin).parent
    for folder in (package / "lib" / "plugins", package / "PlugIns", package / "plugins"):
        release = release_near(folder, (*NEAR_PLUGINS, "../lib")) if folder.is_dir() else ""
        if release:
            yield Host(f"pymeshlab {release}", release, folder)
            return
