"""Look into the wheel and the sdist of `dist/`; install each in an environment with nothing else.

python tests/check_distribution.py [FOLDER]

Not part of the test suite: it downloads numpy, scipy and numba twice and takes some minutes.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tarfile
import tempfile
import tomllib
import venv
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
VERSION = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["version"]
OF_THE_REPOSITORY = re.compile(r"\.git\w+|\.ci/.*")
OF_THE_BUILD = re.compile(
    r"PKG-INFO|setup\.cfg|medialis\.egg-info/.*|core/medialis/viewer/three\.js"
)
IN_THE_WHEEL = re.compile(
    r"medialis(_meshlab|_meshset)?/.*\.pyi?|medialis/py\.typed"
    r"|medialis/(batches|render|reports|viewer)/\w+\.(css|html|js|npz|txt)"
    rf"|medialis-{re.escape(VERSION)}\.dist-info/[\w./]+"
)


def look_into(package: Path) -> None:
    """Compare the files of a package with what belongs into it.

    Raises
    ------
    SystemExit
        When something is missing or does not belong there.
    """
    if package.suffix == ".whl":
        found = set(zipfile.ZipFile(package).namelist())
        packages = [ROOT / "core" / "medialis", *(ROOT / "meshlab_plugin").glob("medialis_*")]
        wanted = {
            file.relative_to(folder.parent).as_posix()
            for folder in packages
            for kind in ("*.py", "*.pyi", "py.typed", "*.css", "*.html", "*.js", "*.npz", "*.txt")
            for file in folder.rglob(kind)
        }
        licences = f"medialis-{VERSION}.dist-info/licenses"
        wanted |= {f"{licences}/LICENSE", f"{licences}/meshlab_plugin/LICENSE"}
        odd = {name for name in found if not IN_THE_WHEEL.fullmatch(name)}
    elif not (ROOT / ".git").exists():
        print(f"{package.name}: not compared, only a checkout knows what belongs into it")
        return
    else:
        with tarfile.open(package) as archive:
            found = {m.name.partition("/")[2] for m in archive.getmembers() if m.isfile()}
        tracked = subprocess.run(
            ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True
        ).stdout.split("\n")
        wanted = {name for name in tracked if name and not OF_THE_REPOSITORY.fullmatch(name)}
        odd = {name for name in found - wanted if not OF_THE_BUILD.fullmatch(name)}
    if odd or wanted - found:
        missing = sorted(wanted - found)
        raise SystemExit(f"{package.name}: not in it {missing}, not of it {sorted(odd)}")


def check(package: Path) -> None:
    """Install a package, run it from a folder where no source is, and uninstall it."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        venv.create(folder / "env", with_pip=True)
        programs = folder / "env" / ("Scripts" if os.name == "nt" else "bin")
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

        python = programs / ("python.exe" if os.name == "nt" else "python")
        call(python, "-m", "pip", "install", "--quiet", package)
        if call(programs / "medialis", "--version") != f"medialis {VERSION}\n":
            raise SystemExit(f"{package.name}: it is not version {VERSION}.")
        lines = call(programs / "medialis", "demo", "--output", "out").splitlines()
        picture = Path(lines[-1])
        if not (folder / picture).read_bytes().startswith(b"\x89PNG"):
            raise SystemExit(f"{package.name}: the demo has no picture at {picture}.")
        where = call(python, "-c", "import medialis; print(medialis.__file__)").strip()
        if not Path(where).is_relative_to(folder):
            raise SystemExit(f"{package.name}: the package comes from {where}.")
        for name in ("medialis_meshset", "medialis_meshlab"):
            code = f"from importlib.util import find_spec; print(find_spec({name!r}).origin)"
            call(python, "-c", code)
        print(call(programs / "medialis", "doctor"))
        call(python, "-m", "pip", "uninstall", "--quiet", "--yes", "medialis")
        if left := [str(path) for path in (folder / "env").rglob("*medialis*")]:
            raise SystemExit(f"{package.name}: uninstalling leaves {left}.")
        print(f"{package.name}: installed, demo run, uninstalled")


def main(arguments: list[str]) -> int:
    """Check all packages of a folder."""
    folder = Path(arguments[0]) if arguments else ROOT / "dist"
    packages = sorted([*folder.glob("*.whl"), *folder.glob("*.tar.gz")])
    if [p.suffix for p in packages] != [".whl", ".gz"]:
        print(f"{folder} must hold one wheel and one sdist: run make clean dist.")
        return 1
    for package in packages:
        look_into(package)
    for package in packages:
        check(package.resolve())
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
