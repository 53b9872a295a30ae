"""The build backend: that of setuptools, with two things more.

It makes the script that the viewer draws with where npm is there (`core/viewer_library/build.py`).

Its editable installs are found from every folder. One of packages from two folders is found by a
hook that Python asks last: in a folder that holds a clone called `medialis`, Python takes the clone
itself for the package before. Paths in a .pth file are searched first; type checkers and editors
read them as well.
"""

from __future__ import annotations

import base64
import hashlib
import runpy
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

from setuptools import build_meta
from setuptools.build_meta import (  # noqa: F401 - the hooks that stay as they are
    build_sdist,
    get_requires_for_build_editable,
    get_requires_for_build_sdist,
    get_requires_for_build_wheel,
    prepare_metadata_for_build_editable,
    prepare_metadata_for_build_wheel,
)

ROOT = Path(__file__).resolve().parent
SOURCES = ("core", "meshlab_plugin")
PATHS = "medialis_sources.pth"


def build_wheel(
    wheel_directory: str,
    config_settings: dict[str, Any] | None = None,
    metadata_directory: str | None = None,
) -> str:
    """Build a wheel, with the viewer where it can be made."""
    make_viewer_library()
    return build_meta.build_wheel(wheel_directory, config_settings, metadata_directory)


def make_viewer_library() -> None:
    """Make the script of the viewer; without npm or the network everything else works."""
    library = ROOT / "core" / "viewer_library" / "build.py"
    if not library.is_file():
        return
    made = runpy.run_path(str(library))
    try:
        if not made["is_built"]():
            made["build"]()
    except (OSError, subprocess.SubprocessError) as error:
        print(f"The viewer was left out ({error}); `make viewer` tries again.", file=sys.stderr)


def build_editable(
    wheel_directory: str,
    config_settings: dict[str, Any] | None = None,
    metadata_directory: str | None = None,
) -> str:
    """Build the wheel of an editable install, with a file of the paths of the sources."""
    make_viewer_library()
    name = build_meta.build_editable(wheel_directory, config_settings, metadata_directory)
    wheel = Path(wheel_directory) / name
    with zipfile.ZipFile(wheel) as archive:
        files = {entry: archive.read(entry) for entry in archive.namelist()}
    files[PATHS] = "".join(f"{ROOT / source}\n" for source in SOURCES).encode()
    digest = base64.urlsafe_b64encode(hashlib.sha256(files[PATHS]).digest()).rstrip(b"=").decode()
    record = next(entry for entry in files if entry.endswith(".dist-info/RECORD"))
    files[record] += f"{PATHS},sha256={digest},{len(files[PATHS])}\n".encode()
    with zipfile.ZipFile(wheel, "w", zipfile.ZIP_DEFLATED) as archive:
        for entry, data in files.items():
            archive.writestr(entry, data)
    return name
