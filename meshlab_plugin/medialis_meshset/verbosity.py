# SPDX-License-Identifier: GPL-3.0-or-later
"""Progress of a filter, printed where the MeshSet is verbose, as pymeshlab prints its own."""

from __future__ import annotations

import sys
from weakref import WeakKeyDictionary

import pymeshlab

from medialis import Progress

_verbose: WeakKeyDictionary[pymeshlab.MeshSet, bool]
_verbose = WeakKeyDictionary()


def note_verbosity(mesh_set: pymeshlab.MeshSet, verbosity: bool) -> None:
    """Remember what `MeshSet.set_verbosity` was told, which pymeshlab does not tell."""
    _verbose[mesh_set] = bool(verbosity)


def progress_of(mesh_set: pymeshlab.MeshSet) -> Progress:
    """Return the progress of one run; it prints a line for each stage and each tenth."""
    if not _verbose.get(mesh_set, False):
        return Progress()
    told: list[tuple[str, int]] = [("", -1)]

    def tell(fraction: float, text: str) -> bool:
        line = (text, int(10 * fraction))
        if line != told[0]:
            told[0] = line
            sys.stdout.write(f"{100 * fraction:3.0f} % {text}\n")
        return True

    return Progress.of(tell)
