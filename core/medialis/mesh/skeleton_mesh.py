"""Surface-skeleton mesh: triangles between skeleton points (thesis 3.4.1).

The map from a surface point to the center of its maximal ball is continuous. So the surface's own
triangles, lifted to the centers of their corners, are a mesh of the skeleton: the surface, deflated
until its two sides meet. `_skeleton_mesh_kernels.py` says how the two sides become one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.errors import InvalidShapeError
from medialis.model.medial_cloud import MedialCloud
from medialis.model.shape import Shape
from medialis.model.skeleton_mesh import SkeletonMesh
from medialis.progress import Progress, ProgressCallback
from medialis.threads import run_chunks
from medialis.validation import IntArray, as_number, as_whole_number

DEFAULT_SLACK = 1.0
"""Sample spacings by which a radius may change against the slope of the sheet. On horse (48k
samples, spoke angles above 30 degrees) 0.5 rejects 0.75 % of the faces, 1 0.2 %, 2 0.03 %."""

DEFAULT_BRIDGE = 2
"""Surface edges; on horse, cow, bunny the first closes 1/4 to 1/3 of the length of all borders (the
holes of single false balls), the second and third another tenth, more only webs between spikes."""

FACES_A_CHUNK = 16384
"""About 2 ms of work."""


def skeleton_mesh(
    shape: Shape,
    cloud: MedialCloud,
    *,
    keep: ArrayLike | None = None,
    slack: float = DEFAULT_SLACK,
    bridge: int = DEFAULT_BRIDGE,
    smallest_piece: float = 0.0,
    progress: Progress | ProgressCallback | None = None,
) -> SkeletonMesh:
    """Connect the points of a surface skeleton to triangles.

    Parameters
    ----------
    shape : Shape
        The mesh from which the cloud was computed.
    cloud : MedialCloud
        All k balls, not a thinned cloud: a triangle needs the balls of three neighbouring samples.
    keep : (k,) bool, optional
        Points to use (importance, spoke angle, ... above a threshold); all valid ones when missing.
    slack : float
        Above 0 to 1000: see Notes, criterion 1. Larger keeps more triangles between distant points.
    bridge : int
        0 to 100: gaps in the usable points are closed over this many surface edges, see Notes.
    smallest_piece : float
        Fraction of the diagonal, 0 to 1: pieces all of whose points lie within this distance of
        the mean of their points are left out.
    progress : callable, optional
        Called with (fraction, text); returning False cancels.

    Returns
    -------
    SkeletonMesh
        Its points keep the order of the cloud, its triangles that of the surface.

    Raises
    ------
    InvalidShapeError
        When the shape has no faces, the cloud is not one of this shape or has two balls for one
        sample and side, or `keep` is not one bool a ball.
    InvalidOptionError
        When an option is out of its range.
    Cancelled
        When `progress` asks for it.

    Notes
    -----
    A surface triangle a, b, c is lifted to the centers of the balls at its corners when

    1. the radius changes as it does on a sheet: along a sheet its slope is at most the cosine of
       half the spoke angle, so |r_a - r_b| <= |c_a - c_b| (cos(t_a/2) + cos(t_b/2))/2
       + slack |a - b|. A triangle that jumps from one sheet to another behind or before it runs
       along the spokes, where the slope is 1. The last term, in sample spacings, is what sampling
       and the tolerance can do to a radius. Ligatures pass, however stretched: there the centers
       move apart because the normals turn, at nearly the same radius.
    2. the three balls, larger by the longest side of a, b, c, cover the lifted triangle: it lies
       inside the shape, or outside by less than a sample spacing, which matters only where a wall
       is thinner than that.

    A sample without a usable ball takes that of a neighbour, up to `bridge` edges away (the nearest
    sample): this contracts the hole that it would leave, instead of tearing the sheet.

    Each sheet would be covered from both sides, by different points. Rows of one side are replaced
    by their partners across the sheet (the ball of the second feature point, where its center is
    no further off than those of its neighbours there); triangles that then lie on those of the
    other side are left out, those that join sheets are kept. So each sheet is covered once, with
    the connectivity of the surface, and sheets share points where they meet.

    Where the skeleton is a curve (a round tube) the triangles are slivers along it, where it is a
    point (a sphere) a speck.

    Cost: O(m log m), about 100 bytes a face; 0.12 s for horse2 (194k samples) on two cores.

    Source: thesis 3.4.1. Deviates: no Delaunay triangulation of the skeleton points of each face,
    projected on its plane. Triangulations of neighbouring faces overlap without agreeing and
    cross where points from both sides lie close in projection; lifted faces agree by construction.

    Examples
    --------
    The skeleton of a flat box is mostly its middle rectangle:

    >>> import numpy as np, medialis
    >>> x = [[x, y, z] for x in (0, 4) for y in (0, 4) for z in (0, 1)]
    >>> q = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> faces = [t for a, b, c, d in q for t in ((a, b, c), (a, c, d))]
    >>> box = medialis.refine(medialis.make_shape(x, faces), 0.2)
    >>> mesh = medialis.skeleton_mesh(box, medialis.surface_skeleton(box))
    >>> bool(np.abs(np.median(mesh.points[:, 2]) - 0.5) < 1e-6)
    True
    """
    slack = as_number(slack, "slack", low=0.0, high=1000.0, open_low=True)
    bridge = as_whole_number(bridge, "bridge", low=0, high=100)
    smallest_piece = as_number(smallest_piece, "smallest_piece", low=0.0, high=1.0)
    if shape.faces is None:
        raise InvalidShapeError(
            "A skeleton mesh needs a surface with faces, got a point cloud: reconstruct a surface "
            "first, or show the skeleton as points."
        )
    usable, faces = _usable(shape, cloud, keep), shape.faces
    progress = Progress.of(progress)
    parts = []
    sides = [sign for sign in (1, -1) if (cloud.side == sign).any()]
    with progress.stage("skeleton mesh", 0.0, 1.0):
        for turn, sign in enumerate(sides):
            with progress.stage("lift", turn / len(sides), (turn + 1) / len(sides)):
                parts.append(_lift(shape, faces, cloud, usable, sign, slack, bridge, progress))
        triangles = np.concatenate([t for t, _ in parts]) if parts else np.empty((0, 3), np.int32)
        origin = np.concatenate([o for _, o in parts]) if parts else np.empty(0, np.int32)
        mesh = _compact(cloud, triangles, origin)
        if smallest_piece > 0.0:
            mesh = _without_small_pieces(mesh, cloud, smallest_piece * shape.diagonal)
    return mesh


def _usable(shape: Shape, cloud: MedialCloud, keep: ArrayLike | None) -> NDArray[np.bool_]:
    last = max(cloud.source.max(initial=-1), cloud.features.max(initial=-1))
    if last >= shape.point_count:
        raise InvalidShapeError(
            f"The cloud refers to sample {last}, the shape has {shape.point_count}: give the shape "
            "from which the cloud was computed."
        )
    if keep is None:
        return cloud.valid
    mask = np.asarray(keep)
    if mask.shape != (len(cloud),) or mask.dtype != np.bool_:
        raise InvalidShapeError(
            f"keep must be a ({len(cloud)},) array of bools, one a ball, got {mask.dtype} "
            f"{mask.shape}."
        )
    return cloud.valid & mask


def _rows_of_samples(
    shape: Shape, faces: IntArray, cloud: MedialCloud, usable: NDArray[np.bool_], bridge: int
) -> IntArray:
    """Row that stands for each sample: of its own ball, else of a near sample's, else -1."""
    from medialis.mesh._skeleton_mesh_kernels import bridge_gaps

    rows = np.flatnonzero(usable).astype(np.int32)
    row_near = np.full(shape.point_count, -1, np.int32)
    row_near[cloud.source[rows]] = rows
    if len(rows) != np.count_nonzero(row_near >= 0):
        raise InvalidShapeError("The cloud has several balls for one sample and side.")
    for _ in range(bridge):
        wider = row_near.copy()
        bridge_gaps(faces, shape.points, cloud.source, row_near, wider)
        row_near = wider
    return row_near


def _lift(
    shape: Shape,
    faces: IntArray,
    cloud: MedialCloud,
    usable: NDArray[np.bool_],
    sign: int,
    slack: float,
    bridge: int,
    progress: Progress,
) -> tuple[IntArray, IntArray]:
    """Triangles of one side as rows of the cloud, and the face each comes from."""
    # Imported here: compiled code takes half a second to load, and `medialis --help` needs none.
    from medialis.mesh import _skeleton_mesh_kernels as kernels

    k, m = len(cloud), len(faces)
    usable = usable & (cloud.side == sign)
    row_near = _rows_of_samples(shape, faces, cloud, usable, bridge)
    chords, slopes = _chords(shape, cloud)
    rows, ok = np.empty((m, 3), np.int32), np.zeros(m, np.bool_)
    balls = shape.points, cloud.source, cloud.centers, cloud.radii

    def work(begin: int, end: int) -> None:
        kernels.test_faces(begin, end, slack, faces, row_near, *balls, slopes, rows, ok)

    run_chunks(work, m, FACES_A_CHUNK, progress=progress)
    longest = np.zeros(k)
    kernels.longest_edges(rows, ok, cloud.centers, longest)
    across = np.where(usable, row_near[cloud.features[:, 1]], np.int32(-1))
    partner = np.full(k, -1, np.int32)
    kernels.find_partners(usable, across, cloud.centers, chords, longest, partner)
    second = np.zeros(k, np.bool_)
    kernels.join_sides(
        rows, ok, partner, chords, np.arange(k, dtype=np.int32), np.zeros(k, np.int8), second
    )
    lifted, kept = np.empty((m, 3), np.int32), np.zeros(m, np.bool_)
    kernels.lift_faces(rows, ok, partner, second, *balls, chords, lifted, kept)
    origin = np.flatnonzero(kept).astype(np.int32)
    return _without_duplicates(lifted[origin], origin)


def _chords(shape: Shape, cloud: MedialCloud) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return unit vectors from the f2 to f1, and cosines of half the spoke angles.

    The chord is the normal of the sheet: the sheet bisects the two feature points. Zero and NaN
    rows belong to masked balls, which are never used.
    """
    chords = shape.points[cloud.features[:, 0]] - shape.points[cloud.features[:, 1]]
    length = np.linalg.norm(chords, axis=1, keepdims=True)
    np.divide(chords, length, out=chords, where=length > 0)
    return chords, np.cos(cloud.spoke_angles / 2)


def _without_duplicates(triangles: IntArray, origin: IntArray) -> tuple[IntArray, IntArray]:
    """Drop triangles with the same three corners as an earlier one."""
    order = np.lexsort(np.sort(triangles, axis=1).T)
    corners = np.sort(triangles, axis=1)[order]
    first = np.r_[True, (corners[1:] != corners[:-1]).any(axis=1)][: len(order)]
    chosen = np.sort(order[first])  # lexsort is stable: the first of equals is the earliest
    return triangles[chosen], origin[chosen]


def _compact(cloud: MedialCloud, triangles: IntArray, origin: IntArray) -> SkeletonMesh:
    """Give the rows that triangles use their numbers, in the order of the cloud."""
    used = np.zeros(len(cloud), np.bool_)
    used[triangles.ravel()] = True
    rows = np.flatnonzero(used).astype(np.int32)
    place = np.full(len(cloud), -1, np.int32)
    place[rows] = np.arange(len(rows), dtype=np.int32)
    return SkeletonMesh(cloud.centers[rows], place[triangles], rows, origin)


def _without_small_pieces(mesh: SkeletonMesh, cloud: MedialCloud, reach: float) -> SkeletonMesh:
    piece, count = mesh.pieces, mesh.piece_count
    size = np.bincount(piece, minlength=count)
    mean = np.stack([np.bincount(piece, mesh.points[:, j], count) / size for j in range(3)], axis=1)
    far = np.linalg.norm(mesh.points - mean[piece], axis=1) > reach
    large = np.bincount(piece[far], minlength=count) > 0
    kept = large[piece[mesh.faces[:, 0]]] if len(mesh.faces) else np.zeros(0, np.bool_)
    return _compact(cloud, mesh.rows[mesh.faces[kept]], mesh.face_origin[kept])
