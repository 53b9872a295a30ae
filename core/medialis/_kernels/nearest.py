"""The nearest of many balls or triangles, exactly, by a box tree over them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from medialis._kernels.box_tree import BoxTree, build_box_tree, wide_levels
from medialis.errors import InvalidShapeError
from medialis.threads import run_chunks
from medialis.validation import FloatArray, IntArray, as_field, as_points

QUERIES_A_CHUNK = 512


@dataclass(frozen=True, eq=False)
class NearestTree:
    """A box tree over the centers of k balls, or of balls round k triangles.

    Attributes
    ----------
    tree : BoxTree
    radii : (k,) float64
        In tree order.
    largest : (nodes, 8) float64
        Largest radius below each child of a tree of balls; boxes of triangles hold them whole: 0.
    corners : (k, 3, 3) or (0, 3, 3) float64
        Corners of triangles in tree order, relative to the tree's center.
    """

    tree: BoxTree
    radii: FloatArray
    largest: FloatArray
    corners: FloatArray

    @classmethod
    def of_balls(cls, centers: ArrayLike, radii: ArrayLike) -> NearestTree:
        """Build the tree of balls.

        Raises
        ------
        InvalidShapeError
            For arrays of a wrong shape, no ball, or a radius that is negative or not finite.
        """
        middles = as_points(centers, "centers")
        sizes = as_field(radii, len(middles), "radii")
        if not np.isfinite(sizes).all() or (sizes < 0).any():
            raise InvalidShapeError("radii must be finite and not negative.")
        return cls._of(middles, sizes, np.empty((0, 3, 3)))

    @classmethod
    def of_triangles(cls, points: FloatArray, faces: IntArray) -> NearestTree:
        """Build the tree of the triangles of a mesh."""
        corners = points[faces]
        middles = corners.mean(axis=1)
        sizes = np.linalg.norm(corners - middles[:, None], axis=2).max(axis=1)
        return cls._of(middles, sizes, corners)

    @classmethod
    def _of(cls, middles: FloatArray, sizes: FloatArray, corners: FloatArray) -> NearestTree:
        from medialis._kernels.nearest_kernels import largest_radii

        tree = build_box_tree(middles, np.zeros_like(middles))
        ordered = sizes[tree.order]
        largest = np.zeros((len(tree.child), tree.bounds.shape[2]))
        for nodes, child_depth, fan in wide_levels(len(tree.child), tree.depth):
            count = nodes.stop - nodes.start
            if len(corners):
                _bound_corners(tree, corners, nodes, child_depth, fan)
                continue
            largest_radii(ordered, child_depth, fan, 0, count, largest[nodes])
        placed = corners[tree.order] - tree.center if len(corners) else corners
        return cls(tree, ordered, largest, placed)

    def distances(
        self,
        queries: FloatArray,
        *,
        enough: float = -np.inf,
    ) -> tuple[FloatArray, IntArray]:
        """Return the distance of points to the nearest item, and its row.

        Parameters
        ----------
        queries : (q, 3) float
        enough : float
            The search of a point ends at the first item that is nearer than this.

        Returns
        -------
        distance : (q,) float64
            To balls |x - c| - r, negative inside; to triangles >= 0.
        row : (q,) int32
            Ties go either way, but always the same way. (inf, any row) where nothing counts.

        Notes
        -----
        Cost: about O(log k) a point near the items; more far inside a hollow shape, where many
        items are equally far.
        """
        from medialis._kernels.nearest_kernels import nearest_item

        points, tree = as_points(queries, "queries"), self.tree
        # Bounds are float32 of coordinates relative to the middle: good to 1e-7 of their size,
        # twice.
        shifted = points - tree.center
        reach = float(np.abs(tree.points).max(initial=0.0) + np.abs(shifted).max())
        distance, row = np.empty(len(points)), np.empty(len(points), np.int64)

        def work(begin: int, end: int) -> None:
            nearest_item(
                begin, end, shifted, tree.points, self.radii, self.corners,
                tree.bounds, tree.child, self.largest, tree.depth, 4e-7 * reach, enough, distance,
                row,
            )  # fmt: skip

        run_chunks(work, len(points), QUERIES_A_CHUNK)
        return distance, tree.order[row]


def nearest_on_triangles(queries: FloatArray, corners: FloatArray) -> FloatArray:
    """Return the barycentric coordinates of the place of one triangle nearest to each point.

    Parameters
    ----------
    queries : (q, 3) float64
    corners : (q, 3, 3) float64

    Returns
    -------
    (q, 3) float64
        Not negative, sum 1; exactly 0 for the corners that an edge or a corner does not have.
    """
    from medialis._kernels.nearest_kernels import nearest_places

    places = np.empty((len(queries), 2))
    nearest_places(queries, corners, places)
    first = np.where(places.sum(axis=1) >= 1.0, 0.0, 1.0 - places.sum(axis=1))
    return np.column_stack([first, places])


def _bound_corners(
    tree: BoxTree, corners: FloatArray, nodes: slice, child_depth: int, fan: int
) -> None:
    """Let the boxes of some nodes hold whole triangles, in place of their middles.

    Far from a flat surface, boxes of middles that are widened by the size of triangles leave
    thousands of triangles that may be the nearest.
    """
    n, count = len(corners), nodes.stop - nodes.start
    first = (n * np.arange(count * fan)) >> child_depth
    placed = corners[tree.order] - tree.center
    for rows, ufunc, ends in (
        (slice(0, 3), np.minimum, placed.min(axis=1)),
        (slice(3, 6), np.maximum, placed.max(axis=1)),
    ):
        boxes = ufunc.reduceat(ends, first, axis=0).reshape(count, fan, 3)
        tree.bounds[nodes, rows, :fan] = boxes.transpose(0, 2, 1)
