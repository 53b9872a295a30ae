"""Balls that cover a surface: closed forms, points of the surface, files."""

import json
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

import medialis
from closed_forms import box_mesh, icosphere
from medialis.base.errors import InvalidOptionError, InvalidShapeError
from medialis.medial_meshes.distances import _given


def single(center=(0, 0, 0), radius=0.1):
    return medialis.MedialMesh([center], [radius], [], [])


@pytest.mark.slow
def test_one_ball_round_a_cube_goes_through_its_corners():
    """Radius sqrt(3) / 2 of a cube of side 1; the ball is 2.72 times as large, so 1.72 outside.

    Steps of 1 / 40 of the way end within 1 / 40 of the radius, as quasi-random volumes within 1 %.
    """
    cube = box_mesh((1.0, 1.0, 1.0), 0.5)
    cover = medialis.ball_cover(single((0.1, 0, 0)), cube)
    assert len(cover) == 1
    assert np.sqrt(3) / 2 <= cover.radii[0] < 1.025 * np.sqrt(3) / 2
    ratio = 4 / 3 * np.pi * cover.radii[0] ** 3
    assert np.isclose(cover.excess, ratio - 1, rtol=0.02)


@pytest.mark.slow
def test_a_ball_is_covered_by_itself():
    cover = medialis.ball_cover(single(), icosphere(4))
    assert 1.0 <= cover.radii[0] < 1.01 and cover.excess < 0.05


def on_surface(shape, count, seed):
    """Random points of a mesh."""
    rng = np.random.default_rng(seed)
    face = rng.choice(shape.face_count, count, p=shape.face_areas / shape.area)
    shares = rng.dirichlet([1, 1, 1], count)
    return np.einsum("pk,pkd->pd", shares, shape.points[shape.faces[face]])


@pytest.mark.slow
@pytest.mark.parametrize("balls", [1, 12, 80])
def test_every_point_of_the_surface_is_in_a_ball(balls):
    shape = medialis.organic_shape(200)
    cover = medialis.ball_cover(medialis.medial_mesh(shape, balls=balls, quality="fast"), shape)
    places = np.concatenate([shape.points, on_surface(shape, 20_000, 1)])
    far = np.linalg.norm(places[:, None] - cover.centers, axis=2) - cover.radii
    assert far.min(axis=1).max() <= 0
    assert len(cover) <= balls


@pytest.mark.slow
def test_more_balls_cover_more_tightly():
    shape = medialis.organic_shape(200)
    mesh = medialis.medial_mesh(shape, balls=80, quality="fast")
    few, many = (medialis.ball_cover(mesh.level(n), shape).excess for n in (8, 80))
    assert many < 0.6 * few


def test_each_piece_goes_to_the_ball_that_grows_least():
    """Against all balls, one after the other; far from the origin too."""
    rng = np.random.default_rng(5)
    for offset in (0.0, 1e6):
        pieces = rng.random((3000, 1, 3)) + 0.02 * rng.random((3000, 3, 3)) + offset
        pieces[0] = pieces[0, 0]  # a point
        centers, radii = rng.random((40, 3)) + offset, 0.3 * rng.random(40)
        owner, need = _given(pieces, centers, radii)
        far = np.linalg.norm(pieces[:, :, None] - centers, axis=3).max(axis=1)
        least = (far - radii).min(axis=1)
        rows = np.arange(len(pieces))
        assert np.abs((far - radii)[rows, owner] - least).max() < 1e-9
        assert np.abs(far[rows, owner] - need).max() < 1e-9


@pytest.mark.slow
def test_files_hold_the_balls(tmp_path):
    cover = medialis.ball_cover(single(), icosphere(2))
    medialis.write_ball_cover(tmp_path / "a.json", cover, unit="mm")
    found = json.loads((tmp_path / "a.json").read_text())
    assert found["excess_volume"] == cover.excess
    assert np.allclose(found["spheres"][0]["radius"], cover.radii[0] / 1000, rtol=1e-12)
    medialis.write_ball_cover(tmp_path / "a & b.urdf", cover)
    robot = ElementTree.parse(tmp_path / "a & b.urdf").getroot()
    assert robot.get("name") == "a & b"
    spheres = robot.findall("link/collision/geometry/sphere")
    assert [float(one.get("radius")) for one in spheres] == cover.radii.tolist()
    place = robot.find("link/collision/origin").get("xyz").split()
    assert np.array_equal([float(word) for word in place], cover.centers[0])


@pytest.mark.slow
def test_what_cannot_be_covered_or_written(tmp_path):
    cloud = medialis.make_shape(icosphere(1).points, normals=icosphere(1).points)
    with pytest.raises(InvalidShapeError, match="point cloud"):
        medialis.ball_cover(single(), cloud)
    cover = medialis.ball_cover(single(), icosphere(1))
    with pytest.raises(InvalidOptionError, match="json"):
        medialis.write_ball_cover(tmp_path / "a.xml", cover)
    with pytest.raises(InvalidOptionError, match="unit"):
        medialis.write_ball_cover(tmp_path / "a.json", cover, unit="ell")
