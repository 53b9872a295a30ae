"""What hosts draw beside the values of a layer: sizes of points, legends, numbers at places."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from medialis.hosts.shown import Shown
from medialis.hosts.words import title
from medialis.model.shape import Shape
from medialis.operations.quantities import quantity
from medialis.operations.result import Layer, Outcome
from medialis.render.annotation import number_text
from medialis.render.colors import label_colors, map_colors
from medialis.validation import FloatArray

LARGEST_DOT = 0.012
"""Radius of drawn points at most, as a share of the diagonal: a few points are still points."""
TUBE = 0.004
"""Radius of drawn curves at least, as a share of the diagonal: thinner ones are not seen."""
SPARSE, SAMPLES = 0.3, 5000
"""Where a layer has fewer points than this share of the samples, they may lie farther apart: their
distance is measured at so many."""
MOST_ENTRIES = 12
"""Segments that a legend lists; it says how many there are."""
MOST_NUMBERS = 20
"""Places at which numbers are written: more would cover each other."""
STEPS = 64
"""Colours of the bar of a legend."""
APART = 0.07
"""How far outside the surface a number stands, as a share of the diagonal."""


def drawn_radius(layer: Layer, result: Outcome) -> float:
    """Return the radius at which the points or curves of a layer are drawn.

    Points touch their neighbours, curves are as thick as the samples are apart.

    Parameters
    ----------
    layer : Layer
    result : Outcome
        That the layer is from.

    Examples
    --------
    >>> import medialis
    >>> result = medialis.run("surface_skeleton", medialis.organic_shape(56))
    >>> drawn_radius(result.layers[0], result) == result.shape.spacing / 2
    True
    """
    shape = result.shape
    usual = 0.5 * float(result.values.get("spacing") or shape.spacing)
    diagonal = shape.diagonal
    if layer.edges is not None:
        return max(usual, TUBE * diagonal)
    points = layer.points[~layer.hidden]
    if len(points) < 2:
        return LARGEST_DOT * diagonal
    if len(points) < SPARSE * shape.point_count:
        from scipy.spatial import cKDTree

        chosen = points[:: max(1, len(points) // SAMPLES)]
        usual = max(usual, 0.5 * float(np.median(cKDTree(points).query(chosen, k=2)[0][:, 1])))
    return min(usual, LARGEST_DOT * diagonal)


@dataclass(frozen=True, eq=False)
class Legend:
    """What the colours of a layer mean.

    Attributes
    ----------
    title : str
    low, high : float
        Values of the first and last colour; angles in degrees.
    quantity : {"length", "area", "angle", ""}
        What they measure, for hosts that have units of their own.
    colors : (k, 3) float64
        SRGB from the first to the last colour, or of the segments.
    names : tuple of str
        Of the segments; empty for numbers.
    """

    title: str
    low: float
    high: float
    quantity: str
    colors: FloatArray
    names: tuple[str, ...] = ()

    def number(self, value: float) -> str:
        """Return a value in short, without a unit but degrees."""
        return number_text(value) + ("°" if self.quantity == "angle" else "")


def legend_of(found: Shown) -> Legend:
    """Return the legend of what is shown.

    Examples
    --------
    >>> import medialis
    >>> from medialis.hosts import shown
    >>> layer = medialis.run("thickness", medialis.organic_shape(56)).layers[0]
    >>> key = legend_of(shown(layer))
    >>> key.title, key.quantity, key.low == layer.color_limits[0]
    ('thickness', 'length', True)
    """
    name = title(found.name)
    if found.is_label:
        present = np.unique(np.asarray(found.values)[np.asarray(found.values) >= 0])
        few = present[:MOST_ENTRIES]
        names = tuple(str(int(label)) for label in few)
        return Legend(f"{name}: {len(present)}", 0.0, 0.0, "", label_colors(few), names)
    what = quantity(found.name)
    factor = math.degrees(1.0) if what == "angle" else 1.0
    low, high = found.limits
    colors = map_colors(np.linspace(0.0, 1.0, STEPS), found.color_map, 0.0, 1.0)
    return Legend(name, factor * low, factor * high, what, colors)


@dataclass(frozen=True, eq=False)
class Numbers:
    """Values that are written at places of a layer, the first ones first.

    Attributes
    ----------
    places : (k, 3) float64
        On the surface.
    texts_at : (k, 3) float64
        Where the values stand, outside.
    values : (k,) float64
    quantity : {"length", "area", "angle", ""}
    """

    places: FloatArray
    texts_at: FloatArray
    values: NDArray[np.float64]
    quantity: str


def numbers_of(layer: Layer, shape: Shape) -> Numbers | None:
    """Return the values that hosts write at the points of a layer (`Layer.number_by`).

    Parameters
    ----------
    layer : Layer
    shape : Shape
        Its normals say where outside is.
    """
    if layer.number_by is None or len(layer.points) == 0:
        return None
    places = layer.points[:MOST_NUMBERS]
    values = np.asarray(layer.attributes[layer.number_by], np.float64)[:MOST_NUMBERS]
    # The places are few: looking at all points is quicker than to build a tree.
    near = [int(((shape.points - place) ** 2).sum(axis=1).argmin()) for place in places]
    outward = shape.normals[near]
    return Numbers(
        places, places + APART * shape.diagonal * outward, values, quantity(layer.number_by)
    )
