"""What the operations on sheets and segments share: parameters, layers, notes."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.balls.surface_skeleton import Preparation, surface_skeleton
from medialis.model.medial_cloud import MedialCloud
from medialis.model.segmentation import Segmentation
from medialis.model.shape import Shape
from medialis.operations.result import Layer, Outcome
from medialis.options import Options, changed
from medialis.progress import Progress
from medialis.validation import IntArray


@dataclass(frozen=True, kw_only=True)
class SheetPreparation(Preparation):
    """Preparation of what needs several samples across every face."""

    tolerance: float = changed(Preparation, "tolerance", advanced=True)
    refine: float = changed(
        Preparation,
        "refine",
        default=0.01,
        help="Split edges longer than this fraction of the size for the computation, so "
        "that flat faces get samples; the surface stays the same. 0 computes with the"
        " given vertices only. Sheets and edges need several samples across every "
        "face.",
    )


def computed(shape: Shape, options: Options, progress: Progress) -> tuple[Shape, MedialCloud]:
    """Refine and shrink balls, the first part of all these operations."""
    with progress.stage("skeleton", 0.0, 0.4):
        cloud = surface_skeleton.of(shape, options, progress)
    return cloud.surface, cloud


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
