"""Results as tables of pandas."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.hosts.other_libraries import Drawable, Drawn, library
from medialis.model.curve_skeleton import CurveSkeleton


def to_pandas(thing: Drawable | Sequence[Any]) -> Any:
    """Return a table: the points of a layer, the branches of a curve skeleton, or a list of rows.

    Parameters
    ----------
    thing : Layer, Result, MedialCloud, CurveSkeleton, or sequence of ThinSpot or Row
        A layer or result: one line a point, with x, y, z and every attribute. A curve skeleton: one
        line a branch. A list of thin spots or of rows of a batch: one line each.

    Returns
    -------
    pandas.DataFrame

    Raises
    ------
    InvalidShapeError
        When there is no table of it.
    InvalidOptionError
        When pandas is not installed.

    See Also
    --------
    thin_spots : makes a list.
    batch : makes rows.

    Examples
    --------
    >>> import medialis
    >>> result = medialis.run("thickness", medialis.organic_shape(56))
    >>> medialis.to_pandas(result).thickness.min()  # doctest: +SKIP
    """
    pandas = library("pandas")
    if isinstance(thing, CurveSkeleton):
        ends = np.array([[row[0], row[-1]] for row in thing.branches]).reshape(-1, 2)
        columns: dict[str, Any] = {"start": ends[:, 0], "end": ends[:, 1]}
        columns |= {"length": thing.branch_lengths, "mean_radius": thing.mean_radii}
        return pandas.DataFrame({**columns, "tortuosity": thing.tortuosity})
    if isinstance(thing, list | tuple) and all(dataclasses.is_dataclass(row) for row in thing):
        return pandas.DataFrame([_line(row) for row in thing])
    drawn = Drawn.of(thing)  # type: ignore[arg-type]
    return pandas.DataFrame(_columns({"": drawn.points, **drawn.attributes}))


def _line(row: Any) -> dict[str, Any]:
    """Return the columns of one line of a list: numbers, words and places."""
    line: dict[str, Any] = {}
    for one in dataclasses.fields(row):
        value = getattr(row, one.name)
        if isinstance(value, Mapping):
            line |= {k: v for k, v in value.items() if isinstance(v, int | float | str)}
        elif np.shape(value) == (3,) and np.asarray(value).dtype.kind == "f":
            line |= {f"{one.name}_{axis}": v for axis, v in zip("xyz", value, strict=True)}
        else:
            line[one.name] = value
    return line


def _columns(attributes: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return one column a number: vectors as name_x, name_y, name_z, others by number."""
    found: dict[str, NDArray[Any]] = {}
    for name, values in attributes.items():
        if np.ndim(values) == 1:
            found[name] = np.array(values)
            continue
        flat = np.reshape(values, (len(values), -1))
        ends = "xyz" if flat.shape[1] == 3 else range(flat.shape[1])
        for end, column in zip(ends, flat.T, strict=True):
            found[f"{name}_{end}".lstrip("_")] = column.copy()
    return found
