"""Operation: segments of a surface by mean shift of its medial cloud (thesis 5.3)."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from medialis.balls.surface_skeleton import Preparation
from medialis.errors import InvalidOptionError, InvalidShapeError
from medialis.files._files import number_lines
from medialis.model.shape import Shape
from medialis.operations.common import cloud_arrays
from medialis.operations.declaration import Operation
from medialis.operations.result import Outcome
from medialis.operations.segments import border_layer, computed, note_unseen, surface_layers
from medialis.options import Options, file
from medialis.progress import Progress
from medialis.segments.mean_shift_segments import MeanShiftSegmentsOptions, mean_shift_segments

_LINES = "Text file with a vertex number, or the x y z of a point near a vertex, in each line: "


@dataclass(frozen=True, kw_only=True)
class SeedFiles(Options):
    """Files of points that a user picked."""

    add_seeds: str = file("Add seeds", _LINES + "each is a seed.", selection="each")
    remove_seeds: str = file(
        "Remove seeds", _LINES + "seeds within the search radius of it are none."
    )


@dataclass(frozen=True, kw_only=True)
class MeanShiftSegmentsRun(MeanShiftSegmentsOptions, SeedFiles, Preparation):
    """Options of the operation `mean_shift_segments`."""


def run(shape: Shape, options: MeanShiftSegmentsRun, progress: Progress) -> Outcome:
    """Refine, shrink balls, shift seeds, carry the clusters to the surface."""
    add, remove = (_read_picks(path, shape) for path in (options.add_seeds, options.remove_seeds))
    picked = MeanShiftSegmentsOptions.taken_from(options, add=add, remove=remove)
    cloud = computed(shape, options, progress)
    with progress.stage("segments", 0.4, 1.0):
        segments = mean_shift_segments.of(cloud, picked, progress)
    if segments.count == 0:
        raise InvalidShapeError(
            "No sample got a segment: try a larger search radius or more last steps."
        )
    fine, labels = cloud.surface, segments.labels
    layers = surface_layers(
        "mean_shift_segments",
        shape,
        fine,
        {"segment": labels},
        color_by="segment",
        labels=("segment",),
    )
    note_unseen(layers[0], segments.count, progress)
    return Outcome(
        shape=fine,
        layers=(*layers, *border_layer(segments)),
        values={
            "samples": fine.point_count,
            "segments": segments.count,
            "unassigned_samples": int((labels < 0).sum()),
            "areas": segments.areas.tolist(),
        },
        arrays={**cloud_arrays(cloud), "segment": labels},
        shown=layers[-1:],
    )


def _read_picks(path: str, shape: Shape) -> NDArray[np.int64]:
    """Vertices in a file: a number of the input, or three coordinates, a line; # is a comment."""
    if not path:
        return np.empty(0, np.int64)
    numbers: list[int] = []
    places: list[list[float]] = []
    for line_number, line, words in number_lines(path):
        try:
            if len(words) == 1 and re.fullmatch("-?[0-9]{1,18}", words[0]):
                numbers.append(int(words[0]))
                continue
            x, y, z = (float(word) for word in words)
        except ValueError:
            raise InvalidOptionError(
                f"Line {line_number} of {path} must hold a vertex number or x y z, got {line!r}."
            ) from None
        places.append([x, y, z])
    if not numbers and not places:
        raise InvalidOptionError(f"{path} holds no vertex number and no point.")
    return np.concatenate([_in_shape(numbers, shape), _nearest(places, shape)])


def _in_shape(numbers: list[int], shape: Shape) -> NDArray[np.int64]:
    """Numbers in the repaired shape of vertices of the input."""
    known = shape.point_count if shape.vertex_map is None else len(shape.vertex_map)
    outside = [number for number in numbers if not 0 <= number < known]
    if outside:
        raise InvalidOptionError(f"Vertices are numbered 0..{known - 1}, got {outside[0]}.")
    picked = np.array(numbers, np.int64)
    mapped = picked if shape.vertex_map is None else shape.vertex_map[picked].astype(np.int64)
    if (mapped < 0).any():
        raise InvalidOptionError(f"Vertex {picked[mapped < 0][0]} is used by no face: no seed.")
    return mapped


def _nearest(places: list[list[float]], shape: Shape) -> NDArray[np.int64]:
    if not places:
        return np.empty(0, np.int64)
    if not np.isfinite(places).all():
        raise InvalidOptionError("Points of seeds must be finite numbers.")
    return shape.tree.query(np.array(places))[1].astype(np.int64)


OPERATION = Operation(
    name="mean_shift_segments",
    filter_name="compute_scalar_by_medial_bumps_per_vertex",
    label="Bump segments",
    group="Segment",
    help="Segment a surface into its convex bumps, such as the teeth of a dental cast.\n\n"
    "Bumps are where the medial cloud is dense: seeds are shifted to the densest places, and "
    "the samples along their path are their segment.",
    source="thesis 5.3",
    examples=(("teeth.ply --search-radius 5%", "one segment for each tooth"),),
    layers={
        "mean_shift_segments": "the surface with the number of the segment of each vertex",
        "samples": "the same on the refined surface",
        "borders": "curves between the segments",
    },
    options=MeanShiftSegmentsRun,
    run=run,
    order=170,
)
