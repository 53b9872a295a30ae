"""Outliers and noise of scans with known surfaces, beside what other programs do.

    python benchmarks/scans.py                     # 20,000 points; two minutes
    python benchmarks/scans.py --points 200000     # twelve minutes

A sphere, a square and a torus with no noise, 0.3 and 1 % of the diagonal (standard deviation along
each axis). Two tables in Markdown: `remove_outliers` with 20 outliers to 100 points, anywhere in
the box and a tenth of the diagonal round it, beside statistical and radius removal as Open3D
defines them; and `smooth` without outliers, beside a quadric through 30 neighbours (moving least
squares). Outliers may lie on the surface by chance: in the last column are those more than three
deviations off the true surface.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np
from scipy.spatial import cKDTree

import medialis

NOISES = (0.0, 0.003, 0.01)
OUTLIERS = 0.2
TUBE = 0.35
"""Radius of the tube of the torus, whose circle has the radius 1."""


def sphere(count: int, rng: np.random.Generator) -> np.ndarray:
    """Return points on a sphere of radius 1."""
    points = rng.normal(size=(count, 3))
    return np.asarray(points / np.linalg.norm(points, axis=1, keepdims=True))


def square(count: int, rng: np.random.Generator) -> np.ndarray:
    """Return points on a square in the plane z = 0."""
    return np.column_stack([rng.uniform(-1, 1, (count, 2)), np.zeros(count)])


def torus(count: int, rng: np.random.Generator) -> np.ndarray:
    """Return points spread evenly on a torus."""
    round_it, across, lot = rng.uniform(0, 1, (3, 3 * count))
    far = 1 + TUBE * np.cos(2 * np.pi * across)
    turn, across = 2 * np.pi * np.stack([round_it, across])[:, lot * (1 + TUBE) < far][:, :count]
    far = 1 + TUBE * np.cos(across)
    return np.column_stack([far * np.cos(turn), far * np.sin(turn), TUBE * np.sin(across)])


SURFACES: dict[str, tuple[Callable[..., np.ndarray], Callable[[np.ndarray], np.ndarray]]] = {
    "sphere": (sphere, lambda p: np.linalg.norm(p, axis=1) - 1),
    "square": (square, lambda p: p[:, 2]),
    "torus": (torus, lambda p: np.hypot(np.hypot(p[:, 0], p[:, 1]) - 1, p[:, 2]) - TUBE),
}
"""Points on a surface, and how far a point lies off it."""


def statistical(points: np.ndarray) -> np.ndarray:
    """Tell outliers: the mean distance to 20 neighbours is above the usual by two deviations."""
    far = cKDTree(points).query(points, k=21)[0][:, 1:].mean(axis=1)
    return np.asarray(far > far.mean() + 2 * far.std())


def within_radius(points: np.ndarray) -> np.ndarray:
    """Tell outliers: fewer than 6 others lie within four times the usual distance of neighbours."""
    tree = cKDTree(points)
    usual = np.median(tree.query(points, k=2)[0][:, 1])
    return np.asarray(tree.query_ball_point(points, 4 * usual, return_length=True) < 7)


def on_neighbours(points: np.ndarray) -> np.ndarray:
    """Move each point onto the quadric through its 30 neighbours (plain moving least squares)."""
    moved = np.empty_like(points)
    tree = cKDTree(points)
    for some in np.array_split(np.arange(len(points)), max(1, len(points) // 5000)):
        near = points[tree.query(points[some], k=31)[1]]
        spokes = near - near.mean(axis=1, keepdims=True)
        axes = np.linalg.eigh(np.einsum("rki,rkj->rij", spokes, spokes))[1]
        w, v, u = np.moveaxis(np.einsum("rki,rij->rkj", near - points[some, None], axes), 2, 0)
        terms = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=2)
        height = np.einsum("rk,rk->r", np.linalg.pinv(terms)[:, 0], w)
        moved[some] = points[some] + height[:, None] * axes[:, :, 0]
    return moved


def scores(gone: np.ndarray, bad: np.ndarray) -> str:
    """Return precision, recall and the share of good points that are lost, as cells."""
    hit = (gone & bad).sum()
    lost = 100 * (gone & ~bad).sum() / (~bad).sum()
    return f"{hit / max(gone.sum(), 1):.3f} / {hit / bad.sum():.3f} / {lost:.2f}"


def scan(name: str, count: int, noise: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Return a scan, a cloud of outliers, and the standard deviation of the noise."""
    rng = np.random.default_rng(0)
    points = SURFACES[name][0](count, rng)
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    rough = points + noise * size * rng.normal(size=points.shape)
    low, high = rough.min(axis=0) - 0.1 * size, rough.max(axis=0) + 0.1 * size
    return rough, rng.uniform(low, high, (round(OUTLIERS * count), 3)), noise * size


def print_outliers(count: int, names: list[str]) -> None:
    """Print precision, recall and losses of three ways to remove outliers."""
    print(
        "\n| scan | noise | remove_outliers | seconds | statistical | radius | known surface |\n"
        "|---|---|---|---|---|---|---|"
    )
    for name in names:
        for noise in NOISES:
            points, outliers, deviation = scan(name, count, noise)
            cloud = np.concatenate([points, outliers])
            bad = np.arange(len(cloud)) >= count
            clock = time.process_time()
            result = medialis.run("remove_outliers", medialis.make_shape(cloud))
            seconds = time.process_time() - clock
            off = np.abs(SURFACES[name][1](cloud)) > max(3 * deviation, 1e-9)
            known = scores(off, bad)
            others = f"{scores(statistical(cloud), bad)} | {scores(within_radius(cloud), bad)}"
            ours = scores(~result.arrays["kept"], bad)
            told = f"| {count:,} on a {name} | {100 * noise:g} % | {ours} | {seconds:.1f}"
            print(f"{told} | {others} | {known} |", flush=True)


def print_smooth(count: int, names: list[str]) -> None:
    """Print which share of the noise is left, and how far the surface has shrunk."""
    print(
        "\n| scan | noise | left by smooth | inwards | seconds | by 30 neighbours | inwards |\n"
        "|---|---|---|---|---|---|---|"
    )
    for name in names:
        for noise in NOISES[1:]:
            points, _, deviation = scan(name, count, noise)
            off = SURFACES[name][1]
            before = np.sqrt(np.mean(off(points) ** 2))
            clock = time.process_time()
            moved = medialis.run("smooth", medialis.make_shape(points)).layers[0].points
            seconds = time.process_time() - clock
            cells = []
            for after in (moved, on_neighbours(points)):
                left = np.sqrt(np.mean(off(after) ** 2)) / before
                cells.append(f"{left:.2f} | {-off(after).mean() / deviation:+.2f}")
            told = f"| {count:,} on a {name} | {100 * noise:g} % | {cells[0]} | {seconds:.1f}"
            print(f"{told} | {cells[1]} |", flush=True)


def main() -> None:
    """Print both tables for scans of so many points."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", choices=[*SURFACES, []], default=[])
    parser.add_argument("--points", type=int, default=20_000)
    given = parser.parse_args()
    names = given.names or [*SURFACES]
    print_outliers(given.points, names)
    print_smooth(given.points, names)


if __name__ == "__main__":
    main()
