"""Volumes of labels to shapes: arrays, images of SimpleITK and nibabel, files."""

from types import SimpleNamespace

import numpy as np
import pytest

import medialis
from medialis.exchange.label_volumes import label_volume

skimage = pytest.importorskip("skimage", reason="scikit-image makes the surfaces")
GRID = np.indices((40, 30, 30))
MIDDLE, RADIUS = np.array([17.0, 14.0, 15.0]), 9.0


def two_balls():
    """A ball of label 3 with a smaller one of label 7 beside it, in voxels."""
    volume = np.zeros(GRID.shape[1:], np.uint8)
    away = GRID - MIDDLE[:, None, None, None]
    volume[(away**2).sum(axis=0) < RADIUS**2] = 3
    small = GRID - np.array([33, 14, 15])[:, None, None, None]
    volume[(small**2).sum(axis=0) < 25] = 7
    return volume


def volume_of(shape):
    corners = shape.points[shape.faces] - shape.points.mean(axis=0)
    return np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6


def test_each_label_is_a_closed_surface_at_its_place():
    shapes = medialis.label_surfaces(two_balls(), spacing=(0.5, 0.5, 0.5))
    assert list(shapes) == [3, 7]
    for shape in shapes.values():
        assert (shape.edge_twins >= 0).all()
    ball = shapes[3]
    off = np.linalg.norm(ball.points - 0.5 * MIDDLE, axis=1) - 0.5 * RADIUS
    # A vertex lies between two voxels and may move by half a voxel: below one in all.
    assert np.abs(off).max() < 0.5
    # The voxels themselves hold 1 % more or less than the ball.
    assert volume_of(ball) == pytest.approx(4 / 3 * np.pi * (0.5 * RADIUS) ** 3, rel=0.03)


def test_smoothing_takes_steps_away_and_keeps_walls_of_one_voxel():
    volume = two_balls()
    rough = medialis.label_surfaces(volume, [3], smooth=False)[3]
    fine = medialis.label_surfaces(volume, [3])[3]
    spread = [np.std(np.linalg.norm(s.points - MIDDLE, axis=1)) for s in (rough, fine)]
    assert spread[1] < 0.6 * spread[0]
    plate = np.zeros((20, 20, 5), bool)
    plate[2:18, 2:18, 2] = True
    thin = medialis.label_surfaces(plate)[1]
    assert (thin.edge_twins >= 0).all()
    assert 0.5 < np.median(medialis.thickness(thin)) < 1.5


def test_voxels_may_be_long_and_axes_turned():
    """A reflected grid turns faces inside out unless they are turned as well."""
    affine = np.array([[0, -0.5, 0, 10], [-1, 0, 0, 20], [0, 0, 2.0, -5], [0, 0, 0, 1]])
    for sign in (1, -1):
        affine[2, 2] *= sign
        image = SimpleNamespace(affine=affine, dataobj=two_balls(), header=SimpleNamespace())
        shape = medialis.label_surfaces(image, [7], smooth=False)[7]
        assert shape.unit == "mm" and volume_of(shape) > 0
        place = affine[:3, :3] @ [33, 14, 15] + affine[:3, 3]
        assert np.allclose(np.mean(shape.bounds, axis=0), place, atol=1e-6)


def test_files_and_images_give_the_same_shapes(tmp_path):
    nibabel = pytest.importorskip("nibabel", reason="nibabel is not installed")
    sitk = pytest.importorskip("SimpleITK", reason="SimpleITK is not installed")
    volume = two_balls()
    image = sitk.GetImageFromArray(volume.T)
    image.SetSpacing((0.5, 0.7, 1.0))
    image.SetOrigin((3.0, -2.0, 8.0))
    image.SetDirection((0, -1, 0, 1, 0, 0, 0, 0, 1))
    shapes = [medialis.label_surfaces(image)[3]]
    for name in ("a.nrrd", "a.nii.gz"):
        sitk.WriteImage(image, str(tmp_path / name))
        shapes.append(medialis.label_surfaces(tmp_path / name)[3])
    shapes.append(medialis.label_surfaces(nibabel.load(tmp_path / "a.nii.gz"))[3])
    itk, nrrd, nifti, loaded = (shape.points for shape in shapes)
    assert np.array_equal(itk, nrrd) and np.array_equal(nifti, loaded)
    # SimpleITK's x is left and y back, nibabel's right and front; single precision in the header.
    assert np.allclose(nifti, itk * [-1, -1, 1], atol=1e-5)
    assert all(volume_of(shape) > 0 for shape in shapes)
    middle = [3.0 - 0.7 * 14, -2.0 + 0.5 * 17, 8.0 + 15.0]
    assert np.allclose(itk.mean(axis=0), middle, atol=0.05)


@pytest.mark.parametrize(
    ("volume", "said"),
    [
        (np.zeros((4, 4, 4), int), "no labels"),
        (np.zeros((4, 4)), r"three axes, got shape \(4, 4\)"),
        (np.full((4, 4, 4), 0.5), "holds fractions"),
        (np.full((4, 4, 4), np.nan), "holds fractions"),
        (np.full((4, 4, 4), -1), "from 0 to 1,000,000, got -1 to -1"),
        (np.full((4, 4, 4), "a"), "whole numbers, got <U1"),
    ],
)
def test_what_is_no_volume_of_labels_is_told(volume, said):
    with pytest.raises(medialis.InvalidShapeError, match=said):
        medialis.label_surfaces(volume)


def test_labels_and_spacing_are_checked():
    with pytest.raises(medialis.InvalidShapeError, match="no label 5"):
        medialis.label_surfaces(two_balls(), [3, 5])
    with pytest.raises(medialis.InvalidShapeError, match="must be positive"):
        medialis.label_surfaces(two_balls(), spacing=(1, 0, 1))
    assert label_volume(two_balls()[..., None]).labels.shape == (40, 30, 30)  # one channel


@pytest.mark.parametrize("name", ["a.nii", "a.nii.gz", "a.nrrd"])
def test_damaged_and_missing_files_are_named(tmp_path, name):
    pytest.importorskip("nibabel", reason="nibabel is not installed")
    pytest.importorskip("SimpleITK", reason="SimpleITK is not installed")
    with pytest.raises(medialis.FileError, match=name):
        medialis.label_surfaces(tmp_path / name)
    (tmp_path / name).write_bytes(b"no volume at all")
    with pytest.raises(medialis.FileError, match=name):
        medialis.label_surfaces(tmp_path / name)


def test_reading_a_volume_as_a_mesh_says_what_to_do(tmp_path):
    (tmp_path / "a.nii").write_bytes(b"\x5c\x01\0\0".ljust(344, b"\0") + b"n+1\0" + bytes(100))
    (tmp_path / "a.nrrd").write_bytes(b"NRRD0004\n")
    for name in ("a.nii", "a.nrrd"):
        with pytest.raises(medialis.InvalidShapeError, match="label_surfaces"):
            medialis.read_shape(tmp_path / name)
