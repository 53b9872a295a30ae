"""Balls and rods on one axis: bodies with necks whose thickness is known in closed form.

The thickness at a sample is the diameter of the primitive that it is on: the ball, or the rod. At a
flat end of a rod the largest ball touches the edge: it has the radius of the distance to the edge.
"""

import itertools
from dataclasses import dataclass

import numpy as np

from closed_forms import revolved


@dataclass(frozen=True)
class Primitive:
    """A ball, or a rod from `low` to `high`, on the z-axis."""

    radius: float
    low: float
    high: float
    rod: bool = False

    @property
    def center(self):
        return 0.5 * (self.low + self.high)

    def width(self, z):
        """Radius of the section at a height; negative outside."""
        if self.rod:
            return np.where((z >= self.low) & (z <= self.high), self.radius, -1.0)
        square = self.radius**2 - (z - self.center) ** 2
        return np.where(square >= 0, np.sqrt(np.maximum(square, 0)), -1.0)


def ball(radius, center):
    return Primitive(radius, center - radius, center + radius)


def rod(radius, low, high):
    return Primitive(radius, low, high, rod=True)


def _crossings(one, other):
    """Heights at which the outlines of two primitives cross."""
    if one.rod and other.rod:
        return [one.low, one.high, other.low, other.high]
    if one.rod or other.rod:
        cylinder, sphere = (one, other) if one.rod else (other, one)
        square = sphere.radius**2 - cylinder.radius**2
        half = np.sqrt(max(square, 0))
        return [sphere.center - half, sphere.center + half, cylinder.low, cylinder.high]
    gap = other.center - one.center
    square = one.radius**2 - other.radius**2 + other.center**2 - one.center**2
    return [square / (2 * gap)] if gap else []


def profile(parts, corners):
    """Outline (p, 2) of the union: radius and height; balls have arcs of so many chords."""
    heights = {p.low for p in parts} | {p.high for p in parts}
    for i, one in enumerate(parts):
        for other in parts[:i]:
            heights.update(_crossings(one, other))
    low, high = min(p.low for p in parts), max(p.high for p in parts)
    heights = np.array(sorted(z for z in heights if low - 1e-12 <= z <= high + 1e-12))
    heights = heights[np.append(True, np.diff(heights) > 1e-9 * (high - low))]
    rows = [(0.0, low)]
    for a, b in itertools.pairwise(heights):
        middle = 0.5 * (a + b)
        widest = max(parts, key=lambda p: float(p.width(middle)))
        if widest.rod:
            piece = [(widest.radius, a), (widest.radius, b)]
        else:
            start, stop = (
                np.arccos(np.clip((z - widest.center) / widest.radius, -1, 1)) for z in (a, b)
            )
            chords = max(1, int(np.ceil((start - stop) / np.pi * corners)))
            turn = np.linspace(start, stop, chords + 1)
            piece = [(widest.radius * np.sin(t), widest.center + widest.radius * np.cos(t))
                     for t in turn]  # fmt: skip
        rows += piece
    rows.append((0.0, high))
    kept = [rows[0]]
    for row in rows[1:]:
        if np.hypot(row[0] - kept[-1][0], row[1] - kept[-1][1]) > 1e-7 * (high - low):
            kept.append(row)
    kept = np.array(kept)
    kept[[0, -1], 0] = 0.0
    return kept


def mesh_of(parts, corners=24, around=48):
    """The union as a closed mesh."""
    return revolved(profile(parts, corners), around)


def true_thickness(parts, points):
    """Thickness at points of the surface, and which of them are at a flat end of a rod."""
    across, z = np.hypot(points[:, 0], points[:, 1]), points[:, 2]
    off = np.stack([
        np.abs(across - p.radius) + 1e9 * ((z < p.low - 1e-6) | (z > p.high + 1e-6)) if p.rod
        else np.abs(np.hypot(across, z - p.center) - p.radius)
        for p in parts
    ])  # fmt: skip
    nearest = off.argmin(axis=0)
    true = 2 * np.array([p.radius for p in parts])[nearest]
    low, high = min(parts, key=lambda p: p.low), max(parts, key=lambda p: p.high)
    for end, height, sign in ((low, low.low, 1), (high, high.high, -1)):
        if end.rod:
            on_disc = np.abs(z - height) < 1e-6 * (high.high - low.low)
            on_side = (nearest == parts.index(end)) & ~on_disc
            edge = np.where(on_disc, end.radius - across, sign * (z - height))
            rows = on_disc | (on_side & (edge < end.radius))
            true[rows] = np.minimum(2 * end.radius, 2 * np.maximum(edge[rows], 0))
    return true


def random_necks(seed):
    """A chain of balls and rods of random sizes; kinds: snowman, dumbbell, ball stud, chain."""
    rng = np.random.default_rng(seed)
    kind = ("snowman", "dumbbell", "stud", "chain")[seed % 4]
    if kind == "snowman":  # balls that overlap in a neck
        radii = rng.uniform(4, 10, 2)
        gap = rng.uniform(1.02 * abs(radii[0] - radii[1]) + 0.3 * radii.min(), 0.95 * radii.sum())
        return kind, [ball(radii[0], 0.0), ball(radii[1], gap)]
    if kind == "dumbbell":
        radii = rng.uniform(5, 10, 2)
        bar, gap = rng.uniform(0.06, 0.7) * radii.min(), radii.sum() * rng.uniform(1.1, 2)
        return kind, [ball(radii[0], 0.0), ball(radii[1], gap), rod(bar, 0.0, gap)]
    if kind == "stud":
        radius = rng.uniform(5, 10)
        bar = rng.uniform(0.3, 0.8) * radius
        return kind, [ball(radius, 0.0), rod(bar, 0.0, radius * rng.uniform(1.6, 3))]
    radii = rng.uniform(3, 8, rng.integers(3, 6))
    parts, at = [], 0.0
    for k, radius in enumerate(radii):
        if k:
            at += 0.8 * (radii[k - 1] + radius)
        parts.append(ball(radius, at))
    return kind, parts
