"""Run the kernels in numba's simulator, and compare with the processor: see test_kernels.py."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

import medialis
from gpu.driver import LISTED, FakeDriver, builder, install
from medialis.hosts.compile_ahead import named

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
    print(json.dumps(ITEMS))


if __name__ == "__main__":
    main()
