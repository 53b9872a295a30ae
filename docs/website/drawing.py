"""All pictures of the site, each drawn once, by as many processes as there are processors."""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Callable, Collection
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import make_pictures
import make_thesis_figures

from medialis.base.threads import thread_limit
from medialis.operations.registry import OPERATIONS
from medialis.show.png import write_png
from website.strips import default_picture, default_viewer, tiles

PAGE_PICTURES = {**make_pictures.PICTURES, **make_thesis_figures.FIGURES}


def draw_all(folder: Path, names: Collection[str]) -> None:
    """Draw the named pictures of pages, the gallery and all strips; what is there is kept."""
    runs = {tile.file: tile for o in OPERATIONS for p in o.parameters for tile in tiles(o, p)}
    jobs = [
        *(partial(_page_picture, name) for name in names),
        *(partial(default_picture, operation) for operation in OPERATIONS),
        *(partial(default_viewer, operation) for operation in OPERATIONS),
        *(tile.draw for tile in runs.values()),
    ]
    clock = time.perf_counter()
    with ProcessPoolExecutor(mp_context=multiprocessing.get_context("spawn")) as pool:
        seconds = sum(pool.map(partial(_timed, folder=folder), jobs))
    spent = time.perf_counter() - clock
    print(f"{len(jobs)} pictures: {spent:.0f} s, {seconds:.0f} s of processor time")


def _timed(job: Callable[[Path], object], folder: Path) -> float:
    clock = time.process_time()
    with thread_limit(1):
        job(folder)
    return time.process_time() - clock


def _page_picture(name: str, folder: Path) -> None:
    """Draw a picture that a page written by hand shows."""
    path = folder / "pages" / f"{name}.png"
    if not path.exists():
        path.parent.mkdir(exist_ok=True)
        write_png(path, PAGE_PICTURES[name]())
