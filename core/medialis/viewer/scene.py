"""What the viewer shows of results: surfaces, points and curves with values, and thin spots.

Layers that lie on the same surface become one surface with all their values. Where no layer lies on
the surface, the shape itself is shown see-through.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from medialis.units import AREAS, LENGTHS, RADIANS
from medialis.validation import FloatArray, IntArray

if TYPE_CHECKING:
    from medialis.model.shape import Shape
    from medialis.operations.result import Layer, Outcome

NUMBERS_ONLY = ("feature_1", "feature_2", "source", "node", "pair")
"""Attributes that name rows of other arrays: as colours they say nothing."""

SPOTS = "thin_spots"

Kind = Literal["surface", "points", "curves"]


@dataclass(frozen=True, eq=False)
class Field:
    """Values of the points of a part, in the unit that people read.

    Attributes
    ----------
    name : str
    values : (n,) array
    unit : {"length", "area", "degrees", ""}
    is_label : bool
        They number segments.
    color_map : str
    limits : (float, float) or None
        Values of the first and last colour; all of them where None.
    shown_from : float
        Points below are hidden at first; -inf hides none.
    """

    name: str
    values: NDArray[Any]
    unit: str = ""
    is_label: bool = False
    color_map: str = "sequential"
    limits: tuple[float | None, float | None] = (None, None)
    shown_from: float = -math.inf


@dataclass(eq=False)
class Part:
    """One thing that can be switched on and off."""

    title: str
    kind: Kind
    points: FloatArray
    faces: IntArray | None = None
    edges: IntArray | None = None
    fields: list[Field] = field(default_factory=list)
    color_by: str | None = None
    filter_by: str | None = None
    visible: bool = True
    opacity: float = 1.0

    def lies_on(self, points: FloatArray, faces: IntArray | None) -> bool:
        """Tell whether these are the same points and faces."""
        if (self.faces is None) != (faces is None) or self.points.shape != points.shape:
            return False
        same = self.faces is None or np.array_equal(self.faces, faces)  # type: ignore[arg-type]
        return bool(same and np.array_equal(self.points, points))


@dataclass(frozen=True, eq=False)
class Spot:
    """A thin spot: its two ends, the second NaN where there is none, and its value."""

    position: FloatArray
    opposite: FloatArray
    value: float
    kind: str


@dataclass(frozen=True, eq=False)
class Scene:
    """All that a page shows.

    Attributes
    ----------
    title : str
    parts : list of Part
    spots : list of Spot
    shape : Shape
        Gives the size, and the first view.
    notes : list of str
        What the results say: shown as text.
    """

    title: str
    parts: list[Part]
    spots: list[Spot]
    shape: Shape
    notes: list[str]


def scene_of(results: Sequence[Outcome], title: str) -> Scene:
    """Return what is shown of one or more results of the same shape; of the later ones, hidden.

    Points and fields of the first result are seen at first.
    """
    parts: list[Part] = []
    spots: list[Spot] = []
    for number, result in enumerate(results):
        for layer in _layers(result):
            if layer.name == SPOTS:
                continue
            _add(parts, layer, visible=number == 0)
        spots = spots or _spots(result)
    shape = results[0].shape
    if not any(_stands_for(part, shape) for part in parts):
        parts.insert(0, _bare(shape))
    _choose(parts, shape)
    notes = [str(note) for result in results for note in getattr(result, "messages", ())]
    return Scene(title, parts, spots, shape, list(dict.fromkeys(notes)))


def _layers(result: Outcome) -> list[Layer]:
    """Layers that are worth showing; where pictures show a finer copy of one, that one."""
    finer = result.shown[0] if result.shown and result.shown[0].auxiliary else None
    found = []
    for layer in result.layers:
        if layer.on_input and finer is not None:
            found.append(finer)
            finer = None
        elif not layer.auxiliary:
            found.append(layer)
    return found


def _add(parts: list[Part], layer: Layer, visible: bool) -> None:
    """Add a layer, or its values to the part that has its points and faces already."""
    if len(layer.points) == 0:
        return
    fields = _fields(layer)
    for part in parts:
        if layer.faces is not None and part.lies_on(layer.points, layer.faces):
            known = {one.name for one in part.fields}
            part.fields += [one for one in fields if one.name not in known]
            return
    kind: Kind = "points"
    if layer.faces is not None:
        kind = "surface"
    elif layer.edges is not None:
        kind = "curves"
    names = [one.name for one in fields]
    parts.append(
        Part(
            _title(layer, parts),
            kind,
            layer.points,
            layer.faces,
            layer.edges,
            fields,
            layer.color_by if layer.color_by in names else next(iter(names), None),
            layer.filter_by if layer.filter_by in names else None,
            visible,
        )
    )


def _title(layer: Layer, parts: list[Part]) -> str:
    on_surface = layer.on_input or layer.name == "samples"
    if on_surface and not any(part.title == "surface" for part in parts):
        return "surface"
    return layer.name.replace("_", " ")


def _fields(layer: Layer) -> list[Field]:
    found = []
    for name, values in layer.attributes.items():
        array = np.asarray(values)
        if array.ndim != 1 or array.dtype.kind not in "fiub" or name in NUMBERS_ONLY:
            continue
        if name == "side" and len(np.unique(array)) == 1:
            continue
        own = name == layer.color_by
        first, unit = -math.inf, _unit(layer, name)
        if name == layer.filter_by and layer.filter_default:
            first = layer.filter_unit.attribute(layer.filter_default)
        if unit == "degrees":
            array, first = np.degrees(array), math.degrees(first)
        found.append(
            Field(
                name,
                array,
                unit,
                name in layer.labels and array.dtype.kind in "iub",
                layer.color_map if own else "sequential",
                layer.color_limits if own else (None, None),
                first,
            )
        )
    return found


def _unit(layer: Layer, name: str) -> str:
    if name in RADIANS:
        return "degrees"
    if name in AREAS or (name == layer.filter_by and layer.filter_unit.power == 2):
        return "area"
    return "length" if name in LENGTHS else ""


def _spots(result: Outcome) -> list[Spot]:
    """Thin spots as the values of a result tell them, numbered from the thinnest."""
    rows = result.values.get("spots")
    if not isinstance(rows, list | tuple):
        return []
    none = [math.nan] * 3
    return [
        Spot(
            np.array(row["position"], float),
            np.array(row.get("opposite") or none, float),
            float(row["value"]),
            str(row.get("kind", "wall")),
        )
        for row in rows
        if isinstance(row, dict) and row.get("value") is not None
    ]


def _stands_for(part: Part, shape: Shape) -> bool:
    """Tell whether a part is the surface of the shape, and not one inside of it, or its points."""
    if part.kind != "surface":
        return shape.faces is None and part.points.shape == shape.points.shape
    size = part.points.max(axis=0) - part.points.min(axis=0)
    low, high = shape.bounds
    return bool(np.abs(size - (high - low)).max() < 0.02 * shape.diagonal)


def _bare(shape: Shape) -> Part:
    kind: Kind = "points" if shape.faces is None else "surface"
    return Part("shape" if shape.faces is None else "surface", kind, shape.points, shape.faces)


def _choose(parts: list[Part], shape: Shape) -> None:
    """Let the shape be see-through where something inside it is shown.

    Where there are triangles inside, the points that they are made of are hidden.
    """
    inner = [part for part in parts if part.kind == "surface" and not _stands_for(part, shape)]
    if any(part.visible for part in inner):
        for part in parts:
            part.visible &= part.kind != "points"
    inside = [part for part in parts if part.visible and part.kind != "surface"]
    surfaces = [part for part in parts if part.kind == "surface"]
    for part in surfaces[:1]:
        if inside or any(other.visible for other in surfaces[1:]):
            part.opacity, part.visible = 0.2, True
            if inside and inside[0].fields:
                part.color_by = None
    if inside and not any(part.kind == "surface" for part in parts):
        inside[0].opacity = 1.0
