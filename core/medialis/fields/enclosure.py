"""How often a surface is wound round a place: twice where parts overlap (for thesis 3.5.1)."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from medialis.model.shape import Shape
from medialis.surface.surface_graph import CLOUD_NEIGHBOURS
from medialis.validation import FloatArray

VIEW = np.linalg.qr(np.array([[0.31, 0.83, 0.46], [0.72, -0.15, 0.67], [0.59, 0.53, -0.61]]))[0]
"""Three directions at right angles, off the axes that shapes are drawn along: rays meet no edge."""

ENCLOSED, TWICE = 0.5, 1.5
"""Times a surface is wound round a place from which on it is inside, and inside of two parts."""


class Enclosure:
    """What tells how often a surface is wound round a place.

    Parameters
    ----------
    shape : Shape
        n samples and m faces, outward.
    """

    def __init__(self, shape: Shape) -> None:
        self.shape = shape

    @cached_property
    def _seen(self) -> FloatArray:
        """The points as seen along `VIEW`, (n, 3)."""
        # A product of matrices wakes all threads, which costs more than it saves.
        return np.einsum("na,ab->nb", self.shape.points - self.shape.bounds[0], VIEW)

    def times(self, places: FloatArray) -> FloatArray:
        """Return how often the surface is wound round each of some places (q, 3) off it, (q,).

        Of a closed mesh a whole number: 0 outside, 1 inside, 2 where two parts of it overlap. Of an
        open mesh the median of six rays. Of a cloud its solid angle, good where places are several
        spacings off the samples.

        Cost O(q (m + n)), 2 ms for a place in a mesh of 400,000 faces.
        """
        if self.shape.faces is None:
            return _times_by_samples(self.shape, places)
        from medialis.fields._enclosure_kernels import count_crossings

        counts, room = np.zeros((len(places), 6)), np.empty((3, 3))
        for row, place in zip(counts, (places - self.shape.bounds[0]) @ VIEW, strict=True):
            count_crossings(self._seen, self.shape.faces, place, room, row)
        return np.asarray(np.median(counts, axis=1))


def _times_by_samples(shape: Shape, places: FloatArray) -> FloatArray:
    """Sum the solid angles of samples, each as large as the disc of its nearest neighbours."""
    k = min(CLOUD_NEIGHBOURS, shape.point_count - 1)
    if k < 1:
        return np.zeros(len(places))
    area = np.pi * shape.tree.query(shape.points, k=[k + 1])[0][:, 0] ** 2 / k
    result = np.empty(len(places))
    for i, place in enumerate(places):
        away = shape.points - place
        distance = np.linalg.norm(away, axis=1)
        facing = np.einsum("ij,ij->i", away, shape.normals)
        seen = distance > 0
        result[i] = (area[seen] * facing[seen] / distance[seen] ** 3).sum() / (4 * np.pi)
    return result
