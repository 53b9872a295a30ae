#!/usr/bin/env python3
"""Build the plugin for one MeshLab of this machine, or for all that it can be built for here.

python meshlab_plugin/build.py              for the MeshLab of Debian or Ubuntu
python meshlab_plugin/build.py FOLDER       for the one whose library meshlab-common is in FOLDER
python meshlab_plugin/build.py --all        for that of the system and those of PYMESHLAB, and
                                            leave them where the wheel takes them from

A library says its release. Its source is fetched into build/meshlab-RELEASE unless it is there
(MESHLAB_SOURCES names another folder than build). A plugin is built in build/plugin-RELEASE, where
`medialis meshlab-install` finds it. It takes CMake, a C++ compiler, the headers of Qt 5.15, Eigen
and GLEW: docs/meshlab.md says how to get them on Linux, macOS and Windows.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Iterable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
BUILD = ROOT / "build"
PLUGIN = ROOT / "meshlab_plugin" / "filter_medialis"
PACKAGED = ROOT / "meshlab_plugin" / "medialis_meshset" / "plugins"
"""What lies here goes into the wheel. Those built for Linux are in the repository."""

PYMESHLAB = ("2023.12.post2", "2025.7.post1")
"""Wheels whose libraries are those of the MeshLab releases of the same numbers, in double."""

RELEASE = re.compile(rb"20[2-9]\d\.[01]\dd?")
LIBRARIES = ("libmeshlab-common.so", "libmeshlab-common.dylib", "meshlab-common.dll")
SUFFIXES = (".so", ".dylib", ".dll")
NOTE = "medialis-plugin.json"
SYSTEM_FOLDERS = ("/usr/lib/*/meshlab", "/usr/lib/meshlab", "/usr/lib/*")
REPOSITORY = "https://github.com/cnr-isti-vclab/meshlab"


def run(*command: object, cwd: Path | None = None) -> str:
    """Run a program; what it prints, or the end of the build."""
    words = [str(word) for word in command]
    done = subprocess.run(words, cwd=cwd, capture_output=True, text=True, errors="replace")
    if done.returncode != 0:
        sys.exit(f"{' '.join(words)}\n{done.stdout}{done.stderr}")
    sys.stderr.write(done.stderr)
    return done.stdout


def library_in(folder: Path) -> Path | None:
    """Return the library meshlab-common of a folder."""
    return next((folder / name for name in LIBRARIES if (folder / name).is_file()), None)


def release_of(library: Path) -> str:
    """Return the release that a library is of, with a d for double precision."""
    found = RELEASE.search(library.read_bytes())
    if found is None:
        sys.exit(f"{library} does not tell its release.")
    return found.group().decode()


def source_of(release: str) -> Path:
    """Return the source of a release; fetch it where it is not there."""
    number = release.removesuffix("d")
    folder = Path(os.environ.get("MESHLAB_SOURCES", BUILD)) / f"meshlab-{number}"
    if (folder / "src" / "common").is_dir():
        return folder
    if number == "2020.09":
        run(ROOT / "meshlab_plugin" / "debian_source.sh", folder)
        return folder
    run("git", "clone", "--depth", 1, "--branch", f"MeshLab-{number}", REPOSITORY, folder)
    run("git", "submodule", "update", "--init", "--depth", 1, "src/vcglib", cwd=folder)
    return folder


def exported_names(listing: str) -> list[str]:
    """Return the names that `dumpbin /exports` lists: ordinal, hint, address, name."""
    return re.findall(r"^\s+\d+\s+[0-9A-F]+\s+[0-9A-F]{8}\s+(\S+)", listing, re.MULTILINE)


def import_library(library: Path, folder: Path) -> None:
    """Make what the linker of Windows needs of a library that came without it (lib and dumpbin)."""
    names = exported_names(run("dumpbin", "/exports", library))
    definition = folder / "meshlab-common.def"
    definition.write_text("EXPORTS\n" + "".join(f"{name}\n" for name in names))
    run("lib", f"/def:{definition}", "/machine:x64", f"/out:{folder / 'meshlab-common.lib'}")


def build(libraries: Path) -> Path:
    """Build the plugin for the MeshLab of a folder of libraries; return the file."""
    library = library_in(libraries)
    if library is None:
        sys.exit(f"There is no library meshlab-common in {libraries}.")
    release = release_of(library)
    folder = BUILD / f"plugin-{release}"
    folder.mkdir(parents=True, exist_ok=True)
    if library.suffix == ".dll":
        import_library(library, folder)
    run(
        *("cmake", "-S", PLUGIN, "-B", folder, f"-DMESHLAB_SOURCE={source_of(release)}"),
        *(f"-DMESHLAB_LIBRARY={library}", f"-DMESHLAB_RELEASE={release}"),
        *(f"-DPython3_EXECUTABLE={sys.executable}", "-DCMAKE_BUILD_TYPE=Release"),
    )
    run("cmake", "--build", folder, "--config", "Release")
    made = [file for file in folder.glob("*filter_medialis.*") if file.suffix in SUFFIXES]
    sys.stdout.write(f"{release}: {made[0]}\n")
    return made[0]


def pymeshlab_libraries(version: str) -> Path:
    """Return the folder of the libraries of a pymeshlab; its wheel is fetched and unpacked."""
    folder = BUILD / f"pymeshlab-{version}"
    if not folder.is_dir():
        run(sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--dest", folder,
            f"pymeshlab=={version}")  # fmt: skip
        for wheel in folder.glob("*.whl"):
            zipfile.ZipFile(wheel).extractall(folder)
    found = (file.parent for name in LIBRARIES for file in folder.rglob(name))
    libraries = next(found, None)
    if libraries is None:
        sys.exit(f"pymeshlab {version} has no library meshlab-common for this system.")
    return libraries


def system_libraries() -> Path | None:
    """Return the folder of the MeshLab that the system has installed."""
    folders = (folder for pattern in SYSTEM_FOLDERS for folder in Path("/").glob(pattern[1:]))
    return next((folder for folder in folders if library_in(folder)), None)


def package(plugins: Iterable[Path]) -> None:
    """Put built plugins where the wheel takes them from."""
    for plugin in plugins:
        note = plugin.parent / NOTE
        about = json.loads(note.read_text("utf-8"))
        folder = PACKAGED / f"{about['system']}-{about['meshlab']}"
        folder.mkdir(parents=True, exist_ok=True)
        shutil.copy(note, folder)
        shutil.copy(plugin, folder)
        if plugin.suffix == ".so":
            run("strip", "--strip-unneeded", folder / plugin.name)


def main() -> None:
    """Build what the command line asks for."""
    parser = argparse.ArgumentParser(description="Build the plugin for MeshLab.")
    parser.add_argument("folder", nargs="?", type=Path, help="of the library meshlab-common")
    parser.add_argument("--all", action="store_true", help="for all MeshLabs, and package them")
    options = parser.parse_args()
    here = options.folder or system_libraries()
    if options.all:
        folders = [here] if here else []
        package([build(each) for each in (*folders, *map(pymeshlab_libraries, PYMESHLAB))])
    elif here is None:
        sys.exit("MeshLab is not installed here: name the folder of its library meshlab-common.")
    else:
        build(here)


if __name__ == "__main__":
    main()
