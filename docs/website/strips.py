"""Strips of small pictures: an operation at several values of one parameter, low to high.

Every picture is kept under a hash of the core and of this folder, so that a second build of the
same state draws nothing anew. A run that several strips show, as that at the defaults, is one file.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import medialis
from medialis.operations.declaration import Operation, Parameter
from medialis.show.picture import draw_result
from medialis.show.png import write_png
from medialis.show.viewer.page import has_library
from website.pages import ROOT
from website.parameter_values import BASE, default_shape, example_of

SIZE = (400, 320)
GRAIN = 16
"""Pixels of a cell, a twentieth of a picture."""

SEEN = 16
"""Steps of 255 by which a cell must change in colour to be noticed."""

BACKGROUND = ("samples", "diagonal", "spacing")
"""Values that say more about the input than about the result."""


@dataclass(frozen=True)
class Panel:
    """One picture of a strip: the file, or the sentence that says why there is none."""

    value: Any
    picture: str | None
    values: Mapping[str, Any]
    error: str = ""
    glance: Sequence[Any] = ()


def state() -> str:
    """Return a hash of all that can change a picture."""
    digest = hashlib.sha256()
    for folder in (ROOT / "core", ROOT / "docs"):
        for path in sorted(folder.rglob("*")):
            if path.suffix in (".py", ".js", ".css", ".html"):
                digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


def picture_of(
    result: medialis.Result,
    size: tuple[int, int] = SIZE,
    layer: str = "",
    color_by: str | None = None,
) -> NDArray[np.uint8]:
    """Return the picture of a result: the named layer, else its own last image or first layer."""
    for chosen in result.layers:
        if chosen.name == layer:
            result = replace(result, shown=(chosen,), images={})
    if not result.images:
        options = {"width": size[0], "height": size[1], "style": medialis.Style(legend=False)}
        return draw_result(result, color_by=color_by, **options)
    image = list(result.images.values())[-1]
    step = max(1, round(image.shape[1] / (2 * size[0])))
    height, width = (step * (n // step) for n in image.shape[:2])
    blocks = image[:height, :width].reshape(height // step, step, width // step, step, 3)
    return blocks.mean(axis=(1, 3)).round().astype(np.uint8)


def default_picture(operation: Operation, folder: Path) -> str:
    """Draw an operation at its defaults for the gallery, and return the name of the file."""
    name = f"default-{operation.name}.png"
    if not (folder / name).exists():
        shape = default_shape(operation)()
        result = medialis.run(operation.name, shape, **BASE.get(operation.name, dict)())
        write_png(folder / name, picture_of(result, (560, 420)))
    return name


def default_viewer(operation: Operation, folder: Path) -> str:
    """Make the page of an operation at its defaults in three dimensions; return its name."""
    name = f"viewers/{operation.name}.html"
    if has_library() and not (folder / name).exists():
        (folder / name).parent.mkdir(exist_ok=True)
        shape = default_shape(operation)()
        result = medialis.run(operation.name, shape, **BASE.get(operation.name, dict)())
        result.viewer_html(folder / name, title=operation.label)
    return name if (folder / name).exists() else ""


@dataclass(frozen=True)
class Tile:
    """One run to draw: an operation, a shape, and the parameters that are not at their default."""

    operation: Operation
    shape: Callable[[], medialis.Shape]
    given: tuple[tuple[str, Any], ...]
    layer: str = ""
    color_by: str | None = None

    @property
    def file(self) -> str:
        """Name of the picture."""
        look = (self.shape.__name__, self.given, self.layer, self.color_by)
        key = repr((self.operation.name, *look))
        return f"{self.operation.name}-{hashlib.sha256(key.encode()).hexdigest()[:12]}.png"

    def draw(self, folder: Path) -> None:
        """Run the operation and save picture and values, where they are not there yet."""
        record = (folder / self.file).with_suffix(".json")
        if record.exists():
            return
        known: dict[str, Any] = {"values": {}, "error": ""}
        try:
            result = medialis.run(self.operation.name, self.shape(), **dict(self.given))
            picture = picture_of(result, SIZE, self.layer, self.color_by)
            write_png(folder / self.file, picture)
            known |= {"values": dict(result.values), "glance": _glance(picture)}
        except medialis.MedialisError as error:  # a sentence for users is worth showing
            known["error"] = str(error)
        record.write_text(json.dumps(known), encoding="utf-8")


def tiles(operation: Operation, parameter: Parameter) -> list[Tile]:
    """Return the runs of a strip, one for each value of the parameter."""
    example = example_of(operation, parameter)
    defaults = {p.name: p.default for p in operation.parameters}
    found = []
    for value in example.values:
        all_given = {**example.others, parameter.name: value}
        changed = sorted(item for item in all_given.items() if item[1] != defaults[item[0]])
        given = tuple(changed)
        found.append(Tile(operation, example.shape, given, example.layer, example.color_by))
    return found


def strip(operation: Operation, parameter: Parameter, folder: Path) -> list[Panel]:
    """Run an operation at the values of a parameter, and draw each result.

    An empty list: the parameter has no values to draw, or they all give the same.
    """
    values = example_of(operation, parameter).values
    panels = [
        _panel(tile, value, folder)
        for tile, value in zip(tiles(operation, parameter), values, strict=True)
    ]
    looks = {(panel.error, _bytes(panel, folder), repr(panel.values)) for panel in panels}
    return panels if len(looks) > 1 else []


def can_be_seen(panels: Sequence[Panel]) -> bool:
    """Tell whether the pictures of a strip differ for somebody who glances at them."""
    glances = [panel.glance for panel in panels]
    if any(panel.error for panel in panels) or len({np.shape(glance) for glance in glances}) > 1:
        return True
    return bool(np.ptp(np.array(glances), axis=0).max() > SEEN)


def _glance(picture: NDArray[np.uint8]) -> list[list[list[int]]]:
    """Return the picture in cells of GRAIN pixels: the mean colour of each."""
    height, width = (n // GRAIN for n in picture.shape[:2])
    cells = picture[: height * GRAIN, : width * GRAIN].reshape(height, GRAIN, width, GRAIN, 3)
    return cells.mean(axis=(1, 3)).round().astype(int).tolist()


def _bytes(panel: Panel, folder: Path) -> bytes:
    return (folder / panel.picture).read_bytes() if panel.picture else b""


def _panel(tile: Tile, value: Any, folder: Path) -> Panel:
    tile.draw(folder)
    known = json.loads((folder / tile.file).with_suffix(".json").read_text(encoding="utf-8"))
    picture = None if known["error"] else tile.file
    return Panel(value, picture, known["values"], known["error"], known.get("glance", []))


def changing_values(panels: Sequence[Panel]) -> list[str]:
    """Return the names of the numbers that differ between the pictures, the telling ones first."""
    good = [panel.values for panel in panels if not panel.error]
    numbers = [
        name
        for name, value in (good[0] if good else {}).items()
        if isinstance(value, int | float) and not isinstance(value, bool)
    ]
    changing = [n for n in numbers if len({repr(values.get(n)) for values in good}) > 1]
    return sorted(changing, key=lambda name: name in BACKGROUND)
