"""Balls of a mesh that its triangles constrain, not its samples alone (thesis 3.2).

Between samples, balls that only samples constrain poke out of the surface. `Walls` shrinks them to
what the triangles leave room for. What counts as surface is said in `shape/creases.py`; how a
triangle constrains a ball, in `_triangle_kernels.py`. At convex creases nothing but the smallest
balls fits: `with_edge_balls` gives samples there the ends of the sheets that come out of the
creases, `between_samples` puts more of them between the samples.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import Index, unit_rows
from medialis.base.progress import Progress
from medialis.base.threads import run_chunks
from medialis.base.validation import FloatArray, IntArray
from medialis.shape.creases import STEEPER, Creases
from medialis.shape.shape import Shape
from medialis.skeleton.medial_cloud import (
    SAMPLES_A_CHUNK,
    BallStatus,
    MedialCloud,
    overwritten,
    shrink_options,
)

if TYPE_CHECKING:
    from medialis.base._box_tree_kernels import BoxTree, Leaves
    from medialis.skeleton._triangle_kernels import Hung

BLOCKS_A_CHUNK = 1024  # halved 0 %, doubled 0 %
"""Of 8 faces."""

ROUNDING = 1e-10  # halved 0 %, doubled 0 %
"""Fraction of the diagonal: a place less deep than this in a ball is on it."""

CREASE_DEPTH = 1e-6  # halved 0 %, doubled 0 %
"""Fraction of the diagonal: how far the ball at a crease lies from it, at least."""

LARGEST_GAP = 1e-3  # halved 19 %, doubled 17 %
"""Fraction of the diagonal: no place of a convex crease is farther than this from a ball."""

MOST_BETWEEN = 3  # halved 100 %, doubled 44 %
"""Balls between two samples of a crease, at most: enough for edges of 0.8 % of the diagonal."""

DEPTH_BETWEEN = 0.55  # halved 44 %, doubled 13 %
"""Lengths of their edge that balls between samples lie deep: in a right angle half-way to where the
balls of the next samples begin."""

LEAST_FIT = 0.9  # halved 12 %, doubled 95 %
"""Share of the radius that two walls would allow: balls between samples with less lie where those
of the samples do, since other walls are near."""

LEAST_DEPTH = 1 / 16
"""Of the tolerance: how deep a face that is no relief may lie in a ball of a shape without flat
faces and cylinders. With none, a third of the right thicknesses of an irregular mesh were wrong."""


@dataclass(frozen=True, eq=False)
class Walls:
    """The triangles of a mesh as what constrains balls, hung on the tree of its samples.

    Attributes
    ----------
    creases : Creases
        Of the mesh.
    tree : BoxTree
        Of the samples.
    place : (n,) int32
        Where each sample lies in the tree.
    faces : (8 b,) int32
        Faces in blocks of 8, those of each leaf in blocks of their own; -1 where a slot is left.
    hung : Hung
        Where they lie, in that order.
    """

    creases: Creases
    tree: BoxTree
    place: IntArray
    faces: IntArray
    hung: Hung

    @classmethod
    def of(cls, creases: Creases, tree: BoxTree) -> Walls:
        """Hang the triangles of a mesh on the tree of its samples. Cost O(m), parallel."""
        from medialis.base.box_tree import fill_bounds
        from medialis.skeleton import _triangle_kernels as kernels

        shape, place = creases.shape, tree.place
        depth, faces = tree.depth, np.asarray(shape.faces)
        leaf, first = np.empty(len(faces), np.int32), np.zeros((1 << depth) + 1, np.int64)
        kernels.count_blocks(place, faces, depth, leaf, first)
        blocks = int(first[-1])
        slots = kernels.BLOCK * blocks
        order, corners = np.empty(slots, np.int32), np.empty((slots, 3), np.int32)
        reliefs = np.empty((slots, 4))
        unit = shrink_options(shape.diagonal, 0.0, 0.0).unit
        out = order, corners, reliefs
        bulges = creases.bulges
        kernels.fill_blocks(place, faces, leaf, first, bulges, creases.least_cosines, unit, out)
        del bulges, leaf  # as large as the shape
        hulls = np.empty((blocks, kernels.ROWS, kernels.BLOCK), np.float32)
        run_chunks(kernels.fill_hulls, blocks, BLOCKS_A_CHUNK, tree.points, corners, hulls)
        bounds = np.empty_like(tree.bounds)
        fill_bounds(bounds, depth, _leaves(tree.points, corners, first))
        hung = kernels.Hung(tree.points, bounds, tree.child, first, corners, reliefs, hulls)
        return cls(creases, tree, place, order, hung)

    @property
    def shape(self) -> Shape:
        """The mesh."""
        return self.creases.shape

    def room(self, centers: FloatArray, most: FloatArray) -> FloatArray:
        """Return how far places (k, 3) are from the nearest triangle, but at most `most` (k,)."""
        from medialis.skeleton._triangle_kernels import measure_room

        lengths = shrink_options(self.shape.diagonal, 0.0, 0.0)
        places = centers / lengths.unit - self.tree.center
        radii = most / lengths.unit
        given = places, lengths.margin, self.hung, radii
        run_chunks(measure_room, len(places), SAMPLES_A_CHUNK, *given)
        radii *= lengths.unit
        return radii

    def constrain(
        self,
        cloud: MedialCloud,
        tolerance: float,
        progress: Progress,
        *,
        directions: FloatArray | None = None,
    ) -> MedialCloud:
        """Shrink balls until no triangle lies deeper in them than it may.

        Parameters
        ----------
        cloud : MedialCloud
            k balls of this shape that were just made: they are `overwritten`.
        tolerance : float
            Fraction of the diagonal.
        progress : Progress
        directions : (k, 3) float64, optional
            From the center to the sample; else the outward normal there, turned for outer balls.
            Where it is given, the faces that meet at the sample constrain the ball too.

        Returns
        -------
        MedialCloud
            A ball that changed touches a face between its corners, or at one of them.
        """
        from medialis.skeleton._triangle_kernels import TangentBalls, shrink_to_triangles

        tree, shape = self.tree, self.shape
        at_own = directions is not None
        # Neighbours share certificates; inner balls, the first, are the same with outer ones.
        n, k = len(tree.order), len(cloud)
        if k % n == 0 and (cloud.source.reshape(-1, n) == np.arange(n)).all():
            order = (n * np.arange(k // n)[:, None] + tree.order).ravel()
            samples, normals = np.tile(np.arange(n, dtype=np.int32), k // n), tree.normals
        else:
            samples = self.place[cloud.source]
            order = np.lexsort((samples, -cloud.side))
            samples = samples[order]
            normals = tree.normals[samples]
        signs = cloud.side[order]
        if directions is None:
            direction = (signs.reshape(-1, len(normals), 1) * normals).reshape(-1, 3)
        else:
            direction = np.ascontiguousarray(directions[order])
        meets_none = cloud.status[order] == BallStatus.OPEN
        if meets_none.any():  # what fits into them tells nothing of others: they come last
            turn = np.lexsort((meets_none, -signs))
            order, samples, signs, direction = (x[turn] for x in (order, samples, signs, direction))
        largest = float(np.nanmax(cloud.radii, initial=0.0)) / shape.diagonal
        lengths = shrink_options(shape.diagonal, tolerance, largest)
        radii = cloud.radii[order] / lengths.unit
        face, places = np.full(len(order), -1, np.int64), np.zeros((len(order), 3))
        # What is no relief may lie no deeper in parts; facets of smooth surfaces are not so sure.
        least = ROUNDING * shape.diagonal / lengths.unit
        flat = shape.planes is not None and bool((shape.planes >= 0).any())
        if not flat and (shape.cylinders is None or len(shape.cylinders.radii) == 0):
            least = max(least, LEAST_DEPTH * lengths.tolerance)
        highest = math.sin(math.radians(min(self.creases.angle, 90.0))) ** 2 / 2
        balls = TangentBalls(samples, direction, signs, at_own, radii, face, places)
        given = balls, lengths, least, highest, self.hung
        run_chunks(shrink_to_triangles, len(order), SAMPLES_A_CHUNK, *given, progress=progress)
        touching = np.flatnonzero(face >= 0)
        rows, directions = order[touching], direction[touching]
        radii = radii[touching] * lengths.unit
        faces, weights = self.faces[face[touching]], places[touching]
        del balls, given, order, samples, signs, direction, face, places  # as large as the cloud
        return _touching_faces(cloud, rows, directions, radii, faces, weights)


def _leaves(points: FloatArray, corners: IntArray, first: NDArray[np.int64]) -> Leaves:
    """Return what `fill_bounds` takes: the corners of the faces of each leaf."""
    from medialis.base._box_tree_kernels import Leaves
    from medialis.skeleton._triangle_kernels import gather_corners

    count = len(first) - 1
    places, normals = np.empty((3 * len(corners), 3)), np.empty((count, 3))  # mostly not touched
    starts, place = np.empty(count + 1, np.int64), np.full(len(points), -1, np.int32)
    filled = gather_corners(points, corners, first, place, (places, starts, normals))
    return Leaves(places[:filled], starts, normals, np.arange(count + 1))


AT_EDGE = 0.3
"""Radii of the ball: where the contact with a chord lies farther off that with the cylinder than
chords do, it lies at the end of the cylinder."""

ROUNDS_TO_TOUCH = 4
"""The first one leaves the square of what chords lie off, over the radius."""


def _within_cylinders(
    shape: Shape,
    faces: IntArray,
    contact: FloatArray,
    own: FloatArray,
    directions: FloatArray,
    radii: FloatArray,
) -> FloatArray:
    """Return radii of balls that touch the cylinder that a face is a chord of, not the chord.

    Of a bore seen from the wall around it chords lie beyond the surface: balls were too large. At
    the ends of a cylinder a ball touches its edge, and what is beyond is no surface.
    """
    cylinders, result = shape.cylinders, np.array(radii)
    rows = np.arange(0) if cylinders is None else np.flatnonzero(cylinders.label[faces] >= 0)
    if cylinders is None or len(rows) == 0:
        return result
    which, center = cylinders.label[faces[rows]], own[rows] - radii[rows, None] * directions[rows]
    foot = cylinders.feet(which, center)
    deep = np.abs(cylinders.heights(which, contact[rows]))
    inside = np.linalg.norm(foot - contact[rows], axis=1) <= 2.0 * deep + AT_EDGE * radii[rows]
    rows, which = rows[inside], which[inside]
    own, directions = own[rows], directions[rows]
    for _ in range(ROUNDS_TO_TOUCH):
        center = own - result[rows, None] * directions
        step = own - cylinders.feet(which, center)
        along = 2.0 * np.einsum("ka,ka->k", step, directions)
        square = np.einsum("ka,ka->k", step, step)
        deep = (along > 0) & (square < result[rows] * along)
        result[rows[deep]] = square[deep] / along[deep]
    return result


def _touching_faces(
    cloud: MedialCloud,
    rows: Index,
    directions: FloatArray,
    radii: FloatArray,
    faces: IntArray,
    weights: FloatArray,
) -> MedialCloud:
    """Return a cloud whose balls in some rows are tangent to their sample and touch a face.

    Of a face that is a chord of a cylinder they touch the cylinder.
    """
    from medialis.skeleton._triangle_kernels import find_contacts

    surface, source = cloud.surface, cloud.source[rows]
    own, contact, second = surface.points[source], np.empty((len(rows), 3)), np.empty_like(source)
    find_contacts(surface.points, np.asarray(surface.faces), faces, weights, contact, second)
    radii = _within_cylinders(surface, faces, contact, own, directions, radii)
    centers = own - radii[:, None] * directions
    features, status = np.stack([source, second], axis=1), BallStatus.OK
    balls = {"centers": centers, "radii": radii, "features": features, "status": status}
    angles = angles_between(directions, contact - centers)
    del own, contact
    touching = {"contact_faces": faces, "contact_weights": weights}
    return overwritten(cloud, rows, **balls, spoke_angles=angles, **touching)


def angles_between(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return the angle between vectors, row by row, in radians."""
    across = np.linalg.norm(np.cross(one, other), axis=1)
    return np.arctan2(across, np.einsum("ij,ij->i", one, other))


PROBES = 6
"""Depths at which there must be room, each an eighth of the one before."""

MOST_HALVINGS = 40
"""Of the depth of balls at creases: to a millionth of a millionth."""


def _fitting(
    walls: Walls, places: FloatArray, inward: FloatArray, cosine: FloatArray, depth: FloatArray
) -> FloatArray:
    """Return how deep below places balls of radius depth * cosine fit in, at most `depth` (k,).

    In a plate thinner than the depth they would lie beyond the other side: there it is halved.
    """
    return _probed(walls, places, inward, cosine, depth, MOST_HALVINGS)


def _has_room(
    walls: Walls, places: FloatArray, inward: FloatArray, cosine: FloatArray, depth: FloatArray
) -> NDArray[np.bool_]:
    """Tell whether balls of radius depth * cosine fit in below places, (k,), and smaller ones do.

    Far beyond the other side of a thin plate there is room as well, but not on the way there: at
    one of two depths one of which is eight times the other, down to a hundred-thousandth.
    """
    return _probed(walls, places, inward, cosine, depth, 0) >= 0.0


def _probed(
    walls: Walls,
    places: FloatArray,
    inward: FloatArray,
    cosine: FloatArray,
    depth: FloatArray,
    halvings: int,
) -> FloatArray:
    """Return depths (k,) halved where balls do not fit in; -1 there where none may be halved."""
    from medialis.skeleton._triangle_kernels import Below, fit_below

    lengths = shrink_options(walls.shape.diagonal, 0.0, 0.0)
    below = Below(places / lengths.unit, inward, cosine, walls.tree.center)
    result = np.array(depth / lengths.unit)
    given = below, (lengths.margin, LEAST_FIT, PROBES, halvings), walls.hung, result
    run_chunks(fit_below, len(result), SAMPLES_A_CHUNK, *given)
    return np.where(result < 0.0, -1.0, result * lengths.unit)


def with_edge_balls(cloud: MedialCloud, walls: Walls, tolerance: float) -> MedialCloud:
    """Give samples on convex creases the ball that fits into the crease beside them.

    A ball tangent at such a sample cuts a face whatever its normal: its radius is 0. The ball whose
    center lies the tolerance deep, on the line of the mean normal, touches the faces next to the
    sample instead: the end of the sheet that comes out of the crease. Both of its feature points
    are the sample; its spoke angle is that of the crease. The cloud given is `overwritten`.
    """
    surface, creases = cloud.surface, walls.creases
    cut_rows = np.zeros(len(cloud), np.bool_)
    for sign in (1, -1):
        mine = cloud.side == sign
        if mine.any():
            cut = np.zeros(surface.point_count, np.bool_)
            cut[creases.cut_vertices(sign)] = True
            cut_rows |= mine & cut[cloud.source]
    rows = np.flatnonzero(cut_rows)
    lowest = np.ones(surface.point_count)
    cosines = np.einsum("ij,ij->i", creases.normals, surface.normals[creases.vertices])
    np.minimum.at(lowest, creases.vertices, cosines)
    source = cloud.source[rows]
    rows = rows[(lowest[source] > 0) & (lowest[source] < 1 - STEEPER)]
    source = cloud.source[rows]
    inward = -surface.normals[source] * cloud.side[rows, None]
    deep = np.full(len(rows), _depth(cloud, tolerance))
    depth = _fitting(walls, surface.points[source], inward, lowest[source], deep)
    centers, radii = surface.points[source] + depth[:, None] * inward, depth * lowest[source]
    features, angles = np.stack([source, source], axis=1), 2.0 * np.arccos(lowest[source])
    balls = {"centers": centers, "radii": radii, "features": features, "spoke_angles": angles}
    on_none = {"status": BallStatus.OK, "contact_faces": -1, "contact_weights": 0.0}
    return overwritten(cloud, rows, **balls, **on_none)


def between_samples(cloud: MedialCloud, walls: Walls, tolerance: float) -> MedialCloud:
    """Return balls of convex creases between the samples there, and one beside each sample.

    Without them the union of the balls lacks the crease between any two samples. Each lies where
    the sheet comes out of the crease, and has the distance of the surface as its radius; its
    feature points are the sample nearest to its contact, the place of the crease below it.
    """
    surface, creases = cloud.surface, walls.creases
    parts = [
        _on_edges(cloud, creases, sign)
        for sign in (1, -1)
        if surface.faces is not None and (cloud.side == sign).any()
    ]
    first, second, sign, part = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    if len(first) == 0:
        return cloud.subset(first)
    face, side = np.divmod(first, 3)
    corners = np.asarray(surface.faces)[face]
    rows = np.arange(len(face))
    weights = np.zeros((len(face), 3))
    weights[rows, side], weights[rows, (side + 1) % 3] = 1.0 - part, part
    source = corners[rows, np.where(part < 0.5, side, (side + 1) % 3)]
    one, other = surface.face_normals[face], surface.face_normals[second // 3]
    middle = unit_rows(one + other, least=STEEPER)
    cosine = np.clip(np.einsum("ij,ij->i", middle, one), 0.0, 1.0)
    place = np.einsum("ij,ijk->ik", weights, surface.points[corners])
    ends = surface.points[corners[rows, side]] - surface.points[corners[rows, (side + 1) % 3]]
    small = _depth(cloud, tolerance)
    most = LARGEST_GAP * surface.diagonal / np.maximum(1.0 - cosine, STEEPER)
    depth = np.minimum(DEPTH_BETWEEN * np.linalg.norm(ends, axis=1), most)
    depth = np.maximum(depth, small)
    # They lie `depth` off a place of the surface, which is no nearer than that.
    inward = -sign[:, None] * middle
    radii = walls.room(place + depth[:, None] * inward, depth)
    fits = radii >= LEAST_FIT * depth * cosine
    rows = np.flatnonzero(fits & (depth > small))
    way = place[rows], inward[rows], cosine[rows], depth[rows] / 8.0
    fits[rows] = _has_room(walls, *way)
    shallow = _fitting(walls, place, inward, cosine, np.where(fits, 0.0, small))
    depth, radii = np.where(fits, depth, shallow), np.where(fits, radii, shallow * cosine)
    centers, features = place - (depth * sign)[:, None] * middle, np.stack([source, source], axis=1)
    status, angles = np.full(len(face), BallStatus.OK), 2.0 * np.arccos(cosine)
    touching = centers, radii, features, source, status, angles, sign, face, weights
    balls = MedialCloud(*touching, surface=surface)
    return balls.subset(fits | (part > 0))  # the sample itself has the small one


def _depth(cloud: MedialCloud, tolerance: float) -> float:
    return max(tolerance, CREASE_DEPTH) * cloud.surface.diagonal


def _on_edges(
    cloud: MedialCloud, creases: Creases, sign: int
) -> tuple[Index, Index, NDArray[np.int8], FloatArray]:
    """Return half-edges of creases convex on a side, their twins, the side, and shares of them."""
    surface = cloud.surface
    mine = cloud.valid & (cloud.side == sign) & (cloud.features[:, 0] == cloud.features[:, 1])
    has_ball = np.zeros(surface.point_count, np.bool_)
    has_ball[cloud.source[mine]] = True
    first, second = creases.half_edges[creases.inward == (sign < 0)].T
    corners = np.asarray(surface.faces)
    start, end = corners[first // 3, first % 3], corners[first // 3, (first + 1) % 3]
    both = has_ball[start] & has_ball[end]
    first, second, start, end = first[both], second[both], start[both], end[both]
    length = np.linalg.norm(surface.points[end] - surface.points[start], axis=1)
    count = np.ceil(length / (2 * LARGEST_GAP * surface.diagonal)).astype(np.int64)
    count = np.where(count > 1, np.minimum(count, 1 + MOST_BETWEEN), 0)
    edge = np.repeat(np.arange(len(first)), count)
    turn = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
    part = turn / count[edge]
    return first[edge], second[edge], np.full(len(edge), sign, np.int8), part
