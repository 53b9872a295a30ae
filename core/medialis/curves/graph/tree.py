"""A growing graph on linked balls, and the cheapest path of every other ball to it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.curves.graph.ground import BallLinks
from medialis.model.polylines import follow


class GraphTree:
    """A graph on linked balls, and the cheapest path of every other ball to it.

    Parameters
    ----------
    links : BallLinks
        k balls.

    Attributes
    ----------
    edges : list of (e, 2) int64
        Of the graph so far, between balls: those of each branch.
    spent : (k,) float64
        Cost of the cheapest path of each ball to the graph; inf where there is none.
    path : (k,) float64
        Its length.
    parent : (k,) int32
        The next ball on it; -1 for balls of the graph, and where there is none.
    base : (k,) int32
        Ball of the graph in which it ends; -1 where there is none.
    """

    def __init__(self, links: BallLinks) -> None:
        k, self.links = len(links), links
        self.edges: list[NDArray[np.int64]] = []
        self.spent, self.path = np.full(k, np.inf), np.full(k, np.inf)
        self.parent, self.base = np.full(k, -1, np.int32), np.full(k, -1, np.int32)

    def copy(self) -> GraphTree:
        """Return the same graph, to grow on by itself."""
        other = GraphTree(self.links)
        other.edges = list(self.edges)
        for name in ("spent", "path", "parent", "base"):
            getattr(other, name)[:] = getattr(self, name)
        return other

    def add(self, balls: list[int]) -> None:
        """Make balls nodes of the graph, and find the paths of the others to it anew."""
        from medialis.curves.graph._growth_kernels import spread_from_tree

        room = len(self.links.neighbours) + len(balls)
        spread_from_tree(
            np.array(balls, np.int32), self.links.offsets, self.links.neighbours,
            self.links.length, self.links.cost, np.empty(room), np.empty(room, np.int32),
            self.spent, self.parent, self.path, self.base,
        )  # fmt: skip

    def join(self, ball: int) -> list[int]:
        """Take the cheapest path of a ball into the list of edges; return its new balls."""
        path = follow(self.parent, ball)
        self.edges.append(pairs(path[:-1], path[1:]))
        return path[:-1]


def pairs(a: ArrayLike, b: ArrayLike) -> NDArray[np.int64]:
    """Return edges between two equally long lists of balls, (e, 2)."""
    return np.stack([np.asarray(a, np.int64), np.asarray(b, np.int64)], axis=1)
