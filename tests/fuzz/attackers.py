"""Cases of the kind `attackers`: somebody makes names beside and in the output, before and during.

Links, pipes and folders with every name that medialis uses, in the folder around the output, in it
and in that of a batch; manifests that lead elsewhere. Where folders stay the same when their names
are given away, hidden ones are exchanged for links while they are written. Nothing of a victim may
be read, written, emptied or removed, and nothing is waited for.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import threading
from contextlib import suppress
from pathlib import Path

from fuzz.commands import (
    Content,
    command,
    finish,
    one_line,
    start,
    write_inputs,
)
from fuzz.commands import run as run_command
from fuzz.kinds import Case, Fault, Kind
from medialis.base import disk

BESIDE = ("out", ".out-deadbeef", ".out-00000000", ".out-{}", ".medialis-lock")
INSIDE = (
    *("manifest.json", "thickness.ply", "samples.ply", "thickness.npz", "thin_spots.ply"),
    *(".medialis-lock", ".medialis-moves", ".replaced", ".out-{}"),
)
OF_BATCH = (
    *("a", "a/thickness", ".medialis-batch", "results.csv", "results.html", ".results.csv-{}"),
    *("a/.thickness-{}", "a/thickness/manifest.json", "b"),
)
PAUSE = 0.001
DONE, BAD_INPUT, SOME_FAILED = 0, 2, 3


def run(case: Case) -> None:
    """Attack a run, a batch or a view; the victim stays as it was."""
    rng = case.rng
    victim = case.folder / "victim"
    _make_victim(case.home, victim)
    before = _all_of(victim)
    scene = rng.choice(("run", "run", "batch", "view"))
    place = case.folder / "place"
    place.mkdir()
    source = os.fspath(write_inputs(case.home / "inputs")[0])
    if scene == "view":
        words, names = _hostile_result(case, place), ()
    elif scene == "batch":
        words = ["batch", "thickness", source, "--workers", "1", "-o", os.fspath(place / "out")]
        names = (*BESIDE[1:], *(f"out/{name}" for name in OF_BATCH))
    else:
        words = ["thickness", source, "-o", os.fspath(place / "out")]
        names = (*BESIDE[1:], *(f"out/{name}" for name in INSIDE))
    if scene != "view":
        words.append("--no-picture")
    if scene == "run" and rng.random() < 0.5:
        words.append("--overwrite")
    if rng.random() < 0.6 and scene != "view":
        (place / "out").mkdir()
    for _ in range(rng.randrange(5) if names else 0):
        _plant(rng, place, rng.choice(names), victim)
    child = start(command(*words), case.folder)
    over = threading.Event()
    swaps = disk.AT and scene == "run" and rng.random() < 0.4
    attacker = threading.Thread(target=_attack, args=(rng, place, names, victim, over, swaps))
    attacker.start()
    try:
        ended = finish(child)
    finally:
        over.set()
        attacker.join()
    (case.folder / "about.txt").write_text(f"{words}\nswaps: {swaps}\n{ended}")
    if (after := _all_of(victim)) != before:
        differ = sorted(n for n in after.keys() | before.keys() if after.get(n) != before.get(n))
        raise Fault(f"a victim was touched by a {scene}", ", ".join(differ))
    codes = (DONE, BAD_INPUT, SOME_FAILED) if scene == "batch" else (DONE, BAD_INPUT)
    if ended.code not in codes or "Traceback" in ended.err:
        raise Fault(f"an attacked {scene}: exit {ended.code}", ended.err)
    if ended.code == BAD_INPUT and scene != "batch" and not one_line(ended.err):
        raise Fault(f"an attacked {scene}: not one line", ended.err)
    refused = ("not the name of a file", "a link", "not a regular file")
    if scene == "view" and not any(words in ended.err for words in refused):
        raise Fault("what lies outside of the folder of a result is read", f"{ended}")
    if ended.code == DONE and scene == "run" and not swaps:
        _check_result(place / "out")


def _make_victim(home: Path, victim: Path) -> None:
    """A folder that looks like a result, and like what a killed run left."""
    known = home / "result"
    if not known.exists():
        source = os.fspath(write_inputs(home / "inputs")[0])
        ended = run_command(command("thickness", source, "--no-picture", "-o", known), home)
        if ended.code != 0:
            raise Fault("an undisturbed run fails", ended.err)
    shutil.copytree(known, victim)
    for name in (".medialis-lock", "precious", "results.csv"):
        (victim / name).write_text("SECRET")
    (victim / "thickness").mkdir()
    (victim / "thickness" / "thickness.npz").write_text("SECRET")


def _all_of(folder: Path) -> Content:
    """Names, contents and times of change of all that is in a folder."""
    return {
        path.relative_to(folder).as_posix(): f"{path.lstat().st_mtime_ns} {path.lstat().st_size}"
        for path in folder.rglob("*")
    }


def _plant(rng: random.Random, place: Path, name: str, victim: Path) -> None:
    """Make one name; what is there already stays, and so does the victim behind an own link."""
    path = place / name.format(f"{rng.getrandbits(32):08x}")
    if path.parent.resolve().is_relative_to(victim.resolve()):
        return
    with suppress(OSError):
        kind = rng.choice(("link", "link", "link", "file", "pipe", "folder", "dangling"))
        if kind == "link":
            path.symlink_to(rng.choice((victim, victim / "precious", victim / "manifest.json")))
        elif kind == "dangling":
            path.symlink_to(victim / "new")
        elif kind == "pipe":
            os.mkfifo(path)
        elif kind == "file":
            with path.open("x") as stream:
                stream.write("planted")
        else:
            path.mkdir()
            inner = path / rng.choice((".medialis-lock", ".medialis-moves", "manifest.json"))
            inner.symlink_to(victim / "precious")


def _attack(
    rng: random.Random,
    place: Path,
    names: tuple[str, ...],
    victim: Path,
    over: threading.Event,
    swaps: bool,
) -> None:
    """Make names again and again, and give away those of hidden folders."""
    while names and not over.wait(PAUSE):
        _plant(rng, place, rng.choice(names), victim)
        for path in place.glob(".out-*") if swaps else ():
            with suppress(OSError):
                if not path.is_symlink() and (path / ".medialis-lock").is_file():
                    path.rename(place / f"taken{rng.getrandbits(32):08x}")
                    path.symlink_to(victim)


def _hostile_result(case: Case, place: Path) -> list[str]:
    """A result whose manifest or files lead elsewhere."""
    folder = place / "out"
    shutil.copytree(case.home / "result", folder)
    for name in (".medialis-lock", "precious"):
        (folder / name).unlink(missing_ok=True)
    (case.folder / "private").mkdir()
    secret = case.folder / "private" / "SECRET.ply"
    shutil.copy(folder / "thickness.ply", secret)
    manifest = json.loads((folder / "manifest.json").read_bytes())
    kind = case.rng.choice(("name", "operation", "link", "pipe", "manifest", "absolute"))
    if kind in ("name", "absolute"):
        name = "../../private/SECRET" if kind == "name" else os.fspath(secret.with_suffix(""))
        manifest["layers"][0]["name"] = name
        manifest["shown"] = [name]
    elif kind == "operation":
        shutil.copy(folder / "thickness.npz", secret.with_suffix(".npz"))
        manifest["operation"] = "../../private/SECRET"
    elif kind == "manifest":
        (folder / "manifest.json").rename(secret.with_suffix(".json"))
        (folder / "manifest.json").symlink_to(secret.with_suffix(".json"))
    else:
        (folder / "thickness.ply").unlink()
        if kind == "link":
            (folder / "thickness.ply").symlink_to(secret)
        else:
            os.mkfifo(folder / "thickness.ply")
    if kind != "manifest":
        (folder / "manifest.json").write_text(json.dumps(manifest))
    return ["view", os.fspath(folder), "-o", os.fspath(case.folder / "page.html")]


def _check_result(out: Path) -> None:
    """What the manifest lists is there, as files."""
    manifest = json.loads((out / "manifest.json").read_bytes())
    for name, told in manifest["contents"].items():
        path = out / name
        if path.is_symlink() or not path.is_file() or path.stat().st_size != told["bytes"]:
            raise Fault("a result of an attacked run is not whole", name)


KIND = Kind(run, processor_seconds=60.0, wall_seconds=300.0)
