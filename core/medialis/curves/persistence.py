"""How sure each end of a curve skeleton is: how far it is from being no limb (for thesis 3.6.3).

A limb is one where its tip reaches out of the ball at its base, by half the radius of that ball or
by half its own width, and where enough of the surface hangs on it (`finishing.py`). The number is
how many times over it does both: as lengths, the lower of the two. At 1 the end is at the limit,
and another mesh of the same shape may have none there.
"""

from __future__ import annotations

import numpy as np

from medialis.base.arrays import Index, kd_tree
from medialis.base.validation import FloatArray, frozen
from medialis.curves.candidates import CandidateMeasure
from medialis.curves.curve_skeleton import CurveSkeleton
from medialis.curves.growth import APART, STICKS_OUT


def measured_persistence(
    graph: CurveSkeleton, measured: CandidateMeasure, candidates: Index, smallest: float
) -> FloatArray:
    """Return `node_persistence` of a graph that knows the node of each sample.

    A node is as wide as the shape at the nearest of the candidates, rows of what was measured.
    """
    surface, node = measured.cloud.surface, np.asarray(graph.vertex_node)
    known = np.flatnonzero(node >= 0)
    hangs = np.bincount(node[known], surface.point_areas[known], minlength=len(graph.nodes))
    areas: FloatArray = hangs.astype(np.float64)
    widths = np.full(len(graph.nodes), np.inf)
    if len(candidates):
        near = kd_tree(measured.cloud.centers[candidates]).query(graph.nodes)[1]
        widths = measured.widths[candidates[near]]
    return node_persistence(graph, widths, areas, smallest)


def node_persistence(
    graph: CurveSkeleton, widths: FloatArray, areas: FloatArray, smallest: float
) -> FloatArray:
    """Return how sure the limb of each node is.

    Parameters
    ----------
    graph : CurveSkeleton
        v nodes.
    widths : (v,) float64
        Half the width of the limb at each node; inf where it is not known.
    areas : (v,) float64
        Of the surface next to each node.
    smallest : float
        Area below which a limb is none; 0: every limb is large enough.

    Returns
    -------
    (v,) float64
        Without a unit, above 0; about 1 and more for limbs that were kept. Nodes between limbs have
        the maximum of their component: they are pruned last. A component without limbs gets the
        value of its whole area, or 1 if `smallest` is 0.
    """
    result, whole = np.full(len(graph.nodes), -1.0), np.bincount(graph.components, areas)
    for branch, row in enumerate(graph.branches):
        free = graph.degrees[row[[0, -1]]] == 1
        long = float(graph.branch_lengths[branch])
        if free.all():
            room = float(graph.radii[row].max())
            tip = row[0] if graph.radii[row[0]] < graph.radii[row[-1]] else row[-1]
            sure = _sticks_out(long, graph.radii[tip], room, widths[tip])
            hangs = whole[graph.components[tip]]
        elif free.any():
            base, tip = (row[-1], row[0]) if free[0] else (row[0], row[-1])
            away = np.linalg.norm(graph.nodes[row] - graph.nodes[base], axis=1)
            far = max(float(away[row == tip][0]), long / 2)
            sure = _sticks_out(far, graph.radii[tip], graph.radii[base], widths[tip])
            hangs = areas[row[away >= APART * graph.radii[base]]].sum()
        else:
            continue
        sure = min(sure, _times(hangs, smallest))
        result[row] = np.maximum(result[row], sure)
    most = np.full(graph.component_count, -1.0)
    np.maximum.at(most, graph.components, result)
    alone = [_times(one, smallest) if smallest > 0.0 else 1.0 for one in whole]
    most = np.where(most < 0.0, alone, most)
    return frozen(np.where(result < 0.0, most[graph.components], result), np.float64)


def _sticks_out(distance: float, tip: float, base: float, width: float) -> float:
    """How far the ball at a tip reaches out of that at the base, over what is asked (`growth`)."""
    return max(0.0, distance + tip - base) / max(min(STICKS_OUT * base, width), 1e-300)


def _times(area: float, smallest: float) -> float:
    return float(np.sqrt(area / smallest)) if smallest > 0.0 else np.inf
