"""The report of a run: one HTML file that holds everything, and the same as JSON."""

from __future__ import annotations

import base64
import html
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.io.results import json_text
from medialis.operations.pictures import draw_result, draw_turntable
from medialis.operations.result import Result
from medialis.quality.measures import measure
from medialis.render.png import encode_png

STILLS, STILL_SIZE = 4, 360

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; margin: 2em auto; max-width: 62em; padding: 0 1em; }
h2 { margin-top: 2em; border-bottom: 1px solid #ccc; } img, svg { max-width: 100%; height: auto; }
table { border-collapse: collapse; } td, th { text-align: left; padding: .15em 1.2em .15em 0; }
td + td { font-variant-numeric: tabular-nums; } .row { display: flex; flex-wrap: wrap; gap: 1em; }
.row > * { flex: 1 1 200px; min-width: 0; max-width: 26em; } figcaption { color: #666; }
figure { margin: 0; max-width: 26em; } .wide { overflow-x: auto; }
rect { fill: #3b6fb6; } text { font-size: 11px; }
@media (prefers-color-scheme: dark) { body { background: #16181c; color: #ddd; }
  text { fill: #ddd; } h2 { border-color: #444; } rect { fill: #6d9fe0; } }
"""

_WORDS = {
    "surface_to_balls_max": "surface to balls, largest",
    "surface_to_balls_mean": "surface to balls, mean",
    "balls_to_surface_max": "balls to surface, largest",
    "balls_to_surface_mean": "balls to surface, mean",
    "hausdorff": "Hausdorff distance, two-sided",
    "deepest": "deepest sample in a ball",
    "deep_95_percent": "95 % of the balls: no deeper than",
}


def report_texts(result: Result, *, source: str | None = None) -> dict[str, str]:
    """Return the files of a report, ``report.html`` and ``report.json``, as text by name."""
    found = measure(result, source=None if source is None else Path(source).name)
    return {"report.html": report_page(found, stills(result)), "report.json": json_text(found)}


def stills(result: Result) -> list[NDArray[np.uint8]]:
    """Return the pictures of a report: the result and views all round it."""
    if not result.layers:
        return list(result.images.values())
    views = draw_turntable(result, STILLS, size=STILL_SIZE)
    return [*result.images.values(), draw_result(result), *views]


def report_page(measures: Mapping[str, Any], pictures: Sequence[NDArray[np.uint8]]) -> str:
    """Return the report as one HTML page with its pictures inside.

    Parameters
    ----------
    measures : dict
        From `medialis.quality.measures.measure`.
    pictures : sequence of (h, w, 3) uint8
        The first one is shown large.
    """
    title = measures["operation"].replace("_", " ")
    if measures["source"]:
        title += f" of {measures['source']}"
    parts = [
        f"<h1>{html.escape(title)}</h1>",
        _pictures(pictures),
        _section("What was said", _list(measures["messages"])),
        _section("Result", _table(measures["values"])),
        _section("Quality", _quality(measures)),
        _section("Distributions", _charts(measures["histograms"])),
        _section("Thin spots", _spots(measures["thin_spots"])),
        _section("Input", _input(measures["input"])),
        _section("Parameters", _table(measures["parameters"])),
        _section("Seconds", _table(measures["seconds"])),
        _section("Versions", _table(measures["versions"])),
    ]
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{html.escape(title)}</title><style>{_STYLE}</style></head><body>\n"
        + "\n".join(filter(None, parts))
        + "\n</body></html>\n"
    )


def _section(title: str, body: str) -> str:
    return f"<h2>{title}</h2>\n{body}" if body else ""


def _pictures(pictures: Sequence[NDArray[np.uint8]]) -> str:
    images = [
        f'<img alt="picture {number + 1} of the result" src="data:image/png;base64,'
        f'{base64.b64encode(encode_png(image)).decode()}">'
        for number, image in enumerate(pictures)
    ]
    rest = f'<div class="row">{"".join(images[1:])}</div>' if images[1:] else ""
    return "".join(images[:1]) + rest


def _list(lines: Iterable[str]) -> str:
    items = "".join(f"<li>{html.escape(line)}</li>" for line in lines)
    return f"<ul>{items}</ul>" if items else ""


def _table(values: Mapping[str, Any]) -> str:
    rows = "".join(
        f"<tr><td>{html.escape(_WORDS.get(name, name.replace('_', ' ')))}</td>"
        f"<td>{_shown(value)}</td></tr>"
        for name, value in values.items()
    )
    return f'<div class="wide"><table>{rows}</table></div>' if rows else ""


def _shown(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, float):
        return f"{value:.5g}" if math.isfinite(value) else str(value)
    return html.escape(str(value))


def _quality(measures: Mapping[str, Any]) -> str:
    parts = []
    for name, unit in (("reconstruction", "per cent of the size"), ("emptiness", "the same")):
        if measures[name] is not None:
            parts.append(f"<h3>{name.capitalize()} ({unit})</h3>{_table(measures[name])}")
    if measures["centredness"] is not None:
        table = _table(measures["centredness"])
        parts.append(f"<h3>Centredness (distance to the surface over radius)</h3>{table}")
    topology = measures["topology"]
    known = {"components of the shape": topology["components"], "its genus": topology["genus"]}
    found = {f"{name.replace('_', ' ')} found": v for name, v in topology["found"].items()}
    parts.append(f"<h3>Topology</h3>{_table({**known, **found})}")
    return "".join(parts)


def _charts(histograms: Mapping[str, Mapping[str, Sequence[float]]]) -> str:
    charts = "".join(
        f"<figure>{_chart(chart['counts'], chart['edges'])}"
        f"<figcaption>{name.replace('_', ' ')}"
        f"{' in radians' if name == 'spoke_angle' else ''}</figcaption></figure>"
        for name, chart in histograms.items()
    )
    return f'<div class="row">{charts}</div>' if charts else ""


def _chart(counts: Sequence[float], edges: Sequence[float]) -> str:
    """Bars of a histogram as SVG, the range below."""
    width, height = 320, 130
    bar, top = width / len(counts), max([*counts, 1])
    bars = "".join(
        f'<rect x="{i * bar:.1f}" y="{height * (1 - count / top):.1f}" width="{bar - 0.6:.1f}" '
        f'height="{height * count / top:.1f}"/>'
        for i, count in enumerate(counts)
    )
    return (
        f'<svg viewBox="0 0 {width} {height + 16}" role="img" aria-label="histogram">{bars}'
        f'<text x="0" y="{height + 13}">{edges[0]:.4g}</text>'
        f'<text x="{width}" y="{height + 13}" text-anchor="end">{edges[-1]:.4g}</text></svg>'
    )


def _area(area: float | None) -> str:
    return "" if area is None else f"{area:.4g}"  # a cloud has no areas


def _spots(spots: Sequence[Mapping[str, Any]] | None) -> str:
    if not spots:
        return ""
    rows = "".join(
        f"<tr><td>{spot['value']:.5g}</td><td>{_area(spot['area'])}</td><td>{spot['vertices']}</td>"
        f"<td>{', '.join(f'{x:.5g}' for x in spot['position'])}</td></tr>"
        for spot in spots
    )
    head = "<tr><th>value</th><th>area</th><th>vertices</th><th>position</th></tr>"
    return f'<div class="wide"><table>{head}{rows}</table></div>'


def _input(found: Mapping[str, Mapping[str, Any] | None]) -> str:
    before, after = found["as_read"], found["as_computed"] or {}
    rows = "".join(
        f"<tr><td>{name.replace('_', ' ')}</td>"
        f"<td>{'' if before is None else _shown(before[name])}</td><td>{_shown(value)}</td></tr>"
        for name, value in after.items()
    )
    head = "<tr><th></th><th>as read</th><th>as computed on</th></tr>"
    return f'<div class="wide"><table>{head}{rows}</table></div>'
