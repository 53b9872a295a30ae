# SPDX-License-Identifier: GPL-3.0-or-later
"""Compiling the core's kernels ahead, in a process of its own, so that the first click is quick.

Compiled kernels go to the core's folder in the user's cache, which an update of the extension does
not touch. A finished warm-up leaves a mark there; without it one starts when Blender opens.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import bpy

from medialis.hosts import WARMUP, kernel_folder, kernels_are_compiled

DELAY = 2.0
"""Seconds after the start of Blender."""


class Warmup:
    """A child process that compiles all kernels.

    Attributes
    ----------
    note : str
        Sentence for the panel; empty when there is nothing to tell.
    fraction : float
        How far it is.
    """

    def __init__(self, arguments: Sequence[str] = WARMUP) -> None:
        self.fraction = 0.0
        self.note = "Preparing for the first use (once, about a minute)"
        self._lines: list[str] = []
        self._process = subprocess.Popen(
            [sys.executable, *arguments],
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
            creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    @property
    def running(self) -> bool:
        """Whether the process is still at work."""
        return self._reader.is_alive()

    def wait(self, seconds: float | None = None) -> None:
        """Wait for its end."""
        self._reader.join(seconds)

    def stop(self) -> None:
        """End the process; kernels compiled so far stay in the cache."""
        if self._process.poll() is None:
            self._process.terminate()
        self._process.wait()
        self._reader.join()

    def _read(self) -> None:
        with self._process.stderr as stream:
            for line in stream:
                words = line.split(maxsplit=2)
                if len(words) > 1 and words[0] == "PROGRESS":
                    self.fraction = float(words[1])
                else:
                    self._lines.append(line.rstrip())
        failed = self._process.wait() > 0  # below 0: we ended it
        self.note = ""
        if failed:
            self.note = "Preparing failed: the first use takes a minute longer"
            print("medialis: preparing kernels failed:", *self._lines[-5:], sep="\n  ")


current: Warmup | None = None


def choose_cache() -> None:
    """Use the user's cache folder; where it cannot be written, a folder of Blender's."""
    folder = kernel_folder()
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
    if not (folder.is_dir() and os.access(folder, os.W_OK)):
        own = Path(bpy.utils.user_resource("DATAFILES", path="medialis", create=True))
        os.environ["MEDIALIS_CACHE_DIR"] = str(own)


def start() -> float | None:
    """Start compiling when that was not done yet; as a timer, look again while it runs."""
    global current
    if current is None:
        if kernels_are_compiled():
            return None
        current = Warmup()
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()
    return 1.0 if current.running else None


def register() -> None:
    """Choose the cache; in a Blender window start compiling soon."""
    choose_cache()
    if not bpy.app.background:
        bpy.app.timers.register(start, first_interval=DELAY, persistent=True)


def unregister() -> None:
    """Stop compiling."""
    global current
    if bpy.app.timers.is_registered(start):
        bpy.app.timers.unregister(start)
    if current is not None:
        current.stop()
        current = None
