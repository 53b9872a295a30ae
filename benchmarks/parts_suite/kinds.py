"""Kinds of parts: each makes a solid with fillets of some radius, and says what is known of it.

Outlines that are extruded along z, or revolved about z, and boxes with fillets. Where a fillet has
no room it is smaller. Sheets go straight on through a weld where the wall on the other side has the
same thickness; welds of two sheets that cross are one curve.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any

import cadquery as cq
import numpy as np

from parts_suite.profiles import Corner, band, bent, outline
from parts_suite.truth import Part, Wall, cylinder, polygon, polygon_area, rib, sphere

Kind = Callable[[float], Part]
KINDS: dict[str, tuple[float, Kind]] = {}
"""The thinnest wall of each kind, and what makes it with fillets of a radius in millimetres."""


def kind(thinnest: float) -> Callable[[Callable[[float], Part]], Kind]:
    """Enter a kind into the table under the name of its function."""

    def enter(make: Kind) -> Kind:
        KINDS[make.__name__] = thinnest, make
        return make

    return enter


def made(name: str, ratio: float) -> Part:
    """Make a part of a kind with a fillet of so many thicknesses of its thinnest wall."""
    thinnest, make = KINDS[name]
    part = make(ratio * thinnest)
    part.radius_walls = ratio
    assert part.solid.isValid()
    return part


def flat(
    thickness: float,
    corners: Sequence[tuple[float, float, float]],
    clear: float,
    ending: float | None = None,
    taken: float = 0.0,
) -> Wall:
    """Return a flat wall; surely one from `clear` off its border, but for `taken` of its area."""
    patch = polygon(*corners)
    area = polygon_area(patch)
    p = np.array(patch["corners"])
    around = float(np.linalg.norm(p - np.roll(p, -1, axis=0), axis=1).sum())
    least = max(area - around * clear + 4 * clear**2 - taken, 0.0)
    return Wall(thickness, [patch], area, least, clear, ending)


def upright(
    p: Sequence[float], q: Sequence[float], length: float
) -> list[tuple[float, float, float]]:
    """Return the corners of a line of an outline, extruded along z."""
    return [(p[0], p[1], 0), (q[0], q[1], 0), (q[0], q[1], length), (p[0], p[1], length)]


def line(*points: Sequence[float]) -> list[list[list[float]]]:
    """Return the segments of a line through points."""
    p = [list(map(float, point)) for point in points]
    return [[a, b] for a, b in itertools.pairwise(p)]


def circle(center: Sequence[float], radius: float, count: int = 96) -> list[list[list[float]]]:
    """Return the segments of a circle about z."""
    angle = 2 * math.pi * np.arange(count + 1) / count
    x, y, z = center
    return line(*[(x + radius * math.cos(a), y + radius * math.sin(a), z) for a in angle])


def extruded(corners: Sequence[Corner], length: float) -> Any:
    """Return the solid of an outline, extruded along z."""
    return outline(corners).extrude(length).val()


def box(low: Sequence[float], high: Sequence[float]) -> Any:
    """Return a box between two corners."""
    size = [h - a for a, h in zip(low, high, strict=True)]
    return cq.Workplane().box(*size, centered=False).translate(tuple(low))


def feet(work: Any, height: float, radius: float, within: tuple[float, ...]) -> Any:
    """Round the edges at a height that lie within a rectangle (x0, y0, x1, y1)."""
    if radius == 0:
        return work
    low, high = (*within[:2], height - 1e-3), (*within[2:], height + 1e-3)
    edges = work.edges(cq.selectors.BoxSelector(low, high))
    return edges.fillet(radius)


@kind(2.0)
def tee(r: float) -> Part:
    """Make a wall of 2 on one of 3."""
    length = 50.0
    corners: list[Corner] = [(-30, 0), (30, 0), (30, 3), (1, 3, r), (1, 40), (-1, 40), (-1, 3, r),
                             (-30, 3)]  # fmt: skip
    weld = line((0, 1.5, 0), (0, 1.5, length))
    taken = (2 * r + 2 + 2 * 3) * length
    walls = [
        flat(3, upright((-30, 1.5), (30, 1.5), length), 3, taken=taken),
        flat(2, upright((0, 1.5), (0, 40), length), 2, taken=(r + 1.5) * length),
    ]
    return Part("tee", 0, r, extruded(corners, length), 2, [length], walls, [rib(2, 3)], weld)


@kind(2.0)
def ell(r: float) -> Part:
    """Make two walls of 2 at a right angle, rounded inside only."""
    length, taken = 60.0, (r + 2) * 60.0
    corners: list[Corner] = [(0, 0), (50, 0), (50, 2), (2, 2, r), (2, 40), (0, 40)]
    walls = [
        flat(2, upright((1, 1), (50, 1), length), 2, taken=taken),
        flat(2, upright((1, 1), (1, 40), length), 2, taken=taken),
    ]
    weld = line((1, 1, 0), (1, 1, length))
    return Part("ell", 0, r, extruded(corners, length), 2, [length], walls, [], weld)


@kind(2.0)
def channel(r: float) -> Part:
    """Make a base of 2.5 with two flanges of 2, rounded inside."""
    length = 70.0
    corners: list[Corner] = [(0, 0), (50, 0), (50, 30), (48, 30), (48, 2.5, r), (2, 2.5, r),
                             (2, 30), (0, 30)]  # fmt: skip
    walls = [flat(2.5, upright((1, 1.25), (49, 1.25), length), 2.5, taken=2 * (r + 2) * length)]
    weld = []
    for x in (1, 49):
        walls.append(flat(2, upright((x, 1.25), (x, 30), length), 2, taken=(r + 2.5) * length))
        weld += line((x, 1.25, 0), (x, 1.25, length))
    return Part("channel", 0, r, extruded(corners, length), 3, [length] * 2, walls, [], weld)


@kind(2.0)
def i_beam(r: float) -> Part:
    """Make a web of 2 between flanges of 3 and 2.5."""
    length = 60.0
    corners: list[Corner] = [
        (-25, 0), (25, 0), (25, 3), (1, 3, r), (1, 47.5, r), (25, 47.5), (25, 50), (-25, 50),
        (-25, 47.5), (-1, 47.5, r), (-1, 3, r), (-25, 3),
    ]  # fmt: skip
    walls, weld = [], []
    for y, t in ((1.5, 3.0), (48.75, 2.5)):
        taken = (2 * r + 2 + 2 * t) * length
        walls.append(flat(t, upright((-25, y), (25, y), length), t, taken=taken))
        weld += line((0, y, 0), (0, y, length))
    walls.append(flat(2, upright((0, 1.5), (0, 48.75), length), 2, taken=(2 * r + 3) * length))
    return Part("i_beam", 0, r, extruded(corners, length), 3, [length] * 2, walls,
                [rib(2, 2.5)], weld)  # fmt: skip


@kind(1.5)
def sheet_metal(r: float) -> Part:
    """Make a hat of sheet metal of 1.5 with four bends."""
    length, t = 45.0, 1.5
    path = [(0, 0), (20, 0), (20, 25), (55, 25), (55, 0), (75, 0)]
    solid = extruded(band(path, t, r), length)
    patches, area, least = [], 0.0, 0.0
    for shape, about in bent(path, r + t / 2 if r else 0.0):
        if shape == "line":
            p, q = about
            patches.append(polygon(*upright(p, q, length)))
            long = math.dist(p, q)
            area += long * length
            least += (long - 2 * t) * (length - 2 * t)
        else:
            patch, arc = _arc(about, length)
            patches.append(patch)
            area += arc * length
    walls = [Wall(t, patches, area, least, t)]
    welds = [] if r else [length] * 4
    weld = [] if r else [s for x, y in path[1:-1] for s in line((x, y, 0), (x, y, length))]
    return Part("sheet_metal", 0, r, solid, 1 if r else 5, welds, walls, [], weld)


def _arc(about: tuple[Any, ...], length: float) -> tuple[dict[str, Any], float]:
    """Return the patch of an arc, extruded along z, and its length."""
    center, radius, first, last = about
    a, b = first - center, last - center
    if a[0] * b[1] - a[1] * b[0] < 0:
        a, b = b, a
    turn = math.acos(float(np.clip(a @ b / (radius * radius), -1, 1)))
    across = (*(a / radius).tolist(), 0.0)
    patch = cylinder((*center.tolist(), 0.0), (0, 0, 1), radius, length, across, math.degrees(turn))
    return patch, turn * radius


@kind(2.0)
def hollow_section(r: float) -> Part:
    """Make a rectangular hollow section 60 x 40 x 2 with an inner radius."""
    length, t, a, b = 80.0, 2.0, 60.0, 40.0
    out = [(0, 0), (a, 0), (a, b), (0, b)]
    inn = [(t, t), (a - t, t), (a - t, b - t), (t, b - t)]
    outer = outline([(*p, r + t if r else 0) for p in out]).extrude(length)
    solid = outer.cut(outline([(*p, r) for p in inn]).extrude(length)).val()
    h, bend = t / 2, r + t / 2 if r else 0.0
    middle = [np.array(p, float) for p in ((h, h), (a - h, h), (a - h, b - h), (h, b - h))]
    patches, area, least = [], 0.0, 0.0
    for k in range(4):
        p, q = middle[k], middle[(k + 1) % 4]
        along = (q - p) / np.linalg.norm(q - p)
        p, q = p + bend * along, q - bend * along
        patches.append(polygon(*upright(p, q, length)))
        area += math.dist(p, q) * length
        least += (math.dist(p, q) - 2 * t) * (length - 2 * t)
        if r:
            inward = np.array([-along[1], along[0]])
            patch, arc = _arc((q + bend * inward, bend, q, q + bend * (inward + along)), length)
            patches.append(patch)
            area += arc * length
    walls = [Wall(t, patches, area, least, t)]
    if r:
        return Part("hollow_section", 0, r, solid, 1, [], walls)
    weld = [s for x, y in middle for s in line((x, y, 0), (x, y, length))]
    return Part("hollow_section", 0, r, solid, 4, [length] * 4, walls, [], weld)


@kind(1.5)
def ribs(r: float) -> Part:
    """Make three ribs of 1.5 with ends of their own on a plate of 3."""
    plate = box((0, 0, 0), (80, 50, 3))
    places = (15.0, 40.0, 65.0)
    for x in places:
        plate = plate.union(box((x - 0.75, 8, 3), (x + 0.75, 42, 15)))
    plate = feet(plate, 3, r, (5, 5, 75, 45))
    walls, weld = [_plate(3, 80, 50, 1.5, 3 * (34 + 2 * r) * (1.5 + 2 * r + 6))], []
    for x in places:
        corners = [(x, 8, 1.5), (x, 42, 1.5), (x, 42, 15), (x, 8, 15)]
        walls.append(flat(1.5, corners, 1.5, taken=(r + 1.5) * 34 + 2 * r * r))
        weld += line((x, 8, 1.5), (x, 42, 1.5))
    known = [rib(1.5, 3)] * 3
    return Part("ribs", 0, r, plate.val(), 4, [34.0] * 3, walls, known, weld)


def _plate(t: float, a: float, b: float, z: float, taken: float) -> Wall:
    corners = [(0.0, 0.0, z), (a, 0.0, z), (a, b, z), (0.0, b, z)]
    return flat(t, corners, t, taken=taken)


@kind(1.5)
def rib_grid(r: float) -> Part:
    """Make two ribs of 1.5 and 2 that cross on a plate of 3."""
    plate = box((0, 0, 0), (70, 60, 3))
    plate = plate.union(box((8, 29, 3), (62, 31, 15))).union(box((34.25, 8, 3), (35.75, 52, 15)))
    if r:
        plate = _grid_feet(plate, r)
    weld = line((8, 30, 1.5), (62, 30, 1.5)) + line((35, 8, 1.5), (35, 52, 1.5))
    weld += line((35, 30, 1.5), (35, 30, 15))
    walls = [
        _plate(3, 70, 60, 1.5, (54 + 44) * (2 + 2 * r + 6)),
        flat(2, [(8, 30, 1.5), (62, 30, 1.5), (62, 30, 15), (8, 30, 15)], 2,
             taken=(r + 1.5) * 54 + 13.5 * (2 * r + 1.5 + 4)),
        flat(1.5, [(35, 8, 1.5), (35, 52, 1.5), (35, 52, 15), (35, 8, 15)], 1.5,
             taken=(r + 1.5) * 44 + 13.5 * (2 * r + 2 + 3)),
    ]  # fmt: skip
    known = [rib(1.5, 3), rib(2, 3)]
    return Part("rib_grid", 0, r, plate.val(), 3, [54.0, 44.0, 13.5], walls, known, weld)


def _grid_feet(plate: Any, r: float) -> Any:
    """Round the feet and the four edges where the ribs cross."""
    low, high = (5, 5, 2.999), (65, 55, 3.001)
    feet_ = cq.selectors.BoxSelector(low, high)
    upright_ = cq.selectors.BoxSelector((34, 28.9, 3.001), (36, 31.1, 14.9))
    return plate.edges(cq.selectors.SumSelector(feet_, upright_)).fillet(r)


@kind(1.5)
def bosses(r: float) -> Part:
    """Make two bosses with walls of 1.5 and blind bores on a plate of 3."""
    plate = box((0, 0, 0), (70, 40, 3))
    walls, weld = [_plate(3, 70, 40, 1.5, 2 * math.pi * (5 + r + 3) ** 2)], []
    for x in (20.0, 50.0):
        outside = cq.Workplane().circle(5).extrude(15).translate((x, 20, 3))
        inside = cq.Workplane().circle(3.5).extrude(15).translate((x, 20, 3))
        plate = plate.union(outside.cut(inside))
        around = 2 * math.pi * 4.25
        patch = cylinder((x, 20, 1.5), (0, 0, 1), 4.25, 16.5, (1, 0, 0))
        walls.append(Wall(1.5, [patch], around * 16.5, around * (16.5 - 1.5 - r - 3), 1.5))
        weld += circle((x, 20, 1.5), 4.25)
    if r:
        for x in (20.0, 50.0):
            reach = 5.2
            selector = cq.selectors.BoxSelector((x - reach, 20 - reach, 2.99),
                                                (x + reach, 20 + reach, 3.01))  # fmt: skip
            circles = [e for e in plate.edges(selector).vals() if e.radius() > 4]
            plate = plate.newObject(circles).fillet(r)
    known = [rib(1.5, 3, "boss")] * 2
    return Part("bosses", 0, r, plate.val(), 3, [2 * math.pi * 4.25] * 2, walls, known, weld)


@kind(1.2)
def enclosure(r: float) -> Part:
    """Make a box with walls of 2, a floor of 2.5 and 3 ribs of 1.2; rounded inside, at ribs."""
    a, b, c, t, f = 100.0, 70.0, 30.0, 2.0, 2.5
    room = box((t, t, f), (a - t, b - t, c + 1))
    if r:
        room = room.edges("|Z").fillet(r).faces("<Z").edges().fillet(r)
    solid = box((0, 0, 0), (a, b, c)).cut(room)
    places = (25.0, 50.0, 75.0)
    for x in places:
        solid = solid.union(box((x - 0.6, 12, f), (x + 0.6, 58, f + 9)))
    solid = feet(solid, f, r, (15, 10, 85, 60))
    h, g = t / 2, f / 2
    floor = flat(f, [(h, h, g), (a - h, h, g), (a - h, b - h, g), (h, b - h, g)], f + r,
                 taken=3 * (46 + 2 * r) * (1.2 + 2 * r + 2 * f))  # fmt: skip
    sides = [
        [(h, h), (a - h, h)], [(a - h, h), (a - h, b - h)], [(a - h, b - h), (h, b - h)],
        [(h, b - h), (h, h)],
    ]  # fmt: skip
    walls, weld, lengths = [floor], [], []
    for p, q in sides:
        walls.append(flat(t, [(*p, g), (*q, g), (*q, c), (*p, c)], t + r))
        weld += line((*p, g), (*q, g)) + line((*p, g), (*p, c))
        lengths += [math.dist(p, q), c - g]
    for x in places:
        corners = [(x, 12, g), (x, 58, g), (x, 58, f + 9), (x, 12, f + 9)]
        walls.append(flat(1.2, corners, 1.2, taken=(r + g) * 46 + 2 * r * r))
        weld += line((x, 12, g), (x, 58, g))
        lengths.append(46.0)
    return Part("enclosure", 0, r, solid.val(), 8, lengths, walls, [rib(1.2, f)] * 3, weld)


@kind(2.0)
def tray(r: float) -> Part:
    """Make a tray of 2 all round: bends with an inner radius, spheres in its corners."""
    a, b, c, t = 70.0, 50.0, 20.0, 2.0
    outer, inner = box((0, 0, 0), (a, b, c)), box((t, t, t), (a - t, b - t, c + 30))
    h = t / 2
    if r:
        outer = outer.edges("|Z or <Z").fillet(r + t)
        inner = inner.edges("|Z or <Z").fillet(r)
        m = r + h
        patches, area = _tray_patches(a, b, c, h, m)
        least = (a - 2 * m - 2 * h - 2 * t) * (b - 2 * m - 2 * h - 2 * t)
        for long in (a, b):
            least += 2 * (long - 2 * m - 2 * h - 2 * t) * (c - m - h - 2 * t)
        walls = [Wall(t, patches, area, least, t)]
        return Part("tray", 0, r, outer.cut(inner).val(), 1, [], walls)
    solid = outer.cut(inner)
    corners = [(h, h, h), (a - h, h, h), (a - h, b - h, h), (h, b - h, h)]
    walls, weld, lengths = [flat(t, corners, t)], [], []
    for k in range(4):
        p, q = corners[k], corners[(k + 1) % 4]
        walls.append(flat(t, [p, q, (*q[:2], c), (*p[:2], c)], t))
        weld += line(p, q) + line(p, (*p[:2], c))
        lengths += [math.dist(p, q), c - h]
    return Part("tray", 0, r, solid.val(), 5, lengths, walls, [], weld)


def _tray_patches(
    a: float, b: float, c: float, h: float, m: float
) -> tuple[list[dict[str, Any]], float]:
    """Return the middle of a rounded tray, whose bends have the radius m, and its area."""
    low, far, wide, top = h + m, a - h - m, b - h - m, c - h - m
    patches = [polygon((low, low, h), (far, low, h), (far, wide, h), (low, wide, h))]
    patches += [polygon((low, y, low), (far, y, low), (far, y, c), (low, y, c)) for y in (h, b - h)]
    patches += [
        polygon((x, low, low), (x, wide, low), (x, wide, c), (x, low, c)) for x in (h, a - h)
    ]
    area = sum(polygon_area(patch) for patch in patches)
    for x, y, across in ((low, low, (-1, 0, 0)), (far, low, (0, -1, 0)), (far, wide, (1, 0, 0)),
                         (low, wide, (0, 1, 0))):  # fmt: skip
        patches.append(cylinder((x, y, low), (0, 0, 1), m, top, across, 90))
        sides = [(-1.0 if x == low else 1.0, 0, 0), (0, -1.0 if y == low else 1.0, 0), (0, 0, -1.0)]
        patches.append(sphere((x, y, low), m, sides))
        area += math.pi / 2 * m * top + math.pi / 2 * m * m
    for start, axis, long, across in (
        ((low, low, low), (1, 0, 0), far - low, (0, -1, 0)),
        ((low, wide, low), (1, 0, 0), far - low, (0, 0, -1)),
        ((low, low, low), (0, 1, 0), wide - low, (0, 0, -1)),
        ((far, low, low), (0, 1, 0), wide - low, (1, 0, 0)),
    ):
        patches.append(cylinder(start, axis, m, long, across, 90))
        area += math.pi / 2 * m * long
    return patches, area


@kind(1.5)
def snap_fit(r: float) -> Part:
    """Make an arm of 1.5 with a hook on a base of 2.5."""
    length = 14.0
    corners: list[Corner] = [
        (0, 0), (40, 0), (40, 2.5), (20.75, 2.5, r), (20.75, 24), (22.75, 24), (20.75, 29),
        (19.25, 29), (19.25, 2.5, r), (0, 2.5),
    ]  # fmt: skip
    taken = (2 * r + 1.5 + 5) * length
    walls = [
        flat(2.5, upright((0, 1.25), (40, 1.25), length), 2.5, taken=taken),
        flat(1.5, upright((20, 1.25), (20, 29), length), 1.5, taken=(r + 1.25 + 7) * length),
    ]
    weld = line((20, 1.25, 0), (20, 1.25, length))
    # What the hook does to the middle of the arm is no matter of the wall.
    weld += line((20, 23, 7), (20, 29, 7)) + line((20, 24, 0), (20, 24, length))
    weld += line((20, 26.5, 0), (20, 26.5, length)) + line((20, 29, 0), (20, 29, length))
    return Part("snap_fit", 0, r, extruded(corners, length), 2, [length], walls,
                [rib(1.5, 2.5)], weld)  # fmt: skip


@kind(2.0)
def tube(r: float) -> Part:
    """Make a tube of 2 whose rims are rounded, at most by 0.45 of the wall."""
    t, radius, height = 2.0, 20.0, 50.0
    e = min(r, 0.45 * t)
    corners = [(radius - 1, 0, e), (radius + 1, 0, e), (radius + 1, height, e),
               (radius - 1, height, e)]  # fmt: skip
    solid = outline(corners, "XZ").revolve(360, (0, 0, 0), (0, 1, 0)).val()
    around = 2 * math.pi * radius
    patch = cylinder((0, 0, 0), (0, 0, 1), radius, height, (1, 0, 0))
    walls = [Wall(t, [patch], around * height, around * (height - 2 * (t + e)), t)]
    return Part("tube", 0, r, solid, 1, [], walls)


@kind(2.0)
def bracket(r: float) -> Part:
    """Make two walls of 3 at a right angle and a gusset of 2 between them."""
    a, b, c, t, g = 60.0, 50.0, 50.0, 3.0, 2.0
    solid = box((0, 0, 0), (a, b, t)).union(box((0, 0, 0), (t, b, c)))
    side = cq.Workplane("XZ").polyline([(t - 1, t - 1), (45, t - 1), (45, t), (t, 40), (t - 1, 40)])
    solid = solid.union(side.close().extrude(-g).translate((0, b / 2 - g / 2, 0)))
    if r:
        foot = cq.selectors.BoxSelector((t - 1e-3, 1, t - 1e-3), (50, b - 1, t + 1e-3))
        back = cq.selectors.BoxSelector((t - 1e-3, 1, t - 1e-3), (t + 1e-3, b - 1, 45))
        solid = solid.edges(cq.selectors.SumSelector(foot, back)).fillet(r)
    y, h = b / 2, t / 2
    taken = (r + 3) * b + 45 * (2 * r + g + 2 * t)
    walls = [
        flat(t, [(h, 0, h), (a, 0, h), (a, b, h), (h, b, h)], t, taken=taken),
        flat(t, [(h, 0, h), (h, b, h), (h, b, c), (h, 0, c)], t, taken=taken),
        flat(g, [(h, y, h), (46.73, y, h), (45, y, t), (t, y, 40), (h, y, 41.32)], g,
             taken=(r + h) * 90),
    ]  # fmt: skip
    weld = line((h, 0, h), (h, b, h)) + line((h, y, h), (45, y, h)) + line((h, y, h), (h, y, 40))
    lengths = [b, 45.0 - h, 40.0 - h]
    return Part("bracket", 0, r, solid.val(), 3, lengths, walls, [rib(g, t)], weld)


@kind(1.5)
def heat_sink(r: float) -> Part:
    """Make six fins of 1.5 on a base of 4."""
    length, count, pitch = 50.0, 6, 12.0
    corners: list[Corner] = [(0, 0), (72, 0), (72, 4)]
    for k in reversed(range(count)):
        x = pitch * k + 6
        corners += [(x + 0.75, 4, r), (x + 0.75, 30), (x - 0.75, 30), (x - 0.75, 4, r)]
    corners.append((0, 4))
    walls = [flat(4, upright((0, 2), (72, 2), length), 4,
                  taken=count * (2 * r + 1.5 + 8) * length)]  # fmt: skip
    weld = []
    for k in range(count):
        x = pitch * k + 6
        walls.append(flat(1.5, upright((x, 2), (x, 30), length), 1.5, taken=(r + 2) * length))
        weld += line((x, 2, 0), (x, 2, length))
    known = [rib(1.5, 4)] * count
    return Part("heat_sink", 0, r, extruded(corners, length), 7, [length] * count, walls, known,
                weld)  # fmt: skip


@kind(2.0)
def flanged_pipe(r: float) -> Part:
    """Make a pipe of 2 with a flange of 3 at its end, rounded outside of their corner."""
    inner, outer, rim, t, height = 14.0, 16.0, 35.0, 3.0, 50.0
    corners: list[Corner] = [(inner, 0), (rim, 0), (rim, t), (outer, t, r), (outer, height),
                             (inner, height)]  # fmt: skip
    solid = outline(corners, "XZ").revolve(360, (0, 0, 0), (0, 1, 0)).val()
    middle, around = (inner + outer) / 2, math.pi * (inner + outer)
    wide = math.pi * (rim**2 - middle**2)
    clear = math.pi * ((rim - t) ** 2 - (outer + r + t) ** 2)
    pipe = cylinder((0, 0, t / 2), (0, 0, 1), middle, height - t / 2, (1, 0, 0))
    walls = [
        Wall(3, [_ring((0, 0, t / 2), middle, rim)], wide, clear, 3),
        Wall(2, [pipe], around * (height - t / 2), around * (height - t - r - 4), 2),
    ]
    weld = circle((0, 0, t / 2), middle)
    return Part("flanged_pipe", 0, r, solid, 2, [around], walls, [], weld)


def _ring(center: tuple[float, float, float], inner: float, outer: float) -> dict[str, Any]:
    """Return a flat ring about z."""
    return {"type": "ring", "center": list(center), "radii": [inner, outer]}


@kind(0.95)
def rounded_plate(r: float) -> Part:
    """Make a plate of 0.95 with its upper rim rounded, by 0.9 of the wall at most; for 2, both."""
    t, a, b = 0.95, 80.0, 60.0
    solid = box((0, 0, 0), (a, b, t))
    if r > 1.5 * t:
        solid = solid.edges("|X or |Y").fillet(0.45 * t)
    elif r:
        solid = solid.faces(">Z").edges().fillet(min(r, 0.9 * t))
    walls = [_plate(t, a, b, t / 2, 0.0)]
    return Part("rounded_plate", 0, r, solid.val(), 1, [], walls)


@kind(2.0)
def step(r: float) -> Part:
    """Make a plate that steps from 2 to 3.5, rounded at most by 1.4 there."""
    length, e = 50.0, min(r, 1.4)
    corners: list[Corner] = [(0, 0), (70, 0), (70, 2), (35, 2, e), (35, 3.5), (0, 3.5)]
    walls = [
        flat(3.5, upright((0, 1.75), (35, 1.75), length), 3.5),
        flat(2, upright((35, 1), (70, 1), length), 2, taken=e * length),
    ]
    weld = line((35, 1.375, 0), (35, 1.375, length)) + line((37, 1.2, 0), (37, 1.2, length))
    weld += line((33, 1.2, 0), (33, 1.2, length))
    return Part("step", 0, r, extruded(corners, length), 2, [length], walls, [], weld)


@kind(1.6)
def draft_rib(r: float) -> Part:
    """Make a rib that narrows from 2.4 to 1.6 over 24 on a plate of 3."""
    length = 50.0
    corners: list[Corner] = [(0, 0), (50, 0), (50, 3), (26.2, 3, r), (25.8, 27), (24.2, 27),
                             (23.8, 3, r), (0, 3)]  # fmt: skip
    walls = [
        flat(3, upright((0, 1.5), (50, 1.5), length), 3, taken=(2 * r + 2.4 + 6) * length),
        flat(2.45, upright((25, 1.5), (25, 27), length), 2, 1.6, taken=(r + 2) * length),
    ]
    weld = line((25, 1.5, 0), (25, 1.5, length))
    return Part("draft_rib", 0, r, extruded(corners, length), 2, [length], walls,
                [rib(2.4, 3)], weld)  # fmt: skip


@kind(2.0)
def pipe_tee(r: float) -> Part:
    """Make a pipe of 2 with a branch of 2 on its side, rounded outside."""
    big, small, half, t = 20.0, 10.0, 45.0, 2.0

    def bar(radius: float, long: float) -> Any:
        return cq.Workplane("YZ").circle(radius).extrude(2 * long).translate((-long, 0, 0))

    def branch(radius: float, high: float) -> Any:
        return cq.Workplane().circle(radius).extrude(high)

    solid = bar(big + 1, half).union(branch(small + 1, 50))
    if r:
        solid = solid.edges(cq.selectors.BoxSelector((-12, -12, 16), (12, 12, 22))).fillet(r)
    solid = solid.cut(bar(big - 1, half + 1)).cut(branch(small - 1, 51))
    angle = 2 * math.pi * np.arange(241) / 240
    curve = [(small * math.cos(a), small * math.sin(a),
              math.sqrt(big**2 - (small * math.sin(a)) ** 2)) for a in angle]  # fmt: skip
    weld = line(*curve)
    around = sum(math.dist(p, q) for p, q in weld)
    low = math.sqrt(big**2 - small**2)
    pipes = 2 * math.pi * big * 2 * half - math.pi * small**2
    walls = [
        Wall(t, [cylinder((-half, 0, 0), (1, 0, 0), big, 2 * half, (0, 0, 1))], pipes,
             pipes - 4 * math.pi * big * t - 2 * around * (r + 2 * t), t),
        Wall(t, [cylinder((0, 0, low), (0, 0, 1), small, 50 - low, (1, 0, 0))],
             2 * math.pi * small * (50 - 19), 2 * math.pi * small * (50 - 20 - 3 - r - 4), t),
    ]  # fmt: skip
    return Part("pipe_tee", 0, r, solid.val(), 2, [around], walls, [], weld)
