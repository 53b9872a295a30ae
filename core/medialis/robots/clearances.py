"""Links of a robot at rest: which of them must not touch, and how far apart they are."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from medialis.base.validation import FloatArray
from medialis.robots.covers import Clearance, Cover
from medialis.robots.link_solids import LinkSolid

FAR = 1.5
"""Diagonals of a link: links that are farther away do not limit its balls. No ball of a cover is
larger than the link."""

TOUCHING = 1e-6
"""Diagonals: links that are nearer than this touch, and their balls overlap in any case."""

ROUNDING = 1e-9
"""Metres: balls that overlap by less touch."""

Frame = tuple[FloatArray, FloatArray]


@dataclass(frozen=True)
class LinkOverlap:
    """Two links whose balls or capsules overlap at rest, though the links do not.

    Attributes
    ----------
    first, second : str
        Names of the links.
    depth : float
        Largest depth of a ball of one in a ball of the other, in metres.
    """

    first: str
    second: str
    depth: float


class RestingLinks:
    """The links of a robot where they are when no joint is moved.

    Parameters
    ----------
    solids : dict of LinkSolid
    frames : dict of (rotation (3, 3), origin (3,))
        Of each link; links without a frame are not compared.
    are_separate : callable
        Returns whether two links move against each other without a joint between them.
    """

    def __init__(
        self,
        solids: Mapping[str, LinkSolid],
        frames: Mapping[str, Frame],
        are_separate: Callable[[str, str], bool],
    ) -> None:
        self.solids, self.frames = solids, frames
        self.gaps: dict[tuple[str, str], float] = {}
        """Distance in metres of links that move against each other and do not touch at rest."""
        for one, other in combinations(solids, 2):
            if one in frames and other in frames and are_separate(one, other):
                gap = min(self._gap(one, other), self._gap(other, one))
                if gap > 0.0:
                    self.gaps[one, other] = gap

    def _distances(self, points: FloatArray, one: str, other: str, reach: FloatArray) -> FloatArray:
        """Return distances of points of a link, at its diagonal 1, from another link.

        Negative inside; infinite where the other link's box is farther away than `reach` (q,).
        """
        solid, there = self.solids[one], self.solids[other]
        rotation, origin = self.frames[one]
        turn, place = self.frames[other]
        metres = points * solid.scale + solid.middle
        local = there.placed((metres @ rotation.T + origin - place) @ turn)
        ratio = there.scale / solid.scale
        low, high = there.box
        from_box = np.linalg.norm(np.maximum(np.maximum(low - local, local - high), 0.0), axis=1)
        result = np.full(len(points), np.inf)
        near = np.flatnonzero(from_box * ratio <= reach)
        if len(near):
            result[near] = there.distances(local[near])
            within = near[from_box[near] == 0.0]
            if len(within):
                result[within[there.contains(local[within])]] *= -1.0
        return result * ratio

    def _gap(self, one: str, other: str) -> float:
        """Return the distance of medial balls of a link from another one, in metres.

        Infinite for links that are far apart, 0 for links that touch.
        """
        solid = self.solids[one]
        centers, depths = solid.medial_balls
        away = self._distances(centers, one, other, np.full(len(centers), FAR)) - depths
        gap = float(away.min())
        return gap * solid.scale if gap > TOUCHING else 0.0

    def clearance(self, name: str) -> Clearance | None:
        """Return the distance from all links that a link must not touch, as a function of points.

        None where there are none.
        """
        others = [
            one if other == name else other
            for (one, other), gap in self.gaps.items()
            if name in (one, other) and gap < np.inf
        ]
        if not others:
            return None

        def distances(points: FloatArray) -> FloatArray:
            reach = np.full(len(points), FAR)
            return np.min([self._distances(points, name, other, reach) for other in others], axis=0)

        return distances

    def overlaps(self, covers: Mapping[str, Cover]) -> tuple[LinkOverlap, ...]:
        """Return the pairs of links whose covers overlap, the deepest first."""
        found = []
        placed = {}
        for name, cover in covers.items():
            if name in self.frames:
                rotation, origin = self.frames[name]
                ends = cover.axes.reshape(-1, 2, 3) @ rotation.T + origin
                placed[name] = ends, cover.radii
        for one, other in self.gaps:
            (first, radii), (second, others) = placed[one], placed[other]
            away = segment_distances(first, second) - radii[:, None] - others
            depth = -float(away.min(initial=np.inf))
            if depth > ROUNDING:
                found.append(LinkOverlap(one, other, depth))
        return tuple(sorted(found, key=lambda pair: -pair.depth))


def segment_distances(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the distance of each of some segments (k, 2, 3) from each of others (l, 2, 3), (k, l).

    Either the nearest points are ends of one of them, or both are within, where the segments cross
    when seen along the line between these points.
    """
    a, b = first[:, None, 0], second[None, :, 0]
    u, v = first[:, None, 1] - a, second[None, :, 1] - b
    to_second = b - a
    best = np.full((len(first), len(second)), np.inf)
    for base, along, others in (
        (a, u, (second[None, :, 0], second[None, :, 1])),
        (b, v, (first[:, None, 0], first[:, None, 1])),
    ):
        for end in others:
            share = _share(end - base, along)
            best = np.minimum(best, np.linalg.norm(end - base - share[..., None] * along, axis=2))
    uu, vv, uv = (np.sum(p * q, axis=2) for p, q in ((u, u), (v, v), (u, v)))
    wu, wv = np.sum(to_second * u, axis=2), np.sum(to_second * v, axis=2)
    det = uu * vv - uv * uv
    safe = np.where(det > 1e-12 * uu * vv, det, 1.0)
    s, t = (wu * vv - wv * uv) / safe, (wu * uv - wv * uu) / safe
    within = (det > 1e-12 * uu * vv) & (s >= 0) & (s <= 1) & (t >= 0) & (t <= 1)
    apart = np.linalg.norm(to_second + t[..., None] * v - s[..., None] * u, axis=2)
    return np.where(within, np.minimum(best, apart), best)


def _share(away: FloatArray, along: FloatArray) -> FloatArray:
    square = np.sum(along * along, axis=-1)
    share = np.sum(away * along, axis=-1) / np.where(square > 0.0, square, 1.0)
    return np.clip(share, 0.0, 1.0)
