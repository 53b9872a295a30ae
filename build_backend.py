"""The build backend: that of setuptools, and four things that it does before.

- The machine code of the kernels (`core/kernel_library/build.py`), where a C compiler is there: the
  wheel is one of this system and Python then. With `MEDIALIS_PURE=1`, or without a compiler, it is
  the one for all, with which numba compiles. Editable installs have none: `make kernels`.
- The GPU kernels (`build_gpu.py` in the same folder), if their compiler is installed. Releases set
  `MEDIALIS_GPU_KERNELS=1` to require it (115 MB).
- The script that the viewer draws with, where npm is there (`core/viewer_library/build.py`).
- The long description: the README, whose links lead to the files of this version on the web.
"""

from __future__ import annotations

import os
import platform
import re
import runpy
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

from setuptools import Distribution, build_meta
from setuptools.build_meta import (  # noqa: F401 - the hooks that stay as they are
    build_sdist,
    get_requires_for_build_editable,
    get_requires_for_build_sdist,
    prepare_metadata_for_build_editable,
    prepare_metadata_for_build_wheel,
)
from setuptools.command.build_py import build_py

ROOT = Path(__file__).resolve().parent
PICTURE = re.compile(r"(!\[[^][]*\]\()(?!\w+:|#)")
LINK = re.compile(r"((?<!!)\[(?:[^][]|!\[[^][]*\])*\]\()(?!\w+:|#)")
"""Up to a target that is relative to the page."""

KERNELS = ROOT / "core" / "kernel_library" / "build.py"
GPU_KERNELS = KERNELS.with_name("build_gpu.py")
GPU_COMPILER = KERNELS.with_name("gpu_compiler.txt")


def get_requires_for_build_wheel(config_settings: dict[str, Any] | None = None) -> list[str]:
    """Ask for what kernels are made with, where they can be made."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    with_range = [one for one in project["dependencies"] if one.startswith(("numba", "threadpool"))]
    needed = [*with_range, "numpy>=2"] if why_pure() is None else []
    usual = sys.platform != "darwin" and platform.machine().lower() in ("x86_64", "amd64")
    if needed and usual and os.environ.get("MEDIALIS_GPU_KERNELS"):
        lines = GPU_COMPILER.read_text("ascii").splitlines()
        needed += [line for line in lines if not line.startswith("#")]
    return [*build_meta.get_requires_for_build_wheel(config_settings), *needed]


def why_pure() -> str | None:
    """Say why a wheel has no machine code; None when it has."""
    if os.environ.get("MEDIALIS_PURE", "") not in ("", "0"):
        return "MEDIALIS_PURE is set"
    if not KERNELS.is_file():
        return "the sources are not whole"
    why: str | None = runpy.run_path(str(KERNELS))["can_link"]()
    return why


class BuildWithKernels(build_py):
    """Copying the package into a wheel, with the machine code that was made for this Python."""

    made: tuple[Path, ...] = ()

    def run(self) -> None:
        """Copy what setuptools copies, and the modules."""
        super().run()
        for path in self.made:
            target = Path(self.build_lib) / path.relative_to(ROOT / "core")
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(path, target)


def build_wheel(
    wheel_directory: str,
    config_settings: dict[str, Any] | None = None,
    metadata_directory: str | None = None,
) -> str:
    """Build a wheel, with machine code and the viewer where they can be made."""
    make_viewer_library()
    if reason := why_pure():
        print(f"A wheel without machine code is built: {reason}.", file=sys.stderr)
    else:
        for script in (KERNELS, GPU_KERNELS):
            subprocess.run([sys.executable, str(script)], check=True, stdout=sys.stderr)
        BuildWithKernels.made = tuple(runpy.run_path(str(KERNELS))["made_files"]())
        Distribution.has_ext_modules = lambda self: True  # type: ignore[method-assign]
    return build_meta.build_wheel(wheel_directory, config_settings, metadata_directory)


def build_editable(
    wheel_directory: str,
    config_settings: dict[str, Any] | None = None,
    metadata_directory: str | None = None,
) -> str:
    """Build the wheel of an editable install, with the viewer where it can be made."""
    make_viewer_library()
    return build_meta.build_editable(wheel_directory, config_settings, metadata_directory)


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


def long_description(page: str, source: str, version: str) -> str:
    """Return a page whose links lead to the files of a version, and its pictures too."""
    page = PICTURE.sub(rf"\1{source}/raw/v{version}/", page)
    return LINK.sub(rf"\1{source}/blob/v{version}/", page)


def write_long_description() -> None:
    """Write it where pyproject.toml looks for it, before setuptools reads that."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    page = (ROOT / "README.md").read_text("utf-8")
    text = long_description(page, project["urls"]["Source"], project["version"])
    target = ROOT / "build" / "long_description.md"
    target.parent.mkdir(exist_ok=True)
    target.write_text(text, "utf-8")


write_long_description()  # every hook needs it
