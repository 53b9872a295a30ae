"""Operation: image-based reconstruction of a shape from its balls (thesis 3.4)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from medialis.base.options import choice, flag, whole
from medialis.base.progress import Progress
from medialis.operations.declaration import Operation
from medialis.operations.result import Outcome
from medialis.shape.shape import Shape
from medialis.skeleton.layers import cloud_arrays, cloud_layer
from medialis.skeleton.surface_skeleton import Preparation, surface_skeleton

if TYPE_CHECKING:
    from medialis.show.reconstruction import Comparison


@dataclass(frozen=True, kw_only=True)
class BallReconstructionRun(Preparation):
    """Options of the operation `ball_reconstruction`."""

    size: int = whole(
        700,
        "Image size",
        "Pixels along each side.",
        low=64,
        high=4096,
    )
    progressive: bool = flag(
        False,
        "Progressive",
        "Also draw growing shares of the balls, the most important ones first.",
    )
    order: str = choice(
        "radius",
        "Order",
        "What makes a ball important in progressive mode.",
        {
            "radius": "Large balls come first.",
            "spoke_angle": "Balls whose spokes enclose a large angle come first.",
        },
    )


def run(shape: Shape, options: BallReconstructionRun, progress: Progress) -> Outcome:
    """Render the union of the balls beside the surface and compare them pixel by pixel."""
    from medialis.show.annotation import contact_sheet
    from medialis.show.camera import Camera, shape_view
    from medialis.show.reconstruction import progressive, reconstruct_image

    with progress.stage("skeleton", 0.0, 0.3):
        cloud = surface_skeleton.of(shape, options, progress)
    fine = cloud.surface
    size = options.size
    direction, up = shape_view(fine)
    camera = Camera.framing(fine.points, direction=direction, up=up, width=size, height=size)
    with progress.stage("reconstruct", 0.3, 0.6 if options.progressive else 1.0):
        found = reconstruct_image(cloud, camera, progress=progress)
    if math.isnan(found.median_difference):
        progress.warn(
            "No pixel shows both the balls and the surface: the shape is thinner than a pixel of a "
            f"picture of {size} pixels. Raise size.",
            "thinner_than_a_pixel",
            size=size,
        )
    images = {
        "reconstruction": contact_sheet(
            [found.surface_images[0], found.ball_images[0], found.difference_images[0]],
            [
                "surface",
                f"union of {found.ball_count} balls",
                f"difference: {_caption(found)}",
            ],
            columns=3,
        )
    }
    values: dict[str, Any] = {
        "balls": found.ball_count,
        "pixels_that_differ_percent": 100 * found.only_one_share,
        "median_depth_difference_percent": found.median_difference,
        "depth_difference_95_percent": found.difference_95,
    }
    if options.progressive:
        order = cloud.radii if options.order == "radius" else cloud.spoke_angles
        with progress.stage("progressive", 0.6, 1.0):
            steps = progressive(cloud, order, camera=camera, progress=progress)
        images["progressive"] = contact_sheet(
            [step.ball_images[0] for step in steps],
            [f"{step.ball_count} balls: {_caption(step)}" for step in steps],
            columns=3,
        )
        values["progressive"] = [
            [step.ball_count, 100 * step.only_one_share, step.median_difference] for step in steps
        ]
    return Outcome(
        shape=fine,
        layers=(replace(cloud_layer("balls", cloud.subset(cloud.valid)), role="balls"),),
        values=values,
        arrays=cloud_arrays(cloud),
        images=images,
    )


def _caption(found: Comparison) -> str:
    if math.isnan(found.median_difference):
        return "no pixel shows both"
    return (
        f"{100 * found.only_one_share:.2f} % of the pixels, median depth "
        f"{found.median_difference:.3f} % of the size"
    )


OPERATION = Operation(
    name="ball_reconstruction",
    filter_name="get_medial_reconstruction_image",
    label="Reconstruct from balls (image)",
    group="Inspect",
    help="Draw the union of the medial balls beside the surface, and measure how they differ.\n\n"
    "Both are rendered with the same camera; the difference image and the numbers (share of pixels "
    "that differ, depth error in per cent of the size) tell how well the skeleton describes the "
    "shape. In progressive mode the balls are added in falling order of radius or spoke angle.",
    source="thesis 3.4",
    examples=(("creature.ply --progressive", "how few balls are enough"),),
    layers={
        "balls": "the medial balls that were drawn",
    },
    options=BallReconstructionRun,
    run=run,
    makes_images=True,
    order=30,
    words=("spheres", "medial balls"),
)
