"""CurveSkeleton: a curve skeleton as a graph of nodes, edges and branches (thesis 3.6)."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from medialis.base.arrays import Described, Mask, distinct, rows_at
from medialis.base.errors import InvalidShapeError
from medialis.base.kept import Bound
from medialis.base.validation import FloatArray, IntArray, Positions, check_range, frozen, hold
from medialis.shape.shape import Shape
from medialis.shape.surface import piece_labels
from medialis.skeleton.medial_cloud import MedialCloud

if TYPE_CHECKING:
    from medialis.curves.candidates import CandidateMeasure


@dataclass(frozen=True, eq=False, repr=False)
class CurveEvidence(Described):
    """What a curve skeleton of a mesh was made of.

    Attributes
    ----------
    measured : CandidateMeasure or None
        Of all k skeleton points; None where it was made from level sets, without candidates.
    candidates : (c,) int32
        Rows of the skeleton points that are candidates.
    importance : (c,) float64
        Their mu, an area, each the median over itself and its neighbours.
    kept : (c,) bool
        Candidates whose importance is not below the threshold.
    genus : dict
        Handles of the solid that each component of the surface encloses.
    closed_loops : dict
        Loops that were closed, by the same components.
    missing : tuple of (l, 3) float64
        Where loops are missing: closed lines over the surface, round the handles that no loop of
        the graph goes round.
    seams, unclear : int
        Edges of three or more faces and vertices where the surface touches itself; and edges at
        which the solid is a guess: a wall ends there, or there is no outside.
    """

    measured: CandidateMeasure | None
    candidates: IntArray
    importance: FloatArray
    kept: Mask
    genus: dict[int, int]
    closed_loops: dict[int, int]
    missing: tuple[Positions, ...] = ()
    seams: int = 0
    unclear: int = 0

    @classmethod
    def of_level_sets(
        cls, genus: dict[int, int], loops: dict[int, int], seams: int, unclear: int
    ) -> CurveEvidence:
        """Return the evidence of a skeleton that is not made of balls."""
        none = frozen(np.empty(0), np.int32), frozen(np.empty(0), np.float64)
        stay = frozen(np.empty(0), np.bool_)
        return cls(None, *none, stay, genus, loops, (), seams, unclear)


@dataclass(frozen=True, eq=False, repr=False)
class ViewPoints(Described):
    """The points that a curve skeleton from views was linked from.

    Attributes
    ----------
    points : (k, 3) float64
        Sharpened points, those in one pixel merged.
    weights : (k,) float64
        Number of matched pairs that each point stands for.
    """

    points: Positions
    weights: FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class CurveSkeleton(Bound):
    """A graph of points along the middle of a shape; loops are kept.

    A branch is a chain of edges between two nodes that are not of degree 2, or a closed chain. Use
    `of` to have the branches found.

    Attributes
    ----------
    nodes : (v, 3) float64
        Positions in the units of the shape.
    edges : (e, 2) int32
        Pairs of different nodes, no pair twice.
    radii : (v,) float64
        Radius of the ball round each node, same units; from level sets that of a circle with the
        area of the section.
    importance : (v,) float64
        How much of the surface hangs on the skeleton here (the mu of the thesis, an area, for
        skeletons from the surface skeleton); NaN where it was not measured.
    branch : (e,) int32
        Branch of each edge, 0, 1, ...
    vertex_node : (n,) int32 or None
        Node of each vertex of the surface; -1: none.
    vertex_branch : (n,) int32 or None
        Branch of each vertex of the surface; -1: none (also where the skeleton is one point).
    persistence : (v,) float64 or None
        How sure the limb of each node is, without a unit: how many times over it is what a limb
        must be, so that an end at 1 is at the limit. Nodes between limbs have the largest one
        of their component. None where it was not measured.
    cloud : MedialCloud or None
        The balls that it was computed from.
    evidence : CurveEvidence or None
        What it was made of, when it was computed from balls.
    view_points : ViewPoints or None
        The same, when it was computed from views.

    Raises
    ------
    InvalidShapeError
        When the arrays do not fit together, an edge is no pair of two nodes or comes twice, a
        branch is no chain of edges, or nodes or radii lie beyond 1e151.

    Examples
    --------
    >>> import medialis
    >>> points = [[0, 0, 0], [1, 0, 0], [2, 1, 0], [2, -1, 0]]
    >>> fork = medialis.CurveSkeleton.of(points, [[0, 1], [1, 2], [1, 3]], [1, 1, 1, 1])
    >>> fork.branch.tolist(), fork.junctions.tolist(), fork.end_points.tolist(), fork.loops
    ([0, 1, 2], [1], [0, 2, 3], 0)
    """

    nodes: Positions
    edges: IntArray
    radii: FloatArray
    importance: FloatArray
    branch: IntArray
    vertex_node: IntArray | None = None
    vertex_branch: IntArray | None = None
    persistence: FloatArray | None = field(default=None, kw_only=True)
    cloud: MedialCloud | None = field(default=None, kw_only=True)
    evidence: CurveEvidence | None = field(default=None, kw_only=True)
    view_points: ViewPoints | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        v, e = len(self.nodes), len(self.edges)
        hold(self, nodes=(v, 3), edges=(e, 2), radii=v, importance=v, branch=e)
        if self.persistence is not None:
            hold(self, persistence=v)
        check_range(self.nodes, "nodes")
        check_range(self.radii, "radii")
        _check_edges(self.edges, v)
        _check_branches(self.branch, _branch_of_edges(self.edges, v))
        branches = int(self.branch.max(initial=-1)) + 1
        rows = None if self.surface is None else self.surface.point_count
        for name, count in (("vertex_node", v), ("vertex_branch", branches)):
            given = getattr(self, name)
            if given is None:
                continue
            value = np.asarray(given)
            if value.ndim != 1 or (len(value) and not -1 <= value.min() <= value.max() < count):
                raise InvalidShapeError(
                    f"{name} must be a row of numbers from -1 to {count - 1}, got {value.shape}."
                )
            if rows not in (None, len(value)):
                raise InvalidShapeError(
                    f"{name} must have a row for each of the {rows} points of the surface, got "
                    f"{len(value)}."
                )
            object.__setattr__(self, name, frozen(value, np.int32))

    @classmethod
    def of(
        cls,
        nodes: ArrayLike,
        edges: ArrayLike,
        radii: ArrayLike,
        *,
        importance: ArrayLike | None = None,
        vertex_node: ArrayLike | None = None,
        cloud: MedialCloud | None = None,
    ) -> CurveSkeleton:
        """Find the branches of a graph and return it as a curve skeleton.

        Parameters
        ----------
        nodes : (v, 3) float
        edges : (e, 2) int
            Undirected.
        radii : (v,) float
        importance : (v,) float, optional
            NaN when missing.
        vertex_node : (n,) int, optional
            Node of each vertex of the surface. Its branch is the one that the node lies on; at a
            junction the thickest one.
        cloud : MedialCloud, optional
            Balls on that surface.

        Raises
        ------
        InvalidShapeError
            As the class.
        """
        points = np.asarray(nodes, np.float64).reshape(-1, 3)
        pairs = np.asarray(edges, np.int32).reshape(-1, 2)
        _check_edges(pairs, len(points))
        branch = _branch_of_edges(pairs, len(points))
        measured = np.full(len(points), np.nan) if importance is None else np.asarray(importance)
        bare = cls(points, pairs, np.asarray(radii, np.float64), measured, branch, cloud=cloud)
        if vertex_node is None:
            return bare
        node = np.asarray(vertex_node, np.int32)
        # Written from the thinnest to the thickest, so that the thickest remains.
        of_node = np.full(len(points) + 1, -1, np.int32)  # one more row: the branch of node -1
        for number in np.argsort(bare.mean_radii, kind="stable").tolist():
            of_node[bare.branches[number]] = number
        return replace(bare, vertex_node=node, vertex_branch=of_node[node])

    def __repr__(self) -> str:
        return (
            f"CurveSkeleton({len(self.nodes)} nodes, {self.branch_count} branches, "
            f"{self.loops} loops)"
        )

    def subset(self, stays: Mask) -> CurveSkeleton:
        """Return the chosen nodes (v,), their radii, and the edges between them."""
        number = np.cumsum(stays) - 1
        edges = number[self.edges[stays[self.edges].all(axis=1)]]
        return CurveSkeleton.of(self.nodes[stays], edges, self.radii[stays])

    @property
    def surface(self) -> Shape | None:
        """The surface whose points `vertex_node` and `vertex_branch` refer to, if known."""
        return None if self.cloud is None else self.cloud.surface

    @cached_property
    def diagonal(self) -> float:
        """The unit of lengths: the diagonal of the surface, or of the nodes where it is unknown."""
        if self.surface is not None:
            return self.surface.diagonal
        if len(self.nodes) == 0:
            return 0.0
        return math.dist(self.nodes.min(axis=0), self.nodes.max(axis=0))

    @cached_property
    def degrees(self) -> IntArray:
        """Number of edges at each node, (v,)."""
        return frozen(np.bincount(self.edges.ravel(), minlength=len(self.nodes)), np.int32)

    @cached_property
    def neighbours(self) -> tuple[tuple[int, ...], ...]:
        """Nodes at the other ends of the edges of each node, in the order of the edges."""
        near: list[list[int]] = [[] for _ in range(len(self.nodes))]
        for a, b in self.edges.tolist():
            near[a].append(b)
            near[b].append(a)
        return tuple(map(tuple, near))

    @property
    def junctions(self) -> IntArray:
        """Nodes where three or more edges meet."""
        return frozen(np.flatnonzero(self.degrees >= 3), np.int32)

    @property
    def end_points(self) -> IntArray:
        """Nodes with one edge."""
        return frozen(np.flatnonzero(self.degrees == 1), np.int32)

    @property
    def branch_count(self) -> int:
        """Number of branches b."""
        return int(self.branch.max(initial=-1)) + 1

    @cached_property
    def branches(self) -> tuple[IntArray, ...]:
        """Nodes along each branch, from end to end; a closed branch ends with its first node."""
        from medialis.base._kernels import walk_chains

        order = np.argsort(self.branch, kind="stable")
        starts = np.searchsorted(self.branch[order], np.arange(self.branch_count + 1))
        nodes = np.empty(len(order) + self.branch_count, np.int32)
        walk_chains(self.edges, order, starts, self.degrees, nodes)
        ends = starts[1:] + np.arange(1, self.branch_count + 1)
        return tuple(frozen(nodes[a:b], np.int32) for a, b in itertools.pairwise([0, *ends]))

    @cached_property
    def components(self) -> IntArray:
        """Connected component of each node, (v,), numbered by their lowest node."""
        return piece_labels(len(self.nodes), self.edges)

    @property
    def component_count(self) -> int:
        """Number of connected components."""
        return int(self.components.max(initial=-1)) + 1

    @property
    def loops(self) -> int:
        """Number of independent loops: edges - nodes + components (the first Betti number)."""
        return len(self.edges) - len(self.nodes) + self.component_count

    @cached_property
    def edge_lengths(self) -> FloatArray:
        """Length of each edge, (e,)."""
        a, b = self.edges.T
        return frozen(np.linalg.norm(self.nodes[a] - self.nodes[b], axis=1), np.float64)

    @cached_property
    def branch_lengths(self) -> FloatArray:
        """Length of each branch, (b,)."""
        total = np.bincount(self.branch, self.edge_lengths, minlength=self.branch_count)
        return frozen(total, np.float64)

    @property
    def length(self) -> float:
        """Length of all edges."""
        return float(self.edge_lengths.sum())

    @cached_property
    def tortuosity(self) -> FloatArray:
        """Length of each branch over the distance of its ends, (b,): 1 straight, inf closed."""
        tips = [self.nodes[row[-1]] - self.nodes[row[0]] for row in self.branches]
        chord, result = np.array([np.linalg.norm(tip) for tip in tips]), np.full(len(tips), np.inf)
        return frozen(np.divide(self.branch_lengths, chord, out=result, where=chord > 0), float)

    @cached_property
    def mean_radii(self) -> FloatArray:
        """Mean radius along each branch, (b,), by length."""
        a, b = self.edges.T
        middle, length = (self.radii[a] + self.radii[b]) / 2, self.branch_lengths
        total = np.bincount(self.branch, middle * self.edge_lengths)
        plain = np.bincount(self.branch, middle) / np.bincount(self.branch)
        return frozen(np.divide(total, length, out=plain, where=length > 0), float)

    @cached_property
    def least_radii(self) -> FloatArray:
        """Least radius of the nodes along each branch, (b,)."""
        least = np.array([self.radii[row].min() for row in self.branches])
        return frozen(least, np.float64)

    @cached_property
    def fork_angles(self) -> FloatArray:
        """Angles in radians of each branch with the nearest other one at its two ends, (b, 2).

        NaN where a branch ends at no fork. It leaves a fork in the direction from where it is two
        radii of the ball there away, along it, to four, or to its end: nearer to the fork branches
        bend towards each other. Rods of radius 3 that leave one of 4 at 40, 60, 75, 90 and 120
        degrees from each other: within 0.5 degrees (from one radius to three: 5.8, to six: 2.1).
        """
        leaving: dict[int, list[tuple[int, int, FloatArray]]] = {}
        for branch, row in enumerate(self.branches):
            for end, nodes in enumerate((row, row[::-1])):
                if self.degrees[nodes[0]] >= 3:
                    found = branch, end, self._direction(nodes)
                    leaving.setdefault(int(nodes[0]), []).append(found)
        result = np.full((self.branch_count, 2), np.nan)
        for ends in leaving.values():
            directions = np.array([direction for *_, direction in ends])
            cosines = np.clip(directions @ directions.T, -1.0, 1.0)
            np.fill_diagonal(cosines, -np.inf)
            for (branch, end, _), nearest in zip(ends, cosines.max(axis=1), strict=True):
                result[branch, end] = np.arccos(nearest)
        return frozen(result, np.float64)

    def _direction(self, nodes: IntArray) -> FloatArray:
        """Return the direction in which a branch leaves the first of its nodes."""
        points, radius = self.nodes[nodes], self.radii[nodes[0]]
        along = np.cumsum(np.linalg.norm(np.diff(points, axis=0, prepend=points[:1]), axis=1))
        span = np.minimum([2.0 * radius, 4.0 * radius], along[-1] * np.array([0.5, 1.0]))
        near, far = rows_at(span, along, points)
        length = float(np.linalg.norm(far - near))
        return np.asarray((far - near) / (length or 1.0))

    @cached_property
    def branch_table(self) -> dict[str, FloatArray | IntArray]:
        """Columns of a table with a line a branch.

        Nodes at its `start` and its `end`, `length`, `mean_radius`, `least_radius`, `tortuosity`,
        and `fork_angle`: the smaller one of `fork_angles`, NaN where it ends at no fork.
        """
        ends = np.array([[row[0], row[-1]] for row in self.branches], np.int32).reshape(-1, 2)
        angles = np.fmin(*self.fork_angles.T)
        return {
            "start": ends[:, 0],
            "end": ends[:, 1],
            "length": self.branch_lengths,
            "mean_radius": self.mean_radii,
            "least_radius": self.least_radii,
            "tortuosity": self.tortuosity,
            "fork_angle": angles,
        }

    def surface_part(self, branch: int) -> IntArray:
        """Return the vertices of the surface that belong to a branch.

        Raises
        ------
        InvalidShapeError
            When the skeleton has no map from the surface.
        """
        if self.vertex_branch is None:
            raise InvalidShapeError("This curve skeleton has no map from a surface to branches.")
        return frozen(np.flatnonzero(self.vertex_branch == branch), np.int32)


def _check_edges(edges: IntArray, count: int) -> None:
    if edges.min(initial=0) < 0 or edges.max(initial=-1) >= count:
        raise InvalidShapeError(
            f"Edges must name nodes 0..{count - 1}, got {edges.min()}..{edges.max()}."
        )
    same = np.flatnonzero(edges[:, 0] == edges[:, 1])
    if len(same):
        text = f"An edge must join two nodes; edge {same[0]} joins one with itself."
        raise InvalidShapeError(text)
    low, high = edges.min(axis=1).astype(np.int64), edges.max(axis=1)
    if len(distinct(low * count + high)) < len(edges):
        raise InvalidShapeError("An edge must not come twice: merge equal edges first.")


def _check_branches(branch: IntArray, chain: IntArray) -> None:
    """Hold given branches (e,) against the chains of the edges: any numbers, none left out."""
    pairs = np.unique(np.stack([branch, chain], axis=1), axis=0)
    if not all(np.array_equal(np.sort(row), np.arange(len(pairs))) for row in pairs.T):
        raise InvalidShapeError(
            f"branch must number the {int(chain.max(initial=-1)) + 1} chains of edges between "
            "nodes that have not two edges, from 0, one number each."
        )


def _branch_of_edges(edges: IntArray, count: int) -> IntArray:
    """Join edges that meet at a node of degree 2 into chains, numbered by their lowest edge."""
    order = np.argsort(edges.ravel(), kind="stable")
    degree = np.bincount(edges.ravel(), minlength=count)
    first = (np.cumsum(degree) - degree)[degree == 2]
    return piece_labels(len(edges), np.stack([order[first], order[first + 1]], axis=1) // 2)
