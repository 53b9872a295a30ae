# SPDX-License-Identifier: GPL-3.0-or-later
"""The filter script of a MeshSet, kept free of the filters that we apply on the way.

pymeshlab records every filter; a script with our inner steps would name layers that are gone.
"""

from __future__ import annotations

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
                with _standard_error_silent():
                    mesh_set.load_filter_script(str(file))


@contextmanager
def _standard_error_silent() -> Iterator[None]:
    """Send to nowhere what C++ code prints: MeshLab prints a line for each filter that it loads.

    Where there is no such stream, there is nothing to silence.
    """
    with ExitStack() as stack:
        with suppress(OSError):
            kept = os.dup(2)
            stack.callback(os.close, kept)
            nowhere = os.open(os.devnull, os.O_WRONLY)
            stack.callback(os.close, nowhere)
            os.dup2(nowhere, 2)
            stack.callback(os.dup2, kept, 2)
        yield
