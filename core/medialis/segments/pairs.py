"""How likely people put two places of a surface into the same part.

For each pair of sites a few quantities say how the surface leads from one to the other: how much
the radius changes on the way, how much the surface bends inwards, and how heat spreads between
them, over the surface as it is and over one that hardly lets it pass where it bends inwards. A
weighted sum of these gives the share of people who see one part.

Heat also jumps between the two places that a ball touches, as often as it would walk so far: the
two walls of a cup are as one, and both sides of a limb are closer than the way round it.

Quantities are means over several placements of the sites, so that it matters little where they lie.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from medialis.segments.sites import Sites, in_common
from medialis.validation import FloatArray

NEAR = 0.02
"""Caps are neighbours when they have more than this share of their area in common."""

HEAT = (1 / 100, 1 / 25, 1 / 8)
"""Times at which heat is looked at: it has spread over about this share of the surface."""

GONE = 10.0
"""Modes of which less than exp(-10) is left at a time are left out: a tenth is enough for most."""

BENT = 0.2
"""Bend in radians from one site to the next that lets 1 / e of the heat pass. A crease of 90
degrees lets 1 / 1000 pass."""

LINKED = 0.1
"""Share of a cap from which the caps across its balls are neighbours of its ball."""

JUMP = 0.02
"""Radians that a jump across a ball counts as at least: two spacings of the way."""

SHORTEST_JUMP = 0.2
"""Spacings: across anything thinner heat jumps as often as this."""

FAR = 9.0
"""Of what cannot be reached; the largest that quantities have elsewhere."""

NAMES = (
    "radius", "bends",
    "heat_early", "heat", "heat_late", "resistance",
    "held_early", "held", "held_late", "held_resistance",
)  # fmt: skip


def share_together(placements: Sequence[Sites], area: FloatArray) -> FloatArray:
    """Return the share of people who are expected to see one part, for each pair of sites, (s, s).

    0 between components of the surface.

    Parameters
    ----------
    placements : sequence of Sites
        Of the same surface; the result is for the sites of the first one.
    area : (n,) float64
        Of the samples.
    """
    sites = placements[0]
    total = np.full((len(sites), len(sites)), OFFSET)
    for other in placements:
        found = np.zeros((len(other), len(other)))
        for quantity, weight in zip(pair_quantities(other), WEIGHTS, strict=True):
            found += weight * quantity
        total += _carried(sites, other, area, found) / len(placements)
    shares = 1.0 / (1.0 + np.exp(np.clip(-total, -50.0, 50.0)))
    shares = (shares + shares.T) / 2
    shares[sites.components[:, None] != sites.components[None, :]] = 0.0
    return shares


def mean_quantities(placements: Sequence[Sites], area: FloatArray) -> list[FloatArray]:
    """Return the quantities of all pairs of sites of the first placement, means over all."""
    total = [np.zeros((len(placements[0]), len(placements[0]))) for _ in NAMES]
    for other in placements:
        for mean, found in zip(total, pair_quantities(other), strict=True):
            mean += _carried(placements[0], other, area, found) / len(placements)
    return total


def _carried(sites: Sites, other: Sites, area: FloatArray, values: FloatArray) -> FloatArray:
    """Means of the values of pairs of other sites over the caps of pairs of sites."""
    from scipy.sparse import csr_array

    every = np.arange(len(area))
    common = in_common(sites.shares, other.shares, every, every, area)
    total = common.sum(axis=1)
    mean = csr_array(common / np.where(total > 0, total, 1.0)[:, None])
    return np.asarray(mean @ (mean @ values).T).T


def pair_quantities(sites: Sites) -> list[FloatArray]:
    """Return the quantities of all pairs of sites, (s, s) each, in the order of `NAMES`."""
    s, spacing = len(sites), sites.spacing
    common = _shares_in_common(sites)
    one, two = np.nonzero(common > NEAR)
    step = sites.places[two] - sites.places[one]
    length = np.maximum(np.linalg.norm(step, axis=1), 1e-3 * spacing)
    turn = ((sites.normals[two] - sites.normals[one]) * step).sum(axis=1) / length
    bend = np.maximum(-turn, 0.0)
    across = _across(sites)
    jump = np.nonzero(np.where(across > LINKED, across, 0.0))
    ends = np.concatenate([one, jump[0]]), np.concatenate([two, jump[1]])
    log_radius = _smooth_logarithms(sites)
    way = 0.01 * length / spacing
    bends = np.concatenate([bend + way, np.full(len(jump[0]), JUMP)])
    found = [
        _least(np.abs(log_radius[ends[1]] - log_radius[ends[0]]), ends, s),
        np.log1p(3.0 * _least(bends, ends, s)),
    ]
    flow = sites.overlaps[one, two]
    # The mean square of the step of a random walk in time t is 4 t.
    flow = flow * (4.0 * s * spacing**2 / (flow * length**2).sum()) if len(flow) else flow
    area = sites.areas * (s / sites.areas.sum())
    jumps, jumping = _jumps(sites)
    ends = np.concatenate([one, jumps[0]]), np.concatenate([two, jumps[1]])
    for passing in (flow, flow * np.exp(-bend / BENT)):
        found += _heat(np.concatenate([passing, jumping]), ends, area)
    return found


def _jumps(sites: Sites) -> tuple[tuple[Any, Any], FloatArray]:
    """Pairs of sites that balls touch both of, and how much heat jumps from one to the other."""
    across = sites.across.copy()
    np.fill_diagonal(across, 0.0)
    one, two = np.nonzero(across)
    gap = np.linalg.norm(sites.places[two] - sites.places[one], axis=1)
    gap = np.maximum(gap, SHORTEST_JUMP * sites.spacing)
    # Steps of a length `gap`: their mean square in time t is 4 t as well.
    return (one, two), across[one, two] / 2 * 4.0 / gap**2


def _shares_in_common(sites: Sites) -> FloatArray:
    """Area that two caps have in common, for the means of those of each with itself; diagonal 0."""
    own = np.sqrt(np.diag(sites.overlaps))
    common = sites.overlaps / np.maximum(own[:, None] * own[None, :], 1e-300)
    np.fill_diagonal(common, 0.0)
    return np.asarray(common)


def _across(sites: Sites) -> FloatArray:
    """Share of two caps that lies across from the other, the mean of both; diagonal 0."""
    share = sites.across / sites.areas[:, None]
    share = np.minimum(1.0, 0.5 * (share + share.T))
    np.fill_diagonal(share, 0.0)
    return np.asarray(share)


def _smooth_logarithms(sites: Sites) -> FloatArray:
    """Logarithm of the radius, the mean over the neighbours."""
    total = sites.overlaps.sum(axis=1)
    return np.asarray((sites.overlaps @ np.log(sites.radii)) / np.maximum(total, 1e-300))


def _least(cost: FloatArray, ends: tuple[Any, Any], s: int) -> FloatArray:
    """Cost of the cheapest path between all pairs, `FAR` where there is none; ends both ways."""
    from medialis.segments._site_kernels import least_sums

    costs = np.full((s, s), np.inf, np.float32)
    np.minimum.at(costs, ends, cost)
    least_sums(costs, np.float32(FAR))
    return np.minimum(costs, FAR, dtype=np.float64)


def _heat(flow: FloatArray, ends: tuple[Any, Any], area: FloatArray) -> list[FloatArray]:
    """How much of the heat of two sites is common at each time, 0 to 1, and their resistance.

    The resistance is that of heat which has spread a little, as that of points only tells how many
    neighbours they have.
    """
    from scipy.linalg import eigh

    s = len(area)
    links = np.zeros((s, s))
    np.add.at(links, ends, flow)
    links = (links + links.T) / 2
    root = np.sqrt(area)
    matrix = (np.diag(links.sum(axis=1)) - links) / (root[:, None] * root[None, :])
    # Of a few modes vectors are found one by one.
    rate, mode = eigh(
        matrix, driver="evr", subset_by_value=(-np.inf, GONE / (HEAT[0] * s)), check_finite=False
    )
    rate, mode = np.maximum(rate, 0.0), mode / root[:, None]
    found: list[FloatArray] = []
    for share in HEAT:
        left = np.searchsorted(share * s * rate, GONE)  # rates rise
        half = mode[:, :left] * np.exp(-share * s * rate[:left] / 2)
        heat = half @ half.T
        own = np.sqrt(np.maximum(np.diag(heat), 1e-300))
        found.append(np.clip(heat / (own[:, None] * own[None, :]), 0.0, 1.0))
    moving = rate > 1e-8
    slow = mode[:, moving] * np.exp(-HEAT[0] * s * rate[moving] / 2) / np.sqrt(rate[moving])
    inner = slow @ slow.T
    own = np.diag(inner)
    found.append(np.log(np.maximum(own[:, None] + own[None, :] - 2 * inner, 0.0) + 0.1))
    return found


OFFSET = -1.175
WEIGHTS = (
    -0.943, 3.365,
    -1.989, -3.245, -6.693, 7.069,
    0.348, 2.720, 7.468, -9.239,
)  # fmt: skip
"""Chosen by logistic regression on what people did with 76 models of 19 classes and on 32 generated
bodies whose parts are beyond doubt, all with the same weight, and so that turned, split, decimated
and noisy copies of a model have the same sums; `benchmarks/parts.py left_out` chooses them anew,
and measures classes that are left out."""
