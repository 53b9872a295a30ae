"""Make the script that the viewer draws with, from the packages that package-lock.json pins.

python core/viewer_library/build.py    (needs npm; `make viewer` does it)

The script lies in the package, `core/medialis/show/viewer/three.js`; git ignores it, wheels have
it.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

FOLDER = Path(__file__).resolve().parent
ROOT = FOLDER.parent.parent
WORK = ROOT / "build" / "viewer-library"
SCRIPT = ROOT / "core" / "medialis" / "show" / "viewer" / "three.js"
SOURCES = ("package.json", "package-lock.json", "parts.js")
NPM = ("ci", "--ignore-scripts", "--no-audit", "--no-fund", "--loglevel=error")
BUNDLE = ("parts.js", "--bundle", "--minify", "--format=iife", "--global-name=THREE")
PATIENCE = 300
"""Seconds."""


def is_built() -> bool:
    """Tell whether the script is there and no older than what it is made of."""
    newest = max((FOLDER / name).stat().st_mtime for name in SOURCES)
    return SCRIPT.is_file() and SCRIPT.stat().st_mtime >= newest


def build() -> None:
    """Fetch the packages and make the script.

    Raises
    ------
    OSError, subprocess.SubprocessError
        When npm is not there, or fails.
    """
    npm = shutil.which("npm")
    if npm is None:
        raise FileNotFoundError("npm is not installed; it comes with Node.js.")
    WORK.mkdir(parents=True, exist_ok=True)
    for name in SOURCES:
        shutil.copy(FOLDER / name, WORK)
    run = {"cwd": WORK, "check": True, "timeout": PATIENCE, "stdout": sys.stderr}
    subprocess.run([npm, *NPM], **run)
    made = WORK / "three.js"
    command = [npm, "exec", "--no", "--", "esbuild", *BUNDLE, f"--outfile={made}"]
    subprocess.run([*command, "--log-level=error"], **run)
    three = json.loads((WORK / "node_modules/three/package.json").read_text("utf-8"))
    head = f"/* three.js {three['version']}, https://threejs.org, MIT licence:\n"
    licence = (WORK / "node_modules/three/LICENSE").read_text("utf-8")
    whole = WORK / "with-licence.js"
    whole.write_text(f"{head}{licence} */\n{made.read_text('utf-8')}", encoding="utf-8")
    whole.replace(SCRIPT)  # all at once


if __name__ == "__main__":
    if not is_built() or "--anew" in sys.argv:
        build()
    print(f"{SCRIPT}: {SCRIPT.stat().st_size / 1e3:.0f} kB")
