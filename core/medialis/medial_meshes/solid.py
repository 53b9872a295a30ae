"""The solid that a mesh bounds: what is inside, how thick it is, and which topology it has."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.fields.enclosure import VIEW
from medialis.medial_meshes.boxes import Boxes
from medialis.model.surface import Surface
from medialis.threads import run_chunks
from medialis.validation import FloatArray

PLACES_A_CHUNK = 2048
RAYS_A_CHUNK = 1024

INSIDE = 0.5
"""Times the surface is wound round a place, from which on it is inside."""

BESIDE = 1e-6
"""How far from a face its two sides are looked at, in diagonals."""


class Solid:
    """A mesh of diagonal about 1, and what of space it encloses.

    Parameters
    ----------
    points : (n, 3) float64
    faces : (m, 3) int32
        Outward; closed, or as good as it gets.
    """

    def __init__(self, points: FloatArray, faces: NDArray[np.int32]) -> None:
        self.surface = Surface(points, faces)
        self.points, self.faces = self.surface.points, np.asarray(faces, np.int64)

    @cached_property
    def whole(self) -> bool:
        """True when every edge has two faces that run along it in opposite directions."""
        table = self.surface.edge_table
        return bool((table.counts == 2).all() and table.pairs[2].all())

    @cached_property
    def walls(self) -> NDArray[np.bool_]:
        """Faces that part inside from outside, (m,); all where none does."""
        if self.whole and len(self._pieces) == 1:
            return np.ones(len(self.faces), bool)
        middles, normals = self.points[self.faces].mean(axis=1), self.surface.face_normals
        within = self.contains(middles - BESIDE * normals)
        parting = within != self.contains(middles + BESIDE * normals)
        return np.asarray(parting if parting.any() else ~parting)

    @cached_property
    def corners(self) -> NDArray[np.int64]:
        """The vertices of those."""
        return np.unique(self.faces[self.walls])

    @cached_property
    def _pieces(self) -> NDArray[np.int64]:
        return np.unique(self.surface.face_pieces).astype(np.int64)

    @cached_property
    def vertex_normals(self) -> FloatArray:
        """Unit normals of the vertices, by the areas of their faces."""
        normals = np.zeros_like(self.points)
        for corner in range(3):
            np.add.at(normals, self.faces[:, corner], self.surface.face_vectors)
        return normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]

    @cached_property
    def _seen(self) -> list[tuple[FloatArray, Boxes]]:
        """The vertices seen along three directions (one if closed), with trees of their faces."""
        turns = [np.roll(np.arange(3), axis) for axis in range(1 if self.whole else 3)]
        views = [np.ascontiguousarray((self.points @ VIEW)[:, turn]) for turn in turns]
        return [(view, Boxes.over(view[self.faces])) for view in views]

    @cached_property
    def boxes(self) -> Boxes:
        """The tree of the faces."""
        return Boxes.over(self.points[self.faces])

    def winding(self, places: FloatArray) -> FloatArray:
        """Return how often the surface is wound round each place (q, 3), (q,).

        Of a closed mesh a whole number, of an open one the median of six rays.
        """
        from medialis.medial_meshes._ray_kernels import count_crossings

        counts = np.empty((len(places), 2 * len(self._seen)))
        for axis, (view, boxes) in enumerate(self._seen):
            turned = np.ascontiguousarray((places @ VIEW)[:, np.roll(np.arange(3), axis)])
            found = np.empty((len(places), 2))

            def work(
                begin: int,
                end: int,
                given: tuple[Any, ...] = (turned, view),
                tree: Boxes = boxes,
                out: FloatArray = found,
            ) -> None:
                count_crossings(
                    begin, end, *given, self.faces, tree.order, tree.bounds, tree.depth, out
                )

            run_chunks(work, len(places), PLACES_A_CHUNK)
            counts[:, 2 * axis : 2 * axis + 2] = found
        return np.asarray(counts[:, 0] if self.whole else np.median(counts, axis=1))

    def contains(self, places: FloatArray) -> NDArray[np.bool_]:
        """Tell which places (q, 3) are inside, (q,)."""
        return np.asarray(self.winding(places) > INSIDE)

    def free_way(
        self,
        origins: FloatArray,
        directions: FloatArray,
        own: NDArray[np.int64],
        longest: FloatArray,
    ) -> tuple[FloatArray, NDArray[np.int64]]:
        """Return how far rays from places on faces `own` go, and the face met, -1 for none.

        No ray goes farther than `longest` (q,).
        """
        from medialis.medial_meshes._ray_kernels import ray_lengths

        boxes = self.boxes
        length, met = np.empty(len(origins)), np.empty(len(origins), np.int64)

        def work(begin: int, end: int) -> None:
            ray_lengths(
                begin, end, origins, directions, own, longest, self.points, self.faces,
                boxes.order, boxes.bounds, boxes.depth, length, met,
            )  # fmt: skip

        run_chunks(work, len(origins), RAYS_A_CHUNK)
        return length, met

    @cached_property
    def bodies(self) -> list[Solid]:
        """The solid of each outer piece of a closed mesh, with the cavities in it.

        Each is a solid for itself, also where it crosses others. Pieces that are hidden in others
        are left out. Only itself where there is just one, and where the mesh is not closed.
        """
        count = len(self._pieces)
        if not self.whole or count == 1:
            return [self]
        pieces = self.surface.face_pieces
        corner = self.points[self.faces[:, 0]] - self.points.mean(axis=0)
        volumes = np.bincount(pieces, np.einsum("ij,ij->i", corner, self.surface.face_vectors))
        seen = np.bincount(pieces, self.walls) > 0
        outer = [int(i) for i in np.flatnonzero((volumes > 0) & seen)]
        if not outer:
            return [self]
        order = np.argsort(pieces, kind="stable")
        starts = np.searchsorted(pieces[order], np.arange(count + 1))
        rows = [order[starts[i] : starts[i + 1]] for i in range(count)]
        shells = {i: self._part(rows[i]) for i in outer}
        held: dict[int, list[int]] = {i: [i] for i in outer}
        for i in np.flatnonzero((volumes < 0) & seen):
            place = self.points[self.faces[rows[i][0], :1]]
            round_it = [j for j in outer if shells[j].contains(place)[0]]
            if round_it:
                held[min(round_it, key=lambda j: volumes[j])].append(int(i))
        if len(outer) == 1 and len(held[outer[0]]) == count:
            return [self]
        return [
            shells[i] if len(own) == 1 else self._part(np.concatenate([rows[j] for j in own]))
            for i, own in held.items()
        ]

    def _part(self, rows: NDArray[np.int64]) -> Solid:
        """Return the solid of some of the faces."""
        used, faces = np.unique(self.faces[rows], return_inverse=True)
        return Solid(self.points[used], faces.reshape(-1, 3).astype(np.int32))

    @cached_property
    def _crosses_itself(self) -> bool:
        """True when some faces of a piece part inside from outside, and others do not."""
        pieces, walls = self.surface.face_pieces, self.walls
        count = np.bincount(pieces[walls], minlength=len(self._pieces))
        return bool(((count > 0) & (count < np.bincount(pieces))).any())

    @cached_property
    def betti(self) -> tuple[int, int, int] | None:
        """Parts, handles and cavities of the solid; None where the mesh is no closed manifold.

        Each piece of it that parts inside from outside counts: those with the inside within are
        parts, the others cavities, and handles add up. Parts that cross count each for itself, and
        those that touch at a vertex are apart there.
        """
        if not self.whole:
            return None
        if self.bodies != [self]:
            each = [body.betti for body in self.bodies]
            known = [one for one in each if one is not None]
            parts, handles, cavities = (sum(one[k] for one in known) for k in range(3))
            return (parts, handles, cavities) if len(known) == len(each) else None
        if self._crosses_itself:
            return None
        surface, faces = self.surface, self.faces
        pieces = surface.face_pieces
        count = int(pieces.max()) + 1
        first = np.full(count, -1)
        widest = np.argsort(surface.face_areas, kind="stable")
        first[pieces[widest]] = widest
        middle, normal = self.points[faces[first]].mean(axis=1), surface.face_normals[first]
        within = self.contains(middle - BESIDE * normal)
        beyond = self.contains(middle + BESIDE * normal)
        fans = np.unique(surface.topology.corner_fans(), return_index=True)[1]
        vertices = np.bincount(pieces[fans // 3], minlength=count)
        euler = vertices - np.bincount(pieces, minlength=count) // 2
        bounds = within != beyond
        volumes = np.bincount(
            pieces, np.einsum("ij,ij->i", self.points[faces[:, 0]], surface.face_vectors), count
        )
        cavity = bounds & (volumes < 0)
        handles = (2 - euler[bounds]) // 2
        return int((bounds & ~cavity).sum()), int(handles.sum()), int(cavity.sum())
