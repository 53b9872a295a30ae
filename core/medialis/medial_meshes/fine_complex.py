"""The fine complex: circumcenters inside a solid, connected as the Voronoi cells of its samples.

1. `Cells`: the Delaunay tetrahedra of the samples, and which are inside.
2. `_build`: those whose circumcenters lie inside are the vertices, faces between two of them the
   edges, and Delaunay edges with inside tetrahedra all round the polygons. On a dense sampling the
   solid retracts onto that complex (duality), so its Betti numbers are right. Small bumps leave
   spikes, which are pruned.
3. `fine_complex`: more samples, other draws, until they are.
4. `grown`: if all that fails, the inside is chosen for its topology, whatever the samples are. From
   the deepest one on, inside tetrahedra join where the topology of the dual stays: one part without
   loops or hollows, up to seams where it meets itself. The seams that close the longest loops are
   then closed, as many as the solid has handles. What stays out are single tetrahedra at places
   where samples are too few, mostly along sharp edges.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from medialis.base.arrays import Index, Mask, Ragged, kd_tree
from medialis.base.errors import InvalidShapeError
from medialis.base.progress import Progress
from medialis.base.threads import run_patiently, run_together
from medialis.base.validation import FloatArray
from medialis.medial_meshes.mesh import betti_numbers
from medialis.medial_meshes.sampling import BESIDE, Samples, Solid, take_samples
from medialis.shape.surface import piece_labels

if TYPE_CHECKING:
    from medialis.medial_meshes._complex_kernels import Live


ATTEMPTS = (1.0, 1.0, 0.6, 1.7, 0.6)
"""Factors of the number of samples, each with its own draw, until the topology is right. Where
faces of a mesh meet at sharp angles, a draw fails as often as not, and denser ones do as well."""

MOST_TRIED = 16  # halved 0 %, doubled 0 %
"""Attempts end when their samples together are this many times those asked for."""

MENDED = 2  # halved 72 %, doubled 86 %
"""How often a complex is built from a draw, with samples added where it crosses the surface."""

FAR, NEAREST = 0.1, 1e-5  # halved 62 %, doubled 0 %; halved 0 %, doubled 0 %
"""Diagonals: larger balls are not looked at for crossings, nearer crossings are the same."""

FEWEST_SAMPLES, SPREAD = 200, 2.0  # halved 0 %, doubled 0 %; halved 0 %, doubled 0 %
"""Samples of a body, at least; but all together no more than so many times those asked for."""

SLIGHTLY = 1e-3  # halved 0 %, doubled 0 %
"""Share of hidden samples up to which bodies do not cross, but for rounding."""

LONGEST_RING = 4096  # halved 0 %, doubled 0 %
"""Tetrahedra round one edge; more than that are left without a polygon."""

INFINITE = 1e3  # halved 0 %, doubled 0 %
"""Diagonals: larger circumscribed balls are those of flat tetrahedra."""

PAIRS = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))

NEVER = 1 << 40
"""Tetrahedra that are missing round edges and samples on the hull."""


@dataclass(frozen=True, eq=False)
class Tetrahedra:
    """Delaunay tetrahedra.

    Attributes
    ----------
    corners, neighbours : (t, 4) int64
        Neighbour k is across from corner k, -1 for none.
    centers, radii : (t, 3), (t,) float64
    inside : (t,) bool
    """

    corners: Index
    neighbours: Index
    centers: FloatArray
    radii: FloatArray
    inside: Mask


@dataclass(frozen=True, eq=False)
class FineComplex:
    """A complex of balls with the topology of a solid, and the samples that it was made of.

    Attributes
    ----------
    balls : (v, 4) float64
        Center and radius.
    edges, faces : (e, 2), (f, 3) int64
    samples : Samples
    pole : (c,) int64
        For each candidate the largest ball at its sample.
    betti : (int, int, int)
    """

    balls: FloatArray
    edges: Index
    faces: Index
    samples: Samples
    pole: Index
    betti: tuple[int, int, int]

    @cached_property
    def _tree(self) -> Any:
        return kd_tree(self.balls[:, :3])

    def nearest(self, places: FloatArray) -> FloatArray:
        """Return the ball whose center is nearest to each place (q, 3), (q, 4)."""
        return self.balls[self._tree.query(places)[1]]


More = Callable[[Solid, float], tuple[FloatArray, FloatArray]]
"""What tells further samples of a body by their spacing: places and normals."""


def fine_complex(
    solid: Solid,
    count: int,
    relief: float,
    seed: int,
    progress: Progress,
    more: More | None = None,
) -> FineComplex:
    """Build the complex of about `count` samples; more come until its Betti numbers are right.

    They are added where an edge of it crosses the surface, then drawn anew. Bodies of a closed mesh
    have complexes of their own: gaps between them, and places where they cross, do not count.
    """
    bodies = solid.bodies
    areas = np.array([body.surface.area for body in bodies])
    least = min(FEWEST_SAMPLES, SPREAD * count / len(bodies))
    counts = np.maximum(count * areas / areas.sum(), least).astype(np.int64)
    found: list[FineComplex] = []
    for k, (body, number) in enumerate(zip(bodies, counts, strict=True)):
        with progress.stage("complex", k / len(bodies), (k + 1) / len(bodies)):
            try:
                found.append(_of_body(body, int(number), relief, seed, progress, more))
            except InvalidShapeError:
                if k == len(bodies) - 1 and not found:
                    raise
    if lost := len(bodies) - len(found):
        progress.warn(
            f"{lost:,} of {len(bodies):,} parts of the mesh have no balls: they enclose nothing, "
            "or are too small beside the size of the whole.",
            "parts_without_balls",
            lost=lost,
            parts=len(bodies),
        )
    best = found[0]
    if len(bodies) > 1:
        best, hidden = _joined(solid, found)
        if hidden > SLIGHTLY:
            progress.note(
                f"Parts of the mesh cross each other. {len(bodies)} parts have balls of their own, "
                "which no edge joins.",
                "parts_cross",
                parts=len(bodies),
            )
    _note_topology(best, solid.betti, progress)
    return best


def _of_body(
    solid: Solid, count: int, relief: float, seed: int, progress: Progress, more: More | None
) -> FineComplex:
    """Build the complex of one body: the best of some attempts."""
    found: list[FineComplex] = []
    for attempt, factor in enumerate(ATTEMPTS):
        if sum(len(one.samples.chosen) for one in found) * MENDED > MOST_TRIED * count:
            break
        samples = take_samples(solid, int(factor * count), seed + 1000 * attempt)
        if more is not None:
            samples = samples.with_more(*more(solid, samples.spacing))
        with progress.stage("complex", attempt / len(ATTEMPTS), (attempt + 1) / len(ATTEMPTS)):
            found.append(_mended(solid, samples, relief, progress))
        if solid.betti is None or found[-1].betti == solid.betti:
            break
    found = [one for one in found if len(one.balls)]
    if not found:
        raise InvalidShapeError(
            "No ball lies inside the shape: it is flat, or far too small beside its size and place."
        )
    return min(found, key=lambda one: _distance(one, solid.betti))


def _joined(solid: Solid, found: list[FineComplex]) -> tuple[FineComplex, float]:
    """Put the complexes of bodies together; samples that lie in other bodies are left out.

    Returns the share of those, too.
    """
    starts = np.cumsum([0] + [len(one.balls) for one in found])
    firsts = np.cumsum([0] + [len(one.samples.points) for one in found])
    points, normals, areas = (
        np.concatenate([getattr(one.samples, name) for one in found])
        for name in ("points", "normals", "areas")
    )
    owner = np.concatenate([one.samples.owner + n for one, n in zip(found, firsts, strict=False)])
    shown = ~solid.contains(points + BESIDE * normals)
    if not shown.any():
        shown[:] = True
    place = np.where(shown, np.cumsum(shown) - 1, -1)
    spacing = max(one.samples.spacing for one in found)
    samples = Samples(points[shown], normals[shown], areas[shown], place[owner[shown]], spacing)
    edges, faces, pole = (
        np.concatenate([getattr(one, name) + n for one, n in zip(found, starts, strict=False)])
        for name in ("edges", "faces", "pole")
    )
    parts, loops, hollows = (sum(one.betti[k] for one in found) for k in range(3))
    balls = np.concatenate([one.balls for one in found])
    joined = FineComplex(balls, edges, faces, samples, pole[shown], (parts, loops, hollows))
    return joined, float(1.0 - shown.mean())


def _mended(solid: Solid, samples: Samples, relief: float, progress: Progress) -> FineComplex:
    """Build the complex, with more samples where it crosses the surface; return the best one.

    Where that does not do, it is grown with the topology wanted.
    """
    found, wanted = [], solid.betti
    for step in range(MENDED):
        progress.update(step / MENDED)
        now = samples
        cells = run_patiently(lambda given=now: Cells.of(solid, given), progress)  # type: ignore[misc]
        found.append(_build(cells, relief))
        if wanted is None or found[-1].betti == wanted:
            break
        points, normals = cells.crossings(solid)
        if len(points) == 0:
            break
        samples = samples.with_more(points, normals)
    best = min(found, key=lambda one: _distance(one, wanted))
    if wanted is None or best.betti == wanted or wanted[::2] != (1, 0):
        return best
    other = _build(replace(cells, inside=grown(cells, wanted[1])), relief)
    return min(best, other, key=lambda one: _distance(one, wanted))


def _distance(found: FineComplex, wanted: tuple[int, int, int] | None) -> int:
    """How far the Betti numbers are from those wanted."""
    return (
        0 if wanted is None else sum(abs(a - b) for a, b in zip(found.betti, wanted, strict=True))
    )


def _note_topology(
    found: FineComplex, wanted: tuple[int, int, int] | None, progress: Progress
) -> None:
    """Say where the topology is a guess, and which number is wrong."""
    if wanted is None:
        progress.warn(
            "The mesh is open, crosses itself, or has faces that are turned over: what is inside, "
            "and so the topology, is a guess.",
            "inside_guessed",
        )
    elif found.betti != wanted:
        names = ("parts", "loops", "hollows")
        off = ", ".join(
            f"{a} {name} where the mesh has {b}"
            for name, a, b in zip(names, found.betti, wanted, strict=True)
            if a != b
        )
        progress.warn(
            f"The topology of the mesh was not reached: the fine mesh has {off}.",
            "topology_off",
            found=list(found.betti),
            wanted=list(wanted),
        )


@dataclass(frozen=True, eq=False)
class Cells(Tetrahedra):
    """Delaunay tetrahedra of the chosen samples, and which are inside.

    Attributes
    ----------
    samples : Samples
    chosen : (n,) int64
        Candidates that are vertices of the tetrahedra.
    """

    samples: Samples
    chosen: Index

    @classmethod
    def of(cls, solid: Solid, samples: Samples) -> Cells:
        """Compute them."""
        from scipy.spatial import Delaunay, QhullError

        chosen = samples.chosen
        points = samples.points[chosen]
        try:
            found, _ = run_together(lambda: Delaunay(points), lambda: solid.betti)
        except QhullError:
            raise InvalidShapeError(
                "The samples of the shape span no volume: a medial mesh needs a solid."
            ) from None
        corners, neighbours = (x.astype(np.int64) for x in (found.simplices, found.neighbors))
        centers, radii = _circumballs(points, corners)
        inside = np.isfinite(radii)
        inside[inside] = solid.contains(centers[inside])
        if not inside.any():
            raise InvalidShapeError(
                "Nothing of the shape is inside it: a medial mesh needs a solid."
            )
        before = inside.copy()
        _fill(inside, neighbours, radii, solid.betti)
        filled = inside & ~before  # their circumcenters are outside
        centers[filled] = points[corners[filled]].mean(axis=1)
        off = np.linalg.norm(points[corners[filled]] - centers[filled][:, None], axis=2)
        radii[filled] = off.min(axis=1)
        return cls(corners, neighbours, centers, radii, inside, samples, chosen)

    @property
    def proper(self) -> Mask:
        """Samples with something outside next to them, (n,)."""
        proper = np.zeros(len(self.chosen), bool)
        proper[self.corners[~self.inside]] = True
        rim, across = np.nonzero(self.neighbours < 0)
        for k in range(4):  # the faces of the hull: all corners but the one across
            rows = rim[across != k]
            proper[self.corners[rows, k]] = True
        return proper

    def crossings(self, solid: Solid) -> tuple[FloatArray, FloatArray]:
        """Return where edges between cells on the same side meet the surface, and its normals."""
        a, side = np.nonzero(self.neighbours >= 0)
        b = self.neighbours[a, side]
        same = (a < b) & (self.inside[a] == self.inside[b])
        same &= (self.radii[a] < FAR) & (self.radii[b] < FAR)
        a, b = a[same], b[same]
        way = self.centers[b] - self.centers[a]
        length = np.linalg.norm(way, axis=1)
        way /= np.maximum(length, 1e-300)[:, None]
        none = np.full(len(a), -1)
        found, face = solid.free_way(self.centers[a], way, none, length)
        met = np.flatnonzero(face >= 0)
        places = self.centers[a[met]] + found[met][:, None] * way[met]
        _, first = np.unique(np.rint(places / NEAREST), axis=0, return_index=True)
        return places[first], solid.surface.face_normals[face[met[first]]]


def _build(cells: Cells, relief: float) -> FineComplex:
    """Take the dual of the inside tetrahedra, and prune it."""
    samples, chosen, inside = cells.samples, cells.chosen, cells.inside
    points, normals = samples.points[chosen], samples.normals[chosen]
    number = np.where(inside, np.cumsum(inside) - 1, -1)
    edges, faces = dual_of(cells.corners, cells.neighbours, number)
    faces = opened(faces, cells.proper)
    live, live_edges, live_faces = _pruned(edges, faces, points, normals, int(inside.sum()), relief)
    rows = np.flatnonzero(inside)[live]
    place = np.cumsum(live) - 1
    balls = np.column_stack([cells.centers[rows], cells.radii[rows]])
    kept_edges, kept_faces = place[edges[live_edges, :2]], place[faces[live_faces, :3]]
    pole = _poles(cells.corners[rows], cells.radii[rows], len(points), balls, points)
    row_of = np.empty(len(samples.owner), np.int64)
    row_of[chosen] = np.arange(len(chosen))
    betti = betti_numbers(len(balls), kept_edges, kept_faces)
    return FineComplex(balls, kept_edges, kept_faces, samples, pole[row_of[samples.owner]], betti)


def _circumballs(points: FloatArray, corners: Index) -> tuple[FloatArray, FloatArray]:
    """Centers and radii of the balls through the corners of tetrahedra; not finite where flat."""
    a = points[corners[:, 0]]
    b, c, d = (points[corners[:, j]] - a for j in (1, 2, 3))
    bc, cd, db = np.cross(b, c), np.cross(c, d), np.cross(d, b)
    twice = 2 * np.einsum("ij,ij->i", b, cd)
    squares = [np.einsum("ij,ij->i", v, v)[:, None] for v in (b, c, d)]
    with np.errstate(all="ignore"):
        offset = (squares[0] * cd + squares[1] * db + squares[2] * bc) / twice[:, None]
        radii = np.linalg.norm(offset, axis=1)
    radii[~(radii < INFINITE)] = np.inf  # far outside, and finite squares
    return a + offset, radii


def _fill(
    inside: Mask, neighbours: Index, radii: FloatArray, wanted: tuple[int, int, int] | None
) -> None:
    """Let false cavities be inside and drop crumbs: as many of both as the solid has are left."""
    outside = len(inside)
    a, side = np.nonzero(neighbours >= 0)
    b = neighbours[a, side]
    same = (inside[a] == inside[b]) & (a < b)
    rim = np.flatnonzero((neighbours < 0).any(axis=1) & ~inside)
    links = np.concatenate(
        [np.stack([a[same], b[same]], axis=1), np.stack([rim, np.full(len(rim), outside)], axis=1)]
    )
    label = piece_labels(outside + 1, links)
    size = np.bincount(label, np.append(np.where(np.isfinite(radii), radii, 0.0) ** 3, 0.0))
    within = np.zeros(len(size), bool)
    within[label[:-1][inside]] = True
    hollow = ~within
    hollow[label[-1]] = False
    for which, number, becomes in ((hollow, 2, True), (within, 0, False)):
        groups = np.flatnonzero(which)
        ranked = groups[np.argsort(-size[groups], kind="stable")]
        keep = len(ranked) if wanted is None else wanted[number]
        changed = np.zeros(len(size), bool)
        changed[ranked[keep:]] = True
        inside[changed[label[:-1]]] = becomes


def dual_of(corners: Index, neighbours: Index, number: Index) -> tuple[Index, Index]:
    """Return edges (e, 5) and triangles (f, 5) between numbered tetrahedra, with their samples."""
    from medialis.medial_meshes._complex_kernels import dual_edges, dual_triangles

    count = len(corners)
    edges = np.empty((2 * count, 5), np.int64)
    edges = edges[: dual_edges(corners, neighbours, number, edges)]
    # Each of the 6 edges of a tetrahedron has it in its ring once, as one triangle at most.
    chords, faces = np.empty((6 * count, 5), np.int64), np.empty((6 * count, 5), np.int64)
    ring = np.empty(LONGEST_RING, np.int64)
    more, triangles = dual_triangles(corners, neighbours, number, ring, chords, faces)
    return np.concatenate([edges, chords[:more]]), faces[:triangles].copy()


def opened(faces: Index, proper: Mask, first: Mask | None = None) -> Index:
    """Open the cells of samples that only inside tetrahedra touch: they are no hollows.

    Each such cell loses a triangle towards a sample on the way to a `proper` one, of those marked
    as `first` where it has any.
    """
    drop = []
    ends = faces[:, 3:]
    while not proper.all():
        rim = np.flatnonzero(proper[ends[:, 0]] != proper[ends[:, 1]])
        if first is not None:
            rim = rim[np.argsort(~first[rim], kind="stable")]
        if len(rim) == 0:
            break
        lone = np.where(proper[ends[rim, 0]], ends[rim, 1], ends[rim, 0])
        samples, chosen = np.unique(lone, return_index=True)
        drop.append(rim[chosen])
        proper[samples] = True
    return np.delete(faces, np.concatenate(drop), axis=0) if drop else faces


def _pruned(
    edges: Index, faces: Index, points: FloatArray, normals: FloatArray, count: int, limit: float
) -> Live:
    """Collapse what small bumps made; return what stays."""
    from medialis.medial_meshes._complex_kernels import Dual, Live, prune, reliefs, sides_of

    by_vertex = Ragged.group(edges[:, :2].ravel(), count)
    items = np.asarray(by_vertex.indices, np.int64) // 2
    sides = np.zeros((len(faces), 3), np.int64)
    sides_of(faces, edges, by_vertex.offsets, items, sides)
    edge_relief, relief = np.empty(len(edges)), np.empty(len(faces))
    reliefs(edges, 2, points, normals, edge_relief)
    reliefs(faces, 3, points, normals, relief)
    live = Live(*(np.ones(n, bool) for n in (count, len(edges), len(faces))))
    prune(Dual(edges, sides, by_vertex.offsets, items), edge_relief, relief, limit, live)
    return live


def _poles(
    corners: Index, radii: FloatArray, count: int, balls: FloatArray, points: FloatArray
) -> Index:
    """Return the largest ball at each sample; the nearest one where pruning left none."""
    order = np.argsort(radii, kind="stable")
    pole = np.full(count, -1)
    pole[corners[order].ravel()] = np.repeat(order, 4)
    lost = np.flatnonzero(pole < 0)
    if len(lost):
        pole[lost] = kd_tree(balls[:, :3]).query(points[lost])[1]
    return pole


def grown(cells: Tetrahedra, loops: int) -> Mask:
    """Return the tetrahedra (t,) of a dual of one part with this many loops and without hollows.

    There are fewer loops where no more can be closed. Cost: O(t log t), and a shortest way for each
    loop that could be closed.
    """
    growth = _Growth(cells)
    growth.add(int(np.where(cells.inside, growth.tables.depth, -1.0).argmax()))
    for _ in range(loops):
        t = growth.longest()
        if t < 0:
            break
        growth.add(t)
    return growth.state.member


class _Growth:
    """The set, and what its kernels need."""

    def __init__(self, cells: Tetrahedra) -> None:
        from medialis.medial_meshes._complex_kernels import Grown, Heap, Tables

        self.cells = cells
        corners, count = cells.corners, int(cells.corners.max()) + 1
        ends = np.sort(corners[:, PAIRS], axis=2)
        edges = np.unique((ends[..., 0] * count + ends[..., 1]).ravel(), return_inverse=True)[1]
        edges = edges.reshape(-1, 6).astype(np.int64)
        left, around = np.bincount(edges.ravel()), np.bincount(corners.ravel())
        rim, across = np.nonzero(cells.neighbours < 0)
        for slot, (a, b) in enumerate(PAIRS):
            left[edges[rim[(across != a) & (across != b)], slot]] = NEVER
        for k in range(4):
            around[corners[rim[across != k], k]] = NEVER
        depth = np.where(np.isfinite(cells.radii), cells.radii, 0.0)
        self.tables = Tables(corners, cells.neighbours, edges, cells.inside, depth)
        self.state = Grown(left, around, np.zeros(len(corners), bool))
        room = 8 * len(corners) + 64  # each pushes its four neighbours once, and waits
        self.heap = Heap(np.empty(room), np.empty(room, np.int64))
        self.waiting = np.empty(len(corners), np.int64)
        self._way = np.full(len(corners), np.inf)
        self._known: dict[int, float] = {}

    def add(self, t: int) -> None:
        """Let a tetrahedron join, and all that may then."""
        from medialis.medial_meshes._complex_kernels import grow, join

        size = join(t, self.tables, self.state, self.heap, 0)
        grow(self.tables, self.state, self.heap, size, self.waiting)

    def longest(self) -> int:
        """Return the tetrahedron that closes the longest loop, -1 where none closes any.

        One of each seam is looked at, the deepest. Loops only get shorter as the set grows, so a
        length known before is an upper bound.
        """
        from medialis.medial_meshes._complex_kernels import closers

        rest = np.flatnonzero(self.cells.inside & ~self.state.member)
        ends = np.empty((len(rest), 2), np.int64)
        closers(rest, self.tables, self.state, ends)
        closing = ends[:, 1] >= 0
        if not closing.any():
            return -1
        seam, depth = self._seams(rest), self.tables.depth
        order = np.flatnonzero(closing)
        order = order[np.argsort(-depth[rest[order]], kind="stable")]
        order = order[np.unique(seam[order], return_index=True)[1]]
        bound = np.array([self._known.get(int(rest[i]), np.inf) for i in order])
        fresh = np.zeros(len(order), bool)
        while not fresh[k := int(bound.argmax())]:
            bound[k], fresh[k] = self._length(*ends[order[k]]), True
            self._known[int(rest[order[k]])] = bound[k]
        return int(rest[order[k]])

    def _length(self, a: int, b: int) -> float:
        from medialis.medial_meshes._complex_kernels import way_between

        cells, member = self.cells, self.state.member
        length = way_between(a, b, cells.neighbours, cells.centers, member, self.heap, self._way)
        return float(length)

    def _seams(self, rest: Index) -> Index:
        """Return the connected piece of each of some tetrahedra."""
        place = np.full(len(self.cells.corners), -1)
        place[rest] = np.arange(len(rest))
        beside = self.cells.neighbours[rest]
        row, side = np.nonzero((beside >= 0) & (place[beside] >= 0))
        links = np.stack([row, place[beside[row, side]]], axis=1)
        return np.asarray(piece_labels(len(rest), links), np.int64)
