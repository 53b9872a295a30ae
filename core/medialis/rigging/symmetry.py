"""The plane under which a curve skeleton is its own mirror image, and the limbs that it pairs."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from medialis.rigging.limbs import Limb
from medialis.validation import FloatArray

SYMMETRIC = 0.65
"""Share of the length of all limbs whose image must be a limb, the less the farther it is off."""
TIE = 0.05
"""Planes whose shares differ by less are equally good: the one facing x most is taken."""
SAMPLES, LONGEST, REFINED, TURNS = 400, 24, 8, 12
ALIKE = 0.97
"""Planes whose normals have at least this product are fitted once."""
PLACES = np.linspace(0.0, 1.0, 17)


@dataclass(frozen=True)
class Plane:
    """Points p with ``normal @ p == offset``; the left side is where it is larger."""

    normal: FloatArray
    offset: float

    def image(self, points: FloatArray) -> FloatArray:
        """Return the mirror image of points (..., 3)."""
        return points - 2 * (points @ self.normal - self.offset)[..., None] * self.normal


def mirrored_limbs(limbs: list[Limb]) -> list[tuple[int, int]]:
    """Return pairs of limbs that are mirror images of each other, left and right one.

    Planes are tried through the middle of all limbs, across their principal axes, and between the
    ends of any two of the longest; the best are fitted to what they map on what. A limb is the
    image of another where their balls overlap, on average, and each is the nearest image of the
    other. Without a plane that maps nearly all limbs on limbs (across it, or each along itself)
    there are no pairs.
    """
    kept = [number for number, limb in enumerate(limbs) if limb.kept and limb.length > 0]
    if len(kept) < 2:
        return []
    rows = np.stack([limbs[number].at(PLACES) for number in kept])
    lengths = np.array([limbs[number].length for number in kept])
    found = [
        (*_pairs(plane, rows, lengths), plane) for plane in _planes(limbs, kept, rows, lengths)
    ]
    # A flat figure is its own image in its own plane, too: a limb that is mapped on another one
    # counts half as much again.
    found = [one for one in found if one[0] >= SYMMETRIC]
    in_pairs = [lengths[np.array(pairs, int)].sum() / lengths.sum() for _, pairs, _ in found]
    worth = [share + half / 2 for (share, _, _), half in zip(found, in_pairs, strict=True)]
    equal = [one for one, value in zip(found, worth, strict=True) if value >= max(worth) - TIE]
    if not equal:
        return []
    _, pairs, plane = max(equal, key=lambda one: abs(one[2].normal[0]))
    side = rows[:, :, :3].mean(axis=1) @ plane.normal
    return [(kept[a], kept[b]) if side[a] > side[b] else (kept[b], kept[a]) for a, b in pairs]


def _planes(
    limbs: list[Limb], kept: list[int], rows: FloatArray, lengths: FloatArray
) -> list[Plane]:
    """Return the best planes, fitted."""
    from scipy.spatial import cKDTree

    step = lengths.sum() / SAMPLES
    samples = np.concatenate(
        [
            limbs[number].at(np.linspace(0.0, 1.0, int(length / step) + 2))
            for number, length in zip(kept, lengths.tolist(), strict=True)
        ]
    )
    points = samples[:, :3]
    tree = cKDTree(points)
    middle = points.mean(axis=0)
    axes = np.linalg.eigh(np.cov((points - middle).T))[1].T
    planes = [_facing(axis, middle) for axis in axes]
    longest = np.argsort(-lengths, kind="stable")[:LONGEST]
    for a, b in itertools.combinations(longest.tolist(), 2):
        one, other = rows[a, -1, :3], rows[b, -1, :3]
        if (one != other).any():
            planes.append(_facing(one - other, (one + other) / 2))

    def misfit(plane: Plane) -> float:
        apart, near = tree.query(plane.image(points))
        return float(np.minimum(apart / np.maximum(samples[near, 3], 1e-300), 1.0).mean())

    order = np.argsort([misfit(plane) for plane in planes], kind="stable")
    distinct: list[Plane] = []
    for number in order.tolist():
        if all(abs(planes[number].normal @ plane.normal) < ALIKE for plane in distinct):
            distinct.append(planes[number])
    return [_fitted(plane, points, tree) for plane in distinct[:REFINED]]


def _facing(normal: FloatArray, through: FloatArray) -> Plane:
    """Return a plane through a point; the largest coordinate of its normal is positive."""
    normal = normal / np.linalg.norm(normal)
    normal = normal * np.sign(normal[np.argmax(np.round(np.abs(normal), 6))])
    return Plane(normal, float(normal @ through))


def _fitted(plane: Plane, points: FloatArray, tree: object) -> Plane:
    """Fit a plane to the pairs of a point and that nearest to its image, again and again.

    |q - image(p)|^2 is |q - p|^2 + 4 (n p)(n q) for p and q from their means: the best normal is
    the eigenvector of the smallest eigenvalue of the symmetric part of the sum of p q^T.
    """
    for _ in range(TURNS):
        _, near = tree.query(plane.image(points))  # type: ignore[attr-defined]
        p, q = points, points[near]
        product = (p - p.mean(axis=0)).T @ (q - q.mean(axis=0))
        normal = np.linalg.eigh(product + product.T)[1][:, 0]
        after = _facing(normal, (p.mean(axis=0) + q.mean(axis=0)) / 2)
        if abs(after.normal @ plane.normal) < 0.9:  # it turned to another symmetry
            return plane
        plane = after
    return plane


def _pairs(
    plane: Plane, rows: FloatArray, lengths: FloatArray
) -> tuple[float, list[tuple[int, int]]]:
    """Return the share of the length whose image is a limb, and the pairs of limbs.

    A limb counts the less the farther its image is off: 1 - d^2, d = 1 where balls only touch.
    """
    from scipy.spatial.distance import cdist

    apart = np.zeros((len(rows), len(rows)))
    for k in range(len(PLACES)):
        touching = np.maximum(rows[:, None, k, 3] + rows[None, :, k, 3], 1e-300)
        apart += cdist(plane.image(rows[:, k, :3]), rows[:, k, :3]) / touching
    apart = (apart + apart.T) / (2 * len(PLACES))
    image = apart.argmin(axis=1)
    number = np.arange(len(rows))
    good = (image[image] == number) & (apart[number, image] <= 1.0)
    overlap = np.maximum(1.0 - apart[number, image] ** 2, 0.0)
    share = float((lengths * good * overlap).sum() / lengths.sum())
    pairs = [(a, int(image[a])) for a in np.flatnonzero(good & (image > number)).tolist()]
    return share, pairs
