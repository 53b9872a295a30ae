"""Operation: segments of a surface by mean shift of its medial cloud (thesis 5.3)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from medialis.balls.surface_skeleton import Preparation, surface_skeleton
from medialis.errors import FileError, InvalidOptionError, InvalidShapeError
from medialis.model.segmentation import Segmentation
from medialis.model.shape import Shape
from medialis.operations.common import cloud_arrays
from medialis.operations.declaration import Operation
from medialis.operations.result import Layer, Outcome
from medialis.operations.segments import note_unseen
from medialis.options import choice, file, flag, length, whole
from medialis.progress import Progress
from medialis.segments.mean_shift_segments import Seeds, mean_shift_segments


@dataclass(frozen=True, kw_only=True)
class MeanShiftSegmentsRun(Preparation):
    """Options of the operation `mean_shift_segments`."""

    reach: float = length(
        0.05,
        "Reach",
        "Radius of the kernel: about the half width of a bump.",
        low=0.001,
    )
    seeds: Seeds = choice(
        "spread",
        "Seeds",
        "Which balls are shifted: some all over, some of the smallest 30 % (bumps, "
        "such as teeth), all (slow), or none but those added.",
        ("spread", "bumps", "all", "none"),
    )
    last_steps: int = whole(
        0,
        "Last steps",
        "Only so many last steps of each path count, so that what is far from the "
        "dense places gets no segment; 20 for dental casts. 0 counts the whole path.",
        high=300,
    )
    fill: bool = flag(
        True,
        "Whole surface",
        "What got no segment takes the nearest one along the surface. Off for dental casts.",
    )
    add_seeds: str = file(
        "Add seeds",
        "Text file with a vertex number, or x y z of a point near a vertex, a line: "
        "each is a seed.",
    )
    remove_seeds: str = file(
        "Remove seeds",
        "Text file with a vertex number, or x y z of a point near a vertex, a line: "
        "seeds within reach of it are none.",
    )


def run(shape: Shape, options: MeanShiftSegmentsRun, progress: Progress) -> Outcome:
    """Refine, shrink balls, shift seeds, carry the clusters to the surface."""
    add, remove = (_read_picks(path, shape) for path in (options.add_seeds, options.remove_seeds))
    with progress.stage("skeleton", 0.0, 0.5):
        cloud = surface_skeleton.of(shape, options, progress)
    fine = cloud.surface
    with progress.stage("segments", 0.5, 1.0):
        found = mean_shift_segments(
            fine,
            cloud,
            reach=options.reach,
            seeds=options.seeds,
            add=add,
            remove=remove,
            last_steps=options.last_steps or None,
            fill=options.fill,
            progress=progress,
        )
    if found.count == 0:
        raise InvalidShapeError("No sample got a segment: try a larger reach or more last steps.")
    surface = _layer("mean_shift_segments", shape, found)
    note_unseen(surface, found.count, progress)
    samples = () if fine is shape else (_layer("samples", fine, found),)
    return Outcome(
        shape=fine,
        layers=(surface, *samples),
        values={
            "samples": fine.point_count,
            "segments": found.count,
            "unassigned_samples": int((found.labels < 0).sum()),
            "areas": found.areas.tolist(),
        },
        arrays={**cloud_arrays(fine, cloud), "segment": found.labels},
        shown=samples or (surface,),
    )


def _layer(name: str, shape: Shape, found: Segmentation) -> Layer:
    """Layer of the first points of the refined shape: all of them, or the vertices of the input."""
    return Layer(
        name,
        shape.points,
        shape.faces,
        attributes={"segment": found.labels[: shape.point_count]},
        color_by="segment",
        labels=("segment",),
        on_input=name != "samples",
        auxiliary=name == "samples",
    )


def _read_picks(path: str, shape: Shape) -> NDArray[np.int64]:
    """Vertices in a file: a number of the input, or three coordinates, a line; # is a comment."""
    if not path:
        return np.empty(0, np.int64)
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is no text"
        raise FileError(f"Cannot read the points in {path}: {reason}.") from None
    numbers: list[int] = []
    places: list[list[float]] = []
    for line_number, line in enumerate(text.splitlines(), 1):
        words = line.split("#")[0].replace(",", " ").split()
        if not words:
            continue
        try:
            if len(words) == 1:
                numbers.append(int(words[0]))
                continue
            x, y, z = (float(word) for word in words)
        except ValueError:
            raise InvalidOptionError(
                f"Line {line_number} of {path} must hold a vertex number or x y z, got "
                f"{line.strip()[:40]!r}."
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
    from scipy.spatial import cKDTree

    if not np.isfinite(places).all():
        raise InvalidOptionError("Points of seeds must be finite numbers.")
    return cKDTree(shape.points).query(np.array(places))[1].astype(np.int64)


_FILE_HELP = "Text file with a vertex number, or x y z of a point near a vertex, a line"

OPERATION = Operation(
    name="mean_shift_segments",
    filter_name="compute_segmentation_by_mean_shift_per_vertex",
    label="Bump segments",
    group="Segment",
    help="Segment a surface into its convex bumps, such as the teeth of a dental cast.\n\n"
    "Bumps are where the medial cloud is dense: seeds are shifted to the densest places, and "
    "what they pass on the way is their segment.",
    source="thesis 5.3",
    options=MeanShiftSegmentsRun,
    run=run,
    order=170,
)
