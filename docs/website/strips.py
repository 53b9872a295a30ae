"""Strips of small pictures: an operation at several values of one parameter, low to high.

Every picture is kept under a hash of the core and of this folder, so that a second build of the
same state draws nothing anew.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import medialis
from medialis.operations.declaration import Operation, Parameter
from medialis.operations.pictures import draw_result
from medialis.render.png import write_png
from website.pages import ROOT
from website.parameter_values import BASE, SHAPES, creature, example_of

SIZE = (400, 320)
BACKGROUND = ("samples", "diagonal", "spacing")
"""Values that say more about the input than about the result."""


@dataclass(frozen=True)
class Panel:
    """One picture of a strip: the file, or the sentence that says why there is none."""

    value: Any
    picture: str | None
    values: Mapping[str, Any]
    error: str = ""


def state() -> str:
    """Return a hash of all that can change a picture."""
    digest = hashlib.sha256()
    for folder in (ROOT / "core", ROOT / "docs"):
        for path in sorted(folder.rglob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


def picture_of(result: medialis.Result, size: tuple[int, int] = SIZE) -> NDArray[np.uint8]:
    """Return the picture of a result: its own last image, else its first layer."""
    if not result.images:
        return draw_result(result, width=size[0], height=size[1])
    image = list(result.images.values())[-1]
    step = max(1, round(image.shape[1] / (2 * size[0])))
    height, width = (step * (n // step) for n in image.shape[:2])
    blocks = image[:height, :width].reshape(height // step, step, width // step, step, 3)
    return blocks.mean(axis=(1, 3)).round().astype(np.uint8)


def default_picture(operation: Operation, folder: Path) -> str:
    """Draw an operation at its defaults for the gallery, and return the name of the file."""
    name = f"default-{operation.name}.png"
    if not (folder / name).exists():
        shape = SHAPES.get(operation.name, creature)()
        result = medialis.run(operation.name, shape, **BASE.get(operation.name, dict)())
        write_png(folder / name, picture_of(result, (560, 420)))
    return name


def strip(operation: Operation, parameter: Parameter, folder: Path) -> list[Panel]:
    """Run an operation at the values of a parameter, and draw each result.

    An empty list: the parameter has no values to draw, or they all give the same.
    """
    example = example_of(operation, parameter)
    panels = [
        _panel(operation, example.shape, {**example.others, parameter.name: value}, value, folder)
        for value in example.values
    ]
    looks = {(panel.error, _bytes(panel, folder), repr(panel.values)) for panel in panels}
    return panels if len(looks) > 1 else []


def _bytes(panel: Panel, folder: Path) -> bytes:
    return (folder / panel.picture).read_bytes() if panel.picture else b""


def _panel(
    operation: Operation, shape: Any, given: dict[str, Any], value: Any, folder: Path
) -> Panel:
    key = repr((operation.name, shape.__name__, sorted(given.items())))
    name = f"{operation.name}-{hashlib.sha256(key.encode()).hexdigest()[:12]}.png"
    record = (folder / name).with_suffix(".json")
    if not record.exists():
        known: dict[str, Any] = {"values": {}, "error": ""}
        try:
            result = medialis.run(operation.name, shape(), **given)
            write_png(folder / name, picture_of(result))
            known["values"] = dict(result.values)
        except medialis.MedialisError as error:  # a sentence for users is worth showing
            known["error"] = str(error)
        record.write_text(json.dumps(known), encoding="utf-8")
    known = json.loads(record.read_text(encoding="utf-8"))
    picture = None if known["error"] else name
    return Panel(value, picture, known["values"], known["error"])


def main_value(panels: Sequence[Panel]) -> str | None:
    """Return the name of the first number that differs between the pictures."""
    good = [panel.values for panel in panels if not panel.error]
    numbers = [
        name
        for name, value in (good[0] if good else {}).items()
        if isinstance(value, int | float) and not isinstance(value, bool)
    ]
    changing = [n for n in numbers if len({repr(values.get(n)) for values in good}) > 1]
    ranked = sorted(changing, key=lambda name: name in BACKGROUND)
    return (ranked or [None])[0]
