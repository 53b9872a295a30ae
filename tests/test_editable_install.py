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
    """Python took a clone called `medialis` for the package when it ran in the folder above it."""
    pytest.importorskip("setuptools", reason="building needs setuptools")
    clone, site = tmp_path / "medialis", tmp_path / "site"
    for package in ("core/medialis", "meshlab_plugin/medialis_meshset"):
        (clone / package).mkdir(parents=True)
        (clone / package / "__init__.py").write_text("")
    for name in ("pyproject.toml", "build_backend.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, clone)
    shutil.copy(ROOT / "meshlab_plugin" / "LICENSE", clone / "meshlab_plugin")
    done = run(clone, "-c", BUILD, str(tmp_path))
    with zipfile.ZipFile(tmp_path / done.splitlines()[-1]) as wheel:
        wheel.extractall(site)
        assert "medialis_sources.pth" in record(wheel)
    found = run(tmp_path, "-S", "-c", LOOK, str(site)).strip()
    assert Path(found) == clone / "core" / "medialis" / "__init__.py"


def record(wheel: zipfile.ZipFile) -> str:
    name = next(name for name in wheel.namelist() if name.endswith("RECORD"))
    return wheel.read(name).decode()


def run(folder: Path, *arguments: str) -> str:
    command = [sys.executable, *arguments]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, env={})
    assert done.returncode == 0, done.stderr
    return done.stdout
