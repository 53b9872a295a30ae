"""FeatureSets: all samples that a ball touches, in clusters (thesis 6.2.1.1).

Their number is the type of a medial point: rim, sheet or Y-curve (thesis 6.2.1.2), and points of
the rim can be filtered out (A3 filter, 6.2.1.3).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import Mask, Ragged, sums_of
from medialis.base.kept import Bound
from medialis.base.options import Options, algorithm, changed, number
from medialis.base.progress import Progress
from medialis.base.threads import run_chunks, run_patiently
from medialis.base.validation import FloatArray, IntArray, frozen, hold
from medialis.shape.graph import local_spacing, surface_graph
from medialis.shape.shape import Shape
from medialis.skeleton.medial_cloud import (
    MedialCloud,
    ShrinkOptions,
    Side,
    sample_tree,
    shrink_options,
)
from medialis.skeleton.surface_skeleton import Preparation, as_cloud, balls_of, shape_or_cloud

GOES_ROUND = 0.4  # halved 22 %, doubled 96 %
"""Agreement below which one cluster goes round its ball: 0 for a circle or a sphere, 0.30 for 3/4
of a circle, 0.5 for a half sphere, 0.64 for half a circle."""

BALLS_A_CHUNK = 4096
"""Some 20 milliseconds of work. On tubes each chunk finds the balls that lie on rings anew."""


@dataclass(frozen=True, eq=False, repr=False)
class FeatureSets(Bound):
    """All samples that each of the k balls of a cloud touches, in clusters.

    Attributes
    ----------
    samples : Ragged
        k rows: the samples that each ball touches, first its two feature points, then the others
        in no particular order; empty for a masked ball.
    clusters : (entries,) int16
        Cluster of each entry of ``samples.indices``, 0, 1, ... within its row; the first feature
        point is in cluster 0.
    counts : (k,) int32
        Number of clusters; 0 for a masked ball.
    agreement : (k,) float64
        Length of the mean of the unit normals of the faces there, 0 to 1: 0 where they go round the
        ball or come from two opposite walls, 0.71 across a right edge, 0.9 for the quarter circle
        of a rounded one, 1 on a plane. NaN for a masked ball.
    cloud : MedialCloud
        The balls.

    Raises
    ------
    InvalidShapeError
        When the arrays do not fit together.
    """

    samples: Ragged
    clusters: NDArray[np.int16]
    counts: IntArray
    agreement: FloatArray
    cloud: MedialCloud = field(kw_only=True)

    def __post_init__(self) -> None:
        k = len(self.cloud)
        hold(self, clusters=len(self.samples.indices), counts=k, agreement=k)

    def __len__(self) -> int:
        return len(self.samples)

    def __repr__(self) -> str:
        return f"FeatureSets({len(self)} balls, {len(self.samples.indices)} samples)"

    @property
    def closed(self) -> Mask:
        """True where the only cluster goes round the ball, as in a tube or a sphere, (k,)."""
        return (self.counts == 1) & (self.agreement < GOES_ROUND)

    @property
    def rim(self) -> Mask:
        """True where a ball has one contact that does not go round it: on the rim (A3), (k,)."""
        return (self.counts == 1) & ~self.closed


@dataclass(frozen=True, kw_only=True)
class FeatureSetOptions(Options):
    """Options of `extended_feature_transform`."""

    contact_gap: float = number(
        0.1,
        "Contact gap",
        "A sample belongs to a ball when it lies no more than this many sample spacings outside.",
        low=1e-9,
        high=10.0,
    )
    """The thesis's epsilon. A ball of radius r gathers the samples of a flat contact up to the
    distance sqrt(0.2 r h) from it: half a spacing h for r = 1.25 h, so that no contact is missed
    but by the smallest balls."""


@algorithm(FeatureSetOptions, door=as_cloud)
def extended_feature_transform(
    cloud: MedialCloud, options: FeatureSetOptions, progress: Progress
) -> FeatureSets:
    """Find all samples that each ball touches, and their clusters.

    Parameters
    ----------
    cloud : MedialCloud
        k balls.

    Returns
    -------
    FeatureSets
        Samples that are neighbours along the surface or share a neighbour, directly or through
        others of the same set, are one cluster.

    See Also
    --------
    point_types, medial_sheets, soft_edges, patches : what rests on the feature sets.

    Notes
    -----
    A set is cut to the two feature points when it has more than 1024 samples, which only a tube or
    a sphere with thousands of samples round one ball has. So memory is linear: at most 6 kB a ball,
    on organic meshes about 200 bytes.

    Source: thesis 6.2.1.1, Eq. 6.1. Deviates: clusters follow the edges of the mesh (in a cloud,
    nearest neighbours) instead of a single linkage cut at the local spacing. Both join samples that
    lie next to each other; edges need no length, so that long triangles do not tear a cluster and
    the two sides of a thin wall do not merge. Two edges are allowed, not one: the two samples that
    a small ball touches beside an edge of the shape often have one between them.

    Examples
    --------
    >>> import medialis
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    >>> sets = medialis.extended_feature_transform(cloud)
    >>> bool((sets.samples[7][:2] == cloud.features[7]).all()), bool(sets.counts.max() > 2)
    (True, True)
    """
    rows = np.flatnonzero(cloud.valid).astype(np.int32)
    spacing = run_patiently(lambda: local_spacing(cloud.surface), progress)
    gaps = np.zeros(len(cloud))
    gaps[rows] = options.contact_gap * spacing[cloud.features[rows]].mean(axis=1)
    with progress.stage("feature sets", 0.0, 1.0):
        return _find(cloud, rows, gaps, progress)


def _mean_face_normals(shape: Shape) -> FloatArray:
    """Mean of the unit normals of the faces at each sample, by area, (n, 3); shorter on a crease.

    The normal of the sample itself where it has no face. Faces are turned to agree with those.
    """
    if shape.faces is None:
        return shape.normals
    normals, corners = shape.face_vectors.copy(), np.asarray(shape.faces)
    outward = np.einsum("ij,ij->i", normals, shape.normals[corners].sum(axis=1))
    normals[outward < 0] *= -1.0
    area = np.repeat(2 * shape.face_areas, 3)
    n, corner = shape.point_count, corners.ravel()
    total = np.bincount(corner, area, minlength=n)[:, None]
    mean = sums_of(corner, np.repeat(normals, 3, axis=0), n)
    return np.divide(mean, total, out=shape.normals.copy(), where=total > 0)


def _find(cloud: MedialCloud, rows: IntArray, gaps: FloatArray, progress: Progress) -> FeatureSets:
    # Imported here: compiled code takes half a second to load, and `medialis --help` needs none.
    from medialis.sheets._kernels import Links, SetColumns, TouchingBalls, find_sets, place_sets

    k, shape = len(cloud), cloud.surface
    out = SetColumns(np.zeros(k, np.int64), np.zeros(k, np.int32), np.full(k, np.nan))
    chunks: dict[int, tuple[IntArray, NDArray[np.int16]]] = {}
    if len(rows):
        lengths = shrink_options(shape.diagonal, 0.0, 0.0)
        unit, tree = lengths.unit, sample_tree(shape, progress)
        rows = rows[np.argsort(tree.place[cloud.source[rows]], kind="stable")]
        gaps = gaps / unit
        reach = cloud.radii / unit + gaps
        centers = cloud.centers / unit - tree.center
        balls = TouchingBalls(centers, reach, gaps, cloud.features, lengths.margin)
        normals = run_patiently(lambda: _mean_face_normals(shape), progress)
        graph = run_patiently(lambda: surface_graph(shape), progress)
        links = Links(graph.offsets, graph.indices)

        def work(begin: int, end: int) -> None:
            chunks[begin] = find_sets(begin, end, rows, balls, normals, tree, links, out)

        run_chunks(work, len(rows), BALLS_A_CHUNK, progress=progress)
    offsets = np.concatenate([[0], np.cumsum(out.size)])
    samples, clusters = np.empty(offsets[-1], np.int32), np.empty(offsets[-1], np.int16)
    for begin, (touched, labels) in chunks.items():
        progress.update(1.0)
        part = rows[begin : begin + BALLS_A_CHUNK]
        place_sets(part, offsets, touched, labels, samples, clusters)
    return FeatureSets(Ragged(offsets, samples), clusters, out.clusters, out.agreement, cloud=cloud)


class PointType(IntEnum):
    """Type of a medial point; larger numbers are the number of contacts, A1^k."""

    NONE = 0
    """A masked ball."""
    A3 = 1
    """One contact, on the rim of a sheet, behind a convex edge, however soft."""
    SHEET = 2
    """Two contacts (A1^2), inside a sheet. Also balls of tubes and spheres, whose one contact goes
    all the way round."""
    Y_CURVE = 3
    """Three contacts (A1^3), near a curve where sheets meet."""


@dataclass(frozen=True, kw_only=True)
class PointTypesOptions(Preparation):
    """Options of `point_types`: only those of the balls."""

    side: Side = changed(ShrinkOptions, "side")


@algorithm(PointTypesOptions, keep=False, door=shape_or_cloud, prepare=balls_of)
def point_types(cloud: MedialCloud, options: PointTypesOptions, progress: Progress) -> IntArray:
    """Classify medial points by the number of places where their balls touch the surface.

    Parameters
    ----------
    cloud : MedialCloud
        k balls.

    Returns
    -------
    (k,) int32
        A `PointType`: 0 for masked balls, 1 for A3, 2 for A1^2, m for A1^m.

    See Also
    --------
    extended_feature_transform : the samples that each ball touches.

    Notes
    -----
    Near Y-curves a band about one sample wide has three types or more. Keep the points above type
    1 to regularize a skeleton (thesis 6.2.1.3): only its rim goes, one sample wide where the
    surface bends sharply, and nothing is torn.

    Source: thesis 6.2.1.2. Deviates: one cluster that goes round its ball is type 2, so that the
    filter leaves tubes alone.

    Examples
    --------
    >>> import medialis
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    >>> types = medialis.point_types(cloud)
    >>> regular = cloud.subset(types > medialis.PointType.A3)
    >>> 0 < len(regular) < len(cloud)
    True
    """
    sets = extended_feature_transform.of(cloud, options, progress)
    return frozen(np.where(sets.closed, PointType.SHEET, sets.counts), np.int32)
