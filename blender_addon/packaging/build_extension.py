# SPDX-License-Identifier: GPL-3.0-or-later
"""Build the Blender extension: one zip for each system, with the wheels for all its Blenders.

    python blender_addon/packaging/build_extension.py               # this system, into dist/blender
    python blender_addon/packaging/build_extension.py --core FOLDER # all whose core is in FOLDER
    python blender_addon/packaging/build_extension.py --kernels     # machine code for this Python

The wheels of scipy and threadpoolctl are pinned by version and hash in the `wheels-*.txt` beside
this file and bundled unmodified. numpy is Blender's own. The core has a wheel for each system and
Python, with its kernels made ahead of time, so that no compiler is bundled. Those of this system
are built from the sources, those of others on these, by the release workflow. The same sources,
kernels and setuptools give the same bytes. This folder is not shipped.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

PACKAGING = Path(__file__).resolve().parent
ADDON = PACKAGING.parent
SOURCES = ("*.py", "*.pyi", "py.typed", "*.css", "*.html", "*.js", "*.npz", "*.toml", "*.txt")
"""Files of the core that its wheel has."""
ROOT = ADDON.parent
MANIFEST = "blender_manifest.toml"
WHEELS = ROOT / "build" / "wheels"
ZIPS = ROOT / "dist" / "blender"
BUILDERS = ROOT / "build"
"""Where the environments are that make kernels, one for each Python."""
LEFT_OUT = {"three.js"}
"""The library of the viewer in a browser, which the extension does not open."""
LARGEST_ZIP = {1: 50_000_000, 2: 90_000_000}
"""Bytes, by the number of Pythons."""
OF_THE_PACKAGE = ("pyproject.toml", "README.md")
NOT_SHIPPED = {"packaging", "examples", "__pycache__", *OF_THE_PACKAGE}
BLENDERS = {"3.11": ("4.2.0", "5.1.0"), "3.13": ("5.1.0", None)}
"""For each Python: the first Blender that has it, and the first that has it no more."""


@dataclass(frozen=True)
class System:
    """One zip: the name that Blender has for a system, and the Pythons of its Blenders there.

    Attributes
    ----------
    tags : tuple of str
        What pip calls it. Blender 4.2 needs glibc 2.28 too, so no Linux wheel asks for more.
    core : str
        Pattern of the platform in the name of a core's wheel.
    """

    name: str
    pythons: tuple[str, ...]
    tags: tuple[str, ...]
    core: str

    def zip_name(self, version: str, pythons: Sequence[str] = ()) -> str:
        """Return the file name a user chooses by: their system, and the Python if it has one only.

        Parameters
        ----------
        pythons : sequence of str
            Those that the zip is for; all when it is empty.
        """
        some = pythons and tuple(pythons) != self.pythons
        part = f"-python{'-'.join(pythons)}" if some else ""
        return f"medialis-{version}-{self.name}{part}.zip"


SYSTEMS = (
    System(
        "linux-x64",
        ("3.11", "3.13"),
        ("manylinux_2_28_x86_64", "manylinux_2_17_x86_64"),
        r"(many)?linux\w+x86_64",
    ),
    System("windows-x64", ("3.11", "3.13"), ("win_amd64",), "win_amd64"),
    System("macos-arm64", ("3.11", "3.13"), ("macosx_12_0_arm64",), r"macosx_\d+_\d+_arm64"),
    # Blender 5 left Intel Macs.
    System(
        "macos-x64",
        ("3.11",),
        ("macosx_10_15_x86_64", "macosx_10_13_x86_64"),
        r"macosx_\d+_\d+_x86_64",
    ),
)


def this_system() -> System | None:
    """Return the system of this machine, or None where no Blender has an extension for it."""
    systems = {"Linux": "linux", "Windows": "windows", "Darwin": "macos"}
    machine = platform.machine().lower().replace("x86_64", "x64").replace("amd64", "x64")
    here = f"{systems.get(platform.system())}-{machine}"
    return next((system for system in SYSTEMS if system.name == here), None)


def this_python() -> str:
    """Return the version of the Python that runs this, as in ``3.11``."""
    return f"{sys.version_info[0]}.{sys.version_info[1]}"


def pins_of(python: str) -> Path:
    """Return the file that pins the wheels for a Python."""
    return PACKAGING / f"wheels-py{python.replace('.', '')}.txt"


def pinned_hashes(pins: Path) -> dict[str, set[str]]:
    """Return the sha256 sums that a pins file allows for each requirement (`numba==0.68.1`)."""
    hashes: dict[str, set[str]] = {}
    for line in pins.read_text(encoding="utf-8").splitlines():
        if line and not line.startswith(("#", " ")):
            requirement = line.rstrip(" \\")
            hashes[requirement] = set()
        elif "--hash=sha256:" in line:
            hashes[requirement].add(line.partition("--hash=sha256:")[2].rstrip(" \\"))
    return hashes


def pinned_wheels(folder: Path, pins: Path) -> list[Path] | None:
    """Return the pinned wheels in a folder, or None when one is missing or was changed."""
    found = {hashlib.sha256(path.read_bytes()).hexdigest(): path for path in folder.glob("*.whl")}
    chosen = [
        next((found[digest] for digest in sorted(allowed) if digest in found), None)
        for allowed in pinned_hashes(pins).values()
    ]
    return None if None in chosen else sorted(path for path in chosen if path is not None)


def downloaded(system: System, python: str, wheels: Path) -> Path:
    """Return the folder of the downloaded wheels for a system and a Python."""
    return wheels / f"py{python.replace('.', '')}-{system.name}"


def fetch_wheels(system: System, python: str, wheels: Path, *, offline: bool = False) -> list[Path]:
    """Return the third-party wheels for a Python; what is not in `wheels` yet is downloaded."""
    folder, pins = downloaded(system, python, wheels), pins_of(python)
    here = pinned_wheels(folder, pins)
    if here is None and not offline:
        tags = [f"--platform={tag}" for tag in system.tags]
        options = ["--quiet", "--no-deps", "--only-binary=:all:", "--require-hashes"]
        target = [f"--python-version={python}", "--implementation=cp", *tags]
        command = [sys.executable, "-m", "pip", "download", *options, *target]
        run = subprocess.run([*command, "--dest", str(folder), "--requirement", str(pins)])
        here = pinned_wheels(folder, pins) if run.returncode == 0 else None
    if here is None:
        raise SystemExit(
            f"The wheels that {pins.name} names are not in {folder}"
            + ("; build once without --offline." if offline else ", and pip could not get them.")
        )
    return here


def core_version() -> str:
    """Return the version in pyproject.toml; the extension's own two must be the same."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    version = project["project"]["version"]
    package = tomllib.loads((ADDON / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extension = tomllib.loads((ADDON / MANIFEST).read_text(encoding="utf-8"))["version"]
    if {version} != {extension, package["version"]}:
        raise SystemExit(
            f"pyproject.toml has version {version}, {MANIFEST} has {extension}, the package "
            f"medialis-blender {package['version']}."
        )
    return version


def contact() -> dict[str, str]:
    """Return what pyproject.toml tells of the project: `website`, and `maintainer` with address."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    author = project["authors"][0]
    found = {"website": project.get("urls", {}).get("Homepage")}
    if "email" in author:
        found["maintainer"] = f"{author['name']} <{author['email']}>"
    return {name: text for name, text in found.items() if text}


def find_interpreter(python: str) -> list[str] | None:
    """Return the command of a Python of a version that can make environments; None without one.

    `PYTHON311` names it, else it is the running one, that on the path, or one of pyenv's.
    """
    named = os.environ.get(f"PYTHON{python.replace('.', '')}")
    candidates = [[named]] if named else []
    candidates += [[sys.executable]] if python == this_python() else []
    candidates += [[f"python{python}"]]
    pyenv = Path.home() / ".pyenv" / "versions"
    candidates += [[str(path)] for path in sorted(pyenv.glob(f"{python}.*/bin/python{python}"))]
    candidates += [["py", f"-{python}"]] if sys.platform == "win32" else []
    check = f"import sys, ensurepip, venv; sys.exit('%d.%d' % sys.version_info[:2] != '{python}')"
    for candidate in candidates:
        try:
            if not subprocess.run([*candidate, "-c", check], capture_output=True).returncode:
                return candidate
        except OSError:
            continue
    return None


@cache
def builder(python: str, *, offline: bool = False) -> Path | None:
    """Return the Python of the environment that makes kernels and wheels; made when missing.

    None where this machine has no Python of that version.

    Raises
    ------
    SystemExit
        When it has to be made or changed, and cannot.
    """
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    of = {re.match(r"[\w-]+", line)[0]: line for line in project["dependencies"]}
    needed = ["setuptools>=77", "numpy>=2", of["numba"], of["threadpoolctl"]]
    folder = BUILDERS / f"kernels-env-{python}"
    runs = folder / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")
    stamp = folder / "installed"
    if stamp.is_file() and stamp.read_text(encoding="utf-8").splitlines() == needed:
        return runs
    interpreter = find_interpreter(python)
    if interpreter is None:
        return None
    if offline:
        raise SystemExit(f"{folder} does not have {' '.join(needed)}: build without --offline.")
    install = [str(runs), "-m", "pip", "install", "--quiet", "--upgrade", *needed]
    for command in ([*interpreter, "-m", "venv", "--clear", str(folder)], install):
        if subprocess.run(command).returncode:
            raise SystemExit(f"The environment for kernels could not be made in {folder}.")
    stamp.write_text("\n".join(needed), encoding="utf-8")
    return runs


def make_kernels(runs: Path) -> list[Path]:
    """Make the machine code of what has changed, in its place; return the modules and the record.

    Raises
    ------
    SystemExit
        When it cannot be made.
    """
    library = ROOT / "core" / "kernel_library" / "build.py"
    if subprocess.run([runs, library]).returncode:
        raise SystemExit("The kernels could not be made, and without them no wheel is built.")
    code = f"import runpy; print(*runpy.run_path({str(library)!r})['made_files'](), sep='\\n')"
    listed = subprocess.run([runs, "-c", code], capture_output=True, check=True, encoding="utf-8")
    return [Path(line) for line in listed.stdout.splitlines()]


def build_core(folder: Path, runs: Path) -> Path:
    """Build the core's wheel for a Python from a clean copy, with the kernels made for it.

    Blender does not unpack a wheel whose name and version it has unpacked before. So the version
    carries a hash of the sources and of the machine code: another build of the same release is not
    mistaken for this one.

    Raises
    ------
    SystemExit
        When it cannot be built.
    """
    core = ROOT / "core"
    made = make_kernels(runs)
    sources = [core / "medialis_after_import.py"]
    sources += sorted(
        file
        for kind in SOURCES
        for file in (core / "medialis").rglob(kind)
        if file.name not in LEFT_OUT
    )
    library = [file for file in sorted((core / "kernel_library").iterdir()) if file.is_file()]
    digest = hashlib.sha256()
    for source in [*sources, *sorted(made)]:
        digest.update(source.relative_to(ROOT).as_posix().encode() + source.read_bytes())
    local = f'version = "{core_version()}+core.{digest.hexdigest()[:8]}"'
    with tempfile.TemporaryDirectory() as temporary:
        copy = Path(temporary)
        about = [ROOT / n for n in ("pyproject.toml", "build_backend.py", "README.md", "LICENSE")]
        for source in [*about, *sources, *library, *made]:
            target = copy / source.relative_to(ROOT)
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(source, target)
        project = (copy / "pyproject.toml").read_text(encoding="utf-8")
        project = re.sub(r"^version = .*$", local, project, count=1, flags=re.MULTILINE)
        (copy / "pyproject.toml").write_text(project, encoding="utf-8")
        options = ["--quiet", "--no-deps", "--no-build-isolation", "--no-index"]
        command = [runs, "-m", "pip", "wheel", *options, "--wheel-dir", str(folder), "."]
        epoch = dict(os.environ, SOURCE_DATE_EPOCH="315532800")  # 1980, the first year of a zip
        epoch.pop("MEDIALIS_PURE", None)
        if subprocess.run(command, cwd=copy, env=epoch).returncode:
            raise SystemExit("The core's wheel could not be built.")
    wheel = max(folder.glob("medialis-*.whl"), key=lambda path: path.stat().st_mtime_ns)
    with zipfile.ZipFile(wheel) as archive:  # had it been compiled anew, it would not be the same
        for path in made:
            if archive.read(path.relative_to(core).as_posix()) != path.read_bytes():
                raise SystemExit(f"{wheel.name} has another {path.name} than was made.")
    return wheel


def given_core(folder: Path, system: System, python: str) -> Path | None:
    """Return the core's wheel for a system and a Python from a folder; None when it has none."""
    tag = "cp" + python.replace(".", "")
    name = re.compile(rf"medialis-{re.escape(core_version())}(\+[\w.]+)?-{tag}-{tag}-([\w.]+)\.whl")
    found = [(path, name.fullmatch(path.name)) for path in sorted(folder.glob("*.whl"))]
    fitting = [
        path
        for path, parts in found
        if parts and all(re.fullmatch(system.core, one) for one in parts[2].split("."))
    ]
    if len(fitting) > 1:
        raise SystemExit(f"{folder} has several: {' '.join(path.name for path in fitting)}")
    return fitting[0] if fitting else None


def extension_files(addon: Path = ADDON) -> Iterator[tuple[str, Path]]:
    """Yield name in the zip and path of every file that is shipped, but for the manifest."""
    for path in sorted(addon.rglob("*")):
        parts = path.relative_to(addon).parts
        hidden = any(part.startswith(".") or part in NOT_SHIPPED for part in parts)
        if path.is_file() and not hidden and path.name != MANIFEST and path.suffix != ".pyc":
            yield "/".join(parts), path


def filled_manifest(
    text: str, system: System, wheels: list[Path], pythons: Sequence[str] = ()
) -> str:
    """Return the manifest of one zip: its system, Blender versions and wheels filled in."""
    pythons = pythons or system.pythons
    first, last = BLENDERS[pythons[0]][0], BLENDERS[pythons[-1]][1]
    minimum = f'blender_version_min = "{first}"'
    text = re.sub(r'^blender_version_min = ".*"$', minimum, text, flags=re.MULTILINE)
    about = contact()
    if "maintainer" in about:
        maintainer = f'maintainer = "{about["maintainer"]}"'
        text = re.sub(r'^maintainer = ".*"$', maintainer, text, flags=re.MULTILINE)
    lines = [f'website = "{about["website"]}"'] if "website" in about else []
    lines.append(f'platforms = ["{system.name}"]')
    if last:  # Blender leaves out this version itself
        lines.append(f'blender_version_max = "{last}"')
    lines += ["wheels = [", *(f'    "./wheels/{wheel.name}",' for wheel in wheels), "]"]
    return re.sub(r"^# packaging/build_extension.*$", "\n".join(lines), text, flags=re.MULTILINE)


def write_zip(
    target: Path,
    system: System,
    wheels: list[Path],
    pythons: Sequence[str] = (),
    addon: Path = ADDON,
) -> None:
    """Write one zip; names sorted, times constant: the same content gives the same bytes.

    Wheels are compressed once more: 1 % less.

    Parameters
    ----------
    pythons : sequence of str
        Those that the wheels are for; all of the system when it is empty.
    """
    pythons = pythons or system.pythons
    wheels = sorted({wheel.name: wheel for wheel in wheels}.values(), key=lambda one: one.name)
    manifest = filled_manifest(
        (addon / MANIFEST).read_text(encoding="utf-8"), system, wheels, pythons
    )
    files = [(name, path.read_bytes()) for name, path in extension_files(addon)]
    files.append((MANIFEST, manifest.encode()))
    files += [(f"wheels/{wheel.name}", wheel.read_bytes()) for wheel in wheels]
    target.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(target, "w") as archive:
        for name, content in sorted(files):
            info = zipfile.ZipInfo(name)  # dated 1980
            info.external_attr = 0o644 << 16
            info.create_system = 3
            archive.writestr(info, content, zipfile.ZIP_DEFLATED, compresslevel=9)
    size, largest = target.stat().st_size, LARGEST_ZIP[len(pythons)]
    if size > largest:
        target.unlink()
        raise SystemExit(f"{target.name} has {size / 1e6:.1f} MB; {largest / 1e6:.0f} are allowed.")


def without_viewer(wheel: Path, folder: Path) -> Path:
    """Return a copy of a core's wheel without what the extension does not open."""
    target = folder / wheel.name
    with zipfile.ZipFile(wheel) as old, zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as new:
        for info in old.infolist():
            name, content = info.filename.rpartition("/")[2], old.read(info)
            if name == "RECORD":
                lines = content.decode().splitlines(keepends=True)
                kept = [n for n in lines if n.split(",")[0].rpartition("/")[2] not in LEFT_OUT]
                content = "".join(kept).encode()
            if name not in LEFT_OUT:
                new.writestr(info, content)
    return target


def cores_of(
    system: System, pythons: Sequence[str], folder: Path, options: argparse.Namespace
) -> dict[str, Path]:
    """Return the core's wheels of a system by Python: those given, and those built for this one."""
    found = {}
    for python in pythons:
        wheel = given_core(options.core, system, python) if options.core else None
        if wheel is not None:
            wheel = without_viewer(wheel, folder)
        elif system == this_system():
            runs = builder(python, offline=options.offline)
            wheel = None if runs is None else build_core(folder, runs)
        if wheel is not None:
            found[python] = wheel
    return found


def build_zips(options: argparse.Namespace) -> list[str]:
    """Build the zips and print their sizes; return what was skipped, and why."""
    version, skipped, here = core_version(), [], this_system()
    for system in [one for one in SYSTEMS if one == here or not options.here]:
        pythons = [this_python()] if options.here else system.pythons
        with tempfile.TemporaryDirectory() as folder:
            cores = cores_of(system, pythons, Path(folder), options)
            for python in [python for python in pythons if python not in cores]:
                where = f"no Python {python} was found" if system == here else "build it there"
                skipped.append(f"medialis for {system.name}, Python {python}: {where}")
            # Half a zip is for this machine alone.
            if not cores or (len(cores) < len(pythons) and system != here):
                skipped.append(f"{system.zip_name(version)}: see above")
                continue
            wheels = list(cores.values())
            for python in cores:
                wheels += fetch_wheels(system, python, options.wheels, offline=options.offline)
            target = options.output / system.zip_name(version, tuple(cores))
            write_zip(target, system, wheels, tuple(cores))
            print(f"{target.stat().st_size / 1e6:6.1f} MB  {target}", flush=True)
    return skipped


def main(arguments: list[str] | None = None) -> None:
    """Build what the command line asks for and print sizes, and what was skipped."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--here", action="store_true", help="only for this machine and Python")
    parser.add_argument("--offline", action="store_true", help="download nothing")
    parser.add_argument(
        "--wheels-only", action="store_true", help="print paths of wheels for --here"
    )
    parser.add_argument("--kernels", action="store_true", help="only make kernels of this Python")
    parser.add_argument("--core", type=Path, help="folder with the core's wheels of other systems")
    parser.add_argument("--all", action="store_true", help="an error where a zip is skipped")
    parser.add_argument("--wheels", type=Path, default=WHEELS, help="folder of downloaded wheels")
    parser.add_argument("--output", type=Path, default=ZIPS, help="folder of the zips")
    options = parser.parse_args(arguments)
    system, python = this_system(), this_python()
    if options.kernels:
        make_kernels(builder(python, offline=options.offline))
        return
    if (options.here or options.wheels_only) and (system is None or python not in system.pythons):
        raise SystemExit("No Blender that the extension supports has this Python and platform.")
    if options.wheels_only:
        print(*fetch_wheels(system, python, options.wheels, offline=options.offline), sep="\n")
        return
    skipped = build_zips(options)
    print(*(f"Skipped: {line}." for line in skipped), sep="\n", end="\n" if skipped else "")
    if skipped and options.all:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
