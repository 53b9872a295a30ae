"""What operations share: the refinement parameter and the checks before and after computing."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.model.medial_cloud import MedialCloud
from medialis.model.shape import Shape
from medialis.operations.result import FilterUnit, Layer


def cloud_arrays(shape: Shape, cloud: MedialCloud) -> dict[str, NDArray[Any]]:
    """Full arrays of a shape and its medial cloud, masked rows included, for the NPZ file."""
    arrays: dict[str, NDArray[Any]] = {"points": shape.points, "normals": shape.normals}
    for name in ("faces", "origin", "face_origin", "vertex_map", "face_map"):
        if getattr(shape, name) is not None:
            arrays[name] = getattr(shape, name)
    for name in ("centers", "radii", "features", "source", "status", "spoke_angles", "side"):
        arrays[name] = getattr(cloud, name)
    return arrays


def cloud_layer(
    name: str,
    cloud: MedialCloud,
    first: Mapping[str, NDArray[Any]] | None = None,
    *,
    unit: FilterUnit | None = None,
    hidden_below: float = 0.0,
) -> Layer:
    """Layer of a cloud without its masked rows; `source` tells the sample of each ball.

    It is coloured and filtered by the first of the `first` attributes, in this unit, else by radius
    and spoke angle.
    """
    first = first or {}
    return Layer(
        name,
        cloud.centers,
        attributes={
            **first,
            "radius": cloud.radii,
            "spoke_angle": cloud.spoke_angles,
            "feature_1": cloud.features[:, 0],
            "feature_2": cloud.features[:, 1],
            "source": cloud.source,
            "side": cloud.side,
        },
        color_by=next(iter(first), "radius"),
        filter_by=next(iter(first), "spoke_angle"),
        filter_unit=unit or (FilterUnit() if first else FilterUnit.degrees()),
        filter_default=hidden_below,
    )


def samples_layer(shape: Shape) -> Layer:
    """Layer of the surface as computed on: feature points and sources index its points."""
    return Layer(
        "samples",
        shape.points,
        shape.faces,
        attributes={"normal": shape.normals},
        auxiliary=True,
    )


def summary(values: NDArray[np.float64], name: str) -> dict[str, float | None]:
    """Smallest, median and largest of the finite values, as result values; None without any."""
    finite = values[np.isfinite(values)]
    return {
        f"{name}_{word}": float(measure(finite)) if len(finite) else None
        for word, measure in (("min", np.min), ("median", np.median), ("max", np.max))
    }
