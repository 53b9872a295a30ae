"""Planes: the flat faces of a part, as against the facets of what is rounded (for thesis 3.2).

A mesh of a part has faces of two kinds that look alike: flat ones, which are meant as they are, and
facets, chords of a smooth surface. Faces that lie in one plane and hang together are a region. What
tells both kinds apart is how much regions bend against each other, and how wide they are. Facets of
widths w and v on a surface of curvature k bend by k (w + v) / 2 at their common edge. Where the
surface goes over from a flat face into a rounded one, tangentially, the first half of this is
missing: k v / 2, however wide the flat face is. Curvature k is told by the next edge of the rounded
region. So a wide flat face beside a strip of facets bends far too little to be a chord itself.

Such a region stays as it is: at its corners the smooth surface has its normal, so that nothing of
it bulges, and what is rounded beside it ends tangent to it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import Index, Mask, Ragged, sums_of, unit_rows
from medialis.base.validation import FloatArray, IntArray, frozen
from medialis.shape.diagnosis import power_of_two_scale
from medialis.shape.surface import Surface

if TYPE_CHECKING:
    from medialis.shape._plane_kernels import Borders, Mesh, Regions

SAME_PLANE = 1e-6
"""Share of the diagonal: what lies less far from a plane is in it. Six digits of a text file."""

LARGE = 4.0
"""Mean areas of faces: smaller triangles between needles are no flat faces."""

AMISS = 0.1
"""Share of its rounded border at which a flat face may look like a facet."""

OF_A_PART = 0.05
"""Share of the surface that is flat in a part. A scan or an isosurface has some faces in a plane by
chance, up to 1.2 % on those tried, and nothing about them is special."""


def find_planes(surface: Surface, crease: float) -> IntArray:
    """Return the flat face of a part that each face of a mesh lies in, (m,); -1: in none.

    Parameters
    ----------
    surface : Surface
        A mesh of m faces.
    crease : float
        Radians: edges that bend by more are sharp, and tell nothing of what is rounded.

    Notes
    -----
    A region is no flat face where it looks like a facet along more than a tenth of its rounded
    border. Of single triangles nothing may: on irregular meshes of smooth shapes one in some
    thousands does so by chance, and there the surface is nearly flat. Cost O(m).
    """
    from medialis.shape import _plane_kernels as kernels

    surface = _in_range(surface)
    none = frozen(np.full(surface.face_count, -1), np.int32)
    mesh = _mesh(surface)
    regions = _regions(mesh, SAME_PLANE * surface.diagonal)
    least = OF_A_PART * regions.area.sum()
    may, beside = np.empty((2, len(regions.area)), np.bool_)
    large = LARGE * regions.area.sum() / max(int(regions.count.sum()), 1)
    kernels.find_candidates(mesh, regions, crease, large, may, beside)
    may &= regions.flat
    if regions.area[may].sum() < least:  # whatever their borders tell
        return none
    borders = _borders(mesh, regions, crease, beside)
    wide, plane = _widths(surface, mesh, regions, borders), np.empty(len(may), np.bool_)
    kernels.find_flat_regions(regions, borders, may, wide, AMISS, plane)
    if regions.area[plane].sum() < least:
        return none
    number = np.where(plane, np.cumsum(plane) - 1, -1)[regions.label]
    number[surface.flat_faces] = -1
    return frozen(number, np.int32)


def _in_range(surface: Surface) -> Surface:
    scale = power_of_two_scale(surface.points)
    if scale == 1.0:
        return surface
    return Surface.of_checked(surface.points * scale, surface.faces).adopt(surface.topology)


def _mesh(surface: Surface) -> Mesh:
    """Return what kernels need of a surface; edges of flat faces, or of odd ones, are left out."""
    from medialis.shape._plane_kernels import Mesh

    first, second, opposite = surface.edge_table.pairs
    bends = surface.edge_bends
    if surface.flat_faces.any() or not opposite.all():
        use = opposite & ~(surface.flat_faces[first // 3] | surface.flat_faces[second // 3])
        first, second, bends = first[use], second[use], bends[use]
    vectors, units, areas = surface.face_vectors, surface.face_normals, surface.face_areas
    faces = np.asarray(surface.faces)
    return Mesh(surface.points, faces, vectors, units, areas, first, second, bends)


def _regions(mesh: Mesh, near: float) -> Regions:
    """Put faces that hang together in one plane into regions."""
    from medialis.shape import _plane_kernels as kernels

    label = np.empty(len(mesh.faces), np.int32)
    kernels.join_planes(mesh, near, np.arange(len(label), dtype=np.int32), label)
    r = int(label.max(initial=-1)) + 1
    columns = np.zeros(r, np.int64), np.zeros((r, 3)), np.zeros(r), np.zeros(r, np.bool_)
    regions = kernels.Regions(label, *columns)
    kernels.measure_regions(mesh, near, regions)
    return regions


def _borders(mesh: Mesh, regions: Regions, crease: float, beside: Mask) -> Borders:
    """Return the borders of pairs of regions at edges of wanted ones: they lie on one line each."""
    from medialis.shape import _plane_kernels as kernels

    keys, starts = np.empty(len(mesh.first), np.int64), np.empty(len(mesh.first) + 1, np.int32)
    pairs = kernels.list_borders(mesh, regions, crease, beside, keys, starts)
    one, other = np.empty((2, 2 * pairs), np.int32)
    length, bend = np.empty((2, 2 * pairs))
    borders = kernels.Borders(one, other, length, bend, np.empty((2 * pairs, 3)))
    kernels.measure_borders(mesh, regions, keys, starts[: pairs + 1], borders)
    return borders


def _widths(surface: Surface, mesh: Mesh, regions: Regions, borders: Borders) -> FloatArray:
    """Return how wide region `one` is across each border, (b,)."""
    from medialis.shape import _plane_kernels as kernels

    around, wide = np.zeros(len(regions.area)), np.empty(len(borders.one))
    if (regions.count > 2).any():
        kernels.measure_perimeters(mesh, regions, surface.edge_twins, around)
    faces = Ragged.group(regions.label, len(regions.area))
    kernels.measure_widths(mesh, regions, borders, around, faces.offsets, faces.indices, wide)
    return wide


def plane_normals(surface: Surface, planes: IntArray) -> FloatArray:
    """Return the unit normal of each plane, (p, 3)."""
    rows = np.flatnonzero(planes >= 0)
    count = int(planes.max(initial=-1)) + 1
    vectors = np.asarray(_in_range(surface).face_vectors)[rows]
    return unit_rows(sums_of(planes[rows], vectors, count), 1e-300)


def only_plane(group: NDArray[Any], planes: NDArray[Any], count: int) -> Index:
    """Return the plane of each group of faces, (count,); -1: there is none, or there are several.

    Of each face its group and its plane are given, -1 where it lies in none.
    """
    rows = np.flatnonzero(planes >= 0)
    most, least = np.full(count, -1, np.int64), np.full(count, np.iinfo(np.int64).max)
    np.maximum.at(most, group[rows], planes[rows])
    np.minimum.at(least, group[rows], planes[rows])
    return np.where(most == least, most, -1)


def with_planes(
    normals: FloatArray, surface: Surface, planes: IntArray, crease: float
) -> FloatArray:
    """Return vertex normals that are those of planes, where a smooth surface ends at one.

    Parameters
    ----------
    normals : (n, 3) float64
    surface : Surface
    planes : (m,) int32
        `find_planes`.
    crease : float
        Radians: vertices where two edges bend by more keep their normals.
    """
    if (planes < 0).all():
        return normals
    faces = np.asarray(surface.faces)
    plane = only_plane(faces.ravel(), np.repeat(planes, 3), surface.point_count)
    first = surface.edge_table.pairs[0][surface.edge_bends > crease]
    ends = [faces[first // 3, (first + step) % 3] for step in (0, 1)]
    creases = np.bincount(np.concatenate(ends), minlength=surface.point_count)
    rows = np.flatnonzero((plane >= 0) & (creases < 2) & np.asarray(normals).any(axis=1))
    result = np.array(normals)
    result[rows] = plane_normals(surface, planes)[plane[rows]]
    return frozen(result, np.float64)
