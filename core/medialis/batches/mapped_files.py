"""Arrays in files, mapped into memory: what a huge cloud is made of while it is computed."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.errors import FileError
from medialis.files._files import reason

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


class Files:
    """Arrays in .npy files of one folder; those of the tree are temporary."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.temporary = folder / "tree"
        self.temporary.mkdir(exist_ok=True)

    def new(self, name: str, shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
        """Create a temporary array, mapped for writing."""
        return create_mapped(self.temporary / f"{name}.npy", shape, dtype)

    def result(self, name: str, shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
        """Create an array that stays."""
        return create_mapped(self.folder / f"{name}.npy", shape, dtype)

    def remove_temporary(self) -> None:
        """Remove the files of the tree."""
        shutil.rmtree(self.temporary)


def blocks(n: int) -> Iterator[slice]:
    """Give the rows 0..n in parts of `ROWS_A_BLOCK`."""
    for begin in range(0, n, ROWS_A_BLOCK):
        yield slice(begin, min(begin + ROWS_A_BLOCK, n))


def create_mapped(path: Path, shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
    """Create a .npy file and map it for writing.

    Its place on the disk is taken now: writing to mapped pages that have none kills the process.

    Raises
    ------
    FileError
        When the disk is full or the file cannot be written.
    """
    try:
        array = np.lib.format.open_memmap(path, "w+", dtype, shape)
        if hasattr(os, "posix_fallocate"):
            _reserve(path)
    except OSError as error:
        raise FileError(f"Cannot write {path.name}: {reason(error)}.") from None
    return as_plain(array)


def _reserve(path: Path) -> None:
    """Let the disk set the size of a file aside, where the file system can."""
    try:
        with path.open("r+b") as stream:
            os.posix_fallocate(stream.fileno(), 0, path.stat().st_size)
    except OSError as error:
        if error.errno not in (errno.EOPNOTSUPP, errno.EINVAL):
            raise


def as_plain(mapped: NDArray[Any]) -> NDArray[Any]:
    """View a mapped array as a plain one, which is what kernels are compiled for."""
    return mapped.view(np.ndarray)
