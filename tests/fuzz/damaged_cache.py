"""Cases of the kind `cache`: compiled kernels are damaged; numbers must not change."""

from __future__ import annotations

import functools
import os
import random
import shutil
import subprocess
import sys
from pathlib import Path

from fuzz.kinds import Case, Fault, Kind

CODE = """
import hashlib, sys, warnings
warnings.simplefilter("error")
import medialis
from fuzz.nasty_shapes import sphere
shape = medialis.make_shape(*sphere(6), repair=True)
cloud = medialis.shrink_balls(shape)
content = cloud.centers.tobytes() + cloud.features.tobytes() + cloud.radii.tobytes()
print(hashlib.sha256(content).hexdigest())
"""
"""A few kernels that call each other; damaged ones are compiled anew within seconds."""

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


@functools.cache
def _warm(home: Path) -> tuple[Path, str]:
    """Compile the kernels into a cache of our own, and return what they compute."""
    base = home / "warm"
    ended = _compute(base)
    if ended.returncode != 0:
        raise Fault("an intact cache fails", ended.stderr)
    return base, ended.stdout


def _compute(folder: Path) -> subprocess.CompletedProcess[str]:
    settings = {**os.environ, "MEDIALIS_CACHE_DIR": str(folder)}
    try:
        return subprocess.run(
            [sys.executable, "-c", CODE],
            env=settings,
            capture_output=True,
            text=True,
            timeout=SECONDS,
        )
    except subprocess.TimeoutExpired:
        raise Fault("a damaged cache: hang") from None


KIND = Kind(run, processor_seconds=100.0, wall_seconds=500.0)
