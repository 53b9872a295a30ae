"""Install the wheel and the sdist of `dist/`, each in an environment with nothing else; run them.

python tests/check_distribution.py [FOLDER]

Not part of the test suite: it downloads numpy, scipy and numba twice and takes some minutes.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def check(package: Path) -> None:
    """Install one package and run the demo from a folder where no source is."""
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
        licences = call(python, "-m", "pip", "show", "--files", "medialis").count("LICENSE")
        if licences < 2:
            raise SystemExit(f"{package.name}: the two licences are not in it.")
        print(f"{package.name}: installed, demo run, {licences} licences")


def main(arguments: list[str]) -> int:
    """Check all packages of a folder."""
    folder = Path(arguments[0]) if arguments else ROOT / "dist"
    packages = [*folder.glob("*.whl"), *folder.glob("*.tar.gz")]
    if {p.suffix for p in packages} != {".whl", ".gz"}:
        print(f"{folder} must hold a wheel and an sdist: run make dist first.")
        return 1
    for package in packages:
        check(package.resolve())
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
