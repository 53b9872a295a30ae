"""Sheets of a fine complex that change its envelope little are taken away, as wholes.

Sheets go as long as no sample of the surface is farther than a bound from the balls of those that
stay, the largest ones: so of what sticks out only where others do so too, nothing is left. They are
taken from their free rims by elementary collapses, so the topology stays; where others are one
sheet then, they are looked at again.

Of a fitted mesh parts go one by one (`trimmed`): a triangle with a free side goes with that side,
an edge with a free end with its ball, as long as nothing that is gone sticks out of what stays by
more than a bound.

Of shapes that are nearly balls most balls are of no use either. All lie in one place, and nearly
all of the surface is as far from each: they would take long to fit, to follow the mesh's triangles.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from itertools import combinations
from typing import NamedTuple

import numpy as np

from medialis.base.arrays import Index, Mask, Ragged, kd_tree
from medialis.base.box_tree import NearestTree
from medialis.base.validation import FloatArray
from medialis.medial_meshes.distances import points_on
from medialis.medial_meshes.envelope import Envelope
from medialis.medial_meshes.fine_complex import FineComplex
from medialis.medial_meshes.mesh import Complex, sheets_of
from medialis.medial_meshes.sampling import Solid

AT_ONCE = 0.5
"""Share of the size of the largest sheet from which on sheets come back in the same step."""

CREASED = math.cos(math.radians(40.0))
"""Cosine of the turn across an edge of the mesh from which on sheets end there."""

TOUCHES, NEAR_SAMPLES = 1.3, 3.0
"""How many times its radius, and how many spacings, a ball that ends at an edge is from its faces
and as large, at most."""

ROUNDED = 9
"""Digits of places that tell whether they are the same."""

ROUNDS = 8
"""In which fins are sought, at most: each makes sheets that were cut by fins one."""


ROUND = 0.02
"""Diagonals: nearly a ball is what fits between two balls round one place that differ by less."""

NO_MATTER = 1e-3
"""Diagonals: errors that nobody sees; more balls are not tried."""

LOWERED, STUCK = 0.75, 2
"""Twice as many balls, this often, have to lower the error below this share of it."""


Part = tuple[int, ...]

ACROSS = 5
"""Points along the longest side of what is taken away, or its largest radius, about."""


def finless(fine: FineComplex, bound: float) -> FineComplex:
    """Return a fine complex without fins; candidates belong to the ball next to them then."""
    chosen = fine.samples.chosen
    touched = Touched(fine.samples.points[chosen], fine.pole[chosen])
    now, place = without_fins(Complex(fine.balls, fine.edges, fine.faces), touched, bound)
    pole = place[fine.pole]
    lost = np.flatnonzero(pole < 0)
    if len(lost):
        tree = NearestTree.of_balls(now.balls[:, :3], now.balls[:, 3])
        pole[lost] = tree.distances(fine.samples.points[lost])[1]
    return FineComplex(now.balls, now.edges, now.faces, fine.samples, pole, fine.betti)


class Planes(NamedTuple):
    """Planes that balls touch: the ball of each (p,), a place on it and its normal, (p, 3)."""

    ball: Index
    feet: FloatArray
    normals: FloatArray


def creased(fine: FineComplex, solid: Solid) -> tuple[FineComplex, Planes]:
    """Return a complex whose rims reach the sharp edges and corners of the mesh, with radius 0.

    Samples leave a rim a spacing short of them. Only places change: those of balls on a rim that
    touch both faces of an edge. Their planes are returned too.
    """
    ends, normals = _creases(solid, outward=True)
    none = Planes(np.empty(0, np.int64), np.empty((0, 3)), np.empty((0, 3)))
    if len(ends) == 0:
        return fine, none
    rim = _rim(fine)
    balls = fine.balls.copy()
    crease, foot = _nearest_on(ends, balls[rim, :3], fine.samples.spacing)
    lean = np.sqrt(
        np.maximum(0.5 * (1 + np.einsum("ij,ij->i", *normals[crease].swapaxes(0, 1))), 0)
    )
    far = np.linalg.norm(foot - balls[rim, :3], axis=1) * lean
    radii = balls[rim, 3]
    reaches = (far < TOUCHES * radii) & (radii < NEAR_SAMPLES * fine.samples.spacing)
    rim, crease, foot = rim[reaches], crease[reaches], foot[reaches]
    if len(rim) == 0:
        return fine, none
    ball = np.repeat(rim, 2)
    facing = normals[crease].reshape(-1, 3)
    corners, uses = np.unique(ends.reshape(-1, 3), axis=0, return_counts=True)
    balls[rim] = np.column_stack([foot, np.zeros(len(rim))])
    away, near = kd_tree(foot).query(corners)
    for k in np.flatnonzero((uses > 2) & (away < NEAR_SAMPLES * fine.samples.spacing)):
        balls[rim[near[k]], :3] = corners[k]
        around = (ends == corners[k]).all(axis=2).any(axis=1)
        own = normals[around].reshape(-1, 3)
        ball = np.append(ball, np.full(len(own), rim[near[k]]))
        facing = np.concatenate([facing, own])
    found = FineComplex(balls, fine.edges, fine.faces, fine.samples, fine.pole, fine.betti)
    return found, Planes(ball, balls[ball, :3], facing)


def on_reflex_edges(solid: Solid, spacing: float) -> tuple[FloatArray, FloatArray]:
    """Return places on the sharp edges that go inwards, and normals there, (q, 3) each.

    Without samples on them balls beside stick out between those of the faces.
    """
    ends, normals = _creases(solid, outward=False)
    if len(ends) == 0:
        return np.empty((0, 3)), np.empty((0, 3))
    row, share = _along(ends, spacing)
    middle = normals.sum(axis=1)
    middle /= np.maximum(np.linalg.norm(middle, axis=1), 1e-300)[:, None]
    places = (1 - share) * ends[row, 0] + share * ends[row, 1]
    places, first = np.unique(np.round(places, ROUNDED), axis=0, return_index=True)
    return places, middle[row[first]]


def _creases(solid: Solid, *, outward: bool) -> tuple[FloatArray, FloatArray]:
    """Return the ends (e, 2, 3) of edges that stick out, or go in, and normals (e, 2, 3) there."""
    surface, points, faces = solid.surface, solid.points, solid.faces
    first, second, _ = surface.edge_table.pairs
    a, b = first // 3, second // 3
    normals = np.stack([surface.face_normals[a], surface.face_normals[b]], axis=1)
    far = points[faces[b, (second + 2) % 3]] - points[faces[a, 0]]
    out = np.einsum("ij,ij->i", far, normals[:, 0]) < 0
    sharp = (out == outward) & (np.einsum("ij,ij->i", normals[:, 0], normals[:, 1]) < CREASED)
    rows = np.stack([faces[a, first % 3], faces[a, (first + 1) % 3]], axis=1)[sharp]
    return points[rows], normals[sharp]


def _rim(fine: FineComplex) -> Index:
    """Return the vertices on free sides of triangles, and free ends of edges."""
    count = len(fine.balls)
    sides = np.sort(fine.faces[:, [[0, 1], [0, 2], [1, 2]]].reshape(-1, 2), axis=1)
    keys, uses = np.unique(sides @ [count, 1], return_counts=True)
    free = keys[uses == 1]
    ends = np.flatnonzero(np.bincount(fine.edges.ravel(), minlength=count) == 1)
    return np.unique(np.concatenate([free // count, free % count, ends]))


def _nearest_on(ends: FloatArray, places: FloatArray, step: float) -> tuple[Index, FloatArray]:
    """Return the segment (e, 2, 3) next to each place, about, and the place on it that is."""
    way = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(way, axis=1)
    row, share = _along(ends, step)
    near = row[kd_tree(ends[row, 0] + share * way[row]).query(places)[1]]
    along = np.einsum("ij,ij->i", places - ends[near, 0], way[near])
    along = np.clip(along / np.maximum(length[near] ** 2, 1e-300), 0.0, 1.0)
    return near, ends[near, 0] + along[:, None] * way[near]


def _along(ends: FloatArray, step: float) -> tuple[Index, FloatArray]:
    """Return the segment of each of some places at steps along it, and how far along, (q, 1)."""
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    pieces = np.ceil(length / step).astype(np.int64) + 1
    row = np.repeat(np.arange(len(ends)), pieces)
    number = np.arange(len(row)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    return row, (number / np.maximum(pieces - 1, 1)[row])[:, None]


class Touched(NamedTuple):
    """Places of a surface (q, 3), and the ball that touches each, (q,)."""

    places: FloatArray
    ball: Index


def without_fins(given: Complex, touched: Touched, bound: float) -> tuple[Complex, Index]:
    """Return a complex without fins, and the row of each vertex in it, -1 where it is gone.

    No place is farther than `bound` from the balls that stay.
    """
    place = np.arange(len(given))
    now = Complex(given.balls, np.sort(given.edges, axis=1), np.sort(given.faces, axis=1))
    for _ in range(ROUNDS):
        low = _low_sheets(now, touched, bound)
        if not low.any():
            break
        vertices, edges, faces = taken(now, low)
        if vertices.all() and edges.all():
            break
        number = np.where(vertices, np.cumsum(vertices) - 1, -1)
        now = Complex(now.balls[vertices], number[now.edges[edges]], number[now.faces[faces]])
        place = np.where(place >= 0, number[place], -1)
        ball = number[touched.ball]
        if len(lost := np.flatnonzero(ball < 0)):
            tree = NearestTree.of_balls(now.balls[:, :3], now.balls[:, 3])
            ball[lost] = tree.distances(touched.places[lost])[1]
        touched = touched._replace(ball=ball)
    return now, place


def _low_sheets(now: Complex, touched: Touched, bound: float) -> Mask:
    """Tell which triangles belong to sheets that others stand for, (f,).

    The largest one stays; the others come back, large ones first, until all places are within the
    bound of the balls that stay: a small one may have no place then that others do not stand for.
    """
    sheet = sheets_of(now.balls[:, :3], now.faces).of_faces
    count = int(sheet.max(initial=-1)) + 1
    if count == 0:
        return np.zeros(0, bool)
    size = np.bincount(sheet, minlength=count)
    stays = np.arange(count) == size.argmax()
    of_ball = np.full(len(now), -1)
    np.maximum.at(of_ball, now.faces.ravel(), np.repeat(sheet, 3))
    here = np.zeros(len(now), bool)
    added = of_ball < 0
    far = np.full(len(touched.places), np.inf)
    while True:
        added[now.faces[stays[sheet]]] = True
        added &= ~here
        here |= added
        balls = now.balls[added]
        if len(balls):
            tree = NearestTree.of_balls(balls[:, :3], balls[:, 3])
            rest = np.flatnonzero(far > bound)
            far[rest] = np.minimum(far[rest], tree.distances(touched.places[rest])[0])
        far[here[touched.ball]] = 0.0
        worst = np.zeros(count + 1)
        np.maximum.at(worst, of_ball[touched.ball], far)
        back = (worst[:count] > bound) & ~stays
        if not back.any():
            break
        stays |= back & (size >= AT_ONCE * size[back].max())
        added = np.zeros(len(now), bool)
    return ~stays[sheet]


def taken(now: Complex, low: Mask) -> tuple[Mask, Mask, Mask]:
    """Collapse triangles from free rims, and edges that they leave; tell what stays."""
    from medialis.medial_meshes._complex_kernels import Dual, Live, prune

    count = len(now)
    keys = now.edges @ np.array([count, 1])
    order = np.argsort(keys, kind="stable")
    sides = np.stack(
        [
            order[np.searchsorted(keys, now.faces[:, pair] @ [count, 1], sorter=order)]
            for pair in ([0, 1], [0, 2], [1, 2])
        ],
        axis=1,
    ).astype(np.int64)
    edges = np.full((len(now.edges), 5), -1)
    edges[:, :2] = now.edges
    by_vertex = Ragged.group(now.edges.ravel(), count)
    items = np.asarray(by_vertex.indices, np.int64) // 2
    loose = np.ones(len(edges))
    loose[sides[low].ravel()] = 0.0
    live = Live(*(np.ones(n, bool) for n in (count, len(edges), len(sides))))
    dual = Dual(edges, np.ascontiguousarray(sides), by_vertex.offsets, items)
    prune(dual, loose, np.where(low, 0.0, 1.0), 0.5, live)
    return live.vertices, live.edges, live.faces


def is_round(solid: Solid, fine: FineComplex) -> bool:
    """Tell whether a solid is nearly a ball."""
    if fine.betti != (1, 0, 0):
        return False
    largest = fine.balls[fine.balls[:, 3].argmax()]
    far = np.linalg.norm(solid.points[solid.corners] - largest[:3], axis=1).max()
    return bool(far - largest[3] < ROUND)


def useful(
    fitted: Callable[[int], Complex], error: Callable[[Complex], float], most: int
) -> Complex | None:
    """Return the mesh of as many balls as are useful; None where all of `most` may be."""
    found, errors = [fitted(1)], [np.inf]
    errors[0] = error(found[0])
    while errors[-1] > NO_MATTER:
        if len(errors) > STUCK and errors[-1] > LOWERED * errors[-1 - STUCK]:
            break
        wanted = 1 << len(found)
        if wanted >= most:
            return None
        found.append(fitted(wanted))
        errors.append(error(found[-1]))
    first = next(k for k, one in enumerate(errors) if LOWERED * one <= min(errors))
    return found[first] if len(found[first]) < most else None


def trimmed(given: Complex, bound: float) -> Complex:
    """Return a complex without the parts at its rims that change its envelope by at most `bound`.

    Balls that no other part needs go, too; the others keep their order.
    """
    rest = _Rest(given, bound)
    while sum(rest.without(side, part) for side, part in rest.free()):
        pass
    return rest.complex


def _sides(part: Part) -> list[Part]:
    return list(combinations(part, len(part) - 1)) if len(part) > 1 else []


class _Rest:
    """What stays of a complex, and points on what was taken away."""

    def __init__(self, given: Complex, bound: float) -> None:
        self.balls, self.bound, self.gone = given.balls, bound, np.empty((0, 3))
        self.parts: set[Part] = {(v,) for v in range(len(given))}
        for rows in (given.edges, given.faces):
            self.parts |= {tuple(row) for row in np.sort(rows, axis=1).tolist()}
        self.above = Counter(side for part in self.parts for side in _sides(part))
        self._refused: set[tuple[Part, Part]] = set()

    def free(self) -> list[tuple[Part, Part]]:
        """Return free sides with their triangles, free ends with their edges; small ones first."""
        found = [
            (side, part)
            for part in self.parts
            for side in _sides(part)
            if self._goes(side, part) and (side, part) not in self._refused
        ]
        return sorted(found, key=lambda pair: (self._length(pair[1]), pair))

    def without(self, side: Part, part: Part) -> bool:
        """Take a part and a free side of it away, where that changes little; tell whether."""
        if not self._goes(side, part):
            return False
        self._take(side, part, -1)
        tops = [one for one in self.parts if not self.above[one]]
        rest = Envelope(self.balls, np.array([(*one, -1, -1)[:3] for one in sorted(tops)]))
        points = self._points(part)
        if self._holds(rest, points) and self._holds(rest, self.gone):
            out = rest.distances(points)[0]
            self.gone = np.concatenate([self.gone, points[out > -self.bound]])
            return True
        self._take(side, part, 1)
        self._refused.add((side, part))
        return False

    def _holds(self, rest: Envelope, points: FloatArray) -> bool:
        """Tell whether places that were taken away are all near enough to some part of the rest."""
        return bool((rest.distances(points, enough=self.bound)[0] < self.bound).all())

    @property
    def complex(self) -> Complex:
        """What stays."""
        own = [sorted(one for one in self.parts if len(one) == size) for size in (1, 2, 3)]
        balls, edges, faces = (
            np.array(rows, np.int64).reshape(-1, size + 1) for size, rows in enumerate(own)
        )
        number = np.full(len(self.balls), -1)
        number[balls[:, 0]] = np.arange(len(balls))
        return Complex(self.balls[balls[:, 0]], number[edges], number[faces])

    def _goes(self, side: Part, part: Part) -> bool:
        """Tell whether a part is there, a side of no other, and one of its sides only its own."""
        return part in self.parts and not self.above[part] and self.above[side] == 1

    def _take(self, side: Part, part: Part, change: int) -> None:
        """Take two parts away, or put them back."""
        for one in (part, side):
            (self.parts.discard if change < 0 else self.parts.add)(one)
            for below in _sides(one):
                self.above[below] += change

    def _length(self, part: Part) -> float:
        """Return the longest side."""
        places = self.balls[list(part), :3]
        return float(np.linalg.norm(places - np.roll(places, 1, axis=0), axis=1).max())

    def _points(self, part: Part) -> FloatArray:
        """Return points on the balls, cones and slab of a part."""
        rows = np.arange(len(part), dtype=np.int64)
        edges = np.array(list(combinations(rows, 2)), np.int64)
        faces = rows[None] if len(part) == 3 else np.empty((0, 3), np.int64)
        balls = self.balls[list(part)]
        step = max(self._length(part), float(balls[:, 3].max())) / ACROSS
        return points_on((balls, edges, faces), step)
