"""Put the built MeshLab plugin where MeshLab looks, tell it which Python to run, and check both.

Only files are copied here; nothing of MeshLab or of the plugin is imported. Where MeshLab looks:

- 2020.09 (as Debian and Ubuntu package it): in its own folder ``plugins``, for all users.
- 2021.05 and later: in ``MeshLabExtraPlugins/<version>`` of the user's data folder for MeshLab.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from medialis.errors import FileError, InvalidOptionError
from medialis.io._files import complete_file, reason

PROGRAM_NOTE = "medialis-program.txt"
"""File beside the plugin: the interpreter that has medialis, one line."""

BUILD_NOTE = "medialis-plugin.json"
"""File beside the built plugin: the version and scalar type of the MeshLab it is for."""

NAMES = {"linux": "libfilter_medialis.so", "darwin": "libfilter_medialis.dylib"}
WINDOWS_NAME = "filter_medialis.dll"
HOW_TO_BUILD = (
    "build it with meshlab_plugin/build.sh (docs/meshlab.md), then run medialis meshlab-install"
)
_LEFT_OUT = ("QT_", "LD_", "DYLD_", "PYTHONHOME", "PYTHONPATH", "PYTHONSTARTUP")


@dataclass(frozen=True)
class Machine:
    """Where to look: the system and the user; tests give a folder that plays both.

    Attributes
    ----------
    platform : str
        As `sys.platform`.
    root : path
        The root of the file system.
    home : path
        The user's folder.
    environment : mapping
        The variables ``XDG_DATA_HOME`` (Linux), ``APPDATA`` (Windows), ``PATH``.
    """

    platform: str = sys.platform
    root: Path = Path("/")
    home: Path = field(default_factory=Path.home)
    environment: Mapping[str, str] = field(default_factory=lambda: os.environ)

    @property
    def plugin_name(self) -> str:
        """File name of the plugin."""
        return NAMES.get(self.platform, WINDOWS_NAME)

    @property
    def user_data(self) -> Path:
        """The user's folder for the data of applications, as Qt finds it."""
        if self.platform == "darwin":
            return self.home / "Library" / "Application Support"
        if self.platform == "win32":
            return Path(self.environment.get("APPDATA", self.home / "AppData" / "Roaming"))
        return Path(self.environment.get("XDG_DATA_HOME") or self.home / ".local" / "share")

    def extra_folder(self, version: str, scalar: str) -> Path:
        """Folder of plugins that the user adds to MeshLab 2021.05 or later."""
        name = f"MeshLab_64bit_{'dp' if scalar == 'double' else 'fp'}"
        return self.user_data / "VCG" / name / "MeshLabExtraPlugins" / version

    def system_folders(self) -> list[Path]:
        """Existing plugin folders of a MeshLab 2020.09 of this system."""
        if self.platform != "linux":
            return []
        patterns = ("usr/lib/*/meshlab/plugins", "usr/lib/meshlab/plugins",
                    "usr/local/lib/meshlab/plugins")  # fmt: skip
        return sorted(p for pattern in patterns for p in self.root.glob(pattern) if p.is_dir())

    def installed(self) -> list[Path]:
        """All installed plugins."""
        extra = self.user_data.glob(f"VCG/MeshLab_64bit_*/MeshLabExtraPlugins/*/{self.plugin_name}")
        system = [folder / self.plugin_name for folder in self.system_folders()]
        return sorted(p for p in (*extra, *system) if p.is_file())


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


@dataclass(frozen=True)
class Finding:
    """One line of the doctor: what was looked for, whether it is all right, what to do if not."""

    ok: bool
    text: str
    advice: str = ""


def diagnose(machine: Machine | None = None) -> list[Finding]:
    """Return what is there and what is missing for the filters in MeshLab's menu."""
    machine = machine or Machine()
    program = shutil.which("meshlab", path=machine.environment.get("PATH"))
    folders = machine.system_folders()
    found = [f"program {program}"] * bool(program) + [f"plugins in {p}" for p in folders]
    findings = [
        Finding(True, f"MeshLab: {', '.join(found)}.")
        if found
        else Finding(
            False,
            "MeshLab: not found in the usual places.",
            "Install it from meshlab.net or with your system's packages; one that lies elsewhere "
            "works too, with meshlab-install --meshlab FOLDER.",
        )
    ]
    installed = machine.installed()
    if not installed:
        advice = HOW_TO_BUILD[:1].upper() + HOW_TO_BUILD[1:] + "."
        findings.append(Finding(False, "Plugin: not installed.", advice))
    for plugin in installed:
        findings.append(Finding(True, f"Plugin: {plugin}."))
        findings.append(_program_of(plugin))
    return findings


def _program_of(plugin: Path) -> Finding:
    """Say which Python a plugin runs and whether that has medialis."""
    advice = "Run medialis meshlab-install from the Python environment that has medialis."
    try:
        python = (plugin.parent / PROGRAM_NOTE).read_text("utf-8").strip()
    except (OSError, ValueError):
        return Finding(False, f"Python: no {PROGRAM_NOTE} beside the plugin names one.", advice)
    environment = {k: v for k, v in os.environ.items() if not k.startswith(_LEFT_OUT)}
    try:
        done = subprocess.run(
            [python, "-m", "medialis", "--version"],
            env=environment, capture_output=True, text=True, timeout=60,
        )  # fmt: skip
    except (OSError, ValueError, subprocess.TimeoutExpired):
        return Finding(False, f"Python: {python} cannot be run.", advice)
    if done.returncode != 0:
        return Finding(False, f"Python: {python} has no medialis.", advice)
    return Finding(True, f"Python: {python} has {done.stdout.strip()}.")
