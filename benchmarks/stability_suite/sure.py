"""Whether what is said to be sure is there in copies: parts and thin spots by their persistence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

import medialis
from stability_suite.changes import changes

COPIES = (
    *("each face in four", "half of the faces", "a fifth of the faces"),
    *("noise 0.1 %", "noise 0.3 %"),
)

IN_COMMON = 0.8
"""Of a part and one of a copy together that both have at least, for the part to be there."""

SPOTS = 40

PARTS_FROM, SPOTS_FROM = (0.0, 1.25, 2.0), (0.0, 0.01, 0.04)
"""Persistence from which a class goes; of spots as a share of the diagonal."""


@dataclass(frozen=True)
class Found:
    """Parts and thin spots, at the vertices of the given mesh."""

    part: np.ndarray
    sure_parts: np.ndarray
    spot: np.ndarray
    sure_spots: np.ndarray
    thinnest: np.ndarray


def found_at(shape: medialis.Shape, places: np.ndarray) -> Found:
    """Compute parts and thin spots of a shape, and look at places."""
    parts = medialis.run("parts", shape)
    walls = medialis.run("thickness", shape, spots=SPOTS)
    medialis.forget()
    spots = walls.values["spots"]
    part, spot = (
        np.asarray(one.arrays[name])[cKDTree(one.shape.points).query(places)[1]]
        for one, name in ((parts, "parts"), (walls, "thin_spot"))
    )
    thinnest = np.array([one["position"] for one in spots]).reshape(-1, 3)
    sure = np.array([one["persistence"] for one in spots])
    return Found(part, np.array(parts.values["persistence"]), spot, sure, thinnest)


def rows_of(shape: medialis.Shape) -> tuple[list[tuple[float, bool]], list[tuple[float, bool]]]:
    """Return the persistence of each part and each thin spot, and whether all copies have it."""
    known = changes()
    own, tree = found_at(shape, shape.points), cKDTree(shape.points)
    others = [found_at(known[name][0](shape), shape.points) for name in COPIES]
    parts = [
        (float(sure), all(common(shape, own.part == k, one.part) >= IN_COMMON for one in others))
        for k, sure in enumerate(own.sure_parts)
    ]
    spots = []
    for k, sure in enumerate(own.sure_spots):
        at = tree.query(own.thinnest[k])[1]
        there = all(
            one.spot[at] > 0 or (own.spot[tree.query(one.thinnest)[1]] == k + 1).any()
            for one in others
        )
        spots.append((float(sure) / shape.diagonal, there))
    return parts, spots


def common(shape: medialis.Shape, part: np.ndarray, labels: np.ndarray) -> float:
    """Return what a part and the best of some others have in common, of both together."""
    weight, best = shape.point_areas, 0.0
    for label in np.unique(labels[part]):
        other = labels == label
        both = float(weight[part & other].sum())
        best = max(best, both / float(weight[part | other].sum()))
    return best


def table(name: str, rows: list[tuple[float, bool]], limits: tuple[float, ...]) -> str:
    """Return how many of each class of persistence are in all copies."""
    lines = [f"| {name}: persistence | in all copies | of |", "|---|---|---|"]
    for low, high in zip(limits, (*limits[1:], np.inf), strict=True):
        there = [one for sure, one in rows if low <= sure < high]
        lines.append(f"| {low:g} to {high:g} | {sum(there)} | {len(there)} |")
    return "\n".join(lines)
