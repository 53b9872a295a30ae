"""Run the kernels in numba's simulator, and compare with the processor: see test_kernels.py."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

import medialis
from medialis.base.gpu import opened_gpu
from medialis.curves.from_views._view_kernels import cull_and_sharpen
from medialis.curves.from_views.on_gpu import sharpened, silhouette_skeletons
from medialis.curves.from_views.skeleton import as_drawn, pack
from medialis.curves.from_views.views import (
    OrthographicCamera,
    Scratch,
    View,
    runs_of,
    skeletonize,
)
from medialis.hosts.compile_ahead import named
from on_gpu.driver import LISTED, FakeDriver, builder, install

ITEMS: Counter[str] = Counter()


@cache
def simulated(name: str) -> Any:
    """Return a kernel as the simulator runs it: what each thread of a launch calls."""
    from numba import cuda

    made = builder()
    return cuda.jit(made.launched(LISTED[name], made.on_device(named(name))))


class Simulator(FakeDriver):
    """A driver whose launches run in the simulator."""

    def run(self, name: str, first: int, last: int, arguments: list[Any]) -> None:
        """Run some items."""
        ITEMS[name] += last - first
        simulated(name)[-(-(last - first) // 32), 32](first, last, *arguments)


class Patch:
    """Set for good: this process ends."""

    @staticmethod
    def setattr(owner: Any, name: str, value: Any) -> None:
        setattr(owner, name, value)


def same(work: Callable[[], Any], *names: str) -> None:
    """Compare what both devices find."""
    found = []
    for device in ("cpu", "gpu"):
        medialis.forget()
        with medialis.use_device(device):
            found.append(work())
    for name in names:
        mine, other = (getattr(one, name) for one in found)
        assert mine.tobytes() == other.tobytes(), name


def main() -> None:
    """Run all."""
    install(Patch, Simulator())
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(310, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    shape = medialis.Shape(normals * [3, 2, 1] + 0.01 * rng.normal(size=normals.shape), normals)
    balls = "centers", "radii", "features", "status"
    same(lambda: medialis.shrink_balls(shape, tolerance=0.0), *balls)
    points = rng.random((300, 3))
    shifted = "centers", "labels", "seed_labels", "shares"
    same(lambda: medialis.mean_shift(points, search_radius=0.06), *shifted)
    same_silhouettes(rng)
    print(json.dumps(ITEMS))


def same_silhouettes(rng: np.random.Generator) -> None:
    """Compare the skeletons of small silhouettes, and points sharpened by the view of a ball."""
    size, scratch = 8, Scratch(8)
    masks = rng.random((300, size, size)) < 0.7
    masks[:, [0, -1]] = masks[:, :, [0, -1]] = False
    pictures = [np.where(mask, 0, np.nan).astype(np.float32) for mask in masks]
    runs = [runs_of(near, scratch).copy() for near in pictures]
    with opened_gpu().session(medialis.Progress()) as session:
        rows, distances = silhouette_skeletons(session, runs, size, 0.0, True)
    for mask, some, row, distance in zip(masks, runs, rows, distances, strict=True):
        field = np.empty((size, size), np.float32)
        expected = skeletonize(some, 0.0, scratch, field)
        assert row.column.tobytes() == expected.column.tobytes()
        assert row.begin.tobytes() == expected.begin.tobytes()
        assert distance.tobytes() == field[mask].tobytes()
    camera = OrthographicCamera([0, 0, 0], np.eye(3), 4.0, 32)
    x, y = np.meshgrid(*2 * (np.linspace(-2, 2, 32),))
    depth = np.sqrt(np.where(x * x + y * y < 2, 2.0 - x * x - y * y, np.nan))
    view = View(camera, -depth, depth)
    drawn = as_drawn(view)
    skeletonize(drawn.runs, 1.0, drawn.scratch, drawn.field)
    packed, points = pack(drawn), rng.normal(scale=0.7, size=(310, 3))
    expected, alive = points.copy(), np.ones(len(points), bool)
    for step in (1.0, 0.5):
        cull_and_sharpen(packed, step, 0, len(points), expected, alive)
    with opened_gpu().session(medialis.Progress()) as session:
        moved, kept = sharpened([(packed, 1.0), (packed, 0.5)], points, session)
    assert moved.tobytes() == expected.tobytes() != points.tobytes()
    assert kept.tolist() == alive.tolist() and 0 < kept.sum() < len(kept)


if __name__ == "__main__":
    main()
