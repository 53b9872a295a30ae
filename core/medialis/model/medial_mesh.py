"""MedialMesh: balls with edges and triangles between them, and its levels of detail."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.errors import InvalidShapeError
from medialis.kept import Bound, Described
from medialis.model.betti import betti_numbers
from medialis.model.complex_sheets import Sheets, sheets_of
from medialis.validation import FloatArray, IntArray, frozen, hold

Index = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Complex:
    """Balls (v, 4), edges (e, 2) and triangles (f, 3) between them; lower vertices first."""

    balls: FloatArray
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
    after: FloatArray

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
        while True:
            further = target[target]
            if (further == target).all():
                break
            target = further
        balls = self.start.balls.copy()
        last = np.full(len(balls), -1)
        last[self.into[:steps]] = np.arange(steps)  # of several steps the last one is kept
        moved = last >= 0
        balls[moved] = self.after[last[moved]]
        live = target == np.arange(len(target))
        place = (np.cumsum(live) - 1)[target]
        return mapped(Complex(balls[live], self.start.edges, self.start.faces), place), place


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


def mapped(given: Complex, place: Index) -> Complex:
    """Return the image of edges and triangles under a map of their vertices."""
    return Complex(
        given.balls, _image(place[given.edges], len(given)), _image(place[given.faces], len(given))
    )


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

    centers: FloatArray
    radii: FloatArray
    edges: IntArray
    faces: IntArray
    _finer: Collapse | None = field(default=None, kw_only=True, repr=False)
    _merged: Collapse | LateCollapse | None = field(default=None, kw_only=True, repr=False)

    def __post_init__(self) -> None:
        n = len(self.centers)
        rows = {"edges": 2, "faces": 3}
        for name, width in rows.items():
            value = np.sort(np.asarray(getattr(self, name), np.int64).reshape(-1, width), axis=1)
            if value.size and (value.min() < 0 or value.max() >= n):
                raise InvalidShapeError(f"{name} must name balls from 0 to {n - 1}.")
            object.__setattr__(self, name, value)
        hold(
            self,
            centers=(np.float64, n, 3),
            radii=(np.float64, n),
            edges=(np.int32, len(self.edges), 2),
            faces=(np.int32, len(self.faces), 3),
        )
        if not (np.isfinite(self.centers).all() and np.isfinite(self.radii).all()):
            raise InvalidShapeError("Centers and radii must be finite.")
        if (self.radii < 0).any():
            raise InvalidShapeError("Radii must not be negative.")
        self._check_simplices()

    def _check_simplices(self) -> None:
        """Refuse rows of equal corners, rows given twice, and sides that are no edge."""
        n = np.int64(len(self.centers))
        keys = self.edges.astype(np.int64) @ np.array([n, 1])
        for name in ("edges", "faces"):
            rows = getattr(self, name).astype(np.int64)
            powers = n ** np.arange(rows.shape[1])[::-1]
            if (np.diff(rows, axis=1) == 0).any() or len(np.unique(rows @ powers)) < len(rows):
                raise InvalidShapeError(f"{name} must have distinct balls, each row once.")
        sides = self.faces[:, [[0, 1], [0, 2], [1, 2]]].reshape(-1, 2).astype(np.int64)
        if not np.isin(sides @ np.array([n, 1]), keys).all():
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
        balls = given.balls
        return cls(
            balls[:, :3], np.maximum(balls[:, 3], 0.0), given.edges, given.faces,  # type: ignore[arg-type]
            _finer=finer, _merged=coarser,
        )  # fmt: skip


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

    centers: FloatArray
    radii: FloatArray
    excess: float

    def __len__(self) -> int:
        return len(self.radii)
