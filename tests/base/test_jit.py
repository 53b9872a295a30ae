"""The cache of kernels that numba compiles."""

import os
import subprocess
import sys

import numpy as np
import pytest

from medialis.base import cache_folder

COMPUTE = """\
import numpy as np
from medialis.base._kernels import find_root
from medialis.curves._kernels import median_of
print(find_root(np.array([0, 0, 1], np.int32), 2), median_of(np.array([3.0, 1.0, 2.0])))
"""
RESULT = "0 2.0"

posix = pytest.mark.skipif(os.name == "nt", reason="looks at owners and rights of Unix")


@pytest.mark.slow
def test_importing_the_package_loads_no_compiled_code():
    code = (
        "import sys, medialis, medialis.cli.commands; len(medialis.OPERATIONS); "
        "sys.exit(', '.join({'numba', 'scipy.spatial', 'scipy.sparse'} & set(sys.modules)))"
    )
    found = subprocess.run([sys.executable, "-c", code], stderr=subprocess.PIPE, text=True)
    assert found.stderr.strip() == ""


def test_hash_covers_every_kernel_source(tmp_path, monkeypatch):
    """A changed, added or renamed kernel file means another folder: never stale machine code."""
    kernels, topic = tmp_path / "base", tmp_path / "topic"
    kernels.mkdir()
    topic.mkdir()
    (kernels / "_kernels.py").write_text("one")
    (topic / "_b_kernels.py").write_text("two")
    (topic / "other.py").write_text("three")
    monkeypatch.setattr(cache_folder, "PACKAGE", tmp_path)
    cache_folder.kernel_cache.cache_clear()
    seen = []

    def folder():
        cache_folder.kernel_cache.cache_clear()
        return cache_folder.kernel_cache()

    try:
        seen.append(folder())
        (topic / "other.py").write_text("no kernel")
        assert folder() == seen[0]
        (topic / "_b_kernels.py").write_text("changed")
        seen.append(folder())
        (kernels / "_c_kernels.py").write_text("")
        seen.append(folder())
        (kernels / "_c_kernels.py").rename(kernels / "_d_kernels.py")
        seen.append(folder())
        assert len(set(seen)) == 4
    finally:
        monkeypatch.undo()
        cache_folder.kernel_cache.cache_clear()


def test_environment_names_the_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "b"))
    monkeypatch.delenv("MEDIALIS_CACHE_DIR", raising=False)
    assert cache_folder.user_cache() == tmp_path / "b"
    monkeypatch.setenv("MEDIALIS_CACHE_DIR", str(tmp_path / "a"))
    assert cache_folder.user_cache() == tmp_path / "a"
    monkeypatch.delenv("MEDIALIS_CACHE_DIR")
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    if sys.platform.startswith("linux"):
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "c"))
        assert cache_folder.user_cache() == tmp_path / "c" / "medialis"
    assert "medialis" in cache_folder.user_cache().parts


def test_a_finished_warmup_is_remembered_for_these_kernels(tmp_path, monkeypatch):
    monkeypatch.setenv("MEDIALIS_CACHE_DIR", str(tmp_path))
    cache_folder.kernel_cache.cache_clear()
    try:
        cache_folder.mark_compiled()  # no folder yet: nothing to remember, no error
        assert not cache_folder.kernels_are_compiled()
        cache_folder.kernel_cache().mkdir()
        cache_folder.mark_compiled()
        assert cache_folder.kernels_are_compiled()
        monkeypatch.setattr(cache_folder, "kernel_sources", list)
        cache_folder.kernel_cache.cache_clear()
        assert not cache_folder.kernels_are_compiled()
    finally:
        cache_folder.kernel_cache.cache_clear()


def run_code(code, **settings):
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        env={**os.environ, **settings},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return done


def compute(folder):
    return run_code(COMPUTE, MEDIALIS_CACHE_DIR=str(folder)).stdout.strip()


def entries(folder):
    """The index and the data of both kernels."""
    found = {
        (kernel, path.suffix): path
        for path in folder.rglob("*.nb?")
        for kernel in ("find_root", "median_of")
        if kernel in path.name
    }
    assert len(found) == 4
    return found


def test_processes_that_save_at_once_do_not_exchange_their_code(tmp_path, monkeypatch):
    """Numba numbers data: of two types of a kernel one ran the code of the other (fixed)."""
    from medialis.base.compiling import _CheckedFiles

    one, other = (_CheckedFiles(str(tmp_path), "kernel-1.py311", "stamp") for _ in range(2))
    with monkeypatch.context() as patch:  # both have read the index before the other wrote
        patch.setattr(_CheckedFiles, "_load_index", lambda files: {})
        one.save(("f4",), "code for f4")
        other.save(("f8",), "code for f8")
    found = {key: one.load((key,)) for key in ("f4", "f8")}
    assert found == {"f4": None, "f8": "code for f8"}  # what is not known is compiled again
    one.save(("f4",), "code for f4")
    assert other.load(("f4",)) == "code for f4" and other.load(("f8",)) == "code for f8"


@pytest.mark.slow
def test_damaged_entries_are_compiled_anew(tmp_path):
    """Of 150 damaged caches 17 crashed the process and 2 gave wrong numbers (fixed)."""
    from medialis.base.compiling import SUM, _checksum

    assert compute(tmp_path) == RESULT
    files = entries(tmp_path)
    sound = {place: path.read_bytes() for place, path in files.items()}

    def flipped(data, place):
        changed = bytearray(data)
        changed[place] ^= 1
        return bytes(changed)

    def exchanged(place):
        kernel, suffix = place
        return sound["median_of" if kernel == "find_root" else "find_root", suffix]

    data = [place for place in files if place[1] == ".nbc"]
    index = [place for place in files if place[1] == ".nbi"]
    damages = {
        "a bit in the code": {place: flipped(sound[place], -400) for place in data},
        "a bit of the checksum": {place: flipped(sound[place], 3) for place in data},
        "a bit of the index": {place: flipped(sound[place], SUM + 40) for place in index},
        "truncated": {place: sound[place][: len(sound[place]) // 2] for place in files},
        "empty": dict.fromkeys(files, b""),
        "exchanged data": {place: exchanged(place) for place in data},
        "exchanged index": {place: exchanged(place) for place in index},
    }
    for name, damage in damages.items():
        for place, content in damage.items():
            assert content != sound[place]
            files[place].write_bytes(content)
        assert compute(tmp_path) == RESULT, name
        for place in damage:
            content = files[place].read_bytes()
            assert content[:SUM] == _checksum(str(files[place]), content[SUM:]), name


@pytest.mark.slow
def test_sound_entries_are_not_compiled_again(tmp_path):
    assert compute(tmp_path) == RESULT
    before = {path: path.stat().st_mtime_ns for path in entries(tmp_path).values()}
    assert compute(tmp_path) == RESULT
    assert {path: path.stat().st_mtime_ns for path in before} == before


@pytest.mark.slow
def test_unwritable_cache_still_computes(tmp_path):
    (tmp_path / "file").write_text("a file where the folder should be")
    assert compute(tmp_path / "file") == RESULT


@posix
@pytest.mark.slow
def test_a_folder_that_others_can_write_to_is_not_used(tmp_path):
    """Machine code that another user had put there was run (fixed); the log says so once."""
    folder = tmp_path / "shared"
    folder.mkdir()
    folder.chmod(0o777)
    with_log = "import logging\nlogging.basicConfig()\n" + COMPUTE
    done = run_code(with_log, MEDIALIS_CACHE_DIR=str(folder))
    assert done.stdout.strip() == RESULT and list(folder.iterdir()) == []
    (line,) = done.stderr.splitlines()
    assert f"other users can write to {folder}" in line and "set MEDIALIS_CACHE_DIR" in line


@pytest.fixture
def own_cache(tmp_path, monkeypatch):
    """A cache folder of the test's own."""
    monkeypatch.setenv("MEDIALIS_CACHE_DIR", str(tmp_path / "cache"))
    cache_folder.kernel_cache.cache_clear()
    yield tmp_path / "cache"
    cache_folder.kernel_cache.cache_clear()


@posix
def test_a_folder_of_another_user_is_not_used(own_cache, monkeypatch, caplog):
    """Machine code of another user was run (fixed); the log says so once, with how to mend it."""
    from medialis.base import compiling, jit

    cache_folder.make_kernel_cache()
    monkeypatch.setattr(cache_folder.os, "geteuid", lambda: 12345)
    with pytest.raises(OSError, match="belongs to another user"):
        cache_folder.make_kernel_cache()
    compiling._say_once.cache_clear()
    for _ in range(2):
        assert jit.kernel(lambda a: a + 1)(1) == 2
    (record,) = caplog.records
    assert f"{own_cache} belongs to another user" in record.getMessage()
    assert "set MEDIALIS_CACHE_DIR to a folder" in record.getMessage()
    compiling._say_once.cache_clear()
    assert not list(own_cache.rglob("*.nb?"))


@posix
def test_a_folder_under_one_that_others_can_write_to_is_not_used(own_cache, monkeypatch):
    """They could put another folder in its place between a look and a read (fixed)."""
    own_cache.mkdir(0o700)
    own_cache.parent.chmod(0o777)
    with pytest.raises(OSError, match=f"other users can write to {own_cache.parent}$"):
        cache_folder.make_kernel_cache()
    own_cache.parent.chmod(0o1777)  # as /tmp: nobody renames the entries of others
    cache_folder.make_kernel_cache()


@posix
def test_a_link_in_a_folder_of_others_is_no_way_to_the_cache(tmp_path, monkeypatch):
    """The folders that a link lies in are looked at, as those of the way itself."""
    (tmp_path / "sound").mkdir(0o700)
    (tmp_path / "open").mkdir()
    (tmp_path / "open" / "link").symlink_to(tmp_path / "sound")
    (tmp_path / "first").symlink_to("open/link")
    assert cache_folder.written_by_others(tmp_path / "first") is None
    (tmp_path / "open").chmod(0o777)
    assert cache_folder.written_by_others(tmp_path / "sound") is None
    said = cache_folder.written_by_others(tmp_path / "first")
    assert said == f"other users can write to {tmp_path / 'open'}"


@posix
@pytest.mark.slow
def test_files_that_others_could_have_written_are_not_run(tmp_path):
    """Code put into a cache folder while it was open was run after it had been closed (fixed)."""
    assert compute(tmp_path) == RESULT
    before = {path: path.stat().st_ino for path in entries(tmp_path).values()}
    for path in before:
        path.chmod(0o666)
    assert compute(tmp_path) == RESULT
    after = entries(tmp_path).values()
    assert all(path.stat().st_mode & 0o022 == 0 for path in after)  # written anew
    assert all(before[path] != path.stat().st_ino for path in after)


@posix
def test_only_own_regular_files_are_read(tmp_path, monkeypatch):
    """A pipe does not make the reader wait; a link is not followed."""
    own = tmp_path / "own"
    own.write_bytes(b"code")
    own.chmod(0o600)
    (tmp_path / "link").symlink_to(own)
    os.mkfifo(tmp_path / "pipe")
    assert cache_folder.read_own(str(own)) == b"code"
    for name in ("link", "pipe", "nothing"):
        assert cache_folder.read_own(str(tmp_path / name)) is None
    monkeypatch.setattr(cache_folder.os, "geteuid", lambda: 12345)
    assert cache_folder.read_own(str(own)) is None


@posix
def test_folders_are_made_for_their_user_alone(own_cache):
    """Machine code is kept where others cannot write, so folders that we make are like that."""
    before = os.umask(0)
    try:
        cache_folder.make_kernel_cache()
    finally:
        os.umask(before)
    assert own_cache.stat().st_mode & 0o777 == 0o700
    assert cache_folder.kernel_cache().stat().st_mode & 0o777 == 0o700


def test_code_that_checks_bounds_has_a_folder_of_its_own(own_cache, monkeypatch):
    """A run with NUMBA_BOUNDSCHECK=1 left slow code for all later ones, or used theirs (fixed)."""
    folders = set()
    for settings in ({}, {"NUMBA_BOUNDSCHECK": "1"}, {"NUMBA_CPU_NAME": "generic"}):
        with monkeypatch.context() as changed:
            for name, value in settings.items():
                changed.setenv(name, value)
            changed.setenv("NUMBA_NUM_THREADS", str(len(folders) + 1))  # changes no code
            cache_folder.kernel_cache.cache_clear()
            folders.add(cache_folder.kernel_cache())
    assert len(folders) == 3


@posix
@pytest.mark.slow
def test_without_home_and_entry_of_the_user_kernels_are_kept_under_the_temporary_folder(tmp_path):
    """In a container whose user has no HOME and no entry every import failed (fixed)."""
    code = (
        "import os, pwd\ndef none(user):\n    raise KeyError(user)\npwd.getpwuid = none\n"
        "for name in ('HOME', 'XDG_CACHE_HOME', 'MEDIALIS_CACHE_DIR', 'NUMBA_CACHE_DIR'):\n"
        "    os.environ.pop(name, None)\n"
    )
    assert run_code(code + COMPUTE, TMPDIR=str(tmp_path)).stdout.strip() == RESULT
    assert set(entries(tmp_path / f"medialis-{os.getuid()}"))


def test_the_median_of_no_candidate_is_0():
    """With a single candidate, which has no neighbour, memory before the array was read (fixed)."""
    from medialis.curves._kernels import median_of

    for values, median in (([], 0.0), ([5.0], 5.0), ([4.0, 1.0], 2.5), ([3.0, 9.0, 1.0], 3.0)):
        assert median_of(np.array(values)) == median


def test_kernels_release_the_lock():
    from medialis.base.compiling import dispatcher_of
    from medialis.skeleton._ball_kernels import shrink_balls

    assert dispatcher_of(shrink_balls).targetoptions["nogil"]
