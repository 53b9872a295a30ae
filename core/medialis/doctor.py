"""What is installed, what is missing and how to get it: `medialis doctor`."""

from __future__ import annotations

import os
import platform
import shutil
import sys
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from medialis.version import package_version

NEEDED = ("numpy", "scipy", "numba", "llvmlite")

EXTRAS = (
    ("trimesh", "io", "reading glTF, 3MF, Collada and more"),
    ("distributed", "dask", "batch runs over many files"),
    ("pymeshlab", "meshlab", "filters in pymeshlab scripts"),
    ("bpy", "blender", "the Blender add-on in plain Python scripts"),
)
"""Package, the extra that brings it, what it is for."""

HOSTS = (
    ("Blender", ("blender",), "install the extension from its zip: docs/blender.md"),
    ("MeshLab", ("meshlab",), "the filter-menu plugin: docs/meshlab.md"),
)
"""Program, its commands, and how medialis gets into it."""


@dataclass(frozen=True)
class Finding:
    """One line of the report.

    Attributes
    ----------
    name : str
    state : str
        "ok", "missing" (something optional) or "broken" (medialis cannot work).
    text : str
        What was found, or how to get it.
    """

    name: str
    state: str
    text: str


def examine() -> list[Finding]:
    """Look at the installation, the kernel cache and the hosts; changes nothing."""
    found = [
        Finding("medialis", "ok", f"{package_version()} in {Path(__file__).parent}"),
        Finding("Python", "ok", f"{platform.python_version()} ({sys.executable})"),
        Finding("system", "ok", f"{platform.platform()}, {platform.machine()}"),
    ]
    found += [_package(name, "broken", f"pip install {name}") for name in NEEDED]
    found += _kernels()
    found += [
        _package(name, "missing", f'{use}: pip install "medialis[{extra}]"')
        for name, extra, use in EXTRAS
    ]
    for name, commands, how in HOSTS:
        place = next((path for c in commands if (path := shutil.which(c))), None)
        text = f"{place}; {how}" if place else f"not on the PATH; {how}"
        found.append(Finding(name, "ok" if place else "missing", text))
    return found


def _package(name: str, otherwise: str, how: str) -> Finding:
    try:
        return Finding(name, "ok", version(name))
    except PackageNotFoundError:
        return Finding(name, otherwise, how)


def _kernels() -> list[Finding]:
    """Threads, and whether compiled kernels can be kept and are there."""
    from medialis.threads import thread_count

    found = [Finding("threads", "ok", str(thread_count()))]
    try:
        from medialis._kernels.jit import kernel_cache
    except Exception as error:  # noqa: BLE001 - a broken numba raises anything, and that is the news
        why = " ".join(str(error).split())
        return [*found, Finding("kernels", "broken", f"numba cannot be loaded: {why}")]
    folder = kernel_cache()
    nearest = next(path for path in [folder, *folder.parents] if path.exists())
    if not os.access(nearest, os.W_OK):
        text = f"{folder} cannot be written: every start compiles anew; set MEDIALIS_CACHE_DIR"
        return [*found, Finding("kernel cache", "missing", text)]
    files = list(folder.glob("*.nbc"))
    size = sum(file.stat().st_size for file in files) / 1e6
    text = f"{folder}: {len(files)} kernels, {size:.1f} MB"
    if not files:
        text = f"{folder}: empty, the first run compiles; `medialis warmup` does it now"
    return [*found, Finding("kernel cache", "ok", text)]


def as_text(findings: list[Finding]) -> str:
    """Return the report for people."""
    marks = {"ok": "ok     ", "missing": "-      ", "broken": "BROKEN "}
    return "\n".join(f"{marks[f.state]}{f.name:14}{f.text}" for f in findings)


def as_data(findings: list[Finding]) -> list[dict[str, Any]]:
    """Return the report for programs."""
    return [asdict(finding) for finding in findings]
