"""Noise of a surface: how much there is, and a copy of the mesh without it.

The level is measured where it matters, between neighbouring vertices: how far a vertex lies off a
quadric through the vertices round it. A smooth surface lies off as well where it bends within the
neighbourhood, but that part grows quickly with the size of the neighbourhood and the noise does not
grow, so two sizes tell them apart. A low quantile leaves out sharp edges; a vertex whose faces lie
in one plane is not off at all, however near to sharp edges it is. Where neighbourhoods close round
a thin tube nothing tells noise from its shape; such vertices are left out.

The copy is smoothed by a thin plate, which takes away bends shorter than a length and leaves
straight and evenly curved parts as they are. The length follows from the noise: long enough for the
normals to be of use.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from medialis.base.errors import InvalidShapeError
from medialis.base.validation import FloatArray, IntArray, as_number
from medialis.shape.normals import CREASE_ANGLE, ring_normals
from medialis.shape.reading import ShapeLike, as_shape
from medialis.shape.shape import Shape

MOST_MEASURED = 4000  # halved 5 %, doubled 0 %
"""Vertices that the level is measured at: its error is some 4 % then."""

FEWEST_MEASURED = 100
LEAST_NEIGHBOURS, MOST_NEIGHBOURS = 10, 300
MOST_EDGES = 30  # halved 0 %, doubled 0 %
"""Vertices with more edges, the hubs of fans, are left out: their rings reach everywhere."""

QUANTILE, NORMAL_QUANTILE = 0.25, 0.31864  # halved 34 %, doubled 13 %; halved 13 %, doubled 38 %
"""Of the distances from the quadric, and the same of a normal distribution."""

BENDING = 2.0  # halved 100 %, doubled 0.6 %
"""Ratio of what bending adds in three rings and in two, at least: 2.0 to 3.0 on real meshes without
noise, more on mechanical parts."""

FLAT, SHARP = 1e-3, math.radians(CREASE_ANGLE)
"""Bends of edges in radians that are flat, and sharp."""

LONG, SHORT = 2.0, 0.1  # halved 0 %, doubled 0 %; halved 0 %, doubled 0 %
"""Length of a long edge, in units of the length that this share of the edges is shorter than."""

FLAT_SHARE, SHARP_SHARE = 0.25, 0.1  # halved 0 %, doubled 0 %; halved 0 %, doubled 0 %
"""Of the edges of a mesh from a CAD program, at least: washers, pipes and perforated plates of few
vertices have 50 to 60 % and 33 to 37 %; scans and sculptures below 1 % flat ones."""

SLOPE = 0.05  # halved 46 %, doubled 20 %
"""Slope that is left of the noise after smoothing, 3 degrees. With 0.2 false branches stay; with
0.03 no branch more is right, and thin parts shrink more."""

SHORTEST, LONGEST = 0.6, 4.0  # halved 0 %, doubled 50 %; halved 0 %, doubled 0 %
"""Spacings: smoothing lengths. A shorter one hardly changes bends of a few spacings; the longest is
that for noise of four times the spacing."""

PRECISE, MOST_STEPS = 1e-4, 2000  # halved 0.2 %, doubled 0.5 %; halved 0 %, doubled 0 %
"""Share of the change to which the smoothing is solved, and when to stop in any case."""


def noise_level(shape: ShapeLike) -> float:
    """Estimate the standard deviation of the noise of the vertices of a mesh.

    Parameters
    ----------
    shape : Shape
        A mesh of n vertices. Sharp edges, curvature and holes do not count as noise.

    Returns
    -------
    float
        Along the normal, in the units of the points; 0 for a clean mesh, for a point cloud and for
        a mesh with too few vertices to tell.

    See Also
    --------
    smooth_noise : removes it.
    surface_skeleton : does both where needed.

    Notes
    -----
    Cost O(n), and quadrics through 19 and 37 neighbours of 4000 vertices. Within 8 % of the true
    level on real meshes with Gaussian noise of 6 to 120 % of the spacing. Not in the thesis.

    Examples
    --------
    >>> import medialis
    >>> shape = medialis.organic_shape(56)
    >>> medialis.noise_level(shape) < 0.05 * shape.spacing
    True
    """
    return noise_above(as_shape(shape), 0.0)


def noise_above(shape: Shape, least: float) -> float:
    """Return the level of the noise of a mesh, or 0 as soon as it is known to be below `least`."""
    if shape.faces is None or len(shape.edges) == 0 or _constructed(shape):
        return 0.0
    n = shape.point_count
    rows = np.arange(0, n, 1 + n // MOST_MEASURED)
    links = _Links.of(shape)
    near = links.off_quadrics(rows, 2)
    if _level(near, 0.0 * near) < least:
        return 0.0  # what is three rings away can only take from it
    far = links.off_quadrics(rows, 3)
    level = _level(near, far)
    if level <= least:
        return 0.0
    # Rings that close round a tube are off any quadric, and grow no more.
    ahead = links.lie_ahead(rows, _plate(shape, 1.0).normals)
    return _level(near[ahead], far[ahead])


def _level(near: FloatArray, far: FloatArray) -> float:
    """Return the noise by distances from quadrics of two and three rings; NaN is left out."""
    deviation = []
    for away in (near[~np.isnan(near)], far[~np.isnan(far)]):
        if len(away) < FEWEST_MEASURED:
            return 0.0
        deviation.append(float(np.quantile(away, QUANTILE)) / NORMAL_QUANTILE)
    square = (BENDING**2 * deviation[0] ** 2 - deviation[1] ** 2) / (BENDING**2 - 1)
    return math.sqrt(max(0.0, square))


def _constructed(shape: Shape) -> bool:
    """Tell meshes of flat faces and sharp edges: all their vertices lie on edges, none is noise.

    Noise bends every edge, so that few are flat; steps of voxels have edges of equal lengths.
    """
    bends = shape.edge_bends
    some = len(bends) > 0 and (bends < FLAT).mean() > FLAT_SHARE
    if not some or (bends > SHARP).mean() <= SHARP_SHARE:
        return False
    return bool(shape.edge_lengths.max() >= LONG * np.quantile(shape.edge_lengths, SHORT))


@dataclass(frozen=True, eq=False)
class _Links:
    """The neighbours of each vertex, without the hubs of fans, and whether its faces are flat."""

    points: FloatArray
    flat: NDArray[np.bool_]
    offsets: NDArray[np.int64]
    neighbours: IntArray

    @classmethod
    def of(cls, shape: Shape) -> _Links:
        from medialis.shape._normal_kernels import list_links

        offsets = np.zeros(shape.point_count + 2, np.int64)
        neighbours = np.empty(2 * len(shape.edges), np.int32)
        list_links(shape.edges, MOST_EDGES, offsets, neighbours)
        return cls(shape.points, _on_planes(shape), offsets, neighbours)

    def _rings(self, rows: NDArray[np.int64], steps: int) -> tuple[IntArray, NDArray[np.int64]]:
        """Return the vertices up to some steps from each row, and how many there are."""
        from medialis.shape._normal_kernels import find_rings

        rings = np.empty((len(rows), MOST_NEIGHBOURS), np.int32)
        counts = np.empty(len(rows), np.int64)
        find_rings(rows, steps, self.offsets, self.neighbours, rings, counts)
        return rings, counts

    def lie_ahead(self, rows: NDArray[np.int64], normals: FloatArray) -> NDArray[np.bool_]:
        """Tell rows whose three rings do not turn to the other side, by normals without noise."""
        rings, counts = self._rings(rows, 3)
        there = np.arange(MOST_NEIGHBOURS) < counts[:, None]
        along = np.zeros(there.shape)
        row, place = np.nonzero(there)
        along[row, place] = np.einsum("ij,ij->i", normals[rings[there]], normals[rows[row]])
        return np.asarray((along >= 0).all(axis=1))

    def off_quadrics(self, rows: NDArray[np.int64], steps: int) -> FloatArray:
        """Return how far rows lie off quadrics through their rings, in deviations of equal noise.

        A point itself is no part of its ring. Those with few neighbours, and with very many, have
        NaN; those of flat faces are off by nothing.
        """
        from medialis.shape._normal_kernels import measure_off_quadrics, measure_spread

        rings, counts = self._rings(rows, steps)
        use = (counts < MOST_NEIGHBOURS) & (counts >= LEAST_NEIGHBOURS)
        known, rings, counts = rows[use], rings[use], counts[use]
        spread = np.empty((len(known), 4, 3))
        measure_spread(self.points, known, rings, counts, spread)
        size, axes = np.linalg.eigh(spread[:, :3])  # the normal first
        size, off = np.sqrt(np.maximum(size[:, 2], 1e-300)), np.empty(len(known))
        means = spread[:, 3].copy()
        measure_off_quadrics(self.points, known, rings, counts, means, axes, size, off)
        away = np.full(len(rows), np.nan)
        away[use] = np.where(self.flat[known], 0.0, off)
        return away


def _on_planes(shape: Shape) -> NDArray[np.bool_]:
    """Tell the vertices at which no edge bends, (n,)."""
    from medialis.shape._normal_kernels import mark_bent

    result = np.ones(shape.point_count, np.bool_)
    mark_bent(shape.edge_table.pairs[0], shape.edge_bends, FLAT, shape.faces, result)
    return result


def smooth_noise(shape: ShapeLike, level: float) -> tuple[Shape, float]:
    """Smooth a mesh as much as noise of a given level needs, and no more.

    Parameters
    ----------
    shape : Shape
        A mesh of n vertices.
    level : float
        Standard deviation of the noise, a length: ``noise_level(shape)``. 0 changes nothing.

    Returns
    -------
    Shape
        With the same faces, moved vertices and new normals.
    float
        What is left of the noise, its standard deviation as a length.

    Raises
    ------
    InvalidShapeError
        When the shape has no faces.
    InvalidOptionError
        When the level is not a number from 0.

    See Also
    --------
    noise_level : measures it.
    surface_skeleton : does both where needed.

    Notes
    -----
    Minimizes the sum of ``d |x - x0|^2 + 16 m^4 d |x - y|^2`` over the vertices, y the mean of the
    d neighbours: a bend of wave number k per spacing keeps 1 / (1 + (m k)^4) of its height. Of
    white noise of deviation s on a spacing h that leaves the height s / (4 m) and the slope
    s / (5 h m^2), from which the length m follows. Borders bend freely. Not in the thesis.

    Examples
    --------
    >>> import medialis
    >>> import numpy as np
    >>> clean = medialis.organic_shape(80)
    >>> step = np.random.default_rng(0).normal(size=clean.points.shape) * 0.003 * clean.diagonal
    >>> rough = medialis.make_shape(clean.points + step, clean.faces)
    >>> smooth, left = medialis.smooth_noise(rough, medialis.noise_level(rough))
    >>> medialis.noise_level(smooth) < medialis.noise_level(rough)
    True
    """
    shape = as_shape(shape)
    if shape.faces is None:
        raise InvalidShapeError("Smoothing needs a mesh, got a point cloud.")
    level = as_number(level, "level", low=0.0)
    if level == 0.0 or len(shape.edges) == 0:
        return shape, 0.0
    # Noise makes edges longer: the spacing is that of a copy without the noise of single vertices.
    spacing = _plate(shape, 1.0).spacing
    length = LONGEST
    if spacing > 0:
        length = min(max(math.sqrt(level / (5 * SLOPE * spacing)), SHORTEST), LONGEST)
    return _plate(shape, length), level / (4 * length)


def _plate(shape: Shape, length: float) -> Shape:
    """Bend a mesh like a thin plate that is tied to its vertices; the length is in spacings."""
    assert shape.faces is not None
    links = shape.edge_matrix
    degree = np.diff(links.indptr).astype(np.float64)
    bends = degree > 0
    twins = shape.edge_twins
    bends[shape.faces.ravel()[twins < 0]] = False
    bends[np.roll(shape.faces, -1, axis=1).ravel()[twins < 0]] = False
    weight = (16 * length**4 * bends / np.maximum(degree, 1))[:, None]
    degree = np.maximum(degree, 1)[:, None]

    def apply(x: FloatArray) -> FloatArray:
        bend = weight * (degree * x - links @ x)
        return np.asarray(degree * bend - links @ bend)

    # The change of the points, by conjugate gradients with the degrees as preconditioner; the three
    # coordinates share each product. Sums by einsum: the same bits on any number of threads.
    right = -apply(shape.points - shape.points.mean(axis=0))
    change, rest = np.zeros_like(right), right
    step = rest / degree
    size = np.einsum("ij,ij->j", rest, step)
    enough = PRECISE**2 * size
    for _ in range(MOST_STEPS):
        if (size <= enough).all():
            break
        bent = degree * step + apply(step)
        share = size / np.maximum(np.einsum("ij,ij->j", step, bent), 1e-300)
        change, rest = change + share * step, rest - share * bent
        ready = rest / degree
        before, size = size, np.einsum("ij,ij->j", rest, ready)
        step = ready + size / np.maximum(before, 1e-300) * step
    points = shape.points + change
    normals = ring_normals(points, shape.faces)
    return shape.remade(points=points, normals=normals, planes=None, cylinders=None)
