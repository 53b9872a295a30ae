"""Preparation of shapes for single features: which samples they need, and which balls.

`Preparation` (in `surface_skeleton.py`) holds the options; the classes here add what curve
skeletons, sheets and edges need besides. Functions inherit them, and so do the operations of the
same names, so that both compute from the same balls.

Automatic lengths are fractions of the diagonal of the box along the axes. It changes by a fifth
when a shape is turned, and with it how fine a mesh is refined and how accurate balls are, so that
results would follow the pose. `InvariantPreparation` takes fractions of a size that does not.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from medialis.base.options import changed, choice
from medialis.base.progress import Progress
from medialis.base.threads import run_patiently
from medialis.shape.shape import Shape
from medialis.skeleton.medial_cloud import MedialCloud, Side
from medialis.skeleton.surface_skeleton import Preparation, SurfaceSkeletonOptions

SPREADS = 4.0
"""Size of a shape over the spread of its area: its diagonal, as the mean of real shapes."""


def size_share(shape: Shape) -> float:
    """Return a size of a shape that rotations do not change, in diagonals of its box.

    It is a multiple of the spread of its area: of the root mean square distance from its middle.
    """
    area = shape.point_areas
    if not area.sum() > 0.0 or not shape.diagonal > 0.0:
        return 1.0
    points, weights = (shape.points - shape.bounds[0]) / shape.diagonal, area / area.sum()
    square = ((points - weights @ points) ** 2).sum(axis=1)
    return SPREADS * float(np.sqrt(weights @ square))


@dataclass(frozen=True, kw_only=True)
class InvariantPreparation(Preparation):
    """Preparation whose automatic lengths do not change when the shape is turned."""

    def size_scale(self, shape: Shape) -> float:
        """Return the size that automatic lengths are fractions of, in diagonals of the shape."""
        return size_share(shape)

    def auto_values(
        self, data: Any, starts: Mapping[str, float], progress: Progress
    ) -> dict[str, float]:
        """Choose tolerance and longest edge, and all other automatic lengths by the size alone."""
        chosen = super().auto_values(data, starts, progress)
        surface = data.surface if isinstance(data, MedialCloud) else data
        others = sorted(set(starts) - {"tolerance", "refine"})
        if others and isinstance(surface, Shape):
            scale = run_patiently(lambda: self.size_scale(surface), progress)
            chosen |= {name: min(scale * starts[name], 1.0) for name in others}
        return chosen


@dataclass(frozen=True, kw_only=True)
class SheetPreparation(Preparation):
    """Preparation of what needs several samples across every face."""

    tolerance: float = changed(Preparation, "tolerance", advanced=True)
    refine: float = changed(
        Preparation,
        "refine",
        auto=0.01,
        help="Split edges longer than this share of the size for the computation, so that flat "
        "faces get samples; flat faces stay the same. 0 computes with the given vertices only. "
        "Sheets and edges need several samples across every face. auto: 1 %, or more where that "
        "would make too many samples.",
    )


SIDE_OF_EDGES: dict[str, Side] = {"convex": "inner", "concave": "outer", "both": "both"}


@dataclass(frozen=True, kw_only=True)
class EdgePreparation(SheetPreparation):
    """Preparation of what finds edges: balls inside of convex, outside of concave ones."""

    edges: str = choice(
        "both",
        "Edges",
        "Which edges are looked for.",
        {
            "convex": "Edges that stick out, by balls inside the shape.",
            "concave": "Edges of notches and grooves, by balls outside the shape.",
            "both": "Edges of both kinds, which takes twice as long as one.",
        },
    )

    def ball_options(self) -> SurfaceSkeletonOptions:
        """Return the options of the balls that are behind these edges."""
        return SurfaceSkeletonOptions.taken_from(self, side=SIDE_OF_EDGES[self.edges])

    def unused_options(self, data: Any) -> frozenset[str]:
        """Return the options that only prepare shapes, where balls are given."""
        return super().unused_options(data) | (
            {"edges"} if isinstance(data, MedialCloud) else set()
        )
