# SPDX-License-Identifier: GPL-3.0-or-later
"""Build the Blender extension: one zip for each platform and Python, with the wheels it needs.

    python blender_addon/packaging/build_extension.py                    # all, into dist/blender
    python blender_addon/packaging/build_extension.py --here --offline   # this machine's only

The wheels of numba, llvmlite, scipy and threadpoolctl are pinned by version and hash in the
`wheels-*.txt` beside this file and bundled unmodified. numpy is Blender's own. The core's wheel is
built from its sources. The same sources and the same setuptools give the same bytes. This folder is
not shipped.
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
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

PACKAGING = Path(__file__).resolve().parent
ADDON = PACKAGING.parent
SOURCES = ("*.py", "*.pyi", "py.typed", "*.css", "*.html", "*.js", "*.npz", "*.txt")
"""Files of the core that its wheel has."""
ROOT = ADDON.parent
MANIFEST = "blender_manifest.toml"
WHEELS = ROOT / "build" / "wheels"
ZIPS = ROOT / "dist" / "blender"
LEFT_OUT = {"three.js"}
"""The library of the viewer in a browser, which the extension does not open."""
LARGEST_ZIP = 100_000_000
OF_THE_PACKAGE = ("pyproject.toml", "setup.py", "medialis_blender.pth", "README.md")
NOT_SHIPPED = {"packaging", "examples", "__pycache__", *OF_THE_PACKAGE}
# What pip calls the platforms. Blender 4.2 needs glibc 2.28 too, so no Linux wheel asks for more.
PIP_PLATFORMS = {
    "linux-x64": ("manylinux_2_28_x86_64", "manylinux_2_17_x86_64"),
    "windows-x64": ("win_amd64",),
    "macos-arm64": ("macosx_12_0_arm64",),
    "macos-x64": ("macosx_10_15_x86_64", "macosx_10_13_x86_64"),
}


@dataclass(frozen=True)
class Bundle:
    """One zip: the Blender versions that share a Python, on one platform."""

    platform: str
    python: str
    blender: str
    blender_max: str | None
    pins: str

    @property
    def folder(self) -> str:
        """Name of the folder that keeps its downloaded wheels."""
        return f"py{self.python.replace('.', '')}-{self.platform}"

    def zip_name(self, version: str) -> str:
        """Return the file name a user chooses by: their Blender and their platform."""
        return f"medialis-{version}-blender{self.blender}-{self.platform}.zip"


def _series(python: str, blender: str, maximum: str | None, pins: dict[str, str]) -> list[Bundle]:
    return [Bundle(name, python, blender, maximum, file) for name, file in pins.items()]


PY313 = dict.fromkeys(("linux-x64", "windows-x64", "macos-arm64"), "wheels-py313.txt")
PY311 = dict.fromkeys(PY313, "wheels-py311.txt") | {
    "linux-x64": "wheels-py311-linux-x64.txt",
    "macos-x64": "wheels-py311-macos-x64.txt",
}
# Blender leaves out the version in blender_version_max itself.
BUNDLES = [
    *_series("3.11", "4.2-to-5.0", "5.1.0", PY311),
    *_series("3.13", "5.1-and-later", None, PY313),
]
SKIPPED = "macos-x64 with Python 3.13: Blender 5 left Intel Macs, and numba has no wheel for them."


def this_bundle() -> Bundle | None:
    """Return the bundle for this machine and the running Python, or None where there is none."""
    systems = {"Linux": "linux", "Windows": "windows", "Darwin": "macos"}
    machine = platform.machine().lower().replace("x86_64", "x64").replace("amd64", "x64")
    here = f"{systems.get(platform.system())}-{machine}"
    python = f"{sys.version_info[0]}.{sys.version_info[1]}"
    return next((b for b in BUNDLES if (b.platform, b.python) == (here, python)), None)


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


def fetch_wheels(bundle: Bundle, wheels: Path, *, offline: bool = False) -> list[Path]:
    """Return the third-party wheels of a bundle; what is not in `wheels` yet is downloaded."""
    folder, pins = wheels / bundle.folder, PACKAGING / bundle.pins
    here = pinned_wheels(folder, pins)
    if here is None and not offline:
        tags = [f"--platform={tag}" for tag in PIP_PLATFORMS[bundle.platform]]
        options = ["--quiet", "--no-deps", "--only-binary=:all:", "--require-hashes"]
        target = [f"--python-version={bundle.python}", "--implementation=cp", *tags]
        command = [sys.executable, "-m", "pip", "download", *options, *target]
        run = subprocess.run([*command, "--dest", str(folder), "--requirement", str(pins)])
        here = pinned_wheels(folder, pins) if run.returncode == 0 else None
    if here is None:
        raise SystemExit(
            f"The wheels that {bundle.pins} names are not in {folder}"
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


def build_core(folder: Path) -> Path:
    """Build the core's wheel from a clean copy; the same sources give the same wheel.

    Blender does not unpack a wheel whose name and version it has unpacked before. So the version
    carries a hash of the sources: another build of the same release is not mistaken for this one.
    """
    package = ROOT / "core" / "medialis"
    sources = [ROOT / "core" / "medialis_after_import.py"]
    sources += sorted(
        file for kind in SOURCES for file in package.rglob(kind) if file.name not in LEFT_OUT
    )
    digest = hashlib.sha256()
    for source in sources:
        digest.update(source.relative_to(ROOT).as_posix().encode() + source.read_bytes())
    local = f'version = "{core_version()}+core.{digest.hexdigest()[:8]}"'
    with tempfile.TemporaryDirectory() as temporary:
        copy = Path(temporary)
        for name in ("pyproject.toml", "build_backend.py", "README.md", "LICENSE"):
            shutil.copyfile(ROOT / name, copy / name)
        for source in sources:
            target = copy / source.relative_to(ROOT)
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source, target)
        project = (copy / "pyproject.toml").read_text(encoding="utf-8")
        project = re.sub(r"^version = .*$", local, project, count=1, flags=re.MULTILINE)
        (copy / "pyproject.toml").write_text(project, encoding="utf-8")
        options = ["--quiet", "--no-deps", "--no-build-isolation", "--no-index"]
        command = [sys.executable, "-m", "pip", "wheel", *options, "--wheel-dir", str(folder), "."]
        epoch = dict(os.environ, SOURCE_DATE_EPOCH="315532800")  # 1980, the first year of a zip
        if subprocess.run(command, cwd=copy, env=epoch).returncode:
            raise SystemExit("The core's wheel could not be built: is setuptools 77 or later here?")
    return next(folder.glob("medialis-*.whl"))


def extension_files(addon: Path = ADDON) -> Iterator[tuple[str, Path]]:
    """Yield name in the zip and path of every file that is shipped, but for the manifest."""
    for path in sorted(addon.rglob("*")):
        parts = path.relative_to(addon).parts
        hidden = any(part.startswith(".") or part in NOT_SHIPPED for part in parts)
        if path.is_file() and not hidden and path.name != MANIFEST and path.suffix != ".pyc":
            yield "/".join(parts), path


def filled_manifest(text: str, bundle: Bundle, wheels: list[Path]) -> str:
    """Return the manifest of one zip: its platform, Blender versions and wheels filled in."""
    minimum = f'blender_version_min = "{bundle.blender.partition("-")[0]}.0"'
    text = re.sub(r'^blender_version_min = ".*"$', minimum, text, flags=re.MULTILINE)
    about = contact()
    if "maintainer" in about:
        maintainer = f'maintainer = "{about["maintainer"]}"'
        text = re.sub(r'^maintainer = ".*"$', maintainer, text, flags=re.MULTILINE)
    lines = [f'website = "{about["website"]}"'] if "website" in about else []
    lines.append(f'platforms = ["{bundle.platform}"]')
    if bundle.blender_max:
        lines.append(f'blender_version_max = "{bundle.blender_max}"')
    lines += ["wheels = [", *(f'    "./wheels/{wheel.name}",' for wheel in wheels), "]"]
    return re.sub(r"^# packaging/build_extension.*$", "\n".join(lines), text, flags=re.MULTILINE)


def write_zip(target: Path, bundle: Bundle, wheels: list[Path], addon: Path = ADDON) -> None:
    """Write one zip; names sorted, times constant: the same content gives the same bytes.

    Wheels are compressed once more: 1.2 MB of 100 less, and Blender 5's for Linux has 0.1 too many.
    """
    manifest = filled_manifest((addon / MANIFEST).read_text(encoding="utf-8"), bundle, wheels)
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
    if target.stat().st_size > LARGEST_ZIP:
        size = target.stat().st_size / 1e6
        target.unlink()
        raise SystemExit(f"{target.name} has {size:.1f} MB; {LARGEST_ZIP / 1e6:.0f} are allowed.")


def main(arguments: list[str] | None = None) -> None:
    """Build the zips that the command line asks for and print their sizes."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--here", action="store_true", help="only for this machine and Python")
    parser.add_argument("--offline", action="store_true", help="download nothing")
    parser.add_argument("--wheels-only", action="store_true", help="build nothing, print paths")
    parser.add_argument("--wheels", type=Path, default=WHEELS, help="folder of downloaded wheels")
    parser.add_argument("--output", type=Path, default=ZIPS, help="folder of the zips")
    options = parser.parse_args(arguments)
    bundles = [this_bundle()] if options.here else BUNDLES
    if bundles == [None]:
        raise SystemExit("No Blender that the extension supports has this Python and platform.")
    version = core_version()
    with tempfile.TemporaryDirectory() as folder:
        core = None if options.wheels_only else build_core(Path(folder))
        for bundle in bundles:
            wheels = fetch_wheels(bundle, options.wheels, offline=options.offline)
            if core is None:
                print(*wheels, sep="\n")
            else:
                target = options.output / bundle.zip_name(version)
                write_zip(target, bundle, sorted([core, *wheels]))
                print(f"{target.stat().st_size / 1e6:6.1f} MB  {target}")
    if not options.here:
        print(f"Skipped: {SKIPPED}")


if __name__ == "__main__":
    main()
