"""What the operations on sheets and segments share: options, layers, notes."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.balls.ball_shrinking import Side
from medialis.balls.surface_skeleton import (
    Preparation,
    SurfaceSkeletonOptions,
    surface_skeleton,
)
from medialis.model.medial_cloud import MedialCloud
from medialis.model.segmentation import Segmentation
from medialis.model.shape import Shape
from medialis.operations.common import cloud_arrays
from medialis.operations.result import Layer, Outcome
from medialis.options import Options, changed, choice
from medialis.progress import Progress

SIDE_OF_EDGES: dict[str, Side] = {"convex": "inner", "concave": "outer", "both": "both"}


@dataclass(frozen=True, kw_only=True)
class SheetPreparation(Preparation):
    """Preparation of what needs several samples across every face."""

    tolerance: float = changed(Preparation, "tolerance", advanced=True)
    refine: float = changed(
        Preparation,
        "refine",
        default=0.01,
        help="Split edges longer than this share of the size for the computation, so "
        "that flat faces get samples; flat faces stay the same. 0 computes with the"
        " given vertices only. Sheets and edges need several samples across every "
        "face.",
    )


@dataclass(frozen=True, kw_only=True)
class EdgePreparation(SheetPreparation):
    """Preparation of what finds edges: balls inside of convex, outside of concave ones."""

    edges: str = choice(
        "both",
        "Edges",
        "Convex edges, concave ones, or both (takes twice as long as one).",
        tuple(SIDE_OF_EDGES),
    )

    @property
    def on_side(self) -> SurfaceSkeletonOptions:
        """Options of the balls that lie behind these edges."""
        return SurfaceSkeletonOptions.taken_from(self, side=SIDE_OF_EDGES[self.edges])


def computed(shape: Shape, options: Options, progress: Progress) -> MedialCloud:
    """Refine and shrink balls, the first part of all these operations."""
    with progress.stage("skeleton", 0.0, 0.4):
        return surface_skeleton.of(shape, options, progress)


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
    for target in (shape,) if fine is shape else (shape, fine):
        on_input = target is shape
        faces: dict[str, NDArray[Any]] = {}
        if segmentation is not None and target.faces is not None:
            # Hosts keep vertex and face attributes in one list, where names are unique.
            faces[f"face_{name}"] = (
                _input_face_labels(shape, segmentation) if on_input else segmentation.of_faces()
            )
        layers.append(
            Layer(
                name if on_input else "samples",
                target.points,
                target.faces,
                attributes={k: v[: target.point_count] for k, v in attributes.items()},
                face_attributes=faces,
                on_input=on_input,
                auxiliary=not on_input,
                **options,
            )
        )
    return tuple(layers)


def _input_face_labels(shape: Shape, segmentation: Segmentation) -> NDArray[np.int32]:
    """Return the segment of each face of the shape that was given, (m,)."""
    if segmentation.surface.face_count == shape.face_count:
        return segmentation.of_faces()
    if shape.face_origin is None:
        return segmentation.of_input_faces()
    # Refined by the caller and again: the origin of its faces is that of the first refinement.
    return Segmentation(segmentation.labels[: shape.point_count], surface=shape).of_faces()


def note_unseen(layer: Layer, count: int, progress: Progress) -> None:
    """Say how many of `count` segments a layer on a coarse input shows nowhere."""
    fields = (*layer.attributes.values(), *layer.face_attributes.values())
    labels = np.unique(np.concatenate(fields))
    unseen = count - int((labels >= 0).sum())
    if unseen:
        progress.note(
            f"{unseen} of {count} segments hold no vertex of the input and no whole face, since it "
            "is coarse: the layer samples shows them.",
            "segments_unseen",
            unseen=unseen,
            segments=count,
        )


def border_layer(segmentation: Segmentation) -> tuple[Layer, ...]:
    """Layer of the curves between segments; none where there are none."""
    points, edges = segmentation.borders
    return (Layer("borders", points, edges=edges, auxiliary=True),) if len(edges) else ()


def segmentation_outcome(
    name: str,
    shape: Shape,
    cloud: MedialCloud,
    segmentation: Segmentation,
    progress: Progress,
    **values: Any,
) -> Outcome:
    """Return the outcome of an operation whose result is a segmentation."""
    fine, labels = segmentation.surface, segmentation.labels
    missing = int((labels < 0).sum())
    if missing:
        progress.note(
            f"{missing} of {fine.point_count} samples have no label (-1): they lie in components "
            "of the surface without any inner ball (open or flat pieces).",
            "samples_unlabelled",
            level=logging.WARNING,
            unlabelled=missing,
            samples=fine.point_count,
        )
    layers = surface_layers(
        name, shape, fine, {name: labels}, segmentation, color_by=name, labels=(name,)
    )
    note_unseen(layers[0], segmentation.count, progress)
    return Outcome(
        shape=fine,
        layers=(*layers, *border_layer(segmentation)),
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
            **cloud_arrays(cloud),
            name: labels,
            f"face_{name}": segmentation.of_faces(),
        },
        shown=layers[-1:],
    )
