"""Weights of pieces that no bone runs through: they follow the skin that they hang on.

Eyes, teeth, hair, buttons, clothes and weapons are often pieces of their own. A piece that is small
or sticks out moves as a whole, with the skin at its contact; clothes follow the skin vertex by
vertex (`hung_weights`). `carried_weights` brings the weights of a united surface to its pieces.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from medialis.base.arrays import Index, Mask, kd_tree, rows_of_labels
from medialis.base.validation import FloatArray, IntArray
from medialis.rigging.bones import SkinWeights
from medialis.shape.shape import Shape
from medialis.shape.union import United

SMALL = 0.05
"""Maximum size of a piece that moves as a whole, as a fraction of the diagonal of the shape."""

STICKS_OUT = 0.2
"""Minimum distance of a piece from the skin (90 % quantile) as a fraction of its own size from
which on it moves as a whole: clothes have up to 0.1, a bun or a weapon 0.3 to 1."""

CONTACT = 0.1
"""Extent of the contact of a piece with the skin, as a fraction of the size of the piece."""


def carried_weights(skin: SkinWeights, union: United, shape: Shape) -> SkinWeights:
    """Return the weights of the given points of a shape from those of its united surface.

    Parameters
    ----------
    skin : SkinWeights
        Weights of the m points of ``union.shape``, or of more, of which these are the first ones.
    union : United
        Of a shape with n points.
    shape : Shape

    Returns
    -------
    SkinWeights
        Of n points. Points of united pieces have the weights of the nearest point of the united
        surface; loose pieces follow those (`hung_weights`).
    """
    rows = union.nearest
    near = replace(skin, bones=skin.bones[rows], weights=skin.weights[rows])
    loose = union.loose[union.piece]
    return hung_weights(near, shape, loose) if loose.any() else near


def hung_weights(skin: SkinWeights, shape: Shape, hanging: Mask) -> SkinWeights:
    """Return weights with which hanging pieces follow the skin of the other pieces.

    Parameters
    ----------
    skin : SkinWeights
        Of the n points; those of hanging pieces are replaced.
    shape : Shape
        Of n points, with faces.
    hanging : (n,) bool
        Points of the hanging pieces, which are whole components; not all points.

    Examples
    --------
    >>> import medialis
    >>> tetrahedron = np.array([[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]])
    >>> corners = np.array([[0.0, 0, 0], [0, 1, 0], [1, 0, 0], [0, 0, 1]])
    >>> points = np.concatenate([corners, corners / 50 + [0, 0, 1.1]])
    >>> shape = medialis.make_shape(points, np.concatenate([tetrahedron, tetrahedron + 4]))
    >>> skin = SkinWeights([[0], [0], [0], [1], [-1], [-1], [-1], [-1]], np.ones((8, 1)))
    >>> hung_weights(skin, shape, np.arange(8) >= 4).bones.ravel().tolist()
    [0, 0, 0, 1, 1, 1, 1, 1]
    """
    bones, weights = np.array(skin.bones), np.array(skin.weights)
    donors, rows = np.flatnonzero(~hanging), np.flatnonzero(hanging)
    away, near = kd_tree(shape.points[donors]).query(shape.points[rows])
    near = donors[near]
    bones[rows], weights[rows] = skin.bones[near], skin.weights[near]
    for own in rows_of_labels(shape.components[rows]):
        size = float(np.linalg.norm(np.ptp(shape.points[rows[own]], axis=0)))
        far = float(np.quantile(away[own], 0.9))
        if size > SMALL * shape.diagonal and far <= STICKS_OUT * size:
            continue
        touching = near[own[away[own] <= away[own].min() + CONTACT * size]]
        bones[rows[own]], weights[rows[own]] = _mean(skin, touching)
    return replace(skin, bones=bones, weights=weights)


def _mean(skin: SkinWeights, rows: Index) -> tuple[IntArray, FloatArray]:
    """Return the bones and weights (k,) that are the mean of some points; the heaviest ones."""
    count, width = int(skin.bones.max()) + 1, skin.bones.shape[1]
    used = skin.bones[rows] >= 0
    sums = np.bincount(skin.bones[rows][used], skin.weights[rows][used], count)
    best = np.argsort(-sums, kind="stable")[:width]
    bones, weights = np.full(width, -1, np.int32), np.zeros(width)
    best = best[sums[best] > 0]
    bones[: len(best)], weights[: len(best)] = best, sums[best] / sums[best].sum()
    return bones, weights
