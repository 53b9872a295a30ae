"""Lines in the middle of tubes, from some places to others, and where they part.

1. `inlets`: the open ends of a tube are borders that balls of the tube lie in the middle of; holes
   in a wall are none. A line ends in the middle of the border.
2. `shortest`: balls of neighbouring samples are linked, and paths are shortest where a step counts
   as its length over the radius: they keep to where the shape is widest.
3. `Middle`: such a path jumps from ball to ball. Each of its places moves to the parabola along
   the path that fits the wide balls round it best; a bend does not draw it inwards, as a mean
   would. Short bends are smoothed by a spline.
4. `joined`: where lines from one place part by less than a share of the radius they are one.
5. `tracts`: pieces of lines as the Vascular Modeling Toolkit numbers them. A fork is a piece of its
   own, blanked: from where its ball begins to where a line has left the balls of the other one.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from medialis.base.arrays import (
    Described,
    Index,
    Mask,
    distinct,
    kd_tree,
    places_along,
    polylines,
    rows_at,
    unit_rows,
    weighted_graph,
)
from medialis.base.box_tree import NearestTree, exact_box_tree, nearest_others
from medialis.base.errors import InvalidShapeError
from medialis.base.progress import Progress
from medialis.base.threads import run_chunks
from medialis.base.validation import FloatArray, Positions
from medialis.skeleton.medial_cloud import MedialCloud

IN_THE_MIDDLE = 0.5
"""Radii that the balls at the border of an open end lie from its middle at most; those at a hole in
a wall lie one radius away, and more."""

LEAP = 10.0
"""A step from a ball out of it costs so many times its length: it may lead through a wall."""

CELL = 0.25
"""Radii of the cells in each of which the widest ball is linked to others."""

NEAR = 23
"""Wide balls that each one is linked to, at most."""

STEPS_A_RADIUS = 4.0
"""Places of a line while it is laid in the middle, to the radius of its median ball."""

MOST_STEPS = 2000
"""Of a line while it is laid in the middle."""

WINDOW = 1.5
"""Radii along a line from which balls count for a place."""

ASIDE = 0.5
"""Radii across it."""

WIDE = 0.8
"""Balls count that have this share of the radius of the largest ball there, at least."""

LIMITS = np.array([WINDOW, ASIDE, 0.5, WIDE])
"""Of a sheet the widest ridge counts; a ball is compared with those half a radius before and behind
it."""

BEND = 3.0
"""Radii: bends shorter than this are smoothed."""

STIFFEST = 1e9
"""Weight of third differences, at most: what rounding leaves digits for."""

PINNED = 1e6
"""Weight of an end that stays, where others have 1."""

ROUNDS = 3
"""Times that a line is laid in the middle, each from where it lies."""

PLACES_A_CHUNK = 16

FEWEST = 6
"""Balls that a parabola is fitted to; where there are fewer, a mean is taken."""

ONE_LINE = 0.1
"""Radii: lines from the same place are one as long as they lie this near to each other."""


@dataclass(frozen=True, eq=False)
class Inlet:
    """An open end: its border, the middle of it, and its mean radius."""

    vertices: Index
    middle: FloatArray
    radius: float


def inlets(cloud: MedialCloud) -> list[Inlet]:
    """Return the open ends of a surface, the widest first."""
    surface = cloud.surface
    assert surface.faces is not None
    table = surface.edge_table
    border = table.ends[table.counts == 1]
    found = []
    for line in polylines(border, surface.point_count):
        if line[0] != line[-1] or len(line) < 4:
            continue
        around = surface.points[line]
        steps = np.linalg.norm(np.diff(around, axis=0), axis=1)
        length = float(steps.sum())
        if length == 0.0:
            continue
        middle = (steps @ (around[1:] + around[:-1])) / (2.0 * length)
        rows = line[:-1][cloud.valid[line[:-1]]]
        if len(rows) == 0:
            continue
        aside = np.linalg.norm(np.median(cloud.centers[rows], axis=0) - middle)
        if aside <= IN_THE_MIDDLE * np.median(cloud.radii[rows]):
            away = np.linalg.norm(around[:-1] - middle, axis=1)
            found.append(Inlet(rows.astype(np.int64), middle, float(away.mean())))
    return sorted(found, key=lambda one: -one.radius)


def shortest(cloud: MedialCloud, starts: Index, ends: Index) -> list[Index]:
    """Return the rows of balls along the path to each end from the nearest start.

    Parameters
    ----------
    cloud : MedialCloud
        All balls of a mesh.
    starts, ends : (s,), (e,) int
        Rows of valid balls.

    Raises
    ------
    InvalidShapeError
        When no path leads to an end: it lies in another part.
    """
    from scipy.sparse.csgraph import dijkstra

    a, b = _links(cloud).T
    radii = np.maximum(cloud.radii, 1e-12 * cloud.surface.diagonal)
    length = np.linalg.norm(cloud.centers[a] - cloud.centers[b], axis=1)
    cost = 0.5 * length * (1.0 / radii[a] + 1.0 / radii[b])
    cost[length > np.maximum(radii[a], radii[b])] *= LEAP
    cost = np.maximum(cost, 1e-9)  # balls of the same center
    graph = weighted_graph(cost, a, b, len(cloud))
    known = {"directed": False, "indices": starts, "return_predecessors": True, "min_only": True}
    away, before, _ = dijkstra(graph, **known)
    lost = ends[~np.isfinite(away[ends])]
    if len(lost):
        x, y, z = cloud.surface.points[lost[0]] + cloud.surface.offset
        raise InvalidShapeError(
            f"No line leads to the end at {x:.6g} {y:.6g} {z:.6g}: it lies in another part of the "
            "shape than where lines begin."
        )
    paths = []
    for end in ends.tolist():
        path = [end]
        while (above := int(before[path[-1]])) >= 0:
            path.append(above)
        paths.append(np.array(path[::-1], np.int64))
    return paths


def _links(cloud: MedialCloud) -> Index:
    """Return pairs (l, 2) of balls: of neighbouring samples, and wide ones that overlap.

    A coarse tube has few samples in the middle of its faces, whose balls are the widest; their
    neighbours are at its edges. Of the balls of a cell, a share of their radius wide, the largest
    is linked to those near it whose centers lie in it or that its center lies in: the line between
    such centers is inside.
    """
    edges = _stand_ins(cloud)[cloud.surface.edges]
    edges = edges[(edges[:, 0] != edges[:, 1]) & cloud.valid[edges].all(axis=1)]
    rows = np.flatnonzero(cloud.valid & (cloud.radii > 0.0))
    rows = rows[np.argsort(-cloud.radii[rows], kind="stable")]
    octave = np.floor(np.log2(cloud.radii[rows]))
    cells = np.floor(cloud.centers[rows] / (CELL * 2.0**octave)[:, None])
    # The first of each cell is the largest: sorting keeps the order of equal ones.
    keys = np.column_stack([octave, cells]).T
    order = np.lexsort(keys)
    first = np.ones(len(rows), np.bool_)
    first[1:] = (np.diff(keys[:, order], axis=1) != 0).any(axis=0)
    wide = rows[np.sort(order[first])]
    if len(wide) < 2:
        return edges
    near, away = nearest_others(cloud.centers[wide], NEAR)
    one, other = np.repeat(wide, near.shape[1]), wide[near.ravel()]
    inside = away.ravel() < np.maximum(cloud.radii[one], cloud.radii[other])
    more = np.stack([one, other], axis=1)[inside]
    pairs = np.concatenate([edges, more])
    low, high = np.minimum(*pairs.T), np.maximum(*pairs.T)
    keys = distinct(low * np.int64(len(cloud)) + high)
    return np.stack([keys // len(cloud), keys % len(cloud)], axis=1)


def resampled(points: FloatArray, step: float, most: int = MOST_STEPS) -> FloatArray:
    """Return places at equal steps along a polyline, no longer than `step`; both ends stay."""
    along = places_along(points)
    count = int(np.clip(np.ceil(along[-1] / step), 1, most))
    at = np.linspace(0.0, along[-1], count + 1)
    return rows_at(at, along, points)


def tangents_of(points: FloatArray) -> FloatArray:
    """Return unit tangents (k, 3) of a polyline."""
    if len(points) < 2:
        return np.tile([1.0, 0.0, 0.0], (len(points), 1))
    return unit_rows(np.gradient(points, axis=0), instead=np.array([1.0, 0.0, 0.0]))


class Middle:
    """Lays lines in the middle of the balls of a cloud."""

    def __init__(self, cloud: MedialCloud) -> None:
        from medialis.curves._section_kernels import Balls

        rows, surface = np.flatnonzero(cloud.valid), cloud.surface
        centers, self._radii = cloud.centers[rows], cloud.radii[rows]
        self._near = kd_tree(centers)
        self._tree = exact_box_tree(centers)
        source = cloud.source[rows]
        touching = unit_rows(surface.points[source] - centers)
        areas = np.maximum(surface.point_areas[source], 1e-300)
        self._balls = Balls(*(x[self._tree.order] for x in (self._radii, touching, areas)))

    def line(self, path: FloatArray, fixed: tuple[bool, bool], progress: Progress) -> FloatArray:
        """Lay a path through centers of balls in the middle of the balls round it.

        Parameters
        ----------
        path : (k, 3) float64
        fixed : (bool, bool)
            Whether its first and its last place stay.
        progress : Progress

        Returns
        -------
        (p, 3) float64
            At equal steps.
        """
        typical = float(np.median(self._radii_near(path)))
        path = self._smoothed(resampled(path, typical / STEPS_A_RADIUS), fixed)
        for number in range(ROUNDS):
            path = resampled(path, typical / STEPS_A_RADIUS)
            tangents = _smooth_tangents(path, typical)
            inner, moved = slice(int(fixed[0]), len(path) - int(fixed[1])), path.copy()
            moved[inner] = self._fitted(path[inner], tangents[inner], progress)
            path = self._smoothed(moved, fixed)
            progress.update((number + 1) / ROUNDS)
        return path

    def _radii_near(self, path: FloatArray) -> FloatArray:
        return self._radii[self._near.query(path)[1]]

    def _smoothed(self, path: FloatArray, fixed: tuple[bool, bool]) -> FloatArray:
        """Return a path without bends shorter than `BEND`: of least change of curvature.

        Squares of its distances and of its third differences are least; a circle stays one.
        """
        from scipy.sparse import diags
        from scipy.sparse.linalg import spsolve

        count = len(path)
        if count < FEWEST:
            return path
        third = diags([-1.0, 3.0, -3.0, 1.0], [0, 1, 2, 3], shape=(count - 3, count))
        weights = np.ones(count)
        weights[[0, -1]] = np.where(fixed, PINNED, 1.0)
        radii = self._radii_near(path)
        step = max(float(places_along(path)[-1]) / (count - 1), 1e-9 * float(radii.max()))
        stiff = (BEND * radii[1:-2] / (2.0 * np.pi * step)) ** 6
        system = diags([weights], [0]) + third.T @ diags([np.minimum(stiff, STIFFEST)], [0]) @ third
        found = np.asarray(spsolve(system.tocsc(), weights[:, None] * path))
        ends = [k for k, stays in zip((0, -1), fixed, strict=True) if stays]
        found[ends] = path[ends]
        return found

    def _fitted(self, places: FloatArray, tangents: FloatArray, progress: Progress) -> FloatArray:
        """Return where the parabolas along tangents that fit wide balls best pass, (k, 3)."""
        from medialis.curves._section_kernels import Line, fit_parabolas

        away, nearest = self._near.query(places)
        radii, tree = self._radii[nearest], self._tree
        line = Line(places - tree.center, np.ascontiguousarray(tangents), radii)
        moves = np.zeros_like(places)
        given = line, tree, self._balls, LIMITS, FEWEST, moves
        run_chunks(fit_parabolas, len(places), PLACES_A_CHUNK, *given, progress=progress.still)
        lost = away > WINDOW * radii
        return np.where(lost[:, None], self._near.data[nearest], places) + moves


def _smooth_tangents(path: FloatArray, radius: float) -> FloatArray:
    """Return tangents between the places a radius before and behind each one."""
    along = places_along(path)
    before, behind = (np.clip(along + shift, 0.0, along[-1]) for shift in (-radius, radius))
    chord = rows_at(behind, along, path) - rows_at(before, along, path)
    return unit_rows(chord, instead=np.array([1.0, 0.0, 0.0]))


@dataclass(frozen=True, eq=False, repr=False)
class Centerlines(Described):
    """Lines that share what they have in common.

    Attributes
    ----------
    points : (p, 3) float64
    radii : (p,) float64
        Distance to the surface.
    lines : tuple of (k,) int64
        The points along each line, from its start to its end.
    """

    points: Positions
    radii: FloatArray
    lines: tuple[Index, ...]


def joined(paths: list[FloatArray], surface: NearestTree) -> Centerlines:
    """Let lines from the same place share their points as long as they run together.

    Over the last radius before they part, a line goes over from the one it shares to its own way,
    so that neither has a kink.
    """
    points = [paths[0]]
    lines = [np.arange(len(paths[0]))]
    total = len(paths[0])
    for path in paths[1:]:
        known, radius = np.concatenate(points), surface.distances(path)[0]
        step = max(float(np.linalg.norm(path[1] - path[0])) if len(path) > 1 else 0.0, 1e-300)
        own, other, nearest = 0, lines[0], np.zeros(len(path), np.int64)
        for line in lines:
            away, beside = kd_tree(known[line]).query(path)
            apart = away > ONE_LINE * radius + 0.5 * step  # places need not lie opposite each other
            together = int(np.argmax(apart)) if apart.any() else len(path)
            if together > own:
                own, other, nearest = together, line, beside
        own = min(own, len(path) - 1)  # its end is its own
        parts = max(own - int(radius[own] / step), min(own, 1)) if own else 0
        fade = np.linspace(0.0, 1.0, own - parts + 2)[1:-1, None]
        beside = known[other[nearest[parts:own]]]
        led = beside + fade * fade * (3.0 - 2.0 * fade) * (path[parts:own] - beside)
        shared = int(nearest[parts - 1]) + 1 if parts else 0
        points.append(np.concatenate([led, path[own:]]))
        lines.append(np.concatenate([other[:shared], total + np.arange(len(path) - parts)]))
        total += len(path) - parts
    known = np.concatenate(points)
    return Centerlines(known, surface.distances(known)[0], tuple(lines))


@dataclass(frozen=True, eq=False, repr=False)
class Tract(Described):
    """A piece of a line: the line, its places along it, its group, and whether it is a fork."""

    line: int
    first: int
    last: int
    group: int
    blanked: bool


def tracts(found: Centerlines) -> list[Tract]:
    """Cut lines at their forks; pieces of several lines that are the same have the same group."""
    groups: dict[tuple[bool, tuple[int, ...]], int] = {}
    pieces = []
    for number, line in enumerate(found.lines):
        shared = _shared(found, number)
        blanked = _blanked(found, number, shared)
        cuts = np.flatnonzero(np.diff(blanked.astype(int))) + 1
        ends = [0, *cuts.tolist(), len(line)]
        for first, last in itertools.pairwise(ends):
            with_these = tuple(np.flatnonzero(shared > first).tolist())
            key = bool(blanked[first]), with_these
            group = groups.setdefault(key, len(groups))
            pieces.append(Tract(number, first, last - 1, group, bool(blanked[first])))
    return pieces


def _shared(found: Centerlines, number: int) -> Index:
    """Return how many places each line has in common with one, from the start."""
    own = found.lines[number]
    result = np.empty(len(found.lines), np.int64)
    for other, line in enumerate(found.lines):
        count = min(len(own), len(line))
        differ = own[:count] != line[:count]
        result[other] = int(np.argmax(differ)) if differ.any() else count
    return result


def _blanked(found: Centerlines, number: int, common: Index) -> Mask:
    """Which places of a line, which has so many in common with each, belong to a fork."""
    own = found.lines[number]
    result = np.zeros(len(own), bool)
    along = places_along(found.points[own])
    for other, shared in enumerate(common.tolist()):
        if other == number or shared in (0, len(own)):
            continue
        fork = shared - 1
        first = int(np.searchsorted(along, along[fork] - found.radii[own[fork]]))
        rest = found.lines[other][fork:]
        away = kd_tree(found.points[rest]).query(found.points[own[shared:]])
        inside = away[0] < found.radii[rest[away[1]]]
        last = shared + (int(np.argmin(inside)) if not inside.all() else len(inside))
        result[max(first, 0) : last] = True
    return result


def nearest_balls(cloud: MedialCloud, vertices: Index) -> Index:
    """Return the ball of each vertex, or the nearest that is valid in its part.

    Raises
    ------
    InvalidShapeError
        When there is none.
    """
    rows = _stand_ins(cloud)[vertices]
    if not cloud.valid[rows].all():
        raise InvalidShapeError("A place lies in a part of the shape that holds no ball.")
    return rows


def _stand_ins(cloud: MedialCloud) -> Index:
    """Return the row of a valid ball for each sample: its own, or the nearest of its part.

    Samples of parts without any keep their own. So samples without a ball cut no tube.
    """
    rows = np.arange(len(cloud))
    parts = cloud.surface.components
    for part in np.unique(parts[~cloud.valid]).tolist():
        here = parts == part
        lost, known = np.flatnonzero(here & ~cloud.valid), np.flatnonzero(here & cloud.valid)
        if len(known):
            points = cloud.surface.points
            rows[lost] = known[kd_tree(points[known]).query(points[lost])[1]]
    return rows


def node_vertices(cloud: MedialCloud, nodes: FloatArray, radii: FloatArray) -> Index:
    """Return the widest ball near each node of a curve skeleton, as a row."""
    rows = np.flatnonzero(cloud.valid)
    tree = kd_tree(cloud.centers[rows])
    found = []
    for node, radius in zip(nodes, radii, strict=True):
        near = tree.query_ball_point(node, 0.5 * radius) or [int(tree.query(node)[1])]
        found.append(int(rows[near][np.argmax(cloud.radii[rows[near]])]))
    return np.array(found, np.int64)
