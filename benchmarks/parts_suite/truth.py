"""What is known of a part: its walls with their true middle surfaces, its welds, ribs, verdicts.

A wall is a list of patches with one thickness, or one that runs linearly between two. A patch is a
convex polygon, or a part of a cylinder, cone or sphere. Lengths are millimetres.

    wall    {"thickness": [t0, t1], "patches": [...], "area", "least_area", "clear"}

`area` is that of the middle surface, `least_area` what of it is surely as thick as the wall (blends
and ends away), `clear` how far from welds and rims that begins.
"""

from __future__ import annotations

import itertools
import json
import math
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

Vector = tuple[float, float, float]
FAR = 1e9

RADII = (0.0, 0.25, 0.5, 1.0, 2.0)
"""Fillets, in thicknesses of the thinnest wall of the part."""

TESSELLATIONS = (0.1, 0.03, 0.01)
"""Millimetres that triangles may lie off the solid."""

HELD_OUT = ("channel", "heat_sink", "flanged_pipe", "snap_fit", "draft_rib")
"""Kinds that nobody looks at while the program is made."""


@dataclass
class Wall:
    """A wall: patches of its middle surface, in one thickness or from `thickness` to `ending`."""

    thickness: float
    patches: list[dict[str, Any]]
    area: float
    least_area: float
    clear: float
    ending: float | None = None


@dataclass
class Part:
    """A part and what is known of it."""

    kind: str
    radius_walls: float
    radius: float
    solid: Any
    sheets: int
    welds: list[float]
    walls: list[Wall]
    ribs: list[dict[str, Any]] = field(default_factory=list)
    weld_lines: list[dict[str, Any]] = field(default_factory=list)

    @property
    def name(self) -> str:
        """Kind and fillet, as in `tee_r0.25`."""
        return f"{self.kind}_r{self.radius_walls:g}"

    def truth(self) -> dict[str, Any]:
        """Return what is known, for JSON."""
        told = {key: value for key, value in vars(self).items() if key not in ("solid", "walls")}
        told["held_out"] = self.kind in HELD_OUT
        told["unit"] = "mm"
        told["walls"] = [asdict(wall) for wall in self.walls]
        told["verdicts"] = verdicts(self.walls)
        return told


def rib(thickness: float, wall: float, kind: str = "rib") -> dict[str, Any]:
    """Return what a person says of a rib: its thickness and that of the wall it stands on."""
    return {"kind": kind, "thickness": thickness, "wall": wall}


def verdicts(walls: list[Wall]) -> list[dict[str, Any]]:
    """Return limits with what is too thin there: equal, a little below and above, between walls."""
    known = sorted({round(wall.thickness, 6) for wall in walls if wall.ending is None})
    if any(wall.ending is not None for wall in walls):
        lowest = min(min(wall.thickness, wall.ending or FAR) for wall in walls)
        limits = [0.98 * lowest]
    else:
        limits = [known[0], 0.98 * known[0], 1.02 * known[-1]]
        limits += [(a + b) / 2 for a, b in itertools.pairwise(known)]
    result = []
    for limit in limits:
        thin = [w for w in walls if w.ending is None and w.thickness < limit * (1 - 1e-9)]
        result.append(
            {
                "minimum": limit,
                "passed": not thin,
                "area": sum(wall.area for wall in thin),
                "least_area": sum(wall.least_area for wall in thin),
            }
        )
    return result


def polygon(*corners: Vector) -> dict[str, Any]:
    """Return a flat convex patch."""
    return {"type": "polygon", "corners": [list(map(float, corner)) for corner in corners]}


def cylinder(
    start: Vector, axis: Vector, radius: float, length: float, across: Vector, turn: float = 360.0
) -> dict[str, Any]:
    """Return a part of a cylinder: from `across`, by `turn` degrees about `axis`."""
    return {"type": "cone", "start": list(start), "axis": list(axis), "radius": radius,
            "ending": radius, "length": length, "across": list(across), "turn": turn}  # fmt: skip


def sphere(center: Vector, radius: float, sides: list[Vector]) -> dict[str, Any]:
    """Return a part of a sphere: that ahead of all `sides`."""
    return {"type": "sphere", "center": list(center), "radius": radius, "sides": sides}


def polygon_area(patch: dict[str, Any]) -> float:
    """Return the area of a flat patch."""
    p = np.array(patch["corners"])
    return float(np.linalg.norm(np.cross(p[1:-1] - p[0], p[2:] - p[0]).sum(axis=0)) / 2)


def distance(patch: dict[str, Any], places: np.ndarray) -> np.ndarray:
    """Return how far places (n, 3) are from a patch, (n,)."""
    return np.linalg.norm(places - nearest(patch, places), axis=1)


def nearest(patch: dict[str, Any], places: np.ndarray) -> np.ndarray:
    """Return the nearest places of a patch, (n, 3)."""
    if patch["type"] == "polygon":
        return _on_polygon(np.array(patch["corners"]), places)
    if patch["type"] == "sphere":
        center = np.array(patch["center"])
        out = places - center
        out = out / np.maximum(np.linalg.norm(out, axis=1), 1e-300)[:, None]
        for side in patch["sides"]:
            n = np.array(side, float)
            out = out - np.minimum(out @ n, 0.0)[:, None] * n
            out = out / np.maximum(np.linalg.norm(out, axis=1), 1e-300)[:, None]
        return center + patch["radius"] * out
    if patch["type"] == "ring":
        return _on_ring(patch, places)
    start, axis, across = (np.array(patch[key], float) for key in ("start", "axis", "across"))
    side = np.cross(axis, across)
    away = places - start
    angle = np.arctan2(away @ side, away @ across) % (2 * math.pi)
    turn = math.radians(patch["turn"])
    if patch["turn"] < 360.0:
        past = (2 * math.pi - turn) / 2 + turn
        angle = np.where(angle > past, 0.0, np.minimum(angle, turn))
    height = np.clip(away @ axis, 0.0, patch["length"])
    radius = patch["radius"] + (patch["ending"] - patch["radius"]) * height / patch["length"]
    out = np.cos(angle)[:, None] * across + np.sin(angle)[:, None] * side
    return start + height[:, None] * axis + radius[:, None] * out


def _on_ring(patch: dict[str, Any], places: np.ndarray) -> np.ndarray:
    center, (inner, outer) = np.array(patch["center"]), patch["radii"]
    out = (places - center) * np.array([1.0, 1.0, 0.0])
    long = np.linalg.norm(out, axis=1)
    return center + out * (np.clip(long, inner, outer) / np.maximum(long, 1e-300))[:, None]


def _on_polygon(corners: np.ndarray, places: np.ndarray) -> np.ndarray:
    normal = np.cross(corners[1:-1] - corners[0], corners[2:] - corners[0]).sum(axis=0)
    normal = normal / np.linalg.norm(normal)
    flat = places - ((places - corners[0]) @ normal)[:, None] * normal
    inside = np.ones(len(places), bool)
    best, result = np.full(len(places), FAR), flat.copy()
    for one, two in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along = two - one
        inside &= (flat - one) @ np.cross(normal, along) >= 0
        share = np.clip((places - one) @ along / (along @ along), 0.0, 1.0)
        foot = one + share[:, None] * along
        off = np.linalg.norm(foot - places, axis=1)
        nearer = off < best
        best[nearer], result[nearer] = off[nearer], foot[nearer]
    result[inside] = flat[inside]
    return result


def on_border(patch: dict[str, Any], places: np.ndarray, within: float) -> np.ndarray:
    """Tell which places are nearer than `within` to the border of a flat patch, (n,)."""
    if patch["type"] == "polygon":
        corners = np.array(patch["corners"])
        ends = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
        return near_lines(ends, places) < within
    if patch["type"] == "sphere":
        center = np.array(patch["center"])
        deep = [(places - center) @ np.array(side, float) for side in patch["sides"]]
        return np.min(deep, axis=0) < within if deep else np.zeros(len(places), bool)
    if patch["type"] == "ring":
        out = np.linalg.norm((places - np.array(patch["center"]))[:, :2], axis=1)
        inner, outer = patch["radii"]
        return (out < inner + within) | (out > outer - within)
    start, axis = np.array(patch["start"]), np.array(patch["axis"])
    height = (places - start) @ axis
    result = (height < within) | (height > patch["length"] - within)
    if patch["turn"] < 360.0:
        across = np.array(patch["across"], float)
        angle = np.arctan2((places - start) @ np.cross(axis, across), (places - start) @ across)
        angle = angle % (2 * math.pi)
        radius = patch["radius"]
        far = np.minimum(angle, np.abs(math.radians(patch["turn"]) - angle)) * radius
        result |= (far < within) | (angle > math.radians(patch["turn"]))
    return result


def near_lines(ends: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return how far places (n, 3) are from the nearest of some lines (e, 2, 3), (n,)."""
    best = np.full(len(places), FAR)
    for one, two in ends:
        along = two - one
        share = np.clip((places - one) @ along / (along @ along), 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(one + share[:, None] * along - places, axis=1))
    return best


def read(path: Path) -> dict[str, Any]:
    """Read what is known of a part."""
    return json.loads(path.read_text(encoding="utf-8"))
