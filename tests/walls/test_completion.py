"""The completion of fields: a dense oracle, a closed form on any triangles, parts of it anew."""

import math

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import Delaunay

import closed_forms as forms
from medialis.shape.generate import organic_shape
from medialis.skeleton.medial_cloud import shrink_balls
from medialis.walls import completion as module
from medialis.walls._completion_kernels import LARGEST_WEIGHT, LEAST_WEIGHT
from medialis.walls.completion import complete, complete_again
from medialis.walls.thickness import (
    WALL_ANGLE,
    WallThicknessOptions,
    field_on_surface,
    thickness,
    thickness_field,
    wall_thickness,
)


@pytest.fixture(scope="module")
def creature():
    shape = organic_shape(56)
    return shape, shrink_balls(shape)


def to_the_end(monkeypatch):
    """Take as many steps as it needs, and complete again all that is joined."""
    monkeypatch.setattr(module, "FEWEST_STEPS", 5000)
    monkeypatch.setattr(module, "MOST_STEPS", 5000)
    monkeypatch.setattr(module, "SMOOTHING_ACCURACY", 1e-13)
    monkeypatch.setattr(module, "CARRIED", math.inf)


@pytest.mark.parametrize("few_rows", [20, 10_000])
def test_completion_is_the_harmonic_field_between_reliable_samples(creature, monkeypatch, few_rows):
    """With enough steps: weighed by cotangents, geometric means of their neighbours (dense)."""
    shape, cloud = creature
    rows = cloud.wall_angles >= math.radians(WALL_ANGLE)
    fixed = field_on_surface(cloud.subset(rows), 2 * cloud.radii[rows])
    fixed[cloud.source[rows]] = 2 * cloud.radii[rows]
    free = np.isnan(fixed)
    links = shape.cotangent_weights.tocsr()
    links.data = np.clip(links.data, LEAST_WEIGHT, LARGEST_WEIGHT)
    n = shape.point_count
    laplacian = (coo_array((links.sum(axis=1), (range(n), range(n)))).tocsr() - links)[free]
    known = np.log(fixed[~free])
    wanted = np.exp(np.linalg.solve(laplacian[:, free].toarray(), -laplacian[:, ~free] @ known))
    wanted = np.maximum(wanted, thickness(cloud)[free])  # no wall is thinner than a ball in it
    few = wall_thickness(cloud, min_spoke_angle=WALL_ANGLE)
    to_the_end(monkeypatch)
    monkeypatch.setattr(module, "FEW_ROWS", few_rows)
    values = wall_thickness(cloud, min_spoke_angle=WALL_ANGLE - 1e-9)  # nothing kept
    assert (values[~free] == fixed[~free]).all()
    assert np.allclose(values[free], wanted, rtol=1e-9)
    assert np.median(np.abs(few[free] / wanted - 1)) < 0.01


@pytest.mark.parametrize("count", [300, 8_000])
def test_a_strip_has_the_same_field_however_it_is_cut(count):
    """Between its ends the logarithm is linear; cotangents keep linear fields of any triangles.

    8,000 vertices are 200 edges long: steps along edges alone would not cross that.
    """
    random, side = np.random.default_rng(count), int(math.sqrt(count / 5))
    rim = np.linspace(0, 1, side)
    long = np.linspace(0, 5, 5 * side)
    flat = np.concatenate(
        [
            random.uniform((0.02, 0.02), (4.98, 0.98), (count, 2)),
            *(np.stack([np.full(side, x), rim], axis=1) for x in (0.0, 5.0)),
            *(np.stack([long, np.full(5 * side, y)], axis=1)[1:-1] for y in (0.0, 1.0)),
        ]
    )
    strip = forms.mesh(np.pad(flat, ((0, 0), (0, 1))), Delaunay(flat).simplices)
    x = strip.points[:, 0]
    known = np.where((x == 0) | (x == 5), np.exp(-x / 5), np.nan)
    values = complete(strip, known, known).values
    assert np.abs(values / np.exp(-x / 5) - 1).max() < 0.02


def test_seeds_are_nearest_along_the_surface(creature):
    """Against scipy's search."""
    shape, cloud = creature
    field = thickness_field(cloud, WallThicknessOptions())
    seeds = np.flatnonzero(~np.isnan(field.known))
    length = np.linalg.norm(np.diff(shape.points[shape.edges], axis=1)[:, 0], axis=1)
    n = shape.point_count
    graph = coo_array((length, tuple(shape.edges.T)), shape=(n, n)).tocsr()
    far = dijkstra(graph, directed=False, indices=seeds, min_only=True)
    assert np.allclose(field.distance, far, rtol=1e-12) and np.isin(field.seed, seeds).all()


def test_completed_again_is_as_completed_at_once(creature, monkeypatch):
    """The same seeds, and with enough steps the same harmonic field."""
    to_the_end(monkeypatch)
    shape, _ = creature
    n, random = shape.point_count, np.random.default_rng(0)
    cube = forms.box_mesh((0.3, 0.3, 0.3), 0.1)
    shape = forms.mesh(
        np.concatenate([shape.points, cube.points + np.array([9, 0, 0])]),
        np.concatenate([shape.faces, cube.faces + n]),
    )
    other = random.uniform(1, 2, shape.point_count)
    known = np.where(random.random(len(other)) < 0.02, other, np.nan)
    known[n:] = np.nan
    before = complete(shape, other, known)
    for share in (0.1, 0.5):
        gone = random.random(len(known)) < share
        gone[n + before.known[n:].argmin()] = share == 0.5  # what was lent to the cube
        other, known = np.where(gone, np.nan, other), np.where(gone, np.nan, known)
        lower = np.flatnonzero(~np.isnan(known))[:5]
        known[lower] *= 0.9
        before = complete_again(before, other, known)
        wanted = complete(shape, other, known)
        assert (before.seed == wanted.seed).all() and (before.lent == wanted.lent).all()
        assert np.allclose(before.distance, wanted.distance, rtol=1e-12)
        assert np.allclose(before.values, wanted.values, rtol=1e-9)
        assert complete_again(before, other, known) is before


def test_what_is_far_from_a_change_keeps_its_value(creature):
    """One sample less: what changes lies within two thicknesses of those that took its value."""
    shape, cloud = creature
    field = thickness_field(cloud, WallThicknessOptions())
    least = int(np.nanargmin(field.known))
    known = field.known.copy()
    known[least] = np.nan
    after = complete_again(field, known, known)
    changed = np.flatnonzero(after.values != field.values)
    took = np.append(np.flatnonzero(field.seed == least), least)
    far = np.linalg.norm(shape.points[changed][:, None] - shape.points[took], axis=2)
    room = module.CARRIED * after.known[after.seed[took]].max()
    assert len(changed) > 0 and far.min(axis=1).max() <= room
