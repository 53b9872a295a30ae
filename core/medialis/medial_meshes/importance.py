"""Importance on the balls of a medial mesh, and meshes simplified by it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.base.errors import InvalidShapeError
from medialis.base.validation import FloatArray
from medialis.medial_meshes.mesh import MedialMesh
from medialis.skeleton.medial_cloud import MedialCloud


def values_on_balls(mesh: MedialMesh, cloud: MedialCloud, values: ArrayLike) -> FloatArray:
    """Carry values of a surface skeleton to the balls of a medial mesh.

    Parameters
    ----------
    mesh : MedialMesh
    cloud : MedialCloud
        Of the same shape.
    values : (k,) float
        Of its balls, as its importance; NaN and balls that are not valid do not count.

    Returns
    -------
    (n,) float64
        The value of the nearest ball of the cloud; NaN where it has none.

    Raises
    ------
    InvalidShapeError
        When there is not a value for each ball.

    See Also
    --------
    important_mesh : simplifies the mesh by them.

    Examples
    --------
    >>> import medialis
    >>> shape = medialis.organic_shape(56)
    >>> mesh, cloud = medialis.medial_mesh(shape, balls=12), medialis.surface_skeleton(shape)
    >>> medialis.values_on_balls(mesh, cloud, cloud.radii).shape
    (12,)
    """
    from scipy.spatial import cKDTree

    given = np.asarray(values, np.float64)
    if given.shape != (len(cloud),):
        raise InvalidShapeError(f"There are {len(cloud)} balls and values of shape {given.shape}.")
    known = np.flatnonzero(cloud.valid & ~np.isnan(given))
    if not len(known):
        return np.full(len(mesh), np.nan)
    return given[known[cKDTree(cloud.centers[known]).query(mesh.centers)[1]]]


def important_mesh(mesh: MedialMesh, importance: ArrayLike, threshold: float) -> MedialMesh:
    """Take balls of low importance from the rims of a medial mesh, without changing its topology.

    Triangles with a free side and edges with a free end go, one after the other, while one of
    their balls is less important than the threshold (elementary collapses). Less important balls
    stay where the topology needs them, and where more important ones lie all round.

    Parameters
    ----------
    mesh : MedialMesh
    importance : (n,) float
        Of its balls; NaN counts as important.
    threshold : float
        In the unit of the importance.

    Returns
    -------
    MedialMesh
        Of some of the balls, in their order, with the same Betti numbers and without levels.

    Raises
    ------
    InvalidShapeError
        When there is not a value for each ball.

    See Also
    --------
    values_on_balls : gives the importance of the balls.

    Examples
    --------
    >>> import medialis
    >>> chain = medialis.MedialMesh([[x, 0, 0] for x in range(4)], [1] * 4,
    ...                             [[0, 1], [1, 2], [2, 3]], [])
    >>> medialis.important_mesh(chain, [0.1, 2, 3, 0.2], 1.0).centers[:, 0].tolist()
    [1.0, 2.0]
    """
    value = np.asarray(importance, np.float64)
    if value.shape != (len(mesh),):
        raise InvalidShapeError(f"There are {len(mesh)} balls and values of shape {value.shape}.")
    low: NDArray[np.bool_] = np.less(value, threshold)  # NaN is not
    edges, faces = _triangles_taken(mesh, low)
    balls = _ends_taken(mesh, low, edges, faces)
    number = np.cumsum(balls) - 1
    return MedialMesh(
        mesh.centers[balls], mesh.radii[balls],
        number[mesh.edges[edges]], number[mesh.faces[faces]],
    )  # fmt: skip


def _sides(mesh: MedialMesh) -> NDArray[np.int64]:
    """Return the edge that each side of each triangle is, (f, 3)."""
    powers = np.array([len(mesh), 1], np.int64)
    keys = mesh.edges @ powers
    order = np.argsort(keys, kind="stable")
    wanted = mesh.faces[:, [[0, 1], [0, 2], [1, 2]]] @ powers
    found: NDArray[np.int64] = order[np.searchsorted(keys, wanted, sorter=order)]
    return found


def _triangles_taken(
    mesh: MedialMesh, low: NDArray[np.bool_]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Collapse triangles from free sides with an end of low importance.

    Returns
    -------
    edges, faces : masks of those that stay
    """
    sides = _sides(mesh)
    removable = np.logical_or(*low[mesh.edges].T).tolist()
    uses = np.bincount(sides.ravel(), minlength=len(mesh.edges))
    owners = np.zeros(len(mesh.edges), np.int64)  # of a free side the one triangle that is left
    np.bitwise_xor.at(owners, sides.ravel(), np.arange(3 * len(sides)) // 3)
    rows, left, around = sides.tolist(), uses.tolist(), owners.tolist()
    edges, faces = np.ones(len(mesh.edges), bool), np.ones(len(sides), bool)
    waiting = [side for side in range(len(left)) if left[side] == 1 and removable[side]]
    for side in waiting:  # grows meanwhile
        if left[side] != 1:
            continue
        triangle = around[side]
        edges[side] = faces[triangle] = False
        for other in rows[triangle]:
            left[other] -= 1
            around[other] ^= triangle
            if left[other] == 1 and removable[other]:
                waiting.append(other)
    return edges, faces


def _ends_taken(
    mesh: MedialMesh, low: NDArray[np.bool_], edges: NDArray[np.bool_], faces: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Take balls of low importance at the one edge that they have; tell those that stay.

    `edges` are those that stay so far; those that go are marked in it.
    """
    bound = np.zeros(len(edges), bool)  # sides of triangles
    bound[_sides(mesh)[faces]] = True
    ends = mesh.edges.tolist()
    at: list[set[int]] = [set() for _ in range(len(mesh))]
    for edge in np.flatnonzero(edges).tolist():
        for ball in ends[edge]:
            at[ball].add(edge)
    balls = np.ones(len(mesh), bool)
    waiting = [ball for ball in range(len(mesh)) if low[ball] and len(at[ball]) == 1]
    for ball in waiting:  # grows meanwhile
        if len(at[ball]) != 1:
            continue
        edge = next(iter(at[ball]))
        if bound[edge]:
            continue
        other = sum(ends[edge]) - ball
        at[ball].clear()
        at[other].discard(edge)
        balls[ball] = edges[edge] = False
        if low[other] and len(at[other]) == 1:
            waiting.append(other)
    return balls
