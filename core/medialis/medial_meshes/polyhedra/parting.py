"""The medial axis of a polyhedron that is not convex, as balls on its sheets, seams and junctions.

1. `_parted`: the Voronoi cells of samples are put together by walls (`Facets`). What parts two of
   them stays of the fine complex, everything else collapses: so its topology is right, and sheets,
   seams and junctions are those of the walls, but for what is smaller than the samples are apart.
2. Balls are placed exactly; rims go to the edges and corners of the solid.
3. Where more walls meet at a seam than must, as on the axis of a square bar, samples part some of
   them by ribbons: these are flat on the seam then, and are contracted.
4. `Structure.mesh`: merged along what balls belong to, to any number, and placed again.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from medialis.base.arrays import Index, Mask, Ragged, polylines
from medialis.base.box_tree import NearestTree
from medialis.base.errors import InvalidShapeError
from medialis.base.validation import FloatArray
from medialis.medial_meshes.collapsing import collapse, planes_of
from medialis.medial_meshes.fine_complex import Cells, FineComplex, dual_of, opened
from medialis.medial_meshes.fins import on_reflex_edges
from medialis.medial_meshes.mesh import Collapse, Complex, betti_numbers, sheets_of
from medialis.medial_meshes.polyhedra.walls import OUT, Facets
from medialis.medial_meshes.sampling import Samples, Solid, take_samples
from medialis.shape.surface import piece_labels

SAMPLES, SEEDS = 5000, 3
"""Samples, and how many draws of them are tried."""

MOST_FACES, MOST_CORNERS = 60, 1000
"""Of a polyhedron: bodies of more flat faces are mostly coarse meshes of what is round."""

SMALL, HANGING = 3.0, 3.0
"""Spacings: pieces of sheets at a rim that are no larger were cut off by a corner; so were those up
to so many times as large that hang at the rest."""

NO_LENGTH = 1e-4
"""Diagonals: ends of a seam that is no longer are one junction."""

ROUNDS = 8
"""In which edges are contracted that would join different sheets, at most."""

PASSES = 40
"""In which ribbons are contracted, at most."""

HALVINGS, BENT = 6, 1e-4
"""How often edges are halved, and from which distance to the solid on, in diagonals."""

HOLD = 1e-4
"""Weight of staying in place when balls are merged, against the planes that they touch. A T of 100
balls is off by 0.37 % with it, by 0.75 with ten times as much; with a tenth it is 0.19 %, but
triangles have a quality of 0.47 in the mean instead of 0.59."""


SIDES = np.array([[0, 1], [0, 2], [1, 2]])
"""Corners of a triangle at the ends of its sides."""


def _sides(faces: Index) -> Index:
    """Return the ends of all sides of triangles, (3 f, 2), ascending."""
    return np.asarray(np.sort(faces[:, SIDES].reshape(-1, 2), axis=1))


@dataclass(frozen=True, eq=False)
class _Parted:
    """Balls (v, 4), edges and triangles between them.

    Attributes
    ----------
    touched : (v, k) bool
        The faces that each ball touches.
    pair : (f, 2) int64
        The two faces that each triangle parts.
    """

    balls: FloatArray
    edges: Index
    faces: Index
    touched: Mask
    pair: Index

    def merged(self, links: Index) -> _Parted:
        """Return it with linked balls as one: of most faces, at a corner, or the largest."""
        label = piece_labels(len(self.balls), links).astype(np.int64)
        count = int(label.max()) + 1
        radii = self.balls[:, 3]
        order = np.lexsort([radii, radii == 0.0, self.touched.sum(axis=1)])
        chosen = np.empty(count, np.int64)
        chosen[label[order]] = order
        touched = np.zeros((count, self.touched.shape[1]), bool)
        np.logical_or.at(touched, label, self.touched)
        rows = np.sort(label[self.faces], axis=1)
        proper = (np.diff(rows, axis=1) > 0).all(axis=1)
        faces, first = np.unique(rows[proper], axis=0, return_index=True)
        edges = np.sort(label[self.edges], axis=1)
        edges = np.unique(edges[edges[:, 0] < edges[:, 1]], axis=0)
        return _Parted(self.balls[chosen], edges, faces, touched, self.pair[proper][first])

    @property
    def sides(self) -> tuple[Index, Index, Index]:
        """Return the sides of triangles by their ends: an order, where each begins, how many."""
        keys = _sides(self.faces) @ [len(self.balls), 1]
        order = np.argsort(keys, kind="stable")
        _, starts, counts = np.unique(keys[order], return_index=True, return_counts=True)
        return order, starts, counts

    def ends_of(self, sides: Index) -> Index:
        """Return the ends of sides of triangles, (s, 2)."""
        columns = SIDES[sides % 3]
        return np.asarray(self.faces[sides[:, None] // 3, columns])


@dataclass(frozen=True, eq=False)
class Structure:
    """The medial axis of a polyhedron as many balls, and the sequence that merges them."""

    facets: Facets
    touched: Mask
    sequence: Collapse
    sheets: int
    samples: Samples
    _made: dict[int, Complex | None] = field(default_factory=dict)

    def mesh(self, count: int) -> Complex | None:
        """Return it as `count` balls, placed once; None where these are too few for its sheets."""
        if count not in self._made:
            self._made[count] = self._merged(count)
        return self._made[count]

    def _merged(self, count: int) -> Complex | None:
        given, place = self.sequence.level(count)
        rim, walls = _rim(given), self.facets.count_walls(self.touched)
        order = np.lexsort([np.arange(len(place)), walls])  # the one of most walls is the last
        chosen = np.empty(len(given), np.int64)
        chosen[place[order]] = order
        touched = self.touched[chosen]
        if len(given) > count or _number(given) != self.sheets:
            return None
        return self._exact(given, touched, rim)

    @property
    def fine(self) -> FineComplex:
        """All of its balls, as the complex of its samples."""
        start, samples = self.sequence.start, self.samples
        tree = NearestTree.of_balls(start.balls[:, :3], start.balls[:, 3])
        pole = tree.distances(samples.points)[1].astype(np.int64)
        return FineComplex(start.balls, start.edges, start.faces, samples, pole, (1, 0, 0))

    def _exact(self, given: Complex, touched: Mask, rim: Mask) -> Complex:
        balls = given.balls.copy()
        inner = np.flatnonzero(~rim)
        balls[inner] = self.facets.placed(balls[inner, :3], touched[inner], mended=1)[0]
        balls[rim, :3] = self.facets.on_rim(balls[rim, :3], touched[rim])[0]
        balls[rim, 3] = 0.0
        return replace(given, balls=balls)


def facets_to_part(solid: Solid) -> Facets | None:
    """Return the faces of a polyhedron without handles that is not convex; None for others.

    None also for those of more than 60 faces, or of more than 1,000 corners.
    """
    facets = Facets.of(solid)
    if facets is None or not facets.reflex.any() or solid.betti != (1, 0, 0):
        return None
    few = len(facets) <= MOST_FACES and len(facets.corners[0]) <= MOST_CORNERS
    return facets if few else None


def structure_of(solid: Solid, facets: Facets, seed: int) -> Structure | None:
    """Return the medial axis of the polyhedron of `facets_to_part`; None where it is not found."""
    for draw in range(SEEDS):
        samples = take_samples(solid, SAMPLES, seed + 1000 * draw)
        samples = samples.with_more(*on_reflex_edges(solid, samples.spacing))
        try:
            found = _structure(solid, facets, Cells.of(solid, samples))
        except InvalidShapeError:
            return None
        if found is not None:
            return found
    return None


def _structure(solid: Solid, facets: Facets, cells: Cells) -> Structure | None:
    now = _parted(cells, facets)
    if now is None:
        return None
    now = _mended(now, facets)
    centers, spacing = now.balls[:, :3], cells.samples.spacing
    rim = _rim(now)
    inner = np.flatnonzero(~rim)
    balls, touched = now.balls.copy(), now.touched.copy()
    balls[inner], touched[inner] = facets.placed(centers[inner], touched[inner])
    touched[inner] |= facets.distances(balls[inner, :3]) < balls[inner, 3:] + OUT
    places, touched[rim] = facets.on_rim(centers[rim], touched[rim])
    if (np.linalg.norm(places - centers[rim], axis=1) > 2 * SMALL * spacing).any():
        return None
    balls[rim] = np.column_stack([places, np.zeros(len(places))])
    now = replace(now, balls=balls, touched=touched)
    now = _without_ribbons(now, facets)
    now = _without_crumbs(_mended(now, facets), facets, SMALL * spacing)
    if len(_wrong_edges(now, facets)):
        return None
    pure = _only_sheets(now)
    if pure is None:
        return None
    now = _bent(pure, facets)
    start = Complex(now.balls, now.edges, now.faces)
    if betti_numbers(len(now.balls), now.edges, now.faces) != (1, 0, 0):
        return None
    sequence = collapse(start, _quadrics(now, facets), 1, whole=True)
    return Structure(facets, now.touched, sequence, _number(start), cells.samples)


def _parted(cells: Cells, facets: Facets) -> _Parted | None:
    """Keep of the dual of inside cells what parts walls; None where more stays."""
    from medialis.medial_meshes._complex_kernels import Dual, Live, prune, sides_of

    samples, inside = cells.samples, cells.inside
    label = facets.distances(samples.points[cells.chosen]).argmin(axis=1)
    count = int(inside.sum())
    number = np.where(inside, np.cumsum(inside) - 1, -1)
    edges, faces = dual_of(cells.corners, cells.neighbours, number)
    faces = opened(faces, cells.proper, facets.smooth[tuple(label[faces[:, 3:]].T)])
    pair, three = label[faces[:, 3:]], label[edges[:, 2:]]
    parts = ~facets.smooth[tuple(pair.T)]
    carries = ~facets.smooth[three, np.roll(three, 1, axis=1)].all(axis=1)
    by_vertex = Ragged.group(edges[:, :2].ravel(), count)
    items = np.asarray(by_vertex.indices, np.int64) // 2
    sides = np.zeros((len(faces), 3), np.int64)
    sides_of(faces, edges, by_vertex.offsets, items, sides)
    live = Live(*(np.ones(n, bool) for n in (count, len(edges), len(faces))))
    dual = Dual(edges, sides, by_vertex.offsets, items)
    prune(dual, carries.astype(np.float64), parts.astype(np.float64), 0.5, live)
    if not (parts | ~live.faces).all():
        return None
    rows = np.flatnonzero(inside)[live.vertices]
    place = np.cumsum(live.vertices) - 1
    touched = np.zeros((len(rows), len(facets)), bool)
    for corner in label[cells.corners[rows]].T:
        touched[np.arange(len(rows)), corner] = True
    balls = np.column_stack([cells.centers[rows], cells.radii[rows]])
    kept = place[edges[live.edges, :2]], place[faces[live.faces, :3]]
    return _Parted(balls, *kept, touched, pair[live.faces])


def _mended(now: _Parted, facets: Facets) -> _Parted:
    """Contract edges whose triangles are neither two of one sheet nor one of each of some."""
    for _ in range(ROUNDS):
        wrong = _wrong_edges(now, facets)
        if len(wrong) == 0:
            break
        now = now.merged(wrong)
    return now


def _wrong_edges(now: _Parted, facets: Facets) -> Index:
    """Return edges (q, 2) of two triangles of different sheets, or of more where two are alike.

    Where three sheets meet at a corner of the solid, the third is missing beyond the last samples.
    """
    order, starts, counts = now.sides
    wrong = np.zeros(len(starts), bool)
    for first in range(int(counts.max(initial=1)) - 1):
        for second in range(first + 1, int(counts.max())):
            rows = np.flatnonzero(counts > second)
            a, b = (now.pair[order[starts[rows] + k] // 3] for k in (first, second))
            wrong[rows] |= facets.alike(a, b) != (counts[rows] == 2)
    return now.ends_of(order[starts[wrong]])


def _rim(now: _Parted | Complex) -> Mask:
    """Tell which vertices lie on free sides of triangles, (v,)."""
    count = len(now.balls)
    keys, uses = np.unique(_sides(now.faces) @ [count, 1], return_counts=True)
    free = keys[uses == 1]
    result = np.zeros(count, bool)
    result[free // count] = result[free % count] = True
    return result


def _number(now: Complex) -> int:
    return int(sheets_of(now.balls[:, :3], now.faces).of_faces.max(initial=-1)) + 1


def _without_ribbons(now: _Parted, facets: Facets) -> _Parted:
    """Contract triangles whose balls all touch the same three walls: they are flat on a seam."""
    for _ in range(PASSES):
        common = np.asarray(now.touched[now.faces].all(axis=1))
        flat = np.flatnonzero(facets.count_walls(common) > 2)
        if len(flat) == 0:
            break
        corners = now.balls[now.faces[flat], :3]
        lengths = np.linalg.norm(corners[:, [0, 0, 1]] - corners[:, [1, 2, 2]], axis=2)
        short = lengths.argmin(axis=1)
        ends = now.ends_of(3 * flat + short)
        free = np.ones(len(now.balls), bool)
        links = []
        for i in np.argsort(lengths.min(axis=1), kind="stable"):
            if free[ends[i]].all():
                free[ends[i]] = False
                links.append(ends[i])
        now = now.merged(np.array(links))
    return now


def _without_crumbs(now: _Parted, facets: Facets, small: float) -> _Parted:
    """Contract small pieces at a rim, which has no small sheets, and seams without a length.

    Also pieces that are not as small, where a larger one of the same walls has a ball of theirs.
    """
    found = sheets_of(now.balls[:, :3], now.faces)
    size = np.bincount(found.of_faces)
    corner, owner = now.faces.ravel(), np.repeat(found.of_faces, 3)
    order = np.argsort(owner, kind="stable")
    starts = np.concatenate([[0], np.cumsum(3 * size)])
    pieces = [np.unique(corner[order[i:j]]) for i, j in pairwise(starts.tolist())]
    crumbs = []
    for k, one in enumerate(pieces):
        length = np.linalg.norm(np.ptp(now.balls[one, :3], axis=0))
        if length < small and (now.balls[one, 3] == 0.0).any():
            crumbs.append(one)
        elif length < HANGING * small:
            beside = np.isin(corner, one) & (size[owner] > size[k])
            near = now.pair[np.flatnonzero(beside) // 3]
            own = now.pair[np.flatnonzero(found.of_faces == k)[:1]]
            if facets.alike(np.repeat(own, len(near), axis=0), near).any():
                crumbs.append(one)
    seams = polylines(found.seams, len(now.balls))
    short = [one for one in seams if np.ptp(now.balls[one, :3], axis=0).max() < NO_LENGTH]
    crumbs += [one.astype(np.int64) for one in short]
    links = [np.stack([one[1:], np.full(len(one) - 1, one[0])], axis=1) for one in crumbs]
    return now.merged(np.concatenate(links)) if links else now


def _only_sheets(now: _Parted) -> _Parted | None:
    """Take away edges that lead nowhere; None where others belong to no triangle."""
    order, starts, _ = now.sides
    edges = now.ends_of(order[starts])
    used = np.zeros(len(now.balls), bool)
    used[now.faces] = True
    bare = now.edges[~np.isin(now.edges @ [len(used), 1], edges @ [len(used), 1])]
    if len(np.unique(piece_labels(len(used), bare)[used])) < used.sum():
        return None
    number = np.cumsum(used) - 1
    return _Parted(now.balls[used], number[edges], number[now.faces], now.touched[used], now.pair)


def _bent(now: _Parted, facets: Facets) -> _Parted:
    """Halve edges in whose middle a straight one is not tangent to the solid: parabolic sheets."""
    for _ in range(HALVINGS):
        count = len(now.balls)
        order, starts, counts = now.sides
        ends = now.ends_of(order[starts])
        middle = now.balls[ends].mean(axis=1)
        which = np.empty(len(order), np.int64)
        which[order] = np.repeat(np.arange(len(starts)), counts)
        own = np.zeros((len(starts), len(facets)), bool)
        for column in now.pair.T:
            own[which, np.repeat(column, 3)] = True
        far = np.stack([facets.nearest(middle[:, :3], k)[0] for k in range(len(facets))], axis=1)
        split = np.flatnonzero(np.abs(far.min(axis=1) - middle[:, 3]) > BENT)
        if len(split) == 0:
            break
        new = np.full(len(starts), -1)
        new[split] = count + np.arange(len(split))
        placed, touched = facets.placed(middle[split, :3], own[split])
        touched |= facets.distances(placed[:, :3]) < placed[:, 3:] + OUT
        faces, pair = _cut(now.faces, now.pair, new[which.reshape(-1, 3)])
        now = _Parted(
            np.concatenate([now.balls, placed]), np.unique(_sides(faces), axis=0), faces,
            np.concatenate([now.touched, touched]), pair,
        )  # fmt: skip
    return now


def _cut(faces: Index, pair: Index, new: Index) -> tuple[Index, Index]:
    """Cut triangles at new vertices on their sides 01, 02, 12 (-1 for none)."""
    rows = [(faces[(new < 0).all(axis=1)], pair[(new < 0).all(axis=1)])]
    for turn in range(3):  # a is across from the side that is cut alone, or not cut alone
        a, b, c = (np.roll([0, 1, 2], -turn)[k] for k in range(3))
        side = {frozenset((0, 1)): 0, frozenset((0, 2)): 1, frozenset((1, 2)): 2}
        ab, ac, bc = (side[frozenset(one)] for one in ((a, b), (a, c), (b, c)))
        one = (new[:, bc] >= 0) & (new[:, ab] < 0) & (new[:, ac] < 0)
        two = (new[:, bc] < 0) & (new[:, ab] >= 0) & (new[:, ac] >= 0)
        f, n, p = faces[one], new[one], pair[one]
        rows += [(np.stack(x, axis=1), p) for x in (
            (f[:, a], f[:, b], n[:, bc]), (f[:, a], n[:, bc], f[:, c]))]  # fmt: skip
        f, n, p = faces[two], new[two], pair[two]
        rows += [(np.stack(x, axis=1), p) for x in (
            (f[:, a], n[:, ab], n[:, ac]), (n[:, ab], f[:, b], f[:, c]),
            (n[:, ab], f[:, c], n[:, ac]))]  # fmt: skip
    three = (new >= 0).all(axis=1)
    f, n, p = faces[three], new[three], pair[three]
    rows += [(np.stack(x, axis=1), p) for x in (
        (f[:, 0], n[:, 0], n[:, 1]), (n[:, 0], f[:, 1], n[:, 2]),
        (n[:, 1], n[:, 2], f[:, 2]), (n[:, 0], n[:, 2], n[:, 1]))]  # fmt: skip
    found = np.concatenate([one for one, _ in rows])
    return np.sort(found, axis=1), np.concatenate([one for _, one in rows])


def _quadrics(now: _Parted, facets: Facets) -> FloatArray:
    """Return the quadric of each ball: of the planes that it touches, (v, 15)."""
    corners = now.balls[now.faces, :3]
    areas = 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    own = np.bincount(now.faces.ravel(), np.repeat(areas, 3), len(now.balls)) / 3
    ball, face = (x.copy() for x in np.nonzero(now.touched))
    feet, normals = np.empty((len(ball), 3)), -facets.planes[face, :3]
    for k in range(len(facets)):
        rows = np.flatnonzero(face == k)
        far, feet[rows] = facets.nearest(now.balls[ball[rows], :3], k)
        off = rows[far > OUT]
        normals[off] = (feet[off] - now.balls[ball[off], :3]) / far[far > OUT, None]
    touching = np.bincount(ball, minlength=len(now.balls))
    given = Samples(feet, normals, (own / touching)[ball], ball, 0.0)
    return planes_of(given, now.balls, ball, hold=HOLD)
