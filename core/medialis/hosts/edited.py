"""Layers that the user of a host has edited: back as files, and their levels from bytes."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from medialis.operations.declaration import Operation
from medialis.operations.result import Levels
from medialis.options import Kind, Parameter


def unpacked_levels(data: bytes) -> Levels:
    """Return the levels of a layer from what their `packed` gave."""
    from medialis.operations.mesh_levels import MeshLevels

    return MeshLevels.unpacked(data)


def takes_back(operation: Operation, layer: str) -> Parameter | None:
    """Return the option of an operation that takes a layer of its result as it was edited.

    Examples
    --------
    >>> from medialis import operation
    >>> takes_back(operation("medial_mesh"), "medial_mesh").name
    'edited'
    """
    files = (p for p in operation.parameters if p.kind is Kind.FILE and p.layer)
    return next((p for p in files if p.layer == layer), None)


def write_edited(
    path: str | os.PathLike[str],
    points: ArrayLike,
    faces: ArrayLike | None,
    edges: ArrayLike | None,
    attributes: Mapping[str, Any],
    *,
    unit: str | None = None,
) -> None:
    """Write points, triangles and edges as they are in a host, in the format of the file's ending.

    Parameters
    ----------
    path : path
        Ends in one of `Layer.formats`.
    points : (p, 3) float
    faces : (m, 3) int or None
    edges : (e, 2) int or None
    attributes : dict
        Of points: `radius` where they are balls.
    unit : str, optional
        What one unit of the points is.

    Raises
    ------
    InvalidOptionError
        For another ending, and where the format needs what is not there, such as a radius.
    InvalidShapeError
        When a number is not finite.
    FileError
        When the file cannot be written.
    """
    from medialis.files.layer_files import Content, write_content

    given = None if faces is None else np.asarray(faces, np.int32).reshape(-1, 3)
    lines = None if edges is None else np.asarray(edges, np.int32).reshape(-1, 2)
    places = np.asarray(points, np.float64).reshape(-1, 3)
    write_content(path, Content(places, given, lines, attributes, {}, unit))
