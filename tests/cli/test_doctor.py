"""`medialis doctor` tells the truth about an installation, on this machine and on made-up ones."""

import json
import os
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import pytest

from medialis.base import gpu
from medialis.base.errors import GpuError
from medialis.base.version import package_version
from medialis.cli import doctor
from medialis.cli.commands import main
from medialis.hosts import menu_entries
from medialis.hosts.machine import EXTENSION, Machine
from medialis.hosts.menu import FILTER_NOTE, PROGRAM_NOTE, write_notes
from on_gpu.driver import FakeDriver, install

posix = pytest.mark.skipif(os.name == "nt", reason="plays programs by shell scripts")


@pytest.fixture
def machine(tmp_path) -> Machine:
    root = tmp_path / "machine"
    (root / "home").mkdir(parents=True)
    (root / "bin").mkdir()
    return Machine("linux", root, root / "home", {"PATH": str(root / "bin")})


@pytest.fixture
def quick(monkeypatch):
    """Nothing is imported: the tests of the rest need not wait for it."""
    monkeypatch.setattr(doctor, "_loads", lambda module: "")


def test_what_lies_in_the_folder_is_not_what_is_installed(tmp_path, monkeypatch):
    """A file numpy.py in the current folder was imported, and numpy called broken (fixed)."""
    (tmp_path / "numpy.py").write_text("raise ImportError('not this one')")
    monkeypatch.chdir(tmp_path)
    assert doctor._loads("numpy") == ""


def test_a_folder_that_is_gone_does_not_matter(tmp_path, monkeypatch):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    assert Machine(home=tmp_path).root.exists()


def program(path: Path, text: str, code: int = 0) -> Path:
    path.write_text(f'#!/bin/sh\necho "{text}"\nexit {code}\n')
    path.chmod(0o755)
    return path


def by_name(findings):
    return {finding.name.strip(): finding for finding in findings}


@pytest.mark.slow
def test_a_sound_installation_has_nothing_broken(machine, monkeypatch, capsys):
    monkeypatch.setattr(doctor, "Machine", lambda: machine)
    monkeypatch.setattr(doctor, "record", dict)  # nothing is made ahead: numba is needed
    assert main(["doctor", "--json"]) == 0
    found = {entry["name"]: entry for entry in json.loads(capsys.readouterr().out)}
    assert found["numba"]["text"] == version("numba") and found["medialis"]["state"] == "ok"


def test_the_report_names_everything_and_what_to_do(machine, quick):
    findings = doctor.examine(machine)
    text = doctor.as_text(findings)
    assert all(f"{one.name}  " in text and one.text in text for one in findings)  # columns
    assert [f.name for f in findings if f.state != "ok" and not f.advice] == []
    assert "-> get Blender 4.2 or later from blender.org" in text


def test_what_is_missing_comes_with_the_way_to_get_it(monkeypatch, machine, quick):
    def installed(name):
        if name in ("scipy", "distributed", "lxml"):
            raise PackageNotFoundError(name)
        return "1.0"

    monkeypatch.setattr(doctor, "version", installed)
    found = by_name(doctor.examine(machine))
    assert found["scipy"].state == "broken" and found["scipy"].advice == "pip install scipy"
    assert found["extra dask"].state == found["extra io"].state == "missing"
    assert found["extra io"].text.startswith("lxml not installed")
    assert found["extra dask"].advice == 'pip install "medialis[dask]"'


@pytest.mark.slow
def test_a_package_that_cannot_be_loaded_is_found_out(tmp_path, monkeypatch, machine, capsys):
    """It is installed, so its version is known; only loading it tells."""
    (tmp_path / "numba.py").write_text("raise ImportError('Numba needs NumPy 1.0 or less')")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(doctor, "Machine", lambda: machine)
    monkeypatch.setattr(doctor, "EXTRAS", {})
    monkeypatch.setattr(doctor, "record", dict)
    assert main(["doctor"]) == 2
    printed = capsys.readouterr().out
    expected = "installed and cannot be loaded: ImportError: Numba needs NumPy 1.0 or less"
    assert f"BROKEN numba {version('numba')} is {expected}" in " ".join(printed.split())
    assert "-> pip install --force-reinstall numba" in printed and "kernel cache" not in printed


@pytest.mark.slow
def test_a_computation_without_its_packages_points_to_the_doctor(tmp_path):
    (tmp_path / "numba.py").write_text("raise ImportError('Numba needs NumPy 1.0 or less')")
    path = os.pathsep.join([str(tmp_path), *filter(None, sys.path)])
    done = subprocess.run(
        [sys.executable, "-m", "medialis", "demo", "-o", str(tmp_path / "out")],
        env={**os.environ, "PYTHONPATH": path, "MEDIALIS_KERNELS": "numba"},
        capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    expected = "a package cannot be loaded: Numba needs NumPy 1.0 or less; see medialis doctor."
    assert (done.returncode, done.stderr) == (2, f"medialis: {expected}\n")
    assert not (tmp_path / "out").exists()


def test_kernels_of_other_pythons_do_not_count(tmp_path, monkeypatch, machine, quick):
    this = "py{}{}".format(*sys.version_info)
    for name in (f"a.{this}.1.nbc", f"a.{this}.nbi", "a.py36.1.nbc"):
        (tmp_path / name).touch()
    monkeypatch.setattr(doctor, "record", dict)  # nothing is made ahead
    monkeypatch.setattr(doctor, "kernel_cache", lambda: tmp_path)
    assert ": 1 kernels of this Python" in by_name(doctor.examine(machine))["kernel cache"].text


def test_kernels_made_ahead_are_said(monkeypatch, machine, quick):
    """With them numba is not needed, so it is not looked for, and there is no cache to tell of."""
    made = {"base/_made": {"size": 2_000_000}, "walls/_made": {"size": 1_000_000}}
    monkeypatch.setattr(doctor, "record", lambda: made)
    found = by_name(doctor.examine(machine))
    assert found["kernels"].text.endswith("for this Python: 2 modules, 3.0 MB")
    assert not {"numba", "llvmlite", "kernel cache"} & set(found)


def test_threads_are_not_those_of_numba(machine, quick, monkeypatch):
    monkeypatch.setenv("NUMBA_NUM_THREADS", "1")
    found = by_name(doctor.examine(machine))["threads"]
    assert found.text.startswith(f"{doctor.thread_count()}, ") and "NUMBA_NUM_THREADS" in found.text


def test_the_kernel_cache_is_looked_at_and_not_made(tmp_path, monkeypatch, machine, quick):
    monkeypatch.setattr(doctor, "record", dict)  # nothing is made ahead
    monkeypatch.setattr(doctor, "kernel_cache", lambda: tmp_path / "a" / "b")
    monkeypatch.setattr(doctor, "kernels_are_compiled", lambda: False)
    found = by_name(doctor.examine(machine))["kernel cache"]
    assert (
        found.state == "ok" and "0 kernels of" in found.text and "medialis warmup" in found.advice
    )
    assert not (tmp_path / "a").exists()


@pytest.mark.parametrize("folder", ["no folder", "no rights"])
def test_a_cache_that_cannot_be_written_says_what_to_do(
    tmp_path, monkeypatch, machine, quick, folder
):
    (tmp_path / "no folder").write_text("a file")
    monkeypatch.setattr(doctor, "record", dict)  # nothing is made ahead
    monkeypatch.setattr(doctor, "kernel_cache", lambda: tmp_path / folder / "kernels")
    if folder == "no rights":
        monkeypatch.setattr(doctor.os, "access", lambda path, mode: mode == os.F_OK)
    found = by_name(doctor.examine(machine))["kernel cache"]
    assert found.state == "missing" and "every start compiles anew" in found.text
    assert "MEDIALIS_CACHE_DIR" in found.advice


@posix
@pytest.mark.parametrize("place", [".", "kernels"])
def test_a_cache_that_others_can_write_to_says_what_to_do(
    tmp_path, monkeypatch, machine, quick, place
):
    """The doctor called a folder fine that no computation uses (fixed)."""
    (tmp_path / "cache" / "kernels").mkdir(parents=True)
    (tmp_path / "cache" / place).chmod(0o770)
    monkeypatch.setattr(doctor, "record", dict)  # nothing is made ahead
    monkeypatch.setattr(doctor, "kernel_cache", lambda: tmp_path / "cache" / "kernels")
    found = by_name(doctor.examine(machine))["kernel cache"]
    assert found.state == "missing" and "other users can write to" in found.text
    assert "MEDIALIS_CACHE_DIR" in found.advice


def test_without_a_home_folder_hosts_are_not_looked_for(monkeypatch, quick):
    def none():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", none)
    assert "variable HOME" in by_name(doctor.examine())["hosts"].text


@posix
@pytest.mark.parametrize(
    ("text", "code", "state", "expected"),
    [
        ("Blender 5.2.0 LTS", 0, "ok", "5.2.0 ("),
        ("Blender 3.4.1", 0, "missing", "too old"),
        ("", 1, "broken", "cannot be run: it ended with code 1"),
        ("Segmentation fault", 0, "broken", "does not say its version"),
    ],
)
def test_blender_is_asked_for_its_version(machine, quick, text, code, state, expected):
    program(machine.root / "bin" / "blender", text, code)
    found = by_name(doctor.examine(machine))
    assert found["Blender"].state == state and expected in found["Blender"].text
    assert (
        found["extension"].state == "missing" and "Install from Disk" in found["extension"].advice
    )


@pytest.mark.parametrize(
    ("platform", "folder"),
    [
        ("linux", ".config/blender/4.5/extensions/user_default"),
        ("darwin", "Library/Application Support/Blender/4.5/extensions/user_default"),
        ("win32", "AppData/Roaming/Blender Foundation/Blender/4.5/extensions/user_default"),
    ],
)
def test_the_installed_extension_is_found(machine, quick, platform, folder):
    manifest = machine.home / folder / EXTENSION
    manifest.parent.mkdir(parents=True)
    manifest.write_text('version = "1.2.3"')
    there = Machine(platform, machine.root, machine.home, machine.environment)
    found = by_name(doctor.examine(there))["extension"]
    assert found.state == "ok" and found.text == f"1.2.3 in {manifest.parent}"
    manifest.write_text("version =")
    found = by_name(doctor.examine(there))["extension"]
    assert found.state == "broken" and "again" in found.advice


def test_folders_that_are_named_for_blender_are_looked_at(machine):
    resources, extensions = machine.root / "resources", machine.root / "extensions"
    expected = [extensions / "here" / EXTENSION, resources / "extensions" / "there" / EXTENSION]
    for manifest in expected:
        manifest.parent.mkdir(parents=True)
        manifest.touch()
    variables = {"BLENDER_USER_RESOURCES": resources, "BLENDER_USER_EXTENSIONS": extensions}
    named = {name: str(folder) for name, folder in variables.items()}
    assert Machine("linux", machine.root, machine.home, named).blender_extensions() == expected


@pytest.mark.parametrize(
    ("platform", "name", "file"),
    [
        ("darwin", "blender", "Applications/Blender.app/Contents/MacOS/Blender"),
        ("win32", "blender", "Program Files/Blender Foundation/Blender 4.5/blender.exe"),
        ("linux", "blender", "opt/blender-4.5/blender"),
        ("darwin", "meshlab", "Applications/MeshLab2025.07.app/Contents/MacOS/meshlab"),
    ],
)
def test_programs_are_found_where_they_usually_are(machine, platform, name, file):
    (machine.root / file).parent.mkdir(parents=True)
    (machine.root / file).touch()
    there = Machine(platform, machine.root, machine.home, machine.environment)
    assert there.programs(name) == [machine.root / file]


def test_meshlab_and_its_plugin_are_missing(machine, quick):
    found = by_name(doctor.examine(machine))
    assert found["MeshLab"].state == found["plugin"].state == "missing"
    assert "meshlab.net" in found["MeshLab"].advice and "meshlab-install" in found["plugin"].advice


@pytest.mark.slow
def test_the_filters_beside_the_plugin_are_of_this_medialis(machine, quick):
    folder = machine.root / "usr" / "lib" / "x86_64-linux-gnu" / "meshlab" / "plugins"
    folder.mkdir(parents=True)
    (folder / "libfilter_medialis.so").touch()

    def its_filters():
        return by_name(doctor.examine(machine))["its filters"]

    assert its_filters().state == "broken" and "adds nothing" in its_filters().text
    write_notes(folder)
    assert its_filters().state == "ok"
    assert its_filters().text == f"{len(menu_entries())}, of this medialis"
    table = (folder / FILTER_NOTE).read_text("utf-8").replace(package_version(), "0.9")
    (folder / FILTER_NOTE).write_text(table, "utf-8")
    assert its_filters().state == "missing" and "of medialis 0.9" in its_filters().text
    assert its_filters().advice == "run medialis meshlab-install again"


@posix
def test_the_python_of_the_plugin_is_run(machine, quick, monkeypatch, tmp_path):
    folder = machine.root / "usr" / "lib" / "x86_64-linux-gnu" / "meshlab" / "plugins"
    folder.mkdir(parents=True)
    (folder / "libfilter_medialis.so").touch()
    python = tmp_path / "python"
    (folder / PROGRAM_NOTE).write_text(f"{python}\n")

    def its_python():
        found = by_name(doctor.examine(machine))
        assert str(folder) in found["MeshLab"].text and found["plugin"].state == "ok"
        return found["its Python"]

    assert its_python().text == f"{python} cannot run medialis: no such file or directory"
    program(python, "", 1)
    assert its_python().state == "broken" and "meshlab-install" in its_python().advice
    program(python, "medialis 1.2$PYTHONHOME")
    monkeypatch.setenv("PYTHONHOME", "/of/the/host")  # the plugin does not hand it on
    assert its_python().text == f"{python} has medialis 1.2" and its_python().state == "ok"
    (folder / PROGRAM_NOTE).unlink()
    assert its_python().state == "missing" and "runs `medialis` from the path" in its_python().text
    assert sys.executable not in its_python().text


def test_a_gpu_is_tried(machine, quick, monkeypatch):
    driver = FakeDriver()
    install(monkeypatch, driver)
    finding = by_name(doctor.examine(machine))["GPU"]
    assert finding.state == "ok" and "Fake GPU, driver for CUDA 12.4" in finding.text
    driver.fails = "cuLaunchKernel", driver.calls["cuLaunchKernel"] + 1, 719
    finding = by_name(doctor.examine(machine))["GPU"]
    assert finding.state == "broken" and "cuLaunchKernel failed: made to fail (719)" in finding.text
    monkeypatch.setattr(gpu.Session, "get", lambda self, array, out: out)
    finding = by_name(doctor.examine(machine))["GPU"]
    assert finding.state == "broken" and "others than those of the processor" in finding.text


def test_no_gpu_is_nothing_broken(machine, quick, monkeypatch):
    install(monkeypatch, None)
    monkeypatch.setattr(gpu, "load_library", lambda: (_ for _ in ()).throw(GpuError("none here.")))
    finding = by_name(doctor.examine(machine))["GPU"]
    assert (finding.state, finding.text) == ("missing", "not used: none here.")
