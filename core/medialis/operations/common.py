"""What operations share: the refinement parameter and the checks before and after computing."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.errors import InvalidShapeError
from medialis.model.medial_cloud import MedialCloud
from medialis.model.shape import Shape
from medialis.operations.declaration import Kind, Parameter
from medialis.operations.result import Layer
from medialis.progress import Progress
from medialis.shape.noise import noise_level, smooth_noise
from medialis.shape.refinement import refine
from medialis.surface_skeletons import thin_walls
from medialis.surface_skeletons.ball_shrinking import (
    DEFAULT_TOLERANCE,
    LARGEST_RADIUS,
    SIDES,
    Side,
)

REFINE = Parameter(
    "refine",
    Kind.LENGTH,
    0.02,
    "Refine edges above",
    "Split edges longer than this fraction of the size for the computation, so that flat faces get "
    "samples; the surface stays the same. 0 computes with the given vertices only.",
    low=0.0,
    high=1.0,
)
SIDE = Parameter(
    "side",
    Kind.CHOICE,
    "inner",
    "Side",
    "Skeleton inside the shape, outside, or both.",
    choices=SIDES,
)
TOLERANCE = Parameter(
    "tolerance",
    Kind.LENGTH,
    DEFAULT_TOLERANCE,
    "Tolerance",
    "Relief of the surface lower than this fraction of the size does not shrink a ball; no sample "
    "lies deeper than this inside one. 0 gives the exact maximal balls, larger values suppress "
    "noise.",
    low=0.0,
    high=0.1,
)

DENOISE = Parameter(
    "denoise",
    Kind.CHOICE,
    "auto",
    "Noise",
    "auto: measure the noise of the surface and compute on a smoothed copy where it disturbs the "
    "normals; clean surfaces stay as they are, also with sharp edges. off: never.",
    choices=("auto", "off"),
)

NOISY = 0.04
"""Spacings: deviation of noise from which on a surface is smoothed. It tilts normals by 5 degrees.
Of 21 real meshes only one has more, a noisy scan with 0.043."""


def denoised(
    shape: Shape, choice: str, tolerance: float, progress: Progress
) -> tuple[Shape, float]:
    """Smooth a noisy mesh for the computation and say so; return the tolerance it then needs."""
    if choice == "off" or shape.faces is None or shape.diagonal == 0.0:
        return shape, tolerance
    level = noise_level(shape)
    if level == 0.0 or level < NOISY * shape.spacing:
        return shape, tolerance
    smooth, left = smooth_noise(shape, level)
    if not smooth.diagonal > 0:
        return shape, tolerance
    raised = min(max(tolerance, left / shape.diagonal), TOLERANCE.high)
    text = f", with a tolerance of {100 * raised:.3f} %" if raised > tolerance else ""
    progress.note(
        f"The surface is noisy: its vertices lie {100 * level / shape.diagonal:.2g} % of the "
        f"diagonal off a smooth surface ({level / shape.spacing:.2g} of the spacing). Computed on "
        f"a smoothed copy{text} (denoise = off turns this off)."
    )
    return smooth, raised


def refined(shape: Shape, fraction: float, progress: Progress) -> Shape:
    """Refine a coarse mesh for the computation and say so."""
    if fraction == 0.0 or shape.faces is None or shape.diagonal == 0.0:
        return shape
    with progress.stage("refine", 0.0, 0.1):
        fine = refine(shape, fraction * shape.diagonal)
    if fine is not shape:
        progress.note(
            f"Refined for the computation: {shape.point_count} vertices became "
            f"{fine.point_count} samples (edges above {100 * fraction:g} % of the diagonal were "
            "split, the surface is unchanged; refine = 0 turns this off)."
        )
    return fine


def maximal_balls(
    shape: Shape,
    tolerance: float,
    progress: Progress,
    *,
    side: Side = "inner",
    largest_radius: float = LARGEST_RADIUS,
) -> MedialCloud:
    """Shrink balls, also behind thin walls (see `thin_walls.maximal_balls`).

    Raises
    ------
    InvalidShapeError
        When no ball meets a second sample; the sentence says why.
    """
    cloud = thin_walls.maximal_balls(
        shape, tolerance=tolerance, side=side, largest_radius=largest_radius, progress=progress
    )
    _require_balls(cloud, shape)
    return cloud


def _require_balls(cloud: MedialCloud, shape: Shape) -> None:
    """Raise a sentence that says why there is no skeleton, when there is none."""
    if cloud.valid.any():
        return
    spread = np.linalg.svd(shape.points - shape.points.mean(axis=0), compute_uv=False)
    flat = spread[-1] <= 1e-9 * spread[0]
    why = "the shape is flat" if flat else "nothing faces them on this side"
    if not flat and shape.faces is None:
        why += " (if the normals of this cloud point inward, turn them or leave them out)"
    raise InvalidShapeError(
        f"No ball of the {shape.point_count} samples meets a second sample: {why}. A skeleton "
        "needs a surface that encloses a volume, at least partly."
    )


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
    name: str, cloud: MedialCloud, first: Mapping[str, NDArray[Any]] | None = None
) -> Layer:
    """Layer of a cloud without its masked rows; `source` tells the sample of each ball.

    It is coloured and filtered by the first of the `first` attributes, else by radius and angle.
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
