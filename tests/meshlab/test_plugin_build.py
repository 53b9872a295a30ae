"""What builds the plugin on systems that are not here: checked as far as one system can."""

import importlib.util
import json
import re
import subprocess
import sys

import pytest

from real_meshlab import PLUGIN, PROJECT, need

DUMPBIN = """\
Microsoft (R) COFF/PE Dumper Version 14.38.33133.0

File Type: DLL

    ordinal hint RVA      name

          1    0 0001C0A0 ??0MeshModel@@QEAA@HABVQString@@0@Z
          2    1 0001C3F0 ??1MLException@@UEAA@XZ
         12    B 000213F0 qt_plugin_query_metadata

  Summary
        1000 .data
"""


@pytest.fixture(scope="module")
def build():
    spec = importlib.util.spec_from_file_location("build_plugin", PLUGIN.parent / "build.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_names_of_a_library_of_windows_are_all_found(build):
    assert build.exported_names(DUMPBIN) == [
        "??0MeshModel@@QEAA@HABVQString@@0@Z", "??1MLException@@UEAA@XZ", "qt_plugin_query_metadata"
    ]  # fmt: skip


@pytest.mark.parametrize("name", ["libmeshlab-common.so", "libmeshlab-common.dylib",
                                  "meshlab-common.dll"])  # fmt: skip
def test_a_library_of_each_system_is_found_and_says_its_release(build, tmp_path, name):
    (tmp_path / name).write_bytes(b"\0abc 2025.07dH\0")
    assert build.library_in(tmp_path) == tmp_path / name
    assert build.release_of(tmp_path / name) == "2025.07d"
    (tmp_path / name).write_bytes(b"nothing")
    with pytest.raises(SystemExit, match="does not tell its release"):
        build.release_of(tmp_path / name)


def test_a_packaged_plugin_is_one_that_the_installer_takes(build, tmp_path, monkeypatch):
    from medialis.hosts import Machine
    from medialis_meshlab_plugin.install import built_plugins, this_system

    machine = Machine()
    folder = tmp_path / "build" / "plugin-2020.09"
    folder.mkdir(parents=True)
    plugin = folder / machine.plugin_name.replace(".so", ".dylib")
    plugin.write_bytes(b"plugin")
    about = {"meshlab": "2020.09", "system": this_system(machine)}
    (folder / build.NOTE).write_text(json.dumps(about))
    monkeypatch.setattr(build, "PACKAGED", tmp_path / "plugins")
    build.package([plugin])
    (file,) = (tmp_path / "plugins").rglob("*filter_medialis*")
    file.rename(file.with_name(machine.plugin_name))
    with built_plugins(tmp_path / "plugins", machine) as found:
        assert [(b.release, b.system) for b in found] == [("2020.09", this_system(machine))]


@pytest.mark.slow
def test_a_source_of_another_release_is_refused(tmp_path):
    """CMake says so before anything is compiled."""
    need("cmake")
    source = tmp_path / "source"
    (source / "src" / "common").mkdir(parents=True)
    (source / "src" / "vcglib" / "vcg").mkdir(parents=True)
    (source / "ML_VERSION").write_text("2023.12")
    refused = {
        "2025.07d": "The source is that of MeshLab 2023.12, not of 2025.07d",
        "new": "MESHLAB_RELEASE must be as in 2020.09",
    }
    for release, sentence in refused.items():
        done = subprocess.run(
            ["cmake", "-S", PLUGIN, "-B", tmp_path / release, f"-DMESHLAB_SOURCE={source}",
             f"-DMESHLAB_RELEASE={release}", "-DMESHLAB_LIBRARY=x"],
            capture_output=True, text=True,
        )  # fmt: skip
        assert done.returncode != 0 and sentence in re.sub(r"\s+", " ", done.stderr)


def test_the_script_explains_itself():
    command = [sys.executable, PROJECT / "meshlab_plugin" / "build.py", "--help"]
    assert "--all" in subprocess.run(command, capture_output=True, text=True, check=True).stdout
