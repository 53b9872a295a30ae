"""Shapes of the accuracy suite: closed forms, CAD parts and organic ones with a known axis."""

from __future__ import annotations

import sys
from functools import cache, partial
from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull

import medialis
from accuracy_suite.cells import Cells
from accuracy_suite.envelopes import Canal, Function, Sheet, unit
from accuracy_suite.flat_prisms import flat_prism
from accuracy_suite.known import KnownShape, Truth, grid_mesh, made, mesh_of, sunflower
from accuracy_suite.sections import (
    Section,
    extruded_truth,
    lathe,
    revolved_truth,
    turned_out,
)

TESTS = Path(__file__).resolve().parents[2] / "tests"
if str(TESTS) not in sys.path:
    sys.path.append(str(TESTS))
import closed_forms as forms  # noqa: E402


@cache
def shapes() -> dict[str, KnownShape]:
    """All shapes by name."""
    every = [*_round_forms(), *_flat_prisms(), *_cad_parts(), *_organic_shapes()]
    return {one.name: one for one in every}


def _ball_mesh(longest: float, rng: np.random.Generator | None, axes: np.ndarray) -> medialis.Shape:
    """Make an icosphere, or the convex hull of random points, stretched."""
    edge = longest / axes.max()
    if rng is None:
        levels = max(1, int(np.ceil(np.log2(1.05 / edge))))
        sphere = forms.icosphere(levels)
        return mesh_of(sphere.points * axes, sphere.faces)
    count = int(np.ceil(4 * np.pi / (0.866 * (0.8 * edge) ** 2)))
    points = unit(rng.normal(size=(count, 3)))
    for _ in range(30):  # apart from each other a little, so that edges are of one length
        hull = ConvexHull(points)
        links = hull.simplices[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        total = np.zeros_like(points)
        np.add.at(total, links[:, 0], points[links[:, 1]])
        np.add.at(total, links[:, 1], points[links[:, 0]])
        points = unit(0.5 * points + 0.5 * unit(total))
    hull = ConvexHull(points)
    a, b, c = points[hull.simplices.T]
    outward = (np.cross(b - a, c - a) * a).sum(axis=1) > 0
    faces = np.where(outward[:, None], hull.simplices, hull.simplices[:, ::-1])
    return mesh_of(points * axes, faces)


def _ellipsoid_axis(axes: np.ndarray) -> Truth:
    """Return the ellipse of half axes (a^2 - c^2)/a, (b^2 - c^2)/b; see tests/closed_forms.py."""
    a, b, c = axes
    x, y = sunflower(20_000)
    # The ball of (a x, b y, z) has the radius c^2 |(x/a, y/b, z/c^2)|.
    height = np.maximum(0, 1 - x**2 - y**2) / c**2  # z^2 / c^4
    radii = c**2 * np.sqrt((x / a) ** 2 + (y / b) ** 2 + height)
    points = np.stack([x * (a - c**2 / a), y * (b - c**2 / b), 0 * x], axis=1)
    normals = np.repeat([[0, 0, 1.0]], len(x), axis=0)
    return Truth(points, radii, normals, np.full(len(x), 0.008))


def _round_forms() -> list[KnownShape]:
    """Sphere, ellipsoid and torus."""
    axes = np.array([1.0, 0.8, 0.5])
    ring = np.stack([np.cos(t := np.linspace(0, 2 * np.pi, 20_001)), np.sin(t), 0 * t], axis=1)

    def torus(longest: float, rng: np.random.Generator | None) -> medialis.Shape:
        def surface(u: np.ndarray, v: np.ndarray) -> np.ndarray:
            rho = 1 + 0.3 * np.cos(2 * np.pi * u)
            a, b = rho * np.cos(2 * np.pi * v), rho * np.sin(2 * np.pi * v)
            return np.stack([a, b, 0.3 * np.sin(2 * np.pi * u)], axis=1)

        count = int(np.ceil(2 * np.pi * 0.3 / longest))
        free, around = np.ones(count, bool), int(np.ceil(2 * np.pi * 1.3 / longest))
        rows = np.arange(count) / count
        return turned_out(grid_mesh(surface, rows, around, free=free, poles=False, rng=rng))

    return [
        KnownShape(
            "sphere", "closed form", lambda h, rng: _ball_mesh(h, rng, np.ones(3)),
            lambda: Truth.of_curve(np.zeros((1, 3)), np.ones(1)), 2.0, sheets=1,
        ),
        KnownShape(
            "ellipsoid", "closed form", lambda h, rng: _ball_mesh(h, rng, axes),
            lambda: _ellipsoid_axis(axes), 1.0, sheets=1,
        ),
        KnownShape(
            "torus", "closed form", torus, lambda: Truth.of_curve(ring, np.full(len(ring), 0.3)),
            0.6, sheets=1, loops=1, ends=0, curve=ring,
        ),
    ]  # fmt: skip


def _flat_prisms() -> list[KnownShape]:
    """Box, wedge, L, T, prism and a cylinder with flat ends, flat enough for a middle sheet."""
    box = [[-1.0, -0.75], [1.0, -0.75], [1.0, 0.75], [-1.0, 0.75]]
    hexagon = forms.disc_outline(1.0, 6)
    found = [
        flat_prism("box", box, 1.0),
        flat_prism("cube", [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]], 1.0),
        flat_prism("wedge", forms.TRIANGLE, 0.8),
        flat_prism("L", forms.L_OUTLINE, 0.8),
        flat_prism("T", forms.T_OUTLINE, 0.8),
        flat_prism("prism", hexagon, 0.8),
        flat_prism("slab", [[0, 0], [1.2, 0], [1.2, 0.9], [0, 0.9]], 0.1),
    ]
    half = Section.of_loops([[0, -0.5], [1, -0.5], [1, 0.5], [0, 0.5]])
    cylinder = KnownShape(
        "cylinder", "closed form",
        lambda h, rng: lathe(np.array([[0, -0.5], [1, -0.5], [1, 0.5], [0, 0.5]]), h, rng, False),
        lambda: revolved_truth(half), 1.0, sheets=3,
        areas=np.sort([np.pi / 4, *2 * [np.sqrt(2) * np.pi * 0.75]]), y_length=np.pi,
    )  # fmt: skip
    return [*found, cylinder]


def _extruded(name: str, cells: Cells, height: float, across: float, **known: object) -> KnownShape:
    return KnownShape(
        name, "CAD", lambda h, rng: made(partial(cells.solid, height), h, rng),
        lambda: extruded_truth(cells.section(), height), across, coarse=True, **known,
    )  # fmt: skip


def _revolved(name: str, profile: list, across: float, **known: object) -> KnownShape:
    """Make a solid of revolution of a closed half section, touching the axis or not."""
    points = np.array(profile, float)
    closed = points[:, 0].min() > 0
    return KnownShape(
        name, "CAD", lambda h, rng: lathe(points, h, rng, closed),
        lambda: revolved_truth(Section.of_loops(points)), across, **known,
    )  # fmt: skip


def _on_plane(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Points of all combinations of three rows."""
    return np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).reshape(-1, 3)


def _cad_parts() -> list[KnownShape]:
    """Bracket, I-beam, ribbed and perforated plates, tubes, rings, shafts."""
    bracket = Cells.of_rows([0, 0.1, 1.2], [0, 0.16, 1.0], ["#.", "##"])
    leg = _on_plane(np.array([0.0, 0.1]), np.linspace(0.16, 1.0, 85), np.linspace(-0.3, 0.3, 61))
    i_beam = Cells.of_rows([0, 0.34, 0.46, 0.8], [0, 0.16, 0.84, 1.0], ["###", ".#.", "###"])
    web = _on_plane(np.array([0.34, 0.46]), np.linspace(0.16, 0.84, 69), np.linspace(-1, 1, 201))
    ribbed = Cells.of_rows([0, 0.1, 0.4, 0.5, 0.8, 0.9], [0, 0.12, 0.5], ["#.#.#", "#####"])
    plate = Cells.of_rows(
        [0, 0.3, 0.6, 0.9, 1.2, 1.5], [0, 0.3, 0.6, 0.9],
        ["#####", "#.#.#", "#####"],
    )  # fmt: skip
    channel = Cells.of_rows([0, 0.12, 0.7, 0.82], [0, 0.14, 0.6], ["#.#", "###"])
    turn = np.linspace(0, 2 * np.pi, 721)
    neck = np.concatenate(
        [np.column_stack([0.2 * np.cos(turn), 0.2 * np.sin(turn), np.full(721, z)])
         for z in np.linspace(-0.3, 0.3, 61)]
    )  # fmt: skip
    return [
        _extruded("bracket", bracket, 0.6, 0.1, thinnest=(0.1, leg)),
        _extruded("I-beam", i_beam, 2.0, 0.12, thinnest=(0.12, web)),
        _extruded("ribbed plate", ribbed, 0.8, 0.1),
        _extruded("plate with holes", plate, 0.15, 0.15, loops=2),
        _extruded("channel", channel, 1.2, 0.12),
        _revolved(
            "tube", [[0.4, -0.6], [0.5, -0.6], [0.5, 0.6], [0.4, 0.6]], 0.1, loops=1,
        ),
        _revolved(
            "ring", [[0.7, -0.15], [1.0, -0.15], [1.0, 0.15], [0.7, 0.15]], 0.3,
            loops=1, ends=0,
            curve=np.column_stack([0.85 * np.cos(turn), 0.85 * np.sin(turn), 0 * turn]),
        ),
        _revolved(
            "shaft",
            [[0, -1], [0.4, -1], [0.4, -0.3], [0.2, -0.3],
             [0.2, 0.3], [0.4, 0.3], [0.4, 1], [0, 1]],
            0.4, loops=0, ends=2, thinnest=(0.4, neck),
        ),
    ]  # fmt: skip


def _canal(name: str, canal: Canal, across: float, **known: object) -> KnownShape:
    t = np.linspace(0, 1, 8001)
    return KnownShape(
        name, "organic", canal.mesh, canal.truth, across, curve=canal.curve(t),
        loops=int(canal.closed), ends=0 if canal.closed else 2, **known,
    )  # fmt: skip


def _organic_shapes() -> list[KnownShape]:
    """Canals along curves and sheets with rounded rims."""
    two_pi = 2 * np.pi

    def helix(t: np.ndarray) -> np.ndarray:
        a = 3 * np.pi * t
        return np.stack([np.cos(a), np.sin(a), 1.6 * t], axis=1)

    def knot(t: np.ndarray) -> np.ndarray:
        a = two_pi * t
        rho = 2 + np.cos(3 * a)
        return np.stack([rho * np.cos(2 * a), rho * np.sin(2 * a), 1.2 * np.sin(3 * a)], axis=1)

    def snake(t: np.ndarray) -> np.ndarray:
        return np.stack([4 * t, 0.5 * np.sin(two_pi * t), 0.3 * np.cos(3 * t)], axis=1)

    def bar(t: np.ndarray) -> np.ndarray:
        return np.stack([2 * t - 1, 0 * t, 0 * t], axis=1)

    def oval(t: np.ndarray) -> np.ndarray:
        a = two_pi * t
        return np.stack([1.3 * np.cos(a), np.sin(a), 0.2 * np.sin(2 * a)], axis=1)

    def pinched(wide: float, narrow: float, at: float, width: float) -> Function:
        """Radii with one minimum, steep enough to be told from its surroundings by one sample."""
        return lambda t: wide - (wide - narrow) * np.exp(-(((t - at) / width) ** 2))

    canals = {
        "tentacle": Canal(helix, pinched(0.2, 0.15, 0.6, 0.018)),
        "knot": Canal(knot, pinched(0.3, 0.24, 0.3, 0.01), closed=True),
        "snake": Canal(snake, lambda t: 0.2 + 0.07 * np.cos(2 * two_pi * t + 0.6)),
        "hourglass": Canal(bar, pinched(0.3, 0.12, 0.45, 0.15)),
        "capsule": Canal(bar, lambda t: 0.3 + 0 * t),
        "bead ring": Canal(oval, pinched(0.25, 0.19, 0.4, 0.025), closed=True),
    }
    across = {
        "tentacle": 0.3, "knot": 0.48, "snake": 0.26, "hourglass": 0.24, "capsule": 0.6,
        "bead ring": 0.38,
    }  # fmt: skip
    found = []
    for name, canal in canals.items():
        thin = None if name == "capsule" else canal.thinnest()
        found.append(_canal(name, canal, across[name], thinnest=thin))
    return found + _sheet_shapes()


def _sheet_shapes() -> list[KnownShape]:
    """Make a leaf, a bowl and a band that is turned by half a turn."""

    def leaf(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.stack([x, 0.45 * y, 0.25 * x**2 - 0.15 * y**2], axis=1)

    def leaf_radius(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return 0.1 - 0.04 * (x**2 + y**2) + 0.02 * x

    def bowl(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.stack([x, y, 0.5 * (x**2 + y**2)], axis=1)

    def bowl_radius(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return 0.1 - 0.035 * np.exp(-((x - 0.35) ** 2 + (y + 0.1) ** 2) / 0.08)

    def band(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        turn = 2 * np.pi * y
        rho = 1 + 0.3 * x * np.cos(turn / 2)
        return np.stack(
            [rho * np.cos(turn), rho * np.sin(turn), 0.3 * x * np.sin(turn / 2)], axis=1
        )

    def band_radius(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return 0.08 - 0.025 * np.exp(-((((y - 0.2) % 1.0 - 0.5) / 0.018) ** 2)) + 0.0 * x

    sheets = {
        "leaf": (Sheet(leaf, leaf_radius), 0.12),
        "bowl": (Sheet(bowl, bowl_radius), 0.13),
        "twisted band": (Sheet(band, band_radius, band=True, twisted=True), 0.11),
    }
    found = []
    for name, (sheet, across) in sheets.items():
        thin = None if name == "leaf" else sheet.thinnest()  # that of the leaf is a tip
        loops = int(sheet.band)
        found.append(
            KnownShape(
                name, "organic", sheet.mesh, sheet.truth, across, sheets=1, loops=loops,
                thinnest=thin,
            )
        )  # fmt: skip
    return found
