"""Values of results for people: what is a length, an area or an angle, and how it is written.

Results as every host can show them: layers of points, triangles or curves with attributes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import Described
from medialis.base.errors import InvalidShapeError
from medialis.base.options import AREAS, LENGTHS, POWERS, RADIANS, VOLUMES, Kind, with_unit
from medialis.base.progress import counted
from medialis.base.validation import Positions, as_faces, as_points
from medialis.operations.positions import Listed, Place, of_array
from medialis.shape.shape import Shape

_PARTS = ("_min", "_median", "_max")

LAYERS_TOLD = 2
"""Layers that the text of a result tells the sizes of."""

WORDS = {
    "a3_points": "rim points",
    "y_points": "Y-curve points",
    "y_network_points": "Y-network points",
    "y_curves": "Y-curves",
    "y_length": "Y-curve length",
    "seams": "Y-curves",
    "seam": "Y-curve",
    "medial_mesh_seams": "medial mesh Y-curves",
}
"""What values are called for people, where that is not their name."""

INNER = {
    *("open_balls", "without_normal", "between_parts", "along_edges"),
    *("expected_loops", "expected_loops_certain", "explained"),
    *("candidates", "kept_candidates", "sheet_share", "kept_points", "spacing", "unlabelled"),
    *("seam_edges", "fewest_balls", "most_balls", "unassigned_samples"),
    *(f"checked_thickness_{word}" for word in ("min", "median", "max")),
    # What the verdict, or a message, says as well.
    *("checked_percent", "too_thin", "too_thick", "thick_ribs", "overlaps"),
}
"""Values that tell how it was computed: people see them with --verbose, and in
the manifest."""


def value_words(name: str) -> str:
    """Return the name of a value for people.

    Examples
    --------
    >>> value_words("thin_spots"), value_words("seams"), value_words("largest_error_percent")
    ('thin spots', 'Y-curves', 'largest error')
    """
    return WORDS.get(name, name.removesuffix("_percent").replace("_", " "))


DIMENSIONS = {"length": 1, "area": 2, "volume": 3}
"""Power of the unit of length in each quantity."""


def quantity(name: str) -> str:
    """Return "length", "area", "volume" or "angle" (in radians) for a value's name, else nothing.

    Examples
    --------
    >>> quantity("radius_max"), quantity("area"), quantity("spoke_angle"), quantity("nodes")
    ('length', 'area', 'angle', '')
    """
    stem = next((name.removesuffix(part) for part in _PARTS if name.endswith(part)), name)
    kinds = {"length": LENGTHS, "area": AREAS, "volume": VOLUMES, "angle": RADIANS}
    return next((kind for kind, names in kinds.items() if stem in names), "")


def unit_of(name: str, unit: str | None) -> str:
    """Return the unit that a value has in tables; `unit` is that of the shape. "": none is known.

    Examples
    --------
    >>> unit_of("area", "mm"), unit_of("spoke_angle", None), unit_of("error_percent", None)
    ('mm²', 'degrees', '%')
    """
    what = quantity(name)
    if what in DIMENSIONS:
        return f"{unit}{POWERS[DIMENSIONS[what]]}" if unit else ""
    return "degrees" if what == "angle" else "%" if name.endswith("_percent") else ""


def value_text(name: str, value: Any, unit: str | None = None) -> str:
    """Return a value of a result for people, with its unit; `unit` is that of the shape.

    Examples
    --------
    >>> value_text("radius_max", 0.5, "mm"), value_text("spoke_angle_min", math.pi / 3)
    ('0.5 mm', '60.0 degrees')
    >>> value_text("samples", 35779), value_text("area", None)
    ('35,779', 'not defined')
    """
    what = quantity(name)
    if value is None:
        return "not defined"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, Mapping):
        return ", ".join(f"{key}: {value_text('', part, unit)}" for key, part in value.items())
    if isinstance(value, float) and what == "angle":
        return f"{math.degrees(value):.1f} degrees"
    if isinstance(value, float):
        own = unit if what else "%" if name.endswith("_percent") else None
        return with_unit(value, own, DIMENSIONS.get(what, 1))
    return f"{value:,}" if isinstance(value, int) else str(value)


def value_rows(values: Mapping[str, Any], unit: str | None = None) -> Iterator[tuple[str, str]]:
    """Yield the values of a result in words; tables are for programs and left out.

    Smallest, median and largest of a quantity share a row.

    Examples
    --------
    >>> list(value_rows({"points": 3, "radius_min": 1.0, "radius_median": 1.5, "radius_max": 3.0}))
    [('points', '3'), ('radius', '1 to 3, median 1.5')]
    """
    stems = [name.removesuffix("_min") for name in values if name.endswith("_min")]
    threes = {stem: [f"{stem}{part}" for part in _PARTS] for stem in stems}
    whole = {a: b for a, b in threes.items() if all(isinstance(values.get(c), float) for c in b)}
    done = {one for three in whole.values() for one in three[1:]}
    for name, value in values.items():
        parts = value.values() if isinstance(value, Mapping) else ()
        tables = isinstance(value, list) or any(isinstance(p, list | Mapping) for p in parts)
        if name in done or tables:
            continue
        stem = name.removesuffix("_min")
        if stem != name and stem in whole:
            low, median, high = (value_text(one, values[one], unit) for one in whole[stem])
            ending = low.removeprefix(low.split(" ")[0])
            if ending and high.endswith(ending):
                low = low.removesuffix(ending)
            yield value_words(stem), f"{low} to {high}, median {median}"
        else:
            yield value_words(name), value_text(name, value, unit)


def value_lines(values: Mapping[str, Any], unit: str | None = None) -> list[str]:
    """Return the values of a result as lines for people.

    Examples
    --------
    >>> value_lines({"points": 3, "spoke_angle_max": math.pi, "spots": [{}], "area": None})
    ['points: 3', 'spoke angle max: 180.0 degrees', 'area: not defined']
    """
    return [f"{name}: {text}" for name, text in value_rows(values, unit)]


@dataclass(frozen=True)
class FilterUnit:
    """How an attribute follows from the option that people give: scale * option ** power.

    A slider on the attribute shows the option, so that its number can be typed into the operation.

    Attributes
    ----------
    kind : Kind
        LENGTH: the option is a fraction of the bounding-box diagonal; ANGLE: degrees.
    scale, power : float
    option : str or None
        Name of the option of the operation that removes or hides the same points.

    Examples
    --------
    >>> FilterUnit(Kind.LENGTH, scale=20.0, option="threshold").attribute(0.05)
    1.0
    """

    kind: Kind = Kind.FLOAT
    scale: float = 1.0
    power: float = 1.0
    option: str | None = None

    @classmethod
    def length(cls, diagonal: float, option: str | None = None, *, power: float = 1.0) -> Self:
        """Return the unit of lengths, or areas (power 2), as fractions of the diagonal."""
        return cls(Kind.LENGTH, diagonal**power, power, option)

    @classmethod
    def degrees(cls, option: str | None = None) -> Self:
        """Return the unit of an attribute in radians."""
        return cls(Kind.ANGLE, math.pi / 180.0, 1.0, option)

    def attribute(self, option: float) -> float:
        """Return the value of the attribute that an option stands for."""
        return self.scale * option**self.power

    def of_attribute(self, value: float) -> float:
        """Return the option that stands for a value of the attribute, at least 0."""
        share = value / self.scale if self.scale > 0.0 else 0.0
        return float(max(share, 0.0) ** (1.0 / self.power))


class Levels(Protocol):
    """A layer with other numbers of points, none of which has to be computed.

    Attributes
    ----------
    fewest, most : int
        Points of the coarsest and of the finest one.
    """

    @property
    def fewest(self) -> int: ...  # noqa: D102

    @property
    def most(self) -> int: ...  # noqa: D102

    def layer(self, count: int) -> Layer:
        """Return the layer of so many points, or of as near a number as there is."""

    def packed(self) -> bytes:
        """Return all of it as bytes; `medialis.hosts.unpacked_levels` reads them."""


@dataclass(frozen=True, eq=False, repr=False)
class Layer(Described):
    """Points, triangles or curves with named attributes, one row a point.

    Attributes
    ----------
    name : str
        Name in the host and stem of the file.
    points : (p, 3) float64
    faces : (m, 3) int32 or None
    edges : (e, 2) int32 or None
    attributes : dict of (p,) or (p, d) arrays
        Scalars (float), labels (int) or vectors.
    color_by : str or None
        The attribute that hosts show first.
    color_map : str
        Its colour map (`render.colors`).
    color_limits : (float or None, float or None)
        Values of its first and last colour; the range of the values where None.
    color_limit : float or None
        Values of `color_by` below it are told from those above by colour.
    classes : tuple of (str, (float, float, float))
        Name and sRGB colour of the numbers 0, 1, ... where `color_by` tells kinds, not amounts.
    face_attributes : dict of (m,) or (m, d) arrays
        The same for faces.
    labels : tuple of str
        Attributes that number segments: 0, 1, ...; -1 is none. Hosts make groups of them. A number
        means the same in all layers, arrays and values of a result, so a layer with few points
        (the vertices of a coarse input) may lack some.
    filter_by : str or None
        Attribute whose small values hosts can hide by a slider without computing anew.
    filter_unit : FilterUnit
        What the slider shows, and
    filter_default : float
        where it stands at first, in that unit: points below it are hidden, not lost.
    number_by : str or None
        Attribute whose values hosts write at the points, the first ones where there are many.
    on_input : bool
        The points and faces are those of the shape that was given: hosts that show it already
        write the attributes on it (see `Shape.on_input_points`) instead of adding a layer.
    auxiliary : bool
        What the other layers refer to, such as the samples: hosts add it on request only.
    role : str
        "bones": hosts with armatures add its bones in its place; "skin": it shows the weights
        of its skin; "hidden": hosts add it invisible; "shape": it takes the place of the
        shape, which hosts hide; "balls": hosts draw the points with their radius, and where edges
        and faces join them the cones and slabs between them, also when users move them;
        "selection": hosts select the points whose `selected` is 1, and add nothing.
    formats : tuple of str
        Formats in which it is written besides PLY: "obj" and "glb" (triangles), "ma" (balls with
        their edges and triangles), "json" and "urdf" (balls).
    facts : dict of float
        Numbers that belong to all of it and stand in such files: `excess_volume` of balls.
    levels : Levels or None
        The same with fewer and with more points; hosts show them by a slider.
    drawn_by : str
        Layer of triangles of the same result that pictures show in the place of these points.
    """

    name: str
    points: Positions
    faces: NDArray[np.int32] | None = None
    edges: NDArray[np.int32] | None = None
    attributes: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    color_by: str | None = None
    color_map: str = "sequential"
    color_limits: tuple[float | None, float | None] = (None, None)
    color_limit: float | None = None
    classes: tuple[tuple[str, tuple[float, float, float]], ...] = ()
    face_attributes: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    labels: tuple[str, ...] = ()
    filter_by: str | None = None
    filter_unit: FilterUnit = FilterUnit()
    filter_default: float = 0.0
    number_by: str | None = None
    on_input: bool = False
    auxiliary: bool = False
    role: str = ""
    formats: tuple[str, ...] = ()
    facts: Mapping[str, float] = field(default_factory=dict)
    levels: Levels | None = None
    drawn_by: str = ""

    def __post_init__(self) -> None:
        count = len(as_points(self.points, f"points of layer {self.name}"))
        faces = 0
        if self.faces is not None:
            faces = len(as_faces(self.faces, count, f"faces of layer {self.name}"))
        for rows, attributes in ((count, self.attributes), (faces, self.face_attributes)):
            for name, values in attributes.items():
                if len(values) != rows:
                    raise InvalidShapeError(
                        f"Attribute {name} of layer {self.name} has {len(values)} rows, not {rows}."
                    )
        known = {*self.attributes, *self.face_attributes}
        wanted = {*self.labels, *filter(None, (self.color_by, self.filter_by, self.number_by))}
        if not wanted <= known:
            raise InvalidShapeError(
                f"Layer {self.name} has no attribute {', '.join(sorted(wanted - known))}."
            )

    def __repr__(self) -> str:
        parts = [self.name, *layer_sizes(self)]
        names = [*self.attributes, *self.face_attributes]
        return f"Layer({', '.join(parts)}{': ' if names else ''}{', '.join(names)})"

    @property
    def hidden(self) -> NDArray[np.bool_]:
        """Which points (p,) a slider at `filter_default` hides; none where that is 0."""
        values = self.attributes.get(self.filter_by or "")
        if values is None or self.filter_default == 0.0:
            return np.zeros(len(self.points), bool)
        return np.asarray(values) < self.filter_unit.attribute(self.filter_default)


def layer_sizes(layer: Layer) -> list[str]:
    """Return how many points, triangles and edges a layer has, in words.

    Examples
    --------
    >>> layer_sizes(Layer("ends", np.zeros((2, 3)), edges=np.array([[0, 1]], np.int32)))
    ['2 points', '1 edge']
    """
    rows = (("point", layer.points), ("triangle", layer.faces), ("edge", layer.edges))
    return [counted(len(values), word) for word, values in rows if values is not None]


@dataclass(frozen=True, eq=False, repr=False)
class Outcome(Described):
    """What the function of an operation returns.

    Attributes
    ----------
    shape : Shape
        The shape as computed on: repaired and perhaps refined; features index its points.
    layers : tuple of Layer
        First the one that hosts select.
    values : dict
        Counts and measures, plain numbers; None for what is not defined (NaN and infinity become
        None, also inside lists and dicts).
    arrays : dict of arrays
        The full result, also of masked rows; goes to the NPZ file.
    images : dict of (h, w, 3) uint8
        Pictures that are themselves the result.
    panels : dict of tuples of (str, Layer)
        Pictures besides the main one: surfaces side by side, each with its caption.
    shown : tuple of Layer
        What pictures show instead of the first layer inside the shape: a layer in its colours, and
        layers of points marked on it.
    extras : dict
        What else the feature gives, for its formats and for hosts that have a place for it, such
        as "graph", "bones" and "skin" (weights on the points of the given shape).
    """

    shape: Shape
    layers: tuple[Layer, ...] = ()
    values: Mapping[str, Any] = field(default_factory=dict)
    arrays: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    images: Mapping[str, NDArray[np.uint8]] = field(default_factory=dict)
    panels: Mapping[str, tuple[tuple[str, Layer], ...]] = field(default_factory=dict)
    shown: tuple[Layer, ...] = ()
    extras: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", _defined(dict(self.values)))


def _defined(value: Any) -> Any:
    """Return plain data with None in the place of NaN and infinity; arrays become lists."""
    if isinstance(value, np.ndarray | np.generic):
        value = of_array(value)
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Mapping):
        return {name: _defined(part) for name, part in value.items()}
    if isinstance(value, Place | Listed):
        return type(value)(_defined(part) for part in value)
    if isinstance(value, list | tuple):
        return [_defined(part) for part in value]
    return value


@dataclass(frozen=True, eq=False, repr=False)
class Result(Outcome, Described):
    """An outcome with the record of the run.

    Attributes
    ----------
    operation : str
    parameters : dict
        All of them, defaults included. Automatic ones have the number that was chosen; "auto" stays
        where an option had no use, as the longest edge of a point cloud.
    seconds : dict
        Per stage.
    messages : tuple of str
        What was repaired, refined or masked.
    automatic : tuple of str
        Parameters whose number was chosen automatically.
    """

    operation: str = ""
    parameters: Mapping[str, Any] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)
    messages: tuple[str, ...] = ()
    automatic: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """Say the operation, the unit, and the sizes of the first layers."""
        sizes = [f"{one.name} ({', '.join(layer_sizes(one))})" for one in self.layers[:LAYERS_TOLD]]
        more = [f"{len(self.layers) - LAYERS_TOLD} more layers"] * (len(self.layers) > LAYERS_TOLD)
        unit = f"in {self.shape.unit}" if self.shape.unit else "unit unknown"
        return f"Result({', '.join([self.operation, unit, *sizes, *more])})"

    @property
    def title(self) -> str:
        """The operation in words."""
        return self.operation.replace("_", " ").capitalize()
