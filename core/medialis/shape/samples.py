"""Sample shapes by name, made by code: creatures, plants, parts of machines, vessels."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from medialis.base.validation import FloatArray, as_choice, as_whole_number
from medialis.shape.generate import Cone, Point, blended, dental_arch, implicit_shape, organic_shape
from medialis.shape.reading import make_shape
from medialis.shape.shape import Shape


def sample_shape(name: str, resolution: int = 128) -> Shape:
    """Make a sample shape: a closed mesh with outward normals, or the points of a scan.

    Parameters
    ----------
    name : str
        One of `SAMPLES`: creature, hand, tree, molecule, vase, gear, bracket, teeth, scan.
    resolution : int
        Vertices along the longest side, about, 56 to 600; their number grows with its square.

    Returns
    -------
    Shape
        The gear has sharp edges; the vase is a thin shell; the molecule has a ring, the gear a hole
        and the bracket three.

    Raises
    ------
    InvalidOptionError
        When there is no such name or `resolution` is out of its range.

    See Also
    --------
    dental_arch : the teeth, with the number of the tooth at each vertex.

    Examples
    --------
    >>> import medialis
    >>> gear = medialis.sample_shape("gear", 56)
    >>> gear.point_count - len(gear.faces) // 2  # Euler characteristic: one hole
    0
    """
    as_choice(name, "name", tuple(SAMPLES))
    return _MADE[name][0](as_whole_number(resolution, "resolution", low=56, high=600))


def _hand(resolution: int) -> Shape:
    """Five fingers of three joints each on a palm, and a stub of the arm."""
    cones: list[Cone] = [
        ((0.0, 0.0, -0.75), (0.0, 0.0, -0.15), 0.20, 0.19),
        ((-0.16, 0.0, 0.0), (-0.22, 0.0, 0.55), 0.15, 0.13),
        ((0.16, 0.0, 0.0), (0.22, 0.0, 0.52), 0.16, 0.12),
        ((0.0, 0.0, -0.05), (0.0, 0.0, 0.60), 0.17, 0.13),
    ]
    fingers = [(-0.36, -19.0, 0.72), (-0.12, -6.0, 0.98), (0.12, 6.0, 0.90), (0.36, 20.0, 0.66)]
    for x, lean, length in fingers:
        cones += _chain((x * 0.9, 0.0, 0.52), length, lean, (0.095, 0.088, 0.08, 0.07))
    thumb: list[Point] = [
        (0.20, 0.04, 0.05), (0.48, 0.12, 0.28), (0.66, 0.12, 0.52), (0.72, 0.08, 0.74),
    ]  # fmt: skip
    radii = (0.16, 0.12, 0.10, 0.08)
    cones += [(thumb[k], thumb[k + 1], radii[k], radii[k + 1]) for k in range(3)]
    low, high = np.array([-0.75, -0.42, -1.05]), np.array([0.92, 0.45, 1.68])
    flat = np.array([1.0, 1.25, 1.0])
    return implicit_shape(lambda p: blended(p * flat, cones, 0.035), low, high, resolution)


def _chain(start: Point, length: float, lean: float, radii: tuple[float, ...]) -> list[Cone]:
    """Joints of a finger that bends a little forward."""
    points, at = [start], np.array(start)
    for k, share in enumerate((0.45, 0.3, 0.25)):
        side, bend = np.radians(lean), np.radians(6.0 + 12.0 * k)
        at = at + length * share * np.array([np.sin(side), np.sin(bend), np.cos(side + bend)])
        points.append((float(at[0]), float(at[1]), float(at[2])))
    return [(points[k], points[k + 1], radii[k], radii[k + 1]) for k in range(3)]


def _tree(resolution: int) -> Shape:
    """Make a trunk that forks four times, with roots."""
    rng = np.random.default_rng(5)
    cones: list[Cone] = []
    grown = [(np.array([0.0, 0, 0]), np.array([0.05, 0.0, 1.0]), 1.1, 0.17, 0)]
    while grown:
        base, along, length, radius, order = grown.pop()
        end = base + length * along
        thin = max(0.74 * radius, 0.052)
        cones.append((_plain(base), _plain(end), radius, thin))
        if order < 4:
            across = np.cross(along, rng.normal(size=3))
            across /= np.linalg.norm(across)
            for sign in (-1, 1):
                lean = np.radians(rng.uniform(24, 40))
                turned = np.cos(lean) * along + sign * np.sin(lean) * across
                turned[2] += 0.08
                turned /= np.linalg.norm(turned)
                grown.append((end, turned, length * rng.uniform(0.68, 0.8), thin, order + 1))
    for turn in 2 * np.pi * (np.arange(5) + rng.uniform(-0.2, 0.2, 5)) / 5:
        toe = 0.55 * np.array([np.cos(turn), np.sin(turn), -0.25])
        cones.append((_plain(0.08 * toe), _plain(toe), 0.12, 0.06))
    ends = np.array([p for a, b, _, _ in cones for p in (a, b)])
    low, high = ends.min(axis=0) - 0.2, ends.max(axis=0) + 0.2
    return implicit_shape(lambda points: blended(points, cones, 0.025), low, high, resolution)


def _plain(point: FloatArray) -> Point:
    return float(point[0]), float(point[1]), float(point[2])


def _molecule(resolution: int) -> Shape:
    """Make toluene as balls and sticks: a ring of six, five hydrogens and a methyl group."""
    turn = np.radians(60 * np.arange(6))
    ring = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    atoms = [(p, 0.30) for p in 1.4 * ring] + [(p, 0.20) for p in 2.45 * ring[1:]]
    bonds = [(1.4 * ring[k], 1.4 * ring[k - 1]) for k in range(6)]
    bonds += [(1.4 * ring[k], 2.45 * ring[k]) for k in range(1, 6)]
    methyl = 2.9 * ring[0]
    atoms.append((methyl, 0.30))
    bonds.append((1.4 * ring[0], methyl))
    for angle in np.radians([90.0, 210.0, 330.0]):
        end = methyl + np.array([0.40, 0.98 * np.cos(angle), 0.98 * np.sin(angle)])
        atoms.append((end, 0.20))
        bonds.append((methyl, end))
    cones: list[Cone] = [(_plain(p), _plain(p + np.array([0, 0, 1e-3])), r, r) for p, r in atoms]
    cones += [(_plain(a), _plain(b), 0.11, 0.11) for a, b in bonds]
    low, high = np.array([-2.9, -2.6, -1.3]), np.array([3.7, 2.6, 1.3])
    return implicit_shape(lambda points: blended(points, cones, 0.04), low, high, resolution)


def _vase(resolution: int) -> Shape:
    """Turn a profile round the axis: a thin wall, thicker at the foot."""
    height = np.linspace(0.0, 2.0, resolution // 2)
    outer = 0.42 + 0.33 * np.sin(0.35 + 2.05 * height) * np.exp(-0.12 * height)
    wall = 0.045 + 0.05 * np.exp(-6 * height)
    rise = 0.09  # of the floor
    inside = height > rise
    bend = np.linspace(0, np.pi, 9)[1:-1]  # the lip is round
    middle, half = outer[-1] - wall[-1] / 2, wall[-1] / 2
    radii = [outer, middle + half * np.cos(bend), (outer - wall)[inside][::-1]]
    heights = [height, 2.0 + half * np.sin(bend), height[inside][::-1]]
    floor = float(radii[-1][-1]) * np.linspace(1, 0, resolution // 8)[1:-1]
    foot = float(outer[0]) * np.linspace(0, 1, resolution // 8)[1:-1]
    radius = np.concatenate([foot, *radii, floor])
    level = np.concatenate([0 * foot, *heights, np.full(len(floor), heights[-1][-1])])
    return turned(radius, level, around=resolution)


def turned(radius: FloatArray, level: FloatArray, around: int) -> Shape:
    """Mesh a surface of revolution between two points of its axis, z; outward where it rises."""
    turn = 2 * np.pi * np.arange(around) / around
    wide, high = radius[:, None], np.repeat(level[:, None], around, axis=1)
    rings = np.stack([wide * np.cos(turn), wide * np.sin(turn), high], axis=2)
    count = len(radius)
    points = np.concatenate([rings.reshape(-1, 3), [[0, 0, level[0]], [0, 0, level[-1]]]])
    place = np.arange(count * around).reshape(count, around)
    a, b = place[:-1], np.roll(place, -1, axis=1)[:-1]
    c, d = np.roll(place, -1, axis=1)[1:], place[1:]
    first, last = place[0], place[-1]
    faces = [
        np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2),
        np.stack([np.roll(first, -1), first, 0 * first + count * around], axis=1),
        np.stack([last, np.roll(last, -1), 0 * last + count * around + 1], axis=1),
    ]  # fmt: skip
    return make_shape(points, np.concatenate([part.reshape(-1, 3) for part in faces]))


def _gear(resolution: int) -> Shape:
    """Make a spur gear of 14 teeth with a bore: flat sides, sharp edges."""
    teeth, steps = 14, resolution // 16
    corners = np.array([[0.0, 1.0], [0.21, 1.0], [0.29, 0.80], [0.71, 0.80], [0.79, 1.0], [1, 1.0]])
    counts = [max(round(steps * w), 2) for w in (0.5, 0.7, 1.0, 0.7, 0.5)]
    sides = [np.linspace(0, 1, n, endpoint=False) + k for k, n in enumerate(counts)]
    share = np.concatenate(sides)
    place, size = (np.interp(share, range(6), corners[:, k]) for k in (0, 1))
    turn = (np.arange(teeth)[:, None] + place).ravel() * 2 * np.pi / teeth
    outline = np.stack([np.cos(turn), np.sin(turn)], axis=1) * np.tile(size, teeth)[:, None]
    bore = 0.28 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    rows = resolution // 9
    across = [outline + (bore - outline) * s for s in np.linspace(0, 1, rows + 1)]
    levels = np.linspace(-0.17, 0.17, resolution // 14 + 2)
    lift = [np.insert(outline, 2, z, axis=1) for z in levels[1:-1]]
    drop = [np.insert(bore, 2, z, axis=1) for z in levels[::-1][1:-1]]
    top = [np.insert(ring, 2, levels[-1], axis=1) for ring in across]
    bottom = [np.insert(ring, 2, levels[0], axis=1) for ring in across[::-1]]
    rings = np.stack([*lift, *top, *drop, *bottom])
    index = np.arange(rings.shape[0] * rings.shape[1]).reshape(rings.shape[:2])
    a, b = index, np.roll(index, -1, axis=1)
    c, d = np.roll(b, -1, axis=0), np.roll(a, -1, axis=0)
    faces = np.concatenate([np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)])
    return make_shape(rings.reshape(-1, 3), faces.reshape(-1, 3))


def _bracket(resolution: int) -> Shape:
    """Make an angle of two plates with a rib, rounded edges and three holes."""

    def distance(points: FloatArray) -> FloatArray:
        x, y, z = points.T
        base = _rounded_box(points, (0.9, 0.0, 0.1), (0.9, 0.6, 0.1))
        wall = _rounded_box(points, (0.1, 0.0, 0.7), (0.1, 0.6, 0.7))
        slope = (x / 1.45 + z / 1.15 - 1.0) / np.hypot(1 / 1.45, 1 / 1.15)
        rib = _rounded_box(points, (0.7, 0.0, 0.55), (0.7, 0.1, 0.55))
        rib = 0.02 * np.logaddexp(rib / 0.02, slope / 0.02)
        body = -0.04 * np.log(sum(np.exp(np.clip(-d / 0.04, -60, 60)) for d in (base, wall, rib)))
        holes = [np.hypot(x - 1.25, y - side) - 0.16 for side in (-0.33, 0.33)]
        holes.append(np.hypot(y, z - 1.14) - 0.15)
        for hole in holes:
            body = 0.02 * np.logaddexp(body / 0.02, -hole / 0.02)
        return body

    low, high = np.array([-0.1, -0.7, -0.1]), np.array([1.9, 0.7, 1.5])
    return implicit_shape(distance, low, high, resolution)


def _rounded_box(points: FloatArray, middle: Point, half: Point) -> FloatArray:
    """Return the signed distance to a box whose edges are round."""
    radius = 0.05
    away = np.abs(points - np.array(middle)) - (np.array(half) - radius)
    outside = np.linalg.norm(np.maximum(away, 0.0), axis=1)
    return outside + np.minimum(away.max(axis=1), 0.0) - radius


def _teeth(resolution: int) -> Shape:
    return dental_arch(resolution=min(max(resolution, 100), 500))[0]


def _scan(resolution: int) -> Shape:
    """Return noisy points of the creature, and some anywhere around it."""
    shape, rng = organic_shape(resolution), np.random.default_rng(0)
    low, high = shape.bounds
    points = shape.points + rng.normal(scale=NOISE * shape.diagonal, size=shape.points.shape)
    astray = rng.uniform(low, high, (int(OUTLIERS * len(points)), 3))
    return make_shape(np.concatenate([points, astray]))


NOISE, OUTLIERS = 0.002, 0.05
"""Of the scan: deviation as a part of the diagonal, and share of outliers."""

_MADE: dict[str, tuple[Callable[[int], Shape], str]] = {
    "creature": (organic_shape, "a creature with four legs, ears and a tail: for everything"),
    "hand": (_hand, "a hand with five fingers: curve skeletons, parts, armatures"),
    "tree": (_tree, "a tree with roots: curve skeletons that fork"),
    "molecule": (_molecule, "balls and sticks with a ring: curve skeletons, parts"),
    "vase": (_vase, "a vessel with a thin wall: thickness"),
    "gear": (_gear, "a gear with sharp edges and a hole: sheets, patches"),
    "bracket": (_bracket, "an angle with a rib and three holes: thickness, sheets"),
    "teeth": (_teeth, "a dental arch with 14 teeth: mean shift segments"),
    "scan": (
        _scan,
        "points of the creature as a scanner sees them, with noise and outliers: for clouds",
    ),
}
SAMPLES = {name: text for name, (_, text) in _MADE.items()}
"""What each sample shape is and what it is good for, by its name."""
