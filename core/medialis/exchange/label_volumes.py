"""Volumes of labels, as anatomists have them, to shapes: one closed surface for each label."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base.errors import FileError, InvalidShapeError
from medialis.base.validation import FloatArray
from medialis.exchange.libraries import library
from medialis.shape.reading import make_shape
from medialis.shape.shape import Shape
from medialis.shape.surface import link_matrix

ROUNDS = 50
"""Pairs of smoothing steps. The vertices of a ball with a radius of 8 voxels are then 0.06 voxels
off in the mean, before 0.17; its volume stays."""

SHRINK, GROW = 0.5, -0.51
"""Taubin's factors: long waves keep their size, so solids do not shrink."""

HALF = 0.5
"""Voxels that a vertex may move: half the way to the centers on both sides of it."""

MOST_LABELS = 1_000_000
"""A box is found for every number up to the largest label."""


class LabelVolume(NamedTuple):
    """Labels on a grid and where the grid lies.

    Attributes
    ----------
    labels : (i, j, k) int
        0 is background.
    affine : (4, 4) float64
        From indices to places.
    unit : str or None
    """

    labels: NDArray[Any]
    affine: FloatArray
    unit: str | None = None


def label_surfaces(
    volume: Any,
    labels: Sequence[int] | None = None,
    *,
    spacing: float | Sequence[float] = 1.0,
    smooth: bool = True,
) -> dict[int, Shape]:
    """Return the surface of each label of a volume, by marching cubes of scikit-image.

    Parameters
    ----------
    volume : path, SimpleITK.Image, nibabel image, or (i, j, k) array of int or bool
        Labels; 0 is background. Files are read by nibabel (.nii, .nii.gz, .mgz) or else SimpleITK
        (.nrrd, .mha and others). Images bring their own places: those of nibabel are x right, y
        front, z up, in millimetres; those of SimpleITK x left, y back, z up.
    labels : sequence of int, optional
        Which ones; all where it is None.
    spacing : float or (3,) float
        Size of the voxels of an array along each axis; images know theirs.
    smooth : bool
        Smooth the steps of the voxels. No vertex moves by more than half a voxel along each axis:
        thin parts stay, and so do volumes. Wide terraces of nearly flat slopes remain in part.

    Returns
    -------
    dict of Shape
        By label, in ascending order: closed meshes, repaired, with outward normals. Where a label
        ends at the border of the volume, the surface is closed half a voxel beyond.

    Raises
    ------
    InvalidShapeError
        When it is no volume of labels, or has none of those asked for.
    InvalidOptionError
        When scikit-image, or what reads the file, is not installed (`medialis[volumes]`).
    FileError
        When the file cannot be read.

    See Also
    --------
    run : what to do with a shape.
    surface_of_cloud : of points.

    Examples
    --------
    >>> import numpy as np
    >>> import medialis
    >>> grid = np.indices((40, 40, 40)) - 19.5
    >>> ball = (grid**2).sum(axis=0) < 15**2
    >>> shapes = medialis.label_surfaces(ball.astype(np.uint8) * 7, spacing=0.1)  # doctest: +SKIP
    >>> medialis.run("thickness", shapes[7]).values["thickness_median"]  # doctest: +SKIP
    3.0
    """
    from scipy.ndimage import find_objects

    grid = label_volume(volume, spacing)
    library("skimage")
    measure = library("skimage.measure")
    boxes = enumerate(find_objects(grid.labels), 1)  # None where there is no voxel of a label
    there = {label: box for label, box in boxes if box}
    wanted = sorted(there) if labels is None else [int(one) for one in labels]
    if not wanted or set(wanted) - set(there):
        raise InvalidShapeError(
            f"The volume has no label {sorted(set(wanted) - set(there))[0]}."
            if wanted
            else "The volume has no labels: all its voxels are 0."
        )
    found = {}
    for label in wanted:
        mask = np.pad(grid.labels[there[label]] == label, 1).astype(np.float32)
        points, faces = measure.marching_cubes(mask, 0.5, allow_degenerate=False)[:2]
        points = points.astype(np.float64)
        if smooth:
            points = smoothed(points, faces)
        points += [box.start - 1 for box in there[label]]
        places = points @ grid.affine[:3, :3].T + grid.affine[:3, 3]
        if np.linalg.det(grid.affine[:3, :3]) > 0:  # faces of scikit-image look inward
            faces = faces[:, ::-1]
        found[label] = make_shape(places, faces, repair=True, unit=grid.unit)
    return found


def label_volume(volume: Any, spacing: float | Sequence[float] = 1.0) -> LabelVolume:
    """Return the labels of a file, an image or an array, and where they lie.

    Raises
    ------
    InvalidShapeError
        When it has not three axes, or holds other things than whole numbers from 0 on.
    InvalidOptionError
        When what reads the file is not installed.
    FileError
        When the file cannot be read.
    """
    if isinstance(volume, str | os.PathLike):
        volume = _read(os.fspath(volume))
    unit, affine = None, np.eye(4)
    if hasattr(volume, "dataobj"):  # nibabel
        unit = {"meter": "m", "micron": "um"}.get(_nifti_unit(volume), "mm")
        affine, values = np.asarray(volume.affine, np.float64), np.asarray(volume.dataobj)
    elif hasattr(volume, "GetDirection"):  # SimpleITK
        unit = "mm"
        size = volume.GetDimension()
        if size == 3:
            direction = np.reshape(volume.GetDirection(), (3, 3))
            affine[:3, :3] = direction * np.array(volume.GetSpacing())
            affine[:3, 3] = volume.GetOrigin()
        values = library("SimpleITK").GetArrayFromImage(volume).T
    else:
        values = np.asarray(volume)
        steps = np.broadcast_to(np.asarray(spacing, np.float64), (3,))
        if not (np.isfinite(steps).all() and (steps > 0).all()):
            raise InvalidShapeError(f"The spacing must be positive, got {spacing!r}.")
        affine = np.diag([*steps, 1.0])
    return LabelVolume(_labels(values), affine, unit)


def smoothed(points: FloatArray, faces: NDArray[Any]) -> FloatArray:
    """Return the vertices of a surface between voxels without their steps; in voxels.

    Taubin (1995) under the constraint of Gibson (1998): a vertex stays within half a voxel.
    """
    from scipy.sparse import diags_array

    links = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    near = link_matrix(len(points), links)
    mean = diags_array(1.0 / np.maximum(near.sum(axis=1), 1.0)) @ near
    found = points
    for _ in range(ROUNDS):
        for factor in (SHRINK, GROW):
            found = found + factor * (mean @ found - found)
            found = np.clip(found, points - HALF, points + HALF)
    return np.asarray(found)


def _labels(values: NDArray[Any]) -> NDArray[np.int32]:
    """Return a volume as whole numbers.

    Raises
    ------
    InvalidShapeError
        When it is none.
    """
    while values.ndim > 3 and 1 in values.shape[3:]:  # a single time, or a single channel
        values = values.squeeze(3 + values.shape[3:].index(1))
    if values.ndim != 3 or 0 in values.shape:
        raise InvalidShapeError(f"A volume of labels has three axes, got shape {values.shape}.")
    if values.dtype.kind == "f":
        with np.errstate(invalid="ignore"):
            whole = np.isfinite(values).all() and (values == np.round(values)).all()
        if not whole:
            raise InvalidShapeError(
                "A volume of labels holds whole numbers; this one holds fractions. Segment the "
                "picture first."
            )
    elif values.dtype.kind not in "biu":
        raise InvalidShapeError(f"A volume of labels holds whole numbers, got {values.dtype}.")
    low, high = int(values.min()), int(values.max())
    if low < 0 or high > MOST_LABELS:
        raise InvalidShapeError(
            f"Labels are numbers from 0 to {MOST_LABELS:,}, got {low} to {high}; number them anew."
        )
    return values.astype(np.int32)


def _nifti_unit(image: Any) -> str:
    """Return the name of the unit in the header of a NIfTI image; other formats have none."""
    units = getattr(image.header, "get_xyzt_units", None)
    return str(units()[0]) if callable(units) else "mm"


def _read(name: str) -> Any:
    """Read an image file.

    Raises
    ------
    FileError
        When it is missing or cannot be read.
    """
    medical = name.lower().endswith((".nii", ".nii.gz", ".mgz", ".mgh"))
    reader = library("nibabel" if medical else "SimpleITK")
    try:
        if not medical:
            return reader.ReadImage(name)
        image = reader.load(name)
        np.asarray(image.dataobj)  # what is read late tells late that a file is cut short
        return image
    except Exception as error:  # noqa: BLE001 - a third-party parser may raise anything
        reason = " ".join(str(error).split())[-200:] or type(error).__name__
        raise FileError(f"Cannot read the volume {name}: {reason}") from None
