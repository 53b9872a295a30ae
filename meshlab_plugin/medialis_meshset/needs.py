# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether the pymeshlab that is installed can work, told before it is loaded."""

from __future__ import annotations

import re
import sys
from importlib import metadata

OLDEST = "2023.12.post2"
"""The first pymeshlab that numpy 2 does not crash."""


def require_pymeshlab() -> None:
    """Refuse what is missing or too old; a pymeshlab that is loaded already did not crash.

    Raises
    ------
    ImportError
        With a sentence that says what to install.
    """
    if sys.modules.get("pymeshlab") is not None:
        return
    try:
        found = "" if "pymeshlab" in sys.modules else metadata.version("pymeshlab")
    except metadata.PackageNotFoundError:
        found = ""
    if not found:
        raise ModuleNotFoundError(
            "medialis needs pymeshlab for its MeshLab filters, and it is not installed: "
            "pip install medialis-meshlab",
            name="pymeshlab",
        )
    if _numbers(found) < _numbers(OLDEST):
        raise ImportError(
            f"medialis needs pymeshlab {OLDEST} or later, got {found}, which crashes with numpy 2: "
            f"pip install 'pymeshlab>={OLDEST}'",
            name="pymeshlab",
        )


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(map(int, re.findall(r"\d+", version)))
