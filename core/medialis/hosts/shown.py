"""What hosts show of a layer, as colours and as finite numbers, and what they hide."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.operations.result import Layer
from medialis.render.colors import label_colors, map_colors, value_range
from medialis.validation import FloatArray

HIDDEN_SUFFIX = "_hidden"


@dataclass(frozen=True, eq=False)
class Shown:
    """One attribute of a layer with its colours.

    Attributes
    ----------
    name : str
    values : (rows,) array
        One row a point, or a face.
    on_faces : bool
    is_label : bool
        They number segments, which have distinct colours (`medialis.hosts.label_colors`); else
        the colours are those of
    color_map : str
        with its first and last colour at the
    limits : (float, float)
    """

    name: str
    values: NDArray[Any]
    on_faces: bool
    is_label: bool
    color_map: str
    limits: tuple[float, float]

    @property
    def rgb(self) -> FloatArray:
        """SRGB colours (rows, 3) in 0..1; grey where there is no value."""
        if self.is_label:
            return label_colors(self.values)
        return map_colors(self.values, self.color_map, *self.limits)

    @property
    def rgba_bytes(self) -> NDArray[np.uint8]:
        """The colours in 8 bits with full opacity, (rows, 4)."""
        colors = np.full((len(self.values), 4), 255, np.uint8)
        colors[:, :3] = np.rint(255 * self.rgb)
        return colors

    @property
    def finite(self) -> FloatArray:
        """The values (rows,), NaN as the lowest finite one and infinity as the highest."""
        low, high = value_range(self.values)
        values = np.asarray(self.values, np.float64)
        return np.clip(np.where(np.isnan(values), low, values), low, high)

    def rows(self, chosen: NDArray[np.bool_]) -> Shown:
        """Return what is shown of some rows, in the same colours."""
        return replace(self, values=self.values[chosen])


def shown(
    layer: Layer,
    attributes: Mapping[str, NDArray[Any]] | None = None,
    face_attributes: Mapping[str, NDArray[Any]] | None = None,
) -> Shown | None:
    """Return what hosts show first of a layer: its `color_by`.

    Parameters
    ----------
    layer : Layer
    attributes, face_attributes : dict, optional
        The layer's own as a host has them, such as those that `on_input` returns.

    Returns
    -------
    Shown or None
        None when there is no `color_by`, or it holds vectors.

    Examples
    --------
    >>> import medialis
    >>> layer = medialis.run("thickness", medialis.organic_shape(56)).layers[0]
    >>> found = shown(layer)
    >>> found.name, found.rgba_bytes.shape == (len(layer.points), 4)
    ('thickness', True)
    """
    name = layer.color_by
    on_points = layer.attributes if attributes is None else attributes
    on_faces = layer.face_attributes if face_attributes is None else face_attributes
    if name is None or name not in {**on_faces, **on_points}:
        return None
    by_face = name not in on_points
    values = np.asarray((on_faces if by_face else on_points)[name])
    if values.ndim != 1:
        return None
    is_label = name in layer.labels and values.dtype.kind in "iub"
    limits = value_range(values, *layer.color_limits)
    return Shown(name, values, by_face, is_label, layer.color_map, limits)


def hidden_apart(layer: Layer) -> tuple[Layer, ...]:
    """Split a layer of points into those that it shows and those that it hides at first.

    For hosts without a slider: the second, whose name ends in "_hidden", is added invisible.
    Colours mean the same in both.

    Returns
    -------
    tuple of Layer
        One, the layer itself, when it hides nothing or has faces or edges.
    """
    hidden = layer.hidden
    if not hidden.any() or layer.faces is not None or layer.edges is not None:
        return (layer,)
    found = shown(layer)
    limits = layer.color_limits if found is None else found.limits
    return tuple(
        replace(
            layer,
            name=layer.name + suffix,
            points=layer.points[rows],
            attributes={name: np.asarray(v)[rows] for name, v in layer.attributes.items()},
            color_limits=limits,
            filter_default=0.0,
            role=role,
        )
        for suffix, rows, role in (("", ~hidden, layer.role), (HIDDEN_SUFFIX, hidden, "hidden"))
    )
