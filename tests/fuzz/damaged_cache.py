"""Cases of the kind `cache`: compiled kernels are damaged; numbers must not change."""

from __future__ import annotations

import functools
import os
import random
import select
import shutil
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from fuzz.kinds import Case, Fault, Kind

CODE = """
import hashlib
import medialis
from fuzz.nasty_shapes import sphere
shape = medialis.make_shape(*sphere(6), repair=True)
cloud = medialis.shrink_balls(shape)
content = cloud.centers.tobytes() + cloud.features.tobytes() + cloud.radii.tobytes()
print(hashlib.sha256(content).hexdigest())
"""
"""A few kernels that call each other; damaged ones are compiled anew within seconds."""

WARM = """
import os, sys, warnings
warnings.simplefilter("error")
import numba.core.caching, scipy.sparse.csgraph, scipy.spatial
for line in sys.stdin:
    folder, said, told = line.rstrip("\\n").split("\\t")
    process = os.fork()
    if process == 0:
        os.environ["MEDIALIS_CACHE_DIR"], os.environ["MEDIALIS_KERNELS"] = folder, "numba"
        for number, path in ((1, said), (2, told)):
            os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
        break
    print(os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]), flush=True)
else:
    sys.exit()
"""
"""A process that has libraries and no kernel: the code runs in a copy of it, which may crash."""

SECONDS = 200.0


def run(case: Case) -> None:
    """Damage one to four files of a copy of a warm cache, and compute."""
    rng = case.rng
    base, expected = _warm(case.home)
    folder = case.home / "copy"
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(base, folder)
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    chosen = rng.sample(files, min(len(files), rng.choice((1, 1, 2, 4))))
    about = [f"{path.name}: {_damage(rng, path, files)}" for path in chosen]
    (case.folder / "about.txt").write_text("\n".join(about))
    for turn in ("with it", "with it mended"):
        ended = _compute(folder)
        if ended.returncode != 0:
            title = f"a damaged cache: exit {ended.returncode} {turn}"
            raise Fault(title, "\n".join([*about, ended.stderr]))
        if ended.stdout != expected:
            raise Fault(f"a damaged cache: wrong numbers {turn}", "\n".join([*about, ended.stdout]))
        if ended.stderr:
            raise Fault(f"a damaged cache: words {turn}", "\n".join([*about, ended.stderr]))
        if rng.random() < 0.7:
            return


def _damage(rng: random.Random, path: Path, files: list[Path]) -> str:
    """Damage a file and say how."""
    data = bytearray(path.read_bytes())
    kind = rng.choice(
        ("cut", "flip", "other", "random", "empty", "longer", "gone", "folder", "set")
    )
    if kind == "cut":
        data = data[: rng.randrange(len(data) + 1)]
    elif kind == "flip":
        for _ in range(rng.choice((1, 10, 200)) if data else 0):
            data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    elif kind == "set" and data:
        begin = rng.randrange(len(data))
        data[begin : begin + 4096] = bytes(len(data[begin : begin + 4096]))  # a lost block
    elif kind == "other":
        other = rng.choice(files)
        data = bytearray(other.read_bytes() if other.is_file() else b"")
    elif kind == "random":
        data = bytearray(rng.randbytes(rng.randrange(2000)))
    elif kind == "empty":
        data = bytearray()
    elif kind == "longer":
        data += rng.randbytes(rng.randrange(100))
    if kind in ("gone", "folder"):
        path.unlink()
    if kind == "folder":
        path.mkdir()
    elif kind != "gone":
        path.write_bytes(data)
    return kind


@dataclass(frozen=True)
class Ended:
    """How a computation ended; negative: the signal that killed it."""

    returncode: int
    stdout: str
    stderr: str


@functools.cache
def _warm(home: Path) -> tuple[Path, str]:
    """Compile the kernels into a cache of our own, and return what they compute."""
    base = home / "warm"
    ended = _compute(base)
    if ended.returncode != 0:
        raise Fault("an intact cache fails", ended.stderr)
    return base, ended.stdout


def _compute(folder: Path) -> Ended:
    """Compute with the kernels in a folder, in a new copy of the warm process."""
    said, told = folder.with_name("stdout.txt"), folder.with_name("stderr.txt")
    process = _warm_process()
    assert process.stdin is not None and process.stdout is not None
    process.stdin.write(f"{folder}\t{said}\t{told}\n")
    process.stdin.flush()
    if not select.select([process.stdout], [], [], SECONDS)[0]:
        os.killpg(process.pid, signal.SIGKILL)
        _warm_process.cache_clear()
        raise Fault("a damaged cache: hang")
    return Ended(int(process.stdout.readline()), said.read_text(), told.read_text())


@functools.cache
def _warm_process() -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", WARM + CODE],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        process_group=0,
    )


KIND = Kind(run, processor_seconds=100.0, wall_seconds=500.0)
