# SPDX-License-Identifier: GPL-3.0-or-later
"""Put the plugin that is built for a MeshLab where that looks, with its filters and its Python.

Which MeshLabs this machine has is told by the library meshlab-common, which each of them has: it
holds its release, with a d for double precision, and a plugin is taken by that release alone. Only
files are copied here; nothing of MeshLab, pymeshlab or the plugin is imported.
"""

from __future__ import annotations

import importlib.util
import json
import os
import platform
import re
import shutil
import sys
import tempfile
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from medialis import FileError, InvalidOptionError
from medialis.hosts import Machine, complete_file, reason, write_notes

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


def hosts(machine: Machine) -> list[Host]:
    """Return every MeshLab that is found, and pymeshlab where there is no other."""
    found = list(_meshlabs(machine)) or list(_pymeshlab())
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


BUILD_NOTE = "medialis-plugin.json"
"""File beside a built plugin: the release and the system that it is for."""

HOW_TO_GET = (
    "install the built ones (pip install medialis-meshlab), then run medialis meshlab-install"
)

HOW_TO_BUILD = (
    "build it with meshlab_plugin/build.py of the sources (docs/meshlab.md), then run "
    "medialis meshlab-install"
)


@dataclass(frozen=True)
class Built:
    """A plugin as it was built: the file, and the release and the system that it is for."""

    file: Path
    release: str
    system: str

    @classmethod
    def of(cls, file: Path) -> Built:
        """Read what a built plugin is for.

        Raises
        ------
        InvalidOptionError
            When nothing beside it tells.
        """
        try:
            about = json.loads((file.parent / BUILD_NOTE).read_text("utf-8"))
            return cls(file, str(about["meshlab"]), str(about.get("system", "")))
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            raise InvalidOptionError(
                f"{file} has no readable {BUILD_NOTE} beside it that tells its MeshLab."
            ) from None


def this_system(machine: Machine) -> str:
    """Return system and processor as the build of a plugin writes them."""
    names = {"darwin": "Darwin", "win32": "Windows"}
    return f"{names.get(machine.platform, 'Linux')}-{platform.machine()}"


@contextmanager
def built_plugins(
    place: str | os.PathLike[str] | None, machine: Machine
) -> Iterator[tuple[Built, ...]]:
    """Give the built plugins for this system: of a folder or a release archive, else all known.

    Those are what `pip` has installed with medialis-meshlab, and what was built below this folder;
    the newest of a release is taken.

    Parameters
    ----------
    place : path or None
        A folder or a zip file with a folder for each plugin.
    machine : Machine

    Raises
    ------
    FileError
        When there is no such folder or archive.
    """
    with tempfile.TemporaryDirectory(prefix="medialis-") as unpacked:
        if place is None:
            folders = [*_installed(), Path("build")]
        elif zipfile.is_zipfile(place):
            with zipfile.ZipFile(place) as archive:
                archive.extractall(unpacked)
            folders = [Path(unpacked)]
        elif Path(place).is_dir():
            folders = [Path(place)]
        else:
            raise FileError(f"Cannot find {place}: it is no folder and no zip file of plugins.")
        files = [f for folder in folders for f in folder.glob(f"**/{machine.plugin_name}")]
        files.sort(key=lambda file: file.stat().st_mtime)
        noted = [Built.of(file) for file in files if (file.parent / BUILD_NOTE).is_file()]
        here = ("", this_system(machine))
        yield tuple({b.release: b for b in noted if b.system in here}.values())


def _installed() -> list[Path]:
    """Return the folder of the plugins that came with the package."""
    folder = Path(__file__).parents[1] / "medialis_meshset" / "plugins"
    return [folder] if folder.is_dir() else []


def install_wanted(
    plugins: str | None, plugin: str | None, release: str | None, folder: str | None
) -> tuple[dict[str, Path], list[FileError]]:
    """Install for all MeshLabs that are meant: `medialis meshlab-install`.

    Parameters
    ----------
    plugins : path or None
        See `built_plugins`.
    plugin : path or None
        This one, whatever it is for.
    release, folder : str or None
        See `wanted_hosts`.

    Returns
    -------
    dict, list of FileErrors
        The installed plugin by the name of the MeshLab; why others have none.

    Raises
    ------
    FileError
        When no MeshLab is found, or none has got a plugin.
    """
    machine, done, problems = Machine(), {}, []
    chosen = wanted_hosts(release, folder, machine)
    with built_plugins(plugins, machine) as built:
        for host in chosen:
            try:
                if plugin:
                    files = install(plugin, host.folder, machine=machine)
                else:
                    files = install_for(host, built, machine)
                done[host.name] = files[0]
            except FileError as error:
                problems.append(error)
    if not done:
        raise problems[0]
    return done, problems


def wanted_hosts(release: str | None, folder: str | None, machine: Machine) -> list[Host]:
    """Return the MeshLabs that are meant: a named one, or all that are found.

    Raises
    ------
    FileError
        When there is none.
    """
    if folder is not None:
        target = Path(folder)
        if not target.is_dir():
            raise FileError(f"Cannot install into {target}: there is no such folder.")
        return [Host(str(target), release or release_near(target, NEAR_PLUGINS), target)]
    found = hosts(machine)
    if release is not None:
        named = [host for host in found if host.release == release]
        return named or [user_host(release, machine)]
    if not found:
        raise FileError(
            "Cannot find MeshLab or pymeshlab on this machine. Of a MeshLab elsewhere, an AppImage "
            "for example, name the release as its Help > About says it: --release 2025.07d; or "
            "name its folder of plugins: --meshlab FOLDER."
        )
    return found


def install_for(host: Host, plugins: Sequence[Built], machine: Machine) -> list[Path]:
    """Install the plugin that is built for a MeshLab; return the files written.

    Raises
    ------
    FileError
        When there is none for it, or its folder may not be written.
    """
    match = next((built for built in plugins if built.release == host.release), None)
    if match is None:
        known = ", ".join(sorted(built.release for built in plugins)) or "none"
        precision = "double" if host.release.endswith("d") else "single"
        what = f"{host.name} ({precision} precision)" if host.release else host.name
        advice = HOW_TO_BUILD if _installed() else HOW_TO_GET
        raise FileError(
            f"There is no built plugin for {what} on {this_system(machine)}; there are: {known}. "
            f"{advice[0].upper()}{advice[1:]}."
        )
    return install(match.file, host.folder, machine=machine)


def install(
    plugin: str | os.PathLike[str],
    folder: str | os.PathLike[str],
    *,
    python: str | os.PathLike[str] = sys.executable,
    machine: Machine | None = None,
) -> list[Path]:
    """Copy a built plugin into a folder of plugins, with its filters and the Python it runs.

    Parameters
    ----------
    plugin : path
    folder : path
        Made when missing.
    python : path
        Interpreter that has medialis.
    machine : Machine, optional
        This one when missing.

    Returns
    -------
    list of paths
        The files written.

    Raises
    ------
    FileError
        When the plugin is missing, or the folder may not be written.
    """
    machine, source, target = machine or Machine(), Path(plugin), Path(folder)
    if not source.is_file():
        raise FileError(f"Cannot install {source}: there is no such file; {HOW_TO_BUILD}.")
    placed = target / machine.plugin_name
    try:
        target.mkdir(parents=True, exist_ok=True)
        # Whole files take the place of old ones: a running MeshLab keeps what it has loaded.
        notes = write_notes(target, python)
        with complete_file(placed) as stream, source.open("rb") as built:
            shutil.copyfileobj(built, stream)
    except OSError as error:
        why = str(error).rstrip(".") if isinstance(error, FileError) else reason(error)
        raise FileError(
            f"Cannot install into {target}: {why}; for a MeshLab of the system run it as "
            "administrator (sudo)."
        ) from None
    return [placed, *notes]


if __name__ == "__main__":  # as the build of the plugin does: a built one can be loaded where it is
    write_notes(sys.argv[1])
