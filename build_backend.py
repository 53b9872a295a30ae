"""The build backend: that of setuptools, with editable installs that every folder can import.

An editable install of packages from two folders is found by a hook that Python asks last. In a
folder that holds a clone called `medialis`, Python takes the clone itself for the package before.
Paths in a .pth file are searched first; type checkers and editors read them as well.
"""

from __future__ import annotations

import base64
import hashlib
import zipfile
from pathlib import Path
from typing import Any

from setuptools import build_meta
from setuptools.build_meta import (  # noqa: F401 - the hooks that stay as they are
    build_sdist,
    build_wheel,
    get_requires_for_build_editable,
    get_requires_for_build_sdist,
    get_requires_for_build_wheel,
    prepare_metadata_for_build_editable,
    prepare_metadata_for_build_wheel,
)

SOURCES = ("core", "meshlab_plugin")
PATHS = "medialis_sources.pth"


def build_editable(
    wheel_directory: str,
    config_settings: dict[str, Any] | None = None,
    metadata_directory: str | None = None,
) -> str:
    """Build the wheel of an editable install, with a file of the paths of the sources."""
    name = build_meta.build_editable(wheel_directory, config_settings, metadata_directory)
    wheel = Path(wheel_directory) / name
    with zipfile.ZipFile(wheel) as archive:
        files = {entry: archive.read(entry) for entry in archive.namelist()}
    root = Path(__file__).resolve().parent
    files[PATHS] = "".join(f"{root / source}\n" for source in SOURCES).encode()
    digest = base64.urlsafe_b64encode(hashlib.sha256(files[PATHS]).digest()).rstrip(b"=").decode()
    record = next(entry for entry in files if entry.endswith(".dist-info/RECORD"))
    files[record] += f"{PATHS},sha256={digest},{len(files[PATHS])}\n".encode()
    with zipfile.ZipFile(wheel, "w", zipfile.ZIP_DEFLATED) as archive:
        for entry, data in files.items():
            archive.writestr(entry, data)
    return name
