"""Code blocks of Markdown pages, run as a reader would."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def blocks(page: Path) -> list[tuple[str, str]]:
    """Language and text of all code blocks that name their language."""
    return BLOCK.findall(page.read_text(encoding="utf-8"))


def run_python(code: str, page: Path, names: dict[str, Any]) -> None:
    """Run a block with the names that earlier ones have made."""
    exec(compile(code, f"{page.name}, a code block", "exec"), names)


def run_bash(code: str, folder: Path, environment: Mapping[str, str] | None = None) -> str:
    """Run a block in a folder, with this Python's `medialis` as the command; return its output."""
    programs = folder / "programs"
    programs.mkdir(exist_ok=True)
    command = programs / "medialis"
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m medialis "$@"\n')
    command.chmod(0o755)
    known = {**os.environ, **(environment or {})}
    known["PATH"] = f"{programs}{os.pathsep}{known['PATH']}"
    done = subprocess.run(
        ["bash", "-ec", code], cwd=folder, env=known, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    return done.stdout
