"""The report of a run: one HTML file that holds everything, and the same as JSON."""

from __future__ import annotations

import base64
import html
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.options import AUTO, NUMBERS, Kind
from medialis.base.progress import Progress, ProgressCallback, counted
from medialis.base.threads import run_patiently
from medialis.formats.json_npz import json_text
from medialis.operations.registry import OPERATIONS
from medialis.operations.result import Result, quantity, unit_of
from medialis.show.picture import draw_result, draw_turntable
from medialis.show.png import encode_png
from medialis.show.reports.measures import LENGTHS_OF_FILE, TABLES, measure
from medialis.show.reports.page import (
    bullets,
    cell,
    chart,
    data_text,
    named,
    number,
    page,
    place,
    records,
    section,
    table,
    verdict_list,
)
from medialis.show.viewer.page import frame, has_library, viewer_page

STILLS, STILL_SIZE = 4, 360
MOST_POINTS = 2_000_000
"""Points of all layers that a report shows in three dimensions: a page of 20 MB."""

ROWS = 30
"""Rows of tables that are shown."""

OF_CLOUDS = (
    *("vertices", "duplicate_vertices", "nonfinite_vertices"),
    *("diagonal", "spacing", "min_edge", "max_edge"),
)
"""What a diagnosis says of a point cloud."""

ABOUT = {
    "reconstruction": (
        "Distances between the surface and the union of the balls, in per cent of the diagonal. "
        "The surface is seen at its samples and at the middles of its edges and faces, the balls "
        "at points on their spheres."
    ),
    "emptiness": "Depth of samples of the surface in balls, in per cent of the diagonal.",
    "envelope": (
        "Distances between the surface and the envelope of the medial mesh (the union of its "
        "balls, cones and slabs), in per cent of the diagonal."
    ),
    "centredness": "Distance to the surface over the radius, at the nodes; 1 is centred.",
}
LABELS = {
    "surface_to_balls_max": "surface to balls, largest",
    "surface_to_balls_mean": "surface to balls, mean",
    "balls_to_surface_max": "balls to surface, largest",
    "balls_to_surface_mean": "balls to surface, mean",
    "hausdorff": "Hausdorff distance (the larger of both)",
    "worst_place": "found at",
    "mean_error": "surface to envelope, mean",
    "largest_error": "the larger of both",
    "deepest": "deepest sample",
    "deep_95_percent": "95 % of the samples: at most",
    "low_5_percent": "95 % of the nodes: at least",
}


def report_texts(
    result: Result,
    *,
    source: str | None = None,
    progress: Progress | ProgressCallback | None = None,
) -> dict[str, str]:
    """Return the files of a report, ``report.html`` and ``report.json``, as text by name."""
    progress = Progress.of(progress).unnamed
    name = None if source is None else Path(source).name
    with progress.stage("measures", 0.0, 0.5):
        found = run_patiently(lambda: measure(result, source=name), progress)
    with progress.stage("stills", 0.5, 0.9):
        pictures = stills(result, progress)
    with progress.stage("viewer", 0.9, 1.0):
        viewer = run_patiently(lambda: viewer_frame(result, name), progress)
    page = report_page(found, pictures, viewer)
    return {"report.html": page, "report.json": json_text(found)}


def viewer_frame(result: Result, name: str | None) -> str:
    """Return the result in three dimensions as a part of a page; nothing where it is too large."""
    points = len(result.shape.points) + sum(len(layer.points) for layer in result.layers)
    if not has_library() or not result.layers or points > MOST_POINTS:
        return ""
    title = result.title + (f" of {name}" if name else "")
    return f'<section id="viewer">{frame(viewer_page([result], title, still=False))}</section>'


def stills(result: Result, progress: Progress) -> list[NDArray[np.uint8]]:
    """Return the pictures of a report: the result and views all round it."""
    if not result.layers:
        return list(result.images.values())
    with progress.stage("main", 0.0, 0.4):
        main = draw_result(result, progress=progress)
    with progress.stage("round", 0.4, 1.0):
        views = list(draw_turntable(result, STILLS, size=STILL_SIZE, progress=progress))
    return [*result.images.values(), main, *views]


def report_page(
    measures: Mapping[str, Any], pictures: Sequence[NDArray[np.uint8]], viewer: str = ""
) -> str:
    """Return the report as one HTML page with its pictures inside.

    Parameters
    ----------
    measures : dict
        From `medialis.show.reports.measures.measure`.
    pictures : sequence of (h, w, 3) uint8
        From `stills`: the last four are views all round, the one before is the main picture.
    viewer : str
        From `viewer_frame`; the views are left out where it is there.
    """
    title = measures["operation"].replace("_", " ").capitalize()
    if measures["source"]:
        title += f" of {measures['source']}"
    count = len(pictures) - STILLS if len(pictures) > STILLS else len(pictures)
    large, views = pictures[:count], pictures[count:]
    seconds = [(named(name), f"{value:.2f}") for name, value in measures["seconds"].items()]
    body = (
        f"<header><h1>{html.escape(title)}</h1>\n{_subtitle(measures)}</header><main>",
        '<div class="side">',
        section("At a glance", verdict_list(measures["verdict"])),
        section("", *(_picture(image) for image in large[-1:])),
        "</div>",
        viewer or _views(views),
        section("Notes", bullets(measures["messages"])),
        *(section("", _picture(image)) for image in large[:-1]),
        section("Quality", _quality(measures)),
        section("Distributions", _charts(measures["histograms"], "loops" in measures["topology"])),
        section("Thin spots", records(measures["thin_spots"] or [], ROWS)),
        *(section(TABLES[name], records(rows, ROWS)) for name, rows in measures["tables"].items()),
        '<div class="side">',
        section("Result", *_values(measures)),
        section("Input", _input(measures["input"])),
        "</div>",
        '<div class="side">',
        section("Parameters", _parameters(measures)),
        section("Seconds", table(seconds)),
        section("Versions", table(measures["versions"].items())),
        "</div></main>",
    )
    return page(title, data_text("medialis.show.reports", "report.css"), *body)


def _subtitle(measures: Mapping[str, Any]) -> str:
    shape = measures["input"]["as_computed"]
    diagonal = measures["values"].get("diagonal") or shape["diagonal"]
    parts = [
        counted(shape["vertices"], "sample"),
        f"diagonal {number(diagonal)} {measures['unit'] or 'in the units of the file'}",
        f"{number(measures['seconds'].get('total', 0.0), 3)} seconds",
        f"medialis {measures['versions']['medialis']}",
    ]
    return f'<p class="soft">{html.escape(" · ".join(parts))}</p>'


def _picture(image: NDArray[np.uint8], alt: str = "the result") -> str:
    data = base64.b64encode(encode_png(image)).decode()
    height, width = image.shape[:2]
    return f'<img alt="{alt}" width="{width}" height="{height}" src="data:image/png;base64,{data}">'


def _views(images: Sequence[NDArray[np.uint8]]) -> str:
    step = 360 // max(len(images), 1)
    views = [_picture(image, f"turned by {step * i} degrees") for i, image in enumerate(images)]
    return f'<div class="views">{"".join(views)}</div>' if views else ""


def _quality(measures: Mapping[str, Any]) -> str:
    parts, diagonal = [], measures["input"]["as_computed"]["diagonal"]
    for name, about in ABOUT.items():
        if measures[name] is not None:
            rows = [
                (LABELS.get(k, named(k)), place(v, diagonal) if k == "worst_place" else number(v))
                for k, v in measures[name].items()
            ]
            parts.append(
                f'<div><h3>{name.capitalize()}</h3><p class="soft">{about}</p>{table(rows)}</div>'
            )
    return f'<div class="row">{"".join(parts)}</div>' if parts else ""


def _charts(histograms: Mapping[str, Mapping[str, Any]], curve: bool) -> str:
    units = dict.fromkeys(LENGTHS_OF_FILE, "units of the file")
    units |= {"spoke_angle": "degrees", "sharpness": "share of a right angle"}
    if curve:  # its importance is the area of the surface that hangs on a node
        units["importance"] = "area, square units of the file"
    factors = {"spoke_angle": 180 / math.pi}
    charts = [
        chart(found, f"{named(name)} ({units[name]})", factors.get(name, 1.0))
        for name, found in histograms.items()
    ]
    return f'<div class="row">{"".join(charts)}</div>' if charts else ""


def _values(measures: Mapping[str, Any]) -> list[str]:
    """Tables of the values: single ones, then one for each list of things."""
    diagonal = measures["input"]["as_computed"]["diagonal"]
    single: list[tuple[str, str, str]] = []
    more: list[str] = []
    for name, value in measures["values"].items():
        if isinstance(value, dict):
            for key, part in value.items():
                if _is_table(part):
                    more.append(f"<h3>{named(name)}: {named(key)}</h3>{records(part, ROWS)}")
                else:
                    single.append((f"{named(name)}: {named(key)}", cell(part), ""))
        elif _is_table(value):
            more.append(f"<h3>{named(name)}</h3>{records(value, ROWS)}")
        elif quantity(name) == "angle" and value is not None:
            single.append((named(name), f"{number(math.degrees(value))}°", ""))
        else:
            what = quantity(name) if isinstance(value, float) else ""
            is_length = what == "length" and name != "diagonal" and diagonal > 0
            share = f"{number(100 * value / diagonal)} %" if is_length else ""
            unit = unit_of(name, measures["unit"]) if what else ""
            text = f"{cell(value)} {unit}" if unit else cell(value)
            single.append((named(name), text, share))
    head = ("", "", "of the diagonal") if any(share for *_, share in single) else ()
    return [table(single, head), *more]


def _is_table(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and isinstance(value[0], dict)


def _input(found: Mapping[str, Mapping[str, Any] | None]) -> str:
    before, after = found["as_read"], found["as_computed"] or {}
    rows = [
        (named(name), "–" if before is None else number(before[name]), number(value))
        for name, value in after.items()
        if after["faces"] or name in OF_CLOUDS
    ]
    return table(rows, ("", "as read", "as computed on"))


def _parameters(measures: Mapping[str, Any]) -> str:
    entries = [entry for entry in OPERATIONS if entry.name == measures["operation"]]
    known = {parameter.name: parameter for entry in entries for parameter in entry.parameters}
    rows = []
    for name, value in measures["parameters"].items():
        kind, usual = None, value
        if name in known:
            kind, usual = known[name].kind, known[name].default
        default = f"default: {_with_unit(kind, usual)}" if value != usual else ""
        default = "automatic" if name in measures["automatic"] else default
        rows.append((named(name), _with_unit(kind, value), default))
    return table(rows)


def _with_unit(kind: Kind | None, value: Any) -> str:
    if kind in NUMBERS and value == AUTO:
        return "automatic"
    if kind is Kind.LENGTH:
        return f"{number(100 * value)} % of the diagonal"
    if kind is Kind.ANGLE:
        return f"{number(value)}°"
    return number(value) if value != "" else "none"
