# SPDX-License-Identifier: GPL-3.0-or-later
"""Make a repository of the extension that Blender can install from and update from.

    python blender_addon/packaging/build_repository.py              # index.json for dist/blender

The folder of the zips gets an `index.json` and a page, written by Blender's own tool: that of the
`blender` on the path, or of a bpy module of `make hosts`. Put the folder on any web server, or give
Blender its path as `file:///.../index.json`.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
ZIPS = ROOT / "dist" / "blender"
TOOL = "*/scripts/addons_core/bl_pkg/cli/blender_ext.py"


def extension_tool() -> list[str]:
    """Return the command of Blender's extension tool, the newest there is.

    Raises
    ------
    SystemExit
        When there is none.
    """
    blender = shutil.which("blender")
    if blender is not None:
        return [blender, "--command", "extension"]
    found = sorted(ROOT.glob(f".venv-bpy-*/lib/python*/site-packages/bpy/{TOOL}"))
    for folder in sys.path:  # this Python's own bpy, if it has one, comes last
        found += sorted((Path(folder) / "bpy").glob(TOOL))
    if not found:
        raise SystemExit("Blender's extension tool is needed: make hosts, or blender on the path.")
    return [sys.executable, str(found[-1])]


def make_repository(folder: Path) -> Path:
    """Write the index of the zips in a folder, and return it.

    Raises
    ------
    SystemExit
        When there are no zips, or the tool refuses one.
    """
    if not list(folder.glob("*.zip")):
        raise SystemExit(f"There are no zips in {folder}: `make blender` builds them.")
    command = [*extension_tool(), "server-generate", f"--repo-dir={folder}", "--html"]
    if subprocess.run(command).returncode:
        raise SystemExit("Blender's extension tool could not make the index.")
    return folder / "index.json"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path, nargs="?", default=ZIPS, help="folder of the zips")
    print(make_repository(parser.parse_args().folder.resolve()))
