"""Betti numbers of complexes of vertices, edges and triangles, over the field of two elements.

Sheets of a complex of triangles: patches that meet where an edge has three triangles or more.

MedialMesh: balls with edges and triangles between them, and its levels of detail; importance on its
balls, and meshes simplified by it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from medialis.base.arrays import Described, Index, Mask, kd_tree, twice_areas
from medialis.base.errors import InvalidShapeError
from medialis.base.kept import Bound
from medialis.base.validation import BallRows, FloatArray, IntArray, Positions, frozen, hold
from medialis.shape.surface import Topology, piece_labels
from medialis.skeleton.medial_cloud import MedialCloud


def betti_numbers(count: int, edges: Index, faces: Index) -> tuple[int, int, int]:
    """Return parts, independent loops and enclosed hollows of a complex.

    Parameters
    ----------
    count : int
        Vertices.
    edges : (e, 2) int
        All edges, also those of triangles, each once.
    faces : (f, 3) int
        Triangles, each once.
    """
    from medialis.medial_meshes._complex_kernels import eliminate, free_faces

    parts = int(piece_labels(count, edges).max(initial=-1)) + 1
    rows = np.sort(np.asarray(faces, np.int64), axis=1)
    hollows = 0
    if len(rows):
        keys = rows[:, [0, 0, 1]] * count + rows[:, [1, 2, 2]]
        sides = np.unique(keys, return_inverse=True)[1].reshape(-1, 3)
        closed = np.ones(len(rows), bool)
        free_faces(sides, int(sides.max()) + 1, closed)
        if closed.any():
            hollows = eliminate(np.sort(sides[closed], axis=1), int(sides.max()) + 1)
    euler = count - len(edges) + len(faces)
    return parts, parts + hollows - euler, hollows


class Sheets(NamedTuple):
    """What triangles and edges belong to.

    Attributes
    ----------
    of_faces : (f,) int64
        Sheet of each triangle; sheet 0 has the largest area, and so on.
    of_points : (n,) int64
        Sheet of each vertex; -1 where there are several, and where there are no triangles.
    seams : (s, 2) int64
        Edges of three triangles or more.
    """

    of_faces: Index
    of_points: Index
    seams: Index


def sheets_of(points: FloatArray, faces: Index) -> Sheets:
    """Cut a complex into sheets: triangles belong together where an edge has just two of them.

    Each sheet is a surface with borders, its triangles cut apart along seams; it may touch itself
    in single vertices.

    Parameters
    ----------
    points : (n, 3) float64
    faces : (f, 3) int
        Each once.
    """
    faces, count = np.asarray(faces, np.int64).reshape(-1, 3), len(points)
    topology = Topology(faces.astype(np.int32), count)
    table, pieces = topology.edge_table, topology.face_pieces
    order = np.argsort(-np.bincount(pieces, twice_areas(points, faces)), kind="stable")
    of_faces = np.argsort(order)[pieces]
    low, high = np.full(count, len(faces)), np.full(count, -1)
    for corner in faces.T:
        np.minimum.at(low, corner, of_faces)
        np.maximum.at(high, corner, of_faces)
    seams = table.ends[table.counts > 2].astype(np.int64)
    return Sheets(of_faces, np.where(low == high, high, -1), seams)


@dataclass(frozen=True, eq=False)
class Complex:
    """Balls (v, 4), edges (e, 2) and triangles (f, 3) between them; lower vertices first."""

    balls: BallRows
    edges: Index
    faces: Index

    def __len__(self) -> int:
        return len(self.balls)

    def placed(self, scale: float, middle: FloatArray) -> Complex:
        """Return it scaled, then moved."""
        return Complex(placed_balls(self.balls, scale, middle), self.edges, self.faces)


def placed_balls(balls: FloatArray, scale: float, middle: FloatArray) -> FloatArray:
    """Return balls (n, 4) scaled, then moved."""
    result = balls * scale
    result[:, :3] += middle
    return result


@dataclass(frozen=True, eq=False)
class Collapse:
    """A complex and the steps that make it coarser: any level without computing again.

    Attributes
    ----------
    start : Complex
    removed, into : (s,) int64
        Step by step the vertex that was merged, and the one that stayed.
    after : (s, 4) float64
        The ball that it became.
    """

    start: Complex
    removed: Index
    into: Index
    after: BallRows

    @property
    def fewest(self) -> int:
        """Vertices of the coarsest level."""
        return len(self.start) - len(self.removed)

    def placed(self, scale: float, middle: FloatArray) -> Collapse:
        """Return it scaled, then moved."""
        after = placed_balls(self.after, scale, middle)
        return Collapse(self.start.placed(scale, middle), self.removed, self.into, after)

    def level(self, count: int) -> tuple[Complex, Index]:
        """Return the complex of `count` vertices, and the vertex that each of the first became.

        Contracting an edge maps simplices to simplices, so any level is the image of the start.
        """
        steps = min(max(len(self.start) - count, 0), len(self.removed))
        target = np.arange(len(self.start))
        target[self.removed[:steps]] = self.into[:steps]
        while ((further := target[target]) != target).any():
            target = further
        balls = self.start.balls.copy()
        last = np.full(len(balls), -1)
        last[self.into[:steps]] = np.arange(steps)  # of several steps the last one is kept
        moved = last >= 0
        balls[moved] = self.after[last[moved]]
        live = target == np.arange(len(target))
        place, count = (np.cumsum(live) - 1)[target], int(live.sum())
        images = (_image(place[rows], count) for rows in (self.start.edges, self.start.faces))
        return Complex(balls[live], *images), place


class LateCollapse:
    """A collapse that is computed when it is asked for; all levels of a mesh share it."""

    def __init__(self, compute: Callable[[], Collapse]) -> None:
        self._compute = compute

    @cached_property
    def found(self) -> Collapse:
        """The collapse."""
        return self._compute()

    def __getstate__(self) -> dict[str, Any]:
        """Other processes get what was computed."""
        return {"found": self.found}


def _image(rows: Index, count: int) -> Index:
    """Rows with distinct entries, ascending in themselves, each once."""
    rows = np.sort(rows, axis=1)
    rows = rows[(np.diff(rows, axis=1) > 0).all(axis=1)]
    keys = rows[:, 0]
    for column in range(1, rows.shape[1]):
        keys = keys * count + rows[:, column]
    return np.ascontiguousarray(rows[np.unique(keys, return_index=True)[1]])


@dataclass(frozen=True, eq=False, repr=False)
class MedialMesh(Bound):
    """A complex of medial balls: it stands for the union of its balls, cones and slabs.

    Between balls that an edge or a triangle joins, centers and radii are linear.

    Attributes
    ----------
    centers : (n, 3) float64
        In the units of the shape.
    radii : (n,) float64
        Not negative.
    edges : (e, 2) int32
        All of them, also those of triangles; the lower vertex first, each once.
    faces : (f, 3) int32
        Triangles between balls, ascending in themselves; their orientation has no meaning.

    Raises
    ------
    InvalidShapeError
        When the arrays do not fit together, or a triangle has a side that is no edge.
    """

    centers: Positions
    radii: FloatArray
    edges: IntArray
    faces: IntArray
    _finer: Collapse | None = field(default=None, kw_only=True, repr=False)
    _merged: Collapse | LateCollapse | None = field(default=None, kw_only=True, repr=False)

    def __post_init__(self) -> None:
        n = len(self.centers)
        for name, width in (("edges", 2), ("faces", 3)):
            value = np.sort(np.asarray(getattr(self, name), np.int64).reshape(-1, width), axis=1)
            if value.size and (value.min() < 0 or value.max() >= n):
                raise InvalidShapeError(f"{name} must name balls from 0 to {n - 1}.")
            object.__setattr__(self, name, value)
        hold(self, centers=(n, 3), radii=n, edges=(len(self.edges), 2), faces=(len(self.faces), 3))
        if not (np.isfinite(self.centers).all() and np.isfinite(self.radii).all()):
            raise InvalidShapeError("Centers and radii must be finite.")
        if (self.radii < 0).any():
            raise InvalidShapeError("Radii must not be negative.")
        self._check_simplices()

    def _check_simplices(self) -> None:
        """Refuse rows of equal corners, rows given twice, and sides that are no edge."""
        n, keys = np.int64(len(self.centers)), {}
        for name in ("edges", "faces"):
            rows = getattr(self, name).astype(np.int64)
            keys[name] = rows @ n ** np.arange(rows.shape[1])[::-1]
            if (np.diff(rows, axis=1) == 0).any() or len(np.unique(keys[name])) < len(rows):
                raise InvalidShapeError(f"{name} must have distinct balls, each row once.")
        sides = self.faces[:, [[0, 1], [0, 2], [1, 2]]].reshape(-1, 2).astype(np.int64)
        if not np.isin(sides @ np.array([n, 1]), keys["edges"]).all():
            raise InvalidShapeError("Each side of a triangle must be an edge.")

    def __len__(self) -> int:
        return len(self.radii)

    @cached_property
    def betti(self) -> tuple[int, int, int]:
        """Parts, independent loops and enclosed hollows."""
        return betti_numbers(len(self), self.edges.astype(np.int64), self.faces.astype(np.int64))

    @cached_property
    def sheets(self) -> Sheets:
        """Sheets of its triangles and balls, and the seams where they meet."""
        return sheets_of(self.centers, self.faces.astype(np.int64))

    @property
    def _coarser(self) -> Collapse | None:
        return self._merged.found if isinstance(self._merged, LateCollapse) else self._merged

    @property
    def fewest(self) -> int:
        """Balls of the coarsest level."""
        return len(self) if self._coarser is None else self._coarser.fewest

    @property
    def most(self) -> int:
        """Balls of the finest level."""
        return len(self) if self._finer is None else len(self._finer.start)

    @cached_property
    def complex(self) -> Complex:
        """The same as one array of balls, and 64-bit indices."""
        balls = frozen(np.column_stack([self.centers, self.radii]), np.float64)
        return Complex(balls, self.edges.astype(np.int64), self.faces.astype(np.int64))

    def level(self, balls: int) -> MedialMesh:
        """Return the mesh with this many balls, without computing anew.

        Fewer balls come from merging those of this mesh, more are those of the fine complex that
        it was made of; the topology is the same. Beyond `fewest` and `most` it is those.
        """
        sequence = self._coarser if balls < len(self) else self._finer
        if sequence is None or balls == len(self):
            return self
        found, _ = sequence.level(balls)
        return MedialMesh.of(found, finer=self._finer, coarser=self._merged)

    def with_levels(self) -> MedialMesh:
        """Return the mesh with its levels computed: data that can be moved and packed."""
        return replace(self, _merged=self._coarser)

    @classmethod
    def of_rows(cls, balls: FloatArray, edges: Index, faces: Index) -> MedialMesh:
        """Make a mesh of balls (n, 4) and rows as others give them.

        Sides of triangles that are no edge are added; edges and triangles that come twice, or with
        equal ends, are there once or not at all.
        """
        edges, faces = np.reshape(edges, (-1, 2)), np.reshape(faces, (-1, 3))
        faces = _image(np.asarray(faces, np.int64), len(balls))
        sides = faces[:, [[0, 1], [0, 2], [1, 2]]].reshape(-1, 2)
        rows = _image(np.concatenate([np.asarray(edges, np.int64), sides]), len(balls))
        return cls(balls[:, :3], balls[:, 3], rows, faces)  # type: ignore[arg-type]

    @classmethod
    def of(
        cls,
        given: Complex,
        *,
        finer: Collapse | None = None,
        coarser: Collapse | LateCollapse | None = None,
    ) -> MedialMesh:
        """Make a mesh of a complex, with the sequences of its levels."""
        centers, radii = given.balls[:, :3], np.maximum(given.balls[:, 3], 0.0)
        rows: tuple[Any, Any] = given.edges, given.faces
        return cls(centers, radii, *rows, _finer=finer, _merged=coarser)


@dataclass(frozen=True, repr=False)
class BallCover(Described):
    """Balls in one of which each point of a surface lies.

    Attributes
    ----------
    centers : (n, 3) float64
    radii : (n,) float64
    excess : float
        Volume of the balls outside of the solid, as a share of its volume; an estimate, up to
        about a hundredth of the volume of the balls.
    """

    centers: Positions
    radii: FloatArray
    excess: float

    def __len__(self) -> int:
        return len(self.radii)


def values_on_balls(mesh: MedialMesh, cloud: MedialCloud, values: ArrayLike) -> FloatArray:
    """Carry values of a surface skeleton to the balls of a medial mesh.

    Parameters
    ----------
    mesh : MedialMesh
    cloud : MedialCloud
        Of the same shape.
    values : (k,) float
        Of its balls, as its importance; NaN and balls that are not valid do not count.

    Returns
    -------
    (n,) float64
        The value of the nearest ball of the cloud; NaN where it has none.

    Raises
    ------
    InvalidShapeError
        When there is not a value for each ball.

    See Also
    --------
    important_mesh : simplifies the mesh by them.

    Examples
    --------
    >>> import medialis
    >>> shape = medialis.organic_shape(56)
    >>> mesh, cloud = medialis.medial_mesh(shape, balls=12), medialis.surface_skeleton(shape)
    >>> medialis.values_on_balls(mesh, cloud, cloud.radii).shape
    (12,)
    """
    given = np.asarray(values, np.float64)
    if given.shape != (len(cloud),):
        raise InvalidShapeError(f"There are {len(cloud)} balls and values of shape {given.shape}.")
    known = np.flatnonzero(cloud.valid & ~np.isnan(given))
    if not len(known):
        return np.full(len(mesh), np.nan)
    return given[known[kd_tree(cloud.centers[known]).query(mesh.centers)[1]]]


def important_mesh(mesh: MedialMesh, importance: ArrayLike, threshold: float) -> MedialMesh:
    """Take balls of low importance from the rims of a medial mesh, without changing its topology.

    Triangles with a free side and edges with a free end go, one after the other, while one of
    their balls is less important than the threshold (elementary collapses). Less important balls
    stay where the topology needs them, and where more important ones lie all round.

    Parameters
    ----------
    mesh : MedialMesh
    importance : (n,) float
        Of its balls; NaN counts as important.
    threshold : float
        In the unit of the importance.

    Returns
    -------
    MedialMesh
        Of some of the balls, in their order, with the same Betti numbers and without levels.

    Raises
    ------
    InvalidShapeError
        When there is not a value for each ball.

    See Also
    --------
    values_on_balls : gives the importance of the balls.

    Examples
    --------
    >>> import medialis
    >>> chain = medialis.MedialMesh([[x, 0, 0] for x in range(4)], [1] * 4,
    ...                             [[0, 1], [1, 2], [2, 3]], [])
    >>> medialis.important_mesh(chain, [0.1, 2, 3, 0.2], 1.0).centers[:, 0].tolist()
    [1.0, 2.0]
    """
    value = np.asarray(importance, np.float64)
    if value.shape != (len(mesh),):
        raise InvalidShapeError(f"There are {len(mesh)} balls and values of shape {value.shape}.")
    low: Mask = np.less(value, threshold)  # NaN is not
    edges, faces = _triangles_taken(mesh, low)
    balls = _ends_taken(mesh, low, edges, faces)
    number = np.cumsum(balls) - 1
    kept = number[mesh.edges[edges]], number[mesh.faces[faces]]
    return MedialMesh(mesh.centers[balls], mesh.radii[balls], *kept)


def _sides(mesh: MedialMesh) -> Index:
    """Return the edge that each side of each triangle is, (f, 3)."""
    powers = np.array([len(mesh), 1], np.int64)
    keys = mesh.edges @ powers
    order = np.argsort(keys, kind="stable")
    wanted = mesh.faces[:, [[0, 1], [0, 2], [1, 2]]] @ powers
    found: Index = order[np.searchsorted(keys, wanted, sorter=order)]
    return found


def _triangles_taken(mesh: MedialMesh, low: Mask) -> tuple[Mask, Mask]:
    """Collapse triangles from free sides with an end of low importance.

    Returns
    -------
    edges, faces : masks of those that stay
    """
    sides = _sides(mesh)
    removable = np.logical_or(*low[mesh.edges].T).tolist()
    uses = np.bincount(sides.ravel(), minlength=len(mesh.edges))
    owners = np.zeros(len(mesh.edges), np.int64)  # of a free side the one triangle that is left
    np.bitwise_xor.at(owners, sides.ravel(), np.arange(3 * len(sides)) // 3)
    rows, left, around = sides.tolist(), uses.tolist(), owners.tolist()
    edges, faces = np.ones(len(mesh.edges), bool), np.ones(len(sides), bool)
    waiting = [side for side in range(len(left)) if left[side] == 1 and removable[side]]
    for side in waiting:  # grows meanwhile
        if left[side] != 1:
            continue
        triangle = around[side]
        edges[side] = faces[triangle] = False
        for other in rows[triangle]:
            left[other] -= 1
            around[other] ^= triangle
            if left[other] == 1 and removable[other]:
                waiting.append(other)
    return edges, faces


def _ends_taken(mesh: MedialMesh, low: Mask, edges: Mask, faces: Mask) -> Mask:
    """Take balls of low importance at the one edge that they have; tell those that stay.

    `edges` are those that stay so far; those that go are marked in it.
    """
    bound = np.zeros(len(edges), bool)  # sides of triangles
    bound[_sides(mesh)[faces]] = True
    ends = mesh.edges.tolist()
    at: list[set[int]] = [set() for _ in range(len(mesh))]
    for edge in np.flatnonzero(edges).tolist():
        for ball in ends[edge]:
            at[ball].add(edge)
    balls = np.ones(len(mesh), bool)
    waiting = [ball for ball in range(len(mesh)) if low[ball] and len(at[ball]) == 1]
    for ball in waiting:  # grows meanwhile
        if len(at[ball]) != 1:
            continue
        edge = next(iter(at[ball]))
        if bound[edge]:
            continue
        other = sum(ends[edge]) - ball
        at[ball].clear()
        at[other].discard(edge)
        balls[ball] = edges[edge] = False
        if low[other] and len(at[other]) == 1:
            waiting.append(other)
    return balls
