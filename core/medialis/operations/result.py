"""Results as every host can show them: layers of points, triangles or curves with attributes."""

from __future__ import annotations

import html
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from medialis.errors import InvalidShapeError
from medialis.kept import Described
from medialis.model.armature import Bones, SkinWeights
from medialis.model.curve_skeleton import CurveSkeleton
from medialis.model.shape import Shape
from medialis.options import Kind
from medialis.validation import as_faces, as_points


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
        "bones": hosts with armatures add `Outcome.rig` in its place; "skin": it shows the weights
        of `Outcome.skin`; "hidden": hosts add it invisible; "shape": it takes the place of the
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
    """

    name: str
    points: NDArray[np.float64]
    faces: NDArray[np.int32] | None = None
    edges: NDArray[np.int32] | None = None
    attributes: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    color_by: str | None = None
    color_map: str = "sequential"
    color_limits: tuple[float | None, float | None] = (None, None)
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

    @property
    def hidden(self) -> NDArray[np.bool_]:
        """Which points (p,) a slider at `filter_default` hides; none where that is 0."""
        values = self.attributes.get(self.filter_by or "")
        if values is None or self.filter_default == 0.0:
            return np.zeros(len(self.points), bool)
        return np.asarray(values) < self.filter_unit.attribute(self.filter_default)


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
    graph : CurveSkeleton or None
        A graph that is written in graph formats as well.
    rig : Bones or None
        Bones for hosts that have armatures, and
    skin : SkinWeights or None
        their weights on the points of the given shape.
    shown : tuple of Layer
        What pictures show instead of the first layer inside the shape: a layer in its colours, and
        layers of points marked on it.
    """

    shape: Shape
    layers: tuple[Layer, ...] = ()
    values: Mapping[str, Any] = field(default_factory=dict)
    arrays: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    images: Mapping[str, NDArray[np.uint8]] = field(default_factory=dict)
    shown: tuple[Layer, ...] = ()
    graph: CurveSkeleton | None = None
    rig: Bones | None = None
    skin: SkinWeights | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", _defined(dict(self.values)))


def _defined(value: Any) -> Any:
    """Return plain data with None in the place of NaN and infinity."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Mapping):
        return {name: _defined(part) for name, part in value.items()}
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
        All of them, defaults included.
    seconds : dict
        Per stage.
    messages : tuple of str
        What was repaired, refined or masked.
    """

    operation: str = ""
    parameters: Mapping[str, Any] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)
    messages: tuple[str, ...] = ()

    def viewer_html(
        self, path: str | os.PathLike[str], *others: Outcome, title: str | None = None
    ) -> None:
        """Write one HTML file that shows the result in three dimensions, by itself.

        Parameters
        ----------
        path : path
            An existing file is replaced.
        *others : Result
            Of the same shape: more layers to switch on.
        title : str, optional
            Of the page; the operation when missing.

        Raises
        ------
        FileError
            When the page cannot be written, or the library that it draws with is missing.
        """
        from medialis.viewer.page import write_viewer

        write_viewer(path, (self, *others), title or self.title)

    def show(self, *others: Outcome) -> Path | None:
        """Show the result in three dimensions: in the notebook, else in the browser.

        Returns
        -------
        Path or None
            The page that the browser was given; None in a notebook.
        """
        from medialis.viewer.page import viewer_page
        from medialis.viewer.showing import show_page

        return show_page(viewer_page((self, *others), self.title), self.operation)

    @property
    def title(self) -> str:
        """The operation in words."""
        return self.operation.replace("_", " ").capitalize()

    def _repr_html_(self) -> str:
        """Return what notebooks show: a small picture beside the values."""
        from medialis.operations.pictures import picture_html
        from medialis.operations.quantities import value_lines

        lines = [*value_lines(self.values, self.shape.unit), *map(str, self.messages)]
        told = "<br>".join(html.escape(line) for line in lines)
        return (
            '<div style="display:flex;gap:1em;align-items:flex-start;flex-wrap:wrap">'
            f"{picture_html(self)}<div style='flex:1 1 20em'><b>{html.escape(self.title)}</b><br>"
            f"{told}</div></div>"
        )
