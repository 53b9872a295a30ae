"""Shapes whose sizes in millimetres are known, and what operations should tell of them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

import medialis
from medialis.shape.generate import blended, implicit_shape

Numbers = Mapping[str, tuple[float, float]]
"""Truths by the name of a value: what it is, and by what share it may be off."""


@dataclass(frozen=True)
class Known:
    """A shape of known size.

    Attributes
    ----------
    name : str
    make : callable
        Gives the shape, in millimetres.
    runs : dict of tuple of str
        Operations by their commands, and what is typed behind the file.
    truths : dict of dict
        What values of an operation are, with the share by which they may be off.
    size : (float, float, float) or None
        Sides of the box round it, sorted; None: not known.
    """

    name: str
    make: Callable[[], medialis.Shape]
    runs: Mapping[str, Sequence[str]]
    truths: Mapping[str, Numbers] = field(default_factory=dict)
    size: tuple[float, float, float] | None = None


def cells(planes: Sequence[Sequence[float]], filled: Callable[..., bool]) -> medialis.Shape:
    """Mesh the cells of a grid that are filled; `planes` are the three lists of its coordinates."""
    counts = [len(row) - 1 for row in planes]
    inside = {cell for cell in itertools.product(*map(range, counts)) if filled(*cell)}
    number: dict[tuple[int, ...], int] = {}
    faces = []
    for cell, axis, end in itertools.product(sorted(inside), range(3), (0, 1)):
        beside = tuple(c + (2 * end - 1) * (k == axis) for k, c in enumerate(cell))
        if beside in inside:
            continue
        one, other = (axis + 1) % 3, (axis + 2) % 3
        corners = []
        for a, b in ((0, 0), (1, 0), (1, 1), (0, 1)):
            corner = list(cell)
            corner[axis] += end
            corner[one] += a
            corner[other] += b
            corners.append(number.setdefault(tuple(corner), len(number)))
        p, q, r, s = corners if end else corners[::-1]
        faces += [(p, q, r), (p, r, s)]
    points = [[planes[k][c] for k, c in enumerate(corner)] for corner in number]
    return medialis.make_shape(np.array(points), np.array(faces), unit="mm")


def box() -> medialis.Shape:
    """Make a box of 40 x 30 x 20."""
    return cells(([0, 40], [0, 30], [0, 20]), lambda *cell: True)


def bracket() -> medialis.Shape:
    """Make a base of 4 with walls of 2 and 0.8 that stand on it."""
    xs, ys = [0.0, 2.0, 30.0, 30.8, 40.0], [0.0, 4.0, 24.0, 30.0]
    walls = {(0, 1), (0, 2), (2, 1)}
    return cells((xs, ys, [0.0, 25.0]), lambda i, j, k: j == 0 or (i, j) in walls)


def plate() -> medialis.Shape:
    """Make a plate of 60 x 40 x 3 with two square holes of 8."""
    xs, ys = [0, 10, 18, 42, 50, 60], [0, 16, 24, 40]
    holes = {(1, 1), (3, 1)}
    return cells((xs, ys, [0, 3]), lambda i, j, k: (i, j) not in holes)


def rods(
    *limbs: tuple[Sequence[float], Sequence[float], float], cells: int = 100
) -> Callable[[], medialis.Shape]:
    """Return what makes a union of capsules (start, end, radius), a little rounded where they meet.

    Away from where they meet the surface is that of the capsules.
    """
    cones = [(start, end, radius, radius) for start, end, radius in limbs]
    soft = 0.1 * min(radius for *_, radius in limbs)

    def distance(places: np.ndarray) -> np.ndarray:
        return blended(places, cones, soft)

    def make() -> medialis.Shape:
        ends = np.array([place for limb in limbs for place in limb[:2]], float)
        most = 1.3 * max(radius for *_, radius in limbs)
        made = implicit_shape(distance, ends.min(axis=0) - most, ends.max(axis=0) + most, cells)
        return medialis.make_shape(made.points, made.faces, unit="mm")

    return make


def fork(
    angle: float = 60.0, length: float = 40.0, cells: int = 100
) -> Callable[[], medialis.Shape]:
    """Return what makes a stem of radius 4 with two arms of radius 3 at an angle in degrees."""
    half = math.radians(angle / 2)
    arms = [(s * length * math.sin(half), length * math.cos(half), 0.0) for s in (-1, 1)]
    start = (0.0, 0.0, 0.0)
    return rods(
        ((0.0, -length, 0.0), start, 4.0), *((start, arm, 3.0) for arm in arms), cells=cells
    )


def sample(name: str, size: float) -> Callable[[], medialis.Shape]:
    """Return what makes a sample whose diagonal is `size` millimetres."""

    def make() -> medialis.Shape:
        made = medialis.sample_shape(name, 80)
        return medialis.make_shape(made.points * (size / made.diagonal), made.faces, unit="mm")

    return make


EXACT, CLOSE, NEAR = 1e-6, 0.01, 0.05
"""Shares: closed forms of flat walls; of rounded ones that are sampled; of curve skeletons, whose
limbs are blended where they meet."""

TWO: dict[str, Sequence[str]] = {"thickness": (), "wall-check": ()}
GRAPH: dict[str, Sequence[str]] = {"curve-skeleton": ("--formats", "swc,graphml,json,obj")}
BALLS: dict[str, Sequence[str]] = {"surface-skeleton": ()}
FEW: dict[str, Sequence[str]] = {"medial-mesh": ("--balls", "12")}

LIMITS = ("--minimum", "1mm", "--maximum", "3.5mm")

SHAPES = (
    Known(
        "box", box, {**TWO, **BALLS, **FEW, "skeleton-mesh": ()},
        {"thickness": {"wall_thickness_min": (20, EXACT), "thickness_max": (20, EXACT)},
         "wall_check": {"typical": (20, EXACT)},
         "medial_mesh": {"balls": (12, 0), "sheets": (13, 0)}},
        size=(20, 30, 40),
    ),
    Known(
        "bracket", bracket,
        {"thickness": ("--threshold", "1mm"), "wall-check": LIMITS, "midsurface": (), "parts": ()},
        {"thickness": {"wall_thickness_min": (0.8, EXACT), "thin_spots": (1, 0)},
         "wall_check": {"minimum": (1, EXACT), "maximum": (3.5, EXACT), "too_thin": (1, 0),
                        "too_thick": (1, 0), "checked_thickness_min": (0.8, EXACT)},
         "midsurface": {"thickness_min": (0.8, EXACT), "thickness_max": (4, EXACT)}},
        size=(25, 30, 40),
    ),
    Known(
        "plate", plate, {**TWO, "midsurface": ()},
        {"thickness": {"wall_thickness_min": (3, EXACT), "thickness_max": (3, EXACT)},
         "wall_check": {"typical": (3, EXACT), "minimum": (1.5, EXACT)},
         "midsurface": {"thickness_median": (3, EXACT)}},
        size=(3, 40, 60),
    ),
    Known(
        "ball", rods(((0, 0, 0), (1e-6, 0, 0), 10.0)), {**TWO, **BALLS},
        {"thickness": {"wall_thickness_min": (20, CLOSE), "thickness_max": (20, CLOSE)},
         "surface_skeleton": {"radius_median": (10, CLOSE)}},
        size=(20, 20, 20),
    ),
    Known(
        "tube", rods(((-40, 0, 0), (40, 0, 0), 5.0), ((0, 0, 0), (0, 30, 0), 3.0)),
        {**TWO, **GRAPH, "view-curve-skeleton": (), "armature": ()},
        {"thickness": {"wall_thickness_min": (6, CLOSE)},
         "curve_skeleton": {"length": (110, NEAR), "branches": (3, 0), "loops": (0, 0)}},
        size=(10, 38, 90),
    ),
    Known(
        "fork", fork(), {**GRAPH, "parts": ()},
        {"curve_skeleton": {"length": (120, NEAR), "branches": (3, 0), "junctions": (1, 0),
                            "branch_table[1].mean_radius": (4, NEAR),
                            "branch_table[0].fork_angle": (math.radians(60), NEAR),
                            "branch_table[1].fork_angle": (math.radians(150), NEAR)}},
    ),
    Known("figure", sample("creature", 180.0), {**TWO, **GRAPH, **BALLS, "parts": ()}),
    Known("hand", sample("hand", 200.0), {**TWO, **GRAPH, "armature": (), "medial-mesh": ()}),
    Known("gear", sample("gear", 60.0), {**TWO, "patches": (), "medial-sheets": ()}),
    Known("vase", sample("vase", 300.0), {"thickness": ("--threshold", "3mm"), "midsurface": ()}),
)  # fmt: skip
"""Ten of them."""


def chosen(names: Sequence[str]) -> Iterator[Known]:
    """Yield the shapes of these names, or all."""
    return (one for one in SHAPES if not names or one.name in names)
