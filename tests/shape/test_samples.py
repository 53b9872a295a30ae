"""Sample shapes by name: closed, outward, of the genus that their description says."""

import numpy as np
import pytest

import medialis
from medialis.base.errors import InvalidOptionError
from medialis.shape.generate import make_unambiguous, surface_nets
from medialis.shape.samples import SAMPLES, sample_shape

HANDLES = {"molecule": 1, "gear": 1, "bracket": 3}


@pytest.mark.slow
@pytest.mark.parametrize("resolution", [56, 83])
@pytest.mark.parametrize("name", sorted(SAMPLES.keys() - {"scan"}))
def test_samples_are_closed_manifolds_of_one_part(name, resolution):
    shape = sample_shape(name, resolution)
    found = medialis.diagnose(shape.points, shape.faces)
    assert (found.boundary_edges, found.nonmanifold_edges, found.components) == (0, 0, 1)
    assert found.genus == HANDLES.get(name, 0)
    corners = shape.points[shape.faces]
    volume = np.einsum("mi,mi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    assert 0 < volume < np.prod(np.ptp(shape.points, axis=0))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["vase", "gear", "bracket", "hand"])
def test_the_shape_does_not_depend_on_the_resolution(name):
    coarse, fine = (sample_shape(name, resolution) for resolution in (64, 110))
    assert fine.point_count > 2 * coarse.point_count
    np.testing.assert_allclose(coarse.bounds, fine.bounds, atol=0.02 * fine.diagonal)


def test_the_gear_has_flat_sides_and_sharp_edges():
    gear = sample_shape("gear", 64)
    corners = gear.points[gear.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    flat = np.abs(np.abs(normals[:, 2]) - 1) < 1e-9
    side = np.abs(normals[:, 2]) < 1e-9
    assert (flat | side).all() and flat.any() and side.any()


def test_nets_of_random_numbers_are_manifolds():
    """Signs were once changed to and fro for ever."""
    for seed in range(5):
        values = np.random.default_rng(seed).normal(size=(9, 9, 9))
        values[[0, -1]] = values[:, [0, -1]] = values[:, :, [0, -1]] = 1.0
        make_unambiguous(values)
        points, faces = surface_nets(values, np.zeros(3), 1.0)
        found = medialis.diagnose(points, faces)
        assert (found.boundary_edges, found.nonmanifold_edges) == (0, 0)


def test_unknown_names_and_sizes_are_one_sentence():
    with pytest.raises(InvalidOptionError, match="creature"):
        sample_shape("teapot")
    with pytest.raises(InvalidOptionError, match="56"):
        sample_shape("gear", 3)


def test_the_scan_is_points():
    scan = sample_shape("scan", 56)
    assert scan.faces is None and scan.point_count > 400
