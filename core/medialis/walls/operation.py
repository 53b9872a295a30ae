"""Operation: thickness of the wall behind every point of the surface, and the thinnest places.

Operation: walls against a least and a largest thickness, ribs, and gaps between walls.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import Mask
from medialis.base.errors import InvalidOptionError
from medialis.base.options import (
    AUTO,
    Length,
    Size,
    changed,
    choice,
    file,
    length,
    number,
    whole,
    with_unit,
)
from medialis.base.progress import Progress, counted
from medialis.base.validation import FloatArray, IntArray
from medialis.operations.declaration import Operation, Selection
from medialis.operations.positions import place
from medialis.operations.result import Layer, Outcome, Result
from medialis.shape.graph import ENCLOSED, Enclosure
from medialis.shape.shape import Shape
from medialis.skeleton.layers import cloud_arrays, summary, surface_layers, weighted_median
from medialis.skeleton.medial_cloud import MedialCloud
from medialis.skeleton.surface_skeleton import SurfaceSkeletonOptions, surface_skeleton
from medialis.walls.rules import MATERIALS, NONE, PROCESSES, Rules, process_help, rules_of
from medialis.walls.thickness import (
    WallPreparation,
    WallThicknessOptions,
    thickness,
    unresolved_walls,
    wall_balls,
    wall_thickness,
)
from medialis.walls.thin_spots import ThinSpot, ThinSpotOptions, thin_spots
from medialis.walls.wall_check import (
    EQUAL,
    LARGEST_SHARE,
    LEAST_SHARE,
    WallCheck,
    WallLimits,
    check_walls,
)

SHOWN_SHARE = 98.0  # halved 0 %, doubled 100 %
"""Per cent of the vertices that the colours span, from the thinnest up: a few very thick places do
not make everything else look thin."""

EVEN = 0.02
"""Relative: colors do not tell walls apart that differ by less from the middle of their range."""

COLORS: dict[str, Any] = {"color_map": "sequential"}

PLACES = 15  # halved 0 %, doubled 0 %
"""Balls that are looked at to tell whether a cloud or an open mesh encloses anything."""

MOST = 0.5  # halved 0 %, doubled 0 %
"""Share of the surface from which on a threshold that calls it thin is worth a warning."""

UNRESOLVED_SHARE = 0.02  # halved 0 %, doubled 0 %
"""Share of the samples from which on walls thinner than the sampling are worth a warning."""


def run_thickness(shape: Shape, options: ThinSpotOptions, progress: Progress) -> Outcome:
    """Refine, shrink balls, measure, complete, list the thinnest places."""
    with progress.stage("skeleton", 0.0, 0.7):
        cloud = surface_skeleton.of(shape, options, progress)
    fine = cloud.surface
    # A length means the shape that was given; smooth refinement may bulge out of its box.
    same = options.threshold * shape.diagonal / fine.diagonal
    given, options = options, replace(options, threshold=min(same, 1.0))
    with progress.stage("thickness", 0.7, 0.85):
        values = thickness.of(cloud, options, progress)
        walls = wall_thickness.of(cloud, options, progress)
    with progress.stage("thin spots", 0.85, 1.0):
        spots = thin_spots.of(cloud, options, progress)
    note_resolution(cloud, progress)
    note_enclosure(cloud, progress)
    _note_share(walls, options, fine, progress)
    _note_thinnest(spots, given, shape, progress)
    labels = np.full(fine.point_count, -1, np.int32)
    for row, spot in enumerate(spots, 1):  # as in the list
        labels[spot.vertices] = row
    fields: dict[str, Any] = {"thickness": values, "wall_thickness": walls, "thin_spot": labels}
    # Vertices of parts are on sharp edges as a rule, where the thickness is nearly 0.
    shown: dict[str, Any] = {"color_by": "wall_thickness", **COLORS, "labels": ("thin_spot",)}
    limits = _color_limits(walls)
    limit = given.threshold * shape.diagonal or None
    layers = surface_layers("thickness", shape, fine, fields, color_limits=limits, **shown)
    marks = _spots_layer(spots, limits)
    return Outcome(
        shape=fine,
        layers=(layers[0], *marks, *layers[1:]),
        values={
            "samples": fine.point_count,
            **summary(values, "thickness", fine.point_areas),
            **summary(walls, "wall_thickness", fine.point_areas),
            "thin_spots": len(spots),
            "overlaps": sum(spot.kind == "overlap" for spot in spots),
            "spots": _table(
                spots,
                *("kind", "position", "opposite", "value", "area", "vertices", "persistence"),
            ),
            "diagonal": fine.diagonal,
            "spacing": fine.spacing,
        },
        arrays={**cloud_arrays(cloud), **fields},
        shown=(replace(layers[-1], color_limit=limit), *marks),
    )


def _color_limits(values: FloatArray) -> tuple[float, float]:
    """Return the range of the colors, which is at least `EVEN` to each side of its middle."""
    low, high = float(values.min()), float(np.percentile(values, SHOWN_SHARE))
    middle = 0.5 * (low + high)
    return min(low, (1.0 - EVEN) * middle), max(high, (1.0 + EVEN) * middle)


def _spots_layer(spots: tuple[ThinSpot, ...], limits: tuple[float, float]) -> tuple[Layer, ...]:
    """Layer of the places, in the colours of the surface."""
    counts = [len(spot.vertices) for spot in spots]
    attributes = _columns(spots, "value", "area")
    if np.isnan(attributes["area"]).all():
        del attributes["area"]  # a cloud has no areas
    attributes["vertices"] = np.array(counts, np.int32)
    attributes["overlap"] = _are(spots, "overlap")
    attributes |= _columns(spots, "persistence")
    return _marks("thin_spots", spots, attributes, color_limits=limits, **COLORS)


def _marks(
    name: str, places: Sequence[Any], attributes: dict[str, Any], first: str = "value", **shown: Any
) -> tuple[Layer, ...]:
    """Layer of places that a check found, coloured by the first attribute; none without any."""
    if not places:
        return ()
    points = np.array([place.position for place in places])
    return (Layer(name, points, attributes=attributes, color_by=first, number_by=first, **shown),)


def _columns(places: Sequence[Any], *names: str) -> dict[str, NDArray[Any]]:
    """Return what places have of some names, an array each."""
    return {name: np.array([getattr(place, name) for place in places]) for name in names}


def _are(places: Sequence[Any], kind: str) -> IntArray:
    return np.array([place.kind == kind for place in places], np.int32)


def _table(places: Iterable[Any], *names: str) -> list[dict[str, Any]]:
    """Return places for people and programs: positions, counts of vertices, other values."""

    def told(name: str, value: Any) -> Any:
        if name == "vertices":
            return len(value)
        if name in ("position", "opposite"):
            return None if np.isnan(value).any() else place(value)
        return value

    return [{name: told(name, getattr(one, name)) for name in names} for one in places]


def _thin(result: Result, shape: Shape) -> Mask:
    """Which vertices lie on a wall below the threshold."""
    limit = result.parameters["threshold"] * shape.diagonal
    return np.asarray(result.layers[0].attributes["wall_thickness"]) < limit


def _note_share(
    values: FloatArray, options: ThinSpotOptions, surface: Shape, progress: Progress
) -> None:
    """Say so where the threshold calls most of the shape thin."""
    thin = values < options.threshold * surface.diagonal
    share = float(surface.point_areas[thin].sum() / surface.point_areas.sum())
    if share > MOST:
        limit = with_unit(options.threshold * surface.diagonal, surface.unit)
        median = with_unit(weighted_median(values, surface.point_areas), surface.unit)
        text = (
            f"{100 * share:.0f} % of the shape is thinner than the threshold of {limit}; its "
            f"median {options.kind} is {median}. Check the unit of the threshold."
        )
        progress.warn(text, "mostly_thin", share=share)


def _note_thinnest(
    spots: tuple[ThinSpot, ...], options: ThinSpotOptions, shape: Shape, progress: Progress
) -> None:
    below = options.threshold * shape.diagonal
    limit = with_unit(below, shape.unit)
    if not spots:
        text = f"No place is thinner than {limit}." if below else "No thin spot was found."
        progress.note(text, "no_thin_spot", threshold=below)
        return
    walls = [spot for spot in spots if spot.kind == "wall"]
    more = f" below {limit}" if below else ""
    if walls:
        place = ", ".join(f"{x:.6g}" for x in walls[0].position + shape.offset)
        text = (
            f"{counted(len(walls), 'thin spot', verbs=('was', 'were'))} found{more}. The thinnest "
            f"has a {options.kind} of {with_unit(walls[0].value, shape.unit)} at ({place})."
        )
        progress.note(text, "thin_spots", spots=len(walls), thinnest=walls[0].value)
    if len(walls) < len(spots):
        count = len(spots) - len(walls)
        text = (
            f"{counted(count, 'place', verbs=('is', 'are'))} thin{more} because parts of the mesh "
            "overlap or cross there: their values tell how deep, not how thick a wall is."
        )
        progress.warn(text, "overlaps", spots=count)


def note_enclosure(cloud: MedialCloud, progress: Progress) -> None:
    """Say so where the balls of a cloud or an open mesh lie inside nothing."""
    shape = cloud.surface
    if shape.faces is not None and shape.closed_components.all():
        return
    rows = wall_balls(cloud)
    if len(rows) == 0:
        rows = np.flatnonzero(cloud.valid & (cloud.side > 0))
    rows = rows[np.linspace(0, len(rows) - 1, min(PLACES, len(rows))).astype(np.int64)]
    outside = int((Enclosure(shape).times(cloud.centers[rows]) < ENCLOSED).sum())
    if 2 * outside > len(rows):
        text = (
            f"The {'cloud' if shape.faces is None else 'surface'} encloses nothing at "
            f"{counted(outside, 'place', of=len(rows))} that were looked at. Thickness there is "
            "the distance to what lies behind, not that of a wall."
        )
        progress.warn(text, "encloses_nothing", places=outside, of=len(rows))


def note_resolution(cloud: MedialCloud, progress: Progress) -> None:
    """Say so where walls may be thinner than the samples are apart."""
    count, of = int(unresolved_walls(cloud).sum()), cloud.surface.point_count
    if count > UNRESOLVED_SHARE * of:
        text = (
            f"{counted(count, 'sample', of=of, verbs=('lies', 'lie'))} on a wall that may be "
            "thinner than the spacing of its samples; its thickness is uncertain. Try a smaller "
            "refine."
        )
        progress.warn(text, "unresolved_walls", samples=count, of=of)


THICKNESS = Operation(
    name="thickness",
    filter_name="compute_scalar_by_medial_thickness_per_vertex",
    label="Thickness",
    group="Thickness",
    help="Measure how thick a shape is at every point of its surface, and list the thinnest "
    "places.\n\n"
    "The thickness is the diameter of the largest ball inside the shape that touches or contains "
    "the point; it falls to zero towards a sharp edge. The wall thickness leaves edges, bumps and "
    "noise out: there, it is that of the wall around. Thin spots are the thinnest walls, each with "
    "both ends, value, area and vertices; overlaps of parts are listed apart from walls.",
    source="thesis 3.5.1",
    examples=(
        ("creature.ply --unit mm --threshold 0.1mm", "where the wall is thinner than 0.1 mm"),
        ("creature.ply -o report --report", "the thinnest places, with a page on how sure that is"),
    ),
    layers={
        "thickness": "the surface with thickness, wall thickness and number of the thin spot at "
        "each vertex",
        "thin_spots": "one point for each thin spot, the thinnest first",
        "samples": "the same on the refined surface",
    },
    options=ThinSpotOptions,
    run=run_thickness,
    thin_lines=True,
    selection=Selection(
        "compute_selection_by_medial_thickness_per_vertex",
        "Select the vertices where a shape is thinner than a length.",
        _thin,
        {"threshold": 0.02},
    ),
    order=40,
    words=("thin walls", "wall thickness", "3D print"),
)

CHECKS = ("within", "too thin", "too thick", "edge", "overlap", "gap", "part lines")
"""What the numbers 0, 1, ... of the attribute `check` mean."""

CHECK_COLORS = (
    (0.80, 0.82, 0.82), (0.80, 0.17, 0.18), (0.15, 0.42, 0.75),
    (0.92, 0.92, 0.90), (0.58, 0.30, 0.62), (0.95, 0.66, 0.20),
    (0.25, 0.60, 0.48),
)  # fmt: skip
"""Their colours in pictures."""

UNCHECKED = 0.01
"""Fraction of the surface that may be unchecked in a verdict: a few samples have no ball."""

RATIO = 0.6
"""Of a rib to its wall, where no process says another."""


@dataclass(frozen=True, kw_only=True)
class WallCheckRun(WallPreparation):
    """Options of the operation `wall_check`."""

    minimum: float = length(
        0.0,
        "Minimum",
        "Walls thinner than this are too thin. 0: as material or process say, else not checked; "
        "half of the typical wall where there is no limit at all.",
    )
    maximum: float = length(
        0.0,
        "Maximum",
        "Walls thicker than this are too thick. 0: as material or process say, else not checked; "
        "one and a half times the typical wall where there is no limit at all.",
    )
    material: str = choice(
        NONE,
        "Material",
        "Take the limits that are usual for injection moulding of a plastic; the unit of the shape "
        "must be known.",
        {
            NONE: "No plastic: only the limits that are given count.",
            **{
                name: f"Walls are to be {low:g} to {high:g} mm thick."
                for name, (low, high) in MATERIALS.items()
            },
        },
    )
    process: str = choice(
        NONE,
        "Process",
        "Take the limits that are usual for a way of making it, or those of the file of rules; the "
        "unit of the shape must be known.",
        {
            NONE: "Only what is given counts; of a file of rules with one process, that.",
            **{name: process_help(name) for name in PROCESSES},
        },
    )
    rules: str = file(
        "Rules",
        "TOML file with the limits of processes, to take instead of the usual ones.",
    )
    gap: float = length(
        0.0,
        "Gap",
        "Walls that face each other across less room than this are too close. 0: as the process "
        "says, else not checked.",
    )
    line_width: float = length(
        0.0,
        "Line width",
        "Walls that are not whole lines of this width are told, as a nozzle lays them. 0: as the "
        "process says, else not looked at.",
    )
    rib_ratio: float = number(
        AUTO,
        "Rib ratio",
        "Ribs and bosses thicker than this share of the wall that they stand on are counted. auto: "
        "as the process says, else 0.6.",
        high=100.0,
        auto=RATIO,
    )
    min_spoke_angle: float = changed(
        WallThicknessOptions,
        "min_spoke_angle",
        default=150.0,
        help="Faces that enclose less than 180 degrees minus this are two sides of a wall, others "
        "an edge.",
    )
    regions: int = whole(
        100,
        "Regions",
        "List at most this many regions of each kind, and as many ribs.",
        low=1,
        high=100_000,
        advanced=True,
    )

    def auto_values(
        self, data: Any, starts: Mapping[str, float], progress: Progress
    ) -> dict[str, float]:
        """Choose the ratio of ribs by the process, if it has one, and the rest by the shape."""
        chosen = super().auto_values(data, starts, progress)
        if "rib_ratio" in starts:
            rules = rules_of(self.rules, self.process)
            ratio = starts["rib_ratio"] if rules is None else rules.rib_ratio
            chosen |= {"rib_ratio": ratio} if math.isfinite(ratio) else {}
        return chosen


def run_wall_check(shape: Shape, options: WallCheckRun, progress: Progress) -> Outcome:
    """Refine, shrink balls, measure, collect regions, ribs and gaps."""
    limits = _limits(shape, options)
    gaps = limits.gap > 0
    with progress.stage("skeleton", 0.0, 0.4 if gaps else 0.7):
        cloud = surface_skeleton.of(shape, options, progress)
    outer = None
    if gaps:
        with progress.stage("outside", 0.4, 0.7):
            outside = SurfaceSkeletonOptions.taken_from(options, side="outer")
            outer = surface_skeleton.of(shape, outside, progress)
    with progress.stage("walls", 0.7, 1.0):
        check = check_walls(cloud, outer, limits, options.min_spoke_angle, progress)
    fine = cloud.surface
    note_resolution(cloud, progress)
    note_enclosure(cloud, progress)
    _note_limits(check, limits, options, shape, progress)
    _note_regions(check, limits, fine, shape, progress)
    _note_ribs(check, limits.rib_ratio, progress)
    walls = check.walls
    fields: dict[str, Any] = {"thickness": check.thickness, "checked_thickness": walls}
    fields |= _codes(check)
    low = check.minimum if check.minimum > 0 else float(walls.min())
    high = float(walls.max()) if math.isinf(check.maximum) else check.maximum
    shown: dict[str, Any] = {"color_by": "checked_thickness", **COLORS, "labels": ("region",)}
    limits_shown = low, max(high, low)
    layers = surface_layers("wall_check", shape, fine, fields, color_limits=limits_shown, **shown)
    marks = _regions_layer(check) + _ribs_layer(check, limits.rib_ratio)
    verdict, passed = _verdict(check, fine, limits.rib_ratio)
    return Outcome(
        shape=fine,
        layers=(layers[0], *marks, *layers[1:]),
        values={
            "passed": passed,
            "verdict": verdict,
            "minimum": check.minimum,
            "maximum": check.maximum,
            "typical": check.typical,
            "largest_ball": check.largest_ball or None,
            "checked_percent": 100.0 * _checked_share(check, fine),
            **summary(walls, "checked_thickness", fine.point_areas),
            "too_thin": len(check.of_kind("too thin")),
            "too_thick": len(check.of_kind("too thick")),
            "narrow_gaps": len(check.of_kind("gap")) if gaps else None,
            "overlaps": len(check.of_kind("overlap")),
            "part_lines": len(check.of_kind("part lines")) if limits.line_width > 0 else None,
            "thick_ribs": _thick_ribs(check, limits.rib_ratio),
            "regions": _region_rows(check, limits.line_width),
            "ribs": _table(
                check.ribs[: options.regions],
                *("kind", "ratio", "thickness", "wall", "length", "position"),
            ),
            "samples": fine.point_count,
            "diagonal": fine.diagonal,
            "spacing": fine.spacing,
        },
        arrays={**cloud_arrays(cloud), **fields},
        shown=(replace(layers[-1], color_by="check", classes=_classes(check, shape)), *marks[:1]),
    )


def _classes(check: WallCheck, shape: Shape) -> tuple[tuple[str, tuple[float, float, float]], ...]:
    """Return what the numbers of `check` mean, with the limits, and their colours."""
    told = {"too thin": ("below", check.minimum), "too thick": ("above", check.maximum)}
    names = [
        f"{name}: {told[name][0]} {with_unit(told[name][1], shape.unit)}" if name in told else name
        for name in CHECKS
    ]
    return tuple(zip(names, CHECK_COLORS, strict=True))


def _limits(shape: Shape, options: WallCheckRun) -> WallLimits:
    """Return the limits in the units of the shape: those given, of the material, of the process.

    Raises
    ------
    FileError
        When the file of rules cannot be read.
    InvalidOptionError
        When the minimum is above the maximum, a material or a process is named and the unit is not
        known, or as `rules_of`.
    """
    given = [value * shape.diagonal or None for value in (options.minimum, options.maximum)]
    if options.material != NONE:
        size = Size.of(shape)
        for place, amount in enumerate(MATERIALS[options.material]):
            known = size.fraction(Length(amount, "mm"), f"the limit of {options.material}")
            given[place] = given[place] or known * shape.diagonal
    named = rules_of(options.rules, options.process)
    rules = named or Rules(rib_ratio=RATIO)

    def asked(name: str) -> float:
        return getattr(options, name) * shape.diagonal or rules.in_units_of(shape, name)

    low, high = given[0] or asked("minimum") or None, given[1] or asked("maximum") or None
    if low is not None and high is not None and low > high:
        raise InvalidOptionError(
            f"The minimum of {with_unit(low, shape.unit)} is above the maximum of "
            f"{with_unit(high, shape.unit)}."
        )
    ratio = rules.rib_ratio if "rib_ratio" in options.auto_starts() else options.rib_ratio
    lines = asked("line_width"), rules.line_tolerance, rules.most_lines
    return WallLimits(low, high, asked("gap"), options.regions, ratio, *lines)


def _codes(check: WallCheck) -> dict[str, IntArray]:
    """Return `check` and `region` of each sample, numbered from 1; the first region counts."""
    count = len(check.thickness)
    codes, numbers = np.zeros(count, np.int32), np.full(count, -1, np.int32)
    codes[check.edge] = CHECKS.index("edge")
    for row, region in reversed(list(enumerate(check.regions, 1))):
        codes[region.vertices] = CHECKS.index(region.kind)
        numbers[region.vertices] = row
    return {"check": codes, "region": numbers}


def _regions_layer(check: WallCheck) -> tuple[Layer, ...]:
    codes = np.array([CHECKS.index(region.kind) for region in check.regions], np.int32)
    columns = _columns(check.regions, "value", "area")
    attributes = {"value": columns["value"], "check": codes, "area": columns["area"]}
    return _marks("wall_regions", check.regions, attributes, **COLORS)


def _region_rows(check: WallCheck, line_width: float) -> list[dict[str, Any]]:
    """Return the regions for people and programs; with the lines of a wall where lines count."""
    names = "kind", "value", "least", "most", "area", "position", "opposite", "vertices"
    rows = _table(check.regions, *names)
    if line_width > 0:
        for row in rows:
            row["lines"] = None if row["kind"] in ("gap", "overlap") else row["value"] / line_width
    return rows


def _ribs_layer(check: WallCheck, most: float) -> tuple[Layer, ...]:
    ratio, rib, wall = _columns(check.ribs, "ratio", "thickness", "wall").values()
    attributes = {"ratio": ratio, "rib_thickness": rib, "wall_thickness": wall}
    attributes["boss"] = _are(check.ribs, "boss")
    limits = 0.0, max(2.0 * (RATIO if math.isinf(most) else most), 1e-9)
    return _marks("ribs", check.ribs, attributes, "ratio", color_limits=limits)


def _thick_ribs(check: WallCheck, most: float) -> int:
    return sum(rib.ratio > most * (1.0 + EQUAL) for rib in check.ribs)


def _checked_share(check: WallCheck, surface: Shape) -> float:
    """Return the fraction of the area that the check speaks for."""
    areas = surface.point_areas
    return float(areas[check.checked].sum() / areas.sum())


def _verdict(check: WallCheck, surface: Shape, most_ratio: float) -> tuple[str, bool | None]:
    """Return the verdict in a sentence, and whether the part passes; None: no verdict."""
    nouns = {"too thin": "wall too thin", "too thick": "wall too thick", "gap": "gap too narrow"}
    found = [
        (len(check.of_kind(kind)), noun)  # type: ignore[arg-type]
        for kind, noun in nouns.items()
    ]
    found.append((_thick_ribs(check, most_ratio), "rib too thick for its wall"))
    failures = [
        f"{count} {noun if count == 1 else noun.replace(' ', 's ', 1)}"
        for count, noun in found
        if count
    ]
    share = _checked_share(check, surface)
    partly = share < 1.0 - UNCHECKED
    of_it = f" Only {100 * share:.3g} % of the surface was checked." if partly else ""
    if failures:
        return f"The part does not pass: {', '.join(failures)}.{of_it}", False
    if share == 0.0:
        return "No verdict: nothing was checked, since the surface encloses no volume.", None
    if partly:
        return f"No verdict: nothing fails where the part was checked.{of_it}", None
    return "All walls, ribs and gaps that were checked are within the limits.", True


def _note_limits(
    check: WallCheck, limits: WallLimits, options: WallCheckRun, shape: Shape, progress: Progress
) -> None:
    unit = shape.unit
    low, high = with_unit(check.minimum, unit), with_unit(check.maximum, unit)
    if limits.minimum is None and limits.maximum is None:
        text = (
            f"No limit was given: {low} to {high} were taken, {LEAST_SHARE:g} and "
            f"{LARGEST_SHARE:g} times the typical wall of {with_unit(check.typical, unit)}. Say "
            "--minimum, --maximum, --material or --process."
        )
    elif limits.maximum is None:
        text = f"Walls are to be at least {low} thick."
    elif limits.minimum is None:
        text = f"Walls are to be at most {high} thick."
    else:
        text = f"Walls are to be {low} to {high} thick."
    if options.material != NONE:
        text += f" What is not given is usual for {options.material}, injection moulded."
    process = "" if options.process == NONE else options.process.replace("_", " ")
    if options.rules:
        named = f", for {process}" if process else ""
        text += f" What is not given stands in {Path(options.rules).name}{named}."
    elif process:
        text += f" What is not given is usual for {process}."
    told: dict[str, Any] = {"minimum": check.minimum, "material": options.material}
    told |= {"process": options.process, "rules": options.rules}
    progress.note(text, "wall_limits", **told)


def _note_regions(
    check: WallCheck, limits: WallLimits, fine: Shape, shape: Shape, progress: Progress
) -> None:
    words = {
        "too thin": ("region", "too thin, the worst {} thick"),
        "too thick": ("region", "too thick, the worst {} thick"),
        "gap": ("gap", "too narrow, the worst {} wide"),
    }
    failed = False
    for kind, (noun, text) in words.items():
        regions = check.of_kind(kind)  # type: ignore[arg-type]
        if not regions:
            continue
        failed = True
        worst = regions[0]
        place = ", ".join(f"{x:.6g}" for x in worst.position + shape.offset)
        text = (
            f"{counted(len(regions), noun, verbs=('is', 'are'))} "
            f"{text.format(with_unit(worst.value, shape.unit))} at ({place})."
        )
        progress.warn(text, kind.replace(" ", "_"), regions=len(regions), worst=worst.value)
    share = _checked_share(check, fine)
    if share < 1.0 - UNCHECKED:
        parts = len(np.unique(fine.components[~check.checked]))
        text = (
            f"{100 * (1.0 - share):.3g} % of the surface, {counted(parts, 'part')}, was not "
            "checked: it encloses no volume there. Close the surface, or thicken it to a solid."
        )
        progress.warn(text, "not_checked", share=1.0 - share, parts=parts)
    elif not failed:
        progress.note("All walls are within the limits.", "walls_pass")
    if found := check.of_kind("part lines"):
        width = limits.line_width
        text = (
            f"{counted(len(found), 'region', verbs=('is', 'are'))} not whole lines of "
            f"{with_unit(width, shape.unit)}: {found[0].value / width:.2f} lines where it is "
            "farthest from it."
        )
        progress.warn(text, "part_lines", regions=len(found), lines=found[0].value / width)
    if overlaps := len(check.of_kind("overlap")):
        text = (
            f"{counted(overlaps, 'place', verbs=('is', 'are'))} thin because parts of the mesh "
            "overlap there: the values tell how deep, not how thick a wall is."
        )
        progress.warn(text, "overlaps", places=overlaps)
    if check.flaws:
        text = (
            f"{counted(check.flaws, 'ball', verbs=('was', 'were'))} left out that folds of the "
            "mesh make far smaller than the samples are apart."
        )
        progress.note(text, "specks", balls=check.flaws)
    if count := int(check.edge.sum()):
        text = (
            f"{counted(count, 'sample', of=len(check.edge), verbs=('lies', 'lie'))} at sharp "
            "edges, which are no thin walls."
        )
        progress.note(text, "sharp_edges", samples=count)


def _note_ribs(check: WallCheck, most: float, progress: Progress) -> None:
    if not check.ribs or math.isinf(most):
        return
    worst, count = check.ribs[0], _thick_ribs(check, most)
    text = (
        f"{count} of {len(check.ribs)} ribs and bosses {'is' if count == 1 else 'are'} thicker "
        f"than {most:g} of the wall beside them, {worst.ratio:.3g} at most."
    )
    told: dict[str, Any] = {"ribs": len(check.ribs), "thick": count, "ratio": worst.ratio}
    (progress.warn if count else progress.note)(text, "ribs", **told)


WALL_CHECK = Operation(
    name="wall_check",
    filter_name="compute_scalar_by_medial_wall_check_per_vertex",
    label="Wall Check",
    group="Thickness",
    help="Check the walls of a part against a least and a largest thickness, for moulding, casting "
    "and printing.\n\n"
    "Lists the regions that are too thin or too thick with area, place and values, ribs and bosses "
    "with their ratio to the wall that they stand on, and gaps between walls that are too narrow. "
    "Sharp edges, fillets and parts that overlap are told from thin walls. Limits are given as "
    "lengths, such as 1mm, by the name of a process or a plastic, or in a file of rules.",
    source="thesis 3.5.1",
    examples=(
        ("bracket.ply --unit in --minimum 1.5mm --maximum 4mm", "walls outside of 1.5 to 4 mm"),
        ("bracket.ply --unit in --process FDM -o print", "for a printer, its lines as well"),
    ),
    layers={
        "wall_check": "the surface with thickness, checked thickness, check (0 within, 1 too thin, "
        "2 too thick, 3 edge, 4 overlap, 5 gap, 6 part lines) and region at each vertex",
        "wall_regions": "one point for each region, at its worst place",
        "ribs": "one point for each rib or boss, with its ratio to the wall",
        "samples": "the same on the refined surface",
    },
    options=WallCheckRun,
    run=run_wall_check,
    thin_lines=True,
    checks=True,
    order=42,
    words=("thin walls", "3D print check", "moulding"),
)
