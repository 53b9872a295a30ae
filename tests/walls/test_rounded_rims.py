"""Plates whose rims are rounded, from a little to full rounds: their thickness is that of the wall.

A plate is a stack of rectangles, each further in than the one below or above it: what is rounded
ends in mitres at its four corners, as edges do that a modeller rounds.
"""

import math

import numpy as np
import pytest

import medialis


def rounded_plate(size, t, top, bottom, segments, seed):
    """Plate (a, b, t) whose upper and lower rims are rounded by radii, cut into so many chords."""
    (a, b), turn = size, np.radians(np.linspace(0, 90, segments + 1))
    below = [(bottom * (1 - math.sin(u)), bottom * (1 - math.cos(u))) for u in turn]
    above = [(top * (1 - math.cos(u)), t - top * (1 - math.sin(u))) for u in turn]
    rows = []
    for row in (*below, *above):  # a radius of 0 has one row, and full rounds share one
        if not rows or math.dist(row, rows[-1]) > 1e-9 * t:
            rows.append(row)
    points = [
        place
        for d, z in rows
        for place in ((d, d, z), (a - d, d, z), (a - d, b - d, z), (d, b - d, z))
    ]
    last, flip = 4 * len(rows) - 4, np.random.default_rng(seed).random(len(points)) < 0.5
    faces = [(0, 2, 1), (0, 3, 2), (last, last + 1, last + 2), (last, last + 2, last + 3)]
    for p in range(last):
        q = p - p % 4 + (p + 1) % 4
        cut = [(p, q, p + 4), (q, q + 4, p + 4)]
        faces += cut if flip[p] else [(p, q, q + 4), (p, q + 4, p + 4)]
    return np.array(points), np.array(faces)


def turned(points, seed):
    rotation = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    return points @ (rotation * np.sign(np.linalg.det(rotation))).T


def assert_is_its_wall(size, t, top, bottom, segments, *, seed=0, unit="mm", refine=0.02):
    """Equal to both limits it passes; below a higher one it is one region, away from its rim."""
    points, faces = rounded_plate(size, t, top * t, bottom * t, segments, seed)
    if seed:
        points = turned(points, seed)
    shape = medialis.make_shape(points, faces, unit=unit)

    def check(low, high=None):
        limits = {"minimum": f"{low * t:.9g}{unit}"}
        limits |= {"maximum": f"{high * t:.9g}{unit}"} if high else {}
        return medialis.run("wall_check", shape, refine=refine, **limits).values

    for limits in ((1.0, 1.0), (0.98, None)):
        values = check(*limits)
        told = [(r["kind"], r["value"] / t, r["area"]) for r in values["regions"]]
        assert values["passed"], (limits, told)
    (region,) = check(1.02)["regions"]
    assert region["value"] == pytest.approx(t, rel=1e-3)
    assert math.dist(region["position"], region["opposite"]) == pytest.approx(t, rel=1e-3)
    flat = math.prod(side - 2 * max(top, bottom) * t for side in size)
    assert 0.97 * flat <= region["area"] <= 1.03 * math.prod(size)


# fmt: off
RIMS = [(0.25, 0), (0.5, 0), (0.7, 0), (0.9, 0), (1, 0),
        (0.125, 0.125), (0.25, 0.25), (0.45, 0.45), (0.5, 0.5), (0.6, 0.2), (0.75, 0.25)]
# fmt: on
"""Radii of the upper and the lower rim, in thicknesses; a half on both sides is a full round."""


@pytest.mark.parametrize(
    ("top", "bottom", "segments"),
    [(0.9, 0, 4), (0.5, 0, 8), (0.5, 0.5, 2), (0.5, 0.5, 5), (0.7, 0, 2)],
)
def test_a_rounded_rim_is_no_wall(top, bottom, segments):
    """0.9 of 0.95 mm on one side told 0.733 mm: mitres leaned the normals of the whole rim."""
    assert_is_its_wall((80, 60), 0.95, top, bottom, segments, seed=segments)


@pytest.mark.slow
@pytest.mark.parametrize("segments", [2, 3, 5, 9])
@pytest.mark.parametrize(("top", "bottom"), RIMS)
def test_rims_of_any_radius_and_tessellation_are_no_walls(top, bottom, segments):
    seed = 7 * segments + int(100 * top)
    assert_is_its_wall((80, 60), 2.0, top, bottom, segments, seed=seed, refine=0.01)


@pytest.mark.slow
@pytest.mark.parametrize(("unit", "factor"), [("m", 1e-3), ("in", 1 / 25.4), ("mm", 250.0)])
def test_rims_are_the_same_in_all_units(unit, factor):
    size = 80 * factor, 60 * factor
    assert_is_its_wall(size, 0.95 * factor, 0.9, 0, 4, seed=3, unit=unit)


@pytest.mark.parametrize("degrees", [1.0, 1.5])
def test_the_end_of_a_tapered_wall_is_no_rim(degrees):
    """Its sides are as good as parallel, but its end is as thin as they say: sharp, no round."""
    a, b, t = 40.0, 30.0, 4.0
    end = t - 2 * a * math.tan(math.radians(degrees))
    x, y, z = np.array([(i, j, k) for i in (0, 1) for j in (0, 1) for k in (-0.5, 0.5)]).T
    points = np.column_stack([a * x, b * y, np.where(x > 0, end, t) * z])
    quads = (0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)
    faces = [f for a, b, c, d in quads for f in ((a, b, c), (a, c, d))]
    shape = medialis.make_shape(points, faces, unit="mm")
    (region,) = medialis.run("wall_check", shape, minimum=f"{1.05 * end:.9g}mm").values["regions"]
    assert region["value"] == pytest.approx(end, rel=1e-3)
