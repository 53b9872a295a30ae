"""Put the plugin that is built for a MeshLab where that looks, with its filters and its Python.

Only files are copied here; nothing of MeshLab or of the plugin is imported.
"""

from __future__ import annotations

import importlib.util
import json
import os
import platform
import shutil
import sys
import tempfile
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from medialis.cli.machine import Machine
from medialis.cli.meshlab_hosts import NEAR_PLUGINS, Host, hosts, release_near, user_host
from medialis.cli.meshlab_notes import write_notes
from medialis.errors import FileError, InvalidOptionError
from medialis.files._files import complete_file, reason

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
    """Return the folder of the plugins that came with the package, whose code stays unloaded."""
    spec = importlib.util.find_spec("medialis_meshset")
    return [] if spec is None or spec.origin is None else [Path(spec.origin).parent / "plugins"]


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
        notes = write_notes(target, str(python))
        with complete_file(placed) as stream, source.open("rb") as built:
            shutil.copyfileobj(built, stream)
    except OSError as error:
        why = str(error).rstrip(".") if isinstance(error, FileError) else reason(error)
        raise FileError(
            f"Cannot install into {target}: {why}; for a MeshLab of the system run it as "
            "administrator (sudo)."
        ) from None
    return [placed, *notes]
