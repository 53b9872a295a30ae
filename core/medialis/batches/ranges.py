"""The balls of a huge cloud, in ranges of samples: on threads here, or on workers of a cluster."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from medialis.balls.ball_shrinking import SAMPLES_A_CHUNK, Shrinking
from medialis.batches.engine import cluster, hand_out, warn_if_open
from medialis.batches.mapped_files import Files, as_plain
from medialis.errors import FileError
from medialis.progress import Progress
from medialis.threads import run_chunks

if TYPE_CHECKING:
    from medialis._kernels.box_tree import BoxTree

AGAIN = "Nothing was written: see to the cluster, and call it again."
CHUNKS_A_JOB = 256
"""Chunks that a cluster worker is given at a time: about half a second of work."""


@dataclass(frozen=True)
class Range:
    """A job of a cluster worker: chunks first..last of the samples in tree order."""

    name: str
    folder: str
    options: Shrinking
    center: tuple[float, ...]
    depth: int
    begin: int
    end: int


def shrink_range(job: Range) -> int:
    """Run on a worker: map the files, shrink the balls of a range, return how many."""
    from medialis._kernels.box_tree import BoxTree

    folder = Path(job.folder)
    parts = {
        name: as_plain(np.load(folder / "tree" / f"{name}.npy", mmap_mode="r+"))
        for name in ("points", "normals", "order", "blocks", "bounds", "child")
    }
    tree = BoxTree(np.array(job.center), **parts, depth=job.depth)
    results = {
        name: as_plain(np.load(folder / place, mmap_mode="r+"))
        for name, place in (
            ("centers", "centers.npy"),
            ("radii", "radii.npy"),
            ("second", "tree/second.npy"),
            ("status", "status.npy"),
            ("spoke_angles", "spoke_angles.npy"),
        )
    }
    shrink_chunks(tree, job.options, results, job.begin, job.end, None)
    return job.end - job.begin


def shrink_chunks(
    tree: BoxTree,
    options: Shrinking,
    results: dict[str, NDArray[Any]],
    first: int,
    last: int,
    progress: Progress | None,
) -> None:
    """Shrink the balls of the samples first..last, in tree order, on threads."""
    names = ("centers", "radii", "second", "status", "spoke_angles")
    out = tuple(results[name] for name in names)

    def work(begin: int, end: int) -> None:
        options.run(tree, first + begin, first + end, 1, out)

    run_chunks(work, last - first, SAMPLES_A_CHUNK, progress=progress)


def shrink_there(
    files: Files, tree: BoxTree, options: Shrinking, scheduler: str, progress: Progress
) -> None:
    """Hand ranges of whole chunks to the workers of a cluster; they write into the same files."""
    n = len(tree.points)
    step = CHUNKS_A_JOB * SAMPLES_A_CHUNK
    jobs = [
        Range(
            f"range-{begin}", str(files.folder.absolute()), options, tuple(tree.center.tolist()),
            tree.depth, begin, min(begin + step, n),
        )
        for begin in range(0, n, step)
    ]  # fmt: skip
    done = 0
    warn_if_open(scheduler, progress)
    with cluster(scheduler) as (client, slots):
        for job, count in hand_out(client, jobs, shrink_range, slots, AGAIN):
            if count is None:
                raise FileError(
                    f"A worker died at {job.name}: out of memory, or a crash in a library. {AGAIN}"
                )
            done += count
            progress.update(done / n)
