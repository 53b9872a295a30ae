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

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from medialis.fields.thickness import WALL_ANGLE, ThicknessOptions, thickness, wall_angles
from medialis.kept import Described
from medialis.model.medial_cloud import MedialCloud
from medialis.model.ragged import Ragged
from medialis.model.shape import Shape
from medialis.options import algorithm, length, number, whole
from medialis.progress import Progress
from medialis.surface.surface_graph import CLOUD_NEIGHBOURS
from medialis.threads import run_patiently
from medialis.validation import FloatArray, IntArray, as_points, frozen

PROMINENCE = 0.25
"""Share of its value that one climbs from a minimum before it is a place of its own. Places at 0.1,
0.25, 0.5 and 1: hand 5, 5, 5, 4 (its five fingers), bunny 7, 6, 4, 3, scapula 23, 12, 11, 6."""


@dataclass(frozen=True, eq=False, repr=False)
class ThinSpot(Described):
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


@dataclass(frozen=True, kw_only=True)
class ThinSpotOptions(ThicknessOptions):
    """Options of `thin_spots`."""

    threshold: float = length(
        0.0,
        "Thin below",
        "Every connected region thinner than this fraction of the size is a thin spot. 0 finds the "
        "places that are thinner than all around them.",
    )
    spots: int = whole(
        10, "Thin spots", "List at most this many places, the thinnest first.", low=1, high=100_000
    )
    prominence: float = number(
        PROMINENCE,
        "Prominence",
        "Without a threshold: how far the thickness rises around a place before it counts as one "
        "of its own, as a share of its thickness.",
        high=100.0,
        advanced=True,
    )


@algorithm(ThinSpotOptions)
def thin_spots(
    cloud: MedialCloud, options: ThinSpotOptions, progress: Progress
) -> tuple[ThinSpot, ...]:
    """List the thinnest places of a shape, thinnest first.

    Parameters
    ----------
    cloud : MedialCloud
        Balls on n samples. Those between two walls join their sides into one place.

    Returns
    -------
    tuple of ThinSpot
        By rising value, ties by the lowest sample. Their vertices never overlap.

    Raises
    ------
    InvalidShapeError
        When no inner ball is valid.

    See Also
    --------
    thickness : the field that the places are those of.

    Notes
    -----
    Cost: sorting n values and the edges; 0.2 s for 194,000 vertices. Source: thesis 3.5.1 (locally
    thin parts).

    Examples
    --------
    >>> import medialis
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    >>> spots = medialis.thin_spots(cloud)
    >>> bool(spots[0].position[0] < -1.2)  # the end of the tail
    True
    """
    values = thickness.of(cloud, options, progress)

    def find() -> tuple[ThinSpot, ...]:
        walls = (cloud.side > 0) & (wall_angles(cloud) >= math.radians(WALL_ANGLE))
        return places_of_field(cloud.surface, values, cloud.features[walls], options)

    return run_patiently(find, progress)


def places_of_field(
    shape: Shape, field: FloatArray, walls: IntArray, options: ThinSpotOptions
) -> tuple[ThinSpot, ...]:
    """List the lowest places of a field (n,), 0 or more; `walls` (w, 2) joins their two sides."""
    graph = _neighbours(shape, walls)
    order = np.argsort(field, kind="stable").astype(np.int32)
    if options.threshold > 0:
        level = options.threshold * shape.diagonal
        starts = order[field[order] < level]
        levels = np.full(len(starts), level)
        return _regions(shape, field, (starts, field[starts], levels), graph, options.spots)
    ratio = 1.0 + options.prominence
    calm, order = _without_specks(field, order, graph)
    starts = order[_prominent(calm, order, graph, ratio)[order]]
    # A sample so much lower than those round it that it could be a place of its own is a speck.
    depth = np.where(calm[starts] < ratio * field[starts], field[starts], calm[starts])
    turn = np.argsort(depth, kind="stable")
    starts, depth = starts[turn], depth[turn]
    return _regions(shape, calm, (starts, depth, ratio * calm[starts]), graph, options.spots)


def _neighbours(shape: Shape, walls: IntArray) -> Ragged:
    """Return the graph on which places are connected: edges, and balls across a wall."""
    from scipy.sparse import coo_array

    n = shape.point_count
    edges = shape.edges if shape.faces is not None else _cloud_links(shape)
    a, b = np.concatenate([edges, walls]).T
    ends = np.concatenate([a, b]), np.concatenate([b, a])
    graph = coo_array((np.ones(len(ends[0]), np.int8), ends), shape=(n, n)).tocsr()
    return Ragged(graph.indptr, graph.indices)


def _cloud_links(shape: Shape) -> IntArray:
    n, k = shape.point_count, min(CLOUD_NEIGHBOURS + 1, shape.point_count)
    near = shape.tree.query(shape.points, k=k)[1].reshape(n, k)
    links = np.stack([np.repeat(np.arange(n), k), near.ravel()], axis=1)
    return frozen(links[links[:, 0] != links[:, 1]], np.int32)


def _without_specks(
    field: FloatArray, order: IntArray, graph: Ragged
) -> tuple[FloatArray, IntArray]:
    """Return the third lowest value round each sample, and its order (ties: the lower sample)."""
    from medialis.surface._surface_graph_kernels import third_lowest

    calm = np.empty_like(field)
    third_lowest(field, graph.offsets, graph.indices, calm)
    return calm, order[np.argsort(calm[order], kind="stable")]


def _prominent(
    field: FloatArray, order: IntArray, graph: Ragged, ratio: float
) -> NDArray[np.bool_]:
    from medialis.surface._surface_graph_kernels import prominent_minima

    found = np.zeros(len(field), np.bool_)
    parent = np.full(len(field), -1, np.int32)
    prominent_minima(order, field, graph.offsets, graph.indices, ratio, parent, found)
    return found


def _regions(
    shape: Shape,
    field: FloatArray,
    starts: tuple[IntArray, FloatArray, FloatArray],
    graph: Ragged,
    count: int,
) -> tuple[ThinSpot, ...]:
    """Collect what lies below its level round each start: samples, values, levels."""
    from medialis.surface._surface_graph_kernels import flood_below

    label, queue = np.full(len(field), -1, np.int32), np.empty(len(field), np.int32)
    area = shape.point_areas if shape.faces is not None else np.full(len(field), np.nan)
    places: list[ThinSpot] = []
    for start, depth, level in zip(*(column.tolist() for column in starts), strict=True):
        if len(places) == count:
            break
        if label[start] >= 0:
            continue
        number = len(places)
        size = flood_below(start, level, field, graph.offsets, graph.indices, number, label, queue)
        vertices = np.sort(queue[:size])
        total = float(area[vertices].sum())
        places.append(ThinSpot(shape.points[start], depth, start, vertices, total))
    return tuple(places)
