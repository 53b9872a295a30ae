"""Runs of `python -m medialis` in a child process, and what is in the folders that they leave."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from fuzz.kinds import Fault
from fuzz.nasty_shapes import sphere, tube
from medialis.formats.ply_attributes import write_ply

PATIENCE = 150.0
"""Seconds after which a run hangs."""

Content = dict[str, str]
"""Checksums of files by their names relative to a folder."""


@dataclass(frozen=True)
class Ended:
    """How a run ended.

    Attributes
    ----------
    code : int
        Negative: the signal that killed it.
    out, err : str
    started : bool
        Whether it had a handler when the signal came: medialis ran, not only the start of Python.
    """

    code: int
    out: str
    err: str
    started: bool = True


def command(*words: str | os.PathLike[str]) -> list[str]:
    """Return the command line of medialis."""
    return [sys.executable, "-W", "error", "-m", "medialis", *(os.fspath(word) for word in words)]


def start(
    words: Sequence[str],
    folder: Path,
    *,
    before: Callable[[], None] | None = None,
    stdout: int | IO[bytes] = subprocess.PIPE,
) -> subprocess.Popen[bytes]:
    """Start a run in a session of its own, in which Ctrl-C works."""

    def prepare() -> None:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        if before is not None:
            before()

    return subprocess.Popen(
        words,
        cwd=folder,
        env={**os.environ, "PYTHONFAULTHANDLER": "1"},
        stdin=subprocess.DEVNULL,
        stdout=stdout,
        stderr=subprocess.PIPE,
        start_new_session=True,
        preexec_fn=prepare,
    )


def finish(child: subprocess.Popen[bytes], *, started: bool = True) -> Ended:
    """Wait for the end of a run, and of all that it started."""
    try:
        out, err = child.communicate(timeout=PATIENCE)
    except subprocess.TimeoutExpired:
        raise Fault("hang of a run", f"{child.args}\n{_stacks(child)}") from None
    finally:
        kill_group(child)
    said, told = ((text or b"").decode("utf-8", "replace") for text in (out, err))
    return Ended(child.returncode, said, told, started)


def _stacks(child: subprocess.Popen[bytes]) -> str:
    """End a run that hangs, and return what all of its threads were doing."""
    child.send_signal(signal.SIGABRT)
    with suppress(subprocess.TimeoutExpired):
        return child.communicate(timeout=5.0)[1].decode("utf-8", "replace")
    return "it does not answer"


def kill_group(child: subprocess.Popen[bytes]) -> None:
    """Kill a run with its workers."""
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(child.pid, signal.SIGKILL)
    child.wait()
    for pipe in (child.stdout, child.stderr):
        if pipe is not None:
            pipe.close()


def run(words: Sequence[str], folder: Path, **more: Any) -> Ended:
    """Run to the end."""
    return finish(start(words, folder, **more))


def one_line(text: str) -> bool:
    """Whether a text is one line that medialis wrote."""
    return text.startswith("medialis: ") and text.count("\n") == 1 and text.endswith("\n")


def has_handler(process: int) -> bool:
    """Whether a process handles SIGTERM: Python alone does not, medialis does before it imports."""
    with suppress(OSError):
        lines = Path(f"/proc/{process}/status").read_text().splitlines()
        (caught,) = (line.split()[1] for line in lines if line.startswith("SigCgt:"))
        return bool(int(caught, 16) >> (signal.SIGTERM - 1) & 1)
    return True


def wait(child: subprocess.Popen[bytes], seconds: float) -> None:
    """Wait for some time, or less when the run ends before."""
    end = time.monotonic() + seconds
    while time.monotonic() < end and child.poll() is None:
        time.sleep(0.002)


def content(folder: Path) -> Content:
    """Checksums of all files of a folder; of manifests and tables without times and places."""
    result = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            name = path.relative_to(folder).as_posix()
            result[name] = hashlib.sha256(_steady(path)).hexdigest()
    return result


def _steady(path: Path) -> bytes:
    data = path.read_bytes()
    if path.name == "manifest.json":
        with suppress(ValueError, KeyError, TypeError):
            manifest = json.loads(data)
            manifest["seconds"] = None
            manifest["files"] = [Path(name).name for name in manifest["files"]]
            manifest["picture"] = Path(manifest["picture"] or "").name
            return json.dumps(manifest, sort_keys=True).encode()
    if path.name == "results.csv":
        rows = list(csv.reader(io.StringIO(data.decode("utf-8", "replace"))))
        times = [place for place, name in enumerate(rows[0] if rows else ()) if "seconds" in name]
        return json.dumps(
            [[cell for place, cell in enumerate(row) if place not in times] for row in rows]
        ).encode()
    if path.name == "results.html":
        return b""  # it has times; the table beside it says the same
    return data


def hidden(folder: Path) -> list[str]:
    """Hidden files and folders anywhere in a folder."""
    found = folder.rglob(".*") if folder.is_dir() else ()
    return sorted(path.relative_to(folder).as_posix() for path in found)


def check_whole(folder: Path, generations: Sequence[Content], what: str) -> None:
    """Where a manifest is, all that it lists is of one generation; else nothing is claimed."""
    for manifest in folder.rglob("manifest.json"):
        if any(part.startswith(".") for part in manifest.relative_to(folder).parts):
            continue
        place = manifest.parent.relative_to(folder)
        try:
            files = [Path(name).name for name in json.loads(manifest.read_bytes())["files"]]
        except (ValueError, KeyError, TypeError) as error:
            raise Fault(f"a manifest is half written {what}", f"{manifest}: {error}") from error
        missing = [name for name in files if not (manifest.parent / name).is_file()]
        if missing:
            raise Fault(f"files of a manifest are missing {what}", f"{manifest}: {missing}")
        here = content(folder)
        names = [(place / name).as_posix() for name in files]
        if not any(all(here[n] == known.get(n) for n in names) for known in generations):
            old_and_new = [[n for n in names if here[n] != known.get(n)] for known in generations]
            raise Fault(f"results are mixed {what}", f"differs from each: {old_and_new}")


def check_same(folder: Path, expected: Content, what: str) -> None:
    """Hold a folder against what it should be."""
    here = content(folder) if folder.is_dir() else {}
    differ = sorted(n for n in here.keys() | expected.keys() if here.get(n) != expected.get(n))
    if differ:
        raise Fault(f"files differ {what}", ", ".join(differ))


def write_inputs(folder: Path) -> list[Path]:
    """Write three small shapes, always with the same time of change."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for name, (points, faces) in {"a": tube(8, 12), "b": sphere(7), "c": tube(5, 20)}.items():
        paths.append(folder / f"{name}.ply")
        write_ply(paths[-1], points, faces)
        os.utime(paths[-1], ns=(0, 0))
    return paths
