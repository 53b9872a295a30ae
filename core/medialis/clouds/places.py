"""The places of a cloud that are classified: each once, without scatter, no denser than it is."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from medialis.balls.subsampling import points_apart
from medialis.clouds.smoothing import SCATTERS_APART, jitter, without_jitter
from medialis.model.manifold_set import ManifoldSet
from medialis.progress import Progress
from medialis.threads import run_patiently
from medialis.validation import FloatArray


@dataclass(frozen=True, eq=False)
class Speakers:
    """Which of the classified places speaks for each point.

    Attributes
    ----------
    place : (n,) int64
        The place of each point.
    places : (p, 3) float64
        Different places.
    chosen : (k,) int64
        Those that are classified.
    apart : float
        Places nearer to a chosen one than this may be left out.
    """

    place: NDArray[np.int64]
    places: FloatArray
    chosen: NDArray[np.int64]
    apart: float

    def rows(self, found: ManifoldSet) -> NDArray[np.int64]:
        """Return the row of each point in a set of the chosen places, (n,).

        A place that was left out has that of the nearest chosen one in a manifold, if there is one
        as near as it must have been.
        """
        from scipy.spatial import cKDTree

        row = np.full(len(self.places), -1)
        row[self.chosen] = np.arange(len(self.chosen))
        left = np.flatnonzero(row < 0)
        if len(left):
            good = np.flatnonzero(found.manifolds.lengths > 0)
            for rows in (np.arange(len(self.chosen)), good):
                tree = cKDTree(self.places[self.chosen[rows]])
                # A little farther: rounding must leave none without.
                near = tree.query(self.places[left], distance_upper_bound=1.01 * self.apart)[1]
                some = near < len(rows)
                row[left[some]] = rows[near[some]]
        return np.asarray(row[self.place])


def classified_places(
    points: FloatArray, fewest: int, smooth: bool, progress: Progress
) -> tuple[FloatArray, Speakers]:
    """Return each place once, in units of the size and without scatter, and who speaks for whom.

    Places are in the order of coordinates: ties then do not depend on the given order. None are
    returned for points that all coincide. Where they are denser than they scatter, no
    neighbourhood of theirs is flat: some are chosen that are far enough apart.
    """
    low, high = points.min(axis=0), points.max(axis=0)
    size = math.hypot(*(high - low))
    if size == 0.0:
        nowhere = np.zeros(len(points), np.int64)
        return np.empty((0, 3)), Speakers(nowhere, np.empty((0, 3)), nowhere[:0], 0.0)
    places, place = run_patiently(lambda: _different(points), progress)
    places = (places - 0.5 * (low + high)) / size
    every = np.arange(len(places))
    if len(places) < fewest or not smooth:
        return places, Speakers(place, places, every, 0.0)
    scatter = run_patiently(lambda: jitter(places), progress)
    if scatter == 0.0:
        return places, Speakers(place, places, every, 0.0)
    progress.note(
        f"The points scatter by {100 * scatter:.2g} % of the size about their surfaces. They were "
        "classified by smoothed positions (smooth = off turns this off).",
        "scattered",
        scatter=scatter,
    )
    apart = SCATTERS_APART * scatter
    chosen = np.flatnonzero(points_apart(places, every, apart))
    moved = without_jitter(places, chosen, scatter, progress)
    return moved, Speakers(place, places, chosen, apart)


def _different(points: FloatArray) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return the different rows, sorted, and which of them each point is.

    As `numpy.unique`, which lets no other thread run while it sorts rows.
    """
    order = np.lexsort(points.T[::-1])
    rising = points[order]
    fresh = np.ones(len(points), bool)
    fresh[1:] = (rising[1:] != rising[:-1]).any(axis=1)
    place = np.empty(len(points), np.int64)
    place[order] = np.cumsum(fresh) - 1
    return rising[fresh], place
