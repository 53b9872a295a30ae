"""Where this system and this user keep Blender, MeshLab and what belongs to them.

Where MeshLab looks for plugins:

- 2020.09 (as Debian and Ubuntu package it): in its own folder ``plugins``, for all users.
- 2021.05 and later: in ``MeshLabExtraPlugins/<version>`` of the user's data folder for MeshLab.

Blender keeps extensions in ``<version>/extensions/<repository>/<name>`` of the user's settings.
"""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from medialis.base.errors import FileError

PLUGINS = {"linux": "libfilter_medialis.so", "darwin": "libfilter_medialis.dylib"}
WINDOWS_PLUGIN = "filter_medialis.dll"

EXTENSION = "medialis/blender_manifest.toml"

USUAL_PLACES = {
    ("linux", "blender"): "opt/blender*/blender",
    ("darwin", "blender"): "Applications/Blender*.app/Contents/MacOS/Blender",
    ("win32", "blender"): "Program Files/Blender Foundation/Blender*/blender.exe",
    ("darwin", "meshlab"): "Applications/MeshLab*.app/Contents/MacOS/meshlab",
    ("win32", "meshlab"): "Program Files/VCG/MeshLab/meshlab.exe",
}
"""Programs that are not on the path: system and name, files below the root."""


def home_folder() -> Path:
    """Return the user's folder.

    Raises
    ------
    FileError
        When the system knows none.
    """
    try:
        return Path.home()
    except RuntimeError:
        raise FileError(
            "Cannot find the home folder of this user: name it in the variable HOME."
        ) from None


def _root() -> Path:
    """Return the root of the file system, on Windows that of the drive it is installed on."""
    return Path(os.environ.get("SYSTEMDRIVE", "C:") + "\\" if sys.platform == "win32" else "/")


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
        The variables ``XDG_DATA_HOME`` and ``XDG_CONFIG_HOME`` (Linux), ``APPDATA`` (Windows),
        ``BLENDER_USER_RESOURCES``, ``BLENDER_USER_EXTENSIONS``, ``PATH``.
    """

    platform: str = sys.platform
    root: Path = field(default_factory=_root)
    home: Path = field(default_factory=home_folder)
    environment: Mapping[str, str] = field(default_factory=lambda: os.environ)

    @property
    def plugin_name(self) -> str:
        """File name of the MeshLab plugin."""
        return PLUGINS.get(self.platform, WINDOWS_PLUGIN)

    @property
    def user_data(self) -> Path:
        """The user's folder for the data of applications, as Qt finds it."""
        return self._user_folder("XDG_DATA_HOME", Path(".local", "share"))

    @property
    def user_settings(self) -> Path:
        """The user's folder for the settings of applications, as Blender finds it."""
        return self._user_folder("XDG_CONFIG_HOME", Path(".config"))

    def _user_folder(self, variable: str, otherwise: Path) -> Path:
        """Return the folder that a variable names on Linux, and the one for both elsewhere."""
        if self.platform == "darwin":
            return self.home / "Library" / "Application Support"
        if self.platform == "win32":
            return Path(self.environment.get("APPDATA", self.home / "AppData" / "Roaming"))
        return Path(self.environment.get(variable) or self.home / otherwise)

    def programs(self, name: str) -> list[Path]:
        """Return where a program lies: on the path, or in the usual places."""
        found = shutil.which(name, path=self.environment.get("PATH"))
        pattern = USUAL_PLACES.get((self.platform, name))
        usual = sorted(self.root.glob(pattern)) if pattern else []
        return [*([Path(found)] if found else []), *usual]

    def blender_extensions(self) -> list[Path]:
        """Return the manifest of every installed extension, one for each Blender version."""
        name = {"darwin": "Blender", "win32": "Blender Foundation/Blender"}
        settings = self.user_settings / name.get(self.platform, "blender")
        found = list(settings.glob(f"*/extensions/*/{EXTENSION}"))
        if "BLENDER_USER_RESOURCES" in self.environment:
            named = Path(self.environment["BLENDER_USER_RESOURCES"])
            found += named.glob(f"extensions/*/{EXTENSION}")
        if "BLENDER_USER_EXTENSIONS" in self.environment:
            found += Path(self.environment["BLENDER_USER_EXTENSIONS"]).glob(f"*/{EXTENSION}")
        return sorted(found)

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

    def plugins(self) -> list[Path]:
        """Return all installed MeshLab plugins."""
        extra = self.user_data.glob(f"VCG/MeshLab_64bit_*/MeshLabExtraPlugins/*/{self.plugin_name}")
        system = [folder / self.plugin_name for folder in self.system_folders()]
        return sorted(p for p in (*extra, *system) if p.is_file())
