"""The extension as users get it: its zip, and the zip installed in a Blender of its own.

The sessions run in their own process and profile. The modules they can import at the start are bpy
and what bpy itself asks for, so that numba, scipy and the core can only come from the zip.
"""

from __future__ import annotations

import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGING = ROOT / "blender_addon" / "packaging"
SESSION = Path(__file__).with_name("extension_session.py")


def _load(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, PACKAGING / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


build = _load("build_extension")
repository = _load("build_repository")


def _bpy_folder() -> Path:
    spec = importlib.util.find_spec("bpy")
    if spec is None:
        pytest.skip("needs the bpy module: `make hosts`, then the Python of .venv-bpy-*")
    return Path(spec.origin).parent


def _blender_tool(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run Blender's own extension tool."""
    (tool,) = _bpy_folder().glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py")
    return subprocess.run([sys.executable, tool, *arguments], capture_output=True, text=True)


def _small_wheel(folder: Path, name: str) -> Path:
    """Return a wheel in name only: what the zip holds is tested, not what the wheels do."""
    path = folder / name
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("nothing.txt", "")
    return path


@pytest.mark.parametrize("bundle", build.BUNDLES, ids=lambda bundle: bundle.folder)
def test_zip_holds_what_is_shipped(bundle: Any, tmp_path: Path) -> None:
    """No tests, build scripts or caches; the version of the project; the same bytes again."""
    python, system = "cp" + bundle.python.replace(".", ""), build.PIP_PLATFORMS[bundle.platform][0]
    wheels = [
        _small_wheel(tmp_path, f"numba-0.68.1-{python}-{python}-{system}.whl"),
        _small_wheel(tmp_path, f"medialis-{build.core_version()}+core.0-py3-none-any.whl"),
    ]
    target = tmp_path / bundle.zip_name(build.core_version())
    build.write_zip(target, bundle, wheels)
    with zipfile.ZipFile(target) as archive:
        names = archive.namelist()
        manifest = tomllib.loads(archive.read("blender_manifest.toml").decode())
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert manifest["version"] == project["version"]
    assert manifest["platforms"] == [bundle.platform]
    first = {"3.11": "4.2.0", "3.13": "5.1.0"}
    assert manifest["blender_version_min"] == first[bundle.python]
    assert set(manifest["permissions"]) == {"files"}
    assert sorted(manifest["wheels"]) == sorted(f"./wheels/{wheel.name}" for wheel in wheels)
    assert {"LICENSE", "__init__.py", "blender_manifest.toml"} <= set(names)
    unwanted = re.compile(r"test|build_|packaging|__pycache__|\.pyc$|(^|/)\.|\.whl\.")
    assert [name for name in names if unwanted.search(name)] == []
    again = tmp_path / "again.zip"
    build.write_zip(again, bundle, wheels)
    assert again.read_bytes() == target.read_bytes()


def test_website_and_address_come_from_the_project(tmp_path: Path, monkeypatch) -> None:
    """Who publishes it says them in pyproject.toml, once."""
    text = (ROOT / "pyproject.toml").read_text()
    project = text.replace(
        '{ name = "The medialis developers" }', '{ name = "Some One", email = "one@some.org" }'
    )
    project = re.sub('(?<=^Homepage = ").*(?="$)', "https://some.org", project, flags=re.M)
    (tmp_path / "pyproject.toml").write_text(project)
    manifest = (build.ADDON / build.MANIFEST).read_text()
    monkeypatch.setattr(build, "ROOT", tmp_path)
    found = tomllib.loads(build.filled_manifest(manifest, build.BUNDLES[0], []))
    assert found["website"] == "https://some.org"
    assert found["maintainer"] == "Some One <one@some.org>"


def test_the_code_keeps_the_rules_of_the_platform() -> None:
    """See docs/blender_guidelines.md."""
    forbidden = re.compile(
        r"sys\.(path|modules)|__file__|\b(open|eval|exec)\("
        r"|import (urllib|requests|socket|threading|subprocess)"
    )
    for name, path in build.extension_files():
        assert not name.startswith("examples")
        if path.suffix == ".py":
            assert not forbidden.search(path.read_text()), name


def test_blender_tool_accepts_source_and_zips(tmp_path: Path) -> None:
    (tags,) = _bpy_folder().glob("*/scripts/modules/_bpy_internal/extensions/tags.py")
    source = _blender_tool("validate", f"--valid-tags={tags}", str(build.ADDON))
    assert source.returncode == 0, source
    for bundle in build.BUNDLES:
        python = "cp" + bundle.python.replace(".", "")
        system = build.PIP_PLATFORMS[bundle.platform][0]
        wheel = _small_wheel(tmp_path, f"numba-0.68.1-{python}-{python}-{system}.whl")
        target = tmp_path / bundle.zip_name(build.core_version())
        build.write_zip(target, bundle, [wheel])
        assert (checked := _blender_tool("validate", str(target))).returncode == 0, checked


@pytest.mark.parametrize("pins", sorted(PACKAGING.glob("wheels-*.txt")), ids=lambda path: path.stem)
def test_pins_are_exact_and_without_numpy(pins: Path) -> None:
    """All that the core depends on, and llvmlite; but never numpy, which Blender brings."""
    hashes = build.pinned_hashes(pins)
    names = [re.match(r"(\w+)==[\d.]+$", requirement)[1] for requirement in hashes]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    dependencies = {re.match(r"\w+", line)[0] for line in project["dependencies"]}
    assert set(names) == dependencies - {"numpy"} | {"llvmlite"}
    platforms = [bundle for bundle in build.BUNDLES if bundle.pins == pins.name]
    any_platform = "threadpoolctl"  # pure Python: one wheel for all
    for requirement, sums in hashes.items():
        assert len(sums) == (1 if requirement.startswith(any_platform) else len(platforms))


def test_changed_wheel_is_not_bundled(tmp_path: Path) -> None:
    folder = tmp_path / build.BUNDLES[0].folder
    folder.mkdir()
    _small_wheel(folder, "numba-0.68.1-cp311-cp311-win_amd64.whl")
    with pytest.raises(SystemExit, match="build once without --offline"):
        build.fetch_wheels(build.BUNDLES[0], tmp_path, offline=True)


def test_versions_must_agree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    manifest = (build.ADDON / build.MANIFEST).read_text().replace('version = "', 'version = "9', 2)
    (tmp_path / build.MANIFEST).write_text(manifest)
    shutil.copy(build.ADDON / "pyproject.toml", tmp_path)
    monkeypatch.setattr(build, "ADDON", tmp_path)
    with pytest.raises(SystemExit, match="has version"):
        build.core_version()


def _bpy_alone(folder: Path) -> Path:
    """Link bpy and what it requires, and nothing else, into a folder to import from."""
    wanted, seen = ["bpy"], set()
    while wanted:
        name = wanted.pop()
        with suppress(PackageNotFoundError):  # a requirement of another platform
            package = distribution(name)
            if name in seen:
                continue
            seen.add(name)
            required = [line for line in package.requires or [] if "extra ==" not in line]
            wanted += [re.match(r"[\w.-]+", line)[0] for line in required]
            for top in {file.parts[0] for file in package.files or []} - {"..", "__pycache__"}:
                if not (folder / top).exists():
                    (folder / top).symlink_to(package.locate_file(top))
    return folder


@pytest.fixture(scope="module")
def extension(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the zip for this Blender, built from the sources as they are."""
    _bpy_folder()
    bundle = build.this_bundle()
    if bundle is None:
        pytest.skip("no Blender that the extension supports has this Python and platform")
    if build.pinned_wheels(build.WHEELS / bundle.folder, PACKAGING / bundle.pins) is None:
        pytest.skip(f"needs the wheels that {bundle.pins} names: `make hosts` fetches them")
    folder = tmp_path_factory.mktemp("zip")
    build.main(["--here", "--offline", "--output", str(folder)])
    return next(folder.glob("*.zip"))


class Profile:
    """A new user's machine: Blender's folders, home and caches in one temporary folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        for name in ("site", "home", "blender", "cache"):
            (folder / name).mkdir()
        self.site = _bpy_alone(folder / "site")

    def session(self, *steps: str) -> dict[str, Any]:
        """Return what one Blender process reports after these steps."""
        environment = {
            name: value
            for name, value in os.environ.items()
            if not name.startswith(("MEDIALIS", "NUMBA", "BLENDER"))
        }
        environment |= {
            "HOME": str(self.folder / "home"),
            "XDG_CACHE_HOME": str(self.folder / "cache"),
            "BLENDER_USER_RESOURCES": str(self.folder / "blender"),
        }
        command = [sys.executable, "-I", "-S", "-B", str(SESSION), str(self.site), *steps]
        run = subprocess.run(
            command, env=environment, cwd=self.folder, capture_output=True, text=True, timeout=600
        )
        lines = [line for line in run.stdout.splitlines() if line.startswith("RESULT ")]
        assert lines, f"{run.stdout}\n{run.stderr}"
        return json.loads(lines[-1].removeprefix("RESULT "))

    def kernels(self) -> dict[Path, int]:
        """Return every compiled kernel with the time of its last change."""
        found = [path for ending in ("nbi", "nbc") for path in self.folder.rglob(f"*.{ending}")]
        return {path: path.stat().st_mtime_ns for path in found}


def _updated(extension: Path, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the next release: another version of the add-on, and a core with a line more."""
    copy = folder / "next"
    shutil.copytree(ROOT / "core" / "medialis", copy / "core" / "medialis")
    shutil.copy(ROOT / "core" / "medialis_after_import.py", copy / "core")
    for name in ("pyproject.toml", "build_backend.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, copy)
    with (copy / "core" / "medialis" / "base" / "errors.py").open("a") as file:
        file.write("\nUPDATED = True\n")
    monkeypatch.setattr(build, "ROOT", copy)
    core = build.build_core(folder)
    target = folder / "next.zip"
    with zipfile.ZipFile(extension) as old, zipfile.ZipFile(target, "w") as new:
        (old_core,) = [name for name in old.namelist() if "wheels/medialis-" in name]
        for name in set(old.namelist()) - {old_core, build.MANIFEST}:
            new.writestr(name, old.read(name))
        new.write(core, f"wheels/{core.name}")
        text = old.read(build.MANIFEST).decode().replace(Path(old_core).name, core.name)
        new.writestr(build.MANIFEST, re.sub(r'\nversion = ".*"', '\nversion = "99.0.0"', text))
    return target


def _repository(extension: Path, folder: Path) -> Path:
    """Return the index of a repository: this zip, and those of other systems and Blenders."""
    zips = folder / "repository"
    zips.mkdir()
    shutil.copy(extension, zips)
    for bundle in build.BUNDLES:
        target = zips / bundle.zip_name(build.core_version())
        if not target.exists():
            system = build.PIP_PLATFORMS[bundle.platform][0]
            python = "cp" + bundle.python.replace(".", "")
            wheel = _small_wheel(folder, f"numba-0.68.1-{python}-{python}-{system}.whl")
            build.write_zip(target, bundle, [wheel])
    index = repository.make_repository(zips)
    assert len(json.loads(index.read_text())["data"]) == len(build.BUNDLES)
    return index


def test_life_of_an_installation(
    extension: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Install from a repository, run on the bundled wheels, restart, update without compiling anew,
    uninstall."""
    profile = Profile(tmp_path)
    index = _repository(extension, tmp_path)
    first = profile.session(f"repository={index.as_uri()}", "run")
    assert first["outcome"] == ["FINISHED"]
    assert first["new objects"] >= 1
    assert first["version"].startswith(build.core_version())
    bundled = {name: file for name, file in first["files"].items() if name != "numpy"}
    wheels = str(tmp_path / "blender" / "extensions" / ".local")
    assert all(file.startswith(wheels) for file in bundled.values()), bundled
    assert first["files"]["numpy"].startswith(str(profile.site))  # Blender's own
    assert first["enabled"] and first["operator"] and not first["updated"]

    compiled = profile.kernels()
    assert compiled
    own = tmp_path / "blender" / "extensions" / ".user" / "user_default" / "medialis"
    assert all(own in path.parents for path in compiled)
    assert not first["numba here"]  # it computes in a process of its own
    restarted = profile.session("enable", "run")
    assert restarted["outcome"] == ["FINISHED"]
    updated = profile.session(f"install={_updated(extension, tmp_path, monkeypatch)}", "run")
    assert updated["outcome"] == ["FINISHED"] and updated["updated"]
    assert profile.kernels() == compiled

    disabled = profile.session("enable", "disable")
    assert disabled["known"] and not disabled["enabled"] and not disabled["operator"]
    gone = profile.session("enable", "uninstall")
    assert not gone["known"] and not gone["enabled"] and not gone["operator"]
    assert list((tmp_path / "blender" / "extensions").rglob("medialis*")) == []
