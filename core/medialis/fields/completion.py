"""A field that is known at some samples, continued over the rest of a surface (for thesis 3.5.1).

Every other sample of a mesh starts with the value of the nearest one along the edges. Then they
become the geometric mean of their neighbours, as far as a fixed number of steps carries. Where less
is known than before, only what took its values from there is continued anew.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from medialis.kept import Described
from medialis.model.ragged import Ragged
from medialis.model.shape import Shape
from medialis.surface.surface_graph import mesh_graph, nearest_seeds
from medialis.validation import FloatArray, IntArray

SMOOTHING_STEPS, SMOOTHING_ACCURACY = 40, 1e-3
"""Steps at most, and residual relative to the start. On horse2, 40 steps (60 ms) look the same as
400; the transition is then up to 40 edges wide."""


@dataclass(frozen=True, eq=False, repr=False)
class CompletedField(Described):
    """A field with a value at each of the n samples of a surface.

    Attributes
    ----------
    surface : Shape
    known : (n,) float64
        What it was completed from, NaN elsewhere.
    values : (n,) float64
    seed : (n,) int32
        The known sample that is nearest along the edges, -1 where there is none.
    distance : (n,) float64
        Its distance along the edges.
    lent : (n,) bool
        Known samples of components that have no values of their own.
    """

    surface: Shape
    known: FloatArray
    values: FloatArray
    seed: IntArray
    distance: FloatArray
    lent: NDArray[np.bool_]


def complete(surface: Shape, other: FloatArray, known: FloatArray) -> CompletedField:
    """Give a value to every sample.

    `known` (n,) is the field, NaN where it is not known; where a component of a mesh has no known
    value, the largest of `other` (n,) there counts as known.
    """
    n, missing = surface.point_count, np.isnan(known)
    if surface.faces is None or not missing.any():
        values = known.copy()
        if missing.all():
            values[np.nanargmax(other)] = np.nanmax(other)
        _nearest_in_space(surface, values)
        every, none = np.arange(n, dtype=np.int32), np.zeros(n, np.bool_)
        return CompletedField(surface, known, values, every, np.zeros(n), none)
    graph = mesh_graph(surface.faces, missing)
    seed, distance = nearest_seeds(surface.points, graph, ~missing)
    if (seed < 0).any():
        known = _with_other_components(surface, other, known, seed)
        seed, distance = nearest_seeds(surface.points, graph, ~np.isnan(known))
    reached = seed >= 0
    values = known.copy()
    values[reached] = known[seed[reached]]
    _smooth(np.flatnonzero(missing & reached), values, known, graph)
    _nearest_in_space(surface, values)
    return CompletedField(surface, known, values, seed, distance, missing & ~np.isnan(known))


def complete_again(before: CompletedField, other: FloatArray, known: FloatArray) -> CompletedField:
    """Return `complete` of a field that is known at fewer samples than before, or is lower there.

    What is more than `SMOOTHING_STEPS` edges from all samples that change keeps its value.
    """
    surface = before.surface
    if surface.faces is None:
        return complete(surface, other, known)
    # What was lent stays as long as it is there.
    lent = before.lent & ~np.isnan(other)
    known = np.where(lent, other, known)
    missing = np.isnan(known)
    lost = missing & ~np.isnan(before.known)
    changed = np.flatnonzero(lost | (known < before.known))
    if len(changed) == 0:
        return before
    seed, distance = before.seed.copy(), before.distance.copy()
    seed[changed] = np.where(missing[changed], seed[changed], changed)
    cut = (seed >= 0) & lost[seed]
    rows = np.flatnonzero(cut)
    near = _rings(surface, cut, missing, np.union1d(changed, rows))
    graph = mesh_graph(surface.faces, near)
    if not _seed_again(surface, graph, cut, seed, distance):
        return complete(surface, other, known)
    values = np.where(missing, before.values, known)
    values[rows] = known[seed[rows]]
    values[seed < 0] = np.nan
    _smooth(np.flatnonzero(near & missing), values, known, graph)
    _nearest_in_space(surface, values)
    return CompletedField(surface, known, values, seed, distance, lent)


def _rings(
    surface: Shape, inside: NDArray[np.bool_], free: NDArray[np.bool_], starts: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Return what is inside, and the free samples as many edges from the starts as steps carry."""
    faces = np.asarray(surface.faces)
    result = inside.copy()
    for _ in range(SMOOTHING_STEPS):
        around = np.unique(faces[surface.fans.joined(starts) // 3])
        starts = around[free[around] & ~result[around]]
        if len(starts) == 0:
            break
        result[starts] = True
    return result


def _seed_again(
    surface: Shape,
    graph: Ragged,
    cut: NDArray[np.bool_],
    seed: NDArray[np.int32],
    distance: NDArray[np.float64],
) -> bool:
    """Find the nearest seeds of some samples again, in place; False where one has none."""
    from medialis.surface._surface_graph_kernels import spread_again

    rows = np.flatnonzero(cut)
    seed[rows], distance[rows] = -1, np.inf
    room = int(graph.lengths[rows].sum()) + len(rows)
    keys, names = np.empty(room), np.empty(room, np.int32)
    spread_again(
        rows, cut, surface.points, graph.offsets, graph.indices, keys, names, distance, seed
    )
    return bool((seed[rows] >= 0).all())


def _with_other_components(
    surface: Shape, other: FloatArray, known: FloatArray, seed: IntArray
) -> FloatArray:
    """Return what is known, and the largest other value of each component without a seed."""
    rows = np.flatnonzero((seed < 0) & ~np.isnan(other))
    part = surface.components[rows]
    order = np.lexsort((rows, -other[rows], part))  # ties: the lowest index
    first = order[np.flatnonzero(np.diff(part[order], prepend=-1))]
    result = known.copy()
    result[rows[first]] = other[rows[first]]
    return result


def _smooth(
    rows: NDArray[np.int64], values: NDArray[np.float64], known: FloatArray, graph: Ragged
) -> None:
    """Replace the steps between nearest values by a smooth transition, in place.

    Of logarithms: what few steps leave undone is a share of the value then, also in a thin fin on a
    thick base.
    """
    from medialis.surface._surface_graph_kernels import make_harmonic

    low, high = np.nanmin(known), np.nanmax(known)
    steps, accuracy = SMOOTHING_STEPS, SMOOTHING_ACCURACY
    logarithms = np.log(values / high)
    make_harmonic(rows, graph.offsets, graph.indices, steps, accuracy, logarithms)
    # What few steps may overshoot.
    values[rows] = np.clip(high * np.exp(logarithms[rows]), low, high)


def _nearest_in_space(surface: Shape, values: NDArray[np.float64]) -> None:
    """Give samples without a value the nearest one in space, in place."""
    from scipy.spatial import cKDTree

    missing = np.isnan(values)
    known = np.flatnonzero(~missing)
    if len(known) < len(values):
        nearest = cKDTree(surface.points[known]).query(surface.points[missing])[1]
        values[missing] = values[known[nearest]]
