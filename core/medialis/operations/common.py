"""What operations share: arrays, layers and summaries of balls and their surface."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.model.medial_cloud import COLUMNS, MedialCloud
from medialis.model.shape import Shape
from medialis.operations.result import FilterUnit, Layer

SURFACE = ("points", "normals", "faces", "origin", "face_origin", "vertex_map", "face_map")


def cloud_arrays(cloud: MedialCloud) -> dict[str, NDArray[Any]]:
    """All arrays of a medial cloud and its surface, masked rows included, for the NPZ file."""
    arrays = {name: getattr(cloud.surface, name) for name in SURFACE}
    arrays |= {name: getattr(cloud, name) for name in COLUMNS}
    return {name: values for name, values in arrays.items() if values is not None}


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
