"""A surface through the points of a cloud."""

import numpy as np
import pytest

import closed_forms as forms
import medialis
from medialis.base.errors import InvalidShapeError


def scattered_torus():
    """Torus sampled on a grid of its angles, each moved by up to a quarter of its step: in a
    regular grid four neighbours lie on one circle, and rounding alone decides on the diagonal."""
    rng = np.random.default_rng(1)
    u, v = np.meshgrid(np.arange(120), np.arange(36), indexing="ij")
    u = 2 * np.pi * (u + rng.uniform(-0.25, 0.25, u.shape)).ravel() / 120
    v = 2 * np.pi * (v + rng.uniform(-0.25, 0.25, v.shape)).ravel() / 36
    ring = np.stack([np.cos(u), np.sin(u), 0 * u], 1)
    normals = np.cos(v)[:, None] * ring + np.sin(v)[:, None] * [0, 0, 1]
    return medialis.Shape(ring + 0.3 * normals, normals)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("make", "genus"), [(lambda: forms.sphere(1500).shape, 0), (scattered_torus, 1)]
)
def test_sphere_and_torus_get_closed_outward_surfaces(make, genus):
    shape = make()
    found = medialis.surface_of_cloud(shape)
    assert np.array_equal(found.points, shape.points)
    assert np.array_equal(found.normals, shape.normals)
    told = medialis.diagnose(found.points, found.faces)
    assert told.closed and told.genus == genus and told.components == 1
    assert told.orientation == "out" and told.nonmanifold_edges == 0


@pytest.mark.slow
def test_area_and_volume_of_a_sphere():
    """Chords lie below the sphere by at most h^2 / 8: the volume misses no more than that shell."""
    shape = forms.sphere(3000).shape
    told = medialis.diagnose(shape.points, medialis.surface_of_cloud(shape).faces)
    missing = 4 * np.pi / 3 - told.volume
    assert 0 < missing < 4 * np.pi * told.max_edge**2 / 8


def test_turned_and_moved_clouds_get_the_same_triangles():
    shape = forms.ellipsoid(800, mirrored=False).shape
    q = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    q *= np.sign(np.linalg.det(q))
    turned = medialis.Shape(1e3 * shape.points @ q.T + 7, shape.normals @ q.T)

    def keys(s):
        return {tuple(sorted(f)) for f in medialis.surface_of_cloud(s).faces.tolist()}

    assert keys(turned) == keys(shape)


@pytest.mark.slow
def test_importance_of_a_cloud_when_asked_for():
    sphere = forms.sphere(1500).shape
    result = medialis.run("skeleton_importance", sphere, reconstruct=True, refine=0)
    assert "surface_built" in {message.code for message in result.messages}
    arc = result.layers[0].attributes["importance"]
    expected = result.layers[0].attributes["spoke_angle"]  # unit radius: the arc is the angle
    assert np.median(np.abs(arc - expected) / expected) < 0.02


def test_flat_and_inward_clouds_are_refused():
    flat = np.c_[np.random.default_rng(0).random((50, 2)), np.zeros(50)]
    with pytest.raises(InvalidShapeError, match="flat"):
        medialis.surface_of_cloud(medialis.Shape(flat, np.tile([0.0, 0, 1], (50, 1))))
    sphere = forms.sphere(300).shape
    with pytest.raises(InvalidShapeError, match="inside"):
        medialis.surface_of_cloud(medialis.Shape(sphere.points, -sphere.normals))
