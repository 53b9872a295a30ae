"""Weights with which the bones of any armature move any mesh, by the ways inside the body.

Steps: the pieces that bones run through (`_hanging`; the others follow them, see `pieces.py`), and
the lines along which bones act (`deforming.py`); a grid over the mesh and the bones (`_grid`),
whose cells are inside by six rays each, so that holes, pieces and inner faces do no harm; the
cheapest bones of each cell, by ways that stay inside (`_way_kernels.py`); the nearest bones of each
vertex, by the cells behind it (`_nearest`); weights smoothed along the surface over the distance to
the bone, and the same for a whole piece that is smaller than that distance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from medialis.base.arrays import Index, Mask, enclosed_volume, kd_tree, rows_of_labels
from medialis.base.errors import InvalidOptionError, InvalidShapeError
from medialis.base.options import Options, algorithm, number, whole
from medialis.base.progress import Progress
from medialis.base.threads import run_patiently
from medialis.base.validation import FloatArray, IntArray
from medialis.rigging.armature import Armature
from medialis.rigging.bones import MOST_BONES, Bones, SkinWeights, smoothed_weights, stiffness
from medialis.rigging.deforming import Segments, deforming, is_eye, segments_of
from medialis.rigging.pieces import hung_weights
from medialis.shape.reading import as_shape
from medialis.shape.shape import Shape
from medialis.shape.union import enclosing_pieces

if TYPE_CHECKING:
    from medialis.rigging._way_kernels import Grid, Ways

CELLS, INSIDE = 1_000_000, 150_000
"""Cells of the grid, and of those inside, at most, about: a figure of 1.8 m with spread arms has
cells of 11 mm."""

MARGIN = 2
"""Cells around the mesh and the bones."""

SHIFT = (0.3819660, 0.4142136, 0.2679492)
"""Where the grid begins, in cells: centers do not fall on the planes that modelled meshes have."""

KEPT = 3
"""Bones that are looked at for each vertex."""

OUTSIDE = 4.0
"""Times its length that a way outside the body costs."""

BAND = 2
"""Cells from the surface that ways lead through outside; what lies farther off follows others."""

FEE = 4.0
"""Diagonals of the grid that a face between two cells costs: more than any way."""

FURTHER = 0.25
"""Share past the last wanted cell to which the search goes on, for the second bone of each."""

DETOUR = 1.13
"""Times the straight distance that a straight way along 26 neighbours measures at most."""

NEARLY = 0.01
"""Share of the distance within which two bones are equally near."""

BEYOND = 0.1
"""Fraction by which the distance from a bone is larger straight beyond its joint."""

BONE_SAMPLES = 200
"""Number of samples of a bone as long as the diagonal: they show which pieces it runs through."""

BALL, CENTERED, CUBE = 0.15, 0.15, 0.6
"""Maximum size of a ball joint, as a fraction of the diagonal of the shape; maximum distance of its
middle from the joint, as a fraction of its own size; minimum ratio of the sides of its box."""

KNUCKLE = 0.04
"""Minimum size of a ball joint, as a fraction of the diagonal: smaller ones are knuckles, whose
halves follow different bones."""

PASSES = 20
"""Times that weights are smoothed once bones were left out."""

LARGEST_LIMIT = 8
"""Bones that may move one vertex."""

INSIDE_VOTES = 4
"""Of six rays that say inside; a hole spoils one of them."""


@dataclass(frozen=True, kw_only=True)
class Weighing(Options):
    """How weights are shared and smoothed."""

    bones_per_vertex: int = whole(
        MOST_BONES, "Bones per vertex", "At most this many bones move a vertex.", low=1,
        high=LARGEST_LIMIT,
    )  # fmt: skip
    softness: float = number(
        0.5,
        "Softness",
        "Weights are smoothed along the surface over this times the distance to the bone. 0 is "
        "stiff.",
        high=4.0,
    )


@dataclass(frozen=True, kw_only=True)
class BindOptions(Weighing):
    """Options of `bind_weights`."""

    armature: Armature | Bones


@algorithm(BindOptions, door=as_shape)
def bind_weights(shape: Shape, options: BindOptions, progress: Progress) -> SkinWeights:
    """Compute the weights with which the bones of an armature move a mesh.

    The nearest bone of a vertex is the one with the shortest way inside the body, so a hand on the
    hip does not move it. A way may leave the body, or pass a face, but pays for it: so no vertex is
    without a bone, however broken the mesh is. Weights are smoothed along the surface. A piece of
    the mesh that is smaller than its distance to the bone moves as a whole.

    Parameters
    ----------
    shape : Shape, path, (vertices, faces), or mesh of another library
        A mesh of n vertices. It may have holes, several pieces, inner faces, and no inside at all.
    armature : Armature or Bones
        In the place and size of the shape.

    Returns
    -------
    SkinWeights
        Every vertex has one to four bones, and weights that sum to 1.

    Raises
    ------
    InvalidShapeError
        When the shape has no faces, or no bone comes near it.

    See Also
    --------
    skin_weights : of bones along the curve skeleton of the shape.

    Notes
    -----
    Distances in voxels as Dionne and de Lasa (2013) take them, smoothed as the heat weights of
    Baran and Popovic (2007). Cost: a grid of a million cells, and one sparse factorization. Source:
    none; the thesis has no rigging.

    Examples
    --------
    >>> import medialis
    >>> shape = medialis.organic_shape(56)
    >>> low, high = (float(end[2]) for end in shape.bounds)
    >>> heads, tails = [[0, 0, low], [0, 0, 0]], [[0, 0, 0], [0, 0, high]]
    >>> spine = medialis.Armature(heads, tails, [-1, 0])
    >>> skin = medialis.bind_weights(shape, armature=spine)
    >>> round(float(skin.weights.sum(axis=1).min()), 12), int(skin.bones[:, 0].max())
    (1.0, 1)
    """
    armature = options.armature
    if not isinstance(armature, Armature | Bones):
        raise InvalidOptionError(
            f"armature must be an Armature or Bones, got {type(armature).__name__}."
        )
    if shape.faces is None:
        raise InvalidShapeError(
            f"Binding needs a mesh, got {shape.point_count:,} points without faces: reconstruct a "
            "surface first."
        )
    _require_near(shape, armature)
    return run_patiently(lambda: _bound(shape, armature, options), progress)


def _require_near(shape: Shape, armature: Armature | Bones) -> None:
    """Refuse an armature that lies beside the shape."""
    low, high = shape.bounds
    margin = 0.5 * shape.diagonal
    joints = np.stack([armature.heads, armature.tails], axis=1)
    away = np.maximum(joints.min(axis=1) - high, low - joints.max(axis=1)).max(axis=1)
    if (away > margin).all():
        raise InvalidShapeError(
            f"No bone lies at the shape: the nearest of {armature.count} is {away.min():.4g} away, "
            f"and the shape is {shape.diagonal:.4g} large. Give an armature of the same place, "
            "size and axes."
        )


def _bound(shape: Shape, armature: Armature | Bones, options: Weighing) -> SkinWeights:
    moves = deforming(armature)
    turned = _turned_pieces(shape, armature, moves)
    moves = moves & ~np.array([is_eye(name) for name in armature.names])
    lines = segments_of(armature, moves if moves.any() else ~moves)
    hanging = _hanging(shape, lines)
    if hanging is None:
        skin = _of_body(shape, lines, options)
    else:
        body, rows, _ = shape.some_bodies(~hanging)
        own = _of_body(body, lines, options)
        bones = np.full((shape.point_count, own.bones.shape[1]), -1, np.int32)
        weights = np.zeros(bones.shape)
        bones[rows], weights[rows] = own.bones, own.weights
        skin = hung_weights(SkinWeights(bones, weights), shape, hanging)
    if not (turned >= 0).any():
        return skin
    bones, weights = np.array(skin.bones), np.array(skin.weights)
    rows = np.flatnonzero(turned >= 0)
    bones[rows], weights[rows] = -1, 0.0
    bones[rows, 0], weights[rows, 0] = turned[rows], 1.0
    return SkinWeights(bones, weights)


def _of_body(shape: Shape, lines: Segments, options: Weighing) -> SkinWeights:
    """Weigh the bones at each vertex by the ways to them."""
    skin, far = _nearest(shape, lines)
    most = options.bones_per_vertex
    if options.softness > 0 and len(np.unique(lines.bone)) > 1:
        width = options.softness * far
        smooth = _limited(smoothed_weights(skin, shape, width, most + 1), most)
        skin = _smoothed_within(smooth, skin, shape, width)
    return _whole_pieces(_limited(skin, most), shape, far)


def _hanging(shape: Shape, lines: Segments) -> Mask | None:
    """Return the points of pieces that no bone runs through, (n,); None if there are none.

    A bone outside of all pieces runs through the nearest one: hair strips and skirts enclose no
    volume, but may have bones of their own.
    """
    if shape.part_count < 2:
        return None
    counts = np.ceil(BONE_SAMPLES * np.linalg.norm(lines.tails - lines.heads, axis=1)
                     / shape.diagonal).astype(np.int64) + 2  # fmt: skip
    line = np.repeat(np.arange(len(counts)), counts)
    step = np.arange(len(line)) - np.repeat(np.cumsum(counts) - counts, counts)
    share = (step / np.repeat(counts - 1, counts))[:, None]
    places = (1 - share) * lines.heads[line] + share * lines.tails[line]
    inside = enclosing_pieces(shape, places)
    through = np.zeros(int(shape.components.max()) + 1, np.bool_)
    through[inside.pieces] = True
    outside = np.setdiff1d(np.arange(len(places)), inside.rows)
    if len(outside):
        used = np.flatnonzero(shape.used_points)
        near = kd_tree(shape.points[used]).query(places[outside])[1]
        through[shape.components[used[near]]] = True
    hanging = ~through[shape.components]
    return hanging if through.any() and hanging.any() else None


def _turned_pieces(shape: Shape, armature: Armature | Bones, moves: Mask) -> IntArray:
    """Return the bone that turns the piece of each point as a whole, (n,), -1: none.

    Such a piece is small, and its middle is at the head of the bone: an eyeball, or a ball joint,
    which is as long as it is wide and has no other joint inside.
    """
    found = np.full(shape.point_count, -1, np.int32)
    if shape.part_count < 2:
        return found
    bones = np.flatnonzero(moves)
    heads = armature.heads[bones]
    eye = np.array([is_eye(armature.names[bone]) for bone in bones.tolist()])
    for rows in rows_of_labels(shape.components):
        low, high = shape.points[rows].min(axis=0), shape.points[rows].max(axis=0)
        sides = high - low
        size = float(np.linalg.norm(sides))
        if not 0 < size <= BALL * shape.diagonal:
            continue
        away = np.linalg.norm(heads - (low + high) / 2, axis=1)
        nearest = int(away.argmin())
        within = ((heads >= low) & (heads <= high)).all(axis=1)
        apart = np.linalg.norm(heads - heads[nearest], axis=1) > CENTERED * size
        ball = size >= KNUCKLE * shape.diagonal and sides.min() >= CUBE * sides.max()
        ball = ball and not (within & apart).any()
        if away[nearest] <= (0.5 if eye[nearest] else CENTERED * ball) * size:
            found[rows] = bones[nearest]
    return found


def _limited(skin: SkinWeights, most: int) -> SkinWeights:
    """Keep the heaviest bones of each vertex, less what the next one weighs: so none jumps."""
    if skin.bones.shape[1] <= most:
        return skin
    weights = skin.weights[:, :most] - skin.weights[:, most, None]
    weights[weights[:, 0] <= 0, 0] = 1.0
    bones = np.where(weights > 0, skin.bones[:, :most], -1)
    return SkinWeights(bones, weights / weights.sum(axis=1, keepdims=True))


def _smoothed_within(
    skin: SkinWeights, nearest: SkinWeights, shape: Shape, width: FloatArray
) -> SkinWeights:
    """Smooth what the limit has left rough, with the bones that are left."""
    from medialis.rigging._way_kernels import Couplings, smooth_within

    stiff, mass = stiffness(shape)
    table = stiff.tocsr()
    table.setdiag(0.0)
    pulls = mass / np.maximum(width, 1e-6 * shape.diagonal) ** 2
    couplings = Couplings(
        table.indptr.astype(np.int32), table.indices.astype(np.int32), -table.data, pulls
    )
    before = np.zeros_like(skin.weights)
    for bone, share in zip(nearest.bones.T, nearest.weights.T, strict=True):
        before += share[:, None] * ((skin.bones == bone[:, None]) & (bone >= 0)[:, None])
    weights, moved = np.array(skin.weights), np.empty_like(skin.weights)
    for _ in range(PASSES):
        smooth_within(couplings, skin.bones, before, weights, moved)
        weights, moved = moved, weights
    order = np.argsort(-weights, axis=1, kind="stable")
    weights = np.take_along_axis(weights, order, axis=1)
    bones = np.take_along_axis(skin.bones, order, axis=1)
    return SkinWeights(np.where(weights > 0, bones, -1), weights)


def _nearest(shape: Shape, segments: Segments) -> tuple[SkinWeights, FloatArray]:
    """Return the nearest bones of each vertex with their shares, and the distance to them."""
    from medialis.rigging._way_kernels import Fares, Waiting, nearest_bones

    cell, origin, size = _lattice(shape, segments)
    points = (shape.points - origin) / cell
    normals = np.nan_to_num(shape.normals)
    grid = _grid(points, shape.faces, size)
    around = _behind(points, normals, grid)
    grid.wanted[around.cells[around.good | ~around.good.any(axis=1, keepdims=True)]] = True
    ends = (segments.heads - origin) / cell, (segments.tails - origin) / cell
    lines = replace(segments, heads=ends[0], tails=ends[1])
    fee = FEE * float(np.linalg.norm(size))
    ways = _seeds(lines, grid, fee)
    seeds = ways.costs[np.isfinite(ways.costs)]
    lists = int(max(fee + OUTSIDE * np.sqrt(3.0), seeds.max())) + 2
    after, before = np.empty((2, ways.costs.size), np.int32)
    waiting = Waiting(np.full(lists, -1, np.int32), after, before)
    limit = nearest_bones(grid, Fares(OUTSIDE, fee, FURTHER), ways, waiting)
    found = _of_vertices(around, ways, limit, fee)
    skin, far = _shared(points, lines, found, fee)
    return skin, cell * far


def _lattice(shape: Shape, segments: Segments) -> tuple[float, FloatArray, Index]:
    """Return the edge of a cell, where the first center stands, and how many there are."""
    low, high = shape.bounds
    reach = 0.25 * shape.diagonal
    joints = np.clip(np.concatenate([segments.heads, segments.tails]), low - reach, high + reach)
    low, high = np.minimum(low, joints.min(axis=0)), np.maximum(high, joints.max(axis=0))
    sides = np.maximum(high - low, 1e-2 * shape.diagonal)
    assert shape.faces is not None
    volume = enclosed_volume(shape.points, shape.faces)
    cell = float(np.cbrt(max(sides.prod() / CELLS, volume / INSIDE)))
    size = np.ceil((high - low) / cell).astype(np.int64) + 2 * MARGIN
    return cell, low - cell * (MARGIN - 0.5 - np.array(SHIFT) / 2), size


def _grid(points: FloatArray, faces: IntArray | None, size: Index) -> Grid:
    """Tell inside from outside by rays along both ways of each axis."""
    from scipy.ndimage import maximum_filter

    from medialis.rigging._way_kernels import Grid, mark_crossings

    votes, parted = np.zeros(size, np.int8), np.zeros(int(size.prod()), np.uint8)
    for axis in range(3):
        entries = np.zeros(int(size.prod()), np.int16)
        mark_crossings(points, faces, axis, size, entries, parted)
        ahead = np.cumsum(entries.reshape(size), axis=axis, dtype=np.int16)
        votes += ahead != 0
        votes += ahead != np.take(ahead, [-1], axis=axis)
    inside = (votes >= INSIDE_VOTES).ravel()
    near = maximum_filter(parted.reshape(size) > 0, 3)
    passed = inside | maximum_filter(near, 2 * BAND - 1).ravel()
    return Grid(size, inside, parted, ~near.ravel(), passed, np.zeros(len(inside), np.bool_))


def _cells_around(places: FloatArray, size: Index) -> tuple[Index, FloatArray]:
    """Return the eight cells around each place, (n, 8), and where their centers are, (n, 8, 3)."""
    corner = np.floor(places).astype(np.int64)[:, None] + np.indices((2, 2, 2)).reshape(3, 8).T
    corner = np.clip(corner, 0, size - 1)
    return np.ravel_multi_index(tuple(corner.T), tuple(size)).T, corner.astype(np.float64)


def _seeds(lines: Segments, grid: Grid, fee: float) -> Ways:
    """Return the ways from each bone to the cells around it and to the nearest cells inside.

    Parts of bones outside of the mesh reach the nearest inside cell straight and without a fee,
    since rigs fit some meshes badly. Cells outside have the usual fee.
    """
    from medialis.rigging._way_kernels import Ways

    total = int(lines.bone.max()) + 1
    line, cells, centers = _cells_along(lines, grid)
    far = _distance(centers, lines.heads[line], lines.tails[line])
    order = np.argsort(far, kind="stable")
    cells, bone, far = cells[order], lines.bone[line[order]].astype(np.int64), far[order]
    _, rows = np.unique(cells * total + bone, return_index=True)
    cells, bone, far = cells[rows], bone[rows], far[rows]
    cost = np.where(grid.inside[cells], far, OUTSIDE * far + fee)
    order = np.lexsort((bone, cost, cells))
    cells, bone, cost = cells[order], bone[order], cost[order]
    column = np.arange(len(cells)) - np.searchsorted(cells, cells)
    shape = len(grid.inside), min(KEPT, len(np.unique(lines.bone)))
    ways = Ways(np.full(shape, -1, np.int32), np.full(shape, np.inf), np.full(shape, np.inf))
    kept = column < shape[1]
    place = cells[kept], column[kept]
    ways.bones[place] = bone[kept]
    ways.costs[place] = ways.lengths[place] = cost[kept]
    return ways


def _cells_along(lines: Segments, grid: Grid) -> tuple[Index, Index, FloatArray]:
    """Return the cells around each line, and the nearest inside cell of each of them outside.

    Returns
    -------
    line, cells : (k,) int64
    centers : (k, 3) float64
    """
    heads, tails = lines.heads, lines.tails
    counts = np.ceil(2.0 * np.linalg.norm(tails - heads, axis=1)).astype(np.int64) + 2
    line = np.repeat(np.arange(len(heads)), counts)
    step = np.arange(len(line)) - np.repeat(np.cumsum(counts) - counts, counts)
    share = (step / np.repeat(counts - 1, counts))[:, None]
    around, centers = _cells_around((1 - share) * heads[line] + share * tails[line], grid.size)
    line, cells, centers = np.repeat(line, 8), around.ravel(), centers.reshape(-1, 3)
    inside, outside = np.flatnonzero(grid.inside), np.flatnonzero(~grid.inside[cells])
    if len(inside) == 0 or len(outside) == 0:
        return line, cells, centers
    places = np.stack(np.unravel_index(inside, tuple(grid.size)), axis=1).astype(np.float64)
    near = kd_tree(places).query(centers[outside])[1]
    return (
        np.concatenate([line, line[outside]]),
        np.concatenate([cells, inside[near]]),
        np.concatenate([centers, places[near]]),
    )


def _distance(points: FloatArray, heads: FloatArray, tails: FloatArray) -> FloatArray:
    """Return the distance of each point from its segment."""
    along, off = tails - heads, points - heads
    squared = np.maximum((along**2).sum(axis=-1), 1e-300)  # a bone without length is a place
    share = (off * along).sum(axis=-1) / squared
    return np.asarray(np.linalg.norm(off - np.clip(share, 0, 1)[..., None] * along, axis=-1))


class _Around(NamedTuple):
    """The eight cells behind each of n vertices.

    Attributes
    ----------
    cells : (n, 8) int64
    good, inside : (n, 8) bool
        Whether a cell is inside, and whether it lies behind the surface as well.
    lengths : (n, 8) float64
        How far its center is from the vertex.
    """

    cells: Index
    good: Mask
    inside: Mask
    lengths: FloatArray


def _behind(points: FloatArray, normals: FloatArray, grid: Grid) -> _Around:
    cells, centers = _cells_around(points - 0.75 * normals, grid.size)
    way = centers - points[:, None]
    inside = grid.inside[cells]
    good = inside & (np.einsum("nkc,nc->nk", way, normals) < 0)
    return _Around(cells, good, inside, np.linalg.norm(way, axis=2))


def _of_vertices(
    around: _Around, ways: Ways, limit: float, fee: float
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return the cheapest bones of each vertex by the cells behind it: bones, costs and lengths."""
    cells = around.cells
    length = around.lengths * np.where(around.good, 1.0, OUTSIDE)
    toll = np.where(around.inside & ~around.good, fee, 0.0)
    shape = len(cells), -1
    bones = ways.bones[cells].reshape(shape)
    lengths = (ways.lengths[cells] + length[..., None]).reshape(shape)
    costs = (ways.costs[cells] + (length + toll)[..., None]).reshape(shape)
    costs = np.where(ways.costs[cells].reshape(shape) <= limit, costs, np.inf)
    rows, found = np.arange(len(cells)), []
    for _ in range(ways.bones.shape[1]):
        best = costs.argmin(axis=1)
        cost = costs[rows, best]
        found.append(
            (np.where(np.isfinite(cost), bones[rows, best], -1), cost, lengths[rows, best])
        )
        costs = np.where(bones == bones[rows, best][:, None], np.inf, costs)
    whole, cost, length = (np.stack(columns, axis=1) for columns in zip(*found, strict=True))
    return whole, cost, length


def _to_bones(points: FloatArray, lines: Segments, bones: IntArray) -> FloatArray:
    """Return the distance of points (n, 3) from bones (n, k), beyond a joint times 0.9 to 1.1.

    Beyond a joint, two bones are equally near: their common end is the nearest place of both. The
    factor decides for the bone on whose side of the plane between them a point is.
    """
    rows = np.minimum(np.searchsorted(lines.bone, bones), len(lines.bone) - 1)
    heads, way = lines.heads[rows], lines.tails[rows] - lines.heads[rows]
    off = points[:, None] - heads
    squared = np.maximum((way**2).sum(axis=-1), 1e-300)
    share = (off * way).sum(axis=-1) / squared
    away = off - np.clip(share, 0.0, 1.0)[..., None] * way
    far = np.linalg.norm(away, axis=-1)
    along = (away * way).sum(axis=-1) / np.maximum(far * np.sqrt(squared), 1e-300)
    beyond = np.where(share < 0, -along, np.where((share > 1) & lines.joint[rows], along, 0.0))
    return np.asarray(far * (1.0 + BEYOND * beyond))


def _shared(
    points: FloatArray,
    lines: Segments,
    found: tuple[IntArray, FloatArray, FloatArray],
    fee: float,
) -> tuple[SkinWeights, FloatArray]:
    """Share each vertex between the bones that are nearly equally near; return the distance, too.

    A way without a bend is as long as the straight line, which the grid knows only roughly.
    """
    bones, costs, lengths = found
    straight = _to_bones(points, lines, bones)
    far = np.where(lengths <= DETOUR * straight + 2.0, straight, lengths)
    known = np.isfinite(costs)
    tolls = np.subtract(costs, lengths, out=np.full_like(costs, np.inf), where=known)
    far = np.where(tolls <= tolls.min(axis=1, keepdims=True) + fee / 2, far, np.inf)
    far[~known] = np.inf
    lost = ~known.any(axis=1)
    if lost.all():  # no way leads to the mesh
        own = np.unique(lines.bone)
        every = np.array([_to_bones(points, lines, np.full((len(points), 1), bone))[:, 0]
                          for bone in own.tolist()]).T  # fmt: skip
        order = np.argsort(every, axis=1, kind="stable")[:, : bones.shape[1]]
        bones, far = own[order].astype(np.int32), np.take_along_axis(every, order, axis=1)
    elif lost.any():  # pieces apart follow what they are next to
        row = np.flatnonzero(~lost)[kd_tree(points[~lost]).query(points[lost])[1]]
        bones[lost], far[lost] = bones[row], far[row]
    least = np.maximum(far.min(axis=1, keepdims=True), 0.5)
    share = np.clip(1.0 - (far / least - 1.0) / NEARLY, 0.0, None)
    weights = share / share.sum(axis=1, keepdims=True)
    order = np.argsort(-weights, axis=1, kind="stable")
    weights = np.take_along_axis(weights, order, axis=1)
    bones = np.take_along_axis(bones, order, axis=1)
    return SkinWeights(np.where(weights > 0, bones, -1), weights), least[:, 0]


def _whole_pieces(skin: SkinWeights, shape: Shape, far: FloatArray) -> SkinWeights:
    """Give the pieces that are smaller than their distance to the bone one weight each."""
    label = shape.components
    count = int(label.max()) + 1
    if count == 1:
        return skin
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, label, shape.points)
    np.maximum.at(high, label, shape.points)
    sizes = np.bincount(label)
    small = np.linalg.norm(high - low, axis=1) < np.bincount(label, far) / sizes
    rows = np.flatnonzero(small[label])
    bones, weights = np.array(skin.bones), np.array(skin.weights)
    total = int(bones.max()) + 1
    keys = label[rows, None] * total + bones[rows].clip(min=0)
    keys, place = np.unique(keys, return_inverse=True)
    sums = np.bincount(place.ravel(), weights[rows].ravel())
    piece, bone = np.divmod(keys, total)
    order = np.lexsort((-sums, piece))
    piece, bone, sums = piece[order], bone[order], sums[order]
    column = np.arange(len(piece)) - np.searchsorted(piece, piece)
    width = bones.shape[1]
    kept = (column < width) & (sums > 0)
    of_piece = np.full((count, width), -1, np.int32), np.zeros((count, width))
    of_piece[0][piece[kept], column[kept]] = bone[kept]
    of_piece[1][piece[kept], column[kept]] = sums[kept]
    bones[rows], weights[rows] = of_piece[0][label[rows]], of_piece[1][label[rows]]
    weights[rows] /= weights[rows].sum(axis=1, keepdims=True)
    return SkinWeights(bones, weights)
