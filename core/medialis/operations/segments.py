"""What the operations on sheets and segments share: parameters, layers, notes."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.features.sheets import DEFAULT_TAU
from medialis.model.medial_cloud import MedialCloud
from medialis.model.segmentation import Segmentation
from medialis.model.shape import Shape
from medialis.operations.common import REFINE, TOLERANCE, maximal_balls, refined
from medialis.operations.declaration import Kind, Parameter
from medialis.operations.result import Layer, Outcome
from medialis.progress import Progress
from medialis.surface_skeletons.ball_shrinking import Side
from medialis.validation import IntArray

TAU = Parameter(
    "tau",
    Kind.FLOAT,
    DEFAULT_TAU,
    "Sheet threshold",
    "Two neighbouring points are on one sheet when their feature points are closer together than "
    "this many sample spacings. Larger values join more.",
    low=1.5,
    high=100.0,
    advanced=True,
)
FINE = replace(
    REFINE,
    default=0.01,
    help=f"{REFINE.help} Sheets and edges need several samples across every face.",
)
SEGMENT_TOLERANCE = replace(TOLERANCE, advanced=True)


def smallest_segment(default: float, what: str) -> Parameter:
    """Return the parameter for the smallest segment, as a share of the surface."""
    return Parameter(
        "smallest",
        Kind.FLOAT,
        default,
        f"Smallest {what}",
        f"A {what} that covers less than this share of the surface is merged into the neighbour "
        "with the longest common border. 0 keeps all.",
        low=0.0,
        high=1.0,
    )


def computed(
    shape: Shape, parameters: Mapping[str, Any], progress: Progress, *, side: Side
) -> tuple[Shape, MedialCloud]:
    """Refine and shrink balls, the first part of all these operations."""
    fine = refined(shape, parameters["refine"], progress)
    with progress.stage("skeleton", 0.1, 0.4):
        cloud = maximal_balls(fine, parameters["tolerance"], progress, side=side)
    return fine, cloud


def input_face_labels(shape: Shape, fine: Shape, segmentation: Segmentation) -> IntArray:
    """Return the segment of each face of the shape that was given, (m,).

    A face that was split has the segment that covers most of it (ties: the lowest).
    """
    labels = segmentation.of_faces(fine)
    if fine is shape or fine.face_origin is None or fine.faces is None:
        return labels
    a, b, c = fine.points[fine.faces.T]
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    width = segmentation.count + 1
    keys = np.asarray(fine.face_origin, np.int64) * width + labels + 1
    used, place = np.unique(keys, return_inverse=True)
    total = np.bincount(place.reshape(-1), area)
    order = np.lexsort((-used, total))  # the last one of each face stays
    result = np.full(shape.face_count, -1, np.int32)
    result[used[order] // width] = used[order] % width - 1
    return result


def surface_layers(
    name: str,
    shape: Shape,
    fine: Shape,
    attributes: Mapping[str, NDArray[Any]],
    segmentation: Segmentation | None = None,
    **options: Any,
) -> tuple[Layer, ...]:
    """Layers of fields on the surface: on the input, and on the samples if there are more."""
    layers = []
    for target, label in ((shape, name), (fine, "samples")):
        faces: dict[str, NDArray[Any]] = {}
        if segmentation is not None and target.faces is not None:
            own = target is fine and fine is not shape
            # Hosts keep vertex and face attributes in one list, where names are unique.
            faces[f"face_{name}"] = (
                segmentation.of_faces(fine) if own else input_face_labels(shape, fine, segmentation)
            )
        layers.append(
            Layer(
                label,
                target.points,
                target.faces,
                attributes={k: v[: target.point_count] for k, v in attributes.items()},
                face_attributes=faces,
                on_input=target is shape,
                auxiliary=label == "samples",
                **options,
            )
        )
        if fine is shape:
            break
    return tuple(layers)


def note_unseen(layer: Layer, count: int, progress: Progress) -> None:
    """Say how many of `count` segments a layer on a coarse input shows nowhere."""
    fields = (*layer.attributes.values(), *layer.face_attributes.values())
    labels = np.unique(np.concatenate(fields))
    unseen = count - int((labels >= 0).sum())
    if unseen:
        progress.note(
            f"{unseen} of {count} segments hold no vertex of the input and no whole face, since it "
            "is coarse: the layer samples shows them."
        )


def segmentation_outcome(
    name: str,
    shape: Shape,
    fine: Shape,
    segmentation: Segmentation,
    progress: Progress,
    arrays: Mapping[str, NDArray[Any]],
    values: Mapping[str, Any],
) -> Outcome:
    """Return the outcome of an operation whose result is a segmentation."""
    missing = int((segmentation.labels < 0).sum())
    if missing:
        progress.note(
            f"{missing} of {fine.point_count} samples have no label (-1): they lie in components "
            "of the surface without any inner ball (open or flat pieces).",
            level=logging.WARNING,
        )
    layers = surface_layers(
        name,
        shape,
        fine,
        {name: segmentation.labels},
        segmentation,
        color_by=name,
        labels=(name,),
    )
    note_unseen(layers[0], segmentation.count, progress)
    return Outcome(
        shape=fine,
        layers=layers,
        values={
            name: segmentation.count,
            "areas": segmentation.areas.tolist(),
            "unlabelled": missing,
            "samples": fine.point_count,
            **values,
            "diagonal": fine.diagonal,
            "spacing": fine.spacing,
        },
        arrays={
            **arrays,
            name: segmentation.labels,
            f"face_{name}": segmentation.of_faces(fine),
        },
        shown=layers[-1:],
    )
