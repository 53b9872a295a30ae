"""Cases of the kind `shapes`: a nasty shape, an operation and random options that are all valid."""

from __future__ import annotations

import json
import math
import os
import random
import resource
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

import medialis
from fuzz.kinds import GIGABYTE, Case, Fault, Kind
from fuzz.nasty_shapes import Faces, Points, nasty_mesh, nasty_normals
from medialis.base.options import Kind as Option
from medialis.base.options import Parameter
from medialis.formats.json_npz import json_text, read_npz
from medialis.formats.ply_attributes import read_ply_attributes, write_ply
from medialis.operations.declaration import Operation
from medialis.operations.result import Result

SECONDS = 10.0
"""Processor time of an operation on fewer than 1,000 vertices with options no dearer than usual."""

LONG_SECONDS = 60.0
"""The same where options ask for more samples, directions or views."""

SLOWER = 10.0 if os.environ.get("NUMBA_BOUNDSCHECK") == "1" else 1.0
"""Kernels that check bounds are compiled meanwhile and slow: what they cost tells nothing."""

USUAL_SECONDS, MOST_SLOWNESS = 0.35, 3.0
"""Processor time of 200,000 nearest neighbours on a quiet machine of 2026, and how much slower a
machine may be before cases are slow on it."""

MOST_MEMORY = 3 * GIGABYTE

MAY_BE_INFINITE = {"importance", "length", "geodesic_length", "edge_radius"}
"""+inf where the feature points of a ball lie on different parts: no path joins them; edges that
are not there are infinitely blunt."""

MAY_BE_NAN = {
    *("centers", "radii", "spoke_angles", "spoke_angle", "radius", "feature_radius"),
    *("radius_ratio", "importance", "geodesic_length", "start_tangent", "end_tangent"),
    *("length", "tangent", "candidate_measure"),
}
"""Arrays and attributes of balls that are not there, or that have no second feature point, as the
classes that they come from say."""

WORK = {
    "refine": (0.01, 1.0),
    "candidates": (0.005, 1.0),
    "directions": (2, 200),
    "size": (32, 512),
    "pairs": (1, 100),
    "neighbours": (4, 20),
    "bone_length": (0.01, 1.0),
    "balls": (1, 1000),
    "samples": (100, 20_000),
    "error": (0.005, 0.5),
    "cell": (0.0025, 0.2),
}
"""Ranges of options that ask for more work than the shape brings."""

MAY_BE_ZERO = ("refine", "error")
"""Options of these whose 0 asks for nothing: it is drawn too."""


def run(case: Case) -> None:
    """Make shape and options, run the operation, look at all that it returns."""
    rng = case.rng
    operations = medialis.OPERATIONS
    chosen = operations[case.number % len(operations)]
    points, faces, made = nasty_mesh(rng)
    cloud = not chosen.needs_faces and rng.random() < 0.2
    normals = nasty_normals(rng, points) if cloud else None
    repair = rng.random() < 0.8
    options = random_options(rng, chosen, len(points), case.folder)
    about = {"operation": chosen.name, "options": options, "repair": repair, "made": made}
    keep_shape(case, {**about, "cloud": cloud}, points, None if cloud else faces, normals)
    extras = rng.random(), rng.random()
    try:
        shape = medialis.make_shape(points, None if cloud else faces, normals, repair=repair)
        begin, before = time.process_time(), peak_memory()
        result = _computed(chosen, shape, options, threads=1)
        limit = SLOWER * (LONG_SECONDS if _dear(chosen, options) else SECONDS)
        check_cost(chosen.name, time.process_time() - begin, peak_memory() - before, limit)
        check_result(result)
        if extras[0] < 0.15:
            _check_threads(result, _computed(chosen, shape, options, threads=2))
        if extras[1] < 0.15:
            _check_written(result, case.folder / "written")
    except medialis.MedialisError as error:
        if not str(error).strip():
            raise Fault("an error without a sentence") from error


def keep_shape(
    case: Case,
    about: Mapping[str, Any],
    points: Points,
    faces: Faces | None,
    normals: Points | None = None,
) -> None:
    """Write what a case is about into its folder, which stays where something is found."""
    (case.folder / "about.json").write_text(json.dumps(about, indent=1))
    given = {"points": points, "faces": faces, "normals": normals}
    arrays = {name: rows for name, rows in given.items() if rows is not None}
    np.savez(case.folder / "shape.npz", **arrays)  # type: ignore[arg-type]
    write_ply(case.folder / "shape.ply", points, faces)


def random_options(
    rng: random.Random, chosen: Operation, points: int, folder: Path
) -> dict[str, Any]:
    """Draw options from their declared ranges, each at its default half of the time."""
    options = {}
    for parameter in chosen.parameters:
        # A layer that is given back leaves nothing to compute.
        if rng.random() < (0.1 if parameter.layer else 0.5):
            value = _drawn(rng, parameter, points, folder)
            if value is not None:
                options[parameter.name] = value
    if chosen.name == "geodesic_path" and "start" not in options:
        options["start"] = rng.randrange(points)
    return options


def _drawn_mesh(rng: random.Random, path: Path) -> str:
    """Write a medial mesh of random balls, edges and triangles, some of them twice."""
    count = rng.choice((1, 2, 5, 30))
    size = rng.choice((0.0, 1e-3, 1.0, 100.0))
    lines = [f"{count} 0 0"]
    for _ in range(count):
        center = [size * rng.uniform(-1, 1) for _ in range(3)]
        lines.append(f"v {center[0]} {center[1]} {center[2]} {size * max(0, rng.uniform(-1, 1))}")
    for word, corners in (("e", 2), ("f", 3)):
        for _ in range(rng.choice((0, count))):
            balls = (rng.randrange(count) for _ in range(corners))
            lines.append(" ".join([word, *map(str, balls)]))
    path.write_text("\n".join(lines))
    return os.fspath(path)


def usual_number(parameter: Parameter) -> float:
    """Return the default of a number, or what "auto" starts from."""
    return parameter.default if parameter.auto is None else parameter.auto


def _drawn(rng: random.Random, parameter: Parameter, points: int, folder: Path) -> Any:
    if parameter.kind is Option.BOOL:
        return rng.random() < 0.5
    if parameter.kind is Option.CHOICE:
        return rng.choice(parameter.choices)
    if parameter.layer:
        return _drawn_mesh(rng, folder / f"{parameter.name}.ma")
    if parameter.kind is Option.FILE:
        path = folder / f"{parameter.name}.txt"
        rows = [rng.randrange(points) for _ in range(2 * rng.choice((1, 5, 50)))]
        pairs = zip(rows[::2], rows[1::2], strict=True)
        whole = "".join(f"{a} {b}\n" for a, b in pairs)
        path.write_text(whole if parameter.name == "pairs" else whole.replace(" ", "\n"))
        return os.fspath(path)
    if parameter.name in ("start", "end"):
        return rng.randrange(points)
    low, high = WORK.get(parameter.name, (parameter.low, parameter.high))
    low, high = max(low, parameter.low), min(high, parameter.high)
    if parameter.name in MAY_BE_ZERO and rng.random() < 0.4:
        return 0.0
    small = max(low, 1e-6 * high)
    draws = (
        low,
        high,
        rng.uniform(low, high),
        small * (high / small) ** rng.random(),
        min(high, max(low, usual_number(parameter) * rng.uniform(0.5, 2))),
    )
    value = rng.choice(draws)
    return round(value) if parameter.kind is Option.INT else float(value)


def _dear(chosen: Operation, options: Mapping[str, Any]) -> bool:
    """Whether an option asks for more work than its default."""
    for parameter in chosen.parameters:
        usual = usual_number(parameter)
        value = options.get(parameter.name, usual)
        if parameter.name in ("refine", "candidates", "bone_length", "cell"):
            if 0 < value < usual:
                return True
        elif parameter.name == "error":  # a search of many fits
            if value > 0:
                return True
        elif parameter.name in WORK and parameter.kind is Option.INT and value > usual:
            return True
    if options.get("seeds") == "all" or options.get("quality") == "best":
        return True
    return bool(options.get("pairs"))


def _computed(
    chosen: Operation, shape: medialis.Shape, options: Mapping[str, Any], *, threads: int
) -> Result:
    with medialis.memory_limit(0):
        return medialis.run(chosen.name, shape, threads=threads, **options)


def check_cost(name: str, seconds: float, memory: int, limit: float) -> None:
    """Compare processor time with a limit on a quiet machine, and memory with `MOST_MEMORY`."""
    if seconds > limit and seconds > limit * (slow := slowness()):
        text = f"{seconds:.1f} s of processor time, at most {limit:g} x {slow:.2f}"
        raise Fault(f"slow: {name}", text, again=True)
    if memory > MOST_MEMORY:
        raise Fault(f"memory of {name}", f"{memory / GIGABYTE:.1f} GiB")


def slowness() -> float:
    """How many times as slow as usual the machine is now, 1 to `MOST_SLOWNESS`.

    Processor time grows where others use the same caches and the other half of a core.
    """
    points = np.random.default_rng(0).random((200_000, 3))
    begin = time.process_time()
    cKDTree(points).query(points, k=2)
    return min(max(1.0, (time.process_time() - begin) / USUAL_SECONDS), MOST_SLOWNESS)


def check_result(result: Result) -> None:
    """Look for NaN, for indices that name nothing, and for balls larger than the shape."""
    for place, number in _numbers(result.values, "values"):
        if not math.isfinite(number):
            raise Fault(f"{number} in {result.operation}: {place}")
    for layer in result.layers:
        if not np.isfinite(layer.points).all():
            raise Fault(f"layer {layer.name} of {result.operation} has points that are NaN")
        for ends in (layer.faces, layer.edges):
            if (
                ends is not None
                and ends.size
                and not 0 <= ends.min() <= ends.max() < len(layer.points)
            ):
                raise Fault(
                    f"layer {layer.name} of {result.operation} names points that are not there"
                )
        for name, values in layer.attributes.items():
            _check_numbers(values, name, f"{result.operation}: layer {layer.name}")
            if name in ("radius", "radii") and (values > result.shape.diagonal).any():
                raise Fault(f"layer {layer.name} of {result.operation} has balls larger than it")
    for name, values in result.arrays.items():
        _check_numbers(np.asarray(values), name, f"{result.operation}: arrays")
    json_text(result.values)


def _check_numbers(values: np.ndarray[Any, Any], name: str, place: str) -> None:
    if values.dtype.kind != "f":
        return
    endless = values == -np.inf if name in MAY_BE_INFINITE else np.isinf(values)
    if endless.any():
        raise Fault(f"infinity in {place}, {name}")
    if name not in MAY_BE_NAN and np.isnan(values).any():
        raise Fault(f"NaN in {place}, {name}")


def _numbers(value: Any, place: str) -> Iterator[tuple[str, float]]:
    if isinstance(value, float):
        yield place, value
    elif isinstance(value, Mapping):
        for key, item in value.items():
            yield from _numbers(item, f"{place}.{key}")
    elif isinstance(value, list | tuple):
        for item in value:
            yield from _numbers(item, f"{place}[]")


def _check_threads(one: Result, two: Result) -> None:
    """One and two threads give the same bits."""
    differ = [name for name in one.arrays if not _same(one.arrays[name], two.arrays[name])]
    for first, second in zip(one.layers, two.layers, strict=True):
        if not _same(first.points, second.points):
            differ.append(f"layer {first.name}")
        for name, values in first.attributes.items():
            if not _same(values, second.attributes[name]):
                differ.append(f"layer {first.name}, {name}")
    if json_text(one.values) != json_text(two.values):
        differ.append("values")
    if differ:
        raise Fault(f"threads change {one.operation}", ", ".join(differ))


def _same(a: np.ndarray[Any, Any], b: np.ndarray[Any, Any]) -> bool:
    return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()


def _check_written(result: Result, folder: Path) -> None:
    """Results can be drawn, written and read back."""
    manifest = medialis.write_result(result, folder)
    missing = [name for name in manifest["files"] if not Path(name).is_file()]
    if missing:
        raise Fault("files of a manifest are missing", f"{missing}")
    for layer in result.layers:
        read_ply_attributes(folder / f"{layer.name}.ply")
    arrays = read_npz(folder / f"{result.operation}.npz")
    if any(not _same(np.asarray(result.arrays[name]), arrays[name]) for name in result.arrays):
        raise Fault("arrays are others after writing and reading")


def peak_memory() -> int:
    """Bytes that the process had at most."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


KIND = Kind(
    run,
    processor_seconds=75.0 * SLOWER,
    wall_seconds=400.0 * SLOWER,
    memory=12 * GIGABYTE,
    share=3.0,
)
