"""The thinnest place of a wall near a ball, as a caliper finds it (for thesis 3.5.1).

The ball of a sample tells how thick a wall is at that sample. The wall is thinnest between samples
as a rule, or at one whose normal leans. So both contacts of the ball move over the faces of their
sides, from patch to patch, while the ball between them gets smaller.

The ball that is tangent at a place a with the normal n and goes through b has the diameter
|a - b| / cos(angle of n and a - b). No ball that touches the surface at a is larger, nor at b, so
the larger of the two diameters is never below the thickness. They are |a - b| where the distance is
the least in all directions: only there, and at the sharp end of a wall, is it said to be the
thickness. Along a rounded rim, where |a - b| falls to 0, the diameters stay what they are, and
normals of facets are too rough to tell more than the balls of the samples do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from medialis.model.shape import Shape
from medialis.validation import FloatArray

RINGS = 2
"""Rings of faces round a contact that make a patch."""

STEPS = 24
"""Patches on the way down, at most: the lowest sample lies a few rings from the lowest place."""

CONVEX = math.cos(math.radians(30.0))
"""A side of a wall ends where it bends outward by more than 30 degrees: at a sharp edge."""

LEANING = math.cos(math.radians(60.0))
"""Faces that lean more than 60 degrees from across the wall are no side of it."""

ACROSS = math.cos(math.radians(30.0))
"""Normals at the two places lean no more from the line between them than in a wall that tapers by
60 degrees."""

STEEP = math.cos(math.radians(15.0))
"""A vertex with a face that leans more than this from its normal is at a crease: the normal is a
mean over faces of two sides, and leans itself."""

EQUAL = 1e-9
"""Relative: lengths that differ by less are the same one."""


@dataclass(frozen=True)
class Caliper:
    """Two places on opposite sides of a wall.

    Attributes
    ----------
    ends : (2, 3) float64
    faces : two (f,) int arrays
        The faces that each of them lies on, those of its side of the wall.
    thickness : float
        Diameter of the ball between them.
    """

    ends: FloatArray
    faces: tuple[NDArray[np.int64], NDArray[np.int64]]
    thickness: float

    @property
    def length(self) -> float:
        """Distance of the two places."""
        return math.dist(*self.ends.tolist())


class PatchRoom:
    """What patches of faces of a mesh are listed in.

    Parameters
    ----------
    shape : Shape
        n samples and m faces.
    """

    def __init__(self, shape: Shape) -> None:
        assert shape.faces is not None
        self.shape, self.faces = shape, np.asarray(shape.faces)
        self._marked = np.zeros(shape.face_count, np.uint8)
        self._known = np.zeros(shape.point_count, np.int32)
        self._listed = np.empty(shape.face_count, np.int64)

    def around(self, seeds: NDArray[np.int64], rings: int) -> NDArray[np.int64]:
        """Return some faces and those round them, so many rings, ascending."""
        from medialis.fields._caliper_kernels import list_around

        fans, marks = self.shape.fans, (self._marked, self._known)
        count = list_around(
            seeds, rings, self.faces, fans.offsets, fans.indices, *marks, self._listed
        )
        return np.sort(self._listed[:count])

    def side(self, seeds: NDArray[np.int64], outward: FloatArray) -> NDArray[np.int64]:
        """Return the faces round some seeds that are of the same side of a wall, ascending."""
        from medialis.fields._caliper_kernels import list_side

        shape, near = self.shape, self.around(seeds, RINGS)
        count = list_side(
            near, seeds, outward, LEANING, CONVEX, shape.points, self.faces, shape.face_normals,
            shape.face_adjacency, self._marked, self._listed,
        )  # fmt: skip
        return np.sort(self._listed[:count])

    def patch(self, faces: NDArray[np.int64]) -> _Patch:
        """Return some faces as a patch."""
        from medialis.fields._caliper_kernels import fill_patch, list_corners

        shape, count = self.shape, len(faces)
        corners = np.empty(3 * count, np.int32)
        corners = np.sort(corners[: list_corners(faces, self.faces, self._known, corners)])
        vertices, own = np.empty((len(corners), 6)), np.empty((count, 3), np.int64)
        edges = np.empty(3 * count, np.int64)
        fill_patch(
            faces, corners, shape.points, shape.normals, self.faces, shape.face_normals, STEEP,
            self._known, vertices, own, edges,
        )  # fmt: skip
        return _Patch(vertices, own, np.stack(np.divmod(np.unique(edges), len(corners)), axis=1))


@dataclass(frozen=True)
class _Patch:
    """A patch of faces with vertices of its own.

    Attributes
    ----------
    vertices : (v, 6) float64
        Place and normal: of the smooth surface, but at a crease of the faces of the patch alone.
    faces : (f, 3) int
    edges : (e, 2) int
    """

    vertices: FloatArray
    faces: NDArray[np.int64]
    edges: NDArray[np.int64]


def close_caliper(room: PatchRoom, start: Caliper) -> Caliper | None:
    """Move both ends over their sides of a wall until it gets no thinner.

    Parameters
    ----------
    room : PatchRoom
        Of a mesh.
    start : Caliper
        Contacts of a ball between two walls, and faces there.

    Returns
    -------
    Caliper or None
        None where the distance of the ends is the least neither in all directions nor up to sharp
        edges where a wall ends: along a rounded rim, at a fingertip, or where the sides meet in an
        edge. The ball says what is known there.

    Notes
    -----
    Cost: some milliseconds; a step measures all pairs of vertices, edges and faces of two patches.
    """
    shape = room.shape
    # The ball touches the smooth surface, the caliper the faces: only calipers are compared.
    here = replace(start, thickness=math.inf)
    across = (start.ends[0] - start.ends[1]) / max(start.length, 1e-300)
    for _ in range(STEPS):
        one, other = room.side(here.faces[0], across), room.side(here.faces[1], -across)
        if not len(one) or not len(other):
            break
        ends, thickness = _thinnest_places(room, one, other, here.ends)
        if math.dist(*ends.tolist()) <= EQUAL * shape.diagonal:
            return None
        if thickness >= here.thickness * (1.0 - EQUAL):
            break
        here = Caliper(
            ends, (_faces_at(shape, one, ends[0]), _faces_at(shape, other, ends[1])), thickness
        )
    return here if _is_least(room, here) or _ends_wall(shape, here) else None


def _sharp(shape: Shape, faces: NDArray[np.int64], across: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Tell the sides (f, 3) of faces that are convex creases."""
    assert shape.faces is not None
    normals, points = shape.face_normals, shape.points
    bent = np.einsum("fa,fja->fj", normals[faces], normals[across]) < CONVEX
    ahead = points[shape.faces[across]].mean(axis=2) - points[shape.faces[faces, 0]][:, None]
    return np.asarray(bent & (np.einsum("fa,fja->fj", normals[faces], ahead) < 0))


def _faces_at(shape: Shape, patch: NDArray[np.int64], place: FloatArray) -> NDArray[np.int64]:
    """Return the faces of a patch that a place lies on."""
    assert shape.faces is not None
    corners = shape.points[shape.faces[patch]]
    weights = _nearest_weights(np.repeat(place[None], len(patch), axis=0), corners)
    apart = np.linalg.norm(np.einsum("fj,fja->fa", weights, corners) - place, axis=1)
    return patch[apart <= apart.min() + EQUAL * shape.diagonal]


def _is_least(room: PatchRoom, caliper: Caliper) -> bool:
    """Tell whether no face round one end is nearer to the other end."""
    for j in (0, 1):
        corners = room.shape.points[room.faces[room.around(caliper.faces[j], 1)]]
        other = np.repeat(caliper.ends[1 - j][None], len(corners), axis=0)
        feet = np.einsum("fj,fja->fa", _nearest_weights(other, corners), corners)
        if np.linalg.norm(feet - other, axis=1).min() < caliper.length * (1.0 - 1e-6):
            return False
    return True


def _ends_wall(shape: Shape, caliper: Caliper) -> bool:
    """Tell whether both ends lie on convex creases."""
    assert shape.faces is not None
    for place, faces in zip(caliper.ends, caliper.faces, strict=True):
        side, crease = np.nonzero(_sharp(shape, faces, shape.face_adjacency[faces]))
        corners = np.asarray(shape.faces)[faces[side]]
        rows = np.arange(len(side))
        first, last = (shape.points[corners[rows, (crease + step) % 3]] for step in (0, 1))
        off = np.linalg.norm(np.cross(last - first, place - first), axis=1)
        long = np.linalg.norm(last - first, axis=1)
        if not (off <= 1e-6 * long * shape.diagonal).any():
            return False
    return True


def _thinnest_places(
    room: PatchRoom, one: NDArray[np.int64], other: NDArray[np.int64], before: FloatArray
) -> tuple[FloatArray, float]:
    """Return places of two patches with the smallest ball between them, (2, 3), and its diameter.

    Two triangles are closest at a corner of one of them, or on an edge of each. Of equal balls the
    one nearest to the places before is taken. The places stay, and the diameter is inf, where no
    two faces face each other.
    """
    from medialis.fields._caliper_kernels import try_corners, try_edges

    a, b, ends = room.patch(one), room.patch(other), np.array(before)
    best, p, q = np.full(3, np.inf), np.empty(6), np.empty(6)
    found = before, np.array([ACROSS, EQUAL * room.shape.diagonal, EQUAL]), best, ends
    try_corners(a.vertices, a.faces, b.vertices, p, q, p, q, *found)
    try_corners(b.vertices, b.faces, a.vertices, q, p, p, q, *found)
    try_edges(a.vertices, a.edges, b.vertices, b.edges, p, q, *found)
    return ends, float(best[1])


def _nearest_weights(places: FloatArray, corners: FloatArray) -> FloatArray:
    from medialis._kernels.nearest import nearest_on_triangles

    return nearest_on_triangles(places, corners)
