"""Run whole operations of this checkout beside those of another commit: is one slower.

    python benchmarks/guard.py                      against the last release, on three small shapes
    python benchmarks/guard.py --against COMMIT     against any other commit
    python benchmarks/guard.py --files horse2.ply   on files of your own
    python benchmarks/guard.py --limit 1.5          fails only from half as much again

Both have a process of their own, and take turns. Times are processor seconds of an operation on a
shape in memory with nothing kept from another; `read` reads the file. U is the time of
`cKDTree(points).query(points, k=2)`, build included. One is slower where its ratio is above the
limit by more than the noise: three standard errors of the ratio of the two medians.

Where this checkout has kernels made ahead, those that differ are made for the other commit too, by
its own `build.py`, which takes minutes. Where that cannot be, numba compiles all on both sides:
what it compiles is up to a fifth slower.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
OPERATIONS = (
    "read",
    "surface_skeleton",
    "skeleton_importance",
    "thickness",
    "curve_skeleton",
    "parts",
    "medial_sheets",
    "skeleton_mesh",
    "armature",
    "medial_mesh",
)
SHAPES = ("creature", "plate", "knot")
OPTIONS = {"surface_skeleton": {"importance": False}, "medial_mesh": {"balls": 60}}
ROUNDS, LIMIT = 5, 1.1

CHILD = """
import json, sys, time
import numpy as np
from scipy.spatial import cKDTree
import medialis
shapes = {}
def seconds(work):
    clock = time.process_time()
    work()
    return time.process_time() - clock
for line in sys.stdin:
    path, name, options = json.loads(line)
    try:
        if path not in shapes:
            shapes = {path: medialis.read_shape(path)}
        shape = shapes[path]
        medialis.forget()
        points = np.array(shape.points)
        if name == "U":
            answer = seconds(lambda: cKDTree(points).query(points, k=2))
        elif name == "read":
            answer = seconds(lambda: medialis.read_shape(path))
        else:
            try:
                answer = seconds(lambda: medialis.run(name, shape, **options))
            except medialis.InvalidOptionError:  # what it was before it had the option
                answer = seconds(lambda: medialis.run(name, shape))
    except Exception as error:
        answer = f"{type(error).__name__}: {error}"
    print(json.dumps(answer), file=sys.__stdout__, flush=True)
"""
"""What runs in the processes: of this package only what has been public since 2.0."""


class Side:
    """A process that runs operations of the package in a folder."""

    def __init__(self, package: Path, kernels: str = "") -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-W", "ignore", "-c", CHILD],
            env=os.environ | {"PYTHONPATH": str(package), "MEDIALIS_KERNELS": kernels},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def seconds(self, path: Path, name: str) -> float | str:
        """Return the processor seconds of an operation on a file, or the words of its error."""
        asked, answered = self._process.stdin, self._process.stdout
        assert asked is not None and answered is not None
        asked.write(json.dumps([str(path), name, OPTIONS.get(name, {})]) + "\n")
        asked.flush()
        line = answered.readline()
        if not line:
            raise SystemExit(f"The process of {name} ended: exit {self._process.wait()}.")
        answer: float | str = json.loads(line)
        return answer

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.communicate()


def git(*words: str) -> str:
    """Return what git prints."""
    return subprocess.run(
        ["git", "-C", str(ROOT), *words], check=True, capture_output=True, text=True
    ).stdout.strip()


def last_release() -> str:
    """Return the newest tag, or where there is none the commit that wrote the newest version."""
    tags = git("tag", "--list", "v*", "--sort=-creatordate", "--merged")
    if tags:
        return tags.splitlines()[0]
    for line in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").splitlines():
        if line.startswith("## [") and not line.startswith("## [Unreleased]"):
            heading = line[: line.index("]") + 1]
            found = git("log", "--format=%H", "-S", heading, "--", "CHANGELOG.md").splitlines()
            if found:
                return found[0]
    raise SystemExit("No release in this history (is it a shallow clone?): give --against COMMIT.")


@contextmanager
def package_of(commit: str) -> Iterator[Path]:
    """Give the package of a commit, with kernels made ahead here: `made_ahead` makes the others."""
    with tempfile.TemporaryDirectory() as folder:
        archive = Path(folder) / "sources.tar"
        git("archive", "--output", str(archive), commit, "core")
        shutil.unpack_archive(archive, folder, filter="data")
        for made in (ROOT / "core").rglob("*made*"):
            there = Path(folder) / made.relative_to(ROOT)
            if made.suffix in (".so", ".pyd", ".json") and there.parent.is_dir():
                shutil.copy2(made, there)
        yield Path(folder) / "core"


def made_ahead(package: Path) -> bool:
    """Make the kernels of a package that are not as its sources; tell whether all are made."""
    if not any((package / "medialis" / "base").glob("made-*.json")):
        return False
    words = [sys.executable, str(package / "kernel_library" / "build.py")]
    environment = os.environ | {"PYTHONPATH": str(package)}
    return subprocess.run(words, env=environment, check=False).returncode == 0


def judged(before: list[float], now: list[float]) -> tuple[float, float]:
    """Return the ratio of two medians and its noise, three standard errors.

    The deviation is 1.48 times the median one, and a median's error 1.25 times that of a mean.
    """
    medians = [float(np.median(times)) for times in (before, now)]
    errors = [
        1.25 * 1.48 * float(np.median(np.abs(np.array(times) / median - 1))) / len(times) ** 0.5
        for times, median in zip((before, now), medians, strict=True)
    ]
    ratio = medians[1] / medians[0]
    return ratio, 3 * ratio * float(np.hypot(*errors))


def compared(sides: list[Side], path: Path, names: list[str], rounds: int, limit: float) -> bool:
    """Print a row for each operation on a file; tell whether none is slower."""
    unit = float(np.median([float(sides[1].seconds(path, "U")) for _ in range(rounds)]))
    print(f"\n{path.stem}: U = {unit:.4f} s\n", flush=True)
    print("| operation | before, U | now, U | ratio | noise | |\n|---|---|---|---|---|---|")
    fine = True
    for name in names:
        for side in sides:
            side.seconds(path, name)  # compiles, and warms up
        times: list[list[float | str]] = [[], []]
        for turn in range(rounds):
            for which in (0, 1) if turn % 2 else (1, 0):
                times[which].append(sides[which].seconds(path, name))
        words = [next((t for t in of if isinstance(t, str)), "") for of in times]
        if any(words):
            told = "; ".join(
                f"{side} it says {text}"
                for side, text in zip(("before", "now"), words, strict=True)
                if text
            )
            print(f"| {name} | | | | | {told} |", flush=True)
            fine &= not words[1]
            continue
        before, now = ([float(t) for t in of] for of in times)
        ratio, noise = judged(before, now)
        slower = ratio > limit + noise
        fine &= not slower
        print(
            f"| {name} | {np.median(before) / unit:.1f} | {np.median(now) / unit:.1f} "
            f"| {ratio:.2f} | {noise:.2f} | {'**slower**' if slower else ''} |",
            flush=True,
        )
    return fine


def main() -> int:
    """Compare, and return 1 where an operation is slower or fails."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--against", metavar="COMMIT")
    parser.add_argument("--files", nargs="+", type=Path, metavar="FILE")
    parser.add_argument("--operations", nargs="+", default=list(OPERATIONS), metavar="NAME")
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    parser.add_argument("--limit", type=float, default=LIMIT)
    given = parser.parse_args()
    commit = given.against or last_release()
    print(
        f"Before: {git('log', '-1', '--format=%h %s', commit)}. Limit: {given.limit:g}.", flush=True
    )
    fine = True
    with package_of(commit) as package, tempfile.TemporaryDirectory() as folder:
        both = [package, ROOT / "core"]
        ahead = all(made_ahead(one) for one in both)
        how = "made ahead" if ahead else "compiled by numba"
        print(f"Kernels on both sides: {how}.", flush=True)
        sides = [Side(one, "" if ahead else "numba") for one in both]
        try:
            for path in given.files or _written(Path(folder)):
                fine &= compared(sides, path, given.operations, given.rounds, given.limit)
        finally:
            for side in sides:
                side.close()
    return 0 if fine else 1


def _written(folder: Path) -> Iterator[Path]:
    """Write the small shapes as files, one after the other."""
    from whole_runs import SHAPES as KNOWN
    from whole_runs import written

    for name in SHAPES:
        written(KNOWN[name](), folder / f"{name}.ply")
        yield folder / f"{name}.ply"


if __name__ == "__main__":
    sys.exit(main())
