"""Welding: which vertices of a mesh are one, and which faces of a mesh are bodies of their own.

Files store one vertex several times: once for each triangle (STL), for each face of a CAD model or
for each seam of a texture, often with other rounding. Bodies that touch, on the other hand, have
vertices at the same positions that are not one. `weld` tells the two apart in three steps:

1. Vertices at exactly the same position are merged, first within each body of the file, then across
   bodies where something is open. Closed components are left alone: none is merged with a component
   that it touches.
2. Boundary edges that run along each other within `weld_distance` are merged, where that collapses
   no face. The distance follows from the precision of the coordinates (`coordinate_step`).
3. Files without shared vertices do not say which triangles form a body, so step 1 merges the
   vertices of bodies that touch. Round an edge of more than two faces, each face that enters a
   solid is paired with the next face that leaves it. Parts that these pairs close get vertices of
   their own.

No position changes: a merged vertex takes the position of the first one, at most twice
`weld_distance` away.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import EdgeTable, Index, Mask, first_equal_row, next_side, unit_rows
from medialis.base.progress import Message, counted
from medialis.base.validation import FloatArray, IntArray
from medialis.shape.surface import Surface, Topology, piece_labels

STEPS = 2.0
"""Weld distance in steps of the coordinates: two roundings of one position differ by one step in
each coordinate, by 1.73 steps in space."""

MIN_DISTANCE = 1e-8
"""Weld distance as a fraction of the diagonal, at least: the error of a few operations in double
precision far above rounding; trimesh merges vertices within 1e-8."""

MAX_DISTANCE = 1e-3
"""Weld distance as a fraction of the diagonal, at most, however coarse the coordinates are."""

MAX_GAP = 0.25
"""Distance of two boundary edges that are merged, as a fraction of the shorter edge, at most."""

CANDIDATES = 8
"""Nearest boundary edges that are compared with each boundary edge."""

SAMPLED_COORDINATES = 30_000
"""Coordinates whose digits are examined, at most."""

MIN_DIGITS, MAX_DIGITS = 4, 12
"""Significant digits of coordinates that were rounded to a decimal number: fewer are positions on a
grid, such as the corners of boxes, more are full double precision."""

SINGLE_DIGITS = 9
"""Significant digits that identify a number in single precision."""

FEW_NUMBERS = 5
"""Distinct numbers of one order of magnitude that show how many decimals such numbers have."""

MIN_SHARE = 0.02
"""Fraction of coordinates that show a precision, at least, or that contradict it, at most."""

MAX_CONTACT = 0.2
"""Fraction of the faces of a body that lie on those of another one, below which vertices that the
file shares are parted. Folds of scanned surfaces have more: these are blobs of four faces."""

SAME_ANGLE = 1e-6
"""Radians: faces at an edge whose angles differ by less lie on each other."""

FLAT = 1e-9
"""Volume over the absolute volume of its tetrahedra below which a closed part encloses nothing."""


@dataclass(frozen=True, eq=False)
class Weld:
    """A mesh whose coincident vertices are merged.

    Attributes
    ----------
    faces : (m, 3) int32
        The faces given, over k vertices.
    first : (k,) int64
        The given vertex whose position each vertex has.
    vertex_map : (n,) int32
        The vertex that each given vertex became; the first one where bodies share it.
    exact, near : int
        Vertices merged with one at the same position, and with one nearby.
    distance : float
        Largest distance that was allowed for the latter.
    parted : int
        Bodies that touch others and got vertices of their own.
    """

    faces: IntArray
    first: Index
    vertex_map: IntArray
    exact: int = 0
    near: int = 0
    distance: float = 0.0
    parted: int = 0

    @property
    def messages(self) -> tuple[Message, ...]:
        """What was done, one sentence each."""
        result = []
        if self.exact:
            text = f"Welded {counted(self.exact, 'point')} lying exactly on another one."
            result.append(Message(text, "welded", points=self.exact))
        if self.near:
            text = (
                f"Welded {counted(self.near, 'vertex')} of cracks at most {self.distance:.3g} from "
                "another one, the precision of the coordinates, where that closes the mesh."
            )
            data: dict[str, Any] = {"vertices": self.near, "distance": self.distance}
            result.append(Message(text, "cracks_welded", **data))
        if self.parted:
            text = f"Kept {self.parted} bodies apart that touch in shared vertices."
            result.append(Message(text, "bodies_kept_apart", bodies=self.parted))
        return tuple(result)


def weld(surface: Surface, bodies: IntArray | None = None) -> Weld:
    """Merge vertices of a mesh that are one, and keep bodies apart that only touch.

    Parameters
    ----------
    surface : Surface
        n finite points, of a size such that squares of lengths stay in range, and m faces. Of a
        cloud all points at the same position are merged.
    bodies : (m,) int32, optional
        Body of the file that each face belongs to.

    Returns
    -------
    Weld

    Notes
    -----
    Cost O(n) for the first step, O(b log b) for the second with b boundary edges left after the
    first one, O(e) for the third with e edges of more than two faces.

    Examples
    --------
    >>> points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1e-17, 0], [1, 1, 0], [0, 1, 0]]
    >>> welded = weld(Surface(points, [[0, 1, 2], [3, 4, 5]]))
    >>> welded.faces.tolist(), welded.exact, welded.near
    ([[0, 1, 2], [1, 3, 2]], 1, 1)
    """
    points, faces, n = surface.points, surface.topology.faces, surface.point_count
    result = Weld(faces, np.arange(n), np.arange(n, dtype=np.int32))
    if len(faces) == 0:
        return _merged(result, surface.first_equal_point, exact=True)
    if not surface.used_points.all():
        result = _merged(result, _stand_ins(surface), exact=True)
    elif surface.topology.is_solid:
        return result
    # First within the bodies of the file, then across them where something is left open.
    for label in (None,) if bodies is None else (_vertex_labels(faces, bodies, n), None):
        now = Topology(result.faces, len(result.first)) if result.exact else surface.topology
        here = np.flatnonzero(_open_vertices(now))
        rows = first_equal_row(points[result.first[here]])
        if label is not None:
            rows = first_equal_row(np.stack([rows, label[result.first[here]], 0 * rows], axis=1))
        first = np.arange(len(result.first))
        first[here] = here[rows]
        result = _merged(result, first, exact=True)
    table = EdgeTable.of(result.faces, len(result.first)) if result.exact else surface.edge_table
    result = _without_cracks(points, result, table)
    if not result.exact and not result.near and not (table.counts > 2).any():
        return result
    return _parted(surface, result)


def _open_vertices(topology: Topology) -> Mask:
    """Vertices of components with an edge that does not have two faces, (n,)."""
    table, component = topology.edge_table, topology.components
    is_open = np.zeros(int(component.max(initial=-1)) + 1, np.bool_)
    is_open[component[table.low[table.counts != 2]]] = True
    return is_open[component]


def _stand_ins(surface: Surface) -> Index:
    """Vertex at the same position for each vertex without faces, itself for the others, (n,)."""
    equal, used = surface.first_equal_point, surface.used_points
    result = np.arange(surface.point_count)
    best = np.full(len(result), len(result))
    np.minimum.at(best, equal, np.where(used, result, len(result)))
    best = np.where(best < len(result), best, result)
    return np.where(used, result, best[equal])


def _vertex_labels(faces: IntArray, bodies: IntArray, n: int) -> IntArray:
    """Body of each vertex, (n,); -1 for vertices without faces."""
    label = np.full(n, -1, np.int32)
    label[faces] = np.asarray(bodies)[:, None]
    return label


def _merged(weld: Weld, first: Index, *, exact: bool, distance: float = 0.0) -> Weld:
    """Merge vertices with those that `first` (k,) names; these name themselves."""
    kept = first == np.arange(len(first))
    count = int(np.count_nonzero(~kept))
    if count == 0:
        return weld
    place = (np.cumsum(kept) - 1).astype(np.int32)[first]
    return replace(
        weld,
        faces=place[weld.faces],
        first=weld.first[kept],
        vertex_map=place[weld.vertex_map],
        exact=weld.exact + (count if exact else 0),
        near=weld.near + (0 if exact else count),
        distance=max(weld.distance, distance),
    )


# Cracks


def weld_distance(points: FloatArray) -> float:
    """Largest distance of two vertices of some points (n, 3) that rounding may have parted.

    Examples
    --------
    >>> weld_distance(np.array([[0, 0, 0], [0.1234, 0.2, 0.3], [1.0, 0.9876, 0]])).__round__(6)
    0.0002
    """
    diagonal = math.hypot(*np.ptp(points, axis=0).tolist())
    step = STEPS * coordinate_step(points)
    return min(max(step, MIN_DISTANCE * diagonal), MAX_DISTANCE * diagonal)


def coordinate_step(points: FloatArray) -> float:
    """Distance of neighbouring numbers at the largest coordinate, in the precision of the file.

    It is that of decimal numbers where nearly all coordinates have at most `MAX_DIGITS` significant
    digits, as in text; that of single precision where some coordinates are such numbers, as in
    binary STL; else that of double precision. Text that keeps the number of decimals is
    distinguished from text that keeps the number of significant digits: there smaller numbers have
    more decimals.

    Examples
    --------
    >>> coordinate_step(np.array([[0.125, 12.345, 99.875]]))
    0.001
    """
    values = np.abs(points.ravel())
    largest = float(values.max(initial=0.0))
    if largest == 0.0:
        return 0.0
    values = values[:: max(1, len(values) // SAMPLED_COORDINATES)]
    values = np.append(values[values > 1e-9 * largest], largest)
    digits, decimals = _decimal_digits(values)
    single = (values == values.astype(np.float32)) & (digits > SINGLE_DIGITS)
    if np.mean(single) > MIN_SHARE:
        return float(np.spacing(np.float32(largest)))
    text = digits <= MAX_DIGITS
    if np.mean(~text) > MIN_SHARE or digits[text].max() < MIN_DIGITS:
        return float(np.spacing(largest))
    distinct, first = np.unique(values[text], return_index=True)
    leading = np.floor(np.log10(distinct)).astype(np.int64) + 1
    decimals, digits = decimals[text][first], digits[text][first]
    counts = np.bincount(leading - leading.min())
    highest = leading.min() + np.flatnonzero(counts >= min(FEW_NUMBERS, counts.max())).max()
    if decimals[leading == highest].max() >= decimals.max():
        return float(10.0 ** -decimals.max())
    return float(10.0 ** (leading.max() - digits.max()))


def _decimal_digits(values: FloatArray) -> tuple[Index, Index]:
    """Significant digits and decimals of positive numbers, (k,) each; 99 digits: more than 15."""
    leading = np.floor(np.log10(values)).astype(np.int64) + 1
    digits = np.full(len(values), 99)
    for count in range(1, 16):
        left = np.flatnonzero(digits == 99)
        power = count - leading[left]
        with np.errstate(over="ignore", invalid="ignore"):
            up, down = 10.0 ** np.maximum(power, 0), 10.0 ** np.maximum(-power, 0)
            fits = np.rint(values[left] * up / down) / up * down == values[left]
        digits[left[fits]] = count
    return digits, digits - leading


def _without_cracks(points: FloatArray, weld: Weld, table: EdgeTable) -> Weld:
    """Merge boundary edges that run along each other within the weld distance."""
    at = points[weld.first]
    odd = np.flatnonzero(table.counts % 2 == 1)
    if len(odd) < 2:
        return weld
    distance = weld_distance(points)
    odd = _beside_cracks(at, table, odd, distance)
    net = np.add.reduceat(np.where(table.forward[table.order], 1, -1), table.first[:-1])[odd]
    start = np.where(net > 0, table.low[odd], table.high[odd])
    end = np.where(net > 0, table.high[odd], table.low[odd])
    links, matched = _crack_links(at, start.astype(np.int64), end.astype(np.int64), distance)
    if len(links) == 0:
        return weld
    a, b, c = weld.faces.T
    proper = (a != b) & (b != c) & (c != a)
    while len(links):
        label = piece_labels(len(at), links)
        first = np.full(int(label.max()) + 1, len(at))
        np.minimum.at(first, label, np.arange(len(at)))
        corners = label[weld.faces[proper]]
        folded = (corners == np.roll(corners, 1, axis=1)).any(axis=1)
        far = np.linalg.norm(at - at[first[label]], axis=1) > 2.0 * distance
        bad = np.zeros(len(first), np.bool_)
        bad[corners[folded]] = bad[label[far]] = True
        kept = ~bad[label[links[:, 0]]]
        if kept.all():
            return _merged(weld, first[label], exact=False, distance=distance)
        # Once more with the best matches alone, then without.
        again = matched[bad[label[matched[:, 0]]]]
        links, matched = np.concatenate([links[kept], again]), matched[:0]
    return weld


def _beside_cracks(at: FloatArray, table: EdgeTable, odd: Index, distance: float) -> Index:
    """Edges of an odd number of faces, and those whose ends are both near ends of such edges.

    Where bodies touch, faces of both may share an edge while their own neighbours share another.
    """
    from scipy.spatial import cKDTree

    ends = np.unique(table.ends[odd])
    near = np.isfinite(cKDTree(at[ends]).query(at, distance_upper_bound=distance)[0])
    return np.union1d(odd, np.flatnonzero(near[table.ends].all(axis=1)))


def _crack_links(at: FloatArray, start: Index, end: Index, distance: float) -> tuple[Index, Index]:
    """Pairs of vertices at both sides of cracks, (k, 2), and those of the best matches.

    Boundary edges within the distance of each other are linked: several where bodies touch. Of the
    best matches each edge has at most one: the nearest, one that runs the opposite way first.
    """
    from scipy.spatial import cKDTree

    center = at[start].mean(axis=0)
    one, other = at[start] - center, at[end] - center
    length = np.linalg.norm(other - one, axis=1)
    count = min(CANDIDATES, len(start))
    tree = cKDTree(np.hstack([one, other]))
    pairs = []
    for turned, query in ((True, np.hstack([other, one])), (False, np.hstack([one, other]))):
        near = tree.query(query, k=np.arange(1, count + 1), distance_upper_bound=2 * distance)[1]
        i, k = np.nonzero(near < len(start))
        j = near[i, k]
        i, j = i[i != j], j[i != j]
        ends = (other, one) if turned else (one, other)
        apart = np.maximum(
            np.linalg.norm(one[i] - ends[0][j], axis=1),
            np.linalg.norm(other[i] - ends[1][j], axis=1),
        )
        fits = (apart <= distance) & (apart <= MAX_GAP * np.minimum(length[i], length[j]))
        low, high = np.minimum(i, j)[fits], np.maximum(i, j)[fits]
        order = np.lexsort((high, low, apart[fits]))
        pairs.append(np.stack([low, high, np.full(len(low), turned)], axis=1)[order])
    every = np.concatenate(pairs)
    best = _mutual_nearest(every, len(start))
    return _ends_of(every, start, end), _ends_of(best, start, end)


def _ends_of(pairs: Index, start: Index, end: Index) -> Index:
    """Pairs of vertices at the ends of pairs of edges (i, j, whether they run opposite ways)."""
    i, j, opposite = pairs.T
    first, last = np.where(opposite, end[j], start[j]), np.where(opposite, start[j], end[j])
    return np.stack([np.r_[start[i], end[i]], np.r_[first, last]], axis=1)


def _mutual_nearest(pairs: Index, count: int) -> Index:
    """Return the pairs, best first, whose two members are in no better pair that is returned."""
    chosen = []
    while len(pairs):
        best = np.full(count, len(pairs))
        rank = np.arange(len(pairs))
        np.minimum.at(best, pairs[:, 0], rank)
        np.minimum.at(best, pairs[:, 1], rank)
        mutual = (best[pairs[:, 0]] == rank) & (best[pairs[:, 1]] == rank)
        chosen.append(pairs[mutual])
        taken = np.zeros(count, np.bool_)
        taken[pairs[mutual, :2]] = True
        pairs = pairs[~taken[pairs[:, :2]].any(axis=1)]
    return np.concatenate(chosen) if chosen else pairs


# Bodies that touch


def _parted(given: Surface, weld: Weld) -> Weld:
    """Give each body that only touches others vertices of its own.

    What the given faces connect by sharing a vertex is one body, unless two faces lie on each other
    there: these are the contact of two bodies.
    """
    surface = Surface.of_checked(given.points[weld.first], weld.faces)
    if surface.topology.is_solid:
        return weld
    group, closed = _joined_groups(given, *_closed_groups(surface))
    component = surface.components[surface.topology.faces[:, 0]]
    several = np.zeros(int(component.max()) + 1, np.int64)
    one_of = np.zeros(int(group.max()) + 1, np.int64)
    one_of[group] = component
    np.add.at(several, one_of, 1)
    apart = closed & (several[one_of] > 1)
    if not apart.any():
        return weld
    # One part of each component keeps its vertices: the parts that are not closed, else the first.
    whole = np.ones(len(several), np.bool_)
    whole[one_of[~apart]] = False
    first_part = np.unique(one_of, return_index=True)[1]
    apart[first_part[whole]] = False
    number = np.where(apart, np.cumsum(apart), 0)
    flat = weld.faces.ravel().astype(np.int64)
    keys = np.repeat(number[group], 3) * np.int64(len(weld.first)) + flat
    # Vertices stay where they are; further copies of shared vertices come after them.
    owner = np.full(len(weld.first), np.iinfo(np.int64).max)
    np.minimum.at(owner, flat, keys)
    copies = np.unique(keys[keys != owner[flat]])
    moved = keys != owner[flat]
    corners = flat.copy()
    corners[moved] = len(weld.first) + np.searchsorted(copies, keys[moved])
    return replace(
        weld,
        faces=corners.reshape(-1, 3).astype(np.int32),
        first=np.concatenate([weld.first, weld.first[copies % len(weld.first)]]),
        exact=max(weld.exact - len(copies), 0),
        parted=int(np.count_nonzero(closed & (several[one_of] > 1))),
    )


def _closed_groups(surface: Surface) -> tuple[IntArray, Mask, Index]:
    """Group the faces across paired half-edges.

    Returns
    -------
    group : (m,) int32
        Group of each face.
    closed : (g,) bool
        Groups that enclose a volume.
    contacts : (c, 2) int64
        Faces of several groups that lie on each other at an edge.
    """
    m, table = surface.face_count, surface.edge_table
    a, b, opposite = table.pairs
    sides, contacts = np.stack([a[opposite], b[opposite]], axis=1).astype(np.int64), _NO_PAIRS
    if (table.counts > 2).any():
        wedges, contacts = _wedges(surface)
        sides = np.concatenate([sides, wedges])
    group = piece_labels(m, sides // 3)
    count = int(group.max()) + 1
    paired = np.zeros(3 * m, np.bool_)
    paired[sides] = True
    closed = np.ones(count, np.bool_)
    closed[group[np.flatnonzero(~paired) // 3]] = False
    corners = surface.points[surface.topology.faces]
    weight = np.bincount(group, minlength=count)
    middle = np.stack([np.bincount(group, corners[:, :, k].mean(axis=1)) for k in range(3)], axis=1)
    corners = corners - (middle / weight[:, None])[group][:, None]
    volume = np.einsum("fa,fa->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    total, absolute = np.bincount(group, volume), np.bincount(group, np.abs(volume))
    contacts = contacts // 3
    contacts = contacts[group[contacts[:, 0]] != group[contacts[:, 1]]]
    return group, closed & (np.abs(total) > FLAT * absolute), contacts


def _joined_groups(
    given: Surface, group: IntArray, closed: Mask, contacts: Index
) -> tuple[IntArray, Mask]:
    """Join groups that share a given vertex, except for bodies with few faces on each other."""
    count = len(closed)
    corners = given.topology.faces.ravel()
    one_of = np.zeros(given.point_count, np.int64)
    one_of[corners] = np.repeat(group, 3)
    pairs = np.stack([np.repeat(group, 3), one_of[corners]], axis=1).astype(np.int64)
    keys = _pair_keys(pairs, count)
    touching = np.repeat(_pair_keys(group[contacts], count), 2)
    touching = np.unique(np.stack([touching, contacts.ravel()], axis=1), axis=0)
    sizes = np.bincount(group, minlength=count)
    key, faces = np.unique(touching[:, 0], return_counts=True)
    smaller = sizes[np.stack(np.divmod(key, count), axis=1)].min(axis=1)
    few = key[0.5 * faces < MAX_CONTACT * smaller]
    joined = (pairs[:, 0] != pairs[:, 1]) & ~np.isin(keys, few)
    label = piece_labels(count, pairs[joined])
    whole = np.ones(int(label.max()) + 1, np.bool_)
    whole[label[~closed]] = False
    return label[group], whole


def _pair_keys(pairs: NDArray[np.integer], count: int) -> Index:
    """One number for each unordered pair (k, 2) of numbers below `count`."""
    return pairs.min(axis=1).astype(np.int64) * count + pairs.max(axis=1)


_NO_PAIRS = np.empty((0, 2), np.int64)


def _wedges(surface: Surface) -> tuple[Index, Index]:
    """Pairs of half-edges at edges of more than two faces: across wedges of solids, and contacts.

    Round an edge, faces that enter a solid and faces that leave it alternate; where bodies touch, a
    face that leaves one lies on a face that enters the other, and is counted first: a contact.
    Edges where they do not alternate have no pairs.
    """
    table, points, corner = surface.edge_table, surface.points, surface.topology.faces.ravel()
    edge = np.repeat(np.arange(len(table.counts)), table.counts)
    rows = np.flatnonzero(table.counts[edge] > 2)
    half, edge = table.order[rows].astype(np.int64), edge[rows]
    low, high = points[table.low[edge]], points[table.high[edge]]
    axis = unit_rows(high - low)
    away = points[corner[next_side(next_side(half))]] - low
    away -= np.einsum("ij,ij->i", away, axis)[:, None] * axis
    begins = np.flatnonzero(np.diff(edge, prepend=-1))
    number = np.repeat(np.arange(len(begins)), np.diff(np.append(begins, len(edge))))
    x = unit_rows(away)[begins][number]
    y = np.cross(axis, x)
    angle = np.arctan2(np.einsum("ij,ij->i", away, y), np.einsum("ij,ij->i", away, x))
    angle = np.where(angle < -SAME_ANGLE, angle + 2 * np.pi, angle)
    leaves = table.forward[half]
    if _volume_sign(surface) < 0:
        leaves = ~leaves
    order, step = _by_angle(number, angle, leaves)
    half, leaves = half[order], leaves[order]
    onward = np.arange(1, len(half) + 1)
    onward[np.append(begins[1:], len(edge)) - 1] = begins
    alternating = np.ones(len(begins), np.bool_)
    alternating[number[leaves == leaves[onward]]] = False
    pairs = np.stack([half, half[onward]], axis=1)
    enters = ~leaves & alternating[number]
    return pairs[enters], pairs[leaves & alternating[number] & (step == step[onward])]


def _by_angle(number: Index, angle: FloatArray, leaves: Mask) -> tuple[Index, Index]:
    """Order of half-edges by edge and angle, of equal angles leaving ones first; their steps.

    Half-edges of the same edge and angle are of one step.
    """
    order = np.lexsort((angle, number))
    steps = np.diff(angle[order], prepend=-1.0) > SAME_ANGLE
    steps |= np.diff(number[order], prepend=-1) > 0
    step = np.empty(len(order), np.int64)
    step[order] = np.cumsum(steps)
    order = np.lexsort((~leaves, step))
    return order, step[order]


def _volume_sign(surface: Surface) -> float:
    middle = surface.points.mean(axis=0)
    corners = surface.points[surface.topology.faces] - middle
    inside = np.einsum("fa,fa->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    return float(np.sign(inside))
