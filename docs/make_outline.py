"""Draw what a medial axis is: an outline, its medial axis, and some of the largest discs inside.

    python docs/make_outline.py        # writes docs/pictures/medial_axis.svg

The axis is computed as in three dimensions: for each point of the outline the largest disc that
touches it there and holds no other point, by letting the disc shrink until nothing is inside.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

PICTURE = Path(__file__).resolve().parent / "pictures" / "medial_axis.svg"
POINTS = 900
WIDTH, HEIGHT, SCALE = 800, 560, 150.0
LEAST_ANGLE = 60.0
"""Degrees between the spokes of a disc: those of less belong to single bends of the outline."""

SHOWN = (0.05, 0.14, 0.255, 0.59)
"""Places along the outline whose discs are drawn, as parts of its points."""

STYLE = """\
text { font: 26px sans-serif; fill: #1b2a3a; }
.outline { fill: #dde6ee; stroke: #33475b; stroke-width: 3; }
.disc { fill: #f0a13033; stroke: #c46a00; stroke-width: 2; }
.spoke { stroke: #c46a00; stroke-width: 2; stroke-dasharray: 5 4; }
.axis { fill: #0b6fb8; }
.touch { fill: #c46a00; }
@media (prefers-color-scheme: dark) {
  text { fill: #e8eef4; }
  .outline { fill: #24313d; stroke: #9fb3c6; }
  .disc { stroke: #ffb54d; } .spoke { stroke: #ffb54d; } .touch { fill: #ffb54d; }
  .axis { fill: #5cb8ff; }
}"""

Array = NDArray[np.float64]


def outline() -> tuple[Array, Array]:
    """Return points of a closed outline with three lobes, and its unit normals outwards."""
    turn = np.linspace(0, 2 * np.pi, POINTS, endpoint=False)
    size = 1 + 0.42 * np.cos(3 * turn) + 0.1 * np.sin(2 * turn)
    points = np.stack([1.45 * size * np.cos(turn), 1.05 * size * np.sin(turn)], axis=1)
    along = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
    normals = np.stack([along[:, 1], -along[:, 0]], axis=1)
    return points, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def largest_discs(points: Array, normals: Array) -> tuple[Array, Array, NDArray[np.int64]]:
    """Return center, radius and second contact of the largest disc inside, at each point."""
    radius = np.full(len(points), 10.0)
    second = np.zeros(len(points), np.int64)
    while True:
        centers = points - radius[:, None] * normals
        away = np.linalg.norm(points[None] - centers[:, None], axis=2)
        np.fill_diagonal(away, np.inf)
        nearest = away.argmin(axis=1)
        inside = away[np.arange(len(points)), nearest] < radius * (1 - 1e-9)
        if not inside.any():
            return centers, radius, second
        # The disc through both points that touches the outline at the first one.
        gap = points[inside] - points[nearest[inside]]
        radius[inside] = (gap**2).sum(axis=1) / (2 * (gap * normals[inside]).sum(axis=1))
        second[inside] = nearest[inside]


def spoke_angles(points: Array, centers: Array, second: NDArray[np.int64]) -> Array:
    """Return the angle between the two spokes of each disc, in degrees."""
    spokes = points - centers, points[second] - centers
    first, other = (s / np.linalg.norm(s, axis=1, keepdims=True) for s in spokes)
    return np.degrees(np.arccos(np.clip((first * other).sum(axis=1), -1, 1)))


def drawing() -> str:
    """Return the picture as text."""
    points, normals = outline()
    centers, radius, second = largest_discs(points, normals)
    axis = spoke_angles(points, centers, second) > LEAST_ANGLE
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" role="img">',
        "<title>A shape, discs that fit inside and touch it twice, and the line of their centers"
        "</title>",
        f"<style>{STYLE}</style>",
        f'<path class="outline" d="M{" L".join(map(_place, points[::3]))} Z"/>',
    ]
    shown = [int(share * len(points)) for share in SHOWN]
    for row in shown:
        x, y = _place(centers[row]).split()
        lines.append(f'<circle class="disc" cx="{x}" cy="{y}" r="{SCALE * radius[row]:.1f}"/>')
    for row in shown:
        for touch in (points[row], points[second[row]]):
            path = f"M{_place(centers[row])} L{_place(touch)}"
            lines.append(f'<path class="spoke" d="{path}"/>{_dot("touch", touch, 6)}')
    lines += [_dot("axis", place, 2.5) for place in centers[axis]]
    lines += [_dot("axis", centers[row], 6) for row in shown]
    lines += [
        '<text x="24" y="44">outline</text>',
        '<text x="24" y="532"><tspan style="fill:#c46a00">discs that touch it twice</tspan></text>',
        '<text x="440" y="532"><tspan style="fill:#0b6fb8">their centers: medial axis</tspan>'
        "</text>",
        "</svg>",
    ]
    return "\n".join(lines) + "\n"


def _place(point: Array) -> str:
    x, y = 345 + SCALE * point[0], HEIGHT / 2 - 42 - SCALE * point[1]
    return f"{x:.1f} {y:.1f}"


def _dot(kind: str, point: Array, size: float) -> str:
    x, y = _place(point).split()
    return f'<circle class="{kind}" cx="{x}" cy="{y}" r="{size}"/>'


if __name__ == "__main__":
    PICTURE.write_text(drawing(), encoding="utf-8")
    print(PICTURE)
