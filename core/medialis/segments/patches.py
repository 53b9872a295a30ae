"""Patches: the faces of a surface between its edges, sharp or soft (thesis 6.3.1, 6.3.2).

`soft_edges` finds convex edges, sharp or blunt, at every scale: they lie in front of the rim of the
skeleton. `patches` divides a surface along them. Of a mesh faces are divided (`face_patches`): what
hangs together across no crease and no soft edge is a patch, patches between which the mesh hardly
turns are one (`joined_across_weak`). Of a cloud samples are divided.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import Mask, Ragged
from medialis.base.kept import Bound
from medialis.base.options import algorithm, angle, number
from medialis.base.progress import Progress
from medialis.base.threads import run_patiently
from medialis.base.validation import FloatArray, IntArray, frozen, hold
from medialis.shape.creases import bends_inward, crease_edges
from medialis.shape.graph import nearest_seeds, surface_graph
from medialis.shape.labels import (
    Segmentation,
    completed,
    connected_labels,
    diffused_labels,
    fill_components,
    merge_small,
    numbered_by_weight,
)
from medialis.shape.shape import Shape
from medialis.sheets.feature_sets import extended_feature_transform
from medialis.skeleton.medial_cloud import MedialCloud
from medialis.skeleton.preparation import EdgePreparation
from medialis.skeleton.surface_skeleton import balls_of, shape_or_cloud

SHARPER = 1.5  # halved 22 %, doubled 0 %
"""An edge bends this many times as sharply as the surface beside it, or it is none: a bore wall,
which is bent alike everywhere, has no edge of its own."""

LEAST_FACES = 8  # halved 12 %, doubled 22 %
"""A piece of fewer faces beside a soft edge is left over from the edge: it joins the nearest."""

DIFFUSION = 40  # halved 13 %, doubled 4 %
"""Steps by which borders in soft edges are straightened: they move by about six faces at most."""

SHORTENING = 4
"""Rounds in which borders that go to and fro are shortened; one is enough for a strip of quads."""

ROUNDING = 1e-9
"""Share by which lengths that are the same differ."""

LEAST_SAMPLES = 8  # halved 27 %, doubled 45 %
"""A piece between edges of fewer samples is no patch: it joins the nearest one."""

MOSTLY_ROUND = 0.5  # halved 0 %, doubled 0 %
"""Share of the surface on soft edges above which much of a shape is round: a box has 13 %, rounded
cylinder, fandisk and scapula 28 to 37; hand, creature, horse and cow 54 to 62, as have the rounded
castings of rockerarm and screwdriver."""


@dataclass(frozen=True, eq=False, repr=False)
class SoftEdges(Bound):
    """Edges as fields on the n samples of a surface.

    Attributes
    ----------
    radius : (n,) float64
        Radius of the smallest A3 ball that touches each sample, in the units of the shape: how
        blunt the edge is. inf where there is no edge.
    angle : (n,) float64
        Radians: by how much the surface turns across the edge, at most, over these balls; 0 where
        there is no edge.
    rim : (k,) bool
        True for the A3 balls.
    cloud : MedialCloud
        The k balls: inner ones lie behind convex edges, outer ones behind concave edges.

    Raises
    ------
    InvalidShapeError
        When the arrays do not have one value a sample or ball.
    """

    radius: FloatArray
    angle: FloatArray
    rim: Mask
    cloud: MedialCloud = field(kw_only=True)

    def __post_init__(self) -> None:
        n, k = self.cloud.surface.point_count, len(self.cloud)
        hold(self, radius=n, angle=n, rim=k)

    def __repr__(self) -> str:
        count = int(np.isfinite(self.radius).sum())
        return f"SoftEdges({count} of {len(self.radius)} samples on edges)"

    @property
    def sharpness(self) -> FloatArray:
        """Share of a right angle by which the surface turns across the edge, (n,), 0 to 1."""
        return np.minimum(self.angle / (np.pi / 2), 1.0)

    def on_edge(self, min_angle: float) -> Mask:
        """Return the samples on edges that turn by at least this many degrees, (n,)."""
        return self.angle >= max(math.radians(min_angle), np.finfo(np.float64).tiny)


@dataclass(frozen=True, kw_only=True)
class SoftEdgeOptions(EdgePreparation):
    """Options of `soft_edges`: only those of the balls, it has no scale to choose."""


@algorithm(SoftEdgeOptions, door=shape_or_cloud, prepare=balls_of)
def soft_edges(cloud: MedialCloud, options: SoftEdgeOptions, progress: Progress) -> SoftEdges:
    """Find the edges of a surface, with how blunt they are and how far they turn.

    Parameters
    ----------
    cloud : MedialCloud
        k balls. Inner balls find convex edges, outer ones concave edges.

    Returns
    -------
    SoftEdges

    See Also
    --------
    patches : the surface divided along its edges.
    extended_feature_transform : the samples that each ball touches.

    Notes
    -----
    The rim of the skeleton (A3 points) lies behind edges; every sample in the feature set of such a
    ball is on one. The angle across it follows from the normals: two walls that turn by 2 t have
    unit normals whose mean is cos(t) long.

    Source: thesis 6.3.1. Deviates: samples off every edge have the radius inf, not the largest
    distance; the angle is new.

    Examples
    --------
    >>> import medialis
    >>> edges = medialis.soft_edges(medialis.surface_skeleton(medialis.organic_shape(56)))
    >>> bool(edges.radius.min() < 0.03)  # the tips of ears and tail
    True
    """
    from medialis.sheets._kernels import smallest_at_samples

    sets = extended_feature_transform.of(cloud, options, progress)
    n = cloud.surface.point_count
    radius, angle = np.full(n, np.inf), np.zeros(n)
    turns = 2.0 * np.arccos(np.clip(np.nan_to_num(sets.agreement), 0.0, 1.0))
    members = sets.samples.offsets, sets.samples.indices
    smallest_at_samples(sets.rim, cloud.radii, turns, *members, radius, angle)
    return SoftEdges(radius, angle, sets.rim, cloud=cloud)


@dataclass(frozen=True, eq=False)
class FaceEdges:
    """The e edges between two faces of a mesh.

    Attributes
    ----------
    shape : Shape
    faces : (e, 2) int32
        The two faces at each edge.
    crease : (e,) bool
        Whether it divides them.
    length : (e,) float64
    """

    shape: Shape
    faces: IntArray
    crease: Mask
    length: FloatArray

    @classmethod
    def of(cls, shape: Shape, min_angle: float, kinds: tuple[bool, bool]) -> FaceEdges:
        """Find the edges; `kinds`: whether convex creases divide, and concave ones."""
        first, second, bent = crease_edges(shape, min_angle)
        bent &= np.where(bends_inward(shape, first, second), kinds[1], kinds[0])
        corners = np.asarray(shape.faces).ravel()
        along = shape.points[corners[first]] - shape.points[corners[second]]
        faces = np.stack([first // 3, second // 3], axis=1)
        return cls(shape, faces, bent, np.linalg.norm(along, axis=1))

    def graph(self, *, creases: bool) -> Ragged:
        """Return the neighbours of each face, across creases or not, m rows."""
        ends = self.faces if creases else self.faces[~self.crease]
        both = np.concatenate([ends, ends[:, ::-1]])
        rows = Ragged.group(both[:, 0], self.shape.face_count)
        return Ragged(rows.offsets, frozen(both[rows.indices, 1], np.int32))

    @cached_property
    def centers(self) -> FloatArray:
        """Middle of each face, (m, 3)."""
        return frozen(self.shape.points[np.asarray(self.shape.faces)].mean(axis=1), np.float64)

    def turns(self, faces: NDArray[Any]) -> tuple[FloatArray, FloatArray]:
        """Return by how much the surface turns between pairs of faces (e, 2), and their distances.

        Radians; positive where it bends inward.
        """
        normals = self.shape.face_normals[faces]
        away = self.centers[faces[:, 1]] - self.centers[faces[:, 0]]
        cross = np.linalg.norm(np.cross(normals[:, 0], normals[:, 1]), axis=1)
        turn = np.arctan2(cross, np.einsum("ij,ij->i", normals[:, 0], normals[:, 1]))
        inward = np.einsum("ij,ij->i", away, normals[:, 0] - normals[:, 1]) > 0
        return np.where(inward, turn, -turn), np.linalg.norm(away, axis=1)


def joined_across_weak(
    edges: FaceEdges,
    labels: IntArray,
    seed: IntArray,
    free: Mask,
    min_angle: float,
) -> IntArray:
    """Join patches where most of their common border is no edge.

    A border is an edge at a crease, and where the surface turns by `min_angle` between the faces
    off all edges that are nearest on both sides, more sharply than the patches themselves do.

    Parameters
    ----------
    edges : FaceEdges
    labels : (m,) int32
    seed : (m,) int32
        The nearest face off soft edges; -1: none.
    free : (m,) bool
        Faces off soft edges.
    min_angle : float
        Degrees.
    """
    ends = labels[edges.faces]
    border = (ends[:, 0] != ends[:, 1]) & ((seed[edges.faces] >= 0).all(axis=1) | edges.crease)
    rows, pair = np.flatnonzero(border), ends[border]
    turn, distance = edges.turns(seed[edges.faces[rows]])
    usual = _bend(edges, labels, free)[pair].mean(axis=1) * np.sign(turn)
    sharp = np.abs(turn) >= SHARPER * usual * distance
    edge = edges.crease[rows] | ((np.abs(turn) >= math.radians(min_angle)) & sharp)
    vote = np.where(edge, 1.0, -1.0) * edges.length[rows]
    return _joined(pair, vote, int(labels.max(initial=-1)) + 1)[labels]


def _joined(pair: NDArray[Any], vote: FloatArray, count: int) -> IntArray:
    """Join pairs with negative votes, the most negative first; the votes of joined pairs add up."""
    used, which = np.unique(np.sort(pair, axis=1), axis=0, return_inverse=True)
    total = np.bincount(which.reshape(-1), vote, minlength=len(used))
    votes: list[dict[int, float]] = [{} for _ in range(count)]
    waiting = []
    for (a, b), value in zip(used.tolist(), total.tolist(), strict=True):
        votes[a][b] = votes[b][a] = value
        if value < 0:
            waiting.append((value, a, b))
    heapq.heapify(waiting)
    target = np.arange(count, dtype=np.int32)
    while waiting:
        value, a, b = heapq.heappop(waiting)
        if votes[a].get(b) != value:
            continue  # one of them was joined, or their border grew
        target[target == b] = a
        del votes[a][b], votes[b][a]
        for other, more in votes[b].items():
            del votes[other][b]
            total_vote = votes[a].get(other, 0.0) + more
            votes[a][other] = votes[other][a] = total_vote
            if total_vote < 0:
                heapq.heappush(waiting, (total_vote, min(a, other), max(a, other)))
        votes[b] = {}
    return target


def _bend(edges: FaceEdges, labels: IntArray, free: Mask) -> FloatArray:
    """Mean curvature of each patch off its soft edges, positive where it bends inward."""
    ends, count = labels[edges.faces], int(labels.max(initial=-1)) + 1
    inside = (ends[:, 0] == ends[:, 1]) & free[edges.faces].all(axis=1) & ~edges.crease
    turn = edges.turns(edges.faces[inside])[0] * edges.length[inside]
    area = np.bincount(labels[free], edges.shape.face_areas[free], minlength=count)
    total = np.bincount(ends[inside, 0], turn, minlength=count)
    return np.divide(total, area, out=np.zeros(count), where=area > 0)


def face_patches(
    surface: Shape,
    soft: Mask,
    min_angle: float,
    kinds: tuple[bool, bool],
    smallest: float,
) -> Segmentation:
    """Divide the faces of a mesh along creases and through the middle of soft edges.

    Parameters
    ----------
    surface : Shape
        A mesh of n samples and m faces.
    soft : (n,) bool
        Samples on soft edges.
    min_angle : float
        Degrees by which the mesh bends at a crease.
    kinds : (convex, concave)
        Which creases divide.
    smallest : float
        Share of the surface below which a patch is merged.

    Notes
    -----
    Faces hang together across all edges but creases. Those at soft samples are taken out; what
    hangs together still is a patch, and the faces taken out join the nearest one that they hang
    together with. Two patches across whose common border the surface hardly turns are one. So
    creases are borders exactly, and each patch is connected.
    """
    edges = FaceEdges.of(surface, min_angle, kinds)
    across, smooth = edges.graph(creases=True), edges.graph(creases=False)
    area, every = surface.face_areas, np.ones(surface.face_count, np.bool_)
    corners = np.asarray(surface.faces)
    free = ~soft[corners].any(axis=1) & (area > 0)
    labels = _without_scraps(connected_labels(np.where(free, 0, -1), smooth), smooth)
    seed = nearest_seeds(edges.centers, smooth, labels >= 0)[0]
    labels = np.where(seed < 0, -1, labels[seed])
    labels = fill_components(connected_labels(0 * labels, smooth), labels, every)
    labels = joined_across_weak(edges, labels, seed, free, min_angle)
    labels = shortened(diffused_labels(labels, smooth, DIFFUSION), edges)
    labels = connected_labels(labels, smooth)
    for graph in (smooth, across):
        labels = merge_small(labels, area, graph, smallest * float(area.sum()))
    labels = numbered_by_weight(labels, area)
    return Segmentation(_of_samples(surface, labels), surface=surface, face_labels=labels)


def shortened(labels: IntArray, edges: FaceEdges) -> IntArray:
    """Give faces to the neighbour with which they share more border than with their own patch.

    A border in the middle of a strip of quads would go to and fro along its diagonals.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> ring = np.array([[0, 1], [1, 2], [2, 3], [3, 4], [4, 0]])
    >>> edges = SimpleNamespace(faces=ring, crease=np.zeros(5, bool), length=np.ones(5))
    >>> shortened(np.array([0, 0, 1, 0, 0], np.int32), edges).tolist()
    [0, 0, 0, 0, 0]
    """
    labels, within = labels.copy(), ~edges.crease
    face = np.concatenate([edges.faces[within, 0], edges.faces[within, 1]])
    beside = np.concatenate([edges.faces[within, 1], edges.faces[within, 0]])
    length = np.tile(edges.length[within], 2)
    for step in range(2 * SHORTENING):  # upwards and downwards: neighbours must not change places
        own, other = labels[face].astype(np.int64), labels[beside].astype(np.int64)
        rows = np.flatnonzero((other > own) if step % 2 == 0 else (other < own))
        if len(rows) == 0:
            continue
        inside = np.bincount(face, np.where(own == other, length, 0.0), minlength=len(labels))
        count = int(labels.max()) + 2
        pair, which = np.unique(face[rows] * count + other[rows] + 1, return_inverse=True)
        shared = np.bincount(which.reshape(-1), length[rows])
        of, wanted = pair // count, pair % count - 1
        better = shared > inside[of] * (1 + ROUNDING)
        order = np.flatnonzero(better)[np.argsort(shared[better], kind="stable")]
        labels[of[order]] = wanted[order]
    return labels


def _without_scraps(labels: IntArray, graph: Ragged) -> IntArray:
    """Take out pieces of few faces beside faces that are taken out."""
    face = np.repeat(np.arange(len(labels)), graph.lengths)
    beside = labels[face[labels[graph.indices] < 0]]
    count = int(labels.max(initial=-1)) + 1
    scrap = np.bincount(labels[labels >= 0], minlength=count) < LEAST_FACES
    scrap &= np.bincount(beside[beside >= 0], minlength=count) > 0
    return np.where((labels >= 0) & np.append(scrap, False)[labels], -1, labels).astype(np.int32)


def _of_samples(surface: Shape, labels: IntArray) -> IntArray:
    """Give each sample the largest patch that it touches; -1 to those without a face.

    So all samples of a crease have one label.
    """
    none = int(labels.max(initial=-1)) + 1
    result = np.full(surface.point_count, none, np.int32)
    np.minimum.at(result, np.asarray(surface.faces), labels[:, None])
    return np.where(result == none, -1, result).astype(np.int32)


@dataclass(frozen=True, kw_only=True)
class PatchesOptions(EdgePreparation):
    """Options of `patches`.

    At 30 degrees, gears, fandisk and rockerarm are divided along the edges that one would draw, and
    the body of the horse stays one patch.
    """

    min_angle: float = angle(
        30.0,
        "Minimum angle",
        "Edges across which the surface turns by less do not separate patches.",
    )
    smallest: float = number(
        0.002,
        "Smallest patch",
        "A patch that covers less than this share of the surface is merged into the "
        "neighbour with the longest common border. 0 keeps all.",
    )


@algorithm(PatchesOptions, door=shape_or_cloud, prepare=balls_of)
def patches(cloud: MedialCloud, options: PatchesOptions, progress: Progress) -> Segmentation:
    """Divide a surface into patches along its edges, sharp or soft.

    Parameters
    ----------
    cloud : MedialCloud
        k balls: inner ones for convex edges, outer ones for concave edges, or both.

    Returns
    -------
    Segmentation
        Every sample has a patch; components of the surface are never joined.

    See Also
    --------
    soft_edges : the edges, as fields on the surface.
    parts : limbs and bodies, or sheets, instead of faces.

    Notes
    -----
    A mesh is divided by its faces: they hang together across all edges of the mesh but creases,
    and those at samples on soft edges (`medialis.soft_edges`) are taken out. What stays connected
    is a patch, and the faces of the soft edges join the nearest one. Patches are one where the
    surface turns by less than `min_angle` across their border, or no more sharply than beside it,
    as in a bore. So patches are connected, and borders follow creases exactly. A sample at a border
    has the largest patch that it touches. A cloud is divided by its samples, without creases.

    Source: thesis 6.3.2. Deviates: creases of a mesh are borders, weak edges do not count, small
    pieces are merged, and with outer balls concave edges separate as well.

    Examples
    --------
    >>> import medialis
    >>> x = [[x, y, z] for x in (0, 4) for y in (0, 3) for z in (0, 2)]
    >>> q = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> faces = [t for a, b, c, d in q for t in ((a, b, c), (a, c, d))]
    >>> box = medialis.make_shape(x, faces)
    >>> medialis.patches(medialis.surface_skeleton(box)).count
    6
    """
    edges, surface = soft_edges.of(cloud, options, progress), cloud.surface
    _note_round(edges, options.min_angle, progress)
    kinds = bool((cloud.side > 0).any()), bool((cloud.side < 0).any())

    def divide() -> Segmentation:
        soft = edges.on_edge(options.min_angle)
        if surface.faces is not None:
            return face_patches(surface, soft, options.min_angle, kinds, options.smallest)
        labels = connected_labels(np.where(soft, -1, 0).astype(np.int32), surface_graph(surface))
        size = np.bincount(labels[labels >= 0], minlength=1)
        labels[size[labels] < LEAST_SAMPLES] = -1
        return completed(surface, labels, options.smallest, fill=True)

    return run_patiently(divide, progress)


def _note_round(edges: SoftEdges, min_angle: float, progress: Progress) -> None:
    """Say that much of a shape is round, so that no one takes all of its patches for faces."""
    areas = edges.cloud.surface.point_areas
    share = float(areas[edges.on_edge(min_angle)].sum() / max(areas.sum(), 1e-300))
    if share > MOSTLY_ROUND:
        text = (
            f"{100 * share:.0f} % of the surface is round, where patches end in the middle of "
            "nothing. Parts divide limbs; a larger minimum angle leaves the sharper edges."
        )
        progress.note(text, "few_edges", share=share)
