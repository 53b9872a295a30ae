"""Cases of the kind `disk`: no room for what is written, and folders that cannot be written."""

from __future__ import annotations

import ctypes
import functools
import os
import resource
import shutil
import sys
from pathlib import Path

from fuzz.commands import (
    Content,
    check_same,
    command,
    content,
    hidden,
    one_line,
    write_inputs,
)
from fuzz.commands import (
    run as run_command,
)
from fuzz.kinds import Case, Fault, Kind

OPERATIONS = ("thickness", "curve-skeleton", "patches")
LARGEST = 150_000
"""Bytes: some more than the largest file of a result, its picture."""

BAD_INPUT, SOME_FAILED = 2, 3
DROP_FROM_BOUNDS, ANY_RIGHTS, ANY_READING = 24, 1, 2
"""Of prctl and of capabilities in Linux."""


def run(case: Case) -> None:
    """Run where something cannot be written: one sentence, and nothing changes."""
    scenes = (_no_room, _no_room, _no_room, _batch_without_room, _closed_folder, _strange_places)
    (*scenes, _full_output)[case.rng.randrange(len(scenes) + 1)](case)


def _no_room(case: Case) -> None:
    """Files cannot grow beyond a limit."""
    name = case.rng.choice(OPERATIONS)
    words, old_folder, whole = _results(case.home, name)
    out, limit = case.folder / "out", case.rng.choice((0, 1, case.rng.randrange(LARGEST)))
    replaced = case.rng.random() < 0.5
    if replaced:
        shutil.copytree(old_folder, out)
    before = content(out) if replaced else {}
    ended = run_command(command(*words, "-o", out), case.folder, before=lambda: _limit_files(limit))
    what = f"when files may have {limit} bytes"
    (case.folder / "about.txt").write_text(f"{name} {what}, replaced: {replaced}\n{ended}")
    if ended.code == 0:
        check_same(out, whole, "with little room")  # what is replaced goes with all its files
    else:
        _check_refused(ended.code, ended.err, "without room")
        check_same(out, before, "without room")
        if not replaced and out.exists():
            raise Fault("a folder stays without room", what)
    _check_hidden(case.folder)


def _batch_without_room(case: Case) -> None:
    """Rows fail, or all of it; what is there is whole; with room again all is done."""
    inputs = [os.fspath(path) for path in write_inputs(case.home / "inputs")]
    words = command("batch", "thickness", *inputs, "--workers", "1", "-o", case.folder / "out")
    limit = case.rng.randrange(LARGEST)
    ended = run_command(words, case.folder, before=lambda: _limit_files(limit))
    (case.folder / "about.txt").write_text(f"batch, files of {limit} bytes\n{ended}")
    if ended.code not in (0, BAD_INPUT, SOME_FAILED) or "Traceback" in ended.err:
        raise Fault(f"a batch without room: exit {ended.code}", ended.err)
    again = run_command(words, case.folder)
    if again.code != 0 or "None failed." not in again.out:
        raise Fault(f"a batch after one without room: exit {again.code}", again.out + again.err)
    _check_hidden(case.folder)


def _closed_folder(case: Case) -> None:
    """Rights are missing."""
    name = case.rng.choice(OPERATIONS)
    words, old_folder, _ = _results(case.home, name)
    out = case.folder / "closed" / "out"
    replaced = case.rng.random() < 0.5
    out.parent.mkdir()
    if replaced:
        shutil.copytree(old_folder, out)
    closed = [out.parent] if not replaced else case.rng.choice(([out], [out, out.parent]))
    before = content(out.parent)
    for folder in closed:
        folder.chmod(0o500)
    try:
        ended = run_command(command(*words, "-o", out), case.folder, before=_drop_rights)
    finally:
        for folder in (out.parent, out):
            if folder.exists():
                folder.chmod(0o700)
    (case.folder / "about.txt").write_text(f"{name}, closed: {closed}\n{ended}")
    _check_refused(ended.code, ended.err, "into a closed folder")
    check_same(out.parent, before, "in a closed folder")
    _check_hidden(case.folder)


def _strange_places(case: Case) -> None:
    """The output is a file, lies below one, or in a folder that takes nothing."""
    name = case.rng.choice(OPERATIONS)
    words, _, _ = _results(case.home, name)
    file = case.folder / "file"
    file.write_text("mine")
    places = (file, file / "below", "/proc/self/out", "/dev/null/out", "/sys/out", "", "x" * 300)
    place = case.rng.choice((*places, case.folder / ("y/" * 3000), "-", "a\nb", "/dev/full"))
    ended = run_command(command(*words, f"--output={place}"), case.folder)
    (case.folder / "about.txt").write_text(f"{name} to {str(place)[:100]!r}\n{ended}")
    if ended.code != 0:
        _check_refused(ended.code, ended.err, "to a strange place")
    if file.read_text() != "mine":
        raise Fault("a file of the user was changed")
    _check_hidden(case.folder)


def _full_output(case: Case) -> None:
    """Standard output is full, or the working folder is gone."""
    words, _, _ = _results(case.home, case.rng.choice(OPERATIONS))
    words = case.rng.choice((words, words, ("list",), ("describe", "--json"), ("info", words[1])))
    place = case.folder / "here"
    place.mkdir()
    given = command(*words, *(("-o", str(case.folder / "out")) if words[0] in OPERATIONS else ()))
    gone = case.rng.random() < 0.4
    if gone:
        ended = run_command(given, place, before=lambda: shutil.rmtree(place))
    else:
        with open("/dev/full", "wb") as full:  # noqa: PTH123 - no Path has such a device
            ended = run_command(given, place, stdout=full)
    (case.folder / "about.txt").write_text(f"{given}, folder gone: {gone}\n{ended}")
    if ended.code != 0 or not gone:
        kind = "in a folder that is gone" if gone else "to a full output"
        _check_refused(ended.code, ended.err, kind)


def _check_refused(code: int, text: str, what: str) -> None:
    if "Traceback" in text or code < 0:
        last = (text.strip().splitlines() or [""])[-1].partition(":")[0]
        raise Fault(f"exit {code} {what}: {last}", text)
    if code != BAD_INPUT or not one_line(text):
        raise Fault(f"exit {code} and {text.count(chr(10))} lines {what}", text)


def _check_hidden(folder: Path) -> None:
    left = hidden(folder)
    if left:
        raise Fault("hidden files stay where nothing can be written", ", ".join(left))


def _limit_files(size: int) -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))


def _drop_rights() -> None:
    """Take from root what lets it write everywhere."""
    if os.geteuid() == 0 and sys.platform == "linux":
        libc = ctypes.CDLL(None)
        for right in (ANY_RIGHTS, ANY_READING):
            libc.prctl(DROP_FROM_BOUNDS, right, 0, 0, 0)


@functools.cache
def _results(home: Path, name: str) -> tuple[tuple[str, ...], Path, Content]:
    """Return a command without its output, a folder with an older result, and what it gives."""
    source = write_inputs(home / "inputs")[0]
    words = (name, os.fspath(source), "--refine", "0.05", "--overwrite")
    contents = []
    for folder, more in (
        (home / f"{name}-old", ("--tolerance", "0.001")),
        (home / f"{name}-new", ()),
    ):
        shutil.rmtree(folder, ignore_errors=True)
        ended = run_command(command(*words, *more, "-o", folder), home)
        if ended.code != 0:
            raise Fault(f"an undisturbed run fails: {name}", ended.err)
        contents.append(content(folder))
    return words, home / f"{name}-old", contents[1]


KIND = Kind(run, processor_seconds=100.0, wall_seconds=500.0)
