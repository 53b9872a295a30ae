"""Lengths that stay what they are when a shape is turned: shares of a size that turns with it.

The diagonal of the box along the axes changes by a fifth when a shape is turned, and with it how
fine a mesh is refined and how accurate balls are, so that results would follow the pose.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np

from medialis.base.options import Options
from medialis.base.progress import Progress
from medialis.base.threads import run_patiently
from medialis.shape.shape import Shape
from medialis.skeleton.surface_skeleton import SurfaceSkeletonOptions

TURNING = ("refine", "tolerance", "threshold", "candidates")
"""Options that are lengths."""

SPREADS = 4.0  # halved 100 %, doubled 100 %
"""Times the spread of its area that a shape is large: its diagonal, as the mean of real shapes."""

Turning = TypeVar("Turning", bound=Options)


def turning(
    shape: Shape, options: Turning, progress: Progress, *declared: type[Options]
) -> Turning:
    """Take lengths as shares of a size that turns with the shape, where no one asked for others.

    Lengths that are no defaults, as the surface skeleton or `declared` options have them, stay
    shares of the diagonal.
    """
    kinds: tuple[type[Options], ...] = (SurfaceSkeletonOptions, *declared)
    every = [one for kind in kinds for one in kind.parameters()]
    known = {p.name: p.default for p in every if p.name in TURNING}
    names = [p.name for p in options.parameters() if p.name in known]
    usual = [name for name in names if getattr(options, name) == known[name]]
    if not usual:
        return options
    share = run_patiently(lambda: size_share(shape), progress)
    return replace(options, **{name: share * known[name] for name in usual})


def size_share(shape: Shape) -> float:
    """Return a size of a shape that no turn changes, in diagonals of its box.

    It is a multiple of the spread of its area: of the root mean square distance from its middle.
    """
    area = shape.point_areas
    if not area.sum() > 0.0 or not shape.diagonal > 0.0:
        return 1.0
    points, weights = (shape.points - shape.bounds[0]) / shape.diagonal, area / area.sum()
    square = ((points - weights @ points) ** 2).sum(axis=1)
    return SPREADS * float(np.sqrt(weights @ square))
