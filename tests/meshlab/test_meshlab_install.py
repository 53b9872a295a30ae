"""`medialis meshlab-install` on a folder that plays the whole machine."""

import json
import os
import platform
import sys
import zipfile
from pathlib import Path

import pytest

import medialis
from medialis.cli.commands import main
from medialis.hosts import Machine, menu_entries
from medialis.hosts.menu import FILTER_NOTE, PROGRAM_NOTE
from medialis_meshlab_plugin import install as installer
from medialis_meshlab_plugin.install import (
    BUILD_NOTE,
    Built,
    built_plugins,
    install,
    install_for,
    this_system,
    wanted_hosts,
)


@pytest.fixture
def machine(tmp_path, monkeypatch) -> Machine:
    root = tmp_path / "machine"
    (root / "home").mkdir(parents=True)
    monkeypatch.setattr(installer, "_pymeshlab", lambda: iter(()))
    monkeypatch.setattr(installer, "_installed", list)
    return Machine("linux", root, root / "home", {"PATH": str(root / "usr" / "bin")})


def built(folder: Path, release: str, name: str = "libfilter_medialis.so", system=None) -> Path:
    folder.mkdir(parents=True)
    (folder / name).write_bytes(b"plugin for " + release.encode())
    about = {"meshlab": release} | ({} if system is None else {"system": system})
    (folder / BUILD_NOTE).write_text(json.dumps(about))
    return folder / name


def library(folder: Path, release: str, name: str = "libmeshlab-common.so") -> None:
    """A file as the library is: the release somewhere between other bytes."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_bytes(b"\x7fELF 1999.12 \0" + release.encode() + b"H\x89\0")


def system_folder(machine: Machine, release: str = "2020.09") -> Path:
    folder = machine.root / "usr" / "lib" / "x86_64-linux-gnu" / "meshlab" / "plugins"
    library(folder.parent, release)
    folder.mkdir(parents=True)
    return folder


def install_all(machine: Machine, place: Path, **named) -> list[Path]:
    """What the command does: for every MeshLab that is found."""
    chosen = wanted_hosts(named.get("release"), named.get("folder"), machine)
    with built_plugins(place, machine) as plugins:
        return [install_for(host, plugins, machine)[0] for host in chosen]


def test_each_meshlab_gets_the_plugin_of_its_release_and_precision(machine, tmp_path):
    """Debian's, and that of a user who has the 2023.12 of the site, in double precision."""
    system = system_folder(machine)
    user = machine.extra_folder("2023.12d", "double")
    user.mkdir(parents=True)
    plugins = {r: built(tmp_path / "p" / r, r) for r in ("2020.09", "2023.12", "2023.12d")}
    assert install_all(machine, tmp_path / "p") == [
        system / "libfilter_medialis.so", user / "libfilter_medialis.so",
    ]  # fmt: skip
    assert (system / "libfilter_medialis.so").read_bytes() == plugins["2020.09"].read_bytes()
    assert (user / "libfilter_medialis.so").read_bytes() == plugins["2023.12d"].read_bytes()


def test_the_release_of_a_newer_system_meshlab_is_read_from_its_library(machine, tmp_path):
    folder = system_folder(machine, "2022.02")
    built(tmp_path / "p" / "old", "2020.09")
    with pytest.raises(medialis.FileError, match=r"no built plugin for MeshLab 2022.02 \(single"):
        install_all(machine, tmp_path / "p")
    assert list(folder.iterdir()) == []
    built(tmp_path / "p" / "new", "2022.02")
    assert install_all(machine, tmp_path / "p") == [folder / "libfilter_medialis.so"]


@pytest.mark.parametrize(
    ("system", "near", "name", "program"),
    [
        ("darwin", "Applications/MeshLab2025.07.app/Contents/Frameworks",
         "libmeshlab-common.dylib", "Applications/MeshLab2025.07.app/Contents/MacOS/meshlab"),
        ("win32", "Program Files/VCG/MeshLab", "meshlab-common.dll",
         "Program Files/VCG/MeshLab/meshlab.exe"),
    ],
)  # fmt: skip
def test_meshlabs_of_other_systems_are_found_by_their_program(
    machine, tmp_path, system, near, name, program
):
    there = Machine(system, machine.root, machine.home, {"PATH": ""})
    library(machine.root / near, "2025.07d", name)
    (machine.root / program).parent.mkdir(parents=True, exist_ok=True)
    (machine.root / program).write_text("")
    (host,) = wanted_hosts(None, None, there)
    assert host.release == "2025.07d"
    assert host.folder == there.extra_folder("2025.07d", "double")


def test_pymeshlab_is_taken_where_there_is_no_meshlab(machine, tmp_path, monkeypatch):
    monkeypatch.undo()
    there = Machine("linux", machine.root, machine.home, {"PATH": ""})
    package = tmp_path / "site" / "pymeshlab"
    (package / "lib" / "plugins").mkdir(parents=True)
    (package / "__init__.py").write_text("raise RuntimeError('it must not be imported')")
    library(package / "lib", "2025.07d")
    monkeypatch.syspath_prepend(str(tmp_path / "site"))
    monkeypatch.delitem(sys.modules, "pymeshlab", raising=False)
    (host,) = wanted_hosts(None, None, there)
    assert (host.release, host.folder) == ("2025.07d", package / "lib" / "plugins")


def test_a_release_can_be_named_where_none_is_found(machine, tmp_path):
    with pytest.raises(medialis.FileError, match=r"AppImage.*--release 2025.07d"):
        wanted_hosts(None, None, machine)
    built(tmp_path / "p" / "a", "2025.07d")
    (file,) = install_all(machine, tmp_path / "p", release="2025.07d")
    assert file == machine.extra_folder("2025.07d", "double") / "libfilter_medialis.so"
    assert machine.plugins() == [file]


def test_a_release_archive_is_a_place_of_plugins(machine, tmp_path):
    folder = system_folder(machine)
    plugin = built(tmp_path / "p" / "a", "2020.09")
    with zipfile.ZipFile(tmp_path / "plugins.zip", "w") as archive:
        for file in plugin.parent.iterdir():
            archive.write(file, f"plugins/Linux-2020.09/{file.name}")
    assert install_all(machine, tmp_path / "plugins.zip") == [folder / plugin.name]
    with pytest.raises(medialis.FileError, match="no folder and no zip file"):
        install_all(machine, tmp_path / "none")


def test_plugins_of_other_systems_are_not_taken(machine, tmp_path):
    system_folder(machine)
    built(tmp_path / "p" / "a", "2020.09", system="Linux-riscv64")
    with pytest.raises(medialis.FileError, match=r"there are: none\. Install .*pip"):
        install_all(machine, tmp_path / "p")
    here = built(tmp_path / "p" / "b", "2020.09", system=f"Linux-{platform.machine()}")
    with built_plugins(tmp_path / "p", machine) as plugins:
        assert [plugin.file for plugin in plugins] == [here]
    assert this_system(machine) == f"Linux-{platform.machine()}"


def test_the_newest_built_plugin_of_a_release_is_taken(machine, tmp_path, monkeypatch):
    old = built(tmp_path / "build" / "plugin-a", "2020.09")
    new = built(tmp_path / "build" / "plugin-b", "2020.09")
    os.utime(new, (2e9, 2e9))
    os.utime(old, (1, 1))
    monkeypatch.chdir(tmp_path)
    with built_plugins(None, machine) as plugins:
        assert [plugin.file.name for plugin in plugins] == [new.name]
        assert plugins[0].file.resolve() == new


def test_filters_and_python_lie_beside_the_plugin(machine, tmp_path):
    folder = system_folder(machine)
    plugin = built(tmp_path / "p" / "a", "2020.09")
    written = install(plugin, folder, machine=machine, python="/some where/bin/python3")
    assert written[0].read_bytes() == plugin.read_bytes()
    assert sorted(folder.iterdir()) == sorted(written)
    assert (folder / PROGRAM_NOTE).read_text() == "/some where/bin/python3\n"
    table = json.loads((folder / FILTER_NOTE).read_text("utf-8"))
    assert [entry["name"] for entry in table["filters"]] == [e["name"] for e in menu_entries()]
    assert table["medialis"] == medialis.__version__
    install(plugin, folder, machine=machine)
    assert Path((folder / PROGRAM_NOTE).read_text().strip()) == Path(sys.executable).absolute()


def test_the_folders_that_the_environment_names_win(machine, tmp_path):
    there = Machine("linux", machine.root, machine.home, {"XDG_DATA_HOME": str(tmp_path / "data")})
    assert there.extra_folder("2025.07d", "double").is_relative_to(tmp_path / "data")
    windows = Machine("win32", machine.root, machine.home, {"APPDATA": str(tmp_path / "roaming")})
    assert windows.extra_folder("2025.07d", "double").is_relative_to(tmp_path / "roaming")


def test_what_is_missing_is_one_sentence(machine, tmp_path):
    with pytest.raises(medialis.FileError, match="there is no such file; build it with"):
        install(tmp_path / "nothing.so", tmp_path, machine=machine)
    with pytest.raises(medialis.FileError, match="there is no such folder"):
        wanted_hosts(None, str(tmp_path / "none"), machine)
    plugin = built(tmp_path / "p" / "a", "2020.09")
    (plugin.parent / BUILD_NOTE).write_text("{")
    with pytest.raises(medialis.InvalidOptionError, match=f"no readable {BUILD_NOTE}"):
        Built.of(plugin)
    assert list(machine.home.iterdir()) == []


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="needs a user with limits")
def test_a_folder_that_may_not_be_written_asks_for_an_administrator(machine, tmp_path):
    folder = system_folder(machine)
    folder.chmod(0o500)
    with pytest.raises(medialis.FileError, match=r"permission denied; .*administrator"):
        install(built(tmp_path / "p" / "a", "2020.09"), folder, machine=machine)
    assert list(folder.iterdir()) == []


def test_a_failed_copy_leaves_the_old_plugin(machine, tmp_path, monkeypatch):
    folder = system_folder(machine)
    plugin = built(tmp_path / "p" / "a", "2020.09")
    install(plugin, folder, machine=machine)

    def full(*arguments):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("shutil.copyfileobj", full)
    with pytest.raises(medialis.FileError, match="no space left on device"):
        install(plugin, folder, machine=machine)
    assert (folder / plugin.name).read_bytes() == plugin.read_bytes()
    assert len(list(folder.iterdir())) == 3


def test_the_command_says_where_and_what_is_missing(machine, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("medialis_meshlab_plugin.install.Machine", lambda: machine)
    folder = system_folder(machine)
    machine.extra_folder("2021.05", "float").mkdir(parents=True)
    built(tmp_path / "p" / "a", "2020.09")
    assert main(["meshlab-install", "--plugins", str(tmp_path / "p")]) == 0
    printed = capsys.readouterr()
    assert f"MeshLab 2020.09: {folder / 'libfilter_medialis.so'}" in printed.out
    assert "no built plugin for MeshLab 2021.05" in printed.err
    assert main(["meshlab-install", "--plugins", str(tmp_path / "p"), "--release", "2021.07"]) == 2
    assert "medialis: There is no built plugin for MeshLab 2021.07" in capsys.readouterr().err


def test_a_user_without_a_home_folder_gets_one_sentence(monkeypatch, capsys):
    def none():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", none)
    assert main(["meshlab-install"]) == 2
    expected = "medialis: Cannot find the home folder of this user: name it in the variable HOME.\n"
    assert capsys.readouterr().err == expected


def test_without_the_package_of_the_plugin_the_command_says_how_to_get_it(monkeypatch, capsys):
    monkeypatch.setattr("importlib.metadata.entry_points", lambda **_: ())
    assert main(["meshlab-install"]) == 2
    assert "pip install medialis-meshlab" in capsys.readouterr().err
