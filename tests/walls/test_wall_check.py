"""Wall check on generated families: what is thin, thick, an edge, a rib or a gap is known."""

import itertools
import math

import numpy as np
import pytest

import medialis
import plates
from closed_forms import disc_outline, prism, revolved
from medialis.cli.commands import main
from medialis.show.reports.measures import measure
from medialis.show.reports.report import report_page
from medialis.walls.rules import MATERIALS

QUIET = {"refine": 0.012}


def blocks(*boxes):
    """The union of boxes (x0, x1, y0, y1, z0, z1) as one closed mesh."""
    planes = [sorted({box[2 * d + end] for box in boxes for end in (0, 1)}) for d in range(3)]
    filled = np.zeros([len(p) + 1 for p in planes], bool)
    for box in boxes:
        low, high = (
            [p.index(box[2 * d + end]) + 1 for d, p in enumerate(planes)] for end in (0, 1)
        )
        filled[tuple(slice(a, b) for a, b in zip(low, high, strict=True))] = True
    numbers, faces = {}, []
    for cell, axis, side in itertools.product(np.argwhere(filled), range(3), (0, 1)):
        beyond = cell.copy()
        beyond[axis] += 2 * side - 1
        if filled[tuple(beyond)]:
            continue
        corners = []
        for u, v in ((0, 0), (1, 0), (1, 1), (0, 1)):
            key = cell - 1
            key[axis] += side
            key[(axis + 1) % 3] += u
            key[(axis + 2) % 3] += v
            corners.append(numbers.setdefault(tuple(key), len(numbers)))
        a, b, c, d = corners if side else corners[::-1]
        faces += [(a, b, c), (a, c, d)]
    points = [[p[i] for p, i in zip(planes, key, strict=True)] for key in numbers]
    return medialis.make_shape(np.array(points, float), np.array(faces), unit="mm")


def both(*shapes):
    """Several closed meshes in one."""
    starts = np.cumsum([0, *(shape.point_count for shape in shapes)])
    faces = [shape.faces + start for shape, start in zip(shapes, starts, strict=False)]
    points = np.concatenate([shape.points for shape in shapes])
    return medialis.make_shape(points, np.concatenate(faces), unit="mm")


def rigid(shape, factor, at):
    """The shape turned, scaled and moved."""
    turn = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    return medialis.make_shape(factor * shape.points @ turn.T + at, shape.faces, unit="mm")


def check(shape, **options):
    return medialis.run("wall_check", shape, **{**QUIET, **options}).values


def kinds(values):
    return [region["kind"] for region in values["regions"]]


RIBBED = (0, 60, 0, 40, 0, 2), (0, 60, 19, 20.2, 2, 12)


@pytest.mark.slow
@pytest.mark.parametrize("refine", [0.006, 0.012, 0.02])
@pytest.mark.parametrize(("factor", "at"), [(1.0, 0.0), (1e-3, 0.0), (250.0, [1e7, -4e6, 9e5])])
def test_a_rib_is_told_from_its_plate_at_any_scale_place_and_resolution(refine, factor, at):
    """2 mm plate, 1.2 mm rib: one region, ratio 0.6; 0.02 has 1.6 samples across the rib."""
    shape = rigid(blocks(*RIBBED), factor, at)
    low, high = 1.5 * factor, 2.5 * factor
    values = check(shape, minimum=f"{low}mm", maximum=f"{high}mm", refine=refine)
    assert kinds(values) == ["too thin"] and not values["passed"]
    (region,) = values["regions"]
    rounding = 1e-9 * (np.abs(shape.points).max() / shape.diagonal + 1)
    assert region["value"] == pytest.approx(1.2 * factor, rel=1e-6 + rounding)
    # One side of 60 x 10; samples at the foot belong to both walls: a row of faces along it.
    exact, spacing = 600 * factor**2, values["spacing"]
    assert abs(region["area"] - exact) < spacing * 60 * factor
    # Both ends lie opposite to each other, in the middle of the wall: from all of its borders.
    ends = np.array([region["position"], region["opposite"]])
    assert np.linalg.norm(ends[0] - ends[1]) == pytest.approx(region["value"], rel=1e-9 + rounding)
    moved = np.column_stack([(shape.points - at) / factor, np.ones(shape.point_count)])
    back = np.linalg.lstsq(moved, blocks(*RIBBED).points, rcond=None)[0]
    x, y, z = np.append((ends.mean(axis=0) - at) / factor, 1.0) @ back
    assert y == pytest.approx(19.6, abs=1e-3 + 60 * rounding)
    assert min(x, 60 - x, z - 2, 12 - z) > 4
    (rib,) = values["ribs"]
    assert rib["kind"] == "rib"
    assert rib["ratio"] == pytest.approx(0.6, rel=1e-6 + rounding)
    assert rib["thickness"] == pytest.approx(1.2 * factor, rel=1e-6 + rounding)
    assert rib["length"] == pytest.approx(60 * factor, abs=4 * spacing)
    place = np.array(rib["position"])
    foot = rigid(blocks(*RIBBED), factor, at).points
    assert np.linalg.norm(foot - place, axis=1).min() < 40 * factor


@pytest.mark.slow
def test_limits_on_both_sides_and_the_place_of_what_is_too_thick():
    lump = blocks((0, 60, 0, 40, 0, 2), (20, 40, 10, 30, 2, 9))
    values = check(lump, minimum="1mm", maximum="3mm")
    assert kinds(values) == ["too thick"]
    (region,) = values["regions"]
    assert region["value"] == pytest.approx(9.0, rel=1e-6)  # from its top through the plate
    assert np.all(np.abs(np.array(region["position"])[:2] - [30, 20]) <= 10.01)
    assert region["most"] == region["value"] and region["least"] > 3.0
    assert check(lump, minimum="1mm", maximum="10mm")["passed"]
    assert kinds(check(lump, minimum="2.1mm")) == ["too thin"]
    assert check(lump, minimum="1.999mm")["passed"]


@pytest.mark.slow
@pytest.mark.parametrize("degrees", [8.0, 15.0, 30.0, 45.0, 60.0])
def test_the_edge_of_a_wedge_is_no_thin_wall(degrees):
    height = 20 * math.tan(math.radians(degrees / 2))
    wedge = prism([(0, 0), (20, -height), (20, height)], 30, longest_edge=2.0)
    values = check(wedge, minimum=0.6 * height / wedge.diagonal)
    assert values["passed"] and kinds(values) == []


def test_a_wall_with_draft_is_thin_though_it_tapers():
    """One degree a side, 1.2 at the foot, 0.5 at the tip: below 1 in its upper part."""
    lean = 20 * math.tan(math.radians(1))
    wall = prism([(-0.6, 0), (0.6, 0), (0.6 - lean, 20), (lean - 0.6, 20)], 40, longest_edge=1.0)
    values = check(wall, minimum=1.0 / wall.diagonal)
    assert kinds(values) == ["too thin"]
    assert values["regions"][0]["value"] == pytest.approx(1.2 - 2 * lean, rel=0.01)
    assert values["checked_thickness_min"] >= values["regions"][0]["value"]


@pytest.mark.slow
def test_a_sharp_rim_of_an_even_wall_counts_for_none():
    """A blade: 3 thick, ground to an edge of 40 degrees. Below 2 there is only the edge."""
    long = 1.5 / math.tan(math.radians(20))
    blade = prism([(0, 0), (long, -1.5), (30, -1.5), (30, 1.5), (long, 1.5)], 30, longest_edge=1.0)
    result = medialis.run("wall_check", blade, minimum=2.0 / blade.diagonal, **QUIET)
    assert result.values["passed"]
    assert result.values["checked_thickness_min"] == pytest.approx(3.0, rel=1e-3)
    assert "sharp_edges" in [message.code for message in result.messages]
    edge = result.arrays["check"] == 3
    assert edge.any() and result.shape.points[edge, 0].max() < long
    assert kinds(check(blade, minimum=3.1 / blade.diagonal)) == ["too thin"]


@pytest.mark.slow
def test_fillets_and_round_edges_are_not_thin():
    """A tray of 3 mm with a fillet of 0.5 mm at its rim, where balls are 1 mm wide."""
    turn = np.radians(np.linspace(0, 90, 7))
    arc = np.stack([20 - 0.5 + 0.5 * np.cos(turn), 3 - 0.5 + 0.5 * np.sin(turn)], axis=1)
    disc = revolved([[0, 0], [20, 0], *arc, [0, 3]], 64)
    values = check(disc, minimum=2.5 / disc.diagonal)
    assert values["passed"] and values["checked_thickness_min"] == pytest.approx(3.0, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("turned", [False, True])
def test_a_gap_between_plates_and_none_between_parts_that_overlap(turned):
    low, high = blocks((0, 30, 0, 20, 0, 2)), blocks((0, 30, 0, 20, 2.5, 5))
    pair = both(low, high)
    pair = rigid(pair, 1.0, 7.0) if turned else pair
    values = check(pair, minimum="1mm", gap="0.8mm")
    assert kinds(values) == ["gap"] and values["narrow_gaps"] == 1
    (region,) = values["regions"]
    assert region["value"] == pytest.approx(0.5, rel=1e-6)
    # One side, less half a face along its rim, where samples lie on two sides.
    assert 600 - 100 * values["spacing"] <= region["area"] <= 600
    ends = np.array([region["position"], region["opposite"]])
    assert np.linalg.norm(ends[0] - ends[1]) == pytest.approx(0.5, rel=1e-6)
    assert check(pair, minimum="1mm", gap="0.49mm")["passed"]


@pytest.mark.slow
def test_a_slot_is_a_gap_and_its_corner_is_none():
    slot = blocks((0, 30, 0, 20, 0, 3), (0, 30, 0, 8, 3, 9), (0, 30, 8.7, 20, 3, 9))
    values = check(slot, minimum="1mm", gap="1mm")
    assert kinds(values) == ["gap"]
    assert values["regions"][0]["value"] == pytest.approx(0.7, rel=1e-6)


@pytest.mark.slow
def test_solids_that_overlap_are_no_thin_wall_and_no_gap():
    pair = both(blocks((0, 30, 0, 20, 0, 5)), blocks((10, 40, 5, 15, 4.6, 10)))
    values = check(pair, minimum="1mm", gap="1mm")
    assert kinds(values) == ["overlap"] and values["passed"] and values["overlaps"] == 1
    assert values["regions"][0]["value"] == pytest.approx(0.4, rel=1e-6)


@pytest.mark.slow
def test_what_stands_on_what():
    i_beam = blocks((0, 60, 0, 40, 0, 4), (0, 60, 17, 23, 4, 36), (0, 60, 0, 40, 36, 40))
    values = check(i_beam, minimum="1mm")
    (rib,) = values["ribs"]  # the web, on both of its flanges
    assert (rib["kind"], rib["ratio"]) == ("rib", pytest.approx(1.5, rel=1e-6))
    assert not values["passed"] and values["verdict"].endswith("1 rib too thick for its wall.")
    uneven = blocks((0, 60, 0, 40, 0, 4), (0, 60, 19, 21, 4, 36), (0, 60, 0, 40, 36, 36.8))
    (rib,) = check(uneven, minimum="0.5mm", refine=0.008)["ribs"]
    assert rib["wall"] == pytest.approx(0.8, rel=1e-6)  # the thinner one
    assert rib["ratio"] == pytest.approx(2.5, rel=1e-6)
    corner = blocks((0, 60, 0, 40, 0, 4), (0, 60, 0, 4, 4, 40))
    assert check(corner, minimum="1mm")["ribs"] == []
    step = blocks((0, 30, 0, 40, 0, 4), (30, 60, 0, 40, 0, 6))
    assert check(step, minimum="1mm")["ribs"] == []
    tray = blocks((0, 60, 0, 40, 0, 3), (0, 60, 0, 3, 3, 30), (0, 60, 37, 40, 3, 30))
    assert check(tray, minimum="1mm")["ribs"] == []


@pytest.mark.slow
def test_bosses_round_and_square():
    square = blocks((0, 60, 0, 40, 0, 2), (10, 13, 18, 21, 2, 12))
    (boss,) = check(square, minimum="1mm")["ribs"]
    assert boss["kind"] == "boss" and boss["ratio"] == pytest.approx(1.5, rel=1e-6)
    disc = disc_outline(1.0, 48)
    round_one = revolved([[0, 0], [20, 0], [20, 2], [1.5, 2], [1.5, 8], [0, 8]], 48)
    (boss,) = check(round_one, refine=0.008)["ribs"]
    # the inscribed ball of a polygon of 48 corners
    inner = math.cos(math.pi / len(disc))
    assert boss["kind"] == "boss" and inner * 1.5 <= boss["ratio"] <= 1.5 + 1e-6


def turned(outline, around=64):
    """A closed outline of radius and height, turned round an axis that it does not touch."""
    return medialis.make_shape(*plates.revolved(outline, around), unit="mm")


SQUARE = [(4, 10, 4, 5.2, 2, 8), (4, 10, 8.8, 10, 2, 8), (4, 5.2, 5.2, 8.8, 2, 8),
          (8.8, 10, 5.2, 8.8, 2, 8)]  # fmt: skip
AROUND = [(0, 14, 0, 5.2, 0, 2), (0, 14, 8.8, 14, 0, 2), (0, 5.2, 5.2, 8.8, 0, 2),
          (8.8, 14, 5.2, 8.8, 0, 2)]  # fmt: skip
BORED = [(8, 0), (8, 2), (3, 2), (3, 8), (1.8, 8)]
LEAN = 8 * math.tan(math.radians(2))
STANDING = {
    # part, thinnest wall, what stands on what
    "solid boss": (lambda: revolved([[0, 0], [8, 0], [8, 2], [1.5, 2], [1.5, 8], [0, 8]], 64), 2,
                   [("boss", 1.5)]),
    "boss bored to its wall": (lambda: revolved([[0, 0], *BORED, [1.8, 2], [0, 2]], 64), 1.2,
                               [("boss", 0.6)]),
    "boss bored into its wall": (lambda: revolved([[0, 0], *BORED, [1.8, 1], [0, 1]], 64), 1,
                                 [("boss", 0.6)]),
    "boss bored through": (lambda: turned([(1.8, 0), *BORED]), 1.2, [("boss", 0.6)]),
    "boss bored wide": (lambda: turned([(3, 0), (9, 0), (9, 2), (4, 2), (4, 8), (3, 8)]), 1,
                        [("boss", 0.5)]),
    "square boss bored to its wall": (lambda: blocks((0, 14, 0, 14, 0, 2), *SQUARE), 1.2,
                                      [("boss", 0.6)]),
    "square boss bored through": (lambda: blocks(*AROUND, *SQUARE), 1.2, [("boss", 0.6)]),
    "thin rib": (lambda: blocks((0, 12, 0, 10, 0, 2), (0, 12, 4.5, 5.5, 2, 6)), 1, [("rib", 0.5)]),
    "thick rib": (lambda: blocks((0, 20, 0, 16, 0, 2), (0, 20, 6.5, 9.5, 2, 10)), 2,
                  [("rib", 1.5)]),
    "crossing ribs": (lambda: blocks((0, 12, 0, 12, 0, 2), (0, 12, 5.5, 6.5, 2, 6),
                                     (5.4, 6.6, 0, 12, 2, 6)), 1,
                      [("rib", 0.6), ("rib", 0.5)]),
    "gusset": (lambda: blocks((0, 14, 0, 10, 0, 2), (0, 2, 0, 10, 2, 10), (2, 7, 4.4, 5.6, 2, 7)),
               1.2, [("rib", 0.6)]),
    "disc with a hole": (lambda: turned([(3, 0), (9, 0), (9, 2), (3, 2)]), 2, []),
    "bent pipe wall": (lambda: turned([(3, 0), (5, 0), (5, 12), (3, 12)]), 2, []),
    "flange at an end": (lambda: turned([(8, 0), (14, 0), (14, 2), (10, 2), (10, 8), (8, 8)]), 2,
                         []),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("across", [3, 6])
@pytest.mark.parametrize("name", STANDING)
def test_what_stands_on_a_wall_is_the_same_with_few_and_many_samples(name, across):
    """A polygon of 64 corners is up to 0.12 % narrower than its circle, on both sides of a ring."""
    make, thinnest, expected = STANDING[name]
    shape = make()
    values = check(shape, refine=1.5 * thinnest / across / shape.diagonal)
    found = sorted((rib["kind"], rib["ratio"]) for rib in values["ribs"])
    assert [kind for kind, _ in found] == sorted(kind for kind, _ in expected)
    assert [ratio for _, ratio in found] == pytest.approx(
        sorted(ratio for _, ratio in expected), rel=0.005
    )


@pytest.mark.slow
@pytest.mark.parametrize("across", [3, 6])
def test_bosses_bored_through_keep_their_ratio_where_a_rib_joins_them(across):
    """With few samples the walls of the bosses are too narrow to tell that the rib stands there."""
    second = [(a + 20, b + 20, *rest) for a, b, *rest in SQUARE]
    plate = [(0, 34, 0, 5.2, 0, 2), (0, 34, 8.8, 14, 0, 2), (0, 5.2, 5.2, 8.8, 0, 2),
             (8.8, 25.2, 5.2, 8.8, 0, 2), (28.8, 34, 5.2, 8.8, 0, 2)]  # fmt: skip
    shape = blocks(*plate, *SQUARE, *second, (10, 24, 6.5, 7.5, 2, 6))
    found = check(shape, refine=1.5 / across / shape.diagonal)["ribs"]
    bosses = [rib["ratio"] for rib in found if rib["kind"] == "boss"]
    assert bosses == pytest.approx([0.6, 0.6], rel=0.005)
    (rib,) = [rib for rib in found if rib["kind"] == "rib"]
    thinnest = 1.2 if across == 12 else 2
    assert (rib["thickness"], rib["wall"]) == pytest.approx((1, thinnest), rel=0.005)


@pytest.mark.slow
@pytest.mark.parametrize("across", [3, 6])
def test_regions_gaps_and_thickness_are_the_same_with_few_and_many_samples(across):
    """A slot of 0.5 in a plate of 2 with a thin and a thick place."""
    shape = blocks((0, 6, 0, 10, 0, 2), (6.5, 12, 0, 10, 0, 2), (0, 12, 0, 3, 0, 2),
                   (12, 16, 0, 10, 0, 0.8), (0, 6, 4, 10, 2, 5))  # fmt: skip
    refine = 1.5 * 0.8 / across / shape.diagonal
    values = check(shape, refine=refine, minimum="1mm", maximum="3mm", gap="0.7mm")
    assert kinds(values) == ["too thin", "too thick", "gap"]
    assert [region["value"] for region in values["regions"]] == pytest.approx([0.8, 5, 0.5])
    assert values["checked_thickness_min"] == pytest.approx(0.8)
    # One side of the thin plate, and of what is nearer below the step to its edge than sqrt(1.6
    # (0.5 - 0.4)): there balls are still below 1. Of the slot 7 x 2.
    spacing = values["spacing"]
    thin, _, slot = (region["area"] for region in values["regions"])
    assert abs(thin - (40 + 0.5 * 0.4 * 10)) < spacing * (2 * 10 + 2)
    # Within half a gap of its closed end balls touch the end.
    assert 14 - 0.25 * 2 - spacing * 2 * (7 + 2) < slot <= 14


@pytest.mark.slow
def test_only_what_stands_on_a_wall_is_a_rib():
    """Limbs hang on limbs; a block of the same width as a rib stands on no plate."""
    assert check(medialis.organic_shape(60))["ribs"] == []
    block = blocks((0, 20, 0, 20, 0, 20), (0, 20, 9, 11, 20, 28))
    assert check(block)["ribs"] == []


@pytest.mark.slow
def test_a_rib_with_fillets_and_one_with_draft():
    arc = np.radians(np.linspace(0, 90, 7))
    fillet = np.stack([21.1 - 0.5 * np.sin(arc), 2.5 - 0.5 * np.cos(arc)], axis=1)
    right = np.array([[40, 0], [40, 2], *fillet, [20.6, 12]])
    filleted = prism(np.concatenate([right, [40, 0] + [-1, 1] * right[::-1]]), 60, longest_edge=4.0)
    (rib,) = check(filleted, refine=0.008)["ribs"]
    assert rib["ratio"] == pytest.approx(0.6, rel=0.005)
    lean = 10 * math.tan(math.radians(1.0))
    right = np.array([[40, 0], [40, 2], [20.6, 2], [20.6 - lean, 12]])
    drafted = prism(np.concatenate([right, [40, 0] + [-1, 1] * right[::-1]]), 60, longest_edge=4.0)
    (rib,) = check(drafted, refine=0.008)["ribs"]
    assert rib["thickness"] == pytest.approx(1.2, rel=0.005)  # where it stands


@pytest.mark.slow
def test_threads_and_order_change_nothing():
    shape = blocks(*RIBBED)
    one = medialis.run("wall_check", shape, threads=1, gap="1mm", **QUIET)
    two = medialis.run("wall_check", blocks(*RIBBED), threads=2, gap="1mm", **QUIET)
    assert one.values == two.values
    assert all(np.array_equal(one.arrays[k], two.arrays[k]) for k in ("thickness", "check"))


@pytest.mark.slow
def test_materials_say_their_limits_and_given_ones_win():
    shape = blocks(*RIBBED)
    values = check(shape, material="ABS")
    assert (values["minimum"], values["maximum"]) == pytest.approx((1.14, 3.56))
    assert values["passed"]
    values = check(shape, material="ABS", minimum="1.5mm")
    assert (values["minimum"], values["maximum"]) == pytest.approx((1.5, 3.56))
    inches = medialis.make_shape(shape.points / 25.4, shape.faces, unit="in")
    assert check(inches, material="ABS")["minimum"] == pytest.approx(1.14 / 25.4)
    bare = medialis.make_shape(shape.points, shape.faces)
    with pytest.raises(medialis.InvalidOptionError, match="--unit mm"):
        check(bare, material="ABS")
    with pytest.raises(medialis.InvalidOptionError, match="above the maximum"):
        check(shape, minimum="3mm", maximum="2mm")
    for low, high in MATERIALS.values():
        assert 0.3 < low < high < 20


@pytest.mark.slow
def test_without_limits_walls_are_compared_with_the_typical_one():
    plate = blocks((0, 60, 0, 40, 0, 2), (60, 70, 0, 40, 0, 0.8), (0, 10, 0, 10, 2, 4))
    values = check(plate)
    assert values["typical"] == pytest.approx(2.0, rel=1e-6)
    assert (values["minimum"], values["maximum"]) == pytest.approx((1.0, 3.0), rel=1e-6)
    assert kinds(values) == ["too thin", "too thick"]


@pytest.mark.slow
def test_layers_say_what_failed_where():
    result = medialis.run("wall_check", blocks(*RIBBED), minimum="1.5mm", maximum="3mm", **QUIET)
    layers = {layer.name: layer for layer in result.layers}
    assert set(layers) == {"wall_check", "wall_regions", "ribs", "samples"}
    samples = layers["samples"]
    thin = samples.attributes["check"] == 1
    assert np.array_equal(thin, samples.attributes["region"] == 1)
    assert np.array_equal(thin, samples.attributes["checked_thickness"] < 1.5)
    assert samples.color_limits == pytest.approx((1.5, 3.0))
    assert layers["wall_regions"].attributes["value"].tolist() == [
        region["value"] for region in result.values["regions"]
    ]
    assert layers["ribs"].attributes["ratio"] == pytest.approx([0.6], rel=1e-6)


def test_a_cloud_of_points_is_checked_as_far_as_it_goes():
    shape = medialis.refine(blocks((0, 30, 0, 20, 0, 2)), longest_edge=0.02)
    cloud = medialis.make_shape(shape.points, None, shape.normals, unit="mm")
    values = check(cloud, minimum="3mm")
    assert "too thin" in kinds(values) and values["ribs"] == []


@pytest.mark.slow
@pytest.mark.parametrize(("limit", "said"), [("1mm", "within the limits"), ("1.5mm", "1 too thin")])
def test_the_report_has_the_verdict_and_both_tables(limit, said):
    result = medialis.run("wall_check", blocks(*RIBBED), minimum=limit, **QUIET)
    measures = measure(result)
    (line,) = [line for line in measures["verdict"] if line["about"] == "Walls"]
    assert said in line["text"]
    page = report_page(measures, [])
    assert "Ribs and bosses" in page and ("Walls to look at" in page) == (limit == "1.5mm")


@pytest.mark.slow
def test_what_is_not_passed_can_end_a_program(tmp_path):
    """`--fail` of a run and of a batch, `require` in Python; ribs that are too thick count."""
    shape = blocks((0, 20, 0, 16, 0, 2), (0, 20, 6.5, 9.5, 2, 10))
    path = tmp_path / "part.ply"
    medialis.write_mesh(path, shape)
    for options, code in (
        (["--minimum", "1mm"], 1),
        (["--minimum", "1mm", "--rib-ratio", "1.6"], 0),
        (["--minimum", "2.002mm", "--rib-ratio", "1.6"], 0),  # within 0.1 %
        (["--minimum", "2.003mm", "--rib-ratio", "1.6"], 1),
    ):
        words = ["wall-check", str(path), "--unit", "mm", *options, "--no-picture", "--overwrite"]
        out = ["-o", str(tmp_path / "out")]
        assert main([*words, *out, "--fail"]) == code
        assert main([*words, *out]) == 0
    words = ["batch", "wall-check", str(path), "-o", str(tmp_path / "batch"), "--no-picture"]
    words += ["--workers", "1", "--set", "wall_check.minimum=1%"]
    assert main([*words, "--fail"]) == 1 and main(words) == 0
    result = medialis.run("wall_check", shape, minimum="1mm")
    assert result.passed is False and result.values["thick_ribs"] == 1
    with pytest.raises(medialis.NotPassedError, match="1 rib too thick"):
        result.require()
    good = medialis.run("wall_check", shape, minimum="1mm", rib_ratio=1.6)
    assert good.require() is good and good.passed is True
    assert medialis.run("thickness", shape).passed is None


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.3, 0.5])
def test_a_rounded_rim_hides_no_thin_wall_and_is_none(share):
    """A disc of 0.95 with one rim rounded by up to half of it: 1,227 mm2 for 12,166 were found."""
    turn, r, t = np.radians(np.linspace(0, 90, 9)), share * 0.95, 0.95
    arc = np.stack([20 - r + r * np.cos(turn), t - r + r * np.sin(turn)], axis=1)
    shape = revolved([[0, 0], [20, 0], *arc, [0, t]], 96)
    disc = medialis.make_shape(shape.points, shape.faces, unit="mm")
    values = check(disc, minimum="1mm")
    (region,) = values["regions"]
    inside, outside = math.pi * (20 - r) ** 2, math.pi * 20**2
    assert inside * 0.99 < region["area"] < outside
    assert region["value"] == pytest.approx(t, rel=2e-3)
    assert math.dist(region["position"], region["opposite"]) == pytest.approx(t, rel=2e-3)
    assert math.hypot(*region["position"][:2]) < 20 - r - t
    assert check(disc, minimum="0.94mm")["passed"]
