# SPDX-License-Identifier: GPL-3.0-or-later
"""Where files of the add-on go: the folder of the extension in the user's own, and nowhere else."""

from __future__ import annotations

import tempfile
from pathlib import Path

import bpy

_temporary: tempfile.TemporaryDirectory[str] | None = None


def own_folder(name: str) -> Path:
    """Return a folder of the extension, made when missing; a passing one of a module.

    Parameters
    ----------
    name : str
        "exchange" for arrays on their way.
    """
    if __package__.startswith("bl_ext."):
        return Path(bpy.utils.extension_path_user(__package__, path=name, create=True))
    global _temporary
    if _temporary is None:
        _temporary = tempfile.TemporaryDirectory(prefix="medialis-")
    folder = Path(_temporary.name) / name
    folder.mkdir(exist_ok=True)
    return folder


def kernel_environment() -> dict[str, str]:
    """Return the variable that tells the core where it may keep compiled code.

    Kernels are made ahead of time. Were there a numba of another extension, it could compile what
    was not; where the add-on is no extension, the core's own choice of a folder stands.
    """
    if __package__.startswith("bl_ext."):
        folder = bpy.utils.extension_path_user(__package__, path="kernels", create=False)
        return {"MEDIALIS_CACHE_DIR": folder}
    return {}


def remove_passing() -> None:
    """Remove the passing folder."""
    global _temporary
    if _temporary is not None:
        _temporary.cleanup()
        _temporary = None
