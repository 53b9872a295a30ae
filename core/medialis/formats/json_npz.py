"""Values and arrays out and back without loss: strict JSON, and NPZ.

The same content gives the same bytes.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from dataclasses import asdict, is_dataclass
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.base.errors import InvalidOptionError, InvalidShapeError
from medialis.formats.files import complete_file, file_bytes, reading, write_text

MOST_PACKED, LEAST_UNPACKED = 200, 1_000_000_000
"""Times its own size that an archive may unpack to, from so many bytes on. Masks pack by 100."""


def write_npz(path: str | os.PathLike[str], arrays: Mapping[str, ArrayLike]) -> None:
    """Write named arrays as an uncompressed NPZ file; the same arrays give the same bytes.

    Raises
    ------
    InvalidOptionError
        When a name is no text or empty, or an array holds Python objects.
    FileError
        When the file cannot be written.
    """
    import zipfile

    checked = {}
    for name, values in arrays.items():
        array = np.asarray(values)
        if not isinstance(name, str) or not name or "\0" in name:
            raise InvalidOptionError(f"an array name must be text, got {name!r}.")
        if array.dtype.hasobject:
            raise InvalidOptionError(f"array {name!r} holds Python objects; numbers are needed.")
        checked[name] = array
    with complete_file(path) as stream, zipfile.ZipFile(stream, "w") as archive:
        for name, array in checked.items():
            # A ZipInfo made here has a fixed date, so nothing in the file tells when it was made.
            with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True) as member:
                np.lib.format.write_array(member, array, allow_pickle=False)


def read_npz(path: str | os.PathLike[str]) -> dict[str, NDArray[Any]]:
    """Read all arrays of an NPZ file, in the order they were written.

    Raises
    ------
    FileError
        When the file is missing or cannot be read.
    InvalidShapeError
        When it is no NPZ file, damaged, or holds Python objects.
    """
    import io
    import zipfile

    name = os.fspath(path)
    data = file_bytes(name)
    with reading(name):
        if not data.startswith(b"PK"):
            raise InvalidShapeError("it is not an NPZ file.")
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            sizes = {entry.filename: entry.file_size for entry in archive.infolist()}
            if sum(sizes.values()) > max(MOST_PACKED * len(data), LEAST_UNPACKED):
                raise InvalidShapeError(
                    f"it unpacks to {sum(sizes.values()) / 1e9:.3g} GB, more than {MOST_PACKED} "
                    "times its size."
                )
            return {
                member.removesuffix(".npy"): _member(archive, member, size)
                for member, size in sizes.items()
            }


def _member(archive: Any, member: str, size: int) -> NDArray[Any]:
    """Read one array; its header is held against the size of the member first."""
    npy = np.lib.format
    with archive.open(member) as stream:
        version = npy.read_magic(stream)
        header = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}[version]
        shape, _, dtype = header(stream)
        if dtype.hasobject:
            raise InvalidShapeError(f"its array {member[:60]} holds Python objects.")
        if math.prod(shape) * dtype.itemsize > size or min(shape, default=0) < 0:
            raise InvalidShapeError(f"its array {member[:60]} is cut short.")
    with archive.open(member) as stream:
        return np.asarray(npy.read_array(stream, allow_pickle=False))


def json_text(value: Any) -> str:
    """Return strict JSON: NaN and infinity become null, keys are sorted, arrays become lists.

    Numpy numbers, paths, enums, sets (sorted) and dataclasses are understood.

    Raises
    ------
    InvalidOptionError
        When something has no place in JSON, or contains itself.

    Examples
    --------
    >>> print(json_text({"b": float("nan"), "a": [1, True]}))
    {
      "a": [
        1,
        true
      ],
      "b": null
    }
    """
    try:
        return json.dumps(_plain(value), indent=2, sort_keys=True, allow_nan=False)
    except RecursionError:
        raise InvalidOptionError("a value for JSON is nested too deeply or holds itself.") from None


def write_json(path: str | os.PathLike[str], value: Any) -> None:
    """Write a value as UTF-8 JSON, see `json_text`.

    Raises
    ------
    InvalidOptionError
        When something has no place in JSON.
    FileError
        When the file cannot be written.
    """
    write_text(path, json_text(value) + "\n")


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if isinstance(value, Enum):
        value = value.value
    if value is None or isinstance(value, bool | str):
        return value
    if isinstance(value, int):
        return int(value)
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {_key(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, os.PathLike):
        return _plain(os.fspath(value))
    if isinstance(value, set | frozenset):
        return _plain(sorted(value, key=repr))
    if is_dataclass(value) and not isinstance(value, type):
        return _plain(asdict(value))
    raise InvalidOptionError(f"a {type(value).__name__} has no place in JSON.")


def _key(key: Any) -> str:
    if isinstance(key, np.generic):
        key = key.item()
    if not isinstance(key, str | int | float):
        raise InvalidOptionError(f"a JSON key must be text or a number, got {key!r}.")
    return str(key)
