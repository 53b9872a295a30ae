"""Clouds that do not fit comfortably: balls with everything mapped from files (thesis 3.2).

Strategy. The tree over all samples is built once, in files that are mapped into memory, and its
samples are shrunk in ranges of tree order: spatial blocks. A ball never reaches farther than its
diameter, and the traversal touches only the nodes that the ball meets, so the halo of a block is
loaded page by page as its balls need it, however wide that is, and never twice computed. Ranges
hold whole chunks of the single run, and warm starts and certificates do not cross chunks: the
result is the same bit for bit, on threads here or on the workers of a cluster.
"""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.balls.ball_shrinking import (
    Shrinking,
    ShrinkOptions,
    shrink_options,
)
from medialis.batches.mapped_files import MEASURES, RESULTS, Files, blocks
from medialis.batches.ranges import shrink_chunks, shrink_there
from medialis.errors import FileError, InvalidShapeError
from medialis.files.output_folder import OutputFolder
from medialis.model.medial_cloud import Balls
from medialis.paths.importance import measures_of_points
from medialis.progress import Progress, ProgressCallback
from medialis.validation import as_normals, as_points

if TYPE_CHECKING:
    from medialis._kernels.box_tree import BoxTree


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
    from medialis._kernels.box_tree import build_box_tree

    chosen = ShrinkOptions(tolerance=tolerance, largest_radius=largest_radius)
    samples, directions = _mapped(points, "points"), _mapped(normals, "normals")
    progress = Progress.of(progress)
    with OutputFolder(folder) as out:
        files = Files(out.file("a").parent)
        unit_normals = files.new("unit_normals", (len(samples), 3), np.float64)
        with progress.stage("check", 0.0, 0.05):
            diagonal = _check(samples, directions, unit_normals, progress)
            unit_normals.flags.writeable = False  # as in a Shape: kernels are compiled for that
        options = shrink_options(diagonal, chosen.tolerance, chosen.largest_radius)
        with progress.stage("tree", 0.05, 0.25):
            tree = build_box_tree(samples, unit_normals, unit=options.unit, allocate=files.new)
        with progress.stage("balls", 0.25, 0.9):
            results = _new_results(files, len(samples))
            if scheduler is None:
                shrink_chunks(tree, options, results, 0, len(samples), progress)
            else:
                shrink_there(files, tree, options, scheduler, progress)
        with progress.stage("finish", 0.9, 1.0):
            _finish(tree, options, results, progress)
            _measure(samples, files, results)
        del tree, unit_normals, results
        files.remove_temporary()
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
        arrays = {n: np.load(Path(folder) / f"{n}.npy", mmap_mode="r") for n in RESULTS}
        return Balls(**arrays)
    except (OSError, ValueError) as error:
        raise FileError(f"Cannot read a medial cloud in {os.fspath(folder)}: {error}.") from None


def _mapped(values: Any, name: str) -> NDArray[np.float64]:
    if isinstance(values, str | os.PathLike):
        try:
            values = np.load(values, mmap_mode="r")
        except (OSError, ValueError, EOFError) as error:
            raise FileError(f"Cannot read {name} from {os.fspath(values)}: {error}.") from None
    array = np.asarray(values)
    if array.ndim != 2 or array.shape[1] != 3 or array.dtype != np.float64 or len(array) == 0:
        raise InvalidShapeError(
            f"{name} must be an (n, 3) float64 array, got {array.dtype} {array.shape}."
        )
    return array


def _check(
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    out_normals: NDArray[np.float64],
    progress: Progress,
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


def _new_results(files: Files, n: int) -> dict[str, NDArray[Any]]:
    results: dict[str, NDArray[Any]] = {}
    for name, (dtype, width) in RESULTS.items():
        results[name] = files.result(name, (n, width) if width else (n,), dtype)
    results["second"] = files.new("second", (n,), np.int32)
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


def _measure(points: NDArray[np.float64], files: Files, results: dict[str, NDArray[Any]]) -> None:
    n = len(points)
    out = {name: files.result(name, (n,), np.float64) for name in MEASURES}
    for here in blocks(n):
        cloud = Balls(**{name: results[name][here] for name in RESULTS})
        found = measures_of_points(points, cloud)
        for name in MEASURES:
            out[name][here] = found[name]
