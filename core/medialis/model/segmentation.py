"""Segmentation: one label for every sample and face of a surface (thesis 5.3, 6.3)."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from medialis.errors import InvalidShapeError
from medialis.kept import Bound
from medialis.model.borders import face_borders, vertex_borders
from medialis.model.shape import Shape
from medialis.validation import FloatArray, IntArray, frozen, hold


@dataclass(frozen=True, eq=False, repr=False)
class Segmentation(Bound):
    """Partition of the samples of a surface.

    Attributes
    ----------
    labels : (n,) int32
        Segment of each sample: 0, 1, ... from the largest area to the smallest; -1: none, because
        nothing tells (see the function that made it).
    surface : Shape
        The n samples: the surface as computed on, refined where that was needed.
    method : str
        How it was divided, where a function has several methods: as "limbs" or "sheets".
    face_labels : (m,) int32 or None
        Segment of each face of the surface, where borders follow edges of the mesh.
    joins : (j, 2) int32 or None
        Where segments form a tree: which two are joined first, and so on; the second one becomes
        part of the first.
    join_levels : (j,) float64 or None
        How much belongs together what is joined, 1 at most, the largest first.

    Raises
    ------
    InvalidShapeError
        When there is not one label a sample, or a face.

    Examples
    --------
    >>> import medialis
    >>> shape = medialis.make_shape([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]],
    ...                             [[0, 1, 2], [0, 2, 3]])
    >>> halves = medialis.Segmentation([0, 0, 0, 1], surface=shape)
    >>> halves, halves.of_faces().tolist()
    (Segmentation(2 segments of 4 samples), [0, 0])
    """

    labels: IntArray
    surface: Shape = field(kw_only=True)
    method: str = field(default="", kw_only=True)
    face_labels: IntArray | None = field(default=None, kw_only=True)
    joins: IntArray | None = field(default=None, kw_only=True)
    join_levels: FloatArray | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        labels = np.asarray(self.labels)
        if labels.shape != (self.surface.point_count,):
            raise InvalidShapeError(
                f"labels must be one number for each of the {self.surface.point_count} samples, "
                f"got {labels.shape}."
            )
        object.__setattr__(self, "labels", frozen(labels, np.int32))
        if self.face_labels is not None:
            hold(self, face_labels=(np.int32, self.surface.face_count))
        if self.joins is not None:
            j = len(self.joins)
            hold(self, joins=(np.int32, j, 2), join_levels=(np.float64, j))

    def __repr__(self) -> str:
        return f"Segmentation({self.count} segments of {len(self.labels)} samples)"

    @cached_property
    def areas(self) -> FloatArray:
        """Area of each segment, (count,); number of samples in a cloud."""
        labels, weight = self.labels, self.surface.point_areas
        if self.face_labels is not None:
            labels, weight = self.face_labels, self.surface.face_areas
        areas = np.bincount(labels[labels >= 0], weight[labels >= 0])
        return frozen(areas, np.float64)

    @property
    def count(self) -> int:
        """Number of segments."""
        return len(self.areas)

    @cached_property
    def borders(self) -> tuple[FloatArray, IntArray]:
        """Curves between the segments of a mesh: points (p, 3), and edges (e, 2) between them.

        Where samples were divided they cross the triangles, and are as short as they can be without
        leaving the triangles that have samples of two segments; where faces were divided they
        follow edges of the mesh.
        """
        if self.surface.faces is None:
            return frozen(np.empty((0, 3)), np.float64), frozen(np.empty((0, 2)), np.int32)
        if self.face_labels is not None:
            return face_borders(self.surface, self.face_labels)
        return vertex_borders(self.surface, self.labels)

    def of_faces(self) -> IntArray:
        """Return the segment of each face of the surface, (m,).

        Its own where faces were divided, else that of most of its corners. Three different corners:
        the lowest segment, which is the largest. -1 where two corners or more have none.
        """
        if self.face_labels is not None:
            return self.face_labels
        if self.surface.faces is None:
            return frozen(np.empty(0), np.int32)
        low, middle, high = np.sort(self.labels[self.surface.faces], axis=1).T
        three = (low != middle) & (middle != high)
        # Sorted: the middle one is the majority, if there is one. -1 comes first.
        return frozen(np.where(three, np.where(low < 0, middle, low), middle), np.int32)

    def joined(self, count: int) -> Segmentation:
        """Return the division into fewer segments, `count` at least, by the tree of `joins`.

        Each segment of it is made of whole segments of this one. More than `count` where too few of
        them can be joined; the same segments without a tree.
        """
        if self.joins is None or self.join_levels is None:
            return self
        turns = min(max(self.count - max(count, 1), 0), len(self.joins))
        first = np.arange(self.count)
        for kept, dropped in self.joins[:turns][::-1].tolist():  # their target is final
            first[dropped] = first[kept]
        area = np.bincount(first, self.areas, minlength=self.count)
        used = np.unique(first)
        order = used[np.lexsort((used, -area[used]))]
        number = np.full(self.count + 1, -1, np.int32)  # the last one is that of -1
        number[order] = np.arange(len(order))
        number[:-1] = number[first]
        return Segmentation(
            number[self.labels],
            surface=self.surface,
            method=self.method,
            face_labels=None if self.face_labels is None else number[self.face_labels],
            joins=number[self.joins[turns:]],
            join_levels=self.join_levels[turns:],
        )

    def of_input_faces(self) -> IntArray:
        """Return the segment of each face before `medialis.refine`, (m_in,).

        A face that was split has the segment that covers most of it (ties: the lowest).
        """
        labels, origin = self.of_faces(), self.surface.face_origin
        if origin is None:
            return labels
        width = self.count + 1
        keys = np.asarray(origin, np.int64) * width + labels + 1
        used, place = np.unique(keys, return_inverse=True)
        total = np.bincount(place.reshape(-1), self.surface.face_areas)
        order = np.lexsort((-used, total))  # the last one of each face stays
        result = np.full(int(origin.max(initial=-1)) + 1, -1, np.int32)
        result[used[order] // width] = used[order] % width - 1
        return frozen(result, np.int32)
