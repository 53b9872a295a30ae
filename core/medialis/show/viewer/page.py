"""The page of the viewer, in five steps: text of arrays, scene, words, page, where it is shown.

The scene is what is shown of results: surfaces, points and curves with values. Words are the places
that were found and the numbers, as on the screen of the command line: they are there without WebGL.
Layers that lie on the same surface become one surface with all their values; where no layer lies on
the surface, the shape itself is shown see-through.

Arrays become text: points and values are rounded to 16 bits of their range. Neighbours in a mesh
are alike, so that the differences between rows are small: their low and high bytes, each in a row,
deflate well. The page undoes it (`unpack.js`). It has everything inside and loads nothing from
elsewhere; it is shown where the user is, in a notebook or in the browser.
"""

from __future__ import annotations

import base64
import functools
import html
import importlib
import json
import math
import os
import re
import sys
import tempfile
import webbrowser
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.base.errors import FileError
from medialis.base.options import AREAS, LENGTHS, RADIANS
from medialis.base.validation import FloatArray, IntArray
from medialis.formats.files import write_text
from medialis.operations.result import INNER, value_rows, value_text, value_words
from medialis.show.borders import cut_by_labels
from medialis.show.camera import shape_view
from medialis.show.colors import color_table, palette, value_range
from medialis.show.picture import draw_result, line_edges
from medialis.show.png import encode_png
from medialis.show.reports.page import data_text, page

if TYPE_CHECKING:
    from medialis.operations.result import Layer, Outcome
    from medialis.shape.shape import Shape

LEVELS = 65_533
"""The largest code of a finite value."""

INFINITE, MISSING = 65_534, 65_535


@dataclass
class Packer:
    """Collects arrays of whole numbers; the text of all of them goes into the page."""

    blocks: list[bytes] = field(default_factory=list)
    size: int = 0

    def add(self, values: ArrayLike, *, differences: bool = True) -> dict[str, int]:
        """Add (n,) or (n, d) whole numbers within 2^31; return where they lie.

        Each column is stored as differences from row to row, or as it is. Small numbers of either
        sign become small ones from 0; first come their lowest bytes, then the next ones.
        """
        table = np.asarray(values, np.int64)
        columns = table[:, None] if table.ndim == 1 else table
        steps = np.diff(columns, axis=0, prepend=0) if differences else columns
        flat = steps.T.ravel()
        folded = ((flat << 1) ^ (flat >> 63)).astype("<u8")
        width = max(1, (int(folded.max(initial=0)).bit_length() + 7) // 8)
        block = folded.view(np.uint8).reshape(-1, 8).T[:width].tobytes()
        where = {"at": self.size, "rows": len(columns), "columns": columns.shape[1], "bytes": width}
        self.blocks.append(block)
        self.size += len(block)
        return {**where, "differences": int(differences)}

    def add_faces(self, faces: NDArray[np.int32]) -> list[dict[str, int]]:
        """Add triangles, sorted by their lowest corner, and turned so that it comes first.

        The other two corners are stored as what they lie above it: a sixth of the text.
        """
        first = faces.argmin(axis=1)[:, None]
        turned = np.take_along_axis(faces.astype(np.int64), (first + np.arange(3)) % 3, axis=1)
        turned = turned[np.lexsort((turned[:, 1], turned[:, 0]))]
        return [self.add(turned[:, 0]), self.add(turned[:, 1:] - turned[:, :1], differences=False)]

    def text(self) -> str:
        """Return all of them, deflated, as base64."""
        return base64.b64encode(zlib.compress(b"".join(self.blocks), 7)).decode()


def point_codes(points: NDArray[np.float64]) -> tuple[NDArray[np.int64], dict[str, Any]]:
    """Return points (n, 3) as whole numbers up to 65535, and how to get them back.

    Points are `low + step * code`; a step is the longest side of their box over 65535.
    """
    low = points.min(axis=0, initial=np.inf) if len(points) else np.zeros(3)
    size = float((points.max(axis=0) - low).max()) if len(points) else 0.0
    step = size / 65_535 or 1.0
    return np.rint((points - low) / step).astype(np.int64), {"low": low.tolist(), "step": step}


def value_codes(values: NDArray[Any]) -> tuple[NDArray[np.int64], dict[str, Any]]:
    """Return numbers (n,) as codes of their finite range, with codes for infinity and NaN."""
    numbers = np.asarray(values, np.float64)
    finite = np.isfinite(numbers)
    known = numbers[finite] if finite.any() else np.array([0.0, 1.0])
    low, high = float(known.min()), float(known.max())
    share = np.zeros(len(numbers))
    share[finite] = (numbers[finite] - low) / ((high - low) or 1.0)
    codes = np.rint(LEVELS * share).astype(np.int64)
    codes[~finite] = np.where(numbers[~finite] == np.inf, INFINITE, MISSING)
    return codes, {"low": low, "high": high}


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
    shown_from, shown_to : float
        Points below and above are hidden at first, and grey on surfaces; infinite hides none.
    classes : tuple of (str, (float, float, float))
        Name and colour of each label; the palette where there are none.
    """

    name: str
    values: NDArray[Any]
    unit: str = ""
    is_label: bool = False
    color_map: str = "sequential"
    limits: tuple[float | None, float | None] = (None, None)
    shown_from: float = -math.inf
    shown_to: float = math.inf
    classes: tuple[tuple[str, tuple[float, float, float]], ...] = ()


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
    role: str = ""

    def lies_on(self, points: FloatArray, faces: IntArray | None) -> bool:
        """Tell whether these are the same points and faces."""
        if (self.faces is None) != (faces is None) or self.points.shape != points.shape:
            return False
        same = self.faces is None or np.array_equal(self.faces, faces)  # type: ignore[arg-type]
        return bool(same and np.array_equal(self.points, points))


def scene_of(results: Sequence[Outcome]) -> list[Part]:
    """Return what is shown of one or more results of the same shape; of the later ones, hidden.

    Points and fields of the first result are seen at first. Where that is a field on the surface,
    the places that it marks are hidden: their numbers say where they are.
    """
    parts: list[Part] = []
    for number, result in enumerate(results):
        on_surface = number == 0 and any(layer.on_input for layer in result.layers[:1])
        for layer in _layers(result):
            if layer.name != SPOTS:
                marks = on_surface and layer.faces is None and layer.edges is None
                marks &= not layer.on_input and not layer.auxiliary
                _add(parts, layer, visible=number == 0 and not marks and layer.role != "hidden")
    # In a folder without the shape a layer stands in for it; the envelope is what is known of it.
    first = results[0]
    own = [layer.points for layer in first.layers if layer.role]
    is_known = not any(np.array_equal(points, first.shape.points) for points in own)
    shape = first.shape if is_known else None
    if shape is not None and not any(_stands_for(part, shape) for part in parts):
        if shape.faces is None:
            parts.insert(0, Part("shape", "points", shape.points))
        else:
            parts.insert(0, Part("surface", "surface", shape.points, shape.faces))
    _choose(parts, shape)
    return parts


def _layers(result: Outcome) -> list[Layer]:
    """Layers that are worth showing; where pictures show a finer copy of one, that one."""
    look, found = (result.shown[0] if result.shown else None), []
    for layer in result.layers:
        if look is not None and layer.on_input and (look.auxiliary or look.name == layer.name):
            found.append(look)
            look = None
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
    lines: Kind = "points" if layer.edges is None else "curves"
    kind: Kind = lines if layer.faces is None else "surface"
    names = [one.name for one in fields]
    parts.append(
        Part(
            _title(layer, parts),
            kind,
            layer.points,
            layer.faces,
            line_edges(layer),
            fields,
            layer.color_by if layer.color_by in names else next(iter(names), None),
            layer.filter_by if layer.filter_by in names else None,
            visible,
            role=_role(layer),
        )
    )


def _role(layer: Layer) -> str:
    """Return "balls" for balls that nothing joins: they are drawn as large as they are."""
    if layer.role == "balls" or "json" in layer.formats:
        bare = layer.faces is None and layer.edges is None and "radius" in layer.attributes
        return "balls" if bare else ""
    return layer.role


def _title(layer: Layer, parts: list[Part]) -> str:
    on_surface = layer.on_input or layer.name == "samples"
    if on_surface and not any(part.title == "surface" for part in parts):
        return "surface"
    return value_words(layer.name)


def _fields(layer: Layer) -> list[Field]:
    found = []
    for name, values in layer.attributes.items():
        array = np.asarray(values)
        if array.ndim != 1 or array.dtype.kind not in "fiub" or name in NUMBERS_ONLY:
            continue
        if name == "side" and len(np.unique(array)) == 1:
            continue
        own = name == layer.color_by
        classes = layer.classes if own else ()
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
                (name in layer.labels or bool(classes)) and array.dtype.kind in "iub",
                layer.color_map if own else "sequential",
                layer.color_limits if own else (None, None),
                first,
                math.inf if layer.color_limit is None or not own else layer.color_limit,
                classes,
            )
        )
    return found


def _unit(layer: Layer, name: str) -> str:
    if name in RADIANS:
        return "degrees"
    if name in AREAS or (name == layer.filter_by and layer.filter_unit.power == 2):
        return "area"
    return "length" if name in LENGTHS else ""


def _stands_for(part: Part, shape: Shape | None) -> bool:
    """Tell whether a part is the surface of the shape, and not one inside of it, or its points."""
    if shape is None:
        return part.title.endswith(" envelope")
    if part.role:
        return False
    if part.kind != "surface":
        return shape.faces is None and part.points.shape == shape.points.shape
    size = part.points.max(axis=0) - part.points.min(axis=0)
    low, high = shape.bounds
    return bool(np.abs(size - (high - low)).max() < 0.02 * shape.diagonal)


def _choose(parts: list[Part], shape: Shape | None) -> None:
    """Let what the result is about be seen: the shape round it is see-through, or hidden.

    Where there are triangles inside, the points that they are made of are hidden; where these take
    the place of the shape, as the midsurface does, the shape is.
    """
    outer = [part for part in parts if part.kind == "surface" and _stands_for(part, shape)]
    inner = [part for part in parts if part.kind == "surface" and part not in outer]
    if any(part.visible for part in inner):
        for part in parts:
            part.visible &= part.kind != "points"
    seen = [part for part in parts if part.visible and part not in outer]
    if seen:
        for part in outer:
            part.visible = part is outer[0] and not any(one.role == "shape" for one in seen)
            part.opacity = 0.2
            if seen[0].fields:
                part.color_by = None


Row = Mapping[str, Any]


def _thin_spot(row: Row, unit: str | None) -> str:
    return value_text("value", row["value"], unit) + _but("wall", row)


def _region(row: Row, unit: str | None) -> str:
    text = f"{row['kind']}, {value_text('value', row['value'], unit)}"
    if row.get("area") is None:
        return text
    return f"{text}, {value_text('area', row['area'], unit)} of one side"


def _rib(row: Row, unit: str | None) -> str:
    own, wall = (value_text("thickness", row[name], unit) for name in ("thickness", "wall"))
    return f"{row['kind']}, {own} on a wall of {wall} (ratio {value_text('', row['ratio'])})"


def _but(usual: str, row: Row) -> str:
    kind = row.get("kind", usual)
    return "" if kind == usual else f", {kind}"


TABLES: dict[str, tuple[str, str, Callable[[Row, str | None], str]]] = {
    "spots": ("Thin spots", "thin spot", _thin_spot),
    "regions": ("Regions", "region", _region),
    "ribs": ("Ribs and bosses", "rib", _rib),
}
"""Heading, what one of them is, and what is said of it, by the name of the value."""


def places_of(results: Sequence[Outcome], origin: FloatArray) -> list[dict[str, Any]]:
    """Return the places that results list, numbered as on the screen; positions from `origin`.

    Those of the first table are numbered on the shape; ribs only in their list.
    """
    found: list[dict[str, Any]] = []
    for name, (heading, noun, words) in TABLES.items():
        table = next((rows for rows in (_rows(one, name) for one in results) if rows), ())
        unit = results[0].shape.unit
        on_shape = not any(one["onShape"] for one in found)
        for number, row in enumerate(table, 1):
            value = float(row.get("value") or row.get("thickness") or 0.0)
            found.append(
                {
                    "table": name,
                    "heading": heading,
                    "noun": noun,
                    "number": number,
                    "text": words(row, unit),
                    "position": (np.array(row["position"], float) - origin).tolist(),
                    "opposite": _opposite(row, origin),
                    "value": value if math.isfinite(value) else 0.0,
                    "kind": str(row.get("kind", "wall")),
                    "onShape": on_shape and name != "ribs",
                }
            )
    return found


def _rows(result: Outcome, name: str) -> list[Row]:
    """Return a table of places of a result; what a damaged manifest has is no place."""
    rows = result.values.get(name)
    needed = {"ribs": ("position", "thickness", "wall", "ratio", "kind")}.get(name, ("position",))
    return [
        row
        for row in (rows if isinstance(rows, list | tuple) else ())
        if isinstance(row, dict)
        and all(row.get(one) is not None for one in needed)
        and (name == "ribs" or row.get("value") is not None)
        and (name != "regions" or "kind" in row)
    ]


def _opposite(row: Row, origin: FloatArray) -> list[float] | None:
    other = np.array(row.get("opposite") or [math.nan] * 3, float)
    return None if np.isnan(other).any() else (other - origin).tolist()


def numbers_of(results: Sequence[Outcome]) -> Iterator[tuple[str, str]]:
    """Yield what a table says of the first result: names and values with their unit."""
    first = results[0]
    known = {name: v for name, v in first.values.items() if v is not None and name not in INNER}
    yield from value_rows(known, first.shape.unit)


STILL = 720, 540
"""Pixels of the picture that stands for the canvas where there is no WebGL."""


def still_of(results: Sequence[Outcome]) -> str:
    """Return the picture of the first result as the address of an image; "": it has none."""
    first = results[0]
    images = list(first.images.values())
    if not images and first.layers:
        images = [draw_result(first, width=STILL[0], height=STILL[1])]
    if not images:
        return ""
    return f"data:image/png;base64,{base64.b64encode(encode_png(images[0])).decode()}"


LIBRARY = "three.js"
SCRIPTS = (
    *("unpack", "shaders", "parts", "viewer", "picking", "legend", "facts", "panel", "start"),
)
COLORS = 256


def write_viewer(
    path: str | os.PathLike[str], results: Sequence[Outcome], title: str = "medialis"
) -> None:
    """Write a page that shows results of one shape; the first one is seen at first.

    Raises
    ------
    FileError
        When the page cannot be written, or the library that it draws with is missing.
    """
    write_text(path, viewer_page(results, title))


def viewer_page(results: Sequence[Outcome], title: str = "medialis", *, still: bool = True) -> str:
    """Return the page as text; with the picture that stands for the canvas without WebGL.

    Raises
    ------
    FileError
        When the library that it draws with is missing.
    """
    library = _library()
    packer = Packer()
    scene = json.dumps(_described(results, title, packer), allow_nan=False)
    scene = scene.replace("<", "\\u003c")  # a name must not end the script
    data = {"scene": scene, "arrays": packer.text(), "library": library}
    scripts = "\n".join(_text(f"{name}.js") for name in SCRIPTS)
    return page(
        title,
        _text("viewer.css"),
        _text("page.html").removesuffix("\n").replace("STILL", still_of(results) if still else ""),
        *(f'<script type="text/plain" id="{id}">{text}</script>' for id, text in data.items()),
        f"<script>\n{scripts}</script>",
    )


def has_library() -> bool:
    """Tell whether pages can be made: checkouts build the library first."""
    return (resources.files(__package__) / LIBRARY).is_file()


@functools.lru_cache(maxsize=1)
def _library() -> str:
    """Return the library deflated, as base64."""
    if not has_library():
        raise FileError(
            "The viewer draws with three.js, which this installation lacks: in a checkout, "
            "`make viewer` fetches it (npm is needed); wheels have it."
        )
    data = (resources.files(__package__) / LIBRARY).read_bytes()
    return base64.b64encode(zlib.compress(data, 9)).decode()


def _text(name: str) -> str:
    return data_text("medialis.show.viewer", name)


def _described(results: Sequence[Outcome], title: str, packer: Packer) -> dict[str, Any]:
    """Return the scene as plain data; its arrays go to the packer.

    All places are relative to the middle of the shape: graphics cards have single precision.
    """
    shown, shape = scene_of(results), results[0].shape
    low, high = shape.bounds
    origin = (low + high) / 2
    direction, up = shape_view(shape)
    parts = [_part(part, origin, packer) for part in shown]
    notes = (str(note) for result in results for note in getattr(result, "messages", ()))
    maps = {field["map"] for part in parts for field in part["fields"]}
    return {
        "title": title,
        "notes": list(dict.fromkeys(notes)),
        "unit": shape.unit,
        "diagonal": _size(results[0]) or 1.0,
        "origin": origin.tolist(),
        "half": ((high - low) / 2).tolist(),
        "direction": np.asarray(direction).tolist(),
        "up": np.asarray(up).tolist(),
        "parts": parts,
        "places": places_of(results, origin),
        "numbers": list(numbers_of(results)),
        "maps": {name: _colors(color_table(name), COLORS) for name in sorted(maps)},
        "palette": _colors(palette()),
    }


def _size(result: Outcome) -> float:
    """Return the diagonal that the result tells; what was refined or is inside has another one."""
    told = result.values.get("diagonal")
    return told if isinstance(told, float) else result.shape.diagonal


def with_borders(part: Part) -> Part:
    """Return a surface that shows labels with its triangles cut at their borders: no saw-teeth.

    Each side has points of its own there, so that all corners of a triangle have one label.
    """
    shown = next((one for one in part.fields if one.name == part.color_by), None)
    if part.faces is None or shown is None or not shown.is_label:
        return part
    count, labels = len(part.points), np.asarray(shown.values, np.int32)
    cut = cut_by_labels(part.points, part.faces, labels)
    side = np.repeat(cut.side[:, None], 3, axis=1)
    new = cut.faces >= count
    pairs, row = np.unique(
        np.stack([cut.faces[new], side[new]], axis=1), axis=0, return_inverse=True
    )
    faces = cut.faces.copy()
    faces[new] = count + row.reshape(-1)
    ends = cut.shares[pairs[:, 0] - count]
    first, second = ends[:, :2].astype(np.int64).T

    def continued(field: Field) -> Field:
        values = np.asarray(field.values)
        nearer = values[np.where(ends[:, 2] < 0.5, first, second)]
        if field is shown:
            nearer = pairs[:, 1].astype(values.dtype)
        elif not field.is_label and values.dtype.kind == "f":
            between = values[first] + ends[:, 2] * (values[second] - values[first])
            nearer = np.where(np.isfinite(between), between, nearer)
        return replace(field, values=np.concatenate([values, nearer]))

    points = np.concatenate([part.points, cut.points[pairs[:, 0]]])
    fields = [continued(field) for field in part.fields]
    return replace(part, points=points, faces=faces, fields=fields)


def _part(part: Part, origin: FloatArray, packer: Packer) -> dict[str, Any]:
    told = len(part.points if part.faces is None else part.faces)
    part = with_borders(part)
    names = [field.name for field in part.fields]
    codes, place = point_codes(part.points - origin)
    return {
        **{name: getattr(part, name) for name in ("title", "kind", "visible", "opacity", "role")},
        "told": told,
        "points": {**place, "codes": packer.add(codes)},
        "faces": None if part.faces is None else packer.add_faces(part.faces),
        "edges": None if part.edges is None else packer.add(part.edges),
        "fields": [_field(field, packer) for field in part.fields],
        "colorBy": None if part.color_by is None else names.index(part.color_by),
        "filterBy": None if part.filter_by is None else names.index(part.filter_by),
    }


def _field(field: Field, packer: Packer) -> dict[str, Any]:
    if field.is_label:
        codes, place = np.asarray(field.values, np.int64) + 1, {"low": 0.0, "high": 1.0}
    else:
        codes, place = value_codes(field.values)
    low, high = place["low"], place["high"]
    span = (high - low) or 1.0
    begin, end = ((at - low) / span for at in (field.shown_from, field.shown_to))
    return {
        "name": field.name,
        "title": value_words(field.name),
        "unit": field.unit,
        "label": field.is_label,
        "map": field.color_map,
        **place,
        "limits": list(value_range([low, high], *field.limits)),
        "infinite": bool(np.isposinf(np.asarray(field.values, float)).any()),
        "from": float(np.clip(begin, 0.0, 1.0)),
        "to": float(np.clip(end, 0.0, 1.0)),
        "classes": [name for name, _ in field.classes],
        "colors": _colors([color for _, color in field.classes]) if field.classes else None,
        "codes": packer.add(codes),
    }


def _colors(rgb: Any, count: int | None = None) -> str:
    """Return colours (n, 3) in 0..1 as base64 of their bytes; `count` of them."""
    if count is not None:
        rgb = rgb[np.linspace(0, len(rgb) - 1, count).round().astype(int)]
    return base64.b64encode(np.rint(255 * np.asarray(rgb)).astype(np.uint8).tobytes()).decode()


HEIGHT = 560
"""Pixels in a notebook."""


def show_page(text: str, name: str) -> Path | None:
    """Show a page in the notebook that asks, else in the browser.

    Returns
    -------
    Path or None
        The file that the browser was given; None in a notebook.
    """
    shell = _notebook()
    if shell is not None:
        display = importlib.import_module("IPython.display")
        # As data: `HTML` warns of frames, and advises one that has no page inside.
        display.display({"text/html": frame(text), "text/plain": name}, raw=True)
        return None
    words = re.sub(r"\W+", "-", name).strip("-") or "view"
    path = Path(tempfile.mkdtemp(prefix="medialis-")) / f"{words}.html"
    write_text(path, text)
    webbrowser.open(path.as_uri())
    return path


def frame(text: str, height: int = HEIGHT, title: str = "the result in three dimensions") -> str:
    """Return a page as a frame for another page, with all that it needs inside."""
    return (
        f'<iframe title="{html.escape(title)}" srcdoc="{html.escape(text)}" '
        f'width="100%" height="{height}" '
        'style="border:0;border-radius:10px" allow="fullscreen"></iframe>'
    )


def _notebook() -> Any:
    """Return the shell of the notebook that runs this, None elsewhere (IPython in a terminal)."""
    if "IPython" not in sys.modules:
        return None
    shell = importlib.import_module("IPython").get_ipython()
    return shell if hasattr(shell, "kernel") else None
