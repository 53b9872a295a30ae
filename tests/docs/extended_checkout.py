"""A copy of the sources with the operation of CONTRIBUTING.md, added as that page says."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

from code_blocks import blocks

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "CONTRIBUTING.md"
NAME = "widest_places"
COPIED = ("core/medialis", "meshlab_plugin", "blender_addon")


def extended_checkout(folder: Path) -> Path:
    """Copy the core and the adapters, and add the folder of the page."""
    for name in COPIED:
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    feature = folder / "core" / "medialis" / NAME
    feature.mkdir()
    *files, test = (code for language, code in blocks(PAGE) if language == "python")
    for name, code in zip(("__init__", "_kernels", "operation"), files, strict=True):
        (feature / f"{name}.py").write_text(code)
    (folder / f"test_{NAME}.py").write_text(test)
    return folder


def python_path(checkout: Path) -> dict[str, str]:
    """Return the variable that lets a Python import the packages of a checkout."""
    folders = (checkout / "core", checkout / "meshlab_plugin", checkout)
    return {"PYTHONPATH": os.pathsep.join(map(str, folders))}


def run_in(checkout: Path, *arguments: str | Path) -> str:
    """Run this Python in a checkout and return what it prints."""
    done = subprocess.run(
        [sys.executable, *arguments], cwd=checkout, env={**os.environ, **python_path(checkout)},
        capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout
