"""The faces of a mesh with long edges: what refinement has to look at.

Halving an edge makes no other one long: the new edge across a face is no longer than the mean of
the two sides beside it. So faces without a long edge stay as they are, and are left out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.model.surface import Surface
from medialis.surface._halving import Cut, TooManyPointsError


@dataclass(frozen=True)
class LongEdges:
    """The faces of a mesh that have a long edge: halving never makes others long.

    Attributes
    ----------
    whole : Surface
    surface : Surface
        The part, with vertices of its own in their order.
    vertices : (v,) int64
        Those vertices in the mesh, ascending.
    faces : (f,) int64
        Its faces in the mesh, ascending.
    """

    whole: Surface
    surface: Surface
    vertices: NDArray[np.int64]
    faces: NDArray[np.int64]

    @classmethod
    def of(cls, whole: Surface, longest_edge: float) -> LongEdges:
        """Return the faces with edges longer than `longest_edge`."""
        table, corners = whole.edge_table, np.asarray(whole.faces)
        proper = table.low != table.high  # a face that names a vertex twice has a side of no length
        long = np.flatnonzero(proper)[whole.edge_lengths > longest_edge]
        has_long = np.zeros(whole.face_count, np.bool_)
        for turn in range(int(table.counts.max(initial=0))):
            here = long[table.counts[long] > turn]
            has_long[table.order[table.first[here] + turn] // 3] = True
        faces = np.flatnonzero(has_long)
        used = np.zeros(whole.point_count, np.bool_)
        used[corners[faces]] = True
        vertices, place = np.flatnonzero(used), np.cumsum(used) - 1
        return cls(whole, Surface(whole.points[vertices], place[corners[faces]]), vertices, faces)

    def cut(self, longest_edge: float, most_points: int) -> Cut:
        """Halve long edges until there are none; return the whole mesh.

        Raises
        ------
        TooManyPointsError
            When there would be more than `most_points`.
        """
        others = self.whole.point_count - len(self.vertices)
        most, cut = most_points - others, Cut.of(self.surface)
        try:
            while (more := cut.with_strips(longest_edge).halved(longest_edge, most)) is not None:
                cut = more
            cut = cut.without_strips()
            # The ways across a strip may be a little too long.
            while (more := cut.halved(longest_edge, most)) is not None:
                cut = more
        except TooManyPointsError as error:
            made, wanted = error.args
            raise TooManyPointsError(made + others, wanted) from None
        return self._with_rest(cut)

    def _with_rest(self, cut: Cut) -> Cut:
        """Put the part, cut into smaller faces, back in its place."""
        points, count = self.whole.points, len(self.vertices)
        new = cut.points[count:]
        place = np.append(self.vertices, len(points) + np.arange(len(new)))
        stay = np.ones(self.whole.face_count, np.bool_)
        stay[self.faces] = False
        rest = np.flatnonzero(stay)
        origin = np.append(rest, self.faces[cut.origin])
        order = np.argsort(origin, kind="stable")
        faces = np.concatenate([np.asarray(self.whole.faces)[rest], place[cut.faces]])
        return replace(
            cut,
            points=np.concatenate([points, new]),
            faces=faces[order].astype(np.int64),
            origin=origin[order],
        )


def has_new(faces: NDArray[Any], n: int) -> NDArray[np.bool_]:
    """Tell the faces that have a vertex from the n-th on."""
    a, b, c = faces.T
    return np.asarray((a >= n) | (b >= n) | (c >= n))
