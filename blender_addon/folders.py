# SPDX-License-Identifier: GPL-3.0-or-later
"""Where files of the add-on go: the folder of the extension in the user's own, and nowhere else."""

from __future__ import annotations

import tempfile
from pathlib import Path

import bpy

_temporary: tempfile.TemporaryDirectory[str] | None = None


def exchange() -> Path:
    """Return the folder of this process for arrays on their way: no other Blender uses it.

    It goes with Blender; after a crash the process that computes takes it away.
    """
    global _temporary
    if _temporary is None:
        inside = None
        if __package__.startswith("bl_ext."):
            inside = bpy.utils.extension_path_user(__package__, path="exchange", create=True)
        _temporary = tempfile.TemporaryDirectory(prefix="medialis-", dir=inside)
    return Path(_temporary.name)


def kernel_environment() -> dict[str, str]:
    """Return the variable that tells the core where it may keep compiled code.

    Kernels are made ahead of time. Were there a numba of another extension, it could compile what
    was not; where the add-on is no extension, the core's own choice of a folder stands.
    """
    if __package__.startswith("bl_ext."):
        folder = bpy.utils.extension_path_user(__package__, path="kernels", create=False)
        return {"MEDIALIS_CACHE_DIR": folder}
    return {}


def remove_exchange() -> None:
    """Remove the folder of this process."""
    global _temporary
    if _temporary is not None:
        _temporary.cleanup()
        _temporary = None
