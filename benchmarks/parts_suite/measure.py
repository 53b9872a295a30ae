"""What midsurface, wall check and thickness say of a part, against what is known of it."""

from __future__ import annotations

import math
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

import medialis
from parts_suite.truth import distance, near_lines, nearest, on_border

SAME = 0.005
"""Of a thickness."""

AWAY = 2.0
"""Thicknesses, of the thickest wall, that a weld is away where offsets are measured."""


class Known:
    """What is known of a part, ready for measuring."""

    def __init__(self, truth: dict[str, Any]) -> None:
        self.truth = truth
        self.patches = [(w, p) for w in truth["walls"] for p in w["patches"]]
        self.thickest = max(wall["thickness"] for wall in truth["walls"])
        self.welds = np.array(truth["weld_lines"], float).reshape(-1, 2, 3)

    def nearest_wall(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the distance to the nearest patch, and its row, of each place."""
        away = np.array([distance(patch, places) for _, patch in self.patches])
        return away.min(axis=0), away.argmin(axis=0)

    def off_welds(self, places: np.ndarray) -> np.ndarray:
        """Return how far places are from the nearest weld."""
        return near_lines(self.welds, places)

    def off_middle(self, region: dict[str, Any]) -> float:
        """Return how far a thin place is from the middle of a wall, in thicknesses; inf at a rim.

        Within half a thickness of a rim or weld, that is.
        """
        middle = np.mean([region["position"], region["opposite"]], axis=0)[None]
        away, row = self.nearest_wall(middle)
        wall, patch = self.patches[int(row[0])]
        half = 0.5 * wall["thickness"]
        rim = len(self.patches) == len(self.truth["walls"]) and on_border(patch, middle, half)[0]
        return math.inf if rim else float(away[0]) / wall["thickness"]

    def thickness_at(self, row: int, places: np.ndarray) -> np.ndarray:
        """Return the true thickness of the wall of a patch at some places."""
        wall, patch = self.patches[row]
        if wall["ending"] is None:
            return np.full(len(places), wall["thickness"])
        corners = np.array(patch["corners"])  # the second and third side are the far end
        along = corners[1] - corners[0]
        share = (places - corners[0]) @ along / (along @ along)
        return wall["thickness"] + share * (wall["ending"] - wall["thickness"])


def midsurface(path: Path, known: Known) -> dict[str, Any]:
    """Return counts, offsets, lengths and angles of the midsurface."""
    clock = time.perf_counter()
    try:
        result = medialis.run("midsurface", _shape(path))
    except medialis.MedialisError as error:
        return {"failed": str(error)[:60]}
    values, layer = result.values, result.layers[0]
    points, off = layer.points, known.off_welds(layer.points)
    away, row = known.nearest_wall(points)
    thick = np.array([known.patches[k][0]["thickness"] for k in range(len(known.patches))])[row]
    clear = off > AWAY * known.thickest
    told = layer.attributes["thickness"]
    errors = []
    for k in np.unique(row):
        mine = clear & (row == k) & (away < 0.5 * thick)
        mine &= ~on_border(known.patches[k][1], points, 0.5 * thick[0])
        true = known.thickness_at(int(k), points[mine])
        errors.append(np.abs(told[mine] / true - 1.0))
    every = np.concatenate(errors) if errors else np.empty(0)
    offset = away[clear] / thick[clear]
    lengths = [weld["length"] for weld in values["weld_list"]]
    area = sum(wall["area"] for wall in known.truth["walls"])
    return {
        "sheets": values["sheets"],
        "welds": values["welds"],
        "weld_length": sum(lengths),
        "offset": _percentile(offset, 99),
        "offset_most": float(offset.max(initial=0.0)),
        "thickness": _percentile(every, 99),
        "area": values["area"] / area - 1.0,
        **_angles(points, layer.faces),
        "seconds": time.perf_counter() - clock,
    }


def thickness(path: Path, known: Known) -> dict[str, Any]:
    """Return the errors of the thickness of walls, away from their ends, welds and blends."""
    clock = time.perf_counter()
    result = medialis.run("thickness", _shape(path))
    layer = next(layer for layer in result.layers if layer.name == "samples")
    points, told = layer.points, layer.attributes["thickness"]
    away, row = known.nearest_wall(points)
    errors, off = [], known.off_welds(points)
    for k, (wall, patch) in enumerate(known.patches):
        t = wall["thickness"]
        mine = (row == k) & (away < 0.51 * max(t, wall["ending"] or 0.0))
        feet = nearest(patch, points[mine])
        deep = ~on_border(patch, feet, t)
        rows = np.flatnonzero(mine)[deep]
        rows = rows[off[rows] > known.truth["radius"] + 1.5 * known.thickest]
        errors.append(np.abs(told[rows] / known.thickness_at(k, points[rows]) - 1.0))
    every = np.concatenate(errors)
    return {
        "samples": len(every),
        "median": _percentile(every, 50),
        "p99": _percentile(every, 99),
        "most": float(every.max(initial=0.0)),
        "seconds": time.perf_counter() - clock,
    }


def walls(path: Path, known: Known) -> dict[str, Any]:
    """Return what the wall check gets wrong: verdicts, areas, ends of thin places, ribs."""
    clock, wrong, ends = time.perf_counter(), [], 0.0
    ribs: list[dict[str, Any]] = []
    lowest = 0.9 * min(min(w["thickness"], w["ending"] or 1e9) for w in known.truth["walls"])
    asked = {"minimum": f"{lowest:.9g}mm", "maximum": f"{known.thickest:.9g}mm", "rib_ratio": 100.0}
    values = medialis.run("wall_check", _shape(path), **asked).values
    if not values["passed"]:
        wrong.append(f"up to {known.thickest:.4g} {values['verdict'][24:]}")
    for case in known.truth["verdicts"]:
        limit = case["minimum"]
        asked = {"minimum": f"{limit:.9g}mm", "rib_ratio": 100.0}
        result = medialis.run("wall_check", _shape(path), **asked)
        values = result.values
        ribs = values["ribs"]
        if values["passed"] != case["passed"]:
            wrong.append(f"at {limit:.4g} passed {values['passed']}")
        thin = [region for region in values["regions"] if region["kind"] == "too thin"]
        area = sum(region["area"] for region in thin)
        if not 0.97 * case["least_area"] <= area <= 1.03 * case["area"] + 1e-9:
            span = f"{case['least_area']:.0f}..{case['area']:.0f}"
            wrong.append(f"at {limit:.4g} area {area:.0f} for {span}")
        for region in thin:
            if region["opposite"] is None:
                ends = math.inf
                continue
            apart = math.dist(region["position"], region["opposite"])
            ends = max(ends, abs(apart / region["value"] - 1.0))
            ends = max(ends, known.off_middle(region))
    return {
        "wrong": wrong,
        "ends": ends,
        "ribs": [(r["kind"], round(r["thickness"], 4), round(r["wall"], 4)) for r in ribs],
        "ribs_right": same_ribs(ribs, known.truth["ribs"]),
        "seconds": time.perf_counter() - clock,
    }


def same_ribs(found: list[dict[str, Any]], known: list[dict[str, Any]]) -> bool:
    """Tell whether ribs are those that are known, within `SAME` of their thicknesses."""
    left = list(known)
    for rib in found:
        for one in left:
            near = all(abs(rib[key] / one[key] - 1) < SAME for key in ("thickness", "wall"))
            if near and rib["kind"] == one["kind"]:
                left.remove(one)
                break
        else:
            return False
    return not left


def _shape(path: Path) -> medialis.Shape:
    return medialis.read_shape(path, unit=None if path.suffix == ".step" else "mm")


def _percentile(values: np.ndarray, share: float) -> float:
    return float(np.percentile(values, share)) if len(values) else math.nan


def _angles(points: np.ndarray, faces: np.ndarray) -> dict[str, float]:
    least = np.full(len(faces), 180.0)
    for j in range(3):
        u = points[faces[:, (j + 1) % 3]] - points[faces[:, j]]
        v = points[faces[:, (j + 2) % 3]] - points[faces[:, j]]
        sine = np.linalg.norm(np.cross(u, v), axis=1)
        angle = np.degrees(np.arctan2(sine, np.einsum("ij,ij->i", u, v)))
        least = np.minimum(least, angle)
    return {"angle": float(least.min()), "angle_5": float(np.percentile(least, 5))}


def summary(rows: list[dict[str, Any]]) -> list[str]:
    """Return the shares of what is right."""
    counts: Counter[str] = Counter()
    of: Counter[str] = Counter()
    for row in rows:
        for name, right in row["right"].items():
            of[name] += 1
            counts[name] += bool(right)
    return [f"{name:12s} {counts[name]:4d} of {of[name]:4d}" for name in of]
