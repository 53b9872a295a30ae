"""How many balls or capsules each link of a robot gets, out of a given number.

Each link has covers by 1, 2, 3, ... balls. The number that counts is how many times thicker a cover
makes its link: 1 + 2 p / t for a protrusion p and a link that is t thick. Balls are dealt so that
the product of these factors over all links gets small: the next ones go where they decrease the
logarithm most, for each ball. A factor of a thick link is near 1 and hardly changes; that of a very
thin one changes by as much as p does, whatever t is: neither takes balls from all others.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np

from medialis.base.arrays import Index
from medialis.base.progress import Progress
from medialis.base.validation import FloatArray
from medialis.robots.covers import LinkCovers

LOOK_AHEAD = 4
"""Balls that may be needed together before the protrusion falls, as on the corners of a box."""

PER_PATCH = 4
"""Patches for each ball of a link, at least."""


SPENT_APART = 0.5
"""Fraction of the balls that keep links apart, at most, where all balls keep only some apart."""


class Shares(NamedTuple):
    """What each link gets.

    Attributes
    ----------
    covers : dict of LinkCovers
    counts : dict of int
    floors : dict of float
        For links whose covers keep clear of other links: how far, in diagonals, they may stick out
        anyway, since there are too few balls for less.
    """

    covers: dict[str, LinkCovers]
    counts: dict[str, int]
    floors: dict[str, float]


def share(
    free: Mapping[str, LinkCovers],
    limits: Mapping[str, FloatArray],
    gaps: Iterable[float],
    total: int,
    progress: Progress,
) -> Shares:
    """Share a number of balls among links.

    Parameters
    ----------
    free : dict of LinkCovers
        Covers of each link without regard to others.
    limits : dict of (m,) float64
        Of links near others: how far candidates may stick out to keep clear of these.
    gaps : iterable of float
        Distances in metres of links that must not touch. Links get balls for this first: as many
        pairs are kept apart as the number allows, beginning with the largest gaps.
    total : int
        Number of balls; at least one for each link is used.
    """
    covers, floors = dict(free), dict.fromkeys(limits, np.inf)
    floor, columns = _kept_apart(free, limits, sorted(gaps), total)
    for name, chosen in columns.items():
        one = free[name]
        floors[name] = floor / one.solid.scale
        needs = one.needs.within(np.maximum(limits[name], floors[name]))
        covers[name] = LinkCovers(one.solid, needs, chosen)
    counts = {name: one.fewest for name, one in covers.items()}
    room = total - sum(counts.values())
    steps = {name: _next_step(one, counts[name], room) for name, one in covers.items()}
    while room > 0 and steps:
        name = max(steps, key=lambda one: steps[one][0])
        gain, more = steps[name]
        if gain <= 0.0:
            break
        counts[name] += more
        room -= more
        steps[name] = _next_step(covers[name], counts[name], room)
        for other, (_, wanted) in steps.items():
            if wanted > room > 0:
                steps[other] = _next_step(covers[other], counts[other], room)
        progress.update(1.0 - room / total)
    return Shares(covers, counts, floors)


def _kept_apart(
    free: Mapping[str, LinkCovers], limits: Mapping[str, FloatArray], gaps: list[float], total: int
) -> tuple[float, dict[str, Index]]:
    """Return the least floor in metres that the balls suffice for, and columns within it.

    Links whose candidates may stick out by half of a gap, or by their limits, do not touch where
    they are at least this gap apart.
    """
    best: tuple[float, dict[str, Index]] = (np.inf, {})
    if not gaps or not limits:
        return best
    columns = _fewest(free, limits, 0.5 * gaps[0], total - len(free))
    if columns is not None:
        return 0.5 * gaps[0], columns
    low, high = 1, len(gaps)
    while low < high:
        middle = (low + high) // 2
        columns = _fewest(free, limits, 0.5 * gaps[middle], int(SPENT_APART * (total - len(free))))
        if columns is None:
            low = middle + 1
        else:
            best, high = (0.5 * gaps[middle], columns), middle
    return best


def _fewest(
    free: Mapping[str, LinkCovers], limits: Mapping[str, FloatArray], floor: float, room: int
) -> dict[str, Index] | None:
    """Return columns of covers that stick out by limits, or by a floor in metres.

    None where they are more than `room` balls besides one for each link.
    """
    found = {}
    for name, own in limits.items():
        one = free[name]
        allowed = np.maximum(own, floor / one.solid.scale)
        if allowed.min() >= one.protrusion(1):
            continue
        columns = one.needs.fewest(min(room + 1, len(one.needs.values) // PER_PATCH), allowed)
        if columns is None:
            return None
        found[name] = columns
        room -= len(columns) - 1
    return found


def _next_step(covers: LinkCovers, count: int, room: int) -> tuple[float, int]:
    """Return the largest gain for each ball that is added, and how many are added for it."""
    most = min(LOOK_AHEAD, room, len(covers.needs.values) // PER_PATCH - count)
    now = covers.factor(count)
    steps = [((now - covers.factor(count + more)) / more, more) for more in range(1, most + 1)]
    return max(steps, key=lambda step: (step[0], -step[1]), default=(0.0, 0))
