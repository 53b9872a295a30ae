"""Thin spots: where a shape is thinnest, one entry a place (thesis 3.5.1).

With a threshold, a place is a connected region below it: what fails a wall check. Without one, a
place is a prominent minimum: from it one must climb to 1.25 times its value before reaching
anywhere thinner. Its region is all that is connected to it below 1.25 times its value. Such
regions never overlap: if those of two minima m1 < m2 met, both would be connected below 1.25 m2,
and m2 would reach the lower m1 without climbing that high. One or two samples that are far too low
(a fold, a bad normal) make no place there: minima are those of the third lowest value round each
sample.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.errors import InvalidShapeError
from medialis.fields.thickness import MIN_SPOKE_ANGLE, wall_angles
from medialis.model.medial_cloud import MedialCloud
from medialis.model.shape import Shape
from medialis.surface.surface_graph import CLOUD_NEIGHBOURS
from medialis.validation import (
    FloatArray,
    IntArray,
    as_field,
    as_number,
    as_points,
    as_whole_number,
    frozen,
)

PROMINENCE = 0.25
"""Share of its value that one climbs from a minimum before it is a place of its own. Places at 0.1,
0.25, 0.5 and 1: hand 5, 5, 5, 4 (its five fingers), bunny 7, 6, 4, 3, scapula 23, 12, 11, 6."""


@dataclass(frozen=True, eq=False)
class ThinSpot:
    """A place where the shape is thin.

    Attributes
    ----------
    position : (3,) float64
        The thinnest sample.
    value : float
        The field there; without a threshold, the third lowest value round it where that is a
        prominence higher.
    vertex : int
        Index of the thinnest sample.
    vertices : (v,) int32
        All samples of the place, ascending.
    area : float
        Of the surface that they stand for (a third of each face at each corner); NaN in a cloud.
    """

    position: FloatArray
    value: float
    vertex: int
    vertices: IntArray
    area: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", as_points([self.position], "position")[0])
        object.__setattr__(self, "vertices", frozen(np.asarray(self.vertices), np.int32))


def thin_spots(
    shape: Shape,
    values: ArrayLike,
    *,
    threshold: float | None = None,
    count: int = 10,
    prominence: float = PROMINENCE,
    cloud: MedialCloud | None = None,
) -> tuple[ThinSpot, ...]:
    """List the thinnest places of a shape, thinnest first.

    Parameters
    ----------
    shape : Shape
        n samples.
    values : (n,) float
        Thickness of each (`medialis.thickness`), not negative; NaN and infinity belong to no place.
    threshold : float, optional
        Absolute. Every connected region below it is a place. When missing, every prominent minimum
        is one (see the top of this module).
    count : int
        At most this many places, 1 to 1,000,000.
    prominence : float
        Without a threshold: how far one must climb from a minimum, as a share of its value.
    cloud : MedialCloud, optional
        Its balls join the two sides of a wall into one place; without it they are two.

    Returns
    -------
    tuple of ThinSpot
        By rising value, ties by the lowest sample. Their vertices never overlap.

    Raises
    ------
    InvalidShapeError
        When there is not one value a sample, one is negative, or the cloud belongs to a larger
        shape.
    InvalidOptionError
        For a threshold that is not above 0, or another option out of range.

    Notes
    -----
    Cost: sorting n values and the edges; 0.2 s for 194,000 vertices. Source: thesis 3.5.1 (locally
    thin parts).

    Examples
    --------
    >>> import medialis
    >>> shape = medialis.organic_shape(56)
    >>> cloud = medialis.surface_skeleton(shape)
    >>> spots = medialis.thin_spots(shape, medialis.thickness(shape, cloud), cloud=cloud)
    >>> bool(spots[0].position[0] < -1.2)  # the end of the tail
    True
    """
    field = as_field(values, shape.point_count, "values")
    if (field < 0).any():
        raise InvalidShapeError(
            f"values must not be negative: {int((field < 0).sum())} of {len(field)} are."
        )
    if threshold is not None:
        threshold = as_number(threshold, "threshold", low=0.0, open_low=True)
    count = as_whole_number(count, "count", low=1, high=1_000_000)
    prominence = as_number(prominence, "prominence", low=0.0, high=100.0)
    field = np.where(np.isnan(field), np.inf, field)
    offsets, neighbours = _neighbours(shape, cloud)
    order = np.argsort(field, kind="stable").astype(np.int32)
    if threshold is not None:
        starts = order[field[order] < threshold]
        levels = np.full(len(starts), threshold)
        return _regions(shape, field, starts, field[starts], levels, offsets, neighbours, count)
    ratio = 1.0 + prominence
    calm, order = _without_specks(field, order, offsets, neighbours)
    starts = order[_prominent(calm, order, offsets, neighbours, ratio)[order]]
    # A sample so much lower than those round it that it could be a place of its own is a speck.
    depth = np.where(calm[starts] < ratio * field[starts], field[starts], calm[starts])
    turn = np.argsort(depth, kind="stable")
    starts, depth = starts[turn], depth[turn]
    return _regions(shape, calm, starts, depth, ratio * calm[starts], offsets, neighbours, count)


def _neighbours(
    shape: Shape, cloud: MedialCloud | None
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the graph on which places are connected: edges, and balls across a wall."""
    from scipy.sparse import coo_array

    n = shape.point_count
    links = [shape.edges if shape.faces is not None else _cloud_links(shape)]
    if cloud is not None:
        if int(cloud.features.max(initial=-1)) >= n:
            raise InvalidShapeError(
                f"The balls touch sample {cloud.features.max()}, but there are only {n} samples: "
                "give the shape that the cloud was computed on."
            )
        walls = (cloud.side > 0) & (wall_angles(shape, cloud) >= MIN_SPOKE_ANGLE)
        links.append(cloud.features[walls])
    a, b = np.concatenate(links).T
    ends = np.concatenate([a, b]), np.concatenate([b, a])
    graph = coo_array((np.ones(len(ends[0]), np.int8), ends), shape=(n, n)).tocsr()
    return graph.indptr, graph.indices


def _cloud_links(shape: Shape) -> IntArray:
    from scipy.spatial import cKDTree

    n, k = shape.point_count, min(CLOUD_NEIGHBOURS + 1, shape.point_count)
    near = cKDTree(shape.points).query(shape.points, k=k)[1].reshape(n, k)
    links = np.stack([np.repeat(np.arange(n), k), near.ravel()], axis=1)
    return frozen(links[links[:, 0] != links[:, 1]], np.int32)


def _without_specks(
    field: FloatArray, order: IntArray, offsets: NDArray[np.int32], neighbours: NDArray[np.int32]
) -> tuple[FloatArray, IntArray]:
    """Return the third lowest value round each sample, and its order (ties: the lower sample)."""
    from medialis.surface._surface_graph_kernels import third_lowest

    calm = np.empty_like(field)
    third_lowest(field, offsets, neighbours, calm)
    calm[np.isinf(field)] = np.inf
    return calm, order[np.argsort(calm[order], kind="stable")]


def _prominent(
    field: FloatArray,
    order: IntArray,
    offsets: NDArray[np.int32],
    neighbours: NDArray[np.int32],
    ratio: float,
) -> NDArray[np.bool_]:
    from medialis.surface._surface_graph_kernels import prominent_minima

    found = np.zeros(len(field), np.bool_)
    parent = np.full(len(field), -1, np.int32)
    prominent_minima(order, field, offsets, neighbours, ratio, parent, found)
    return found & np.isfinite(field)


def _regions(
    shape: Shape,
    field: FloatArray,
    starts: IntArray,
    depths: FloatArray,
    levels: FloatArray,
    offsets: NDArray[np.int32],
    neighbours: NDArray[np.int32],
    count: int,
) -> tuple[ThinSpot, ...]:
    """Collect what lies below its level round each start that is in no region yet."""
    from medialis.surface._surface_graph_kernels import flood_below

    label, queue = np.full(len(field), -1, np.int32), np.empty(len(field), np.int32)
    area = shape.point_areas if shape.faces is not None else np.full(len(field), np.nan)
    spots: list[ThinSpot] = []
    for start, depth, level in zip(starts.tolist(), depths.tolist(), levels.tolist(), strict=True):
        if len(spots) == count:
            break
        if label[start] >= 0:
            continue
        size = flood_below(start, level, field, offsets, neighbours, len(spots), label, queue)
        vertices = np.sort(queue[:size])
        place = shape.points[start]
        spots.append(ThinSpot(place, depth, start, vertices, float(area[vertices].sum())))
    return tuple(spots)
