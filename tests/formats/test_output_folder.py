"""Folders of results while each call of the system fails once or kills, and others are there."""

import errno
import json
import os
import subprocess
import sys
import threading

import pytest

from fuzz.hindered_disk import failing, hindered, killing
from medialis.base.errors import FileError
from medialis.formats.files import write_text
from medialis.formats.output_folder import MANIFEST, OutputFolder, remove_left

unix = pytest.mark.skipif(sys.platform == "win32", reason="needs links and forks")
OLD = {"a": "old a", "gone": "old gone", MANIFEST: json.dumps({"files": ["a", "gone", MANIFEST]})}
NEW = {"a": "new a", "sheets/b": "new b", MANIFEST: json.dumps({"files": ["a", MANIFEST]})}


def contents(folder):
    """Return what is in a folder by its names, hidden files as well; no folder of no file."""
    found = (path for path in folder.rglob("*") if not path.is_dir() or path.is_symlink())
    return {path.relative_to(folder).as_posix(): path.read_text() for path in found}


def write(out):
    with OutputFolder(out, replaced=lambda there: ["gone"]) as folder:
        for name, text in NEW.items():
            write_text(folder.file(name), text)


def begin(tmp_path, replaced):
    out = tmp_path / "deep" / "out"
    if replaced:
        out.mkdir(parents=True)
        for name, text in OLD.items():
            (out / name).write_text(text)
    return out


def steps(tmp_path, replaced):
    """Return how many calls there are."""
    with hindered(lambda number, name: None) as system:
        write(begin(tmp_path, replaced))
    return system.count


ERRORS = (errno.ENOSPC, errno.EIO, errno.EROFS, errno.EINTR)


@pytest.mark.slow
@pytest.mark.parametrize("replaced", [True, False])
@pytest.mark.parametrize("error", ERRORS, ids=errno.errorcode.get)
def test_each_call_that_fails_once_leaves_the_old_or_the_new_result(tmp_path, error, replaced):
    count, told = steps(tmp_path / "count", replaced), 0
    assert count > 20
    for number in range(count):
        out = begin(tmp_path / str(number), replaced)
        before = contents(tmp_path / str(number))
        try:
            with hindered(failing(number, error)):
                write(out)
        except FileError as failure:
            told += 1
            assert str(out) in str(failure) and ".out-" not in str(failure)
            now = {n: t for n, t in contents(tmp_path / str(number)).items() if "/.out-" not in n}
            assert now == before
        else:
            assert {n: t for n, t in contents(out).items() if n[0] != "."} == NEW
        remove_left(out)
        left = [name for name in contents(tmp_path / str(number)) if "/." in name]
        # A file whose removal failed lies in a hidden folder that nobody holds, or is gone.
        assert left == []
    assert told > count // 2


@unix
@pytest.mark.slow
@pytest.mark.parametrize("replaced", [True, False])
def test_after_a_kill_at_each_step_the_next_run_works_and_nothing_is_left(tmp_path, replaced):
    """Files of a killed run lay beside those of an older one, and of no result (fixed)."""
    count = steps(tmp_path / "count", replaced)
    for number in range(count):
        place = tmp_path / str(number)
        out = begin(place, replaced)
        before = contents(out) if out.exists() else {}
        process = os.fork()
        if process == 0:
            try:
                with hindered(killing(number)):
                    write(out)
            finally:
                os._exit(1)
        assert os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]) == 9
        if (out / MANIFEST).exists():  # whole, old or new
            assert contents(out) in (before, NEW)
        if number % 2:
            remove_left(out)
            now = contents(out) if out.exists() else {}
            assert now in (before, NEW)
        else:
            write(out)
            assert contents(out) == NEW
        assert [name for name in contents(place) if "/." in name or name[0] == "."] == []


@unix
def test_what_somebody_plants_beside_and_in_the_output_is_neither_followed_nor_emptied(tmp_path):
    """A link with the name of a hidden folder had the folder at its end emptied (fixed)."""
    victim = tmp_path / "victim"
    victim.mkdir()
    for name in (".medialis-lock", "precious", "a"):
        (victim / name).write_text("precious")
    out = tmp_path / "out"
    out.mkdir()
    for place in (tmp_path, out):
        (place / ".out-deadbeef").symlink_to(victim)
    (out / "a").symlink_to(victim / "a")
    (out / MANIFEST).symlink_to(victim / "precious")
    (tmp_path / ".out-0badcafe").mkdir()
    (tmp_path / ".out-0badcafe" / ".medialis-lock").symlink_to(victim / "precious")
    os.mkfifo(tmp_path / ".out-00000000")
    (tmp_path / ".out-11111111").mkdir()
    os.mkfifo(tmp_path / ".out-11111111" / ".medialis-lock")
    write(out)
    assert {name: (out / name).read_text() for name in NEW} == NEW
    assert not any((out / name).is_symlink() for name in NEW)
    assert contents(victim) == dict.fromkeys((".medialis-lock", "precious", "a"), "precious")
    (out / "sheets" / "b").unlink()
    (out / "sheets").rmdir()
    (out / "sheets").symlink_to(victim)
    with pytest.raises(FileError, match="link"):
        write(out)
    assert sorted(contents(victim)) == [".medialis-lock", "a", "precious"]


@unix
def test_a_journal_that_leads_elsewhere_moves_nothing(tmp_path):
    (tmp_path / "precious").write_text("precious")
    out, hidden = tmp_path / "out", tmp_path / ".out-deadbeef"
    for folder in (out, hidden, hidden / ".replaced"):
        folder.mkdir(mode=0o700)
    (hidden / ".medialis-lock").touch()
    (hidden / ".replaced" / "0").write_text("hostile")
    number = (tmp_path / "precious").stat().st_ino
    names = {"files": [["../precious", number]], "aside": ["../precious"], "folders": ["../out"]}
    (hidden / ".medialis-moves").write_text(json.dumps(names))
    remove_left(out)
    assert (tmp_path / "precious").read_text() == "precious" and out.exists()


@pytest.mark.slow
def test_runs_into_one_folder_at_once_are_never_mixed(tmp_path):
    """1 of 120 ended with a manifest that lists the other's file, 3 of 20 with an error (fixed)."""
    faults = []

    def many(mine):
        for _ in range(25):
            texts = {f"{mine}-{i}": mine for i in range(3)} | {"both": mine}

            def replaced(there):
                known = there.about(MANIFEST) is not None
                return json.loads(there.read(MANIFEST))["files"] if known else []

            try:
                with OutputFolder(tmp_path / "new" / "out", replaced=replaced) as folder:
                    for name, text in texts.items():
                        write_text(folder.file(name), text)
                    write_text(folder.file(MANIFEST), json.dumps({"files": [*texts, MANIFEST]}))
            except BaseException as error:  # noqa: BLE001 - threads tell nobody
                faults.append(error)

    threads = [threading.Thread(target=many, args=(name,)) for name in "xyz"]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert faults == []
    found = contents(tmp_path / "new" / "out")
    assert sorted(found) == sorted(json.loads(found[MANIFEST])["files"])
    assert len({text for name, text in found.items() if name != MANIFEST}) == 1
    assert os.listdir(tmp_path / "new") == ["out"]  # noqa: PTH208 - hidden ones as well


PAIR = """
import sys
from medialis.cli import main
sys.exit(main(["thickness", sys.argv[1], "-o", sys.argv[2], "--no-picture", "--refine", sys.argv[3],
               *sys.argv[4:]]))
"""


@pytest.mark.slow
def test_pairs_of_commands_into_one_folder_end_with_one_whole_result(tmp_path):
    """Both succeed with --overwrite; without it the second of them is refused in one line.

    A second one that begins when the first one has ended replaces its result, and says so.
    """
    import medialis

    medialis.write_mesh(tmp_path / "a.ply", medialis.make_shape(*cube(), repair=True))
    for turn in range(4):
        out = tmp_path / f"out{turn}"
        more = ["--overwrite"] if turn % 2 else []
        children = [
            subprocess.Popen(
                [sys.executable, "-c", PAIR, tmp_path / "a.ply", out, refine, *more],
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                text=True,
            )
            for refine in ("0.1", "0.2")
        ]
        ended = [(child.communicate()[1], child.returncode) for child in children]
        codes = sorted(code for _, code in ended)
        assert codes == [0, 0] or (codes == [0, 2] and not more), ended
        assert all(code == 0 or "Nothing was written" in said for said, code in ended), ended
        manifest = json.loads((out / MANIFEST).read_bytes())
        assert more or codes == [0, 2] or "refine" in manifest["replaced"]
        assert sorted(manifest["contents"]) == sorted(set(contents_bytes(out)) - {MANIFEST})
        for name, told in manifest["contents"].items():
            assert (out / name).stat().st_size == told["bytes"]
    assert [path.name for path in tmp_path.iterdir() if path.name[0] == "."] == []


def contents_bytes(folder):
    return {path.name: path.stat().st_size for path in folder.iterdir()}


def cube():
    from fuzz.nasty_shapes import grid_box

    return grid_box(4)


@pytest.mark.slow
def test_names_in_a_manifest_lead_nowhere_else(tmp_path):
    """A layer called `../private/secret` was read into the page (fixed)."""
    import medialis

    result = medialis.run("thickness", medialis.make_shape(*cube(), repair=True))
    manifest = medialis.write_result(
        result, tmp_path / "out", pictures=medialis.Pictures(main=False)
    )
    (tmp_path / "private").mkdir()
    secret = tmp_path / "private" / "secret.ply"
    layer = manifest["layers"][0]["name"]
    secret.write_bytes((tmp_path / "out" / f"{layer}.ply").read_bytes())
    told = json.loads((tmp_path / "out" / MANIFEST).read_bytes())
    for name in ("../private/secret", str(secret.with_suffix(""))):
        text = json.dumps(told).replace(f'"{layer}"', json.dumps(name))
        (tmp_path / "out" / MANIFEST).write_text(text)
        with pytest.raises(medialis.InvalidShapeError, match="not the name of a file"):
            medialis.read_result(tmp_path / "out")
    (tmp_path / "out" / MANIFEST).write_text(json.dumps(told))
    if sys.platform != "win32":
        (tmp_path / "out" / f"{layer}.ply").unlink()
        (tmp_path / "out" / f"{layer}.ply").symlink_to(secret)
        with pytest.raises(medialis.FileError, match="link"):
            medialis.read_result(tmp_path / "out")
        (tmp_path / "out" / MANIFEST).unlink()
        os.mkfifo(tmp_path / "out" / MANIFEST)
        with pytest.raises(medialis.FileError, match="regular"):
            medialis.read_result(tmp_path / "out")
