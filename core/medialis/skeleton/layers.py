"""What operations on balls, sheets and segments share: arrays, layers, notes, summary."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import Index
from medialis.base.errors import InvalidOptionError
from medialis.base.options import Options
from medialis.base.progress import Progress
from medialis.base.validation import FloatArray, IntArray
from medialis.formats.files import number_lines
from medialis.operations.positions import numbers, places
from medialis.operations.result import FilterUnit, Layer, Outcome
from medialis.shape.labels import Segmentation
from medialis.shape.shape import Shape
from medialis.skeleton.medial_cloud import COLUMNS, MedialCloud
from medialis.skeleton.surface_skeleton import balls_of

SURFACE = ("points", "normals", "faces", "origin", "face_origin", "vertex_map", "face_map")


def cloud_arrays(cloud: MedialCloud) -> dict[str, NDArray[Any]]:
    """All arrays of a medial cloud and its surface, masked rows included, for the NPZ file."""
    arrays = {name: getattr(cloud.surface, name) for name in SURFACE}
    arrays |= {name: getattr(cloud, name) for name in COLUMNS}
    marked = {"points": places, "centers": places, "normals": numbers, "contact_weights": numbers}
    return {
        name: marked.get(name, np.asarray)(values)
        for name, values in arrays.items()
        if values is not None
    }


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
    one, other = cloud.features.T
    known = {**first, "radius": cloud.radii, "spoke_angle": cloud.spoke_angles}
    known |= {"feature_1": one, "feature_2": other, "source": cloud.source, "side": cloud.side}
    return Layer(
        name,
        cloud.centers,
        attributes=known,
        color_by=next(iter(first), "radius"),
        filter_by=next(iter(first), "spoke_angle"),
        filter_unit=unit or (FilterUnit() if first else FilterUnit.degrees()),
        filter_default=hidden_below,
    )


def samples_layer(shape: Shape) -> Layer:
    """Layer of the surface as computed on: feature points and sources index its points."""
    normals = {"normal": numbers(shape.normals)}
    return Layer("samples", shape.points, shape.faces, attributes=normals, auxiliary=True)


def summary(
    values: FloatArray, name: str, weights: FloatArray | None = None
) -> dict[str, float | None]:
    """Minimum, median and maximum of the finite values, as result values; None without any.

    With `weights`, such as the areas of samples, the median is that of the weights: it does not
    change where a part of a surface is sampled more densely.
    """
    finite = np.isfinite(values)
    if not finite.any():
        return {f"{name}_{word}": None for word in ("min", "median", "max")}
    found = values[finite]
    median = np.median(found) if weights is None else weighted_median(found, weights[finite])
    return {
        f"{name}_min": float(found.min()),
        f"{name}_median": float(median),
        f"{name}_max": float(found.max()),
    }


def weighted_median(values: FloatArray, weights: FloatArray) -> float:
    """Return the value that half of the weight is below; the plain median where all weigh 0."""
    order = np.argsort(values, kind="stable")
    below = np.cumsum(weights[order])
    if not below[-1] > 0.0:
        return float(np.median(values))
    return float(values[order[np.searchsorted(below, 0.5 * below[-1])]])


def computed(shape: Shape, options: Options, progress: Progress, share: float = 0.4) -> MedialCloud:
    """Refine and shrink balls, the first part of all these operations."""
    with progress.stage("skeleton", 0.0, share):
        return balls_of(shape, options, progress)


def vertices_of_input(shape: Shape, numbers: Index, use: str) -> Index:
    """Return the numbers in the repaired shape of vertices of the input.

    Raises
    ------
    InvalidOptionError
        For numbers of no vertex, and for vertices that no face uses: `use` says what they are not.
    """
    known = shape.point_count if shape.vertex_map is None else len(shape.vertex_map)
    outside = numbers[(numbers < 0) | (numbers >= known)]
    if len(outside):
        raise InvalidOptionError(f"Vertices are numbered 0..{known - 1}, got {outside.max()}.")
    mapped = numbers if shape.vertex_map is None else shape.vertex_map[numbers].astype(np.int64)
    if (mapped < 0).any():
        raise InvalidOptionError(f"Vertex {numbers[mapped < 0][0]} is used by no face: {use}.")
    return mapped


def vertices_in_file(path: str, shape: Shape, use: str) -> Index:
    """Return vertices in a file, in its order; none without one.

    A line holds a number of the input, or the three coordinates of a place near a vertex; # begins
    a comment. `use` says what a vertex that no face uses cannot be.

    Raises
    ------
    InvalidOptionError
        For another line, for no line, and as `vertices_of_input`.
    """
    if not path:
        return np.empty(0, np.int64)
    found: list[int] = []
    for line_number, line, words in number_lines(path):
        try:
            if len(words) == 1 and re.fullmatch("-?[0-9]{1,18}", words[0]):
                number = np.array([int(words[0])])
                found += vertices_of_input(shape, number, use).tolist()
                continue
            x, y, z = (float(word) for word in words)
        except InvalidOptionError:
            raise
        except ValueError:
            raise InvalidOptionError(
                f"Line {line_number} of {path} must hold a vertex number or x y z, got {line!r}."
            ) from None
        if not np.isfinite([x, y, z]).all():
            raise InvalidOptionError(f"Line {line_number} of {path} must hold finite numbers.")
        found.append(int(shape.tree.query(np.array([x, y, z]) - shape.offset)[1]))
    if not found:
        raise InvalidOptionError(f"{path} holds no vertex number and no point.")
    return np.array(found, np.int64)


def layers_of_segments(name: str, found: str) -> dict[str, str]:
    """Say what the layers of a segmentation are, for its declaration."""
    return {
        name: f"the surface with the number of the {found}",
        "samples": "the same on the refined surface",
        "borders": "curves between the segments",
    }


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
        own = {key: values[: target.point_count] for key, values in attributes.items()}
        known: dict[str, Any] = {"attributes": own, "face_attributes": faces, "on_input": on_input}
        called, known["auxiliary"] = name if on_input else "samples", not on_input
        layers.append(Layer(called, target.points, target.faces, **known, **options))
    return tuple(layers)


def _input_face_labels(shape: Shape, segmentation: Segmentation) -> IntArray:
    """Return the segment of each face of the shape that was given, (m,)."""
    if segmentation.surface.face_count == shape.face_count:
        return segmentation.of_faces()
    if shape.face_origin is None:
        return segmentation.of_input_faces()
    # Refined by the caller and again: the origin of its faces is that of the first refinement.
    return Segmentation(segmentation.labels[: shape.point_count], surface=shape).of_faces()


def note_unseen(layer: Layer, name: str, count: int, progress: Progress) -> None:
    """Say how many of `count` segments a layer on a coarse input shows nowhere."""
    fields = (layer.attributes[name], *layer.face_attributes.values())
    labels = np.unique(np.concatenate(fields))
    unseen = count - int((labels >= 0).sum())
    if unseen:
        text = (
            f"{unseen} of {count} segments hold no vertex of the input and no whole face, since it "
            "is coarse: the layer samples shows them."
        )
        progress.note(text, "segments_unseen", unseen=unseen, segments=count)


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
        progress.warn(
            f"{missing} of {fine.point_count} samples have no label (-1): they lie in components "
            "of the surface without any inner ball (open or flat pieces).",
            "samples_unlabelled",
            unlabelled=missing,
            samples=fine.point_count,
        )
    fields: dict[str, NDArray[Any]] = {name: labels}
    arrays = {**cloud_arrays(cloud), name: labels, f"face_{name}": segmentation.of_faces()}
    if (sure := segmentation.persistence) is not None:
        values["persistence"] = numbers(sure.tolist())
        arrays["persistence"] = sure
        fields["persistence"] = np.append(sure, 0.0)[labels]
    layers = surface_layers(name, shape, fine, fields, segmentation, color_by=name, labels=(name,))
    note_unseen(layers[0], name, segmentation.count, progress)
    return Outcome(
        shape=fine,
        layers=(*layers, *border_layer(segmentation)),
        values={
            name: segmentation.count,
            "areas": numbers(segmentation.areas.tolist()),
            "unlabelled": missing,
            "samples": fine.point_count,
            **values,
            "diagonal": fine.diagonal,
            "spacing": fine.spacing,
        },
        arrays=arrays,
        shown=layers[-1:],
    )
