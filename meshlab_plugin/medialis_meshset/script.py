# SPDX-License-Identifier: GPL-3.0-or-later
"""The filter script of a MeshSet, kept free of the filters that we apply on the way.

pymeshlab records every filter; a script with our inner steps would name layers that are gone.
"""

from __future__ import annotations

import ctypes
import os
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import pymeshlab

EMPTY = "<FilterScript/>"


@contextmanager
def filter_script_kept(mesh_set: pymeshlab.MeshSet) -> Iterator[None]:
    """Give the MeshSet its filter script back at the end of the block."""
    with tempfile.TemporaryDirectory(prefix="medialis-") as folder:
        file = Path(folder) / "before.mlx"
        mesh_set.save_filter_script(str(file))
        try:
            yield
        finally:
            mesh_set.clear_filter_script()
            if EMPTY not in file.read_text(encoding="utf-8"):
                with _standard_output_silent():
                    mesh_set.load_filter_script(str(file))


@contextmanager
def _standard_output_silent() -> Iterator[None]:
    """Send to nowhere what C++ code prints: MeshLab prints a line a filter that it loads.

    Where that cannot be done (no such stream, Windows), the lines appear.
    """
    with ExitStack() as stack:
        with suppress(OSError, TypeError, AttributeError):
            library = ctypes.CDLL(None)
            library.fflush(None)
            kept = os.dup(1)
            stack.callback(os.close, kept)
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, 1)
            os.close(nowhere)
            stack.callback(os.dup2, kept, 1)
            stack.callback(library.fflush, None)
        yield
