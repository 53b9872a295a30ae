"""`medialis meshlab-install` on a folder that plays the whole machine."""

import json
import os
import sys
from pathlib import Path

import pytest

import medialis
from medialis.cli.commands import main
from medialis.cli.machine import Machine
from medialis.cli.meshlab_install import BUILD_NOTE, PROGRAM_NOTE, build_of, find_built, install


@pytest.fixture
def machine(tmp_path) -> Machine:
    root = tmp_path / "machine"
    (root / "home").mkdir(parents=True)
    return Machine("linux", root, root / "home", {"PATH": str(root / "usr" / "bin")})


def built(folder: Path, version: str, scalar: str, name: str = "libfilter_medialis.so") -> Path:
    folder.mkdir(parents=True)
    (folder / name).write_bytes(b"plugin for " + version.encode())
    (folder / BUILD_NOTE).write_text(json.dumps({"meshlab": version, "scalar": scalar}))
    return folder / name


def system_folder(machine: Machine) -> Path:
    folder = machine.root / "usr" / "lib" / "x86_64-linux-gnu" / "meshlab" / "plugins"
    folder.mkdir(parents=True)
    return folder


def test_the_plugin_of_debian_goes_into_the_folder_of_the_system(machine, tmp_path):
    folder = system_folder(machine)
    plugin = built(tmp_path / "build", "2020.09", "float")
    written = install(plugin, machine=machine, python="/some where/bin/python3")
    assert written == [folder / "libfilter_medialis.so", folder / PROGRAM_NOTE]
    assert written[0].read_bytes() == plugin.read_bytes()
    assert written[1].read_text() == "/some where/bin/python3\n"
    assert sorted(folder.iterdir()) == sorted(written)


@pytest.mark.parametrize(
    ("platform", "scalar", "name", "expected"),
    [
        ("linux", "double", "libfilter_medialis.so", ".local/share/VCG/MeshLab_64bit_dp"),
        ("linux", "float", "libfilter_medialis.so", ".local/share/VCG/MeshLab_64bit_fp"),
        ("win32", "double", "filter_medialis.dll", "AppData/Roaming/VCG/MeshLab_64bit_dp"),
        ("darwin", "double", "libfilter_medialis.dylib",
         "Library/Application Support/VCG/MeshLab_64bit_dp"),
    ],
)  # fmt: skip
def test_later_meshlabs_look_in_the_folder_of_the_user(
    machine, tmp_path, platform, scalar, name, expected
):
    there = Machine(platform, machine.root, machine.home, {})
    plugin = built(tmp_path / "build", "2025.07d", scalar, name)
    written = install(plugin, machine=there)
    folder = machine.home / expected / "MeshLabExtraPlugins" / "2025.07d"
    assert written[0] == folder / name and written[0].is_file()
    assert Path(written[1].read_text().strip()) == Path(sys.executable).absolute()
    assert there.plugins() == [folder / name]


def test_the_folders_that_the_environment_names_win(machine, tmp_path):
    there = Machine("linux", machine.root, machine.home, {"XDG_DATA_HOME": str(tmp_path / "data")})
    assert there.extra_folder("2025.07d", "double").is_relative_to(tmp_path / "data")
    windows = Machine("win32", machine.root, machine.home, {"APPDATA": str(tmp_path / "roaming")})
    assert windows.extra_folder("2025.07d", "double").is_relative_to(tmp_path / "roaming")


def test_installing_again_replaces_and_a_named_folder_wins(machine, tmp_path):
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    plugin = built(tmp_path / "build", "2020.09", "float")
    install(plugin, folder=folder, machine=machine)
    plugin.write_bytes(b"newer")
    written = install(plugin, folder=folder, machine=machine)
    assert written[0].read_bytes() == b"newer" and len(list(folder.iterdir())) == 2


def test_what_is_missing_is_one_sentence(machine, tmp_path):
    with pytest.raises(medialis.FileError, match="there is no such file; build it with"):
        install(tmp_path / "nothing.so", machine=machine)
    plugin = built(tmp_path / "build", "2020.09", "float")
    with pytest.raises(medialis.FileError, match=r"Cannot find MeshLab 2020.09 .*--meshlab"):
        install(plugin, machine=machine)
    with pytest.raises(medialis.FileError, match="there is no such folder"):
        install(plugin, folder=tmp_path / "none", machine=machine)
    (plugin.parent / BUILD_NOTE).write_text("{")
    with pytest.raises(medialis.InvalidOptionError, match=f"no readable {BUILD_NOTE}"):
        build_of(plugin)
    with pytest.raises(medialis.FileError, match="Cannot find a built plugin"):
        find_built(tmp_path, machine)
    assert list(machine.home.iterdir()) == []


def test_the_newest_built_plugin_is_found(machine, tmp_path):
    old = built(tmp_path / "build" / "plugin-2020.09", "2020.09", "float")
    new = built(tmp_path / "build" / "plugin-2025.07d", "2025.07d", "double")
    os.utime(old, (1, 1))
    assert find_built(tmp_path, machine) == new


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="needs a user with limits")
def test_a_folder_that_may_not_be_written_asks_for_an_administrator(machine, tmp_path):
    folder = system_folder(machine)
    folder.chmod(0o500)
    with pytest.raises(medialis.FileError, match=r"permission denied; .*administrator"):
        install(built(tmp_path / "build", "2020.09", "float"), machine=machine)
    assert list(folder.iterdir()) == []


def test_a_failed_copy_leaves_the_old_plugin(machine, tmp_path, monkeypatch):
    folder = system_folder(machine)
    plugin = built(tmp_path / "build", "2020.09", "float")
    install(plugin, machine=machine)

    def full(*arguments):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("shutil.copyfileobj", full)
    with pytest.raises(medialis.FileError, match="no space left on device"):
        install(plugin, machine=machine)
    assert (folder / plugin.name).read_bytes() == plugin.read_bytes()
    assert len(list(folder.iterdir())) == 2


def test_the_command_prints_where(machine, tmp_path, capsys):
    folder = system_folder(machine)
    plugin = built(tmp_path / "build", "2020.09", "float")
    assert main(["meshlab-install", "--plugin", str(plugin), "--meshlab", str(folder)]) == 0
    assert str(folder / PROGRAM_NOTE) in capsys.readouterr().out
    assert main(["meshlab-install", "--plugin", str(tmp_path / "none")]) == 2
    assert "medialis: Cannot install" in capsys.readouterr().err


def test_a_user_without_a_home_folder_gets_one_sentence(monkeypatch, capsys):
    def none():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", none)
    assert main(["meshlab-install"]) == 2
    expected = "medialis: Cannot find the home folder of this user: name it in the variable HOME.\n"
    assert capsys.readouterr().err == expected
