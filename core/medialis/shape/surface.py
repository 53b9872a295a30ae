"""Surface: triangles, or points alone, with each geometric quantity named and computed once.

`Topology` is the part that follows from the faces alone, whatever their points.

`solid_boundary` is the boundary of the solid that a mesh encloses, as a closed manifold: handles
are counted on it. Where a mesh touches itself in a vertex, it has a vertex for each fan of faces.
Where more than two faces meet at an edge, it passes there once for each wedge of the solid: the
solid lies behind each face, so on going round the edge a face that enters it belongs to the next
that leaves. Faces that are left over are walls within the solid or fins on it. Holes are closed by
fans of triangles.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.base.arrays import (
    EdgeTable,
    Index,
    Mask,
    Ragged,
    extent,
    first_equal_row,
    kd_tree,
    next_side,
)
from medialis.base.kept import Bound
from medialis.base.validation import FloatArray, IntArray, Positions, as_faces, as_points, frozen

if TYPE_CHECKING:
    from medialis.shape.bodies import Bodies


class Topology:
    """How triangles hang together; each quantity is computed when it is first asked for, once.

    Half-edge 3 f + j is side j of face f, from its corner j to the next one.

    Parameters
    ----------
    faces : (m, 3) int32
        May be empty.
    point_count : int
    """

    def __init__(self, faces: IntArray, point_count: int) -> None:
        self.faces = faces
        self.point_count = point_count

    @cached_property
    def edge_table(self) -> EdgeTable:
        """The half-edges of each edge, sorted once for all that needs them."""
        return EdgeTable.of(self.faces, self.point_count)

    @cached_property
    def edges(self) -> IntArray:
        """Undirected edges (e, 2), see `Surface.edges`."""
        edges = self.edge_table.ends
        loops = edges[:, 0] == edges[:, 1]
        return frozen(edges[~loops] if loops.any() else edges, np.int32)

    @cached_property
    def edge_twins(self) -> IntArray:
        """The same edge in the neighbouring face, (3m,), see `Surface.edge_twins`."""
        from medialis.shape._kernels import list_twins

        result = np.full(3 * len(self.faces), -1, np.int32)
        list_twins(*self.edge_table.pairs[:2], result)
        return frozen(result, np.int32)

    @cached_property
    def is_solid(self) -> bool:
        """Whether each edge has two faces, which agree on their outside, and each vertex one ring.

        So it is where the faces bound a solid that touches itself nowhere, or several.
        """
        from medialis.shape._kernels import count_rings

        *_, opposite = self.edge_table.pairs
        if 2 * len(opposite) != 3 * len(self.faces) or not opposite.all():
            return False
        twins = self.edge_twins  # an edge of a face that names a vertex twice has none
        if twins.min(initial=0) < 0:
            return False
        rings = count_rings(twins, np.zeros(len(twins), np.bool_))
        return rings == int(np.count_nonzero(self.used_points))

    @cached_property
    def used_points(self) -> Mask:
        """True for the points that faces use, (n,)."""
        from medialis.shape._kernels import mark_corners

        used = np.zeros(self.point_count, np.bool_)
        mark_corners(self.faces, used)
        return frozen(used, np.bool_)

    @cached_property
    def fans(self) -> Ragged:
        """For each point the half-edges that leave it, ascending: one for each face there."""
        return Ragged.group(self.faces.ravel(), self.point_count)

    @cached_property
    def components(self) -> IntArray:
        """Connected component of each point, (n,), numbered by their lowest vertex."""
        from medialis.shape._kernels import label_components

        label = np.empty(self.point_count, np.int32)
        label_components(self.faces, np.arange(len(label), dtype=np.int32), label)
        return frozen(label, np.int32)

    @cached_property
    def part_count(self) -> int:
        """Number of components that have faces."""
        unused = len(self.used_points) - int(np.count_nonzero(self.used_points))
        return int(self.components.max(initial=-1)) + 1 - unused

    @cached_property
    def face_pieces(self) -> IntArray:
        """Piece of each face, (m,), see `Surface.face_pieces`."""
        from medialis.shape._kernels import label_face_pieces

        if self.__dict__.get("is_solid") and self.part_count == 1:
            return frozen(np.zeros(len(self.faces)), np.int32)
        label = np.empty(len(self.faces), np.int32)
        label_face_pieces(self.edge_twins, np.arange(len(label), dtype=np.int32), label)
        return frozen(label, np.int32)

    def corner_fans(self) -> IntArray:
        """Fan of each corner, (3m,): corners of one vertex joined across edges of two faces."""
        from medialis.shape._kernels import label_corner_fans

        label = np.empty(3 * len(self.faces), np.int32)
        label_corner_fans(*self.edge_table.pairs, np.arange(len(label), dtype=np.int32), label)
        return frozen(label, np.int32)

    @cached_property
    def first_equal_face(self) -> NDArray[np.int64]:
        """The first face with the same three corners in any order, (m,); mostly the face itself."""
        from medialis.shape._kernels import has_equal_faces

        # Where an edge has two faces at most, equal ones share all of theirs.
        table = self.edge_table
        if table.counts.max(initial=0) < 3 and not has_equal_faces(self.edge_twins):
            return np.arange(len(self.faces))
        # Three at a time: numpy goes along the short axis one by one.
        a, b, c = (self.faces[:, j].astype(np.int64) for j in range(3))
        low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
        middle = a + b + c - low - high
        return first_equal_row(np.stack([low, middle, high], axis=1))


def piece_labels(count: int, links: NDArray[Any]) -> IntArray:
    """Return the connected piece of each of `count` nodes, numbered by their lowest node.

    Parameters
    ----------
    count : int
    links : (e, 2) int
        Pairs of nodes in any order.

    Examples
    --------
    >>> piece_labels(5, np.array([[0, 3], [1, 4]])).tolist()
    [0, 1, 2, 0, 1]
    """
    from medialis.base._kernels import label_pieces

    pairs = np.ascontiguousarray(np.asarray(links).reshape(-1, 2), np.int64)
    label = np.empty(count, np.int32)
    label_pieces(pairs, np.arange(count, dtype=np.int32), label)
    return frozen(label, np.int32)


FLAT_HEIGHT = 1e-12
"""A face is flat when its height is at most this part of its longest edge. Rounding of the
differences leaves a height of about 1e-16 to an exactly flat face; no real face is that thin."""


class Surface(Bound):
    """A triangle mesh, or a cloud of points, and what its geometry tells.

    Every quantity is computed when it is first asked for, once. Half-edge 3 f + j is side j of face
    f, from its corner j to the next one.

    Parameters
    ----------
    points : (n, 3) float
        Vertices in the caller's units.
    faces : (m, 3) int, optional
        Triangles; None or no rows: a cloud.

    Raises
    ------
    InvalidShapeError
        When an array has the wrong shape, is not finite, or a face index is out of range.

    Examples
    --------
    >>> import medialis
    >>> square = medialis.Surface([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]],
    ...                           [[0, 1, 2], [0, 2, 3]])
    >>> square.area, square.edges.tolist(), square.border_edges
    (1.0, [[0, 1], [0, 2], [0, 3], [1, 2], [2, 3]], 4)
    """

    points: Positions
    faces: IntArray | None

    def __init__(self, points: ArrayLike, faces: ArrayLike | None = None) -> None:
        self.points = as_points(points)
        given = None if faces is None else as_faces(faces, len(self.points))
        self.faces = None if given is None or len(given) == 0 else given

    @classmethod
    def of_checked(cls, points: FloatArray, faces: IntArray | None = None) -> Surface:
        """Return a surface of arrays that follow from checked ones: they are looked at no more."""
        made = object.__new__(Surface)
        made.points = frozen(points, np.float64)
        made.faces = None if faces is None or len(faces) == 0 else frozen(faces, np.int32)
        return made

    def __repr__(self) -> str:
        faces = "a cloud" if self.faces is None else f"{self.face_count} faces"
        unit = getattr(self, "unit", None)
        size = f"{self.diagonal:.6g} {unit or ''}".rstrip()
        counts = f"{self.point_count} points, {faces}, diagonal {size}"
        return f"{type(self).__name__}({counts})"

    @property
    def point_count(self) -> int:
        """Number of points n."""
        return len(self.points)

    @property
    def face_count(self) -> int:
        """Number of triangles m (0 for a cloud)."""
        return 0 if self.faces is None else len(self.faces)

    @cached_property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper corner of the bounding box, two (3,) arrays."""
        low, high = extent(self.points)
        return frozen(low, np.float64), frozen(high, np.float64)

    @cached_property
    def diagonal(self) -> float:
        """Length of the bounding-box diagonal: the unit of every length option."""
        low, high = self.bounds
        return math.hypot(*(high - low))  # the square of 1e-200 would be 0

    @cached_property
    def offset(self) -> FloatArray:
        """What was taken from all points so that they lie near the origin, (3,); mostly zero."""
        return frozen(np.zeros(3), np.float64)

    # Faces

    @cached_property
    def face_vectors(self) -> FloatArray:
        """Normal of each face times twice its area, (m, 3)."""
        from medialis.shape._kernels import cross_faces

        vectors = np.empty((self.face_count, 3))
        if self.faces is not None:
            cross_faces(self.points, self.faces, vectors)
        return frozen(vectors, np.float64)

    @property
    def face_areas(self) -> FloatArray:
        """Area of each face, (m,)."""
        return self._face_measures[0]

    @property
    def face_normals(self) -> FloatArray:
        """Unit normal of each face, (m, 3); zero where a face has no area."""
        return self._face_measures[1]

    @property
    def flat_faces(self) -> Mask:
        """True for faces with (nearly) no height, (m,), see `FLAT_HEIGHT`."""
        return self._face_measures[2]

    @cached_property
    def _face_measures(self) -> tuple[FloatArray, FloatArray, Mask]:
        from medialis.shape._kernels import measure_faces

        m = self.face_count
        areas, units, flat = np.empty(m), np.empty((m, 3)), np.empty(m, np.bool_)
        if self.faces is not None:
            measure_faces(self.points, self.faces, FLAT_HEIGHT, areas, units, flat)
        return frozen(areas, np.float64), frozen(units, np.float64), frozen(flat, np.bool_)

    @property
    def area(self) -> float:
        """Area of all faces."""
        return float(self.face_areas.sum())

    @cached_property
    def point_areas(self) -> FloatArray:
        """Area that each point stands for, (n,): a third of its faces; 1 in a cloud."""
        if self.faces is None:
            return frozen(np.ones(self.point_count), np.float64)
        third = np.repeat(self.face_areas / 3, 3)
        return frozen(np.bincount(self.faces.ravel(), third, self.point_count), np.float64)

    # Edges

    @cached_property
    def topology(self) -> Topology:
        """What follows from the faces alone."""
        none = np.empty((0, 3), np.int32)
        return Topology(none if self.faces is None else self.faces, self.point_count)

    def adopt(self, known: Topology) -> Self:
        """Use what is known of the same faces, where they are the same; return this surface."""
        own = self.topology
        if own.point_count == known.point_count and np.array_equal(own.faces, known.faces):
            self.__dict__["topology"] = known
        return self

    def adopt_measures(self, known: Surface) -> Self:
        """Use what was measured of faces and edges of the same points, and `adopt` its topology."""
        same = self.adopt(known.topology).topology is known.topology
        if same and np.array_equal(self.points, known.points):
            names = "_face_measures", "face_vectors", "edge_bends"
            self.__dict__.update({n: known.__dict__[n] for n in names if n in known.__dict__})
        return self

    def adopt_turned(self, known: Surface, turned: Mask) -> None:
        """Use what is the same on a surface some faces of which, whole pieces, are turned over."""
        own, its = self.topology.__dict__, known.topology.__dict__
        own["edge_table"] = known.edge_table.turned(turned)
        names = "edges", "used_points", "components", "face_pieces", "first_equal_face", "is_solid"
        own.update({name: its[name] for name in names if name in its})
        if turned.all():  # no minus before a zero
            vectors, units = (
                frozen(0.0 - v, np.float64) for v in (known.face_vectors, known.face_normals)
            )
            measures = known.face_areas, units, known.flat_faces
            self.__dict__ |= {"face_vectors": vectors, "_face_measures": measures}

    @property
    def edge_table(self) -> EdgeTable:
        """The half-edges of each edge, sorted once for all that needs them."""
        return self.topology.edge_table

    @property
    def edges(self) -> IntArray:
        """Undirected edges (e, 2), lower index first, in ascending order; empty for a cloud.

        A face that names a vertex twice has no edge from the vertex to itself.
        """
        return self.topology.edges

    @cached_property
    def edge_lengths(self) -> FloatArray:
        """Length of each edge, (e,)."""
        from medialis.shape._kernels import measure_edges

        lengths = np.empty(len(self.edges))
        measure_edges(self.points, self.edges, lengths)
        return frozen(lengths, np.float64)

    @cached_property
    def edge_bends(self) -> FloatArray:
        """Angle in radians between the two faces at each edge of two, in the order of its pairs.

        0 in one plane, and where a face has no area; see `EdgeTable.pairs`.
        """
        from medialis.shape._kernels import measure_bends

        first, second, _ = self.edge_table.pairs
        bends = np.empty(len(first))
        measure_bends(first, second, self.face_normals, bends)
        return frozen(bends, np.float64)

    @property
    def edge_twins(self) -> IntArray:
        """The same edge in the neighbouring face, (3m,), for each half-edge.

        -1 at a border, at a non-manifold edge (three or more faces) and where a face that names a
        vertex twice meets itself.
        """
        return self.topology.edge_twins

    @cached_property
    def face_adjacency(self) -> IntArray:
        """Face across each side, (m, 3); side j joins corners j and j + 1; -1: see `edge_twins`."""
        twins = self.edge_twins.reshape(-1, 3)
        return frozen(np.where(twins < 0, -1, twins // 3), np.int32)

    @property
    def fans(self) -> Ragged:
        """For each point the half-edges that leave it, ascending: one for each face there."""
        return self.topology.fans

    @property
    def border_edges(self) -> int:
        """Edges with a single face, where all others have two: 0 for a closed surface."""
        return 2 * len(self.edges) - 3 * self.face_count

    @property
    def used_points(self) -> NDArray[np.bool_]:
        """True for the points that faces use, (n,); for all of a cloud."""
        if self.faces is None:
            return frozen(np.ones(self.point_count), np.bool_)
        return self.topology.used_points

    # Neighbours

    @cached_property
    def spacing(self) -> float:
        """Mean distance of neighbouring samples: the mean edge length.

        For a cloud, or a mesh whose vertices carry no edges, it is the mean distance to the
        nearest other sample (0 when all samples coincide).
        """
        if len(self.edges):
            return float(self.edge_lengths.mean())
        return float(self.nearest_distances.mean()) if self.point_count > 1 else 0.0

    @cached_property
    def nearest_distances(self) -> FloatArray:
        """Distance of each point to the nearest other one, (n,): 0 where points coincide.

        inf where there is no other point. A search costs as much as points coincide with the one
        that it starts from, so each place is looked at once.
        """
        first = self.first_equal_point
        if (first == np.arange(self.point_count)).all():
            return frozen(_nearest_others(self.tree, self.points), np.float64)
        count = np.bincount(first, minlength=self.point_count)
        places, alone = self.points[count > 0], count == 1
        result = np.zeros(self.point_count)
        if alone.any():
            result[alone] = _nearest_others(kd_tree(places), self.points[alone])
        return frozen(result, np.float64)

    @cached_property
    def first_equal_point(self) -> NDArray[np.int64]:
        """The first point at exactly the same place, (n,); mostly the point itself."""
        return first_equal_row(self.points)

    @cached_property
    def tree(self) -> Any:
        """The kd-tree of the points."""
        return kd_tree(self.points)

    @cached_property
    def edge_matrix(self) -> Any:
        """Sparse (n, n) float64 array with 1 for each edge, in both directions."""
        return link_matrix(self.point_count, self.edges)

    @cached_property
    def cotangent_weights(self) -> Any:
        """Sparse (n, n) float64 array: half the cotangents of the angles across each edge.

        Faces with nearly no area count as a little larger, so that weights stay in range: at least
        1e-12 of the largest face, and of the square of the diagonal where no face has an area.
        """
        from scipy.sparse import coo_array

        n = self.point_count
        if self.faces is None:
            return coo_array((n, n)).tocsr()
        twice = 2 * self.face_areas
        largest = float(twice.max(initial=0)) or self.diagonal**2 or 1.0
        safe = np.maximum(twice, 1e-12 * largest)
        left, right = (np.roll(self.faces, -step, axis=1) for step in (1, 2))
        u, v = (self.points[side] - self.points[self.faces] for side in (left, right))
        weights = 0.5 * (u * v).sum(axis=2) / safe[:, None]
        ends = left.T.ravel(), right.T.ravel()
        one_way = coo_array((weights.T.ravel(), ends), shape=(n, n)).tocsr()
        return (one_way + one_way.T).tocsr()

    @cached_property
    def components(self) -> IntArray:
        """Connected component of each point, (n,), numbered by their lowest vertex.

        Faces connect their corners. In a cloud every point has number 0.
        """
        if self.faces is None:
            return frozen(np.zeros(self.point_count), np.int32)
        return self.topology.components

    @property
    def part_count(self) -> int:
        """Number of components that have faces."""
        return 0 if self.faces is None else self.topology.part_count

    @property
    def face_pieces(self) -> IntArray:
        """Piece of each face, (m,), numbered by their lowest face.

        Faces are joined across edges of exactly two faces, so pieces may touch at vertices and at
        non-manifold edges.
        """
        return self.topology.face_pieces

    @property
    def bodies(self) -> IntArray:
        """Body of each point, (n,) int32, numbered by their lowest point; 0 for all of a cloud.

        A body is a closed component with its cavities, and what interpenetrates it; components that
        are not closed are one body together. Bodies that touch, nearly touch or overlap by less
        than 0.2 % of the diagonal are bodies of their own (see `medialis.shape.bodies`).
        """
        return self.body_contacts.label

    @cached_property
    def body_contacts(self) -> Bodies:
        """The bodies, where they touch, and which points do."""
        # By name: finding bodies takes creases and normals, which rest on surfaces.
        found: Bodies = import_module("medialis.shape.bodies").find_bodies(self)
        return found

    @cached_property
    def closed_components(self) -> NDArray[np.bool_]:
        """True for the components that have faces and no border, one row a component."""
        closed = np.zeros(int(self.components.max(initial=-1)) + 1, np.bool_)
        if self.faces is not None:
            table = self.edge_table
            closed[self.components[self.faces[:, 0]]] = True
            closed[self.components[table.ends[table.counts != 2, 0]]] = False
        return frozen(closed, np.bool_)


def _nearest_others(tree: Any, points: FloatArray) -> FloatArray:
    """Return how far the second nearest point of a tree is, the nearest being the point itself."""
    return np.asarray(tree.query(points, k=2)[0][:, 1])


def link_matrix(count: int, links: NDArray[Any]) -> Any:
    """Return a sparse (count, count) float64 array with 1 for each link (e, 2), both ways."""
    from scipy.sparse import csr_array

    a, b = links.T
    return csr_array((np.ones(2 * len(a)), (np.r_[a, b], np.r_[b, a])), shape=(count, count))


def linked_rows(count: int, links: NDArray[Any]) -> tuple[IntArray, IntArray, IntArray]:
    """Return where the neighbours of each node start, the neighbours, and how often each is one.

    As the parts of `link_matrix`, which loads scipy.

    Examples
    --------
    >>> [part.tolist() for part in linked_rows(3, np.array([[0, 2], [2, 1], [0, 2]]))]
    [[0, 1, 2, 4], [2, 2, 0, 1], [2, 1, 2, 1]]
    """
    from medialis.shape._kernels import link_rows

    first, pairs = np.zeros(count + 1, np.int32), np.ascontiguousarray(links, np.int32)
    neighbours, times = np.empty((2, 2 * len(pairs)), np.int32)
    filled = link_rows(pairs, first, neighbours, times)
    return first, neighbours[:filled], times[:filled]


@dataclass(frozen=True, eq=False)
class SolidBoundary:
    """A closed manifold, cut from a mesh.

    Attributes
    ----------
    points : (p, 3) float64
        The vertices of the mesh, a copy for each further fan of a vertex, and one in the middle of
        each hole.
    faces : (q, 3) int32
        Those of the mesh, and those that close holes.
    twins : (3q,) int64
        The same edge in the neighbouring face. Two edges may have the same ends.
    vertex : (p,) int64
        Vertex of the mesh that each point is a copy of; -1 for the middles of holes.
    component : (p,) int32
        Component of the mesh (`Surface.components`) that each point belongs to.
    seams : (c,) int64
        For each component of the mesh: edges with three or more faces, and vertices apart from
        these with several fans.
    unclear : (c,) int64
        Edges with faces left over, and edges beyond which a one-sided surface (a Moebius band) has
        its back: there the solid is a guess.
    """

    points: FloatArray
    faces: IntArray
    twins: Index
    vertex: Index
    component: IntArray
    seams: Index
    unclear: Index


def solid_boundary(surface: Surface) -> SolidBoundary:
    """Cut a mesh into the closed manifolds that bound its solid.

    Parameters
    ----------
    surface : Surface
        A mesh.
    """
    assert surface.faces is not None
    a, b, unclear = _joined_sides(surface)
    faces, vertex = _copied_vertices(surface, a, b)
    table, count = surface.edge_table, int(surface.components.max()) + 1
    many = table.counts > 2
    several = np.bincount(vertex) > 1
    several[np.concatenate([table.low[many], table.high[many]])] = False
    twins = np.full(faces.size, -1)
    twins[a], twins[b] = b, a
    points, component = surface.points[vertex], surface.components[vertex]
    seams = np.concatenate([np.flatnonzero(several), table.low[many]])
    points, faces, twins, component = _closed(points, faces, twins, component)
    return SolidBoundary(
        points,
        faces,
        twins,
        np.concatenate([vertex, np.full(len(points) - len(vertex), -1)]),
        component,
        np.bincount(surface.components[seams], minlength=count),
        np.bincount(surface.components[table.low[unclear]], minlength=count),
    )


def _joined_sides(surface: Surface) -> tuple[IntArray, IntArray, Index]:
    """Pairs of half-edges that the boundary joins, and the edges where others are left over."""
    table = surface.edge_table
    a, b, opposite = table.pairs
    unclear = np.flatnonzero(table.counts == 2)[~opposite].tolist()
    pairs, many = [], np.flatnonzero(table.counts > 2)
    fin = _fins(surface) if len(many) else np.zeros(0, bool)
    for edge in many.tolist():
        sides = table.order[table.first[edge] : table.first[edge + 1]]
        found = _paired(surface, sides, fin[sides // 3])
        pairs += found
        if 2 * len(found) < len(sides):
            unclear.append(edge)
    more = np.array(pairs, np.int32).reshape(-1, 2)
    a, b = np.concatenate([a[opposite], more[:, 0]]), np.concatenate([b[opposite], more[:, 1]])
    return a, b, np.array(unclear, np.int64)


def _fins(surface: Surface) -> NDArray[np.bool_]:
    """Faces of pieces that have a border."""
    return np.isin(surface.face_pieces, surface.face_pieces[surface.edge_table.single // 3])


def _paired(surface: Surface, sides: IntArray, fin: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Pair the half-edges of one edge: each face that enters the solid with one that leaves it.

    Of as many as enter and leave, each that enters takes the nearest that leaves, round the edge.
    Where their numbers differ, closed pieces go before fins, and flat pairs before sharp ones.
    """
    assert surface.faces is not None
    corner, forward = surface.faces.ravel(), surface.edge_table.forward[sides]
    ends = surface.points[corner[[sides[0], next_side(sides[:1])[0]]]]
    low, high = ends if forward[0] else ends[::-1]
    angle = _angles_round(low, high, surface.points[corner[next_side(next_side(sides))]])
    enters, leaves = np.flatnonzero(~forward), np.flatnonzero(forward)
    cost = (angle[leaves] - angle[enters][:, None]) % (2 * np.pi)
    if len(enters) != len(leaves):
        cost = np.abs(cost - np.pi) + 2 * np.pi * (fin[enters][:, None] | fin[leaves])
    pairs, used = [], np.zeros(cost.shape, bool)
    for place in np.argsort(cost, axis=None, kind="stable").tolist():
        i, j = divmod(place, len(leaves))
        if not used[i, j]:
            pairs.append((int(sides[enters[i]]), int(sides[leaves[j]])))
            used[i], used[:, j] = True, True
    return pairs


def _angles_round(low: FloatArray, high: FloatArray, tips: FloatArray) -> FloatArray:
    """Angle of each tip round the line from low to high, counted from the first, (k,)."""
    axis = (high - low) / max(float(np.linalg.norm(high - low)), 1e-300)
    away = tips - low
    away = away - np.outer(away @ axis, axis)
    x = away[0] / max(float(np.linalg.norm(away[0])), 1e-300)
    return np.asarray(np.arctan2(away @ np.cross(axis, x), away @ x))


def _copied_vertices(surface: Surface, a: IntArray, b: IntArray) -> tuple[IntArray, Index]:
    """Faces with a copy of a vertex for each further fan there, and the vertex of each point, (p,).

    A fan are corners of a vertex joined across pairs of half-edges; copies come after the vertices.
    """
    from medialis.shape._kernels import label_corner_fans

    assert surface.faces is not None
    corner, n = surface.faces.ravel(), surface.point_count
    fan = np.empty(len(corner), np.int32)
    ones = np.ones(len(a), bool)
    label_corner_fans(a, b, ones, np.arange(len(corner), dtype=np.int32), fan)
    vertex = np.empty(int(fan.max()) + 1, np.int64)
    vertex[fan] = corner
    further = np.ones(len(vertex), bool)
    further[np.unique(vertex, return_index=True)[1]] = False
    point = np.where(further, n + np.cumsum(further) - 1, vertex)
    faces = point[fan].reshape(-1, 3).astype(np.int32)
    return faces, np.concatenate([np.arange(n), vertex[further]])


def _closed(
    points: FloatArray, faces: IntArray, twins: Index, component: IntArray
) -> tuple[FloatArray, IntArray, Index, IntArray]:
    """Close each hole by a fan of triangles round the mean of its border.

    One half-edge of a border starts and one ends in each of its vertices: a vertex is one fan.
    """
    sides = np.flatnonzero(twins < 0)
    if len(sides) == 0:
        return points, faces, twins, component
    start, end = faces.ravel()[sides], faces.ravel()[next_side(sides)]
    label = piece_labels(len(points), np.stack([start, end], axis=1))[start]
    _, first, ring = np.unique(label, return_index=True, return_inverse=True)
    size = np.bincount(ring, minlength=len(first))
    middle = np.stack([np.bincount(ring, points[start, k]) / size for k in range(3)], axis=1)
    fan = np.stack([end, start, len(points) + ring], axis=1)
    new = len(twins) + 3 * np.arange(len(sides))
    twins = np.concatenate([twins, np.empty(3 * len(sides), np.int64)])
    twins[sides], twins[new] = new, sides
    # From the start of a side to the middle, and back in the triangle of the side that ends there.
    before = np.empty(len(points), np.int64)
    before[end] = new
    twins[new + 1], twins[before[start] + 2] = before[start] + 2, new + 1
    return (
        frozen(np.concatenate([points, middle]), np.float64),
        frozen(np.concatenate([faces, fan]), np.int32),
        twins,
        frozen(np.concatenate([component, component[start[first]]]), np.int32),
    )
