"""Feature transform and its inverse: fields from the skeleton to the surface and back (3.5.1).

Every valid ball touches two samples (the feature transform); a sample is touched by any number of
balls, at least by its own (the inverse, `MedialCloud.inverse_features`). So a value of each ball
becomes a field on the surface by reducing over the balls that touch a sample, and a field on the
surface becomes a value of each ball by reducing over its two feature points.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from medialis.model.medial_cloud import MedialCloud
from medialis.validation import FloatArray, IntArray, as_choice, as_field, frozen

Reduce = Literal["min", "max", "mean"]
REDUCTIONS = ("min", "max", "mean")


def feature_transform(cloud: MedialCloud) -> IntArray:
    """Return the two samples that each ball touches.

    Parameters
    ----------
    cloud : MedialCloud
        k balls.

    Returns
    -------
    (k, 2) int32
        Indices into the samples; both are -1 for a masked ball.

    See Also
    --------
    field_on_surface, field_on_skeleton : values either way.

    Notes
    -----
    The inverse is `MedialCloud.inverse_features`. Source: thesis 3.5.1.

    Examples
    --------
    >>> import medialis
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    >>> features = medialis.feature_transform(cloud)
    >>> touching = cloud.inverse_features
    >>> pairs = [(ball, sample) for ball in range(9) for sample in features[ball] if sample >= 0]
    >>> all(ball in touching[sample] for ball, sample in pairs)
    True
    """
    return frozen(np.where(cloud.valid[:, None], cloud.features, -1), np.int32)


def field_on_surface(
    cloud: MedialCloud, values: ArrayLike, *, reduce: Reduce = "max"
) -> FloatArray:
    """Carry a value of each ball to the samples that the balls touch.

    Parameters
    ----------
    cloud : MedialCloud
        k balls on n samples. Masked balls touch nothing.
    values : (k,) float
        One value a ball; NaN takes no part.
    reduce : {"max", "min", "mean"}
        What a sample gets that several balls touch. With the maximum, small balls of bumps near a
        sample do not hide the value of its wall.

    Returns
    -------
    (n,) float64
        NaN where no ball (with a value) touches.

    Raises
    ------
    InvalidShapeError
        When there is not one value a ball.
    InvalidOptionError
        For an unknown reduction.

    See Also
    --------
    field_on_skeleton : the other direction.
    thickness : the radii on the surface, without those of edges and bumps.

    Notes
    -----
    Cost O(k + n), 2 ms for 200,000 balls. Source: thesis 3.5.1, Figure 3.11.

    Examples
    --------
    >>> import medialis
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    >>> field = medialis.field_on_surface(cloud, cloud.radii)
    >>> bool((field[cloud.source] >= cloud.radii)[cloud.valid].all())
    True
    """
    from medialis.fields._feature_kernels import MAXIMUM, MINIMUM, SUM, gather_at_features

    reduce = as_choice(reduce, "reduce", REDUCTIONS)  # type: ignore[assignment]
    field, count = as_field(values, len(cloud), "values"), cloud.surface.point_count
    out, counts = np.full(count, np.nan), np.zeros(count, np.int32)
    how = {"min": MINIMUM, "max": MAXIMUM, "mean": SUM}[reduce]
    gather_at_features(feature_transform(cloud), field, how, out, counts)
    if reduce == "mean":
        out /= np.maximum(counts, 1)
    return out


def field_on_skeleton(
    cloud: MedialCloud, field: ArrayLike, *, reduce: Reduce = "mean"
) -> FloatArray:
    """Carry a field on the surface to the balls, from the two places that each touches.

    Parameters
    ----------
    cloud : MedialCloud
        k balls on n samples.
    field : (n,) float
        One value a sample of ``cloud.surface``; NaN takes no part.
    reduce : {"mean", "min", "max"}

    Returns
    -------
    (k,) float64
        NaN for masked balls and where neither contact has a value. Between the corners of a face
        the field is interpolated.

    Raises
    ------
    InvalidShapeError
        When there is not one number a sample.
    InvalidOptionError
        For an unknown reduction.

    See Also
    --------
    field_on_surface : the other direction.

    Notes
    -----
    Cost O(k). Source: thesis 3.5.1.

    Examples
    --------
    >>> import medialis
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    >>> height = medialis.field_on_skeleton(cloud, cloud.surface.points[:, 2])
    >>> above = abs(height - cloud.centers[:, 2])[cloud.valid]
    >>> bool((above <= cloud.radii[cloud.valid] + 1e-3 * cloud.surface.diagonal).all())
    True
    """
    reduce = as_choice(reduce, "reduce", REDUCTIONS)  # type: ignore[assignment]
    values = as_field(field, cloud.surface.point_count, "field")
    both = np.full((2, len(cloud)), np.nan)
    both[:, cloud.valid] = values[cloud.features[cloud.valid].T]
    between = cloud.valid & (cloud.contact_faces >= 0)
    if cloud.surface.faces is not None and between.any():
        corners = values[cloud.surface.faces[cloud.contact_faces[between]]]
        both[1, between] = np.einsum("ij,ij->i", cloud.contact_weights[between], corners)
    if reduce == "min":
        return np.fmin(*both)
    if reduce == "max":
        return np.fmax(*both)
    first, second = np.where(np.isnan(both), both[::-1], both)  # one NaN: the other one alone
    return 0.5 * first + 0.5 * second  # halves: the sum of two large values would overflow
