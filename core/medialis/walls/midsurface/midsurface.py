"""The midsurface of a solid of walls: sheets for shell elements, welded where they meet.

From balls to the midsurface: sides of walls become sheets, which are cut along each other; curves
are made even, and the sheets inside them. Then all are one mesh with shared vertices at welds,
sheets numbered through. Lumps are what of the solid is no wall, with their share of the volume.
"""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from medialis.base.arrays import Described, Index, rows_of_labels, twice_areas
from medialis.base.errors import InvalidShapeError
from medialis.base.options import Options, algorithm, angle, length
from medialis.base.progress import Progress
from medialis.base.threads import run_patiently
from medialis.base.validation import FloatArray, IntArray, Positions, hold
from medialis.medial_meshes.sampling import Solid
from medialis.shape.shape import Shape
from medialis.shape.surface import piece_labels
from medialis.skeleton.medial_cloud import MedialCloud
from medialis.skeleton.surface_skeleton import Preparation, as_cloud

if TYPE_CHECKING:
    from medialis.walls.midsurface.curves import Curve
    from medialis.walls.midsurface.junctions import CutSheet


@dataclass(frozen=True)
class Lump:
    """A part of a solid that is no wall.

    Attributes
    ----------
    share : float
        Of the volume of the solid.
    position : tuple of float
        A place in its middle.
    """

    share: float
    position: tuple[float, float, float]


@dataclass(frozen=True, eq=False, repr=False)
class Midsurface(Described):
    """Triangles in the middle of walls.

    Attributes
    ----------
    points : (n, 3) float64
        In the units of the shape. Sheets that meet have the same vertices at their weld.
    faces : (m, 3) int32
    thickness : (n,) float64
        Of the wall at each vertex; at a weld that of the thickest one.
    face_thickness : (m,) float64
        Of the wall that each face is in.
    sheet : (m,) int32
        The sheet of each face, the largest first.
    weld_edges : (e, 2) int32
        Edges where sheets meet.
    weld : (e,) int32
        The weld curve of each.
    lumps : tuple of Lump
        What is no wall, the largest first.
    wall_share : float or None
        Share of the volume of the solid that lies in the walls; None: the mesh is open.
    """

    points: Positions
    faces: IntArray
    thickness: FloatArray
    face_thickness: FloatArray
    sheet: IntArray
    weld_edges: IntArray
    weld: IntArray
    lumps: tuple[Lump, ...] = ()
    wall_share: float | None = None

    def __post_init__(self) -> None:
        n, m, e = len(self.points), len(self.faces), len(self.weld)
        hold(self, points=(n, 3), faces=(m, 3), thickness=n, face_thickness=m, sheet=m)
        hold(self, weld_edges=(e, 2), weld=e)

    @property
    def sheets(self) -> int:
        """How many sheets there are."""
        return int(self.sheet.max(initial=-1)) + 1

    @property
    def welds(self) -> int:
        """How many curves there are at which sheets meet."""
        return int(self.weld.max(initial=-1)) + 1

    @cached_property
    def areas(self) -> FloatArray:
        """Area of each face, (m,)."""
        return twice_areas(self.points, self.faces) / 2

    def of_sheet(self, number: int) -> dict[str, float | int]:
        """Return area, number of faces, and mean, smallest and largest thickness of one sheet."""
        mine = self.sheet == number
        area, values = self.areas[mine], self.face_thickness[mine]
        return {
            "sheet": number,
            "area": float(area.sum()),
            "faces": int(mine.sum()),
            "thickness_mean": float((area * values).sum() / max(float(area.sum()), 1e-300)),
            "thickness_min": float(values.min()),
            "thickness_max": float(values.max()),
        }


PLACES = 12_000  # halved 5 %, doubled 2 %
"""Of a grid inside of the solid that tell how much of it is wall: shares are good to 1 %."""

MOST_CELLS = 600_000  # halved 0 %, doubled 0 %
"""Of the grid, those outside included: thin shells get fewer places."""

BESIDE = 1.5  # halved 100 %, doubled 100 %
"""Half thicknesses: what is nearer to a sheet is wall, also the outer corner of two at right
angles, 1.41 away from their weld."""

LEAST_SHARE = 0.005  # halved 0 %, doubled 0 %
"""Of the volume: smaller lumps are fillets and the like, and not named."""


def find_lumps(shape: Shape, sheets: Midsurface) -> tuple[tuple[Lump, ...], float]:
    """Return the lumps of a solid, the largest first, and the share of the volume that is wall.

    Parameters
    ----------
    shape : Shape
        A closed mesh.
    sheets : Midsurface
        Of at least one sheet.
    """
    from medialis.base.box_tree import NearestTree, nearest_on_triangles

    low, high = shape.bounds
    size = shape.diagonal
    solid = Solid((shape.points - low) / size, np.asarray(shape.faces))
    volume = abs(float(np.einsum("ia,ia->", shape.points[np.asarray(shape.faces)[:, 0]] - low,
                                 shape.face_vectors)) / 6) / size**3  # fmt: skip
    span = (high - low) / size
    cell = (max(volume / PLACES, float(np.prod(span)) / MOST_CELLS)) ** (1 / 3)
    count = np.maximum(1, np.ceil(span / cell).astype(np.int64))
    steps = [(np.arange(n) + 0.5) / n * s for n, s in zip(count, span, strict=True)]
    grid = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 3)
    inside = np.flatnonzero(solid.contains(grid))
    if len(inside) == 0:
        return (), 1.0
    places = grid[inside] * size + low
    tree = NearestTree.of_triangles(sheets.points, np.asarray(sheets.faces))
    distance, row = tree.distances(places)
    corners = np.asarray(sheets.faces)[row]
    weights = nearest_on_triangles(places, sheets.points[corners])
    half = np.einsum("qj,qj->q", weights, sheets.thickness[corners]) / 2
    outside = np.flatnonzero(distance > BESIDE * half)
    label = _pieces(inside[outside], count)
    found = []
    for rows in rows_of_labels(label):
        mine = places[outside[rows]]
        share = len(mine) / len(inside)
        if share >= LEAST_SHARE:
            x, y, z = mine[np.linalg.norm(mine - mine.mean(axis=0), axis=1).argmin()].tolist()
            found.append(Lump(share, (x, y, z)))
    found.sort(key=lambda lump: (-lump.share, lump.position))
    return tuple(found), 1.0 - len(outside) / len(inside)


def _pieces(cells: Index, count: Index) -> IntArray:
    """Give a number to each piece of cells of a grid that hang together through their sides."""
    row = np.full(int(np.prod(count)), -1)
    row[cells] = np.arange(len(cells))
    place = np.stack(np.unravel_index(cells, tuple(count)), axis=1)
    links = []
    for axis in range(3):
        step = np.zeros(3, np.int64)
        step[axis] = 1
        fits = place[:, axis] + 1 < count[axis]
        there = row[np.ravel_multi_index(tuple((place[fits] + step).T), tuple(count))]
        links.append(np.stack([np.flatnonzero(fits), there], axis=1)[there >= 0])
    return np.asarray(piece_labels(len(cells), np.concatenate(links)))


STRAIGHT_ON = math.cos(math.radians(15.0))  # halved 0 %, doubled 0 %
"""Cosine of the turn up to which a sheet goes on into another one of the same thickness."""

ALIKE = 0.05  # halved 0 %, doubled 0 %
"""Share of the thickness by which these may differ."""

SAME_CURVE = math.cos(math.radians(30.0))  # halved 0 %, doubled 48 %
"""Cosine of the turn up to which a weld goes on past a place where others meet it."""


def assembled(
    sheets: list[CutSheet],
    numbers: list[dict[int, int]],
    places: FloatArray,
    curves: list[Curve],
    nodes: int,
) -> Midsurface:
    """Put the meshes of all sheets together, vertex by vertex at their curves.

    Parameters
    ----------
    sheets : list of CutSheet
        Remeshed.
    numbers : list of dict
        The number of each vertex of a sheet that lies on a curve.
    places : (k, 3) float64
        Of these numbers.
    curves : list of Curve
    nodes : int
        How many of the places are nodes, the first ones.
    """
    points, faces, means, owner, values = [places], [], [], [], []
    count, halves = len(places), np.zeros(len(places))
    for s, (sheet, known) in enumerate(zip(sheets, numbers, strict=True)):
        mesh = sheet.mesh
        corners = mesh.faces[: mesh.face_count][mesh.alive]
        used = np.unique(corners)
        number = np.full(mesh.vertex_count, -1, np.int64)
        for v, k in known.items():
            number[v] = k
        own = used[number[used] < 0]
        number[own] = count + np.arange(len(own))
        half = np.zeros(mesh.vertex_count)
        if len(used):
            half[used] = sheet.raw.at(mesh.points[used])[1]
        shared = used[number[used] < len(places)]
        np.maximum.at(halves, number[shared], half[shared])
        points.append(mesh.points[own])
        values.append(half[own])
        faces.append(number[corners])
        means.append(half[corners].mean(axis=1))
        owner.append(np.full(len(corners), s, np.int32))
        count += len(own)
    every = np.concatenate(points)
    triangles = np.concatenate(faces).reshape(-1, 3)
    fine = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
    triangles = triangles[fine]
    used, compact = np.unique(triangles, return_inverse=True)
    new = np.full(len(every), -1, np.int64)
    new[used] = np.arange(len(used))
    half = np.concatenate([halves, *values])
    mean = np.concatenate(means)[fine]
    raw_sheet = np.concatenate(owner)[fine]
    mesh_faces = compact.reshape(-1, 3).astype(np.int32)
    edges, of_edge = _weld_edges(curves, nodes, new)
    label = _numbered(every[used], mesh_faces, raw_sheet, 2 * mean, edges, len(sheets))
    edges, weld = _weld_curves(every[used], mesh_faces, label, edges, of_edge)
    return Midsurface(every[used], mesh_faces, 2 * half[used], 2 * mean, label, edges, weld)


def _weld_edges(curves: list[Curve], nodes: int, new: Index) -> tuple[IntArray, IntArray]:
    """Return the edges of all curves of several sheets, and the curve of each."""
    result, of_edge, first = [], [], nodes
    for k, curve in enumerate(curves):
        inner = first + np.arange(len(curve.places) - 2)
        first += len(inner)
        if len(curve.chains) < 2:
            continue
        line = new[np.concatenate([[curve.nodes[0]], inner, [curve.nodes[1]]])]
        result.append(np.stack([line[:-1], line[1:]], axis=1))
        of_edge.append(np.full(len(line) - 1, k, np.int32))
    if not result:
        return np.empty((0, 2), np.int32), np.empty(0, np.int32)
    edges, of_all = np.concatenate(result).astype(np.int32), np.concatenate(of_edge)
    there = (edges >= 0).all(axis=1) & (edges[:, 0] != edges[:, 1])
    return edges[there], of_all[there]


def _at_edges(faces: IntArray, edges: IntArray, count: int) -> dict[tuple[int, int], list[int]]:
    """Return the faces at each of some edges."""
    wanted = {(min(a, b), max(a, b)) for a, b in edges.tolist()}
    result: dict[tuple[int, int], list[int]] = defaultdict(list)
    if not wanted:
        return result
    on = np.zeros(count, np.bool_)
    on[edges] = True
    rows = np.flatnonzero(on[faces].sum(axis=1) >= 2)
    for row in rows.tolist():
        corners = faces[row].tolist()
        for j in range(3):
            a, b = corners[j], corners[(j + 1) % 3]
            key = (min(a, b), max(a, b))
            if key in wanted:
                result[key].append(row)
    return result


def _numbered(
    points: FloatArray,
    faces: IntArray,
    raw_sheet: IntArray,
    thickness: FloatArray,
    edges: IntArray,
    count: int,
) -> IntArray:
    """Give sheets numbers, the largest first; those that go straight on into others share one."""
    votes: dict[tuple[int, int], float] = defaultdict(float)
    for (a, b), rows in _at_edges(faces, edges, len(points)).items():
        along = points[b] - points[a]
        length = float(np.linalg.norm(along))
        outward = []
        for row in rows:
            tip = points[int(faces[row].sum()) - a - b] - points[a]
            away = tip - (tip @ along) * along / max(length * length, 1e-300)
            outward.append(away / max(float(np.linalg.norm(away)), 1e-300))
        sheets = raw_sheet[rows].tolist()
        single = [i for i, s in enumerate(sheets) if sheets.count(s) == 1]
        for p, i in enumerate(single):
            for j in single[p + 1 :]:
                pair = (min(sheets[i], sheets[j]), max(sheets[i], sheets[j]))
                one, two = float(thickness[rows[i]]), float(thickness[rows[j]])
                on = float(outward[i] @ outward[j]) < -STRAIGHT_ON
                alike = abs(one - two) <= ALIKE * min(one, two)
                votes[pair] += length if on and alike else -length
    links = np.array([pair for pair, vote in votes.items() if vote > 0], np.int64).reshape(-1, 2)
    joined = piece_labels(count, links)[raw_sheet]
    area = np.bincount(joined, twice_areas(points, faces), minlength=count)
    order = np.lexsort((np.arange(count), -area))
    rank = np.empty(count, np.int32)
    rank[order] = np.arange(count)
    return np.asarray(rank[joined])


def _weld_curves(
    points: FloatArray, faces: IntArray, sheet: IntArray, edges: IntArray, of_edge: IntArray
) -> tuple[IntArray, IntArray]:
    """Return the edges at which sheets meet, and the weld of each: curves of the same sheets."""
    at = _at_edges(faces, edges, len(points))
    meeting: dict[int, frozenset[int]] = {}
    keep = []
    for i, (a, b) in enumerate(edges.tolist()):
        rows = at.get((min(a, b), max(a, b)), [])
        labels = frozenset(sheet[rows].tolist())
        if len(rows) > 2 or len(labels) > 1:
            keep.append(i)
            meeting.setdefault(int(of_edge[i]), labels)
    edges, of_edge = edges[keep], of_edge[keep]
    pieces = sorted(meeting)
    index = {k: i for i, k in enumerate(pieces)}
    ends: dict[int, list[tuple[int, FloatArray]]] = defaultdict(list)
    for k in pieces:
        mine = edges[of_edge == k]
        count = np.bincount(mine.ravel(), minlength=len(points))
        for v in np.flatnonzero(count == 1).tolist():
            row = mine[(mine == v).any(axis=1)][0]
            away = points[int(row.sum()) - v] - points[v]
            ends[v].append((k, away / max(float(np.linalg.norm(away)), 1e-300)))
    links = [
        (index[k], index[q])
        for around in ends.values()
        for i, (k, one) in enumerate(around)
        for q, two in around[i + 1 :]
        if meeting[k] == meeting[q] and float(one @ two) < -SAME_CURVE
    ]
    label = piece_labels(len(pieces), np.array(links, np.int64).reshape(-1, 2))
    number = np.unique(label, return_inverse=True)[1] if len(label) else label
    weld = np.array([number[index[int(k)]] for k in of_edge.tolist()], np.int32)
    return edges.astype(np.int32), weld


@dataclass(frozen=True, kw_only=True)
class MidsurfaceOptions(Options):
    """Options of `midsurface`."""

    edge: float = length(
        0.02,
        "Edge length",
        "Length of the edges of the triangles, as a share of the size.",
        low=1e-4,
        high=0.5,
    )
    angle: float = angle(
        150.0,
        "Least angle",
        "Walls lie between balls that touch both of their sides at a wider angle than this, seen "
        "from the center of the ball: two flat walls may be inclined by 180 degrees less this.",
        low=90.0,
        high=179.0,
        advanced=True,
    )


@algorithm(MidsurfaceOptions, door=as_cloud)
def midsurface(cloud: MedialCloud, options: MidsurfaceOptions, progress: Progress) -> Midsurface:
    """Compute the midsurface of a solid of walls, as an even triangle mesh.

    Parameters
    ----------
    cloud : MedialCloud
        Inner balls of a closed mesh.

    Returns
    -------
    Midsurface

    Raises
    ------
    InvalidShapeError
        When the balls do not lie in a mesh.

    See Also
    --------
    thickness : how thick walls are, on the surface.
    medial_mesh : the medial axis with its branches into edges.

    Notes
    -----
    Where the ball of a sample touches the opposite wall, its center is a point of the midsurface.
    The faces on one side of a wall are moved to these centers, and go on over ribs and up to the
    edges of the side with a linear thickness, so rims are where they should be. Sheets are extended
    straight on where they end within the solid, cut along each other, and what lies between no
    opposite walls is taken away. Curves get even vertices that all sheets share, and the rest of
    each sheet even triangles (Botsch and Kobbelt 2004). Not in the thesis.

    Examples
    --------
    >>> import medialis
    >>> x = [[x, y, z] for x in (0, 40) for y in (0, 30) for z in (0, 2)]
    >>> q = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> faces = [t for a, b, c, d in q for t in ((a, b, c), (a, c, d))]
    >>> middle = medialis.midsurface(medialis.make_shape(x, faces))
    >>> middle.sheets, round(float(middle.areas.sum()), 6), round(float(middle.thickness.max()), 6)
    (1, 1200.0, 2.0)
    """
    from medialis.base.box_tree import NearestTree
    from medialis.walls.midsurface.curves import find_chains, find_curves, forget_lost, lay_curves
    from medialis.walls.midsurface.junctions import cut_sheets, join_steps, tidy_borders
    from medialis.walls.midsurface.remeshing import remesh
    from medialis.walls.midsurface.sides import find_sides, raw_sheets

    shape = cloud.surface
    if shape.faces is None:
        raise InvalidShapeError("A midsurface is computed from a mesh, got a point cloud.")
    crease = next(p.default for p in Preparation.parameters() if p.name == "creases")
    edge, balls = options.edge * shape.diagonal, cloud.inner.own
    progress.update(0.0)
    sides = find_sides(balls, math.radians(options.angle), crease)
    raws = raw_sheets(sides)
    if not raws:
        none: Any = np.empty(0)
        threes, pairs = none.reshape(0, 3), none.reshape(0, 2)
        return Midsurface(threes, threes, none, none, none, pairs, none)
    progress.update(0.3)
    sheets = cut_sheets(raws)
    surface = NearestTree.of_triangles(shape.points, np.asarray(shape.faces))
    join_steps(sheets, surface)
    tidy_borders(sheets, surface)
    forget_lost(sheets)
    chains, nodes = find_chains(sheets)
    curves = find_curves(sheets, chains, nodes, edge)
    kinds, numbers, places = lay_curves(sheets, curves, nodes)
    for s, (sheet, kind) in enumerate(zip(sheets, kinds, strict=True)):
        begin, end = (0.5 + 0.5 * (s + step) / len(sheets) for step in (0, 1))
        with progress.stage("triangles", begin, end):
            remesh(sheet.mesh, kind, sheet.raw, edge, progress)
    found = assembled(sheets, numbers, places, curves, len(nodes))
    if not shape.closed_components.all():
        return found
    lumps, share = run_patiently(lambda: find_lumps(shape, found), progress)
    return replace(found, lumps=lumps, wall_share=share)
