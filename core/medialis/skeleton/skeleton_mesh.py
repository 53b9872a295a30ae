"""SkeletonMesh: triangles between skeleton points (thesis 3.4.1).

The map from a surface point to the center of its maximal ball is continuous. So the surface's own
triangles, lifted to the centers of their corners, are a mesh of the skeleton: the surface, deflated
until its two sides meet. `_ball_kernels.py` says how the two sides become one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import Mask, first_equal_row, unit_rows
from medialis.base.errors import InvalidShapeError
from medialis.base.kept import kept
from medialis.base.options import Options, algorithm, angle, changed, flag, length, whole
from medialis.base.progress import Progress
from medialis.base.threads import run_chunks, run_patiently
from medialis.base.validation import FloatArray, IntArray, Positions, as_faces, frozen, hold
from medialis.shape.graph import local_spacing
from medialis.shape.shape import Shape
from medialis.shape.surface import Surface
from medialis.skeleton.importance.importance import (
    Importance,
    connected_importance,
    geodesic_importance,
    important_points,
)
from medialis.skeleton.medial_cloud import MedialCloud, ShrinkOptions, Side
from medialis.skeleton.rims import blended, clean_rims
from medialis.skeleton.surface_skeleton import Preparation, balls_of, shape_or_cloud

RADIUS_SLACK = 1.0  # halved 78 %, doubled < 0.1 %
"""Sample spacings by which a radius may change against the slope of the sheet. On horse (48k
samples, spoke angles above 30 degrees) 0.5 rejects 0.75 % of the faces, 1 0.2 %, 2 0.03 %."""

FACES_A_CHUNK = 16384  # halved 0 %, doubled 0 %
"""About 2 ms of work."""


@dataclass(frozen=True, eq=False, repr=False)
class SkeletonMesh(Surface):
    """A surface skeleton as triangles: open sheets that meet along curves, not a manifold.

    It is a `Surface`: areas, edges, components and more are its quantities.

    Attributes
    ----------
    points : (p, 3) float64
        Skeleton points, each used by a triangle; none when the skeleton has no sheet.
    faces : (t, 3) int32
        Triangles; no two have the same three corners. Their orientation has no meaning.
    rows : (p,) int32
        Row of the medial cloud that each point is: ``cloud.radii[mesh.rows]`` and likewise for any
        (k,) attribute. Of a point of a clean rim, the ball that it was moved from (`at_points`).
    face_origin : (t,) int32
        Face of the surface from which each triangle was lifted; of one that closes a gap, a face
        beside it.
    cloud : MedialCloud
        The k balls.
    selected : (k,) bool
        Balls that the mesh was made of.
    blend : tuple of (w,) int32, int32 and float64, or None
        Of clean rims: points, rows of balls, and the weight of each at the point, which is their
        mean. Those of a point are 1 together; some lie below 0.

    Raises
    ------
    InvalidShapeError
        When the arrays do not fit together.
    """

    points: Positions
    faces: IntArray
    rows: IntArray
    face_origin: IntArray
    cloud: MedialCloud = field(kw_only=True)
    selected: Mask = field(kw_only=True)
    blend: tuple[IntArray, IntArray, FloatArray] | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        p, t = len(self.points), len(self.faces)
        hold(self, points=(p, 3), faces=(t, 3), rows=p, face_origin=t, selected=len(self.cloud))
        as_faces(self.faces, p)

    def at_points(self, values: NDArray[Any]) -> FloatArray:
        """Return numbers of the balls (k,) or (k, d) at the points: those of `rows`.

        At points of clean rims, the weighted mean that the point itself is of centers.
        """
        known = np.asarray(values, np.float64)
        own = known[self.rows]
        return own if self.blend is None else blended(own, known, self.blend)

    @classmethod
    def of_rows(
        cls, cloud: MedialCloud, triangles: IntArray, origin: IntArray, selected: Mask
    ) -> SkeletonMesh:
        """Make a mesh of triangles that name rows of the cloud; its points keep their order."""
        used = np.zeros(len(cloud), np.bool_)
        used[triangles] = True
        rows = np.flatnonzero(used).astype(np.int32)
        place = np.cumsum(used, dtype=np.int32) - 1
        faces = frozen(place[triangles], np.int32)
        return cls(cloud.centers[rows], faces, rows, origin, cloud=cloud, selected=selected)

    def __repr__(self) -> str:
        return f"SkeletonMesh({len(self.points)} points, {len(self.faces)} faces)"


@dataclass(frozen=True, kw_only=True)
class SkeletonMeshOptions(Preparation):
    """Options of `skeleton_mesh`."""

    side: Side = changed(ShrinkOptions, "side")
    min_spoke_angle: float = angle(
        45.0,
        "Minimum spoke angle",
        "Leave out points whose feature points are less than this many degrees apart,"
        " seen from the center. 0 keeps every sheet, also those of bumps and noise.",
    )
    importance: float = length(
        0.0,
        "Importance",
        "Leave out points whose geodesic importance is below this share of the "
        "size: removes what bumps and noise made. 0 measures no geodesics.",
        high=10.0,
    )
    smallest_piece: float = length(
        0.01,
        "Smallest piece",
        "Leave out separate pieces all of whose points lie within this share of the "
        "size from their middle. 0 keeps all.",
    )
    bridge: int = whole(
        2,
        "Bridge gaps",
        "Close gaps that left-out points would tear, up to this many edges from each side.",
        high=100,
        advanced=True,
    )
    """On horse, cow, bunny the first closes 1/4 to 1/3 of the length of all borders (the holes of
    single false balls), the second and third another tenth, more only webs between spikes."""
    clean_rims: bool = flag(
        True,
        "Clean rims",
        "Close slits and small holes that the balls beside them cover, and smooth the rims of the "
        "sheets: their points move along the sheet.",
        advanced=True,
    )


@algorithm(SkeletonMeshOptions, door=shape_or_cloud, prepare=balls_of)
def skeleton_mesh(
    cloud: MedialCloud, options: SkeletonMeshOptions, progress: Progress
) -> SkeletonMesh:
    """Connect the points of a surface skeleton to triangles.

    Parameters
    ----------
    cloud : MedialCloud
        k balls of a mesh. A triangle needs the balls of three neighbouring samples: a cloud that
        was thinned by more than `bridge` can close has few.

    Returns
    -------
    SkeletonMesh
        Its points keep the order of the cloud, its triangles that of the surface; ``selected``
        are the balls with angle and importance enough. It has no triangle when no sheet is left.

    Raises
    ------
    InvalidShapeError
        When the surface has no faces, or the cloud has two balls for one sample and side
        besides those of fans.

    See Also
    --------
    sheet_meshes : a mesh of each sheet apart.
    geodesic_importance, connected_importance : the measure behind `importance`.

    Notes
    -----
    A surface triangle a, b, c is lifted to the centers of the balls at its corners when

    1. the radius changes as it does on a sheet: along a sheet its slope is at most the cosine of
       half the spoke angle, so |r_a - r_b| <= |c_a - c_b| (cos(t_a/2) + cos(t_b/2))/2
       + |a - b|. A triangle that jumps from one sheet to another behind or before it runs along
       the spokes, where the slope is 1. The last term is what sampling and the tolerance can do to
       a radius. Ligatures pass, however stretched: there the centers move apart because the
       normals turn, at nearly the same radius.
    2. the three balls, larger by the longest side of a, b, c, cover the lifted triangle: it lies
       inside the shape, or outside by less than a sample spacing, which matters only where a wall
       is thinner than that.

    Rims are cleaned: slits and holes are closed where balls cover them, teeth cut off, and points
    of the rim moved to a mean of balls along it, within their own ball (see `rims.py`).

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
    >>> box = medialis.refine(medialis.make_shape(x, faces), longest_edge=0.05)
    >>> mesh = medialis.skeleton_mesh(medialis.surface_skeleton(box))
    >>> bool(np.abs(np.median(mesh.points[:, 2]) - 0.5) < 1e-6)
    True
    """
    cloud = cloud.own
    require_faces(cloud.surface)
    with progress.stage("select", 0.0, 0.6):
        selected = cloud.valid & (cloud.spoke_angles >= math.radians(options.min_spoke_angle))
        if options.importance > 0:
            importance = measured_importance(cloud, options, progress)
            selected &= important_points(importance, threshold=options.importance)
    # Another smallest piece takes the same triangles.
    chosen = options.min_spoke_angle, options.importance, options.bridge
    with progress.stage("skeleton mesh", 0.6, 1.0):
        mesh = kept(
            lifted,
            cloud,
            chosen,
            lambda: lifted(cloud, selected, options.bridge, progress),
            progress,
        )
    if options.smallest_piece > 0.0:
        mesh = _without_small_pieces(mesh, options.smallest_piece * cloud.surface.diagonal)
    return run_patiently(lambda: with_clean_rims(mesh), progress) if options.clean_rims else mesh


def with_clean_rims(mesh: SkeletonMesh) -> SkeletonMesh:
    """Close slits and small holes of a mesh, and smooth its rims (`rims.py`)."""
    if not len(mesh.faces):
        return mesh
    cloud, rows = mesh.cloud, mesh.rows
    spacing = local_spacing(cloud.surface)[cloud.source[rows]]
    rims = clean_rims(mesh, cloud.radii[rows], spacing)
    points, given, weights = rims.blend
    return SkeletonMesh(
        rims.at_points(mesh.points), rims.faces, rows[rims.kept], mesh.face_origin[rims.origin],
        cloud=cloud, selected=mesh.selected, blend=(points, rows[given], weights),
    )  # fmt: skip


def require_faces(shape: Shape) -> None:
    """Refuse a point cloud.

    Raises
    ------
    InvalidShapeError
    """
    if shape.faces is None:
        raise InvalidShapeError(
            "A skeleton mesh needs a surface with faces, got a point cloud: reconstruct a surface "
            "first, or use surface_skeleton, which shows points."
        )


def measured_importance(cloud: MedialCloud, options: Options, progress: Progress) -> Importance:
    """Return the importance of each ball, connected where the cloud is whole."""
    importance = geodesic_importance.of(cloud, options, progress)
    return connected_importance.of(importance, options, progress) if cloud.whole else importance


def lifted(cloud: MedialCloud, selected: Mask, bridge: int, progress: Progress) -> SkeletonMesh:
    """Return the mesh of the selected balls, with all its pieces, those of each side apart."""
    parts = [(np.empty((0, 3), np.int32), np.empty(0, np.int32))]
    sides = [sign for sign in (1, -1) if (cloud.side == sign).any()]
    for turn, sign in enumerate(sides):
        with progress.stage("lift", turn / len(sides), (turn + 1) / len(sides)):
            usable = selected & (cloud.side == sign)
            parts.append(_lift_side(cloud, usable, bridge, progress))
    triangles, origin = (np.concatenate(part) for part in zip(*parts, strict=True))
    return SkeletonMesh.of_rows(cloud, triangles, origin, selected)


def _rows_of_samples(cloud: MedialCloud, usable: Mask, bridge: int) -> IntArray:
    """Row that stands for each sample: of its own ball, else of a near sample's, else -1."""
    from medialis.skeleton._ball_kernels import bridge_gaps

    shape, rows = cloud.surface, np.flatnonzero(usable).astype(np.int32)
    row_near = np.full(shape.point_count, -1, np.int32)
    row_near[cloud.source[rows]] = rows
    if len(rows) != np.count_nonzero(row_near >= 0):
        raise InvalidShapeError("The cloud has several balls for one sample and side.")
    for _ in range(bridge):
        wider = row_near.copy()
        bridge_gaps(shape.faces, shape.points, cloud.source, row_near, wider)
        row_near = wider
    return row_near


def _lift_side(
    cloud: MedialCloud, usable: Mask, bridge: int, progress: Progress
) -> tuple[IntArray, IntArray]:
    """Triangles of one side as rows of the cloud, and the face each comes from."""
    # Imported here: compiled code takes half a second to load, and `medialis --help` needs none.
    from medialis.skeleton import _ball_kernels as kernels

    shape, k, m = cloud.surface, len(cloud), cloud.surface.face_count
    row_near = _rows_of_samples(cloud, usable, bridge)
    # The sheet bisects the two feature points. Zero and NaN rows belong to masked balls, which are
    # never used.
    chords = unit_rows(shape.points[cloud.features[:, 0]] - shape.points[cloud.features[:, 1]])
    known = shape.points, cloud.source, cloud.centers, cloud.radii
    balls = kernels.SheetBalls(*known, chords, np.cos(cloud.spoke_angles / 2))
    rows, ok = np.empty((m, 3), np.int32), np.zeros(m, np.bool_)
    given = RADIUS_SLACK, shape.faces, row_near, balls, rows, ok
    run_chunks(kernels.test_faces, m, FACES_A_CHUNK, *given, progress=progress)
    longest = np.zeros(k)
    kernels.longest_edges(rows, ok, cloud.centers, longest)
    across = np.where(usable, row_near[cloud.features[:, 1]], np.int32(-1))
    partner = np.full(k, -1, np.int32)
    kernels.find_partners(usable, across, balls, longest, partner)
    parent, parity, second = np.arange(k, dtype=np.int32), np.zeros(k, np.int8), np.zeros(k, bool)
    kernels.join_sides(rows, ok, partner, chords, parent, parity, second)
    lifted, stays = np.empty((m, 3), np.int32), np.zeros(m, np.bool_)
    kernels.lift_faces(rows, ok, partner, second, balls, lifted, stays)
    origin = np.flatnonzero(stays).astype(np.int32)
    first = first_equal_row(np.sort(lifted[origin], axis=1))
    origin = origin[first == np.arange(len(first))]  # no two with the same three corners
    return lifted[origin], origin


def _without_small_pieces(mesh: SkeletonMesh, radius: float) -> SkeletonMesh:
    """Drop the pieces all of whose points lie within the radius of their mean."""
    piece, count = mesh.components, mesh.part_count
    size = np.bincount(piece, minlength=count)
    mean = np.stack([np.bincount(piece, mesh.points[:, j], count) / size for j in range(3)], axis=1)
    far = np.linalg.norm(mesh.points - mean[piece], axis=1) > radius
    large = np.bincount(piece[far], minlength=count) > 0
    chosen = large[piece[mesh.faces[:, 0]]]
    triangles = mesh.rows[mesh.faces[chosen]]
    return SkeletonMesh.of_rows(mesh.cloud, triangles, mesh.face_origin[chosen], mesh.selected)
