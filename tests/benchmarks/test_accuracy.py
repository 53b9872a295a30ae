"""The accuracy suite: its shapes are what they claim, and its table is that of this code."""

import math

import numpy as np
import pytest
from accuracy_suite.catalogue import shapes
from accuracy_suite.cells import Cells
from accuracy_suite.known import Truth
from accuracy_suite.networks import networks
from accuracy_suite.sections import Section, extruded_truth
from accuracy_suite.suite import SECTIONS, mesh
from accuracy_suite.table import PAGE, page, read_table
from accuracy_suite.walls import ray_thickness

from medialis.shape.diagnosis import diagnose
from medialis.show.reports.measures import distance_to_balls

QUICK = {
    "axis": ("sphere, 4 across", "box, as drawn", "hourglass, 4 across", "leaf, 4 across"),
    "rays": ("slab, 12 along a wall", "bracket, 12 along a wall, irregular"),
    "thickness": ("hourglass, 6 across",),
    "thin": ("hourglass", "bracket"),
    "noisy_thin": ("bowl",),
    "sheets": ("box, 8 across", "L, 8 across"),
    "curves": ("capsule", "bead ring"),
    "segments": ("patches of box",),
}
"""Rows that are computed within a second or two."""

FLOOR = 0.1
"""Differences below this do not count: per cent of the diagonal or of a value. Shares of balls that
poke out vary by their threshold: 2."""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("section", "title"), [(name, title) for name, titles in QUICK.items() for title in titles]
)
def test_rows_are_those_of_the_table(section, title):
    """Within a quarter, either way: where they are better, the table is old.

    After a change that is meant: python benchmarks/accuracy.py --write
    """
    row = dict(SECTIONS[section]())[title]()
    written = read_table()[section][title]
    assert row.keys() == written.keys()
    for name, value in row.items():
        if value is None or isinstance(value, int):
            same = value == written[name]
            assert same, f"{section}, {title}: {name} is {value}, written {written[name]}"
            continue
        floor = 2.0 if name.startswith("poke_out") or name == "right" else FLOOR
        close = math.isclose(value, written[name], rel_tol=0.25, abs_tol=floor)
        assert close, f"{section}, {title}: {name} is {value:.4g}, written {written[name]}"


def test_the_page_is_written_from_the_numbers():
    assert PAGE.read_text() == page(read_table())


@pytest.mark.slow
@pytest.mark.parametrize("irregular", [False, True])
@pytest.mark.parametrize("name", list(shapes()))
def test_true_balls_are_empty_and_touch_every_sample(name, irregular):
    """The samples lie on the union of the true balls: no ball holds one, and all have one near.

    No nearer than rounding; no farther than the places of the truth are apart (0.75 covers).
    """
    shape, truth = mesh(name, 4, irregular), shapes()[name].truth()
    away = distance_to_balls(shape.points, truth.points, truth.radii)[0]
    apart = max(float(truth.cover.max()), 1e-4 * shape.diagonal)
    assert away.min() >= -1e-6 * shape.diagonal
    assert away.max() <= 1.5 * apart
    found = diagnose(shape.points, shape.faces)
    assert found.boundary_loops == 0 and found.nonmanifold_edges == 0 and found.components == 1
    loops = shapes()[name].loops
    assert found.genus == (loops or 0)
    a, b, c = shape.points[shape.faces.T]
    assert (np.cross(a, b) * c).sum() > 0  # faces look outwards


@pytest.mark.slow
@pytest.mark.parametrize("name", list(networks()))
def test_networks_have_the_handles_that_they_claim(name):
    shape = mesh(name, 4, False)
    assert diagnose(shape.points, shape.faces).genus == networks()[name].loops


def test_the_axis_of_a_section_is_that_of_its_corners():
    """A square: the diagonals. An L: the place where its concave corner counts is a parabola."""
    square = Section.of_loops([[0, 0], [2, 0], [2, 2], [0, 2]])
    centers, radii, _ = square.axis(0.05)
    off = np.minimum(abs(centers[:, 0] - centers[:, 1]), abs(centers.sum(axis=1) - 2))
    assert off.max() < 1e-12 and np.allclose(radii, square.distances(centers)[0])
    bend = Section.of_loops([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]])
    centers, radii, _ = bend.axis(0.05)
    assert np.allclose(radii, bend.distances(centers)[0], atol=1e-9)
    assert bend.area() == pytest.approx(3) and bend.girth() == pytest.approx(8)
    angles = sorted(round(math.degrees(inner)) for _, _, inner in bend.corners())
    assert angles == [90] * 5 + [270]


def test_a_drawing_of_cells_is_a_closed_solid_with_its_sides_joined():
    cells = Cells.of_rows([0, 1, 2, 3], [0, 1, 2, 3], ["###", "#.#", "###"])
    assert len(cells.section().sides) == 8 and cells.section().area() == pytest.approx(8)
    solid = cells.solid(2.0)
    assert diagnose(solid.points, solid.faces).genus == 1
    a, b, c = solid.points[solid.faces.T]
    assert (np.cross(a, b) * c).sum() / 6 == pytest.approx(16)
    # The largest disc touches two outer sides and a corner of the hole: (1 - r) sqrt(2) = r.
    assert extruded_truth(cells.section(), 2.0).radii.max() == pytest.approx(2 - 2**0.5, abs=1e-3)


def test_closed_forms_of_flat_prisms():
    """A box: 4 (a + b + c) edges, the sheets of benchmarks/features.py by hand."""
    box = shapes()["box"]
    a, b, c = 2.0, 1.5, 1.0
    edges = [(2 * s - c) / 2 * c / math.sqrt(2) for s in (a, b, c) for _ in range(4)]
    assert np.allclose(box.areas, sorted([(a - c) * (b - c), *edges]))
    assert box.y_length == pytest.approx(8 * math.sqrt(3) / 2 + 2 * (a - c) + 2 * (b - c))
    assert [shapes()[name].sheets for name in ("cube", "wedge", "L", "T", "prism")] == [
        12, 10, 16, 19, 19,
    ]  # fmt: skip


def test_distance_to_a_truth_is_that_to_its_discs():
    truth = Truth(np.zeros((1, 3)), np.ones(1), np.array([[0, 0, 1.0]]), np.array([0.5]))
    queries = np.array([[0.3, 0, 0.2], [0, 0.8, 0.4], [0, 0, 0]])
    assert np.allclose(truth.distances(queries), [0.2, 0.5, 0.0])


def test_rays_through_a_slab_are_its_height_but_near_its_rim():
    shape = shapes()["slab"].make(0.1, np.random.default_rng(0))
    rays = ray_thickness(shape, shape)
    inside = (np.abs(shape.points[:, 2]) > 0.0499) & (shape.points[:, 0] > 0.06)
    inside &= (shape.points[:, 0] < 1.14) & (np.abs(shape.points[:, 1] - 0.45) < 0.39)
    assert inside.any() and np.allclose(rays[inside], 0.1)
    assert np.isnan(rays[~inside]).any()
