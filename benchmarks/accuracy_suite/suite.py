"""All rows of the accuracy table: what is measured of which mesh of which shape."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache, partial
from pathlib import Path

import numpy as np

import medialis
from accuracy_suite.axis_distances import sheet_row, skeleton_row, union_row
from accuracy_suite.catalogue import shapes
from accuracy_suite.curve_graphs import curve_row, part_row, patch_row
from accuracy_suite.known import KnownShape
from accuracy_suite.networks import bodies, networks
from accuracy_suite.poke_out import poke_out
from accuracy_suite.sections import lathe
from accuracy_suite.walls import ray_row, thin_row, truth_row

Row = dict[str, float]
REAL = Path(__file__).resolve().parents[3] / "shared" / "shapes"
"""Real meshes, which are no part of the repository; without them their rows are left out."""

MOST_VERTICES = 60_000
FINE = 0.005
"""Fraction of the diagonal: longest edge for the union of balls."""

UNCROSSED = (
    *("fertility", "fandisk", "screwdriver", "hand", "rockerarm", "scapula", "elephant"),
    *("armadillo", "igea"),
)
"""Closed real meshes without faces that cross."""

UNIONS = ("horse", "fertility", "fandisk", "rockerarm")
FLAT = ("box", "cube", "wedge", "L", "T", "prism", "slab", "cylinder")
PLANE = ("box", "wedge", "L", "T", "prism", "bracket", "I-beam")
WALLS = {"slab": 1.2, "tube": 1.2, "bracket": 1.0, "I-beam": 2.0}
"""Length of a wall of shapes with opposite parallel walls."""


def random() -> np.random.Generator:
    """Return the same numbers for every mesh, whichever rows are computed."""
    return np.random.default_rng(16)


@cache
def mesh(name: str, across: float, irregular: bool) -> medialis.Shape:
    """Mesh a shape with so many samples across its smallest thickness."""
    known = every_shape()[name]
    return known.make(known.across / across, random() if irregular else None)


@cache
def every_shape() -> dict[str, KnownShape]:
    """Shapes with a known axis, then networks."""
    return {**shapes(), **networks()}


def axis_rows() -> Iterator[tuple[str, Callable[[], Row]]]:
    """Skeleton against truth: as drawn at the defaults, else on the samples of the mesh alone."""
    for name, known in shapes().items():
        if known.coarse:
            yield (
                f"{name}, as drawn",
                lambda known=known: skeleton_row(known.make(np.inf, None), known.truth(), 0.02),
            )
        for across, irregular in ((4, False), (4, True), (8, False), (8, True)):
            title = f"{name}, {across} across" + irregular * ", irregular"

            def row(name: str = name, across: int = across, irregular: bool = irregular) -> Row:
                shape = mesh(name, across, irregular)
                if shape.point_count > MOST_VERTICES:
                    return {}
                return skeleton_row(shape, shapes()[name].truth(), 0.0)

            yield title, row


def poke_out_rows() -> Iterator[tuple[str, Callable[[], Row]]]:
    """Poke-out of real meshes at the defaults."""

    def row(name: str) -> Row:
        found = poke_out(medialis.surface_skeleton(medialis.read_shape(REAL / f"{name}.ply")))
        return {
            "balls": found.balls,
            "poke_out": found.share,
            "poke_out_creases": found.share_at_creases,
            "tenth": found.tenth,
            "worst": found.worst,
        }

    for name in UNCROSSED if REAL.exists() else ():
        yield name, partial(row, name)


def union_rows() -> Iterator[tuple[str, Callable[[], Row]]]:
    """Union of the balls against the surface, edges refined to 0.5 % of the diagonal."""
    for name in UNIONS if REAL.exists() else ():
        yield name, lambda name=name: union_row(medialis.read_shape(REAL / f"{name}.ply"), FINE)
    for name in ("box", "L", "snake", "bead ring"):
        yield name, lambda name=name: union_row(mesh(name, 4, False), FINE)


def ray_rows() -> Iterator[tuple[str, Callable[[], Row]]]:
    """Thickness against rays: samples of the mesh alone, and refined as the operation does."""
    for name, length in WALLS.items():
        for count in (12, 3):
            for irregular in (False, True):
                title = f"{name}, {count} along a wall" + irregular * ", irregular"
                make = partial(_wall_mesh, name, length / count, irregular)
                yield title, lambda make=make: ray_row(make(), 0.0)
        coarse = partial(_wall_mesh, name, length / 3, True)
        yield f"{name}, at the defaults", lambda coarse=coarse: ray_row(coarse(), 0.01)


def _wall_mesh(name: str, longest: float, irregular: bool) -> medialis.Shape:
    """Mesh a shape; a tube has 96 sides however far its samples are apart along it."""
    rng = random() if irregular else None
    if name != "tube":
        return shapes()[name].make(longest, rng)
    profile = np.array([[0.4, -0.6], [0.5, -0.6], [0.5, 0.6], [0.4, 0.6]])
    return lathe(profile, longest, rng, closed=True, columns=96)


def truth_rows() -> Iterator[tuple[str, Callable[[], Row]]]:
    """Thickness against the true balls of organic shapes, on the samples of the mesh alone."""
    for name, known in shapes().items():
        if known.kind == "organic":
            for irregular in (False, True):
                title = f"{name}, 6 across" + irregular * ", irregular"
                yield title, partial(_truth_row, name, irregular)


def _truth_row(name: str, irregular: bool) -> Row:
    return truth_row(mesh(name, 6, irregular), shapes()[name])


def thin_rows() -> Iterator[tuple[str, Callable[[], Row]]]:
    """First thin spot at the defaults of the operation."""
    for name, known in shapes().items():
        if known.thinnest is not None:

            def row(name: str = name, known: KnownShape = known) -> Row:
                shape = known.make(np.inf, None) if known.coarse else mesh(name, 8, False)
                return thin_row(shape, known)

            yield name, row


def noisy_thin_rows() -> Iterator[tuple[str, Callable[[], Row]]]:
    """First thin spot of the same shapes whose vertices lie off by a tenth of their spacing."""
    for name, known in shapes().items():
        if known.thinnest is not None:
            yield name, partial(_noisy_thin_row, name, known)


def _noisy_thin_row(name: str, known: KnownShape) -> Row:
    clean = mesh(name, 8, False)
    step = 0.1 * clean.spacing * random().normal(size=clean.points.shape)
    return thin_row(medialis.make_shape(clean.points + step, clean.faces), known)


def sheet_rows() -> Iterator[tuple[str, Callable[[], Row]]]:
    """Sheets, areas and Y-curves at 8 samples across."""
    for name in FLAT:
        known = shapes()[name]
        wanted = {"areas": known.areas, "y_length": known.y_length}
        for irregular in (False, True):
            yield (
                f"{name}, 8 across" + irregular * ", irregular",
                lambda name=name, irregular=irregular, wanted=wanted: sheet_row(
                    mesh(name, 8, irregular), wanted
                ),
            )


def curve_rows() -> Iterator[tuple[str, Callable[[], Row]]]:
    """Curve skeletons at the defaults of the operation."""
    for name, known in every_shape().items():
        if known.loops is not None:
            yield name, lambda name=name, known=known: curve_row(mesh(name, 4, False), known)


def segment_rows() -> Iterator[tuple[str, Callable[[], Row]]]:
    """Patches of polyhedra, and parts of bodies with arms."""
    for name in PLANE:
        yield f"patches of {name}", lambda name=name: patch_row(mesh(name, 8, False))
    for name in ("jack", "fork"):
        yield f"parts of {name}", lambda name=name: part_row(*bodies()[name])


SECTIONS: dict[str, Callable[[], Iterator[tuple[str, Callable[[], Row]]]]] = {
    "axis": axis_rows,
    "poke_out": poke_out_rows,
    "union": union_rows,
    "rays": ray_rows,
    "thickness": truth_rows,
    "thin": thin_rows,
    "noisy_thin": noisy_thin_rows,
    "sheets": sheet_rows,
    "curves": curve_rows,
    "segments": segment_rows,
}
