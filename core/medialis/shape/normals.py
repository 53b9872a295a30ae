"""Vertex normals of meshes, and estimated, consistently oriented ones of clouds (for thesis 3.2).

Normals of a mesh are those of the smooth surface through each vertex and its ring
(_normal_kernels.py). Those of a cloud: directions by principal components of the nearest
neighbours; signs by a minimum spanning tree over the neighbour graph, so that they are carried
along where the surface is flat first (Hoppe et al., "Surface reconstruction from unorganized
points", 1992); outside by a vote of extreme points, or by the places that the points were seen
from.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.base.arrays import Ragged, first_equal_row, kd_tree, unit_rows
from medialis.base.errors import InvalidShapeError
from medialis.base.options import Options, algorithm, whole
from medialis.base.progress import Progress, counted
from medialis.base.threads import nearest_rows, run_chunks, run_patiently
from medialis.base.validation import FloatArray, IntArray, as_faces, as_points, frozen, sealed
from medialis.shape.cylinders import Cylinders, find_cylinders, with_cylinders
from medialis.shape.diagnosis import propagate_signs
from medialis.shape.planes import find_planes, with_planes
from medialis.shape.rulings import needles, with_rulings
from medialis.shape.surface import Surface, piece_labels

FACING_AWAY = 1e-6  # halved 0 %, doubled 0 %
"""Cosine beyond which a face looks away from the normal: above rounding, so that the rim of a flat
double-sided sheet, exactly at right angles to its faces, keeps its normal."""

CREASE_ANGLE = 30.0  # halved 100 %, doubled 100 %
"""Degrees: edges that bend by more are creases, here and by default in `surface_skeleton`."""

SHARP = math.radians(CREASE_ANGLE) + 1e-4
"""The same in radians, with what rounding adds: three chords of a right angle bend by just 30
degrees, and are all smooth."""

VERTICES_A_CHUNK = 4096


def vertex_normals(points: FloatArray, faces: IntArray) -> FloatArray:
    """Compute unit vertex normals: those of the smooth surface through each vertex and its ring.

    At creases, where two edges at a vertex bend by more than 30 degrees, and at borders, it is the
    mean of the face normals, weighted by the angle of the face at the vertex. These weights depend
    on the faces only, not on how they are cut into triangles. Where a smooth surface ends at a flat
    face of a part (`medialis.shape.planes`), it is that of this face.

    Parameters
    ----------
    points : (n, 3) float
        Vertices.
    faces : (m, 3) int
        Triangles, counter-clockwise seen from outside.

    Returns
    -------
    (n, 3) float64
        Zero where a vertex has no face with an area, or where one of its faces looks the other way
        (a fold: its faces have no common outside, and a ball would start on the wrong side).

    Raises
    ------
    InvalidShapeError
        When an array has the wrong shape or a face index is out of range.

    See Also
    --------
    estimate_normals : of clouds.

    Notes
    -----
    The surface has the second order and is found by least squares; it is exact on spheres and
    planes. On irregular meshes of smooth shapes means of face normals are 1 to 2 degrees off, four
    to six times as much: slim faces are inclined however smooth the shape is. Cost O(m), parallel.

    Examples
    --------
    >>> vertex_normals([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])[0]
    array([0., 0., 1.])
    """
    points = as_points(points)
    surface = Surface.of_checked(points, as_faces(faces, len(points)))
    if surface.faces is None:
        return frozen(np.zeros_like(points), np.float64)
    planes = find_planes(surface, SHARP)
    return part_normals(ring_normals(points, surface.faces), surface, planes)[0]


def part_normals(
    normals: FloatArray, surface: Surface, planes: IntArray
) -> tuple[FloatArray, Cylinders]:
    """Return normals (n, 3) that are those of flat faces, rulings and cylinders, and the latter."""
    found = needles(surface, planes)
    cylinders = find_cylinders(surface, planes, SHARP, found)
    normals = with_planes(normals, surface, planes, SHARP)
    normals = with_rulings(normals, surface, planes, SHARP, found[0])
    return with_cylinders(normals, surface, planes, cylinders, SHARP), cylinders


def ring_normals(points: FloatArray, faces: IntArray, *, smooth: bool = True) -> FloatArray:
    """Return the `vertex_normals` of arrays that were checked.

    Without `smooth` all are the means that `vertex_normals` has at creases: for vertices on flat
    faces and straight edges, which refinement makes.
    """
    # Imported here: compiled code takes half a second to load, and `medialis --help` needs none.
    from medialis.shape._normal_kernels import Fans, fill_normals

    faces = frozen(faces, np.int32)
    # Scaled to about 1, so that squared areas of tiny or huge shapes stay in range.
    local = points - points[0]
    local /= max(-float(local.min()), float(local.max())) or 1.0
    fans = Ragged.group(faces.ravel(), len(points))
    mesh = Fans(local, faces, fans.offsets, fans.indices)
    normals, crease = np.zeros((len(points), 3)), math.cos(SHARP)
    with_these = mesh, crease, FACING_AWAY, smooth, normals
    run_chunks(fill_normals, len(points), VERTICES_A_CHUNK, *with_these)
    return sealed(normals)


BATCH = 1 << 16

GRAZING = 0.17
"""Cosine of normal and beam below which the error of the normal, some 10 degrees, could turn it."""


@dataclass(frozen=True, kw_only=True)
class NormalsOptions(Options):
    """Options of `estimate_normals`."""

    neighbours: int = whole(
        12,
        "Neighbours",
        "Nearest samples that span the tangent plane, all others if there are fewer.",
        low=3,
        high=100,
    )
    viewpoints: ArrayLike | None = field(default=None, compare=False, repr=False)
    """Where the points were seen from, (3,) or (n, 3); NaN where unknown."""


@algorithm(NormalsOptions)
def estimate_normals(points: ArrayLike, options: NormalsOptions, progress: Progress) -> FloatArray:
    """Estimate unit outward normals of a point cloud.

    Parameters
    ----------
    points : (n, 3) float
        Samples of one or more surfaces.
    viewpoints : (3,) or (n, 3) float, optional
        Where the points, or each of them, were seen from (scanner, camera), NaN where unknown.

    Returns
    -------
    (n, 3) float64
        Unit normals, consistent within each part of the neighbour graph and outward for a closed
        surface. Which side of an open one is outside is a guess; a message says when it is unsure.
        With viewpoints they face these.

    Raises
    ------
    InvalidShapeError
        With fewer than 4 different points, or all of them on one line; or when the viewpoints are
        neither one nor one for each point.

    See Also
    --------
    surface_of_cloud : triangles through the points.
    vertex_normals : the normals of a mesh, which need no guess.

    Notes
    -----
    Cost O(n log n). A surface thinner than the sampling distance, or with sharp creases, can get
    wrong signs: give normals where you have them.

    Examples
    --------
    >>> import numpy as np, medialis
    >>> points = np.random.default_rng(0).normal(size=(500, 3))
    >>> points /= np.linalg.norm(points, axis=1, keepdims=True)
    >>> normals = medialis.estimate_normals(points)
    >>> bool((np.einsum("ij,ij->i", normals, points) > 0.9).all())
    True
    """
    points = as_points(points)
    views = None if options.viewpoints is None else as_viewpoints(options.viewpoints, len(points))
    centered = points - points.mean(axis=0)
    size = float(np.abs(centered).max())
    spread = np.linalg.svd(centered / size, compute_uv=False) if size else np.zeros(3)
    if (
        np.count_nonzero(first_equal_row(points) == np.arange(len(points))) < 4
        or spread[1] < 1e-9 * spread[0]
    ):
        raise InvalidShapeError(
            "Normals need at least 4 different points that do not all lie on one line; "
            f"{len(points)} came. Give normals, or a mesh with faces."
        )
    progress.update(0.0)
    centered /= size  # squared distances of tiny or huge clouds stay in range
    k = min(options.neighbours, len(points) - 1) + 1
    tree = run_patiently(lambda: kd_tree(centered), progress)
    with progress.stage("neighbours", 0.0, 0.4):
        near = nearest_rows(tree, centered, k, progress)
    normals = run_patiently(lambda: _plane_normals(centered, near), progress)
    progress.update(0.7)
    beams = None if views is None else _unit(views - points)
    oriented, doubtful, parts = run_patiently(
        lambda: _orient(centered, normals, near, beams), progress
    )
    if doubtful:
        text = (
            f"The outside of {doubtful} of {counted(parts, 'part')} of the cloud is uncertain "
            "(open or noisy): the normals agree with each other, but may all point inward."
        )
        progress.warn(text, "outside_uncertain", parts=doubtful, of=parts)
    if beams is not None:
        oriented = _facing(oriented, beams, progress)
    return frozen(oriented, np.float64)


def as_viewpoints(viewpoints: ArrayLike, count: int) -> FloatArray:
    """Return a viewpoint for each of `count` points, (count, 3); NaN is allowed."""
    try:
        views = np.asarray(viewpoints, np.float64)
    except (TypeError, ValueError):
        views = np.empty(0)
    if views.shape not in ((3,), (count, 3)):
        raise InvalidShapeError(
            f"viewpoints must have shape (3,) or ({count}, 3), got {views.shape}."
        )
    return np.broadcast_to(views, (count, 3))


def _unit(vectors: FloatArray) -> FloatArray:
    """Return unit vectors; zero where one is zero, or not finite."""
    size = np.abs(vectors).max(axis=1)
    good = np.isfinite(size) & (size > 0)
    scaled = np.where(good[:, None], vectors, 0.0) / np.where(good, size, 1.0)[:, None]
    return scaled / np.where(good, np.linalg.norm(scaled, axis=1), 1.0)[:, None]


def _facing(
    normals: NDArray[np.float64], beams: FloatArray, progress: Progress
) -> NDArray[np.float64]:
    """Turn normals to the viewpoints; grazing ones keep the sign of what they hang together with.

    A surface is not seen from behind, so the beam tells the sign wherever the normal is accurate.
    """
    cosine = np.einsum("ij,ij->i", normals, beams)
    seen = int(beams.any(axis=1).sum())
    text = f"The normals of {counted(seen, 'point', of=len(normals))} face the viewpoint."
    progress.note(text, "normals_face_viewpoints", points=seen, of=len(normals))
    return np.where((cosine < -GRAZING)[:, None], -normals, normals)


def _plane_normals(points: FloatArray, near: NDArray[np.int64]) -> NDArray[np.float64]:
    """Direction of least variance of each point's neighbourhood, sign arbitrary."""
    normals = np.empty_like(points)
    for begin in range(0, len(points), BATCH):
        patch = points[near[begin : begin + BATCH]]
        patch = patch - patch.mean(axis=1, keepdims=True)
        covariance = np.einsum("nki,nkj->nij", patch, patch)
        normals[begin : begin + BATCH] = np.linalg.eigh(covariance)[1][:, :, 0]
    return normals


def _orient(
    points: FloatArray,
    normals: NDArray[np.float64],
    near: NDArray[np.int64],
    beams: FloatArray | None,
) -> tuple[NDArray[np.float64], int, int]:
    """Return normals that agree and look outward, how many parts are unsure, and of how many."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

    n = len(points)
    a, b = np.repeat(np.arange(n), near.shape[1]), near.ravel()
    a, b = a[a != b], b[a != b]
    # 1 - |cos| is 0 on a plane, but a sparse matrix drops zeros: shifted by a constant, which
    # changes no minimum spanning tree.
    weight = 1.0 + 1e-6 - np.abs(np.einsum("ij,ij->i", normals[a], normals[b]))
    low, high = np.minimum(a, b), np.maximum(a, b)
    _, first = np.unique(low * np.int64(n) + high, return_index=True)
    # scipy before 1.12 builds minimum spanning trees on 32-bit indices only.
    low, high = low[first].astype(np.int32), high[first].astype(np.int32)
    graph = coo_array((weight[first], (low, high)), shape=(n, n)).tocsr()
    part = piece_labels(n, np.stack([low, high], axis=1))
    parts = int(part.max()) + 1

    # One virtual root above one point of each part turns the forest into a tree.
    tree = minimum_spanning_tree(graph).tocoo()
    heads = np.unique(part, return_index=True)[1]
    rows = np.concatenate([tree.row, np.full(parts, n)])
    columns = np.concatenate([tree.col, heads])
    joined = coo_array((np.ones(len(rows), np.int8), (rows, columns)), shape=(n + 1, n + 1)).tocsr()
    parent = breadth_first_order(joined, n, directed=False)[1]
    above = np.where(parent[:n] == n, np.arange(n), parent[:n])
    agree = np.where(np.einsum("ij,ij->i", normals, normals[above]) < 0, -1, 1)
    sign = propagate_signs(np.append(parent[:n], -1), np.append(agree, 1))[:n]
    oriented = normals * sign[:, None]
    outward, unsure = _outward(points, oriented, part, parts)
    if beams is not None:
        seen = np.bincount(part, np.einsum("ij,ij->i", oriented, beams), minlength=parts)
        outward = np.where(seen == 0, outward, np.where(seen < 0, -1.0, 1.0))
        unsure &= seen == 0
    return oriented * outward[part][:, None], int(unsure.sum()), parts


def _outward(
    points: FloatArray, normals: NDArray[np.float64], part: NDArray[np.int32], parts: int
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return +1 or -1 for each part (do its extreme points look outward?) and whether it is unsure.

    At the sample that lies farthest in a direction, the normal of a closed surface has a positive
    component along it. 26 directions vote, weighted by that component.
    """
    grid = np.array(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3)).reshape(3, -1).T
    directions = unit_rows(grid[np.abs(grid).sum(axis=1) > 0])
    votes, sure = np.zeros(parts), np.zeros(parts)
    for direction in directions:
        height = points @ direction
        top = np.lexsort((height, part))
        ends = np.cumsum(np.bincount(part, minlength=parts)) - 1
        component = normals[top[ends]] @ direction
        votes += component
        sure += np.abs(component)
    return np.where(votes < 0, -1.0, 1.0), np.abs(votes) < 0.5 * sure
