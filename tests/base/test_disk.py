"""The one way to files: no link, no pipe, nothing outside; and no other way in the core."""

import ast
import os
import sys
from pathlib import Path

import pytest
from make_house import PACKAGES, modules

from medialis.base import cache_folder, disk
from medialis.base.disk import Folder

PACKAGE = Path(cache_folder.PACKAGE)
unix = pytest.mark.skipif(sys.platform == "win32", reason="links and pipes need rights there")


@pytest.fixture(params=[True, False], ids=["descriptors", "paths"])
def way(request, monkeypatch):
    """Both ways: names in open folders, and paths, as on Windows."""
    if request.param and not disk.AT:
        pytest.skip("no names in open folders here")
    monkeypatch.setattr(disk, "AT", request.param)


@unix
@pytest.mark.usefixtures("way")
def test_links_pipes_and_names_that_lead_elsewhere_are_refused(tmp_path):
    (tmp_path / "secret").write_text("secret")
    inner = tmp_path / "inner"
    inner.mkdir()
    (inner / "link").symlink_to(tmp_path / "secret")
    (inner / "way").symlink_to(tmp_path)
    (inner / "dangling").symlink_to(tmp_path / "new")
    os.mkfifo(inner / "pipe")
    with Folder.at(inner) as folder:
        for name in ("link", "dangling", "pipe", "way", "missing"):
            with pytest.raises(OSError, match=r"link|regular|no such"):
                folder.read(name)
            with pytest.raises(OSError, match=r"."):
                folder.folder(name)
        for name in ("../secret", "..", ".", "", str(tmp_path / "secret"), "a\0b", "way/secret"):
            with pytest.raises(OSError, match="not the name"):
                folder.read(name)
        for name in ("link", "dangling", "pipe", "way"):
            with pytest.raises(FileExistsError):
                folder.new(name)
        with pytest.raises(OSError, match="link"):
            folder.open_regular("dangling", os.O_RDWR | os.O_CREAT)
        folder.empty()
        assert folder.names() == []
    assert (tmp_path / "secret").read_text() == "secret" and not (tmp_path / "new").exists()


@unix
@pytest.mark.skipif(not disk.AT, reason="names cannot be looked up in open folders")
def test_a_folder_that_is_open_stays_the_same(tmp_path):
    """Its name may be given to a link meanwhile: what is written by path goes to the folder."""
    (tmp_path / "victim").mkdir()
    (tmp_path / "own").mkdir()
    with Folder.at(tmp_path / "own") as folder, folder.held():
        (tmp_path / "own").rename(tmp_path / "moved")
        (tmp_path / "own").symlink_to("victim")
        with disk.folder_of(tmp_path / "own" / "a") as (place, name), place.new(name) as stream:
            stream.write(b"mine")
        assert disk.read_file(tmp_path / "own" / "a") == b"mine"
    assert (tmp_path / "moved" / "a").read_bytes() == b"mine"
    assert list((tmp_path / "victim").iterdir()) == []


@unix
@pytest.mark.usefixtures("way")
def test_below_a_folder_no_link_is_followed_and_above_it_those_of_the_user(tmp_path):
    (tmp_path / "real" / "a").mkdir(parents=True)
    (tmp_path / "own").symlink_to("real")
    (tmp_path / "real" / "b").symlink_to("a")
    with Folder.at(tmp_path / "own" / "a", tmp_path / "own") as folder:
        assert folder.names() == []
    with pytest.raises(OSError, match="link"):
        Folder.at(tmp_path / "own" / "b", tmp_path / "own")
    made = []
    with pytest.raises(OSError, match="link"):
        disk.make_folders(tmp_path / "own" / "b" / "c", made, tmp_path / "own")
    assert made == [] and list((tmp_path / "real" / "a").iterdir()) == []


@unix
@pytest.mark.skipif(sys.platform == "win32" or os.geteuid() != 0, reason="gives links away")
def test_links_of_others_where_others_may_write_are_not_followed(tmp_path):
    (tmp_path / "victim").mkdir()
    (tmp_path / "shared").mkdir()
    link = tmp_path / "shared" / "out"
    link.symlink_to(tmp_path / "victim")
    (tmp_path / "shared").chmod(0o1777)
    disk.refuse_links_of_others(link)  # one's own
    os.lchown(link, 65534, 65534)
    with pytest.raises(PermissionError, match="another user"):
        disk.refuse_links_of_others(link / "deeper")
    (tmp_path / "shared").chmod(0o755)
    disk.refuse_links_of_others(link)  # nobody but its owner could have put it there


FORBIDDEN = {
    "os": {
        *("open", "replace", "rename", "renames", "remove", "unlink", "rmdir", "removedirs"),
        *("mkdir", "makedirs", "link", "symlink", "scandir", "listdir", "truncate", "mkfifo"),
        *("chmod", "chown", "utime"),
    },
    "shutil": {"copy", "copy2", "copyfile", "copytree", "move", "rmtree", "copyfileobj"},
    "tempfile": {"*"},
    "io": {"open", "FileIO"},
    "np": {"load", "save", "savez", "savez_compressed", "fromfile", "loadtxt", "savetxt", "memmap"},
}
METHODS = {
    *("open", "read_bytes", "read_text", "write_bytes", "write_text", "unlink", "rmdir", "mkdir"),
    *("rename", "touch", "iterdir", "glob", "rglob", "symlink_to", "hardlink_to", "tofile"),
}
"""Of paths; so is `replace` with one argument."""

OWN = "files of the package itself"
PASSING = "a folder that the system has just made for this process, with a new name"
ALLOWED = {
    "base/cache_folder.py": ("Path.rglob Path.glob Path.read_bytes Path.mkdir Path.touch "
                             "tempfile.gettempdir os.open",
                             f"{OWN}; the folder of kernels, which has rules of its own"),
    "base/gpu.py": ("Path.read_bytes", OWN),
    "base/jit.py": ("Path.rglob Path.read_bytes Path.read_text Path.glob Path.open",
                    f"{OWN}; a list for those who make kernels"),
    "base/version.py": ("Path.read_text Path.glob", f"{OWN}, and what installing noted of it"),
    "operations/names.py": ("Path.rglob Path.read_text", OWN),
    "show/annotation.py": ("np.load", OWN),
    "show/colors.py": ("np.load", OWN),
    "show/reports/page.py": ("Path.read_text", OWN),
    "show/viewer/page.py": ("Path.read_bytes tempfile.mkdtemp Path.open",
                            f"{OWN}; {PASSING}; webbrowser.open is no file"),
    "show/writing.py": ("Path.open", "a file in an open folder, by its name there"),
    "cli/commands.py": ("Path.open os.open", "webbrowser.open is no file; the device for nothing"),
    "cli/doctor.py": ("Path.glob Path.read_text", "notes that installing wrote beside plugins"),
    "hosts/machine.py": ("Path.glob", "where other programs are installed"),
    "hosts/compile_ahead.py": ("tempfile.TemporaryDirectory os.open os.scandir Path.touch "
                               "Path.read_text", f"{PASSING}; the folder of kernels; {OWN}"),
    "hosts/computing.py": ("tempfile.TemporaryFile Path.glob Path.unlink",
                           "the folder of a host, which is its own"),
    "hosts/computing_child.py": ("tempfile.mkstemp Path.open Path.unlink Path.rglob "
                                 "Path.glob Path.rmdir",
                                 "the folder of a host, which is its own; the folder of kernels"),
    "formats/foreign.py": ("os.open", "the device for nothing"),
    "formats/scans.py": ("Path.open tempfile.TemporaryDirectory Path.write_bytes",
                         f"laspy.open reads from memory; {PASSING}"),
    "formats/json_npz.py": ("Path.open", "members of archives in memory"),
    "medial_meshes/operation.py": ("np.load np.savez_compressed", "in memory"),
    "batches/huge.py": ("np.memmap", "of files that are open"),
    "batches/jobs.py": ("Path.open", "`Folder.open`"),
    "formats/output_folder.py": ("Path.open", "`Folder.open`"),
}  # fmt: skip
"""What else is called, and why that is no way to files of users."""


def calls(path):
    """Yield what a file calls that opens, lists, replaces or removes files."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.Call):
            continue
        call = node.func
        if isinstance(call, ast.Name) and call.id == "open":
            yield "open"
        if not isinstance(call, ast.Attribute):
            continue
        module = call.value.id if isinstance(call.value, ast.Name) else ""
        if module in FORBIDDEN:
            if FORBIDDEN[module] & {"*", call.attr}:
                yield f"{module}.{call.attr}"
        elif call.attr in METHODS or (call.attr == "replace" and len(node.args) == 1
                                      and not node.keywords):  # fmt: skip
            yield f"Path.{call.attr}"


@pytest.mark.slow
def test_the_core_has_no_other_way_to_files():
    """What opens, lists, replaces or removes files of users does so by `medialis.base.disk`."""
    assert "medialis" in PACKAGES
    unused, found = {name: set(words.split()) for name, (words, _) in ALLOWED.items()}, []
    for path in modules():
        name = path.relative_to(PACKAGE).as_posix()
        if name == "base/disk.py":
            continue
        used = set(calls(path))
        found += [f"{name}: {call}" for call in sorted(used - unused.get(name, set()))]
        unused[name] = unused.get(name, set()) - used
    assert found == []
    assert {name: left for name, left in unused.items() if left} == {}
