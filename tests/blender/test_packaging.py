"""The extension as users get it: its zip, and the zip installed in a Blender of its own.

The sessions run in their own process and profile. The modules they can import at the start are bpy
and what bpy itself asks for: scipy and the core can only come from the zip, and numba is nowhere.
"""

from __future__ import annotations

import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
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


def _small_wheels(folder: Path, system: Any) -> list[Path]:
    """Return wheels in name only as a zip of a system has them: for each of its Pythons."""
    wheels = [_small_wheel(folder, "threadpoolctl-3.8.0-py3-none-any.whl")]
    for python in system.pythons:
        tags = f"cp{python.replace('.', '')}-cp{python.replace('.', '')}-{system.tags[0]}"
        wheels.append(_small_wheel(folder, f"scipy-1.1{python[-1]}.0-{tags}.whl"))
        wheels.append(_small_wheel(folder, f"medialis-{build.core_version()}-{tags}.whl"))
    return wheels


@pytest.mark.parametrize("system", build.SYSTEMS, ids=lambda system: system.name)
def test_zip_holds_what_is_shipped(system: Any, tmp_path: Path) -> None:
    """No tests, build scripts or caches; the version of the project; the same bytes again."""
    wheels = _small_wheels(tmp_path, system)
    target = tmp_path / system.zip_name(build.core_version())
    build.write_zip(target, system, [*wheels, wheels[0]])
    with zipfile.ZipFile(target) as archive:
        names = archive.namelist()
        manifest = tomllib.loads(archive.read("blender_manifest.toml").decode())
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert manifest["version"] == project["version"]
    assert manifest["platforms"] == [system.name]
    assert manifest["blender_version_min"] == "4.2.0"
    intel_mac = system.name == "macos-x64"
    assert manifest.get("blender_version_max") == ("5.1.0" if intel_mac else None)
    assert set(manifest["permissions"]) == {"files"}
    assert sorted(manifest["wheels"]) == sorted(f"./wheels/{wheel.name}" for wheel in wheels)
    assert {"LICENSE", "__init__.py", "blender_manifest.toml"} <= set(names)
    unwanted = re.compile(r"test|build_|packaging|__pycache__|\.pyc$|(^|/)\.|\.whl\.")
    assert [name for name in names if unwanted.search(name)] == []
    assert not [name for name in names if "numba" in name or "llvmlite" in name]
    again = tmp_path / "again.zip"
    build.write_zip(again, system, wheels)
    assert again.read_bytes() == target.read_bytes()


@pytest.mark.parametrize(
    "python, first, last", [("3.11", "4.2.0", "5.1.0"), ("3.13", "5.1.0", None)]
)
def test_zip_for_one_python_is_for_its_blenders(python: str, first: str, last: str | None) -> None:
    system = build.SYSTEMS[0]
    text = (build.ADDON / build.MANIFEST).read_text()
    manifest = tomllib.loads(build.filled_manifest(text, system, [], [python]))
    assert manifest["blender_version_min"] == first
    assert manifest.get("blender_version_max") == last
    assert system.zip_name("1.0", [python]) == f"medialis-1.0-{system.name}-python{python}.zip"
    assert system.zip_name("1.0", system.pythons) == f"medialis-1.0-{system.name}.zip"


@pytest.mark.parametrize("pythons", [("3.11",), ("3.11", "3.13")], ids=" ".join)
def test_zip_that_is_too_large_is_refused(
    pythons: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert build.LARGEST_ZIP == {1: 50_000_000, 2: 90_000_000}
    monkeypatch.setitem(build.LARGEST_ZIP, len(pythons), 1000)
    target = tmp_path / "large.zip"
    with pytest.raises(SystemExit, match=r"large.zip has [\d.]+ MB; 0 are allowed"):
        build.write_zip(target, build.SYSTEMS[0], [], pythons)
    assert not target.exists()


def test_given_cores_make_the_zips_of_other_systems(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Where one is missing, what has to be built elsewhere is said, and that zip is skipped."""
    cores, version = tmp_path / "cores", build.core_version()
    cores.mkdir()
    linux = "manylinux_2_27_x86_64.manylinux_2_28_x86_64"
    for tags in (
        f"cp311-cp311-{linux}",
        f"cp313-cp313-{linux}",
        "cp311-cp311-manylinux_2_28_aarch64",
        "cp311-cp311-win_amd64",
        "cp311-cp311-macosx_11_0_arm64",
        "cp313-cp313-macosx_11_0_arm64",
        "cp311-cp311-macosx_10_15_x86_64",
    ):
        _small_wheel(cores, f"medialis-{version}-{tags}.whl")
    _small_wheel(cores, "medialis-0.1-cp313-cp313-win_amd64.whl")  # of another version
    scipy = _small_wheel(tmp_path, "scipy-1.15.3-cp311-cp311-any.whl")
    monkeypatch.setattr(build, "fetch_wheels", lambda *a, **b: [scipy])
    monkeypatch.setattr(build, "this_system", lambda: build.SYSTEMS[0])
    made = tmp_path / "made"
    with pytest.raises(SystemExit):
        build.main(["--all", "--core", str(cores), "--output", str(made)])
    said = capsys.readouterr().out
    assert "Skipped: medialis for windows-x64, Python 3.13: build it there." in said
    names = {
        f"medialis-{version}-{system}.zip" for system in ("linux-x64", "macos-arm64", "macos-x64")
    }
    assert {path.name for path in made.iterdir()} == names
    with zipfile.ZipFile(made / f"medialis-{version}-linux-x64.zip") as archive:
        assert {name for name in archive.namelist() if "wheels/medialis" in name} == {
            f"wheels/medialis-{version}-{python}-{python}-{linux}.whl"
            for python in ("cp311", "cp313")
        }
    _small_wheel(cores, f"medialis-{version}-cp313-cp313-win_amd64.whl")
    build.main(["--all", "--core", str(cores), "--output", str(made)])
    assert "Skipped" not in capsys.readouterr().out
    assert len(list(made.iterdir())) == len(build.SYSTEMS)


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
    found = tomllib.loads(build.filled_manifest(manifest, build.SYSTEMS[0], []))
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
    for system in build.SYSTEMS:
        target = tmp_path / system.zip_name(build.core_version())
        build.write_zip(target, system, _small_wheels(tmp_path, system))
        assert (checked := _blender_tool("validate", str(target))).returncode == 0, checked


@pytest.mark.parametrize("python", build.BLENDERS)
def test_pins_are_exact_and_without_numpy(python: str) -> None:
    """All that the core depends on, but never numpy, which Blender brings, nor the compiler."""
    hashes = build.pinned_hashes(build.pins_of(python))
    names = [re.match(r"(\w+)==[\d.]+$", requirement)[1] for requirement in hashes]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    dependencies = {re.match(r"\w+", line)[0] for line in project["dependencies"]}
    assert set(names) == dependencies - {"numpy", "numba"}
    platforms = [system for system in build.SYSTEMS if python in system.pythons]
    any_platform = "threadpoolctl"  # pure Python: one wheel for all
    for requirement, sums in hashes.items():
        assert len(sums) == (1 if requirement.startswith(any_platform) else len(platforms))


def test_every_pin_is_used() -> None:
    pins = {build.pins_of(python) for python in build.BLENDERS}
    assert pins == set(PACKAGING.glob("wheels-*.txt"))


def test_changed_wheel_is_not_bundled(tmp_path: Path) -> None:
    folder = build.downloaded(build.SYSTEMS[1], "3.11", tmp_path)
    folder.mkdir()
    _small_wheel(folder, "scipy-1.15.3-cp311-cp311-win_amd64.whl")
    with pytest.raises(SystemExit, match="build once without --offline"):
        build.fetch_wheels(build.SYSTEMS[1], "3.11", tmp_path, offline=True)


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
    system, python = build.this_system(), build.this_python()
    if system is None or python not in system.pythons:
        pytest.skip("no Blender that the extension supports has this Python and platform")
    pins = build.pins_of(python)
    if build.pinned_wheels(build.downloaded(system, python, build.WHEELS), pins) is None:
        pytest.skip(f"needs the wheels that {pins.name} names: `make hosts` fetches them")
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

    def kernels(self) -> list[Path]:
        """Return every kernel that was compiled here, and every folder for such."""
        kinds = ("*.nbi", "*.nbc", "kernels", "kernels-*")
        return [path for kind in kinds for path in self.folder.rglob(kind)]


def _updated(extension: Path, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the next release: another version of the add-on, and a core with a line more."""
    copy = folder / "next"
    for name in ("medialis", "kernel_library"):
        shutil.copytree(ROOT / "core" / name, copy / "core" / name)
    shutil.copy(ROOT / "core" / "medialis_after_import.py", copy / "core")
    for name in ("pyproject.toml", "build_backend.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, copy)
    with (copy / "core" / "medialis" / "base" / "errors.py").open("a") as file:
        file.write("\nUPDATED = True\n")
    runs = build.builder(build.this_python(), offline=True)
    monkeypatch.setattr(build, "ROOT", copy)
    core = build.build_core(folder, runs)
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
    """Return the index of a repository: this zip, and those of other systems."""
    zips = folder / "repository"
    zips.mkdir()
    shutil.copy(extension, zips)
    for system in build.SYSTEMS:
        if system != build.this_system():
            target = zips / system.zip_name(build.core_version())
            build.write_zip(target, system, _small_wheels(folder, system))
    index = repository.make_repository(zips)
    assert len(json.loads(index.read_text())["data"]) == len(build.SYSTEMS)
    return index


def test_core_has_what_was_made_ahead(extension: Path) -> None:
    """One wheel, for this Python and system, with its machine code and the licence of numba."""
    tag = f"cp{build.this_python().replace('.', '')}"
    with zipfile.ZipFile(extension) as archive:
        (name,) = [name for name in archive.namelist() if "wheels/medialis-" in name]
        assert re.search(rf"\+core\.\w{{8}}-{tag}-{tag}-\w+\.whl$", name)
        with archive.open(name) as stream, zipfile.ZipFile(stream) as core:
            names = core.namelist()
    assert [name for name in names if re.fullmatch(r"medialis/base/made-[\w-]+\.json", name)]
    ending = sysconfig.get_config_var("EXT_SUFFIX")
    made = {
        path.relative_to(ROOT / "core").as_posix() for path in ROOT.rglob(f"core/*/*/_made{ending}")
    }
    assert len(made) > 8
    assert {name for name in names if "/_made." in name} == made
    assert [name for name in names if name.endswith("licenses/core/kernel_library/LICENSE.numba")]
    assert not [name for name in names if "self_test" in name or name.endswith(".c")]


def test_life_of_an_installation(
    extension: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Install from a repository, run on the bundled wheels, restart, update, uninstall; nothing is
    compiled, from the first click on, and there is nothing to compile with."""
    profile = Profile(tmp_path)
    index = _repository(extension, tmp_path)
    first = profile.session(f"repository={index.as_uri()}", "run")
    assert first["outcome"] == ["FINISHED"]
    assert first["new objects"] >= 1
    assert first["version"].startswith(build.core_version())
    assert {first["files"].pop(name) for name in ("numba", "llvmlite")} == {None}
    bundled = {name: file for name, file in first["files"].items() if name != "numpy"}
    wheels = str(tmp_path / "blender" / "extensions" / ".local")
    assert all(file.startswith(wheels) for file in bundled.values()), bundled
    assert first["files"]["numpy"].startswith(str(profile.site))  # Blender's own
    assert first["enabled"] and first["operator"] and not first["updated"]
    assert profile.kernels() == []
    assert not first["numba here"]

    clicked = profile.session("enable", "click")
    assert clicked["clicked"] == ["FINISHED"]
    restarted = profile.session("enable", "run")
    assert restarted["outcome"] == ["FINISHED"]
    updated = profile.session(f"install={_updated(extension, tmp_path, monkeypatch)}", "run")
    assert updated["outcome"] == ["FINISHED"] and updated["updated"]
    assert profile.kernels() == []

    disabled = profile.session("enable", "disable")
    assert disabled["known"] and not disabled["enabled"] and not disabled["operator"]
    gone = profile.session("enable", "uninstall")
    assert not gone["known"] and not gone["enabled"] and not gone["operator"]
    assert list((tmp_path / "blender" / "extensions").rglob("medialis*")) == []
