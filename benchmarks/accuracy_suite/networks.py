"""Tubes round networks of curves, and bodies with arms: known curve skeletons and parts."""

from __future__ import annotations

import numpy as np

import medialis
from accuracy_suite.catalogue import forms  # noqa: F401  (makes tests/ importable)
from accuracy_suite.cells import Cells
from accuracy_suite.known import KnownShape, Truth

import tubes  # isort: skip


def networks() -> dict[str, KnownShape]:
    """Return networks; where arms meet, the axis is more than the curves, which are its middle."""
    wheel = [tubes.circle([0, 0, 0], 1.3), tubes.segment([-1.3, 0, 0], [1.3, 0, 0])]
    ladder = [tubes.segment([x, -1.4, 0], [x, 1.4, 0]) for x in (-0.5, 0.5)]
    ladder += [tubes.segment([-0.5, y, 0], [0.5, y, 0]) for y in (-0.9, -0.3, 0.3, 0.9)]
    fork = [tubes.segment([0, 0, 0], 1.6 * arm) for arm in tubes.FORK]
    cross = [tubes.segment([0, 0, 0], 1.4 * arm) for arm in tubes.AXES]
    return {
        "fork": _network("fork", fork, 0.25, 0, 3),
        "six arms": _network("six arms", cross, 0.25, 0, 6),
        "wheel": _network("wheel", wheel, 0.2, 2, 0),
        "ladder": _network("ladder", ladder, 0.13, 3, 4),
        "thin ladder": _network("thin ladder", ladder, 0.06, 3, 4),
        "pinholes": _pinholes(),
    }


def _network(name: str, curves: list, radius: float, loops: int, ends: int) -> KnownShape:
    curve = np.concatenate([tubes.dense_curve(np.asarray(one, float), 0.001) for one in curves])

    def make(longest: float, rng: np.random.Generator | None) -> medialis.Shape:
        return tubes.tube(curves, radius, longest / 1.3)  # edges are up to the cell's diagonal

    return KnownShape(
        name, "network", make, lambda: Truth.of_curve(curve, np.full(len(curve), radius)),
        2 * radius, loops=loops, ends=ends, curve=curve,
    )  # fmt: skip


def _pinholes() -> KnownShape:
    """Return a block with two holes through it, 1 % of its size wide."""
    lines = [0, 0.3, 0.312, 0.7, 0.712, 1.0]
    block = Cells.of_rows(lines, [0, 0.3, 0.312, 0.6], ["#####", "#.#.#", "#####"])
    coarse = block.solid(0.3)
    return KnownShape(
        "pinholes", "network", lambda h, rng: coarse,
        lambda: Truth.of_curve(np.zeros((1, 3)), np.ones(1)), 0.3, loops=2,
    )  # fmt: skip


def bodies() -> dict[str, tuple[medialis.Shape, np.ndarray]]:
    """Meshes with the body of each vertex: a ball with six arms, and three arms alone."""
    jack = tubes.hub(tubes.AXES, 0.06, ball=0.6)
    fork = tubes.hub(tubes.FORK, 0.06, ball=0.25)[0]
    return {"jack": jack, "fork": (fork, (fork.points @ tubes.FORK.T).argmax(axis=1))}
