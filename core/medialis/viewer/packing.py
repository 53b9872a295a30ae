"""Arrays as a short text: differences of whole numbers, byte by byte, deflated.

Points and values are rounded to 16 bits of their range. Neighbours in a mesh are alike, so that the
differences between rows are small: their low and high bytes, each in a row, deflate well. The page
undoes it (`unpack.js`).
"""

from __future__ import annotations

import base64
import zlib
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

LEVELS = 65_533
"""The largest code of a finite value."""

INFINITE, MISSING = 65_534, 65_535


@dataclass
class Packer:
    """Collects arrays of whole numbers; the text of all of them goes into the page."""

    blocks: list[bytes] = field(default_factory=list)
    size: int = 0

    def add(self, values: ArrayLike, *, differences: bool = True) -> dict[str, int]:
        """Add (n,) or (n, d) whole numbers within 2^31; return where they lie.

        Each column is stored as differences from row to row, or as it is. Small numbers of either
        sign become small ones from 0; first come their lowest bytes, then the next ones.
        """
        table = np.asarray(values, np.int64)
        columns = table[:, None] if table.ndim == 1 else table
        steps = np.diff(columns, axis=0, prepend=0) if differences else columns
        flat = steps.T.ravel()
        folded = ((flat << 1) ^ (flat >> 63)).astype("<u8")
        width = max(1, (int(folded.max(initial=0)).bit_length() + 7) // 8)
        block = folded.view(np.uint8).reshape(-1, 8).T[:width].tobytes()
        where = {"at": self.size, "rows": len(columns), "columns": columns.shape[1], "bytes": width}
        self.blocks.append(block)
        self.size += len(block)
        return {**where, "differences": int(differences)}

    def add_faces(self, faces: NDArray[np.int32]) -> list[dict[str, int]]:
        """Add triangles, sorted by their lowest corner, and turned so that it comes first.

        The other two corners are stored as what they lie above it: a sixth of the text.
        """
        first = faces.argmin(axis=1)[:, None]
        turned = np.take_along_axis(faces.astype(np.int64), (first + np.arange(3)) % 3, axis=1)
        turned = turned[np.lexsort((turned[:, 1], turned[:, 0]))]
        return [
            self.add(turned[:, 0]),
            self.add(turned[:, 1:] - turned[:, :1], differences=False),
        ]

    def text(self) -> str:
        """Return all of them, deflated, as base64."""
        return base64.b64encode(zlib.compress(b"".join(self.blocks), 7)).decode()


def point_codes(points: NDArray[np.float64]) -> tuple[NDArray[np.int64], dict[str, Any]]:
    """Return points (n, 3) as whole numbers up to 65535, and how to get them back.

    Points are `low + step * code`; a step is the longest side of their box over 65535.
    """
    low = points.min(axis=0, initial=np.inf) if len(points) else np.zeros(3)
    size = float((points.max(axis=0) - low).max()) if len(points) else 0.0
    step = size / 65_535 or 1.0
    return np.rint((points - low) / step).astype(np.int64), {"low": low.tolist(), "step": step}


def value_codes(values: NDArray[Any]) -> tuple[NDArray[np.int64], dict[str, Any]]:
    """Return numbers (n,) as codes of their finite range, with codes for infinity and NaN."""
    numbers = np.asarray(values, np.float64)
    finite = np.isfinite(numbers)
    known = numbers[finite] if finite.any() else np.array([0.0, 1.0])
    low, high = float(known.min()), float(known.max())
    share = np.zeros(len(numbers))
    share[finite] = (numbers[finite] - low) / ((high - low) or 1.0)
    codes = np.rint(LEVELS * share).astype(np.int64)
    codes[~finite] = np.where(numbers[~finite] == np.inf, INFINITE, MISSING)
    return codes, {"low": low, "high": high}
