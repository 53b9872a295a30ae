"""Put the built MeshLab plugin where MeshLab looks, and tell it which Python to run.

Only files are copied here; nothing of MeshLab or of the plugin is imported.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
from pathlib import Path

from medialis.cli.machine import Machine
from medialis.errors import FileError, InvalidOptionError
from medialis.files._files import complete_file, reason

PROGRAM_NOTE = "medialis-program.txt"
"""File beside the plugin: the interpreter that has medialis, one line."""

BUILD_NOTE = "medialis-plugin.json"
"""File beside the built plugin: the version and scalar type of the MeshLab it is for."""

HOW_TO_BUILD = (
    "build it with meshlab_plugin/build.sh of the sources (docs/meshlab.md), then run "
    "medialis meshlab-install"
)


def find_built(folder: str | os.PathLike[str] = ".", machine: Machine | None = None) -> Path:
    """Return the newest plugin that `meshlab_plugin/build.sh` has built below a checkout.

    Raises
    ------
    FileError
        When there is none.
    """
    name = (machine or Machine()).plugin_name
    found = list(Path(folder).glob(f"build/plugin-*/{name}"))
    if not found:
        raise FileError(
            f"Cannot find a built plugin (build/plugin-*/{name}) in this folder: name it with "
            f"--plugin, or {HOW_TO_BUILD}."
        )
    return max(found, key=lambda path: path.stat().st_mtime)


def install(
    plugin: str | os.PathLike[str],
    *,
    folder: str | os.PathLike[str] | None = None,
    python: str | os.PathLike[str] = sys.executable,
    machine: Machine | None = None,
) -> list[Path]:
    """Copy a built plugin to where its MeshLab looks, and write down which Python it runs.

    Parameters
    ----------
    plugin : path
        The built plugin; the file `BUILD_NOTE` beside it says for which MeshLab it is.
    folder : path, optional
        The plugin folder of MeshLab; found when missing.
    python : path
        Interpreter that has medialis.
    machine : Machine, optional
        This one when missing.

    Returns
    -------
    list of paths
        The two files written.

    Raises
    ------
    FileError
        When the plugin or MeshLab is missing, or the folder may not be written.
    """
    machine, source = machine or Machine(), Path(plugin)
    if not source.is_file():
        raise FileError(f"Cannot install {source}: there is no such file; {HOW_TO_BUILD}.")
    target = Path(folder) if folder is not None else _folder_for(source, machine)
    if folder is not None and not target.is_dir():
        raise FileError(f"Cannot install into {target}: there is no such folder.")
    placed, note = target / machine.plugin_name, target / PROGRAM_NOTE
    try:
        target.mkdir(parents=True, exist_ok=True)
        # Whole files take the place of old ones: a running MeshLab keeps what it has loaded.
        with complete_file(note) as stream:
            stream.write(f"{Path(python).absolute()}\n".encode())
        with complete_file(placed) as stream, source.open("rb") as built:
            shutil.copyfileobj(built, stream)
    except OSError as error:
        why = str(error).rstrip(".") if isinstance(error, FileError) else reason(error)
        raise FileError(
            f"Cannot install into {target}: {why}; for a MeshLab of the system run it as "
            "administrator (sudo)."
        ) from None
    return [placed, note]


def _folder_for(plugin: Path, machine: Machine) -> Path:
    version, scalar = build_of(plugin)
    if not version.startswith("2020"):
        return machine.extra_folder(version, scalar)
    folders = machine.system_folders()
    if not folders:
        raise FileError(
            f"Cannot find MeshLab {version} on this machine: install it (apt install meshlab), or "
            "name its folder of plugins with --meshlab."
        )
    return folders[0]


def build_of(plugin: Path) -> tuple[str, str]:
    """Return version and scalar type of the MeshLab that a plugin was built for.

    Raises
    ------
    InvalidOptionError
        When nothing beside it tells.
    """
    try:
        about = json.loads((plugin.parent / BUILD_NOTE).read_text("utf-8"))
        return str(about["meshlab"]), str(about["scalar"])
    except (OSError, ValueError, KeyError, TypeError):
        raise InvalidOptionError(
            f"{plugin} has no readable {BUILD_NOTE} beside it that tells its MeshLab: name "
            "MeshLab's folder of plugins with --meshlab."
        ) from None
