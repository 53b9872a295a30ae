"""Operation: a cloud without the points that lie in no manifold (thesis 4.2.4.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from medialis.clouds.dense_points import dense_points
from medialis.clouds.manifolds import ManifoldsOptions, manifolds
from medialis.errors import InvalidShapeError
from medialis.model.manifold_set import ManifoldSet, PointClass
from medialis.model.shape import Shape
from medialis.operations.declaration import Operation
from medialis.operations.manifolds import (
    manifold_arrays,
    manifold_values,
    note_mostly_noise,
)
from medialis.operations.result import Layer, Outcome
from medialis.options import changed
from medialis.progress import Progress, counted


@dataclass(frozen=True, kw_only=True)
class RemoveOutliersRun(ManifoldsOptions):
    """Options of the operation `remove_outliers`."""

    max_bend: float = changed(ManifoldsOptions, "max_bend", default=18.0)
    max_turn: float = changed(ManifoldsOptions, "max_turn", default=12.0)


def run(shape: Shape, options: RemoveOutliersRun, progress: Progress) -> Outcome:
    """Keep the points that belong to a manifold."""
    with progress.stage("manifolds", 0.0, 1.0):
        found = manifolds.of(shape, options, progress)
    noise = found.point_class == PointClass.NOISE
    dense = dense_points(shape.points, noise, options.min_points, progress)
    kept = ~noise | dense
    if not kept.any():
        least = options.min_points
        advice = "Try larger angles or more neighbours."
        if shape.point_count < least:
            advice = f"A surface needs {least} points or more (min_points): give more, or lower it."
        raise InvalidShapeError(
            f"None of the {shape.point_count} points lies on a smooth surface: nothing is left. "
            + advice
        )
    _note_removed(found, kept, dense, progress)
    note_mostly_noise(found, progress)
    clean = Layer(
        "without_outliers",
        shape.points[kept],
        attributes={
            "manifold": found.labels()[kept],
            "source": np.flatnonzero(kept).astype(np.int32),
        },
        color_by="manifold",
        labels=("manifold",),
        role="shape",
    )
    noise = Layer(
        "noise",
        shape.points,
        shape.faces,
        attributes={"noise": np.where(kept, -1, 0).astype(np.int32)},
        color_by="noise",
        labels=("noise",),
        on_input=True,
    )
    return Outcome(
        shape=shape,
        layers=(clean, noise),
        values={"kept_points": int(kept.sum()), **manifold_values(found)},
        arrays={"points": shape.points, "kept": kept, **manifold_arrays(found)},
        shown=(clean,),
    )


def _note_removed(
    found: ManifoldSet, kept: NDArray[np.bool_], dense: NDArray[np.bool_], progress: Progress
) -> None:
    """Say how many points go, and why, and how many stay although they lie on no smooth patch."""
    removed = int((~kept).sum())
    rough = int((~kept & (found.patch_counts == 0)).sum())
    small = removed - rough
    text = f"{counted(removed, 'point', of=len(kept), verbs=('is', 'are'))} noise"
    if removed:
        text += f": {rough} on no smooth patch, {small} on pieces smaller than min_points"
    counts = {"points": removed, "of": len(kept), "no_patch": rough, "small_pieces": small}
    progress.note(f"{text}.", "noise_removed", **counts)
    if stay := int(dense.sum()):
        progress.note(
            f"{counted(stay, 'point', verbs=('lies', 'lie'))} on no smooth surface, but as close "
            "together as the surface beside them: kept, as thin or sharp parts of it.",
            "dense_kept",
            points=stay,
        )


OPERATION = Operation(
    name="remove_outliers",
    filter_name="generate_point_cloud_without_outliers",
    label="Remove outliers",
    group="Segment",
    help="Remove the outliers of a cloud: points that lie on no smooth surface.\n\n"
    "Keeps what belongs to a manifold, also where surfaces cross, and thin or sharp parts that are "
    "as dense as the surface beside them. No point is moved: smooth does that.",
    source="thesis 4.2.4.2",
    examples=(("scan.ply", "the scan without the points that lie on no surface"),),
    layers={
        "without_outliers": "the points that are kept",
        "noise": "all points, with those that go marked",
    },
    options=RemoveOutliersRun,
    run=run,
    order=160,
)
