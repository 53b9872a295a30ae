"""Look into the wheels and the sdist of `dist/`; install each in an environment with nothing else.

python tests/check_distribution.py [FOLDER] [--pythons python3.11 python3.13]

Not part of the test suite: it downloads numpy, scipy, numba and pymeshlab and takes some minutes.
The wheel of medialis-blender is tested with bpy (tests/blender/test_package.py).
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tarfile
import tempfile
import tomllib
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
VERSION = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["version"]
OF_THE_REPOSITORY = re.compile(r"\.git\w+|\.(ci|github)/.*|docs/pictures/.*")
OF_THE_BUILD = re.compile(
    r"PKG-INFO|setup\.cfg|\w+(/\w+)*\.egg-info/.*|core/medialis/show/viewer/three\.js|build/long_description\.md"
)
CORE_FILES = re.compile(
    r"medialis/.*\.pyi?|medialis/py\.typed|medialis_after_import\.py"
    r"|medialis/(\w+/)+\w+\.(css|html|js|npz|toml|txt)|medialis/base/gpu_kernels\.xz"
)
MESHLAB_FILES = re.compile(
    r"medialis_(meshlab|meshlab_plugin|meshset)/.*\.py|medialis_meshlab\.pth"
    r"|medialis_meshset/plugins/[\w.-]+/(\w+\.(so|dylib|dll)|medialis-plugin\.json)"
)
LARGEST_SDIST = 5_000_000


@dataclass(frozen=True)
class Distribution:
    """A published package: its folder, what its wheel holds, its licence, and how to try it."""

    name: str
    folder: Path
    files: re.Pattern[str]
    licence: str
    trial: str

    @property
    def wheel(self) -> str:
        """The file, as pip names it."""
        return f"{self.name.replace('-', '_')}-{VERSION}-py3-none-any.whl"

    @property
    def about(self) -> str:
        """The folder of the metadata within the wheel."""
        return f"{self.name.replace('-', '_')}-{VERSION}.dist-info"


DISTRIBUTIONS = (
    Distribution(
        "medialis", ROOT / "core", CORE_FILES, "MIT",
        "import medialis; print(medialis.surface_skeleton(medialis.organic_shape(56)))",
    ),
    Distribution(
        "medialis-meshlab", ROOT / "meshlab_plugin", MESHLAB_FILES, "GPL-3.0-or-later",
        "import pymeshlab; ms = pymeshlab.MeshSet(); ms.create_torus(); "
        "print(ms.compute_scalar_by_medial_thickness_per_vertex())",
    ),
)  # fmt: skip
SOURCES = (
    "*.py",
    "*.pyi",
    "py.typed",
    "*.css",
    "*.html",
    "*.js",
    "*.npz",
    "*.toml",
    "*.txt",
    "*.pth",
    "*.so",
)


def look_into_wheel(package: Path, of: Distribution) -> None:
    """Compare the files and the licence of a wheel with what belongs into it.

    Raises
    ------
    SystemExit
        When something is missing or does not belong there.
    """
    with zipfile.ZipFile(package) as archive:
        found = set(archive.namelist())
        about = archive.read(f"{of.about}/METADATA").decode()
    folders = [path for path in of.folder.glob("medialis*") if (path / "__init__.py").is_file()]
    wanted = {
        file.relative_to(of.folder).as_posix()
        for kind in SOURCES
        for file in [
            *of.folder.glob(f"medialis_{kind}"),
            *(f for d in folders for f in d.rglob(kind)),
        ]
    }
    wanted.add(f"{of.about}/licenses/LICENSE")
    compare(package, found, wanted, lambda name: of.files.fullmatch(name) or of.about in name)
    if f"License-Expression: {of.licence}\n" not in about:
        raise SystemExit(f"{package.name}: its licence is not {of.licence}.")
    if links := re.findall(r"\]\((?!\w+:|#)[^)]*\)", about):
        raise SystemExit(f"{package.name}: links of the long description lead nowhere: {links}.")


def look_into_sdist(package: Path) -> None:
    """Compare the files of the repository's sdist with those of the checkout.

    Raises
    ------
    SystemExit
        When something is missing, does not belong there, or the file is too large.
    """
    if package.stat().st_size > LARGEST_SDIST:
        raise SystemExit(f"{package.name}: {package.stat().st_size / 1e6:.1f} MB, 5 are allowed.")
    if not (ROOT / ".git").exists():
        print(f"{package.name}: not compared, only a checkout knows what belongs into it")
        return
    with tarfile.open(package) as archive:
        found = {m.name.partition("/")[2] for m in archive.getmembers() if m.isfile()}
    tracked = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.split("\n")
    wanted = {name for name in tracked if name and not OF_THE_REPOSITORY.fullmatch(name)}
    compare(package, found, wanted, lambda name: name in wanted or OF_THE_BUILD.fullmatch(name))


def compare(
    package: Path, found: set[str], wanted: set[str], belongs: Callable[[str], object]
) -> None:
    """Stop where files are missing or odd ones are there."""
    missing, odd = sorted(wanted - found), sorted(n for n in found if not belongs(n))
    if missing or odd:
        raise SystemExit(f"{package.name}: not in it {missing}, not of it {odd}")


def check(python: str, package: Path, of: Distribution) -> None:
    """Install a package, run it from a folder where no source is, and uninstall it."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        clean = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
        clean["MEDIALIS_CACHE_DIR"] = str(folder / "cache")

        def call(*command: object) -> str:
            words = [str(word) for word in command]
            done = subprocess.run(
                words, cwd=folder, env=clean, capture_output=True, text=True, check=False
            )
            if done.returncode:
                raise SystemExit(f"{' '.join(words)}\n{done.stdout}{done.stderr}")
            return done.stdout

        call(python, "-m", "venv", folder / "env")
        programs = folder / "env" / ("Scripts" if os.name == "nt" else "bin")
        inside = programs / ("python.exe" if os.name == "nt" else "python")
        call(inside, "-m", "pip", "install", "--quiet", "--find-links", package.parent, package)
        if call(programs / "medialis", "--version") != f"medialis {VERSION}\n":
            raise SystemExit(f"{package.name}: it is not version {VERSION}.")
        where = call(inside, "-c", "import medialis; print(medialis.__file__)").strip()
        if not Path(where).is_relative_to(folder):
            raise SystemExit(f"{package.name}: the package comes from {where}.")
        print(call(inside, "-W", "error", "-c", of.trial).strip())
        if of.name == "medialis":
            lines = call(programs / "medialis", "demo", "--output", "out").splitlines()
            if not (folder / lines[-1]).read_bytes().startswith(b"\x89PNG"):
                raise SystemExit(f"{package.name}: the demo has no picture at {lines[-1]}.")
        print(call(programs / "medialis", "doctor"))
        call(inside, "-m", "pip", "uninstall", "--quiet", "--yes", of.name, "medialis")
        if left := [str(path) for path in (folder / "env").rglob("*medialis*")]:
            raise SystemExit(f"{package.name}: uninstalling leaves {left}.")
        version = call(inside, "--version").strip()
        print(f"{package.name}: installed on {version}, run, uninstalled")


def main(arguments: list[str] | None = None) -> int:
    """Check all packages of a folder."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", nargs="?", type=Path, default=ROOT / "dist")
    parser.add_argument("--pythons", nargs="+", default=[sys.executable], help="interpreters")
    options = parser.parse_args(arguments)
    folder = options.folder.resolve()
    sdist = folder / f"medialis-{VERSION}.tar.gz"
    wheels = [(folder / of.wheel, of) for of in DISTRIBUTIONS]
    if missing := [p.name for p in (sdist, *(p for p, _ in wheels)) if not p.is_file()]:
        print(f"{folder} lacks {missing}: run make clean dist.")
        return 1
    look_into_sdist(sdist)
    for package, of in wheels:
        look_into_wheel(package, of)
    for python in options.pythons:
        for package, of in wheels:
            check(python, package, of)
    check(options.pythons[0], sdist, DISTRIBUTIONS[0])
    return 0


if __name__ == "__main__":
    sys.exit(main())
