"""Make every picture of the docs by running the operations on generated shapes.

python docs/make_pictures.py [NAME ...]
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

import medialis
from medialis.robots.urdf import link_shapes, robot_of
from medialis.show.annotation import ColorBar, contact_sheet
from medialis.show.camera import Camera
from medialis.show.colors import value_range
from medialis.show.picture import (
    IN_DEGREES,
    Balls,
    Curves,
    Points,
    Surface,
    draw,
    draw_panels,
    draw_result,
    draw_turntable,
)
from medialis.show.png import write_png
from medialis.show.raster import Style

Image = NDArray[np.uint8]
FOLDER = Path(__file__).resolve().parent / "pictures"
WIDTH = 2000
"""Pixels across a page: twice those of most screens."""

CROPPED = Style(crop=True)


def hero() -> Image:
    """Draw surface skeletons of a creature, a part of a machine and a hand."""
    names = ("creature", "bracket", "hand")
    results = [medialis.run("surface_skeleton", medialis.sample_shape(name)) for name in names]
    return _sheet(results, names, 3)


def overview() -> Image:
    """Draw six results of one shape, for the first page."""
    shape = medialis.organic_shape(160)
    runs = {
        "where its middle is": ("skeleton_mesh", ""),
        "how its parts hang together": ("curve_skeleton", ""),
        "how thick it is, and where thinnest": ("thickness", ""),
        "which parts it has": ("parts", ""),
        "bones, and what they move": ("armature", "skin"),
        "its smooth sheets": ("medial_sheets", "sheet_meshes"),
    }
    images = []
    for name, layer in runs.values():
        result = medialis.run(name, shape)
        if layer:
            result = _layer_of(result, layer)
        images.append(_picture(result, 3, style=Style(crop=True, legend=False)))
    return contact_sheet(images, list(runs), 3)


def _all_balls(shape: medialis.Shape, **options: object) -> medialis.Result:
    """Compute the whole surface skeleton: no noise smoothed away, no ball hidden."""
    return medialis.run("surface_skeleton", shape, denoise="off", importance=False, **options)


def spoke_angle() -> Image:
    """Colour by spoke angle."""
    result = _all_balls(medialis.organic_shape(200))
    return _picture(result, color_by="spoke_angle")


def _picture(
    result: medialis.Result, columns: int = 1, *, style: Style = CROPPED, **options: Any
) -> Image:
    """Draw a result as wide as one of so many columns of a page."""
    width = WIDTH // columns
    return draw_result(result, width=width, height=int(0.8 * width), style=style, **options)


def _sheet(
    results: list[medialis.Result],
    captions: Sequence[str],
    columns: int = 2,
    *,
    color_by: str | None = None,
) -> Image:
    """Draw results side by side; those of one quantity on one shape share a scale and a legend."""
    options: dict[str, Any] = {"color_by": color_by}
    key = _shared_scale(results, color_by)
    if key is not None:
        options["style"] = replace(CROPPED, legend=False, limits=(key.low, key.high))
    images = [_picture(r, columns, **options) for r in results]
    return contact_sheet(images, captions, columns, key=key)


def _shared_scale(results: list[medialis.Result], color_by: str | None) -> ColorBar | None:
    """Return the scale of results that show the same quantity of shapes of the same size."""
    layers = [(result.shown or result.layers)[0] for result in results]
    names = {color_by or layer.color_by for layer in layers}
    name = names.pop() if len(names) == 1 else None
    sizes = [result.shape.diagonal for result in results]
    if name is None or any(name in layer.labels for layer in layers) or np.ptp(sizes) > 0.1:
        return None
    factor = 180 / np.pi if name in IN_DEGREES else 1.0
    shown = [factor * layer.attributes[name][~layer.hidden] for layer in layers]
    scales = [
        value_range(values, *(layer.color_limits if layer.color_by == name else (None, None)))
        for layer, values in zip(layers, shown, strict=True)
    ]
    limits = min(low for low, _ in scales), max(high for _, high in scales)
    missing = any(bool(np.isnan(values).any()) for values in shown)
    colors = {layer.color_map if layer.color_by == name else "sequential" for layer in layers}
    unit = " (degrees)" if name in IN_DEGREES else ""
    return ColorBar(name.replace("_", " ") + unit, colors.pop(), *limits, missing)


def subsample() -> Image:
    """Thesis Figure 3.3: the skeleton thinned to four point distances, coloured by spoke angle."""
    shape, distances = medialis.organic_shape(200), (0.0, 0.005, 0.01, 0.02)
    results = [_all_balls(shape, subsample=d) for d in distances]
    captions = [
        f"point distance {100 * d:g} %: {r.values['skeleton_points']} points"
        for d, r in zip(distances, results, strict=True)
    ]
    return _sheet(results, captions, color_by="spoke_angle")


def _noisy(amount: float) -> medialis.Shape:
    shape = medialis.organic_shape(160)
    step = np.random.default_rng(0).normal(size=shape.point_count) * amount * shape.diagonal
    return medialis.make_shape(shape.points + step[:, None] * shape.normals, shape.faces)


def tolerance() -> Image:
    """Noise of 0.05 % of the size against four tolerances."""
    shape, values = _noisy(0.0005), (0.0, 0.0003, 0.001, 0.003)
    results = [_all_balls(shape, tolerance=t) for t in values]
    return _sheet(results, [f"tolerance {100 * t:g} %" for t in values])


def _box() -> medialis.Shape:
    corners = np.array([[x, y, z] for x in (0, 3) for y in (0, 2) for z in (0, 1)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return medialis.make_shape(corners, faces, repair=True)


def refine() -> Image:
    """Draw a box of 8 vertices with three refinements."""
    values = (0.0, 0.05, 0.02, 0.005)
    results = [_all_balls(_box(), refine=v) for v in values]
    captions = [
        f"refine {100 * v:g} %: {r.values['samples']} samples"
        for v, r in zip(values, results, strict=True)
    ]
    return _sheet(results, captions)


def sides() -> Image:
    """Inner and outer skeleton."""
    shape = medialis.organic_shape(160)
    results = [_all_balls(shape, side=side) for side in ("inner", "outer")]
    return _sheet(results, ["side inner", "side outer"])


def reconstruction() -> Image:
    """Thesis Figure 3.7: surface, union of balls, difference."""
    shape = medialis.organic_shape(300)
    return medialis.run("ball_reconstruction", shape, size=660).images["reconstruction"]


def progressive() -> Image:
    """Thesis 3.4: growing shares of the balls, largest first."""
    shape = medialis.organic_shape(200)
    return medialis.run("ball_reconstruction", shape, size=500, progressive=True).images[
        "progressive"
    ]


def _dented_plate() -> medialis.Shape:
    """Make a plate 3 x 2 x 0.4 with two round dents from both sides, 0.08 and 0.16 left."""
    x, y = np.meshgrid(np.linspace(-1.5, 1.5, 121), np.linspace(-1, 1, 81), indexing="ij")
    half = np.full(x.shape, 0.2)
    for u, v, left in ((-0.7, 0.1, 0.08), (0.6, -0.3, 0.16)):
        half -= (0.2 - left / 2) * np.exp(-((x - u) ** 2 + (y - v) ** 2) / 0.35**2)
    top = np.stack([x, y, half], axis=2).reshape(-1, 3)
    n, index = len(top), np.arange(len(top)).reshape(x.shape)
    a, b, c, d = (
        i.ravel() for i in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:])
    )
    cells = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    loop = np.concatenate([index[:-1, 0], index[-1, :-1], index[:0:-1, -1], index[0, :0:-1]])
    ahead = np.roll(loop, -1)
    rim = [(loop, loop + n, ahead + n), (loop, ahead + n, ahead)]
    faces = [cells, cells[:, ::-1] + n, *(np.stack(corners, axis=1) for corners in rim)]
    return medialis.make_shape(np.concatenate([top, top * [1, 1, -1]]), np.concatenate(faces))


def thickness() -> Image:
    """Thickness of the creature (thesis Figure 3.11) and of a plate with two dents."""
    shapes = (medialis.organic_shape(200), _dented_plate())
    results = [medialis.run("thickness", shape) for shape in shapes]
    captions = [f"{r.values['thin_spots']} thin spots" for r in results]
    return _sheet(results, captions)


def wall_angle() -> Image:
    """All balls, and only those of walls."""
    shapes, angles = (_box(), medialis.organic_shape(160)), (0.0, 120.0)
    results = [medialis.run("thickness", s, min_spoke_angle=a) for s in shapes for a in angles]
    return _sheet(results, [f"min spoke angle {angle:g} degrees" for angle in angles * 2])


def _blocks(*boxes: tuple[float, ...]) -> medialis.Shape:
    """Make the union of boxes (x0, x1, y0, y1, z0, z1), in millimetres."""
    planes = [sorted({box[2 * d + end] for box in boxes for end in (0, 1)}) for d in range(3)]
    filled = np.zeros([len(plane) + 1 for plane in planes], bool)
    for box in boxes:
        ends = [[p.index(box[2 * d + end]) + 1 for end in (0, 1)] for d, p in enumerate(planes)]
        filled[tuple(slice(*pair) for pair in ends)] = True
    corners = []
    for cell, axis, side in itertools.product(np.argwhere(filled), range(3), (0, 1)):
        step = np.eye(3, dtype=int)
        if not filled[tuple(cell + (2 * side - 1) * step[axis])]:
            u, v = step[(axis + 1) % 3], step[(axis + 2) % 3]
            quad = [cell - 1 + side * step[axis] + w for w in (0 * u, u, u + v, v)]
            quad = quad if side else quad[::-1]
            corners += [quad[i] for i in (0, 1, 2, 0, 2, 3)]
    keys, faces = np.unique(corners, axis=0, return_inverse=True)
    points = np.stack([np.array(planes[d])[keys[:, d]] for d in range(3)], axis=1)
    return medialis.make_shape(points, faces.reshape(-1, 3), unit="mm")


def _joined(*shapes: medialis.Shape) -> medialis.Shape:
    """Make one shape of several."""
    starts = np.cumsum([0, *(shape.point_count for shape in shapes)])
    faces = [shape.faces + start for shape, start in zip(shapes, starts, strict=False)]
    points = np.concatenate([shape.points for shape in shapes])
    return medialis.make_shape(points, np.concatenate(faces), unit="mm")


def _blade() -> medialis.Shape:
    """Make a plate of 3 mm, ground to an edge of 40 degrees."""
    outline = np.array([(0, 0), (4.12, -1.5), (30, -1.5), (30, 1.5), (4.12, 1.5)])
    low, high = (np.column_stack([outline, np.full(5, z)]) for z in (0.0, 20.0))
    cap = np.array([(0, 1, 4), (1, 2, 3), (1, 3, 4)])
    i, j = np.arange(5), np.roll(np.arange(5), -1)
    walls = [np.stack([i, j, j + 5], axis=1), np.stack([i, j + 5, i + 5], axis=1)]
    faces = np.concatenate([cap[:, ::-1], cap + 5, *walls])
    return medialis.make_shape(np.concatenate([low, high]), faces, unit="mm")


def wall_check() -> Image:
    """Check a plate with ribs, a box with its lid, and a blade."""
    ribs = (0, 60, 19, 20.2, 2, 12), (10, 13, 5, 8, 2, 12), (30, 32, 0, 19, 2, 12)
    plate = _blocks((0, 60, 0, 40, 0, 2), *ribs, (0, 60, 39.4, 40, 2, 12))
    ends = [(x, x + 3, 0, 50, 0, 30) for x in (0, 57)]
    sides = [(0, 60, y, y + 3, 0, 30) for y in (0, 47)]
    box = _joined(_blocks((0, 60, 0, 50, 0, 3), *ends, *sides), _blocks((0, 60, 0, 50, 30.5, 31.7)))
    limits: list[tuple[medialis.Shape, dict[str, str]]] = [
        (plate, {"minimum": "1mm", "maximum": "2.5mm"}),
        (box, {"minimum": "1.5mm", "maximum": "4mm", "gap": "1mm"}),
        (_blade(), {"minimum": "2mm"}),
    ]
    results = [medialis.run("wall_check", shape, **given) for shape, given in limits]  # type: ignore[call-overload]
    captions = [
        ", ".join(region["kind"] for region in r.values["regions"]) or "passes" for r in results
    ]
    return _sheet(results, captions, 3)


def turntable() -> Image:
    """Eight views all round."""
    result = medialis.run("surface_skeleton", medialis.organic_shape(160))
    return contact_sheet(list(draw_turntable(result, 8, size=500)), columns=4)


def views() -> Image:
    """Orthographic and perspective projection."""
    result = medialis.run("surface_skeleton", medialis.organic_shape(160))
    points = result.shape.points
    size = {"width": WIDTH // 2, "height": WIDTH // 3}
    cameras = [
        Camera.framing(
            points, direction=(1, -1.2, 0.4), up=(0, 0, 1), perspective=perspective, **size
        )
        for perspective in (False, True)
    ]
    images = [draw_result(result, camera=camera, style=CROPPED) for camera in cameras]
    return contact_sheet(images, ["orthographic", "perspective"], 2)


def skeleton_mesh() -> Image:
    """Thesis Figures 3.8, 3.9: the skeleton as triangles."""
    result = medialis.run("skeleton_mesh", medialis.organic_shape(200))
    return _picture(result, title="Surface skeleton as triangles")


def mesh_angles() -> Image:
    """Thesis Figure 3.9 m-r: the mesh of all points, and simplified by three spoke angles."""
    shape, angles = medialis.organic_shape(200), (0.0, 30.0, 60.0, 90.0)
    results = [medialis.run("skeleton_mesh", shape, min_spoke_angle=a) for a in angles]
    captions = [
        f"spoke angle from {a:g} degrees: {r.values['faces']} faces"
        for a, r in zip(angles, results, strict=True)
    ]
    return _sheet(results, captions)


def mesh_bridges() -> Image:
    """Draw the gaps of left-out points: torn, and bridged."""
    shape = _noisy(0.0005)
    results = [medialis.run("skeleton_mesh", shape, bridge=b) for b in (0, 2)]
    return _sheet(results, ["bridge 0", "bridge 2"])


def mesh_box() -> Image:
    """Draw the sheets of a box of 8 vertices: points and triangles."""
    results = [medialis.run(name, _box()) for name in ("surface_skeleton", "skeleton_mesh")]
    return _sheet(results, ["points", "triangles"])


def _balls_and_envelope(shape: medialis.Shape, count: int, camera: Camera) -> list[Image]:
    """Draw the medial mesh of a shape, and its envelope."""
    mesh = medialis.medial_mesh(shape, balls=count)
    around = Surface(shape.points, shape.faces, opacity=0.12)
    balls = Balls(mesh.centers, mesh.radii, values=mesh.radii)
    envelope = medialis.envelope_surface(mesh)
    items = [
        [around, Surface(mesh.centers, mesh.faces), Curves(mesh.centers, mesh.edges, width=2.0)],
        [balls],
        [Surface(envelope.points, envelope.faces)],
    ]
    return [draw(one, camera) for one in items]


def medial_mesh() -> Image:
    """Draw 30, 120 and 500 balls: the complex, the balls, and the envelope."""
    shape = medialis.organic_shape(200)
    camera = Camera.framing(shape.points, width=400, height=300)
    counts = (30, 120, 500)
    images = [one for count in counts for one in _balls_and_envelope(shape, count, camera)]
    words = ("edges and triangles", "balls", "envelope")
    return contact_sheet(images, [f"{n}: {word}" for n in counts for word in words], 3)


def medial_mesh_balls() -> Image:
    """Draw levels of one sequence, from coarse to fine."""
    shape = medialis.organic_shape(200)
    camera = Camera.framing(shape.points, width=300, height=225)
    mesh, images, counts = medialis.medial_mesh(shape, balls=120), [], (4, 8, 15, 30, 60, 120)
    for count in counts:
        envelope = medialis.envelope_surface(mesh.level(count))
        images.append(draw([Surface(envelope.points, envelope.faces)], camera))
    return contact_sheet(images, [f"{count} balls" for count in counts], 3)


def medial_mesh_sheets() -> Image:
    """Draw the sheets of 500 balls, each with its own vertices: colours end at seams."""
    result = medialis.run("medial_mesh", medialis.organic_shape(200), balls=500)
    layer = result.layers[0]
    assert layer.faces is not None
    corners = layer.points[layer.faces].reshape(-1, 3)
    sheets = medialis.Layer(
        "sheets",
        corners,
        np.arange(len(corners), dtype=np.int32).reshape(-1, 3),
        attributes={"sheet": np.repeat(layer.face_attributes["sheet"], 3)},
        color_by="sheet",
        labels=("sheet",),
    )
    values = result.values
    title = f"{values['sheets']} sheets of 500 balls, {values['seams']} seams"
    return _picture(replace(result, layers=(sheets,)), title=title)


def view_curve_skeleton() -> Image:
    """Thesis Figures 3.17, 3.18: the graph, and the points that it was linked from."""
    shape = medialis.organic_shape(160)
    result = medialis.run("view_curve_skeleton", shape, pairs=200, size=512)
    return _picture(result, title="Curve skeleton from 200 pairs of views")


def _walls(name: str) -> medialis.Shape:
    """Make one of the solids of walls that the tests know."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
    import plates

    return medialis.make_shape(*getattr(plates, name)())


def midsurface() -> Image:
    """Draw solids of walls and their midsurfaces, in the colours of the thickness."""
    parts = {
        "I-beam": ("i_beam", (0.6, 0.35, 0.7), (0, 1, 0)),
        "bracket with ribs": ("bracket", (0.5, 0.8, 0.6), (0, 0, 1)),
        "box": ("open_box", (0.5, -0.7, 0.9), (0, 0, 1)),
        "bent sheet": ("bent_sheet", (-0.7, 0.5, 0.8), (0, 1, 0)),
        "pipe junction": ("pipe_tee", (0.5, -1.0, 0.6), (0, 0, 1)),
        "step from 4 to 6": ("step", (0.3, 0.5, 0.9), (0, 1, 0)),
    }
    images = []
    for name, direction, up in parts.values():
        shape = _walls(name)
        found = medialis.midsurface(shape, edge=0.025)
        camera = Camera.framing(
            shape.points, width=WIDTH // 4, height=WIDTH // 4, direction=direction, up=up
        )
        corners = found.points[found.faces].reshape(-1, 3)
        rows = np.arange(len(corners), dtype=np.int32).reshape(-1, 3)
        lines = np.sort(found.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        edges = Curves(found.points, np.unique(lines, axis=0), width=1.0)
        welds = Curves(found.points, found.weld_edges, width=4.0)
        sheets = Surface(corners, rows, labels=np.repeat(found.sheet, 3))
        images.append(draw([Surface(shape.points, shape.faces)], camera, style=CROPPED))
        images.append(draw([sheets, edges, welds], camera, style=CROPPED))
    return contact_sheet(images, [w for name in parts for w in (name, "midsurface")], 4)


def importance() -> Image:
    """Thesis Figure 3.4: the skeleton of a noisy shape at three thresholds of importance."""
    shape, thresholds = _noisy(0.001), (0.0, 0.02, 0.05, 0.1)
    results = [
        medialis.run("skeleton_importance", shape, denoise="off", threshold=t) for t in thresholds
    ]
    captions = [
        f"importance from {100 * t:g} %: {r.values['skeleton_points']} points"
        for t, r in zip(thresholds, results, strict=True)
    ]
    return _sheet(results, captions)


def measures() -> Image:
    """Prune a noisy skeleton by importance, spoke angle and radius, to the same number."""
    shape = _noisy(0.001)
    result = medialis.run("skeleton_importance", shape, denoise="off")
    layer = result.layers[0]
    count = result.values["points_above_percent"]["5"]
    results = []
    for name in ("importance", "spoke_angle", "radius"):
        values = layer.attributes[name]
        kept = np.sort(np.argsort(-values, kind="stable")[:count])
        attributes = {key: array[kept] for key, array in layer.attributes.items()}
        pruned = medialis.Layer(name, layer.points[kept], attributes=attributes, color_by=name)
        results.append(replace(result, layers=(pruned,)))
    return _sheet(results, [f"{count} points by {r.layers[0].name}" for r in results])


def geodesic() -> Image:
    """Draw a geodesic path from the nose to a hind foot."""
    shape = medialis.organic_shape(160)
    ends = [int(np.argmax(shape.points @ d)) for d in ((1, 0.1, -0.2), (-0.4, 0.5, -1))]
    return _picture(medialis.run("geodesic_path", shape, start=ends[0], end=ends[1]))


def _tubes() -> list[medialis.Shape]:
    """Make tubes round half a ring, three arms and three crossing axes."""
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))
    from tubes import arc, segment, tube

    arms = [segment([0, 0, 0], end) for end in ([0, 0, -1.4], [1.2, 0.2, 0.8], [-1.2, 0, 0.8])]
    axes = [segment(-end, end) for end in 1.3 * np.eye(3)]
    bent = [arc([0, 0, 0], 1, 0, np.pi)]
    return [tube(curves, 0.25, 0.06) for curves in (bent, arms, axes)]


def _wheel() -> medialis.Shape:
    """Make a tube round a ring with two bars: three handles."""
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))
    from tubes import circle, segment, tube

    bars = [segment([-1.2, y, 0], [1.2, y, 0]) for y in (-0.5, 0.5)]
    return tube([circle([0, 0, 0], 1.3), *bars], 0.2, 0.06)


def curve_skeleton() -> Image:
    """Thesis Figure 3.13: curve skeletons with the radius, of a creature and of a wheel."""
    results = [medialis.run("curve_skeleton", s) for s in (medialis.organic_shape(160), _wheel())]
    captions = [f"{r.values['branches']} branches, {r.values['loops']} loops" for r in results]
    return _sheet(results, captions)


def curve_candidates() -> Image:
    """Thesis 3.6.1 and 3.6.2: candidates by the measure I, and by the area importance."""
    result = medialis.run("curve_skeleton", medialis.organic_shape(160))
    layer = next(row for row in result.layers if row.name.endswith("candidates"))
    root = np.sqrt(layer.attributes["importance"]) / result.shape.diagonal
    area = medialis.Layer("area", layer.points, attributes={"root": root}, color_by="root")
    results = [replace(result, layers=(one,)) for one in (layer, area)]
    return _sheet(results, ["measure I", "square root of mu over the size"])


def curve_parts() -> Image:
    """Colour the surface by the branch of each point."""
    results = []
    for shape in (medialis.organic_shape(160), _wheel()):
        result = medialis.run("curve_skeleton", shape)
        parts = next(row for row in result.layers if row.on_input)
        results.append(replace(result, shown=(parts,)))
    return _sheet(results, ["", ""])


def curve_options() -> Image:
    """Thresholds and smoothing."""
    shape = medialis.organic_shape(160)
    options: list[dict[str, float]] = [
        {"threshold": 0.04},
        {"threshold": 0.15},
        {"smoothing": 0.0},
        {"simplify": 0.01},
    ]
    results = [medialis.run("curve_skeleton", shape, **given) for given in options]
    captions = [
        f"{name} {value:g}: {result.values['nodes']} nodes, {result.values['branches']} branches"
        for given, result in zip(options, results, strict=True)
        for name, value in given.items()
    ]
    return _sheet(results, captions)


def centerline() -> Image:
    """Draw the lines of an open tube that forks, and of the creature."""
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))
    from tubes import FORK, segment, tube

    shape = tube([segment([0, 0, 0], 3 * one) for one in FORK], 0.4, 0.1)
    ends = (shape.points[shape.faces].mean(axis=1) @ FORK.T > 2.9).any(axis=1)
    opened = medialis.make_shape(shape.points, shape.faces[~ends], repair=True)
    shown = [
        medialis.run("centerline", opened),
        medialis.run("centerline", medialis.organic_shape(120)),
    ]
    return _sheet(shown, ["an open tube", "a closed shape"], 2)


def tree_cylinders() -> Image:
    """Draw the points of a generated scan, and its cylinders beside them."""
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))
    from tree_scans import grown, scanned

    points = scanned(grown(3, 14), 25_000, positions=3, noise=0.003, occluded=True)
    cloud = replace(medialis.make_shape(points, unit="m"), up="z")
    return draw_panels(medialis.run("tree_cylinders", cloud), "cylinders", size=WIDTH // 2)


ARM = (
    ("base", "0 0 0.05", '<cylinder radius="0.1" length="0.1"/>'),
    ("shoulder", "0 0 0.2", '<cylinder radius="0.06" length="0.2"/>'),
    ("arm", "0.2 0 0.3", '<box size="0.5 0.08 0.1"/>'),
    ("hand", "0.47 0 0.22", '<box size="0.06 0.16 0.1"/>'),
    ("left", "0.47 0.06 0.12", '<box size="0.02 0.02 0.1"/>'),
    ("right", "0.47 -0.06 0.12", '<box size="0.02 0.02 0.1"/>'),
)
"""Links of an arm: name, place, shape."""


def robot_balls() -> Image:
    """Draw the links of an arm, balls that hold them, and balls that keep above a table."""
    row = '<link name="{}"><collision><origin xyz="{}"/><geometry>{}</geometry></collision></link>'
    links = "".join(row.format(*link) for link in ARM)
    with TemporaryDirectory() as folder:
        path = Path(folder, "arm.urdf")
        path.write_text(f'<robot name="arm">{links}</robot>', encoding="utf-8")
        shapes = list(link_shapes(path, robot_of(path), medialis.Progress()).values())
        plane = (0.0, 0.0, 1.0, 0.0)
        robots = [medialis.robot_balls(path, balls=n, plane=plane) for n in (30, 120)]
    camera = Camera.framing(np.concatenate([s.points for s in shapes]), width=600, height=450)
    solid = [Surface(s.points, s.faces) for s in shapes]
    images = [draw(solid, camera)]
    for robot in robots:
        covers = [
            Balls(one.centers, one.radii, values=np.full(len(one), float(k)))
            for k, one in enumerate(robot.links.values())
        ]
        images.append(draw(covers, camera))
    counts = [sum(map(len, robot.links.values())) for robot in robots]
    return contact_sheet(images, ["links", *(f"{count} balls" for count in counts)], 3)


def convex_pieces() -> Image:
    """Draw pieces moved apart: of a bracket, of a vase, and of the creature."""
    names, apart = ("bracket", "vase", "creature"), []
    for name in names:
        result = medialis.run("convex_pieces", medialis.sample_shape(name))
        layer, own = result.layers[0], result.layers[0].attributes["piece"]
        middles = np.array([layer.points[own == k].mean(axis=0) for k in range(own.max() + 1)])
        moved = layer.points + 0.35 * (middles - layer.points.mean(axis=0))[own]
        apart.append(replace(result, layers=(replace(layer, points=moved),)))
    counts = [result.values["pieces"] for result in apart]
    words = [f"{name}: {n} pieces" for name, n in zip(names, counts, strict=True)]
    return _sheet(apart, words, 3)


def curve_comparison() -> Image:
    """Five shapes: curve skeletons from the surface skeleton above, from views below."""
    shapes = [medialis.organic_shape(120), *_tubes(), _wheel()]
    names = ("curve_skeleton", "view_curve_skeleton")
    results = [medialis.run(name, shape) for name in names for shape in shapes]
    captions = [f"{r.values['end_points']} ends, {r.values['loops']} loops" for r in results]
    return _sheet(results, captions, len(shapes))


def _solids() -> dict[str, medialis.Shape]:
    """Return shapes of which every sheet, patch and part is known; made as the tests make them."""
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))
    import closed_forms as forms

    return {
        "box": forms.box_mesh((2.0, 1.5, 1.0), 10.0),
        "L": forms.prism(forms.L_OUTLINE, 0.8, 10.0),
        "T": forms.prism(forms.T_OUTLINE, 0.8, 10.0),
        "wedge": forms.prism(forms.TRIANGLE, 0.8, 10.0),
        "flat cylinder": forms.rounded_cylinder(1.0, 1.0, 0.0, 0.03),
        "rounded cylinder": forms.rounded_cylinder(1.0, 1.6, 0.25, 0.03),
        "dumbbell": forms.dumbbell(step=0.04),
        "plate": _dented_plate(),
        "creature": medialis.organic_shape(200),
    }


def _gallery(
    operation: str,
    names: str,
    value: str,
    what: str,
    parameters: dict[str, str] | None = None,
) -> Image:
    """Run an operation on several solids and count what it found."""
    solids = _solids()
    given = parameters or {}
    results = [medialis.run(operation, solids[name], **given) for name in names.split(", ")]
    captions = [
        f"{name}: {r.values[value]} {what}"
        for name, r in zip(names.split(", "), results, strict=True)
    ]
    return _sheet(results, captions, 3)


def point_types() -> Image:
    """Types of medial points, and the creature's skeleton without its rim."""
    solids = _solids()
    results = [
        medialis.run("point_types", solids[name], filter_rim=rim)
        for name, rim in (("box", False), ("L", False), ("creature", False), ("creature", True))
    ]
    shown = []
    for result in results:
        layer = result.layers[0]
        types = np.minimum(layer.attributes["type"], 3).astype(np.int32)
        layer = replace(
            layer, attributes={"type": types}, labels=("type",), filter_by=None, color_by="type"
        )
        shown.append(replace(result, layers=(layer,)))
    captions = [f"{r.values['a3_points']} rim, {r.values['y_points']} Y-curve" for r in results]
    return _sheet(shown, [*captions[:3], "the rim left out"])


def medial_sheets() -> Image:
    """Thesis Figure 6.4: points by sheet."""
    names = "box, L, T, wedge, flat cylinder, creature"
    return _gallery("medial_sheets", names, "sheets", "sheets")


def _layer_of(result: medialis.Result, name: str) -> medialis.Result:
    """Return a result that shows another of its layers."""
    return replace(result, layers=tuple(x for x in result.layers if x.name == name))


def y_network() -> Image:
    """Thesis Figure 6.6: the curves where sheets meet."""
    solids = _solids()
    results = [medialis.run("medial_sheets", solids[name]) for name in ("box", "L", "creature")]
    captions = [
        f"{r.values['y_curves']} curves, length {r.values['y_length']:.2f}" for r in results
    ]
    return _sheet([_layer_of(r, "y_network") for r in results], captions, 3)


def sheet_meshes() -> Image:
    """Thesis Figure 6.7: meshed sheets."""
    solids = _solids()
    results = [medialis.run("medial_sheets", solids[name]) for name in ("box", "T", "creature")]
    captions = [f"area {r.values['area']:.2f}" for r in results]
    return _sheet([_layer_of(r, "sheet_meshes") for r in results], captions, 3)


def soft_edges() -> Image:
    """Thesis Figure 6.8: sharp and blunt edges, by sharpness and by radius."""
    solids = _solids()
    names = ("L", "rounded cylinder", "creature")
    results = [medialis.run("soft_edges", solids[name]) for name in names]
    images = [_picture(r, 3) for r in results]
    images += [_picture(_radius_of_edges(r), 3, color_by="edge_radius") for r in results]
    return contact_sheet(images, [*names, *names], 3)


def _radius_of_edges(result: medialis.Result) -> medialis.Result:
    """Return the result with no radius, drawn grey, off all edges."""
    layer = result.shown[0]
    on_edge = layer.attributes["sharpness"] > 0
    radius = np.where(on_edge, layer.attributes["edge_radius"], np.nan)
    layer = replace(layer, attributes={**layer.attributes, "edge_radius": radius})
    return replace(result, shown=(layer,))


def patches() -> Image:
    """Thesis Figure 6.9: patches between edges."""
    names = "box, L, flat cylinder, rounded cylinder, plate, creature"
    return _gallery("patches", names, "patches", "patches")


def parts() -> Image:
    """Thesis Figure 6.10: parts of shapes, one for each sheet."""
    names = "dumbbell, creature, box, L, flat cylinder, rounded cylinder"
    return _gallery("parts", names, "parts", "parts", {"method": "sheets"})


def parts_as_seen() -> Image:
    """Parts where people would divide a shape."""
    names = ("creature", "hand", "tree", "vase", "gear", "bracket")
    shapes = [medialis.sample_shape(name) for name in names]
    names += ("stool", "hammer", "bolt", "mug", "dumbbell", "jack")
    sys.path[:0] = [str(FOLDER.parents[1] / "benchmarks"), str(FOLDER.parents[1] / "tests")]
    from known_bodies import known_bodies

    from closed_forms import dumbbell
    from tubes import AXES, hub

    made = {name: shape for name, shape, _ in known_bodies(("stool", "hammer", "bolt", "cup"))}
    shapes += [made[name] for name in ("stool_0", "hammer_0", "bolt_0", "cup_3")]
    shapes += [dumbbell(step=0.04), hub(AXES, 0.04, ball=0.6)[0]]
    results = [medialis.run("parts", shape) for shape in shapes]
    captions = [f"{n}: {r.values['parts']} parts" for n, r in zip(names, results, strict=True)]
    return _sheet(results, captions, 4)


def limbs() -> Image:
    """Parts by the curve skeleton, where limbs leave a body."""
    solids = _solids()
    from tubes import AXES, FORK, hub

    solids |= {
        "jack": hub(AXES, 0.04, ball=0.6)[0],
        "fork": hub(FORK, 0.04, ball=0.25)[0],
        "wheel": _wheel(),
    }
    names = ("creature", "jack", "dumbbell", "fork", "T", "wheel")
    results = [medialis.run("parts", solids[name], method="limbs") for name in names]
    captions = [f"{n}: {r.values['parts']} parts" for n, r in zip(names, results, strict=True)]
    return _sheet(results, captions, 3)


def _crossing(outliers: float) -> medialis.Shape:
    """Make a sphere cut by two planes as a cloud, with outliers in the box around it."""
    rng = np.random.default_rng(0)
    ball = rng.normal(size=(9000, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    flat, steep = (rng.uniform(-1.5, 1.5, (7000, 3)) * scale for scale in ((1, 1, 0), (1, 0, 1)))
    noise = rng.uniform(-1.5, 1.5, (int(outliers * 23000), 3))
    points = np.concatenate([ball, flat, steep + np.array([0, 0.3, 0]), noise])
    return medialis.Shape(points, np.zeros_like(points))


def _manifold_surfaces(result: medialis.Result) -> Image:
    layer = result.layers[-1]
    assert layer.faces is not None
    owner = layer.face_attributes["manifold_of_face"]
    surface = Surface(layer.points, layer.faces, labels=owner, per_face=True)
    return draw(
        [surface], Camera.framing(layer.points, width=WIDTH // 2, height=WIDTH // 3), style=CROPPED
    )


def manifolds() -> Image:
    """Draw a cloud of three surfaces and 40 % noise: points, and their surfaces."""
    result = medialis.run("manifolds", _crossing(0.4), surfaces=True)
    images = [_picture(result, 2), _manifold_surfaces(result)]
    count = result.values["manifolds"]
    return contact_sheet(images, [f"{count} manifolds, noise in grey", "their surfaces"], 2)


def skeleton_manifolds() -> Image:
    """Thesis Figure 4.7: the skeleton of a mesh divided into its manifolds."""
    shape = medialis.organic_shape(300)
    result = medialis.run("manifolds", shape, cloud="skeleton", max_bend=15.0, surfaces=True)
    images = [_picture(result, 2), _manifold_surfaces(result)]
    return contact_sheet(images, ["skeleton points", "surfaces of the manifolds"], 2)


def remove_outliers() -> Image:
    """Thesis Figure 4.5: a cloud with 40 % outliers, and what is left of it."""
    shape = medialis.organic_shape(200)
    rng = np.random.default_rng(0)
    base = shape.points[rng.choice(shape.point_count, int(0.4 * shape.point_count))]
    step = rng.normal(size=base.shape)
    step *= (
        0.4
        * shape.diagonal
        * rng.random((len(base), 1))
        / np.linalg.norm(step, axis=1, keepdims=True)
    )
    points = np.concatenate([shape.points, base + step])
    noisy = medialis.Shape(points, np.zeros_like(points))
    kept = medialis.run("remove_outliers", noisy).layers[0].points
    camera = Camera.framing(shape.points, width=WIDTH // 2, height=WIDTH // 3)
    images = [draw([Points(p, size=4.0)], camera, style=CROPPED) for p in (points, kept)]
    return contact_sheet(images, [f"{len(p)} points" for p in (points, kept)], 2)


def mean_shift_segments() -> Image:
    """Thesis Figure 5.5: a generated dental arch by automatic seeds, and by one pick a tooth."""
    shape, teeth = medialis.dental_arch()
    cloud = medialis.surface_skeleton(shape)
    rows = [np.flatnonzero(teeth == t) for t in range(teeth.max() + 1)]
    tips = [int(r[shape.points[r, 2].argmax()]) for r in rows]
    automatic = medialis.mean_shift_segments(cloud, seeds="bumps", last_steps=20, fill=False)
    picked = medialis.mean_shift_segments(
        cloud, search_radius=0.04, seeds="none", add=tips, fill=False
    )
    found = [teeth, automatic.labels, picked.labels]
    camera = Camera.framing(
        shape.points, width=WIDTH // 2, height=WIDTH // 3, direction=(0.2, 0.8, 1.0), up=(0, 0, 1)
    )
    surfaces = [Surface(shape.points, shape.faces, labels=labels) for labels in found]
    images = [draw([surface], camera, style=CROPPED) for surface in surfaces]
    other = medialis.organic_shape(200)
    result = medialis.run("mean_shift_segments", other)
    images.append(_picture(result, 2))
    captions = ["known teeth", "automatic seeds, last 20 steps", "one pick a tooth", "whole paths"]
    return contact_sheet(images, captions, 2)


def test_poses() -> Image:
    """Draw a person that is bent at its main joints, by the weights of `bind`."""
    folder = Path(__file__).resolve().parents[1]
    sys.path += [str(folder / "benchmarks"), str(folder / "tests")]
    import known_figures

    person = known_figures.biped("athlete", "t").shape
    return draw_panels(medialis.run("bind", person, poses=True), "test_poses")


PICTURES: dict[str, Callable[[], Image]] = {
    make.__name__: make
    for make in (
        hero, overview, spoke_angle,
        subsample, tolerance, refine, sides, reconstruction, progressive,
        thickness, wall_angle, wall_check,
        turntable, views, skeleton_mesh, mesh_angles, mesh_bridges, mesh_box,
        medial_mesh, medial_mesh_balls, medial_mesh_sheets,
        midsurface, importance, measures, geodesic, curve_skeleton, curve_candidates, curve_parts,
        curve_options, curve_comparison, centerline, tree_cylinders, convex_pieces,
        robot_balls, view_curve_skeleton,
        point_types, medial_sheets, y_network, sheet_meshes, soft_edges, patches, limbs, parts,
        parts_as_seen, manifolds, skeleton_manifolds, remove_outliers, mean_shift_segments,
        test_poses,
    )
}  # fmt: skip


def main(names: list[str]) -> None:
    """Make the named pictures, or all."""
    FOLDER.mkdir(exist_ok=True)
    for name in names or PICTURES:
        path = FOLDER / f"{name}.png"
        write_png(path, PICTURES[name]())
        print(path)


if __name__ == "__main__":
    main(sys.argv[1:])
