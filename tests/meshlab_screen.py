"""The window of the real MeshLab 2020.09 on a display without a screen: keys, clicks, pictures."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from real_meshlab import MeshLab, need

PATIENCE = 120.0
SEARCH = (1258, 46)
APPLY, CLOSE, ABOVE_DEFAULT = (0.74, 22), (0.26, 22), (0.04, 84)
"""Places in a dialog: the share of its width, and pixels from its bottom. Above
"Default" there is nothing where 2020.09 has its box "Preview"."""


@dataclass
class Screen:
    """One running MeshLab; positions are pixels of its display."""

    meshlab: MeshLab
    process: subprocess.Popen[bytes]

    def xdotool(self, *words: object) -> str:
        """Run xdotool on the display; what it prints."""
        command = [need("xdotool"), *map(str, words)]
        environment = self.meshlab.environment
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60)
        return done.stdout.strip()

    def click(self, x: int, y: int) -> None:
        self.xdotool("mousemove", x, y, "click", 1)
        time.sleep(0.3)

    def key(self, *names: str) -> None:
        self.xdotool("key", *names)

    def picture(self, path: Path) -> None:
        """Write the whole display as a PNG file."""
        subprocess.run(
            [need("import"), "-window", "root", str(path)],
            env=self.meshlab.environment, check=True, timeout=60,
        )  # fmt: skip

    def windows(self, title: str) -> list[str]:
        """The numbers of the windows with a title that are shown."""
        mine = ("search", "--onlyvisible", "--all", "--pid", self.process.pid, "--name", title)
        return self.xdotool(*mine).split()

    def wait(self, what: Callable[[], Any], seconds: float = PATIENCE) -> Any:
        """Wait until a function gives something, and return it."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if found := what():
                return found
            time.sleep(0.05)
        raise TimeoutError("MeshLab did not get there")

    def child(self) -> str:
        """The process that a filter runs; empty without one."""
        words = ["pgrep", "-P", str(self.process.pid)]
        return subprocess.run(words, capture_output=True, text=True).stdout.strip()

    def fill(self, window: str, size: tuple[int, int]) -> bool:
        """Give a window a size; whether it keeps it, which it does not while files are opened."""
        self.xdotool("windowmove", window, 0, 0)
        self.xdotool("windowsize", window, *size)
        time.sleep(2.0)
        width, height = (f"{name}={n}" for name, n in zip(("WIDTH", "HEIGHT"), size, strict=True))
        lines = self.xdotool("getwindowgeometry", "--shell", window).splitlines()
        return width in lines and height in lines and "X=0" in lines

    def place(self, title: str, where: tuple[float, int]) -> tuple[int, int]:
        """A place in a dialog."""
        window = self.wait(lambda: self.windows(f"^{title}$"))[0]
        geometry = self.xdotool("getwindowgeometry", "--shell", window).splitlines()
        about = dict(line.split("=") for line in geometry)
        x = int(about["X"]) + round(where[0] * int(about["WIDTH"]))
        return x, int(about["Y"]) + int(about["HEIGHT"]) - where[1]

    def choose(self, title: str) -> None:
        """Open the dialog of a filter by MeshLab's field for searching, which sorts as it likes."""
        for downs in (1, 1, 2, 3, 4, 5, 6):
            self.click(*SEARCH)
            time.sleep(0.7)
            self.xdotool("type", title)
            time.sleep(1.0)
            self.key(*["Down"] * downs)
            self.key("Return")
            with suppress(TimeoutError):
                self.wait(lambda: self.windows(f"^{title}$"), seconds=4)
                time.sleep(0.5)
                return
        raise LookupError(title)

    def apply(self, title: str, *, to_its_end: bool = True) -> None:
        """Press Apply and wait until the child has come, and has gone."""
        self.click(*self.place(title, APPLY))
        self.wait(self.child)
        if to_its_end:
            self.wait(lambda: not self.child())
            time.sleep(1.0)

    def close(self, title: str) -> None:
        self.click(*self.place(title, CLOSE))


@contextmanager
def meshlab_window(
    meshlab: MeshLab, files: Sequence[Path], size: tuple[int, int] = (1280, 900)
) -> Iterator[Screen]:
    """Start MeshLab on files, make its window as large as the display, and end it."""
    command = [str(meshlab.folder / "meshlab"), *map(str, files)]
    process = subprocess.Popen(
        command, env={**meshlab.environment, "QT_X11_NO_MITSHM": "1"},
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=meshlab.folder,
    )  # fmt: skip
    screen = Screen(meshlab, process)
    try:
        window = screen.wait(lambda: screen.windows("^MeshLab 2020"))[0]
        screen.wait(lambda: screen.fill(window, size))
        yield screen
    finally:
        process.kill()
        process.wait(timeout=30)
