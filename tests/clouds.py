"""Generated clouds with known manifolds, outliers, jitter, and measures of agreement."""

import math

import numpy as np

from closed_forms import unit


def plane(n, rng, angle=0.0):
    """The square -1..1, turned about x by an angle in degrees."""
    u, v, a = rng.uniform(-1, 1, n), rng.uniform(-1, 1, n), math.radians(angle)
    return np.stack([u, v * math.cos(a), v * math.sin(a)], axis=1)


def crossing_planes(angle, n=4000, seed=0):
    """Two planes and which is which."""
    rng = np.random.default_rng(seed)
    return np.concatenate([plane(n, rng), plane(n, rng, angle)]), np.repeat([0, 1], n)


def three_planes(n=4000, seed=0):
    """Three coordinate planes."""
    rng = np.random.default_rng(seed)
    parts = [plane(n, rng)[:, order] for order in ([0, 1, 2], [2, 0, 1], [1, 2, 0])]
    return np.concatenate(parts), np.repeat([0, 1, 2], n)


def sphere_and_plane(n=4000, seed=0):
    """The unit sphere, cut by a plane."""
    rng = np.random.default_rng(seed)
    cut = 1.6 * plane(n, rng) + [0, 0, 0.2]
    return np.concatenate([unit(rng.normal(size=(n, 3))), cut]), np.repeat([0, 1], n)


def spiral_and_plane(n=6000, seed=0):
    """A spiral band of three half turns, cut by a plane (thesis Figure 4.4 e)."""
    rng = np.random.default_rng(seed)
    turn = np.sqrt(rng.uniform(math.pi**2, (4 * math.pi) ** 2, n))
    radius = turn / (4 * math.pi)
    band = np.stack([radius * np.cos(turn), radius * np.sin(turn), rng.uniform(-0.5, 0.5, n)], 1)
    return np.concatenate([band, 1.1 * plane(n // 2, rng)]), np.repeat([0, 1], [n, n // 2])


def parallel_sheets(n=3000, gap=0.15, seed=0):
    """Three parallel squares."""
    rng = np.random.default_rng(seed)
    return np.concatenate([plane(n, rng) + np.array([0, 0, gap * i]) for i in range(3)]), np.repeat(
        [0, 1, 2], n
    )


def mobius_band(n=5000, seed=0):
    """One manifold that cannot be oriented."""
    rng = np.random.default_rng(seed)
    u, v = rng.uniform(0, 2 * math.pi, n), rng.uniform(-0.35, 0.35, n)
    ring = 1 + v * np.cos(u / 2)
    points = np.stack([ring * np.cos(u), ring * np.sin(u), v * np.sin(u / 2)], axis=1)
    return points, np.zeros(n, int)


ROOM = np.array([6.0, 5.0, 2.8])
BOXES = (((4.2, 3.2, 0.0), (5.6, 4.4, 0.75)), ((0.2, 4.2, 0.0), (1.4, 4.8, 2.0)))


def laser_room(step, noise, at=(1.8, 3.3, 1.7), seed=0):
    """A room of 6 x 5 x 2.8 m with two boxes as a laser scanner sees it, and which face is which.

    Beams are `step` degrees apart both ways, but not right below the scanner; ranges have errors of
    the deviation `noise`. Points are 2 mm to 0.2 m apart.
    """
    turn, up = np.meshgrid(
        np.radians(np.arange(0, 360, step)), np.radians(np.arange(-70, 90, step)), indexing="ij"
    )
    beam = np.stack([np.cos(up) * np.cos(turn), np.cos(up) * np.sin(turn), np.sin(up)], axis=-1)
    beam, at = beam.reshape(-1, 3) + 1e-12, np.array(at)
    ends = np.maximum(-at / beam, (ROOM - at) / beam)
    reach, side = ends.min(axis=1), ends.argmin(axis=1)
    face = 2 * side + (beam[np.arange(len(beam)), side] > 0)
    for number, (low, high) in enumerate(BOXES, 1):
        a, b = (low - at) / beam, (high - at) / beam
        enter, leave = np.minimum(a, b), np.maximum(a, b).min(axis=1)
        side, into = enter.argmax(axis=1), enter.max(axis=1)
        hit = (into < leave) & (into > 0) & (into < reach)
        face = np.where(hit, 6 * number + side, face)
        reach = np.where(hit, into, reach)
    reach = reach + noise * np.random.default_rng(seed).normal(size=len(reach))
    return at + beam * reach[:, None], np.unique(face, return_inverse=True)[1]


def clean_clouds(seed=0):
    """Clouds without noise: dense, small, coarse, graded, cut and scanned ones, by name."""
    rng = np.random.default_rng(seed)

    def sphere(n, radius=1.0):
        return radius * unit(rng.normal(size=(n, 3)))

    def even(n):
        i = np.arange(n) + 0.5
        z, turn = 1 - 2 * i / n, i * math.pi * (3 - math.sqrt(5))
        return np.stack([np.cos(turn), np.sin(turn), 0 * z], 1) * np.sqrt(1 - z * z)[:, None] + z[
            :, None
        ] * [0, 0, 1]

    graded = sphere(60000)
    graded = graded[rng.random(60000) < np.exp(3 * (graded[:, 2] - 1))]
    holed = sphere(8000)
    for middle in sphere(12):
        holed = holed[np.linalg.norm(holed - middle, axis=1) > 0.2]
    square = [rng.uniform(0, 1, (1000, 2)) for _ in range(6)]
    cube = [np.insert(uv, side % 3, side // 3, axis=1) for side, uv in enumerate(square)]
    dense = np.array([1.3, 0, 0]) + sphere(8000, 0.05)
    small = [0.05 * even(400) + at for at in rng.uniform(0, 2, (30, 3))]
    return {
        "coarse sphere": sphere(200),
        "sphere": sphere(3000),
        "dense sphere": sphere(30000),
        "sphere, evenly sampled": even(20000),
        "small dense sphere beside a coarse one": np.concatenate([sphere(3000), dense]),
        "30 small spheres": np.concatenate(small),
        "sphere, 20 times denser on one side": graded,
        "sphere with 12 holes": holed,
        "half a sphere": holed[holed[:, 2] > 0],
        "cube": np.concatenate(cube),
        "laser room, 2 degrees": laser_room(2.0, 0.0)[0],
        "laser room, 1 degree": laser_room(1.0, 0.0)[0],
        "laser room, 2 degrees, 2.5 mm": laser_room(2.0, 0.0025)[0],
        "laser room, 1 degree, 1 cm": laser_room(1.0, 0.01)[0],
    }


def with_outliers(points, share, seed=1):
    """Thesis 4.2.4.2: an outlier for a share of the points, up to 40 % of the size away."""
    rng = np.random.default_rng(seed)
    count = round(share * len(points))
    base = points[rng.choice(len(points), count, replace=False)]
    size = np.linalg.norm(np.ptp(points, axis=0))
    away = 0.4 * size * rng.uniform(0, 1, (count, 1)) * unit(rng.normal(size=(count, 3)))
    return np.concatenate([points, base + away])


def jittered(points, share, seed=2):
    """Moved by at most `share` of the size, uniformly within a ball."""
    rng = np.random.default_rng(seed)
    length = share * np.linalg.norm(np.ptp(points, axis=0))
    radius = rng.uniform(0, 1, (len(points), 1)) ** (1 / 3)
    return points + length * radius * unit(rng.normal(size=points.shape))


def adjusted_rand(a, b):
    """Adjusted Rand index (Hubert and Arabie 1985) of two labellings; 1 when they agree."""
    a, b = (np.unique(x, return_inverse=True)[1].reshape(-1) for x in (a, b))
    table = np.zeros((a.max() + 1, b.max() + 1))
    np.add.at(table, (a, b), 1)

    def pairs(counts):
        return (counts * (counts - 1) / 2).sum()

    both, left, right = pairs(table), pairs(table.sum(1)), pairs(table.sum(0))
    expected = left * right / pairs(np.array([len(a)]))
    largest = (left + right) / 2
    return 1.0 if largest == expected else (both - expected) / (largest - expected)


def noise_scores(labels, clean):
    """Recall and precision of the label -1 against the points after the first `clean`."""
    found, true = labels < 0, np.arange(len(labels)) >= clean
    hit = (found & true).sum()
    return hit / max(true.sum(), 1), hit / max(found.sum(), 1)
