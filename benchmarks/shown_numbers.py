"""Whether numbers that are shown agree with each other, and with the truth.

    python benchmarks/shown_numbers.py [SHAPE ...] [--folder FOLDER]

Shapes of known size in millimetres go through the command line, as a user types it. Each number on
the screen, in notes, in the legend of the picture, on the page of `medialis view` and in the table
of a batch is held against the manifest, the manifest against closed forms, and operations on the
same shape against each other. Every contradiction is a line; the exit status is 1 when there is
one. About 100 s of processor time.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
from shown_suite import surfaces
from shown_suite.shapes import Known, chosen
from shown_suite.surfaces import Told

import medialis
from medialis.cli import main as command
from medialis.operations.result import quantity
from medialis.show import annotation, marks

UNIT = "mm"
BY_QUANTITY = {"length": UNIT, "area": f"{UNIT}²", "angle": "degrees"}

MOST_LINES, LONGEST = 25, 160


def main(arguments: Sequence[str] | None = None) -> int:
    """Parse the command line, run all, print contradictions; return the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("shapes", nargs="*", help="names of shapes; all when there is none")
    parser.add_argument("--folder", type=Path, help="where results stay; else they are removed")
    given = parser.parse_args(arguments)
    bad = 0
    with contextlib.ExitStack() as stack:
        folder = given.folder or Path(stack.enter_context(tempfile.TemporaryDirectory()))
        for known in chosen(given.shapes):
            found = list(contradictions(known, folder))
            print(f"{known.name}: {', '.join(known.runs)}: {len(found)} contradictions", flush=True)
            for line in found:
                print(f"  {line}", flush=True)
            bad += len(found)
    return 1 if bad else 0


def contradictions(known: Known, folder: Path) -> Iterator[str]:
    """Run all operations of a shape and yield what disagrees, a sentence each."""
    folder.mkdir(parents=True, exist_ok=True)
    file, shape = folder / f"{known.name}.ply", known.make()
    medialis.write_mesh(file, shape)
    yield from _info(file, known, shape)
    manifests: dict[str, dict[str, Any]] = {}
    for name, more in known.runs.items():
        place = folder / known.name / name
        texts, screen = _run(
            name, str(file), "--unit", UNIT, "-o", str(place), "--overwrite", *more
        )
        manifest = json.loads((place / "manifest.json").read_text(encoding="utf-8"))
        manifests[manifest["operation"]] = manifest
        for line in (
            *_shown(screen, manifest),
            *_in_picture(texts, manifest),
            *_on_page(place, manifest),
            *_true(manifest, known),
        ):
            yield f"{name}: {line}"
    yield from _together(manifests, shape)
    yield from _in_table(file, known, manifests)


def _run(*words: str) -> tuple[list[str], str]:
    """Run a command; return the texts of its pictures, and what it printed.

    Raises
    ------
    RuntimeError
        When it fails.
    """
    drawn: list[str] = []

    def write(image: Any, text: str, *where: Any, **how: Any) -> None:
        drawn.append(text)
        plain(image, text, *where, **how)

    plain, screen = annotation.draw_text, io.StringIO()
    with (
        mock.patch.multiple(annotation, draw_text=write),
        mock.patch.multiple(marks, draw_text=write),
        contextlib.redirect_stdout(screen),
    ):
        code = command(list(words))
    if code not in (0, 1):
        raise RuntimeError(f"medialis {' '.join(words)} ended with {code}.")
    return drawn, screen.getvalue()


def _info(file: Path, known: Known, shape: medialis.Shape) -> Iterator[str]:
    """Hold `medialis info` against the shape, and its size against the truth."""
    _, text = _run("info", str(file))
    found = re.search(r"^size (\S+) x (\S+) x (\S+)", text, re.MULTILINE)
    assert found is not None
    size = sorted(map(float, found.groups()))
    low, high = shape.bounds
    for what, sides in (("box", sorted(high - low)), ("truth", known.size)):
        if sides is not None and not np.allclose(
            size, sides, rtol=5e-3 if what == "truth" else 1e-5
        ):
            yield f"info: size {size}, {what} {list(sides)}"
    told = re.search(r"diagonal (\S+),", text)
    if told is None or abs(float(told[1]) / shape.diagonal - 1) > 1e-5:
        yield f"info: diagonal {told and told[1]}, not {shape.diagonal:.6g}"


def _shown(screen: str, manifest: Mapping[str, Any]) -> Iterator[str]:
    """Hold the screen against the manifest; tell what lacks its unit, and what is long."""
    lines = screen.splitlines()
    if len(lines) > MOST_LINES:
        yield f"{len(lines)} lines on the screen"
    yield from (f"long: {text}" for text in manifest["messages"] if len(text) > LONGEST)
    yield from held_against(surfaces.on_screen(screen), manifest)


def held_against(told: Iterator[Told], manifest: Mapping[str, Any]) -> Iterator[str]:
    """Yield a sentence for each number that is not that of the manifest, or has another unit."""
    values = dict(surfaces.known_numbers(manifest["values"]))
    lengths = [*values.values(), *_of_options(manifest)]
    for one in told:
        if one.where == "note":
            if not any(one.agrees(value) for value in lengths):
                yield f"{one.number:g} {one.unit} is in no value: {one.name}"
            continue
        same = {"y_curves": "seams"}.get(one.name, f"{one.name}_percent")
        value = values.get(one.name, values.get(same))
        if value is None:
            yield f"{one.where}: {one.name} {one.number:g} is not in the manifest"
            continue
        unit = BY_QUANTITY.get(quantity(one.name.split(".")[-1]), "")
        if unit == "degrees":
            value = float(np.degrees(value))
        if not one.agrees(value):
            yield f"{one.where}: {one.name} is {one.number!r}, in the manifest {value!r}"
        if unit and one.unit != unit:
            yield f"{one.where}: {one.name} has the unit {one.unit!r}, not {unit!r}"


def _of_options(manifest: Mapping[str, Any]) -> Iterator[float]:
    """Yield the options that are lengths, in the unit of the shape."""
    diagonal = manifest["values"].get("diagonal") or 0.0
    for value in manifest["parameters"].values():
        if isinstance(value, float):
            yield value * diagonal
    for note in manifest["notes"]:
        yield from (float(x) for x in note["data"].values() if isinstance(x, int | float))


def _in_picture(texts: Sequence[str], manifest: Mapping[str, Any]) -> Iterator[str]:
    """Look at the legend: lengths have the unit, limits and numbers of places are those told."""
    values = dict(surfaces.known_numbers(manifest["values"]))
    places = [v for name, v in values.items() if name.endswith("].value")]
    for text in texts:
        stem = text.split(" (")[0].rstrip(";").replace(" ", "_")
        unit = BY_QUANTITY.get(quantity(stem))
        if unit and f"({unit})" not in text:
            yield f"legend: {text!r} lacks its unit"
        marked = re.fullmatch(rf"\d+: ({surfaces.NUMBER})(?: (mm))?", text)
        if marked is not None:
            told = surfaces.number_told("legend", text, *marked.groups())
            if not any(told.agrees(value) for value in places) or not told.unit:
                yield f"legend: {text!r} is none of the places {places}"
        for told in surfaces.in_note(text, "legend"):
            limits = [values.get("minimum"), values.get("maximum"), *_of_options(manifest)]
            if ("below" in text or "above" in text) and not any(
                told.agrees(value) for value in limits if value is not None
            ):
                yield f"legend: {text!r} is none of the limits"
        limit = re.fullmatch(rf"({surfaces.NUMBER}) limit", text)
        if limit is not None:
            told = surfaces.number_told("legend", text, limit[1], UNIT)
            if not told.agrees(manifest["parameters"]["threshold"] * values["diagonal"]):
                yield f"legend: {text!r} is not the threshold"


def _on_page(place: Path, manifest: Mapping[str, Any]) -> Iterator[str]:
    """Hold the page of the result against the manifest; a field that it lacks is no matter."""
    page = place.with_suffix(".html")
    _run("view", str(place), "-o", str(page))
    values = dict(surfaces.known_numbers(manifest["values"]))
    told = [
        one
        for one in surfaces.on_page(page.read_text(encoding="utf-8"))
        if one.name in values or one.name.startswith(("spots[", "regions["))
    ]
    yield from held_against(iter(told), manifest)


def _true(manifest: Mapping[str, Any], known: Known) -> Iterator[str]:
    """Hold the manifest against closed forms, and ranges against what they must contain."""
    values = manifest["values"]
    numbers = dict(surfaces.known_numbers(values))
    for name, (truth, share) in known.truths.get(manifest["operation"], {}).items():
        if name not in numbers or abs(numbers[name] - truth) > share * abs(truth):
            yield f"{name} is {numbers.get(name)!r}, in truth {truth!r}"


def _together(manifests: Mapping[str, Mapping[str, Any]], shape: medialis.Shape) -> Iterator[str]:
    """Hold operations on the same shape against each other."""
    for name, manifest in manifests.items():
        diagonal = manifest["values"].get("diagonal")
        if diagonal is not None and abs(diagonal / shape.diagonal - 1) > 1e-6:
            yield f"{name}: the diagonal is {diagonal!r}, that of the shape {shape.diagonal!r}"
        if manifest["unit"] != UNIT:
            yield f"{name}: the unit is {manifest['unit']!r}"


def _in_table(
    file: Path, known: Known, manifests: Mapping[str, Mapping[str, Any]]
) -> Iterator[str]:
    """Run the same as a batch, and hold its table against the manifests of the single runs."""
    folder = file.parent / f"{known.name}_batch"
    shutil.rmtree(folder, ignore_errors=True)
    given = []
    for name, more in known.runs.items():
        pairs = zip(more[::2], more[1::2], strict=True)
        given += [f"{name}.{a[2:]}={b}" for a, b in pairs if a != "--formats"]
    words = ["batch", ",".join(known.runs), str(file), "-o", str(folder), "--unit", UNIT]
    _run(*words, "--no-picture", "--workers", "1", *(w for one in given for w in ("--set", one)))
    text = (folder / "results.csv").read_text(encoding="utf-8")
    told: dict[str, list[Told]] = {}
    for operation, one in surfaces.in_csv(text, known.name):
        told.setdefault(operation, []).append(one)
    for operation, manifest in manifests.items():
        mine = [one for one in told.get(operation, []) if one.name not in ("status", "seconds")]
        if not mine:
            yield f"csv: nothing of {operation}"
        for line in held_against(iter(mine), manifest):
            yield f"{operation}: {line}"


if __name__ == "__main__":
    sys.exit(main())
