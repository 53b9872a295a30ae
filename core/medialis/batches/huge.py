"""Clouds that do not fit comfortably: balls with everything mapped from files (thesis 3.2).

Strategy. The tree over all samples is built once, in files that are mapped into memory, and its
samples are shrunk in ranges of tree order: spatial blocks. A ball never reaches farther than its
diameter, and the traversal touches only the nodes that the ball meets, so the halo of a block is
loaded page by page as its balls need it, however wide that is, and never twice computed. Ranges
hold whole chunks of the single run, and warm starts and certificates do not cross chunks: the
result is the same bit for bit, on threads or a GPU here, or on the workers of a cluster
(`shrink_there`).
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.base import disk
from medialis.base.errors import FileError, InvalidShapeError
from medialis.base.progress import Progress, ProgressCallback
from medialis.base.validation import FloatArray, as_normals, as_points
from medialis.batches.engine import cluster, hand_out, warn_if_open
from medialis.formats.files import reason
from medialis.formats.output_folder import OutputFolder
from medialis.skeleton.importance.importance import measures_of_points
from medialis.skeleton.medial_cloud import (
    SAMPLES_A_CHUNK,
    Balls,
    Shrinking,
    ShrinkOptions,
    shrink_options,
)

if TYPE_CHECKING:
    from medialis.base._box_tree_kernels import BoxTree

ROWS_A_BLOCK = 1 << 20
"""What is checked, scaled or copied at a time: 24 MB of coordinates."""

RESULTS = {
    "centers": (np.float64, 3),
    "radii": (np.float64, 0),
    "features": (np.int32, 2),
    "source": (np.int32, 0),
    "status": (np.int8, 0),
    "spoke_angles": (np.float64, 0),
    "side": (np.int8, 0),
}
MEASURES = ("feature_radius", "radius_ratio")
OUT = ("centers", "radii", "second", "status", "spoke_angles")
"""What shrinking fills; the second feature points are kept only while it runs."""

TREE = "tree"
"""Folder, in that of the results, of what is kept only while it runs."""


def blocks(n: int) -> Iterator[slice]:
    """Give the rows 0..n in parts of `ROWS_A_BLOCK`."""
    for begin in range(0, n, ROWS_A_BLOCK):
        yield slice(begin, min(begin + ROWS_A_BLOCK, n))


def create_mapped(folder: Path, name: str, shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
    """Create a .npy file of an array and map it for writing.

    Its place on the disk is taken now: writing to mapped pages that have none kills the process.

    Raises
    ------
    FileError
        When the disk is full or the file cannot be written.
    """
    header = {"descr": np.lib.format.dtype_to_descr(np.dtype(dtype)), "fortran_order": False}
    try:
        with disk.folder_of(folder / f"{name}.npy") as (place, file):
            stream = os.fdopen(place.create(file), "w+b")
        with stream:
            np.lib.format.write_array_header_1_0(stream, {**header, "shape": shape})
            stream.flush()
            size = math.prod(shape) * np.dtype(dtype).itemsize
            disk.set_aside(stream.fileno(), stream.tell() + size)
            array = np.memmap(stream, dtype, "r+", stream.tell(), shape)
    except OSError as error:
        raise FileError(f"Cannot write {name}.npy: {reason(error)}.") from None
    return as_plain(array)


def open_mapped(path: str | os.PathLike[str], *, write: bool = False) -> NDArray[Any]:
    """Map the array of a .npy file.

    Raises
    ------
    OSError
        When it cannot be read, or is no regular file.
    ValueError
        When it is no such file, damaged, or holds Python objects.
    """
    with disk.open_file(path, os.O_RDWR if write else os.O_RDONLY) as stream:
        version = np.lib.format.read_magic(stream)
        read = {(1, 0): np.lib.format.read_array_header_1_0}.get(
            version, np.lib.format.read_array_header_2_0
        )
        shape, by_columns, dtype = read(stream)
        if dtype.hasobject:
            raise ValueError("it holds Python objects")
        size = math.prod(shape) * dtype.itemsize
        if stream.tell() + size > os.fstat(stream.fileno()).st_size or not size:
            raise ValueError("it is cut short, or empty")
        order: Literal["F", "C"] = "F" if by_columns else "C"
        mode: Literal["r+", "r"] = "r+" if write else "r"
        return np.memmap(stream, dtype, mode, stream.tell(), shape, order)


def as_plain(mapped: NDArray[Any]) -> NDArray[Any]:
    """View a mapped array as a plain one, which is what kernels are compiled for."""
    return mapped.view(np.ndarray)


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
    from medialis.base._box_tree_kernels import BoxTree

    names = (*OUT, *("points", "normals", "order", "blocks", "bounds", "child"))
    places = [Path(job.folder) / ("" if name in RESULTS else TREE) for name in names]
    mapped = {
        name: as_plain(open_mapped(place / f"{name}.npy", write=True))
        for name, place in zip(names, places, strict=True)
    }
    results = {name: mapped.pop(name) for name in OUT}
    tree = BoxTree(np.array(job.center), **mapped, depth=job.depth)
    out = tuple(results[name] for name in OUT)
    job.options.run_all(job.begin, job.end, tree, 1, out, Progress())
    return job.end - job.begin


def shrink_there(
    folder: Path, tree: BoxTree, options: Shrinking, scheduler: str, progress: Progress
) -> None:
    """Hand ranges of whole chunks to the workers of a cluster; they write into the same files."""
    n = len(tree.points)
    step = CHUNKS_A_JOB * SAMPLES_A_CHUNK
    jobs = [
        Range(
            f"range-{begin}", str(folder.absolute()), options, tuple(tree.center.tolist()),
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


def huge_surface_skeleton(
    points: ArrayLike | str | os.PathLike[str],
    normals: ArrayLike | str | os.PathLike[str],
    folder: str | os.PathLike[str],
    *,
    tolerance: float = ShrinkOptions.tolerance,
    largest_radius: float = ShrinkOptions.largest_radius,
    scheduler: str | None = None,
    progress: Progress | ProgressCallback | None = None,
) -> Balls:
    """Compute the inner surface skeleton of a cloud that is larger than the memory likes.

    The same numbers as `medialis.surface_skeleton`, bit for bit. All large arrays live in files of
    the folder, which needs about 300 bytes a sample while it runs and 86 at the end.

    Parameters
    ----------
    points, normals : (n, 3) float64 array, or the path of a .npy file of one
        Samples with unit outward normals; a path is mapped, not read.
    folder : path
        For the results: one .npy file for each array of a `medialis.Balls`, opened again by
        `open_medial_cloud`, and feature_radius.npy and radius_ratio.npy, the other measures of
        `medialis.local_measures`.
    tolerance, largest_radius : float
        As in `medialis.surface_skeleton`.
    scheduler : str, optional
        Address of a Dask scheduler whose workers see the folder under the same path; threads of
        this process when missing.
    progress : callable, optional
        Called with (fraction, text); returning False cancels.

    Returns
    -------
    Balls
        Its arrays are mapped from the files.

    Raises
    ------
    InvalidShapeError
        When the samples cannot be used.
    InvalidOptionError
        When an option is out of its range.
    FileError
        When a file cannot be read or written, or a worker of the cluster died.
    Cancelled
        When `progress` asks for it; the folder is as it was.

    See Also
    --------
    open_medial_cloud : opens what it wrote.
    shrink_balls : in memory.

    Notes
    -----
    Source: thesis 3.2.1. Cost: as `medialis.surface_skeleton`, plus reading and writing.

    Examples
    --------
    >>> import tempfile
    >>> import medialis
    >>> shape = medialis.organic_shape(56)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     balls = medialis.huge_surface_skeleton(shape.points, shape.normals, f"{folder}/out")
    ...     len(balls) == shape.point_count
    True
    """
    # Imported here: compiled code takes half a second to load, and `medialis --help` needs none.
    from medialis.base.box_tree import build_box_tree

    chosen = ShrinkOptions(tolerance=tolerance, largest_radius=largest_radius)
    samples, directions = _mapped(points, "points"), _mapped(normals, "normals")
    progress = Progress.of(progress)
    with OutputFolder(folder) as out:
        files = out.file("a").parent
        temporary = out.file(f"{TREE}/a").parent
        new = partial(create_mapped, temporary)
        unit_normals = new("unit_normals", (len(samples), 3), np.float64)
        with progress.stage("check", 0.0, 0.05):
            diagonal = _check(samples, directions, unit_normals, progress)
            unit_normals.flags.writeable = False  # as in a Shape: kernels are compiled for that
        options = shrink_options(diagonal, chosen.tolerance, chosen.largest_radius)
        with progress.stage("tree", 0.05, 0.25):
            tree = build_box_tree(samples, unit_normals, unit=options.unit, allocate=new)
        with progress.stage("balls", 0.25, 0.9):
            results = _new_results(files, new, len(samples))
            if scheduler is None:
                columns = tuple(results[name] for name in OUT)
                options.run_all(0, len(samples), tree, 1, columns, progress)
            else:
                shrink_there(files, tree, options, scheduler, progress)
        with progress.stage("finish", 0.9, 1.0):
            _finish(tree, options, results, progress)
            _measure(samples, files, results)
        del tree, unit_normals, results
        with disk.folder_of(temporary) as (place, name):
            with place.folder(name) as passing:
                passing.empty()
            place.remove_folder(name)
    return open_medial_cloud(folder)


def open_medial_cloud(folder: str | os.PathLike[str]) -> Balls:
    """Open the result of `huge_surface_skeleton`; arrays are mapped, nothing is read yet.

    Raises
    ------
    FileError
        When a file is missing or damaged.

    See Also
    --------
    huge_surface_skeleton : writes the folder.

    Examples
    --------
    >>> import tempfile
    >>> import medialis
    >>> shape = medialis.organic_shape(56)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = medialis.huge_surface_skeleton(shape.points, shape.normals, f"{folder}/out")
    ...     len(medialis.open_medial_cloud(f"{folder}/out")) == shape.point_count
    True
    """
    try:
        arrays = {n: open_mapped(Path(folder) / f"{n}.npy") for n in RESULTS}
        return Balls(**arrays)
    except (OSError, ValueError) as error:
        raise FileError(f"Cannot read a medial cloud in {os.fspath(folder)}: {error}.") from None


def _mapped(values: Any, name: str) -> FloatArray:
    if isinstance(values, str | os.PathLike):
        try:
            values = open_mapped(values)
        except (OSError, ValueError, EOFError) as error:
            raise FileError(f"Cannot read {name} from {os.fspath(values)}: {error}.") from None
    array = np.asarray(values)
    if array.ndim != 2 or array.shape[1] != 3 or array.dtype != np.float64 or len(array) == 0:
        raise InvalidShapeError(
            f"{name} must be an (n, 3) float64 array, got {array.dtype} {array.shape}."
        )
    return array


def _check(
    points: FloatArray, normals: FloatArray, out_normals: FloatArray, progress: Progress
) -> float:
    """Check all rows, make the normals unit, and return the diagonal of the bounding box."""
    if len(points) != len(normals):
        raise InvalidShapeError(f"There are {len(points)} points but {len(normals)} normals.")
    low, high = np.full(3, math.inf), np.full(3, -math.inf)
    for here in blocks(len(points)):
        part = as_points(points[here])
        low, high = np.minimum(low, part.min(axis=0)), np.maximum(high, part.max(axis=0))
        out_normals[here] = as_normals(normals[here], len(part))
        progress.update(here.stop / len(points))
    diagonal = math.hypot(*(high - low))
    if diagonal == 0.0:
        raise InvalidShapeError(f"All {len(points)} points coincide: a skeleton needs an extent.")
    return diagonal


def _new_results(
    folder: Path, temporary: Callable[..., NDArray[Any]], n: int
) -> dict[str, NDArray[Any]]:
    results = {
        name: create_mapped(folder, name, (n, width) if width else (n,), dtype)
        for name, (dtype, width) in RESULTS.items()
    }
    results["second"] = temporary("second", (n,), np.int32)
    for here in blocks(n):
        for name in ("centers", "radii", "spoke_angles"):
            results[name][here] = np.nan
        results["second"][here] = -1
        results["source"][here] = np.arange(here.start, here.stop)
        results["side"][here] = 1
    return results


def _finish(
    tree: BoxTree, options: Shrinking, results: dict[str, NDArray[Any]], progress: Progress
) -> None:
    n = len(results["radii"])
    for here in blocks(n):
        options.to_input(tree, results["centers"][here], results["radii"][here])
        results["features"][here, 0] = results["source"][here]
        results["features"][here, 1] = results["second"][here]
        progress.update(here.stop / n)


def _measure(points: FloatArray, folder: Path, results: dict[str, NDArray[Any]]) -> None:
    n = len(points)
    out = {name: create_mapped(folder, name, (n,), np.float64) for name in MEASURES}
    for here in blocks(n):
        cloud = Balls(**{name: results[name][here] for name in RESULTS})
        found = measures_of_points(points, cloud)
        for name in MEASURES:
            out[name][here] = found[name]
