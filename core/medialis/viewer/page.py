"""The page of the viewer: everything inside, nothing loaded from elsewhere."""

from __future__ import annotations

import base64
import functools
import html
import json
import math
import os
import zlib
from collections.abc import Sequence
from importlib import resources
from typing import TYPE_CHECKING, Any

import numpy as np

from medialis.errors import FileError
from medialis.files._files import complete_file
from medialis.render.colors import color_table, palette, value_range
from medialis.render.framing import default_view
from medialis.validation import FloatArray
from medialis.viewer.packing import Packer, point_codes, value_codes
from medialis.viewer.scene import Field, Part, Scene, Spot, scene_of

if TYPE_CHECKING:
    from medialis.operations.result import Outcome

LIBRARY = "three.js"
SCRIPTS = ("unpack", "shaders", "parts", "viewer", "picking", "legend", "panel", "start")
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
    text = viewer_page(results, title)
    with complete_file(path) as stream:
        stream.write(text.encode("utf-8", "backslashreplace"))


def viewer_page(results: Sequence[Outcome], title: str = "medialis") -> str:
    """Return the page as text.

    Raises
    ------
    FileError
        When the library that it draws with is missing.
    """
    library = _library()
    packer = Packer()
    scene = json.dumps(_described(scene_of(results, title), packer), allow_nan=False)
    scene = scene.replace("<", "\\u003c")  # a name must not end the script
    data = {"scene": scene, "arrays": packer.text(), "library": library}
    scripts = "\n".join(_text(f"{name}.js") for name in SCRIPTS)
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{html.escape(title)}</title><style>\n{_text('viewer.css')}</style></head><body>\n"
        f"{_text('page.html')}"
        + "".join(
            f'<script type="text/plain" id="{id}">{text}</script>\n' for id, text in data.items()
        )
        + f"<script>\n{scripts}</script>\n</body></html>\n"
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
            "`make viewer` fetches it (npm is needed, which comes with Node.js); wheels have it."
        )
    data = (resources.files(__package__) / LIBRARY).read_bytes()
    return base64.b64encode(zlib.compress(data, 9)).decode()


def _text(name: str) -> str:
    return (resources.files(__package__) / name).read_text("utf-8")


def _described(scene: Scene, packer: Packer) -> dict[str, Any]:
    """Return the scene as plain data; its arrays go to the packer.

    All places are relative to the middle of the shape: graphics cards have single precision.
    """
    low, high = scene.shape.bounds
    origin = (low + high) / 2
    direction, up = default_view(scene.shape.points)
    parts = [_part(part, origin, packer) for part in scene.parts]
    maps = {field["map"] for part in parts for field in part["fields"]}
    return {
        "title": scene.title,
        "notes": scene.notes,
        "unit": scene.shape.unit,
        "diagonal": scene.shape.diagonal or 1.0,
        "origin": origin.tolist(),
        "half": ((high - low) / 2).tolist(),
        "direction": np.asarray(direction).tolist(),
        "up": np.asarray(up).tolist(),
        "parts": parts,
        "spots": [_spot(spot, origin) for spot in scene.spots],
        "maps": {name: _colors(color_table(name), COLORS) for name in sorted(maps)},
        "palette": _colors(palette()),
    }


def _part(part: Part, origin: FloatArray, packer: Packer) -> dict[str, Any]:
    names = [field.name for field in part.fields]
    codes, place = point_codes(part.points - origin)
    return {
        "title": part.title,
        "kind": part.kind,
        "visible": part.visible,
        "opacity": part.opacity,
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
    begin = (field.shown_from - low) / ((high - low) or 1.0)
    return {
        "name": field.name,
        "title": field.name.replace("_", " "),
        "unit": field.unit,
        "label": field.is_label,
        "map": field.color_map,
        **place,
        "limits": list(value_range([low, high], *field.limits)),
        "infinite": bool(np.isposinf(np.asarray(field.values, float)).any()),
        "from": float(np.clip(begin, 0.0, 1.0)),
        "codes": packer.add(codes),
    }


def _spot(spot: Spot, origin: FloatArray) -> dict[str, Any]:
    known = not np.isnan(spot.opposite).any()
    return {
        "position": (spot.position - origin).tolist(),
        "opposite": (spot.opposite - origin).tolist() if known else None,
        "value": spot.value if math.isfinite(spot.value) else 0.0,
        "kind": spot.kind,
    }


def _colors(rgb: Any, count: int | None = None) -> str:
    """Return colours (n, 3) in 0..1 as base64 of their bytes; `count` of them."""
    if count is not None:
        rgb = rgb[np.linspace(0, len(rgb) - 1, count).round().astype(int)]
    return base64.b64encode(np.rint(255 * np.asarray(rgb)).astype(np.uint8).tobytes()).decode()
