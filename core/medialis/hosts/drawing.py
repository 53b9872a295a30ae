"""What hosts show of a layer: names and numbers as people read them, colours, and what is beside.

Names of layers, segments and options; what was typed or picked; the attribute that a layer shows
first with its colours (`Shown`), and what it hides (`hidden_apart`); sizes of points, legends, and
numbers at places. Curves as tubes and marked places as balls (`solid`), for hosts that draw lines
and points a pixel wide.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import Index, Mask, kd_tree, polylines, unit_rows
from medialis.base.errors import InvalidOptionError
from medialis.base.options import Kind, Parameter
from medialis.base.validation import FloatArray
from medialis.operations.result import Layer, Outcome, quantity
from medialis.shape.shape import Shape
from medialis.show.annotation import number_text
from medialis.show.colors import label_colors, map_colors, value_range

MOST_PICKED = 100
"""Vertices that are taken as the ends of paths: nobody picks more by hand."""


def title(name: str) -> str:
    """Return the name of a layer, attribute or image for people.

    Examples
    --------
    >>> title("curve_skeleton")
    'curve skeleton'
    """
    return name.replace("_", " ")


def label_name(name: str, label: int) -> str:
    """Return the name of a segment, for groups and materials.

    Examples
    --------
    >>> label_name("part", 3), label_name("part", -1)
    ('part 003', 'part none')
    """
    return f"{name} none" if label < 0 else f"{name} {label:03d}"


def identifier(name: str) -> str:
    """Return a name as expressions can hold it: letters, digits, underscores.

    Examples
    --------
    >>> identifier("3 % of size")
    '_3___of_size'
    """
    word = re.sub(r"\W", "_", name, flags=re.ASCII)
    return f"_{word}" if word[:1].isdigit() else word


def free_name(name: str, taken: Collection[str]) -> str:
    """Return the name, or with _2, _3, ... when it is taken in any case of letters.

    Examples
    --------
    >>> free_name("radius", ["Radius", "radius_2"])
    'radius_3'
    """
    known = {other.lower() for other in taken}
    number, free = 1, name
    while free.lower() in known:
        number += 1
        free = f"{name}_{number}"
    return free


def distinct_names(
    attributes: Mapping[str, Any], face_attributes: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the face attributes under names that those of the points do not have.

    Examples
    --------
    >>> distinct_names({"part": 0}, {"part": 1, "side": 2})
    {'part_of_face': 1, 'side': 2}
    """
    return {
        f"{name}_of_face" if name in attributes else name: values
        for name, values in face_attributes.items()
    }


def picked_lines(parameter: Parameter, vertices: Sequence[int] | Index) -> str:
    r"""Return the file of an option that lists vertices, or pairs of them, for picked ones.

    A path runs from each to the next.

    Raises
    ------
    InvalidOptionError
        When there is no pair, or there are too many for hand-picked ones.

    Examples
    --------
    >>> import medialis
    >>> options = medialis.operation("geodesic_path").parameters
    >>> (pairs,) = [option for option in options if option.selection]
    >>> picked_lines(pairs, [3, 8, 5])
    '3 8\n8 5\n'
    """
    rows = [int(row) for row in vertices]
    if parameter.selection != "pair":
        return "".join(f"{row}\n" for row in rows)
    if not 2 <= len(rows) <= MOST_PICKED:
        raise InvalidOptionError(
            f"Select 2 to {MOST_PICKED} vertices, the ends of paths, one after the other; "
            f"{len(rows)} {'is' if len(rows) == 1 else 'are'} selected."
        )
    return "".join(f"{one} {other}\n" for one, other in itertools.pairwise(rows))


def as_typed(value: float, *, percent: bool = False) -> float:
    """Return the number that a user typed into a widget that keeps single precision.

    Parameters
    ----------
    value : float
        What the widget holds.
    percent : bool
        It holds per cent, and the fraction is wanted.

    Examples
    --------
    >>> import numpy as np
    >>> as_typed(np.float32(0.03)), as_typed(np.float32(0.03), percent=True)
    (0.03, 0.0003)
    """
    meant = Decimal(str(np.float32(value)))  # the shortest decimal that it stands for
    return float(meant / 100 if percent else meant)


def with_labels(text: str, parameters: Sequence[Parameter]) -> str:
    """Return a message in the words that people see in a host: labels and their values.

    Messages name options as Python has them, ``denoise = off``.

    Parameters
    ----------
    text : str
    parameters : sequence of Parameter
        Of the operation.

    Examples
    --------
    >>> import medialis
    >>> options = medialis.operation("surface_skeleton").parameters
    >>> with_labels("A smoothed copy was used (denoise = off turns this off).", options)
    'A smoothed copy was used (Noise: Off turns this off).'
    >>> with_labels("Use refine = 0.01.", options)
    'Use Refine edges above: 1 %.'
    """
    by_name = {p.name: p for p in parameters}
    names = "|".join(map(re.escape, by_name))
    given = re.compile(rf"\b({names})\s*=\s*([\w%-]+(?:\.\d+)?)")
    return given.sub(lambda found: _labelled(by_name[found[1]], found[2]), text) if names else text


def _labelled(parameter: Parameter, value: str) -> str:
    words = title(value).capitalize()
    if parameter.kind is Kind.BOOL:
        words = {"True": "On", "False": "Off"}.get(value, words)
    elif parameter.kind is Kind.LENGTH and re.fullmatch(r"[\d.]+", value):
        words = f"{100 * float(value):g} %"
    return f"{parameter.label}: {words}"


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

    def rows(self, chosen: Mask) -> Shown:
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
    ('wall_thickness', True)
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
        chosen = points[:: max(1, len(points) // SAMPLES)]
        usual = max(usual, 0.5 * float(np.median(kd_tree(points).query(chosen, k=2)[0][:, 1])))
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
    ('wall thickness', 'length', True)
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
    values: FloatArray
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


SIDES = 8
OF_RADIUS = 0.15
"""Radius of a tube: that of drawn curves, and this share of the medial radius more."""

DARK_SHARE = 0.6
"""How much longer the colour scale of a tube begins before its values: without its dark third."""

Solid = tuple[FloatArray, Index, Index]
"""Points, faces, and the row of the layer that each point comes from."""


def solid(layer: Layer, diagonal: float) -> Layer:
    """Return a layer with its edges as tubes, or its numbered places as balls; others stay.

    Attributes are those of the point that a vertex of a tube or ball belongs to. Curves with
    numbered branches have a colour for each, marks one for each place.

    Parameters
    ----------
    layer : Layer
    diagonal : float
        Of the shape.

    Examples
    --------
    >>> line = Layer("line", [[0, 0, 0], [1, 0, 0.0]], edges=[[0, 1]])
    >>> tube = solid(line, 1.0)
    >>> tube.edges is None, len(tube.points), len(tube.faces)
    (True, 18, 32)
    """
    if layer.number_by is not None and layer.faces is None and layer.edges is None:
        attributes = {**layer.attributes, "spot": np.arange(len(layer.points), dtype=np.int32)}
        marks = replace(layer, attributes=attributes, color_by="spot", labels=("spot",))
        return _made_of(marks, _balls(np.asarray(layer.points, np.float64), LARGEST_DOT * diagonal))
    if layer.edges is None:
        return layer
    radii = np.full(len(layer.points), TUBE * diagonal)
    if "radius" in layer.attributes:
        radii += OF_RADIUS * np.nan_to_num(np.asarray(layer.attributes["radius"], np.float64))
    points = np.asarray(layer.points, np.float64)
    made = _made_of(layer, _tubes(points, np.asarray(layer.edges), radii))
    return _bright(made, by_branch=layer.faces is None)


def _bright(layer: Layer, *, by_branch: bool) -> Layer:
    """Colour curves by branch, else without the dark colours of the map."""
    on_points = [name for name in layer.labels if name in layer.attributes]
    if by_branch and on_points:
        return replace(layer, color_by=on_points[0])
    values = layer.attributes.get(layer.color_by or "")
    if values is None:
        return layer
    low, high = value_range(values, *layer.color_limits)
    return replace(layer, color_limits=(low - DARK_SHARE * (high - low), high))


def _made_of(layer: Layer, made: Solid) -> Layer:
    """Return the layer with this mesh in the place of its edges or points; its faces stay."""
    points, faces, rows = made
    kept = layer.faces is not None and len(layer.faces) > 0
    face_attributes: Mapping[str, NDArray[Any]] = {}
    if kept:
        assert layer.faces is not None
        faces = np.concatenate([layer.faces, faces + len(layer.points)])
        points = np.concatenate([layer.points, points])
        rows = np.concatenate([np.arange(len(layer.points)), rows])
        face_attributes = {
            name: _with_tubes(np.asarray(v), len(faces), name in layer.labels)
            for name, v in layer.face_attributes.items()
        }
    return replace(
        layer,
        points=points,
        faces=faces.astype(np.int32),
        edges=None,
        attributes={name: np.asarray(v)[rows] for name, v in layer.attributes.items()},
        face_attributes=face_attributes,
        number_by=None,
    )


def _with_tubes(values: NDArray[Any], count: int, is_label: bool) -> NDArray[Any]:
    """Return values of faces with those of tubes behind: no segment, else the first value."""
    more = np.repeat(values[:1], count - len(values), axis=0)
    return np.concatenate([values, np.full_like(more, -1) if is_label else more])


def _balls(centers: FloatArray, radius: float) -> Solid:
    """Return a ball at each center: an octahedron, split twice."""
    ball, faces = _unit_ball(2)
    count, n = len(centers), len(ball)
    points = (np.asarray(centers)[:, None] + radius * ball).reshape(-1, 3)
    all_faces = (faces + n * np.arange(count)[:, None, None]).reshape(-1, 3)
    return points, all_faces, np.repeat(np.arange(count), n)


def _unit_ball(rounds: int) -> tuple[FloatArray, Index]:
    points = np.concatenate([np.eye(3), -np.eye(3)])
    signs = [(a, b, c) for a in (0, 3) for b in (1, 4) for c in (2, 5)]
    outward = [row if sum(i > 2 for i in row) % 2 == 0 else row[::-1] for row in signs]
    faces = np.array(outward, np.int64)
    for _ in range(rounds):
        pairs = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        edges, place = np.unique(pairs, axis=0, return_inverse=True)
        middle = unit_rows(points[edges].sum(axis=1))
        m = place.reshape(-1, 3) + len(points)
        points = np.concatenate([points, middle])
        corners = [(faces[:, k], m[:, k], m[:, k - 1]) for k in range(3)]
        faces = np.concatenate([m, *(np.stack(corner, axis=1) for corner in corners)])
    return points, faces


def _tubes(points: FloatArray, edges: NDArray[Any], radii: FloatArray) -> Solid:
    """Return tubes along all polylines of a graph, closed at their ends."""
    parts: list[Solid] = []
    first = 0
    for line in polylines(edges, len(points)):
        made, faces = _tube(points[line], radii[line])
        rows = np.concatenate([np.repeat(line, SIDES), line[[0, -1]]])
        parts.append((made, faces + first, rows))
        first += len(made)
    if not parts:
        return np.empty((0, 3)), np.empty((0, 3), np.int64), np.empty(0, np.int64)
    columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
    return columns[0], columns[1], columns[2]


def _tube(line: FloatArray, radii: FloatArray) -> tuple[FloatArray, Index]:
    """Return the rings round a polyline, the two ends, and the faces between them."""
    count = len(line)
    across, beside = _frames(line)
    turn = 2 * np.pi * np.arange(SIDES) / SIDES
    ring = np.cos(turn)[:, None] * across[:, None] + np.sin(turn)[:, None] * beside[:, None]
    points = (line[:, None] + radii[:, None, None] * ring).reshape(-1, 3)
    k, after = np.arange(SIDES), (np.arange(SIDES) + 1) % SIDES
    base = SIDES * np.arange(count - 1)[:, None]
    a, b, c, d = base + k, base + after, base + SIDES + k, base + SIDES + after
    sides = np.concatenate([np.stack([a, b, c], -1), np.stack([b, d, c], -1)]).reshape(-1, 3)
    start, end, last = SIDES * count, SIDES * count + 1, SIDES * (count - 1)
    caps = np.concatenate(
        [
            np.stack([np.full(SIDES, start), after, k], -1),
            np.stack([np.full(SIDES, end), last + k, last + after], -1),
        ]
    )
    return np.concatenate([points, line[[0, -1]]]), np.concatenate([sides, caps])


def _frames(line: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return two directions across a polyline at each point, which turn no more than it does."""
    steps = unit_rows(np.diff(line, axis=0))
    along = np.concatenate([steps[:1], steps[:-1] + steps[1:], steps[-1:]])
    norms = np.linalg.norm(along, axis=1)
    along[norms < 1e-9] = np.concatenate([steps, steps[-1:]])[norms < 1e-9]
    along[~along.any(axis=1)] = (0.0, 0.0, 1.0)
    along /= np.linalg.norm(along, axis=1)[:, None]
    across = np.empty_like(along)
    before = np.eye(3)[np.abs(along[0]).argmin()]
    for i, direction in enumerate(along):
        flat = before - (before @ direction) * direction
        if flat @ flat < 1e-12:
            flat = np.cross(direction, np.eye(3)[np.abs(direction).argmin()])
        before = across[i] = flat / np.linalg.norm(flat)
    return across, np.cross(along, across)
