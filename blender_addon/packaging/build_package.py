# SPDX-License-Identifier: GPL-3.0-or-later
"""Build the wheel of `medialis-blender`, the add-on as a package for scripts with bpy.

python blender_addon/packaging/build_package.py            # into dist
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
from build_extension import ADDON, OF_THE_PACKAGE, ROOT, core_version, extension_files

DIST = ROOT / "dist"


def build_package(folder: Path) -> Path:
    """Build the wheel from a clean copy of what the extension's zip has, and return it.

    Raises
    ------
    SystemExit
        When the versions differ, or setuptools is too old.
    """
    version = core_version()
    with tempfile.TemporaryDirectory() as temporary:
        copy = Path(temporary)
        files = [*extension_files(), *((n, ADDON / n) for n in OF_THE_PACKAGE)]
        for name, path in files:
            target = copy / name
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, target)
        options = ["--quiet", "--no-deps", "--no-build-isolation", "--no-index"]
        command = [sys.executable, "-m", "pip", "wheel", *options, "--wheel-dir", str(folder), "."]
        if subprocess.run(command, cwd=copy).returncode:
            raise SystemExit("The wheel could not be built: is setuptools 77 or later here?")
    return next(folder.glob(f"medialis_blender-{version}-*.whl"))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--output", type=Path, default=DIST, help="folder of the wheel")
    print(build_package(parser.parse_args().output))
