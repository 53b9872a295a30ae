"""An editable install is found from every folder, the one that holds the clone included."""

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
BUILD = "import build_backend, sys; print(build_backend.build_editable(sys.argv[1]))"
LOOK = "import site, sys; site.addsitedir(sys.argv[1]); import medialis; print(medialis.__file__)"


def test_the_clone_is_not_taken_for_the_package(tmp_path):
    """Python took a clone called `medialis` for the package when it ran in the folder above it.

    A path in a .pth file is searched first; a hook for imports would be asked last.
    """
    pytest.importorskip("setuptools", reason="building needs setuptools")
    clone, site = tmp_path / "medialis", tmp_path / "site"
    (clone / "core" / "medialis").mkdir(parents=True)
    for name in ("core/medialis/__init__.py", "core/medialis_after_import.py"):
        (clone / name).write_text("")
    for name in ("pyproject.toml", "build_backend.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, clone)
    done = run(clone, "-c", BUILD, str(tmp_path))
    with zipfile.ZipFile(tmp_path / done.splitlines()[-1]) as wheel:
        wheel.extractall(site)
    found = run(tmp_path, "-S", "-c", LOOK, str(site)).strip()
    assert Path(found) == clone / "core" / "medialis" / "__init__.py"


def run(folder: Path, *arguments: str) -> str:
    command = [sys.executable, *arguments]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, env={})
    assert done.returncode == 0, done.stderr
    return done.stdout
