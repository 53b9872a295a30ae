"""What is installed, what it means, what is missing and how to get it: `medialis doctor`.

Packages are imported in processes of their own: what is installed is not always what loads.
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from medialis.base.cache_folder import kernel_cache, kernels_are_compiled, written_by_others
from medialis.base.device import DEVICES
from medialis.base.errors import FileError, GpuError
from medialis.base.jit import record
from medialis.base.threads import thread_count
from medialis.base.version import package_version
from medialis.formats.files import reason
from medialis.hosts.machine import Machine
from medialis.hosts.menu import FILTER_NOTE, PROGRAM_NOTE
from medialis.show.viewer.page import has_library

NEEDED = {"numpy": "numpy", "scipy": "scipy.spatial", "llvmlite": "llvmlite", "numba": "numba"}
"""Package and the module that must load."""
TO_COMPILE = {"llvmlite", "numba"}
"""Those that are not needed where kernels are made ahead of time."""

EXTRAS = {
    "cad": ("STEP", ("cascadio",)),
    "scans": ("LAS, LAZ and E57", ("laspy", "lazrs", "pye57")),
    "io": ("glTF, Collada and more", ("trimesh", "networkx", "lxml", "pycollada")),
    "dask": ("batches on a cluster", ("dask", "distributed")),
    "completion": ("completion in shells", ("shtab",)),
    "meshlab": ("filters of pymeshlab", ("pymeshlab",)),
    "blender": ("Blender as a Python module (Python 3.11 or 3.13)", ("bpy",)),
}
"""What an extra is for, and its packages."""

MODULES = {"pycollada": "collada"}
"""Modules that are not named like their package."""

OLDEST_BLENDER = (4, 2)
NOT_HANDED_ON = ("QT_", "LD_", "DYLD_", "PYTHONHOME", "PYTHONPATH", "PYTHONSTARTUP")
"""Variables that the MeshLab plugin keeps from the Python that it runs, by their beginnings."""

NOT_FOUND = "not found on the path or in the usual places"
PATIENCE = 60
"""Seconds for a program to answer."""


@dataclass(frozen=True)
class Finding:
    """One line of the report.

    Attributes
    ----------
    name : str
    state : str
        "ok", "missing" (something optional) or "broken" (it is there or needed, and cannot work).
    text : str
        What was found and what it means.
    advice : str
        What to do about it; empty when there is nothing to do.
    """

    name: str
    state: str
    text: str
    advice: str = ""


def examine(machine: Machine | None = None) -> list[Finding]:
    """Look at the installation, the kernel cache and the hosts; changes nothing."""
    found = [
        Finding("medialis", "ok", f"{package_version()} in {Path(__file__).parent}"),
        Finding("Python", "ok", f"{platform.python_version()} ({sys.executable})"),
        Finding("system", "ok", f"{platform.platform()}, {platform.machine()}"),
    ]
    with ThreadPoolExecutor(thread_count()) as pool:
        names = [name for name in NEEDED if not (record() and name in TO_COMPILE)]
        needed = [pool.submit(_needed, name) for name in names]
        extras = [pool.submit(_extra, name) for name in EXTRAS]
        found += [future.result() for future in needed]
        found += [_threads(), *([_cache()] if found[-1].state == "ok" else []), _gpu()]
        found += [future.result() for future in extras]
    found.append(_viewer())
    try:
        machine = machine or Machine()
    except FileError as error:
        return [*found, Finding("hosts", "missing", f"not looked for: {error}")]
    return [*found, *_blender(machine), *_meshlab(machine)]


def _viewer() -> Finding:
    """Look for the library that pages in three dimensions draw with."""
    if has_library():
        return Finding("viewer", "ok", "medialis view makes pages in three dimensions")
    advice = "in a checkout, make viewer fetches it; npm is needed, which comes with Node.js"
    return Finding("viewer", "missing", "three.js, which medialis view draws with", advice)


def _call(command: Sequence[str], environment: Mapping[str, str]) -> tuple[bool, str]:
    """Return whether a program ends well, and what it says; its last line when it does not."""
    try:
        done = subprocess.run(
            command, env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True,
            errors="replace", timeout=PATIENCE,
        )  # fmt: skip
    except (OSError, ValueError) as error:
        return False, reason(error) if isinstance(error, OSError) else str(error)
    except subprocess.TimeoutExpired:
        return False, f"no answer in {PATIENCE} seconds"
    if done.returncode == 0:
        return True, done.stdout.strip()
    lines = [line.strip() for line in done.stderr.splitlines() if line.strip()]
    return False, lines[-1] if lines else f"it ended with code {done.returncode}"


def _loads(module: str) -> str:
    """Return why a module cannot be imported; empty when it can."""
    path = {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    loads, why = _call([sys.executable, "-P", "-c", f"import {module}"], {**os.environ, **path})
    return "" if loads else why


def _version(name: str) -> str:
    """Return the version of a package; nothing where it is not installed."""
    try:
        return version(name)
    except PackageNotFoundError:
        return ""


def _needed(name: str) -> Finding:
    found = _version(name)
    if not found:
        text = "not installed; nothing works without it"
        return Finding(name, "broken", text, f"pip install {name}")
    why = _loads(NEEDED[name])
    if not why:
        return Finding(name, "ok", found)
    text = f"{found} is installed and cannot be loaded: {why}"
    return Finding(name, "broken", text, f"pip install --force-reinstall {name}")


def _extra(extra: str) -> Finding:
    """Say what is there of an extra, and whether it loads."""
    (use, packages), name = EXTRAS[extra], f"extra {extra}"
    there = {package: _version(package) for package in packages}
    if missing := [package for package, found in there.items() if not found]:
        text = f"{', '.join(missing)} not installed; for {use}"
        return Finding(name, "missing", text, f'pip install "medialis[{extra}]"')
    for package in packages:
        if why := _loads(MODULES.get(package, package)):
            text = f"{package} is installed and cannot be loaded: {why}"
            return Finding(name, "broken", text, f"pip install --force-reinstall {package}")
    return Finding(name, "ok", f"{', '.join(map(' '.join, there.items()))}; for {use}")


def _threads() -> Finding:
    text = f"{thread_count()}, one for each processor that may be used; --threads takes fewer"
    if "NUMBA_NUM_THREADS" in os.environ:
        text += "; NUMBA_NUM_THREADS changes nothing here"
    return Finding("threads", "ok", text)


def _gpu() -> Finding:
    """Report the GPU, its driver, and whether kernels load and give correct results."""
    from medialis.base.gpu import kernel_names, opened_gpu

    try:
        gpu, names = opened_gpu(), kernel_names()
        for name in names:
            gpu.function(name)
    except GpuError as error:
        advice = (
            "optional: install the driver of an NVIDIA GPU for --device gpu (large clouds, views)"
        )
        return Finding("GPU", "missing", f"not used: {error}", advice)
    text = f"{gpu.name}, driver for CUDA {gpu.driver}, loads all {len(names)} kernels"
    if wrong := _wrong_on_gpu():
        return Finding("GPU", "broken", f"{text}, but {wrong}", "use --device cpu, and report it")
    return Finding("GPU", "ok", f"{text}; use it with --device gpu")


def _wrong_on_gpu() -> str:
    """Return the error of a small test on the GPU; empty if it gives the processor's balls."""
    from medialis.base.device import use_device
    from medialis.base.progress import Progress
    from medialis.shape.generate import organic_shape
    from medialis.skeleton.medial_cloud import ShrinkOptions, shrink

    found, progress = [], Progress()
    for device in DEVICES[1:]:
        with use_device(device):
            found.append(shrink(organic_shape(56), ShrinkOptions(tolerance=0.0), progress)[0])
    if failed := [str(one) for one in progress.messages if one.code == "gpu_not_used"]:
        return failed[0]
    same = found[0].centers.tobytes() == found[1].centers.tobytes()
    return "" if same else "its balls of a small shape are others than those of the processor"


def _cache() -> Finding:
    """Say whether kernels were made ahead; else where compiled ones are kept, and how many."""
    if made := record():
        size = sum(about["size"] for about in made.values()) / 1e6
        text = f"made ahead of time for this Python: {len(made)} modules, {size:.1f} MB"
        return Finding("kernels", "ok", text)
    advice = "name a folder that you alone can write to in the variable MEDIALIS_CACHE_DIR"
    folder = kernel_cache()
    places = [place for place in (folder.parent, folder) if place.is_dir()]
    if why := next(filter(None, map(written_by_others, places)), None):
        text = f"{why}, so its machine code is not run: every start compiles anew"
        return Finding("kernel cache", "missing", text, advice)
    nearest = next(path for path in [folder, *folder.parents] if os.access(path, os.F_OK))
    if not (nearest.is_dir() and os.access(nearest, os.W_OK | os.X_OK)):
        text = f"{folder} cannot be written: every start compiles anew"
        return Finding("kernel cache", "missing", text, advice)
    files = list(folder.glob("*.py{}{}.*.nbc".format(*sys.version_info)))
    size = sum(file.stat().st_size for file in files) / 1e6
    text = f"{folder}: {len(files)} kernels of this Python, {size:.1f} MB"
    if kernels_are_compiled():
        return Finding("kernel cache", "ok", f"{text}, all that there are")
    return Finding("kernel cache", "ok", f"{text}; a first run compiles what it needs",
                   "to compile all of them now: medialis warmup")  # fmt: skip


def _blender(machine: Machine) -> Iterator[Finding]:
    """Look for Blender and for the extension in the user's folders."""
    oldest = ".".join(map(str, OLDEST_BLENDER))
    get = f"get Blender {oldest} or later from blender.org"
    programs = machine.programs("blender")
    for program in programs:
        answers, text = _call([str(program), "--version"], os.environ)
        words = text.split() if answers else []
        numbers = words[1] if len(words) > 1 and words[0] == "Blender" else ""
        if not numbers:
            why = "it does not say its version" if answers else text
            yield Finding("Blender", "broken", f"{program} cannot be run: {why}", get)
        elif tuple(int(x) for x in numbers.split(".") if x.isdigit()) < OLDEST_BLENDER:
            text = f"{numbers} ({program}) is too old for the extension"
            yield Finding("Blender", "missing", text, get)
        else:
            yield Finding("Blender", "ok", f"{numbers} ({program})")
    if not programs:
        yield Finding("Blender", "missing", NOT_FOUND, get)
    manifests = machine.blender_extensions()
    yield from map(_extension, manifests)
    if not manifests:
        advice = (
            "drag the zip of the extension into Blender, or Preferences > Get Extensions > Install "
            "from Disk; `make blender` in the sources makes it"
        )
        yield Finding("  extension", "missing", "not installed for this user", advice)


def _extension(manifest: Path) -> Finding:
    """Say which version of the extension is installed for which Blender."""
    try:
        about = tomllib.loads(manifest.read_text("utf-8"))["version"]
    except (OSError, ValueError, KeyError):
        text = f"{manifest} cannot be read: Blender will not load it"
        return Finding("  extension", "broken", text, "install the extension again from its zip")
    return Finding("  extension", "ok", f"{about} in {manifest.parent}")


def _meshlab(machine: Machine) -> Iterator[Finding]:
    """Look for MeshLab, for the plugin of its filter menu, and for the Python that it runs."""
    folders = [f"plugins in {folder}" for folder in machine.system_folders()]
    places = [*map(str, machine.programs("meshlab")), *folders]
    if places:
        yield Finding("MeshLab", "ok", ", ".join(places))
    else:
        advice = "get it from meshlab.net or with your system's packages"
        yield Finding("MeshLab", "missing", NOT_FOUND, advice)
    installed = machine.plugins()
    if not installed:
        text = "not installed; for filters in MeshLab's menu"
        advice = (
            "install the built ones (pip install medialis-meshlab), then run medialis "
            "meshlab-install"
        )
        yield Finding("  plugin", "missing", text, advice)
    for plugin in installed:
        yield from (
            Finding("  plugin", "ok", str(plugin)),
            _filters_of(plugin),
            _program_of(plugin),
        )


def _filters_of(plugin: Path) -> Finding:
    """Say whether the filters beside a plugin are those of this medialis."""
    advice = "run medialis meshlab-install again"
    try:
        table = json.loads((plugin.parent / FILTER_NOTE).read_text("utf-8"))
        count, of = len(table["filters"]), table["medialis"]
    except (OSError, ValueError, KeyError, TypeError):
        text = f"no readable {FILTER_NOTE} beside the plugin: it adds nothing to the menu"
        return Finding("  its filters", "broken", text, advice)
    if of != package_version():
        text = f"{count}, of medialis {of}: this is {package_version()}"
        return Finding("  its filters", "missing", text, advice)
    return Finding("  its filters", "ok", f"{count}, of this medialis")


def _program_of(plugin: Path) -> Finding:
    """Say which Python a plugin runs and whether that has medialis."""
    advice = "run medialis meshlab-install from the Python environment that has medialis"
    try:
        python = (plugin.parent / PROGRAM_NOTE).read_text("utf-8").strip()
    except (OSError, ValueError):
        text = f"no {PROGRAM_NOTE} beside the plugin names one: it runs `medialis` from the path"
        return Finding("  its Python", "missing", text, advice)
    handed_on = {k: v for k, v in os.environ.items() if not k.startswith(NOT_HANDED_ON)}
    works, text = _call([python, "-m", "medialis", "--version"], handed_on)
    if not works:
        return Finding("  its Python", "broken", f"{python} cannot run medialis: {text}", advice)
    return Finding("  its Python", "ok", f"{python} has {text}")


def as_text(findings: Sequence[Finding]) -> str:
    """Return the report for people."""
    marks = {"ok": "ok     ", "missing": "-      ", "broken": "BROKEN "}
    width, lines = max((len(found.name) for found in findings), default=0) + 2, []
    for found in findings:
        lines.append(f"{marks[found.state]}{found.name:{width}}{found.text}")
        if found.advice:
            lines.append(f"{'':{7 + width}}-> {found.advice}")
    return "\n".join(lines)


def as_data(findings: Sequence[Finding]) -> list[dict[str, Any]]:
    """Return the report for programs."""
    return [asdict(finding) for finding in findings]
